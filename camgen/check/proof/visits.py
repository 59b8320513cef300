"""Visits and laps: how long the tool stays at one path, and where it runs there at one depth."""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct

from camgen.check.proof.contours import Matched
from camgen.check.proof.motions import Motions
from camgen.check.proof.pieces import BoolArray, IntArray, dot
from camgen.check.proof.tasks import Task
from camgen.check.proof.travel import Phases
from camgen.model.pose import FloatArray

#: A lap is closed if its ends are nearer, mm.
_SAME_MM = 0.01
#: Deviation of the height of a pass, mm, and a fall that the digits of a text show.
_HEIGHT_MM, _FALL_MM = 2e-3, 2e-4
#: A motion is below the depth of a pass by more than this, mm. Texts have three digits.
_BELOW_MM = 1e-3


def number_visits(motions: Motions, phases: Phases, clearance: float, slack: float) -> IntArray:
    """(M,) number of the visit to which each motion belongs, -1 above the part.

    A visit ends where the tool rises to the clearance height, or where another path begins.
    """
    lowest = np.minimum(motions.start[:, 2], motions.end[:, 2])
    low = phases.works | (phases.known & (lowest < clearance - slack))
    goes_on = np.append(False, low[:-1]) & np.append(False, motions.path[1:] == motions.path[:-1])
    rises = (motions.end[:, 2] >= clearance - slack) & ~phases.works
    goes_on &= ~np.append(False, rises[:-1])
    return np.where(low, np.cumsum(low & ~goes_on) - 1, -1)


class Laps(Struct, frozen=True, eq=False):
    """The level parts of visits: L laps over the W working motions of a task.

    A visit has one lap for each depth at which it runs. Leads belong to the lap, and motions over
    tabs. A ramp down to the next depth belongs to none.

    reached: (W,) index of the deepest pass at whose depth the visit has been when each motion
        begins; -1 before the first.
    lap: (W,) number of the lap of each motion, or -1.
    depth: (L,) index of the pass.
    contour: (L,) contour that the first motion follows.
    first, last: (L,) places among the W motions of the first and the last that follows a contour.
    closed: (L,) whether the last one ends where the first one begins.
    """

    reached: IntArray
    lap: IntArray
    depth: IntArray
    contour: IntArray
    first: IntArray
    last: IntArray
    closed: BoolArray


def find_laps(
    task: Task,
    motions: Motions,
    matched: Matched,
    visit: IntArray,
    owner: IntArray,
    limit: float,
) -> Laps:
    """The laps of the motions that `matched` describes.

    visit: (W,) number of the visit of each motion.
    owner: (K,) contour of each piece of the drawing.
    limit: distance, mm, that a motion may have from its place in the drawing.
    """
    rows = matched.rows
    reached = find_reached(task, motions, rows, visit)
    begins = np.ones(len(rows), np.bool_)
    begins[1:] = (reached[1:] != reached[:-1]) | (visit[1:] != visit[:-1])
    group = np.cumsum(begins) - 1
    down = _have_gone_down(task, motions, rows, reached, group)
    place = np.flatnonzero(matched.follows & (reached >= 0) & ~down)
    count = int(group.max(initial=-1)) + 1
    first, last = np.full(count, len(rows)), np.full(count, -1)
    np.minimum.at(first, group[place], place)
    np.maximum.at(last, group[place], place)
    kept = last >= 0
    number = np.where(kept, np.cumsum(kept) - 1, -1)
    lap = number[group] if count else group
    lap[down] = -1
    first, last = first[kept], last[kept]
    begin, end = motions.start[rows[first], :2], motions.end[rows[last], :2]
    operation = task.operation
    led = followed_part(operation.lead_in, limit) + followed_part(operation.lead_out, limit)
    return Laps(
        reached=reached,
        lap=lap,
        depth=reached[first],
        contour=owner[matched.piece[first]],
        first=first,
        last=last,
        closed=np.sqrt(dot(begin - end, begin - end)) <= _SAME_MM + 2 * led,
    )


def find_reached(task: Task, motions: Motions, rows: IntArray, visit: IntArray) -> IntArray:
    """(W,) index of the deepest pass of each visit when its motions begin: `Laps.reached`."""
    start, end = motions.start[rows, 2], motions.end[rows, 2]
    level = _level_of(task, start)
    # The last chords of a ramp are as deep as the pass, and still go down. A visit that begins at
    # the depth of a pass, and goes down from there, has been there.
    falls = (end < start - _FALL_MM) & (_level_of(task, end) == level)
    falls[1:] &= visit[1:] == visit[:-1]
    falls[:1] = False
    return _deepest_so_far(visit, np.where(falls, -1, level))


def _level_of(task: Task, height: FloatArray) -> IntArray:
    """(W,) index of the pass at whose depth each height is, -1 for none."""
    deviation = np.abs(height[:, None] + np.array(task.depths))
    index = deviation.argmin(axis=1)
    return np.where(deviation.min(axis=1, initial=np.inf) <= _HEIGHT_MM, index, -1)


def _deepest_so_far(visit: IntArray, levels: IntArray) -> IntArray:
    if not len(visit):
        return levels
    base = (int(levels.max()) + 2) * np.cumsum(np.append(1, visit[1:] != visit[:-1]))
    deepest = np.maximum.accumulate(np.where(levels >= 0, levels + base, 0))
    return np.asarray(np.maximum(deepest - base, -1))


def _have_gone_down(
    task: Task, motions: Motions, rows: IntArray, reached: IntArray, group: IntArray
) -> BoolArray:
    """(W,) motions of ramps below the depth that their visit has reached, and all later ones.

    The first chords of a ramp may be below it by less than `_BELOW_MM`.
    """
    if task.operation.entry == "plunge":
        return np.zeros(len(rows), np.bool_)
    heights = np.append(-np.array(task.depths), np.inf)[reached]
    below = lowest_of(motions, rows) < heights - _BELOW_MM
    falls = motions.end[rows, 2] < motions.start[rows, 2] - _FALL_MM
    ramp = np.cumsum(~falls)
    below |= falls & (np.bincount(ramp, below)[ramp] > 0)
    count = np.cumsum(below)
    before: IntArray = (count - below)[np.searchsorted(group, group)]
    return np.asarray((count > before) & (reached >= 0))


def lowest_of(motions: Motions, rows: IntArray) -> FloatArray:
    """(W,) the lower end of each of the motions `rows`, mm."""
    return np.asarray(np.minimum(motions.start[rows, 2], motions.end[rows, 2]))


def highest_of(motions: Motions, rows: IntArray) -> FloatArray:
    """(W,) the upper end of each of the motions `rows`, mm."""
    return np.asarray(np.maximum(motions.start[rows, 2], motions.end[rows, 2]))


def followed_part(length: float, limit: float) -> float:
    """The length, mm, of a lead that may be as near to the contour as a motion along it.

    That is the first chord of a quarter circle of the length `length`, if it is within `limit`.
    """
    return math.sqrt(8 * limit * length / (math.pi / 2))
