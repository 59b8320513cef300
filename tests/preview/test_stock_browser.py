"""The stock that the page cuts while it plays, compared with shapes of shapely and with discs."""

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
from tests.preview.test_page import PARTS, make_job_of_two_tools
from tests.preview.test_stock import MILLED, SEVERAL
from tests.support.browsers import SMALL, Driven, OpenPage

Floats = np.ndarray[Any, np.dtype[np.float64]]
#: A tool of 9 mm runs along the border of a slot of 30 x 10 mm. It cuts most places more than once.
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
    """Views of milled parts by name."""
    jobs = {"profile": MILLED, "pocket": POCKET, "groove": GROOVE}
    shown = {
        name: make_view(camgen.build(PARTS / "bracket.dxf", post="gcode", job=job))
        for name, job in jobs.items()
    }
    shown["several"] = make_view(camgen.build(PARTS / "motor.dxf", post="gcode", job=SEVERAL))
    shown["robot"] = make_view(
        camgen.build(PARTS / "bracket.dxf", post="rapid", job=make_job_of_two_tools())
    )
    # The tool is a few cells wide: no other tool has so coarse a grid.
    thin = MILLED | {"operation": {"kind": "trace", "depth": 2.0}, "tool": {"diameter": 0.5}}
    shown["thin"] = make_view(camgen.build(PARTS / "motor.dxf", post="gcode", job=thin))
    shown["dips"] = dip(shown["profile"])
    corners = np.array([(20.0, 20), (60, 20), (60, 40), (20, 40)])
    shown["marked"] = replace(shown["profile"], marks=(Mark("gouge", corners, 0.0, 0.125, "c1"),))
    return shown


def dip(shown: View) -> View:
    """The view with a rapid between two paths lowered to 2 mm below the top of the material."""
    events, position = shown.track.events, shown.track.position.copy()
    free = (events.kind == 0)[shown.track.event]
    # The first rapid at the clearance height that moves sideways.
    steps = np.hypot(*np.diff(position[:, :2], axis=0, prepend=position[:1, :2]).T)
    s = np.flatnonzero(free & (steps > 10) & (position[:, 2] == 20))[1]
    position[s - 1 : s + 1, 2] = -2.0
    return replace(shown, track=replace(shown.track, position=position))


@pytest.fixture
def opened(browser: Driven, views: dict[str, View], tmp_path: Path) -> Iterator[Any]:
    """Opens the page of a view in a new tab; the tabs are closed after the test."""
    pages: list[OpenPage] = []

    def make(name: str, scheme: str = "light", draws: bool = True) -> OpenPage:
        file = tmp_path / f"{name}.html"
        file.write_text(format_page(views[name]), encoding="utf-8")
        pages.append(OpenPage(browser, file, SMALL, scheme, draws))
        return pages[-1]

    yield make
    for tab in pages:
        tab.context.close()


@pytest.fixture(scope="module")
def shared(
    browser: Driven, views: dict[str, View], tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Any]:
    """Opens the page of a view once for all tests that only ask for the stock at some time.

    The page has no WebGL: it computes the stock and does not draw it.
    """
    pages: dict[str, OpenPage] = {}
    folder = tmp_path_factory.mktemp("shared")

    def make(name: str) -> OpenPage:
        if name not in pages:
            file = folder / f"{name}.html"
            file.write_text(format_page(views[name]), encoding="utf-8")
            pages[name] = OpenPage(browser, file, draws=False)
        return pages[name]

    yield make
    for tab in pages.values():
        tab.context.close()


#: Moves to a time and cuts until the stock is that of the time, without drawing frames between.
PLAY_TO = """(time) => {
  const { player, cutting } = camgen;
  player.to(time);
  while (cutting.stock.time !== cutting.stock.wanted) cutting.stock.work();
}"""
READ_FIELD = """() => {
  const { heights, struck, nx, ny, cell, low } = camgen.cutting.stock.field;
  const text = (values) => {
    const bytes = new Uint8Array(values.buffer);
    return btoa(Array.from(bytes, (b) => String.fromCharCode(b)).join(""));
  };
  return { heights: text(heights), struck: text(struck), nx, ny, cell, low };
}"""


