"""Curves that are drawn twice, in whole or in part, are used once."""

import math
from pathlib import Path
from typing import Any

import pytest

from camgen.model.files import Source
from camgen.model.job import Choice, InputTable, Job, OperationTable, ProcessTable, Step, ToolTable
from camgen.model.part import Part
from camgen.plan import plan
from camgen.read import dxf
from camgen.read.files import Files
from tests.read.test_dxf import length, new, notes, read, written

ONCE = "(drawn twice; each is used once)"
RECTANGLE = [(0, 0), (60, 0), (60, 40), (0, 40)]


def add_halves(space: Any) -> None:
    """The rectangle in eight lines."""
    for start, end in zip(RECTANGLE, RECTANGLE[1:] + RECTANGLE[:1], strict=True):
        middle = ((start[0] + end[0]) / 2, (start[1] + end[1]) / 2)
        space.add_line(start, middle)
        space.add_line(middle, end)


def add_arcs(space: Any) -> None:
    """A circle of 20 mm in four arcs."""
    for k in range(4):
        space.add_arc((10, 5), 10, 90 * k + 17, 90 * k + 107)


@pytest.mark.parametrize("first", ["whole", "parts"])
def test_a_circle_and_its_arcs_are_one(first: str) -> None:
    document, space = new()
    if first == "whole":
        space.add_circle((10, 5), 10)
    add_arcs(space)
    if first == "parts":
        space.add_circle((10, 5), 10)
    part = read(document)
    assert [contour.closed for contour in part.contours] == [True]
    assert length(part.contours[0]) == pytest.approx(20 * math.pi)
    (note,) = notes(part)
    assert note.startswith("repaired: dropped: 1 contour on layer 0, near x ")
    assert note.endswith(ONCE)


@pytest.mark.parametrize("first", ["whole", "parts"])
def test_a_rectangle_and_its_halves_are_one(first: str) -> None:
    document, space = new()
    if first == "whole":
        space.add_lwpolyline(RECTANGLE, close=True)
    add_halves(space)
    if first == "parts":
        space.add_lwpolyline(RECTANGLE, close=True)
    part = read(document)
    assert [contour.closed for contour in part.contours] == [True]
    assert length(part.contours[0]) == pytest.approx(200)


def test_lines_that_overlap_in_part_close_an_outline() -> None:
    document, space = new()
    space.add_line((0, 0), (35, 0))
    space.add_line((60, 0), (20, 0))
    space.add_lwpolyline([(60, 0), (60, 40), (0, 40), (0, 0)])
    part = read(document)
    assert [contour.closed for contour in part.contours] == [True]
    assert length(part.contours[0]) == pytest.approx(200)
    assert notes(part) == [
        f"repaired: dropped: 15 mm of 1 LINE on layer 0, near x 27.5, y 0 {ONCE}"
    ]
    assert part.notes[0].places == ((27.5, 0.0),)


def test_outlines_of_lines_with_a_common_edge_stay_closed() -> None:
    """Each of two plates side by side has four lines. The second plate is higher."""
    document, space = new()
    for left, top in ((0, 30), (40, 50)):
        corners = [(left, 0), (left + 40, 0), (left + 40, top), (left, top)]
        for start, end in zip(corners, corners[1:] + corners[:1], strict=True):
            space.add_line(start, end, dxfattribs={"layer": str(left)})
    part = read(document)
    assert [contour.closed for contour in part.contours] == [True, True]
    assert [length(contour) for contour in part.contours] == pytest.approx([140, 180])


def test_the_part_of_a_line_that_lies_on_an_outline_is_left_out() -> None:
    document, space = new()
    space.add_line((20, 0), (75, 0))
    space.add_lwpolyline(RECTANGLE, close=True)
    part = read(document)
    rest, outline = part.contours
    assert rest.points.tolist() == [[60, 0], [75, 0]]
    assert length(outline) == pytest.approx(200)
    assert notes(part)[0] == (
        f"repaired: dropped: 40 mm of 1 contour on layer 0, near x 40, y 0 {ONCE}"
    )


def test_an_outline_repeated_with_a_small_shift_is_one() -> None:
    document, space = new()
    space.add_lwpolyline(RECTANGLE, close=True)
    space.add_lwpolyline([(x + 0.03, y - 0.02) for x, y in RECTANGLE], close=True)
    space.add_lwpolyline([(x + 0.2, y + 0.2) for x, y in RECTANGLE], close=True)
    part = read(document)
    assert len(part.contours) == 2


