"""The statements of PacScript except the flow: grammar, action and effect of each word."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

from camgen.lang.code import Condition, Effect
from camgen.lang.pacscript import motions, orders, settings
from camgen.lang.pacscript.effects import LOST, OMITTED
from camgen.lang.pacscript.expressions import (
    LEFT_OUT,
    Node,
    arguments,
    list_arguments,
    parse,
    parse_optional,
)
from camgen.lang.pacscript.motion import LINEAR, cut_bracket, read_axes, read_motion
from camgen.lang.pacscript.orders import Assignment, Calling, Declaration, Switching
from camgen.lang.pacscript.values import Unreadable
from camgen.lang.pacscript.words import RESERVED
from camgen.lang.values import require

VERB = re.compile(r"([a-z_]\w*[!#%$]?)\s*(.*)", re.IGNORECASE | re.DOTALL)
_NAME = re.compile(r"([a-z_]\w*[!#%$]?(?:\s*\.\s*[a-z_]\w*)*)\s*(.*)", re.IGNORECASE | re.DOTALL)
_EQUALS = re.compile(r'"[^"]*"|[()\[\]]|[<>=]=|=[<>]|<>|=')
TAKE = re.compile(r"(?:(.+?)\s*)??(?:,?\s*keep\s*=\s*(.+))?", re.IGNORECASE | re.DOTALL)
_DEFIO = re.compile(r"([a-z_]\w*[!#%$]?)\s*=\s*\w+\s*,\s*(.*)", re.IGNORECASE | re.DOTALL)
_DECLARED = re.compile(
    r"([a-z_]\w*[!#%$]?)\s*(\(.*?\)|\[.*?\])?\s*(?:as\s+(\w+))?\s*(?:=\s*(.+))?",
    re.IGNORECASE | re.DOTALL,
)
_CHANNEL = re.compile(r"#\s*[\w.]+\s*,?\s*", re.IGNORECASE)
#: Types by the word of the declaration.
_TYPED = {
    "defint": "integer",
    "defsng": "single",
    "defdbl": "double",
    "defstr": "string",
    "defpos": "position",
    "defjnt": "joint",
    "defvec": "vector",
    "deftrn": "trans",
}
DECLARE = frozenset(("dim", "public", "static", "private", "extern", *_TYPED))


def find_outside(pattern: re.Pattern[str], text: str, sign: str) -> int:
    """Return the index of a sign outside of brackets and quotes, -1 without one.

    pattern: finds quotes, brackets and the sign.
    """
    depth = 0
    for match in pattern.finditer(text):
        if match[0] == sign and depth == 0:
            return match.start()
        depth += (match[0] in ("(", "[")) - (match[0] in (")", "]"))
    return -1


def find_equals(text: str) -> int:
    """Return the index of the = of an assignment, -1 without one."""
    return find_outside(_EQUALS, text, "=")


def read_loop_condition(rest: str) -> Condition | None:
    """``While|Until condition``, None without one."""
    if not rest.strip():
        return None
    match = VERB.fullmatch(rest.strip())
    if match is None or match[1].lower() not in ("while", "until"):
        raise Unreadable(f"{rest[:40]} is not understood")
    return make_condition(parse(match[2]), match[1].lower() == "while")


def make_condition(node: Node, wanted: bool = True) -> Condition:
    """Make the condition of a branch or a loop. wanted: value with which a loop continues."""
    is_constant = node.kind == "number" or (node.kind == "name" and node.content in CONSTANTS)
    return Condition(node, wanted, is_constant, is_unlikely=node.kind in ("<>", "not"))


CONSTANTS = frozenset(("true", "on", "false", "off"))


def read_case(text: str) -> tuple[str, Node, Node | None]:
    """Parse a value of a Case: its comparison, and its operand, of which "to" has two."""
    if match := re.fullmatch(r"is\s*(<>|<=|>=|<|>|=)\s*(.+)", text, re.IGNORECASE | re.DOTALL):
        return match[1], parse(match[2]), None
    if match := re.fullmatch(r'([^"]+?)\bto\b([^"]+)', text, re.IGNORECASE | re.DOTALL):
        return "to", parse(match[1].strip()), parse(match[2].strip())
    return "=", parse(text), None


def read_call(text: str) -> Calling:
    """Parse `name a, b` or `name(a, b)`."""
    match = _NAME.fullmatch(text)
    if match is None:
        node = parse(text)
        if node.kind in ("member", "call", "name", "element"):
            return Calling(node, ())
        raise Unreadable(f"{text[:60]} is not understood")
    name, rest = parse(match[1]), match[2].strip()
    if rest.startswith("("):
        inside, tail = cut_bracket(rest)
        if not tail:
            return Calling(name, tuple(parse(part) for part in list_arguments(inside) if part))
        if tail.startswith("."):
            return Calling(parse(f"{match[1]}({inside}){tail.split(None, 1)[0]}"), ())
    values = (parse_optional(part) or LEFT_OUT for part in list_arguments(rest))
    return Calling(name, tuple(values))


def read_declarations(word: str, rest: str, pac: bool) -> list[Declaration]:
    """Parse the variables of `Dim` and other declarations."""
    if word == "extern":
        return []
    declarations = []
    for part in arguments(rest):
        match = _DECLARED.fullmatch(part)
        if match is None or (match[1].lower() in RESERVED and not pac):
            raise Unreadable(f"{part[:60] or 'nothing'} cannot be declared")
        inside = (match[2] or "")[1:-1]
        tops = tuple(parse(top) for top in arguments(inside) if top) if match[2] else None
        kind = _TYPED.get(word) or (match[3] or _SUFFIXES.get(match[1][-1], "variant")).lower()
        value = parse_optional(match[4])
        declarations.append(Declaration(match[1].lower().rstrip("!#%$"), kind, tops, value))
    return declarations


_SUFFIXES = {"!": "single", "#": "double", "%": "integer", "$": "string"}


class Order(NamedTuple):
    """The statement of a word.

    read: returns the operand of `do` from the text after the word. Unreadable.
    do: carries it out, called with the state of the run and the operand.
    """

    read: Callable[[str], Any]
    do: Callable[[Any, Any], object]
    effect: Effect = Effect.NONE


def _read_take(rest: str) -> list[Node | None]:
    match = TAKE.fullmatch(rest)
    if match is None:
        return [None, None]
    return [parse_optional(part) for part in match.groups()]


def _read_switch(rest: str, level: float) -> Switching:
    parts = arguments(rest)
    at = find_equals(parts[0])
    target, value = parts[0], Node("number", level)
    if at >= 0:
        target, value = parts[0][:at].strip(), parse(parts[0][at + 1 :])
    match = re.fullmatch(r"(io)\s*\[(.*?)\bto\b(.*)\]", target, re.IGNORECASE | re.DOTALL)
    which = parse(match[2].strip()) if match else parse(target)
    upto = parse(match[3].strip()) if match else None
    for part in parts[1:2]:
        parse(part)
    return Switching(which, upto, level, value, is_pulse=len(parts) > 1)


def _read_wait(rest: str) -> list[Node]:
    parts = arguments(rest)
    if not parts[0]:
        raise Unreadable("Wait needs a condition")
    return [parse(part) for part in parts]


def read_list(rest: str) -> list[Node]:
    """An ordinary list of values."""
    return list(map(parse, list_arguments(rest)))


def _read_force(rest: str) -> list[Node]:
    return [parse(part) for part in arguments(rest) if find_equals(part) < 0]


def _read_plain_let(rest: str) -> Assignment:
    targets, value = _read_targets(rest, "let")
    return Assignment(targets[0], value)


def _read_targets(rest: str, word: str) -> tuple[list[Node], Node]:
    at = find_equals(rest)
    if at < 0:
        raise Unreadable(f"{word.capitalize()} needs a name and =")
    return [parse(part) for part in arguments(rest[:at])], parse(rest[at + 1 :].strip())


def _read_defio(rest: str) -> tuple[str, Node]:
    match = require(_DEFIO.fullmatch(rest), Unreadable("DefIO needs a name, a type and a number"))
    return match[1].lower().rstrip("!#%$"), parse(arguments(match[2])[0])


def _read_input(rest: str) -> list[Node]:
    return [parse(part) for part in arguments(_CHANNEL.sub("", rest, count=1)) if part]


def _read_in_out(rest: str, word: str) -> Assignment:
    at = find_equals(rest)
    if at < 0:
        raise Unreadable(f"{word.capitalize()} needs =")
    return Assignment(parse(rest[:at].strip()), parse(rest[at + 1 :].strip()))


def _read_remark(rest: str, word: str) -> str:
    return f"{word} {rest}".rstrip() + f": {(OMITTED | LOST)[word]}"


#: A motion in the usual spelling, an assignment and a call have no word.
ASSIGN = Order(_read_plain_let, orders.set_variable)
CALL = Order(read_call, orders.call, Effect.ACTS)
_read_move = partial(read_motion, kinds=(*LINEAR, "c", "s"))
_read_along = partial(read_motion, kinds=tuple(LINEAR))
_DRIVE = partial(motions.drive, relative=True)
_DRIVE_TO = partial(motions.drive, relative=False)
_INPUTS = ("input", "lineinput", "com_state", "getpublicvalue", "readbytearray")
_PARTS = ("a", "f", "j", "o", "p", "r", "rx", "ry", "rz", "x", "y", "z")
ORDERS: dict[str, Order] = {
    "move": Order(_read_move, motions.move, Effect.MOVES),
    "approach": Order(_read_along, motions.approach, Effect.MOVES),
    "depart": Order(_read_along, motions.depart, Effect.MOVES),
    "draw": Order(_read_along, motions.draw, Effect.MOVES),
    "archmove": Order(read_motion, motions.arch, Effect.MOVES),
    "rotate": Order(read_motion, motions.rotate, Effect.MOVES),
    "rotateh": Order(read_motion, motions.rotate_hand, Effect.MOVES),
    "drive": Order(read_axes, _DRIVE, Effect.MOVES),
    "drivea": Order(read_axes, _DRIVE_TO, Effect.MOVES),
    "gohome": Order(read_list, motions.go_home, Effect.MOVES),
    **dict.fromkeys(("addpathpoint", "setsplinepoint"), Order(read_list, motions.add_path_point)),
    **dict.fromkeys(("clrpathpoint", "clrsplinepoint"), Order(read_list, motions.clear_path)),
    "home": Order(read_list, settings.set_home),
    "takearm": Order(_read_take, settings.take_arm),
    "givearm": Order(read_list, settings.give_arm, Effect.LEAVES),
    "motor": Order(read_list, settings.motor),
    "speed": Order(read_list, settings.speed_statement),
    "extspeed": Order(read_list, settings.external_speed),
    "changetool": Order(read_list, partial(settings.change, kind="tool")),
    "changework": Order(read_list, partial(settings.change, kind="work")),
    "tool": Order(read_list, partial(settings.define, kind="tool")),
    "work": Order(read_list, partial(settings.define, kind="work")),
    "delay": Order(read_list, settings.delay, Effect.ACTS),
    "forceparam": Order(_read_force, settings.force_parameter),
    "forcectrl": Order(_read_force, settings.force_control),
    "hold": Order(read_list, settings.wait_for_operator),
    "halt": Order(read_list, settings.wait_for_operator, Effect.LEAVES),
    "arrive": Order(read_list, settings.arrive),
    "waitmotion": Order(read_list, settings.wait_for_motion),
    "interrupt": Order(read_list, partial(settings.cut_short, word="Interrupt")),
    "motionskip": Order(read_list, partial(settings.cut_short, word="Motionskip")),
    "set": Order(partial(_read_switch, level=1.0), orders.switch, Effect.ACTS),
    "reset": Order(partial(_read_switch, level=0.0), orders.switch, Effect.ACTS),
    "wait": Order(_read_wait, orders.wait),
    "defio": Order(_read_defio, orders.define_port),
    "run": Order(read_call, orders.start_task),
    "runbyname": Order(read_call, orders.start_task),
    "call": CALL,
    "callbyname": CALL,
    "let": ASSIGN,
    **{
        f"let{part}": Order(
            partial(_read_targets, word=f"let{part}"), partial(orders.assign_part, part=part)
        )
        for part in _PARTS
    },
    **{word: Order(_read_input, partial(orders.fill, word=word)) for word in _INPUTS},
    "in": Order(partial(_read_in_out, word="in"), orders.set_variable),
    "out": Order(partial(_read_in_out, word="out"), orders.set_variable),
    **{word: Order(partial(_read_remark, word=word), orders.omit) for word in OMITTED},
    **{word: Order(partial(_read_remark, word=word), orders.lose) for word in LOST},
}  # fmt: skip
