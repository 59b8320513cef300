"""Lines of our own G-code by column: motions as posts print them, with the remarks and outputs between them.

What they do is what ``camgen.lang.gcode.motion.read_plain`` makes of them line by line, and what the machine does with
the outputs; where a line asks for more than numbers, that is left to these two.
"""

from __future__ import annotations

import math
import re
import string
from collections.abc import Callable, Mapping, Sequence
from typing import overload

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.lang.columns import read_numbers, read_words
from camgen.lang.gcode.arcs import NO_ANGLE, OVER_MM, OVER_RAD, Limits
from camgen.lang.gcode.machine import RAPID
from camgen.model.body import NUMBER, Body, Packed
from camgen.model.pose import TOOL_DOWN, FloatArray
from camgen.model.program import Indices, Mask, MoveC, MoveJ, MoveL, Output

Codes = NDArray[np.uint8]

_END, _BLANK = ord("\n"), ord(" ")
#: The greatest code of a motion.
_MOST_CODE = 3
#: An output.
_SWITCH = re.compile(r"M6([45]) P([0-9]{1,2})")
#: So many lines are looked at together; fewer than so many in a row are read one by one.
_SOME, FEW = 8192, 32
_AXES = "XYZIJ"
#: A number as in JSON, whose reader has no sign for -0. Larger ones are judged line by line.
_UNSIGNED = r"(?:0|[1-9][0-9]{0,5})(?:\.[0-9]+)?"
_LARGER = 1e6
DECIMAL = rf"(?:-(?!0(?!\.)))?{_UNSIGNED}"
#: One motion as posts print it: in capitals, in this order, a blank between the words, far from the limit of a line.
MOTION = (
    r"(?!.{71})G([0-3])"
    + "".join(f"(?: {letter}({DECIMAL}))?" for letter in _AXES)
    + f"(?: F({_UNSIGNED}))?"
)
_SIGNED_ZERO = re.compile(rb"-0(?!\.)")
#: Turns letters with numbers and blanks between them into numbers with commas between them.
_SIGNS = {code: code for code in b"0123456789.-"} | dict.fromkeys(b" \n", ord(","))
_SIGNS |= dict.fromkeys(string.ascii_uppercase.encode(), ord(" "))
_TO_NUMBERS = bytes(_SIGNS.get(code, ord("?")) for code in range(256))
#: A comment as posts print it: without a comma none is an order.
REMARK = r"\((?!.{71})[A-Za-z0-9 _.+\-=/:#@*]*\)"
_REMARK = re.compile(REMARK)
#: The most characters of a motion, and of a comment behind its bracket.
_LONGEST = 70
#: The place of each letter among the words of a motion, -1 where it is none of them.
_PLACES = np.full(256, -1, np.int8)
_PLACES[np.frombuffer(f"{_AXES}F".encode(), np.uint8)] = np.arange(len(_AXES) + 1)
_FEED = len(_AXES)


def _codes_of(text: str) -> Codes:
    """The characters of a text, one byte each; a question mark for one that is not ASCII."""
    return np.frombuffer(text.encode("ascii", "replace"), np.uint8)


class Lines(Sequence[str]):
    """The lines of texts one after the other, without their ends; each is made when it is asked for."""

    def __init__(self, texts: Sequence[str]) -> None:
        # Of one text, as a program is, there is no second copy.
        self._text = (
            texts[0]
            if len(texts) == 1
            else "".join(text.removesuffix("\n") + "\n" for text in texts)
        )
        ends = np.flatnonzero(_codes_of(self._text) == _END)
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
    codes = _codes_of(lines.text(first, last) + "\n0")  # one more than is looked at
    ends = np.flatnonzero(codes == _END)
    begins = np.append(0, ends[:-1] + 1)
    moves, digit, words = _read_motions(codes, begins, ends)
    others, outputs = _read_others(codes, begins, ends, switch)
    other = ~moves
    other[others] = False
    return Chunk(
        first,
        other,
        moves,
        digit,
        words,
        {first + line: output for line, output in outputs.items()},
    )


def _read_motions(
    codes: Codes, begins: Indices, ends: Indices
) -> tuple[Mask, NDArray[np.int8], FloatArray]:
    """(N,) which lines are like ``MOTION``; of these the digits of G, and the words (N, 6) as in ``Chunk``."""
    moves, digit = np.zeros(len(ends), np.bool_), np.zeros(len(ends), np.int8)
    words = np.full((len(ends), len(_AXES) + 1), np.nan)
    maybe = (codes[begins] == ord("G")) & (ends - begins <= _LONGEST)
    read = _read_words(codes[:-1][np.repeat(maybe, ends - begins + 1)])
    if read is not None:
        moves[maybe], digit[maybe], words[maybe] = read
    return moves, digit, words


def _read_words(codes: Codes) -> tuple[Mask, NDArray[np.int8], FloatArray] | None:
    """As ``_read_motions``, for whole lines; None if one of them has more than letters and numbers.

    The lines are then read one by one.
    """
    stops = np.flatnonzero((codes == _BLANK) | (codes == _END))
    starts = np.append(0, stops[:-1] + 1)
    text = codes.tobytes().translate(_TO_NUMBERS)[:-1]
    values = read_numbers(text)
    if values is None or not len(values) or np.abs(values).max() >= _LARGER:
        return None
    if _SIGNED_ZERO.search(text):
        return None
    if text.count(b" ") != len(stops) or (codes[starts] <= ord("9")).any():
        return None
    last = codes[stops] == _END
    head = np.append(True, last[:-1])
    line = np.cumsum(head) - 1
    place = _PLACES[codes[starts]]
    sound = place > np.where(head, -1, np.append(-1, place[:-1]))
    sound[1:] |= head[:-1] & (place[1:] >= 0)
    sound &= (place != _FEED) | (codes[starts + 1] != ord("-"))
    digit = (codes[starts + 1] - ord("0"))[head]
    sound[head] = (
        (codes[starts] == ord("G"))[head] & (digit <= _MOST_CODE) & ((stops - starts)[head] == 2)
    )
    moves = np.bincount(line[~sound], minlength=len(digit)) == 0
    said = ~head & moves[line]
    words = np.full((len(digit), len(_AXES) + 1), np.nan)
    words[line[said], place[said]] = values[said]
    return moves, np.where(moves, digit, 0).astype(np.int8), words


def _read_others(
    codes: Codes, begins: Indices, ends: Indices, switch: Callable[[str, str], Output | None]
) -> tuple[Indices, dict[int, Output]]:
    """The lines that are like ``REMARK`` or set an output, and the outputs by line."""

    def decode(text: str) -> Output | bool | None:
        output = _SWITCH.fullmatch(text)
        return switch(output[1], output[2]) if output else bool(_REMARK.fullmatch(text))

    rows = np.flatnonzero((codes[begins] != ord("G")) & (ends - begins <= _LONGEST + 1))
    text, spans = codes.tobytes().decode(), zip(begins[rows], ends[rows], strict=True)
    effects, _ = read_words([text[begin:end] for begin, end in spans], decode)
    read = dict(zip(rows.tolist(), effects, strict=True))
    outputs = {row: effect for row, effect in read.items() if isinstance(effect, Output)}
    return np.array([row for row, effect in read.items() if effect], np.intp), outputs


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
    """The points half-way along arcs as ``camgen.lang.gcode.arcs.divide`` finds them, to the last bit, and which arcs
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
