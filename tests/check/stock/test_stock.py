"""The stock proof against formulas: distances, depths, areas and volumes of motions written by hand."""

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
import pytest
from msgspec.structs import replace

from camgen.check.stock import Cut, StockProof, Task, design, prove
from camgen.model.job import Job, OperationTable, ProcessTable, StockTable, ToolTable
from camgen.model.part import Contour, Part
from camgen.model.pose import TOOL_DOWN, Pose
from camgen.model.program import Instruction, MoveC, MoveJ, MoveL

Holder = Literal["frame", "vacuum", "tape"]
MILL = ToolTable(diameter=6.0)
Place = tuple[float, float, float]


def at(*place: float) -> Pose:
    x, y, z = place
    return Pose(TOOL_DOWN, (x, y, z))


def rapid(*place: float) -> Instruction:
    return MoveJ(at(*place), 100.0)


def feed(*place: float) -> Instruction:
    return MoveL(at(*place), 10.0)


def circle(x: float, y: float, radius: float, z: float) -> list[Instruction]:
    """Down to z at its right and once round, counter-clockwise, in two halves."""
    right, left = (x + radius, y, z), (x - radius, y, z)
    down: list[Instruction] = [rapid(x + radius, y, 5.0), feed(*right)]
    halves = [
        MoveC(at(x, y + radius, z), at(*left), 10.0),
        MoveC(at(x, y - radius, z), at(*right), 10.0),
    ]
    return [*down, *halves, rapid(x + radius, y, 5.0)]


def around(
    low: float, high: float, radius: float, z: float, shift: float = 0.0
) -> list[Instruction]:
    """Outside of the square from ``low`` to ``high``, with arcs about its corners; all of it moved to the right."""
    a, b, r, h = low, high, radius, radius / math.sqrt(2)
    corners: list[tuple[Place, Place, Place]] = [
        ((b, a - r, z), (b + h, a - h, z), (b + r, a, z)),
        ((b + r, b, z), (b + h, b + h, z), (b, b + r, z)),
        ((a, b + r, z), (a - h, b + h, z), (a - r, b, z)),
        ((a - r, a, z), (a - h, a - h, z), (a, a - r, z)),
    ]
    body: list[Instruction] = [rapid(a + shift, a - r, 5.0), feed(a + shift, a - r, z)]
    for start, via, end in corners:
        moved = [at(x + shift, y, height) for x, y, height in (start, via, end)]
        body += [MoveL(moved[0], 10.0), MoveC(moved[1], moved[2], 10.0)]
    return [*body, rapid(a + shift, a - r, 5.0)]


def loop(name: str, *points: tuple[float, float], bulge: float = 0.0) -> Contour:
    return Contour(np.array(points), np.full(len(points), bulge), True, "0", name)


def square(name: str, low: float, high: float) -> Contour:
    return loop(name, (low, low), (high, low), (high, high), (low, high))


def disc(name: str, x: float, y: float, radius: float) -> Contour:
    return loop(name, (x + radius, y), (x - radius, y), bulge=1.0)


def part(*contours: Contour, worked: frozenset[str] | None = None) -> Part:
    return Part("p", "p.dxf", "mm", contours, (), worked=worked)


def task(
    drawn: Part,
    kind: str = "follow",
    depth: float = 5.0,
    tool: ToolTable = MILL,
    **settings: object,
) -> Task:
    operation = OperationTable(kind=kind, depth=depth, **settings)  # type: ignore[arg-type]  # kinds to come too
    return Task(Job(operation=operation, tool=tool, process=ProcessTable()), drawn)


def proof(
    body: Sequence[Instruction],
    *tasks: Task,
    tool: ToolTable = MILL,
    thickness: float | None = 5.0,
    held: Holder = "tape",
) -> StockProof:
    cut = Cut(body, range(1, len(body) + 1), tool, "p.ngc")
    stock = StockTable(thickness=thickness, held=held)
    return prove([cut], design(tasks, stock), stock=stock)


# Gouges.


@pytest.mark.parametrize("depth", [1.0, 5.0])
def test_beside_a_square_nothing_is_cut_of_it(depth: float) -> None:
    assert proof(around(0, 40, 3.0, -depth), task(part(square("c1", 0, 40)))).refused == ()


