"""RAPID statements by column: motions to points that are written out, and the outputs between them.

A long program is made of these in a few spellings. The text of a file is cut at its points; what stands between two of
them is read by the general rules once for each spelling, and the numbers of all points are columns. What is spelled
otherwise ends a run of statements and is read by the general rules, which say the same of all that is read here.
"""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from itertools import compress

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.ragged import begins, offsets, ramp
from camgen.lang.columns import find_distinct, read_numbers
from camgen.lang.rapid import plain
from camgen.lang.rapid.expressions import Calls
from camgen.lang.rapid.tokens import RESERVED
from camgen.lang.rapid.tree import Call, Inline, Numbers, Shape
from camgen.model.pose import FloatArray, to_vec3
from camgen.model.program import Indices, Mask

_NUMBER = r"-?[0-9]{1,7}(?:\.[0-9]{1,9})?"
_PLACE = re.compile(rf"{_NUMBER},{_NUMBER},{_NUMBER}")
#: What follows the position of a point up to the end of its orientation. So few digits cannot make a number that is
#: larger than a num can be; those of a position are looked at when it is read.
_TURN = re.compile(rf"\],\[({_NUMBER},{_NUMBER},{_NUMBER},{_NUMBER})\]")
_OPEN = "[["
#: So many characters are cut at a time: what they are cut into stays in the processor's cache.
_BLOCK = 1 << 18
#: mm: a position with one beyond this is not read here.
_FARTHEST = 1e7
#: Between the last statement of a PROC, in the usual spelling, and the first one of the next.
_PARTING = re.compile(
    r"(\n *ERROR\n *RAISE;)?\n *ENDPROC(\n+) *PROC ([A-Za-z][A-Za-z0-9_]*)\(\)\n((?: *![^\n]*\n)*) *"
)
#: Longer than any head of a statement that is spelled as usual.
_LONGEST_HEAD = 60
#: So many texts are remembered.
_MOST_KNOWN = 10_000
_NONE = -1
_MOST_POINTS = 2
_MOTIONS = frozenset(("movej", "movel", "movec"))
_SWITCHES = frozenset(("setdo", "setao", "set", "reset"))


class _Between(Struct, frozen=True, eq=False):
    """What stands between two points. tail: the end of a statement, empty where it goes on; head: the beginning of the
    next one, or what goes on. whole: the statements between these by number, each with the line ends before it. lines:
    line ends of all these. parts: whether the next statement is one of another routine.
    """

    tail: str
    head: str
    whole: tuple[tuple[int, int], ...]
    lines: int
    parts: bool = False


class Parting(Struct, frozen=True):
    """What stands between two routines. name: of the second, which begins ``at`` so many characters behind the last
    point of the first. handles: whether the first hands errors on. last, begin: line ends from the last statement of
    the first to its end, and to the beginning of the second. lines: line ends of all.
    """

    name: str
    at: int
    handles: bool
    last: int
    begin: int
    lines: int


#: What follows the position of a point: the numbers of its turn and of what is between, the length of the turn; and
#: what parts routines.
_Behind = tuple[tuple[int, int, int], Parting | None]


