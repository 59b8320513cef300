"""Orders the paths of a plan into one short tour, adds leads and tabs, and keeps the tool down."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain, pairwise
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
    "may_end_early",
    "may_link_by_joints",
    "order",
]


def may_end_early(stage: str) -> bool:
    """Whether a stage is a search that KeyboardInterrupt ends alone: its best result is used."""
    return stage.endswith(MAY_END)


def order(
    plan: Plan,
    job: Job,
    cell: Cell | None = None,
    watch: Watch = ignore_stages,
    joint_links: bool = False,
) -> Tour:
    """The paths of `plan` in the order in which they are run, from and back to the home of `cell`.

    Raises NoSafeProgram if no edge of a 3-D part has a collision-free link, and JobError if paths
    of edges or of a replay were changed.

    watch: callback that gets the progress of a search.
    joint_links: whether an arm links the paths of a flat part by joint motions, even if
        its tool has only one roll.
    """
    if isinstance(plan, (EdgePlan, ReplayPlan)) and plan.paths is not plan.original_paths:
        raise make_changed_paths_error()
    if isinstance(plan, ReplayPlan):
        return ReplayTour(
            plan.paths,
            plan.travel,
            "as-drawn",
            run=plan.run,
            original_paths=plan.paths,
            parts=plan.parts,
        )
    if isinstance(plan, EdgePlan):
        from camgen.order.edges import order_edges  # noqa: PLC0415 (fcl: only for edges)

        return order_edges(plan, job, cell, watch)
    if isinstance(plan, JobPlan):
        return _order_steps(plan, job, cell, watch, joint_links)
    watch("ordering")
    return _order_paths(plan, job, cell, watch, joint_links)


def may_link_by_joints(job: Job) -> bool:
    """Whether an arm may link paths by joint motions, in at least one operation of the job."""
    jobs = [job]
    if job.operations:
        from camgen.plan.steps import make_step_jobs  # noqa: PLC0415 (shapely: only for operations)

        jobs = make_step_jobs(job)
    return any(_may_lift_freely(job_of_step) for job_of_step in jobs)


def _may_lift_freely(job: Job) -> bool:
    """Whether links may be joint motions.

    A tool that follows its contour winds up between the paths, and one that stays down does not
    leave the part.
    """
    return job.tool.orient != "follow" and not job.process.stay_down


def _order_steps(
    plan: JobPlan, job: Job, cell: Cell | None, watch: Watch, joint_links: bool
) -> JobTour:
    """The operations in their order, each with the best tour over its own paths."""
    from camgen.plan.steps import make_step_job  # noqa: PLC0415 (shapely: only where needed)

    watch("ordering")
    jobs = [make_step_job(job, step) for step in plan.steps]
    tours = []
    for step_plan, step_job in zip(plan.plans, jobs, strict=True):
        tours.append(_order_paths(step_plan, step_job, cell, watch, joint_links))
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
        (*chain.from_iterable(tour.notes for tour in tours), *_note_later(plan, paths, job)),
        steps=plan.steps,
        numbers=plan.numbers,
        tours=tuple(tours),
        links=_link_steps(plan, tours, jobs),
    )


def _link_steps(
    plan: JobPlan, tours: Sequence[Tour], jobs: Sequence[Job]
) -> tuple[FloatArray | None, ...]:
    """The links at working height from operation to operation, see `JobTour`."""
    from camgen.order.stay_down import lead_beside  # noqa: PLC0415

    links: list[FloatArray | None] = [None] * len(tours)
    for number, (before, job) in enumerate(pairwise(jobs), 1):
        pair = tours[number - 1 : number + 1]
        same = before.tool == job.tool and before.process.spindle == job.process.spindle
        # The joints of an arm lead from above a path to above the next one.
        if same and all(tour.paths and not isinstance(tour, ArmTour) for tour in pair):
            left, met = pair[0].paths[-1], pair[1].paths[0]
            links[number] = lead_beside(left, met, plan.plans[number].part, job)
    return tuple(links)


def _note_later(plan: JobPlan, paths: Sequence[ToolPath], job: Job) -> list[Note]:
    """A note if contours are not run in the order of `tour.order`: operations keep theirs."""
    first: dict[str, int] = {}
    owner = []
    for number, step_plan in zip(plan.numbers, plan.plans, strict=True):
        owner += [number] * len(step_plan.paths)
    for place, path in enumerate(paths):
        for name in path.contours:
            first.setdefault(name, place)
    for before, after in pairwise([name for name in job.tour.order if name in first]):
        if first[after] < first[before]:
            why = (
                f"operation {owner[first[after]]} runs before operation {owner[first[before]]}; "
                "the order holds within each"
            )
            what = f"tour.order: contour {after} is run before {before}"
            return [Note("warning", what, why, (before, after))]
    return []


def make_changed_paths_error() -> JobError:
    """The error for changed paths of edges or of a replay: their motions would not change."""
    return JobError(
        "paths",
        "of edges and of replays follow from the job",
        remedy="change the job, and plan again",
    )


def _order_paths(plan: Plan, job: Job, cell: Cell | None, watch: Watch, joint_links: bool) -> Tour:
    """The paths of a flat part with their leads, tabs and, for an arm, rolls."""
    from camgen.order.arrange import measure_travel, order_paths  # noqa: PLC0415 (5 ms)
    from camgen.order.leads import add_leads  # noqa: PLC0415 (shapely: only for flat parts)
    from camgen.order.stay_down import stay_down  # noqa: PLC0415
    from camgen.order.tabs import add_tabs  # noqa: PLC0415 (only for what needs it)

    start = cell.home.origin[:2] if cell is not None and isinstance(cell.home, Pose) else None
    choice, operation = job.tour, job.operation

    def report(fraction: float) -> None:
        watch(f"ordering {fraction:.0%}, Ctrl-C {MAY_END}")

    on_progress = None if watch is ignore_stages else report
    tour = order_paths(plan.paths, choice, start, operation.inside_first, on_progress)
    arm = None
    # The travel of a machine whose home is a pose is that of the plane already.
    if isinstance(cell, Workcell) and cell.arm is not None and start is None and plan.paths:
        arm = cell
    may_roll = job.tool.symmetric or job.tool.turn is not None
    free = arm is not None and (may_roll or (joint_links and _may_lift_freely(job)))
    # Leads and tabs change the paths for which rolls are chosen. Order and starts come first then,
    # and rolls at the end.
    has_leads = operation.lead_in or operation.lead_out or operation.overlap
    rolls_later = free and bool(has_leads or operation.tabs or operation.tab_spacing)
    if arm is not None and choice.method == "best" and (rolls_later or not free):
        tour = _order_on_arm(plan, tour, job, arm, watch, free)
    fixtures = cell.fixtures if isinstance(cell, Workcell) else None
    led, lead_notes = add_leads(tour.paths, plan.part, job, fixtures)
    led, tab_notes = add_tabs(tour.paths, led, job)
    notes = [*tour.notes, *lead_notes, *tab_notes, *_note_end(tour, choice.seconds)]
    # Leads move the ends of a path by no more than their lengths.
    moved = len(plan.paths) * (operation.lead_in + operation.lead_out + operation.overlap)
    bound = None if tour.bound is None else max(0.0, tour.bound - moved)
    tour = replace(tour, paths=tuple(led), travel=measure_travel(led, start), bound=bound)
    tour, link_notes = stay_down(tour, plan.part, job)
    tour = replace(tour, notes=(*notes, *link_notes))
    if arm is None or not free:
        return tour
    from camgen.order.arm import TourRequest, order_with_rolls  # noqa: PLC0415 (fcl: only for arms)

    request = TourRequest(tour, _rules(plan, tour, job), rolls_later or choice.method != "best")
    tour = order_with_rolls(request, job, arm, watch)
    return replace(tour, travel=measure_travel(tour.paths, start))


def _note_end(tour: Tour, seconds: float) -> Iterator[Note]:
    if tour.stopped:
        why = (
            "the best tour so far is used; without the interrupt the same job may give another one"
        )
        yield Note("warning", "the search for a short tour was stopped", why)
    if tour.timed:
        what = f"the search for a short tour was ended by the clock, tour.seconds = {seconds:g}"
        why = "the order may differ from run to run; without tour.seconds it does not"
        yield Note("assumed", what, why)


def _rules(plan: Plan, tour: Tour, job: Job) -> Rules:
    from camgen.order.arrange import make_rules  # noqa: PLC0415 (5 ms, which edges do not need)

    return make_rules(plan.paths, tour.paths, job.tour, job.operation.inside_first)


def _order_on_arm(
    plan: Plan, tour: Tour, job: Job, cell: Workcell, watch: Watch, free: bool
) -> Tour:
    """The tour ordered by the time of the joints, without a test for collisions.

    free: the rolls that the tool may have are chosen, and links are joint motions.
    """
    from camgen.order.arm import (  # noqa: PLC0415 (fcl: only for arms)
        TourRequest,
        order_by_time,
        order_with_rolls,
    )

    request = TourRequest(tour, _rules(plan, tour, job))
    if free:
        return order_with_rolls(request, job, cell, watch, prove=False)
    return order_by_time(request, job, cell, watch)
