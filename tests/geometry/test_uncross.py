"""Loops that cross themselves by a slip: parted at the crossing, the part on their left."""

import math

import numpy as np
import pytest

from camgen.geometry.nesting import measure_loop_areas
from camgen.geometry.segments import Segments, find_following, make_contour_segments
from camgen.geometry.uncross import find_slips, uncross_loops
from camgen.model.part import Contour
from tests.support.drawn import clockwise, contour, rectangle

#: A line to the origin and an arc that comes back 0.5 deg beside it: they cross again 2 R sin(0.5 deg) from the tip.
RADIUS, OFF = 20.0, math.radians(0.5)
AGAIN = 2 * RADIUS * math.sin(OFF)


def spike(off: float = OFF) -> Contour:
    """A line along y = 0 to the tip at the origin, back on an arc that begins ``off`` beside it and bends across it."""
    heading, half = math.pi + off, 0.4
    end = (
        2 * RADIUS * math.sin(half) * np.array([math.cos(heading - half), math.sin(heading - half)])
    )
    return contour([(-30, 0), (0, 0), tuple(end), (-30, 20)], [0, -math.tan(half / 2), 0, 0])


def parted(*contours: Contour) -> tuple[Segments, np.ndarray]:
    source = make_contour_segments(contours)
    following = find_following(source, np.ones(len(contours), dtype=bool))
    return uncross_loops(source, following, find_slips(source, following, len(contours)))


def loops(source: Segments, following: np.ndarray) -> list[Segments]:
    found, seen = [], set()
    for begin in range(len(source)):
        here, own = begin, []
        while here not in seen:
            seen.add(here)
            own.append(here)
            here = int(following[here])
        if own:
            table = source.take(np.array(own))
            found.append(
                Segments(
                    *(getattr(table, n) for n in table.__struct_fields__[:-1]),
                    np.zeros_like(table.owner),
                )
            )
    return found


def areas(contour_: Contour) -> list[float]:
    return sorted(float(measure_loop_areas(loop, 1)[0]) for loop in loops(*parted(contour_)))


#: Between a chord and an arc of RADIUS that turns by 2 OFF.
LENS = RADIUS**2 * (2 * OFF - math.sin(2 * OFF)) / 2


def test_the_tip_of_a_spike_is_turned_round_and_keeps_its_area() -> None:
    shape = spike()
    whole = float(measure_loop_areas(make_contour_segments([shape]), 1)[0])
    sign = math.copysign(1, whole)
    small, large = areas(shape if sign > 0 else clockwise(shape))
    assert small == pytest.approx(LENS, rel=1e-6)
    # The drawn loop counts the tip against the rest.
    assert large == pytest.approx(abs(whole) + LENS, rel=1e-9)


def test_the_tip_of_a_notch_is_no_border() -> None:
    """Run the other way the part is around: the tip lies in it, and no tool gets there."""
    shape = spike()
    hole = (
        clockwise(shape) if measure_loop_areas(make_contour_segments([shape]), 1)[0] > 0 else shape
    )
    (only,) = areas(hole)
    assert only < 0


def test_both_loops_meet_where_they_crossed() -> None:
    source, following = parted(spike())
    near = np.hypot(*source.start.T)
    assert np.sort(near)[:3] == pytest.approx([0.0, AGAIN, AGAIN], abs=1e-9)
    assert (np.hypot(*(source.end - source.start[following]).T) < 1e-9).all()


def test_what_does_not_cross_itself_stays_as_it_is() -> None:
    away = spike(-OFF)
    source, following = parted(rectangle(0, 0, 5, 5), away)
    assert len(source) == 8
    assert following.tolist() == [1, 2, 3, 0, 5, 6, 7, 4]


def test_other_contours_keep_their_rows() -> None:
    first, last = rectangle(100, 0, 5, 5), rectangle(200, 0, 5, 5)
    source, following = parted(first, spike(), last)
    assert source.start[:8, 0].min() == 100
    assert following[:8].tolist() == [1, 2, 3, 0, 5, 6, 7, 4]
    assert sorted(set(source.owner[8:].tolist())) == [1]


@pytest.mark.parametrize("degrees", [0.001, 1.0, 10.0, 22.0, 23.0, 40.0])
def test_a_slip_is_found_however_wide_the_corner(degrees: float) -> None:
    """The arc turns by 0.8 rad and is back on the line after 2 off: at 22.9 deg it ends there."""
    off = math.radians(degrees)
    source, _ = parted(spike(off))
    again = np.abs(np.hypot(*source.start.T) - 2 * RADIUS * math.sin(off)) < 1e-9
    assert again.any() == (degrees < 22.9)
