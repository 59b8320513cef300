"""The stock and the tools in the data of the page."""

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
from tests.preview.test_page import PARTS, read_data, unpack

MILLED: dict[str, object] = {
    "operation": {"depth": 6.0, "passes": 3},
    "tool": {"center_cutting": True},
    "process": {"spindle": 9000.0},
}

#: A tool in contact rounds edges and removes no material from above.
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


def make_view_of(job: dict[str, object], part: str = "bracket.dxf", post: str = "gcode") -> View:
    """The view of a part that is built with a job."""
    return make_view(camgen.build(PARTS / part, post=post, job=job))


def interpolate_height(tool: ToolTable, radius: float) -> float:
    """Height of the profile of a tool at a distance from its axis, mm."""
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
def test_the_profile_of_a_tool_is_that_of_its_kind(
    tool: ToolTable, radius: float, expected: float
) -> None:
    # Round profiles are chords of 90 / 23 deg, which deviate by less than 3 (1 - cos 2 deg) mm.
    assert interpolate_height(tool, radius) == pytest.approx(expected, abs=0.003)
    assert compute_profile(tool)[-1][0] == tool.diameter / 2


@pytest.mark.parametrize("kind", ["laser", "plasma", "knife", "pen"])
def test_a_tool_without_a_cutting_shape_has_no_profile(kind: str) -> None:
    assert compute_profile(ToolTable(kind=kind)) == ()


def test_the_stock_is_the_part_with_a_margin_and_the_thickness_of_the_job() -> None:
    # bracket.dxf is 80 x 50 mm.
    view = make_view_of(MILLED | {"stock": {"thickness": 8.0, "margin": 7.0}})
    assert view.stock is not None
    assert view.stock.low.tolist() == pytest.approx([-7, -7, -8])
    assert view.stock.high.tolist() == pytest.approx([87, 57, 0])
    assert dict(view.facts)["Stock"] == "94 x 64 x 8 mm"


def test_without_a_thickness_the_stock_is_as_thick_as_the_program_is_deep() -> None:
    view = make_view_of(MILLED)
    assert view.stock is not None
    assert view.stock.low[2] == -6
    assert "stock.thickness is not set" in dict(view.facts)["Stock"]


def test_the_outline_of_the_stock_may_be_a_layer_of_the_drawing() -> None:
    drilled = {"tools": SEVERAL["tools"], "operations": [DRILLED]}
    view = make_view_of(drilled | {"stock": {"layer": "OUTLINE", "thickness": 7.0}}, "motor.dxf")
    assert view.stock is not None
    assert view.stock.low[:2].tolist() == pytest.approx([0, 0])
    assert view.stock.high[:2].tolist() == pytest.approx([120, 90])


@pytest.mark.parametrize(
    ("part", "job"),
    [
        ("bracket.dxf", {}),
        ("bracket.dxf", {"operation": {"kind": "trace"}}),
        # In contact with existing edges.
        ("bracket.dxf", PRESSED),
        ("bracket.dxf", MILLED | {"process": {"switch": "contact"}, "tool": {"kind": "laser"}}),
        ("space.dxf", {"operation": {"kind": "trace"}}),
    ],
)
def test_a_job_that_removes_no_material_from_above_has_no_stock(
    part: str, job: dict[str, object]
) -> None:
    view = make_view_of(job, part, "rapid")
    assert view.stock is None
    assert "Stock" not in dict(view.facts)
    plain = read_data(format_page(view))
    assert not {"stock", "tools", "tool_of", "marks"} & set(plain)


def test_a_page_without_a_stock_has_no_script_for_the_cut() -> None:
    with_stock, without = format_page(make_view_of(MILLED)), format_page(make_view_of({}))
    assert "function carve(" in with_stock
    assert "function carve(" not in without


def test_each_motion_has_the_tool_in_the_spindle() -> None:
    view = make_view_of(SEVERAL, "motor.dxf")
    assert [(tool.name, tool.diameter) for tool in view.tools] == [
        ("drill 5", 5.0),
        ("mill 6", 6.0),
    ]
    # The tool of a path is that of its operation.
    events = view.track.events
    names = [view.tools[tool].name for tool in view.tool_of.tolist()]
    work = [
        (names[k], view.rows[path].operation)
        for k, path in enumerate(events.path.tolist())
        if path >= 0
    ]
    assert all(name in operation for name, operation in work)
    # The drill goes home before it is changed, and the mill starts from home.
    change = int(np.argmax(view.tool_of))
    assert set(view.tool_of[:change].tolist()) == {0}
    assert set(view.tool_of[change:].tolist()) == {1}
    assert events.start[change].tolist() == events.end[0].tolist()
    assert [label for label, _ in view.facts if label.startswith("Tool ")] == ["Tool 1", "Tool 2"]


