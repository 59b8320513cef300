"""All links between the ends of processing motions, what each takes, and the one that is cheapest.

RFA paper, section III.B: direct where two ends share a vertex, along a reached edge where one joins them, else by
retraction, free motion and approach. One retraction for each end makes them all: O(n) motions, not O(n^2).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray
from camgen.motion.limits import LinkSpeeds, turn_speed
from camgen.motion.pose_paths import Way
from camgen.motion.setup import Reached, Setup
from camgen.order.edges.retract import Retraction
from camgen.robots.kinematics.forward import flange
from camgen.robots.models import Robot

#: Up to so many motions it is looked for links along more than one edge: the cost is the cube of their number.
MANY = 150
#: Links by retraction, free motion and approach, the second by way of the home position.
FREE, BY_HOME = -1, -2


class JointLink(Struct, frozen=True, eq=False):
    """A joint motion.

    joints: (J,) joint values of its target.
    free: whether it is in free space, not at the part.
    speed: speed of the TCP, mm/s, from ``paced``.
    share: fraction of the maximum speeds of the joints, from ``paced``; 0 where ``speed`` alone
        holds.
    """

    joints: FloatArray
    free: bool = True
    speed: float = 0.0
    share: float = 0.0


class PathLink(Struct, frozen=True, eq=False):
    """A motion of the TCP along a pose path.

    way: pose path, from its first row.
    joints: (N, J) joint values at its rows.
    speed: (N - 1,) speed of each segment, mm/s.
    kind: its part in a link.
    """

    way: Way
    joints: FloatArray
    speed: FloatArray
    kind: Literal["retraction", "approach", "shared edge"]


Piece = JointLink | PathLink


class MotionEnds(Struct, frozen=True, eq=False):
    """The ends of n motions; 2 i is the start of motion i, 2 i + 1 its end.

    joints: (2 n, J) joint values.
    safe: (2 n, J) joint values at the end of each retraction.
    out: (2 n,) time of each retraction, s.
    free: (2 n, 2 n) time of the joint motion between two ends of retractions, s.
    direct: (2 n, 2 n) time of the direct motion, s; inf for a motion that is not possible.
    through: (n,) time along each motion with the process off, s.
    speed: speed of the TCP at the part, mm/s.
    """

    joints: FloatArray
    safe: FloatArray
    out: FloatArray
    free: FloatArray
    direct: FloatArray
    through: FloatArray
    speed: float


def seconds(robot: Robot, a: FloatArray, b: FloatArray, speed: float) -> FloatArray:
    """What the joints need from ``a`` to ``b`` (..., J), the slowest counting, or the flange at ``speed`` mm/s."""
    joints = (np.abs(b - a) / robot.fastest).max(axis=-1)
    places = [
        flange(robot, x.reshape(-1, x.shape[-1]))[1].reshape(*x.shape[:-1], 3) for x in (a, b)
    ]
    ways = np.linalg.norm(places[1] - places[0], axis=-1)
    return np.asarray(np.maximum(joints, ways / speed))


def distinct(vertices: FloatArray, near: float) -> BoolArray:
    """(2 n, 2 n): which ends of different edges are at one vertex. vertices: (2 n, 3) of the edges, not of the tool."""
    same = np.linalg.norm(vertices[:, None] - vertices[None], axis=2) < near
    own = np.arange(len(vertices)) // 2
    same &= own[:, None] != own[None]
    return np.asarray(same)


def along(ends: MotionEnds) -> tuple[FloatArray, IntArray]:
    """Seconds (2 n, 2 n) of the cheapest link at the part from each end to each other, and the next end on its way."""
    best = ends.direct.copy()
    at = np.arange(len(best))
    first = np.broadcast_to(at[None], best.shape).copy()
    if len(best) <= 2 * MANY:
        best[at, at ^ 1] = ends.through[at // 2]
        for k in range(len(best)):
            over = best[:, k, None] + best[None, k]
            better = over < best - 1e-12
            best = np.where(better, over, best)
            first = np.where(better, first[:, k, None], first)
    return best, first


def steps(
    ends: MotionEnds, at_part: tuple[FloatArray, IntArray], blocked: BoolArray, home: FloatArray
) -> tuple[FloatArray, IntArray]:
    """Seconds (2 n, 2 n) of the cheapest link from each end to each other, and how it begins (2 n, 2 n): the next end
    on the way, ``FREE`` for retraction, free motion and approach, ``BY_HOME`` for the same by way of the home position.

    at_part: as of ``along``. blocked: (2 n, 2 n) free motions that collide. home: (2 n,) s from free space to home,
    infinite where that collides.
    """
    moving = np.stack([np.where(blocked, math.inf, ends.free), home[:, None] + home[None]])
    free = moving.min(axis=0) + ends.out[:, None] + ends.out[None]
    begins = np.where(moving.argmin(axis=0) == 0, FREE, BY_HOME)
    best, first = at_part
    rfa = free < best
    return np.where(rfa, free, best), np.where(rfa, begins, first)


def paced(
    setup: Setup, pieces: Sequence[Piece], here: FloatArray, speeds: LinkSpeeds
) -> tuple[Piece, ...]:
    """``pieces`` of a link that begins at the joints ``here`` (J,), its motions of the joints in free space as fast as
    the joints and ``speeds`` allow.
    """
    found: list[Piece] = []
    for piece in pieces:
        if isinstance(piece, JointLink):
            found.append(_pace_turn(setup, piece, here, speeds))
            here = piece.joints
        else:
            found.append(piece)
            here = piece.joints[-1]
    return tuple(found)


def _pace_turn(setup: Setup, turn: JointLink, here: FloatArray, speeds: LinkSpeeds) -> JointLink:
    speed, share = turn_speed(setup, here, turn.joints, speeds) if turn.free else (speeds.part, 0.0)
    return replace(turn, speed=speed, share=share)


def leaving(out: Retraction) -> PathLink:
    """A retraction."""
    return PathLink(out.way, out.joints, out.speed, "retraction")


def entering(out: Retraction) -> PathLink:
    """The same as an approach."""
    return PathLink(out.way.reversed(), out.joints[::-1], out.speed[::-1], "approach")


def by_way_of(motion: Reached, end: int, other: Retraction, speed: float) -> Retraction:
    """Out of one end (0 start, 1 end) back along the motion at ``speed`` mm/s and then as from its other end."""
    there = motion if end == 0 else motion.reversed()
    return Retraction(
        _chain(there.way, other.way),
        np.concatenate([there.joints, other.joints[1:]]),
        _chain(there.looks, other.looks),
        np.concatenate([there.dense, other.dense[1:]]),
        np.concatenate([np.full(len(there.way) - 1, speed), other.speed]),
        "back along the edge",
        other.via,
    )


def _chain(one: Way, other: Way) -> Way:
    """``one`` and then ``other``, which begins where it ends."""
    return Way(
        *(np.concatenate([getattr(one, f), getattr(other, f)[1:]]) for f in Way.__struct_fields__)
    )
