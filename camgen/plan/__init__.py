"""Planning: from a part to tool paths. One function an operation; which operations there are is an open table.

The entry points ``camgen.operations`` name them, those of camgen and those of other packages alike
(docs/writing-an-operation.md).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Literal, TypeVar

import msgspec
from msgspec import Struct
from msgspec.structs import replace

from camgen.lang.recorded import Recorded
from camgen.model.cell import Cell
from camgen.model.errors import AmbiguousInput, InputError, JobError
from camgen.model.job import Job, Step
from camgen.model.part import EarlierRun, Note, Part
from camgen.model.path import ToolPath
from camgen.model.plugins import OPERATIONS, find, list_entries, load
from camgen.model.text import counted
from camgen.plan.page import in_margin, on_page

if TYPE_CHECKING:
    from camgen.collision.cell import Surroundings
    from camgen.lang.recorded import ProgramRun
    from camgen.model.part import Contour, Line
    from camgen.motion.setup import EdgeMotion, UnreachableEdge
    from camgen.plan.tool_parts import ToolPart

#: What is called when a stage begins or has got somewhere: what the user is told.
Watch = Callable[[str], None]
Kind = Literal["drawing", "picture", "solid", "program", "curves"]
Options = TypeVar("Options")


#: The end of the name of a stage in which Ctrl-C ends a search alone.
MAY_END = "takes the best so far"


def ignore_stages(_: str) -> None:
    """Nobody watches: then nobody can stop a search but with all the rest."""


#: What looks at a picture itself, not at its contours.
_WHOLE_PICTURE = ("fill", "drill")
#: Below this share of covered copper the summary warns.
_ENOUGH = 0.98


class Coverage(Struct, frozen=True):
    """Areas, mm2. copper: what is to be covered. covered: of it, by ink. outside: ink beside it, of passes. thin: ink
    beside it that only centre lines leave, of tracks thinner than the tool.
    """

    copper: float
    covered: float
    outside: float
    thin: float

    @property
    def enough(self) -> bool:
        """Whether so little is bare that nobody need look."""
        return self.covered >= _ENOUGH * self.copper

    def percent(self, area: float) -> float:
        """``area``, mm2, as a share of the copper."""
        return 100 * area / self.copper if self.copper else 0.0

    def __str__(self) -> str:
        left = self.copper - self.covered
        return (
            f"{self.percent(self.covered):.2f} % of {self.copper:.1f} mm2 covered, {left:.2f} mm2 not; ink outside "
            f"{self.percent(self.outside):.2f} % ({self.outside:.2f} mm2), beside thin tracks "
            f"{self.percent(self.thin):.2f} % ({self.thin:.2f} mm2)"
        )


class Plan(Struct, frozen=True, eq=False):
    """What will be done. part: as it is worked on, on its page and with as few points as it needs. paths: in the order
    of its contours. notes: what the reader and the planner left out, mended or want known. coverage: of what is to be
    filled, None for other operations.

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
    """Processing motions along edges, or curves in space, each with a path.

    edges: all edges that were asked for, mm.
    motions: motions along those that the arm reaches, or along pieces of them.
    unreached: edges without a motion.
    where: the surroundings of the arm.
    made: the paths of the motions.
    noun: name of an edge in messages.
    barred: pairs of paths between which the tool must leave the part.
    """

    edges: tuple[Line, ...]
    motions: tuple[EdgeMotion, ...]
    unreached: tuple[UnreachableEdge, ...]
    where: Surroundings
    made: tuple[ToolPath, ...]
    noun: str = "edge"
    barred: frozenset[frozenset[str]] = frozenset()


class ReplayPlan(Plan, frozen=True, eq=False, kw_only=True):
    """The motions of a program that was read, as they stand in it. travel: mm of its rapid motions. made: the paths.
    parts: of G-code, by its tools, whose paths are the paths, one after the other.
    """

    run: ProgramRun
    travel: float
    made: tuple[ToolPath, ...]
    parts: tuple[ToolPart, ...] = ()


class JobPlan(Plan, frozen=True, eq=False, kw_only=True):
    """Several operations, in the order in which they run. numbers: their places in ``Job.operations``. plans: of each,
    whose paths, one after the other, are the paths.
    """

    steps: tuple[Step, ...]
    numbers: tuple[int, ...]
    plans: tuple[Plan, ...]


class Operation(Struct, frozen=True):
    """One operation. name: that of its entry point, and of ``operation.kind``. about: a line for the user. takes: the
    kinds of parts that it is for. plan: from a part, its job, the cell and who watches to what will be done; raises
    InputError or JobError where it cannot.
    """

    name: str
    about: str
    takes: tuple[Kind, ...]
    plan: Callable[[Part, Job, Cell | None, Watch], Plan]


