"""The states of a tour that cost least together, by dynamic programming from item to item."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from msgspec import Struct

from camgen.geometry.ragged import offsets
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray
from camgen.motion.limits import MotionLimits
from camgen.order.arm.items import Item, States, join_states

#: Cost of a link that is not allowed, s: more than any tour takes, and still a number.
FORBIDDEN = 1e6
#: Cost of a change of the posture beside its time, s: most such links collide or need a detour.
CHANGE = 1.0
#: Links of a tour that are worked out together: bounds the memory.
_AT_ONCE = 1_000_000
#: rad or mm: joint values that are no farther apart are the same.
SAME = 1e-6


class CostModel(Struct, frozen=True, eq=False):
    """The facts that the costs of all links share.

    items: the paths.
    limits: maximum speeds and accelerations.
    home: (J,) joint values.
    lines: whether the TCP goes straight from path to path, and the arm stays in its posture.
    """

    items: tuple[Item, ...]
    limits: MotionLimits
    home: FloatArray
    lines: bool


class BlockedLink(Struct, frozen=True, eq=False):
    """A link that collides, with all links whose ends are near to its ends, in both directions.

    start, end: (J,) joint values of its ends.
    radius: largest difference of a joint value at an end that is near, rad or mm.
    cost: time of the detour beside that of the link, s; ``FORBIDDEN`` without a detour.
    """

    start: FloatArray
    end: FloatArray
    radius: float
    cost: float


BlockedLinks = Sequence[BlockedLink]


def gate_places(item: Item, gate: IntArray) -> FloatArray:
    """TCP positions (M, 3) above the gates (M,), mm."""
    return item.position[item.gates[gate]]


def change_cost(cost_model: CostModel, start: IntArray, end: IntArray) -> FloatArray:
    """Cost (M, K) of a change of the posture from branches (M,) to branches (K,), s."""
    return np.asarray((FORBIDDEN if cost_model.lines else CHANGE) * (start[:, None] != end[None]))


def home_seconds(
    cost_model: CostModel, joints: FloatArray, blocked_links: BlockedLinks
) -> FloatArray:
    """Seconds (M,) of the links between home and joint values (M, J)."""
    cost = cost_model.limits.seconds(joints - cost_model.home, 0.0)[None]
    return np.asarray(add_blocked_costs(cost, cost_model.home[None], joints, blocked_links)[0])


def add_blocked_costs(
    cost: FloatArray, start: FloatArray, end: FloatArray, blocked_links: BlockedLinks
) -> FloatArray:
    """``cost`` (M, K) of links from ``start`` (M, J) to ``end`` (K, J), blocked links included."""
    extra = np.zeros((len(start), len(end)))
    for blocked in blocked_links:
        for a, b in ((blocked.start, blocked.end), (blocked.end, blocked.start)):
            one = np.abs(start - a).max(axis=1) < blocked.radius
            if one.any():
                both = one[:, None] & (np.abs(end - b).max(axis=1) < blocked.radius)[None]
                extra = np.maximum(extra, blocked.cost * both)
    return np.asarray(cost + extra)


class _Near(Struct, frozen=True, eq=False):
    """The states of all items, one item after the other, that are near to an end of a blocked link.

    enter, leave: (W, 2, S) whether a state is entered, or left, near to an end of a link.
    first: (items + 1,) the first state of each item.
    """

    enter: BoolArray
    leave: BoolArray
    first: IntArray

    def add(
        self, cost: FloatArray, one: int, other: int, blocked_links: BlockedLinks
    ) -> FloatArray:
        """``cost`` (M, K) from item to item with what its walls add."""
        start = self.leave[:, :, self.first[one] : self.first[one + 1]]
        end = self.enter[:, :, self.first[other] : self.first[other + 1]]
        extra: FloatArray = np.zeros((1, 1))
        if not blocked_links:
            return cost
        for blocked, side in np.argwhere(start.any(axis=2) & end[:, ::-1].any(axis=2)).tolist():
            more = blocked_links[blocked].cost * (
                start[blocked, side, :, None] & end[blocked, 1 - side, None]
            )
            extra = np.maximum(extra, more)
        return np.asarray(cost + extra)


def _find_near(states: Sequence[States], blocked_links: BlockedLinks) -> _Near:
    first = offsets([len(one) for one in states])
    if not blocked_links:
        none: BoolArray = np.zeros((0, 2, 0), dtype=np.bool_)
        return _Near(none, none, first)
    enter, leave = (
        np.concatenate([getattr(one, name) for one in states]) for name in ("enter", "leave")
    )
    shape = (len(blocked_links), 2, len(enter))
    near = np.zeros((2, *shape), dtype=np.bool_)
    for k, blocked in enumerate(blocked_links):
        for side, joints in enumerate((blocked.start, blocked.end)):
            for table, own in zip(near, (enter, leave), strict=True):
                table[k, side] = np.abs(own - joints).max(axis=1) < blocked.radius
    return _Near(near[0], near[1], first)


def all_links(
    cost_model: CostModel, order: Sequence[int], states: Sequence[States], change: float
) -> Iterator[FloatArray]:
    """Seconds (M, K) from each state of an item to each state of the next, collisions aside.

    change: cost of another posture, s.
    """
    count = np.array([len(states[k]) for k in order])
    most = int(count.max())
    if len(order) > 2 and most * most * len(order) > _AT_ONCE:
        for pair in pairwise(order):
            yield from all_links(cost_model, pair, states, change)
        return
    rows = np.minimum(np.arange(most), count[:, None] - 1) + offsets(count)[:-1, None]
    every = join_states([states[k] for k in order])
    gates = [gate_places(cost_model.items[k], states[k].gate) for k in order]
    enter, leave, branch = every.enter[rows], every.leave[rows], every.branch[rows]
    into, out = (np.concatenate([places[:, side] for places in gates])[rows] for side in (0, 1))
    way = np.sqrt(((into[1:, None] - out[:-1, :, None]) ** 2).sum(axis=-1))
    seconds = cost_model.limits.between(leave[:-1], enter[1:], way)
    seconds += change * (branch[:-1, :, None] != branch[1:, None])
    for k, table in enumerate(seconds):
        yield table[: count[k], : count[k + 1]]


def choose(
    cost_model: CostModel,
    order: Sequence[int],
    states: Sequence[States],
    blocked_links: BlockedLinks,
) -> tuple[float, IntArray]:
    """The states with the least time from home and back: seconds, and the state of each item."""
    near = _find_near(states, blocked_links)
    first = order[0]
    cost = home_seconds(cost_model, states[first].enter, blocked_links)
    backs: list[IntArray] = []
    before = first
    for item, links in zip(
        order[1:],
        all_links(cost_model, order, states, FORBIDDEN if cost_model.lines else CHANGE),
        strict=True,
    ):
        total = cost[:, None] + near.add(links, before, item, blocked_links)
        best = total.argmin(axis=0)
        backs.append(best)
        cost = total[best, np.arange(total.shape[1])]
        before = item
    cost = cost + home_seconds(cost_model, states[before].leave, blocked_links)
    chosen = np.zeros(len(states), dtype=np.int64)
    at = int(cost.argmin())
    for place in range(len(order) - 1, -1, -1):
        chosen[order[place]] = at
        if place:
            at = int(backs[place - 1][at])
    return float(cost.min()), chosen
