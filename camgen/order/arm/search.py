"""Order, direction, seam, posture and turn of all paths together, by the time of the joints.

The states of a tour are chosen layer by layer (``layers``), its order by the search over a table of the chosen states'
links, in turn; where any turn is as good, the turns are moved in finer and finer steps in between. States and links are
tested for collisions when a tour uses them: what collides is out, and the states are chosen again.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence, Set
from functools import partial
from itertools import pairwise

import numpy as np
from msgspec import Struct, field

from camgen.geometry.ragged import offsets
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray
from camgen.motion.setup import Blockage, FreeSpace, SampledMotion, Setup
from camgen.order.arm.detours import find_detour
from camgen.order.arm.items import (
    StateJoints,
    States,
    compute_state_joints,
    join_states,
    turn_round,
)
from camgen.order.arm.layers import (
    FORBIDDEN,
    SAME,
    BlockedLink,
    CostModel,
    add_blocked_costs,
    change_cost,
    choose,
    gate_places,
    home_seconds,
)
from camgen.order.solver import matrix
from camgen.order.solver.ring import shorten_ring
from camgen.robots.kinematics.forward import flange

#: So many paths are put in another order; of more the order by length is kept.
MANY = 1_000
#: Rounds of states and order, and the share of the time below which a round is the last.
_ROUNDS, _GAIN = 8, 1e-3
#: rad: steps in which turns are moved, and how many to each side; so many looks are worth it.
STEPS, _SIDES, _WORTH = (math.radians(5.0), math.radians(2.0), math.radians(0.7)), 4, 8_000
#: Looks of a path at which a state is tested that no tour has used yet.
_FEW = 6
#: Links whose ends are within this share of their way of those of one that collides are taken to collide too.
_ALIKE, _FAR_ALIKE = 0.15, 0.35
#: rad or mm: where other states are known to do, only those as near as this are taken to collide too.
_CLOSE = 0.06
#: rad or mm: for links so long that collide a way round is looked for at once; shorter ones have other states first.
_LONG = 1.0
#: So often the states are chosen anew because of links that collide before their turns are moved.
_BEGINNINGS = 12
#: Rounds of repair before what still collides goes another way.
_REPAIRS = 8
#: So often the order is made anew as if every link had the turns that suit it best.
_ANY_ROLL_ROUNDS = 3
#: rad: joints turn by no more between two places at which a link is looked at before it is proved.
_LOOK = math.radians(2.5)
#: Shuffles of the search for an order, as a share of the usual number; more paths than that have none.
_EFFORT, _CROWD = 0.3, 300
#: Exchanges for each of a tour's points, and the most.
_KICKS, _MOST_KICKS = 6, 4_000


class SearchOptions(Struct, frozen=True):
    """What the search may change.

    may_reorder: whether the order of the items may change.
    any_roll: whether every roll is as good, so that rolls are moved in fine steps.
    least_height: least height of the TCP on a link, mm in the work frame.
    """

    may_reorder: bool
    any_roll: bool
    least_height: float


class TourProblem(Struct, frozen=True, eq=False):
    """All that the search needs and learns; the collections are changed by the search.

    setup: the arm, and the collision test of joint values.
    free_space: the collision test of motions.
    cost_model: the items, and the time of their links.
    states: by item, its states; reduced where states collide, see ``tested``.
    rules: the precedence of the items.
    options: what the search may change.
    tested: items whose states were reduced to those that do not collide.
    blocked_links: links that collide.
    free: keys of links and states that are known to be clear.
    lost: items of which every state collides.
    shut: keys of links and states that collide between the samples of a first test.
    detours: joint values (J,) by way of which a blocked link goes, by the bytes of its ends.
    around: seconds by which a detour takes longer than its link, by key.
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
    shut: set[bytes] = field(default_factory=set)
    detours: dict[bytes, tuple[FloatArray, ...]] = field(default_factory=dict)
    around: dict[bytes, float] = field(default_factory=dict)


class Solution(Struct, eq=False):
    """A tour.

    order: items in the order in which they are run.
    states: (n,) the state of each item, by item.
    seconds: time of its links, s.
    """

    order: list[int]
    states: States
    seconds: float


