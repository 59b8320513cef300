"""Searches a tour of points that may come in any order: posture blocks, then order and rolls."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from msgspec.structs import replace

from camgen.model.sequences import take_rows
from camgen.motion.limits import time_from_rest
from camgen.order.arm.blocks import find_blocks, narrow_states, select_clear_states
from camgen.order.arm.items import States, join_states
from camgen.order.arm.lattice import (
    KnownLinks,
    RejectedLinks,
    add_detours,
    choose_point_states,
    make_pair_key,
    prove_links,
    reject_links,
)
from camgen.order.arm.layers import FORBIDDEN, compute_posture_costs
from camgen.order.arm.search import (
    ROLL_STEPS,
    OnProgress,
    Solution,
    TourProblem,
    add_shifted_rolls,
    find_blocked_paths,
    measure_fastest_links,
)
from camgen.order.solver.ring import shorten_ring

#: Maximum number of points that are searched together; more are searched as paths are.
MAX_POINTS = 300
#: Number of points below which the search has nothing to gain.
MIN_POINTS = 5
#: s: maximum cost of a blocked link in the search for an order.
_MAX_BLOCKED_COST = 12.0
#: Maximum number of rounds.
_ROUNDS = 12
#: Rounds in a row without gain after which the search ends.
_IDLE_ROUNDS = 4
#: Perturbations of the order for each point in the first round.
_FIRST_PERTURBATIONS = 8
#: The same in later rounds.
_LATER_PERTURBATIONS = 4
#: Divisions into blocks whose postures are used.
_MAX_DIVISIONS = 4
#: s: time above that of the best division up to which others are used.
_WORSE_DIVISION = 1.5
#: Number of points up to which the search also starts with one posture each, and takes longer.
_FEW_POINTS = 120
#: rad or mm: states whose joint values are nearer than this to the chosen state are tried with
#: another order.
_NEAR_STATE = 1.5
#: Fraction of the time that a round must gain.
_MIN_GAIN = 5e-4
#: Fraction of the time that a change of the rolls must gain.
_MIN_ROLL_GAIN = 1e-3
#: rad: by round, the steps of rolls with which an order is searched as if each link had the rolls
#: that suit it best; 0 for the chosen rolls.
_ORDER_STEPS = (ROLL_STEPS[0], ROLL_STEPS[1], 0.0, ROLL_STEPS[2], 0.0)
#: Factor on the time of the best tour above which the first states of a new order are not refined,
#: for few points. For more points it is 1.
_HOPELESS_FACTOR = 1.03
#: rad: steps by which the rolls of the best tour are moved at the end.
_LAST_STEPS = (math.radians(0.7), math.radians(0.25))
#: Maximum number of times that states are chosen again because a link has no detour.
_MAX_REPEATS = 6
#: Maximum number of rounds of proof.
_MAX_PROOFS = 40


def are_points(problem: TourProblem, kept: Sequence[int]) -> bool:
    """Whether the items `kept` are searched as points.

    Each is entered and left at one position, they may come in any order, and there are `MIN_POINTS`
    to `MAX_POINTS` of them.
    """
    items, rules = list(kept), problem.rules
    if not problem.options.may_reorder or not problem.options.any_roll:
        return False
    if not MIN_POINTS <= len(items) <= MAX_POINTS:
        return False
    if (rules.parent[items] >= 0).any() or len(set(rules.rank[items].tolist())) > 1:
        return False
    has_one_gate = all(len(problem.cost_model.items[k].gates) == 1 for k in items)
    return has_one_gate and all(problem.states[k].branch.min() >= 0 for k in items)


def find_point_tour(
    problem: TourProblem, kept: Sequence[int], on_progress: OnProgress
) -> Solution | None:
    """Find the fastest tour through the points `kept`; None if no tour is found.

    Colliding states are removed from `problem`. Points without any other are added to its `lost`.
    """
    select_clear_states(problem, kept)
    order = [k for k in kept if k not in problem.lost]
    if len(order) < MIN_POINTS:
        return None
    known: KnownLinks = {}
    best: Solution | None = None
    for narrowed, first_order, states in _list_starts(problem, order):
        solution = _search(narrowed, first_order, states, known, on_progress)
        if solution is not None and (best is None or solution.seconds < best.seconds):
            best = solution
        if best is not None and best.seconds < FORBIDDEN and len(order) > _FEW_POINTS:
            break
    if best is None or best.seconds >= FORBIDDEN:
        return None
    return _prove(problem, best, known)


def _prove(problem: TourProblem, solution: Solution, known: KnownLinks) -> Solution | None:
    """Choose other states until no link or path collides between samples; None if that fails."""
    rejected: RejectedLinks = {}
    for _ in range(_MAX_PROOFS):
        if solution.seconds < FORBIDDEN and not find_blocked_paths(problem, solution):
            blocked = prove_links(problem, solution)
            if not blocked:
                return solution
            # Links next to a blocked one would collide as well.
            reject_links(problem, solution, blocked, rejected)
        states = add_shifted_rolls(problem, solution, ROLL_STEPS[-1])
        for k, shifted in enumerate(states):
            states[k] = join_states([shifted, _select_near(problem, solution.states, k)])
        chosen = choose_point_states(problem, solution.order, states, known, rejected)
        if chosen is None:
            return None
        solution = add_detours(problem, chosen)
    return None


def _list_starts(
    problem: TourProblem, order: list[int]
) -> Iterator[tuple[TourProblem, list[int], list[States]]]:
    """Yield the starts of the search: a problem, an order, and the states to choose from.

    The first has all states in the postures of the best divisions into blocks, the second the order
    and the postures of the best division.
    """
    divisions = find_blocks(problem, order, _MAX_DIVISIONS)
    branches: set[int] = set()
    for division in divisions:
        if division.seconds < divisions[0].seconds + _WORSE_DIVISION:
            branches.update(division.branches)
    states = list(problem.states)
    for k, of_item in enumerate(problem.states):
        in_branches = np.isin(of_item.branch, sorted(branches))
        if in_branches.any():
            states[k] = of_item.pick(in_branches)
    problem = replace(problem, states=states)
    yield problem, order, states
    if divisions:
        best = divisions[0]
        by_block = sorted(order, key=lambda k: best.branches.index(best.branch[k]))
        yield problem, by_block, narrow_states(problem, best)


def _search(
    problem: TourProblem,
    order: list[int],
    states: list[States],
    known: KnownLinks,
    on_progress: OnProgress,
) -> Solution | None:
    """Search from one start, in rounds of another order and other states; None without a tour."""
    first = choose_point_states(problem, order, states, known)
    if first is None:
        return None
    best, idle = add_detours(problem, first), 0
    max_idle = _IDLE_ROUNDS if len(order) <= _FEW_POINTS else _IDLE_ROUNDS - 1
    on_progress(f"joints, {best.seconds:.1f} s")
    for attempt in range(_ROUNDS):
        solution = _run_round(problem, best, known, attempt)
        on_progress(f"joints, {solution.seconds:.1f} s, round {attempt + 1}")
        if solution.seconds < best.seconds * (1 - _MIN_GAIN):
            best, idle = solution, 0
        else:
            idle += 1
        if idle >= max_idle:
            break
    refined = add_detours(problem, _refine(problem, best, known, _LAST_STEPS))
    return refined if refined.seconds < best.seconds else best


def _run_round(
    problem: TourProblem, solution: Solution, known: KnownLinks, attempt: int
) -> Solution:
    """Search another order, choose states for it, and refine their rolls.

    The time is infinite if the new order promises nothing.
    """
    step = _ORDER_STEPS[attempt % len(_ORDER_STEPS)]
    shifted = add_shifted_rolls(problem, solution, step or ROLL_STEPS[-1])
    for_order = shifted if step else solution.states.split()
    order = _reorder(problem, solution, for_order, known, attempt)
    if order in (solution.order, solution.order[::-1]) and not step:
        return Solution(order, solution.states, np.inf)
    at_change = _find_posture_changes(solution, order)
    states = []
    for k, near in enumerate(shifted):
        others = problem.states[k]
        if k not in at_change:
            others = _select_near(problem, solution.states, k)
        states.append(join_states([near, others]))
    chosen = choose_point_states(problem, order, states, known)
    factor = _HOPELESS_FACTOR if len(order) <= _FEW_POINTS else 1.0
    if chosen is None or chosen.seconds > factor * solution.seconds:
        return Solution(order, solution.states, np.inf)
    result = add_detours(problem, _refine(problem, chosen, known, ROLL_STEPS))
    for _ in range(_MAX_REPEATS):
        if result.seconds < FORBIDDEN:
            break
        again = choose_point_states(problem, order, states, known)
        if again is not None:
            result = add_detours(problem, again)
    return result


def _refine(
    problem: TourProblem, solution: Solution, known: KnownLinks, steps: Sequence[float]
) -> Solution:
    """Move the rolls by these steps, rad, one step size after the other, while that saves time."""
    for step in steps:
        while True:
            states = add_shifted_rolls(problem, solution, step)
            finer = choose_point_states(problem, solution.order, states, known)
            if finer is None:
                break
            saved = solution.seconds - finer.seconds
            if saved > 0:
                solution = finer
            if saved < _MIN_ROLL_GAIN * solution.seconds:
                break
    return solution


def _find_posture_changes(solution: Solution, order: Sequence[int]) -> set[int]:
    items = {order[0], order[-1]}
    for before, after in pairwise(order):
        if solution.states.branch[before] != solution.states.branch[after]:
            items |= {before, after}
    return items


def _select_near(problem: TourProblem, current: States, item: int) -> States:
    states = problem.states[item]
    return states.pick(np.abs(states.enter - current.enter[item]).max(axis=1) < _NEAR_STATE)


def _reorder(
    problem: TourProblem,
    solution: Solution,
    states: list[States],
    known: KnownLinks,
    attempt: int,
) -> list[int]:
    """Search the fastest order if each link may use any of `states` of both its items."""
    order, cost_model = solution.order, problem.cost_model
    limits, count = cost_model.limits, len(order)
    table = measure_fastest_links(cost_model, [states[k].enter for k in order])
    positions = np.array(
        [item.position[item.gates[0]] for item in take_rows(cost_model.items, order)]
    )
    distances = np.sqrt(((positions[:, None] - positions[None]) ** 2).sum(axis=-1))
    tip_seconds = time_from_rest(distances, limits.speed, limits.acceleration)
    branch = solution.states.branch[order]
    table[1:, 1:] = np.maximum(table[1:, 1:], tip_seconds)
    table[1:, 1:] += compute_posture_costs(cost_model, branch, branch)
    place = {-1: 0} | {k: row for row, k in enumerate(order, 1)}
    for (a, b), seconds in known.items():
        i, j = place[a], place[b]
        # If one link between two items has no detour, the others seldom have one.
        detour = problem.detour_seconds.get(make_pair_key(a, b), 0.0)
        cost = min(max(seconds, detour), _MAX_BLOCKED_COST)
        table[i, j] = table[j, i] = max(table[i, j], cost)
    ring = np.minimum(table, table.T)
    np.fill_diagonal(ring, 0.0)
    perturbations = (_LATER_PERTURBATIONS if attempt else _FIRST_PERTURBATIONS) * count
    return take_rows([-1, *order], shorten_ring(ring, range(count + 1), perturbations, attempt)[1:])
