"""The page in a real browser without a window: its pictures, its controls, and hostile names."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import camgen
from camgen.model.part import Contour
from camgen.pipeline import Result
from camgen.preview.page import format_page
from camgen.preview.view import make_view
from camgen.robots.kinematics.forward import compute_flange
from tests.preview.test_page import PARTS, ROBOT, make_hostile_view
from tests.support.browsers import PHONE, SMALL, Driven, OpenPage
from tests.support.waiting import wait_for


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory, solid: Result) -> dict[str, Path]:
    """Files of pages by the names of their results; the texts of "evil" are hostile."""
    folder = tmp_path_factory.mktemp("pages")
    flat = camgen.build(PARTS / "bracket.dxf", post="gcode", job={"tool": {"kind": "pen"}})
    robot = camgen.build(PARTS / "bracket.dxf", post="rapid", job=ROBOT)
    views = {
        "flat": make_view(flat),
        "robot": make_view(robot),
        "solid": make_view(solid),
        "evil": make_hostile_view(flat),
    }
    for name, shown in views.items():
        (folder / f"{name}.html").write_text(format_page(shown), encoding="utf-8")
    return {name: folder / f"{name}.html" for name in views}


@pytest.fixture
def opened(browser: Driven, files: dict[str, Path]) -> Iterator[Any]:
    """Opens a page by its name in a new tab; the tabs are closed after the test."""
    pages: list[OpenPage] = []

    def make(
        name: str, size: dict[str, int] = SMALL, scheme: str = "light", draws: bool = True
    ) -> OpenPage:
        pages.append(OpenPage(browser, files[name], size, scheme, draws))
        return pages[-1]

    yield make
    for tab in pages:
        tab.context.close()


@pytest.mark.parametrize("name", ["flat", "robot", "solid"])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_page_shows_a_picture_without_errors_and_without_a_network(
    opened: Any, name: str, scheme: str
) -> None:
    tab = opened(name, scheme=scheme)
    picture = tab.picture()
    background = picture[picture.shape[0] // 2, 3].astype(int)
    assert (background.mean() > 200) == (scheme == "light")
    shown = np.abs(picture.astype(int) - background).max(axis=2) > 24
    # The margins are left out: axes, legend and scale cover the picture there.
    assert shown[100:-100, 100:-100].mean() > 0.01
    assert tab.log.messages == []
    assert [url for url in tab.log.requests if not url.startswith(("data:", "blob:"))] == [
        tab.page.url
    ]


def test_the_executed_path_is_shown_instead_of_the_programmed_path(
    browser: Driven, tmp_path: Path
) -> None:
    contour = Contour([(0, 0), (40, 0), (40, 40)], [0, 0, 0], False, "0")
    job = {"operation": {"kind": "trace"}, "tolerance": {"corner": 5.0}}
    result = camgen.build(camgen.part([contour]), post="rapid", job=job)
    file = tmp_path / "corner.html"
    file.write_text(format_page(make_view(result)), encoding="utf-8")
    shown = OpenPage(browser, file)
    style = "() => getComputedStyle(document.documentElement).getPropertyValue('--executed')"
    red, green, blue = bytes.fromhex(shown.run(style).strip().removeprefix("#"))

    def count_executed() -> int:
        is_executed = np.abs(shown.picture() - np.array([blue, green, red])).max(axis=2) < 10
        return int(is_executed.sum())

    for name in ("tool", "executed"):
        assert count_executed() == 0
        shown.run(f"() => document.querySelector('[data-layer={name}]').click()")
    # Two lines of 40 mm are drawn, at least one pixel wide. A busy machine draws them later.
    scale = shown.run("() => camgen.look.height") / shown.run("() => camgen.gl.canvas.clientHeight")
    wait_for("the executed path", lambda: count_executed() > 70 / scale)
    assert shown.log.messages == []
    shown.context.close()


#: Notes the width of the canvas and the fraction of its pixels that are drawn, each time after the
#: page has reacted to a new size and before the browser shows the frame.
SAMPLE_CANVAS = """() => {
  window.seen = [];
  const drawn = () => {
    const { gl } = camgen;
    const [w, h] = [gl.drawingBufferWidth, gl.drawingBufferHeight];
    const pixels = new Uint8Array(4 * w * h);
    gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    const words = new Uint32Array(pixels.buffer);
    return words.reduce((sum, one) => sum + (one !== words[0]), 0) / words.length;
  };
  const canvas = document.getElementById("canvas");
  new ResizeObserver(() => window.seen.push([canvas.clientWidth, drawn()])).observe(canvas);
}"""


@pytest.mark.parametrize("name", ["flat", "solid"])
def test_a_canvas_of_another_size_is_painted_before_it_is_shown(opened: Any, name: str) -> None:
    tab = opened(name)
    tab.run(SAMPLE_CANVAS)
    for width, height in ((1400, 900), (900, 700), (1300, 640)):
        tab.page.set_viewport_size({"width": width, "height": height})
        tab.page.wait_for_function(
            "() => window.seen.length && window.seen.at(-1)[0] "
            "=== document.getElementById('canvas').clientWidth"
        )
    samples = tab.run("window.seen")
    # The first sample is the canvas before any change. It was painted a frame ago, so its buffer
    # may be empty.
    assert len(samples) > 2
    assert min(painted for _, painted in samples[1:]) > 0.005


@pytest.mark.parametrize("name", ["flat", "solid"])
def test_no_picture_is_empty_at_once_after_load_or_while_the_window_changes(
    browser: Driven, files: dict[str, Path], name: str
) -> None:
    context = browser.new_context(viewport=SMALL)
    context_tab = context.new_page()
    context_tab.goto(files[name].as_uri())
    pictures = [context_tab.screenshot()]
    for width, height in ((1400, 900), (1000, 700), (1300, 640)):
        context_tab.set_viewport_size({"width": width, "height": height})
        pictures.append(context_tab.screenshot())
    context.close()
    for raw in pictures:
        shown = cv2.imdecode(np.frombuffer(raw, np.uint8), cv2.IMREAD_COLOR).astype(int)
        # The list and the axes, legend and scale over the picture are left out.
        inner = shown[150:-200, 500:-120]
        assert (np.abs(inner - inner[0, 0]).max(axis=2) > 24).mean() > 0.01


def test_the_picture_stays_where_it_was_moved_to_when_the_window_changes(opened: Any) -> None:
    tab = opened("flat", draws=False)
    tab.page.mouse.move(700, 400)
    tab.page.mouse.wheel(0, -240)
    tab.page.wait_for_function("() => camgen.look.own")
    before = tab.run(
        "[...camgen.look.target.slice(0, 2), camgen.look.height / canvas.clientHeight]"
    )
    tab.page.set_viewport_size({"width": 1000, "height": 600})
    tab.page.wait_for_function("() => canvas.width < 700")
    after = tab.run("[...camgen.look.target.slice(0, 2), camgen.look.height / canvas.clientHeight]")
    assert after == pytest.approx(before)


def test_the_paths_have_the_colours_of_their_order(opened: Any) -> None:
    tab = opened("flat")
    tab.run("camgen.setScreen()")
    picture = tab.picture().astype(int)
    # The legend: the first path is blue, the last one orange. Colours are (blue, green, red).
    for colour in ((220, 98, 31), (30, 88, 226)):
        assert (np.abs(picture - colour).max(axis=2) < 12).sum() > 30, colour


def test_the_slider_moves_the_robot_to_the_joint_values_of_that_time(opened: Any) -> None:
    tab = opened("robot")
    before = tab.picture()
    tab.page.evaluate(
        "s => { const e = document.getElementById('slider'); e.value = s; "
        "e.dispatchEvent(new Event('input')); }",
        15.0,
    )
    after = tab.picture()
    assert (np.abs(before.astype(int) - after.astype(int)).max(axis=2) > 30).mean() > 0.01
    result = camgen.build(PARTS / "bracket.dxf", post="rapid", job=ROBOT)
    arm = make_view(result).arm
    assert arm is not None
    joints = np.array(
        [np.interp(15.0, arm.time, arm.joints[:, k]) for k in range(arm.joints.shape[1])]
    )
    rotation, origin = compute_flange(arm.robot, joints[None])
    tool = result.program.flange_from_tool
    base = origin[0] + rotation[0] @ np.asarray(tool.origin)
    expected = np.asarray(result.program.base_from_work.inverse().apply(base.tolist()))
    matrix = np.array(tab.run("camgen.toolGroup.matrix")).reshape(4, 4).T
    assert matrix[:3, 3] + tab.run("camgen.data.origin") == pytest.approx(expected, abs=0.01)


def test_the_list_names_and_highlights_a_path(opened: Any) -> None:
    tab = opened("flat")
    before = tab.picture()
    rows = tab.page.locator("#rows .row")
    assert rows.count() == 4
    rows.nth(3).click()
    assert tab.run("camgen.chosen.path") == 3
    assert "picked" in rows.nth(3).get_attribute("class")
    # The chosen path has a colour of its own, which was not on the screen before.
    counts = [
        (np.abs(picture.astype(int) - (0, 149, 255)).max(axis=2) < 12).sum()
        for picture in (before, tab.picture())
    ]
    assert counts[0] == 0
    assert counts[1] > 500


def test_a_double_click_in_the_list_moves_the_tool_to_the_start_of_the_path(opened: Any) -> None:
    tab = opened("flat", draws=False)
    tab.page.locator("#rows .row").nth(2).dblclick()
    start_time = tab.run(
        "camgen.track.time[camgen.track.event.findIndex((e) => camgen.track.path[e] === 2) - 1]"
    )
    assert tab.run("camgen.player.time") == pytest.approx(start_time) != 0
    assert tab.run("camgen.chosen.path") == 2


def test_a_click_on_a_path_names_its_row(opened: Any) -> None:
    tab = opened("flat", draws=False)
    spot = tab.run(
        """() => {
          camgen.setScreen();
          const { event, path, position } = camgen.track;
          const [x, y] = camgen.toScreen(position, event.findIndex((e) => path[e] === 3) + 3);
          const area = document.getElementById("canvas").getBoundingClientRect();
          return [x + area.left, y + area.top];
        }"""
    )
    tab.page.mouse.click(*spot)
    assert tab.run("camgen.chosen.path") == 3
    assert "c1" in tab.page.locator("#tip").inner_text()


def test_keys_play_step_turn_and_measure(opened: Any) -> None:
    tab = opened("flat", draws=False)
    keys = tab.page.keyboard
    keys.press("ArrowRight")
    first = tab.run("camgen.player.time")
    keys.press("ArrowRight")
    assert tab.run("camgen.player.time") > first > 0
    keys.press("ArrowLeft")
    assert tab.run("camgen.player.time") == pytest.approx(first)
    # The end is far at this speed, however late a busy machine answers.
    tab.run("camgen.player.speed = 0.01")
    keys.press(" ")
    tab.page.wait_for_function("first => camgen.player.on && camgen.player.time > first", arg=first)
    keys.press(" ")
    assert not tab.run("camgen.player.on")
    keys.press("s")
    assert tab.run("camgen.look.tilt") == 0
    keys.press("t")
    assert tab.run("camgen.look.tilt") == pytest.approx(np.pi / 2)
    keys.press("?")
    assert tab.page.locator("#keys").is_visible()
    keys.press("?")
    keys.press("m")
    assert tab.run("camgen.measure.on")


def test_the_page_draws_all_again_after_the_graphics_context_was_lost(opened: Any) -> None:
    tab = opened("solid")
    before = tab.picture().astype(int)
    tab.run(
        "() => { window.card = camgen.gl.getExtension('WEBGL_lose_context'); "
        "window.card.loseContext(); }"
    )
    tab.page.wait_for_function("() => camgen.gl.isContextLost()")
    tab.page.keyboard.press("t")
    tab.page.keyboard.press("i")
    tab.run("window.card.restoreContext()")
    tab.page.wait_for_function("() => !camgen.gl.isContextLost()")
    assert (np.abs(tab.picture().astype(int) - before).max(axis=2) > 60).mean() < 0.02
    assert [text for text in tab.log.messages if "CONTEXT_LOST" not in text] == []


def test_f_fits_the_part_and_shift_f_fits_the_robot_as_well(opened: Any) -> None:
    tab = opened("solid", draws=False)
    # Positions in px: eight corners of the box of part and paths, then the base of the robot.
    script = """() => {
      camgen.setScreen();
      const { low, high } = camgen.box;
      const corners = [];
      for (let k = 0; k < 8; k++)
        corners.push([0, 1, 2].map((i) => (k >> i & 1 ? high[i] : low[i])));
      return [...corners, camgen.arm.base.slice(12, 15)].map((point) => camgen.toScreen(point, 0));
    }"""

    def measure_picture() -> tuple[float, np.ndarray[Any, Any]]:
        """Width of the box and all positions, px from the top left of the canvas."""
        spots = np.array(tab.run(script))
        return float(np.ptp(spots[:8], axis=0).max()), spots

    area = tab.page.locator("#canvas").bounding_box()
    first_width = measure_picture()[0]
    tab.page.keyboard.press("f")
    part_width = measure_picture()[0]
    tab.page.keyboard.press("F")
    whole_width, spots = measure_picture()
    # The page opens with the whole arm in the picture.
    assert part_width > first_width == pytest.approx(whole_width)
    assert part_width > 0.7 * min(area["width"], area["height"])
    assert (spots >= 0).all()
    assert (spots <= (area["width"], area["height"])).all()


def test_an_arm_is_drawn_as_shapes_within_the_cuboids_that_a_layer_shows(opened: Any) -> None:
    tab = opened("robot")
    assert tab.run(
        "camgen.layers.boxes.off && camgen.layers.boxes.things.every((thing) => !thing.visible)"
    )
    # For each link: the number of its bodies, the number of its cuboids, and the largest distance
    # (mm) of a point of a body from the nearest cuboid.
    links = tab.run(
        """() => camgen.arm.links3.map((link, k) => {
          const boxOf = ([pose, half]) => ({ turn: camgen.inverse(camgen.matrixOf(pose)), half });
          const boxes = camgen.arm.links[k][1].map(boxOf);
          const bodies = link.parts[0].parts.filter(({ name }) => name === "arm");
          let out = 0;
          for (const body of bodies) {
            const { points } = body.draw.shape;
            for (let i = 0; i < points.length; i += 3) {
              const at = camgen.moved(body.matrix, points.subarray(i, i + 3));
              const gaps = boxes.map(({ turn, half }) => {
                const own = camgen.moved(turn, at);
                return Math.max(...own.map((v, n) => Math.abs(v) - half[n]));
              });
              out = Math.max(out, Math.min(...gaps));
            }
          }
          return [bodies.length, boxes.length, out];
        })"""
    )
    assert len(links) == 7
    for bodies, boxes, distance in links:
        assert bodies == boxes
        assert distance < 0.01
    before = tab.picture().astype(int)
    tab.page.keyboard.press("l")
    tab.page.locator("[data-layer=boxes]").click()
    assert (np.abs(tab.picture().astype(int) - before).max(axis=2) > 24).mean() > 0.02


def test_two_clicks_measure_a_distance_between_corners(opened: Any) -> None:
    tab = opened("flat", draws=False)
    tab.page.keyboard.press("m")
    # The straight sides of the outline end where its round corners begin: 80 x 50 mm, radius 10.
    ends = tab.run(
        """() => {
          camgen.setScreen();
          const o = camgen.data.origin;
          const area = document.getElementById("canvas").getBoundingClientRect();
          return [[10, 50], [70, 50]].map(([x, y]) => {
            const [u, v] = camgen.toScreen([x - o[0], y - o[1], -o[2]], 0);
            return [u + area.left, v + area.top];
          });
        }"""
    )
    for x, y in ends:
        tab.page.mouse.click(x + 2, y - 2)
    card_text = tab.page.locator("#marks .card").inner_text()
    assert card_text.startswith("60.000 mm")


def test_dragging_turns_and_the_wheel_zooms(opened: Any) -> None:
    tab = opened("flat", draws=False)
    turn, height = tab.run("[camgen.look.turn, camgen.look.height]")
    tab.page.mouse.move(800, 400)
    tab.page.mouse.down()
    tab.page.mouse.move(900, 430, steps=5)
    tab.page.mouse.up()
    tab.page.mouse.wheel(0, -240)
    tab.page.wait_for_function("height => camgen.look.height < height", arg=height)
    later = tab.run("[camgen.look.turn, camgen.look.height]")
    assert later[0] < turn
    assert later[1] < height
    assert tab.run("camgen.chosen.path") == -1


def test_names_that_are_markup_are_shown_and_do_nothing(opened: Any) -> None:
    tab = opened("evil", draws=False)
    assert "<img" in tab.page.locator("#notes").inner_text()
    tab.page.locator("[data-tab=paths]").click()
    tab.page.locator("#rows .row").first.click()
    for button in tab.page.locator("nav button").all():
        button.click()
    assert tab.run("window.bad") is None
    assert tab.log.messages == []
    assert tab.page.locator("img").count() == 0
    assert "</script>" in tab.page.locator("#title").inner_text()


@pytest.mark.parametrize("name", ["robot", "solid"])
def test_on_a_phone_nothing_is_wider_than_the_screen_and_nothing_overlaps(
    opened: Any, name: str
) -> None:
    tab = opened(name, size=PHONE)
    assert tab.run("document.documentElement.scrollWidth") <= PHONE["width"]
    boxes = tab.run(
        """["header", "main", "footer", "aside"].map((name) => {
          const { top, bottom } = document.querySelector(name).getBoundingClientRect();
          return [top, bottom];
        })"""
    )
    assert all(boxes[k][1] <= boxes[k + 1][0] + 1 for k in range(3))
    assert boxes[1][1] - boxes[1][0] > 250
    legend, scale = (tab.page.locator(n).bounding_box() for n in ("#legend", "#scale"))
    assert legend["x"] + legend["width"] < scale["x"]


def test_print_has_title_numbers_and_picture(opened: Any) -> None:
    tab = opened("solid")
    tab.run("dispatchEvent(new Event('beforeprint'))")
    tab.page.emulate_media(media="print")
    text = tab.page.locator("#print").inner_text()
    assert "rfa1.stl, rapid" in text
    assert "Controller" in text
    assert "Left out" in text
    assert tab.run("document.querySelector('#print img').src.length") > 5000
    assert not tab.page.locator("footer").is_visible()
