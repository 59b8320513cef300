"""What a job should leave on the bench, as polygons: the material inside of contours, or the ink of a pen."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry.segments import flatten, from_contours
from camgen.model.errors import InputError, JobError
from camgen.model.job import Job
from camgen.model.part import Contour, Part
from camgen.model.path import ToolPath
from camgen.model.pose import FloatArray
from camgen.plan import Plan, find_operation, plan
from camgen.plan.page import on_page
from camgen.plan.steps import find_boundary, find_enclosed

#: Arcs as chords that leave them by so much, mm; and of a round pen as a share of its radius.
_CHORD, _PEN_CHORDS = 0.002, 32
#: What a pen or a brush leaves: these operations.
_INKED = ("trace", "fill")
#: The tool runs beside the borders of the material: these operations.
_BESIDE = ("follow", "chamfer")


class Expected(Struct, frozen=True, eq=False):
    """source: the drawing. region: polygons, mm. rings: the closed lines around it or through it, (N, 2) each, that
    places are told along, with their names. inked: it is ink along paths, else the material inside of contours.
    """

    source: str
    region: shapely.Geometry
    rings: tuple[FloatArray, ...]
    names: tuple[str, ...]
    inked: bool


def expect(drawing: Part, job: Job) -> Expected:
    """What ``job`` makes of ``drawing``. InputError where nothing of it has an inside or it is not flat."""
    if drawing.solid is not None or not drawing.contours:
        remedy = "give a drawing, or a picture that is drawn"
        raise InputError(
            drawing.source, "has no flat contours to compare a photo with", remedy=remedy
        )
    if find_operation(drawing, job).name in _INKED:
        return _ink(plan(drawing, job), job)
    laid = on_page(drawing, job)
    return _material(laid)


def _material(part: Part) -> Expected:
    closed = [contour for contour in part.contours if contour.closed]
    if not closed:
        remedy = "close its outlines, or raise input.join"
        raise InputError(
            part.source, "no closed contour, so that nothing of it has an inside", remedy=remedy
        )
    return _enclosed(part.source, closed)


def _enclosed(source: str, closed: Sequence[Contour]) -> Expected:
    rings = tuple(_line(contour) for contour in closed)
    names = tuple(contour.id for contour in closed)
    return Expected(source, enclose(rings), rings, names, inked=False)


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
    """The contours by which the part of ``drawing`` is found before, or after, ``job`` is run.

    Certain is the outline of the stock, if the job has one on a layer. Else the contours that bound
    material. Else, if all contours are worked on the material, those that no other one encloses.
    Raises InputError if no contour is closed.
    """
    closed = [contour for contour in drawing.contours if contour.closed and not contour.is_mark]
    if job.stock.layer:
        ids = frozenset(contour.id for contour in closed if contour.layer == job.stock.layer)
    elif job.operations:
        ids = find_boundary(drawing, job)
    elif find_operation(drawing, job).name in _BESIDE:
        ids = frozenset(contour.id for contour in closed)
    else:
        ids = frozenset()
    certain = [contour for contour in closed if contour.id in ids]
    if not certain:
        inner = find_enclosed(replace(drawing, contours=tuple(closed)))
        certain = [contour for contour in closed if contour.id not in inner]
    names = {contour.id for contour in certain}
    possible = tuple(contour for contour in closed if contour.id not in names)
    return Sought(
        _material(replace(drawing, contours=tuple(certain))), _enclosed(drawing.source, possible)
    )


def enclose(rings: Sequence[FloatArray]) -> shapely.Geometry:
    """What closed lines (N, 2) enclose, even-odd."""
    shapes = [shapely.make_valid(shapely.Polygon(ring)) for ring in rings if len(ring) >= 3]
    while (
        len(shapes) > 1
    ):  # by halves: neighbours first, so that no step has to do with all of them
        odd = shapes[len(shapes) // 2 * 2 :]
        shapes = [
            shapely.symmetric_difference(a, b)
            for a, b in zip(shapes[::2], shapes[1::2], strict=False)
        ] + odd
    return shapes[0] if shapes else shapely.Polygon()


def _line(contour: Contour) -> FloatArray:
    points, _ = flatten(from_contours([contour]), _CHORD)
    return points


def _ink(made: Plan, job: Job) -> Expected:
    if not made.paths:
        raise JobError(
            "job", "no path is left that would leave ink", remedy="camgen build says why"
        )
    radius = job.tool.radius
    strokes = [shapely.buffer(_stroke(path), radius, quad_segs=_PEN_CHORDS) for path in made.paths]
    region = shapely.union_all(strokes)
    rings = tuple(path.position[:, :2] for path in made.paths)
    return Expected(
        made.part.source, region, rings, tuple(path.id for path in made.paths), inked=True
    )


def _stroke(path: ToolPath) -> shapely.Geometry:
    """The line that the pen draws, arcs as chords."""
    points = [path.position[:1, :2]]
    for start, via, end in zip(
        path.position[:-1, :2], path.via[1:, :2], path.position[1:, :2], strict=True
    ):
        points.append(end[None] if np.isnan(via).any() else _arc(start, via, end))
    line = np.concatenate(points)
    return shapely.LineString(line) if len(line) > 1 else shapely.Point(line[0])


def _arc(start: FloatArray, via: FloatArray, end: FloatArray) -> FloatArray:
    """Points (N, 2) after ``start`` on the circle through three; the end too where they lie in line."""
    a, b = complex(*(via - start)), complex(*(end - start))
    area = (a.conjugate() * b).imag
    if abs(area) < 1e-9 * abs(a) * abs(b) or not abs(a):
        return end[None]
    centre = 1j * (abs(a) ** 2 * b - abs(b) ** 2 * a) / (-2 * area)
    sweep = 2 * float(np.angle((b - a) / a))
    count = max(int(np.ceil(abs(sweep) / 2 / np.arccos(max(1 - _CHORD / abs(centre), 0.5)))), 2)
    points = centre - centre * np.exp(1j * np.linspace(0, sweep, count + 1)[1:])
    return np.asarray(start + np.column_stack([points.real, points.imag]))
