"""The stock proof against formulas: distances, depths, areas and volumes of given motions."""

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
from camgen.model.program import Instruction, MoveC, MoveJ, MoveL, Output

Holder = Literal["frame", "vacuum", "tape"]
MILL = ToolTable(diameter=6.0)
Place = tuple[float, float, float]


def make_pose(*place: float) -> Pose:
    x, y, z = place
    return Pose(TOOL_DOWN, (x, y, z))


def rapid_to(*place: float) -> Instruction:
    return MoveJ(make_pose(*place), 100.0)


def feed_to(*place: float) -> Instruction:
    return MoveL(make_pose(*place), 10.0)


def cut_circle(x: float, y: float, radius: float, z: float) -> list[Instruction]:
    """Plunge to z at the right end of a circle and run it counter-clockwise, in two halves."""
    right, left = (x + radius, y, z), (x - radius, y, z)
    down: list[Instruction] = [rapid_to(x + radius, y, 5.0), feed_to(*right)]
    halves = [
        MoveC(make_pose(x, y + radius, z), make_pose(*left), 10.0),
        MoveC(make_pose(x, y - radius, z), make_pose(*right), 10.0),
    ]
    return [*down, *halves, rapid_to(x + radius, y, 5.0)]


def cut_around(
    low: float, high: float, radius: float, z: float, shift: float = 0.0
) -> list[Instruction]:
    """Run outside the square from `low` to `high` at a distance, with arcs about its corners.

    shift: mm by which the path is moved to the right.
    """
    a, b, r, h = low, high, radius, radius / math.sqrt(2)
    corners: list[tuple[Place, Place, Place]] = [
        ((b, a - r, z), (b + h, a - h, z), (b + r, a, z)),
        ((b + r, b, z), (b + h, b + h, z), (b, b + r, z)),
        ((a, b + r, z), (a - h, b + h, z), (a - r, b, z)),
        ((a - r, a, z), (a - h, a - h, z), (a, a - r, z)),
    ]
    body: list[Instruction] = [rapid_to(a + shift, a - r, 5.0), feed_to(a + shift, a - r, z)]
    for start, via, end in corners:
        moved = [make_pose(x + shift, y, height) for x, y, height in (start, via, end)]
        body += [MoveL(moved[0], 10.0), MoveC(moved[1], moved[2], 10.0)]
    return [*body, rapid_to(a + shift, a - r, 5.0)]


def make_loop(name: str, *points: tuple[float, float], bulge: float = 0.0) -> Contour:
    return Contour(np.array(points), np.full(len(points), bulge), True, "0", name)


def make_square(name: str, low: float, high: float) -> Contour:
    return make_loop(name, (low, low), (high, low), (high, high), (low, high))


def make_disc(name: str, x: float, y: float, radius: float) -> Contour:
    return make_loop(name, (x + radius, y), (x - radius, y), bulge=1.0)


def make_part(*contours: Contour, worked: frozenset[str] | None = None) -> Part:
    return Part("p", "p.dxf", "mm", contours, (), worked=worked)


def make_task(
    drawn: Part,
    kind: str = "follow",
    depth: float = 5.0,
    tool: ToolTable = MILL,
    **settings: object,
) -> Task:
    operation = OperationTable(kind=kind, depth=depth, **settings)  # type: ignore[arg-type]
    return Task(Job(operation=operation, tool=tool, process=ProcessTable()), drawn)


def prove_cut(
    body: Sequence[Instruction],
    *tasks: Task,
    tool: ToolTable = MILL,
    thickness: float | None = 5.0,
    held: Holder = "tape",
) -> StockProof:
    """Prove one program that is the text p.ngc; line n is instruction n of `body`."""
    cut = Cut(body, range(1, len(body) + 1), tool, "p.ngc")
    stock = StockTable(thickness=thickness, held=held)
    return prove([cut], design(tasks, stock), stock=stock)


# Gouges.


@pytest.mark.parametrize("depth", [1.0, 5.0])
def test_a_path_outside_a_square_leaves_the_square_whole(depth: float) -> None:
    assert (
        prove_cut(
            cut_around(0, 40, 3.0, -depth), make_task(make_part(make_square("c1", 0, 40)))
        ).refused
        == ()
    )


