"""Whether the path that the controller runs keeps to the tolerance of corners."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from msgspec.structs import replace

from camgen.check.executed import UNLIMITED, ReadText, Rounding, join_roundings, measure_text
from camgen.check.report import clean
from camgen.model.errors import NoSafeProgram
from camgen.model.job import Job
from camgen.model.path import Tour
from camgen.model.pose import FloatArray
from camgen.model.program import Columns
from camgen.model.text import short, short_each
from camgen.motion.corners import compute_corner_tolerance
from camgen.order import JobTour
from camgen.post import Post
from camgen.post.plugins import dynamics_of, find_post, states_rounding

if TYPE_CHECKING:
    from camgen.pipeline.programs import PostedPrograms

#: The option of a post with the distance that its controller keeps in corners.
_PATH = "path_tolerance"
#: Rounding of the digits of a text moves both ends of a motion.
_ENDS = 2


def check_rounding(tour: Tour, job: Job, posted: PostedPrograms) -> Rounding | None:
    """The rounding of the texts, as they were read back, that comes nearest to its tolerance.

    None for a post that does not state how its controller rounds.

    Raises NoSafeProgram for a corner that is rounded farther than the job allows.
    """
    post = posted.texts[0].post
    if not states_rounding(post):
        return None
    dynamics = dynamics_of(post, job)
    by_path = list_tolerances(tour, job)
    worst = Rounding()
    count = 0
    for text in posted.texts:
        columns, planned = Columns(text.executed.body), text.program.columns
        lines = np.asarray(text.executed.lines)[columns.at]
        read = ReadText(columns, lines, planned.works, by_path[planned.path], text.name)
        rounding = measure_text(read, dynamics, job.tolerance.chord)
        count += rounding.transitions
        worst = join_roundings(worst, rounding)
    worst = replace(worst, transitions=count)
    if worst.excess > _ENDS * posted.tolerance.mm:
        raise _refuse(worst, post)
    return worst


def limit_path_tolerance(job: Job, post: str) -> Job:
    """The job with a `post.path_tolerance` that its corners allow, if it states none.

    LinuxCNC keeps to one distance in all corners of a program.
    """
    usual = getattr(find_post(post), _PATH, None)
    if usual is None or _PATH in job.post:
        return job
    tolerance = job.tolerance
    allowed = tolerance.chord if tolerance.corner is None else tolerance.corner
    if allowed >= usual:
        return job
    # P has four digits; 0 is an exact path.
    return replace(job, post={**job.post, _PATH: math.floor(allowed * 1e4) / 1e4})


def report_rounding(rounded: Rounding | None) -> dict[str, object]:
    """The rounding as a table of the report, mm; empty without a model."""
    if rounded is None:
        return {}
    table: dict[str, object] = {"transitions": rounded.transitions, "mm": rounded.mm}
    table["largest_mm"] = rounded.largest
    if rounded.line:
        table |= {"allowed_mm": rounded.allowed, "place": list(rounded.place)}
        table |= {"file": clean(rounded.file), "line": rounded.line}
    return {"rounded": table}


def list_tolerances(tour: Tour, job: Job) -> FloatArray:
    """(P + 1,) distance, mm, by which each path may be left in corners; the last is for no path."""
    parts = [(tour, job)]
    if isinstance(tour, JobTour):
        steps = zip(tour.tours, tour.steps, strict=True)
        parts = [(part, replace(job, tool=step.tool)) for part, step in steps]
    tolerances: list[float] = []
    for part, settings in parts:
        tolerances += [_find_tolerance(settings, path.operation) for path in part.paths]
    return np.array([*tolerances, UNLIMITED])


def _find_tolerance(job: Job, operation: str) -> float:
    """The corners of a program that was read are its own, unless the job states a tolerance."""
    if operation == "replay" and job.tolerance.corner is None:
        return UNLIMITED
    return compute_corner_tolerance(job, operation)


def _refuse(worst: Rounding, post: Post) -> NoSafeProgram:
    place = " ".join(short_each(worst.place, 3))
    what = (
        f"the controller rounds the corner at {place} mm by {short(worst.mm, 4)} mm, "
        f"the job allows {short(worst.allowed, 4)} mm"
    )
    remedy = remedy_for_corners(post, worst.allowed)
    return NoSafeProgram(worst.file, what, f"line {worst.line}", remedy)


def remedy_for_corners(post: Post, allowed: float) -> str:
    """The settings to change where corners are rounded by more than the distance `allowed`, mm."""
    remedy = "raise tolerance.corner"
    if hasattr(post, _PATH):
        return f"set post.path_tolerance = {short(allowed, 4)}, or {remedy}"
    return remedy
