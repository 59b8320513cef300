"""Noise of outlines and its correlation along them, measured on the outlines themselves.

Neighbouring points share noise: a picture that was smoothed or rectified, grain, and motion of the
camera see to that. Differences of neighbours show too little of it, and lines break up into pieces
that follow it. So outlines are divided for one level of noise after another. The residuals of each
division are coded as noise that is correlated from point to point (autoregressive, first order).
The level of an outline is that with the shortest description of runs and residuals (minimum
description length). True features make residuals that jump, and are cheaper as runs.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from camgen.geometry.ragged import list_owners, number_rows
from camgen.geometry.rings import ComplexArray, Rings
from camgen.model.part import IntArray
from camgen.model.pose import FloatArray
from camgen.vision.lines_arcs.fit import Curves, count_numbers
from camgen.vision.lines_arcs.joints import orient
from camgen.vision.lines_arcs.runs import PRICE, Runs, fit_runs, make_blocks, merge

#: Number of levels of noise, each twice the one before.
_LEVELS = 8
#: Levels above that of the largest outline which no other outline has: the picture has one noise,
#: and short outlines show it badly.
_FURTHER = 2
#: Largest noise of an edge, rms, as a share of its blur. With more noise no edge is found.
_MOST_NOISE = 0.5
#: Number of neighbours that may share noise.
_LAGS = 8
#: Number of points at the end of a run that do not count: they may be rounded. Fewest points of a
#: run that counts: shorter curves follow the noise. Fewest points of an outline that count.
_ENDS, _LONG, _FEWEST = 4, 24, 24
#: Least variance of a description, px2, for outlines without any noise.
_LEAST_VARIANCE = 1e-12


def divide(
    loops: Rings, points: ComplexArray, sigma: FloatArray, blur: FloatArray
) -> tuple[Runs, FloatArray]:
    """The runs of closed loops that have the shortest description, and their noise (L,), px.

    points: (N,) px.
    sigma: (L,) noise that neighbours do not share, px.
    blur: (L,) px.
    """
    weight, runs = np.ones(len(points)), make_blocks(loops)
    divisions: list[Runs] = []
    lengths: list[FloatArray] = []
    for level in range(_LEVELS):
        noise = sigma * 2.0**level
        runs = merge(runs, loops, points, weight, noise)
        curves = fit_runs(runs, loops, points, weight, noise)[1]
        divisions.append(runs)
        lengths.append(_describe(runs, loops, points, curves, blur))
    length = np.array(lengths)
    length[int(np.argmin(length[:, np.argmax(loops.count)])) + _FURTHER :] = np.inf
    levels = np.argmin(length, axis=0)
    return _choose(divisions, levels), sigma * 2.0**levels


def _choose(divisions: Sequence[Runs], levels: IntArray) -> Runs:
    """The runs of each loop from the division of its level (L,)."""
    parts = []
    for level, runs in enumerate(divisions):
        rows = levels[runs.loop] == level
        parts.append((runs.first[rows], runs.count[rows], runs.loop[rows]))
    first, count, loop = np.concatenate(parts, axis=1)
    order = np.argsort(loop, kind="stable")
    return Runs(first[order], count[order], loop[order])


def _describe(
    runs: Runs, loops: Rings, points: ComplexArray, curves: Curves, blur: FloatArray
) -> FloatArray:
    """(L,) length of a description, in squares of the noise; inf where no noise is so large."""
    residuals = measure_residuals(runs, loops, points, curves)
    weight = np.ones(len(points))
    variance = _covariance(loops, residuals, weight, 0)
    shared = _covariance(loops, residuals, weight, 1)
    innovation = variance - shared**2 / np.maximum(variance, _LEAST_VARIANCE)
    coded = loops.count * np.log(np.maximum(innovation, 0) + _LEAST_VARIANCE)
    numbers = np.bincount(runs.loop, count_numbers(curves), len(loops.count))
    return np.where(variance > (_MOST_NOISE * blur) ** 2, np.inf, coded + PRICE * numbers)


def measure(
    runs: Runs, loops: Rings, residuals: FloatArray, weight: FloatArray, blur: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Noise of single points and noise of means, both (L,) px; nan if too few points show it.

    The mean of n points has the noise of means / sqrt(n), where n is more than a few.

    residuals: (N,) px.
    weight: (N,) 1 for points that count, 0 for others.
    blur: (L,) px.
    """
    rows, _ = runs.rows(loops)
    place, count = number_rows(runs.count), runs.count[list_owners(runs.count)]
    inner = weight.copy()
    inner[rows] *= (np.minimum(place, count - 1 - place) >= _ENDS) & (count >= _LONG)
    enough = np.bincount(loops.loop, inner, len(loops.count)) >= _FEWEST
    variance = _covariance(loops, residuals, inner, 0)
    whole = variance.copy()
    for lag in range(1, _LAGS):
        whole += 2 * (1 - lag / _LAGS) * _covariance(loops, residuals, inner, lag)
    single = np.sqrt(np.maximum(variance, _LEAST_VARIANCE))
    share = np.where(enough, np.minimum(1.0, _MOST_NOISE * blur / single), np.nan)
    return share * single, share * np.sqrt(np.maximum(whole, variance))


def measure_residuals(runs: Runs, loops: Rings, points: ComplexArray, curves: Curves) -> FloatArray:
    """(N,) signed distances of the points from the curves of their runs, px."""
    rows, _ = runs.rows(loops)
    oriented = orient(curves, runs, loops, points).take(list_owners(runs.count))
    residuals = np.empty(len(points))
    residuals[rows] = oriented.distances(points[rows])
    return residuals


def _covariance(loops: Rings, values: FloatArray, weight: FloatArray, lag: int) -> FloatArray:
    """(L,) covariance of the values with those ``lag`` places further."""
    further = loops.shifted(lag)
    both = weight * weight[further]
    total = np.bincount(loops.loop, both * values * values[further], len(loops.count))
    return np.asarray(total / np.maximum(np.bincount(loops.loop, both, len(loops.count)), 1))
