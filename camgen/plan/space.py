"""Plans curves in space, for an arm with a given tool axis or for a machine of three axes."""

from __future__ import annotations

import math

import numpy as np

from camgen.model.cell import Cell
from camgen.model.errors import JobError
from camgen.model.job import Job
from camgen.model.part import Curve, Part
from camgen.model.path import ToolPath, make_waypoints
from camgen.model.pose import TOOL_DOWN
from camgen.model.program import Joints
from camgen.model.text import short
from camgen.plan import Plan, Watch
from camgen.plan.columns import compute_depths
from camgen.plan.unused import check_idle

#: Largest tilt of a tool that counts as straight down, rad.
_UPRIGHT = math.radians(1e-4)


def plan_space(part: Part, job: Job, cell: Cell | None, watch: Watch) -> Plan:
    """Plan the paths along the curves of `part`.

    Raises JobError without a cell, and for settings that the machine of the cell cannot run.
    """
    if cell is None:
        raise JobError(
            "cell",
            "is not given",
            remedy="curves in space need the machine that follows them: give the cell",
        )
    if isinstance(cell.home, Joints):
        from camgen.plan.edges.curves import plan_curves  # noqa: PLC0415 (it loads fcl)

        check_idle(job, "curves in space")
        return plan_curves(part, job, cell, watch)
    check_idle(job, "curves in space on a machine without an arm")
    _check_three_axes(part, job)
    return Plan(part, tuple(_make_path(curve, job) for curve in part.curves), part.notes)


def _check_three_axes(part: Part, job: Job) -> None:
    from camgen.plan.edges.stand import choose_axis, fixed_rotation  # noqa: PLC0415 (rarely needed)

    if part.solid is not None:
        raise JobError(
            "job",
            "a machine of three axes is not tested against a part",
            "--post",
            f"leave {part.solid.source} out, or give rapid, pacscript or vplus",
        )
    for curve in part.curves:
        axis = choose_axis(curve, job)
        if axis == "normal":
            raise JobError(
                "job", '"normal" needs an arm', "tool.axis", "give rapid, pacscript or vplus"
            )
        given = curve.rotations if axis == "given" else None
        rotations = fixed_rotation(job)[None] if given is None else given
        # The roll of a spinning tool has no meaning.
        tilt = np.arccos(np.clip(rotations[:, :, 2] @ TOOL_DOWN[:, 2], -1.0, 1.0))
        if tilt.max() > _UPRIGHT:
            degrees = short(math.degrees(float(tilt.max())), 2)
            subject = "a machine of three axes keeps its tool straight down"
            raise JobError(
                "job",
                f"{subject}, curve {curve.id} leans it by {degrees} deg",
                "tool.axis" if axis == "given" else "tool.angles",
                'set tool.axis to "fixed", or give rapid, pacscript or vplus',
            )
    top = max(float(np.concatenate([c.points[:, 2], c.middles[:, 2]]).max()) for c in part.curves)
    if top + job.process.approach > job.process.clearance:
        clearance = f"{short(job.process.clearance, 3)} mm"
        subject = "where the tool approaches the curves, which reach up to"
        raise JobError(
            "job",
            f"{clearance} is below {subject} z = {short(top, 3)}",
            "process.clearance",
            f"set it to {short(math.ceil(top + job.process.approach), 3)} or more",
        )


def _make_path(curve: Curve, job: Job) -> ToolPath:
    """The tool straight down along `curve`. A closed curve keeps its start, as an open path."""
    return ToolPath(
        id=curve.id,
        layer=curve.layer,
        table=make_waypoints(
            position=curve.points,
            via=np.concatenate([np.full((1, 3), np.nan), curve.via]),
            force_direction=[0.0, 0.0, -1.0 if job.process.force else 0.0],
            force=job.process.force,
            feed=job.process.feed,
        ),
        closed=False,
        depths=compute_depths(job.operation.depth, job.operation.passes),
        contours=(curve.id,),
        operation="trace",
    )
