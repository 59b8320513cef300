"""Lens distortion as OpenCV defines it, on the plane at distance 1 before the camera, exact in both directions.

With s = x^2 + y^2, the ideal point (x, y) is seen at

    x' = x f + 2 p1 x y + p2 (s + 2 x^2) + s1 s + s2 s^2
    y' = y f + p1 (s + 2 y^2) + 2 p2 x y + s3 s + s4 s^2
    f = (1 + k1 s + k2 s^2 + k3 s^3) / (1 + k4 s + k5 s^2 + k6 s^3)

and then through the tilt of the sensor (OpenCV documentation, calib3d, "Detailed Description").

Such a polynomial holds where it was fitted. Further out the radius x f may stop rising and turn back, so that two ideal
points are seen at one place. What lies beyond has no answer and is nan, in both directions.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import NDArray

from camgen.model.pose import FloatArray
from camgen.model.tolerance import NONZERO

#: How many coefficients a lens may have, in OpenCV's order k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tau_x tau_y.
COUNTS = (0, 4, 5, 8, 12, 14)

_ROUNDS = 60
#: A solution whose image is further away than this (as a part of the larger of 1 and its radius) is none.
_SOLVED_SHARE = 1e-13
_RADIUS_SAMPLES = 1025
#: Ideal points further out than this (times the farthest seen one) are not looked for: the lens would magnify so much.
_FARTHEST_RATIO = 1e3
#: A coefficient below this bends nothing.
_NOTHING = 1e-60


def distort_ideal(lens: FloatArray, ideal: FloatArray) -> FloatArray:
    """Where a lens with these coefficients (n,) shows ideal points (N, 2); nan beyond its fold."""
    c = _pad(lens)
    seen, slopes = _model(c, ideal)
    out = ~_before_fold(slopes, ideal, fold(lens))
    tilt = _tilt(c)
    lifted = seen @ tilt[:, :2].T + tilt[:, 2]
    shown: FloatArray = lifted[:, :2] / lifted[:, 2:]
    shown[out] = np.nan
    return shown


def straight(lens: FloatArray, seen: FloatArray) -> FloatArray:
    """The ideal points (N, 2) that a lens shows at ``seen`` (N, 2): the inverse of ``distort_ideal``, nan where there
    is none.

    Newton's method from the solution of the radial part alone, which is found in a table.
    """
    c, farthest = _pad(lens), fold(lens)
    level = np.linalg.inv(_tilt(c))
    lifted = seen @ level[:, :2].T + level[:, 2]
    target = lifted[:, :2] / lifted[:, 2:]
    ideal = _radial_start(c, target, farthest)
    for _ in range(_ROUNDS):
        found, slopes = _model(c, ideal)
        step = _solve(slopes, target - found)
        step[~np.isfinite(step).all(axis=1)] = 0
        ideal = _hold_inside(ideal + step, farthest)
        if not np.any(np.abs(step) > 1e-16 * (1 + np.abs(ideal))):
            break
    found, slopes = _model(c, ideal)
    with np.errstate(invalid="ignore", over="ignore"):
        error = np.linalg.norm(found - target, axis=1)
        solved = error <= _SOLVED_SHARE * np.maximum(1, np.linalg.norm(target, axis=1))
    ideal[~(solved & _before_fold(slopes, ideal, farthest))] = np.nan
    return ideal


def fold(lens: FloatArray) -> float:
    """The radius at which the radial part stops rising, or jumps; inf if it never does.

    x f(s) = x n / d rises while n d + 2 s (n' d - n d') > 0 and d > 0.
    """
    c = _pad(lens)
    n, d = np.array([1, c[0], c[1], c[4]]), np.array([1, c[5], c[6], c[7]])
    bend = polynomial.polysub(
        polynomial.polymul(polynomial.polyder(n), d), polynomial.polymul(n, polynomial.polyder(d))
    )
    rise = polynomial.polyadd(polynomial.polymul(n, d), polynomial.polymul([0, 2], bend))
    return float(np.sqrt(min(_first_root(rise), _first_root(d))))


def _first_root(p: FloatArray) -> float:
    """The least s > 0 from where a polynomial that is 1 at s = 0 is negative; inf if there is none.

    The roots of the reversed polynomial are 1 / s. Its leading coefficient is that 1, while those of the polynomial
    itself may be so small that the roots which matter drown.
    """
    inverse = polynomial.polyroots(np.where(np.abs(p) > _NOTHING, p, 0)[::-1])
    real = inverse.real[
        (np.abs(inverse.imag) <= 1e-9 * np.abs(inverse)) & (inverse.real > _FARTHEST_RATIO**-2)
    ]
    roots = np.sort(1 / real)
    beyond = roots[polynomial.polyval(roots * (1 + 1e-4), p) < 0]
    return float(beyond[0]) if len(beyond) else np.inf


def _pad(lens: FloatArray) -> FloatArray:
    return np.concatenate([lens, np.zeros(COUNTS[-1] - len(lens))])


def _model(c: FloatArray, ideal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """x', y' before the tilt (N, 2), and their derivatives by x and y (N, 2, 2)."""
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = c[:12].tolist()
    x, y = ideal.T
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        s = x * x + y * y
        below = 1 + s * (k4 + s * (k5 + s * k6))
        f = (1 + s * (k1 + s * (k2 + s * k3))) / below
        twice = (
            2 * (k1 + s * (2 * k2 + s * 3 * k3) - f * (k4 + s * (2 * k5 + s * 3 * k6))) / below
        )  # 2 df/ds
        u = x * f + 2 * p1 * x * y + p2 * (s + 2 * x * x) + s * (s1 + s * s2)
        v = y * f + p1 * (s + 2 * y * y) + 2 * p2 * x * y + s * (s3 + s * s4)
        prism_u, prism_v = 2 * (s1 + 2 * s * s2), 2 * (s3 + 2 * s * s4)
        across = x * y * twice + 2 * p1 * x + 2 * p2 * y
        slopes = np.stack(
            [
                np.stack(
                    [
                        f + x * x * twice + 2 * p1 * y + 6 * p2 * x + x * prism_u,
                        across + y * prism_u,
                    ],
                    axis=1,
                ),
                np.stack(
                    [
                        across + x * prism_v,
                        f + y * y * twice + 6 * p1 * y + 2 * p2 * x + y * prism_v,
                    ],
                    axis=1,
                ),
            ],
            axis=1,
        )
    return np.column_stack([u, v]), slopes


def _before_fold(slopes: FloatArray, ideal: FloatArray, farthest: float) -> NDArray[np.bool_]:
    """Which points lie inside of the fold: the fold's radius, and where tangential terms fold earlier the Jacobian."""
    with np.errstate(invalid="ignore", over="ignore"):
        area = slopes[:, 0, 0] * slopes[:, 1, 1] - slopes[:, 0, 1] * slopes[:, 1, 0]
        return np.asarray((np.hypot(*ideal.T) < farthest) & (area > 0), dtype=np.bool_)