class Surface:
    """The stock at a time.

    heights: (ny, nx) height of the remaining material, mm in the work frame.
    struck: (ny, nx) 1 where a rapid has met material.
    cell: distance of two samples, mm.
    x, y: (ny, nx) positions of the samples, mm in the work frame.
    """

    def __init__(self, tab: OpenPage, time: float) -> None:
        tab.page.evaluate(PLAY_TO, time)
        field = tab.run(READ_FIELD)
        shape = (field["ny"], field["nx"])
        self.heights = (
            np.frombuffer(base64.b64decode(field["heights"]), "<f4").reshape(shape).astype(float)
        )
        self.struck = np.frombuffer(base64.b64decode(field["struck"]), np.uint8).reshape(shape)
        self.cell = float(field["cell"])
        origin = tab.run("camgen.data.origin")
        self.heights += origin[2]
        x, y = (field["low"][k] + origin[k] + self.cell * np.arange(shape[1 - k]) for k in (0, 1))
        self.x, self.y = np.meshgrid(x, y)


def run_centre(track: Track, until: float, z: float) -> shapely.Geometry:
    """The lines of the tool centre at the height z (mm) until a time (s), without rapids."""
    at = track.position
    keep = (
        (np.diff(at[:, 2], prepend=99.0) == 0)
        & (np.abs(at[:, 2] - z) < 1e-9)
        & (track.time <= until)
    )
    keep &= track.events.kind[track.event] != 0
    runs = shapely.union_all(
        [shapely.LineString(at[s - 1 : s + 1, :2]) for s in np.flatnonzero(keep)]
    )
    # Distances from long, prepared chains take a third of the time.
    merged = shapely.line_merge(runs)
    shapely.prepare(merged)
    return merged


@pytest.mark.parametrize(
    ("name", "radius", "fraction"), [("profile", 3.0, 0.5), ("pocket", 4.5, 1.0)]
)
def test_the_remaining_stock_is_the_block_without_the_swept_tool_at_each_depth(
    shared: Any, views: dict[str, View], name: str, radius: float, fraction: float
) -> None:
    shown = views[name]
    until = fraction * float(shown.track.time[-1])
    # The end of a motion, so that no motion is run in part.
    until = float(shown.track.time[np.searchsorted(shown.track.time, until)])
    left = Surface(shared(name), until)
    expected = np.zeros_like(left.heights)
    wall = np.zeros(left.heights.shape, dtype=bool)
    points = shapely.points(left.x, left.y)
    levels = sorted({z for z in shown.track.position[:, 2].tolist() if z < 0}, reverse=True)
    assert len(levels) > 1
    for z in levels:
        distance = shapely.distance(run_centre(shown.track, until, z), points)
        # The tool's own edge is a cell wide.
        wall |= np.abs(distance - radius) < 0.55 * left.cell
        expected[distance < radius] = z
    assert left.heights[~wall] == pytest.approx(expected[~wall], abs=1e-4)
    # A part of the stock is cut and a part is not; the walls take few samples.
    assert (expected < 0).mean() > 0.02
    assert (expected == 0).mean() > 0.2
    assert wall.mean() < 0.12
    # The samples at walls, left out above, count here: the removed volume is that of the shapes.
    cut = -left.heights.sum() * left.cell**2
    above = [0.0, *levels]
    swept = [run_centre(shown.track, until, z).buffer(radius, quad_segs=64) for z in levels]
    exact = sum(
        (high - low) * shapely.union_all(swept[k:]).area
        for k, (high, low) in enumerate(pairwise(above))
    )
    assert cut == pytest.approx(exact, rel=0.01)


def test_a_v_tool_cuts_a_groove_with_its_angle(shared: Any, views: dict[str, View]) -> None:
    shown = views["groove"]
    end = float(shown.track.time[-1])
    left = Surface(shared("groove"), end)
    distance = shapely.distance(run_centre(shown.track, end, -1.0), shapely.points(left.x, left.y))
    # 90 deg: each mm from the centre line raises the groove by 1 mm.
    assert left.heights == pytest.approx(np.minimum(distance - 1.0, 0.0), abs=0.02)
    assert left.heights.min() == pytest.approx(-1.0, abs=0.15)


