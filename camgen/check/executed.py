"""The path that the controller runs of a text, against the programmed one."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.geometry.arcs import Spans, spans_through
from camgen.model.cell import Dynamics
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray, Vec3, to_vec3
from camgen.model.program import Columns, Comment, MoveC, MoveJ
from camgen.motion.rounding import Transitions, measure_rounding

#: Transitions that are measured together.
_BLOCK = 16384


class Rounding(Struct, frozen=True):
    """The place where the executed path leaves the programmed one farthest.

    transitions: number of transitions between working motions without a stop.
    mm: distance there; 0 without transitions.
    allowed: distance that the job allows there, mm.
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

    @property
    def excess(self) -> float:
        """Distance, mm, beyond the allowed one; negative within it."""
        return self.mm - self.allowed


def measure_text(
    columns: Columns,
    lines: IntArray,
    works: BoolArray,
    allowed: FloatArray,
    dynamics: Dynamics,
    file: str,
) -> Rounding:
    """The rounding of a text that exceeds the allowed one most.

    columns: the text as it was read back, with M motions.
    lines: (M,) line of each motion.
    works: (M,) whether each motion is in contact with the part.
    allowed: (M,) distance that the job allows at the end of each motion, mm.
    dynamics: dynamics of the controller.
    file: name of the text.
    """
    first = find_transitions(columns, works, dynamics)
    worst = Rounding(len(first), file=file)
    for low in range(0, len(first), _BLOCK):
        rows = first[low : low + _BLOCK]
        mm = measure_rounding(pick_transitions(columns, rows), dynamics)
        k = int(np.argmax(mm - allowed[rows]))
        row = int(rows[k])
        limit, place = float(allowed[row]), to_vec3(columns.ends[row])
        rounding = Rounding(len(first), float(mm[k]), limit, place, int(lines[row]), file)
        if not worst.line or rounding.excess > worst.excess:
            worst = rounding
    return worst


def find_transitions(columns: Columns, works: BoolArray, dynamics: Dynamics) -> IntArray:
    """(K,) working lines and arcs that go on into another one without a stop."""
    linear = ~columns.moves_are(MoveJ) & works
    done = np.cumsum(~columns.are(Comment))[columns.at]
    follows = linear[:-1] & linear[1:] & (np.diff(done) == 1)
    if dynamics.corner in ("zone", "overlap"):
        follows &= columns.blend[:-1] > 0
    # The first motion has no known start.
    follows[:1] = False
    return np.flatnonzero(follows)


def pick_transitions(columns: Columns, first: IntArray) -> Transitions:
    """The transitions from the motions `first` (K,) into the next ones."""
    fast = np.maximum(columns.speed[first], columns.speed[first + 1])
    pair = (_shape(columns, first), _shape(columns, first + 1))
    return Transitions(*pair, columns.blend[first], fast)


def _shape(columns: Columns, rows: IntArray) -> Spans:
    via = np.full((len(rows), 3), np.nan)
    arcs = columns.moves_are(MoveC)[rows]
    via[arcs] = columns.vias_of(rows[arcs])
    return spans_through(columns.ends[rows - 1], via, columns.ends[rows])
