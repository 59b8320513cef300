"""Faults seeded in set-ups, and whether camgen reports them.

python -m bench.check.set_up_faults [SEED, 1] [MOST OF A KIND, 20] [KIND ...]

The rule that chooses them was written down before the checks. There are 200 faults of the kinds
`KINDS`. A fault of a job is built, a fault of a text is given to `camgen verify` beside its job
and its part, with the digest of the text made right again.

- in the job: two tools swapped, depth 0.5 mm or more beyond the stock, feed 1.5 times the
  largest of the table, speed twice the largest, another material, an outline with a gap;
- in the text: depth 0.5 mm, feed times 1.5, speed times 2 or at rest or to the left, the number
  of a tool.

The numbers come from a generator with the seed, and the jobs in turn from `CASES`, for LinuxCNC. A
job without a material has that of `MATERIAL`, one without a thickness that of its deepest
operation, drilling apart. A fault counts if it matters: material that must stay is cut, or a stated
limit is exceeded, by a judge that shares no code with the checks. Each must have a line that the
sound job or text has not. At most a tenth may be invisible without a plan; these are listed.
"""

from __future__ import annotations

import math
import random
import re
import sys
import tempfile
import tomllib
import warnings
from collections import Counter
from collections.abc import Callable
from copy import deepcopy
from functools import cache, partial
from itertools import combinations
from pathlib import Path
from typing import NamedTuple

import ezdxf
import numpy as np

from bench.check.cells import carve
from bench.check.set_up import NEARLY, Load, find_fastest, measure_load, read_chart
from bench.support.commands import Tables, run_camgen, write_job
from bench.support.faults import IDLE, Verdict, try_faults
from bench.support.gcode_text import read_moves
from bench.support.runner import ROOT, must_be_none, open_table, read_words, select
from camgen.model.job import Job
from camgen.model.signature import sign
from camgen.read import read
from camgen.read.files import Files

#: Kinds of faults, with the number of each.
KINDS = {
    "tools swapped in the job": 20,
    "depth in the job": 20,
    "feed in the job": 20,
    "speed in the job": 20,
    "material in the job": 10,
    "outline with a gap": 10,
    "depth in the text": 20,
    "feed in the text": 20,
    "speed in the text": 20,
    "spindle in the text": 20,
    "tool number in the text": 20,
}

#: Golden jobs that cut material below the top face.
CASES = (
    "bracket-bore",
    "bracket-pocket",
    "bracket-tabs",
    "motor-plate",
    "plate-drill",
    "smooth-passes",
)
MATERIAL = "aluminium"

COLUMNS = (
    "fault | seeded | refused | a line more | no line | by the rebuilt program alone "
    "| left out: without effect"
)
#: Changes a job; False if it has nothing to change.
JobFault = Callable[[Tables, random.Random], bool]
#: The lines of a program with one change; None if it has nothing to change.
TextFault = Callable[[list[str], Tables, random.Random], list[str] | None]
_REBUILT = "by the rebuilt program: "
#: A cell whose depth differs by more, mm, is another one.
_DEEPER_MM = 0.2
_BELOW_MM = 0.5
_DIGEST = re.compile(r" - text [0-9a-f]{12}")
#: Rows of a summary that name a fault.
_TELLING = re.compile(r"warning|differs|skipped|assumed|fault|left out|remark|exceeded")


class Outcome(NamedTuple):
    """The outcome of a command.

    code: its exit code.
    lines: lines that name something.
    """

    code: int
    lines: Counter[str]


def run(*words: object) -> Outcome:
    """A command of camgen."""
    code, lines = run_camgen(*words)
    return Outcome(code, Counter(filter(_TELLING.search, lines)))


def list_tools(job: Tables) -> list[Tables]:
    """The rows of the tools."""
    return job["tools"] if "tools" in job else [job.setdefault("tool", {})]


def list_steps(job: Tables) -> list[Tables]:
    """The rows of the operations."""
    return job["operations"] if "operations" in job else [job.setdefault("operation", {})]


def find_tool(job: Tables, step: Tables) -> Tables:
    """The tool of an operation."""
    tools, named = list_tools(job), step.get("tool")
    return next((row for row in tools if named in (row.get("name"), row.get("number"))), tools[0])


