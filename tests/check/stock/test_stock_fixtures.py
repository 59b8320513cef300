"""Clearances from fixtures, compared with a dense sampling that shares no code with the proof."""

import math

import numpy as np
import pytest

from camgen.check.stock import Cut, Fault, Task, design, examine_fixtures, prove
from camgen.geometry.fixtures import Fixtures, list_fixtures
from camgen.model.job import CellTable, Job, OperationTable, ProcessTable, ToolTable
from camgen.model.part import Contour, Part
from camgen.model.pose import TOOL_DOWN, FloatArray, Pose
from camgen.model.program import Instruction, MoveC, MoveJ, MoveL

CLAMP = [10.0, -10.0, -5.0, 30.0, 20.0, 12.0]
MILL = ToolTable(diameter=6.0)


def make_pose(*place: float) -> Pose:
    x, y, z = place
    return Pose(TOOL_DOWN, (x, y, z))


def rapid_to(*place: float) -> MoveJ:
    return MoveJ(make_pose(*place), 100.0)


def feed_to(*place: float) -> MoveL:
    return MoveL(make_pose(*place), 10.0)


def arc_to(via: tuple[float, ...], end: tuple[float, ...]) -> MoveC:
    return MoveC(make_pose(*via), make_pose(*end), 10.0)


def make_fixtures(*boxes: list[float], margin: float = 2.0) -> Fixtures:
    fixtures = list_fixtures(Job(cell=CellTable(fixtures=list(boxes), margin=margin)), ())
    assert fixtures is not None
    return fixtures


def examine_cut(
    body: list[Instruction], fixtures: Fixtures, tool: ToolTable = MILL
) -> tuple[float, float, tuple[Fault, ...]]:
    """Clearances at the sides of fixtures and above them, mm, and the faults."""
    clearance, faults = examine_fixtures([Cut(body, range(1, len(body) + 1), tool)], fixtures)
    assert clearance.fixtures == len(fixtures.listed)
    return clearance.aside, clearance.above, faults


def sample_motion(start: FloatArray, motion: Instruction, count: int = 4001) -> FloatArray:
    """Positions (N, 3) of the tip along a motion; an arc is the circle through three points."""
    fractions = np.linspace(0.0, 1.0, count)[:, None]
    end = np.array(motion.target.origin)
    if not isinstance(motion, MoveC):
        return start + fractions * (end - start)
    via = np.array(motion.via.origin)
    (x0, y0), (x1, y1), (x2, y2) = start[:2], via[:2], end[:2]
    d = 2 * (x0 * (y1 - y2) + x1 * (y2 - y0) + x2 * (y0 - y1))
    squares = [x * x + y * y for x, y in ((x0, y0), (x1, y1), (x2, y2))]
    mx = (squares[0] * (y1 - y2) + squares[1] * (y2 - y0) + squares[2] * (y0 - y1)) / d
    my = (squares[0] * (x2 - x1) + squares[1] * (x0 - x2) + squares[2] * (x1 - x0)) / d
    first, last = math.atan2(y0 - my, x0 - mx), math.atan2(y2 - my, x2 - mx)
    sweep = (last - first) % (2 * math.pi)
    if d < 0:
        sweep -= 2 * math.pi
    angle = first + fractions * sweep
    radius = math.hypot(x0 - mx, y0 - my)
    x, y = mx + radius * np.cos(angle), my + radius * np.sin(angle)
    return np.hstack([x, y, np.full_like(x, start[2])])


def measure_clearances(
    positions: FloatArray, box: list[float], height: float, radius: float
) -> tuple[float, float]:
    """The smallest clearances of a round body from a box, mm.

    The first is at the side, while the body is below the top. The second is above the top.
    height: bottom of the body above the tip of the tool, mm.
    """
    x1, y1, _, x2, y2, top = box
    dx = np.maximum(np.maximum(x1 - positions[:, 0], positions[:, 0] - x2), 0)
    dy = np.maximum(np.maximum(y1 - positions[:, 1], positions[:, 1] - y2), 0)
    aside, height_above = np.hypot(dx, dy) - radius, positions[:, 2] + height - top
    is_below, is_over = height_above < 0, (height_above >= 0) & (aside < 0)
    return (
        float(aside[is_below].min(initial=math.inf)),
        float(height_above[is_over].min(initial=math.inf)),
    )


