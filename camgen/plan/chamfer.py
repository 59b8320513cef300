"""Chamfers contours: a V tool runs along them so that its cone cuts a bevel at the top edge.

A tool with the tip angle a and the tip diameter t has the radius t / 2 + h tan(a / 2) at the
height h above its tip. The tip runs beside the wall below the bevel, at a gap of `_GAP` or less if
the tool is small. So the centre of the tool is at the offset o = t / 2 + gap from the contour. A
bevel of the width w, seen from above, needs the radius o + w at the top face, which puts the tip
at the depth (gap + w) / tan(a / 2).
"""

from __future__ import annotations

import math

from msgspec import Struct

from camgen.model.errors import JobError
from camgen.model.job import Job
from camgen.model.part import Note, Part
from camgen.model.path import ToolPath
from camgen.plan.columns import compute_depths
from camgen.plan.follow import run_beside
from camgen.plan.unused import check_rules

#: Usual and minimum distance of the tip from the wall, mm. Small tools run nearer than usual.
_GAP, _MIN_GAP = 0.5, 0.1


class Bevel(Struct, frozen=True):
    """Position of the tool for a chamfer, mm.

    offset: distance of its centre from the contour.
    depth: depth of its tip below the top face.
    reach: its radius at the top face.
    """

    offset: float
    depth: float
    reach: float


def chamfer(part: Part, job: Job) -> tuple[tuple[ToolPath, ...], tuple[Note, ...]]:
    """Plan chamfers of the worked contours, on the sides that `follow` takes, with notes.

    Raises JobError for a tool that is not a V tool, and for a width that is missing or too large.
    """
    bevel = compute_bevel(job)
    depths = compute_depths(bevel.depth, job.operation.passes)
    return run_beside(part, job, bevel.offset, depths, "chamfer", bevel.reach)


def compute_bevel(job: Job) -> Bevel:
    """The position of the tool for `operation.width`. Raises JobError for unsuitable settings."""
    tool, width = job.tool, job.operation.width
    check_rules(
        [
            (
                tool.kind != "v",
                f'a tool of kind "{tool.kind}" cuts no chamfer',
                "tool.kind",
                'set tool.kind to "v"',
            ),
            (
                width is None,
                "a chamfer has a width",
                "operation.width",
                "set it, mm seen from above",
            ),
            (
                job.operation.depth != 0,
                "the depth of a chamfer follows from its width",
                "operation.depth",
                "leave it out",
            ),
            (
                job.process.force != 0,
                "a chamfer has a width, not a force",
                "process.force",
                "set process.force to 0",
            ),
            (
                job.operation.side == "on",
                "a chamfer is beside a contour",
                "operation.side",
                "choose a side, or trace it",
            ),
        ]
    )
    assert width is not None
    tip = tool.tip_diameter / 2
    room = tool.radius - tip - width
    if room < _MIN_GAP - 1e-9:
        # Rounded down: the width that the remedy names is accepted.
        accepted = math.floor((tool.radius - tip - _MIN_GAP) * 1000 + 1e-6) / 1000
        remedy = f"{accepted:g} mm at most" if accepted > 0 else "take a larger tool"
        raise JobError(
            "job",
            f"{width:g} mm is more than a V tool of {tool.diameter:g} "
            f"mm cuts, its tip {_MIN_GAP:g} mm off the wall",
            "operation.width",
            remedy,
        )
    gap = min(_GAP, room)
    half = math.radians(tool.tip_angle if tool.tip_angle is not None else 90.0) / 2
    return Bevel(tip + gap, (gap + width) / math.tan(half), tip + gap + width)
