"""Networks of lines drawn with few lifts: chains that meet become trails before they are put in order.

The reader has joined the ends that meet in pairs. What is left are places where more lines meet: a chain that ends at a
vertex of another one, loops that touch. Such a network is cut at its nodes and run anew (route inspection: Kwan, 1962;
Edmonds and Johnson, 1973): a trail begins and ends where an odd number of lines meet, so that each connected network
takes half as many trails as it has such nodes, and no fewer are possible. At a node the straightest ways are taken.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.planners.merging_trails import Pieces, trails
from camgen.pose import FloatArray
from camgen.shapes import Contour, Note
from camgen.text import short
from camgen.tours.near import IntArray

__all__ = ["merged"]

#: Vertices in one cell of a grid so wide (mm) are one place, off the numbers that are drawn most.
_SAME, _OFF_GRID = 1e-6, 0.381966


class _Vertices(Struct, frozen=True, eq=False):
    """All vertices: points (V, 2), owner (V,) the contour, node (V,) the place, first (C + 1,) of each contour's."""

    points: FloatArray
    owner: IntArray
    node: IntArray
    first: IntArray


def merged(
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
            result[members[chosen[0]]] = _named(made)
    if not ids:
        return tuple(contours), ()
    why = f"lines that meet within input.join = {short(tolerance, 6)} mm are run with the fewest lifts"
    note = Note("joined", f"networks of lines: {len(ids)} contours run as {after} paths", why, tuple(ids))
    return tuple(one for k in range(len(contours)) for one in result[k]), (note,)


def _named(made: list[Contour]) -> list[Contour]:
    """Each trail has the name of the contour that it begins with; the second one of a name and so on are counted."""
    seen: dict[str, int] = {}
    named = []
    for contour in made:
        seen[contour.id] = count = seen.get(contour.id, 0) + 1
        named.append(contour if count == 1 else replace(contour, id=f"{contour.id}.{count}"))
    return named


def _networks(contours: list[Contour], tolerance: float) -> list[tuple[list[int], list[Contour]]]:
    """The contours of one layer that meet others, by network, and its trails."""
    if len(contours) < 2:
        return []
    vertices = _vertices(contours)
    vertices = _met(vertices, contours, tolerance)
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
    reach = max(_SAME, 16 * float(np.spacing(np.abs(points).max())))
    cells = np.floor(points / reach + _OFF_GRID).astype(np.int64)
    order = np.lexsort((cells[:, 1], cells[:, 0]))
    fresh = np.concatenate([[True], (np.diff(cells[order], axis=0) != 0).any(axis=1)])
    node = np.empty(len(points), dtype=np.int64)
    node[order] = np.cumsum(fresh) - 1
    return _Vertices(
        points, np.repeat(np.arange(len(contours)), counts), node, np.concatenate([[0], np.cumsum(counts)])
    )


def _met(vertices: _Vertices, contours: list[Contour], tolerance: float) -> _Vertices:
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
    end, other = tree.query(shapely.points(vertices.points[ends]), predicate="dwithin", distance=tolerance)
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
