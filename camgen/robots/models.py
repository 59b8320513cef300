"""The model of a robot: joints, limits, speeds, and the shapes of its links."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from msgspec import Struct

from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray, Pose, Vec3
from camgen.robots.chain import Joint
from camgen.robots.kinematics.arms import Arm, Gantry, Scara, Spherical
from camgen.robots.kinematics.three_parallel import ThreeParallel

Kind = Literal["spherical-wrist", "three-parallel", "scara", "cartesian", "serial"]
Certainty = Literal["confirmed", "derived", "uncertain"]

_KINDS: dict[type, Kind] = {
    Spherical: "spherical-wrist",
    ThreeParallel: "three-parallel",
    Scara: "scara",
    Gantry: "cartesian",
    type(None): "serial",
}


class Box(Struct, frozen=True, eq=False):
    """A cuboid in the frame of a link.

    link_from_box: its centre and axes.
    half: half its edge lengths, mm.
    """

    link_from_box: Pose
    half: Vec3


class Surface(Struct, frozen=True, eq=False):
    """A surface of triangles.

    vertices: (V, 3) in the frame of the link, mm.
    faces: (F, 3) indices of the corners of each triangle.
    """

    vertices: FloatArray
    faces: IntArray


class Link(Struct, frozen=True, eq=False):
    """A body of an arm.

    boxes: cuboids around it, the first test for collisions.
    surfaces: meshes that decide where boxes meet, and that are shown; none if boxes describe it.
    unread: names of meshes that could not be read.
    """

    name: str
    boxes: tuple[Box, ...]
    surfaces: tuple[Surface, ...] = ()
    unread: tuple[str, ...] = ()


class Trust(Struct, frozen=True, forbid_unknown_fields=True):
    """Certainty of the numbers of a robot."""

    kinematics: Certainty
    limits: Certainty
    speeds: Certainty
    boxes: Certainty


class Robot(Struct, frozen=True, eq=False):
    """A robot of J joints. Joint values (J,) are those of its controller, rad or mm.

    limits: (J, 2) joint limits, finite.
    speeds: (J,) maximum speeds, rad/s or mm/s.
    flange: last_joint_from_flange.
    coupling: (J, J) matrix from the joint values to those of the serial chain.
    serial_limits: (J, 2) limits of the values of the serial chain, infinite for none.
    links: the base, then the link that each joint moves.
    touching: pairs of links, by index, that are not tested against each other.
    pad: distance by which boxes are to be grown, mm.
    home: (J,) joint values.
    arm: closed form of the inverse kinematics, None if it has none.
    held: (J,) speeds to which a job limits the joints, None for `speeds`.
    accelerations: (J,) rad/s2 or mm/s2, None if the job states none.
    """

    name: str
    maker: str
    controller: str
    convention: str
    joints: tuple[Joint, ...]
    limits: FloatArray
    speeds: FloatArray
    flange: Pose
    coupling: FloatArray
    serial_limits: FloatArray
    links: tuple[Link, ...]
    touching: tuple[tuple[int, int], ...]
    pad: float
    home: FloatArray
    trust: Trust
    notes: tuple[str, ...]
    sources: tuple[str, ...]
    arm: Arm | None
    held: FloatArray | None = None
    accelerations: FloatArray | None = None

    @property
    def fastest(self) -> FloatArray:
        """(J,) maximum speeds of the joints in the job."""
        return self.speeds if self.held is None else self.held

    @property
    def revolute(self) -> BoolArray:
        """(J,) whether each joint is revolute; others slide."""
        return np.array([not joint.sliding for joint in self.joints])

    @property
    def kind(self) -> Kind:
        """The kind of its closed form; serial for none."""
        return _KINDS[type(self.arm)]

    @property
    def lever(self) -> float:
        """Length that weighs as much as a radian, mm: half the length of the chain.

        It is the mean lever of its joints.
        """
        lengths = (math.hypot(*joint.previous_from_joint.origin) for joint in self.joints)
        return max(sum(lengths) / 2, 1.0)
