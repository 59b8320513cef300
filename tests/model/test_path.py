"""Tool paths: reversal and length."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from camgen.geometry.arcs import measure_path, measure_spans
from camgen.model.path import ToolPath, make_waypoints


@st.composite
def paths(draw):
    """A path of arcs and lines with force and feed per segment, and its length.

    The length is computed from the radii and sweeps of the arcs.
    """
    n = draw(st.integers(2, 7))
    random = np.random.default_rng(draw(st.integers(0, 10_000)))
    position = [random.uniform(-50, 50, 3)]
    via = [np.full(3, np.nan)]
    length = 0.0
    for _ in range(n - 1):
        if draw(st.booleans()):
            radius, sweep = (
                random.uniform(0.1, 40),
                draw(st.sampled_from([0.01, 0.5, 2.0, math.pi])),
            )
            u, v = np.linalg.qr(random.normal(size=(3, 2)))[0].T
            centre = position[-1] - radius * u
            via.append(centre + radius * (math.cos(sweep / 2) * u + math.sin(sweep / 2) * v))
            position.append(centre + radius * (math.cos(sweep) * u + math.sin(sweep) * v))
            length += radius * sweep
        else:
            via.append(np.full(3, np.nan))
            position.append(random.uniform(-50, 50, 3))
            length += math.dist(position[-1], position[-2])
    press = random.normal(size=(n, 2, 3))
    columns = {
        "force_direction": press,
        "force": random.uniform(0, 9, n),
        "feed": random.uniform(1, 90, n),
    }
    for column in columns.values():
        column[0] = column[1]
    axis = random.normal(size=(n, 3))
    path = ToolPath(
        id="p",
        layer="l",
        table=make_waypoints(position, via, axis=axis, **columns),
        closed=False,
    )
    return path, length


COLUMNS = ("position", "via", "axis", "force_direction", "force", "feed")


@given(paths())
def test_a_path_that_is_reversed_twice_is_the_same(drawn):
    path, _ = drawn
    again = path.reversed().reversed()
    for name in COLUMNS:
        np.testing.assert_array_equal(getattr(again, name), getattr(path, name))
        assert not getattr(path.reversed(), name).flags.writeable


@given(paths())
def test_the_length_of_a_path_is_the_same_in_both_directions(drawn):
    path, length = drawn
    assert measure_path(path) == pytest.approx(length, rel=1e-9)
    assert measure_path(path.reversed()) == pytest.approx(length, rel=1e-9)


@given(paths())
def test_a_reversed_path_keeps_the_values_of_each_segment(drawn):
    path, _ = drawn
    back = path.reversed()
    n = len(path.position)
    for i in range(1, n):
        j = n - i
        np.testing.assert_array_equal(back.position[j], path.position[i - 1])
        np.testing.assert_array_equal(back.position[j - 1], path.position[i])
        np.testing.assert_array_equal(back.via[j], path.via[i])
        np.testing.assert_array_equal(back.force_direction[j], path.force_direction[i][::-1])
        assert (back.force[j], back.feed[j]) == (path.force[i], path.feed[i])
    assert np.isnan(back.via[0]).all()
    np.testing.assert_array_equal(back.force_direction[0], back.force_direction[1])


def test_a_very_flat_arc_is_as_long_as_its_chord():
    position = np.array([[0.0, 0, 0], [10, 0, 0], [10, 0, 0]])
    via = np.array([[np.nan] * 3, [5.0, 1e-9, 0], [np.nan] * 3])
    assert measure_spans(position, via[1:]) == pytest.approx([10.0, 0.0])
