"""Plans curves in space for an arm, with the tool oriented by the job or by the points."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import compress

import numpy as np

from camgen.collision.cell import CellScene, make_cell_scene
from camgen.geometry.surface import find_nearest
from camgen.model.cell import Cell
from camgen.model.errors import InputError, JobError
from camgen.model.job import Job
from camgen.model.limits import format_limit
from camgen.model.part import Note, Part, list_ids
from camgen.model.pose import FloatArray
from camgen.model.text import counted, short
from camgen.plan import EdgePlan, Watch
from camgen.plan.edges import LineTask, plan_lines
from camgen.plan.edges.stand import choose_axis, plan_orientation
from camgen.robots.workcell import Workcell

#: Distance from the part beyond which a curve does not lie on it, mm.
_ON_IT = 0.01


def plan_curves(part: Part, job: Job, cell: Cell, watch: Watch) -> EdgePlan:
    """The motions along the curves of `part` that the arm of `cell` reaches, one path for each.

    Raises JobError for a cell without an arm and for settings that contradict each other,
    InputError for too many curves, NoSafeProgram if none can be followed.
    """
    if not isinstance(cell, Workcell) or cell.arm is None:
        raise JobError(
            "job",
            "an arm that follows curves in space has to be known",
            "cell.robot",
            "name it: camgen robots lists all",
        )
    if job.tour.method == "as-drawn":
        raise JobError(
            "job",
            "an arm takes curves in space in its own order",
            "tour.method",
            'set it to "best"',
        )
    if len(part.curves) > job.limits.edges:
        count = counted(len(part.curves), "curve")
        raise InputError(
            part.source,
            f"{count} in space, more than {format_limit(job.limits.edges)}",
            remedy="build them in several programs, or raise limits.edges",
        )
    lines = [(curve, plan_orientation(curve, job, part.solid)) for curve in part.curves]
    chains: list[FloatArray] = []
    for curve in part.curves:
        chains += curve.points, curve.middles
    points = np.concatenate(chains)

    def surround(other: Job, tip: float) -> CellScene:
        return make_cell_scene(other, cell, part.solid, tip, worked=points)

    return plan_lines(
        part, job, cell, watch, LineTask(lines, surround, _note_faces(part, job), "curve")
    )


def _note_faces(part: Part, job: Job) -> Iterator[Note]:
    solid = part.solid
    square = [curve for curve in part.curves if choose_axis(curve, job) == "normal"]
    if solid is None or not square:
        return
    distances = np.array([find_nearest(solid, curve.points).distance.max() for curve in square])
    far = list_ids(compress(square, distances > _ON_IT))
    if far:
        largest = short(float(distances.max()), 3)
        yield Note(
            "assumed",
            f"{counted(len(far), 'curve')} up to {largest} mm off {solid.source}",
            "the tool is square to the nearest face, wherever that is",
            far,
        )