Tell = Callable[[str], None]


def find_tour(problem: TourProblem, order: Sequence[int], prove: bool, tell: Tell) -> Solution:
    """A first tour in the ``order``. prove: states, and links, are tested for collisions."""
    solution = choose_states(problem, list(order), list(problem.states), prove)
    for attempt in range(_BEGINNINGS if prove else 0):
        tell(f"joints, {solution.seconds:.1f} s, beginning {attempt + 1}")
        if not solution.order or not learn_blocked_links(problem, solution):
            break
        solution = choose_states(problem, solution.order, list(problem.states), prove)
    return solution


def improve_tour(problem: TourProblem, solution: Solution, prove: bool, tell: Tell) -> Solution:
    """``solution`` with its states and its order bettered in turn."""
    solution = move_turns(problem, solution, prove)
    for _ in range(_ANY_ROLL_ROUNDS if problem.options.may_reorder else 0):
        any_roll = move_turns(problem, _order_for_any_roll(problem, solution, prove), prove)
        if any_roll.seconds >= solution.seconds:
            break
        solution = any_roll
    for attempt in range(_ROUNDS):
        tell(f"joints, {solution.seconds:.1f} s, round {attempt + 1}")
        before = solution.seconds
        solution = _move_gates(problem, solution)
        if problem.options.may_reorder:
            solution = _reorder(problem, solution, attempt)
        solution = move_turns(problem, solution, prove)
        if before - solution.seconds < _GAIN * before:
            break
    return solution


def choose_states(
    problem: TourProblem,
    order: list[int],
    states: list[States],
    prove: bool,
    known: States | None = None,
) -> Solution:
    """The best of ``states`` along ``order`` that collide with nothing. known: (n) states that need no test."""
    cost_model = problem.cost_model
    while True:
        cost, chosen = choose(cost_model, order, states, problem.blocked_links)
        current = join_states([states[k].pick(chosen[[k]]) for k in range(len(states))])
        new = [k for k in order if prove and not _is_known(problem, current, known, k)]
        hit = find_hits(problem, new, current.pick(np.array(new, dtype=np.int64)))
        if not hit.any():
            return Solution(order, current, cost)
        asked = [
            (k, states[k], int(chosen[k]))
            for k, stops in zip(new, hit.tolist(), strict=True)
            if stops
        ]
        for (k, _, _), left in zip(asked, _prune(problem, asked), strict=True):
            if not len(left):
                problem.lost.add(k)
                order = [item for item in order if item != k]
            states[k] = left if len(left) else current.single(k)
        if not order:
            return Solution(order, current, 0.0)


def _is_known(problem: TourProblem, current: States, known: States | None, item: int) -> bool:
    same = (
        known is not None
        and known.turn[item] == current.turn[item]
        and known.branch[item] == current.branch[item]
    )
    return bool(current.branch[item] < 0 or same or key_of(current, item) in problem.free)


def key_of(states: States, row: int, item: int | None = None) -> bytes:
    """What tells a state of an item, that of the same number where none is given, from all others of it, but for whole
    turns and gates.
    """
    return b"%d:%d:%.6f" % (row if item is None else item, states.branch[row], states.turn[row])


def _compute_state_joints(
    problem: TourProblem, numbers: Sequence[int], states: States
) -> StateJoints:
    """E states of the items ``numbers`` (E,) as they are run."""
    items = [problem.cost_model.items[k] for k in numbers]
    loop = np.array([item.closed for item in items], dtype=np.bool_)
    forward = loop | (states.gate[:, 0] == 0)
    near = np.where(forward[:, None], states.enter, states.leave)
    return compute_state_joints(
        problem.setup, items, states.turn, states.branch, np.where(loop, states.gate[:, 0], 0), near
    )


