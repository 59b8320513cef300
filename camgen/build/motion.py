"""The proof of motion of a build: what the printed texts, read back, do along the drawing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from camgen.model.errors import VerifyError
from camgen.model.job import Job
from camgen.model.part import Note, Part
from camgen.plan import Plan, ReplayPlan

if TYPE_CHECKING:
    from camgen.build.programs import Checked, Posted
    from camgen.check.proof import MotionProof

_REMEDY = "do not run the program: camgen or one of its plug-ins planned it wrong; please report it"


def prove_motion(
    part: Part, plan: Plan, job: Job, checked: Checked, posted: Posted, notes: Sequence[Note]
) -> MotionProof:
    """Compares the motions of the texts with the drawing.

    part: the drawing as it was read, before planning.
    notes: all notes of the build.
    Raises VerifyError for the first motion that is not what drawing and job ask for.
    """
    from camgen.check import proof  # noqa: PLC0415 (shapely, after planning has loaded it)

    if reason := why_unproven(plan):
        return proof.MotionProof(0, 0.0, 0, 0, (), (reason,))
    programs = []
    first = 0
    for count, reading, (_, program) in zip(
        posted.counts, posted.readings, checked.programs, strict=True
    ):
        file = posted.files[first].name
        first += count
        path = program.columns.path
        programs.append(proof.Program(reading.body, reading.lines, path, program.paths, file))
    rounding = proof.Rounding(posted.tolerance.mm, posted.tolerance.speed)
    result = proof.prove_motion(part, job, programs, notes, rounding)
    for file, finding in result.findings[:1]:
        more = len(result.findings) - 1
        what = finding.text + (f", and {more} more like it" if more else "")
        raise VerifyError(
            file, f"the text is not what the drawing asks for: {what}", finding.line, _REMEDY
        )
    return result


def why_unproven(plan: Plan) -> str:
    """Why motions are not compared with the part, empty if they are."""
    if isinstance(plan, ReplayPlan):
        return "the input is a program, its motions are compared with the text alone"
    return ""
