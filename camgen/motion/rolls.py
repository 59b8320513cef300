"""The rolls of a tool about its axis that are allowed: any, or those that the job lists."""

from __future__ import annotations

import math
from itertools import pairwise

from msgspec import Struct

from camgen.model.errors import JobError
from camgen.model.job import Job, ToolTable
from camgen.model.text import counted
from camgen.motion.setup import OrientationFreedom

#: deg: a tool whose rolls have a larger step keeps one of them along a path.
WIDEST_STEP = 30.0
#: Maximum number of rolls that a job may list; no tool needs more.
_MAX_ROLLS = 720
#: Rounding: fraction of a step, and rad.
_EPS = 1e-9


class Rolls(Struct, frozen=True):
    """Allowed rolls of a tool.

    angles: rad, in order.
    round: whether the first one is the neighbour of the last one.
    steady: whether the tool keeps one of them along a path.
    """

    angles: tuple[float, ...]
    round: bool
    steady: bool

    def find_neighbour(self, index: int, step: int) -> int:
        """The index of the roll that is `step` (-1, 0 or 1) after another one, -1 for none."""
        if step == 0:
            return index
        neighbour = index + step
        if self.steady or not (self.round or 0 <= neighbour < len(self.angles)):
            return -1
        return neighbour % len(self.angles)


def read_rolls(tool: ToolTable) -> tuple[float, ...] | None:
    """The rolls of `tool.turn`, rad, in order, 0 among them; None if the job lists none.

    Raises JobError if the setting is invalid.
    """
    given = tool.turn
    if given is None:
        return None
    if tool.symmetric:
        raise JobError(
            "job", "a symmetric tool has any turn", "tool.turn", "leave out one of the two"
        )
    if len(given) != 3 or not all(map(math.isfinite, given)):
        raise JobError(
            "job", f"has {counted(len(given), 'value')}", "tool.turn", "give [from, to, step], deg"
        )
    low, high, step = given
    if step <= 0 or not low <= 0 <= high or high - low > 360:
        raise JobError(
            "job",
            f"{given} is not a range of turns",
            "tool.turn",
            "give [from, to, step] with from <= 0 <= to, 360 deg apart at most, and a step above 0",
        )
    first, last = math.ceil(low / step - _EPS), math.floor(high / step + _EPS)
    if last - first >= _MAX_ROLLS:
        raise JobError(
            "job", f"has {counted(last - first + 1, 'turn')}", "tool.turn", "take a larger step"
        )
    if last > first and (last - first) * step > 360 - _EPS:
        last -= 1  # The last roll would be the first one again.
    return tuple(math.radians(k * step) for k in range(first, last + 1))


def list_rolls(freedom: OrientationFreedom, count: int) -> Rolls:
    """The rolls of `freedom`; `count` of them, evenly spread, if any roll is allowed."""
    if not freedom.roll:
        return Rolls((0.0,), False, True)
    if freedom.turns is None:
        angles = ((k * math.tau / count + math.pi) % math.tau - math.pi for k in range(count))
        return Rolls(tuple(angles), True, False)
    step = min((b - a for a, b in pairwise(freedom.turns)), default=math.tau)
    is_round = freedom.turns[-1] - freedom.turns[0] + step > math.tau - _EPS
    is_steady = step > math.radians(WIDEST_STEP) + _EPS
    return Rolls(freedom.turns, is_round and len(freedom.turns) > 1, is_steady)


def find_freedom(job: Job) -> OrientationFreedom:
    """The freedom that the job leaves for the orientation of the tool."""
    turns = read_rolls(job.tool)
    has_roll = job.tool.symmetric or turns is not None
    return OrientationFreedom(math.radians(job.tool.axis_tilt), has_roll, turns)
