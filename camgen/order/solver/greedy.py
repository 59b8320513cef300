"""A tour of items joined at their nearest ends, the closest pairs first.

It is about a sixth longer than the best tour, and is found fast. This is the greedy matching of
J. Bentley ("Fast algorithms for geometric traveling salesman problems", 1992): a link is taken if
both of its ends are still free and it closes no ring. Items that must come before others are in
groups of their own.
"""

from __future__ import annotations

import numpy as np

from camgen.geometry.nearest import Discs, IntArray, find_nearest_items
from camgen.geometry.ragged import (
    compute_first_rows,
    find_first_occurrences,
    find_root,
    list_owners,
    measure_runs,
    number_rows,
    select_distinct,
)
from camgen.geometry.vectors import measure_plane_lengths
from camgen.model.pose import FloatArray
from camgen.order.solver.kernel import CLOSED, ONE_WAY
from camgen.order.solver.plane import Items, Start, split_ends, sum_ends

#: Near ends among which the next link is searched.
_NEAR_ENDS = 5
#: Rounds in which every closed item starts at its best sample.
_ROUNDS = 3


def join_greedily(items: Items, discs: Discs, home: FloatArray | None) -> Start | None:
    """A tour that keeps parents and ranks; None if an item may run one way only.

    discs: result of `make_discs`.
    home: x, y where it begins and ends; None for nowhere.
    """
    if (items.kind == ONE_WAY).any() or not len(items.kind):
        return None
    order: list[IntArray] = []
    enter = items.first[:-1].copy()
    position = home
    group = make_groups(items)
    for number in select_distinct(group):
        joined, entered = _join_group(items, discs, np.flatnonzero(group == number))
        # The group is reversed if its other end is nearer to the group before.
        left = np.where(items.kind[joined] == CLOSED, entered, sum_ends(items)[joined] - entered)
        if position is not None:
            first, last = items.points[entered[0]] - position, items.points[left[-1]] - position
            if float((last**2).sum()) < float((first**2).sum()):
                joined, entered, left = joined[::-1], left[::-1], entered[::-1]
        order.append(joined)
        enter[joined] = entered
        position = items.points[left[-1]]
    return choose_all_samples(items, Start(np.concatenate(order), enter), home, _ROUNDS)


def choose_all_samples(items: Items, tour: Start, home: FloatArray | None, rounds: int) -> Start:
    """Start every other closed item in turn at its best sample between its neighbours."""
    order, count = tour.order, len(tour.order)
    enter = tour.enter.copy()
    closed = items.kind == CLOSED
    loop = closed & (np.diff(items.first) > 1)
    for parity in (0, 1) * rounds:
        places = np.arange(parity, count, 2)
        places = places[loop[order[places]]]
        if not len(places):
            continue
        places = places[np.argsort(order[places])]  # neighbours in the tables come together
        leave = np.where(closed, enter, sum_ends(items) - enter)
        before = items.points[leave[order[places - 1]]]
        after = items.points[enter[order[(places + 1) % count]]]
        for place, side, other in ((0, before, after), (count - 1, after, before)):
            side[places == place] = other[places == place] if home is None else home
        enter[order[places]] = _find_best_samples(items, order[places], before, after)
    return Start(order, enter)


def _find_best_samples(
    items: Items, chosen: IntArray, before: FloatArray, after: FloatArray
) -> IntArray:
    """The sample of each chosen item with the shortest links, the first of equal ones."""
    count = np.diff(items.first)[chosen]
    owner, step = list_owners(count), number_rows(count)
    number = items.first[chosen][owner] + step
    points = items.points[number]
    cost = measure_plane_lengths(points - before[owner]) + measure_plane_lengths(
        points - after[owner]
    )
    best = np.flatnonzero(cost == np.minimum.reduceat(cost, compute_first_rows(count))[owner])
    return number[best[compute_first_rows(measure_runs(owner[best]))]]


def make_groups(items: Items) -> IntArray:
    """The group of each item, by rank and then by the depth of items inside.

    Each group comes after those of a lower number.
    """
    depth = np.zeros(len(items.kind), dtype=np.int64)
    inside = np.flatnonzero(items.parent >= 0)
    while len(inside):
        raised = depth.copy()
        np.maximum.at(raised, items.parent[inside], depth[inside] + 1)
        if (raised == depth).all():
            break
        depth = raised
    return items.rank * (int(depth.max()) + 1) + depth


