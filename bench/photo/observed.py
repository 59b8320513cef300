"""The feed and the force of a program at the points of a known part."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench.render.truth import Truth, find_nearest
from bench.support.motions import sample_plane
from camgen.model.program import Program

#: Largest distance between the sampled points of a program, mm.
STEP = 0.02
#: Length of contact over which a peak of the feed is averaged, mm: the tool touches at least that.
PEAK = 1.0


@dataclass(frozen=True)
class Run:
    """The motions of a program along its paths.

    places: (N,) complex, mm.
    speed: (N,) mm/s.
    pressed: (N,) bool, whether a force is set.
    time: (N,) s, from each place to the next.
    """

    places: np.ndarray
    speed: np.ndarray
    pressed: np.ndarray
    time: np.ndarray


@dataclass(frozen=True)
class Observed:
    """The feed of the contact point.

    length: length of contact with force, mm.
    off5: share of that length in which the feed is more than 5 % off.
    peak: largest feed over ``PEAK`` mm, as a multiple of the nominal feed.
    without: length of contact without force, mm.
    too_much: length of path with force on which the contact point stands still, mm.
    """

    length: float
    off5: float
    peak: float
    without: float
    too_much: float


def sample_program(program: Program) -> Run:
    """Samples the motions along the paths of a program, ``STEP`` apart."""
    columns = program.columns
    ends, vias, works = columns.ends, columns.vias, columns.works
    motions = []
    for k in np.flatnonzero(works).tolist():
        via = vias[k] if np.isfinite(vias[k, 0]) else None
        places = sample_plane(ends[k - 1], via, ends[k], STEP)
        count = len(places)
        is_pressed = columns.force[k] > 0
        motions.append((places, np.full(count, columns.speed[k]), np.full(count, is_pressed)))
    places, speed, pressed = (np.concatenate(column) for column in zip(*motions, strict=True))
    time = np.abs(np.diff(places, append=places[-1])) / speed
    return Run(places, speed, pressed, time)


def observe(run: Run, truth: Truth, feed: float) -> Observed:
    """The feed of the contact point in a run. feed: nominal feed of the contact point, mm/s."""
    row = find_nearest(truth.points, run.places)
    ratio = truth.contact * run.speed[row] / feed
    moving, pressed = truth.contact > 0, run.pressed[row]
    good = moving & pressed
    whole = truth.length[good].sum()
    off5 = truth.length[good & (np.abs(ratio - 1) > 0.05)].sum() / whole
    without, too_much = truth.length[moving & ~pressed].sum(), truth.length[~moving & pressed].sum()
    peak = _find_peak(truth.length[good], ratio[good])
    return Observed(*(float(x) for x in (whole, off5, peak, without, too_much)))


def _find_peak(length: np.ndarray, ratio: np.ndarray) -> float:
    """The largest mean of `ratio` over ``PEAK`` mm: length divided by time."""
    along, time = np.cumsum(length), np.cumsum(length / ratio)
    end = np.searchsorted(along, along + PEAK)
    begin = np.flatnonzero(end < len(along))
    end = end[begin]
    return float(((along[end] - along[begin]) / (time[end] - time[begin])).max(initial=0.0))
