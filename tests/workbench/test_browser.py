"""The workbench in a real browser without a window: forms, pictures, keys, tabs, reloads, ends."""

import shutil
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import ezdxf
import numpy as np
import pytest

from camgen.cli import main
from tests.support.benches import Bench, open_bench
from tests.support.browsers import PHONE, Driven, start_browser
from tests.support.tabs import POLL, Tab
from tests.support.waiting import LONG, wait_for

pytest.importorskip("uvicorn", reason="the extra workbench is not installed")
PARTS = Path(__file__).parents[2] / "fixtures" / "parts"


@pytest.fixture(scope="module")
def browser() -> Iterator[Driven]:
    with start_browser() as opened:
        yield opened


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    shutil.copy(PARTS / "bracket.dxf", tmp_path / "part.dxf")
    return tmp_path


@pytest.fixture(scope="module")
def common_bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    work = tmp_path_factory.mktemp("common")
    shutil.copy(PARTS / "bracket.dxf", work / "part.dxf")
    with open_bench(work, ["part.dxf"]) as opened:
        yield opened


@pytest.fixture
def bench(common_bench: Bench) -> Iterator[Bench]:
    """A workbench for tests that write no file. Their changes are undone afterwards."""
    yield common_bench
    common_bench.undo_all()


@pytest.fixture
def tab(browser: Driven, bench: Bench) -> Iterator[Tab]:
    opened = Tab(browser, bench)
    yield opened
    opened.context.close()


@pytest.fixture
def drawn_tab(browser: Driven, bench: Bench) -> Iterator[Tab]:
    """A tab whose pages draw their scenes."""
    opened = Tab(browser, bench, draws=True)
    yield opened
    opened.context.close()


@pytest.fixture
def own_tab(browser: Driven, folder: Path) -> Iterator[Tab]:
    """The page of a workbench that no other test uses, as the test changes files or ends it."""
    with open_bench(folder, ["part.dxf"]) as started:
        opened = Tab(browser, started)
        yield opened
        opened.context.close()


def test_a_change_is_built_at_once_and_saved_as_the_command_line_does(
    own_tab: Tab, folder: Path, tmp_path: Path
) -> None:
    first = own_tab.rest()["built"]["number"]
    before = own_tab.shown(first).locator("#rows").inner_text()
    own_tab.enter("process.feed", "31")
    second = own_tab.rest("s.tables.process")["built"]["number"]
    frame = own_tab.shown(second)
    assert own_tab.page.locator("#frames iframe").count() == 1
    assert frame.locator("#rows").inner_text() != before
    assert own_tab.page.locator('[data-path=\'["process","feed"]\'].changed').count() == 1
    assert "\u2022" in own_tab.page.title()
    own_tab.page.keyboard.press("Control+s")
    assert own_tab.rest("s.saved && s.told")["told"] == "written: part.toml, part.ngc"
    assert (folder / "part.toml").read_text().endswith("\n[process]\nfeed = 31\n")
    program = (folder / "part.ngc").read_bytes()
    (tmp_path / "again").mkdir()
    assert (
        main(
            [
                "build",
                str(folder / "part.dxf"),
                "--post",
                "gcode",
                "-o",
                str(tmp_path / "again"),
                "-q",
            ]
        )
        == 0
    )
    assert (tmp_path / "again" / "part.ngc").read_bytes() == program
    assert own_tab.log.messages == []
    origin = own_tab.bench.address.rpartition("/")[0]
    assert [
        url for url in own_tab.log.requests if not url.startswith((origin, "blob:", "data:"))
    ] == []