def draw_motions(seed: int, count: int) -> list[Instruction]:
    """A program around the clamp: lines, horizontal arcs, plunges, rapid motions at all heights."""
    generator = np.random.default_rng(seed)
    body: list[Instruction] = [rapid_to(-40, -40, 40)]
    position = np.array([-40.0, -40.0, 40.0])
    while len(body) < count:
        kind = generator.integers(4)
        x, y = generator.uniform((-15, -35), (55, 45))
        z = float(generator.choice([-3.0, 2.0, 11.0, 12.5, 15.0, 30.0]))
        if kind == 0:
            body.append(feed_to(x, y, z))
        elif kind == 1:
            body.append(rapid_to(x, y, z))
        elif kind == 2:
            body.append(rapid_to(*position[:2], z))
        else:
            middle = (position[:2] + np.array([x, y])) / 2
            side = np.array([position[1] - y, x - position[0]]) * generator.uniform(-0.9, 0.9)
            body.append(arc_to((*(middle + side), position[2]), (x, y, position[2])))
        position = np.array(body[-1].target.origin)
    return body


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("margin", [0.0, 2.0])
def test_motions_within_the_margin_are_those_that_a_dense_sampling_finds(
    seed: int, margin: float
) -> None:
    body = draw_motions(seed, 60)
    tool = ToolTable(diameter=6.0, length=30.0, holder=[[-12, -12, 0, 12, 12, 9]])
    clearance_aside, above, faults = examine_cut(body, make_fixtures(CLAMP, margin=margin), tool)
    lines = {fault.line for fault in faults}
    clear = meets = 0
    smallest = math.inf
    position = np.array(body[0].target.origin)
    for line, motion in enumerate(body[1:], 2):
        positions = sample_motion(position, motion)
        position = positions[-1]
        raised = [*CLAMP[:5], CLAMP[5] + (margin if isinstance(motion, MoveJ) else 0.0)]
        for height, radius in ((0.0, 3.0), (21.0, 12.0)):
            smallest = min(smallest, measure_clearances(positions, CLAMP, height, radius)[0])
        aside = min(
            measure_clearances(positions, raised, height, radius)[0]
            for height, radius in ((0.0, 3.0), (21.0, 12.0))
        )
        # Above the edges of a fixture the clearance is slanted, and no raised box shows that.
        is_slanted = isinstance(motion, MoveJ) and margin > 0
        if aside < margin - 0.05 and not (is_slanted and not _is_below(positions, CLAMP)):
            meets += 1
            assert line in lines
        if aside > margin + 0.05:
            clear += 1
            assert line not in lines
    assert meets > 10
    assert clear > 5
    assert clearance_aside == pytest.approx(max(smallest, 0.0), abs=0.02)
    assert above >= 0


def _is_below(positions: FloatArray, box: list[float]) -> bool:
    """Whether the tool itself is below the top of a box all along."""
    return bool((positions[:, 2] < box[5]).all())


def test_the_depth_in_a_clamp_is_the_shortest_distance_out_of_it() -> None:
    """At y = 19 the tool of radius 3 mm is 4 mm in the clamp, and it is 15 mm below its top."""
    body: list[Instruction] = [
        rapid_to(0, 19, 30),
        feed_to(0, 19, -3),
        feed_to(50, 19, -3),
        rapid_to(50, 19, 30),
    ]
    _, _, faults = examine_cut(body, make_fixtures(CLAMP))
    (fault,) = faults
    assert (fault.kind, fault.line, fault.fixture, fault.serious) == ("fixture", 3, 1, True)
    assert fault.mm == pytest.approx(4.0, abs=0.01)
    assert "the tool runs 4 mm deep into fixture 1" in fault.text
    shallow: list[Instruction] = [rapid_to(0, 5, 30), feed_to(0, 5, 11.5), feed_to(50, 5, 11.5)]
    _, _, (fault,) = examine_cut(shallow, make_fixtures(CLAMP))
    assert fault.mm == pytest.approx(0.5)


def test_a_motion_within_the_margin_is_a_fault_with_its_distance() -> None:
    body: list[Instruction] = [rapid_to(0, 24.5, 30), feed_to(0, 24.5, -3), feed_to(50, 24.5, -3)]
    aside, _, (fault,) = examine_cut(body, make_fixtures(CLAMP))
    assert aside == pytest.approx(1.5)
    assert fault.mm == 0
    assert "passes fixture 1 1.5 mm apart, cell.margin asks for 2 mm" in fault.text
    assert examine_cut(body, make_fixtures(CLAMP, margin=1.5))[2] == ()