@pytest.mark.parametrize(
    ("shift", "mm"), [(0.004, None), (0.006, 0.006), (0.1, 0.1), (2.0, 2.0), (9.0, 5.0)]
)
def test_a_shifted_path_gouges_by_its_shift(shift: float, mm: float | None) -> None:
    gouges = prove_cut(
        cut_around(0, 40, 3.0, -5.0, shift), make_task(make_part(make_square("c1", 0, 40)))
    ).gouges
    if mm is None:
        assert gouges == ()
        return
    # On the left the tool enters the square. A gouge is never more than the depth of the cut.
    assert max(fault.mm for fault in gouges) == pytest.approx(mm, abs=1e-6)
    worst = max(gouges, key=lambda fault: fault.mm)
    assert -3.0 <= worst.x <= shift
    assert worst.z == -5.0
    assert worst.file == "p.ngc"
    assert isinstance(cut_around(0, 40, 3.0, -5.0, shift)[worst.line - 1], (MoveL, MoveC))


@pytest.mark.parametrize(("radius", "mm"), [(7.0, None), (7.004, None), (7.02, 0.02), (7.5, 0.5)])
def test_an_arc_that_is_too_wide_gouges_the_wall_of_a_hole(radius: float, mm: float | None) -> None:
    drawn = make_part(make_square("c1", -50, 50), make_disc("c2", 0, 0, 10.0))
    gouges = prove_cut(cut_circle(0, 0, radius, -5.0), make_task(drawn)).gouges
    # The faults are at the plunge and at both halves.
    assert [fault.line for fault in gouges] == ([] if mm is None else [2, 3, 4])
    assert [fault.mm for fault in gouges] == (
        [] if mm is None else pytest.approx([mm] * 3, abs=1e-9)
    )


def test_the_plunge_and_the_path_inside_a_part_are_gouges() -> None:
    body = [rapid_to(20, 20, 5), feed_to(20, 20, -2), feed_to(25, 20, -2), rapid_to(25, 20, 5)]
    gouges = prove_cut(body, make_task(make_part(make_square("c1", 0, 40)))).gouges
    assert [fault.line for fault in gouges] == [2, 3]
    assert [fault.mm for fault in gouges] == pytest.approx([2.0, 2.0])


def test_a_cut_deeper_than_the_operation_is_a_gouge() -> None:
    drawn = make_part(make_square("c1", 0, 40))
    gouges = prove_cut(cut_around(0, 40, 3.0, -5.2), make_task(drawn)).gouges
    assert {round(fault.mm, 6) for fault in gouges} == {0.2}
    assert "too deep" in gouges[0].text


def test_a_region_may_be_cut_as_deep_as_its_own_operation() -> None:
    drawn = make_part(make_square("c1", 0, 60), make_square("c2", 20, 40))
    pocket = make_task(make_part(*drawn.contours, worked=frozenset({"c2"})), "pocket", 2.0)
    outline = make_task(make_part(*drawn.contours, worked=frozenset({"c1"})), "follow", 5.0)
    inside = [rapid_to(25, 25, 5), feed_to(25, 25, -2), feed_to(35, 35, -2), rapid_to(35, 35, 5)]
    assert prove_cut([*inside, *cut_around(0, 60, 3.0, -5.0)], pocket, outline).refused == ()
    deeper = [rapid_to(25, 25, 5), feed_to(25, 25, -3), feed_to(35, 35, -3), rapid_to(35, 35, 5)]
    assert {round(fault.mm, 6) for fault in prove_cut(deeper, pocket, outline).gouges} == {1.0}


def test_a_cut_into_an_island_is_a_gouge() -> None:
    drawn = make_part(
        make_square("c1", 0, 60), make_square("c2", 10, 50), make_disc("c3", 30, 30, 5.0)
    )
    pocket = make_task(make_part(*drawn.contours, worked=frozenset({"c2", "c3"})), "pocket", 2.0)
    body = [rapid_to(15, 30, 5), feed_to(15, 30, -2), feed_to(22.5, 30, -2), rapid_to(22.5, 30, 5)]
    gouges = prove_cut(body, pocket).gouges
    assert gouges[0].line == 3
    assert gouges[0].mm == pytest.approx(0.5)


