"""Robot programs anew: what an old one does, as tool paths for another arm.

Joint values mean nothing to another arm. With ``operation.taught_on``, the arm that the program was written for, they
become the pose that they gave there. Those with which the program begins and ends are that arm's home, for which the
home of the cell stands.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from msgspec.structs import replace

from camgen.lang.taught import Reach, Taught
from camgen.model.cell import Cell
from camgen.model.errors import InputError, JobError
from camgen.model.job import Job
from camgen.model.part import Note
from camgen.model.path import ToolPath, waypoints
from camgen.model.pose import Pose, frozen, to_vec3
from camgen.model.program import Columns, Instruction, Joints, Motion, MoveC, MoveJ, MoveL, Output
from camgen.model.text import counted
from camgen.plan import ReplayPlan
from camgen.plan.unused import check_idle
from camgen.robots.models import Robot
from camgen.robots.workcell import Workcell


def plan_taught(part: Taught, job: Job, cell: Cell | None) -> ReplayPlan:
    """The program's motions as they stand in it; its paths are what it runs in lines and arcs, between motions of the
    joints. InputError for a motion to joint values that cannot be told to another arm.
    """
    check_idle(job, "a taught program")
    body, lines, notes = _without_joints(part, job, cell)
    if not any(isinstance(item, MoveJ | MoveL | MoveC) for item in body):
        raise InputError(
            part.source, "holds no motion to a pose", remedy="name its arm: operation.taught_on"
        )
    body, stops = _stop_before_others(body)
    if stops:
        what = f"{counted(stops, 'motion stops', 'motions stop')} at the end instead of blending"
        notes.append(
            Note(
                "assumed",
                what,
                "an output, a wait or the end comes next, which would act on the way",
            )
        )
    body, in_place = _drop_joint_turns(body, cell)
    if in_place:
        count = counted(in_place, "joint motion")
        what = f"{count} without the speed at which the tool turns"
        why = "joint motions of this controller have none; with cell.robot they get a share"
        notes.append(Note("skipped", what, why))
    columns = Columns(body)
    unstated = int((columns.turned & (columns.turn == 0)).sum())
    if unstated:
        turns = counted(unstated, "motion only turns", "motions only turn")
        what = f"{turns} the tool: at {job.process.turn:g} deg/s"
        notes.append(Note("assumed", what, "the text states no speed of turning for them"))
    run = replace(part.run, body=tuple(body), lines=tuple(lines))
    paths, travel = paths_of(body, lines)
    every = (*part.notes, *notes, *_tell_frames(part, job))
    return ReplayPlan(part, paths, every, run=run, travel=travel, made=paths)


def _drop_joint_turns(body: list[Instruction], cell: Cell | None) -> tuple[list[Instruction], int]:
    """Drops speeds of turning of joint motions for a controller without them.

    Returns the body and their number. With an arm they stay, and its joints get a share.
    """
    has_arm = isinstance(cell, Workcell) and cell.arm is not None
    if cell is None or cell.pace.turns or has_arm:
        return body, 0
    turns = [k for k, item in enumerate(body) if isinstance(item, MoveJ) and item.turn]
    for k in turns:
        body[k] = replace(body[k], turn=0.0)
    return body, len(turns)


def _tell_frames(part: Taught, job: Job) -> list[Note]:
    """What the text does not say of its frames, and the job does not either."""
    found = []
    for frame, given, key, what in (
        (
            part.frames.flange_from_tool,
            job.cell.flange_from_tool,
            "cell.flange_from_tool",
            f"tool {part.frames.tool}",
        ),
        (
            part.frames.base_from_work,
            job.cell.base_from_work,
            "cell.base_from_work",
            f"frame {part.frames.work}",
        ),
    ):
        if frame is None and given is None:
            found.append(
                Note(
                    "assumed",
                    f"the {what.strip()} is that of the cell",
                    f"no text says it; set {key}",
                )
            )
    return found


# Joint values.


def _without_joints(
    part: Taught, job: Job, cell: Cell | None
) -> tuple[list[Instruction], list[int], list[Note]]:
    """The body with the home of the cell for the joint values with which it begins and ends, which it may go to in
    between as well, and with poses for all others.
    """
    items = list(zip(part.run.body, part.run.lines, strict=True))
    at = {
        k: values for k, (item, _) in enumerate(items) if (values := _joints_of(item)) is not None
    }
    arm = _find_arm(job.operation.taught_on) if job.operation.taught_on else None
    own = cell.arm if isinstance(cell, Workcell) else None
    if not at or (arm is not None and own is not None and own.name == arm.name):
        return list(part.run.body), list(part.run.lines), []
    moves = [k for k, (item, _) in enumerate(items) if isinstance(item, MoveJ | MoveL | MoveC)]
    homes = {at[k] for k in (moves[0], moves[-1]) if k in at}
    inner = 0
    for k, values in at.items():
        item, line = items[k]
        if values in homes:
            assert isinstance(item, MoveJ)
            items[k] = (MoveJ(_home_of(cell), item.speed, turn=item.turn), line)
        else:
            items[k] = (replace(item, target=_pose_of(values, arm, part, cell, line)), line)
            inner += 1
    # The program begins at home anyway.
    kept = [pair for k, pair in enumerate(items) if k != moves[0] or k not in at]
    notes = (
        [_told(len(at) - inner, "values", "the home of this cell is meant")]
        if len(at) > inner
        else []
    )
    if arm is not None and inner:
        notes.append(_told(inner, f"values of {arm.name}", "it goes to where these put the tool"))
    return [item for item, _ in kept], [line for _, line in kept], notes


def _told(count: int, values: str, what: str) -> Note:
    return Note(
        "assumed",
        f"{counted(count, 'motion')} to joint {values}: {what}",
        "another arm has other joints",
    )


def _joints_of(item: Instruction) -> tuple[float, ...] | None:
    return (
        item.target.values if isinstance(item, MoveJ) and isinstance(item.target, Joints) else None
    )


def _home_of(cell: Cell | None) -> Pose | Joints:
    if cell is None:
        raise JobError(
            "cell", "is not given", remedy="the program goes home, which is that of a cell"
        )
    return cell.home


def _find_arm(name: str) -> Robot:
    from camgen.robots.catalogue import robot  # noqa: PLC0415 (only for what needs it)

    try:
        return robot(name)
    except JobError as error:
        raise JobError("job", error.what, "operation.taught_on", error.remedy) from error


def find_flange(name: str) -> Reach:
    """Where the flange of the arm ``name`` is in its base, from joint values. JobError where there is no such arm."""
    from camgen.robots.kinematics.forward import flange  # noqa: PLC0415 (only for what needs it)

    arm = _find_arm(name)

    def reach(values: Sequence[float]) -> Pose | None:
        if len(values) != len(arm.joints):
            return None
        rotation, origin = flange(arm, np.array([values]))
        return Pose(frozen(rotation[0]), to_vec3(origin[0]))

    return reach


def _pose_of(
    values: tuple[float, ...], arm: Robot | None, part: Taught, cell: Cell | None, line: int
) -> Pose:
    """Where ``arm`` puts the tool, in the work frame. InputError where no arm is known, or it has other joints."""
    if arm is None:
        what = "goes to joint values, which say nothing to another arm"
        remedy = 'name the arm that it was written for: operation.taught_on = "abb_irb120"'
        raise InputError(part.source, what, f"line {line}", remedy)
    flange = find_flange(arm.name)(values)
    if flange is None:
        what = f"{counted(len(values), 'joint value')}, and {arm.name} has {len(arm.joints)}"
        raise InputError(part.source, what, f"line {line}", "name another arm: operation.taught_on")
    tool = part.frames.flange_from_tool or (cell.flange_from_tool if cell else None)
    work = part.frames.base_from_work or (cell.base_from_work if cell else None)
    if tool is None or work is None:
        raise JobError("cell", "is not given", remedy="joint values become poses in a cell")
    return work.inverse() @ flange @ tool


# Corners and paths.


def _stop_before_others(body: list[Instruction]) -> tuple[list[Instruction], int]:
    """The body with stops before instructions that are not motions, and their number.

    The program for the new arm switches outputs on after the first motion if the text does so
    before it. Then the first motion stops too.
    """
    moving = [isinstance(item, MoveJ | MoveL | MoveC) for item in body]
    first = moving.index(True)
    waiting = any(isinstance(item, Output) and item.value for item in body[:first])
    stopped, stops = list(body), 0
    for k, item in enumerate(body):
        if not isinstance(item, MoveJ | MoveL | MoveC) or item.blend == 0:
            continue
        is_followed = k + 1 < len(body) and moving[k + 1]
        if not is_followed or (k == first and waiting):
            stopped[k] = replace(item, blend=0.0)
            stops += 1
    return stopped, stops


def stretches(moves: Sequence[Motion]) -> list[tuple[int, int]]:
    """What is run in lines and arcs: from the motion of the joints before, if that goes to a pose, to before the next
    one.
    """
    if not moves:
        return []
    cuts = [0, *(k for k, move in enumerate(moves) if k and isinstance(move, MoveJ)), len(moves)]
    found = [
        (low if isinstance(moves[low].target, Pose) else low + 1, high)
        for low, high in pairwise(cuts)
    ]
    return [(low, high) for low, high in found if high - low > 1]


def paths_of(
    body: Sequence[Instruction], lines: Sequence[int]
) -> tuple[tuple[ToolPath, ...], float]:
    """The stretches as paths, and mm of the motions of the joints."""
    every = zip(body, lines, strict=True)
    pairs = [(item, n) for item, n in every if isinstance(item, MoveJ | MoveL | MoveC)]
    moves, at = [item for item, _ in pairs], [n for _, n in pairs]
    found = stretches(moves)
    paths = tuple(_path(k, at[low + 1], moves[low:high]) for k, (low, high) in enumerate(found, 1))
    return paths, math.fsum(_apart(a, b) for a, b in pairwise(moves) if isinstance(b, MoveJ))


def _apart(a: Motion, b: Motion) -> float:
    if not isinstance(a.target, Pose) or not isinstance(b.target, Pose):
        return 0.0
    return math.dist(a.target.origin, b.target.origin)


def _path(number: int, line: int, rows: Sequence[Motion]) -> ToolPath:
    count = len(rows)
    poses = [row.target for row in rows if isinstance(row.target, Pose)]
    via = [
        row.via.origin if isinstance(row, MoveC) and k else (math.nan,) * 3
        for k, row in enumerate(rows)
    ]
    feed = [rows[max(k, 1)].speed for k in range(count)]
    return ToolPath(
        id=f"n{number}",
        layer=f"line {line}",
        table=waypoints(
            position=np.array([pose.origin for pose in poses]),
            via=via,
            axis=[pose.rotation[:, 2] for pose in poses],
            feed=feed,
        ),
        closed=False,
        reversible=False,
        operation="replay",
    )