def test_the_view_of_the_page_survives_a_new_program(drawn_tab: Tab) -> None:
    """The view: camera, chosen path, time, pane, layers and colouring."""
    frame = drawn_tab.shown(drawn_tab.rest()["built"]["number"])
    frame.evaluate(
        "() => { const { look, player } = camgen; look.turn = 0.7; look.tilt = 0.9; "
        "look.height = 55; look.own = true; look.target = [3, 4, 5]; player.to(4); }"
    )
    frame.locator("nav button[data-tab=paths]").click()
    rows = frame.locator("#rows > *")
    rows.nth(1).click()
    frame.locator("nav button[data-tab=text]").click()
    frame.locator(".switch button[data-by=feed]").click()
    before = frame.evaluate("camgen.viewState()")
    assert before["id"]
    drawn_tab.enter("process.feed", "31")
    after = drawn_tab.shown(drawn_tab.rest("s.tables.process")["built"]["number"]).evaluate(
        "camgen.viewState()"
    )
    for name in ("id", "tab", "colouring", "layers"):
        assert after[name] == before[name]
    for name in ("turn", "tilt", "height"):
        assert after["camera"][name] == pytest.approx(before["camera"][name], abs=1e-6)
    assert after["camera"]["target"] == pytest.approx(before["camera"]["target"], abs=1e-4)
    assert after["time"] == pytest.approx(before["time"], abs=1e-6)
    assert drawn_tab.log.messages == []


def test_an_error_is_shown_at_its_setting_and_the_last_program_stays(tab: Tab) -> None:
    number = tab.rest()["built"]["number"]
    tab.enter("process.force", "-1")
    tab.rest("s.failed")
    line = "error: part.toml: force must be a number >= 0, not -1 ([process])"
    assert tab.page.locator("#says .bad span").inner_text() == line
    wrong = tab.page.locator(".field.wrong")
    assert wrong.count() == 1
    assert line in wrong.inner_text()
    tab.shown(number)
    assert tab.page.locator("#save").is_disabled()
    tab.page.locator("#filter").fill("nothing has this word")
    tab.page.locator("#says button").click()
    assert tab.page.evaluate("document.activeElement.id") == "f-process-force"
    wrong.locator(".reset").click()
    assert tab.rest("!s.failed")["tables"] == {}
    assert tab.page.locator("#says p").count() == 0


def test_settings_are_found_by_their_words_and_by_their_changes(tab: Tab) -> None:
    tab.page.locator("#filter").fill("spindle speed")
    assert tab.page.locator("#f-process-spindle").is_visible()
    assert not tab.page.locator("#f-process-feed").is_visible()
    tab.page.locator("#filter").fill("")
    tab.enter("tool.diameter", "4")
    tab.rest("s.tables.tool")
    # Defaults follow from the job: plunge is a third of the feed, and a page has a lower clearance.
    assert tab.field("process.plunge").get_attribute("placeholder") == "6.666667"
    assert tab.field("process.clearance").input_value() == "20"
    tab.enter("page.size", "A4")
    tab.rest("s.tables.page")
    assert tab.field("process.clearance").input_value() == "3"
    assert (
        "default: 3 here, else 20"
        in tab.page.locator('[data-path=\'["process","clearance"]\'] .usual').inner_text()
    )
    tab.page.locator("#undo").click()
    tab.rest("!s.tables.page")
    tab.page.locator("#only").check()
    assert tab.page.locator("#groups .field:visible").count() == 1


def test_arrow_keys_step_a_number(tab: Tab) -> None:
    tab.field("process.feed").press("ArrowUp")
    tab.field("process.feed").press("Shift+ArrowUp")
    assert tab.rest("s.tables.process?.feed === 31")["failed"] is None


def test_a_second_tab_and_a_reload_show_the_same_session(tab: Tab, browser: Driven) -> None:
    tab.enter("tool.diameter", "5")
    tab.rest("s.tables.tool")
    other = Tab(browser, tab.bench)
    assert other.rest()["tables"] == {"tool": {"diameter": 5}}
    other.enter("tool.diameter", "3")
    number = tab.rest("s.tables.tool?.diameter === 3")["built"]["number"]
    tab.shown(number)
    assert tab.field("tool.diameter").input_value() == "3"
    other.context.close()
    tab.page.reload()
    assert tab.rest()["tables"] == {"tool": {"diameter": 3}}
    tab.shown(number)
    tab.page.locator("#undo").click()
    assert tab.rest("s.tables.tool?.diameter === 5")["undo"] == 1