#: Cuts a block of 40 x 20 x 10 mm along one motion, with a sample each 0.25 mm.
SWEEP = """([tool, from, to]) => {
  const { makeField, makeShape, carve } = camgen.cutting;
  const field = makeField({ low: [-10, -10, -10], high: [30, 10, 0] }, 0.25);
  carve(field, makeShape(tool, 0.25), from, to, false);
  return { heights: Array.from(field.heights), nx: field.nx, ny: field.ny };
}"""


@pytest.mark.parametrize(
    ("a", "b"), [((0, 0, 0), (20, 3, -2)), ((20, 0, -4), (3, -4, -1)), ((5, 5, 2), (5, 5, -3))]
)
def test_a_ramp_and_a_plunge_cut_the_union_of_the_tool_at_each_sample(
    shared: Any, a: tuple[float, ...], b: tuple[float, ...]
) -> None:
    tab = shared("profile")
    tool = {"profile": [[0, 0], [3, 0]], "diameter": 6}
    swept = tab.page.evaluate(SWEEP, [tool, a, b])
    heights = np.array(swept["heights"]).reshape(swept["ny"], swept["nx"])
    x, y = np.meshgrid(-10 + 0.25 * np.arange(swept["nx"]), -10 + 0.25 * np.arange(swept["ny"]))
    deepest, highest = np.zeros_like(x), np.zeros_like(x)
    for fraction in np.linspace(0, 1, 2001):
        px, py, pz = (p + fraction * (q - p) for p, q in zip(a, b, strict=True))
        distance = np.hypot(x - px, y - py)
        # At a wall the grid may err by half a cell, 0.125 mm, to either side.
        for depth, radius in ((deepest, 3.125), (highest, 2.875)):
            np.minimum(depth, pz, out=depth, where=distance <= radius)
    assert (heights >= deepest - 2e-3).all()
    assert (heights <= highest + 2e-3).all()
    assert heights.min() == pytest.approx(min(a[2], b[2]), abs=1e-5)


def test_the_stock_of_an_earlier_time_is_shown_again(opened: Any, views: dict[str, View]) -> None:
    end = float(views["pocket"].track.time[-1])
    tab, fresh_tab = opened("pocket", draws=False), opened("pocket", draws=False)
    fresh = Surface(fresh_tab, 0.37 * end).heights
    Surface(tab, end)
    assert tab.run("camgen.cutting.stock.kept.length") > 3
    back = Surface(tab, 0.37 * end).heights
    assert back.tolist() == fresh.tolist()
    assert (Surface(tab, 0.0).heights == 0).all()
    ended = Surface(tab, end).heights
    assert (ended <= back).all()
    assert ended.sum() < back.sum()


@pytest.mark.parametrize("name", ["profile", "pocket", "groove", "several", "thin"])
def test_a_rapid_out_of_a_cut_touches_no_material(
    shared: Any, views: dict[str, View], name: str
) -> None:
    tab = shared(name)
    assert not Surface(tab, float(views[name].track.time[-1])).struck.any()
    assert tab.run("camgen.cutting.stock.met.size") == 0


def test_a_rapid_through_material_is_marked_where_it_runs(
    opened: Any, views: dict[str, View]
) -> None:
    end = float(views["profile"].track.time[-1])
    tab = opened("dips")
    left = Surface(tab, end)
    moved = np.flatnonzero(
        views["dips"].track.position[:, 2] != views["profile"].track.position[:, 2]
    )
    rapid = shapely.LineString(views["dips"].track.position[moved, :2])
    points = shapely.points(left.x, left.y)
    assert (shapely.distance(points[left.struck > 0], rapid) <= 3.0).all()
    inner = shapely.distance(points, rapid) < 2.5
    # The rapid runs through whole material, except for the holes that were cut before.
    assert left.struck[inner].mean() > 0.8
    assert tab.run("camgen.cutting.stock.met.size") >= 1
    assert tab.page.locator("#hint").inner_text() == "Red: a rapid through material"


