"""Pieces that nothing holds, compared with a flood fill over the cells that a text cuts."""

from __future__ import annotations

import math
import random
import re
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
import shapely

import camgen
from camgen.check.stock import Cut, StockProof, Task, design, prove
from camgen.check.stock.clear import index_motions
from camgen.check.stock.moves import tabulate
from camgen.check.stock.pieces import find_pieces
from camgen.model.errors import NoSafeProgram
from camgen.model.job import Job, StockTable, ToolTable
from camgen.model.part import Contour, Part
from camgen.model.program import Instruction
from camgen.pipeline.assumptions import note_pieces
from tests.check.stock.test_stock import (
    MILL,
    cut_around,
    cut_circle,
    feed_to,
    make_disc,
    make_part,
    make_square,
    make_task,
    rapid_to,
)
from tests.support import drawn
from tests.support.flood import Region, find_loose

THICKNESS, MARGIN = 4.0, 12.0


def build(contours: Sequence[Contour], diameter: float = 3.0, **changes: Any) -> camgen.Result:
    """Build a program that cuts all contours out of a sheet.

    changes: settings of the job; two underlines stand for the dot.
    """
    job: dict[str, Any] = {
        "operation": {"depth": THICKNESS, "passes": 2},
        "tool": {"diameter": diameter},
        "process": {"spindle": 9000.0},
        "stock": {"thickness": THICKNESS, "margin": MARGIN, "held": "tape"},
    }
    for name, value in changes.items():
        table, key = name.split("__")
        job[table][key] = value
    return camgen.build(drawn.part(*contours), post="gcode", job=job)


def find_flooded(result: camgen.Result, diameter: float = 3.0) -> list[Region]:
    """The pieces that the text of a build cuts free, found by flood fill."""
    points = np.concatenate([contour.points for contour in result.part.contours])
    low, high = points.min(axis=0) - MARGIN, points.max(axis=0) + MARGIN
    box = (low[0], low[1], high[0], high[1])
    return find_loose(result.files[0].text, {0: diameter / 2}, THICKNESS, box)


def make_nested_squares(count: int, x: float = 0.0, size: float = 90.0) -> list[Contour]:
    """Squares within each other, with a distance of 10 mm."""
    contours = []
    for k in range(count):
        low, side = 10.0 * k, size - 20.0 * k
        contours.append(drawn.rectangle(x + low, low, side, side, f"{x:g}-{k}"))
    return contours


def draw_parts(generator: random.Random) -> list[Contour]:
    """Three parts next to each other, each with a hole, some with a part in the hole."""
    contours = []
    for k in range(3):
        x, y, width = 60.0 * k, generator.uniform(0, 10), generator.uniform(38, 48)
        contours.append(drawn.rectangle(x, y, width, width, f"part{k}"))
        middle = x + width / 2, y + width / 2
        radius = generator.uniform(2.0, width / 2 - 4)
        contours.append(drawn.circle(*middle, radius, f"hole{k}"))
        if radius > 12:
            contours.append(drawn.circle(*middle, radius - generator.uniform(4, 8), f"inner{k}"))
    return contours


@pytest.mark.parametrize("seed", range(6))
def test_a_flood_fill_finds_the_same_pieces(seed: int) -> None:
    generator = random.Random(seed)
    tabs = {"operation__tabs": 2, "operation__tab_width": 2.0} if seed % 2 else {}
    result = build(draw_parts(generator), **tabs)
    assert result.proof is not None
    chip = math.pi * 1.5**2
    regions = [region for region in find_flooded(result) if region.area > chip]
    pieces = sorted(
        (piece for piece in result.proof.pieces.loose), key=lambda piece: -piece.shape.area
    )
    assert len(pieces) == len(regions)
    for piece, region in zip(pieces, regions, strict=True):
        # A cell at the border of a region is counted as a whole or not at all.
        assert piece.shape.area == pytest.approx(region.area, abs=0.1 * piece.shape.length)
        assert shapely.distance(piece.shape.envelope, shapely.Point(region.x, region.y)) < 0.1


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5])
def test_parts_in_windows_of_parts_are_held_by_tabs(count: int) -> None:
    contours = make_nested_squares(count)
    tabs = {"operation__tabs": 3, "operation__tab_width": 3.0, "stock__held": "frame"}
    result = build(contours, **tabs)
    chip = math.pi * 1.5**2
    # The slug of the innermost hole has no part in it.
    slugs = [region for region in find_flooded(result) if region.area > chip]
    assert len(slugs) == (count % 2 == 0)
    assert len(result.proof.pieces.loose) == len(slugs)  # type: ignore[union-attr]
    with pytest.raises(NoSafeProgram, match=r"comes loose at its last cut, .*: nothing holds it"):
        build(contours, stock__held="frame")


