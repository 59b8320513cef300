"""Merges networks of lines into trails, so that they are drawn with few lifts.

The reader has joined ends that meet in pairs. A network has more lines at a point: a chain that
ends at a vertex of another one, or loops that touch. It is cut at these nodes and its pieces are
joined again to trails (route inspection: Kwan, 1962; Edmonds and Johnson, 1973). A trail starts
and ends at nodes with an odd number of lines, so a connected network needs half as many trails as
it has such nodes. At a node a trail continues in the straightest direction.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry.nearest import IntArray
from camgen.geometry.pairing import pair_points
from camgen.geometry.ragged import (
    compute_offsets,
    count_rows,
    find_root,
    list_owners,
    mark_run_starts,
)
from camgen.model.part import BoolArray, Contour, Note, list_ids, tabulate_contours
from camgen.model.pose import FloatArray, frozen
from camgen.model.sequences import take_rows
from camgen.model.text import counted, short
from camgen.model.tolerance import OFF_GRID, SAME_POINT_MM

# Trails: ends are paired at the nodes, circuits that share a node are joined, lifts are cut out.

#: Number of ends at a node up to which all pairs are compared. Beyond, opposite ends are paired.
_MAX_COMPARED_ENDS = 32
#: Maximum distance by which an end is moved without an added line, mm.
_CLOSE = 1e-6


class Pieces(Struct, frozen=True, eq=False):
    """Stretches of contours between nodes.

    rows: contour, first and last vertex of each piece. In a closed contour the last vertex may lie
        beyond the end, which continues at the start.
    nodes: two for each piece, its start and its end.
    home: (nodes, 2) positions of the nodes, mm.
    network: network of each piece.
    """

    rows: list[tuple[int, int, int]]
    nodes: list[int]
    home: FloatArray
    network: list[int]


def make_trails(pieces: Pieces, contours: list[Contour]) -> list[tuple[Contour, int]]:
    """Trails that run every piece once, each with its network.

    A network gets half as many trails as it has odd nodes, or one. An end is a number: 2 i is the
    start of piece i, 2 i + 1 its end. Odd nodes are paired by lifts.
    """
    ends_by_node: list[list[int]] = [[] for _ in pieces.home]
    for end, node in enumerate(pieces.nodes):
        ends_by_node[node].append(end)
    odd = np.flatnonzero(count_rows(ends_by_node) % 2).tolist()
    directions = list(_compute_directions(pieces, contours))
    partner = _pair_ends(ends_by_node, directions)
    # An odd node has one end without a partner: there the pen is lifted, and moved to another one.
    alone = np.flatnonzero(np.array(partner) < 0)
    loose = alone[np.argsort(np.array(pieces.nodes)[alone], kind="stable")].tolist()
    lifts: list[int] = [-1] * len(partner)
    if odd:
        for a, b in enumerate(pair_points(pieces.home[odd]).tolist()):
            lifts[loose[a]] = loose[b]
    jumps = np.where(np.array(partner) >= 0, partner, lifts).tolist()
    _join_circuits(ends_by_node, jumps, lifts, directions)
    return [
        (_draw_trail(pieces, contours, run, closed), pieces.network[run[0] >> 1])
        for run, closed in _list_trails(jumps, lifts)
    ]


def _compute_directions(pieces: Pieces, contours: list[Contour]) -> Iterator[tuple[float, float]]:
    """For each end the unit vector along its piece, away from the node."""
    for k, a, b in pieces.rows:
        points, bulges = contours[k].points, contours[k].bulges
        size = len(points)
        for row, sign in ((a, 1.0), (b - 1, -1.0)):
            (px, py), (qx, qy) = points[row % size].tolist(), points[(row + 1) % size].tolist()
            # The tangent differs from the chord by half the sweep, atan(bulge) twice, at both ends.
            angle = math.atan2(qy - py, qx - px) - sign * 2 * math.atan(float(bulges[row % size]))
            yield sign * math.cos(angle), sign * math.sin(angle)


def _pair_ends(ends_by_node: list[list[int]], directions: list[tuple[float, float]]) -> list[int]:
    """Pair the ends at each node, straightest first. Returns the partner of each end, or -1."""
    partner = [-1] * len(directions)
    for ends in ends_by_node:
        if len(ends) > _MAX_COMPARED_ENDS:
            ranked = sorted(ends, key=lambda end: (math.atan2(*directions[end]), end))
            half = len(ends) // 2
            pairs = list(zip(ranked[:half], ranked[half : 2 * half], strict=True))
        else:
            pairs = list(itertools.combinations(ends[::-1], 2))
            # Rounded, so that the last bit does not decide between equal angles.
            pairs.sort(key=lambda pair: (round(_bend(directions, *pair), 9), pair))
        for a, b in pairs:
            if partner[a] < 0 and partner[b] < 0:
                partner[a], partner[b] = b, a
    return partner


def _bend(directions: list[tuple[float, float]], a: int, b: int) -> float:
    """-1 if two ends continue each other straight, 1 if the trail would reverse its direction."""
    (a_x, a_y), (b_x, b_y) = directions[a], directions[b]
    return a_x * b_x + a_y * b_y


def _join_circuits(
    ends_by_node: list[list[int]],
    jumps: list[int],
    lifts: list[int],
    directions: list[tuple[float, float]],
) -> None:
    """Join circuits that share a node by an exchange of partners. Changes jumps and lifts."""
    circuit = _number_circuits(jumps)
    parent = list(range(len(jumps)))
    for ends in ends_by_node:
        for end in ends[1:]:
            first = find_root(parent, circuit[ends[0] >> 1])
            second = find_root(parent, circuit[end >> 1])
            if first != second:
                parent[max(first, second)] = min(first, second)
                _exchange_partners(ends[0], end, jumps, lifts, directions)


def _exchange_partners(
    a: int, c: int, jumps: list[int], lifts: list[int], directions: list[tuple[float, float]]
) -> None:
    """Exchange the partners of the ends a and c, which are at one node and in two circuits.

    Both exchanges make one circuit; the straighter one is taken. A node has at most one lift, which
    may then start at another end of the node. Changes jumps and lifts.
    """
    b, d = jumps[a], jumps[c]
    # The end at another node, to which the pen is lifted; -1 without a lift.
    far = next((partner for end, partner in ((a, b), (c, d)) if lifts[end] >= 0), -1)
    straight, crossed = ((a, c), (b, d)), ((a, d), (b, c))

    def sum_bends(pairs: tuple[tuple[int, int], ...]) -> float:
        return round(sum(_bend(directions, *pair) for pair in pairs if far not in pair), 9)

    for first, second in min(straight, crossed, key=sum_bends):
        jumps[first], jumps[second] = second, first
        lifts[first], lifts[second] = (second, first) if far in (first, second) else (-1, -1)


def _number_circuits(jumps: list[int]) -> list[int]:
    circuit = [-1] * (len(jumps) // 2)
    for piece in range(len(circuit)):
        end = 2 * piece
        while circuit[end >> 1] < 0:
            circuit[end >> 1] = piece
            end = jumps[end ^ 1]
    return circuit


def _list_trails(jumps: list[int], lifts: list[int]) -> Iterator[tuple[list[int], bool]]:
    """For each trail the ends at which its pieces are entered, and whether it is closed."""
    seen = [False] * (len(jumps) // 2)
    for start in [*np.flatnonzero(np.array(lifts) >= 0).tolist(), *range(0, len(jumps), 2)]:
        run: list[int] = []
        end = start
        while not seen[end >> 1]:
            seen[end >> 1] = True
            run.append(end)
            if lifts[end ^ 1] >= 0:
                break
            end = jumps[end ^ 1]
        if run:
            yield run, lifts[start] < 0


def _draw_trail(pieces: Pieces, contours: list[Contour], run: list[int], closed: bool) -> Contour:
    points, bulges = [], []
    for end in run:
        xy, bulge = _stretch(pieces, contours, end)
        # The last point of a piece is the first point of the next one.
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
    """Points (M, 2) and bulges (M - 1,) of a piece entered at `end`, from node to node."""
    k, a, b = pieces.rows[end >> 1]
    rows = np.arange(a, b + 1) % len(contours[k].points)
    xy, bulge = contours[k].points[rows], contours[k].bulges[rows[:-1]]
    for side, row in ((0, 0), (1, -1)):
        node = pieces.home[pieces.nodes[end & ~1 | side]]
        if bulge[row] == 0 or math.dist(xy[row], node) <= _CLOSE:
            xy[row] = node
        elif side:
            # An arc keeps its shape: a line connects its end with the node.
            xy, bulge = np.concatenate([xy, [node]]), np.concatenate([bulge, [0.0]])
        else:
            xy, bulge = np.concatenate([[node], xy]), np.concatenate([[0.0], bulge])
    return (xy[::-1], -bulge[::-1] + 0.0) if end & 1 else (xy, bulge)


class _Vertices(Struct, frozen=True, eq=False):
    """The vertices of all contours.

    points: (V, 2) positions, mm.
    owner: (V,) contour of each vertex.
    node: (V,) node of each vertex; vertices at one position share a node.
    first: (C + 1,) first vertex of each contour, and V.
    """

    points: FloatArray
    owner: IntArray
    node: IntArray
    first: IntArray


def merge(
    contours: Sequence[Contour], fixed: Sequence[bool] | BoolArray, tolerance: float
) -> tuple[tuple[Contour, ...], tuple[Note, ...]]:
    """Replace the contours of each network by few trails, at the index of its first contour.

    fixed: contours that are not changed.
    tolerance: distance within which an end meets a vertex of another contour, mm.
    Only contours of one layer are merged. A contour that meets no other stays as it is. Returns
    the contours, and a note if any were merged.
    """
    layers: dict[str, list[int]] = {}
    for k, contour in enumerate(contours):
        if not fixed[k] and len(contour.points) > 1:
            layers.setdefault(contour.layer, []).append(k)
    result = [[contour] for contour in contours]
    ids: list[str] = []
    count = 0
    for members in layers.values():
        for chosen, merged in _merge_layer(take_rows(contours, members), tolerance):
            if len(merged) == len(chosen):
                continue  # no lift is saved, and the chains of the reader are straighter
            rows = take_rows(members, chosen)
            chosen_ids = list_ids(take_rows(contours, rows))
            ids += chosen_ids
            count += len(merged)
            for row in rows:
                result[row] = []
            result[rows[0]] = list(_name_trails(merged, chosen_ids))
    if not ids:
        return tuple(contours), ()
    note = Note(
        "joined",
        f"networks of lines: {counted(len(ids), 'contour')} run as {counted(count, 'path')}",
        f"lines that meet within input.join = {short(tolerance, 6)} mm "
        "are run with the fewest lifts",
        tuple(ids),
    )
    return tuple(itertools.chain.from_iterable(result)), (note,)


def _name_trails(merged: list[Contour], sources: tuple[str, ...]) -> Iterator[Contour]:
    """Name each trail after its first contour; a number follows from the second of a name on."""
    seen: dict[str, int] = {}
    for contour in merged:
        seen[contour.id] = count = seen.get(contour.id, 0) + 1
        name = contour.id if count == 1 else f"{contour.id}.{count}"
        yield replace(contour, id=name, sources=sources)


def _merge_layer(
    contours: list[Contour], tolerance: float
) -> list[tuple[list[int], list[Contour]]]:
    if len(contours) < 2:
        return []
    vertices = _meet(_make_vertices(contours), contours, tolerance)
    label = _label_networks(vertices, len(contours))
    chosen = np.flatnonzero(np.bincount(label, minlength=len(contours))[label] > 1)
    if not len(chosen):
        return []
    pieces = _cut(contours, vertices, chosen, label)
    networks: dict[int, tuple[list[int], list[Contour]]] = {}
    for k in chosen.tolist():
        networks.setdefault(int(label[k]), ([], []))[0].append(k)
    for contour, number in make_trails(pieces, contours):
        networks[number][1].append(contour)
    return list(networks.values())


def _make_vertices(contours: list[Contour]) -> _Vertices:
    points, _, counts, _ = tabulate_contours(contours)
    cell_size = max(SAME_POINT_MM, 16 * float(np.spacing(np.abs(points).max())))
    cells = np.floor(points / cell_size + OFF_GRID).astype(np.int64)
    order = np.lexsort((cells[:, 1], cells[:, 0]))
    is_new = mark_run_starts(cells[order])
    node = np.empty(len(points), dtype=np.int64)
    node[order] = np.cumsum(is_new) - 1
    return _Vertices(points, list_owners(counts), node, compute_offsets(counts))


def _meet(vertices: _Vertices, contours: list[Contour], tolerance: float) -> _Vertices:
    """Move each lone end to the nearest vertex of another contour within `tolerance`."""
    is_open = ~tabulate_contours(contours).closed
    starts, points = vertices.first[:-1], vertices.points
    extent = (np.maximum.reduceat(points, starts) - np.minimum.reduceat(points, starts)).max(axis=1)
    movable = np.flatnonzero(is_open & (extent > 4 * tolerance))
    ends = np.concatenate([vertices.first[movable], vertices.first[movable + 1] - 1])
    ends = ends[np.bincount(vertices.node)[vertices.node[ends]] == 1]
    if not len(ends) or tolerance <= 0:
        return vertices
    import shapely  # noqa: PLC0415 (0.1 s, and only drawings with loose ends need it)

    end, other = shapely.STRtree(shapely.points(vertices.points)).query(
        shapely.points(vertices.points[ends]), predicate="dwithin", distance=tolerance
    )
    end = ends[end]
    is_foreign = vertices.owner[end] != vertices.owner[other]
    end, other = end[is_foreign], other[is_foreign]
    distance = np.hypot(*(vertices.points[end] - vertices.points[other]).T)
    node, points = vertices.node.copy(), vertices.points.copy()
    used: set[int] = set()
    for k in np.lexsort((other, end, distance)).tolist():
        a, b = int(end[k]), int(other[k])
        # An end that was moved is not a target, so that a row of close ends does not collapse.
        if a not in used and b not in used:
            node[a], points[a] = node[b], points[b]
            used.add(a)
            if b in ends:
                used.add(b)
    return _Vertices(points, vertices.owner, node, vertices.first)


def _label_networks(vertices: _Vertices, count: int) -> IntArray:
    """(C,) the network of each contour, named by its lowest contour."""
    order = np.argsort(vertices.node, kind="stable")
    together = np.flatnonzero(np.diff(vertices.node[order]) == 0)
    owner = vertices.owner[order]
    label = list(range(count))
    for a, b in zip(owner[together].tolist(), owner[together + 1].tolist(), strict=True):
        low, high = sorted((find_root(label, a), find_root(label, b)))
        label[high] = low
    return np.array([find_root(label, k) for k in range(count)])


def _cut(contours: list[Contour], vertices: _Vertices, chosen: IntArray, label: IntArray) -> Pieces:
    is_shared = np.bincount(vertices.node) > 1
    rows: list[tuple[int, int, int]] = []
    nodes: list[int] = []
    for k in chosen.tolist():
        first, size = int(vertices.first[k]), len(contours[k].points)
        contour_nodes = vertices.node[first : first + size]
        shared = np.flatnonzero(is_shared[contour_nodes]).tolist()
        cuts = [*shared, shared[0] + size] if contours[k].closed else sorted({0, *shared, size - 1})
        for a, b in itertools.pairwise(cuts):
            rows.append((k, a, b))
            nodes += [int(contour_nodes[a]), int(contour_nodes[b % size])]
    used, places = np.unique(nodes, return_inverse=True)
    home = np.zeros((len(used), 2))
    # The first vertex of a node is written last, so it gives the position.
    rows_of_nodes = np.flatnonzero(np.isin(vertices.node, used))[::-1]
    home[np.searchsorted(used, vertices.node[rows_of_nodes])] = vertices.points[rows_of_nodes]
    return Pieces(rows, places.tolist(), home, label[np.array(rows)[:, 0]].tolist())
