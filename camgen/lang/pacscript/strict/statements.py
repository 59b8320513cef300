"""The statements of a strict run. A statement that no program of a post has is a finding."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import partial

from camgen.lang.code import Act, Compiler, Effect, Return
from camgen.lang.columns import Run
from camgen.lang.pacscript import motions
from camgen.lang.pacscript.code import ProcedureCode, make_motions
from camgen.lang.pacscript.expressions import arguments, parse
from camgen.lang.pacscript.lines import split_rows, without_comment
from camgen.lang.pacscript.motion import LINEAR, Motion, read_motion
from camgen.lang.pacscript.settings import LAST_FRAME, LONGEST_DELAY
from camgen.lang.pacscript.source import Procedure, Statement
from camgen.lang.pacscript.state import LAST_SIGNAL
from camgen.lang.pacscript.statements import TAKE
from camgen.lang.pacscript.values import Unreadable, index
from camgen.lang.pacscript.words import name_fault
from camgen.lang.values import require
from camgen.model.pose import Pose
from camgen.model.program import Output, Wait
from camgen.model.text import counted

from . import force
from .conditions import ask_question, read_question, read_words
from .run import StrictRun
from .spelling import note_unusual
from .values import TYPES, check_speed

_VERB = re.compile(r"([a-z]\w*)\s*(.*)", re.IGNORECASE | re.ASCII | re.DOTALL)
_ASSIGNMENT = re.compile(r"([a-z]\s*\[[^\]]*\]|([a-z]\w*))\s*=\s*(.+)", re.IGNORECASE | re.ASCII)
_DECLARATION = re.compile(r"([a-z]\w*)(?:\s+as\s+(\w+))?\s*(?:=\s*(.+))?", re.IGNORECASE | re.ASCII)
_IO = re.compile(r"IO\s*\[([^\]]*)\]", re.IGNORECASE)
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


def compile_strictly(procedure: Procedure, templates: list[force.Template]) -> ProcedureCode:
    """The steps of a procedure. Faults are found when their statement runs.

    templates: force lines of the options.
    """
    compiler = Compiler()
    statements = _list_statements(procedure, force.may_say(templates, "Move"))
    at = 0
    while at < len(statements):
        line, text = statements[at]
        if force_lines := force.read_template(templates, statements, at):
            compiler.add(Act(line, do=force.run_template, operand=force_lines))
            at += force_lines.line_count
        elif isinstance(text, Run):
            compiler.add(make_motions(line, text))
            at += 1
        else:
            at += _add_statement(compiler, statements, at, text)
    return ProcedureCode(compiler.finish(), frozenset())


def _list_statements(procedure: Procedure, by_line: bool) -> list[Statement]:
    """The statements of a procedure.

    by_line: whether motions in the usual spelling may be lines of a template.
    """
    if not by_line:
        return procedure.statements
    statements = []
    for line, text in procedure.statements:
        rows = split_rows(text) if isinstance(text, Run) else [text]
        for number, row in enumerate(rows, start=line):
            statements.append(Statement(number, without_comment(row)))
    return statements


def _add_statement(compiler: Compiler, statements: Sequence[Statement], at: int, text: str) -> int:
    """Adds the step of a statement or of a block. Returns the number of its statements."""
    line = statements[at].line
    match = _VERB.match(text)
    verb = match[1].lower() if match else ""
    if verb in _BLOCKS:
        if verb == "if" and (question := read_question(statements, at)):
            compiler.add(Act(line, do=ask_question, operand=question))
            return len(question.statements)
        fault, count = _find_block(statements, at, verb)
        compiler.add(Act(line, cost=count, do=_refuse_block, operand=(text, fault)))
        return count
    compiler.add(Act(line, do=run_statement, operand=text, effect=Effect.ACTS))
    return 1


def _find_block(statements: Sequence[Statement], at: int, verb: str) -> tuple[str, int]:
    """The fault of a block, which depends on the machine, and the number of its statements."""
    if verb == "if" and not read_words(statements[at]).endswith("then"):
        return "If is not evaluated", 1
    depth, closing = 0, _BLOCKS[verb]
    for count, other in enumerate(statements[at:], start=1):
        words = read_words(other)
        if re.match(rf"{verb}\b", words) and (verb != "if" or words.endswith("then")):
            depth += 1
        elif re.match(rf"{closing}\b", words) or (verb == "if" and words == "endif"):
            depth -= 1
        if depth == 0:
            return f"{verb.capitalize()} is not evaluated, up to line {other.line}", count
    return f"{verb.capitalize()} has no {closing.title()}", len(statements) - at


def _refuse_block(run: StrictRun, operand: tuple[str, str]) -> None:
    text, fault = operand
    note_unusual(run.machine, text)
    raise Unreadable(fault)


def run_statement(run: StrictRun, text: str) -> Return | None:
    """Runs a statement. Returns the step that leaves the procedure for `Exit Sub`."""
    machine = run.machine
    note_unusual(run.machine, text)
    match = _VERB.fullmatch(text)
    verb, rest = (match[1].lower(), match[2]) if match else ("", "")
    if verb == "exit" and rest.lower() in ("sub", "function"):
        machine.remark("the procedure is left outside the question of the post for Mps")
        return Return(machine.line)
    if verb in _STATEMENTS:
        _STATEMENTS[verb](run, rest)
    elif verb in _WITHOUT_EFFECT:
        machine.remark(f"{text.split(maxsplit=1)[0]}, which no program of the post has")
    else:
        _assign(run, text, verb)
    return None


def _assign(run: StrictRun, text: str, verb: str) -> None:
    """Runs an assignment. Raises Unreadable for another statement."""
    assignment = _ASSIGNMENT.fullmatch(text)
    if assignment is None or verb == "io":
        if verb in _NOT_EVALUATED:
            raise Unreadable(f"{text.split(maxsplit=1)[0]} is not evaluated")
        raise Unreadable(f"unknown statement {text[:60]}")
    target, name, expression = assignment.groups()
    if name and (what := name_fault(name)):
        raise Unreadable(what)
    value = run.evaluate(parse(expression))
    run.machine.remark("a variable gets a value, outside the question of the post for Mps")
    run.set_variable(parse(target), value)


def _declare(run: StrictRun, rest: str) -> None:
    for part in arguments(rest):
        match = require(_DECLARATION.fullmatch(part), Unreadable(f"Dim {part} is not evaluated"))
        if what := name_fault(match[1]):
            raise Unreadable(what)
        name, kind = match[1].lower(), (match[2] or "variant").lower()
        if name in run.scope.kinds:
            raise Unreadable(f"{name} is declared twice")
        if kind not in TYPES:
            raise Unreadable(f"{kind} is not a type")
        run.scope.kinds[name] = kind
        if (name, kind) != _VARIABLE:
            run.machine.remark(f"the variable {match[1]}, which no program of the post has")
        if match[3] and kind != "string":
            run.set_variable(parse(name), run.evaluate(parse(match[3])))


# -- arm, frames and outputs -----------------------------------------------------------------------


def _take_arm(run: StrictRun, rest: str) -> None:
    machine = run.machine
    if machine.armed:
        machine.remark("the arm is taken twice")
    if machine.questions:
        machine.remark("TakeArm after a question for Mps, which may leave the program")
    machine.armed, machine.given_back = True, False
    match = TAKE.fullmatch(rest)
    group = index(run.read_number(match[1])) if match and match[1] else 0
    keep = run.read_number(match[2]) if match and match[2] else 1.0
    if keep not in (0, 1):
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


def _give_arm(run: StrictRun, rest: str) -> None:
    machine = run.machine
    if not machine.armed:
        machine.remark("GiveArm of an arm that is not taken")
    machine.armed, machine.given_back = False, True
    if rest:
        raise Unreadable(f"GiveArm has no arguments, not {rest[:40]}")


def _motor(run: StrictRun, rest: str) -> None:
    state = run.read_number(rest)
    if state not in (0, 1):
        raise Unreadable(f"Motor {rest[:40]} is not On or Off")
    run.machine.motor = bool(state)
    run.machine.remark(f"Motor {'On' if state else 'Off'}, which no option asks for")


def _change(run: StrictRun, rest: str, *, kind: str) -> None:
    machine = run.machine
    chosen = _read_frame(run, rest, kind, 0)
    if machine.moved and chosen != machine.numbers[kind]:
        machine.fault(f"the {kind} frame changes after the first motion")
        machine.forget_place()
    machine.numbers[kind], machine.settled = chosen, False


def _define(run: StrictRun, rest: str, *, kind: str) -> None:
    machine = run.machine
    parts = arguments(rest)
    frame = run.evaluate(parse(parts[1])) if len(parts) == 2 else 0.0
    if not isinstance(frame, Pose):
        raise Unreadable(f"{kind.capitalize()} needs a number and a position")
    chosen = _read_frame(run, parts[0], kind, int(kind == "tool"))
    if not machine.expected.define:
        reason = "though post.define does not ask for it"
        machine.remark(f"{kind} {chosen} is written to the controller, {reason}")
    if machine.moved and chosen == machine.numbers[kind]:
        machine.fault(f"the {kind} frame changes after the first motion")
    machine.defined[(kind, chosen)] = frame


def _read_frame(run: StrictRun, text: str, kind: str, least: int) -> int:
    """The number of a frame. 0 is that of the controller, the flange or the base."""
    chosen = index(run.read_number(text))
    if not least <= chosen <= LAST_FRAME:
        raise Unreadable(f"{kind} {chosen}; there are {least} to {LAST_FRAME}")
    return chosen


def _switch(run: StrictRun, rest: str, *, level: float) -> None:
    match = require(
        _IO.fullmatch(rest), Unreadable(f"an output of {rest or 'nothing'} is not evaluated")
    )
    io = index(run.read_number(match[1]))
    if io > LAST_SIGNAL:
        raise Unreadable(f"IO[{io}]; the highest is IO[{LAST_SIGNAL}]")
    run.machine.emit_still(Output(run.machine.signals.get(io, f"IO[{io}]"), level))


def _delay(run: StrictRun, rest: str) -> None:
    milliseconds = run.read_number(rest)
    if milliseconds < 0:
        raise Unreadable("a negative delay")
    if milliseconds > LONGEST_DELAY:
        raise Unreadable("a delay longer than a controller holds")
    if milliseconds != int(milliseconds):
        what = f"a delay of {milliseconds:g} ms, no whole number; seconds are not meant"
        run.machine.remark(what)
    run.machine.emit_still(Wait(milliseconds / 1000))


# -- speeds and motions ----------------------------------------------------------------------------


def _set_speed(run: StrictRun, rest: str) -> None:
    """Runs `Speed`, in percent or by `Mps`, for motions without a speed of their own."""
    machine = run.machine
    machine.internal = machine.stated_internal = check_speed(run.evaluate(parse(rest)))
    machine.acceleration, machine.settled = (), False  # Speed changes it (reference, Speed).


def _set_external_speed(run: StrictRun, rest: str) -> None:
    machine = run.machine
    values = [run.read_number(part) for part in arguments(rest)]
    if not 0 < values[0] <= 100:
        raise Unreadable(f"an external speed of {values[0]:g} %")
    machine.external = machine.stated_external = values[0]
    machine.settled = False
    if len(values) > 1:
        machine.remark("ExtSpeed with an acceleration, which no option asks for")


def _set_acceleration(run: StrictRun, rest: str) -> None:
    values = _read_percent(run, rest)
    run.machine.acceleration = (*values, *run.machine.acceleration[1:])[:2]


def _set_deceleration(run: StrictRun, rest: str) -> None:
    values = _read_percent(run, rest)
    run.machine.acceleration = (*run.machine.acceleration[:1], *values[:1])


def _read_percent(run: StrictRun, rest: str) -> list[float]:
    """One or two accelerations, %. Raises Unreadable if they are out of range."""
    run.machine.settled = False
    values = [run.read_number(part) for part in arguments(rest)]
    for value in values:
        if not 0.0001 <= value <= 100:
            raise Unreadable(f"an acceleration of {value:g} %")
    if len(values) > 2:
        raise Unreadable("an acceleration has one value or two")
    return values


def _move(run: StrictRun, rest: str) -> None:
    kind = arguments(rest)[0]
    if kind.lower() not in (*LINEAR, "c"):
        raise Unreadable(f"Move {kind} is not evaluated")
    motion = _read_motion(rest, "c")
    if motion.kind == "c" and len(motion.goals) != 2:
        raise Unreadable(f"Move C has {counted(len(motion.goals), 'point')} instead of two")
    motions.move(run, motion)


def _move_back(run: StrictRun, rest: str, *, do: Callable[[StrictRun, Motion], None]) -> None:
    do(run, _read_motion(rest))


def _read_motion(rest: str, *kinds: str) -> Motion:
    motion = read_motion(rest, (*LINEAR, *kinds))
    if any(goal.extended is not None for goal in motion.goals):
        raise Unreadable("extended axes are not evaluated")
    return motion


_STATEMENTS: dict[str, Callable[[StrictRun, str], None]] = {
    "accel": _set_acceleration,
    "approach": partial(_move_back, do=motions.approach),
    "call": StrictRun.call_procedure,
    "changetool": partial(_change, kind="tool"),
    "changework": partial(_change, kind="work"),
    "decel": _set_deceleration,
    "delay": _delay,
    "depart": partial(_move_back, do=motions.depart),
    "dim": _declare,
    "draw": partial(_move_back, do=motions.draw),
    "extspeed": _set_external_speed,
    "forcectrl": force.control,
    "forceparam": force.parameter,
    "givearm": _give_arm,
    "motor": _motor,
    "move": _move,
    "reset": partial(_switch, level=0.0),
    "set": partial(_switch, level=1.0),
    "speed": _set_speed,
    "takearm": _take_arm,
    "tool": partial(_define, kind="tool"),
    "work": partial(_define, kind="work"),
}
