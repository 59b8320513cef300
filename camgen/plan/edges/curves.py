"""Curves in space for an arm: as the edges of a 3-D part, with the tool as the job or the points say."""

from __future__ import annotations

import numpy as np

from camgen.collision.cell import Surroundings, around
from camgen.geometry.surface import nearest
from camgen.model.cell import Cell
from camgen.model.errors import InputError, JobError
from camgen.model.job import Job
from camgen.model.limits import tell
from camgen.model.part import Note, Part
from camgen.model.text import counted, short
from camgen.plan import EdgePlan, Watch
from camgen.plan.edges import LineTask, plan_ways
from camgen.plan.edges.stand import choose_axis, stand
from camgen.robots.workcell import Workcell

#: mm: a curve that is farther from the part is not on it.
_ON_IT = 0.01


def plan_curves(part: Part, job: Job, cell: Cell, watch: Watch) -> EdgePlan:
    """The motions along the curves of ``part`` that the arm of ``cell`` reaches, a path each.

    JobError for a cell without an arm and settings that do not go together, InputError for too many curves,
    NoSafeProgram where none can be followed.
    """
    if not isinstance(cell, Workcell) or cell.arm is None:
        what = "an arm follows curves in space only where it is known"
        raise JobError(
            "job", what, "cell.robot", "name it: camgen robots lists those that there are"
        )
    if job.tour.method == "as-drawn":
        raise JobError(
            "job",
            "an arm takes curves in space in its own order",
            "tour.method",
            'set it to "best"',
        )
    if len(part.curves) > job.limits.edges:
        what = f"{counted(len(part.curves), 'curve')} in space, more than {tell(job.limits.edges)}"
        raise InputError(
            part.source, what, remedy="build them in several programs, or raise limits.edges"
        )
    ways = [(curve, stand(curve, job, part.solid)) for curve in part.curves]
    points = np.concatenate(
        [column for curve in part.curves for column in (curve.points, curve.middles)]
    )

    def surround(other: Job, tip: float) -> Surroundings:
        return around(other, cell, part.solid, tip, beside=points)

    task = LineTask(ways, surround, _note_faces(part, job), "curve")
    return plan_ways(part, job, cell, watch, task)


def _note_faces(part: Part, job: Job) -> tuple[Note, ...]:
    """How far the curves are from the part whose faces the tool is square to."""
    solid = part.solid
    square = [curve for curve in part.curves if choose_axis(curve, job) == "normal"]
    if solid is None or not square:
        return ()
    apart = {curve.id: float(nearest(solid, curve.points).apart.max()) for curve in square}
    far = tuple(name for name, way in apart.items() if way > _ON_IT)
    if not far:
        return ()
    what = (
        f"{counted(len(far), 'curve')} up to {short(max(apart.values()), 3)} mm off {solid.source}"
    )
    return (Note("assumed", what, "the tool is square to the nearest face, wherever that is", far),)
