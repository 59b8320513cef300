"""Thins a mask to centre lines of one pixel, and turns these into long strokes.

The border of the mask is removed in parallel until only lines are left (Guo and Hall, "Parallel
thinning with two-subiteration algorithms", 1989). The eight neighbours of a pixel decide whether it
is removed. So they are read as one byte, and a table of 256 answers for each of the two
subiterations decides for all pixels. The lines are then a graph of branches between nodes. Short
spurs are removed, near junctions are merged, and branches that run straight on are joined.
"""

from __future__ import annotations

import itertools
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence

import cv2
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.ragged import find_root
from camgen.geometry.rings import ComplexArray
from camgen.model.part import BoolArray, IntArray
from camgen.model.sequences import take_rows
from camgen.vision.image import Pixels

#: The eight neighbours (rows down, columns right) from the one above, clockwise. Neighbour k has
#: bit k of the byte.
_NEIGHBOURS = ((-1, 0), (-1, 1), (0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1))
#: Weights of the neighbours in the byte, as a filter kernel.
_KERNEL = np.array([[128, 1, 2], [64, 0, 4], [32, 16, 8]], dtype=np.float32)
#: The whole picture is tested as long as an iteration removes more than one pixel of this many.
_PIXELS_PER_REMOVED = 2000


def thin_mask(mask: Pixels, keep: Pixels | None = None) -> Pixels:
    """Thin `mask` ((H, W) uint8, not 0 inside) to centre lines, connected as the mask is.

    Beyond the border of the picture counts as outside.

    keep: (H, W), not 0 at pixels that stay in any case; lines then end at them.

    Returns (H, W) uint8, 255 on a line.
    """
    lines = np.zeros(mask.shape, dtype=np.uint8)
    u, v, width, height = cv2.boundingRect(mask)
    if not width:
        return lines
    window = (slice(v, v + height), slice(u, u + width))
    pixels = np.pad((mask[window] != 0).astype(np.uint8), 1)
    removable = np.ones_like(pixels)
    if keep is not None:
        removable = np.pad((keep[window] == 0).astype(np.uint8), 1)
    pixels = _thin_changed(_thin_all(pixels, removable), removable)
    lines[window] = pixels[1:-1, 1:-1] * np.uint8(255)
    return lines


def _thin_all(pixels: Pixels, removable: Pixels) -> Pixels:
    """Iterations over the whole picture, as long as they remove many pixels.

    pixels, removable: (H, W), 0 or 1. Returns the remaining pixels.
    """
    limit = cv2.countNonZero(pixels) // _PIXELS_PER_REMOVED
    removed_count = limit + 1
    while removed_count > limit:
        removed_count = 0
        for table in _TABLES:
            code = cv2.filter2D(pixels, cv2.CV_8U, _KERNEL, borderType=cv2.BORDER_CONSTANT)
            removed = cv2.bitwise_and(cv2.bitwise_and(cv2.LUT(code, table), pixels), removable)
            removed_count += cv2.countNonZero(removed)
            pixels = np.asarray(cv2.subtract(pixels, removed), dtype=np.uint8)
    return pixels


def _thin_changed(pixels: Pixels, removable: Pixels) -> Pixels:
    """Iterations over those pixels alone whose neighbours have changed, until nothing changes.

    Each subiteration begins with all pixels. `pixels` (H, W) is changed in place and returned.
    """
    flat, flat_removable = pixels.ravel(), removable.ravel()
    steps = np.array(_NEIGHBOURS) @ (pixels.shape[1], 1)
    weights = 1 << np.arange(8)
    # Pixels that each of the two subiterations has to test.
    changed = [np.flatnonzero(flat & flat_removable)] * 2
    half = 0
    while len(changed[0]) or len(changed[1]):
        tested = changed[half]
        tested = tested[flat[tested] != 0]
        codes = flat[tested[:, None] + steps] @ weights
        removed = tested[_TABLES[half][codes] != 0]
        flat[removed] = 0
        near = np.unique(removed[:, None] + steps)
        near = near[(flat[near] & flat_removable[near]) != 0]
        changed[half] = near
        half = 1 - half
        changed[half] = np.union1d(changed[half], near)
    return pixels


