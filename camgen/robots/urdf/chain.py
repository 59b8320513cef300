"""From the tree of a URDF to the chain that camgen moves: from the robot's base to one tip, fixed joints folded in."""

from __future__ import annotations

import math

from msgspec import Struct

from camgen.model.errors import InputError
from camgen.model.pose import Pose, translation
from camgen.model.text import short
from camgen.robots.chain import Joint
from camgen.robots.urdf.xml import Description, RawJoint

#: Names of the frame at the flange, as ROS-Industrial and others have them, the best first: by their last words.
_TIPS = (("tool0",), ("flange",), ("ee", "link"), ("ee",), ("end", "effector"))
#: ROS's REP 199: a link of this name is the frame that the controller calls its base.
_BASE = "base"
#: rad: a joint without limits is taken to turn so far to either side.
_CONTINUOUS = math.tau
#: rad: limits beyond this are no limits.
_NO_LIMIT_RAD = 4 * math.tau
_HERE = translation(0.0, 0.0, 0.0)


class JointChain(Struct, frozen=True, eq=False):
    """joints: of the chain. raw: the same as described. flange: last_joint_from_flange. base, tip: names of links.
    bodies: for the base and each joint the links that move with it, and where: body_from_link. notes: what was assumed.
    """

    joints: tuple[Joint, ...]
    raw: tuple[RawJoint, ...]
    flange: Pose
    base: str
    tip: str
    bodies: tuple[dict[str, Pose], ...]
    notes: tuple[str, ...]


def chain_of(of: Description, tip: str) -> JointChain:
    """The chain to the link ``tip``, or to the flange where it is "". InputError for what is no single tree of links,
    and for a chain with joints that an arm does not have.
    """
    above = _above(of)
    root = _root(of, above)
    tip, notes = (_name_tip(of, tip), []) if tip else _find(of, _depths(of, root), root)
    way = _way(above, tip)
    moving = [joint for joint in way if joint.type != "fixed"]
    if not moving:
        raise InputError(
            of.file,
            f"nothing moves between {root} and {tip}",
            remedy="name another tip: FILE.urdf#LINK",
        )
    for joint in moving:
        _check(of, joint)
    bodies, left = _bodies(of, root, moving)
    base = _BASE if _BASE in bodies[0] else root
    base_from_root = bodies[0][base].inverse()
    bodies = (_rebase(bodies[0], base_from_root), *bodies[1:])
    joints = _fold(moving, bodies)
    notes += [
        f"{joint.name} has no limits: -360 to 360 deg are taken"
        for joint in moving
        if joint.type == "continuous"
    ]
    notes += [f"{name} moves by itself: it is left out" for name in left]
    return JointChain(joints, tuple(moving), bodies[-1][tip], base, tip, bodies, tuple(notes))


def limits_of(joint: RawJoint) -> tuple[float, float]:
    """Rad or mm."""
    if joint.type == "continuous":
        return -_CONTINUOUS, _CONTINUOUS
    return joint.limit.lower or 0.0, joint.limit.upper or 0.0


def _above(of: Description) -> dict[str, RawJoint]:
    """For each link the joint that carries it."""
    above: dict[str, RawJoint] = {}
    for joint in of.joints:
        if joint.child in above:
            where = f"joints {above[joint.child].name} and {joint.name}"
            raise InputError(
                of.file,
                f"link {joint.child} hangs on two joints",
                where,
                "camgen moves chains, no loops",
            )
        above[joint.child] = joint
    return above


def _root(of: Description, above: dict[str, RawJoint]) -> str:
    """The one link that no joint carries, from which all others are reached."""
    roots = [name for name in of.links if name not in above]
    if not of.links:
        raise InputError(of.file, "has no links")
    if len(roots) > 1:
        raise InputError(
            of.file,
            f"has {len(roots)} roots: {_list(roots)}",
            remedy="join them, or remove what is loose",
        )
    root = roots[0] if roots else ""
    depths = _depths(of, root)
    rest = [name for name in of.links if name not in depths]
    if rest:
        raise InputError(
            of.file,
            f"links hang on each other in a loop: {_list(rest)}",
            remedy="camgen moves chains",
        )
    return root


def _depths(of: Description, root: str) -> dict[str, int]:
    """For each link the number of joints that move it; root: where to begin."""
    below = _below(of)
    depths, todo = {root: 0}, [root] if root else []
    while todo:
        for joint in below.get(name := todo.pop(), []):
            depths[joint.child] = depths[name] + (joint.type != "fixed")
            todo.append(joint.child)
    return depths


