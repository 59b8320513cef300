"""``cell.margin`` where an arm chooses: everything is asked to keep it first; what cannot is put in beside the rest.

Joint values that are looked at are asked to be no nearer; the check of the program says what is in between.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from camgen.collision.cell import Surroundings
from camgen.collision.hits import find_collisions, measure_clearance
from camgen.collision.scene import Scene, narrow
from camgen.model.part import BoolArray
from camgen.model.pose import FloatArray
from camgen.order.arm.search import Solution, TourProblem

#: mm: between two looks a link comes nearer by so much at most, mostly.
_SLACK = 0.25

Clear = Callable[[FloatArray], BoolArray]


def clear_of(scene: Scene, near: float = 0.0) -> Clear:
    """Which joint values come no nearer than ``near`` mm. Most of those that do are near a box: meshes come last."""
    meshed = sorted({int(pair) for target in scene.targets for pair in target.of_strike})
    boxed = narrow(scene, [k for k in range(len(scene.pairs)) if k not in meshed])
    at_mesh = narrow(scene, meshed)

    def clear(joints: FloatArray) -> BoolArray:
        good: BoolArray = np.asarray(find_collisions(boxed, joints, near=near) < 0)
        if meshed and good.any():
            good[good] = find_collisions(at_mesh, joints[good], near=near) < 0
        return good

    return clear


def roomy_of(where: Surroundings, home: FloatArray, worked: FloatArray) -> Clear:
    """Which joint values keep the margin, of all pairs that have it at home (J,). worked: (K, J) joint values at the
    tool's contact: what the tool is nearer to in most of them, however it is turned, it is meant to be near to.
    """
    scene, near = where.apart, where.margin + _SLACK
    kept = [
        k for k in range(len(scene.pairs)) if not _is_close(narrow(scene, [k]), home, worked, near)
    ]
    kept_pairs = {scene.pairs[k] for k in kept}
    bare = [k for k, pair in enumerate(where.scene.pairs) if pair not in kept_pairs]
    apart, beside = clear_of(narrow(scene, kept), near), clear_of(narrow(where.scene, bare))

    def clear(joints: FloatArray) -> BoolArray:
        good = apart(joints)
        good[good] = beside(joints[good])
        return good

    return clear


def _is_close(scene: Scene, home: FloatArray, worked: FloatArray, near: float) -> bool:
    """Whether the one pair of ``scene`` is nearer at home, or at most of the contacts."""
    if measure_clearance(scene, home[None], near)[0] < near:
        return True
    if "tool" not in scene.pairs[0] or {link.name for link in scene.robot.links} & set(
        scene.pairs[0]
    ):
        return False
    return bool(
        len(worked)
        and np.count_nonzero(find_collisions(scene, worked, near=near) >= 0) > len(worked) / 2
    )


def put_in(problem: TourProblem, solution: Solution, more: Sequence[int], fixed: bool) -> list[int]:
    """The order of ``solution`` with the items ``more``, each where its quickest state takes least time, and where the
    rules have it. fixed: in the order of their numbers.
    """
    order = list(solution.order)
    current, limits, rules = solution.states, problem.cost_model.limits, problem.rules
    own = {k: problem.states[k] for k in more} | {k: current.single(k) for k in order}
    for k in more:
        ranks = rules.rank[order]
        low = int(np.count_nonzero(ranks < rules.rank[k]))
        high = int(np.count_nonzero(ranks <= rules.rank[k]))
        if fixed:
            low = high = int(np.count_nonzero(np.array(order) < k))
        places = {item: at for at, item in enumerate(order)}
        low = max([low, *(places[item] + 1 for item in order if rules.parent[item] == k)])
        high = max(
            min([high, *([places[rules.parent[k]]] if rules.parent[k] in places else [])]), low
        )
        leave = [problem.cost_model.home[None], *(own[item].leave for item in order)]
        enter = [*(own[item].enter for item in order), problem.cost_model.home[None]]
        cost = [
            (
                limits.between(leave[at], own[k].enter, 0.0).min(axis=0)
                + limits.between(own[k].leave, enter[at], 0.0).min(axis=1)
            ).min()
            for at in range(low, high + 1)
        ]
        order.insert(low + int(np.argmin(cost)), k)
    return order
