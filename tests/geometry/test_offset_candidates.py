"""Each candidate of an offset curve agrees with the formulas of circles and lines."""

import math

import numpy as np
import pytest

from camgen.geometry.offset import _MISS, _cut_candidates, _move_sideways, _plain_corners
from camgen.geometry.segments import make_segments

QUARTER = math.tan(math.pi / 8)


@pytest.mark.parametrize(
    ("sense", "radius"),
    [(1.0, 13.0), (-1.0, 7.0)],
    ids=["outside, counter-clockwise", "inside, clockwise"],
)
def test_a_moved_arc_is_extended_along_its_circle(sense: float, radius: float) -> None:
    """A quarter of a circle with a radius of 10 mm around the origin moves by 3 mm to its right."""
    ends = np.array([[10.0, 0.0], [0.0, 10.0]])[:: int(sense)]
    source = make_segments(
        ends[:1], ends[1:], np.array([sense * QUARTER]), np.zeros(1, dtype=np.int64)
    )
    early, late = 2.0, 1.0
    start, end, bulge = _move_sideways(
        source, 3.0, np.array([radius]), np.array([early]), np.array([late])
    )
    first, last = (0.0, math.pi / 2) if sense > 0 else (math.pi / 2, 0.0)
    first, last = first - sense * early / radius, last + sense * late / radius
    assert start[0] == pytest.approx([radius * math.cos(first), radius * math.sin(first)])
    assert end[0] == pytest.approx([radius * math.cos(last), radius * math.sin(last)])
    assert bulge[0] == pytest.approx(math.tan((last - first) / 4))


def test_a_moved_line_is_extended_in_its_direction() -> None:
    source = make_segments(
        np.array([[0.0, 0.0]]), np.array([[3.0, 4.0]]), np.zeros(1), np.zeros(1, dtype=np.int64)
    )
    start, end, bulge = _move_sideways(
        source, 5.0, np.array([np.inf]), np.array([10.0]), np.array([20.0])
    )
    # The direction is (0.6, 0.8), and its right side is (0.8, -0.6).
    assert start[0] == pytest.approx([4.0 - 6.0, -3.0 - 8.0])
    assert end[0] == pytest.approx([3.0 + 4.0 + 12.0, 4.0 - 3.0 + 16.0])
    assert bulge[0] == 0.0


@pytest.mark.parametrize(("before", "after"), [(1.0, 1.0), (1.0, 8.0), (8.0, 1.0), (0.4, math.inf)])
def test_a_plain_corner_joins_curves_that_nearly_meet(before: float, after: float) -> None:
    """Each curve deviates from its tangent by its sagitta. At the corner, both sagittas add up."""
    distance = 3.0
    for fraction, is_plain in ((0.9, True), (1.1, False)):
        # An extension e on a radius R has a sagitta of e^2 / 2R. The arc of the corner is 2 e long.
        extension = math.sqrt(2.0 * fraction * _MISS / (1.0 / before + 1.0 / after))
        angle = np.array([2.0 * extension / distance])
        plain = _plain_corners(angle, np.array([before]), np.array([after]), distance, 1.0)
        assert plain.tolist() == [is_plain]


def test_a_plain_corner_is_flat_and_outer() -> None:
    straight = np.full(4, np.inf)
    angles = np.array([0.0, -0.01, 0.01, 0.49])
    # A corner with the angle t is t^2 d / 8 outside of the arc around it: 0.04 um for 0.01 rad.
    plain = _plain_corners(angles, straight, straight, 3.0, 0.001)
    assert plain.tolist() == [False, False, True, False]


def test_a_candidate_is_cut_at_crossings_but_not_next_to_its_ends() -> None:
    """Three lines cross the first one, in its middle and 1e-7 mm from both of its ends."""
    x = np.array([5.0, 1e-7, 10.0 - 1e-7])
    start = np.vstack([[0.0, 0.0], np.column_stack([x, np.full(3, -1.0)])])
    end = np.vstack([[10.0, 0.0], np.column_stack([x, np.full(3, 1.0)])])
    owner = np.arange(4, dtype=np.int64)
    candidates = make_segments(start, end, np.zeros(4), owner)
    row, low, high = _cut_candidates(candidates, np.zeros(4, dtype=np.int64))
    first = row == 0
    assert low[first] == pytest.approx([0.0, 0.5], abs=0.0)
    assert high[first] == pytest.approx([0.5, 1.0], abs=0.0)
