"""A network cut at its nodes, run as few trails: ways through the nodes, circuits that become one, lifts cut out."""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.pose import FloatArray, frozen
from camgen.shapes import Contour
from camgen.tours.matching import paired

__all__ = ["Pieces", "trails"]

#: Up to so many ends at a node are paired by the least turn of all pairs; beyond, each with the one opposite.
_CROWD = 32
#: An end is moved so far at most without a line of its own, mm.
_CLOSE = 1e-6


class Pieces(Struct, frozen=True, eq=False):
    """Stretches of contours between nodes.

    rows: contour, first and last vertex; the last may lie beyond the end of a closed contour, which goes on at its
    start. nodes: of each piece two, where it begins and where it ends. home: (nodes, 2) mm. network: of each piece.
    """

    rows: list[tuple[int, int, int]]
    nodes: list[int]
    home: FloatArray
    network: list[int]


def trails(pieces: Pieces, contours: list[Contour]) -> list[tuple[Contour, int]]:
    """Contours that run every piece once, each with its network; half as many as a network has odd nodes, or one.

    End 2 i is where piece i begins, 2 i + 1 where it ends; lifts between odd nodes are pieces behind the others.
    """
    at: list[list[int]] = [[] for _ in pieces.home]
    for end, node in enumerate(pieces.nodes):
        at[node].append(end)
    odd = [node for node, ends in enumerate(at) if len(ends) % 2]
    directions = _directions(pieces, contours)
    partner = _through(at, directions)
    # Each odd node has one end that leads nowhere: there the pen is lifted, and let down at the node's partner.
    loose = [next(end for end in at[node] if partner[end] < 0) for node in odd]
    lifts: list[int] = [-1] * len(partner)
    if odd:
        for a, b in enumerate(paired(pieces.home[odd]).tolist()):
            lifts[loose[a]] = loose[b]
    jumps = [p if p >= 0 else q for p, q in zip(partner, lifts, strict=True)]
    _as_one(at, jumps, lifts, directions)
    return [(_drawn(pieces, contours, run, closed), pieces.network[run[0] >> 1]) for run, closed in _runs(jumps, lifts)]


def _directions(pieces: Pieces, contours: list[Contour]) -> list[tuple[float, float]]:
    """Of each end the unit vector along its piece, away from the node."""
    found = []
    for k, a, b in pieces.rows:
        points, bulges = contours[k].points, contours[k].bulges
        size = len(points)
        for row, sign in ((a, 1.0), (b - 1, -1.0)):
            (px, py), (qx, qy) = points[row % size].tolist(), points[(row + 1) % size].tolist()
            # The tangent turns away from the chord by half the sweep, atan(bulge) twice, at both ends.
            angle = math.atan2(qy - py, qx - px) - sign * 2 * math.atan(float(bulges[row % size]))
            found.append((sign * math.cos(angle), sign * math.sin(angle)))
    return found


def _through(at: list[list[int]], directions: list[tuple[float, float]]) -> list[int]:
    """The end at which each end goes on at its node, straightest first; -1 for the one left over at an odd node."""
    partner = [-1] * len(directions)
    for ends in at:
        if len(ends) > _CROWD:
            around = sorted(ends, key=lambda end: (math.atan2(*directions[end]), end))
            half = len(ends) // 2
            pairs = list(zip(around[:half], around[half : 2 * half], strict=True))
        else:
            # Rounded, so that equal turns do not hang on the last bit.
            ranked = sorted((round(_bend(directions, a, b), 9), a, b) for k, a in enumerate(ends) for b in ends[:k])
            pairs = [(a, b) for _, a, b in ranked]
        for a, b in pairs:
            if partner[a] < 0 and partner[b] < 0:
                partner[a], partner[b] = b, a
    return partner


def _bend(directions: list[tuple[float, float]], a: int, b: int) -> float:
    """-1 where one end goes straight on in the other, 1 where it turns back."""
    (ax, ay), (bx, by) = directions[a], directions[b]
    return ax * bx + ay * by


