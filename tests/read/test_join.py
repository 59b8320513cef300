"""Pieces whose ends meet are joined, in whatever order and direction they were drawn."""

import math
import random
from itertools import chain

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


def collect(pieces: list[Piece], kind: str = "LINE") -> DrawnPieces:
    """The pieces in the table from which contours are made."""
    layers = tuple(sorted({layer for *_, layer in pieces}))
    counts = [len(points) for points, *_ in pieces]
    return DrawnPieces(
        points=np.array(list(chain(*(points for points, *_ in pieces))), float).reshape(-1, 2),
        bulges=np.array(list(chain(*(bulges for _, bulges, *_ in pieces))), float),
        first=np.concatenate([[0], np.cumsum(counts)]).astype(np.intp),
        closed=np.array([closed for _, _, closed, _ in pieces], dtype=bool),
        layer=np.array([layers.index(layer) for *_, layer in pieces], dtype=np.intp),
        kind=np.zeros(len(pieces), dtype=np.intp),
        color=np.zeros(len(pieces), dtype=np.intp),
        layers=layers,
        kinds=(kind,),
        colors=("",),
    )


def join(pieces: list[Piece], tolerance: float = 0.05) -> tuple[tuple[Contour, ...], list[str]]:
    """The contours, and the texts of the notes, of pieces that meet within `tolerance` (mm)."""
    contours, notes = make_contours(collect(pieces), tolerance)
    return contours, [str(note) for note in notes]


def list_segments(contour: Contour) -> frozenset[frozenset[Point]]:
    """The segments of a closed contour without order and direction, rounded to 1e-6 mm."""
    points = [tuple(np.round(point, 6).tolist()) for point in contour.points]
    return frozenset(frozenset((points[i - 1], points[i])) for i in range(len(points)))


SQUARE = [(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)]


def sides(corners: list[Point], layer: str = "0") -> list[Piece]:
    return [line(a, b, layer) for a, b in zip(corners, corners[1:] + corners[:1], strict=True)]


def test_four_lines_make_a_closed_square() -> None:
    contours, notes = join(sides(SQUARE))
    assert len(contours) == 1
    assert contours[0].closed
    assert contours[0].id == "c1"
    assert contours[0].points.tolist() == [list(p) for p in SQUARE]
    assert notes == []
    assert not contours[0].points.flags.writeable


@fewer(12)
@given(st.integers(0, 10**6), st.integers(1, 4), st.integers(3, 9), st.sampled_from([0.0, 0.02]))
def test_order_and_direction_of_the_pieces_do_not_matter(
    seed: int, count: int, corners: int, jitter: float
) -> None:
    """Random star-shaped polygons, shuffled and reversed, whose ends miss by up to `jitter` mm."""
    rng = random.Random(seed)
    polygons, pieces = [], []
    for k in range(count):
        polygon = []
        for i in range(corners):
            angle, radius = 2 * math.pi * i / corners, rng.uniform(20, 40)
            polygon.append((100.0 * k + radius * math.cos(angle), radius * math.sin(angle)))
        polygons.append(polygon)
        for (ax, ay), b in zip(polygon, polygon[1:] + polygon[:1], strict=True):
            moved = (ax + rng.uniform(-jitter, jitter) / 2, ay + rng.uniform(-jitter, jitter) / 2)
            pieces.append(line(moved, b) if rng.random() < 0.5 else line(b, moved))
    in_order, _ = join(pieces)
    rng.shuffle(pieces)
    contours, _ = join(pieces)
    assert len(contours) == count
    assert all(c.closed and len(c.points) == corners for c in contours)
    assert {list_segments(c) for c in contours} == {list_segments(c) for c in in_order}
    for contour in contours:
        drawn = np.array(polygons[round(float(contour.points[:, 0].mean()) / 100)])
        offsets = contour.points[:, None] - drawn[None]
        distances = np.hypot(*offsets.transpose(2, 0, 1)).min(axis=0)
        assert distances.max() <= jitter + 1e-9


def test_two_lines_meet_half_way_and_the_largest_gap_is_noted() -> None:
    contours, notes = join([line((0, 0), (10, 0)), line((10, 0.04), (10, 10))])
    assert contours[0].points.tolist() == [[0, 0], [10, 0.02], [10, 10]]
    assert (
        "joined: gaps closed: 1, largest 0.04 mm (ends closer than input.join = 0.05 mm meet)"
        in notes
    )


def test_a_line_moves_to_the_end_of_an_arc() -> None:
    half_circle = ([(10.0, 0.0), (10.0, 10.0)], [1.0, 0.0], False, "0")
    contours, _ = join([line((0, 0), (10, 0.03)), half_circle])
    assert contours[0].points.tolist() == [[0, 0], [10, 0], [10, 10]]
    assert contours[0].bulges.tolist() == [0, 1, 0]


