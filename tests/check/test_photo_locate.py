"""The pose of a drawing in a rendered photo, compared with the pose of the rendering."""

import cmath
import itertools
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import camgen
from bench.render.parts import bracket
from bench.render.shapes import Loop, box, circle, hole, pieces, rounded
from camgen.check.photo import registration
from camgen.check.photo.locate import Located
from camgen.model.errors import NoSafeProgram
from camgen.pipeline import Result
from tests.support.part_photos import (
    MIDDLE,
    PIXEL,
    PLATE,
    bumped,
    mirrored,
    photo,
    write_dxf,
)

SQUARE = (rounded([(-20, -20, 0), (20, -20, 0), (20, 20, 0), (-20, 20, 0)]),)
#: Width and height, px, of a photo in which the bracket fits.
LARGE = (840, 700)
PHOTO_JOB = {"image": {"mm_per_px": PIXEL}}
#: The tool follows the contour itself, so that its position is that of the part.
TRACE = {**PHOTO_JOB, "operation": {"kind": "trace"}, "tool": {"kind": "pen"}}


@pytest.fixture
def few_rotations(monkeypatch: pytest.MonkeyPatch) -> None:
    """Try a third of the rotations, in tests of other things."""
    monkeypatch.setattr(registration, "_TURNS", 12)


def build(drawing: Path, picture: Path, job: Any = None, **more: Any) -> Result:
    """Build a drawing at its pose in a photo."""
    return camgen.build(drawing, post="gcode", job=job or PHOTO_JOB, locate=picture, **more)


def get_located(result: Result) -> Located:
    """The location of the drawing."""
    assert result.located is not None
    return result.located


def list_photo_notes(result: Result) -> list[str]:
    """Kind and text of the notes on the photo."""
    notes = [note for note in result.notes if note.what.startswith("photo.png: ")]
    return [f"{note.kind} {note.what.removeprefix('photo.png: ')}" for note in notes]


# The pose.


@pytest.mark.usefixtures("few_rotations")
@pytest.mark.parametrize(("turn", "shift"), [(0.0, 0j), (1.1, 6 - 3j), (-2.9, -4 + 5j)])
def test_a_program_is_placed_where_the_photo_shows_the_part(
    tmp_path: Path, turn: float, shift: complex
) -> None:
    drawn = write_dxf(tmp_path / "bracket.dxf", bracket())
    middle = complex(*LARGE) / 2 * PIXEL + shift
    result = build(
        drawn, photo(tmp_path / "photo.png", bracket(), turn, at=shift, size=LARGE), TRACE
    )
    pose = get_located(result).pose
    assert abs(complex(pose.x, pose.y) - middle) < 0.02
    assert abs(math.remainder(pose.turn - turn, math.tau)) < 3e-4
    assert get_located(result).share > 0.99
    assert get_located(result).deviation < PIXEL
    # The coordinates of the text are compared with the rendered outline.
    outline = pieces([loop.moved(turn, middle) for loop in bracket()])
    words = re.findall(r"^G[0123] X([\d.-]+) Y([\d.-]+)", result.text, re.M)
    targets = [complex(float(x), float(y)) for x, y in words]
    on_contour = np.array([target for target in targets if target])  # home is at 0, 0
    assert len(on_contour) > 20
    assert outline.distance(on_contour).max() < 0.03
    assert result.motion is not None
    assert not result.motion.unproven


@pytest.mark.usefixtures("few_rotations")
def test_the_same_photo_makes_the_same_program(tmp_path: Path) -> None:
    drawn = write_dxf(tmp_path / "plate.dxf", PLATE)
    picture = photo(tmp_path / "photo.png", PLATE, 0.3)
    first, second = (build(drawn, picture) for _ in range(2))
    assert first.text == second.text
    line = re.search(r"drawing located by a photo: x (.*) y (.*) mm turned (.*) deg", first.text)
    assert line
    expected = [MIDDLE.real, MIDDLE.imag, math.degrees(0.3)]
    assert [*map(float, line.groups())] == pytest.approx(expected, abs=0.02)
    other = build(drawn, photo(tmp_path / "photo.png", PLATE, 0.31))
    digests = [re.findall("job ([0-9a-f]{12})", build.text) for build in (first, other)]
    assert digests[0] != digests[1]