def plan(part: Part, job: Job, cell: Cell | None = None, watch: Watch = ignore_stages) -> Plan:
    """The tool paths of ``part`` as ``job`` asks for them. cell: where the program will run; edges of solids need it.

    Raises JobError for settings that do not go together, InputError for a part that holds nothing for the operation.
    """
    laid = on_page(part, job)
    part = in_margin(part, laid, _simplify(laid, job), job)
    watch("planning")
    part, stock = _without_stock(part, job)
    made = (
        _plan_steps(part, job, cell, watch)
        if job.operations
        else plan_operation(part, job, cell, watch)
    )
    if job.tour.seams or job.tour.order:
        made = _by_contour(made, replace(part, contours=(*part.contours, *stock)), job)
    if not stock:
        return made
    return replace(made, part=replace(made.part, contours=(*made.part.contours, *stock)))


def _by_contour(made: Plan, part: Part, job: Job) -> Plan:
    """A plan with what ``tour.seams`` and ``tour.order`` say of single contours of ``part``."""
    from camgen.plan.seams import insist_on_order, pin_seams  # noqa: PLC0415 (loads shapely, for few jobs)

    insist_on_order(part, job)
    if not job.tour.seams:
        return made
    plans = made.plans if isinstance(made, JobPlan) else (made,)
    paths, notes = pin_seams([one.paths for one in plans], part, job)
    notes = (*made.notes, *notes)
    if not isinstance(made, JobPlan):
        return replace(made, paths=paths[0], notes=notes)
    plans = tuple(replace(one, paths=own) for one, own in zip(plans, paths, strict=True))
    return replace(made, plans=plans, paths=chain_paths(plans), notes=notes)


def _without_stock(part: Part, job: Job) -> tuple[Part, tuple[Contour, ...]]:
    """The part without the outline of its stock, and that. InputError where the layer of the job holds none."""
    layer = job.stock.layer
    if not layer or part.solid is not None or part.curves:
        return part, ()
    stock = tuple(c for c in part.contours if c.layer == layer and c.closed)
    if not stock:
        what = f"no closed contour on layer {layer!r}"
        raise InputError(
            part.source,
            what,
            "stock.layer",
            "camgen inspect shows the layers; or give stock.margin",
        )
    ids = tuple(c.id for c in stock)
    note = Note(
        "assumed",
        f"{counted(len(stock), 'contour')} on layer {layer}: the stock, not machined",
        "stock.layer",
        ids,
    )
    kept = tuple(c for c in part.contours if c.id not in ids)
    return replace(part, contours=kept, notes=(*part.notes, note)), stock


def _plan_steps(part: Part, job: Job, cell: Cell | None, watch: Watch) -> JobPlan:
    """All operations of ``job``, in the order in which they run."""
    from camgen.plan.steps import arrange, find_enclosed_by, job_of, share_out  # noqa: PLC0415 (shapely is loaded only by what needs it)

    shares, left = share_out(part, job)
    notes = [*part.notes, *left]
    has_rest = any(step.operation.rest for step in job.operations)
    plans = []
    earlier: list[tuple[frozenset[str], list[EarlierRun]]] = []
    for share in shares:
        number, kind = share.number, share.step.operation.kind
        whole = share.part.worked is not None and len(share.part.worked) == len(part.contours)
        own_part = share.part
        if share.step.operation.rest:
            own_part = replace(own_part, earlier=_find_earlier(own_part, earlier))
        made = _plan_share(own_part, job_of(job, share.step), number, whole, cell, watch)
        if has_rest:
            from camgen.plan.rest import list_runs  # noqa: PLC0415 (only for jobs that ask for it)

            worked_ids = share.part.worked or frozenset()
            earlier.append((worked_ids, list_runs(made.paths, share.step.tool)))
        notes += [
            replace(note, what=f"operation {number} ({kind}): {note.what}") for note in made.notes
        ]
        own = tuple(replace(path, id=f"{number}:{path.id}") for path in made.paths)
        plans.append(replace(made, paths=own))
    numbers = list(range(len(plans)))
    if job.tour.method != "as-drawn":
        worked = [frozenset(name for path in one.paths for name in path.contours) for one in plans]
        enclosed = []
        for step, ids in zip(job.operations, worked, strict=True):
            cuts_profiles = step.operation.kind == "follow" and step.operation.inside_first
            enclosed.append(find_enclosed_by(part, ids) if cuts_profiles else frozenset[str]())
        numbers = arrange(job.operations, worked, enclosed)
    steps, run = tuple(job.operations[k] for k in numbers), tuple(plans[k] for k in numbers)
    return JobPlan(
        part, chain_paths(run), tuple(notes), steps=steps, numbers=tuple(numbers), plans=run
    )


