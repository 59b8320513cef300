"""Curves become arcs and lines within the tolerance of points that other formulas give."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from camgen.geometry import curves

Array = NDArray[np.float64]


def sampled(points: Array, bulges: Array, per_segment: int = 24) -> Array:
    """Points on lines and arcs. The radius of an arc with the chord c is c (1 + b b) / (4 |b|)."""
    samples = [points[:1]]
    for p, q, b in zip(points[:-1], points[1:], bulges[:-1], strict=True):
        t = np.linspace(0, 1, per_segment + 1)[1:, None]
        if abs(b) < 1e-12:
            samples.append(p + (q - p) * t)
            continue
        left = np.array([-(q - p)[1], (q - p)[0]])
        center = (p + q) / 2 + left * (1 - b * b) / (4 * b)
        start = math.atan2(*(p - center)[::-1])
        angle = start + 4 * math.atan(b) * t
        samples.append(center + np.hypot(*(p - center)) * np.hstack([np.cos(angle), np.sin(angle)]))
    return np.concatenate(samples)


def farthest(points: Array, line: Array) -> float:
    """Largest distance of `points` from the polyline `line`, mm."""
    return float(shapely.distance(shapely.points(points), shapely.linestrings(line)).max())


def assert_within(outline: curves.Outline, exact: Array, chord: float) -> None:
    points, bulges = outline
    fitted = sampled(points, bulges)
    # The polylines themselves deviate from their curves by their own sagitta.
    slack = 1e-3 * chord + max(sagitta(exact), sagitta(fitted))
    assert farthest(exact, fitted) <= chord + slack
    assert farthest(fitted[:: max(1, len(fitted) // 600)], exact) <= chord + slack
    assert np.abs(bulges).max() <= 1
    assert bulges[-1] == 0


def sagitta(line: Array) -> float:
    """Largest distance of a dense polyline from its curve: half the height of a corner, mm."""
    middle = (line[:-2] + line[2:]) / 2
    return float(np.hypot(*(line[1:-1] - middle).T).max() / 2)


def de_boor(control: Array, knots: list[float], degree: int, weights: Array, t: float) -> Array:
    """A point of a spline by the recursion of de Boor, in homogeneous coordinates."""
    h = np.column_stack([control * weights[:, None], weights])
    spans = [i for i in range(degree, len(control)) if knots[i] < knots[i + 1]]
    k = next(i for i in spans if t <= knots[i + 1])
    d = [h[j + k - degree] for j in range(degree + 1)]
    for r in range(1, degree + 1):
        for j in range(degree, r - 1, -1):
            low, high = knots[j + k - degree], knots[j + 1 + k - r]
            a = (t - low) / (high - low)
            d[j] = (1 - a) * d[j - 1] + a * d[j]
    return np.asarray(d[degree][:2] / d[degree][2])


@pytest.mark.parametrize("chord", [0.1, 0.01, 0.001])
@pytest.mark.parametrize("ratio", [1.0, 0.8, 0.4, 0.05])
def test_an_ellipse_of_100_mm_is_followed_within_the_tolerance(ratio: float, chord: float) -> None:
    run = curves.make_ellipse(
        np.zeros(2), np.array([50.0, 0.0]), np.array([0.0, 50 * ratio]), 0.0, math.tau
    )
    outline = curves.fit([run], chord)[0]
    t = np.linspace(0, math.tau, 1501)
    assert_within(outline, np.column_stack([50 * np.cos(t), 50 * ratio * np.sin(t)]), chord)


def test_a_full_ellipse_takes_some_tens_of_arcs() -> None:
    run = curves.make_ellipse(
        np.zeros(2), np.array([50.0, 0.0]), np.array([0.0, 20.0]), 0.0, math.tau
    )
    assert len(curves.fit([run], 0.01)[0][0]) <= 64


@given(
    st.floats(-7, 7),
    st.floats(0.01, math.tau),
    st.floats(0.01, 200),
    st.floats(0.01, 200),
    st.floats(-3, 3),
    st.booleans(),
)
def test_any_elliptical_arc_is_followed_within_the_tolerance(
    start: float, sweep: float, a: float, b: float, skew: float, back: bool
) -> None:
    u, v = np.array([a, skew]), np.array([-skew, b])
    end = start - sweep if back else start + sweep
    center = np.array([1000.0, -300.0])
    outline = curves.fit([curves.make_ellipse(center, u, v, start, end)], 0.01)[0]
    t = np.linspace(start, end, 801)[:, None]
    assert_within(outline, center + np.cos(t) * u + np.sin(t) * v, 0.01)


KNOTS = {
    "clamped": ([0, 0, 0, 0, 1, 2, 3, 3, 3, 3], 3),
    "periodic": ([-3, -2, -1, 0, 1, 2, 3, 4, 5, 6], 3),
    "double knot": ([0, 0, 0, 1, 1, 2, 3, 3, 3], 2),
    "fifth degree": ([0] * 6 + [1] * 6, 5),
    "polyline": ([0, 0, 1, 2, 3, 4, 5, 5], 1),
}
CONTROL = np.array([[0, 0], [20, 40], [50, -30], [70, 30], [90, 0], [60, -60.0]])


@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("name", KNOTS)
def test_a_spline_is_followed_within_the_tolerance(name: str, weighted: bool) -> None:
    knots, degree = KNOTS[name]
    weights = np.array([1.0, 4.0, 0.3, 2.0, 1.0, 1.0]) if weighted else np.ones(6)
    run = curves.make_bspline(
        CONTROL, np.array(knots, dtype=float), degree, weights if weighted else None
    )
    t = np.linspace(knots[degree], knots[len(CONTROL)], 1201)
    float_knots = [float(knot) for knot in knots]
    exact = np.array([de_boor(CONTROL, float_knots, degree, weights, float(x)) for x in t])
    assert_within(curves.fit([run], 0.01)[0], exact, 0.01)


def test_a_straight_bezier_curve_is_one_line() -> None:
    run = curves.make_bezier(np.array([[[0, 0], [1, 2], [2, 4], [3, 6.0]]]))
    points, bulges = curves.fit([run], 0.01)[0]
    assert points.tolist() == [[0, 0], [3, 6]]
    assert bulges.tolist() == [0, 0]


@pytest.mark.parametrize(
    "control",
    [
        [[0, 0], [10, 10], [0, 10], [10, 0]],  # a cusp
        [[0, 0], [20, 10], [-10, 10], [10, 0]],  # a loop
        [[0, 0], [0, 0], [10, 10], [10, 0]],  # no tangent at the start
        [[0, 0], [10, 0], [-10, 0], [5, 0]],  # back and forth on a line
        [[0, 0], [0.004, 0.01], [0.008, 0.01], [0.01, 0]],  # smaller than the tolerance
    ],
)
def test_a_difficult_bezier_curve_is_followed_within_the_tolerance(
    control: list[list[float]],
) -> None:
    c = np.array(control, dtype=float)
    t = np.linspace(0, 1, 1201)[:, None]
    exact = (
        (1 - t) ** 3 * c[0] + 3 * t * (1 - t) ** 2 * c[1] + 3 * t * t * (1 - t) * c[2] + t**3 * c[3]
    )
    outline = curves.fit([curves.make_bezier(c[None])], 0.01)[0]
    assert_within(outline, exact, 0.01)
    assert len(outline[0]) < 60


def test_ends_are_exact_far_from_the_origin() -> None:
    c = np.array([[0, 0], [10, 30], [40, 30], [50, 0.0]]) + 1e9
    points, _ = curves.fit([curves.make_bezier(c[None])], 0.01)[0]
    assert points[0].tolist() == c[0].tolist()
    assert np.abs(points[-1] - c[-1]).max() <= 2 * np.spacing(1e9)


def test_curves_of_different_degrees_are_fitted_together_as_alone() -> None:
    quad = curves.make_bezier(np.array([[[0, 0], [5, 10], [10, 0.0]]]))
    cubic = curves.make_bezier(np.array([[[0, 5], [5, 15], [10, 15], [15, 5.0]]]))
    together = curves.fit([cubic, quad, cubic], 0.01)
    alone = [curves.fit([curve], 0.01)[0] for curve in (cubic, quad, cubic)]
    for (p, b), (q, c) in zip(together, alone, strict=True):
        assert np.array_equal(p, q)
        assert np.array_equal(b, c)


@pytest.mark.parametrize(
    ("count", "knots", "degree", "weights"),
    [
        (4, [0, 0, 1, 1], 3, None),
        (4, [0] * 8, 3, None),
        (4, [0, 0, 0, 0, 1, 1, 1, 1], 3, [1, 0, 1, 1]),
        (4, [0, 0, 0, 0, 1, 1, 1, 1], 3, [1, 1, 1]),
        (3, [0] * 8, 4, None),
    ],
)
def test_an_invalid_spline_is_refused(
    count: int, knots: list[float], degree: int, weights: list[float] | None
) -> None:
    with pytest.raises(ValueError, match=r"."):
        curves.make_bspline(
            np.zeros((count, 2)),
            np.array(knots, dtype=float),
            degree,
            None if weights is None else np.array(weights),
        )


def test_numbers_out_of_range_give_infinities() -> None:
    run = curves.make_bezier(np.array([[[0, 0], [1e308, 0], [-1e308, 1e308], [1, 1.0]]]))
    run[0, 1, 2] = 1e-308
    with np.errstate(all="ignore"):
        points, _ = curves.fit([run], 0.01)[0]
    assert not np.isfinite(points).all()
