"""Collisions by a plain loop over fcl, without a filter before it: a judge of camgen's verdicts.

The loop shares nothing with camgen but the frames of the links. A box is in the part if the solid
angles of all triangles, seen from its middle, add up to a sphere.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import fcl
import numpy as np

from camgen.model.part import Solid
from camgen.model.pose import FloatArray, Pose
from camgen.robots.kinematics.forward import compute_flange, compute_link_frames
from camgen.robots.models import Box, Link, Robot


def compute_solid_angle(triangles: FloatArray, point: FloatArray) -> float:
    """The solid angle of a surface from a point, in spheres (van Oosterom, Strackee, 1983)."""
    a, b, c = (triangles - point).transpose(1, 0, 2)
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    product = la * lb * lc + (a * b).sum(axis=1) * lc
    product += (b * c).sum(axis=1) * la + (c * a).sum(axis=1) * lb
    return float(np.arctan2(volume, product).sum() / (2 * math.pi))


class Body(NamedTuple):
    """A body that fcl tests.

    shape: object of fcl.
    middle: middle of a sphere around it, base frame, mm.
    radius: radius of that sphere, mm.
    """

    shape: Any
    middle: tuple[float, float, float]
    radius: float


class Setting(NamedTuple):
    """The bodies beside an arm.

    solid: the part.
    base_from_part: its pose.
    standing: bodies that do not move, base frame.
    tool: bodies at the flange. The first one works on the part.
    contact: depth by which that one may enter the part, mm.
    allowed: pairs of link and tool that are not tested.
    """

    solid: Solid
    base_from_part: Pose
    standing: tuple[Link, ...]
    tool: tuple[Link, ...]
    contact: float
    allowed: tuple[tuple[str, str], ...] = ()


#: Two names, and the bodies of each.
Pair = tuple[str, str, list[Body], list[Body]]


class Loop:
    """The plain loop of an arm in its setting."""

    def __init__(self, robot: Robot, setting: Setting) -> None:
        self.robot, self.setting = robot, setting
        self.allowed = {frozenset(pair) for pair in setting.allowed}
        solid, pose = setting.solid, setting.base_from_part
        self.triangles = solid.vertices[solid.faces]
        self.low, self.high = solid.vertices.min(axis=0), solid.vertices.max(axis=0)
        model = fcl.BVHModel()
        model.beginModel(len(solid.vertices), len(solid.faces))
        model.addSubModel(np.asarray(solid.vertices), np.asarray(solid.faces))
        model.endModel()
        mesh = fcl.CollisionObject(model, _convert_pose(pose.rotation, pose.origin))
        radius = float(np.linalg.norm(self.high - self.low)) / 2
        self.mesh = Body(mesh, pose.apply((self.low + self.high) / 2), radius)
        self.standing = []
        for link in setting.standing:
            self.standing.append((link.name, _place_boxes(link.boxes, np.eye(3), np.zeros(3))))

    def _is_in_part(self, box: Body) -> bool:
        middle = self.setting.base_from_part.inverse().apply(box.middle)
        if (middle < self.low).any() or (middle > self.high).any():
            return False
        return compute_solid_angle(self.triangles, np.array(middle)) > 0.5

    def _meet(self, bodies: list[Body], others: list[Body]) -> bool:
        for a, b in itertools.product(bodies, others):
            if fcl.collide(a.shape, b.shape, fcl.CollisionRequest(), fcl.CollisionResult()):
                return True
        return others == [self.mesh] and any(map(self._is_in_part, bodies))

    def _list_pairs(self, joints: FloatArray) -> Iterator[Pair]:
        """All pairs that are tested at joint values (J,)."""
        robot, last = self.robot, len(self.robot.joints)
        rotations, origins = compute_link_frames(robot, joints[None])
        flange = [frame[0] for frame in compute_flange(robot, joints[None])]
        spared = {frozenset(pair) for pair in robot.touching}
        names = [link.name for link in robot.links]
        padded, meeting = [], []
        for k, link in enumerate(robot.links):
            frame = rotations[0, k], origins[0, k]
            padded.append(_place_boxes(link.boxes, *frame, robot.pad))
            # Links that touch the last one meet the tool without padding.
            is_bare = frozenset((k, last)) in spared
            meeting.append(_place_boxes(link.boxes, *frame) if is_bare else padded[k])
        for i, j in itertools.combinations(range(last + 1), 2):
            if frozenset((i, j)) not in spared:
                yield names[i], names[j], padded[i], padded[j]
        tools, working = [], []
        for k, body in enumerate(self.setting.tool):
            less = 0.0 if k else -self.setting.contact
            tools.append((body.name, _place_boxes(body.boxes, *flange)))
            working.append((body.name, _place_boxes(body.boxes, *flange, less)))
        for (name, boxes), k in itertools.product(tools, range(last)):
            if frozenset((names[k], name)) not in self.allowed:
                yield names[k], name, meeting[k], boxes
        moving = list(zip(names, padded, strict=True))[1:]
        for (name, boxes), (other, obstacle) in itertools.product(moving + tools, self.standing):
            yield name, other, boxes, obstacle
        for name, boxes in moving + working:
            yield name, "part", boxes, [self.mesh]

    def find_hit(self, joints: FloatArray) -> tuple[str, str] | None:
        """The names of the first pair that meets at joint values (J,); None without one."""
        for name, other, bodies, others in self._list_pairs(joints):
            if self._meet(bodies, others):
                return name, other
        return None

    def measure_clearance(self, joints: FloatArray, least: float = math.inf) -> float:
        """The clearance of all pairs but tool and part, mm, at joint values (J,) without a hit.

        least: limit of the result, mm, for instance the clearance of other joint values.
        """
        for name, other, bodies, others in self._list_pairs(joints):
            if (name, other) == ("tool", "part"):
                continue
            for a, b in itertools.product(bodies, others):
                # Spheres that are farther apart need no measurement.
                if math.dist(a.middle, b.middle) - a.radius - b.radius < least:
                    request, result = fcl.DistanceRequest(), fcl.DistanceResult()
                    least = min(least, float(fcl.distance(a.shape, b.shape, request, result)))
        return least


def _convert_pose(rotation: FloatArray, origin: Any) -> Any:
    return fcl.Transform(np.asarray(rotation), np.asarray(origin))


def _place_boxes(
    boxes: Iterable[Box], rotation: FloatArray, origin: FloatArray, padding: float = 0.0
) -> list[Body]:
    """Boxes of a frame, larger by the padding on all sides, mm."""
    bodies = []
    for box in boxes:
        middle = origin + rotation @ np.asarray(box.link_from_box.origin)
        half = [half + padding for half in box.half]
        pose = _convert_pose(rotation @ box.link_from_box.rotation, middle)
        shape = fcl.CollisionObject(fcl.Box(*(2 * side for side in half)), pose)
        bodies.append(Body(shape, tuple(middle.tolist()), math.hypot(*half)))
    return bodies
