"""Evaluates PacScript expressions during a run, and assigns their values."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable

import numpy as np

from camgen.lang.pacscript.expressions import OPERATORS, Node
from camgen.lang.pacscript.functions import (
    ASKED,
    FUNCTIONS,
    calculate,
    call,
    get_value,
    numbers,
    place,
    turned,
)
from camgen.lang.pacscript.machine import copy_value
from camgen.lang.pacscript.state import State
from camgen.lang.pacscript.values import (
    Array,
    ExternalPose,
    Rate,
    Unreadable,
    Value,
    Vector,
    Wrong,
    figure_of,
    finite,
    index,
    joints,
    name_place,
    number,
    position,
    vector,
    with_figure,
)
from camgen.lang.values import Unknown, find_first_unknown
from camgen.model.pose import IDENTITY, Pose
from camgen.model.program import Joints

#: The short form of a variable of the controller or of an input or output, such as `I10`.
STORED_NAME = re.compile(r"(io|[pjtvifds])(\d{1,9})", re.ASCII)
_CONSTANTS: dict[str, Value] = {
    "on": 1.0,
    "off": 0.0,
    "true": 1.0,
    "false": 0.0,
    "pi": 3.141592653589793,
    # Types of elements of arrays, from a header of the controller.
    "vt_i2": 2.0,
    "vt_i4": 3.0,
    "vt_r4": 4.0,
    "vt_r8": 5.0,
    "vt_bstr": 8.0,
    "vt_bool": 11.0,
    "vt_variant": 12.0,
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
    """Evaluate an expression. Raises Unreadable."""
    return _KINDS_OF_NODES.get(node.kind, _operate)(run, node)


def evaluate_all(run: State, nodes: Iterable[Node]) -> list[Value]:
    """Evaluate expressions in order."""
    return [run.evaluate(node) for node in nodes]


def _evaluate_tuple(run: State, node: Node) -> Value:
    values = tuple(evaluate_all(run, node.parts))
    return values[0] if len(values) == 1 else values


def _refuse_range(_run: State, _node: Node) -> Value:
    raise Unreadable("a range of positions stands where one value is expected")


def _apply_sign(run: State, node: Node) -> Value:
    value = run.evaluate(node.parts[0])
    if node.content == 1.0 and isinstance(value, (float, bool)):
        return value
    sign = float(node.content)
    if isinstance(value, (Vector, Joints)):
        return type(value)(tuple(sign * item for item in value.values))  # type: ignore[arg-type]
    return run.combine("*", value, sign)


def _invert(run: State, node: Node) -> Value:
    value = run.evaluate(node.parts[0])
    if isinstance(value, Unknown):
        return value
    return not value if isinstance(value, bool) else float(~int(number(value)))


def _operate(run: State, node: Node) -> Value:
    """Apply the operators of a chain such as `a + b - c` from left to right."""
    chain = [node]
    while chain[-1].parts[0].kind in OPERATORS:
        chain.append(chain[-1].parts[0])
    value = run.evaluate(chain[-1].parts[0])
    for operation in reversed(chain):
        value = run.combine(operation.kind, value, run.evaluate(operation.parts[1]))
    return value


def combine(_run: State, sign: str, a: Value, b: Value) -> Value:
    """Apply an operator to two values. Raises Unreadable."""
    if sign in ("and", "or"):  # A known operand may decide the result alone.
        for operand, other in ((a, b), (b, a)):
            is_known = isinstance(other, (bool, float))
            if isinstance(operand, Unknown) and is_known and bool(other) == (sign == "or"):
                return other
    return calculate(sign, a, b)


def evaluate_name(run: State, word: str) -> Value:
    """Evaluate a name: a variable, a function without arguments, a constant, or a stored value."""
    value = run.find_variable(word)
    if value is not None:
        return value
    if word in _CONSTANTS:
        return _CONSTANTS[word]
    if short := STORED_NAME.fullmatch(word):
        return read_stored(run, short[1], int(short[2]))
    if (value := run.port(word)) is not None:
        return value
    if word in FUNCTIONS or word in ASKED or word in _OF_RUN or run.find_function(word):
        return evaluate_call(run, word, ())
    return run.undeclared(word)


def read_stored(run: State, letter: str, at: int) -> Value:
    """Return the value of a variable of the controller, or of an input or output."""
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


def evaluate_index(run: State, letter: str, parts: tuple[Node, ...]) -> Value:
    """Evaluate `P[n]`, `IO[n]`, or an element of an array of the program."""
    values = evaluate_all(run, parts)
    array = run.find_variable(letter)
    if isinstance(array, Array):
        return select_element(array, values)
    if letter not in _STORED and letter != "io":
        return Unknown(f"{letter}[...]")
    if not values or isinstance(values[0], Unknown):
        return Unknown(f"{letter.upper()}[...] at a place that is not known")
    if len(values) > 1:
        raise Unreadable(f"{letter.upper()}[] has one number")
    return read_stored(run, letter, index(number(values[0])))


def select_element(array: Array, values: list[Value]) -> Value:
    """Return an element of an array, or the whole array for empty brackets."""
    if not values:
        return array
    for value in values:
        if isinstance(value, Unknown):
            return Unknown(value.what)
    return array.get(tuple(int(number(value)) for value in values))


def evaluate_call(run: State, word: str, parts: tuple[Node, ...]) -> Value:
    """Evaluate `name(...)`: an element of an array, a procedure of the program, or a function."""
    held = run.find_variable(word)
    if isinstance(held, Array):
        return select_element(held, evaluate_all(run, parts))
    if procedure := run.find_procedure(word):
        return run.call(procedure, parts)
    if held is not None and word not in FUNCTIONS:
        return held if isinstance(held, Unknown) else Unknown(f"an element of {word}")
    if word in _OF_RUN:
        return _OF_RUN[word](run, evaluate_all(run, parts))
    values = evaluate_all(run, parts)
    if word in FUNCTIONS:
        return call(word, values)
    if word == "outrange":
        run.machine.log.assume("places that OutRange asks for are within reach", word)
        return run.machine.given(word) or 0.0
    if word in ASKED:
        return run.machine.unknown(word, word)
    return run.leave_out(word)


def _evaluate_member(run: State, node: Node) -> Value:
    """Evaluate `object.member`, or an element of the value of a function."""
    owner, *rest = node.parts
    if node.kind == "element":
        value = run.evaluate(owner)
        values = evaluate_all(run, rest)
        return (
            select_element(value, values)
            if isinstance(value, Array)
            else Unknown("an element of a value that is not known")
        )
    evaluate_all(run, rest)
    label = owner.content if owner.kind in ("name", "call") else "object"
    return run.machine.unknown(f"{label}.{node.content}")


# Functions whose values depend on the run.


def _mps(run: State, values: list[Value]) -> Value:
    if values and isinstance(values[0], Unknown):
        return Unknown(values[0].what)
    (speed,) = numbers(values, 1) or (0.0,)
    machine = run.machine
    unit = machine.given("mps")
    machine.log.assume(f"Mps(1) is assumed to be {unit or 1.0:g} mm/s", "mps", unit or 1.0)
    return Rate(finite(speed * (unit or 1.0)), machine.rated)


def _to_joints(_run: State, values: list[Value]) -> Value:
    """Evaluate `J2P` or `J2T`. The position is unknown, so the joint values themselves are kept."""
    value = get_value(values, 0, 0.0)
    if isinstance(value, tuple):
        value = joints(numbers(list(value)))
    if not isinstance(value, Joints):
        return Unknown("a position of joint values")
    return value


def _ask_operator(run: State, _values: list[Value]) -> Value:
    """Evaluate `MsgBox`, which waits for the operator."""
    run.machine.stop()
    return run.machine.unknown("the answer to MsgBox", "msgbox")


def _shift(run: State, values: list[Value]) -> Value:
    """Evaluate `Dev`. The reference does not state about which axes it rotates."""
    offset = get_value(values, 1, 0.0)
    if isinstance(offset, tuple):
        offset = fit(offset, "position")
    if isinstance(offset, Pose) and not np.array_equal(offset.rotation, IDENTITY):
        run.machine.log.assume(
            "the angles of Dev are assumed to be turns about the axes of the work frame"
        )
    return call("dev", values)


def _find_joints(run: State, _values: list[Value]) -> Value:
    return run.machine.joints or Unknown(f"the joint values in line {run.machine.line}")


_OF_RUN: dict[str, Callable[[State, list[Value]], Value]] = {
    "mps": _mps,
    "j2p": _to_joints,
    "j2t": _to_joints,
    "msgbox": _ask_operator,
    "dev": _shift,
    **dict.fromkeys(
        ("curpos", "destpos", "curtrn", "desttrn"), lambda run, _values: run.machine.current_pose
    ),
    **dict.fromkeys(("curjnt", "destjnt"), _find_joints),
    "curtool": lambda run, _values: float(run.machine.numbers["tool"]),
    "curwork": lambda run, _values: float(run.machine.numbers["work"]),
    "curspd": lambda run, _values: run.machine.internal,
    "curextspd": lambda run, _values: run.machine.external,
    "toolpos": lambda run, values: _frame(run, "tool", values),
    "workpos": lambda run, values: _frame(run, "work", values),
}


def _frame(run: State, kind: str, values: list[Value]) -> Value:
    if not values or isinstance(values[0], Unknown):
        return Unknown(f"a {kind} frame")
    at = int(number(values[0]))
    return run.machine.pose_of(kind, at) or Unknown(f"{kind} {at}")


_KINDS_OF_NODES: dict[str, Callable[[State, Node], Value]] = {
    "number": lambda _run, node: node.content,
    "text": lambda _run, node: str(node.content),
    "left out": lambda _run, _node: 0.0,
    "name": lambda run, node: evaluate_name(run, str(node.content)),
    "index": lambda run, node: evaluate_index(run, str(node.content), node.parts),
    "call": lambda run, node: evaluate_call(run, str(node.content), node.parts),
    "tuple": _evaluate_tuple,
    "member": _evaluate_member,
    "element": _evaluate_member,
    "range": _refuse_range,
    "sign": _apply_sign,
    "not": _invert,
}


# Assignments.


def assign(run: State, target: Node, value: Value) -> None:
    """Assign a value to a variable, an element or an output."""
    word = str(target.content)
    if target.kind == "name":
        assign_name(run, word, value)
    elif target.kind == "index" and not isinstance(run.find_variable(word), Array):
        at = evaluate_all(run, target.parts)
        if at and not isinstance(at[0], Unknown):
            _assign_stored(run, word, index(number(at[0])), value)
    elif target.kind in ("index", "call"):
        _assign_element(run, target, value)
    elif target.kind != "element":  # The value of an element of an element is not kept.
        evaluate_all(run, target.parts[1:])


def assign_name(run: State, word: str, value: Value) -> None:
    """Assign a value to a name."""
    scope = run.scope
    if word not in scope.names:
        if word in run.module_scope.names:
            scope = run.module_scope
        elif run.write_port(word, value):
            return
        elif (short := STORED_NAME.fullmatch(word)) is not None:
            _assign_stored(run, short[1], int(short[2]), value)
            return
    scope.names[word] = copy_value(fit(value, scope.kinds.get(word, "variant")))


def _assign_stored(run: State, letter: str, at: int, value: Value) -> None:
    if letter == "io":
        run.set_signal(at, value)
    elif letter in _STORED:
        run.machine.globals[(letter, at)] = fit(value, _STORED[letter])
    else:
        raise Unreadable(f"{letter}[] is not a variable")


def _assign_element(run: State, target: Node, value: Value) -> None:
    word = str(target.content)
    array = run.find_variable(word)
    indices = evaluate_all(run, target.parts)
    if find_first_unknown(indices) is not None:
        return
    place_of = tuple(int(number(position_value)) for position_value in indices)
    if array is None or not isinstance(array, Array):
        array = Array((), array if isinstance(array, Unknown) else 0.0)
        run.scope.names[word] = array
    array.check(place_of)
    array.items[place_of] = copy_value(
        fit(value, run.scope.kinds.get(word, run.module_scope.kinds.get(word, "variant")))
    )


def fit(value: Value, kind: str) -> Value:
    """Convert a value to a type: lists become positions, numbers of integers are rounded."""
    if isinstance(value, Unknown) or kind == "variant":
        return value
    if isinstance(value, tuple) and (unknown := find_first_unknown(value)):
        return unknown
    if kind in ("position", "trans"):
        return value if isinstance(value, (Pose, Joints, Array)) else place(value)
    if kind == "joint":
        return joints(numbers(list(value))) if isinstance(value, tuple) else value
    if kind == "vector":
        if isinstance(value, tuple):
            return vector(numbers(list(value)))
        if isinstance(value, ExternalPose):
            return Unknown(value.base)
        return Vector(value.origin) if isinstance(value, Pose) else value
    if isinstance(value, str) and kind in _NUMBERS:
        return call("val", [value])
    if kind in ("integer", "long") and isinstance(value, float):
        return float(round(value))
    return value


_NUMBERS = frozenset(("integer", "long", "single", "double"))


def assign_component(run: State, which: str, target: Node, value: Value) -> None:
    """Run `LetX p = v` and the like. which: letters after Let, in lower case."""
    old = run.evaluate(target)
    if isinstance(old, Unknown):
        if which in ("x", "y", "z", "rx", "ry", "rz", "f", "fig"):
            return
        raise Unreadable(f"{old.what} is not known")
    if isinstance(old, ExternalPose):
        if which not in ("f", "fig"):
            old = name_place(f"{old.base} as changed in line {run.machine.line}")
        assign(run, target, old)
    elif isinstance(value, Unknown):
        assign(run, target, value)
    elif isinstance(old, Vector) and which in "xyz":
        at = "xyz".index(which)
        values = list(old.values)
        values[at] = number(fit(value, "double"))
        assign(run, target, vector(values))
    elif isinstance(old, Pose):
        assign(run, target, _with_component(old, which, value))
    elif isinstance(old, Joints) and which == "j":
        assign(run, target, value)
    elif old == 0.0 and which in ("x", "y", "z", "rx", "ry", "rz", "f"):
        assign(run, target, _with_component(position([]), which, value))
    # Otherwise it is a component of a value that is not in the text.


def assign_axis(run: State, target: Node, axis: Value, value: Value) -> None:
    """Run `LetJ axis, j = v`, which sets the value of one axis."""
    old = run.evaluate(target)
    if isinstance(old, Unknown):
        return
    if isinstance(axis, Unknown) or isinstance(value, Unknown) or not isinstance(old, Joints):
        assign(run, target, Unknown("a joint value of which an axis is not known"))
        return
    at = int(number(axis))
    if not 1 <= at <= 8:
        raise Wrong(f"there is no axis {at}")
    values = [*old.values, *[0.0] * (at - len(old.values))]
    values[at - 1] = math.radians(number(fit(value, "double")))
    assign(run, target, Joints(tuple(values)))


def _with_component(old: Pose, which: str, value: Value) -> Pose:
    if which in ("f", "fig"):
        return with_figure(old, int(number(value)))
    if which in ("rx", "ry", "rz"):
        return turned(old, ("rx", "ry", "rz").index(which), number(fit(value, "double")))
    if which == "p":
        return with_figure(Pose(old.rotation, place(value).origin), figure_of(old))
    if which in ("x", "y", "z"):
        values = list(old.origin)
        values["xyz".index(which)] = number(fit(value, "double"))
        return with_figure(Pose(old.rotation, vector(values).values), figure_of(old))
    raise Unreadable(f"Let{which.upper()} is not evaluated")
