"""The turns about its axis that a tool may have: any, or those that the job lists."""

from __future__ import annotations

import math

from msgspec import Struct

from camgen.model.errors import JobError
from camgen.model.job import Job, ToolTable
from camgen.model.text import counted
from camgen.motion.setup import OrientationFreedom

#: deg: turns with wider steps stay as they are along a path; a tool that has so few is not led through others.
WIDEST_STEP = 30.0
#: So many turns are more than any tool needs.
_MOST = 720
_EPS = 1e-9


class Rolls(Struct, frozen=True):
    """angles: rad, each beside the next. round: the first comes after the last. steady: the tool keeps
    one of them along a path.
    """

    angles: tuple[float, ...]
    round: bool
    steady: bool

    def beside(self, index: int, step: int) -> int:
        """The index of the turn that is ``step`` (-1, 0 or 1) from that at ``index``; -1: none."""
        if step == 0:
            return index
        other = index + step
        if self.steady or not (self.round or 0 <= other < len(self.angles)):
            return -1
        return other % len(self.angles)


def is_free(tool: ToolTable) -> bool:
    """Whether the tool has more than one turn."""
    return tool.symmetric or tool.turn is not None


def turns_of(tool: ToolTable) -> tuple[float, ...] | None:
    """The turns (rad) of ``tool.turn`` in order, 0 among them; None: the job has none. JobError for what is none."""
    given = tool.turn
    if given is None:
        return None
    if tool.symmetric:
        raise JobError(
            "job", "a symmetric tool has any turn", "tool.turn", "leave out one of the two"
        )
    if len(given) != 3 or not all(math.isfinite(v) for v in given):
        raise JobError(
            "job", f"has {counted(len(given), 'value')}", "tool.turn", "give [from, to, step], deg"
        )
    low, high, step = given
    if step <= 0 or not low <= 0 <= high or high - low > 360:
        remedy = (
            "give [from, to, step] with from <= 0 <= to, 360 deg apart at most, and a step above 0"
        )
        raise JobError("job", f"{given} are no turns", "tool.turn", remedy)
    first, last = math.ceil(low / step - _EPS), math.floor(high / step + _EPS)
    if last - first >= _MOST:
        raise JobError(
            "job", f"has {counted(last - first + 1, 'turn')}", "tool.turn", "take a larger step"
        )
    if last > first and (last - first) * step > 360 - _EPS:
        last -= 1  # a whole turn is none
    return tuple(math.radians(k * step) for k in range(first, last + 1))


def rolls_of(freedom: OrientationFreedom, count: int) -> Rolls:
    """The turns of ``freedom``; of a tool that has any, ``count`` of them, evenly."""
    if not freedom.roll:
        return Rolls((0.0,), False, True)
    if freedom.turns is None:
        angles = ((k * math.tau / count + math.pi) % math.tau - math.pi for k in range(count))
        return Rolls(tuple(angles), True, False)
    step = min(
        (b - a for a, b in zip(freedom.turns, freedom.turns[1:], strict=False)), default=math.tau
    )
    whole = freedom.turns[-1] - freedom.turns[0] + step > math.tau - _EPS
    return Rolls(
        freedom.turns, whole and len(freedom.turns) > 1, step > math.radians(WIDEST_STEP) + _EPS
    )


def freedom_of(job: Job) -> OrientationFreedom:
    """What the job leaves free of the tool's orientation."""
    turns = turns_of(job.tool)
    return OrientationFreedom(
        math.radians(job.tool.axis_tilt), job.tool.symmetric or turns is not None, turns
    )
