"""The base of the G-code posts: a three-axis machine with the tool straight down, in RS-274.

Sources: the LinuxCNC manual (G-code, M-code and overview chapters) and its interpreter, which
judges the printed text in the tests; for GRBL the firmware 1.1. Every pose is a point of the tool
tip in the work offset, mm.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import chain, compress
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from camgen.geometry.arcs import level_arms
from camgen.geometry.ragged import mark_run_starts
from camgen.geometry.vectors import are_within
from camgen.model.cell import Cell
from camgen.model.errors import JobError, Refused
from camgen.model.pose import (
    IDENTITY,
    TOOL_DOWN,
    FloatArray,
    Pose,
    Vec3,
    angle_between,
    translation,
)
from camgen.model.program import (
    Columns,
    Comment,
    Force,
    Indices,
    Instruction,
    Joints,
    Mask,
    Motion,
    MoveC,
    MoveJ,
    MoveL,
    Output,
    Program,
    Stop,
    ToolChange,
    Wait,
)
from camgen.model.text import short
from camgen.post import Post, Tolerance, end_of, pose_of
from camgen.post.printed import Forms, make_forms, round_numbers
from camgen.post.values import choose_line

#: mm: smaller arcs are not well defined by three decimals; larger ones exceed GRBL's 32-bit
#: arithmetic.
_MIN_RADIUS, _MAX_RADIUS = 0.05, 10_000.0
#: mm: allowed difference of the two radii of an arc, by GRBL's error 33; LinuxCNC allows more.
_RADII = 0.005


class Arc(NamedTuple):
    """The printed form of an arc: G2 or G3, and the words of its centre."""

    code: str
    centre: str


class Arcs(NamedTuple):
    """N arcs in the XY plane.

    fault: (N,) index in `FAULTS`, 0 for none.
    left: (N,) whether the arc is counter-clockwise.
    centre: (N, 2) centre from the printed start, mm.
    """

    fault: NDArray[np.intp]
    left: Mask
    centre: FloatArray

    def printed(self, rows: Indices, decimals: int) -> list[Arc]:
        """Print the arcs `rows`."""
        codes = np.where(self.left[rows], "G3", "G2").tolist()
        arcs = []
        for code, (i, j) in zip(codes, self.centre[rows].tolist(), strict=True):
            arcs.append(Arc(code, f"I{short(i, decimals + 1)} J{short(j, decimals + 1)}"))
        return arcs


#: Reasons why an arc becomes chords.
FAULTS = (
    "",
    "the arc does not lie in the XY plane",
    "the arc is too small, too large or more than half a circle",
    "the arc does not differ from its chord",
    "the rounded arc has two radii",
)
#: Number of the fault of an arc that leaves its chord by less than a printed digit.
FLAT = 3


def print_arcs(start: FloatArray, via: FloatArray, end: FloatArray, decimals: int) -> Arcs:
    """Compute arcs from start through via to end, each (N, 3) mm, as they can be printed.

    The centre is on the perpendicular bisector of the printed end points, so that both radii agree,
    at the distance of the planned centre. So shallow arcs are exact too, whose radius does not
    follow from three rounded points.
    """
    blocks = []
    for low in range(0, max(len(start), 1), _BLOCK):
        rows = slice(low, low + _BLOCK)
        blocks.append(_print_block(start[rows], via[rows], end[rows], decimals))
    return Arcs(*map(np.concatenate, zip(*blocks, strict=True)))


def _print_block(start: FloatArray, via: FloatArray, end: FloatArray, decimals: int) -> Arcs:
    digit = 10.0**-decimals
    # From the start to the planned centre.
    arm, sweep, left = level_arms(start, via, end)
    first, last = np.round(start, decimals), np.round(end, decimals)
    span = (last - first)[:, :2]
    with np.errstate(divide="ignore", invalid="ignore"):
        radius, chord = np.hypot(*arm.T), np.hypot(*span.T)
        across = np.column_stack([-span[:, 1], span[:, 0]]) / chord[:, None]
        middle = (first + last)[:, :2] / 2
        distance = ((start[:, :2] + arm - middle) * across).sum(axis=1)
        centre = np.round(middle + distance[:, None] * across - first[:, :2], decimals + 1)
        tests = (
            (first[:, 2] != last[:, 2]) | (np.abs(via[:, 2] - first[:, 2]) > digit),
            ~((radius >= _MIN_RADIUS) & (radius <= _MAX_RADIUS))
            | ((sweep - np.pi) * radius > digit),
            (radius * (1 - np.cos(sweep / 2)) < digit) | (chord < digit),
            ~(np.abs(np.hypot(*centre.T) - np.hypot(*(span - centre).T)) <= _RADII),
        )
    return Arcs(np.select(tests, range(1, len(FAULTS)), 0), left, centre)


#: Limits of coordinates, mm, and waits, s; and of feeds, mm/min. No machine exceeds them, and they
#: keep a line within GRBL's 79 characters. The upper limit of feeds holds for rpm too.
_MAX_PRINTED, _SLOWEST, _FASTEST = 99_999.0, 0.01, 999_999.0
#: Smaller numbers have an exponent in the forms of lines.
_MIN_PLAIN = 1e-4
#: Codes of motions: joint motion, line, arc to the right, arc to the left.
_CODES = ("G0", "G1", "G2", "G3")
#: Number of arcs that are computed at a time.
_BLOCK = 8192
#: First words that make a comment an order to LinuxCNC.
_ACTIVE = re.compile(r"\s*(msg|debug|print|log|probe|axis|preview|py|abort|stop)", re.IGNORECASE)
#: The two coolants; M9 switches both off.
COOLANT = ("M7", "M8")


@dataclass
class Rs274(Post):
    """The common part of the posts for LinuxCNC and GRBL. See docs/posts/gcode.md."""

    passes: ClassVar[tuple[str, ...]] = ("chords",)
    verified_fields: ClassVar[frozenset[str]] = frozenset({"speed"})
    works: ClassVar[tuple[str, ...]] = ("G54", "G55", "G56", "G57", "G58", "G59")

    work: str = field(
        default="G54", kw_only=True, metadata={"help": "work offset in which the program runs"}
    )
    arcs: bool = field(
        default=True,
        kw_only=True,
        metadata={"help": "G2 and G3; false: chords within tolerance.chord"},
    )
    signals: dict[str, str] = field(
        default_factory=dict, kw_only=True, metadata={"help": "the output of each signal"}
    )
    lift: bool = field(
        default=False,
        kw_only=True,
        metadata={"help": "G53 G0 Z0 first: the machine's zero of Z is its top"},
    )

    #: The words of the last printed position (X, Y, Z), and its numbers.
    _words: tuple[str, ...] = field(default=(), init=False, repr=False)
    _position: Vec3 = field(default=(0.0, 0.0, 0.0), init=False, repr=False)
    #: The last printed F, and its speed.
    _feed: str = field(default="", init=False, repr=False)
    _speed: float = field(default=0.0, init=False, repr=False)
    #: The next arcs of the program; None for one that cannot be printed.
    _ahead: Iterator[Arc | None] = field(
        default_factory=lambda: iter(()), init=False, repr=False, compare=False
    )

    def __post_init__(self) -> None:
        if self.work not in self.works:
            remedy = "one of " + ", ".join(self.works)
            raise JobError("[post] work", f"{self.work!r} is not a work offset", remedy=remedy)
        if not 2 <= self.decimals <= 6:
            raise JobError(
                "[post] decimals",
                f"{self.decimals} is not between 2 and 6",
                remedy="3 is usual for mm",
            )
        if self.max_lines < 0:
            raise JobError(
                "[post] max_lines",
                f"must be 0 or more, not {self.max_lines}",
                remedy="0: the program is not split",
            )

    @classmethod
    def cell(cls) -> Cell:
        """A mill whose home is 50 mm above the work zero."""
        home, about = Pose(TOOL_DOWN, (0.0, 0.0, 50.0)), "3-axis mill, work offset G54"
        return Cell(about, translation(0, 0, 0), translation(0, 0, 100), home)

    def tolerance(self) -> Tolerance:
        """Half the last printed digit; feeds have at least two digits in mm/min."""
        return Tolerance(0.5 * 10**-self.decimals, 1e-5, math.radians(5e-4), 1e-4, 0.01, 5e-4)

    def prepare(self, program: Program, chord: float) -> Program:
        """See `Post`. Also refuses a rotated work frame: a work offset only shifts the axes."""
        if angle_between(program.base_from_work.rotation, IDENTITY) > 1e-6:
            raise Refused(
                self.name,
                -1,
                f"{self.work} cannot turn the work frame",
                "align the part with the axes and leave the angles of cell.base_from_work at 0",
            )
        return super().prepare(program, chord)

    def begin(self, program: Program) -> Sequence[str]:
        """Header comments and the whole modal state, which the last program may have changed."""
        remarks = (
            f"program {self.program or program.name}",
            f"post {self.name} mm work {self.work}",
            *program.header,
        )
        return [
            *(self.note(remark) for remark in remarks),
            f"G17 G21 G40 {self.work} G80 G90 G94",
            "G91.1",
        ]

    def ready(self) -> Sequence[str]:
        """Lines before the first motion, when all outputs are off.

        The lift comes before G49: a tool length that was on would lower the next height.
        """
        return ("G53 G0 Z0", "G49") if self.lift else ("G49",)

    def end(self, program: Program) -> Sequence[str]:  # noqa: ARG002 (the contract's signature)
        """LinuxCNC demands an end."""
        return ("M2",)

    def comment(self, text: str) -> str:
        """A comment of its own line that is never one of LinuxCNC's active ones."""
        return f"(- {text})" if _ACTIVE.match(text) else f"({text})"

    def movej(self, motion: MoveJ) -> Sequence[str]:
        """G0. The first one lifts before it travels, since the machine's position is unknown."""
        first = not self._words
        words = self._go(motion)
        if not first:
            return ("G0 " + " ".join(words),)
        up, across = f"G0 {words[2]}", f"G0 {words[0]} {words[1]}"
        return (*self.ready(), *((across, up) if self.lift else (up, across)))

    def movel(self, motion: MoveL) -> Sequence[str]:
        """G1, with the feed if it changes."""
        return (" ".join(["G1", *self._go(motion), *self._feed_word(motion)]),)

    def movec(self, motion: MoveC) -> Sequence[str]:
        """G2 or G3 in the XY plane, centre from the printed start."""
        arc = next(self._ahead, None)
        if arc is None:
            arcs = self._find_arc(motion, self._position)
            if arcs.fault[0]:
                raise Refused(self.name, -1, FAULTS[int(arcs.fault[0])])
            arc = arcs.printed(np.zeros(1, dtype=np.intp), self.decimals)[0]
        self._go(motion)
        return (" ".join([arc.code, *self._words[:2], arc.centre, *self._feed_word(motion)]),)

    def forms(self, program: Program) -> Forms | None:
        """All motions except those from an unknown position; None if an arc cannot be printed."""
        columns = program.columns
        kind, ends = columns.kinds, round_numbers(columns.ends, self.decimals)
        # The first motion, and the first one after each tool change, print the whole position.
        first = np.searchsorted(columns.at, np.append(0, np.flatnonzero(columns.are(ToolChange))))
        rows = np.setdiff1d(np.arange(len(ends)), first)
        arcs = np.flatnonzero(columns.moves_are(MoveC))
        printed = self._find_arcs(columns, arcs)
        if not columns.posed.all() or printed.fault.any():
            return None
        numbers = np.zeros((len(ends), 5))
        numbers[:, :3] = ends
        numbers[arcs, 3:] = round_numbers(printed.centre, self.decimals + 1)
        if ((numbers != 0) & (np.abs(numbers) < _MIN_PLAIN)).any():
            return None
        used = np.zeros(numbers.shape, np.bool_)
        used[1:, :3] = ends[1:] != ends[:-1]
        used[~used.any(axis=1), 0] = True
        used[arcs] = (True, True, False, True, True)
        code = kind.astype(np.intp)
        code[arcs] += printed.left
        feeds, feed = self._feed_words(columns)

        def form(code: int, feed: int, *used: int) -> str:
            words = [letter + "%.12g" for letter in compress("XYZIJ", used)]
            return " ".join([_CODES[code], *words, *feeds[feed : feed + 1]])

        numbers, used = numbers[rows], used[rows]
        return make_forms(rows, [code[rows], feed[rows], *used.T], form, numbers, used)

    def _feed_words(self, columns: Columns) -> tuple[list[str], Indices]:
        """Return the F words of a program, and the index of the word of each motion.

        The index is the number of words for a motion without an F word.
        """
        working = np.flatnonzero(~columns.moves_are(MoveJ))
        speeds, which = np.unique(columns.speed[working], return_inverse=True)
        words = ["F" + _feed_text(speed * 60.0) for speed in speeds.tolist()]
        feeds = list(dict.fromkeys(words))
        index = {word: k for k, word in enumerate(feeds)}
        feed = np.array([index[word] for word in words], np.intp)[which]
        printed = np.full(len(columns.at), len(feeds))
        changed = mark_run_starts(feed)
        printed[working[changed]] = feed[changed]
        return feeds, printed

    def split(self, program: Program, printed: Iterable[Sequence[str]]) -> Sequence[Sequence[str]]:
        """See `Post`. The arcs are computed by column before they are printed."""
        self._ahead = self._look_ahead(program.columns)
        return super().split(program, printed)

    def _look_ahead(self, columns: Columns) -> Iterator[Arc | None]:
        arcs = np.flatnonzero(columns.moves_are(MoveC))
        for low in range(0, len(arcs), _BLOCK):
            block = self._find_arcs(columns, arcs[low : low + _BLOCK])
            printed = block.printed(np.arange(len(block.fault)), self.decimals)
            for fault, arc in zip(block.fault.tolist(), printed, strict=True):
                yield None if fault else arc

    def _find_arcs(self, columns: Columns, arcs: Indices) -> Arcs:
        # The start of the first motion is unknown, but it is not an arc.
        starts = np.where(arcs[:, None] > 0, columns.ends[arcs - 1], np.nan)
        return print_arcs(starts, columns.vias_of(arcs), columns.ends[arcs], self.decimals)

    def _go(self, motion: Motion) -> list[str]:
        """Return the axis words that change, at least one, so that the text keeps every motion."""
        place, digits, old = pose_of(motion).origin, self.decimals, self._words
        if not old:
            words = [axis + short(value, digits) for axis, value in zip("XYZ", place, strict=True)]
            self._words, self._position = tuple(words), place
            return words
        # Written out for the three axes: this takes a third of the time of printing a long program.
        (x, y, z), (word_x, word_y, word_z) = place, old
        before_x, before_y, before_z = self._position
        changed = []
        if x != before_x and (word := "X" + short(x, digits)) != word_x:
            changed.append(word)
            word_x = word
        if y != before_y and (word := "Y" + short(y, digits)) != word_y:
            changed.append(word)
            word_y = word
        if z != before_z and (word := "Z" + short(z, digits)) != word_z:
            changed.append(word)
            word_z = word
        self._words, self._position = (word_x, word_y, word_z), place
        return changed or [word_x]

    def _feed_word(self, motion: Motion) -> list[str]:
        if motion.speed == self._speed:
            return []
        self._speed, text = motion.speed, _feed_text(motion.speed * 60.0)
        if text == self._feed:
            return []
        self._feed = text
        return ["F" + text]

    def wait(self, item: Wait) -> Sequence[str]:
        """G4 takes seconds in both dialects."""
        return (f"G4 P{short(item.seconds, 3)}",)

    def stop(self, item: Stop) -> Sequence[str]:
        """M0, and M1 for a stop that the operator can switch off."""
        return choose_line(item.optional, "M1", "M0")

    def accepts(self, columns: Columns) -> Mask:
        """Motions within the limits with the tool straight down, and outputs."""
        fine = columns.turned_as(TOOL_DOWN)
        fine &= are_within(columns.ends, _MAX_PRINTED)
        feed = columns.speed * 60.0
        fine &= columns.moves_are(MoveJ) | ((feed >= _SLOWEST) & (feed <= _FASTEST))
        arcs = np.flatnonzero(columns.moves_are(MoveC))
        fine[arcs] &= self._accepted_arcs(columns, arcs)
        accepted = columns.are(Comment) | columns.alike(
            Output, lambda item: not self.why_not(item, None, None)
        )
        accepted[columns.at[fine]] = True
        return accepted

    def _accepted_arcs(self, columns: Columns, arcs: Indices) -> Mask:
        if not self.arcs or not len(arcs):
            return np.zeros(len(arcs), np.bool_)
        upright = np.array([not is_tilted(rotation) for rotation in columns.table], np.bool_)
        fine: Mask = (self._find_arcs(columns, arcs).fault == 0) & upright[columns.via_rotation]
        return fine

    def why_not(self, item: Instruction, before: Motion | None, _after: Motion | None) -> str:
        """Return why the machine cannot do `item`; arcs that are refused here become chords."""
        match item:
            case MoveJ() | MoveL() | MoveC():
                return self._why_not_motion(item, end_of(before))
            case Output():
                return self.why_not_signal(item)
            case Wait() if item.seconds > _MAX_PRINTED:
                return f"a wait of {item.seconds:g} s is longer than {_MAX_PRINTED:g} s"
            case Force():
                return self.why_not_force(item)
        return ""

    def _why_not_motion(self, item: Motion, start: Pose | None) -> str:
        target = item.target
        if isinstance(target, Joints):
            return (
                "a three-axis machine has no joint values to move to"
                "; give the home position as a pose"
            )
        if is_tilted(target.rotation) or (isinstance(item, MoveC) and is_tilted(item.via.rotation)):
            return (
                "the tool is not straight down, and the machine has three axes"
                "; use a robot's post or no axis tilt"
            )
        x, y, z = target.origin
        if not all(abs(v) <= _MAX_PRINTED for v in (x, y, z)):
            return f"a coordinate is beyond {_MAX_PRINTED:g} mm"
        if isinstance(item, MoveJ):
            return ""
        feed = item.speed * 60.0
        if not _SLOWEST <= feed <= _FASTEST:
            return (
                f"a feed of {feed:g} mm/min is not {_SLOWEST:g} to {_FASTEST:g} mm/min"
                "; change process.feed or process.plunge"
            )
        if not isinstance(item, MoveC):
            return ""
        if start is None or not self.arcs:
            return "arcs are off or start nowhere; set post.arcs"
        return FAULTS[int(self._find_arc(item, start.origin).fault[0])]

    def _find_arc(self, item: MoveC, start: Vec3) -> Arcs:
        points = np.array([[start], [item.via.origin], [item.target.origin]])
        return print_arcs(points[0], points[1], points[2], self.decimals)

    def why_not_signal(self, item: Output) -> str:
        """Return why the signal cannot be set in this dialect."""
        signal, value = item.signal, item.value
        if signal == "spindle" and value < 0:
            return (
                f"the spindle is to turn backwards (M4, {-value:g} rpm), "
                "and this post prints M3 alone"
            )
        if signal == "spindle" and not value <= _FASTEST:
            return f"a spindle speed of {value:g} rpm is beyond {_FASTEST:g} rpm"
        if signal == "spindle":
            return ""
        if signal not in self.signals:
            known = ", ".join(["spindle", *sorted(self.signals)])
            coolant = {"mist": "M7", "flood": "M8"}.get(signal)
            example = f', e.g. {{ {signal} = "{coolant}" }}' if coolant else ""
            return (
                f"signal {signal} has no output (known: {known}); "
                f"give it one in post.signals{example}"
            )
        if value in (0, 1):
            return ""
        what = f"signal {signal} is on (1) or off (0), not {value:g}"
        if value > 1:
            return (
                f"{what}; if it is the spindle of an old program: "
                f'input.signals = {{ {signal} = "spindle" }}'
            )
        return what

    def why_not_force(self, item: Force) -> str:  # noqa: ARG002 (for overrides)
        """Return why force control cannot be turned on: G-code has none."""
        return 'G-code has no force control; set process.force = 0 or post.force = "ignore"'