def find_hits(
    problem: TourProblem, numbers: Sequence[int], states: States, looks: int = 0
) -> BoolArray:
    """Which of E states of the items ``numbers`` (E,) collide or cannot be run. looks: at so many, 0: at all."""
    if not len(numbers):
        return np.zeros(0, dtype=np.bool_)
    # States that differ by whole turns or by where they are entered are one here.
    keys = [key_of(states, row, item) for row, item in enumerate(numbers)]
    place = {key: row for row, key in reversed(list(enumerate(keys)))}
    once = np.array(list(place.values()))
    bad = dict(
        zip(
            place,
            _find_hits(problem, [numbers[k] for k in once], states.pick(once), looks).tolist(),
            strict=True,
        )
    )
    if not looks:
        problem.free.update(key for key, stops in bad.items() if not stops)
    return np.array([bad[key] or key in problem.shut for key in keys], dtype=np.bool_)


def _find_hits(
    problem: TourProblem, numbers: Sequence[int], states: States, looks: int
) -> BoolArray:
    state_joints = _compute_state_joints(problem, numbers, states)
    bad = ~state_joints.is_valid
    rows = []
    for k in np.flatnonzero(state_joints.is_valid).tolist():
        own = np.arange(state_joints.first[k], state_joints.first[k + 1])
        if looks and len(own) > looks:
            own = own[np.unique(np.round(np.linspace(0, len(own) - 1, looks)).astype(np.int64))]
        # What stands at the height of travel is there twice.
        moved = np.abs(np.diff(state_joints.joints[own], axis=0)).max(axis=1) > 0
        rows.append(own[np.append(moved, True)])
    if not rows:
        return bad
    flat = np.concatenate(rows)
    owner = np.repeat(np.flatnonzero(state_joints.is_valid), [len(own) for own in rows])
    # A state that collides at its last look is not looked at again.
    last = np.append(owner[1:] != owner[:-1], True)
    for some in (last, ~last):
        asked = np.flatnonzero(some & ~bad[owner])
        bad[owner[asked[~problem.setup.clear(state_joints.joints[flat[asked]])]]] = True
    return bad


def _prune(problem: TourProblem, asked: Sequence[tuple[int, States, int]]) -> list[States]:
    """For each item, its states and the chosen one, which collides: the states without that and all others that do."""
    left = []
    for _, states, chosen in asked:
        same = (states.branch == states.branch[chosen]) & (states.turn == states.turn[chosen])
        left.append(states.pick(~same))
    open_ = [
        k
        for k, (item, states, _) in enumerate(asked)
        if not (item in problem.tested and states is problem.states[item])
    ]
    numbers = [asked[k][0] for k in open_ for _ in range(len(left[k]))]
    if numbers:
        every = join_states([left[k] for k in open_])
        free = np.array(
            [key_of(every, row, item) in problem.free for row, item in enumerate(numbers)],
            dtype=np.bool_,
        )
        tried = np.flatnonzero(~free & (every.branch >= 0))
        bad = np.zeros(len(numbers), dtype=np.bool_)
        bad[tried] = find_hits(problem, [numbers[k] for k in tried], every.pick(tried), _FEW)
        ends = np.cumsum([len(left[k]) for k in open_])[:-1]
        for k, own in zip(open_, np.split(bad, ends), strict=True):
            left[k] = left[k].pick(~own)
    for (item, states, chosen), rest in zip(asked, left, strict=True):
        if states is problem.states[item]:
            problem.tested.add(item)
            # One that is lost keeps a state to stand in a table, and is in no order.
            problem.states[item] = rest if len(rest) else states.single(chosen)
    return left


def _order_for_any_roll(problem: TourProblem, solution: Solution, prove: bool) -> Solution:
    """The order in which the points would be soonest gone through if each link had the turns that suit it best, with
    the states that are chosen for it: other than the order that states were chosen for.
    """
    order, cost_model, current = solution.order, problem.cost_model, solution.states
    if (
        not _is_plain(problem, solution)
        or not problem.options.any_roll
        or not 4 < len(order) <= _CROWD
    ):
        return solution
    fine = shift_turns(problem, solution, STEPS[0])
    ring = measure_soonest_links(cost_model, [fine[k].enter for k in order])
    np.fill_diagonal(ring, 0.0)
    ring[1:, 1:] += change_cost(cost_model, current.branch[order], current.branch[order])
    ring = np.minimum(ring, ring.T)
    made = shorten_ring(ring, range(len(ring)), min(_KICKS * len(order), _MOST_KICKS))
    return choose_states(problem, [order[k - 1] for k in made[1:]], fine, prove, current)


