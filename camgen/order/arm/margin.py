"""Applies `cell.margin` to tours of an arm: paths that cannot keep it are inserted at the end.

The margin is tested at samples. The check of the program reports the clearance between them.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from camgen.collision.cell import CellScene
from camgen.collision.hits import find_collisions, measure_clearance
from camgen.collision.scene import Scene, select_pairs
from camgen.model.part import BoolArray
from camgen.model.pose import FloatArray
from camgen.model.sequences import take_rows
from camgen.order.arm.detours import ClearTest
from camgen.order.arm.items import States
from camgen.order.arm.search import Solution, TourProblem
from camgen.order.solver import matrix

#: mm: added to the margin, because most links come nearer by at most this between two samples.
_SLACK_MM = 0.25


def make_clear_test(scene: Scene, distance: float = 0.0) -> ClearTest:
    """A test of joint values that keeps all pairs farther apart than `distance`, mm.

    Pairs with a mesh are tested last, because most collisions are with boxes.
    """
    meshed = set[int]().union(*(target.of_strike.tolist() for target in scene.targets))
    boxed = select_pairs(scene, sorted(set(range(len(scene.pairs))) - meshed))
    at_mesh = select_pairs(scene, sorted(meshed))

    def is_clear(joints: FloatArray) -> BoolArray:
        clear: BoolArray = np.asarray(find_collisions(boxed, joints, near=distance) < 0)
        if meshed and clear.any():
            clear[clear] = find_collisions(at_mesh, joints[clear], near=distance) < 0
        return clear

    return is_clear


def make_margin_test(where: CellScene, home: FloatArray, contacts: FloatArray) -> ClearTest:
    """A test of joint values for the margin, of all pairs that keep it at home (J,).

    A pair of the tool that does not keep it at most contacts is tested without it: the tool has to
    come near to that body.

    contacts: (K, J) joint values at which the tool is in contact.
    """
    scene, distance = where.with_margin, where.margin + _SLACK_MM
    pairs = range(len(scene.pairs))
    kept = [k for k in pairs if not _is_close(select_pairs(scene, [k]), home, contacts, distance)]
    kept_pairs = set(take_rows(scene.pairs, kept))
    others = [k for k, pair in enumerate(where.scene.pairs) if pair not in kept_pairs]
    keeps_margin = make_clear_test(select_pairs(scene, kept), distance)
    are_others_clear = make_clear_test(select_pairs(where.scene, others))

    def is_clear(joints: FloatArray) -> BoolArray:
        clear = keeps_margin(joints)
        clear[clear] = are_others_clear(joints[clear])
        return clear

    return is_clear


def _is_close(scene: Scene, home: FloatArray, contacts: FloatArray, distance: float) -> bool:
    """Whether the only pair of `scene` is nearer than `distance` at home or at most contacts."""
    if measure_clearance(scene, home[None], distance)[0] < distance:
        return True
    pair, links = scene.pairs[0], {link.name for link in scene.robot.links}
    if "tool" not in pair or not links.isdisjoint(pair) or not len(contacts):
        return False
    near = find_collisions(scene, contacts, near=distance) >= 0
    return bool(np.count_nonzero(near) > len(contacts) / 2)


def insert_items(
    problem: TourProblem, solution: Solution, added: Sequence[int], fixed: bool
) -> list[int]:
    """Insert each item of `added` where its fastest state takes least time and the rules allow it.

    fixed: whether items stay in the order of their indices.
    """
    order = list(solution.order)
    current, limits, rules = solution.states, problem.cost_model.limits, problem.rules
    states = current.split()
    for k in added:
        states[k] = problem.states[k]
    home = States.fixed(problem.cost_model.home)
    for k in added:
        low, high = _find_allowed_places(rules, order, k, fixed)
        stops = [home, *take_rows(states, order), home]
        cost = []
        for before, after in pairwise(stops[low : high + 2]):
            into = limits.between(before.leave, states[k].enter, 0.0).min(axis=0)
            out = limits.between(states[k].leave, after.enter, 0.0).min(axis=1)
            cost.append((into + out).min())
        order.insert(low + int(np.argmin(cost)), k)
    return order


def _find_allowed_places(
    rules: matrix.Rules, order: list[int], item: int, fixed: bool
) -> tuple[int, int]:
    """The first and the last index in `order` at which the rules allow an item."""
    ranks = rules.rank[order]
    low = int(np.count_nonzero(ranks < rules.rank[item]))
    high = int(np.count_nonzero(ranks <= rules.rank[item]))
    if fixed:
        low = high = int(np.count_nonzero(np.array(order) < item))
    for place, other in enumerate(order):
        if rules.parent[other] == item:
            low = max(low, place + 1)
        if other == rules.parent[item]:
            high = min(high, place)
    return low, max(high, low)