def test_a_click_leaves_a_contour_out_and_a_layer_is_switched(tab: Tab) -> None:
    frame = tab.shown(tab.rest()["built"]["number"])
    message = {
        "camgen": "picked",
        "path": 3,
        "id": "c1",
        "layer": "OUTLINE",
        "source": "path",
        "x": 0,
        "y": 0,
    }
    frame.evaluate("message => parent.postMessage(message, location.origin)", message)
    card = tab.page.locator("#picked")
    card.get_by_text("Leave out c1").click()
    assert tab.rest("s.tables.operations")["tables"] == {
        "operations": [{"ids": ["c2", "c3", "c4"]}]
    }
    assert not card.is_visible()
    tab.page.locator("[data-tab=layers]").click()
    tab.page.get_by_text("Take in").click()
    tab.rest("!s.tables.operations")
    tab.page.locator("#layers input[type=checkbox]").first.uncheck()
    assert tab.rest("s.tables.input")["tables"] == {"input": {"layers": ["*", "!HOLES"]}}
    tab.page.locator("#layers input[type=checkbox]").first.check()
    tab.rest("!s.tables.input")
    # A layer is moved by dragging, and by keys.
    rows = tab.page.locator("#layers .layer")
    rows.nth(1).locator(".grip").drag_to(rows.nth(0))
    assert tab.rest("s.tables.tour")["tables"] == {"tour": {"layers": ["OUTLINE", "HOLES"]}}
    rows.nth(0).locator(".grip").press("Alt+ArrowDown")
    assert tab.rest("s.tables.tour?.layers[0] === 'HOLES'")["failed"] is None


def test_a_seam_is_dragged_along_its_path_and_a_row_to_another_place(tab: Tab) -> None:
    frame = tab.shown(tab.rest()["built"]["number"])
    frame.locator("nav button[data-tab=paths]").click()
    # camgen chooses the seams; c1, the outline, is the last of four paths.
    frame.locator("#rows .row").nth(3).click()
    ring = frame.locator(".seam")
    ring.wait_for()
    box = ring.bounding_box()
    assert box is not None
    tab.page.mouse.move(box["x"] + 11, box["y"] + 11)
    tab.page.mouse.down()
    tab.page.mouse.move(box["x"] + 90, box["y"] - 60, steps=4)
    tab.page.mouse.up()
    state = tab.rest("s.tables.tour?.seams")
    assert state["failed"] is None
    (point,) = state["tables"]["tour"]["seams"]
    frame = tab.shown(state["built"]["number"])
    assert frame.locator(".seam.set").is_visible()
    run = state["looked"]["runs"][3]
    assert run["point"] == point
    # The seam is at a corner near the point, or within the last digit of the point.
    assert run["seam"][:2] == pytest.approx(point, abs=0.11)
    # A key moves the seam by one step of 1 mm along the path.
    frame.locator(".seam").press("ArrowRight")
    frame.locator(".seam").press("Enter")
    state = tab.rest(
        f"s.tables.tour?.seams?.[0][0] !== {point[0]} || "
        f"s.tables.tour?.seams?.[0][1] !== {point[1]}"
    )
    moved = state["looked"]["runs"][3]["seam"]
    assert 0.5 < float(np.hypot(moved[0] - run["seam"][0], moved[1] - run["seam"][1])) <= 1.01
    # A row of the list is moved by dragging, and by keys. It stays chosen and keeps the focus.
    frame = tab.shown(state["built"]["number"])
    third = frame.evaluate("camgen.data.paths[2].id")
    frame.locator("#rows .row").nth(2).drag_to(frame.locator("#rows .row").nth(0))
    state = tab.rest("s.tables.tour.order")
    assert state["tables"]["tour"]["order"] == [third]
    frame = tab.shown(state["built"]["number"])
    assert frame.evaluate("camgen.data.paths[0].id") == third
    frame.locator("#rows .row").nth(0).click()
    frame.locator("#list").press("Alt+ArrowDown")
    state = tab.rest("s.tables.tour.order?.length === 2")
    assert state["tables"]["tour"]["order"][1] == third
    # The outline cannot run before its holes: the error states it, and undo goes one step back.
    frame = tab.shown(state["built"]["number"])
    frame.locator("#rows .row").nth(3).drag_to(frame.locator("#rows .row").nth(0))
    assert "c1 would be run before path" in tab.rest("s.failed")["failed"]["line"]
    tab.page.locator("#undo").click()
    state = tab.rest("!s.failed")
    # camgen chooses the seam again. The row that was clicked stays chosen.
    tab.shown(state["built"]["number"]).locator("#rows .row").nth(3).click()
    tab.page.get_by_text("Seam chosen by camgen").click()
    assert "seams" not in tab.rest("!s.tables.tour.seams")["tables"]["tour"]
    assert tab.log.messages == []


