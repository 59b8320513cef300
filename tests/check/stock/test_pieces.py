"""Pieces of slanted motions, and the widest disc of the excess."""

import math

import numpy as np
import pytest
import shapely

from camgen.check.stock.moves import _pieces
from camgen.check.stock.removal import _widest
from camgen.model.job import ToolTable

V_TOOL = ToolTable(kind="v", diameter=6.0, tip_angle=90.0)


@pytest.mark.parametrize(("fall", "count"), [(0.0049, 1), (0.0051, 2), (0.0126, 3), (1.0, 200)])
def test_a_piece_of_a_slanted_motion_goes_down_by_no_more_than_five_micrometres(
    fall: float, count: int
) -> None:
    start, end = np.zeros((1, 3)), np.array([[10.0, 0.0, -fall]])
    via = np.full((1, 3), np.nan)
    which, *_ = _pieces(V_TOOL, start, via, end, np.zeros(1, np.int64))
    assert len(which) == count
    assert fall / len(which) <= 0.005 + 1e-12


def test_the_widest_disc_has_its_middle() -> None:
    narrow = shapely.box(0.0, 0.0, 50.0, 2.0)
    # Its sides slant, so that the disc touches them beside and above its middle.
    wide = shapely.Polygon([(100.0, 200.0), (105.0, 205.0), (110.0, 200.0), (105.0, 195.0)])
    diameter, middle = _widest(np.array([narrow, wide]))
    assert diameter == pytest.approx(10.0 / math.sqrt(2.0), abs=0.02)
    assert middle is not None
    assert math.dist(middle, (105.0, 200.0)) < 0.02
