"""Turns a robot program into tool paths for another arm.

Joint values mean nothing to another arm. With `operation.taught_on`, the arm for which the program
was written, they become poses. The joint values with which the program starts and ends are the
home of that arm; the home of the cell replaces them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from msgspec.structs import replace

from camgen.lang.taught import Reach, TaughtProgram
from camgen.model.cell import Cell
from camgen.model.errors import InputError, JobError
from camgen.model.job import Job
from camgen.model.part import Note
from camgen.model.path import ToolPath, make_waypoints
from camgen.model.pose import Pose, frozen, to_vec3
from camgen.model.program import Columns, Instruction, Joints, Motion, MoveC, MoveJ, MoveL, Output
from camgen.model.text import counted
from camgen.plan import ReplayPlan
from camgen.plan.unused import check_idle
from camgen.robots.models import Robot
from camgen.robots.workcell import Workcell


def plan_taught(part: TaughtProgram, job: Job, cell: Cell | None) -> ReplayPlan:
    """Plan the motions of a program in its order; its lines and arcs are the paths.

    Raises InputError for a program without poses, and for joint values that cannot be converted.
    """
    check_idle(job, "a taught program")
    body, lines, notes = _replace_joints(part, job, cell)
    if not any(isinstance(item, MoveJ | MoveL | MoveC) for item in body):
        raise InputError(
            part.source, "holds no motion to a pose", remedy="name its arm: operation.taught_on"
        )
    body, stops = _stop_before_others(body)
    if stops:
        notes.append(
            Note(
                "assumed",
                f"{counted(stops, 'motion stops', 'motions stop')} at the end instead of blending",
                "an output, a wait or the end comes next, which would take effect on the way",
            )
        )
    body, dropped = _drop_joint_turns(body, cell)
    if dropped:
        notes.append(
            Note(
                "skipped",
                f"{counted(dropped, 'joint motion')} without the speed at which the tool turns",
                "joint motions of this controller have none; with cell.robot they get a share",
            )
        )
    columns = Columns(body)
    unstated = int((columns.turned & (columns.turn == 0)).sum())
    if unstated:
        turns = counted(unstated, "motion only turns", "motions only turn")
        notes.append(
            Note(
                "assumed",
                f"{turns} the tool: at {job.process.turn:g} deg/s",
                "the text states no speed of turning for them",
            )
        )
    run = replace(part.run, body=tuple(body), lines=tuple(lines))
    paths, travel = make_paths(body, lines)
    notes = [*part.notes, *notes, *_note_frames(part, job)]
    return ReplayPlan(part, paths, tuple(notes), run=run, travel=travel, original_paths=paths)


def _drop_joint_turns(body: list[Instruction], cell: Cell | None) -> tuple[list[Instruction], int]:
    """Drop the reorientation speeds of joint motions for a controller without them.

    Returns the body and their number. With an arm they stay, and its joints get a fraction.
    """
    has_arm = isinstance(cell, Workcell) and cell.arm is not None
    if cell is None or cell.pace.turns or has_arm:
        return body, 0
    turns = [k for k, item in enumerate(body) if isinstance(item, MoveJ) and item.turn]
    for k in turns:
        body[k] = replace(body[k], turn=0.0)
    return body, len(turns)


def _note_frames(part: TaughtProgram, job: Job) -> Iterator[Note]:
    tool, work = f"tool {part.frames.tool}".strip(), f"frame {part.frames.work}".strip()
    for key, name in (("flange_from_tool", tool), ("base_from_work", work)):
        if getattr(part.frames, key) is None and getattr(job.cell, key) is None:
            yield Note(
                "assumed",
                f"the {name} is that of the cell",
                f"the text does not state it; set cell.{key}",
            )


# Joint values.


def _replace_joints(
    part: TaughtProgram, job: Job, cell: Cell | None
) -> tuple[list[Instruction], list[int], list[Note]]:
    """The body with poses in place of joint values, its lines, and notes.

    The joint values at the start and the end of the program, and equal ones in between, become the
    home of the cell.
    """
    items = list(zip(part.run.body, part.run.lines, strict=True))
    joints: dict[int, tuple[float, ...]] = {}
    for k, (item, _) in enumerate(items):
        if isinstance(item, MoveJ) and isinstance(item.target, Joints):
            joints[k] = item.target.values
    taught_arm = _find_arm(job.operation.taught_on) if job.operation.taught_on else None
    cell_arm = cell.arm if isinstance(cell, Workcell) else None
    is_same = taught_arm is not None and cell_arm is not None and cell_arm.name == taught_arm.name
    if not joints or is_same:
        return list(part.run.body), list(part.run.lines), []
    moves = [k for k, (item, _) in enumerate(items) if isinstance(item, MoveJ | MoveL | MoveC)]
    homes = {joints[k] for k in (moves[0], moves[-1]) if k in joints}
    converted = 0
    for k, values in joints.items():
        item, line = items[k]
        if values in homes:
            assert isinstance(item, MoveJ)
            if cell is None:
                raise JobError(
                    "cell", "is not given", remedy="the program goes home, which is that of a cell"
                )
            items[k] = (MoveJ(cell.home, item.speed, turn=item.turn), line)
        else:
            target = _convert_joints(values, taught_arm, part, cell, line)
            items[k] = (replace(item, target=target), line)
            converted += 1
    # The program starts at home in any case.
    if moves[0] in joints:
        del items[moves[0]]
    notes = []
    if len(joints) > converted:
        notes.append(
            _note_joints(len(joints) - converted, "values", "the home of this cell replaces them")
        )
    if taught_arm is not None and converted:
        notes.append(
            _note_joints(
                converted, f"values of {taught_arm.name}", "they become the pose of its tool"
            )
        )
    return [item for item, _ in items], [line for _, line in items], notes


def _note_joints(count: int, values: str, what: str) -> Note:
    return Note(
        "assumed",
        f"{counted(count, 'motion')} to joint {values}: {what}",
        "another arm has other joints",
    )


def _find_arm(name: str) -> Robot:
    from camgen.robots.catalogue import find_robot  # noqa: PLC0415 (only for what needs it)

    try:
        return find_robot(name)
    except JobError as error:
        raise JobError("job", error.what, "operation.taught_on", error.remedy) from error


def find_flange(name: str) -> Reach:
    """A function from joint values of the arm `name` to the pose of its flange in its base.

    Raises JobError for an unknown arm.
    """
    from camgen.robots.kinematics.forward import compute_flange  # noqa: PLC0415 (if it is needed)

    arm = _find_arm(name)

    def reach(values: Sequence[float]) -> Pose | None:
        if len(values) != len(arm.joints):
            return None
        rotation, origin = compute_flange(arm, np.array([values]))
        return Pose(frozen(rotation[0]), to_vec3(origin[0]))

    return reach


def _convert_joints(
    values: tuple[float, ...], arm: Robot | None, part: TaughtProgram, cell: Cell | None, line: int
) -> Pose:
    """The pose of the tool in the work frame if `arm` has joint `values`.

    Raises InputError if no arm is named or it has another number of joints.
    """
    if arm is None:
        raise InputError(
            part.source,
            "goes to joint values, which mean nothing to another arm",
            f"line {line}",
            'name the arm that it was written for: operation.taught_on = "abb_irb120"',
        )
    flange = find_flange(arm.name)(values)
    if flange is None:
        raise InputError(
            part.source,
            f"{counted(len(values), 'joint value')}, and {arm.name} has {len(arm.joints)}",
            f"line {line}",
            "name another arm: operation.taught_on",
        )
    tool = part.frames.flange_from_tool or (cell.flange_from_tool if cell else None)
    work = part.frames.base_from_work or (cell.base_from_work if cell else None)
    if tool is None or work is None:
        raise JobError("cell", "is not given", remedy="joint values become poses in a cell")
    return work.inverse() @ flange @ tool


# Blends and paths.


def _stop_before_others(body: list[Instruction]) -> tuple[list[Instruction], int]:
    """The body with stops before instructions that are not motions, and their number.

    An output that the text sets before the first motion is set after it in the program for the new
    arm. So the first motion stops too.
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


