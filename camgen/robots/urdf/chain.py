"""Makes the chain that camgen moves from the tree of a URDF.

It leads from the base of the robot to one tip. Fixed joints become part of the links.
"""

from __future__ import annotations

import math

from msgspec import Struct

from camgen.model.errors import InputError
from camgen.model.pose import Pose, translation
from camgen.model.text import short
from camgen.robots.chain import Joint
from camgen.robots.urdf.xml import Description, RawJoint

#: Last words of names of the frame at the flange in files of ROS-Industrial and others, best first.
_TIPS = (("tool0",), ("flange",), ("ee", "link"), ("ee",), ("end", "effector"))
#: Name of the link that is the base frame of the controller (ROS, REP 199).
_BASE = "base"
#: rad: limit that is assumed on either side for a joint without limits.
_CONTINUOUS = math.tau
#: rad: limits beyond this are invalid.
_NO_LIMIT_RAD = 4 * math.tau


class JointChain(Struct, frozen=True, eq=False):
    """The chain from the base to the tip.

    joints: joints that move, in order.
    raw: these joints as described.
    flange: last_joint_from_flange.
    base, tip: names of links.
    bodies: body_from_link by the name of the link: first links that move with the base, then links
        that move with each joint.
    notes: assumptions, as texts.
    """

    joints: tuple[Joint, ...]
    raw: tuple[RawJoint, ...]
    flange: Pose
    base: str
    tip: str
    bodies: tuple[dict[str, Pose], ...]
    notes: tuple[str, ...]


def make_chain(description: Description, tip: str) -> JointChain:
    """The chain to the link `tip`, or to the flange if it is empty.

    Raises InputError if the links are not a single tree, or if the chain has joints that an arm
    does not have.
    """
    joint_above = _find_joints_above(description)
    root = _find_root(description, joint_above)
    notes: list[str] = []
    if not tip:
        tip, notes = _find_tip(description, _count_joints(description, root), root)
    elif tip not in description.links:
        raise InputError(
            description.file,
            f"there is no link {tip}",
            remedy=f"there are {_list(list(description.links))}",
        )
    moving = [joint for joint in _list_joints(joint_above, tip) if joint.type != "fixed"]
    if not moving:
        raise InputError(
            description.file,
            f"nothing moves between {root} and {tip}",
            remedy="name another tip: FILE.urdf#LINK",
        )
    for joint in moving:
        _check_joint(description.file, joint)
    bodies, loose = _find_bodies(description, root, moving)
    base = _BASE if _BASE in bodies[0] else root
    base_from_root = bodies[0][base].inverse()
    bodies = ({name: base_from_root @ place for name, place in bodies[0].items()}, *bodies[1:])
    joints: list[Joint] = []
    for joint, body in zip(moving, bodies, strict=False):
        if joint.type == "continuous":
            notes.append(f"{joint.name} has no limits: -360 to 360 deg are assumed")
        previous_from_joint = body[joint.parent] @ joint.parent_from_child
        joints.append(Joint(joint.name, joint.sliding, previous_from_joint, joint.axis))
    notes += [f"link {name} is not part of the arm: it is left out" for name in loose]
    return JointChain(
        tuple(joints), tuple(moving), bodies[-1][tip], base, tip, bodies, tuple(notes)
    )


def find_limits(joint: RawJoint) -> tuple[float, float]:
    """The limits of a joint, rad or mm."""
    if joint.type == "continuous":
        return -_CONTINUOUS, _CONTINUOUS
    return joint.lower or 0.0, joint.upper or 0.0


def _find_joints_above(description: Description) -> dict[str, RawJoint]:
    """The joint that carries each link, by the name of the link."""
    joint_above: dict[str, RawJoint] = {}
    for joint in description.joints:
        if joint.child in joint_above:
            raise InputError(
                description.file,
                f"link {joint.child} is the child of two joints",
                f"joints {joint_above[joint.child].name} and {joint.name}",
                "remove one of them: camgen cannot move loops",
            )
        joint_above[joint.child] = joint
    return joint_above


def _find_root(description: Description, joint_above: dict[str, RawJoint]) -> str:
    """The one link that no joint carries, from which all others are reached."""
    roots = [name for name in description.links if name not in joint_above]
    if not description.links:
        raise InputError(description.file, "has no links")
    if len(roots) > 1:
        raise InputError(
            description.file,
            f"has {len(roots)} roots: {_list(roots)}",
            remedy="connect them by joints, or remove all but one",
        )
    root = roots[0] if roots else ""
    reached = _count_joints(description, root)
    rest = [name for name in description.links if name not in reached]
    if rest:
        raise InputError(
            description.file,
            f"links form a loop, or are below one: {_list(rest)}",
            remedy="remove a joint of the loop: camgen cannot move loops",
        )
    return root