def test_a_motion_outside_the_stock_cuts_nothing() -> None:
    hole = make_task(make_part(make_disc("c1", 0, 0, 3.0)), "drill", 5.0)
    outside = [rapid_to(50, 0, 5), feed_to(50, 0, -2), feed_to(60, 0, -2), rapid_to(60, 0, 5)]
    assert prove_cut(outside, hole).refused == ()
    near = [rapid_to(15, 0, 5), feed_to(15, 0, -2), rapid_to(15, 0, 5)]
    assert {fault.kind for fault in prove_cut(near, hole).refused} == {"gouge"}


@pytest.mark.parametrize(("diameter", "mm"), [(6.0, None), (6.2, 0.1)])
def test_a_drill_may_be_as_wide_as_the_circle(diameter: float, mm: float | None) -> None:
    tool = ToolTable(kind="drill", diameter=diameter)
    hole = make_task(
        make_part(make_square("c1", -20, 20), make_disc("c2", 0, 0, 3.0)), "drill", 5.0, tool
    )
    body = [rapid_to(0, 0, 5), feed_to(0, 0, -5), rapid_to(0, 0, 5)]
    gouges = prove_cut(body, hole, tool=tool).gouges
    assert [fault.mm for fault in gouges[:1]] == ([] if mm is None else pytest.approx([mm]))


def test_a_traced_line_may_be_cut_and_nothing_off_the_line() -> None:
    line = Contour(np.array([[0.0, 0.0], [30.0, 0.0]]), np.zeros(2), False, "0", "c1")
    engrave = make_task(make_part(line), "trace", 1.0, ToolTable(diameter=2.0))
    for y, depth, count in ((0.0, 1.0, 0), (0.1, 1.0, 2), (0.0, 1.1, 2)):
        body = [
            rapid_to(0, y, 5),
            feed_to(0, y, -depth),
            feed_to(30, y, -depth),
            rapid_to(30, y, 5),
        ]
        gouges = prove_cut(body, engrave, tool=ToolTable(diameter=2.0)).gouges
        assert len([fault for fault in gouges if fault.line < 4]) == count


def test_a_chamfer_wider_than_its_setting_is_a_gouge() -> None:
    # The tip, 90 deg, is 3 mm deep and 2 mm off the contour. The cone then cuts 1 mm of the part at
    # the top face.
    tool = ToolTable(kind="v", diameter=10.0, tip_angle=90.0)
    chamfer = make_task(make_part(make_square("c1", 0, 40)), "chamfer", 3.0, tool, width=1.0)
    assert prove_cut(cut_around(0, 40, 2.0, -3.0), chamfer, tool=tool).gouges == ()
    gouges = prove_cut(cut_around(0, 40, 1.9, -3.0), chamfer, tool=tool).gouges
    assert max(fault.mm for fault in gouges) == pytest.approx(0.1, abs=1e-6)


def test_a_ball_mill_may_come_nearer_to_a_wall_that_ends_above_its_tip() -> None:
    # The ball has a radius of 3 mm. At a height h above its tip, its section has the radius
    # sqrt(9 - (3 - h)^2).
    ball = ToolTable(kind="ball mill", diameter=6.0)
    drawn = make_part(make_square("c1", 0, 60), make_square("c2", 20, 40))
    deep = make_task(make_part(*drawn.contours, worked=frozenset({"c2"})), "pocket", 2.0, ball)
    slot = make_task(make_part(*drawn.contours, worked=frozenset({"c1"})), "follow", 5.0, ball)
    body = [rapid_to(23, 30, 5), feed_to(23, 30, -2), feed_to(23, 31, -2), rapid_to(23, 31, 5)]
    assert (
        max((fault.mm for fault in prove_cut(body, deep, slot, tool=ball).gouges), default=0.0)
        == 0.0
    )
    distance = math.sqrt(9 - 1)  # 2 mm above the tip
    body = [
        rapid_to(20 + distance, 30, 5),
        feed_to(20 + distance, 30, -2),
        feed_to(20 + distance, 31, -2),
        rapid_to(20 + distance, 31, 5),
    ]
    assert prove_cut(body, deep, slot, tool=ball).gouges == ()
    body = [
        rapid_to(20 + distance - 0.1, 30, 5),
        feed_to(20 + distance - 0.1, 30, -2),
        feed_to(30, 31, -2),
        rapid_to(30, 31, 5),
    ]
    assert prove_cut(body, deep, slot, tool=ball).gouges[0].mm == pytest.approx(0.1, abs=1e-6)


