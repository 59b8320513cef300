"""What names, elements and functions are worth while a PacScript program runs."""

from __future__ import annotations

import math
import re
from collections.abc import Callable

import numpy as np

from camgen.lang.pacscript.expressions import OPERATORS, Node
from camgen.lang.pacscript.functions import (
    ASKED,
    FUNCTIONS,
    calculate,
    call,
    numbers,
    place,
    turned,
)
from camgen.lang.pacscript.machine import blank, copy_value
from camgen.lang.pacscript.state import State
from camgen.lang.pacscript.values import (
    Array,
    Figured,
    Placed,
    Rate,
    Unreadable,
    Value,
    Vector,
    Wrong,
    finite,
    index,
    joints,
    name_place,
    number,
    position,
    vector,
    with_figure,
)
from camgen.lang.values import Unknown
from camgen.model.pose import IDENTITY, Pose
from camgen.model.program import Joints

_SHORT = re.compile(r"(io|[pjtvifds])(\d{1,9})", re.ASCII)
_CONSTANTS: dict[str, Value] = {
    "on": 1.0,
    "off": 0.0,
    "true": 1.0,
    "false": 0.0,
    "pi": 3.141592653589793,
}
#: Types of the header of the controller, which name what an array holds.
_KINDS = {
    "vt_i2": 2.0,
    "vt_i4": 3.0,
    "vt_r4": 4.0,
    "vt_r8": 5.0,
    "vt_bstr": 8.0,
    "vt_bool": 11.0,
    "vt_variant": 12.0,
}
#: Functions that tell where the arm is, by what they give.
_PLACES = {
    "curpos": "pose",
    "destpos": "pose",
    "curtrn": "pose",
    "desttrn": "pose",
    "curjnt": "joints",
    "destjnt": "joints",
}
_STORED = {
    "i": "integer",
    "f": "single",
    "d": "double",
    "s": "string",
    "p": "position",
    "j": "joint",
    "t": "trans",
    "v": "vector",
}


def evaluate(run: State, node: Node) -> Value:
    """The value of an expression. Unreadable."""
    kind = node.kind
    if kind == "number":
        return node.said
    if kind == "name":
        return name(run, str(node.said))
    if kind == "text":
        return str(node.said)
    if kind == "index":
        return element_of_letter(run, str(node.said), node.parts)
    if kind == "call":
        return called(run, str(node.said), node.parts)
    if kind == "tuple":
        values = tuple(run.evaluate(part) for part in node.parts)
        return values[0] if len(values) == 1 else values
    if kind in ("member", "element"):
        return _of_object(run, node)
    if kind == "range":
        raise Unreadable("a range of positions stands where one value is expected")
    return _operate(run, node) if kind != "left out" else 0.0


def truth(value: Value) -> bool | Unknown:
    """Return whether a condition holds."""
    return value if isinstance(value, Unknown) else bool(number(value))


def _operate(run: State, node: Node) -> Value:
    if node.kind == "sign":
        value = run.evaluate(node.parts[0])
        return (
            value
            if node.said == 1.0 and isinstance(value, (float, bool))
            else negate(run, value, float(node.said))
        )
    if node.kind == "not":
        value = run.evaluate(node.parts[0])
        if isinstance(value, Unknown):
            return value
        return not value if isinstance(value, bool) else float(~int(number(value)))
    chain = [node]
    while chain[-1].parts[0].kind in OPERATORS:
        chain.append(chain[-1].parts[0])
    value = run.evaluate(chain[-1].parts[0])
    for one in reversed(chain):
        value = run.combine(one.kind, value, run.evaluate(one.parts[1]))
    return value


def combine(_run: State, sign: str, a: Value, b: Value) -> Value:
    """Two values with an operator between them. Raises Unreadable."""
    if sign in ("and", "or"):  # What is known may decide it alone.
        for one, other in ((a, b), (b, a)):
            if (
                isinstance(one, Unknown)
                and isinstance(other, (bool, float))
                and bool(other) == (sign == "or")
            ):
                return other
    return calculate(sign, a, b)


def negate(run: State, value: Value, sign: float) -> Value:
    """``value`` times ``sign``."""
    if isinstance(value, (Vector, Joints)):
        return type(value)(tuple(sign * one for one in value.values))  # type: ignore[arg-type]
    return run.combine("*", value, sign)


