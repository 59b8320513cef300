"""Corner paths, compared with formulas."""

from __future__ import annotations

import math

import numpy as np
import pytest

from camgen.geometry.arcs import Spans, make_spans
from camgen.model.cell import Dynamics
from camgen.model.pose import FloatArray, rotation_about
from camgen.motion.corners import blend_corners
from camgen.motion.rounding import Transitions, measure_rounding, round_off

ZONE, OVERLAP = Dynamics(), Dynamics(acceleration=500.0, corner="overlap")
NO_VIA = np.full(3, np.nan)


def make_spans_from_points(start: FloatArray, via: FloatArray, end: FloatArray) -> Spans:
    """One motion through three points; via is nan for a line."""
    return make_spans(start[None], via[None], end[None])


def make_line(length: float, turn: float = 0.0) -> Spans:
    """A line along x that ends at the origin, or with a turn, rad, one that begins there."""
    far_end = length * np.array([math.cos(turn), math.sin(turn), 0.0])
    return (
        make_spans_from_points(np.zeros(3), NO_VIA, far_end)
        if turn
        else make_spans_from_points(-far_end, NO_VIA, np.zeros(3))
    )


def make_arc(radius: float, sweep: float, start: float = 0.0) -> Spans:
    """An arc to the left that touches the x axis at the origin, from angle `start` over `sweep`."""
    angles = start + sweep * np.array([0.0, 0.5, 1.0])
    points = np.stack([np.sin(angles), 1 - np.cos(angles), 0 * angles], axis=1) * radius
    return make_spans_from_points(*points)


def measure_deviation(
    first: Spans, second: Spans, blend: float, dynamics: Dynamics = ZONE
) -> float:
    """The deviation at the corner of two motions at 20 mm/s, mm."""
    pair = Transitions(first, second, np.array([blend]), np.array([20.0]))
    return float(measure_rounding(pair, dynamics)[0])


@pytest.mark.parametrize("degrees", [1.0, 20.0, 90.0, 150.0, 179.0])
@pytest.mark.parametrize("blend", [0.3, 1.0, 5.0])
def test_the_corner_of_two_lines_deviates_by_half_the_blend_times_the_sine(
    degrees: float, blend: float
) -> None:
    turn = math.radians(degrees)
    expected = blend * math.sin(turn / 2) / 2
    assert measure_deviation(make_line(30), make_line(30, turn), blend) == pytest.approx(
        expected, rel=2e-3
    )


@pytest.mark.parametrize("radius", [2.0, 10.0, 50.0])
@pytest.mark.parametrize("fraction", [0.01, 0.05, 0.1])
def test_a_line_into_an_arc_deviates_as_its_parabola(radius: float, fraction: float) -> None:
    """For small zones it is 3/32 of the change of curvature times the square of the zone."""
    blend = fraction * radius
    expected = 3 / 32 * blend**2 / radius
    assert measure_deviation(make_line(99), make_arc(radius, 2.0), blend) == pytest.approx(
        expected, rel=0.02
    )


@pytest.mark.parametrize("radius", [2.0, 10.0, 50.0])
def test_two_arcs_of_one_circle_deviate_in_the_middle_of_the_zone(radius: float) -> None:
    """In the middle both arcs are run b / 4 from the corner: 2 R (1 - cos(b / 4R))."""
    blend = 0.1 * radius
    expected = 2 * radius * (1 - math.cos(0.1 / 4))
    distance = measure_deviation(make_arc(radius, 1.5, -1.5), make_arc(radius, 1.5), blend)
    assert distance == pytest.approx(expected, rel=1e-3)


def test_a_zone_is_limited_to_half_of_the_shorter_motion() -> None:
    turn = math.pi / 2
    limited = measure_deviation(make_line(0.4), make_line(30, turn), 5.0)
    assert limited == pytest.approx(measure_deviation(make_line(30), make_line(30, turn), 0.2))


def test_an_overlap_begins_where_the_first_motion_brakes() -> None:
    """At 20 mm/s and 500 mm/s2 braking begins 0.4 mm before the corner."""
    turn = math.pi / 2
    distance = measure_deviation(make_line(30), make_line(30, turn), 1.0, OVERLAP)
    assert distance == pytest.approx(0.4 * math.sin(turn / 2) / 2, rel=2e-3)


def test_the_deviation_does_not_depend_on_the_direction_in_space() -> None:
    rotation = rotation_about(0, 0.7) @ rotation_about(2, 1.1)

    def rotate(motion: Spans) -> Spans:
        return make_spans(
            motion.start @ rotation.T, motion.via @ rotation.T, motion.end @ rotation.T
        )

    left, right = make_arc(4.0, 1.0, -1.0), make_arc(7.0, 1.0)
    for first, second in (
        (make_line(9), make_arc(4.0, 1.0)),
        (left, right),
        (make_line(9), make_line(9, 1.0)),
    ):
        rotated = measure_deviation(rotate(first), rotate(second), 1.0)
        assert rotated == pytest.approx(measure_deviation(first, second, 1.0), rel=1e-9)


def test_a_corner_path_begins_and_ends_on_the_programmed_path() -> None:
    pair = Transitions(make_line(30), make_arc(10.0, 1.0), np.array([1.0]), np.array([20.0]))
    for curve in round_off(pair, ZONE):
        assert curve[0, 0] == pytest.approx([-1.0, 0.0, 0.0])
        # The end of the zone is 1 mm from the corner, on the circle about (0, 10).
        assert np.hypot(*curve[0, -1, :2]) == pytest.approx(1.0)
        assert np.hypot(curve[0, -1, 0], curve[0, -1, 1] - 10.0) == pytest.approx(10.0)


@pytest.mark.parametrize("radius", [0.3, 1.0, 3.0, 6.4, 20.0, 200.0])
@pytest.mark.parametrize("tolerance", [0.002, 0.01, 0.05])
def test_the_widest_zone_within_the_tolerance_is_chosen(radius: float, tolerance: float) -> None:
    first, second = make_line(99), make_arc(radius, 2.0)
    points = np.concatenate([first.start, second.start, second.end])
    both = make_spans(points[:-1], np.concatenate([first.via, second.via]), points[1:])
    chosen = float(blend_corners(both, np.full(2, 20.0), tolerance, ZONE)[0])
    # The arc is 2 R long, so a zone of 1 or 5 mm is at most R.
    zones = [zone for zone in (5.0, 1.0, 0.3, 0.1) if zone <= max(radius, 0.3)]
    allowed = [zone for zone in zones if measure_deviation(first, second, zone) <= tolerance]
    assert chosen == (allowed[0] if allowed else 0.0)
    # The parabola gives b <= sqrt(32 / 3 tolerance / change of curvature).
    largest = math.sqrt(32 / 3 * tolerance * radius)
    assert chosen <= 1.05 * largest
