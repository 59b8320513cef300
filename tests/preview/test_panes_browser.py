"""The panes beside the picture in a browser: notes, text of the program, colours, frames.

The pages have no WebGL, so that they show no scene.
"""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

import camgen
from camgen.preview.listing import Listing
from camgen.preview.page import format_page
from camgen.preview.view import make_view
from tests.preview.test_page import PARTS
from tests.support.browsers import SMALL, Driven, OpenPage, open_context


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Files of pages by name: four holes, paths left out, 6000 lines, and a text left out."""
    folder = tmp_path_factory.mktemp("pages")
    rings = {"operation": {"kind": "trace"}}
    results = {
        "flat": camgen.build(PARTS / "bracket.dxf", post="gcode", job={"tool": {"kind": "pen"}}),
        "left": camgen.build(PARTS / "bracket.dxf", post="gcode", job={"tool": {"diameter": 12.0}}),
        "long": camgen.build(write_zigzag(folder), post="gcode", job=rings),
    }
    views = {name: make_view(result) for name, result in results.items()}
    # A page without the text of its program, which is too long.
    views["huge"] = replace(
        views["left"], listing=Listing((), views["left"].listing.lines, "left.ngc: too long")
    )
    for name, shown in views.items():
        (folder / f"{name}.html").write_text(format_page(shown), encoding="utf-8")
    return {name: folder / f"{name}.html" for name in views}


def write_zigzag(folder: Path, count: int = 6000) -> Path:
    """Writes a drawing of a zigzag of `count` short lines."""
    lines = ["0", "SECTION", "2", "ENTITIES", "0", "POLYLINE", "8", "A", "66", "1"]
    for k in range(count):
        lines += ["0", "VERTEX", "8", "A", "10", str(k * 0.1), "20", str(5 * (k % 2))]
    file = folder / "waves.dxf"
    file.write_text("\n".join([*lines, "0", "SEQEND", "0", "ENDSEC", "0", "EOF\n"]))
    return file


@pytest.fixture
def opened(browser: Driven, files: dict[str, Path]) -> Iterator[Any]:
    """Opens a page by its name in a new tab; after the test no tab may have logged anything."""
    pages: list[OpenPage] = []

    def make(name: str, size: dict[str, int] = SMALL, scheme: str = "light") -> OpenPage:
        pages.append(OpenPage(browser, files[name], size, scheme, draws=False))
        return pages[-1]

    yield make
    for tab in pages:
        assert tab.log.messages == []
        tab.context.close()


def test_a_page_without_the_text_of_a_long_program_has_its_picture_and_notes(opened: Any) -> None:
    tab = opened("huge")
    assert tab.page.locator("#notes .note").count() > 0
    tab.page.locator("nav [data-tab=text]").click()
    assert tab.page.locator("#code").inner_text() == "left.ngc: too long"
    # There is no text to scroll to a line of a note; the slider moves to its time.
    tab.run("camgen.toLine(20)")
    assert tab.run("camgen.player.time") > 0
    tab.page.locator("nav [data-tab=paths]").click()
    assert tab.page.locator("#rows .row").count() > 0


# -- notes


def test_the_pane_of_notes_is_open_if_a_path_is_left_out(opened: Any) -> None:
    tab = opened("left")
    assert tab.page.locator("[aria-selected=true]").inner_text().startswith("Notes")
    chips = tab.page.locator("#kinds button").all_inner_texts()
    kinds = tab.run("camgen.notes.map((note) => note.kind)")
    assert chips[0] == f"{kinds.count('skipped')} left out"
    assert tab.page.locator("#notes .note").count() == len(kinds)
    tab.page.locator("#kinds .skipped").click()
    assert tab.page.locator("#notes .note:visible").count() == kinds.count("skipped")
    assert opened("flat").page.locator("[aria-selected=true]").inner_text() == "Paths 4"


def test_a_click_on_a_note_marks_its_place_and_a_click_on_the_place_its_note(opened: Any) -> None:
    tab = opened("left")
    note = tab.page.locator("#notes .skipped.placed").first
    note.click()
    ring = tab.page.locator("#pointed i").first.bounding_box()
    area = tab.page.locator("#canvas").bounding_box()
    spot = (ring["x"] + ring["width"] / 2, ring["y"] + ring["height"] / 2)
    assert area["x"] < spot[0] < area["x"] + area["width"]
    assert area["y"] < spot[1] < area["y"] + area["height"]
    note.click()
    tab.page.wait_for_function("() => !document.querySelector('#pointed i')")
    tab.page.locator("[data-tab=paths]").click()
    tab.page.mouse.click(*spot)
    assert tab.page.locator("[aria-selected=true]").inner_text().startswith("Notes")
    assert "picked" in note.get_attribute("class")


# -- the program's text


def test_the_line_that_runs_is_marked_and_a_click_on_a_line_moves_the_tool(opened: Any) -> None:
    tab = opened("flat")
    tab.page.locator("[data-tab=text]").click()
    row = tab.page.locator(".code", has_text="G1 Z0 F300").first
    row.click()
    assert "now" in row.get_attribute("class")
    height_mm = tab.run("camgen.placeAt(camgen.player.time).at[2] + camgen.data.origin[2]")
    assert height_mm == pytest.approx(0.0, abs=1e-4)
    tab.page.keyboard.press("ArrowRight")
    assert tab.page.locator(".code.now span").inner_text().startswith("G3 ")
    # A comment does not move the tool, so the next motion is shown.
    tab.page.locator(".code", has_text="(path c4 layer HOLES)").click()
    assert tab.page.locator(".code.now span").inner_text() == "(path c4 layer HOLES)"
    assert tab.run(
        "camgen.placeAt(camgen.player.time).at[0] + camgen.data.origin[0]"
    ) == pytest.approx(40.472, abs=1e-3)


def test_only_the_visible_lines_of_a_long_program_are_in_the_page(opened: Any) -> None:
    tab = opened("long")
    tab.page.locator("[data-tab=text]").click()
    assert tab.run("camgen.listing.rows.length") > 6000
    tab.run("camgen.player.to(camgen.track.time[4000])")
    assert tab.page.locator(".code").count() < 120
    marked = tab.page.locator(".code.now")
    assert marked.is_visible()
    assert int(marked.locator("i").inner_text()) > 3000


# -- light and dark


def test_the_switch_of_light_and_dark_is_remembered(opened: Any) -> None:
    tab = opened("flat", scheme="dark")
    background = "getComputedStyle(document.body).backgroundColor"
    dark = tab.run(background)
    tab.page.locator("#theme").click()
    light = tab.run(background)
    assert light != dark
    tab.page.reload()
    assert tab.run(background) == light
    tab.page.locator("#theme").click()
    assert tab.run(background) == dark
    tab.page.locator("#theme").click()
    tab.page.emulate_media(color_scheme="light")
    tab.page.wait_for_function(
        "light => getComputedStyle(document.body).backgroundColor === light", arg=light
    )


# -- in a frame

#: A page with the page of a part in a frame. `got` has the messages of the frame, `say` sends one.
PARENT = """<!doctype html>
<iframe id="inner" src="/page" style="width:1200px;height:760px"></iframe>
<script>window.got = []; addEventListener("message", (event) => got.push(event.data));
window.say = (message) => {
  document.getElementById("inner").contentWindow.postMessage(message, location.origin);
};
</script>"""


@pytest.fixture
def framed(browser: Driven, files: dict[str, Path]) -> Iterator[Any]:
    """The page `PARENT` after the page in its frame was loaded."""
    context = open_context(browser, draws=False, viewport={"width": 1300, "height": 800})
    context.route(
        "http://camgen.test/**",
        lambda route: route.fulfill(
            content_type="text/html",
            body=PARENT
            if route.request.url.endswith("/")
            else files["flat"].read_text(encoding="utf-8"),
        ),
    )
    tab = context.new_page()
    tab.goto("http://camgen.test/")
    tab.wait_for_function("() => got.some((one) => one.camgen === 'ready')")
    yield tab
    context.close()


def read_state(tab: Any) -> dict[str, Any]:
    """Asks the page in the frame for its state."""
    tab.evaluate("got.length = 0; say({ camgen: 'state?' })")
    tab.wait_for_function("() => got.some((one) => one.camgen === 'state')")
    state = tab.evaluate("got.find((one) => one.camgen === 'state').state")
    assert isinstance(state, dict)
    return state


def test_a_page_in_a_frame_sends_its_state_and_restores_it(framed: Any) -> None:
    inner = framed.frame_locator("#inner")
    first_state = read_state(framed)
    inner.locator("#rows .row").nth(2).click()
    inner.locator("[data-tab=text]").click()
    inner.locator("#canvas").hover()
    framed.mouse.wheel(0, -240)
    framed.evaluate(
        "say({ camgen: 'restore', state: "
        "{ time: 5.0, layers: { travel: false }, colouring: 'feed' } })"
    )
    second_state = read_state(framed)
    assert (second_state["tab"], second_state["time"], second_state["colouring"]) == (
        "text",
        5.0,
        "feed",
    )
    assert second_state["layers"]["travel"] is False
    framed.evaluate("state => say({ camgen: 'restore', state })", first_state)
    assert read_state(framed) == first_state
    framed.evaluate("state => say({ camgen: 'restore', state })", second_state)
    assert read_state(framed) == second_state
    # An unknown path is not chosen. Messages without a state do nothing.
    framed.evaluate(
        "state => say({ camgen: 'restore', state })",
        second_state | {"id": "gone", "tab": "none", "side": "x;y"},
    )
    framed.evaluate("say({ camgen: 'restore', state: 7 }); say({ camgen: 'other' }); say(null)")
    assert read_state(framed)["id"] == ""


def test_a_click_is_sent_to_the_parent_which_can_choose_a_path(framed: Any) -> None:
    inner = framed.frame_locator("#inner")
    framed.evaluate("got.length = 0")
    inner.locator("#rows .row").nth(1).click()
    framed.wait_for_function("() => got.length > 0")
    assert framed.evaluate("got[0]") | {"x": 0, "y": 0, "z": 0} == {
        **{"camgen": "picked", "path": 1, "id": "c4", "layer": "HOLES", "source": "path"},
        **{"x": 0, "y": 0, "z": 0},
    }
    framed.evaluate("say({ camgen: 'choose', id: 'c1' })")
    assert read_state(framed)["id"] == "c1"
    framed.evaluate("say({ camgen: 'theme', theme: 'dark' })")
    assert inner.locator("html").get_attribute("data-theme") == "dark"


def test_messages_of_other_windows_do_nothing(framed: Any) -> None:
    first_state = read_state(framed)
    inner = next(frame for frame in framed.frames if frame.url.endswith("/page"))
    message = json.dumps({"camgen": "choose", "id": "c1"})
    inner.evaluate(f"window.postMessage({message}, location.origin)")
    assert read_state(framed) == first_state


# -- the line about the current time


@pytest.fixture(scope="module")
def flat_page(browser: Driven, files: dict[str, Path]) -> Iterator[OpenPage]:
    """A page whose window the tests change."""
    opened = OpenPage(browser, files["flat"], draws=False)
    yield opened
    opened.context.close()


@pytest.mark.parametrize("width", [1400, 1280, 1000, 760, 390])
def test_the_line_about_the_current_time_is_not_cut_off(flat_page: OpenPage, width: int) -> None:
    tab = flat_page
    tab.page.set_viewport_size({"width": width, "height": 800})
    tab.run("camgen.player.to(20)")
    assert tab.run("innerWidth") == width
    for name in ("where", "what"):
        script = (
            "id => ((one) => [one.clientWidth || one.offsetWidth, one.scrollWidth])"
            "(document.getElementById(id))"
        )
        visible_px, needed_px = tab.page.evaluate(script, name)
        assert visible_px >= needed_px
    line_box, foot_box = (
        tab.page.locator("#what").bounding_box(),
        tab.page.locator("footer").bounding_box(),
    )
    assert line_box["x"] + line_box["width"] <= width
    assert line_box["y"] + line_box["height"] <= foot_box["y"] + foot_box["height"] <= 800
    assert tab.log.messages == []