def test_each_part_that_is_not_held_is_named() -> None:
    contours = [drawn.rectangle(0, 0, 30, 30, "c1"), drawn.rectangle(60, 0, 30, 30, "c2")]
    result = build(contours)
    held, loose = result.proof.pieces.loose  # type: ignore[union-attr]
    assert {held.contour, loose.contour} == {"c1", "c2"}
    assert [note.what for note in result.notes if "cut free" in note.what] == [
        "2 parts and 0 slugs are cut free"
    ]


@pytest.mark.parametrize(("radius", "area"), [(3.0, 0.0), (3.9, 0.0), (12.0, math.pi * 81)])
def test_a_slug_is_named_if_it_is_larger_than_the_tool(radius: float, area: float) -> None:
    contours = [drawn.rectangle(-40, -40, 80, 80, "c1"), drawn.circle(0, 0, radius, "c2")]
    result = build(contours, operation__tabs=3, stock__held="frame")
    slugs = result.proof.pieces.loose  # type: ignore[union-attr]
    assert [piece.kind for piece in slugs] == ["slug"] * (area > 0)
    # The pieces are narrower by 0.01 mm.
    assert [piece.shape.area for piece in slugs] == pytest.approx([area] * len(slugs), rel=0.01)
    notes = [note for note in result.notes if "slug" in note.what]
    assert len(notes) == len(slugs)
    if notes:
        assert notes[0].what == "1 slug comes loose, the largest 18 x 18 mm at 0 0 within c2"
        assert not notes[0].fails_strict


def test_an_operation_of_holes_alone_holds_the_slug() -> None:
    hole = drawn.circle(0, 0, 12.0, "c2")
    result = build([hole], operation__tabs=3, operation__side="inside", stock__held="frame")
    assert result.proof is not None
    assert result.proof.pieces.loose == ()
    assert find_flooded(result) == []


@pytest.mark.parametrize(
    ("margin", "held", "is_refused"),
    [
        (0.0, "frame", True),
        (0.0, "vacuum", False),
        (2.9, "frame", True),
        (8.0, "frame", False),
    ],
)
def test_tabs_without_a_frame_of_stock_hold_nothing(
    margin: float, held: str, is_refused: bool
) -> None:
    contours = [drawn.rectangle(0, 0, 40, 40, "c1")]
    changes = {"stock__margin": margin, "stock__held": held, "operation__tabs": 3}
    if is_refused:
        with pytest.raises(NoSafeProgram, match=r"leave no frame of the stock.*stock\.margin"):
            build(contours, **changes)
    else:
        assert build(contours, **changes).proof is not None


@pytest.mark.parametrize(("distance", "is_refused"), [(2.0, True), (9.0, False)])
def test_the_outline_of_the_stock_is_the_frame(distance: float, is_refused: bool) -> None:
    side = 40 + 2 * distance
    blank = drawn.rectangle(-distance, -distance, side, side, "blank")
    contours = [drawn.rectangle(0, 0, 40, 40, "c1")]
    whole = Part("part", "part.dxf", "mm", (*contours, _move_to_layer(blank, "stock")), ())
    job = {
        "operation": {"depth": THICKNESS, "passes": 2, "tabs": 3},
        "tool": {"diameter": 3.0},
        "process": {"spindle": 9000.0},
        "stock": {"thickness": THICKNESS, "layer": "stock"},
    }
    if is_refused:
        with pytest.raises(NoSafeProgram, match="leave no frame of the stock"):
            camgen.build(whole, post="gcode", job=job)
    else:
        assert camgen.build(whole, post="gcode", job=job).proof is not None


