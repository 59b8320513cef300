"""RAPID statements by column: motions to points that are written out, and the outputs between them.

A long program consists of these in a few spellings. The text of a file is cut at its points. The
text between two points, a gap, is read by the general rules once per spelling, and the numbers of
all points are columns. A statement in another spelling ends a sequence. The general rules read it,
and would read all statements of a sequence with the same result.
"""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from itertools import chain, compress

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.ragged import begins, offsets, ramp
from camgen.lang.columns import find_distinct, read_numbers
from camgen.lang.rapid import plain
from camgen.lang.rapid.expressions import Calls
from camgen.lang.rapid.tokens import RESERVED
from camgen.lang.rapid.tree import Calling, Inline, Numbers, Shape
from camgen.model.pose import FloatArray, to_vec3
from camgen.model.program import Indices, Mask

_NUMBER = r"-?[0-9]{1,7}(?:\.[0-9]{1,9})?"
_POSITION = re.compile(rf"{_NUMBER},{_NUMBER},{_NUMBER}")
#: Text after the position of a point up to the end of its orientation. Its numbers have too few
#: digits to be larger than a num can be. The size of a position is tested when it is read.
_TURN = re.compile(rf"\],\[({_NUMBER},{_NUMBER},{_NUMBER},{_NUMBER})\]")
_OPEN = "[["
#: Number of characters that are cut at a time. Their pieces stay in the cache of the processor.
_BLOCK = 1 << 18
#: Coordinates beyond this are read by the general rules, mm.
_LARGEST = 1e7
#: Text between the last statement of a PROC and the first one of the next, in the usual spelling.
_PARTING = re.compile(
    r"(\n *ERROR\n *RAISE;)?\n *ENDPROC(\n+)"
    r" *PROC ([A-Za-z][A-Za-z0-9_]*)\(\)\n((?: *![^\n]*\n)*) *"
)
#: Maximum number of characters of the head of a statement in the usual spelling.
_LONGEST_HEAD = 60
#: Maximum number of texts in a cache.
_CACHE_LIMIT = 10_000
_NONE = -1
_MOST_POINTS = 2
_MOTIONS = frozenset(("movej", "movel", "movec"))
_SWITCHES = frozenset(("setdo", "setao", "set", "reset"))


class _Gap(Struct, frozen=True, eq=False):
    """The text between two points.

    tail: end of a statement, empty if the statement continues after the gap.
    head: beginning of the next statement, or the continuation.
    whole: number of the shape of each statement between these, and the line ends before it.
    lines: number of line ends.
    parts: whether the next statement belongs to another routine.
    """

    tail: str
    head: str
    whole: tuple[tuple[int, int], ...]
    lines: int
    parts: bool = False


class Parting(Struct, frozen=True):
    """The text between two routines.

    name: name of the second routine.
    at: number of characters from the last point of the first routine to the second one.
    handles: whether the first routine has an ERROR handler that is RAISE alone.
    last: line ends from the last statement of the first routine to its end.
    begin: line ends from the last statement of the first routine to the second one.
    lines: number of line ends.
    """

    name: str
    at: int
    handles: bool
    last: int
    begin: int
    lines: int


#: Text after the position of a point: number of the quaternion, number of the gap, characters of
#: the quaternion; and the text between two routines, None inside a routine.
_Follower = tuple[tuple[int, int, int], Parting | None]


