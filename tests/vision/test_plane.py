"""The work plane agrees with exact homographies, and with cv2.projectPoints."""

import cv2
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from camgen.model.errors import JobError
from camgen.model.pose import Pose, frozen, pose_from_values, rotation_from_fixed_xyz
from camgen.vision.camera.camera import Camera
from camgen.vision.plane import (
    Plane,
    compute_pose,
    compute_scales,
    find_off_line,
    fit_homography,
    fit_plane,
    make_plane,
    map_points,
)

MATRIX = np.array([[5090.0, 0, 1921], [0, 5092, 1370], [0, 0, 1]])
LENS = Camera(
    matrix=frozen(MATRIX),
    distortion=frozen([-0.11, 0.09, 0.0006, -0.0004, -0.02]),
    size=(3840, 2748),
    name="lens",
)
PINHOLE = Camera(matrix=frozen(MATRIX), distortion=frozen([]), size=(3840, 2748), name="pinhole")
#: Points of the work plane, mm.
GRID = np.stack(np.meshgrid([0.0, 120, 260, 400], [0.0, 90, 180, 300]), axis=-1).reshape(-1, 2)
SIX = np.array([(0, 0), (300, 0), (300, 200), (0, 200), (140, 90), (220, 40)], float)


def looking(
    tilt: float = 12, about: float = 30, at: tuple[float, float] = (200, 150), height: float = 700
) -> Pose:
    """The pose camera_from_work of a camera that looks at the point `at` from `height` mm.

    It is tilted by `tilt` deg around an axis in the work plane, `about` deg from x.
    """
    spin = rotation_from_fixed_xyz(0, 0, np.radians(about))
    tip = rotation_from_fixed_xyz(np.radians(180 + tilt), 0, 0)
    rotation = spin @ tip @ spin.T
    origin = np.array([0, 0, height]) - rotation @ np.array([*at, 0])
    return Pose(frozen(rotation), (float(origin[0]), float(origin[1]), float(origin[2])))


def seen(camera: Camera, pose: Pose, points: np.ndarray, z: float = 0.0) -> np.ndarray:
    """Pixels (N, 2) of work points (N, 2) at height `z` in the photo, by cv2.projectPoints."""
    solid = np.column_stack([points, np.full(len(points), z)]) @ pose.rotation.T + pose.origin
    lens = camera.distortion if len(camera.distortion) else None
    # The points are in the camera frame already: cv2.Rodrigues loses digits near half a turn.
    zero = np.zeros(3)
    return cv2.projectPoints(solid, zero, zero, camera.matrix, lens)[0].reshape(-1, 2)


def error_mm(plane: Plane, camera: Camera, pose: Pose, points: np.ndarray = GRID) -> float:
    """Largest error (mm) of the work points that the plane gives for their undistorted pixels."""
    pinhole = Camera(matrix=camera.matrix, distortion=frozen([]), size=camera.size, name="")
    ideal = seen(pinhole, pose, points)
    return float(np.linalg.norm(map_points(plane.work_from_pixel, ideal) - points, axis=1).max())


def refusal(px: object, mm: object, camera: Camera | None = None, height: float = 0.0) -> str:
    with pytest.raises(JobError) as caught:
        fit_plane(camera, px, mm, height=height)
    assert "\n" not in str(caught.value)
    return str(caught.value)


# -- point pairs


@pytest.mark.parametrize("camera", [LENS, PINHOLE])
@pytest.mark.parametrize("tilt", [0, 5, 18, 40])
@pytest.mark.parametrize("count", [4, 16])
def test_exact_pairs_give_the_exact_plane(camera: Camera, tilt: float, count: int) -> None:
    pose = looking(tilt)
    points = GRID if count == 16 else GRID[[0, 3, 15, 12]]
    plane = fit_plane(camera, seen(camera, pose, points), points)
    assert error_mm(plane, camera, pose) < 1e-6
    assert plane.rms_mm <= plane.max_mm < 1e-6
    assert plane.residuals_mm.shape == plane.residuals_px.shape == (count,)
    # The two homographies are inverse, and the points lie in front of the camera.
    assert np.allclose(plane.pixel_from_work @ plane.work_from_pixel, np.eye(3), atol=1e-9)
    assert np.all(np.column_stack([GRID, np.ones(16)]) @ plane.pixel_from_work[2] > 0)
    assert not plane.pixel_from_work.flags.writeable


