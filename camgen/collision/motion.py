"""A whole motion: sampled as finely as what moves and what is near ask for."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from camgen.collision.clearance import least
from camgen.collision.hits import finite, hits, place
from camgen.collision.scene import Scene
from camgen.pose import FloatArray

#: The longest stretches are 2 ** _HALVINGS steps.
_HALVINGS = 5
#: rad that joints may turn together between two places where it is worked out how far all has moved.
_TURN = 0.05


class Course(Struct, frozen=True):
    """What a motion meets. pair: of ``scene.pairs``, -1 if none. at: where the first hit is, in rows of the waypoints:
    2.25 is a quarter of the way from row 2 to row 3; nan if there is none. clearance: mm; 0 at a hit, ``near`` if
    nothing comes closer.
    """

    pair: int
    at: float
    clearance: float


def motion(scene: Scene, waypoints: FloatArray, step: float, near: float = 0.0) -> Course:
    """The first hit of the motion through the configurations (K, J), rad or mm, or else how close it comes.

    Joints run evenly from row to row: a Cartesian motion is given as rows so dense that this is what it is.

    A stretch of the motion is free where, at its middle, boxes grown by all that they move within it (``moved``) and by
    ``near`` meet nothing: nothing happens in it that is not within these boxes. What is not free is halved, down to
    stretches in which no point moves by more than ``step`` (mm); these are tested at their middle as they are. So
    a hit that is not found is less than half a step deep, a step if both bodies move, and the clearance at any moment
    is no more than that below the one returned.
    """
    return motions(scene, [waypoints], step, near)[0]


def motions(scene: Scene, several: Sequence[FloatArray], step: float, near: float = 0.0) -> list[Course]:
    """``motion`` of each of ``several``, together: in a fraction of the time where they are short."""
    lines = [_Line.of(scene, finite(waypoints)) for waypoints in several]
    at = _undecided(scene, lines, step, near)
    rows = [_rows(line.waypoints, here) for line, here in zip(lines, at, strict=True)]
    pairs = hits(scene, np.concatenate(rows))
    ends = np.cumsum([len(own) for own in rows])
    courses = []
    for own, here, found in zip(rows, at, np.split(pairs, ends[:-1]), strict=True):
        met = np.flatnonzero(found >= 0)
        if len(met):
            courses.append(Course(int(found[met[0]]), float(here[met[0]]), 0.0))
        else:
            courses.append(Course(-1, math.nan, least(scene, own, near) if near > 0 else 0.0))
    return courses


class _Line(Struct, frozen=True, eq=False):
    """One motion. numbers: (K,) places along the waypoints, in rows, between which joints turn by no more than
    ``_TURN``. ways: (K, B) mm that any point of each box has moved at most up to there. way: (K,) the same of the box
    that moves most.
    """

    waypoints: FloatArray
    numbers: FloatArray
    ways: FloatArray
    way: FloatArray

    @classmethod
    def of(cls, scene: Scene, waypoints: FloatArray) -> _Line:
        """The motion through ``waypoints`` (K, J)."""
        numbers = _finer(_angles(scene, waypoints))
        moves = moved(scene, _rows(waypoints, numbers))
        ways = np.vstack([np.zeros(len(scene.frame)), np.cumsum(moves, axis=0)])
        way = np.append(0.0, np.cumsum(moves.max(axis=1, initial=0.0)))
        return cls(waypoints, numbers, ways, way)


def _finer(angles: FloatArray) -> FloatArray:
    """Places along the waypoints, in rows, between which joints turn by no more than ``_TURN``: ``moved`` is close
    there.
    """
    parts = np.maximum(np.ceil(angles / _TURN), 1).astype(np.int64)
    before = np.repeat(np.cumsum(parts) - parts, parts)
    row = np.repeat(np.arange(len(parts)), parts)
    return np.append(row + (np.arange(len(row)) - before) / parts[row], float(len(parts)))


def _undecided(scene: Scene, lines: Sequence[_Line], step: float, near: float) -> list[FloatArray]:
    """Where each motion must be tested as it is, in rows of its waypoints: its ends, and the middles of those stretches
    that are no longer than ``step`` and were never found free.
    """
    count = [max(math.ceil(line.way[-1] / (step * 2**_HALVINGS)), 1) for line in lines]
    width = [float(line.way[-1]) / c for line, c in zip(lines, count, strict=True)]
    begins = [np.arange(c) * w for c, w in zip(count, width, strict=True)]
    while long := [k for k, line in enumerate(lines) if width[k] > step and len(begins[k])]:
        asked = [_asked(lines[k], begins[k], width[k]) for k in long]
        rows, grow = (np.concatenate(column) for column in zip(*asked, strict=True))
        hit = np.split(hits(scene, rows, grow + near) >= 0, np.cumsum([len(begins[k]) for k in long])[:-1])
        for k, own in zip(long, hit, strict=True):
            left = begins[k][own]
            width[k] /= 2
            begins[k] = np.concatenate([left, left + width[k]])
    at = []
    for line, own, w in zip(lines, begins, width, strict=True):
        middles = np.interp(np.sort(own) + w / 2, line.way, line.numbers)
        at.append(np.concatenate([line.numbers[:1], middles, line.numbers[-1:]]))
    return at


def _asked(line: _Line, begins: FloatArray, width: float) -> tuple[FloatArray, FloatArray]:
    """The middles of the stretches that begin at ``begins`` along the way: joints (N, J), and mm (N, B) by which boxes
    must grow there for all that they do in the stretch.
    """
    index = np.arange(len(line.way), dtype=np.float64)
    before, middle, after = (np.interp(begins + width * part, line.way, index) for part in (0.0, 0.5, 1.0))
    here = _rows(line.ways, middle)
    grow = np.maximum(here - _rows(line.ways, before), _rows(line.ways, after) - here)
    return _rows(line.waypoints, np.interp(middle, index, line.numbers)), grow


def _rows(table: FloatArray, at: FloatArray) -> FloatArray:
    """``table`` (K, C) between its rows, at ``at`` (N,): (N, C)."""
    row = np.minimum(at.astype(np.int64), max(len(table) - 2, 0))
    part = (at - row)[:, None]
    return np.asarray(table[row] * (1 - part) + table[np.minimum(row + 1, len(table) - 1)] * part)


def moved(scene: Scene, waypoints: FloatArray) -> FloatArray:
    """How long the way of any point of each box is at most from each row of (K, J) to the next: (K - 1, B), mm.

    A point's speed differs from its mean by no more than half of its greatest acceleration. The mean is no more than
    the way of the box's middle and of the ends of its axes. Two joints give no more than the product of their rates
    and the lever of one, so that half of what all give is no more than all angles times all rates with their levers.
    """
    placed = place(scene, waypoints)
    straight = np.linalg.norm(np.diff(placed.centres, axis=0), axis=-1)
    straight += (np.linalg.norm(np.diff(placed.axes, axis=0), axis=-2) * scene.half).sum(axis=-1)
    serial = waypoints @ scene.robot.coupling.T
    angles = _angles(scene, waypoints)
    bent = angles[:, None] * (np.abs(np.diff(serial, axis=0)) @ _levers(scene, np.abs(serial).max(axis=0)))
    return np.asarray(straight + bent)


def _angles(scene: Scene, waypoints: FloatArray) -> FloatArray:
    """The sum of what all turning joints turn from row to row (K - 1,), rad."""
    turning = np.array([not joint.sliding for joint in scene.robot.joints])
    return np.asarray(np.abs(np.diff(waypoints @ scene.robot.coupling.T, axis=0))[:, turning].sum(axis=1))


def _levers(scene: Scene, travel: FloatArray) -> FloatArray:
    """How far any point of a box moves at most per rad or mm of a joint (J, B): its distance from the joint's origin,
    for which the lengths of the chain are added up. travel: (J,) the farthest that each joint is from 0.
    """
    joints = scene.robot.joints
    levers = np.zeros((len(joints), len(scene.frame)))
    far = np.linalg.norm(scene.origin, axis=1) + np.linalg.norm(scene.half, axis=1)
    for k in reversed(range(len(joints))):
        beyond = scene.frame > k
        levers[k, beyond] = 1.0 if joints[k].sliding else far[beyond]
        far[beyond] += math.hypot(*joints[k].previous_from_joint.origin) + joints[k].sliding * travel[k]
    return levers
