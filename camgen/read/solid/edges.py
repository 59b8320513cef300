"""Edges of a mesh: chains of sharp sides as lines, arcs, circles and curves, with face normals."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import pairwise

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry.arcs import Circle, find_circle, fit_circle, measure_spans
from camgen.geometry.vectors import cross, normalize
from camgen.model.part import Edge, EdgeKind, IntArray
from camgen.model.pose import FloatArray, frozen
from camgen.read.solid.sharp import CORNER, SharpSides, SideChains

# Recognition: a chain of short sides is divided into the lines, arcs and circles that were meshed,
# and into curves, which are runs of lines and arcs.

Fits = Callable[[FloatArray, float], bool]

#: Fewest sides of an arc. Fewer lie on a circle by chance.
_FEWEST_ARC_SIDES = 3
#: Factor between the longest and the shortest side of an arc, except its first and last side, which
#: other faces may cut short. The last side of a fillet, the line after it and the first side of the
#: next fillet lie on one circle too, but their lengths differ more.
_EVEN = 1.5
#: rad: largest change of direction between two pieces of a curve.
_SMOOTH = float(np.radians(20.0))
#: Factor between the lengths of two neighbouring sides from which on they are not parts of a curve.
_LONG_SIDE = 2.0
#: Factor between the curvatures of two neighbouring pieces below which they are parts of a curve.
_LIKE_BENDS = 2.0


class EdgePiece(Struct, frozen=True, eq=False):
    """A line or an arc along some sides of a chain.

    low, high: first and last vertex. On a closed chain `high` may go past the last vertex.
    circle: circle of an arc, None for a line.
    """

    low: int
    high: int
    circle: Circle | None

    @property
    def can_curve(self) -> bool:
        """Whether the piece can be a part of a curve: an arc, or one side only."""
        return self.circle is not None or self.high - self.low == 1


class SideRun(Struct, frozen=True):
    """Pieces that are one edge."""

    kind: EdgeKind
    pieces: tuple[EdgePiece, ...]


def recognise(
    points: FloatArray, closed: bool, tolerance: float, tight: float
) -> tuple[int, list[SideRun]]:
    """Divide a chain into runs.

    points: (N, 3) vertices of the chain, mm; a closed one ends with its first vertex again.
    tolerance: largest distance of a vertex from its line or arc, mm.
    tight: a vertex at most this far from the chord of its neighbours, mm, is not a corner of the
        edge: another face ends there.

    Returns the index of the vertex at which the runs start, and the runs. The vertices of the runs
    of a closed chain are counted from that vertex.
    """
    if not closed:
        kept = _select_corners(points, tight)
        return 0, _renumber(_group_curves(points[kept], _divide(points[kept], tolerance)), kept)
    # The first start is a corner, whichever one rounding makes the largest.
    offsets = _measure_offsets(np.concatenate([points[-2:-1], points]))
    start = int(np.argmax(offsets >= offsets.max() / 2))
    points = _rotate(points, start)
    kept = _select_corners(points, tight)
    circle = fit_circle(points[kept[:-1]])
    has_sides = len(kept) > 2 * _FEWEST_ARC_SIDES
    if circle is not None and has_sides and _is_full_circle(circle, points[kept], tolerance):
        return start, [SideRun("circle", (EdgePiece(0, len(points) - 1, circle),))]
    further = int(kept[_find_start(points[kept], _divide(points[kept], tolerance))])
    points = _rotate(points, further)
    kept = _select_corners(points, tight)
    runs = _join_ends(points[kept], _group_curves(points[kept], _divide(points[kept], tolerance)))
    return (start + further) % (len(points) - 1), _renumber(runs, kept)


def _find_start(points: FloatArray, pieces: list[EdgePiece]) -> int:
    """The vertex at which a closed chain should start: an end of its longest piece.

    Vertex 0 is not chosen, because a piece may go through it.
    """
    lengths = [float(np.linalg.norm(points[p.high] - points[p.low])) for p in pieces]
    longest = pieces[int(np.argmax(np.round(lengths, 6)))]
    return (longest.low or longest.high) % (len(points) - 1)


def _rotate(points: FloatArray, start: int) -> FloatArray:
    """The vertices of a closed chain, from vertex `start` to the same vertex."""
    return np.concatenate([points[start:-1], points[: start + 1]])


def _measure_offsets(points: FloatArray) -> FloatArray:
    """(N - 2,) distances of the inner `points` from the chords of their neighbours, mm."""
    chord, arm = points[2:] - points[:-2], points[1:-1] - points[:-2]
    length = np.linalg.norm(chord, axis=1)
    height = np.linalg.norm(cross(chord, arm), axis=1) / np.where(length > 0, length, 1.0)
    return np.asarray(np.where(length > 0, height, np.linalg.norm(arm, axis=1)))


def _select_corners(points: FloatArray, tight: float) -> IntArray:
    """Indices of `points` without those on a straight line between others."""
    straight = [*(_measure_offsets(points) <= tight).tolist(), False]
    kept = [0]
    while kept[-1] < len(points) - 1:
        at = kept[-1]
        kept.append(_find_reach(points, at, 2, _is_line, tight) if straight[at] else at + 1)
    return np.array(kept)


def _renumber(runs: list[SideRun], kept: IntArray) -> list[SideRun]:
    """The runs of `points[kept]` with their vertices counted in all points."""
    numbers = [*kept.tolist(), *(kept[-1] + kept[1:]).tolist()]
    renumbered = []
    for run in runs:
        pieces = (EdgePiece(numbers[p.low], numbers[p.high], p.circle) for p in run.pieces)
        renumbered.append(SideRun(run.kind, tuple(pieces)))
    return renumbered


def _is_full_circle(circle: Circle, points: FloatArray, tolerance: float) -> bool:
    angles = circle.angles(points[:-1])
    return bool(circle.distances(points).max() <= tolerance and (np.diff(angles) > 0).all())


def _divide(points: FloatArray, tolerance: float) -> list[EdgePiece]:
    """Lines and arcs one after the other, each as long as possible; a line if both are as long."""
    pieces: list[EdgePiece] = []
    last = len(points) - 1
    at = 0
    while at < last:
        line = _find_reach(points, at, 2, _is_line, tolerance)
        arc = _find_reach(points, at, _FEWEST_ARC_SIDES, _is_arc, tolerance)
        circle = fit_circle(points[at : arc + 1]) if arc > max(line, at + 1) else None
        end = arc if circle is not None else line
        pieces.append(EdgePiece(at, end, circle))
        at = end
    return pieces


def _find_reach(points: FloatArray, at: int, fewest: int, fits: Fits, tolerance: float) -> int:
    """The last vertex up to which the sides from vertex `at` fit.

    The range is doubled while it fits, then bisected. If not even `fewest` sides fit, it is one.
    """
    last = len(points) - 1
    good, step = at + fewest, fewest
    if good > last or not fits(points[at : good + 1], tolerance):
        return at + 1
    while good + step <= last and fits(points[at : good + step + 1], tolerance):
        good += step
        step *= 2
    while step > 1:
        step = (step + 1) // 2
        if good + step <= last and fits(points[at : good + step + 1], tolerance):
            good += step
    return good


def _is_line(points: FloatArray, tolerance: float) -> bool:
    chord = points[-1] - points[0]
    length = float(np.sqrt(chord @ chord))
    if length == 0.0:
        return False
    offsets = points[1:-1] - points[0]
    along = offsets @ (chord / length)
    squared_distances = (offsets**2).sum(axis=1) - along**2
    return bool((squared_distances <= tolerance**2).all() and (np.diff(along) > 0).all())


def _is_arc(points: FloatArray, tolerance: float) -> bool:
    """Whether all vertices are within `tolerance` of an arc, in order and evenly spaced."""
    last = len(points) - 1
    ends, half = points[last] - points[0], points[last // 2] - points[0]
    # The ends of an arc that is nearly a circle are too close together to define it.
    b, c = (last // 2, last) if ends @ ends > 0.25 * (half @ half) else (last // 3, 2 * last // 3)
    circle = find_circle(points[0], points[b], points[c])
    if circle is None or (circle.distances(points) > tolerance).any():
        return False
    steps = np.diff(circle.angles(points))
    if not ((steps > 0).all() and (steps < CORNER).all()):
        return False
    alike = steps * _EVEN >= steps.max()
    return bool(alike[1:-1].all() and np.count_nonzero(alike) >= _FEWEST_ARC_SIDES)


def _group_curves(points: FloatArray, pieces: list[EdgePiece]) -> list[SideRun]:
    groups = [[pieces[0]]]
    for piece in pieces[1:]:
        if _is_one_curve(points, groups[-1][-1], piece):
            groups[-1].append(piece)
        else:
            groups.append([piece])
    return list(map(_make_run, groups))


def _make_run(pieces: list[EdgePiece]) -> SideRun:
    kind: EdgeKind = "line" if pieces[0].circle is None else "arc"
    return SideRun(kind if len(pieces) == 1 else "curve", tuple(pieces))


def _join_ends(points: FloatArray, runs: list[SideRun]) -> list[SideRun]:
    """The runs of a closed chain, the last one joined to the first one if they are one curve."""
    last, first = runs[-1], runs[0]
    if len(runs) == 1 or not _is_one_curve(points, last.pieces[-1], first.pieces[0]):
        return runs
    around = len(points) - 1
    moved = [EdgePiece(p.low + around, p.high + around, p.circle) for p in first.pieces]
    return [*runs[1:-1], SideRun("curve", (*last.pieces, *moved))]


def _is_one_curve(points: FloatArray, a: EdgePiece, b: EdgePiece) -> bool:
    """Whether `b` continues `a` as a curve does: smoothly, and with a similar curvature.

    Only arcs and single sides can be parts of a curve.
    """
    if not (a.can_curve and b.can_curve):
        return False
    before, after = points[a.high] - points[a.high - 1], points[b.low + 1] - points[b.low]
    lengths = float(np.linalg.norm(before)), float(np.linalg.norm(after))
    turn = float(np.arctan2(np.linalg.norm(cross(before, after)), before @ after))
    if turn > _SMOOTH:
        return False
    circle = a.circle or b.circle
    if circle is None:
        return max(lengths) < _LONG_SIDE * min(lengths)
    if a.circle is not None and b.circle is not None:
        low, high = sorted([a.circle.radius, b.circle.radius])
        joint = points[b.low]
        is_same_side = float((a.circle.center - joint) @ (b.circle.center - joint)) > 0
        return high < _LIKE_BENDS * low and is_same_side
    # The turn is half of what the two sides at the joint sweep. So 2 turn R is the length that they
    # would have on the circle. A line sweeps nothing, a side of the curve about its own length.
    arc_side, single_side = lengths if a.circle is not None else lengths[::-1]
    share = (2 * turn * circle.radius - arc_side) / single_side
    return 1 / _LIKE_BENDS < share < _LIKE_BENDS


# Edges: the runs as spans, with the normals of both faces at the ends and middles of the spans.

#: rad: the normals along an arc belong to one surface of revolution if they keep their angles to
#: radius, tangent and axis within this, which is more than the error of a mesh.
_STEADY = float(np.radians(3.0))
#: The normals along a line belong to a flat face if they change by less from side to side (cosine).
STEADY_COSINE = float(np.cos(np.radians(2.0)))
#: Rounding of single precision, as a fraction of the largest coordinate.
_TIGHT = 2.0**-22
#: mm: positions are compared in steps of this for the order of edges.
_ORDER_STEP_MM = 1e-3


class EdgeSpans(Struct, frozen=True, eq=False):
    """The spans of an edge or of a part of it; fields as in `Edge`."""

    points: FloatArray
    via: FloatArray
    normals: FloatArray
    via_normals: FloatArray


def make_edges(chains: SideChains, vertices: FloatArray, tolerance: float) -> list[Edge]:
    """All edges of the chains, without ids.

    tolerance: largest distance of a vertex from its line or arc, mm.
    """
    size = np.diff(chains.first)
    limits = tolerance, _TIGHT * float(np.abs(vertices).max(initial=0.0))
    edges = _make_lines(chains.sides.take(chains.first[:-1][size == 1]), vertices)
    for k in np.flatnonzero(size > 1).tolist():
        sides = chains.sides.take(np.arange(chains.first[k], chains.first[k + 1]))
        points = vertices[np.append(sides.start, sides.end[-1])]
        start, runs = recognise(points, bool(chains.closed[k]), *limits)
        for run in runs:
            rows = (start + np.arange(run.pieces[0].low, run.pieces[-1].high)) % len(sides)
            edges.append(_make_edge(run, sides.take(rows), vertices))
    return edges


def sort_edges(edges: Iterable[Edge]) -> tuple[Edge, ...]:
    """The edges with ids, from the highest to the lowest, then by y, then by x of their middles."""
    listed = list(edges)
    if not listed:
        return ()
    middle = np.array(list(map(_find_box_middle, listed)))
    ends = np.array([[*e.points[0], e.length] for e in listed])
    keys = np.column_stack([-middle[:, 2], middle[:, 1], middle[:, 0], ends])
    # The offset keeps middles at whole and half steps away from the limits of their steps.
    order = np.lexsort(np.floor(keys / _ORDER_STEP_MM + 0.4637).T[::-1])
    return tuple(replace(listed[k], id=f"e{i}") for i, k in enumerate(order.tolist(), start=1))


def _find_box_middle(edge: Edge) -> FloatArray:
    both = np.concatenate([edge.points[:-1] if edge.closed else edge.points, edge.via])
    return np.asarray(both.min(axis=0) + both.max(axis=0)) / 2


def _make_lines(sides: SharpSides, vertices: FloatArray) -> list[Edge]:
    """The edges of chains of one side, all of which are lines."""
    points = frozen(np.stack([vertices[sides.start], vertices[sides.end]], axis=1))
    via = frozen(points.mean(axis=1, keepdims=True))
    normals = frozen(np.stack([sides.normals] * 2, axis=1))
    via_normals = frozen(sides.normals[:, None])
    length = np.linalg.norm(points[:, 1] - points[:, 0], axis=1).tolist()
    angle, convex = sides.angle.tolist(), sides.convex.tolist()
    return [
        Edge(
            "",
            "line",
            points[k],
            via[k],
            normals[k],
            via_normals[k],
            angle[k],
            convex[k],
            False,
            0.0,
            length[k],
        )
        for k in range(len(length))
    ]


def _make_edge(run: SideRun, sides: SharpSides, vertices: FloatArray) -> Edge:
    corners = vertices[np.append(sides.start, sides.end[-1])]
    weight = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    parts = []
    for piece in run.pieces:
        low, high = piece.low - run.pieces[0].low, piece.high - run.pieces[0].low
        points, normals = corners[low : high + 1], sides.normals[low:high]
        if piece.circle is None:
            parts.append(_span_line(points, normals, weight[low:high]))
        else:
            parts.append(_span_arc(piece.circle, points, normals, weight[low:high]))
    spans = _join_spans(parts)
    circle = run.pieces[0].circle if run.kind in ("arc", "circle") else None
    return Edge(
        "",
        run.kind,
        frozen(spans.points),
        frozen(spans.via),
        frozen(spans.normals),
        frozen(spans.via_normals),
        float(np.average(sides.angle, weights=weight)),
        bool(sides.convex[0]),
        bool((corners[0] == corners[-1]).all()),
        circle.radius if circle else 0.0,
        float(measure_spans(spans.points, spans.via).sum()),
    )


def _span_line(points: FloatArray, normals: FloatArray, weight: FloatArray) -> EdgeSpans:
    """The spans of a line: one, unless the normals change along it.

    points: (N, 3) vertices along the line.
    normals: (N - 1, 2, 3) normals of the faces at its sides.
    weight: (N - 1,) lengths of its sides.
    """
    cosines = np.einsum("ijk,ijk->ij", normals[1:], normals[:-1])
    starts = np.flatnonzero(~np.append(False, (cosines > STEADY_COSINE).all(axis=1)))
    via_normals = normalize(np.add.reduceat(normals * weight[:, None, None], starts))
    ends = points[np.append(starts, len(points) - 1)]
    return EdgeSpans(ends, (ends[1:] + ends[:-1]) / 2, _average_normals(via_normals), via_normals)


def _span_arc(
    circle: Circle, points: FloatArray, normals: FloatArray, weight: FloatArray
) -> EdgeSpans:
    """The spans of an arc: at most half circles, or one per side if the faces do not turn with it.

    Parameters as in `_span_line`.
    """
    # At a vertex on the chord of its neighbours another face ends. Its two sides are one.
    kept = _select_corners(points, _TIGHT * float(np.abs(points).max()))
    points = points[kept]
    normals = normalize(np.add.reduceat(normals * weight[:, None, None], kept[:-1]))
    weight = np.add.reduceat(weight, kept[:-1])
    angles, at, places = divide_arc(circle, points)
    middles = (angles[1:] + angles[:-1]) / 2
    local = np.einsum("smk,sjk->sjm", _compute_frames(circle, middles), normals)
    mean = normalize(np.einsum("s,sjm->jm", weight, local))
    if (np.einsum("sjm,jm->sj", local, mean) < np.cos(_STEADY)).any():
        return EdgeSpans(points, circle.at(middles), _average_normals(normals), normals)
    turned = np.einsum("smk,jm->sjk", _compute_frames(circle, at), mean)
    return EdgeSpans(places[::2], places[1::2], turned[::2], turned[1::2])


def divide_arc(circle: Circle, points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Divide an arc through points (N, 3) into K spans of at most half a circle.

    Returns the angles (N,) of the points from the first one on, rad, then the angles (2 K + 1,) and
    the positions of the ends and middles of the spans, alternately.
    """
    angles = circle.angles(points)
    angles[0], angles[-1] = 0.0, angles[-1] if angles[-1] > 1e-6 else 2 * np.pi
    count = max(1, int(np.ceil(angles[-1] / np.pi - 1e-6)))
    at = np.linspace(0.0, angles[-1], 2 * count + 1)
    places = circle.at(at)
    places[0], places[-1] = points[0], points[-1]  # neighbours share these to the last bit
    return angles, at, places


