"""Views are resampled from photos whose grey value at each pixel is known by formula."""

import cv2
import numpy as np
import pytest

from camgen.model.errors import InputError, JobError
from camgen.model.pose import frozen
from camgen.vision.camera.camera import Camera, distort, sample_photo
from camgen.vision.image import Picture
from camgen.vision.plane import fit_plane, make_plane, map_points
from camgen.vision.to_scale import (
    ScaledView,
    make_plane_view,
    make_scaled_view,
    map_to_photo,
    map_to_work,
    measure_mm_per_pixel,
    rectify,
    remap,
)
from tests.vision.test_plane import LENS, MATRIX, PINHOLE, looking, seen

#: A small camera with the strong distortion of a cheap lens.
SMALL = Camera(
    matrix=frozen([[800.0, 0, 321], [0, 802, 236], [0, 0, 1]]),
    distortion=frozen([-0.28, 0.1, 0.001, -0.0006, -0.02]),
    size=(640, 480),
    name="small",
)


def pixel_positions(view: ScaledView) -> np.ndarray:
    """Work point (H, W, 2) of each pixel of the view, mm."""
    v, u = np.mgrid[: view.pixels.shape[0], : view.pixels.shape[1]]
    return np.dstack([u, v]) @ view.work_from_view[:, :2].T + view.work_from_view[:, 2]


def photo_of(camera: Camera, values: np.ndarray) -> Picture:
    pixels = values.reshape(camera.size[1], camera.size[0]).astype(np.uint8)
    return Picture("photo.png", np.ascontiguousarray(pixels))


#: `LENS` with a quarter of its pixels along each side.
QUARTER = Camera(
    matrix=frozen(MATRIX * [[0.25], [0.25], [1]]),
    distortion=LENS.distortion,
    size=(960, 687),
    name="quarter",
)


@pytest.mark.parametrize(
    ("camera", "height", "region"),
    [
        (SMALL, 110, None),
        (QUARTER, 700, (100, 60, 320, 240)),
        # A corner of the photo, at which the distortion is largest.
        (LENS, 700, (380, 100, 460, 150)),
        (LENS, 700, (150, 100, 260, 160)),
    ],
)
@pytest.mark.parametrize("tilt", [0, 25])
def test_every_view_pixel_comes_from_its_place_in_the_photo(
    camera: Camera, height: float, region: tuple[float, float, float, float] | None, tilt: float
) -> None:
    """The map of the view and cv2.projectPoints differ by less than 0.002 px at 20000 pixels."""
    pose = looking(tilt, height=height)
    plane = make_plane(camera, pose)
    view = rectify(blank(camera), camera, plane, region)
    # The values of this photo are u and v, which interpolation gives back exactly. It has three
    # channels, as OpenCV quantises two to 1/32 px.
    v, u = np.mgrid[: camera.size[1], : camera.size[0]].astype(np.float32)
    rows, columns = view.pixels.shape[:2]
    shown, valid = remap(
        np.dstack([u, v, u]),  # type: ignore[arg-type]
        make_plane_view(camera, plane, camera.size),
        view.work_from_view,
        (columns, rows),
    )
    rng = np.random.default_rng(0)
    row, column = rng.integers(0, rows, 20_000), rng.integers(0, columns, 20_000)
    usable = valid[row, column]
    mm = pixel_positions(view)[row, column][usable]
    assert len(mm) > 3000
    assert np.abs(shown[row, column][usable][:, :2] - seen(camera, pose, mm)).max() < 0.002


@pytest.mark.parametrize("camera", [SMALL, PINHOLE])
def test_a_smooth_pattern_keeps_its_place(camera: Camera) -> None:
    """Waves of 12 mm in the photo have the same phase in the view, to 0.005 px."""
    small = Camera(matrix=SMALL.matrix, distortion=camera.distortion, size=SMALL.size, name="")
    pose = looking(15, height=440)
    plane = make_plane(small, pose)
    mm = map_to_work(make_plane_view(small, plane, small.size), photo_grid(small.size))
    waves = 127 + 60 * np.sin(mm[:, 0] * 2 * np.pi / 12) + 60 * np.cos(mm[:, 1] * 2 * np.pi / 12)
    view = rectify(photo_of(small, np.rint(waves)), small, plane)
    x, y = np.moveaxis(pixel_positions(view), 2, 0) * 2 * np.pi / 12
    valid = view.valid if view.valid is not None else np.ones(x.shape, bool)
    columns = np.stack([np.sin(x), np.cos(x), np.sin(y), np.cos(y), np.ones(x.shape)], axis=-1)[
        valid
    ]
    fit = np.linalg.lstsq(columns, view.pixels[valid].astype(float))[0]
    phases = np.array([np.arctan2(fit[1], fit[0]), np.arctan2(-fit[2], fit[3])])
    # A pixel of the photo is 0.55 mm wide.
    assert np.abs(phases * 12 / (2 * np.pi)).max() / 0.55 < 0.005
    assert np.hypot(fit[0], fit[1]) == pytest.approx(60, rel=0.05)