class Spellings:
    """The spellings of a program, each read once.

    shapes: shapes of statements.
    turns: quaternions.
    gaps: texts between points.
    """

    def __init__(self, grammar: Callable[[str, int], Calls]) -> None:
        self.shapes: list[Shape] = []
        self.turns: list[Numbers] = []
        self.gaps: list[_Gap] = []
        self._grammar = grammar
        self._shapes: dict[tuple[str, ...], int] = {}
        self._turns: dict[str, int] = {}
        self._gap_of: dict[str, int] = {}
        self._parted: dict[tuple[str, str], int] = {}
        self._followers: dict[str, _Follower] = {}

    def list_followers(
        self, texts: Sequence[str]
    ) -> tuple[NDArray[np.int32], Indices, Indices, dict[int, Parting]]:
        """Reads N texts from the end of the position of a point to the next point.

        Returns four values:
        (N,) numbers of the quaternions, -1 if the text does not end a point;
        (N,) numbers of the gaps, -1 if they are not usual;
        (N,) characters of the quaternions;
        the texts between two routines, by index.
        """
        distinct, number = find_distinct(texts)
        followers = [self._followers.get(text) or self._read_follower(text) for text in distinct]
        rows = np.array([row for row, _ in followers], np.intp).reshape(-1, 3)[number]
        parts = np.array([parting is not None for _, parting in followers], np.bool_)[number]
        partings: dict[int, Parting] = {}
        for index in np.flatnonzero(parts).tolist():
            parting = followers[number[index]][1]
            if parting is not None:
                partings[index] = parting
        return rows[:, 0].astype(np.int32), rows[:, 1], rows[:, 2], partings

    def _read_follower(self, text: str) -> _Follower:
        turn = _TURN.match(text)
        if turn is None:
            return (_NONE, _NONE, 0), None
        number, rest = self._turn(turn[1]), text[turn.end() :]
        gap = self._gap_of.get(rest, _NONE)
        parting = None
        if gap < 0:
            parted = _find_parting(rest)
            if parted is None:
                gap = self._gap(rest)
            else:
                gap = self._part(rest[: parted.start()], rest[parted.end() :])
                is_usual = gap >= 0 and parted[3].lower() not in RESERVED
                parting = _parting(parted) if is_usual else None
                gap = gap if parting else _NONE
        follower = (number, gap, turn.end()), parting
        if parting is None and gap >= 0 and len(self._followers) < _CACHE_LIMIT:
            self._followers[text] = follower
        return follower

    def _turn(self, text: str) -> int:
        number = self._turns.get(text)
        if number is None:
            number = self._turns[text] = len(self.turns)
            w, x, y, z = map(float, text.split(","))
            self.turns.append((w, x, y, z))
        return number

    def shape(self, *parts: str) -> int:
        """The number of the shape of a statement with points between `parts`.

        It is -1 for a statement that is not read by column. This includes motions whose first point
        is in another line than their name.
        """
        number = self._shapes.get(parts)
        if number is None:
            number = _NONE
            shape = plain.shape_of(self._grammar, *parts)
            if shape is not None and _is_by_column(shape, parts):
                number = len(self.shapes)
                self.shapes.append(shape)
            if number >= 0 or len(self._shapes) < _CACHE_LIMIT:
                self._shapes[parts] = number
        return number

    def _gap(self, text: str) -> int:
        """The number of the gap between two points of a routine, -1 if it is not usual."""
        left, end, head = text.rpartition(";")
        number = self._read(left + end, head, parts=False)
        if number >= 0:
            self._gap_of[text] = number
        return number

    def _part(self, left: str, right: str) -> int:
        """The number of the gap between the last point of a routine and the first one of the next.

        It is -1 if the gap is not usual.
        """
        number = self._parted.get((left, right), _NONE)
        if number < 0 and left.endswith(";") and ";" not in right and "\n" not in right:
            number = self._read(left, right, parts=True)
            if number >= 0:
                self._parted[left, right] = number
        return number

    def _read(self, left: str, head: str, *, parts: bool) -> int:
        if _is_odd(left) or _is_odd(head):
            return _NONE
        tail, *whole = left.split(";")[: left.count(";")] or [""]
        statements = []
        lines = tail.count("\n")
        for statement in whole:
            shape = self.shape(statement + ";")
            if shape < 0:
                return _NONE
            statements.append((shape, lines + self.shapes[shape].lead))
            lines += statement.count("\n")
        tail = tail + ";" if left else ""
        self.gaps.append(_Gap(tail, head, tuple(statements), lines + head.count("\n"), parts))
        return len(self.gaps) - 1


