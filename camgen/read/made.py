"""Parts that were made in code: from points, from shapely geometries, from a trimesh."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from msgspec.structs import replace

from camgen.geometry.ragged import starts_run
from camgen.model.errors import InputError
from camgen.model.job import Job
from camgen.model.part import Contour, Part
from camgen.model.pose import FloatArray, frozen
from camgen.read.open_outlines import find_open_outlines


def make_part(shape: Any, name: str = "part", layer: str = "0") -> Part:
    """The part that ``shape`` is, mm: chains of points (N, 2), contours, a shapely geometry, or a trimesh.

    A chain whose last point is its first is closed. shape may be a list of any of these but meshes. layer: of contours
    that have none. InputError for what is no shape, or holds a number that is not finite.
    """
    if hasattr(shape, "vertices") and hasattr(shape, "faces"):
        return _make_solid(shape, name)
    contours = [
        Contour(frozen(points), frozen(bulges), closed, own or layer, f"c{k}", color=color)
        for k, (points, bulges, closed, own, color) in enumerate(_chains(shape, name), 1)
    ]
    if not contours:
        raise InputError(
            name, "holds no shape", remedy="give points, a shapely geometry or a trimesh"
        )
    outlines = find_open_outlines(contours, Job())
    # No setting closes the gaps of a part that was made in code.
    outlines = tuple(replace(outline, join=0.0) for outline in outlines)
    return Part(name, name, "mm", tuple(contours), (), open_outlines=outlines)


_Chain = tuple[FloatArray, FloatArray, bool, str, str]


def _chains(shape: Any, name: str) -> Iterator[_Chain]:
    """Points, bulges, whether closed, the layer and the color of every contour of ``shape``."""
    if isinstance(shape, Contour):
        yield shape.points, shape.bulges, shape.closed, shape.layer, shape.color
    elif hasattr(shape, "geom_type"):
        yield from _shapely(shape, name)
    elif _is_points(shape):
        yield _chain(shape, name)
    elif isinstance(shape, Iterable) and not isinstance(shape, (str, bytes)):
        for one in shape:
            yield from _chains(one, name)
    else:
        what = f"a {type(shape).__name__} is no shape"
        raise InputError(name, what, remedy="give points, a shapely geometry or a trimesh")


def _is_points(shape: Any) -> bool:
    """Whether ``shape`` is one chain: rows of two numbers."""
    if isinstance(shape, np.ndarray):
        return shape.ndim == 2 and shape.dtype.kind in "iuf"
    return isinstance(shape, Sequence) and len(shape) > 0 and all(_is_point(row) for row in shape)


def _is_point(row: Any) -> bool:
    return (
        len(row) == 2 and all(isinstance(v, (int, float, np.number)) for v in row)
        if hasattr(row, "__len__")
        else False
    )


def _shapely(shape: Any, name: str) -> Iterator[_Chain]:
    if shape.geom_type == "Polygon":
        for ring in (shape.exterior, *shape.interiors):
            yield _chain(ring.coords, name)
    elif shape.geom_type in ("LineString", "LinearRing"):
        yield _chain(shape.coords, name)
    elif hasattr(shape, "geoms"):
        for one in shape.geoms:
            yield from _shapely(one, name)
    else:
        raise InputError(
            name, f"a {shape.geom_type} has no contour", remedy="give polygons or lines"
        )


def _chain(points: Any, name: str) -> _Chain:
    rows = np.array(points, dtype=np.float64)[:, :2]
    if not np.isfinite(rows).all():
        raise InputError(name, "a coordinate is not finite", remedy="give numbers, mm")
    rows = rows[starts_run(rows)]
    closed = len(rows) > 3 and bool((rows[0] == rows[-1]).all())
    rows = rows[:-1] if closed else rows
    if len(rows) < 2:
        raise InputError(name, "a contour is a single point", remedy="give at least two points")
    return rows, np.zeros(len(rows)), closed, "", ""


def _make_solid(mesh: Any, name: str) -> Part:
    from camgen.read.solid.mesh import make_solid  # noqa: PLC0415 (only for what needs it)
    from camgen.read.solid.mesh_file import MeshSoup  # noqa: PLC0415

    vertices, faces = (
        np.array(mesh.vertices, dtype=np.float64),
        np.array(mesh.faces, dtype=np.int64),
    )
    if not np.isfinite(vertices).all():
        raise InputError(name, "a coordinate is not finite", remedy="give numbers, mm")
    found = make_solid(MeshSoup(vertices, faces, "mm", 1.0, ()), name, name)
    return Part(name, name, found.units, (), found.notes, solid=found)
