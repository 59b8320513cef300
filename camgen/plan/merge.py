"""Networks of lines drawn with few lifts: chains that meet become trails before they are put in order.

The reader has joined the ends that meet in pairs. What is left are places where more lines meet: a chain that ends at a
vertex of another one, loops that touch. Such a network is cut at its nodes and run anew (route inspection: Kwan, 1962;
Edmonds and Johnson, 1973): a trail begins and ends where an odd number of lines meet, so that each connected network
takes half as many trails as it has such nodes, and no fewer are possible. At a node the straightest ways are taken.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry.nearest import IntArray
from camgen.geometry.pairing import pair_points
from camgen.geometry.ragged import offsets, owners, starts_run
from camgen.model.part import Contour, Note
from camgen.model.pose import FloatArray, frozen
from camgen.model.text import counted, short
from camgen.model.tolerance import OFF_GRID, SAME_POINT_MM

# A network cut at its nodes, run as few trails: ways through the nodes, circuits that become one, lifts cut out.

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
        for a, b in enumerate(pair_points(pieces.home[odd]).tolist()):
            lifts[loose[a]] = loose[b]
    jumps = [p if p >= 0 else q for p, q in zip(partner, lifts, strict=True)]
    _as_one(at, jumps, lifts, directions)
    return [
        (_draw_trail(pieces, contours, run, closed), pieces.network[run[0] >> 1])
        for run, closed in _runs(jumps, lifts)
    ]


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
            ranked = sorted(
                (round(_bend(directions, a, b), 9), a, b)
                for k, a in enumerate(ends)
                for b in ends[:k]
            )
            pairs = [(a, b) for _, a, b in ranked]
        for a, b in pairs:
            if partner[a] < 0 and partner[b] < 0:
                partner[a], partner[b] = b, a
    return partner


def _bend(directions: list[tuple[float, float]], a: int, b: int) -> float:
    """-1 where one end goes straight on in the other, 1 where it turns back."""
    (ax, ay), (bx, by) = directions[a], directions[b]
    return ax * bx + ay * by


def _as_one(
    at: list[list[int]], jumps: list[int], lifts: list[int], directions: list[tuple[float, float]]
) -> None:
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
            _exchange(held, end, jumps, lifts, directions)


def _exchange(
    a: int, c: int, jumps: list[int], lifts: list[int], directions: list[tuple[float, float]]
) -> None:
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


def _draw_trail(pieces: Pieces, contours: list[Contour], run: list[int], closed: bool) -> Contour:
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
    return replace(
        first,
        points=frozen(np.concatenate(points)),
        bulges=frozen(np.concatenate(bulges)),
        closed=closed,
    )


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


class _Vertices(Struct, frozen=True, eq=False):
    """All vertices: points (V, 2), owner (V,) the contour, node (V,) the place, first (C + 1,) of each contour's."""

    points: FloatArray
    owner: IntArray
    node: IntArray
    first: IntArray


def merge(
    contours: Sequence[Contour], fixed: Sequence[bool], tolerance: float
) -> tuple[tuple[Contour, ...], tuple[Note, ...]]:
    """The contours with each network as few trails, in the place of its first contour, and a note.

    fixed: contours to be left as they are. tolerance: mm, an end meets a vertex of another contour that is nearer.
    Only contours of one layer are merged. A contour that meets no other stays as it is.
    """
    layers: dict[str, list[int]] = {}
    for k, contour in enumerate(contours):
        if not fixed[k] and len(contour.points) > 1:
            layers.setdefault(contour.layer, []).append(k)
    result: dict[int, list[Contour]] = {k: [contour] for k, contour in enumerate(contours)}
    ids: list[str] = []
    after = 0
    for members in layers.values():
        for chosen, made in _networks([contours[k] for k in members], tolerance):
            if len(made) == len(chosen):
                continue  # what the reader has joined needs no more lifts, and goes straighter
            ids += [contours[members[k]].id for k in chosen]
            after += len(made)
            for k in chosen:
                result[members[k]] = []
            result[members[chosen[0]]] = _name_trails(made, tuple(ids[-len(chosen) :]))
    if not ids:
        return tuple(contours), ()
    why = f"lines that meet within input.join = {short(tolerance, 6)} mm are run with the fewest lifts"
    note = Note(
        "joined",
        f"networks of lines: {counted(len(ids), 'contour')} run as {counted(after, 'path')}",
        why,
        tuple(ids),
    )
    return tuple(one for k in range(len(contours)) for one in result[k]), (note,)


def _name_trails(made: list[Contour], sources: tuple[str, ...]) -> list[Contour]:
    """Each trail has the name of the contour that it begins with; the second one of a name and so on are counted."""
    seen: dict[str, int] = {}
    named = []
    for contour in made:
        seen[contour.id] = count = seen.get(contour.id, 0) + 1
        name = contour.id if count == 1 else f"{contour.id}.{count}"
        named.append(replace(contour, id=name, sources=sources))
    return named


