"""A tour of items joined at their nearest ends, the closest pairs first; about a sixth above the best, and soon made.

The greedy matching of J. Bentley ("Fast algorithms for geometric traveling salesman problems", 1992): a link is taken
if both of its ends are still free and it closes no ring. Items that must come before others make groups of their own.
"""

from __future__ import annotations

import numpy as np

from camgen.geometry.nearest import Discs, IntArray, find_nearest_items
from camgen.geometry.ragged import begins, each_once, first_of_each, owners, ramp, run_lengths
from camgen.geometry.vectors import plane_lengths
from camgen.model.pose import FloatArray
from camgen.order.solver.kernel import CLOSED, ONE_WAY
from camgen.order.solver.plane import Items, Start, both_ends, ends_apart

__all__ = ["group_of", "join_greedily", "settle_all"]

#: Near ends among which the next link is looked for.
_NEAR_ENDS = 5
#: So often every closed item is begun anew, at its best sample.
_ROUNDS = 3


def join_greedily(items: Items, discs: Discs, home: FloatArray | None) -> Start | None:
    """A tour that keeps parents and ranks; None where items may run one way only, whose ends are not alike.

    discs: see ``discs_of``. home: x, y where it begins and ends, None: nowhere.
    """
    if (items.kind == ONE_WAY).any() or not len(items.kind):
        return None
    order: list[IntArray] = []
    enter = items.first[:-1].copy()
    here = home
    group = group_of(items)
    for number in each_once(group):
        own, entered = _join(items, discs, np.flatnonzero(group == number))
        # Run backwards where that begins nearer to what comes before.
        left = np.where(items.kind[own] == CLOSED, entered, both_ends(items)[own] - entered)
        if here is not None:
            one, other = items.points[entered[0]] - here, items.points[left[-1]] - here
            if float((other**2).sum()) < float((one**2).sum()):
                own, entered, left = own[::-1], left[::-1], entered[::-1]
        order.append(own)
        enter[own] = entered
        here = items.points[left[-1]]
    return settle_all(items, Start(np.concatenate(order), enter), home, _ROUNDS)


def settle_all(items: Items, tour: Start, home: FloatArray | None, rounds: int) -> Start:
    """The tour with every closed item begun at its best sample between its neighbours, every other one in turn, in each
    of some rounds.
    """
    order, count = tour.order, len(tour.order)
    enter = tour.enter.copy()
    closed = items.kind == CLOSED
    loop = closed & (np.diff(items.first) > 1)
    for _ in range(rounds):
        for odd in (0, 1):
            place = np.arange(odd, count, 2)
            place = place[loop[order[place]]]
            if not len(place):
                continue
            place = place[
                np.argsort(order[place])
            ]  # neighbours in the tables are looked at together
            leave = np.where(closed, enter, both_ends(items) - enter)
            before, after = (
                items.points[leave[order[place - 1]]],
                items.points[enter[order[(place + 1) % count]]],
            )
            for edge, side, other in ((0, before, after), (count - 1, after, before)):
                side[place == edge] = other[place == edge] if home is None else home
            enter[order[place]] = _best_samples(items, order[place], before, after)
    return Start(order, enter)


def _best_samples(items: Items, own: IntArray, before: FloatArray, after: FloatArray) -> IntArray:
    """The sample of each closed item with the shortest way from ``before`` to ``after``, the first of equal ones."""
    count = np.diff(items.first)[own]
    which, step = owners(count), ramp(count)
    number = items.first[own][which] + step
    one, two = items.points[number] - before[which], items.points[number] - after[which]
    cost = plane_lengths(one) + plane_lengths(two)
    least = np.minimum.reduceat(cost, begins(count))
    hits = np.flatnonzero(cost == least[which])
    return number[hits[begins(run_lengths(which[hits]))]]


def group_of(items: Items) -> IntArray:
    """By item, its group; each group comes after those before: by rank, then by how deep others lie inside."""
    depth = np.zeros(len(items.kind), dtype=np.int64)
    inside = np.flatnonzero(items.parent >= 0)
    while len(inside):
        raised = depth.copy()
        np.maximum.at(raised, items.parent[inside], depth[inside] + 1)
        if (raised == depth).all():
            break
        depth = raised
    return items.rank * (int(depth.max()) + 1) + depth


