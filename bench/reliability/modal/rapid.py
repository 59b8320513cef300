"""The modal state of RAPID by routine. The settings of its caller are unknown in a routine."""

from __future__ import annotations

import re
from collections.abc import Iterator

from bench.reliability.modal.machine import (
    Atom,
    Event,
    Machine,
    Number,
    Point,
    as_number,
    describe_arc,
    read_atom,
    rename,
    split,
)

_WORD = re.compile(r'"(?:[^"]|"")*"|\d+\.?\d*(?:e[+-]?\d+)?|\.\d+|[a-z_]\w*|:=|<>|<=|>=|[^\s]')
_SPEEDS = """
    5 10 20 30 40 50 60 80 100 150 200 300 400 500 600 800 1000 1500 2000 2500 3000 4000 5000 6000
    7000"""
#: Predefined zones: mm of the TCP, of the orientation and of external axes, deg, mm, deg.
_ZONES = {
    "z0": (0.3, 0.3, 0.3, 0.03, 0.3, 0.03),
    "z1": (1, 1, 1, 0.1, 1, 0.1),
    "z5": (5, 8, 8, 0.8, 8, 0.8),
    "z10": (10, 15, 15, 1.5, 15, 1.5),
    "z15": (15, 23, 23, 2.3, 23, 2.3),
    "z20": (20, 30, 30, 3, 30, 3),
    "z30": (30, 45, 45, 4.5, 45, 4.5),
    "z40": (40, 60, 60, 6, 60, 6),
    "z50": (50, 75, 75, 7.5, 75, 7.5),
}
#: Longest name and longest string, characters.
_NAME_LENGTH, _STRING_LENGTH = 32, 80
_POSE = ("mm",) * 3 + ("turn",) * 4
#: Units of the numbers of each kind of value, in order.
_UNITS = {
    "pose": _POSE + ("",) * 10,
    "joints": ("deg",) * 6 + ("",) * 6,
    "speed": ("mm/s", "deg/s", "", ""),
    "zone": ("",) * 7,
    "newtons": ("N",),
    "threshold": ("",),
    "tool": ("", *_POSE) + ("",) * 11,
    "frame": ("",) * 3 + _POSE * 2,
}
#: Kinds of values with types and names of arguments of their own.
_TYPES = {"tooldata": "tool", "wobjdata": "frame", "speeddata": "speed", "zonedata": "zone"}
_OPTIONS = {"wobj": "frame", "fx": "newtons", "fy": "newtons", "fz": "newtons"}
#: Required arguments of each motion, in order. Options are between them.
_MOTIONS = {
    "moveabsj": "joints speed zone tool",
    "movej": "pose speed zone tool",
    "movel": "pose speed zone tool",
    "movec": "pose pose speed zone tool",
    "fcpress1lstart": "pose speed threshold zone tool",
    "fcpressl": "pose speed newtons zone tool",
    "fcpressc": "pose pose speed newtons zone tool",
    "fcpressend": "pose speed tool",
}
_SUPERVISIONS = ("confj", "confl")
_OUTPUTS = ("setdo", "setao", "setgo", "set", "reset")
#: Statements that have no effect when they are repeated before a motion or an unknown statement.
_STATES = (
    ["waittime", "\\", "inpos", ",", "0", ";"],
    ["if", "fcisforcemode", "(", ")", "fcdeact", ";"],
)
_SETTINGS = {"confj", "confl", "singarea", "accset", "velset", "cirpathmode"}
_DECLARATIONS = {"const", "pers", "var"}
_RESERVED_WORDS = """
    alias and backward case connect const default div do else elseif endfor endfunc endif endmodule
    endproc endrecord endtest endtrap endwhile error exit false for from func goto if inout local
    mod module nostepin not noview or pers proc raise readonly record retry return step sysmodule
    task test then to trap true trynext undo var viewonly while with xor fine vmax tool0 wobj0 load0
    main user base reg1 reg2 reg3 reg4 reg5 wobj1 clock1 high low edge set reset setdo setao setgo
    stop waittime offs reltool tpwrite fccalib fcdeact fcact"""