@pytest.mark.parametrize(
    ("shift", "mm"), [(0.004, None), (0.006, 0.006), (0.1, 0.1), (2.0, 2.0), (9.0, 5.0)]
)
def test_a_path_that_is_moved_aside_cuts_by_so_much(shift: float, mm: float | None) -> None:
    found = proof(around(0, 40, 3.0, -5.0, shift), task(part(square("c1", 0, 40)))).gouges
    if mm is None:
        assert found == ()
        return
    # On its left side the tool goes into the square; no way out is longer than the cut is deep.
    assert max(fault.mm for fault in found) == pytest.approx(mm, abs=1e-6)
    worst = max(found, key=lambda fault: fault.mm)
    assert -3.0 <= worst.x <= shift
    assert worst.z == -5.0
    assert worst.file == "p.ngc"
    assert isinstance(around(0, 40, 3.0, -5.0, shift)[worst.line - 1], (MoveL, MoveC))


@pytest.mark.parametrize(("radius", "mm"), [(7.0, None), (7.004, None), (7.02, 0.02), (7.5, 0.5)])
def test_an_arc_that_is_too_wide_cuts_into_the_hole_s_wall(radius: float, mm: float | None) -> None:
    drawn = part(square("c1", -50, 50), disc("c2", 0, 0, 10.0))
    found = proof(circle(0, 0, radius, -5.0), task(drawn)).gouges
    # The plunge, and both halves.
    assert [fault.line for fault in found] == ([] if mm is None else [2, 3, 4])
    assert [fault.mm for fault in found] == (
        [] if mm is None else pytest.approx([mm] * 3, abs=1e-9)
    )


def test_the_plunge_and_all_of_a_path_in_the_material_are_gouges() -> None:
    body = [rapid(20, 20, 5), feed(20, 20, -2), feed(25, 20, -2), rapid(25, 20, 5)]
    found = proof(body, task(part(square("c1", 0, 40)))).gouges
    assert [fault.line for fault in found] == [2, 3]
    assert [fault.mm for fault in found] == pytest.approx([2.0, 2.0])


def test_deeper_than_the_operation_is_a_gouge_of_what_lies_below() -> None:
    drawn = part(square("c1", 0, 40))
    found = proof(around(0, 40, 3.0, -5.2), task(drawn)).gouges
    assert {round(fault.mm, 6) for fault in found} == {0.2}
    assert "too deep" in found[0].text


def test_each_place_has_the_depth_of_the_deepest_operation_there() -> None:
    drawn = part(square("c1", 0, 60), square("c2", 20, 40))
    pocket = task(part(*drawn.contours, worked=frozenset({"c2"})), "pocket", 2.0)
    outline = task(part(*drawn.contours, worked=frozenset({"c1"})), "follow", 5.0)
    inside = [rapid(25, 25, 5), feed(25, 25, -2), feed(35, 35, -2), rapid(35, 35, 5)]
    assert proof([*inside, *around(0, 60, 3.0, -5.0)], pocket, outline).refused == ()
    deeper = [rapid(25, 25, 5), feed(25, 25, -3), feed(35, 35, -3), rapid(35, 35, 5)]
    assert {round(one.mm, 6) for one in proof(deeper, pocket, outline).gouges} == {1.0}


def test_an_island_of_a_pocket_stays() -> None:
    drawn = part(square("c1", 0, 60), square("c2", 10, 50), disc("c3", 30, 30, 5.0))
    pocket = task(part(*drawn.contours, worked=frozenset({"c2", "c3"})), "pocket", 2.0)
    body = [rapid(15, 30, 5), feed(15, 30, -2), feed(22.5, 30, -2), rapid(22.5, 30, 5)]
    found = proof(body, pocket).gouges
    assert found[0].line == 3
    assert found[0].mm == pytest.approx(0.5)


def test_outside_of_the_stock_nothing_is_cut() -> None:
    hole = task(part(disc("c1", 0, 0, 3.0)), "drill", 5.0)
    away = [rapid(50, 0, 5), feed(50, 0, -2), feed(60, 0, -2), rapid(60, 0, 5)]
    assert proof(away, hole).refused == ()
    near = [rapid(15, 0, 5), feed(15, 0, -2), rapid(15, 0, 5)]
    assert {fault.kind for fault in proof(near, hole).refused} == {"gouge"}


