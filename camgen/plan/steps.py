"""Splits a job with several operations: the contours of each, and the order in which they run."""

from __future__ import annotations

from collections.abc import Container, Iterator, Sequence
from itertools import combinations, permutations

import numpy as np
from msgspec.structs import replace

from camgen.geometry.segments import compute_bounds, make_contour_segments
from camgen.model.errors import InputError, JobError
from camgen.model.job import Choice, Job, Step, ToolTable
from camgen.model.part import Contour, Note, Part, drop_ids, keep_ids, list_ids, select_closed
from camgen.model.pose import FloatArray
from camgen.model.sequences import take_rows
from camgen.model.text import name_first
from camgen.model.tolerance import SAME_POINT_MM
from camgen.plan.open_outlines import check_outlines
from camgen.plan.unused import drop_inherited
from camgen.read.colors import format_color, resolve_named
from camgen.read.layers import is_chosen_layer
from camgen.read.marks import can_drill_marks

#: Rank of each kind, lower ranks first: holes, pockets, lines on the part, edges, outlines.
_RANKS = {"drill": 0, "bore": 0, "pocket": 1, "fill": 2, "trace": 2, "chamfer": 3, "follow": 4}
#: Operations that need all contours that bound material, to find the side of the tool.
_ALONG_MATERIAL = ("follow", "chamfer")
#: Operations that search for circles themselves.
_HOLES = ("drill", "bore")
#: Maximum number of colors that a message lists.
_LISTED_COLORS = 20
#: Maximum deviation of a contour from a circle, as a fraction of its radius.
_CIRCLE_DEVIATION = 0.002


def make_step_job(job: Job, step: Step) -> Job:
    """The job of one operation alone.

    `holes` is removed if the operation does not search for circles: it has chosen the contours.
    """
    operation = drop_inherited(step.operation, job.operation)
    if operation.kind not in _HOLES:
        operation = replace(operation, holes=None)
    return replace(
        job, tool=step.tool, operation=operation, process=step.process, tools=[], operations=[]
    )


def make_step_jobs(job: Job) -> list[Job]:
    """The job of each operation alone; `job` itself if it has no list of operations."""
    return [make_step_job(job, step) for step in job.operations] or [job]


def name_drills(jobs: Sequence[Job]) -> list[ToolTable]:
    """The tools of operations. An end mill that only drills gets the kind "drill"."""
    milling = [job.tool for job in jobs if job.operation.kind != "drill"]
    tools = []
    for job in jobs:
        only_drills = job.tool.kind == "end mill" and job.tool not in milling
        tools.append(replace(job.tool, kind="drill") if only_drills else job.tool)
    return tools


def split_part(part: Part, job: Job) -> tuple[list[Part], list[Note]]:
    """The flat `part` with the contours of each operation of `job`, as listed, and notes.

    For `follow` and `chamfer` it has also the contours that bound material. Raises InputError if an
    operation has no contour, and JobError if the part is not flat.
    """
    if part.solid is not None or part.curves:
        raise JobError(
            "job", "several operations are for flat parts", "[[operations]]", "use [operation]"
        )
    chosen = _choose_each(part, job)
    boundary = _find_bounding(part, job.operations, chosen)
    step_parts = []
    for number, step in enumerate(job.operations):
        needs_boundary = step.operation.kind in _ALONG_MATERIAL
        ids = boundary | chosen[number] if needs_boundary else chosen[number]
        contours = keep_ids(part.contours, ids)
        step_parts.append(replace(part, contours=contours, notes=(), worked=chosen[number]))
    return step_parts, list(_note_unused(part, chosen))


def find_boundary(part: Part, job: Job) -> frozenset[str]:
    """The ids of the contours that bound material in a job with several operations."""
    return _find_bounding(part, job.operations, _choose_each(part, job))


def _choose_each(part: Part, job: Job) -> list[frozenset[str]]:
    return [_choose(part, step, number) for number, step in enumerate(job.operations)]