def read_tool(job: Tables, row: Tables) -> Tables:
    """A tool with the values that a job leaves out."""
    process = job.get("process", {})
    usual = {"diameter": 6.0, "kind": "end mill", "flutes": 2, "number": 0}
    more = {"feed": process.get("feed", 20.0), "speed": process.get("spindle", 0.0)}
    is_drill = any(
        step.get("kind") == "drill" and find_tool(job, step) is row for step in list_steps(job)
    )
    return usual | more | ({"kind": "drill"} if is_drill else {}) | row


def load(case: str) -> tuple[Path, Tables]:
    """A golden job with a material and a thickness, and its part."""
    job = tomllib.loads((ROOT / "fixtures" / "cases" / case / "job.toml").read_text())
    stock = job.setdefault("stock", {})
    stock.setdefault("material", MATERIAL)
    steps = list_steps(job)
    milled = [step for step in steps if step.get("kind") not in ("drill", "chamfer")]
    depths = [step["depth"] for step in milled or steps]
    stock.setdefault("thickness", max(depths))
    return ROOT / "fixtures" / "parts" / f"{case.split('-', maxsplit=1)[0]}.dxf", job


# Faults of jobs.


def swap_tools(job: Tables, chance: random.Random) -> bool:
    """Two operations with each other's tools."""
    steps = [step for step in list_steps(job) if "tool" in step]
    pairs = [
        (first, second)
        for first, second in combinations(steps, 2)
        if find_tool(job, first) != find_tool(job, second)
    ]
    if not pairs:
        return False
    first, second = chance.choice(pairs)
    first["tool"], second["tool"] = second["tool"], first["tool"]
    return True


def deepen(job: Tables, chance: random.Random) -> bool:
    """An operation that goes too far below the stock."""
    step = chance.choice([step for step in list_steps(job) if step.get("kind") != "chamfer"])
    tool = read_tool(job, find_tool(job, step))
    tip = tool["diameter"] / 2 / math.tan(math.radians(59)) if tool["kind"] == "drill" else 0.0
    step["depth"] = job["stock"]["thickness"] + _BELOW_MM + tip + chance.uniform(0.05, 3.0)
    return True


def hurry(job: Tables, chance: random.Random) -> bool:
    """A tool with one and a half times the largest feed of the chart."""
    row = chance.choice(list_tools(job))
    tool = read_tool(job, row)
    if not tool["speed"] or tool["kind"] == "v":
        return False
    edges = 1 if tool["kind"] == "drill" else tool["flutes"]
    feed = 1.5 * read_chart(tool, MATERIAL) * edges * tool["speed"] / 60
    table = row if "tools" in job else job["process"]
    table["feed"] = feed
    table.pop("plunge", None)
    return True


def spin(job: Tables, chance: random.Random) -> bool:
    """A tool at twice the largest cutting speed of the chart."""
    row = chance.choice(list_tools(job))
    tool = read_tool(job, row)
    if not tool["speed"]:
        return False
    speed = 2 * find_fastest(tool) * 304.8 / math.pi / tool["diameter"]
    table, key = (row, "speed") if "tools" in job else (job["process"], "spindle")
    table[key] = speed
    return True


def harden(job: Tables, chance: random.Random) -> bool:
    """Feeds and a speed for plywood, in aluminium."""
    row = chance.choice(list_tools(job))
    tool = read_tool(job, row)
    if tool["kind"] != "end mill" or not tool["speed"]:
        return False
    feed = chance.uniform(0.6, 1.0) * read_chart(tool, "plywood") * tool["flutes"] * 300
    table, key = (row, "speed") if "tools" in job else (job["process"], "spindle")
    table[key], table["feed"] = 18_000.0, feed
    return True


def open_outline(part: Path, file: Path, chance: random.Random) -> bool:
    """The drawing with a gap in its outline. Writes `file`."""
    drawing = ezdxf.new()
    contours = read(part, Job(), Files()).contours
    sizes = [float(np.prod(np.ptp(contour.points, axis=0))) for contour in contours]
    for contour, size in zip(contours, sizes, strict=True):
        points = np.column_stack([contour.points, contour.bulges])
        is_open = size == max(sizes)
        if is_open:
            first, last = points[0].copy(), points[-1]
            straight = first[:2] - last[:2]
            gap = chance.uniform(0.1, 2.0)
            first[:2] -= straight / np.hypot(*straight) * gap
            points = np.vstack([points, first])
        drawing.modelspace().add_lwpolyline(
            points,
            format="xyb",
            close=contour.closed and not is_open,
            dxfattribs={"layer": contour.layer},
        )
    drawing.saveas(file)
    return True


