"""The machine that runs G-code: its settings, its modal state, its position and its program so far.

It runs a text of any author. What differs between third-party programs and the read-back of a
post's is a `Profile`: tables and a few functions.
"""

from __future__ import annotations

from array import array
from collections import defaultdict
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from msgspec import Struct

from camgen.lang.gcode.arcs import LINUXCNC as LINUXCNC_ARCS
from camgen.lang.gcode.arcs import Limits, Piece
from camgen.lang.gcode.beam import Beam
from camgen.lang.gcode.compensation import OffsetPath, Segment
from camgen.lang.gcode.dialects import LINUXCNC, RAPID, Dialect
from camgen.lang.gcode.rotation import Rotation
from camgen.lang.gcode.words import Line, LineError, Parameters, UnknownWord
from camgen.lang.log import Log
from camgen.lang.run import LimitReached
from camgen.model.limits import Limits as Bounds
from camgen.model.limits import format_limit
from camgen.model.pose import TOOL_DOWN, Pose, Vec3
from camgen.model.program import BodyBuilder, Instruction, MoveC, MoveJ, MoveL, Output, Stop
from camgen.model.text import short

#: Feed, mm/min, of a machine with a default feed, before the first F.
FEED = 600.0
_BOUNDS = Bounds()
AXES = "XYZ"
ARCS = ("G2", "G3")
_FULL_POWER = "M4 lowers the power with the speed on GRBL, and does not here"

#: M97, M98, M99, G65 or GOTO, the number of a program or line, the number of runs, and arguments.
Leap = tuple[str, float, int, Mapping[int, float] | None]
#: Runs a code. It is called with the machine, the code and the words, and removes what it uses.
Handler = Callable[[Any, str, dict[str, float]], None]
#: The effect of a line other than a motion: its output, whether it is a comment, None for others.
FindEffect = Callable[[str], Output | bool | None]


class Profile(Struct, frozen=True):
    """The tables and functions in which third-party programs and read-backs differ.

    All functions may raise LineError.

    handlers: function of each modal group, and of each motion other than a line, an arc or a hole.
    clean: returns the words of a line without comments and blanks, in lower case.
    parse: returns the codes by group and the words of a clean line.
    prepare_motion: is called before a motion, or before the holes of a cycle, with the code of the
        line, its words, and whether it is a cycle.
    run_without_axes: is called for a motion code without axis words.
    switch: sets an output.
    find_effect: finds the effect of a line that is not a motion, for lines that are read by column;
        None if these are motions alone.
    goes_on: whether the run goes on after a word that is not read.
    """

    handlers: Mapping[str, Handler]
    clean: Callable[[Machine, str], str]
    parse: Callable[[Machine, str, Parameters], Line]
    prepare_motion: Callable[[Machine, str, Mapping[str, float], bool], None]
    run_without_axes: Callable[[Machine, str], None]
    switch: Callable[[Machine, str, float], None]
    find_effect: FindEffect | None = None
    goes_on: bool = False


