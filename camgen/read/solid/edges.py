"""Runs of sides as edges: spans, and the normals of both faces at their ends and middles."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import pairwise

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry.arcs import Circle, find_circle, fit_circle, measure_spans
from camgen.geometry.vectors import cross, unit
from camgen.model.part import Edge, EdgeKind, IntArray
from camgen.model.pose import FloatArray, frozen
from camgen.read.solid.sharp import CORNER, SharpSides, SideChains

# A chain of short sides as what it was before it was meshed: lines, arcs, circles, and curves of both.

Fits = Callable[[FloatArray, float], bool]

#: Sides in a row that make an arc; fewer fit one by chance.
_LEAST_SIDES = 3
#: Sides of an arc are alike to this factor, but for the first and the last, which other faces may cut short. The last
#: side of one fillet, the line between and the first side of the next lie on one circle too: they are not alike.
_EVEN = 1.5
#: Pieces of a curve turn into each other by less than this (rad).
_SMOOTH = float(np.radians(20.0))
#: A side longer than so many times the one beside it is no part of a curve.
_LONG_SIDE = 2.0
#: Pieces beside each other are parts of a curve if their bends differ by less than this factor.
_LIKE_BENDS = 2.0


class EdgePiece(Struct, frozen=True, eq=False):
    """Vertices low..high of a chain (high may pass its end where it is closed). circle: of an arc, else None."""

    low: int
    high: int
    circle: Circle | None

    @property
    def single(self) -> bool:
        """Whether it is one side only."""
        return self.high - self.low == 1


class SideRun(Struct, frozen=True):
    """Pieces that are one edge."""

    kind: EdgeKind
    pieces: tuple[EdgePiece, ...]


def recognise(
    points: FloatArray, closed: bool, tolerance: float, tight: float
) -> tuple[int, list[SideRun]]:
    """The runs of a chain of ``points`` (N, 3), and the vertex at which they begin.

    closed: the last point is the first again; the runs then count from the vertex named, round and round. tight: mm, a
    vertex that is so near to the chord of its neighbours is none of the part's, but another face's that ends there.
    """
    if not closed:
        kept = _corners(points, tight)
        return 0, _count(_runs(points[kept], _pieces(points[kept], tolerance)), kept)
    aside = _aside(np.concatenate([points[-2:-1], points]))
    begin = int(
        np.argmax(aside >= aside.max() / 2)
    )  # a corner, and the same one whatever rounding does
    points = _from(points, begin)
    kept = _corners(points, tight)
    circle = fit_circle(points[kept[:-1]])
    if (
        circle is not None
        and len(kept) > 2 * _LEAST_SIDES
        and _once_round(circle, points[kept], tolerance)
    ):
        return begin, [SideRun("circle", (EdgePiece(0, len(points) - 1, circle),))]
    further = int(kept[_break(points[kept], _pieces(points[kept], tolerance))])
    points = _from(points, further)
    kept = _corners(points, tight)
    runs = _join_ends(points[kept], _runs(points[kept], _pieces(points[kept], tolerance)))
    return (begin + further) % (len(points) - 1), _count(runs, kept)


def _break(points: FloatArray, pieces: list[EdgePiece]) -> int:
    """Where to begin a closed chain: at an end of its longest piece, which the place it was begun at did not cut."""
    lengths = [float(np.linalg.norm(points[p.high] - points[p.low])) for p in pieces]
    longest = pieces[int(np.argmax(np.round(lengths, 6)))]
    return (longest.low or longest.high) % (len(points) - 1)


def _from(points: FloatArray, begin: int) -> FloatArray:
    """A closed chain begun at another vertex."""
    return np.concatenate([points[begin:-1], points[: begin + 1]])


def _aside(points: FloatArray) -> FloatArray:
    """(N - 2,) how far the inner ``points`` are from the chords of their neighbours."""
    chord, arm = points[2:] - points[:-2], points[1:-1] - points[:-2]
    length = np.linalg.norm(chord, axis=1)
    height = np.linalg.norm(cross(chord, arm), axis=1) / np.where(length > 0, length, 1.0)
    return np.asarray(np.where(length > 0, height, np.linalg.norm(arm, axis=1)))


def _corners(points: FloatArray, tight: float) -> IntArray:
    """Indices of ``points`` without those on the straight way between others."""
    straight = [*(_aside(points) <= tight).tolist(), False] if len(points) > 2 else [False]
    if not any(straight):
        return np.arange(len(points))
    kept = [0]
    while kept[-1] < len(points) - 1:
        at = kept[-1]
        kept.append(_reach(points, at, 2, _is_line, tight) if straight[at] else at + 1)
    return np.array(kept)


def _count(runs: list[SideRun], kept: IntArray) -> list[SideRun]:
    """The runs of ``points[kept]`` counted in all points."""
    around, last = int(kept[-1]), len(kept) - 1

    def place(k: int) -> int:
        return int(kept[k]) if k <= last else around + int(kept[k - last])

    return [
        SideRun(r.kind, tuple(EdgePiece(place(p.low), place(p.high), p.circle) for p in r.pieces))
        for r in runs
    ]


def _once_round(circle: Circle, points: FloatArray, tolerance: float) -> bool:
    angles = circle.angles(points[:-1])
    return bool(np.abs(circle.distances(points)).max() <= tolerance and (np.diff(angles) > 0).all())


def _pieces(points: FloatArray, tolerance: float) -> list[EdgePiece]:
    """Lines and arcs one after the other, each as long as it can be; a line where both are."""
    result: list[EdgePiece] = []
    last = len(points) - 1
    at = 0
    while at < last:
        line = _reach(points, at, 2, _is_line, tolerance)
        arc = _reach(points, at, _LEAST_SIDES, _is_arc, tolerance)
        circle = fit_circle(points[at : arc + 1]) if arc > max(line, at + 1) else None
        end = arc if circle is not None else line
        result.append(EdgePiece(at, end, circle))
        at = end
    return result


def _reach(points: FloatArray, at: int, least: int, fits: Fits, tolerance: float) -> int:
    """The vertex up to which the sides from vertex ``at`` on fit; at + 1 if not even ``least`` of them do."""
    last = len(points) - 1
    good, step = at + least, least
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
    away = points[1:-1] - points[0]
    along = away @ (chord / length)
    aside = (away**2).sum(axis=1) - along**2
    return bool((aside <= tolerance**2).all() and (np.diff(along) > 0).all())


def _is_arc(points: FloatArray, tolerance: float) -> bool:
    """Whether all vertices are within ``tolerance`` of the arc through three of them, evenly spaced."""
    last = len(points) - 1
    ends, half = points[last] - points[0], points[last // 2] - points[0]
    # The ends of an arc that is nearly a circle are too close together to say where it is.
    b, c = (last // 2, last) if ends @ ends > 0.25 * (half @ half) else (last // 3, 2 * last // 3)
    circle = find_circle(points[0], points[b], points[c])
    if circle is None or (np.abs(circle.distances(points)) > tolerance).any():
        return False
    steps = np.diff(circle.angles(points))
    if not ((steps > 0).all() and (steps < CORNER).all()):
        return False
    alike = steps * _EVEN >= steps.max()
    return bool(alike[1:-1].all() and np.count_nonzero(alike) >= _LEAST_SIDES)


def _runs(points: FloatArray, pieces: list[EdgePiece]) -> list[SideRun]:
    """Pieces that are one curve together."""
    groups = [[pieces[0]]]
    for piece in pieces[1:]:
        if _together_pieces(points, groups[-1][-1], piece):
            groups[-1].append(piece)
        else:
            groups.append([piece])
    return [_run(group) for group in groups]


def _run(pieces: list[EdgePiece]) -> SideRun:
    alone: EdgeKind = "line" if pieces[0].circle is None else "arc"
    return SideRun(alone if len(pieces) == 1 else "curve", tuple(pieces))


def _join_ends(points: FloatArray, runs: list[SideRun]) -> list[SideRun]:
    """The runs of a closed chain, the last one with the first one if they are one curve."""
    last, first = runs[-1], runs[0]
    if len(runs) == 1 or not _together_pieces(points, last.pieces[-1], first.pieces[0]):
        return runs
    around = len(points) - 1
    moved = [EdgePiece(p.low + around, p.high + around, p.circle) for p in first.pieces]
    return [*runs[1:-1], SideRun("curve", (*last.pieces, *moved))]


def _together_pieces(points: FloatArray, a: EdgePiece, b: EdgePiece) -> bool:
    """Whether ``b`` goes on from ``a`` as a curve does: smoothly, and with much the same bend."""
    if not all(p.single or p.circle is not None for p in (a, b)):
        return False
    before, after = points[a.high] - points[a.high - 1], points[b.low + 1] - points[b.low]
    lengths = float(np.linalg.norm(before)), float(np.linalg.norm(after))
    turn = float(np.arctan2(np.linalg.norm(cross(before, after)), before @ after))
    if turn > _SMOOTH:
        return False
    if a.circle is None and b.circle is None:
        return max(lengths) < _LONG_SIDE * min(lengths)
    if a.circle is not None and b.circle is not None:
        radii = sorted([a.circle.radius, b.circle.radius])
        at = points[b.low]
        return (
            radii[1] < _LIKE_BENDS * radii[0]
            and float((a.circle.center - at) @ (b.circle.center - at)) > 0
        )
    # Half of what each side sweeps: a line sweeps nothing, a side of the curve what its length asks for.
    circle, bent, side = (
        (a.circle, *lengths) if a.circle is not None else (b.circle, *lengths[::-1])
    )
    assert circle is not None
    share = (2 * turn * circle.radius - bent) / side
    return 1 / _LIKE_BENDS < share < _LIKE_BENDS


#: Along an arc normals that turn with it are one surface of revolution; what the mesh adds is below this (rad).
_STEADY = float(np.radians(3.0))
#: Along a line normals that turn by less than this from side to side (cosine) are those of one flat face.
STEADY_COSINE = float(np.cos(np.radians(2.0)))
#: Rounding of single precision, as a part of the largest coordinate.
_TIGHT = 2.0**-22
#: Places are compared in steps of this (mm) for the order of edges.
_ORDER_STEP_MM = 1e-3


class EdgeSpans(Struct, frozen=True, eq=False):
    """The columns of an edge, or of a part of it."""

    points: FloatArray
    via: FloatArray
    normals: FloatArray
    via_normals: FloatArray


def edges_of(chains: SideChains, vertices: FloatArray, tolerance: float) -> list[Edge]:
    """All edges of ``chains``, arcs recognised within ``tolerance`` (mm), without ids."""
    size = np.diff(chains.first)
    limits = tolerance, _TIGHT * float(np.abs(vertices).max(initial=0.0))
    result = _single(chains.segments.take(chains.first[:-1][size == 1]), vertices)
    for k in np.flatnonzero(size > 1).tolist():
        rows = np.arange(chains.first[k], chains.first[k + 1])
        result += _of_chain(chains.segments.take(rows), vertices, bool(chains.closed[k]), *limits)
    return result


def order(edges: Iterable[Edge]) -> tuple[Edge, ...]:
    """The edges with ids, from the highest to the lowest, then by y, then by x of their middles."""
    listed = list(edges)
    if not listed:
        return ()
    middle = np.array([_middle(e) for e in listed])
    ends = np.array([[*e.points[0], e.length] for e in listed])
    # A middle half-way between two steps must not fall to either side by rounding.
    key = np.floor(
        np.column_stack([-middle[:, 2], middle[:, 1], middle[:, 0], ends]) / _ORDER_STEP_MM + 0.4637
    )
    order = np.lexsort(key.T[::-1])
    return tuple(replace(listed[k], id=f"e{i}") for i, k in enumerate(order.tolist(), start=1))


def _middle(edge: Edge) -> FloatArray:
    both = np.concatenate([edge.points[:-1] if edge.closed else edge.points, edge.via])
    return np.asarray(both.min(axis=0) + both.max(axis=0)) / 2


def _single(sides: SharpSides, vertices: FloatArray) -> list[Edge]:
    """Chains of one side: lines, all at once."""
    points = frozen(np.stack([vertices[sides.start], vertices[sides.end]], axis=1))
    via = frozen(points.mean(axis=1, keepdims=True))
    normals, via_normals = (
        frozen(np.stack([sides.normals] * 2, axis=1)),
        frozen(sides.normals[:, None]),
    )
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


def _of_chain(
    sides: SharpSides, vertices: FloatArray, closed: bool, tolerance: float, tight: float
) -> list[Edge]:
    points = vertices[np.append(sides.start, sides.end[-1])]
    begin, runs = recognise(points, closed, tolerance, tight)
    result = []
    for run in runs:
        rows = (begin + np.arange(run.pieces[0].low, run.pieces[-1].high)) % len(sides)
        own = sides.take(rows)
        corners = vertices[np.append(own.start, own.end[-1])]
        result.append(_edge(run, corners, own))
    return result


def _edge(run: SideRun, corners: FloatArray, sides: SharpSides) -> Edge:
    """One edge: ``corners`` (N, 3) are the vertices along it, ``sides`` the N - 1 sides between them."""
    base = run.pieces[0].low
    weight = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    spans = _together(
        [_spans(p, p.low - base, p.high - base, corners, sides, weight) for p in run.pieces]
    )
    circle = run.pieces[0].circle if run.kind in ("arc", "circle") else None
    return Edge(
        "", run.kind, frozen(spans.points), frozen(spans.via), frozen(spans.normals), frozen(spans.via_normals),
        float(np.average(sides.angle, weights=weight)), bool(sides.convex[0]), bool((corners[0] == corners[-1]).all()),
        circle.radius if circle else 0.0, float(measure_spans(spans.points, spans.via).sum()),
    )  # fmt: skip


def _spans(
    piece: EdgePiece,
    low: int,
    high: int,
    corners: FloatArray,
    sides: SharpSides,
    weight: FloatArray,
) -> EdgeSpans:
    points, normals = corners[low : high + 1], sides.normals[low:high]
    if piece.circle is None:
        return _straight(points, normals, weight[low:high])
    return _round(piece.circle, points, normals, weight[low:high])


def _straight(points: FloatArray, normals: FloatArray, weight: FloatArray) -> EdgeSpans:
    """Spans of a line: one, unless the normals turn along it."""
    steady = np.append(
        False, (np.einsum("ijk,ijk->ij", normals[1:], normals[:-1]) > STEADY_COSINE).all(axis=1)
    )
    kept = np.flatnonzero(~steady)
    via_normals = unit(np.add.reduceat(normals * weight[:, None, None], kept))
    chosen = points[np.append(kept, len(points) - 1)]
    return EdgeSpans(chosen, (chosen[1:] + chosen[:-1]) / 2, _between(via_normals), via_normals)


def _round(
    circle: Circle, points: FloatArray, normals: FloatArray, weight: FloatArray
) -> EdgeSpans:
    """Spans of an arc, at most half circles; side by side where the faces do not turn with it."""
    # A vertex on the chord of its neighbours is another face's, and both its sides are one.
    kept = _corners(points, _TIGHT * float(np.abs(points).max()))
    points = points[kept]
    normals = unit(np.add.reduceat(normals * weight[:, None, None], kept[:-1]))
    weight = np.add.reduceat(weight, kept[:-1])
    angles = circle.angles(points)
    angles[0], angles[-1] = 0.0, angles[-1] if angles[-1] > 1e-6 else 2 * np.pi
    middles = (angles[1:] + angles[:-1]) / 2
    local = np.einsum("smk,sjk->sjm", _frames(circle, middles), normals)
    mean = unit(np.einsum("s,sjm->jm", weight, local))
    if (np.einsum("sjm,jm->sj", local, mean) < np.cos(_STEADY)).any():
        return EdgeSpans(points, circle.at(middles), _between(normals), normals)
    count = max(1, int(np.ceil(angles[-1] / np.pi - 1e-6)))
    at = np.linspace(0.0, angles[-1], 2 * count + 1)
    places, turned = circle.at(at), np.einsum("smk,jm->sjk", _frames(circle, at), mean)
    places[0], places[-1] = points[0], points[-1]  # neighbours share these to the last bit
    return EdgeSpans(places[::2], places[1::2], turned[::2], turned[1::2])


def _frames(circle: Circle, angles: FloatArray) -> FloatArray:
    """(N, 3, 3) rows radial, tangential, axial at ``angles`` of the circle."""
    radial = circle.radial(angles)
    axial = np.broadcast_to(circle.axis, radial.shape)
    return np.stack([radial, cross(axial, radial), axial], axis=1)


def _between(normals: FloatArray) -> FloatArray:
    """(N + 1, 2, 3) at the ends of spans from (N, 2, 3) at their middles."""
    inner = unit(normals[1:] + normals[:-1])
    return np.concatenate([normals[:1], inner, normals[-1:]])


def _together(parts: list[EdgeSpans]) -> EdgeSpans:
    """The spans of all ``parts``; where two meet, the mean of their normals."""
    if len(parts) == 1:
        return parts[0]
    points = np.concatenate([p.points[:-1] for p in parts] + [parts[-1].points[-1:]])
    joints = [unit(a.normals[-1:] + b.normals[:1]) for a, b in pairwise(parts)]
    normals = [part for p, j in zip(parts, joints, strict=False) for part in (p.normals[1:-1], j)]
    normals = [parts[0].normals[:1], *normals, parts[-1].normals[1:]]
    via, via_normals = (
        np.concatenate([getattr(p, name) for p in parts]) for name in ("via", "via_normals")
    )
    return EdgeSpans(points, via, np.concatenate(normals), via_normals)
