"""The modal state of G-code: LinuxCNC, and GRBL 1.1 with its shorter list of words."""

from __future__ import annotations

import math
import re

from bench.reliability.modal.machine import Atom, Event, Machine, Number

#: Codes by modal group (LinuxCNC, G-code overview).
_GROUPS = {
    "motion": "G0 G1 G2 G3 G81 G82 G83 G80",
    "plane": "G17 G18 G19",
    "distance": "G90 G91",
    "arcs": "G90.1 G91.1",
    "feed mode": "G93 G94 G95",
    "units": "G20 G21",
    "comp": "G40",
    "length": "G43 G49",
    "return": "G98 G99",
    "work": "G54 G55 G56 G57 G58 G59 G59.1 G59.2 G59.3",
    "path": "G61 G61.1 G64",
    "spindle mode": "G97",
    "stop": "M0 M1 M2 M30 M60",
    "spindle": "M3 M4 M5",
    "mist": "M7",
    "flood": "M8",
    "coolant": "M9",
    "dwell": "G4",
    "machine": "G53",
    "change": "M6",
    "digital": "M62 M63 M64 M65",
    "analog": "M67 M68",
}
_GROUP: dict[str, str] = {}
for _name, _codes in _GROUPS.items():
    _GROUP |= dict.fromkeys(_codes.split(), _name)
_NOT_GRBL_CODES = """
    G81 G82 G83 G90.1 G95 G43 G98 G99 G59.1 G59.2 G59.3 G61.1 G64 G97 M60 M6 M62 M63 M64 M65 M67
    M68"""
_NOT_GRBL = frozenset(_NOT_GRBL_CODES.split())
_WORD = re.compile(r"([A-Z])([+-]?(?:\d+\.?\d*|\.\d+))")
_ACTIVE_COMMENT = re.compile(r"\(\s*(msg|debug|print|log|probe)", re.IGNORECASE)
_ORDER = ("plane", "units", "comp", "length", "work", "path", "distance", "arcs", "spindle mode")
#: Words that belong to the codes of a group.
_NUMBERS = {"path": "PQ", "length": "H"}
#: Largest difference of the two radii of an arc, mm: error 33 of GRBL, tolerance of LinuxCNC.
_RADII_MM = {True: 0.005, False: 0.02828}
#: Largest difference of the two radii of an arc as a fraction of the radius.
_RADII_FRACTION = 0.001
_AXES = "XYZ"


def trace(text: str, grbl: bool) -> list[Event]:
    """The trace of one program. grbl: whether GRBL runs it, not LinuxCNC."""
    controller = _Controller(grbl)
    for line in text.split("\n"):
        if controller.has_ended:
            break
        controller.read(line)
    if not controller.has_ended:
        controller.machine.add("no end")
    controller.machine.keep("S", *controller.speed)
    return controller.machine.end()


def _strip(line: str, grbl: bool) -> str | None:
    """A line without comments and blanks, in capitals.

    None if its brackets do not fit, a comment has an effect, or the controller refuses it.
    """
    kept, depth = "", 0
    if grbl and any(mark in "!~?" or ord(mark) > 126 for mark in line):
        return None
    for place, mark in enumerate(line):
        if mark == "(":
            if depth or _ACTIVE_COMMENT.match(line, place):
                return None
            depth = 1
        elif mark == ")":
            if not depth:
                return None
            depth = 0
        elif mark == ";" and not depth:
            break
        elif not depth and not mark.isspace():
            kept += mark.upper()
    is_too_long = len(line) > 252 or (grbl and len(kept) > 79)
    return None if depth or is_too_long else kept