def _make_table(half: int) -> Pixels:
    """Table (256,) of one subiteration: 1 if a pixel with these neighbours is removed."""
    around = (np.arange(256) >> np.arange(8)[:, None] & 1).astype(bool)
    n, ne, e, se, s, sw, w, nw = around
    direct, diagonal = around[::2], around[1::2]
    # With a single run of neighbours around the pixel, removing it separates nothing.
    runs = (~direct & (diagonal | np.roll(direct, -1, axis=0))).sum(axis=0)
    # Numbers of pairs of adjacent neighbours with a pixel. A line that ends here has only one.
    pairs_before = (np.roll(diagonal, 1, axis=0) | direct).sum(axis=0)
    pairs = np.minimum(pairs_before, (direct | diagonal).sum(axis=0))
    # Subiteration 0 removes from the south-west, subiteration 1 from the north-east.
    is_kept = (n | ne | ~se) & e if half else (s | sw | ~nw) & w
    is_removed = (runs == 1) & (pairs >= 2) & (pairs <= 3) & ~is_kept
    return np.asarray(is_removed.astype(np.uint8))


_TABLES = (_make_table(0), _make_table(1))


# Centre lines as a graph: branches of pixels between ends, junctions and kept pixels.

Float32 = NDArray[np.float32]

#: The eight neighbours (rows down, columns right): four direct ones, then four diagonal ones.
_STEPS = ((-1, 0), (0, 1), (1, 0), (0, -1), (-1, 1), (1, 1), (1, -1), (-1, -1))
#: The two direct neighbours on both sides of each diagonal one, as indices of `_STEPS`.
_DIRECT_OF_DIAGONAL = {4: (0, 1), 5: (1, 2), 6: (2, 3), 7: (3, 0)}


class Branch(Struct, eq=False):
    """A line between two nodes.

    points: (N,) u + iv, px, N >= 2, or 1 for a dot.
    start, end: indices of its nodes.
    """

    points: ComplexArray
    start: int
    end: int

    @property
    def length(self) -> float:
        """Length along the points, px."""
        return float(np.abs(np.diff(self.points)).sum())


class Graph(Struct, eq=False):
    """Centre lines as branches between N nodes.

    A closed line without a node of its own starts and ends at the same pixel.

    branches: the branches; `start` and `end` are indices of the following arrays.
    place: (N,) u + iv, px.
    held: (N,), the node is a kept pixel.
    depth: (N,), distance to the border of the mask, px.
    """

    branches: list[Branch]
    place: ComplexArray
    held: BoolArray
    depth: NDArray[np.float64]


def make_graph(lines: Pixels, kept: Pixels | None, depth: Float32) -> Graph:
    """Make the graph of centre lines ((H, W), as returned by `thin_mask`).

    kept: (H, W), not 0 at kept pixels, which do not belong to the lines; None for none.
    depth: (H, W), distance of each pixel to the border of the mask that was thinned, px.
    """
    line_pixels = lines if kept is None else cv2.subtract(lines, kept)
    v, u = np.nonzero(line_pixels)
    width = line_pixels.shape[1]
    flat = v * width + u
    neighbours = _find_neighbours(flat, width)
    place = u + 1j * v
    # For each pixel of a line the node of the kept pixel that it touches, -1 for none.
    anchor = np.full(len(flat), -1)
    if kept is not None and len(flat):
        rows, anchor_places = _find_anchors(u, v, kept)
        anchor[rows] = len(flat) + np.arange(len(rows))
        place = np.concatenate([place, anchor_places])
    node_depth = depth[place.imag.astype(np.int64), place.real.astype(np.int64)].astype(np.float64)
    branches = _find_branches(neighbours, anchor.tolist(), place)
    return Graph(branches, place, np.arange(len(place)) >= len(flat), node_depth)


