"""A whole motion: sampled as finely as what moves and what is near ask for."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from camgen.collision.hits import ROWS, Nearest, finite, hits, least_of_each, place
from camgen.collision.scene import Scene
from camgen.geometry.ragged import offsets, owners, ramp
from camgen.model.part import IntArray
from camgen.model.pose import FloatArray

#: The longest stretches are 2 ** _HALVINGS steps.
_HALVINGS = 5
#: rad that joints may turn together between two places where it is worked out how far all has moved.
_CLOSE_TURN = 0.05
#: Of so many waypoints one is looked at first.
_SPARSE = 8


class Course(Struct, frozen=True):
    """What a motion meets. pair: of ``scene.pairs``, -1 if none. at: where the first hit is, in rows of the waypoints:
    2.25 is a quarter of the way from row 2 to row 3; nan if there is none. clearance: mm; 0 at a hit, ``near`` if
    nothing comes closer. nearest, nearest_at: the pair that comes as close as ``clearance`` and where, in rows; -1 and
    nan at a hit and if nothing comes closer.
    """

    pair: int
    at: float
    clearance: float
    nearest: int = -1
    nearest_at: float = math.nan

    @property
    def hit(self) -> bool:
        """Whether it meets anything."""
        return self.pair >= 0


def motion(scene: Scene, waypoints: FloatArray, step: float, near: float = 0.0, apart: float = 0.0) -> Course:
    """The first hit of the motion through the configurations (K, J), rad or mm, or else how close it comes.

    Joints run evenly from row to row. apart: mm that any point of a body may be off that at most, as it is where the
    TCP runs along a line: a motion that is free is free with that too.

    A stretch of the motion is free where, at its middle, boxes grown by all that they move within it
    (``measure_moves``) and by ``near`` meet nothing: nothing happens in it that is not within these boxes. What is not
    free is halved, down to stretches in which no point moves by more than ``step`` (mm); these are tested at their
    middle as they are. So a hit that is not found is less than half a step and ``apart`` deep, twice that if both
    bodies move, and the clearance at any moment is no more than that below the one returned.
    """
    return motions(scene, [waypoints], step, near, apart)[0]


def motions(
    scene: Scene, several: Sequence[FloatArray], step: float, near: float = 0.0, apart: float = 0.0
) -> list[Course]:
    """``motion`` of each of ``several``, together: in a fraction of the time where they are short."""
    lines = [_Line.of(scene, finite(waypoints)) for waypoints in several]
    # What is as near at some of the waypoints bounds how near the rest need be looked at.
    sparse = [line.waypoints[::_SPARSE] for line in lines]
    nears = _bound(scene, sparse, near)
    at = _find_undecided(scene, lines, step, [bound.distance for bound in nears], apart)
    rows = [_rows(line.waypoints, here) for line, here in zip(lines, at, strict=True)]
    pairs = np.split(hits(scene, np.concatenate(rows)), np.cumsum([len(own) for own in rows])[:-1])
    free = [bound.distance if (own < 0).all() else 0.0 for own, bound in zip(pairs, nears, strict=True)]
    closer = _least(scene, rows, free)
    return [_course(*one) for one in zip(at, pairs, nears, closer, strict=True)]


def _course(at: FloatArray, pairs: IntArray, bound: Nearest, closer: Nearest) -> Course:
    """What a motion meets at its undecided places ``at``, or how near it comes there or before, at some waypoints."""
    met = np.flatnonzero(pairs >= 0)
    if len(met):
        return Course(int(pairs[met[0]]), float(at[met[0]]), 0.0)
    if closer.pair >= 0:
        return Course(-1, math.nan, closer.distance, closer.pair, float(at[closer.row]))
    return Course(-1, math.nan, bound.distance, bound.pair, float(bound.row * _SPARSE) if bound.pair >= 0 else math.nan)


def _bound(scene: Scene, several: Sequence[FloatArray], near: float) -> list[Nearest]:
    """The least clearance of each of several tables of configurations, at most ``near``; 0 where one collides."""
    if near == 0:
        return [Nearest(0.0, -1, -1) for _ in several]
    struck = np.split(hits(scene, np.concatenate(several)) >= 0, np.cumsum([len(rows) for rows in several])[:-1])
    return _least(scene, several, [0.0 if one.any() else near for one in struck])


def _least(scene: Scene, several: Sequence[FloatArray], nears: Sequence[float]) -> list[Nearest]:
    """``least`` of each of several tables, rows counted in each; for those that are to be nearer than 0 nothing."""
    asked = [k for k, near in enumerate(nears) if near > 0]
    found = [Nearest(0.0, -1, -1) for _ in several]
    if asked:
        lengths = np.array([len(several[k]) for k in asked])
        joints = np.concatenate([several[k] for k in asked])
        measured = least_of_each(scene, joints, owners(lengths), np.array([nears[k] for k in asked]))
        for k, one, begin in zip(asked, measured, offsets(lengths).tolist(), strict=False):
            found[k] = Nearest(one.distance, one.row - begin, one.pair)
    return found


class _Line(Struct, frozen=True, eq=False):
    """One motion. numbers: (K,) places along the waypoints, in rows, between which joints turn by no more than
    ``_CLOSE_TURN``. ways: (K, B) mm that any point of each box has moved at most up to there. way: (K,) the same of
    the box that moves most. turned: (K, J) what the joints of the serial chain have turned or slid up to there, to and
    fro. closing: (J, P) mm per rad or mm of a joint by which two boxes of a pair come nearer at most.
    """

    waypoints: FloatArray
    numbers: FloatArray
    ways: FloatArray
    way: FloatArray
    turned: FloatArray
    closing: FloatArray

    @classmethod
    def of(cls, scene: Scene, waypoints: FloatArray) -> _Line:
        """The motion through ``waypoints`` (K, J)."""
        numbers = _finer(_angles(scene, waypoints))
        rows = _rows(waypoints, numbers)
        moves = measure_moves(scene, rows)
        ways = np.vstack([np.zeros(len(scene.frame)), np.cumsum(moves, axis=0)])
        way = np.append(0.0, np.cumsum(moves.max(axis=1, initial=0.0)))
        serial = rows @ scene.robot.coupling.T
        turned = np.vstack([np.zeros(serial.shape[1]), np.cumsum(np.abs(np.diff(serial, axis=0)), axis=0)])
        return cls(waypoints, numbers, ways, way, turned, closing(scene, np.abs(serial).max(axis=0)))


def _finer(angles: FloatArray) -> FloatArray:
    """Places along the waypoints, in rows, between which joints turn by no more than ``_CLOSE_TURN``: ``measure_moves``
    is close there.
    """
    parts = np.maximum(np.ceil(angles / _CLOSE_TURN), 1).astype(np.int64)
    row = owners(parts)
    return np.append(row + ramp(parts) / parts[row], float(len(parts)))


def _find_undecided(
    scene: Scene, lines: Sequence[_Line], step: float, nears: Sequence[float], apart: float
) -> list[FloatArray]:
    """Where each motion must be tested as it is, in rows of its waypoints: its ends, and the middles of those stretches
    that are no longer than ``step`` and were never found free.
    """
    count = [max(math.ceil(line.way[-1] / (step * 2**_HALVINGS)), 1) for line in lines]
    width = [float(line.way[-1]) / c for line, c in zip(lines, count, strict=True)]
    begins = [np.arange(c) * w for c, w in zip(count, width, strict=True)]
    while long := [k for k, line in enumerate(lines) if width[k] > step and len(begins[k])]:
        asked = [_ask(lines[k], begins[k], width[k]) for k in long]
        rows, grow, closing = (np.concatenate(column) for column in zip(*asked, strict=True))
        near = np.repeat([nears[k] for k in long], [len(begins[k]) for k in long])
        ends = np.cumsum([len(begins[k]) for k in long])
        hit = np.split(hits(scene, rows, grow + apart, closing + 2 * apart, near) >= 0, ends[:-1])
        for k, own in zip(long, hit, strict=True):
            left = begins[k][own]
            width[k] /= 2
            begins[k] = np.concatenate([left, left + width[k]])
    at = []
    for line, own, w in zip(lines, begins, width, strict=True):
        middles = np.interp(np.sort(own) + w / 2, line.way, line.numbers)
        at.append(np.concatenate([line.numbers[:1], middles, line.numbers[-1:]]))
    return at


def _ask(line: _Line, begins: FloatArray, width: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The middles of the stretches that begin at ``begins`` along the way: joints (N, J), and mm (N, B) by which boxes
    must grow there for all that they do in the stretch, (N, P) by which two must together.
    """
    index = np.arange(len(line.way), dtype=np.float64)
    places = [np.interp(begins + width * part, line.way, index) for part in (0.0, 0.5, 1.0)]
    grow, turned = (_most(table, places) for table in (line.ways, line.turned))
    return _rows(line.waypoints, np.interp(places[1], index, line.numbers)), grow, turned @ line.closing


