"""RAPID statements by column: motions to points that are written out, and the outputs between them.

A long program is made of these in a few spellings. The text of a file is cut at its points; what stands between two of
them is read by the general rules once for each spelling, and the numbers of all points are columns. What is spelled
otherwise ends a run of statements and is read by the general rules, which say the same of all that is read here.
"""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Callable

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.ragged import begins, ramp
from camgen.model.pose import FloatArray
from camgen.model.program import Indices
from camgen.read.rapid import plain
from camgen.read.rapid.expressions import Calls
from camgen.read.rapid.tree import Call, Inline, Numbers, Shape

#: So few digits cannot make a number that is larger than a num can be.
_NUMBER = r"-?[0-9]{1,7}(?:\.[0-9]{1,9})?"
_POINT = re.compile(rf"\[\[({_NUMBER},{_NUMBER},{_NUMBER})\],\[({_NUMBER},{_NUMBER},{_NUMBER},{_NUMBER})\]")
#: The characters of a point beside its two groups.
_BRACKETS = len("[[],[]")
#: Longer than any head of a statement that is spelled as usual.
_LONGEST_HEAD = 60
_NONE = -1
_MOST_POINTS = 2
_MOTIONS = frozenset(("movej", "movel", "movec"))
_SWITCHES = frozenset(("setdo", "setao", "set", "reset"))


class _Between(Struct, frozen=True, eq=False):
    """What stands between two points. tail: the end of a statement, empty where it goes on; head: the beginning of the
    next one, or what goes on. whole: the statements between these by number, each with the line ends before it. lines:
    line ends of all.
    """

    tail: str
    head: str
    whole: tuple[tuple[int, int], ...]
    lines: int


class Spellings:
    """The spellings that a program has, each read once. shapes: of statements."""

    def __init__(self, grammar: Callable[[str, int], Calls]) -> None:
        self.shapes: list[Shape] = []
        self.turns: list[Numbers] = []
        self.between: list[_Between] = []
        self._grammar = grammar
        self._known: dict[str, int] = {}
        self._shapes: dict[tuple[str, ...], int] = {}
        self._turns: dict[str, int] = {}

    def list_between(self, texts: list[str]) -> Indices:
        """The numbers of texts between points, -1 where one is not as usual."""
        found = [self._between(text) if known is None else known for text, known in self._look_up(texts)]
        return np.array(found, np.intp)

    def _look_up(self, texts: list[str]) -> zip[tuple[str, int | None]]:
        return zip(texts, map(self._known.get, texts), strict=True)

    def list_turns(self, texts: list[str]) -> NDArray[np.int32]:
        """The numbers of quaternions."""
        for text in set(texts):
            if text not in self._turns:
                self._turns[text] = len(self.turns)
                w, x, y, z = map(float, text.split(","))
                self.turns.append((w, x, y, z))
        return np.fromiter(map(self._turns.__getitem__, texts), np.int32, len(texts))

    def shape(self, *parts: str) -> int:
        """The number of the shape of a statement with points between ``parts``; -1: none that is read here, or one
        whose first point is in another line than its name.
        """
        known = self._shapes.get(parts)
        if known is None:
            shape = plain.shape_of(self._grammar, *parts)
            known = _NONE
            read = _MOTIONS if len(parts) > 1 else _SWITCHES
            if shape is not None and shape.name in read and (read is _SWITCHES or shape.lead == parts[0].count("\n")):
                known = len(self.shapes)
                self.shapes.append(shape)
            if known >= 0 or len(self._shapes) < 10_000:
                self._shapes[parts] = known
        return known

    def _between(self, text: str) -> int:
        if "PROC" in text or "!" in text or '"' in text:
            return _NONE
        tail, *whole, head = text.split(";") if ";" in text else ("", text)
        found = []
        lines = tail.count("\n")
        for one in whole:
            shape = self.shape(one + ";")
            if shape < 0:
                return _NONE
            found.append((shape, lines + self.shapes[shape].lead))
            lines += one.count("\n")
        number = self._known[text] = len(self.between)
        end = tail + ";" if ";" in text else ""
        self.between.append(_Between(end, head, tuple(found), text.count("\n")))
        return number


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
        shape, line, point = self.spellings.shapes[columns.shape[row]], int(columns.line[row]), int(columns.point[row])
        if point < 0:
            return Call(line, shape.name, shape.args, shape.options)
        x, y, z = self.points[point].tolist()
        turn = self.spellings.turns[self.turn[point]]
        if len(shape.points) == 1:
            return Inline(line, shape, (x, y, z), turn)
        u, v, w = self.points[point - 1].tolist()
        return Inline(line, shape, (x, y, z), turn, (u, v, w), self.spellings.turns[self.turn[point - 1]])


