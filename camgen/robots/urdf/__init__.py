"""Makes a robot from a URDF file: `cell.robot = "arm.urdf"`."""

from __future__ import annotations

import itertools
import math
import re
from pathlib import Path

import numpy as np
from msgspec.structs import replace

from camgen.model.errors import InputError
from camgen.model.limits import format_limit
from camgen.model.pose import FloatArray, frozen
from camgen.model.text import counted
from camgen.model.tolerance import PARALLEL_EDGES
from camgen.read.files import Files
from camgen.robots.kinematics.arms import recognise_arm
from camgen.robots.kinematics.forward import compute_jacobian, compute_link_frames
from camgen.robots.kinematics.joint_limits import list_turn_counts
from camgen.robots.models import Box, Link, Robot, Surface, Trust
from camgen.robots.urdf.boxes import Shapes, is_own_hull, place_points, read_shapes
from camgen.robots.urdf.chain import JointChain, find_limits, make_chain
from camgen.robots.urdf.xml import Description, read_description

#: mm by which boxes are grown, the same as for built-in robots.
_PAD = 5.0
#: Maximum sum of the lengths of all links, mm. The longest industrial arms reach 5 m.
_LONGEST_MM = 20_000.0
#: mm: an upper arm that leans by no more is upright.
_STRAIGHT_MM = 1e-3
#: Maximum number of combinations of turn counts. Seven joints of +-360 deg have 3 ** 7.
_TURNS = 2187
#: rad by which joints are bent for a home in which the arm is not stretched.
_BEND = math.radians(30)
#: Smallest singular value of the Jacobian that is enough at home.
_MIN_SINGULAR_VALUE = 0.05


def read_urdf(file: str, tip: str, files: Files) -> Robot:
    """The arm that a URDF file describes, from its base to a tip.

    tip: name of the link at the tip; empty for the flange.

    Raises InputError with the link or joint that is wrong, or that camgen cannot move.
    """
    described = read_description(Path(file), files)
    chain = make_chain(described, tip)
    count, limit = len(chain.joints), files.limits.urdf_joints
    if count > limit:
        raise InputError(
            file,
            f"has {count} joints between {chain.base} and {chain.tip}, "
            f"{format_limit(limit)} at most",
            remedy="name a nearer tip, FILE.urdf#LINK, or raise limits.urdf_joints",
        )
    _check_metres(file, chain)
    links, notes = _make_links(described, chain, files)
    arm = _make_robot(described, chain, links, notes)
    if len(list_turn_counts(arm)) > _TURNS:
        raise InputError(
            file,
            "its joints can make too many whole turns",
            "limits",
            "narrow the limits of some: half of the stated range is enough for most paths",
        )
    arm = replace(arm, home=_find_home(arm))
    if _is_abb(arm):
        note = "its name and axes are those of an ABB arm: confdata follow from its joint values"
        return replace(arm, maker="ABB", controller="IRC5 (RAPID)", notes=(*arm.notes, note))
    return arm


#: Names of arms of ABB at ROS-Industrial and elsewhere. Arms with a parallel rod are left out,
#: because their controller has another joint 3.
_ABB_NAME = re.compile(
    r"(?:abb[ _-]?)?irb[ _-]?(?!1400|1410|2400|4400|640|660|760)\d", re.IGNORECASE
)
#: Axes of serial arms of ABB at zero, with the upper arm upright, in the frame of the base.
_ABB_AXES = ((0, 0, 1), (0, 1, 0), (0, 1, 0), (1, 0, 0), (0, 1, 0), (1, 0, 0))


def _is_abb(robot: Robot) -> bool:
    """Whether the name is that of an ABB arm, with the zeros and signs of its controller."""
    if len(robot.joints) != len(_ABB_AXES) or not _ABB_NAME.match(robot.name):
        return False
    rotations, origins = (
        table[0] for table in compute_link_frames(robot, np.zeros((1, len(_ABB_AXES))))
    )
    axes = [
        turn @ np.asarray(joint.axis)
        for turn, joint in zip(rotations[1:], robot.joints, strict=True)
    ]
    if not np.allclose(axes, _ABB_AXES, atol=PARALLEL_EDGES):
        return False
    upright, ahead = origins[3] - origins[2], origins[5] - origins[3]
    return bool(np.hypot(*upright[:2]) < _STRAIGHT_MM and upright[2] > 0 and ahead[0] > 0)


def _check_metres(file: str, chain: JointChain) -> None:
    """Raise InputError if links are longer than those of any arm: lengths in URDF are in m."""
    shifts = [*(joint.previous_from_joint for joint in chain.joints), chain.flange]
    length = sum(math.hypot(*shift.origin) for shift in shifts)
    if length > _LONGEST_MM:
        raise InputError(
            file,
            f"is an arm of {length / 1000:.0f} m; lengths in mm, where URDF has metres?",
            "origin",
            "divide its lengths by 1000",
        )


