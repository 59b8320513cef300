"""Finds laps that begin over a tab, because the ramp before them ends there.

Over a tab a ramp is as high as the tab. If it ends there, its lap begins at that height too, and
comes down to its depth after the tab. Their heights alone would make these motions a ramp.
"""

from __future__ import annotations

import math

import numpy as np

from camgen.check.proof.heights import tab_top
from camgen.check.proof.motions import Motions
from camgen.check.proof.pieces import BoolArray, IntArray
from camgen.check.proof.tasks import Task
from camgen.check.proof.visits import Laps

#: Two places are the same if they are nearer, mm.
_SAME_MM = 0.01
#: A motion down from a tab is steeper than a ramp by more than this factor.
_STEEPER = 1.1


def find_tab_entries(
    task: Task, motions: Motions, rows: IntArray, laps: Laps, slack: float
) -> IntArray:
    """(W,) number of the lap that each of the motions `rows` begins over a tab, -1 for all others.

    A lap begins where it ends, here over a tab. From its first motion at its depth these motions
    lead back to that place. They are as high as the tab, or come down from it more steeply than a
    ramp does. With the end of the lap over the same tab they are no longer than a tab.
    """
    entries = np.full(len(rows), -1)
    if task.operation.entry == "plunge" or not np.isfinite(tab_top(task)):
        return entries
    begin, end = motions.start[rows], motions.end[rows]
    length = np.hypot(*(end - begin)[:, :2].T)
    # Motion k begins where motion k - 1 ends, which is over a tab.
    linked = np.append(False, np.abs(begin[1:] - end[:-1]).max(axis=1, initial=0.0) <= _SAME_MM)
    linked &= np.append(False, _are_over_tab(task, motions, rows, slack)[:-1])
    highest = np.maximum(begin[:, 2], end[:, 2])
    operation = task.operation
    longest = operation.tab_width + task.job.tool.diameter + 2 * operation.tab_height + _SAME_MM
    for number, last in enumerate(laps.last.tolist()):
        height = slack - task.depths[laps.depth[number]]
        if end[last, 2] <= height:
            continue
        first = place = int(laps.first[number])
        while linked[place] and math.dist(begin[place, :2], end[last, :2]) > _SAME_MM:
            place -= 1
        rise = last
        while rise > first and highest[rise - 1] > height:
            rise -= 1
        total = length[place:first].sum() + length[rise : last + 1].sum()
        is_closed = math.dist(begin[place, :2], end[last, :2]) <= _SAME_MM
        if is_closed and total <= longest:
            entries[place:first] = number
    return entries


def _are_over_tab(task: Task, motions: Motions, rows: IntArray, slack: float) -> BoolArray:
    """(W,) whether motions run on the height of the tabs, or come down from it."""
    step = motions.end[rows] - motions.start[rows]
    length, drop = np.hypot(step[:, 0], step[:, 1]), -step[:, 2]
    highest = np.maximum(motions.start[rows, 2], motions.end[rows, 2])
    is_level = (np.abs(highest - tab_top(task)) <= slack) & (np.abs(drop) <= slack)
    slope = _STEEPER * math.tan(math.radians(task.operation.entry_angle))
    is_flank = (highest <= tab_top(task) + slack) & (drop > slope * length)
    return np.asarray(is_level | is_flank)