def _move_to_layer(contour: Contour, layer: str) -> Contour:
    return Contour(contour.points, contour.bulges, contour.closed, layer, contour.id)


def test_an_arm_may_cut_a_part_free() -> None:
    contours = [drawn.rectangle(0, 0, 40, 40, "c1"), drawn.circle(20, 20, 12.0, "c2")]
    job = {
        "operation": {"depth": 4.0},
        "tool": {"diameter": 3.0},
        "process": {"spindle": 9000.0},
        "stock": {"thickness": 4.0},
        "post": {"signals": {"spindle": "aoSpindle"}},
    }
    result = camgen.build(drawn.part(*contours), post="rapid", job=job)
    assert result.proof is not None
    assert [fault.kind for fault in result.proof.loose] == ["loose", "loose"]
    assert not [note for note in result.notes if "slug" in note.what]


# Motions written by hand.


def prove_cuts(
    *bodies: Sequence[Instruction],
    tasks: Sequence[Task] = (),
    tools: Sequence[ToolTable] = (),
    thickness: float = 5.0,
) -> StockProof:
    stock = StockTable(thickness=thickness)
    cuts = [
        Cut(body, range(1, len(body) + 1), tool, "p.ngc")
        for body, tool in zip(bodies, tools or [MILL] * len(bodies), strict=True)
    ]
    return prove(cuts, design(tasks or [OUTLINE], stock), stock=stock)


OUTLINE = make_task(make_part(make_square("c1", 0, 40)))
PATH = cut_around(0, 40, 3.0, -5.0)


def add_tab(start: float, width: float) -> list[Instruction]:
    """The path around the square with a tab of a width on its first line."""
    end = start + width + MILL.diameter
    tab = [
        feed_to(start, -3, -5),
        feed_to(start, -3, -4),
        feed_to(end, -3, -4),
        feed_to(end, -3, -5),
    ]
    return [*PATH[:2], *tab, *PATH[2:]]


@pytest.mark.parametrize(("width", "count"), [(5.0, 0), (0.5, 0), (0.03, 0), (0.01, 1), (0.0, 1)])
def test_a_tab_holds_a_part_if_it_is_wider_than_a_thread(width: float, count: int) -> None:
    assert len(prove_cuts(add_tab(10.0, width)).unheld) == count


@pytest.mark.parametrize(("skin", "count"), [(0.2, 0), (0.01, 0), (0.0, 1), (-0.5, 1)])
def test_a_skin_that_is_left_below_holds_a_part(skin: float, count: int) -> None:
    body = cut_around(0, 40, 3.0, skin - 5.0)
    assert (
        len(
            prove_cuts(
                body, tasks=[make_task(make_part(make_square("c1", 0, 40)), depth=6.0)]
            ).unheld
        )
        == count
    )


def test_two_tools_free_a_part_together() -> None:
    half = len(PATH) // 2
    # Each tool begins above the position where the other one ends.
    x, y, _ = PATH[half].target.origin  # type: ignore[union-attr]
    first = [*PATH[: half + 1], rapid_to(x, y, 5)]
    second = [rapid_to(x, y, 5), feed_to(x, y, -5), *PATH[half + 1 :]]
    tools = [MILL, ToolTable(diameter=6.0, number=2)]
    assert prove_cuts(first).unheld == prove_cuts(second).unheld == ()
    (fault,) = prove_cuts(first, second, tools=tools).unheld
    assert fault.cut == 1
    assert "within c1" in fault.text


def test_a_pocket_that_removes_the_tab_frees_the_part() -> None:
    body = add_tab(10.0, 4.0)
    pocket = [rapid_to(8, -3, 5), feed_to(8, -3, -5), feed_to(26, -3, -5), rapid_to(26, -3, 5)]
    assert prove_cuts(body).unheld == ()
    (fault,) = prove_cuts(body, pocket).unheld
    assert (fault.cut, fault.line) == (1, 3)


