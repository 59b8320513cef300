"""Reads an Adept V+ program of a post back: text -> instructions, findings by line.

The interpreter is written from the manuals. It runs the program that no other calls from its first
to its last line. Lines that cannot be followed (tests, jumps, arguments) are refused, not guessed.
"""

from __future__ import annotations

import math
import re
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import groupby

import numpy as np
from msgspec.structs import replace

from camgen.lang.log import Log
from camgen.lang.post_options import read_positive, read_signals
from camgen.lang.programs import Executed, Frames
from camgen.lang.vplus.locations import Expression
from camgen.lang.vplus.names import canonical
from camgen.lang.vplus.text import (
    BASE,
    NULL,
    Frame,
    Location,
    Routine,
    Statement,
    Stretch,
    Unreadable,
    routines,
)
from camgen.lang.vplus.variables import variable
from camgen.lang.vplus.walk import walk, walk_apart
from camgen.model.pose import Pose
from camgen.model.program import Columns, Instruction, MoveJ, MoveL, splice

from .datafile import read_data
from .robot import POSTURES, RobotState, Settings, same
from .scara import check_scara

#: Maximum number of instructions that loops may add to those of the text.
_LOOPED = 100_000
_CALLS = 20
_CALL = re.compile(r"([A-Za-z][A-Za-z0-9._]*)\s*\(\s*(.*?)\s*\)")
_OTHERS = frozenset(
    """ABORT ANY CALIBRATE CASE CLOSEI CPOFF CPON DECOMPOSE DO DURATION ELSE EXECUTE EXIT FCLOSE
    FOPEN FOPENR GOTO HALT HERE IF MC OPENI PARAMETER REACT REACTI READ RESET RETURNE STOP TIMER
    UNTIL VALUE WAIT WHILE WRITE
    """.split()  # noqa: SIM905 (a table)
)
#: Words of instructions that cannot name a program, besides those of `camgen.lang.vplus.names`.
_ARGUMENTS = frozenset(
    {"CP", "EVENT", "IPS", "MMPS", "MONITOR", "PPOINT", "PROGRAM", "REAL", "ROBOT", "WORLD"}
)
#: Motions. The position is unknown after one that cannot be read, and after other motions.
_MOTIONS = frozenset({"APPRO", "APPROS", "DEPART", "DEPARTS", "MOVE", "MOVES"})
_OTHER_MOTIONS = frozenset({"ALIGN", "ALTER", "CLOSE", "DRIVE", "MOVEST", "MOVET", "OPEN", "READY"})


@dataclass(slots=True)
class _Loop:
    start: int
    end: int
    name: str
    last: float
    step: float


class _Exhausted(Exception):
    """Raised if a program runs more instructions than any program needs."""