_TAKEN = frozenset((*_RESERVED_WORDS.split(), *_MOTIONS, *_SETTINGS))
#: Statements of one word, without a semicolon.
_BARE = ("endproc", "endmodule", "error", "endfunc", "endtrap")


def trace(text: str) -> list[Event]:
    """The trace of one module."""
    statements = list(_split_statements(text))
    names = [words[words.index("proc") + 1] for words in statements if _is_header(words)]
    statements = rename(statements, [name for name in names if name != "main"], _is_free)
    # The name of an optional argument belongs to its instruction (kernel manual, parameter lists).
    code = re.sub("![^\n]*", "", text.lower())
    module = _Module(re.findall(r"(?<!\\)\b\w+", code), _list_switching(statements))
    for words in statements:
        module.read(words)
    module.leave()
    for name in sorted(module.persistent):
        module.machine.add("persistent", name, *module.persistent[name])
    return module.machine.end()


def _split_statements(text: str) -> Iterator[list[str]]:
    """The statements of a text, with headers of routines.

    A comment after a statement is left out (IRC5 and many programs take it there). One within a
    statement, or outside of the module, is words.
    """
    words: list[str] = []
    has_begun = has_ended = False
    for line in text.split("\n"):
        plain = line.strip()
        if plain and not has_begun and not re.match(r"module\b", plain, re.IGNORECASE):
            yield plain.split()
            continue
        parts = re.split(r'("(?:[^"]|"")*")', plain)
        for word in _WORD.findall("".join(p if p[:1] == '"' else p.lower() for p in parts)):
            if word == "!" and has_begun and not has_ended and not words:
                break
            words.append(word)
            has_begun |= word == "module"
            has_ended |= word == "endmodule"
            is_header = words[0] in ("proc", "local") and word == ")"
            is_module = words[0] == "module" and len(words) == 2
            if word == ";" or word in _BARE or is_header or is_module:
                yield words
                words = []
    if words:
        yield words


def _is_header(words: list[str]) -> bool:
    return words[-1] == ")" and "proc" in words[:2]


def _is_free(name: str) -> bool:
    """Whether a routine may have a name."""
    is_legal = re.fullmatch(r"[a-z]\w*", name) is not None and len(name) <= _NAME_LENGTH
    return is_legal and name not in _TAKEN


def _list_switching(statements: list[list[str]]) -> dict[str, list[list[str]]]:
    """The bodies of routines that only set outputs to numbers; others have an empty one."""
    bodies: dict[str, list[list[str]]] = {}
    name = ""
    for words in statements:
        if _is_header(words):
            name = words[words.index("proc") + 1]
            bodies[name] = []
        elif words == ["endproc"]:
            name = ""
        elif name:
            bodies[name].append(words)
    for name, body in bodies.items():
        if not all(words[0] in _OUTPUTS and words[-1] == ";" for words in body):
            bodies[name] = []
    return bodies