def test_two_arcs_keep_their_ends_and_get_a_short_line_between_them() -> None:
    first = ([(0.0, 0.0), (10.0, 0.0)], [0.5, 0.0], False, "0")
    second = ([(10.0, 0.03), (20.0, 0.0)], [0.5, 0.0], False, "0")
    contours, _ = join([first, second])
    assert contours[0].points.tolist() == [[0, 0], [10, 0], [10, 0.03], [20, 0]]
    assert contours[0].bulges.tolist() == [0.5, 0, 0.5, 0]


def test_a_gap_wider_than_the_tolerance_stays_open() -> None:
    contours, notes = join([line((0, 0), (10, 0)), line((10, 0.06), (10, 10))])
    assert [c.closed for c in contours] == [False, False]
    assert notes == [
        "warning: open contours: 2 (gap of 0.06 mm near x 10, y 0.03: input.join = 0.061 closes it)"
    ]


def test_each_gap_of_an_outline_is_noted_with_the_tolerance_that_closes_all() -> None:
    """Two pieces of a rectangle leave gaps of 0.1 and 0.2 mm. A line lies far from both."""
    pieces = [
        ([(0.0, 0.0), (100.0, 0.0), (100.0, 50.0)], [0.0] * 3, False, "0"),
        ([(100.0, 50.1), (0.0, 50.1), (0.0, 0.2)], [0.0] * 3, False, "0"),
        line((150, 20), (150, 30)),
    ]
    _, notes = join(pieces)
    assert notes == [
        "warning: open contours: 3 (gaps of 0.1 mm near x 100, y 50.05, 0.2 mm near x 0, y 0.1: "
        "input.join = 0.201 closes them)"
    ]
    contours, _ = join(pieces, 0.201)
    assert [contour.closed for contour in contours] == [True, False]


def test_ends_that_are_far_apart_are_not_reported_as_gaps() -> None:
    _, notes = join([line((0, 0), (10, 0)), line((20, 20), (30, 0))])
    assert notes == [
        "warning: open contours: 2 (their ends meet no free end within input.join = 0.05 mm)"
    ]


def test_a_row_of_close_points_does_not_collapse() -> None:
    """A hundred parallel lines, 0.04 mm apart: an end meets one neighbour and pulls no other."""
    contours, _ = join([line((0.04 * i, 0.0), (0.04 * i, 10.0)) for i in range(100)])
    points = np.concatenate([contour.points for contour in contours])
    assert float(np.ptp(points[:, 0])) > 3.9
    assert sum(len(c.points) for c in contours) >= 100


def test_segments_far_shorter_than_the_tolerance_stay_as_drawn() -> None:
    """Their ends meet exactly, so none of them counts as a gap."""
    circle = [(0.1 * math.cos(t), 0.1 * math.sin(t)) for t in np.linspace(0, math.tau, 201)[:-1]]
    contours, notes = join(sides(circle))
    assert len(contours) == 1
    assert contours[0].closed
    assert len(contours[0].points) == 200
    assert notes == []


def test_a_short_line_is_not_closed_on_itself() -> None:
    contours, _ = join([line((0, 0), (0.03, 0))])
    assert [c.closed for c in contours] == [False]


def test_an_end_is_joined_to_the_nearest_end() -> None:
    contours, _ = join(
        [line((0, 0), (10, 0)), line((10.04, 0), (20, 5)), line((10.01, 0), (20, -5))]
    )
    assert contours[0].points[-1].tolist() == [20, -5]
    assert len(contours) == 2


def test_a_contour_continues_straight_at_a_junction() -> None:
    cross = [
        line((-5, 0), (0, 0)),
        line((0, 5), (0, 0)),
        line((0, 0), (5, 0)),
        line((0, 0), (0, -5)),
    ]
    contours, _ = join(cross)
    assert sorted(c.points.tolist() for c in contours) == [
        [[-5, 0], [0, 0], [5, 0]],
        [[0, 5], [0, 0], [0, -5]],
    ]


def test_an_arc_continues_along_its_tangent_and_not_along_its_chord() -> None:
    """A quarter circle ends at the origin in direction +x. Its chord points along the line down."""
    arc = ([(-5.0, 5.0), (0.0, 0.0)], [math.tan(math.pi / 8), 0.0], False, "0")
    contours, _ = join([arc, line((0, 0), (5, -5)), line((0, 0), (5, 0))])
    assert contours[0].points.tolist() == [[-5, 5], [0, 0], [5, 0]]


def test_each_of_many_ends_at_one_point_is_joined_to_the_opposite_one() -> None:
    spokes = [
        line((0, 0), (10 * math.cos(t), 10 * math.sin(t)))
        for t in np.linspace(0, math.tau, 201)[:-1]
    ]
    contours, _ = join(spokes)
    assert len(contours) == 100
    for c in contours:
        assert float(np.abs(c.points[0] + c.points[-1]).max()) < 1e-9


def test_an_end_is_joined_to_an_end_of_its_layer_first() -> None:
    """An engraved line starts at a corner of a cut square and continues one side straight."""
    contours, _ = join([*sides(SQUARE, "CUT"), line((10, 0), (20, 0), "ENGRAVE")])
    assert [(c.layer, c.closed) for c in contours] == [("CUT", True), ("ENGRAVE", False)]


