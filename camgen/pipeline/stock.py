"""The stock proof of a build: the material that the printed text removes, once read back."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.check.report import Cycle, clean
from camgen.geometry.ragged import find_run_starts
from camgen.geometry.segments import flatten
from camgen.model.errors import NoSafeProgram
from camgen.model.job import Job, ToolTable
from camgen.model.path import Tour
from camgen.model.pose import Pose
from camgen.model.program import Comment, Instruction, Program
from camgen.order import JobTour
from camgen.pipeline.rounding import list_tolerances, remedy_for_corners
from camgen.plan import EdgePlan, JobPlan, Plan, ReplayPlan
from camgen.plan.columns import make_path_segments
from camgen.plan.steps import make_step_job, make_step_jobs, name_drills
from camgen.post.plugins import dynamics_of, states_rounding

if TYPE_CHECKING:
    from camgen.check.stock import Cut, StockProof
    from camgen.pipeline.programs import PostedText, Request

#: Remedy for a tool that meets a fixture.
MOVE_FIXTURE = "move the fixture: cell.fixtures"
#: Settings that hold a piece.
REMEDY_FOR_PIECES = (
    "set operation.tabs, on the contours around it too, a depth that leaves a skin, stock.margin "
    'to the stock around the drawing, or stock.held = "vacuum" or "tape"'
)


def prove_stock(
    full_plan: Plan,
    plan: Plan,
    tour: Tour,
    request: Request,
    texts: Sequence[PostedText],
) -> StockProof | None:
    """The stock proof of `texts`; None for a plan that cuts nothing, or no flat part.

    full_plan: the plan before paths were left out. The material of those paths is reported as rest
        material.

    Raises NoSafeProgram for the first motion that cuts into the part, moves through material in
    rapid motion or with the holder, or comes too near to a fixture, and for the first piece that
    must be held and is not.
    """
    if isinstance(plan, (EdgePlan, ReplayPlan)) or plan.part.curves:
        return None
    job = request.job
    jobs = [make_step_job(job, step) for step in plan.steps] if isinstance(plan, JobPlan) else [job]
    cuts = any(step_job.operation.depth or step_job.operation.width for step_job in jobs)
    if not cuts or explain_unproven(job):
        return None
    from camgen.check.stock import design, make_task, prove  # noqa: PLC0415 (shapely)

    plans = plan.plans if isinstance(plan, JobPlan) else (plan,)
    tasks = [
        make_task(plan.part, step_job, step_plan.part)
        for step_job, step_plan in zip(jobs, plans, strict=True)
    ]
    post = texts[0].post
    proof = prove(
        list(make_text_cuts(tour, request, texts)),
        design(tasks, job.stock, _sweep_left_out(full_plan, tour, jobs)),
        dynamics_of(post, job) if states_rounding(post) else None,
        job.stock,
        request.cell.fixtures,
        on_arm=not isinstance(request.cell.home, Pose),
    )
    if proof.refused:
        worst = proof.refused[0]
        more = f", and {len(proof.refused) - 1} more like it" if len(proof.refused) > 1 else ""
        remedy = "see tool.diameter, operation.depth and operation.side"
        if any(step_job.operation.kind == "fill" for step_job in jobs):
            remedy += '; "pocket" clears exactly'
        if worst.kind == "corner":
            remedy = remedy_for_corners(post, float(list_tolerances(tour, job)[:-1].min()))
        if worst.kind == "fixture":
            remedy = MOVE_FIXTURE
        if worst.kind == "unheld":
            remedy = REMEDY_FOR_PIECES
        raise NoSafeProgram(worst.file, f"{worst.text}{more}", f"line {worst.line}", remedy)
    return proof


def _sweep_left_out(full_plan: Plan, tour: Tour, jobs: Sequence[Job]) -> Any:
    """Polygons that the tool would sweep on the paths that are left out, None without any."""
    import shapely  # noqa: PLC0415 (only for cuts)

    from camgen.check.stock.cells import CHORD_MM  # noqa: PLC0415

    kept = {path.id for path in tour.paths}
    plans = full_plan.plans if isinstance(full_plan, JobPlan) else (full_plan,)
    swept = []
    for plan, job in zip(plans, jobs, strict=True):
        for path in plan.paths:
            if path.id in kept:
                continue
            line = shapely.points(path.position[0, :2])
            if len(path.position) > 1:
                points = flatten(make_path_segments((path,)), CHORD_MM)[0]
                line = shapely.linestrings(np.concatenate([points, path.position[-1:, :2]]))
            swept.append(shapely.buffer(line, job.tool.radius + 2 * CHORD_MM))
    return shapely.union_all(swept) if swept else None


def explain_unproven(job: Job) -> str:
    """The reason why the material that a job removes is not proven, empty if it is."""
    jobs = make_step_jobs(job)
    if any(step_job.tool.orient == "follow" for step_job in jobs):
        return "the tool turns with the contour"
    if any(step_job.operation.planner == "image" for step_job in jobs):
        return "the image planner follows the picture to a part of a pixel, not its contours"
    return ""


class StatedProgram(NamedTuple):
    """A program with the instructions of its text.

    name: name of the file of the text.
    body: the instructions of the text, those of the program without its comments.
    lines: line of each instruction of `body`.
    program: the program.
    """

    name: str
    body: Sequence[Instruction]
    lines: Sequence[int]
    program: Program


def make_text_cuts(tour: Tour, request: Request, texts: Sequence[PostedText]) -> Iterator[Cut]:
    """The cuts of each operation, in order, with the instructions of the texts."""
    stated = []
    for text in texts:
        body, lines = text.executed.body, text.executed.lines
        stated.append(StatedProgram(text.name, body, lines, text.program))
    return make_cuts(tour, request, stated)


def make_cuts(tour: Tour, request: Request, stated: Sequence[StatedProgram]) -> Iterator[Cut]:
    """The cuts of each operation, in order."""
    from camgen.check.stock import Cut  # noqa: PLC0415 (shapely)

    job, home = request.job, request.cell.home
    steps: list[tuple[ToolTable, str]] = [(name_drills([job])[0], "")]
    step_of = np.zeros(len(tour.paths), dtype=np.intp)
    if isinstance(tour, JobTour):
        tools = name_drills([make_step_job(job, step) for step in tour.steps])
        steps = list(zip(tools, [f"operation {number}" for number in tour.numbers], strict=True))
        step_of = np.repeat(np.arange(len(steps)), [len(one_tour.paths) for one_tour in tour.tours])
    corners = np.zeros(len(steps))
    np.maximum.at(corners, step_of, list_tolerances(tour, job)[:-1])
    # A robot has no rapid motion; it travels on straight lines. If every cut is slower than travel,
    # a motion at the travel speed is treated as a rapid motion, which must not cut. With
    # process.stay_down there is no stock beside the part through which it could run.
    process = job.process
    stays = any(step.process.stay_down for step in job.operations) or process.stay_down
    is_slower = process.feed * process.max_feed_factor < process.travel_speed and not stays
    rapid_speed = process.travel_speed if is_slower and not isinstance(home, Pose) else float("inf")
    for text in stated:
        row_steps = _find_steps(text.program, step_of)
        for start, end in pairwise([*find_run_starts(row_steps).tolist(), len(row_steps)]):
            step = int(row_steps[start])
            tool, step_name = steps[step]
            yield Cut(
                text.body[start:end],
                text.lines[start:end],
                tool,
                text.name,
                step_name,
                rapid_speed,
                job.tolerance.chord,
                float(corners[step]),
            )


def _find_steps(program: Program, step_of: NDArray[np.intp]) -> NDArray[np.intp]:
    """The step of each instruction except comments, shape (N,).

    step_of: step of each path. An instruction on no path belongs to the step of the next motion
        that is on one.
    """
    columns = program.columns
    steps = np.full(len(program.body), -1, dtype=np.intp)
    moving = columns.path >= 0
    steps[columns.at[moving]] = step_of[columns.path[moving]]
    steps = steps[~columns.are(Comment)]
    on_path = np.flatnonzero(steps >= 0)
    following = np.minimum(np.searchsorted(on_path, np.arange(len(steps))), len(on_path) - 1)
    return np.asarray(steps[on_path[following]])


class OperationSum(Struct, frozen=True):
    """The sums of one of several operations.

    number: index of the operation in the job.
    paths: number of its paths.
    seconds: time of its paths and links, s.
    removed: volume that it removes, mm3; None if that is not proven.
    """

    number: int
    paths: int
    seconds: float
    removed: float | None


def sum_operations(tour: Tour, time: Cycle, proof: StockProof | None) -> list[OperationSum]:
    """The sums of each operation, in the order in which they run; empty for a job with one."""
    if not isinstance(tour, JobTour):
        return []
    volumes = iter(proof.volumes if proof else ())
    sums, start = [], 0
    for number, step_tour in zip(tour.numbers, tour.tours, strict=True):
        count = len(step_tour.paths)
        rows = slice(start, start + count)
        start = rows.stop
        seconds = float(time.paths[rows].sum() + time.links[rows].sum())
        volume = next(volumes) if proof and count else None
        sums.append(OperationSum(number, count, seconds, volume))
    return sums


def report_operations(
    job: Job, sums: Sequence[OperationSum], proof: StockProof | None
) -> dict[str, object]:
    """The tables of the report on several operations and on the stock, in mm3 and s."""
    tables: dict[str, object] = {}
    rows = []
    for operation_sum in sums:
        step, volume = job.operations[operation_sum.number], operation_sum.removed
        row = {
            "number": operation_sum.number,
            "kind": step.operation.kind,
            "tool": clean(step.tool.name),
            "tool_number": step.tool.number,
            "paths": operation_sum.paths,
            "time_s": round(operation_sum.seconds, 1),
            "removed_mm3": None if volume is None else round(volume, 1),
        }
        rows.append(row)
    if rows:
        tables["operations"] = rows
    if proof:
        tables["stock"] = {
            "removed_mm3": round(proof.volume, 1),
            "excess_mm3": round(proof.excess, 1),
            "loose": [fault.text for fault in proof.loose],
            "rounded_corners_mm": None if proof.bite is None else round(proof.bite, 4),
            "not_judged": list(proof.notes),
            "set_up": {
                "examined": list(proof.set_up.examined),
                "not_examined": list(proof.set_up.unexamined),
                "exceeded": [breach.what for breach in proof.set_up.breaches],
            },
        }
    return tables
