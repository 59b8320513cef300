"""Loops that are independent at a distance are found, by the pairs of boxes that overlap."""

from itertools import product

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

#: Lower left corner, width and height of a box.
_BOX = st.tuples(st.integers(0, 9), st.integers(0, 9), st.integers(0, 4), st.integers(0, 4))


@given(
    st.lists(_BOX, max_size=8),
    st.lists(st.tuples(_BOX, st.integers(0, 5)), min_size=1, max_size=20),
)
def test_all_pairs_of_boxes_that_meet_are_found(
    first: list[tuple[int, int, int, int]],
    second_with_owners: list[tuple[tuple[int, int, int, int], int]],
) -> None:
    second = [box for box, _ in second_with_owners]
    owner = np.array([loop for _, loop in second_with_owners], dtype=np.int64)
    with pytest.MonkeyPatch.context() as patch:
        # Some loops are small with this limit, and others large.
        patch.setattr(apart, "FEW", 3)
        chunks = [*find_box_pairs(list_bounds(first), list_bounds(second), owner)]
    pairs: list[tuple[int, int]] = []
    for first_rows, second_rows in chunks:
        pairs += zip(first_rows.tolist(), second_rows.tolist(), strict=True)
    rows = product(range(len(first)), range(len(second)))
    assert sorted(pairs) == [(a, b) for a, b in rows if boxes_meet(first[a], second[b])]


def list_bounds(boxes: list[tuple[int, int, int, int]]) -> np.ndarray:
    """Left, lower, right and upper sides (N, 4) of boxes."""
    table = np.array(boxes, dtype=float).reshape(-1, 4)
    return np.hstack([table[:, :2], table[:, :2] + table[:, 2:]])


def boxes_meet(first: tuple[int, int, int, int], second: tuple[int, int, int, int]) -> bool:
    x, y, width, height = first
    left, low, other_width, other_height = second
    overlaps_in_x = x <= left + other_width and left <= x + width
    return overlaps_in_x and y <= low + other_height and low <= y + height


def labels(drawn: list[Contour], distance: float) -> list[int]:
    """The label of each loop at this distance. All loops are in one group before."""
    source, closed = make_contour_segments(drawn), np.ones(len(drawn), dtype=np.bool_)
    group = np.zeros(len(source), dtype=np.int64)
    curve = make_offset(source, find_following(source, closed), group, distance, 0.001)
    label = set_apart(source, group, curve.segments, curve.source, distance)
    assert all(len(set(label[source.owner == k].tolist())) == 1 for k in range(len(drawn)))
    return [int(label[source.owner == k][0]) for k in range(len(drawn))]


def test_holes_and_parts_are_independent_if_the_tool_does_not_touch_two_at_once() -> None:
    # A plate has holes of 10 mm with walls of 0.5 mm. The tool of 6 mm is in one hole at a time.
    plate = rectangle(-20, -20, 200, 40)
    holes = [clockwise(circle(10.5 * k, 0, 5)) for k in range(12)]
    label = labels([plate, *holes], 3.0)
    assert label[0] not in label[1:]
    assert len(set(label)) == 13
    parts = [circle(x, 0, 5) for x in (0, 16.1, 32.0, 60, 90, 120, 150, 180, 210)]
    label = labels(parts, 3.0)
    # The gap is 6.1 mm after the first part and 5.9 mm after the second. The second and the third
    # part have one curve around both.
    assert label[1] == label[2]
    assert len(set(label)) == 8
