"""Robot programs anew: what an old one does, as tool paths for another arm.

Joint values mean nothing to another arm. With ``operation.taught_on``, the arm that the program was written for, they
become the pose that they gave there; without it they stand for that arm's home, and only before the first motion to a
pose and after the last.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from msgspec.structs import replace

from camgen.model.cell import Cell
from camgen.model.errors import InputError, JobError
from camgen.model.job import Job
from camgen.model.part import Note
from camgen.model.path import ToolPath
from camgen.model.pose import Pose, Vec3, frozen
from camgen.model.program import Instruction, Joints, Motion, MoveC, MoveJ, MoveL
from camgen.model.text import counted
from camgen.plan import ReplayPlan
from camgen.plan.unused import no_idle
from camgen.read.taught import Taught
from camgen.robots.models import Robot
from camgen.robots.workcell import Workcell


def plan_taught(part: Taught, job: Job, cell: Cell | None) -> ReplayPlan:
    """The program's motions as they stand in it; its paths are what it runs in lines and arcs, between motions of the
    joints. InputError for a motion to joint values that cannot be told to another arm.
    """
    no_idle(job, "a taught program")
    body, lines, notes = _without_joints(part, job, cell)
    if not any(isinstance(item, MoveJ | MoveL | MoveC) for item in body):
        raise InputError(part.source, "holds no motion to a pose", remedy="name its arm: operation.taught_on")
    body, stops = _stop_before_others(body)
    if stops:
        what = f"{counted(stops, 'motion stops', 'motions stop')} at the end instead of blending"
        notes.append(Note("assumed", what, "an output, a wait or the end comes next, which would act on the way"))
    run = replace(part.run, body=tuple(body), lines=tuple(lines))
    paths, travel = paths_of(body, lines)
    every = (*part.notes, *notes, *_tell_frames(part, job))
    return ReplayPlan(part, paths, every, run=run, travel=travel, made=paths)


def _tell_frames(part: Taught, job: Job) -> list[Note]:
    """What the text does not say of its frames, and the job does not either."""
    found = []
    for frame, given, key, what in (
        (part.frames.flange_from_tool, job.cell.flange_from_tool, "cell.flange_from_tool", f"tool {part.frames.tool}"),
        (part.frames.base_from_work, job.cell.base_from_work, "cell.base_from_work", f"frame {part.frames.work}"),
    ):
        if frame is None and given is None:
            found.append(Note("assumed", f"the {what.strip()} is that of the cell", f"no text says it; set {key}"))
    return found


# Joint values.


def _without_joints(part: Taught, job: Job, cell: Cell | None) -> tuple[list[Instruction], list[int], list[Note]]:
    """The body with poses for the joint values of the arm that it was taught on."""
    items = list(zip(part.run.body, part.run.lines, strict=True))
    at = [k for k, (item, _) in enumerate(items) if isinstance(item, MoveJ) and isinstance(item.target, Joints)]
    if not at:
        return list(part.run.body), list(part.run.lines), []
    if job.operation.taught_on:
        arm = _find_arm(job.operation.taught_on)
        own = cell.arm if isinstance(cell, Workcell) else None
        if own is not None and own.name == arm.name:
            return list(part.run.body), list(part.run.lines), []
        for k in at:
            item, line = items[k]
            if isinstance(item, MoveJ) and isinstance(item.target, Joints):
                items[k] = (replace(item, target=_pose_of(item.target, arm, part, cell, line)), line)
        what = f"{counted(len(at), 'motion')} to joint values of {arm.name} become motions to where these put the tool"
        return [i for i, _ in items], [n for _, n in items], [Note("assumed", what, "another arm has other joints")]
    posed = [k for k, (item, _) in enumerate(items) if _is_posed(item)]
    inner = [k for k in at if posed and posed[0] < k < posed[-1]]
    if inner or not posed:
        what = "goes to joint values, which say nothing to another arm"
        remedy = 'name the arm that it was written for: operation.taught_on = "abb_irb120"'
        raise InputError(part.source, what, f"line {items[(inner or at)[0]][1]}", remedy)
    last = at[-1] if at[-1] > posed[-1] else -1
    if last >= 0:
        if cell is None:
            raise JobError("cell", "is not given", remedy="the program ends at home, which is that of a cell")
        items[last] = (replace(items[last][0], target=cell.home), items[last][1])
    kept = [pair for k, pair in enumerate(items) if k == last or k not in set(at)]
    what = f"{counted(len(at), 'motion')} to joint values at the start and the end: the home of this cell stands for it"
    return [i for i, _ in kept], [n for _, n in kept], [Note("assumed", what, "or name operation.taught_on")]


def _is_posed(item: Instruction) -> bool:
    return isinstance(item, MoveJ | MoveL | MoveC) and isinstance(item.target, Pose)


def _find_arm(name: str) -> Robot:
    from camgen.robots.catalogue import robot  # noqa: PLC0415 (only for what needs it)

    try:
        return robot(name)
    except JobError as error:
        raise JobError("job", error.what, "operation.taught_on", error.remedy) from error


def _pose_of(target: Joints, arm: Robot, part: Taught, cell: Cell | None, line: int) -> Pose:
    """Where ``arm`` puts the tool, in the work frame."""
    from camgen.robots.kinematics.forward import flange  # noqa: PLC0415 (only for what needs it)

    if len(target.values) != len(arm.joints):
        what = f"{counted(len(target.values), 'joint value')}, and {arm.name} has {len(arm.joints)}"
        raise InputError(part.source, what, f"line {line}", "name another arm: operation.taught_on")
    tool = part.frames.flange_from_tool or (cell.flange_from_tool if cell else None)
    work = part.frames.base_from_work or (cell.base_from_work if cell else None)
    if tool is None or work is None:
        raise JobError("cell", "is not given", remedy="joint values become poses in a cell")
    rotation, origin = flange(arm, np.array([target.values]))
    return work.inverse() @ Pose(frozen(rotation[0]), _point(origin[0].tolist())) @ tool


def _point(values: list[float]) -> Vec3:
    x, y, z = values
    return (x, y, z)


# Corners and paths.


def _stop_before_others(body: list[Instruction]) -> tuple[list[Instruction], int]:
    """The body with stops where something else than a motion follows, and how many."""
    found, stops = list(body), 0
    for k, item in enumerate(body):
        if isinstance(item, MoveJ | MoveL | MoveC) and item.blend > 0:
            following = body[k + 1] if k + 1 < len(body) else None
            if not isinstance(following, MoveJ | MoveL | MoveC):
                found[k] = replace(item, blend=0.0)
                stops += 1
    return found, stops


def stretches(moves: Sequence[Motion]) -> list[tuple[int, int]]:
    """What is run in lines and arcs: from the motion of the joints before, if that goes to a pose, to before the next
    one.
    """
    cuts = [0, *(k for k, move in enumerate(moves) if k and isinstance(move, MoveJ)), len(moves)]
    found = [(low if isinstance(moves[low].target, Pose) else low + 1, high) for low, high in pairwise(cuts)]
    return [(low, high) for low, high in found if high - low > 1]


def paths_of(body: Sequence[Instruction], lines: Sequence[int]) -> tuple[tuple[ToolPath, ...], float]:
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
    via = [row.via.origin if isinstance(row, MoveC) and k else (math.nan,) * 3 for k, row in enumerate(rows)]
    feed = [rows[max(k, 1)].speed for k in range(count)]
    return ToolPath(
        id=f"n{number}",
        layer=f"line {line}",
        position=frozen([pose.origin for pose in poses]),
        via=frozen(via),
        axis=frozen([pose.rotation[:, 2] for pose in poses]),
        force_direction=frozen(np.zeros((count, 2, 3))),
        force=frozen(np.zeros(count)),
        feed=frozen(feed),
        closed=False,
        reversible=False,
        operation="replay",
    )
