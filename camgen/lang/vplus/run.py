"""Adept V+: what a program of another hand does when it is run once (docs/languages/vplus.md).

The strict read-back of what the post ``vplus`` writes uses the same text, expressions and variables.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from camgen.lang.beside import sum_up
from camgen.lang.coverage import measure_coverage
from camgen.lang.log import Log
from camgen.lang.motion_speed import Limit, pace_motion
from camgen.lang.programs import Ask, Executed, Frames, carry_pose, strip_mark
from camgen.model.pose import Pose
from camgen.model.program import Columns, Instruction, MoveJ, MoveL, splice

from .check import check_rest
from .flow import Machine
from .names import canonical
from .points import read_points, read_values
from .robot import RATED_TURN, Tool
from .text import NULL, Frame, Routine, Statement, read_files
from .units import find_data
from .variables import Value

#: More work frames than these are no frames that somebody taught: targets in them are told in the base.
_FRAMES = 8
#: So many other tasks and reactions are looked at.
_MOST_BESIDE = 20
#: Instructions of each, beyond those of the text.
_MOST_OF_A_TASK = 5_000
_CALL = re.compile(r"(?:CALL|EXECUTE)\b[^A-Za-z]*([A-Za-z][A-Za-z0-9._]*)", re.IGNORECASE)


def run_programs(files: Mapping[str, str], ask: Ask) -> Executed:
    """What the programs in ``files`` do from their entry on."""
    log = Log(shifts=ask.shifts)
    files = {name: strip_mark(text) for name, text in files.items()}
    beside = find_data(files)
    routines, data = read_files(
        files,
        beside,
        lambda line, what: log.find("refused", what, line=line),
        lambda line, what: log.find("unusual", what, line=line),
    )
    values = {**read_points(ask.points, log), **read_values(data, log)}
    machine = _ready(routines, ask, log, beside, values)
    entry = _find_entry(routines, ask.entry)
    if entry is None:
        what = f"there is no program {ask.entry}" if ask.entry else "there is no .PROGRAM"
        log.find("refused", what, line=1)
        return Executed((), (), findings=log.list_findings(), stopped=(1, what))
    log.fact("entry", entry.name)
    machine.run(entry)
    end, ran = machine.line, frozenset(log.ran)
    short = replace(
        ask, limits=replace(ask.limits, vplus_steps=min(ask.limits.vplus_steps, _MOST_OF_A_TASK))
    )
    _look_beside(machine, log, lambda aside: _ready(routines, short, aside, beside, values))
    check_rest(routines, ran, log)
    _tell_programs(routines, machine, log)
    placed = _place(machine)
    body = _pace(machine, placed)
    return Executed(
        body,
        tuple(machine.lines),
        placed.frames,
        placed.places if len(placed.frames) > 1 else (),
        findings=log.list_findings(),
        assumed=log.list_assumed(),
        facts=log.list_facts(", ", 20),
        lost=log.list_lost(),
        omitted=log.list_omitted(),
        stopped=machine.stopped,
        is_limited=log.is_limited,
        choices=log.list_choices(),
        steps=log.steps,
        coverage=measure_coverage(machine.compile_all(), log.ran, end),
    )


def _ready(
    routines: Sequence[Routine],
    ask: Ask,
    log: Log,
    beside: Mapping[str, str],
    values: Mapping[str, Value],
) -> Machine:
    machine = Machine(routines, ask, log)
    machine.lay_beside(beside)
    machine.give(values)
    return machine


def _look_beside(machine: Machine, log: Log, ready: Callable[[Log], Machine]) -> None:
    """Runs the other tasks, and what reacts and does not come, each by itself: what it does is told, and what is wrong
    in it. Where a reaction comes is not known: what it meets there is unusual at most.
    """
    waiting = [(key, *told, "tasks beside it, not run") for key, told in machine.beside.items()]
    waiting += [
        (key, *told, "reactions that do not come") for key, told in machine.reactions.items()
    ]
    for key, text, line, label in waiting[:_MOST_BESIDE]:
        routine = machine.find_program(key)
        if routine is None:
            log.fact(label, f"{text}: in none of the files")
            if label.startswith("tasks"):
                log.lose(f"another task, {text}, is in none of the files", line=line)
            continue
        log_beside = Log()
        other = ready(log_beside)
        other.run(routine)
        log.ran |= log_beside.ran
        log.fact(label, f"{text}: {sum_up(other.body)}")
        if label.startswith("tasks") and other.body:
            log.lose(f"another task, {text}, is not shown: {sum_up(other.body)}", line=line)
        for finding in log_beside.list_findings():
            if finding.level != "dangerous":
                what = f"in {routine.name}: {finding.what}"
                log.find("unusual", what, line=finding.line)
            elif label.startswith("tasks"):
                log.find(finding.level, finding.what, line=finding.line)


def _find_entry(routines: Sequence[Routine], name: str) -> Routine | None:
    """The program ``name``; without one main, else the first that none calls and that does something."""
    by_name = {canonical(routine.name): routine for routine in reversed(routines)}
    if name:
        return by_name.get(canonical(name))
    for usual in ("main", "a.main", "a.start"):
        if usual in by_name:
            return by_name[usual]
    called = _called(routines)
    free = [r for r in routines if canonical(r.name) not in called]
    does = [r for r in free if not r.arguments and len(r.statements) > 0]
    return next(iter((*does, *free, *routines)), None)


def _called(routines: Sequence[Routine]) -> set[str]:
    found = set()
    for routine in routines:
        for statement in routine.statements:
            if isinstance(statement, Statement) and statement.word in ("CALL", "EXECUTE"):
                match = _CALL.match(f"{statement.word} {statement.rest}")
                if match and canonical(match[1]) != canonical(routine.name):
                    found.add(canonical(match[1]))
    return found


def _tell_programs(routines: Sequence[Routine], machine: Machine, log: Log) -> None:
    for routine in routines:
        if canonical(routine.name) not in machine.ran:
            log.fact("programs not run", routine.name)


class PlacedBody(NamedTuple):
    """A body with its targets in frames.

    frames: frames in the order of their first use.
    places: index in `frames` for each instruction.
    body: the instructions.
    """

    frames: tuple[Frames, ...]
    places: tuple[int, ...]
    body: Sequence[Instruction]


def _place(machine: Machine) -> PlacedBody:
    """The body with its targets in the frames of the text."""
    flat = _is_flat(machine)
    frames: list[Frames] = []
    places: dict[object, int] = {}
    known: dict[tuple[int, int, int], int] = {}
    found: list[int] = []
    changed: dict[int, Sequence[Instruction]] = {}
    # What stands before the first pose is counted to its frame.
    frame = next((one for one in machine.frames if one is not None), Frame())
    given = zip(machine.frames, machine.bases, machine.tool, strict=True)
    for index, (own, base, tool) in enumerate(given):
        frame = own or frame
        short = id(frame), id(base), tool
        if short not in known:
            one = _frames(machine.tools[tool], frame, base, flat)
            key = _key(one, tool)
            if key not in places:
                places[key] = len(frames)
                frames.append(one)
            known[short] = places[key]
        found.append(known[short])
        if own is not None and flat and frame.compound and not frame.external:
            item = machine.body[index]
            moved = replace(item, target=frame.pose @ item.target)  # type: ignore[union-attr, operator]
            changed[index] = (moved,)
    body = splice(machine.body, changed) if changed else machine.body
    return PlacedBody(tuple(frames), tuple(found), body)


def _is_flat(machine: Machine) -> bool:
    """Whether there are too many work frames to name them."""
    seen: dict[tuple[object, ...], None] = {}
    for frame in {
        id(one): one for one in machine.frames if one is not None and one.compound
    }.values():
        pose = frame.pose
        seen[(pose.origin, pose.rotation.tobytes())] = None
    return len(seen) > _FRAMES


def _frames(tool: Tool, frame: Frame, base: Pose | None, flat: bool) -> Frames:
    if frame.external:
        return Frames(tool.name, frame.external, tool.pose, None)
    inner = frame.pose if frame.compound and not flat else NULL
    name = frame.name if frame.compound and not flat else ""
    return Frames(tool.name, name, tool.pose, base @ inner if base is not None else inner)


def _key(one: Frames, tool: int) -> object:
    pose = one.base_from_work
    return tool, one.work, None if pose is None else (pose.origin, pose.rotation.tobytes())


def _pace(machine: Machine, placed: PlacedBody) -> Sequence[Instruction]:
    """The body at the speeds that SPEED's rotational speed and DURATION leave."""
    columns = Columns(placed.body)
    at = columns.at.tolist()
    turns = columns.moves_are(MoveL) & columns.posed
    turns[1:] &= columns.rotation[1:] != columns.rotation[:-1]
    turns[:1] = False
    timed = np.isin(columns.at, list(machine.durations))
    blind = columns.moves_are(MoveL)
    blind[1:] &= ~columns.posed[:-1]
    begins = np.array([begin for begin, _ in machine.turning])
    changed = {}
    for motion in np.flatnonzero(turns | timed | blind).tolist():
        index = at[motion]
        item = placed.body[index]
        seconds = machine.durations.get(index, 0.0)
        rate = machine.turning[int(np.searchsorted(begins, index, "right")) - 1][1]
        turn = math.radians(rate / 100 * RATED_TURN) if isinstance(item, MoveL) else 0.0
        start = _find_start(placed, at[motion - 1] if motion else None, index)
        if seconds and (start is None or not isinstance(item.target, Pose)):
            what = "the time of a motion from or to a place that the text does not hold"
            machine.log.omit(f"DURATION {seconds:g}: {what}", line=machine.lines[index])
        elif start is None and rate < 100 and isinstance(item, MoveL):
            what = "where the motion begins is not known"
            machine.log.omit(f"SPEED with {rate:g} % of turning: {what}", line=machine.lines[index])
        paced = pace_motion(item, start, Limit(item.speed, turn, seconds))
        if isinstance(paced, MoveJ) and paced is not item:
            paced = replace(paced, share=0.0)
        changed[index] = (paced,)
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
