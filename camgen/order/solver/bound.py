"""What no tour can be shorter than: a tree over all ends, made dearer where it branches (Held and Karp, 1970).

Every tour, less its two ways from and to home, is a tree that joins all items, with as many links at each open end as
one and at each closed item as two. The cheapest tree is no longer than that, and it stays so when every link at an end
is charged a price that is paid back once per link the end should have.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.nearest import IntArray, find_nearest_items
from camgen.geometry.ragged import begins, first_of_each, owners, ramp
from camgen.model.pose import FloatArray
from camgen.order.solver.kernel import CLOSED
from camgen.order.solver.plane import Items, make_discs, split_ends

__all__ = ["DensePoints", "compute_lower_bound"]

#: Near ends among which the tree is looked for; all others count as no farther than the farthest of these.
_NEAR_ENDS = 8
#: The first step of the prices, as a part of the way to the known tour, and how fast the steps shrink. Measured: twice
#: as much overshoots, a third as much is slow.
_PULL, _SHRINK = 0.15, 0.95
#: Pairs of points that are measured in one go.
_PAIRS = 1_000_000


class _Graph(Struct, frozen=True, eq=False):
    """Ends of open items and closed items as nodes. one, two, apart: (E,) pairs that are near and what they are apart
    at least. sure: (V,) of a node, all pairs that are not listed are farther. home: (V,) how far home is. links: (V,) 1
    for an end, 2 for a closed item. forced: (F, 2) the two ends of open items.
    """

    one: IntArray
    two: IntArray
    apart: FloatArray
    sure: FloatArray
    home: FloatArray
    links: IntArray
    forced: IntArray


class DensePoints(Struct, frozen=True, eq=False):
    """Points close along the items: first (N + 1,) of each item's, points (P, 2) mm, radius (N,) mm: no place of an
    item is farther than that from one of its points.
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
    """A length, mm, that no tour of ``items`` is below, whatever the order, the directions and the starts.

    home: x, y where every tour begins and ends, None: nowhere. known: the length of some tour, mm, which sets the size
    of the steps. rounds: trees to look at, 1 or more. dense: with it near pairs are measured more closely.
    """
    if not len(items.kind):
        return 0.0
    graph = _graph(items, home, dense)
    if len(graph.links) == 1:
        return max(float(2 * graph.home[0]), 0.0)
    price = np.zeros(len(graph.links))
    best, pull, before = 0.0, _PULL, np.zeros(len(graph.links))
    for _ in range(rounds):
        length, links = _tree(graph, price)
        best = max(best, length)
        over = 0.7 * (links - graph.links) + 0.3 * before
        before = over
        size = float((over**2).sum())
        if size < 1e-12 or known <= best:
            break
        price += pull * (1.02 * known - length) / size * over
        pull *= _SHRINK
    # Rounding of the sums must not lift the bound above the best tour.
    return max(0.0, best * (1 - 1e-12) - 1e-9)


def _graph(items: Items, home: FloatArray | None, dense: DensePoints | None) -> _Graph:
    nodes, first = split_ends(items, make_discs(items))
    count = int(nodes.owner.max()) + 1
    near = find_nearest_items(nodes, count, _NEAR_ENDS)
    closed = items.kind == CLOSED
    forced = np.stack([first[~closed], first[~closed] + 1], axis=1)
    partner = np.arange(count)
    partner[forced[:, 0]], partner[forced[:, 1]] = forced[:, 1], forced[:, 0]
    once = (near.other != partner[near.item]) & (near.item != near.other)
    one, two = near.item[once], near.other[once]
    # A pair may be listed from one side or from both; once is enough, and half the work.
    first_seen = first_of_each(np.minimum(one, two) * count + np.maximum(one, two))
    one, two, listed = one[first_seen], two[first_seen], near.apart[once][first_seen]
    apart = np.minimum(listed, np.maximum(near.sure[one], near.sure[two]))
    if dense is not None:
        np.maximum(apart, _measure(dense, closed, one, two), out=apart)
    far = np.zeros(count)
    if home is not None:
        gap = np.sqrt(((nodes.centre - home) ** 2).sum(axis=1)) - nodes.radius
        far[:] = np.inf
        np.minimum.at(far, nodes.owner, np.maximum(gap, 0.0))
    links = np.full(count, 1)
    links[first[closed]] = 2
    return _Graph(one, two, apart, near.sure, far, links, forced)