@pytest.mark.parametrize(
    ("name", "scheme"), [("profile", "dark"), ("several", "light"), ("marked", "light")]
)
def test_the_page_opens_with_the_stock_at_the_end_and_an_empty_console(
    opened: Any, name: str, scheme: str
) -> None:
    tab = opened(name, scheme)
    picture = tab.picture().astype(int)
    background = picture[picture.shape[0] // 2, 3]
    # The block fills much of the picture from the first frame on.
    assert (np.abs(picture - background).max(axis=2) > 12)[100:-100, 100:-100].mean() > 0.3
    assert tab.run("camgen.player.time === camgen.track.time.at(-1)")
    assert tab.log.messages == []


def test_the_stock_is_switched_off_like_other_layers(opened: Any) -> None:
    tab = opened("profile")
    tab.page.evaluate(PLAY_TO, 0.0)
    before = tab.picture().astype(int)
    tab.page.locator("[data-do=layers]").click()
    checkbox = tab.page.locator("[data-layer=stock]")
    assert checkbox.is_checked()
    checkbox.uncheck()
    tab.page.locator("[data-do=layers]").click()
    assert (np.abs(tab.picture().astype(int) - before).max(axis=2) > 24).mean() > 0.2


def test_the_current_tool_is_shown_and_its_operation_listed(
    opened: Any, views: dict[str, View]
) -> None:
    tab = opened("several", draws=False)
    shown = views["several"]
    tools = "camgen.toolGroup.parts.map((one) => [one.name, one.visible])"
    for path, expected in ((0, [True, False]), (len(shown.rows) - 1, [False, True])):
        at = float(
            shown.track.time[np.flatnonzero(shown.track.events.path[shown.track.event] == path)[0]]
        )
        tab.page.evaluate(PLAY_TO, at)
        assert [seen for name, seen in tab.run(tools) if name == "tool"] == expected
    tab.page.locator("[data-tab=paths]").click()
    row = tab.page.locator("#rows .row").first.inner_text()
    assert "1 drill - drill 5" in row
    tab.page.locator("#filter").fill("mill 6")
    assert tab.page.locator("#rows .row").count() == 1


def test_the_arm_holds_the_tip_of_the_current_tool_at_the_position_of_the_program(
    shared: Any, views: dict[str, View]
) -> None:
    tab = shared("robot")
    track = views["robot"].track
    for path in (0, len(views["robot"].rows) - 1):
        rows = np.flatnonzero(track.events.path[track.event] == path)
        time = float(track.time[rows[len(rows) // 2]])
        tab.page.evaluate(PLAY_TO, time)
        # The tools differ by 30 mm; joints are sampled, and straight in between.
        tip = tab.run("camgen.toolGroup.matrix.slice(12, 15)")
        assert tip == pytest.approx(tab.page.evaluate("at => camgen.placeAt(at).at", time), abs=0.5)


def test_a_gouge_is_red_in_the_picture_and_among_the_notes(opened: Any) -> None:
    tab = opened("marked")
    tab.page.evaluate(PLAY_TO, 0.0)
    red = []
    for _ in range(2):
        picture = tab.picture().astype(int)
        red.append((picture[..., 2] - picture[..., :2].max(axis=2) > 60).mean())
        tab.run("() => document.querySelector('[data-layer=gouge]').click()")
    assert red[0] > red[1] + 0.02
    tab.page.locator("[data-tab=notes]").click()
    assert tab.page.locator("[data-tab=notes]").inner_text() == "Notes 2"
    assert "Gouge 0.125 mm" in tab.page.locator("#notes .gouge").inner_text()


def test_the_stock_is_right_after_an_interruption_between_steps_of_one_time(
    shared: Any, views: dict[str, View]
) -> None:
    tab = shared("profile")
    until = 0.3 * float(views["profile"].track.time[-1])
    expected = Surface(tab, until).heights
    # A slow machine is interrupted between steps of one time: all steps are cut, the time is not
    # yet set.
    tab.run(
        """() => {
          const { stock } = camgen.cutting;
          stock.to(camgen.data.total ?? 1e9);
          while (stock.work(Infinity));
          stock.time = -1;
        }"""
    )
    assert (Surface(tab, until).heights == expected).all()
