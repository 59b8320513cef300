"""A tour through points that may come in any order: blocks of one posture each, order and turns bettered in turn."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from msgspec.structs import replace

from camgen.geometry.ragged import offsets
from camgen.motion.limits import from_rest
from camgen.order.arm.blocks import find_blocks, leave_clear, narrow_states
from camgen.order.arm.items import States, join_states
from camgen.order.arm.lattice import (
    Barred,
    Known,
    bar_links,
    go_round,
    pair_key,
    prove_links,
    settle_points,
)
from camgen.order.arm.layers import WALL, change_cost
from camgen.order.arm.search import STEPS, Found, Tell, Work, blocked_paths, shift_turns
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
_LOOSE = (STEPS[0], STEPS[1], 0.0, STEPS[2], 0.0)
#: An order of few points whose first states take so many times as long as the best tour so far is left; of more points
#: one that takes longer.
_HOPELESS = 1.03
#: rad: steps in which the turns of the best tour are moved at last.
_LAST = (math.radians(0.7), math.radians(0.25))
#: So often states are chosen anew where no way round a link is found.
_AGAIN = 6
#: Rounds of proof.
_PROOFS = 40


def are_points(work: Work, kept: Sequence[int]) -> bool:
    """Whether the items ``kept`` are each entered and left at one place, may come in any order, and are neither too
    many nor too few to be searched as points.
    """
    some = list(kept)
    if not work.wish.search or not work.wish.loose or not LEAST <= len(some) <= MOST:
        return False
    if (work.rules.parent[some] >= 0).any() or len(set(work.rules.rank[some].tolist())) > 1:
        return False
    return all(
        len(work.ground.items[k].gates) == 1 and work.states[k].branch.min() >= 0 for k in some
    )


def find_points(work: Work, kept: Sequence[int], tell: Tell) -> Found | None:
    """The soonest tour that is found through the points ``kept``; None where there is none.

    Leaves out the states that collide, as ``work.lost`` tells the points that have none.
    """
    leave_clear(work, kept)
    order = [k for k in kept if k not in work.lost]
    if len(order) < LEAST:
        return None
    known: Known = {}
    best: Found | None = None
    for narrow, begun, states in _begin(work, order):
        found = _search(narrow, begun, states, known, tell)
        if found is not None and (best is None or found.seconds < best.seconds):
            best = found
        if best is not None and best.seconds < WALL and len(order) > _FEW:
            break
    if best is None or best.seconds >= WALL:
        return None
    return _prove(work, best, known)


def _prove(work: Work, found: Found, known: Known) -> Found | None:
    """``found`` with other states where its links or paths collide between the places that were looked at."""
    barred: Barred = {}
    for _ in range(_PROOFS):
        if found.seconds < WALL and not blocked_paths(work, found):
            bad = prove_links(work, found)
            if not bad:
                return found
            # The one beside it would graze as well.
            bar_links(work, found, bad, barred)
        states = [
            join_states([own, _near(work, found.now, k)])
            for k, own in enumerate(shift_turns(work, found, STEPS[-1]))
        ]
        made = settle_points(work, found.order, states, known, barred)
        if made is None:
            return None
        found = go_round(work, made)
    return None


def _begin(work: Work, order: list[int]) -> Iterator[tuple[Work, list[int], list[States]]]:
    """What the search begins with: orders, and the states to choose from: those of the postures that promise most,
    then those of one posture each.
    """
    found = find_blocks(work, order, _TRIED)
    found = [one for one in found if one.seconds < found[0].seconds + _WORSE]
    some = sorted({b for one in found for b in one.branches})
    own = [one.pick(np.isin(one.branch, some)) if found else one for one in work.states]
    own = [one if len(one) else other for one, other in zip(own, work.states, strict=True)]
    work = replace(work, states=own)
    yield work, order, own
    if found:
        rank = {b: k for k, b in enumerate(found[0].branches)}
        yield (
            work,
            sorted(order, key=lambda k: rank[found[0].branch[k]]),
            narrow_states(work, found[0]),
        )


def _search(
    work: Work, order: list[int], states: list[States], known: Known, tell: Tell
) -> Found | None:
    best = settle_points(work, order, states, known)
    if best is None:
        return None
    best, idle = go_round(work, best), 0
    tell(f"joints, {best.seconds:.1f} s")
    for attempt in range(_ROUNDS):
        made = _round(work, best, known, attempt)
        tell(f"joints, {made.seconds:.1f} s, round {attempt + 1}")
        if made.seconds < best.seconds * (1 - _GAIN):
            best, idle = made, 0
        else:
            idle += 1
        if idle >= (_IDLE if len(order) <= _FEW else _IDLE - 1):
            break
    fine = go_round(work, _refine(work, best, known, _LAST))
    return fine if fine.seconds < best.seconds else best


def _round(work: Work, found: Found, known: Known, attempt: int) -> Found:
    """Another order, states for it, and finer turns."""
    step = _LOOSE[attempt % len(_LOOSE)]
    fine = shift_turns(work, found, step or STEPS[-1])
    order = _reorder(work, found, fine if step else _as_is(found), known, attempt)
    if order in (found.order, found.order[::-1]) and not step:
        return Found(order, found.now, np.inf)
    turning = _find_turning(found, order)
    states = [
        join_states([own, work.states[k] if k in turning else _near(work, found.now, k)])
        for k, own in enumerate(fine)
    ]
    made = settle_points(work, order, states, known)
    if made is None or made.seconds > (_HOPELESS if len(order) <= _FEW else 1.0) * found.seconds:
        return Found(order, found.now, np.inf)
    made = go_round(work, _refine(work, made, known, STEPS))
    for _ in range(_AGAIN):
        if made.seconds < WALL:
            break
        again = settle_points(work, order, states, known)
        made = made if again is None else go_round(work, again)
    return made


def _as_is(found: Found) -> list[States]:
    return [found.now.pick(np.array([k])) for k in range(len(found.now))]


def _refine(work: Work, found: Found, known: Known, steps: Sequence[float]) -> Found:
    """``found`` with turns moved in finer and finer steps."""
    for step in steps:
        while True:
            finer = settle_points(work, found.order, shift_turns(work, found, step), known)
            gained = 0.0 if finer is None else found.seconds - finer.seconds
            if finer is not None and gained > 0:
                found = finer
            if gained < _FINER * found.seconds:
                break
    return found


def _find_turning(found: Found, order: Sequence[int]) -> set[int]:
    """The items beside home, or beside another posture."""
    branch = found.now.branch
    pairs = {k for pair in pairwise(order) if branch[pair[0]] != branch[pair[1]] for k in pair}
    return pairs | {order[0], order[-1]}


def _near(work: Work, now: States, item: int) -> States:
    """The states of an item that are near to that which is chosen, and some of all others."""
    states = work.states[item]
    return states.pick(np.abs(states.enter - now.enter[item]).max(axis=1) < _BESIDE)


def _reorder(work: Work, found: Found, fine: list[States], known: Known, attempt: int) -> list[int]:
    """The order in which the points would be soonest gone through if each link had the turns of ``fine`` that suit it
    best.
    """
    order, ground = found.order, work.ground
    count = len(order)
    joints = [fine[k].enter for k in order]
    first = offsets([len(own) for own in joints])
    every = np.concatenate(joints)
    table = np.zeros((count + 1, count + 1))
    for k, own in enumerate(joints, 1):
        table[k, 1:] = np.minimum.reduceat(
            ground.limits.between(own, every, 0.0).min(axis=0), first[:-1]
        )
        table[k, 0] = table[0, k] = ground.limits.seconds(own - ground.home, 0.0).min()
    at = np.array([ground.items[k].position[ground.items[k].gates[0]] for k in order])
    way = np.sqrt(((at[:, None] - at[None]) ** 2).sum(axis=-1))
    table[1:, 1:] = np.maximum(
        table[1:, 1:], from_rest(way, ground.limits.speed, ground.limits.acceleration)
    )
    table[1:, 1:] += change_cost(ground, found.now.branch[order], found.now.branch[order])
    place = {-1: 0} | {k: row for row, k in enumerate(order, 1)}
    for (a, b), seconds in known.items():
        i, j = place[a], place[b]
        # Where no way round one of their links was found, others of theirs seldom have one.
        more = work.around.get(pair_key(a, b), 0.0)
        table[i, j] = table[j, i] = max(table[i, j], min(max(seconds, more), _FAR))
    ring = np.minimum(table, table.T)
    np.fill_diagonal(ring, 0.0)
    kicks = (_LATER if attempt else _KICKS) * count
    made = shorten_ring(ring, range(count + 1), kicks, attempt)
    return [order[k - 1] for k in made[1:]]