def _join(items: Items, discs: Discs, group: IntArray) -> tuple[IntArray, IntArray]:
    """The items of the group in the order of one greedy path, and the point where each is entered."""
    if len(group) == 1:
        return group, items.first[group]
    nodes, first = ends_apart(items, discs)
    closed = items.kind == CLOSED
    # Nodes of the group, numbered from 0: both ends of an open item, one of a closed one.
    width = np.where(closed[group], 1, 2)
    start = begins(width)
    number = np.full(int(nodes.owner.max()) + 1, -1)
    node = np.repeat(first[group], width) + ramp(width)
    number[node] = np.arange(len(node))
    kept = number[nodes.owner] >= 0
    own = Discs(number[nodes.owner[kept]], nodes.centre[kept], nodes.radius[kept])
    item = np.repeat(np.arange(len(group)), width)
    links = _link(own, item, np.where(closed[group], 2, 1)[item])
    return _walk(items, group, item, start, links)


def _link(discs: Discs, item: IntArray, free: IntArray) -> list[list[int]]:
    """By node, the nodes it is joined to. free: by node, how many links it may have."""
    count = len(free)
    left, label, own = free.tolist(), list(range(int(item.max()) + 1)), item.tolist()
    links: list[list[int]] = [[] for _ in range(count)]
    parts = len(label)
    while parts > 1:
        open_ = np.flatnonzero(np.array(left) > 0)
        place = np.full(count, -1)
        place[open_] = np.arange(len(open_))
        there = place[discs.owner] >= 0
        some = Discs(place[discs.owner[there]], discs.centre[there], discs.radius[there])
        near = find_nearest_items(some, len(open_), _NEAR_ENDS)
        one, two = open_[near.item], open_[near.other]
        # A pair may be listed from one side or from both; once is enough.
        kept = first_of_each(np.minimum(one, two) * count + np.maximum(one, two))
        kept = kept[item[one[kept]] != item[two[kept]]]
        kept = kept[np.argsort(one[kept] * count + two[kept])]
        kept = kept[np.argsort(near.distance[kept], kind="stable")]
        before = parts
        for a, b in zip(one[kept].tolist(), two[kept].tolist(), strict=True):
            if left[a] and left[b]:
                k, m = _root(label, own[a]), _root(label, own[b])
                if k != m:
                    label[m] = k
                    left[a] -= 1
                    left[b] -= 1
                    links[a].append(b)
                    links[b].append(a)
                    parts -= 1
        if parts == before:
            break
    return links


def _root(label: list[int], item: int) -> int:
    while label[item] != item:
        label[item] = label[label[item]]
        item = label[item]
    return item


def _walk(
    items: Items, group: IntArray, item: IntArray, start: IntArray, links: list[list[int]]
) -> tuple[IntArray, IntArray]:
    """The path that the links make, or the paths one after the other where near ends gave out."""
    own, begin, number = item.tolist(), start.tolist(), group.tolist()
    closed = (items.kind[group] == CLOSED).tolist()
    first, last = items.first[:-1][group].tolist(), (items.first[1:][group] - 1).tolist()
    done = [False] * len(number)
    order: list[int] = []
    enter: list[int] = []
    degree = [
        len(links[begin[k]]) if closed[k] else len(links[begin[k]]) + len(links[begin[k] + 1])
        for k in range(len(number))
    ]
    for head in (k for k in range(len(number)) if degree[k] < 2):
        k, node = head, begin[head]
        if not closed[head] and links[node]:
            node += 1
        while not done[k]:
            done[k] = True
            order.append(number[k])
            enter.append(first[k] if node == begin[k] else last[k])
            out = node if closed[k] else 2 * begin[k] + 1 - node
            following = [other for other in links[out] if not done[own[other]]]
            if not following:
                break
            node = following[0]
            k = own[node]
    return np.array(order), np.array(enter)
