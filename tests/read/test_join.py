"""Ends that meet are joined, whatever the order and direction in which the pieces were drawn."""

import math
import random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from camgen.model.part import Contour, Note
from camgen.read.join import make_contours
from camgen.read.pieces import DrawnPieces, are_first
from tests.support.examples import fewer

Point = tuple[float, float]
Piece = tuple[list[Point], list[float], bool, str]


def line(a: Point, b: Point, layer: str = "0") -> Piece:
    return ([a, b], [0.0, 0.0], False, layer)


def soup(pieces: list[Piece], kind: str = "LINE") -> DrawnPieces:
    layers = tuple(sorted({p[3] for p in pieces}))
    counts = [len(p[0]) for p in pieces]
    return DrawnPieces(
        points=np.array([xy for p in pieces for xy in p[0]], dtype=float).reshape(-1, 2),
        bulges=np.array([b for p in pieces for b in p[1]], dtype=float),
        first=np.concatenate([[0], np.cumsum(counts)]).astype(np.intp),
        closed=np.array([p[2] for p in pieces], dtype=bool),
        layer=np.array([layers.index(p[3]) for p in pieces], dtype=np.intp),
        kind=np.zeros(len(pieces), dtype=np.intp),
        color=np.zeros(len(pieces), dtype=np.intp),
        layers=layers,
        kinds=(kind,),
        colors=("",),
    )


def joined(pieces: list[Piece], tolerance: float = 0.05) -> tuple[tuple[Contour, ...], list[str]]:
    made, notes = make_contours(soup(pieces), tolerance)
    return made, [str(n) for n in notes]


def ring(made: Contour) -> frozenset[frozenset[Point]]:
    """The segments of a closed contour without order and direction, rounded."""
    points = [tuple(np.round(p, 6).tolist()) for p in made.points]
    return frozenset(frozenset((points[i - 1], points[i])) for i in range(len(points)))


SQUARE = [(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)]


def sides(corners: list[Point], layer: str = "0") -> list[Piece]:
    return [line(a, b, layer) for a, b in zip(corners, corners[1:] + corners[:1], strict=True)]


def test_a_square_of_lines() -> None:
    made, notes = joined(sides(SQUARE))
    assert len(made) == 1
    assert made[0].closed
    assert made[0].id == "c1"
    assert made[0].points.tolist() == [list(p) for p in SQUARE]
    assert notes == []
    assert not made[0].points.flags.writeable


@fewer(12)
@given(st.integers(0, 10**6), st.integers(1, 4), st.integers(3, 9), st.sampled_from([0.0, 0.02]))
def test_order_and_direction_of_the_pieces_do_not_matter(
    seed: int, count: int, corners: int, jitter: float
) -> None:
    """Random star-shaped polygons, shuffled and reversed, with ends up to ``jitter`` apart."""
    rng = random.Random(seed)
    polygons, pieces = [], []
    for k in range(count):
        polygon = [
            (100.0 * k + r * math.cos(t), r * math.sin(t))
            for t, r in ((2 * math.pi * i / corners, rng.uniform(20, 40)) for i in range(corners))
        ]
        polygons.append(polygon)
        for (ax, ay), b in zip(polygon, polygon[1:] + polygon[:1], strict=True):
            moved = (ax + rng.uniform(-jitter, jitter) / 2, ay + rng.uniform(-jitter, jitter) / 2)
            pieces.append(line(moved, b) if rng.random() < 0.5 else line(b, moved))
    straight, _ = joined(pieces)
    rng.shuffle(pieces)
    made, _ = joined(pieces)
    assert len(made) == count
    assert all(c.closed and len(c.points) == corners for c in made)
    assert {ring(c) for c in made} == {ring(c) for c in straight}
    for contour in made:
        corners_of = np.array(polygons[round(float(contour.points[:, 0].mean()) / 100)])
        away = np.hypot(*(contour.points[:, None] - corners_of[None]).transpose(2, 0, 1)).min(
            axis=0
        )
        assert away.max() <= jitter + 1e-9


def test_two_lines_meet_half_way_and_the_largest_gap_is_told() -> None:
    made, notes = joined([line((0, 0), (10, 0)), line((10, 0.04), (10, 10))])
    assert made[0].points.tolist() == [[0, 0], [10, 0.02], [10, 10]]
    assert (
        "joined: gaps closed: 1, largest 0.04 mm (ends closer than input.join = 0.05 mm meet)"
        in notes
    )


def test_a_line_moves_to_the_end_of_an_arc() -> None:
    half = ([(10.0, 0.0), (10.0, 10.0)], [1.0, 0.0], False, "0")
    made, _ = joined([line((0, 0), (10, 0.03)), half])
    assert made[0].points.tolist() == [[0, 0], [10, 0], [10, 10]]
    assert made[0].bulges.tolist() == [0, 1, 0]


def test_two_arcs_stay_as_they_are_with_a_short_line_between() -> None:
    one = ([(0.0, 0.0), (10.0, 0.0)], [0.5, 0.0], False, "0")
    two = ([(10.0, 0.03), (20.0, 0.0)], [0.5, 0.0], False, "0")
    made, _ = joined([one, two])
    assert made[0].points.tolist() == [[0, 0], [10, 0], [10, 0.03], [20, 0]]
    assert made[0].bulges.tolist() == [0.5, 0, 0.5, 0]