class Run(Struct, frozen=True, eq=False):
    """Statements one after the other: the rows ``first`` to before ``last`` of a file."""

    rows: Rows
    first: int
    last: int


class Cut:
    """The text of one file, cut at its P points: S statements that move, with what stands between them."""

    def __init__(self, text: str, first_line: int, spellings: Spellings) -> None:
        cut = _POINT.split(text)
        betweens, places, turns = cut[::3], cut[1::3], cut[2::3]
        self.text, self.spellings = text, spellings
        flat = map(float, ",".join(places).split(",")) if places else ()
        points = np.fromiter(flat, np.float64, 3 * len(places)).reshape(-1, 3)
        self.rows = Rows(points, spellings.list_turns(turns), spellings)
        # Before the first point and behind the last one stands what is no end of a statement and beginning of another.
        inner = spellings.list_between(betweens[1:-1])
        between = np.concatenate([[_NONE], inner, [_NONE]])[: len(places) + 1].astype(np.intp)
        odd = np.flatnonzero(between < 0)
        lines = np.array([*(one.lines for one in spellings.between), 0], np.intp)[between]
        lines[odd] = [betweens[k].count("\n") for k in odd.tolist()]
        self._line = first_line + np.cumsum(lines)[:-1]
        sizes = [np.fromiter(map(len, texts), np.intp, len(texts)) for texts in (betweens, places, turns)]
        inside = sizes[1] + sizes[2] + _BRACKETS
        starts = np.cumsum(sizes[0][:-1]) + np.cumsum(inside) - inside
        self._starts, self._ends = starts.tolist(), (starts + inside).tolist()
        goes_on = np.array([*(not one.tail for one in spellings.between), False], np.bool_)[between]
        self._last: Indices = np.flatnonzero(~goes_on[1:])
        self._first: Indices = np.append(0, self._last[:-1] + 1)[: len(self._last)]
        self._begun: list[int] = self._first.tolist()
        self._between = between
        self._ends_odd: dict[int, str] = {k - 1: betweens[k][: betweens[k].find(";") + 1] for k in odd.tolist() if k}
        self._shape = self._find_shapes()
        on = (between[self._last + 1] >= 0) & (np.append(self._shape[1:], _NONE) >= 0)
        stops = np.flatnonzero(~on)
        self._stop = stops[np.searchsorted(stops, np.arange(len(on)))]
        whole = np.array([*(len(one.whole) for one in spellings.between), 0], np.intp)
        self._counts = 1 + whole[between[self._last + 1]]
        self._begins = begins(self._counts)

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
        shape[rows] = np.array([self._shape_of(k, self._head(k)) for k in rows[one].tolist()], np.intp)[back]
        odd = np.flatnonzero(begun & ~ended)
        shape[odd] = [self._shape_of(k, self._head(k)) for k in odd.tolist()]
        return shape

    def _head(self, statement: int) -> str:
        return self.spellings.between[int(self._between[self._first[statement]])].head

    def _tail(self, statement: int) -> str:
        last = int(self._last[statement])
        number = int(self._between[last + 1])
        return self._ends_odd[last] if number < 0 else self.spellings.between[number].tail

    def _shape_of(self, statement: int, head: str) -> int:
        first, last = int(self._first[statement]), int(self._last[statement])
        tail = self._tail(statement)
        inside = [self.spellings.between[self._between[k]].head for k in range(first + 1, last + 1)]
        return self.spellings.shape(head, *inside, tail) if tail and last - first < _MOST_POINTS else _NONE

    def run(self, start: int) -> tuple[Run, int, int] | None:
        """The statements from the offset ``start`` on, where one begins; the offset behind them, and its line.

        None where the one that begins there is not read here.
        """
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
        end = int(self._stop[statement])
        last, tail = int(self._last[end]), self._tail(end)
        found = Run(self.rows, int(self._begins[statement]), int(self._begins[end]) + 1)
        return found, self._ends[last] + len(tail), int(self._line[last]) + tail.count("\n")

    def close(self) -> None:
        """Gives the rows their columns, when all runs are known."""
        spellings, last = self.spellings, self._last
        rank = ramp(self._counts)
        statement = np.repeat(np.arange(len(last)), self._counts)
        moves = rank == 0
        shape, line = self._shape[statement], self._line[self._first][statement]
        between = self._between[last + 1][statement]
        for k, one in enumerate(spellings.between):
            for place, (number, lines) in enumerate(one.whole, start=1):
                rows = np.flatnonzero((between == k) & (rank == place))
                shape[rows], line[rows] = number, self._line[last[statement[rows]]] + lines
        columns = (shape, line, np.where(moves, last[statement], _NONE))
        self.rows.columns = Columns(*(column.astype(np.int32) for column in columns))