def photo_grid(size: tuple[int, int]) -> np.ndarray:
    v, u = np.mgrid[: size[1], : size[0]].astype(float)
    return np.column_stack([u.ravel(), v.ravel()])


def test_dots_lie_in_the_view_where_they_were_drawn_in_the_photo() -> None:
    """cv2.projectPoints places dots in the photo. Their centres of gravity are compared."""
    pose = looking(18, at=(20, 15), height=110)
    px = seen(SMALL, pose, DOTS)
    v, u = np.mgrid[:480, :640]
    photo = np.full((480, 640), 220.0)
    for a, b in px:
        photo -= 200 * np.exp(-((u - a) ** 2 + (v - b) ** 2) / (2 * 2.5**2))
    view = rectify(photo_of(SMALL, np.rint(photo)), SMALL, make_plane(SMALL, pose))
    positions = pixel_positions(view)
    for dot in DOTS:
        near = np.hypot(*np.moveaxis(positions - dot, 2, 0)) < 1.2
        centre = np.average(positions[near], axis=0, weights=220.0 - view.pixels[near])
        assert np.linalg.norm(centre - dot) < 0.01


DOTS = np.array([(5.0, 6), (35, 6), (34, 25), (6, 26), (20, 15)])


# -- scale, region and visible part


@pytest.mark.parametrize("tilt", [0, 10, 25])
@pytest.mark.parametrize("camera", [QUARTER, SMALL])
def test_the_view_is_nowhere_coarser_than_the_photo(camera: Camera, tilt: float) -> None:
    """A step of one view pixel is at most one photo pixel in any direction, by projectPoints."""
    height = 700 if camera is QUARTER else 110
    pose = looking(tilt, height=height)
    view = rectify(blank(camera), camera, make_plane(camera, pose))
    mm = pixel_positions(view)[::37, ::29].reshape(-1, 2)
    valid = np.ones(len(mm), bool) if view.valid is None else view.valid[::37, ::29].ravel()
    longest = 0.0
    for angle in np.linspace(0, np.pi, 12, endpoint=False):
        step = view.mm_per_px * np.array([np.cos(angle), np.sin(angle)])
        steps_px = seen(camera, pose, mm[valid] + step) - seen(camera, pose, mm[valid])
        longest = max(longest, float(np.linalg.norm(steps_px, axis=1).max()))
    # The photo may be finest between two samples, so the longest step is a bit shorter than 1 px.
    assert 0.97 < longest < 1.003
    # The scale has at most three digits.
    assert f"{view.mm_per_px:.3g}" == f"{view.mm_per_px:g}"


def blank(camera: Camera) -> Picture:
    return Picture("photo.png", np.full((camera.size[1], camera.size[0]), 200, np.uint8))


def test_a_view_has_x_to_the_right_y_up_and_whole_pixels() -> None:
    view = rectify(blank(QUARTER), QUARTER, make_plane(QUARTER, looking(10)))
    s = view.mm_per_px
    assert view.work_from_view[:, :2].tolist() == [[s, 0], [0, -s]]
    # Pixel centres lie on whole multiples of the scale.
    assert np.allclose(view.work_from_view[:, 2] / s, np.rint(view.work_from_view[:, 2] / s))
    assert not view.pixels.flags.writeable


def test_the_view_holds_the_whole_photo_and_only_the_photo_is_valid() -> None:
    pose = looking(20, about=50)
    plane = make_plane(QUARTER, pose)
    view = rectify(blank(QUARTER), QUARTER, plane)
    plane_view = make_plane_view(QUARTER, plane, QUARTER.size)
    border = map_to_work(plane_view, sample_photo(QUARTER.size, 40))
    first, last = pixel_positions(view)[-1, 0], pixel_positions(view)[0, -1]
    assert np.all(border.min(axis=0) >= first)
    assert np.all(border.max(axis=0) <= last)
    mm = pixel_positions(view)[::31, ::29]
    px = seen(QUARTER, pose, mm.reshape(-1, 2))
    margin = np.minimum(px, np.array(QUARTER.size) - 1 - px).min(axis=1).reshape(mm.shape[:2])
    assert view.valid is not None
    valid = view.valid[::31, ::29]
    assert np.all(valid[margin > 0.01])
    assert not np.any(valid[margin < -0.01])
    pixels = view.pixels[::31, ::29]
    assert np.all(pixels[valid] == 200)
    assert np.all(pixels[margin < -1.01] == 0)