def test_without_a_camera_the_photo_is_read_as_undistorted() -> None:
    pose = looking(18)
    plane = fit_plane(None, seen(PINHOLE, pose, GRID), GRID)
    assert error_mm(plane, PINHOLE, pose) < 1e-6


def test_the_distortion_of_the_lens_is_removed() -> None:
    pose = looking()
    without_lens = fit_plane(PINHOLE, seen(LENS, pose, GRID), GRID)
    assert error_mm(without_lens, PINHOLE, pose) > 0.1
    assert error_mm(fit_plane(LENS, seen(LENS, pose, GRID), GRID), LENS, pose) < 1e-6


@given(
    st.lists(st.floats(-1, 1), min_size=8, max_size=8), st.floats(1e-2, 1e3), st.floats(-1e4, 1e4)
)
def test_any_exact_homography_is_found(numbers: list[float], scale: float, offset: float) -> None:
    """The points have any unit and any distance from the origin, in front of the camera."""
    true = np.append(np.array(numbers) * ([0.4] * 6 + [0.3] * 2), 1.0).reshape(3, 3)
    true += np.diag([1.0, -1.0, 0])
    unit = np.array([(0, 0), (1, 0), (1, 1), (0, 1), (0.3, 0.6)])
    origin = map_points(true, unit[:1])[0]
    assume(np.linalg.det(true[:2, :2] - np.outer(origin, true[2, :2])) < -0.2)
    assume(compute_scales(true, unit)[:, 0].min() > 0.1)
    image = map_points(true, unit)
    assume(find_off_line(image) is None)
    source = unit * scale + offset * scale
    fitted = fit_homography(source, image)
    assert np.abs(map_points(fitted, source) - image).max() < 1e-7


def test_the_plane_of_noisy_pairs_is_more_exact_than_a_single_pair() -> None:
    """cv2.findHomography, which minimises the same sum of squares, gives the same plane."""
    pose = looking(18)
    rng = np.random.default_rng(5)
    px = seen(PINHOLE, pose, GRID) + rng.normal(0, 0.3, (16, 2))
    plane = fit_plane(PINHOLE, px, GRID)
    by_opencv = cv2.findHomography(GRID, px, 0)[0]
    assert (
        np.abs(map_points(plane.pixel_from_work, GRID) - map_points(by_opencv, GRID)).max() < 1e-3
    )
    squares = np.sum((map_points(plane.pixel_from_work, GRID) - px) ** 2)
    assert squares <= np.sum((map_points(by_opencv, GRID) - px) ** 2) * (1 + 1e-9)
    mm_per_px = 700 / 5090
    assert 0.5 < plane.rms_mm / (0.3 * np.sqrt(2) * mm_per_px) < 1.2
    assert error_mm(plane, PINHOLE, pose) < 0.3 * np.sqrt(2) * mm_per_px * 1.3


def test_each_pair_has_a_residual_in_mm_and_px() -> None:
    pose = looking(0)
    px = seen(PINHOLE, pose, GRID)
    px[5] += (1.2, 0)
    plane = fit_plane(PINHOLE, px, GRID)
    assert int(np.argmax(plane.residuals_px)) == 5
    assert plane.max_mm == pytest.approx(plane.residuals_mm[5])
    # Seen straight from above, a pixel has the same size everywhere: height over focal length.
    assert np.allclose(plane.residuals_mm, plane.residuals_px * 700 / 5091, rtol=0.01)
    assert plane.rms_mm == pytest.approx(np.sqrt(np.mean(plane.residuals_mm**2)))


def test_four_pairs_are_noted_as_unchecked() -> None:
    pose = looking()
    (note,) = fit_plane(PINHOLE, seen(PINHOLE, pose, SIX[:4]), SIX[:4]).notes
    assert note.kind == "assumed"
    assert fit_plane(PINHOLE, seen(PINHOLE, pose, SIX), SIX).notes == ()


# -- wrong pairs


