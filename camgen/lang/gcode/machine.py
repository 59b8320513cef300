"""The state of a machine that runs G-code, and the effect of each code that is not a motion."""

from __future__ import annotations

import re
from array import array
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from msgspec import Struct

from camgen.lang.gcode.arcs import LINUXCNC, Limits, Piece
from camgen.lang.gcode.words import (
    Line,
    LineError,
    Parameters,
    tell_unread,
    words_of,
)
from camgen.lang.log import Log
from camgen.lang.run import Stopped
from camgen.model.limits import Limits as Bounds
from camgen.model.limits import tell
from camgen.model.part import NoteKind
from camgen.model.pose import TOOL_DOWN, Pose, Vec3
from camgen.model.program import Instruction, MoveC, MoveJ, MoveL, Output, Packing, Stop, Wait

#: Speed of G0, mm/s. No text states it, and a motion needs a positive speed.
RAPID = 100.0
_BOUNDS = Bounds()
AXES = "XYZ"
ARCS = ("G2", "G3")

_NUMBER = r"[ \t]*([+-]?(?:[0-9]{1,6}(?:\.[0-9]{0,12})?|\.[0-9]{1,12}))[ \t]*"
#: One motion without parameters: the digit of G0 to G3, then X Y Z I J F.
PLAIN = re.compile(
    r"[ \t]*(?:[nN][0-9]{1,9}[ \t]*)?(?:[gG]0?([0-3])[ \t]*(?![0-9.]))?"
    + "".join(f"(?:[{letter}{letter.lower()}]{_NUMBER})?" for letter in "XYZIJF")
    + r"(?:\([^(),]*\)[ \t]*|;[^,]*)?\r?"  # a comment with a comma may be one that LinuxCNC acts on
)


#: M97, M98, M99, G65 or GOTO, the number of a program or line, the number of runs, and arguments.
Leap = tuple[str, float, int, Mapping[int, float] | None]
#: Runs a code other than a motion. It is called with the machine, the code and the words.
Handler = Callable[[Any, str, dict[str, float]], None]
#: Reads plain lines, as `motion.read_plain`.
PlainReader = Callable[["Machine", Sequence[str], int, int], int]


class Grammar(Struct, frozen=True):
    """The words that change the flow.

    o_words: whether O-words do, as in LinuxCNC. Else they are numbers of programs.
    numbers: whether an O-word may be the number of a program.
    macros: whether macros of Fanuc do.
    nested: whether comments may nest.
    """

    o_words: bool = True
    numbers: bool = True
    macros: bool = False
    nested: bool = False