class Spellings:
    """The spellings that a program has, each read once. shapes: of statements."""

    def __init__(self, grammar: Callable[[str, int], Calls]) -> None:
        self.shapes: list[Shape] = []
        self.turns: list[Numbers] = []
        self.between: list[_Between] = []
        self._grammar = grammar
        self._shapes: dict[tuple[str, ...], int] = {}
        self._turns: dict[str, int] = {}
        self._known: dict[str, int] = {}
        self._parted: dict[tuple[str, str], int] = {}
        self._behind: dict[str, _Behind] = {}

    def list_behind(
        self, texts: Sequence[str]
    ) -> tuple[NDArray[np.int32], Indices, Indices, dict[int, Parting]]:
        """Of texts from behind the position of a point to the next one: the numbers of the quaternions, -1 where none
        ends the point; the numbers of what is between, -1 where that is not as usual; the lengths of the rest of the
        points; and by their places those that part two routines.
        """
        distinct, number = find_distinct(texts)
        read = [self._behind.get(text) or self._read_behind(text) for text in distinct]
        rows = np.array([row for row, _ in read], np.intp).reshape(-1, 3)[number]
        parts = np.array([parting is not None for _, parting in read], np.bool_)[number]
        partings = {
            place: parting
            for place in np.flatnonzero(parts).tolist()
            if (parting := read[number[place]][1]) is not None
        }
        return rows[:, 0].astype(np.int32), rows[:, 1], rows[:, 2], partings

    def _read_behind(self, text: str) -> _Behind:
        turn = _TURN.match(text)
        if turn is None:
            return (_NONE, _NONE, 0), None
        number, rest = self._turn(turn[1]), text[turn.end() :]
        between = self._known.get(rest, _NONE)
        parting = None
        if between < 0:
            parted = _find_parting(rest)
            if parted is None:
                between = self._between(rest)
            else:
                between = self._part(rest[: parted.start()], rest[parted.end() :])
                parting = None if between < 0 or parted[3].lower() in RESERVED else _parting(parted)
                between = between if parting else _NONE
        found = (number, between, turn.end()), parting
        if parting is None and between >= 0 and len(self._behind) < _MOST_KNOWN:
            self._behind[text] = found
        return found

    def _turn(self, text: str) -> int:
        number = self._turns.get(text)
        if number is None:
            number = self._turns[text] = len(self.turns)
            w, x, y, z = map(float, text.split(","))
            self.turns.append((w, x, y, z))
        return number

    def shape(self, *parts: str) -> int:
        """The number of the shape of a statement with points between ``parts``; -1: none that is read here, or one
        whose first point is in another line than its name.
        """
        known = self._shapes.get(parts)
        if known is None:
            shape = plain.shape_of(self._grammar, *parts)
            known = _NONE
            read = _MOTIONS if len(parts) > 1 else _SWITCHES
            if (
                shape is not None
                and shape.name in read
                and (read is _SWITCHES or shape.lead == parts[0].count("\n"))
            ):
                known = len(self.shapes)
                self.shapes.append(shape)
            if known >= 0 or len(self._shapes) < _MOST_KNOWN:
                self._shapes[parts] = known
        return known

    def _between(self, text: str) -> int:
        """The number of what stands between two points of a routine."""
        left, end, head = text.rpartition(";")
        known = self._read(left + end, head, parts=False)
        if known >= 0:
            self._known[text] = known
        return known

    def _part(self, left: str, right: str) -> int:
        """The number of what stands between the last point of a routine and the first one of the next."""
        known = self._parted.get((left, right), _NONE)
        if known < 0 and left.endswith(";") and ";" not in right and "\n" not in right:
            known = self._read(left, right, parts=True)
            if known >= 0:
                self._parted[left, right] = known
        return known

    def _read(self, left: str, head: str, *, parts: bool) -> int:
        if _is_odd(left) or _is_odd(head):
            return _NONE
        tail, *whole = left.split(";")[: left.count(";")] or [""]
        found = []
        lines = tail.count("\n")
        for one in whole:
            shape = self.shape(one + ";")
            if shape < 0:
                return _NONE
            found.append((shape, lines + self.shapes[shape].lead))
            lines += one.count("\n")
        self.between.append(
            _Between(
                tail + ";" if left else "", head, tuple(found), lines + head.count("\n"), parts
            )
        )
        return len(self.between) - 1


def _is_odd(text: str) -> bool:
    """Whether a text may hold the begin or the end of a routine, a remark or a string."""
    return "PROC" in text or "!" in text or '"' in text


def _find_parting(text: str) -> re.Match[str] | None:
    """The first one behind a statement that ends a line."""
    end = text.find(";\n")
    while end >= 0 and (found := _PARTING.match(text, end + 1)) is None:
        end = text.find(";\n", end + 1)
    return found if end >= 0 else None


def _parting(found: re.Match[str]) -> Parting:
    handles, blank, name, remarks = found.groups()
    last = 3 if handles else 1
    begin = last + len(blank)
    at = found.start(3) - len("PROC ")
    return Parting(name, at, bool(handles), last, begin, begin + 1 + remarks.count("\n"))


class Columns(Struct, frozen=True, eq=False):
    """Rows of statements, (R,) each. shape: by number in ``Spellings``. line: 1-based. point: to which it moves, -1: to
    none.
    """

    shape: NDArray[np.int32]
    line: NDArray[np.int32]
    point: NDArray[np.int32]

    def take(self, rows: Indices) -> Columns:
        """Some of the rows."""
        return Columns(self.shape[rows], self.line[rows], self.point[rows])