def test_messages_of_other_pages_are_ignored(tab: Tab) -> None:
    tab.shown(tab.rest()["built"]["number"])
    tab.page.evaluate(
        "postMessage({ camgen: 'picked', path: 3, id: 'c1', layer: 'OUTLINE' }, location.origin)"
    )
    tab.page.evaluate(
        """() => new Promise((done) => {
          const frame = document.createElement("iframe");
          frame.srcdoc = "<p>";
          frame.onload = done;
          document.body.append(frame);
        })"""
    )
    tab.page.wait_for_timeout(200)
    assert not tab.page.locator("#picked").is_visible()


def test_operations_are_added_set_moved_and_removed(tab: Tab) -> None:
    tab.page.locator("[data-tab=steps]").click()
    tab.page.get_by_text("Add operation").click()
    tab.rest("s.tables.operations?.length === 1")
    row = tab.page.locator("[data-row='operations.0']")
    row.get_by_text("Edit").click()
    row.locator("select.more").select_option("kind")
    tab.rest("s.tables.operations[0].kind")
    tab.page.locator("#f-operations-0-kind").select_option("drill")
    tab.rest("s.tables.operations[0].kind === 'drill'")
    row.locator("select.more").select_option("layers")
    tab.rest("s.tables.operations[0].layers")
    tab.page.locator("#f-operations-0-layers").fill('["HOLES"]')
    tab.page.locator("#f-operations-0-layers").press("Enter")
    tab.rest("s.tables.operations[0].layers[0] === 'HOLES'")
    tab.page.get_by_text("Add operation").click()
    tab.rest("s.tables.operations?.length === 2")
    tab.page.locator("[data-row='operations.1'] .grip").press("Alt+ArrowUp")
    state = tab.rest("s.tables.operations[1].kind === 'drill'")
    assert state["tables"]["operations"] == [{}, {"kind": "drill", "layers": ["HOLES"]}]
    tab.page.locator("[data-row='operations.0']").get_by_role("button", name="Remove").click()
    assert (
        tab.rest("s.tables.operations.length === 1")["tables"]["operations"][0]["kind"] == "drill"
    )
    assert tab.log.messages == []


def test_a_photo_shows_its_stages_live(browser: Driven, tmp_path: Path) -> None:
    # A bright disc with a ring of half its brightness around it.
    photo = cv2.circle(np.full((200, 300, 3), 30, np.uint8), (150, 100), 70, (120, 120, 120), -1)
    cv2.imwrite(str(tmp_path / "disc.png"), cv2.circle(photo, (150, 100), 40, (230, 230, 230), -1))
    with open_bench(tmp_path, ["disc.png", "--set", "image.mm_per_px=0.2"]) as bench:
        tab = Tab(browser, bench)
        state = tab.rest()
        assert state["failed"] is None, state["failed"]
        assert state["looked"]["kind"] == "picture"
        tab.page.get_by_text("From picture to path").click()
        picture = tab.page.locator("#picture img")
        tab.page.wait_for_function("() => document.querySelector('#picture img').naturalWidth > 0")
        before = decode_image(picture.screenshot())
        tab.field("image.mask").select_option("threshold")
        tab.page.locator(".field:has(#f-image-threshold) input[type=range]").fill("200")
        picture_number = tab.rest("s.tables.image.threshold === 200")["picture"]
        tab.page.wait_for_function(
            f"() => document.querySelector('#picture img').src.endsWith('/{picture_number}')"
        )
        tab.page.wait_for_function("() => document.querySelector('#picture img').complete")
        after = decode_image(picture.screenshot())
        assert after.shape != before.shape or np.abs(after.astype(int) - before).max() > 50
        assert tab.log.messages == []
        tab.context.close()


