"""Curves in space, followed as they are: by an arm with its tool as asked for, or as motions of three axes."""

from __future__ import annotations

import math

import numpy as np

from camgen.model.cell import Cell
from camgen.model.errors import JobError
from camgen.model.job import Job
from camgen.model.part import Curve, Part
from camgen.model.path import ToolPath, waypoints
from camgen.model.pose import TOOL_DOWN
from camgen.model.program import Joints
from camgen.model.text import short
from camgen.plan import Plan, Watch
from camgen.plan.columns import pass_depths
from camgen.plan.unused import check_idle

#: rad: an axis that leans by no more is straight down.
_UPRIGHT = math.radians(1e-4)


def plan_space(part: Part, job: Job, cell: Cell | None, watch: Watch) -> Plan:
    """What follows the curves of ``part`` in the cell. JobError where it is not known, or cannot do what is asked."""
    if cell is None:
        raise JobError(
            "cell", "is not given", remedy="who follows curves in space decides how: give the cell"
        )
    if isinstance(cell.home, Joints):
        from camgen.plan.edges.curves import plan_curves  # noqa: PLC0415 (fcl and kinematics, only for what needs them)

        check_idle(job, "curves in space")
        return plan_curves(part, job, cell, watch)
    check_idle(job, "curves in space on a machine without an arm")
    _insist_on_three_axes(part, job)
    return Plan(part, tuple(_path(curve, job) for curve in part.curves), part.notes)


def _insist_on_three_axes(part: Part, job: Job) -> None:
    """JobError for a tool that would have to lean, and for travel through the curves."""
    from camgen.plan.edges.stand import choose_axis, fixed_rotation  # noqa: PLC0415 (only for curves in space)

    if part.solid is not None:
        what = "a machine of three axes is not tested against a part"
        raise JobError(
            "job",
            what,
            "--post",
            f"leave {part.solid.source} out, or give rapid, pacscript or vplus",
        )
    for curve in part.curves:
        axis = choose_axis(curve, job)
        if axis == "normal":
            raise JobError(
                "job", '"normal" needs an arm', "tool.axis", "give rapid, pacscript or vplus"
            )
        turned = (
            curve.rotations
            if axis == "given" and curve.rotations is not None
            else fixed_rotation(job)[None]
        )
        # A turn about the axis is none to a tool that spins.
        lean = np.arccos(np.clip(turned[:, :, 2] @ TOOL_DOWN[:, 2], -1.0, 1.0))
        if lean.max() > _UPRIGHT:
            what = f"a machine of three axes keeps its tool straight down, curve {curve.id} leans it by"
            key = "tool.axis" if axis == "given" else "tool.angles"
            remedy = 'set tool.axis to "fixed", or give rapid, pacscript or vplus'
            raise JobError(
                "job", f"{what} {short(math.degrees(float(lean.max())), 2)} deg", key, remedy
            )
    top = max(float(np.concatenate([c.points[:, 2], c.middles[:, 2]]).max()) for c in part.curves)
    if top + job.process.approach > job.process.clearance:
        what = f"{short(job.process.clearance, 3)} mm is below where the tool approaches the curves, which reach up to"
        remedy = f"set it to {short(math.ceil(top + job.process.approach), 3)} or more"
        raise JobError("job", f"{what} z = {short(top, 3)}", "process.clearance", remedy)


def _path(curve: Curve, job: Job) -> ToolPath:
    """The tool straight down along ``curve``. One that is closed begins where it is drawn: it is run as an open one."""
    return ToolPath(
        id=curve.id,
        layer=curve.layer,
        table=waypoints(
            position=curve.points,
            via=np.concatenate([np.full((1, 3), np.nan), curve.via]),
            force_direction=[0.0, 0.0, -1.0 if job.process.force else 0.0],
            force=job.process.force,
            feed=job.process.feed,
        ),
        closed=False,
        depths=pass_depths(job.operation.depth, job.operation.passes),
        contours=(curve.id,),
        operation="trace",
    )
