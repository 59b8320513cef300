"""Pieces of slanted motions, and the widest disc of the excess."""

import math
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
import shapely

from camgen.check.stock.moves import Moves, _divide
from camgen.check.stock.pieces import _chords
from camgen.check.stock.removal import _find_largest_disc
from camgen.geometry.segments import make_contour_segments
from camgen.model.job import ToolTable
from tests.support.drawn import circle, contour

V_TOOL = ToolTable(kind="v", diameter=6.0, tip_angle=90.0)


@pytest.mark.parametrize(("fall", "count"), [(0.0049, 1), (0.0051, 2), (0.0126, 3), (1.0, 200)])
def test_a_slanted_motion_is_divided_into_pieces_of_at_most_5_micrometres(
    fall: float, count: int
) -> None:
    start, end = np.zeros((1, 3)), np.array([[10.0, 0.0, -fall]])
    via = np.full((1, 3), np.nan)
    which, *_ = _divide(V_TOOL, start, via, end, np.zeros(1, np.int64))
    assert len(which) == count
    assert fall / len(which) <= 0.005 + 1e-12


def test_the_widest_disc_is_found_with_its_middle() -> None:
    narrow = shapely.box(0.0, 0.0, 50.0, 2.0)
    # The sides are slanted, and the disc touches them on both sides above and below its middle.
    wide = shapely.Polygon([(100.0, 200.0), (105.0, 205.0), (110.0, 200.0), (105.0, 195.0)])
    diameter, middle = _find_largest_disc(np.array([narrow, wide]))
    assert diameter == pytest.approx(10.0 / math.sqrt(2.0), abs=0.02)
    assert middle is not None
    assert math.dist(middle, (105.0, 200.0)) < 0.02


def test_a_line_is_one_chord_between_its_ends() -> None:
    plane = make_contour_segments([contour([(0, 0), (100, 0)], closed=False)])
    moves = cast("Moves", SimpleNamespace(plane=plane))
    (line,) = _chords(moves, np.array([0]))
    assert shapely.length(line) == pytest.approx(100.0)
    assert shapely.distance(line, shapely.Point(100.0, 0.0)) == pytest.approx(0.0)


def test_a_half_circle_becomes_four_equal_chords() -> None:
    moves = cast("Moves", SimpleNamespace(plane=make_contour_segments([circle(0, 0, 10)])))
    half = _chords(moves, np.array([0]))[0]
    # Each of the four chords deviates by r (1 - cos(22.5 deg)).
    farthest = 10.0 * (1.0 - math.cos(math.pi / 8))
    middles = shapely.line_interpolate_point(half, np.linspace(0.0, 1.0, 201), normalized=True)
    deviations = 10.0 - shapely.distance(middles, shapely.Point(0.0, 0.0))
    assert deviations.max() == pytest.approx(farthest, abs=1e-3)
