"""An outline with a gap is recognised by its gap, its length and the contours in it."""

import math
from collections.abc import Sequence
from pathlib import Path

import ezdxf
import pytest

import camgen
from camgen.model.part import OpenOutline, Part
from camgen.pipeline.inputs import join_parts
from camgen.read.made import make_part

Point = tuple[float, float]
#: A point of a polyline and the bulge after it: x, y, tan of a quarter of the sweep.
Corner = tuple[float, float, float]


def plate(gap: float) -> list[list[Corner]]:
    """A plate of 100 x 60 mm, counter-clockwise, open by `gap` mm at the end of its left side."""
    corners = [(0, 0), (100, 0), (100, 60), (0, 60), (0, gap)]
    return [straight(corners)]


def straight(corners: Sequence[Point]) -> list[Corner]:
    return [(x, y, 0.0) for x, y in corners]


def halves(low: float, high: float) -> list[list[Corner]]:
    """The plate in two halves, with a gap in the lower side and one in the upper side, mm."""
    left = [(50 - low, 0), (0, 0), (0, 60), (50, 60)]
    right = [(50 + high, 60), (100, 60), (100, 0), (50, 0)]
    return [straight(left), straight(right)]


def arc(degrees: float) -> list[list[Corner]]:
    """An arc around (50, 30) with a radius of 25 mm."""
    half_sweep = math.radians(degrees) / 2
    bulge = math.tan(half_sweep / 4)
    start, middle, end = (on_circle(k * half_sweep) for k in range(3))
    return [[(*start, bulge), (*middle, bulge), (*end, 0.0)]]


def chord_middle(degrees: float) -> Point:
    """The middle of the line that closes the arc."""
    start, end = on_circle(0), on_circle(math.radians(degrees))
    return (start[0] + end[0]) / 2, (start[1] + end[1]) / 2


def on_circle(angle: float) -> Point:
    return 50 + 25 * math.cos(angle), 30 + 25 * math.sin(angle)


def dashes(count: int, fraction: float) -> list[list[Corner]]:
    """A circle around (50, 30) of `count` arcs. A gap of `fraction` of its sweep follows each."""
    step = 2 * math.pi / count
    sweep = step / (1 + fraction)
    pieces = []
    for k in range(count):
        start, end = on_circle(k * step), on_circle(k * step + sweep)
        pieces.append([(*start, math.tan(sweep / 4)), (*end, 0.0)])
    return pieces


def draw(
    file: Path,
    pieces: Sequence[Sequence[Corner]],
    windows: Sequence[Sequence[Point]],
    layer: str = "0",
) -> Path:
    """A DXF drawing in mm with open pieces, and closed windows after them."""
    document = ezdxf.new("R2010", units=4)
    for piece in pieces:
        document.modelspace().add_lwpolyline(piece, "xyb", dxfattribs={"layer": layer})
    for window in windows:
        document.modelspace().add_lwpolyline(window, close=True)
    document.saveas(file)
    return file


WINDOW = [(40.0, 25.0), (60.0, 25.0), (60.0, 35.0), (40.0, 35.0)]


def outlines(file: Path, join: float = 0.05, **job: object) -> tuple[OpenOutline, ...]:
    return camgen.read(file, {"input": {"join": join}, **job}).open_outlines


def closed_contours(part: Part) -> int:
    return sum(contour.closed for contour in part.contours)


@pytest.mark.parametrize(
    ("pieces", "gap", "place"),
    [
        (plate(0.5), 0.5, (0.0, 0.25)),
        (plate(15.9), 15.9, (0.0, 7.95)),  # 5 % of 320 mm are 16 mm
        (halves(0.4, 0.7), 0.7, (50.35, 60.0)),
        # The chord of 15 degrees of a circle with a radius of 25 mm: 6.5 mm, 4.2 % of the length.
        (arc(345), 50 * math.sin(math.radians(7.5)), chord_middle(345)),
    ],
    ids=["plate", "wide", "halves", "arc"],
)
def test_the_gap_is_measured_and_its_value_closes_the_outline(
    tmp_path: Path, pieces: list[list[Corner]], gap: float, place: Point
) -> None:
    file = draw(tmp_path / "part.dxf", pieces, [WINDOW])
    (outline,) = outlines(file)
    assert outline.ids == tuple(f"c{k + 1}" for k in range(len(pieces)))
    assert outline.inside == (f"c{len(pieces) + 1}",)
    assert outline.gap == pytest.approx(gap, abs=1e-6)
    assert outline.place == pytest.approx(place, abs=1e-6)
    assert gap < outline.join <= gap + 0.002 + 1e-9
    assert closed_contours(camgen.read(file, {"input": {"join": gap - 0.001}})) == 1
    part = camgen.read(file, {"input": {"join": outline.join}})
    assert closed_contours(part) == 2
    assert part.open_outlines == ()


