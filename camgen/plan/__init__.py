"""Plans tool paths: one function per operation makes the paths of a part.

Operations are found through the entry points `camgen.operations`, those of camgen and those of
other packages alike (docs/writing-an-operation.md).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Literal, TypeVar

import msgspec
from msgspec import Struct
from msgspec.structs import replace

from camgen.lang.recorded import Recorded
from camgen.model.cell import Cell
from camgen.model.errors import AmbiguousInput, InputError, JobError
from camgen.model.job import Job, Step
from camgen.model.part import EarlierRun, Note, Part, drop_ids, list_ids
from camgen.model.path import ToolPath
from camgen.model.plugins import OPERATIONS, find, list_entries, load
from camgen.model.sequences import take_rows
from camgen.model.text import counted
from camgen.plan.page import fit_to_page, place_on_page

if TYPE_CHECKING:
    from camgen.collision.cell import CellScene
    from camgen.lang.recorded import ProgramRun
    from camgen.model.part import Contour, Line
    from camgen.motion.setup import EdgeMotion, UnreachableEdge
    from camgen.plan.tool_parts import ToolPart

#: Callback of a stage: it receives a line for the user about its start and its progress.
Watch = Callable[[str], None]
Kind = Literal["drawing", "picture", "solid", "program", "curves"]
Options = TypeVar("Options")


#: End of the name of a stage in which Ctrl-C ends the search, not the whole run.
MAY_END = "takes the best so far"


def ignore_stages(_: str) -> None:
    """A `Watch` that reports nothing. A search then stops only together with the whole run."""


#: Operations that plan in the pixels of a picture, not on its contours.
_WHOLE_PICTURE = ("fill", "drill")
#: Covered fraction of the copper below which the summary warns.
_ENOUGH = 0.98


class Coverage(Struct, frozen=True):
    """Areas of a filled part, mm2.

    copper: area to be covered.
    covered: part of the copper that has ink.
    outside: ink of passes outside the copper.
    thin: ink outside the copper along centre lines of tracks thinner than the tool.
    """

    copper: float
    covered: float
    outside: float
    thin: float

    @property
    def enough(self) -> bool:
        """True if the bare area is so small that the user need not check it."""
        return self.covered >= _ENOUGH * self.copper

    def percent(self, area: float) -> float:
        """`area` in mm2 as a percentage of the copper, 0 if there is no copper."""
        return 100 * area / self.copper if self.copper else 0.0

    def __str__(self) -> str:
        bare = self.copper - self.covered
        parts = [
            f"{self.percent(self.covered):.2f} % of {self.copper:.1f} mm2 covered",
            f"{bare:.2f} mm2 not; ink outside {self.percent(self.outside):.2f} %"
            f" ({self.outside:.2f} mm2)",
            f"beside thin tracks {self.percent(self.thin):.2f} % ({self.thin:.2f} mm2)",
        ]
        return ", ".join(parts)


class Plan(Struct, frozen=True, eq=False):
    """The result of an operation.

    part: the part on its page, thinned out to the points that it needs.
    paths: tool paths in the order of the contours.
    notes: messages of the reader and of the planner.
    coverage: areas of a filled part, None for other operations.
    left_out: paths and stretches of paths that a fixture blocks.
    """

    part: Part
    paths: tuple[ToolPath, ...]
    notes: tuple[Note, ...]
    coverage: Coverage | None = None
    left_out: tuple[ToolPath, ...] = ()

    def __repr__(self) -> str:
        name, paths = type(self).__name__, counted(len(self.paths), "path")
        return f"{name}({self.part.name!r}, {paths}, {counted(len(self.notes), 'note')})"


class EdgePlan(Plan, frozen=True, eq=False, kw_only=True):
    """Motions along edges, or along curves in space, with a tool path for each.

    edges: all requested edges, mm.
    motions: motions along the edges that the arm reaches, or along pieces of them.
    unreached: edges without a motion.
    where: the scene of the arm.
    original_paths: the paths of the motions.
    noun: name of an edge in messages.
    barred: pairs of paths between which the tool must leave the part.
    """

    edges: tuple[Line, ...]
    motions: tuple[EdgeMotion, ...]
    unreached: tuple[UnreachableEdge, ...]
    where: CellScene
    original_paths: tuple[ToolPath, ...]
    noun: str = "edge"
    barred: frozenset[frozenset[str]] = frozenset()


class ReplayPlan(Plan, frozen=True, eq=False, kw_only=True):
    """The motions of a program that was read, in its order.

    run: the run of the program.
    travel: total length of its rapid motions, mm.
    original_paths: the paths as they were planned.
    parts: one part of a G-code program for each tool, in the order of the paths; empty otherwise.
    """

    run: ProgramRun
    travel: float
    original_paths: tuple[ToolPath, ...]
    parts: tuple[ToolPart, ...] = ()


class JobPlan(Plan, frozen=True, eq=False, kw_only=True):
    """Several operations, in the order in which they run.

    steps: the operations.
    numbers: index of each operation in `Job.operations`.
    plans: plan of each operation; their paths, joined, are `paths`.
    """

    steps: tuple[Step, ...]
    numbers: tuple[int, ...]
    plans: tuple[Plan, ...]


class Operation(Struct, frozen=True):
    """An operation of an entry point.

    name: name of the entry point and value of `operation.kind`.
    about: one line for the user.
    takes: kinds of parts that it accepts.
    plan: makes a plan from a part, its job, the cell and a `Watch`. Raises InputError or JobError.
    """

    name: str
    about: str
    takes: tuple[Kind, ...]
    plan: Callable[[Part, Job, Cell | None, Watch], Plan]


def plan(part: Part, job: Job, cell: Cell | None = None, watch: Watch = ignore_stages) -> Plan:
    """Plan the tool paths of `part` as `job` states.

    cell: the cell in which the program will run, required for the edges of a solid.
    Raises JobError for settings that exclude each other, and InputError if the part has nothing
    that the operation can work on.
    """
    placed = place_on_page(part, job)
    part = fit_to_page(part, placed, _simplify(placed, job), job)
    watch("planning")
    part, stock = _split_stock(part, job)
    if job.operations:
        planned: Plan = _plan_steps(part, job, cell, watch)
    else:
        planned = plan_operation(part, job, cell, watch)
    if job.tour.seams or job.tour.order:
        planned = _pin_contours(planned, replace(part, contours=(*part.contours, *stock)), job)
    if not stock:
        return planned
    return replace(planned, part=replace(planned.part, contours=(*planned.part.contours, *stock)))


def _pin_contours(planned: Plan, part: Part, job: Job) -> Plan:
    """Check `tour.order` and apply `tour.seams`, which select single contours of `part`."""
    from camgen.plan.seams import check_order, pin_seams  # noqa: PLC0415 (it loads shapely)

    check_order(part, job)
    if not job.tour.seams:
        return planned
    plans = planned.plans if isinstance(planned, JobPlan) else (planned,)
    paths, notes = pin_seams([step_plan.paths for step_plan in plans], part, job)
    notes = (*planned.notes, *notes)
    if not isinstance(planned, JobPlan):
        return replace(planned, paths=paths[0], notes=notes)
    plans = tuple(
        replace(step_plan, paths=pinned) for step_plan, pinned in zip(plans, paths, strict=True)
    )
    return replace(planned, plans=plans, paths=join_paths(plans), notes=notes)


def _split_stock(part: Part, job: Job) -> tuple[Part, tuple[Contour, ...]]:
    """Split the part into the contours to machine and the outlines of its stock.

    Raises InputError if the layer `stock.layer` has no closed contour.
    """
    layer = job.stock.layer
    if not layer or part.solid is not None or part.curves:
        return part, ()
    stock = tuple(c for c in part.contours if c.layer == layer and c.closed)
    if not stock:
        raise InputError(
            part.source,
            f"no closed contour on layer {layer!r}",
            "stock.layer",
            "camgen inspect shows the layers; or give stock.margin",
        )
    ids = list_ids(stock)
    note = Note(
        "assumed",
        f"{counted(len(stock), 'contour')} on layer {layer}: the stock, not machined",
        "stock.layer",
        ids,
    )
    return replace(part, contours=drop_ids(part.contours, ids), notes=(*part.notes, note)), stock


def _plan_steps(part: Part, job: Job, cell: Cell | None, watch: Watch) -> JobPlan:
    from camgen.plan.steps import (  # noqa: PLC0415 (shapely is loaded only by what needs it)
        find_enclosed,
        make_step_job,
        order_steps,
        split_part,
    )

    step_parts, unused_notes = split_part(part, job)
    notes = [*part.notes, *unused_notes]
    has_rest = any(step.operation.rest for step in job.operations)
    plans = []
    earlier: list[tuple[frozenset[str], list[EarlierRun]]] = []
    for number, step in enumerate(job.operations):
        step_part = step_parts[number]
        worked = step_part.worked or frozenset()
        works_on_all = len(worked) == len(part.contours)
        if step.operation.rest:
            runs = (*part.earlier, *_find_earlier(step_part, earlier))
            step_part = replace(step_part, earlier=runs)
        planned = _plan_step(step_part, make_step_job(job, step), number, works_on_all, cell, watch)
        if has_rest:
            from camgen.plan.rest import list_runs  # noqa: PLC0415 (only for jobs that ask for it)

            earlier.append((worked, [*list_runs(planned.paths, step.tool)]))
        notes += [
            replace(note, what=f"operation {number} ({step.operation.kind}): {note.what}")
            for note in planned.notes
        ]
        paths = tuple(replace(path, id=f"{number}:{path.id}") for path in planned.paths)
        plans.append(replace(planned, paths=paths))
    numbers = list(range(len(plans)))
    if job.tour.method != "as-drawn":
        path_ids, enclosed = [], []
        for step, planned in zip(job.operations, plans, strict=True):
            ids = frozenset[str]().union(*(path.contours for path in planned.paths))
            cuts_profiles = step.operation.kind == "follow" and step.operation.inside_first
            path_ids.append(ids)
            enclosed.append(find_enclosed(part, ids) if cuts_profiles else frozenset[str]())
        numbers = order_steps(job.operations, path_ids, enclosed)
    ordered = tuple(take_rows(plans, numbers))
    return JobPlan(
        part,
        join_paths(ordered),
        tuple(notes),
        steps=tuple(take_rows(job.operations, numbers)),
        numbers=tuple(numbers),
        plans=ordered,
    )


def _find_earlier(
    part: Part, earlier: Sequence[tuple[frozenset[str], list[EarlierRun]]]
) -> Iterator[EarlierRun]:
    """The runs of earlier operations that work on one of the contours of `part`.

    earlier: contours and runs of the operations that are listed before.
    """
    for ids, runs in earlier:
        if part.works_on(tuple(ids)):
            yield from runs


def _plan_step(
    part: Part, job: Job, number: int, works_on_all: bool, cell: Cell | None, watch: Watch
) -> Plan:
    """Plan one of several operations. If it finds nothing to do, it has a note and no paths.

    works_on_all: the operation works on all contours of the part.
    """
    planner: str = job.operation.kind if job.operation.kind in _WHOLE_PICTURE else ""
    if job.operation.planner == "image":
        planner = "the image planner"
    if part.raster is not None and planner and not works_on_all:
        raise JobError(
            "job",
            f"{planner} works on the whole picture, not on single contours",
            f"operations.{number}",
            "remove layers, ids, colors, nesting and holes from the row",
        )
    try:
        return plan_operation(part, job, cell, watch)
    except AmbiguousInput:
        raise
    except InputError as error:
        return Plan(part, (), (Note("skipped", error.what, error.remedy),))


def join_paths(plans: Sequence[Plan]) -> tuple[ToolPath, ...]:
    """The paths of all plans in their order; `ToolPath.parent` counts in the joined list."""
    joined: list[ToolPath] = []
    for planned in plans:
        offset = len(joined)
        for path in planned.paths:
            parent = path.parent + offset if path.parent >= 0 else -1
            joined.append(replace(path, parent=parent))
    return tuple(joined)


def plan_operation(part: Part, job: Job, cell: Cell | None, watch: Watch) -> Plan:
    """Plan the only operation of `job` for a part that lies at its final position."""
    planned = find_operation(part, job).plan(part, job, cell, watch)
    # The notes of the reader are kept even if an operation of another package drops them.
    dropped = tuple(note for note in part.notes if note not in planned.notes)
    return replace(planned, notes=(*dropped, *planned.notes)) if dropped else planned


def find_operation(part: Part, job: Job) -> Operation:
    """The operation that the job names, or the default one for the kind of the part.

    Raises JobError if the operation does not accept parts of this kind.
    """
    kind, name = find_part_kind(part), name_operation(part, job)
    operation = load(find(list_entries(OPERATIONS), name, "operation", "see docs/operations.md"))
    if not isinstance(operation, Operation):
        raise JobError(
            f"operation {name}",
            "is not a camgen.plan.Operation",
            remedy="fix or remove its package",
        )
    if kind not in operation.takes:
        raise _make_kind_error(kind, name, part)
    return operation


def name_operation(part: Part, job: Job) -> str:
    """The name of the operation that the job states, or of the default one for the part."""
    if job.operation.kind != "auto":
        return job.operation.kind
    kind = find_part_kind(part)
    if kind in ("solid", "program"):
        return {"solid": "edges", "program": "replay"}[kind]
    # A part on a page is a drawing to be drawn.
    on_lines = kind == "curves" or (job.page.size and job.operation.planner != "image")
    return "trace" if on_lines else "follow"


def find_part_kind(part: Part) -> Kind:
    """The kind of a part, which decides about the operations that accept it."""
    if isinstance(part, Recorded):
        return "program"
    if part.curves:
        return "curves"
    if part.solid is not None:
        return "solid"
    return "drawing" if part.raster is None else "picture"


def _make_kind_error(kind: Kind, name: str, part: Part) -> JobError:
    remedy = "leave it out"
    if kind == "program":
        what = f"G-code is replayed, it cannot be used to {name}"
        remedy = 'set operation.kind to "replay" or leave it out'
    elif kind == "solid":
        what = f'"{name}" is for flat parts, this is a 3-D part'
        remedy = 'set operation.kind to "edges"'
    elif kind == "curves":
        what = f'"{name}" is for flat parts, these are curves in space'
        remedy = 'set operation.kind to "trace"'
    else:
        is_replay = name == "replay"
        suited = f"G-code, {part.source} is not G-code"
        what = f'"replay" is for {suited}' if is_replay else f'"{name}" is not for a {kind}'
    return JobError("job", what, "operation.kind", remedy)


def read_options(job: Job, settings: type[Options]) -> Options:
    """`operation.options` as the table of an operation, a msgspec Struct.

    Raises JobError for a key or a value that the table does not have.
    """
    try:
        return msgspec.convert(job.operation.options, settings, strict=True)
    except msgspec.ValidationError as error:
        raise JobError(
            "job", str(error), "operation.options", "see the page of the operation"
        ) from error


def _simplify(part: Part, job: Job) -> Part:
    if part.raster is None and not job.tolerance.simplify and not job.input.min_length:
        return part
    from camgen.plan.simplify import simplify  # noqa: PLC0415 (it loads OpenCV)

    return simplify(part, job)
