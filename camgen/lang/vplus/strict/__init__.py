"""Reads an Adept V+ program of a post back: text -> instructions, findings by line.

The interpreter is written from the manuals. It runs the program that no other calls from its first
to its last line. Lines that cannot be followed (tests, jumps, arguments) are refused, not guessed.
"""

from __future__ import annotations

import math
import re
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Mapping, Sequence
from itertools import groupby
from typing import NoReturn

import numpy as np
from msgspec.structs import replace

from camgen.lang.code import Act, Return
from camgen.lang.flow import Counter, Flow, Rules
from camgen.lang.log import Log
from camgen.lang.post_options import read_positive, read_signals
from camgen.lang.programs import Executed, Frames
from camgen.lang.run import Budget, Stopped
from camgen.lang.values import require
from camgen.lang.vplus.arm import POSTURES, is_same
from camgen.lang.vplus.code import FLOW, Translator, read_bounds
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
    parse_files,
)
from camgen.lang.vplus.variables import check_name
from camgen.lang.vplus.walk import Walker
from camgen.model.pose import Pose
from camgen.model.program import Columns, Instruction, MoveJ, MoveL, splice

from .datafile import read_data
from .robot import RobotState, Settings
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


class Machine(RobotState, Walker):
    """The controller: the robot and the programs that it runs."""

    def __init__(self, programs: Mapping[str, Routine], log: Log, settings: Settings) -> None:
        super().__init__(log, settings)
        self._programs = programs
        self.budget = Budget(0, _LOOPED, "")
        for routine in programs.values():
            self.budget.left += sum(map(_length, routine.statements))
        self._flow = Flow(self, self.budget, Rules(_CALLS, skips_blocks=True))
        self.line = 0

    def run(self, routine: Routine) -> None:
        """Runs a routine and those that it calls. Adds findings for what cannot be run."""
        try:
            self._run(routine)
            self.finish(self.line)
        except Stopped:
            self.fault(self.line, "the loops of this program do not come to an end")

    def _run(self, routine: Routine) -> None:
        self.enter()
        for label, index in routine.labels.items():
            line = next((item.line for item in routine.statements[index : index + 1]), routine.line)
            self.remark(line, f"label {label}, to which no statement of a post jumps")
        self._flow.run(routine.code)
        self.leave()

    def add_fault(self, line: int, word: str, error: Exception) -> None:
        """Add a finding for an instruction that cannot be run."""
        self.fault(line, str(error))
        if word in _MOTIONS:
            self.lose_position()

    # -- answers to the engine (`camgen.lang.flow.Language`) ------------------------------------
    # No program of a post has cases or open choices. The budget ends a loop that repeats itself.

    def open_count(self, count: str) -> Counter:
        """The counter of FOR."""
        name, _, bounds = count.partition("=")
        name = check_name(name.strip())
        counter = Counter(name, *read_bounds(Expression(bounds, self)))
        self.store(self.line, name, counter.first)
        return counter

    def evaluate(self, expression: str | Statement) -> float:
        """The value of a counter. Raises Unreadable for another block."""
        if isinstance(expression, Statement):
            self._refuse(expression.word)
        return self.real(expression)

    def act(self, statement: Statement) -> None:
        """Runs an instruction."""
        word = statement.word
        if word in _DOES:
            _DOES[word](self, statement)
        elif word == "TYPE":
            self.remark(statement.line, "TYPE, which no program of the post has")
        else:
            self._refuse(word)

    def end(self, statements: Sequence[Statement | Stretch]) -> Return:
        """Runs a RETURN. statements: its statement and the next one."""
        statement, *others = statements
        if isinstance(statement, Statement) and statement.rest:
            self.fault(statement.line, "RETURN stands alone")
        if others:
            self.fault(others[0].line, "a statement after RETURN never runs")
        return Return(statement.line)

    def _refuse(self, word: str) -> NoReturn:
        """Raises Unreadable for a word that is not evaluated."""
        if word in _OTHER_MOTIONS:
            self.lose_position()
        if word in _OTHERS | _OTHER_MOTIONS:
            raise Unreadable(f"{word} is not evaluated")
        raise Unreadable(f"unknown statement {word[:40]}")

    def call(self, statement: Statement) -> None:
        """Runs `CALL name()`."""
        match = require(_CALL.fullmatch(statement.rest), Unreadable("CALL wants name()"))
        routine = require(
            self._programs.get(canonical(match[1])),
            Unreadable(f"program {match[1]} is not in this text"),
        )
        if match[2] or routine.arguments:
            raise Unreadable("the arguments of a CALL are not evaluated")
        if self.depth >= _CALLS:
            raise Unreadable(f"more than {_CALLS} programs call each other")
        self._run(routine)
        self.line = statement.line

    def declare_variables(self, statement: Statement) -> None:
        """Runs `AUTO`, `LOCAL` or `GLOBAL`."""
        declared = self._scopes[-1].auto
        for part in re.sub(r"^(REAL|DOUBLE)\s+", "", statement.rest, flags=re.IGNORECASE).split(
            ","
        ):
            key = canonical(check_name(re.sub(r"\[[^\]]*\]$", "", part.strip())))
            if key in declared:
                raise Unreadable(f"{part.strip()} is declared twice")
            if statement.word != "GLOBAL":
                declared[key] = None
        if statement.word != "AUTO":
            what = "its variables outlive the program, those of AUTO do not"
            self.remark(statement.line, f"{statement.word}: {what}")


