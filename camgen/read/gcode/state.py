"""What a G-code program has set so far, and what it has done: the machine that the interpreter plays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from camgen.model.part import Note, NoteKind
from camgen.model.pose import TOOL_DOWN, Pose, Vec3
from camgen.model.program import Instruction, MoveC, MoveJ, MoveL, Output, Wait
from camgen.read.gcode.arcs import LINUXCNC, Limits, Piece
from camgen.read.gcode.words import Wrong

#: G0 runs at the machine's own speed, which no text tells; an instruction needs a positive one, mm/s.
RAPID = 100.0
#: More instructions are not meant.
_MOST = 3_000_000
AXES = "XYZ"


@dataclass(slots=True)
class Machine:
    """Lengths mm, feeds mm/s, absolute coordinates: those of the frame in which the program begins.

    limits: of arcs. on_off: the spindle is switched without ever a speed. line:
    1-based, the one that is read. at: the position; known: of which axes the program has said it. begun: a position has
    been written down. held: rapid motions before that. entry: the feed at which an assumed start is reached, 0: none.
    shift: absolute = program + shift. unit: mm, None: not said. blend: 1 where corners may be rounded (G64), else 0.
    length, length_at_z: G43 or G49, and the one that held at the first motion of Z. to_start: whether a cycle retracts
    to where it began (G98). level, sticky: where the cycles in a row began, and their words that hold on.
    """

    limits: Limits = LINUXCNC
    on_off: bool = False
    line: int = 0
    body: list[Instruction] = field(default_factory=list)
    lines: list[int] = field(default_factory=list)
    remarks: dict[tuple[NoteKind, str, str], int] = field(default_factory=dict)
    at: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    known: list[bool] = field(default_factory=lambda: [False, False, False])
    begun: bool = False
    held: int = 0
    entry: float = 0.0
    shift: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    unit: float | None = None
    incremental: bool = False
    absolute_centre: bool = False
    plane: str = "G17"
    motion: str = ""
    blend: float = 1.0
    feed_mode: str = "G94"
    feed: float = 0.0
    speed: float = 0.0
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
    ended: bool = False

    @property
    def scale(self) -> float:
        """What one unit of the program is, mm; 1 where it has not said."""
        return 1.0 if self.unit is None else self.unit

    def add(self, item: Instruction) -> None:
        """Writes ``item`` down for the line that is read."""
        if len(self.body) >= _MOST:
            raise Wrong(f"more than {_MOST} instructions cannot be meant")
        self.body.append(item)
        self.lines.append(self.line)

    def remark(self, kind: NoteKind, what: str, why: str = "") -> None:
        """Notes what the user should know, once, with the first line that it concerns."""
        self.remarks.setdefault((kind, what, why), self.line)

    def rapid(self, end: Sequence[float], axes: Sequence[int] = ()) -> None:
        """A motion at the machine's own speed. axes: those that the line names; their position is known from here on.

        Until all are known, nothing is written down: where the tool stands at the start is not in the text.
        """
        self.at[:] = end
        for axis in axes:
            self.known[axis] = True
        if self.begun or all(self.known):
            self.begun = True
            self.add(MoveJ(Pose(TOOL_DOWN, self.here()), RAPID))
        else:
            self.held += 1

    def start(self) -> None:
        """Before a motion at feed: a position that is not known is taken for 0, and is where the program begins."""
        if self.begun:
            return
        unknown = [name for name, known in zip(AXES, self.known, strict=True) if not known]
        if unknown:
            self.remark(
                "assumed", f"the program begins at {' '.join(name + '0' for name in unknown)}", "it does not say where"
            )
            self.entry = self.feed or RAPID
        self.known[:] = [True, True, True]
        self.begun = True
        self.add(MoveJ(Pose(TOOL_DOWN, self.here()), RAPID))

    def here(self) -> Vec3:
        """The position."""
        x, y, z = self.at
        return (x, y, z)

    def pieces(self, pieces: Sequence[Piece], speed: float) -> None:
        """Lines and arcs at ``speed``, mm/s."""
        self.cut = True
        for via, end in pieces:
            pose = Pose(TOOL_DOWN, end)
            if via is None:
                self.add(MoveL(pose, speed, self.blend))
            else:
                self.add(MoveC(Pose(TOOL_DOWN, via), pose, speed, self.blend))
        self.at[:] = pieces[-1][1]

    def switch(self, signal: str, value: float) -> None:
        """Sets an output."""
        self.add(Output(signal, value))

    def wait(self, seconds: float) -> None:
        """Stands still."""
        self.add(Wait(seconds))

    def notes(self) -> tuple[tuple[int, Note], ...]:
        """The remarks, each with the first line that it concerns."""
        return tuple((line, Note(*remark)) for remark, line in self.remarks.items())

    def value(self, name: str) -> float | None:
        """A parameter that the machine decides, by number or name; None for one that is not known."""
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
    "_rpm": lambda m: m.speed,
    "_line": lambda m: float(m.line),
    "_spindle_on": lambda m: float(m.spindle != "M5"),
    "_spindle_cw": lambda m: float(m.spindle == "M3"),
}
