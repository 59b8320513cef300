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
from msgspec import Struct

from camgen.geometry.ragged import offsets
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray
from camgen.motion.setup import Hit, Room, Setup, Track
from camgen.order.arm.detours import find_detour
from camgen.order.arm.items import States, Stood, join_states, stand, turn_round
from camgen.order.arm.layers import (
    SAME,
    WALL,
    Ground,
    Wall,
    add_walls,
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
_LOOSE = 3
#: rad: joints turn by no more between two places at which a link is looked at before it is proved.
_LOOK = math.radians(2.5)
#: Shuffles of the search for an order, as a share of the usual number; more paths than that have none.
_EFFORT, _CROWD = 0.3, 300
#: Exchanges for each of a tour's points, and the most.
_KICKS, _MOST_KICKS = 6, 4_000


class Wish(Struct, frozen=True):
    """search: the order may change. loose: any turn is as good, so that turns are moved in fine steps. floor: mm, work
    frame, below which the tip does not go on a link.
    """

    search: bool
    loose: bool
    floor: float


class Work(Struct, frozen=True, eq=False):
    """What the search knows. states: by item; narrowed where some collide, as ``tested`` says. walls: links that
    collide. free: links and states that are known to be clear. lost: items that no state is left of. shut: states
    that collide between two looks. detours: ways round links that collide. around: s, by link, what they cost more.
    """

    setup: Setup
    room: Room
    ground: Ground
    states: list[States]
    rules: matrix.Rules
    wish: Wish
    tested: set[int]
    walls: list[Wall]
    free: set[bytes]
    lost: set[int]
    shut: set[bytes]
    detours: dict[bytes, tuple[FloatArray, ...]]
    around: dict[bytes, float]


class Found(Struct, eq=False):
    """A tour. order: items. now: (n) their states, by item. seconds: of its links."""

    order: list[int]
    now: States
    seconds: float


Tell = Callable[[str], None]


def find_tour(work: Work, order: Sequence[int], prove: bool, tell: Tell) -> Found:
    """A first tour in the ``order``. prove: states, and links, are tested for collisions."""
    found = settle(work, list(order), list(work.states), prove)
    for attempt in range(_BEGINNINGS if prove else 0):
        tell(f"joints, {found.seconds:.1f} s, beginning {attempt + 1}")
        if not found.order or not blocked_links(work, found):
            break
        found = settle(work, found.order, list(work.states), prove)
    return found


def better_tour(work: Work, found: Found, prove: bool, tell: Tell) -> Found:
    """``found`` with its states and its order bettered in turn."""
    found = move_turns(work, found, prove)
    for _ in range(_LOOSE if work.wish.search else 0):
        loose = move_turns(work, _loosen(work, found, prove), prove)
        if loose.seconds >= found.seconds:
            break
        found = loose
    for attempt in range(_ROUNDS):
        tell(f"joints, {found.seconds:.1f} s, round {attempt + 1}")
        before = found.seconds
        found = _move_gates(work, found)
        if work.wish.search:
            found = _reorder(work, found, attempt)
        found = move_turns(work, found, prove)
        if before - found.seconds < _GAIN * before:
            break
    return found


def settle(
    work: Work, order: list[int], states: list[States], prove: bool, known: States | None = None
) -> Found:
    """The best of ``states`` along ``order`` that collide with nothing. known: (n) states that need no test."""
    ground = work.ground
    while True:
        cost, chosen = choose(ground, order, states, work.walls)
        now = join_states([states[k].pick(chosen[[k]]) for k in range(len(states))])
        new = [k for k in order if prove and not _is_known(work, now, known, k)]
        hit = find_hits(work, new, now.pick(np.array(new, dtype=np.int64)))
        if not hit.any():
            return Found(order, now, cost)
        asked = [
            (k, states[k], int(chosen[k]))
            for k, stops in zip(new, hit.tolist(), strict=True)
            if stops
        ]
        for (k, _, _), left in zip(asked, _prune(work, asked), strict=True):
            if not len(left):
                work.lost.add(k)
                order = [item for item in order if item != k]
            states[k] = left if len(left) else now.pick(np.array([k]))
        if not order:
            return Found(order, now, 0.0)


def _is_known(work: Work, now: States, known: States | None, item: int) -> bool:
    same = (
        known is not None
        and known.turn[item] == now.turn[item]
        and known.branch[item] == now.branch[item]
    )
    return bool(now.branch[item] < 0 or same or key_of(now, item) in work.free)


def key_of(states: States, row: int, item: int | None = None) -> bytes:
    """What tells a state of an item, that of the same number where none is given, from all others of it, but for whole
    turns and gates.
    """
    return b"%d:%d:%.6f" % (row if item is None else item, states.branch[row], states.turn[row])


def _stand(work: Work, numbers: Sequence[int], states: States) -> Stood:
    """E states of the items ``numbers`` (E,) as they are run."""
    items = [work.ground.items[k] for k in numbers]
    loop = np.array([item.closed for item in items], dtype=np.bool_)
    forward = loop | (states.gate[:, 0] == 0)
    near = np.where(forward[:, None], states.enter, states.leave)
    return stand(
        work.setup, items, states.turn, states.branch, np.where(loop, states.gate[:, 0], 0), near
    )


def find_hits(work: Work, numbers: Sequence[int], states: States, looks: int = 0) -> BoolArray:
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
            _find_hits(work, [numbers[k] for k in once], states.pick(once), looks).tolist(),
            strict=True,
        )
    )
    if not looks:
        work.free.update(key for key, stops in bad.items() if not stops)
    return np.array([bad[key] or key in work.shut for key in keys], dtype=np.bool_)