@pytest.mark.parametrize(("diameter", "mm"), [(6.0, None), (6.2, 0.1)])
def test_a_drill_may_be_as_wide_as_the_circle(diameter: float, mm: float | None) -> None:
    tool = ToolTable(kind="drill", diameter=diameter)
    hole = task(part(square("c1", -20, 20), disc("c2", 0, 0, 3.0)), "drill", 5.0, tool)
    body = [rapid(0, 0, 5), feed(0, 0, -5), rapid(0, 0, 5)]
    found = proof(body, hole, tool=tool).gouges
    assert [fault.mm for fault in found[:1]] == ([] if mm is None else pytest.approx([mm]))


def test_a_traced_line_may_be_cut_and_nothing_beside_it() -> None:
    line = Contour(np.array([[0.0, 0.0], [30.0, 0.0]]), np.zeros(2), False, "0", "c1")
    engrave = task(part(line), "trace", 1.0, ToolTable(diameter=2.0))
    for y, depth, hits in ((0.0, 1.0, 0), (0.1, 1.0, 2), (0.0, 1.1, 2)):
        body = [rapid(0, y, 5), feed(0, y, -depth), feed(30, y, -depth), rapid(30, y, 5)]
        found = proof(body, engrave, tool=ToolTable(diameter=2.0)).gouges
        assert len([fault for fault in found if fault.line < 4]) == hits


def test_a_chamfer_may_be_as_wide_as_it_is_asked_for() -> None:
    # Of 90 degrees: 3 mm deep its tip is 2 mm beside the contour, so that the cone is 1 mm in at the top face.
    tool = ToolTable(kind="v", diameter=10.0, tip_angle=90.0)
    chamfer = task(part(square("c1", 0, 40)), "chamfer", 3.0, tool, width=1.0)
    assert proof(around(0, 40, 2.0, -3.0), chamfer, tool=tool).gouges == ()
    found = proof(around(0, 40, 1.9, -3.0), chamfer, tool=tool).gouges
    assert max(fault.mm for fault in found) == pytest.approx(0.1, abs=1e-6)


def test_a_ball_leaves_more_room_above_its_tip() -> None:
    # A wall of 2 mm at a distance d: a ball of 3 mm with its tip 3 mm deep is sqrt(9 - 4) wide 1 mm above its tip.
    ball = ToolTable(kind="ball mill", diameter=6.0)
    drawn = part(square("c1", 0, 60), square("c2", 20, 40))
    deep = task(part(*drawn.contours, worked=frozenset({"c2"})), "pocket", 2.0, ball)
    slot = task(part(*drawn.contours, worked=frozenset({"c1"})), "follow", 5.0, ball)
    body = [rapid(23, 30, 5), feed(23, 30, -2), feed(23, 31, -2), rapid(23, 31, 5)]
    assert max((one.mm for one in proof(body, deep, slot, tool=ball).gouges), default=0.0) == 0.0
    wide = math.sqrt(9 - 1)  # 2 mm above the tip
    body = [
        rapid(20 + wide, 30, 5),
        feed(20 + wide, 30, -2),
        feed(20 + wide, 31, -2),
        rapid(20 + wide, 31, 5),
    ]
    assert proof(body, deep, slot, tool=ball).gouges == ()
    body = [
        rapid(20 + wide - 0.1, 30, 5),
        feed(20 + wide - 0.1, 30, -2),
        feed(30, 31, -2),
        rapid(30, 31, 5),
    ]
    assert proof(body, deep, slot, tool=ball).gouges[0].mm == pytest.approx(0.1, abs=1e-6)


# Rapid motions, holders.


def slot_then(*more: Instruction) -> list[Instruction]:
    return [rapid(-10, -3, 5), feed(-10, -3, -5), feed(50, -3, -5), rapid(50, -3, 5), *more]


def test_a_rapid_motion_in_a_slot_is_none_through_material() -> None:
    drawn = part(square("c1", 0, 40))
    back = slot_then(rapid(40, -3, 5), rapid(40, -3, -4.9), rapid(0, -3, -4.9), rapid(0, -3, 5))
    assert proof(back, task(drawn)).rapids == ()
    # The tool is as wide as the slot: half a millimetre beside it there is waste, which is material too.
    beside = slot_then(rapid(40, -3.5, 5), rapid(40, -3.5, -2), rapid(40, -3.5, 5))
    found = proof(beside, task(drawn)).rapids
    assert [fault.line for fault in found] == [6]
    assert found[0].mm == pytest.approx(0.5, abs=0.03)


