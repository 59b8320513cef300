"""RAPID statements by column: motions to points that are written out, and the outputs between them.

A long program consists of these in a few spellings. The text of a file is cut at its points. The
text after a point up to the next one, a gap, is read by the general rules once per spelling, and
the numbers of all points are columns. A statement in another spelling ends a sequence. The general
rules read it, and would read all statements of a sequence with the same result.
"""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Callable, Collection, Iterator, Sequence
from itertools import chain

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.ragged import compute_first_rows, compute_offsets, number_rows
from camgen.lang.columns import find_distinct, read_numbers
from camgen.model.pose import FloatArray, to_vec3
from camgen.model.program import Indices, Mask

from .expressions import Calls
from .tokens import RESERVED, Wrong
from .tree import Calling, Inline, Numbers, Point, Routine, Run, Shape

_NUMBER = r"-?[0-9]{1,7}(?:\.[0-9]{1,9})?"
_POSITION = re.compile(rf"{_NUMBER},{_NUMBER},{_NUMBER}")
#: Text after the position of a point up to the end of its orientation. Its numbers have too few
#: digits to be larger than a num can be. The size of a position is tested when it is read.
_TURN = re.compile(rf"\],\[({_NUMBER},{_NUMBER},{_NUMBER},{_NUMBER})\]")
_OPEN = "[["
_NEEDS_RULES = re.compile(r"\"|\(|\[\[")
_ANY_POINT = "[[0,0,0],[1,0,0,0]"
#: Number of characters that are cut at a time. Their pieces stay in the cache of the processor.
_BLOCK = 1 << 18
#: Coordinates beyond this are read by the general rules, mm.
_LARGEST = 1e7
#: Text between the last statement of a PROC and the first one of the next, in the usual spelling.
_PARTING = re.compile(
    r"(?<=;)(\n *ERROR\n *RAISE;)?\n *ENDPROC(\n+)"
    r" *PROC ([A-Za-z][A-Za-z0-9_]*)\(\)\n((?: *![^\n]*\n)*)(?=[^;\n]*\Z)"
)
#: The end of a PROC after its last statement, in the usual spelling.
_END = re.compile(r"(\n *ERROR\n *RAISE;)?\n *ENDPROC\b")
#: Maximum number of characters of the head of a statement in the usual spelling.
_LONGEST_HEAD = 60
#: Maximum number of texts in a cache.
_CACHE_LIMIT = 10_000
_NONE = -1
_MOST_POINTS = 2
_SWITCHES = frozenset(("setdo", "setao", "set", "reset"))
#: Statements of a long program: it moves and switches.
_FREE = _SWITCHES | {"movej", "movel", "movec"}


class _Gap(Struct, frozen=True, eq=False):
    """The text after a point up to the next one.

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
    parts: bool


class _Parting(Struct, frozen=True):
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
_Follower = tuple[tuple[int, int, int], _Parting | None]


class Spellings:
    """The spellings of a program, each read once.

    shapes: shapes of statements.
    turns: quaternions.
    gaps: texts after points.
    """

    def __init__(
        self, grammar: Callable[[str, int], Calls], names: Collection[str] | None = None
    ) -> None:
        """Begins without spellings.

        grammar: the general rules.
        names: names of statements that may be read by column, in lower case. None: all names.
        """
        self.shapes: list[Shape] = []
        self.turns: list[Numbers] = []
        self.gaps: list[_Gap] = []
        self._grammar, self._names = grammar, names
        self._shapes: dict[tuple[str, ...], int] = {}
        self._turns: dict[str, int] = {}
        self._gap_of: dict[tuple[str, str, bool], int] = {}
        self._followers: dict[str, _Follower] = {}

    def list_followers(
        self, texts: Sequence[str]
    ) -> tuple[NDArray[np.int32], Indices, Indices, dict[int, _Parting]]:
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
        partings: dict[int, _Parting] = {}
        for index in np.flatnonzero(parts).tolist():
            parting = followers[number[index]][1]
            if parting is not None:
                partings[index] = parting
        return rows[:, 0].astype(np.int32), rows[:, 1], rows[:, 2], partings

    def _read_follower(self, text: str) -> _Follower:
        turn = _TURN.match(text)
        if turn is None:
            return (_NONE, _NONE, 0), None
        rest = text[turn.end() :]
        parting = None
        parted = _PARTING.search(rest) if "ENDPROC" in rest else None
        if parted is None:
            left, end, head = rest.rpartition(";")
            gap = self._gap(left + end, head, parts=False)
        else:
            gap = self._gap(rest[: parted.start()], rest[parted.end() :], parts=True)
            if gap >= 0:
                parting = _read_parting(parted)
                if parting.name.lower() in RESERVED:
                    gap = _NONE
        follower = (self._turn(turn[1]), gap, turn.end()), parting
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

        It is -1 for a statement that is not read by column.
        """
        number = self._shapes.get(parts)
        if number is None:
            number = _NONE
            shape = _read_shape(self._grammar, *parts)
            if shape is not None and self._is_by_column(shape, len(parts) - 1):
                number = len(self.shapes)
                self.shapes.append(shape)
            if number >= 0 or len(self._shapes) < _CACHE_LIMIT:
                self._shapes[parts] = number
        return number

    def _is_by_column(self, shape: Shape, points: int) -> bool:
        if points == 0:
            return shape.name in _SWITCHES
        return self._names is None or shape.name in self._names

    def _gap(self, left: str, head: str, *, parts: bool) -> int:
        """The number of the gap of some statements and the head of the next one.

        It is -1 if the gap is not usual.
        left: text up to the last semicolon, empty if a statement continues after the gap.
        """
        number = self._gap_of.get((left, head, parts), _NONE)
        if number >= 0 or _is_odd(left) or _is_odd(head):
            return number
        tail, *whole = left.split(";")[: left.count(";")] or [""]
        name = head.lstrip() if left else head
        if left and "\n" in name:
            return _NONE
        statements = []
        lines = tail.count("\n")
        for statement in whole:
            shape = self.shape(statement + ";")
            if shape < 0:
                return _NONE
            statements.append((shape, lines + self.shapes[shape].lead))
            lines += statement.count("\n")
        if left:
            tail += ";"
        number = self._gap_of[left, head, parts] = len(self.gaps)
        self.gaps.append(_Gap(tail, name, tuple(statements), lines + head.count("\n"), parts))
        return number


