"""Notes on what a build takes for granted about the set-up."""

from __future__ import annotations

from camgen.model.job import Job
from camgen.model.part import Note, Part
from camgen.read.recorded import Recorded
from camgen.robots.workcell import Workcell


def note_arm(part: Part, job: Job, cell: Workcell) -> tuple[Note, ...]:
    """The arm of a part in space, if the job names none."""
    if cell.arm is None or job.cell.robot or isinstance(part, Recorded):
        return ()
    what = f"the arm is the {cell.arm.name} of the built-in cell"
    return (Note("assumed", what, "set cell.robot to yours; camgen robots lists the arms"),)