# Rapid motions, holders.


def cut_slot_then(*more: Instruction) -> list[Instruction]:
    return [
        rapid_to(-10, -3, 5),
        feed_to(-10, -3, -5),
        feed_to(50, -3, -5),
        rapid_to(50, -3, 5),
        *more,
    ]


def test_a_rapid_motion_is_free_in_a_slot_and_a_fault_off_its_middle() -> None:
    drawn = make_part(make_square("c1", 0, 40))
    in_slot = cut_slot_then(
        rapid_to(40, -3, 5), rapid_to(40, -3, -4.9), rapid_to(0, -3, -4.9), rapid_to(0, -3, 5)
    )
    assert prove_cut(in_slot, make_task(drawn)).rapids == ()
    # The tool is as wide as the slot. Half a millimetre to the side it enters the waste.
    half_mm_off = cut_slot_then(
        rapid_to(40, -3.5, 5), rapid_to(40, -3.5, -2), rapid_to(40, -3.5, 5)
    )
    rapids = prove_cut(half_mm_off, make_task(drawn)).rapids
    assert [fault.line for fault in rapids] == [6]
    assert rapids[0].mm == pytest.approx(0.5, abs=0.03)


def test_a_rapid_motion_before_the_slot_is_cut_is_a_fault() -> None:
    drawn = make_part(make_square("c1", 0, 40))
    body = [
        rapid_to(40, -3, 5),
        rapid_to(40, -3, -4.9),
        rapid_to(0, -3, -4.9),
        rapid_to(0, -3, 5),
        *cut_slot_then(),
    ]
    assert [fault.line for fault in prove_cut(body, make_task(drawn)).rapids] == [2, 3]


@pytest.mark.parametrize(("depth", "lines"), [(-1.8, []), (-2.2, [4])])
def test_a_rapid_motion_deeper_than_the_last_peck_is_a_fault(
    depth: float, lines: list[int]
) -> None:
    tool = ToolTable(kind="drill", diameter=6.0)
    hole = make_task(
        make_part(make_square("c1", -20, 20), make_disc("c2", 0, 0, 3.0)), "drill", 5.0, tool
    )
    body = [
        rapid_to(0, 0, 5),
        feed_to(0, 0, -2),
        rapid_to(0, 0, 5),
        rapid_to(0, 0, depth),
        feed_to(0, 0, -5),
        rapid_to(0, 0, 5),
    ]
    assert [fault.line for fault in prove_cut(body, hole, tool=tool).rapids] == lines


def test_a_holder_collides_with_the_material_at_a_deep_slot() -> None:
    # The holder ends 10 mm above the tip. In a cut 12 mm deep it is 2 mm below the top face.
    tool = ToolTable(diameter=6.0, length=30.0, holder=[[-10.0, -10.0, 0.0, 10.0, 10.0, 20.0]])
    drawn = make_part(make_square("c1", 0, 40))
    holders = prove_cut(
        cut_around(0, 40, 3.0, -12.0), make_task(drawn, depth=12.0), tool=tool, thickness=12.0
    ).holders
    assert holders
    assert holders[0].line == 2
    assert "2 mm deep" in holders[0].text
    assert (
        prove_cut(
            cut_around(0, 40, 3.0, -10.0), make_task(drawn, depth=10.0), tool=tool, thickness=12.0
        ).holders
        == ()
    )


# Loose parts.