def measure_soonest_links(cost_model: CostModel, joints: Sequence[FloatArray]) -> FloatArray:
    """Seconds (n + 1, n + 1) of the soonest link between any states of two of n points, home first.

    joints: by point, the joint values of its states (M, J).
    """
    first = offsets([len(rows) for rows in joints])
    every = np.concatenate(joints)
    table = np.zeros((len(first), len(first)))
    for k, rows in enumerate(joints, 1):
        seconds = cost_model.limits.between(rows, every, 0.0).min(axis=0)
        table[k, 1:] = np.minimum.reduceat(seconds, first[:-1])
        table[k, 0] = table[0, k] = cost_model.limits.seconds(rows - cost_model.home, 0.0).min()
    return table


def _is_plain(problem: TourProblem, solution: Solution) -> bool:
    """Whether all items are left where they are entered, and may come in any order."""
    own = solution.states.pick(np.array(solution.order))
    free = (problem.rules.parent[solution.order] < 0).all() and len(
        set(problem.rules.rank[solution.order].tolist())
    ) == 1
    return bool(free and not (own.enter != own.leave).any())


def move_turns(
    problem: TourProblem, solution: Solution, prove: bool, still: Set[int] = frozenset()
) -> Solution:
    """Turns a little to both sides of those that are chosen, in finer and finer steps, but of the items ``still``."""
    sizes = [len(problem.cost_model.items[k]) for k in solution.order]
    if not problem.options.any_roll or sum(sizes) > _WORTH:
        return solution
    for step in STEPS:
        while True:
            better = choose_states(
                problem,
                solution.order,
                shift_turns(problem, solution, step, still),
                prove,
                solution.states,
            )
            gained = solution.seconds - better.seconds
            solution = better if gained > 0 else solution
            if gained < _GAIN * solution.seconds:
                break
    return solution


def shift_turns(
    problem: TourProblem, solution: Solution, step: float, still: Set[int] = frozenset()
) -> list[States]:
    """By item its state and, but of the items ``still``, those with other turns within ``_SIDES`` steps."""
    current = solution.states
    asked = [k for k in solution.order if current.branch[k] >= 0 and k not in still]
    shifts = step * np.array([k for k in range(-_SIDES, _SIDES + 1) if k])
    own = np.repeat(asked, len(shifts))
    turn = current.turn[own] + np.tile(shifts, len(asked))
    turn = np.remainder(turn + math.pi, math.tau) - math.pi
    wanted = current.pick(own)
    wanted = States(wanted.enter, wanted.leave, wanted.gate, turn, wanted.branch)
    made, good = _place(problem, own.tolist(), wanted)
    # Where the arm cannot go there evenly it is another state, which the grid has.
    good &= np.abs(made.enter - current.enter[own]).max(
        axis=1, initial=0.0
    ) < 4 * _SIDES * step + math.radians(10)
    states = current.split()
    for place, k in enumerate(asked):
        rows = np.arange(place * len(shifts), (place + 1) * len(shifts))
        states[k] = join_states([states[k], made.pick(rows[good[rows]])])
    return states


def _place(
    problem: TourProblem, numbers: Sequence[int], states: States
) -> tuple[States, BoolArray]:
    """States of the items ``numbers`` with the joints at their gates worked out anew, and which can be run."""
    if not len(numbers):
        return states, np.zeros(0, dtype=np.bool_)
    state_joints = _compute_state_joints(problem, numbers, states)
    gates = [problem.cost_model.items[k].gates for k in numbers]
    at = (
        np.array([own[pair] for own, pair in zip(gates, states.gate, strict=True)])
        + state_joints.first[:-1, None]
    )
    good = state_joints.is_valid & np.isfinite(state_joints.joints[at]).all(axis=(1, 2))
    return States(
        state_joints.joints[at[:, 0]],
        state_joints.joints[at[:, 1]],
        states.gate,
        states.turn,
        states.branch,
    ), good


