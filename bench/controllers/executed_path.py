"""Samples of an executed program, and how far they are from the programmed path.

Nothing here imports camgen.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from bench.controllers.programmed_path import Array, ProgrammedPath, Span
from bench.support.motions import measure_from_lines

#: s between two samples.
PERIOD = 1e-3
#: Samples of a line are compared with this number of motions before and after it.
_NEIGHBOURS = 4
#: mm: the machine is at home if it is nearer, before it leaves again.
_AT_HOME = 0.3


class Samples(NamedTuple):
    """Commanded positions of a program while it moves, one a period.

    places: (N, 3) mm, machine.
    lines: (N,) line number of the text, not falling.
    """

    places: Array
    lines: Array


def read_samples(file: Path) -> Samples:
    """The samples that `halsampler -t` has written: number, position, speed, line, and inputs.

    ValueError if samples are missing.
    """
    rows = [line.split() for line in file.read_text().splitlines() if line != "overrun"]
    table = np.array([row for row in rows if len(row) == 9], dtype=float)
    if (np.diff(table[:, 0]) != 1).any():
        raise ValueError(f"{file.name}: samples are missing")
    moves = np.flatnonzero((np.diff(table[:, 1:4], axis=0) != 0).any(axis=1))
    table = table[moves[0] : moves[-1] + 2]
    return Samples(table[:, 1:4], np.maximum.accumulate(table[:, 5]).astype(int))


def measure_seconds(samples: Samples, path: ProgrammedPath) -> float:
    """Seconds from where the machine passes home to its last motion."""
    distance = np.linalg.norm(samples.places - path.home, axis=1)
    first = int(np.argmax(distance < _AT_HOME))
    leaves = distance[first:] >= _AT_HOME
    last = first + int(np.argmax(leaves))
    nearest = first + int(np.argmin(distance[first:last]))
    return (len(samples.places) - 1 - nearest) * PERIOD


def measure_distance(samples: Samples, path: ProgrammedPath) -> tuple[float, int]:
    """The largest distance, mm, between both paths, and the line of text where it is.

    It is the distance of samples from the motions of their line and its neighbours, and that of the
    ends of motions from the polyline through the samples.
    """
    lines = np.array([span.line for span in path.spans])
    worst, place = 0.0, 0
    for line in np.unique(samples.lines):
        first = max(0, int(np.searchsorted(lines, line)) - _NEIGHBOURS)
        last = int(np.searchsorted(lines, line, "right")) + _NEIGHBOURS
        chosen = samples.places[samples.lines == line]
        spans = path.spans[first:last]
        distance = float(np.min([measure_from_span(span, chosen) for span in spans], axis=0).max())
        if distance > worst:
            worst, place = distance, int(line)
    for number, span in enumerate(path.spans):
        first = lines[max(0, number - _NEIGHBOURS)]
        last = lines[min(len(lines) - 1, number + _NEIGHBOURS)]
        begin, end = np.searchsorted(samples.lines, [first, last + 1])
        distance = measure_from_polyline(samples.places[begin : end + 1], span.end)
        if distance > worst:
            worst, place = distance, span.line
    return worst, place


def measure_from_span(span: Span, places: Array) -> Array:
    """(N,) distance, mm, of places (N, 3) from a motion."""
    if not span.sweep:
        return measure_from_lines(places, span.start, span.end)
    arms = [place[:2] - span.centre for place in (span.start, span.end)]
    begin = np.arctan2(arms[0][1], arms[0][0])
    arm = places[:, :2] - span.centre
    turn = (np.arctan2(arm[:, 1], arm[:, 0]) - begin) * np.sign(span.sweep)
    share = np.mod(turn, 2 * np.pi) / abs(span.sweep)
    # Both radii differ by the digits of the text.
    radii = [np.hypot(*arm) for arm in arms]
    radius = radii[0] + (radii[1] - radii[0]) * np.clip(share, 0.0, 1.0)
    across = np.hypot(np.hypot(arm[:, 0], arm[:, 1]) - radius, places[:, 2] - span.start[2])
    ends = [np.linalg.norm(places - end, axis=1) for end in (span.start, span.end)]
    return np.where(share <= 1.0, across, np.minimum(*ends))


def measure_from_polyline(places: Array, point: Array) -> float:
    """Distance, mm, of a point (3,) from the polyline through places (N, 3)."""
    return float(measure_from_lines(point, places[:-1], places[1:]).min())