def test_a_loose_part_is_refused_in_a_frame_and_noted_on_tape() -> None:
    drawn, body = make_task(make_part(make_square("c1", 0, 40))), cut_around(0, 40, 3.0, -5.0)
    refused = prove_cut(body, drawn, held="frame").refused
    assert [(fault.kind, fault.serious) for fault in refused] == [("unheld", True)]
    assert "the part within c1 comes loose at its last cut" in refused[0].text
    assert refused[0].text.endswith("nothing holds it")
    taped = prove_cut(body, drawn, held="tape")
    assert taped.refused == ()
    assert [(fault.serious, "tape holds it" in fault.text) for fault in taped.loose] == [
        (False, True)
    ]


def test_a_hole_that_is_cut_after_the_outline_is_cut_in_a_loose_part() -> None:
    drawn = make_task(make_part(make_square("c1", 0, 40), make_disc("c2", 20, 20, 8.0)))
    outline = cut_around(0, 40, 3.0, -5.0)
    late = prove_cut([*outline, *cut_circle(20, 20, 5.0, -5.0)], drawn, held="frame").unheld
    # The fault is at the end of the outline.
    assert [("before its last cut" in fault.text, fault.line) for fault in late] == [
        (True, len(outline) - 1)
    ]
    early = prove_cut([*cut_circle(20, 20, 5.0, -5.0), *outline], drawn, held="frame").unheld
    assert ["before its last cut" in fault.text for fault in early] == [False]


def test_a_cut_that_frees_a_part_has_to_be_its_last_cut() -> None:
    drawn = make_task(make_part(make_square("c1", 0, 40)))
    # The lower left corner is run again when the part is loose already.
    again = [
        rapid_to(-3, 0, 5),
        feed_to(-3, 0, -5),
        MoveC(make_pose(-2.1213203, -2.1213203, -5), make_pose(0, -3, -5), 10.0),
    ]
    body = [*cut_around(0, 40, 3.0, -5.0), *again, rapid_to(0, -3, 5)]
    (fault,) = prove_cut(body, drawn, held="frame").unheld
    assert "before its last cut" in fault.text
    assert fault.line < 11


def test_a_tab_or_a_thicker_stock_holds_the_part() -> None:
    drawn = make_task(make_part(make_square("c1", 0, 40)))
    whole = cut_around(0, 40, 3.0, -5.0)
    lifted = [
        *whole[:2],
        feed_to(10, -3, -5),
        feed_to(10, -3, -4),
        feed_to(20, -3, -4),
        feed_to(20, -3, -5),
        *whole[2:],
    ]
    for body, thickness in ((lifted, 5.0), (whole, 6.0), (whole, None)):
        result = prove_cut(body, drawn, thickness=thickness, held="frame")
        assert result.unheld == result.loose == ()


# Removed volume and excess.


def test_the_volume_of_a_ring_is_the_difference_of_two_cylinders() -> None:
    drawn = make_task(make_part(make_square("c1", -50, 50), make_disc("c2", 0, 0, 10.0)))
    result = prove_cut([*cut_circle(0, 0, 7.0, -2.5), *cut_circle(0, 0, 7.0, -5.0)], drawn)
    assert result.volume == pytest.approx(math.pi * (10**2 - 4**2) * 5, rel=3e-3)
    assert [(level.top, level.bottom) for level in result.levels] == [(0.0, -2.5), (-2.5, -5.0)]


def test_the_volume_of_a_groove_has_the_section_of_the_ball() -> None:
    ball = ToolTable(kind="ball mill", diameter=6.0)
    line = Contour(np.array([[0.0, 0.0], [200.0, 0.0]]), np.zeros(2), False, "0", "c1")
    body = [rapid_to(0, 0, 5), feed_to(0, 0, -3), feed_to(200, 0, -3), rapid_to(200, 0, 5)]
    result = prove_cut(body, make_task(make_part(line), "trace", 3.0, ball), tool=ball)
    assert result.volume == pytest.approx(200 * math.pi * 9 / 2 + 2 / 3 * math.pi * 27, rel=0.02)


