"""The extent of a program against the travel of a machine."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from camgen.check.travel import exceed_travel, leave_travel, measure_extent
from camgen.model.cell import Axes
from camgen.model.machine import Machine
from camgen.model.pose import TOOL_DOWN, Pose
from camgen.model.program import Columns, Instruction, MoveC, MoveJ, MoveL
from tests.support.whole import whole

AXES = Axes((1.0,) * 3, (1.0,) * 3)


def at(x: float, y: float, z: float = 0.0) -> Pose:
    return Pose(TOOL_DOWN, (x, y, z))


def columns(*body: Instruction) -> Columns:
    return Columns(whole((MoveJ(at(0, 0), 100.0), *body)))


def machine(low: tuple[float, float, float], high: tuple[float, float, float]) -> Machine:
    return Machine("m.txt", "GRBL", "grbl", "junction", AXES, low, high)


def shifted(program: Columns, x: float = 0.0) -> np.ndarray:
    return np.tile((x, 0.0, 0.0), (len(program.moves), 1))


@given(st.floats(0.5, 50), st.floats(0, 6.2), st.floats(0.1, 6.2), st.booleans())
def test_the_extent_of_an_arc_holds_all_of_it(
    radius: float, begin: float, sweep: float, left: bool
) -> None:
    turn = sweep if left else -sweep
    angles = np.linspace(begin, begin + turn, 20001)
    points = radius * np.column_stack([np.cos(angles), np.sin(angles)])
    via, end = points[10000], points[-1]
    arc = columns(MoveL(at(*points[0]), 10.0), MoveC(at(*via), at(*end), 10.0))
    extent = measure_extent(arc, shifted(arc))
    places = np.vstack([points, np.zeros(2)])
    assert extent.low[:2] == pytest.approx(places.min(axis=0), abs=1e-6 * radius)
    assert extent.high[:2] == pytest.approx(places.max(axis=0), abs=1e-6 * radius)


def test_the_place_beyond_the_travel_is_the_worst_one() -> None:
    # Half a circle of R 10 mm about (10, 0) reaches y = 10 between its ends.
    program = columns(MoveC(at(10, 10), at(20, 0), 10.0), MoveL(at(20, -3), 10.0))
    extent = measure_extent(program, shifted(program))
    assert leave_travel(extent, machine((0, -3, 0), (20, 10, 0))) is None
    beyond = leave_travel(extent, machine((0, -2, 0), (20, 8, 0)))
    assert beyond is not None
    assert beyond.motion == 1
    assert beyond.text == "axis Y would be at 10 mm, its travel ends at 8 mm"
    below = leave_travel(extent, machine((0, -1, 0), (20, 9, 0)))
    assert below is not None
    assert below.motion == 2
    assert below.text == "axis Y would be at -3 mm, its travel begins at -1 mm"


def test_a_shift_moves_the_whole_program() -> None:
    program = columns(MoveC(at(10, 10), at(20, 0), 10.0))
    extent = measure_extent(program, shifted(program, -30.0))
    assert extent.low.tolist() == pytest.approx([-30, 0, 0])
    assert extent.high.tolist() == pytest.approx([-10, 10, 0])


def test_the_extent_may_be_as_long_as_the_travel() -> None:
    program = columns(MoveL(at(30, 40, -5), 10.0), MoveL(at(-10, 0), 10.0))
    extent = measure_extent(program, shifted(program))
    assert exceed_travel(extent, machine((100, 100, 100), (140, 140, 105))) is None
    beyond = exceed_travel(extent, machine((0, 0, 0), (40, 39.5, 5)))
    assert beyond is not None
    assert beyond.text == "axis Y runs from 0 to 40 mm, 40 mm; its travel is 39.5 mm"
    assert math.isclose(extent.low[2], -5)
