"""What comes of an edge: the joints that process it, or the reason why none do."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import NDArray

from camgen.model.job import ProcessTable
from camgen.model.pose import FloatArray, Pose, frozen
from camgen.motion.pose_paths import Index, PosePath, counts
from camgen.robots.models import Robot


def all_clear(joints: FloatArray) -> NDArray[np.bool_]:
    """For where there is nothing to come near (N,)."""
    return np.ones(len(joints), dtype=bool)


def _never_apart(one: FloatArray, _: FloatArray) -> FloatArray:
    return np.zeros(len(one))


class Setup(Struct, frozen=True, eq=False):
    """A robot, its work and its tool. clear: which joint values (N, J) collide with nothing (N,). hit: what joint
    values (J,) that are not clear collide with, as a phrase: "link 5 with the part". apart: mm
    that a point of arm and tool is at most from where other joint values have it (N,), for two tables of them (N, J).
    roomy: which joint values (N, J) that are clear keep the margin too (N,).
    """

    robot: Robot
    base_from_work: Pose
    flange_from_tool: Pose
    clear: Callable[[FloatArray], NDArray[np.bool_]] = all_clear
    hit: Callable[[FloatArray], str] = lambda _: "something"
    apart: Callable[[FloatArray, FloatArray], FloatArray] = _never_apart
    roomy: Callable[[FloatArray], NDArray[np.bool_]] = all_clear


class SampledMotion(Struct, frozen=True, eq=False):
    """A motion as it was looked at: joints (D, J), and the TCP's poses there, from one to the next of which it keeps to
    lines and arcs. way: None where the joints run evenly instead.
    """

    joints: FloatArray
    way: PosePath | None = None


class Blockage(Struct, frozen=True):
    """What stops a motion. what: "collision, link 5 against part". at: where, in rows of its track."""

    kind: Literal["collision", "jump"]
    what: str
    at: float


class FreeSpace(Struct, frozen=True, eq=False):
    """Where it is free, base frame. level: z, mm, above which tool and holder are free. low, high: (3,) corners of the
    part's box. beside: mm from that box within which the holder may meet it. look: what stops each of some motions,
    or the mm that it keeps from what it must not come near, at most ``margin``. gaps: the same mm of joint values (N,
    J) that collide with nothing (N,).
    """

    level: float
    low: FloatArray
    high: FloatArray
    beside: float
    margin: float
    look: Callable[[Sequence[SampledMotion]], list[Blockage | float]]
    gaps: Callable[[FloatArray], FloatArray]


class OrientationFreedom(Struct, frozen=True):
    """What of a tool's orientation is free where the nominal one does not do. tilt: rad, how far its axis may lean from
    the nominal one to any side. roll: turns about its axis are as good, any or, where they are given, ``turns`` (rad,
    in order, 0 among them). Where the roll changes along an arc the axis may lean by up to 2 deg between two rows.
    """

    tilt: float = 0.0
    roll: bool = False
    turns: tuple[float, ...] | None = None

    def __bool__(self) -> bool:
        return self.tilt > 0 or self.roll


class UnreachableEdge(Struct, frozen=True):
    """An edge that cannot be processed. kind: the shape itself; as in ``kinematics.reasons``; or a collision. text: the
    reason with its amount and the place along the edge. remedy: what would help, "" where that is not known.
    """

    id: str
    kind: Literal["shape", "reach", "lean", "limit", "singular", "jump", "collision"]
    text: str
    remedy: str = ""

    @property
    def reason(self) -> str:
        """The reason, with what would help."""
        return "; ".join(filter(None, (self.text, self.remedy)))


class FoldedEdge(UnreachableEdge, frozen=True, eq=False, kw_only=True):
    """An edge that the offset folds back on itself in places; elsewhere it can be run in pieces.

    path: pose path of the whole edge.
    folded: (S,) segments of the path that are folded, not all of them.
    """

    path: PosePath
    folded: NDArray[np.bool_]


class EdgeMotion(Struct, frozen=True, eq=False):
    """A processing motion.

    way: pose path with the rows of the program, N.
    joints: (N, J) joint values at these rows, their posture.
    looks: pose path with a row at each of the D places at which the motion is examined.
    dense: (D, J) joint values there.
    at: (N,) places of the program's rows among these.
    tilt: (D,) angle between tool z and its nominal direction, rad.
    roll: (D,) turn about tool z from the nominal orientation, rad.
    backwards: whether the edge is run from its end to its start.
    trimmed: lengths of the edge before the first row and after the last, mm. The second is negative
        for a piece of a closed edge that runs over the start of the edge.
    nearer: the motion that would be preferred without a margin, if this is another one.
    part_of: id of the edge of which this is a piece; empty for a whole edge.
    """

    id: str
    backwards: bool
    way: PosePath
    joints: FloatArray
    looks: PosePath
    dense: FloatArray
    at: NDArray[np.int64]
    tilt: FloatArray
    roll: FloatArray
    trimmed: tuple[float, float] = (0.0, 0.0)
    nearer: EdgeMotion | None = None
    part_of: str = ""

    @property
    def line(self) -> str:
        """Id of its edge."""
        return self.part_of or self.id

    def reversed(self) -> EdgeMotion:
        """The same motion the other way."""
        return replace(
            self,
            backwards=not self.backwards,
            way=self.way.reversed(),
            joints=frozen(self.joints[::-1]),
            looks=self.looks.reversed(),
            dense=frozen(self.dense[::-1]),
            at=len(self.dense) - 1 - self.at[::-1],
            tilt=frozen(self.tilt[::-1]),
            roll=frozen(self.roll[::-1]),
            trimmed=self.trimmed[::-1],
        )

    @property
    def freed(self) -> tuple[float, float] | None:
        """The most tilt and roll, deg; None where the nominal orientation does."""
        most = (math.degrees(np.abs(self.tilt).max()), math.degrees(np.abs(self.roll).max()))
        return most if max(most) > 1e-6 else None


def feed_of(motion: EdgeMotion, length: float, process: ProcessTable) -> float:
    """The feed of the TCP, so that the point on the edge, ``length`` mm long, runs at ``process.feed``."""
    return process.feed * min(feed_factor(motion, length), process.max_feed_factor)


def feed_factor(motion: EdgeMotion, length: float) -> float:
    """Length of the path of the TCP divided by that of the edge, ``length`` mm."""
    return float(motion.way.length.sum()) / length if length > 0 else 1.0


# From the poses of a way to those of the flange, and how finely a motion is looked at.

#: mm, rad: a motion is looked at so often, and no joint turns by more than JUMP rad from one look to the next.
_LOOK_MM, _LOOK_TURN, JUMP = 5.0, math.radians(5), math.radians(15)
#: rad: what a motion keeps from singularities.
MARGIN = math.radians(2)


def dense_parts(way: PosePath) -> Index:
    """Into how many parts the segments of ``way`` are cut to be looked at."""
    return counts(way, _LOOK_MM, _LOOK_TURN)


def flange_poses(
    setup: Setup, position: FloatArray, rotation: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """base_from_flange, rotations (..., 3, 3) and origins (..., 3), for the TCP in the work frame."""
    tool_from_flange = setup.flange_from_tool.inverse()
    turned = setup.base_from_work.rotation @ rotation
    base = position @ setup.base_from_work.rotation.T + np.asarray(setup.base_from_work.origin)
    return turned @ tool_from_flange.rotation, base + turned @ np.asarray(tool_from_flange.origin)