def _compute_frames(circle: Circle, angles: FloatArray) -> FloatArray:
    """(N, 3, 3) radial, tangential and axial unit vectors (rows) at `angles` (N,) of the circle."""
    radial = circle.radial(angles)
    axial = np.broadcast_to(circle.axis, radial.shape)
    return np.stack([radial, cross(axial, radial), axial], axis=1)


def _average_normals(normals: FloatArray) -> FloatArray:
    """(N + 1, 2, 3) normals at the ends of spans with the normals (N, 2, 3) at their middles."""
    return np.concatenate([normals[:1], normalize(normals[1:] + normals[:-1]), normals[-1:]])


def _join_spans(parts: list[EdgeSpans]) -> EdgeSpans:
    """The spans of all parts. Where two meet, their normals are averaged."""
    if len(parts) == 1:
        return parts[0]
    points = np.concatenate([p.points[:-1] for p in parts] + [parts[-1].points[-1:]])
    normals = [parts[0].normals[:-1]]
    for before, after in pairwise(parts):
        normals += [normalize(before.normals[-1:] + after.normals[:1]), after.normals[1:-1]]
    normals.append(parts[-1].normals[-1:])
    via = np.concatenate([p.via for p in parts])
    via_normals = np.concatenate([p.via_normals for p in parts])
    return EdgeSpans(points, via, np.concatenate(normals), via_normals)