def _solve(slopes: FloatArray, right: FloatArray) -> FloatArray:
    """The 2 x 2 systems of Newton's method by Cramer's rule; not finite where one is singular."""
    (a, b), (c, d) = slopes[:, 0].T, slopes[:, 1].T
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        area = a * d - b * c
        u, v = right.T
        found: FloatArray = np.stack([d * u - b * v, a * v - c * u], axis=1) / area[:, None]
    return found


def _hold_inside(ideal: FloatArray, farthest: float) -> FloatArray:
    """Points beyond the fold drawn back to just inside of it."""
    if not np.isfinite(farthest):
        return ideal
    radius = np.hypot(*ideal.T)
    shrink = np.minimum(1, farthest * (1 - 1e-9) / np.maximum(radius, NONZERO))
    held: FloatArray = ideal * shrink[:, None]
    return held


def _radial_start(c: FloatArray, target: FloatArray, farthest: float) -> FloatArray:
    radius = np.hypot(*target.T)
    reach = float(np.nanmax(radius, initial=0.0, where=np.isfinite(radius)))

    def shown(r: FloatArray) -> FloatArray:
        alone = np.where(np.isin(np.arange(len(c)), (0, 1, 4, 5, 6, 7)), c, 0)
        along: FloatArray = _model(alone, np.column_stack([r, np.zeros_like(r)]))[0][:, 0]
        return along

    top = min(reach, farthest)
    while top < min(farthest, _FARTHEST_RATIO * reach) and shown(np.array([top]))[0] < reach:
        top = min(1.5 * top, farthest)
    table = np.linspace(0, top, _RADIUS_SAMPLES)
    found = np.interp(radius, np.maximum.accumulate(shown(table)), table)
    with np.errstate(invalid="ignore"):
        start = target * np.where(radius > 0, found / radius, 1)[:, None]
    return _hold_inside(np.asarray(start, dtype=np.float64), farthest)


def _tilt(c: FloatArray) -> FloatArray:
    """The homography (3, 3) of a sensor that is tilted by tau_x and tau_y, from the level plane to it."""
    cx, sx, cy, sy = np.cos(c[12]), np.sin(c[12]), np.cos(c[13]), np.sin(c[13])
    turned = np.array([[cy, sy * sx, -sy * cx], [0, cx, sx], [sy, -cy * sx, cy * cx]])
    onto = np.array([[turned[2, 2], 0, -turned[0, 2]], [0, turned[2, 2], -turned[1, 2]], [0, 0, 1]])
    tilt: FloatArray = onto @ turned
    return tilt