@pytest.mark.parametrize("bad", range(6))
@pytest.mark.parametrize("camera", [LENS, None])
def test_a_wrong_pair_is_named(bad: int, camera: Camera | None) -> None:
    pose = looking(15)
    px = seen(camera or PINHOLE, pose, SIX) + np.random.default_rng(bad).normal(0, 0.01, (6, 2))
    wrong = SIX.copy()
    wrong[bad, 0] += 4  # mm
    message = refusal(px, wrong, camera)
    assert f"pair {bad + 1} (pixel [" in message
    assert " is wrong: the others put it " in message
    assert f"work [{wrong[bad, 0]:g}, {wrong[bad, 1]:g}] mm" in message


@pytest.mark.parametrize("seed", range(12))
def test_a_wrong_pair_among_noisy_ones_is_named(seed: int) -> None:
    rng = np.random.default_rng(seed)
    bad = int(rng.integers(16))
    px = seen(PINHOLE, looking(15), GRID) + rng.normal(0, 0.5, (16, 2))
    px[bad] += rng.choice([-1, 1], 2) * 9
    assert f"pair {bad + 1} (" in refusal(px, GRID)


@pytest.mark.parametrize("bad", range(5))
@pytest.mark.parametrize("with_camera", [True, False])
def test_the_wrong_one_of_five_pairs_is_named_as_most_likely(bad: int, with_camera: bool) -> None:
    """Residuals do not show which of five pairs is wrong: any four pairs fit exactly."""
    five = np.array([(0, 0), (300, 0), (300, 200), (0, 200), (130, 30)], float)
    px = seen(PINHOLE, looking(8), five)
    wrong = five.copy()
    wrong[bad] += (25, -18)
    message = refusal(px, wrong, PINHOLE if with_camera else None)
    assert f"most likely wrong is pair {bad + 1} (" in message


def test_pairs_with_noise_are_not_refused() -> None:
    """150 sets of 5 to 16 pairs, clicked by hand to about a pixel, give no false alarm."""
    rng = np.random.default_rng(3)
    px, fitted = seen(PINHOLE, looking(15), GRID), 0
    for _ in range(150):
        rows = rng.permutation(16)[: rng.integers(5, 17)]
        if find_off_line(GRID[rows]) is None:
            fit_plane(PINHOLE, px[rows] + rng.normal(0, 0.7, (len(rows), 2)), GRID[rows])
            fitted += 1
    assert fitted > 100


def test_two_wrong_pairs_contradict_the_others() -> None:
    wrong = SIX.copy()
    wrong[1] += (12, 3)
    wrong[4] += (-9, 11)
    assert "contradict each other" in refusal(seen(PINHOLE, looking(), SIX), wrong)


def test_a_doubtful_pair_is_noted() -> None:
    px = seen(PINHOLE, looking(), GRID)
    px[9] += (0, 2)
    px += np.random.default_rng(1).normal(0, 0.6, px.shape)
    (note,) = fit_plane(PINHOLE, px, GRID).notes
    assert note.kind == "warning"
    assert note.what.startswith("pair 10 (")


# -- refused


def test_mirrored_points_are_refused_with_a_hint() -> None:
    pose = looking(10)
    px = seen(PINHOLE, pose, SIX)
    hint = "the points are mirrored; seen from above, y runs up where v runs down"
    assert hint in refusal(px, SIX * [1, -1])
    assert "mirrored" in refusal(px, SIX[:, ::-1])
    assert "mirrored" in refusal(px[:4], SIX[:4] * [-1, 1])
    # Points that are rotated by any angle are accepted: the camera may have any roll.
    for angle in (30, 90, 180, 270):
        rotation = np.array(rotation_from_fixed_xyz(0, 0, np.radians(angle)))[:2, :2]
        fit_plane(PINHOLE, px, SIX @ rotation.T)


def test_points_in_the_wrong_order_are_refused() -> None:
    assert "in the same order" in refusal(seen(PINHOLE, looking(), SIX[:4]), SIX[[0, 2, 1, 3]])


@pytest.mark.parametrize(
    ("points", "what"),
    [
        ([(0, 0), (100, 0), (200, 0), (0, 100)], "pair 1, pair 2, pair 3 lie on one line in mm"),
        ([(0, 0), (50, 80), (100, 0.5), (200, 0)], "pair 1, pair 3, pair 4 lie on one line"),
        (
            [(0, 0), (100, 0), (200, 0), (300, 0), (120, 90)],
            "all points but pair 5 lie on one line",
        ),
        ([(0, 0), (10, 10), (20, 20), (30, 30)], "lie on one line"),
        ([(0, 0), (100, 0), (100, 0), (0, 100)], "pair 2 and pair 3 are the same point"),
    ],
)
def test_points_on_a_line_or_repeated_are_named(
    points: list[tuple[float, float]], what: str
) -> None:
    work = np.array(points, float)
    good = np.array([(10, 900), (900, 880), (870, 30), (20, 10), (500, 400)], float)[: len(work)]
    assert what in refusal(good, work)
    assert what.replace("in mm", "in the photo") in refusal(work * [2, -2] + 1000, good)


