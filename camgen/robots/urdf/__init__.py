"""An arm from a URDF file: ``cell.robot = "arm.urdf"``."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from camgen.model.errors import InputError
from camgen.model.limits import tell
from camgen.model.pose import FloatArray, frozen
from camgen.model.text import counted
from camgen.model.tolerance import PARALLEL_EDGES
from camgen.read.files import Files
from camgen.robots.kinematics.arms import recognise
from camgen.robots.kinematics.forward import frames, jacobian
from camgen.robots.kinematics.joint_limits import turns
from camgen.robots.models import Box, Link, Robot, Surface, Trust
from camgen.robots.urdf.boxes import Shapes, is_own_hull, place_points, shapes_of
from camgen.robots.urdf.chain import JointChain, chain_of, limits_of
from camgen.robots.urdf.xml import Description, read_description

#: mm by which boxes are grown, as those of the built-in robots.
_PAD = 5.0
#: Sum of the lengths of all links, mm. The longest industrial arms reach 5 m.
_LONGEST_MM = 20_000.0
#: mm: an upper arm that leans by no more is upright.
_STRAIGHT_MM = 1e-3
#: Whole turns of all joints together that are looked at: seven joints of +-360 deg have 3 to the power of 7.
_TURNS = 2187
#: rad: joints are bent by so much for a home where the arm is not stretched. Least singular value that is enough there.
_BEND, _CLEAR_OF_SINGULAR = math.radians(30), 0.05


def read_urdf(file: str, tip: str, files: Files) -> Robot:
    """The arm that the URDF ``file`` describes, from its base to the link ``tip``, "": to its flange.

    InputError with the link or joint that is wrong, or that camgen cannot move.
    """
    described = read_description(Path(file), files)
    chain = chain_of(described, tip)
    most = files.limits.urdf_joints
    if len(chain.joints) > most:
        what = f"has {len(chain.joints)} joints between {chain.base} and {chain.tip}, {tell(most)} at most"
        raise InputError(
            file, what, remedy="name a nearer tip, FILE.urdf#LINK, or raise limits.urdf_joints"
        )
    _insist_on_metres(file, chain)
    links, notes = _links(described, chain, files)
    arm = _bare(described, chain, links, notes)
    if len(turns(arm)) > _TURNS:
        remedy = "narrow the limits of some: half of what is stated is enough for most paths"
        raise InputError(file, "its joints can make too many whole turns", "limits", remedy)
    arm = replace(arm, home=_home(arm))
    return (
        replace(arm, maker=_ABB, controller=_RAPID, notes=(*arm.notes, _ABB_NOTE))
        if _is_abb(arm)
        else arm
    )


_ABB, _RAPID = "ABB", "IRC5 (RAPID)"
_ABB_NOTE = "its name and axes are those of an ABB arm: confdata count by its joint values"
#: The names of ABB's arms at ROS-Industrial and elsewhere. Arms with a parallel rod are left out:
#: their controller has another joint 3.
_ABB_NAME = re.compile(
    r"(?:abb[ _-]?)?irb[ _-]?(?!1400|1410|2400|4400|640|660|760)\d", re.IGNORECASE
)
#: The axes of ABB's serial arms at zero, upper arm upright, in the frame of the base.
_ABB_AXES = ((0, 0, 1), (0, 1, 0), (0, 1, 0), (1, 0, 0), (0, 1, 0), (1, 0, 0))


def _is_abb(robot: Robot) -> bool:
    """Whether the name is an ABB arm's, and zeros and signs of its joints are the controller's."""
    if len(robot.joints) != len(_ABB_AXES) or not _ABB_NAME.match(robot.name):
        return False
    rotations, origins = (table[0] for table in frames(robot, np.zeros((1, len(_ABB_AXES)))))
    axes = [
        turn @ np.asarray(joint.axis)
        for turn, joint in zip(rotations[1:], robot.joints, strict=True)
    ]
    if not np.allclose(axes, _ABB_AXES, atol=PARALLEL_EDGES):
        return False
    upright, ahead = origins[3] - origins[2], origins[5] - origins[3]
    return bool(np.hypot(*upright[:2]) < _STRAIGHT_MM and upright[2] > 0 and ahead[0] > 0)


def _insist_on_metres(file: str, chain: JointChain) -> None:
    """InputError for an arm whose links are longer than those of any arm: URDF has metres."""
    shifts = [*(joint.previous_from_joint for joint in chain.joints), chain.flange]
    length = sum(math.hypot(*shift.origin) for shift in shifts)
    if length > _LONGEST_MM:
        what = f"is an arm of {length / 1000:.0f} m; lengths in mm, where URDF has metres?"
        raise InputError(file, what, "origin", "divide its lengths by 1000")


def _links(
    described: Description, chain: JointChain, files: Files
) -> tuple[tuple[Link, ...], list[str]]:
    """What moves together, with its boxes, and notes on what has none."""
    links: list[Link] = []
    notes: list[str] = []
    names = [chain.base, *(joint.child for joint in chain.raw)]
    for name, body in zip(names, chain.bodies, strict=True):
        boxes: list[Box] = []
        surfaces: list[Surface] = []
        unread: list[str] = []
        whole = True
        for part, body_from_part in body.items():
            shapes = _shapes(described, part, files)
            boxes += [Box(body_from_part @ box.link_from_box, box.half) for box in shapes.boxes()]
            surfaces += [
                Surface(place_points(body_from_part, surface.vertices), surface.faces)
                for surface in shapes.surfaces
            ]
            unread += shapes.unread
            notes += shapes.notes
            whole = whole and shapes.whole
        # Meshes that leave a shape out would be a link with a gap.
        links.append(Link(name, tuple(boxes), tuple(surfaces) if whole else (), tuple(unread)))
    return tuple(links), notes


def _shapes(described: Description, part: str, files: Files) -> Shapes:
    """The shapes of a link for collisions.

    A convex one is often the hull of its link, which fills the fork of a wrist. Then the visible
    shapes count, if all of them can be read.
    """
    folder = Path(described.file).parent
    shapes = shapes_of(part, described.links[part], folder, files)
    visible = described.visible[part]
    if visible and visible != described.links[part] and any(map(is_own_hull, shapes.surfaces)):
        visible_shapes = shapes_of(part, visible, folder, files)
        if not visible_shapes.notes:
            return visible_shapes
    return shapes


def _bare(
    described: Description, chain: JointChain, links: tuple[Link, ...], notes: list[str]
) -> Robot:
    """The robot, its home at the middle of the limits."""
    limits = frozen([limits_of(joint) for joint in chain.raw])
    count = len(chain.joints)
    said = [*chain.notes, *notes]
    if described.rounded:
        one = "angle was taken as the multiple of 90 deg that it is rounded from"
        many = "angles were taken as the multiples of 90 deg that they are rounded from"
        said.append(counted(described.rounded, one, many))
    return Robot(
        name=described.name,
        maker="",
        controller="",
        convention=f"The joints of the URDF, from link {chain.base} to link {chain.tip}.",
        joints=chain.joints,
        limits=limits,
        speeds=frozen([joint.limit.velocity for joint in chain.raw]),
        flange=chain.flange,
        coupling=frozen(np.eye(count)),
        serial_limits=frozen(np.tile([-math.inf, math.inf], (count, 1))),
        links=links,
        touching=tuple((k, k + 1) for k in range(count)),
        pad=_PAD,
        home=frozen(limits.mean(axis=1)),
        trust=Trust("uncertain", "uncertain", "uncertain", "uncertain"),
        notes=tuple(said),
        sources=(Path(described.file).name,),
        arm=recognise(chain.joints, chain.flange),
    )


def _home(robot: Robot) -> FloatArray:
    """Where the arm is not stretched: joints at 0, or amid limits that 0 is not within, if that will do; else with the
    fewest joints bent by 30 deg.
    """
    low, high = robot.limits.T
    turning = np.array([not joint.sliding for joint in robot.joints])
    rest = np.where((low < 0) & (high > 0) & turning, 0.0, (low + high) / 2)
    best, clear = rest, -1.0
    for bent in range(min(int(turning.sum()), 2) + 1):
        every = np.array(
            [_bend(rest, joints) for joints in _sign(np.flatnonzero(turning).tolist(), bent)]
        )
        every = every[((low <= every) & (every <= high)).all(axis=1)]
        clears = _clearness(robot, every, turning).round(
            9
        )  # of two bends that do as well, the first
        if clears.max(initial=-1.0) > clear:
            best, clear = every[clears.argmax()], float(clears.max())
        if clear >= _CLEAR_OF_SINGULAR:
            break
    return frozen(best)


def _sign(joints: list[int], count: int) -> Iterator[tuple[tuple[int, int], ...]]:
    """Each choice of ``count`` joints, each with a sign."""
    for chosen in itertools.combinations(joints, count):
        for signs in itertools.product((1, -1), repeat=count):
            yield tuple(zip(chosen, signs, strict=True))


def _bend(rest: FloatArray, joints: tuple[tuple[int, int], ...]) -> FloatArray:
    values = rest.copy()
    for joint, sign in joints:
        values[joint] += sign * _BEND
    return values


def _clearness(robot: Robot, joints: FloatArray, turning: NDArray[np.bool_]) -> FloatArray:
    """The least singular values (N,) of the Jacobian; a slide counts as a joint at the arm's mean lever."""
    moved, _, _ = jacobian(robot, joints)
    moved[:, :3] /= robot.lever
    moved[:, :, ~turning] *= robot.lever
    return np.asarray(np.linalg.svd(moved, compute_uv=False)[:, -1])