def find_stretches(moves: Sequence[Motion]) -> Iterator[tuple[int, int]]:
    """The ranges of motions that are lines and arcs.

    A range starts with the joint motion before, if its target is a pose: the start of the path.
    """
    if not moves:
        return
    cuts = [0, *(k for k, move in enumerate(moves) if k and isinstance(move, MoveJ)), len(moves)]
    for low, high in pairwise(cuts):
        first = low if isinstance(moves[low].target, Pose) else low + 1
        if high - first > 1:
            yield first, high


def make_paths(
    body: Sequence[Instruction], lines: Sequence[int]
) -> tuple[tuple[ToolPath, ...], float]:
    """The lines and arcs of a body as paths, and the length of its joint motions, mm."""
    moves: list[Motion] = []
    line_numbers = []
    for item, line in zip(body, lines, strict=True):
        if isinstance(item, MoveJ | MoveL | MoveC):
            moves.append(item)
            line_numbers.append(line)
    paths = [
        _make_path(k, line_numbers[low + 1], moves[low:high])
        for k, (low, high) in enumerate(find_stretches(moves), 1)
    ]
    links = [_measure_distance(a, b) for a, b in pairwise(moves) if isinstance(b, MoveJ)]
    return tuple(paths), math.fsum(links)


def _measure_distance(a: Motion, b: Motion) -> float:
    if not isinstance(a.target, Pose) or not isinstance(b.target, Pose):
        return 0.0
    return math.dist(a.target.origin, b.target.origin)


def _make_path(number: int, line: int, rows: Sequence[Motion]) -> ToolPath:
    poses = [row.target for row in rows if isinstance(row.target, Pose)]
    none = (math.nan,) * 3
    vias = [row.via.origin if isinstance(row, MoveC) else none for row in rows[1:]]
    return ToolPath(
        id=f"n{number}",
        layer=f"line {line}",
        table=make_waypoints(
            position=np.array([pose.origin for pose in poses]),
            via=[none, *vias],
            axis=[pose.rotation[:, 2] for pose in poses],
            feed=[rows[max(k, 1)].speed for k in range(len(rows))],
        ),
        closed=False,
        reversible=False,
        operation="replay",
    )
