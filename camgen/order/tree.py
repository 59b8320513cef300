"""The starts of paths in a tree of boxes: finds the nearest one while paths are removed and added.

A closed path may begin anywhere on its segments, an open one at its start and, if it is reversible,
at its end. The boxes are packed once along a Hilbert curve. A path that has been run leaves its
boxes, and an empty box leaves its parent, so that the search for the few paths that remain far away
stays short.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from camgen.geometry.arcs import Spans
from camgen.geometry.ragged import compute_offsets, list_owners, number_rows
from camgen.model.part import IntArray
from camgen.model.pose import FloatArray
from camgen.model.sequences import take_rows
from camgen.model.tolerance import NONZERO, SAME_POINT_MM
from camgen.order.starts import Starts
from camgen.plan.starting import SEAM

#: key, start x y, vector to the end x y, 1 / length^2 (0 for a single point).
Line = tuple[int, float, float, float, float, float]
#: key, centre x y, radius, unit direction of the middle x y, cosine of half the sweep, start x y,
#: end x y, signed sweep.
Arc = tuple[int, float, float, float, float, float, float, float, float, float, float, float]
#: Lower corner x y, upper corner x y, node.
Entry = tuple[float, float, float, float, int]

#: Pieces in a leaf and boxes in a box. 4 to 12 are equally fast.
_FAN = 6
_GRID = 65535


class StartTree:
    """The starts of the paths that may be run next.

    If several starts are equally near, the lowest number is found. But a start that is touched
    (within 1e-6 mm) is taken at once: where thousands of paths share a point, testing all of them
    each time would be quadratic.
    """

    def __init__(self, where: Starts) -> None:
        number, low, high = _divide_segments(where.shape)
        order = np.argsort(_order_along_curve((low + high) / 2), kind="stable")
        self.items = _make_items(where.shape)
        self.leaves = -(-len(number) // _FAN)
        counts = np.bincount(number, minlength=len(self.items))
        self.leaf_of: list[int] = (np.argsort(order) // _FAN).tolist()
        self.piece_of: list[int] = compute_offsets(counts).tolist()
        self.start_of: list[int] = where.first.tolist()
        sorted_items = take_rows(self.items, number[order].tolist())
        self.pots = [sorted_items[i : i + _FAN] for i in range(0, len(sorted_items), _FAN)]
        self.entries, self.parents, self.kids = _build_levels(low[order], high[order])

    def remove(self, path: int) -> None:
        """Removes the starts of `path` from the search."""
        for start in range(self.start_of[path], self.start_of[path + 1]):
            for leaf in self.leaf_of[self.piece_of[start] : self.piece_of[start + 1]]:
                self.pots[leaf].remove(self.items[start])
                if not self.pots[leaf]:
                    self._close(leaf)

    def add(self, path: int) -> None:
        """Adds the starts of `path`, removed before, to the search again."""
        for start in range(self.start_of[path], self.start_of[path + 1]):
            for leaf in self.leaf_of[self.piece_of[start] : self.piece_of[start + 1]]:
                if not self.pots[leaf]:
                    self._open(leaf)
                self.pots[leaf].append(self.items[start])

    def nearest(self, x: float, y: float, near: int = 0) -> int:
        """The index of the start nearest to x, y in mm; -1 if no path is left.

        near: a start that was near before.
        """
        leaf = self._neighbour(self.leaf_of[self.piece_of[near]], x, y)
        if leaf < 0:
            return -1
        best, choice = _scan(self.pots[leaf], x, y, math.inf, -1)
        if best < SAME_POINT_MM**2:
            return choice
        reach = math.sqrt(best)
        left, right, bottom, top = x - reach, x + reach, y - reach, y + reach
        pots, kids, leaves = self.pots, self.kids, self.leaves
        stack = [len(self.entries) - 1]
        while stack:
            node = stack.pop()
            if node >= leaves:
                for x0, y0, x1, y1, child in kids[node - leaves]:
                    if x0 <= right and x1 >= left and y0 <= top and y1 >= bottom:
                        stack.append(child)
            elif node != leaf:
                least, choice = _scan(pots[node], x, y, best, choice)
                if least < SAME_POINT_MM**2:
                    return choice
                if least < best:
                    best, reach = least, math.sqrt(least)
                    left, right, bottom, top = x - reach, x + reach, y - reach, y + reach
        return choice

    def _neighbour(self, node: int, x: float, y: float) -> int:
        """A leaf near the leaf `node` that is not empty, to begin the search; -1 if all are."""
        while node >= 0 and not (
            self.pots[node] if node < self.leaves else self.kids[node - self.leaves]
        ):
            node = self.parents[node]
        while node >= self.leaves:
            least = math.inf
            for x0, y0, x1, y1, child in self.kids[node - self.leaves]:
                distance = max(x0 - x, x - x1, 0.0) + max(y0 - y, y - y1, 0.0)
                if distance < least:
                    least, node = distance, child
        return node

    def project(self, start: int, x: float, y: float) -> tuple[float, float, float]:
        """The point of a start nearest to x, y: its fraction 0..1 of the segment, and its x, y.

        It is the end of the segment if that is nearer to it than `SEAM`.
        """
        item = self.items[start]
        if len(item) == 6:
            _, px, py, dx, dy, inverse = item
            fraction = min(max(((x - px) * dx + (y - py) * dy) * inverse, 0.0), 1.0)
            fraction = _snap_to_ends(fraction, math.hypot(dx, dy))
            return fraction, px + fraction * dx, py + fraction * dy
        _, cx, cy, radius, mx, my, _, ax, ay, end_x, end_y, sweep = item
        vx, vy = x - cx, y - cy
        fraction = 0.5 + math.atan2(mx * vy - my * vx, mx * vx + my * vy) / sweep
        if not 0 <= fraction <= 1:
            fraction = float(math.hypot(x - ax, y - ay) > math.hypot(x - end_x, y - end_y))
        fraction = _snap_to_ends(fraction, radius * abs(sweep))
        if fraction in (0.0, 1.0):
            return (1.0, end_x, end_y) if fraction else (0.0, ax, ay)
        scale = radius / math.hypot(vx, vy) if vx or vy else 0.0
        return (
            (fraction, cx + scale * vx, cy + scale * vy)
            if scale
            else (fraction, cx + radius * mx, cy + radius * my)
        )

    def _close(self, node: int) -> None:
        parent = self.parents[node]
        if parent >= 0:
            self.kids[parent - self.leaves].remove(self.entries[node])
            if not self.kids[parent - self.leaves]:
                self._close(parent)

    def _open(self, node: int) -> None:
        parent = self.parents[node]
        if parent >= 0:
            if not self.kids[parent - self.leaves]:
                self._open(parent)
            self.kids[parent - self.leaves].append(self.entries[node])


def _snap_to_ends(fraction: float, length: float) -> float:
    """The fraction; 0 or 1 if it would cut a piece shorter than SEAM off a segment, mm."""
    return fraction if min(fraction, 1 - fraction) * length >= SEAM else float(round(fraction))


def _scan(pot: list[Line | Arc], x: float, y: float, best: float, choice: int) -> tuple[float, int]:
    """The least squared distance from x, y to a start of `pot` and its index, if below `best`."""
    # Written out, without a function per shape: this loop is most of the time of a tour.
    for item in pot:
        if len(item) == 6:
            _, px, py, dx, dy, inverse = item
            vx, vy = x - px, y - py
            part = (vx * dx + vy * dy) * inverse
            if part > 0:
                part = min(part, 1.0)
                vx -= part * dx
                vy -= part * dy
            distance = vx * vx + vy * vy
        else:
            _, cx, cy, radius, mx, my, cosine, ax, ay, end_x, end_y, _ = item
            vx, vy = x - cx, y - cy
            arm = math.sqrt(vx * vx + vy * vy)
            if vx * mx + vy * my >= arm * cosine:
                distance = (arm - radius) ** 2
            else:
                distance = min((x - ax) ** 2 + (y - ay) ** 2, (x - end_x) ** 2 + (y - end_y) ** 2)
        if distance < best or (distance == best and item[0] < choice):
            best, choice = distance, item[0]
    return best, choice


def _make_items(shape: Spans) -> list[Line | Arc]:
    """The segments as tuples of plain numbers: faster than arrays for one at a time."""
    reach = shape.end - shape.start
    square = reach[:, 0] ** 2 + reach[:, 1] ** 2
    inverse = np.divide(1.0, square, out=np.zeros_like(square), where=square > 0)
    keys = np.arange(len(square))
    columns = (keys, shape.start[:, 0], shape.start[:, 1], reach[:, 0], reach[:, 1], inverse)
    items: list[Line | Arc] = list(zip(*map(np.ndarray.tolist, columns), strict=True))
    c = shape.curved
    towards, along = shape.towards[c], shape.along[c]
    centre = shape.via[c] - shape.radius[c, None] * towards
    sign = np.sign(towards[:, 0] * along[:, 1] - towards[:, 1] * along[:, 0])
    xy = (*centre.T[:2], shape.radius[c], *towards.T[:2], np.cos(shape.sweep[c] / 2))
    ends = (
        *shape.start[c].T[:2],
        *shape.end[c].T[:2],
        np.where(sign == 0, 1.0, sign) * shape.sweep[c],
    )
    arcs: Iterator[Arc] = zip(*map(np.ndarray.tolist, (keys[c], *xy, *ends)), strict=True)
    for arc in arcs:
        items[arc[0]] = arc
    return items


def _divide_segments(shape: Spans) -> tuple[IntArray, FloatArray, FloatArray]:
    """Divide segments so that boxes fit: the segment of each piece, and its box (P, 2) to (P, 2),
    mm.

    A piece is no longer than the mean segment, so that there are at most twice as many. No arc is
    more than a quarter of a circle.
    """
    count = np.maximum(1, np.ceil(shape.sweep / (math.pi / 2) - 1e-9))
    if shape.length.any():
        mean = float(shape.length[shape.length > 0].mean())
        count = np.maximum(count, np.ceil(shape.length / mean - 1e-9))
    number, step = list_owners(count.astype(np.int64)), number_rows(count.astype(np.int64))
    segment, count = shape.pick(number), count[number]
    a, b = segment.point(step / count)[:, :2], segment.point((step + 1) / count)[:, :2]
    # An arc leaves its chord by no more than its sagitta.
    swell = (2 * segment.radius * np.sin(segment.sweep / count / 4) ** 2)[:, None]
    return number, np.minimum(a, b) - swell, np.maximum(a, b) + swell


def _order_along_curve(points: FloatArray) -> IntArray:
    """The place of each point (P, 2) along a Hilbert curve, on which neighbours are near."""
    low = points.min(axis=0)
    side = max(float((points.max(axis=0) - low).max()), NONZERO)
    x, y = ((points - low) / side * _GRID).astype(np.int64).T
    place = np.zeros(len(points), dtype=np.int64)
    for bit in reversed(range(_GRID.bit_length())):
        right, upper = (x >> bit & 1).astype(bool), (y >> bit & 1).astype(bool)
        place = place << 2 | (3 * right ^ upper)
        flip = right & ~upper
        x, y = np.where(flip, _GRID - x, x), np.where(flip, _GRID - y, y)
        x, y = np.where(upper, x, y), np.where(upper, y, x)
    return place


def _build_levels(
    low: FloatArray, high: FloatArray
) -> tuple[list[Entry], list[int], list[list[Entry]]]:
    """Boxes over the sorted pieces, level by level.

    Returns entries and parents by node (leaves first, root last), and the kids of the inner nodes.
    """
    entries: list[Entry] = []
    parents: list[int] = []
    kids: list[list[Entry]] = []
    while True:
        cuts = np.arange(0, len(low), _FAN)
        low, high = np.minimum.reduceat(low, cuts), np.maximum.reduceat(high, cuts)
        done, count = len(entries), len(low)
        entries += zip(*low.T.tolist(), *high.T.tolist(), range(done, done + count), strict=True)
        if count == 1:
            return entries, [*parents, -1], kids
        parents += (done + count + np.arange(count) // _FAN).tolist()
        kids += [entries[i : min(i + _FAN, done + count)] for i in range(done, done + count, _FAN)]
