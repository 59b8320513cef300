"""Lines of our own G-code by column: motions as posts print them, with the remarks and outputs between them.

What they do is what ``camgen.lang.gcode.motion.read_plain`` makes of them line by line, and what the machine does with
the outputs; where a line asks for more than numbers, that is left to these two.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from typing import overload

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.lang.gcode.arcs import NO_ANGLE, OVER_MM, OVER_RAD, Limits
from camgen.lang.gcode.machine import RAPID
from camgen.model.body import NUMBER, Body, Packed
from camgen.model.pose import TOOL_DOWN, FloatArray
from camgen.model.program import Indices, Mask, MoveC, MoveJ, MoveL, Output

from .numbers import DECIMAL, WORD, Codes, codes_of, read_numbers

_END, _BLANK = ord("\n"), ord(" ")
#: The greatest code of a motion.
_MOST_CODE = 3
#: An output, and its fewest characters.
_SWITCH, _OUTPUT = re.compile(r"M6([45]) P([0-9]{1,2})"), len("M64 P0")
#: So many lines are looked at together; fewer than so many in a row are read one by one.
_SOME, FEW = 8192, 32
_AXES = "XYZIJ"
#: One motion as posts print it: in capitals, in this order, a blank between the words, far from the limit of a line.
MOTION = (
    r"(?!.{71})G([0-3])"
    + "".join(f"(?: {letter}({DECIMAL}))?" for letter in _AXES)
    + f"(?: F({DECIMAL.removeprefix('-?')}))?"
)
#: A comment as posts print it: without a comma none is an order.
REMARK = r"\((?!.{71})[A-Za-z0-9 _.+\-=/:#@*]*\)"
#: The most characters of a motion, and of a comment behind its bracket.
_LONGEST = 70
#: The place of each letter among the words of a motion, -1 where it is none of them.
_PLACES = np.full(256, -1, np.int8)
_PLACES[np.frombuffer(f"{_AXES}F".encode(), np.uint8)] = np.arange(len(_AXES) + 1)
_FEED = len(_AXES)
#: The characters that may not stand in a comment.
_UNUSUAL = np.array(
    [re.fullmatch(REMARK, f"({chr(code)})") is None for code in range(256)], np.bool_
)


class Lines(Sequence[str]):
    """The lines of texts one after the other, without their ends; each is made when it is asked for."""

    def __init__(self, texts: Sequence[str]) -> None:
        # Of one text, as a program is, there is no second copy.
        self._text = (
            texts[0]
            if len(texts) == 1
            else "".join(text.removesuffix("\n") + "\n" for text in texts)
        )
        ends = np.flatnonzero(codes_of(self._text) == _END) - WORD
        if texts and not self._text.endswith("\n"):
            ends = np.append(ends, len(self._text))
        self._ends = ends

    def __len__(self) -> int:
        return len(self._ends)

    @overload
    def __getitem__(self, index: int) -> str: ...
    @overload
    def __getitem__(self, index: slice) -> list[str]: ...
    def __getitem__(self, index: int | slice) -> str | list[str]:
        if isinstance(index, slice):
            return [self[k] for k in range(*index.indices(len(self)))]
        place = index + len(self) if index < 0 else index
        if not 0 <= place < len(self):
            raise IndexError("there is no such line")
        return self.text(place, place + 1)

    def text(self, low: int, high: int) -> str:
        """The lines from ``low`` to before ``high``, of which there is one at least, with LF between them."""
        return self._text[int(self._ends[low - 1]) + 1 if low else 0 : int(self._ends[high - 1])]


class Chunk(Struct, eq=False):
    """Lines from ``first`` on by column (N,). other: what is none of those that are read here. moves: motions. digit:
    of G. words: (N, 6) X, Y, Z, I, J, F as they are written, NaN where they are not. outputs: by line from 0. usable:
    whether all its motions so far needed no more than their numbers.
    """

    first: int
    other: Mask
    moves: Mask
    digit: NDArray[np.int8]
    words: FloatArray
    outputs: Mapping[int, Output]
    usable: bool = True

    def holds(self, line: int) -> bool:
        """Whether a line, from 0, is among them."""
        return 0 <= line - self.first < len(self.other)

    def end(self, line: int) -> int:
        """The line from ``line`` on that is another, or behind them all."""
        return line + int(np.append(self.other[line - self.first :], True).argmax())


def cut(lines: Lines, first: int, switch: Callable[[str, str], Output | None]) -> Chunk:
    """So many lines from ``first`` (from 0) on, or as many as there are.

    switch: the output that M64 or M65 sets, by the last digit of the code and its number; None for one that is none.
    """
    last = min(first + _SOME, len(lines))
    codes = codes_of(lines.text(first, last) + "\n0")  # one more than is looked at
    ends = np.flatnonzero(codes == _END)
    begins = np.append(WORD, ends[:-1] + 1)
    moves, digit, words = _read_motions(codes, begins, ends)
    outputs = _read_outputs(codes, begins, ends, switch)
    read = moves | _find_remarks(codes, begins, ends)
    read[list(outputs)] = True
    return Chunk(
        first,
        ~read,
        moves,
        digit,
        words,
        {first + line: output for line, output in outputs.items()},
    )


def _read_motions(
    codes: Codes, begins: Indices, ends: Indices
) -> tuple[Mask, NDArray[np.int8], FloatArray]:
    """(N,) which lines are like ``MOTION``; of these the digits of G, and the words (N, 6) as in ``Chunk``."""
    stops = np.flatnonzero((codes == _BLANK) | (codes == _END))
    starts = np.append(WORD, stops[:-1] + 1)
    last = codes[stops] == _END
    head = np.append(True, last[:-1])
    line = np.cumsum(head) - 1
    place = _PLACES[codes[starts]]
    values, sound = read_numbers(codes, np.minimum(starts + 1, stops), stops)
    rising = place > np.where(head, -1, np.append(-1, place[:-1]))
    rising[1:] |= head[:-1] & (place[1:] >= 0)
    sound &= rising & ((place != _FEED) | (codes[starts + 1] != ord("-")))
    digit = codes[begins + 1] - ord("0")
    coded = (codes[begins] == ord("G")) & (digit <= _MOST_CODE) & (stops[head] == begins + 2)
    sound[head] = coded
    moves = (ends - begins <= _LONGEST) & (np.bincount(line[~sound], minlength=len(ends)) == 0)
    said = ~head & moves[line]
    words = np.full((len(ends), len(_AXES) + 1), np.nan)
    words[line[said], place[said]] = values[said]
    return moves, np.where(moves, digit, 0).astype(np.int8), words


def _read_outputs(
    codes: Codes, begins: Indices, ends: Indices, switch: Callable[[str, str], Output | None]
) -> dict[int, Output]:
    """The outputs that lines like M64 P1 set, by line."""
    size = ends - begins
    rows = np.flatnonzero((codes[begins] == ord("M")) & ((size == _OUTPUT) | (size == _OUTPUT + 1)))
    # Behind the line end of a shorter one stands another line.
    texts = codes[begins[rows, None] + np.arange(_OUTPUT + 1)]
    texts[size[rows] == _OUTPUT, -1] = 0
    spelled, place = np.unique(texts.view(f"S{_OUTPUT + 1}")[:, 0], return_inverse=True)
    found = [_SWITCH.fullmatch(text.decode()) for text in spelled.tolist()]
    known = [None if one is None else switch(one[1], one[2]) for one in found]
    each = zip(rows.tolist(), map(known.__getitem__, place.tolist()), strict=True)
    return {row: output for row, output in each if output is not None}


def _find_remarks(codes: Codes, begins: Indices, ends: Indices) -> Mask:
    """(N,) which lines are like ``REMARK``."""
    remarks = (codes[begins] == ord("(")) & (codes[ends - 1] == ord(")"))
    remarks &= (ends - begins >= len("()")) & (ends - begins <= _LONGEST + 1)
    rows = np.flatnonzero(remarks)
    unusual = np.flatnonzero(_UNUSUAL[codes])
    inside = np.searchsorted(unusual, ends[rows] - 1) - np.searchsorted(unusual, begins[rows] + 1)
    remarks[rows] = inside == 0
    return np.asarray(remarks)


class Settled(Struct, frozen=True, eq=False):
    """The state of a machine in mm, absolute in the XY plane, whose motions say all that they need. at: mm. feed:
    mm/s. blend: of motions at feed.
    """

    at: tuple[float, float, float]
    feed: float
    blend: float
    limits: Limits


class Done(Struct, frozen=True, eq=False):
    """What lines do. line: behind them, from 0. body: instructions, lines: of each, from 1. at, feed: after them.
    motion: the last motion code. cut: whether any was at feed.
    """

    line: int
    body: Body
    lines: NDArray[np.int64]
    at: tuple[float, float, float]
    feed: float
    motion: str
    cut: bool


def perform(chunk: Chunk, state: Settled, low: int, high: int) -> Done | None:
    """What the lines from ``low`` to before ``high`` of the chunk do, none of them another, up to a motion that needs
    more than its numbers; None where that is the first one.
    """
    here = slice(low - chunk.first, high - chunk.first)
    rows = np.flatnonzero(chunk.moves[here]) + here.start
    words, digit = chunk.words[rows], chunk.digit[rows]
    ends = np.column_stack([_held(words[:, k], state.at[k]) for k in range(3)])
    feed = _held(words[:, _FEED] / 60.0, state.feed)
    starts = np.concatenate([[state.at], ends[:-1]])
    centred = ~np.isnan(words[:, 3:5])
    arc = digit >= 2
    sound = (
        ~np.isnan(words[:, :3]).all(axis=1)
        & ((digit == 0) | (feed > 0))
        & (arc == centred.any(axis=1))
    )
    arcs = np.flatnonzero(arc & sound)
    vias, good = _pass_through(
        starts[arcs], ends[arcs], np.nan_to_num(words[arcs, 3:5]), digit[arcs] == 3, state.limits
    )
    sound[arcs[~good]] = False
    stop = int(np.append(sound, False).argmin())
    if stop == 0:
        return None
    end = int(rows[stop]) + chunk.first if stop < len(rows) else high
    vias = vias[: int(np.searchsorted(arcs, stop))]
    rows, digit, ends, feed = rows[:stop], digit[:stop], ends[:stop], feed[:stop]
    outputs = {line: output for line, output in chunk.outputs.items() if low <= line < end}
    places = np.concatenate([rows + chunk.first, np.fromiter(outputs, np.intp, len(outputs))])
    order = np.argsort(places, kind="stable")
    kinds = np.array([NUMBER[MoveJ], NUMBER[MoveL], NUMBER[MoveC], NUMBER[MoveC]], np.int8)[digit]
    kind = np.append(kinds, np.full(len(outputs), NUMBER[Output], np.int8))[order]
    rapid = digit == 0
    packed = Packed(
        kind=kind,
        end=ends,
        rotation=np.zeros(stop, np.int32),
        speed=np.where(rapid, RAPID, feed),
        blend=np.where(rapid, 0.0, state.blend),
        path=np.full(stop, -1),
        work=np.zeros(stop, np.bool_),
        via=vias,
        via_rotation=np.zeros(len(vias), np.int32),
        kept=kind == NUMBER[Output],
    )
    x, y, z = ends[-1].tolist()
    return Done(
        line=end,
        body=Body(packed, [TOOL_DOWN], list(outputs.values())),
        lines=(places[order] + 1).astype(np.int64),
        at=(x, y, z),
        feed=float(feed[-1]),
        motion=f"G{digit[-1]}",
        cut=not rapid.all(),
    )


def _held(values: FloatArray, before: float) -> FloatArray:
    """(N,): each value, the last one before it where it is not said (NaN), or the one ``before`` all."""
    last = np.maximum.accumulate(np.where(np.isnan(values), 0, np.arange(1, len(values) + 1)))
    return np.append(before, values)[last]


def _pass_through(
    start: FloatArray, end: FloatArray, centre: FloatArray, left: Mask, limits: Limits
) -> tuple[FloatArray, Mask]:
    """The points half-way along arcs as ``camgen.lang.gcode.arcs.pieces`` finds them, to the last bit, and which arcs
    are level, no more than half a circle, and taken by the controller. centre: (N, 2) from the start.
    """
    a, b = (start[:, k] + centre[:, k] for k in range(2))
    from_centre = [(point[:, 0] - a, point[:, 1] - b) for point in (start, end)]
    radii = np.stack([_each(math.hypot, *arm) for arm in from_centre])
    begin, finish = (_each(math.atan2, arm[1], arm[0]) for arm in from_centre)
    turn = np.where(left, finish - begin, begin - finish) % (2 * math.pi)
    turn = np.where(turn < NO_ANGLE, turn + 2 * math.pi, turn)
    least, most, _ = limits.spiral
    differ, widest = np.abs(radii[0] - radii[1]), radii.max(axis=0)
    with np.errstate(divide="ignore"):
        half = turn - np.minimum(OVER_MM / widest, OVER_RAD) <= math.pi
    good = half & (radii.min(axis=0) >= limits.least_radius) & (start[:, 2] == end[:, 2])
    good &= (differ <= most) & ((differ <= least) | (differ <= 0.001 * widest))
    angle, radius = begin + np.where(left, turn, -turn) / 2, (radii[0] + radii[1]) / 2
    across = a + radius * _each(math.cos, angle), b + radius * _each(math.sin, angle)
    return np.column_stack([*across, start[:, 2]]), good


def _each(function: Callable[..., float], *values: FloatArray) -> FloatArray:
    return np.fromiter(map(function, *(one.tolist() for one in values)), np.float64, len(values[0]))
