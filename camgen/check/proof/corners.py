"""Corners between working motions: how far the controller may round them."""

from __future__ import annotations

import math

import numpy as np

from camgen.check.proof.findings import Findings
from camgen.check.proof.motions import Motions
from camgen.check.proof.pieces import IntArray, normals_along
from camgen.check.proof.tasks import Task
from camgen.model.cell import Dynamics
from camgen.model.pose import FloatArray

#: Share of the width of a pen, and mm: a rounding that much smaller is not seen (docs/planning.md).
_PEN_SHARE, _PEN_MM = 1 / 20, 0.05
#: Radius of the largest arc, mm, that a text may have as chords.
_LARGEST_ARC_MM = 1e3
#: A smaller turn, rad, makes no corner: the ends of arcs have the digits of the text.
_FLAT = 0.02


def allowed_rounding(task: Task) -> float:
    """The largest deviation of a rounded corner, mm: `tolerance.corner` or its default."""
    tolerance = task.job.tolerance
    if tolerance.corner is not None:
        return tolerance.corner
    if task.kind in ("trace", "fill"):
        return max(tolerance.chord, min(_PEN_SHARE * task.job.tool.diameter, _PEN_MM))
    return tolerance.chord


def check_corners(
    task: Task,
    motions: Motions,
    pairs: IntArray,
    pace: Dynamics,
    limit: float,
    findings: Findings,
) -> None:
    """Finds corners that the controller rounds by more than the job allows.

    pairs: (N,) motions that go on into the next one in contact.
    pace: the way in which the controller passes corners.
    limit: slack, mm.
    """
    first = pairs[motions.blend[pairs] > 0]
    if pace.corner == "junction" or not len(first):
        return
    second = first + 1
    leaves = _direction(motions, first, 1.0)
    arrives = _direction(motions, second, 0.0)
    turn = np.arccos(np.clip((leaves * arrives).sum(axis=1), -1.0, 1.0))
    for rows in (first, second):
        turn = turn - _turn_of_chords(task, motions, rows)
    deviation = _deviation(motions, first, second, np.sin(turn / 2), pace)
    wrong = (turn > _FLAT) & (deviation > allowed_rounding(task) + limit)
    for index in np.flatnonzero(wrong)[:1].tolist():
        what = f"ends in a corner that is rounded by {deviation[index]:.3f} mm"
        findings.add(motions, int(first[index]), what)


def _turn_of_chords(task: Task, motions: Motions, rows: IntArray) -> FloatArray:
    """(N,) angle, rad, by which a line may differ from the arc whose chord it is; 0 for an arc.

    A chord that leaves its arc by s turns away from it by 4 s / length.
    """
    chord = task.job.tolerance.chord
    length = motions.plane.length[rows]
    longest = math.sqrt(8 * chord * _LARGEST_ARC_MM)
    may_be_chord = (motions.plane.turn[rows] == 0) & (length <= longest)
    return np.where(may_be_chord, 4 * chord / np.maximum(length, 1e-9), 0.0)


def _direction(motions: Motions, rows: IntArray, share: float) -> FloatArray:
    left = normals_along(motions.plane, rows, np.full(len(rows), share))
    length = motions.plane.length[rows]
    rise = motions.end[rows, 2] - motions.start[rows, 2]
    along = np.column_stack([left[:, 1] * length, -left[:, 0] * length, rise])
    size = np.sqrt((along**2).sum(axis=1))
    return np.asarray(along / np.maximum(size, 1e-12)[:, None])


def _deviation(
    motions: Motions, first: IntArray, second: IntArray, sine: FloatArray, pace: Dynamics
) -> FloatArray:
    """(N,) distance, mm, of the rounded path from its corner.

    sine: (N,) of half the turn. A rounding from b before a corner to b after it is a parabola,
    which passes the corner at b sin(turn / 2) / 2.
    """
    before, after = motions.plane.length[first], motions.plane.length[second]
    if pace.corner == "arc":
        # LinuxCNC states the deviation itself: G64 P.
        return motions.blend[first]
    begin = np.minimum(motions.blend[first], np.minimum(before, after) / 2)
    if pace.corner == "overlap":
        # The next motion begins when the one before begins to brake.
        fastest = np.maximum(motions.speed[first], motions.speed[second])
        begin = np.minimum(fastest**2 / (2 * pace.acceleration), np.maximum(before, after) / 2)
    return np.asarray(begin * sine / 2)