def _translate_return(translator: Translator, statement: Statement) -> None:
    statements = translator.routine.statements[translator.index :][:2]
    translator.add(Act(statement.line, do=Machine.end, operand=statements))


#: The words of the flow. Blocks other than FOR are refused.
_FLOW = {
    "RETURN": _translate_return,
    "FOR": FLOW["FOR"],
    "END": FLOW["END"],
    "UNTIL": FLOW["UNTIL"],
    **dict.fromkeys(("CASE", "DO", "IF", "WHILE"), Translator.refuse_block),
}


def _length(statement: Statement | Stretch) -> int:
    return len(statement.poses) if isinstance(statement, Stretch) else 1


#: Methods by the word of their instruction. They are not bound to a machine, which would then refer
#: to itself and stay in memory.
_DOES: dict[str, Callable[[Machine, Statement], None]] = {
    "=": Machine.assign_number,
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
    **dict.fromkeys(("AUTO", "GLOBAL", "LOCAL"), Machine.declare_variables),
    **dict.fromkeys(("COARSE", "FINE", "NULL", "NONULL"), Machine.set_accuracy),
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
    programs: dict[str, Routine] = {}
    for routine in parse_files(files, log, strict=True)[0]:
        routine.code = Translator(routine, Machine.act, _FLOW, log).compile()
        for step in routine.code.steps:
            step.cost = min(step.cost, 1)
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
    begins, rates = zip(*turning, strict=True)
    changed: dict[int, tuple[Instruction, ...]] = {}
    for index in columns.at[columns.turned].tolist():
        percent = rates[bisect_right(begins, index) - 1]
        changed[index] = (replace(body[index], turn=math.radians(percent / 100 * rated)),)
    return splice(body, changed) if changed else body


def _check_turning(machine: Machine, body: tuple[Instruction, ...], lines: Sequence[int]) -> None:
    """Adds findings for linear motions at a rotational speed below 100 %, which may slow them."""
    begins, rates = zip(*machine.turning, strict=True)
    if min(rates) >= 100:
        return
    columns = Columns(body)
    moved = np.zeros(len(columns.at), np.bool_)
    moved[1:] = np.abs(np.diff(columns.ends, axis=0)).max(axis=1, initial=0.0) > _SPOT
    moved[1:] &= columns.posed[:-1] & columns.moves_are(MoveL)[1:]
    straight = columns.at[moved].tolist()
    ends = *begins[1:], len(body)
    for begin, end, rate in zip(begins, ends, rates, strict=True):
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
            machine.remark(line, f"a target in {frame.external}, not in {work} as post.work has it")


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
    return next(iter(roots), None)


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
            robot.fault(line, f"the frames of the targets differ, and {error}")
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
            if not is_same(frame.pose, pose):
                return None
            pose = frame.pose
    return first if first.compound or first.external else None