def test_a_photo_without_a_scale_is_shown_and_its_scale_requested(
    browser: Driven, tmp_path: Path
) -> None:
    cv2.imwrite(
        str(tmp_path / "photo.png"),
        cv2.circle(np.full((200, 300, 3), 30, np.uint8), (150, 100), 60, (220, 220, 220), -1),
    )
    with open_bench(tmp_path, ["photo.png"]) as bench:
        tab = Tab(browser, bench)
        state = tab.rest()
        assert "mm_per_px" in state["failed"]["line"]
        tab.page.wait_for_function("() => document.querySelector('#picture img').naturalWidth > 0")
        assert tab.page.locator("#picture").is_visible()
        tab.enter("image.mm_per_px", "0.2")
        assert tab.rest("s.tables.image")["failed"] is None
        tab.context.close()


def test_a_changed_file_is_read_again(own_tab: Tab, folder: Path) -> None:
    first = own_tab.rest()["built"]["number"]
    shutil.copy(PARTS / "plate.dxf", folder / "part.dxf")
    second = own_tab.rest(f"s.built.number > {first}")["built"]["number"]
    own_tab.shown(second)
    own_tab.enter("process.feed", "30")
    own_tab.rest("s.tables.process")
    (folder / "part.toml").write_text("[process]\nfeed = 14\n")
    own_tab.page.get_by_text("Read the file").click()
    assert own_tab.rest("s.tables.process.feed === 14")["saved"]
    assert own_tab.field("process.feed").input_value() == "14"


def test_the_end_of_the_server_is_reported(own_tab: Tab) -> None:
    own_tab.rest()
    own_tab.bench.process.send_signal(signal.SIGKILL)
    own_tab.page.wait_for_selector("#says .bad")
    assert "does not answer" in own_tab.page.locator("#says").inner_text()
    assert own_tab.page.locator("#says").get_by_text("Copy the job").is_visible()


def test_close_ends_the_workbench_and_the_page_states_it(own_tab: Tab) -> None:
    own_tab.rest()
    own_tab.page.locator("#close").click()
    own_tab.page.wait_for_selector("#says .look")
    assert "is closed" in own_tab.page.locator("#says").inner_text()
    assert own_tab.bench.process.wait(LONG) == 0


def test_names_that_are_markup_do_nothing(browser: Driven, tmp_path: Path) -> None:
    evil = "<img src=x onerror=parent.bad=1>"
    drawing = ezdxf.new("R2010", units=4)
    drawing.modelspace().add_circle((0, 0), 20, dxfattribs={"layer": "&amp b"})
    drawing.saveas(tmp_path / f"{evil}.dxf")
    with open_bench(tmp_path, [f"{evil}.dxf", "--set", f"tool.name={evil}"]) as bench:
        tab = Tab(browser, bench)
        tab.rest()
        for button in tab.page.locator("aside [role=tab]").all():
            button.click()
        assert tab.page.evaluate("window.bad") is None
        assert tab.page.locator("aside img").count() == 0
        assert evil in tab.page.locator("h1").inner_text()
        tab.context.close()


def test_on_a_phone_nothing_is_wider_than_the_screen(browser: Driven, bench: Bench) -> None:
    tab = Tab(browser, bench, PHONE)
    for button in tab.page.locator("aside [role=tab]").all():
        button.click()
        assert tab.page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
    tab.context.close()


def decode_image(raw: bytes) -> Any:
    return cv2.imdecode(np.frombuffer(raw, np.uint8), cv2.IMREAD_COLOR)


# Keys. They are read from the help, so that a key without a test is noticed.

#: Elements that have the focus. A text field takes the keys that it does not type.
FOCUS = {
    "field": ("settings", "#f-process-feed"),
    "form": ("settings", "#settings"),
    "list": ("steps", "[data-row='operations.0'] .grip"),
    "picture": ("settings", "#canvas"),
    "paths": ("settings", "#list"),
}
IN_PICTURE = ("picture", "paths")


