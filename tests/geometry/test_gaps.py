"""Distances of lines and arcs from each other, against distances of many points of both."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from camgen.geometry.intersect import Obstacles, measure_distances, measure_gaps, measure_nearest
from camgen.geometry.segments import Segments, make_segments, points_at
from camgen.model.pose import FloatArray

NUMBERS = st.floats(-10, 10).map(lambda value: round(value, 2))
BULGES = st.sampled_from([0.0, 0.1, -0.4, 0.7, 1.0, -1.0])


def one(start: tuple[float, float], end: tuple[float, float], bulge: float) -> Segments:
    return make_segments(
        np.array([start]), np.array([end]), np.array([bulge]), np.zeros(1, dtype=np.int64)
    )


def places(segment: Segments, count: int = 1500) -> FloatArray:
    return points_at(segment.take(np.zeros(count, dtype=np.int64)), np.linspace(0, 1, count))


@given(
    st.tuples(NUMBERS, NUMBERS),
    st.tuples(NUMBERS, NUMBERS),
    BULGES,
    st.tuples(NUMBERS, NUMBERS),
    BULGES,
)
def test_the_gap_is_that_of_the_nearest_points(
    start: tuple[float, float],
    end: tuple[float, float],
    bulge: float,
    other: tuple[float, float],
    turn: float,
) -> None:
    if np.hypot(start[0] - end[0], start[1] - end[1]) < 0.1 or np.hypot(*other) < 0.1:
        return
    first, second = one(start, end, bulge), one(other, (0.0, 0.0), turn)
    a, b = places(first), places(second)
    nearest = float(np.hypot(*(a[:, None] - b[None]).reshape(-1, 2).T).min())
    found = float(measure_gaps(first, second, 100.0)[0])
    # Steps of the points are at most a length of 40 mm in 1500.
    assert found <= nearest + 1e-9
    assert found == pytest.approx(nearest, abs=0.03)


def test_arcs_about_one_centre_are_apart_by_their_radii() -> None:
    inner, outer = one((3, 0), (0, 3), np.tan(np.pi / 8)), one((5, 0), (-5, 0), 1.0)
    assert measure_gaps(inner, outer, 10.0) == pytest.approx([2.0])
    away = one((-5, 0), (0, -5), np.tan(np.pi / 8))
    assert measure_gaps(inner, away, 10.0) == pytest.approx([np.hypot(5, 3)])


def test_the_nearest_of_several_segments_counts_within_reach() -> None:
    # A line along y = 0 and a half circle about (20, 0) with the radius 5, above it.
    start, end = np.array([[0.0, 0.0], [25.0, 0.0]]), np.array([[10.0, 0.0], [15.0, 0.0]])
    segments = make_segments(start, end, np.array([0.0, 1.0]), np.array([0, 1]))
    points = np.array([[4.0, 3.0], [20.0, 8.0], [13.0, 0.0], [4.0, 30.0]])
    assert measure_nearest(points, segments, 10.0) == pytest.approx([3.0, 3.0, 2.0, np.inf])


@pytest.mark.parametrize("step", [0.02, 0.6, 7.0])
def test_points_in_a_row_have_the_distances_that_each_has_by_itself(step: float) -> None:
    """Points near each other are looked up together, whatever their groups are."""
    random = np.random.default_rng(4)
    start = random.uniform(0, 60, (50, 2))
    bulge = random.uniform(-1, 1, 50) * (random.random(50) < 0.5)
    none = np.zeros(50, dtype=np.int64)
    segments = make_segments(start, start + random.normal(0, 6, (50, 2)), bulge, none)
    points = np.cumsum(random.normal(0, step, (700, 2)), axis=0) % 60
    groups, chosen = random.integers(0, 2, 50), random.integers(0, 2, 700)
    gaps_of = np.array(
        [measure_distances(np.full((50, 2), point), segments, np.arange(50)) for point in points]
    )
    gaps_of[chosen[:, None] != groups] = np.inf
    gaps_of[gaps_of > 2.5] = np.inf
    obstacles = Obstacles(segments, groups)
    assert obstacles.nearest(points, chosen, 2.5).tolist() == gaps_of.min(axis=1).tolist()
    rows = np.where(np.isfinite(gaps_of.min(axis=1)), gaps_of.argmin(axis=1), -1)
    assert obstacles.nearest_rows(points, chosen, 2.5).tolist() == rows.tolist()
    assert (rows >= 0).any()
    assert (rows < 0).any()