@pytest.mark.parametrize("focal", [800.0, 560.0])
def test_a_lens_model_with_a_fold_shows_nothing_twice(focal: float) -> None:
    """With k1 = -0.5, points beyond a radius of sqrt(2 / 3) would appear inside the photo again.

    With the shorter focal length, the corners of the photo show nothing: they lie beyond the fold.
    """
    matrix = frozen([[focal, 0, 321], [0, focal, 236], [0, 0, 1]])
    folding = Camera(
        matrix=matrix, distortion=frozen([-0.5, 0, 0, 0, 0]), size=(640, 480), name="folding"
    )
    far = np.array([[1.2, 0, 1.0]])
    zero = np.zeros(3)
    folded, _ = cv2.projectPoints(far, zero, zero, folding.matrix, folding.distortion)
    assert 0 < folded[0, 0, 0] < 640  # The formula of OpenCV places the point in the photo.
    assert np.isnan(distort(folding, np.array([[321 + 1.2 * focal, 236]]))).all()
    plane = make_plane(folding, looking(0, height=110, at=(200, 150)))
    shown = make_plane_view(folding, plane, folding.size)
    seen_mm = map_to_work(shown, sample_photo(folding.size, 20))
    assert np.isnan(seen_mm).any() == (focal < 700)
    region = (108.0, 58.0, 292.0, 242.0)
    view = rectify(blank(folding), folding, plane, region)
    assert view.valid is not None
    assert 0.05 < view.valid.mean() < 0.9
    mm = pixel_positions(view)[view.valid]
    ideal = (map_points(plane.pixel_from_work, mm) - folding.matrix[:2, 2]) / focal
    radius = np.linalg.norm(ideal, axis=1)
    assert radius.max() < np.sqrt(2 / 3)
    px = ideal * (1 - 0.5 * radius**2)[:, None] * focal + folding.matrix[:2, 2]
    assert np.all((px > -0.1) & (px < np.array(folding.size) - 0.9))
    # The view shows nearly the whole photo.
    assert radius.max() > (0.55 if focal > 700 else 0.78)


def test_a_region_is_cut_out_of_the_view() -> None:
    pose = looking(25)
    plane = make_plane(QUARTER, pose)
    whole = rectify(blank(QUARTER), QUARTER, plane)
    part = rectify(blank(QUARTER), QUARTER, plane, (150, 100, 250, 160))
    assert part.valid is None
    assert part.mm_per_px >= whole.mm_per_px
    first, last = pixel_positions(part)[-1, 0], pixel_positions(part)[0, -1]
    assert np.all(np.abs(first - (150, 100)) < part.mm_per_px)
    assert np.all(np.abs(last - (250, 160)) < part.mm_per_px)


def test_a_region_outside_of_the_photo_is_invalid_or_refused() -> None:
    plane = make_plane(SMALL, looking(0, height=110, at=(20, 15)))
    view = rectify(blank(SMALL), SMALL, plane, (20, 15, 90, 75))
    assert view.valid is not None
    assert 0.1 < view.valid.mean() < 0.9
    with pytest.raises(InputError, match=r"does not show the region \(\[500, 500, 510, 510\] mm\)"):
        rectify(blank(SMALL), SMALL, plane, (500, 500, 510, 510))
    for bad in ((0.0, 0, 0, 5), (0.0, 0, float("nan"), 5), (5.0, 0, 1, 5)):
        with pytest.raises(JobError, match="is not a rectangle"):
            rectify(blank(SMALL), SMALL, plane, bad)


@pytest.mark.parametrize("camera", [SMALL, None])
def test_a_horizon_in_the_photo_does_not_make_an_endless_view(camera: Camera | None) -> None:
    pose = looking(75, about=0, height=110, at=(20, 15))
    plane = make_plane(SMALL, pose)
    view = rectify(blank(SMALL), camera, plane)
    assert view.pixels.size <= 6 * 640 * 480
    (note,) = view.notes
    assert "of the photo left out of the view" in note.what
    # The rest of the photo is at most 4.6 times coarser than its finest place.
    plane_view = make_plane_view(camera, plane, SMALL.size)
    fine, coarse = measure_mm_per_pixel(plane_view, pixel_positions(view)[view.valid][::50])
    assert coarse.max() < 4.6 * fine.min()


def test_a_view_far_larger_than_the_photo_is_refused() -> None:
    plane = make_plane(SMALL, looking(0, height=110, at=(20, 15)))
    with pytest.raises(InputError, match=r"its view would have \d+ x \d+ pixels, over 6 times"):
        rectify(blank(SMALL), SMALL, plane, (0, 0, 900, 900))