def name(run: State, said: str) -> Value:
    """What a name is worth: a variable, a function without brackets, a constant, or a stored variable."""
    scope = run.scope
    if said in scope.names:
        return scope.names[said]
    if said in run.module_scope.names:
        return run.module_scope.names[said]
    if said in _CONSTANTS:
        return _CONSTANTS[said]
    if short := _SHORT.fullmatch(said):
        return stored(run, short[1], int(short[2]))
    if (found := run.port(said)) is not None:
        return found
    if (
        said in _PLACES
        or said in FUNCTIONS
        or said in ASKED
        or said in _OWN
        or run.find_function(said)
    ):
        return called(run, said, ())
    if said in _KINDS:
        return _KINDS[said]
    return run.undeclared(said)


def is_stored(said: str) -> bool:
    """Whether a name is the short form of a variable of the controller, ``I10``."""
    return _SHORT.fullmatch(said) is not None


def stored(run: State, letter: str, at: int) -> Value:
    """A variable of the controller, or an input or output."""
    machine = run.machine
    if letter == "io":
        return run.signal(at)
    key = (letter, at)
    if key in machine.globals:
        return machine.globals[key]
    if key in machine.points:
        return machine.points[key]
    if letter in "pt":
        return name_place(f"{letter.upper()}[{at}]")
    return machine.unknown(f"{letter.upper()}[{at}]", f"{letter}[{at}]")


def element_of_letter(run: State, letter: str, parts: tuple[Node, ...]) -> Value:
    """``P[n]``, ``IO[n]``, or an element of an array of the program."""
    values = [run.evaluate(part) for part in parts]
    if letter in run.scope.names or letter in run.module_scope.names:
        of = name(run, letter)
        if isinstance(of, Array):
            return element(of, values)
    if letter not in _STORED and letter != "io":
        return Unknown(f"{letter}[...]")
    if not values or isinstance(values[0], Unknown):
        return Unknown(f"{letter.upper()}[...] at a place that is not known")
    if len(values) > 1:
        raise Unreadable(f"{letter.upper()}[] has one number")
    return stored(run, letter, index(number(values[0])))


def element(of: Array, values: list[Value]) -> Value:
    """An element of an array, all of it with empty brackets."""
    if not values:
        return of
    for value in values:
        if isinstance(value, Unknown):
            return Unknown(value.what)
    return of.get(tuple(int(number(value)) for value in values))


def called(run: State, said: str, parts: tuple[Node, ...]) -> Value:
    """``name(...)``: an element of an array, a procedure of the program, or a function of the language."""
    held = run.scope.names.get(said)
    if held is None:
        held = run.module_scope.names.get(said)
    if isinstance(held, Array):
        return element(held, [run.evaluate(part) for part in parts])
    if procedure := run.find_procedure(said):
        return run.call(procedure, parts)
    if held is not None and said not in FUNCTIONS:
        return held if isinstance(held, Unknown) else Unknown(f"an element of {said}")
    if said in _OWN:
        return _OWN[said](run, [run.evaluate(part) for part in parts])
    if said in _PLACES:
        return _tell_place(run, said)
    values = [run.evaluate(part) for part in parts]
    if said in FUNCTIONS:
        return _constructed(said, values) if said in _MADE else call(said, values)
    if said == "outrange":
        run.machine.log.assume("places that OutRange asks for are within reach", said)
        given = run.machine.given(said)
        return given if given is not None else 0.0
    if said in ASKED:
        return run.machine.unknown(said, said)
    return run.leave_out(said)


def _tell_place(run: State, said: str) -> Value:
    """Where the arm is when the motions so far are done."""
    if _PLACES[said] == "pose":
        return run.machine.current_pose
    return run.machine.joints or Unknown(f"the joint values in line {run.machine.line}")


_MADE = frozenset(("p", "j", "v"))


def _constructed(said: str, values: list[Value]) -> Value:
    for value in values:
        if isinstance(value, Unknown):
            return Unknown(value.what)
    if said == "p" and values and isinstance(values[0], Vector):
        values = [
            *values[0].values,
            *(
                values[1].values
                if len(values) > 1 and isinstance(values[1], Vector)
                else values[1:]
            ),
        ]
    return call(said, values)


def _of_object(run: State, node: Node) -> Value:
    """``object.member`` or an element of what a function gives."""
    of, *rest = node.parts
    if node.kind == "element":
        value = run.evaluate(of)
        values = [run.evaluate(part) for part in rest]
        return (
            element(value, values)
            if isinstance(value, Array)
            else Unknown("an element of a value that is not known")
        )
    for part in rest:
        run.evaluate(part)
    said = of.said if of.kind in ("name", "call") else "object"
    return run.machine.unknown(f"{said}.{node.said}")


