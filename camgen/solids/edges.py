"""Runs of sides as edges: spans, and the normals of both faces at their ends and middles."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.pose import FloatArray, frozen
from camgen.solid import Edge
from camgen.solids.chains import Chains
from camgen.solids.circles import Circle, cross, span_lengths
from camgen.solids.pieces import Piece, Run, recognised
from camgen.solids.sharp import Segments

#: Along an arc normals that turn with it are one surface of revolution; what the mesh adds is below this (rad).
_STEADY = float(np.radians(3.0))
#: Along a line normals that turn by less than this from side to side (cosine) are those of one flat face.
_FLAT = float(np.cos(np.radians(2.0)))
#: Rounding of single precision, as a part of the largest coordinate.
_TIGHT = 2.0**-22
#: Places are compared in steps of this (mm) for the order of edges.
_STEP = 1e-3


class Spans(Struct, frozen=True, eq=False):
    """The columns of an edge, or of a part of it."""

    points: FloatArray
    via: FloatArray
    normals: FloatArray
    via_normals: FloatArray


def edges_of(chains: Chains, vertices: FloatArray, tolerance: float) -> list[Edge]:
    """All edges of ``chains``, arcs recognised within ``tolerance`` (mm), without ids."""
    size = np.diff(chains.first)
    limits = tolerance, _TIGHT * float(np.abs(vertices).max(initial=0.0))
    result = _single(chains.segments.take(chains.first[:-1][size == 1]), vertices)
    for k in np.flatnonzero(size > 1).tolist():
        rows = np.arange(chains.first[k], chains.first[k + 1])
        result += _of_chain(chains.segments.take(rows), vertices, bool(chains.closed[k]), *limits)
    return result


def ordered(edges: Iterable[Edge]) -> tuple[Edge, ...]:
    """The edges with ids, from the highest to the lowest, then by y, then by x of their middles."""
    listed = list(edges)
    if not listed:
        return ()
    middle = np.array([_middle(e) for e in listed])
    ends = np.array([[*e.points[0], e.length] for e in listed])
    # A middle half-way between two steps must not fall to either side by rounding.
    key = np.floor(np.column_stack([-middle[:, 2], middle[:, 1], middle[:, 0], ends]) / _STEP + 0.4637)
    order = np.lexsort(key.T[::-1])
    return tuple(replace(listed[k], id=f"e{i}") for i, k in enumerate(order.tolist(), start=1))


def _middle(edge: Edge) -> FloatArray:
    both = np.concatenate([edge.points[:-1] if edge.closed else edge.points, edge.via])
    return np.asarray(both.min(axis=0) + both.max(axis=0)) / 2


def _single(sides: Segments, vertices: FloatArray) -> list[Edge]:
    """Chains of one side: lines, all at once."""
    points = frozen(np.stack([vertices[sides.start], vertices[sides.end]], axis=1))
    via = frozen(points.mean(axis=1, keepdims=True))
    normals, via_normals = frozen(np.stack([sides.normals] * 2, axis=1)), frozen(sides.normals[:, None])
    length = np.linalg.norm(points[:, 1] - points[:, 0], axis=1).tolist()
    angle, convex = sides.angle.tolist(), sides.convex.tolist()
    return [
        Edge("", "line", points[k], via[k], normals[k], via_normals[k], angle[k], convex[k], False, 0.0, length[k])
        for k in range(len(length))
    ]


def _of_chain(sides: Segments, vertices: FloatArray, closed: bool, tolerance: float, tight: float) -> list[Edge]:
    points = vertices[np.append(sides.start, sides.end[-1])]
    begin, runs = recognised(points, closed, tolerance, tight)
    result = []
    for run in runs:
        rows = (begin + np.arange(run.pieces[0].low, run.pieces[-1].high)) % len(sides)
        own = sides.take(rows)
        corners = vertices[np.append(own.start, own.end[-1])]
        result.append(_edge(run, corners, own))
    return result


def _edge(run: Run, corners: FloatArray, sides: Segments) -> Edge:
    """One edge: ``corners`` (N, 3) are the vertices along it, ``sides`` the N - 1 sides between them."""
    base = run.pieces[0].low
    weight = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    spans = _together([_spans(p, p.low - base, p.high - base, corners, sides, weight) for p in run.pieces])
    circle = run.pieces[0].circle if run.kind in ("arc", "circle") else None
    return Edge(
        "", run.kind, frozen(spans.points), frozen(spans.via), frozen(spans.normals), frozen(spans.via_normals),
        float(np.average(sides.angle, weights=weight)), bool(sides.convex[0]), bool((corners[0] == corners[-1]).all()),
        circle.radius if circle else 0.0, float(span_lengths(spans.points, spans.via).sum()),
    )  # fmt: skip


def _spans(piece: Piece, low: int, high: int, corners: FloatArray, sides: Segments, weight: FloatArray) -> Spans:
    points, normals = corners[low : high + 1], sides.normals[low:high]
    if piece.circle is None:
        return _straight(points, normals, weight[low:high])
    return _round(piece.circle, points, normals, weight[low:high])


def _straight(points: FloatArray, normals: FloatArray, weight: FloatArray) -> Spans:
    """Spans of a line: one, unless the normals turn along it."""
    steady = np.append(False, (np.einsum("ijk,ijk->ij", normals[1:], normals[:-1]) > _FLAT).all(axis=1))
    kept = np.flatnonzero(~steady)
    via_normals = unit(np.add.reduceat(normals * weight[:, None, None], kept))
    chosen = points[np.append(kept, len(points) - 1)]
    return Spans(chosen, (chosen[1:] + chosen[:-1]) / 2, _between(via_normals), via_normals)


def _round(circle: Circle, points: FloatArray, normals: FloatArray, weight: FloatArray) -> Spans:
    """Spans of an arc, at most half circles; side by side where the faces do not turn with it."""
    angles = circle.angles(points)
    angles[0], angles[-1] = 0.0, angles[-1] if angles[-1] > 1e-6 else 2 * np.pi
    middles = (angles[1:] + angles[:-1]) / 2
    local = np.einsum("smk,sjk->sjm", _frames(circle, middles), normals)
    mean = unit(np.einsum("s,sjm->jm", weight, local))
    if (np.einsum("sjm,jm->sj", local, mean) < np.cos(_STEADY)).any():
        return Spans(points, circle.at(middles), _between(normals), normals)
    count = max(1, int(np.ceil(angles[-1] / np.pi - 1e-6)))
    at = np.linspace(0.0, angles[-1], 2 * count + 1)
    places, turned = circle.at(at), np.einsum("smk,jm->sjk", _frames(circle, at), mean)
    places[0], places[-1] = points[0], points[-1]  # neighbours share these to the last bit
    return Spans(places[::2], places[1::2], turned[::2], turned[1::2])


def _frames(circle: Circle, angles: FloatArray) -> FloatArray:
    """(N, 3, 3) rows radial, tangential, axial at ``angles`` of the circle."""
    radial = circle.radial(angles)
    axial = np.broadcast_to(circle.axis, radial.shape)
    return np.stack([radial, cross(axial, radial), axial], axis=1)


def _between(normals: FloatArray) -> FloatArray:
    """(N + 1, 2, 3) at the ends of spans from (N, 2, 3) at their middles."""
    inner = unit(normals[1:] + normals[:-1])
    return np.concatenate([normals[:1], inner, normals[-1:]])


def _together(parts: list[Spans]) -> Spans:
    """The spans of all ``parts``; where two meet, the mean of their normals."""
    if len(parts) == 1:
        return parts[0]
    points = np.concatenate([p.points[:-1] for p in parts] + [parts[-1].points[-1:]])
    joints = [unit(a.normals[-1:] + b.normals[:1]) for a, b in pairwise(parts)]
    normals = [part for p, j in zip(parts, joints, strict=False) for part in (p.normals[1:-1], j)]
    normals = [parts[0].normals[:1], *normals, parts[-1].normals[1:]]
    via, via_normals = (np.concatenate([getattr(p, name) for p in parts]) for name in ("via", "via_normals"))
    return Spans(points, via, np.concatenate(normals), via_normals)


def unit(vectors: FloatArray) -> FloatArray:
    """``vectors`` (..., 3) at length 1."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))