def _read_shape(grammar: Callable[[str, int], Calls], *parts: str) -> Shape | None:
    """The shape of a statement that has points between `parts`, None if it needs the general rules.

    A string may hold a semicolon, a function remembers its line, and a point that is not cut out
    has two brackets.
    """
    count = len(parts) - 1
    if _NEEDS_RULES.search("".join(parts)):
        return None
    parser = grammar(_ANY_POINT.join(parts), 0)
    if parser.token[0] != "name" or parser.word() in RESERVED:
        return None
    try:
        call = parser.statement_call()
    except Wrong:
        return None
    rests = [arg.value[2:] for arg in call.args[:count] if isinstance(arg, Point)]
    if len(rests) < count:
        return None
    return Shape(call.name, tuple(rests), call.args[count:], call.options, call.line)


def _is_odd(text: str) -> bool:
    """Whether a text may have a comment, a string, or the begin or end of a routine."""
    return "PROC" in text or "!" in text or '"' in text


def _read_parting(match: re.Match[str]) -> _Parting:
    handles, blank, name, remarks = match.groups()
    last = 3 if handles else 1
    begin = last + len(blank)
    at = match.start(3) - len("PROC ")
    return _Parting(name, at, bool(handles), last, begin, begin + 1 + remarks.count("\n"))


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