def test_a_rapid_motion_before_the_slot_is_cut_goes_through_material() -> None:
    drawn = part(square("c1", 0, 40))
    body = [
        rapid(40, -3, 5),
        rapid(40, -3, -4.9),
        rapid(0, -3, -4.9),
        rapid(0, -3, 5),
        *slot_then(),
    ]
    assert [fault.line for fault in proof(body, task(drawn)).rapids] == [2, 3]


@pytest.mark.parametrize(("again", "lines"), [(-1.8, []), (-2.2, [4])])
def test_pecks_come_back_no_deeper_than_they_were(again: float, lines: list[int]) -> None:
    tool = ToolTable(kind="drill", diameter=6.0)
    hole = task(part(square("c1", -20, 20), disc("c2", 0, 0, 3.0)), "drill", 5.0, tool)
    body = [
        rapid(0, 0, 5),
        feed(0, 0, -2),
        rapid(0, 0, 5),
        rapid(0, 0, again),
        feed(0, 0, -5),
        rapid(0, 0, 5),
    ]
    assert [fault.line for fault in proof(body, hole, tool=tool).rapids] == lines


def test_a_holder_comes_into_what_is_beside_a_deep_slot() -> None:
    # From the flange to 10 mm above the tip: a cut 12 mm deep has it 2 mm below the top face.
    held = ToolTable(diameter=6.0, length=30.0, holder=[[-10.0, -10.0, 0.0, 10.0, 10.0, 20.0]])
    drawn = part(square("c1", 0, 40))
    found = proof(
        around(0, 40, 3.0, -12.0), task(drawn, depth=12.0), tool=held, thickness=12.0
    ).holders
    assert found
    assert found[0].line == 2
    assert "2 mm deep" in found[0].text
    assert (
        proof(around(0, 40, 3.0, -10.0), task(drawn, depth=10.0), tool=held, thickness=12.0).holders
        == ()
    )


# Loose parts.


def test_a_part_that_nothing_holds_is_refused_and_on_tape_remarked() -> None:
    drawn, body = task(part(square("c1", 0, 40))), around(0, 40, 3.0, -5.0)
    refused = proof(body, drawn, held="frame").refused
    assert [(fault.kind, fault.serious) for fault in refused] == [("unheld", True)]
    assert "the part within c1 comes loose at its last cut" in refused[0].text
    assert refused[0].text.endswith("nothing holds it")
    taped = proof(body, drawn, held="tape")
    assert taped.refused == ()
    assert [(fault.serious, "tape holds it" in fault.text) for fault in taped.loose] == [
        (False, True)
    ]


def test_a_hole_that_is_cut_after_the_outline_finds_the_part_loose() -> None:
    drawn = task(part(square("c1", 0, 40), disc("c2", 20, 20, 8.0)))
    first = around(0, 40, 3.0, -5.0)
    late = proof([*first, *circle(20, 20, 5.0, -5.0)], drawn, held="frame").unheld
    # Told where the way around it ends.
    assert [("before its last cut" in fault.text, fault.line) for fault in late] == [
        (True, len(first) - 1)
    ]
    early = proof([*circle(20, 20, 5.0, -5.0), *first], drawn, held="frame").unheld
    assert ["before its last cut" in fault.text for fault in early] == [False]


def test_what_frees_a_part_may_not_be_the_last_that_is_cut_beside_it() -> None:
    drawn = task(part(square("c1", 0, 40)))
    # Once more round the lower left corner, down and up: the part is loose by then.
    again = [
        rapid(-3, 0, 5),
        feed(-3, 0, -5),
        MoveC(at(-2.1213203, -2.1213203, -5), at(0, -3, -5), 10.0),
    ]
    body = [*around(0, 40, 3.0, -5.0), *again, rapid(0, -3, 5)]
    (fault,) = proof(body, drawn, held="frame").unheld
    assert "before its last cut" in fault.text
    assert fault.line < 11


def test_a_bridge_or_a_thicker_stock_holds_the_part() -> None:
    drawn = task(part(square("c1", 0, 40)))
    whole = around(0, 40, 3.0, -5.0)
    lifted = [
        *whole[:2],
        feed(10, -3, -5),
        feed(10, -3, -4),
        feed(20, -3, -4),
        feed(20, -3, -5),
        *whole[2:],
    ]
    for body, thickness in ((lifted, 5.0), (whole, 6.0), (whole, None)):
        judged = proof(body, drawn, thickness=thickness, held="frame")
        assert judged.unheld == judged.loose == ()