def focus(tab: Tab, name: str) -> None:
    """Gives an element the focus as a user does: the picture by a click.

    No build may run that would bring a new picture.
    """
    pane, selector = FOCUS[name]
    tab.open(pane)
    if name in IN_PICTURE:
        frame = tab.shown(tab.page.evaluate("workbench.state().built.number"))
    if name == "picture":
        frame.locator(selector).click(position={"x": 4, "y": 200})
    elif name == "paths":
        frame.locator("nav button[data-tab=paths]").click()
        frame.locator(selector).focus()
    else:
        tab.page.locator(selector).focus()


def list_help_keys(tab: Tab, section: int) -> list[str]:
    """The names of keys in a section of the help."""
    tab.page.locator("#help").click()
    texts = tab.page.locator(f"#keys .keys >> nth={section} >> kbd").all_inner_texts()
    tab.page.locator("#keys button").click()
    return ", ".join(texts).split(", ")


def wait_state(tab: Tab, condition: str) -> None:
    """Waits for a state, called s, while builds may run."""
    tab.page.wait_for_function(
        f"() => {{ const s = workbench.state(); return {condition}; }}", polling=POLL
    )


def press_save(tab: Tab, key: str, place: str) -> None:
    height = 21 + list(FOCUS).index(place)
    tab.bench.change("process", "clearance", value=height)
    tab.rest(f"s.unsaved && s.tables.process.clearance === {height}")
    focus(tab, place)
    tab.page.keyboard.press(key)
    wait_state(tab, "!s.unsaved && s.told.startsWith('written: part.toml, part.ngc')")


def press_undo(tab: Tab, key: str, place: str) -> None:
    steps = tab.page.evaluate("workbench.state().undo")
    focus(tab, place)
    tab.page.keyboard.press(key)
    wait_state(tab, f"s.undo === {steps - 1} && s.redo === 1")
    tab.bench.post("redo")
    wait_state(tab, f"s.undo === {steps}")


def press_redo(tab: Tab, key: str, place: str) -> None:
    steps = tab.page.evaluate("workbench.state().undo")
    tab.bench.post("undo")
    wait_state(tab, f"s.undo === {steps - 1}")
    focus(tab, place)
    tab.page.keyboard.press(key)
    wait_state(tab, f"s.undo === {steps} && s.redo === 0")


def press_help(tab: Tab, key: str, place: str) -> None:
    focus(tab, place)
    tab.page.keyboard.press(key)
    if key == "?" and place == "field":
        assert tab.page.locator("#f-process-feed").input_value() == "30?"
        assert tab.page.locator("#keys[open]").count() == 0
        tab.page.keyboard.press("Backspace")
        return
    tab.page.wait_for_selector("#keys[open]")
    tab.page.keyboard.press(key)
    tab.page.wait_for_selector("#keys:not([open])", state="hidden")


#: Keys of the workbench, by their names in the help.
EVERYWHERE = {
    "Ctrl-S": ("Control+s", press_save),
    "Ctrl-Z": ("Control+z", press_undo),
    "Ctrl-Shift-Z": ("Control+Shift+z", press_redo),
    "Ctrl-Y": ("Control+y", press_redo),
    "F1": ("F1", press_help),
    "?": ("?", press_help),
}

#: Keys of the picture, by their names in its help: the key, a state, and what the key makes of it.
TURNED = "camgen.look.tilt = 0.3"
#: A program that plays would move on before a slow machine has the key.
PAUSED = "camgen.player.play(false); camgen.player.to({})"
PICTURE_KEYS = {
    "space": (" ", PAUSED.format(0), "camgen.player.on || camgen.player.time > 0"),
    "left": ("ArrowLeft", PAUSED.format(9), "camgen.player.time < 9"),
    "right": ("ArrowRight", PAUSED.format(9), "camgen.player.time > 9"),
    "home": ("Home", PAUSED.format(9), "camgen.player.time === 0"),
    "end": ("End", PAUSED.format(9), "camgen.player.time > 12"),
    "f": ("f", "camgen.look.own = true", "!camgen.look.own"),
    "t": ("t", TURNED, "camgen.look.tilt > 1.5"),
    "s": ("s", TURNED, "camgen.look.tilt === 0"),
    "i": ("i", TURNED, "camgen.look.tilt === 0.5"),
    "m": ("m", "camgen.measure.on = false", "camgen.measure.on"),
    "c": (
        "c",
        "document.querySelector('[data-by=order]').click()",
        "document.querySelector('[data-by=feed]').ariaChecked === 'true'",
    ),
    "l": (
        "l",
        "document.getElementById('layers').hidden = true",
        "!document.getElementById('layers').hidden",
    ),
    "d": (
        "d",
        "window.before = camgen.viewState().theme",
        "camgen.viewState().theme !== window.before",
    ),
    "esc": (
        "Escape",
        "document.querySelector('#rows .row').click()",
        "camgen.chosen.path === -1",
    ),
}


