"""Arcs in space are compared with arcs of known centre, axis, radius and sweep."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from camgen.geometry.arcs import (
    are_bent,
    compute_bulges,
    compute_circle,
    find_arc_middles,
    find_bulge_middles,
    find_circle,
    fit_circle,
    is_arc,
    level_arms,
    make_span_chain,
    make_spans,
    make_spans_through,
    measure_arcs,
    measure_spans,
    measure_sweep,
    turn_about,
)
from camgen.model.pose import rotation_about_axis, rotation_from_fixed_xyz

ANGLES = st.floats(-3.1, 3.1)
HALF_CIRCLES = st.floats(0.01, math.pi)
FRACTIONS = st.floats(0.0, 1.0)


class KnownArc:
    """An arc around (12, -7, 3) mm in any plane.

    plane: (3, 3) rotation. Its columns are the direction from the centre to the start, the tangent
        at the start, and the axis.
    radius: mm.
    sweep: rad.
    """

    def __init__(self, angles: tuple[float, float, float], radius: float, sweep: float) -> None:
        self.plane = np.array(rotation_from_fixed_xyz(*angles))
        self.radius, self.sweep = radius, sweep
        self.centre = np.array([12.0, -7.0, 3.0])

    def point(self, fraction: float) -> np.ndarray:
        a = self.sweep * fraction
        return self.centre + self.plane @ (self.radius * np.array([math.cos(a), math.sin(a), 0.0]))

    def tangent(self, fraction: float) -> np.ndarray:
        a = self.sweep * fraction
        return self.plane @ np.array([-math.sin(a), math.cos(a), 0.0])

    def points(self, *fractions: float) -> tuple[np.ndarray, ...]:
        return tuple(self.point(fraction)[None] for fraction in fractions)


RADII, PLANES = st.floats(0.1, 500.0), st.tuples(ANGLES, ANGLES, ANGLES)
#: Arcs of up to half a circle, and of nearly a whole circle.
half_arcs = st.builds(KnownArc, PLANES, RADII, HALF_CIRCLES)
wide_arcs = st.builds(KnownArc, PLANES, RADII, st.floats(0.05, 6.2))


def slack(arc: KnownArc) -> float:
    """Error from rounding of the points, mm. It is inverse to the square of a small sweep."""
    return 1e-13 * (arc.radius + 20.0) / min(arc.sweep, 1.0) ** 2 + 1e-12


@given(half_arcs, FRACTIONS)
def test_a_span_has_the_length_radius_points_and_tangents_of_its_arc(
    arc: KnownArc, fraction: float
) -> None:
    span = make_spans(*arc.points(0.0, 0.5, 1.0))
    assert span.length[0] == pytest.approx(arc.radius * arc.sweep, rel=1e-9)
    assert span.sweep[0] == pytest.approx(arc.sweep, abs=1e-9)
    assert span.radius[0] == pytest.approx(arc.radius, abs=100 * slack(arc))
    assert np.allclose(
        span.point(np.array([fraction]))[0], arc.point(fraction), rtol=0, atol=slack(arc)
    )
    at_start, at_end = span.tangents()
    assert np.allclose(at_start[0], arc.tangent(0.0), rtol=0, atol=1e-10 / arc.sweep)
    assert np.allclose(at_end[0], arc.tangent(1.0), rtol=0, atol=1e-10 / arc.sweep)


@given(half_arcs, st.tuples(ANGLES, ANGLES, ANGLES))
def test_a_vector_is_rotated_with_the_arc_to_its_middle(
    arc: KnownArc, vector: tuple[float, float, float]
) -> None:
    rotation = rotation_about_axis(arc.plane[:, 2], arc.sweep / 2)
    rotated = make_spans(*arc.points(0.0, 0.5, 1.0)).to_middle(np.array([vector]))
    assert np.allclose(rotated[0], rotation @ np.array(vector), rtol=0, atol=1e-9 / arc.sweep)


@given(wide_arcs, st.floats(0.1, 0.9))
def test_the_via_point_may_lie_anywhere_on_the_arc(arc: KnownArc, fraction: float) -> None:
    points = arc.points(0.0, fraction, 1.0)
    allowed = 1e3 * slack(arc) + 1e-9 * arc.radius / (2 * math.pi - arc.sweep)
    assert np.allclose(find_arc_middles(*points)[0], arc.point(0.5), rtol=0, atol=allowed)
    assert measure_arcs(*points)[0] == pytest.approx(arc.radius * arc.sweep, rel=1e-7)
    span = make_spans_through(*points)
    assert np.allclose(span.point(np.array([0.25]))[0], arc.point(0.25), rtol=0, atol=allowed)
    assert np.allclose(span.tangents()[0][0], arc.tangent(0.0), rtol=0, atol=1e-6)


@given(wide_arcs, st.floats(0.1, 0.9))
def test_functions_for_a_single_arc_give_the_same_arc(arc: KnownArc, fraction: float) -> None:
    start, via, end = (tuple(arc.point(f).tolist()) for f in (0.0, fraction, 1.0))
    centre, radius, axis, sweep = compute_circle(start, via, end)
    allowed = 1e3 * slack(arc) + 1e-9 * arc.radius / (2 * math.pi - arc.sweep) ** 2
    assert np.allclose(centre, arc.centre, rtol=0, atol=allowed)
    assert radius == pytest.approx(arc.radius, abs=allowed)
    assert np.allclose(axis, arc.plane[:, 2], rtol=0, atol=1e-6)
    assert sweep == pytest.approx(arc.sweep, abs=1e-6)
    assert is_arc(start, via, end)
    assert measure_sweep(start, via, end)[0] == pytest.approx(arc.sweep, abs=1e-6)
    arm = tuple((arc.point(0.0) - arc.centre).tolist())
    assert np.allclose(
        turn_about(arm, axis, sweep), arc.point(1.0) - arc.centre, rtol=0, atol=allowed
    )
    circle = find_circle(*(arc.point(f) for f in (0.0, fraction, 1.0)))
    assert circle is not None
    assert np.allclose(circle.center, arc.centre, rtol=0, atol=allowed)


@given(st.floats(-1.0, 1.0).filter(lambda b: abs(b) > 1e-3), st.floats(0.1, 100.0), ANGLES)
def test_a_bulge_is_the_tangent_of_a_quarter_of_the_sweep(
    bulge: float, chord: float, angle: float
) -> None:
    start, end = np.zeros((1, 3)), chord * np.array([[math.cos(angle), math.sin(angle), 0.0]])
    middle = find_bulge_middles(start, np.array([bulge]), end)
    assert compute_bulges(start, middle, end)[0] == pytest.approx(bulge)
    assert measure_spans(np.vstack([start, end]), middle)[0] == pytest.approx(
        4 * math.atan(abs(bulge)) * chord * (1 + bulge * bulge) / (4 * abs(bulge))
    )
    # A positive bulge runs counter-clockwise, so that the centre is on the left of the travel.
    arm, sweep, left = level_arms(start, middle, end)
    assert left[0] == (bulge > 0)
    assert sweep[0] == pytest.approx(4 * math.atan(abs(bulge)))
    ahead = end[0, :2] / chord
    assert (ahead[0] * arm[0, 1] - ahead[1] * arm[0, 0]) * bulge >= -1e-9


def test_a_line_is_a_span_without_a_via_point() -> None:
    start, end = np.array([[0.0, 0, 0], [1, 1, 1]]), np.array([[3.0, 4, 0], [1, 1, 1]])
    lines = make_spans(start, np.full((2, 3), np.nan), end)
    assert lines.length.tolist() == [5.0, 0.0]
    assert lines.sweep.tolist() == [0.0, 0.0]
    assert lines.point(np.array([0.2, 0.5])).tolist() == [[3 * 0.2, 4 * 0.2, 0.0], [1.0, 1.0, 1.0]]
    assert lines.tangents()[0].tolist() == [[0.6, 0.8, 0.0], [0.0, 0.0, 0.0]]


@pytest.mark.parametrize("height", [0.0, 1e-12, 1e-9, 1e-6])
def test_a_flat_arc_is_as_long_as_its_chord(height: float) -> None:
    start, end = np.zeros((1, 3)), np.array([[100.0, 0.0, 0.0]])
    via = np.array([[50.0, height, 0.0]])
    assert are_bent(start, via, end)[0] == (height > 1e-7)
    assert make_spans(start, via, end).length[0] == pytest.approx(100.0, rel=1e-12)
    assert make_spans_through(start, via, end).length[0] == pytest.approx(100.0, rel=1e-12)
    assert measure_arcs(start, via, end)[0] == pytest.approx(100.0, rel=1e-12)
    quarter = make_spans(start, via, end).point(np.array([0.25]))
    assert np.allclose(quarter, [[25.0, 0.75 * height, 0.0]], rtol=0, atol=1e-9)


def test_points_on_a_line_with_the_via_point_outside_are_not_an_arc() -> None:
    start, via, end = np.zeros((1, 3)), np.array([[30.0, 0.0, 0.0]]), np.array([[10.0, 0.0, 0.0]])
    assert measure_arcs(start, via, end)[0] == pytest.approx(50.0)  # 30 mm forward, 20 mm back
    assert not make_spans_through(start, via, end).curved[0]
    assert not is_arc((0.0, 0.0, 0.0), (30.0, 0.0, 0.0), (10.0, 0.0, 0.0))


@given(wide_arcs, st.integers(4, 30))
def test_a_circle_is_fitted_to_its_points(arc: KnownArc, count: int) -> None:
    circle = fit_circle(np.array([arc.point(k / (count - 1)) for k in range(count)]))
    assert circle is not None
    allowed = 1e4 * slack(arc)
    assert np.allclose(circle.center, arc.centre, rtol=0, atol=allowed)
    assert circle.radius == pytest.approx(arc.radius, abs=allowed)
    assert np.allclose(circle.axis, arc.plane[:, 2], rtol=0, atol=1e-5)


@pytest.mark.parametrize("size", [1.0, 100.0, 10_000.0])
def test_points_on_a_line_with_rounding_are_not_an_arc_at_any_size(size: float) -> None:
    # The sine of the angle between both chords is 4e-10. Below 1e-9, the points are on a line.
    start, end = (0.0, 0.0, 0.0), (size, 0.0, size)
    via = (size / 2, math.sqrt(2) * size / 2 * 4e-10, size / 2)
    with pytest.raises(ValueError, match="on one line"):
        compute_circle(start, via, end)
    bent_via = (size / 2, math.sqrt(2) * size / 2 * 4e-9, size / 2)
    assert compute_circle(start, bent_via, end)[1] > 1e6 * size


def test_a_chain_has_a_span_from_each_point_to_the_next() -> None:
    points = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 2.0, 0.0], [1.0, 2.0, 4.0]])
    spans_between = make_span_chain(points, np.full((3, 3), np.nan))
    assert spans_between.start.tolist() == points[:3].tolist()
    assert spans_between.length.tolist() == [1.0, 2.0, 4.0]
