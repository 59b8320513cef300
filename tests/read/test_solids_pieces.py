"""Lines, arcs and curves are distinguished by the vertices of a chain, of any mesh."""

import math
from itertools import chain

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from camgen.geometry.arcs import find_circle, fit_circle, measure_spans
from camgen.model.pose import rotation_from_fixed_xyz
from camgen.read.solid.edges import SideRun, recognise

Array = NDArray[np.float64]
TIGHT = 1e-7


def arc(
    radius: float, start: float, end: float, sides: int, center: tuple[float, float] = (0.0, 0.0)
) -> Array:
    """Points of an arc from `start` to `end` (deg), at the ends of `sides` equal chords."""
    angle = np.radians(np.linspace(start, end, sides + 1))
    x, y = center[0] + radius * np.cos(angle), center[1] + radius * np.sin(angle)
    return np.column_stack([x, y, np.zeros(sides + 1)])


def kinds(runs: list[SideRun]) -> list[str]:
    return [run.kind for run in runs]


@given(
    st.floats(0.5, 500),
    st.floats(20, 350),
    st.integers(10, 60),
    st.tuples(*[st.floats(-3, 3)] * 3),
    st.tuples(*[st.floats(-300, 300)] * 3),
)
def test_an_arc_anywhere_in_space_is_one_arc(
    radius: float,
    sweep: float,
    sides: int,
    turn: tuple[float, float, float],
    move: tuple[float, float, float],
) -> None:
    points = arc(radius, 0, sweep, sides) @ rotation_from_fixed_xyz(*turn).T + move
    _, (run,) = recognise(points, False, 1e-5 * radius, TIGHT * radius)
    assert run.kind == "arc"
    circle = run.pieces[0].circle
    assert circle is not None
    assert circle.radius == pytest.approx(radius, rel=1e-6)
    assert np.allclose(circle.center, move, atol=1e-5 * radius)
    assert circle.angles(points)[-1] == pytest.approx(math.radians(sweep), abs=1e-6)


def test_a_line_between_two_fillets_stays_a_line() -> None:
    # For any length of the line, a circle passes through the last side of the first fillet, the
    # line, and the first side of the second fillet.
    for length in (0.7, 2.0, 60.0):
        left, right = arc(5, 180, 90, 10, (0, 0)), arc(5, 90, 0, 10, (length, 0))
        _, runs = recognise(np.concatenate([left, right]), False, 1e-3, TIGHT)
        assert kinds(runs) == ["arc", "line", "arc"], length
        assert [run.pieces[0].high - run.pieces[0].low for run in runs] == [10, 1, 10]


def test_vertices_on_a_line_or_a_chord_do_not_divide_it() -> None:
    along = np.array([0, 3, 3.5, 20, 21, 50.0])
    _, runs = recognise(np.outer(along, [0.6, 0.8, 0.0]), False, 1e-3, TIGHT)
    assert kinds(runs) == ["line"]
    # A vertex of another face on a chord does not change the radius of the arc.
    points = np.insert(arc(10, 0, 90, 6), 3, arc(10, 0, 90, 6)[2:4].mean(axis=0), axis=0)
    _, (run,) = recognise(points, False, 1e-3, TIGHT * 10)
    assert run.kind == "arc"
    assert run.pieces[0].circle is not None
    assert run.pieces[0].circle.radius == pytest.approx(10, abs=1e-9)
    assert run.pieces[0].high == 7


def test_three_sides_of_a_polygon_with_corners_are_three_lines() -> None:
    _, runs = recognise(arc(10, 0, 135, 3), False, 1e-3, TIGHT)  # The corners have 45 deg.
    assert kinds(runs) == ["line", "line", "line"]


def test_an_ellipse_is_a_curve() -> None:
    t = np.linspace(0, 2 * np.pi, 49)
    points = np.column_stack([20 * np.cos(t), 11 * np.sin(t), np.zeros(49)])
    points[-1] = points[0]
    _, runs = recognise(points, True, 1e-3, TIGHT)
    assert kinds(runs) == ["curve"]
    assert runs[0].pieces[-1].high - runs[0].pieces[0].low == 48


@pytest.mark.parametrize("start", range(0, 40, 7))
def test_a_loop_may_start_at_any_vertex(start: int) -> None:
    loop = np.concatenate([arc(5, 180, 0, 18, (0, 30)), arc(5, 0, -180, 18, (0, 0))])
    rotated = np.roll(loop, -start, axis=0)
    _, runs = recognise(np.concatenate([rotated, rotated[:1]]), True, 1e-3, TIGHT)
    assert sorted(kinds(runs)) == ["arc", "arc", "line", "line"]
    pieces = chain(*(run.pieces for run in runs))
    assert np.allclose([piece.circle.radius for piece in pieces if piece.circle is not None], 5)


def test_circles_through_three_points_and_through_many_are_exact() -> None:
    points = arc(7, 10, 200, 25, (3, -4)) + np.array([0, 0, 2])
    for circle in (find_circle(points[0], points[9], points[-1]), fit_circle(points)):
        assert circle is not None
        assert np.allclose(circle.center, [3, -4, 2])
        assert circle.radius == pytest.approx(7)
        assert np.allclose(circle.axis, [0, 0, 1])
        assert np.allclose(circle.distances(points + np.array([0, 0, 0.5])), 0.5)
    assert find_circle(points[0], points[0] + [1, 1, 1], points[0] + [2, 2, 2]) is None


def test_the_lengths_of_lines_and_arcs_are_exact() -> None:
    ends = np.array([[1.0, 0, 0], [-1, 0, 0], [-1, 0, 5]])
    via = np.array([[0.0, 1, 0], [-1, 0, 2.5]])
    assert np.allclose(measure_spans(ends, via), [math.pi, 5])