def _networks(contours: list[Contour], tolerance: float) -> list[tuple[list[int], list[Contour]]]:
    """The contours of one layer that meet others, by network, and its trails."""
    if len(contours) < 2:
        return []
    vertices = _vertices(contours)
    vertices = _meet(vertices, contours, tolerance)
    label = _components(vertices, len(contours))
    sizes = np.bincount(label, minlength=len(contours))
    chosen = np.flatnonzero(sizes[label] > 1)
    if not len(chosen):
        return []
    pieces = _cut(contours, vertices, chosen, label)
    found: dict[int, tuple[list[int], list[Contour]]] = {}
    for k in chosen.tolist():
        found.setdefault(int(label[k]), ([], []))[0].append(k)
    for contour, number in trails(pieces, contours):
        found[number][1].append(contour)
    return list(found.values())


def _vertices(contours: list[Contour]) -> _Vertices:
    points = np.concatenate([contour.points for contour in contours])
    counts = np.array([len(contour.points) for contour in contours])
    reach = max(SAME_POINT_MM, 16 * float(np.spacing(np.abs(points).max())))
    cells = np.floor(points / reach + OFF_GRID).astype(np.int64)
    order = np.lexsort((cells[:, 1], cells[:, 0]))
    fresh = starts_run(cells[order])
    node = np.empty(len(points), dtype=np.int64)
    node[order] = np.cumsum(fresh) - 1
    return _Vertices(points, owners(counts), node, offsets(counts))


def _meet(vertices: _Vertices, contours: list[Contour], tolerance: float) -> _Vertices:
    """Ends that share their place with no other vertex are moved in with the nearest vertex of another contour."""
    opened = np.array([not contour.closed for contour in contours])
    starts, points = vertices.first[:-1], vertices.points
    extent = (np.maximum.reduceat(points, starts) - np.minimum.reduceat(points, starts)).max(axis=1)
    firm = np.flatnonzero(opened & (extent > 4 * tolerance))
    ends = np.concatenate([vertices.first[firm], vertices.first[firm + 1] - 1])
    ends = ends[np.bincount(vertices.node)[vertices.node[ends]] == 1]
    if not len(ends) or tolerance <= 0:
        return vertices
    import shapely  # noqa: PLC0415 (0.1 s, and only drawings with loose ends need it)

    tree = shapely.STRtree(shapely.points(vertices.points))
    end, other = tree.query(
        shapely.points(vertices.points[ends]), predicate="dwithin", distance=tolerance
    )
    end = ends[end]
    fair = vertices.owner[end] != vertices.owner[other]
    end, other = end[fair], other[fair]
    gap = np.hypot(*(vertices.points[end] - vertices.points[other]).T)
    node, points = vertices.node.copy(), vertices.points.copy()
    done: set[int] = set()
    for k in np.lexsort((other, end, gap)).tolist():
        a, b = int(end[k]), int(other[k])
        # A vertex that has moved itself is left alone, so that no row of close ends falls into one place.
        if a not in done and b not in done:
            node[a], points[a] = node[b], points[b]
            done |= {a} | ({b} if b in ends else set())
    return _Vertices(points, vertices.owner, node, vertices.first)


def _components(vertices: _Vertices, count: int) -> IntArray:
    """(C,) the lowest contour of the network of each contour."""
    order = np.argsort(vertices.node, kind="stable")
    together = np.flatnonzero(np.diff(vertices.node[order]) == 0)
    one, two = vertices.owner[order[together]], vertices.owner[order[together + 1]]
    label = np.arange(count)
    one, two = one[one != two], two[one != two]
    while True:
        low = np.minimum(label[one], label[two])
        new = label.copy()
        np.minimum.at(new, label[one], low)
        np.minimum.at(new, label[two], low)
        new = new[new]
        if (new == label).all():
            return label
        label = new


def _cut(contours: list[Contour], vertices: _Vertices, chosen: IntArray, label: IntArray) -> Pieces:
    """The chosen contours cut at the nodes of their networks."""
    shared = np.bincount(vertices.node) > 1
    rows: list[tuple[int, int, int]] = []
    nodes: list[int] = []
    for k in chosen.tolist():
        first, size = int(vertices.first[k]), len(contours[k].points)
        own = vertices.node[first : first + size]
        at = np.flatnonzero(shared[own]).tolist()
        turns = [*at, at[0] + size] if contours[k].closed else sorted({0, *at, size - 1})
        for a, b in itertools.pairwise(turns):
            rows.append((k, a, b))
            nodes += [int(own[a]), int(own[b % size])]
    which, places = np.unique(nodes, return_inverse=True)
    home = np.zeros((len(which), 2))
    held = np.flatnonzero(np.isin(vertices.node, which))[::-1]
    home[np.searchsorted(which, vertices.node[held])] = vertices.points[held]
    return Pieces(rows, places.tolist(), home, [int(label[k]) for k, _, _ in rows])