# Faults of texts.


def _change(
    lines: list[str], chance: random.Random, pattern: str, format_number: Callable[[float], str]
) -> list[str] | None:
    """The text with one number changed; None without one. pattern: has the number as its group."""
    code = [k for k, line in enumerate(lines) if "(" not in line and re.search(pattern, line)]
    if not code:
        return None
    place = chance.choice(code)
    match = re.search(pattern, lines[place])
    assert match
    start, end = match.span(1)
    changed = lines[place][:start] + format_number(float(match[1])) + lines[place][end:]
    return [*lines[:place], changed, *lines[place + 1 :]]


def shift_depth(lines: list[str], _job: Tables, chance: random.Random) -> list[str] | None:
    shift = chance.choice((-0.5, 0.5))
    return _change(lines, chance, r"\bZ(-[0-9.]+)", lambda z: f"{z + shift:g}")


def shift_feed(lines: list[str], _job: Tables, chance: random.Random) -> list[str] | None:
    return _change(lines, chance, r"\bF([0-9.]+)", lambda feed: f"{feed * 1.5:g}")


def shift_speed(lines: list[str], _job: Tables, chance: random.Random) -> list[str] | None:
    factor = chance.choice((0.5, 2.0))
    return _change(lines, chance, r"\bS([0-9.]+)", lambda speed: f"{speed * factor:g}")


def stop_spindle(lines: list[str], _job: Tables, chance: random.Random) -> list[str] | None:
    pattern, word = chance.choice([(r"M(3)\b", "4"), (r"M(3)\b", "5"), (r"\bS([0-9.]+)", "0")])
    return _change(lines, chance, pattern, lambda _: word)


def change_tool(lines: list[str], job: Tables, chance: random.Random) -> list[str] | None:
    numbers = [row["number"] for row in list_tools(job) if "number" in row]

    def other(number: float) -> str:
        return str(chance.choice([known for known in numbers if known != number]))

    return _change(lines, chance, r"\bT([0-9]+)", other) if len(numbers) > 1 else None


JOB_FAULTS: dict[str, JobFault] = {
    "tools swapped in the job": swap_tools,
    "depth in the job": deepen,
    "feed in the job": hurry,
    "speed in the job": spin,
    "material in the job": harden,
}
TEXT_FAULTS: dict[str, TextFault] = {
    "depth in the text": shift_depth,
    "feed in the text": shift_feed,
    "speed in the text": shift_speed,
    "spindle in the text": stop_spindle,
    "tool number in the text": change_tool,
}


# Judges.


def is_cut_otherwise(job: Tables, text: str, other_job: Tables, other: str) -> bool:
    """Whether two programs leave other material, by a sweep in cells of a common grid."""
    tools = []
    for tables in (job, other_job):
        tools.append([read_tool(tables, row) for row in list_tools(tables)])
    pitch = min(tool["diameter"] for tool in tools[0] + tools[1]) / 8
    grids = []
    for rows, words in zip(tools, (text, other), strict=True):
        radii = {0: rows[0]["diameter"] / 2} | {row["number"]: row["diameter"] / 2 for row in rows}
        grids.append(carve(list(read_moves(words)), radii, pitch)[0])
    first, second = grids
    shapes = first.depth.shape, second.depth.shape
    if shapes[0] != shapes[1] or np.abs(first.low - second.low).max() > pitch / 2:
        return True
    return bool((np.abs(first.depth - second.depth) > _DEEPER_MM).any())


def exceeds(job: Tables, text: str) -> bool:
    """Whether a text exceeds a limit of the stock or of the chart of its material."""
    material = job["stock"]["material"]
    for row in list_tools(job):
        tool = read_tool(job, row)
        moves = [
            move
            for move in read_moves(text)
            if move.tool == tool["number"] and not move.rapid and move.deepest > 0
        ]
        load = measure_load(moves, tool) if moves else Load(0.0, 0.0, 0.0)
        is_deep = load.depth > job["stock"]["thickness"] + _BELOW_MM
        is_fast = load.speed > find_fastest(tool) * NEARLY
        if is_deep or is_fast or load.tooth > read_chart(tool, material) * NEARLY:
            return True
    return False


# The bench.


