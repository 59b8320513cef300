"""The proof of motion of a build: what the printed texts, read back, do along the drawing."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from msgspec.structs import replace

from camgen.check import proof
from camgen.check.proof import Controller, MotionProof
from camgen.model.errors import VerifyError
from camgen.model.job import Job
from camgen.model.part import Note, Part
from camgen.model.program import Columns, Instruction, Joints
from camgen.model.text import counted
from camgen.plan import Plan, ReplayPlan
from camgen.post.plugins import dynamics_of
from camgen.robots.workcell import Workcell

if TYPE_CHECKING:
    from camgen.pipeline.programs import PostedPrograms, Request
    from camgen.post import Post

#: Rounding of a text, mm and mm/s, and rad, whose digits are not known.
_DIGIT_MM, _DIGIT_RAD = 1e-3, math.radians(1e-3)
_REMEDY = "do not run the program: camgen or one of its plug-ins planned it wrong; please report it"


def prove_motion(
    part: Part,
    plan: Plan,
    request: Request,
    posted: PostedPrograms,
    notes: Sequence[Note],
) -> MotionProof:
    """Compares the motions of the texts with the drawing.

    part: the drawing as it was read, before planning.
    notes: all notes of the build.
    Raises VerifyError for the first motion that is not what drawing and job ask for.
    """
    job = request.job
    if isinstance(plan, ReplayPlan):
        reason = "the input is a program, its motions are compared with the text alone"
        return proof.MotionProof(0, 0.0, 0, (), (reason,))
    programs = []
    for text in posted.texts:
        path, origins = text.program.columns.path, text.program.paths
        body, lines = text.executed.body, text.executed.lines
        programs.append(proof.Program(body, lines, path, origins, text.name))
    tolerance = posted.tolerance
    rounding = proof.Rounding(tolerance.mm, tolerance.speed, tolerance.joint)
    controller = describe_controller(posted.texts[0].post, job, request.cell)
    result = proof.prove_motion(part, job, programs, notes, rounding, controller)
    if part.raster is not None:
        # Borders of a picture are planned with less than a pixel of freedom, in ways of their own.
        return _report_picture(result)
    for file, finding in result.findings[:1]:
        more = len(result.findings) - 1
        what = finding.text + (f", and {more} more like it" if more else "")
        raise VerifyError(
            file, f"the text is not what the drawing asks for: {what}", finding.line, _REMEDY
        )
    return result


def _report_picture(result: MotionProof) -> MotionProof:
    """The proof of a picture: a difference from its borders is reported, not refused."""
    reasons = [*result.unproven]
    for _, finding in result.findings[:1]:
        reasons.append(f"against the borders in the picture, {finding.text}")
    return replace(result, findings=(), unproven=tuple(reasons))


def compare_text(
    part: Part,
    job: Job,
    body: Sequence[Instruction],
    lines: Sequence[int],
    place: Callable[[int], str],
    controller: Controller | None,
) -> str:
    """The result of the proof for a text that was not built here, as a line of the summary.

    place: names file and line of a line that is counted through all files.
    controller: the controller of the text. None for a text of another hand: it is not known.
    """
    from camgen.check import proof  # noqa: PLC0415 (shapely, only for this)

    if job.operations:
        return "not proven: the text does not say which motion belongs to which operation"
    columns = Columns(body)
    signal = proof.process_signal(job.process)
    unknown = []
    if signal not in {"", *(output.signal for output in columns.outputs)}:
        unknown.append(f"output {signal}: the text names none so")
        job = replace(job, process=replace(job.process, signal=""))
    path = np.full(len(columns.at), -1, np.intp)
    program = proof.Program(body, lines, path, (), "")
    # The number of digits of a text of another hand is not known: a thousandth is usual.
    rounding = proof.Rounding(_DIGIT_MM, _DIGIT_MM, _DIGIT_RAD)
    if controller is None:
        unknown.append("rounded corners: it is not known how the controller passes them")
    result = proof.prove_motion(part, job, [program], (), rounding, controller)
    what = f"{counted(result.contours, 'contour')} in {format_motions(result)}"
    if not result.findings:
        reasons = "; ".join([*unknown, *list_reasons(result, controller is not None)])
        return f"{what}; not proven: {reasons}" if reasons else f"verified: {what}"
    _, first = result.findings[0]
    where = f"{place(first.line)}: " if first.line else ""
    more = counted(len(result.findings), "difference")
    return f"not proven: {more} from what the job asks for, first {where}{first.text}"


def format_motions(result: MotionProof) -> str:
    """The numbers of motions as text: those compared with the drawing, and those by their ends."""
    what = counted(result.motions, "motion")
    if result.unplaced.at_home:
        what += f" and {result.unplaced.at_home} to or from home"
    if result.unplaced.begins:
        what += f" and {result.unplaced.begins} from where the machine stands"
    return what


def list_reasons(result: MotionProof, knows_home: bool = True) -> tuple[str, ...]:
    """Why a proof without findings is not complete, empty if it is.

    knows_home: whether the proof knew the rest position.
    """
    elsewhere = result.unplaced.elsewhere
    if not elsewhere:
        return result.unproven
    what = f"{counted(elsewhere, 'motion')} to or from joint values"
    what += " other than those of home" if knows_home else ", since home is not known"
    return (*result.unproven, what)


def describe_controller(post: Post, job: Job, cell: Workcell) -> Controller:
    """The controller of the texts of a post, as far as the proof has to know it."""
    home = cell.home if isinstance(cell.home, Joints) else None
    return Controller(dynamics_of(post, job), frozenset(post.list_verified()), home)
