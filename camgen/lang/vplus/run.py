"""Runs third-party Adept V+ programs once (docs/languages/vplus.md).

The strict read-back of the texts of the post `vplus` has the same text, expressions and variables.
"""

from __future__ import annotations

import math
import re
from bisect import bisect_right
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from camgen.lang.beside import sum_up
from camgen.lang.coverage import measure_coverage
from camgen.lang.log import Log
from camgen.lang.motion_speed import Limit, pace_motion
from camgen.lang.programs import Executed, Frames, RunRequest, carry_pose, index_frames, strip_mark
from camgen.model.pose import Pose
from camgen.model.program import Columns, Instruction, MoveJ, MoveL, splice

from .check import check_rest
from .code import FLOW, Translator
from .flow import Machine
from .names import canonical
from .points import read_points, read_values
from .robot import RATED_ROTATION, Tool
from .text import NULL, Frame, Routine, Statement, parse_files
from .units import find_data

#: Maximum number of work frames. More were computed rather than taught, so that all targets are
#: given in the base.
_MAX_FRAMES = 8
#: Maximum number of other tasks and reactions that are run.
_MAX_TASKS = 20
#: Maximum number of steps of each, in addition to those of the text.
_MAX_TASK_STEPS = 5_000
_CALL = re.compile(r"(?:CALL|EXECUTE)\b[^A-Za-z]*([A-Za-z][A-Za-z0-9._]*)", re.IGNORECASE)


def run_programs(files: Mapping[str, str], request: RunRequest) -> Executed:
    """Run the programs in `files` from their entry. Texts by name, in the order of their lines."""
    log = Log(shifts=request.shifts)
    files = {name: strip_mark(text) for name, text in files.items()}
    data_files = find_data(files)
    routines, data = parse_files(files, log, data_files)
    for routine in routines:
        routine.code = Translator(routine, Machine.act, FLOW, log).compile()
    values = {**read_points(request.points, log), **read_values(data, log)}
    machine = Machine(routines, request, log, data_files, values)
    entry = _find_entry(routines, request.entry)
    if entry is None:
        what = f"there is no program {request.entry}" if request.entry else "there is no .PROGRAM"
        log.find("refused", what, line=1)
        return Executed((), (), findings=log.list_findings(), stopped=(1, what))
    log.fact("entry", entry.name)
    machine.run(entry)
    end, ran = machine.line, frozenset(log.ran)
    short = replace(
        request,
        limits=replace(
            request.limits, vplus_steps=min(request.limits.vplus_steps, _MAX_TASK_STEPS)
        ),
    )
    _run_concurrent(machine, log, lambda aside: Machine(routines, short, aside, data_files, values))
    check_rest(routines, ran, log)
    for routine in routines:
        if canonical(routine.name) not in machine.ran:
            log.fact("programs not run", routine.name)
    placed = _split_by_frames(machine)
    body = _limit_speeds(machine, placed)
    return Executed(
        body,
        tuple(machine.lines),
        placed.frames,
        index_frames(placed.frames, placed.places),
        stopped=machine.stopped,
        coverage=measure_coverage((routine.code for routine in routines), log.ran, end),
        **log.list_all(", ", 20),
    )


def _run_concurrent(machine: Machine, log: Log, make_machine: Callable[[Log], Machine]) -> None:
    """Run each other task, and each reaction that was not run, alone, and log its effects.

    The state of the machine when a reaction comes is unknown, so a finding in it is at most
    unusual.
    """
    concurrent = [(key, *task, "tasks beside it, not run") for key, task in machine.tasks.items()]
    concurrent += [
        (key, *reaction, "reactions that do not come")
        for key, reaction in machine.reactions.items()
    ]
    for key, text, line, label in concurrent[:_MAX_TASKS]:
        routine = machine.programs.get(key)
        if routine is None:
            log.fact(label, f"{text}: in none of the files")
            if label.startswith("tasks"):
                log.lose(f"another task, {text}, is in none of the files", line=line)
            continue
        task_log = Log()
        other = make_machine(task_log)
        other.run(routine)
        log.ran |= task_log.ran
        log.fact(label, f"{text}: {sum_up(other.body)}")
        if label.startswith("tasks") and other.body:
            log.lose(f"another task, {text}, is not shown: {sum_up(other.body)}", line=line)
        for finding in task_log.list_findings():
            if finding.level != "dangerous":
                log.find("unusual", f"in {routine.name}: {finding.what}", line=finding.line)
            elif label.startswith("tasks"):
                log.find(finding.level, finding.what, line=finding.line)


def _find_entry(routines: Sequence[Routine], name: str) -> Routine | None:
    """Return the program `name`, or without a name the entry: main, or else one that none calls.

    Among these the first one with statements and without arguments. None if there is no such
    program.
    """
    by_name = {canonical(routine.name): routine for routine in reversed(routines)}
    if name:
        return by_name.get(canonical(name))
    for usual in ("main", "a.main", "a.start"):
        if usual in by_name:
            return by_name[usual]
    called = _find_called(routines)
    free = [r for r in routines if canonical(r.name) not in called]
    runnable = [r for r in free if not r.arguments and len(r.statements) > 0]
    return next(iter((*runnable, *free, *routines)), None)