@pytest.mark.parametrize(
    ("pieces", "windows"),
    [
        (plate(16.1), [WINDOW]),  # over 5 % of 320 mm
        (arc(340), [WINDOW]),  # the chord of 20 degrees is 5.6 % of the length
        (dashes(24, 0.1), [WINDOW]),  # 1/11 of the circle
        (plate(0.5), [[(90.0, 25.0), (110.0, 25.0), (110.0, 35.0), (90.0, 35.0)]]),  # across it
        (plate(0.5), [[(190.0, 25.0), (210.0, 25.0), (210.0, 35.0)]]),  # beside it
        (plate(0.5), [[(0.0, 0.0), (100.0, 0.0), (100.0, 60.0), (0.0, 60.0)]]),  # on top of it
        (
            [[(0, 0, 0.0), (100, 60, 0.0), (100, 0, 0.0), (0, 60, 0.0), (0, 0.5, 0.0)]],
            [WINDOW],
        ),  # a figure of eight
    ],
    ids=["too wide", "arc", "dashes", "across", "beside", "twice", "crossing itself"],
)
def test_other_open_lines_are_not_outlines(
    tmp_path: Path, pieces: list[list[Corner]], windows: list[list[Point]]
) -> None:
    assert outlines(draw(tmp_path / "part.dxf", pieces, windows)) == ()


def test_a_window_that_touches_the_outline_lies_in_it(tmp_path: Path) -> None:
    corner = [(100.0, 60.0), (80.0, 60.0), (80.0, 40.0), (100.0, 40.0)]
    (outline,) = outlines(draw(tmp_path / "part.dxf", plate(0.5), [corner]))
    assert outline.inside == ("c2",)


def test_one_value_closes_all_outlines(tmp_path: Path) -> None:
    small = [[(x + 200, y, bulge) for x, y, bulge in plate(0.2)[0]]]
    windows = [WINDOW, [(x + 200, y) for x, y in WINDOW]]
    file = draw(tmp_path / "part.dxf", plate(0.9) + small, windows)
    assert [(o.ids, o.inside, round(o.gap, 6)) for o in outlines(file)] == [
        (("c1",), ("c3",), 0.9),
        (("c2",), ("c4",), 0.2),
    ]
    (join,) = {outline.join for outline in outlines(file)}
    assert closed_contours(camgen.read(file, {"input": {"join": join}})) == 4


@pytest.mark.parametrize(
    ("job", "count"),
    [
        ({"operation": {"kind": "follow"}}, 1),
        ({"operation": {"kind": "pocket"}}, 1),
        ({"operation": {"kind": "trace"}}, 0),
        ({"operation": {"kind": "drill"}}, 0),
        ({"page": {"size": "A4"}}, 0),  # a page is traced
        ({"operations": [{"kind": "trace"}, {"kind": "follow"}]}, 1),
        ({"operations": [{"kind": "trace"}, {"kind": "drill"}]}, 0),
        ({"operations": [{"kind": "drill", "nesting": "inner"}]}, 1),
    ],
    ids=str,
)
def test_outlines_are_searched_if_an_operation_has_sides(
    tmp_path: Path, job: dict[str, object], count: int
) -> None:
    file = draw(tmp_path / "part.dxf", plate(0.5), [WINDOW])
    assert len(outlines(file, **job)) == count


def test_outlines_of_several_drawings_keep_their_contours(tmp_path: Path) -> None:
    file = draw(tmp_path / "part.dxf", plate(0.5), [WINDOW])
    both = join_parts([camgen.read(file), camgen.read(file)])
    assert [(outline.ids, outline.inside) for outline in both.open_outlines] == [
        (("1/c1",), ("1/c2",)),
        (("2/c1",), ("2/c2",)),
    ]


def test_no_setting_closes_a_part_that_was_made_in_code() -> None:
    corners = [(x, y) for x, y, _ in plate(0.5)[0]]
    (outline,) = make_part([corners, [*WINDOW, WINDOW[0]]]).open_outlines
    assert (outline.ids, outline.inside, outline.join) == (("c1",), ("c2",), 0.0)
