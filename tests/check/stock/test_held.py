"""Pieces that nothing holds, against a flood fill over the cells that a text cuts through."""

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
from camgen.check.stock.pieces import find_pieces
from camgen.model.errors import NoSafeProgram
from camgen.model.job import Job, StockTable, ToolTable
from camgen.model.part import Contour, Part
from camgen.model.program import Instruction
from camgen.pipeline.assumptions import note_pieces
from tests.check.stock.test_stock import MILL, around, circle, disc, feed, part, rapid, square, task
from tests.support import drawn
from tests.support.flood import Region, find_loose

THICKNESS, MARGIN = 4.0, 12.0


def build(contours: Sequence[Contour], diameter: float = 3.0, **changes: Any) -> camgen.Result:
    """A program that cuts all contours out of a sheet.

    changes: settings, with two underlines for the dot.
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


def flood(result: camgen.Result, diameter: float = 3.0) -> list[Region]:
    """The pieces that its text cuts free."""
    points = np.concatenate([contour.points for contour in result.part.contours])
    low, high = points.min(axis=0) - MARGIN, points.max(axis=0) + MARGIN
    box = (low[0], low[1], high[0], high[1])
    return find_loose(result.files[0].text, {0: diameter / 2}, THICKNESS, box)


def nested(count: int, x: float = 0.0, size: float = 90.0) -> list[Contour]:
    """Squares within each other, 10 mm apart."""
    contours = []
    for k in range(count):
        low, side = 10.0 * k, size - 20.0 * k
        contours.append(drawn.rectangle(x + low, low, side, side, f"{x:g}-{k}"))
    return contours


def draw(chance: random.Random) -> list[Contour]:
    """Parts beside each other, each with holes, some with a part in a hole."""
    contours = []
    for k in range(3):
        x, y, width = 60.0 * k, chance.uniform(0, 10), chance.uniform(38, 48)
        contours.append(drawn.rectangle(x, y, width, width, f"part{k}"))
        middle = x + width / 2, y + width / 2
        radius = chance.uniform(2.0, width / 2 - 4)
        contours.append(drawn.circle(*middle, radius, f"hole{k}"))
        if radius > 12:
            contours.append(drawn.circle(*middle, radius - chance.uniform(4, 8), f"inner{k}"))
    return contours


@pytest.mark.parametrize("seed", range(6))
def test_a_flood_fill_finds_the_same_pieces(seed: int) -> None:
    chance = random.Random(seed)
    tabs = {"operation__tabs": 2, "operation__tab_width": 2.0} if seed % 2 else {}
    result = build(draw(chance), **tabs)
    assert result.proof is not None
    chip = math.pi * 1.5**2
    regions = [region for region in flood(result) if region.area > chip]
    pieces = sorted(
        (piece for piece in result.proof.pieces.loose), key=lambda piece: -piece.shape.area
    )
    assert len(pieces) == len(regions)
    for piece, region in zip(pieces, regions, strict=True):
        # A cell at the rim is in or out as a whole.
        assert piece.shape.area == pytest.approx(region.area, abs=0.1 * piece.shape.length)
        assert shapely.distance(piece.shape.envelope, shapely.Point(region.x, region.y)) < 0.1


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5])
def test_parts_in_windows_are_held_down_to_any_depth(count: int) -> None:
    contours = nested(count)
    tabs = {"operation__tabs": 3, "operation__tab_width": 3.0, "stock__held": "frame"}
    result = build(contours, **tabs)
    chip = math.pi * 1.5**2
    # The slug of the innermost hole has no part in it.
    slugs = [region for region in flood(result) if region.area > chip]
    assert len(slugs) == (count % 2 == 0)
    assert len(result.proof.pieces.loose) == len(slugs)  # type: ignore[union-attr]
    with pytest.raises(NoSafeProgram, match=r"comes loose at its last cut, .*: nothing holds it"):
        build(contours, stock__held="frame")


def test_the_part_that_is_not_held_is_named_among_several() -> None:
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
    # It is taken narrower by 0.01 mm.
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
    assert flood(result) == []


@pytest.mark.parametrize(
    ("margin", "held", "is_refused"),
    [
        (0.0, "frame", True),
        (0.0, "vacuum", False),
        (2.9, "frame", True),
        (8.0, "frame", False),
    ],
)
def test_a_bridge_to_no_stock_holds_nothing(margin: float, held: str, is_refused: bool) -> None:
    contours = [drawn.rectangle(0, 0, 40, 40, "c1")]
    changes = {"stock__margin": margin, "stock__held": held, "operation__tabs": 3}
    if is_refused:
        with pytest.raises(NoSafeProgram, match=r"leave no frame of the stock.*stock\.margin"):
            build(contours, **changes)
    else:
        assert build(contours, **changes).proof is not None


@pytest.mark.parametrize(("room", "is_refused"), [(2.0, True), (9.0, False)])
def test_the_outline_of_the_stock_is_the_frame(room: float, is_refused: bool) -> None:
    side = 40 + 2 * room
    blank = drawn.rectangle(-room, -room, side, side, "blank")
    contours = [drawn.rectangle(0, 0, 40, 40, "c1")]
    whole = Part("part", "part.dxf", "mm", (*contours, _on_layer(blank, "stock")), ())
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


def _on_layer(contour: Contour, layer: str) -> Contour:
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


# By hand.


def judge(
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


OUTLINE = task(part(square("c1", 0, 40)))
WAY = around(0, 40, 3.0, -5.0)


def lift(start: float, width: float) -> list[Instruction]:
    """The way around with a bridge of a width on its first line."""
    end = start + width + MILL.diameter
    over = [feed(start, -3, -5), feed(start, -3, -4), feed(end, -3, -4), feed(end, -3, -5)]
    return [*WAY[:2], *over, *WAY[2:]]


@pytest.mark.parametrize(("width", "count"), [(5.0, 0), (0.5, 0), (0.03, 0), (0.01, 1), (0.0, 1)])
def test_a_bridge_holds_down_to_the_width_of_a_thread(width: float, count: int) -> None:
    assert len(judge(lift(10.0, width)).unheld) == count


@pytest.mark.parametrize(("skin", "count"), [(0.2, 0), (0.01, 0), (0.0, 1), (-0.5, 1)])
def test_a_skin_holds(skin: float, count: int) -> None:
    body = around(0, 40, 3.0, skin - 5.0)
    assert len(judge(body, tasks=[task(part(square("c1", 0, 40)), depth=6.0)]).unheld) == count


def test_two_tools_free_a_part_together() -> None:
    half = len(WAY) // 2
    # Each begins above the place where the other one ends.
    x, y, _ = WAY[half].target.origin  # type: ignore[union-attr]
    first = [*WAY[: half + 1], rapid(x, y, 5)]
    second = [rapid(x, y, 5), feed(x, y, -5), *WAY[half + 1 :]]
    tools = [MILL, ToolTable(diameter=6.0, number=2)]
    assert judge(first).unheld == judge(second).unheld == ()
    (fault,) = judge(first, second, tools=tools).unheld
    assert fault.cut == 1
    assert "within c1" in fault.text


def test_a_pocket_that_eats_the_bridge_frees_the_part() -> None:
    body = lift(10.0, 4.0)
    eats = [rapid(8, -3, 5), feed(8, -3, -5), feed(26, -3, -5), rapid(26, -3, 5)]
    assert judge(body).unheld == ()
    (fault,) = judge(body, eats).unheld
    assert (fault.cut, fault.line) == (1, 3)


def test_a_tab_that_is_not_there_is_counted() -> None:
    two = task(part(square("c1", 0, 40)), tabs=2, tab_width=4.0)
    (fault,) = judge(lift(10.0, 4.0), tasks=[two]).unheld
    assert fault.text == "1 tab on c1, the job asks for 2"
    single = task(part(square("c1", 0, 40)), tabs=1, tab_width=4.0)
    assert judge(lift(10.0, 4.0), tasks=[single]).unheld == ()
    (fault,) = judge(WAY, tasks=[single]).unheld
    assert fault.text.endswith("no tab is left that holds it")


def test_what_is_left_and_should_be_gone_is_left_out() -> None:
    # The job asks for no bridge.
    (note,) = note_pieces(judge(lift(10.0, 5.0)), Job())
    assert (note.kind, note.fails_strict) == ("skipped", True)
    match = re.match(r"([\d.]+) mm2 not cut at z -5, up to ([\d.]+) mm wide", note.what)
    assert match
    # The strip of 6 mm is 5 mm long in its middle, and longer by what the round tool leaves.
    round_mm2 = 2 * (3 * 6 - math.pi * 9 / 2)
    assert float(match[1]) == pytest.approx(5 * 6 + round_mm2, abs=0.1)
    assert note_pieces(judge(WAY, tasks=[OUTLINE]), Job()) == ()


def test_a_tab_of_a_window_and_of_its_part_is_counted() -> None:
    drawing = part(square("c1", -60, 60), square("c2", -40, 40), square("c3", -20, 20))
    wanted = task(drawing, tabs=2, tab_width=4.0)
    window = [(-37, -37), (37, -37), (37, 37), (-37, 37), (-37, -37)]
    passes = {
        "c1": around(-60, 60, 3.0, -5.0),
        "c2": [rapid(-37, -37, 5), *(feed(x, y, -5) for x, y in window)],
        "c3": around(-20, 20, 3.0, -5.0),
    }
    for name in passes:
        bodies = []
        for contour, body in passes.items():
            bridges = 1 if contour == name else 2
            bodies.append([*lift_again(body, contour, bridges), rapid(0, 0, 20)])
        faults = judge(*bodies, tasks=[wanted]).unheld
        assert [fault.text for fault in faults] == [f"1 tab on {name}, the job asks for 2"]


def lift_again(body: Sequence[Instruction], contour: str, count: int) -> list[Instruction]:
    """The way around a contour with bridges of 4 mm on its first line."""
    y = {"c1": -63.0, "c2": -37.0, "c3": -23.0}[contour]
    lifted = list(body[:2])
    for x in (-15.0, 5.0)[:count]:
        heights = ((x, -5), (x, -4), (x + 10, -4), (x + 10, -5))
        lifted += [feed(place, y, z) for place, z in heights]
    return [*lifted, *body[2:]]


def test_a_slug_to_which_the_tool_comes_back_is_serious_and_not_refused() -> None:
    drawing = task(part(square("c1", -40, 40), disc("c2", 0, 0, 15.0)))
    ring = circle(0, 0, 12.0, -5.0)
    slug = judge(ring, tasks=[drawing]).loose
    assert [(fault.serious, "slug" in fault.text) for fault in slug] == [(False, True)]
    # Again along the slug's rim: the tool reaches to 8.9 mm from the middle, and the slug to 9 mm.
    again = judge(ring, circle(0, 0, 11.9, -5.0), tasks=[drawing])
    assert [(fault.serious, fault.kind) for fault in again.loose] == [(True, "loose")]
    assert again.refused == ()


def test_a_clamp_holds_what_reaches_under_it() -> None:
    from camgen.check.stock.clear import index_motions  # noqa: PLC0415
    from camgen.check.stock.moves import tabulate  # noqa: PLC0415

    cuts = [Cut(WAY, range(1, len(WAY) + 1), MILL, "p.ngc")]
    gone, wanted = index_motions(tabulate(cuts), cuts), design([OUTLINE], StockTable(thickness=5.0))
    assert len(find_pieces(gone, wanted).loose) == 1
    assert find_pieces(gone, wanted, shapely.box(35, 15, 60, 25)).loose == ()
    assert len(find_pieces(gone, wanted, shapely.box(46, 15, 60, 25)).loose) == 1
