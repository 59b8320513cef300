"""Marker sheets are drawn, and found in photos that are rendered from the drawings."""

import re
import xml.etree.ElementTree as ET
from argparse import Namespace
from functools import cache
from itertools import product
from pathlib import Path

import cv2
import numpy as np
import pytest

from camgen.cli import markers as cli_markers
from camgen.cli.say import make_terminal
from camgen.model.errors import InputError, JobError
from camgen.model.pose import Pose, frozen
from camgen.vision.boards.find import _detect, _measure, find
from camgen.vision.boards.sheet import SIZES, Board, draw_pdf, draw_svg, make_sheet
from camgen.vision.camera.camera import Camera, undistort
from camgen.vision.image import Picture
from camgen.vision.plane import Plane, make_plane, map_points
from tests.vision.test_plane import error_mm, looking, seen

#: The distortion is that of a good industrial lens. From 430 mm, a photo has 4 px/mm.
CAMERA = Camera(
    matrix=frozen([[1500.0, 0, 641], [0, 1501, 458], [0, 0, 1]]),
    distortion=frozen([-0.11, 0.09, 0.0006, -0.0004, -0.02]),
    size=(1280, 920),
    name="bench",
)
EMPTY = Picture("p.png", np.full((920, 1280), 128, np.uint8))
A4 = make_sheet("A4")
#: Points in the free area of the sheet, mm.
INSIDE = np.array(list(product((0.0, 60, 150, 220), (0.0, 50, 120))))


def rectangles_of_pdf(data: bytes) -> tuple[np.ndarray, tuple[float, float]]:
    """All rectangles (left, low, width, height) and the page (width, height), points."""
    text = data.decode("ascii")
    start = int(re.search(r"startxref\n(\d+)", text)[1])  # type: ignore[index]
    assert text[start:].startswith("xref\n")
    offsets = [int(digits) for digits in re.findall(r"(\d{10}) 00000 n ", text[start:])]
    for number, offset in enumerate(offsets, 1):
        assert text[offset:].startswith(f"{number} 0 obj\n")
    length, stream = re.search(
        r"/Length (\d+) >>\nstream\n(.*)\nendstream", text, re.DOTALL
    ).groups()  # type: ignore[union-attr]
    assert int(length) == len(stream)
    box = re.search(r"/MediaBox \[0 0 (\S+) (\S+)\]", text).groups()  # type: ignore[union-attr]
    a, b, c, d, e, f = map(float, stream.split(" cm")[0].split())
    assert (a, b, c, e, f) == (d, 0, 0, 0, 0)
    lines = [line.split()[:4] for line in stream.splitlines() if line.endswith(" re")]
    return np.array(lines, float) * a, (float(box[0]), float(box[1]))


def rectangles_of_svg(data: bytes) -> tuple[np.ndarray, tuple[float, float]]:
    """All rectangles (left, low, width, height) and the page (width, height), mm."""
    root = ET.fromstring(data)
    size = [float(root.attrib[k].removesuffix("mm")) for k in ("width", "height")]
    assert root.attrib["viewBox"] == f"0 0 {size[0]:g} {size[1]:g}"
    rectangles = []
    for path in root.iter("{http://www.w3.org/2000/svg}path"):
        for x, y, w, h, back in re.findall(
            r"M(\S+) (\S+)h(\S+?)v(\S+?)h(-\S+?)z", path.attrib["d"]
        ):
            assert float(back) == -float(w)
            rectangles.append([float(x), size[1] - float(y) - float(h), float(w), float(h)])
    return np.array(rectangles), (size[0], size[1])


def painted(rectangles: np.ndarray, page: tuple[float, float], per_unit: float) -> np.ndarray:
    """The page as pixels, with black rectangles on white.

    per_unit: pixels for each unit of the rectangles.
    """
    width, height = (round(v * per_unit) for v in page)
    paper = np.full((height, width), 255, np.uint8)
    for x, y, w, h in rectangles * per_unit:
        paper[round(height - y - h) : round(height - y), round(x) : round(x + w)] = 0
    return paper


@cache
def paper(size: str, marker: float) -> np.ndarray:
    """The sheet at 18 px/mm, which is 60 px for each module of a marker of 20 mm."""
    return painted(*rectangles_of_svg(draw_svg(make_sheet(size, marker))), 18)


def pixels_of(camera: Camera) -> np.ndarray:
    v, u = np.mgrid[: camera.size[1], : camera.size[0]].astype(float)
    return np.column_stack([u.ravel(), v.ravel()])


