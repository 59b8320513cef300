"""The chain of joints that a robot is."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.model.pose import FloatArray, Pose, Vec3, frozen


class Joint(Struct, frozen=True, eq=False):
    """One joint. previous_from_joint: its place in the frame before it, at 0. axis: unit vector in its own frame, about
    which it turns or along which it slides.
    """

    name: str
    sliding: bool
    previous_from_joint: Pose
    axis: Vec3


class AtZero(Struct, frozen=True, eq=False):
    """The chain with every joint at 0, in the base frame: a point on each axis (J, 3), mm, the axes' directions (J, 3)
    and base_from_flange.
    """

    points: FloatArray
    directions: FloatArray
    base_from_flange: Pose


def at_zero(joints: tuple[Joint, ...], flange: Pose) -> AtZero:
    """Where the axes are when every joint stands at 0. flange: last_joint_from_flange."""
    base_from_joint = Pose(frozen(np.eye(3)), (0.0, 0.0, 0.0))
    points, directions = [], []
    for joint in joints:
        base_from_joint = base_from_joint @ joint.previous_from_joint
        points.append(base_from_joint.origin)
        directions.append(base_from_joint.rotation @ np.asarray(joint.axis))
    return AtZero(frozen(points), frozen(directions), base_from_joint @ flange)
