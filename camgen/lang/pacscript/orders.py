"""The actions of statements with names, calls, outputs and inputs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from camgen.lang.pacscript.evaluate import (
    STORED_NAME,
    assign,
    assign_axis,
    assign_component,
    assign_name,
    evaluate_all,
    fit,
)
from camgen.lang.pacscript.expressions import Node
from camgen.lang.pacscript.functions import ASKED, FUNCTIONS
from camgen.lang.pacscript.machine import blank, copy_value
from camgen.lang.pacscript.state import State
from camgen.lang.pacscript.values import Array, Unreadable, Value, index, number
from camgen.lang.run import Stopped
from camgen.lang.values import Unknown, find_first_unknown
from camgen.model.program import Output

#: Outputs that one statement may switch.
_MOST_OUTPUTS = 256


class Declaration(NamedTuple):
    """A variable of ``Dim``.

    kind: its type in lower case.
    tops: largest indices of an array, None of another variable.
    value: its first value, None without one.
    """

    name: str
    kind: str
    tops: tuple[Node, ...] | None
    value: Node | None


class Assignment(NamedTuple):
    """``target = value``."""

    target: Node
    value: Node


class Calling(NamedTuple):
    """A name or a member with the values that it takes."""

    target: Node
    values: tuple[Node, ...]


class Switching(NamedTuple):
    """``Set`` and ``Reset``.

    which: the output, or the number of the first one.
    upto: number of the last output, None for a single one.
    level: 1 of Set, 0 of Reset.
    value: expression of the level.
    is_pulse: whether the output switches back by itself.
    """

    which: Node
    upto: Node | None
    level: float
    value: Node
    is_pulse: bool


def declare(run: State, declarations: Sequence[Declaration]) -> None:
    """``Dim`` and the other declarations."""
    for name, kind, tops, init in declarations:
        if tops is not None:
            sizes = evaluate_all(run, tops)
            limits: tuple[int, ...] = ()
            if find_first_unknown(sizes) is None:
                limits = tuple(int(number(size)) for size in sizes)
            run.scope.kinds[name] = kind
            run.scope.names[name] = Array(limits, blank(kind))
            if init is not None and isinstance(value := run.evaluate(init), Array):
                run.scope.names[name] = value.copy()
        elif init is not None:
            value = run.evaluate(init)
            run.scope.kinds[name] = kind
            run.scope.names[name] = copy_value(fit(value, kind))
        elif name not in run.scope.kinds:
            run.scope.kinds[name] = kind
            run.scope.names[name] = blank(kind)


def define_port(run: State, port: tuple[str, Node]) -> None:
    """``DefIO name = kind, number``."""
    at = run.evaluate(port[1])
    run.scope.ios[port[0]] = -1 if isinstance(at, Unknown) else int(number(at))


def set_variable(run: State, assignment: Assignment) -> None:
    """``target = value``."""
    target, value = assignment
    try:
        assign(run, target, copy_value(run.evaluate(value)))
    except Unreadable as error:
        # The value from before is no longer the value of the variable.
        if target.kind in ("name", "index", "call"):
            assign(run, target, Unknown(f"{target.content} ({error})"))
        raise


def call(run: State, calling: Calling) -> None:
    """Run a call of a procedure, a function or a method."""
    node = calling.target
    name = str(node.content)
    if node.kind == "member":
        evaluate_all(run, calling.values)
        owner = node.parts[0]
        module = run.read(run.stems[str(owner.content)]) if owner.content in run.stems else None
        procedure = module.procedures.get(name) if module is not None else None
        if module is not None and procedure is not None:
            run.call((module, procedure), calling.values)
        else:
            run.log.fact("other devices", f"{owner.content}.{name}")
        return
    called = run.find_procedure(name)
    if called is not None:
        run.call(called, calling.values)
        return
    values = evaluate_all(run, calling.values)
    if name == "msgbox":
        run.machine.stop()
    elif name not in FUNCTIONS and name not in ASKED:
        run.leave_out(name)
        for part, value in zip(calling.values, values, strict=True):
            _fill(run, name, part, value)


def _fill(run: State, name: str, part: Node, value: Value) -> None:
    """Forgets a variable without a value that a missing procedure takes: it may be set there."""
    variable = str(part.content)
    scope = run.scope if variable in run.scope.names else run.module_scope
    if part.kind not in ("name", "call") or variable not in scope.names:
        return
    filled = Unknown(f"{variable} from {name}")
    if isinstance(value, Array) and not value.items:
        scope.names[variable] = Array(value.tops, filled)
    elif value == blank(scope.kinds.get(variable, "variant")):
        scope.names[variable] = filled


def start_task(run: State, calling: Calling) -> None:
    """``Run``: a task beside this one."""
    evaluate_all(run, calling.values)
    run.machine.tasks.setdefault(str(calling.target.content).lower(), run.machine.line)


def switch(run: State, switching: Switching) -> None:
    """``Set`` and ``Reset``."""
    level = run.evaluate(switching.value)
    for at in _signals(run, switching.which, switching.upto):
        if isinstance(at, int):
            run.set_signal(at, level)
            if switching.is_pulse:
                run.machine.emit(Output(str(at), 1.0 - switching.level))
                run.log.fact("pulses", f"IO[{at}]")
        elif not run.write_port(at, level):
            assign_name(run, at, level)


def _signals(run: State, which: Node, upto: Node | None) -> list[int | str]:
    if upto is not None:
        ends = run.evaluate(which), run.evaluate(upto)
        if any(isinstance(end, Unknown) for end in ends):
            run.log.leave_out("outputs whose numbers the text does not hold are left out")
            return []
        first, last = (index(number(end)) for end in ends)
        if last - first >= _MOST_OUTPUTS:
            raise Unreadable(f"IO[{first} To {last}] names more than {_MOST_OUTPUTS} outputs")
        return list(range(first, last + 1))
    if which.kind == "index" and which.content == "io" and which.parts:
        at = run.evaluate(which.parts[0])
        if isinstance(at, Unknown):
            run.log.leave_out(
                f"{at.what}, the number of an output, is not known: it is left out", at.key
            )
            return []
        return [index(number(at))]
    if which.kind == "name":
        name = str(which.content)
        short = STORED_NAME.fullmatch(name)
        return [int(short[2]) if short and short[1] == "io" else name]
    raise Unreadable("an output that is not understood")


def assign_part(run: State, letting: tuple[list[Node], Node], part: str) -> None:
    """Run `LetX [axis,] target = value`. part: X."""
    targets, value = letting
    if part == "f":
        run.log.fact("posture", "LetF sets the figure of a position")
    if len(targets) == 1:
        assign_component(run, part, targets[0], run.evaluate(value))
    else:
        assign_axis(run, targets[-1], run.evaluate(targets[0]), run.evaluate(value))


def omit(run: State, remark: str) -> None:
    """A statement that another machine does without. remark: its text and its effect."""
    run.log.omit(remark)


def lose(run: State, remark: str) -> None:
    """A statement that would move or switch another machine differently."""
    run.log.leave_out(remark)


def wait(run: State, parts: Sequence[Node]) -> None:
    """``Wait condition[, time[, result]]``: over at once, and its condition holds from then on."""
    condition, *others = parts
    holds = run.evaluate(condition)
    if isinstance(holds, Unknown) or not number(holds):
        given = _find_given(run, condition)
        unknown = holds if isinstance(holds, Unknown) else Unknown("what others set")
        if given and unknown is not holds:
            raise Stopped(f"waits forever: {given} is given otherwise")
        run.log.choose(f"Wait for {unknown.what} is over at once", unknown.key)
        _learn(run, condition)
    run.machine.passing = False
    if len(others) > 1 and others[1].kind in ("name", "index"):
        assign(run, others[1], 1.0)


def _find_given(run: State, node: Node) -> str:
    """Return the first value of a condition that the user has given, empty without one."""
    if node.kind == "index" and node.parts and node.parts[0].kind == "number":
        key = f"{node.content}[{node.parts[0].content:g}]"
        return key if run.machine.given(key) is not None else ""
    if node.kind == "name" and run.machine.given(str(node.content)) is not None:
        return str(node.content)
    return next(filter(None, (_find_given(run, part) for part in node.parts)), "")


def _learn(run: State, node: Node) -> None:
    """Set variables and inputs so that a condition holds. It is an equation, or several of them."""
    if node.kind == "and":
        _learn(run, node.parts[0])
        _learn(run, node.parts[1])
    elif node.kind == "=" and node.parts[0].kind in ("name", "index"):
        try:
            value = run.evaluate(node.parts[1])
            if not isinstance(value, Unknown):
                _assign_awaited(run, node.parts[0], value)
        except Unreadable:
            return
    elif node.kind in ("name", "index"):
        _assign_awaited(run, node, 1.0)


def _assign_awaited(run: State, node: Node, value: Value) -> None:
    name = str(node.content)
    short = STORED_NAME.fullmatch(name)
    if node.kind == "index" and name == "io":
        at = run.evaluate(node.parts[0])
        if not isinstance(at, Unknown):
            run.learned[index(number(at))] = value
    elif node.kind == "name" and short and short[1] == "io":
        run.learned[int(short[2])] = value
    elif node.kind == "index" or short or run.find_variable(name) is not None:
        assign(run, node, value)


def fill(run: State, targets: Sequence[Node], word: str) -> None:
    """``Input`` and other statements that fill variables from outside. word: the statement."""
    takes_all = word in ("input", "lineinput", "com_state")
    for node in targets if takes_all else targets[:1]:
        if node.kind in ("name", "index", "call"):
            name = str(node.content)
            assign(run, node, run.machine.unknown(f"{name} from {word}", name))
