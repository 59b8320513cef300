"""Channels as wide as the tool have centre lines, which are known by construction."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from camgen.geometry.centre_lines import CentreLines, find_centre_lines
from camgen.geometry.intersect import Obstacles, measure_nearest
from camgen.geometry.segments import find_following, make_contour_segments, points_at
from camgen.model.part import Contour, IntArray
from camgen.model.pose import FloatArray
from tests.support.drawn import circle, clockwise, contour, rectangle
from tests.support.examples import fewer

RADIUS, SLACK = 3.0, 0.004
NONE = make_contour_segments([])


def slot(length: float, width: float) -> Contour:
    half = width / 2
    corners = [(0, -half), (length, -half), (length, half), (0, half)]
    return contour(corners, [0.0, 1.0, 0.0, 1.0])


def lines_in(*contours: Contour) -> CentreLines:
    """The centre lines within outer contours, which are drawn counter-clockwise."""
    source = make_contour_segments([clockwise(shape) for shape in contours])
    following = find_following(source, np.ones(len(contours), dtype=np.bool_))
    group = np.zeros(len(source), dtype=np.int64)
    return find_centre_lines(source, following, group, RADIUS, SLACK, NONE)


def ends(lines: CentreLines) -> list[list[float]]:
    """The first and last points of the only line, the left one first."""
    assert lines.closed.tolist() == [False]
    both = np.array([lines.segments.start[0], lines.segments.end[-1]])
    return sorted(np.round(both, 3).tolist())


@pytest.mark.parametrize("width", [5.9925, 5.995, 6.0, 6.0001, 6.002])
def test_a_slot_has_its_centre_line(width: float) -> None:
    lines = lines_in(slot(30, width))
    assert ends(lines) == [[0, 0], [30, 0]]
    assert len(lines.segments) == 1
    assert {int(lines.source[0]), int(lines.other[0])} == {0, 2}


@pytest.mark.parametrize("width", [5.98, 5.99, 6.01])
def test_a_channel_of_another_width_has_none(width: float) -> None:
    lines = lines_in(slot(30, width))
    assert not len(lines.segments)
    assert not len(lines.holes)


def test_a_centre_line_keeps_the_tool_radius_from_a_square_end() -> None:
    lines = lines_in(rectangle(0, 0, 30, 6))
    assert ends(lines) == [[3, 3], [27, 3]]


def test_the_centre_line_of_a_bent_slot_is_an_arc() -> None:
    inner, outer, quarter = 17.0, 23.0, math.tan(math.pi / 8)
    corners = [(0, inner), (inner, 0), (outer, 0), (0, outer)]
    lines = lines_in(contour(corners, [-quarter, 1.0, quarter, 1.0]))
    assert ends(lines) == [[0, 20], [20, 0]]
    assert lines.segments.radius.tolist() == pytest.approx([20])


def test_a_ring_between_two_circles_is_closed() -> None:
    source = make_contour_segments([clockwise(circle(0, 0, 23)), circle(0, 0, 17, "c2")])
    following = find_following(source, np.ones(2, dtype=np.bool_))
    group = np.zeros(len(source), dtype=np.int64)
    lines = find_centre_lines(source, following, group, RADIUS, SLACK, NONE)
    assert lines.closed.tolist() == [True]
    assert lines.segments.length.sum() == pytest.approx(40 * math.pi)
    assert not set(lines.source // 2) & set(lines.other // 2)


def test_a_centre_line_turns_at_the_corner_of_an_l() -> None:
    corners = [(0, 0), (30, 0), (30, 30), (24, 30), (24, 6), (0, 6)]
    lines = lines_in(contour(corners))
    assert ends(lines) == [[3, 3], [27, 27]]
    assert sum(abs(angle) for angle in lines.turn) == pytest.approx(math.pi / 2)


def test_the_arms_of_a_t_are_run_once() -> None:
    corners = [(0, 0), (30, 0), (30, 6), (18, 6), (18, 30), (12, 30), (12, 6), (0, 6)]
    lines = lines_in(contour(corners))
    # Two arms of 9 mm, the stem of 21 mm, and a quarter of a circle between them.
    expected = 9 + 9 + 21 + 3 * math.pi / 2
    assert lines.segments.length.sum() == pytest.approx(expected, abs=0.05)
    points = np.array([[4.0, 3.0], [15.0, 26.0], [26.0, 3.0]])
    assert measure_nearest(points, lines.segments, 1.0).max() < 1e-3


def test_a_neck_between_two_wide_areas_has_a_centre_line() -> None:
    lower = [(0, 0), (20, 0), (20, 7), (40, 7), (40, 0), (60, 0)]
    upper = [(60, 20), (40, 20), (40, 13), (20, 13), (20, 20), (0, 20)]
    assert ends(lines_in(contour(lower + upper))) == [[20, 10], [40, 10]]


def test_a_round_hole_as_wide_as_the_tool_is_a_point() -> None:
    lines = lines_in(circle(7, -2, 3))
    assert not len(lines.segments)
    assert lines.holes.tolist() == [pytest.approx([7, -2])]


def test_a_line_that_is_known_already_is_left_out() -> None:
    source = make_contour_segments([clockwise(slot(30, 6))])
    following = find_following(source, np.ones(1, dtype=np.bool_))
    known = make_contour_segments([contour([(-5, 0), (18, 0)], closed=False)])
    lines = find_centre_lines(source, following, source.owner, RADIUS, SLACK, known)
    assert ends(lines)[1] == [30, 0]
    assert ends(lines)[0][0] == pytest.approx(18, abs=5 * SLACK)


@fewer(12)
@given(
    st.floats(0.3, 3.0),
    st.floats(2.0, 9.0),
    st.floats(-0.003, 0.001),
    st.integers(30, 90),
)
def test_a_wavy_slot_is_followed_and_never_cut_deeper_than_the_slack(
    turns: float, height: float, excess: float, count: int
) -> None:
    """A slot around a wave of chords. GEOS makes its walls, at half of the width on both sides."""
    t = np.linspace(0, 1, count)
    wave = np.column_stack([60 * t, height * np.sin(2 * np.pi * turns * t)])
    middle = shapely.LineString(wave)
    walls = middle.buffer(RADIUS + excess, quad_segs=64, cap_style="flat", join_style="round")
    if walls.geom_type != "Polygon" or len(walls.interiors):
        return
    corners = np.array(walls.exterior.coords)[:-1]
    shape = contour((corners if walls.exterior.is_ccw else corners[::-1]).tolist())
    lines = lines_in(shape)
    fractions = np.linspace(0, 1, 9)
    segments = lines.segments.take(np.repeat(np.arange(len(lines.segments)), 9))
    points = points_at(segments, np.tile(fractions, len(lines.segments)))
    gaps = shapely.distance(shapely.points(points), walls.exterior)
    assert (gaps >= RADIUS - SLACK - 1e-6).all()


def test_long_walls_of_a_wide_area_are_measured_at_few_points(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    measured = 0
    nearest = Obstacles.nearest

    def count(self: Obstacles, points: FloatArray, group: IntArray, reach: float) -> FloatArray:
        nonlocal measured
        measured += len(points)
        return nearest(self, points, group, reach)

    monkeypatch.setattr(Obstacles, "nearest", count)
    assert not len(lines_in(rectangle(0, 0, 80_000, 80_000)).segments)
    assert 0 < measured < 20_000
    # A slot of 8 m has its centre line.
    assert ends(lines_in(slot(8_000, 6.0))) == [[0, 0], [8_000, 0]]


@pytest.mark.parametrize("shape", [circle(0, 0, 5), circle(0, 0, 9), slot(22, 8)])
def test_a_hole_that_is_wider_than_the_tool_is_not_measured(
    monkeypatch: pytest.MonkeyPatch, shape: Contour
) -> None:
    measured: list[int] = []
    nearest = Obstacles.nearest

    def count(self: Obstacles, points: FloatArray, group: IntArray, reach: float) -> FloatArray:
        measured.append(len(points))
        return nearest(self, points, group, reach)

    monkeypatch.setattr(Obstacles, "nearest", count)
    assert not len(lines_in(shape).segments)
    assert sum(measured) == 0


def test_an_arc_near_its_centre_is_measured() -> None:
    # The parallel arc beyond the centre of a round end of 3 mm touches the wall on the other side.
    assert ends(lines_in(slot(30, 6.0))) == [[0, 0], [30, 0]]
    # A parallel arc at its own centre is a point.
    hole = lines_in(circle(0, 0, 4.5))
    assert not len(hole.segments)
    assert not len(hole.holes)
