"""How fast the corner between two motions is passed, by the ways in which controllers round it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from msgspec import Struct

from camgen.pose import FloatArray
from camgen.post import Pace

#: Half a turn (rad) below which two motions go on in one direction.
_NONE = 1e-6


class Corners(Struct, frozen=True, eq=False):
    """K corners. half: (K,) half of the turn of the direction of travel, 0 to pi / 2. room: (K,) mm, half of the
    shorter motion beside it. blend: (K,) mm. fast: (K,) mm/s, the greater of the two feeds.
    """

    half: FloatArray
    room: FloatArray
    blend: FloatArray
    fast: FloatArray


def passed(corners: Corners, pace: Pace) -> tuple[FloatArray, FloatArray]:
    """Squared speed (K,) in each corner, infinite where nothing limits it, and how far (K,) before and behind the
    corner it holds, mm.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        square, reach = _WAYS[pace.corner](corners, pace)
    straight = corners.half < _NONE
    if pace.corner == "overlap":
        return square, reach
    return np.where(straight, np.inf, square), np.where(straight, 0.0, reach)


def _zone(corners: Corners, pace: Pace) -> tuple[FloatArray, FloatArray]:
    """A parabola from d before the corner to d behind it, run with one acceleration: 2 v sin(h) in the time 2 d / v."""
    reach = np.minimum(corners.blend, corners.room)
    return pace.acceleration * reach / np.sin(corners.half), reach


def _overlap(corners: Corners, pace: Pace) -> tuple[FloatArray, FloatArray]:
    """The next motion speeds up while the one before slows down, v^2 / 2a before the corner, whatever its angle."""
    square = np.minimum(2 * pace.acceleration * corners.room, corners.fast**2)
    return square, square / (2 * pace.acceleration)


def _arc(corners: Corners, pace: Pace) -> tuple[FloatArray, FloatArray]:
    """An arc that stays within ``pace.deviation`` and within its room: v^2 = a r, e = r (1 / cos(h) - 1)."""
    cosine = np.cos(corners.half)
    within = pace.deviation * cosine / (1 - cosine)
    radius = np.minimum(within, corners.room / np.tan(corners.half))
    return pace.across * pace.acceleration * radius, np.zeros(len(radius))


def _junction(corners: Corners, pace: Pace) -> tuple[FloatArray, FloatArray]:
    """As for such an arc, but the machine stays on the lines, so that no room is needed."""
    cosine = np.cos(corners.half)
    return pace.acceleration * pace.deviation * cosine / (1 - cosine), np.zeros(len(cosine))


_WAYS: dict[str, Callable[[Corners, Pace], tuple[FloatArray, FloatArray]]] = {
    "zone": _zone,
    "overlap": _overlap,
    "arc": _arc,
    "junction": _junction,
}
