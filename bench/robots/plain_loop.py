"""Collisions by a plain loop over fcl, with no filter before it: what camgen's verdicts are held against.

It has nothing of camgen but the links' frames, and takes the sum of the solid angles of all triangles for whether a box
is in the part.
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


def solid_angle(triangles: FloatArray, point: FloatArray) -> float:
    """Of a surface seen from a point, in whole spheres (van Oosterom, Strackee, 1983)."""
    a, b, c = (triangles - point).transpose(1, 0, 2)
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    over = np.einsum("ij,ij->i", a, np.cross(b, c))
    under = (
        la * lb * lc
        + (a * b).sum(axis=1) * lc
        + (b * c).sum(axis=1) * la
        + (c * a).sum(axis=1) * lb
    )
    return float(np.arctan2(over, under).sum() / (2 * math.pi))


class Body(NamedTuple):
    """What fcl tests, and a sphere around it: its middle in the frame of the base, and its radius, mm."""

    shape: Any
    middle: tuple[float, float, float]
    radius: float


class Loop:
    """The plain loop. standing: base_from_box. tool: bodies at the flange. contact: mm that the first of them may enter
    the part.
    """

    def __init__(
        self,
        of: Robot,
        solid: Solid,
        base_from_part: Pose,
        standing: tuple[Link, ...],
        tool: tuple[Link, ...],
        contact: float,
        allowed: tuple[tuple[str, str], ...] = (),
    ) -> None:
        self.of, self.base_from_part = of, base_from_part
        self.tool, self.contact, self.allowed = tool, contact, {frozenset(pair) for pair in allowed}
        self.triangles = solid.vertices[solid.faces]
        self.low, self.high = solid.vertices.min(axis=0), solid.vertices.max(axis=0)
        model = fcl.BVHModel()
        model.beginModel(len(solid.vertices), len(solid.faces))
        model.addSubModel(np.asarray(solid.vertices), np.asarray(solid.faces))
        model.endModel()
        mesh = fcl.CollisionObject(
            model, self._transform(base_from_part.rotation, base_from_part.origin)
        )
        middle, radius = (
            base_from_part.apply((self.low + self.high) / 2),
            np.linalg.norm(self.high - self.low) / 2,
        )
        self.mesh = Body(mesh, middle, float(radius))
        self.standing = [
            (body.name, self._bodies(body.boxes, np.eye(3), np.zeros(3), 0.0)) for body in standing
        ]

    @staticmethod
    def _transform(rotation: FloatArray, origin: Any) -> Any:
        return fcl.Transform(np.asarray(rotation), np.asarray(origin))

    def _bodies(
        self, boxes: Iterable[Box], rotation: FloatArray, origin: FloatArray, by: float
    ) -> list[Body]:
        made = []
        for box in boxes:
            at = origin + rotation @ np.asarray(box.link_from_box.origin)
            half = [half + by for half in box.half]
            turned = rotation @ box.link_from_box.rotation
            shape = fcl.CollisionObject(
                fcl.Box(*(2 * h for h in half)), self._transform(turned, at)
            )
            made.append(Body(shape, tuple(at.tolist()), math.hypot(*half)))
        return made

    def _in_part(self, box: Body) -> bool:
        at = self.base_from_part.inverse().apply(box.middle)
        if (at < self.low).any() or (at > self.high).any():
            return False
        return solid_angle(self.triangles, np.array(at)) > 0.5

    def _met(self, ones: list[Body], others: list[Body]) -> bool:
        return any(
            fcl.collide(a.shape, b.shape, fcl.CollisionRequest(), fcl.CollisionResult())
            for a in ones
            for b in others
        ) or (others == [self.mesh] and any(self._in_part(a) for a in ones))

    def _pairs(self, joints: FloatArray) -> Iterator[tuple[str, str, list[Body], list[Body]]]:
        """All pairs that are tested at one configuration (J,): their names and their bodies."""
        of, last = self.of, len(self.of.joints)
        rotations, origins = compute_link_frames(of, joints[None])
        tip = compute_flange(of, joints[None])
        spared = {frozenset(pair) for pair in of.touching}
        placed = list(zip(of.links, rotations[0], origins[0], strict=True))
        padded = [self._bodies(k.boxes, r, o, of.pad) for k, r, o in placed]
        # Links that touch the last one meet the tool without padding.
        meeting = [
            self._bodies(k.boxes, r, o, 0.0) if frozenset((i, last)) in spared else padded[i]
            for i, (k, r, o) in enumerate(placed)
        ]
        names = [link.name for link in of.links]
        for i, j in itertools.combinations(range(last + 1), 2):
            if frozenset((i, j)) not in spared:
                yield names[i], names[j], padded[i], padded[j]
        tools = [
            (body.name, self._bodies(body.boxes, tip[0][0], tip[1][0], 0.0)) for body in self.tool
        ]
        working = [
            (body.name, self._bodies(body.boxes, tip[0][0], tip[1][0], -self.contact))
            for body in self.tool[:1]
        ]
        for (name, boxes), i in itertools.product(tools, range(last)):
            if frozenset((names[i], name)) not in self.allowed:
                yield names[i], name, meeting[i], boxes
        moving = list(zip(names, padded, strict=True))[1:]
        for (name, boxes), (other, obstacle) in itertools.product(moving + tools, self.standing):
            yield name, other, boxes, obstacle
        for name, boxes in moving + working + tools[1:]:
            yield name, "part", boxes, [self.mesh]

    def first(self, joints: FloatArray) -> tuple[str, str] | None:
        """The first pair of names that meets at one configuration (J,)."""
        return next(
            ((a, b) for a, b, ones, others in self._pairs(joints) if self._met(ones, others)), None
        )

    def gap(self, joints: FloatArray, least: float = math.inf) -> float:
        """The least distance, mm, of all pairs but the tool and the part at one configuration (J,) without a hit.

        least: mm, from other configurations; it is the answer where nothing is nearer.
        """
        for name, other, ones, others in self._pairs(joints):
            for a, b in itertools.product(ones, others):
                # What is farther by the spheres around both need not be measured.
                near = math.dist(a.middle, b.middle) - a.radius - b.radius < least
                if near and (name, other) != ("tool", "part"):
                    least = min(
                        least,
                        float(
                            fcl.distance(
                                a.shape, b.shape, fcl.DistanceRequest(), fcl.DistanceResult()
                            )
                        ),
                    )
        return least