class Machine(RobotState):
    """The controller: the robot and the programs that it runs."""

    def __init__(self, programs: Mapping[str, Routine], log: Log, settings: Settings) -> None:
        super().__init__(log, settings)
        self._programs = programs
        self._budget = _LOOPED
        for routine in programs.values():
            self._budget += sum(map(_length, routine.statements))
        self._line = 0

    def run(self, routine: Routine) -> None:
        """Runs a routine and those that it calls. Adds findings for what cannot be run."""
        try:
            self._run(routine)
            self.finish(self._line)
        except _Exhausted:
            self.report(self._line, "the loops of this program do not come to an end")

    def _run(self, routine: Routine) -> None:
        self.enter()
        for label, index in routine.labels.items():
            line = _line_at(routine, index)
            self.remark(line, f"label {label}, to which no statement of a post jumps")
        walk(routine, partial(self._next, routine, []), self._stretch, self._unreadable)
        self.leave()

    def _stretch(self, plain: Stretch) -> None:
        count = len(plain.poses)
        if count <= self._budget and self.stretch(plain):
            self._budget -= count
            self._line = plain.line + count - 1
            return
        walk_apart(plain, self._move_apart, self._unreadable)

    def _move_apart(self, statement: Statement) -> None:
        self._spend(statement.line)
        self.move(statement)

    def _spend(self, line: int) -> None:
        """Takes the instruction of a line from the budget. Raises _Exhausted at its end."""
        self._line = line
        self._budget -= 1
        if self._budget < 0:
            raise _Exhausted

    def _unreadable(self, statement: Statement, error: Unreadable) -> None:
        self.report(statement.line, str(error))
        if statement.word in _MOTIONS:
            self.lost()

    def _next(self, routine: Routine, loops: list[_Loop], index: int, statement: Statement) -> int:
        """Runs an instruction. Returns the index of the next one."""
        self._spend(statement.line)
        word = statement.word
        if word == "RETURN":
            if statement.rest:
                self.report(statement.line, "RETURN stands alone")
            if index + 1 < len(routine.statements):
                line = _line_at(routine, index + 1)
                self.report(line, "a statement after RETURN never runs")
            return len(routine.statements)
        if word == "FOR":
            return self._loop(statement, index, routine.partner, loops)
        if word == "END":
            return self._again(index, loops)
        if word in _DOES:
            _DOES[word](self, statement)
        elif word == "TYPE":
            self.remark(statement.line, "TYPE, which no program of the post has")
        else:
            self._refuse(word)
        return index + 1

    def _loop(
        self, statement: Statement, index: int, partner: Mapping[int, int], loops: list[_Loop]
    ) -> int:
        name, _, bounds = statement.rest.partition("=")
        name = variable(name.strip())
        text = Expression(bounds, self)
        first = text.real()
        text.expect("TO")
        last = text.real()
        step = text.real() if text.accept("STEP") else 1.0
        text.finish()
        if step == 0:
            raise Unreadable("a loop with step 0")
        if index not in partner:
            raise Unreadable("a loop without END")
        self.store(statement.line, name, first)
        loop = _Loop(index, partner[index], name, last, step)
        if (first - last) * step > 0:
            return loop.end + 1
        loops.append(loop)
        return index + 1

    def _again(self, index: int, loops: list[_Loop]) -> int:
        if not loops or loops[-1].end != index:
            return index + 1
        loop = loops[-1]
        value = self.real(loop.name) + loop.step
        self.assign(loop.name, value)
        if (value - loop.last) * loop.step > 0:
            loops.pop()
            return index + 1
        return loop.start + 1

    def _refuse(self, word: str) -> None:
        """Raises Unreadable for a word that is not evaluated."""
        if word in _OTHER_MOTIONS:
            self.lost()
        if word in _OTHERS | _OTHER_MOTIONS:
            raise Unreadable(f"{word} is not evaluated")
        raise Unreadable(f"unknown statement {word[:40]}")

    def call(self, statement: Statement) -> None:
        """Runs `CALL name()`."""
        match = _CALL.fullmatch(statement.rest)
        if match is None:
            raise Unreadable("CALL wants name()")
        routine = self._programs.get(canonical(match[1]))
        if routine is None:
            raise Unreadable(f"program {match[1]} is not in this text")
        if match[2] or routine.arguments:
            raise Unreadable("the arguments of a CALL are not evaluated")
        if self.depth >= _CALLS:
            raise Unreadable(f"more than {_CALLS} programs call each other")
        self._run(routine)
        self._line = statement.line

    def declares(self, statement: Statement) -> None:
        """Runs `AUTO`, `LOCAL` or `GLOBAL`."""
        self.declare(statement.rest, statement.word != "GLOBAL")
        if statement.word != "AUTO":
            what = "its variables outlive the program, those of AUTO do not"
            self.remark(statement.line, f"{statement.word}: {what}")


def _line_at(routine: Routine, index: int) -> int:
    """The line of a statement, or of the routine if the index is after the last statement."""
    if index < len(routine.statements):
        return routine.statements[index].line
    return routine.line


def _length(statement: Statement | Stretch) -> int:
    return len(statement.poses) if isinstance(statement, Stretch) else 1


