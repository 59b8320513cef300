"""Motions against fixtures, judged by a dense sampling that shares nothing with the proof."""

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


def at(*place: float) -> Pose:
    x, y, z = place
    return Pose(TOOL_DOWN, (x, y, z))


def rapid(*place: float) -> MoveJ:
    return MoveJ(at(*place), 100.0)


def feed(*place: float) -> MoveL:
    return MoveL(at(*place), 10.0)


def arc(via: tuple[float, ...], end: tuple[float, ...]) -> MoveC:
    return MoveC(at(*via), at(*end), 10.0)


def stand(*boxes: list[float], margin: float = 2.0) -> Fixtures:
    fixtures = list_fixtures(Job(cell=CellTable(fixtures=list(boxes), margin=margin)), ())
    assert fixtures is not None
    return fixtures


def examine(
    body: list[Instruction], fixtures: Fixtures, tool: ToolTable = MILL
) -> tuple[float, float, tuple[Fault, ...]]:
    clearance, faults = examine_fixtures([Cut(body, range(1, len(body) + 1), tool)], fixtures)
    assert clearance.fixtures == len(fixtures.listed)
    return clearance.aside, clearance.above, faults


def sample(start: FloatArray, move: Instruction, count: int = 4001) -> FloatArray:
    """Places of the tip along one motion, (N, 3); arcs by the circle through three points."""
    share = np.linspace(0.0, 1.0, count)[:, None]
    end = np.array(move.target.origin)
    if not isinstance(move, MoveC):
        return start + share * (end - start)
    via = np.array(move.via.origin)
    (ax, ay), (bx, by), (cx, cy) = start[:2], via[:2], end[:2]
    d = 2 * (ax * (by - cy) + bx * (cy - ay) + cx * (ay - by))
    squares = [x * x + y * y for x, y in ((ax, ay), (bx, by), (cx, cy))]
    mx = (squares[0] * (by - cy) + squares[1] * (cy - ay) + squares[2] * (ay - by)) / d
    my = (squares[0] * (cx - bx) + squares[1] * (ax - cx) + squares[2] * (bx - ax)) / d
    first, last = math.atan2(ay - my, ax - mx), math.atan2(cy - my, cx - mx)
    turn = (last - first) % (2 * math.pi)
    if d < 0:
        turn -= 2 * math.pi
    angle = first + share * turn
    radius = math.hypot(ax - mx, ay - my)
    x, y = mx + radius * np.cos(angle), my + radius * np.sin(angle)
    return np.hstack([x, y, np.full_like(x, start[2])])


def judge(
    places: FloatArray, box: list[float], height: float, radius: float
) -> tuple[float, float]:
    """Smallest distance aside of a body below the top of a box, and smallest height over it."""
    x1, y1, _, x2, y2, top = box
    dx = np.maximum(np.maximum(x1 - places[:, 0], places[:, 0] - x2), 0)
    dy = np.maximum(np.maximum(y1 - places[:, 1], places[:, 1] - y2), 0)
    aside, up = np.hypot(dx, dy) - radius, places[:, 2] + height - top
    below, over = up < 0, (up >= 0) & (aside < 0)
    return (
        float(aside[below].min(initial=math.inf)),
        float(up[over].min(initial=math.inf)),
    )