def try_job(kind: str, folder: Path, number: int, chance: random.Random) -> Verdict | None:
    """The verdict on a fault of a job, and the fault; None if the case has nothing to change."""
    case = CASES[number % len(CASES)]
    part, job = load(case)
    faulty = deepcopy(job)
    changed = part
    if kind == "outline with a gap":
        changed = folder / "open.dxf"
        open_outline(part, changed, chance)
    elif not JOB_FAULTS[kind](faulty, chance):
        return None
    program, sound = build_sound(case, folder)
    text, outcome = build(faulty, changed, folder)
    about = f"{kind}, {case}"
    if outcome.code:
        return "refused", about
    by_sweep = kind in ("tools swapped in the job", "outline with a gap")
    matters = is_cut_otherwise(job, program, faulty, text) if by_sweep else exceeds(faulty, text)
    if not matters:
        return IDLE, about
    return ("a line more" if outcome.lines - sound.lines else "no line"), about


def build(job: Tables, part: Path, folder: Path) -> tuple[str, Outcome]:
    """The program of a job, empty if it is refused."""
    drawing, target = folder / "part.dxf", folder / "part.ngc"
    drawing.write_bytes(part.read_bytes())
    write_job(job, drawing.with_suffix(".toml"))
    target.unlink(missing_ok=True)
    outcome = run("build", str(drawing), "--post", "gcode", "-o", str(target))
    return (target.read_text() if target.exists() else ""), outcome


@cache
def build_sound(case: str, folder: Path) -> tuple[str, Outcome]:
    """The program of a golden job."""
    part, job = load(case)
    return build(job, part, folder)


def verify(text: str, case: str, folder: Path) -> tuple[Outcome, Outcome]:
    """The outcomes of `camgen verify` for a text: with and without the rebuilt program."""
    part, job = load(case)
    drawing, program = folder / "part.dxf", folder / "part.ngc"
    drawing.write_bytes(part.read_bytes())
    write_job(job, drawing.with_suffix(".toml"))
    program.write_text(text)
    words = ("verify", str(program), "--part", str(drawing))
    return run(*words), run(*words, "--post", "gcode")


@cache
def verify_sound(case: str, folder: Path) -> tuple[Outcome, Outcome]:
    """The outcomes for the program of a golden job."""
    return verify(build_sound(case, folder)[0], case, folder)


def try_text(kind: str, folder: Path, number: int, chance: random.Random) -> Verdict | None:
    """The verdict on a fault of a text, and the fault; None if the text has nothing to change."""
    case = CASES[number % len(CASES)]
    _, job = load(case)
    text, _ = build_sound(case, folder)
    lines = _DIGEST.sub("", text).split("\n")
    changed = TEXT_FAULTS[kind](lines, job, chance)
    if changed is None:
        return None
    edited = sign("\n".join(changed))
    sound, sound_alone = verify_sound(case, folder)
    outcome, alone = verify(edited, case, folder)
    new = [line for line, old in zip(changed, lines, strict=True) if line != old]
    row = f"{kind}, {case}: {new[0]}" if new else kind
    if kind == "depth in the text" and not is_cut_otherwise(job, text, job, edited):
        return IDLE, row
    if alone.code == sound_alone.code and not alone.lines - sound_alone.lines:
        row = f"{_REBUILT}{row}"
    if outcome.code > sound.code:
        return "refused", row
    return ("a line more" if outcome.lines - sound.lines else "no line"), row


def main(seed: int, largest_count: int, *names: str) -> int:
    """Prints the table and the faults without a line; 1 if there is one."""
    table = open_table(COLUMNS, f", seed {seed}")
    silent: list[str] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for kind in select(KINDS, names):
            try_fault = try_text if kind in TEXT_FAULTS else try_job
            count = min(KINDS[kind], largest_count)
            judged = try_faults(kind, seed, count, partial(try_fault, kind, folder))
            verdicts = Counter(verdict for verdict, _ in judged)
            rebuilt = sum(text.startswith(_REBUILT) for _, text in judged)
            unseen = [text for verdict, text in judged if verdict == "no line"]
            silent += unseen
            seeded = len(judged) - verdicts[IDLE]
            cells = verdicts["refused"], verdicts["a line more"], must_be_none(len(unseen))
            table.add(kind, seeded, *cells, rebuilt, verdicts[IDLE])
    print("\n".join(["", *silent]))
    return int(bool(silent))


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    sys.exit(main(*read_words(1, 20)))