# What is gone, and what is left.


def test_the_volume_of_a_ring_is_that_of_two_circles() -> None:
    drawn = task(part(square("c1", -50, 50), disc("c2", 0, 0, 10.0)))
    found = proof([*circle(0, 0, 7.0, -2.5), *circle(0, 0, 7.0, -5.0)], drawn)
    assert found.volume == pytest.approx(math.pi * (10**2 - 4**2) * 5, rel=3e-3)
    assert [(one.top, one.bottom) for one in found.levels] == [(0.0, -2.5), (-2.5, -5.0)]


def test_the_volume_of_a_groove_is_that_of_the_ball() -> None:
    ball = ToolTable(kind="ball mill", diameter=6.0)
    line = Contour(np.array([[0.0, 0.0], [200.0, 0.0]]), np.zeros(2), False, "0", "c1")
    body = [rapid(0, 0, 5), feed(0, 0, -3), feed(200, 0, -3), rapid(200, 0, 5)]
    found = proof(body, task(part(line), "trace", 3.0, ball), tool=ball)
    assert found.volume == pytest.approx(200 * math.pi * 9 / 2 + 2 / 3 * math.pi * 27, rel=0.02)


def test_the_volume_of_a_ramp_is_half_that_of_its_slot() -> None:
    line = Contour(np.array([[0.0, 0.0], [200.0, 0.0]]), np.zeros(2), False, "0", "c1")
    body = [rapid(0, 0, 5), feed(0, 0, 0), feed(200, 0, -4), rapid(200, 0, 5)]
    found = proof(body, task(part(line), "trace", 4.0), thickness=4.0)
    # At every depth the slot is as much shorter, and has half a disc at each end.
    assert found.volume == pytest.approx(200 * 6 * 4 / 2 + math.pi * 9 * 4, rel=2e-3)


def test_what_inner_corners_keep_is_explained_by_the_tool() -> None:
    drawn = task(part(square("c1", -50, 50), square("c2", 0, 20)))
    body = [
        rapid(3, 3, 5),
        feed(3, 3, -5),
        feed(17, 3, -5),
        feed(17, 17, -5),
        feed(3, 17, -5),
        feed(3, 3, -5),
    ]
    inner = task(part(*drawn.part.contours, worked=frozenset({"c2"})))
    excess = proof([*body, rapid(3, 3, 5)], inner).levels[-1].excess
    assert excess.area == pytest.approx((4 - math.pi) * 9, rel=0.02)
    assert excess.corners == pytest.approx(excess.area, rel=0.02)
    assert excess.size == 0.0
    assert excess.unexplained.is_empty


def test_what_the_tool_cannot_reach_beside_the_contour_is_explained_where_it_fits_only_farther_away() -> (
    None
):
    # Another square keeps the tool off the upper side, so that it cannot roll round the two upper corners.
    other = loop("c2", (0, 40.01), (40, 40.01), (40, 80), (0, 80))
    drawn = part(square("c1", 0, 40), other, worked=frozenset({"c1"}))
    whole = around(0, 40, 3.0, -5.0)
    body = [rapid(-3, 40, 5), feed(-3, 40, -5), feed(-3, 0, -5)]
    lower_left, lower_right = whole[-2], whole[3]
    assert isinstance(lower_left, MoveC)
    assert isinstance(lower_right, MoveC)
    body += [lower_left, feed(40, -3, -5), lower_right, feed(43, 40, -5), rapid(43, 40, 5)]
    found = proof(body, task(drawn))
    assert found.gouges == ()
    excess = found.levels[-1].excess
    # At each end a quarter of a disc as wide as the kerf, less half of the tool's.
    assert excess.area == pytest.approx(2 * math.pi * (36 / 4 - 9 / 2), rel=0.01)
    assert excess.corners == pytest.approx(excess.area, rel=0.01)
    assert excess.unexplained.is_empty


