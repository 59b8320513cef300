"""The motions of programs as they were read back: a table of paths, depths and tools."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from msgspec import Struct

from camgen.check.stock.profile import BEAMS, is_flat
from camgen.geometry.arcs import make_spans
from camgen.geometry.ragged import list_owners, number_rows
from camgen.geometry.segments import BoolArray, IntArray, Segments, make_segments, split_segments
from camgen.model.job import ToolTable
from camgen.model.pose import FloatArray
from camgen.model.program import Columns, Instruction, MoveJ, MoveL, Output

#: mm: rounding of heights and depths. A gouge that is no deeper does not count.
TOLERANCE_MM = 0.005
#: mm: maximum deviation of the chords that replace an arc that is not level.
_CHORD_MM = 0.002
#: A sloping motion of a tool that is not a cylinder is divided into pieces of at most this height,
#: mm, but at most this number of pieces.
_STEP_MM, _MAX_PIECES = 0.005, 2000
#: Fraction of the travel speed from which on a line is rapid. A speed is printed with few digits,
#: or as a fraction of another one.
_NEARLY = 0.99
#: Largest z of the tool axis, as a unit vector, that is straight down.
_DOWN = -1 + 1e-7


class Stated(Struct, frozen=True):
    """The feeds and speeds that a job states for a tool.

    feed: largest feed of the tool's centre, mm/s.
    plunge: largest feed straight down, mm/s.
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
    travel: speed from which on a line is a rapid motion, mm/s; infinite for a controller with rapid
        motions.
    chord: distance by which lines that stand for an arc may leave it between their ends, mm.
    corner: distance by which the controller may round corners, mm.
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
    """N motions of all cuts in order of time. A motion with an unknown start starts at its end.

    start: (N, 3) start of the tip, mm.
    end: (N, 3) end of the tip, mm.
    plane: the motions seen from above.
    down: (N, 2) depth of the tip below the top face at both ends, mm; inf for a beam that is on,
        -inf for a beam that is off.
    rapid: (N,) whether a motion is rapid.
    cut: (N,) number of its cut.
    line: (N,) line of the text, from 1.
    motion: (N,) number of the motion in the columns of its cut, from 0.
    stroke: (N,) number of motions out of the material until then.
    chord: (N,) distance by which a line may leave the arc for which it stands, mm.
    tilted: number of motions with a tilted tool. They are left out.
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
        """Largest depth of each motion below the top face, (N,) mm."""
        return np.asarray(self.down.max(axis=1))

    @cached_property
    def level(self) -> BoolArray:
        """Whether the tip stays at one depth, (N,)."""
        with np.errstate(invalid="ignore"):
            change = np.abs(self.down[:, 1] - self.down[:, 0])
        return np.asarray(~(change > TOLERANCE_MM / 5))

    @cached_property
    def upright(self) -> BoolArray:
        """Whether the motion goes straight up or down, or nowhere, (N,)."""
        return np.asarray(self.plane.length <= TOLERANCE_MM / 5)

    @cached_property
    def rising(self) -> BoolArray:
        """Whether the motion goes straight up, (N,); it removes nothing."""
        return np.asarray(self.upright & (self.down[:, 1] <= self.down[:, 0]))

    def below(self, depth: float, rows: IntArray | None = None) -> Portions:
        """Return the parts of motions that run deeper than `depth` mm.

        rows: (K,) motions; None: all.
        """
        rows = np.arange(len(self)) if rows is None else rows
        rows = rows[self.deepest[rows] > depth]
        first, last = self.down[rows].T
        with np.errstate(invalid="ignore", divide="ignore"):
            at = np.clip((depth - first) / (last - first), 0.0, 1.0)
        low, high = np.where(first > depth, 0.0, at), np.where(last > depth, 1.0, at)
        return Portions(rows, low, high, split_segments(self.plane, rows, low, high))


class Portions(Struct, frozen=True, eq=False):
    """K parts of motions.

    row: (K,) index of the motion.
    low: (K,) start of the part, as a fraction of the motion.
    high: (K,) end of the part, as a fraction of the motion.
    plane: the parts seen from above.
    """

    row: IntArray
    low: FloatArray
    high: FloatArray
    plane: Segments


def tabulate(cuts: Sequence[Cut]) -> Moves:
    """Make one table of all motions of `cuts`, in their order.

    The tool starts at the last end of the cut before it in the same file, or at an unknown point.
    """
    tables: list[Moves] = []
    for number, cut in enumerate(cuts):
        before = np.full(3, np.nan)
        if number > 0 and cuts[number - 1].file == cut.file and len(tables[-1]) > 0:
            before = tables[-1].end[-1]
        tables.append(_tabulate_cut(cut, number, before))
    return _join(tables)


def _join(tables: list[Moves]) -> Moves:
    joined = {}
    for column in ("start", "end", "down", "rapid", "cut", "line", "motion", "chord"):
        joined[column] = np.concatenate([getattr(table, column) for table in tables])
    bulge = np.concatenate([table.plane.bulge for table in tables])
    start, end, low = joined["start"], joined["end"], joined["down"].min(axis=1, initial=np.inf)
    return Moves(
        **joined,
        plane=make_segments(start[:, :2], end[:, :2], bulge, np.arange(len(bulge))),
        stroke=np.cumsum(joined["rapid"] | (low <= TOLERANCE_MM)),
        tilted=sum(table.tilted for table in tables),
        lost=sum(table.lost for table in tables),
    )


def _tabulate_cut(cut: Cut, number: int, before: FloatArray) -> Moves:
    """Make the table of one cut.

    before: (3,) position of the tool before it, mm; NaN if it is unknown.
    """
    columns = Columns(cut.body)
    end = columns.ends
    start = np.roll(end, 1, axis=0)
    start[:1] = before
    start = np.where(np.isnan(start), end, start)
    rapid = find_rapid(columns, cut.travel)
    line = np.asarray(cut.lines, dtype=np.int64)[columns.at]
    down = find_depths(cut, columns, start, end, rapid)
    straight = _are_straight_down(columns)
    known = np.flatnonzero(columns.posed & straight)
    row, low, high, bulge, start, end = _divide(cut.tool, start, columns.vias, end, known)
    first, last = down[row].T
    with np.errstate(invalid="ignore"):
        part = np.where(np.isfinite(first) & np.isfinite(last), last - first, 0.0)
    down = np.column_stack([first + part * low, first + part * high])
    plane = make_segments(start[:, :2], end[:, :2], bulge, np.arange(len(row)))
    lines = (plane.bulge == 0) & (plane.length > 0)
    return Moves(
        start=start,
        end=end,
        plane=plane,
        down=down,
        rapid=rapid[row],
        cut=np.full(len(row), number),
        line=line[row],
        motion=row,
        stroke=np.zeros(len(row), np.int64),
        chord=np.where(lines, cut.chord, 0.0),
        tilted=int((columns.posed & ~straight).sum()),
        lost=int((~columns.posed).sum()),
    )


def find_rapid(columns: Columns, travel: float) -> BoolArray:
    """Whether motions (M,) are rapid: joint motions, and lines at `travel` mm/s."""
    fast = columns.moves_are(MoveL) & (columns.speed >= _NEARLY * travel)
    return np.asarray(columns.moves_are(MoveJ) | fast)


def find_depths(
    cut: Cut, columns: Columns, start: FloatArray, end: FloatArray, rapid: BoolArray
) -> FloatArray:
    """Compute the depth of the tip at both ends (M, 2), see `Moves.down`.

    A beam or a blade is on if any output is on. In a program without outputs it is on below the top
    face.
    """
    down = -np.column_stack([start[:, 2], end[:, 2]])
    if cut.tool.kind == "pen":
        return np.full_like(down, -np.inf)
    if cut.tool.kind not in BEAMS:
        return down
    has_outputs = columns.are(Output).any()
    on = _are_switched_on(columns) if has_outputs else (down >= -TOLERANCE_MM).all(axis=1)
    return np.where((on & ~rapid)[:, None], np.inf, -np.inf) * np.ones(2)


def _are_switched_on(columns: Columns) -> BoolArray:
    values: dict[str, float] = {}
    at, on = [-1], [False]
    for index in np.flatnonzero(columns.are(Output)).tolist():
        item = columns.body[index]
        assert isinstance(item, Output)
        values[item.signal] = item.value
        at.append(index)
        on.append(any(values.values()))
    return np.asarray(np.array(on)[np.searchsorted(at, columns.at) - 1])


def _are_straight_down(columns: Columns) -> BoolArray:
    down = np.array([rotation[2, 2] <= _DOWN for rotation in columns.table], dtype=np.bool_)
    result = np.ones(len(columns.at), dtype=np.bool_)
    posed = np.flatnonzero(columns.posed)
    result[posed] = down[columns.rotation[posed]]
    return result


_Pieces = tuple[IntArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]


def _divide(
    tool: ToolTable, start: FloatArray, via: FloatArray, end: FloatArray, rows: IntArray
) -> _Pieces:
    """Divide the motions `rows` into lines and level arcs.

    Other arcs become chords. Sloping motions of a tool that is not a cylinder become short pieces.

    Returns for each piece its motion, start and end as fractions of it, bulge, start (N, 3) and end
    (N, 3).
    """
    start, via, end = start[rows], via[rows], end[rows]
    curved = ~np.isnan(via[:, 0])
    via_rise = np.where(curved, np.abs(via[:, 2] - start[:, 2]), 0.0)
    flat = np.abs(end[:, 2] - start[:, 2]) + via_rise <= 1e-6
    chords = np.flatnonzero(curved & ~flat)
    count = np.ones(len(rows), dtype=np.int64)
    span = make_spans(start, via, end)
    if len(chords):
        cosine = np.clip(1 - _CHORD_MM / np.maximum(span.radius[chords], 1e-9), -1.0, 1.0)
        step = 2 * np.arccos(cosine)
        count[chords] = np.maximum(np.ceil(span.sweep[chords] / np.maximum(step, 1e-3)), 1)
    if not is_flat(tool):
        fall = np.ceil(np.abs(end[:, 2] - start[:, 2]) / _STEP_MM).astype(np.int64)
        upright = np.hypot(*(end - start)[:, :2].T) <= TOLERANCE_MM / 5
        count = np.where(upright, count, np.maximum(count, np.minimum(fall, _MAX_PIECES)))
    which, index = list_owners(count), number_rows(count)
    low, high = index / count[which], (index + 1) / count[which]
    divided = count[which] > 1
    first, last = start[which], end[which]
    first[divided] = span.point(low[divided], which[divided])
    last[divided] = span.point(high[divided], which[divided])
    bulge = np.where(curved & flat, _compute_bulges(start, via, end), 0.0)[which]
    return rows[which], low, high, bulge, first, last


def _compute_bulges(start: FloatArray, via: FloatArray, end: FloatArray) -> FloatArray:
    """Compute tan(sweep / 4) of arcs through any point `via`; 0 for lines.

    The chord is seen from `via` under half of the angle of the rest of the circle.
    """
    a, b = (start - via)[:, :2], (end - via)[:, :2]
    across, along = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], (a * b).sum(axis=1)
    angle = np.arctan2(np.abs(across), along)
    with np.errstate(divide="ignore", invalid="ignore"):
        bulge = -np.sign(across) / np.tan(angle / 2)
    return np.asarray(np.nan_to_num(bulge, nan=0.0, posinf=0.0, neginf=0.0))
