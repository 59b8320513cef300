"""Photos of a part on a marker sheet or beside a board are read in the area that is free."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import camgen
from camgen.model.errors import CamgenError, JobError, NoSafeProgram
from camgen.model.part import Note
from camgen.model.pose import frozen
from camgen.pipeline import Result
from camgen.read.image import _free_area
from camgen.vision.boards.sheet import draw_svg, make_sheet
from camgen.vision.camera.camera import Camera
from camgen.vision.plane import fit_plane
from tests.vision.test_markers import painted, rectangles_of_svg

CASES = Path(__file__).parents[2].parent / "shared" / "data" / "cases"
#: A camera 250 mm above the point (110, 60) of the sheet, which the middle of its photo shows. At
#: the sheet, the photo has 4 px/mm.
ABOVE, FOOT, MIDDLE, FOCAL = 250.0, (110.0, 60.0), (599.5, 449.5), 1000.0
SIZE = (1204, 900)
#: The part (left, lower, right, upper) and the height of its upper face above the sheet, mm.
PART, HEIGHT = (60.0, 30.0, 160.0, 100.0), 15.0


def camera_file(folder: Path) -> str:
    text = (
        f"image_width: {SIZE[0]}\nimage_height: {SIZE[1]}\ncamera_name: above\n"
        "camera_matrix:\n  rows: 3\n  cols: 3\n"
        f"  data: [{FOCAL}, 0, {MIDDLE[0]}, 0, {FOCAL}, {MIDDLE[1]}, 0, 0, 1]\n"
        "distortion_model: plumb_bob\ndistortion_coefficients:\n  rows: 1\n  cols: 5\n"
        "  data: [0, 0, 0, 0, 0]\n"
    )
    (folder / "camera.yaml").write_text(text)
    return str(folder / "camera.yaml")


def on_the_sheet(folder: Path, part: tuple[float, float, float, float], height: float) -> Path:
    """A photo of the A4 sheet and a dark rectangle above it, from 4 x 4 rays per pixel."""
    page = painted(*rectangles_of_svg(draw_svg(make_sheet("A4"))), 16)
    fine = np.full((SIZE[1] * 4, SIZE[0] * 4), 255, np.uint8)
    fine[42 * 4 : 42 * 4 + page.shape[0], 8 * 4 : 8 * 4 + page.shape[1]] = page
    scale = FOCAL / (ABOVE - height)
    left, right = (round((MIDDLE[0] + 0.5 + scale * (x - FOOT[0])) * 4) for x in part[::2])
    low, high = (round((MIDDLE[1] + 0.5 - scale * (y - FOOT[1])) * 4) for y in part[1::2])
    fine[high:low, left:right] = 60
    pixels = cv2.GaussianBlur(cv2.resize(fine, SIZE, interpolation=cv2.INTER_AREA), (0, 0), 0.6)
    file = folder / "sheet.png"
    cv2.imwrite(str(file), pixels)
    return file


def build(file: Path, **tables: dict[str, Any]) -> Result:
    return camgen.build(file, post="gcode", job=tables)


def box(result: Result) -> list[float]:
    points = np.concatenate([contour.points for contour in result.part.contours])
    return [*points.min(axis=0).tolist(), *points.max(axis=0).tolist()]


def notes_with(result: Result, words: str) -> list[Note]:
    return [note for note in result.notes if words in note.what]


def case(name: str) -> Path:
    if not (CASES / name).is_file():
        pytest.skip(f"{name}: the folder shared/data/cases is not there")
    return CASES / name


def test_the_free_area_shrinks_with_the_height() -> None:
    """At 15 of 250 mm, the area is 235 / 250 = 0.94 times as large, around the point below."""
    matrix = frozen([[FOCAL, 0, MIDDLE[0]], [0, FOCAL, MIDDLE[1]], [0, 0, 1]])
    camera = Camera(matrix=matrix, distortion=frozen([0.0] * 5), size=SIZE, name="above")
    mm = np.array([(0.0, 0), (200, 0), (200, 100), (0, 100), (100, 50)])
    px = np.array(MIDDLE) + (mm - FOOT) * 4 * (1, -1)
    low = fit_plane(camera, px, mm)
    assert _free_area(make_sheet("A4"), low) == pytest.approx((0, 0, 221, 124))
    high = fit_plane(camera, px, mm, height=HEIGHT)
    # 110 - 0.94 * 110 + 0.3, 60 - 0.94 * 60 + 0.3, 110 + 0.94 * 111 - 0.3, 60 + 0.94 * 64 - 0.3
    assert _free_area(make_sheet("A4"), high) == pytest.approx((6.9, 3.9, 214.04, 119.86), abs=1e-6)
    with pytest.raises(JobError, match="lies behind the camera"):
        fit_plane(camera, px, mm, height=260.0)
    with pytest.raises(JobError, match=r"\[camera\] height: at this height nothing of the free"):
        _free_area(make_sheet("A4"), fit_plane(camera, px, mm, height=249.9))


def test_a_thick_part_on_the_sheet_has_one_outline(tmp_path: Path) -> None:
    """The marks of the origin are left out. They do not count as a part at the border."""
    file = on_the_sheet(tmp_path, PART, HEIGHT)
    table = {"markers": "A4", "file": camera_file(tmp_path), "height": HEIGHT}
    result = build(file, camera=table)
    assert len(result.part.contours) == 1
    assert box(result) == pytest.approx(PART, abs=0.06)
    assert not notes_with(result, "height 0")


def test_a_height_of_0_is_noted_with_markers(tmp_path: Path) -> None:
    """A part 15 mm high appears 250 / 235 as large: from 110 - 50 * 1.0638 to 110 + 50 * 1.0638."""
    file = on_the_sheet(tmp_path, PART, HEIGHT)
    result = build(file, camera={"markers": "A4", "file": camera_file(tmp_path)})
    assert box(result)[::2] == pytest.approx([56.81, 163.19], abs=0.06)
    (note,) = notes_with(result, "height 0")
    assert note.kind == "assumed"
    assert note.what == "height 0: the part's upper face lies in the plane of the sheet"


def test_the_shared_photo_of_a_part_15_mm_high_gives_its_size() -> None:
    """The part is an L of 60..160 x 30..100 mm with a hole. A pixel is about 0.15 mm wide."""
    lens = str(case("img_height15_cam.yaml"))
    table = {"markers": "A4", "file": lens, "height": 15.0}
    result = build(case("img_height15.jpg"), camera=table)
    assert len(result.part.contours) == 2
    assert box(result) == pytest.approx((60, 30, 160, 100), abs=0.2)


BOARD = {"markers": "8x6", "square": 12.0, "marker": 9.0}


def test_the_shared_board_in_the_pattern_before_opencv_4_6_is_read() -> None:
    table = {**BOARD, "file": str(case("img_board_cam.yaml"))}
    image = {"region": [105.0, 0.0, 175.0, 70.0]}
    result = build(case("img_board_legacy.jpg"), camera=table, image=image)
    assert notes_with(result, "in the pattern before OpenCV 4.6")
    assert box(result) == pytest.approx((112, 10, 165, 60), abs=0.1)


def test_a_row_that_the_shared_board_lacks_is_a_warning() -> None:
    table = {**BOARD, "markers": "8x7", "file": str(case("img_board_cam.yaml"))}
    image = {"region": [103.0, 0.0, 180.0, 85.0]}
    result = build(case("img_board_rows.jpg"), camera=table, image=image)
    (note,) = notes_with(result, "no corner of the lower row")
    assert note.kind == "warning"
    assert "12 mm too far up" in note.why
    with pytest.raises(CamgenError, match="--strict and no corner of the lower row"):
        camgen.build(
            case("img_board_rows.jpg"),
            post="gcode",
            job={"camera": table, "image": image},
            strict=True,
        )


def beside_a_board(folder: Path, k: float) -> Path:
    """A photo, with distortion k and 10 px/mm, of a board and a part of 160..200 x 20..60 mm.

    The board has 7 x 5 squares of 20 mm.
    """
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    board = cv2.aruco.CharucoBoard((7, 5), 20.0, 15.0, dictionary)
    straight = np.full((1200, 2400), 205, np.uint8)
    straight[100:1100, 100:1500] = board.generateImage((1400, 1000), marginSize=0)
    straight[500:900, 1700:2100] = 50
    v, u = np.mgrid[:1200, :2400].astype(np.float32)
    x, y = u - 1199.5, v - 599.5
    # Position of a pixel of the photo in the straight picture, to first order.
    back = 1 - k * (x**2 + y**2) / (1199.5**2 + 599.5**2)
    u, v = 1199.5 + x * back, 599.5 + y * back
    pixels = cv2.remap(straight, u, v, cv2.INTER_LINEAR, borderValue=205)
    file = folder / "board.png"
    cv2.imwrite(str(file), pixels)
    return file


BESIDE: dict[str, Any] = {"region": [145.0, 5.0, 215.0, 90.0]}
#: Error of an outline with hard edges, mm: a tenth of a pixel, in addition to that of the place.
OUTLINE_MM = 0.01


@pytest.mark.parametrize("k", [0.0, -0.02])
def test_a_board_shows_the_lens_of_a_part_beside_it(k: float, tmp_path: Path) -> None:
    """The markers lie farther out than the inner corners, and show more of the lens."""
    table = {"markers": "7x5", "marker": 15.0, "square": 20.0}
    result = build(beside_a_board(tmp_path, k), camera=table, image=BESIDE)
    assert bool(notes_with(result, "lens from the photo: k1")) == bool(k)
    (placed,) = notes_with(result, "the part is placed to within")
    bound = float(placed.what.split()[-2])
    assert bound < 0.5
    error = np.abs(np.array(box(result)) - (160, 20, 200, 60)).max()
    # The bound covers the place alone. On some processors it is 0.001 mm, by the last bits.
    assert error < max(min(bound, 0.1), OUTLINE_MM)
    assert bool(notes_with(result, "without a calibrated lens")) == (bound > 0.1)


def test_a_part_outside_of_the_points_without_a_lens_is_refused(tmp_path: Path) -> None:
    file = beside_a_board(tmp_path, -0.02)
    mm = np.stack(np.meshgrid([20.0, 60, 120], [20.0, 50, 80]), axis=-1).reshape(-1, 2)
    straight = np.array([100, 1100]) + mm * (10, -10) - 0.5
    from_middle = straight - (1199.5, 599.5)
    stretch = 1 - 0.02 * (from_middle**2).sum(axis=1) / (1199.5**2 + 599.5**2)
    px = (1199.5, 599.5) + from_middle * stretch[:, None]
    table = {"points_px": px.tolist(), "points_mm": mm.tolist()}
    with pytest.raises(NoSafeProgram, match="without a calibrated lens: it may be") as refused:
        build(file, camera=table, image=BESIDE)
    assert refused.value.exit_code == 3
    assert 'set image.accept = ["outside"]' in str(refused.value)
    accepted = build(file, camera=table, image={**BESIDE, "accept": ["outside"]})
    (note,) = notes_with(accepted, "without a calibrated lens")
    assert (note.kind, note.strict) == ("warning", False)
    assert notes_with(accepted, "the part is placed to within")


def test_an_unknown_word_to_accept_is_refused(tmp_path: Path) -> None:
    with pytest.raises(JobError, match="accept"):
        build(beside_a_board(tmp_path, 0), image={"accept": ["everything"]})


def test_the_shared_board_without_a_calibration_shows_its_lens() -> None:
    """Without the lens, the part beside the board would be 50.8 mm wide instead of 53 mm."""
    image = {"region": [105.0, 0.0, 175.0, 70.0]}
    result = build(case("img_board_nolens12.jpg"), camera=BOARD, image=image)
    assert box(result) == pytest.approx((112, 10, 165, 60), abs=0.05)
    assert notes_with(result, "lens from the photo: k1 -0.1")
    (placed,) = notes_with(result, "the part is placed to within")
    assert float(placed.what.split()[-2]) < 0.2
