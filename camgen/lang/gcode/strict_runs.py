"""Lines of G-code of a post by column: motions, comments and outputs in the spelling of posts.

The result equals that of `camgen.lang.gcode.motion.read_plain` and of the machine, line by line.
Lines in another spelling, and motions that need more than their numbers, are left to these two.
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
#: Largest code of a motion.
_LAST_CODE = 3
#: An output.
_SWITCH = re.compile(r"M6([45]) P([0-9]{1,2})")
#: Number of lines that are read together. They stay in the cache of the processor.
_CHUNK_LINES = 8192
#: Number of lines in a sequence below which reading line by line is faster.
SHORTEST_RUN = 32
_AXES = "XYZIJ"
#: A number as in JSON, whose reader has no sign for -0. Larger ones are judged line by line.
_UNSIGNED = r"(?:0|[1-9][0-9]{0,5})(?:\.[0-9]+)?"
_LARGER = 1e6
DECIMAL = rf"(?:-(?!0(?!\.)))?{_UNSIGNED}"
#: One motion as posts print it: in capitals, in this order, a blank between the words, and much
#: shorter than the limit of a line.
MOTION = (
    r"(?!.{71})G([0-3])"
    + "".join(f"(?: {letter}({DECIMAL}))?" for letter in _AXES)
    + f"(?: F({_UNSIGNED}))?"
)
_SIGNED_ZERO = re.compile(rb"-0(?!\.)")
#: Translation of words with blanks between them to numbers with commas between them.
_SIGNS = {code: code for code in b"0123456789.-"} | dict.fromkeys(b" \n", ord(","))
_SIGNS |= dict.fromkeys(string.ascii_uppercase.encode(), ord(" "))
_TO_NUMBERS = bytes(_SIGNS.get(code, ord("?")) for code in range(256))
#: A comment as posts print it. A comment without a comma has no effect on the machine.
REMARK = r"\((?!.{71})[A-Za-z0-9 _.+\-=/:#@*]*\)"
_REMARK = re.compile(REMARK)
#: Maximum number of characters of a motion, and of a comment after its opening bracket.
_LONGEST = 70
#: Column of each letter among the words of a motion, -1 for other letters.
_COLUMNS = np.full(256, -1, np.int8)
_COLUMNS[np.frombuffer(f"{_AXES}F".encode(), np.uint8)] = np.arange(len(_AXES) + 1)
_FEED = len(_AXES)


def _codes_of(text: str) -> Codes:
    """The characters of a text as bytes (N,). Characters that are not ASCII are question marks."""
    return np.frombuffer(text.encode("ascii", "replace"), np.uint8)


class Lines(Sequence[str]):
    """The lines of texts in order, without their ends. Each is made when it is needed."""

    def __init__(self, texts: Sequence[str]) -> None:
        # A program is usually one text, which is not copied.
        if len(texts) == 1:
            self._text = texts[0]
        else:
            self._text = "".join(text.removesuffix("\n") + "\n" for text in texts)
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
        """The lines from index `low` to before `high` with LF between them, at least one line."""
        return self._text[int(self._ends[low - 1]) + 1 if low else 0 : int(self._ends[high - 1])]


class Chunk(Struct, eq=False):
    """N lines by column.

    first: index of the first line, from 0.
    is_other: (N,) whether a line is not a motion, comment or output in the usual spelling.
    is_motion: (N,) whether a line is a motion.
    digit: (N,) digit of G of a motion.
    words: (N, 6) X, Y, Z, I, J, F as written, NaN for missing words.
    outputs: output by line, from 0.
    usable: whether all motions so far needed no more than their numbers.
    """

    first: int
    is_other: Mask
    is_motion: Mask
    digit: NDArray[np.int8]
    words: FloatArray
    outputs: Mapping[int, Output]
    usable: bool = True

    def holds(self, line: int) -> bool:
        """Whether the chunk has a line, from 0."""
        return 0 <= line - self.first < len(self.is_other)

    def end(self, line: int) -> int:
        """The first line from `line` on that is of another kind, or the line after the chunk."""
        return line + int(np.append(self.is_other[line - self.first :], True).argmax())


def cut(lines: Lines, first: int, switch: Callable[[str, str], Output | None]) -> Chunk:
    """Reads the lines of one chunk.

    first: index of the first line, from 0.
    switch: returns the output that M64 or M65 sets, by the last digit of the code and the number of
        the output, or None if there is no such output.
    """
    last = min(first + _CHUNK_LINES, len(lines))
    codes = _codes_of(lines.text(first, last) + "\n0")  # one more than is read
    ends = np.flatnonzero(codes == _END)
    begins = np.append(0, ends[:-1] + 1)
    is_motion, digit, words = _read_motions(codes, begins, ends)
    usual, outputs = _read_others(codes, begins, ends, switch)
    is_other = ~is_motion
    is_other[usual] = False
    output_at = {first + line: output for line, output in outputs.items()}
    return Chunk(first, is_other, is_motion, digit, words, output_at)


def _read_motions(
    codes: Codes, begins: Indices, ends: Indices
) -> tuple[Mask, NDArray[np.int8], FloatArray]:
    """`is_motion`, `digit` and `words` of a `Chunk` with N lines."""
    is_motion, digit = np.zeros(len(ends), np.bool_), np.zeros(len(ends), np.int8)
    words = np.full((len(ends), len(_AXES) + 1), np.nan)
    candidates = (codes[begins] == ord("G")) & (ends - begins <= _LONGEST)
    columns = _read_words(codes[:-1][np.repeat(candidates, ends - begins + 1)])
    if columns is not None:
        is_motion[candidates], digit[candidates], words[candidates] = columns
    return is_motion, digit, words


def _read_words(codes: Codes) -> tuple[Mask, NDArray[np.int8], FloatArray] | None:
    """`is_motion`, `digit` and `words` of lines that begin with G.

    Returns None if a line has more than letters and numbers. All lines are then read one by one.
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
    is_last = codes[stops] == _END
    is_first = np.append(True, is_last[:-1])
    line = np.cumsum(is_first) - 1
    column = _COLUMNS[codes[starts]]
    # Words must be in the order of their columns. The first word is the code.
    is_valid = column > np.where(is_first, -1, np.append(-1, column[:-1]))
    is_valid[1:] |= is_first[:-1] & (column[1:] >= 0)
    is_valid &= (column != _FEED) | (codes[starts + 1] != ord("-"))
    digit = (codes[starts + 1] - ord("0"))[is_first]
    is_code = (codes[starts] == ord("G"))[is_first] & ((stops - starts)[is_first] == 2)
    is_valid[is_first] = is_code & (digit <= _LAST_CODE)
    is_motion = np.bincount(line[~is_valid], minlength=len(digit)) == 0
    is_word = ~is_first & is_motion[line]
    words = np.full((len(digit), len(_AXES) + 1), np.nan)
    words[line[is_word], column[is_word]] = values[is_word]
    return is_motion, np.where(is_motion, digit, 0).astype(np.int8), words


