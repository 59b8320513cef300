"""The motions of programs as they were read back, by column: where the tip runs, how deep, with which tool."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from msgspec import Struct

from camgen.check.stock.profile import BEAMS, is_flat
from camgen.geometry.arcs import make_spans
from camgen.geometry.ragged import owners, ramp
from camgen.geometry.segments import BoolArray, IntArray, Segments, make, split
from camgen.model.job import ToolTable
from camgen.model.pose import FloatArray
from camgen.model.program import Columns, Instruction, MoveJ, MoveL, Output

#: What is this little above the top face, mm, or this little too deep, is rounding; a gouge up to it is none.
TOLERANCE_MM = 0.005
#: An arc out of the level becomes chords that leave it by at most this, mm.
_CHORD_MM = 0.002
#: A slanted motion of a tool that is no cylinder is looked at in pieces that go down by at most this, mm; at most so
#: many of them.
_STEP_MM, _MOST_PIECES = 0.005, 2000
#: A speed is printed in digits, or as a share of another one.
_NEARLY = 0.99
#: The axis of a tool that leans by more, as a cosine, is not straight down.
_DOWN = -1 + 1e-7


class Stated(Struct, frozen=True):
    """The feeds and speeds that a job states for a tool.

    feed: largest feed of the tool's centre, mm/s.
    plunge: largest feed of going straight down, mm/s.
    speeds: speeds of the spindle, rpm; empty for none.
    """

    feed: float
    plunge: float
    speeds: tuple[float, ...]


class Cut(Struct, frozen=True, eq=False):
    """The instructions of one tool as they were read back.

    body: instructions in order, with poses of the tip in the work frame.
    lines: line of each instruction in the text, from 1.
    tool: the tool.
    file: name of the text.
    name: name of the operation in messages.
    travel: speed, mm/s, from which on a line is a rapid motion; infinite for a controller that has
        rapid motions of its own.
    chord: distance, mm, by which lines that stand for an arc may leave it between their ends.
    corner: distance, mm, by which the controller may round corners.
    stated: feeds and speeds of the job, to be compared with the text; None: they are not compared.
    """

    body: Sequence[Instruction]
    lines: Sequence[int]
    tool: ToolTable
    file: str = "program"
    name: str = ""
    travel: float = float("inf")
    chord: float = 0.0
    corner: float = 0.0
    stated: Stated | None = None


class Moves(Struct, frozen=True, eq=False, dict=True):
    """N motions in order of time, of all cuts. Motions with an unknown start are where they end.

    start, end: (N, 3) mm.
    plane: the motions seen from above.
    down: (N, 2) depth of the tip below the top face at both ends, mm; inf for a beam that is on,
        -inf for a beam that is off.
    rapid: (N,) whether a motion is rapid.
    cut: (N,) number of its cut.
    line: (N,) line of the text, from 1.
    motion: (N,) number of the motion in the columns of its cut, from 0.
    stroke: (N,) number of descents of the tool until then.
    chord: (N,) distance by which a line may leave the arc for which it stands, mm.
    tilted: number of motions with a leaning tool. They are left out.
    lost: number of motions to joint values. They are left out.
    """

    start: FloatArray
    end: FloatArray
    plane: Segments
    down: FloatArray
    rapid: BoolArray
    cut: IntArray
    line: IntArray
    motion: IntArray
    stroke: IntArray
    chord: FloatArray
    tilted: int
    lost: int

    def __len__(self) -> int:
        return len(self.rapid)

    @cached_property
    def deepest(self) -> FloatArray:
        """(N,) mm below the top face."""
        return np.asarray(self.down.max(axis=1))

    @cached_property
    def level(self) -> BoolArray:
        """(N,) whether the tip stays at one depth."""
        with np.errstate(invalid="ignore"):
            apart = np.abs(self.down[:, 1] - self.down[:, 0])
        return np.asarray(~(apart > TOLERANCE_MM / 5))

    @cached_property
    def upright(self) -> BoolArray:
        """(N,) whether the motion goes straight up or down, or nowhere."""
        return np.asarray(self.plane.length <= TOLERANCE_MM / 5)

    @cached_property
    def rising(self) -> BoolArray:
        """(N,) whether the motion goes straight up, which cuts nothing that is not cut already."""
        return np.asarray(self.upright & (self.down[:, 1] <= self.down[:, 0]))

    def below(self, depth: float, rows: IntArray | None = None) -> Portions:
        """What of ``rows`` (else of all) runs deeper than ``depth``, mm."""
        rows = np.arange(len(self)) if rows is None else rows
        rows = rows[self.deepest[rows] > depth]
        first, last = self.down[rows].T
        with np.errstate(invalid="ignore", divide="ignore"):
            at = np.clip((depth - first) / (last - first), 0.0, 1.0)
        low, high = np.where(first > depth, 0.0, at), np.where(last > depth, 1.0, at)
        return Portions(rows, low, high, split(self.plane, rows, low, high))


class Portions(Struct, frozen=True, eq=False):
    """Parts of motions. row: (K,) the motion. low, high: (K,) the fractions of it. plane: seen from above."""

    row: IntArray
    low: FloatArray
    high: FloatArray
    plane: Segments


def tabulate(cuts: Sequence[Cut]) -> Moves:
    """The motions of ``cuts``, one after the other; within one file the tool goes on from where the last one ended."""
    tables: list[Moves] = []
    for number, cut in enumerate(cuts):
        goes_on = number > 0 and cuts[number - 1].file == cut.file and len(tables[-1]) > 0
        tables.append(_table(cut, number, tables[-1].end[-1] if goes_on else np.full(3, np.nan)))
    return _join(tables)


def _join(tables: list[Moves]) -> Moves:
    start, end, down, rapid, cut, line, motion, chord = (
        np.concatenate([getattr(table, name) for table in tables])
        for name in ("start", "end", "down", "rapid", "cut", "line", "motion", "chord")
    )
    bulge = np.concatenate([one.plane.bulge for one in tables])
    plane = make(start[:, :2], end[:, :2], bulge, np.arange(len(bulge)))
    lost, tilted = sum(one.lost for one in tables), sum(one.tilted for one in tables)
    strokes = _strokes(down, rapid)
    return Moves(start, end, plane, down, rapid, cut, line, motion, strokes, chord, tilted, lost)


def _strokes(down: FloatArray, rapid: BoolArray) -> IntArray:
    """(N,) counts up where the tool is out of the material."""
    return np.cumsum(rapid | (down.min(axis=1, initial=np.inf) <= TOLERANCE_MM))


def _table(cut: Cut, number: int, before: FloatArray) -> Moves:
    """The motions of one cut. before: (3,) where the tool is then, NaN where that is not known."""
    columns = Columns(cut.body)
    end = columns.ends
    start = np.roll(end, 1, axis=0)
    start[:1] = before
    start = np.where(np.isnan(start), end, start)
    rapid = find_rapid(columns, cut.travel)
    line = np.asarray(cut.lines, dtype=np.int64)[columns.at]
    down = find_depths(cut, columns, start, end, rapid)
    straight = _straight_down(columns)
    known = columns.posed & straight
    row, low, high, bulge, start, end = _pieces(
        cut.tool, start, columns.vias, end, np.flatnonzero(known)
    )
    first, last = down[row].T
    with np.errstate(invalid="ignore"):
        part = np.where(np.isfinite(first) & np.isfinite(last), last - first, 0.0)
    down = np.column_stack([first + part * low, first + part * high])
    plane = make(start[:, :2], end[:, :2], bulge, np.arange(len(row)))
    many = np.full(len(row), number)
    lines = (plane.bulge == 0) & (plane.length > 0)
    chord = np.where(lines, cut.chord, 0.0)
    lost, tilted = int((~columns.posed).sum()), int((columns.posed & ~straight).sum())
    return Moves(
        start, end, plane, down, rapid[row], many, line[row], row, many, chord, tilted, lost
    )


def find_rapid(columns: Columns, travel: float) -> BoolArray:
    """(M,) whether motions are rapid: those of the joints, and lines at `travel`, mm/s."""
    fast = columns.moves_are(MoveL) & (columns.speed >= _NEARLY * travel)
    return np.asarray(columns.moves_are(MoveJ) | fast)


def find_depths(
    cut: Cut, columns: Columns, start: FloatArray, end: FloatArray, rapid: BoolArray
) -> FloatArray:
    """(M, 2) how deep the tip is at both ends, of a beam or a blade whether it is on."""
    down = -np.column_stack([start[:, 2], end[:, 2]])
    if cut.tool.kind in BEAMS:
        on = ~rapid & (
            _switched_on(columns)
            if columns.are(Output).any()
            else (down >= -TOLERANCE_MM).all(axis=1)
        )
        return np.where(on[:, None], np.inf, -np.inf) * np.ones(2)
    return np.full_like(down, -np.inf) if cut.tool.kind == "pen" else down


def _switched_on(columns: Columns) -> BoolArray:
    """(M,) whether any output is on during each motion."""
    values: dict[str, float] = {}
    at, on = [-1], [False]
    for index in np.flatnonzero(columns.are(Output)).tolist():
        item = columns.body[index]
        assert isinstance(item, Output)
        values[item.signal] = item.value
        at.append(index)
        on.append(any(values.values()))
    return np.asarray(np.array(on)[np.searchsorted(at, columns.at) - 1])


def _straight_down(columns: Columns) -> BoolArray:
    """(M,) whether the tool's axis, z of the tool, looks straight down at the end of each motion."""
    down = np.array([rotation[2, 2] <= _DOWN for rotation in columns.table], dtype=np.bool_)
    result = np.ones(len(columns.at), dtype=np.bool_)
    posed = np.flatnonzero(columns.posed)
    result[posed] = down[columns.rotation[posed]]
    return result