@pytest.mark.parametrize("join", [0.05, 0.5])
def test_a_wide_tolerance_for_joining_drops_no_curve(join: float) -> None:
    document, space = new()
    for radius in (10, 10.2, 10.4):
        space.add_circle((0, 0), radius)
    space.add_line((20, 0), (60, 0))
    space.add_line((20, 0.3), (60, 0.3))
    assert len(read(document, join=join).contours) in (4, 5)
    assert sum(map(length, read(document, join=join).contours)) > 2 * math.pi * 30.6 + 79


def test_shared_edges_of_closed_parts_stay_with_both() -> None:
    document, space = new()
    space.add_lwpolyline([(0, 0), (40, 0), (40, 40), (0, 40)], close=True)
    space.add_lwpolyline([(40, 0), (80, 0), (80, 40), (40, 40)], close=True)
    part = read(document)
    assert [contour.closed for contour in part.contours] == [True, True]
    assert part.notes == ()


def test_the_square_in_the_middle_of_nine_stays() -> None:
    """Its edges lie on edges of its neighbours, but none of them has its shape."""
    document, space = new()
    for k in (0, 1, 2, 3, 5, 6, 7, 8, 4):
        x, y = 10 * (k % 3), 10 * (k // 3)
        space.add_lwpolyline([(x, y), (x + 10, y), (x + 10, y + 10), (x, y + 10)], close=True)
    assert len(read(document).contours) == 9


def step(kind: Any, *layers: str) -> Step:
    return Step(
        tool=ToolTable(),
        operation=OperationTable(kind=kind),
        process=ProcessTable(),
        choice=Choice(layers=list(layers)),
    )


def read_for(document: Any, *operations: Step) -> Part:
    job = Job(input=InputTable(), operations=list(operations))
    return dxf.read(Source(Path("test.dxf"), written(document).encode()), job, Files())


def test_one_contour_may_be_drawn_for_each_operation() -> None:
    document, space = new()
    space.add_lwpolyline(RECTANGLE, close=True, dxfattribs={"layer": "POCKET"})
    space.add_lwpolyline(RECTANGLE, close=True, dxfattribs={"layer": "OUTLINE"})
    add_halves(space)
    both = read_for(document, step("pocket", "POCKET"), step("follow", "OUTLINE"))
    assert [contour.layer for contour in both.contours] == ["POCKET", "OUTLINE", "0"]
    # An operation that chooses both layers works on one of them.
    alone = read_for(document, step("follow", "*"))
    assert [contour.layer for contour in alone.contours] == ["POCKET"]
    assert [contour.layer for contour in read(document).contours] == ["POCKET"]


@pytest.mark.parametrize(("shared", "total"), [("once", 280), ("each", 320)])
def test_shared_edges_are_traced_once(shared: Any, total: float) -> None:
    """Two squares of 40 mm side by side have seven edges. One edge belongs to both."""
    document, space = new()
    space.add_lwpolyline([(0, 0), (40, 0), (40, 40), (0, 40)], close=True)
    space.add_lwpolyline([(40, 0), (80, 0), (80, 40), (40, 40)], close=True)
    planned = plan(read(document), Job(operation=OperationTable(kind="trace", shared=shared)))
    run = 0.0
    for path in planned.paths:
        run += sum(math.dist(a, b) for a, b in zip(path.position, path.position[1:], strict=False))
    assert run == pytest.approx(total)
    joined = [str(note) for note in planned.notes if "run once" in note.what]
    assert len(joined) == (shared == "once")


def test_common_edges_of_a_row_of_parts_are_traced_once() -> None:
    """Ten squares in a row have 31 edges. The note names the nine edges between them."""
    document, space = new()
    for k in range(10):
        x = 20 * k
        space.add_lwpolyline([(x, 0), (x + 20, 0), (x + 20, 20), (x, 20)], close=True)
    planned = plan(read(document), Job(operation=OperationTable(kind="trace")))
    (note,) = (note for note in planned.notes if "run once" in note.what)
    assert note.what == "180 mm of 9 contours lie on others and are run once"
