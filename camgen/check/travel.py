"""The extent of a program, held against the travel of its machine."""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct

from camgen.geometry.arcs import make_spans_through
from camgen.model.machine import Machine
from camgen.model.part import IntArray
from camgen.model.pose import FloatArray, Vec3
from camgen.model.program import Columns, MoveC

#: Positions beyond the travel by less are rounding, mm.
_ROUNDING_MM = 1e-6


class Extent(Struct, frozen=True, eq=False):
    """The extreme positions of a program in X, Y and Z.

    low, high: (3,) mm.
    low_motion, high_motion: (3,) the motions that reach them.
    """

    low: FloatArray
    high: FloatArray
    low_motion: IntArray
    high_motion: IntArray


class Excess(Struct, frozen=True):
    """A place at which a program leaves the travel.

    motion: the motion that leaves it.
    text: axis, position and limit.
    """

    motion: int
    text: str


def measure_extent(columns: Columns, shift: FloatArray) -> Extent:
    """The extent of a program, arcs between their ends included.

    shift: (M, 3) mm, added to the position of each motion; NaN positions are left out.
    """
    ends = columns.ends + shift
    motion, places = _find_extremes(columns, ends, shift)
    points = np.concatenate([ends, places])
    owner = np.concatenate([np.arange(len(ends)), motion])
    known = ~np.isnan(points).any(axis=1)
    points, owner = points[known], owner[known]
    lowest, highest = points.argmin(axis=0), points.argmax(axis=0)
    axes = np.arange(3)
    return Extent(points[lowest, axes], points[highest, axes], owner[lowest], owner[highest])


def _find_extremes(
    columns: Columns, ends: FloatArray, shift: FloatArray
) -> tuple[IntArray, FloatArray]:
    """The motions (K,) and places (K, 3), mm, at which an axis turns around on an arc."""
    arcs = np.flatnonzero(columns.moves_are(MoveC))
    arcs = arcs[arcs > 0]
    spans = make_spans_through(ends[arcs - 1], columns.vias_of(arcs) + shift[arcs], ends[arcs])
    # A position on an arc is a constant and a sine of the angle from its middle.
    turning = np.arctan2(spans.along, spans.towards)
    angles = np.stack([turning, turning - math.pi, turning + math.pi], axis=2)
    inside = (np.abs(angles) < spans.sweep[:, None, None] / 2) & spans.curved[:, None, None]
    arc, _, _ = np.nonzero(inside)
    return arcs[arc], spans.point(angles[inside] / spans.sweep[arc] + 0.5, arc)


def leave_travel(extent: Extent, machine: Machine) -> Excess | None:
    """The position farthest beyond the travel of an axis, None if all are within.

    extent: extent of the program in machine coordinates.
    """
    below = np.asarray(machine.low) - extent.low
    above = extent.high - np.asarray(machine.high)
    if max(below.max(), above.max()) <= _ROUNDING_MM:
        return None
    if below.max() > above.max():
        axis = int(below.argmax())
        limit = f"begins at {machine.low[axis]:.10g}"
        motion, position = extent.low_motion[axis], extent.low[axis]
    else:
        axis = int(above.argmax())
        limit = f"ends at {machine.high[axis]:.10g}"
        motion, position = extent.high_motion[axis], extent.high[axis]
    text = f"axis {'XYZ'[axis]} would be at {_mm(position)} mm, its travel {limit} mm"
    return Excess(int(motion), text)


def exceed_travel(extent: Extent, machine: Machine) -> Excess | None:
    """The axis whose travel is too short for the program by most, None if all are long enough."""
    size = extent.high - extent.low
    travel = np.asarray(machine.high) - np.asarray(machine.low)
    if (size - travel).max() <= _ROUNDING_MM:
        return None
    axis = int((size - travel).argmax())
    text = (
        f"axis {'XYZ'[axis]} runs from {_mm(extent.low[axis])} to {_mm(extent.high[axis])} mm, "
        f"{_mm(size[axis])} mm; its travel is {_mm(travel[axis])} mm"
    )
    return Excess(int(max(extent.low_motion[axis], extent.high_motion[axis])), text)


def size_of(low: Vec3, high: Vec3) -> str:
    """The size of a box in words.

    >>> size_of((0.0, 0.0, -40.0), (200.0, 300.0, 0.0))
    '200 x 300 x 40 mm'
    """
    return " x ".join([_mm(end - begin) for begin, end in zip(low, high, strict=True)]) + " mm"


def _mm(value: float) -> str:
    return f"{round(value, 3):.10g}"
