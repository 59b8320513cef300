"""The path that the controller runs of a text, against the programmed one."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry.arcs import Spans, make_spans_through
from camgen.geometry.vectors import measure_angles
from camgen.model.cell import Dynamics
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray, Vec3, to_vec3
from camgen.model.program import Columns, Comment, MoveC, MoveJ
from camgen.model.tolerance import NONZERO
from camgen.motion.rounding import Transitions, measure_rounding

#: mm: the allowed distance of a text that has none.
UNLIMITED = 1e6
#: Transitions that are measured together.
_BLOCK = 4096


class Rounding(Struct, frozen=True):
    """The place where the executed path comes nearest to the distance that it may have.

    transitions: number of transitions between working motions without a stop.
    largest: largest distance from the programmed path, mm. Between chords of an arc more is allowed
        than elsewhere, so the path may be farther there.
    mm: distance at the place; 0 without transitions.
    allowed: distance that the job allows there, mm; `UNLIMITED` for a program that is replayed.
    place: the end of the first motion, mm, work frame.
    line: line of the first motion in the text, from 1; 0 without transitions.
    file: name of the text.
    """

    transitions: int = 0
    mm: float = 0.0
    allowed: float = 0.0
    place: Vec3 = (0.0, 0.0, 0.0)
    line: int = 0
    file: str = ""
    largest: float = 0.0

    @property
    def excess(self) -> float:
        """Distance, mm, beyond the allowed one; negative within it."""
        return self.mm - self.allowed


class ReadText(NamedTuple):
    """A text as it was read back, with M motions.

    columns: its instructions.
    lines: (M,) line of each motion.
    works: (M,) whether each motion is in contact with the part.
    allowed: (M,) distance that the job allows at the end of each motion, mm.
    file: name of the text.
    """

    columns: Columns
    lines: IntArray
    works: BoolArray
    allowed: FloatArray
    file: str


def measure_text(text: ReadText, dynamics: Dynamics, chord: float) -> Rounding:
    """The rounding of a text that exceeds the allowed one most.

    Chords stand for an arc that they leave by `chord`, mm. The executed path may leave the arc by
    the allowed distance, and so its chords by the sum of both.

    dynamics: dynamics of the controller.
    """
    columns = text.columns
    first = find_transitions(columns, text.works, dynamics)
    worst = Rounding(len(first), file=text.file)
    for low in range(0, len(first), _BLOCK):
        rows = first[low : low + _BLOCK]
        transitions = pick_transitions(columns, rows)
        mm = measure_rounding(transitions, dynamics)
        limits = text.allowed[rows] + allow_chords(transitions, chord)
        k = int(np.argmax(mm - limits))
        row = int(rows[k])
        limit, place = float(limits[k]), to_vec3(columns.ends[row])
        line = int(text.lines[row])
        largest = float(mm.max())
        rounding = Rounding(len(first), float(mm[k]), limit, place, line, text.file, largest)
        worst = join_roundings(worst, rounding)
    return worst


def join_roundings(first: Rounding, second: Rounding) -> Rounding:
    """The rounding that exceeds the allowed one more, with the largest distance of both."""
    largest = max(first.largest, second.largest)
    is_first = first.line and first.excess >= second.excess
    return replace(first if is_first or not second.line else second, largest=largest)


def allow_chords(transitions: Transitions, chord: float) -> FloatArray:
    """(K,) `chord` between two lines that may be chords of an arc, else 0.

    A chord that leaves its arc by s turns away from it by 4 s / length at either end.
    """
    first, second = transitions.first, transitions.second
    turn = measure_angles(first.tangents()[1], second.tangents()[0])
    lengths = [np.maximum(motion.length, NONZERO) for motion in (first, second)]
    limit = 4 * chord * (1 / lengths[0] + 1 / lengths[1])
    return np.where(~first.curved & ~second.curved & (turn <= limit), chord, 0.0)


def find_transitions(columns: Columns, works: BoolArray, dynamics: Dynamics) -> IntArray:
    """(K,) working lines and arcs that go on into another one without a stop."""
    linear = ~columns.moves_are(MoveJ) & works
    done = np.cumsum(~columns.are(Comment))[columns.at]
    follows = linear[:-1] & linear[1:] & (np.diff(done) == 1)
    if dynamics.corner in ("zone", "overlap"):
        follows &= columns.blend[:-1] > 0
    # The start of a motion is known from the motion before it.
    follows[:1] = False
    follows[1:] &= ~np.isnan(columns.ends[:-2, 0])
    return np.flatnonzero(follows)


def pick_transitions(columns: Columns, first: IntArray) -> Transitions:
    """The transitions from the motions `first` (K,) into the next ones."""
    fast = np.maximum(columns.speed[first], columns.speed[first + 1])
    pair = (pick_shapes(columns, first), pick_shapes(columns, first + 1))
    return Transitions(*pair, columns.blend[first], fast)


def pick_shapes(columns: Columns, rows: IntArray) -> Spans:
    """The lines and arcs of the motions `rows` (K,), which have a motion before them."""
    via = np.full((len(rows), 3), np.nan)
    arcs = columns.moves_are(MoveC)[rows]
    via[arcs] = columns.vias_of(rows[arcs])
    return make_spans_through(columns.ends[rows - 1], via, columns.ends[rows])