def test_pieces_on_two_layers_make_one_closed_contour() -> None:
    contours, notes = join([*sides(SQUARE, "A")[:2], *sides(SQUARE, "B")[2:]])
    assert [(c.layer, c.closed) for c in contours] == [("A", True)]
    assert notes == [
        "joined: contours over more than one layer: 1 (each counts to the layer of its first piece)"
    ]


@given(
    st.lists(
        st.tuples(st.integers(0, 3), st.integers(0, 3), st.integers(0, 3), st.integers(0, 3)),
        max_size=30,
    )
)
def test_the_first_of_lines_that_are_drawn_more_than_once_is_used(
    drawn: list[tuple[int, int, int, int]],
) -> None:
    ends = [frozenset([(a, b), (c, d)]) for a, b, c, d in drawn]
    lines = [line((float(a), float(b)), (float(c), float(d))) for a, b, c, d in drawn]
    is_first = are_first(collect(lines), np.zeros(len(lines), np.intp))
    assert is_first.tolist() == [pair not in ends[:k] for k, pair in enumerate(ends)]


def test_a_line_drawn_again_backwards_or_on_another_layer_is_used_once() -> None:
    contours, notes = join([*sides(SQUARE), line((10, 0), (0, 0)), line((10, 10), (10, 0), "B")])
    assert len(contours) == 1
    assert contours[0].closed
    assert notes == ["repaired: dropped: 2 LINE on layers 0, B (drawn twice; each is used once)"]


@pytest.mark.parametrize("start", range(4))
@pytest.mark.parametrize("reverse", [False, True])
def test_a_closed_piece_is_recognised_from_any_start_and_in_both_directions(
    start: int, reverse: bool
) -> None:
    points, bulges = [(0.0, 0.0), (9.0, 0.0), (9.0, 5.0), (2.0, 6.0)], [0.1, 0.2, 0.0, -0.4]
    other_points, other_bulges = points[start:] + points[:start], bulges[start:] + bulges[:start]
    if reverse:
        # Backwards, a segment leaves the point that it led to, and its bulge is negated.
        other_bulges = [-b for b in other_bulges[-2::-1] + other_bulges[-1:]]
        other_points = other_points[::-1]
    contours, _ = join([(points, bulges, True, "0"), (other_points, other_bulges, True, "0")])
    assert len(contours) == 1


def test_pieces_that_differ_in_a_bulge_are_both_used() -> None:
    contours, _ = join(
        [(list(SQUARE), [0.0] * 4, True, "0"), (list(SQUARE), [0.0, 0.0, 0.1, 0.0], True, "0")]
    )
    assert len(contours) == 2


def test_an_outline_drawn_as_polyline_and_as_lines_is_used_once() -> None:
    contours, notes = join([(list(SQUARE), [0.0] * 4, True, "0"), *sides(SQUARE)])
    assert len(contours) == 1
    assert any("drawn twice" in note for note in notes)


def test_circles_that_start_at_different_points_are_one_circle() -> None:
    vertical = ([(0.0, -5.0), (0.0, 5.0)], [1.0, 1.0], True, "0")
    horizontal = ([(5.0, 0.0), (-5.0, 0.0)], [-1.0, -1.0], True, "0")
    contours, _ = join([vertical, horizontal])
    assert len(contours) == 1


def test_an_arc_beyond_a_half_circle_is_halved() -> None:
    """The bulge is tan(270 deg / 4): three quarters of the circle around (5, 5)."""
    contours, _ = join(
        [([(5.0, 0.0), (0.0, 5.0)], [math.tan(math.radians(67.5)), 0.0], False, "0")]
    )
    points, bulges = contours[0].points, contours[0].bulges
    assert len(points) == 3
    assert np.abs(bulges).max() <= 1
    assert np.hypot(*(points - 5).T) == pytest.approx([5, 5, 5])
    assert points[1] == pytest.approx([5 + 5 / math.sqrt(2), 5 + 5 / math.sqrt(2)])


def test_repeated_points_are_dropped_and_damaged_pieces_left_out() -> None:
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
    contours, notes = join(pieces)
    assert [c.points.tolist() for c in contours] == [[[0, 0], [5, 0], [5, 5]]]
    assert contours[0].bulges.tolist() == [0.5, 0.2, 0]
    assert notes[0].startswith("skipped: damaged: 4 LINE on layer 0")
    assert notes[1] == "repaired: dropped: 1 LINE on layer 0 (without length)"


def test_a_square_far_from_the_origin_is_closed() -> None:
    contours, _ = join(sides([(x + 1e9, y - 1e9) for x, y in SQUARE]))
    assert contours[0].closed
    assert contours[0].points[0].tolist() == [1e9, -1e9]


def test_no_piece_makes_no_contour() -> None:
    assert join([]) == ((), [])


def test_a_note_stays_on_one_line() -> None:
    _, notes = make_contours(collect([line((1, 1), (1, 1), "a\nb)")]), 0.05)
    assert notes == (Note("repaired", "dropped: 1 LINE on layer a_b_", "without length"),)
