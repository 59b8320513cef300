"""Outlines divided into runs for lines and arcs: the order of the steps."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.pose import FloatArray
from camgen.vision.outlines_loops import ComplexArray, Loops
from camgen.vision.primitives_fit import BoolArray, Curves
from camgen.vision.primitives_joints import Joints, cleared, joints, normals, oriented, small_corners
from camgen.vision.primitives_pieces import Runs, blocks, fitted, merged, relaxed, rougher, trimmed, within

_ROUNDS, _RELAXED, _CORNERS = 3, 2, 3
#: Fewer points than this are no feature.
_LEAST = 3
#: The shift by the blur is not believed beyond this, px: the arc is as small as the blur.
_MOST_SHIFT = 0.3


class Divided(Struct, frozen=True, eq=False):
    """points (N,) px, put right for the blur; the runs with their curves and the joints behind them; counts (N,): which
    points no corner has rounded.
    """

    points: ComplexArray
    runs: Runs
    curves: Curves
    joints: Joints
    counts: BoolArray


def divided(loops: Loops, halfway: ComplexArray, sigma: FloatArray, blur: FloatArray) -> Divided:
    """Lines and arcs of closed loops of points where the grey value is half-way; sigma, blur (L,) px."""
    weight, told = np.ones(len(halfway)), sigma
    runs = merged(blocks(loops), loops, halfway, weight, sigma)
    for _ in range(_ROUNDS):
        sigma = rougher(runs, loops, halfway, fitted(runs, loops, halfway, weight, sigma)[1], told)
        for _ in range(_RELAXED):
            _, curves, _ = fitted(runs, loops, halfway, weight, sigma)
            runs = relaxed(runs, loops, halfway, curves, sigma)
            _, curves, _ = fitted(runs, loops, halfway, weight, sigma)
            weight = trimmed(runs, loops, halfway, curves, sigma, blur)
        for _ in range(_CORNERS):
            runs, curves = _without_corners(runs, loops, halfway, weight, sigma, blur)
            found = joints(curves, runs, loops, halfway, sigma, blur)
            weight = cleared(found, curves, runs, loops, halfway) * trimmed(runs, loops, halfway, curves, sigma, blur)
        runs = merged(runs, loops, halfway, weight, sigma)
    curves = _curves(runs, loops, halfway, weight, sigma)
    points = _put_right(runs, loops, halfway, curves, blur)
    curves = _curves(runs, loops, points, weight, sigma)
    found = joints(curves, runs, loops, points, sigma, blur)
    return Divided(points, runs, curves, found, cleared(found, curves, runs, loops, points))


def _curves(runs: Runs, loops: Loops, points: ComplexArray, weight: FloatArray, sigma: FloatArray) -> Curves:
    return oriented(fitted(runs, loops, points, weight, sigma)[1], runs, loops, points)


def _without_corners(
    runs: Runs, loops: Loops, points: ComplexArray, weight: FloatArray, sigma: FloatArray, blur: FloatArray
) -> tuple[Runs, Curves]:
    """The runs without those that are the picture's rounding of a corner, or next to nothing."""
    curves = _curves(runs, loops, points, weight, sigma)
    small = small_corners(curves, runs, loops, points, blur) | ((runs.count < _LEAST) & runs.several())
    if not small.any():
        return runs, curves
    runs = _given_away(runs, loops, small, curves)
    return runs, _curves(runs, loops, points, weight, sigma)


def _given_away(runs: Runs, loops: Loops, small: BoolArray, curves: Curves) -> Runs:
    """``small`` runs given to their neighbours, half each: of neighbours the one that bends most."""
    after, before = runs.following(), runs.before()
    rank = np.empty(len(runs), dtype=np.int64)
    rank[np.argsort(np.abs(curves.curvature), kind="stable")] = np.arange(len(runs))
    rank = np.where(small, rank, -1)
    gone = np.flatnonzero(small & (rank > rank[before]) & (rank > rank[after]))
    first, count = runs.first.copy(), runs.count.copy()
    half = runs.count[gone] // 2
    rest = runs.count[gone] - half
    # A run between two that go gets a share of both.
    np.add.at(count, before[gone], half)
    np.add.at(count, after[gone], rest)
    np.add.at(first, after[gone], -rest)
    keep = np.ones(len(runs), dtype=np.bool_)
    keep[gone] = False
    return within(Runs(first[keep], count[keep], runs.loop[keep]), loops)


def _put_right(runs: Runs, loops: Loops, points: ComplexArray, curves: Curves, blur: FloatArray) -> ComplexArray:
    """The points of arcs moved away from their centre by what the blur has moved them towards it, s^2 / (2 r)."""
    rows, _ = runs.rows(loops)
    which = np.repeat(np.arange(len(runs)), runs.count)
    shift = (curves.curvature * blur[runs.loop] ** 2 / 2).clip(-_MOST_SHIFT, _MOST_SHIFT)
    moved = points.copy()
    moved[rows] += shift[which] * normals(curves.take(which), points[rows])
    return moved
