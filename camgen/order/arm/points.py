"""A tour through points that may come in any order: blocks of one posture each, order and turns bettered in turn."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from msgspec.structs import replace

from camgen.motion.limits import time_from_rest
from camgen.order.arm.blocks import find_blocks, leave_clear, narrow_states
from camgen.order.arm.items import States, join_states
from camgen.order.arm.lattice import (
    Barred,
    Known,
    bar_links,
    choose_point_states,
    go_round,
    pair_key,
    prove_links,
)
from camgen.order.arm.layers import FORBIDDEN, change_cost
from camgen.order.arm.search import (
    STEPS,
    Solution,
    Tell,
    TourProblem,
    find_blocked_paths,
    measure_soonest_links,
    shift_turns,
)
from camgen.order.solver.ring import shorten_ring

#: More points than this are searched as paths are; the fewest that are worth it.
MOST, LEAST = 300, 5
#: s: what a link costs that is not a door, where there should be one.
_FAR = 12.0
#: Rounds, and those in a row that gain nothing.
_ROUNDS, _IDLE = 12, 4
#: Exchanges for each point in the first round and in later ones.
_KICKS, _LATER = 8, 4
#: Ways to part the points into blocks whose postures are used, and s by which they may be worse than the best of them.
_TRIED, _WORSE = 4, 1.5
#: So few points are also searched with one posture each to begin with, and longer.
_FEW = 120
#: rad or mm: states that are as near to that which is chosen are tried with another order.
_BESIDE = 1.5
_GAIN, _FINER = 5e-4, 1e-3
#: rad: steps of the turns with which an order is looked for as if every link had those that suit it best; 0: with the
#: turns as they are.
_ANY_ROLL_ROUNDS = (STEPS[0], STEPS[1], 0.0, STEPS[2], 0.0)
#: An order of few points whose first states take so many times as long as the best tour so far is left; of more points
#: one that takes longer.
_HOPELESS = 1.03
#: rad: steps in which the turns of the best tour are moved at last.
_LAST = (math.radians(0.7), math.radians(0.25))
#: So often states are chosen anew where no way round a link is found.
_AGAIN = 6
#: Rounds of proof.
_PROOFS = 40


def are_points(problem: TourProblem, kept: Sequence[int]) -> bool:
    """Whether the items ``kept`` are each entered and left at one place, may come in any order, and are neither too
    many nor too few to be searched as points.
    """
    some = list(kept)
    if (
        not problem.options.may_reorder
        or not problem.options.any_roll
        or not LEAST <= len(some) <= MOST
    ):
        return False
    if (problem.rules.parent[some] >= 0).any() or len(set(problem.rules.rank[some].tolist())) > 1:
        return False
    return all(
        len(problem.cost_model.items[k].gates) == 1 and problem.states[k].branch.min() >= 0
        for k in some
    )


def find_points(problem: TourProblem, kept: Sequence[int], tell: Tell) -> Solution | None:
    """The soonest tour that is found through the points ``kept``; None where there is none.

    Leaves out the states that collide, as ``problem.lost`` tells the points that have none.
    """
    leave_clear(problem, kept)
    order = [k for k in kept if k not in problem.lost]
    if len(order) < LEAST:
        return None
    known: Known = {}
    best: Solution | None = None
    for narrow, begun, states in _begin(problem, order):
        found = _search(narrow, begun, states, known, tell)
        if found is not None and (best is None or found.seconds < best.seconds):
            best = found
        if best is not None and best.seconds < FORBIDDEN and len(order) > _FEW:
            break
    if best is None or best.seconds >= FORBIDDEN:
        return None
    return _prove(problem, best, known)


def _prove(problem: TourProblem, solution: Solution, known: Known) -> Solution | None:
    """``solution`` with other states where its links or paths collide between the places that were looked at."""
    barred: Barred = {}
    for _ in range(_PROOFS):
        if solution.seconds < FORBIDDEN and not find_blocked_paths(problem, solution):
            bad = prove_links(problem, solution)
            if not bad:
                return solution
            # The one beside it would graze as well.
            bar_links(problem, solution, bad, barred)
        states = [
            join_states([own, _near(problem, solution.states, k)])
            for k, own in enumerate(shift_turns(problem, solution, STEPS[-1]))
        ]
        made = choose_point_states(problem, solution.order, states, known, barred)
        if made is None:
            return None
        solution = go_round(problem, made)
    return None


def _begin(
    problem: TourProblem, order: list[int]
) -> Iterator[tuple[TourProblem, list[int], list[States]]]:
    """What the search begins with: orders, and the states to choose from: those of the postures that promise most,
    then those of one posture each.
    """
    found = find_blocks(problem, order, _TRIED)
    found = [one for one in found if one.seconds < found[0].seconds + _WORSE]
    some = sorted({b for one in found for b in one.branches})
    own = [one.pick(np.isin(one.branch, some)) if found else one for one in problem.states]
    own = [one if len(one) else other for one, other in zip(own, problem.states, strict=True)]
    problem = replace(problem, states=own)
    yield problem, order, own
    if found:
        rank = {b: k for k, b in enumerate(found[0].branches)}
        yield (
            problem,
            sorted(order, key=lambda k: rank[found[0].branch[k]]),
            narrow_states(problem, found[0]),
        )


def _search(
    problem: TourProblem, order: list[int], states: list[States], known: Known, tell: Tell
) -> Solution | None:
    best = choose_point_states(problem, order, states, known)
    if best is None:
        return None
    best, idle = go_round(problem, best), 0
    tell(f"joints, {best.seconds:.1f} s")
    for attempt in range(_ROUNDS):
        made = _round(problem, best, known, attempt)
        tell(f"joints, {made.seconds:.1f} s, round {attempt + 1}")
        if made.seconds < best.seconds * (1 - _GAIN):
            best, idle = made, 0
        else:
            idle += 1
        if idle >= (_IDLE if len(order) <= _FEW else _IDLE - 1):
            break
    fine = go_round(problem, _refine(problem, best, known, _LAST))
    return fine if fine.seconds < best.seconds else best


def _round(problem: TourProblem, solution: Solution, known: Known, attempt: int) -> Solution:
    """Another order, states for it, and finer turns."""
    step = _ANY_ROLL_ROUNDS[attempt % len(_ANY_ROLL_ROUNDS)]
    fine = shift_turns(problem, solution, step or STEPS[-1])
    order = _reorder(problem, solution, fine if step else solution.states.split(), known, attempt)
    if order in (solution.order, solution.order[::-1]) and not step:
        return Solution(order, solution.states, np.inf)
    turning = _find_turning(solution, order)
    states = [
        join_states(
            [own, problem.states[k] if k in turning else _near(problem, solution.states, k)]
        )
        for k, own in enumerate(fine)
    ]
    made = choose_point_states(problem, order, states, known)
    if made is None or made.seconds > (_HOPELESS if len(order) <= _FEW else 1.0) * solution.seconds:
        return Solution(order, solution.states, np.inf)
    made = go_round(problem, _refine(problem, made, known, STEPS))
    for _ in range(_AGAIN):
        if made.seconds < FORBIDDEN:
            break
        again = choose_point_states(problem, order, states, known)
        made = made if again is None else go_round(problem, again)
    return made


def _refine(
    problem: TourProblem, solution: Solution, known: Known, steps: Sequence[float]
) -> Solution:
    """``solution`` with turns moved in finer and finer steps."""
    for step in steps:
        while True:
            finer = choose_point_states(
                problem, solution.order, shift_turns(problem, solution, step), known
            )
            gained = 0.0 if finer is None else solution.seconds - finer.seconds
            if finer is not None and gained > 0:
                solution = finer
            if gained < _FINER * solution.seconds:
                break
    return solution


def _find_turning(solution: Solution, order: Sequence[int]) -> set[int]:
    """The items beside home, or beside another posture."""
    branch = solution.states.branch
    pairs = {k for pair in pairwise(order) if branch[pair[0]] != branch[pair[1]] for k in pair}
    return pairs | {order[0], order[-1]}


def _near(problem: TourProblem, current: States, item: int) -> States:
    """The states of an item that are near to that which is chosen, and some of all others."""
    states = problem.states[item]
    return states.pick(np.abs(states.enter - current.enter[item]).max(axis=1) < _BESIDE)


def _reorder(
    problem: TourProblem, solution: Solution, fine: list[States], known: Known, attempt: int
) -> list[int]:
    """The order in which the points would be soonest gone through if each link had the turns of ``fine`` that suit it
    best.
    """
    order, cost_model = solution.order, problem.cost_model
    count = len(order)
    table = measure_soonest_links(cost_model, [fine[k].enter for k in order])
    at = np.array([cost_model.items[k].position[cost_model.items[k].gates[0]] for k in order])
    way = np.sqrt(((at[:, None] - at[None]) ** 2).sum(axis=-1))
    table[1:, 1:] = np.maximum(
        table[1:, 1:], time_from_rest(way, cost_model.limits.speed, cost_model.limits.acceleration)
    )
    table[1:, 1:] += change_cost(
        cost_model, solution.states.branch[order], solution.states.branch[order]
    )
    place = {-1: 0} | {k: row for row, k in enumerate(order, 1)}
    for (a, b), seconds in known.items():
        i, j = place[a], place[b]
        # Where no way round one of their links was found, others of theirs seldom have one.
        more = problem.around.get(pair_key(a, b), 0.0)
        table[i, j] = table[j, i] = max(table[i, j], min(max(seconds, more), _FAR))
    ring = np.minimum(table, table.T)
    np.fill_diagonal(ring, 0.0)
    kicks = (_LATER if attempt else _KICKS) * count
    made = shorten_ring(ring, range(count + 1), kicks, attempt)
    return [order[k - 1] for k in made[1:]]