def _find_hits(work: Work, numbers: Sequence[int], states: States, looks: int) -> BoolArray:
    stood = _stand(work, numbers, states)
    bad = ~stood.good
    rows = []
    for k in np.flatnonzero(stood.good).tolist():
        own = np.arange(stood.first[k], stood.first[k + 1])
        if looks and len(own) > looks:
            own = own[np.unique(np.round(np.linspace(0, len(own) - 1, looks)).astype(np.int64))]
        # What stands at the height of travel is there twice.
        moved = np.abs(np.diff(stood.joints[own], axis=0)).max(axis=1) > 0
        rows.append(own[np.append(moved, True)])
    if not rows:
        return bad
    flat = np.concatenate(rows)
    owner = np.repeat(np.flatnonzero(stood.good), [len(own) for own in rows])
    # A state that collides at its last look is not looked at again.
    last = np.append(owner[1:] != owner[:-1], True)
    for some in (last, ~last):
        asked = np.flatnonzero(some & ~bad[owner])
        bad[owner[asked[~work.setup.clear(stood.joints[flat[asked]])]]] = True
    return bad


def _prune(work: Work, asked: Sequence[tuple[int, States, int]]) -> list[States]:
    """For each item, its states and the chosen one, which collides: the states without that and all others that do."""
    left = []
    for _, states, chosen in asked:
        same = (states.branch == states.branch[chosen]) & (states.turn == states.turn[chosen])
        left.append(states.pick(~same))
    open_ = [
        k
        for k, (item, states, _) in enumerate(asked)
        if not (item in work.tested and states is work.states[item])
    ]
    numbers = [asked[k][0] for k in open_ for _ in range(len(left[k]))]
    if numbers:
        every = join_states([left[k] for k in open_])
        free = np.array(
            [key_of(every, row, item) in work.free for row, item in enumerate(numbers)],
            dtype=np.bool_,
        )
        tried = np.flatnonzero(~free & (every.branch >= 0))
        bad = np.zeros(len(numbers), dtype=np.bool_)
        bad[tried] = find_hits(work, [numbers[k] for k in tried], every.pick(tried), _FEW)
        ends = np.cumsum([len(left[k]) for k in open_])[:-1]
        for k, own in zip(open_, np.split(bad, ends), strict=True):
            left[k] = left[k].pick(~own)
    for (item, states, chosen), rest in zip(asked, left, strict=True):
        if states is work.states[item]:
            work.tested.add(item)
            # One that is lost keeps a state to stand in a table, and is in no order.
            work.states[item] = rest if len(rest) else states.pick(np.array([chosen]))
    return left