def _as_one(at: list[list[int]], jumps: list[int], lifts: list[int], directions: list[tuple[float, float]]) -> None:
    """Circuits that share a node become one: two ways through it, of one circuit each, exchange their ends."""
    circuit = _circuits(jumps)
    parent = list(range(len(jumps)))

    def root(number: int) -> int:
        while parent[number] != number:
            parent[number] = parent[parent[number]]
            number = parent[number]
        return number

    for ends in at:
        held = ends[0]
        for end in ends[1:]:
            one, two = root(circuit[held >> 1]), root(circuit[end >> 1])
            if one == two:
                continue
            parent[max(one, two)] = min(one, two)
            _exchanged(held, end, jumps, lifts, directions)


def _exchanged(a: int, c: int, jumps: list[int], lifts: list[int], directions: list[tuple[float, float]]) -> None:
    """The ways from a and from c, at one node and in two circuits, led into each other, the straighter way of two.

    Either makes one circuit. A node has one lift at most: then it leads from another end of the same node.
    """
    b, d = jumps[a], jumps[c]
    far = b if lifts[a] >= 0 else d if lifts[c] >= 0 else -1
    straight, crossed = ((a, c), (b, d)), ((a, d), (b, c))

    def turn(pairs: tuple[tuple[int, int], ...]) -> float:
        return round(sum(_bend(directions, *pair) for pair in pairs if far not in pair), 9)

    for one, two in min(straight, crossed, key=turn):
        jumps[one], jumps[two] = two, one
        lifts[one], lifts[two] = (two, one) if far in (one, two) else (-1, -1)


def _circuits(jumps: list[int]) -> list[int]:
    """A number for the circuit of each piece: its lowest piece."""
    found = [-1] * (len(jumps) // 2)
    for piece in range(len(found)):
        end = 2 * piece
        while found[end >> 1] < 0:
            found[end >> 1] = piece
            end = jumps[end ^ 1]
    return found


def _runs(jumps: list[int], lifts: list[int]) -> list[tuple[list[int], bool]]:
    """The ends at which the pieces of each trail are entered, and whether it comes back to where it began."""
    seen = [False] * (len(jumps) // 2)
    found = []
    begins = [end for end in range(len(jumps)) if lifts[end] >= 0]
    for begin in [*begins, *range(0, len(jumps), 2)]:
        run: list[int] = []
        end = begin
        while not seen[end >> 1]:
            seen[end >> 1] = True
            run.append(end)
            if lifts[end ^ 1] >= 0:
                break
            end = jumps[end ^ 1]
        if run:
            found.append((run, lifts[begin] < 0))
    return found


def _drawn(pieces: Pieces, contours: list[Contour], run: list[int], closed: bool) -> Contour:
    """The pieces of a trail as one contour, with layer and name of the first."""
    points, bulges = [], []
    for end in run:
        xy, bulge = _stretch(pieces, contours, end)
        # Each piece gives its last point to the next one, which begins there.
        points.append(xy[:-1])
        bulges.append(bulge)
    if not closed:
        points.append(xy[-1:])
        bulges.append(np.zeros(1))
    first = contours[pieces.rows[run[0] >> 1][0]]
    return replace(first, points=frozen(np.concatenate(points)), bulges=frozen(np.concatenate(bulges)), closed=closed)


def _stretch(pieces: Pieces, contours: list[Contour], end: int) -> tuple[FloatArray, FloatArray]:
    """Points (M, 2) and bulges (M - 1,) of a piece entered at ``end``, from node to node."""
    k, a, b = pieces.rows[end >> 1]
    rows = np.arange(a, b + 1) % len(contours[k].points)
    xy, bulge = contours[k].points[rows], contours[k].bulges[rows[:-1]]
    for side, beside, row in ((0, 0, 0), (1, -1, -1)):
        node = pieces.home[pieces.nodes[end & ~1 | side]]
        if bulge[beside] == 0 or math.dist(xy[row], node) <= _CLOSE:
            xy[row] = node
        elif side:
            # An arc is not bent: a line leads on from its end.
            xy, bulge = np.concatenate([xy, [node]]), np.concatenate([bulge, [0.0]])
        else:
            xy, bulge = np.concatenate([[node], xy]), np.concatenate([[0.0], bulge])
    return (xy[::-1], -bulge[::-1] + 0.0) if end & 1 else (xy, bulge)
