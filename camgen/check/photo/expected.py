"""Computes the expected result of a job as polygons: material inside contours, or ink of a pen."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry.segments import flatten, make_contour_segments
from camgen.model.errors import InputError, JobError
from camgen.model.job import Job
from camgen.model.part import Contour, Part, list_ids, select_closed
from camgen.model.path import ToolPath
from camgen.model.pose import FloatArray
from camgen.plan import Plan, find_operation, plan
from camgen.plan.page import place_on_page
from camgen.plan.steps import find_boundary, find_enclosed

#: mm: maximum deviation of the chords of arcs.
_CHORD = 0.002
#: Chords of a quarter circle at the end of a stroke.
_PEN_CHORDS = 32
#: Operations that leave ink.
_INKED = ("trace", "fill")
#: Operations in which the tool runs beside the borders of the material.
_BESIDE = ("follow", "chamfer")


class Expected(Struct, frozen=True, eq=False):
    """The expected result of a job.

    source: name of the drawing.
    region: polygons, mm.
    rings: lines around it or through it, (N, 2) mm each. The position of a difference is measured
        along these.
    names: names of the rings.
    inked: whether it is ink along paths, not material inside contours.
    """

    source: str
    region: shapely.Geometry
    rings: tuple[FloatArray, ...]
    names: tuple[str, ...]
    inked: bool


def expect(drawing: Part, job: Job) -> Expected:
    """Compute the expected result of `job` on `drawing`.

    Raises InputError if the drawing is not flat or has no closed contour.
    """
    if drawing.solid is not None or not drawing.contours:
        what, remedy = "has no flat contours to compare a photo with", "give a drawing or a picture"
        raise InputError(drawing.source, what, remedy=remedy)
    if find_operation(drawing, job).name in _INKED:
        return _make_ink(plan(drawing, job), job)
    return _make_material(place_on_page(drawing, job))


def _make_material(part: Part) -> Expected:
    closed = select_closed(part.contours)
    if not closed:
        raise InputError(
            part.source,
            "no closed contour, so nothing has an inside",
            remedy="close its outlines, or raise input.join",
        )
    return _make_enclosed(part.source, closed)


def _make_enclosed(source: str, closed: Sequence[Contour]) -> Expected:
    rings = tuple(flatten(make_contour_segments([contour]), _CHORD)[0] for contour in closed)
    return Expected(source, enclose(rings), rings, list_ids(closed), inked=False)


class Sought(Struct, frozen=True, eq=False):
    """The contours of a drawing by which its part is found in a photo.

    certain: the outline of the part, which the photo has to show.
    possible: contours on the material, such as holes to drill and lines to draw, which the photo
        may show or not.
    """

    certain: Expected
    possible: Expected

    @property
    def region(self) -> shapely.Geometry:
        """The polygons between both kinds of contours, even-odd."""
        return enclose((*self.certain.rings, *self.possible.rings))


def seek(drawing: Part, job: Job) -> Sought:
    """Select the contours by which a part is found before or after `job` is run.

    Certain is the outline of the stock, if the job has one on a layer; otherwise the contours that
    bound material. Without any, these are the contours that no other one encloses.

    Raises InputError if no contour is closed.
    """
    closed = [contour for contour in drawing.contours if contour.closed and not contour.is_mark]
    if job.stock.layer:
        ids = frozenset(contour.id for contour in closed if contour.layer == job.stock.layer)
    elif job.operations:
        ids = find_boundary(drawing, job)
    elif find_operation(drawing, job).name in _BESIDE:
        ids = frozenset(list_ids(closed))
    else:
        ids = frozenset()
    certain = [contour for contour in closed if contour.id in ids]
    if not certain:
        inner = find_enclosed(replace(drawing, contours=tuple(closed)), set(list_ids(closed)))
        certain = [contour for contour in closed if contour.id not in inner]
    names = set(list_ids(certain))
    possible = tuple(contour for contour in closed if contour.id not in names)
    outline = _make_material(replace(drawing, contours=tuple(certain)))
    return Sought(outline, _make_enclosed(drawing.source, possible))


def enclose(rings: Sequence[FloatArray]) -> shapely.Geometry:
    """Compute the polygons that closed lines (N, 2) enclose, even-odd."""
    shapes = [shapely.make_valid(shapely.Polygon(ring)) for ring in rings if len(ring) >= 3]
    # Neighbours are merged first, so that no step handles all of them.
    while len(shapes) > 1:
        odd = shapes[len(shapes) // 2 * 2 :]
        pairs = zip(shapes[::2], shapes[1::2], strict=False)
        shapes = [shapely.symmetric_difference(a, b) for a, b in pairs] + odd
    return shapes[0] if shapes else shapely.Polygon()


def _make_ink(planned: Plan, job: Job) -> Expected:
    if not planned.paths:
        raise JobError(
            "job", "no path is left that would leave ink", remedy="camgen build reports the reasons"
        )
    lines = [_make_stroke(path) for path in planned.paths]
    strokes = shapely.buffer(lines, job.tool.radius, quad_segs=_PEN_CHORDS)
    rings = tuple(path.position[:, :2] for path in planned.paths)
    names = tuple(path.id for path in planned.paths)
    return Expected(planned.part.source, shapely.union_all(strokes), rings, names, inked=True)


def _make_stroke(path: ToolPath) -> shapely.Geometry:
    position = path.position[:, :2]
    points = [position[:1]]
    for start, via, end in zip(position[:-1], path.via[1:, :2], position[1:], strict=True):
        points.append(end[None] if np.isnan(via).any() else _divide_arc(start, via, end))
    line = np.concatenate(points)
    return shapely.LineString(line) if len(line) > 1 else shapely.Point(line[0])


def _divide_arc(start: FloatArray, via: FloatArray, end: FloatArray) -> FloatArray:
    """Return points (N, 2) after `start` on the arc through `via`; only `end` for a line."""
    a, b = complex(*(via - start)), complex(*(end - start))
    area = (a.conjugate() * b).imag
    if abs(area) < 1e-9 * abs(a) * abs(b) or not abs(a):
        return end[None]
    centre = 1j * (abs(a) ** 2 * b - abs(b) ** 2 * a) / (-2 * area)
    sweep = 2 * float(np.angle((b - a) / a))
    count = max(int(np.ceil(abs(sweep) / 2 / np.arccos(max(1 - _CHORD / abs(centre), 0.5)))), 2)
    points = centre - centre * np.exp(1j * np.linspace(0, sweep, count + 1)[1:])
    return np.asarray(start + np.column_stack([points.real, points.imag]))