def _move_gates(problem: TourProblem, solution: Solution) -> Solution:
    """The same postures and turns, entered at other gates."""
    current = solution.states
    states = current.split()
    for k in solution.order:
        item = problem.cost_model.items[k]
        if item.reversible:
            states[k] = join_states([states[k], turn_round(states[k])])
        elif item.closed and len(item.gates) > 1 and current.branch[k] >= 0:
            state_joints = _compute_state_joints(problem, [k], states[k])
            joints = state_joints.joints[item.gates]
            numbers = np.arange(len(joints))
            count = len(numbers)
            every = States(
                joints,
                joints,
                np.stack([numbers] * 2, axis=1),
                np.full(count, current.turn[k]),
                np.full(count, current.branch[k]),
            )
            states[k] = join_states([states[k], every])
    return choose_states(problem, solution.order, states, False)


def _reorder(problem: TourProblem, solution: Solution, seed: int) -> Solution:
    """The states as they are in the shortest order that is found."""
    order, current, cost_model = solution.order, solution.states, problem.cost_model
    count = len(order)
    if not 2 < count <= MANY:
        return solution
    own = current.pick(np.array(order))
    flips = np.array([cost_model.items[k].reversible for k in order])
    table = _tables(problem, order, own)
    # What cannot be turned round is neither left where it is entered nor entered where it is left.
    stiff = ~flips & (np.abs(own.enter - own.leave).max(axis=1) > 0)
    table.between[stiff, 0] = table.between[:, :, stiff, 1] = FORBIDDEN
    table.first[stiff, 1] = table.last[stiff, 0] = FORBIDDEN
    rules = matrix.Rules(_inner(problem.rules.parent, order), problem.rules.rank[order])
    plain = bool((rules.parent < 0).all() and len(set(rules.rank.tolist())) == 1)
    if _is_plain(problem, solution):
        ring = np.zeros((count + 1, count + 1))
        ring[1:, 1:] = table.between[:, 0, :, 0]
        ring[0, 1:] = ring[1:, 0] = table.first[:, 0]
        ring = np.minimum(ring, ring.T)
        made = shorten_ring(ring, range(count + 1), min(_KICKS * count, _MOST_KICKS), seed)
        seconds = float(ring[made, np.roll(made, -1)].sum())
        better = Solution([order[k - 1] for k in made[1:]], current, seconds)
        return better if seconds < solution.seconds - 1e-9 else solution
    start = (list(range(count)), [False] * count)
    effort = _EFFORT if count <= _CROWD else 0.0
    items, backs = matrix.shortest(table, seed, effort, start, None if plain else rules)
    seconds = matrix.total(table, items, backs)
    if seconds >= solution.seconds - 1e-9:
        return solution
    turned = np.array(
        [order[k] for k, back in zip(items, backs, strict=True) if back and flips[k]],
        dtype=np.int64,
    )
    enter, leave, gate = current.enter.copy(), current.leave.copy(), current.gate.copy()
    enter[turned], leave[turned], gate[turned] = (
        current.leave[turned],
        current.enter[turned],
        current.gate[turned][:, ::-1],
    )
    return Solution(
        [order[k] for k in items], States(enter, leave, gate, current.turn, current.branch), seconds
    )


def _inner(parent: IntArray, order: Sequence[int]) -> IntArray:
    """The parents among the items of ``order``, by their places in it."""
    place = np.full(len(parent) + 1, -1)
    place[list(order)] = np.arange(len(order))
    return np.asarray(place[parent[list(order)]])


def _tables(problem: TourProblem, order: Sequence[int], own: States) -> matrix.Table:
    """The seconds of all links between the ends of the items, and from and to home."""
    cost_model, count = problem.cost_model, len(order)
    ends = np.stack([own.enter, own.leave], axis=1).reshape(2 * count, -1)
    places = np.stack(
        [gate_places(cost_model.items[k], own.gate[i]) for i, k in enumerate(order)], axis=0
    ).reshape(2 * count, 3)
    branch = np.repeat(own.branch, 2)
    table = cost_model.limits.between(
        ends, ends, np.linalg.norm(places[:, None] - places[None], axis=-1)
    )
    table += change_cost(cost_model, branch, branch)
    table = add_blocked_costs(table, ends, ends, problem.blocked_links)
    home = home_seconds(cost_model, ends, problem.blocked_links).reshape(count, 2)
    return matrix.Table(table.reshape(count, 2, count, 2), home, home.copy())