def _count_joints(description: Description, root: str) -> dict[str, int]:
    """The number of joints that move each link that is reached from `root`, by its name."""
    below = _find_joints_below(description)
    counts, pending = {root: 0}, [root] if root else []
    while pending:
        for joint in below.get(name := pending.pop(), []):
            counts[joint.child] = counts[name] + (joint.type != "fixed")
            pending.append(joint.child)
    return counts


def _find_joints_below(description: Description) -> dict[str, list[RawJoint]]:
    """The joints that each link carries, by the name of the link."""
    below: dict[str, list[RawJoint]] = {}
    for joint in description.joints:
        below.setdefault(joint.parent, []).append(joint)
    return below


def _list_joints(joint_above: dict[str, RawJoint], tip: str) -> list[RawJoint]:
    joints: list[RawJoint] = []
    while tip in joint_above:
        joints.append(joint_above[tip])
        tip = joint_above[tip].parent
    return joints[::-1]


def _find_tip(description: Description, counts: dict[str, int], root: str) -> tuple[str, list[str]]:
    """The link at the flange, and notes on the choice. counts: joints that move each link."""
    for words in _TIPS:
        named = [name for name in description.links if _words(name)[-len(words) :] == words]
        if named:
            return _check_single(description, named), []
    carrying = {joint.parent for joint in description.joints}
    ends = [name for name in description.links if name not in carrying]
    largest = max(counts[name] for name in ends)
    tip = _check_single(description, [name for name in ends if counts[name] == largest])
    others = [name for name in ends if name != tip]
    note = f"the tip is {tip}, farthest from {root}"
    return tip, [f"{note}, not {_list(others)}" if others else note]


def _check_single(description: Description, names: list[str]) -> str:
    if len(names) > 1:
        raise InputError(
            description.file,
            f"it is not clear which link is the flange: {_list(names)}",
            "cell.robot",
            "name it after the file: FILE.urdf#LINK",
        )
    return names[0]


def _words(name: str) -> tuple[str, ...]:
    return tuple(name.casefold().replace("-", "_").replace("/", "_").split("_"))


def _check_joint(file: str, joint: RawJoint) -> None:
    """Raise InputError for a joint of the chain that cannot be moved or tested."""
    where, lower, upper = f"joint {joint.name}", joint.lower, joint.upper
    unit, limit_unit = ("m", "mm") if joint.sliding else ("rad", "rad")
    if joint.type in ("floating", "planar"):
        raise InputError(
            file,
            f"an arm cannot have a {joint.type} joint",
            where,
            "make it fixed, or name another tip",
        )
    if joint.follows:
        raise InputError(
            file,
            f"it follows joint {joint.follows} (mimic)",
            where,
            "camgen moves each joint by itself: use a built-in robot",
        )
    if not (joint.velocity or 0.0) > 0:
        raise InputError(
            file, "it states no speed", where, f'give <limit velocity="..."/>, {unit}/s'
        )
    if joint.type == "continuous":
        return
    if lower is None or upper is None:
        raise InputError(
            file, "it states no limits", where, f'give <limit lower="..." upper="..."/>, {unit}'
        )
    if not lower < upper:
        raise InputError(
            file,
            f"its limits leave no range: {short(lower, 4)} to {short(upper, 4)} {limit_unit}",
            where,
            'correct the limits, or make it type="fixed"',
        )
    if not joint.sliding and max(-lower, upper) > _NO_LIMIT_RAD:
        raise InputError(
            file, "a limit is more than four turns from 0", where, 'make it type="continuous"'
        )


def _find_bodies(
    description: Description, root: str, moving: list[RawJoint]
) -> tuple[tuple[dict[str, Pose], ...], list[str]]:
    """The links of each body: body_from_link by the name of the link; and links of no body.

    The first body stands, the others move with each of the joints `moving`. Links below other
    joints are in no body.
    """
    below = _find_joints_below(description)
    moving_names = {joint.name for joint in moving}
    bodies, loose = [], []
    for start in (root, *(joint.child for joint in moving)):
        body = {start: translation(0.0, 0.0, 0.0)}
        pending = [start]
        while pending:
            name = pending.pop()
            for joint in below.get(name, []):
                if joint.type == "fixed":
                    body[joint.child] = body[name] @ joint.parent_from_child
                    pending.append(joint.child)
                elif joint.name not in moving_names:
                    loose.append(joint.child)
        bodies.append(body)
    return tuple(bodies), loose


def _list(names: list[str]) -> str:
    return ", ".join(names[:8]) + (f" and {len(names) - 8} more" if len(names) > 8 else "")