@dataclass(slots=True)
class Machine:
    """The state of the machine, and the program that it has run so far.

    Lengths are mm, feeds mm/s, angles deg. Coordinates are absolute in the frame in which the
    program begins. `Foreign` runs programs of any author, `Strict` those of a post.

    limits: limits of arcs.
    bounds: limits of the job.
    on_off: whether the program switches the spindle and never states a speed.
    others: letters of axes that must not move.
    plain: pattern of a line that `motion.read_plain` reads.
    most: maximum number of instructions.
    line: number of the line that is read, from 1.
    body, lines: instructions so far, and the line of each.
    at: position.
    known: whether the program has stated the position of each axis.
    has_position: whether the program has an instruction with a position.
    held: number of rapid motions before that.
    entry: feed at which an assumed start is reached, 0 without one.
    shift: absolute coordinates minus those of the program.
    unit: unit of length of the program, mm; None before G20 or G21.
    blend: 1 if corners may be rounded (G64), else 0.
    force: force of the motions at feed, N.
    cut: whether a motion at feed has run.
    length, length_at_z: G43 or G49, and the one in force at the first motion of Z.
    work, works: work offset in force, and the coordinates of each, None if not known.
    shifted: shift of the origin by G92, None if not known.
    to_start: whether a cycle retracts to its start (G98), None before G98 or G99.
    level, sticky: start of the cycles in a row, and their modal words.
    opened: whether a per cent sign has come.
    lifted: whether G53 has moved the machine.
    leap: the call or the jump of the line.
    inside: returns the number of subroutines that run.
    run_lines: runs the steps of a profile.
    find_lines: finds these steps by the numbers of their first and last block.
    spun: radius and angle of the line, in polar coordinates.
    pause: seconds in a dwell of P1.
    fewest_holes: number of holes of a line without L.
    handlers: handlers of the codes, by modal group.
    log: findings, assumptions, losses and facts of the run.
    exact: limits of arcs in plain motions, by the digits of the program; None: `limits`.
    """

    limits: Limits = LINUXCNC
    bounds: Bounds = _BOUNDS
    on_off: bool = False
    others: str = "ABCUVW"
    plain: re.Pattern[str] = PLAIN
    most: float = _BOUNDS.gcode_motions
    line: int = 0
    body: Packing = field(default_factory=Packing)
    lines: array[int] = field(default_factory=partial(array, "q"))
    at: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    known: list[bool] = field(default_factory=lambda: [False, False, False])
    has_position: bool = False
    held: int = 0
    entry: float = 0.0
    shift: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    unit: float | None = None
    incremental: bool = False
    absolute_centre: bool = False
    plane: str = "G17"
    motion: str = ""
    blend: float = 1.0
    force: float = 0.0
    feed_mode: str = "G94"
    feed: float = 0.0
    speed: float | None = None
    spindle: str = "M5"
    coolants: set[str] = field(default_factory=set)
    tool: int | None = None
    changed_to: int | None = None
    cut: bool = False
    length: str = "G49"
    length_at_z: str = ""
    work: str = ""
    works: dict[str, list[float | None]] = field(default_factory=dict)
    shifted: list[float | None] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    to_start: bool | None = None
    level: float | None = None
    sticky: dict[str, float] = field(default_factory=dict)
    opened: bool = False
    ended: bool = False
    lifted: bool = False
    leap: Leap | None = None
    inside: Callable[[], int] = lambda: 0
    run_lines: Callable[[range], None] = lambda _steps: None
    find_lines: Callable[[float | None, float], range] = lambda _first, _last: range(0)
    spun: tuple[float, float] | None = None
    pause: float = 1.0
    fewest_holes: int = 1
    exact: Limits | None = None
    handlers: Mapping[str, Handler] = field(default_factory=dict)
    log: Log = field(init=False)

    def __post_init__(self) -> None:
        self.log = Log(lambda: self.line)

    def bare(self, raw: str) -> str:
        """The words of a line, without comments and blanks, in lower case. Raises LineError."""
        raise NotImplementedError

    def words(self, text: str, known: Parameters) -> Line:
        """The codes by group and the words of a bare line. Raises LineError."""
        return words_of(text, known, self.group)

    def group(self, code: str) -> str:
        """The modal group of a code. Raises LineError."""
        raise NotImplementedError

    def take(self, codes: Mapping[str, str], words: Mapping[str, float]) -> None:
        """Examines the words of a line before they act. Raises LineError."""

    def begin(self, codes: dict[str, str], words: dict[str, float]) -> None:
        """Removes the words of a line that belong to no modal group. Raises LineError."""

    def end(self, codes: Mapping[str, str], words: dict[str, float]) -> None:
        """Is called after all codes of a line. Raises LineError."""

    def turn_axes(self, words: dict[str, float], code: str) -> None:  # noqa: ARG002 (for overrides)
        """Removes the words of axes other than X, Y and Z. Raises LineError."""
        for letter in self.others:
            if words.pop(letter, 0.0):
                raise LineError(f"axis {letter} moves: only X, Y and Z are replayed")

    def trace(self, code: str, words: dict[str, float]) -> bool:  # noqa: ARG002 (for overrides)
        """Runs a motion other than a line, an arc or a hole.

        Returns whether `code` is such a motion. Raises LineError.
        """
        return False

    def lift(self, motion: str, words: dict[str, float]) -> None:
        """G53. Raises LineError."""
        lift(self, motion, words)

    def stop(self, code: str) -> None:
        """Adds the stop of M0, M60 and M1, or ends the program."""
        if code in ("M0", "M1", "M60"):
            self.add(Stop(optional=code == "M1"))
        else:
            self.ended = True

    def set_feed(self, words: dict[str, float], codes: dict[str, str]) -> None:
        """Sets feed mode and feed. Raises LineError."""
        feed(self, words, codes)

    def insist_on_feed(self, code: str) -> None:
        """Raises LineError for a motion at feed without a feed."""
        if self.feed <= 0:
            raise LineError(f"{code} without a feed (F)")

    def read_plain(self, lines: Sequence[str], at: int, bound: int, plain: PlainReader) -> int:
        """Reads lines from index `at` on, up to a line that is not plain, or to `bound`.

        Returns the index of that line.

        plain: reads them line by line.
        """
        return plain(self, lines, at, bound)

    def is_remark(self, raw: str) -> bool:  # noqa: ARG002 (for overrides)
        """Return whether a line is certainly a comment without effect."""
        return False

    def obey(self, group: str, code: str, words: dict[str, float]) -> None:
        """Runs a code other than a motion, and removes the words that it uses. Raises LineError."""
        self.handlers[group](self, code, words)

    def refuse(self, error: LineError) -> None:
        """Is called for a wrong line. It raises the error if the run stops."""
        raise NotImplementedError

    def without_mode(self) -> None:
        """Is called for axis words without a modal motion code. Raises LineError."""
        raise LineError("axis words without a motion code (G0, G1, G2, G3)")

    def centre(self, absolute: Callable[[], list[Piece]], error: LineError) -> list[Piece]:  # noqa: ARG002
        """The pieces of an arc whose centre is wrong. Raises LineError.

        absolute: returns the pieces for a centre in absolute coordinates.
        """
        raise error

    def stands(self, what: str) -> None:
        """Is called for a motion that needs another spindle state. Raises LineError."""
        raise LineError(what)

    def turned(self, point: list[float], back: bool = False) -> list[float]:  # noqa: ARG002 (for overrides)
        """A point in machine coordinates from program coordinates. It may change the list.

        back: whether the point is in machine coordinates, and is wanted in program coordinates.
        """
        return point

    def turn_centre(self, words: dict[str, float]) -> None:
        """Turns the words of the centre of an arc, mm, into machine coordinates."""

    def beside(self, start: Vec3, end: Vec3, words: dict[str, float]) -> tuple[float, ...]:  # noqa: ARG002
        """The centre of an arc beside which the tool runs, any value for a line.

        Empty if the tool runs on the path.
        """
        return ()

    def follow(
        self, start: Vec3, end: Vec3, speed: float | None, centre: tuple[float, ...] = ()
    ) -> None:
        """Adds a motion beside which the tool runs.

        centre: centre of an arc in its plane.
        """

    def miss(self, what: str) -> None:
        """Is called for a subroutine that is in no file. Raises LineError."""
        raise LineError(what)

    def takes(self, key: int) -> bool:  # noqa: ARG002 (for overrides)
        """Return whether a line may set this parameter of the machine."""
        return False

    def is_settled(self) -> bool:
        """Return whether the words of a line alone determine its effect."""
        usual = (
            self.has_position
            and self.unit is not None
            and self.plane == "G17"
            and self.feed_mode == "G94"
        )
        unusual = self.ended or self.incremental or self.absolute_centre or self.sticky
        return usual and not unusual and self.length == self.length_at_z

    @property
    def scale(self) -> float:
        """Length of one unit of the program, mm; 1 before the program states it."""
        return 1.0 if self.unit is None else self.unit

    def add(self, item: Instruction) -> None:
        """Adds an instruction of the line that is read."""
        self.insist_on_size()
        self.body.append(item)
        self.lines.append(self.line)

    def insist_on_size(self) -> None:
        """Raises Stopped if the program has more instructions than the limit allows."""
        if len(self.body) >= self.most:
            raise Stopped(
                f"more than {tell(self.most)} instructions are refused (limits.gcode_motions)"
            )

    def note(self, kind: NoteKind, what: str, why: str = "") -> None:
        """Adds a note to the log, with its reason."""
        raise NotImplementedError

    def rapid(self, end: Sequence[float], axes: Sequence[int] = ()) -> None:
        """Adds a rapid motion, once the position of all axes is known.

        axes: axes of the line. Their position is known from now on.
        """
        self.at[:] = end
        for axis in axes:
            self.known[axis] = True
        if self.has_position or all(self.known):
            self.has_position = True
            self.add(MoveJ(Pose(TOOL_DOWN, self.here()), RAPID))
        else:
            self.held += 1

    def start(self) -> None:
        """Is called before a motion at feed: the program begins at 0 in each axis without a position."""
        if self.has_position:
            return
        unknown = [name for name, known in zip(AXES, self.known, strict=True) if not known]
        if unknown:
            self.note(
                "assumed",
                f"the program begins at {' '.join(name + '0' for name in unknown)}",
                "it does not say where",
            )
            self.entry = self.feed or RAPID
        self.known[:] = [True, True, True]
        self.has_position = True
        self.add(MoveJ(Pose(TOOL_DOWN, self.here()), RAPID))

    def here(self) -> Vec3:
        """The position as a tuple."""
        x, y, z = self.at
        return (x, y, z)

    def pieces(self, pieces: Sequence[Piece], speed: float) -> None:
        """Adds lines and arcs at `speed`, mm/s."""
        self.cut = True
        for via, end in pieces:
            pose = Pose(TOOL_DOWN, end)
            if via is None:
                self.add(MoveL(pose, speed, self.blend, self.force))
            else:
                self.add(MoveC(Pose(TOOL_DOWN, via), pose, speed, self.blend, self.force))
        self.at[:] = pieces[-1][1]

    def switch(self, signal: str, value: float) -> None:
        """Sets an output."""
        self.add(Output(signal, value))

    def turn(self) -> None:
        """Switches the spindle to its modal state."""
        if self.on_off:
            self.switch("process", float(self.spindle != "M5"))
        else:
            speed = self.speed or 0.0
            self.switch("spindle", {"M3": speed, "M4": -speed, "M5": 0.0}[self.spindle])

    def settle(self, code: str, words: Mapping[str, float], cycle: bool) -> None:  # noqa: ARG002 (for overrides)
        """Is called before a motion, or before the holes of a cycle. Raises LineError.

        code: code of the line.
        """
        if self.unit is None:
            self.unit = 1.0
            self.note(
                "assumed", "lengths are mm", "neither G20 nor G21 stands before the first motion"
            )
        if not cycle and "Z" not in words:
            return
        if not self.length_at_z:
            self.length_at_z = self.length
        elif self.length != self.length_at_z:
            why = "it shifts z by the length of the tool, which is not known here"
            raise LineError(f"a motion of Z after {self.length}: {why}")

    def stand(self, code: str) -> None:
        """Is called for a motion code without axis words. Raises LineError."""
        if code in ARCS:
            raise LineError(f"{code} without an end point or centre")
        # LinuxCNC moves to the place where the tool stands.
        self.held += code in ("G0", "G1") and not self.has_position

    def value(self, name: str) -> float | None:
        """The value of a parameter of the machine by number or name, None if it is not known."""
        tell = _VALUES.get(name)
        axis = _POSITIONS.get(name)
        if axis is not None and self.known[axis]:
            return (self.at[axis] - self.shift[axis]) / self.scale
        return None if tell is None else tell(self)


