"""The area that a tool sweeps, against formulas."""

import math

import pytest
import shapely

from camgen.check.stock import sweep
from camgen.check.stock.moves import Cut, tabulate
from camgen.model.job import ToolTable
from camgen.model.pose import TOOL_DOWN, Pose
from camgen.model.program import Instruction, MoveC, MoveJ

#: mm: radius of the helix and of the tool.
RADIUS, TOOL = 2.0, 3.0


def make_helix(laps: int) -> Cut:
    """A helix about the origin that goes down by 1 mm in each lap, in two halves."""

    def pose(turn: float) -> Pose:
        x, y = RADIUS * math.cos(math.tau * turn), RADIUS * math.sin(math.tau * turn)
        return Pose(TOOL_DOWN, (x, y, -turn))

    body: list[Instruction] = [MoveJ(pose(0), 100.0)]
    for half in range(2 * laps):
        body.append(MoveC(pose((half + 0.5) / 2), pose((half + 1) / 2), 10.0))
    return Cut(tuple(body), tuple(range(1, len(body) + 1)), ToolTable(diameter=2 * TOOL))


@pytest.mark.parametrize("depth", [0.2, 0.7, 3.1])
def test_the_laps_of_a_helix_are_swept_once(depth: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Lines that run over themselves take a time that grows with the square of their laps."""
    longest = 0.0

    def widen(lines: sweep.Shapes, radius: float) -> sweep.Shapes:
        nonlocal longest
        longest = float(shapely.length(lines).sum())
        return shapely.buffer(lines, radius, quad_segs=64)

    monkeypatch.setattr(sweep, "_widen", widen)
    cut = make_helix(30)
    area = shapely.union_all(sweep.sweep(tabulate([cut]), [cut], depth)).area
    # Chords leave the helix by less than 0.005 mm.
    rim = math.tau * (RADIUS + TOOL) * 0.005
    assert area == pytest.approx(math.pi * (RADIUS + TOOL) ** 2, abs=rim)
    # A part of a lap is below the depth, then whole laps follow.
    assert longest <= 2 * math.tau * RADIUS
