"""G-code for LinuxCNC 2.9.

Sources: the LinuxCNC manual (G-code, M-code and overview chapters) and its interpreter, which
judges the printed text in the tests.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import ClassVar, Literal

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.model.cell import Dynamics
from camgen.model.errors import JobError
from camgen.model.pose import FloatArray, Pose, Vec3
from camgen.model.program import (
    Columns,
    Comment,
    Force,
    Instruction,
    Mask,
    Motion,
    MoveC,
    MoveJ,
    MoveL,
    Output,
    Program,
    ToolChange,
    splice,
)
from camgen.model.text import short
from camgen.model.tolerance import PECK_CLEARANCE_MM, SAME_POINT_MM
from camgen.post import Tolerance, pose_of
from camgen.post.passes import remove_force
from camgen.post.printed import Forms
from camgen.post.values import choose_line, choose_words

from .arc_ends import end_in_chords
from .rs274 import COOLANT, Rs274, check_signals

# Drilling cycles (LinuxCNC manual, canned cycles).

#: Digits of R and Q, and their last digit, mm. LinuxCNC subtracts Q once for every peck, so its
#: rounding adds up.
_PECK_DIGITS, _PECK_STEP_MM = 6, 1e-6
#: mm: tolerance of heights, far more than their rounding.
_NEARLY = 0.01


class DrillStroke(Struct, frozen=True):
    """A motion straight up or down.

    z: height at its end, mm.
    feed: speed, mm/s; 0 for a rapid motion.
    """

    z: float
    feed: float


class CycleHole(Struct, frozen=True, eq=False):
    """One drilling cycle.

    first: index of the first instruction that it replaces.
    last: index of the last instruction that it replaces.
    motions: motions that the controller makes of it, along the same path.
    words: words of its line, without X and Y.
    across: whether its first motion is the link to the hole.
    """

    first: int
    last: int
    motions: tuple[Motion, ...]
    words: str
    across: bool

    @property
    def place(self) -> Vec3:
        """Position at its end, mm."""
        return pose_of(self.motions[-1]).origin

    @property
    def feed(self) -> float:
        """Feed, mm/s."""
        return next(motion.speed for motion in self.motions if isinstance(motion, MoveL))


def find_holes(columns: Columns, decimals: int) -> list[CycleHole]:
    """Find the drilling cycles of a program."""
    ends, is_rapid = columns.ends, columns.moves_are(MoveJ)
    if len(ends) < 3:
        return []
    down = (np.diff(ends[:, 2]) < -SAME_POINT_MM) & ~_are_level_moves(ends)
    starts = is_rapid[:-1] & columns.posed[:-1] & down & _come_back_up(ends)[:-1]
    cycle_holes: list[CycleHole] = []
    for k in np.flatnonzero(starts).tolist():
        if cycle_holes and int(columns.at[k]) < cycle_holes[-1].last:
            continue
        hole = _make_hole(columns, k, decimals)
        if hole is not None:
            cycle_holes.append(hole)
    return cycle_holes


def _are_level_moves(ends: FloatArray) -> Mask:
    return np.asarray((ends[1:, 0] != ends[:-1, 0]) | (ends[1:, 1] != ends[:-1, 1]))


def _come_back_up(ends: FloatArray) -> Mask:
    """Whether the tool comes back to about the height of each motion before it leaves X and Y."""
    place = np.cumsum(np.append(True, _are_level_moves(ends)))
    # All heights at one place become lower than those at the places before it. So one accumulation
    # from the end is enough.
    height = ends[:, 2] - place * (np.nanmax(np.abs(ends[:, 2])) * 2 + 1)
    highest = np.fmax.accumulate(height[::-1])[::-1]
    return np.append(highest[1:] >= height[:-1] - _NEARLY, False)


def _make_hole(columns: Columns, k: int, decimals: int) -> CycleHole | None:
    last = _find_return(columns, k)
    if last is None:
        return None
    above = columns.moves[k]
    x, y, top = above.target.origin
    strokes = _join_strokes(columns.moves[k + 1 : last + 1], top, above.speed)
    words = _choose_cycle(top, strokes, decimals) if strokes else ""
    if not words:
        return None
    across = k > 0 and _is_link(columns.pose(k - 1), above.target, decimals)
    motions: list[Motion] = [above] if across else []
    for stroke in strokes:
        target = Pose(above.target.rotation, (x, y, stroke.z))
        if stroke.feed:
            motions.append(MoveL(target, stroke.feed, path=above.path, work=True))
        else:
            motions.append(MoveJ(target, above.speed, path=above.path, work=False))
    first = int(columns.at[k + (not across)])
    return CycleHole(first, int(columns.at[last]), tuple(motions), words, across)


def _is_link(before: Pose | None, above: Pose, decimals: int) -> bool:
    if before is None or abs(before.origin[2] - above.origin[2]) > SAME_POINT_MM:
        return False
    (x, y, _), (u, v, _) = before.origin, above.origin
    return short(x, decimals) != short(u, decimals) or short(y, decimals) != short(v, decimals)


def _find_return(columns: Columns, k: int) -> int | None:
    """Find the motion that returns to the end of motion `k`, only straight up and down between."""
    x, y, top = columns.moves[k].target.origin
    for j in range(k + 1, len(columns.moves)):
        item = columns.moves[j]
        if columns.at[j] != columns.at[j - 1] + 1 or not isinstance(item.target, Pose):
            return None
        u, v, z = item.target.origin
        if (u, v) != (x, y) or not isinstance(item, MoveJ | MoveL) or z > top + SAME_POINT_MM:
            return None
        if isinstance(item, MoveL) and item.force:
            return None
        if abs(z - top) <= SAME_POINT_MM:
            return None if _is_peck(columns, j) else j
    return None


def _is_peck(columns: Columns, j: int) -> bool:
    """Whether motion `j` ends a peck, not a hole: the next motion has the same X and Y."""
    if j + 1 == len(columns.moves) or columns.at[j + 1] != columns.at[j] + 1:
        return False
    return bool((columns.ends[j + 1, :2] == columns.ends[j, :2]).all())


def _join_strokes(moves: Sequence[MoveJ | MoveL], top: float, travel: float) -> list[DrillStroke]:
    """Join motions up and down to strokes, each in one direction; empty if they are not a hole.

    travel: speed from which a line is a rapid motion on this machine, mm/s.
    """
    strokes = [DrillStroke(top, -1.0)]
    for move in moves:
        is_rapid = isinstance(move, MoveJ) or move.speed == travel
        stroke = DrillStroke(pose_of(move).origin[2], 0.0 if is_rapid else move.speed)
        if stroke.feed > travel:
            return []
        last = strokes[-1]
        if stroke.feed == last.feed and (last.z - strokes[-2].z) * (stroke.z - last.z) >= 0:
            strokes.pop()
        strokes.append(stroke)
    return strokes[1:]


def _choose_cycle(top: float, strokes: Sequence[DrillStroke], decimals: int) -> str:
    """Return the words of the cycle with these `strokes` from the height `top`; empty for none."""
    retract, rest = (top, strokes) if strokes[0].feed else (strokes[0].z, strokes[1:])
    cuts = [stroke for stroke in rest if stroke.feed]
    levels = [retract, *(cut.z for cut in cuts)]
    is_rising = any(b >= a - SAME_POINT_MM for a, b in pairwise(levels))
    if not cuts or len({cut.feed for cut in cuts}) > 1 or is_rising:
        return ""
    wanted = [DrillStroke(cuts[0].z, cuts[0].feed)]
    for before, cut in pairwise(cuts):
        wanted += [DrillStroke(retract, 0.0), DrillStroke(before.z + PECK_CLEARANCE_MM, 0.0), cut]
    wanted.append(DrillStroke(top, 0.0))
    if len(rest) != len(wanted):
        return ""
    for a, b in zip(rest, wanted, strict=True):
        if a.feed != b.feed or abs(a.z - b.z) > SAME_POINT_MM:
            return ""
    words = f"Z{short(levels[-1], decimals)} R{short(retract, _PECK_DIGITS)}"
    if len(cuts) == 1:
        return f"G81 {words}"
    peck = _compute_peck(levels, decimals)
    return f"G83 {words} Q{short(peck, _PECK_DIGITS)}" if peck else ""


def _compute_peck(levels: Sequence[float], decimals: int) -> float:
    """Compute the Q of the pecks from `levels[0]` to the others; 0 if no Q makes just these.

    LinuxCNC goes down by Q from the printed R while it is above the printed Z, which decide the
    number of pecks. A Z that is rounded down would leave a last peck of that rounding.
    """
    step, count = levels[0] - levels[1], len(levels) - 1
    if any(abs(levels[0] - k * step - levels[k]) > SAME_POINT_MM for k in range(1, count)):
        return 0.0
    depth = float(short(levels[0], _PECK_DIGITS)) - float(short(levels[-1], decimals))
    peck = round(max(step, depth / count + _PECK_STEP_MM), _PECK_DIGITS)
    if (count - 1) * peck > depth - _PECK_STEP_MM:
        return 0.0
    return peck if (count - 1) * (peck - step) < 0.5 * 10**-decimals else 0.0


def group_holes(
    body: Sequence[Instruction], cycle_holes: Sequence[CycleHole]
) -> Iterator[tuple[CycleHole, bool, bool]]:
    """Yield each hole, whether it continues the cycle before it, and whether its cycle ends."""
    joins = []
    for before, after in pairwise(cycle_holes):
        is_same = before.words == after.words and before.feed == after.feed and after.across
        between = body[before.last + 1 : after.first]
        joins.append(is_same and all(isinstance(item, Comment) for item in between))
    for hole, joined, joins_next in zip(cycle_holes, [False, *joins], [*joins, False], strict=True):
        yield hole, joined, not joins_next


#: Outputs of signals: LinuxCNC has at most 64 digital outputs.
_OUTPUTS = (*COOLANT, *(f"P{n}" for n in range(64)))


@dataclass
class GCode(Rs274):
    """LinuxCNC 2.9, three axes."""

    name: ClassVar[str] = "gcode"
    suffix: ClassVar[str] = ".ngc"
    about: ClassVar[str] = "G-code for LinuxCNC (RS-274/NGC), three-axis mill"
    works: ClassVar[tuple[str, ...]] = (*Rs274.works, "G59.1", "G59.2", "G59.3")
    changes_tools: ClassVar[bool] = True

    lift: bool = field(
        default=True,
        kw_only=True,
        metadata={"help": "G53 G0 Z0 first: the machine's zero of Z is its top"},
    )
    tool: int = field(
        default=0, kw_only=True, metadata={"help": "tool to change to and measure by; 0: no change"}
    )
    path_tolerance: float = field(
        default=0.01, kw_only=True, metadata={"help": "G64 P, mm; 0: exact path (G61)"}
    )
    cycles: bool = field(
        default=True, kw_only=True, metadata={"help": "G81 and G83 for holes; false: each motion"}
    )
    signals: dict[str, str] = field(
        default_factory=lambda: {"process": "P0"},
        kw_only=True,
        metadata={"help": "digital output (P0 to P63) or coolant (M7, M8) of each signal"},
    )
    outputs: int = field(
        default=4,
        kw_only=True,
        metadata={"help": "digital and analog outputs that the machine has, to read back by"},
    )
    force: Literal["refuse", "ignore", "analog"] = field(
        default="refuse",
        kw_only=True,
        metadata={"help": "ignore: leave out; analog: an analog output (M67, M68)"},
    )
    force_channel: int = field(
        default=0, kw_only=True, metadata={"help": "analog output of the force, 0 to 63"}
    )
    force_scale: float = field(
        default=0.0, kw_only=True, metadata={"help": "output value per N; analog needs it"}
    )

    #: Whether a tool change has already printed the lines before the first motion.
    _changed: bool = field(default=False, init=False, repr=False)
    #: The printed analog value, empty while force is off.
    _pressing: str = field(default="", init=False, repr=False)
    #: The motion and the row of `group_holes` that starts with it, None inside a cycle, by the
    #: identity of the motion.
    _cycles: dict[int, tuple[Motion, tuple[CycleHole, bool, bool] | None]] = field(
        default_factory=dict, init=False, repr=False
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 <= self.tool <= 99_999:
            raise JobError("[post] tool", f"{self.tool} is not a tool number", remedy="0 for none")
        if self.path_tolerance != 0 and not 1e-4 <= self.path_tolerance <= 10:
            raise JobError(
                "[post] path_tolerance",
                f"{self.path_tolerance} is not 0.0001 to 10 mm",
                remedy="0 for the exact path; "
                "without a tolerance LinuxCNC would round corners by any amount",
            )
        check_signals(self.signals, _OUTPUTS, [COOLANT])
        if not 1 <= self.outputs <= 64:
            raise JobError(
                "[post] outputs",
                f"{self.outputs} is not 1 to 64",
                remedy="num_dio and num_aio of motmod",
            )
        if not 0 <= self.force_channel <= 63:
            raise JobError("[post] force_channel", f"must be 0 to 63, not {self.force_channel}")
        if self.force == "analog" and not 1e-3 <= self.force_scale <= 1e3:
            raise JobError(
                "[post] force_scale",
                "analog force needs the output's value per N",
                remedy="0.001 to 1000",
            )

    def tolerance(self) -> Tolerance:
        """Half of the last printed digit, a force by its scale."""
        scale = self.force_scale if self.force == "analog" else 1.0
        return replace(super().tolerance(), force=0.5e-4 / scale)

    def dynamics(self) -> Dynamics:
        """A small mill; G64 P rounds every corner, G61 none.

        The fractions of the acceleration are those of LinuxCNC (docs/cycle-time.md).
        """
        return Dynamics(
            acceleration=500.0,
            corner="arc",
            deviation=self.path_tolerance,
            across=0.866,
            along=0.5,
            last=0.5 if self.path_tolerance else 1.0,
            rapid_stops=True,
        )

    def list_changed(self) -> frozenset[str]:
        """Force, if it is left out, and holes, which become cycles."""
        return choose_words({"force": self.force == "ignore", "cycles": self.cycles})

    def prepare(self, program: Program, chord: float) -> Program:
        """See `Rs274`; may leave out force, ends some arcs in chords, and makes cycles of holes."""
        if self.force == "ignore":
            program = remove_force(program)
        program = super().prepare(program, chord)
        if self.path_tolerance:
            program = end_in_chords(program, self.decimals)
        cycle_holes = find_holes(program.columns, self.decimals) if self.cycles else []
        if not cycle_holes:
            return program
        changed: dict[int, Sequence[Motion]] = {}
        for row in group_holes(program.body, cycle_holes):
            first, *others = row[0].motions
            self._cycles[id(first)] = first, row
            self._cycles.update((id(motion), (motion, None)) for motion in others)
            changed |= dict.fromkeys(range(row[0].first, row[0].last + 1), ())
            changed[row[0].first] = row[0].motions
        return program.with_body(splice(tuple(program.body), changed))

    def begin(self, program: Program) -> Sequence[str]:
        """Q0 keeps LinuxCNC from joining lines, so that the path stays within P."""
        if program.columns.are(Force).any():
            value = f"analog output {self.force_channel} is {short(self.force_scale, 6)} per N"
            lines = (
                f"force: {value}, led to a regulator in HAL",
                "force: its direction and its zero are the machine's",
            )
            program = replace(program, header=(*program.header, *lines))
        path = f"G64 P{short(self.path_tolerance, 4)} Q0" if self.path_tolerance else "G61"
        return [*super().begin(program), path]

    def ready(self) -> Sequence[str]:
        """The tool and its length come last."""
        if self._changed:
            return ()
        return (*super().ready(), *((f"T{self.tool} M6", "G43") if self.tool else ()))

    def change_tool(self, item: ToolChange) -> Sequence[str]:
        """M6, a lift to the top of the machine, whose position is unknown, and the new length."""
        first = not self._changed
        self._changed, self._words = True, ()
        name = f"tool {item.name}"
        if item.diameter:
            name += f" diameter {short(item.diameter, 3)} mm length {short(item.length, 3)} mm"
        return (
            self.note(" ".join(name.split())),
            *(super().ready() if first else ()),
            f"T{item.number} M6",
            *(("G53 G0 Z0",) if self.lift else ()),
            f"G43 H{item.number}",
        )

    def movej(self, motion: MoveJ) -> Sequence[str]:
        """G0, or the cycle that starts with it."""
        lines = self._cycle(motion)
        return super().movej(motion) if lines is None else lines

    def movel(self, motion: MoveL) -> Sequence[str]:
        """G1, after the force of this line, or the cycle that starts with it."""
        lines = self._cycle(motion)
        return (*self._pressed(motion), *super().movel(motion)) if lines is None else lines

    def forms(self, program: Program) -> Forms | None:
        """See `Rs274`. Programs with force or cycles are printed one by one."""
        return None if self._cycles or program.columns.are(Force).any() else super().forms(program)

    def _cycle(self, motion: MoveJ | MoveL) -> Sequence[str] | None:
        """Print the cycle that starts with `motion`; empty inside a cycle, None outside."""
        known, row = self._cycles.get(id(motion), (None, None))
        if known is not motion:
            return None
        self._go(motion)
        if row is None:
            return ()
        hole, joined, last = row
        x, y, _ = hole.place
        words = [f"X{short(x, self.decimals)}", f"Y{short(y, self.decimals)}"]
        feed = []
        if isinstance(motion.target, Pose):
            feed = self._feed_word(MoveL(motion.target, hole.feed))
        if not joined:
            words = ["G98", hole.words[:3], *words, hole.words[4:], *feed]
        return (" ".join(words), *(("G80",) if last else ()))

    def movec(self, motion: MoveC) -> Sequence[str]:
        """G2 or G3, after the force of this arc."""
        return (*self._pressed(motion), *super().movec(motion))

    def output(self, item: Output) -> Sequence[str]:
        """M64 and M65 wait for the end of the motion before them."""
        if item.signal == "spindle":
            return choose_line(item.value, f"S{short(item.value, 6)} M3", "M5")
        word = self.signals[item.signal]
        if word in COOLANT:
            return choose_line(item.value, word, "M9")
        return choose_line(item.value, f"M64 {word}", f"M65 {word}")

    def why_not(self, item: Instruction, before: Motion | None, after: Motion | None) -> str:
        """Also of a tool change."""
        if not isinstance(item, ToolChange):
            return super().why_not(item, before, after)
        if not item.number:
            name = item.name or short(item.diameter, 3)
            return f"tool {name} has no number in the tool table; set tools.number"
        if self.tool:
            return (
                "post.tool is for programs with one tool; leave it out, the operations name theirs"
            )
        return ""

    def print_force(self, item: Force) -> Sequence[str]:
        """M68 acts at once, after the motion before it has ended."""
        value = self._force_word(item.newtons)
        self._pressing = value if item.newtons > 0 else ""
        return (f"M68 E{self.force_channel} Q{value}",)

    def _pressed(self, motion: MoveL | MoveC) -> Sequence[str]:
        """M67 acts with the next motion, without a stop before it."""
        if not self._pressing:
            return ()
        value = self._force_word(motion.force)
        if value == self._pressing:
            return ()
        self._pressing = value
        return (f"M67 E{self.force_channel} Q{value}",)

    def _force_word(self, newtons: float) -> str:
        return short(newtons * self.force_scale, 4)

    def why_not_force(self, item: Force) -> str:
        """An analog output can represent a force; its effect on the tool is wired in HAL."""
        if self.force != "analog":
            return (
                f"{super().why_not_force(item)}, "
                'or post.force = "analog" with an output wired to a regulator'
            )
        if item.newtons > 0 and self._force_word(item.newtons) == "0":
            return (
                f"{item.newtons:g} N is 0 at post.force_scale = {self.force_scale:g}"
                "; raise the scale"
            )
        return ""