#: Methods by the word of their instruction. They are not bound to a machine, which would then refer
#: to itself and stay in memory.
_DOES: dict[str, Callable[[Machine, Statement], None]] = {
    "=": Machine.let,
    "ACCEL": Machine.accel,
    "ATTACH": Machine.attach,
    "BASE": Machine.base,
    "BREAK": Machine.brake,
    "CALL": Machine.call,
    "DELAY": Machine.delay,
    "DETACH": Machine.detach,
    "PAUSE": Machine.stop,
    "SELECT": Machine.select,
    "SET": Machine.set,
    "SIGNAL": Machine.signal,
    "SPEED": Machine.speed,
    "TOOL": Machine.set_tool,
    "WAIT.EVENT": Machine.wait_event,
    **dict.fromkeys(("APPRO", "APPROS"), Machine.appro),
    **dict.fromkeys(("AUTO", "GLOBAL", "LOCAL"), Machine.declares),
    **dict.fromkeys(("COARSE", "FINE", "NULL", "NONULL"), Machine.settle),
    **dict.fromkeys(("DEPART", "DEPARTS"), Machine.depart),
    **dict.fromkeys(("DISABLE", "ENABLE"), Machine.switch),
    **dict.fromkeys(("MOVE", "MOVES"), Machine.move),
    **dict.fromkeys(POSTURES, Machine.configure),
}


#: Maximum change of position of a reorientation, mm: twice the 0.1 of one printed decimal.
_SPOT = 0.2
#: Defaults of options (docs/posts/vplus.md): mm/s and deg/s at 100 %, numbers of outputs,
#: names of the tool and the work frame.
_RATED, _RATED_TURN, _SIGNALS, _TOOL, _WORK = 7500.0, 1200.0, {"process": 33}, "cg.tool", "cg.work"


def read(files: Mapping[str, str], options: Mapping[str, object]) -> Executed:
    """Runs a program.

    files: programs by file name. With `points = "file"` a reader and its data file, in this order.
    options: options of the post. They give what the text does not state.

    A target `frame:..` is in that frame if all targets name the same one, which is then the work
    frame. Else all targets are in the base, and the work frame is the identity. A motion before
    BREAK stops (blend 0), others have a blend of 1 mm.
    """
    if options.get("points") == "file":
        return read_data(files, options, read)
    log = Log()
    settings = _read_settings(options)
    machine = _run(files, settings, log)
    _check_frames(machine)
    if machine.axes == 4:
        check_scara(machine)
    work, body, lines = _translate(machine)
    if not any(machine.frames):  # no target has a frame
        work = machine.stated.get(settings.work)
    body = tuple(body)
    _check_turning(machine, body, lines)
    body = _with_turns(body, machine.turning, settings.rated_turn)
    frames = Frames(base_from_work=work, flange_from_tool=machine.tool)
    return Executed(body, tuple(lines), (frames,), findings=log.list_findings())


def _read_settings(options: Mapping[str, object]) -> Settings:
    tool = canonical(str(options.get("tool", _TOOL)))
    work = canonical(str(options.get("work", _WORK)))
    posture = options.get("posture", ())
    return Settings(
        rated=read_positive(options, "rated", _RATED),
        rated_turn=read_positive(options, "rated_turn", _RATED_TURN),
        signals=read_signals(options, _SIGNALS),
        tool=tool,
        work=work,
        undeclared=frozenset() if options.get("declare", True) else frozenset((tool, work)),
        profile=int(read_positive(options, "profile", 0)),
        acceleration=read_positive(options, "accel", 100.0),
        posture=frozenset(map(str, posture)) if isinstance(posture, list | tuple) else frozenset(),
    )


def _run(files: Mapping[str, str], settings: Settings, log: Log) -> Machine:
    """The machine after it has run the files."""

    def report(line: int, what: str) -> None:
        log.find("refused", what, line=line)

    def remark(line: int, what: str) -> None:
        log.find("unusual", what, line=line)

    programs: dict[str, Routine] = {}
    for routine in routines(files, report, remark):
        programs.setdefault(canonical(routine.name), routine)
    machine = Machine(programs, log, settings)
    start = _find_start(list(programs.values()), log)
    if start is not None:
        machine.run(start)
    return machine


def _with_turns(
    body: Sequence[Instruction], turning: Sequence[tuple[int, float]], rated: float
) -> Sequence[Instruction]:
    """`body` with the speed of its reorientations.

    turning: index of an instruction and rotational speed from it on, %.
    rated: rotational speed at 100 %, deg/s.
    """
    columns = Columns(body)
    begins = [begin for begin, _ in turning]
    changed: dict[int, tuple[Instruction, ...]] = {}
    for index in columns.at[columns.turned].tolist():
        percent = turning[bisect_right(begins, index) - 1][1]
        changed[index] = (replace(body[index], turn=math.radians(percent / 100 * rated)),)
    return splice(body, changed) if changed else body


