"""Read-back for Adept V+: what a ``.v2`` text says, found by carrying it out. Written from the manuals.

The one program that no other calls is run from its first to its last line. Programs that cannot be followed (tests,
jumps, arguments) are not guessed at: every such line is a fault.
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
from camgen.lang.programs import Executed, Frames
from camgen.lang.vplus.locations import Expression
from camgen.lang.vplus.names import canonical
from camgen.lang.vplus.text import (
    BASE,
    NULL,
    Frame,
    Location,
    Report,
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
from .robot import POSTURES, RobotState, same
from .scara import check_scara

# V+ programs carried out, line by line. For the read-back ``vplus``.

#: Loops may add so many instructions to those that stand in the text.
_LOOPED = 100_000
_CALLS = 20
_CALL = re.compile(r"([A-Za-z][A-Za-z0-9._]*)\s*\(\s*(.*?)\s*\)")
_OTHERS = frozenset(
    """ABORT ANY CALIBRATE CASE CLOSEI CPOFF CPON DECOMPOSE DO DURATION ELSE EXECUTE EXIT FCLOSE FOPEN FOPENR GOTO HALT
    HERE IF MC OPENI PARAMETER REACT REACTI READ RESET RETURNE STOP TIMER UNTIL VALUE WAIT WHILE WRITE
    """.split()  # noqa: SIM905 (a table)
)
#: Words of instructions, beside those of ``camgen.lang.vplus.names``, that name no program.
_ARGUMENTS = frozenset(
    {"CP", "EVENT", "IPS", "MMPS", "MONITOR", "PPOINT", "PROGRAM", "REAL", "ROBOT", "WORLD"}
)
#: After these, and after a motion that cannot be read, nobody knows where the robot is.
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
    """More instructions than any program needs."""


class Machine(RobotState):
    """The controller: the robot and the programs that it runs. The other arguments as those of ``RobotState``."""

    def __init__(
        self,
        programs: Mapping[str, Routine],
        report: Report,
        remark: Report,
        rated: float,
        signals: Mapping[int, str],
        known: frozenset[str],
        accel: tuple[int, float],
    ) -> None:
        super().__init__(report, remark, rated, signals, known, accel)
        self._programs = programs
        self._budget = _LOOPED + sum(
            map(_length, (s for p in programs.values() for s in p.statements))
        )
        self._line = 0

    def run(self, routine: Routine) -> None:
        """Carries out ``routine`` and what it calls. What cannot be, is reported."""
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
        """The budget pays for the instruction in ``line``."""
        self._line = line
        self._budget -= 1
        if self._budget < 0:
            raise _Exhausted

    def _unreadable(self, statement: Statement, error: Unreadable) -> None:
        self.report(statement.line, str(error))
        if statement.word in _MOTIONS:
            self.lost()

    def _next(self, routine: Routine, loops: list[_Loop], index: int, statement: Statement) -> int:
        """Carries out one instruction; the index of the one after it."""
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
        """Raises Unreadable for what is not evaluated."""
        if word in _OTHER_MOTIONS:
            self.lost()
        if word in _OTHERS | _OTHER_MOTIONS:
            raise Unreadable(f"{word} is not evaluated")
        raise Unreadable(f"unknown statement {word[:40]}")

    def call(self, statement: Statement) -> None:
        """``CALL name()``."""
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
        """``AUTO``, ``LOCAL`` and ``GLOBAL``."""
        self.declare(statement.rest, statement.word != "GLOBAL")
        if statement.word != "AUTO":
            self.remark(
                statement.line,
                f"{statement.word}: its variables outlive the program, those of AUTO do not",
            )


def _line_at(routine: Routine, index: int) -> int:
    """Line of a statement by its index; of the program where the index is behind the last one."""
    if index < len(routine.statements):
        return routine.statements[index].line
    return routine.line


def _length(statement: Statement | Stretch) -> int:
    return len(statement.poses) if isinstance(statement, Stretch) else 1


#: Not kept by the machine: it would then be in a circle with itself, and stay when nobody needs it any more.
_DOES: dict[str, Callable[[Machine, Statement], None]] = {
    "=": Machine.let, "ACCEL": Machine.accel, "APPRO": Machine.appro, "APPROS": Machine.appro,
    "ATTACH": Machine.attach, "AUTO": Machine.declares, "BASE": Machine.base, "BREAK": Machine.brake,
    "CALL": Machine.call, "DELAY": Machine.delay, "DEPART": Machine.depart, "DEPARTS": Machine.depart,
    "DETACH": Machine.detach, "DISABLE": Machine.switch, "ENABLE": Machine.switch, "GLOBAL": Machine.declares,
    "LOCAL": Machine.declares, "MOVE": Machine.move, "MOVES": Machine.move, "PAUSE": Machine.stop,
    "SELECT": Machine.select, "SET": Machine.set, "SIGNAL": Machine.signal, "SPEED": Machine.speed,
    "TOOL": Machine.set_tool, "WAIT.EVENT": Machine.wait_event,
    **dict.fromkeys(POSTURES, Machine.configure),
    **dict.fromkeys(("COARSE", "FINE", "NULL", "NONULL"), Machine.settle),
}  # fmt: skip


#: How far the printed digits may move a turn on the spot, mm: 0.1 with one decimal, and its double.
_SPOT = 0.2
#: The defaults of the post's options that give numbers their meaning (docs/posts/vplus.md).
_RATED, _RATED_TURN, _SIGNALS, _TOOL, _WORK = 7500.0, 1200.0, {"process": 33}, "cg.tool", "cg.work"
#: The options that name the tool and the work frame, with their defaults.
_FRAMES = (("tool", _TOOL), ("work", _WORK))


def read(files: Mapping[str, str], options: Mapping[str, object]) -> Executed:
    """What the files say. options: ``rated``, ``rated_turn``, ``signals``; ``declare = false`` with ``tool``, ``work``.

    A target ``frame:..`` is given in that frame when all targets name the same one, which then is ``work``; else all
    are given in the base, and ``work`` is the identity. A motion before BREAK stops (blend 0), another blends by 1 mm.
    ``points = "file"``: a reader and its data file, in this order.
    """
    if options.get("points") == "file":
        return read_data(files, options, read)
    log = Log()

    def report(line: int, what: str) -> None:
        log.find("refused", what, line=line)

    def remark(line: int, what: str) -> None:
        log.find("unusual", what, line=line)

    machine = _run(files, options, report, remark)
    _check_given(machine, options, remark)
    if machine.axes == 4:
        check_scara(machine)
    work, body, lines = _translate(machine, report)
    if not any(machine.frames):  # no target says what it is given in
        work = machine.stated.get(canonical(str(options.get("work", _WORK))))
    _check_turning(tuple(body), lines, machine.turning, remark)
    body = _with_turns(tuple(body), machine.turning, _number(options, "rated_turn", _RATED_TURN))
    frames = Frames(base_from_work=work, flange_from_tool=machine.tool)
    return Executed(body, tuple(lines), (frames,), findings=log.list_findings())


def _run(
    files: Mapping[str, str], options: Mapping[str, object], report: Report, remark: Report
) -> Machine:
    """The machine after it has run what the files say."""
    found = routines(files, report, remark)
    programs: dict[str, Routine] = {}
    for routine in found:
        programs.setdefault(canonical(routine.name), routine)
    rated, signals, known = (
        _number(options, "rated", _RATED),
        _signal_names(options),
        _list_known(options),
    )
    accel = int(_number(options, "profile", 0)), _number(options, "accel", 100.0)
    machine = Machine(programs, report, remark, rated, signals, known, accel)
    machine.names = frozenset(_list_frames(options))
    posture = options.get("posture", ())
    machine.asked = (
        frozenset(map(str, posture)) if isinstance(posture, (list, tuple)) else frozenset()
    )
    for start in _start(list(programs.values()), report, remark):
        machine.run(start)
    return machine


def _number(options: Mapping[str, object], key: str, default: float) -> float:
    value = options.get(key, default)
    return float(value) if isinstance(value, (int, float)) and value > 0 else default


def _with_turns(
    body: Sequence[Instruction], turning: Sequence[tuple[int, float]], rated: float
) -> Sequence[Instruction]:
    """``body`` with the speed of its turns on the spot. turning: % of ``rated`` deg/s, from which place on."""
    columns = Columns(body)
    places = columns.at[columns.turned].tolist()
    begins = [begin for begin, _ in turning]
    rates = [turning[bisect_right(begins, place) - 1][1] for place in places]
    changed = {
        place: (replace(body[place], turn=math.radians(rate / 100 * rated)),)
        for place, rate in zip(places, rates, strict=True)
    }
    return splice(body, changed) if changed else body


def _check_turning(
    body: tuple[Instruction, ...],
    lines: Sequence[int],
    turning: Sequence[tuple[int, float]],
    remark: Report,
) -> None:
    """Remarks on a rotational speed below 100 % where the tool does not turn on the spot: it may slow the path."""
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
            remark(
                lines[straight[first]],
                f"{what}: where the tool turns, it may be slower than its SPEED",
            )


def _signal_names(options: Mapping[str, object]) -> dict[int, str]:
    table = options.get("signals", _SIGNALS)
    return (
        {n: str(name) for name, n in table.items() if isinstance(n, int)}
        if isinstance(table, Mapping)
        else {}
    )


def _list_known(options: Mapping[str, object]) -> frozenset[str]:
    """Locations that the text need not define."""
    return frozenset() if options.get("declare", True) else frozenset(_list_frames(options))


def _list_frames(options: Mapping[str, object]) -> tuple[str, str]:
    """The names of the tool and of the work frame, as V+ keeps them."""
    tool, work = (str(options.get(key, name)) for key, name in _FRAMES)
    return canonical(tool), canonical(work)


def _check_given(machine: Machine, options: Mapping[str, object], remark: Report) -> None:
    """Remarks on a tool or a work frame of the controller that is not the one that the options name."""
    tool, work = _list_frames(options)
    if machine.tool_name not in ("", tool):
        remark(1, f"the tool is {machine.tool_name}, not {tool} as post.tool has it")
    for line, frame in zip(machine.lines, machine.frames, strict=True):
        if frame is not None and frame.external not in ("", work):
            remark(line, f"a target in {frame.external}, not in {work} as post.work has it")


def _start(found: list[Routine], report: Report, remark: Report) -> list[Routine]:
    """The program that no other calls; several: the first."""
    called = set()
    for routine in found:
        for statement in routine.statements:
            if not isinstance(statement, Stretch) and statement.word == "CALL":
                called.add(canonical(statement.rest.partition("(")[0].strip()))
    roots = [r for r in found if canonical(r.name) not in called] or found[:1]
    if roots and roots[0] is not found[0]:
        remark(roots[0].line, f"{roots[0].name} calls the others and is not the first program")
    for other in roots[1:]:
        report(other.line, f"program {other.name} is called by no other and not evaluated")
    for routine in found:
        if routine.name.upper() in _ARGUMENTS:
            report(routine.line, f"{routine.name} is a word of V+, not the name of a program")
    if not roots:
        report(1, "there is no .PROGRAM")
    return roots[:1]


def _translate(
    robot: RobotState, report: Report
) -> tuple[Pose | None, Sequence[Instruction], Sequence[int]]:
    """The common frame, the instructions with poses in it, and their lines."""
    # Most frames are the same object as the one before.
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
            report(line, f"the frames of the targets differ, and {error}")
            continue
        lines.append(line)
    return NULL, body, lines


def _in_base(item: Instruction, frame: Frame | None) -> Instruction:
    if frame is None or not isinstance(item, (MoveJ, MoveL)) or not isinstance(item.target, Pose):
        return item
    return replace(item, target=Location(item.target, frame).in_base())


def _common(given: list[Frame]) -> Frame | None:
    """One of the frames if all are the same, else nothing; nothing, too, if that is the base."""
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