def test_each_key_of_the_help_works_with_any_focus(own_tab: Tab) -> None:
    own_tab.bench.change("operations", value=[{}])
    own_tab.bench.change("process", "feed", value=31)
    own_tab.rest("s.tables.process")
    own_tab.field("process.feed")
    keys = list_help_keys(own_tab, 0)
    assert set(keys) == set(EVERYWHERE)
    for key in sorted(keys, key="Ctrl-S".__ne__):
        name, press = EVERYWHERE[key]
        for place in FOCUS:
            press(own_tab, name, place)
        if key == "Ctrl-S":
            # From here on each build ends at once, since it fails, and the picture stays.
            own_tab.bench.change("process", "force", value=-1)
            own_tab.bench.change("process", "feed", value=30)
            own_tab.rest("s.failed")
    keys = list_help_keys(own_tab, 1)
    assert set(keys) == set(PICTURE_KEYS)
    frame = own_tab.shown(own_tab.rest()["built"]["number"])
    for place in ("form", "list", *IN_PICTURE):
        focus(own_tab, place)
        for key in keys:
            name, state, effect = PICTURE_KEYS[key]
            frame.evaluate(state)
            own_tab.page.keyboard.press(name)
            frame.wait_for_function(f"() => {effect}", polling=POLL)
    assert own_tab.log.messages == []


def test_a_typed_text_has_a_separate_undo_until_it_is_applied(tab: Tab) -> None:
    tab.enter("process.feed", "31")
    tab.rest("s.tables.process")
    field = tab.field("process.feed")
    field.press("End")
    tab.page.keyboard.type("5")
    tab.page.keyboard.press("Control+z")
    tab.page.wait_for_function("document.activeElement.value === '31'", polling=POLL)
    tab.page.keyboard.press("Control+z")
    assert tab.rest("!s.tables.process")["undo"] == 0


# Tabs and servers that end.


@pytest.mark.parametrize("ending", ["tab", "server"])
def test_typed_text_and_changes_survive_the_end_of_the_tab(
    browser: Driven, folder: Path, tmp_path_factory: pytest.TempPathFactory, ending: str
) -> None:
    """The last text is typed and not applied."""
    state = tmp_path_factory.mktemp("state")
    with open_bench(folder, ["part.dxf"], state) as bench:
        tab = Tab(browser, bench)
        tab.enter("process.feed", "31")
        tab.open("steps")
        tab.page.get_by_text("Add operation").click()
        tab.rest("s.tables.operations")
        tab.open("settings")
        tab.field("process.plunge").focus()
        with tab.page.expect_response("**/draft"):
            tab.page.keyboard.type("7")
        if ending == "tab":
            tab.context.close()
        bench.process.send_signal(signal.SIGKILL if ending == "server" else signal.SIGINT)
        bench.process.wait(LONG)
        if ending == "server":
            tab.page.wait_for_selector("aside[inert]")
            tab.context.close()
    with open_bench(folder, ["part.dxf"], state) as bench:
        tab = Tab(browser, bench)
        line = tab.page.locator("#says .look span").inner_text()
        assert line.startswith("3 changes of part.toml from 2")
        assert line.endswith(" were not saved.")
        tab.page.get_by_text("Take up").click()
        tables = tab.rest("!s.offer && s.tables.process.plunge")["tables"]
        assert tables == {"process": {"feed": 31, "plunge": 7}, "operations": [{}]}
        assert tab.field("process.plunge").input_value() == "7"
        assert tab.log.messages == []
        tab.context.close()


