"""Loops that need no test against others: told apart rightly, and nothing changes by it."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from camgen.geometry import nesting
from camgen.geometry.nesting import find_plain, measure_loop_areas
from camgen.geometry.segments import make_contour_segments
from camgen.model.part import Contour
from tests.support.drawn import circle, clockwise, contour, rectangle, rounded

ELL = contour([(0, 0), (20, 0), (20, 5), (5, 5), (5, 20), (0, 20)])
#: A circle with a bite: its outline turns inward along the arc of the bite.
BITTEN = contour([(10, 0), (-10, 0), (0, -4)], [1.0, 0.0, -0.4])


def found(*loops: Contour) -> list[bool]:
    return find_plain(make_contour_segments(loops), len(loops)).tolist()


@pytest.mark.parametrize("shape", [circle(0, 0, 5), rectangle(0, 0, 9, 4), rounded(30, 20, 5)])
def test_convex_loops_are_plain_in_both_directions(shape: Contour) -> None:
    assert found(shape) == [True]
    assert found(clockwise(shape)) == [True]


def test_loops_that_turn_back_twice_round_or_there_and_back_are_not() -> None:
    twice = contour([(5, 0), (-5, 0), (5, 0), (-5, 0)], [1.0] * 4)
    star = contour(
        [(math.cos(4 * math.pi * k / 5), math.sin(4 * math.pi * k / 5)) for k in range(5)]
    )
    for shape in (ELL, clockwise(ELL), BITTEN, twice, star, contour([(0, 0), (10, 0)])):
        assert found(shape) == [False]


def test_a_loop_with_anything_in_its_box_is_not_alone() -> None:
    plate, hole, corner = rectangle(0, 0, 50, 50), circle(20, 20, 5), circle(26.5, 26.5, 1)
    assert found(plate, hole) == [False, True]
    assert found(plate, hole, corner) == [False, True, True]
    assert found(plate, hole, circle(24.5, 24.5, 1)) == [False, False, False]
    assert found(hole, hole) == [False, False]


def test_areas_are_exact() -> None:
    areas = measure_loop_areas(
        make_contour_segments(
            [circle(3, 4, 5), clockwise(rectangle(0, 0, 9, 4)), rounded(30, 20, 5)]
        ),
        3,
    )
    assert areas == pytest.approx([math.pi * 25, -36, 600 - (4 - math.pi) * 25], rel=1e-12)


@st.composite
def loops(draw: st.DrawFn) -> Contour:
    x, y, size = (draw(st.integers(0, 40)) for _ in range(3))
    kind = draw(st.sampled_from([circle, rectangle, "ell"]))
    if kind == "ell":
        return Contour(np.array(ELL.points) * (size + 1) / 20 + (x, y), ELL.bulges, True, "0", "c1")
    return circle(x, y, size + 1) if kind is circle else rectangle(x, y, size + 1, size + 2)


@given(st.lists(loops(), min_size=1, max_size=12))
def test_nesting_is_the_same_without_the_short_way(drawn: list[Contour]) -> None:
    segments = make_contour_segments(drawn)
    short = nesting.find_nesting(segments, len(drawn))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(nesting, "find_plain", lambda _, count: np.zeros(count, dtype=np.bool_))
        long = nesting.find_nesting(segments, len(drawn))
    for name in ("depth", "parent", "crossed", "empty"):
        assert getattr(short, name).tolist() == getattr(long, name).tolist()
