"""Edges that go on smoothly as the same line or circle become one: CAD programs halve circles and cut lines."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
from msgspec.structs import replace

from camgen.pose import FloatArray, frozen
from camgen.solid import Edge
from camgen.solids.circles import cross, through

#: Ends are one place if they agree to this (mm).
_MEET = 1e-4
#: Tangents and normals agree to this (cosine).
_ALIKE = float(np.cos(np.radians(1.0)))


def backwards(edge: Edge) -> Edge:
    """The same edge run the other way: what was on the left is on the right."""
    return replace(
        edge, points=frozen(edge.points[::-1]), via=frozen(edge.via[::-1]),
        normals=frozen(edge.normals[::-1, ::-1]), via_normals=frozen(edge.via_normals[::-1, ::-1]),
    )  # fmt: skip


def directed(edge: Edge) -> Edge:
    """The edge from the end with the smaller x, then y, then z; a closed one sets out towards the smaller."""
    a, b = (edge.via[0], edge.via[-1]) if edge.closed else (edge.points[0], edge.points[-1])
    return edge if np.round(a, 6).tolist() <= np.round(b, 6).tolist() else backwards(edge)


def joined(edges: list[Edge]) -> list[Edge]:
    """The edges with those that go on as one made one."""
    chains: dict[int, Edge] = dict(enumerate(edges))
    at: dict[tuple[int, ...], list[int]] = defaultdict(list)
    for k, edge in chains.items():
        if not edge.closed:
            for point in (edge.points[0], edge.points[-1]):
                at[_place(point)].append(k)
    owner = {k: k for k in chains}
    for place, (first, *rest) in at.items():
        if len(rest) != 1:
            continue
        a, b = _owner(owner, first), _owner(owner, rest[0])
        one = _one(chains[a], chains[b], place)
        if one is not None:
            chains.pop(b, None)
            chains[a], owner[b] = one, a
    return list(chains.values())


def _owner(owner: dict[int, int], k: int) -> int:
    while owner[k] != k:
        k = owner[k]
    return k


def _place(point: FloatArray) -> tuple[int, ...]:
    return tuple(np.round(point / _MEET).astype(np.int64).tolist())


def _one(a: Edge, b: Edge, place: tuple[int, ...]) -> Edge | None:
    """``a`` and ``b`` as one edge over the place where they meet, None if they are two. They may be one: a circle."""
    if a.kind not in ("line", "arc") or a.kind != b.kind or a.convex != b.convex:
        return None
    if a is b:
        return replace(a, kind="circle", closed=True) if a.kind == "arc" and _smooth(a, a) else None
    a = a if _place(a.points[-1]) == place else backwards(a)
    b = b if _place(b.points[0]) == place else backwards(b)
    if abs(a.radius - b.radius) > _MEET or not _smooth(a, b):
        return None
    if a.kind == "arc" and _apart(a, b) > 2 * _MEET:
        return None
    columns = {n: frozen(np.concatenate([getattr(a, n), getattr(b, n)])) for n in ("via", "via_normals")}
    columns |= {n: frozen(np.concatenate([getattr(a, n), getattr(b, n)[1:]])) for n in ("points", "normals")}
    share = a.length / (a.length + b.length)
    angle = share * a.angle + (1 - share) * b.angle
    return replace(a, **columns, angle=angle, length=a.length + b.length)


def _smooth(a: Edge, b: Edge) -> bool:
    """Whether b goes on where a ends with the same tangent and the same two normals."""
    if (np.einsum("si,si->s", a.normals[-1], b.normals[0]) < _ALIKE).any():
        return False
    return (
        float(_tangent(a.points[-1], a.via[-1], a.points[-2]) @ _tangent(b.points[0], b.via[0], b.points[1])) < -_ALIKE
    )


def _tangent(p: FloatArray, via: FloatArray, q: FloatArray) -> FloatArray:
    """(3,) unit, the way in which the span from ``p`` over ``via`` to ``q`` leaves p."""
    circle = through(p, via, q)
    way = q - p if circle is None else cross(circle.axis, circle.first)
    return np.asarray(way / np.linalg.norm(way))


def _apart(a: Edge, b: Edge) -> float:
    """How far the centres of two arcs are apart, mm."""
    first, second = through(a.points[0], a.via[0], a.points[1]), through(b.points[0], b.via[0], b.points[1])
    if first is None or second is None:
        return np.inf
    return float(np.linalg.norm(first.center - second.center))