def test_the_volume_of_a_ramp_is_half_that_of_its_slot() -> None:
    line = Contour(np.array([[0.0, 0.0], [200.0, 0.0]]), np.zeros(2), False, "0", "c1")
    body = [rapid_to(0, 0, 5), feed_to(0, 0, 0), feed_to(200, 0, -4), rapid_to(200, 0, 5)]
    result = prove_cut(body, make_task(make_part(line), "trace", 4.0), thickness=4.0)
    # At a depth the slot is shorter in proportion, with half a disc at each end.
    assert result.volume == pytest.approx(200 * 6 * 4 / 2 + math.pi * 9 * 4, rel=2e-3)


def test_excess_in_inner_corners_is_explained_by_the_tool() -> None:
    drawn = make_task(make_part(make_square("c1", -50, 50), make_square("c2", 0, 20)))
    body = [
        rapid_to(3, 3, 5),
        feed_to(3, 3, -5),
        feed_to(17, 3, -5),
        feed_to(17, 17, -5),
        feed_to(3, 17, -5),
        feed_to(3, 3, -5),
    ]
    inner = make_task(make_part(*drawn.part.contours, worked=frozenset({"c2"})))
    excess = prove_cut([*body, rapid_to(3, 3, 5)], inner).levels[-1].excess
    assert excess.area == pytest.approx((4 - math.pi) * 9, rel=0.02)
    assert excess.corners == pytest.approx(excess.area, rel=0.02)
    assert excess.size == 0.0
    assert excess.unexplained.is_empty


def test_excess_at_corners_that_the_tool_cannot_reach_is_explained() -> None:
    # A second square lies along the upper side. So the tool cannot run that side and its corners.
    other = make_loop("c2", (0, 40.01), (40, 40.01), (40, 80), (0, 80))
    drawn = make_part(make_square("c1", 0, 40), other, worked=frozenset({"c1"}))
    whole = cut_around(0, 40, 3.0, -5.0)
    body = [rapid_to(-3, 40, 5), feed_to(-3, 40, -5), feed_to(-3, 0, -5)]
    lower_left, lower_right = whole[-2], whole[3]
    assert isinstance(lower_left, MoveC)
    assert isinstance(lower_right, MoveC)
    body += [lower_left, feed_to(40, -3, -5), lower_right, feed_to(43, 40, -5), rapid_to(43, 40, 5)]
    result = prove_cut(body, make_task(drawn))
    assert result.gouges == ()
    excess = result.levels[-1].excess
    # At each end a quarter of a disc of 6 mm, the kerf, remains, less half a disc of the tool.
    assert excess.area == pytest.approx(2 * math.pi * (36 / 4 - 9 / 2), rel=0.01)
    assert excess.corners == pytest.approx(excess.area, rel=0.01)
    assert excess.unexplained.is_empty


def test_a_side_that_is_not_cut_is_excess_as_wide_as_the_kerf() -> None:
    drawn = make_part(
        make_square("c1", -50, 50), make_square("c2", 0, 40), worked=frozenset({"c2"})
    )
    body = [
        rapid_to(3, 3, 5),
        feed_to(3, 3, -5),
        feed_to(37, 3, -5),
        feed_to(37, 37, -5),
        feed_to(3, 37, -5),
        rapid_to(3, 37, 5),
    ]
    result = prove_cut(body, make_task(drawn))
    assert result.gouges == ()
    assert result.levels[-1].excess.size == pytest.approx(6.0, abs=0.1)
    # The strip between the ends of the path is 34 mm long. A quarter disc and a square
    # are gone at each end.
    area = 34 * 6 - 2 * (math.pi * 9 / 4 + 9)
    assert result.levels[-1].excess.unexplained.area == pytest.approx(area, rel=1e-3)
    assert result.excess == pytest.approx(result.levels[-1].excess.unexplained.area * 5)


def test_a_cut_with_many_depths_is_held_as_a_grid_of_heights() -> None:
    line = Contour(np.array([[0.0, 0.0], [200.0, 0.0]]), np.zeros(2), False, "0", "c1")
    steps: list[Instruction] = []
    for k in range(80):
        steps += [feed_to(2.0 * k, 0, -0.05 * k), feed_to(2.0 * k, 0, -0.05 * k - 0.05)]
    result = prove_cut(
        [rapid_to(0, 0, 5), *steps, rapid_to(160, 0, 5)],
        make_task(make_part(line), "trace", 5.0),
        thickness=6.0,
    )
    assert result.grid is not None
    assert result.levels == ()
    # The disc of a step reaches sqrt(9 - y^2) ahead, 3 pi / 4 on average, and steps are half a step
    # late. At the end there is half a disc of the last depth.
    mean_depth = 0.05 * ((79 + 3 * math.pi / 4) / 2 + 0.5)
    assert result.volume == pytest.approx(158 * 6 * mean_depth + math.pi * 9 / 2 * 4, rel=0.02)