def _most(table: FloatArray, places: Sequence[FloatArray]) -> FloatArray:
    """How much columns that only grow change at most from the middle one of three places to the others."""
    before, here, after = (_rows(table, place) for place in places)
    return np.maximum(here - before, after - here)


def _rows(table: FloatArray, at: FloatArray) -> FloatArray:
    """``table`` (K, C) between its rows, at ``at`` (N,): (N, C)."""
    row = np.minimum(at.astype(np.int64), max(len(table) - 2, 0))
    part = (at - row)[:, None]
    return np.asarray(table[row] * (1 - part) + table[np.minimum(row + 1, len(table) - 1)] * part)


def measure_moves(scene: Scene, waypoints: FloatArray) -> FloatArray:
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
    bent = angles[:, None] * (np.abs(np.diff(serial, axis=0)) @ levers(scene, np.abs(serial).max(axis=0)))
    return np.asarray(straight + bent)


def measure_apart(scene: Scene, one: FloatArray, other: FloatArray) -> FloatArray:
    """How far any point of a body is at most from where it is in another configuration: (N,) mm for each of (N, J)."""
    found = np.zeros(len(one))
    for begin in range(0, len(one), ROWS):
        rows = slice(begin, begin + ROWS)
        here, there = place(scene, one[rows]), place(scene, other[rows])
        straight = np.linalg.norm(here.centres - there.centres, axis=-1)
        turned = (np.linalg.norm(here.axes - there.axes, axis=-2) * scene.half).sum(axis=-1)
        found[rows] = (straight + turned).max(axis=1, initial=0.0)
    return found