# What a tour uses is proved: the paths as they are run, and the links between them.


def prove_tour(problem: TourProblem, solution: Solution, tell: Tell) -> Solution:
    """``solution`` with other states where paths or links collide, as far as there are any."""
    for attempt in range(_REPAIRS if solution.order else 0):
        touched = find_blocked_paths(problem, solution) | learn_blocked_links(problem, solution)
        if not touched:
            return solution
        tell(f"joints, {solution.seconds:.1f} s, repair {attempt + 1}")
        solution = _repair(problem, solution, touched)
    return solution


def _repair(problem: TourProblem, solution: Solution, touched: set[int]) -> Solution:
    """The tour with states chosen anew for the items that are ``touched`` and those beside them."""
    order, current = solution.order, solution.states
    place = {item: k for k, item in enumerate(order)}
    beside = {p + d for p in (place[item] for item in touched) for d in (-1, 0, 1)}
    near = {order[p] for p in beside if 0 <= p < len(order)}
    fine = shift_turns(problem, solution, STEPS[0]) if problem.options.any_roll else current.split()
    states = [
        join_states([own, problem.states[k]])
        if k in near and len(problem.states[k])
        else current.single(k)
        for k, own in enumerate(fine)
    ]
    return choose_states(problem, order, states, True)


def find_blocked_paths(problem: TourProblem, solution: Solution) -> set[int]:
    """The items whose states, new ones, collide between two looks."""
    asked = [
        k
        for k in solution.order
        if solution.states.branch[k] >= 0 and _proved(solution.states, k) not in problem.free
    ]
    if not asked:
        return set()
    state_joints = _compute_state_joints(problem, asked, solution.states.pick(np.array(asked)))
    tracks, owner = [], []
    for place, k in enumerate(asked):
        joints = state_joints.joints[state_joints.first[place] : state_joints.first[place + 1]]
        item = problem.cost_model.items[k]
        tracks.append(SampledMotion(joints[: item.last + 1]))
        tracks += [
            SampledMotion(joints[[item.before[gate], gate]]) for gate in item.gates[1:].tolist()
        ]
        owner += [k] * len(item.gates)
    hit = {
        k
        for k, stop in zip(owner, problem.free_space.look(tracks), strict=True)
        if isinstance(stop, Blockage)
    }
    problem.shut.update(key_of(solution.states, k) for k in hit)
    problem.free.difference_update(key_of(solution.states, k) for k in hit)
    problem.free.update(_proved(solution.states, k) for k in asked if k not in hit)
    return hit


def _proved(current: States, item: int) -> bytes:
    return b"path " + key_of(current, item)


def learn_blocked_links(problem: TourProblem, solution: Solution) -> set[int]:
    """Tests the new links of a tour, and keeps those that collide; the items at their ends.

    A link on which the TCP comes too low is blocked as well.
    """
    pairs = list(zip([-1, *solution.order], [*solution.order, -1], strict=True))
    ends = {pair: _ends_of(problem, solution.states, pair) for pair in pairs}
    untested = [
        pair
        for pair in pairs
        if link_key(*ends[pair]) not in problem.free and detour_of(problem, *ends[pair]) is None
    ]
    touched: set[int] = set()
    blocked = find_blocked(problem, [ends[pair] for pair in untested])
    for pair, is_blocked in zip(untested, blocked, strict=True):
        if is_blocked:
            problem.blocked_links.append(make_blocked_link(problem, *ends[pair], _LONG))
            touched.update(item for item in pair if item >= 0)
    return touched


def _ends_of(
    problem: TourProblem, current: States, pair: tuple[int, int]
) -> tuple[FloatArray, FloatArray]:
    """The joint values at both ends of the link between two items, -1 for home."""
    home, (a, b) = problem.cost_model.home, pair
    return (home if a < 0 else current.leave[a], home if b < 0 else current.enter[b])