def _check_turning(machine: Machine, body: tuple[Instruction, ...], lines: Sequence[int]) -> None:
    """Adds findings for linear motions at a rotational speed below 100 %, which may slow them."""
    turning = machine.turning
    if all(rate >= 100 for _, rate in turning):
        return
    columns = Columns(body)
    moved = np.zeros(len(columns.at), np.bool_)
    moved[1:] = np.abs(np.diff(columns.ends, axis=0)).max(axis=1, initial=0.0) > _SPOT
    moved[1:] &= columns.posed[:-1] & columns.moves_are(MoveL)[1:]
    straight = columns.at[moved].tolist()
    ends = [begin for begin, _ in turning[1:]] + [len(body)]
    for (begin, rate), end in zip(turning, ends, strict=True):
        first = bisect_left(straight, begin)
        if rate < 100 and first < len(straight) and straight[first] < end:
            what = f"a straight motion at {rate:g} % rotational speed"
            reason = "where the tool turns, it may be slower than its SPEED"
            machine.remark(lines[straight[first]], f"{what}: {reason}")


def _check_frames(machine: Machine) -> None:
    """Adds findings for a tool or work frame of the controller that the options do not name."""
    tool, work = machine.settings.tool, machine.settings.work
    if machine.tool_name not in ("", tool):
        machine.remark(1, f"the tool is {machine.tool_name}, not {tool} as post.tool has it")
    for line, frame in zip(machine.lines, machine.frames, strict=True):
        if frame is not None and frame.external not in ("", work):
            what = f"a target in {frame.external}, not in {work} as post.work has it"
            machine.remark(line, what)


def _find_start(programs: list[Routine], log: Log) -> Routine | None:
    """The first program that no other calls, None if there are no programs."""
    called = set()
    for routine in programs:
        for statement in routine.statements:
            if not isinstance(statement, Stretch) and statement.word == "CALL":
                called.add(canonical(statement.rest.partition("(")[0].strip()))
    uncalled = [routine for routine in programs if canonical(routine.name) not in called]
    roots = uncalled or programs[:1]
    if roots and roots[0] is not programs[0]:
        what = f"{roots[0].name} calls the others and is not the first program"
        log.find("unusual", what, line=roots[0].line)
    for other in roots[1:]:
        what = f"program {other.name} is called by no other and not evaluated"
        log.find("refused", what, line=other.line)
    for routine in programs:
        if routine.name.upper() in _ARGUMENTS:
            what = f"{routine.name} is a word of V+, not the name of a program"
            log.find("refused", what, line=routine.line)
    if not roots:
        log.find("refused", "there is no .PROGRAM", line=1)
    return roots[0] if roots else None


def _translate(robot: RobotState) -> tuple[Pose | None, Sequence[Instruction], Sequence[int]]:
    """The common frame, the instructions with targets in it, and their lines."""
    # Most frames are the same object as the frame before.
    given = [frame for frame, _ in groupby(robot.frames) if frame is not None]
    common = _common(given)
    if common is not None:
        return None if common.external else common.pose, robot.body, robot.lines
    if all(frame is BASE for frame in given):
        return NULL if given else None, robot.body, robot.lines
    body: list[Instruction] = []
    lines: list[int] = []
    for item, line, frame in zip(robot.body, robot.lines, robot.frames, strict=True):
        try:
            body.append(_in_base(item, frame))
        except Unreadable as error:
            robot.report(line, f"the frames of the targets differ, and {error}")
            continue
        lines.append(line)
    return NULL, body, lines


def _in_base(item: Instruction, frame: Frame | None) -> Instruction:
    if frame is None or not isinstance(item, (MoveJ, MoveL)) or not isinstance(item.target, Pose):
        return item
    return replace(item, target=Location(item.target, frame).in_base())


def _common(given: list[Frame]) -> Frame | None:
    """The first frame if all are equal. None if they differ or are the base."""
    if not given:
        return None
    first = given[0]
    pose = first.pose
    for frame in given:
        if frame.external != first.external or frame.compound != first.compound:
            return None
        if frame.pose is not pose:
            if not same(frame.pose, pose):
                return None
            pose = frame.pose
    return first if first.compound or first.external else None
