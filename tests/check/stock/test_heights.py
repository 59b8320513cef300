"""The grid of heights, compared with the depth of each motion in each cell."""

from __future__ import annotations

import numpy as np

from camgen.check.stock.heights import _keep_deepest, _lower


def test_a_tool_partly_outside_the_grid_cuts_only_the_cells_that_it_meets() -> None:
    shape = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
    for line in range(-3, 6):
        for column in range(-4, 7):
            depth = np.full((4, 5), 2.5)
            _lower(depth, line, column, shape)
            expected = np.full((4, 5), 2.5)
            for (row, offset), tool_depth in np.ndenumerate(shape):
                if 0 <= line + row < 4 and 0 <= column + offset < 5:
                    expected[line + row, column + offset] = max(2.5, tool_depth)
            assert depth.tolist() == expected.tolist(), (line, column)


def test_the_deepest_of_several_passes_over_a_position_is_kept() -> None:
    points = np.array([(1.0, 0.0), (0.0, 1.0), (1.0, 0.0), (0.0, 0.0), (1.0, 0.0)])
    places, deepest = _keep_deepest(points, np.array([3.0, 1.0, 5.0, 2.0, 4.0]))
    assert places.tolist() == [[0, 0], [0, 1], [1, 0]]
    assert deepest.tolist() == [2, 1, 5]
    assert [len(rows) for rows in _keep_deepest(points[:0], np.zeros(0))] == [0, 0]