def _read_others(
    codes: Codes, begins: Indices, ends: Indices, switch: Callable[[str, str], Output | None]
) -> tuple[Indices, dict[int, Output]]:
    """Rows of the lines that are comments in the usual spelling or outputs, and outputs by row."""

    def decode(text: str) -> Output | bool | None:
        match = _SWITCH.fullmatch(text)
        return switch(match[1], match[2]) if match else bool(_REMARK.fullmatch(text))

    rows = np.flatnonzero((codes[begins] != ord("G")) & (ends - begins <= _LONGEST + 1))
    text, spans = codes.tobytes().decode(), zip(begins[rows], ends[rows], strict=True)
    effects, _ = read_words([text[begin:end] for begin, end in spans], decode)
    effect_of = dict(zip(rows.tolist(), effects, strict=True))
    outputs = {row: effect for row, effect in effect_of.items() if isinstance(effect, Output)}
    return np.array([row for row, effect in effect_of.items() if effect], np.intp), outputs


class MotionState(Struct, frozen=True, eq=False):
    """The state before a sequence: mm, absolute coordinates, arcs in the XY plane.

    at: position, mm.
    feed: feed, mm/s.
    blend: blend of motions at feed.
    limits: tolerances of arcs.
    """

    at: tuple[float, float, float]
    feed: float
    blend: float
    limits: Limits


class RunEffect(Struct, frozen=True, eq=False):
    """The effect of a sequence of lines.

    line: index of the line after the sequence, from 0.
    body: N instructions.
    lines: (N,) line of each instruction, from 1.
    at: position after the sequence, mm.
    feed: feed after the sequence, mm/s.
    motion: last motion code.
    cut: whether a motion was at feed.
    """

    line: int
    body: Body
    lines: NDArray[np.int64]
    at: tuple[float, float, float]
    feed: float
    motion: str
    cut: bool