_Pieces = tuple[IntArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]


def _pieces(
    tool: ToolTable, start: FloatArray, via: FloatArray, end: FloatArray, rows: IntArray
) -> _Pieces:
    """Motions ``rows`` as lines and level arcs: which, from and to what fraction, bulges, starts (N, 3), ends (N, 3).

    Arcs that leave the level are chords; slanted ones of a tool that is no cylinder, short ones.
    """
    start, via, end = start[rows], via[rows], end[rows]
    curved = ~np.isnan(via[:, 0])
    flat = (
        np.abs(end[:, 2] - start[:, 2]) + np.where(curved, np.abs(via[:, 2] - start[:, 2]), 0.0)
        <= 1e-6
    )
    chords = np.flatnonzero(curved & ~flat)
    count = np.ones(len(rows), dtype=np.int64)
    span = make_spans(start, via, end)
    if len(chords):
        step = 2 * np.arccos(
            np.clip(1 - _CHORD_MM / np.maximum(span.radius[chords], 1e-9), -1.0, 1.0)
        )
        count[chords] = np.maximum(np.ceil(span.sweep[chords] / np.maximum(step, 1e-3)), 1)
    if not is_flat(tool):
        fall = np.ceil(np.abs(end[:, 2] - start[:, 2]) / _STEP_MM).astype(np.int64)
        upright = np.hypot(*(end - start)[:, :2].T) <= TOLERANCE_MM / 5
        count = np.where(upright, count, np.maximum(count, np.minimum(fall, _MOST_PIECES)))
    which, place = owners(count), ramp(count)
    low, high = place / count[which], (place + 1) / count[which]
    many = count[which] > 1
    first, last = start[which], end[which]
    first[many], last[many] = (
        span.point(low[many], which[many]),
        span.point(high[many], which[many]),
    )
    bulge = np.where(curved & flat, _bulges(start, via, end), 0.0)[which]
    return rows[which], low, high, bulge, first, last


def _bulges(start: FloatArray, via: FloatArray, end: FloatArray) -> FloatArray:
    """tan(sweep / 4) of arcs through ``via``, wherever on them that lies: the angle under which the chord is seen from
    there is half of what is left of the circle. 0 for lines.
    """
    a, b = (start - via)[:, :2], (end - via)[:, :2]
    across, along = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], (a * b).sum(axis=1)
    angle = np.arctan2(np.abs(across), along)
    with np.errstate(divide="ignore", invalid="ignore"):
        bulge = -np.sign(across) / np.tan(angle / 2)
    return np.asarray(np.nan_to_num(bulge, nan=0.0, posinf=0.0, neginf=0.0))