def _feed_text(feed: float) -> str:
    return short(feed, max(2, 3 - math.floor(math.log10(feed))))


def is_tilted(rotation: FloatArray) -> bool:
    """Whether tool z is not straight down; the roll does not matter."""
    return rotation is not TOOL_DOWN and (
        math.hypot(rotation[0, 2], rotation[1, 2]) > 1e-6 or rotation[2, 2] > 0
    )


def check_signals(
    signals: dict[str, str], allowed: Sequence[str], shared: Sequence[tuple[str, str]]
) -> None:
    """Check that every signal has an output of the dialect, and can be switched off by itself.

    allowed: the words that may be printed. Other words of the table are refused.
    shared: pairs of words that one word switches off.

    Raises JobError for the first signal that has not.
    """
    names = ", ".join(allowed) if len(allowed) < 9 else f"{allowed[0]} to {allowed[-1]}"
    remedy = f"one of {names}"
    for name, word in signals.items():
        where = f"[post.signals] {name}"
        if name in ("", "spindle"):
            raise JobError(where, "is not a free name", remedy="the spindle is built in")
        if word not in allowed:
            raise JobError(where, f"{word!r} is not an output of this controller", remedy=remedy)
        taken = {word, *chain.from_iterable(pair for pair in shared if word in pair)}
        if any(other in taken for key, other in signals.items() if key != name):
            raise JobError(
                where,
                f"{word} is switched off by another signal too",
                remedy="give each its own output",
            )