def _join_group(items: Items, discs: Discs, group: IntArray) -> tuple[IntArray, IntArray]:
    """The items of the group in the order of one greedy path, and the point where each begins."""
    if len(group) == 1:
        return group, items.first[group]
    nodes, first = split_ends(items, discs)
    closed = (items.kind == CLOSED)[group]
    # Nodes of the group, numbered from 0: both ends of an open item, one for a closed item.
    width = np.where(closed, 1, 2)
    start = compute_first_rows(width)
    number = np.full(int(nodes.owner.max()) + 1, -1)
    node = np.repeat(first[group], width) + number_rows(width)
    number[node] = np.arange(len(node))
    kept = number[nodes.owner] >= 0
    group_discs = Discs(number[nodes.owner[kept]], nodes.centre[kept], nodes.radius[kept])
    item = np.repeat(np.arange(len(group)), width)
    links = _link_nodes(group_discs, item, np.where(closed, 2, 1)[item])
    return _follow_links(items, group, item, start, links)


def _link_nodes(discs: Discs, item: IntArray, allowed: IntArray) -> list[list[int]]:
    """The nodes to which each node is linked. allowed: number of links that a node may have."""
    count = len(allowed)
    free, label, item_of = allowed.tolist(), list(range(int(item.max()) + 1)), item.tolist()
    links: list[list[int]] = [[] for _ in range(count)]
    parts = len(label)
    while parts > 1:
        open_nodes = np.flatnonzero(np.array(free) > 0)
        place = np.full(count, -1)
        place[open_nodes] = np.arange(len(open_nodes))
        kept = place[discs.owner] >= 0
        open_discs = Discs(place[discs.owner[kept]], discs.centre[kept], discs.radius[kept])
        near = find_nearest_items(open_discs, len(open_nodes), _NEAR_ENDS)
        first, second = open_nodes[near.item], open_nodes[near.other]
        # A pair may be listed from one side or from both; once is enough.
        rows = find_first_occurrences(np.minimum(first, second) * count + np.maximum(first, second))
        rows = rows[item[first[rows]] != item[second[rows]]]
        rows = rows[np.argsort(first[rows] * count + second[rows])]
        rows = rows[np.argsort(near.distance[rows], kind="stable")]
        before = parts
        for a, b in zip(first[rows].tolist(), second[rows].tolist(), strict=True):
            if free[a] and free[b]:
                k, m = find_root(label, item_of[a]), find_root(label, item_of[b])
                if k != m:
                    label[m] = k
                    free[a] -= 1
                    free[b] -= 1
                    links[a].append(b)
                    links[b].append(a)
                    parts -= 1
        if parts == before:
            break
    return links


def _follow_links(
    items: Items, group: IntArray, item: IntArray, start: IntArray, links: list[list[int]]
) -> tuple[IntArray, IntArray]:
    """The path that the links make, or several paths in a row if near ends ran out.

    Returns the items of the group in order, and the point at which each is entered.
    """
    item_of, begin, number = item.tolist(), start.tolist(), group.tolist()
    closed = (items.kind[group] == CLOSED).tolist()
    first, last = items.first[:-1][group].tolist(), (items.first[1:][group] - 1).tolist()
    done = [False] * len(number)
    order: list[int] = []
    enter: list[int] = []
    for head, first_node in enumerate(begin):
        other_end = [] if closed[head] else links[first_node + 1]
        if len(links[first_node]) + len(other_end) == 2:
            continue
        k, node = head, first_node
        if not closed[head] and links[node]:
            node += 1
        while not done[k]:
            done[k] = True
            order.append(number[k])
            enter.append(first[k] if node == begin[k] else last[k])
            out = node if closed[k] else 2 * begin[k] + 1 - node
            next_nodes = [other for other in links[out] if not done[item_of[other]]]
            if not next_nodes:
                break
            node = next_nodes[0]
            k = item_of[node]
    return np.array(order), np.array(enter)