@pytest.mark.usefixtures("few_rotations")
def test_seams_are_points_of_the_drawing(tmp_path: Path) -> None:
    drawn = write_dxf(tmp_path / "plate.dxf", PLATE)
    picture = photo(tmp_path / "photo.png", PLATE, 0.4, at=1 + 2j)
    result = build(drawn, picture, {**TRACE, "tour": {"seams": [[-30, 3]]}})
    (outline,) = [path for path in result.tour.paths if path.contours == ("c1",)]
    expected = (-30 + 3j) * cmath.exp(0.4j) + MIDDLE + 1 + 2j
    assert outline.position[0, :2] == pytest.approx([expected.real, expected.imag], abs=0.02)


@pytest.mark.usefixtures("few_rotations")
def test_several_drawings_are_placed_together(tmp_path: Path) -> None:
    drawn = [
        write_dxf(tmp_path / f"{number}.dxf", [loop.moved(0.0, 5 + 8j)])
        for number, loop in enumerate(PLATE)
    ]
    picture = photo(tmp_path / "photo.png", PLATE, 0.4)
    result = camgen.build(drawn, post="gcode", job=TRACE, locate=picture)
    # The middle of the part is at (5, 8) mm in the drawings.
    origin = MIDDLE - (5 + 8j) * cmath.exp(0.4j)
    pose = get_located(result).pose
    assert abs(complex(pose.x, pose.y) - origin) < 0.02
    assert get_located(result).inspection.expected.names == ("1/c1", "2/c1")
    (hole_path,) = [path for path in result.tour.paths if path.contours == ("2/c1",)]
    positions = hole_path.position[:, 0] + 1j * hole_path.position[:, 1]
    centre = (-12 + 4j) * cmath.exp(0.4j) + MIDDLE
    assert abs(positions - centre) == pytest.approx(np.full(len(positions), 7.0), abs=0.02)


# Equally good poses.


@pytest.mark.usefixtures("few_rotations")
def test_a_symmetric_part_is_not_placed_without_a_start(tmp_path: Path) -> None:
    drawn = write_dxf(tmp_path / "square.dxf", SQUARE)
    picture = photo(tmp_path / "photo.png", SQUARE, 0.1, at=3 - 2j)
    with pytest.raises(NoSafeProgram, match=r"lies in photo.png in 4 poses alike") as caught:
        build(drawn, picture)
    assert "--start" in caught.value.remedy
    poses = re.findall(r"x ([\d.-]+) y ([\d.-]+) mm turned ([\d.-]+) deg", caught.value.what)
    degrees = sorted(float(turn) for _, _, turn in poses)
    first = math.degrees(0.1)
    assert degrees == pytest.approx([first - 180, first - 90, first, first + 90], abs=0.1)
    for x, y, _ in poses:
        assert abs(complex(float(x), float(y)) - MIDDLE - 3 + 2j) < 0.05
    # Each of these poses can be selected.
    result = build(drawn, picture, start=(0, 0, 90))
    assert math.degrees(get_located(result).pose.turn) == pytest.approx(first + 90, abs=0.02)
    with pytest.raises(NoSafeProgram, match="--start: does not decide between poses alike"):
        build(drawn, picture, start=(0, 0, 50))


@pytest.mark.usefixtures("few_rotations")
def test_the_start_determines_the_rotation_of_a_ring(tmp_path: Path) -> None:
    ring = (circle(0, 0, 20), hole(circle(0, 0, 8)))
    drawn = write_dxf(tmp_path / "ring.dxf", ring)
    picture = photo(tmp_path / "photo.png", ring)
    with pytest.raises(NoSafeProgram, match=r"in \d\d poses alike: .*; and \d+ more"):
        build(drawn, picture)
    result = build(drawn, picture, start=(0, 0, 33))
    assert math.degrees(get_located(result).pose.turn) == pytest.approx(33, abs=1.0)


