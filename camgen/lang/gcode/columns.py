"""Motions, comments and outputs in the usual spelling, read by column: most lines of a program.

The result equals that of the machine line by line, to the last bit. Lines in another spelling, and
motions that have a fault, are left to it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import NDArray

from camgen.lang.columns import read_numbers, read_words
from camgen.lang.gcode.arcs import NO_ANGLE, OVER_MM, OVER_RAD, Arc, Limits, Piece, divide
from camgen.lang.gcode.dialects import RAPID
from camgen.lang.gcode.machine import FindEffect, Machine
from camgen.lang.gcode.words import LineError
from camgen.model.body import NUMBER, Body, Packed
from camgen.model.pose import TOOL_DOWN, FloatArray
from camgen.model.program import Indices, Instruction, Mask, MoveC, MoveJ, MoveL, Output

#: Number of lines that are read together. They stay in the cache of the processor.
CHUNK_LINES = 8192
#: Maximum number of characters of a line. All controllers read longer ones.
_LONGEST = 70
#: Larger numbers are judged line by line.
_LARGER = 1e6
#: Words of a motion in the order of their columns.
_LETTERS = "NGXYZIJF"
_N, _G, _X, _I, _F = (_LETTERS.index(letter) for letter in "NGXIF")
#: Classes of characters: the columns of the letters, numbers, the end of a line, and all others.
_NUMBER, _END, _OTHER = len(_LETTERS), len(_LETTERS) + 1, len(_LETTERS) + 2
_CLASS_OF = (
    {letter: column for column, letter in enumerate(_LETTERS)}
    | {letter: column for column, letter in enumerate(_LETTERS.lower())}
    | dict.fromkeys("0123456789.+- ", _NUMBER)
    | {"\n": _END}
)
_CLASSES = bytes(_CLASS_OF.get(chr(code), _OTHER) for code in range(256))
_COMMAS = bytes(ord(",") if group < _NUMBER else code for code, group in enumerate(_CLASSES))
#: The reader of numbers in JSON has no sign for -0.
_SIGNED_ZERO = re.compile(rb"-0(?!\.)")
#: A motion with a comment. A comment with a comma may be one that LinuxCNC acts on.
_COMMENTED = re.compile(
    r"^([ \t]*[NGXYZIJF][^(;\n]*)(?:\([^(),\n]*\)[ \t]*|;[^,\n]*)$", re.IGNORECASE | re.MULTILINE
)


class Chunk(Struct, eq=False):
    """N lines by column.

    first: index of the first line, from 0.
    others: rows of the lines other than motions, comments and outputs in the usual spelling.
    is_motion: (N,) whether a line is a motion.
    words: (N, 8) N, G, X, Y, Z, I, J, F as written, NaN for missing words.
    outputs: output by line, from 0.
    resume: line, from 0, before which lines are not tried again after one that failed.
    pause: number of lines until then.
    """

    first: int
    others: Indices
    is_motion: Mask
    words: FloatArray
    outputs: Mapping[int, Output]
    resume: int = 0
    pause: int = 1

    def holds(self, line: int) -> bool:
        """Whether the chunk has a line, from 0."""
        return 0 <= line - self.first < len(self.is_motion)

    def end(self, line: int) -> int:
        """The first line from `line` on that is of another kind, or the line after the chunk."""
        place = int(np.searchsorted(self.others, line - self.first))
        rows = self.others[place] if place < len(self.others) else len(self.is_motion)
        return self.first + int(rows)


def cut(lines: Sequence[str], first: int, find_effect: FindEffect | None) -> Chunk:
    """Reads the lines of one chunk.

    first: index of the first line, from 0.
    find_effect: effect of a line that is not a motion. None: only motions are read, and blanks and
        a comment after a motion have no effect.
    """
    raw = lines[first : first + CHUNK_LINES]
    text = "\n".join(raw) + "\n"
    if find_effect is None and ("(" in text or ";" in text):
        text = _COMMENTED.sub(r"\1", text)
    data = text.encode("ascii", "replace").replace(b"\r\n", b"\n")
    if find_effect is None:
        data = data.translate(None, b" \t")
    classes = np.frombuffer(data.translate(_CLASSES), np.uint8)
    ends = np.flatnonzero(classes == _END)
    starts = np.append(0, ends[:-1] + 1)
    candidates = (ends - starts <= _LONGEST) & (classes[starts] < _NUMBER)
    candidates[np.searchsorted(ends, np.flatnonzero(classes == _OTHER))] = False
    kept = np.repeat(candidates, ends - starts + 1)
    codes = np.frombuffer(data, np.uint8)[kept]
    is_motion, words = _read_motions(codes, classes[kept], np.flatnonzero(candidates), len(ends))
    is_other = ~is_motion & (ends > starts)
    outputs = {}
    if find_effect is not None:
        rows = np.flatnonzero(is_other)
        effects, _ = read_words([raw[row] for row in rows.tolist()], find_effect)
        for row, effect in zip(rows.tolist(), effects, strict=True):
            is_other[row] = not effect
            if isinstance(effect, Output):
                outputs[first + row] = effect
    return Chunk(first, np.flatnonzero(is_other), is_motion, words, outputs)


def _read_motions(
    codes: NDArray[np.uint8], classes: NDArray[np.uint8], rows: Indices, count: int
) -> tuple[Mask, FloatArray]:
    """`is_motion` and `words` of a chunk.

    codes, classes: characters of the lines that have letters and numbers alone and begin with a
        letter, and the classes of these characters.
    rows: rows of these lines.
    count: number of all lines.
    """
    is_motion, words = np.zeros(count, np.bool_), np.full((count, len(_LETTERS)), np.nan)
    if not len(rows):
        return is_motion, words
    values = _read_numbers(codes.tobytes().translate(_COMMAS, b"\n")[1:])
    letters = np.flatnonzero(classes < _NUMBER)
    column = classes[letters]
    is_first = np.append(True, classes[letters[1:] - 1] == _END)
    row = rows[np.cumsum(is_first) - 1]
    is_valid = np.abs(values) < _LARGER
    is_valid[1:] &= is_first[1:] | (column[1:] > column[:-1])
    numbers, feeds, is_code = column == _N, column == _F, column == _G
    is_valid[numbers] &= codes[letters[numbers] + 1] >= ord("0")
    is_valid[feeds] &= values[feeds] >= 0
    code = values[is_code]
    is_valid[is_code] &= (code == 0) | (code == 1) | (code == 2) | (code == 3)
    words[row, column] = values
    is_motion[row[(column >= _X) & (column < _I)]] = True
    is_motion[row[~is_valid]] = False
    return is_motion, words


def _read_numbers(text: bytes) -> FloatArray:
    """(N,): numbers with commas between them, NaN for other texts."""
    numbers = None if _SIGNED_ZERO.search(text) else read_numbers(text)
    if numbers is None:
        return np.array([_read_number(number) for number in text.split(b",")])
    return numbers


def _read_number(text: bytes) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def perform(m: Machine, chunk: Chunk, low: int, high: int) -> int:
    """Runs the lines from `low` to before `high` of a chunk, which are all in the usual spelling.

    The plane is that of X and Y. The run ends before the first motion with a fault. Returns the
    index of the line after the last one that has run, `low` if this is the first motion.
    """
    span = slice(low - chunk.first, high - chunk.first)
    rows = np.flatnonzero(chunk.is_motion[span]) + span.start
    words, unit = chunk.words[rows], m.scale
    modal = float(m.motion[1:]) if m.motion in ("G0", "G1", "G2", "G3") else math.nan
    digit = _fill(words[:, _G], modal)
    ends = np.column_stack([_fill(words[:, _X + k] * unit + m.shift[k], m.at[k]) for k in range(3)])
    feed = _fill(words[:, _F] * unit / 60.0, m.feed)
    starts = np.concatenate([[m.at], ends[:-1]])
    has_centre = ~(np.isnan(words[:, _I]) & np.isnan(words[:, _I + 1]))
    is_arc = digit >= 2
    is_valid = ((digit == 0) | ((digit > 0) & (feed > 0))) & (is_arc == has_centre)
    arcs = np.flatnonzero(is_arc & is_valid)
    centres = np.nan_to_num(words[arcs, _I:_F]) * unit
    vias = np.full(ends.shape, np.nan)
    lefts, limits = digit[arcs] == 3, (m.exact or m.limits).at_unit(unit)
    is_accepted = np.zeros(0, np.bool_)
    if len(arcs):
        vias[arcs], is_accepted = _find_vias(starts[arcs], ends[arcs], centres, lefts, limits)
    divided: dict[int, list[Piece]] = {}
    for place in np.flatnonzero(~is_accepted).tolist():
        row = int(arcs[place])
        pieces = _divide(starts[row], ends[row], centres[place], bool(lefts[place]), limits)
        if not pieces:
            is_valid[row] = False
            break
        divided[row] = pieces
    stop = int(np.append(is_valid, False).argmin())
    if stop == 0:
        return low
    end = int(rows[stop]) + chunk.first if stop < len(rows) else high
    last = ends[stop - 1].tolist()
    rows, digit, feed = rows[:stop], digit[:stop], feed[:stop]
    ends, vias = ends[:stop], vias[:stop]
    if divided:
        of_motion, ends, vias = _insert(divided, ends, vias)
        rows, digit, feed = rows[of_motion], digit[of_motion], feed[of_motion]
    outputs = {line: output for line, output in chunk.outputs.items() if low <= line < end}
    lines = np.concatenate([rows + chunk.first, np.fromiter(outputs, np.intp, len(outputs))])
    order = np.argsort(lines, kind="stable")
    is_rapid, is_curved = digit == 0, vias[:, 0] == vias[:, 0]  # without NaN
    kinds = np.where(is_rapid, NUMBER[MoveJ], np.where(is_curved, NUMBER[MoveC], NUMBER[MoveL]))
    kind = np.append(kinds, np.full(len(outputs), NUMBER[Output]))[order].astype(np.int8)
    count = len(ends)
    packed = Packed(
        kind=kind,
        end=ends,
        rotation=np.zeros(count, np.int32),
        speed=np.where(is_rapid, RAPID, feed),
        blend=np.where(is_rapid, 0.0, m.blend),
        path=np.full(count, -1),
        work=np.zeros(count, np.bool_),
        via=vias[is_curved],
        via_rotation=np.zeros(int(is_curved.sum()), np.int32),
        kept=kind == NUMBER[Output],
    )
    _add(m, Body(packed, [TOOL_DOWN], list(outputs.values())))
    m.lines.frombytes((lines[order] + 1).astype(np.int64).tobytes())
    if feed[-1] != m.feed:
        m.named.pop("_feed", None)
    m.at[:], m.feed, m.motion = last, float(feed[-1]), f"G{digit[-1]:.0f}"
    m.cut = m.cut or not is_rapid.all()
    return end


def _add(m: Machine, body: Body) -> None:
    if m.force:
        m.body.extend(_with_force(item, m.force) for item in body)
    else:
        m.body.extend_body(body)


def _with_force(item: Instruction, force: float) -> Instruction:
    return replace(item, force=force) if isinstance(item, MoveL | MoveC) else item


def _insert(
    divided: Mapping[int, Sequence[Piece]], ends: FloatArray, vias: FloatArray
) -> tuple[Indices, FloatArray, FloatArray]:
    """The ends and via points of motions of which some are divided, and the index of each before.

    divided: pieces by index. Motions that are left out have pieces too.
    """
    counts = np.ones(len(ends), np.intp)
    kept = {index: pieces for index, pieces in divided.items() if index < len(ends)}
    for index, pieces in kept.items():
        counts[index] = len(pieces)
    before = np.repeat(np.arange(len(ends)), counts)
    ends, vias, places = ends[before], vias[before], np.cumsum(counts) - counts
    for index, pieces in kept.items():
        for place, (via, end) in enumerate(pieces, int(places[index])):
            ends[place], vias[place] = end, via or np.nan
    return before, ends, vias


def _divide(
    start: FloatArray, end: FloatArray, centre: FloatArray, left: bool, limits: Limits
) -> list[Piece]:
    """The pieces of an arc, as the machine makes them, none if the controller refuses it.

    start, end: (3,) mm.
    centre: (2,) from the start, mm.
    left: whether the arc is counterclockwise.
    """
    (x, y, z), (u, v, w), (i, j) = start.tolist(), end.tolist(), centre.tolist()
    arc = Arc("G17", "G3" if left else "G2", (x, y, z), (u, v, w), {"I": i, "J": j})
    try:
        return divide(arc, limits, inch=False)
    except LineError:
        return []


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
