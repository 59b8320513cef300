"""The observed feed and the force of a program beside a known part: what the part sees of the tool, point by point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench.render.truth import Truth
from bench.support.motions import sample_plane
from camgen.model.program import Program

#: mm between the places of the program that are looked at, at most.
STEP = 0.02
#: mm of contact over which a peak of the feed is averaged: the tool touches no less.
PEAK = 1.0


@dataclass(frozen=True)
class Run:
    """A program while it works. places: (N,) complex, mm. speed: (N,) mm/s. pressed: (N,) bool. time: (N,) s, from one
    place to the next.
    """

    places: np.ndarray
    speed: np.ndarray
    pressed: np.ndarray
    time: np.ndarray


@dataclass(frozen=True)
class Observed:
    """Of the contact that is pressed: its length, mm, the share of it where the contact point runs more than 5 % faster
    or slower than asked, and its greatest speed over ``PEAK`` mm, as a multiple of that. without:
    mm of contact that is not pressed. too_much: mm of path that is pressed while the contact point stands still.
    """

    length: float
    off5: float
    peak: float
    without: float
    too_much: float


def run(program: Program) -> Run:
    """The motions along the paths of ``program``, as points ``STEP`` apart."""
    columns = program.columns
    ends, vias, works = columns.ends, columns.vias, columns.works
    found = []
    for k in np.flatnonzero(works).tolist():
        via = vias[k] if np.isfinite(vias[k, 0]) else None
        places = sample_plane(ends[k - 1], via, ends[k], STEP)
        count = len(places)
        found.append(
            (places, np.full(count, columns.speed[k]), np.full(count, columns.force[k] > 0))
        )
    places, speed, pressed = (np.concatenate(column) for column in zip(*found, strict=True))
    time = np.abs(np.diff(places, append=places[-1])) / speed
    return Run(places, speed, pressed, time)


def observe(found: Run, truth: Truth, feed: float) -> Observed:
    """What the part sees of a program. feed: what is asked of the contact point, mm/s."""
    row = nearest_rows(truth.points, found.places)
    seen = truth.contact * found.speed[row] / feed
    runs, pressed = truth.contact > 0, found.pressed[row]
    good = runs & pressed
    whole = truth.length[good].sum()
    off5 = truth.length[good & (np.abs(seen - 1) > 0.05)].sum() / whole
    without, too_much = truth.length[runs & ~pressed].sum(), truth.length[~runs & pressed].sum()
    peak = _peak(truth.length[good], seen[good])
    return Observed(*(float(x) for x in (whole, off5, peak, without, too_much)))


def _peak(length: np.ndarray, seen: np.ndarray) -> float:
    """The greatest mean of ``seen`` over ``PEAK`` mm: what was run, by the time that it took."""
    run_, time = np.cumsum(length), np.cumsum(length / seen)
    end = np.searchsorted(run_, run_ + PEAK)
    begin = np.flatnonzero(end < len(run_))
    end = end[begin]
    return float(((run_[end] - run_[begin]) / (time[end] - time[begin])).max(initial=0.0))


def nearest_rows(places: np.ndarray, others: np.ndarray) -> np.ndarray:
    """(N,) which of ``others`` is nearest to each of ``places``."""
    rows = []
    for k in range(0, len(places), 128):
        apart = places[k : k + 128, None] - others
        rows.append((apart.real**2 + apart.imag**2).argmin(axis=1))
    return np.concatenate(rows)
