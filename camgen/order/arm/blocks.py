"""Points in blocks of one posture each: the fewest postures that reach them all.

An arm changes its posture seldom: most such motions collide, and those that do not take seconds.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from camgen.model.part import IntArray
from camgen.model.pose import frozen
from camgen.order.arm.items import States, find_states, join_states
from camgen.order.arm.search import TourProblem, find_hits, find_met

#: So many states of a posture, and so many of the quickest links between two, tell whether one leads to the other.
_SAMPLED, _ASKED = 400, 48
#: Postures of a tour at most.
_POSTURES = 3
#: A point with so many turns is easily reached.
_EASY = 4
#: Turns that are tried of a point that has fewer clear ones than that.
_FINER, _FEW_TURNS = 72, 12

#: Home among the items.
HOME = -1


class PostureBlocks(Struct, frozen=True):
    """Items in blocks of one posture each.

    branches: branch of each block, in the order of the blocks.
    branch: by item, the branch of its block, -1 for an item in no block.
    seconds: time of the links between the blocks, s.
    """

    branches: tuple[int, ...]
    branch: tuple[int, ...]
    seconds: float


def leave_clear(problem: TourProblem, kept: Sequence[int]) -> None:
    """Leaves those states of the items ``kept`` that collide with nothing."""
    states, owner = _gather(problem, kept)
    bad = find_hits(problem, owner.tolist(), states, 0)
    ends = np.cumsum([len(problem.states[k]) for k in kept])[:-1]
    for k, own in zip(kept, np.split(~bad, ends), strict=True):
        problem.tested.add(k)
        if own.any():
            problem.states[k] = problem.states[k].pick(own)
        else:
            # One that is lost keeps a state to stand in a table, and is in no order.
            problem.lost.add(k)
            problem.states[k] = problem.states[k].single(0)


def find_blocks(problem: TourProblem, kept: Sequence[int], most: int) -> list[PostureBlocks]:
    """Ways to part the items ``kept`` into blocks, at most so many, those first whose links take least time; none where
    ``_POSTURES`` are not enough, or no links between them are found.
    """
    states, owner = _gather(problem, kept)
    branches = np.unique(states.branch).tolist()
    reached = {b: set(owner[states.branch == b].tolist()) for b in branches}
    every = set(kept)
    took: dict[tuple[int, int], float] = {}
    for count in range(1, _POSTURES + 1):
        some = [
            s
            for s in itertools.combinations(branches, count)
            if set().union(*(reached[b] for b in s)) == every
        ]
        found = []
        for chosen in some:
            for ring in itertools.permutations(chosen):
                if ring > ring[::-1]:
                    continue
                seconds = sum(
                    _cross(problem, states, pair, took)
                    for pair in itertools.pairwise([HOME, *ring, HOME])
                )
                if math.isfinite(seconds):
                    found.append(PostureBlocks(ring, _assign(problem, ring, reached), seconds))
        if found:
            return sorted(found, key=lambda one: (one.seconds, one.branches))[:most]
    return []


def _assign(
    problem: TourProblem, ring: Sequence[int], reached: dict[int, set[int]]
) -> tuple[int, ...]:
    """By item the posture of its block: that which reaches most, where it leaves the item ``_EASY`` turns; else that
    which leaves it most.
    """
    branch = [-1] * len(problem.states)
    falling = sorted(ring, key=lambda b: (-len(reached[b]), b))
    for k in sorted(set().union(*(reached[b] for b in ring))):
        own = problem.states[k]
        turns = [len(np.unique(own.turn[own.branch == b])) for b in falling]
        branch[k] = next((b for b, count in zip(falling, turns, strict=True) if count >= _EASY), -1)
        if branch[k] < 0:
            branch[k] = falling[int(np.argmax(turns))]
    return tuple(branch)


def _gather(problem: TourProblem, items: Sequence[int]) -> tuple[States, IntArray]:
    """All states of ``items``, and the item of each."""
    count = [len(problem.states[k]) for k in items]
    return join_states([problem.states[k] for k in items]), np.repeat(np.array(items), count)


def _cross(
    problem: TourProblem,
    states: States,
    pair: tuple[int, int],
    took: dict[tuple[int, int], float],
) -> float:
    """Seconds of the quickest link that is found to be clear from a posture to another, or home; inf: none is."""
    pair = min(pair, pair[::-1])
    if pair not in took:
        home = States.fixed(problem.cost_model.home)
        start, end = (home if b == HOME else _sample(states, b) for b in pair)
        seconds = problem.cost_model.limits.between(start.leave, end.enter, 0.0)
        # Of each state the quickest link, so that they differ.
        best = seconds.argmin(axis=0)
        own = seconds[best, np.arange(len(best))]
        asked = np.argsort(own, kind="stable")[:_ASKED]
        links = [(start.leave[best[k]], end.enter[k]) for k in asked.tolist()]
        clear = ~find_met(problem, links)
        took[pair] = float(own[asked[clear]].min()) if clear.any() else math.inf
    return took[pair]


def _sample(states: States, branch: int) -> States:
    """At most ``_SAMPLED`` states of a branch, evenly taken."""
    rows = np.flatnonzero(states.branch == branch)
    return states.pick(rows[:: math.ceil(len(rows) / _SAMPLED)])


def narrow_states(problem: TourProblem, blocks: PostureBlocks) -> list[States]:
    """By item the states of its block's posture; of an item with few of them also those with turns in between."""
    made = [
        own if b < 0 else own.pick(own.branch == b)
        for own, b in zip(problem.states, blocks.branch, strict=True)
    ]
    few = [
        k
        for k, b in enumerate(blocks.branch)
        if b >= 0 and len(np.unique(made[k].turn)) < _FEW_TURNS
    ]
    finer = frozen(np.arange(_FINER) * (math.tau / _FINER) - math.pi)
    items = [problem.cost_model.items[k] for k in few]
    found = find_states(problem.setup, items, finer, np.arange(_FINER)[None]) if few else []
    more = [own.pick(own.branch == blocks.branch[k]) for k, own in zip(few, found, strict=True)]
    if more:
        clear = ~find_hits(
            problem, np.repeat(few, [len(own) for own in more]).tolist(), join_states(more)
        )
        for k, own, good in zip(
            few, more, np.split(clear, np.cumsum([len(own) for own in more])[:-1]), strict=True
        ):
            made[k] = join_states([made[k], own.pick(good)])
    return made
