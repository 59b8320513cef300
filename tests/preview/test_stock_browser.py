"""The cut as the page plays it: the heights that are left, against shapes of shapely and against every disc."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from msgspec.structs import replace

import camgen
from camgen.preview.page import format_page
from camgen.preview.stock import Mark
from camgen.preview.track import Track
from camgen.preview.view import View, make_view
from tests.preview.test_page import PARTS, changing
from tests.preview.test_stock import MILLED, SEVERAL
from tests.support.browsers import SMALL, Driven, OpenPage

Floats = np.ndarray[Any, np.dtype[np.float64]]
#: A slot of 30 x 10 mm along whose border a tool of 9 mm runs: it sweeps over most of what it leaves more than once.
POCKET = {
    "operation": {"kind": "trace", "depth": 3.0, "passes": 2},
    "process": {"spindle": 9000.0},
    "tool": {"diameter": 9.0},
    "stock": {"thickness": 8.0, "margin": 5.0},
}
GROOVE = {
    "operation": {"kind": "trace", "depth": 1.0},
    "process": {"spindle": 9000.0, "approach": 1.0},
    "tool": {"diameter": 6.0, "kind": "v"},
    "stock": {"thickness": 5.0},
}


@pytest.fixture(scope="module")
def views() -> dict[str, View]:
    jobs = {"profile": MILLED, "pocket": POCKET, "groove": GROOVE}
    found = {
        name: make_view(camgen.build(PARTS / "bracket.dxf", post="gcode", job=job))
        for name, job in jobs.items()
    }
    found["several"] = make_view(camgen.build(PARTS / "motor.dxf", post="gcode", job=SEVERAL))
    found["robot"] = make_view(camgen.build(PARTS / "bracket.dxf", post="rapid", job=changing()))
    # A tool of a few cells: the grid is as coarse for it as for no other.
    thin = MILLED | {"operation": {"kind": "trace", "depth": 2.0}, "tool": {"diameter": 0.5}}
    found["thin"] = make_view(camgen.build(PARTS / "motor.dxf", post="gcode", job=thin))
    found["dips"] = dip(found["profile"])
    corners = np.array([(20.0, 20), (60, 20), (60, 40), (20, 40)])
    found["marked"] = replace(found["profile"], marks=(Mark("gouge", corners, 0.0, 0.125, "c1"),))
    return found


def dip(shown: View) -> View:
    """Travel between two paths that goes 2 mm deep through the material instead of over it."""
    events, position = shown.track.events, shown.track.position.copy()
    free = (events.kind == 0)[shown.track.event]
    # The first one that is as high as travel is, and leads sideways.
    steps = np.hypot(*np.diff(position[:, :2], axis=0, prepend=position[:1, :2]).T)
    s = np.flatnonzero(free & (steps > 10) & (position[:, 2] == 20))[1]
    position[s - 1 : s + 1, 2] = -2.0
    return replace(shown, track=replace(shown.track, position=position))


@pytest.fixture
def opened(browser: Driven, views: dict[str, View], tmp_path: Path) -> Iterator[Any]:
    pages: list[OpenPage] = []

    def make(name: str, scheme: str = "light") -> OpenPage:
        file = tmp_path / f"{name}.html"
        file.write_text(format_page(views[name]), encoding="utf-8")
        pages.append(OpenPage(browser, file, SMALL, scheme))
        return pages[-1]

    yield make
    for one in pages:
        one.context.close()


@pytest.fixture(scope="module")
def shared(
    browser: Driven, views: dict[str, View], tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Any]:
    """Pages that are opened once for all tests that ask them for the surface at times of their own."""
    pages: dict[str, OpenPage] = {}
    folder = tmp_path_factory.mktemp("shared")

    def make(name: str) -> OpenPage:
        if name not in pages:
            file = folder / f"{name}.html"
            file.write_text(format_page(views[name]), encoding="utf-8")
            pages[name] = OpenPage(browser, file, SMALL, "light")
        return pages[name]

    yield make
    for one in pages.values():
        one.context.close()


#: To a time, and on until the surface is that of it, without waiting for the frames in between.
GO = """(time) => {
  const { player, cutting } = camgen;
  player.to(time);
  while (cutting.stock.time !== cutting.stock.wanted) cutting.stock.work();
}"""
FIELD = """() => {
  const { heights, struck, nx, ny, cell, low } = camgen.cutting.stock.field;
  const text = (values) => btoa(Array.from(new Uint8Array(values.buffer), (b) => String.fromCharCode(b)).join(""));
  return { heights: text(heights), struck: text(struck), nx, ny, cell, low };
}"""


class Surface:
    """What is left at a time: heights and struck (ny, nx), and the samples in the work frame."""

    def __init__(self, one: OpenPage, time: float) -> None:
        one.page.evaluate(GO, time)
        found = one.run(FIELD)
        shape = (found["ny"], found["nx"])
        self.heights = (
            np.frombuffer(base64.b64decode(found["heights"]), "<f4").reshape(shape).astype(float)
        )
        self.struck = np.frombuffer(base64.b64decode(found["struck"]), np.uint8).reshape(shape)
        self.cell = float(found["cell"])
        origin = one.run("camgen.data.origin")
        self.heights += origin[2]
        x, y = (found["low"][k] + origin[k] + self.cell * np.arange(shape[1 - k]) for k in (0, 1))
        self.x, self.y = np.meshgrid(x, y)


def ways(track: Track, until: float, z: float) -> shapely.Geometry:
    """Where the tool centre runs at a height, up to a time, without rapids."""
    at = track.position
    keep = (
        (np.diff(at[:, 2], prepend=99.0) == 0)
        & (np.abs(at[:, 2] - z) < 1e-9)
        & (track.time <= until)
    )
    keep &= track.events.kind[track.event] != 0
    found = shapely.union_all(
        [shapely.LineString(at[s - 1 : s + 1, :2]) for s in np.flatnonzero(keep)]
    )
    # Long chains that are prepared are measured three times as fast.
    merged = shapely.line_merge(found)
    shapely.prepare(merged)
    return merged


@pytest.mark.parametrize(("name", "radius", "share"), [("profile", 3.0, 0.5), ("pocket", 4.5, 1.0)])
def test_what_is_left_is_the_stock_less_the_swept_tool_level_by_level(
    shared: Any, views: dict[str, View], name: str, radius: float, share: float
) -> None:
    shown = views[name]
    until = share * float(shown.track.time[-1])
    # The end of a motion, so that no part of one is left over.
    until = float(shown.track.time[np.searchsorted(shown.track.time, until)])
    left = Surface(shared(name), until)
    expected = np.zeros_like(left.heights)
    wall = np.zeros(left.heights.shape, dtype=bool)
    points = shapely.points(left.x, left.y)
    levels = sorted({z for z in shown.track.position[:, 2].tolist() if z < 0}, reverse=True)
    assert len(levels) > 1
    for z in levels:
        away = shapely.distance(ways(shown.track, until, z), points)
        # The tool's own edge is a cell wide.
        wall |= np.abs(away - radius) < 0.55 * left.cell
        expected[away < radius] = z
    assert left.heights[~wall] == pytest.approx(expected[~wall], abs=1e-4)
    # Some of the stock is cut at every level or below, and some is not; walls are thin.
    assert (expected < 0).mean() > 0.02
    assert (expected == 0).mean() > 0.2
    assert wall.mean() < 0.12
    # The wall in between stands where the tool ran: the volume is that of the shapes.
    cut = -left.heights.sum() * left.cell**2
    above = [0.0, *levels]
    swept = [ways(shown.track, until, z).buffer(radius, quad_segs=64) for z in levels]
    exact = sum(
        (high - low) * shapely.union_all(swept[k:]).area
        for k, (high, low) in enumerate(pairwise(above))
    )
    assert cut == pytest.approx(exact, rel=0.01)


def test_a_v_tool_leaves_a_groove_with_its_angle(shared: Any, views: dict[str, View]) -> None:
    shown = views["groove"]
    end = float(shown.track.time[-1])
    left = Surface(shared("groove"), end)
    away = shapely.distance(ways(shown.track, end, -1.0), shapely.points(left.x, left.y))
    # 90 deg: as much higher as farther away.
    assert left.heights == pytest.approx(np.minimum(away - 1.0, 0.0), abs=0.02)
    assert left.heights.min() == pytest.approx(-1.0, abs=0.15)


#: A tool sweeps from one place to another in a stock of 40 x 20 x 10 mm, with a sample each 0.25 mm.
SWEEP = """([tool, from, to]) => {
  const { makeField, makeShape, carve } = camgen.cutting;
  const field = makeField({ low: [-10, -10, -10], high: [30, 10, 0] }, 0.25);
  carve(field, makeShape(tool, 0.25), from, to, false);
  return { heights: Array.from(field.heights), nx: field.nx, ny: field.ny };
}"""


@pytest.mark.parametrize(
    ("a", "b"), [((0, 0, 0), (20, 3, -2)), ((20, 0, -4), (3, -4, -1)), ((5, 5, 2), (5, 5, -3))]
)
def test_a_ramp_and_a_plunge_leave_what_every_place_of_the_tool_leaves(
    shared: Any, a: tuple[float, ...], b: tuple[float, ...]
) -> None:
    one = shared("profile")
    tool = {"profile": [[0, 0], [3, 0]], "diameter": 6}
    found = one.page.evaluate(SWEEP, [tool, a, b])
    heights = np.array(found["heights"]).reshape(found["ny"], found["nx"])
    x, y = np.meshgrid(-10 + 0.25 * np.arange(found["nx"]), -10 + 0.25 * np.arange(found["ny"]))
    least, most = np.zeros_like(x), np.zeros_like(x)
    for share in np.linspace(0, 1, 2001):
        px, py, pz = (p + share * (q - p) for p, q in zip(a, b, strict=True))
        gap = np.hypot(x - px, y - py)
        # A wall is half a cell wide on either side.
        for depth, radius in ((least, 3.125), (most, 2.875)):
            np.minimum(depth, pz, out=depth, where=gap <= radius)
    assert (heights >= least - 2e-3).all()
    assert (heights <= most + 2e-3).all()
    assert heights.min() == pytest.approx(min(a[2], b[2]), abs=1e-5)


def test_going_back_shows_what_was_there(opened: Any, views: dict[str, View]) -> None:
    end = float(views["pocket"].track.time[-1])
    one, other = opened("pocket"), opened("pocket")
    fresh = Surface(other, 0.37 * end).heights
    Surface(one, end)
    assert one.run("camgen.cutting.stock.kept.length") > 3
    back = Surface(one, 0.37 * end).heights
    assert back.tolist() == fresh.tolist()
    assert (Surface(one, 0.0).heights == 0).all()
    ended = Surface(one, end).heights
    assert (ended <= back).all()
    assert ended.sum() < back.sum()


@pytest.mark.parametrize("name", ["profile", "pocket", "groove", "several", "thin"])
def test_a_rapid_out_of_what_was_cut_is_in_no_material(
    shared: Any, views: dict[str, View], name: str
) -> None:
    one = shared(name)
    assert not Surface(one, float(views[name].track.time[-1])).struck.any()
    assert one.run("camgen.cutting.stock.met.size") == 0


def test_a_rapid_through_material_is_marked_where_it_runs(
    shared: Any, views: dict[str, View]
) -> None:
    end = float(views["profile"].track.time[-1])
    one = shared("dips")
    left = Surface(one, end)
    moved = np.flatnonzero(
        views["dips"].track.position[:, 2] != views["profile"].track.position[:, 2]
    )
    way = shapely.LineString(views["dips"].track.position[moved, :2])
    points = shapely.points(left.x, left.y)
    assert (shapely.distance(points[left.struck > 0], way) <= 3.0).all()
    inner = shapely.distance(points, way) < 2.5
    # All of it was whole but the holes that were cut before.
    assert left.struck[inner].mean() > 0.8
    assert one.run("camgen.cutting.stock.met.size") >= 1
    assert one.page.locator("#hint").inner_text() == "Red: a rapid through material"


@pytest.mark.parametrize(
    ("name", "scheme"), [("profile", "dark"), ("several", "light"), ("marked", "light")]
)
def test_the_page_begins_with_what_is_left_in_the_end_and_says_nothing_on_the_console(
    opened: Any, name: str, scheme: str
) -> None:
    one = opened(name, scheme)
    picture = one.picture().astype(int)
    background = picture[picture.shape[0] // 2, 3]
    # The block fills much of the picture from the first frame on.
    assert (np.abs(picture - background).max(axis=2) > 12)[100:-100, 100:-100].mean() > 0.3
    assert one.run("camgen.player.time === camgen.track.time.at(-1)")
    assert one.log.messages == []


def test_the_stock_is_switched_off_like_other_layers(opened: Any) -> None:
    one = opened("profile")
    one.page.evaluate(GO, 0.0)
    before = one.picture().astype(int)
    one.page.locator("[data-do=layers]").click()
    tick = one.page.locator("[data-layer=stock]")
    assert tick.is_checked()
    tick.uncheck()
    one.page.locator("[data-do=layers]").click()
    assert (np.abs(one.picture().astype(int) - before).max(axis=2) > 24).mean() > 0.2


def test_the_tool_that_works_is_shown_and_its_operation_listed(
    opened: Any, views: dict[str, View]
) -> None:
    one = opened("several")
    shown = views["several"]
    tools = "camgen.toolGroup.parts.map((one) => [one.name, one.visible])"
    for path, expected in ((0, [True, False]), (len(shown.rows) - 1, [False, True])):
        at = float(
            shown.track.time[np.flatnonzero(shown.track.events.path[shown.track.event] == path)[0]]
        )
        one.page.evaluate(GO, at)
        assert [seen for name, seen in one.run(tools) if name == "tool"] == expected
    one.page.locator("[data-tab=paths]").click()
    row = one.page.locator("#rows .row").first.inner_text()
    assert "1 drill - drill 5" in row
    one.page.locator("#filter").fill("mill 6")
    assert one.page.locator("#rows .row").count() == 1


def test_the_arm_holds_the_tip_of_the_tool_that_works_where_the_program_is(
    shared: Any, views: dict[str, View]
) -> None:
    one = shared("robot")
    track = views["robot"].track
    for path in (0, len(views["robot"].rows) - 1):
        own = np.flatnonzero(track.events.path[track.event] == path)
        at = float(track.time[own[len(own) // 2]])
        one.page.evaluate(GO, at)
        # The tools differ by 30 mm; joints are sampled, and straight in between.
        tip = one.run("camgen.toolGroup.matrix.slice(12, 15)")
        assert tip == pytest.approx(one.page.evaluate("at => camgen.placeAt(at).at", at), abs=0.5)


def test_what_a_proof_found_is_red_in_the_picture_and_among_the_notes(opened: Any) -> None:
    one, plain = opened("marked"), opened("profile")
    red = []
    for page_ in (one, plain):
        page_.page.evaluate(GO, 0.0)
        picture = page_.picture().astype(int)
        red.append((picture[..., 2] - picture[..., :2].max(axis=2) > 60).mean())
    assert red[0] > red[1] + 0.02
    one.page.locator("[data-tab=notes]").click()
    assert one.page.locator("[data-tab=notes]").inner_text() == "Notes 2"
    assert "Gouge 0.125 mm" in one.page.locator("#notes .gouge").inner_text()


def test_back_from_where_several_steps_share_a_time_leaves_what_was_left_then(
    shared: Any, views: dict[str, View]
) -> None:
    one = shared("profile")
    until = 0.3 * float(views["profile"].track.time[-1])
    expected = Surface(one, until).heights
    # As slow a machine as there is: interrupted after the last step that has the time of the end, not all done.
    one.run(
        """() => {
          const { stock } = camgen.cutting;
          stock.to(camgen.data.total ?? 1e9);
          while (stock.work(Infinity));
          stock.time = -1;
        }"""
    )
    assert (Surface(one, until).heights == expected).all()