def _measure(
    dense: DensePoints, closed: NDArray[np.bool_], one: IntArray, two: IntArray
) -> FloatArray:
    """(E,) what the nodes of each pair are apart at least: their nearest points, less what lies between these."""
    item = np.repeat(np.arange(len(closed)), np.where(closed, 1, 2))
    last = np.concatenate([item[1:] != item[:-1], [True]])
    # The two ends of an open item are its first and its last point; a closed item has all of its own.
    begin = np.where(closed[item] | ~last, dense.first[item], dense.first[item + 1] - 1)
    end = np.where(closed[item], dense.first[item + 1], begin + 1)
    found = np.empty(len(one))
    counts = (end - begin)[one] * (end - begin)[two]
    chunk = np.cumsum(counts) // _PAIRS
    for part in np.split(np.arange(len(one)), np.flatnonzero(np.diff(chunk)) + 1):
        a, b = one[part], two[part]
        size = counts[part]
        pair, step = owners(size), ramp(size)
        wide = (end - begin)[b][pair]
        gap = (
            dense.points[begin[a][pair] + step // wide] - dense.points[begin[b][pair] + step % wide]
        )
        found[part] = (
            np.sqrt(np.minimum.reduceat((gap**2).sum(axis=1), begins(size))) if len(part) else 0.0
        )
    radius = dense.radius[item]
    return np.maximum(found - radius[one] - radius[two], 0.0)


def _tree(graph: _Graph, price: FloatArray) -> tuple[float, IntArray]:
    """The cheapest tree and two ways home at these prices, less what is paid back; and the links of each node."""
    count = len(price)
    half = graph.sure / 2 + price
    hub = int(np.argmin(half))
    rest = np.delete(np.arange(count), hub)
    one = np.concatenate([graph.one, rest])
    two = np.concatenate([graph.two, np.full(count - 1, hub)])
    # Two nodes that are not listed are farther apart than either is sure: half of both is less still, and then the
    # cheapest of all these pairs make a star.
    cost = np.concatenate(
        [graph.apart + price[graph.one] + price[graph.two], half[rest] + half[hub]]
    )
    taken = _spanning(count, one, two, cost, graph.forced)
    ways = graph.home + price
    ends = np.argpartition(ways, 1)[:2]
    links = np.bincount(one[taken], minlength=count) + np.bincount(two[taken], minlength=count)
    links[ends] += 1
    total = float(cost[taken].sum() + ways[ends].sum() - (graph.links * price).sum())
    return total, links


def _spanning(
    count: int, one: IntArray, two: IntArray, cost: FloatArray, forced: IntArray
) -> NDArray[np.intp]:
    """Indices of the edges of the cheapest tree that holds the ``forced`` ones (Boruvka: all parts grow at once)."""
    label = np.arange(count)
    label[forced[:, 1]] = forced[:, 0]
    order = np.argsort(cost, kind="stable")
    a, b = label[one[order]], label[two[order]]
    taken: list[NDArray[np.intp]] = []
    while True:
        apart = np.flatnonzero(a != b)
        if not len(apart):
            return np.concatenate(taken) if taken else np.zeros(0, dtype=np.intp)
        order, a, b = order[apart], a[apart], b[apart]
        # The edges are sorted: the first of each part is its cheapest, written last.
        cheapest = np.full(count, -1)
        back = np.arange(len(order))[::-1]
        cheapest[b[back]] = back
        other = np.full(count, len(order))
        other[a[back]] = back
        cheapest = np.where(cheapest < 0, other, np.minimum(cheapest, other))
        parts = np.flatnonzero(cheapest < len(order))
        picked = np.unique(cheapest[parts])
        taken.append(order[picked])
        target = np.arange(count)
        target[parts] = np.where(
            a[cheapest[parts]] == parts, b[cheapest[parts]], a[cheapest[parts]]
        )
        # Of two parts that chose each other the lower one stays.
        mutual = target[target] == np.arange(count)
        target = np.where(mutual & (np.arange(count) < target), np.arange(count), target)
        while True:
            further = target[target]
            if (further == target).all():
                break
            target = further
        a, b = target[a], target[b]
