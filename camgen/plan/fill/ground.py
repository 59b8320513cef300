"""What is to be covered, on a grid of pixels: the closed borders of a picture or a drawing, even-odd.

One grid for both, so that a board is covered the same whatever file it came in. The borders stay beside it as curves;
what must be exact is measured from them, not from pixels.
"""

from __future__ import annotations

import cv2
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.ragged import owners, stretches
from camgen.geometry.rings import ComplexArray, Rings, make_rings, unit
from camgen.geometry.segments import IntArray, flatten, from_contours
from camgen.model.errors import JobError
from camgen.model.part import Part, Raster
from camgen.model.pose import FloatArray
from camgen.plan.image_space.border import Border, border

Pixels = NDArray[np.uint8]
Distances = NDArray[np.float32]

#: The tool's radius in grid pixels: wanted of a picture, made of a drawing, and the least that can be worked with.
_WANTED_RADIUS_PX, _MADE_RADIUS_PX, _LEAST_RADIUS_PX = 2.2, 6.0, 1.4
#: Pixels of a grid at most, and the free ones around it.
_MOST_PIXELS, _FREE_PIXELS = 40_000_000, 4
#: From the centre of the nearest pixel outside to the border, px: the mean over all directions of an edge.
_OUTSIDE = 0.45


class Ground(Struct, frozen=True, eq=False):
    """mask: (H, W) 255 inside. depth: (H, W) px to the border, 0 outside. edge: the borders; what is inside may be on
    either side. contour: (L,) of each border the index of its contour, 0 for those of a picture. work_from_grid: (2, 3)
    mm of a pixel centre (u, v).
    """

    mask: Pixels
    depth: Distances
    edge: Border
    contour: IntArray
    work_from_grid: FloatArray

    @property
    def mm_per_px(self) -> float:
        """Mm."""
        return float(np.hypot(*self.work_from_grid[:, 0]))

    def placed(self, points: ComplexArray) -> FloatArray:
        """(N, 2) mm of `points` (N,) px."""
        linear, origin = self.work_from_grid[:, :2], self.work_from_grid[:, 2]
        return np.asarray(np.column_stack([points.real, points.imag]) @ linear.T + origin)


