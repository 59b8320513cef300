"""Loops that are apart from all others at some distance, and the pairs of boxes that tell it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from camgen.geometry import apart
from camgen.geometry.apart import find_box_pairs, set_apart
from camgen.geometry.offset import make_offset
from camgen.geometry.segments import find_following, make_contour_segments
from camgen.model.part import Contour
from tests.support.drawn import circle, clockwise, rectangle

_PLACE = st.tuples(st.integers(0, 9), st.integers(0, 9), st.integers(0, 4), st.integers(0, 4))


@given(
    st.lists(_PLACE, max_size=8),
    st.lists(st.tuples(_PLACE, st.integers(0, 5)), min_size=1, max_size=20),
)
def test_pairs_of_boxes(
    asked: list[tuple[int, int, int, int]], others: list[tuple[tuple[int, int, int, int], int]]
) -> None:
    def boxes(places: list[tuple[int, int, int, int]]) -> list[list[float]]:
        return [[x, y, x + w, y + h] for x, y, w, h in places]

    one, two = boxes(asked), boxes([place for place, _ in others])
    owner = np.array([of for _, of in others], dtype=np.int64)
    with pytest.MonkeyPatch.context() as patch:
        # Small loops and larger ones.
        patch.setattr(apart, "FEW", 3)
        chunks = [
            *find_box_pairs(
                np.array(one, dtype=float).reshape(-1, 4), np.array(two, dtype=float), owner
            )
        ]
    found = [
        (a, b) for which, row in chunks for a, b in zip(which.tolist(), row.tolist(), strict=True)
    ]
    met = [
        (a, b)
        for a, (x, y, right, top) in enumerate(one)
        for b, (left, low, end, high) in enumerate(two)
        if x <= end and left <= right and y <= high and low <= top
    ]
    assert sorted(found) == met


def labels(drawn: list[Contour], distance: float) -> list[int]:
    """Of each loop the label at this distance, all of them in one group before."""
    source, closed = make_contour_segments(drawn), np.ones(len(drawn), dtype=np.bool_)
    one = np.zeros(len(source), dtype=np.int64)
    curve = make_offset(source, find_following(source, closed), one, distance, 0.001)
    found = set_apart(source, one, curve.segments, curve.source, distance)
    assert all(len(set(found[source.owner == k].tolist())) == 1 for k in range(len(drawn)))
    return [int(found[source.owner == k][0]) for k in range(len(drawn))]


def test_holes_are_apart_however_thin_the_wall_and_parts_are_where_the_tool_goes_between() -> None:
    # Around all of it a plate, 0.5 mm between holes of 10 mm: the tool of 6 mm is in one or in the other.
    plate = rectangle(-20, -20, 200, 40)
    holes = [clockwise(circle(10.5 * k, 0, 5)) for k in range(12)]
    found = labels([plate, *holes], 3.0)
    assert found[0] not in found[1:]
    assert len(set(found)) == 13
    parts = [circle(x, 0, 5) for x in (0, 16.1, 32.0, 60, 90, 120, 150, 180, 210)]
    found = labels(parts, 3.0)
    # 6.1 mm from the first to the second part, 5.9 from there to the third: one curve about these two.
    assert found[1] == found[2]
    assert len(set(found)) == 8