def find_blocked(
    problem: TourProblem, links: Sequence[tuple[FloatArray, FloatArray]], surely: bool = True
) -> list[bool]:
    """Which motions of the joints collide, or lead the tip too low. surely: what is not found at some places on the way
    is proved, and noted as clear.
    """
    if not links:
        return []
    blocked = np.array([link_key(*pair) not in problem.free for pair in links])
    new = np.flatnonzero(blocked)
    if not len(new):
        return [False] * len(links)
    met = find_met(problem, [links[k] for k in new.tolist()])
    blocked[new] = met
    left = new[~met]
    if surely and len(left):
        stops = problem.free_space.look([SampledMotion(np.stack(links[k])) for k in left.tolist()])
        blocked[left] = [isinstance(stop, Blockage) for stop in stops]
        problem.free.update(link_key(*links[k]) for k in left[~blocked[left]].tolist())
    return [bool(stop) for stop in blocked]


def find_met(
    problem: TourProblem, links: Sequence[tuple[FloatArray, FloatArray]], few: bool = False
) -> BoolArray:
    """Which joint motions collide at a sample, or lead the TCP below ``SearchOptions.least_height``.

    few: only every eighth sample is tested.
    """
    counts = [max(math.ceil(float(np.abs(b - a).max()) / _LOOK), 2) for a, b in links]
    rows = [
        a + np.linspace(0.0, 1.0, n + 1)[:, None] * (b - a)
        for (a, b), n in zip(links, counts, strict=True)
    ]
    owner = np.repeat(np.arange(len(links)), [len(own) for own in rows])
    flat = np.concatenate(rows)
    met = np.zeros(len(links), dtype=np.bool_)
    if math.isfinite(problem.options.least_height):
        rotation, origin = flange(problem.setup.robot, flat)
        tip = origin + rotation @ np.asarray(problem.setup.flange_from_tool.origin)
        base = problem.setup.base_from_work
        met[
            owner[
                (tip - np.asarray(base.origin)) @ base.rotation[:, 2] < problem.options.least_height
            ]
        ] = True
    # Every eighth place first: most motions that collide do so for long.
    step = np.concatenate([np.arange(len(own)) for own in rows])
    for some in (step % 8 == 4,) if few else (step % 8 == 4, step % 8 != 4):
        asked = np.flatnonzero(some & ~met[owner])
        met[owner[asked[~problem.setup.clear(flat[asked])]]] = True
    return met


def link_key(a: FloatArray, b: FloatArray) -> bytes:
    """What tells a link of the joints from all others; the way back is the same."""
    ends = sorted([np.round(a, 6).tobytes(), np.round(b, 6).tobytes()])
    return b"link " + ends[0] + ends[1]


def make_blocked_link(
    problem: TourProblem, a: FloatArray, b: FloatArray, least: float
) -> BlockedLink:
    """What is known of a link that collides, with a way round it, which is looked for where a joint goes ``least`` rad
    or mm or more.
    """
    far = float(np.abs(b - a).max())
    near = max((_ALIKE if far < _LONG else _FAR_ALIKE) * far, SAME)
    if far < least:
        return BlockedLink(a, b, near, FORBIDDEN)
    others = np.concatenate(
        [problem.cost_model.home[None], *(np.stack(way) for way in problem.detours.values())]
    )
    found = find_detour(
        problem.setup.robot,
        problem.cost_model.limits,
        (a, b),
        others,
        problem.setup.clear,
        partial(find_blocked, problem, surely=False),
    )
    if found is None or any(find_blocked(problem, list(pairwise([a, *found, b])))):
        return BlockedLink(a, b, near, FORBIDDEN)
    problem.detours[a.tobytes() + b.tobytes()] = found
    places = np.stack([a, *found, b])
    longer = problem.cost_model.limits.seconds(
        np.diff(places, axis=0), 0.0
    ).sum() - problem.cost_model.limits.seconds(b - a, 0.0)
    return BlockedLink(a, b, near, float(longer))


def detour_of(problem: TourProblem, a: FloatArray, b: FloatArray) -> tuple[FloatArray, ...] | None:
    """The way round that was found for a link, None where none was."""
    if a.tobytes() + b.tobytes() in problem.detours:
        return problem.detours[a.tobytes() + b.tobytes()]
    back = problem.detours.get(b.tobytes() + a.tobytes())
    return None if back is None else back[::-1]
