"""Divides a picture into cells, means of n x n pixels, and fits the bench behind the part in them.

Light, tones and the bench change slowly over the picture. So they are measured in the cells, at a
small part of the cost; only the last comparison is made at every pixel. The bench is the background
of the part. It is a smooth surface, fitted robustly: cells that belong to something else do not
pull it away.
"""

from __future__ import annotations

from functools import cached_property
from itertools import product

import cv2
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.model.tolerance import SIGMAS_OF_MEDIAN

# Smooth surfaces through the cells of a picture.

Doubles = NDArray[np.float64]
#: Rows and columns of cells.
Places = tuple[NDArray[np.intp], NDArray[np.intp]]

#: Cells of a fit, at most: more cost time and change little.
_MAX_SAMPLES = 4_000
#: Sigmas at which a value has no weight any more. Tukey's biweight with this constant is 95 %
#: efficient for normal noise (Beaton and Tukey 1974).
_TUKEY = 4.685
#: Grey values: a standard deviation of a fit is at least this, so that it is never 0.
_MIN_SIGMA = 0.4
#: Iterations of least absolute values. They need no start and bear a third of outliers.
_ABSOLUTE_ITERATIONS = 10
#: Iterations of the biweight, which follow them.
_BIWEIGHT_ITERATIONS = 6

#: Exponents of x and of y in the terms of a surface.
Powers = tuple[tuple[int, int], ...]


def _list_powers(degree: int) -> Powers:
    exponents = product(range(degree + 1), repeat=2)
    return tuple((m, n) for n, m in exponents if m + n <= degree)


_QUADRATIC, _QUARTIC = _list_powers(2), _list_powers(4)


