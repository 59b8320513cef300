"""What strokes cover, as a value that goes from the planner to summary and report."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from camgen.geometry.arcs import chain
from camgen.geometry.ragged import owners, ramp
from camgen.geometry.rings import ComplexArray, Rings, make_rings
from camgen.geometry.segments import IntArray
from camgen.model.part import Part
from camgen.model.path import ToolPath
from camgen.model.pose import FloatArray, frozen
from camgen.model.tolerance import NONZERO
from camgen.plan import Coverage
from camgen.plan.fill.ground import Pixels, crossings, even_odd, outlines, spread

# What the strokes of a round tool cover: measured on the strokes as they will be run, by rows that cut them.

#: Rows by tool diameter; and how they lie: along no direction that boards are drawn in, so that every edge meets many.
_ROWS, _TURN = 12.7, np.exp(0.4j)
#: Rows at most.
_MOST_ROWS = 9000
#: Border crossings of a row stay below the first, passes that lie on each other below the second.
_PASS, _THIN = 1 << 20, 1 << 40


def spans(
    start: ComplexArray, end: ComplexArray, radius: float, pitch: float = 1.0
) -> tuple[IntArray, FloatArray, FloatArray]:
    """What a disc of `radius` that runs along lines covers of the rows v = n `pitch`: n, u from and u to, (M,)."""
    low, high = np.minimum(start.imag, end.imag) - radius, np.maximum(start.imag, end.imag) + radius
    line, row = spread(
        np.ceil(low / pitch).astype(np.int64), np.floor(high / pitch).astype(np.int64) + 1
    )
    v = row * pitch
    along = end - start
    # The outline of a disc that ran along a line: on either side the disc is where the row meets the line that touches
    # all of them, else at one of the two ends.
    lean = np.sign(along.imag) * along.real * radius / np.maximum(np.abs(along), NONZERO)
    rise = np.where(along.imag == 0, NONZERO, along.imag)
    sides = []
    for sign, towards in ((-1, lean), (1, -lean)):
        flat_end = (sign * along.real > 0) * 1.0
        t = np.clip((v - (start.imag + towards)[line]) / rise[line], 0.0, 1.0)
        t = np.where((along.imag == 0)[line], flat_end[line], t)
        off = v - (start.imag[line] + t * along.imag[line])
        sides.append(
            start.real[line]
            + t * along.real[line]
            + sign * np.sqrt(np.maximum(radius**2 - off**2, 0.0))
        )
    left, right = sides
    return row, left, right


def paint(start: ComplexArray, end: ComplexArray, radius: float, shape: tuple[int, int]) -> Pixels:
    """255 for the pixels (H, W) whose centres the disc passes over."""
    row, left, right = spans(start, end, radius)
    inside = (row >= 0) & (row < shape[0])
    row, left, right = row[inside], left[inside], right[inside]
    change = np.zeros((shape[0], shape[1] + 1), dtype=np.int16)
    flat = change.ravel()
    first, last = (
        np.clip(x, 0, shape[1]).astype(np.int64) for x in (np.ceil(left), np.floor(right) + 1)
    )
    np.add.at(flat, row * (shape[1] + 1) + first, np.int16(1))
    np.add.at(flat, row * (shape[1] + 1) + last, np.int16(-1))
    return np.asarray((np.cumsum(change[:, :-1], axis=1, dtype=np.int16) > 0) * np.uint8(255))


def lines_of(paths: Sequence[ComplexArray]) -> tuple[ComplexArray, ComplexArray]:
    """The lines (M,) of polylines, from and to; a single point is a line of no length."""
    if not paths:
        return np.zeros(0, dtype=complex), np.zeros(0, dtype=complex)
    start = np.concatenate([p[: max(len(p) - 1, 1)] for p in paths])
    return start, np.concatenate([p[1:] if len(p) > 1 else p for p in paths])


def measure(
    table: Rings,
    borders: ComplexArray,
    passes: Sequence[ComplexArray],
    thin: Sequence[ComplexArray],
    radius: float,
) -> Coverage:
    """The coverage of what `borders` enclose, even-odd, by polylines. All in mm."""
    borders = borders * _TURN
    passes, thin = ([line * _TURN for line in lines] for lines in (passes, thin))
    pitch = 2 * radius / _ROWS
    tall = float(np.ptp(borders.imag)) if len(borders) else 0.0
    pitch = max(pitch, tall / _MOST_ROWS)
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


# A picture of what strokes cover: what is covered, what stays bare, what is inked beside.

#: Neither, copper covered, copper bare, ink outside: blue, green, red.
COLOURS = ((255, 255, 255), (90, 160, 60), (40, 40, 220), (40, 190, 250))


#: Arcs are looked at as chords that leave them by such a part of the tool's diameter.
SAG = 1000


def run_along(path: ToolPath, sag: float) -> FloatArray:
    """(N, 2) mm along the path, arcs as chords that leave them by `sag` mm at most."""
    if np.isnan(path.via).all():
        return path.position[:, :2]
    found = chain(path.position, path.via[1:])
    with np.errstate(divide="ignore"):
        step = 2 * np.arccos(np.clip(1 - sag / found.radius, -1.0, 1.0))
    count = np.ceil(found.sweep / np.maximum(step, 1e-3)).clip(1).astype(np.int64)
    points = found.point((ramp(count) + 1) / count[owners(count)], owners(count))
    return np.append(path.position[:1, :2], points[:, :2], axis=0)


class Map(Struct, frozen=True, eq=False):
    """pixels: (H, W, 3) in `COLOURS`. work_from_map: (2, 3), mm of a pixel centre (u, v), v down."""

    pixels: Pixels
    work_from_map: FloatArray


def coverage_map(part: Part, paths: Sequence[ToolPath], diameter: float, most: int = 1600) -> Map:
    """What `paths` cover of the closed contours of `part` with a tool of `diameter` mm, at most `most` px."""
    counts, points, work_from_grid, _ = outlines(part, diameter / 2)
    border = (
        np.column_stack([points.real, points.imag]) @ work_from_grid[:, :2].T + work_from_grid[:, 2]
    )
    strokes = [run_along(path, diameter / SAG) for path in paths]
    everything = np.concatenate([border, *strokes])
    low, high = everything.min(axis=0) - diameter, everything.max(axis=0) + diameter
    pixel = float((high - low).max()) / most
    wide, tall = np.ceil((high - low) / pixel).astype(np.int64).tolist()

    def at(places: FloatArray) -> np.ndarray[tuple[int], np.dtype[np.complex128]]:
        return np.asarray(((places[:, 0] - low[0]) + 1j * (high[1] - places[:, 1])) / pixel)

    shape = (tall, wide)
    copper = even_odd(make_rings(counts), at(border), shape) > 0
    ink = paint(*lines_of([at(stroke) for stroke in strokes]), diameter / 2 / pixel, shape) > 0
    kind = np.where(copper, np.where(ink, 1, 2), np.where(ink, 3, 0))
    place = frozen([[pixel, 0.0, low[0]], [0.0, -pixel, high[1]]])
    return Map(np.array(COLOURS, dtype=np.uint8)[kind], place)
