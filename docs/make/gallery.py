"""The gallery: ten tasks and two more, from file to program, on the command line and in the workbench.

    python -m docs.make.gallery [FOLDER]

writes index.md and its pictures into FOLDER (default: docs/gallery). Every task is done twice: by the commands that the
page shows, as processes of their own, and in the workbench by clicks in a Chromium without a window; both have to write
the same program, byte for byte. It needs the extra ``workbench``, playwright and a Chromium.
"""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from time import perf_counter

from msgspec import Struct
from playwright.sync_api import Browser, Page, sync_playwright

from bench.support.runner import machine
from docs.make.pictures import small

ROOT = Path(__file__).parents[2]
PARTS, CASES = ROOT / "fixtures" / "parts", ROOT / "fixtures" / "cases"
_SWITCHES = [
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--no-sandbox",
]
_RESTS = (
    "() => { const s = window.workbench?.state(); return s && !s.stage && (s.built || s.failed); }"
)
_LONG = 180_000
#: Drawings of at most so many bytes go into the page as they are, others as pictures of pixels.
_MOST_SVG = 60_000
#: Lines of a summary that the page shows of every task but the first, by their first word.
_SHOWN = (
    "input",
    "skipped",
    "warning",
    "plan",
    "coverage",
    "operation",
    "time",
    "program",
    "stock",
    "reach",
    "collision",
)
#: Lines that say alike of most tasks that a proof has nothing to examine.
_UNPROVEN = re.compile(
    r"stock +(not proven: nothing is cut|stock\.thickness is not set)"
    r"|(reach|collision) +not proven: no robot"
)


class Task(Struct, frozen=True):
    """One task. about: what somebody wants. file: the input, from fixtures/parts or as ``source``. sets: what is set,
    as table.key and value. more: what lies beside it. job: the job file beside the input, where there is one.
    solid: the picture is of a 3-D part.
    """

    name: str
    about: str
    file: str
    post: str
    sets: tuple[tuple[str, str], ...] = ()
    job: Path | None = None
    more: tuple[str, ...] = ()
    solid: bool = False
    source: Path | None = None


TASKS = (
    Task(
        "outline",
        "Cut this outline and its holes",
        "bracket.dxf",
        "gcode",
        (
            ("tool.diameter", "4"),
            ("operation.depth", "3"),
            ("operation.passes", "3"),
            ("process.spindle", "12000"),
        ),
    ),
    Task(
        "drill",
        "Drill these holes, in pecks",
        "plate.dxf",
        "gcode",
        (
            ("operation.kind", "drill"),
            ("operation.depth", "9"),
            ("operation.passes", "3"),
            ("tool.diameter", "3.3"),
            ("operation.holes", "[3.0, 3.5]"),
            ("process.spindle", "2500"),
        ),
    ),
    Task(
        "plate",
        "Drill, bore, pocket, chamfer and cut out this plate",
        "motor.dxf",
        "gcode",
        job=CASES / "motor-plate" / "job.toml",
    ),
    Task(
        "pocket",
        "Clear this pocket around its islands",
        "bracket.dxf",
        "grbl",
        (
            ("operation.kind", "pocket"),
            ("operation.depth", "2"),
            ("operation.finish", "0.2"),
            ("process.spindle", "12000"),
        ),
    ),
    Task(
        "chamfer",
        "Break all edges by 0.8 mm",
        "bracket.dxf",
        "gcode",
        (
            ("operation.kind", "chamfer"),
            ("operation.width", "0.8"),
            ("tool.kind", "v"),
            ("tool.tip_diameter", "0.4"),
            ("process.switch", "contact"),
        ),
    ),
    Task(
        "logo",
        "Draw this logo on A4 with a pen",
        "logo.svg",
        "grbl",
        (("page.size", "A4"), ("operation.kind", "trace"), ("process.feed", "3000 mm/min")),
    ),
    Task(
        "copper",
        "Cover this copper with a marker",
        "copper.dxf",
        "gcode",
        (("operation.kind", "fill"), ("tool.diameter", "0.85")),
    ),
    Task(
        "gear",
        "Follow the gear in this photo with an arm",
        "gear.png",
        "pacscript",
        (("image.width_mm", "100"), ("tool.diameter", "4")),
    ),
    Task(
        "deburr",
        "Deburr this bracket with force",
        "bracket.dxf",
        "rapid",
        (("process.force", "10"), ("tool.orient", "follow"), ("post.force_load", "lTool")),
    ),
    Task(
        "edges",
        "Deburr the edges of this casting with an arm",
        "rfa1.stl",
        "rapid",
        job=PARTS / "rfa1.toml",
        more=("rfa1_base.stl",),
        solid=True,
    ),
    Task(
        "seam",
        "Glue along this seam in space",
        "seam.xyz",
        "rapid",
        (("input.units", "mm"), ("process.feed", "15")),
    ),
    Task(
        "old",
        "Run this old G-code on a robot",
        "old.ngc",
        "rapid",
        (("post.signals", '{dout0 = "doProcess"}'),),
        source=CASES / "bracket-follow" / "expected" / "part.ngc",
    ),
)


