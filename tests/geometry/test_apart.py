"""Loops that are independent at a distance are found, by the pairs of boxes that overlap."""

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
    second: list[tuple[tuple[int, int, int, int], int]],
) -> None:
    owner = np.array([loop for _, loop in second], dtype=np.int64)
    low, high = list_corners(first)
    other_low, other_high = list_corners([box for box, _ in second])
    with pytest.MonkeyPatch.context() as patch:
        # Some loops are small with this limit, and others large.
        patch.setattr(apart, "FEW", 3)
        boxes = np.hstack([low, high]), np.hstack([other_low, other_high])
        chunks = [np.empty((0, 2), int), *map(np.column_stack, find_box_pairs(*boxes, owner))]
    meets = (low[:, None] <= other_high) & (other_low <= high[:, None])
    assert sorted(np.concatenate(chunks).tolist()) == np.argwhere(meets.all(axis=2)).tolist()


def list_corners(boxes: list[tuple[int, int, int, int]]) -> tuple[np.ndarray, np.ndarray]:
    """Lower left and upper right corners (N, 2) of boxes."""
    table = np.array(boxes, dtype=float).reshape(-1, 4)
    return table[:, :2], table[:, :2] + table[:, 2:]


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