class _Module:
    """A module that is read.

    words: words of the text without comments
    bodies: the result of `_list_switching`
    persistent: the values of persistent data by name
    position: position of the TCP, mm; None if it is unknown
    data: values by name
    routine: name of the routine that is read; None before the first one
    """

    def __init__(self, words: list[str], bodies: dict[str, list[list[str]]]) -> None:
        self.machine, self.words, self.bodies = Machine(), words, bodies
        self.persistent: dict[str, Event] = {}
        self.position: Point | None = None
        self.data: dict[str, Event] = {}
        for speed in _SPEEDS.split():
            self.data[f"v{speed}"] = _read_atoms("speed", [speed, "500", "5000", "1000"])
        for name, zone in _ZONES.items():
            self.data[name] = ("false", *(Number(float(value)) for value in zone))
        self.routine: str | None = None

    def leave(self) -> None:
        """Ends a routine without the supervision of configurations that main leaves.

        It is on whenever a program is started from its beginning (system data types manual, ConfJ,
        ConfL), and calls show it.
        """
        if self.routine == "main":
            for name in _SUPERVISIONS:
                self.machine.state.pop(name, None)
        self.machine.leave()

    def read(self, words: list[str]) -> None:
        """Reads a statement."""
        machine, name = self.machine, words[0]
        if any(word[:1] == '"' and len(word) > _STRING_LENGTH + 2 for word in words):
            machine.add("a long text", *words)
        if ":=" in words and not _DECLARATIONS.isdisjoint(words[: words.index(":=")]):
            self._declare(words)
        elif name == "module" and self._may_name_module(words[1]):
            # Its name has no effect, since nothing else in the text has it.
            machine.add_statement(words[:1])
        elif name in ("proc", "local"):
            self._begin(words)
        elif words[-1] != ";" and name not in (*_BARE, "module"):
            machine.add_statement(words)
        elif name in _MOTIONS:
            self._move(words)
        elif len(words) == 2 and name in self.bodies:
            self._call(words)
        elif not self._run_setting(words):
            machine.add_statement(words)

    def _begin(self, words: list[str]) -> None:
        """Begins a routine."""
        self.position = None
        self.leave()
        self.machine.add_statement(words)
        self.routine = words[-3] if words[-2:] == ["(", ")"] else ""
        if self.routine == "main":
            for setting in _SUPERVISIONS:
                self.machine.keep(setting, "\\", "on")

    def _call(self, words: list[str]) -> None:
        """Calls a routine: its effects if it only switches, else the state that it takes over."""
        body = self.bodies[words[0]]
        if body and all(map(self._run_setting, body)):
            return
        self.machine.move("calls")
        self.machine.add_statement(words)
        self.position = None

    def _run_setting(self, words: list[str]) -> bool:
        """Runs a setting, an output or a wait. Returns whether it is one of them."""
        machine, name = self.machine, words[0]
        plain = " ".join(words).replace("- 0 ;", "0 ;").split(" ")
        value = as_number(words[3:-1] if words[2:3] == [","] else words[1:-1])
        if name in _SETTINGS:
            machine.keep(name, *map(read_atom, words[1:-1]))
        elif name in ("setdo", "setao", "setgo") and words[2:3] == [","] and value is not None:
            machine.switch(words[1], Number(value))
        elif name in ("set", "reset") and len(words) == 3:
            machine.switch(words[1], Number(float(name == "set")))
        elif name == "waittime" and len(words) == 3 and value is not None:
            machine.add("wait", Number(value, "s"))
        elif plain in _STATES:
            # If nothing has moved since, the arm stands, and force control is off.
            machine.switch(" ".join(plain), "is so")
        else:
            return False
        return True

    def _declare(self, words: list[str]) -> None:
        """Declares a datum. A persistent one is in the trace, since it keeps its value."""
        place = words.index(":=")
        kind, name = words[: place - 1], words[place - 1]
        is_late = self.routine is not None or name in self.data
        if is_late or len(name) > _NAME_LENGTH or words[-1] != ";" or len(kind) < 2:
            self.machine.add("a wrong declaration", *words)
            return
        value = _read_atoms(_TYPES.get(kind[-1], ""), words[place + 1 : -1])
        is_plain = kind[0] == "const" and kind[-1] in ("speeddata", "zonedata")
        self.data[name] = value if is_plain else (*kind, *value)
        if "pers" in kind:
            self.persistent[name] = (*kind, *value)

    def _may_name_module(self, name: str) -> bool:
        return _is_free(name) and name not in self.data and self.words.count(name) == 1

    def _read_value(self, kind: str, words: list[str]) -> Event:
        """A datum, or the atoms of a value."""
        if len(words) == 1 and words[0] in self.data:
            return self.data[words[0]]
        return _read_atoms(kind, words)

    def _move(self, words: list[str]) -> None:
        """Runs a motion with its arguments in order."""
        name = words[0]
        arguments = [split(part, "\\") for part in split(words[1:-1])]
        required = [value for value, *_ in arguments if value]
        kinds = _MOTIONS[name].split()
        if len(required) != len(kinds) or [[]] in arguments:
            self.position = None
            self.machine.add_statement(words)
            return
        values = [self._read_value(*pair) for pair in zip(kinds, required, strict=True)]
        self._simplify(name, kinds, values)
        atoms: list[Atom] = []
        for value in values:
            atoms += ("|", *value)
        place = 0
        for value, *options in arguments:
            # The comma before an optional argument may be left out (kernel manual, argument lists).
            place += bool(value)
            for option in options:
                kind = _OPTIONS.get(option[0], "")
                atoms += (f"\\{place}", *option[:2], *self._read_value(kind, option[2:]))
        self._add_motion(name, atoms)

    def _add_motion(self, name: str, atoms: list[Atom]) -> None:
        """Adds a motion with the settings that hold for it.

        ConfJ holds for MoveJ, ConfL for lines and arcs (system data types manual, ConfJ, ConfL);
        MoveAbsJ has no configuration.
        """
        machine, state = self.machine, self.machine.state
        supervision = {"moveabsj": "", "movej": "confj"}.get(name, "confl")
        machine.state = dict(state)
        for key in _SUPERVISIONS:
            if key != supervision:
                machine.state.pop(key, None)
        machine.move(name, *atoms)
        machine.state = state
        for words in _STATES:
            machine.outputs.pop(" ".join(words), None)

    def _simplify(self, name: str, kinds: list[str], values: list[Event]) -> None:
        """Removes differences that have no effect from the values of a motion.

        They are the via point of an arc on the same circle, the speed of external axes that do not
        move, and that of a TCP that keeps its position, since the slowest part of a motion decides
        (speeddata).
        """
        poses = [place for place, kind in enumerate(kinds) if kind == "pose"]
        points: list[Point | None] = []
        external: list[float] = []
        for place in poses:
            numbers = [atom.value for atom in values[place] if isinstance(atom, Number)]
            points.append((numbers[0], numbers[1], numbers[2]) if len(numbers) == 17 else None)
            external = numbers[-6:]
        if len(points) == 2 and self.position and points[0] and points[1]:
            others = [atom for atom in values[poses[0]] if not _is_length(atom)]
            values[poses[0]] = (*describe_arc(self.position, points[0], points[1]), *others)
        place = kinds.index("speed")
        speed = values[place]
        positive = [atom for atom in speed if isinstance(atom, Number) and atom.value > 0]
        is_still = bool(poses) and all(value == 9e9 for value in external)
        if is_still and len(speed) >= 4 and all(atom in positive for atom in speed[-2:]):
            speed = speed[:-2]
        is_reorientation = name == "movel" and points == [self.position] and points != [None]
        if is_reorientation and len(speed) == 2 and speed[0] in positive:
            speed = speed[1:]
        values[place] = speed
        self.position = points[-1] if points else None


