"""Chooses the states of a tour that take least time together, by dynamic programming."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from msgspec import Struct

from camgen.geometry.ragged import compute_offsets, count_rows
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray
from camgen.model.sequences import take_rows
from camgen.motion.limits import MotionLimits
from camgen.order.arm.items import Item, States, join_states

#: Cost of a link that is not allowed, s: more than any tour takes, and still a number.
FORBIDDEN = 1e6
#: Cost of a change of the posture besides its time, s: most such links collide or need a detour.
POSTURE_COST = 1.0
#: Links of a tour that are computed together: bounds the memory.
_MAX_LINKS_AT_ONCE = 1_000_000
#: rad or mm: joint values that are no farther apart are the same.
SAME = 1e-6


class CostModel(Struct, frozen=True, eq=False):
    """The facts that the costs of all links share.

    items: the paths.
    limits: maximum speeds and accelerations.
    home: (J,) joint values.
    lines: whether the TCP goes straight from path to path, and the arm keeps its posture.
    """

    items: tuple[Item, ...]
    limits: MotionLimits
    home: FloatArray
    lines: bool

    @property
    def posture_cost(self) -> float:
        """Cost of a change of the posture besides its time, s."""
        return FORBIDDEN if self.lines else POSTURE_COST


class BlockedLink(Struct, frozen=True, eq=False):
    """A link that collides, with all links whose ends are near to its ends, in both directions.

    start, end: (J,) joint values of its ends.
    radius: largest difference of a joint value at an end that is near, rad or mm.
    cost: time of the detour minus that of the link, s; `FORBIDDEN` without a detour.
    """

    start: FloatArray
    end: FloatArray
    radius: float
    cost: float


BlockedLinks = Sequence[BlockedLink]


def compute_gate_positions(item: Item, gate: IntArray) -> FloatArray:
    """TCP positions (M, 3) above gates of these indices (M,), mm."""
    return item.position[item.gates[gate]]


def compute_posture_costs(cost_model: CostModel, start: IntArray, end: IntArray) -> FloatArray:
    """Cost (M, K) of a change of the posture from branches (M,) to branches (K,), s."""
    return np.asarray(cost_model.posture_cost * (start[:, None] != end[None]))


def time_links_home(
    cost_model: CostModel, joints: FloatArray, blocked_links: BlockedLinks
) -> FloatArray:
    """Times (M,) of the links between home and joint values (M, J), s."""
    cost = cost_model.limits.seconds(joints - cost_model.home, 0.0)[None]
    return np.asarray(add_blocked_costs(cost, cost_model.home[None], joints, blocked_links)[0])


def add_blocked_costs(
    cost: FloatArray, start: FloatArray, end: FloatArray, blocked_links: BlockedLinks
) -> FloatArray:
    """`cost` (M, K) of links from `start` (M, J) to `end` (K, J) with that of their detours, s."""
    extra = np.zeros((len(start), len(end)))
    for blocked in blocked_links:
        for a, b in ((blocked.start, blocked.end), (blocked.end, blocked.start)):
            near_start = np.abs(start - a).max(axis=1) < blocked.radius
            if near_start.any():
                near_both = (
                    near_start[:, None] & (np.abs(end - b).max(axis=1) < blocked.radius)[None]
                )
                extra = np.maximum(extra, blocked.cost * near_both)
    return np.asarray(cost + extra)


class _NearStates(Struct, frozen=True, eq=False):
    """The states of all items, one item after the other, that are near to an end of a blocked link.

    enter, leave: (W, 2, S) whether a state is entered, or left, near to an end of a link.
    first: (items + 1,) the first state of each item.
    blocked_links: the W links.
    """

    enter: BoolArray
    leave: BoolArray
    first: IntArray
    blocked_links: BlockedLinks

    def add_costs(self, cost: FloatArray, item: int, next_item: int) -> FloatArray:
        """`cost` (M, K) of the links from item to item with that of their detours, s."""
        start = self.leave[:, :, self.first[item] : self.first[item + 1]]
        end = self.enter[:, :, self.first[next_item] : self.first[next_item + 1]]
        if not self.blocked_links:
            return cost
        extra: FloatArray = np.zeros((1, 1))
        for k, side in np.argwhere(start.any(axis=2) & end[:, ::-1].any(axis=2)).tolist():
            is_near = start[k, side, :, None] & end[k, 1 - side, None]
            extra = np.maximum(extra, self.blocked_links[k].cost * is_near)
        return np.asarray(cost + extra)


def _find_near(states: Sequence[States], blocked_links: BlockedLinks) -> _NearStates:
    first = compute_offsets(count_rows(states))
    shape = (len(blocked_links), 2, first[-1] if blocked_links else 0)
    near_enter, near_leave = np.zeros(shape, dtype=np.bool_), np.zeros(shape, dtype=np.bool_)
    if blocked_links:
        all_states = join_states(states)
        enter, leave = all_states.enter, all_states.leave
    for k, link in enumerate(blocked_links):
        for side, joints in enumerate((link.start, link.end)):
            near_enter[k, side] = np.abs(enter - joints).max(axis=1) < link.radius
            near_leave[k, side] = np.abs(leave - joints).max(axis=1) < link.radius
    return _NearStates(near_enter, near_leave, first, blocked_links)


def time_links(
    cost_model: CostModel, order: Sequence[int], states: Sequence[States], posture_cost: float
) -> Iterator[FloatArray]:
    """Yield the times (M, K) from each state of an item to each state of the next, s.

    posture_cost: cost of another posture, s. Collisions have no cost here.
    """
    of_order = take_rows(states, order)
    count = count_rows(of_order)
    largest = int(count.max())
    if len(order) > 2 and largest * largest * len(order) > _MAX_LINKS_AT_ONCE:
        for pair in pairwise(order):
            yield from time_links(cost_model, pair, states, posture_cost)
        return
    rows = np.minimum(np.arange(largest), count[:, None] - 1) + compute_offsets(count)[:-1, None]
    joined = join_states(of_order)
    tips = [compute_gate_positions(cost_model.items[k], states[k].gate) for k in order]
    enter, leave, branch = joined.enter[rows], joined.leave[rows], joined.branch[rows]
    all_tips = np.concatenate(tips)
    tip_enter, tip_leave = all_tips[:, 0][rows], all_tips[:, 1][rows]
    distance = np.sqrt(((tip_enter[1:, None] - tip_leave[:-1, :, None]) ** 2).sum(axis=-1))
    seconds = cost_model.limits.between(leave[:-1], enter[1:], distance)
    seconds += posture_cost * (branch[:-1, :, None] != branch[1:, None])
    for k, table in enumerate(seconds):
        yield table[: count[k], : count[k + 1]]


def choose_fastest_states(
    cost_model: CostModel,
    order: Sequence[int],
    states: Sequence[States],
    blocked_links: BlockedLinks,
) -> tuple[float, IntArray]:
    """Choose the states with the least time from home, along `order` and back.

    Returns that time, s, and the index of the state of each item.
    """
    near = _find_near(states, blocked_links)
    cost = time_links_home(cost_model, states[order[0]].enter, blocked_links)
    sources: list[IntArray] = []
    tables = time_links(cost_model, order, states, cost_model.posture_cost)
    for (item, next_item), table in zip(pairwise(order), tables, strict=True):
        total = cost[:, None] + near.add_costs(table, item, next_item)
        best = total.argmin(axis=0)
        sources.append(best)
        cost = total[best, np.arange(total.shape[1])]
    cost = cost + time_links_home(cost_model, states[order[-1]].leave, blocked_links)
    chosen = np.zeros(len(states), dtype=np.int64)
    row = int(cost.argmin())
    for place in range(len(order) - 1, -1, -1):
        chosen[order[place]] = row
        if place:
            row = int(sources[place - 1][row])
    return float(cost.min()), chosen