# What the run itself knows.


def _mps(run: State, values: list[Value]) -> Value:
    if values and isinstance(values[0], Unknown):
        return Unknown(values[0].what)
    (said,) = numbers(values, 1) or (0.0,)
    machine = run.machine
    unit = machine.given("mps")
    machine.log.assume(f"Mps(1) is taken for {unit or 1.0:g} mm/s", "mps", unit or 1.0)
    return Rate(finite(said * (unit or 1.0)), machine.rated)


def _to_joints(_run: State, values: list[Value]) -> Value:
    """``J2P`` and ``J2T``: where the arm is with these joint values is the arm's; a motion may go to them."""
    value = values[0] if values else 0.0
    if isinstance(value, tuple):
        value = joints(numbers(list(value)))
    if not isinstance(value, Joints):
        return Unknown("a position of joint values")
    return value


def _ask_operator(run: State, _values: list[Value]) -> Value:
    """``MsgBox``: stands still until the operator answers."""
    run.machine.stop()
    return run.machine.unknown("the answer to MsgBox", "msgbox")


def _shifted(run: State, values: list[Value]) -> Value:
    """``Dev``, where the reference does not say about which axes it turns."""
    by = values[1] if len(values) > 1 else 0.0
    by = fit(by, "position") if isinstance(by, tuple) else by
    if isinstance(by, Pose) and not np.array_equal(by.rotation, IDENTITY):
        run.machine.log.assume(
            "the angles of Dev are taken for turns about the axes of the work frame"
        )
    return call("dev", values)


def _current(kind: str) -> Callable[[State, list[Value]], Value]:
    return lambda run, _values: float(run.machine.numbers[kind])


def _internal(run: State, _values: list[Value]) -> Value:
    return run.machine.internal


def _external(run: State, _values: list[Value]) -> Value:
    return run.machine.external


_OWN: dict[str, Callable[[State, list[Value]], Value]] = {
    "mps": _mps,
    "j2p": _to_joints,
    "j2t": _to_joints,
    "msgbox": _ask_operator,
    "dev": _shifted,
    "curtool": _current("tool"),
    "curwork": _current("work"),
    "curspd": _internal,
    "curextspd": _external,
    "toolpos": lambda run, values: _frame(run, "tool", values),
    "workpos": lambda run, values: _frame(run, "work", values),
}


def _frame(run: State, kind: str, values: list[Value]) -> Value:
    if not values or isinstance(values[0], Unknown):
        return Unknown(f"a {kind} frame")
    at = int(number(values[0]))
    found = run.machine.pose_of(kind, at)
    return found if found is not None else Unknown(f"{kind} {at}")


# Assignments.


def _held(run: State, said: str) -> Value | None:
    """The value of a variable of the program, None where it has none of that name."""
    found = run.scope.names.get(said)
    return run.module_scope.names.get(said) if found is None else found


def assign(run: State, target: Node, value: Value) -> None:
    """Gives a variable, an element or an output its value."""
    said = str(target.said)
    if target.kind == "name":
        assign_name(run, said, value)
    elif target.kind == "index" and not isinstance(_held(run, said), Array):
        at = [run.evaluate(part) for part in target.parts]
        if at and not isinstance(at[0], Unknown):
            _assign_stored(run, said, index(number(at[0])), value)
    elif target.kind in ("index", "call"):
        _assign_element(run, target, value)
    elif target.kind != "element":  # Of an element of an element no text holds the value.
        for part in target.parts[1:]:
            run.evaluate(part)


def assign_name(run: State, said: str, value: Value) -> None:
    """Gives a name its value."""
    scope = run.scope
    if said not in scope.names:
        if said in run.module_scope.names:
            scope = run.module_scope
        elif run.write_port(said, value):
            return
        elif (short := _SHORT.fullmatch(said)) is not None:
            _assign_stored(run, short[1], int(short[2]), value)
            return
    scope.names[said] = copy_value(fit(value, scope.kinds.get(said, "variant")))


def _assign_stored(run: State, letter: str, at: int, value: Value) -> None:
    if letter == "io":
        run.set_signal(at, value)
    elif letter in _STORED:
        run.machine.globals[(letter, at)] = fit(value, _STORED[letter])
    else:
        raise Unreadable(f"{letter}[] is no variable")


