"""How the arm gets from path to path: its joints evenly; where that collides, straight; or by way of home."""

from __future__ import annotations

import numpy as np
from msgspec import Struct, field

from camgen.geometry.rotations import turned_about_z
from camgen.model.advice import ANOTHER_PLACE
from camgen.model.pose import FloatArray, frozen
from camgen.motion.pose_paths import PosePath, divide
from camgen.motion.setup import JUMP, Blockage, SampledMotion, compute_flange_poses, count_samples
from camgen.order.arm.layers import SAME
from camgen.order.arm.search import (
    Solution,
    TourProblem,
    detour_of,
    find_blocked,
    find_blocked_paths,
    learn_blocked_links,
    link_key,
    make_blocked_link,
)
from camgen.robots.kinematics.continuity import Choice, follow

_NO_WAY = f"no free motion leads to it: {ANOTHER_PLACE}, clearance or home may help"
_COLLIDES = "it collides with every turn that is tried"


class LinkedTour(Struct, frozen=True):
    """A tour with its links.

    solution: the order, and the state of each path.
    to: by path, the joint values (J,) that lead to above its start; empty for a straight line.
    back: joint values (J,) between the last path and home.
    lost: by path that is left out, the reason.
    """

    solution: Solution
    to: dict[int, tuple[FloatArray, ...]] = field(default_factory=dict)
    back: tuple[FloatArray, ...] = ()
    lost: dict[int, str] = field(default_factory=dict)


def link_up(problem: TourProblem, solution: Solution) -> LinkedTour:
    """The tour with a link to each of its paths. A path without one is left out."""
    lost = dict.fromkeys(sorted(find_blocked_paths(problem, solution)), _COLLIDES)
    order = [k for k in solution.order if k not in lost]
    while order:
        solution = Solution(order, solution.states, solution.seconds)
        learn_blocked_links(problem, solution)
        ways, bad = _ways(problem, solution)
        if bad is None:
            back = _way(problem, solution.states.leave[order[-1]], problem.cost_model.home)
            if back is not None:
                return LinkedTour(solution, ways, back[:-1], lost)
            bad = order[-1]
        lost[bad] = _NO_WAY
        order = [k for k in order if k != bad]
    return LinkedTour(Solution([], solution.states, 0.0), lost=lost)


def _ways(
    problem: TourProblem, solution: Solution
) -> tuple[dict[int, tuple[FloatArray, ...]], int | None]:
    """The ways to the paths, and the first one to which there is none."""
    current, home, order = solution.states, problem.cost_model.home, solution.order
    ways: dict[int, tuple[FloatArray, ...]] = {}
    for before, k in zip([-1, *order[:-1]], order, strict=True):
        start = home if before < 0 else current.leave[before]
        way = _way(problem, start, current.enter[k])
        if way is None and before >= 0 and _goes_straight(problem, solution, before, k):
            way = ()
        if way is None and before >= 0:
            legs = _way(problem, start, home), _way(problem, home, current.enter[k])
            way = None if legs[0] is None or legs[1] is None else (*legs[0], *legs[1])
        if way is None:
            return ways, k
        ways[k] = way
    return ways, None


def _way(problem: TourProblem, start: FloatArray, end: FloatArray) -> tuple[FloatArray, ...] | None:
    """The joint values that lead from ``start`` to ``end``, which is the last of them."""
    detour = detour_of(problem, start, end)
    if detour is not None:
        return (*detour, end)
    if link_key(start, end) in problem.free or not find_blocked(problem, [(start, end)])[0]:
        return (end,)
    problem.blocked_links.append(make_blocked_link(problem, start, end, 0.0))
    detour = detour_of(problem, start, end)
    return None if detour is None else (*detour, end)


def _goes_straight(problem: TourProblem, solution: Solution, one: int, other: int) -> bool:
    """Whether the TCP can go straight from above the end of a path to above the start of another."""
    current, items = solution.states, problem.cost_model.items
    if min(current.branch[one], current.branch[other]) < 0:
        return False
    at = [items[one].gates[current.gate[one, 1]], items[other].gates[current.gate[other, 0]]]
    turned = turned_about_z(current.turn[[one, other]])
    way = PosePath(
        frozen([items[one].position[at[0]], items[other].position[at[1]]]),
        frozen(np.full((2, 3), np.nan)),
        frozen(np.stack([items[one].rotation[at[0]], items[other].rotation[at[1]]]) @ turned),
    )
    dense = divide(way, count_samples(way))
    goal = compute_flange_poses(problem.setup, dense.position, dense.rotation)
    made = follow(
        problem.setup.robot, *goal, current.leave[one], min(items[one].off, items[other].off), JUMP
    )
    if not isinstance(made, Choice):
        return False
    ends = np.abs(made.joints[[0, -1]] - [current.leave[one], current.enter[other]]).max()
    return bool(ends < SAME) and not isinstance(
        problem.free_space.look([SampledMotion(made.joints, dense)])[0], Blockage
    )
