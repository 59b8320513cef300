"""The grammar of PacScript statements that are neither motions nor a way through the program."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from camgen.lang.pacscript.effects import LOST, OMITTED
from camgen.lang.pacscript.expressions import LEFT_OUT, Node, arguments, parse
from camgen.lang.pacscript.motion import LINEAR, cut_bracket, read_axes, read_motion
from camgen.lang.pacscript.values import Unreadable
from camgen.lang.pacscript.words import RESERVED

VERB = re.compile(r"([a-z_]\w*[!#%$]?)\s*(.*)", re.IGNORECASE | re.DOTALL)
_NAME = re.compile(r"([a-z_]\w*[!#%$]?(?:\s*\.\s*[a-z_]\w*)*)\s*(.*)", re.IGNORECASE | re.DOTALL)
_EQUALS = re.compile(r'"[^"]*"|[()\[\]]|[<>=]=|=[<>]|<>|=')
_TAKE = re.compile(r"(?:(.+?)\s*)??(?:,?\s*keep\s*=\s*(.+))?", re.IGNORECASE | re.DOTALL)
_DEFIO = re.compile(r"([a-z_]\w*[!#%$]?)\s*=\s*(\w+)\s*,\s*(.*)", re.IGNORECASE | re.DOTALL)
_DECLARED = re.compile(
    r"([a-z_]\w*[!#%$]?)\s*(\(.*?\)|\[.*?\])?\s*(?:as\s+(\w+))?\s*(?:=\s*(.+))?",
    re.IGNORECASE | re.DOTALL,
)
_CHANNEL = re.compile(r"#\s*[\w.]+\s*,?\s*", re.IGNORECASE)
#: By the word that declares, the type of what it declares.
_TYPED = {"defint": "integer", "defsng": "single", "defdbl": "double", "defstr": "string", "defpos": "position",
          "defjnt": "joint", "defvec": "vector", "deftrn": "trans"}  # fmt: skip
DECLARE = frozenset(("dim", "public", "static", "private", "extern", *_TYPED))
#: Statements with an ordinary list of values, which are read as they stand.
_LISTED = frozenset(
    [
        "speed",
        "extspeed",
        "changetool",
        "changework",
        "tool",
        "work",
        "delay",
        "motor",
        "motionskip",
        "interrupt",
        "waitmotion",
        "arrive",
        "gohome",
        "home",
        "forcectrl",
        "forceparam",
        "hold",
        "halt",
        "stop",
        "stopend",
        "givearm",
    ]
)
_LET = frozenset(
    [
        "leta",
        "letf",
        "letj",
        "leto",
        "letp",
        "letr",
        "letrx",
        "letry",
        "letrz",
        "letx",
        "lety",
        "letz",
        "let",
    ]
)


def find_equals(text: str) -> int:
    """Where the = of an assignment is, -1 where there is none."""
    depth = 0
    for match in _EQUALS.finditer(text):
        if match[0] == "=" and depth == 0:
            return match.start()
        depth += (match[0] in ("(", "[")) - (match[0] in (")", "]"))
    return -1


def read_condition(rest: str) -> tuple[Node | None, bool]:
    """``While|Until condition``, and whether it goes on while that holds."""
    if not rest.strip():
        return None, True
    match = VERB.fullmatch(rest.strip())
    if match is None or match[1].lower() not in ("while", "until"):
        raise Unreadable(f"{rest[:40]} is not understood")
    return parse(match[2]), match[1].lower() == "while"


def read_case(text: str) -> tuple[str, Node, Node | None]:
    """One of the values of a Case: its comparison and with what; "to" has two."""
    if found := re.fullmatch(r"is\s*(<>|<=|>=|<|>|=)\s*(.+)", text, re.IGNORECASE | re.DOTALL):
        return found[1], parse(found[2]), None
    if found := re.fullmatch(r'([^"]+?)\bto\b([^"]+)', text, re.IGNORECASE | re.DOTALL):
        return "to", parse(found[1].strip()), parse(found[2].strip())
    return "=", parse(text), None


def read_call(text: str) -> tuple[Node, tuple[Node, ...]]:
    """``name a, b`` or ``name(a, b)``: what is called, a name or a member, and its values."""
    found = _NAME.fullmatch(text)
    if found is None:
        node = parse(text)
        if node.kind in ("member", "call", "name", "element"):
            return node, ()
        raise Unreadable(f"{text[:60]} is not understood")
    name, rest = parse(found[1]), found[2].strip()
    if rest.startswith("("):
        inside, tail = cut_bracket(rest)
        if not tail:
            return name, tuple(
                parse(part) for part in arguments(inside) if part
            ) if inside.strip() else ()
        if tail.startswith("."):
            return parse(f"{found[1]}({inside}){_until_space(tail)}"), ()
    values = (
        tuple(LEFT_OUT if part == "" else parse(part) for part in arguments(rest)) if rest else ()
    )
    return name, values


def _until_space(text: str) -> str:
    return text.split(None, 1)[0]


def read_declarations(
    word: str, rest: str, pac: bool
) -> list[tuple[str, str, tuple[Node, ...] | None, Node | None]]:
    """What ``Dim`` and its like declare: names, types, the tops of arrays, and what they begin with."""
    if word == "extern":
        return []
    found = []
    for part in arguments(rest):
        match = _DECLARED.fullmatch(part)
        if match is None or (match[1].lower() in RESERVED and not pac):
            raise Unreadable(f"{part[:60] or 'nothing'} cannot be declared")
        inside = (match[2] or "")[1:-1]
        tops = tuple(parse(one) for one in arguments(inside) if one) if match[2] else None
        kind = _TYPED.get(word) or (match[3] or _SUFFIXES.get(match[1][-1], "variant")).lower()
        found.append(
            (match[1].lower().rstrip("!#%$"), kind, tops, parse(match[4]) if match[4] else None)
        )
    return found


_SUFFIXES = {"!": "single", "#": "double", "%": "integer", "$": "string"}

Read = tuple[Any, ...] | None


def _read_move(_word: str, rest: str) -> Read:
    return "move", read_motion(rest, (*LINEAR, "c", "s"))


def _read_along(word: str, rest: str) -> Read:
    return word, read_motion(rest, tuple(LINEAR))


def _read_bare(word: str, rest: str) -> Read:
    return word, read_motion(rest)


def _read_drive(word: str, rest: str) -> Read:
    return word, read_axes(rest)


def _read_take(_word: str, rest: str) -> Read:
    match = _TAKE.fullmatch(rest)
    return "takearm", [
        parse(part) if part else None for part in (match.groups() if match else (None, None))
    ]


def _read_switch(word: str, rest: str) -> Read:
    parts = arguments(rest)
    at = find_equals(parts[0])
    target, value = (
        (parts[0][:at].strip(), parse(parts[0][at + 1 :])) if at >= 0 else (parts[0], None)
    )
    found = re.fullmatch(r"(io)\s*\[(.*?)\bto\b(.*)\]", target, re.IGNORECASE | re.DOTALL)
    which = (parse(found[2].strip()), parse(found[3].strip())) if found else (parse(target), None)
    return (
        "switch",
        (which, float(word == "set"), value),
        parse(parts[1]) if len(parts) > 1 else None,
    )


def _read_wait(_word: str, rest: str) -> Read:
    parts = arguments(rest)
    if not parts[0]:
        raise Unreadable("Wait needs a condition")
    return "wait", parse(parts[0]), [parse(part) for part in parts[1:]]


def _read_listed(word: str, rest: str) -> Read:
    if word in ("forceparam", "forcectrl"):
        parts = [part for part in arguments(rest) if find_equals(part) < 0]
    else:
        parts = arguments(rest) if rest.strip() else []
    return word, [parse(part) for part in parts]


def _read_let(word: str, rest: str) -> Read:
    at = find_equals(rest)
    if at < 0:
        raise Unreadable(f"{word.capitalize()} needs a name and =")
    targets, value = [parse(part) for part in arguments(rest[:at])], parse(rest[at + 1 :].strip())
    if word == "let":
        return "assign", targets[0], value
    return "let", (word[3:], targets[-1], targets[0] if len(targets) > 1 else None), value


def _read_defio(_word: str, rest: str) -> Read:
    match = _DEFIO.fullmatch(rest)
    if match is None:
        raise Unreadable("DefIO needs a name, a type and a number")
    return (
        "defio",
        match[1].lower().rstrip("!#%$"),
        (match[2].lower(), parse(arguments(match[3])[0])),
    )


def _read_run(_word: str, rest: str) -> Read:
    return "run", *read_call(rest)


def _read_callee(_word: str, rest: str) -> Read:
    return "call", *read_call(rest)


def _read_input(word: str, rest: str) -> Read:
    return (
        "input",
        [parse(part) for part in arguments(_CHANNEL.sub("", rest, count=1)) if part],
        word,
    )


def _read_in_out(word: str, rest: str) -> Read:
    at = find_equals(rest)
    if at < 0:
        raise Unreadable(f"{word.capitalize()} needs =")
    return "assign", parse(rest[:at].strip()), parse(rest[at + 1 :].strip())


def _read_omitted(word: str, rest: str) -> Read:
    return "omit", f"{word} {rest}".rstrip(), OMITTED[word]


def _read_lost(word: str, rest: str) -> Read:
    return "lose", f"{word} {rest}".rstrip(), LOST[word]


READERS: dict[str, Callable[[str, str], Read]] = {
    "move": _read_move,
    **dict.fromkeys(("approach", "depart", "draw"), _read_along),
    **dict.fromkeys(("archmove", "rotate", "rotateh"), _read_bare),
    **dict.fromkeys(("drive", "drivea"), _read_drive),
    "takearm": _read_take,
    **dict.fromkeys(("set", "reset"), _read_switch),
    "wait": _read_wait,
    **dict.fromkeys(_LISTED, _read_listed),
    **dict.fromkeys(OMITTED, _read_omitted),
    **dict.fromkeys(LOST, _read_lost),
    **dict.fromkeys(_LET, _read_let),
    "defio": _read_defio,
    "run": _read_run,
    "runbyname": _read_run,
    "call": _read_callee,
    "callbyname": _read_callee,
    **dict.fromkeys(
        ("input", "lineinput", "com_state", "getpublicvalue", "readbytearray"), _read_input
    ),
    **dict.fromkeys(("in", "out"), _read_in_out),
}
