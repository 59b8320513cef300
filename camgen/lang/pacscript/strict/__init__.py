"""Reads a DENSO PacScript program of a post back: text -> instructions, findings by line.

The interpreter of the motion part of the language is written from its manual. It refuses a line
that it does not evaluate (conditions, loops, free curves, extended axes) and guesses nothing. The
facts and their sources are listed in docs/posts/pacscript.md.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping

from camgen.lang.pacscript.plain import Plain
from camgen.lang.pacscript.words import name_fault
from camgen.lang.post_options import read_positive, read_signals
from camgen.lang.programs import Executed, Frames
from camgen.model.pose import Pose
from camgen.model.program import MoveC, MoveJ, MoveL, Output, Wait
from camgen.model.text import counted

from . import force, motion
from .conditions import carry_out_if
from .expected import read_expected
from .machine import UNITS, Machine
from .motion import carry_out
from .spelling import find_unusual
from .text import Procedure, SourceText, Statement, read_source
from .values import Unreadable, Value, arguments, evaluate, index, number

#: Maximum depth of calls, and number of statements beyond which a program counts as endless.
_CALLS, _STEPS = 20, 2_000_000
#: Largest number of a tool or work frame (manual 1943) and of an IO (manual 5512).
_LAST_FRAME, _LAST_IO = 63, 24063
#: Longest delay, ms.
_LONGEST_DELAY = 2**31 - 1
_SIGNALS = {"process": 24}
_VERB = re.compile(r"([a-z]\w*)\s*(.*)", re.IGNORECASE | re.ASCII | re.DOTALL)
_ASSIGNMENT = re.compile(
    r"(?:([a-z])\s*\[([^\]]*)\]|([a-z]\w*))\s*=\s*(.+)", re.IGNORECASE | re.ASCII
)
_DECLARATION = re.compile(r"([a-z]\w*)(?:\s+as\s+(\w+))?\s*(?:=\s*(.+))?", re.IGNORECASE | re.ASCII)
_CALL = re.compile(r"(\w+)\s*(?:\((.*)\))?")
_IO = re.compile(r"IO\s*\[([^\]]*)\]", re.IGNORECASE)
_TAKE = re.compile(r"(?:(.+?)\s*)??(?:,?\s*keep\s*=\s*(.+))?", re.IGNORECASE)
_SHORT = re.compile(r"([pjtvifds])(\d{1,9})", re.ASCII)
#: The only variable of a program of the post, and its type.
_VARIABLE = ("unit", "single")
#: First word of a block -> the word that closes it.
_BLOCKS = {"if": "end if", "for": "next", "do": "loop", "select": "end select"}
#: Statements that neither move the arm nor set an output. Posts do not write them.
_WITHOUT_EFFECT = frozenset({"printdbg", "printmsg"})
_NOT_EVALUATED = frozenset(
    {
        "archmove", "arrive", "clrpathpoint", "addpathpoint", "loadpathpoint", "cpmode", "drive",
        "drivea", "eralw", "exit", "forcechangetable", "forcesensor", "forcesensorpayload",
        "forcewaitcondition", "goto", "grvctrl", "grvoffset", "halt", "highpathaccuracy", "hold",
        "interrupt", "let", "letx", "lety", "letz", "motionskip", "motiontimeout", "on", "payload",
        "rotate", "rotateh", "run", "singularavoid", "speedmode", "suspend", "wait", "waitmotion",
        "zforce", "curlmt",
    }
)  # fmt: skip


def read(files: Mapping[str, str], options: Mapping[str, object]) -> Executed:
    """Runs a program.

    options: options of the post. rated, rated_turn, mps, signals, force_on, force_change and
        force_off give what the text does not state. The text must agree with those of `Expected`.

    A blend of `@P` is 1 mm, as its radius is up to the controller. Speeds in percent refer to
    `rated`. If `mps` does not name a unit, both units must result in the same speeds.
    Raises JobError if an option has the wrong type.
    """
    templates = force.templates(options)
    machine = Machine(
        rated=read_positive(options, "rated", 0.0),
        signals=read_signals(options, _SIGNALS),
        rated_turn=read_positive(options, "rated_turn", 500.0),
        units=_units(options),
        expected=read_expected(options),
    )
    source = read_source(files, machine.log, short=not force.may_say(templates, "Move"))
    if main := source.procedures.get("main"):
        run = _Run(machine, source, templates)
        run.called = main.line
        run.procedure(main)
        _finish(machine)
    work, tool = (machine.frames.get((kind, machine.numbers[kind])) for kind in ("work", "tool"))
    return Executed(
        tuple(machine.body),
        tuple(machine.lines),
        (Frames(base_from_work=work, flange_from_tool=tool),),
        findings=machine.log.list_findings(),
    )


def _units(options: Mapping[str, object]) -> tuple[float, ...]:
    """The possible speeds of `Mps(1)`, mm/s."""
    mps = options.get("mps", "ask")
    return (UNITS[mps],) if isinstance(mps, str) and mps in UNITS else tuple(UNITS.values())


def _finish(machine: Machine) -> None:
    """Adds findings for the state at the end of the program."""
    if machine.passing:
        line = _last_motion(machine)
        machine.log.find("refused", "the last motion passes its target", line=line)
    if machine.table is not None:
        machine.fault("force control is on at the end")
    if machine.armed:
        machine.remark("the arm is not given back")
    force.finish(machine)
    machine.judge_end()


def _last_motion(machine: Machine) -> int:
    """The line of the last motion, 0 if the program has none."""
    for item, line in zip(reversed(machine.body), reversed(machine.lines), strict=True):
        if isinstance(item, MoveJ | MoveL | MoveC):
            return line
    return 0


class _Run:
    """The run of a program.

    steps: number of statements that were run.
    called: line of the procedure that was called last.
    ended: whether calls were nested too deep. The run then ends, as it would never end by itself.
    """

    def __init__(
        self, machine: Machine, source: SourceText, templates: list[force.Template]
    ) -> None:
        self.machine, self.source, self.templates = machine, source, templates
        self.steps = 0
        self.called = 0
        self.ended = False

    def procedure(self, procedure: Procedure) -> None:
        """Runs the statements of a procedure to its end or `Exit Sub`."""
        statements, at = procedure.statements, 0
        while at < len(statements) and not self.ended:
            statement = statements[at]
            self.machine.line = statement.line if isinstance(statement, Plain) else statement[0]
            self.steps += 1
            if self.steps > _STEPS:
                self.machine.fault("more statements than a program can have")
                return
            if isinstance(statement, Plain):
                self._move(statement)
                at += 1
            else:
                at += self._step(statements, at, statement[1])

    def _move(self, item: Plain) -> None:
        try:
            carry_out(self.machine, item)
        except Unreadable as error:
            self.machine.fault(str(error))
            self.machine.current_pose = None

    def _step(self, statements: list[Statement], at: int, text: str) -> int:
        """Runs a statement. Returns the number of statements up to the next one."""
        machine = self.machine
        try:
            if self.templates and (
                force_lines := force.apply_template(machine, self.templates, statements, at)
            ):
                return force_lines
            for what in find_unusual(text):
                machine.remark(what)
            match = _VERB.fullmatch(text)
            verb = match[1].lower() if match else ""
            if verb == "if" and (count := carry_out_if(machine, statements, at)):
                return count
            if verb in _BLOCKS:
                return self._skip(statements, at, text.lower(), verb)
            if match and verb == "exit" and match[2].lower() in ("sub", "function"):
                machine.remark("the procedure is left outside the question of the post for Mps")
                return len(statements) - at
            if match and verb == "call":
                self._call(match[2])
            elif match and verb in _STATEMENTS:
                _STATEMENTS[verb](machine, match[2])
            elif verb in _WITHOUT_EFFECT:
                machine.remark(f"{text.split(maxsplit=1)[0]}, which no program of the post has")
            else:
                _otherwise(machine, text, verb)
        except Unreadable as error:
            machine.fault(str(error))
            machine.current_pose = None
        return 1

    def _skip(self, statements: list[Statement], at: int, text: str, verb: str) -> int:
        """Refuses a block that is not evaluated and skips it. Its effect depends on the machine.

        Returns the number of statements up to the next one.
        """
        self.machine.current_pose = None
        if verb == "if" and not text.endswith("then"):
            self.machine.fault("If is not evaluated")
            return 1
        depth, closing = 0, _BLOCKS[verb]
        for count, other in enumerate(statements[at:]):
            if isinstance(other, Plain):
                continue
            words = " ".join(other[1].lower().split())
            if re.match(rf"{verb}\b", words) and (verb != "if" or words.endswith("then")):
                depth += 1
            elif re.match(rf"{closing}\b", words) or (verb == "if" and words == "endif"):
                depth -= 1
            if depth == 0:
                self.machine.fault(f"{verb.capitalize()} is not evaluated, up to line {other[0]}")
                self.steps += count
                return count + 1
        self.machine.fault(f"{verb.capitalize()} has no {closing.title()}")
        return len(statements) - at

    def _call(self, rest: str) -> None:
        machine = self.machine
        match = _CALL.fullmatch(rest)
        called = self.source.procedures.get(match[1].lower()) if match else None
        if match is None or called is None:
            raise Unreadable(f"unknown procedure {rest}")
        values = [evaluate(part, machine.lookup) for part in arguments(match[2] or "") if part]
        if len(values) != len(called.parameters):
            raise Unreadable(
                f"{match[1]} takes {counted(len(called.parameters), 'value')}, not {len(values)}"
            )
        if len(machine.scopes) > _CALLS:
            self.ended = True
            raise Unreadable("procedures that call each other without end")
        if called.line < self.called:
            machine.remark("procedures are called in another order than they are written")
        self.called = called.line
        machine.enter(called.parameters, values)
        line = machine.line
        self.procedure(called)
        machine.leave()
        machine.line = line


def _otherwise(machine: Machine, text: str, verb: str) -> None:
    """Runs an assignment. Raises Unreadable for another statement."""
    assignment = _ASSIGNMENT.fullmatch(text)
    if assignment is None or verb == "io":
        if verb in _NOT_EVALUATED:
            raise Unreadable(f"{text.split(maxsplit=1)[0]} is not evaluated")
        raise Unreadable(f"unknown statement {text[:60]}")
    letter, position, name, expression = assignment.groups()
    if name and (what := name_fault(name)):
        raise Unreadable(what)
    value = evaluate(expression, machine.lookup)
    machine.remark("a variable gets a value, outside the question of the post for Mps")
    short = _SHORT.fullmatch(name.lower()) if name else None
    if letter:
        machine.name((letter.lower(), index(number(position, machine.lookup))), value)
    elif short:
        machine.name((short[1], int(short[2])), value)
    else:
        machine.name(name.lower(), value)


def _declare(machine: Machine, rest: str) -> None:
    for part in arguments(rest):
        match = _DECLARATION.fullmatch(part)
        if match is None:
            raise Unreadable(f"Dim {part} is not evaluated")
        if what := name_fault(match[1]):
            raise Unreadable(what)
        machine.declare(match[1].lower(), (match[2] or "variant").lower())
        if (match[1].lower(), (match[2] or "").lower()) != _VARIABLE:
            machine.remark(f"the variable {match[1]}, which no program of the post has")
        if match[3] and (match[2] or "").lower() != "string":
            machine.name(match[1].lower(), evaluate(match[3], machine.lookup))


def _take_arm(machine: Machine, rest: str) -> None:
    """Runs `TakeArm [group] [Keep = 0|1]`."""
    if machine.armed:
        machine.remark("the arm is taken twice")
    if machine.questions:
        machine.remark("TakeArm after a question for Mps, which may leave the program")
    machine.armed, machine.given = True, False
    match = _TAKE.fullmatch(rest)
    group = index(number(match[1], machine.lookup)) if match and match[1] else 0
    keep = number(match[2], machine.lookup) if match and match[2] else 1.0
    if match is None or keep not in (0, 1):
        raise Unreadable(f"TakeArm {rest[:40]}; Keep is 0 or 1")
    if group:
        machine.remark(f"arm group {group}, which no program of the post takes")
    if keep:
        machine.remark("TakeArm without Keep = 0, so that what the last program has set may hold")
    else:
        # It is believed to set the internal speed to 100 % and both frames to 0. Programs of the
        # post do not rely on this.
        machine.internal = 100.0
        if machine.moved and any(machine.numbers.values()):
            machine.fault("TakeArm Keep = 0 after the first motion: the frames may change")
        machine.numbers.update(tool=0, work=0)
        machine.settled = False


def _give_arm(machine: Machine, rest: str) -> None:
    if not machine.armed:
        machine.remark("GiveArm of an arm that is not taken")
    machine.armed, machine.given = False, True
    if rest:
        raise Unreadable(f"GiveArm has no arguments, not {rest[:40]}")


def _motor(machine: Machine, rest: str) -> None:
    state = number(rest, machine.lookup)
    if state not in (0, 1):
        raise Unreadable(f"Motor {rest[:40]} is not On or Off")
    machine.motor = bool(state)
    machine.remark(f"Motor {'On' if state else 'Off'}, which no option asks for")


def _change(kind: str) -> Callable[[Machine, str], None]:
    def handler(machine: Machine, rest: str) -> None:
        chosen = _frame_number(machine, rest, kind, 0)
        if machine.moved and chosen != machine.numbers[kind]:
            machine.fault(f"the {kind} frame changes after the first motion")
            machine.current_pose = None
        machine.numbers[kind], machine.settled = chosen, False

    return handler


def _frame_number(machine: Machine, text: str, kind: str, least: int) -> int:
    """The number of a frame. 0 is that of the controller, the flange or the base."""
    chosen = index(number(text, machine.lookup))
    if not least <= chosen <= _LAST_FRAME:
        raise Unreadable(f"{kind} {chosen}; there are {least} to {_LAST_FRAME}")
    return chosen


def _define(kind: str) -> Callable[[Machine, str], None]:
    def handler(machine: Machine, rest: str) -> None:
        parts = arguments(rest)
        frame: Value = evaluate(parts[1], machine.lookup) if len(parts) == 2 else 0.0
        if not isinstance(frame, Pose):
            raise Unreadable(f"{kind.capitalize()} needs a number and a position")
        chosen = _frame_number(machine, parts[0], kind, 1 if kind == "tool" else 0)
        if not machine.expected.define:
            reason = "though post.define does not ask for it"
            machine.remark(f"{kind} {chosen} is written to the controller, {reason}")
        if machine.moved and chosen == machine.numbers[kind]:
            machine.fault(f"the {kind} frame changes after the first motion")
        machine.frames[(kind, chosen)] = frame

    return handler


def _switch(value: float) -> Callable[[Machine, str], None]:
    def handler(machine: Machine, rest: str) -> None:
        match = _IO.fullmatch(rest)
        if match is None:
            raise Unreadable(f"an output of {rest or 'nothing'} is not evaluated")
        io = index(number(match[1], machine.lookup))
        if io > _LAST_IO:
            raise Unreadable(f"IO[{io}]; the highest is IO[{_LAST_IO}]")
        machine.emit_still(Output(machine.signals.get(io, f"IO[{io}]"), value))

    return handler


def _delay(machine: Machine, rest: str) -> None:
    milliseconds = number(rest, machine.lookup)
    if not 0 <= milliseconds <= _LONGEST_DELAY:
        too_long = "a delay longer than a controller holds"
        raise Unreadable("a negative delay" if milliseconds < 0 else too_long)
    if milliseconds != int(milliseconds):
        machine.remark(f"a delay of {milliseconds:g} ms, no whole number; seconds are not meant")
    machine.emit_still(Wait(milliseconds / 1000))


_STATEMENTS: dict[str, Callable[[Machine, str], None]] = {
    "accel": motion.acceleration,
    "approach": motion.approach,
    "changetool": _change("tool"),
    "changework": _change("work"),
    "decel": motion.deceleration,
    "delay": _delay,
    "depart": motion.depart,
    "dim": _declare,
    "draw": motion.draw,
    "extspeed": motion.external_speed,
    "forcectrl": force.control,
    "forceparam": force.parameter,
    "givearm": _give_arm,
    "motor": _motor,
    "move": motion.move,
    "reset": _switch(0.0),
    "set": _switch(1.0),
    "speed": motion.speed_statement,
    "takearm": _take_arm,
    "tool": _define("tool"),
    "work": _define("work"),
}
