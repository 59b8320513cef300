"""Loops are nested by their depth, and loops that cross are named."""

import numpy as np

from camgen.geometry.nesting import find_nesting
from camgen.geometry.segments import make_contour_segments
from camgen.model.part import Contour
from tests.support.drawn import circle, clockwise, contour, rectangle


def nested(*loops: Contour) -> tuple[list[int], list[int], list[int]]:
    result = find_nesting(make_contour_segments(loops), len(loops))
    return result.depth.tolist(), result.parent.tolist(), result.crossed.tolist()


def test_an_island_in_a_hole_of_a_plate_has_depth_2() -> None:
    depth, parent, crossed = nested(
        circle(50, 50, 5), rectangle(0, 0, 100, 100), circle(50, 50, 20)
    )
    assert depth == [2, 0, 1]
    assert parent == [2, -1, 1]
    assert crossed == [-1, -1, -1]


def test_the_drawn_direction_does_not_matter() -> None:
    assert nested(clockwise(rectangle(0, 0, 9, 9)), circle(4, 4, 2)) == nested(
        rectangle(0, 0, 9, 9), circle(4, 4, 2)
    )


def test_loops_that_cross_are_named() -> None:
    _, _, crossed = nested(rectangle(0, 0, 10, 10), rectangle(5, 5, 10, 10), circle(50, 0, 3))
    assert crossed == [1, 0, -1]


def test_a_bow_tie_crosses_itself() -> None:
    _, _, crossed = nested(contour([(0, 0), (10, 10), (10, 0), (0, 10)]))
    assert crossed == [0]


def test_loops_that_touch_do_not_cross() -> None:
    depth, parent, crossed = nested(
        rectangle(0, 0, 10, 10), rectangle(10, 0, 10, 10), rectangle(0, 0, 30, 30)
    )
    assert crossed == [-1, -1, -1]
    assert depth == [1, 1, 0]
    assert parent == [2, 2, -1]


def test_a_loop_of_a_line_back_and_forth_is_empty() -> None:
    result = find_nesting(make_contour_segments([contour([(0, 0), (10, 0)]), circle(0, 0, 1)]), 2)
    assert result.empty.tolist() == [True, False]


def test_the_area_is_exact_for_polygons_and_close_for_circles() -> None:
    result = find_nesting(
        make_contour_segments([rectangle(1, 2, 10, 5), clockwise(circle(0, 0, 10))]), 2
    )
    assert result.area[0] == 50.0
    assert abs(result.area[1] + np.pi * 100) < 0.02 * 2 * np.pi * 10


def test_a_loop_that_reaches_a_hair_into_its_neighbour_is_beside_it() -> None:
    """Both have an edge on one line, drawn with the rounding of its file."""
    wide, tall = rectangle(0, 0, 40, 100), rectangle(40 - 1e-5, 0, 40, 80)
    first = contour([(40 - 1e-5, 40), (40 - 1e-5, 0), (80, 0), (80, 80), (40 - 1e-5, 80)])
    for loop in (tall, first):
        assert nested(wide, loop) == ([0, 0], [-1, -1], [-1, -1])
        assert nested(loop, wide) == ([0, 0], [-1, -1], [-1, -1])


def test_chords_do_not_move_a_small_loop_into_the_notch_beside_it() -> None:
    """The gap of 0.01 mm is half of what chords may deviate from arcs of large loops."""
    corners = [(0.31, 0), (-0.31, 0), (-1, 0), (-1, -1), (1, -1), (1, 0)]
    notched = contour(corners, [-1, 0, 0, 0, 0, 0])
    bulb = contour([(-0.3, 0), (0.3, 0), (0, 0.5)], [1, 0, 0])
    assert nested(notched, bulb) == ([0, 0], [-1, -1], [-1, -1])


def test_a_loop_that_touches_another_from_within_is_inside() -> None:
    """The chords of an arc do not meet the edge that the middle of the arc touches."""
    for radius in np.linspace(1.0, 3.0, 21).tolist():
        outline, hole = rectangle(0, 0, 40, 30), circle(20, 30 - radius, radius)
        assert nested(outline, hole) == ([0, 1], [-1, 0], [-1, -1])