def _below(of: Description) -> dict[str, list[RawJoint]]:
    """For each link the joints that it carries."""
    below: dict[str, list[RawJoint]] = {}
    for joint in of.joints:
        below.setdefault(joint.parent, []).append(joint)
    return below


def _way(above: dict[str, RawJoint], tip: str) -> list[RawJoint]:
    """The joints from the root to ``tip``."""
    way: list[RawJoint] = []
    while tip in above:
        way.append(above[tip])
        tip = above[tip].parent
    return way[::-1]


def _name_tip(of: Description, tip: str) -> str:
    if tip not in of.links:
        raise InputError(
            of.file, f"there is no link {tip}", remedy=f"there are {_list(list(of.links))}"
        )
    return tip


def _find(of: Description, depths: dict[str, int], root: str) -> tuple[str, list[str]]:
    """The link at the end of the chain, and what has to be said about the choice."""
    for words in _TIPS:
        named = [name for name in of.links if _words(name)[-len(words) :] == words]
        if named:
            return _only(of, named), []
    carrying = {joint.parent for joint in of.joints}
    ends = [name for name in of.links if name not in carrying]
    most = max(depths[name] for name in ends)
    tip = _only(of, [name for name in ends if depths[name] == most])
    others = [name for name in ends if name != tip]
    return tip, [
        f"the tip is {tip}, farthest from {root}" + (f", not {_list(others)}" if others else "")
    ]


def _only(of: Description, names: list[str]) -> str:
    if len(names) > 1:
        what = f"it is not clear which link is the flange: {_list(names)}"
        raise InputError(of.file, what, "cell.robot", "name it after the file: FILE.urdf#LINK")
    return names[0]


def _words(name: str) -> tuple[str, ...]:
    return tuple(name.casefold().replace("-", "_").replace("/", "_").split("_"))


def _check(of: Description, joint: RawJoint) -> None:
    """InputError for a joint of the chain that cannot be moved or checked."""
    where = f"joint {joint.name}"
    if joint.type in ("floating", "planar"):
        raise InputError(
            of.file,
            f"a {joint.type} joint is none of an arm",
            where,
            "make it fixed, or name another tip",
        )
    if joint.follows:
        what = f"it follows joint {joint.follows} (mimic)"
        raise InputError(
            of.file, what, where, "camgen moves each joint by itself: use a built-in robot"
        )
    if not (joint.limit.velocity or 0.0) > 0:
        unit = "m/s" if joint.sliding else "rad/s"
        raise InputError(
            of.file, "it states no speed", where, f'give <limit velocity="..."/>, {unit}'
        )
    if joint.type == "continuous":
        return
    lower, upper = joint.limit.lower, joint.limit.upper
    unit = "m" if joint.sliding else "rad"
    if lower is None or upper is None:
        raise InputError(
            of.file, "it states no limits", where, f'give <limit lower="..." upper="..."/>, {unit}'
        )
    if not lower < upper:
        what = f"its limits leave it no room: {short(lower, 4)} to {short(upper, 4)} {'mm' if joint.sliding else unit}"
        raise InputError(of.file, what, where, 'mend them, or make it type="fixed"')
    if not joint.sliding and max(-lower, upper) > _NO_LIMIT_RAD:
        raise InputError(
            of.file, "its limits are more than four turns away", where, 'make it type="continuous"'
        )


def _bodies(
    of: Description, root: str, moving: list[RawJoint]
) -> tuple[tuple[dict[str, Pose], ...], list[str]]:
    """The links that stand, and those that move with each of the joints ``moving``: body_from_link by name; and the
    links below other joints.
    """
    below = _below(of)
    own = {joint.name for joint in moving}
    bodies, left = [], []
    for start in (root, *(joint.child for joint in moving)):
        body = {start: _HERE}
        todo = [start]
        while todo:
            name = todo.pop()
            for joint in below.get(name, []):
                if joint.type == "fixed":
                    body[joint.child] = body[name] @ joint.parent_from_child
                    todo.append(joint.child)
                elif joint.name not in own:
                    left.append(joint.child)
        bodies.append(body)
    return tuple(bodies), left


def _rebase(body: dict[str, Pose], new_from_old: Pose) -> dict[str, Pose]:
    return {name: new_from_old @ place for name, place in body.items()}


def _fold(moving: list[RawJoint], bodies: tuple[dict[str, Pose], ...]) -> tuple[Joint, ...]:
    """The joints, each in the frame of the one before it."""
    return tuple(
        Joint(joint.name, joint.sliding, body[joint.parent] @ joint.parent_from_child, joint.axis)
        for joint, body in zip(moving, bodies, strict=False)
    )


def _list(names: list[str]) -> str:
    return ", ".join(names[:8]) + (f" and {len(names) - 8} more" if len(names) > 8 else "")
