"""Edges of exact CAD as spans: lines and circles as they are, all else as arcs through three of its points."""

from __future__ import annotations

import numpy as np

from camgen.pose import FloatArray, frozen
from camgen.solid import Edge, EdgeKind
from camgen.solids.circles import Circle, cross, fitted, span_lengths, through
from camgen.solids.kernel import Beside, Curve

#: Samples that tell a line or a circle that is written as a spline.
_SAMPLES = 33
#: How near a spline must be to a line or a circle to be one, as a part of the tolerance.
_EXACT = 0.1
#: Samples within each half of a span that is compared with its arc.
_WITHIN = 4
#: Divisions at most: a cusp ends in an interval far below any tolerance.
_DEPTH = 20
#: Normals of a line that stay within this (cosine) are those of one flat face.
_FLAT = float(np.cos(np.radians(2.0)))


def edge(curve: Curve, left: Beside, right: Beside, convex: bool, tolerance: float) -> Edge:
    """The edge along ``curve``, without id; ``left`` and ``right`` of growing parameters, seen from outside."""
    at = np.linspace(curve.low, curve.high, _SAMPLES)
    points = curve.points(at)
    kind, circle = _known(curve, points, tolerance)
    if kind == "line":
        ends = _line_parameters(at, left, right)
        places = curve.points(ends)
        middles, via = (ends[1:] + ends[:-1]) / 2, (places[1:] + places[:-1]) / 2
    elif circle is not None:
        ends, middles, places, via = _round(circle, at, points)
    else:
        ends = np.array(_divided(curve, curve.low, curve.high, tolerance, _DEPTH))
        places, middles = curve.points(ends), (ends[1:] + ends[:-1]) / 2
        via = _arc_middles(places, curve.points(middles))
    normals, via_normals = (np.stack([left.normals(t), right.normals(t)], axis=1) for t in (ends, middles))
    closed = bool(np.linalg.norm(places[0] - places[-1]) < 1e-6)
    if closed:
        places[-1] = places[0]
    return Edge(
        "", "circle" if closed and kind == "arc" else kind, frozen(places), frozen(via), frozen(normals),
        frozen(via_normals), _mean_angle(via_normals), convex, closed, circle.radius if circle else 0.0,
        float(span_lengths(places, via).sum()),
    )  # fmt: skip


def _known(curve: Curve, points: FloatArray, tolerance: float) -> tuple[EdgeKind, Circle | None]:
    """Whether the curve is a line or an arc, by its kind or, within a part of ``tolerance``, by its points."""
    if curve.kind == "Line":
        return "line", None
    if curve.kind == "Circle":
        center, axis, radius = curve.circle()
        first = points[0] - center
        return "arc", Circle(center, axis, first / np.linalg.norm(first), radius)
    limit = _EXACT * tolerance
    chord = points[-1] - points[0]
    length = float(np.linalg.norm(chord))
    if length > 0:
        along = (points - points[0]) @ (chord / length)
        aside = np.linalg.norm(points - points[0] - along[:, None] * (chord / length), axis=1)
        if aside.max() <= limit and (np.diff(along) > 0).all():
            return "line", None
    circle = fitted(points[:-1] if length <= limit else points)
    if circle is None or circle.distances(points).max(initial=0.0) > limit:
        return "curve", None
    return ("arc", circle) if (np.diff(circle.angles(points[:-1])) > 0).all() else ("curve", None)


def _line_parameters(at: FloatArray, left: Beside, right: Beside) -> FloatArray:
    """Where a line is divided: at its ends, and on the way if the normals turn."""
    at = at[:: (_SAMPLES - 1) // 4]
    normals = np.stack([left.normals(at), right.normals(at)])
    steady = (np.einsum("ski,sli->skl", normals, normals) > _FLAT).all()
    return at[[0, -1]] if steady else at


def _round(circle: Circle, at: FloatArray, points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Parameters of the ends and the middles of spans of at most half circles, and their places."""
    angles = circle.angles(points)
    angles[0], angles[-1] = 0.0, angles[-1] if angles[-1] > 1e-6 else 2 * np.pi
    count = max(1, int(np.ceil(angles[-1] / np.pi - 1e-6)))
    wanted = np.linspace(0.0, angles[-1], 2 * count + 1)
    parameters, places = np.interp(wanted, angles, at), circle.at(wanted)
    places[0], places[-1] = points[0], points[-1]
    return parameters[::2], parameters[1::2], places[::2], places[1::2]


def _divided(curve: Curve, low: float, high: float, tolerance: float, depth: int) -> list[float]:
    """Parameters from ``low`` to ``high`` between which the curve keeps to the arc through ends and middle."""
    points = curve.points(np.linspace(low, high, 2 * _WITHIN + 1))
    if depth == 0 or _fits(points, tolerance):
        return [low, high]
    middle = (low + high) / 2
    return [
        *_divided(curve, low, middle, tolerance, depth - 1)[:-1],
        *_divided(curve, middle, high, tolerance, depth - 1),
    ]


def _fits(points: FloatArray, tolerance: float) -> bool:
    circle = through(points[0], points[_WITHIN], points[-1])
    if circle is None:
        chord = points[-1] - points[0]
        length = float(np.linalg.norm(chord))
        return length > 0 and bool(
            (np.linalg.norm(cross(points - points[0], chord), axis=1) <= tolerance * length).all()
        )
    angles = circle.angles(points)
    even = bool((np.diff(angles) > 0).all() and angles[-1] < np.pi / 2)
    return even and bool(np.abs(circle.distances(points)).max() <= tolerance)


def _arc_middles(places: FloatArray, middles: FloatArray) -> FloatArray:
    """The middles of the arcs from one of ``places`` (N, 3) to the next through ``middles`` (N - 1, 3)."""
    via = (places[1:] + places[:-1]) / 2
    for k, middle in enumerate(middles):
        circle = through(places[k], middle, places[k + 1])
        if circle is not None:
            via[k] = circle.at(circle.angles(places[k + 1][None]) / 2)[0]
    return via


def _mean_angle(normals: FloatArray) -> float:
    """The angle between the two normals (N, 2, 3), rad, on the average."""
    a, b = normals[:, 0], normals[:, 1]
    return float(np.arctan2(np.linalg.norm(cross(a, b), axis=1), np.einsum("ni,ni->n", a, b)).mean())
