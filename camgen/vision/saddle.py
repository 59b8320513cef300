"""Corners of a chessboard to a hundredth of a pixel: a saddle fitted to the grey values around each.

Two edges cross in a corner. Around it the picture is

    (1 + gx x + gy y) (a tanh(d1 / w) tanh(d2 / w) + b)

with d1, d2 the distances from two lines through the corner: nine numbers (corner, two directions, contrast a, mean b,
slope of the light gx and gy, blur w) are fitted by least squares to some hundred pixels (Levenberg-Marquardt, all
corners of a photo at once). tanh stands for the edge's profile; which one it really is does not matter, since the
picture around the corner is symmetric about it. Neither does a camera's tone curve.

Rendered boards of 9 x 6, 640 x 480 px, noise sigma 2 (bench/calibrate.py; rms of the distance, px):

    photo                        cornerSubPix   findChessboardCornersSB   ... with CALIB_CB_ACCURACY   this
    blur 0.7 px                  0.032          0.075                     0.048                        0.010
    board in a third of it       0.037          0.150                     0.103                        0.011
    blur 2 px, noise sigma 5     0.075          0.094                     0.062                        0.032
    light falls off by 70 %      0.044          0.145                     0.123                        0.012

cornerSubPix with the best of four windows for each kind of photo.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.pose import FloatArray, frozen
from camgen.vision.image import Pixels

#: Rounds of the fit, and twice over: the second time the window lies around what the first one found.
_ROUNDS, _PASSES = 30, 2
_SETTLED = 1e-4
#: Radius of the window, px: as small as can hold nine unknowns, and where more pixels gain nothing.
_LEAST, _MOST = 2.5, 12.0
_DAMPING = 1e-3
_U, _V, _FIRST, _SECOND, _CONTRAST, _MEAN, _SLOPE_U, _SLOPE_V, _BLUR = range(9)


class Saddles(Struct, frozen=True, eq=False):
    """corners (N, 2) px; contrast (N,): the grey value's a, its sign says which quadrants are dark; misfit (N,): rms of
    what the fit leaves, grey values. A corner that ran away, or lies at the photo's border, has contrast 0.
    """

    corners: FloatArray
    contrast: FloatArray
    misfit: FloatArray


class _Windows(Struct, frozen=True, eq=False):
    """Places (N, P) px from each start, grey values and weights there."""

    x: FloatArray
    y: FloatArray
    grey: FloatArray
    weight: FloatArray


def fitted_saddles(grey: Pixels, near: FloatArray, axes: FloatArray, radius: FloatArray) -> Saddles:
    """The corners next to ``near`` (N, 2) px, at most their radius (N,) px away.

    axes: (N, 2, 2), the columns are the directions of the two edges in the photo. radius: of the round window in which
    no other edge may be.
    """
    radius = radius.clip(_LEAST, _MOST)
    start = np.zeros((len(near), 9))
    # The normals of the two edges.
    start[:, _FIRST] = np.arctan2(axes[:, 0, 0], -axes[:, 1, 0])
    start[:, _SECOND] = np.arctan2(axes[:, 0, 1], -axes[:, 1, 1])
    start[:, _BLUR] = np.log(radius / 4)
    corners, found = near, start
    kept, misfit = np.ones(len(near), dtype=np.bool_), np.zeros(len(near))
    for _ in range(_PASSES):
        windows = _cut_out(grey, corners, radius)
        found = _with_contrast(windows, found)
        found, misfit = _fitted(windows, found)
        kept = kept & np.isfinite(found).all(axis=1) & (np.hypot(*(corners + found[:, :2] - near).T) < radius)
        found = np.where(kept[:, None], found, start)
        corners = np.where(kept[:, None], corners + found[:, :2], near)
        found[:, :2] = 0
    margin = np.minimum(corners, np.array(grey.shape[::-1]) - 1 - corners).min(axis=1)
    usable = kept & (margin >= _LEAST)
    contrast = np.where(usable, found[:, _CONTRAST], 0)
    return Saddles(frozen(corners), frozen(contrast), frozen(misfit))


def _cut_out(grey: Pixels, corners: FloatArray, radius: FloatArray) -> _Windows:
    reach = int(np.ceil(radius.max()))
    down, right = (o.ravel() for o in np.mgrid[-reach : reach + 1, -reach : reach + 1])
    whole = np.rint(corners).astype(np.int64)
    u, v = whole[:, :1] + right, whole[:, 1:] + down
    height, width = grey.shape
    inside = (u >= 0) & (v >= 0) & (u < width) & (v < height)
    x, y = u - corners[:, :1], v - corners[:, 1:]
    weight = inside * (radius[:, None] + 0.5 - np.hypot(x, y)).clip(0, 1)
    return _Windows(x, y, grey[v.clip(0, height - 1), u.clip(0, width - 1)].astype(np.float64), weight)


def _with_contrast(windows: _Windows, found: FloatArray) -> FloatArray:
    """Contrast and mean that fit the rest of ``found`` best: a line through grey values over tanh tanh."""
    unit = found.copy()
    unit[:, _CONTRAST], unit[:, _MEAN], unit[:, _SLOPE_U : _SLOPE_V + 1] = 1, 0, 0
    shape = _model(windows, unit)[0]
    total = windows.weight.sum(axis=1)

    def mean(values: FloatArray) -> FloatArray:
        found: FloatArray = (windows.weight * values).sum(axis=1) / total
        return found

    s, g = mean(shape), mean(windows.grey)
    spread = mean((shape - s[:, None]) ** 2)
    unit[:, _CONTRAST] = mean((shape - s[:, None]) * windows.grey) / np.maximum(spread, 1e-12)
    unit[:, _MEAN] = g - unit[:, _CONTRAST] * s
    return unit


def _fitted(windows: _Windows, found: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Levenberg-Marquardt, for each corner its own damping; the numbers (N, 9) and the rms misfit (N,)."""
    damping = np.full(len(found), _DAMPING)
    values, slopes = _model(windows, found)
    error = windows.grey - values
    cost = (windows.weight * error**2).sum(axis=1)
    for _ in range(_ROUNDS):
        weighted = slopes * windows.weight[..., None]
        normal = np.swapaxes(weighted, 1, 2) @ slopes
        right = (np.swapaxes(weighted, 1, 2) @ error[..., None])[..., 0]
        size = np.diagonal(normal, axis1=1, axis2=2)
        normal = normal + (damping[:, None] * size + 1e-9)[..., None] * np.eye(9)
        tried = found + np.linalg.solve(normal, right[..., None])[..., 0]
        tried_values, tried_slopes = _model(windows, tried)
        tried_error = windows.grey - tried_values
        tried_cost = (windows.weight * tried_error**2).sum(axis=1)
        better = tried_cost <= cost
        step = np.abs(tried - found)[better][:, :2].max(initial=0.0)
        found, cost = _chosen(better, tried, found), _chosen(better, tried_cost, cost)
        error, slopes = _chosen(better, tried_error, error), _chosen(better, tried_slopes, slopes)
        damping = np.where(better, damping / 5, damping * 8)
        if step < _SETTLED and (better | (damping > 1e3)).all():
            break
    return found, np.sqrt(cost / windows.weight.sum(axis=1))