def perform(chunk: Chunk, state: MotionState, low: int, high: int) -> RunEffect | None:
    """Runs the lines from `low` to before `high` of a chunk, which are all in the usual spelling.

    The run ends before the first motion that needs more than its numbers. Returns None if this is
    the first motion.
    """
    span = slice(low - chunk.first, high - chunk.first)
    rows = np.flatnonzero(chunk.is_motion[span]) + span.start
    words, digit = chunk.words[rows], chunk.digit[rows]
    ends = np.column_stack([_fill(words[:, k], state.at[k]) for k in range(3)])
    feed = _fill(words[:, _FEED] / 60.0, state.feed)
    starts = np.concatenate([[state.at], ends[:-1]])
    has_centre = ~np.isnan(words[:, 3:5]).all(axis=1)
    has_target = ~np.isnan(words[:, :3]).all(axis=1)
    is_arc = digit >= 2
    is_valid = has_target & ((digit == 0) | (feed > 0)) & (is_arc == has_centre)
    arcs = np.flatnonzero(is_arc & is_valid)
    centres = np.nan_to_num(words[arcs, 3:5])
    vias, is_accepted = _find_vias(
        starts[arcs], ends[arcs], centres, digit[arcs] == 3, state.limits
    )
    is_valid[arcs[~is_accepted]] = False
    stop = int(np.append(is_valid, False).argmin())
    if stop == 0:
        return None
    end = int(rows[stop]) + chunk.first if stop < len(rows) else high
    vias = vias[: int(np.searchsorted(arcs, stop))]
    rows, digit, ends, feed = rows[:stop], digit[:stop], ends[:stop], feed[:stop]
    outputs = {line: output for line, output in chunk.outputs.items() if low <= line < end}
    lines = np.concatenate([rows + chunk.first, np.fromiter(outputs, np.intp, len(outputs))])
    order = np.argsort(lines, kind="stable")
    kinds = np.array([NUMBER[MoveJ], NUMBER[MoveL], NUMBER[MoveC], NUMBER[MoveC]], np.int8)[digit]
    kind = np.append(kinds, np.full(len(outputs), NUMBER[Output], np.int8))[order]
    is_rapid = digit == 0
    packed = Packed(
        kind=kind,
        end=ends,
        rotation=np.zeros(stop, np.int32),
        speed=np.where(is_rapid, RAPID, feed),
        blend=np.where(is_rapid, 0.0, state.blend),
        path=np.full(stop, -1),
        work=np.zeros(stop, np.bool_),
        via=vias,
        via_rotation=np.zeros(len(vias), np.int32),
        kept=kind == NUMBER[Output],
    )
    x, y, z = ends[-1].tolist()
    return RunEffect(
        line=end,
        body=Body(packed, [TOOL_DOWN], list(outputs.values())),
        lines=(lines[order] + 1).astype(np.int64),
        at=(x, y, z),
        feed=float(feed[-1]),
        motion=f"G{digit[-1]}",
        cut=not is_rapid.all(),
    )


def _fill(values: FloatArray, before: float) -> FloatArray:
    """Replaces each NaN in `values` (N,) by the last number before it, or by `before`."""
    last = np.maximum.accumulate(np.where(np.isnan(values), 0, np.arange(1, len(values) + 1)))
    return np.append(before, values)[last]


def _find_vias(
    start: FloatArray, end: FloatArray, centre: FloatArray, left: Mask, limits: Limits
) -> tuple[FloatArray, Mask]:
    """The via points of N arcs (N, 3), mm, and which arcs may run by column.

    Such an arc is level, at most half a circle, and within the tolerances of the controller. The
    via points equal those of `camgen.lang.gcode.arcs.divide` to the last bit.
    start, end: (N, 3) mm.
    centre: (N, 2) from the start, mm.
    left: (N,) whether the arc is counterclockwise.
    """
    centre_x, centre_y = (start[:, k] + centre[:, k] for k in range(2))
    from_centre = [(point[:, 0] - centre_x, point[:, 1] - centre_y) for point in (start, end)]
    radii = np.stack([_each(math.hypot, *arm) for arm in from_centre])
    begin, finish = (_each(math.atan2, arm[1], arm[0]) for arm in from_centre)
    sweep = np.where(left, finish - begin, begin - finish) % (2 * math.pi)
    sweep = np.where(sweep < NO_ANGLE, sweep + 2 * math.pi, sweep)
    always_accepted, limit, _ = limits.spiral
    difference, larger = np.abs(radii[0] - radii[1]), radii.max(axis=0)
    with np.errstate(divide="ignore"):
        is_half = sweep - np.minimum(OVER_MM / larger, OVER_RAD) <= math.pi
    is_small = (difference <= always_accepted) | (difference <= 0.001 * larger)
    is_level = start[:, 2] == end[:, 2]
    has_radius = radii.min(axis=0) >= limits.least_radius
    is_accepted = is_half & is_level & has_radius & is_small & (difference <= limit)
    angle, radius = begin + np.where(left, sweep, -sweep) / 2, (radii[0] + radii[1]) / 2
    via_x = centre_x + radius * _each(math.cos, angle)
    via_y = centre_y + radius * _each(math.sin, angle)
    return np.column_stack([via_x, via_y, start[:, 2]]), is_accepted


def _each(function: Callable[..., float], *arrays: FloatArray) -> FloatArray:
    """The values of a scalar function, which differ from those of numpy in the last bit."""
    numbers = [values.tolist() for values in arrays]
    return np.fromiter(map(function, *numbers), np.float64, len(numbers[0]))
