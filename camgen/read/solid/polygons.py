"""Polygons of a mesh: rows of text files as tables, and triangles without new vertices."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from camgen.model.part import BoolArray, IntArray, Note
from camgen.model.pose import FloatArray
from camgen.model.text import counted

#: Number of corners of a triangle.
TRIANGLE = 3
#: Minimum sine of the turn at each corner of a polygon that is cut as a fan.
_MIN_TURN = 1e-6


class Triangles(Struct, frozen=True, eq=False):
    """The triangles of polygons.

    faces: (F, 3) numbers of vertices.
    notes: notes on polygons that were left out.
    """

    faces: IntArray
    notes: tuple[Note, ...] = ()


def read_table(rows: list[str], width: int) -> FloatArray:
    """(N, width) the first numbers of each row. Raises ValueError for a row with fewer numbers."""
    if not rows:
        return np.zeros((0, width))
    return np.loadtxt(rows, usecols=range(width), ndmin=2)


def read_equal_rows(rows: list[str]) -> IntArray | None:
    """(N, M) the whole numbers of the rows, None unless all rows have as many as the first."""
    try:
        return np.loadtxt(rows, dtype=np.int64, ndmin=2)
    except ValueError:
        return None


def triangulate_polygons(vertices: FloatArray, polygons: Sequence[IntArray]) -> Triangles:
    """Cut polygons into triangles: convex ones as fans, others by constrained triangulation.

    vertices: (V, 3).
    polygons: tables (P, N) of the numbers of the vertices of P polygons with N corners. Polygons
        with fewer than three corners are ignored.

    Raises ValueError for a polygon with a vertex that does not exist.
    """
    for table in polygons:
        if table.size and (table.min() < 0 or table.max() >= len(vertices)):
            raise ValueError("a face names a vertex that is not there")
    pieces: list[IntArray] = [np.zeros((0, 3), dtype=np.int64)]
    crossing = 0
    for table in polygons:
        if table.shape[1] <= TRIANGLE:
            pieces += [table] if table.shape[1] == TRIANGLE else []
            continue
        convex = _are_convex(vertices[table])
        pieces.append(_cut_fans(table[convex]))
        for polygon in table[~convex]:
            faces = _cut(vertices[polygon], polygon)
            if faces is None:
                crossing += 1
            else:
                pieces.append(faces)
    notes: tuple[Note, ...] = ()
    if crossing:
        what = counted(crossing, "face", "faces")
        notes = (Note("skipped", f"{what} left out", "the outline crosses itself"),)
    return Triangles(np.concatenate(pieces), notes)


def _sum_products(points: FloatArray) -> FloatArray:
    """(P, 3) sums of the cross products along polygons (P, N, 3), by Newell."""
    return np.asarray(np.cross(points, np.roll(points, -1, axis=1)).sum(axis=1))


def _are_convex(points: FloatArray) -> BoolArray:
    """(P,) whether polygons (P, N, 3) turn the same way at each corner."""
    points = points - points[:, :1]
    normals = _sum_products(points)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    units = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)
    sides = np.roll(points, -1, axis=1) - points
    after = np.roll(sides, -1, axis=1)
    turns = np.einsum("pnk,pk->pn", np.cross(sides, after), units)
    scale = np.linalg.norm(sides, axis=2) * np.linalg.norm(after, axis=2)
    # A star turns the same way at each corner too, but more than once around.
    angles = np.arctan2(turns, np.einsum("pnk,pnk->pn", sides, after))
    once = np.abs(angles.sum(axis=1) - 2 * np.pi) < 1.0
    return np.asarray((turns > _MIN_TURN * scale).all(axis=1) & once)


def _cut_fans(table: IntArray) -> IntArray:
    """(F, 3) triangles of polygons (P, N) from their first corners."""
    first = np.repeat(table[:, :1], table.shape[1] - 2, axis=1)
    return np.stack([first, table[:, 1:-1], table[:, 2:]], axis=-1).reshape(-1, 3)


def _cut(points: FloatArray, polygon: IntArray) -> IntArray | None:
    """(F, 3) triangles of one polygon, None if its outline crosses itself.

    points: (N, 3) its corners.
    polygon: (N,) their numbers.
    """
    import shapely  # noqa: PLC0415 (only for a mesh with polygons that are not convex)

    flat = _flatten(points)
    if flat is None:
        return np.zeros((0, 3), dtype=np.int64)
    numbers = dict(zip(map(tuple, flat.tolist()), polygon.tolist(), strict=True))
    shape = shapely.Polygon(flat)
    if not shape.is_valid:
        # A hole that a bridge joins to the outline touches itself, and crosses nowhere.
        shape = shapely.make_valid(shape, method="structure", keep_collapsed=False)
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(shape))
    corners = shapely.get_coordinates(triangles).reshape(-1, 4, 2)[:, :3]
    places = map(tuple, corners.reshape(-1, 2).tolist())
    table = np.array([numbers.get(place, -1) for place in places], dtype=np.int64).reshape(-1, 3)
    if (table < 0).any():
        return None
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    clockwise = first[:, 0] * second[:, 1] < first[:, 1] * second[:, 0]
    table[clockwise] = table[clockwise][:, ::-1]
    return table


def _flatten(points: FloatArray) -> FloatArray | None:
    """(N, 2) the corners in their plane, counter-clockwise; None without an area."""
    points = points - points[0]
    normal = _sum_products(points[None])[0]
    length = float(np.linalg.norm(normal))
    if length == 0.0:
        return None
    normal /= length
    across = np.zeros(3)
    across[int(np.abs(normal).argmin())] = 1.0
    first = np.cross(across, normal)
    first /= np.linalg.norm(first)
    return np.asarray(points @ np.column_stack([first, np.cross(normal, first)]))
