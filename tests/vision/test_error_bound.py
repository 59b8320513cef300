"""The error bound of a part covers the known errors of points."""

import numpy as np
import pytest

from camgen.model.pose import frozen
from camgen.vision.camera.camera import Camera
from camgen.vision.error_bound import compute_error_bound
from camgen.vision.plane import fit_plane, map_points

#: A photo with 4 px/mm, whose middle shows the point (150, 100). Its half diagonal is 721.1 px.
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
    """Pixels as seen by a lens that moves the corner of the photo by k half diagonals."""
    fraction = np.linalg.norm(px - MIDDLE, axis=1) / np.hypot(600, 400)
    moved: np.ndarray = px + k * fraction[:, None] ** 2 * (px - MIDDLE)
    return moved


@pytest.mark.parametrize("k", [-0.05, -0.01, 0.02])
def test_the_bound_covers_the_error_of_an_uncorrected_lens(k: float) -> None:
    """Points without noise determine k, so the bound is the error up to terms of second order."""
    plane = fit_plane(None, bent(straight(GRID), k), GRID)
    outline = map_points(plane.work_from_pixel, bent(straight(BESIDE), k))
    error = np.linalg.norm(outline - BESIDE, axis=1).max()
    bound = compute_error_bound(plane, None, SIZE, outline)
    assert error > 0.3
    assert error < bound.total < 1.5 * error + 0.05


def test_the_bound_of_a_calibrated_lens_covers_the_noise() -> None:
    """With noise of 0.1 px at each point, the bound is exceeded in at most 2 of 200 photos."""
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


def test_the_bound_grows_with_the_distance_from_the_points() -> None:
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
    """From 250 mm, a point at a height of 25 mm appears 1 / 0.9 times as far from (150, 100)."""
    plane = fit_plane(CAMERA, straight(GRID), GRID, height=25.0)
    # At this height, x = 150 - 0.9 * 50 = 105 appears where the plane of the points has x = 100.
    bound = compute_error_bound(plane, CAMERA, SIZE, np.array([(105.0, 100 - 0.9 * 40)]))
    assert bound.outside == pytest.approx(0, abs=1e-3)
    bound = compute_error_bound(plane, CAMERA, SIZE, np.array([(114.0, 100 - 0.9 * 40)]))
    assert bound.outside == pytest.approx(10, abs=1e-3)


def test_five_points_determine_no_bound() -> None:
    """Five points give ten numbers for nine unknowns."""
    plane = fit_plane(None, straight(GRID[[0, 4, 12, 20, 24]]), GRID[[0, 4, 12, 20, 24]])
    bound = compute_error_bound(plane, None, SIZE, BESIDE)
    assert not bound.known
    assert bound.outside > 100