def _is_by_column(shape: Shape, parts: Sequence[str]) -> bool:
    """Whether a statement with points between `parts` is read by column."""
    if len(parts) == 1:
        return shape.name in _SWITCHES
    return shape.name in _MOTIONS and shape.lead == parts[0].count("\n")


def _is_odd(text: str) -> bool:
    """Whether a text may have a comment, a string, or the begin or end of a routine."""
    return "PROC" in text or "!" in text or '"' in text


def _find_parting(text: str) -> re.Match[str] | None:
    """The first end of a routine after a statement that ends a line, None without one."""
    end = text.find(";\n")
    while end >= 0:
        match = _PARTING.match(text, end + 1)
        if match is not None:
            return match
        end = text.find(";\n", end + 1)
    return None


def _parting(match: re.Match[str]) -> Parting:
    handles, blank, name, remarks = match.groups()
    last = 3 if handles else 1
    begin = last + len(blank)
    at = match.start(3) - len("PROC ")
    return Parting(name, at, bool(handles), last, begin, begin + 1 + remarks.count("\n"))


class Columns(Struct, frozen=True, eq=False):
    """R rows of statements.

    shape: (R,) numbers of shapes in `Spellings`.
    line: (R,) lines, from 1.
    point: (R,) index of the target, -1 for a statement that does not move.
    """

    shape: NDArray[np.int32]
    line: NDArray[np.int32]
    point: NDArray[np.int32]

    def take(self, rows: Indices) -> Columns:
        """A selection of the rows."""
        return Columns(self.shape[rows], self.line[rows], self.point[rows])


class Rows:
    """The statements of a file, which move to P points.

    columns: rows of the statements. They exist after the whole file was read.
    points: (P, 3) positions, mm.
    turn: (P,) numbers of the quaternions in `spellings`.
    spellings: spellings of the program.
    """

    columns: Columns

    def __init__(self, points: FloatArray, turn: NDArray[np.int32], spellings: Spellings) -> None:
        self.points, self.turn, self.spellings = points, turn, spellings

    def statement(self, row: int) -> Inline | Calling:
        """One row as a statement."""
        columns = self.columns
        shape = self.spellings.shapes[columns.shape[row]]
        line, point = int(columns.line[row]), int(columns.point[row])
        if point < 0:
            return Calling(line, shape.name, shape.args, shape.options)
        position = to_vec3(self.points[point])
        turn = self.spellings.turns[self.turn[point]]
        if len(shape.points) == 1:
            return Inline(line, shape, position, turn)
        via, via_turn = to_vec3(self.points[point - 1]), self.turn[point - 1]
        return Inline(line, shape, position, turn, via, self.spellings.turns[via_turn])


class Run(Struct, frozen=True, eq=False):
    """Consecutive statements: the rows `first` to before `last` of a file."""

    rows: Rows
    first: int
    last: int


class StatementRun(Struct, frozen=True, eq=False):
    """Consecutive statements in the usual spelling, with their end.

    run: statements.
    end: offset of the text after them.
    line: line of their end.
    stop: index of the last motion.
    """

    run: Run
    end: int
    line: int
    stop: int


class PartedRoutine(Struct, frozen=True, eq=False):
    """A routine that another one in the usual spelling follows.

    run: all statements of the routine.
    handles: whether it has an ERROR handler that is RAISE alone.
    last: line of its end.
    name: name of the next routine.
    line: line of the next routine.
    start: offset of the next routine.
    statements: first statements of the next routine, None if they are not read by column.
    """

    run: Run
    handles: bool
    last: int
    name: str
    line: int
    start: int
    statements: StatementRun | None


