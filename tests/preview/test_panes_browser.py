"""The panes beside the picture in a real browser: notes, the program's text, colours, and the page in a frame."""

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
from tests.support.browsers import SMALL, Driven, OpenPage


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("pages")
    rings = {"operation": {"kind": "trace"}}
    results = {
        "flat": camgen.build(PARTS / "bracket.dxf", post="gcode", job={"tool": {"kind": "pen"}}),
        "left": camgen.build(PARTS / "bracket.dxf", post="gcode", job={"tool": {"diameter": 12.0}}),
        "long": camgen.build(waves(folder), post="gcode", job=rings),
    }
    views = {name: make_view(result) for name, result in results.items()}
    # A program whose text is longer than a page takes.
    views["huge"] = replace(
        views["left"], listing=Listing((), views["left"].listing.lines, "left.ngc: too long")
    )
    for name, shown in views.items():
        (folder / f"{name}.html").write_text(format_page(shown), encoding="utf-8")
    return {name: folder / f"{name}.html" for name in views}


def waves(folder: Path, count: int = 6000) -> Path:
    """A zigzag of many short lines."""
    lines = ["0", "SECTION", "2", "ENTITIES", "0", "POLYLINE", "8", "A", "66", "1"]
    for k in range(count):
        lines += ["0", "VERTEX", "8", "A", "10", str(k * 0.1), "20", str(5 * (k % 2))]
    file = folder / "waves.dxf"
    file.write_text("\n".join([*lines, "0", "SEQEND", "0", "ENDSEC", "0", "EOF\n"]))
    return file


@pytest.fixture
def opened(browser: Driven, files: dict[str, Path]) -> Iterator[Any]:
    pages: list[OpenPage] = []

    def make(name: str, size: dict[str, int] = SMALL, scheme: str = "light") -> OpenPage:
        pages.append(OpenPage(browser, files[name], size, scheme))
        return pages[-1]

    yield make
    for one in pages:
        assert one.log.messages == []
        one.context.close()


def test_a_text_that_is_too_long_costs_neither_picture_nor_notes(opened: Any) -> None:
    one = opened("huge")
    assert one.page.locator("#notes .note").count() > 0
    one.page.locator("nav [data-tab=text]").click()
    assert one.page.locator("#code").inner_text() == "left.ngc: too long"
    # A line that a note is about is no place in it; the slider goes there.
    one.run("camgen.toLine(20)")
    assert one.run("camgen.player.time") > 0
    one.page.locator("nav [data-tab=paths]").click()
    assert one.page.locator("#rows .row").count() > 0


# -- notes


def test_grave_notes_stand_first_and_others_behind_the_paths(opened: Any) -> None:
    one = opened("left")
    assert one.page.locator("[aria-selected=true]").inner_text().startswith("Notes")
    chips = one.page.locator("#kinds button").all_inner_texts()
    told = one.run("camgen.notes.map((note) => note.kind)")
    assert chips[0] == f"{told.count('skipped')} left out"
    assert one.page.locator("#notes .note").count() == len(told)
    one.page.locator("#kinds .skipped").click()
    assert one.page.locator("#notes .note:visible").count() == told.count("skipped")
    assert opened("flat").page.locator("[aria-selected=true]").inner_text() == "Paths 4"


def test_a_note_leads_to_its_place_and_the_place_to_its_note(opened: Any) -> None:
    one = opened("left")
    note = one.page.locator("#notes .skipped.placed").first
    note.click()
    ring = one.page.locator("#pointed i").first.bounding_box()
    area = one.page.locator("#canvas").bounding_box()
    spot = (ring["x"] + ring["width"] / 2, ring["y"] + ring["height"] / 2)
    assert area["x"] < spot[0] < area["x"] + area["width"]
    assert area["y"] < spot[1] < area["y"] + area["height"]
    note.click()
    one.page.wait_for_function("() => !document.querySelector('#pointed i')")
    one.page.locator("[data-tab=paths]").click()
    one.page.mouse.click(*spot)
    assert one.page.locator("[aria-selected=true]").inner_text().startswith("Notes")
    assert "picked" in note.get_attribute("class")


# -- the program's text


def test_the_line_that_runs_is_marked_and_a_click_on_a_line_goes_there(opened: Any) -> None:
    one = opened("flat")
    one.page.locator("[data-tab=text]").click()
    row = one.page.locator(".code", has_text="G1 Z0 F300").first
    row.click()
    assert "now" in row.get_attribute("class")
    at = one.run("camgen.placeAt(camgen.player.time).at[2] + camgen.data.origin[2]")
    assert at == pytest.approx(0.0, abs=1e-4)
    one.page.keyboard.press("ArrowRight")
    assert one.page.locator(".code.now span").inner_text().startswith("G3 ")
    # A comment moves nothing: the next motion does.
    one.page.locator(".code", has_text="(path c4 layer HOLES)").click()
    assert one.page.locator(".code.now span").inner_text() == "(path c4 layer HOLES)"
    assert one.run(
        "camgen.placeAt(camgen.player.time).at[0] + camgen.data.origin[0]"
    ) == pytest.approx(40.472, abs=1e-3)


