"""From the graph of centre lines to long strokes: spurs go, junctions become one place, lines run straight on."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
from msgspec import Struct

from camgen.vision.skeleton_graph import Branch, ComplexArray, Graph

#: A branch that ends nowhere is a spur when it is shorter than so many times the depth (px to the border) at its root,
#: which is half the width there. The two spurs of a square end are 1.41 depths long, that of a 60 degree corner 2.
_SPUR = 2.0
#: Junctions nearer to each other than so many times the depth are one.
_ONE = 1.0
#: A line from a junction to itself that is shorter, in depths, is a speck of a hole.
_LONG = 2.0
#: How far from a junction, in depths, its branches are looked at to see which one goes straight on.
_LOOK = 2.0
#: The least cosine between one branch's way in and the other's way out for which the line runs on: 60 deg of bend.
_STRAIGHT = 0.5


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
    branches = _pruned(net, list(net.branches))
    dots = [Stroke(b.points, False, True, True) for b in branches if len(b.points) == 1]
    branches = [b for b in branches if len(b.points) > 1]
    place, stands = _contracted(net, branches)
    within = [stands[b.start] == stands[b.end] and b.start != b.end and len(b.points) > 1 for b in branches]
    branches = [
        b for b, gone in zip(branches, within, strict=True) if not gone or b.length > _LONG * net.depth[b.start]
    ]
    node = [stands[n] for b in branches for n in (b.start, b.end)]
    meeting: dict[int, list[int]] = defaultdict(list)
    for end, n in enumerate(node):
        meeting[n].append(end)
    return dots + _joined(_Tangle(net, branches, node, dict(meeting), place))


def _ends(branches: list[Branch]) -> dict[int, int]:
    """How many branches meet at each node."""
    count: dict[int, int] = defaultdict(int)
    for branch in branches:
        count[branch.start] += 1
        count[branch.end] += 1
    return count


def _pruned(net: Graph, branches: list[Branch]) -> list[Branch]:
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


def _contracted(net: Graph, branches: list[Branch]) -> tuple[dict[int, complex], dict[int, int]]:
    """Which node stands for each, and where it is: nodes nearer to each other than half the width there are one."""
    count = _ends(branches)
    stands: dict[int, int] = {n: n for n in count}

    def top(n: int) -> int:
        while stands[n] != n:
            stands[n] = stands[stands[n]]
            n = stands[n]
        return n

    for b in branches:
        inner = count[b.start] > 2 and count[b.end] > 2 and not (net.held[b.start] or net.held[b.end])
        if inner and b.start != b.end and b.length <= _ONE * max(net.depth[b.start], net.depth[b.end]):
            stands[top(b.end)] = top(b.start)
    node = {n: top(n) for n in stands}
    members: dict[int, list[int]] = defaultdict(list)
    for n, group in node.items():
        members[group].append(n)
    return {group: complex(net.place[own].mean()) for group, own in members.items()}, node


def _joined(tangle: _Tangle) -> list[Stroke]:
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
        if i in free and j in free and cosine[i, j] > _STRAIGHT:
            free -= {i, j}
            pairs.append((ends[i], ends[j]))
    return pairs


def _direction(tangle: _Tangle, end: int) -> complex:
    """Unit, out of the junction, as seen from farther away than it is wide."""
    points = tangle.leaving(end)
    branch = tangle.branches[end // 2]
    depth = tangle.net.depth[branch.end if end % 2 else branch.start]
    near, far = (min(round(depth * k), len(points) - 1) for k in (_ONE / 2, _ONE / 2 + _LOOK))
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
    return Stroke(np.concatenate(pieces), False, tangle.ends_there(first), tangle.ends_there(leaving))