class Cut:
    """The text of a file, cut at its P points into S motions and the gaps between points.

    text: text of the file.
    spellings: spellings of the program.
    rows: statements of the file.
    line_ends: number of line ends of the file.
    """

    def __init__(self, text: str, first_line: int, spellings: Spellings) -> None:
        self.text, self.spellings = text, spellings
        points = _find_points(text, spellings)
        self.rows = Rows(points.points, points.turn, spellings)
        self._starts, self._ends = points.starts.tolist(), points.ends.tolist()
        self._gap_numbers, self._partings = points.gaps, points.partings
        is_odd = points.gaps < 0
        spans = zip([0, *self._ends], [*self._starts, len(text)], strict=True)
        lines = self._of_gaps([gap.lines for gap in spellings.gaps])
        lines[is_odd] = [text.count("\n", *span) for span in compress(spans, is_odd.tolist())]
        parting_lines = [parting.lines for parting in self._partings.values()]
        lines[list(self._partings)] += np.array(parting_lines, np.intp)
        passed = np.cumsum(lines)
        self.line_ends = int(passed[-1])
        self._line = first_line + passed[:-1]
        continues = self._of_gaps([not gap.tail for gap in spellings.gaps]) > 0
        self._last: Indices = np.flatnonzero(~continues[1:])
        self._first: Indices = np.append(0, self._last[:-1] + 1)[: len(self._last)]
        self._first_points: list[int] = self._first.tolist()
        self._shape = self._find_shapes()
        after = self._last + 1
        parts = self._of_gaps([gap.parts for gap in spellings.gaps]) > 0
        has_next = np.append(self._shape[1:], _NONE) >= 0
        is_joined = ~is_odd[after] & ~parts[after] & has_next
        stops = np.flatnonzero(~is_joined)
        self._counts = 1 + self._of_gaps([len(gap.whole) for gap in spellings.gaps])[after]
        # Lists, of which single elements are read faster than of arrays.
        self._stop: list[int] = stops[np.searchsorted(stops, np.arange(len(after)))].tolist()
        self._last_of: list[int] = self._last.tolist()
        self._row: list[int] = begins(self._counts).tolist()
        self._line_of: list[int] = self._line.tolist()

    def _of_gaps(self, values: Sequence[int]) -> Indices:
        """Selects values of gaps, by number, for the P + 1 gaps of the text; 0 for unusual gaps."""
        return np.array([*values, 0], np.intp)[self._gap_numbers]

    def _find_shapes(self) -> Indices:
        """The shapes of the S motions, (S,), -1 for those that are not usual."""
        gaps, first, last = self._gap_numbers, self._first, self._last
        shape = np.full(len(last), _NONE)
        count = len(self.spellings.gaps) + 1
        middle = np.where(last > first, gaps[last], count - 1)
        has_head = (gaps[first] >= 0) & (middle >= 0) & (last - first < _MOST_POINTS)
        has_tail = gaps[last + 1] >= 0
        rows = np.flatnonzero(has_head & has_tail)
        keys = (gaps[first[rows]] * count + middle[rows]) * count + gaps[last[rows] + 1]
        _, distinct, back = np.unique(keys, return_index=True, return_inverse=True)
        distinct_rows = rows[distinct].tolist()
        distinct_shapes = [self._shape_of(row, self._head(row)) for row in distinct_rows]
        shape[rows] = np.array(distinct_shapes, np.intp)[back]
        for row in np.flatnonzero(has_head & ~has_tail).tolist():
            shape[row] = self._shape_of(row, self._head(row))
        return shape

    def _head(self, statement: int) -> str:
        return self.spellings.gaps[int(self._gap_numbers[self._first[statement]])].head

    def _tail(self, statement: int) -> str:
        last = int(self._last[statement])
        number = int(self._gap_numbers[last + 1])
        if number >= 0:
            return self.spellings.gaps[number].tail
        begin, end = self._ends[last], [*self._starts[last + 1 : last + 2], len(self.text)][0]
        return self.text[begin : self.text.find(";", begin, end) + 1]

    def _shape_of(self, statement: int, head: str) -> int:
        first, last = int(self._first[statement]), int(self._last[statement])
        tail = self._tail(statement)
        if not tail or last - first >= _MOST_POINTS:
            return _NONE
        numbers = self._gap_numbers[first + 1 : last + 1].tolist()
        inside = [self.spellings.gaps[number].head for number in numbers]
        return self.spellings.shape(head, *inside, tail)

    def run(self, start: int) -> StatementRun | None:
        """The statements from an offset on, None if the first one is not read by column."""
        point = bisect_left(self._starts, start)
        statement = bisect_left(self._first_points, point)
        if statement == len(self._first_points) or self._first_points[statement] != point:
            return None
        head = self.text[start : self._starts[point]]
        if len(head) > _LONGEST_HEAD or ";" in head or "!" in head or '"' in head:
            return None
        shape = self._shape_of(statement, head)
        if shape < 0:
            return None
        self._shape[statement] = shape
        return self._run_from(statement)

    def _run_from(self, statement: int) -> StatementRun:
        stop = self._stop[statement]
        last, tail = self._last_of[stop], self._tail(stop)
        run = Run(self.rows, self._row[statement], self._row[stop] + 1)
        line = self._line_of[last] + tail.count("\n")
        return StatementRun(run, self._ends[last] + len(tail), line, stop)

    def parted(self, statements: StatementRun) -> PartedRoutine | None:
        """The routine of `statements`, None if no other routine in the usual spelling follows."""
        last = self._last_of[statements.stop]
        parting = self._partings.get(last + 1)
        if parting is None:
            return None
        gap = self.spellings.gaps[self._gap_numbers[last + 1]]
        line, after = self._line_of[last] + gap.lines, statements.stop + 1
        run = statements.run
        return PartedRoutine(
            run=Run(self.rows, run.first, run.last + len(gap.whole)),
            handles=parting.handles,
            last=line + parting.last,
            name=parting.name,
            line=line + parting.begin,
            start=self._ends[last] + parting.at,
            statements=self._run_from(after) if self._shape[after] >= 0 else None,
        )

    def close(self) -> None:
        """Sets the columns of the rows, after the whole file was read."""
        last, gaps = self._last, self.spellings.gaps
        rank = ramp(self._counts)
        statement = np.repeat(np.arange(len(last)), self._counts)
        is_motion = rank == 0
        shape, line = self._shape[statement], self._line[self._first][statement]
        statements = chain.from_iterable(gap.whole for gap in gaps)
        whole = np.array(list(statements), np.intp).reshape(-1, 2)
        before = offsets([len(gap.whole) for gap in gaps])
        others = np.flatnonzero(~is_motion)
        ends = last[statement[others]]
        number, lines = whole[before[self._gap_numbers[ends + 1]] + rank[others] - 1].T
        shape[others], line[others] = number, self._line[ends] + lines
        columns = (shape, line, np.where(is_motion, last[statement], _NONE))
        self.rows.columns = Columns(*(column.astype(np.int32) for column in columns))