def _assign_element(run: State, target: Node, value: Value) -> None:
    said = str(target.said)
    of = run.scope.names.get(said, run.module_scope.names.get(said))
    at = [run.evaluate(part) for part in target.parts]
    if any(isinstance(one, Unknown) for one in at):
        return
    place_of = tuple(int(number(one)) for one in at)
    if of is None or not isinstance(of, Array):
        of = Array((), of if isinstance(of, Unknown) else 0.0)
        run.scope.names[said] = of
    of.check(place_of)
    of.items[place_of] = copy_value(
        fit(value, run.scope.kinds.get(said, run.module_scope.kinds.get(said, "variant")))
    )


def fit(value: Value, kind: str) -> Value:
    """``value`` as a type holds it: lists of values become places, whole numbers are rounded."""
    if isinstance(value, Unknown) or kind == "variant":
        return value
    if isinstance(value, tuple) and (
        unknown := next((one for one in value if isinstance(one, Unknown)), None)
    ):
        return unknown
    if kind in ("position", "trans"):
        return value if isinstance(value, (Pose, Joints, Array)) else place(value)
    if kind == "joint":
        return joints(numbers(list(value))) if isinstance(value, tuple) else value
    if kind == "vector":
        if isinstance(value, tuple):
            return vector(numbers(list(value)))
        if isinstance(value, Placed):
            return Unknown(value.base)
        return Vector(value.origin) if isinstance(value, Pose) else value
    if isinstance(value, str) and kind in _NUMBERS:
        return call("val", [value])
    if kind in ("integer", "long") and isinstance(value, float):
        return float(round(value))
    return value


_NUMBERS = frozenset(("integer", "long", "single", "double"))


def let_part(run: State, which: str, target: Node, value: Value) -> None:
    """``LetX p = v`` and its like. which: the letters after Let."""
    old = run.evaluate(target)
    if isinstance(old, Unknown):
        if which in ("x", "y", "z", "rx", "ry", "rz", "f", "fig"):
            return
        raise Unreadable(f"{old.what} is not known")
    if isinstance(old, Placed):
        assign(
            run,
            target,
            old
            if which in ("f", "fig")
            else name_place(f"{old.base} as changed in line {run.machine.line}"),
        )
    elif isinstance(value, Unknown):
        assign(run, target, value)
    elif isinstance(old, Vector) and which in "xyz":
        at = "xyz".index(which)
        made = list(old.values)
        made[at] = number(fit(value, "double"))
        assign(run, target, vector(made))
    elif isinstance(old, Pose):
        assign(run, target, _with_component(old, which, value))
    elif isinstance(old, Joints) and which == "j":
        assign(run, target, value)
    elif old == 0.0 and which in ("x", "y", "z", "rx", "ry", "rz", "f"):
        assign(run, target, _with_component(position([]), which, value))
    # Else a component of something whose place the text does not hold.


def let_axis(run: State, target: Node, axis: Value, value: Value) -> None:
    """``LetJ axis, j = v``: one value of a joint value."""
    old = run.evaluate(target)
    if isinstance(old, Unknown):
        return
    if isinstance(axis, Unknown) or isinstance(value, Unknown) or not isinstance(old, Joints):
        assign(run, target, Unknown("a joint value of which an axis is not known"))
        return
    at = int(number(axis))
    if not 1 <= at <= 8:
        raise Wrong(f"there is no axis {at}")
    made = [*old.values, *[0.0] * (at - len(old.values))]
    made[at - 1] = math.radians(number(fit(value, "double")))
    assign(run, target, Joints(tuple(made)))


def _with_component(old: Pose, which: str, value: Value) -> Pose:
    if which in ("f", "fig"):
        return with_figure(old, int(number(value)))
    if which in ("rx", "ry", "rz"):
        return turned(old, ("rx", "ry", "rz").index(which), number(fit(value, "double")))
    if which == "p":
        return _moved(old, Vector(place(value).origin))
    if which in ("x", "y", "z"):
        made = list(old.origin)
        made["xyz".index(which)] = number(fit(value, "double"))
        return _moved(old, vector(made))
    raise Unreadable(f"Let{which.upper()} is not evaluated")


def _moved(old: Pose, to: Vector) -> Pose:
    if isinstance(old, Figured):
        return Figured(old.rotation, to.values, old.figure)
    return Pose(old.rotation, to.values)


__all__ = ["assign", "assign_name", "blank", "evaluate", "fit", "let_part"]