def test_wider_gaps_stay_open() -> None:
    made, notes = joined([line((0, 0), (10, 0)), line((10, 0.06), (10, 10))])
    assert [c.closed for c in made] == [False, False]
    assert notes == [
        "warning: open contours: 2 (gap of 0.06 mm near x 10, y 0.03: input.join = 0.061 closes it)"
    ]


def test_each_gap_of_an_outline_is_told_with_what_closes_all() -> None:
    """Two pieces of a rectangle with gaps of 0.1 and 0.2 mm between them, and a line far from both."""
    pieces = [
        ([(0.0, 0.0), (100.0, 0.0), (100.0, 50.0)], [0.0] * 3, False, "0"),
        ([(100.0, 50.1), (0.0, 50.1), (0.0, 0.2)], [0.0] * 3, False, "0"),
        line((150, 20), (150, 30)),
    ]
    _, notes = joined(pieces)
    assert notes == [
        "warning: open contours: 3 (gaps of 0.1 mm near x 100, y 50.05, 0.2 mm near x 0, y 0.1: "
        "input.join = 0.201 closes them)"
    ]
    made, _ = joined(pieces, 0.201)
    assert [contour.closed for contour in made] == [True, False]


def test_ends_that_are_far_apart_are_taken_as_meant() -> None:
    _, notes = joined([line((0, 0), (10, 0)), line((20, 20), (30, 0))])
    assert notes == [
        "warning: open contours: 2 (their ends meet no free end within input.join = 0.05 mm)"
    ]


def test_a_row_of_close_points_does_not_collapse() -> None:
    """A hundred lines side by side, 0.04 apart: each end meets one neighbour, none is pulled along."""
    made, _ = joined([line((0.04 * i, 0.0), (0.04 * i, 10.0)) for i in range(100)])
    points = np.concatenate([c.points for c in made])
    assert float(np.ptp(points[:, 0])) > 3.9
    assert sum(len(c.points) for c in made) >= 100


def test_fine_lines_are_not_swallowed_by_the_tolerance() -> None:
    """Segments far shorter than the tolerance that meet exactly stay as drawn."""
    circle = [(0.1 * math.cos(t), 0.1 * math.sin(t)) for t in np.linspace(0, math.tau, 201)[:-1]]
    made, notes = joined(sides(circle))
    assert len(made) == 1
    assert made[0].closed
    assert len(made[0].points) == 200
    assert notes == []


def test_a_short_line_is_not_closed_on_itself() -> None:
    made, _ = joined([line((0, 0), (0.03, 0))])
    assert [c.closed for c in made] == [False]


def test_the_nearest_end_wins() -> None:
    made, _ = joined([line((0, 0), (10, 0)), line((10.04, 0), (20, 5)), line((10.01, 0), (20, -5))])
    assert made[0].points[-1].tolist() == [20, -5]
    assert len(made) == 2


def test_straight_on_at_a_junction() -> None:
    cross = [
        line((-5, 0), (0, 0)),
        line((0, 5), (0, 0)),
        line((0, 0), (5, 0)),
        line((0, 0), (0, -5)),
    ]
    made, _ = joined(cross)
    assert sorted(c.points.tolist() for c in made) == [
        [[-5, 0], [0, 0], [5, 0]],
        [[0, 5], [0, 0], [0, -5]],
    ]


def test_straight_on_looks_at_the_tangent_of_an_arc() -> None:
    """A quarter circle ends at the origin, running along +x; the chord would point to the other line."""
    arc = ([(-5.0, 5.0), (0.0, 0.0)], [math.tan(math.pi / 8), 0.0], False, "0")
    made, _ = joined([arc, line((0, 0), (5, -5)), line((0, 0), (5, 0))])
    assert made[0].points.tolist() == [[-5, 5], [0, 0], [5, 0]]


def test_many_ends_at_one_point_pair_with_their_opposite() -> None:
    spokes = [
        line((0, 0), (10 * math.cos(t), 10 * math.sin(t)))
        for t in np.linspace(0, math.tau, 201)[:-1]
    ]
    made, _ = joined(spokes)
    assert len(made) == 100
    for c in made:
        assert float(np.abs(c.points[0] + c.points[-1]).max()) < 1e-9


def test_the_own_layer_comes_first() -> None:
    """An engraved line starts at a corner of a cut square, in the straight continuation of one side."""
    made, _ = joined([*sides(SQUARE, "CUT"), line((10, 0), (20, 0), "ENGRAVE")])
    assert [(c.layer, c.closed) for c in made] == [("CUT", True), ("ENGRAVE", False)]


def test_a_loop_on_two_layers_is_a_loop() -> None:
    made, notes = joined([*sides(SQUARE, "A")[:2], *sides(SQUARE, "B")[2:]])
    assert [(c.layer, c.closed) for c in made] == [("A", True)]
    assert notes == [
        "joined: contours over more than one layer: 1 (each counts to the layer of its first piece)"
    ]


