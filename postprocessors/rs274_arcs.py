"""Arcs as RS-274 prints them, many at once: G2 or G3 in the XY plane with the centre from the printed start."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from camgen.body import Indices, Mask
from camgen.pose import FloatArray
from camgen.text import short

#: Arcs smaller than this are not well defined by three decimals; larger ones exceed GRBL's 32-bit arithmetic. mm.
_LEAST_RADIUS, _MOST_RADIUS = 0.05, 10_000.0
#: By how much the two radii of an arc may differ: GRBL's error 33, the stricter of the two controllers. mm.
_RADII = 0.005


class Arc(NamedTuple):
    """What is printed of an arc: G2 or G3, and the words of its centre."""

    code: str
    centre: str


class Arcs(NamedTuple):
    """Arcs in the XY plane by column (N,). fault: number in ``FAULTS``, 0 for none. left: counter-clockwise. centre:
    (N, 2) from the printed start, mm.
    """

    fault: NDArray[np.intp]
    left: Mask
    centre: FloatArray

    def printed(self, rows: Indices, decimals: int) -> list[Arc]:
        """What is printed of the arcs ``rows``."""
        codes = np.where(self.left[rows], "G3", "G2").tolist()
        words = ((short(i, decimals + 1), short(j, decimals + 1)) for i, j in self.centre[rows].tolist())
        return [Arc(code, f"I{i} J{j}") for code, (i, j) in zip(codes, words, strict=True)]


#: Why an arc is left to chords, by number.
FAULTS = (
    "",
    "the arc does not lie in the XY plane",
    "the arc is too small, too large or more than half a circle",
    "the arc cannot be told from its chord",
    "the rounded arc has two radii",
)


def printed_arcs(start: FloatArray, via: FloatArray, end: FloatArray, decimals: int) -> Arcs:
    """Arcs from start through via to end, each (N, 3) mm, as they can be printed.

    The centre lies on the perpendicular bisector of the printed end points, so that both radii agree, at the distance
    of the planned centre: exact for shallow arcs too, where three rounded points would not tell the radius.
    """
    digit = 10.0**-decimals
    u, w = (via - start)[:, :2], (end - start)[:, :2]
    uu, ww, area = (u**2).sum(axis=1), (w**2).sum(axis=1), u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0]
    first, last = np.round(start, decimals), np.round(end, decimals)
    span = (last - first)[:, :2]
    with np.errstate(divide="ignore", invalid="ignore"):
        # From the start to the planned centre.
        arm = np.column_stack([uu * w[:, 1] - ww * u[:, 1], ww * u[:, 0] - uu * w[:, 0]]) / (2 * area)[:, None]
        radius, chord = np.hypot(*arm.T), np.hypot(*span.T)
        rest = w - arm
        turn = np.sign(area) * (arm[:, 1] * rest[:, 0] - arm[:, 0] * rest[:, 1])
        sweep = np.arctan2(turn, -(arm * rest).sum(axis=1)) % (2 * np.pi)
        across = np.column_stack([-span[:, 1], span[:, 0]]) / chord[:, None]
        middle = (first + last)[:, :2] / 2
        away = ((start[:, :2] + arm - middle) * across).sum(axis=1)
        centre = np.round(middle + away[:, None] * across - first[:, :2], decimals + 1)
        tests = (
            (first[:, 2] != last[:, 2]) | (np.abs(via[:, 2] - first[:, 2]) > digit),
            ~((radius >= _LEAST_RADIUS) & (radius <= _MOST_RADIUS)) | ((sweep - np.pi) * radius > digit),
            (radius * (1 - np.cos(sweep / 2)) < digit) | (chord < digit),
            ~(np.abs(np.hypot(*centre.T) - np.hypot(*(span - centre).T)) <= _RADII),
        )
    fault = np.select(tests, range(1, len(FAULTS)), 0)
    return Arcs(fault, area > 0, centre)
