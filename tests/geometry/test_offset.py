"""Exact offset curves agree with the formulas of Steiner, and with GEOS on polylines."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import example, given
from hypothesis import strategies as st

from camgen.geometry.intersect import Obstacles
from camgen.geometry.offset import Offset, make_offset
from camgen.geometry.segments import find_following, flatten, make_contour_segments, points_at
from camgen.model.part import Contour
from tests.support.drawn import circle, clockwise, contour, rectangle, rounded

MITRE = 0.001


def run(contours: list[Contour], distance: float) -> Offset:
    source = make_contour_segments(contours)
    following = find_following(source, np.array([shape.closed for shape in contours]))
    group = np.zeros(len(source), dtype=np.int64)
    return make_offset(source, following, group, distance, MITRE)


def area(curve: Offset) -> float:
    """Signed area of the curves, mm2: the polygons of their ends, and the segments of the arcs."""
    a, b = curve.segments.start, curve.segments.end
    polygon = float((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()) / 2
    is_arc = curve.segments.is_arc
    sweep, radius = curve.segments.sweep[is_arc], curve.segments.radius[is_arc]
    return polygon + float((radius**2 * (sweep - np.sin(sweep))).sum()) / 2


def measure_deviation(contours: list[Contour], curve: Offset, distance: float) -> float:
    """Largest difference between `distance` and that of points on the curve, mm."""
    source = make_contour_segments(contours)
    obstacles = Obstacles(source, np.zeros(len(source), dtype=np.int64))
    count = len(curve.segments)
    points = np.concatenate(
        [points_at(curve.segments, np.full(count, fraction)) for fraction in (0, 0.3, 0.5, 0.9)]
    )
    gap = obstacles.nearest(points, np.zeros(len(points), dtype=np.int64), 2 * distance)
    return float(np.abs(gap - distance).max())


@pytest.mark.parametrize(
    ("shape", "perimeter", "surface"),
    [
        (rectangle(0, 0, 100, 50), 300.0, 5000.0),
        (circle(7, -3, 10), 20 * math.pi, 100 * math.pi),
        (rounded(60, 40, 5), 200 - 40 + 10 * math.pi, 2400 - 100 + 25 * math.pi),
    ],
    ids=["rectangle", "circle", "rounded"],
)
def test_an_offset_of_a_convex_shape_has_the_length_and_area_of_steiner(
    shape: Contour, perimeter: float, surface: float
) -> None:
    curve = run([shape], 3.0)
    assert curve.segments.length.sum() == pytest.approx(perimeter + 6 * math.pi, abs=1e-9)
    assert area(curve) == pytest.approx(surface + 3 * perimeter + 9 * math.pi, abs=1e-9)
    assert curve.closed.all()


def test_lines_stay_lines_and_arcs_stay_arcs() -> None:
    curve = run([rounded(60, 40, 5)], 3.0)
    assert sorted(curve.segments.radius.round(9).tolist()) == [8.0] * 4 + [math.inf] * 4
    hole = run([clockwise(rounded(60, 40, 5))], 3.0)
    assert sorted(hole.segments.radius.round(9).tolist()) == [2.0] * 4 + [math.inf] * 4


def test_a_hole_with_corners_of_less_than_the_tool_radius_gets_sharp_corners() -> None:
    curve = run([clockwise(rounded(60, 40, 2))], 3.0)
    assert curve.segments.length.sum() == pytest.approx(2 * (54 + 34), abs=1e-9)
    assert not curve.segments.is_arc.any()


@pytest.mark.parametrize("radius", [3.0, 2.0])
def test_a_hole_that_the_tool_does_not_fit_has_no_curve(radius: float) -> None:
    assert len(run([clockwise(circle(0, 0, radius))], 3.0).segments) == 0


def test_a_slot_exactly_as_wide_as_the_tool_is_too_narrow_and_a_wider_one_is_not() -> None:
    assert len(run([clockwise(rectangle(0, 0, 30, 6))], 3.0).segments) == 0
    wider = run([clockwise(rectangle(0, 0, 30, 6.5))], 3.0)
    assert wider.segments.length.sum() == pytest.approx(2 * (24 + 0.5), abs=1e-9)


def test_the_round_end_of_a_slot_as_wide_as_the_tool_may_have_a_tiny_corner() -> None:
    """At a corner the segments beside it are extended, and the arc is a point here."""
    slot = contour([(0, 0), (20, 1e-6), (20, 4 + 1e-6), (0, 4)], [0, 1, 0, 1])
    assert len(run([clockwise(slot)], 2.0).segments) == 0


def test_a_keyhole_keeps_its_round_end_if_the_slot_is_as_wide_as_the_tool() -> None:
    # To the right of a circle of 20 mm is a slot of exactly 6 mm. The tool follows the circle, and
    # rolls around the two corners of the slot until it touches both.
    x = math.sqrt(100 - 9)
    bulge = math.tan((2 * math.pi - 2 * math.asin(0.3)) / 8)
    hole = contour([(x, 3), (-10, 0), (x, -3), (30, -3), (30, 3)], [bulge, bulge, 0, 0, 0])
    curve = run([clockwise(hole)], 3.0)
    assert curve.closed.tolist() == [True]
    assert sorted(curve.segments.radius.round(6).tolist()) == [3.0, 3.0, 7.0, 7.0]
    assert measure_deviation([hole], curve, 3.0) < 1e-4


def test_parts_nearer_than_the_tool_share_one_curve() -> None:
    squares = [rectangle(0, 0, 40, 40), rectangle(44, 0, 40, 40)]
    curve = run(squares, 3.0)
    assert len(curve.closed) == 1
    assert measure_deviation(squares, curve, 3.0) < 1e-9
    # The curve follows two outlines of 160 mm. The sides of 40 mm that face each other are missing,
    # apart from the tips where the tool dips between them.
    dip = math.acos(2 / 3)
    expected = 240 + 4 * (3 * math.pi / 2) + 4 * 3 * (math.pi / 2 - dip)
    assert curve.segments.length.sum() == pytest.approx(expected, abs=1e-9)


def test_an_outline_drawn_with_thousands_of_short_segments_keeps_its_distance() -> None:
    t = np.linspace(0, math.pi, 1700)
    outer = np.column_stack([30 * np.cos(t), 30 * np.sin(t)])
    inner = np.column_stack([20 * np.cos(t[::-1]), 20 * np.sin(t[::-1])])
    crescent = contour(np.concatenate([outer, inner]).tolist())
    curve = run([crescent], 4.76)
    assert len(curve.closed) == 1
    assert measure_deviation([crescent], curve, 4.76) < 1e-4
    exact = math.pi * (30 + 4.76) + math.pi * (20 - 4.76) + 2 * 10 + 4 * 4.76 * math.pi / 2
    assert curve.segments.length.sum() == pytest.approx(exact, abs=1e-3)


def star(radii: list[float], bulges: list[float]) -> Contour:
    angle = np.linspace(0, 2 * math.pi, len(radii), endpoint=False)
    directions = np.column_stack([np.cos(angle), np.sin(angle)])
    return contour(directions * np.array(radii)[:, None], bulges)


stars = st.integers(5, 12).flatmap(
    lambda n: st.builds(
        star,
        st.lists(st.floats(20, 60), min_size=n, max_size=n),
        st.lists(st.sampled_from([0.0, 0.0, 0.2, -0.15]), min_size=n, max_size=n),
    )
)


@example(star([20.0] * 11 + [24.0], [0.0] * 9 + [0.2, 0.0, 0.0]), 11.0, False)
@given(shape=stars, distance=st.sampled_from([1.0, 3.0, 6.35, 11.0]), inside=st.booleans())
def test_any_shape_agrees_with_geos(shape: Contour, distance: float, inside: bool) -> None:
    points, _ = flatten(make_contour_segments([shape]), 1e-3)
    polygon = shapely.Polygon(points)
    if not polygon.is_valid:
        return
    curve = run([clockwise(shape) if inside else shape], distance)
    # Lines are buffered one by one: in a polygon, GEOS leaves out corners that are hollow by less
    # than a hundredth of the distance.
    ring = np.concatenate([points, points[:1]])
    lines = shapely.linestrings(np.stack([ring[:-1], ring[1:]], axis=1))
    band = shapely.union_all(shapely.buffer(lines, distance, quad_segs=64))
    expected = polygon.difference(band) if inside else polygon.union(band)
    sign = -1 if inside else 1
    assert curve.open_ends == 0
    assert sign * area(curve) == pytest.approx(expected.area, rel=2e-4, abs=0.05)
    assert curve.segments.length.sum() == pytest.approx(expected.length, rel=1e-3, abs=0.1)
    if len(curve.segments):
        assert measure_deviation([shape], curve, distance) < 2e-3


@given(shape=stars, shift=st.integers(0, 11), inside=st.booleans())
def test_the_start_vertex_does_not_matter(shape: Contour, shift: int, inside: bool) -> None:
    shape = clockwise(shape) if inside else shape
    shifted = contour(np.roll(shape.points, shift, axis=0), np.roll(shape.bulges, shift))
    first, second = run([shape], 3.0), run([shifted], 3.0)
    assert first.segments.length.sum() == pytest.approx(second.segments.length.sum(), abs=1e-6)
    assert area(first) == pytest.approx(area(second), abs=1e-6)
    assert sorted(np.bincount(first.segments.owner)) == sorted(np.bincount(second.segments.owner))


def test_an_open_chain_has_a_curve_on_its_right_side_alone() -> None:
    corner = contour([(0, 0), (50, 0), (50, 30)], closed=False)
    curve = run([corner], 3.0)
    assert curve.closed.tolist() == [False]
    assert curve.segments.start[0] == pytest.approx([0, -3])
    assert curve.segments.end[-1] == pytest.approx([53, 30])
    assert curve.segments.length.sum() == pytest.approx(80 + 1.5 * math.pi)
