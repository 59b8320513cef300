"""The area to fill, on a grid of pixels: the closed borders of a picture or a drawing, even-odd.

One grid for both makes a board filled in the same way from any file. The borders are kept as
curves too; exact distances are measured from them, not from pixels.
"""

from __future__ import annotations

import cv2
import numpy as np
from msgspec import Struct

from camgen.geometry.ragged import count_rows, list_owners, list_range_numbers
from camgen.geometry.rings import ComplexArray, Rings, make_rings, normalize
from camgen.geometry.segments import IntArray, flatten, make_contour_segments
from camgen.model.errors import JobError
from camgen.model.part import Part, Raster, list_closed_rows
from camgen.model.pose import FloatArray
from camgen.model.sequences import take_rows
from camgen.plan.image_space.border import Border, make_border
from camgen.plan.image_space.field import Distances, Pixels

#: Radius of the tool in pixels of the grid: usual one for a picture and for a drawing, minimum.
_PICTURE_RADIUS_PX, _DRAWING_RADIUS_PX, _MIN_RADIUS_PX = 2.2, 6.0, 1.4
#: Maximum number of pixels of a grid, and number of free pixels on each side.
_MAX_PIXELS, _FREE_PIXELS = 40_000_000, 4
#: Distance from the centre of the nearest pixel outside to the border, px: mean of all directions.
_OUTSIDE = 0.45


class FillGrid(Struct, frozen=True, eq=False):
    """The area to fill on a grid of pixels.

    mask: (H, W) 255 inside.
    depth: (H, W) distance from the border, px, 0 outside.
    edge: the borders; the inside may be on either side of them.
    contour: (L,) index of the contour of each border, 0 for the borders of a picture.
    work_from_grid: (2, 3) matrix from a pixel centre (u, v) to mm.
    """

    mask: Pixels
    depth: Distances
    edge: Border
    contour: IntArray
    work_from_grid: FloatArray

    @property
    def mm_per_px(self) -> float:
        """Size of a pixel, mm."""
        return float(np.hypot(*self.work_from_grid[:, 0]))

    def to_work(self, points: ComplexArray) -> FloatArray:
        """(N, 2) `points` (N,) px in the work frame, mm."""
        linear, origin = self.work_from_grid[:, :2], self.work_from_grid[:, 2]
        return np.asarray(np.column_stack([points.real, points.imag]) @ linear.T + origin)


