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
    from camgen.check.collide import Clear
    from camgen.check.feeds import SlowPath
    from camgen.check.reach import Reach
    from camgen.collision.cell import Surroundings


class Checks(Struct, frozen=True, eq=False):
    """The results of the checks; without an arm there is the program alone.

    program: program, with joints, posture and shares for an arm.
    reach: joints along the program.
    clear: its clearance.
    where: bodies against which collisions were tested.
    slow: paths whose feed the joints cannot keep.
    """

    program: Program
    reach: Reach | None = None
    clear: Clear | None = None
    where: Surroundings | None = None
    slow: tuple[SlowPath, ...] = ()


def check(
    program: Program,
    job: Job,
    cell: Cell,
    where: Surroundings | None = None,
    name: str = "",
    flow: Flow | None = None,
) -> Checks:
    """Whether the arm of ``cell`` can run ``program``, links included, and meets nothing.

    where: what there is to run into, as the plan of a 3-D part knows it: the ways between its paths get blends where
    there is room with the margin. Blends along paths stay where what they round off is free. name: of the input, for
    messages. flow: of a flat part, whose ways get blends too. Blocked with the motion, the place, the reason and the
    paths it concerns, JobError for an arm that the program is not for.
    """
    if not isinstance(cell, Workcell) or cell.arm is None:
        return Checks(program)
    if isinstance(cell.home, Pose):
        from camgen.check.machine import check_machine  # noqa: PLC0415 (as below)

        result = check_machine(program, job, cell, name or program.name)
        return Checks(program, result.reach, result.clear, result.where)
    from camgen.check.collide import check_clear  # noqa: PLC0415 (fcl and kinematics, only for what needs them)
    from camgen.check.feeds import find_slow_paths  # noqa: PLC0415
    from camgen.check.flow import let_flow  # noqa: PLC0415
    from camgen.check.reach import check_reach, trace  # noqa: PLC0415
    from camgen.check.rounding import hold_clear  # noqa: PLC0415
    from camgen.check.shares import share_joints  # noqa: PLC0415
    from camgen.collision.cell import make_surroundings  # noqa: PLC0415
    from camgen.collision.motion import measure_apart  # noqa: PLC0415
    from camgen.motion.limits import limit_points  # noqa: PLC0415

    reach = check_reach(program, cell.arm, name or program.name)
    there = where or make_surroundings(job, cell, None)
    distance = partial(measure_apart, there.scene)
    course = trace(reach, cell.arm, distance, name or program.name)
    slow = tuple(find_slow_paths(reach, course, cell.arm, name or program.name))
    clear = check_clear(there, reach, course, cell.arm, name or program.name)
    program = share_joints(reach, cell, distance, limit_points(job.process))
    # Along a flat part the tool is where the job has it, fixtures near or not: what is rounded meets nothing there.
    held = where or replace(there, margin=0.0)
    program, told = hold_clear(program, reach, course, held, cell, clear.clearance)
    if where is not None:
        flow = Flow(plunge(job.process), math.inf, -math.inf)
    if flow is not None:
        # No rim is worked at the corners of links.
        strict = there if there.strict is None else replace(there, work=there.strict)
        program, notes = let_flow(program, reach, strict, cell, flow)
        told = (*told, *notes)
    return Checks(program, reach, replace(clear, notes=(*clear.notes, *told)), there, slow)
