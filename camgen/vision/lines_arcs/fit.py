"""Lines and circles fitted to many runs of points at once, from sums over each run (Taubin 1991).

A curve is A (x^2 + y^2) + B x + C y + D = 0 with B^2 + C^2 - 4 A D = 1 about an origin of its own: a circle, or for
A = 0 a line. Its distance from a point is 2 F / (1 + sqrt(1 + 4 A F)), F being the left side, without a special case
for circles that are almost lines. Sums are kept about a point near the run, and moved when runs are joined, so that
no digits are lost far from the picture's corner.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.rings import ComplexArray
from camgen.model.part import IntArray
from camgen.model.pose import FloatArray
from camgen.model.tolerance import NONZERO

BoolArray = NDArray[np.bool_]

#: Numbers that tell a line and an arc, one end of each included; an arc counts one more, so that it takes four sigma
#: of a bend, not three, to be none of the one line in a hundred that noise bends.
_LINE_NUMBERS, _ARC_NUMBERS = 3, 5
#: An arc that leaves its chord by less (px) is a line: residual distortion of the photo bends lines by as much.
_FLAT_PX = 0.05
_FEWEST_FOR_ARC = 4
_NEWTON = 8


class Sums(Struct, frozen=True, eq=False):
    """For P runs: origin (P,) and the sums (P, 10) of 1, x, y, xx, xy, yy, xz, yz, z, zz about it, z = xx + yy."""

    origin: ComplexArray
    sums: FloatArray

    def take(self, rows: IntArray | BoolArray) -> Sums:
        """The runs chosen by index or mask."""
        return Sums(self.origin[rows], self.sums[rows])


class Curves(Struct, frozen=True, eq=False):
    """origin (P,) px; form (P, 4): A, B, C, D about it; sse (P,): sum of squared distances of the run, px2."""

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
        a, b, c, d = (self.form[:, k][shape] for k in range(4))
        f = a * (local.real**2 + local.imag**2) + b * local.real + c * local.imag + d
        return np.asarray(2 * f / (1 + np.sqrt(np.maximum(1 + 4 * a * f, 0.0))))

    @property
    def curvature(self) -> FloatArray:
        """(P,) 1/px, 0 for lines."""
        return np.asarray(2 * self.form[:, 0])


def sum_runs(points: ComplexArray, weight: FloatArray, first: IntArray) -> Sums:
    """Sums over runs of consecutive ``points`` (N,) that begin at the rows ``first`` (P,)."""
    count = np.diff(np.append(first, len(points)))
    origin = points[first + count // 2]
    local = points - np.repeat(origin, count)
    x, y = local.real, local.imag
    z = x * x + y * y
    columns = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y, x * z, y * z, z, z * z])
    return Sums(origin, np.add.reduceat(columns * weight, first, axis=1).T)


def move_sums(runs: Sums, origin: ComplexArray) -> Sums:
    """The same sums about other origins (P,)."""
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
    return Sums(origin, np.stack(columns, axis=1))


def join_sums(one: Sums, two: Sums) -> Sums:
    """Sums of each run of ``one`` together with that of ``two``, about their common centre."""
    n = np.maximum(one.sums[:, 0] + two.sums[:, 0], 1e-12)
    share = two.sums[:, 0] / n
    middle = one.origin + (two.origin - one.origin) * share
    return Sums(middle, move_sums(one, middle).sums + move_sums(two, middle).sums)


def lines(runs: Sums) -> Curves:
    """The line of least squared distances of each run."""
    n, x, y, xx, xy, yy = runs.sums[:, :6].T
    n = np.maximum(n, 1e-12)
    mx, my = x / n, y / n
    sxx, sxy, syy = xx - n * mx * mx, xy - n * mx * my, yy - n * my * my
    half, rest = (sxx + syy) / 2, np.hypot((sxx - syy) / 2, sxy)
    angle = np.arctan2(2 * sxy, sxx - syy) / 2
    b, c = -np.sin(angle), np.cos(angle)
    form = np.stack([np.zeros_like(b), b, c, -(b * mx + c * my)], axis=1)
    return Curves(runs.origin, form, np.maximum(half - rest, 0.0))


def circles(runs: Sums) -> Curves:
    """The circle or line of each run that Taubin's fit finds: nearly unbiased, also for short arcs."""
    n = np.maximum(runs.sums[:, 0], 1e-12)
    middle = (runs.sums[:, 1] + 1j * runs.sums[:, 2]) / n
    centred = move_sums(runs, runs.origin + middle)
    _, _, _, xx, xy, yy, xz, yz, z, zz = centred.sums.T
    size = np.sqrt(np.maximum(4 * z / n, 1e-12))
    value, vector = _smallest((zz - z * z / n) / size**2, xx, yy, xz / size, yz / size, xy)
    a, b, c = vector[0] / size, vector[1], vector[2]
    d = -a * z / n
    norm = np.sqrt(np.maximum(b * b + c * c - 4 * a * d, 1e-30))
    form = np.stack([a, b, c, d], axis=1) / norm[:, None]
    return Curves(centred.origin, form, np.maximum(value, 0.0))


