"""The time of a program, in all and by path, and the part of it that is travel."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from camgen.body import column
from camgen.cycle.times import timed
from camgen.cycle.work import worked
from camgen.ir import Program, Wait
from camgen.paths import Tour
from camgen.pose import frozen
from camgen.post import Pace
from camgen.report import Cycle

if TYPE_CHECKING:
    from camgen.reach import Reach
    from camgen.robots.models import Robot


def cycle(program: Program, tour: Tour, pace: Pace, found: Reach | None = None, arm: Robot | None = None) -> Cycle:
    """The time of ``program``, which runs the paths of ``tour``. found, arm: see ``timed``."""
    columns = program.columns
    seconds, ends = timed(program, pace, found, arm)
    path = worked(tour, ends)
    # A wait belongs to what comes after it: the one after the signal is switched on to the path, as the pauses in it.
    waits = np.searchsorted(columns.at, np.flatnonzero(columns.are(Wait)))
    every = np.concatenate([seconds, column(columns.of(Wait), "seconds")])
    owner = np.append(path, np.append(path, -1)[waits])
    count = len(tour.paths)
    # Travel leads to the next path that is worked on.
    at = np.flatnonzero(path >= 0)
    order = np.searchsorted(at, np.concatenate([np.arange(len(path)), waits]))
    next_path = np.append(path[at], count)[order]
    travels = owner < 0
    paths = np.bincount(owner[~travels], every[~travels], count)
    links = np.bincount(next_path[travels], every[travels], count + 1)[:count]
    return Cycle(math.fsum(every.tolist()), math.fsum(every[travels].tolist()), frozen(paths), frozen(links))
