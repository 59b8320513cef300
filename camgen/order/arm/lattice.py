"""Chooses the states of a tour's points that take least time together and do not collide.

The links from each point to the next are a table over all states of both. The fastest tour through
all tables is tested. If a link collides, the time of a detour is added to it and to others that
would be used next, and the tour is computed again. Only links that a tour uses are tested.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from msgspec import Struct

from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray
from camgen.model.sequences import take_rows
from camgen.motion.setup import Blockage, SampledMotion
from camgen.order.arm.items import States, choose_each
from camgen.order.arm.layers import POSTURE_COST, time_links
from camgen.order.arm.search import (
    Solution,
    TourProblem,
    find_colliding_links,
    find_colliding_states,
    get_link_ends,
    make_blocked_link,
    make_link_key,
    make_state_key,
    make_state_keys,
)

#: Maximum number of tours through the tables that are tested.
_MAX_TOURS = 60
#: When the link of a tour collides, this many of the fastest links between the same two items are
#: tested together.
_FIRST_BATCH = 24
#: Factor on the batch each time a link between these two items collides again.
_BATCH_GROWTH = 2
#: Largest batch.
_MAX_BATCH = 192
#: s: time that a detour is expected to add to its link, before one is found for a link of the same
#: two points.
DETOUR_GUESS = 2.0
#: s: cost of a link without a detour.
_NO_DETOUR = 10.0

#: mm: clearance that a link keeps if its ends do. The check of the program tests other samples of a
#: link, and finds a clearance that is smaller by less than this.
GRAZE_MM = 0.3
#: mm: tolerance of that clearance.
_CLEARANCE_EPS_MM = 1e-3

#: Least time of a link between two items, s; the lower index first, -1 for home.
KnownLinks = dict[tuple[int, int], float]
#: Rejected links between an item and the next, -1 for home: the joint values of both ends, and the
#: radius around them in which other links are rejected too, rad or mm.
RejectedLinks = dict[tuple[int, int], list[tuple[FloatArray, FloatArray, float]]]
_NOTHING_REJECTED: RejectedLinks = {}
#: Links between two items that are rejected alone. Later ones reject the links near to them too.
_REJECTED_ALONE = 5
#: rad or mm: first radius around a rejected link. It doubles with each rejection.
_FIRST_RADIUS = 0.02
#: rad or mm: largest radius around a rejected link.
_MAX_RADIUS = 0.5


def choose_point_states(
    problem: TourProblem,
    order: Sequence[int],
    states: Sequence[States],
    known: KnownLinks,
    rejected: RejectedLinks = _NOTHING_REJECTED,
) -> Solution | None:
    """Choose one state per item so that the tour home, `order`, home takes least time.

    Only states and links of the fastest tour are tested. A colliding state is removed, a colliding
    link gets the time of a detour. Then the tour is computed again, at most `_MAX_TOURS` times.
    Returns None if every state of an item collides.

    known: gets the least time of a link for each pair of items with a colliding link, s.
    rejected: links that cost `_NO_DETOUR` more.
    """
    home = problem.cost_model.home
    tables = _make_tables(problem, order, states)
    links = _gather_ends(problem, states, order)
    for ends, table in zip(links, tables, strict=True):
        _add_rejections(ends, table, rejected.get(ends.items, ()))
    has_detour = [np.zeros(table.shape, dtype=np.bool_) for table in tables]
    tested: list[set[tuple[int, int]]] = [set() for _ in tables]
    batches = [_FIRST_BATCH] * len(tables)
    for _ in range(_MAX_TOURS):
        ahead, back = _sum_times(tables)
        chosen = _trace(tables, ahead)
        seconds = float((ahead[-1] + tables[-1][:, 0]).min())
        if not np.isfinite(seconds):
            return None
        current = choose_each(take_rows(states, order), np.array(chosen))
        colliding = _find_colliding(problem, order, states, current)
        for place, rows in colliding:
            tables[place][:, rows] = np.inf
            tables[place + 1][rows] = np.inf
        if colliding:
            continue
        joints = [home, *current.enter, home]
        steps = list(pairwise([0, *chosen, 0]))
        untested = [place for place, step in enumerate(steps) if step not in tested[place]]
        results = _test_links(problem, [(joints[place], joints[place + 1]) for place in untested])
        is_done = True
        for place, collides in zip(untested, results, strict=True):
            tested[place].add(steps[place])
            if not collides or has_detour[place][steps[place]]:
                continue
            is_done = False
            table = tables[place]
            through = ahead[place][:, None] + table + back[place]
            through[has_detour[place]] = np.inf
            fastest = np.argsort(through.ravel(), kind="stable")[: batches[place]]
            fastest = fastest[np.isfinite(through.ravel()[fastest])]
            _add_guesses(problem, links[place], table, has_detour[place], fastest)
            batches[place] = min(batches[place] * _BATCH_GROWTH, _MAX_BATCH)
            item, next_item = links[place].items
            known[min(item, next_item), max(item, next_item)] = float(table.min())
        if is_done:
            break
    rows = np.zeros(len(states), dtype=np.int64)
    rows[list(order)] = chosen
    solution_states = choose_each(states, rows)
    branch = solution_states.branch[list(order)]
    changes = int((branch[1:] != branch[:-1]).sum())
    return Solution(list(order), solution_states, seconds - POSTURE_COST * changes)


class _LinkEnds(Struct, frozen=True, eq=False):
    """The states between which the links of a table go.

    items: index of the item that is left and of the item that is entered, -1 for home.
    start, end: (M) and (K) states of these items.
    """

    items: tuple[int, int]
    start: States
    end: States


def _gather_ends(
    problem: TourProblem, states: Sequence[States], order: Sequence[int]
) -> list[_LinkEnds]:
    home = States.fixed(problem.cost_model.home)
    links = []
    for before, after in pairwise([-1, *order, -1]):
        start = home if before < 0 else states[before]
        end = home if after < 0 else states[after]
        links.append(_LinkEnds((before, after), start, end))
    return links


def _add_rejections(
    ends: _LinkEnds,
    table: FloatArray,
    rejected: Sequence[tuple[FloatArray, FloatArray, float]],
) -> None:
    for a, b, radius in rejected:
        is_start = np.abs(ends.start.leave - a).max(axis=1) < radius
        is_end = np.abs(ends.end.enter - b).max(axis=1) < radius
        table[np.outer(is_start, is_end)] += _NO_DETOUR


def reject_links(
    problem: TourProblem, solution: Solution, places: Sequence[int], rejected: RejectedLinks
) -> None:
    """Add the links of a solution at these indices, counted from home, to the rejected ones."""
    stops = [-1, *solution.order, -1]
    for place in places:
        pair = (stops[place], stops[place + 1])
        a, b = get_link_ends(problem, solution.states, pair)
        of_pair = rejected.setdefault(pair, [])
        doublings = len(of_pair) - _REJECTED_ALONE
        radius = min(_FIRST_RADIUS * 2**doublings, _MAX_RADIUS) if doublings >= 0 else 0.0
        of_pair.append((a, b, radius))


def add_detours(problem: TourProblem, solution: Solution) -> Solution:
    """Search the detours of the blocked links of a solution, and add their time to its own."""
    seconds = 0.0
    limits, branch = problem.cost_model.limits, solution.states.branch
    for pair in pairwise([-1, *solution.order, -1]):
        a, b = get_link_ends(problem, solution.states, pair)
        key = make_link_key(a, b)
        known = problem.detour_seconds
        if key in problem.colliding and key not in known:
            extra = make_blocked_link(problem, a, b, 0.0).cost
            known[key] = extra
            cost = min(extra, _NO_DETOUR)
            postures = _make_posture_key(*(-1 if k < 0 else int(branch[k]) for k in pair))
            known[make_pair_key(*pair)] = cost
            known[postures] = min(known.get(postures, cost), cost)
        link_seconds = limits.seconds(b - a, _measure_distance(problem, *pair))
        seconds += float(link_seconds) + known.get(key, 0.0)
    return Solution(solution.order, solution.states, seconds)


def _guess_detour(
    problem: TourProblem,
    link: tuple[FloatArray, FloatArray],
    items: tuple[int, int],
    branches: tuple[int, int],
) -> float:
    """Time that the detour of a link adds, s; if unknown, that of the same items or postures."""
    known = problem.detour_seconds
    for key in (make_link_key(*link), make_pair_key(*items)):
        if key in known:
            return known[key]
    if branches[0] == branches[1]:
        return DETOUR_GUESS
    return known.get(_make_posture_key(*branches), DETOUR_GUESS)


def _make_posture_key(first: int, second: int) -> bytes:
    """The key of the links between two postures, -1 for home."""
    return b"postures %d:%d" % (min(first, second), max(first, second))


def prove_links(problem: TourProblem, solution: Solution) -> list[int]:
    """Prove the links of a solution; returns the indices of those that fail, counted from home.

    A link fails if it collides between the samples, or if its clearance is below `GRAZE_MM` while
    that of its ends is not. The results are added to `problem`.
    """
    links, keys, unproved = [], [], []
    for place, pair in enumerate(pairwise([-1, *solution.order, -1])):
        links.append(np.stack(get_link_ends(problem, solution.states, pair)))
        keys.append(make_link_key(*links[place]))
        if b"wide " + keys[place] not in problem.free and keys[place] not in problem.colliding:
            unproved.append(place)
    failed = []
    space, limit = problem.free_space, GRAZE_MM - _CLEARANCE_EPS_MM
    results = space.look([SampledMotion(links[place]) for place in unproved])
    for place, result in zip(unproved, results, strict=True):
        fails = isinstance(result, Blockage)
        if not isinstance(result, Blockage) and result < limit:
            fails = bool(space.gaps(links[place]).min() >= limit)
        if fails:
            failed.append(place)
            problem.colliding.add(keys[place])
        else:
            problem.free.update((keys[place], b"wide " + keys[place]))
    return failed


def _measure_distance(problem: TourProblem, start: int, end: int) -> float:
    """Distance of the TCP from point to point, mm; 0 from and to home, where the joints count."""
    if min(start, end) < 0:
        return 0.0
    first, second = problem.cost_model.items[start], problem.cost_model.items[end]
    return float(np.linalg.norm(first.position[first.gates[0]] - second.position[second.gates[0]]))


def make_pair_key(first: int, second: int) -> bytes:
    """The key of the links between two items, -1 for home."""
    return b"pair %d:%d" % (min(first, second), max(first, second))


def _make_tables(
    problem: TourProblem, order: Sequence[int], states: Sequence[States]
) -> list[FloatArray]:
    """Times from home to each state of the first item, between items, and back home, s."""
    cost_model = problem.cost_model
    first, last = states[order[0]].enter, states[order[-1]].enter
    from_home = cost_model.limits.seconds(first - cost_model.home, 0.0)
    to_home = cost_model.limits.seconds(last - cost_model.home, 0.0)
    between = [table.copy() for table in time_links(cost_model, order, states, POSTURE_COST)]
    return [from_home[None], *between, to_home[:, None]]


def _sum_times(tables: Sequence[FloatArray]) -> tuple[list[FloatArray], list[FloatArray]]:
    """The least times from home to each state at the start of a table, and from its end home, s."""
    ahead, back = [np.zeros(1)], [np.zeros(1)]
    for table in tables[:-1]:
        ahead.append((ahead[-1][:, None] + table).min(axis=0))
    for table in tables[:0:-1]:
        back.append((table + back[-1]).min(axis=1))
    return ahead, back[::-1]


def _trace(tables: Sequence[FloatArray], ahead: Sequence[FloatArray]) -> list[int]:
    row = 0
    chosen = []
    for table, cost in zip(reversed(tables[1:]), reversed(ahead[1:]), strict=True):
        row = int((cost + table[:, row]).argmin())
        chosen.append(row)
    return chosen[::-1]


def _find_colliding(
    problem: TourProblem, order: Sequence[int], states: Sequence[States], current: States
) -> list[tuple[int, IntArray]]:
    """The places in `order` where the chosen state collides, with all colliding states there."""
    _test_states(problem, order, current)
    colliding = []
    for place, k in enumerate(order):
        key = make_state_key(current, place, k)
        if key in problem.colliding and key not in problem.free:
            keys = _test_states(problem, [k] * len(states[k]), states[k])
            colliding.append((place, np.flatnonzero([key in problem.colliding for key in keys])))
    return colliding


def _test_states(problem: TourProblem, item_indices: Sequence[int], states: States) -> list[bytes]:
    """Test those of the states (E,) of these items that are not known; returns the keys of all."""
    keys = make_state_keys(states, item_indices)
    rows = []
    for row, key in enumerate(keys):
        if key not in problem.free and key not in problem.colliding:
            rows.append(row)
    if rows:
        items = take_rows(item_indices, rows)
        collides = find_colliding_states(problem, items, states.pick(np.array(rows)))
        for row in np.array(rows)[collides].tolist():
            problem.colliding.add(keys[row])
    return keys


def _test_links(
    problem: TourProblem, links: Sequence[tuple[FloatArray, FloatArray]], coarse: bool = False
) -> list[bool]:
    """Which links collide at samples; results are kept. coarse: every eighth sample is tested."""
    keys = [make_link_key(*pair) for pair in links]
    prefixes = (b"", b"seen ", b"few ") if coarse else (b"", b"seen ")
    untested = []
    for k, key in enumerate(keys):
        is_clear = not problem.free.isdisjoint([prefix + key for prefix in prefixes])
        if key not in problem.colliding and not is_clear:
            untested.append(k)
    if untested:
        results = find_colliding_links(problem, take_rows(links, untested), coarse).tolist()
        for k, collides in zip(untested, results, strict=True):
            if collides:
                problem.colliding.add(keys[k])
            else:
                problem.free.add(prefixes[-1] + keys[k])
    return [key in problem.colliding for key in keys]


def _add_guesses(
    problem: TourProblem,
    ends: _LinkEnds,
    table: FloatArray,
    has_detour: BoolArray,
    links: IntArray,
) -> None:
    """Add the time of a detour to those links of a table that collide.

    table: (M, K) times of the links, s, changed.
    has_detour: (M, K) whether a link has its detour already, changed.
    links: indices into the flattened table.
    """
    rows, columns = np.divmod(links, table.shape[1])
    joints = list(zip(ends.start.leave[rows], ends.end.enter[columns], strict=True))
    branches = zip(ends.start.branch[rows].tolist(), ends.end.branch[columns].tolist(), strict=True)
    detours = []
    collides = np.array(_test_links(problem, joints, coarse=True), dtype=np.bool_)
    for link, pair in zip(joints, branches, strict=True):
        detours.append(_guess_detour(problem, link, ends.items, pair))
    table[rows[collides], columns[collides]] += np.array(detours)[collides]
    has_detour[rows[collides], columns[collides]] = True
