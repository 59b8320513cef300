"""Jobs with several operations: which contours each one works on, and in what order they run."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry.segments import from_contours
from camgen.model.errors import InputError, JobError
from camgen.model.job import Choice, Job, Step, ToolTable
from camgen.model.part import Contour, Note, Part
from camgen.model.tolerance import SAME_POINT_MM
from camgen.plan.open_outlines import check_outlines
from camgen.plan.unused import drop_inherited
from camgen.read.chosen import takes_layer
from camgen.read.colors import describe, resolve_named
from camgen.read.marks import drills_marks

#: What is done first: holes, pockets, what is drawn on the part and at its edges, and last what cuts it out.
_RANKS = {"drill": 0, "bore": 0, "pocket": 1, "fill": 2, "trace": 2, "chamfer": 3, "follow": 4}
#: The operations whose sides follow from all contours that bound material.
_BESIDE = ("follow", "chamfer")
#: The operations that look for circles themselves.
_HOLES = ("drill", "bore")
#: So many colors are named where there is not the one that is asked for.
_SHOWN = 20
#: A loop is a circle whose points and middles leave one by no more than this share of its radius.
_ROUND = 0.002


def job_of(job: Job, step: Step) -> Job:
    """The job of one operation by itself. ``holes`` has chosen the contours of one that looks for no circles."""
    operation = drop_inherited(step.operation, job.operation)
    if operation.kind not in _HOLES:
        operation = replace(operation, holes=None)
    return replace(
        job, tool=step.tool, operation=operation, process=step.process, tools=[], operations=[]
    )


def name_drills(jobs: Sequence[Job]) -> list[ToolTable]:
    """The tools of operations, each with the kind that its operations show.

    An end mill is the default kind. An end mill that only drills is a drill.
    """
    milling = [job.tool for job in jobs if job.operation.kind != "drill"]
    return [
        replace(job.tool, kind="drill")
        if job.tool.kind == "end mill" and job.tool not in milling
        else job.tool
        for job in jobs
    ]


class Share(Struct, frozen=True, eq=False):
    """What one operation works on. number: its place in ``Job.operations``. part: with the contours that it works on,
    and those that bound material where it runs beside them.
    """

    number: int
    step: Step
    part: Part


def share_out(part: Part, job: Job) -> tuple[list[Share], list[Note]]:
    """What each operation of ``job`` does on the flat ``part``, as they are listed, and notes.

    InputError where an operation has no contour, JobError for a part that is not flat.
    """
    if part.solid is not None or part.curves:
        raise JobError(
            "job", "several operations are for flat parts", "[[operations]]", "use [operation]"
        )
    chosen = _choose_each(part, job)
    boundary = _bound_material(part, job.operations, chosen)
    shares = []
    for number, step in enumerate(job.operations):
        ids = boundary | chosen[number] if step.operation.kind in _BESIDE else chosen[number]
        shown = tuple(c for c in part.contours if c.id in ids)
        shares.append(
            Share(number, step, replace(part, contours=shown, notes=(), worked=chosen[number]))
        )
    return shares, _left(part, chosen)


def find_boundary(part: Part, job: Job) -> frozenset[str]:
    """The ids of the contours that bound material in a job with several operations."""
    return _bound_material(part, job.operations, _choose_each(part, job))


def _choose_each(part: Part, job: Job) -> list[frozenset[str]]:
    """The ids of the contours that each operation of ``job`` works on."""
    return [_choose(part, step, number) for number, step in enumerate(job.operations)]


def name_of(job: Job, number: int) -> str:
    """An operation for messages: its place, counted from 0 as ``--set`` does, what it is, and its tool."""
    step = job.operations[number]
    tool = step.tool.name or (
        f"T{step.tool.number}" if step.tool.number else f"{step.tool.diameter:g} mm"
    )
    return f"operation {number} {step.operation.kind} - {tool}"


def _left(part: Part, chosen: Sequence[frozenset[str]]) -> list[Note]:
    """A note on the contours that no operation works on."""
    used = frozenset[str]().union(*chosen)
    ids = tuple(c.id for c in part.contours if c.id not in used)
    if not ids:
        return []
    named = ", ".join(ids[:8]) + (" ..." if len(ids) > 8 else "")
    what = f"{len(ids)} of {len(part.contours)} contours in no operation: {named}"
    return [Note("assumed", what, "no row of [[operations]] chooses them", ids)]


def _choose(part: Part, step: Step, number: int) -> frozenset[str]:
    """The ids of the contours that an operation works on. InputError for none, and for what the part has not."""
    choice, where = step.choice, f"operations.{number}"
    known = {c.id for c in part.contours}
    strange = [name for name in choice.ids if name not in known]
    if strange:
        remedy = "camgen inspect -v shows their ids"
        raise InputError(part.source, f"there is no contour {strange[0]!r}", f"{where}.ids", remedy)
    colors = _chosen_colors(part, choice, where)
    found = [
        c
        for c in part.contours
        if takes_layer(c.layer, choice.layers) and (not choice.ids or c.id in choice.ids)
    ]
    if not drills_marks(step.operation):
        found = [c for c in found if not c.is_mark]
    found = [c for c in found if not choice.colors or c.color in colors]
    if choice.nesting != "any":
        inner = find_enclosed(part)
        outer = {c.id for c in part.contours if c.closed} - inner
        check_outlines(part, outer, f"choose by layers or ids in place of {where}.nesting")
        found = [c for c in found if (c.id in inner) == (choice.nesting == "inner") and c.closed]
    holes = step.operation.holes
    if holes is not None and step.operation.kind not in _HOLES:
        found = [c for c in found if _measure_circle(c, holes)]
    if not found and part.raster is None:
        what = "chooses no contour of the drawing"
        remedy = "camgen inspect shows layers and colors; see layers, colors, ids, nesting and holes of the row"
        raise InputError(part.source, what, where, remedy)
    return frozenset(c.id for c in found)


def _chosen_colors(part: Part, choice: Choice, where: str) -> frozenset[str]:
    """The colors that are asked for. InputError for one that no contour has."""
    there = {c.color for c in part.contours}
    asked = [resolve_named(name) for name in choice.colors]
    for name, colors in zip(choice.colors, asked, strict=True):
        if there.isdisjoint(colors):
            known = ", ".join(describe(color) for color in sorted(there - {""})[:_SHOWN])
            remedy = (
                f"there are {known}"
                if known
                else "the input has no colors: choose by layers or ids"
            )
            raise InputError(
                part.source, f"no contour has the color {name!r}", f"{where}.colors", remedy
            )
    return frozenset[str]().union(*asked)


def find_enclosed(part: Part) -> frozenset[str]:
    """The ids of the closed contours that lie inside another one."""
    closed = [c for c in part.contours if c.closed]
    if not closed:
        return frozenset()
    from camgen.geometry.nesting import find_nesting  # noqa: PLC0415 (shapely is loaded only by what needs it)

    depth = find_nesting(from_contours(closed), len(closed)).depth
    return frozenset(c.id for c, level in zip(closed, depth.tolist(), strict=True) if level > 0)


def _measure_circle(contour: Contour, diameters: Sequence[float]) -> bool:
    """Whether a contour is a circle with one of the diameters [from, to], mm."""
    if not contour.closed:
        return False
    segments = from_contours([contour])
    centre = segments.centre[0] if segments.is_arc[0] else contour.points.mean(axis=0)
    away = np.linalg.norm(contour.points - centre, axis=1)
    radius = float(away.mean())
    rounded = np.abs(away - radius).max() <= _ROUND * radius and (
        segments.is_arc.all() or len(contour.points) > 15
    )
    least, most = diameters if len(diameters) == 2 else (np.inf, 0.0)
    return bool(rounded) and least - SAME_POINT_MM <= 2 * radius <= most + SAME_POINT_MM


def _bound_material(
    part: Part, steps: Sequence[Step], chosen: Sequence[frozenset[str]]
) -> frozenset[str]:
    """The contours that say where material is: those that operations run beside, and those that none works on. What is
    drilled, cleared or drawn is on the material, not its border.
    """
    beside, others = set[str](), set[str]()
    for step, ids in zip(steps, chosen, strict=True):
        (beside if step.operation.kind in _BESIDE else others).update(ids)
    bounding = [c for c in part.contours if not c.is_mark]
    return frozenset(c.id for c in bounding if c.id in beside or c.id not in others)


def find_enclosed_by(part: Part, ids: frozenset[str]) -> frozenset[str]:
    """The ids of the closed contours of `part` that lie inside one of the contours `ids`."""
    closed = [c for c in part.contours if c.closed]
    if not closed:
        return frozenset()
    from camgen.geometry.nesting import find_nesting  # noqa: PLC0415 (loads shapely)

    parent = find_nesting(from_contours(closed), len(closed)).parent.tolist()
    enclosed = set[str]()
    for k, contour in enumerate(closed):
        above = parent[k]
        while above >= 0 and closed[above].id not in ids:
            above = parent[above]
        if above >= 0:
            enclosed.add(contour.id)
    return frozenset(enclosed)


def arrange(
    steps: Sequence[Step],
    worked: Sequence[frozenset[str]],
    enclosed: Sequence[frozenset[str]] = (),
) -> list[int]:
    """The numbers of the operations in the order in which they run.

    Holes come before pockets before profiles, and profiles after those inside them. The tool stays
    where that allows it. Two operations that work on one contour stay as they are listed.

    worked: the contours of each operation.
    enclosed: the contours inside them, for operations that cut profiles; none for the others.
    """
    first = _find_earlier(steps, worked, enclosed or [frozenset()] * len(steps))
    ranks = _rank(steps, first)
    left = list(range(len(steps)))
    order: list[int] = []
    while left:
        least = min(ranks[k] for k in left)
        free = [k for k in left if ranks[k] == least and not first[k] & set(left)]
        same = [k for k in free if order and steps[k].tool == steps[order[-1]].tool]
        order.append((same or free)[0])
        left.remove(order[-1])
    return order


def _find_earlier(
    steps: Sequence[Step], worked: Sequence[frozenset[str]], enclosed: Sequence[frozenset[str]]
) -> list[set[int]]:
    """The operations that come before each: listed before it for the same contours, or inside it."""
    count = range(len(steps))
    first: list[set[int]] = [set() for _ in steps]
    for k in count:
        for j in count:
            if j < k and worked[j] & worked[k]:
                first[k].add(j)
    for k in count:
        for j in count:
            inside = worked[j] & enclosed[k] and not worked[k] & enclosed[j]
            if inside and not worked[j] & worked[k] and not _comes_before(first, k, j):
                first[k].add(j)
    return first


def _comes_before(first: Sequence[set[int]], early: int, late: int) -> bool:
    """Whether an operation has to come before another one, directly or by way of others."""
    waiting, seen = [late], set[int]()
    while waiting:
        for k in first[waiting.pop()] - seen:
            seen.add(k)
            waiting.append(k)
    return early in seen


def _rank(steps: Sequence[Step], first: Sequence[set[int]]) -> list[int]:
    """When each is done: by its kind, and not before those that come first."""
    ranks = [_RANKS.get(step.operation.kind, _RANKS["follow"]) for step in steps]
    for _ in steps:
        for k, before in enumerate(first):
            ranks[k] = max([ranks[k], *(ranks[j] for j in before)])
    return ranks
