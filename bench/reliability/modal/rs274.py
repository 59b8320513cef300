"""The modal state of G-code: LinuxCNC, and GRBL 1.1 with its shorter list of words."""

from __future__ import annotations

import math
import re

from bench.reliability.modal.machine import Atom, Event, Machine, Number

#: Codes by modal group (LinuxCNC, G-code overview); those that GRBL 1.1 takes.
_GROUPS = {
    "motion": "G0 G1 G2 G3 G81 G82 G83 G80", "plane": "G17 G18 G19", "distance": "G90 G91", "arcs": "G90.1 G91.1",
    "feed mode": "G93 G94 G95", "units": "G20 G21", "comp": "G40", "length": "G43 G49", "return": "G98 G99",
    "work": "G54 G55 G56 G57 G58 G59 G59.1 G59.2 G59.3", "path": "G61 G61.1 G64", "spindle mode": "G97",
    "stop": "M0 M1 M2 M30 M60", "spindle": "M3 M4 M5", "mist": "M7", "flood": "M8", "coolant": "M9", "dwell": "G4",
    "machine": "G53", "change": "M6", "digital": "M62 M63 M64 M65", "analog": "M67 M68",
}  # fmt: skip
_GROUP = {code: group for group, codes in _GROUPS.items() for code in codes.split()}
_NOT_GRBL = {"G81", "G82", "G83", "G90.1", "G95", "G43", "G98", "G99", "G59.1", "G59.2", "G59.3", "G61.1", "G64"} | {
    "G97", "M60", "M6", "M62", "M63", "M64", "M65", "M67", "M68",
}  # fmt: skip
_WORD = re.compile(r"([A-Z])([+-]?(?:\d+\.?\d*|\.\d+))")
_ORDER = ("plane", "units", "comp", "length", "work", "path", "distance", "arcs", "spindle mode")
#: What arcs may have between their two radii, mm: GRBL's error 33, LinuxCNC's tolerance; and of the radius.
_RADII, _OF_RADIUS = {True: 0.005, False: 0.02828}, 0.001
_AXES = "XYZ"


def trace(text: str, grbl: bool) -> list[Event]:
    """The trace of one program."""
    controller = _Controller(grbl)
    for line in text.split("\n"):
        if controller.ended:
            break
        controller.read(line)
    if not controller.ended:
        controller.machine.say("no end")
    controller.machine.hold("S", *controller.speed)
    return controller.machine.end()


def _strip(line: str, grbl: bool) -> str | None:
    """A line without comments and blanks, in capitals; None where its brackets do not fit or a comment acts."""
    kept, depth = "", 0
    if grbl and any(mark in "!~?" or ord(mark) > 126 for mark in line):
        return None
    for k, mark in enumerate(line):
        if mark == "(":
            if depth or re.match(r"\(\s*(msg|debug|print|log|probe)", line[k:], re.IGNORECASE):
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
    return None if depth or (grbl and len(kept) > 79) or len(line) > 252 else kept


