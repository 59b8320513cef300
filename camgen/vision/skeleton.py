"""The centre lines of a mask, one pixel wide, by parallel thinning of its border.

Guo and Hall, "Parallel thinning with two-subiteration algorithms" (1989): what a pixel's eight neighbours look like
decides whether it goes, so the neighbours are read as one byte, and two tables of 256 answers say it for all pixels.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator

import cv2
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.vision.image import Pixels

#: Neighbours from the one above, clockwise; the weight of each in the byte.
_AROUND = ((-1, 0), (-1, 1), (0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1))
_KERNEL = np.array([[128, 1, 2], [64, 0, 4], [32, 16, 8]], dtype=np.float32)
#: While an iteration takes away more than one pixel in so many, all are looked at again.
_WORTH_LOOKING = 2000


def skeleton(mask: Pixels, keep: Pixels | None = None) -> Pixels:
    """The centre lines (H, W) of ``mask`` ((H, W) uint8, not 0: inside), 255 on a line, connected as the mask is.

    keep: pixels of the mask that stay whatever they look like; lines then end at them. What touches the border of the
    picture is thinned as if there were nothing beyond it.
    """
    found = np.zeros(mask.shape, dtype=np.uint8)
    u, v, width, height = cv2.boundingRect(mask)
    if not width:
        return found
    inside = (slice(v, v + height), slice(u, u + width))
    rest = np.pad((mask[inside] != 0).astype(np.uint8), 1)
    free = np.ones_like(rest) if keep is None else np.pad((keep[inside] == 0).astype(np.uint8), 1)
    rest = _few(*_many(rest, free))
    found[inside] = rest[1:-1, 1:-1] * np.uint8(255)
    return found


def _many(rest: Pixels, free: Pixels) -> tuple[Pixels, Pixels]:
    """Whole iterations over the picture, as long as they are worth it; and what of the picture is still free to go."""
    most = cv2.countNonZero(rest) // _WORTH_LOOKING
    gone = most + 1
    while gone > most:
        gone = 0
        for table in _TABLES:
            code = cv2.filter2D(rest, cv2.CV_8U, _KERNEL, borderType=cv2.BORDER_CONSTANT)
            going = cv2.bitwise_and(cv2.bitwise_and(cv2.LUT(code, table), rest), free)
            gone += cv2.countNonZero(going)
            rest = np.asarray(cv2.subtract(rest, going), dtype=np.uint8)
    return rest, free


def _few(rest: Pixels, free: Pixels) -> Pixels:
    """The same for the pixels alone whose neighbours have changed; all are looked at once for each half."""
    flat, may = rest.ravel(), free.ravel()
    width = rest.shape[1]
    step = np.array([down * width + right for down, right in _AROUND])
    weight = 1 << np.arange(8)
    changed = [np.flatnonzero(flat & may)] * 2
    turn = 0
    while len(changed[0]) or len(changed[1]):
        at = changed[turn]
        at = at[flat[at] != 0]
        going = at[_TABLES[turn][flat[at[:, None] + step] @ weight] != 0]
        flat[going] = 0
        near = np.unique(going[:, None] + step)
        near = near[(flat[near] & may[near]) != 0]
        changed = [near if k == turn else np.union1d(changed[k], near) for k in (0, 1)]
        turn = 1 - turn
    return rest


def _table(turn: int) -> Pixels:
    """For each byte of neighbours 1 where the pixel between them goes in this half of an iteration."""
    n, ne, e, se, s, sw, w, nw = ((np.arange(256) >> k & 1).astype(bool) for k in range(8))
    pairs = ((n, ne, e), (e, se, s), (s, sw, w), (w, nw, n))
    # The runs of neighbours: one, and taking the pixel away parts nothing.
    runs = sum((~a & (b | c)).astype(int) for a, b, c in pairs)
    one = sum((a | b).astype(int) for a, b in ((nw, n), (ne, e), (se, s), (sw, w)))
    other = sum((a | b).astype(int) for a, b in ((n, ne), (e, se), (s, sw), (w, nw)))
    fewest = np.minimum(one, other)
    side = (n | ne | ~se) & e if turn else (s | sw | ~nw) & w
    return np.asarray(((runs == 1) & (fewest >= 2) & (fewest <= 3) & ~side).astype(np.uint8))


_TABLES = (_table(0), _table(1))


# Centre lines as a graph: branches of pixels between ends, junctions and what they are attached to.

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
    return [
        part.tolist()
        for part in np.split(found[row, column], np.searchsorted(row, np.arange(1, len(flat))))
    ]


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


# From the graph of centre lines to long strokes: spurs go, junctions become one place, lines run straight on.

#: A branch that ends nowhere is a spur when it is shorter than so many times the depth (px to the border) at its root,
#: which is half the width there. The two spurs of a square end are 1.41 depths long, that of a 60 degree corner 2.
_SPUR = 2.0
#: Junctions nearer to each other than so many times the depth are one.
_ONE = 1.0
#: A line from a junction to itself that is shorter, in depths, is a speck of a hole.
_LONG_LOOP = 2.0
#: How far from a junction, in depths, its branches are looked at to see which one goes straight on.
_LOOK_DEPTHS = 2.0
#: The least cosine between one branch's way in and the other's way out for which the line runs on: 60 deg of bend.
_STRAIGHT_COSINE = 0.5


class Stroke(Struct, frozen=True, eq=False):
    """points: (N,) u + iv px, N = 1 for a dot. closed: the last is followed by the first. start, end: whether the line
    ends there on its own, so that it may be made longer or shorter, not in a junction or at what was kept.
    """

    points: ComplexArray
    closed: bool
    start: bool
    end: bool


class _Tangle(Struct, frozen=True, eq=False):
    """Branches and their ends: end 2 k is the start of branch k, 2 k + 1 its end.

    node: by end, the junction that it is at. meeting: the ends at each junction. place: where it is.
    """

    net: Graph
    branches: list[Branch]
    node: list[int]
    meeting: dict[int, list[int]]
    place: dict[int, complex]

    def leaving(self, end: int) -> ComplexArray:
        """The points of a branch as seen from one of its ends."""
        points = self.branches[end // 2].points
        return points[::-1] if end % 2 else points

    def ends_there(self, end: int) -> bool:
        """Whether nothing else is where this end is."""
        return len(self.meeting[self.node[end]]) == 1 and not self.net.held[self.node[end]]


def strokes(net: Graph) -> list[Stroke]:
    """The strokes of a graph, every branch that is no spur once."""
    branches = _prune(net, list(net.branches))
    dots = [Stroke(b.points, False, True, True) for b in branches if len(b.points) == 1]
    branches = [b for b in branches if len(b.points) > 1]
    place, stands = _contract(net, branches)
    within = [
        stands[b.start] == stands[b.end] and b.start != b.end and len(b.points) > 1
        for b in branches
    ]
    branches = [
        b
        for b, gone in zip(branches, within, strict=True)
        if not gone or b.length > _LONG_LOOP * net.depth[b.start]
    ]
    node = [stands[n] for b in branches for n in (b.start, b.end)]
    meeting: dict[int, list[int]] = defaultdict(list)
    for end, n in enumerate(node):
        meeting[n].append(end)
    return dots + _join(_Tangle(net, branches, node, dict(meeting), place))


def _ends(branches: list[Branch]) -> dict[int, int]:
    """How many branches meet at each node."""
    count: dict[int, int] = defaultdict(int)
    for branch in branches:
        count[branch.start] += 1
        count[branch.end] += 1
    return count


def _prune(net: Graph, branches: list[Branch]) -> list[Branch]:
    """Without spurs. A node that loses all its branches is a dot."""
    for _ in range(2):
        count = _ends(branches)
        left: list[Branch] = []
        dropped: list[int] = []
        for branch in branches:
            free = [n for n in (branch.start, branch.end) if count[n] == 1 and not net.held[n]]
            root = branch.start if branch.end in free else branch.end
            if len(free) == 1 and branch.length < _SPUR * net.depth[root]:
                dropped.append(root)
            else:
                left.append(branch)
        if not dropped:
            break
        kept = _ends(left)
        lonely = dict.fromkeys(n for n in dropped if not kept[n] and not net.held[n])
        branches = left + [Branch(net.place[[n]], n, n) for n in lonely]
    return branches


def _contract(net: Graph, branches: list[Branch]) -> tuple[dict[int, complex], dict[int, int]]:
    """Which node stands for each, and where it is: nodes nearer to each other than half the width there are one."""
    count = _ends(branches)
    stands: dict[int, int] = {n: n for n in count}

    def top(n: int) -> int:
        while stands[n] != n:
            stands[n] = stands[stands[n]]
            n = stands[n]
        return n

    for b in branches:
        inner = (
            count[b.start] > 2 and count[b.end] > 2 and not (net.held[b.start] or net.held[b.end])
        )
        if (
            inner
            and b.start != b.end
            and b.length <= _ONE * max(net.depth[b.start], net.depth[b.end])
        ):
            stands[top(b.end)] = top(b.start)
    node = {n: top(n) for n in stands}
    members: dict[int, list[int]] = defaultdict(list)
    for n, group in node.items():
        members[group].append(n)
    return {group: complex(net.place[own].mean()) for group, own in members.items()}, node


def _join(tangle: _Tangle) -> list[Stroke]:
    """The branches that run on in one another, as strokes."""
    count = len(tangle.node)
    partner = [-1] * count
    for group, ends in tangle.meeting.items():
        if len(ends) > 1 and not tangle.net.held[group]:
            for a, b in _pairs(tangle, ends):
                partner[a], partner[b] = b, a
    done = [False] * len(tangle.branches)
    # Lines first that have a beginning; what is left then is closed.
    firsts = sorted(range(count), key=lambda end: partner[end] >= 0)
    return [_run(tangle, partner, done, first) for first in firsts if not done[first // 2]]


def _pairs(tangle: _Tangle, ends: list[int]) -> list[tuple[int, int]]:
    """The ends at a junction that go straight on in each other, the straightest first; two alone always do."""
    if len(ends) == 2:
        return [(ends[0], ends[1])]
    out = np.array([_direction(tangle, end) for end in ends])
    cosine = -(out[:, None] * out.conj()).real
    a, b = np.triu_indices(len(ends), 1)
    pairs: list[tuple[int, int]] = []
    free = set(range(len(ends)))
    for k in np.argsort(-cosine[a, b], kind="stable").tolist():
        i, j = int(a[k]), int(b[k])
        if i in free and j in free and cosine[i, j] > _STRAIGHT_COSINE:
            free -= {i, j}
            pairs.append((ends[i], ends[j]))
    return pairs


def _direction(tangle: _Tangle, end: int) -> complex:
    """Unit, out of the junction, as seen from farther away than it is wide."""
    points = tangle.leaving(end)
    branch = tangle.branches[end // 2]
    depth = tangle.net.depth[branch.end if end % 2 else branch.start]
    near, far = (
        min(round(depth * k), len(points) - 1) for k in (_ONE / 2, _ONE / 2 + _LOOK_DEPTHS)
    )
    way = points[far] - points[near if far > near else 0]
    return complex(way / max(abs(way), 1e-9))


def _run(tangle: _Tangle, partner: list[int], done: list[bool], first: int) -> Stroke:
    """The stroke that begins at the end ``first``, through all junctions where it has a partner."""
    pieces: list[ComplexArray] = []
    end = first
    while True:
        done[end // 2] = True
        pieces += [np.array([tangle.place[tangle.node[end]]]), tangle.leaving(end)[1:-1]]
        leaving = end ^ 1
        end = partner[leaving]
        if end < 0 or done[end // 2]:
            break
    if end == first:
        return Stroke(np.concatenate(pieces), True, False, False)
    pieces.append(np.array([tangle.place[tangle.node[leaving]]]))
    return Stroke(
        np.concatenate(pieces), False, tangle.ends_there(first), tangle.ends_there(leaving)
    )
