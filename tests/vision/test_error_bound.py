"""The error bound of a part: against points whose errors are known."""

import numpy as np
import pytest

from camgen.model.pose import frozen
from camgen.vision.camera.camera import Camera
from camgen.vision.error_bound import compute_error_bound
from camgen.vision.plane import fit_plane, map_points

#: 4 px a mm, the place (150, 100) in the middle of a photo with a half diagonal of 721.1 px.
SIZE, MIDDLE = (1201, 801), np.array([600.0, 400.0])
CAMERA = Camera(
    matrix=frozen([[1000.0, 0, 600], [0, 1000, 400], [0, 0, 1]]),
    distortion=frozen([0.0] * 5),
    size=SIZE,
    name="straight",
)
GRID = np.stack(np.meshgrid(*[np.arange(20.0, 101, 20)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
BESIDE = np.array([(220.0, 40), (260, 40), (260, 120), (220, 120)])


def straight(mm: np.ndarray) -> np.ndarray:
    return MIDDLE + (mm - (150.0, 100.0)) * (4, -4)


def bent(px: np.ndarray, k: float) -> np.ndarray:
    """Through a lens with the distortion k: the corner of the photo moves by k half diagonals."""
    share = np.linalg.norm(px - MIDDLE, axis=1) / np.hypot(600, 400)
    moved: np.ndarray = px + k * share[:, None] ** 2 * (px - MIDDLE)
    return moved


@pytest.mark.parametrize("k", [-0.05, -0.01, 0.02])
def test_a_lens_that_nothing_corrects_moves_a_part_by_what_the_bound_says(k: float) -> None:
    """Points without noise give k: the bound is the true error up to terms of second order."""
    plane = fit_plane(None, bent(straight(GRID), k), GRID)
    outline = map_points(plane.work_from_pixel, bent(straight(BESIDE), k))
    error = np.linalg.norm(outline - BESIDE, axis=1).max()
    bound = compute_error_bound(plane, None, SIZE, outline)
    assert error > 0.3
    assert error < bound.total < 1.5 * error + 0.05


def test_a_calibrated_lens_leaves_the_noise() -> None:
    """0.1 px of noise at each point: two of 200 photos at most leave the bound."""
    rng = np.random.default_rng(4)
    errors, bounds = [], []
    for _ in range(200):
        px = straight(GRID) + rng.normal(0, 0.1, GRID.shape)
        plane = fit_plane(CAMERA, px, GRID)
        outline = map_points(plane.work_from_pixel, straight(BESIDE))
        errors.append(np.linalg.norm(outline - BESIDE, axis=1).max())
        bound = compute_error_bound(plane, CAMERA, SIZE, BESIDE)
        assert bound.lens == 0
        bounds.append(bound.noise)
    assert np.count_nonzero(np.array(errors) > bounds) <= 2
    assert np.mean(bounds) < 4 * np.sqrt(np.mean(np.square(errors))) * 1.2


def test_the_bound_grows_with_the_distance_and_not_among_the_points() -> None:
    px = straight(GRID) + np.random.default_rng(1).normal(0, 0.05, GRID.shape)
    plane = fit_plane(None, px, GRID)
    among, near, far = (
        compute_error_bound(plane, None, SIZE, np.array([place]))
        for place in ((60.0, 60.0), (130.0, 60.0), (260.0, 60.0))
    )
    assert [round(bound.outside, 3) for bound in (among, near, far)] == [0, 30, 160]
    assert among.total < near.total < far.total
    assert among.total < 0.05


def test_a_height_is_judged_in_the_plane_of_the_points() -> None:
    """The camera is 250 mm up: a place at 25 mm is seen 1/0.9 as far from (150, 100)."""
    plane = fit_plane(CAMERA, straight(GRID), GRID, height=25.0)
    # 150 - 0.9 * 50 = 105 is 5 mm to the left of the point at x = 100, seen from above.
    bound = compute_error_bound(plane, CAMERA, SIZE, np.array([(105.0, 100 - 0.9 * 40)]))
    assert bound.outside == pytest.approx(0, abs=1e-3)
    bound = compute_error_bound(plane, CAMERA, SIZE, np.array([(114.0, 100 - 0.9 * 40)]))
    assert bound.outside == pytest.approx(10, abs=1e-3)


def test_five_points_tell_no_bound() -> None:
    """Ten numbers for nine unknowns."""
    plane = fit_plane(None, straight(GRID[[0, 4, 12, 20, 24]]), GRID[[0, 4, 12, 20, 24]])
    bound = compute_error_bound(plane, None, SIZE, BESIDE)
    assert not bound.known
    assert bound.outside > 100