class _Points(Struct, frozen=True, eq=False):
    """The P points of a text.

    starts: (P,) offsets of the points.
    ends: (P,) offsets of the text after their orientations.
    points: (P, 3) positions, mm.
    turn: (P,) numbers of the quaternions.
    gaps: (P + 1,) numbers of the gaps before, between and after the points, -1 for unusual ones. A
        block of text has no gap before its first point.
    partings: texts between routines, by index in `gaps`.
    """

    starts: Indices
    ends: Indices
    points: FloatArray
    turn: NDArray[np.int32]
    gaps: Indices
    partings: dict[int, Parting]


def _find_points(text: str, spellings: Spellings) -> _Points:
    """Reads the points of a text that are written out."""
    first = text.find(_OPEN)
    texts = _cut_blocks(text, first) if first >= 0 else ()
    blocks = [_find_block(block, offset, spellings) for block, offset in texts]
    if not blocks:
        empty = np.zeros(0, np.intp)
        return _Points(
            empty, empty, np.zeros((0, 3)), empty.astype(np.int32), np.array([_NONE]), {}
        )
    partings: dict[int, Parting] = {}
    size = 0
    for block in blocks:
        for k, parting in block.partings.items():
            partings[size + k] = parting
        size += len(block.starts)
    starts = np.concatenate([block.starts for block in blocks])
    ends = np.concatenate([block.ends for block in blocks])
    points = np.concatenate([block.points for block in blocks])
    turn = np.concatenate([block.turn for block in blocks])
    gaps = np.concatenate([block.gaps for block in blocks])
    rows = np.flatnonzero(turn >= 0)
    # A gap is usual only between two points. The text before the first point and after the last one
    # is not a gap, nor is the text before a bracket that only begins like a point.
    is_followed = np.append(rows[1:] == rows[:-1] + 1, False)[: len(rows)]
    numbers = np.append(_NONE, np.where(is_followed, gaps[rows], _NONE))
    index = np.zeros(len(turn), np.intp)
    index[rows[is_followed]] = np.flatnonzero(is_followed) + 1
    indices = index[list(partings)].tolist()
    parted = {k: parting for k, parting in zip(indices, partings.values(), strict=True) if k}
    return _Points(starts[rows], ends[rows], points[rows], turn[rows], numbers, parted)