@pytest.mark.parametrize("position", [(5.0, 5.0), (20.0, 25.0), (35.0, 24.0)])
def test_the_clearance_of_a_plunge_is_that_of_its_position(position: tuple[float, float]) -> None:
    body: list[Instruction] = [
        rapid_to(*position, 40),
        feed_to(*position, -3),
        rapid_to(*position, 40),
    ]
    x, y = position
    distance = math.hypot(max(10 - x, x - 30, 0), max(-10 - y, y - 20, 0))
    assert examine_cut(body, make_fixtures(CLAMP))[0] == pytest.approx(distance - 3, abs=1e-9)


@pytest.mark.parametrize(("height", "is_fault"), [(13.9, True), (14.1, False)])
def test_rapid_motions_keep_the_margin_above_a_clamp(height: float, is_fault: bool) -> None:
    rapids: list[Instruction] = [rapid_to(0, 5, height), rapid_to(50, 5, height)]
    _, above, faults = examine_cut(rapids, make_fixtures(CLAMP))
    assert above == pytest.approx(height - 12)
    assert bool(faults) is is_fault
    # A cut may graze the top of a clamp, as it does the jaws of a vice.
    cut: list[Instruction] = [rapid_to(0, 5, height), feed_to(50, 5, height)]
    assert examine_cut(cut, make_fixtures(CLAMP))[2] == ()


def test_a_holder_collides_with_a_clamp_that_the_tool_clears() -> None:
    body: list[Instruction] = [rapid_to(0, 30, 40), feed_to(0, 30, -3), feed_to(50, 30, -3)]
    tool = ToolTable(diameter=6.0, length=30.0, holder=[[-12, -12, 0, 12, 12, 20]])
    assert examine_cut(body, make_fixtures(CLAMP))[2] == ()
    faults = examine_cut(body, make_fixtures(CLAMP), tool)[2]
    # The holder begins 10 mm above the tip, 5 mm below the top of the clamp, and enters it by 2 mm.
    assert {fault.line for fault in faults} == {3}
    assert "the holder runs 2 mm deep into fixture 1" in faults[0].text
    # The holder of a longer tool is above the clamp.
    assert (
        examine_cut(body, make_fixtures(CLAMP), ToolTable(length=45.0, holder=tool.holder))[2] == ()
    )


def test_a_ball_mill_may_come_nearer_with_its_tip() -> None:
    """1 mm below the top a ball of 3 mm radius reaches sqrt(9 - 4) = 2.236 mm aside."""
    body: list[Instruction] = [rapid_to(0, 22.3, 30), feed_to(0, 22.3, 11), feed_to(50, 22.3, 11)]
    ball = ToolTable(kind="ball mill", diameter=6.0)
    assert examine_cut(body, make_fixtures(CLAMP, margin=0.0), ball)[2] == ()
    assert examine_cut(body, make_fixtures(CLAMP, margin=0.0))[2] != ()


def test_an_unknown_holder_below_the_top_of_a_fixture_is_noted() -> None:
    body: list[Instruction] = [rapid_to(0, 50, 40), feed_to(0, 50, -3), feed_to(50, 50, -3)]
    short = ToolTable(diameter=6.0, length=12.0)
    clearance, _ = examine_fixtures([Cut(body, range(1, 4), short)], make_fixtures(CLAMP))
    assert any("set tool.holder" in note for note in clearance.notes)
    clearance, _ = examine_fixtures([Cut(body, range(1, 4), MILL)], make_fixtures(CLAMP))
    assert clearance.notes == ()


def test_a_program_that_hits_a_fixture_is_refused() -> None:
    square = np.array([[0.0, 0.0], [40.0, 0.0], [40.0, 40.0], [0.0, 40.0]])
    outline = Contour(square, np.zeros(4), True, "0", "c1")
    part = Part("part", "part.dxf", "mm", (outline,), ())
    job = Job(
        operation=OperationTable(kind="follow", depth=2.0),
        tool=MILL,
        process=ProcessTable(spindle=9000.0),
    )
    body: list[Instruction] = [rapid_to(-3, -3, 30), feed_to(-3, -3, -2), feed_to(43, -3, -2)]
    cuts = [Cut(body, range(1, 4), MILL)]
    proof = prove(cuts, design([Task(job, part)], job.stock), fixtures=make_fixtures(CLAMP))
    assert {fault.kind for fault in proof.refused} == {"fixture"}
    assert proof.clearance is not None
    free = prove(cuts, design([Task(job, part)], job.stock))
    assert (free.fixtures, free.clearance, free.refused) == ((), None, ())
