"""Actions of the steps of PacScript: names, calls and outputs here, motions and flow beside."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from camgen.lang.pacscript import flow, motions, settings
from camgen.lang.pacscript.code import Op
from camgen.lang.pacscript.evaluate import assign, assign_name, blank, evaluate, fit, let, let_axis
from camgen.lang.pacscript.expressions import Node
from camgen.lang.pacscript.functions import ASKED, FUNCTIONS
from camgen.lang.pacscript.machine import Raised, copy_value
from camgen.lang.pacscript.running import Running
from camgen.lang.pacscript.values import Array, Unknown, Unreadable, Value, index, number
from camgen.lang.run import Ended
from camgen.model.program import Output


def _declare(run: Running, op: Op) -> None:
    for name, kind, tops, init in op.a:
        if tops is not None:
            sizes = [evaluate(run, node) for node in tops]
            known = not any(isinstance(size, Unknown) for size in sizes)
            run.scope.kinds[name] = kind
            run.scope.names[name] = Array(
                tuple(int(number(size)) for size in sizes) if known else (), blank(kind)
            )
            if init is not None and isinstance(value := evaluate(run, init), Array):
                run.scope.names[name] = value.copy()
        elif init is not None:
            value = evaluate(run, init)
            run.scope.kinds[name] = kind
            run.scope.names[name] = copy_value(fit(value, kind))
        elif name not in run.scope.kinds:
            run.scope.kinds[name] = kind
            run.scope.names[name] = blank(kind)


def _define_port(run: Running, op: Op) -> None:
    kind, node = op.b
    at = evaluate(run, node)
    run.scope.ios[op.a] = (kind, int(number(at)) if not isinstance(at, Unknown) else -1)


def _assign(run: Running, op: Op) -> None:
    try:
        value = evaluate(run, op.b)
        assign(run, op.a, value.copy() if isinstance(value, Array) else value)
    except Unreadable as error:
        if op.a.kind in ("name", "index", "call"):  # What it held before would be a lie.
            assign(run, op.a, Unknown(f"{op.a.said} ({error})"))
        raise


def _call(run: Running, op: Op) -> None:
    node: Node = op.a
    name = str(node.said)
    if node.kind == "member":
        for part in op.b:
            evaluate(run, part)
        of = node.parts[0]
        module = run.read(run.stems[str(of.said)]) if of.said in run.stems else None
        procedure = module.procedures.get(name) if module is not None else None
        if module is not None and procedure is not None:
            run.call((module, procedure), op.b)
        else:
            run.machine.log.fact("other devices", f"{of.said}.{name}")
        return
    called = run.find_procedure(name)
    if called is not None:
        run.call(called, op.b)
        return
    values = [evaluate(run, part) for part in op.b]
    if name == "msgbox":
        run.machine.stop()
        run.machine.passing = False
    elif name not in FUNCTIONS and name not in ASKED:
        run.left_out(name)
        for part, value in zip(op.b, values, strict=True):
            _fill(run, name, part, value)


def _fill(run: Running, name: str, part: Node, value: Value) -> None:
    """Forgets a variable without a value that a missing procedure takes: it may be set there."""
    variable = str(part.said)
    scope = run.scope if variable in run.scope.names else run.module_scope
    if part.kind not in ("name", "call") or variable not in scope.names:
        return
    filled = Unknown(f"{variable} from {name}")
    if isinstance(value, Array) and not value.items:
        scope.names[variable] = Array(value.tops, filled)
    elif value == blank(scope.kinds.get(variable, "variant")):
        scope.names[variable] = filled


def _start_task(run: Running, op: Op) -> None:
    for part in op.b:
        evaluate(run, part)
    run.machine.tasks.setdefault(str(op.a.said).lower(), run.machine.line)


def _switch(run: Running, op: Op) -> None:
    (which, upto), value, node = op.a
    level = value if node is None else evaluate(run, node)
    for at in _signals(run, which, upto):
        if isinstance(at, int):
            run.set_signal(at, level)
            if op.b is not None:
                run.machine.emit(Output(str(at), 0.0 if value else 1.0))
                run.machine.log.fact("pulses", f"IO[{at}]")
        elif not run.write_port(at, level):
            assign_name(run, at, level)


def _signals(run: Running, which: Node, upto: Node | None) -> list[int | str]:
    if upto is not None:
        ends = evaluate(run, which), evaluate(run, upto)
        if any(isinstance(end, Unknown) for end in ends):
            run.machine.log.leave_out("outputs whose numbers the text does not hold are left out")
            return []
        first, last = (index(number(end)) for end in ends)
        return list(range(first, min(last, first + 255) + 1))
    if which.kind == "index" and which.said == "io" and which.parts:
        at = evaluate(run, which.parts[0])
        if isinstance(at, Unknown):
            run.machine.log.leave_out(
                f"{at.what}, the number of an output, is not known: it is left out", at.key
            )
            return []
        return [index(number(at))]
    name = str(which.said)
    if which.kind == "name" and name.startswith("io") and name[2:].isdecimal():
        return [int(name[2:11])]
    if which.kind == "name":
        return [name]
    raise Unreadable("an output that is not understood")


def _let(run: Running, op: Op) -> None:
    which, target, axis = op.a
    if which == "f":
        run.machine.log.fact("posture", "LetF sets the figure of a position")
    if axis is None:
        let(run, which, target, evaluate(run, op.b))
    else:
        let_axis(run, target, evaluate(run, axis), evaluate(run, op.b))


def _omit(run: Running, op: Op) -> None:
    run.machine.log.omit(f"{op.a}: {op.b}")


def _lose(run: Running, op: Op) -> None:
    run.machine.log.leave_out(f"{op.a}: {op.b}")


def _raise(_run: Running, _op: Op) -> None:
    raise Raised


def _end(_run: Running, _op: Op) -> None:
    raise Ended


ACTIONS: dict[str, Callable[[Running, Op], Any]] = {
    "plain": motions.plain,
    "move": motions.move,
    "approach": motions.approach,
    "depart": motions.depart,
    "draw": motions.draw,
    "archmove": motions.arch,
    "rotate": motions.rotate,
    "rotateh": motions.rotate_hand,
    **dict.fromkeys(("drive", "drivea"), motions.drive),
    "gohome": motions.go_home,
    "home": settings.set_home,
    "takearm": settings.take_arm,
    "givearm": settings.give_arm,
    "motor": settings.motor,
    "speed": settings.speed_statement,
    "extspeed": settings.external_speed,
    **dict.fromkeys(("changetool", "changework"), settings.change),
    **dict.fromkeys(("tool", "work"), settings.define),
    "delay": settings.delay,
    "forceparam": settings.force_parameter,
    "forcectrl": settings.force_control,
    **dict.fromkeys(("hold", "halt"), settings.hold),
    **dict.fromkeys(("stop", "stopend"), _end),
    **dict.fromkeys(("arrive", "waitmotion"), settings.settle),
    **dict.fromkeys(("interrupt", "motionskip"), settings.interrupt),
    "omit": _omit,
    "lose": _lose,
    "raise": _raise,
    "assign": _assign,
    "dim": _declare,
    "defio": _define_port,
    "call": _call,
    "run": _start_task,
    "switch": _switch,
    "let": _let,
    "wait": flow.wait_for,
    "input": flow.take_input,
}  # fmt: skip

WAYS: dict[str, Callable[[Running, flow.Frame, int, Op], int | None]] = {
    "if": flow.branch,
    "goto": flow.go_to,
    "for": flow.start_for,
    "next": flow.next_for,
    "do": flow.enter,
    "loop": flow.repeat,
    "select": flow.select,
    "gosub": flow.go_sub,
    "on": flow.on_value,
    "on error": flow.on_error,
}
