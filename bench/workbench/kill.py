"""Kills tabs of the workbench in the middle of an edit, and counts the edits that are lost.

    python -m bench.workbench.kill [KILLS, 50] [SEED, 1]

Each kill has its own part, workbench and browser. A user makes up to three edits that are seen in
the page, and then the last one: a text that is typed and never applied, a slider, a menu, a row of
a list, a layer, a path or a seam in the picture. At once, or at a random moment up to a quarter of
a second after the last key or click, SIGKILL ends the server, the browser or the process of the
tab, or the tab is closed without a question; a further kill of the server falls between the keys
of a text. Then the workbench is opened again, and the changes
that it offers are taken up. An edit is lost if the job does not have it. The page reports an edit
that a dead server did not answer. Exits with 1 if an edit is lost without a report. Needs
playwright and a Chromium.
"""

from __future__ import annotations

import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from bench.support.runner import PARTS, Table, must_be_none, open_table, read_words
from tests.support.benches import Bench, open_bench, start_bench
from tests.support.browsers import Driven, start_browser
from tests.support.tabs import Tab
from tests.support.waiting import LONG, wait_for

Tables = dict[str, Any]
#: The longest time between the last key or click and the kill, s.
MOMENT_S = 0.25
#: Keys that a user types into a field of a length.
LENGTHS = ("3", "31", "31.5", "0.25", "112.125")


class Edit(NamedTuple):
    """An edit of the job.

    name: its kind
    make: makes it in a tab; the moment of the kill is after that
    is_in: whether the tables of a job have it
    """

    name: str
    make: Callable[[Tab], None]
    is_in: Callable[[Tables], bool]


def value_of(tables: Tables, path: str) -> Any:
    """The value of a setting such as process.feed; None if the job does not set it."""
    table, key = path.split(".")
    return tables.get(table, {}).get(key)


def type_number(path: str, text: str, *, is_applied: bool) -> Edit:
    """A number that is typed key by key, and applied or not."""

    def make(tab: Tab) -> None:
        tab.open("settings")
        if is_applied:
            tab.enter(path, text)
        else:
            tab.field(path).fill("")
            tab.page.keyboard.type(text)

    name = "entering" if is_applied else "typing"
    return Edit(name, make, lambda tables: value_of(tables, path) == float(text))


def slide(degrees: int) -> Edit:
    """The slider of an angle, at four places."""

    def make(tab: Tab) -> None:
        tab.open("settings")
        tab.field("operation.entry_angle")
        slider = tab.page.locator(".field:has(#f-operation-entry_angle) input[type=range]")
        for place in (1, 2, 3, degrees):
            slider.fill(str(place))

    return Edit(
        "sliding", make, lambda tables: value_of(tables, "operation.entry_angle") == degrees
    )


def choose_direction(tab: Tab) -> None:
    """Chooses from a menu of the form."""
    tab.open("settings")
    tab.field("operation.direction").select_option("conventional")


def add_tool(tab: Tab) -> None:
    """Adds a row to the list of tools."""
    tab.open("steps")
    tab.page.get_by_text("Add tool").click()


def switch_layer(tab: Tab) -> None:
    """Switches off a layer of the drawing."""
    tab.open("layers")
    tab.page.locator("#layers input[type=checkbox]").first.uncheck()


def open_paths(tab: Tab) -> Driven:
    """Opens the list of paths of the picture. Returns the frame of the picture."""
    frame = tab.shown(tab.rest()["built"]["number"])
    frame.locator("nav button[data-tab=paths]").click()
    return frame


def move_path(tab: Tab) -> None:
    """Moves a path in the list of the picture to the place before it."""
    frame = open_paths(tab)
    frame.locator("#rows .row").nth(1).click()
    frame.locator("#list").press("Alt+ArrowUp")


def move_seam(tab: Tab) -> None:
    """Moves the seam of a path along it by keys of the picture."""
    frame = open_paths(tab)
    frame.locator("#rows .row").nth(3).click()
    frame.locator(".seam").press("Shift+ArrowRight")


def has_value(path: str, value: object) -> Callable[[Tables], bool]:
    """Whether the tables of a job have a value."""
    return lambda tables: value_of(tables, path) == value


#: Edits of the form, and edits that need all paths in the picture: a job has one of them.
FORM_EDITS = (
    Edit("choosing", choose_direction, has_value("operation.direction", "conventional")),
    Edit("adding a row", add_tool, lambda tables: len(tables.get("tools", [])) == 1),
)
PICTURE_EDITS = (
    Edit("switching a layer", switch_layer, has_value("input.layers", ["*", "!HOLES"])),
    Edit("moving a path", move_path, lambda tables: len(value_of(tables, "tour.order") or []) == 1),
    Edit("moving a seam", move_seam, lambda tables: bool(value_of(tables, "tour.seams"))),
)


def choose_edits(chance: random.Random, number: int) -> list[Edit]:
    """Up to three edits, then the last one, each at its own place in the job.

    number: number of the last edit, so that all kinds come in turn
    """
    form = [
        type_number("process.feed", chance.choice(LENGTHS), is_applied=False),
        type_number("process.clearance", chance.choice(("61", "72.5")), is_applied=True),
        slide(chance.randrange(5, 40)),
        *FORM_EDITS,
    ]
    edits = [*form, *PICTURE_EDITS]
    last = edits[number % len(edits)]
    others = [edit for edit in form if edit is not last]
    if last in form:
        others.append(chance.choice(PICTURE_EDITS))
    return [*chance.sample(others, chance.randint(0, 3)), last]


# Kills.


def kill_server(tab: Tab, _browser: Driven) -> None:
    tab.bench.process.send_signal(signal.SIGKILL)
    tab.page.wait_for_selector("aside[inert]")


