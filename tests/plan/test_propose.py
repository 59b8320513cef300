"""The job proposed for a drawing: holes are drilled, inner contours cut, outlines cut last."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

import camgen
from camgen.model.part import Contour, Part
from camgen.model.pose import frozen
from camgen.plan.propose import Proposal, propose
from camgen.read.made import make_part

PARTS = Path(__file__).parents[2] / "fixtures" / "parts"


def circle(x: float, y: float, diameter: float, layer: str = "0") -> Contour:
    radius = diameter / 2
    return Contour(frozen([(x - radius, y), (x + radius, y)]), frozen([1.0, 1.0]), True, layer)


def box(
    x: float, y: float, width: float, height: float, fillet: float = 0.0, layer: str = "0"
) -> Contour:
    """A counter-clockwise rectangle from its lower left corner, with corners of radius `fillet`."""
    low, high, r = np.array([x, y]), np.array([x + width, y + height]), fillet
    if not fillet:
        corners = [low, (high[0], low[1]), high, (low[0], high[1])]
        return Contour(frozen(np.array(corners)), frozen(np.zeros(4)), True, layer)
    points = [
        *((x + r, y), (high[0] - r, y), (high[0], y + r), (high[0], high[1] - r)),
        *((high[0] - r, high[1]), (x + r, high[1]), (x, high[1] - r), (x, y + r)),
    ]
    bulges = [0.0, np.tan(np.pi / 8)] * 4
    return Contour(frozen(points), frozen(bulges), True, layer)


def propose_job(*contours: Contour) -> Proposal:
    proposal = propose(make_part(list(contours)))
    assert proposal is not None
    return proposal


def list_rows(proposal: Proposal, *keys: str) -> list[tuple[object, ...]]:
    """The values of some keys in the row of each operation."""
    return [tuple(map(operation.row.get, keys)) for operation in proposal.operations]


def list_diameters(proposal: Proposal) -> list[object]:
    return [tool.row["diameter"] for tool in proposal.tools]


PLATE = box(0, 0, 100, 60)


def test_a_plate_with_holes_counterbores_a_pocket_and_slots() -> None:
    proposal = propose(camgen.read(PARTS / "motor.dxf"))
    assert proposal is not None
    assert [operation.about for operation in proposal.operations] == [
        *("4 holes of 5.5 mm", "1 hole of 8 mm", "4 counterbores of 10 mm: how deep?"),
        *("1 counterbore of 20 mm: how deep?", "2 contours inside others"),
        # The pocket has a counterbore on it and is cut through.
        *("1 contour around slugs", "1 outline"),
    ]
    assert [tool.row["kind"] for tool in proposal.tools] == ["drill", "drill", "end mill"]
    assert [tool.row["number"] for tool in proposal.tools] == [1, 2, 3]
    # The slots are as wide as the widest mill.
    assert list_diameters(proposal) == [5.5, 8.0, 8.0]
    assert proposal.operations[-1].row == {
        "kind": "follow",
        "tool": "mill 8",
        "nesting": "outer",
        "depth": 3.5,
        "entry": "ramp",
        # Three quarters of the feed of the chart for steel: 0.0011 inch, 2 edges, 4850 rpm.
        "plunge": pytest.approx(0.75 * 4.77, abs=0.02),
        "tabs": 4,
    }
    # A kerf of 8 mm and a frame of 8 mm.
    assert proposal.margin == 16.0
    # 3 mm, at most 0.5 mm below the part, and the tip of 118 deg: 2.75 mm / tan(59 deg) = 1.65 mm.
    assert list_rows(proposal, "holes", "nesting", "depth")[0] == ([5.49, 5.51], "inner", 5.1)
    assert proposal.left == ()


def test_a_hole_wider_than_the_largest_drill_is_cut() -> None:
    proposal = propose_job(PLATE, circle(20, 20, 13), circle(60, 20, 13.1))
    assert list_rows(proposal, "kind", "ids", "nesting") == [
        ("drill", None, "inner"),
        ("follow", ["c3"], None),
        ("follow", None, "outer"),
    ]


@pytest.mark.parametrize(("diameter", "tools"), [(0.2, [0.2, 8.0]), (0.13, [8.0])])
def test_a_hole_narrower_than_the_smallest_drill_is_left_out(
    diameter: float, tools: list[float]
) -> None:
    turn = np.arange(24) * np.pi / 12
    ring = np.column_stack([10 + diameter / 2 * np.cos(turn), 10 + diameter / 2 * np.sin(turn)])
    proposal = propose_job(
        box(0, 0, 40, 40), Contour(frozen(ring), frozen(np.zeros(24)), True, "0")
    )
    assert list_diameters(proposal) == pytest.approx(tools, abs=0.01)
    assert len(proposal.left) == 2 - len(tools)


def test_a_disc_with_a_hole_is_cut_out_and_not_drilled() -> None:
    proposal = propose_job(circle(0, 0, 12), circle(0, 0, 5))
    assert list_rows(proposal, "kind", "holes") == [("drill", [4.99, 5.01]), ("follow", None)]
    assert proposal.operations[1].row["nesting"] == "outer"


def test_a_disc_of_the_size_of_a_hole_is_not_drilled() -> None:
    proposal = propose_job(PLATE, circle(20, 20, 10), circle(200, 0, 10), circle(200, 0, 4))
    operation_rows = [operation.row for operation in proposal.operations]
    drill = next(row for row in operation_rows if row["tool"] == "drill 10")
    assert drill["nesting"] == "inner"
    plate, disc = operation_rows[-2:]
    assert (plate["tabs"], plate["depth"]) == (4, 3.5)
    # The path around the disc is 56.5 mm long, so it has two short tabs with steep slopes.
    assert (disc["tabs"], disc["tab_width"], disc["entry_angle"]) == (2, 2.0, 10.0)


def test_an_outline_without_room_for_tabs_keeps_a_skin() -> None:
    (operation,) = propose_job(box(0, 0, 6, 6)).operations
    assert "tabs" not in operation.row
    assert operation.row["depth"] == 2.8


def test_holes_without_an_outline_are_drilled() -> None:
    proposal = propose_job(circle(0, 0, 8), circle(30, 0, 8))
    assert list_rows(proposal, "kind", "nesting") == [("drill", "outer")]


def test_holes_are_listed_by_id_if_another_circle_has_their_size() -> None:
    """A circle in a hole that is too large for a counterbore is a loose disc and is cut out."""
    proposal = propose_job(PLATE, circle(20, 20, 5), circle(60, 30, 40), circle(60, 30, 5))
    assert list_rows(proposal, "kind", "ids") == [
        ("drill", ["c2"]),
        ("follow", ["c3"]),
        ("follow", ["c4"]),
        ("follow", None),
    ]


@pytest.mark.parametrize(
    ("diameters", "ranges"),
    [
        ((5.0, 5.01), [[4.99, 5.02]]),
        ((5.0, 5.1), [[4.99, 5.01], [5.09, 5.11]]),
        ((5.0, 5.03), [[4.99, 5.04]]),
    ],
)
def test_a_range_of_diameters_never_contains_two_sizes(
    diameters: Sequence[float], ranges: list[list[float]]
) -> None:
    proposal = propose_job(PLATE, *(circle(20 + 20 * k, 20, d) for k, d in enumerate(diameters)))
    assert [operation.row["holes"] for operation in proposal.operations[:-1]] == ranges
    # The tools are standard drills, at most 0.011 mm from the smallest hole.
    assert list_diameters(proposal)[:-1] == [round(low + 0.01, 2) for low, _ in ranges]


@pytest.mark.parametrize(
    ("inner", "mills"),
    [
        (box(10, 10, 40, 20), [8.0]),  # no mill fits into sharp corners
        # The slug is a chip without tabs, and a small mill cuts the corners.
        (box(10, 10, 13, 13), [8.0, 3.0]),
        (box(10, 10, 40, 20, fillet=4), [8.0]),
        # 4 corners of 2 mm: the mill of 8 mm misses 4 (2 x 2 + pi) = 28.6 mm of 116.6 mm.
        (box(10, 10, 40, 20, fillet=2), [4.0]),
        (box(10, 10, 40, 20, fillet=2.4), [4.0]),
        # It misses less than 5 % of 1000 mm, and the slug has tabs.
        (box(10, 10, 400, 100, fillet=2), [8.0]),
        (box(10, 10, 40, 4.4), [4.0]),  # a groove
        (box(10, 10, 40, 1.2), [1.0]),
    ],
)
def test_the_mills_are_the_largest_that_touches_enough_and_one_for_the_rest(
    inner: Contour, mills: list[float]
) -> None:
    proposal = propose_job(box(0, 0, 500, 200), inner)
    operations = proposal.operations[: len(mills)]
    assert [item.row["tool"] for item in operations] == [f"mill {mill:g}" for mill in mills]
    assert [item.row.get("rest", False) for item in operations] == [False, True][: len(mills)]


def test_mills_enter_on_ramps_and_finish_walls_that_take_several_passes() -> None:
    proposal = propose_job(box(0, 0, 100, 60), box(10, 10, 40, 5.8), box(10, 30, 40, 1.2))
    groove, thin, *_, outline = (operation.row for operation in proposal.operations)
    # The depth of 3.5 mm is cut in passes of 0.6 tool diameters at most.
    assert (groove["passes"], groove["finish"]) == (2, 0.2)
    assert thin["passes"] == 6
    assert "finish" not in thin
    assert "passes" not in outline
    assert {row["entry"] for row in (groove, thin, outline)} == {"ramp"}


def test_a_hole_without_a_drill_of_its_size_is_bored() -> None:
    proposal = propose_job(PLATE, circle(20, 20, 6.66), circle(60, 20, 6.7))
    assert list_rows(proposal, "kind", "tool", "depth")[:2] == [
        ("bore", "mill 5", 3.5),
        ("drill", "drill 6.7", 5.5),
    ]


def test_a_part_in_a_window_has_tabs() -> None:
    plate = box(0, 0, 200, 150)
    proposal = propose_job(plate, box(10, 10, 170, 120), box(60, 45, 60, 40))
    (part,) = (row for row in proposal.operations if "part inside others" in row.about)
    assert part.row["ids"] == ["c3"]
    assert "tabs" in part.row


def test_a_part_near_the_wall_of_its_window_keeps_a_skin() -> None:
    # Part and window are 10 mm apart, and their kerfs meet all around. They would cut tabs off.
    proposal = propose_job(PLATE, box(10, 10, 60, 40), box(20, 20, 40, 20))
    (part,) = (row for row in proposal.operations if "part inside others" in row.about)
    assert "tabs" not in part.row
    assert part.row["depth"] == 2.8


def test_fillets_and_a_short_notch_of_an_outline_need_no_smaller_mill() -> None:
    assert list_diameters(propose_job(box(0, 0, 60, 40, fillet=1))) == [8.0]
    notch = Contour(
        frozen([(0, 0), (60, 0), (60, 40), (32, 40), (28, 40), (0, 40)]),
        frozen([0, 0, 0, -1, 0, 0]),
        True,
        "0",
    )
    # The notch is 6.3 mm of 202 mm, so the mill of 8 mm may miss it. A smaller mill might cut tabs.
    assert list_diameters(propose_job(notch)) == [8.0]


def test_a_contour_too_narrow_for_all_mills_is_left_out() -> None:
    proposal = propose_job(PLATE, box(10, 10, 40, 0.4), box(10, 20, 40, 8))
    assert proposal.left == ("c2",)
    assert list_rows(proposal, "ids", "nesting")[0] == (["c3"], None)
    assert list_rows(proposal, "ids", "nesting")[-1] == (None, "outer")


def test_small_contours_across_the_outline_are_recesses() -> None:
    recesses = box(92, 20, 20, 16), box(30, -6, 12, 12)
    proposal = propose_job(PLATE, *recesses, circle(20, 40, 6.0))
    assert [operation.about for operation in proposal.operations] == [
        "1 hole of 6 mm",
        "2 pockets across other contours: how deep?",
        "1 outline",
    ]
    assert list_rows(proposal, "kind", "ids", "depth")[1:] == [
        ("pocket", ["c2", "c3"], 1.5),
        ("follow", ["c1"], 3.5),
    ]
    assert proposal.left == ()
    # A mill of 5 mm reaches 1 - (4 - pi) 2.5^2 / 144 = 96 % of the smaller recess, one of 6 mm
    # reaches 94.6 %.
    assert proposal.operations[1].row["tool"] == "mill 5"


@pytest.mark.parametrize(
    "others",
    [
        # More than a quarter of the plate.
        [box(60, 10, 80, 40)],
        # Two that cross each other.
        [box(92, 20, 20, 16), box(96, 30, 20, 16)],
    ],
)
def test_large_or_crossing_contours_across_the_outline_are_left_out(others: list[Contour]) -> None:
    ids = [contour.id for contour in make_part([PLATE, *others]).contours]
    proposal = propose(make_part([PLATE, *others, box(200, 0, 50, 50)]))
    assert proposal is not None
    assert set(proposal.left) == set(ids)
    assert all(row != ("pocket",) for row in list_rows(proposal, "kind"))


def test_contours_are_selected_by_their_layer_if_no_other_contour_is_on_it() -> None:
    slots = [box(10, 10 + 15 * k, 40, 8, layer="SLOTS") for k in range(2)]
    proposal = propose_job(PLATE, circle(80, 20, 5, "HOLES"), *slots)
    assert list_rows(proposal, "layers", "ids", "nesting")[1] == (["SLOTS"], None, "inner")


@pytest.mark.parametrize(
    "part",
    [
        make_part([(0, 0), (10, 0), (10, 10)]),
        make_part([box(0, 0, 10, 10), box(5, 5, 10, 10)]),  # they cross
    ],
)
def test_a_part_without_a_sound_closed_contour_has_no_proposal(part: Part) -> None:
    assert propose(part) is None
