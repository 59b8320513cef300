"""Rounded paths, against formulas of their own."""

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


def make(start: FloatArray, via: FloatArray, end: FloatArray) -> Spans:
    return make_spans(start[None], via[None], end[None])


def line(length: float, turn: float = 0.0) -> Spans:
    """A line that ends in the origin; with a turn one that begins there."""
    far = length * np.array([math.cos(turn), math.sin(turn), 0.0])
    return make(np.zeros(3), NO_VIA, far) if turn else make(-far, NO_VIA, np.zeros(3))


def arc(radius: float, sweep: float, begin: float = 0.0) -> Spans:
    """An arc to the left of +x that touches the x axis in the origin at an angle of 0 along it."""
    angles = begin + sweep * np.array([0.0, 0.5, 1.0])
    places = np.stack([np.sin(angles), 1 - np.cos(angles), 0 * angles], axis=1) * radius
    return make(*places)


def measure(first: Spans, second: Spans, blend: float, dynamics: Dynamics = ZONE) -> float:
    pair = Transitions(first, second, np.array([blend]), np.array([20.0]))
    return float(measure_rounding(pair, dynamics)[0])


@pytest.mark.parametrize("degrees", [1.0, 20.0, 90.0, 150.0, 179.0])
@pytest.mark.parametrize("blend", [0.3, 1.0, 5.0])
def test_two_lines_are_passed_at_half_of_the_blend_times_the_sine(
    degrees: float, blend: float
) -> None:
    turn = math.radians(degrees)
    wanted = blend * math.sin(turn / 2) / 2
    assert measure(line(30), line(30, turn), blend) == pytest.approx(wanted, rel=2e-3)


@pytest.mark.parametrize("radius", [2.0, 10.0, 50.0])
@pytest.mark.parametrize("share", [0.01, 0.05, 0.1])
def test_a_line_into_an_arc_is_left_by_a_parabola(radius: float, share: float) -> None:
    """It is 3/32 of the jump of curvature times the square of the zone, for small zones."""
    blend = share * radius
    wanted = 3 / 32 * blend**2 / radius
    assert measure(line(99), arc(radius, 2.0), blend) == pytest.approx(wanted, rel=0.02)


@pytest.mark.parametrize("radius", [2.0, 10.0, 50.0])
def test_two_arcs_of_one_circle_are_left_where_both_are_run_at_once(radius: float) -> None:
    """Half of a quarter of the zone on both sides: 2 R (1 - cos(b / 4R)) in the middle."""
    blend = 0.1 * radius
    wanted = 2 * radius * (1 - math.cos(0.1 / 4))
    distance = measure(arc(radius, 1.5, -1.5), arc(radius, 1.5), blend)
    assert distance == pytest.approx(wanted, rel=1e-3)


def test_a_zone_is_cut_at_half_of_the_shorter_neighbour() -> None:
    turn = math.pi / 2
    cut = measure(line(0.4), line(30, turn), 5.0)
    assert cut == pytest.approx(measure(line(30), line(30, turn), 0.2))


def test_overlapping_motions_begin_as_the_first_brakes() -> None:
    """At 20 mm/s and 500 mm/s2 that is 0.4 mm before the corner."""
    turn = math.pi / 2
    distance = measure(line(30), line(30, turn), 1.0, OVERLAP)
    assert distance == pytest.approx(0.4 * math.sin(turn / 2) / 2, rel=2e-3)


def test_the_measure_does_not_depend_on_the_direction_in_space() -> None:
    turned = rotation_about(0, 0.7) @ rotation_about(2, 1.1)

    def turn(motion: Spans) -> Spans:
        return make_spans(motion.start @ turned.T, motion.via @ turned.T, motion.end @ turned.T)

    left, right = arc(4.0, 1.0, -1.0), arc(7.0, 1.0)
    for first, second in ((line(9), arc(4.0, 1.0)), (left, right), (line(9), line(9, 1.0))):
        moved = measure(turn(first), turn(second), 1.0)
        assert moved == pytest.approx(measure(first, second, 1.0), rel=1e-9)


def test_a_rounded_path_begins_and_ends_on_the_programmed_one() -> None:
    pair = Transitions(line(30), arc(10.0, 1.0), np.array([1.0]), np.array([20.0]))
    for curve in round_off(pair, ZONE):
        assert curve[0, 0] == pytest.approx([-1.0, 0.0, 0.0])
        # The end of the zone is 1 mm from the corner, on the circle about (0, 10).
        assert np.hypot(*curve[0, -1, :2]) == pytest.approx(1.0)
        assert np.hypot(curve[0, -1, 0], curve[0, -1, 1] - 10.0) == pytest.approx(10.0)


@pytest.mark.parametrize("radius", [0.3, 1.0, 3.0, 6.4, 20.0, 200.0])
@pytest.mark.parametrize("tolerance", [0.002, 0.01, 0.05])
def test_the_widest_zone_within_the_tolerance_is_chosen(radius: float, tolerance: float) -> None:
    first, second = line(99), arc(radius, 2.0)
    points = np.concatenate([first.start, second.start, second.end])
    both = make_spans(points[:-1], np.concatenate([first.via, second.via]), points[1:])
    chosen = float(blend_corners(both, np.full(2, 20.0), tolerance, ZONE)[0])
    # A zone of 1 or 5 mm is no wider than half of the arc.
    zones = [zone for zone in (5.0, 1.0, 0.3, 0.1) if zone <= max(radius, 0.3)]
    allowed = [zone for zone in zones if measure(first, second, zone) <= tolerance]
    assert chosen == (allowed[0] if allowed else 0.0)
    # The rule of the parabola is b <= sqrt(32 / 3 tolerance / jump of curvature).
    rule = math.sqrt(32 / 3 * tolerance * radius)
    assert chosen <= 1.05 * rule
