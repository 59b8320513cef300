"""All links between the ends of processing motions, with their times, and the cheapest of them.

RFA paper, section III.B: a link is direct where two ends share a vertex, runs along a reached edge
that joins them, or else is a retraction, a free motion and an approach. One retraction for each end
serves all links: O(n) motions, not O(n^2).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
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
from camgen.robots.kinematics.forward import compute_flange

#: Maximum number of motions for which links along several edges are searched; the time grows with
#: its third power.
MAX_SEARCHED_MOTIONS = 150
#: Samples of a joint motion between which the path of the TCP is measured.
_TCP_SAMPLES = 5
#: First step of a link by retraction, free motion and approach.
FREE = -1
#: The same by way of the home position.
BY_HOME = -2


class JointLink(Struct, frozen=True, eq=False):
    """A joint motion.

    joints: (J,) joint values of its target.
    free: whether it is in free space, not at the part.
    speed: TCP speed, mm/s, from `replace_speeds`.
    share: fraction of the maximum speeds of the joints, from `replace_speeds`; 0 if `speed` alone
        applies.
    """

    joints: FloatArray
    free: bool = True
    speed: float = 0.0
    share: float = 0.0


class PathLink(Struct, frozen=True, eq=False):
    """A motion of the TCP along a pose path.

    pose_path: pose path, from its first row.
    joints: (N, J) joint values at its rows.
    speed: (N - 1,) speed of each segment, mm/s.
    kind: its part in a link.
    """

    pose_path: PosePath
    joints: FloatArray
    speed: FloatArray
    kind: Literal["retraction", "approach", "shared edge"]


#: A motion of a link.
LinkMotion = JointLink | PathLink


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


def time_joint_motions(
    setup: Setup, a: FloatArray, b: FloatArray, speeds: LinkSpeeds, *, at_part: bool = False
) -> FloatArray:
    """Times (...) of the joint motions from `a` to `b` (..., J), from rest to rest, s.

    The slowest of the joints and the TCP counts, in free space that of the flange too. The paths of
    TCP and flange are measured between `_TCP_SAMPLES` samples.
    """
    joints = speeds.time_joints(setup.robot, b - a)
    tool = np.asarray(setup.flange_from_tool.origin)
    lengths = np.zeros((2, *joints.shape))
    before = None
    for share in np.linspace(0.0, 1.0, _TCP_SAMPLES):
        rows = (1 - share) * a + share * b if 0 < share < 1 else (a, b)[int(share)]
        rotations, origins = compute_flange(setup.robot, rows.reshape(-1, rows.shape[-1]))
        places = np.stack([origins, origins + rotations @ tool]).reshape(2, *rows.shape[:-1], 3)
        if before is not None:
            lengths += np.linalg.norm(places - before, axis=-1)
        before = places
    length = lengths[1] if at_part else lengths.max(axis=0)
    return np.maximum(joints, speeds.time_tool(length, speeds.part if at_part else speeds.free))


def find_shared_vertices(vertices: FloatArray, tolerance: float) -> BoolArray:
    """Whether two ends of different edges are at one vertex, (2 n, 2 n).

    vertices: (2 n, 3) ends of the edges, not of the tool, mm.
    tolerance: largest distance within a vertex, mm.
    """
    same = np.linalg.norm(vertices[:, None] - vertices[None], axis=2) < tolerance
    edge_of = np.arange(len(vertices)) // 2
    return np.asarray(same & (edge_of[:, None] != edge_of))


def find_links_at_part(ends: MotionEnds) -> tuple[FloatArray, IntArray]:
    """Find the fastest links at the part between all ends.

    Returns their times (2 n, 2 n), s, and the next end on each link (2 n, 2 n).
    """
    best = ends.direct.copy()
    index = np.arange(len(best))
    first = np.broadcast_to(index[None], best.shape).copy()
    if len(best) <= 2 * MAX_SEARCHED_MOTIONS:
        best[index, index ^ 1] = ends.through[index // 2]
        for k in range(len(best)):
            by_k = best[:, k, None] + best[None, k]
            is_better = by_k < best - 1e-12
            best = np.where(is_better, by_k, best)
            first = np.where(is_better, first[:, k, None], first)
    return best, first


def choose_links(
    ends: MotionEnds, at_part: tuple[FloatArray, IntArray], blocked: BoolArray, home: FloatArray
) -> tuple[FloatArray, IntArray]:
    """The fastest links between all ends: times (2 n, 2 n), s, and how each begins (2 n, 2 n).

    A link begins with the next end at the part, with `FREE` for retraction, free motion and
    approach, or with `BY_HOME` for these by way of the home position.

    at_part: result of `find_links_at_part`.
    blocked: (2 n, 2 n) whether a free motion collides.
    home: (2 n,) time from free space to home, s; inf for a motion that collides.
    """
    moving = np.stack([np.where(blocked, math.inf, ends.free), home[:, None] + home[None]])
    free = moving.min(axis=0) + ends.out[:, None] + ends.out[None]
    begins = np.where(moving.argmin(axis=0) == 0, FREE, BY_HOME)
    best, first = at_part
    is_free = free < best
    return np.where(is_free, free, best), np.where(is_free, begins, first)


def replace_speeds(
    setup: Setup, motions: Sequence[LinkMotion], start: FloatArray, speeds: LinkSpeeds
) -> Iterator[LinkMotion]:
    """The motions of a link, the joint motions as fast as the joints and `speeds` allow.

    start: (J,) joint values at which the link begins.
    """
    for motion in motions:
        if isinstance(motion, JointLink):
            speed, share = speeds.part, 0.0
            if motion.free:
                speed, share = compute_joint_speed(setup, start, motion.joints, speeds)
            yield replace(motion, speed=speed, share=share)
            start = motion.joints
        else:
            yield motion
            start = motion.joints[-1]


def make_retract(out: Retraction) -> PathLink:
    """The link motion of a retraction."""
    return PathLink(out.pose_path, out.joints, out.speed, "retraction")


def make_approach(out: Retraction) -> PathLink:
    """The link motion of a retraction that is run backwards."""
    return PathLink(out.pose_path.reversed(), out.joints[::-1], out.speed[::-1], "approach")


def make_retraction_along(
    motion: EdgeMotion, end: int, other: Retraction, speed: float
) -> Retraction:
    """A retraction from one end that goes along the motion and then retracts from its other end.

    end: 0 for the start of the motion, 1 for its end.
    other: retraction of the other end.
    speed: speed along the motion, mm/s.
    """
    along_edge = motion if end == 0 else motion.reversed()
    return Retraction(
        join([along_edge.pose_path, other.pose_path]),
        np.concatenate([along_edge.joints, other.joints[1:]]),
        join([along_edge.sampled_path, other.sampled_path]),
        np.concatenate([along_edge.sampled_joints, other.sampled_joints[1:]]),
        np.concatenate([np.full(len(along_edge.pose_path) - 1, speed), other.speed]),
        "back along the edge",
        other.via,
    )
