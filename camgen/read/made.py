"""Parts that are made in code: from points, contours, shapely geometries or a trimesh mesh."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from msgspec.structs import replace

from camgen.geometry.ragged import mark_run_starts
from camgen.model.errors import InputError
from camgen.model.job import Job
from camgen.model.part import Contour, Part
from camgen.model.pose import frozen
from camgen.read.open_outlines import find_open_outlines

_REMEDY = "give points, a shapely geometry or a trimesh"


def make_part(shape: Any, name: str = "part", layer: str = "0") -> Part:
    """The part of a shape that was made in code, mm.

    shape: a chain of points (N, 2), a contour, a shapely geometry, a trimesh mesh, or a list of any
        of these except meshes. A chain that ends with its first point is closed.
    name: name of the part.
    layer: layer of contours that have none.

    Raises InputError for any other shape, and for coordinates that are not finite.
    """
    if hasattr(shape, "vertices") and hasattr(shape, "faces"):
        return _make_solid(shape, name)
    contours: list[Contour] = []
    for contour in _list_contours(shape, name):
        points, bulges = frozen(contour.points), frozen(contour.bulges)
        layered, number = contour.layer or layer, f"c{len(contours) + 1}"
        contours.append(replace(contour, points=points, bulges=bulges, layer=layered, id=number))
    if not contours:
        raise InputError(name, "holds no shape", remedy=_REMEDY)
    outlines = find_open_outlines(contours, Job())
    # No setting closes the gaps of a part that was made in code.
    outlines = tuple(replace(outline, join=0.0) for outline in outlines)
    return Part(name, name, "mm", tuple(contours), (), open_outlines=outlines)


def _list_contours(shape: Any, name: str) -> Iterator[Contour]:
    """The contours of a shape as `make_part` takes it; "" for a layer or color that it has not."""
    if isinstance(shape, Contour):
        yield shape
    elif hasattr(shape, "geom_type"):
        yield from _list_rings(shape, name)
    elif _is_chain(shape):
        yield _make_contour(shape, name)
    elif isinstance(shape, Iterable) and not isinstance(shape, (str, bytes)):
        for member in shape:
            yield from _list_contours(member, name)
    else:
        raise InputError(name, f"a {type(shape).__name__} is not a shape", remedy=_REMEDY)


def _is_chain(shape: Any) -> bool:
    """Whether a shape is one chain of points: rows of two numbers."""
    if isinstance(shape, np.ndarray):
        return shape.ndim == 2 and shape.dtype.kind in "iuf"
    return isinstance(shape, Sequence) and len(shape) > 0 and all(map(_is_point, shape))


def _is_point(row: Any) -> bool:
    has_two = hasattr(row, "__len__") and len(row) == 2
    return has_two and all(isinstance(value, (int, float, np.number)) for value in row)


def _list_rings(shape: Any, name: str) -> Iterator[Contour]:
    if shape.geom_type == "Polygon":
        for ring in (shape.exterior, *shape.interiors):
            yield _make_contour(ring.coords, name)
    elif shape.geom_type in ("LineString", "LinearRing"):
        yield _make_contour(shape.coords, name)
    elif hasattr(shape, "geoms"):
        for member in shape.geoms:
            yield from _list_rings(member, name)
    else:
        raise InputError(
            name, f"a {shape.geom_type} has no contour", remedy="give polygons or lines"
        )


def _make_contour(points: Any, name: str) -> Contour:
    """The contour of a chain of points, without points that repeat their predecessor."""
    rows = np.array(points, dtype=np.float64)[:, :2]
    if not np.isfinite(rows).all():
        raise InputError(name, "a coordinate is not finite", remedy="give numbers, mm")
    rows = rows[mark_run_starts(rows)]
    closed = len(rows) > 3 and bool((rows[0] == rows[-1]).all())
    rows = rows[:-1] if closed else rows
    if len(rows) < 2:
        raise InputError(name, "a contour is a single point", remedy="give at least two points")
    return Contour(rows, np.zeros(len(rows)), closed, "")


def _make_solid(mesh: Any, name: str) -> Part:
    from camgen.read.solid.mesh import make_solid  # noqa: PLC0415 (only for a mesh)
    from camgen.read.solid.soup import MeshSoup  # noqa: PLC0415

    vertices = np.array(mesh.vertices, dtype=np.float64)
    if not np.isfinite(vertices).all():
        raise InputError(name, "a coordinate is not finite", remedy="give numbers, mm")
    faces = np.array(mesh.faces, dtype=np.int64)
    solid = make_solid(MeshSoup(vertices, faces, "mm"), name, name)
    return Part(name, name, solid.units, (), solid.notes, solid=solid)