class Rows:
    """Statements of one file, R of them, that move to P points. Columns are there when all of the file is read.

    points: (P, 3) mm. turn: (P,) of their quaternions, by number in ``spellings``.
    """

    columns: Columns

    def __init__(self, points: FloatArray, turn: NDArray[np.int32], spellings: Spellings) -> None:
        self.points, self.turn, self.spellings = points, turn, spellings

    def statement(self, row: int) -> Inline | Call:
        """One row as a statement."""
        columns = self.columns
        shape, line, point = (
            self.spellings.shapes[columns.shape[row]],
            int(columns.line[row]),
            int(columns.point[row]),
        )
        if point < 0:
            return Call(line, shape.name, shape.args, shape.options)
        place = to_vec3(self.points[point])
        turn = self.spellings.turns[self.turn[point]]
        if len(shape.points) == 1:
            return Inline(line, shape, place, turn)
        before, turn_before = to_vec3(self.points[point - 1]), self.turn[point - 1]
        return Inline(line, shape, place, turn, before, self.spellings.turns[turn_before])


class Run(Struct, frozen=True, eq=False):
    """Statements one after the other: the rows ``first`` to before ``last`` of a file."""

    rows: Rows
    first: int
    last: int


class Found(Struct, frozen=True, eq=False):
    """A run of statements. end: the offset behind it, line: of its end. stop: the last of those that move."""

    run: Run
    end: int
    line: int
    stop: int


class Parted(Struct, frozen=True, eq=False):
    """The end of a routine and the begin of the next one. run: all statements of the first. handles: whether it hands
    errors on. last: the line of its end. name, line, start: of the next, start: its offset. found: the run that this
    begins with, None where its statements are not read here.
    """

    run: Run
    handles: bool
    last: int
    name: str
    line: int
    start: int
    found: Found | None


