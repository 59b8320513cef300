"""What the page is told of the stock and of the tools that cut it."""

from __future__ import annotations

import base64

import cv2
import numpy as np
import pytest
from msgspec.structs import replace
from shapely import Polygon

import camgen
from camgen.model.job import ToolTable
from camgen.model.pose import frozen
from camgen.preview.page import format_page
from camgen.preview.png import draw_png
from camgen.preview.stock import Mark, compute_profile
from camgen.preview.view import View, make_view
from tests.preview.test_page import PARTS, data, unpack

MILLED: dict[str, object] = {
    "operation": {"depth": 6.0, "passes": 3},
    "tool": {"center_cutting": True},
    "process": {"spindle": 9000.0},
}

#: A tool that rounds edges: it presses on what is there.
PRESSED: dict[str, object] = {
    "operation": {"depth": 1.0},
    "process": {"force": 10.0},
    "tool": {"orient": "follow"},
    "post": {"force_calibrated": True},
}
DRILLED: dict[str, object] = {"kind": "drill", "tool": 1, "depth": 7.0, "holes": [5.4, 5.6]}
SEVERAL: dict[str, object] = {
    "tools": [
        {"name": "mill 6", "number": 2, "diameter": 6.0, "speed": 12000.0, "feed": 15.0},
        {
            "name": "drill 5",
            "number": 1,
            "kind": "drill",
            "diameter": 5.0,
            "speed": 3000.0,
            "feed": 3.0,
        },
    ],
    "operations": [
        {"kind": "follow", "tool": "mill 6", "nesting": "outer", "depth": 6.0, "passes": 3},
        DRILLED,
    ],
}


def shown(job: dict[str, object], part: str = "bracket.dxf", post: str = "gcode") -> View:
    return make_view(camgen.build(PARTS / part, post=post, job=job))


def height(tool: ToolTable, radius: float) -> float:
    return float(np.interp(radius, *zip(*compute_profile(tool), strict=True)))


@pytest.mark.parametrize(
    ("tool", "radius", "expected"),
    [
        (ToolTable(diameter=6.0), 2.9, 0.0),
        # A sphere of 3 mm is 3 - sqrt(9 - r^2) above its lowest point.
        (ToolTable(kind="ball mill", diameter=6.0), 1.8, 0.6),
        (ToolTable(kind="ball mill", diameter=6.0), 3.0, 3.0),
        # The corner of a bull nose begins at 3 - 1 mm: 1 - sqrt(1 - 0.6^2) above it.
        (ToolTable(kind="bull nose", diameter=6.0, corner_radius=1.0), 2.0, 0.0),
        (ToolTable(kind="bull nose", diameter=6.0, corner_radius=1.0), 2.6, 0.2),
        # 90 deg: as high as wide, from the flat on.
        (ToolTable(kind="v", diameter=6.0), 2.0, 2.0),
        (ToolTable(kind="v", diameter=6.0, tip_diameter=1.0), 2.0, 1.5),
        (ToolTable(kind="v", diameter=6.0, tip_angle=60.0), 1.0, 3**0.5),
        # 118 deg: r / tan 59 deg.
        (ToolTable(kind="drill", diameter=6.0), 3.0, 1.80258),
    ],
)
def test_the_outline_of_a_tool_is_that_of_its_kind(
    tool: ToolTable, radius: float, expected: float
) -> None:
    # Round ones are chords of 90 / 23 deg, within 3 (1 - cos 2 deg) mm.
    assert height(tool, radius) == pytest.approx(expected, abs=0.003)
    assert compute_profile(tool)[-1][0] == tool.diameter / 2


@pytest.mark.parametrize("kind", ["laser", "plasma", "knife", "pen"])
def test_a_tool_without_a_shape_of_its_own_has_no_outline(kind: str) -> None:
    assert compute_profile(ToolTable(kind=kind)) == ()  # type: ignore[arg-type]


def test_the_stock_is_the_part_with_a_margin_and_as_thick_as_the_job_says() -> None:
    # bracket.dxf is 80 x 50 mm.
    found = shown(MILLED | {"stock": {"thickness": 8.0, "margin": 7.0}})
    assert found.stock is not None
    assert found.stock.low.tolist() == pytest.approx([-7, -7, -8])
    assert found.stock.high.tolist() == pytest.approx([87, 57, 0])
    assert dict(found.facts)["Stock"] == "94 x 64 x 8 mm"