@dataclass(slots=True, kw_only=True)
class Machine:
    """The state of the machine, and the program that it has run so far.

    Lengths are mm, feeds mm/s, angles deg. Coordinates are absolute in the frame in which the
    program begins.

    Settings:

    profile: tables and functions of the run.
    dialect: the dialect of the controller.
    given: values from the user, by name.
    limits: limits of arcs.
    exact: limits of arcs in plain motions, by the digits of the program; None: `limits`.
    bounds: limits of the job.
    on_off: whether the program switches the spindle and never states a speed.
    others: letters of axes that must not move.
    max_instructions: maximum number of instructions.
    unnamed: numbers of the axes that no line of the program names.
    long_wait: s. A longer wait is probably a number of ms.

    The program so far:

    line, raw: number of the line that is read, from 1, and its text.
    body, lines: instructions so far, and the line of each.
    log: findings, assumptions, losses and facts of the run.
    chunk: lines that are read by column (`columns.Chunk`), None before the first.
    unknown_line: first line with a word that is not read, 0 without one.
    marks: number of instructions before each frame, with its tool and work offset.
    opened, ended: whether a per cent sign has come, and the end of the program.
    left_on: names of the outputs that the end of the file leaves on.
    depth: number of subroutines that run.
    run_lines: runs the steps of a profile of a lathe.
    find_lines: finds these steps by the numbers of their first and last block.
    leap: the call or the jump of the line.
    modal: macro after each motion (G66), at the depth of subprograms `modal_depth`.
    moving: whether the line moves an axis.
    cycle: group, code and words of a cycle that waits for its feed.
    first_line: words of the first line of a lathe cycle (G71).

    The position:

    at: position.
    known: whether the program has stated the position of each axis.
    has_position: whether the program has an instruction with a position.
    held: number of rapid motions before that.
    entry: feed at which an assumed start is reached, 0 without one.
    lifted: whether G53 has moved the machine.
    adrift: numbers of the axes whose position is not known from the program.
    rotary: position of the axes A, B and C, deg.
    homes: places that the program stores (G28.1), by code and axis, and values of parameters.
    output_line: line of an output that waits for the next motion in a read-back, 0 without one.

    The origin:

    shift: absolute coordinates minus those of the program.
    work, works: work offset in force, and the coordinates of each by axis, None if not
        known.
    shifted: shift of the origin by G92, None if not known.
    saved_shift: the shift that G92.3 sets.
    rotation: rotation of the coordinates (G68).

    Modes:

    unit: unit of length of the program, mm; None before G20 or G21.
    motion: the motion code in force.
    blend: 1 if corners may be rounded (G64), else 0.
    force: force of the motions at feed, N.
    to_start: whether a cycle retracts to its start (G98), None before G98 or G99.
    level, sticky: start of the cycles in a row, and their modal words.
    spun: radius and angle of the line, in polar coordinates.
    saved: modes that M70 and M73 saved.
    lathe: whether X is a diameter.
    control, order: control points of a spline (G5.2) with their weights, and its order.
    going_on: I and J of a spline (G5) that continues the last one.

    Tools and spindle:

    tool, changed_to: selected tool, and the tool of the last change.
    tools: numbers of the tools in the order of their changes.
    radii: radius of each tool in the tool table, mm.
    cut: whether a motion at feed has run.
    length, length_at_z: G43 or G49, and the one in force at the last motion of Z.
    reached: whether G43 has come, and G49 after it has no finding yet.
    side: side of the cutter compensation, 1 left, -1 right, 0 off.
    path: path of the tool beside the programmed one, None without compensation.
    left_path: whether no motion has run since G40.
    height: height of the tool beside the path, along the normal, mm.
    named: values of predefined names that lines set, and that no other field has.
    most_turns: maximum spindle speed at constant surface speed, rpm.
    halted: line of the M6 that stopped the spindle, 0 after its next start.
    beam: beam of a laser that its dialect switches off in rapid motions.
    varies_power: whether motions at feed have an S of their own, as for a laser.
    filament, at_filament: length of filament, and the value of E, mm.
    filament_adds: whether E is an increment.
    """

    profile: Profile
    dialect: Dialect = LINUXCNC
    given: Mapping[str, float] = field(default_factory=dict)
    limits: Limits = LINUXCNC_ARCS
    exact: Limits | None = None
    bounds: Bounds = _BOUNDS
    on_off: bool = False
    others: str = "ABCUVW"
    max_instructions: float = _BOUNDS.gcode_motions
    unnamed: Collection[int] = ()
    long_wait: float = 100.0

    line: int = 0
    raw: str = ""
    body: BodyBuilder = field(default_factory=BodyBuilder)
    lines: array[int] = field(default_factory=partial(array, "q"))
    log: Log = field(init=False)
    chunk: Any = None
    unknown_line: int = 0
    marks: list[tuple[int, int, str]] = field(default_factory=list)
    opened: bool = False
    ended: bool = False
    left_on: list[str] = field(default_factory=list)
    depth: int = 0
    run_lines: Callable[[range], None] = lambda _steps: None
    find_lines: Callable[[float | None, float], range] = lambda _first, _last: range(0)
    leap: Leap | None = None
    modal: Leap | None = None
    modal_depth: int = 0
    moving: bool = False
    cycle: tuple[str, str, dict[str, float]] | None = None
    first_line: dict[str, float] = field(default_factory=dict)

    at: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    known: list[bool] = field(default_factory=lambda: [False, False, False])
    has_position: bool = False
    held: int = 0
    entry: float = 0.0
    lifted: bool = False
    adrift: set[int] = field(default_factory=set)
    rotary: dict[str, float] = field(default_factory=dict)
    homes: dict[str, float] = field(default_factory=dict)
    output_line: int = 0

    shift: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    work: str = ""
    works: defaultdict[str, list[float | None]] = field(
        default_factory=lambda: defaultdict(lambda: [None, None, None])
    )
    shifted: list[float | None] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    saved_shift: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    rotation: Rotation | None = None

    unit: float | None = None
    incremental: bool = False
    absolute_centre: bool = False
    plane: str = "G17"
    motion: str = ""
    blend: float = 1.0
    force: float = 0.0
    feed_mode: str = "G94"
    feed: float = 0.0
    to_start: bool | None = None
    level: float | None = None
    sticky: dict[str, float] = field(default_factory=dict)
    spun: tuple[float, float] | None = None
    saved: list[tuple[object, ...]] = field(default_factory=list)
    lathe: bool = False
    control: list[tuple[tuple[float, float], float]] = field(default_factory=list)
    order: int = 3
    going_on: tuple[float, float] | None = None

    tool: int | None = None
    changed_to: int | None = None
    tools: list[int] = field(default_factory=list)
    radii: dict[int, float] = field(default_factory=dict)
    cut: bool = False
    length: str = "G49"
    length_at_z: str = ""
    reached: bool = False
    side: int = 0
    path: OffsetPath | None = None
    left_path: bool = False
    height: float = 0.0
    named: dict[str, float] = field(default_factory=dict)
    speed: float | None = None
    spindle: str = "M5"
    most_turns: float = 0.0
    halted: int = 0
    coolants: set[str] = field(default_factory=set)
    beam: Beam | None = None
    varies_power: bool = False
    filament: float = 0.0
    at_filament: float = 0.0
    filament_adds: bool = False

    def __post_init__(self) -> None:
        self.log = Log(lambda: self.line)

    # -- values that the text does not state ----------------------------------------------------

    def assume(self, what: str, key: str = "", value: float = 0.0, why: str = "") -> float:
        """The value that the user gives for `key`, else `value`, as an assumption."""
        taken = self.given.get(key, value)
        self.log.assume(what + (f" ({why})" if why else ""), key, taken)
        return taken

    def guess(self, what: str, key: str, value: float) -> float:
        """The value that the user gives for `key`, else `value`, as an assumption and a loss."""
        if key not in self.given:
            self.log.lose(what)
        return self.assume(what, key, value)

    def refuse(self, error: LineError) -> None:
        """Adds a wrong line as a finding. Raises the error if the run does not go on after it."""
        if isinstance(error, UnknownWord):
            if not self.profile.goes_on:
                raise error
            self.unknown_line = self.unknown_line or self.line
        self.log.find("refused", str(error))

    def assume_feed(self, code: str) -> None:
        """Sets the default feed of the machine before the first F, or adds a refusal."""
        if self.feed > 0 or self.feed_mode == "G93":
            return
        if self.dialect.name == "iso":
            self.log.find(
                "unusual", f"{code} without a feed (F), which LinuxCNC and GRBL refuse", once="feed"
            )
        if self.dialect.default_feed:
            what = "the feed before the first F is one of the machine's, mm/min"
            self.feed = self.guess(what, "feed", FEED) / 60.0
        elif any(item.key.startswith("#") for item in self.log.assumed.values()):
            what = "a feed that depends on the machine, mm/min"
            self.feed = self.guess(what, "feed", FEED) / 60.0
        else:
            self.log.find("refused", f"{code} without a feed (F)")
            self.feed = self.given.get("feed", FEED) / 60.0

    def check_size(self) -> None:
        """Raises LimitReached if the program has more instructions than the limit allows."""
        if len(self.body) >= self.max_instructions:
            limit = format_limit(self.max_instructions)
            raise LimitReached(f"more than {limit} instructions are refused (limits.gcode_motions)")

    # -- the state -----------------------------------------------------------------------------

    @property
    def scale(self) -> float:
        """Length of one unit of the program, mm; 1 before the program states it."""
        return self.unit or 1.0

    @property
    def feed_scale(self) -> float:
        """F per minute, or per turn (G95), for a feed of 1 per second or per turn."""
        if self.feed_mode == "G95":
            return 1.0
        return 60.0

    @property
    def power(self) -> float:
        """The value of the spindle's output, 1 for a program that only switches."""
        return 1.0 if self.on_off else self.speed or 0.0

    def is_settled(self) -> bool:
        """Return whether the words of a line alone determine its effect."""
        usual = (
            self.has_position
            and self.unit is not None
            and self.plane == "G17"
            and self.feed_mode == "G94"
            and self.length == self.length_at_z
        )
        return usual and not (
            self.ended
            or self.incremental
            or self.absolute_centre
            or self.sticky
            or self.output_line
            or self.beam
            or self.control
            or self.varies_power
            or self.given.get("laser")
            or self.adrift
            or self.halted
            or self.side
            or self.left_path
            or self.lathe
            or self.rotation
            or self.dialect.extruder
            or self.dialect.increments
            or (self.reached and self.length == "G49")
        )

    def position(self) -> Vec3:
        """The position as a tuple."""
        x, y, z = self.at
        return (x, y, z)

    def top(self) -> float:
        """The maximum height of the program so far, mm."""
        ends = self.body.body().packed.end
        return max(float(np.nanmax(ends[:, 2])) if len(ends) else self.at[2], self.at[2])

    def turned(self, point: list[float], back: bool = False) -> list[float]:
        """A point in machine coordinates from coordinates that G68 turns. It may change the list.

        back: whether the point is in machine coordinates, and is wanted in turned ones.
        """
        return point if self.rotation is None else self.rotation.turn(point, back)

    # -- instructions --------------------------------------------------------------------------

    def add(self, item: Instruction) -> None:
        """Adds an instruction, after the motion of the compensation that waits for its corner."""
        if self.beam is not None:
            self._write_beam(self.beam.before(item, self.power, self.spindle, self.motion))
        if self.path is not None and self.path.last is not None:
            self.path.pending.append((item, self.line))
            return
        self.check_size()
        self.body.append(item)
        self.lines.append(self.line)

    def start(self) -> None:
        """Prepares a motion at feed: an axis without a position is assumed to be at 0."""
        if self.has_position:
            return
        unknown = [name for name, known in zip(AXES, self.known, strict=True) if not known]
        if unknown:
            names = " ".join(name + "0" for name in unknown)
            self.assume(f"the program begins at {names}", why="it does not say where")
            self.entry = self.feed or RAPID
        self.known[:] = [True, True, True]
        self.has_position = True
        self.add(MoveJ(Pose(TOOL_DOWN, self.position()), RAPID))

    def rapid(self, end: Sequence[float], axes: Sequence[int] = ()) -> None:
        """Adds a rapid motion if the position of all axes is known; on a printer one at the feed.

        axes: numbers of the axes of the line. Their positions are known after it.
        """
        if self.path is not None:
            start = self.position()
            self.at[:] = end
            self.follow(start, self.position(), None)
            return
        if self.dialect.extruder and self.feed > 0 and self.has_position:
            self.at[:] = end
            self.add(MoveL(Pose(TOOL_DOWN, self.position()), self.feed))
            return
        self._check_beam()
        for axis in () if self.has_position else self.unnamed:
            # The whole program runs at one place of this axis.
            if not self.known[axis]:
                self.known[axis] = True
                self.assume(f"the program begins at {AXES[axis]}0", why="it does not say where")
                if axis == 2:
                    self.entry = RAPID
        if not self.has_position:
            self._find_unshown(end)
        self.at[:] = end
        for axis in axes:
            self.known[axis] = True
        if self.has_position or all(self.known):
            self.has_position = True
            self.add(MoveJ(Pose(TOOL_DOWN, self.position()), RAPID))
        else:
            self.held += 1

    def move_rapidly(self, end: Vec3) -> None:
        """Adds a rapid motion of all axes unless the tool is at `end`."""
        if list(end) != self.at:
            self.rapid(end, (0, 1, 2))

    def _find_unshown(self, end: Sequence[float]) -> None:
        """Adds a finding for a rapid motion from a place that is not known in all axes.

        The program shows the first place that is known in all axes, so that the start of this
        motion is in no motion and in no extents.
        """
        known = [k for k in range(3) if self.known[k]]
        if len(known) == 3 or all(end[k] == self.at[k] for k in known):
            return
        start, stop = self._format_place(self.at, known), self._format_place(end, known)
        unknown = " and ".join(AXES[k] for k in range(3) if k not in known)
        is_or_are = "is" if len(known) == 2 else "are"
        what = f"a rapid motion from {start} to {stop} while {unknown} {is_or_are} not known"
        self.log.find("unusual", f"{what}: motions and extents do not show {start}")

    def _format_place(self, place: Sequence[float], axes: Sequence[int]) -> str:
        """Some coordinates of a place in those of the program, such as "X5 Y0"."""
        words = [f"{AXES[k]}{short((place[k] - self.shift[k]) / self.scale, 4)}" for k in axes]
        return " ".join(words)

    def _check_beam(self) -> None:
        if self.beam is not None or self.spindle == "M5" or not (self.on_off or self.speed):
            return
        if self.given.get("laser"):
            what = (
                "moves at rapid with the beam on; GRBL in laser mode switches it off there "
                '(input.dialect = "grbl")'
            )
            self.log.find("dangerous", what, once="beam")
        elif self.varies_power:
            self.assume(
                "the output of S stays on in rapid motions; GRBL in laser mode switches it off",
                "laser",
                why="$32=1 or a tool of kind laser says so",
            )

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

    def follow(
        self, start: Vec3, end: Vec3, speed: float | None, centre: tuple[float, ...] = ()
    ) -> None:
        """Adds a motion beside which the tool runs.

        centre: centre of an arc in its plane, empty for a line.
        """
        assert self.path is not None
        first, second, normal = self.path.axes
        turn = 1 if self.motion == "G3" else -1
        middle = complex(*centre) if centre else None
        a, b = complex(start[first], start[second]), complex(end[first], end[second])
        self.path.move(Segment(a, b, middle, turn, end[normal], speed, self.line))

    def switch(self, signal: str, value: float) -> None:
        """Sets an output. Raises LineError."""
        self.profile.switch(self, signal, value)

    def update_spindle(self) -> None:
        """Switches the spindle, or the beam of a laser, to its modal state."""
        if self.beam is not None:
            if self.spindle == "M4":
                self.assume(_FULL_POWER, why="its output has the power of S")
            self._write_beam(self.beam.at_rest(self.power, self.spindle, self.motion))
        elif self.on_off:
            self.switch("process", float(self.spindle != "M5"))
        elif self.spindle == "M4" and self.given.get("laser"):
            self.switch("spindle", self.power)
        else:
            sign = {"M3": 1.0, "M4": -1.0, "M5": 0.0}[self.spindle]
            self.switch("spindle", sign * (self.speed or 0.0))

    def _write_beam(self, output: Output | None) -> None:
        if output is not None:
            self.add(output)

    def stop(self, code: str) -> None:
        """Adds the stop of M0, M60 and M1, or ends the program."""
        if code in ("M0", "M1", "M60"):
            self.add(Stop(optional=code == "M1"))
        else:
            self.ended = True

    def finish(self) -> None:
        """Switches spindle and coolant off at the end of a program (LinuxCNC manual, M2).

        Without M2 or M30 they are named as left on.
        """
        if self.path is not None:
            self.path.flush()
        if not self.ended:
            on = [] if self.spindle == "M5" else ["the spindle"]
            self.left_on[:] = on + ["a coolant"] * bool(self.coolants)
        if self.spindle != "M5":
            self.spindle = "M5"
            self.update_spindle()
        for code in sorted(self.coolants):
            self.switch(COOLANTS[code], 0.0)


COOLANTS = {"M7": "mist", "M8": "flood"}


def take_axes(m: Machine, words: dict[str, float]) -> dict[int, float]:
    """Removes the axis words of a line. Returns their values by axis, mm."""
    return {k: words.pop(name) * m.scale for k, name in enumerate(AXES) if name in words}
