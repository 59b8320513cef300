"""A photo of a sheet shows its lens. The corners are those of cv2.projectPoints."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from msgspec.structs import replace

from camgen.model.errors import JobError
from camgen.model.pose import Pose, frozen
from camgen.vision.boards.corners import make_chessboard
from camgen.vision.boards.lens import compute_chance, fit_sheet_lens
from camgen.vision.boards.sheet import make_sheet
from camgen.vision.camera.calibrate import read_photo
from camgen.vision.camera.camera import Camera, distort, undistort
from camgen.vision.error_bound import compute_error_bound
from camgen.vision.plane import fit_homography, fit_plane, map_points
from tests.support.files import source
from tests.vision.test_plane import looking, seen

REAL = Path(__file__).parents[2].parent / "shared" / "data" / "calib" / "opencv-left"
SIZE = (2400, 1718)
MIDDLE = np.array([1199.5, 858.5])
CORNERS = make_sheet("A4").corners.reshape(-1, 2)
#: A rectangle in the free area, mm.
PART = np.stack(np.meshgrid([20.0, 65, 110, 155, 200], [15.0, 60, 110]), axis=-1).reshape(-1, 2)
#: Error of a corner along each axis, px (rms).
NOISE = 0.05


class SheetPhoto(NamedTuple):
    """A photo of the sheet.

    camera: camera of the photo.
    pose: pose of the sheet in the camera frame.
    px: (N, 2) corners of the markers, px.
    """

    camera: Camera
    pose: Pose
    px: np.ndarray


def take(seed: int, k1: float, tilt: float = 15.0, decentred: float = 0.007) -> SheetPhoto:
    """A photo of the sheet by a random camera.

    k1: coefficient of the distortion. Without distortion, it is 0.
    tilt: deg.
    decentred: standard deviation of the principal point from the middle, in widths of the photo.
    """
    rng = np.random.default_rng(seed)
    focal = rng.uniform(0.8, 1.2) * SIZE[0]
    u, v = MIDDLE + rng.normal(0, decentred, 2) * SIZE[0]
    bent = [k1, -0.3 * k1, *rng.normal(0, 2e-4, 2), 0.0] if k1 else [0.0] * 5
    matrix = frozen([[focal, 0, u], [0, focal, v], [0, 0, 1]])
    camera = Camera(matrix=matrix, distortion=frozen(bent), size=SIZE, name="true")
    pose = looking(tilt, rng.uniform(0, 360), (110, 62), focal / SIZE[0] * 380)
    px = seen(camera, pose, CORNERS)
    return SheetPhoto(camera, pose, px + rng.normal(0, NOISE, px.shape))


@pytest.mark.parametrize("k1", [-0.25, -0.08, 0.04])
def test_the_fit_gives_the_true_lens(k1: float) -> None:
    """k1, k2 and the principal point are within four standard deviations in each of ten photos."""
    ratios = []
    for seed in range(10):
        photo = take(seed, k1, 25.0)
        fitted = fit_sheet_lens(photo.px, CORNERS, SIZE, needs_focal=False)
        assert fitted is not None
        assert fitted.bends
        # A coefficient times f^2 does not depend on the focal length, which the fit does not know.
        ratio = photo.camera.matrix[0, 0] / fitted.camera.matrix[0, 0]
        k = fitted.camera.distortion[:2] * [ratio**2, ratio**4] - photo.camera.distortion[:2]
        centre = fitted.camera.matrix[:2, 2] - photo.camera.matrix[:2, 2]
        ratios.append(np.concatenate([k, centre]) / fitted.deviations)
    assert np.abs(ratios).max() < 4
    assert 0.2 < np.sqrt(np.mean(np.square(ratios))) < 1.6


@pytest.mark.parametrize("k1", [-0.25, -0.02])
def test_the_lens_places_a_part_within_the_bound(k1: float) -> None:
    """The lens moves the part by 3 to 40 px. With the fit, the error is less than 0.03 mm."""
    for seed in range(10):
        photo = take(seed, k1)
        lens = fit_sheet_lens(photo.px, CORNERS, SIZE, needs_focal=False)
        assert lens is not None
        plane = replace(fit_plane(lens.camera, photo.px, CORNERS), lens=lens)
        px = undistort(lens.camera, seen(photo.camera, photo.pose, PART))
        outline = map_points(plane.work_from_pixel, px)
        error = np.linalg.norm(outline - PART, axis=1).max()
        bound = compute_error_bound(plane, lens.camera, SIZE, outline)
        assert error < min(bound.total, 0.03)
        assert 0 < bound.lens < bound.total < 0.05


def test_a_photo_without_distortion_shows_no_lens() -> None:
    """Every second one of 300 photos has markers that are displaced as a whole."""
    for seed in range(300):
        photo = take(seed, 0.0, tilt=seed % 36)
        rng = np.random.default_rng([seed, 1])
        marks = rng.normal(0, NOISE * (seed % 2), (len(CORNERS) // 4, 2))
        px = photo.px + np.repeat(marks, 4, axis=0)
        assert fit_sheet_lens(px, CORNERS, SIZE, needs_focal=False) is None


def test_corners_without_any_noise_show_no_lens() -> None:
    """Rounding errors of a computation are not treated as measurements of a lens."""
    photo = take(3, 0.0)
    px = seen(photo.camera, photo.pose, CORNERS)
    assert fit_sheet_lens(px, CORNERS, SIZE, needs_focal=False) is None


def test_the_chance_is_that_of_the_f_distribution() -> None:
    """Tables give 3.8714 for 1 % with 6 and 20 degrees of freedom, and 2.1750 for 5 % with 120."""
    assert compute_chance(1.0, 1 + 6 * 3.8714 / 20, 20) == pytest.approx(0.01, rel=1e-4)
    assert compute_chance(1.0, 1 + 6 * 2.1750 / 120, 120) == pytest.approx(0.05, rel=1e-3)
    assert compute_chance(2.0, 2.0, 100) == 1


@pytest.mark.parametrize("k1", [0.0, -0.15])
def test_a_tilt_determines_the_focal_length(k1: float) -> None:
    for seed in range(12):
        photo = take(seed, k1, 28.0)
        fitted = fit_sheet_lens(photo.px, CORNERS, SIZE, needs_focal=True)
        assert fitted is not None
        assert fitted.focal is not None
        focal = photo.camera.matrix[0, 0]
        assert fitted.focal[0] < focal < fitted.focal[1]
        assert abs(fitted.camera.matrix[0, 0] / focal - 1) < 0.06
        assert fitted.focal[1] / fitted.focal[0] < 1.35


@pytest.mark.parametrize("k1", [0.0, -0.15])
def test_the_bound_of_a_height_covers_focal_length_and_principal_point(k1: float) -> None:
    """The part is h = 5 mm high, at the distance d.

    An error of s px in the principal point moves the point below the camera by s d / f, and the
    outline by h / (d - h) times as much.
    """
    for seed in range(8):
        photo = take(seed, k1, 28.0)
        lens = fit_sheet_lens(photo.px, CORNERS, SIZE, needs_focal=True)
        assert lens is not None
        plane = fit_plane(lens.camera, photo.px, CORNERS, height=5.0)
        plane = replace(plane, lens=lens)
        px = undistort(lens.camera, seen(photo.camera, photo.pose, PART, 5.0))
        outline = map_points(plane.work_from_pixel, px)
        bound = compute_error_bound(plane, lens.camera, SIZE, outline)
        assert np.linalg.norm(outline - PART, axis=1).max() < bound.total < 0.6
        focal = lens.camera.matrix[0, 0]
        exact = replace(plane, lens=replace(lens, focal=(focal, focal)))
        shift = 5 * 3 * np.hypot(*lens.deviations[2:]) / focal
        alone = compute_error_bound(exact, lens.camera, SIZE, outline)
        assert 0.7 * shift < alone.height < 1.5 * shift
        assert bound.height > alone.height
        bounds = [compute_error_bound(plane, lens.camera, SIZE, point[None]) for point in outline]
        largest = max(point_bound.total for point_bound in bounds)
        assert bound.total == pytest.approx(largest, rel=1e-9)


@pytest.mark.parametrize("k1", [0.0, -0.15])
def test_a_photo_from_straight_above_has_the_focal_length_of_an_ordinary_camera(k1: float) -> None:
    half = np.hypot(SIZE[0] - 1, SIZE[1] - 1) / 2
    for seed in range(6):
        photo = take(seed, k1, 1.0)
        fitted = fit_sheet_lens(photo.px, CORNERS, SIZE, needs_focal=True)
        assert fitted is not None
        assert fitted.focal is not None
        assert not fitted.is_focal_known
        assert half * 0.999 < fitted.focal[0] < photo.camera.matrix[0, 0] < fitted.focal[1]
        assert fitted.focal[1] < 6.001 * half
        assert "among those of ordinary cameras" in fitted.note.why


def test_four_points_hardly_determine_the_focal_length() -> None:
    """The corners of one marker fit any homography, so that their noise does not show."""
    photo = take(0, 0.0, 30.0)
    four = [0, 1, 2, 3]
    fitted = fit_sheet_lens(photo.px[four], CORNERS[four], SIZE, needs_focal=True)
    assert fitted is not None
    assert fitted.focal is not None
    assert fitted.focal[0] < photo.camera.matrix[0, 0] < fitted.focal[1]
    whole = fit_sheet_lens(photo.px, CORNERS, SIZE, needs_focal=True)
    assert whole is not None
    assert whole.focal is not None
    assert np.diff(fitted.focal) > 2 * np.diff(whole.focal)


def test_the_focal_length_of_the_file_helps_from_straight_above() -> None:
    """The focal length in the file has an error of 3 %, as a whole number of mm may have."""
    for seed in range(6):
        photo = take(seed, -0.15, 1.0)
        focal = photo.camera.matrix[0, 0]
        fitted = fit_sheet_lens(photo.px, CORNERS, SIZE, True, 1.03 * focal)
        assert fitted is not None
        assert fitted.focal is not None
        assert fitted.focal[0] < focal < fitted.focal[1]
        assert abs(fitted.camera.matrix[0, 0] / focal - 1) < 0.06
        assert "the 35 mm focal length in the file" in fitted.note.why


def test_a_focal_length_that_contradicts_the_tilt_is_not_used() -> None:
    photo = take(2, 0.0, 35.0)
    fitted = fit_sheet_lens(photo.px, CORNERS, SIZE, True, 2 * photo.camera.matrix[0, 0])
    assert fitted is not None
    assert fitted.focal is None


def test_a_cropped_photo_has_a_lens_and_no_focal_length() -> None:
    """The left fifth of the photo is missing, so its principal point is 240 px from the middle."""
    photo = take(5, -0.25)
    cut = photo.px - [480.0, 0]
    inside = cut[:, 0] > 0
    lens = fit_sheet_lens(cut[inside], CORNERS[inside], (1920, SIZE[1]), needs_focal=True)
    assert lens is not None
    assert lens.focal is None
    ideal = undistort(lens.camera, seen(photo.camera, photo.pose, PART) - [480.0, 0])
    plane = fit_plane(lens.camera, cut[inside], CORNERS[inside])
    assert np.linalg.norm(map_points(plane.work_from_pixel, ideal) - PART, axis=1).max() < 0.03


def test_contradicting_corners_of_a_sheet_suggest_to_give_the_lens() -> None:
    """The user did not measure these corners, and is not asked to measure one again."""
    photo = take(5, -0.25)
    with pytest.raises(JobError) as caught:
        fit_plane(None, photo.px, CORNERS, source="photo.png: sheet")
    assert "measure it again" not in str(caught.value)
    assert "if the lens bends much, give camera.file" in str(caught.value)


@pytest.mark.skipif(not REAL.is_dir(), reason="the developer data set is not beside the repository")
def test_real_photos_show_the_lens_of_a_cheap_camera() -> None:
    """13 photos of a chessboard together give f = 534 px. The principal point is 3.6 % off.

    Half of each board is fitted and predicts the other half. Without the lens, the error would be
    6 mm or more.
    """
    for file in sorted(REAL.glob("*.jpg")):
        board = read_photo(source(file), make_chessboard(9, 6, 25.0))
        assert board.seen is not None
        px, mm = board.seen.corners, board.seen.places
        lens = fit_sheet_lens(px, mm, board.size, needs_focal=True)
        assert lens is not None
        assert lens.focal is not None
        assert lens.focal[0] < 534 < lens.focal[1]
        assert abs(lens.camera.matrix[0, 0] / 534 - 1) < 0.05
        left = mm[:, 0] < np.median(mm[:, 0])
        half = fit_sheet_lens(px[left], mm[left], board.size, needs_focal=False)
        assert half is not None
        ideal = undistort(half.camera, px)
        back = np.linalg.inv(fit_homography(mm[left], ideal[left]))
        assert np.linalg.norm(map_points(back, ideal) - mm, axis=1).max() < 2.5


def test_few_corners_show_no_lens() -> None:
    photo = take(6, -0.25)
    rows = [0, 30, 60, 90, 10, 50, 70, 100, 20, 40, 80]
    assert fit_sheet_lens(photo.px[rows], CORNERS[rows], SIZE, needs_focal=False) is None


def test_last_digits_of_the_corners_do_not_change_the_camera() -> None:
    """Processors differ in the last digits of a fit. The camera is rounded, so that views agree."""
    photo = take(7, -0.15)
    shift = 1e-9 * np.sin(np.arange(len(CORNERS) * 2)).reshape(-1, 2)
    both = [
        fit_sheet_lens(px, CORNERS, SIZE, needs_focal=True) for px in (photo.px, photo.px + shift)
    ]
    assert both[0] is not None
    assert both[1] is not None
    assert both[0].camera.matrix.tolist() == both[1].camera.matrix.tolist()
    assert both[0].camera.distortion.tolist() == both[1].camera.distortion.tolist()
    assert both[0].note == both[1].note


def test_the_camera_of_a_sheet_has_the_coefficients_of_opencv() -> None:
    """With the order and units of OpenCV, the coefficients give the corners again."""
    photo = take(8, -0.2)
    fitted = fit_sheet_lens(photo.px, CORNERS, SIZE, needs_focal=False)
    assert fitted is not None
    ideal = undistort(fitted.camera, photo.px)
    on_plane = map_points(fit_homography(CORNERS, ideal), CORNERS)
    error = np.linalg.norm(distort(fitted.camera, on_plane) - photo.px, axis=1)
    assert np.sqrt(np.mean(error**2)) < 1.6 * NOISE
    assert f"k1 {fitted.camera.distortion[0]:.4f}"[:9] in fitted.note.what