class Done(Struct, frozen=True):
    """How a task was done. said: the summary. seconds: of the command; clicks, entered, opened: in the workbench."""

    said: str
    seconds: float
    clicks: int
    entered: int
    opened: float
    picture: str


def lay_out(task: Task, folder: Path) -> None:
    folder.mkdir()
    shutil.copy(task.source or PARTS / task.file, folder / task.file)
    for name in task.more:
        shutil.copy(PARTS / name, folder / name)
    if task.job:
        shutil.copy(task.job, (folder / task.file).with_suffix(".toml"))


def command_of(task: Task) -> list[str]:
    sets = [word for place, value in task.sets for word in ("--set", f"{place}={value}")]
    return ["camgen", "build", task.file, "--post", task.post, *sets]


def programs(folder: Path) -> dict[str, bytes]:
    """What was made: all but inputs, jobs and pictures."""
    inputs = (".toml", ".html", ".svg", ".png", ".dxf", ".stl", ".xyz")
    return {
        one.name: one.read_bytes()
        for one in folder.iterdir()
        if one.suffix not in inputs and one.name != "old.ngc"
    }


def build(task: Task, folder: Path) -> tuple[str, float]:
    words = [sys.executable, "-m", "camgen", *command_of(task)[1:]]
    begin = perf_counter()
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=True)
    return done.stderr, perf_counter() - begin


def draw(task: Task, folder: Path, target: Path) -> str:
    """The picture of the result, made by another build; its name."""
    for kind in ("png",) if task.solid else ("svg", "png"):
        words = [
            sys.executable,
            "-m",
            "camgen",
            *command_of(task)[1:],
            "--preview",
            f"shown.{kind}",
            "-q",
            "-o",
            "-",
        ]
        subprocess.run(words, cwd=folder, capture_output=True, check=True)
        data = (folder / f"shown.{kind}").read_bytes()
        (folder / f"shown.{kind}").unlink()
        if kind == "png" or len(data) <= _MOST_SVG:
            break
    file = target / f"{task.name}.{kind}"
    file.write_bytes(small(data) if kind == "png" else data)
    return file.name