@pytest.mark.parametrize(
    ("px", "mm", "what"),
    [
        ([[1, 2], [3, 4], [5, 7]], [[1, 2], [3, 4], [5, 7]], "3 point pairs, a plane needs four"),
        (
            [[1, 2], [3, 4], [5, 7], [8, 1]],
            [[1, 2], [3, 4], [5, 7]],
            "4 points in the photo and 3 in mm",
        ),
        ([1, 2, 3], [[1, 2]], "not a list of points"),
        ([[1, 2], [3]], [[1, 2], [3, 4]], "not a list of points"),
        ([["a", "b"]] * 4, [[1, 2]] * 4, "not a list of points"),
        (
            [[1, 2], [3, 4], [5, 7], [8, float("nan")]],
            [[1, 2], [3, 4], [5, 7], [8, 1]],
            "not finite",
        ),
        (SIX, np.column_stack([SIX, np.full(6, -8.0)]), "a z other than 0"),
    ],
)
def test_an_invalid_list_of_points_is_refused(px: object, mm: object, what: str) -> None:
    assert what in refusal(px, mm)


def test_points_may_have_a_z_of_zero() -> None:
    pose = looking()
    flat = np.column_stack([GRID, np.zeros(16)])
    assert error_mm(fit_plane(LENS, seen(LENS, pose, GRID), flat), LENS, pose) < 1e-6


def test_scales_that_the_camera_contradicts_are_noted() -> None:
    """Units of x that are 6 % too long fit a plane exactly, but no photo by this camera."""
    px = seen(PINHOLE, looking(), GRID)
    assert fit_plane(PINHOLE, px, GRID).notes == ()
    (note,) = fit_plane(PINHOLE, px, GRID * [1.06, 1]).notes
    assert "x and y different scales" in note.what


# -- points below the top face


@pytest.mark.parametrize("height", [3.0, 12.5, -4.0])
@pytest.mark.parametrize("tilt", [0, 15, 35])
def test_points_below_the_top_face_give_the_plane_of_the_face(height: float, tilt: float) -> None:
    pose = looking(tilt)
    px = seen(LENS, pose, GRID, z=-height)
    plane = fit_plane(LENS, px, GRID, height=height)
    assert error_mm(plane, LENS, pose) < 1e-5
    assert plane.max_mm < 1e-6
    # Without the height, the error is about the height times the angle of view.
    assert error_mm(fit_plane(LENS, px, GRID), LENS, pose) > abs(height) * 0.2


def test_a_height_needs_a_camera() -> None:
    message = refusal(seen(PINHOLE, looking(), GRID), GRID, height=5.0)
    assert "need a camera; give [camera] file" in message


# -- pose


@given(st.floats(0, 50), st.floats(0, 360), st.floats(300, 2000))
def test_a_pose_projects_as_opencv_does(tilt: float, about: float, height: float) -> None:
    pose = looking(tilt, about, height=height)
    plane = make_plane(LENS, pose)
    assert error_mm(plane, LENS, pose) < 1e-6
    assert (plane.rms_mm, plane.max_mm, len(plane.residuals_px)) == (0, 0, 0)
    back = compute_pose(plane.pixel_from_work, LENS.matrix)
    assert np.allclose(back.rotation, pose.rotation, atol=1e-9)
    assert np.allclose(back.origin, pose.origin, atol=1e-6)


def test_a_pose_behind_the_camera_or_from_below_is_refused() -> None:
    with pytest.raises(JobError, match="behind the camera"):
        make_plane(PINHOLE, pose_from_values([0, 0, -500, 180, 0, 0]))
    with pytest.raises(JobError, match="sees the part from below"):
        make_plane(PINHOLE, pose_from_values([0, 0, 500, 0, 0, 0]))
