"""Fits lines and circles to many runs of points at once, from sums over each run (Taubin 1991).

A curve is F = A (x^2 + y^2) + B x + C y + D = 0 with B^2 + C^2 - 4 A D = 1 about an origin of its
own. It is a circle, or for A = 0 a line. Its distance from a point is 2 F / (1 + sqrt(1 + 4 A F)),
without a special case for circles that are almost lines. Sums are about a point near the run, and
are moved when runs are joined, so that no digits are lost far from the corner of the picture.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.geometry.rings import ComplexArray
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray
from camgen.model.tolerance import NONZERO

#: Numbers of a line, with one end.
_LINE_NUMBERS = 3
#: Numbers of an arc, with one end, and one more. So a bend has to reach four sigma, not three:
#: noise bends one line in a hundred by three.
_ARC_NUMBERS = 5
#: px: an arc that leaves its chord by less is a line. The remaining distortion of a photo bends
#: lines by as much.
_FLAT_PX = 0.05
#: Points of an arc, at least.
_MIN_ARC_POINTS = 4
#: Iterations of Newton's method for the smallest eigenvalue.
_NEWTON_ITERATIONS = 8


class Sums(Struct, frozen=True, eq=False):
    """Sums over the points of P runs.

    origin: (P,) origin of the sums, px.
    sums: (P, 10) sums of 1, x, y, xx, xy, yy, xz, yz, z, zz about the origin, with z = xx + yy.
    """

    origin: ComplexArray
    sums: FloatArray

    def take(self, rows: IntArray | BoolArray) -> Sums:
        """The runs chosen by index or mask."""
        return Sums(self.origin[rows], self.sums[rows])


class Curves(Struct, frozen=True, eq=False):
    """P lines and circles.

    origin: (P,) origin of each curve, px.
    form: (P, 4) A, B, C, D about the origin.
    sse: (P,) sum of the squared distances of the points of the run, px2.
    """

    origin: ComplexArray
    form: FloatArray
    sse: FloatArray

    def take(self, rows: IntArray | BoolArray) -> Curves:
        """The curves chosen by index or mask."""
        return Curves(self.origin[rows], self.form[rows], self.sse[rows])

    def distances(self, points: ComplexArray) -> FloatArray:
        """Signed distances (P, ...) px of points (P, ...) from their curves."""
        shape = (slice(None),) + (None,) * (points.ndim - 1)
        local = points - self.origin[shape]
        a, b, c, d = self.form.T[:, *shape]
        f = a * (local.real**2 + local.imag**2) + b * local.real + c * local.imag + d
        return np.asarray(2 * f / (1 + np.sqrt(np.maximum(1 + 4 * a * f, 0.0))))

    @property
    def curvature(self) -> FloatArray:
        """Signed curvature (P,), 1/px, 0 for lines."""
        return np.asarray(2 * self.form[:, 0])


def sum_runs(points: ComplexArray, weight: FloatArray, first: IntArray) -> Sums:
    """Sum over runs of consecutive points.

    points: (N,) u + iv, px.
    weight: (N,) weight of each point.
    first: (P,) row of the first point of each run.
    """
    count = np.diff(np.append(first, len(points)))
    origin = points[first + count // 2]
    local = points - np.repeat(origin, count)
    x, y = local.real, local.imag
    z = x * x + y * y
    columns = np.array([np.ones_like(x), x, y, x * x, x * y, y * y, x * z, y * z, z, z * z])
    return Sums(origin, np.add.reduceat(columns * weight, first, axis=1).T)


def move_sums(runs: Sums, origin: ComplexArray) -> Sums:
    """Move sums to other origins (P,), px."""
    shift = origin - runs.origin
    a, b = shift.real, shift.imag
    n, x, y, xx, xy, yy, xz, yz, z, zz = runs.sums.T
    c = a * a + b * b
    z1 = z - 2 * a * x - 2 * b * y + n * c
    columns = [
        n,
        x - n * a,
        y - n * b,
        xx - 2 * a * x + n * a * a,
        xy - a * y - b * x + n * a * b,
        yy - 2 * b * y + n * b * b,
        xz - 2 * a * xx - 2 * b * xy + c * x - a * z1,
        yz - 2 * a * xy - 2 * b * yy + c * y - b * z1,
        z1,
        zz + 4 * (a * a * xx + b * b * yy + 2 * a * b * xy - a * xz - b * yz - c * (a * x + b * y))
        + c * (2 * z + n * c),
    ]  # fmt: skip
    return Sums(origin, np.array(columns).T)


def join_sums(first: Sums, second: Sums) -> Sums:
    """Join each run of `first` with that of `second`; the origin is between, by their weights."""
    fraction = second.sums[:, 0] / np.maximum(first.sums[:, 0] + second.sums[:, 0], 1e-12)
    origin = first.origin + (second.origin - first.origin) * fraction
    return Sums(origin, move_sums(first, origin).sums + move_sums(second, origin).sums)


def fit_lines(runs: Sums) -> Curves:
    """Fit a line to each run, with the least sum of squared distances."""
    n, x, y, xx, xy, yy = runs.sums[:, :6].T
    n = np.maximum(n, 1e-12)
    mx, my = x / n, y / n
    sxx, sxy, syy = xx - n * mx * mx, xy - n * mx * my, yy - n * my * my
    half, rest = (sxx + syy) / 2, np.hypot((sxx - syy) / 2, sxy)
    angle = np.arctan2(2 * sxy, sxx - syy) / 2
    b, c = -np.sin(angle), np.cos(angle)
    form = np.array([np.zeros_like(b), b, c, -(b * mx + c * my)]).T
    return Curves(runs.origin, form, np.maximum(half - rest, 0.0))


def fit_circles(runs: Sums) -> Curves:
    """Fit a circle or line to each run by Taubin's method, nearly unbiased also for short arcs."""
    n = np.maximum(runs.sums[:, 0], 1e-12)
    middle = (runs.sums[:, 1] + 1j * runs.sums[:, 2]) / n
    centred = move_sums(runs, runs.origin + middle)
    _, _, _, xx, xy, yy, xz, yz, z, zz = centred.sums.T
    size = np.sqrt(np.maximum(4 * z / n, 1e-12))
    value, vector = _find_smallest((zz - z * z / n) / size**2, xx, yy, xz / size, yz / size, xy)
    a, b, c = vector[0] / size, vector[1], vector[2]
    d = -a * z / n
    norm = np.sqrt(np.maximum(b * b + c * c - 4 * a * d, 1e-30))
    form = (np.array([a, b, c, d]) / norm).T
    return Curves(centred.origin, form, np.maximum(value, 0.0))