def random_moves(seed: int, count: int) -> list[Instruction]:
    """A program around the clamp: lines, level arcs, plunges and rapid motions at all heights."""
    draw = np.random.default_rng(seed)
    body: list[Instruction] = [rapid(-40, -40, 40)]
    place = np.array([-40.0, -40.0, 40.0])
    while len(body) < count:
        kind = draw.integers(4)
        x, y = draw.uniform((-15, -35), (55, 45))
        z = float(draw.choice([-3.0, 2.0, 11.0, 12.5, 15.0, 30.0]))
        if kind == 0:
            body.append(feed(x, y, z))
        elif kind == 1:
            body.append(rapid(x, y, z))
        elif kind == 2:
            body.append(rapid(*place[:2], z))
        else:
            middle = (place[:2] + np.array([x, y])) / 2
            side = np.array([place[1] - y, x - place[0]]) * draw.uniform(-0.9, 0.9)
            body.append(arc((*(middle + side), place[2]), (x, y, place[2])))
        place = np.array(body[-1].target.origin)
    return body


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("margin", [0.0, 2.0])
def test_the_motions_that_are_too_near_are_those_of_a_dense_sampling(
    seed: int, margin: float
) -> None:
    body = random_moves(seed, 60)
    tool = ToolTable(diameter=6.0, length=30.0, holder=[[-12, -12, 0, 12, 12, 9]])
    least_aside, above, faults = examine(body, stand(CLAMP, margin=margin), tool)
    lines = {fault.line for fault in faults}
    clear = meets = 0
    least = math.inf
    place = np.array(body[0].target.origin)
    for line, move in enumerate(body[1:], 2):
        places = sample(place, move)
        place = places[-1]
        raised = [*CLAMP[:5], CLAMP[5] + (margin if isinstance(move, MoveJ) else 0.0)]
        for height, radius in ((0.0, 3.0), (21.0, 12.0)):
            least = min(least, judge(places, CLAMP, height, radius)[0])
        aside = min(
            judge(places, raised, height, radius)[0]
            for height, radius in ((0.0, 3.0), (21.0, 12.0))
        )
        # Above a top the room is measured slantwise, which no box around it shows.
        slant = isinstance(move, MoveJ) and margin > 0
        if aside < margin - 0.05 and not (slant and not _is_below(places, CLAMP)):
            meets += 1
            assert line in lines
        if aside > margin + 0.05:
            clear += 1
            assert line not in lines
    assert meets > 10
    assert clear > 5
    assert least_aside == pytest.approx(max(least, 0.0), abs=0.02)
    assert above >= 0


def _is_below(places: FloatArray, box: list[float]) -> bool:
    """Whether the tool itself is below the top of a box all along."""
    return bool((places[:, 2] < box[5]).all())


def test_the_depth_in_a_clamp_is_the_least_way_out() -> None:
    """4 mm of the tool are in the clamp at y = 17 + 4 - 3, and 15 mm below its top."""
    body: list[Instruction] = [
        rapid(0, 19, 30),
        feed(0, 19, -3),
        feed(50, 19, -3),
        rapid(50, 19, 30),
    ]
    _, _, faults = examine(body, stand(CLAMP))
    (fault,) = faults
    assert (fault.kind, fault.line, fault.fixture, fault.serious) == ("fixture", 3, 1, True)
    assert fault.mm == pytest.approx(4.0, abs=0.01)
    assert "the tool runs 4 mm deep into fixture 1" in fault.text
    shallow: list[Instruction] = [rapid(0, 5, 30), feed(0, 5, 11.5), feed(50, 5, 11.5)]
    _, _, (fault,) = examine(shallow, stand(CLAMP))
    assert fault.mm == pytest.approx(0.5)


def test_what_passes_too_near_is_told_with_its_distance() -> None:
    body: list[Instruction] = [rapid(0, 24.5, 30), feed(0, 24.5, -3), feed(50, 24.5, -3)]
    least_aside, _, (fault,) = examine(body, stand(CLAMP))
    assert least_aside == pytest.approx(1.5)
    assert fault.mm == 0
    assert "passes fixture 1 1.5 mm apart, cell.margin asks for 2 mm" in fault.text
    assert examine(body, stand(CLAMP, margin=1.5))[2] == ()


@pytest.mark.parametrize("place", [(5.0, 5.0), (20.0, 25.0), (35.0, 24.0)])
def test_the_distance_of_a_plunge_is_that_of_its_place(place: tuple[float, float]) -> None:
    body: list[Instruction] = [rapid(*place, 40), feed(*place, -3), rapid(*place, 40)]
    x, y = place
    distance = math.hypot(max(10 - x, x - 30, 0), max(-10 - y, y - 20, 0))
    assert examine(body, stand(CLAMP))[0] == pytest.approx(distance - 3, abs=1e-9)


