"""Checks of a program before it is posted: reach, collisions, time, and sums."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING

from msgspec import Struct
from msgspec.structs import replace

from camgen.lower.runs import plunge
from camgen.model.cell import Cell
from camgen.model.job import Job
from camgen.model.pose import Pose
from camgen.model.program import Program
from camgen.motion.corners import Flow
from camgen.robots.workcell import Workcell

if TYPE_CHECKING:
    from camgen.check.collide import ClearanceReport
    from camgen.check.feeds import SlowPath
    from camgen.check.reach import JointTrace
    from camgen.collision.cell import CellScene


class Checks(Struct, frozen=True, eq=False):
    """The results of the checks; without an arm there is the program alone.

    program: program, with joints, posture and shares for an arm.
    reach: joints along the program.
    clear: its clearance.
    where: bodies against which collisions were tested.
    slow: paths whose feed the joints cannot keep.
    """

    program: Program
    reach: JointTrace | None = None
    clear: ClearanceReport | None = None
    where: CellScene | None = None
    slow: tuple[SlowPath, ...] = ()


def check(
    program: Program,
    job: Job,
    cell: Cell,
    where: CellScene | None = None,
    name: str = "",
    flow: Flow | None = None,
) -> Checks:
    """Check that the arm of `cell` can run `program`, links included, without a collision.

    The corners of links get blends where they are free and keep the margin. Blends along paths
    stay, or become smaller, so that all they round off is free.

    where: bodies around a 3-D part, from its plan; None for a flat part.
    name: name of the input, for messages.
    flow: corners of links that may be rounded on a flat part; None for none.

    Raises Blocked with the motion, the position, the reason and the blocked paths. Raises JobError
    for an arm that the program is not for.
    """
    if not isinstance(cell, Workcell) or cell.arm is None:
        return Checks(program)
    if isinstance(cell.home, Pose):
        from camgen.check.machine import check_machine  # noqa: PLC0415 (as below)

        return Checks(program, *check_machine(program, job, cell, name or program.name))
    # fcl and kinematics are loaded for programs of arms only.
    from camgen.check.collide import check_clear  # noqa: PLC0415
    from camgen.check.feeds import find_slow_paths  # noqa: PLC0415
    from camgen.check.flow import blend_links  # noqa: PLC0415
    from camgen.check.reach import check_reach, trace_joints  # noqa: PLC0415
    from camgen.check.rounding import reduce_blends  # noqa: PLC0415
    from camgen.check.shares import share_joints  # noqa: PLC0415
    from camgen.collision.cell import make_cell_scene  # noqa: PLC0415
    from camgen.collision.motion import measure_apart  # noqa: PLC0415
    from camgen.motion.limits import limit_points  # noqa: PLC0415

    reach = check_reach(program, cell.arm, name or program.name)
    surroundings = where or make_cell_scene(job, cell, None)
    distance = partial(measure_apart, surroundings.scene)
    joint_path = trace_joints(reach, cell.arm, distance, name or program.name)
    slow = tuple(find_slow_paths(reach, joint_path, cell.arm, name or program.name))
    clear = check_clear(surroundings, reach, joint_path, cell.arm, name or program.name)
    program = share_joints(reach, cell, distance, limit_points(job.process))
    # The paths of a flat part may be nearer to fixtures than the margin, as the job states them.
    # So their corners are tested without the margin.
    along_paths = where or replace(surroundings, margin=0.0)
    program, notes = reduce_blends(program, reach, joint_path, along_paths, cell, clear.clearance)
    notes = (*clear.notes, *notes)
    if where is not None:
        flow = Flow(plunge(job.process), math.inf, -math.inf)
    if flow is not None:
        # No rim is worked at the corners of links.
        strict = surroundings
        if strict.strict is not None:
            strict = replace(strict, work=strict.strict)
        program, link_notes = blend_links(program, reach, strict, cell, flow)
        notes = (*notes, *link_notes)
    return Checks(program, reach, replace(clear, notes=notes), surroundings, slow)