class Cut:
    """The text of one file, cut at its P points: S statements that move, with what stands between them. line_ends: how
    many it has.
    """

    def __init__(self, text: str, first_line: int, spellings: Spellings) -> None:
        self.text, self.spellings = text, spellings
        found = _find_points(text, spellings)
        self.rows = Rows(found.points, found.turn, spellings)
        self._starts, self._ends = found.starts.tolist(), found.ends.tolist()
        self._between, self._partings = found.between, found.partings
        between = found.between
        odd = np.flatnonzero(between < 0)
        gaps = zip([0, *self._ends], [*self._starts, len(text)], strict=True)
        lines = self._of_between([one.lines for one in spellings.between])
        lines[odd] = [text.count("\n", *gap) for gap in compress(gaps, (between < 0).tolist())]
        lines[list(self._partings)] += np.array(
            [one.lines for one in self._partings.values()], np.intp
        )
        passed = np.cumsum(lines)
        self.line_ends = int(passed[-1])
        self._line = first_line + passed[:-1]
        goes_on = self._of_between([not one.tail for one in spellings.between]) > 0
        self._last: Indices = np.flatnonzero(~goes_on[1:])
        self._first: Indices = np.append(0, self._last[:-1] + 1)[: len(self._last)]
        self._begun: list[int] = self._first.tolist()
        self._shape = self._find_shapes()
        behind = self._last + 1
        parts = self._of_between([one.parts for one in spellings.between]) > 0
        on = (between[behind] >= 0) & ~parts[behind] & (np.append(self._shape[1:], _NONE) >= 0)
        stops = np.flatnonzero(~on)
        self._counts = 1 + self._of_between([len(one.whole) for one in spellings.between])[behind]
        # The same for each statement or point, as lists, which are faster to look into one by one.
        self._stop: list[int] = stops[np.searchsorted(stops, np.arange(len(on)))].tolist()
        self._last_of: list[int] = self._last.tolist()
        self._row: list[int] = begins(self._counts).tolist()
        self._line_of: list[int] = self._line.tolist()

    def _of_between(self, values: Sequence[int]) -> Indices:
        """(P + 1,): what is known of the texts between points, by their numbers; 0 where one is not as usual."""
        return np.array([*values, 0], np.intp)[self._between]

    def _find_shapes(self) -> Indices:
        """(S,): the shapes of the statements that begin as usual, -1 of others and where there is none."""
        spellings, between = self.spellings, self._between
        first, last = self._first, self._last
        shape = np.full(len(last), _NONE)
        count = len(spellings.between) + 1
        middle = np.where(last > first, between[last], count - 1)
        begun = (between[first] >= 0) & (middle >= 0) & (last - first < _MOST_POINTS)
        ended = between[last + 1] >= 0
        rows = np.flatnonzero(begun & ended)
        keys = (between[first[rows]] * count + middle[rows]) * count + between[last[rows] + 1]
        _, one, back = np.unique(keys, return_index=True, return_inverse=True)
        shape[rows] = np.array(
            [self._shape_of(k, self._head(k)) for k in rows[one].tolist()], np.intp
        )[back]
        odd = np.flatnonzero(begun & ~ended)
        shape[odd] = [self._shape_of(k, self._head(k)) for k in odd.tolist()]
        return shape

    def _head(self, statement: int) -> str:
        return self.spellings.between[int(self._between[self._first[statement]])].head

    def _tail(self, statement: int) -> str:
        last = int(self._last[statement])
        number = int(self._between[last + 1])
        if number >= 0:
            return self.spellings.between[number].tail
        begin, end = self._ends[last], [*self._starts[last + 1 : last + 2], len(self.text)][0]
        return self.text[begin : self.text.find(";", begin, end) + 1]

    def _shape_of(self, statement: int, head: str) -> int:
        first, last = int(self._first[statement]), int(self._last[statement])
        tail = self._tail(statement)
        inside = [self.spellings.between[self._between[k]].head for k in range(first + 1, last + 1)]
        return (
            self.spellings.shape(head, *inside, tail)
            if tail and last - first < _MOST_POINTS
            else _NONE
        )

    def run(self, start: int) -> Found | None:
        """The statements from the offset ``start`` on, where one begins; None where that one is not read here."""
        point = bisect_left(self._starts, start)
        statement = bisect_left(self._begun, point)
        if statement == len(self._begun) or self._begun[statement] != point:
            return None
        head = self.text[start : self._starts[point]]
        if len(head) > _LONGEST_HEAD or ";" in head or "!" in head or '"' in head:
            return None
        shape = self._shape_of(statement, head)
        if shape < 0:
            return None
        self._shape[statement] = shape
        return self._found(statement)

    def _found(self, statement: int) -> Found:
        stop = self._stop[statement]
        last, tail = self._last_of[stop], self._tail(stop)
        run = Run(self.rows, self._row[statement], self._row[stop] + 1)
        return Found(
            run, self._ends[last] + len(tail), self._line_of[last] + tail.count("\n"), stop
        )

    def parted(self, found: Found) -> Parted | None:
        """What stands between a routine of the run ``found`` and the next one; None where that is not as usual."""
        last = self._last_of[found.stop]
        parting = self._partings.get(last + 1)
        if parting is None:
            return None
        known = self.spellings.between[self._between[last + 1]]
        line, after = self._line_of[last] + known.lines, found.stop + 1
        return Parted(
            Run(self.rows, found.run.first, found.run.last + len(known.whole)),
            parting.handles,
            line + parting.last,
            parting.name,
            line + parting.begin,
            self._ends[last] + parting.at,
            self._found(after) if self._shape[after] >= 0 else None,
        )

    def close(self) -> None:
        """Gives the rows their columns, when all runs are known."""
        last, known = self._last, self.spellings.between
        rank = ramp(self._counts)
        statement = np.repeat(np.arange(len(last)), self._counts)
        moves = rank == 0
        shape, line = self._shape[statement], self._line[self._first][statement]
        whole = np.array([each for one in known for each in one.whole], np.intp).reshape(-1, 2)
        before = offsets([len(one.whole) for one in known])
        others = np.flatnonzero(~moves)
        ends = last[statement[others]]
        number, lines = whole[before[self._between[ends + 1]] + rank[others] - 1].T
        shape[others], line[others] = number, self._line[ends] + lines
        columns = (shape, line, np.where(moves, last[statement], _NONE))
        self.rows.columns = Columns(*(column.astype(np.int32) for column in columns))


