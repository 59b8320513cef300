"""A lower bound for all tours: a tree over all ends, with prices at its branches.

The method is that of Held and Karp (1970). Every tour, without its links from and to home, is a
tree that joins all items, with one link at each end of an open item and two at each closed item.
The cheapest tree is not longer than that. The same holds if every link at an end is charged a price
that is paid back once for each link that the end should have.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.nearest import IntArray, find_nearest_items
from camgen.geometry.ragged import (
    compute_first_rows,
    find_first_occurrences,
    list_owners,
    number_rows,
)
from camgen.model.pose import FloatArray
from camgen.order.solver.kernel import CLOSED
from camgen.order.solver.plane import Items, make_discs, split_ends

#: Near ends among which the tree is searched; all others count as no farther than the farthest one.
_NEAR_ENDS = 8
#: First step of the prices, as a fraction of the gap to the known tour. Measured: twice as much
#: overshoots, a third as much is slow.
_FIRST_STEP = 0.15
#: Factor on the step in each round.
_STEP_FACTOR = 0.95
#: Pairs of points that are measured at once: bounds the memory.
_MAX_PAIRS = 1_000_000


class _Graph(Struct, frozen=True, eq=False):
    """Ends of open items, and closed items, as V nodes.

    first, second: (E,) the nodes of pairs that are near.
    distance: (E,) minimum distance of each pair, mm.
    sure: (V,) distance of a node below which all pairs are listed, mm.
    home: (V,) minimum distance of a node from home, mm.
    links: (V,) number of links in a tour, 1 for an end and 2 for a closed item.
    forced: (F, 2) the two ends of each open item.
    """

    first: IntArray
    second: IntArray
    distance: FloatArray
    sure: FloatArray
    home: FloatArray
    links: IntArray
    forced: IntArray


class DensePoints(Struct, frozen=True, eq=False):
    """Points close to each other along N items.

    first: (N + 1,) first point of each item.
    points: (P, 2) x, y, mm.
    radius: (N,) distance of an item's positions from the nearest of its points, at most, mm.
    """

    first: IntArray
    points: FloatArray
    radius: FloatArray


def compute_lower_bound(
    items: Items,
    home: FloatArray | None,
    known: float,
    rounds: int,
    dense: DensePoints | None = None,
) -> float:
    """A length that no tour of the items is below, whatever its order, directions and starts, mm.

    home: x, y where every tour begins and ends; None for nowhere.
    known: length of some tour, mm, which sets the size of the steps.
    rounds: number of trees, 1 or more.
    dense: points with which near pairs are measured more exactly.
    """
    if not len(items.kind):
        return 0.0
    graph = _make_graph(items, home, dense)
    if len(graph.links) == 1:
        return max(float(2 * graph.home[0]), 0.0)
    price = np.zeros(len(graph.links))
    best, step, direction = 0.0, _FIRST_STEP, np.zeros(len(graph.links))
    for _ in range(rounds):
        length, links = _find_tree(graph, price)
        best = max(best, length)
        direction = 0.7 * (links - graph.links) + 0.3 * direction
        size = float((direction**2).sum())
        if size < 1e-12 or known <= best:
            break
        price += step * (1.02 * known - length) / size * direction
        step *= _STEP_FACTOR
    # Rounding of the sums must not lift the bound above the best tour.
    return max(0.0, best * (1 - 1e-12) - 1e-9)


def _make_graph(items: Items, home: FloatArray | None, dense: DensePoints | None) -> _Graph:
    nodes, first_node = split_ends(items, make_discs(items))
    count = int(nodes.owner.max()) + 1
    near = find_nearest_items(nodes, count, _NEAR_ENDS)
    closed = items.kind == CLOSED
    forced = np.stack([first_node[~closed], first_node[~closed] + 1], axis=1)
    partner = np.arange(count)
    partner[forced[:, 0]], partner[forced[:, 1]] = forced[:, 1], forced[:, 0]
    kept = (near.other != partner[near.item]) & (near.item != near.other)
    first, second = near.item[kept], near.other[kept]
    # A pair may be listed from one side or from both; once is enough, and half the work.
    once = find_first_occurrences(np.minimum(first, second) * count + np.maximum(first, second))
    first, second, listed = first[once], second[once], near.distance[kept][once]
    distance = np.minimum(listed, np.maximum(near.sure[first], near.sure[second]))
    if dense is not None:
        np.maximum(distance, _measure_distances(dense, closed, first, second), out=distance)
    home_distance = np.zeros(count)
    if home is not None:
        of_discs = np.sqrt(((nodes.centre - home) ** 2).sum(axis=1)) - nodes.radius
        home_distance[:] = np.inf
        np.minimum.at(home_distance, nodes.owner, np.maximum(of_discs, 0.0))
    links = np.full(count, 1)
    links[first_node[closed]] = 2
    return _Graph(first, second, distance, near.sure, home_distance, links, forced)


def _measure_distances(
    dense: DensePoints, closed: NDArray[np.bool_], first: IntArray, second: IntArray
) -> FloatArray:
    """(E,) minimum distance of the nodes of each pair, mm.

    It is that of their nearest points, minus the distance of other positions from these points.
    """
    item = np.repeat(np.arange(len(closed)), np.where(closed, 1, 2))
    last = np.concatenate([item[1:] != item[:-1], [True]])
    # The two ends of an open item are its first and its last point; a closed item has all of its
    # points.
    begin = np.where(closed[item] | ~last, dense.first[item], dense.first[item + 1] - 1)
    size = np.where(closed[item], dense.first[item + 1], begin + 1) - begin
    distance = np.empty(len(first))
    counts = size[first] * size[second]
    chunk = np.cumsum(counts) // _MAX_PAIRS
    for rows in np.split(np.arange(len(first)), np.flatnonzero(np.diff(chunk)) + 1):
        if not len(rows):
            continue
        a, b = first[rows], second[rows]
        pair, step = list_owners(counts[rows]), number_rows(counts[rows])
        columns = size[b][pair]
        start = dense.points[begin[a][pair] + step // columns]
        between = start - dense.points[begin[b][pair] + step % columns]
        squares = np.minimum.reduceat((between**2).sum(axis=1), compute_first_rows(counts[rows]))
        distance[rows] = np.sqrt(squares)
    radius = dense.radius[item]
    return np.maximum(distance - radius[first] - radius[second], 0.0)


def _find_tree(graph: _Graph, price: FloatArray) -> tuple[float, IntArray]:
    """The cheapest tree with two links home at these prices: its cost, and the links of each node.

    The prices that are paid back are subtracted from the cost.
    """
    count = len(price)
    half = graph.sure / 2 + price
    hub = int(np.argmin(half))
    others = np.delete(np.arange(count), hub)
    first = np.concatenate([graph.first, others])
    second = np.concatenate([graph.second, np.full(count - 1, hub)])
    # Two nodes that are not listed are farther apart than the listed distance of either, so half of
    # both is a lower bound. With these bounds the cheapest pairs make a star around the hub.
    listed = graph.distance + price[graph.first] + price[graph.second]
    cost = np.concatenate([listed, half[others] + half[hub]])
    taken = _find_spanning_edges(count, first, second, cost, graph.forced)
    home = graph.home + price
    ends = np.argpartition(home, 1)[:2]
    links = np.bincount(first[taken], minlength=count) + np.bincount(second[taken], minlength=count)
    links[ends] += 1
    total = float(cost[taken].sum() + home[ends].sum() - (graph.links * price).sum())
    return total, links


def _find_spanning_edges(
    count: int, first: IntArray, second: IntArray, cost: FloatArray, forced: IntArray
) -> NDArray[np.intp]:
    """Indices of the edges of the cheapest tree that holds the `forced` edges.

    Boruvka's method: all parts grow at once.
    """
    label = np.arange(count)
    label[forced[:, 1]] = forced[:, 0]
    order = np.argsort(cost, kind="stable")
    a, b = label[first[order]], label[second[order]]
    taken: list[NDArray[np.intp]] = [np.zeros(0, dtype=np.intp)]
    while True:
        between = np.flatnonzero(a != b)
        if not len(between):
            return np.concatenate(taken)
        order, a, b = order[between], a[between], b[between]
        # The edges are sorted: the first of each part is its cheapest, written last.
        cheapest = np.full(count, -1)
        back = np.arange(len(order))[::-1]
        cheapest[b[back]] = back
        other = np.full(count, len(order))
        other[a[back]] = back
        cheapest = np.where(cheapest < 0, other, np.minimum(cheapest, other))
        parts = np.flatnonzero(cheapest < len(order))
        edges = cheapest[parts]
        taken.append(order[np.unique(edges)])
        target = np.arange(count)
        target[parts] = np.where(a[edges] == parts, b[edges], a[edges])
        # If two parts chose each other, the lower one stays.
        is_mutual = target[target] == np.arange(count)
        target = np.where(is_mutual & (np.arange(count) < target), np.arange(count), target)
        while True:
            next_target = target[target]
            if (next_target == target).all():
                break
            target = next_target
        a, b = target[a], target[b]
