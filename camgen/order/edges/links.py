"""All links between the ends of processing motions, with their times, and the cheapest of them.

RFA paper, section III.B: a link is direct where two ends share a vertex, runs along a reached edge
that joins them, or else is a retraction, a free motion and an approach. One retraction for each end
serves all links: O(n) motions, not O(n^2).
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
from camgen.motion.limits import LinkSpeeds, compute_joint_speed
from camgen.motion.pose_paths import PosePath, join
from camgen.motion.setup import EdgeMotion, Setup
from camgen.order.edges.retract import Retraction
from camgen.robots.kinematics.forward import flange

#: Largest number of motions for which links along several edges are searched: that takes n^3.
MANY = 150
#: Places of a joint motion at which the way of the tool is measured.
_LOOKS = 5
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

    way: PosePath
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


def seconds(
    setup: Setup, a: FloatArray, b: FloatArray, speeds: LinkSpeeds, *, at_part: bool = False
) -> FloatArray:
    """Seconds (...) of the joint motion from ``a`` to ``b`` (..., J), from rest to rest.

    The slowest joint counts, and the TCP and the flange at `_LOOKS` places of the motion. At the
    part the flange does not count.
    """
    joints = speeds.time_joints(setup.robot, b - a)
    tool = np.asarray(setup.flange_from_tool.origin)
    lengths = np.zeros((2, *joints.shape))
    before = None
    for share in np.linspace(0.0, 1.0, _LOOKS):
        rows = (1 - share) * a + share * b if 0 < share < 1 else (a, b)[int(share)]
        rotations, origins = flange(setup.robot, rows.reshape(-1, rows.shape[-1]))
        places = np.stack([origins, origins + rotations @ tool]).reshape(2, *rows.shape[:-1], 3)
        if before is not None:
            lengths += np.linalg.norm(places - before, axis=-1)
        before = places
    length = lengths[1] if at_part else lengths.max(axis=0)
    return np.maximum(joints, speeds.time_tool(length, speeds.part if at_part else speeds.free))


def distinct(vertices: FloatArray, near: float) -> BoolArray:
    """Whether two ends of different edges are at one vertex, (2 n, 2 n).

    vertices: (2 n, 3) ends of the edges, not of the tool, mm.
    near: largest distance within a vertex, mm.
    """
    same = np.linalg.norm(vertices[:, None] - vertices[None], axis=2) < near
    own = np.arange(len(vertices)) // 2
    same &= own[:, None] != own[None]
    return np.asarray(same)


def along(ends: MotionEnds) -> tuple[FloatArray, IntArray]:
    """The cheapest links at the part between all ends: seconds (2 n, 2 n), and their next ends."""
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
    """The cheapest links between all ends: seconds (2 n, 2 n), and how each begins (2 n, 2 n).

    A link begins with the next end at the part, with ``FREE`` for retraction, free motion and
    approach, or with ``BY_HOME`` for these by way of the home position.

    at_part: result of ``along``.
    blocked: (2 n, 2 n) whether a free motion collides.
    home: (2 n,) seconds from free space to home, inf for a motion that collides.
    """
    moving = np.stack([np.where(blocked, math.inf, ends.free), home[:, None] + home[None]])
    free = moving.min(axis=0) + ends.out[:, None] + ends.out[None]
    begins = np.where(moving.argmin(axis=0) == 0, FREE, BY_HOME)
    best, first = at_part
    rfa = free < best
    return np.where(rfa, free, best), np.where(rfa, begins, first)


def paced(
    setup: Setup, pieces: Sequence[Piece], start: FloatArray, speeds: LinkSpeeds
) -> tuple[Piece, ...]:
    """``pieces`` of a link with the speeds of their joint motions in free space.

    start: (J,) joint values at which the link begins.
    """
    result: list[Piece] = []
    for piece in pieces:
        if isinstance(piece, JointLink):
            result.append(_pace_turn(setup, piece, start, speeds))
            start = piece.joints
        else:
            result.append(piece)
            start = piece.joints[-1]
    return tuple(result)


def _pace_turn(setup: Setup, link: JointLink, start: FloatArray, speeds: LinkSpeeds) -> JointLink:
    """A joint motion as fast as the joints and ``speeds`` allow."""
    speed, share = (
        compute_joint_speed(setup, start, link.joints, speeds) if link.free else (speeds.part, 0.0)
    )
    return replace(link, speed=speed, share=share)


def leaving(out: Retraction) -> PathLink:
    """A retraction."""
    return PathLink(out.way, out.joints, out.speed, "retraction")


def entering(out: Retraction) -> PathLink:
    """A retraction run backwards, as an approach."""
    return PathLink(out.way.reversed(), out.joints[::-1], out.speed[::-1], "approach")


def by_way_of(motion: EdgeMotion, end: int, other: Retraction, speed: float) -> Retraction:
    """A retraction from one end that goes along the motion, and then as from its other end.

    end: 0 for the start of the motion, 1 for its end.
    other: retraction of the other end.
    speed: speed along the motion, mm/s.
    """
    along_edge = motion if end == 0 else motion.reversed()
    return Retraction(
        join([along_edge.way, other.way]),
        np.concatenate([along_edge.joints, other.joints[1:]]),
        join([along_edge.looks, other.looks]),
        np.concatenate([along_edge.dense, other.dense[1:]]),
        np.concatenate([np.full(len(along_edge.way) - 1, speed), other.speed]),
        "back along the edge",
        other.via,
    )