def _chosen(which: NDArray[np.bool_], yes: FloatArray, no: FloatArray) -> FloatArray:
    return np.where(which.reshape(-1, *[1] * (yes.ndim - 1)), yes, no)


def _model(windows: _Windows, numbers: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Grey values (N, P) and their derivatives by the nine numbers (N, P, 9)."""
    u, v, first, second, contrast, mean, slope_u, slope_v, blur = numbers.T[..., None]
    x, y = windows.x - u, windows.y - v
    c1, s1, c2, s2 = np.cos(first), np.sin(first), np.cos(second), np.sin(second)
    sharp = np.exp(-blur.clip(-3, 6))
    d1, d2 = (c1 * x + s1 * y) * sharp, (c2 * x + s2 * y) * sharp
    a, b = np.tanh(d1), np.tanh(d2)
    light = 1 + slope_u * windows.x + slope_v * windows.y
    board = contrast * a * b + mean
    by_d1, by_d2 = light * contrast * b * (1 - a * a), light * contrast * a * (1 - b * b)
    slopes = np.stack(
        [
            -sharp * (by_d1 * c1 + by_d2 * c2),
            -sharp * (by_d1 * s1 + by_d2 * s2),
            by_d1 * sharp * (c1 * y - s1 * x),
            by_d2 * sharp * (c2 * y - s2 * x),
            light * a * b,
            light,
            windows.x * board,
            windows.y * board,
            -(by_d1 * d1 + by_d2 * d2),
        ],
        axis=2,
    )
    return light * board, slopes