def test_of_a_long_program_only_what_is_seen_is_in_the_page(opened: Any) -> None:
    one = opened("long")
    one.page.locator("[data-tab=text]").click()
    assert one.run("camgen.listing.rows.length") > 6000
    one.run("camgen.player.to(camgen.track.time[4000])")
    assert one.page.locator(".code").count() < 120
    marked = one.page.locator(".code.now")
    assert marked.is_visible()
    assert int(marked.locator("i").inner_text()) > 3000


# -- light and dark


def test_the_switch_goes_through_the_colours_and_is_remembered(opened: Any) -> None:
    one = opened("flat", scheme="dark")
    back = "getComputedStyle(document.body).backgroundColor"
    dark = one.run(back)
    one.page.locator("#theme").click()
    light = one.run(back)
    assert light != dark
    one.page.reload()
    assert one.run(back) == light
    one.page.locator("#theme").click()
    assert one.run(back) == dark
    one.page.locator("#theme").click()
    one.page.emulate_media(color_scheme="light")
    one.page.wait_for_function(
        "light => getComputedStyle(document.body).backgroundColor === light", arg=light
    )


# -- in a frame

PARENT = """<!doctype html><iframe id="inner" src="/page" style="width:1200px;height:760px"></iframe>
<script>window.got = []; addEventListener("message", (event) => got.push(event.data));
window.say = (message) => document.getElementById("inner").contentWindow.postMessage(message, location.origin);
</script>"""


@pytest.fixture
def framed(browser: Driven, files: dict[str, Path]) -> Iterator[Any]:
    context = browser.new_context(viewport={"width": 1300, "height": 800})
    context.set_default_timeout(60_000)
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


def ask(tab: Any) -> dict[str, Any]:
    tab.evaluate("got.length = 0; say({ camgen: 'state?' })")
    tab.wait_for_function("() => got.some((one) => one.camgen === 'state')")
    found = tab.evaluate("got.find((one) => one.camgen === 'state').state")
    assert isinstance(found, dict)
    return found


def test_a_page_in_a_frame_gives_its_state_and_takes_it_again(framed: Any) -> None:
    inner = framed.frame_locator("#inner")
    begun = ask(framed)
    inner.locator("#rows .row").nth(2).click()
    inner.locator("[data-tab=text]").click()
    inner.locator("#canvas").hover()
    framed.mouse.wheel(0, -240)
    framed.evaluate(
        "say({ camgen: 'restore', state: { time: 5.0, layers: { travel: false }, colouring: 'feed' } })"
    )
    later = ask(framed)
    assert (later["tab"], later["time"], later["colouring"]) == ("text", 5.0, "feed")
    assert later["layers"]["travel"] is False
    framed.evaluate("state => say({ camgen: 'restore', state })", begun)
    assert ask(framed) == begun
    framed.evaluate("state => say({ camgen: 'restore', state })", later)
    assert ask(framed) == later
    # A path that is gone: none is chosen; what is no state does nothing.
    framed.evaluate(
        "state => say({ camgen: 'restore', state })",
        later | {"id": "gone", "tab": "none", "side": "x;y"},
    )
    framed.evaluate("say({ camgen: 'restore', state: 7 }); say({ camgen: 'other' }); say(null)")
    assert ask(framed)["id"] == ""


def test_a_click_is_told_and_a_path_is_chosen_from_outside(framed: Any) -> None:
    inner = framed.frame_locator("#inner")
    framed.evaluate("got.length = 0")
    inner.locator("#rows .row").nth(1).click()
    framed.wait_for_function("() => got.length > 0")
    assert framed.evaluate("got[0]") | {"x": 0, "y": 0, "z": 0} == {
        **{"camgen": "picked", "path": 1, "id": "c4", "layer": "HOLES", "source": "path"},
        **{"x": 0, "y": 0, "z": 0},
    }
    framed.evaluate("say({ camgen: 'choose', id: 'c1' })")
    assert ask(framed)["id"] == "c1"
    framed.evaluate("say({ camgen: 'theme', theme: 'dark' })")
    assert inner.locator("html").get_attribute("data-theme") == "dark"


def test_messages_from_elsewhere_do_nothing(framed: Any) -> None:
    begun = ask(framed)
    inner = next(frame for frame in framed.frames if frame.url.endswith("/page"))
    told = json.dumps({"camgen": "choose", "id": "c1"})
    inner.evaluate(f"window.postMessage({told}, location.origin)")
    assert ask(framed) == begun


# -- what is said of the moment


@pytest.mark.parametrize("wide", [1400, 1280, 1000, 760, 390])
def test_nothing_of_what_is_said_of_the_moment_is_cut_off(opened: Any, wide: int) -> None:
    one = opened("flat", size={"width": wide, "height": 800})
    one.run("camgen.player.to(20)")
    for name in ("where", "what"):
        script = "id => ((one) => [one.clientWidth || one.offsetWidth, one.scrollWidth])(document.getElementById(id))"
        seen, needed = one.page.evaluate(script, name)
        assert seen >= needed
    now, foot = one.page.locator("#what").bounding_box(), one.page.locator("footer").bounding_box()
    assert now["x"] + now["width"] <= wide
    assert now["y"] + now["height"] <= foot["y"] + foot["height"] <= 800
