"""Describes a collision: the two bodies, their depth in each other, and the joint values."""

from __future__ import annotations

import numpy as np

from camgen.collision.boxes import Boxes, bound_distances
from camgen.collision.hits import place_boxes
from camgen.collision.mesh import find_struck
from camgen.collision.scene import Scene, name_pair
from camgen.model.pose import FloatArray
from camgen.model.text import short
from camgen.robots.models import Robot

#: Halvings of the depth of a box in a mesh.
_HALVINGS = 12


def describe_hit(scene: Scene, joints: FloatArray, pair: int) -> str:
    """The bodies of a pair that meets at joint values (J,), its depth, and the joint values.

    pair: index in `scene.pairs`.
    """
    depth = find_depth(scene, joints, pair)
    deep = "their meshes meet" if depth is None else f"{short(depth, 2)} mm deep"
    return f"{name_pair(scene, pair)}, {deep}, at joints {describe_joints(scene.robot, joints)}"


def describe_joints(robot: Robot, joints: FloatArray) -> str:
    """Joint values (J,): '0 90 -12.5 deg', those of sliding joints with their unit."""
    values = np.where(robot.revolute, np.degrees(joints), joints)
    texts = [short(value, 2) for value in values.tolist()]
    if robot.revolute.all():
        return f"{' '.join(texts)} deg"
    units = np.where(robot.revolute, "deg", "mm")
    return ", ".join(map(" ".join, zip(texts, units, strict=True)))


def find_depth(scene: Scene, joints: FloatArray, pair: int) -> float | None:
    """The shortest shift that separates the boxes of a pair, mm; None if meshes of links decide.

    The depth of a box in a mesh is the distance by which it must be smaller on all sides.
    """
    if scene.closer[pair] is not None:
        return None
    placed = place_boxes(scene, joints[None])
    boxes = Boxes(placed.centres[0], placed.axes[0], placed.half[0])
    tests = np.flatnonzero(scene.of_pair == pair)
    if len(tests):
        distances = bound_distances(boxes[scene.first[tests]], boxes[scene.second[tests]])
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