def _find_smallest(
    p: FloatArray, q: FloatArray, r: FloatArray, pq: FloatArray, pr: FloatArray, qr: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The smallest eigenvalue (P,) and its unit vector (3, P) of symmetric 3 x 3 matrices.

    The matrices have no negative eigenvalues. So Newton's method on the characteristic polynomial,
    which starts at 0, approaches the smallest root from below. It is ten times as fast as LAPACK
    with one matrix at a time.

    p, q, r: (P,) the diagonal.
    pq, pr, qr: (P,) the elements beside it.
    """
    c2, c1 = p + q + r, q * r - qr * qr + p * r - pr * pr + p * q - pq * pq
    c0 = p * (q * r - qr * qr) - pq * (pq * r - qr * pr) + pr * (pq * qr - q * pr)
    value, twice_c2 = np.zeros_like(p), 2 * c2
    for _ in range(_NEWTON_ITERATIONS):
        slope = (3 * value - twice_c2) * value + c1
        slope = np.where(np.abs(slope) > NONZERO, slope, 1.0)
        value = value - (((value - c2) * value + c1) * value - c0) / slope
    p, q, r = p - value, q - value, r - value
    # The vector is perpendicular to all rows: the cross product of the two that are least parallel.
    crosses = np.array(
        [
            [pq * qr - pr * q, pr * pq - p * qr, p * q - pq * pq],
            [pq * r - pr * qr, pr * pr - p * r, p * qr - pq * pr],
            [q * r - qr * qr, qr * pr - pq * r, pq * qr - q * pr],
        ]
    )
    norm = (crosses**2).sum(axis=1)
    chosen = np.argmax(norm, axis=0)
    matrices = np.arange(len(value))
    length = np.sqrt(np.maximum(norm[chosen, matrices], NONZERO))
    return value, crosses[chosen, :, matrices].T / length


def count_numbers(curves: Curves) -> IntArray:
    """Count the numbers of each curve with one end of it, (P,)."""
    return np.where(curves.form[:, 0] == 0, _LINE_NUMBERS, _ARC_NUMBERS)


def fit_best(runs: Sums, sigma: FloatArray, price: float) -> tuple[Curves, FloatArray]:
    """Fit a line or circle to each run, whichever has the lower price.

    The price is the sum of squared distances in units of the noise, plus `price` for each number of
    the curve and of one end.

    sigma: (P,) noise of the points of each run, px.

    Returns the curves and their prices (P,).
    """
    straight, round_ = fit_lines(runs), fit_circles(runs)
    line_cost = straight.sse / sigma**2 + _LINE_NUMBERS * price
    arc_cost = round_.sse / sigma**2 + _ARC_NUMBERS * price
    count, squares = runs.sums[:, 0], runs.sums[:, 3] + runs.sums[:, 5]
    extent = np.sqrt(np.maximum(squares, 0) * 12 / np.maximum(count, 1))
    is_flat = np.abs(round_.curvature) * extent**2 / 8 < _FLAT_PX
    is_line = (line_cost <= arc_cost) | is_flat | (count < _MIN_ARC_POINTS)
    curves = Curves(
        np.where(is_line, straight.origin, round_.origin),
        np.where(is_line[:, None], straight.form, round_.form),
        np.where(is_line, straight.sse, round_.sse),
    )
    return curves, np.where(is_line, line_cost, arc_cost)