def test_motions_and_depths_that_are_not_proven_are_noted() -> None:
    drawn = make_task(make_part(make_square("c1", 0, 40)))
    leaning = Pose(np.array([[1.0, 0, 0], [0, -0.8, 0.6], [0, -0.6, -0.8]]), (0.0, 0.0, -5.0))
    result = prove_cut(
        [rapid_to(0, -3, 5), MoveL(leaning, 10.0), rapid_to(0, -3, 5)], drawn, thickness=None
    )
    assert any("not straight down" in note for note in result.notes)
    assert any("stock.thickness" in note for note in result.notes)


def test_a_beam_cuts_only_while_its_signal_is_on() -> None:
    laser = ToolTable(kind="laser", diameter=0.2)
    drawn = make_task(make_part(make_square("c1", 0, 40)), depth=0.0, tool=laser)
    path = cut_around(0, 40, 0.1, 0.0)
    beam_off = [
        *path[:2],
        feed_to(20, 20, 0),
        feed_to(0, -0.1, 0),
        Output("process", 1.0),
        *path[2:-1],
        Output("process", 0.0),
    ]
    result = prove_cut(beam_off, drawn, tool=laser)
    assert result.refused == ()
    assert [fault.kind for fault in result.loose] == ["loose"]
    beam_on = [
        *path[:2],
        Output("process", 1.0),
        feed_to(20, 20, 0),
        *path[2:-1],
        Output("process", 0.0),
    ]
    assert prove_cut(beam_on, drawn, tool=laser).gouges


def test_a_tool_starts_at_the_last_position_of_the_previous_tool_of_its_file() -> None:
    drawn = make_task(make_part(make_square("c1", 0, 40)))
    path = cut_around(0, 40, 3.0, -5.0)
    cuts = [
        Cut(path[:-1], range(1, len(path)), MILL, "p.ngc"),
        Cut([rapid_to(20, 20, 5)], [50], MILL, "p.ngc"),
    ]
    stock = StockTable(thickness=5.0, held="tape")
    wanted = design([drawn], stock)
    assert [(fault.kind, fault.line) for fault in prove(cuts, wanted, stock=stock).refused] == [
        ("gouge", 50),
        ("rapid", 50),
    ]
    # The position at the start of another file is not known.
    other = Cut([rapid_to(20, 20, 5)], [50], MILL, "q.ngc")
    assert prove([cuts[0], other], wanted, stock=stock).refused == ()


def test_chords_may_deviate_from_their_arcs_between_but_not_at_their_ends() -> None:
    drawn = make_task(make_part(make_disc("c1", 0, 0, 10.0)))
    angles = np.arange(97) * 2 * math.pi / 96
    wanted = design([drawn], StockTable(thickness=5.0))

    def measure_gouges(radius: float, chord: float) -> list[float]:
        ring = [feed_to(radius * math.cos(a), radius * math.sin(a), -5) for a in angles]
        body = [rapid_to(radius, 0, 5), *ring, rapid_to(radius, 0, 5)]
        return [
            fault.mm
            for fault in prove([Cut(body, range(1, 100), MILL, chord=chord)], wanted).gouges
        ]

    # The middle of a chord is nearer to the centre by r (1 - cos(pi / 96)), 0.007 mm.
    assert measure_gouges(13.0, 0.0) == pytest.approx(
        [13 * (1 - math.cos(math.pi / 96))] * 96, abs=1e-6
    )
    assert measure_gouges(13.0, 0.01) == []
    # The plunge is an end as well.
    assert len(measure_gouges(12.994, 0.01)) == 97
    assert measure_gouges(12.996, 0.01) == []