@pytest.mark.usefixtures("few_rotations")
def test_the_start_selects_one_of_two_equal_parts(tmp_path: Path) -> None:
    small = (rounded([(-15, -10, 0), (15, -10, 6), (15, 10, 0), (-15, 10, 0)]),)
    drawn = write_dxf(tmp_path / "plate.dxf", small)
    both = (small[0].moved(0.2, -20 + 0j), small[0].moved(0.5, 20 + 0j))
    picture = photo(tmp_path / "photo.png", both)
    with pytest.raises(NoSafeProgram, match="in 2 poses alike") as caught:
        build(drawn, picture)
    xs = sorted(float(x) for x in re.findall(r"x ([\d.-]+) y", caught.value.what))
    assert xs == pytest.approx([MIDDLE.real - 20, MIDDLE.real + 20], abs=0.05)
    right = get_located(build(drawn, picture, start=(MIDDLE.real + 18, MIDDLE.imag, 28)))
    assert right.pose.x == pytest.approx(MIDDLE.real + 20, abs=0.02)
    assert right.pose.turn == pytest.approx(0.5, abs=1e-3)
    # The other part remains as a loose thing.
    assert [difference.kind for difference in right.inspection.differences] == ["loose"]


# Photos of other things.


@pytest.mark.usefixtures("few_rotations")
def test_a_photo_of_the_other_side_is_refused(tmp_path: Path) -> None:
    drawn = write_dxf(tmp_path / "bracket.dxf", bracket())
    mirrored_part = [mirrored(loop) for loop in bracket()]
    picture = photo(tmp_path / "photo.png", mirrored_part, 0.4, size=LARGE)
    with pytest.raises(NoSafeProgram, match=r"the other side of bracket.dxf: mirrored 100 %"):
        build(drawn, picture)


@pytest.mark.usefixtures("few_rotations")
def test_a_photo_of_another_part_is_refused(tmp_path: Path) -> None:
    drawn = write_dxf(tmp_path / "bracket.dxf", bracket())
    picture = photo(tmp_path / "photo.png", PLATE, 0.4)
    with pytest.raises(NoSafeProgram, match=r"does not show bracket.dxf: \d\d % .* \(50 % must\)"):
        build(drawn, picture)
    # A plate that is 10 % shorter fits with three sides and its hole.
    shorter = (rounded([(-30, -20, 0), (24, -20, 6), (24, 20, 0), (-30, 20, 0)]), PLATE[1])
    drawn = write_dxf(tmp_path / "plate.dxf", PLATE)
    with pytest.raises(NoSafeProgram, match=r"does not show plate.dxf: 7\d % .* \(80 % must\)"):
        build(drawn, photo(tmp_path / "photo.png", shorter, 0.4))


# Deviations.


@pytest.mark.usefixtures("few_rotations")
def test_a_burr_is_warned_about_and_a_missing_hole_is_refused_with_strict(tmp_path: Path) -> None:
    drawn = write_dxf(tmp_path / "plate.dxf", PLATE)
    burred = (bumped(PLATE[0], 0, 10, 5, 0.8), PLATE[1])
    job = {**PHOTO_JOB, "tool": {"kind": "knife"}}
    result = build(drawn, photo(tmp_path / "photo.png", burred, 0.4), job, strict=True)
    tip = (-30 + 12.5 - 20.8j) * cmath.exp(0.4j) + MIDDLE
    (burr,) = get_located(result).inspection.differences
    assert abs(complex(*burr.place) - tip) < 0.5
    assert get_located(result).deviation == pytest.approx(0.8, abs=0.03)
    assert abs(complex(*get_located(result).place) - tip) < 0.5
    (warning,) = [note for note in list_photo_notes(result) if note.startswith("warning")]
    assert re.fullmatch(r"warning 1 burr, 0.[78]\d mm at [\d.]+, [\d.]+ mm, contour c1", warning)

    blank = photo(tmp_path / "photo.png", PLATE[:1], 0.4)
    assert any("1 missing feature, 7.0" in note for note in list_photo_notes(build(drawn, blank)))
    with pytest.raises(NoSafeProgram, match=r"--strict and photo.png: 1 missing feature"):
        build(drawn, blank, job, strict=True)


@pytest.mark.usefixtures("few_rotations")
@pytest.mark.parametrize("shown", [PLATE, PLATE[:1]], ids=["drilled", "blank"])
def test_holes_to_be_drilled_may_be_in_the_photo_or_not(
    tmp_path: Path, shown: Sequence[Loop]
) -> None:
    drawn = write_dxf(tmp_path / "plate.dxf", PLATE, ["outline", "holes"])
    drill = {"kind": "drill", "layers": ["holes"], "depth": 3.0, "holes": [10, 20]}
    job = {**PHOTO_JOB, "operations": [drill], "tool": {"diameter": 14.0, "kind": "drill"}}
    job["process"] = {"spindle": 2000.0}
    result = build(drawn, photo(tmp_path / "photo.png", shown, 0.4), job)
    assert get_located(result).inspection.differences == ()
    hidden = "assumed 1 contour is not in it: c2" in list_photo_notes(result)
    assert hidden == (len(shown) == 1)
    centre = (-12 + 4j) * cmath.exp(0.4j) + MIDDLE
    (path,) = result.tour.paths
    assert path.position[0, :2] == pytest.approx([centre.real, centre.imag], abs=0.02)