@cache
def rays_of_the_lens() -> np.ndarray:
    return undistort(CAMERA, pixels_of(CAMERA))


def photo(
    camera: Camera,
    pose: Pose,
    page: np.ndarray,
    origin: tuple[float, float],
    blur: float = 0.7,
    noise: float = 2,
) -> Picture:
    """A photo of the page, from sixteen rays per pixel.

    page: pixels of the page, 18 px/mm
    origin: work frame from the lower left corner of the page, mm

    The map from photo to page is interpolated between the centres of pixels, exact to 1e-4 px.
    """
    width, height = camera.size
    rays = rays_of_the_lens() if camera is CAMERA else pixels_of(camera)
    page_mm = map_points(make_plane(camera, pose).work_from_pixel, rays) + origin
    page_px = np.stack([page_mm[:, 0] * 18 - 0.5, page.shape[0] - 0.5 - page_mm[:, 1] * 18])
    page_px = page_px.reshape(2, height, width)
    down, right = np.gradient(page_px, axis=(1, 2))
    grey = cv2.blur(np.where(page == 0, 30, 225).astype(np.uint8), (3, 3))
    total = np.zeros((height, width))
    for dv in (np.arange(4) - 1.5) / 4:
        for du in (np.arange(4) - 1.5) / 4:
            column, row = (page_px + dv * down + du * right).astype(np.float32)
            total += cv2.remap(grey, column, row, cv2.INTER_LINEAR, borderValue=120)
    pixels = cv2.GaussianBlur(total / 16, (0, 0), blur)
    pixels += np.random.default_rng(7).normal(0, noise, pixels.shape)
    return Picture("bench.png", np.clip(np.rint(pixels), 0, 255).astype(np.uint8))


@cache
def sheet_photo(tilt: float, blur: float = 0.7) -> tuple[Pose, Picture]:
    pose = looking(tilt, about=0, at=(112, 60), height=420)
    return pose, photo(CAMERA, pose, paper("A4", 20.0), A4.origin, blur)


def with_pixels(picture: Picture, pixels: np.ndarray) -> Picture:
    return Picture(picture.name, np.ascontiguousarray(pixels))


# -- the sheet


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("marker", [12.0, 20.0, 30.0])
def test_markers_have_white_around_them_and_leave_the_middle_free(size: str, marker: float) -> None:
    sheet = make_sheet(size, marker)
    assert 8 <= len(sheet.ids) == len(set(sheet.ids)) <= 50
    assert max(sheet.ids) < 50  # The dictionary has 50 markers.
    left, low = sheet.corners[:, 3].T
    # The markers are square and upright, with their corners in order.
    assert np.allclose(sheet.corners[:, 1] - sheet.corners[:, 3], marker)
    assert np.allclose(sheet.corners[:, 0] - sheet.corners[:, 3], (0, marker))
    # More than a module is white, in x or in y, to other markers and to the free area.
    gap_x, gap_y = np.abs(left[:, None] - left) - marker, np.abs(low[:, None] - low) - marker
    assert np.all((np.maximum(gap_x, gap_y) > marker / 6) | np.eye(len(left), dtype=bool))
    outside = np.maximum.reduce(
        [left - sheet.free[0], -left - marker, low - sheet.free[1], -low - marker]
    )
    assert outside.min() > marker / 6
    # A margin of 10 mm is free along the edges of the paper.
    page = np.array([left + sheet.origin[0], low + sheet.origin[1]])
    assert page.min() >= 10 - 1e-9
    assert np.all(page + marker <= np.array(sheet.page)[:, None] - 10 + 1e-9)


def test_the_a4_sheet_has_28_markers_around_its_free_area() -> None:
    assert A4.page == (297, 210)
    assert A4.free == (297 - 2 * 38, 210 - 38 - 48)
    assert len(A4.ids) == 28