def _cut_blocks(text: str, first: int) -> Iterator[tuple[str, int]]:
    """Cuts a text from an offset on into blocks that begin like a point, each with its offset."""
    while first < len(text):
        end = text.find(_OPEN, first + _BLOCK)
        end = len(text) if end < 0 else end
        yield text[first:end], first
        first = end


def _find_block(text: str, offset: int, spellings: Spellings) -> _Points:
    """Reads all texts of a block that begin like a point, and the gaps after them.

    The number of the quaternion is -1 for a text that is not a point.
    """
    _, *pieces = text.split(_OPEN)
    cuts = [piece.find("]") for piece in pieces]
    positions = [piece[:cut] for piece, cut in zip(pieces, cuts, strict=True)]
    followers = [piece[cut:] for piece, cut in zip(pieces, cuts, strict=True)]
    sizes = np.fromiter(map(len, pieces), np.intp, len(pieces)) + len(_OPEN)
    starts = offset + np.cumsum(sizes) - sizes
    turn, gaps, lengths, partings = spellings.list_followers(followers)
    position_lengths = np.fromiter(map(len, positions), np.intp, len(positions))
    ends = starts + len(_OPEN) + position_lengths + lengths
    rows = np.flatnonzero(turn >= 0)
    points = np.zeros((len(positions), 3))
    if len(rows) < len(positions):
        positions = [positions[row] for row in rows.tolist()]
    points[rows], is_usual = read_positions(positions)
    turn[rows[~is_usual]] = _NONE
    return _Points(starts, ends, points, turn, gaps, partings)


def read_positions(texts: Sequence[str]) -> tuple[FloatArray, Mask]:
    """The positions (N, 3) of N texts, mm, and which texts are in the usual spelling (N,)."""
    whole = ";".join(texts)
    data = whole.encode("ascii", "replace")
    # Numbers of JSON that consist of digits, points and signs are RAPID numbers of the same value.
    if data.translate(None, b"0123456789.-") == b",,;" * (len(texts) - 1) + b",,":
        numbers = read_numbers(data.replace(b";", b","))
        if numbers is not None and np.abs(numbers).max() < _LARGEST:
            return numbers.reshape(-1, 3), np.ones(len(texts), np.bool_)
    is_usual = np.array([_POSITION.fullmatch(text) is not None for text in texts], np.bool_)
    points = np.zeros((len(texts), 3))
    for row in np.flatnonzero(is_usual).tolist():
        points[row] = list(map(float, texts[row].split(",")))
    return points, is_usual