def test_a_side_that_is_not_cut_is_excess_as_wide_as_the_kerf() -> None:
    drawn = part(square("c1", -50, 50), square("c2", 0, 40), worked=frozenset({"c2"}))
    body = [
        rapid(3, 3, 5),
        feed(3, 3, -5),
        feed(37, 3, -5),
        feed(37, 37, -5),
        feed(3, 37, -5),
        rapid(3, 37, 5),
    ]
    found = proof(body, task(drawn))
    assert found.gouges == ()
    assert found.levels[-1].excess.size == pytest.approx(6.0, abs=0.1)
    # The strip between the two ends of the path, 34 mm apart, less a quarter of a disc and a square at each.
    left = 34 * 6 - 2 * (math.pi * 9 / 4 + 9)
    assert found.levels[-1].excess.unexplained.area == pytest.approx(left, rel=1e-3)
    assert found.excess == pytest.approx(found.levels[-1].excess.unexplained.area * 5)


def test_many_levels_are_a_grid_of_heights() -> None:
    line = Contour(np.array([[0.0, 0.0], [200.0, 0.0]]), np.zeros(2), False, "0", "c1")
    steps = [feed(2.0 * k, 0, -0.05 * k - 0.05 * j) for k in range(80) for j in (0, 1)]
    found = proof(
        [rapid(0, 0, 5), *steps, rapid(160, 0, 5)], task(part(line), "trace", 5.0), thickness=6.0
    )
    assert found.grid is not None
    assert found.levels == ()
    # The disc of step k reaches sqrt(9 - y^2) ahead, 3 pi / 4 in the mean, and steps are half a step late; at the end
    # half a disc of the last depth.
    deep = 0.05 * ((79 + 3 * math.pi / 4) / 2 + 0.5)
    assert found.volume == pytest.approx(158 * 6 * deep + math.pi * 9 / 2 * 4, rel=0.02)


def test_what_is_not_judged_is_said() -> None:
    drawn = task(part(square("c1", 0, 40)))
    leaning = Pose(np.array([[1.0, 0, 0], [0, -0.8, 0.6], [0, -0.6, -0.8]]), (0.0, 0.0, -5.0))
    found = proof([rapid(0, -3, 5), MoveL(leaning, 10.0), rapid(0, -3, 5)], drawn, thickness=None)
    assert any("not straight down" in note for note in found.notes)
    assert any("stock.thickness" in note for note in found.notes)


def test_a_beam_cuts_through_while_its_signal_is_on() -> None:
    from camgen.model.program import Output  # noqa: PLC0415

    laser = ToolTable(kind="laser", diameter=0.2)
    drawn = task(part(square("c1", 0, 40)), depth=0.0, tool=laser)
    way = around(0, 40, 0.1, 0.0)
    off = [
        *way[:2],
        feed(20, 20, 0),
        feed(0, -0.1, 0),
        Output("process", 1.0),
        *way[2:-1],
        Output("process", 0.0),
    ]
    found = proof(off, drawn, tool=laser)
    assert found.refused == ()
    assert [fault.kind for fault in found.loose] == ["loose"]
    through = [
        *way[:2],
        Output("process", 1.0),
        feed(20, 20, 0),
        *way[2:-1],
        Output("process", 0.0),
    ]
    assert proof(through, drawn, tool=laser).gouges


def test_one_program_goes_on_from_where_the_tool_before_it_stopped() -> None:
    drawn = task(part(square("c1", 0, 40)))
    way = around(0, 40, 3.0, -5.0)
    cuts = [
        Cut(way[:-1], range(1, len(way)), MILL, "p.ngc"),
        Cut([rapid(20, 20, 5)], [50], MILL, "p.ngc"),
    ]
    stock = StockTable(thickness=5.0, held="tape")
    wanted = design([drawn], stock)
    assert [(fault.kind, fault.line) for fault in prove(cuts, wanted, stock=stock).refused] == [
        ("gouge", 50),
        ("rapid", 50),
    ]
    # Of another file nothing is known of where it begins.
    other = Cut([rapid(20, 20, 5)], [50], MILL, "q.ngc")
    assert prove([cuts[0], other], wanted, stock=stock).refused == ()


def test_chords_may_leave_the_arcs_that_they_stand_for_but_not_at_their_ends() -> None:
    drawn = task(part(disc("c1", 0, 0, 10.0)))
    turns = np.arange(97) * 2 * math.pi / 96
    wanted = design([drawn], StockTable(thickness=5.0))

    def gouges(radius: float, chord: float) -> list[float]:
        ring = [feed(radius * math.cos(a), radius * math.sin(a), -5) for a in turns]
        body = [rapid(radius, 0, 5), *ring, rapid(radius, 0, 5)]
        return [
            one.mm for one in prove([Cut(body, range(1, 100), MILL, chord=chord)], wanted).gouges
        ]

    # Half-way a chord of 96 is nearer to the centre by r (1 - cos(pi / 96)), 0.007 mm.
    assert gouges(13.0, 0.0) == pytest.approx([13 * (1 - math.cos(math.pi / 96))] * 96, abs=1e-6)
    assert gouges(13.0, 0.01) == []
    # The plunge is an end too.
    assert len(gouges(12.994, 0.01)) == 97
    assert gouges(12.996, 0.01) == []