def format_step(job: Job, number: int) -> str:
    """The name of an operation in messages: its index, counted from 0, its kind and its tool."""
    step = job.operations[number]
    number_or_size = f"T{step.tool.number}" if step.tool.number else f"{step.tool.diameter:g} mm"
    return f"operation {number} {step.operation.kind} - {step.tool.name or number_or_size}"


def _note_unused(part: Part, chosen: Sequence[frozenset[str]]) -> Iterator[Note]:
    ids = list_ids(drop_ids(part.contours, frozenset[str]().union(*chosen)))
    if ids:
        yield Note(
            "assumed",
            f"{len(ids)} of {len(part.contours)} contours in no operation: {name_first(ids)}",
            "no row of [[operations]] chooses them",
            ids,
        )


def _choose(part: Part, step: Step, number: int) -> frozenset[str]:
    """The ids of the contours that an operation works on.

    Raises InputError if it has none, or names something that the part does not have.
    """
    choice, where = step.choice, f"operations.{number}"
    known = set(list_ids(part.contours))
    unknown = [name for name in choice.ids if name not in known]
    if unknown:
        raise InputError(
            part.source,
            f"there is no contour {unknown[0]!r}",
            f"{where}.ids",
            "camgen inspect -v shows their ids",
        )
    colors = _choose_colors(part, choice, where)
    chosen = [c for c in part.contours if is_chosen_layer(c.layer, choice.layers)]
    if choice.ids:
        chosen = list(keep_ids(chosen, choice.ids))
    if not can_drill_marks(step.operation):
        chosen = [c for c in chosen if not c.is_mark]
    chosen = [c for c in chosen if not choice.colors or c.color in colors]
    if choice.nesting != "any":
        inner = find_enclosed(part, known)
        outer = inner.symmetric_difference(list_ids(select_closed(part.contours)))
        check_outlines(part, outer, f"choose by layers or ids in place of {where}.nesting")
        chosen = list(keep_ids(chosen, inner if choice.nesting == "inner" else outer))
    holes = step.operation.holes
    if holes is not None and step.operation.kind not in _HOLES:
        chosen = [c for c in chosen if _has_diameter(c, holes)]
    if not chosen and part.raster is None:
        raise InputError(
            part.source,
            "chooses no contour of the drawing",
            where,
            "camgen inspect shows layers and colors; "
            "see layers, colors, ids, nesting and holes of the row",
        )
    return frozenset(list_ids(chosen))


def _choose_colors(part: Part, choice: Choice, where: str) -> frozenset[str]:
    """The colors that a row names. Raises InputError for one that no contour has."""
    part_colors = {c.color for c in part.contours}
    chosen = frozenset[str]()
    for name in choice.colors:
        colors = resolve_named(name)
        if part_colors.isdisjoint(colors):
            listed = sorted(part_colors - {""})[:_LISTED_COLORS]
            names = ", ".join(format_color(color) for color in listed)
            remedy = (
                f"there are {names}"
                if names
                else "the input has no colors: choose by layers or ids"
            )
            raise InputError(
                part.source, f"no contour has the color {name!r}", f"{where}.colors", remedy
            )
        chosen = chosen.union(colors)
    return chosen


def _has_diameter(contour: Contour, diameters: Sequence[float]) -> bool:
    if not contour.closed:
        return False
    segments = make_contour_segments([contour])
    centre = segments.centre[0] if segments.is_arc[0] else contour.points.mean(axis=0)
    distances = np.linalg.norm(contour.points - centre, axis=1)
    radius = float(distances.mean())
    is_round = np.abs(distances - radius).max() <= _CIRCLE_DEVIATION * radius and (
        segments.is_arc.all() or len(contour.points) > 15
    )
    low, high = diameters if len(diameters) == 2 else (np.inf, 0.0)
    return bool(is_round) and low - SAME_POINT_MM <= 2 * radius <= high + SAME_POINT_MM


