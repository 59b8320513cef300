"""Clamps that are drawn: closed outlines on the layers that `cell.fixtures` names.

Clamps are read with the part and are in the same place and unit. Nothing on their layers is
machined. Each clamp is a prism over the area of its outline, from one height to another.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from msgspec.structs import replace

from camgen.geometry.segments import flatten, make_contour_segments
from camgen.model.errors import InputError, JobError
from camgen.model.job import DrawnFixture, Job
from camgen.model.part import Contour, Note, OpenOutline, Part, Solid, drop_ids, list_ids
from camgen.model.pose import FloatArray, frozen
from camgen.model.text import counted, harmless, short, suggest
from camgen.read.units import format_size

#: mm: largest distance of a chord from the arc of an outline that it replaces.
_CHORD_MM = 0.001
_KEY = "cell.fixtures"


def set_clamps_aside(part: Part, job: Job) -> Part:
    """The part with the contours on the layers of clamps moved to `Part.clamps`.

    Raises InputError for an open outline of a clamp, and for a drawing with nothing but clamps.
    """
    layers = job.clamp_layers
    drawn = [contour for contour in part.contours if contour.layer.casefold() in layers]
    if not drawn:
        return part
    if job.page.size:
        raise JobError(
            "job",
            "a drawing that is laid on a page has no clamps",
            _KEY,
            "give boxes, or leave page.size out",
        )
    points = [contour for contour in drawn if contour.is_mark]
    outlines = [contour for contour in drawn if not contour.is_mark]
    ids_of_layer: dict[str, list[str]] = {}
    for contour in outlines:
        if not contour.closed:
            start, end = contour.points[0], contour.points[-1]
            gap = short(float(np.hypot(*(end - start))), 3)
            place = format_size(end.tolist(), 2, " ")
            raise InputError(
                part.source,
                f"the outline of a clamp is open by {gap} mm at {place}",
                f"layer {harmless(contour.layer)}",
                f"close it, or set input.join to more than {gap}",
            )
        ids_of_layer.setdefault(contour.layer, []).append(contour.id)
    ids = frozenset(list_ids(drawn))
    kept = drop_ids(part.contours, ids)
    if not kept:
        raise InputError(part.source, "nothing to machine", "all contours are clamps", _KEY)
    notes = [*part.notes]
    for layer, names in ids_of_layer.items():
        what = f"{counted(len(names), 'contour')} on layer {harmless(layer)}: clamps, not machined"
        notes.append(Note("assumed", what, _KEY, tuple(names)))
    if points:
        notes.append(
            Note(
                "assumed",
                f"not used: {counted(len(points), 'POINT')} on layer {harmless(points[0].layer)}",
                "clamps are closed outlines",
            )
        )
    return replace(
        part,
        contours=kept,
        clamps=(*part.clamps, *outlines),
        notes=tuple(notes),
        open_outlines=tuple(_drop_clamps(part.open_outlines, ids)),
    )


def _drop_clamps(outlines: tuple[OpenOutline, ...], ids: frozenset[str]) -> Iterator[OpenOutline]:
    """The open outlines that enclose other contours than clamps, with these.

    ids: ids of the clamps.
    """
    for outline in outlines:
        inside = tuple(name for name in outline.inside if name not in ids)
        if inside:
            yield replace(outline, inside=inside)


def make_prism(drawn: DrawnFixture, part: Part | None) -> Solid:
    """The clamps of one entry of `cell.fixtures` as one solid, work frame, mm.

    part: part with the clamps of its drawing; None without a drawing.

    Raises JobError without a drawing, for a layer without a closed outline, and for an entry or an
    outline without a size.
    """
    layer = harmless(drawn.layer)
    if part is None:
        raise JobError(
            "job",
            f"the clamps on layer {layer} are drawn, and no drawing is given",
            _KEY,
            "give the drawing, or boxes; camgen verify has --part",
        )
    if drawn.top <= drawn.bottom:
        raise JobError(
            "job",
            f"the clamps on layer {layer} have no height",
            _KEY,
            "give a top above the bottom",
        )
    folded = drawn.layer.casefold()
    contours = [contour for contour in part.clamps if contour.layer.casefold() == folded]
    if not contours:
        near = suggest(layer, sorted({harmless(contour.layer) for contour in part.contours}))
        remedy = f"{near}; camgen inspect lists the layers" if near else "give boxes"
        raise JobError(part.source, f"no closed outline on layer {layer!r}", _KEY, remedy)
    return _extrude(_enclose(contours, part.source), drawn, part)


def _enclose(contours: list[Contour], source: str) -> Any:
    """The area that closed contours enclose together, as polygons."""
    import shapely  # noqa: PLC0415 (only for clamps that are drawn)

    enclosed = []
    for contour in contours:
        points, _ = flatten(make_contour_segments([contour]), _CHORD_MM)
        ring = shapely.linestrings(np.vstack([points, points[:1]]))
        # An outline that crosses itself encloses all its loops.
        loops = shapely.polygonize([shapely.union_all([ring])])
        area = shapely.union_all(shapely.get_parts(loops))
        if area.is_empty:
            place = format_size(contour.points[0].tolist(), 2, " ")
            raise InputError(
                source,
                f"the outline of a clamp at {place} has no area",
                f"layer {harmless(contour.layer)}",
                "draw it as an area",
            )
        enclosed.append(area)
    return shapely.orient_polygons(shapely.union_all(enclosed))


def _extrude(area: Any, drawn: DrawnFixture, part: Part) -> Solid:
    """The prism of an area between two heights.

    area: polygons with their outlines counter-clockwise.
    """
    import shapely  # noqa: PLC0415 (only for clamps that are drawn)

    parts = shapely.get_parts(shapely.constrained_delaunay_triangles(area))
    flat = shapely.get_coordinates(shapely.orient_polygons(parts)).reshape(-1, 4, 2)[:, :3]
    sides = [_lift(flat, drawn.top), _lift(flat[:, ::-1], drawn.bottom)]
    for ring in shapely.get_rings(shapely.get_parts(area)):
        points = shapely.get_coordinates(ring)
        low, high = _lift(points, drawn.bottom), _lift(points, drawn.top)
        sides.append(np.stack([low[:-1], low[1:], high[1:]], axis=1))
        sides.append(np.stack([low[:-1], high[1:], high[:-1]], axis=1))
    triangles = np.concatenate(sides)
    vertices, faces = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    numbers = faces.reshape(-1, 3).astype(np.int64)
    name = harmless(drawn.layer)
    return Solid(name, part.source, "mm", frozen(vertices), numbers, normals, (), (), ())


def _lift(points: FloatArray, height: float) -> FloatArray:
    """(..., 3) the points (..., 2) at a height, mm."""
    return np.concatenate([points, np.full((*points.shape[:-1], 1), height)], axis=-1)