def _make_links(
    described: Description, chain: JointChain, files: Files
) -> tuple[tuple[Link, ...], list[str]]:
    """The links of the chain with their shapes, and notes on missing shapes."""
    links: list[Link] = []
    notes: list[str] = []
    names = [chain.base, *(joint.child for joint in chain.raw)]
    for name, body in zip(names, chain.bodies, strict=True):
        boxes: list[Box] = []
        surfaces: list[Surface] = []
        unread: list[str] = []
        is_whole = True
        for part, body_from_part in body.items():
            shapes = _choose_shapes(described, part, files)
            boxes += [Box(body_from_part @ box.link_from_box, box.half) for box in shapes.boxes()]
            surfaces += [
                Surface(place_points(body_from_part, surface.vertices), surface.faces)
                for surface in shapes.surfaces
            ]
            unread += shapes.unread
            notes += shapes.notes
            is_whole &= not shapes.unread and len(shapes.surfaces) == len(shapes.parts)
        # Without one of its shapes the meshes of a link would have a gap.
        links.append(Link(name, tuple(boxes), tuple(surfaces) if is_whole else (), tuple(unread)))
    return tuple(links), notes


def _choose_shapes(described: Description, part: str, files: Files) -> Shapes:
    """The shapes of a link for collision tests.

    A convex shape is often the hull of its link, which fills the fork of a wrist. Then the visible
    shapes are used, if all of them can be read.
    """
    folder = Path(described.file).parent
    shapes = read_shapes(part, described.links[part], folder, files)
    visible = described.visible[part]
    if visible and visible != described.links[part] and any(map(is_own_hull, shapes.surfaces)):
        visible_shapes = read_shapes(part, visible, folder, files)
        if not visible_shapes.notes:
            return visible_shapes
    return shapes


def _make_robot(
    described: Description, chain: JointChain, links: tuple[Link, ...], notes: list[str]
) -> Robot:
    """The robot, its home at the middle of the limits."""
    limits = frozen([find_limits(joint) for joint in chain.raw])
    count = len(chain.joints)
    all_notes = [*chain.notes, *notes]
    if described.rounded:
        angles = counted(described.rounded, "rounded angle")
        all_notes.append(f"{angles} in the URDF: multiples of 90 deg are assumed")
    return Robot(
        name=described.name,
        maker="",
        controller="",
        convention=f"The joints of the URDF, from link {chain.base} to link {chain.tip}.",
        joints=chain.joints,
        limits=limits,
        speeds=frozen([joint.velocity for joint in chain.raw]),
        flange=chain.flange,
        coupling=frozen(np.eye(count)),
        serial_limits=frozen(np.tile([-math.inf, math.inf], (count, 1))),
        links=links,
        touching=tuple((k, k + 1) for k in range(count)),
        pad=_PAD,
        home=frozen(limits.mean(axis=1)),
        trust=Trust("uncertain", "uncertain", "uncertain", "uncertain"),
        notes=tuple(all_notes),
        sources=(Path(described.file).name,),
        arm=recognise_arm(chain.joints, chain.flange),
    )


def _find_home(robot: Robot) -> FloatArray:
    """Joint values (J,) at which the arm is not stretched.

    They are 0, or the middle of limits that do not contain 0, if that is far enough from
    singularities. Otherwise as few joints as possible are bent by 30 deg.
    """
    low, high = robot.limits.T
    rest = np.where((low < 0) & (high > 0) & robot.revolute, 0.0, (low + high) / 2)
    best, best_value = rest, -1.0
    for count in range(min(int(robot.revolute.sum()), 2) + 1):
        homes = rest + _list_bends(robot, count)
        homes = homes[((low <= homes) & (homes <= high)).all(axis=1)]
        # The first of equal values is chosen.
        values = _measure_singular_values(robot, homes).round(9)
        if values.max(initial=-1.0) > best_value:
            best, best_value = homes[values.argmax()], float(values.max())
        if best_value >= _MIN_SINGULAR_VALUE:
            break
    return frozen(best)


def _list_bends(robot: Robot, count: int) -> FloatArray:
    """Changes (B, J) of joint values that bend each choice of `count` joints to either side."""
    bends = []
    for chosen in itertools.combinations(np.flatnonzero(robot.revolute), count):
        for signs in itertools.product((1.0, -1.0), repeat=count):
            bend = np.zeros(len(robot.joints))
            bend[list(chosen)] = signs
            bends.append(bend)
    return _BEND * np.array(bends)


def _measure_singular_values(robot: Robot, joints: FloatArray) -> FloatArray:
    """The smallest singular value of the Jacobian at joint values (N, J), (N,).

    Lengths are divided by the mean lever of the arm, also those of slides.
    """
    moved, _, _ = compute_jacobian(robot, joints)
    moved[:, :3] /= robot.lever
    moved[:, :, ~robot.revolute] *= robot.lever
    return np.asarray(np.linalg.svd(moved, compute_uv=False)[:, -1])
