"""Corners of a path: the tool stops there, or the controller rounds them within a tolerance."""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct

from camgen.geometry.arcs import Spans, make_spans_through
from camgen.geometry.vectors import measure_angles
from camgen.model.cell import Dynamics
from camgen.model.job import Job
from camgen.model.pose import FloatArray
from camgen.model.tolerance import NONZERO, SMALLEST_ZONE, ZONES
from camgen.motion.rounding import Transitions, measure_rounding

#: mm before the corner at which the reorientation to the next motion begins with each of `ZONES`:
#: z5, z1 and z0 of RAPID.
_TURNS = (8.0, 1.0, 0.3)
#: A line that is rounded by at most this fraction of the width of the pen, and at most this
#: distance in mm, looks the same.
_PEN_SHARE, _MAX_PEN_MM = 1 / 20, 0.05
#: mm: rounding of a distance. Lines that continue into an arc have no corner.
_ROUNDING = 1e-9
#: mm: smallest blend that differs from a stop in program texts.
_MIN_BLEND = 1e-3
#: rad: deviation of the orientation that is allowed in a corner without a stop. If the orientation
#: jumps by more, the tool stops to be reoriented.
JUMP = math.radians(0.5)
#: A reorientation begins this number of zones before the corner at most: z5 of RAPID (`zonedata`).
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


def compute_corner_tolerance(job: Job, operation: str) -> float:
    """Distance by which the path of an `operation` may be rounded in a corner, mm."""
    if job.tolerance.corner is not None:
        return job.tolerance.corner
    if operation in ("trace", "fill"):
        return max(job.tolerance.chord, min(_PEN_SHARE * job.tool.diameter, _MAX_PEN_MM))
    return job.tolerance.chord


def blend_corners(
    motions: Spans, speed: FloatArray, tolerance: FloatArray | float, pace: Dynamics
) -> FloatArray:
    """(N - 1,) distance before the end of each motion at which rounding may begin, mm; 0 is a stop.

    motions: N motions, each from the end of the one before.
    speed: (N,) mm/s.
    tolerance: (N - 1,) limit of the distance, mm, of the executed path from the programmed one.
    pace: way in which the controller rounds.
    """
    start, end = motions.tangents()
    sine = np.sin(measure_angles(end[:-1], start[1:]) / 2)
    fast = np.maximum(speed[:-1], speed[1:])
    tolerance = np.broadcast_to(np.asarray(tolerance, np.float64), sine.shape)
    if pace.corner == "overlap":
        blend = _overlap(motions.length, sine, fast, tolerance, pace)
    else:
        blend = _zone(motions.length, sine, tolerance)
    rows = np.flatnonzero((motions.curved[:-1] | motions.curved[1:]) & (blend > 0))
    if len(rows) and pace.corner in ("zone", "overlap"):
        # In paths in space `via` need not be the middle of an arc.
        first, second = (
            make_spans_through(spans.start, spans.via, spans.end)
            for spans in (motions.pick(rows), motions.pick(rows + 1))
        )
        pairs = Transitions(first, second, blend[rows], fast[rows])
        blend[rows] = _narrow(pairs, tolerance[rows], pace)
    return blend


def _zone(length: FloatArray, sine: FloatArray, tolerance: FloatArray) -> FloatArray:
    """The largest zone that keeps the tolerance and half of the shorter neighbour, mm; 0 is a stop.

    A rounding of two lines that begins b before a corner and ends b after it is a parabola, which
    passes the corner at b sin(turn / 2) / 2. The smallest zone is kept next to shorter neighbours,
    if the tolerance allows it: controllers limit a zone to half of the neighbours by themselves,
    while stops at every point of a fine polyline would leave marks on the part.
    """
    reach = 2 * tolerance / np.maximum(sine, 1e-9)
    # A line that is drawn 10 mm long counts as that, whatever its last binary digit is.
    half = np.minimum(length[:-1], length[1:]) / 2 + 1e-9
    room = np.minimum(reach, np.maximum(half, ZONES[-1]))
    return np.asarray(np.select([room >= zone for zone in ZONES], ZONES, 0.0))


def _overlap(
    length: FloatArray, sine: FloatArray, fast: FloatArray, tolerance: FloatArray, pace: Dynamics
) -> FloatArray:
    """The length of overlapping motions before a corner, mm; 0 is a stop.

    The next motion begins when the previous one begins to brake, v^2 / 2a before its end, or
    half-way if it is too short for its speed. The distance from the corner is at most that of the
    longer one of both.
    """
    length = np.minimum(fast**2 / (2 * pace.acceleration), np.maximum(length[:-1], length[1:]) / 2)
    is_within = length * sine / 2 <= tolerance + _ROUNDING
    return np.where(is_within, np.maximum(np.round(length, 3), _MIN_BLEND), 0.0)


def _narrow(pairs: Transitions, tolerance: FloatArray, pace: Dynamics) -> FloatArray:
    """(K,) blends of transitions with an arc that keep the tolerance: as they are, smaller, or 0.

    tolerance: (K,) limit of the distance, mm, of the executed path from the programmed one.
    """
    blend = pairs.blend.copy()
    # Motions overlap or they do not: there is no smaller blend.
    steps = (*ZONES, SMALLEST_ZONE) if pace.corner == "zone" else (0.0,)
    for step, smaller in zip(steps, (*steps[1:], 0.0), strict=True):
        rows = np.flatnonzero(blend == step if step else blend > 0)
        tried = Transitions(
            pairs.first.pick(rows), pairs.second.pick(rows), blend[rows], pairs.fast[rows]
        )
        blend[rows[measure_rounding(tried, pace) > tolerance[rows] + _ROUNDING]] = smaller
    return blend


def limit_blends(blend: FloatArray, bend: FloatArray, pace: Dynamics) -> FloatArray:
    """Blends (K,) that keep the orientation within `JUMP`: `blend`, smaller, or 0.

    bend: (K,) change of the angular velocity per length of the path at the corner, with its axis,
        rad/mm.

    Rounding mixes the rotations before and after a corner. That changes the orientation at the
    corner by b bend / 4 if both begin b from it.
    """
    reach = 4 * JUMP / np.maximum(bend, NONZERO)
    if pace.corner == "overlap":
        return np.where(blend <= reach, blend, 0.0)
    fits = [(blend >= zone) & (reach >= turn) for zone, turn in zip(ZONES, _TURNS, strict=True)]
    smallest = (blend == SMALLEST_ZONE) & (reach >= TURNING * SMALLEST_ZONE)
    return np.asarray(np.select([*fits, smallest], [*ZONES, SMALLEST_ZONE], 0.0))
