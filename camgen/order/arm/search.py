"""Searches order, direction, seam, posture and roll of all paths together, by the joints' time.

States and order are searched alternately: the states of a tour by dynamic programming (`layers`),
its order by a local search over the links of the chosen states. If the roll is free, rolls are then
moved in finer and finer steps. States and links are tested for collisions only when a tour uses
them. If one collides, it is removed and the states are chosen again.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence, Set
from functools import partial
from itertools import chain, pairwise

import numpy as np
from msgspec import Struct, field

from camgen.geometry.ragged import compute_offsets, count_rows, list_owners, number_rows
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray
from camgen.model.sequences import find_first_places, take_rows
from camgen.motion.setup import Blockage, FreeSpace, SampledMotion, Setup
from camgen.order.arm.detours import find_detour
from camgen.order.arm.items import (
    StateJoints,
    States,
    choose_each,
    compute_state_joints,
    join_states,
    reverse_states,
    select_states,
)
from camgen.order.arm.layers import (
    FORBIDDEN,
    SAME,
    BlockedLink,
    CostModel,
    add_blocked_costs,
    choose_fastest_states,
    compute_gate_positions,
    compute_posture_costs,
    time_links_home,
)
from camgen.order.solver import matrix
from camgen.order.solver.ring import shorten_ring
from camgen.robots.kinematics.forward import compute_flange

#: Maximum number of paths whose order is searched; more keep the order by length.
MAX_REORDERED = 1_000
#: Maximum number of rounds of states and order.
_ROUNDS = 8
#: Fraction of the time that a round must gain, otherwise it is the last.
_MIN_GAIN = 1e-3
#: rad: steps by which rolls are moved, from coarse to fine.
ROLL_STEPS = (math.radians(5.0), math.radians(2.0), math.radians(0.7))
#: Steps to each side.
_STEPS_TO_EACH_SIDE = 4
#: Samples of a tour above which its rolls are not moved, because that takes too long.
_MAX_ROLL_SAMPLES = 8_000
#: Samples of a path at which a state is first tested, before any tour uses it.
_FIRST_SAMPLES = 6
#: Links whose ends are within this fraction of the largest joint motion of a blocked link are
#: blocked too.
_NEAR_FRACTION = 0.15
#: The same for a link of `_LONG_MOTION` or more.
_LONG_NEAR_FRACTION = 0.35
#: rad or mm: joint motion of a link from which a detour is searched at once. The states of shorter
#: links are changed first.
_LONG_MOTION = 1.0
#: Maximum number of first tours, each without the links that collide on the one before.
_FIRST_TOURS = 12
#: Rounds of repair. Links that still collide then get a detour.
_REPAIRS = 8
#: Maximum number of new orders for which each link has the rolls that suit it best.
_ANY_ROLL_ROUNDS = 3
#: rad: largest joint motion between two samples of a link, before it is proved.
_SAMPLE_STEP = math.radians(2.5)
#: Fraction of the usual perturbations in the search for an order.
_EFFORT = 0.3
#: Paths above which the search for an order has no perturbations.
_MAX_PERTURBED = 300
#: Perturbations of the order for each item.
_PERTURBATIONS = 6
#: Maximum number of perturbations.
_MAX_PERTURBATIONS = 4_000


class SearchOptions(Struct, frozen=True):
    """The changes that a search may make.

    may_reorder: whether the order of the items may change.
    any_roll: whether every roll is as good, so that rolls are moved in fine steps.
    least_height: minimum height of the TCP on a link, mm in the work frame.
    """

    may_reorder: bool
    any_roll: bool
    least_height: float


class TourProblem(Struct, frozen=True, eq=False):
    """The problem of a tour search, and the results of all tests so far. The search adds to them.

    setup: the arm, and the collision test of joint values.
    free_space: the collision test of motions.
    cost_model: the items, and the time of their links.
    states: states of each item; reduced if states collide, see `tested`.
    rules: the precedence of the items.
    options: allowed changes.
    tested: items whose states were reduced to those that do not collide.
    blocked_links: links that collide.
    free: keys of links and states that are known to be clear.
    lost: items of which every state collides.
    colliding: keys of links and states that collide between the samples of a first test.
    detours: joint values (J,) to pass through on a blocked link, by the bytes of its ends.
    detour_seconds: time that a detour takes longer than its link, s, by key.
    """

    setup: Setup
    free_space: FreeSpace
    cost_model: CostModel
    states: list[States]
    rules: matrix.Rules
    options: SearchOptions
    tested: set[int] = field(default_factory=set)
    blocked_links: list[BlockedLink] = field(default_factory=list)
    free: set[bytes] = field(default_factory=set)
    lost: set[int] = field(default_factory=set)
    colliding: set[bytes] = field(default_factory=set)
    detours: dict[bytes, tuple[FloatArray, ...]] = field(default_factory=dict)
    detour_seconds: dict[bytes, float] = field(default_factory=dict)


class Solution(Struct, eq=False):
    """A tour.

    order: items in the order in which they are run.
    states: (n,) the state of each item, by item.
    seconds: time of its links, s.
    """

    order: list[int]
    states: States
    seconds: float


#: A callback that gets the progress of a search, which it may stop by an exception.
OnProgress = Callable[[str], None]


def find_tour(
    problem: TourProblem, order: Sequence[int], prove: bool, on_progress: OnProgress
) -> Solution:
    """Find a first tour in this order.

    prove: whether states and links are tested for collisions.
    """
    solution = choose_states(problem, list(order), list(problem.states), prove)
    for attempt in range(_FIRST_TOURS if prove else 0):
        on_progress(f"joints, {solution.seconds:.1f} s, beginning {attempt + 1}")
        if not solution.order or not learn_blocked_links(problem, solution):
            break
        solution = choose_states(problem, solution.order, list(problem.states), prove)
    return solution


def improve_tour(
    problem: TourProblem, solution: Solution, prove: bool, on_progress: OnProgress
) -> Solution:
    """Improve states and order of a tour alternately."""
    solution = improve_rolls(problem, solution, prove)
    for _ in range(_ANY_ROLL_ROUNDS if problem.options.may_reorder else 0):
        any_roll = improve_rolls(problem, _order_for_any_roll(problem, solution, prove), prove)
        if any_roll.seconds >= solution.seconds:
            break
        solution = any_roll
    for attempt in range(_ROUNDS):
        on_progress(f"joints, {solution.seconds:.1f} s, round {attempt + 1}")
        before = solution.seconds
        solution = _move_gates(problem, solution)
        if problem.options.may_reorder:
            solution = _reorder(problem, solution, attempt)
        solution = improve_rolls(problem, solution, prove)
        if before - solution.seconds < _MIN_GAIN * before:
            break
    return solution


def choose_states(
    problem: TourProblem,
    order: list[int],
    states: list[States],
    prove: bool,
    known: States | None = None,
) -> Solution:
    """Choose one state per item so that the tour takes least time and no state collides.

    Items of which every state collides are left out, and added to `problem.lost`.

    prove: whether states are tested for collisions.
    known: (n) a state of each item that needs no test.
    """
    cost_model = problem.cost_model
    while True:
        cost, chosen = choose_fastest_states(cost_model, order, states, problem.blocked_links)
        current = choose_each(states, chosen)
        untested = [k for k in order if prove and not _is_known(problem, current, known, k)]
        tested_states = current.pick(np.array(untested, dtype=np.int64))
        collides = find_colliding_states(problem, untested, tested_states)
        if not collides.any():
            return Solution(order, current, cost)
        to_reduce = [(k, states[k], int(chosen[k])) for k in np.array(untested)[collides].tolist()]
        for (k, _, _), kept in zip(to_reduce, _remove_colliding(problem, to_reduce), strict=True):
            if not len(kept):
                problem.lost.add(k)
                order = [item for item in order if item != k]
            states[k] = kept if len(kept) else current.single(k)
        if not order:
            return Solution(order, current, 0.0)


def _is_known(problem: TourProblem, current: States, known: States | None, item: int) -> bool:
    branch, roll = current.branch[item], current.roll[item]
    if known is not None and known.roll[item] == roll and known.branch[item] == branch:
        return True
    return bool(branch < 0 or make_state_key(current, item) in problem.free)


def make_state_key(states: States, row: int, item: int | None = None) -> bytes:
    """The key of a state of an item, the same for all whole turns and gates.

    item: index of the item; `row` if it is None.
    """
    return b"%d:%d:%.6f" % (row if item is None else item, states.branch[row], states.roll[row])


def make_state_keys(states: States, item_indices: Sequence[int]) -> list[bytes]:
    """The keys of states (E,) of the items with these indices (E,)."""
    return [make_state_key(states, row, item) for row, item in enumerate(item_indices)]


def _compute_state_joints(
    problem: TourProblem, item_indices: Sequence[int], states: States
) -> StateJoints:
    items = take_rows(problem.cost_model.items, item_indices)
    closed = np.array([item.closed for item in items], dtype=np.bool_)
    forward = closed | (states.gate[:, 0] == 0)
    near = np.where(forward[:, None], states.enter, states.leave)
    gate = np.where(closed, states.gate[:, 0], 0)
    return compute_state_joints(problem.setup, items, states.roll, states.branch, gate, near)


def find_colliding_states(
    problem: TourProblem, item_indices: Sequence[int], states: States, max_samples: int = 0
) -> BoolArray:
    """Which of E states, of the items with these indices (E,), collide or cannot be run.

    max_samples: samples of each state that are tested; 0 for all.
    """
    if not len(item_indices):
        return np.zeros(0, dtype=np.bool_)
    # States that differ by whole turns or gates have one key, and are tested once.
    keys = make_state_keys(states, item_indices)
    first_row = find_first_places(keys)
    rows = list(first_row.values())
    items = take_rows(item_indices, rows)
    collides = _test_states(problem, items, states.pick(np.array(rows)), max_samples)
    result = dict(zip(first_row, collides.tolist(), strict=True))
    if not max_samples:
        problem.free.update(key for key, is_colliding in result.items() if not is_colliding)
    return np.array([result[key] or key in problem.colliding for key in keys], dtype=np.bool_)


def _test_states(
    problem: TourProblem, item_indices: Sequence[int], states: States, max_samples: int
) -> BoolArray:
    state_joints = _compute_state_joints(problem, item_indices, states)
    collides = ~state_joints.is_valid
    samples = []
    valid = np.flatnonzero(state_joints.is_valid)
    for k in valid.tolist():
        rows = np.arange(state_joints.first[k], state_joints.first[k + 1])
        if max_samples and len(rows) > max_samples:
            chosen = np.round(np.linspace(0, len(rows) - 1, max_samples)).astype(np.int64)
            rows = rows[np.unique(chosen)]
        # A path at the clearance height has the samples of its gates twice.
        moved = np.abs(np.diff(state_joints.joints[rows], axis=0)).max(axis=1) > 0
        samples.append(rows[np.append(moved, True)])
    if not samples:
        return collides
    flat = np.concatenate(samples)
    owner = np.repeat(valid, count_rows(samples))
    # The last sample first: a state that collides there is not tested again.
    is_last = np.append(owner[1:] != owner[:-1], True)
    for group in (is_last, ~is_last):
        tested = np.flatnonzero(group & ~collides[owner])
        collides[owner[tested[~problem.setup.clear(state_joints.joints[flat[tested]])]]] = True
    return collides


def _remove_colliding(
    problem: TourProblem, to_reduce: Sequence[tuple[int, States, int]]
) -> list[States]:
    """The states of items without the chosen one, which collides, and without others that do.

    Others are tested at `_FIRST_SAMPLES` samples.

    to_reduce: an item, its states, and the index of the chosen one.
    """
    kept = []
    for _, states, chosen in to_reduce:
        same = (states.branch == states.branch[chosen]) & (states.roll == states.roll[chosen])
        kept.append(states.pick(~same))
    pending: list[int] = []
    items: list[int] = []
    for place, (item, states, _) in enumerate(to_reduce):
        if item not in problem.tested or states is not problem.states[item]:
            pending.append(place)
            items += [item] * len(kept[place])
    if items:
        of_pending = take_rows(kept, pending)
        others = join_states(of_pending)
        keys = make_state_keys(others, items)
        is_free = np.array([key in problem.free for key in keys], dtype=np.bool_)
        tested = np.flatnonzero(~is_free & (others.branch >= 0))
        collides = np.zeros(len(items), dtype=np.bool_)
        collides[tested] = find_colliding_states(
            problem, take_rows(items, tested), others.pick(tested), _FIRST_SAMPLES
        )
        for place, states in zip(pending, select_states(of_pending, ~collides), strict=True):
            kept[place] = states
    for (item, states, chosen), remaining in zip(to_reduce, kept, strict=True):
        if states is problem.states[item]:
            problem.tested.add(item)
            # A lost item keeps a state for the tables, and is in no order.
            problem.states[item] = remaining if len(remaining) else states.single(chosen)
    return kept


def _order_for_any_roll(problem: TourProblem, solution: Solution, prove: bool) -> Solution:
    """Search a new order in which each link uses the rolls that make it fastest.

    The states of a solution fit its order, so a search over them favours that order. Here the time
    between two items is the minimum over all rolls near the present ones. Returns `solution` itself
    unless the roll is free, all items are points without precedence, and there are 5 to
    `_MAX_PERTURBED` of them.
    """
    order, cost_model, current = solution.order, problem.cost_model, solution.states
    if not problem.options.any_roll or not 4 < len(order) <= _MAX_PERTURBED:
        return solution
    if not _are_free_points(problem, solution):
        return solution
    shifted = add_shifted_rolls(problem, solution, ROLL_STEPS[0])
    ring = measure_fastest_links(cost_model, [shifted[k].enter for k in order])
    np.fill_diagonal(ring, 0.0)
    branch = current.branch[order]
    ring[1:, 1:] += compute_posture_costs(cost_model, branch, branch)
    return choose_states(problem, _order_ring(ring, order, 0)[0], shifted, prove, current)


def _order_ring(table: FloatArray, order: list[int], seed: int) -> tuple[list[int], float]:
    """Search an order of the items of `order` by their times in both directions, home first.

    Returns it with its time, s.
    """
    ring = np.minimum(table, table.T)
    perturbations = min(_PERTURBATIONS * len(order), _MAX_PERTURBATIONS)
    stops = shorten_ring(ring, range(len(ring)), perturbations, seed)
    seconds = float(ring[stops, np.roll(stops, -1)].sum())
    return take_rows([-1, *order], stops[1:]), seconds


def measure_fastest_links(cost_model: CostModel, joints: Sequence[FloatArray]) -> FloatArray:
    """Times (n + 1, n + 1) of the fastest link between any states of two points, s, home first.

    joints: joint values (M, J) of the states of each of n points.
    """
    first = compute_offsets(count_rows(joints))
    all_joints = np.concatenate(joints)
    table = np.zeros((len(first), len(first)))
    for k, rows in enumerate(joints, 1):
        seconds = cost_model.limits.between(rows, all_joints, 0.0).min(axis=0)
        table[k, 1:] = np.minimum.reduceat(seconds, first[:-1])
        table[k, 0] = table[0, k] = cost_model.limits.seconds(rows - cost_model.home, 0.0).min()
    return table


def _are_free_points(problem: TourProblem, solution: Solution) -> bool:
    """Whether all items are left at the point where they are entered, and may come in any order."""
    states = solution.states.pick(np.array(solution.order))
    parent, rank = problem.rules.parent[solution.order], problem.rules.rank[solution.order]
    is_free = (parent < 0).all() and len(set(rank.tolist())) == 1
    return bool(is_free and not (states.enter != states.leave).any())


def improve_rolls(
    problem: TourProblem, solution: Solution, prove: bool, fixed: Set[int] = frozenset()
) -> Solution:
    """Move the rolls of all items but `fixed` in finer and finer steps while that saves time."""
    sizes = count_rows(take_rows(problem.cost_model.items, solution.order))
    if not problem.options.any_roll or sizes.sum() > _MAX_ROLL_SAMPLES:
        return solution
    for step in ROLL_STEPS:
        while True:
            states = add_shifted_rolls(problem, solution, step, fixed)
            better = choose_states(problem, solution.order, states, prove, solution.states)
            saved = solution.seconds - better.seconds
            solution = better if saved > 0 else solution
            if saved < _MIN_GAIN * solution.seconds:
                break
    return solution


def add_shifted_rolls(
    problem: TourProblem, solution: Solution, step: float, fixed: Set[int] = frozenset()
) -> list[States]:
    """The states of each item: the present one and, for all but `fixed`, some with rolls near it.

    step: difference of neighbouring rolls, rad.
    """
    current = solution.states
    shifted = [k for k in solution.order if current.branch[k] >= 0 and k not in fixed]
    one_side = np.arange(1, _STEPS_TO_EACH_SIDE + 1)
    shifts = step * np.append(-one_side[::-1], one_side)
    owner = np.repeat(shifted, len(shifts))
    roll = current.roll[owner] + np.tile(shifts, len(shifted))
    roll = np.remainder(roll + math.pi, math.tau) - math.pi
    wanted = current.pick(owner)
    wanted = States(wanted.enter, wanted.leave, wanted.gate, roll, wanted.branch)
    placed, is_valid = _replace_joints(problem, owner.tolist(), wanted)
    # A state to which the joints jump is not a shifted one; the search has it anyway.
    moved = np.abs(placed.enter - current.enter[owner]).max(axis=1, initial=0.0)
    is_valid &= moved < 4 * _STEPS_TO_EACH_SIDE * step + math.radians(10)
    states = current.split()
    for place, k in enumerate(shifted):
        rows = np.arange(place * len(shifts), (place + 1) * len(shifts))
        states[k] = join_states([states[k], placed.pick(rows[is_valid[rows]])])
    return states


def _replace_joints(
    problem: TourProblem, item_indices: Sequence[int], states: States
) -> tuple[States, BoolArray]:
    """The states with joint values computed from their rolls, and which of them are valid."""
    if not len(item_indices):
        return states, np.zeros(0, dtype=np.bool_)
    state_joints = _compute_state_joints(problem, item_indices, states)
    rows = []
    for k, gate, first in zip(item_indices, states.gate, state_joints.first, strict=False):
        rows.append(problem.cost_model.items[k].gates[gate] + first)
    joints = state_joints.joints[np.array(rows)]
    is_valid = state_joints.is_valid & np.isfinite(joints).all(axis=(1, 2))
    return States(joints[:, 0], joints[:, 1], states.gate, states.roll, states.branch), is_valid


def _move_gates(problem: TourProblem, solution: Solution) -> Solution:
    """Choose the best gates for the same order, postures and rolls."""
    current = solution.states
    states = current.split()
    for k in solution.order:
        item = problem.cost_model.items[k]
        if item.reversible:
            states[k] = join_states([states[k], reverse_states(states[k])])
        elif item.closed and len(item.gates) > 1 and current.branch[k] >= 0:
            joints = _compute_state_joints(problem, [k], states[k]).joints[item.gates]
            gates, count = np.arange(len(joints)), len(joints)
            roll, branch = np.full(count, current.roll[k]), np.full(count, current.branch[k])
            at_gates = States(joints, joints, np.stack([gates] * 2, axis=1), roll, branch)
            states[k] = join_states([states[k], at_gates])
    return choose_states(problem, solution.order, states, False)


def _reorder(problem: TourProblem, solution: Solution, seed: int) -> Solution:
    """Search a shorter order of the chosen states; `solution` itself if none is found."""
    order, current, cost_model = solution.order, solution.states, problem.cost_model
    count = len(order)
    if not 2 < count <= MAX_REORDERED:
        return solution
    states = current.pick(np.array(order))
    is_reversible = np.array([cost_model.items[k].reversible for k in order])
    table = _make_table(problem, order, states)
    # An item that cannot be reversed is not left where it is entered, nor entered where it is left.
    fixed = ~is_reversible & (np.abs(states.enter - states.leave).max(axis=1) > 0)
    table.between[fixed, 0] = table.between[:, :, fixed, 1] = FORBIDDEN
    table.first[fixed, 1] = table.last[fixed, 0] = FORBIDDEN
    if _are_free_points(problem, solution):
        ring = np.zeros((count + 1, count + 1))
        ring[1:, 1:] = table.between[:, 0, :, 0]
        ring[0, 1:] = ring[1:, 0] = table.first[:, 0]
        new_order, seconds = _order_ring(ring, order, seed)
        better = Solution(new_order, current, seconds)
        return better if seconds < solution.seconds - 1e-9 else solution
    rules = matrix.Rules(_index_parents(problem.rules.parent, order), problem.rules.rank[order])
    has_rules = (rules.parent >= 0).any() or len(set(rules.rank.tolist())) != 1
    start = (list(range(count)), [False] * count)
    effort = _EFFORT if count <= _MAX_PERTURBED else 0.0
    items, backs = matrix.shortest(table, seed, effort, start, rules if has_rules else None)
    seconds = matrix.total(table, items, backs)
    if seconds >= solution.seconds - 1e-9:
        return solution
    reversed_items = np.zeros(len(current), dtype=np.bool_)
    reversed_items[np.array(order)[items]] = np.array(backs) & is_reversible[items]
    enter, leave, gate = current.enter.copy(), current.leave.copy(), current.gate.copy()
    enter[reversed_items] = current.leave[reversed_items]
    leave[reversed_items] = current.enter[reversed_items]
    gate[reversed_items] = current.gate[reversed_items][:, ::-1]
    states = States(enter, leave, gate, current.roll, current.branch)
    return Solution(take_rows(order, items), states, seconds)


def _index_parents(parent: IntArray, order: Sequence[int]) -> IntArray:
    """The parent of each item of `order`, as an index into `order`; -1 for none."""
    place = np.full(len(parent) + 1, -1)
    place[list(order)] = np.arange(len(order))
    return np.asarray(place[parent[list(order)]])


def _make_table(problem: TourProblem, order: Sequence[int], states: States) -> matrix.Table:
    """The times of all links between the ends of the items, and from and to home, s."""
    cost_model, count = problem.cost_model, len(order)
    ends = np.stack([states.enter, states.leave], axis=1).reshape(2 * count, -1)
    positions = [
        compute_gate_positions(cost_model.items[k], states.gate[i]) for i, k in enumerate(order)
    ]
    tips = np.stack(positions, axis=0).reshape(2 * count, 3)
    branch = np.repeat(states.branch, 2)
    distances = np.linalg.norm(tips[:, None] - tips[None], axis=-1)
    table = cost_model.limits.between(ends, ends, distances)
    table += compute_posture_costs(cost_model, branch, branch)
    table = add_blocked_costs(table, ends, ends, problem.blocked_links)
    home = time_links_home(cost_model, ends, problem.blocked_links).reshape(count, 2)
    return matrix.Table(table.reshape(count, 2, count, 2), home, home.copy())


# Proof of the paths and links that a tour uses.


def prove_tour(problem: TourProblem, solution: Solution, on_progress: OnProgress) -> Solution:
    """Choose other states where paths or links of a tour collide, in at most `_REPAIRS` rounds."""
    for attempt in range(_REPAIRS if solution.order else 0):
        blocked = find_blocked_paths(problem, solution) | learn_blocked_links(problem, solution)
        if not blocked:
            return solution
        on_progress(f"joints, {solution.seconds:.1f} s, repair {attempt + 1}")
        solution = _repair(problem, solution, blocked)
    return solution


def _repair(problem: TourProblem, solution: Solution, blocked: set[int]) -> Solution:
    """Choose states again for the items of `blocked` and their neighbours in the tour."""
    order, current = solution.order, solution.states
    affected = set()
    for before, item, after in zip([-1, *order[:-1]], order, [*order[1:], -1], strict=True):
        if not blocked.isdisjoint((before, item, after)):
            affected.add(item)
    states = current.split()
    if problem.options.any_roll:
        states = add_shifted_rolls(problem, solution, ROLL_STEPS[0])
    for k, near_current in enumerate(states):
        if k in affected and len(problem.states[k]):
            states[k] = join_states([near_current, problem.states[k]])
        else:
            states[k] = current.single(k)
    return choose_states(problem, order, states, True)


def find_blocked_paths(problem: TourProblem, solution: Solution) -> set[int]:
    """Find the items whose states collide between two samples; proved ones are not tested again."""
    states = solution.states
    untested = []
    for k in solution.order:
        if states.branch[k] >= 0 and _make_proof_key(states, k) not in problem.free:
            untested.append(k)
    if not untested:
        return set()
    state_joints = _compute_state_joints(problem, untested, states.pick(np.array(untested)))
    motions, owner = [], []
    for place, k in enumerate(untested):
        joints = state_joints.joints[state_joints.first[place] : state_joints.first[place + 1]]
        item = problem.cost_model.items[k]
        motions.append(SampledMotion(joints[: item.last + 1]))
        for gate in item.gates[1:].tolist():
            motions.append(SampledMotion(joints[[item.before[gate], gate]]))
        owner += [k] * len(item.gates)
    results = problem.free_space.look(motions)
    blocked = {k for k, result in zip(owner, results, strict=True) if isinstance(result, Blockage)}
    keys = [make_state_key(states, k) for k in blocked]
    problem.colliding.update(keys)
    problem.free.difference_update(keys)
    problem.free.update(_make_proof_key(states, k) for k in untested if k not in blocked)
    return blocked


def _make_proof_key(current: States, item: int) -> bytes:
    return b"path " + make_state_key(current, item)


def learn_blocked_links(problem: TourProblem, solution: Solution) -> set[int]:
    """Test the untested links of a tour, and add those that are blocked to `problem`.

    A link on which the TCP comes too low is blocked as well. Returns the items at the ends of
    blocked links.
    """
    untested, links = [], []
    for pair in zip([-1, *solution.order], [*solution.order, -1], strict=True):
        link = get_link_ends(problem, solution.states, pair)
        is_tested = make_link_key(*link) in problem.free
        if not is_tested and find_known_detour(problem, *link) is None:
            untested.append(pair)
            links.append(link)
    blocked_items: set[int] = set()
    blocked = find_blocked_links(problem, links)
    for pair, link, is_blocked in zip(untested, links, blocked, strict=True):
        if is_blocked:
            problem.blocked_links.append(make_blocked_link(problem, *link, _LONG_MOTION))
            blocked_items.update(item for item in pair if item >= 0)
    return blocked_items


def get_link_ends(
    problem: TourProblem, current: States, pair: tuple[int, int]
) -> tuple[FloatArray, FloatArray]:
    """Joint values (J,) at both ends of the link between two items, -1 for home."""
    home, (a, b) = problem.cost_model.home, pair
    return (home if a < 0 else current.leave[a], home if b < 0 else current.enter[b])


def find_blocked_links(
    problem: TourProblem, links: Sequence[tuple[FloatArray, FloatArray]], prove: bool = True
) -> list[bool]:
    """Which joint motions collide, or lead the TCP too low.

    prove: whether links that are clear at their samples are proved, and kept as clear.
    """
    blocked = np.array([make_link_key(*pair) not in problem.free for pair in links], dtype=np.bool_)
    untested = np.flatnonzero(blocked)
    if not len(untested):
        return [False] * len(links)
    collides = find_colliding_links(problem, take_rows(links, untested.tolist()))
    blocked[untested] = collides
    unproved = untested[~collides]
    if prove and len(unproved):
        motions = [SampledMotion(np.stack(links[k])) for k in unproved.tolist()]
        results = problem.free_space.look(motions)
        blocked[unproved] = [isinstance(result, Blockage) for result in results]
        problem.free.update(make_link_key(*links[k]) for k in unproved[~blocked[unproved]].tolist())
    return list(blocked.tolist())


def find_colliding_links(
    problem: TourProblem, links: Sequence[tuple[FloatArray, FloatArray]], coarse: bool = False
) -> BoolArray:
    """Which joint motions collide at a sample, or lead the TCP below `SearchOptions.least_height`.

    coarse: only every eighth sample is tested.
    """
    samples = []
    for a, b in links:
        count = max(math.ceil(float(np.abs(b - a).max()) / _SAMPLE_STEP), 2)
        samples.append(a + np.linspace(0.0, 1.0, count + 1)[:, None] * (b - a))
    counts = count_rows(samples)
    owner, step = list_owners(counts), number_rows(counts)
    flat = np.concatenate(samples)
    collides = np.zeros(len(links), dtype=np.bool_)
    if math.isfinite(problem.options.least_height):
        rotation, origin = compute_flange(problem.setup.robot, flat)
        tip = origin + rotation @ np.asarray(problem.setup.flange_from_tool.origin)
        base = problem.setup.base_from_work
        height = (tip - np.asarray(base.origin)) @ base.rotation[:, 2]
        collides[owner[height < problem.options.least_height]] = True
    # Every eighth sample first: most motions that collide do so over a long section.
    for group in (step % 8 == 4,) if coarse else (step % 8 == 4, step % 8 != 4):
        tested = np.flatnonzero(group & ~collides[owner])
        collides[owner[tested[~problem.setup.clear(flat[tested])]]] = True
    return collides


def make_link_key(a: FloatArray, b: FloatArray) -> bytes:
    """The key of a joint motion, the same in both directions."""
    ends = sorted([np.round(a, 6).tobytes(), np.round(b, 6).tobytes()])
    return b"link " + ends[0] + ends[1]


def make_blocked_link(
    problem: TourProblem, a: FloatArray, b: FloatArray, min_motion: float
) -> BlockedLink:
    """A blocked link with the cost of its detour, which is added to `problem.detours`.

    min_motion: largest joint motion from which a detour is searched, rad or mm.
    """
    motion = float(np.abs(b - a).max())
    fraction = _NEAR_FRACTION if motion < _LONG_MOTION else _LONG_NEAR_FRACTION
    radius = max(fraction * motion, SAME)
    if motion < min_motion:
        return BlockedLink(a, b, radius, FORBIDDEN)
    limits, home = problem.cost_model.limits, problem.cost_model.home
    known = chain.from_iterable(problem.detours.values())
    detour = find_detour(
        problem.setup.robot,
        limits,
        (a, b),
        np.stack([home, *known]),
        problem.setup.clear,
        partial(find_blocked_links, problem, prove=False),
    )
    if detour is None or any(find_blocked_links(problem, list(pairwise([a, *detour, b])))):
        return BlockedLink(a, b, radius, FORBIDDEN)
    problem.detours[a.tobytes() + b.tobytes()] = detour
    steps = np.diff(np.stack([a, *detour, b]), axis=0)
    extra = limits.seconds(steps, 0.0).sum() - limits.seconds(b - a, 0.0)
    return BlockedLink(a, b, radius, float(extra))


def find_known_detour(
    problem: TourProblem, a: FloatArray, b: FloatArray
) -> tuple[FloatArray, ...] | None:
    """The detour that was found for a link in either direction; None without one."""
    if a.tobytes() + b.tobytes() in problem.detours:
        return problem.detours[a.tobytes() + b.tobytes()]
    back = problem.detours.get(b.tobytes() + a.tobytes())
    return None if back is None else back[::-1]
