"""The gallery: twelve tasks from file to program, on the command line and in the workbench.

    python -m docs.make.gallery [FOLDER]

writes index.md and its pictures into FOLDER (default: docs/gallery). Each task is done twice: by
the command on the page, in a process, and by clicks in the workbench, in Chromium without a window.
Both must write the same bytes. The extra `workbench`, playwright and a Chromium are needed.
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
from docs.make.pictures import shrink

ROOT = Path(__file__).parents[2]
PARTS, CASES = ROOT / "fixtures" / "parts", ROOT / "fixtures" / "cases"
_SWITCHES = [
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--no-sandbox",
]
_HAS_ENDED = (
    "() => { const s = window.workbench?.state(); return s && !s.stage && (s.built || s.failed); }"
)
_LONG_MS = 180_000
#: Size of the largest drawing that the page shows as SVG, bytes. Larger drawings become PNG.
_LARGEST_SVG = 60_000
#: First words of the lines of a summary on the page. The summary of the first task is complete.
_SHOWN_LINES = (
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
#: Lines of most summaries: a proof has nothing to examine.
_UNPROVEN = re.compile(
    r"stock +(not proven: nothing is cut|stock\.thickness is not set)"
    r"|(reach|collision) +not proven: no robot"
)


class Task(Struct, frozen=True):
    """A task of the gallery.

    name: name of its picture and of its section.
    about: heading, the wish of a user.
    file: name of the input, from fixtures/parts or from `source`.
    post: name of the post.
    sets: settings, each as table.key and value.
    job: job file beside the input, None without one.
    more: names of further files of fixtures/parts.
    solid: whether the picture shows a 3-D part.
    source: file of the input if it is not in fixtures/parts.
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


class TaskResult(Struct, frozen=True):
    """The result of a task.

    summary: summary of the command.
    seconds: time of the command, s.
    clicks, entered: number of clicks and of entries in the workbench.
    opened: time in the workbench, s.
    picture: name of its picture.
    """

    summary: str
    seconds: float
    clicks: int
    entered: int
    open_workbench: float
    picture: str


def copy_inputs(task: Task, folder: Path) -> None:
    """Copies the inputs of a task and its job file into a new folder."""
    folder.mkdir()
    shutil.copy(task.source or PARTS / task.file, folder / task.file)
    for name in task.more:
        shutil.copy(PARTS / name, folder / name)
    if task.job:
        shutil.copy(task.job, (folder / task.file).with_suffix(".toml"))


def make_command(task: Task) -> list[str]:
    """The command of a task, as words."""
    words = ["camgen", "build", task.file, "--post", task.post]
    for place, value in task.sets:
        words += ["--set", f"{place}={value}"]
    return words


def read_programs(folder: Path) -> dict[str, bytes]:
    """The programs in a folder by name: files that are not inputs, jobs or pictures."""
    inputs = (".toml", ".html", ".svg", ".png", ".dxf", ".stl", ".xyz")
    return {
        file.name: file.read_bytes()
        for file in folder.iterdir()
        if file.suffix not in inputs and file.name != "old.ngc"
    }


def build(task: Task, folder: Path) -> tuple[str, float]:
    """Builds a task. Returns the summary and the time of the command, s."""
    words = [sys.executable, "-m", "camgen", *make_command(task)[1:]]
    start = perf_counter()
    process = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=True)
    return process.stderr, perf_counter() - start


def draw(task: Task, folder: Path, target: Path) -> str:
    """Draws the result by another build. Returns the name of the picture."""
    for kind in ("png",) if task.solid else ("svg", "png"):
        words = [
            sys.executable,
            "-m",
            "camgen",
            *make_command(task)[1:],
            "--preview",
            f"shown.{kind}",
            "-q",
            "-o",
            "-",
        ]
        subprocess.run(words, cwd=folder, capture_output=True, check=True)
        data = (folder / f"shown.{kind}").read_bytes()
        (folder / f"shown.{kind}").unlink()
        if kind == "png" or len(data) <= _LARGEST_SVG:
            break
    file = target / f"{task.name}.{kind}"
    file.write_bytes(shrink(data) if kind == "png" else data)
    return file.name


