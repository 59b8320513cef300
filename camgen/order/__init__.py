"""Ordering: from a plan to one tour, as short as it gets, with leads, and down where nothing is in between."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

from msgspec.structs import replace

from camgen.model.cell import Cell
from camgen.model.errors import JobError
from camgen.model.job import Job
from camgen.model.part import Note
from camgen.model.path import ToolPath, Tour
from camgen.model.pose import FloatArray, Pose
from camgen.order.tours import ArmTour, EdgeTour, JobTour, ReplayTour
from camgen.plan import MAY_END, EdgePlan, JobPlan, Plan, ReplayPlan, Watch, ignore_stages
from camgen.robots.workcell import Workcell

if TYPE_CHECKING:
    from camgen.order.solver.matrix import Rules

__all__ = [
    "ArmTour",
    "EdgeTour",
    "JobTour",
    "ReplayTour",
    "may_choose_ways",
    "may_end_early",
    "order",
]


def may_end_early(stage: str) -> bool:
    """Whether a stage is a search that KeyboardInterrupt ends alone: its best result is taken."""
    return stage.endswith(MAY_END)


def order(
    plan: Plan, job: Job, cell: Cell | None = None, watch: Watch = ignore_stages, ways: bool = False
) -> Tour:
    """The paths of ``plan`` in the order in which they are run, from and back to the home of ``cell`` if there is one.

    watch: is told how far a search is. ways: the arm chooses how it goes from path to path of a flat part, in free ways
    of its joints, where its tool has one turn only too. NoSafeProgram where no free way leads to any edge of a
    3-D part.
    """
    if isinstance(plan, (EdgePlan, ReplayPlan)) and plan.paths is not plan.made:
        raise changed_paths()
    if isinstance(plan, ReplayPlan):
        return ReplayTour(
            plan.paths, plan.travel, "as-drawn", run=plan.run, made=plan.paths, parts=plan.parts
        )
    if isinstance(plan, EdgePlan):
        from camgen.order.edges import order_edges  # noqa: PLC0415 (fcl is loaded only by what needs it)

        return order_edges(plan, job, cell, watch)
    if isinstance(plan, JobPlan):
        return _order_steps(plan, job, cell, watch, ways)
    watch("ordering")
    return _order_paths(plan, job, cell, watch, ways)


def may_choose_ways(job: Job) -> bool:
    """Whether an arm can go from path to path as its joints like: of several operations, in one of them at least."""
    jobs = [job]
    if job.operations:
        from camgen.plan.steps import job_of  # noqa: PLC0415 (shapely is loaded only by what needs it)

        jobs = [job_of(job, step) for step in job.operations]
    return any(_may_choose(one) for one in jobs)


def _turns(job: Job) -> bool:
    return job.tool.symmetric or job.tool.turn is not None


def _may_choose(job: Job) -> bool:
    """A tool that turns with its contour winds up between the paths, and one that stays down has no way in the air."""
    return job.tool.orient != "follow" and not job.process.stay_down


def _order_steps(plan: JobPlan, job: Job, cell: Cell | None, watch: Watch, ways: bool) -> JobTour:
    """The operations in their order, each with the best tour over its own paths."""
    from camgen.plan.steps import job_of  # noqa: PLC0415 (shapely is loaded only by what needs it)

    watch("ordering")
    tours = [
        _order_paths(one, job_of(job, step), cell, watch, ways)
        for one, step in zip(plan.plans, plan.steps, strict=True)
    ]
    paths: list[ToolPath] = []
    down: list[int] = []
    for tour in tours:
        down += [len(paths) + place for place in tour.down]
        paths += tour.paths
    bounds = [tour.bound for tour in tours if tour.bound is not None]
    return JobTour(
        tuple(paths),
        sum(tour.travel for tour in tours),
        tours[0].method,
        sum(bounds) if len(bounds) == len(tours) else None,
        frozenset(down),
        any(tour.stopped for tour in tours),
        any(tour.timed for tour in tours),
        (*(note for tour in tours for note in tour.notes), *_note_later(plan, paths, job)),
        steps=plan.steps,
        numbers=plan.numbers,
        tours=tuple(tours),
        links=_link_steps(plan, tours, job),
    )


def _link_steps(plan: JobPlan, tours: Sequence[Tour], job: Job) -> tuple[FloatArray | None, ...]:
    """The ways at working height from operation to operation, see `JobTour`."""
    from camgen.order.stay_down import lead_beside  # noqa: PLC0415
    from camgen.plan.steps import job_of  # noqa: PLC0415 (shapely is loaded only by what needs it)

    links: list[FloatArray | None] = [None] * len(tours)
    for number in range(1, len(tours)):
        pair = tours[number - 1 : number + 1]
        before, step = plan.steps[number - 1 : number + 1]
        same = before.tool == step.tool and before.process.spindle == step.process.spindle
        # The joints of an arm lead from above a path to above the next one.
        if same and all(tour.paths and not isinstance(tour, ArmTour) for tour in pair):
            left, met = pair[0].paths[-1], pair[1].paths[0]
            links[number] = lead_beside(left, met, plan.plans[number].part, job_of(job, step))
    return tuple(links)


def _note_later(plan: JobPlan, paths: Sequence[ToolPath], job: Job) -> list[Note]:
    """A note where contours of ``tour.order`` are not run as they stand there: operations keep their own order."""
    first: dict[str, int] = {}
    for place, path in enumerate(paths):
        for name in path.contours:
            first.setdefault(name, place)
    named = [name for name in job.tour.order if name in first]
    late = next(((one, two) for one, two in pairwise(named) if first[two] < first[one]), None)
    if late is None:
        return []
    owner = [
        number for number, one in zip(plan.numbers, plan.plans, strict=True) for _ in one.paths
    ]
    one, two = late
    why = f"operation {owner[first[two]]} runs before operation {owner[first[one]]}; the order holds within each"
    return [Note("warning", f"tour.order: contour {two} is run before {one}", why, late)]


def changed_paths() -> JobError:
    """The error where paths were changed that are not what is run: their motions are."""
    return JobError(
        "paths",
        "of edges and of replays follow from the job",
        remedy="change the job, and plan again",
    )


def _order_paths(plan: Plan, job: Job, cell: Cell | None, watch: Watch, ways: bool) -> Tour:
    """The paths of a flat part with their leads."""
    from camgen.order.arrange import Search, arrange, measure_travel  # noqa: PLC0415 (5 ms, which edges do not need)
    from camgen.order.leads import add_leads  # noqa: PLC0415 (shapely is loaded only by what needs it)
    from camgen.order.stay_down import stay_down  # noqa: PLC0415
    from camgen.order.tabs import add_tabs  # noqa: PLC0415 (only for what needs it)

    start = cell.home.origin[:2] if cell is not None and isinstance(cell.home, Pose) else None
    choice, operation = job.tour, job.operation

    def tell(part: float) -> None:
        watch(f"ordering {part:.0%}, Ctrl-C {MAY_END}")

    told = None if watch is ignore_stages else tell
    settings = Search(
        choice.method,
        start,
        operation.inside_first,
        choice.seconds,
        choice.seed,
        choice.layers,
        choice.seam,
        choice.order,
    )
    found = arrange(plan.paths, settings, told)
    arm = None
    # The travel of a machine whose home is a pose is that of the plane already.
    if isinstance(cell, Workcell) and cell.arm is not None and start is None and plan.paths:
        arm = cell
    free = arm is not None and (_turns(job) or (ways and _may_choose(job)))
    # Leads and tabs change the paths that turns are chosen for: order and starts first, turns at the end.
    later = free and any(
        (
            operation.lead_in,
            operation.lead_out,
            operation.overlap,
            operation.tabs,
            operation.tab_spacing,
        )
    )
    if arm is not None and choice.method == "best" and (later or not free):
        found = _order_on_arm(plan, found, job, arm, watch, free)
    fixtures = cell.fixtures if isinstance(cell, Workcell) else None
    led, notes = add_leads(found.paths, plan.part, job, fixtures)
    led, more = add_tabs(found.paths, led, job)
    notes = [*found.notes, *notes, *more]
    if found.stopped:
        why = "the best tour so far is used; the same job gives another one when its search is not interrupted"
        notes = [*notes, Note("warning", "the search for a short tour was stopped", why)]
    if found.timed:
        what = (
            f"the search for a short tour was ended by the clock, tour.seconds = {choice.seconds:g}"
        )
        why = "the order may differ from run to run; without tour.seconds it does not"
        notes = [*notes, Note("assumed", what, why)]
    # Leads move the ends of a path by no more than their lengths.
    moved = len(plan.paths) * (operation.lead_in + operation.lead_out + operation.overlap)
    bound = None if found.bound is None else max(0.0, found.bound - moved)
    tour = replace(found, paths=tuple(led), travel=measure_travel(led, start), bound=bound)
    tour, saved = stay_down(tour, plan.part, job)
    tour = replace(tour, notes=(*notes, *saved))
    if arm is None or not free:
        return tour
    from camgen.order.arm import TourRequest, order_with_turns  # noqa: PLC0415 (kinematics, fcl: only for arms)

    request = TourRequest(tour, _rules(plan, tour, job), later or choice.method != "best")
    tour = order_with_turns(request, job, arm, watch)
    return replace(tour, travel=measure_travel(tour.paths, start))


def _rules(plan: Plan, tour: Tour, job: Job) -> Rules:
    """The precedence of the paths, by their index in ``tour``."""
    from camgen.order.arrange import rules_of  # noqa: PLC0415 (5 ms, which edges do not need)

    inside_first, settings = job.operation.inside_first, job.tour
    return rules_of(plan.paths, tour.paths, inside_first, settings.layers, settings.order)


def _order_on_arm(
    plan: Plan, tour: Tour, job: Job, cell: Workcell, watch: Watch, free: bool
) -> Tour:
    """``tour`` by the time of the joints, without a test for collisions.

    free: the rolls that the tool may have are chosen, and links are joint motions.
    """
    from camgen.order.arm import TourRequest, order_by_time, order_with_turns  # noqa: PLC0415 (kinematics, fcl: only for arms)

    request = TourRequest(tour, _rules(plan, tour, job))
    if free:
        return order_with_turns(request, job, cell, watch, prove=False)
    return order_by_time(request, job, cell, watch)