_POSITIONS = {"5420": 0, "5421": 1, "5422": 2, "_x": 0, "_y": 1, "_z": 2}
_VALUES: dict[str, Callable[[Machine], float]] = {
    "_metric": lambda m: float(m.scale == 1.0),
    "_imperial": lambda m: float(m.scale != 1.0),
    "_absolute": lambda m: float(not m.incremental),
    "_incremental": lambda m: float(m.incremental),
    "_inverse_time": lambda m: float(m.feed_mode == "G93"),
    "_units_per_minute": lambda m: float(m.feed_mode == "G94"),
    "_units_per_rev": lambda m: float(m.feed_mode == "G95"),
    "_feed": lambda m: m.feed * 60.0 / m.scale,
    "_rpm": lambda m: m.speed or 0.0,
    "_line": lambda m: float(m.line),
    "_spindle_on": lambda m: float(m.spindle != "M5"),
    "_spindle_cw": lambda m: float(m.spindle == "M3"),
}


# The origin: work offsets, G92 and G10, as far as the program determines them.

_WORKS = ("G54", "G55", "G56", "G57", "G58", "G59", "G59.1", "G59.2", "G59.3")


def work_offset(m: Machine, code: str, words: dict[str, float]) -> None:  # noqa: ARG001 (as all handlers)
    """G54 to G59.3."""
    before, m.work = m.work or "G54", code
    if code == before or not any(m.known):
        return
    old, new = _table(m, before), _table(m, code)
    for axis in range(3):
        a, b = old[axis], new[axis]
        if m.known[axis] and (a is None or b is None):
            raise LineError(
                f"{code} after motions in {before}: how far apart they are is known to the machine alone"
            )
        m.shift[axis] += (b or 0.0) - (a or 0.0)


