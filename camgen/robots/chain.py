"""The chain of joints of a robot."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.model.pose import FloatArray, Pose, Vec3, frozen


class Joint(Struct, frozen=True, eq=False):
    """One joint.

    sliding: whether it is prismatic, otherwise it is revolute.
    previous_from_joint: its frame in that of the joint before it, at value 0.
    axis: unit vector in its own frame, about which it turns or along which it slides.
    """

    name: str
    sliding: bool
    previous_from_joint: Pose
    axis: Vec3


class AtZero(Struct, frozen=True, eq=False):
    """The chain with every joint at 0, in the base frame.

    points: (J, 3) a point on each axis, mm.
    directions: (J, 3) directions of the axes.
    """

    points: FloatArray
    directions: FloatArray
    base_from_flange: Pose


def make_zero_chain(joints: tuple[Joint, ...], flange: Pose) -> AtZero:
    """The chain with every joint at 0. flange: last_joint_from_flange."""
    base_from_joint = Pose(frozen(np.eye(3)), (0.0, 0.0, 0.0))
    points, directions = [], []
    for joint in joints:
        base_from_joint = base_from_joint @ joint.previous_from_joint
        points.append(base_from_joint.origin)
        directions.append(base_from_joint.rotation @ np.asarray(joint.axis))
    return AtZero(frozen(points), frozen(directions), base_from_joint @ flange)