@pytest.mark.parametrize(
    ("draw", "read", "unit"),
    [(draw_svg, rectangles_of_svg, 1.0), (draw_pdf, rectangles_of_pdf, 25.4 / 72)],
)
@pytest.mark.parametrize("size", ["A4", "letter"])
def test_the_drawing_of_a_sheet_shows_its_markers(
    draw: object, read: object, unit: float, size: str
) -> None:
    """OpenCV finds each marker upright and in its place, to 0.06 mm, in the painted rectangles."""
    sheet = make_sheet(size)
    rectangles, page = read(draw(sheet))  # type: ignore[operator]
    assert np.allclose(np.array(page) * unit, SIZES[size.upper()], atol=1e-3)
    pixels = painted(rectangles * unit, sheet.page, 10)
    markers = _detect(pixels, 0)
    numbers = [number for number, _ in markers]
    measured = _measure(pixels, np.array([corners for _, corners in markers]), None)
    assert sorted(numbers) == list(sheet.ids)
    for k, number in enumerate(sheet.ids):
        u, v = measured[numbers.index(number)].T
        mm = np.column_stack([u + 0.5, pixels.shape[0] - 0.5 - v]) / 10
        # The rectangles are painted in whole pixels.
        assert np.abs(mm - sheet.origin - sheet.corners[k]).max() < 0.06
    # The ruler is the lowest group of rectangles. It is 100 mm long.
    ruler = (rectangles * unit)[rectangles[:, 1] * unit < 14]
    assert ruler[:, 0].min() == pytest.approx(10, abs=1e-3)
    assert (ruler[:, 0] + ruler[:, 2]).max() == pytest.approx(110, abs=1e-3)
    # The last two strokes meet in the origin, and the free area is empty.
    ends = (rectangles * unit)[:, :2] + (rectangles * unit)[:, 2:]
    assert np.allclose(ends[-2:], sheet.origin, atol=1e-3)
    begins = (rectangles * unit)[:, :2] - sheet.origin
    is_inside = (ends - sheet.origin > 0.01) & (begins < np.array(sheet.free) - 0.01)
    assert not np.any(np.all(is_inside, axis=1))


def test_the_drawings_ask_for_print_without_scaling_and_for_a_measurement() -> None:
    text = draw_pdf(A4).decode("ascii")
    assert "/PrintScaling /None" in text
    assert "(Measure this: 100 mm over all." in text
    assert "Measure this: 100 mm" in draw_svg(A4).decode()
    assert draw_pdf(A4) == draw_pdf(make_sheet("a4"))


def test_a_printed_length_scales_everything() -> None:
    small = make_sheet("A4", printed=99.4)
    for name in ("page", "origin", "free", "marker", "corners"):
        assert np.allclose(np.array(getattr(small, name)), np.array(getattr(A4, name)) * 0.994)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"size": "A7"}, "no size 'A7'; give one of A4, A3"),
        ({"marker": 3.0}, "markers of 3 mm do not fit on A4; give 8 to 57.1 mm"),
        ({"marker": 80.0}, "markers of 80 mm do not fit"),
        ({"marker": float("nan")}, "do not fit"),
        ({"printed": 9.94}, "cannot be 9.94 mm long in print"),
        ({"printed": float("inf")}, "cannot be inf mm long in print"),
    ],
)
def test_a_sheet_of_invalid_size_is_refused(given: dict[str, object], message: str) -> None:
    with pytest.raises(JobError) as caught:
        make_sheet(**given)  # type: ignore[arg-type]
    assert message in str(caught.value)


# -- sheets in photos


@pytest.mark.parametrize("tilt", [0, 18, 35])
@pytest.mark.parametrize("blur", [0.7, 1.5])
def test_corners_are_found_to_a_tenth_of_a_pixel(tilt: float, blur: float) -> None:
    pose, picture = sheet_photo(tilt, blur)
    markers = _detect(picture.pixels, len(A4.ids))
    assert len(markers) >= (28 if tilt < 30 else 20)
    corners = _measure(picture.pixels, np.array([place for _, place in markers]), CAMERA)
    true = np.array([seen(CAMERA, pose, A4.corners[number]) for number, _ in markers])
    errors_px = np.linalg.norm(corners - true, axis=2)
    assert errors_px.max() < 0.1
    assert np.sqrt(np.mean(errors_px**2)) < 0.04


@pytest.mark.parametrize("tilt", [0, 18, 35])
def test_a_sheet_gives_the_work_plane(tilt: float) -> None:
    pose, picture = sheet_photo(tilt)
    plane = find(picture, CAMERA, A4)
    assert error_mm(plane, CAMERA, pose, INSIDE) < 0.01  # A pixel is 0.28 mm wide.
    assert plane.rms_mm < 0.015
    assert plane.notes == ()
    assert len(plane.residuals_px) >= 80


