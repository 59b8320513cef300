"""The side of an open line that may be cut, and material that earlier cuts have removed."""

from __future__ import annotations

import math

import numpy as np
import pytest

from camgen.check.stock import Cut, Task, design, prove
from camgen.model.job import Job, OperationTable, ProcessTable, StockTable, ToolTable
from camgen.model.part import Contour, Part
from camgen.model.pose import TOOL_DOWN, Pose
from camgen.model.program import Instruction, MoveJ, MoveL

MILL = ToolTable(diameter=6.0)
CORNERS = [(-50.0, -50.0), (50.0, -50.0), (50.0, 50.0), (-50.0, 50.0)]


def _rapid_to(*place: float) -> Instruction:
    return MoveJ(Pose(TOOL_DOWN, place), 100.0)  # type: ignore[arg-type]


def _feed_to(*place: float) -> Instruction:
    return MoveL(Pose(TOOL_DOWN, place), 10.0)  # type: ignore[arg-type]


def _make_plate(*others: Contour, worked: frozenset[str]) -> Part:
    plate = Contour(np.array(CORNERS), np.zeros(4), True, "0", "plate")
    return Part("p", "p.dxf", "mm", (plate, *others), (), worked=worked)


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("bulge", [0.0, 1.0], ids=["line", "half circle"])
def test_only_the_selected_side_of_an_open_line_may_be_cut(side: str, bulge: float) -> None:
    """The line from (0, -20) to (0, 20) has x < 0 at its left, and the half circle at its right."""
    line = Contour(np.array([[0.0, -20.0], [0.0, 20.0]]), np.array([bulge, 0.0]), False, "0", "c1")
    operation = OperationTable(kind="follow", side=side, depth=2.0)
    job = Job(operation=operation, tool=MILL, process=ProcessTable())
    task = Task(job, _make_plate(line, worked=frozenset({"c1"})))
    for sign in (-1.0, 1.0):
        x = 20.0 * bulge + 3.0 * sign if bulge else 3.0 * sign
        body = [
            _rapid_to(x, 0, 5),
            _feed_to(x, 0, -2),
            _feed_to(x, 0.01, -2),
            _rapid_to(x, 0.01, 5),
        ]
        cut = Cut(body, range(1, len(body) + 1), MILL, "p.ngc")
        proof = prove([cut], design([task], StockTable(thickness=5.0)))
        assert bool(proof.gouges) == ((sign < 0) != (side == "left"))


def test_a_hole_before_the_next_program_counts_in_the_volume() -> None:
    """A mill of 2 mm starts horizontally at the bottom of a hole of 8 mm; both remove volume."""
    drill, mill = ToolTable(diameter=8.0), ToolTable(diameter=2.0)
    operation = OperationTable(kind="pocket", depth=2.0)
    job = Job(operation=operation, tool=mill, process=ProcessTable())
    task = Task(job, _make_plate(worked=frozenset({"plate"})))
    first = Cut([_rapid_to(0, 0, 5), _feed_to(0, 0, -2)], range(1, 3), drill, "a.ngc")
    second = Cut([_feed_to(10, 0, -2)], range(1, 2), mill, "a.ngc")
    proof = prove([first, second], design([task], StockTable(thickness=2.0)))
    # The slot is 2 mm wide from x = 0 to 10 and ends in a half disc. The hole has removed its part
    # up to x = sqrt(16 - y^2); `common` is the integral of that over y from -1 to 1.
    common = math.sqrt(15.0) + 16.0 * math.asin(0.25)
    expected = 2.0 * (16.0 * math.pi + 20.0 + math.pi / 2.0 - common)
    assert proof.volume == pytest.approx(expected, rel=3e-3)


def test_a_rapid_motion_is_free_in_a_hole_that_another_tool_has_drilled() -> None:
    """The hole of 8 mm is the last motion of its program, and a slot of 2 mm begins in it."""
    drill, mill = ToolTable(diameter=8.0), ToolTable(diameter=2.0)
    operation = OperationTable(kind="pocket", depth=2.0)
    job = Job(operation=operation, tool=mill, process=ProcessTable())
    task = Task(job, _make_plate(worked=frozenset({"plate"})))
    first = Cut([_rapid_to(0, 0, 5), _feed_to(0, 0, -2)], range(1, 3), drill, "a.ngc")
    for x, faults in ((-2.9, 0), (-4.0, 1)):
        body = [_feed_to(10, 0, -2), _rapid_to(x, 0, -2)]
        second = Cut(body, range(3, 5), mill, "a.ngc")
        proof = prove([first, second], design([task], StockTable(thickness=2.0)))
        assert len(proof.rapids) == faults
