"""Computes lens distortion as OpenCV defines it, exactly and in both directions.

Points are on the plane at distance 1 in front of the camera. With s = x^2 + y^2, the ideal point
(x, y) is seen at

    x' = x f + 2 p1 x y + p2 (s + 2 x^2) + s1 s + s2 s^2
    y' = y f + p1 (s + 2 y^2) + 2 p2 x y + s3 s + s4 s^2
    f = (1 + k1 s + k2 s^2 + k3 s^3) / (1 + k4 s + k5 s^2 + k6 s^3)

and then through the tilt of the sensor (OpenCV documentation, calib3d, "Detailed Description").

Such a polynomial is valid where it was fitted. Further out the radius x f may stop growing and
decrease, so that two ideal points are seen at one place. This radius is the fold. Beyond it a point
has no solution and is nan, in both directions.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import NDArray

from camgen.model.pose import FloatArray
from camgen.model.tolerance import NONZERO

#: Numbers of coefficients that a lens may have, in OpenCV's order k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3
#: s4 tau_x tau_y.
COUNTS = (0, 4, 5, 8, 12, 14)

#: Iterations of Newton's method, at most.
_MAX_ITERATIONS = 60
#: Largest distance of the image of a solution from its target, as a fraction of the larger of 1 and
#: the radius of the target.
_MAX_ERROR = 1e-13
#: Entries of the table of the radial part.
_RADIUS_SAMPLES = 1025
#: Ideal points are searched for up to this many times the radius of the farthest point seen. Beyond
#: it the lens would magnify by as much.
_MAX_RADIUS_RATIO = 1e3
#: A smaller coefficient has no effect.
_MIN_COEFFICIENT = 1e-60


def distort_ideal(lens: FloatArray, ideal: FloatArray) -> FloatArray:
    """Map ideal points (N, 2) to the points (N, 2) at which a lens shows them.

    lens: (n,) coefficients. nan beyond the fold.
    """
    c = _pad(lens)
    level, slopes = _evaluate_model(c, ideal)
    is_beyond = ~_is_before_fold(slopes, ideal, find_fold(lens))
    tilt = _make_tilt(c)
    lifted = level @ tilt[:, :2].T + tilt[:, 2]
    seen: FloatArray = lifted[:, :2] / lifted[:, 2:]
    seen[is_beyond] = np.nan
    return seen


def straighten(lens: FloatArray, seen: FloatArray) -> FloatArray:
    """Map points (N, 2) as seen through a lens to ideal points (N, 2), as `distort_ideal` reversed.

    Newton's method, which starts from the solution of the radial part alone, found in a table.

    lens: (n,) coefficients. nan for a point without a solution.
    """
    c, max_radius = _pad(lens), find_fold(lens)
    untilt = np.linalg.inv(_make_tilt(c))
    lifted = seen @ untilt[:, :2].T + untilt[:, 2]
    target = lifted[:, :2] / lifted[:, 2:]
    ideal = _solve_radial(c, target, max_radius)
    for _ in range(_MAX_ITERATIONS):
        image, slopes = _evaluate_model(c, ideal)
        step = _solve_linear(slopes, target - image)
        step[~np.isfinite(step).all(axis=1)] = 0
        ideal = _limit_radius(ideal + step, max_radius)
        if not np.any(np.abs(step) > 1e-16 * (1 + np.abs(ideal))):
            break
    image, slopes = _evaluate_model(c, ideal)
    with np.errstate(invalid="ignore", over="ignore"):
        error = np.linalg.norm(image - target, axis=1)
        is_solved = error <= _MAX_ERROR * np.maximum(1, np.linalg.norm(target, axis=1))
    ideal[~(is_solved & _is_before_fold(slopes, ideal, max_radius))] = np.nan
    return ideal


def find_fold(lens: FloatArray) -> float:
    """The radius at which the radial part of a lens stops growing, or jumps; inf if it never does.

    x f(s) = x n / d grows while n d + 2 s (n' d - n d') > 0 and d > 0.
    """
    return _find_fold(tuple(_pad(lens).tolist()))


@lru_cache(maxsize=8)
def _find_fold(c: tuple[float, ...]) -> float:
    """`find_fold` of all 14 coefficients. Each map of points asks for it again."""
    n, d = np.array([1, c[0], c[1], c[4]]), np.array([1, c[5], c[6], c[7]])
    n_slope, d_slope = polynomial.polyder(n), polynomial.polyder(d)
    bend = polynomial.polysub(polynomial.polymul(n_slope, d), polynomial.polymul(n, d_slope))
    growth = polynomial.polyadd(polynomial.polymul(n, d), polynomial.polymul([0, 2], bend))
    return float(np.sqrt(min(_find_sign_change(growth), _find_sign_change(d))))


def _find_sign_change(p: FloatArray) -> float:
    """The smallest s > 0 above which a polynomial that is 1 at s = 0 is negative; inf without one.

    The roots of the reversed polynomial are 1 / s. Its leading coefficient is that 1. The leading
    coefficients of the polynomial itself may be so small that its roots lose all digits.
    """
    inverse = polynomial.polyroots(np.where(np.abs(p) > _MIN_COEFFICIENT, p, 0)[::-1])
    is_real = np.abs(inverse.imag) <= 1e-9 * np.abs(inverse)
    roots = np.sort(1 / inverse.real[is_real & (inverse.real > _MAX_RADIUS_RATIO**-2)])
    changes = roots[polynomial.polyval(roots * (1 + 1e-4), p) < 0]
    return float(changes[0]) if len(changes) else np.inf


def _pad(lens: FloatArray) -> FloatArray:
    """All 14 coefficients (14,), 0 for those that the lens does not have."""
    return np.concatenate([lens, np.zeros(COUNTS[-1] - len(lens))])


def _evaluate_model(c: FloatArray, ideal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points x', y' before the tilt (N, 2), and their derivatives by x and y (N, 2, 2)."""
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = c[:12].tolist()
    x, y = ideal.T
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        s = x * x + y * y
        divisor = 1 + s * (k4 + s * (k5 + s * k6))
        f = (1 + s * (k1 + s * (k2 + s * k3))) / divisor
        numerator_slope = k1 + s * (2 * k2 + s * 3 * k3)
        divisor_slope = k4 + s * (2 * k5 + s * 3 * k6)
        f_slope = 2 * (numerator_slope - f * divisor_slope) / divisor  # 2 df/ds
        u = x * f + 2 * p1 * x * y + p2 * (s + 2 * x * x) + s * (s1 + s * s2)
        v = y * f + p1 * (s + 2 * y * y) + 2 * p2 * x * y + s * (s3 + s * s4)
        prism_u, prism_v = 2 * (s1 + 2 * s * s2), 2 * (s3 + 2 * s * s4)
        mixed = x * y * f_slope + 2 * p1 * x + 2 * p2 * y
        u_by_x = f + x * x * f_slope + 2 * p1 * y + 6 * p2 * x + x * prism_u
        u_by_y = mixed + y * prism_u
        v_by_x = mixed + x * prism_v
        v_by_y = f + y * y * f_slope + 6 * p1 * y + 2 * p2 * x + y * prism_v
        slopes = np.stack([u_by_x, u_by_y, v_by_x, v_by_y], axis=1)
    return np.column_stack([u, v]), slopes.reshape(-1, 2, 2)