def ground(part: Part, radius: float) -> Ground:
    """The grid of a part for a tool of `radius` mm. JobError where the tool is too small for picture or drawing."""
    counts, points, work_from_grid, contour = outlines(part, radius)
    table = make_rings(counts)
    corner = _whole(points, np.minimum) - _FREE_PIXELS * (1 + 1j)
    high = _whole(points, np.maximum) - corner + _FREE_PIXELS * (1 + 1j)
    points = points - corner
    work_from_grid = work_from_grid @ np.array(
        [[1, 0, corner.real], [0, 1, corner.imag], [0, 0, 1]]
    )
    shape = (int(high.imag) + 2, int(high.real) + 2)
    mask = even_odd(table, points, shape)
    far = cv2.distanceTransform(mask, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    depth = np.asarray(cv2.max(cv2.subtract(far, _OUTSIDE), 0.0), dtype=np.float32)  # type: ignore[call-overload]
    return Ground(mask, depth, border(*_dense(table, points), shape), contour, work_from_grid)


def slope(field: Ground, pixels: ComplexArray) -> tuple[FloatArray, ComplexArray]:
    """Depth at `pixels` and its gradient, unit."""
    width = field.depth.shape[1]
    at = pixels.imag.astype(np.int64) * width + pixels.real.astype(np.int64)
    flat = field.depth.ravel()
    right, down = (
        np.sum(
            [flat[at + by + k] - flat[at - by + k] for k in (-side, 0, side)],
            axis=0,
            dtype=np.float64,
        )
        for by, side in ((1, width), (width, 1))
    )
    return flat[at].astype(np.float64), unit(np.asarray(right + 1j * down))


def outlines(part: Part, radius: float) -> tuple[IntArray, ComplexArray, FloatArray, IntArray]:
    """The closed borders of a part: points of each, the points px of the grid, work_from_grid, the contour of each."""
    seen = part.raster if part.raster is not None and part.raster.borders else None
    return _of_picture(seen, radius) if seen is not None else _of_drawing(part, radius)


def _whole(points: ComplexArray, pick: np.ufunc) -> complex:
    return complex(np.floor(pick.reduce(points.real)), np.floor(pick.reduce(points.imag)))


def _of_picture(seen: Raster, radius: float) -> tuple[IntArray, ComplexArray, FloatArray, IntArray]:
    mm_per_px = float(np.hypot(*seen.work_from_view[:, 0]))
    size = radius / mm_per_px
    finer = max(1.0, min(_WANTED_RADIUS_PX / size, float(np.sqrt(_MOST_PIXELS / seen.mask.size))))
    if size * finer < _LEAST_RADIUS_PX:
        what = f"{2 * radius:g} mm is {2 * size:.2g} px of the picture"
        raise JobError("job", what, "tool.diameter", "use a wider tool or a finer picture")
    points = np.concatenate([b[:, 0] + 1j * b[:, 1] for b in seen.borders])
    # Pixel centres of the view, in pixels `finer` times as small.
    points = (points + (0.5 + 0.5j)) * finer - (0.5 + 0.5j)
    shift = (0.5 / finer - 0.5) * np.ones(2)
    scale = np.array([[1 / finer, 0, shift[0]], [0, 1 / finer, shift[1]], [0, 0, 1]])
    counts = np.array([len(b) for b in seen.borders])
    return counts, points, seen.work_from_view @ scale, np.zeros(len(counts), dtype=np.int64)


def _of_drawing(part: Part, radius: float) -> tuple[IntArray, ComplexArray, FloatArray, IntArray]:
    closed = np.array([k for k, c in enumerate(part.contours) if c.closed], dtype=np.int64)
    segments = from_contours([part.contours[k] for k in closed.tolist()])
    points, owner = flatten(segments, radius / _MADE_RADIUS_PX / 20)
    counts = np.bincount(owner, minlength=len(closed))
    low, high = points.min(axis=0), points.max(axis=0)
    area = float(np.prod(high - low + radius))
    pixel = max(radius / _MADE_RADIUS_PX, float(np.sqrt(area / _MOST_PIXELS)))
    if radius / pixel < _LEAST_RADIUS_PX:
        wide, tall = (high - low).tolist()
        what = f"{2 * radius:g} mm is too small for a drawing of {wide:.0f} x {tall:.0f} mm"
        raise JobError(
            "job", what, "tool.diameter", "use a wider tool, or fill the drawing in parts"
        )
    # Outer edges lie between the centres of pixels: one that ran through them would count half a pixel of paper.
    low, high = low - pixel / 2, high + pixel / 2
    moved = ((points[:, 0] - low[0]) + 1j * (high[1] - points[:, 1])) / pixel
    return counts, moved, np.array([[pixel, 0, low[0]], [0, -pixel, high[1]]]), closed


def crossings(start: ComplexArray, end: ComplexArray) -> tuple[IntArray, FloatArray]:
    """Where lines cross rows, the whole numbers of v: the row and u of each, (M,). An end on a row belongs to one."""
    low, high = np.minimum(start.imag, end.imag), np.maximum(start.imag, end.imag)
    first, last = np.ceil(low).astype(np.int64), np.ceil(high).astype(np.int64)
    line, row = spread(first, last)
    slope = (end.real - start.real) / np.where(high > low, end.imag - start.imag, 1.0)
    return row, start.real[line] + (row - start.imag[line]) * slope[line]


def spread(first: IntArray, last: IntArray) -> tuple[IntArray, IntArray]:
    """All (k, n) with first[k] <= n < last[k], each (M,)."""
    count = np.maximum(last - first, 0)
    return owners(count), stretches(first, count)


def even_odd(table: Rings, points: ComplexArray, shape: tuple[int, int]) -> Pixels:
    """255 for the pixels (H, W) whose centres an odd number of the closed curves encloses."""
    row, u = crossings(points, points[table.shifted(1)])
    column = np.clip(np.ceil(u).astype(np.int64), 0, shape[1] - 1)
    toggles = np.zeros(shape, dtype=np.uint8)
    np.add.at(toggles.ravel(), row * shape[1] + column, np.uint8(1))
    # Odd stays odd when a sum of bytes overflows.
    return np.asarray((np.cumsum(toggles, axis=1, dtype=np.uint8) & 1) * np.uint8(255))


def _dense(table: Rings, points: ComplexArray) -> tuple[Rings, ComplexArray]:
    """The curves with points no farther apart than about two pixels."""
    step = points[table.shifted(1)] - points
    pieces = np.maximum(np.ceil(np.abs(step) / 2).astype(np.int64), 1)
    line, place = spread(np.zeros_like(pieces), pieces)
    count = np.bincount(table.loop, pieces, len(table.count)).astype(np.int64)
    return make_rings(count), points[line] + step[line] * (place / pieces[line])
