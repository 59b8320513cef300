"""Moves a drawing, to a pose or so that a place of it is at x 0, y 0 (`input.origin`)."""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import pairwise

import numpy as np
from msgspec.structs import replace

from camgen.geometry.ragged import compute_offsets
from camgen.model.errors import JobError
from camgen.model.job import Job
from camgen.model.part import (
    Contour,
    ContourColumns,
    Contours,
    Curve,
    Note,
    Part,
    tabulate_contours,
)
from camgen.model.pose import FloatArray, PlanePose, frozen
from camgen.model.text import short
from camgen.read.extent import measure_box

#: Weights of the low and the high side of a box in x and in y.
_CORNERS = {
    "lower-left": (0.0, 0.0),
    "lower-right": (1.0, 0.0),
    "upper-left": (0.0, 1.0),
    "upper-right": (1.0, 1.0),
    "center": (0.5, 0.5),
}


def move_part(part: Part, job: Job) -> Part:
    """The part with the place that `input.origin` names at x 0, y 0, and a note.

    Pictures, 3-D parts and programs are not moved. Raises JobError for a point that is not two
    numbers, and for a drawing that is laid on a page.
    """
    origin = job.input.origin
    if not origin or part.raster is not None or part.solid is not None:
        return part
    if not part.contours and not part.curves:
        return part
    if job.page.size:
        raise JobError(
            "job",
            "has no effect on a page, whose margins place the drawing",
            "input.origin",
            "leave it out",
        )
    x, y = _find_place(part, origin)
    # Without a minus zero.
    moved = (0.0 - x, 0.0 - y)
    placed = place_part(part, PlanePose(0.0, *moved))
    name = f'"{origin}"' if isinstance(origin, str) else str([*origin])
    return replace(
        placed,
        curves=tuple(_move_curve(curve, np.array([x, y, 0.0])) for curve in part.curves),
        notes=(
            *placed.notes,
            Note(
                "assumed",
                f"moved by x {short(moved[0], 6)}, y {short(moved[1], 6)} mm",
                f"input.origin = {name} is x 0, y 0; notes on reading name places of the drawing",
            ),
        ),
        moved=moved,
    )


def place_part(part: Part, work_from_drawing: PlanePose) -> Part:
    """The part with its contours, and the places of its notes, in another work frame."""

    def place(points: Iterable[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
        placed = work_from_drawing.apply(np.array([*points]).reshape(-1, 2))
        return tuple(map(tuple, placed.tolist()))

    return replace(
        part,
        contours=_place_contours(part.contours, work_from_drawing),
        clamps=_place_contours(part.clamps, work_from_drawing),
        notes=tuple(replace(note, places=place(note.places)) for note in part.notes),
        open_outlines=tuple(
            replace(outline, place=place([outline.place])[0]) for outline in part.open_outlines
        ),
    )


def _find_place(part: Part, origin: str | list[float]) -> tuple[float, float]:
    """The place of the drawing that is moved to the origin, mm."""
    if isinstance(origin, list):
        if len(origin) != 2 or not all(map(math.isfinite, origin)):
            raise JobError(
                "job", "is not a point", "input.origin", "give [x, y], a point of the drawing in mm"
            )
        return float(origin[0]), float(origin[1])
    low, high = measure_box(part.contours, part.curves)
    x, y = (low + np.array(_CORNERS[origin]) * (high - low)).tolist()
    return x, y


def _place_contours(
    contours: tuple[Contour, ...], work_from_drawing: PlanePose
) -> tuple[Contour, ...]:
    columns = tabulate_contours(contours)
    points = frozen(work_from_drawing.apply(columns.points))
    bounds = pairwise(compute_offsets(columns.counts).tolist())
    placed = (
        replace(contour, points=points[first:after])
        for contour, (first, after) in zip(contours, bounds, strict=True)
    )
    return Contours.from_columns(
        placed, ContourColumns(points, columns.bulges, columns.counts, columns.closed)
    )


def _move_curve(curve: Curve, place: FloatArray) -> Curve:
    points, middles = frozen(curve.points - place), frozen(curve.middles - place)
    return replace(curve, points=points, middles=middles)