def test_a_view_without_a_camera_follows_the_points() -> None:
    pose = looking(15, height=110, at=(20, 15))
    pinhole = Camera(matrix=SMALL.matrix, distortion=frozen([]), size=SMALL.size, name="pinhole")
    plane = fit_plane(None, seen(pinhole, pose, DOTS), DOTS)
    shown = make_plane_view(None, plane, SMALL.size)
    assert np.abs(map_to_photo(shown, DOTS) - seen(pinhole, pose, DOTS)).max() < 1e-6
    view = rectify(blank(SMALL), None, plane)
    corners_px = np.array([[0.0, 0], [639, 0], [0, 479], [639, 479]])
    corners = map_points(plane.work_from_pixel, corners_px)
    assert np.abs(corners.min(axis=0) - pixel_positions(view)[-1, 0]).max() < view.mm_per_px
    assert np.abs(corners.max(axis=0) - pixel_positions(view)[0, -1]).max() < view.mm_per_px


def test_a_view_keeps_the_colour_of_the_photo() -> None:
    photo = np.zeros((480, 640, 3), np.uint8)
    photo[:] = (10, 120, 240)
    plane = make_plane(SMALL, looking(0, height=110, at=(20, 15)))
    view = rectify(Picture("p", photo), SMALL, plane)
    assert view.pixels.shape[2] == 3
    middle = view.pixels[view.pixels.shape[0] // 2, view.pixels.shape[1] // 2]
    assert middle.tolist() == [10, 120, 240]


def test_a_photo_that_the_camera_cannot_have_taken_is_refused() -> None:
    plane = make_plane(SMALL, looking(0, height=110))
    with pytest.raises(
        InputError, match="is 480 x 640 px, camera small was calibrated with 640 x 480"
    ):
        rectify(Picture("p.jpg", np.zeros((640, 480), np.uint8)), SMALL, plane)
    with pytest.raises(InputError, match="turned by its Exif orientation"):
        rectify(Picture("p.jpg", np.zeros((480, 640), np.uint8), turned=True), SMALL, plane)


# -- pictures to scale


def test_the_origin_of_a_picture_to_scale_is_its_lower_left_corner() -> None:
    picture = Picture("scan.png", np.zeros((20, 30), np.uint8))
    view = make_scaled_view(picture, mm_per_px=0.5)
    assert np.allclose(pixel_positions(view)[-1, 0], (0.25, 0.25))
    assert np.allclose(pixel_positions(view)[0, -1], (30 * 0.5 - 0.25, 20 * 0.5 - 0.25))
    assert view.pixels is picture.pixels
    assert (view.valid, view.notes) == (None, ())


@pytest.mark.parametrize(
    ("given", "scale"),
    [({"mm_per_px": 0.2}, 0.2), ({"width_mm": 60.0}, 2.0), ({}, 25.4 / 300)],
)
def test_a_scale_is_given_by_a_pixel_a_width_or_a_density(
    given: dict[str, float], scale: float
) -> None:
    picture = Picture("scan.png", np.zeros((20, 30), np.uint8), dpi=300.0)
    view = make_scaled_view(picture, **given)
    assert view.mm_per_px == pytest.approx(scale)
    assert bool(view.notes) == (not given)


def test_the_refusal_of_a_picture_without_scale_lists_the_settings() -> None:
    with pytest.raises(InputError) as caught:
        make_scaled_view(Picture("scan.png", np.zeros((20, 30), np.uint8)))
    for setting in ("[image] mm_per_px", "width_mm", "DPI", "points_px", "plane_from", "markers"):
        assert setting in str(caught.value)


@pytest.mark.parametrize("given", [{"mm_per_px": 0.0}, {"width_mm": -3.0}, {"mm_per_px": np.nan}])
def test_an_invalid_scale_is_refused(given: dict[str, float]) -> None:
    with pytest.raises(JobError, match="must be more than 0"):
        make_scaled_view(Picture("scan.png", np.zeros((20, 30), np.uint8)), **given)


def test_two_scales_are_refused() -> None:
    with pytest.raises(JobError, match="mm_per_px and width_mm are both given"):
        make_scaled_view(
            Picture("scan.png", np.zeros((20, 30), np.uint8)), mm_per_px=0.1, width_mm=50
        )


def test_linear_interpolation_of_this_opencv_is_exact_enough() -> None:
    """cv2.remap of a ramp in float gives the position to 0.001 px. The views depend on it."""
    ramp = np.tile(np.arange(500, dtype=np.float32), (4, 1))
    u = np.linspace(1, 498, 4000, dtype=np.float32)[None]
    values = cv2.remap(ramp, u, np.full_like(u, 1.3), cv2.INTER_LINEAR)
    assert np.abs(values - u).max() < 0.001