def test_tools_and_stock_are_in_the_page() -> None:
    plain = read_data(
        format_page(make_view_of(SEVERAL | {"stock": {"thickness": 8.0}}, "motor.dxf"))
    )
    origin = plain["origin"]
    low, high = (np.add(plain["stock"][name], origin) for name in ("low", "high"))
    # motor.dxf is 120 x 90 mm; the margin is 10 mm.
    assert low.tolist() == pytest.approx([-10, -10, -8])
    assert high.tolist() == pytest.approx([130, 100, 0])
    assert [tool["diameter"] for tool in plain["tools"]] == [5.0, 6.0]
    assert set(unpack(plain["tool_of"], "u1").tolist()) == {0, 1}
    assert plain["paths"][0]["operation"].startswith("1 drill")


def test_a_mark_is_in_the_page_with_its_outline_and_its_fill() -> None:
    # An L of 10 x 10 mm, 3 mm wide: 3 * 10 + 3 * 7 mm2.
    corners = frozen([(0, 0), (10, 0), (10, 3), (3, 3), (3, 10), (0, 10)])
    plain = read_data(
        format_page(
            replace(
                make_view_of(MILLED),
                marks=(Mark("gouge", corners, -2.0, 0.125, "of </script> c1"),),
            )
        )
    )
    (mark,) = plain["marks"]
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


def test_rest_material_of_the_proof_is_marked_the_widest_first() -> None:
    # With corner_radius 8 mm no path fits into two holes of 8 mm and a slot of 30 x 10 mm.
    view = make_view_of(
        {"operation": {"depth": 1.0, "corner_radius": 8.0}, "process": {"spindle": 9000.0}}
    )
    assert [mark.kind for mark in view.marks] == ["excess"] * 3
    assert [mark.width for mark in view.marks] == pytest.approx([10, 8, 8], abs=0.05)
    areas = [Polygon(mark.polygon).area for mark in view.marks]
    assert areas == pytest.approx([20 * 10 + np.pi * 25, np.pi * 16, np.pi * 16], rel=2e-3)
    assert "up to 10 mm wide" in view.marks[0].text
    marks = read_data(format_page(view))["marks"]
    assert [mark["kind"] for mark in marks] == ["excess"] * 3
    assert not make_view_of(MILLED).marks


def test_the_fill_of_a_mark_has_its_holes() -> None:
    square, hole = (
        [(x, y), (x + w, y), (x + w, y + w), (x, y + w)] for x, y, w in ((0, 0, 10), (4, 4, 2))
    )
    mark = Mark("excess", frozen(square), 0.0, 1.0, "", (frozen(hole),))
    (plain,) = read_data(format_page(replace(make_view_of(MILLED), marks=(mark,))))["marks"]
    fill = np.frombuffer(base64.b64decode(plain["triangles"]), "<f4").reshape(-1, 3, 3)
    assert sum(Polygon(corners).area for corners in fill[..., :2]) == pytest.approx(96)


def test_the_page_of_a_job_with_several_tools_begins_with_the_first_used_tool() -> None:
    view = make_view_of(SEVERAL, "motor.dxf")
    assert view.diameter == 5.0
    assert format_page(view) == format_page(make_view_of(SEVERAL, "motor.dxf"))


def test_tabs_are_noted_and_not_wrong() -> None:
    view = make_view_of(MILLED | {"operation": {"depth": 6.0, "passes": 3, "tabs": 4}})
    rings = [line for line in view.lines if line.state in ("noted", "wrong")]
    assert [line.state for line in rings] == ["noted"] * 4
    assert all("tabs" in line.why for line in rings)


def test_the_picture_shows_rest_material_in_amber() -> None:
    view = make_view_of(
        {"operation": {"depth": 1.0, "corner_radius": 8.0}, "process": {"spindle": 9000.0}}
    )
    marked, plain = (
        cv2.imdecode(np.frombuffer(draw_png(marked_view), np.uint8), 1)
        for marked_view in (view, replace(view, marks=()))
    )
    amber = (np.abs(marked.astype(int) - (0, 160, 245)).max(axis=2) < 8).sum()
    assert not (np.abs(plain.astype(int) - (0, 160, 245)).max(axis=2) < 8).any()
    # The width of the paths fills the picture between its borders, 1480 px.
    on_path = view.track.events.path[view.track.event] >= 0
    width_mm = round(float(np.ptp(view.track.position[on_path][:, 0])), 3)
    per_mm = 1480 / width_mm
    area = sum(Polygon(mark.polygon).area for mark in view.marks)
    assert amber == pytest.approx(area * per_mm**2, rel=0.25)