@pytest.mark.parametrize(("height", "is_fault"), [(13.9, True), (14.1, False)])
def test_rapid_motions_keep_the_margin_above_a_clamp_too(height: float, is_fault: bool) -> None:
    over: list[Instruction] = [rapid(0, 5, height), rapid(50, 5, height)]
    _, above, faults = examine(over, stand(CLAMP))
    assert above == pytest.approx(height - 12)
    assert bool(faults) is is_fault
    # A cut may graze it, as it does the jaws of a vice.
    cut: list[Instruction] = [rapid(0, 5, height), feed(50, 5, height)]
    assert examine(cut, stand(CLAMP))[2] == ()


def test_a_holder_meets_a_clamp_that_the_tool_clears() -> None:
    body: list[Instruction] = [rapid(0, 30, 40), feed(0, 30, -3), feed(50, 30, -3)]
    tool = ToolTable(diameter=6.0, length=30.0, holder=[[-12, -12, 0, 12, 12, 20]])
    assert examine(body, stand(CLAMP))[2] == ()
    faults = examine(body, stand(CLAMP), tool)[2]
    # The holder begins 10 mm above the tip, and reaches 2 mm into the clamp, which is 5 mm higher.
    assert {fault.line for fault in faults} == {3}
    assert "the holder runs 2 mm deep into fixture 1" in faults[0].text
    # Longer, it is above the clamp.
    assert examine(body, stand(CLAMP), ToolTable(length=45.0, holder=tool.holder))[2] == ()


def test_a_ball_mill_is_narrow_at_its_tip() -> None:
    """1 mm below the top a ball of 3 mm radius reaches sqrt(9 - 4) = 2.236 mm aside."""
    body: list[Instruction] = [rapid(0, 22.3, 30), feed(0, 22.3, 11), feed(50, 22.3, 11)]
    ball = ToolTable(kind="ball mill", diameter=6.0)
    assert examine(body, stand(CLAMP, margin=0.0), ball)[2] == ()
    assert examine(body, stand(CLAMP, margin=0.0))[2] != ()


def test_an_unknown_holder_that_comes_lower_than_a_fixture_is_a_note() -> None:
    body: list[Instruction] = [rapid(0, 50, 40), feed(0, 50, -3), feed(50, 50, -3)]
    short = ToolTable(diameter=6.0, length=12.0)
    clearance, _ = examine_fixtures([Cut(body, range(1, 4), short)], stand(CLAMP))
    assert any("set tool.holder" in note for note in clearance.notes)
    clearance, _ = examine_fixtures([Cut(body, range(1, 4), MILL)], stand(CLAMP))
    assert clearance.notes == ()


def test_a_fixture_in_the_way_refuses_the_program() -> None:
    square = np.array([[0.0, 0.0], [40.0, 0.0], [40.0, 40.0], [0.0, 40.0]])
    outline = Contour(square, np.zeros(4), True, "0", "c1")
    part = Part("part", "part.dxf", "mm", (outline,), ())
    job = Job(
        operation=OperationTable(kind="follow", depth=2.0),
        tool=MILL,
        process=ProcessTable(spindle=9000.0),
    )
    body: list[Instruction] = [rapid(-3, -3, 30), feed(-3, -3, -2), feed(43, -3, -2)]
    cuts = [Cut(body, range(1, 4), MILL)]
    proof = prove(cuts, design([Task(job, part)], job.stock), fixtures=stand(CLAMP))
    assert {fault.kind for fault in proof.refused} == {"fixture"}
    assert proof.clearance is not None
    free = prove(cuts, design([Task(job, part)], job.stock))
    assert (free.fixtures, free.clearance, free.refused) == ((), None, ())
