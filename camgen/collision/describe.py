"""A collision in words: the two bodies, how deep they meet, and the joint values there."""

from __future__ import annotations

import math

import numpy as np

from camgen.collision.boxes import Boxes, least_apart
from camgen.collision.hits import place
from camgen.collision.mesh import find_struck
from camgen.collision.scene import Scene, name_pair
from camgen.model.pose import FloatArray
from camgen.model.text import short
from camgen.robots.models import Robot

#: Halvings of the depth of a box in a mesh.
_HALVINGS = 12


def describe_hit(scene: Scene, joints: FloatArray, pair: int) -> str:
    """The pair of `scene.pairs` that meets at joint values (J,), its depth, and the values."""
    depth = find_depth(scene, joints, pair)
    deep = "their meshes meet" if depth is None else f"{short(depth, 2)} mm deep"
    return f"{name_pair(scene, pair)}, {deep}, at joints {describe_joints(scene.robot, joints)}"


def describe_joints(robot: Robot, joints: FloatArray) -> str:
    """Joint values (J,): '0 90 -12.5 deg', those of sliding joints with their unit."""
    turning = [not joint.sliding for joint in robot.joints]
    values = [
        math.degrees(value) if turns else value
        for value, turns in zip(joints.tolist(), turning, strict=True)
    ]
    if all(turning):
        return f"{' '.join(short(value, 2) for value in values)} deg"
    units = ["deg" if turns else "mm" for turns in turning]
    return ", ".join(f"{short(value, 2)} {unit}" for value, unit in zip(values, units, strict=True))


def find_depth(scene: Scene, joints: FloatArray, pair: int) -> float | None:
    """The shortest shift that parts the boxes of two bodies, mm, None if meshes of links decide.

    The depth of a box in a mesh is the amount by which it must be smaller on all sides.
    """
    if scene.closer[pair] is not None:
        return None
    placed = place(scene, joints[None])
    boxes = Boxes(placed.centres[0], placed.axes[0], placed.half[0])
    tests = np.flatnonzero(scene.of_pair == pair)
    if len(tests):
        distances = least_apart(boxes[scene.first[tests]], boxes[scene.second[tests]])
        return max(-float(distances.min()), 0.0)
    (target,) = [target for target in scene.targets if pair in target.of_strike]
    frame = target.base_from_mesh
    striking = boxes[target.striking[target.of_strike == pair]].seen_from(
        frame.rotation, np.asarray(frame.origin)
    )
    low, high = 0.0, float(striking.half.min())
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        if find_struck(target.mesh, striking.grown(-middle)).any():
            low = middle
        else:
            high = middle
    return low