def _table(m: Machine, code: str) -> list[float | None]:
    return m.works.setdefault(code, [None, None, None])


def take_axes(m: Machine, words: dict[str, float]) -> dict[int, float]:
    """Removes the axis words of a line. Returns their values by axis, mm."""
    return {k: words.pop(name) * m.scale for k, name in enumerate(AXES) if name in words}


def set_offsets(m: Machine, code: str, words: dict[str, float]) -> None:
    """G10 L2 and L20, G92, G92.1 and G92.2."""
    if code in ("G92.1", "G92.2"):
        _cancel(m, code)
        return
    if code == "G92":
        axes = take_axes(m, words)
        if not axes:
            raise LineError("G92 without an axis")
        for axis, value in axes.items():
            moved = _read_as(m, axis, value)
            total = m.shifted[axis]
            m.shifted[axis] = None if moved is None or total is None else total + moved
        return
    kind, number = words.pop("L", 0.0), words.pop("P", -1.0)
    if kind not in (2.0, 20.0):
        raise LineError(f"G10 L{kind:g} changes the tool table, which is not known here")
    if "R" in words:
        raise LineError("G10 with R turns the work offset")
    if number not in range(10):
        raise LineError(f"G10 P{number:g} is no work offset")
    target = _WORKS[int(number) - 1] if number else (m.work or "G54")
    for axis, value in take_axes(m, words).items():
        _set(m, kind == 20.0, target, axis, value)


