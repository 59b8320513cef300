"""Chooses the links of an arm between paths: joint motions, detours, straight lines, or by home."""

from __future__ import annotations

import numpy as np
from msgspec import Struct, field

from camgen.geometry.rotations import make_rotations_about_z
from camgen.model.advice import ANOTHER_PLACE
from camgen.model.pose import FloatArray, frozen
from camgen.motion.pose_paths import PosePath, divide
from camgen.motion.setup import JUMP, Blockage, SampledMotion, compute_flange_poses, count_samples
from camgen.order.arm.layers import SAME
from camgen.order.arm.search import (
    Solution,
    TourProblem,
    find_blocked_links,
    find_blocked_paths,
    find_known_detour,
    learn_blocked_links,
    make_blocked_link,
    make_link_key,
)
from camgen.robots.kinematics.continuity import Choice, follow

_NO_LINK = f"no collision-free link to this path: {ANOTHER_PLACE}, clearance or home may help"
_COLLIDES = "it collides with every roll of the tool that is tried"


class LinkedTour(Struct, frozen=True):
    """A tour with its links.

    solution: the order, and the state of each path.
    to: joint values (J,) that lead to above the start of a path, by path; empty for a straight
        line.
    back: joint values (J,) between the last path and home.
    lost: reason why a path is left out, by path.
    """

    solution: Solution
    to: dict[int, tuple[FloatArray, ...]] = field(default_factory=dict)
    back: tuple[FloatArray, ...] = ()
    lost: dict[int, str] = field(default_factory=dict)


#: Joint values (J,) of a link: those to pass through, and its end.
_Link = tuple[FloatArray, ...]


def link_paths(problem: TourProblem, solution: Solution) -> LinkedTour:
    """The tour with a link to each of its paths. A path without one is left out."""
    lost = dict.fromkeys(sorted(find_blocked_paths(problem, solution)), _COLLIDES)
    order = [k for k in solution.order if k not in lost]
    while order:
        solution = Solution(order, solution.states, solution.seconds)
        learn_blocked_links(problem, solution)
        links, unlinked = _link_all(problem, solution)
        if unlinked is None:
            back = _link_joints(problem, solution.states.leave[order[-1]], problem.cost_model.home)
            if back is not None:
                return LinkedTour(solution, links, back[:-1], lost)
            unlinked = order[-1]
        lost[unlinked] = _NO_LINK
        order = [k for k in order if k != unlinked]
    return LinkedTour(Solution([], solution.states, 0.0), lost=lost)


def _link_all(problem: TourProblem, solution: Solution) -> tuple[dict[int, _Link], int | None]:
    """The links to the paths in order, and the first path without one, None if all have one."""
    current, home, order = solution.states, problem.cost_model.home, solution.order
    links: dict[int, _Link] = {}
    for before, k in zip([-1, *order[:-1]], order, strict=True):
        start = home if before < 0 else current.leave[before]
        link = _link_joints(problem, start, current.enter[k])
        if link is None and before >= 0 and _goes_straight(problem, solution, before, k):
            link = ()
        if link is None and before >= 0:
            to_home = _link_joints(problem, start, home)
            from_home = _link_joints(problem, home, current.enter[k])
            if to_home is not None and from_home is not None:
                link = (*to_home, *from_home)
        if link is None:
            return links, k
        links[k] = link
    return links, None


def _link_joints(problem: TourProblem, start: FloatArray, end: FloatArray) -> _Link | None:
    """The joint motion from `start` to `end`, or its detour; None if both collide."""
    detour = find_known_detour(problem, start, end)
    if detour is None:
        is_free = make_link_key(start, end) in problem.free
        if is_free or not find_blocked_links(problem, [(start, end)])[0]:
            return (end,)
        problem.blocked_links.append(make_blocked_link(problem, start, end, 0.0))
        detour = find_known_detour(problem, start, end)
    return None if detour is None else (*detour, end)


def _goes_straight(problem: TourProblem, solution: Solution, before: int, after: int) -> bool:
    """Whether the TCP can go straight from above the end of a path to the start of the next."""
    current, setup = solution.states, problem.setup
    first, second = problem.cost_model.items[before], problem.cost_model.items[after]
    if min(current.branch[before], current.branch[after]) < 0:
        return False
    start, end = first.gates[current.gate[before, 1]], second.gates[current.gate[after, 0]]
    rolled = make_rotations_about_z(current.roll[[before, after]])
    path = PosePath(
        frozen([first.position[start], second.position[end]]),
        frozen(np.full((2, 3), np.nan)),
        frozen(np.stack([first.rotation[start], second.rotation[end]]) @ rolled),
    )
    dense = divide(path, count_samples(path))
    goal = compute_flange_poses(setup, dense.position, dense.rotation)
    min_distance = min(first.min_distance, second.min_distance)
    choice = follow(setup.robot, goal, current.leave[before], min_distance, JUMP)
    if not isinstance(choice, Choice):
        return False
    if np.abs(choice.joints[[0, -1]] - [current.leave[before], current.enter[after]]).max() >= SAME:
        return False
    (result,) = problem.free_space.look([SampledMotion(choice.joints, dense)])
    return not isinstance(result, Blockage)