def _angles(scene: Scene, waypoints: FloatArray) -> FloatArray:
    """The sum of what all turning joints turn from row to row (K - 1,), rad."""
    turning = np.array([not joint.sliding for joint in scene.robot.joints])
    return np.asarray(np.abs(np.diff(waypoints @ scene.robot.coupling.T, axis=0))[:, turning].sum(axis=1))


def levers(scene: Scene, travel: FloatArray) -> FloatArray:
    """How far any point of a box moves at most per rad or mm of a joint (J, B): its distance from the joint's origin,
    for which the lengths of the chain are added up. travel: (J,) the farthest that each joint is from 0.
    """
    joints = scene.robot.joints
    found = np.zeros((len(joints), len(scene.frame)))
    far = np.linalg.norm(scene.origin, axis=1) + np.linalg.norm(scene.half, axis=1)
    for k in reversed(range(len(joints))):
        beyond = scene.frame > k
        found[k, beyond] = 1.0 if joints[k].sliding else far[beyond]
        far[beyond] += math.hypot(*joints[k].previous_from_joint.origin) + joints[k].sliding * travel[k]
    return found


def closing(scene: Scene, travel: FloatArray) -> FloatArray:
    """By how much two boxes of a pair come nearer at most per rad or mm of a joint (J, P): by what the joints between
    their links do to the farther one. travel: as for ``levers``.
    """
    one, other = scene.frame[scene.first], scene.frame[scene.second]
    low, high = np.minimum(one, other), np.maximum(one, other)
    lever = levers(scene, travel)[:, np.where(one > other, scene.first, scene.second)]
    joint = np.arange(len(lever))[:, None]
    return np.where((joint >= low) & (joint < high), lever, 0.0)