def _find_earlier(
    part: Part, earlier: Sequence[tuple[frozenset[str], list[EarlierRun]]]
) -> tuple[EarlierRun, ...]:
    """The runs of operations that work on one of the contours of `part` and so come before.

    earlier: contours and runs of the operations that are listed before.
    """
    runs: list[EarlierRun] = []
    for ids, listed in earlier:
        if part.works_on(tuple(ids)):
            runs += listed
    return tuple(runs)


def _plan_share(
    part: Part, job: Job, number: int, whole: bool, cell: Cell | None, watch: Watch
) -> Plan:
    """One of several operations; without paths where its contours hold nothing for it, which costs no other one.

    whole: it works on all contours there are.
    """
    kind = job.operation.kind
    by_pixels = (
        "the image planner"
        if job.operation.planner == "image"
        else kind
        if kind in _WHOLE_PICTURE
        else ""
    )
    if part.raster is not None and by_pixels and not whole:
        what = f"of a picture {by_pixels} takes all, no single contours"
        remedy = "leave out layers, ids, colors, nesting and holes of the row"
        raise JobError("job", what, f"operations.{number}", remedy)
    try:
        return plan_operation(part, job, cell, watch)
    except AmbiguousInput:
        raise
    except InputError as error:
        return Plan(part, (), (Note("skipped", error.what, error.remedy),))


def chain_paths(plans: Sequence[Plan]) -> tuple[ToolPath, ...]:
    """The paths of several plans one after the other."""
    paths: list[ToolPath] = []
    for one in plans:
        before = len(paths)
        paths += [replace(p, parent=p.parent + before) if p.parent >= 0 else p for p in one.paths]
    return tuple(paths)


def plan_operation(part: Part, job: Job, cell: Cell | None, watch: Watch) -> Plan:
    """What the one operation of ``job`` does with ``part``, which lies where it is worked on."""
    made = find_operation(part, job).plan(part, job, cell, watch)
    # What the reader left out is told whatever an operation of another package makes of it.
    untold = tuple(note for note in part.notes if note not in made.notes)
    return replace(made, notes=(*untold, *made.notes)) if untold else made


def find_operation(part: Part, job: Job) -> Operation:
    """The operation that the job names, or the usual one for what the part is. JobError if it is not for such parts."""
    kind, name = kind_of(part), name_operation(part, job)
    found = load(find(list_entries(OPERATIONS), name, "operation", "see docs/operations.md"))
    if not isinstance(found, Operation):
        raise JobError(
            f"operation {name}",
            "is not a camgen.plan.Operation",
            remedy="mend or remove its package",
        )
    if kind not in found.takes:
        raise _not_for(kind, name, part)
    return found


def name_operation(part: Part, job: Job) -> str:
    """The name of the operation that the job states, or of the usual one for the part."""
    if job.operation.kind != "auto":
        return job.operation.kind
    return _usual(kind_of(part), job)


def kind_of(part: Part) -> Kind:
    """What a part is: a drawing, a picture, a solid, curves in space, or a program that was read."""
    if isinstance(part, Recorded):
        return "program"
    if part.curves:
        return "curves"
    return "solid" if part.solid is not None else "drawing" if part.raster is None else "picture"


def _usual(kind: Kind, job: Job) -> str:
    """What is done where the job does not say it. What is laid on a page is a drawing, and is drawn."""
    if kind in ("solid", "program"):
        return {"solid": "edges", "program": "replay"}[kind]
    on_lines = kind == "curves" or (job.page.size and job.operation.planner != "image")
    return "trace" if on_lines else "follow"


def _not_for(kind: Kind, name: str, part: Part) -> JobError:
    if kind == "program":
        what, remedy = (
            f"G-code is replayed, it cannot be used to {name}",
            'set operation.kind to "replay" or leave it out',
        )
    elif kind == "solid":
        what, remedy = (
            f'"{name}" is for flat parts, this is a 3-D part',
            'set operation.kind to "edges"',
        )
    elif kind == "curves":
        what, remedy = (
            f'"{name}" is for flat parts, these are curves in space',
            'set operation.kind to "trace"',
        )
    elif name == "replay":
        what, remedy = f'"replay" is for G-code, {part.source} is none', "leave it out"
    else:
        what, remedy = f'"{name}" is not for a {kind}', "leave it out"
    return JobError("job", what, "operation.kind", remedy)


def read_options(job: Job, settings: type[Options]) -> Options:
    """``operation.options`` as the operation's own table, a msgspec Struct. JobError for what does not fit."""
    try:
        return msgspec.convert(job.operation.options, settings, strict=True)
    except msgspec.ValidationError as error:
        raise JobError(
            "job", str(error), "operation.options", "see the page of the operation"
        ) from error


def _simplify(part: Part, job: Job) -> Part:
    if part.raster is None and not job.tolerance.simplify and not job.input.min_length:
        return part
    from camgen.plan.simplify import simplify  # noqa: PLC0415 (OpenCV is loaded only by what needs it)

    return simplify(part, job)
