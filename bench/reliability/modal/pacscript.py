"""The modal state of PacScript, as far as straight programs need it. Branches are taken word by word, unrun."""

from __future__ import annotations

import re
from collections.abc import Sequence

from bench.reliability.modal.machine import (
    Atom,
    Event,
    Machine,
    Number,
    Point,
    arc,
    arguments,
    as_number,
    atom,
    atoms,
    rename,
    split,
    turn,
    turned,
)
from bench.reliability.mutations import LANGUAGES

_WORD = re.compile(r'"[^"]*"|\d+\.?\d*(?:e[+-]?\d+)?|\.\d+|[a-z_]\w*|<>|<=|>=|\S')
_OPENS, _CLOSES = (
    ("if", "for", "do", "select"),
    (("end", "if"), ("next",), ("loop",), ("end", "select")),
)
_TAKEN = frozenset(word.lower() for word in LANGUAGES["pacscript"].words)
_LONGEST = 1024
_SETTINGS = {"speed", "extspeed", "changetool", "changework", "motor", "payload"}
_NAMES = {"ptp": "p", "s": "speed"}


class _Robot(Machine):
    """With its force tables: ``ForceParam`` defines one (RC8 manual 5176), by which the robot presses while force
    control is on. While it is off a table shows nowhere.
    """

    def __init__(self) -> None:
        super().__init__()
        self.tables: dict[str, Event] = {}
        self.pressing = False

    def fill(self, table: str, value: Event) -> None:
        """Shows at once while the robot presses: it may press by this table."""
        if self.tables.get(table) != value:
            self.tables[table] = value
            if self.pressing:
                self.show_tables()

    def press(self, *value: Atom) -> None:
        """Force control on or off, by all tables."""
        self.pressing = value[:1] != ("false",)
        self.show_tables()
        self.switch("forcectrl", *value)

    def show_tables(self) -> None:
        """All tables, each that has changed."""
        for table in sorted(self.tables):
            self.switch(f"forceparam {table}", *self.tables[table])

    def tell(self, words: Sequence[str]) -> None:
        """A statement that is not understood may read the tables and fill them, or begin to press."""
        self.show_tables()
        super().tell(words)
        self.tables.clear()
        self.pressing |= words[0] in ("call", "sub") or "forcectrl" in words

    def end(self) -> list[Event]:
        """With the tables that are left behind."""
        self.show_tables()
        return super().end()


def trace(text: str) -> list[Event]:
    """The trace of one file."""
    machine, depth, here = _Robot(), 0, None
    lines = text.split("\n")
    read = [_words(line) for line in lines]
    names = [words[1] for words in read if words[:1] == ["sub"] and len(words) > 1]
    read = rename(read, [name for name in names if name != "main"], _is_free)
    for k, (line, said) in enumerate(zip(lines, read, strict=True)):
        words = _plain_parameters(said, read[k + 1 :])
        if len(line.encode()) > _LONGEST:
            machine.say("too long", line)
        if not words:
            continue
        closes = any(tuple(words[: len(mark)]) == mark for mark in _CLOSES)
        opens = words[0] in _OPENS and (words[0] != "if" or words[-1] == "then")
        if depth or opens or closes:
            depth += opens - closes
            _tell_once(machine, words)
        else:
            here = _read(machine, words, here)
    return machine.end()


def _is_free(name: str) -> bool:
    """Whether a Sub may have that name."""
    return re.fullmatch(r"[a-z]\w*", name) is not None and name not in _TAKEN


def _words(line: str) -> list[str]:
    """The words of a line in small letters, without its comment; a text in quotes stays as it is."""
    kept = re.match(r"(?:\"[^\"]*\"|[^'\"])*\"?", line)
    plain = kept[0] if kept else ""
    parts = re.split(r'("[^"]*")', plain)
    words = _WORD.findall("".join(part if part[:1] == '"' else part.lower() for part in parts))
    return [] if words[:1] == ["rem"] else words


def _plain_parameters(words: list[str], after: Sequence[list[str]]) -> list[str]:
    """The words of a statement; of a ``Sub`` that gives no name a value and calls none without ``ByVal``: whether it
    has the caller's variable (``ByRef``, the other word of the keyword list) or a copy, the values in it are the same.
    And without the names that the ``Sub`` does not use: what nobody reads may be called anything.
    """
    if words[:1] != ["sub"]:
        return words
    inside = after[: after.index(["end", "sub"])] if ["end", "sub"] in after else after
    if any("=" in one[1:2] or one[:1] in (["call"], ["sub"], ["dim"], ["for"]) for one in inside):
        return words
    plain = [
        word for k, word in enumerate(words) if word != "byval" or words[k - 1] not in ("(", ",")
    ]
    used = {word for one in inside for word in one}
    named = [
        k
        for k, word in enumerate(plain[:-1])
        if plain[k + 1] == "as" and plain[k - 1] in ("(", ",")
    ]
    return ["" if k in named and word not in used else word for k, word in enumerate(plain)]


def _tell_once(machine: Machine, words: Sequence[str]) -> None:
    """A statement as it is. The same value given again at once to the same name says nothing."""
    event = ("says", *atoms(words))
    if not (len(words) > 2 and words[1] == "=" and machine.trace[-1:] == [event]):
        machine.tell(words)