class Rows:
    """The text of a file, cut at its P points into S statements, and others between them.

    spellings: spellings of the program.
    points: (P, 3) positions, mm.
    turn: (P,) numbers of the quaternions in `spellings`, -1 for a text that only begins like a
        point.
    columns: rows of the statements.
    """

    def __init__(self, text: str, first_line: int, spellings: Spellings) -> None:
        self._text, self.spellings = text, spellings
        points, self._partings = _find_points(text, spellings)
        starts, ends, self.points, self.turn, self._gaps = points
        # Lists, of which single elements are read faster than of arrays.
        self._starts, self._ends = starts.tolist(), ends.tolist()
        self._gap_of: list[int] = self._gaps.tolist()
        line = first_line + np.cumsum(self._count_lines()[:-1])
        self._line_of: list[int] = line.tolist()
        ends_statement = self._of_gaps([bool(gap.tail) for gap in spellings.gaps], other=1) > 0
        ends_statement[-1:] = True
        last: Indices = np.flatnonzero(ends_statement)
        first: Indices = np.append(0, last[:-1] + 1)[: len(last)]
        self._last_of: list[int] = last.tolist()
        self._first_of: list[int] = first.tolist()
        shape = self._find_shapes(first, last)
        is_free = np.array([shape.name in _FREE for shape in spellings.shapes] + [False])[shape]
        is_joined = self._of_gaps([not gap.parts for gap in spellings.gaps])[last] > 0
        is_joined[:-1] &= (shape[1:] >= 0) & (is_free[1:] == is_free[:-1])
        is_joined[-1:] = False
        stops = np.flatnonzero(~is_joined)
        counts = 1 + self._of_gaps([len(gap.whole) for gap in spellings.gaps])[last]
        self._shape_of, self._is_free = shape, is_free
        self._stop: list[int] = stops[np.searchsorted(stops, np.arange(len(last)))].tolist()
        self._row: list[int] = compute_first_rows(counts).tolist()
        self.columns = self._make_columns(shape, counts, line[first], last, line[last])

    def _of_gaps(self, values: Sequence[int], other: int = 0) -> Indices:
        """Selects values of gaps, by number, for the P points; `other` for unusual gaps."""
        return np.array([*values, other], np.intp)[self._gaps]

    def _count_lines(self) -> Indices:
        """The line ends before the first point, and after each point up to the next, (P + 1,)."""
        text, starts = self._text, [*self._starts, len(self._text)]
        lines = self._of_gaps([gap.lines for gap in self.spellings.gaps])
        for point in np.flatnonzero(self._gaps < 0).tolist():
            lines[point] = text.count("\n", self._ends[point], starts[point + 1])
        parting_lines = [parting.lines for parting in self._partings.values()]
        lines[list(self._partings)] += np.array(parting_lines, np.intp)
        return np.append(text.count("\n", 0, starts[0]), lines)

    def _find_shapes(self, first: Indices, last: Indices) -> Indices:
        """The shapes of the S statements, (S,), -1 for those that are not read by column.

        first, last: (S,) the points of each statement.
        """
        before = np.append(_NONE, self._gaps[:-1])[first]
        middle, after = self._gaps[first], self._gaps[last]
        shape = np.full(len(last), _NONE)
        is_short = (last - first < _MOST_POINTS) & (self.turn[first] >= 0) & (self.turn[last] >= 0)
        is_usual = is_short & (before >= 0) & (after >= 0)
        rows = np.flatnonzero(is_usual)
        count = len(self.spellings.gaps) + 1
        keys = (before[rows] * count + middle[rows]) * count + after[rows]
        _, distinct, back = np.unique(keys, return_index=True, return_inverse=True)
        shapes = [self.spellings.shape(*self._parts(row)) for row in rows[distinct].tolist()]
        shape[rows] = np.array(shapes, np.intp)[back]
        for row in np.flatnonzero(is_short & ~is_usual).tolist():
            shape[row] = self.spellings.shape(*self._parts(row))
        return shape

    def _parts(self, statement: int) -> list[str]:
        first, last = self._first_of[statement], self._last_of[statement]
        middle = [self.spellings.gaps[number].head for number in self._gap_of[first:last]]
        return [self._head(first), *middle, self._tail(last)]

    def _head(self, point: int) -> str:
        number = self._gap_of[point - 1] if point else _NONE
        if number >= 0:
            return self.spellings.gaps[number].head
        end = self._starts[point]
        begin = max(self._ends[point - 1] if point else 0, end - _LONGEST_HEAD)
        return self._text[begin:end].rpartition("\n")[2].rpartition(";")[2].lstrip()

    def _tail(self, point: int) -> str:
        number = self._gap_of[point]
        if number >= 0:
            return self.spellings.gaps[number].tail
        begin, is_last = self._ends[point], point + 1 == len(self._starts)
        end = len(self._text) if is_last else self._starts[point + 1]
        return self._text[begin : self._text.find(";", begin, end) + 1]

    def _make_columns(
        self, shape: Indices, counts: Indices, line: Indices, last: Indices, last_line: Indices
    ) -> Columns:
        """The rows of the statements with points, each with those that follow it.

        counts: (S,) number of rows of each statement.
        line, last_line: (S,) lines of the first and of the last point.
        """
        gaps = self.spellings.gaps
        statement, rank = np.repeat(np.arange(len(last)), counts), number_rows(counts)
        shape, line = shape[statement], line[statement]
        statements = chain.from_iterable(gap.whole for gap in gaps)
        whole = np.array(list(statements), np.intp).reshape(-1, 2)
        before = compute_offsets([len(gap.whole) for gap in gaps])
        others = np.flatnonzero(rank)
        owner = statement[others]
        number, lines = whole[before[self._gaps[last[owner]]] + rank[others] - 1].T
        shape[others], line[others] = number, last_line[owner] + lines
        columns = (shape, line, np.where(rank == 0, last[statement], _NONE))
        return Columns(*(column.astype(np.int32) for column in columns))

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

    def run(self, start: int) -> StatementRun | None:
        """The statements from an offset on, None if the first one is not read by column."""
        point = bisect_left(self._starts, start)
        if point == len(self._starts) or self._starts[point] - start > _LONGEST_HEAD:
            return None
        statement = bisect_left(self._first_of, point)
        if self._shape_of[statement] < 0 or self._first_of[statement] != point:
            return None
        is_head = start + len(self._head(point)) == self._starts[point]
        return self._run_from(statement) if is_head else None

    def _run_from(self, statement: int) -> StatementRun:
        stop = self._stop[statement]
        last, tail = self._last_of[stop], self._tail(self._last_of[stop])
        run = Run(self, self._row[statement], self._row[stop] + 1, bool(self._is_free[stop]))
        line = self._line_of[last] + tail.count("\n")
        return StatementRun(run, self._ends[last] + len(tail), line, stop)

    def read_routines(self, name: str, line: int, start: int) -> tuple[list[Routine], int, int]:
        """Consecutive PROCs in the usual spelling, and the offset and the line of their end.

        name, line: name and line of the first PROC.
        start: offset of its first statement.
        """
        routines: list[Routine] = []
        statements = self.run(start)
        while statements is not None:
            last, after, run = self._last_of[statements.stop], statements.stop + 1, statements.run
            parting = self._partings.get(last)
            if parting is None or after == len(self._last_of):
                break
            gap = self.spellings.gaps[self._gap_of[last]]
            run = Run(self, run.first, run.last + len(gap.whole), run.is_free)
            end = self._line_of[last] + gap.lines
            routines.append(_make_routine(name, line, run, parting.handles, end + parting.last))
            name, line, start = parting.name, end + parting.begin, self._ends[last] + parting.at
            statements = self._run_from(after) if self._shape_of[after] >= 0 else None
        if statements is not None and (match := _END.match(self._text, statements.end)):
            end = statements.line + match[0].count("\n")
            routines.append(_make_routine(name, line, statements.run, bool(match[1]), end))
            line, start = end, match.end()
        return routines, start, line