def test_without_a_thickness_the_stock_is_as_thick_as_the_program_is_deep_and_the_page_says_so() -> (
    None
):
    found = shown(MILLED)
    assert found.stock is not None
    assert found.stock.low[2] == -6
    assert "stock.thickness is not set" in dict(found.facts)["Stock"]


def test_the_outline_of_the_stock_may_be_drawn() -> None:
    drilled = {"tools": SEVERAL["tools"], "operations": [DRILLED]}
    found = shown(drilled | {"stock": {"layer": "OUTLINE", "thickness": 7.0}}, "motor.dxf")
    assert found.stock is not None
    assert found.stock.low[:2].tolist() == pytest.approx([0, 0])
    assert found.stock.high[:2].tolist() == pytest.approx([120, 90])


@pytest.mark.parametrize(
    ("part", "job"),
    [
        ("bracket.dxf", {}),
        ("bracket.dxf", {"operation": {"kind": "trace"}}),
        # Presses on edges that are there.
        ("bracket.dxf", PRESSED),
        ("bracket.dxf", MILLED | {"process": {"switch": "contact"}, "tool": {"kind": "laser"}}),
        ("space.dxf", {"operation": {"kind": "trace"}}),
    ],
)
def test_a_job_that_takes_no_material_away_from_above_has_no_stock(
    part: str, job: dict[str, object]
) -> None:
    found = shown(job, part, "rapid")
    assert found.stock is None
    assert "Stock" not in dict(found.facts)
    plain = data(format_page(found))
    assert not {"stock", "tools", "tool_of", "marks"} & set(plain)


def test_a_page_without_a_stock_has_not_the_script_that_plays_the_cut() -> None:
    with_, without = format_page(shown(MILLED)), format_page(shown({}))
    assert "function carve(" in with_
    assert "function carve(" not in without


def test_every_motion_has_the_tool_that_is_in_the_spindle() -> None:
    found = shown(SEVERAL, "motor.dxf")
    assert [(tool.name, tool.diameter) for tool in found.tools] == [
        ("drill 5", 5.0),
        ("mill 6", 6.0),
    ]
    # The one of a path is that of its operation.
    events = found.track.events
    names = [found.tools[tool].name for tool in found.tool_of.tolist()]
    work = [
        (names[k], found.rows[path].operation)
        for k, path in enumerate(events.path.tolist())
        if path >= 0
    ]
    assert all(name in operation for name, operation in work)
    # Two runs: the drill goes home before it is changed, and the mill comes from there.
    change = int(np.argmax(found.tool_of))
    assert set(found.tool_of[:change].tolist()) == {0}
    assert set(found.tool_of[change:].tolist()) == {1}
    assert events.start[change].tolist() == events.end[0].tolist()
    assert [label for label, _ in found.facts if label.startswith("Tool ")] == ["Tool 1", "Tool 2"]


def test_tools_and_stock_are_in_the_page() -> None:
    plain = data(format_page(shown(SEVERAL | {"stock": {"thickness": 8.0}}, "motor.dxf")))
    origin = plain["origin"]
    low, high = (np.add(plain["stock"][name], origin) for name in ("low", "high"))  # type: ignore[index]
    # motor.dxf is 120 x 90 mm; 10 mm around it.
    assert low.tolist() == pytest.approx([-10, -10, -8])
    assert high.tolist() == pytest.approx([130, 100, 0])
    assert [tool["diameter"] for tool in plain["tools"]] == [5.0, 6.0]  # type: ignore[attr-defined]
    assert set(unpack(plain["tool_of"], "u1").tolist()) == {0, 1}  # type: ignore[arg-type]
    assert plain["paths"][0]["operation"].startswith("1 drill")  # type: ignore[index]


