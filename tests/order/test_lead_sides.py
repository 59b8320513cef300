"""The side and the direction of leads, by the distance from the contour and by the travel."""

from __future__ import annotations

import math

import numpy as np
import pytest

from camgen.model.job import Job, OperationTable
from camgen.model.path import ToolPath
from camgen.order.leads import add_leads
from camgen.plan import plan
from camgen.plan.starting import move_start
from tests.support.drawn import circle, clockwise, part, rectangle

RADIUS, TOOL = 20.0, 3.0
#: Far from the origin, so that a position is not mistaken for a direction.
CENTRE = np.array([150.0, -90.0])
LENGTH = 4.0


def _plan_with_leads(direction: str, side: str, is_clockwise: bool) -> ToolPath:
    """The path along a circle, with leads of `LENGTH`."""
    shape = circle(*CENTRE, RADIUS)
    drawing = part(clockwise(shape) if is_clockwise else shape)
    operation = OperationTable(side=side, direction=direction, lead_in=LENGTH, lead_out=LENGTH)
    job = Job(operation=operation)
    (path,), notes = add_leads(plan(drawing, job).paths, drawing, job)
    assert not notes
    return path


@pytest.mark.parametrize("is_clockwise", [False, True])
@pytest.mark.parametrize("side", ["outside", "inside"])
@pytest.mark.parametrize("direction", ["climb", "conventional"])
def test_leads_continue_the_direction_of_travel_on_the_free_side(
    direction: str, side: str, is_clockwise: bool
) -> None:
    path = _plan_with_leads(direction, side, is_clockwise)
    position = path.position[:, :2] - CENTRE
    # Radius of a quarter circle of this length.
    size = LENGTH / (math.pi / 2)
    outward = 1.0 if side == "outside" else -1.0
    curve = RADIUS + outward * TOOL
    for free, touch in ((position[0], position[1]), (position[-1], position[-2])):
        assert math.hypot(*touch) == pytest.approx(curve)
        radial, along = _split(free - touch, touch)
        assert radial == pytest.approx(outward * size)
        assert abs(along) == pytest.approx(size)
    # Climb milling has the part on the right: clockwise around a disc, counter-clockwise in a hole.
    is_ccw = (side == "inside") == (direction == "climb")
    sense = 1.0 if is_ccw else -1.0
    assert _split(position[0] - position[1], position[1])[1] == pytest.approx(-sense * size)
    assert _split(position[-1] - position[-2], position[-2])[1] == pytest.approx(sense * size)


def _split(offset: np.ndarray, point: np.ndarray) -> tuple[float, float]:
    """The parts of an offset along the radius and counter-clockwise across it."""
    radial = point / np.hypot(*point)
    return float(offset @ radial), float(offset @ [-radial[1], radial[0]])


@pytest.mark.parametrize("fraction", [0.0, 0.5])
def test_leads_continue_the_direction_of_travel_wherever_a_path_starts(fraction: float) -> None:
    """The path outside of a rectangle has lines and arcs, and starts at or in each of them."""
    operation = OperationTable(lead_in=LENGTH, lead_out=LENGTH)
    job = Job(operation=operation)
    drawing = part(rectangle(100, 50, 80, 60))
    (planned,) = plan(drawing, job).paths
    size = LENGTH / (math.pi / 2)
    for row in range(1, len(planned.position)):
        shifted = move_start(planned, row, fraction)
        ((path,), _) = add_leads([shifted], drawing, job)
        free, touch = path.position[0], path.position[1]
        # Climb milling runs clockwise outside: the travel is the outward normal, turned right.
        outward = _find_outward(touch[:2])
        travel = np.array([outward[1], -outward[0]])
        assert (free - touch)[:2] == pytest.approx(size * (outward - travel))


def _find_outward(point: np.ndarray) -> np.ndarray:
    """The direction from the nearest point of the rectangle to a place outside of it."""
    nearest = np.clip(point, [100, 50], [180, 110])
    return (point - nearest) / np.hypot(*(point - nearest))