def test_a_hole_in_a_pocket_that_another_operation_makes_is_no_island() -> None:
    drawn = part(square("c1", 0, 60), square("c2", 10, 50), disc("c3", 30, 30, 5.0))
    alone = task(part(*drawn.contours, worked=frozenset({"c2"})), "pocket", 2.0)
    body = [rapid(15, 30, 5), feed(15, 30, -2), feed(45, 30, -2), rapid(45, 30, 5)]
    assert proof(body, alone).gouges == ()
    islands = task(part(*drawn.contours, worked=frozenset({"c2", "c3"})), "pocket", 2.0)
    assert proof(body, islands).gouges[0].line == 3


def test_a_counterbore_goes_around_its_hole_and_no_deeper() -> None:
    drawn = part(square("c1", -40, 40), disc("c2", 0, 0, 5.0), disc("c3", 0, 0, 2.5))
    every = frozenset({"c2", "c3"})
    wide = task(
        part(*drawn.contours, worked=every), "bore", 2.0, ToolTable(diameter=6.0), holes=[9.0, 11.0]
    )
    through = task(
        part(*drawn.contours, worked=every), "drill", 8.0, ToolTable(diameter=5.0, kind="drill")
    )
    bore = Cut(circle(0, 0, 2.0, -2.0), range(1, 6), MILL)
    hole = Cut(
        [rapid(0, 0, 5), feed(0, 0, -8), rapid(0, 0, 5)],
        range(1, 4),
        ToolTable(diameter=5.0, kind="drill"),
    )
    wanted = design([through, wide], StockTable(thickness=8.0))
    assert prove([hole, bore], wanted).refused == ()
    deep = Cut(circle(0, 0, 2.0, -2.1), range(1, 6), MILL)
    # 0.1 mm too deep on what stays around the hole; in the hole's own disc it may be.
    assert max(fault.mm for fault in prove([hole, deep], wanted).gouges) == pytest.approx(0.1)


def test_a_ring_that_bounds_no_material_does_not_turn_a_hole_into_a_part() -> None:
    drawn = part(square("c1", -40, 40), disc("c2", 0, 0, 20.0), disc("c3", 0, 0, 10.0))
    job = task(part(*drawn.contours, worked=frozenset({"c3"})))
    body = circle(0, 0, 7.0, -5.0)
    # As it is drawn the ring is a hole, and what lies in it a part again.
    assert proof(body, job).gouges
    assert proof(body, replace(job, bounds=frozenset({"c1", "c3"}))).gouges == ()
    assert proof(circle(0, 0, 13.0, -5.0), replace(job, bounds=frozenset({"c1", "c3"}))).gouges


def test_a_slot_as_wide_as_the_tool_that_is_not_cut_is_told() -> None:
    """The first 10 mm of 30 mm are cut: 20 mm of it stay, as the round end is moved by that."""
    corners = np.array([(0.0, -3.0), (30.0, -3.0), (30.0, 3.0), (0.0, 3.0)])
    slot = Contour(corners, np.array([0.0, 1.0, 0.0, 1.0]), True, "0", "slot")
    started = [rapid(0, 0, 5), feed(0, 0, -5), feed(10, 0, -5), rapid(10, 0, 5)]
    settings: dict[str, dict[str, object]] = {"pocket": {}, "follow": {"side": "inside"}}
    for kind, chosen in settings.items():
        judged = proof(started, task(part(slot), kind, **chosen))
        assert not judged.faults
        assert judged.levels[-1].excess.unexplained.area == pytest.approx(20 * 6, rel=0.01)
    whole = [rapid(0, 0, 5), feed(0, 0, -5), feed(30, 0, -5), rapid(30, 0, 5)]
    cut = proof(whole, task(part(slot), "pocket"))
    assert cut.levels[-1].excess.unexplained.area == 0.0