@given(
    st.lists(
        st.tuples(st.integers(0, 3), st.integers(0, 3), st.integers(0, 3), st.integers(0, 3)),
        max_size=30,
    )
)
def test_of_lines_drawn_more_than_once_the_first_is_used(
    drawn: list[tuple[int, int, int, int]],
) -> None:
    ends = [frozenset([(a, b), (c, d)]) for a, b, c, d in drawn]
    lines = [line((float(a), float(b)), (float(c), float(d))) for a, b, c, d in drawn]
    kept = are_first(soup(lines), np.zeros(len(lines), np.intp))
    assert kept.tolist() == [one not in ends[:k] for k, one in enumerate(ends)]


def test_twice_drawn_lines_are_used_once_also_backwards_and_on_another_layer() -> None:
    made, notes = joined([*sides(SQUARE), line((10, 0), (0, 0)), line((10, 10), (10, 0), "B")])
    assert len(made) == 1
    assert made[0].closed
    assert notes == ["repaired: dropped: 2 LINE on layers 0, B (drawn twice; each is used once)"]


@pytest.mark.parametrize("turn", range(4))
@pytest.mark.parametrize("back", [False, True])
def test_a_closed_piece_is_known_again_from_any_start(turn: int, back: bool) -> None:
    points, bulges = [(0.0, 0.0), (9.0, 0.0), (9.0, 5.0), (2.0, 6.0)], [0.1, 0.2, 0.0, -0.4]
    points_again, bulges_again = points[turn:] + points[:turn], bulges[turn:] + bulges[:turn]
    if back:
        # Run backwards, the segment that leaves point i is the one that led to it, curved the other way.
        bulges_again = [-b for b in bulges_again[-2::-1] + bulges_again[-1:]]
        points_again = points_again[::-1]
    made, _ = joined([(points, bulges, True, "0"), (points_again, bulges_again, True, "0")])
    assert len(made) == 1


def test_pieces_that_differ_in_a_bulge_are_both_used() -> None:
    made, _ = joined(
        [(list(SQUARE), [0.0] * 4, True, "0"), (list(SQUARE), [0.0, 0.0, 0.1, 0.0], True, "0")]
    )
    assert len(made) == 2


def test_an_outline_as_polyline_and_as_lines_is_one_outline() -> None:
    made, notes = joined([(list(SQUARE), [0.0] * 4, True, "0"), *sides(SQUARE)])
    assert len(made) == 1
    assert any("drawn twice" in n for n in notes)


def test_circles_are_known_again_however_they_are_cut() -> None:
    up = ([(0.0, -5.0), (0.0, 5.0)], [1.0, 1.0], True, "0")
    along = ([(5.0, 0.0), (-5.0, 0.0)], [-1.0, -1.0], True, "0")
    made, _ = joined([up, along])
    assert len(made) == 1


def test_an_arc_beyond_a_half_circle_is_halved() -> None:
    """Bulge tan(270 / 4): three quarters of the circle about (5, 5) from (5, 0) to (0, 5)."""
    made, _ = joined([([(5.0, 0.0), (0.0, 5.0)], [math.tan(math.radians(67.5)), 0.0], False, "0")])
    points, bulges = made[0].points, made[0].bulges
    assert len(points) == 3
    assert np.abs(bulges).max() <= 1
    assert np.hypot(*(points - 5).T) == pytest.approx([5, 5, 5])
    assert points[1] == pytest.approx([5 + 5 / math.sqrt(2), 5 + 5 / math.sqrt(2)])


def test_repeated_points_and_damage() -> None:
    pieces: list[Piece] = [
        (
            [(0.0, 0.0), (0.0, 0.0), (5.0, 0.0), (5.0, 0.0), (5.0, 5.0)],
            [0.0, 0.5, 0.0, 0.2, 0.0],
            False,
            "0",
        ),
        line((1, 1), (1, 1)),
        line((math.nan, 0), (1, 1)),
        line((0, math.inf), (1, 1)),
        line((1e300, 0), (1, 1)),
        ([(2.0, 2.0), (3.0, 3.0)], [math.nan, 0.0], False, "0"),
    ]
    made, notes = joined(pieces)
    assert [c.points.tolist() for c in made] == [[[0, 0], [5, 0], [5, 5]]]
    assert made[0].bulges.tolist() == [0.5, 0.2, 0]
    assert notes[0].startswith("skipped: damaged: 4 LINE on layer 0")
    assert notes[1] == "repaired: dropped: 1 LINE on layer 0 (without length)"


def test_far_from_the_origin() -> None:
    made, _ = joined(sides([(x + 1e9, y - 1e9) for x, y in SQUARE]))
    assert made[0].closed
    assert made[0].points[0].tolist() == [1e9, -1e9]


def test_nothing() -> None:
    assert joined([]) == ((), [])


def test_notes_stay_on_one_line() -> None:
    _, notes = make_contours(soup([line((1, 1), (1, 1), "a\nb)")]), 0.05)
    assert notes == (Note("repaired", "dropped: 1 LINE on layer a_b_", "without length"),)