def _loosen(work: Work, found: Found, prove: bool) -> Found:
    """The order in which the points would be soonest gone through if each link had the turns that suit it best, with
    the states that are chosen for it: other than the order that states were chosen for.
    """
    order, ground, now = found.order, work.ground, found.now
    if not _is_plain(work, found) or not work.wish.loose or not 4 < len(order) <= _CROWD:
        return found
    fine = shift_turns(work, found, STEPS[0])
    count = len(order)
    ring = np.zeros((count + 1, count + 1))
    joints = [fine[k].enter for k in order]
    first = offsets([len(own) for own in joints])
    every = np.concatenate(joints)
    for k, own in enumerate(joints, 1):
        took = np.minimum.reduceat(ground.limits.between(own, every, 0.0).min(axis=0), first[:-1])
        ring[k, 1:] = took
        ring[k, 0] = ring[0, k] = ground.limits.seconds(own - ground.home, 0.0).min()
    np.fill_diagonal(ring, 0.0)
    ring[1:, 1:] += change_cost(ground, now.branch[order], now.branch[order])
    ring = np.minimum(ring, ring.T)
    made = shorten_ring(ring, range(count + 1), min(_KICKS * count, _MOST_KICKS))
    return settle(work, [order[k - 1] for k in made[1:]], fine, prove, now)


def _is_plain(work: Work, found: Found) -> bool:
    """Whether all items are left where they are entered, and may come in any order."""
    own = found.now.pick(np.array(found.order))
    free = (work.rules.parent[found.order] < 0).all() and len(
        set(work.rules.rank[found.order].tolist())
    ) == 1
    return bool(free and not (own.enter != own.leave).any())


def move_turns(work: Work, found: Found, prove: bool, still: Set[int] = frozenset()) -> Found:
    """Turns a little to both sides of those that are chosen, in finer and finer steps, but of the items ``still``."""
    sizes = [len(work.ground.items[k]) for k in found.order]
    if not work.wish.loose or sum(sizes) > _WORTH:
        return found
    for step in STEPS:
        while True:
            better = settle(
                work, found.order, shift_turns(work, found, step, still), prove, found.now
            )
            gained = found.seconds - better.seconds
            found = better if gained > 0 else found
            if gained < _GAIN * found.seconds:
                break
    return found


def shift_turns(
    work: Work, found: Found, step: float, still: Set[int] = frozenset()
) -> list[States]:
    """By item its state and, but of the items ``still``, those with other turns within ``_SIDES`` steps."""
    now = found.now
    asked = [k for k in found.order if now.branch[k] >= 0 and k not in still]
    shifts = step * np.array([k for k in range(-_SIDES, _SIDES + 1) if k])
    own = np.repeat(asked, len(shifts))
    turn = now.turn[own] + np.tile(shifts, len(asked))
    turn = np.remainder(turn + math.pi, math.tau) - math.pi
    wanted = now.pick(own)
    wanted = States(wanted.enter, wanted.leave, wanted.gate, turn, wanted.branch)
    made, good = _place(work, own.tolist(), wanted)
    # Where the arm cannot go there evenly it is another state, which the grid has.
    good &= np.abs(made.enter - now.enter[own]).max(
        axis=1, initial=0.0
    ) < 4 * _SIDES * step + math.radians(10)
    states = [now.pick(np.array([k])) for k in range(len(now))]
    for place, k in enumerate(asked):
        rows = np.arange(place * len(shifts), (place + 1) * len(shifts))
        states[k] = join_states([states[k], made.pick(rows[good[rows]])])
    return states


def _place(work: Work, numbers: Sequence[int], states: States) -> tuple[States, BoolArray]:
    """States of the items ``numbers`` with the joints at their gates worked out anew, and which can be run."""
    if not len(numbers):
        return states, np.zeros(0, dtype=np.bool_)
    stood = _stand(work, numbers, states)
    gates = [work.ground.items[k].gates for k in numbers]
    at = (
        np.array([own[pair] for own, pair in zip(gates, states.gate, strict=True)])
        + stood.first[:-1, None]
    )
    good = stood.good & np.isfinite(stood.joints[at]).all(axis=(1, 2))
    return States(
        stood.joints[at[:, 0]], stood.joints[at[:, 1]], states.gate, states.turn, states.branch
    ), good


