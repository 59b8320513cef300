"""What is proposed for a drawing: round holes drilled, inner loops cut, outlines last, with tools that fit."""

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
    """A rectangle from its lower left corner, counter-clockwise, its corners rounded by ``fillet``."""
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


def proposed(*contours: Contour) -> Proposal:
    found = propose(make_part(list(contours)))
    assert found is not None
    return found


def rows(found: Proposal, *keys: str) -> list[tuple[object, ...]]:
    return [tuple(one.row.get(key) for key in keys) for one in found.operations]


def sizes(found: Proposal) -> list[object]:
    return [tool.row["diameter"] for tool in found.tools]


PLATE = box(0, 0, 100, 60)


def test_a_plate_with_holes_counterbores_a_pocket_and_slots() -> None:
    found = propose(camgen.read(PARTS / "motor.dxf"))
    assert found is not None
    assert [one.about for one in found.operations] == [
        *("4 holes of 5.5 mm", "1 hole of 8 mm", "4 counterbores of 10 mm: how deep?"),
        *("1 counterbore of 20 mm: how deep?", "3 contours inside others", "1 outline"),
    ]
    assert [tool.row["kind"] for tool in found.tools] == ["drill", "drill", "end mill"]
    assert [tool.row["number"] for tool in found.tools] == [1, 2, 3]
    assert sizes(found) == [5.5, 8.0, 6.0]
    assert found.operations[-1].row == {
        **{
            "kind": "follow",
            "tool": "mill 6",
            "nesting": "outer",
            "depth": 3.5,
            "tabs": 4,
            "entry": "ramp",
            "passes": 2,
        },
    }
    # 3 mm, 0.5 mm through at most, and the tip of 118 degrees: 2.75 mm / tan(59 deg) = 1.65 mm.
    assert rows(found, "holes", "nesting", "depth")[0] == ([5.49, 5.51], "inner", 5.1)
    assert found.left == ()


def test_what_is_wide_is_not_drilled() -> None:
    found = proposed(PLATE, circle(20, 20, 13), circle(60, 20, 13.1))
    assert rows(found, "kind", "ids", "nesting") == [
        ("drill", None, "inner"),
        ("follow", ["c3"], None),
        ("follow", None, "outer"),
    ]


@pytest.mark.parametrize(("diameter", "tools"), [(0.2, [0.2, 6.0]), (0.13, [6.0])])
def test_what_is_narrower_than_any_drill_is_left(diameter: float, tools: list[float]) -> None:
    turn = np.arange(24) * np.pi / 12
    ring = np.column_stack([10 + diameter / 2 * np.cos(turn), 10 + diameter / 2 * np.sin(turn)])
    found = proposed(box(0, 0, 40, 40), Contour(frozen(ring), frozen(np.zeros(24)), True, "0"))
    assert sizes(found) == pytest.approx(tools, abs=0.01)
    assert len(found.left) == 2 - len(tools)


def test_a_disc_with_a_hole_is_cut_out_and_not_drilled() -> None:
    found = proposed(circle(0, 0, 12), circle(0, 0, 5))
    assert rows(found, "kind", "holes") == [("drill", [4.99, 5.01]), ("follow", None)]
    assert found.operations[1].row["nesting"] == "outer"


def test_a_disc_of_the_size_of_a_hole_is_not_drilled() -> None:
    found = proposed(PLATE, circle(20, 20, 10), circle(200, 0, 10), circle(200, 0, 4))
    drill = next(one.row for one in found.operations if one.row["tool"] == "drill 10")
    assert drill["nesting"] == "inner"
    assert "2 outlines" in [one.about for one in found.operations]


def test_holes_without_an_outline_are_drilled() -> None:
    found = proposed(circle(0, 0, 8), circle(30, 0, 8))
    assert rows(found, "kind", "nesting") == [("drill", "outer")]


def test_holes_of_one_size_that_are_not_all_meant_are_named() -> None:
    """The circle that stands in a hole too large to be its counterbore is a loose disc: it is cut round."""
    found = proposed(PLATE, circle(20, 20, 5), circle(60, 30, 40), circle(60, 30, 5))
    assert rows(found, "kind", "ids") == [
        ("drill", ["c2"]),
        ("follow", ["c3", "c4"]),
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
def test_no_range_of_diameters_holds_two_sizes(
    diameters: Sequence[float], ranges: list[list[float]]
) -> None:
    found = proposed(PLATE, *(circle(20 + 20 * k, 20, d) for k, d in enumerate(diameters)))
    assert [one.row["holes"] for one in found.operations[:-1]] == ranges
    # No hole becomes wider than it is drawn.
    assert sizes(found)[:-1] == [low + 0.01 for low, _ in ranges]


@pytest.mark.parametrize(
    ("inner", "mill"),
    [
        (box(10, 10, 40, 20), 6.0),  # sharp corners fit no mill
        (box(10, 10, 40, 20, fillet=2), 4.0),
        (box(10, 10, 40, 20, fillet=2.4), 4.0),
        (box(10, 10, 40, 20, fillet=0.2), 6.0),  # too small to be more than a corner
        (box(10, 10, 40, 4.4), 4.0),  # a groove
        (box(10, 10, 40, 1.2), 1.0),
    ],
)
def test_the_mill_fits_the_narrowest_place_and_the_fillets(inner: Contour, mill: float) -> None:
    found = proposed(PLATE, inner)
    assert sizes(found) == sorted({mill, 6.0})
    assert found.operations[0].row["passes"] == int(np.ceil(3.5 / (mill / 2)))


def test_fillets_of_an_outline_are_run_into_only_where_they_are_hollow() -> None:
    assert sizes(proposed(box(0, 0, 60, 40, fillet=1))) == [6.0]
    notch = Contour(
        frozen([(0, 0), (60, 0), (60, 40), (32, 40), (28, 40), (0, 40)]),
        frozen([0, 0, 0, -1, 0, 0]),
        True,
        "0",
    )
    assert sizes(proposed(notch)) == [4.0]


def test_what_no_mill_fits_is_left() -> None:
    found = proposed(PLATE, box(10, 10, 40, 0.6), box(10, 20, 40, 8))
    assert found.left == ("c2",)
    assert rows(found, "ids", "nesting") == [(["c3"], None), (None, "outer")]


def test_contours_that_cross_are_left() -> None:
    found = proposed(PLATE, circle(20, 20, 8), box(50, 50, 20, 30))
    assert found.left == ("c1", "c3")


def test_layers_name_what_is_chosen_where_they_tell_it_from_the_rest() -> None:
    slots = [box(10, 10 + 15 * k, 40, 8, layer="SLOTS") for k in range(2)]
    found = proposed(PLATE, circle(80, 20, 5, "HOLES"), *slots)
    assert rows(found, "layers", "ids", "nesting")[1] == (["SLOTS"], None, "inner")


@pytest.mark.parametrize(
    "part",
    [
        make_part([(0, 0), (10, 0), (10, 10)]),
        make_part([box(0, 0, 10, 10), box(5, 5, 10, 10)]),  # they cross
    ],
)
def test_nothing_is_proposed_for_what_has_no_sound_loop(part: Part) -> None:
    assert propose(part) is None