def make_grid(part: Part, radius: float) -> FillGrid:
    """The grid of a part for a tool of `radius` mm.

    Raises JobError if the tool is too small for the picture or the drawing.
    """
    counts, points, work_from_grid, contour = find_outlines(part, radius)
    table = make_rings(counts)
    corner = _round_down(points, np.minimum) - _FREE_PIXELS * (1 + 1j)
    high = _round_down(points, np.maximum) - corner + _FREE_PIXELS * (1 + 1j)
    points = points - corner
    shift = np.array([[1, 0, corner.real], [0, 1, corner.imag], [0, 0, 1]])
    shape = (int(high.imag) + 2, int(high.real) + 2)
    mask = mask_even_odd(table, points, shape)
    far = cv2.distanceTransform(mask, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    # The types of OpenCV do not allow a number as second operand.
    above = cv2.max(cv2.subtract(far, _OUTSIDE), 0.0)  # type: ignore[call-overload]
    depth = np.asarray(above, dtype=np.float32)
    return FillGrid(
        mask,
        depth,
        make_border(*_make_dense(table, points), shape),
        contour,
        work_from_grid @ shift,
    )


def compute_slope(field: FillGrid, pixels: ComplexArray) -> tuple[FloatArray, ComplexArray]:
    """(N,) depth at `pixels`, px, and the unit vectors of its gradient."""
    width = field.depth.shape[1]
    index = pixels.imag.astype(np.int64) * width + pixels.real.astype(np.int64)
    flat = field.depth.ravel()
    slopes = []
    for step, across in ((1, width), (width, 1)):
        rises = [flat[index + step + k] - flat[index - step + k] for k in (-across, 0, across)]
        slopes.append(np.sum(rises, axis=0, dtype=np.float64))
    right, down = slopes
    return flat[index].astype(np.float64), normalize(np.asarray(right + 1j * down))


def find_outlines(part: Part, radius: float) -> tuple[IntArray, ComplexArray, FloatArray, IntArray]:
    """The closed borders of a part for a tool of `radius` mm.

    Returns the number of points of each border, the points in px of the grid, work_from_grid, and
    the index of the contour of each border.
    """
    if part.raster is not None and part.raster.borders:
        return _outline_picture(part.raster, radius)
    return _outline_drawing(part, radius)


def _round_down(points: ComplexArray, pick: np.ufunc) -> complex:
    return complex(np.floor(pick.reduce(points.real)), np.floor(pick.reduce(points.imag)))


def _outline_picture(
    raster: Raster, radius: float
) -> tuple[IntArray, ComplexArray, FloatArray, IntArray]:
    size = radius / float(np.hypot(*raster.work_from_view[:, 0]))
    factor = max(
        1.0, min(_PICTURE_RADIUS_PX / size, float(np.sqrt(_MAX_PIXELS / raster.mask.size)))
    )
    if size * factor < _MIN_RADIUS_PX:
        raise JobError(
            "job",
            f"{2 * radius:g} mm is {2 * size:.2g} px of the picture",
            "tool.diameter",
            "use a wider tool or a finer picture",
        )
    pixels = np.concatenate(raster.borders)
    # Centres of the view's pixels, in pixels of the grid, which are `factor` times as small.
    points = (pixels[:, 0] + 1j * pixels[:, 1] + (0.5 + 0.5j)) * factor - (0.5 + 0.5j)
    shift = (0.5 / factor - 0.5) * np.ones(2)
    scale = np.array([[1 / factor, 0, shift[0]], [0, 1 / factor, shift[1]], [0, 0, 1]])
    counts = count_rows(raster.borders)
    return counts, points, raster.work_from_view @ scale, np.zeros(len(counts), dtype=np.int64)


def _outline_drawing(
    part: Part, radius: float
) -> tuple[IntArray, ComplexArray, FloatArray, IntArray]:
    closed = np.array(list_closed_rows(part.contours), dtype=np.int64)
    segments = make_contour_segments(take_rows(part.contours, closed))
    points, owner = flatten(segments, radius / _DRAWING_RADIUS_PX / 20)
    counts = np.bincount(owner, minlength=len(closed))
    low, high = points.min(axis=0), points.max(axis=0)
    area = float(np.prod(high - low + radius))
    pixel = max(radius / _DRAWING_RADIUS_PX, float(np.sqrt(area / _MAX_PIXELS)))
    if radius / pixel < _MIN_RADIUS_PX:
        wide, tall = (high - low).tolist()
        raise JobError(
            "job",
            f"{2 * radius:g} mm is too small for a drawing of {wide:.0f} x {tall:.0f} mm",
            "tool.diameter",
            "use a wider tool, or fill the drawing in parts",
        )
    # Outer edges run between the centres of pixels, so that no half pixel of paper counts.
    low, high = low - pixel / 2, high + pixel / 2
    moved = ((points[:, 0] - low[0]) + 1j * (high[1] - points[:, 1])) / pixel
    return counts, moved, np.array([[pixel, 0, low[0]], [0, -pixel, high[1]]]), closed


def find_crossings(start: ComplexArray, end: ComplexArray) -> tuple[IntArray, FloatArray]:
    """The points at which lines cross rows of the grid: row and u of each, (M,).

    An end on a row belongs to one of its two lines.
    """
    low, high = np.minimum(start.imag, end.imag), np.maximum(start.imag, end.imag)
    first, last = np.ceil(low).astype(np.int64), np.ceil(high).astype(np.int64)
    line, row = expand_ranges(first, last)
    slope = (end.real - start.real) / np.where(high > low, end.imag - start.imag, 1.0)
    return row, start.real[line] + (row - start.imag[line]) * slope[line]


def expand_ranges(first: IntArray, last: IntArray) -> tuple[IntArray, IntArray]:
    """All pairs (k, n) with first[k] <= n < last[k], as two arrays (M,)."""
    count = np.maximum(last - first, 0)
    return list_owners(count), list_range_numbers(first, count)


def mask_even_odd(table: Rings, points: ComplexArray, shape: tuple[int, int]) -> Pixels:
    """(H, W) 255 for pixels whose centres an odd number of the closed curves encloses."""
    row, u = find_crossings(points, points[table.shifted(1)])
    column = np.clip(np.ceil(u).astype(np.int64), 0, shape[1] - 1)
    toggles = np.zeros(shape, dtype=np.uint8)
    np.add.at(toggles.ravel(), row * shape[1] + column, np.uint8(1))
    # Odd stays odd when a sum of bytes overflows.
    return np.asarray((np.cumsum(toggles, axis=1, dtype=np.uint8) & 1) * np.uint8(255))


def _make_dense(table: Rings, points: ComplexArray) -> tuple[Rings, ComplexArray]:
    step = points[table.shifted(1)] - points
    pieces = np.maximum(np.ceil(np.abs(step) / 2).astype(np.int64), 1)
    line, place = expand_ranges(np.zeros_like(pieces), pieces)
    count = np.bincount(table.loop, pieces, len(table.count)).astype(np.int64)
    return make_rings(count), points[line] + step[line] * (place / pieces[line])
