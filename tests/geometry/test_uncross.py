"""Loops that cross themselves slightly are split at the crossing, with the part on their left."""

import math

import numpy as np
import pytest
from msgspec.structs import replace

from camgen.geometry.nesting import measure_loop_areas
from camgen.geometry.segments import Segments, find_following, make_contour_segments
from camgen.geometry.uncross import find_slips, uncross_loops
from camgen.model.part import Contour
from tests.support.drawn import clockwise, contour, rectangle

#: A line to the origin and an arc back make an angle of 0.5 deg, rad. The arc has a radius in mm.
RADIUS, ANGLE = 20.0, math.radians(0.5)
#: Distance from the tip at which line and arc cross again, mm.
CROSSING = 2 * RADIUS * math.sin(ANGLE)


def spike(angle: float = ANGLE) -> Contour:
    """A line along y = 0 to a tip at the origin, and an arc back that crosses the line.

    angle: between the line and the start of the arc, rad.
    """
    half_sweep = 0.4
    direction = math.pi + angle - half_sweep
    chord = 2 * RADIUS * math.sin(half_sweep)
    end = (chord * math.cos(direction), chord * math.sin(direction))
    return contour([(-30, 0), (0, 0), end, (-30, 20)], [0, -math.tan(half_sweep / 2), 0, 0])


def uncross(*contours: Contour) -> tuple[Segments, np.ndarray]:
    source = make_contour_segments(contours)
    following = find_following(source, np.ones(len(contours), dtype=bool))
    return uncross_loops(source, following, find_slips(source, following, len(contours)))


def split_loops(source: Segments, following: np.ndarray) -> list[Segments]:
    """The segments of each loop, which all have the owner 0."""
    loops, seen = [], set()
    for start in range(len(source)):
        row, rows = start, []
        while row not in seen:
            seen.add(row)
            rows.append(row)
            row = int(following[row])
        if rows:
            loop = source.take(np.array(rows))
            loops.append(replace(loop, owner=np.zeros_like(loop.owner)))
    return loops


def areas(shape: Contour) -> list[float]:
    """Signed areas of the loops of an uncrossed contour, mm2, in increasing order."""
    loops = split_loops(*uncross(shape))
    return sorted(float(measure_loop_areas(loop, 1)[0]) for loop in loops)


#: Area between a chord and an arc of `RADIUS` with a sweep of 2 `ANGLE`, mm2.
LENS = RADIUS**2 * (2 * ANGLE - math.sin(2 * ANGLE)) / 2


def test_the_tip_of_a_spike_is_reversed_and_keeps_its_area() -> None:
    shape = spike()
    whole = float(measure_loop_areas(make_contour_segments([shape]), 1)[0])
    sign = math.copysign(1, whole)
    small, large = areas(shape if sign > 0 else clockwise(shape))
    assert small == pytest.approx(LENS, rel=1e-6)
    # In the drawn loop, the area of the tip is subtracted.
    assert large == pytest.approx(abs(whole) + LENS, rel=1e-9)


def test_the_tip_of_a_notch_is_removed() -> None:
    """The part lies around a hole. The tip of the hole lies in the part and bounds nothing."""
    shape = spike()
    is_outer = measure_loop_areas(make_contour_segments([shape]), 1)[0] > 0
    (area,) = areas(clockwise(shape) if is_outer else shape)
    assert area < 0


def test_both_loops_meet_at_the_crossing() -> None:
    source, following = uncross(spike())
    from_tip = np.hypot(*source.start.T)
    assert np.sort(from_tip)[:3] == pytest.approx([0.0, CROSSING, CROSSING], abs=1e-9)
    assert (np.hypot(*(source.end - source.start[following]).T) < 1e-9).all()


def test_loops_that_do_not_cross_themselves_are_not_changed() -> None:
    source, following = uncross(rectangle(0, 0, 5, 5), spike(-ANGLE))
    assert len(source) == 8
    assert following.tolist() == [1, 2, 3, 0, 5, 6, 7, 4]


def test_the_segments_stay_sorted_by_contour() -> None:
    first, last = rectangle(100, 0, 5, 5), rectangle(200, 0, 5, 5)
    source, following = uncross(first, spike(), last)
    assert np.all(np.diff(source.owner) >= 0)
    assert source.start[:4, 0].min() == 100
    assert source.start[-4:, 0].min() == 200
    rows = np.arange(len(source))
    assert following[:4].tolist() == [1, 2, 3, 0]
    assert (rows[-1] - following[-4:]).tolist() == [2, 1, 0, 3]
    assert np.array_equal(source.owner[following], source.owner)
    assert source.start[following] == pytest.approx(source.end, abs=1e-6)


@pytest.mark.parametrize("degrees", [0.001, 1.0, 10.0, 22.0, 23.0, 40.0])
def test_a_crossing_is_found_at_any_angle_of_the_tip(degrees: float) -> None:
    """The arc, with a sweep of 0.8 rad, crosses the line after twice the angle: up to 22.9 deg."""
    angle = math.radians(degrees)
    source, _ = uncross(spike(angle))
    at_crossing = np.abs(np.hypot(*source.start.T) - 2 * RADIUS * math.sin(angle)) < 1e-9
    assert at_crossing.any() == (degrees < 22.9)