class _Controller:
    """A three-axis machine.

    grbl: True for GRBL
    has_ended: True after M2 or M30
    position: coordinate of each axis, mm, after "w" for the work offset or "m" for the machine
        (G53); None if it is unknown
    mode: code of the motion group
    feed: F
    sticky: words that a cycle takes from the lines before it
    retract: code of the return level, which only cycles use
    speed: S
    """

    def __init__(self, grbl: bool) -> None:
        self.grbl, self.has_ended = grbl, False
        self.machine = Machine()
        self.position: dict[str, tuple[str, float] | None] = dict.fromkeys(_AXES)
        self.mode, self.feed = "", 0.0
        self.sticky: dict[str, float] = {}
        self.retract = "?"
        self.speed: Event = ("no S",)

    def read(self, line: str) -> None:
        """Runs a line. An unknown or illegal line is in the trace as it is."""
        plain = _strip(line, self.grbl)
        if plain == "":
            return
        pairs = _WORD.findall(plain or "")
        if plain is None or "".join(letter + number for letter, number in pairs) != plain:
            self.machine.add("says", line.strip())
            return
        codes = [f"{letter}{float(number) + 0.0:g}" for letter, number in pairs if letter in "GM"]
        words = {letter: float(number) for letter, number in pairs if letter not in "GM"}
        groups = [_GROUP.get(code, "") for code in codes]
        is_unique = len(set(groups)) == len(groups) and len(words) == len(pairs) - len(codes)
        is_known = "" not in groups and not (self.grbl and _NOT_GRBL.intersection(codes))
        if is_unique and is_known and self._has_legal_numbers(words):
            self._run(dict(zip(groups, codes, strict=True)), words, plain)
        else:
            self.machine.add("says", plain)

    def _has_legal_numbers(self, words: dict[str, float]) -> bool:
        """Whether the numbers of the tool and of the line are legal. Removes that of the line."""
        last = 255 if self.grbl else 99_999
        tool, number = words.get("T", 0), words.pop("N", 0)
        return 0 <= tool <= last and tool == int(tool) and 0 <= number <= 9_999_999

    def _run(self, codes: dict[str, str], words: dict[str, float], plain: str) -> None:
        """Runs the words of a line in LinuxCNC's order. A word that no code needs is refused."""
        machine = self.machine
        if "feed mode" in codes:
            machine.keep("feed mode", codes["feed mode"])
        self.feed = words.pop("F", self.feed)
        if "S" in words:
            # S has no effect on motions while the spindle stands (m-code, "M3, M4, M5").
            self.speed = ("S", Number(words.pop("S")))
        if "T" in words:
            machine.keep("T", Number(words.pop("T")))
        self._set_outputs(codes, words)
        if "change" in codes:
            machine.add("tool", *machine.state.get("T", ("none",)))
        self._switch(codes)
        if "dwell" in codes:
            machine.add("wait", Number(words.pop("P", -1.0), "s"))
        self.retract = codes.get("return", self.retract)
        for group in _ORDER:
            if group in codes:
                letters = _NUMBERS.get(group, "")
                numbers = [Number(words.pop(letter, -1.0)) for letter in letters]
                machine.keep(group, codes[group], *numbers)
        self._run_motion(codes, words)
        if words:
            machine.add("refused", plain)
        if "stop" in codes:
            machine.add("stop", codes["stop"])
            self.has_ended = codes["stop"] in ("M2", "M30")

    def _set_outputs(self, codes: dict[str, str], words: dict[str, float]) -> None:
        """Digital and analog outputs. M62 and M63 wait for the next motion."""
        if "digital" in codes:
            name = f"{words.pop('P', -1.0) + 0.0:g}"
            if codes["digital"] in ("M62", "M63"):
                name = f"next {name}"
            self.machine.switch(name, codes["digital"])
        if "analog" in codes:
            name = f"analog {words.pop('E', -1.0) + 0.0:g}"
            self.machine.switch(name, codes["analog"], Number(words.pop("Q", math.nan)))

    def _switch(self, codes: dict[str, str]) -> None:
        """Spindle and coolant."""
        before = self.machine.outputs.get("spindle", ("M5",))
        spindle = codes.get("spindle", before[0])
        if spindle != "M5":
            self.machine.switch("spindle", spindle, *self.speed)
        elif "spindle" in codes:
            self.machine.switch("spindle", "M5")
        for name in ("mist", "flood"):
            if name in codes or "coolant" in codes:
                self.machine.switch(name, "on" if name in codes else "off")

    def _run_motion(self, codes: dict[str, str], words: dict[str, float]) -> None:
        is_stated = "motion" in codes
        if is_stated and codes["motion"] != self.mode:
            self.mode, self.sticky = codes["motion"], {}
        ends = {axis: words.pop(axis) for axis in _AXES if axis in words}
        is_cycle = self.mode in ("G81", "G82", "G83")
        is_arc = self.mode in ("G2", "G3")
        if not ends and not (is_stated and (is_arc or is_cycle)):
            return
        if not ends and is_cycle:
            self.machine.add("a cycle without a place")
        elif self.mode in ("", "G80"):
            self.machine.add("axes without a motion", *map(str, ends.items()))
        elif is_cycle:
            self._run_cycle(ends, words)
        elif is_arc:
            self._run_arc(ends, words)
        else:
            self._run_line(ends, "m" if "machine" in codes else "w")

    def _find_target(
        self, ends: dict[str, float], frame: str = "w"
    ) -> dict[str, tuple[str, float] | None]:
        """The position at the end of a motion."""
        is_relative = self.machine.state.get("distance") == ("G91",) and frame == "w"
        target = dict(self.position)
        for axis, value in ends.items():
            before = self.position[axis]
            if not is_relative:
                target[axis] = (frame, value)
            elif before:
                target[axis] = (before[0], before[1] + value)
        return target

    def _describe_position(self) -> Event:
        atoms: list[Atom] = []
        for axis in _AXES:
            coordinate = self.position[axis]
            if coordinate:
                atoms += [coordinate[0], Number(coordinate[1], "mm")]
            else:
                atoms += ["?", "?"]
        return tuple(atoms)

    def _describe_feed(self) -> Number:
        return Number(self.feed / 60, "mm/s")

    def _run_line(self, ends: dict[str, float], frame: str) -> None:
        target = self._find_target(ends, frame)
        if target == self.position and all(target[axis] for axis in ends):
            return
        self.position = target
        feed: Event = ("rapid",) if self.mode == "G0" else ("feed", self._describe_feed())
        self.machine.move("line", *self._describe_position(), *feed)

    def _run_arc(self, ends: dict[str, float], words: dict[str, float]) -> None:
        """Adds an arc by its middle. One in another plane, or with R, is added by its words."""
        start, self.position = self.position, self._find_target(ends)
        x, y, u, v = start["X"], start["Y"], self.position["X"], self.position["Y"]
        state = self.machine.state
        is_level = state.get("plane") == ("G17",) and ("I" in words or "J" in words)
        if not (x and y and u and v and is_level) or state.get("arcs") == ("G90.1",):
            text, place = str(sorted(words.items())), self._describe_position()
            self.machine.move("arc", self.mode, text, *place, Number(self.feed))
            words.clear()
            return
        first, last = complex(x[1], y[1]), complex(u[1], v[1])
        centre = first + complex(words.pop("I", 0.0), words.pop("J", 0.0))
        begin, end = abs(first - centre), abs(last - centre)
        if abs(begin - end) > max(_RADII_MM[self.grbl], _RADII_FRACTION * begin):
            self.machine.add("two radii", Number(begin), Number(end))
        start_angle, end_angle = (
            math.atan2(p.imag, p.real) for p in (first - centre, last - centre)
        )
        sign = 1 if self.mode == "G3" else -1
        sweep = (sign * (end_angle - start_angle)) % math.tau
        if sweep < 1e-9:
            sweep = math.tau
        angle, radius = start_angle + sign * sweep / 2, (begin + end) / 2
        x_middle = Number(centre.real + radius * math.cos(angle), "arc")
        y_middle = Number(centre.imag + radius * math.sin(angle), "arc")
        turns, place = Number(words.pop("P", 1.0)), self._describe_position()
        feed = self._describe_feed()
        self.machine.move("arc", self.mode, x_middle, y_middle, turns, *place, feed)

    def _run_cycle(self, ends: dict[str, float], words: dict[str, float]) -> None:
        """Adds a drilling cycle with all words that it takes from the lines before it."""
        self.sticky["Z"] = ends.pop("Z", self.sticky.get("Z", math.nan))
        for letter in "RQP":
            self.sticky[letter] = words.pop(letter, self.sticky.get(letter, -1.0))
        before = self._describe_position()
        self.position = self._find_target(ends)
        place = (*self._describe_position(), *before[4:])
        sizes = [Number(self.sticky[letter], "" if letter == "P" else "mm") for letter in "ZRQP"]
        turns, feed = Number(words.pop("L", 1.0)), self._describe_feed()
        self.machine.move("cycle", self.mode, self.retract, *place, *sizes, turns, feed)
        if self.retract != "G98":
            self.position["Z"] = ("w", self.sticky["R"])