@contextmanager
def opened(task: Task, folder: Path) -> Iterator[str]:
    words = [sys.executable, "-m", "camgen", "open", task.file, "--post", task.post, "--no-browser"]
    with subprocess.Popen(words, cwd=folder, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        try:
            yield process.stderr.readline().split()[1]
        finally:
            process.terminate()


def settle(page: Page) -> None:
    page.wait_for_function(_RESTS, timeout=_LONG)


def click_through(browser: Browser, task: Task, folder: Path) -> tuple[int, int, float]:
    """Sets what the task asks for and saves; how many clicks and entries that took, and s from the command on."""
    clicks = entered = 0
    begin = perf_counter()
    with opened(task, folder) as address:
        page = browser.new_page(viewport={"width": 1400, "height": 900})
        page.set_default_timeout(_LONG)
        page.goto(address)
        settle(page)
        for place, value in task.sets:
            table, key = place.split(".")
            group = page.locator(f"details[data-table={table}]")
            if not group.evaluate("e => e.open"):
                group.locator("summary").first.click()
                clicks += 1
            one = page.locator(f"#f-{table}-{key}")
            if one.evaluate("e => e.tagName") == "SELECT":
                one.select_option(value)
            else:
                one.fill(value)
                one.press("Enter")
            clicks, entered = clicks + 1, entered + 1
            page.wait_for_function(
                f"() => workbench.state().tables[{table!r}]?.[{key!r}] !== undefined"
            )
            settle(page)
        page.locator("#save").click()
        page.wait_for_function(
            "() => workbench.state().saved && (workbench.state().told || '').startsWith('written')"
        )
        spent = perf_counter() - begin
        page.close()
    return clicks + 1, entered, spent


def do(browser: Browser, task: Task, target: Path) -> Done:
    with tempfile.TemporaryDirectory() as name:
        typed, clicked = Path(name, "typed"), Path(name, "clicked")
        lay_out(task, typed)
        lay_out(task, clicked)
        said, seconds = build(task, typed)
        made = programs(typed)
        clicks, entered, opening = click_through(browser, task, clicked)
        assert made, task.name
        assert programs(clicked) == made, f"{task.name}: the workbench wrote another program"
        return Done(said, seconds, clicks, entered, opening, draw(task, typed, target))


def shorten(summary: str) -> str:
    """The lines of a summary that differ between tasks."""
    lines = [
        line
        for line in summary.splitlines()
        if line.split(" ")[0] in _SHOWN and not _UNPROVEN.match(line)
    ]
    return "\n".join(lines)


def page_of(done: list[tuple[Task, Done]]) -> str:
    rows = []
    for k, (task, one) in enumerate(done, 1):
        figures = f"{one.seconds:.1f} | {one.clicks} | {one.entered} | {one.opened:.1f}"
        rows.append(f"| [{task.about}](#{k}-{task.name}) | {task.file} | {task.post} | {figures} |")
    parts = [_HEAD.format(machine=machine()), *rows, ""]
    for k, (task, one) in enumerate(done, 1):
        parts += [f"## {k} {task.name}", ""]
        if task.job:
            parts += [f"The job is in `{Path(task.file).with_suffix('.toml')}`.", ""]
        summary = one.said.rstrip() if k == 1 else shorten(one.said)
        parts += ["```console", f"$ {shlex.join(command_of(task))}", summary, "```", ""]
        parts += [f"![{task.about}]({one.picture})", ""]
    return "\n".join(parts)


_HEAD = """# Gallery

Twelve tasks, each done by one command, and by clicks in [the workbench](../workbench.md): both
write the same program, byte for byte. `python -m docs.make.gallery` makes this page. Seconds are
those of whole processes, in the workbench from `camgen open` to the saved program, clicked by a
script. {machine}. The first summary is whole. The others are without assumptions, tour, cell,
motion, read-back, rounding and set-up, and without proofs that need a model of an arm or a cut.

| task | file | controller | command, s | workbench: clicks | entries | s |
|---|---|---|---|---|---|---|"""


def main(target: Path) -> None:
    target.mkdir(exist_ok=True)
    found = []
    with sync_playwright() as started:
        browser = started.chromium.launch(executable_path=shutil.which("chromium"), args=_SWITCHES)
        for task in TASKS:
            one = do(browser, task, target)
            print(
                f"{task.name}: {one.seconds:.1f} s, {one.clicks} clicks, {one.opened:.1f} s, {one.picture}",
                flush=True,
            )
            found.append((task, one))
    (target / "index.md").write_text(page_of(found), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs" / "gallery")