def _find_bounding(
    part: Part, steps: Sequence[Step], chosen: Sequence[frozenset[str]]
) -> frozenset[str]:
    """The contours that bound material: of `follow`, of `chamfer`, and of no operation.

    Contours that are drilled, cleared or drawn lie on the material.
    """
    along, others = set[str](), set[str]()
    for step, ids in zip(steps, chosen, strict=True):
        (along if step.operation.kind in _ALONG_MATERIAL else others).update(ids)
    return frozenset(contour.id for contour in part.contours if not contour.is_mark) - (
        others - along
    )


def find_enclosed(part: Part, ids: Container[str]) -> frozenset[str]:
    """The ids of the closed contours of `part` that lie inside one of the contours `ids`.

    A contour that reaches out of the box around another one is not inside it.
    """
    closed = select_closed(part.contours)
    if not closed:
        return frozenset()
    from camgen.geometry.apart import merge_boxes  # noqa: PLC0415 (loads shapely)
    from camgen.geometry.nesting import find_nesting  # noqa: PLC0415

    segments = make_contour_segments(closed)
    parent = find_nesting(segments, len(closed)).parent.tolist()
    boxes = merge_boxes(compute_bounds(segments), segments.owner, len(closed))
    enclosed = set[str]()
    for k, contour in enumerate(closed):
        above = parent[k]
        while above >= 0 and (closed[above].id not in ids or _reaches_out(boxes[[k, above]])):
            above = parent[above]
        if above >= 0:
            enclosed.add(contour.id)
    return frozenset(enclosed)


def _reaches_out(boxes: FloatArray) -> bool:
    """Whether the first of two boxes (2, 4) reaches out of the second one."""
    inner, outer = boxes
    return bool((inner[:2] < outer[:2]).any() or (inner[2:] > outer[2:]).any())


def order_steps(
    steps: Sequence[Step],
    worked: Sequence[frozenset[str]],
    enclosed: Sequence[frozenset[str]] = (),
) -> list[int]:
    """The indices of the operations in the order in which they run.

    Holes come before pockets before profiles, and profiles after those inside them. Operations
    with the same tool follow each other if that allows it. Two operations that work on one contour
    keep their order.

    worked: the contours of each operation.
    enclosed: the contours inside them, for operations that cut profiles; none for the others.
    """
    earlier = _find_earlier(steps, worked, enclosed or [frozenset()] * len(steps))
    ranks = _rank(steps, earlier)
    pending = list(range(len(steps)))
    order: list[int] = []
    while pending:
        lowest = min(take_rows(ranks, pending))
        free = [k for k in pending if ranks[k] == lowest and not earlier[k] & set(pending)]
        same = [k for k in free if order and steps[k].tool == steps[order[-1]].tool]
        order.append((same or free)[0])
        pending.remove(order[-1])
    return order


def _find_earlier(
    steps: Sequence[Step], worked: Sequence[frozenset[str]], enclosed: Sequence[frozenset[str]]
) -> list[set[int]]:
    """The operations before each: listed before it for the same contours, or inside it."""
    earlier: list[set[int]] = [set() for _ in steps]
    for j, k in combinations(range(len(steps)), 2):
        if worked[j] & worked[k]:
            earlier[k].add(j)
    for k, j in permutations(range(len(steps)), 2):
        inside = worked[j] & enclosed[k] and not worked[k] & enclosed[j]
        if inside and not worked[j] & worked[k] and not _comes_before(earlier, k, j):
            earlier[k].add(j)
    return earlier


def _comes_before(earlier: Sequence[set[int]], first: int, second: int) -> bool:
    """True if `first` has to come before `second`, directly or because of other operations."""
    waiting, seen = [second], set[int]()
    while waiting:
        for k in earlier[waiting.pop()] - seen:
            seen.add(k)
            waiting.append(k)
    return first in seen


def _rank(steps: Sequence[Step], earlier: Sequence[set[int]]) -> list[int]:
    """The rank of each operation: at least its kind's rank, and the ranks of those before it."""
    ranks = [_RANKS.get(step.operation.kind, _RANKS["follow"]) for step in steps]
    for _ in steps:
        for k, before in enumerate(earlier):
            ranks[k] = max(ranks[k], *take_rows(ranks, before), 0)
    return ranks