@contextmanager
def open_workbench(task: Task, folder: Path) -> Iterator[str]:
    """The address of a workbench with the input of a task."""
    words = [sys.executable, "-m", "camgen", "open", task.file, "--post", task.post, "--no-browser"]
    with subprocess.Popen(words, cwd=folder, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        try:
            yield process.stderr.readline().split()[1]
        finally:
            process.terminate()


def wait_for_build(page: Page) -> None:
    """Waits until no build runs."""
    page.wait_for_function(_HAS_ENDED, timeout=_LONG_MS)


def click_through(browser: Browser, task: Task, folder: Path) -> tuple[int, int, float]:
    """Enters the settings of a task in the workbench and saves.

    Returns the number of clicks, the number of entries, and the time from the command on, s.
    """
    clicks = entered = 0
    start = perf_counter()
    with open_workbench(task, folder) as address:
        page = browser.new_page(viewport={"width": 1400, "height": 900})
        page.set_default_timeout(_LONG_MS)
        page.goto(address)
        wait_for_build(page)
        for place, value in task.sets:
            table, key = place.split(".")
            group = page.locator(f"details[data-table={table}]")
            if not group.evaluate("e => e.open"):
                group.locator("summary").first.click()
                clicks += 1
            field = page.locator(f"#f-{table}-{key}")
            if field.evaluate("e => e.tagName") == "SELECT":
                field.select_option(value)
            else:
                field.fill(value)
                field.press("Enter")
            clicks, entered = clicks + 1, entered + 1
            page.wait_for_function(
                f"() => workbench.state().tables[{table!r}]?.[{key!r}] !== undefined"
            )
            wait_for_build(page)
        page.locator("#save").click()
        page.wait_for_function(
            "() => workbench.state().saved && (workbench.state().told || '').startsWith('written')"
        )
        seconds = perf_counter() - start
        page.close()
    return clicks + 1, entered, seconds


def run_task(browser: Browser, task: Task, target: Path) -> TaskResult:
    """Runs a task on the command line and in the workbench, and compares the programs."""
    with tempfile.TemporaryDirectory() as name:
        typed, clicked = Path(name, "typed"), Path(name, "clicked")
        copy_inputs(task, typed)
        copy_inputs(task, clicked)
        summary, seconds = build(task, typed)
        program_files = read_programs(typed)
        clicks, entered, opening = click_through(browser, task, clicked)
        assert program_files, task.name
        assert read_programs(clicked) == program_files, (
            f"{task.name}: the workbench wrote another program"
        )
        return TaskResult(summary, seconds, clicks, entered, opening, draw(task, typed, target))


def shorten(summary: str) -> str:
    """The lines of a summary that differ between tasks."""
    lines = [
        line
        for line in summary.splitlines()
        if line.split(" ")[0] in _SHOWN_LINES and not _UNPROVEN.match(line)
    ]
    return "\n".join(lines)


def format_page(results: list[tuple[Task, TaskResult]]) -> str:
    """The page with the results of all tasks."""
    rows = []
    for k, (task, result) in enumerate(results, 1):
        figures = f"{result.seconds:.1f} | {result.clicks} | {result.entered} | {result.opened:.1f}"
        rows.append(f"| [{task.about}](#{k}-{task.name}) | {task.file} | {task.post} | {figures} |")
    parts = [_HEAD.format(machine=machine()), *rows, ""]
    for k, (task, result) in enumerate(results, 1):
        parts += [f"## {k} {task.name}", ""]
        if task.job:
            parts += [f"The job is in `{Path(task.file).with_suffix('.toml')}`.", ""]
        summary = result.summary.rstrip() if k == 1 else shorten(result.summary)
        parts += ["```console", f"$ {shlex.join(make_command(task))}", summary, "```", ""]
        parts += [f"![{task.about}]({result.picture})", ""]
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
    results = []
    with sync_playwright() as started:
        browser = started.chromium.launch(executable_path=shutil.which("chromium"), args=_SWITCHES)
        for task in TASKS:
            result = run_task(browser, task, target)
            times = f"{result.seconds:.1f} s, {result.clicks} clicks, {result.opened:.1f} s"
            print(f"{task.name}: {times}, {result.picture}", flush=True)
            results.append((task, result))
    (target / "index.md").write_text(format_page(results), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs" / "gallery")
