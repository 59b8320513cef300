"""Measures and paints the area that the strokes of a round tool cover."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from camgen.geometry.arcs import make_span_chain
from camgen.geometry.ragged import concatenate_columns, list_owners, number_rows
from camgen.geometry.rings import ComplexArray, Rings, make_rings
from camgen.geometry.segments import IntArray
from camgen.model.part import Part
from camgen.model.path import ToolPath
from camgen.model.pose import FloatArray, frozen
from camgen.model.tolerance import NONZERO
from camgen.plan import Coverage
from camgen.plan.fill.ground import (
    expand_ranges,
    find_crossings,
    find_outlines,
    mask_even_odd,
)
from camgen.plan.image_space.field import Pixels

# The covered area is measured on the strokes as they will be run, along rows across them.

#: Number of rows per tool diameter, and their direction. No edge of a board is drawn along it, so
#: every edge crosses many rows.
_ROWS, _TURN = 12.7, np.exp(0.4j)
#: Maximum number of rows.
_MAX_ROWS = 9000
#: Weights that count three things in one number. A row has fewer border crossings than the first,
#: and fewer overlapping passes than the second divided by the first.
_PASS, _THIN = 1 << 20, 1 << 40


def compute_spans(
    start: ComplexArray,
    end: ComplexArray,
    radius: float,
    pitch: float = 1.0,
    rows: tuple[float, float] = (-np.inf, np.inf),
) -> tuple[IntArray, FloatArray, FloatArray]:
    """The intervals of the rows v = n `pitch` that a disc covers while it runs along lines.

    rows: first n, and the one after the last.

    Returns n, and u of both ends, (M,).
    """
    low, high = np.minimum(start.imag, end.imag) - radius, np.maximum(start.imag, end.imag) + radius
    first = np.clip(np.ceil(low / pitch), *rows).astype(np.int64)
    last = np.clip(np.floor(high / pitch) + 1, *rows).astype(np.int64)
    line, row = expand_ranges(first, last)
    v = row * pitch
    along = end - start
    # On each side a row meets the line that touches all discs, or the disc at one of the ends.
    lean = np.sign(along.imag) * along.real * radius / np.maximum(np.abs(along), NONZERO)
    rise = np.where(along.imag == 0, NONZERO, along.imag)
    sides = []
    for sign, shift in ((-1, lean), (1, -lean)):
        flat_end = (sign * along.real > 0) * 1.0
        t = np.clip((v - (start.imag + shift)[line]) / rise[line], 0.0, 1.0)
        t = np.where((along.imag == 0)[line], flat_end[line], t)
        height = v - (start.imag[line] + t * along.imag[line])
        half = sign * np.sqrt(np.maximum(radius**2 - height**2, 0.0))
        sides.append(start.real[line] + t * along.real[line] + half)
    left, right = sides
    return row, left, right


def paint(start: ComplexArray, end: ComplexArray, radius: float, shape: tuple[int, int]) -> Pixels:
    """(H, W) 255 for the pixels over whose centres a disc passes along lines."""
    row, left, right = compute_spans(start, end, radius, rows=(0, shape[0]))
    change = np.zeros((shape[0], shape[1] + 1), dtype=np.int16)
    flat = change.ravel()
    first = np.clip(np.ceil(left), 0, shape[1]).astype(np.int64)
    last = np.clip(np.floor(right) + 1, 0, shape[1]).astype(np.int64)
    np.add.at(flat, row * (shape[1] + 1) + first, np.int16(1))
    np.add.at(flat, row * (shape[1] + 1) + last, np.int16(-1))
    return np.asarray((np.cumsum(change[:, :-1], axis=1, dtype=np.int16) > 0) * np.uint8(255))


def split_lines(paths: Sequence[ComplexArray]) -> tuple[ComplexArray, ComplexArray]:
    """Start and end (M,) of the lines of polylines. A single point is a line of length 0."""
    if not paths:
        return np.zeros(0, dtype=complex), np.zeros(0, dtype=complex)
    start = np.concatenate([p[: max(len(p) - 1, 1)] for p in paths])
    return start, np.concatenate([p[1:] if len(p) > 1 else p for p in paths])


def measure_areas(
    table: Rings,
    borders: ComplexArray,
    passes: Sequence[ComplexArray],
    thin: Sequence[ComplexArray],
    radius: float,
) -> Coverage:
    """The coverage of the area inside `borders`, even-odd, by polylines. All lengths in mm.

    table: lengths of the borders.
    passes: polylines whose ink outside is counted as `outside`.
    thin: polylines whose ink outside is counted as `thin`.
    radius: radius of the tool.
    """
    borders = borders * _TURN
    height = float(np.ptp(borders.imag)) if len(borders) else 0.0
    pitch = max(2 * radius / _ROWS, height / _MAX_ROWS)
    following = borders[table.shifted(1)]
    start = borders.real + 1j * (borders.imag / pitch)
    edge, place = find_crossings(start, following.real + 1j * (following.imag / pitch))
    events = [(edge, place, np.ones(len(edge), dtype=np.int64))]
    for weight, paths in ((_PASS, passes), (_THIN, thin)):
        first, last = split_lines(paths)
        rows, left, right = compute_spans(first * _TURN, last * _TURN, radius, pitch)
        count = np.full(len(rows), weight)
        events += [(rows, left, count), (rows, right, -count)]
    row, place, weights = concatenate_columns(events)
    key = (row - row.min()) * (float(np.ptp(place)) + 1.0) + (place - place.min())
    order = np.argsort(key, kind="stable")
    count = np.cumsum(weights[order])[:-1]
    length = np.diff(key[order])
    copper = count & 1 == 1
    thin_count, remainder = np.divmod(count, _THIN)
    by_pass = remainder >= _PASS
    inked = by_pass | (thin_count > 0)
    # All counts are 0 between the last event of a row and the first of the next one.
    masks = (copper, copper & inked, ~copper & by_pass, ~copper & inked & ~by_pass)
    return Coverage(*(float(length[mask].sum() * pitch) for mask in masks))


# A picture of the covered area, the bare area, and the ink outside.

#: Colours (blue, green, red) of neither, covered copper, bare copper, and ink outside.
COLOURS = ((255, 255, 255), (90, 160, 60), (40, 40, 220), (40, 190, 250))


#: Tool diameter divided by the sagitta of the chords of an arc.
SAG = 1000


def run_along(path: ToolPath, sag: float) -> FloatArray:
    """(N, 2) points along a path, mm, with arcs as chords of a sagitta of at most `sag` mm."""
    if np.isnan(path.via).all():
        return path.position[:, :2]
    arcs = make_span_chain(path.position, path.via[1:])
    with np.errstate(divide="ignore"):
        step = 2 * np.arccos(np.clip(1 - sag / arcs.radius, -1.0, 1.0))
    count = np.ceil(arcs.sweep / np.maximum(step, 1e-3)).clip(1).astype(np.int64)
    points = arcs.point((number_rows(count) + 1) / count[list_owners(count)], list_owners(count))
    return np.append(path.position[:1, :2], points[:, :2], axis=0)


class Map(Struct, frozen=True, eq=False):
    """A picture of the covered area.

    pixels: (H, W, 3) in `COLOURS`.
    work_from_map: (2, 3) matrix from a pixel centre (u, v), v down, to mm.
    """

    pixels: Pixels
    work_from_map: FloatArray


def make_coverage_map(
    part: Part, paths: Sequence[ToolPath], diameter: float, size: int = 1600
) -> Map:
    """A picture of the area that `paths` cover inside the closed contours of `part`.

    diameter: diameter of the tool, mm.
    size: number of pixels of the longer side.
    """
    counts, points, work_from_grid, _ = find_outlines(part, diameter / 2)
    pixels = np.column_stack([points.real, points.imag])
    border = pixels @ work_from_grid[:, :2].T + work_from_grid[:, 2]
    strokes = [run_along(path, diameter / SAG) for path in paths]
    everything = np.concatenate([border, *strokes])
    low, high = everything.min(axis=0) - diameter, everything.max(axis=0) + diameter
    pixel = float((high - low).max()) / size
    width, height = np.ceil((high - low) / pixel).astype(np.int64).tolist()

    def to_pixels(places: FloatArray) -> np.ndarray[tuple[int], np.dtype[np.complex128]]:
        return np.asarray(((places[:, 0] - low[0]) + 1j * (high[1] - places[:, 1])) / pixel)

    shape = (height, width)
    copper = mask_even_odd(make_rings(counts), to_pixels(border), shape) > 0
    lines = split_lines([to_pixels(stroke) for stroke in strokes])
    ink = paint(*lines, diameter / 2 / pixel, shape) > 0
    kind = np.where(copper, np.where(ink, 1, 2), np.where(ink, 3, 0))
    work_from_map = frozen([[pixel, 0.0, low[0]], [0.0, -pixel, high[1]]])
    return Map(np.array(COLOURS, dtype=np.uint8)[kind], work_from_map)
