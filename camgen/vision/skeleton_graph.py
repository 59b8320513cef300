"""Centre lines as a graph: branches of pixels between ends, junctions and what they are attached to."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.vision.image import Pixels

IntArray = NDArray[np.int64]
Float32 = NDArray[np.float32]
ComplexArray = NDArray[np.complex128]

#: The eight neighbours as (v, u): the direct ones, then the diagonal ones, each with the two direct ones beside it.
_STEPS = ((-1, 0), (0, 1), (1, 0), (0, -1), (-1, 1), (1, 1), (1, -1), (-1, -1))
_BESIDE = {4: (0, 1), 5: (1, 2), 6: (2, 3), 7: (3, 0)}


class Branch(Struct, eq=False):
    """A line between two nodes. points: (N,) u + iv px, N >= 2, or 1 for a dot. start, end: its nodes."""

    points: ComplexArray
    start: int
    end: int

    @property
    def length(self) -> float:
        """Px."""
        return float(np.abs(np.diff(self.points)).sum())


class Graph(Struct, eq=False):
    """Branches between nodes 0..N-1. place: (N,) u + iv px. held: (N,) attached to what was kept. depth: (N,) px to
    the border. A closed line without a node of its own starts and ends at the same one.
    """

    branches: list[Branch]
    place: ComplexArray
    held: NDArray[np.bool_]
    depth: NDArray[np.float64]


def graph(lines: Pixels, kept: Pixels | None, depth: Float32) -> Graph:
    """The graph of ``lines`` ((H, W), as ``skeleton`` gives them) without the pixels of ``kept``.

    depth: (H, W) px from each pixel to the border of the mask that was thinned.
    """
    own = lines if kept is None else cv2.subtract(lines, kept)
    v, u = np.nonzero(own)
    width = own.shape[1]
    flat = v * width + u
    beside = _neighbours(flat, width)
    place = u + 1j * v
    anchor = np.full(len(flat), -1)
    places, held = [place], [np.zeros(len(flat), dtype=bool)]
    if kept is not None and len(flat):
        row, at = _anchors(u, v, kept)
        anchor[row] = len(flat) + np.arange(len(row))
        places.append(at)
        held.append(np.ones(len(row), dtype=bool))
    place = np.concatenate(places)
    far = depth[place.imag.astype(np.int64), place.real.astype(np.int64)].astype(np.float64)
    return Graph(_walk(beside, anchor.tolist(), place), place, np.concatenate(held), far)


def _neighbours(flat: IntArray, width: int) -> list[list[int]]:
    """By pixel the pixels that it is joined with: a diagonal one only where no direct one leads there."""
    if not len(flat):
        return []
    found = np.full((len(flat), 8), -1)
    for k, (down, right) in enumerate(_STEPS):
        wanted = flat + down * width + right
        at = np.minimum(np.searchsorted(flat, wanted), len(flat) - 1)
        found[:, k] = np.where(flat[at] == wanted, at, -1)
    for k, (a, b) in _BESIDE.items():
        found[(found[:, a] >= 0) | (found[:, b] >= 0), k] = -1
    # The valid ones of each row, in order.
    row, column = np.nonzero(found >= 0)
    return [part.tolist() for part in np.split(found[row, column], np.searchsorted(row, np.arange(1, len(flat))))]


def _anchors(u: IntArray, v: IntArray, kept: Pixels) -> tuple[IntArray, ComplexArray]:
    """The pixels that touch what was kept, and where: at a direct neighbour rather than a diagonal one."""
    height, width = kept.shape
    touched = np.full(len(u), -1)
    for k in reversed(range(8)):
        down, right = _STEPS[k]
        y, x = v + down, u + right
        inside = (y >= 0) & (x >= 0) & (y < height) & (x < width)
        hit = inside & (kept[y.clip(0, height - 1), x.clip(0, width - 1)] != 0)
        touched[hit] = k
    row = np.flatnonzero(touched >= 0)
    step = np.array([right + 1j * down for down, right in _STEPS])
    return row, (u + 1j * v)[row] + step[touched[row]]


class _Net(Struct, frozen=True):
    """By pixel where one can go on to, and whether it is a node; done: pixels between nodes that a branch has."""

    ways: list[list[int]]
    node: list[bool]
    done: bytearray

    def run(self, before: int, here: int) -> list[int]:
        """From ``before`` over ``here`` to the next node, to what was kept, or round to ``before`` again."""
        chain = [before, here]
        while here < len(self.node) and not self.node[here] and here != chain[0]:
            self.done[here] = 1
            a, b = self.ways[here]
            before, here = here, b if a == before else a
            chain.append(here)
        return chain


def _walk(beside: list[list[int]], anchor: list[int], place: ComplexArray) -> list[Branch]:
    """All branches: from every node along every way that leaves it, then the lines that have no node."""
    ways = [[*own, a] if a >= 0 else own for own, a in zip(beside, anchor, strict=True)]
    net = _Net(ways, [len(own) != 2 for own in ways], bytearray(len(ways)))
    chains = [chain for k, node in enumerate(net.node) if node for chain in _from_node(net, k)]
    # From what was kept to what was kept, and after those, closed ones.
    attached = [k for k in range(len(ways)) if anchor[k] >= 0]
    for k in (*attached, *range(len(ways))):
        if not net.node[k] and not net.done[k]:
            chains.append(net.run(anchor[k], k) if anchor[k] >= 0 else net.run(k, ways[k][0]))
            net.done[k] = 1
    return [Branch(place[chain], chain[0], chain[-1]) for chain in chains]


def _from_node(net: _Net, start: int) -> Iterator[list[int]]:
    """The branches of a node that no other node has."""
    if not net.ways[start]:
        yield [start]
    for way in net.ways[start]:
        # A branch is met from both ends; one of two pixels is known by their order, others by those between.
        known = way < len(net.node) and (way < start if net.node[way] else net.done[way])
        if not known:
            yield net.run(start, way)