def _move_gates(work: Work, found: Found) -> Found:
    """The same postures and turns, entered at other gates."""
    now = found.now
    states = [now.pick(np.array([k])) for k in range(len(now))]
    for k in found.order:
        item = work.ground.items[k]
        if item.reversible:
            states[k] = join_states([states[k], turn_round(states[k])])
        elif item.closed and len(item.gates) > 1 and now.branch[k] >= 0:
            stood = _stand(work, [k], states[k])
            joints = stood.joints[item.gates]
            numbers = np.arange(len(joints))
            count = len(numbers)
            every = States(
                joints,
                joints,
                np.stack([numbers] * 2, axis=1),
                np.full(count, now.turn[k]),
                np.full(count, now.branch[k]),
            )
            states[k] = join_states([states[k], every])
    return settle(work, found.order, states, False)


def _reorder(work: Work, found: Found, seed: int) -> Found:
    """The states as they are in the shortest order that is found."""
    order, now, ground = found.order, found.now, work.ground
    count = len(order)
    if not 2 < count <= MANY:
        return found
    own = now.pick(np.array(order))
    flips = np.array([ground.items[k].reversible for k in order])
    table = _tables(work, order, own)
    # What cannot be turned round is neither left where it is entered nor entered where it is left.
    stiff = ~flips & (np.abs(own.enter - own.leave).max(axis=1) > 0)
    table.between[stiff, 0] = table.between[:, :, stiff, 1] = WALL
    table.first[stiff, 1] = table.last[stiff, 0] = WALL
    rules = matrix.Rules(_inner(work.rules.parent, order), work.rules.rank[order])
    plain = bool((rules.parent < 0).all() and len(set(rules.rank.tolist())) == 1)
    if _is_plain(work, found):
        ring = np.zeros((count + 1, count + 1))
        ring[1:, 1:] = table.between[:, 0, :, 0]
        ring[0, 1:] = ring[1:, 0] = table.first[:, 0]
        ring = np.minimum(ring, ring.T)
        made = shorten_ring(ring, range(count + 1), min(_KICKS * count, _MOST_KICKS), seed)
        seconds = float(ring[made, np.roll(made, -1)].sum())
        better = Found([order[k - 1] for k in made[1:]], now, seconds)
        return better if seconds < found.seconds - 1e-9 else found
    start = (list(range(count)), [False] * count)
    effort = _EFFORT if count <= _CROWD else 0.0
    items, backs = matrix.shortest(table, seed, effort, start, None if plain else rules)
    seconds = matrix.total(table, items, backs)
    if seconds >= found.seconds - 1e-9:
        return found
    turned = np.array(
        [order[k] for k, back in zip(items, backs, strict=True) if back and flips[k]],
        dtype=np.int64,
    )
    enter, leave, gate = now.enter.copy(), now.leave.copy(), now.gate.copy()
    enter[turned], leave[turned], gate[turned] = (
        now.leave[turned],
        now.enter[turned],
        now.gate[turned][:, ::-1],
    )
    return Found(
        [order[k] for k in items], States(enter, leave, gate, now.turn, now.branch), seconds
    )


def _inner(parent: IntArray, order: Sequence[int]) -> IntArray:
    """The parents among the items of ``order``, by their places in it."""
    place = np.full(len(parent) + 1, -1)
    place[list(order)] = np.arange(len(order))
    return np.asarray(place[parent[list(order)]])


def _tables(work: Work, order: Sequence[int], own: States) -> matrix.Table:
    """The seconds of all links between the ends of the items, and from and to home."""
    ground, count = work.ground, len(order)
    ends = np.stack([own.enter, own.leave], axis=1).reshape(2 * count, -1)
    places = np.stack(
        [gate_places(ground.items[k], own.gate[i]) for i, k in enumerate(order)], axis=0
    ).reshape(2 * count, 3)
    branch = np.repeat(own.branch, 2)
    table = ground.limits.between(
        ends, ends, np.linalg.norm(places[:, None] - places[None], axis=-1)
    )
    table += change_cost(ground, branch, branch)
    table = add_walls(table, ends, ends, work.walls)
    home = home_seconds(ground, ends, work.walls).reshape(count, 2)
    return matrix.Table(table.reshape(count, 2, count, 2), home, home.copy())


