"""Loops that need no test against others are found, and the nesting stays the same."""

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
#: A circle with a bite. The outline is concave along the arc of the bite.
BITTEN = contour([(10, 0), (-10, 0), (0, -4)], [1.0, 0.0, -0.4])


def are_plain(*loops: Contour) -> list[bool]:
    return find_plain(make_contour_segments(loops), len(loops)).tolist()


@pytest.mark.parametrize("shape", [circle(0, 0, 5), rectangle(0, 0, 9, 4), rounded(30, 20, 5)])
def test_convex_loops_are_plain_in_both_directions(shape: Contour) -> None:
    assert are_plain(shape) == [True]
    assert are_plain(clockwise(shape)) == [True]


def test_concave_loops_double_loops_and_lines_back_and_forth_are_not_plain() -> None:
    twice = contour([(5, 0), (-5, 0), (5, 0), (-5, 0)], [1.0] * 4)
    star = contour(
        [(math.cos(4 * math.pi * k / 5), math.sin(4 * math.pi * k / 5)) for k in range(5)]
    )
    for shape in (ELL, clockwise(ELL), BITTEN, twice, star, contour([(0, 0), (10, 0)])):
        assert are_plain(shape) == [False]


def test_a_loop_with_another_one_in_its_box_is_not_plain() -> None:
    plate, hole, corner = rectangle(0, 0, 50, 50), circle(20, 20, 5), circle(26.5, 26.5, 1)
    assert are_plain(plate, hole) == [False, True]
    assert are_plain(plate, hole, corner) == [False, True, True]
    assert are_plain(plate, hole, circle(24.5, 24.5, 1)) == [False, False, False]
    assert are_plain(hole, hole) == [False, False]


def test_the_areas_of_loops_are_exact() -> None:
    shapes = [circle(3, 4, 5), clockwise(rectangle(0, 0, 9, 4)), rounded(30, 20, 5)]
    areas = measure_loop_areas(make_contour_segments(shapes), 3)
    assert areas == pytest.approx([math.pi * 25, -36, 600 - (4 - math.pi) * 25], rel=1e-12)


@st.composite
def loops(draw: st.DrawFn) -> Contour:
    x, y, size = (draw(st.integers(0, 40)) for _ in range(3))
    kind = draw(st.sampled_from([circle, rectangle, "ell"]))
    if kind == "ell":
        return Contour(np.array(ELL.points) * (size + 1) / 20 + (x, y), ELL.bulges, True, "0", "c1")
    return circle(x, y, size + 1) if kind is circle else rectangle(x, y, size + 1, size + 2)


@given(st.lists(loops(), min_size=1, max_size=12))
def test_the_nesting_is_the_same_if_no_loop_counts_as_plain(drawn: list[Contour]) -> None:
    segments = make_contour_segments(drawn)
    with_plain = nesting.find_nesting(segments, len(drawn))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(nesting, "find_plain", lambda _, count: np.zeros(count, dtype=np.bool_))
        without_plain = nesting.find_nesting(segments, len(drawn))
    for name in ("depth", "parent", "crossed", "empty"):
        assert getattr(with_plain, name).tolist() == getattr(without_plain, name).tolist()
