"""Charts of materials: their values in mm, interpolation, and recommendations."""

import math
from typing import get_args

import pytest

from camgen.model.job import MaterialName, ToolTable
from camgen.model.materials import MATERIALS, find_charts, recommend

MILL = ToolTable(diameter=6.35)


def test_each_name_of_the_job_is_a_material() -> None:
    assert tuple(MATERIALS) == get_args(MaterialName)


def test_a_feed_of_the_chart_is_in_mm() -> None:
    """HIT: 6061 at 1/4 inch has 0.0010 to 0.0022 inch per tooth."""
    chart, speeds = find_charts(MATERIALS["aluminium"], MILL)
    assert chart
    assert speeds
    assert chart.lowest(6.35) == pytest.approx(0.0254)
    assert chart.highest(6.35) == pytest.approx(0.05588)
    # 800 to 2200 feet per minute on a circle of 6.35 mm.
    circumference = math.pi * 6.35 / 304.8
    assert speeds.turns(6.35) == pytest.approx((800 / circumference, 2200 / circumference))


def test_feeds_are_linear_between_diameters_and_below_the_first() -> None:
    chart, _ = find_charts(MATERIALS["plywood"], MILL)
    assert chart
    # AST: 0.005 inch at 1/8, 0.009 at 1/4, 0.021 at 1/2 and wider.
    assert chart.highest(4.7625) == pytest.approx(0.007 * 25.4)
    assert chart.highest(1.5875) == pytest.approx(0.0025 * 25.4)
    assert chart.highest(50.0) == pytest.approx(0.021 * 25.4)


@pytest.mark.parametrize("name", MATERIALS)
def test_recommendations_keep_the_charts(name: str) -> None:
    material = MATERIALS[name]
    for diameter in (1.0, 3.0, 6.0, 12.0, 30.0):
        tool = ToolTable(diameter=diameter, flutes=3)
        chart, speeds = find_charts(material, tool)
        cutting = recommend(material, tool, 24_000)
        assert chart
        assert cutting
        tooth = cutting.feed * 60 / cutting.speed / 3
        assert chart.lowest(diameter) == pytest.approx(tooth)
        assert tooth <= chart.highest(diameter) * (1 + 1e-9)
        assert cutting.speed <= 24_000
        assert speeds is None or cutting.speed <= speeds.turns(diameter)[1]
        assert cutting.plunge == pytest.approx(cutting.feed / 3)


def test_a_drill_is_of_high_speed_steel_by_default() -> None:
    """HIT, steel at 1/4 inch: HSS 125 feet per minute, carbide 290; both 0.006 inch per turn."""
    steel = MATERIALS["steel"]
    hss = recommend(steel, ToolTable(kind="drill", diameter=6.35), 24_000)
    carbide = recommend(steel, ToolTable(kind="drill", diameter=6.35, material="carbide"), 24_000)
    assert hss
    assert carbide
    assert carbide.speed / hss.speed == pytest.approx(290 / 125)
    assert hss.feed * 60 / hss.speed == pytest.approx(0.006 * 25.4)
    assert hss.plunge == hss.feed


def test_a_tool_that_does_not_rotate_and_a_drill_in_wood_have_no_chart() -> None:
    assert recommend(MATERIALS["steel"], ToolTable(kind="laser"), 24_000) is None
    assert recommend(MATERIALS["mdf"], ToolTable(kind="drill"), 24_000) is None


def test_the_spindle_keeps_the_maximum_speed_of_the_tool() -> None:
    cutting = recommend(MATERIALS["mdf"], ToolTable(max_speed=9000.0), 24_000)
    assert cutting
    assert cutting.speed == 9000
