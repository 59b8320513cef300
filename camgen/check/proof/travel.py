"""Motions between paths: up and down at the ends of a path, across at the clearance height."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from msgspec import Struct

from camgen.check.proof.findings import Findings
from camgen.check.proof.motions import Motions
from camgen.check.proof.pieces import BoolArray, IntArray
from camgen.model.job import ProcessTable

#: Motions that are examined at a time, at least: fewer take longer, more leave the cache.
_STRETCH = 60_000
#: A speed is printed with a few digits.
_NEARLY = 0.99


class Phases(Struct, frozen=True, eq=False):
    """The purpose of each of M motions.

    known: (M,) whether both ends have positions.
    upright: (M,) the TCP moves up or down, or only turns.
    works: (M,) the TCP moves across, in contact: below the clearance height or with the process on.
    chain: (M,) number of the run of working motions, -1 for the others.
    """

    known: BoolArray
    upright: BoolArray
    works: BoolArray
    chain: IntArray


def split_phases(
    motions: Motions, process: ProcessTable, height_slack: float, hops: bool = False
) -> Phases:
    """The phases of the motions of one text.

    height_slack: deviation of a height, mm.
    hops: whether motions below the clearance may travel, as over cleared ground in a pocket.
    """
    known = ~np.isnan(motions.start[:, 0]) & ~np.isnan(motions.end[:, 0])
    upright = known & motions.upright
    high = np.minimum(motions.start[:, 2], motions.end[:, 2]) >= process.clearance - height_slack
    if process.clearance <= height_slack:
        # The tool marks without touching: only its output shows whether it works.
        high &= ~motions.on
    works = known & ~upright & ~high
    if hops:
        works &= ~find_fast(motions, process)
    before = np.append(False, works[:-1]) & np.append(False, motions.path[1:] == motions.path[:-1])
    chain = np.where(works, np.cumsum(works & ~before) - 1, -1)
    return Phases(known, upright, works, chain)


def find_fast(motions: Motions, process: ProcessTable) -> BoolArray:
    """(M,) rapid motions, and lines at the speed of travel if no feed is as high."""
    fast = motions.joint.copy()
    if process.feed < _NEARLY * process.travel_speed:
        fast |= motions.speed >= _NEARLY * process.travel_speed
    return fast


def cut_at_clearance(
    motions: Motions, process: ProcessTable, height_slack: float
) -> list[tuple[int, int]]:
    """Stretches of motions, first and last + 1, that begin and end high between two paths.

    All motions of a path are in one stretch, so that its passes are compared with each other.
    height_slack: deviation of a height, mm.
    """
    path = motions.path
    high = motions.end[:-1, 2] >= process.clearance - height_slack
    # Motions without a path may lie on both sides of a cut.
    later = np.where(path < 0, np.iinfo(path.dtype).max, path)
    later = np.minimum.accumulate(later[::-1])[::-1]
    ends = np.maximum.accumulate(path)[:-1] < later[1:]
    between = np.flatnonzero(high & ends & (path[1:] != path[:-1])) + 1
    if process.clearance <= height_slack:
        # The height does not show whether the tool works.
        between = between[:0]
    wanted = np.searchsorted(between, np.arange(_STRETCH, len(motions), _STRETCH))
    cuts = np.unique(between[wanted[wanted < len(between)]]).tolist()
    return list(pairwise([0, *cuts, len(motions)]))


def check_rest(motions: Motions, clearance: float, findings: Findings) -> None:
    """Finds a first, a last or another motion from or to the rest position below the clearance.

    clearance: clearance height less the deviation of a height, mm. Motions to joint values without
    a path go to the rest position.
    """
    rests = np.isnan(motions.end[:, 0]) & (motions.path < 0)
    low = motions.end[:, 2] < clearance
    leaves = rests & np.append(False, low[:-1])
    arrives = low & np.append(False, rests[:-1])
    for row in np.flatnonzero(leaves)[:1].tolist():
        findings.add(motions, row, "goes to the rest position from below process.clearance")
    for row in np.flatnonzero(arrives)[:1].tolist():
        findings.add(motions, row, "comes from the rest position to below process.clearance")
    if len(motions) and low[-1]:
        findings.add(motions, len(motions) - 1, "ends the program below process.clearance")


def check_travel(
    motions: Motions, phases: Phases, signal: str, contact: BoolArray, findings: Findings
) -> None:
    """Finds travel with the process on, and plunges where no path begins or ends.

    contact: (M,) motions that reach the part: paths, and holes.
    """
    across = phases.known & ~phases.upright & ~phases.works
    for row in np.flatnonzero(across & motions.on)[:1].tolist():
        findings.add(motions, row, f"travels with output {signal} on")
    low = phases.upright & (motions.end[:, 2] < motions.start[:, 2])
    for row in np.flatnonzero(low & ~_touches(phases.upright, contact))[:1].tolist():
        findings.add(motions, row, "goes down where nothing is to be worked")


def _touches(upright: BoolArray, contact: BoolArray) -> BoolArray:
    """(M,) whether a run of upright motions is next to a motion in contact, or holds one."""
    either = upright | contact
    run = np.cumsum(either & ~np.append(False, either[:-1]))
    touched = np.bincount(run[contact & either], minlength=int(run[-1]) + 1 if len(run) else 1) > 0
    return np.asarray(either & touched[run])