def kill_browser(_tab: Tab, browser: Driven) -> None:
    (process,) = list_processes(browser, "browser")
    os.kill(process, signal.SIGKILL)


def kill_process_of_tab(_tab: Tab, browser: Driven) -> None:
    for process in list_processes(browser, "renderer"):
        os.kill(process, signal.SIGKILL)


#: The kill that falls between the keys of a text.
BETWEEN_KEYS = "server, between keys"
KILLS = {
    "server": kill_server,
    "browser": kill_browser,
    "process of the tab": kill_process_of_tab,
    "tab, closed": lambda tab, _browser: tab.page.close(),
    BETWEEN_KEYS: kill_server,
}


def type_while_killed(tab: Tab, moment: float) -> Edit:
    """Types a number while the server is killed. The edit is the text that the field shows then.

    moment: time from the first key to the kill, s
    """
    tab.open("settings")
    field = tab.field("tool.length")
    field.fill("")
    timer = threading.Timer(moment, tab.bench.process.kill)
    timer.start()
    tab.page.keyboard.type("112.125", delay=1000 * MOMENT_S / 7)
    timer.join()
    tab.page.wait_for_selector("aside[inert]")
    shown = field.input_value()

    def is_in(tables: Tables) -> bool:
        value = value_of(tables, "tool.length")
        if not shown or value is None:
            return not shown and value is None
        return float(value) == float(shown)

    return Edit("typing", lambda _tab: None, is_in)


def kind_of(number: int) -> str:
    """The thing that a kill ends. All kinds come in turn."""
    return list(KILLS)[number % len(KILLS)]


def list_processes(browser: Driven, kind: str) -> list[int]:
    """The numbers of the browser's processes of a kind."""
    session = browser.new_browser_cdp_session()
    processes = session.send("SystemInfo.getProcessInfo")["processInfo"]
    return [process["id"] for process in processes if process["type"] == kind]


class Outcome(NamedTuple):
    """A kill.

    last: kind of the edit in which it fell
    edits: number of edits
    reported: number of missing edits that the page reported as not kept
    lost: number of missing edits without a report
    """

    last: str
    edits: int
    reported: int
    lost: int


def run_kill(folder: Path, number: int, seed: int) -> Outcome:
    """Edits a part in a tab of its own, kills it, and opens the part again.

    number: number of the kill
    """
    kind, chance = kind_of(number), random.Random(f"{seed} {number}")
    work, state = folder / "work", folder / "state"
    work.mkdir()
    shutil.copy(PARTS / "bracket.dxf", work / "part.dxf")
    edits = choose_edits(chance, number // len(KILLS))
    with start_browser() as browser, start_bench(work, ["part.dxf"], state) as process:
        assert process.stderr is not None
        tab = Tab(browser, Bench(process, process.stderr.readline().split()[1]))
        for edit in edits[:-1]:
            edit.make(tab)
            wait_seen(tab, edit)
        moment = chance.uniform(0, MOMENT_S)
        if kind == BETWEEN_KEYS:
            edits[-1] = type_while_killed(tab, moment)
        else:
            edits[-1].make(tab)
            time.sleep(chance.choice((0, moment)))
            KILLS[kind](tab, browser)
        is_alive = KILLS[kind] is kill_server
        reported = is_alive and "is not kept" in tab.page.inner_text("#says")
        tables = reopen(work, state, process)
    missing = [edit for edit in edits if not edit.is_in(tables)]
    is_reported = reported and missing == [edits[-1]]
    lost = 0 if is_reported else len(missing)
    return Outcome(edits[-1].name, len(edits), int(is_reported), lost)


def wait_seen(tab: Tab, edit: Edit) -> None:
    """Leaves the field, and waits until the page shows the edit."""
    tab.page.evaluate("document.activeElement.blur()")
    wait_for(edit.name, lambda: edit.is_in(tab.page.evaluate("workbench.state().tables")))


def reopen(work: Path, state: Path, former: subprocess.Popen[str]) -> Tables:
    """The job of a new workbench with the changes that it offers.

    former: the workbench that was killed, or ends because its page is gone
    """
    with open_bench(work, ["part.dxf"], state) as bench:
        former.wait(LONG)
        # The journal of a workbench that ends is found within two seconds; without one none comes.
        for _ in range(20):
            if bench.wait(bool)["offer"]:
                bench.post("journal", counts=True)
                break
            time.sleep(0.25)
        return dict(bench.wait(bool)["tables"])


def measure(kills: int, seed: int) -> int:
    """Prints the tables. Returns the number of edits that are lost."""
    outcomes: dict[str, list[Outcome]] = {kind: [] for kind in KILLS}
    for number in range(kills):
        with tempfile.TemporaryDirectory() as folder:
            outcomes[kind_of(number)].append(run_kill(Path(folder), number, seed))
    table = open_table("killed | kills | edits | reported by the page | lost {}")
    total = []
    for kind, row in outcomes.items():
        if row:
            add_row(table, kind, row)
        total += row
    add_row(table, "all", total)
    table = Table("in the middle of | kills | edits | reported by the page | lost {}")
    for name in sorted({outcome.last for outcome in total}):
        add_row(table, name, [outcome for outcome in total if outcome.last == name])
    return sum(outcome.lost for outcome in total)


def add_row(table: Table, name: str, outcomes: list[Outcome]) -> None:
    """Adds the sums of some kills."""
    edits = sum(outcome.edits for outcome in outcomes)
    reported = sum(outcome.reported for outcome in outcomes)
    lost = sum(outcome.lost for outcome in outcomes)
    table.add(name, len(outcomes), edits, reported, must_be_none(lost))


if __name__ == "__main__":
    sys.exit(1 if measure(*read_words(50, 1)) else 0)