def test_a_journal_is_discarded_after_a_question(
    browser: Driven, folder: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    state = tmp_path_factory.mktemp("state")
    with open_bench(folder, ["part.dxf"], state) as bench:
        bench.change("process", "feed", value=31)
        bench.process.send_signal(signal.SIGKILL)
        bench.process.wait(LONG)
    with open_bench(folder, ["part.dxf"], state) as bench:
        tab = Tab(browser, bench)
        for answer in ("dismiss", "accept"):
            tab.page.once("dialog", lambda dialog, answer=answer: getattr(dialog, answer)())
            assert "1 change of part.toml" in tab.page.locator("#says .look").inner_text()
            tab.page.get_by_text("Discard").click()
        tab.page.wait_for_selector("#says .look", state="detached")
        assert tab.rest("!s.offer")["tables"] == {}
        tab.context.close()


def test_a_tab_with_changes_asks_before_it_closes(own_tab: Tab) -> None:
    questions: list[str] = []

    def stay(dialog: Driven) -> None:
        questions.append(dialog.type)
        dialog.dismiss()

    own_tab.page.on("dialog", stay)
    own_tab.enter("process.feed", "31")
    own_tab.rest("s.unsaved")
    with own_tab.page.expect_event("dialog"):
        own_tab.page.close(run_before_unload=True)
    assert questions == ["beforeunload"]
    own_tab.page.keyboard.press("Control+s")
    own_tab.rest("!s.unsaved")
    own_tab.field("process.feed").fill("32")
    with own_tab.page.expect_event("dialog"):
        own_tab.page.close(run_before_unload=True)
    assert questions == ["beforeunload", "beforeunload"]
    own_tab.field("process.feed").press("Enter")
    own_tab.rest("s.tables.process.feed === 32")
    own_tab.page.keyboard.press("Control+s")
    own_tab.rest("!s.unsaved")
    with own_tab.page.expect_event("close"):
        own_tab.page.close(run_before_unload=True)
    assert len(questions) == 2


@pytest.mark.parametrize("answer", ["accept", "dismiss"])
def test_a_program_that_was_changed_by_hand_is_replaced_after_a_question(
    tab: Tab, answer: str
) -> None:
    """The workbench's answers are made here: its judgement of a program is tested elsewhere."""
    requests: list[object] = []
    questions: list[str] = []

    def reply(route: Driven) -> None:
        requests.append(route.request.post_data_json)
        edited = {"line": "error: part.ngc: was changed", "edited": ["part.ngc"]}
        is_first = len(requests) == 1
        route.fulfill(status=409 if is_first else 200, json=edited if is_first else {})

    def decide(dialog: Driven) -> None:
        questions.append(dialog.message)
        getattr(dialog, answer)()

    tab.page.route("**/save", reply)
    tab.page.on("dialog", decide)
    with tab.page.expect_event("dialog"):
        tab.page.locator("#save").click()
    expected = [{}, {"replace": True}] if answer == "accept" else [{}]
    # The browser is served only while its page is asked to wait.
    wait_for("the answer", lambda: tab.page.wait_for_timeout(20) or len(requests) == len(expected))
    assert questions == ["part.ngc was changed by hand since camgen wrote it. Replace it?"]
    assert requests == expected


def test_a_first_build_that_is_cancelled_can_be_started_again(
    browser: Driven, tmp_path: Path
) -> None:
    drawing = ezdxf.new("R2010", units=4)
    for k in range(3000):  # a build of some seconds
        drawing.modelspace().add_circle((9.0 * (k % 60), 9.0 * (k // 60)), 4.0)
    drawing.saveas(tmp_path / "part.dxf")
    with open_bench(tmp_path, ["part.dxf"]) as bench:
        bench.post("stop")
        tab = Tab(browser, bench)
        assert tab.rest()["built"] is None
        line = tab.page.locator("#says .bad span").inner_text()
        assert line == "stopped: there is no program yet"
        assert "There is no program yet" in tab.page.locator("#empty").inner_text()
        tab.page.get_by_text("Build again").click()
        wait_state(tab, "s.stage")
        tab.context.close()