def sample_cells(mask: NDArray[np.bool_]) -> Places:
    """Rows and columns of at most `_MAX_SAMPLES` true cells of `mask` (h, w), evenly spread."""
    places = np.flatnonzero(mask)
    rows, columns = np.divmod(places[:: len(places) // _MAX_SAMPLES + 1], mask.shape[1])
    return rows, columns


def compute_terms(shape: tuple[int, ...], places: Places, powers: Powers = _QUADRATIC) -> Doubles:
    """Products of powers of x and y, (N, 6) up to the second one, at N cells of a picture.

    shape: (h, w) of the picture, over which x and y run from -1 to 1.
    powers: exponents of the products.
    """
    x, y = _compute_axes(shape)
    rows, columns = places
    count = max(max(powers)) + 1
    x_powers = np.vander(x[columns], count, increasing=True)
    y_powers = np.vander(y[rows], count, increasing=True)
    return np.column_stack([x_powers[:, m] * y_powers[:, n] for m, n in powers])


def evaluate_surface(shape: tuple[int, ...], coefficients: Doubles) -> NDArray[np.float32]:
    """Values (h, w) of a surface with 6 (second power) or 15 coefficients (fourth power)."""
    powers = _QUADRATIC if len(coefficients) == len(_QUADRATIC) else _QUARTIC
    degree = max(max(powers))
    table = np.zeros((degree + 1, degree + 1))
    for (m, n), factor in zip(powers, coefficients.tolist(), strict=True):
        table[n, m] = factor
    x, y = _compute_axes(shape)
    rows = np.vander(y, degree + 1, increasing=True).astype(np.float32)
    columns = np.vander(x, degree + 1, increasing=True).astype(np.float32)
    # Not by @: BLAS starts its threads for it, and waits for them on a busy machine.
    return np.asarray(np.einsum("im,jm->ij", rows @ table.astype(np.float32), columns), np.float32)


def _compute_axes(shape: tuple[int, ...]) -> tuple[Doubles, Doubles]:
    """Coordinates x of all columns and y of all rows, at the middle of the cells."""
    height, width = shape[:2]
    return (np.arange(width) * 2 + 1) / width - 1, (np.arange(height) * 2 + 1) / height - 1


def fit_robustly(
    terms: Doubles, wanted: Doubles, absolute_iterations: int = _ABSOLUTE_ITERATIONS
) -> tuple[Doubles, float]:
    """Fit `wanted` (N,) by the columns of `terms` (N, c), robust against outliers.

    Iteratively re-weighted least squares: the weights first minimize the absolute values of the
    residuals, then they are Tukey's biweight.

    Returns the coefficients (c,) and the standard deviation of the residuals without outliers.
    """
    weights = np.ones_like(wanted)
    # A little on the diagonal: with three columns of cells, or a bench of one tone, the cells do
    # not determine all coefficients.
    ridge = 1e-7 * np.eye(terms.shape[1]) * float(np.square(terms).sum(axis=0).max())
    for iteration in range(absolute_iterations + _BIWEIGHT_ITERATIONS):
        weighted = terms * weights[:, None]
        coefficients = np.asarray(
            np.linalg.solve(weighted.T @ terms + ridge, weighted.T @ wanted), np.float64
        )
        residuals = np.asarray(wanted - terms @ coefficients, np.float64)
        sigma = _measure_spread(residuals)
        if iteration < absolute_iterations:
            weights = np.asarray(1 / np.maximum(np.abs(residuals), sigma / 4))
        else:
            weights = _compute_biweight(residuals, sigma)
    return coefficients, sigma


def _measure_spread(residuals: NDArray[np.floating]) -> float:
    """Standard deviation from the median distance to 0, so that outliers do not count.

    At least `_MIN_SIGMA`, also for an empty array.
    """
    if not residuals.size:
        return _MIN_SIGMA
    return max(_MIN_SIGMA, SIGMAS_OF_MEDIAN * float(np.median(np.abs(residuals))))


def _compute_biweight(residuals: Doubles, sigma: float) -> Doubles:
    """Tukey's biweight of each residual: 1 at 0, falling to 0 at `_TUKEY` sigmas."""
    return np.asarray(
        np.square(np.clip(1 - np.square(residuals / (_TUKEY * sigma)), 0, None)), np.float64
    )


def compute_covariance(values: Doubles) -> Doubles:
    """Covariance matrix (c, c) of N rows `values` (N, c)."""
    deviations = values - values.mean(axis=0)
    return np.asarray(deviations.T @ deviations / len(deviations), np.float64)


# The cells of a picture.

Floats = NDArray[np.float32]
Bools = NDArray[np.bool_]
Bytes = NDArray[np.uint8]

#: Cells of a picture, at most about this number: enough for parts of 1/500 of the width of the
#: picture, and for 3 ms per step.
_MAX_CELLS = 200_000
#: Grey values of noise in a cell, a standard deviation. More is smoothed away.
_MAX_NOISE = 1.0
#: Width of the rim as a fraction of the shorter side. The rim should be bench.
_RIM_FRACTION = 0.03


class Cells(Struct, frozen=True, eq=False, dict=True):
    """A picture in cells.

    Cell (i, j) covers the pixels from size * i to size * i + size - 1. Columns at the right and
    rows at the bottom that do not fill a cell belong to none.

    values: (h, w) grey or (h, w, 3) blue, green, red, float32: mean of the pixels of each cell.
    valid: (h, w), True if the photo shows all pixels of the cell.
    size: side of a cell, px.
    """

    values: Floats
    valid: Bools
    size: int

    @cached_property
    def rim(self) -> Bools:
        """The valid cells along the border of the valid area, (h, w)."""
        return select_rim(self.valid)


class Bench(Struct, frozen=True, eq=False):
    """The bench, which is the background of the part, in one channel.

    values: (h, w) float32, the smooth values that the cells would have without the part.
    sigma: standard deviation of the cells of the bench from `values`.
    """

    values: Floats
    sigma: float


def make_cells(pixels: Bytes, valid: Bools | None) -> Cells:
    """Divide a picture (H, W) or (H, W, 3) into cells.

    valid: (H, W), the pixels that the photo shows; None for all.
    """
    height, width = pixels.shape[:2]
    size = max(1, min(round(np.sqrt(height * width / _MAX_CELLS)), height, width))
    values = _smooth_noise(shrink(pixels, size).astype(np.float32))
    if valid is None:
        return Cells(values, np.ones(values.shape[:2], np.bool_), size)
    return Cells(values, shrink(valid.view(np.uint8) * np.uint8(255), size) == 255, size)


def _smooth_noise(values: Floats) -> Floats:
    """Smooth the cells if their noise is above `_MAX_NOISE`, as in cells of a pixel or two.

    The noise is measured between cells two columns apart.
    """
    differences = 2 * values[:, 2:-2] - values[:, :-4] - values[:, 4:]
    if not differences.size:
        return values
    noise = SIGMAS_OF_MEDIAN * float(np.median(np.abs(differences[::2]))) / 6**0.5
    if noise <= _MAX_NOISE:
        return values
    sigma = min(max(noise / _MAX_NOISE / (2 * np.pi**0.5), 0.6), 1.5)
    return np.asarray(cv2.GaussianBlur(values, (0, 0), sigma), np.float32)


def shrink(pixels: Bytes, size: int) -> Bytes:
    """Means of `size` x `size` pixels, rounded to whole grey values.

    Cells need no fractions, as they are averaged again.
    """
    rows, columns = pixels.shape[0] // size, pixels.shape[1] // size
    covered = pixels[: rows * size, : columns * size]
    return np.asarray(cv2.resize(covered, (columns, rows), interpolation=cv2.INTER_AREA), np.uint8)


def measure_depth(region: Bools) -> Floats:
    """Distance (h, w) of each cell of `region` to the nearest cell outside of it, cells.

    0 outside. The border of the picture does not count as outside.
    """
    return np.asarray(cv2.distanceTransform(region.view(np.uint8), cv2.DIST_L2, 5), np.float32)


def select_inner_cells(region: Bools) -> Bools:
    """The cells of `region` (h, w) whose eight neighbours belong to it too."""
    eroded = cv2.erode(region.view(np.uint8), np.ones((3, 3), np.uint8))
    return np.asarray(eroded.view(np.bool_))


def select_rim(valid: Bools) -> Bools:
    """The valid cells along the border of the valid area, (h, w); at least two cells wide."""
    framed = cv2.copyMakeBorder(valid.view(np.uint8), 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0)
    depth = cv2.distanceTransform(framed, cv2.DIST_L2, 5)[1:-1, 1:-1]
    return np.asarray(valid & (depth <= max(2.0, _RIM_FRACTION * min(valid.shape))), np.bool_)


def fit_bench(values: Floats, cells: Cells) -> Bench:
    """Fit the bench in one channel `values` (h, w) by a smooth surface.

    First a surface of the second power through the rim, then one of the fourth power through the
    rim and all cells that agree with the first. The part and other things may cover a third of the
    rim.
    """
    rim, valid = cells.rim, cells.valid
    places = sample_cells(rim)
    wanted = values[places].astype(np.float64)
    coefficients, sigma = fit_robustly(compute_terms(valid.shape, places), wanted)
    distance = np.abs(values - evaluate_surface(valid.shape, coefficients))
    places = sample_cells(rim | (valid & (distance < 4 * sigma)))
    # Light that falls off through a lens needs the fourth power.
    terms = compute_terms(valid.shape, places, _QUARTIC)
    wanted = values[places].astype(np.float64)
    coefficients, sigma = fit_robustly(terms, wanted, absolute_iterations=4)
    return Bench(evaluate_surface(valid.shape, coefficients), sigma)
