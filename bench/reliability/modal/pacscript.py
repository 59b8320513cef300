"""The modal state of PacScript, as far as straight programs need it. Branches are not run."""

from __future__ import annotations

import re
from collections.abc import Sequence

from bench.reliability.modal.machine import (
    Atom,
    Event,
    Machine,
    Number,
    Point,
    as_number,
    describe_arc,
    multiply,
    read_arguments,
    read_atom,
    read_atoms,
    rename,
    rotate,
    split,
)
from bench.reliability.mutations import LANGUAGES

_WORD = re.compile(r'"[^"]*"|\d+\.?\d*(?:e[+-]?\d+)?|\.\d+|[a-z_]\w*|<>|<=|>=|\S')
_OPENINGS = ("if", "for", "do", "select")
_CLOSINGS = (("end", "if"), ("next",), ("loop",), ("end", "select"))
_TAKEN = frozenset(word.lower() for word in LANGUAGES["pacscript"].words)
#: Bytes of a line that the controller reads.
_LINE_LENGTH = 1024
_SETTINGS = {"speed", "extspeed", "changetool", "changework", "motor", "payload"}
#: Short names of motions and options.
_NAMES = {"ptp": "p", "s": "speed"}


class _Robot(Machine):
    """A robot with its force tables.

    `ForceParam` defines a table (RC8 manual 5176) by which the robot presses while force control is
    on. Until then, a table has no effect.

    tables: values by name
    is_pressing: whether force control is on
    """

    def __init__(self) -> None:
        super().__init__()
        self.tables: dict[str, Event] = {}
        self.is_pressing = False

    def fill(self, table: str, value: Event) -> None:
        """Defines a table. It has an effect at once while the robot presses."""
        if self.tables.get(table) != value:
            self.tables[table] = value
            if self.is_pressing:
                self.show_tables()

    def press(self, *value: Atom) -> None:
        """Switches force control on or off."""
        self.is_pressing = value[:1] != ("false",)
        self.show_tables()
        self.switch("forcectrl", *value)

    def show_tables(self) -> None:
        """Adds all tables that have changed."""
        for table in sorted(self.tables):
            self.switch(f"forceparam {table}", *self.tables[table])

    def add_statement(self, words: Sequence[str]) -> None:
        """Adds a statement that may read the tables, fill them, or begin to press."""
        self.show_tables()
        super().add_statement(words)
        self.tables.clear()
        self.is_pressing |= words[0] in ("call", "sub") or "forcectrl" in words

    def end(self) -> list[Event]:
        """The whole trace, with the tables at the end."""
        self.show_tables()
        return super().end()


def trace(text: str) -> list[Event]:
    """The trace of one file."""
    machine, depth, position = _Robot(), 0, None
    lines = text.split("\n")
    statements = [_read_words(line) for line in lines]
    names = [words[1] for words in statements if words[:1] == ["sub"] and len(words) > 1]
    statements = rename(statements, [name for name in names if name != "main"], _is_free)
    for number, line in enumerate(lines):
        words = _simplify_parameters(statements[number], statements[number + 1 :])
        if len(line.encode()) > _LINE_LENGTH:
            machine.add("too long", line)
        if not words:
            continue
        is_closing = any(tuple(words[: len(mark)]) == mark for mark in _CLOSINGS)
        is_opening = words[0] in _OPENINGS and (words[0] != "if" or words[-1] == "then")
        if depth or is_opening or is_closing:
            depth += is_opening - is_closing
            _add_once(machine, words)
        else:
            position = _read(machine, words, position)
    return machine.end()


def _is_free(name: str) -> bool:
    """Whether a Sub may have a name."""
    return re.fullmatch(r"[a-z]\w*", name) is not None and name not in _TAKEN


def _read_words(line: str) -> list[str]:
    """The words of a line in lower case, strings as they are, without its comment."""
    code = re.match(r"(?:\"[^\"]*\"|[^'\"])*\"?", line)
    parts = re.split(r'("[^"]*")', code[0] if code else "")
    words = _WORD.findall("".join(part if part[:1] == '"' else part.lower() for part in parts))
    return [] if words[:1] == ["rem"] else words


def _simplify_parameters(words: list[str], following: Sequence[list[str]]) -> list[str]:
    """The words of a statement. A simple `Sub` loses `ByVal` and the names that it does not use.

    A `Sub` is simple if it assigns nothing and calls nothing: then it is the same whether it has
    the caller's variable (`ByRef`, the other word of the keyword list) or a copy.
    """
    if words[:1] != ["sub"]:
        return words
    body = following
    if ["end", "sub"] in following:
        body = following[: following.index(["end", "sub"])]
    used = set()
    for line in body:
        if "=" in line[1:2] or line[:1] in (["call"], ["sub"], ["dim"], ["for"]):
            return words
        used |= set(line)
    plain: list[str] = []
    for place, word in enumerate(words):
        if word != "byval" or words[place - 1] not in ("(", ","):
            plain.append(word)
    simple = list(plain)
    for place, word in enumerate(plain[:-1]):
        is_name = plain[place + 1] == "as" and plain[place - 1] in ("(", ",")
        if is_name and word not in used:
            simple[place] = ""
    return simple


def _add_once(machine: Machine, words: Sequence[str]) -> None:
    """Adds a statement as it is. An assignment that is repeated at once has no effect."""
    is_assignment = len(words) > 2 and words[1] == "="
    if not (is_assignment and machine.trace[-1:] == [("says", *read_atoms(words))]):
        machine.add_statement(words)


