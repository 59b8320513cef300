"""What the strokes of a round tool cover: measured on the strokes as they will be run, by rows that cut them.

On a row a stroke is a set of intervals, known exactly; so is what is to be covered. Rows are a small part of the tool's
width apart, and the sum over them is the area to a few parts in ten thousand.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from camgen.geometry.segments import IntArray
from camgen.planners.coverage import Coverage
from camgen.planners.fill_ground import Pixels, crossings, spread
from camgen.planners.image_space_rings import ComplexArray, Rings
from camgen.pose import FloatArray

#: Rows by tool diameter; and how they lie: along no direction that boards are drawn in, so that every edge meets many.
_ROWS, _TURN = 12.7, np.exp(0.4j)
#: Rows at most.
_MOST = 9000
#: Border crossings of a row stay below the first, passes that lie on each other below the second.
_PASS, _THIN = 1 << 20, 1 << 40


def spans(
    start: ComplexArray, end: ComplexArray, radius: float, pitch: float = 1.0
) -> tuple[IntArray, FloatArray, FloatArray]:
    """What a disc of ``radius`` that runs along lines covers of the rows v = n ``pitch``: n, u from and u to, (M,)."""
    low, high = np.minimum(start.imag, end.imag) - radius, np.maximum(start.imag, end.imag) + radius
    line, row = spread(np.ceil(low / pitch).astype(np.int64), np.floor(high / pitch).astype(np.int64) + 1)
    v = row * pitch
    along = end - start
    # The outline of a disc that ran along a line: on either side the disc is where the row meets the line that touches
    # all of them, else at one of the two ends.
    lean = np.sign(along.imag) * along.real * radius / np.maximum(np.abs(along), 1e-300)
    rise = np.where(along.imag == 0, 1e-300, along.imag)
    sides = []
    for sign, towards in ((-1, lean), (1, -lean)):
        flat_end = (sign * along.real > 0) * 1.0
        t = np.clip((v - (start.imag + towards)[line]) / rise[line], 0.0, 1.0)
        t = np.where((along.imag == 0)[line], flat_end[line], t)
        off = v - (start.imag[line] + t * along.imag[line])
        sides.append(start.real[line] + t * along.real[line] + sign * np.sqrt(np.maximum(radius**2 - off**2, 0.0)))
    left, right = sides
    return row, left, right


def painted(start: ComplexArray, end: ComplexArray, radius: float, shape: tuple[int, int]) -> Pixels:
    """255 for the pixels (H, W) whose centres the disc passes over."""
    row, left, right = spans(start, end, radius)
    inside = (row >= 0) & (row < shape[0])
    row, left, right = row[inside], left[inside], right[inside]
    change = np.zeros((shape[0], shape[1] + 1), dtype=np.int16)
    flat = change.ravel()
    first, last = (np.clip(x, 0, shape[1]).astype(np.int64) for x in (np.ceil(left), np.floor(right) + 1))
    np.add.at(flat, row * (shape[1] + 1) + first, np.int16(1))
    np.add.at(flat, row * (shape[1] + 1) + last, np.int16(-1))
    return np.asarray((np.cumsum(change[:, :-1], axis=1, dtype=np.int16) > 0) * np.uint8(255))


def lines_of(paths: Sequence[ComplexArray]) -> tuple[ComplexArray, ComplexArray]:
    """The lines (M,) of polylines, from and to; a single point is a line of no length."""
    if not paths:
        return np.zeros(0, dtype=complex), np.zeros(0, dtype=complex)
    start = np.concatenate([p[: max(len(p) - 1, 1)] for p in paths])
    return start, np.concatenate([p[1:] if len(p) > 1 else p for p in paths])


def measured(
    table: Rings, borders: ComplexArray, passes: Sequence[ComplexArray], thin: Sequence[ComplexArray], radius: float
) -> Coverage:
    """The coverage of what ``borders`` enclose, even-odd, by polylines. All in mm."""
    borders = borders * _TURN
    passes, thin = ([line * _TURN for line in lines] for lines in (passes, thin))
    pitch = 2 * radius / _ROWS
    tall = float(np.ptp(borders.imag)) if len(borders) else 0.0
    pitch = max(pitch, tall / _MOST)
    following = borders[table.shifted(1)]
    edge, place = crossings(*(p.real + 1j * (p.imag / pitch) for p in (borders, following)))
    events = [(edge, place, np.ones(len(edge), dtype=np.int64))]
    # One number counts all three: crossings of the border, passes and thin strokes above each other's reach.
    for weight, paths in ((_PASS, passes), (_THIN, thin)):
        own, left, right = spans(*lines_of(paths), radius, pitch)
        count = np.full(len(own), weight)
        events += [(own, left, count), (own, right, -count)]
    row, place, weights = (np.concatenate(column) for column in zip(*events, strict=True))
    key = (row - row.min()) * (float(np.ptp(place)) + 1.0) + (place - place.min())
    order = np.argsort(key, kind="stable")
    count = np.cumsum(weights[order])[:-1]
    length = np.diff(key[order])
    copper = count & 1 == 1
    thin_count, rest = np.divmod(count, _THIN)
    by_pass = rest >= _PASS
    inked = by_pass | (thin_count > 0)
    areas = (copper, copper & inked, ~copper & by_pass, ~copper & inked & ~by_pass)
    # Between the last interval of a row and the first of the next nothing is open, so that it counts for none.
    return Coverage(*(float(length[where].sum() * pitch) for where in areas))
