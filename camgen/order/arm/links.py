"""How the arm gets from path to path: its joints evenly; where that collides, straight; or by way of home."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.geometry.rotations import turned_about_z
from camgen.model.pose import FloatArray, frozen
from camgen.motion.pose_paths import Way, divide
from camgen.motion.setup import JUMP, Hit, Track, dense_parts, flange_poses
from camgen.order.arm.layers import SAME
from camgen.order.arm.search import (
    Found,
    Work,
    blocked_links,
    blocked_paths,
    detour_of,
    find_blocked,
    link_key,
    wall_between,
)
from camgen.robots.kinematics.continuity import Choice, follow

_NO_WAY = "no free motion leads to it: another place (camgen place), clearance or home may help"
_COLLIDES = "it collides with every turn that is tried"


class Links(Struct, frozen=True):
    """to: by path, the joint values that lead to above its start, none where a straight line does. back: those between
    the last path and home. lost: why paths are left out.
    """

    to: dict[int, tuple[FloatArray, ...]]
    back: tuple[FloatArray, ...]
    lost: dict[int, str]


def link_up(work: Work, found: Found) -> tuple[Found, Links]:
    """The tour with a way to each of its paths; those to which there is none are left out."""
    lost = dict.fromkeys(sorted(blocked_paths(work, found)), _COLLIDES)
    order = [k for k in found.order if k not in lost]
    while order:
        found = Found(order, found.now, found.seconds)
        blocked_links(work, found)
        ways, bad = _ways(work, found)
        if bad is None:
            back = _way(work, found.now.leave[order[-1]], work.ground.home)
            if back is not None:
                return found, Links(ways, back[:-1], lost)
            bad = order[-1]
        lost[bad] = _NO_WAY
        order = [k for k in order if k != bad]
    return Found([], found.now, 0.0), Links({}, (), lost)


def _ways(work: Work, found: Found) -> tuple[dict[int, tuple[FloatArray, ...]], int | None]:
    """The ways to the paths, and the first one to which there is none."""
    now, home, order = found.now, work.ground.home, found.order
    ways: dict[int, tuple[FloatArray, ...]] = {}
    for before, k in zip([-1, *order[:-1]], order, strict=True):
        start = home if before < 0 else now.leave[before]
        way = _way(work, start, now.enter[k])
        if way is None and before >= 0 and _goes_straight(work, found, before, k):
            way = ()
        if way is None and before >= 0:
            legs = _way(work, start, home), _way(work, home, now.enter[k])
            way = None if legs[0] is None or legs[1] is None else (*legs[0], *legs[1])
        if way is None:
            return ways, k
        ways[k] = way
    return ways, None


def _way(work: Work, start: FloatArray, end: FloatArray) -> tuple[FloatArray, ...] | None:
    """The joint values that lead from ``start`` to ``end``, which is the last of them."""
    detour = detour_of(work, start, end)
    if detour is not None:
        return (*detour, end)
    if link_key(start, end) in work.free or not find_blocked(work, [(start, end)])[0]:
        return (end,)
    work.walls.append(wall_between(work, start, end, 0.0))
    detour = detour_of(work, start, end)
    return None if detour is None else (*detour, end)


def _goes_straight(work: Work, found: Found, one: int, other: int) -> bool:
    """Whether the TCP can go straight from above the end of a path to above the start of another."""
    now, items = found.now, work.ground.items
    if min(now.branch[one], now.branch[other]) < 0:
        return False
    at = [items[one].gates[now.gate[one, 1]], items[other].gates[now.gate[other, 0]]]
    turned = turned_about_z(now.turn[[one, other]])
    way = Way(
        frozen([items[one].position[at[0]], items[other].position[at[1]]]),
        frozen(np.full((2, 3), np.nan)),
        frozen(np.stack([items[one].rotation[at[0]], items[other].rotation[at[1]]]) @ turned),
    )
    dense = divide(way, dense_parts(way))
    goal = flange_poses(work.setup, dense.position, dense.rotation)
    made = follow(
        work.setup.robot, *goal, now.leave[one], min(items[one].off, items[other].off), JUMP
    )
    if not isinstance(made, Choice):
        return False
    ends = np.abs(made.joints[[0, -1]] - [now.leave[one], now.enter[other]]).max()
    return bool(ends < SAME) and not isinstance(work.room.look([Track(made.joints, dense)])[0], Hit)