def _read(machine: _Robot, words: list[str], here: Point | None) -> Point | None:
    """A statement that stands in no branch. here: where the tool stands; returned is where it stands after it."""
    name = words[0]
    if name in ("sub", "end", "function", "call"):
        here = None
        machine.leave()
        machine.tell(words)
    elif name == "move":
        event, here = _move(words[1:], here)
        if event:
            machine.move(*event)
        else:
            machine.tell(words)
    elif not _set(machine, words):
        _tell_once(machine, words)
    return here


def _set(machine: _Robot, words: list[str]) -> bool:
    """A setting, an output or a wait; False where it is none of them."""
    name, rest, number = words[0], split(words[1:]), as_number(words[1:])
    if name in _SETTINGS and len(words) > 1:
        machine.hold(name, *atoms(words[1:]))
    elif (
        name in ("accel", "decel")
        and all(as_number(part) is not None for part in rest)
        and len(rest) < 3
    ):
        for key, part in zip((name, "decel"), rest, strict=False):
            machine.hold(key, *atoms(part))
    elif name in ("tool", "work") and len(rest) > 1:
        machine.hold(
            f"{name} {' '.join(rest[0])}", *(each for part in rest[1:] for each in _target(part))
        )
    elif name == "forceparam" and len(rest) > 1:
        machine.fill(
            " ".join(rest[0]), tuple(each for part in rest[1:] for each in _target(part, "N"))
        )
    elif name == "forcectrl" and len(words) > 1:
        machine.press(*atoms(words[1:]))
    elif name in ("set", "reset") and re.fullmatch(r"io \[ \d+ \]", " ".join(words[1:])):
        machine.switch(f"io {int(words[3])}", name)
    elif name == "delay" and number is not None:
        machine.say("wait", Number(number / 1000, "s"))
    else:
        return False
    return True


def _filled(words: Sequence[str]) -> list[str]:
    """The words of a position; a number that is left out before a comma is 0 (RC8 manual, position type)."""
    filled: list[str] = []
    for word in words:
        if word == "," and filled[-1:] in (["("], [","]):
            filled.append("0")
        filled.append(word)
    return filled


def _target(words: Sequence[str], unit: str = "mm") -> Event:
    """A position by place, orientation and figure, joint values, or what stands there."""
    pose = arguments(_filled(words), "p", 7)
    if pose:
        x, y, z, a, b, c, *figure = [*pose, *[0.0] * (6 - len(pose))]
        place = tuple(Number(value, unit) for value in (x, y, z))
        return (
            "p",
            *place,
            *turned(turn(2, c), turn(1, b), turn(0, a)),
            Number(figure[0] if figure else -1.0),
        )
    joints = arguments(words, "j", 8)
    if joints:
        return ("j", *(Number(value, "deg") for value in [*joints, *[0.0] * (8 - len(joints))]))
    return tuple(map(atom, words))


def _marked(words: list[str]) -> tuple[Event, list[str]]:
    """The pass mark before a target and the target; @0 where there is none."""
    if words[:1] == ["@"] and len(words) > 1:
        return ("@", atom(words[1])), words[2:]
    return ("@", Number(0.0)), words


def _move(words: list[str], here: Point | None) -> tuple[Event, Point | None]:
    """A motion from ``here``, and where it leads; nothing where it is not one of those that are written one a line."""
    parts = split(words)
    kind = _NAMES.get(" ".join(parts[0]), " ".join(parts[0]))
    count = 2 if kind == "c" else 1
    if kind not in ("p", "l", "c") or len(parts) < 1 + count:
        return (), None
    mark, end = _marked(parts[count])
    there = _place(end)
    via: Event = ()
    if kind == "c":
        point = _place(parts[1])
        if not point:
            return (), None
        # The orientation of the via point is ignored (reference, Move C), not its figure.
        via = tuple(Number(value, "mm") for value in point)
        if here and there:
            via = arc(here, point, there)
        via = (*via, *_target(parts[1])[-1:])
    options: list[list[Atom]] = []
    for part in parts[1 + count :]:
        if len(part) < 3 or part[1] != "=":
            return (), None
        options.append([_NAMES.get(part[0], part[0]), *_speed(part[2:])])
    if len({str(option[0]) for option in options}) < len(options):
        return (), None
    told = sorted(options, key=lambda option: str(option[0]))
    return (
        "move",
        kind,
        *mark,
        *via,
        *_target(end),
        *(each for option in told for each in option),
    ), there


def _place(words: Sequence[str]) -> Point | None:
    pose = arguments(_filled(words), "p", 7)
    return (*pose, 0.0, 0.0)[:3] if pose else None  # type: ignore[return-value]


def _speed(words: Sequence[str]) -> Event:
    """A share of the internal speed, or ``Mps(number * name)`` with its factors in any order."""
    if words[:2] == ["mps", "("] and words[-1:] == [")"]:
        factors = split(words[2:-1], "*")
        values = [as_number(factor) for factor in factors]
        names = sorted(
            " ".join(f) for f, value in zip(factors, values, strict=True) if value is None
        )
        if all(re.fullmatch(r"[a-z_]\w*", name) for name in names):
            product = 1.0
            for value in values:
                product *= 1.0 if value is None else value
            return ("mps", Number(product, "mm/s"), *names)
    value = as_number(words)
    return tuple(map(atom, words)) if value is None else (Number(value, "%"),)
