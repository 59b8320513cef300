"""The page in a real browser without a window: what is seen, and that what a hostile drawing says does nothing."""

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
from tests.preview.test_page import PARTS, ROBOT, poisoned
from tests.support.browsers import PHONE, SMALL, Driven, OpenPage
from tests.support.waiting import wait_for


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory, solid: Result) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("pages")
    flat = camgen.build(PARTS / "bracket.dxf", post="gcode", job={"tool": {"kind": "pen"}})
    robot = camgen.build(PARTS / "bracket.dxf", post="rapid", job=ROBOT)
    views = {
        "flat": make_view(flat),
        "robot": make_view(robot),
        "solid": make_view(solid),
        "evil": poisoned(flat),
    }
    for name, shown in views.items():
        (folder / f"{name}.html").write_text(format_page(shown), encoding="utf-8")
    return {name: folder / f"{name}.html" for name in views}


@pytest.fixture
def opened(browser: Driven, files: dict[str, Path]) -> Iterator[Any]:
    pages: list[OpenPage] = []

    def make(name: str, size: dict[str, int] = SMALL, scheme: str = "light") -> OpenPage:
        pages.append(OpenPage(browser, files[name], size, scheme))
        return pages[-1]

    yield make
    for one in pages:
        one.context.close()


@pytest.mark.parametrize("name", ["flat", "robot", "solid"])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_page_shows_a_picture_without_errors_and_without_a_network(
    opened: Any, name: str, scheme: str
) -> None:
    one = opened(name, scheme=scheme)
    picture = one.picture()
    background = picture[picture.shape[0] // 2, 3].astype(int)
    assert (background.mean() > 200) == (scheme == "light")
    shown = np.abs(picture.astype(int) - background).max(axis=2) > 24
    # Not counting what lies over the picture: axes, legend, scale.
    assert shown[100:-100, 100:-100].mean() > 0.01
    assert one.log.messages == []
    assert [url for url in one.log.requests if not url.startswith(("data:", "blob:"))] == [
        one.page.url
    ]


def test_the_executed_path_is_shown_in_place_of_the_programmed_one(
    browser: Driven, tmp_path: Path
) -> None:
    contour = Contour([(0, 0), (40, 0), (40, 40)], [0, 0, 0], False, "0")
    job = {"operation": {"kind": "trace"}, "tolerance": {"corner": 5.0}}
    result = camgen.build(camgen.part([contour]), post="rapid", job=job)
    file = tmp_path / "corner.html"
    file.write_text(format_page(make_view(result)), encoding="utf-8")
    shown = OpenPage(browser, file, SMALL, "light")
    style = "() => getComputedStyle(document.documentElement).getPropertyValue('--executed')"
    red, green, blue = bytes.fromhex(shown.run(style).strip().removeprefix("#"))

    def count_executed() -> int:
        is_executed = np.abs(shown.picture() - np.array([blue, green, red])).max(axis=2) < 10
        return int(is_executed.sum())

    for name in ("tool", "executed"):
        assert count_executed() == 0
        shown.run(f"() => document.querySelector('[data-layer={name}]').click()")
    # Two lines of 40 mm are drawn, a pixel wide at least. A busy machine draws them later.
    scale = shown.run("() => camgen.look.height") / shown.run("() => camgen.gl.canvas.clientHeight")
    wait_for("the executed path", lambda: count_executed() > 70 / scale)
    assert shown.log.messages == []
    shown.context.close()


#: Tells, in the turn in which the canvas gets a new size and after the page has seen it, whether anything is drawn.
LOOK = """() => {
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
    one = opened(name)
    one.run(LOOK)
    for wide, high in ((1400, 900), (900, 700), (1300, 640)):
        one.page.set_viewport_size({"width": wide, "height": high})
        one.page.wait_for_function(
            "() => window.seen.length && window.seen.at(-1)[0] === document.getElementById('canvas').clientWidth"
        )
    looks = one.run("window.seen")
    # The first look is at the canvas as it was: painted a frame ago, what is in its buffer may be gone.
    assert len(looks) > 2
    assert min(share for _, share in looks[1:]) > 0.005


@pytest.mark.parametrize("name", ["flat", "solid"])
def test_no_picture_is_empty_at_once_after_load_or_while_the_window_changes(
    browser: Driven, files: dict[str, Path], name: str
) -> None:
    context = browser.new_context(viewport=SMALL)
    tab = context.new_page()
    tab.goto(files[name].as_uri())
    pictures = [tab.screenshot()]
    for wide, high in ((1400, 900), (1000, 700), (1300, 640)):
        tab.set_viewport_size({"width": wide, "height": high})
        pictures.append(tab.screenshot())
    context.close()
    for raw in pictures:
        shown = cv2.imdecode(np.frombuffer(raw, np.uint8), cv2.IMREAD_COLOR).astype(int)
        # Not counting the list and what lies over the picture.
        inner = shown[150:-200, 500:-120]
        assert (np.abs(inner - inner[0, 0]).max(axis=2) > 24).mean() > 0.01


def test_the_picture_stays_where_it_was_moved_to_when_the_window_changes(opened: Any) -> None:
    one = opened("flat")
    one.page.mouse.move(700, 400)
    one.page.mouse.wheel(0, -240)
    one.page.wait_for_function("() => camgen.look.own")
    before = one.run(
        "[...camgen.look.target.slice(0, 2), camgen.look.height / canvas.clientHeight]"
    )
    one.page.set_viewport_size({"width": 1000, "height": 600})
    one.page.wait_for_function("() => canvas.width < 700")
    after = one.run("[...camgen.look.target.slice(0, 2), camgen.look.height / canvas.clientHeight]")
    assert after == pytest.approx(before)


def test_the_paths_have_the_colours_of_their_order(opened: Any) -> None:
    one = opened("flat")
    one.run("camgen.setScreen()")
    picture = one.picture().astype(int)
    # Blue first, orange last, as the legend says; colours are blue, green, red.
    for colour in ((220, 98, 31), (30, 88, 226)):
        assert (np.abs(picture - colour).max(axis=2) < 12).sum() > 30, colour


def test_the_slider_moves_the_robot_to_the_joints_that_were_found(opened: Any) -> None:
    one = opened("robot")
    before = one.picture()
    one.page.evaluate(
        "s => { const e = document.getElementById('slider'); e.value = s; e.dispatchEvent(new Event('input')); }",
        15.0,
    )
    after = one.picture()
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
    matrix = np.array(one.run("camgen.toolGroup.matrix")).reshape(4, 4).T
    assert matrix[:3, 3] + one.run("camgen.data.origin") == pytest.approx(expected, abs=0.01)


def test_the_list_names_and_highlights_a_path(opened: Any) -> None:
    one = opened("flat")
    before = one.picture()
    rows = one.page.locator("#rows .row")
    assert rows.count() == 4
    rows.nth(3).click()
    assert one.run("camgen.chosen.path") == 3
    assert "picked" in rows.nth(3).get_attribute("class")
    # The outline in the colour of what is chosen: it was not on the screen before.
    marked = [
        (np.abs(p.astype(int) - (0, 149, 255)).max(axis=2) < 12).sum()
        for p in (before, one.picture())
    ]
    assert marked[0] == 0
    assert marked[1] > 500


def test_a_double_click_in_the_list_goes_to_where_the_path_begins(opened: Any) -> None:
    one = opened("flat")
    one.page.locator("#rows .row").nth(2).dblclick()
    begins = one.run(
        "camgen.track.time[camgen.track.event.findIndex((e) => camgen.track.path[e] === 2) - 1]"
    )
    assert one.run("camgen.player.time") == pytest.approx(begins) != 0
    assert one.run("camgen.chosen.path") == 2


def test_a_click_on_a_path_names_its_row(opened: Any) -> None:
    one = opened("flat")
    spot = one.run(
        """() => {
          camgen.setScreen();
          const { event, path, position } = camgen.track;
          const [x, y] = camgen.toScreen(position, event.findIndex((e) => path[e] === 3) + 3);
          const area = document.getElementById("canvas").getBoundingClientRect();
          return [x + area.left, y + area.top];
        }"""
    )
    one.page.mouse.click(*spot)
    assert one.run("camgen.chosen.path") == 3
    assert "c1" in one.page.locator("#tip").inner_text()


def test_keys_play_step_turn_and_measure(opened: Any) -> None:
    one = opened("flat")
    keys = one.page.keyboard
    keys.press("ArrowRight")
    first = one.run("camgen.player.time")
    keys.press("ArrowRight")
    assert one.run("camgen.player.time") > first > 0
    keys.press("ArrowLeft")
    assert one.run("camgen.player.time") == pytest.approx(first)
    one.run(
        "camgen.player.speed = 0.01"
    )  # so that the end is far, however long the next look takes
    keys.press(" ")
    one.page.wait_for_function("first => camgen.player.on && camgen.player.time > first", arg=first)
    keys.press(" ")
    assert not one.run("camgen.player.on")
    keys.press("s")
    assert one.run("camgen.look.tilt") == 0
    keys.press("t")
    assert one.run("camgen.look.tilt") == pytest.approx(np.pi / 2)
    keys.press("?")
    assert one.page.locator("#keys").is_visible()
    keys.press("?")
    keys.press("m")
    assert one.run("camgen.measure.on")


def test_a_graphics_card_that_forgets_all_is_told_all_again(opened: Any) -> None:
    one = opened("solid")
    before = one.picture().astype(int)
    one.run(
        "() => { window.card = camgen.gl.getExtension('WEBGL_lose_context'); window.card.loseContext(); }"
    )
    one.page.wait_for_function("() => camgen.gl.isContextLost()")
    one.page.keyboard.press("t")
    one.page.keyboard.press("i")
    one.run("window.card.restoreContext()")
    one.page.wait_for_function("() => !camgen.gl.isContextLost()")
    assert (np.abs(one.picture().astype(int) - before).max(axis=2) > 60).mean() < 0.02
    assert [text for text in one.log.messages if "CONTEXT_LOST" not in text] == []


def test_f_fits_the_part_and_shift_f_the_robot_too(opened: Any) -> None:
    one = opened("solid")
    # In pixels from the middle: the box of the part and the paths, and that of the base of the robot.
    script = """() => {
      camgen.setScreen();
      const { low, high } = camgen.box;
      const corners = [];
      for (let k = 0; k < 8; k++) corners.push([0, 1, 2].map((i) => (k >> i & 1 ? high[i] : low[i])));
      return [...corners, camgen.arm.base.slice(12, 15)].map((point) => camgen.toScreen(point, 0));
    }"""

    def seen() -> tuple[float, np.ndarray[Any, Any]]:
        # toScreen counts from the top left of the canvas.
        spots = np.array(one.run(script))
        return float(np.ptp(spots[:8], axis=0).max()), spots

    area = one.page.locator("#canvas").bounding_box()
    begun = seen()[0]
    one.page.keyboard.press("f")
    part = seen()[0]
    one.page.keyboard.press("F")
    whole, spots = seen()
    # All of the arm is seen first.
    assert part > begun == pytest.approx(whole)
    assert part > 0.7 * min(area["width"], area["height"])
    assert (spots >= 0).all()
    assert (spots <= (area["width"], area["height"])).all()


def test_an_arm_is_drawn_as_shapes_within_the_cuboids_that_a_layer_shows(opened: Any) -> None:
    one = opened("robot")
    assert one.run(
        "camgen.layers.boxes.off && camgen.layers.boxes.things.every((thing) => !thing.visible)"
    )
    # Of every link: how far its bodies stick out of its cuboids, and how many bodies there are.
    found = one.run(
        """() => camgen.arm.links3.map((link, k) => {
          const told = ([pose, half]) => ({ turn: camgen.inverse(camgen.matrixOf(pose)), half });
          const boxes = camgen.arm.links[k][1].map(told);
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
    assert len(found) == 7
    for bodies, boxes, out in found:
        assert bodies == boxes
        assert out < 0.01
    before = one.picture().astype(int)
    one.page.keyboard.press("l")
    one.page.locator("[data-layer=boxes]").click()
    assert (np.abs(one.picture().astype(int) - before).max(axis=2) > 24).mean() > 0.02


def test_two_clicks_measure_a_distance_between_corners(opened: Any) -> None:
    one = opened("flat")
    one.page.keyboard.press("m")
    # The straight sides of the outline end where its round corners begin: 80 x 50 mm, radius 10.
    ends = one.run(
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
        one.page.mouse.click(x + 2, y - 2)
    said = one.page.locator("#marks .card").inner_text()
    assert said.startswith("60.000 mm")


def test_dragging_turns_and_the_wheel_zooms(opened: Any) -> None:
    one = opened("flat")
    turn, height = one.run("[camgen.look.turn, camgen.look.height]")
    one.page.mouse.move(800, 400)
    one.page.mouse.down()
    one.page.mouse.move(900, 430, steps=5)
    one.page.mouse.up()
    one.page.mouse.wheel(0, -240)
    one.page.wait_for_function("height => camgen.look.height < height", arg=height)
    later = one.run("[camgen.look.turn, camgen.look.height]")
    assert later[0] < turn
    assert later[1] < height
    assert one.run("camgen.chosen.path") == -1


def test_names_that_are_markup_are_shown_and_do_nothing(opened: Any) -> None:
    one = opened("evil")
    assert "<img" in one.page.locator("#notes").inner_text()
    one.page.locator("[data-tab=paths]").click()
    one.page.locator("#rows .row").first.click()
    for tab in one.page.locator("nav button").all():
        tab.click()
    assert one.run("window.bad") is None
    assert one.log.messages == []
    assert one.page.locator("img").count() == 0
    assert "</script>" in one.page.locator("#title").inner_text()


@pytest.mark.parametrize("name", ["robot", "solid"])
def test_on_a_phone_nothing_is_wider_than_the_screen_and_nothing_overlaps(
    opened: Any, name: str
) -> None:
    one = opened(name, size=PHONE)
    assert one.run("document.documentElement.scrollWidth") <= PHONE["width"]
    boxes = one.run(
        """["header", "main", "footer", "aside"].map((name) => {
          const { top, bottom } = document.querySelector(name).getBoundingClientRect();
          return [top, bottom];
        })"""
    )
    assert all(boxes[k][1] <= boxes[k + 1][0] + 1 for k in range(3))
    assert boxes[1][1] - boxes[1][0] > 250
    legend, scale = (one.page.locator(n).bounding_box() for n in ("#legend", "#scale"))
    assert legend["x"] + legend["width"] < scale["x"]


def test_print_has_title_numbers_and_picture(opened: Any) -> None:
    one = opened("solid")
    one.run("dispatchEvent(new Event('beforeprint'))")
    one.page.emulate_media(media="print")
    text = one.page.locator("#print").inner_text()
    assert "rfa1.stl, rapid" in text
    assert "Controller" in text
    assert "Left out" in text
    assert one.run("document.querySelector('#print img').src.length") > 5000
    assert not one.page.locator("footer").is_visible()