def test_a_hole_of_another_operation_is_not_an_island_of_a_pocket() -> None:
    drawn = make_part(
        make_square("c1", 0, 60), make_square("c2", 10, 50), make_disc("c3", 30, 30, 5.0)
    )
    alone = make_task(make_part(*drawn.contours, worked=frozenset({"c2"})), "pocket", 2.0)
    body = [rapid_to(15, 30, 5), feed_to(15, 30, -2), feed_to(45, 30, -2), rapid_to(45, 30, 5)]
    assert prove_cut(body, alone).gouges == ()
    islands = make_task(make_part(*drawn.contours, worked=frozenset({"c2", "c3"})), "pocket", 2.0)
    assert prove_cut(body, islands).gouges[0].line == 3


def test_a_counterbore_deeper_than_its_depth_gouges_around_the_hole() -> None:
    drawn = make_part(
        make_square("c1", -40, 40), make_disc("c2", 0, 0, 5.0), make_disc("c3", 0, 0, 2.5)
    )
    holes = frozenset({"c2", "c3"})
    counterbore = make_task(
        make_part(*drawn.contours, worked=holes),
        "bore",
        2.0,
        ToolTable(diameter=6.0),
        holes=[9.0, 11.0],
    )
    through = make_task(
        make_part(*drawn.contours, worked=holes),
        "drill",
        8.0,
        ToolTable(diameter=5.0, kind="drill"),
    )
    bore = Cut(cut_circle(0, 0, 2.0, -2.0), range(1, 6), MILL)
    hole = Cut(
        [rapid_to(0, 0, 5), feed_to(0, 0, -8), rapid_to(0, 0, 5)],
        range(1, 4),
        ToolTable(diameter=5.0, kind="drill"),
    )
    wanted = design([through, counterbore], StockTable(thickness=8.0))
    assert prove([hole, bore], wanted).refused == ()
    deep = Cut(cut_circle(0, 0, 2.0, -2.1), range(1, 6), MILL)
    # The bottom of the counterbore is 0.1 mm too deep. In the disc of the hole any depth is free.
    assert max(fault.mm for fault in prove([hole, deep], wanted).gouges) == pytest.approx(0.1)


def test_a_contour_that_bounds_no_material_does_not_make_a_part_of_a_hole() -> None:
    drawn = make_part(
        make_square("c1", -40, 40), make_disc("c2", 0, 0, 20.0), make_disc("c3", 0, 0, 10.0)
    )
    job = make_task(make_part(*drawn.contours, worked=frozenset({"c3"})))
    body = cut_circle(0, 0, 7.0, -5.0)
    # As drawn, the larger disc is a hole and the smaller one is a part in it.
    assert prove_cut(body, job).gouges
    assert prove_cut(body, replace(job, bounds=frozenset({"c1", "c3"}))).gouges == ()
    assert prove_cut(
        cut_circle(0, 0, 13.0, -5.0), replace(job, bounds=frozenset({"c1", "c3"}))
    ).gouges


def test_a_slot_as_wide_as_the_tool_that_is_not_cut_is_excess() -> None:
    """10 mm of 30 mm are cut. The rest has the area of 20 mm, since both of its ends are round."""
    corners = np.array([(0.0, -3.0), (30.0, -3.0), (30.0, 3.0), (0.0, 3.0)])
    slot = Contour(corners, np.array([0.0, 1.0, 0.0, 1.0]), True, "0", "slot")
    started = [rapid_to(0, 0, 5), feed_to(0, 0, -5), feed_to(10, 0, -5), rapid_to(10, 0, 5)]
    settings: dict[str, dict[str, object]] = {"pocket": {}, "follow": {"side": "inside"}}
    for kind, options in settings.items():
        result = prove_cut(started, make_task(make_part(slot), kind, **options))
        assert not result.faults
        assert result.levels[-1].excess.unexplained.area == pytest.approx(20 * 6, rel=0.01)
    whole = [rapid_to(0, 0, 5), feed_to(0, 0, -5), feed_to(30, 0, -5), rapid_to(30, 0, 5)]
    cut = prove_cut(whole, make_task(make_part(slot), "pocket"))
    assert cut.levels[-1].excess.unexplained.area == 0.0