class _Points(Struct, frozen=True, eq=False):
    """The P points of a text. starts, ends: (P,) the offsets of each, ends: behind its orientation. points: (P, 3) mm.
    turn: (P,) by number. between: (P + 1,) what stands before, between and behind them, by number, -1: not as usual;
    partings: that between routines, by its place there.
    """

    starts: Indices
    ends: Indices
    points: FloatArray
    turn: NDArray[np.int32]
    between: Indices
    partings: dict[int, Parting]


def _find_points(text: str, spellings: Spellings) -> _Points:
    """The points of a text that are written out."""
    first = text.find(_OPEN)
    blocks = (
        [_find_some(*block, spellings) for block in _cut_blocks(text, first)] if first >= 0 else []
    )
    if not blocks:
        none = np.zeros(0, np.intp)
        return _Points(none, none, np.zeros((0, 3)), none.astype(np.int32), np.array([_NONE]), {})
    size, before = 0, []
    for block in blocks:
        before.append(size)
        size += len(block.starts)
    starts, ends, points, turn, between = (
        np.concatenate([getattr(block, name) for block in blocks])
        for name in ("starts", "ends", "points", "turn", "between")
    )
    partings = {
        k + at: one
        for block, at in zip(blocks, before, strict=True)
        for k, one in block.partings.items()
    }
    read = np.flatnonzero(turn >= 0)
    # Before the first point and behind the last one stands what is no end of a statement and beginning of another; as
    # behind one that is followed by what only begins like a point.
    followed = np.append(read[1:] == read[:-1] + 1, False)[: len(read)]
    known = np.append(_NONE, np.where(followed, between[read], _NONE))
    place = np.zeros(len(turn), np.intp)
    place[read[followed]] = np.flatnonzero(followed) + 1
    parted = {
        at: parting
        for at, parting in zip(place[list(partings)].tolist(), partings.values(), strict=True)
        if at
    }
    return _Points(starts[read], ends[read], points[read], turn[read], known, parted)


def _cut_blocks(text: str, first: int) -> Iterator[tuple[str, int]]:
    """The text from ``first`` on in blocks, each with its offset, that begin like a point."""
    while first < len(text):
        end = text.find(_OPEN, first + _BLOCK)
        end = len(text) if end < 0 else end
        yield text[first:end], first
        first = end


def _find_some(text: str, offset: int, spellings: Spellings) -> _Points:
    """What begins like a point in a block of text, with what follows it; -1 for the turn where that is none."""
    _, *pieces = text.split(_OPEN)
    cuts = [piece.find("]") for piece in pieces]
    places = [piece[:at] for piece, at in zip(pieces, cuts, strict=True)]
    behind = [piece[at:] for piece, at in zip(pieces, cuts, strict=True)]
    sizes = np.fromiter(map(len, pieces), np.intp, len(pieces)) + len(_OPEN)
    starts = offset + np.cumsum(sizes) - sizes
    turn, between, rest, partings = spellings.list_behind(behind)
    ends = starts + len(_OPEN) + np.fromiter(map(len, places), np.intp, len(places)) + rest
    read = np.flatnonzero(turn >= 0)
    points = np.zeros((len(places), 3))
    points[read], sound = _read_places(
        places if len(read) == len(places) else [places[k] for k in read.tolist()]
    )
    turn[read[~sound]] = _NONE
    return _Points(starts, ends, points, turn, between, partings)


def _read_places(texts: Sequence[str]) -> tuple[FloatArray, Mask]:
    """The positions (N, 3) that texts say, mm, and which of them are three numbers in the usual spelling."""
    whole = ";".join(texts)
    data = whole.encode("ascii", "replace")
    # Three numbers each of digits, points and signs that are numbers in JSON: RAPID takes them too, and for the same.
    if data.translate(None, b"0123456789.-") == b",,;" * (len(texts) - 1) + b",,":
        numbers = read_numbers(data.replace(b";", b","))
        if numbers is not None and np.abs(numbers).max() < _FARTHEST:
            return numbers.reshape(-1, 3), np.ones(len(texts), np.bool_)
    sound = np.fromiter(
        (_PLACE.fullmatch(text) is not None for text in texts), np.bool_, len(texts)
    )
    points = np.zeros((len(texts), 3))
    points[sound] = [
        list(map(float, text.split(","))) for text in compress(texts, sound.tolist())
    ] or np.zeros((0, 3))
    return points, sound