def test_a_sheet_is_found_in_colour_and_without_a_camera() -> None:
    pinhole = Camera(matrix=CAMERA.matrix, distortion=frozen([]), size=CAMERA.size, name="pinhole")
    pose = looking(12, about=0, at=(112, 60), height=420)
    grey = photo(pinhole, pose, paper("A4", 20.0), A4.origin)
    colour = with_pixels(grey, np.dstack([grey.pixels] * 3))
    plane = find(colour, None, A4)
    assert error_mm(plane, pinhole, pose, INSIDE) < 0.01
    assert np.allclose(plane.pixel_from_work, find(grey, None, A4).pixel_from_work)


def test_a_sheet_is_found_upside_down() -> None:
    pose, picture = sheet_photo(18)
    turned = with_pixels(picture, picture.pixels[::-1, ::-1])
    px = map_points(find(picture, None, A4).pixel_from_work, INSIDE)
    turned_px = map_points(find(turned, None, A4).pixel_from_work, INSIDE)
    assert np.abs(turned_px - (np.array(CAMERA.size) - 1 - px)).max() < 0.02
    assert pose.origin[2] > 0


def test_a_sheet_that_printed_small_makes_the_part_smaller() -> None:
    _, picture = sheet_photo(0)
    small, full = find(picture, CAMERA, make_sheet("A4", printed=99.0)), find(picture, CAMERA, A4)
    px = np.array([[640.0, 460], [900, 500]])
    assert np.allclose(
        map_points(small.work_from_pixel, px), map_points(full.work_from_pixel, px) * 0.99
    )


def test_a_height_above_the_sheet_gives_the_plane_of_the_top_face() -> None:
    """The paper is 12 mm below the top face, at which cv2.projectPoints gives the true pixels."""
    pose, picture = sheet_photo(18)
    face = Pose(pose.rotation, pose.apply((0, 0, 12)))
    plane = find(picture, CAMERA, A4, height=12)
    assert error_mm(plane, CAMERA, face, INSIDE) < 0.03
    assert error_mm(find(picture, CAMERA, A4), CAMERA, face, INSIDE) > 2


def test_a_covered_corner_is_left_out_with_its_marker() -> None:
    pose, picture = sheet_photo(0)
    pixels = picture.pixels.copy()
    # A white strip of 1.2 mm covers the right side of marker 3. The marker is still recognised,
    # with a wrong right side.
    upper, lower = A4.corners[3, 1], A4.corners[3, 2]
    strip = np.array([upper, upper, lower, lower])
    strip += [(-1.2, 1), (1, 1), (1, -1), (-1.2, -1)]
    cv2.fillConvexPoly(pixels, np.rint(seen(CAMERA, pose, strip)).astype(np.int32), 225)
    plane = find(with_pixels(picture, pixels), CAMERA, A4)
    (note,) = plane.notes
    assert note.kind == "warning"
    assert note.what == "marker 3 left out"
    assert error_mm(plane, CAMERA, pose, INSIDE) < 0.02


def covered(picture: Picture, pose: Pose, numbers: list[int]) -> Picture:
    """The photo with these markers under white paper."""
    pixels = picture.pixels.copy()
    for number in numbers:
        corners = np.rint(seen(CAMERA, pose, A4.corners[number])).astype(np.int32)
        cv2.fillConvexPoly(pixels, corners, 225)
    return with_pixels(picture, pixels)


def test_two_markers_are_noted_and_a_single_one_is_refused() -> None:
    pose, picture = sheet_photo(0)
    two = find(covered(picture, pose, [n for n in A4.ids if n not in (0, 14)]), CAMERA, A4)
    assert "only 2 of 28 markers found" in two.notes[0].what
    assert error_mm(two, CAMERA, pose, INSIDE) < 0.1
    with pytest.raises(InputError) as caught:
        find(covered(picture, pose, list(A4.ids[1:])), CAMERA, A4)
    assert "bench.png: shows 1 of the 28 markers of the camgen A4 marker sheet" in str(caught.value)


def test_a_photo_without_markers_is_refused() -> None:
    with pytest.raises(InputError, match="shows 0 of the 28 markers"):
        find(EMPTY, CAMERA, A4)


def test_markers_of_another_sheet_and_repeated_ones_are_ignored_and_named() -> None:
    pose, picture = sheet_photo(0)
    pixels = picture.pixels.copy()
    inside = np.rint(seen(CAMERA, pose, np.array([[60.0, 60], [120, 60]]))).astype(int)
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    for number, (u, v) in zip((41, 5), inside, strict=True):
        stamp = cv2.aruco.generateImageMarker(dictionary, number, 72)
        pixels[v : v + 100, u : u + 100] = 225
        pixels[v + 14 : v + 86, u + 14 : u + 86] = np.clip(stamp, 30, 225)
    plane = find(with_pixels(picture, pixels), CAMERA, A4)
    assert [(note.what, note.why) for note in plane.notes] == [
        ("marker 41 ignored", "not on this sheet"),
        ("marker 5 ignored", "in the photo more than once"),
    ]
    assert error_mm(plane, CAMERA, pose, INSIDE) < 0.01


