"""Parts of segments that lie on others are found, as calculated by hand and by shapely."""

import math
from itertools import chain, pairwise

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from camgen.geometry.overlap import cut_chain, find_covered, find_equal_loops, measure_covered
from camgen.geometry.segments import Segments, make_segments

QUARTER = math.tan(math.pi / 8)
Row = tuple[float, ...]


def segments(rows: list[Row], owners: list[int] | None = None) -> Segments:
    """Segments of rows x, y, x, y and perhaps a bulge. Without owners, each is a piece."""
    table = np.array([(*row, 0.0)[:5] for row in rows])
    owner = np.arange(len(rows)) if owners is None else np.array(owners)
    return make_segments(table[:, :2], table[:, 2:4], table[:, 4], owner)


def covered(rows: list[Row], owners: list[int] | None = None) -> dict[int, list[list[float]]]:
    table = segments(rows, owners)
    label = np.zeros(len(rows), np.int64)
    parts_of = find_covered(table, table.owner + 1, label, 0.05)
    return {row: np.round(parts, 6).tolist() for row, parts in parts_of.items()}


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        ([(0, 0, 30, 0), (20, 0, 50, 0)], {1: [[0, 0.333333]]}),
        ([(0, 0, 30, 0), (50, 0, 20, 0)], {1: [[0.666667, 1]]}),
        ([(0, 0, 10, 0), (20, 0, 30, 0), (0, 0, 40, 0)], {2: [[0, 0.25], [0.5, 0.75]]}),
        ([(0, 0, 40, 0), (10, 0, 20, 0)], {1: [[0, 1]]}),
        # Overlaps of less than the tolerance, ends that touch, and dashes stay.
        ([(0, 0, 30, 0), (29.97, 0, 50, 0)], {}),
        ([(0, 0, 30, 0), (30, 0, 50, 0)], {}),
        ([(0, 0, 3, 0), (4, 0, 7, 0), (8, 0, 11, 0)], {}),
        # Within the tolerance, beyond it, and at an angle.
        ([(0, 0, 30, 0), (0, 0.04, 30, 0.04)], {1: [[0, 1]]}),
        ([(0, 0, 30, 0), (0, 0.06, 30, 0.06)], {}),
        ([(0, 0, 30, 0), (0, 0, 30, 0.3)], {}),
        # A short line may deviate less than a long one, by 2 % of its length.
        ([(0, 0, 0.5, 0), (0, 0.04, 0.5, 0.04)], {}),
        # An arc over a line.
        ([(0, 0, 30, 0), (0, 0, 30, 0, 0.02)], {}),
        # Lines far from the origin, at an angle without exact numbers.
        (
            [(1e5, 1e5, 1e5 + 70, 1e5 + 30), (1e5 + 35, 1e5 + 15, 1e5 + 140, 1e5 + 60)],
            {1: [[0, 0.333333]]},
        ),
        # A quarter circle on a half circle, also over the direction 0, and on a concentric one.
        ([(5, 0, -5, 0, 1.0), (0, 5, -5, 0, QUARTER)], {1: [[0, 1]]}),
        ([(0, -5, 0, 5, 1.0), (5, 0, 0, 5, QUARTER)], {1: [[0, 1]]}),
        ([(0, -5, 0, 5, 1.0), (5, 0, -5, 0, 1.0)], {1: [[0, 0.5]]}),
        ([(0, 5, 0, -5, -1.0), (5, 0, -5, 0, 1.0)], {1: [[0, 0.5]]}),
        ([(5, 0, -5, 0, 1.0), (5.1, 0, -5.1, 0, 1.0)], {}),
        ([(5, 0, -5, 0, 1.0), (5.3, 0, -4.7, 0, 1.0)], {}),
    ],
)
def test_the_parts_that_other_segments_cover_are_found(
    rows: list[Row], expected: dict[int, list[list[float]]]
) -> None:
    assert covered(rows) == expected


def test_a_piece_does_not_cover_itself() -> None:
    assert covered([(0, 0, 30, 0), (30, 0, 10, 0)], [0, 0]) == {}


def test_segments_of_the_lowest_rank_and_of_other_labels_are_not_covered() -> None:
    table = segments([(0, 0, 30, 0), (0, 0, 30, 0)])
    label = np.zeros(2, np.int64)
    assert find_covered(table, np.zeros(2, np.int64), label, 0.05) == {}
    assert find_covered(table, np.array([1, 0]), label, 0.05) == {0: [(0.0, 1.0)]}
    assert find_covered(table, np.array([0, 1]), np.array([0, 1]), 0.05) == {}