def _find_called(routines: Sequence[Routine]) -> set[str]:
    called = set()
    for routine in routines:
        for statement in routine.statements:
            if isinstance(statement, Statement) and statement.word in ("CALL", "EXECUTE"):
                match = _CALL.match(f"{statement.word} {statement.rest}")
                if match and canonical(match[1]) != canonical(routine.name):
                    called.add(canonical(match[1]))
    return called


class PlacedBody(NamedTuple):
    """A body with its targets in frames.

    frames: frames in the order of their first use.
    places: index in `frames` for each instruction.
    body: the instructions.
    """

    frames: tuple[Frames, ...]
    places: tuple[int, ...]
    body: Sequence[Instruction]


def _split_by_frames(machine: Machine) -> PlacedBody:
    flat = _has_too_many_frames(machine)
    frames: list[Frames] = []
    places_by_value: dict[object, int] = {}
    places_by_id: dict[tuple[int, int, int], int] = {}
    places: list[int] = []
    changed: dict[int, Sequence[Instruction]] = {}
    # Instructions before the first pose belong to its frame.
    frame = next((first for first in machine.frames if first is not None), Frame())
    settings = zip(machine.frames, machine.bases, machine.tool, strict=True)
    for index, (target_frame, base, tool) in enumerate(settings):
        frame = target_frame or frame
        identity = id(frame), id(base), tool
        if identity not in places_by_id:
            tool_and_work = _make_frames(machine.tools[tool], frame, base, flat)
            pose = tool_and_work.base_from_work
            place = None if pose is None else (pose.origin, pose.rotation.tobytes())
            key = tool, tool_and_work.work, place
            if key not in places_by_value:
                places_by_value[key] = len(frames)
                frames.append(tool_and_work)
            places_by_id[identity] = places_by_value[key]
        places.append(places_by_id[identity])
        if target_frame is not None and flat and frame.compound and not frame.external:
            item = machine.body[index]
            target = frame.pose @ item.target  # type: ignore[union-attr, operator]
            changed[index] = (replace(item, target=target),)
    body = splice(machine.body, changed) if changed else machine.body
    return PlacedBody(tuple(frames), tuple(places), body)


def _has_too_many_frames(machine: Machine) -> bool:
    compounds = {}
    for frame in machine.frames:
        if frame is not None and frame.compound:
            compounds[id(frame)] = frame.pose
    different = {(pose.origin, pose.rotation.tobytes()) for pose in compounds.values()}
    return len(different) > _MAX_FRAMES


def _make_frames(tool: Tool, frame: Frame, base: Pose | None, flat: bool) -> Frames:
    if frame.external:
        return Frames(tool.name, frame.external, tool.pose, None)
    work, name = NULL, ""
    if frame.compound and not flat:
        work, name = frame.pose, frame.name
    return Frames(tool.name, name, tool.pose, base @ work if base is not None else work)


def _limit_speeds(machine: Machine, placed: PlacedBody) -> Sequence[Instruction]:
    """Limit the speeds of the body by the rotational speed of SPEED and by DURATION."""
    columns = Columns(placed.body)
    at = columns.at.tolist()
    reorients = columns.moves_are(MoveL) & columns.posed
    reorients[1:] &= columns.rotation[1:] != columns.rotation[:-1]
    reorients[:1] = False
    timed = np.isin(columns.at, list(machine.durations))
    from_unknown = columns.moves_are(MoveL)
    from_unknown[1:] &= ~columns.posed[:-1]
    begins, rates = zip(*machine.turning, strict=True)
    changed = {}
    for motion in np.flatnonzero(reorients | timed | from_unknown).tolist():
        index = at[motion]
        item = placed.body[index]
        seconds = machine.durations.get(index, 0.0)
        rate = rates[bisect_right(begins, index) - 1]
        rotation = math.radians(rate / 100 * RATED_ROTATION) if isinstance(item, MoveL) else 0.0
        start = _find_start(placed, at[motion - 1] if motion else None, index)
        if seconds and (start is None or not isinstance(item.target, Pose)):
            what = "the time of a motion from or to a place that the text does not hold"
            machine.log.omit(f"DURATION {seconds:g}: {what}", line=machine.lines[index])
        elif start is None and rate < 100 and isinstance(item, MoveL):
            what = "where the motion begins is not known"
            machine.log.omit(f"SPEED with {rate:g} % of turning: {what}", line=machine.lines[index])
        limited = pace_motion(item, start, Limit(item.speed, rotation, seconds))
        if isinstance(limited, MoveJ) and limited is not item:
            limited = replace(limited, share=0.0)
        changed[index] = (limited,)
    if not changed:
        return tuple(placed.body) if isinstance(placed.body, list) else placed.body
    return splice(placed.body, changed)


def _find_start(placed: PlacedBody, before: int | None, index: int) -> Pose | None:
    """The pose at which the motion at `index` begins, in its frames; None if it is not known.

    before: index of the motion before it, None without one.
    """
    if before is None:
        return None
    target = getattr(placed.body[before], "target", None)
    if not isinstance(target, Pose):
        return None
    then, now = (placed.frames[placed.places[k]] for k in (before, index))
    return target if then is now else carry_pose(target, then, now)
