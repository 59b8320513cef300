"""The modal state of RAPID, routine by routine: what one takes over from its caller is not known in it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import takewhile

from bench.reliability.modal.machine import (
    Atom,
    Event,
    Machine,
    Number,
    Point,
    arc,
    as_number,
    atom,
    rename,
    split,
)

_WORD = re.compile(r'"(?:[^"]|"")*"|\d+\.?\d*(?:e[+-]?\d+)?|\.\d+|[a-z_]\w*|:=|<>|<=|>=|[^\s]')
_SPEEDS = """
    5 10 20 30 40 50 60 80 100 150 200 300 400 500 600 800 1000 1500 2000 2500 3000 4000 5000 6000 7000
    """.split()  # noqa: SIM905
#: Predefined zones: mm of the TCP, of the orientation and of external axes, deg, mm, deg.
_ZONES = {
    "z0": (0.3, 0.3, 0.3, 0.03, 0.3, 0.03), "z1": (1, 1, 1, 0.1, 1, 0.1), "z5": (5, 8, 8, 0.8, 8, 0.8),
    "z10": (10, 15, 15, 1.5, 15, 1.5), "z15": (15, 23, 23, 2.3, 23, 2.3), "z20": (20, 30, 30, 3, 30, 3),
    "z30": (30, 45, 45, 4.5, 45, 4.5), "z40": (40, 60, 60, 6, 60, 6), "z50": (50, 75, 75, 7.5, 75, 7.5),
}  # fmt: skip
_LONGEST, _LONGEST_TEXT = 32, 80
_POSE = ("mm",) * 3 + ("turn",) * 4 + ("",) * 10
_UNITS = {
    "pose": _POSE, "joints": ("deg",) * 6 + ("",) * 6, "speed": ("mm/s", "deg/s", "", ""), "zone": ("",) * 7,
    "newtons": ("N",), "threshold": ("",), "tool": ("",) + ("mm",) * 3 + ("turn",) * 4 + ("",) * 11,
    "frame": ("",) * 3 + (("mm",) * 3 + ("turn",) * 4) * 2,
}  # fmt: skip
#: What each motion is given, in order; options come between.
_MOTIONS = {
    "moveabsj": "joints speed zone tool", "movej": "pose speed zone tool", "movel": "pose speed zone tool",
    "movec": "pose pose speed zone tool", "fcpress1lstart": "pose speed threshold zone tool",
    "fcpressl": "pose speed newtons zone tool", "fcpressc": "pose pose speed newtons zone tool",
    "fcpressend": "pose speed tool",
}  # fmt: skip
_SUPERVISIONS = ("confj", "confl")
_OUTPUTS = ("setdo", "setao", "setgo", "set", "reset")
#: Statements after which something is so that only a motion, or what is not known here, may change.
_STATES = (
    ["waittime", "\\", "inpos", ",", "0", ";"],
    ["if", "fcisforcemode", "(", ")", "fcdeact", ";"],
)
_SETTINGS = {"confj", "confl", "singarea", "accset", "velset", "cirpathmode"}
_KINDS = ("const", "pers", "var")
_RESERVED = """
    alias and backward case connect const default div do else elseif endfor endfunc endif endmodule endproc endrecord
    endtest endtrap endwhile error exit false for from func goto if inout local mod module nostepin not noview or pers
    proc raise readonly record retry return step sysmodule task test then to trap true trynext undo var viewonly while
    with xor fine vmax tool0 wobj0 load0 main user base reg1 reg2 reg3 reg4 reg5 wobj1 clock1 high low edge set reset
    setdo setao setgo stop waittime offs reltool tpwrite fccalib fcdeact fcact""".split()  # noqa: SIM905
_WHOLE = ("endproc", "endmodule", "error", "endfunc", "endtrap")


def trace(text: str) -> list[Event]:
    """The trace of one module."""
    # The name of an optional argument belongs to its instruction alone (kernel manual, parameter lists).
    statements = list(_statements(text))
    names = [words[words.index("proc") + 1] for words in statements if _is_header(words)]
    routines = [name for name in names if name != "main"]
    statements = rename(statements, routines, _is_routine_name)
    module = _Module(
        re.findall(r"(?<!\\)\b\w+", re.sub("![^\n]*", "", text.lower())),
        _list_switching(statements),
    )
    for words in statements:
        module.read(words)
    module.leave()
    for name in sorted(module.persistent):
        module.machine.say("persistent", name, *module.persistent[name])
    return module.machine.end()


def _statements(text: str) -> Iterator[list[str]]:
    """The statements of a text, headers of routines among them. A comment within a statement is words of it, and so
    is one outside of the module; after a statement it is none (IRC5 and many programs take it there).
    """
    words: list[str] = []
    begun = done = False
    for line in text.split("\n"):
        plain = line.strip()
        if plain and not begun and not re.match(r"\s*module\b", plain, re.IGNORECASE):
            yield plain.split()
            continue
        code = "".join(
            part if part[:1] == '"' else part.lower()
            for part in re.split(r'("(?:[^"]|"")*")', plain)
        )
        for word in _WORD.findall(code):
            if word == "!" and begun and not done and not words:
                break
            words.append(word)
            begun, done = begun or word == "module", done or word == "endmodule"
            header = words[0] in ("proc", "local") and word == ")"
            if (
                word == ";"
                or header
                or word in _WHOLE
                or (words[0] == "module" and len(words) == 2)
            ):
                yield words
                words = []
    if words:
        yield words


def _is_header(words: list[str]) -> bool:
    return words[-1] == ")" and "proc" in words[:2]


def _is_routine_name(name: str) -> bool:
    taken = name in _RESERVED or name in _MOTIONS or name in _SETTINGS
    return re.fullmatch(r"[a-z]\w*", name) is not None and len(name) <= _LONGEST and not taken


def _list_switching(statements: list[list[str]]) -> dict[str, list[list[str]]]:
    """The bodies of the routines; empty for one that holds anything else than outputs set to a number."""
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
    return {
        name: body if all(words[0] in _OUTPUTS and words[-1] == ";" for words in body) else []
        for name, body in bodies.items()
    }


class _Module:
    """What is declared, and the machine that reads the routines. words: of the text, without comments. bodies: of the
    routines, as ``_list_switching`` gives them. here: where the tool is.
    """

    def __init__(self, words: list[str], bodies: dict[str, list[list[str]]]) -> None:
        self.machine, self.words, self.bodies = Machine(), words, bodies
        self.persistent: dict[str, Event] = {}
        self.here: Point | None = None
        self.data: dict[str, Event] = {
            f"v{v}": self._flat("speed", [v, "500", "5000", "1000"]) for v in _SPEEDS
        }
        self.data |= {
            name: ("false", *(Number(float(v)) for v in zone)) for name, zone in _ZONES.items()
        }
        self.routines, self.routine = False, ""

    def leave(self) -> None:
        """The end of a routine. What main leaves of the supervision of postures counts no more: it is on whenever a
        program is started from its beginning (system data types manual, ConfJ, ConfL), and calls show it.
        """
        if self.routine == "main":
            for name in _SUPERVISIONS:
                self.machine.state.pop(name, None)
        self.machine.leave()

    def read(self, words: list[str]) -> None:
        """One statement."""
        machine, name = self.machine, words[0]
        if any(word[:1] == '"' and len(word) > _LONGEST_TEXT + 2 for word in words):
            machine.say("a long text", *words)
        if ":=" in words and any(
            word in _KINDS for word in takewhile(lambda word: word != ":=", words)
        ):
            self._declare(words)
        elif name == "module" and self._is_free(words[1]):
            # Nothing in the text says its name: it is no matter which it is.
            machine.tell(words[:1])
        elif name in ("proc", "local"):
            self._begin(words)
        elif words[-1] != ";" and name not in (*_WHOLE, "module"):
            machine.tell(words)
        elif name in _MOTIONS:
            self._move(name, words[1:-1], words)
        elif len(words) == 2 and name in self.bodies:
            self._call(name, words)
        elif not self._set(name, words):
            machine.tell(words)

    def _begin(self, words: list[str]) -> None:
        """The header of a routine."""
        self.routines, self.here = True, None
        self.leave()
        self.machine.tell(words)
        self.routine = words[-3] if words[-2:] == ["(", ")"] else ""
        for setting in _SUPERVISIONS if self.routine == "main" else ():
            self.machine.hold(setting, "\\", "on")

    def _call(self, name: str, words: list[str]) -> None:
        """A routine of this module: what it does where it only switches; else it takes over all that holds."""
        if self.bodies[name] and all(self._set(each[0], each) for each in self.bodies[name]):
            return
        self.machine.move("calls")
        self.machine.tell(words)
        self.here = None

    def _set(self, name: str, words: list[str]) -> bool:
        """A setting, an output or a wait; False where it is none of them."""
        machine = self.machine
        if name in _SETTINGS:
            machine.hold(name, *map(atom, words[1:-1]))
        elif (
            name in ("setdo", "setao", "setgo")
            and words[2:3] == [","]
            and as_number(words[3:-1]) is not None
        ):
            machine.switch(words[1], Number(as_number(words[3:-1]) or 0.0))
        elif name in ("set", "reset") and len(words) == 3:
            machine.switch(words[1], Number(float(name == "set")))
        elif name == "waittime" and len(words) == 3 and as_number(words[1:2]) is not None:
            machine.say("wait", Number(as_number(words[1:2]) or 0.0, "s"))
        elif (plain := " ".join(words).replace("- 0 ;", "0 ;").split(" ")) in _STATES:
            # Said again where nothing has moved, they find the arm standing, and force control off.
            machine.switch(" ".join(plain), "is so")
        else:
            return False
        return True

    def _declare(self, words: list[str]) -> None:
        """A datum, known by its value from here on. A persistent one keeps it: it counts even where nothing uses it."""
        at = words.index(":=")
        kind, name = words[: at - 1], words[at - 1]
        if (
            self.routines
            or name in self.data
            or len(name) > _LONGEST
            or words[-1] != ";"
            or len(kind) < 2
        ):
            self.machine.say("a wrong declaration", *words)
            return
        units = {
            "tooldata": "tool",
            "wobjdata": "frame",
            "speeddata": "speed",
            "zonedata": "zone",
        }.get(kind[-1], "")
        value = self._flat(units, words[at + 1 : -1])
        is_plain = kind[0] == "const" and kind[-1] in ("speeddata", "zonedata")
        self.data[name] = value if is_plain else (*kind, *value)
        if "pers" in kind:
            self.persistent[name] = (*kind, *value)

    def _is_free(self, name: str) -> bool:
        """Whether a module may have that name."""
        legal = re.fullmatch(r"[a-z]\w*", name) is not None and len(name) <= _LONGEST
        taken = name in _RESERVED or name in _MOTIONS or name in _SETTINGS or name in self.data
        return legal and not taken and self.words.count(name) == 1

    def _flat(self, units: str, words: list[str]) -> Event:
        """A value as atoms, with the units of its numbers where it has just as many of them as the kind asks for."""
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
        of = _UNITS.get(units, ())
        leaves = [k for k, each in enumerate(atoms) if each not in ("[", "]", ",")]
        if len(leaves) == len(of):
            for k, unit in zip(leaves, of, strict=True):
                each = atoms[k]
                atoms[k] = Number(each.value, unit) if isinstance(each, Number) else each
            _settle_signs(atoms)
        if units in ("speed", "zone", "newtons"):
            atoms = (
                [each for k, each in enumerate(atoms) if k in leaves] if _is_list(words) else atoms
            )
        return tuple(atoms)

    def _value(self, units: str, words: list[str]) -> Event:
        """What an argument stands for."""
        if len(words) == 1 and words[0] in self.data:
            return self.data[words[0]]
        return self._flat(units, words)

    def _move(self, name: str, given: list[str], words: list[str]) -> None:
        """A motion with its arguments in order."""
        parts = [split(part, "\\") for part in split(given)]
        places = [value for value, *_ in parts if value]
        kinds = _MOTIONS[name].split()
        if len(places) != len(kinds) or any(part == [[]] for part in parts):
            self.here = None
            self.machine.tell(words)
            return
        values = [self._value(kind, place) for kind, place in zip(kinds, places, strict=True)]
        self._settle(name, kinds, values)
        atoms: list[Atom] = [each for value in values for each in ("|", *value)]
        place = 0
        for value, *options in parts:
            # The comma before an optional argument may be left out (kernel manual, argument lists).
            place += bool(value)
            for option in options:
                units = {"wobj": "frame", "fx": "newtons", "fy": "newtons", "fz": "newtons"}.get(
                    option[0], ""
                )
                atoms += [f"\\{place}", *option[:2], *self._value(units, option[2:])]
        self._show(name, atoms)

    def _show(self, name: str, atoms: list[Atom]) -> None:
        """A motion with what holds for it: ConfJ is about MoveJ, ConfL about lines and arcs (system data types manual,
        ConfJ, ConfL); MoveAbsJ has no configuration.
        """
        machine, state = self.machine, self.machine.state
        about = {"moveabsj": "", "movej": "confj"}.get(name, "confl")
        machine.state = {
            key: value for key, value in state.items() if key == about or key not in _SUPERVISIONS
        }
        machine.move(name, *atoms)
        machine.state = state
        for words in _STATES:
            machine.outputs.pop(" ".join(words), None)

    def _settle(self, name: str, kinds: list[str], values: list[Event]) -> None:
        """What two texts may say differently: any via point of an arc, the speed of external axes that do not move, and
        that of a TCP which stays where it is, since the slowest of all that moves decides (speeddata).
        """
        poses = [k for k, kind in enumerate(kinds) if kind == "pose"]
        ends = [[each for each in values[k] if isinstance(each, Number)] for k in poses]
        points = [
            (end[0].value, end[1].value, end[2].value) if len(end) == 17 else None for end in ends
        ]
        if len(points) == 2 and self.here and points[0] and points[1]:
            turned = tuple(
                each
                for each in values[poses[0]]
                if not (isinstance(each, Number) and each.unit == "mm")
            )
            values[poses[0]] = (*arc(self.here, points[0], points[1]), *turned)
        speed = values[kinds.index("speed")]
        if ends and all(each.value == 9e9 for each in ends[-1][-6:]):
            rest = [each for each in speed[-2:] if isinstance(each, Number) and each.value > 0]
            if len(speed) >= 4 and len(rest) == 2:
                speed = values[kinds.index("speed")] = speed[:-2]
        if name == "movel" and self.here is not None and points == [self.here] and len(speed) == 2:
            tcp = speed[0]
            values[1] = speed[1:] if isinstance(tcp, Number) and tcp.value > 0 else speed
        self.here = points[-1] if points else None


def _settle_signs(atoms: list[Atom]) -> None:
    """A quaternion and its negative are one orientation: the first entry that is not 0 becomes positive."""
    turns = [k for k, each in enumerate(atoms) if isinstance(each, Number) and each.unit == "turn"]
    for first in range(0, len(turns), 4):
        group = [
            (k, each) for k in turns[first : first + 4] if isinstance(each := atoms[k], Number)
        ]
        if next((each.value for _, each in group if abs(each.value) > 1e-4), 0.0) < 0:
            for k, each in group:
                atoms[k] = Number(-each.value, "turn")


def _is_list(words: list[str]) -> bool:
    """``[a,b,...]`` as it should stand."""
    return (
        bool(re.fullmatch(r"\[ (?:-? ?[\w.]+ , )*-? ?[\w.]+ \]", " ".join(words)))
        or "[" not in words
    )
