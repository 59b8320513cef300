"""Chooses the contours that divide the plane into cells.

Contours of one operation may cross those of another one. An operation leaves out contours that
cross others of its own part. The others divide the plane, except the walls of pockets, and lines
that are only drawn.
"""

from __future__ import annotations

from collections.abc import Container, Sequence
from itertools import compress
from typing import Any

import numpy as np
import shapely
from msgspec import Struct
from msgspec.structs import replace

from camgen.check.stock.cells import CHORD_MM
from camgen.geometry.nesting import find_nesting, mark_small_crossings
from camgen.geometry.segments import flatten, make_contour_segments
from camgen.model.job import Job
from camgen.model.part import Contour, Part, list_ids, select_closed


class Task(Struct, frozen=True, eq=False):
    """One operation.

    job: its operation, tool and process, and the tolerances.
    part: the planned part with all its contours; `part.worked` are those of the operation.
    bounds: ids of the contours that bound material, which decide between inside and outside; None:
        all of them.
    """

    job: Job
    part: Part
    bounds: frozenset[str] | None = None


def make_task(part: Part, job: Job, operation_part: Part) -> Task:
    """Make the task of one of several operations on `part`.

    operation_part: the part for this operation, with the contours that bound its material.
    """
    bounds = frozenset(list_ids(operation_part.contours))
    return Task(job, replace(part, worked=operation_part.worked), bounds)


class Walls(Struct, frozen=True, eq=False):
    """The contours of a job with T operations.

    worked: (T,) the contours that each operation works on and does not leave out.
    dividing: contours that divide the plane into cells.
    across: walls of pockets that cross those, and their islands.
    """

    worked: Sequence[Sequence[Contour]]
    dividing: Sequence[Contour]
    across: Sequence[Contour]


def choose_walls(contours: Sequence[Contour], tasks: Sequence[Task]) -> Walls:
    """Choose the contours of each task, and those that divide the plane."""
    crossed = _name_crossed(select_closed(contours))
    worked = [_select_followed(contours, task, crossed) for task in tasks]
    loose = _find_loose(contours, tasks, worked, crossed)
    bounding = [contour for contour in contours if contour.id not in loose]
    across = _find_across(bounding, tasks, worked)
    dividing = tuple(contour for contour in bounding if contour.id not in across)
    return Walls(worked, dividing, [contour for contour in bounding if contour.id in across])


def _select_followed(
    contours: Sequence[Contour], task: Task, crossed: Container[str]
) -> list[Contour]:
    """Select the contours that an operation works on and does not leave out.

    An operation beside contours leaves out those that cross others of its part.

    crossed: ids of the contours that cross any others.
    """
    worked = [contour for contour in contours if task.part.works_on(_list_names(contour))]
    if not any(contour.id in crossed for contour in worked):
        return worked
    shown = worked
    if _bounds_material(task):
        shown = [contour for contour in contours if is_within(contour, task)]
    elif get_kind(task) != "pocket":
        return worked
    left_out = _name_crossed(select_closed(shown), islands=_bounds_material(task))
    return [contour for contour in worked if contour.id not in left_out]


def _bounds_material(task: Task) -> bool:
    """Whether the contours of the part of an operation decide between inside and outside."""
    side = task.job.operation.side
    return get_kind(task) == "chamfer" or (
        get_kind(task) == "follow" and side not in ("left", "right")
    )


def is_within(contour: Contour, task: Task) -> bool:
    """Whether a contour belongs to the part of an operation."""
    return task.bounds is None or not task.bounds.isdisjoint(_list_names(contour))


def _list_names(contour: Contour) -> tuple[str, ...]:
    return contour.sources or (contour.id,)


def _find_loose(
    contours: Sequence[Contour],
    tasks: Sequence[Task],
    worked: Sequence[Sequence[Contour]],
    crossed: set[str],
) -> frozenset[str]:
    """Find contours that cross others, but bound material of no operation, such as drawn lines.

    worked: the contours that each operation works on.
    crossed: ids of the contours that cross any others.
    """
    if not crossed or tasks[0].bounds is None:
        return frozenset()
    bounding: set[str] = set()
    for task, followed in zip(tasks, worked, strict=True):
        if _bounds_material(task):
            bounding.update(contour.id for contour in contours if is_within(contour, task))
        elif get_kind(task) in ("pocket", "fill"):
            bounding.update(list_ids(followed))
    return frozenset(crossed - bounding)


def _find_across(
    contours: Sequence[Contour], tasks: Sequence[Task], worked: Sequence[Sequence[Contour]]
) -> frozenset[str]:
    """Find the walls of pockets that cross contours of other operations, and their islands.

    The other contours divide the plane without them. Islands beside which another operation runs
    divide it, too.

    worked: the contours that each operation works on.
    """
    pocketed: set[str] = set()
    others: set[str] = set()
    for task, followed in zip(tasks, worked, strict=True):
        if get_kind(task) == "pocket":
            pocketed.update(list_ids(followed))
        elif _bounds_material(task) or get_kind(task) == "fill":
            others.update(list_ids(followed))
    closed = select_closed(contours)
    walls = [contour for contour in closed if contour.id in pocketed]
    across = _name_crossed(closed) & pocketed if walls else set[str]()
    if not across:
        return frozenset()
    rings = make_polygons(walls)
    is_across = np.array([contour.id in across for contour in walls])
    near = shapely.intersects(rings, shapely.union_all(rings[is_across]))
    return frozenset(list_ids(compress(walls, near))) - others


def make_polygons(closed: Sequence[Contour]) -> Any:
    """Make the polygons (N,) that closed contours enclose."""
    points, owner = flatten(make_contour_segments(closed), CHORD_MM)
    return shapely.make_valid(shapely.polygons(shapely.linearrings(points, indices=owner)))


def _name_crossed(closed: Sequence[Contour], islands: bool = True) -> set[str]:
    """The ids of contours that cross others or themselves.

    islands: whether a corner that reaches out of the contour around it counts.
    """
    if not closed:
        return set()
    segments = make_contour_segments(closed)
    nesting = mark_small_crossings(segments, find_nesting(segments, len(closed)), islands)
    return set(list_ids(compress(closed, nesting.crossed >= 0)))


def get_kind(task: Task) -> str:
    """The kind of an operation; "trace" for one that follows with its centre on the contours."""
    kind, side = task.job.operation.kind, task.job.operation.side
    if kind == "auto":
        kind = "trace" if task.job.page.size else "follow"
    return "trace" if kind == "follow" and side == "on" else kind