def _find_neighbours(flat: IntArray, width: int) -> list[list[int]]:
    """Indices of the pixels that each pixel is joined with.

    A diagonal neighbour counts only if no direct neighbour leads to it.

    flat: (N,) row * width + column of each pixel, sorted.
    """
    if not len(flat):
        return []
    neighbours = np.full((len(flat), 8), -1)
    for k, (down, right) in enumerate(_STEPS):
        wanted = flat + down * width + right
        index = np.minimum(np.searchsorted(flat, wanted), len(flat) - 1)
        neighbours[:, k] = np.where(flat[index] == wanted, index, -1)
    for k, (a, b) in _DIRECT_OF_DIAGONAL.items():
        neighbours[(neighbours[:, a] >= 0) | (neighbours[:, b] >= 0), k] = -1
    row, column = np.nonzero(neighbours >= 0)
    ends = np.searchsorted(row, np.arange(1, len(flat)))
    return [part.tolist() for part in np.split(neighbours[row, column], ends)]


def _find_anchors(u: IntArray, v: IntArray, kept: Pixels) -> tuple[IntArray, ComplexArray]:
    """Find the pixels (u, v) that touch a kept pixel.

    Returns their indices (K,) and the kept pixels (K,) u + iv: a direct neighbour if there is one,
    else a diagonal one.
    """
    height, width = kept.shape
    touched = np.full(len(u), -1)
    for k in reversed(range(8)):
        down, right = _STEPS[k]
        y, x = v + down, u + right
        inside = (y >= 0) & (x >= 0) & (y < height) & (x < width)
        is_kept = inside & (kept[y.clip(0, height - 1), x.clip(0, width - 1)] != 0)
        touched[is_kept] = k
    rows = np.flatnonzero(touched >= 0)
    steps = np.array(_STEPS) @ (1j, 1)
    return rows, (u + 1j * v)[rows] + steps[touched[rows]]


class _Net(Struct, frozen=True):
    """The pixels of centre lines while their branches are followed.

    neighbours: pixels and anchors that each pixel is joined with. Anchors have indices beyond
        those of the pixels.
    is_node: True for each pixel whose number of neighbours is not 2.
    done: 1 for each pixel through which a branch passes; nodes stay 0.
    """

    neighbours: list[list[int]]
    is_node: list[bool]
    done: bytearray

    def follow(self, start: int, first: int) -> list[int]:
        """Pixels from `start` over `first` to the next node or anchor, or back to `start`."""
        chain = [start, first]
        previous, current = start, first
        while current < len(self.is_node) and not self.is_node[current] and current != start:
            self.done[current] = 1
            a, b = self.neighbours[current]
            previous, current = current, b if a == previous else a
            chain.append(current)
        return chain


def _find_branches(
    neighbours: list[list[int]], anchor: list[int], place: ComplexArray
) -> list[Branch]:
    """All branches, first from nodes, then between anchors, then closed lines.

    neighbours: the anchors are added to it.
    """
    attached = [pixel for pixel, node in enumerate(anchor) if node >= 0]
    for pixel in attached:
        neighbours[pixel].append(anchor[pixel])
    is_node = [len(pixels) != 2 for pixels in neighbours]
    net = _Net(neighbours, is_node, bytearray(len(neighbours)))
    chains: list[list[int]] = []
    for pixel in itertools.compress(range(len(is_node)), is_node):
        chains += _follow_from_node(net, pixel)
    for pixel in (*attached, *range(len(anchor))):
        if not is_node[pixel] and not net.done[pixel]:
            if anchor[pixel] >= 0:
                chains.append(net.follow(anchor[pixel], pixel))
            else:
                chains.append(net.follow(pixel, neighbours[pixel][0]))
            net.done[pixel] = 1
    return [Branch(place[chain], chain[0], chain[-1]) for chain in chains]


def _follow_from_node(net: _Net, node: int) -> Iterator[list[int]]:
    """Yield the branches of a node that were not followed from their other end."""
    if not net.neighbours[node]:
        yield [node]
    for first in net.neighbours[node]:
        is_followed = False
        if first < len(net.is_node):
            # Two nodes side by side: the branch belongs to the node with the smaller index.
            is_followed = first < node if net.is_node[first] else bool(net.done[first])
        if not is_followed:
            yield net.follow(node, first)


# From the graph of centre lines to long strokes.