def _make_routine(name: str, line: int, run: Run, handles: bool, last: int) -> Routine:
    handler = (Calling(last - 1, "raise"),) if handles else None
    return Routine(line, name, False, (), (run,), handler, last=last)


#: The P texts of a file that begin like a point: (P,) offsets; (P,) offsets of the text after their
#: orientations, the first ones without one; (P, 3) positions, mm; (P,) numbers of the quaternions,
#: -1 for a text that only begins like a point; (P,) numbers of the gaps after them, -1 for unusual
#: ones.
_Points = tuple[Indices, Indices, FloatArray, NDArray[np.int32], Indices]


def _find_points(text: str, spellings: Spellings) -> tuple[_Points, dict[int, _Parting]]:
    """The texts of a file that begin like a point, and the texts between routines by index."""
    blocks: list[_Points] = []
    partings: dict[int, _Parting] = {}
    size = 0
    for block, offset in _cut_blocks(text):
        points, block_partings = _find_block(block, offset, spellings)
        partings |= {size + index: parting for index, parting in block_partings.items()}
        size += len(points[0])
        blocks.append(points)
    starts, ends, positions, turn, gaps = map(np.concatenate, zip(*blocks, strict=True))
    return (starts, ends, positions, turn, gaps), partings


def _cut_blocks(text: str) -> Iterator[tuple[str, int]]:
    """Cuts a text into blocks that begin like a point, each with its offset, one at least."""
    start = 0
    while start == 0 or start < len(text):
        end = text.find(_OPEN, start + _BLOCK)
        end = len(text) if end < 0 else end
        yield text[start:end], start
        start = max(end, 1)


def _find_block(
    text: str, offset: int, spellings: Spellings
) -> tuple[_Points, dict[int, _Parting]]:
    """The texts of a block that begin like a point, and the texts between routines."""
    before, *pieces = text.split(_OPEN)
    cuts = [piece.find("]") for piece in pieces]
    positions = [piece[:cut] for piece, cut in zip(pieces, cuts, strict=True)]
    followers = [piece[cut:] for piece, cut in zip(pieces, cuts, strict=True)]
    sizes = np.fromiter(map(len, pieces), np.intp, len(pieces)) + len(_OPEN)
    starts = offset + len(before) + np.cumsum(sizes) - sizes
    turn, gaps, lengths, partings = spellings.list_followers(followers)
    rows = np.flatnonzero(turn >= 0)
    points = np.zeros((len(positions), 3))
    if len(rows) < len(positions):
        positions = [positions[row] for row in rows.tolist()]
    points[rows], is_usual = read_positions(positions)
    turn[rows[~is_usual]] = _NONE
    is_point = turn >= 0
    ends = starts + np.where(
        is_point, len(_OPEN) + np.fromiter(cuts, np.intp, len(cuts)) + lengths, 0
    )
    gaps[~is_point] = _NONE
    partings = {index: parting for index, parting in partings.items() if is_point[index]}
    return (starts, ends, points, turn, gaps), partings


def read_positions(texts: Sequence[str]) -> tuple[FloatArray, Mask]:
    """The positions (N, 3) of N texts, mm, and which texts are in the usual spelling (N,)."""
    data = ";".join(texts).encode("ascii", "replace")
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