def _is_before_fold(slopes: FloatArray, ideal: FloatArray, max_radius: float) -> NDArray[np.bool_]:
    """Whether each ideal point (N, 2) is inside of the fold.

    Its radius is below that of the fold, and the Jacobian is positive: tangential terms may fold
    the model earlier.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        area = slopes[:, 0, 0] * slopes[:, 1, 1] - slopes[:, 0, 1] * slopes[:, 1, 0]
        return np.asarray((np.hypot(*ideal.T) < max_radius) & (area > 0), dtype=np.bool_)


def _solve_linear(slopes: FloatArray, right: FloatArray) -> FloatArray:
    """Solve 2 x 2 systems (N, 2, 2) by Cramer's rule; a singular one is not finite."""
    (a, b), (c, d) = slopes[:, 0].T, slopes[:, 1].T
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        area = a * d - b * c
        u, v = right.T
        solution: FloatArray = np.stack([d * u - b * v, a * v - c * u], axis=1) / area[:, None]
    return solution


def _limit_radius(ideal: FloatArray, max_radius: float) -> FloatArray:
    """Move points (N, 2) beyond the fold to just inside of it."""
    if not np.isfinite(max_radius):
        return ideal
    radius = np.hypot(*ideal.T)
    factor = np.minimum(1, max_radius * (1 - 1e-9) / np.maximum(radius, NONZERO))
    return np.asarray(ideal * factor[:, None])


def _solve_radial(c: FloatArray, target: FloatArray, max_radius: float) -> FloatArray:
    """Ideal points (N, 2) that the radial part alone shows at `target` (N, 2), from a table."""
    radius = np.hypot(*target.T)
    reach = float(np.nanmax(radius, initial=0.0, where=np.isfinite(radius)))

    def distort_radius(r: FloatArray) -> FloatArray:
        radial = np.where(np.isin(np.arange(len(c)), (0, 1, 4, 5, 6, 7)), c, 0)
        return np.asarray(_evaluate_model(radial, np.column_stack([r, np.zeros_like(r)]))[0][:, 0])

    top = min(reach, max_radius)
    limit = min(max_radius, _MAX_RADIUS_RATIO * reach)
    while top < limit and distort_radius(np.array([top]))[0] < reach:
        top = min(1.5 * top, max_radius)
    table = np.linspace(0, top, _RADIUS_SAMPLES)
    ideal_radius = np.interp(radius, np.maximum.accumulate(distort_radius(table)), table)
    with np.errstate(invalid="ignore"):
        start = target * np.where(radius > 0, ideal_radius / radius, 1)[:, None]
    return _limit_radius(np.asarray(start, dtype=np.float64), max_radius)


def _make_tilt(c: FloatArray) -> FloatArray:
    """The homography (3, 3) from the level plane to a sensor that is tilted by tau_x and tau_y."""
    cx, sx, cy, sy = np.cos(c[12]), np.sin(c[12]), np.cos(c[13]), np.sin(c[13])
    rotation = np.array([[cy, sy * sx, -sy * cx], [0, cx, sx], [sy, -cy * sx, cy * cx]])
    x, y, z = rotation[:, 2]
    return np.asarray(np.array([[z, 0, -x], [0, z, -y], [0, 0, 1]]) @ rotation)