def _read(machine: _Robot, words: list[str], position: Point | None) -> Point | None:
    """Runs a statement outside of all branches. Returns the position after it.

    position: position of the tool before it, None if it is unknown
    """
    name = words[0]
    if name in ("sub", "end", "function", "call"):
        machine.leave()
        machine.add_statement(words)
        return None
    if name == "move":
        event, target = _read_motion(words[1:], position)
        if event:
            machine.move(*event)
        else:
            machine.add_statement(words)
        return target
    if not _run_setting(machine, words):
        _add_once(machine, words)
    return position


def _run_setting(machine: _Robot, words: list[str]) -> bool:
    """Runs a setting, an output or a wait. Returns whether it is one of them."""
    name, rest, number = words[0], split(words[1:]), as_number(words[1:])
    are_numbers = all(as_number(part) is not None for part in rest)
    if name in _SETTINGS and len(words) > 1:
        machine.keep(name, *read_atoms(words[1:]))
    elif name in ("accel", "decel") and are_numbers and len(rest) < 3:
        for key, part in zip((name, "decel"), rest, strict=False):
            machine.keep(key, *read_atoms(part))
    elif name in ("tool", "work") and len(rest) > 1:
        machine.keep(f"{name} {' '.join(rest[0])}", *_read_targets(rest[1:]))
    elif name == "forceparam" and len(rest) > 1:
        machine.fill(" ".join(rest[0]), _read_targets(rest[1:], "N"))
    elif name == "forcectrl" and len(words) > 1:
        machine.press(*read_atoms(words[1:]))
    elif name in ("set", "reset") and re.fullmatch(r"io \[ \d+ \]", " ".join(words[1:])):
        machine.switch(f"io {int(words[3])}", name)
    elif name == "delay" and number is not None:
        machine.add("wait", Number(number / 1000, "s"))
    else:
        return False
    return True


def _read_pose(words: Sequence[str]) -> list[float] | None:
    """The numbers of a position, None for other words.

    A number that is left out before a comma is 0 (RC8 manual, position type).
    """
    complete: list[str] = []
    for word in words:
        if word == "," and complete[-1:] in (["("], [","]):
            complete.append("0")
        complete.append(word)
    return read_arguments(complete, "p", 7)


def _read_target(words: Sequence[str], unit: str = "mm") -> Event:
    """A position with its rotation and figure, joint values, or the words as they are."""
    pose = _read_pose(words)
    if pose:
        x, y, z, a, b, c, *figure = [*pose, *[0.0] * (6 - len(pose))]
        place = [Number(value, unit) for value in (x, y, z)]
        rotation = multiply(rotate(2, c), rotate(1, b), rotate(0, a))
        return ("p", *place, *rotation, Number(figure[0] if figure else -1.0))
    joints = read_arguments(words, "j", 8)
    if joints:
        return ("j", *(Number(value, "deg") for value in [*joints, *[0.0] * (8 - len(joints))]))
    return tuple(map(read_atom, words))


def _read_targets(parts: list[list[str]], unit: str = "mm") -> Event:
    atoms: list[Atom] = []
    for part in parts:
        atoms += _read_target(part, unit)
    return tuple(atoms)


def _read_motion(words: list[str], position: Point | None) -> tuple[Event, Point | None]:
    """A motion from a position, and the position at its end.

    The event is empty if the words are not those of a motion that the posts write.
    """
    parts = split(words)
    kind = _NAMES.get(" ".join(parts[0]), " ".join(parts[0]))
    count = 2 if kind == "c" else 1
    if kind not in ("p", "l", "c") or len(parts) < 1 + count:
        return (), None
    end = parts[count]
    mark: Atom = Number(0.0)
    if end[:1] == ["@"] and len(end) > 1:
        mark, end = read_atom(end[1]), end[2:]
    target = _read_place(end)
    via: Event = ()
    if kind == "c":
        point = _read_place(parts[1])
        if not point:
            return (), None
        via = tuple(Number(value, "mm") for value in point)
        if position and target:
            via = describe_arc(position, point, target)
        # The orientation of the via point is ignored (reference, Move C), not its figure.
        via = (*via, *_read_target(parts[1])[-1:])
    options: dict[str, Event] = {}
    for part in parts[1 + count :]:
        name = _NAMES.get(part[0], part[0]) if part else ""
        if len(part) < 3 or part[1] != "=" or name in options:
            return (), None
        options[name] = _read_speed(part[2:])
    event: list[Atom] = ["move", kind, "@", mark, *via, *_read_target(end)]
    for name in sorted(options):
        event += (name, *options[name])
    return tuple(event), target


def _read_place(words: Sequence[str]) -> Point | None:
    pose = _read_pose(words)
    return (*pose, 0.0, 0.0)[:3] if pose else None


def _read_speed(words: Sequence[str]) -> Event:
    """Percent of the internal speed, or `Mps(number * name)` with its factors in any order."""
    if words[:2] == ["mps", "("] and words[-1:] == [")"]:
        product = 1.0
        names = []
        for factor in split(words[2:-1], "*"):
            value = as_number(factor)
            if value is None:
                names.append(" ".join(factor))
            else:
                product *= value
        if all(re.fullmatch(r"[a-z_]\w*", name) for name in names):
            return ("mps", Number(product, "mm/s"), *sorted(names))
    value = as_number(words)
    return tuple(map(read_atom, words)) if value is None else (Number(value, "%"),)
