"""The stock proof of a build: what the printed text, read back, does to the material."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.check.report import Cycle, clean
from camgen.geometry.ragged import run_starts
from camgen.geometry.segments import flatten
from camgen.model.errors import NoSafeProgram
from camgen.model.job import Job, ToolTable
from camgen.model.path import Tour
from camgen.model.pose import Pose
from camgen.model.program import Comment, Instruction, Program
from camgen.order import JobTour
from camgen.pipeline.rounding import list_tolerances, remedy_for_corners
from camgen.plan import EdgePlan, JobPlan, Plan, ReplayPlan
from camgen.plan.columns import path_segments
from camgen.plan.steps import job_of, name_drills
from camgen.post.plugins import dynamics_of, states_rounding

if TYPE_CHECKING:
    from camgen.check.stock import Cut, StockProof
    from camgen.pipeline.programs import Checked, Posted, Request

#: Remedy for a tool that meets a fixture.
MOVE_FIXTURE = "move the fixture: cell.fixtures"
#: Settings that hold a piece.
REMEDY_FOR_PIECES = (
    "set operation.tabs, on the contours around it too, a depth that leaves a skin, stock.margin "
    'to the stock around the drawing, or stock.held = "vacuum" or "tape"'
)


def prove_stock(
    asked: Plan, plan: Plan, tour: Tour, request: Request, checked: Checked, posted: Posted
) -> StockProof | None:
    """The stock proof of the texts `posted`; None for a plan that cuts nothing, or no flat part.

    asked: the plan before anything was left out of it: what its other paths would take is told as
        left.

    Raises NoSafeProgram for the first motion that cuts what must stay, runs through material in
    rapid motion or with the holder, or comes too near to a fixture, and for the first piece that
    must be held and is not.
    """
    if isinstance(plan, (EdgePlan, ReplayPlan)) or plan.part.curves:
        return None
    job = request.job
    jobs = [job_of(job, step) for step in plan.steps] if isinstance(plan, JobPlan) else [job]
    if not any(one.operation.depth or one.operation.width for one in jobs) or why_unproven(job):
        return None
    from camgen.check.stock import design, prove, task_on  # noqa: PLC0415 (shapely, only for what cuts)

    plans = plan.plans if isinstance(plan, JobPlan) else (plan,)
    tasks = [task_on(plan.part, own, one.part) for own, one in zip(jobs, plans, strict=True)]
    post = checked.programs[0][0]
    proof = prove(
        list(cuts_of_texts(tour, request, checked, posted)),
        design(tasks, job.stock, _sweep_lost(asked, tour, jobs)),
        dynamics_of(post, job) if states_rounding(post) else None,
        job.stock,
        request.cell.fixtures,
        on_arm=not isinstance(request.cell.home, Pose),
    )
    if proof.refused:
        worst = proof.refused[0]
        more = f", and {len(proof.refused) - 1} more like it" if len(proof.refused) > 1 else ""
        filled = any(one.operation.kind == "fill" for one in jobs)
        remedy = "see tool.diameter, operation.depth and operation.side" + (
            '; "pocket" clears exactly' if filled else ""
        )
        if worst.kind == "corner":
            remedy = remedy_for_corners(post, float(list_tolerances(tour, job)[:-1].min()))
        if worst.kind == "fixture":
            remedy = MOVE_FIXTURE
        if worst.kind == "unheld":
            remedy = REMEDY_FOR_PIECES
        raise NoSafeProgram(worst.file, f"{worst.text}{more}", f"line {worst.line}", remedy)
    return proof


def _sweep_lost(asked: Plan, tour: Tour, jobs: Sequence[Job]) -> Any:
    """Polygons of what the paths that are left out would take, None where there are none."""
    import shapely  # noqa: PLC0415 (only for what cuts)

    from camgen.check.stock.cells import CHORD_MM  # noqa: PLC0415

    kept = {path.id for path in tour.paths}
    swept = []
    for one, job in zip(asked.plans if isinstance(asked, JobPlan) else (asked,), jobs, strict=True):
        for path in one.paths:
            if path.id not in kept:
                points = path.position[:, :2]
                if len(points) > 1:
                    points = np.concatenate(
                        [flatten(path_segments((path,)), CHORD_MM)[0], points[-1:]]
                    )
                line = shapely.linestrings(points) if len(points) > 1 else shapely.points(points[0])
                swept.append(shapely.buffer(line, job.tool.radius + 2 * CHORD_MM))
    return shapely.union_all(swept) if swept else None


def why_unproven(job: Job) -> str:
    """Why what a job cuts is not judged, empty where it is."""
    jobs = [job_of(job, step) for step in job.operations] or [job]
    if any(one.tool.orient == "follow" for one in jobs):
        return "the tool turns with the contour"
    if any(one.operation.planner == "image" for one in jobs):
        return "the image planner follows the picture to a part of a pixel, not its contours"
    return ""


class StatedProgram(NamedTuple):
    """A program with the instructions of its text, which are the same without the comments.

    name: file of the text.
    body, lines: the instructions with their lines.
    program: the program.
    """

    name: str
    body: Sequence[Instruction]
    lines: Sequence[int]
    program: Program


def cuts_of_texts(tour: Tour, request: Request, checked: Checked, posted: Posted) -> Iterator[Cut]:
    """What each operation does, in order, as the texts say it.

    The instructions that were read back are those of the program, one by one, but for its comments: that is what the
    comparison has shown.
    """
    stated, first = [], 0
    for count, executed, (_, program) in zip(
        posted.counts, posted.executed, checked.programs, strict=True
    ):
        name = posted.files[first].name
        stated.append(StatedProgram(name, executed.body, executed.lines, program))
        first += count
    return cuts_of(tour, request, stated)


def cuts_of(tour: Tour, request: Request, stated: Sequence[StatedProgram]) -> Iterator[Cut]:
    """The cuts of each operation, in order."""
    from camgen.check.stock import Cut  # noqa: PLC0415 (shapely, only for what cuts)

    job, home = request.job, request.cell.home
    steps: list[tuple[ToolTable, str]] = [(name_drills([job])[0], "")]
    step_of = np.zeros(len(tour.paths), dtype=np.intp)
    if isinstance(tour, JobTour):
        tools = name_drills([job_of(job, step) for step in tour.steps])
        names = [f"operation {number}" for number in tour.numbers]
        steps = list(zip(tools, names, strict=True))
        step_of = np.repeat(np.arange(len(steps)), [len(one.paths) for one in tour.tours])
    corners = np.zeros(len(steps))
    np.maximum.at(corners, step_of, list_tolerances(tour, job)[:-1])
    # A robot travels on straight lines: what runs as fast as it travels is none that cuts, where no cut is as fast.
    # With process.stay_down there is no stock beside the part that it could run through.
    process = job.process
    stays = any(step.process.stay_down for step in job.operations) or process.stay_down
    slower = process.feed * process.max_feed_factor < process.travel_speed and not stays
    travel = process.travel_speed if slower and not isinstance(home, Pose) else float("inf")
    for text in stated:
        own = _own_step(text.program, step_of)
        edges = [*run_starts(own).tolist(), len(own)]
        for start, end in pairwise(edges):
            tool, about = steps[int(own[start])]
            yield Cut(
                text.body[start:end],
                text.lines[start:end],
                tool,
                text.name,
                about,
                travel,
                job.tolerance.chord,
                float(corners[own[start]]),
            )


def _own_step(program: Program, step_of: NDArray[np.intp]) -> NDArray[np.intp]:
    """(N,): to which step each instruction but comments belongs; what is no motion of a path to that of the next."""
    columns = program.columns
    own = np.full(len(program.body), -1, dtype=np.intp)
    moving = columns.path >= 0
    own[columns.at[moving]] = step_of[columns.path[moving]]
    own = own[~columns.are(Comment)]
    known = np.flatnonzero(own >= 0)
    following = np.minimum(np.searchsorted(known, np.arange(len(own))), len(known) - 1)
    return np.asarray(own[known[following]])


class OperationSum(Struct, frozen=True):
    """One of several operations: its place in the job, how many paths it has, s, and mm3 that it takes away; None where
    that is not judged.
    """

    number: int
    paths: int
    seconds: float
    removed: float | None


def sum_operations(tour: Tour, time: Cycle, proof: StockProof | None) -> list[OperationSum]:
    """What each operation amounts to, in the order in which they run; nothing for a job with one."""
    if not isinstance(tour, JobTour):
        return []
    removed = iter(proof.volumes if proof else ())
    sums, before = [], 0
    for number, one in zip(tour.numbers, tour.tours, strict=True):
        own = slice(before, before + len(one.paths))
        before = own.stop
        seconds = float(time.paths[own].sum() + time.links[own].sum())
        sums.append(
            OperationSum(
                number, len(one.paths), seconds, next(removed) if proof and one.paths else None
            )
        )
    return sums


def report_operations(
    job: Job, sums: Sequence[OperationSum], proof: StockProof | None
) -> dict[str, object]:
    """What the report says of several operations, and of the stock: mm3, s."""
    found: dict[str, object] = {}
    if sums:
        found["operations"] = [
            {
                "number": one.number,
                "kind": job.operations[one.number].operation.kind,
                "tool": clean(job.operations[one.number].tool.name),
                "tool_number": job.operations[one.number].tool.number,
                "paths": one.paths,
                "time_s": round(one.seconds, 1),
                "removed_mm3": None if one.removed is None else round(one.removed, 1),
            }
            for one in sums
        ]
    if proof:
        found["stock"] = {
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
    return found