# What a tour uses is proved: the paths as they are run, and the links between them.


def prove_tour(work: Work, found: Found, tell: Tell) -> Found:
    """``found`` with other states where paths or links collide, as far as there are any."""
    for attempt in range(_REPAIRS if found.order else 0):
        touched = blocked_paths(work, found) | blocked_links(work, found)
        if not touched:
            return found
        tell(f"joints, {found.seconds:.1f} s, repair {attempt + 1}")
        found = _repair(work, found, touched)
    return found


def _repair(work: Work, found: Found, touched: set[int]) -> Found:
    """The tour with states chosen anew for the items that are ``touched`` and those beside them."""
    order, now = found.order, found.now
    place = {item: k for k, item in enumerate(order)}
    beside = {p + d for p in (place[item] for item in touched) for d in (-1, 0, 1)}
    near = {order[p] for p in beside if 0 <= p < len(order)}
    fine = (
        shift_turns(work, found, STEPS[0])
        if work.wish.loose
        else [now.pick(np.array([k])) for k in range(len(now))]
    )
    states = [
        join_states([own, work.states[k]])
        if k in near and len(work.states[k])
        else now.pick(np.array([k]))
        for k, own in enumerate(fine)
    ]
    return settle(work, order, states, True)


def blocked_paths(work: Work, found: Found) -> set[int]:
    """The items whose states, new ones, collide between two looks."""
    asked = [
        k
        for k in found.order
        if found.now.branch[k] >= 0 and _proved(found.now, k) not in work.free
    ]
    if not asked:
        return set()
    stood = _stand(work, asked, found.now.pick(np.array(asked)))
    tracks, owner = [], []
    for place, k in enumerate(asked):
        joints = stood.joints[stood.first[place] : stood.first[place + 1]]
        item = work.ground.items[k]
        tracks.append(Track(joints[: item.last + 1]))
        tracks += [Track(joints[[item.before[gate], gate]]) for gate in item.gates[1:].tolist()]
        owner += [k] * len(item.gates)
    hit = {
        k for k, stop in zip(owner, work.room.look(tracks), strict=True) if isinstance(stop, Hit)
    }
    work.shut.update(key_of(found.now, k) for k in hit)
    work.free.difference_update(key_of(found.now, k) for k in hit)
    work.free.update(_proved(found.now, k) for k in asked if k not in hit)
    return hit


def _proved(now: States, item: int) -> bytes:
    return b"path " + key_of(now, item)


def blocked_links(work: Work, found: Found) -> set[int]:
    """The items at the ends of links, new ones, that collide, or on which the tip comes too low."""
    blocked = find_blocked_links(work, found)
    work.walls.extend(
        wall_between(work, *_ends_of(work, found.now, pair), _LONG) for pair in blocked
    )
    return {item for pair in blocked for item in pair if item >= 0}


def find_blocked_links(work: Work, found: Found) -> list[tuple[int, int]]:
    """The links, new ones, that collide or on which the tip comes too low: the items at their ends, -1 for home."""
    pairs = list(zip([-1, *found.order], [*found.order, -1], strict=True))
    ends = {pair: _ends_of(work, found.now, pair) for pair in pairs}
    new = [
        one
        for one in pairs
        if link_key(*ends[one]) not in work.free and detour_of(work, *ends[one]) is None
    ]
    return [
        one
        for one, met in zip(new, find_blocked(work, [ends[one] for one in new]), strict=True)
        if met
    ]


def _ends_of(work: Work, now: States, pair: tuple[int, int]) -> tuple[FloatArray, FloatArray]:
    """The joint values at both ends of the link between two items, -1 for home."""
    home, (a, b) = work.ground.home, pair
    return (home if a < 0 else now.leave[a], home if b < 0 else now.enter[b])