def test_markers_of_the_wrong_size_contradict_each_other() -> None:
    _, picture = sheet_photo(0)
    with pytest.raises(JobError) as caught:
        find(picture, CAMERA, make_sheet("A4", 15.0))
    assert "contradict each other" in str(caught.value)
    assert "bench.png: camgen A4 marker sheet, markers 15 mm: " in str(caught.value)


def test_a_mirrored_photo_is_refused() -> None:
    """Some markers resemble mirror images of others. The places of these contradict each other."""
    _, picture = sheet_photo(0)
    with pytest.raises((InputError, JobError), match=r"shows \d of|contradict each other"):
        find(with_pixels(picture, picture.pixels[:, ::-1]), None, A4)


def test_a_large_photo_is_searched_reduced_and_measured_in_full() -> None:
    """The photo is enlarged three times, beyond the limit of pixels. Its corners stay as exact."""
    pose, picture = sheet_photo(0)
    large = cv2.resize(picture.pixels, None, fx=3, fy=3, interpolation=cv2.INTER_CUBIC)
    camera = Camera(
        matrix=frozen([[4500.0, 0, 641 * 3 + 1], [0, 4503, 458 * 3 + 1], [0, 0, 1]]),
        distortion=CAMERA.distortion,
        size=(3840, 2760),
        name="large",
    )
    plane = find(with_pixels(picture, large), camera, A4)
    assert len(plane.residuals_px) == 112
    assert error_mm(plane, camera, pose, INSIDE) < 0.01


# -- ChArUco board


BOARD = Board(8, 6, 15.0, 11.0, "5X5_100")


@cache
def board_page() -> np.ndarray:
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    board = cv2.aruco.CharucoBoard((8, 6), 15.0, 11.0, dictionary)
    return board.generateImage((8 * 15 * 18, 6 * 15 * 18))


@pytest.mark.parametrize("tilt", [0, 20])
def test_a_charuco_board_gives_the_work_plane(tilt: float) -> None:
    """OpenCV draws the board, whose lower left corner is the origin."""
    pose = looking(tilt, about=0, at=(60, 45), height=300)
    plane = find(photo(CAMERA, pose, board_page(), (0, 0)), CAMERA, BOARD)
    points = np.array([(0.0, 0), (120, 0), (120, 90), (0, 90), (60, 45)])
    assert error_mm(plane, CAMERA, pose, points) < 0.02  # A pixel is 0.2 mm wide.
    assert plane.rms_mm < 0.02


def test_a_photo_without_the_board_and_an_unknown_dictionary_are_refused() -> None:
    with pytest.raises(InputError, match="shows 0 corners of the ChArUco board 8x6"):
        find(EMPTY, CAMERA, BOARD)
    with pytest.raises(JobError, match="there is no '9X9'"):
        find(EMPTY, CAMERA, Board(8, 6, 15, 11, "9X9"))