def _set(m: Machine, by_position: bool, target: str, axis: int, value: float) -> None:
    table, active = _table(m, target), target == (m.work or "G54")
    if by_position:
        if not active:
            raise LineError("G10 L20 of a work offset that is not the one in use")
        moved, old = _read_as(m, axis, value), table[axis]
        table[axis] = None if moved is None or old is None else old + moved
        return
    old, table[axis] = table[axis], value
    if not active or not m.known[axis]:
        return
    if old is None:
        raise LineError(
            f"G10 L2 moves {target} after a motion in it: where it was is known to the machine alone"
        )
    m.shift[axis] += value - old


def _read_as(m: Machine, axis: int, value: float) -> float | None:
    """Shifts the origin so that an axis stands at `value`, mm.

    Returns the shift, None if the position was not known.
    """
    if not m.known[axis]:
        m.known[axis] = True
        m.at[axis] = value + m.shift[axis]
        m.note(
            "assumed",
            f"the tool stands at {AXES[axis]}{value:g} mm of the work frame",
            "the line says so",
        )
        return None
    moved = m.at[axis] - value - m.shift[axis]
    m.shift[axis] += moved
    return moved


def _cancel(m: Machine, code: str) -> None:
    for axis, by in enumerate(m.shifted):
        if by is None:
            raise LineError(f"{code} after a G92 at a position that the program does not say")
        m.shift[axis] -= by
    m.shifted[:] = [0.0, 0.0, 0.0]


_INCH = 25.4


def feed(m: Machine, words: dict[str, float], codes: dict[str, str]) -> None:
    """Sets feed mode and feed: G93, G94, G95 and F.

    F has the unit in force before the line. It is per minute in G93, and per turn in G95. A change
    of the mode clears the feed. With G93 the word stays: each motion at feed needs its own.
    """
    mode = codes.get("feed mode", m.feed_mode)
    if mode != m.feed_mode:
        m.feed_mode, m.feed = mode, 0.0
    if "F" not in words:
        return
    value = words["F"] if mode == "G93" else words.pop("F")
    if value < 0:
        raise LineError(f"feed F{value:g} is negative")
    if codes.get("units") == ("G20" if m.scale == 1.0 else "G21") and mode != "G93":
        raise LineError(
            "F in the line that changes the unit: controllers differ in which unit it has"
        )
    if mode == "G93":
        m.feed = value / 60.0
    elif mode == "G95":
        m.feed = value * m.scale
    else:
        m.feed = value * m.scale / 60.0


def speed_and_tool(m: Machine, words: dict[str, float], codes: dict[str, str]) -> None:
    """S and T. S without a code changes the speed of a spindle that turns."""
    if "T" in words:
        number = words.pop("T")
        if number < 0 or number != int(number):
            raise LineError(f"T{number:g} is no tool")
        m.tool = int(number)
    if "S" in words:
        value = words.pop("S")
        if value < 0:
            raise LineError(f"spindle speed S{value:g} is negative")
        m.speed = value
        if m.spindle != "M5" and "spindle" not in codes:
            m.turn()


def _nothing(m: Machine, code: str, words: dict[str, float]) -> None:
    """A code without an effect on motions."""


def lift(m: Machine, motion: str, words: dict[str, float]) -> None:
    """G53 G0 Z0 before any other motion: to the top of the machine. The height is not known then.

    LinuxCNC refuses G53 with increments.
    """
    if m.incremental:
        raise LineError("G53 among increments (G91)")
    if (
        m.has_position
        or motion != "G0"
        or any(axis in words for axis in "XY")
        or words.pop("Z", 1.0) != 0
    ):
        raise LineError(tell_unread("G53", "not known"))
    m.lifted, m.known[2], m.at[2] = True, False, 0.0


