"""Divides points into blocks of one posture each: the fewest postures that reach them all.

An arm should change its posture rarely: most such motions collide, and the others take seconds.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from camgen.geometry.ragged import count_rows
from camgen.model.part import IntArray
from camgen.model.pose import frozen
from camgen.model.sequences import take_rows
from camgen.order.arm.items import States, find_states, join_states, select_states
from camgen.order.arm.search import TourProblem, find_colliding_links, find_colliding_states

#: States of a posture among which links to another posture are searched.
_MAX_STATES = 400
#: Fastest links between two postures that are tested.
_TESTED_LINKS = 48
#: Maximum number of postures of a tour.
_MAX_POSTURES = 3
#: Number of rolls from which a point is easy to reach in a posture.
_EASY_ROLLS = 4
#: Rolls that are tried for a point with few clear ones.
_FINE_ROLLS = 72
#: Number of clear rolls below which more are tried.
_FEW_ROLLS = 12

#: Index of home among the items.
HOME = -1


class PostureBlocks(Struct, frozen=True):
    """Items in blocks of one posture each.

    branches: branch of each block, in the order of the blocks.
    branch: branch of the block of each item; -1 for an item in no block.
    seconds: time of the links between the blocks, s.
    """

    branches: tuple[int, ...]
    branch: tuple[int, ...]
    seconds: float


def select_clear_states(problem: TourProblem, kept: Sequence[int]) -> None:
    """Remove from `problem` the states of the items `kept` that collide."""
    states, owner = _gather(problem, kept)
    collides = find_colliding_states(problem, owner.tolist(), states, 0)
    problem.tested.update(kept)
    clear = select_states(take_rows(problem.states, kept), ~collides)
    for k, clear_states in zip(kept, clear, strict=True):
        if len(clear_states):
            problem.states[k] = clear_states
        else:
            # A lost item keeps a state for the tables, and is in no order.
            problem.lost.add(k)
            problem.states[k] = problem.states[k].single(0)


def find_blocks(problem: TourProblem, kept: Sequence[int], max_results: int) -> list[PostureBlocks]:
    """Find divisions of the items `kept` into blocks, those with the fastest links first.

    Returns an empty list if more than `_MAX_POSTURES` postures are needed, or no links between the
    blocks are found.
    """
    states, owner = _gather(problem, kept)
    branches = np.unique(states.branch).tolist()
    reached = {b: set(owner[states.branch == b].tolist()) for b in branches}
    link_times: dict[tuple[int, int], float] = {}
    for count in range(1, _MAX_POSTURES + 1):
        blocks = []
        for chosen in itertools.combinations(branches, count):
            if set().union(*map(reached.__getitem__, chosen)) != set(kept):
                continue
            for ring in itertools.permutations(chosen):
                if ring > ring[::-1]:
                    continue
                pairs = itertools.pairwise([HOME, *ring, HOME])
                seconds = sum(_time_link(problem, states, pair, link_times) for pair in pairs)
                if math.isfinite(seconds):
                    blocks.append(PostureBlocks(ring, _assign(problem, ring, reached), seconds))
        if blocks:
            return sorted(blocks, key=lambda division: (division.seconds, division.branches))[
                :max_results
            ]
    return []


def _assign(
    problem: TourProblem, ring: Sequence[int], reached: dict[int, set[int]]
) -> tuple[int, ...]:
    """Choose the posture of each item's block, -1 for none.

    It is the posture that reaches most items, among those with `_EASY_ROLLS` rolls for the item.
    Without one it is the posture with most rolls for it.
    """
    branch = [-1] * len(problem.states)
    by_reach = sorted(ring, key=lambda b: (-len(reached[b]), b))
    for k in sorted(set().union(*map(reached.__getitem__, ring))):
        states = problem.states[k]
        rolls = [len(np.unique(states.roll[states.branch == b])) for b in by_reach]
        # All counts of `_EASY_ROLLS` or more are alike, and the first of them is taken.
        branch[k] = by_reach[int(np.argmax(np.minimum(rolls, _EASY_ROLLS)))]
    return tuple(branch)


def _gather(problem: TourProblem, items: Sequence[int]) -> tuple[States, IntArray]:
    """All states of `items`, and the item of each."""
    of_items = take_rows(problem.states, items)
    return join_states(of_items), np.repeat(np.array(items), count_rows(of_items))


def _time_link(
    problem: TourProblem,
    states: States,
    pair: tuple[int, int],
    link_times: dict[tuple[int, int], float],
) -> float:
    """Time of the fastest clear link between two postures, or a posture and home, s.

    It is inf if none of the tested links is clear. link_times: results so far, added to.
    """
    pair = min(pair, pair[::-1])
    if pair not in link_times:
        home = States.fixed(problem.cost_model.home)
        start, end = (home if b == HOME else _sample(states, b) for b in pair)
        seconds = problem.cost_model.limits.between(start.leave, end.enter, 0.0)
        # The fastest link of each state, so that the links differ.
        best = seconds.argmin(axis=0)
        fastest = seconds[best, np.arange(len(best))]
        tested = np.argsort(fastest, kind="stable")[:_TESTED_LINKS]
        links = list(zip(start.leave[best[tested]], end.enter[tested], strict=True))
        clear = ~find_colliding_links(problem, links)
        link_times[pair] = float(fastest[tested[clear]].min(initial=math.inf))
    return link_times[pair]


def _sample(states: States, branch: int) -> States:
    """At most `_MAX_STATES` states of a branch, evenly spaced."""
    rows = np.flatnonzero(states.branch == branch)
    return states.pick(rows[:: math.ceil(len(rows) / _MAX_STATES)])


def narrow_states(problem: TourProblem, blocks: PostureBlocks) -> list[States]:
    """The states of each item in its block's posture, with more rolls if it has few."""
    narrowed, with_few_rolls = [], []
    for k, (states, branch) in enumerate(zip(problem.states, blocks.branch, strict=True)):
        narrowed.append(states if branch < 0 else states.pick(states.branch == branch))
        if branch >= 0 and len(np.unique(narrowed[k].roll)) < _FEW_ROLLS:
            with_few_rolls.append(k)
    if not with_few_rolls:
        return narrowed
    rolls = frozen(np.arange(_FINE_ROLLS) * (math.tau / _FINE_ROLLS) - math.pi)
    items = take_rows(problem.cost_model.items, with_few_rolls)
    fine = find_states(problem.setup, items, rolls, np.arange(_FINE_ROLLS)[None])
    for place, k in enumerate(with_few_rolls):
        fine[place] = fine[place].pick(fine[place].branch == blocks.branch[k])
    owner = np.repeat(with_few_rolls, count_rows(fine)).tolist()
    clear = ~find_colliding_states(problem, owner, join_states(fine))
    for k, clear_states in zip(with_few_rolls, select_states(fine, clear), strict=True):
        narrowed[k] = join_states([narrowed[k], clear_states])
    return narrowed
