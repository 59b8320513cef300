"""Chamfers: a V tool beside the contours, so that its cone takes the top edge off.

At the height h above its tip a tool with the whole angle a and the flat t across its tip has the radius
t / 2 + h tan(a / 2). The tip runs ``_GAP`` beside the wall, below the bevel, or nearer where the tool is small: the
centre at the offset o = t / 2 + gap from the contour. For a bevel of the width w, seen from above, the cone has the
radius o + w at the top face, so that the tip is at the depth (gap + w) / tan(a / 2).
"""

from __future__ import annotations

import math

from msgspec import Struct

from camgen.model.errors import JobError
from camgen.model.job import Job
from camgen.model.part import Note, Part
from camgen.model.path import ToolPath
from camgen.plan.columns import pass_depths
from camgen.plan.follow import run_beside

#: The tip runs so far beside the wall, mm, or nearer where the tool is small, but no nearer than the least.
_GAP, _LEAST_GAP = 0.5, 0.1


class Bevel(Struct, frozen=True):
    """Where the tool runs for a chamfer, mm. offset: of its centre from the contour. depth: of its tip below the top
    face. reach: its radius at the top face.
    """

    offset: float
    depth: float
    reach: float


def chamfer(part: Part, job: Job) -> tuple[tuple[ToolPath, ...], tuple[Note, ...]]:
    """Paths that chamfer the contours worked on, on the sides that ``follow`` takes, and what could not be.

    Raises JobError for another tool, a missing width, or a width that the tool has not.
    """
    bevel = lay_bevel(job)
    depths = pass_depths(bevel.depth, job.operation.passes)
    return run_beside(part, job, bevel.offset, depths, "chamfer", bevel.reach)


def lay_bevel(job: Job) -> Bevel:
    """How the tool runs for ``operation.width``. JobError."""
    tool, width = job.tool, job.operation.width
    if tool.kind != "v":
        raise JobError(
            "job",
            f'a tool of kind "{tool.kind}" cuts no chamfer',
            "tool.kind",
            'set tool.kind to "v"',
        )
    if width is None:
        raise JobError(
            "job", "a chamfer has a width", "operation.width", "set it, mm seen from above"
        )
    if job.operation.depth:
        what = "the depth of a chamfer follows from its width"
        raise JobError("job", what, "operation.depth", "leave it out")
    if job.process.force:
        raise JobError(
            "job", "a chamfer has a width, not a force", "process.force", "set process.force to 0"
        )
    if job.operation.side == "on":
        raise JobError(
            "job", "a chamfer is beside a contour", "operation.side", "choose a side, or trace it"
        )
    tip = tool.tip_diameter / 2
    room = tool.radius - tip - width
    if room < _LEAST_GAP - 1e-9:
        most = tool.radius - tip - _LEAST_GAP
        what = (
            f"{width:g} mm is more than a V tool of {tool.diameter:g} "
            f"mm cuts, its tip {_LEAST_GAP:g} mm off the wall"
        )
        remedy = f"{most:.4g} mm at most" if most > 0 else "take a larger tool"
        raise JobError("job", what, "operation.width", remedy)
    gap = min(_GAP, room)
    half = math.radians(tool.tip_angle if tool.tip_angle is not None else 90.0) / 2
    return Bevel(tip + gap, (gap + width) / math.tan(half), tip + gap + width)
