"""Tools of a proposal: tools of a library that fit, with feeds and speeds of charts."""

from __future__ import annotations

import math

import pytest

from camgen.model.job import StockTable, ToolRow
from camgen.model.materials import MATERIALS, find_charts
from camgen.model.part import Contour
from camgen.plan.propose import Proposal, propose
from camgen.plan.proposed_tools import ToolRack
from camgen.read.made import make_part
from tests.plan.test_propose import box, circle

#: Tools of a shop. All values of the drill are known, and few of the mill.
DRILL = ToolRow(name="HSS 5", number=4, kind="drill", diameter=5.0, speed=2000.0, feed=3.0)
MILL = ToolRow(name="long 3", number=12, diameter=3.0, flutes=3, speed=12_000.0)


def propose_for(*contours: Contour, library: tuple[ToolRow, ...], **stock: object) -> Proposal:
    table = StockTable(**stock)  # type: ignore[arg-type]
    proposal = propose(make_part(list(contours)), table, library)
    assert proposal
    return proposal


def list_tool_names(proposal: Proposal) -> list[object]:
    return [operation.row["tool"] for operation in proposal.operations]


def test_tools_of_the_library_are_taken_before_new_ones() -> None:
    plate = (box(0, 0, 100, 60), circle(20, 20, 5), circle(80, 20, 8))
    proposal = propose_for(*plate, library=(DRILL, MILL))
    assert list_tool_names(proposal) == ["HSS 5", "drill 8", "long 3"]
    new, mill = (tool.row for tool in proposal.tools)
    # New tools have the next number after those of the library.
    assert (new["name"], new["number"], new["diameter"]) == ("drill 8", 13, 8.0)
    # The library states the speed of the mill, but no feed.
    assert set(mill) == {"name", "feed", "plunge"}


def test_a_slightly_smaller_drill_fits_and_a_larger_one_does_not() -> None:
    rack = ToolRack((DRILL,), None)
    assert rack.take("drill", 5.02) == "HSS 5"
    assert rack.take("drill", 5.0) == "HSS 5"
    assert rack.tools == ()
    assert rack.take("drill", 4.99) == "drill 4.99"
    assert rack.take("drill", 5.03) == "drill 5.03"
    assert [tool.row["number"] for tool in rack.tools] == [5, 6]


def test_a_new_tool_never_has_a_name_of_the_library() -> None:
    ball = ToolRow(name="mill 6", number=1, kind="ball mill", diameter=6.0)
    assert ToolRack((ball,), None).take("end mill", 6.0) == "mill 6 (2)"


def test_mills_of_the_library_are_tried_from_the_largest_down() -> None:
    library = [ToolRow(name=f"{d} mm", diameter=d) for d in (12.0, 3.175, 6.0, 8.0, 1.0)]
    assert ToolRack(library, None).mills == (12.0, 8.0, 6.0, 3.175, 1.0)
    assert ToolRack((DRILL,), None).mills == ToolRack((), None).mills


@pytest.mark.parametrize("name", MATERIALS)
@pytest.mark.parametrize("kind", ["drill", "end mill"])
def test_feeds_and_speeds_are_those_of_the_charts(name: str, kind: str) -> None:
    """They are rounded by less than 1 %, and never above the speed or the feed of the chart."""
    material = MATERIALS[name]
    for diameter in (1.0, 3.0, 6.0, 12.0):
        rack = ToolRack((), material)
        rack.take(kind, diameter)  # type: ignore[arg-type]
        (tool,) = rack.tools
        row = ToolRow(**tool.row)  # type: ignore[arg-type]
        assert row.speed
        assert row.feed
        chart, speeds = find_charts(material, row)
        if chart is None:
            why = f"placeholder, that of steel: no chart of {name} for a {kind}"
            assert set(tool.comments.values()) == {why}
            continue
        edges = 1 if kind == "drill" else row.flutes
        tooth = row.feed * 60 / row.speed / edges
        assert tooth == pytest.approx(chart.lowest(diameter), rel=0.01)
        assert tooth <= chart.highest(diameter) * 1.005
        assert tool.comments["feed"].startswith(chart.source)
        assert row.speed <= min(10_000, speeds.turns(diameter)[1] if speeds else math.inf)
        limited = "no chart" not in tool.comments["speed"]
        assert limited == (speeds is not None)
        # A drill goes down at its feed, a mill at a third of it.
        assert row.plunge == (None if kind == "drill" else pytest.approx(row.feed / 3, abs=0.01))


def test_the_centre_of_the_tool_keeps_the_feed_of_a_chart() -> None:
    """Otherwise it would run at up to twice the feed around outer corners."""
    plate = box(0, 0, 100, 60)
    known = propose_for(plate, library=(), material="plywood")
    unknown = propose_for(plate, library=())
    assert known.operations[0].row["max_feed_factor"] == 1.0
    assert "max_feed_factor" not in unknown.operations[0].row
