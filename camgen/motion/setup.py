"""Set-up of an arm, and the result for each edge: joint values along it, or the reason for none."""

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
from camgen.motion.pose_paths import Index, PosePath, count_parts
from camgen.robots.models import Robot


def all_clear(joints: FloatArray) -> NDArray[np.bool_]:
    """A test of joint values (N, J) in a space without obstacles: true (N,)."""
    return np.ones(len(joints), dtype=bool)


class Setup(Struct, frozen=True, eq=False):
    """A robot, its work and its tool.

    robot: the arm.
    base_from_work, flange_from_tool: frames of the work and of the tip.
    clear: returns whether joint values (N, J) are free of collisions, (N,).
    hit: names the bodies that collide at joint values (J,), "link 5 with the part".
    measure_apart: returns the largest distance by which a point of arm and tool moves between two
        tables of joint values (N, J), (N,) mm.
    roomy: returns whether joint values (N, J) are clear and keep the margin, (N,).
    """

    robot: Robot
    base_from_work: Pose
    flange_from_tool: Pose
    clear: Callable[[FloatArray], NDArray[np.bool_]] = all_clear
    hit: Callable[[FloatArray], str] = lambda _: "something"
    measure_apart: Callable[[FloatArray, FloatArray], FloatArray] = lambda joints, _: np.zeros(
        len(joints)
    )
    roomy: Callable[[FloatArray], NDArray[np.bool_]] = all_clear


class SampledMotion(Struct, frozen=True, eq=False):
    """A motion at the places where it is examined.

    joints: (D, J) joint values.
    pose_path: pose path of the TCP with a row for each of these; None for a joint motion.
    """

    joints: FloatArray
    pose_path: PosePath | None = None


class Blockage(Struct, frozen=True):
    """The first place where a motion fails.

    kind: whether bodies collide, or the joints cannot follow the pose path.
    what: the reason, "collision, link 5 against part".
    at: the place, in rows of the motion.
    """

    kind: Literal["collision", "jump"]
    what: str
    at: float


class FreeSpace(Struct, frozen=True, eq=False):
    """Free space around the part, base frame.

    level: z above which tool and holder are free, mm.
    low, high: (3,) corners of the part's box, mm.
    holder_distance: distance from that box within which the holder may meet it, mm.
    margin: `cell.margin`, mm.
    look: returns the blockage of each motion, or its clearance, at most `margin`, mm.
    find_blockages: returns the blockage of each motion, or 0. It is quicker than `look`.
    gaps: returns the clearance of joint values (N, J) without a collision, at most `margin`, (N,)
        mm.
    """

    level: float
    low: FloatArray
    high: FloatArray
    holder_distance: float
    margin: float
    look: Callable[[Sequence[SampledMotion]], list[Blockage | float]]
    find_blockages: Callable[[Sequence[SampledMotion]], list[Blockage | float]]
    gaps: Callable[[FloatArray], FloatArray]


class OrientationFreedom(Struct, frozen=True):
    """Orientations that a tool may have besides the nominal one.

    If the roll changes along an arc, the axis may lean by up to 2 deg between two rows.

    tilt: largest angle of its axis to the nominal axis, rad.
    roll: whether it may be rotated about its axis.
    turns: the allowed rolls, rad, in order, 0 among them; None for any.
    """

    tilt: float = 0.0
    roll: bool = False
    turns: tuple[float, ...] | None = None

    def __bool__(self) -> bool:
        return self.tilt > 0 or self.roll


class UnreachableEdge(Struct, frozen=True):
    """An edge that cannot be processed.

    id: id of the edge.
    kind: kind of the reason: its shape, one of `kinematics.reasons`, or a collision.
    text: the reason with its amount and the place along the edge.
    remedy: a setting that would help; empty if none is known.
    """

    id: str
    kind: Literal["shape", "reach", "lean", "limit", "singular", "jump", "collision"]
    text: str
    remedy: str = ""

    @property
    def reason(self) -> str:
        """The reason, with the remedy."""
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

    pose_path: pose path with the rows of the program, N.
    joints: (N, J) joint values at these rows, their posture.
    sampled_path: pose path with a row at each of the D places at which the motion is examined.
    sampled_joints: (D, J) joint values there.
    at: (N,) places of the program's rows among these.
    tilt: (D,) angle between tool z and its nominal direction, rad.
    roll: (D,) rotation about tool z from the nominal orientation, rad.
    backwards: whether the edge is run from its end to its start.
    trimmed: lengths of the edge before the first row and after the last, mm. The second is negative
        for a piece of a closed edge that runs over the start of the edge.
    nearer: the motion that would be preferred without a margin, if this is another one.
    part_of: id of the edge of which this is a piece; empty for a whole edge.
    """

    id: str
    backwards: bool
    pose_path: PosePath
    joints: FloatArray
    sampled_path: PosePath
    sampled_joints: FloatArray
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
        """The motion from its end to its start."""
        return replace(
            self,
            backwards=not self.backwards,
            pose_path=self.pose_path.reversed(),
            joints=frozen(self.joints[::-1]),
            sampled_path=self.sampled_path.reversed(),
            sampled_joints=frozen(self.sampled_joints[::-1]),
            at=len(self.sampled_joints) - 1 - self.at[::-1],
            tilt=frozen(self.tilt[::-1]),
            roll=frozen(self.roll[::-1]),
            trimmed=self.trimmed[::-1],
        )

    @property
    def freed(self) -> tuple[float, float] | None:
        """The largest tilt and roll, deg; None if the tool keeps the nominal orientation."""
        freed = (math.degrees(np.abs(self.tilt).max()), math.degrees(np.abs(self.roll).max()))
        return freed if max(freed) > 1e-6 else None


def compute_feed(motion: EdgeMotion, length: float, process: ProcessTable) -> float:
    """Feed of the TCP, mm/s, with which the contact runs at `process.feed`.

    length: length of the edge, mm.
    """
    return float(compute_tip_feed(compute_feed_factor(motion, length), process))


def compute_tip_feed(factor: FloatArray | float, process: ProcessTable) -> FloatArray:
    """Feed of the TCP, mm/s, for lengths of its path divided by those of the edge."""
    return np.asarray(process.feed * np.minimum(factor, process.max_feed_factor))


def compute_feed_factor(motion: EdgeMotion, length: float) -> float:
    """Length of the path of the TCP divided by that of the edge, `length` mm."""
    return float(motion.pose_path.length.sum()) / length if length > 0 else 1.0


# Poses of the flange, and the places at which a motion is examined.

#: Largest distance and rotation of the TCP between two such places, mm and rad; and the largest
#: rotation of a joint, rad.
_SAMPLE_MM, _SAMPLE_TURN, JUMP = 5.0, math.radians(5), math.radians(15)
#: Smallest distance of a motion from singularities, rad.
MARGIN = math.radians(2)


def count_samples(path: PosePath) -> Index:
    """The number of parts into which each segment of a pose path is divided to be examined."""
    return count_parts(path, _SAMPLE_MM, _SAMPLE_TURN)


def compute_flange_poses(
    setup: Setup, position: FloatArray, rotation: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Rotations (..., 3, 3) and origins (..., 3) of the flange in the base, for poses of the TCP.

    position, rotation: the TCP in the work frame, (..., 3) and (..., 3, 3).
    """
    tool_from_flange = setup.flange_from_tool.inverse()
    turned = setup.base_from_work.rotation @ rotation
    base = position @ setup.base_from_work.rotation.T + np.asarray(setup.base_from_work.origin)
    return turned @ tool_from_flange.rotation, base + turned @ np.asarray(tool_from_flange.origin)