def _outputs(m: Machine, code: str, words: dict[str, float]) -> None:
    """M62 to M65 digital, M67 and M68 analog, before the next motion."""
    analog = code in ("M67", "M68")
    index = words.pop("E" if analog else "P", -1.0)
    if index < 0 or index != int(index):
        raise LineError(f"{code} without the number of its output")
    if not analog:
        m.switch(f"dout{int(index)}", 1.0 if code in ("M62", "M64") else 0.0)
    elif "Q" not in words:
        raise LineError(f"{code} without its value (Q)")
    else:
        m.switch(f"aout{int(index)}", words.pop("Q"))


def _spindle(m: Machine, code: str, words: dict[str, float]) -> None:  # noqa: ARG001
    m.spindle = code
    if m.on_off:
        m.note(
            "assumed",
            "the spindle is the signal process",
            "the program switches it and never says a speed",
        )
    m.turn()


_COOLANTS = {"M7": "mist", "M8": "flood"}


def _coolant(m: Machine, code: str, words: dict[str, float]) -> None:  # noqa: ARG001
    if code != "M9":
        m.coolants.add(code)
        m.switch(_COOLANTS[code], 1.0)
        return
    if not m.coolants:
        m.note("assumed", "M9 switches nothing off", "no coolant is on")
    for word in sorted(m.coolants):
        m.switch(_COOLANTS[word], 0.0)
    m.coolants.clear()


def _dwell(m: Machine, code: str, words: dict[str, float]) -> None:  # noqa: ARG001
    seconds = words.pop("P", -1.0)
    if seconds < 0:
        raise LineError("G4 without its seconds (P)")
    if seconds >= 100:
        m.note(
            "warning",
            f"G4 P{seconds:g} waits for {seconds:g} s",
            "some controllers mean ms; these are seconds",
        )
    m.add(Wait(seconds))


def _override(m: Machine, code: str, words: dict[str, float]) -> None:  # noqa: ARG001
    if code == "M49":
        m.note("skipped", "M49 locks the overrides", "a robot program has no word for it")


def _units(m: Machine, code: str, words: dict[str, float]) -> None:  # noqa: ARG001
    m.unit = _INCH if code == "G20" else 1.0


def _plane(m: Machine, code: str, words: dict[str, float]) -> None:  # noqa: ARG001
    m.plane = code


def _path(m: Machine, code: str, words: dict[str, float]) -> None:
    m.blend = 1.0 if code == "G64" else 0.0
    if code == "G64":
        words.pop("P", None)
        words.pop("Q", None)


def _distance(m: Machine, code: str, words: dict[str, float]) -> None:  # noqa: ARG001
    m.incremental = code == "G91"


def _centres(m: Machine, code: str, words: dict[str, float]) -> None:  # noqa: ARG001
    m.absolute_centre = code == "G90.1"


def _cycle_off(m: Machine, code: str, words: dict[str, float]) -> None:  # noqa: ARG001
    """G80: no motion code is in force."""
    m.motion, m.level = "", None
    m.sticky.clear()


def _level(m: Machine, code: str, words: dict[str, float]) -> None:  # noqa: ARG001
    m.to_start = code == "G98"


def switch_off(m: Machine) -> None:
    """Switches spindle and coolant off at the end of a program (LinuxCNC manual, M2)."""
    if m.spindle != "M5":
        m.spindle = "M5"
        m.turn()
    for word in sorted(m.coolants):
        m.switch(_COOLANTS[word], 0.0)


#: The function of each modal group, in the order in which the groups act. A tool change and the
#: length of a tool differ between programs of a post and others.
HANDLERS: dict[str, Callable[[Machine, str, dict[str, float]], None]] = {
    "outputs": _outputs,
    "tool change": _nothing,
    "spindle": _spindle,
    "mist": _coolant,
    "flood": _coolant,
    "coolant off": _coolant,
    "override": _override,
    "dwell": _dwell,
    "state": _nothing,
    "spindle mode": _nothing,
    "plane": _plane,
    "units": _units,
    "cutter compensation": _nothing,
    "lathe radius": _nothing,
    "length offset": _nothing,
    "work offset": work_offset,
    "path": _path,
    "distance": _distance,
    "arc distance": _centres,
    "return level": _level,
    "cycle off": _cycle_off,
    "offsets": set_offsets,
}
