"""Stretches of the front of a loop: clear ones in discs that are cleared, and bare ones between.

A stretch of a circle is a pair of angles, rad, the first one smaller. On a clear stretch the tool
cuts nothing.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from camgen.model.pose import FloatArray

#: Angles that differ by less are equal, rad.
_SAME_RAD = 1e-9


def clear_spans(
    circle: FloatArray, discs: FloatArray, zero: float, sense: float
) -> list[tuple[float, float]]:
    """The stretch of a circle inside each disc; both angles are equal if no part is inside.

    The middle of a stretch lies between -pi and pi.

    circle: (3,) centre and radius, mm.
    discs: (D, 3) centres and radii, mm.
    zero: direction of the angle 0, rad, counter-clockwise from x.
    sense: 1 for angles that grow counter-clockwise, -1 for angles that grow clockwise.
    """
    steps = discs[:, :2] - circle[:2]
    gaps = np.maximum(np.hypot(*steps.T), 1e-12)
    cosines = (gaps**2 + circle[2] ** 2 - discs[:, 2] ** 2) / (2 * gaps * circle[2])
    halves = np.arccos(np.clip(cosines, -1, 1))
    angles = sense * (np.arctan2(steps[:, 1], steps[:, 0]) - zero)
    middles = np.remainder(angles + np.pi, 2 * np.pi) - np.pi
    return list(zip((middles - halves).tolist(), (middles + halves).tolist(), strict=True))


def unrolled(spans: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """The stretches that are not empty, and copies of them one turn later, by first angle."""
    turn = 2 * math.pi
    clear = []
    for first, last in spans:
        if last > first:
            clear += [(first, last), (first + turn, last + turn)]
    return sorted(clear)


def bare_spans(
    clear: Sequence[tuple[float, float]], begin: float, shortest: float
) -> list[tuple[float, float]]:
    """The stretches of one turn from the angle `begin` on that lie in no stretch of `clear`.

    clear: clear stretches from `unrolled`.
    shortest: rad. A clear stretch between two bare ones that is shorter counts as bare.
    """
    bare: list[tuple[float, float]] = []
    reached, end = begin, begin + 2 * math.pi
    for first, last in (*clear, (end, end)):
        stop = min(first, end)
        if stop > reached + _SAME_RAD:
            is_joined = bare and reached - bare[-1][1] < shortest
            start = bare.pop()[0] if is_joined else reached
            bare.append((start, stop))
        reached = max(reached, last)
    return bare


def crossings(clear: Sequence[tuple[float, float]], begin: float, end: float) -> Iterator[float]:
    """Angles from `begin` to `end` between which straight lines cross the cleared area.

    Each angle and the one before it lie in one stretch of `clear`, so the line between them stays
    in one disc. The last angle is `end`; `begin` is left out.

    clear: stretches from `unrolled` that cover all angles from `begin` to `end`.
    """
    reached = begin
    while reached < end:
        reached = min(end, max(last for first, last in clear if first <= reached + _SAME_RAD))
        yield reached
