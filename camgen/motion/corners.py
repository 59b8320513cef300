"""How the tool passes a corner: it stops, or its controller rounds the corner by no more than a tolerance."""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct

from camgen.model.cell import Dynamics
from camgen.model.job import Job
from camgen.model.pose import FloatArray
from camgen.model.tolerance import NONZERO, ZONES

#: From where on the tool is turned to the next motion with each of them, mm before the corner: z5, z1 and z0 of RAPID.
_TURNS = (8.0, 1.0, 0.3)
#: Share of the width of a pen, and mm at most: a line so much nearer to its corner is not seen.
_PEN_SHARE, _MOST = 1 / 20, 0.05
#: Of a way, mm: lines that go on into an arc have no corner.
_ROUNDING = 1e-9
#: The least blend that texts tell from a stop, mm.
_LEAST_BLEND = 1e-3
#: How far the tool may be from how it is to stand in a corner that it passes, rad; an orientation that jumps by more
#: is turned there while the tool stands still.
JUMP = math.radians(0.5)
#: A tool begins to turn up to so many times a zone before its corner: z5 of RAPID does (``zonedata``).
TURNING = 1.6


class Flow(Struct, frozen=True):
    """The corners of links that may be rounded.

    slow: speed, mm/s. A motion that is no faster leads to a contact; the tool stops before it.
    room: length at the end of a line that may be rounded off, mm; infinite where the part has a
        body in the scene. A flat part has none, and lines lead up from it and down to it.
    floor: z in the work frame below which the tip does not come within a corner, mm; minus infinite
        where the part has a body in the scene.
    """

    slow: float
    room: float
    floor: float


class Corners(Struct, frozen=True, eq=False):
    """K corners between two motions. sine: (K,) of half the turn. before, after: (K,) mm, their lengths. fast: (K,)
    mm/s, the greater of their speeds.
    """

    sine: FloatArray
    before: FloatArray
    after: FloatArray
    fast: FloatArray


def corner_tolerance(job: Job, operation: str) -> float:
    """How far the path of an ``operation`` may be rounded in a corner, mm."""
    if job.tolerance.corner is not None:
        return job.tolerance.corner
    if operation in ("trace", "fill"):
        return max(job.tolerance.chord, min(_PEN_SHARE * job.tool.diameter, _MOST))
    return job.tolerance.chord


def blend_corners(corners: Corners, tolerance: FloatArray | float, pace: Dynamics) -> FloatArray:
    """Where rounding begins (K,), mm before each corner: 0, a stop, where it would leave it by more than ``tolerance``.

    A rounding that begins b before a corner and ends b behind it is a parabola, which passes it at b sin(turn / 2) / 2.
    """
    way = _overlap if pace.corner == "overlap" else _zone
    return way(corners, tolerance, pace)


def _zone(corners: Corners, tolerance: FloatArray | float, _pace: Dynamics) -> FloatArray:
    """One of the zones, no more than half of the shorter neighbour.

    The least zone stays beside shorter neighbours, where the corner allows it: controllers cut a zone to half of the
    neighbours by themselves, while a stop at every point of a fine polyline would leave its mark on the part.
    """
    reach = 2 * tolerance / np.maximum(corners.sine, 1e-9)
    # A line drawn 10 mm long counts as that, whatever is left of it in the last binary digit.
    half = np.minimum(corners.before, corners.after) / 2 + 1e-9
    room = np.minimum(reach, np.maximum(half, ZONES[-1]))
    return np.asarray(np.select([room >= zone for zone in ZONES], ZONES, 0.0))


def _overlap(corners: Corners, tolerance: FloatArray | float, pace: Dynamics) -> FloatArray:
    """The next motion begins when the one before begins to brake, v^2 / 2a before its end, or half-way where it is too
    short for its speed. The tool leaves the corner by what the longer of both ways makes at most.
    """
    way = np.minimum(
        corners.fast**2 / (2 * pace.acceleration), np.maximum(corners.before, corners.after) / 2
    )
    within = way * corners.sine / 2 <= np.asarray(tolerance) + _ROUNDING
    return np.where(within, np.maximum(np.round(way, 3), _LEAST_BLEND), 0.0)


def hold_orientation(blend: FloatArray, bend: FloatArray, pace: Dynamics) -> FloatArray:
    """``blend`` (K,) of corners, smaller or 0 where the tool would be turned by more than ``JUMP`` from how it is to
    stand. bend: (K,) rad/mm by which the turning along the way changes there, its axis with it.

    Rounding turns as it travels: it mixes the turns before and behind a corner, which leaves the orientation at the
    corner by b bend / 4 where both begin b away from it.
    """
    reach = 4 * JUMP / np.maximum(bend, NONZERO)
    if pace.corner == "overlap":
        return np.where(blend <= reach, blend, 0.0)
    fits = [(blend >= zone) & (reach >= turn) for zone, turn in zip(ZONES, _TURNS, strict=True)]
    return np.asarray(np.select(fits, ZONES, 0.0))