def _read_atoms(kind: str, words: list[str]) -> Event:
    """The atoms of a value. Its numbers have units if their count is right."""
    atoms: list[Atom] = []
    sign = 1.0
    for word in words:
        value = as_number([word])
        if word == "-" and sign > 0:
            sign = -1.0
            continue
        atoms.append(word if value is None else Number(sign * value))
        sign = 1.0
    if sign < 0:
        atoms.append("-")
    units = _UNITS.get(kind, ())
    leaves = [place for place, atom in enumerate(atoms) if atom not in ("[", "]", ",")]
    if len(leaves) == len(units):
        for place, unit in zip(leaves, units, strict=True):
            atom = atoms[place]
            atoms[place] = Number(atom.value, unit) if isinstance(atom, Number) else atom
        _fix_signs(atoms)
    if kind in ("speed", "zone", "newtons") and _is_list(words):
        return tuple(atoms[place] for place in leaves)
    return tuple(atoms)


def _is_length(atom: Atom) -> bool:
    return isinstance(atom, Number) and atom.unit == "mm"


def _fix_signs(atoms: list[Atom]) -> None:
    """Makes the first entry of a quaternion positive: its negative is the same orientation."""
    entries = []
    for place, atom in enumerate(atoms):
        if isinstance(atom, Number) and atom.unit == "turn":
            entries.append(place)
    for first in range(0, len(entries), 4):
        group = entries[first : first + 4]
        values = [atoms[place].value for place in group]
        if next((value for value in values if abs(value) > 1e-4), 0.0) < 0:
            for place, value in zip(group, values, strict=True):
                atoms[place] = Number(-value, "turn")


def _is_list(words: list[str]) -> bool:
    """Whether words are `[a,b,...]`, or have no bracket."""
    pattern = r"\[ (?:-? ?[\w.]+ , )*-? ?[\w.]+ \]"
    return re.fullmatch(pattern, " ".join(words)) is not None or "[" not in words