def test_a_missing_tab_is_a_fault() -> None:
    two = make_task(make_part(make_square("c1", 0, 40)), tabs=2, tab_width=4.0)
    (fault,) = prove_cuts(add_tab(10.0, 4.0), tasks=[two]).unheld
    assert fault.text == "1 tab on c1, the job asks for 2"
    single = make_task(make_part(make_square("c1", 0, 40)), tabs=1, tab_width=4.0)
    assert prove_cuts(add_tab(10.0, 4.0), tasks=[single]).unheld == ()
    (fault,) = prove_cuts(PATH, tasks=[single]).unheld
    assert fault.text.endswith("no tab is left that holds it")


def test_material_that_is_left_is_noted_as_skipped() -> None:
    # The job has no tabs.
    (note,) = note_pieces(prove_cuts(add_tab(10.0, 5.0)), Job())
    assert (note.kind, note.fails_strict) == ("skipped", True)
    match = re.match(r"([\d.]+) mm2 not cut at z -5, up to ([\d.]+) mm wide", note.what)
    assert match
    # The strip of 6 mm is 5 mm long in its middle, and longer at its sides: the tool is round.
    round_mm2 = 2 * (3 * 6 - math.pi * 9 / 2)
    assert float(match[1]) == pytest.approx(5 * 6 + round_mm2, abs=0.1)
    assert note_pieces(prove_cuts(PATH, tasks=[OUTLINE]), Job()) == ()


def test_a_missing_tab_of_a_window_or_of_a_part_is_a_fault() -> None:
    drawing = make_part(
        make_square("c1", -60, 60), make_square("c2", -40, 40), make_square("c3", -20, 20)
    )
    wanted = make_task(drawing, tabs=2, tab_width=4.0)
    window = [(-37, -37), (37, -37), (37, 37), (-37, 37), (-37, -37)]
    passes = {
        "c1": cut_around(-60, 60, 3.0, -5.0),
        "c2": [rapid_to(-37, -37, 5), *(feed_to(x, y, -5) for x, y in window)],
        "c3": cut_around(-20, 20, 3.0, -5.0),
    }
    for name in passes:
        bodies = []
        for contour, body in passes.items():
            tabs = 1 if contour == name else 2
            bodies.append([*add_tabs(body, contour, tabs), rapid_to(0, 0, 20)])
        faults = prove_cuts(*bodies, tasks=[wanted]).unheld
        assert [fault.text for fault in faults] == [f"1 tab on {name}, the job asks for 2"]


def add_tabs(body: Sequence[Instruction], contour: str, count: int) -> list[Instruction]:
    """The path around a contour with tabs of 4 mm on its first line."""
    y = {"c1": -63.0, "c2": -37.0, "c3": -23.0}[contour]
    lifted = list(body[:2])
    for x in (-15.0, 5.0)[:count]:
        heights = ((x, -5), (x, -4), (x + 10, -4), (x + 10, -5))
        lifted += [feed_to(tab_x, y, z) for tab_x, z in heights]
    return [*lifted, *body[2:]]


def test_a_loose_slug_that_the_tool_touches_again_is_serious_and_not_refused() -> None:
    drawing = make_task(make_part(make_square("c1", -40, 40), make_disc("c2", 0, 0, 15.0)))
    ring = cut_circle(0, 0, 12.0, -5.0)
    slug = prove_cuts(ring, tasks=[drawing]).loose
    assert [(fault.serious, "slug" in fault.text) for fault in slug] == [(False, True)]
    # The second pass touches the slug, whose radius is 9 mm: it leaves a radius of 8.9 mm.
    again = prove_cuts(ring, cut_circle(0, 0, 11.9, -5.0), tasks=[drawing])
    assert [(fault.serious, fault.kind) for fault in again.loose] == [(True, "loose")]
    assert again.refused == ()


def test_a_clamp_holds_a_piece_that_is_partly_below_it() -> None:
    cuts = [Cut(PATH, range(1, len(PATH) + 1), MILL, "p.ngc")]
    gone, wanted = index_motions(tabulate(cuts), cuts), design([OUTLINE], StockTable(thickness=5.0))
    assert len(find_pieces(gone, wanted).loose) == 1
    assert find_pieces(gone, wanted, shapely.box(35, 15, 60, 25)).loose == ()
    assert len(find_pieces(gone, wanted, shapely.box(46, 15, 60, 25)).loose) == 1
