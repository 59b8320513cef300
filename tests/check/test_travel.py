"""The extent of a program compared with the travel of a machine."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from camgen.check.travel import Extent, exceed_travel, leave_travel, measure_extent
from camgen.model.cell import Axes
from camgen.model.machine import Machine
from camgen.model.pose import TOOL_DOWN, Pose
from camgen.model.program import Columns, Instruction, MoveC, MoveJ, MoveL
from tests.support.whole import whole

AXES = Axes((1.0,) * 3, (1.0,) * 3)


def make_pose(x: float, y: float, z: float = 0.0) -> Pose:
    return Pose(TOOL_DOWN, (x, y, z))


def measure_shifted(*body: Instruction, shift: float = 0.0) -> Extent:
    """The extent of a program that starts at the origin and is shifted along x, mm."""
    program = Columns(whole((MoveJ(make_pose(0, 0), 100.0), *body)))
    return measure_extent(program, np.tile((shift, 0.0, 0.0), (len(program.moves), 1)))


def make_machine(low: tuple[float, float, float], high: tuple[float, float, float]) -> Machine:
    return Machine("m.txt", "GRBL", "grbl", "junction", AXES, low, high)


@given(st.floats(0.5, 50), st.floats(0, 6.2), st.floats(0.1, 6.2), st.booleans())
def test_the_extent_of_an_arc_contains_the_whole_arc(
    radius: float, start: float, sweep: float, left: bool
) -> None:
    signed_sweep = sweep if left else -sweep
    angles = np.linspace(start, start + signed_sweep, 20001)
    points = radius * np.column_stack([np.cos(angles), np.sin(angles)])
    via, end = points[10000], points[-1]
    extent = measure_shifted(
        MoveL(make_pose(*points[0]), 10.0), MoveC(make_pose(*via), make_pose(*end), 10.0)
    )
    all_points = np.vstack([points, np.zeros(2)])
    assert extent.low[:2] == pytest.approx(all_points.min(axis=0), abs=1e-6 * radius)
    assert extent.high[:2] == pytest.approx(all_points.max(axis=0), abs=1e-6 * radius)


def test_the_position_farthest_beyond_the_travel_is_named() -> None:
    # Half a circle of R 10 mm about (10, 0) reaches y = 10 between its ends.
    extent = measure_shifted(
        MoveC(make_pose(10, 10), make_pose(20, 0), 10.0), MoveL(make_pose(20, -3), 10.0)
    )
    assert leave_travel(extent, make_machine((0, -3, 0), (20, 10, 0))) is None
    beyond = leave_travel(extent, make_machine((0, -2, 0), (20, 8, 0)))
    assert beyond is not None
    assert beyond.motion == 1
    assert beyond.text == "axis Y would be at 10 mm, its travel ends at 8 mm"
    below = leave_travel(extent, make_machine((0, -1, 0), (20, 9, 0)))
    assert below is not None
    assert below.motion == 2
    assert below.text == "axis Y would be at -3 mm, its travel begins at -1 mm"


def test_a_shift_moves_the_whole_program() -> None:
    extent = measure_shifted(MoveC(make_pose(10, 10), make_pose(20, 0), 10.0), shift=-30.0)
    assert extent.low.tolist() == pytest.approx([-30, 0, 0])
    assert extent.high.tolist() == pytest.approx([-10, 10, 0])


def test_the_extent_may_be_as_long_as_the_travel() -> None:
    extent = measure_shifted(MoveL(make_pose(30, 40, -5), 10.0), MoveL(make_pose(-10, 0), 10.0))
    assert exceed_travel(extent, make_machine((100, 100, 100), (140, 140, 105))) is None
    beyond = exceed_travel(extent, make_machine((0, 0, 0), (40, 39.5, 5)))
    assert beyond is not None
    assert beyond.text == "axis Y runs from 0 to 40 mm, 40 mm; its travel is 39.5 mm"
    assert math.isclose(extent.low[2], -5)