def find_blocked(
    work: Work, links: Sequence[tuple[FloatArray, FloatArray]], surely: bool = True
) -> list[bool]:
    """Which motions of the joints collide, or lead the tip too low. surely: what is not found at some places on the way
    is proved, and noted as clear.
    """
    if not links:
        return []
    blocked = np.array([link_key(*pair) not in work.free for pair in links])
    new = np.flatnonzero(blocked)
    if not len(new):
        return [False] * len(links)
    met = find_met(work, [links[k] for k in new.tolist()])
    blocked[new] = met
    left = new[~met]
    if surely and len(left):
        stops = work.room.look([Track(np.stack(links[k])) for k in left.tolist()])
        blocked[left] = [isinstance(stop, Hit) for stop in stops]
        work.free.update(link_key(*links[k]) for k in left[~blocked[left]].tolist())
    return [bool(stop) for stop in blocked]


def find_met(
    work: Work, links: Sequence[tuple[FloatArray, FloatArray]], few: bool = False
) -> BoolArray:
    """Which motions of the joints collide at some places on the way, or lead the tip below ``Wish.floor``. few: at
    every eighth place only.
    """
    counts = [max(math.ceil(float(np.abs(b - a).max()) / _LOOK), 2) for a, b in links]
    rows = [
        a + np.linspace(0.0, 1.0, n + 1)[:, None] * (b - a)
        for (a, b), n in zip(links, counts, strict=True)
    ]
    owner = np.repeat(np.arange(len(links)), [len(own) for own in rows])
    flat = np.concatenate(rows)
    met = np.zeros(len(links), dtype=np.bool_)
    if math.isfinite(work.wish.floor):
        rotation, origin = flange(work.setup.robot, flat)
        tip = origin + rotation @ np.asarray(work.setup.flange_from_tool.origin)
        base = work.setup.base_from_work
        met[owner[(tip - np.asarray(base.origin)) @ base.rotation[:, 2] < work.wish.floor]] = True
    # Every eighth place first: most motions that collide do so for long.
    step = np.concatenate([np.arange(len(own)) for own in rows])
    for some in (step % 8 == 4,) if few else (step % 8 == 4, step % 8 != 4):
        asked = np.flatnonzero(some & ~met[owner])
        met[owner[asked[~work.setup.clear(flat[asked])]]] = True
    return met


def link_key(a: FloatArray, b: FloatArray) -> bytes:
    """What tells a link of the joints from all others; the way back is the same."""
    ends = sorted([np.round(a, 6).tobytes(), np.round(b, 6).tobytes()])
    return b"link " + ends[0] + ends[1]


def wall_between(work: Work, a: FloatArray, b: FloatArray, least: float) -> Wall:
    """What is known of a link that collides, with a way round it, which is looked for where a joint goes ``least`` rad
    or mm or more.
    """
    far = float(np.abs(b - a).max())
    near = max((_ALIKE if far < _LONG else _FAR_ALIKE) * far, SAME)
    if far < least:
        return Wall(a, b, near, WALL)
    others = np.concatenate(
        [work.ground.home[None], *(np.stack(way) for way in work.detours.values())]
    )
    found = find_detour(
        work.setup.robot,
        work.ground.limits,
        (a, b),
        others,
        work.setup.clear,
        partial(find_blocked, work, surely=False),
    )
    if found is None or any(find_blocked(work, list(pairwise([a, *found, b])))):
        return Wall(a, b, near, WALL)
    work.detours[a.tobytes() + b.tobytes()] = found
    places = np.stack([a, *found, b])
    longer = work.ground.limits.seconds(
        np.diff(places, axis=0), 0.0
    ).sum() - work.ground.limits.seconds(b - a, 0.0)
    return Wall(a, b, near, float(longer))


def detour_of(work: Work, a: FloatArray, b: FloatArray) -> tuple[FloatArray, ...] | None:
    """The way round that was found for a link, None where none was."""
    if a.tobytes() + b.tobytes() in work.detours:
        return work.detours[a.tobytes() + b.tobytes()]
    back = work.detours.get(b.tobytes() + a.tobytes())
    return None if back is None else back[::-1]
