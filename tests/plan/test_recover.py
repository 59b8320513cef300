"""Arcs that are recovered from short lines."""

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from camgen.geometry.intersect import Obstacles
from camgen.geometry.segments import make_contour_segments
from camgen.model.part import Contour
from camgen.plan.recover import recover_arcs
from tests.support.drawn import circle, clockwise, contour, rectangle


def ellipse(a: float, b: float, count: int) -> Contour:
    t = np.linspace(0, 2 * math.pi, count, endpoint=False)
    return contour(np.column_stack([a * np.cos(t), b * np.sin(t)]).tolist())


def measure_deviation(drawn: Contour, recovered: Contour) -> float:
    """Largest distance of points along the drawn lines from the recovered contour, mm."""
    ends = np.roll(drawn.points, -1, axis=0) if drawn.closed else drawn.points[1:]
    starts = drawn.points if drawn.closed else drawn.points[:-1]
    points = np.concatenate([starts + f * (ends - starts) for f in (0.0, 0.25, 0.5, 0.75)])
    shape = make_contour_segments([recovered])
    obstacles = Obstacles(shape, np.zeros(len(shape), dtype=np.int64))
    return float(obstacles.nearest(points, np.zeros(len(points), dtype=np.int64), 10.0).max())


def test_a_slot_drawn_with_short_lines_becomes_two_lines_and_two_arcs() -> None:
    t = np.linspace(-math.pi / 2, math.pi / 2, 60)
    right = np.column_stack([40 + 10 * np.cos(t), 10 * np.sin(t)])
    slot = contour(np.concatenate([right, -right + [40, 0]]).tolist())
    (recovered,), (note,) = recover_arcs([slot], 0.01)
    segments = make_contour_segments([recovered])
    assert np.isinf(segments.radius).sum() == 2
    assert segments.radius[segments.is_arc] == pytest.approx(10.0, abs=1e-6)
    assert len(segments) <= 6
    assert segments.length.sum() == pytest.approx(80 + 20 * math.pi, abs=0.01)
    assert note.kind == "assumed"
    assert note.what.startswith("118 short lines")


@pytest.mark.parametrize("turned", [False, True])
def test_an_ellipse_is_kept_within_the_tolerance_in_both_directions(turned: bool) -> None:
    drawn = ellipse(50, 20, 400)
    drawn = clockwise(drawn) if turned else drawn
    (recovered,), _ = recover_arcs([drawn], 0.01)
    assert len(recovered.points) < 40
    assert measure_deviation(drawn, recovered) <= 0.01 + 1e-9


def test_polygons_with_few_sides_stay_polygons() -> None:
    shapes = [rectangle(0, 0, 50, 30), ellipse(50, 50, 24), ellipse(5, 5, 8)]
    contours, notes = recover_arcs(shapes, 0.01)
    assert all(a is b for a, b in zip(contours, shapes, strict=True))
    assert notes == ()


def test_a_tolerance_of_zero_keeps_every_line() -> None:
    drawn = ellipse(50, 20, 400)
    assert recover_arcs([drawn], 0.0) == ((drawn,), ())


def test_a_drawn_circle_is_not_changed() -> None:
    drawn = circle(0, 0, 10)
    assert recover_arcs([drawn], 0.01)[0][0] is drawn


@example([5.5625], 2.15923, 18, 0.01)
@given(
    radii=st.lists(st.floats(2.0, 40.0), min_size=1, max_size=4),
    sweep=st.floats(0.6, 3.0),
    count=st.integers(8, 200),
    tolerance=st.sampled_from([0.002, 0.01, 0.1]),
)
def test_open_chains_of_arcs_keep_their_ends_and_the_tolerance(
    radii: list[float], sweep: float, count: int, tolerance: float
) -> None:
    points = [np.zeros(2)]
    heading = 0.0
    for k, radius in enumerate(radii):
        step = (1 if k % 2 else -1) * sweep / count
        for _ in range(count):
            heading += step
            points.append(
                points[-1] + radius * abs(step) * np.array([math.cos(heading), math.sin(heading)])
            )
    drawn = contour(points, closed=False)
    (recovered,), _ = recover_arcs([drawn], tolerance)
    assert measure_deviation(drawn, recovered) <= tolerance + 1e-9
    assert recovered.points[0] == pytest.approx(drawn.points[0])
    assert recovered.points[-1] == pytest.approx(drawn.points[-1])
