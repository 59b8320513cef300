"""The seconds of motions that a planner runs as blocks, as GRBL does: lines and chords of arcs.

Source: the comments of `planner.c` and `motion_control.c` of GRBL 1.1h, and its wiki. The speed at
a junction of two blocks is the speed of a circle which touches both and leaves their corner by the
junction deviation. The machine stays on the lines. The plan of a full buffer ends in a stop, since
the planner does not know the next block yet.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from msgspec import Struct

from camgen.check.axis_limits import limit_along
from camgen.check.profile import durations, squares
from camgen.geometry.arcs import make_spans_through
from camgen.geometry.vectors import measure_lengths, multiply_rows
from camgen.model.cell import Axes, Dynamics
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray

#: Blocks after a junction that the planner knows when the machine passes it: the buffer holds 15,
#: and the machine is in the first of them.
LOOK_AHEAD = 14
#: Two directions whose cosine is within this of 1 go straight on, within this of -1 they turn back.
_STRAIGHT = 1e-6
#: Blocks that are planned at a time, up to the next stop.
_STRETCH = 200_000


class Motions(Struct, frozen=True, eq=False):
    """M lines and arcs in the order in which they run.

    start, end: (M, 3) mm.
    via: (M, 3) mm, a point of an arc; NaN for a line.
    speed: (M,) mm/s of the program, infinite for rapid motions.
    stops: (M,) whether the machine stands at the end.
    """

    start: FloatArray
    end: FloatArray
    via: FloatArray
    speed: FloatArray
    stops: BoolArray

    def pick(self, rows: slice) -> Motions:
        """The motions of `rows`."""
        return Motions(*(getattr(self, name)[rows] for name in Motions.__struct_fields__))


class _Blocks(Struct, frozen=True, eq=False):
    """B blocks, none of them without a step.

    motion: (B,) the motion of each.
    length: (B,) mm.
    direction: (B, 3) unit.
    """

    motion: IntArray
    length: FloatArray
    direction: FloatArray


def time_blocks(motions: Motions, dynamics: Dynamics) -> FloatArray:
    """(M,) seconds of the motions; the machine stands before the first one.

    dynamics: dynamics of the controller.
    """
    chords = _count_chords(motions, dynamics.chord)
    seconds = np.zeros(len(chords))
    for rows in _stretches(chords, motions.stops):
        seconds[rows] = _time(motions.pick(rows), chords[rows], dynamics)
    return seconds


def _stretches(chords: IntArray, stops: BoolArray) -> Iterator[slice]:
    """Rows of motions from stop to stop, as many as `_STRETCH` allows."""
    last = np.append(np.flatnonzero(stops) + 1, len(stops))
    blocks = np.append(0, np.cumsum(chords))[last]
    begin, done = 0, 0
    while begin < len(stops):
        place = min(int(np.searchsorted(blocks, done + _STRETCH)), len(last) - 1)
        end = int(last[place])
        yield slice(begin, end)
        begin, done = end, int(blocks[place])


def _count_chords(motions: Motions, chord: float) -> IntArray:
    """(M,) number of chords of each motion, 1 for a line.

    chord: distance by which they leave their arc, mm; the number is rounded down.
    """
    count = np.ones(len(motions.speed), np.intp)
    arcs = np.flatnonzero(~np.isnan(motions.via[:, 0]))
    spans = make_spans_through(motions.start[arcs], motions.via[arcs], motions.end[arcs])
    # Half of a chord that leaves the arc by its tolerance.
    half = np.sqrt(chord * np.maximum(2 * spans.radius - chord, chord))
    count[arcs] = np.maximum(np.floor(spans.length / (2 * half)), 1)
    return count


def _time(motions: Motions, chords: IntArray, dynamics: Dynamics) -> FloatArray:
    blocks = _cut(motions, chords, dynamics.axes)
    count = len(chords)
    if not len(blocks.motion):
        return np.zeros(count)
    gain, limit = _limit(blocks, motions.speed[blocks.motion], dynamics)
    run: IntArray = np.cumsum(motions.stops) - motions.stops
    goes_on: BoolArray = np.diff(run[blocks.motion]) == 0
    junction = np.where(goes_on, _pass_junctions(blocks.direction, dynamics), 0.0)
    allowed = np.zeros(len(limit) + 1)
    allowed[1:-1] = np.minimum(junction, np.minimum(limit[:-1], limit[1:]) ** 2)
    climb = np.append(0.0, np.cumsum(2 * gain * blocks.length))
    known = climb[LOOK_AHEAD:] - climb[:-LOOK_AHEAD]
    allowed[: len(known)] = np.minimum(allowed[: len(known)], known)
    seconds = durations(blocks.length, limit, squares(blocks.length, allowed, gain), gain)
    seconds[np.append(~goes_on, True)] += dynamics.pause
    return np.asarray(np.bincount(blocks.motion, seconds, count), np.float64)


def _cut(motions: Motions, chords: IntArray, axes: Axes | None) -> _Blocks:
    motion = np.repeat(np.arange(len(chords)), chords)
    first = np.cumsum(chords) - chords
    share = (np.arange(len(motion)) - first[motion] + 1) / chords[motion]
    end = make_spans_through(motions.start, motions.via, motions.end).point(share, motion)
    # Both motions beside a joint have the same point.
    end[first + chords - 1] = motions.end
    start = np.empty_like(end)
    start[1:] = end[:-1]
    start[first] = motions.start
    step = _round(end, axes) - _round(start, axes)
    length = measure_lengths(step)
    moves = length > 0
    return _Blocks(motion[moves], length[moves], step[moves] / length[moves, None])


def _round(points: FloatArray, axes: Axes | None) -> FloatArray:
    if axes is None or axes.steps is None:
        return points
    steps = np.asarray(axes.steps)
    return np.asarray(np.sign(points) * np.floor(np.abs(points) * steps + 0.5) / steps)


def _limit(blocks: _Blocks, speed: FloatArray, dynamics: Dynamics) -> tuple[FloatArray, FloatArray]:
    """(B,) accelerations, mm/s2, and speed limits, mm/s, of the blocks.

    speed: (B,) speeds of the program.
    """
    if dynamics.axes is None:
        return np.full(len(speed), dynamics.acceleration), speed
    gain = limit_along(dynamics.axes.accelerations, blocks.direction)
    return gain, np.minimum(speed, limit_along(dynamics.axes.rates, blocks.direction))


def _pass_junctions(direction: FloatArray, dynamics: Dynamics) -> FloatArray:
    """(B - 1,) squared speed at the junctions, infinite where the way goes straight on.

    A circle touches both directions, turns by t and leaves the corner by e: its radius is
    e cos(t / 2) / (1 - cos(t / 2)). Its acceleration points along the change of direction.
    """
    before, after = direction[:-1], direction[1:]
    cosine = multiply_rows(before, after)
    change = after - before
    size = measure_lengths(change)
    toward = change / np.where(size > 0, size, 1.0)[:, None]
    gain = np.full(len(cosine), dynamics.acceleration)
    if dynamics.axes is not None:
        gain = limit_along(dynamics.axes.accelerations, toward)
    half = np.sqrt(np.clip((1 + cosine) / 2, 0.0, 1.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        square = gain * dynamics.deviation * half / (1 - half)
    square[cosine > 1 - _STRAIGHT] = np.inf
    square[cosine < _STRAIGHT - 1] = 0.0
    return np.asarray(square)