@pytest.mark.usefixtures("few_rotations")
def test_a_blank_is_found_by_the_outline_of_the_stock(tmp_path: Path) -> None:
    stock = (rounded([(-38, -30, 0), (38, -30, 12), (38, 30, 0), (-38, 30, 0)]),)
    drawn = write_dxf(tmp_path / "plate.dxf", (*stock, *PLATE), ["stock", "0", "0"])
    job = {
        **PHOTO_JOB,
        "stock": {"layer": "stock", "thickness": 3.0, "held": "tape"},
        "operation": {"depth": 3.0},
    }
    job["process"] = {"spindle": 9000.0}
    picture = photo(tmp_path / "photo.png", stock, 0.1)
    result = build(drawn, picture, job)
    assert get_located(result).pose.turn == pytest.approx(0.1, abs=3e-4)
    assert get_located(result).inspection.differences == ()
    assert "assumed 2 contours are not in it: c2-c3" in list_photo_notes(result)


@pytest.mark.usefixtures("few_rotations")
def test_a_chip_does_not_move_the_part(tmp_path: Path) -> None:
    drawn = write_dxf(tmp_path / "plate.dxf", PLATE)
    picture = photo(tmp_path / "photo.png", (*PLATE, box(-28, 24, 12, 26)), 0.2)
    result = build(drawn, picture)
    assert abs(complex(get_located(result).pose.x, get_located(result).pose.y) - MIDDLE) < 0.02
    # The chip does not belong to the part, and the largest deviation is on the outline.
    assert get_located(result).deviation < PIXEL
    assert any("warning 1 loose thing" in note for note in list_photo_notes(result))


@pytest.mark.usefixtures("few_rotations")
def test_the_error_bound_of_the_photo_is_noted(tmp_path: Path) -> None:
    drawn = write_dxf(tmp_path / "plate.dxf", PLATE)
    picture = photo(tmp_path / "photo.png", PLATE, 0.4)
    # Eight points whose pixels follow from the scale; the middle of the picture is the origin.
    points = [*itertools.product((-45, 45), (-36, 0, 36)), (0, -36), (0, 36)]
    pixels = [(349.5 + x / PIXEL, 279.5 - y / PIXEL) for x, y in points]
    job = {"camera": {"points_px": pixels, "points_mm": points}}
    result = build(drawn, picture, job)
    pose = get_located(result).pose
    assert abs(complex(pose.x, pose.y)) < 0.02
    assert pose.turn == pytest.approx(0.4, abs=3e-4)
    assert any("the part is placed to within 0.0" in note for note in list_photo_notes(result))


@pytest.mark.usefixtures("few_rotations")
def test_the_report_states_the_pose_of_the_part(tmp_path: Path) -> None:
    drawn = write_dxf(tmp_path / "plate.dxf", PLATE)
    burred = (bumped(PLATE[0], 0, 10, 5, 0.8), PLATE[1])
    result = build(drawn, photo(tmp_path / "photo.png", burred, 0.4))
    report: Any = result.report["located"]
    assert report["photo"] == "photo.png"
    assert report["turn_deg"] == pytest.approx(math.degrees(0.4), abs=0.02)
    assert (report["x"], report["y"]) == pytest.approx((MIDDLE.real, MIDDLE.imag), abs=0.02)
    assert report["fit"] > 0.99
    (burr,) = report["differences"]
    assert (burr["kind"], burr["contour"]) == ("burr", "c1")
    for suffix, mark in ((".svg", b">photo</text>"), (".html", b'"state":"seen"')):
        assert mark in camgen.preview(result, suffix)
    assert camgen.preview(result, ".png") != camgen.preview(
        build(drawn, photo(tmp_path / "photo.png", PLATE, 0.4)), ".png"
    )