def test_lines_of_a_close_pattern_do_not_cover_each_other() -> None:
    """Each line is within the tolerance of the next one. A repeated pattern is covered."""
    rows: list[Row] = [(0.0, 0.04 * k, 10.0, 0.04 * k) for k in range(100)]
    assert covered(rows) == {}
    assert covered([*rows, *rows]) == {k: [[0, 1]] for k in range(100, 200)}


@given(st.lists(st.tuples(st.integers(0, 20), st.integers(0, 20), st.integers(0, 2)), max_size=25))
def test_the_parts_that_are_not_covered_are_as_long_as_the_union(
    lines: list[tuple[int, int, int]],
) -> None:
    """The lines lie on three parallel slanted lines."""
    rows = [(4.0 * a, 3.0 * a + s, 4.0 * b, 3.0 * b + s) for a, b, s in lines if a != b]
    if not rows:
        return
    table = segments(rows)
    label = np.zeros(len(rows), np.int64)
    parts = find_covered(table, table.owner + 1, label, 0.05)
    rest = float(table.length.sum()) - measure_covered(table, parts)
    # Each line is 5 mm per step, so the union is counted in steps.
    steps: set[tuple[int, int]] = set()
    for a, b, s in lines:
        steps.update((s, k) for k in range(min(a, b), max(a, b)))
    assert rest == pytest.approx(5 * len(steps), abs=1e-6)


def test_cut_chains_keep_their_arcs_and_their_ends() -> None:
    points = np.array([(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)])
    bulges = np.array([0.0, 1.0, 0.0, 0.0])
    (points_1, bulges_1), (points_2, bulges_2) = cut_chain(
        points, bulges, True, {0: [(0.2, 0.4)], 1: [(0.5, 1.0)]}
    )
    assert points_1.tolist() == [[4, 0], [10, 0], [15, 5]]
    assert bulges_1.tolist() == [0, pytest.approx(QUARTER), 0]
    assert points_2.tolist() == [[10, 10], [0, 10], [0, 0], [2, 0]]
    assert bulges_2.tolist() == [0, 0, 0, 0]
    assert cut_chain(points[:2], bulges[:2], False, {0: [(0.0, 1.0)]}) == []


def ring(points: list[tuple[float, float]]) -> list[Row]:
    return [(*a, *b) for a, b in pairwise([*points, points[0]])]


def test_loops_of_the_same_shape_are_equal() -> None:
    square = ring([(0, 0), (40, 0), (40, 40), (0, 40)])
    halves = ring([(40, 20), (40, 40), (20, 40), (0, 40), (0, 0), (20, 0), (40, 0)])
    chamfered = ring([(0, 0), (40, 0), (40, 39), (39, 40), (0, 40)])
    circle: list[Row] = [(25, 20, 15, 20, 1.0), (15, 20, 25, 20, 1.0)]
    turn = [(20 + 5 * math.cos(a), 20 + 5 * math.sin(a)) for a in (1.0, 2.5708, 4.1416, 5.7124)]
    arcs: list[Row] = [(*a, *b, QUARTER) for a, b in pairwise([*turn, turn[0]])]
    loops = [square, circle, halves, arcs, chamfered]
    owners = np.repeat(np.arange(5), [len(loop) for loop in loops]).tolist()
    table = segments(list(chain.from_iterable(loops)), owners)
    assert find_equal_loops(table, 5, np.zeros(5, np.int64), 0.05) == [2, 3]
    assert find_equal_loops(table, 5, np.arange(5), 0.05) == []


def test_the_length_of_the_union_is_that_of_shapely() -> None:
    """A hundred random lines lie on ten lines of random directions."""
    rng = np.random.default_rng(5)
    angle, offset = rng.uniform(0, math.pi, 10), rng.uniform(-50, 50, 10)
    rows = []
    for k in range(100):
        direction = np.array([math.cos(angle[k % 10]), math.sin(angle[k % 10])])
        base = offset[k % 10] * np.array([-direction[1], direction[0]])
        low, high = np.sort(rng.uniform(-80, 80, 2))
        rows.append((*(base + low * direction), *(base + high * direction)))
    table = segments(rows)
    parts = find_covered(table, table.owner + 1, np.zeros(100, np.int64), 0.01)
    rest = float(table.length.sum()) - measure_covered(table, parts)
    lines = [shapely.LineString([row[:2], row[2:4]]) for row in rows]
    union = 0.0
    for k in range(10):
        # The lines of one direction are rotated into the x axis, where they are intervals.
        rotated = [shapely.affinity.rotate(line, -angle[k], (0, 0), True) for line in lines[k::10]]
        intervals = [shapely.box(line.bounds[0], 0, line.bounds[2], 1) for line in rotated]
        union += shapely.union_all(intervals).area
    assert rest == pytest.approx(union, abs=0.01 * 100)