def _smallest(
    p: FloatArray, q: FloatArray, r: FloatArray, pq: FloatArray, pr: FloatArray, qr: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The smallest eigenvalue (P,), and its unit vector (3, P), of symmetric matrices with the diagonal p, q, r.

    Newton's method on the characteristic polynomial from 0 comes from below and cannot pass the smallest root of a
    matrix without negative ones; ten times as fast as LAPACK one by one.
    """
    c2, c1 = p + q + r, q * r - qr * qr + p * r - pr * pr + p * q - pq * pq
    c0 = p * (q * r - qr * qr) - pq * (pq * r - qr * pr) + pr * (pq * qr - q * pr)
    value = np.zeros_like(p)
    for _ in range(_NEWTON):
        slope = (3 * value - 2 * c2) * value + c1
        value = value - (((value - c2) * value + c1) * value - c0) / np.where(
            np.abs(slope) > NONZERO, slope, 1.0
        )
    p, q, r = p - value, q - value, r - value
    # The vector is square to all rows: the cross product of those two that are least parallel.
    crosses = np.array(
        [
            [pq * qr - pr * q, pr * pq - p * qr, p * q - pq * pq],
            [pq * r - pr * qr, pr * pr - p * r, p * qr - pq * pr],
            [q * r - qr * qr, qr * pr - pq * r, pq * qr - q * pr],
        ]
    )
    norm = (crosses**2).sum(axis=1)
    chosen = np.argmax(norm, axis=0)
    every = np.arange(len(value))
    return value, crosses[chosen, :, every].T / np.sqrt(np.maximum(norm[chosen, every], NONZERO))


def numbers_of(curves: Curves) -> IntArray:
    """(P,) count of the numbers of each curve and one end of it."""
    return np.where(curves.form[:, 0] == 0, _LINE_NUMBERS, _ARC_NUMBERS)


def best(runs: Sums, sigma: FloatArray, price: float) -> tuple[Curves, FloatArray]:
    """Line or circle for each run, whichever is told cheaper, and its price (P,): squared distances in units of the
    noise ``sigma`` (P,) px, and ``price`` for each number of the curve and for one end.
    """
    straight, round_ = lines(runs), circles(runs)
    cost0 = straight.sse / sigma**2 + _LINE_NUMBERS * price
    cost1 = round_.sse / sigma**2 + _ARC_NUMBERS * price
    extent = np.sqrt(
        np.maximum(runs.sums[:, 3] + runs.sums[:, 5], 0) * 12 / np.maximum(runs.sums[:, 0], 1)
    )
    flat = (np.abs(round_.curvature) * extent**2 / 8 < _FLAT_PX) | (
        runs.sums[:, 0] < _FEWEST_FOR_ARC
    )
    line = (cost0 <= cost1) | flat
    return Curves(
        np.where(line, straight.origin, round_.origin),
        np.where(line[:, None], straight.form, round_.form),
        np.where(line, straight.sse, round_.sse),
    ), np.where(line, cost0, cost1)