#: A branch with a free end is a spur if it is shorter than this many depths. The depth at its root,
#: px to the border, is half the width there. The two spurs of a square end are 1.41 depths long,
#: that of a corner of 60 deg 2.
_SPUR_DEPTHS = 2.0
#: Junctions nearer to each other than this many depths are merged.
_MERGE_DEPTHS = 1.0
#: A branch between merged junctions that is at most this many depths long runs around a speck.
_LOOP_DEPTHS = 2.0
#: Length of a branch, in depths, over which its direction at a junction is measured.
_DIRECTION_DEPTHS = 2.0
#: Smallest cosine of the angle by which a stroke bends at a junction: 60 deg.
_MIN_COSINE = 0.5


class Stroke(Struct, frozen=True, eq=False):
    """A line through junctions.

    points: (N,) u + iv, px, N = 1 for a dot.
    closed: the last point is followed by the first.
    start, end: the first and the last point are free ends, which may be moved along the line. An
        end in a junction or at a kept pixel is not free.
    """

    points: ComplexArray
    closed: bool
    start: bool
    end: bool


class _Junctions(Struct, frozen=True, eq=False):
    """Branches, and how their ends meet. End 2 k is the start of branch k, end 2 k + 1 its end.

    net: the graph.
    branches: the branches that are left of it.
    node: junction of each end, the node that represents the merged ones.
    meeting: ends at each junction.
    place: place of each junction, u + iv, px.
    """

    net: Graph
    branches: list[Branch]
    node: list[int]
    meeting: dict[int, list[int]]
    place: dict[int, complex]

    def points_from(self, end: int) -> ComplexArray:
        """The points of a branch, beginning at one of its ends."""
        points = self.branches[end // 2].points
        return points[::-1] if end % 2 else points

    def is_free(self, end: int) -> bool:
        """Whether no other end and no kept pixel is where this end is."""
        return len(self.meeting[self.node[end]]) == 1 and not self.net.held[self.node[end]]


def join_strokes(net: Graph) -> list[Stroke]:
    """Join the branches of a graph to strokes: first the dots, then the lines.

    Each branch is used once, except spurs and short branches within a merged junction.
    """
    branches = _remove_spurs(net, list(net.branches))
    dots = [Stroke(b.points, False, True, True) for b in branches if len(b.points) == 1]
    lines = [b for b in branches if len(b.points) > 1]
    place, junction_of = _merge_junctions(net, lines)
    kept: list[Branch] = []
    for branch in lines:
        is_apart = junction_of[branch.start] != junction_of[branch.end]
        if (
            is_apart
            or branch.start == branch.end
            or branch.length > _LOOP_DEPTHS * net.depth[branch.start]
        ):
            kept.append(branch)
    node = take_rows(junction_of, _list_ends(kept))
    meeting: dict[int, list[int]] = defaultdict(list)
    for end, junction in enumerate(node):
        meeting[junction].append(end)
    return dots + _join_branches(_Junctions(net, kept, node, dict(meeting), place))


def _list_ends(branches: list[Branch]) -> list[int]:
    """The nodes at the ends of branches: the start and the end of each in turn."""
    ends = [(branch.start, branch.end) for branch in branches]
    return list(itertools.chain.from_iterable(ends))


def _remove_spurs(net: Graph, branches: list[Branch]) -> list[Branch]:
    """The branches without spurs, at most twice. A node that loses all its branches is a dot."""
    for _ in range(2):
        count = Counter(_list_ends(branches))
        kept: list[Branch] = []
        roots: list[int] = []
        for branch in branches:
            free = [n for n in (branch.start, branch.end) if count[n] == 1 and not net.held[n]]
            root = branch.start if branch.end in free else branch.end
            if len(free) == 1 and branch.length < _SPUR_DEPTHS * net.depth[root]:
                roots.append(root)
            else:
                kept.append(branch)
        if not roots:
            break
        kept_count = Counter(_list_ends(kept))
        lonely = dict.fromkeys(n for n in roots if not kept_count[n] and not net.held[n])
        branches = kept + [Branch(net.place[[n]], n, n) for n in lonely]
    return branches


def _merge_junctions(
    net: Graph, branches: list[Branch]
) -> tuple[dict[int, complex], dict[int, int]]:
    """Merge junctions nearer to each other than half the width there.

    Returns the place of each junction, u + iv, by the node that represents it, and the node that
    represents each node of a branch.
    """
    count = Counter(_list_ends(branches))
    # A forest of nodes (union-find): a root represents all nodes of its tree.
    parents = list(range(len(net.place)))
    for branch in branches:
        start, end = branch.start, branch.end
        are_junctions = start != end and count[start] > 2 and count[end] > 2
        if not are_junctions or net.held[start] or net.held[end]:
            continue
        if branch.length <= _MERGE_DEPTHS * max(net.depth[start], net.depth[end]):
            parents[find_root(parents, end)] = find_root(parents, start)
    root_of = {n: find_root(parents, n) for n in count}
    members: dict[int, list[int]] = defaultdict(list)
    for n, root in root_of.items():
        members[root].append(n)
    return {root: complex(net.place[nodes].mean()) for root, nodes in members.items()}, root_of


def _join_branches(junctions: _Junctions) -> list[Stroke]:
    count = len(junctions.node)
    # For each end the end of the branch that continues its own one, -1 for none.
    partner = [-1] * count
    for junction, ends in junctions.meeting.items():
        if len(ends) > 1 and not junctions.net.held[junction]:
            for a, b in _pair_ends(junctions, ends):
                partner[a], partner[b] = b, a
    done = [False] * len(junctions.branches)
    # First the strokes with an end without a partner. The remaining ones are closed.
    strokes: list[Stroke] = []
    for start in sorted(range(count), key=lambda end: partner[end] >= 0):
        if not done[start // 2]:
            strokes.append(_follow_stroke(junctions, partner, done, start))
    return strokes


def _pair_ends(junctions: _Junctions, ends: list[int]) -> list[tuple[int, int]]:
    """Pair the ends at a junction that continue each other, the straightest pair first.

    Two ends alone always do, others only within the bend of `_MIN_COSINE`.
    """
    if len(ends) == 2:
        return [(ends[0], ends[1])]
    out = np.array([_measure_direction(junctions, end) for end in ends])
    cosine = -(out[:, None] * out.conj()).real
    a, b = np.triu_indices(len(ends), 1)
    pairs: list[tuple[int, int]] = []
    free = set(range(len(ends)))
    for k in np.argsort(-cosine[a, b], kind="stable").tolist():
        i, j = int(a[k]), int(b[k])
        if i in free and j in free and cosine[i, j] > _MIN_COSINE:
            free -= {i, j}
            pairs.append((ends[i], ends[j]))
    return pairs


def _measure_direction(junctions: _Junctions, end: int) -> complex:
    """Unit vector out of the junction, measured outside of its own width."""
    points = junctions.points_from(end)
    branch = junctions.branches[end // 2]
    depth = junctions.net.depth[branch.end if end % 2 else branch.start]
    near = min(round(depth * (_MERGE_DEPTHS / 2)), len(points) - 1)
    far = min(round(depth * (_MERGE_DEPTHS / 2 + _DIRECTION_DEPTHS)), len(points) - 1)
    vector = points[far] - points[near if far > near else 0]
    return complex(vector / max(abs(vector), 1e-9))


def _follow_stroke(
    junctions: _Junctions, partner: Sequence[int], done: list[bool], start: int
) -> Stroke:
    """The stroke that begins at the end `start`, through all junctions with a partner.

    Its branches are marked in `done`.
    """
    parts: list[ComplexArray] = []
    end = start
    while True:
        done[end // 2] = True
        parts += [
            np.array([junctions.place[junctions.node[end]]]),
            junctions.points_from(end)[1:-1],
        ]
        last = end ^ 1
        end = partner[last]
        if end < 0 or done[end // 2]:
            break
    if end == start:
        return Stroke(np.concatenate(parts), True, False, False)
    parts.append(np.array([junctions.place[junctions.node[last]]]))
    return Stroke(np.concatenate(parts), False, junctions.is_free(start), junctions.is_free(last))
