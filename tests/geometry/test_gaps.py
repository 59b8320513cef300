"""Distances between lines and arcs agree with those between many of their points."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from camgen.geometry.intersect import Obstacles, measure_distances, measure_gaps, measure_nearest
from camgen.geometry.segments import Segments, make_segments, points_at
from camgen.model.pose import FloatArray

NUMBERS = st.floats(-10, 10).map(lambda value: round(value, 2))
BULGES = st.sampled_from([0.0, 0.1, -0.4, 0.7, 1.0, -1.0])


def make_segment(start: tuple[float, float], end: tuple[float, float], bulge: float) -> Segments:
    return make_segments(
        np.array([start]), np.array([end]), np.array([bulge]), np.zeros(1, dtype=np.int64)
    )


def sample(segment: Segments, count: int = 1500) -> FloatArray:
    return points_at(segment.take(np.zeros(count, dtype=np.int64)), np.linspace(0, 1, count))


@given(
    st.tuples(NUMBERS, NUMBERS),
    st.tuples(NUMBERS, NUMBERS),
    BULGES,
    st.tuples(NUMBERS, NUMBERS),
    BULGES,
)
def test_the_gap_is_the_distance_of_the_nearest_points(
    start: tuple[float, float],
    end: tuple[float, float],
    bulge: float,
    other: tuple[float, float],
    other_bulge: float,
) -> None:
    if np.hypot(start[0] - end[0], start[1] - end[1]) < 0.1 or np.hypot(*other) < 0.1:
        return
    first, second = make_segment(start, end, bulge), make_segment(other, (0.0, 0.0), other_bulge)
    a, b = sample(first), sample(second)
    nearest = float(np.hypot(*(a[:, None] - b[None]).reshape(-1, 2).T).min())
    gap = float(measure_gaps(first, second, 100.0)[0])
    # The points are at most 40 mm / 1500 from each other.
    assert gap <= nearest + 1e-9
    assert gap == pytest.approx(nearest, abs=0.03)


def test_the_gap_of_concentric_arcs_is_the_difference_of_their_radii() -> None:
    inner, outer = (
        make_segment((3, 0), (0, 3), np.tan(np.pi / 8)),
        make_segment((5, 0), (-5, 0), 1.0),
    )
    assert measure_gaps(inner, outer, 10.0) == pytest.approx([2.0])
    opposite = make_segment((-5, 0), (0, -5), np.tan(np.pi / 8))
    assert measure_gaps(inner, opposite, 10.0) == pytest.approx([np.hypot(5, 3)])


def test_the_nearest_of_several_segments_counts_within_reach() -> None:
    # A line along y = 0, and the upper half circle around (20, 0) with a radius of 5 mm.
    start, end = np.array([[0.0, 0.0], [25.0, 0.0]]), np.array([[10.0, 0.0], [15.0, 0.0]])
    segments = make_segments(start, end, np.array([0.0, 1.0]), np.array([0, 1]))
    points = np.array([[4.0, 3.0], [20.0, 8.0], [13.0, 0.0], [4.0, 30.0]])
    assert measure_nearest(points, segments, 10.0) == pytest.approx([3.0, 3.0, 2.0, np.inf])


@pytest.mark.parametrize("step", [0.02, 0.6, 7.0])
def test_points_along_a_path_have_the_distances_that_each_has_alone(step: float) -> None:
    """Neighbouring points are searched together, in spite of different groups."""
    random = np.random.default_rng(4)
    start = random.uniform(0, 60, (50, 2))
    bulge = random.uniform(-1, 1, 50) * (random.random(50) < 0.5)
    owner = np.zeros(50, dtype=np.int64)
    segments = make_segments(start, start + random.normal(0, 6, (50, 2)), bulge, owner)
    points = np.cumsum(random.normal(0, step, (700, 2)), axis=0) % 60
    groups, point_groups = random.integers(0, 2, 50), random.integers(0, 2, 700)
    gaps = np.array(
        [measure_distances(np.full((50, 2), point), segments, np.arange(50)) for point in points]
    )
    gaps[point_groups[:, None] != groups] = np.inf
    gaps[gaps > 2.5] = np.inf
    obstacles = Obstacles(segments, groups)
    assert obstacles.nearest(points, point_groups, 2.5).tolist() == gaps.min(axis=1).tolist()
    rows = np.where(np.isfinite(gaps.min(axis=1)), gaps.argmin(axis=1), -1)
    assert obstacles.nearest_rows(points, point_groups, 2.5).tolist() == rows.tolist()
    assert (rows >= 0).any()
    assert (rows < 0).any()