def test_a_mark_is_in_the_page_with_its_outline_and_its_fill() -> None:
    # An L of 10 x 10 mm, 3 mm wide: 3 * 10 + 3 * 7 mm2.
    corners = frozen([(0, 0), (10, 0), (10, 3), (3, 3), (3, 10), (0, 10)])
    plain = data(
        format_page(
            replace(shown(MILLED), marks=(Mark("gouge", corners, -2.0, 0.125, "of </script> c1"),))
        )
    )
    (mark,) = plain["marks"]  # type: ignore[misc]
    assert (mark["kind"], mark["number"], mark["text"]) == ("gouge", 0.125, "of </script> c1")
    outline, fill = (
        np.frombuffer(base64.b64decode(mark[name]), "<f4").reshape(-1, 3) + plain["origin"]
        for name in ("outline", "triangles")
    )
    assert outline[:, :2].tolist() == [*corners.tolist(), [0, 0]]
    assert (fill[:, 2] == -2).all()
    a, b, c = (fill[k::3, :2] for k in range(3))
    (ux, uy), (vx, vy) = (b - a).T, (c - a).T
    assert np.abs(ux * vy - uy * vx).sum() / 2 == pytest.approx(51)


def test_what_the_proof_finds_to_be_left_is_marked_the_widest_first() -> None:
    # No path bends by less than 8 mm: two holes of 8 mm and a slot of 30 x 10 mm stay where they are.
    found = shown(
        {"operation": {"depth": 1.0, "corner_radius": 8.0}, "process": {"spindle": 9000.0}}
    )
    assert [mark.kind for mark in found.marks] == ["excess"] * 3
    assert [mark.width for mark in found.marks] == pytest.approx([10, 8, 8], abs=0.05)
    areas = [Polygon(mark.polygon).area for mark in found.marks]
    assert areas == pytest.approx([20 * 10 + np.pi * 25, np.pi * 16, np.pi * 16], rel=2e-3)
    assert "up to 10 mm wide" in found.marks[0].text
    marks = data(format_page(found))["marks"]
    assert [mark["kind"] for mark in marks] == ["excess"] * 3  # type: ignore[attr-defined]
    assert not shown(MILLED).marks


def test_the_fill_of_a_mark_has_its_holes() -> None:
    square, hole = (
        [(x, y), (x + w, y), (x + w, y + w), (x, y + w)] for x, y, w in ((0, 0, 10), (4, 4, 2))
    )
    mark = Mark("excess", frozen(square), 0.0, 1.0, "", (frozen(hole),))
    (plain,) = data(format_page(replace(shown(MILLED), marks=(mark,))))["marks"]  # type: ignore[misc]
    fill = np.frombuffer(base64.b64decode(plain["triangles"]), "<f4").reshape(-1, 3, 3)
    assert sum(Polygon(corners).area for corners in fill[..., :2]) == pytest.approx(96)


def test_the_tool_of_the_page_of_a_job_with_several_is_the_first_that_is_used() -> None:
    found = shown(SEVERAL, "motor.dxf")
    assert found.diameter == 5.0
    assert format_page(found) == format_page(shown(SEVERAL, "motor.dxf"))


def test_where_tabs_stand_is_noted_and_not_wrong() -> None:
    found = shown(MILLED | {"operation": {"depth": 6.0, "passes": 3, "tabs": 4}})
    rings = [line for line in found.lines if line.state in ("noted", "wrong")]
    assert [line.state for line in rings] == ["noted"] * 4
    assert all("tabs" in line.why for line in rings)


def test_the_picture_shows_what_is_left_in_amber() -> None:
    found = shown(
        {"operation": {"depth": 1.0, "corner_radius": 8.0}, "process": {"spindle": 9000.0}}
    )
    marked, plain = (
        cv2.imdecode(np.frombuffer(draw_png(one), np.uint8), 1)
        for one in (found, replace(found, marks=()))
    )
    amber = (np.abs(marked.astype(int) - (0, 160, 245)).max(axis=2) < 8).sum()
    assert not (np.abs(plain.astype(int) - (0, 160, 245)).max(axis=2) < 8).any()
    # The picture is as wide as the part and its paths: the share of it that three marks have.
    (x,) = {
        round(
            float(
                np.ptp(found.track.position[found.track.events.path[found.track.event] >= 0][:, 0])
            ),
            3,
        )
    }
    per_mm = 1480 / x
    area = sum(Polygon(mark.polygon).area for mark in found.marks)
    assert amber == pytest.approx(area * per_mm**2, rel=0.25)
