"""What a robot is: joints, limits, speeds, and the boxes of its links."""

from __future__ import annotations

import math
from typing import Literal

from msgspec import Struct

from camgen.model.part import IntArray
from camgen.model.pose import FloatArray, Pose, Vec3
from camgen.robots.chain import Joint
from camgen.robots.kinematics.arms import Arm, Gantry, Scara, Spherical
from camgen.robots.kinematics.three_parallel import ThreeParallel

Kind = Literal["spherical-wrist", "three-parallel", "scara", "cartesian", "serial"]
Known = Literal["confirmed", "derived", "uncertain"]
Triple = tuple[float, float, float]

_KINDS: dict[type, Kind] = {
    Spherical: "spherical-wrist",
    ThreeParallel: "three-parallel",
    Scara: "scara",
    Gantry: "cartesian",
    type(None): "serial",
}


class Box(Struct, frozen=True, eq=False):
    """A cuboid. link_from_box: its centre and axes. half: half its edge lengths, mm."""

    link_from_box: Pose
    half: Vec3


class Surface(Struct, frozen=True, eq=False):
    """Triangles: vertices (V, 3), mm, in the frame of the link; faces (F, 3)."""

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
    """How well a robot's numbers are known."""

    kinematics: Known
    limits: Known
    speeds: Known
    boxes: Known


class Robot(Struct, frozen=True, eq=False):
    """A robot. Joint values (J,) are the controller's: rad, mm for slides.

    limits: (J, 2), finite. speeds: (J,), rad/s or mm/s. flange: last_joint_from_flange. coupling: (J, J), takes the
    controller's values to the turns of the serial chain; serial_limits: (J, 2) of those, infinite where a joint has
    none. links: base first, then the link that each joint moves. touching: pairs of links not tested against each
    other. pad: mm to grow boxes by. home: (J,). arm: the closed form of its joints, or None. held: (J,) speeds to which
    a job holds the joints, None: their own. accelerations: (J,), rad/s2 or mm/s2, None where the job says none.
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
        """(J,) what its joints may run at in the job."""
        return self.speeds if self.held is None else self.held

    @property
    def kind(self) -> Kind:
        """Which closed form it has; serial: none."""
        return _KINDS[type(self.arm)]

    @property
    def lever(self) -> float:
        """Millimetres that weigh as much as a radian: half the length of the chain, the mean lever of its joints."""
        return max(
            sum(math.hypot(*joint.previous_from_joint.origin) for joint in self.joints) / 2, 1.0
        )