class _Controller:
    """A three-axis machine. here: by axis the place in the work offset, in the machine ("m", after G53), or unknown.
    back: the return level, which counts in cycles alone.
    """

    def __init__(self, grbl: bool) -> None:
        self.grbl, self.ended = grbl, False
        self.machine = Machine()
        self.here: dict[str, tuple[str, float] | None] = dict.fromkeys(_AXES)
        self.mode, self.feed = "", 0.0
        self.sticky: dict[str, float] = {}
        self.back = "?"
        self.speed: Event = ("no S",)

    def read(self, line: str) -> None:
        """One line. What is not understood or not allowed stands in the trace as it is."""
        plain = _strip(line, self.grbl)
        if plain == "":
            return
        pairs = _WORD.findall(plain or "")
        if plain is None or "".join(letter + number for letter, number in pairs) != plain:
            self.machine.say("says", line.strip())
            return
        codes = [f"{letter}{float(number) + 0.0:g}" for letter, number in pairs if letter in "GM"]
        words = {letter: float(number) for letter, number in pairs if letter not in "GM"}
        groups = [_GROUP.get(code, "") for code in codes]
        once = len(set(groups)) == len(groups) and len(words) == len(pairs) - len(codes)
        if (
            not once
            or "" in groups
            or (self.grbl and _NOT_GRBL & set(codes))
            or not self._numbered(words)
        ):
            self.machine.say("says", plain)
            return
        self._run(dict(zip(groups, codes, strict=True)), words, plain)

    def _numbered(self, words: dict[str, float]) -> bool:
        most = 255 if self.grbl else 99_999
        tool, number = words.get("T", 0), words.pop("N", 0)
        return 0 <= tool <= most and tool == int(tool) and 0 <= number <= 9_999_999

    def _run(self, codes: dict[str, str], words: dict[str, float], plain: str) -> None:
        """The words of a line in LinuxCNC's order. Those that no code needs make the line one that is refused."""
        machine = self.machine
        if "feed mode" in codes:
            machine.hold("feed mode", codes["feed mode"])
        self.feed = words.pop("F", self.feed)
        if "S" in words:
            # A speed is that of the spindle: while this stands, no motion feels it (m-code, "M3, M4, M5").
            self.speed = ("S", Number(words.pop("S")))
        if "T" in words:
            machine.hold("T", Number(words.pop("T")))
        if "digital" in codes or "analog" in codes:
            self._output(codes.get("digital", ""), codes.get("analog", ""), words)
        if "change" in codes:
            machine.say("tool", *machine.state.get("T", ("none",)))
        self._switch(codes)
        if "dwell" in codes:
            machine.say("wait", Number(words.pop("P", -1.0), "s"))
        self._hold(codes, words)
        self._motion(codes, words)
        if words:
            machine.say("refused", plain)
        if "stop" in codes:
            machine.say("stop", codes["stop"])
            self.ended = codes["stop"] in ("M2", "M30")

    def _hold(self, codes: dict[str, str], words: dict[str, float]) -> None:
        """Settings, with the numbers that belong to them."""
        self.back = codes.get("return", self.back)
        for group in _ORDER:
            if group in codes:
                value = [
                    Number(words.pop(letter, -1.0))
                    for letter in {"path": "PQ", "length": "H"}.get(group, "")
                ]
                self.machine.hold(group, codes[group], *value)

    def _output(self, digital: str, analog: str, words: dict[str, float]) -> None:
        if digital:
            number = f"{words.pop('P', -1.0) + 0.0:g}"
            self.machine.switch(("next " if digital in ("M62", "M63") else "") + number, digital)
        if analog:
            self.machine.switch(
                f"analog {words.pop('E', -1.0) + 0.0:g}", analog, Number(words.pop("Q", math.nan))
            )

    def _switch(self, codes: dict[str, str]) -> None:
        """Spindle and coolant."""
        if "spindle" in codes:
            turning = () if codes["spindle"] == "M5" else self.speed
            self.machine.switch("spindle", codes["spindle"], *turning)
        elif self.machine.outputs.get("spindle", ("M5",))[0] != "M5":
            self.machine.switch("spindle", self.machine.outputs["spindle"][0], *self.speed)
        for name in ("mist", "flood"):
            if name in codes or "coolant" in codes:
                self.machine.switch(name, "on" if name in codes else "off")

    def _motion(self, codes: dict[str, str], words: dict[str, float]) -> None:
        if "motion" in codes and codes["motion"] != self.mode:
            self.mode, self.sticky = codes["motion"], {}
        ends = {axis: words.pop(axis) for axis in _AXES if axis in words}
        cycle = self.mode in ("G81", "G82", "G83")
        if not ends:
            if cycle and "motion" in codes:
                self.machine.say("a cycle without a place")
            elif self.mode in ("G2", "G3") and "motion" in codes:
                self._arc(ends, words)
            return
        if self.mode in ("", "G80"):
            self.machine.say("axes without a motion", *map(str, ends.items()))
        elif cycle:
            self._cycle(ends, words)
        elif self.mode in ("G2", "G3"):
            self._arc(ends, words)
        else:
            self._line(ends, "m" if "machine" in codes else "w")

    def _target(
        self, ends: dict[str, float], frame: str = "w"
    ) -> dict[str, tuple[str, float] | None]:
        """Where a motion leads."""
        target = dict(self.here)
        for axis, value in ends.items():
            before = self.here[axis]
            if self.machine.state.get("distance") == ("G91",) and frame == "w":
                target[axis] = (before[0], before[1] + value) if before else None
            else:
                target[axis] = (frame, value)
        return target

    def _place(self) -> Event:
        """Where the tool stands."""
        atoms: list[Atom] = []
        for axis in _AXES:
            at = self.here[axis]
            atoms += [at[0], Number(at[1], "mm")] if at else ["?", "?"]
        return tuple(atoms)

    def _line(self, ends: dict[str, float], frame: str) -> None:
        target = self._target(ends, frame)
        if target == self.here and all(target[axis] for axis in ends):
            return
        self.here = target
        feed: Event = ("rapid",) if self.mode == "G0" else ("feed", Number(self.feed / 60, "mm/s"))
        self.machine.move("line", *self._place(), *feed)

    def _arc(self, ends: dict[str, float], words: dict[str, float]) -> None:
        """By the point half-way, in the XY plane; with words that are kept as they are in another one or with R."""
        start, target = self.here, self._target(ends)
        known = all(side[axis] for side in (start, target) for axis in "XY")
        level = self.machine.state.get("plane") == ("G17",) and ("I" in words or "J" in words)
        if not known or not level or self.machine.state.get("arcs") == ("G90.1",):
            self.here = target
            self.machine.move(
                "arc", self.mode, str(sorted(words.items())), *self._place(), Number(self.feed)
            )
            words.clear()
            return
        (x, y), (u, v) = ([side[axis][1] for axis in "XY"] for side in (start, target))  # type: ignore[index]
        a, b = x + words.pop("I", 0.0), y + words.pop("J", 0.0)
        first, last = math.hypot(x - a, y - b), math.hypot(u - a, v - b)
        if abs(first - last) > max(_RADII[self.grbl], _OF_RADIUS * first):
            self.machine.say("two radii", Number(first), Number(last))
        begin, end, way = (
            math.atan2(y - b, x - a),
            math.atan2(v - b, u - a),
            1 if self.mode == "G3" else -1,
        )
        sweep = (way * (end - begin)) % (2 * math.pi)
        if sweep < 1e-9:
            sweep = 2 * math.pi
        angle, radius = begin + way * sweep / 2, (first + last) / 2
        middle = (
            Number(a + radius * math.cos(angle), "arc"),
            Number(b + radius * math.sin(angle), "arc"),
        )
        self.here = target
        turns = Number(words.pop("P", 1.0))
        self.machine.move(
            "arc", self.mode, *middle, turns, *self._place(), Number(self.feed / 60, "mm/s")
        )

    def _cycle(self, ends: dict[str, float], words: dict[str, float]) -> None:
        """A drilling cycle as it is, with all that it takes from the lines before it."""
        depth = ends.pop("Z", self.sticky.get("Z", math.nan))
        self.sticky["Z"] = depth
        for letter in "RQP":
            self.sticky[letter] = words.pop(letter, self.sticky.get(letter, -1.0))
        before = self._place()
        self.here = self._target(ends)
        sizes = [Number(self.sticky[letter], "" if letter == "P" else "mm") for letter in "ZRQP"]
        turns, feed = Number(words.pop("L", 1.0)), Number(self.feed / 60, "mm/s")
        self.machine.move(
            "cycle", self.mode, self.back, *self._place(), *before[4:], *sizes, turns, feed
        )
        if self.back != "G98":
            self.here["Z"] = ("w", self.sticky["R"])
