"""Points of a drawing as holes: circles with the diameter of the tool that drills them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import compress

import numpy as np
from msgspec import Struct

from camgen.geometry.ragged import find_run_starts
from camgen.geometry.segments import make_contour_segments
from camgen.model.job import Job, OperationTable
from camgen.model.part import Contour, Note
from camgen.model.pose import FloatArray, frozen
from camgen.model.text import counted, short
from camgen.read.join import find_close_pairs
from camgen.read.layers import is_chosen
from camgen.read.pieces import BoolArray, describe_elements

#: Distance from the centre of a circle, or from another point, up to which a point is dropped, mm.
_SAME_PLACE_MM = 0.05


class Mark(Struct, frozen=True):
    """A point of a drawing.

    x: mm.
    y: mm.
    layer: name of its layer.
    color: its color, "#ff0000".
    """

    x: float
    y: float
    layer: str
    color: str


def find_diameter(mark: Mark, job: Job) -> float:
    """Diameter of the first tool that drills at a mark, mm; 0 without such a tool.

    An operation that chooses holes by their diameters does not drill at marks, which have none.
    """
    for step in job.operations:
        if can_drill_marks(step.operation) and is_chosen(mark.layer, mark.color, step.choice):
            return step.tool.diameter
    if not job.operations and can_drill_marks(job.operation):
        return job.tool.diameter
    return 0.0


def can_drill_marks(operation: OperationTable) -> bool:
    """Whether an operation drills at points of a drawing."""
    return operation.kind == "drill" and operation.holes is None


def add_marks(
    contours: tuple[Contour, ...], marks: Sequence[Mark], job: Job
) -> tuple[tuple[Contour, ...], list[Mark], list[Note]]:
    """The contours with a circle at each mark that is drilled, the other marks, and notes.

    A mark at the centre of a circle is dropped, and so is a second mark at the place of another.
    """
    drilled: list[Mark] = []
    others: list[Mark] = []
    for mark in marks:
        (drilled if find_diameter(mark, job) else others).append(mark)
    if not drilled:
        return contours, others, []
    places = np.array([(mark.x, mark.y) for mark in drilled])
    used = list(compress(drilled, _are_new(places, _list_centres(contours))))
    circles = [
        _make_circle(mark, find_diameter(mark, job), f"c{number}")
        for number, mark in enumerate(used, len(contours) + 1)
    ]
    notes: list[Note] = []
    if used:
        what = describe_elements(["POINT"] * len(used), [mark.layer for mark in used])
        diameters = sorted({find_diameter(mark, job) for mark in used})
        sizes = ", ".join(f"{short(diameter, 3)} mm" for diameter in diameters)
        notes.append(
            Note(
                "assumed",
                f"{what} taken as holes of {sizes}",
                "a point has no diameter: that of the tool which drills it",
            )
        )
    repeated = len(drilled) - len(used)
    if repeated:
        notes.append(
            Note(
                "repaired",
                f"dropped: {counted(repeated, 'POINT', 'POINTs')}",
                "at the centre of a circle, or drawn twice",
            )
        )
    return (*contours, *circles), others, notes


def _list_centres(contours: Sequence[Contour]) -> FloatArray:
    """(N, 2) centres of the closed contours that are arcs with one centre, mm."""
    closed = [contour for contour in contours if contour.closed]
    if not closed:
        return np.zeros((0, 2))
    segments = make_contour_segments(closed)
    first = find_run_starts(segments.owner)
    centre = segments.centre[first]
    offset = np.abs(segments.centre - centre[segments.owner]).max(axis=1)
    offset[~segments.is_arc] = np.inf
    return centre[np.maximum.reduceat(offset, first) <= _SAME_PLACE_MM]


def _are_new(places: FloatArray, known: FloatArray) -> BoolArray:
    """(N,) whether each place is away from all known ones and from the places before it."""
    points = np.concatenate([known, places])
    first, second, _ = find_close_pairs(points, np.zeros(len(points), np.intp), _SAME_PLACE_MM)
    are_new = np.ones(len(points), np.bool_)
    are_new[np.maximum(first, second)] = False
    return are_new[len(known) :]


def _make_circle(mark: Mark, diameter: float, name: str) -> Contour:
    radius = np.array([diameter / 2, 0.0])
    centre = np.array([mark.x, mark.y])
    points = frozen(np.array([centre + radius, centre - radius]))
    return Contour(
        points, frozen(np.ones(2)), True, mark.layer, name, color=mark.color, is_mark=True
    )
