"""The states of a tour's points that cost least together and collide with nothing, tested only where a tour goes.

The links from each point to the next are a table of all their states. The soonest way through all tables is tested; a
link that collides is out, with those beside it that would be next, and the way is found again: a table less a few
entries is no new search.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from msgspec import Struct

from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray
from camgen.motion.setup import Blockage, SampledMotion
from camgen.order.arm.items import States, join_states
from camgen.order.arm.layers import CHANGE, all_links
from camgen.order.arm.search import (
    Solution,
    TourProblem,
    find_hits,
    find_met,
    key_of,
    link_key,
    make_blocked_link,
)

#: Largest number of tours through the tables that are tested.
_WAYS = 60
#: Links that are tested together when a link collides: at first, the factor for the next time, and
#: the largest number.
_BATCH, _MORE, _MOST = 24, 2, 192
#: Cost of a detour beside its link, s, before a detour is found for a link of the same two points,
#: and where no detour exists.
AROUND, _NO_WAY = 2.0, 10.0

#: Distance that a link keeps if its ends do, mm. The check of the program tests other samples of a
#: link, and finds it nearer by less than this.
GRAZE, _EPS = 0.3, 1e-3

#: Least seconds of a link between two items, the lower index first, -1 for home.
Known = dict[tuple[int, int], float]
#: Rejected links between an item and the next, -1 for home: the joint values of both ends, and the
#: radius around them in which other links are rejected too, rad or mm.
Barred = dict[tuple[int, int], list[tuple[FloatArray, FloatArray, float]]]
_NO_BARS: Barred = {}
#: Links between two items that are rejected singly, before links near to them are rejected too.
_PATIENCE = 5
#: First radius around a rejected link and the largest, rad or mm. It doubles with each rejection.
_NEAR, _NEAREST = 0.02, 0.5


def choose_point_states(
    problem: TourProblem,
    order: Sequence[int],
    states: Sequence[States],
    known: Known,
    barred: Barred = _NO_BARS,
) -> Solution | None:
    """The soonest of ``states`` along ``order``, from home and back, with detours for blocked links.

    known: gets the seconds of links whose quickest ones collide.
    barred: links that are rejected.

    None where every state of an item collides.
    """
    tables = _lay(problem, order, states)
    links = _gather_ends(problem, states, order)
    for ends, table in zip(links, tables, strict=True):
        _bar(ends, table, barred.get(ends.items, ()))
    weighed = [np.zeros(table.shape, dtype=np.bool_) for table in tables]
    looked: list[set[tuple[int, int]]] = [set() for _ in tables]
    asked = [_BATCH] * len(tables)
    pairs = [(min(pair), max(pair)) for pair in pairwise([-1, *order, -1])]
    for _ in range(_WAYS):
        ahead, back = _add_up(tables)
        chosen = _trace(tables, ahead)
        seconds = float((ahead[-1] + tables[-1][:, 0]).min())
        if not np.isfinite(seconds):
            return None
        current = [states[k].single(at) for k, at in zip(order, chosen, strict=True)]
        hit = _find_hits(problem, order, states, join_states(current))
        for place, bad in hit:
            tables[place][:, bad] = np.inf
            tables[place + 1][bad] = np.inf
        if hit:
            continue
        home = problem.cost_model.home
        joints = [home, *(state.enter[0] for state in current), home]
        steps = list(enumerate(pairwise([0, *chosen, 0])))
        new = [place for place, step in steps if step not in looked[place]]
        stops = _find_met(problem, [(joints[place], joints[place + 1]) for place in new])
        for place in new:
            looked[place].add(steps[place][1])
        met = [
            p for p, stop in zip(new, stops, strict=True) if stop and not weighed[p][steps[p][1]]
        ]
        if not met:
            break
        for place in met:
            table = tables[place]
            before = ahead[place - 1][:, None] if place else 0.0
            after = back[place] if place < len(order) else 0.0
            through = before + table + after
            _weigh(problem, links[place], table, weighed[place], through, asked[place])
            asked[place] = min(asked[place] * _MORE, _MOST)
            known[pairs[place]] = float(table.min())
    every = list(states)
    for k, one in zip(order, current, strict=True):
        every[k] = one
    chosen_now = join_states([one.single(0) for one in every])
    branch = chosen_now.branch[list(order)]
    changes = int((branch[1:] != branch[:-1]).sum())
    return Solution(list(order), chosen_now, seconds - CHANGE * changes)


class _LinkEnds(Struct, frozen=True, eq=False):
    """The states between which the links of a table go.

    items: the item that is left and the item that is entered, -1 for home.
    start, end: (M) and (K) states of these items.
    """

    items: tuple[int, int]
    start: States
    end: States


def _gather_ends(
    problem: TourProblem, states: Sequence[States], order: Sequence[int]
) -> list[_LinkEnds]:
    """The ends of the links along ``order``, from and back to home."""
    home = States.fixed(problem.cost_model.home)
    links = []
    for one, other in pairwise([-1, *order, -1]):
        start = home if one < 0 else states[one]
        end = home if other < 0 else states[other]
        links.append(_LinkEnds((one, other), start, end))
    return links


def _bar(
    ends: _LinkEnds,
    table: FloatArray,
    bars: Sequence[tuple[FloatArray, FloatArray, float]],
) -> None:
    """Adds the cost of a link without a detour to the links that are near to rejected ones."""
    for a, b, near in bars:
        is_start = np.abs(ends.start.leave - a).max(axis=1) < near
        is_end = np.abs(ends.end.enter - b).max(axis=1) < near
        table[np.outer(is_start, is_end)] += _NO_WAY


def bar_links(
    problem: TourProblem, solution: Solution, places: Sequence[int], barred: Barred
) -> None:
    """Adds the links of ``solution`` at these indices, counted from home, to the rejected ones."""
    stops = [-1, *solution.order, -1]
    for place in places:
        one, other = stops[place], stops[place + 1]
        a, b = (
            problem.cost_model.home if k < 0 else solution.states.enter[k] for k in (one, other)
        )
        bars = barred.setdefault((one, other), [])
        more = len(bars) - _PATIENCE
        bars.append((a, b, min(_NEAR * 2**more, _NEAREST) if more >= 0 else 0.0))


def go_round(problem: TourProblem, solution: Solution) -> Solution:
    """``solution`` with its time, after detours for its blocked links were searched."""
    seconds = 0.0
    current, home = solution.states, problem.cost_model.home
    for one, other in pairwise([-1, *solution.order, -1]):
        a, b = (home if k < 0 else current.enter[k] for k in (one, other))
        key = link_key(a, b)
        if key in problem.shut and key not in problem.around:
            more = make_blocked_link(problem, a, b, 0.0).cost
            problem.around[key] = more
            cost = min(more, _NO_WAY)
            kind = _kind_key(*(-1 if k < 0 else int(current.branch[k]) for k in (one, other)))
            problem.around[pair_key(one, other)] = cost
            problem.around[kind] = min(problem.around.get(kind, cost), cost)
        seconds += float(
            problem.cost_model.limits.seconds(b - a, _measure_way(problem, one, other))
        ) + problem.around.get(key, 0.0)
    return Solution(solution.order, current, seconds)


def _guess_around(
    problem: TourProblem,
    link: tuple[FloatArray, FloatArray],
    items: tuple[int, int],
    branches: tuple[int, int],
) -> float:
    """Cost of the detour of a link, s, or of a link of the same items or the same postures."""
    for key in (link_key(*link), pair_key(*items)):
        if key in problem.around:
            return problem.around[key]
    return (
        problem.around.get(_kind_key(*branches), AROUND) if branches[0] != branches[1] else AROUND
    )


def _kind_key(one: int, other: int) -> bytes:
    """The key of the links between two postures, -1 for home."""
    return b"postures %d:%d" % (min(one, other), max(one, other))


def prove_links(problem: TourProblem, solution: Solution) -> list[int]:
    """The links that seemed clear and collide between the places that were looked at, or come within ``GRAZE`` where
    their ends do not: the check of the program looks at other places. They are known from now on.
    """
    home = problem.cost_model.home
    ends = list(pairwise([home, *(solution.states.enter[k] for k in solution.order), home]))
    keys = [link_key(*pair) for pair in ends]
    new = [
        k
        for k, key in enumerate(keys)
        if b"wide " + key not in problem.free and key not in problem.shut
    ]
    stops = problem.free_space.look([SampledMotion(np.stack(ends[k])) for k in new])
    bad = [isinstance(stop, Blockage) for stop in stops]
    for row, stop in enumerate(stops):
        if not isinstance(stop, Blockage) and stop < GRAZE - _EPS:
            bad[row] = bool(problem.free_space.gaps(np.stack(ends[new[row]])).min() >= GRAZE - _EPS)
    for k, met in zip(new, bad, strict=True):
        if met:
            problem.shut.add(keys[k])
        else:
            problem.free.update((keys[k], b"wide " + keys[k]))
    return [k for k, met in zip(new, bad, strict=True) if met]


def _measure_way(problem: TourProblem, one: int, other: int) -> float:
    """Distance of the TCP from point to point, mm; 0 from and to home, where the joints count."""
    if min(one, other) < 0:
        return 0.0
    items = problem.cost_model.items
    return float(
        np.linalg.norm(
            items[one].position[items[one].gates[0]] - items[other].position[items[other].gates[0]]
        )
    )


def pair_key(one: int, other: int) -> bytes:
    """The key of the links between two items, -1 for home."""
    return b"pair %d:%d" % (min(one, other), max(one, other))


def _lay(problem: TourProblem, order: Sequence[int], states: Sequence[States]) -> list[FloatArray]:
    """Seconds from home to each state of the first item, from each item to the next, and back home."""
    cost_model = problem.cost_model
    home = [
        cost_model.limits.seconds(states[k].enter - cost_model.home, 0.0)
        for k in (order[0], order[-1])
    ]
    return [
        home[0][None],
        *(table.copy() for table in all_links(cost_model, order, states, CHANGE)),
        home[1][:, None],
    ]


def _add_up(tables: Sequence[FloatArray]) -> tuple[list[FloatArray], list[FloatArray]]:
    """The least seconds from home to each state of each item, and from each state back home."""
    ahead = [tables[0][0]]
    for table in tables[1:-1]:
        ahead.append((ahead[-1][:, None] + table).min(axis=0))
    back = [tables[-1][:, 0]]
    for table in reversed(tables[1:-1]):
        back.append((table + back[-1]).min(axis=1))
    return ahead, back[::-1]


def _trace(tables: Sequence[FloatArray], ahead: Sequence[FloatArray]) -> list[int]:
    """The state of each item, in order, on the soonest tour."""
    at = 0
    chosen = []
    for table, cost in zip(reversed(tables[1:]), reversed(ahead), strict=True):
        at = int((cost + table[:, at]).argmin())
        chosen.append(at)
    return chosen[::-1]


def _find_hits(
    problem: TourProblem, order: Sequence[int], states: Sequence[States], current: States
) -> list[tuple[int, IntArray]]:
    """By place in the order where the chosen state collides: all states of that item that do."""
    new = [p for p, k in enumerate(order) if key_of(current, p, k) not in problem.free]
    if not new:
        return []
    _learn(problem, [order[p] for p in new], current.pick(np.array(new)))
    bad = [p for p in new if key_of(current, p, order[p]) in problem.shut]
    found = []
    for p in bad:
        k, own = order[p], states[order[p]]
        _learn(problem, [k] * len(own), own)
        found.append(
            (p, np.flatnonzero([key_of(own, row, k) in problem.shut for row in range(len(own))]))
        )
    return found


def _learn(problem: TourProblem, numbers: Sequence[int], states: States) -> None:
    """Tests those of the states (E,) of the items ``numbers`` that are not known."""
    keys = [key_of(states, row, k) for row, k in enumerate(numbers)]
    new = [
        row for row, key in enumerate(keys) if key not in problem.free and key not in problem.shut
    ]
    if new:
        hit = find_hits(problem, [numbers[row] for row in new], states.pick(np.array(new)))
        problem.shut.update(
            keys[row] for row, stops in zip(new, hit.tolist(), strict=True) if stops
        )


def _find_met(
    problem: TourProblem, links: Sequence[tuple[FloatArray, FloatArray]], few: bool = False
) -> list[bool]:
    """Which links collide, as far as is seen at places on the way, or at ``few`` of them; what is seen is kept."""
    keys = [link_key(*pair) for pair in links]
    enough = (b"", b"seen ", b"few ") if few else (b"", b"seen ")
    new = [
        k
        for k, key in enumerate(keys)
        if key not in problem.shut and not any(how + key in problem.free for how in enough)
    ]
    if new:
        for k, met in zip(
            new, find_met(problem, [links[k] for k in new], few).tolist(), strict=True
        ):
            if met:
                problem.shut.add(keys[k])
            else:
                problem.free.add((b"few " if few else b"seen ") + keys[k])
    return [key in problem.shut for key in keys]


def _weigh(
    problem: TourProblem,
    ends: _LinkEnds,
    table: FloatArray,
    weighed: BoolArray,
    through: FloatArray,
    count: int,
) -> None:
    """Adds the detour to those of the ``count`` soonest links of a table that collide.

    table: (M, K) seconds of the links, changed.
    weighed: (M, K) whether a link has its detour already, changed.
    through: (M, K) seconds of the soonest tour through each link, changed.
    """
    cost = through.ravel()
    cost[weighed.ravel()] = np.inf
    rows = np.argsort(cost, kind="stable")[:count]
    rows = rows[np.isfinite(cost[rows])]
    start, end = np.divmod(rows, table.shape[1])
    links = list(zip(ends.start.leave[start], ends.end.enter[end], strict=True))
    collides = np.array(_find_met(problem, links, few=True), dtype=np.bool_)
    branches = zip(ends.start.branch[start].tolist(), ends.end.branch[end].tolist(), strict=True)
    detours = [
        _guess_around(problem, link, ends.items, pair)
        for link, pair in zip(links, branches, strict=True)
    ]
    table[start[collides], end[collides]] += np.array(detours)[collides]
    weighed[start[collides], end[collides]] = True