def drawn_board(columns: int, rows: int, *, legacy: bool = False) -> Picture:
    """OpenCV's drawing of a board with squares of 30 mm at 2 px/mm and a white margin of 60 px."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    board = cv2.aruco.CharucoBoard((columns, rows), 30.0, 20.0, dictionary)
    board.setLegacyPattern(legacy)
    size = (columns * 60 + 120, rows * 60 + 120)
    return Picture("board.png", board.generateImage(size, marginSize=60))


def origin_px(plane: Plane) -> list[float]:
    return map_points(plane.pixel_from_work, np.zeros((1, 2)))[0].tolist()


def test_the_plane_follows_the_squares_if_the_size_of_the_markers_is_wrong() -> None:
    """The job gives markers of 19 mm. The board has markers of 20 mm, which are measured."""
    plane = find(drawn_board(7, 5), None, Board(7, 5, 30.0, 19.0))
    assert len(plane.residuals_mm) == 24 + 4 * 17
    assert plane.max_mm < 0.01
    assert np.ptp(plane.pairs_mm[:, 0]) == pytest.approx(6 * 30 + 20, abs=0.02)
    assert origin_px(plane) == pytest.approx([59.5, 359.5], abs=0.05)


@pytest.mark.parametrize(
    ("legacy", "pattern"), [(False, "of OpenCV 4.6 and later"), (True, "before OpenCV 4.6")]
)
def test_both_patterns_are_read_and_noted(legacy: bool, pattern: str) -> None:
    """The board has 35 inner corners, and 24 markers with 4 corners each.

    Its lower left corner is where the pixels (59, 419) and (60, 420) meet: the margin is 60 px wide
    and the board 360 px high.
    """
    plane = find(drawn_board(8, 6, legacy=legacy), None, Board(8, 6, 30.0, 20.0))
    assert len(plane.residuals_mm) == 35 + 4 * 24
    assert plane.max_mm < 0.01
    assert origin_px(plane) == pytest.approx([59.5, 419.5], abs=0.05)
    (note,) = [note for note in plane.notes if "pattern" in note.what]
    assert note.what == f"ChArUco board 8x6 read in the pattern {pattern}"
    assert note.kind == "assumed"


def test_an_odd_number_of_rows_has_one_pattern() -> None:
    plane = find(drawn_board(7, 5), None, Board(7, 5, 30.0, 20.0))
    assert plane.notes == ()


@pytest.mark.parametrize(
    ("declared", "what", "shift"),
    [
        (7, "no corner of the lower row of the ChArUco board 8x7", "30 mm too far up"),
        (8, "no corner of the 2 lower rows of the ChArUco board 8x8", "60 mm too far up"),
    ],
)
def test_rows_that_the_board_lacks_are_a_warning(declared: int, what: str, shift: str) -> None:
    """Markers count from the top, the origin lies at the bottom. Each row moves it by a square."""
    plane = find(drawn_board(8, 6), None, Board(8, declared, 30.0, 20.0))
    down = 60.0 * (declared - 6)
    assert origin_px(plane) == pytest.approx([59.5, 419.5 + down], abs=0.05)
    (note,) = [note for note in plane.notes if "no corner" in note.what]
    assert (note.kind, note.strict) == ("warning", True)
    assert what in note.what
    assert shift in note.why
    assert "if the board has 6 rows" in note.why


def test_markers_below_the_last_row_are_a_warning() -> None:
    """A board of 8 x 5 squares has the markers 0 to 19. The sixth row holds four more."""
    plane = find(drawn_board(8, 6), None, Board(8, 5, 30.0, 20.0))
    (note,) = [note for note in plane.notes if note.kind == "warning"]
    assert note.what == "marker 20, 21, 22, 23 is not on the ChArUco board 8x5, its last one is 19"
    assert note.strict


@pytest.mark.parametrize("columns", [7, 9])
def test_a_wrong_number_of_columns_is_refused(columns: int) -> None:
    with pytest.raises(InputError, match="shows 0 corners"):
        find(drawn_board(8, 6), None, Board(columns, 6, 30.0, 20.0))


def test_a_covered_side_that_does_not_move_the_origin_is_noted() -> None:
    """The right column of squares is covered, with its markers and the corners beside them."""
    picture = drawn_board(7, 5)
    pixels = picture.pixels.copy()
    pixels[:, 60 + 5 * 60 + 20 :] = 255
    plane = find(with_pixels(picture, pixels), None, Board(7, 5, 30.0, 20.0))
    assert origin_px(plane) == pytest.approx([59.5, 359.5], abs=0.05)
    (note,) = plane.notes
    assert note.kind == "assumed"
    assert "column" in note.what
    assert "right" in note.what


# -- command


@pytest.mark.parametrize("name", ["sheet.pdf", "sheet.SVG"])
def test_the_command_writes_the_sheet(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    target = tmp_path / name
    arguments = Namespace(output=str(target), size="A3", marker=25.0)
    cli_markers.run(arguments, make_terminal(quiet=False, verbose=0))
    draw = draw_pdf if name.endswith("pdf") else draw_svg
    assert target.read_bytes() == draw(make_sheet("A3", 25.0))
    message = capsys.readouterr().err
    assert "A3 landscape, " in message
    assert "it must be 100 mm" in message


def test_the_command_refuses_another_kind_of_file(tmp_path: Path) -> None:
    with pytest.raises(JobError, match=r"end the name in \.pdf or \.svg"):
        cli_markers.run(
            Namespace(output=str(tmp_path / "s.png"), size="A4", marker=20.0),
            make_terminal(True, 0),
        )
    assert list(tmp_path.iterdir()) == []
