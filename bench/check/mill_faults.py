"""Faults of holders and tabs seeded in programs of mills, and whether camgen finds them.

python -m bench.check.mill_faults [SEED, 1] [OF A KIND, 20] [KIND ...]

The rule that chooses them was written down before the checks. There are 20 faults of each kind of
`SEEDS`. The drawings are `CASES` in turn, with their own jobs or with `JOB`, built for LinuxCNC. A
drawing that is not there is named and left out.

- in the job: a tool so short that its holder reaches into the material
- in the text, whose digest is made right again: a tab taken away, or all tabs of one contour

The numbers come from a generator with the seed. A fault counts if it matters, by a sweep that
shares no code with the checks: the holder meets cells of the stock, cells of a bridge are gone, or
a piece of cells has lost the frame. A fault without effect is replaced by another. Each must be
found by `camgen verify` with the drawing and the job, without a plan: exit code 3 or 4, where the
sound program has 0. Faults of clamps are those of `bench.check.fixture_faults`.
"""

from __future__ import annotations

import random
import re
import sys
import tempfile
import tomllib
import warnings
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from functools import cache, partial
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from bench.check.cells import Grid, carve, make_disc
from bench.check.set_up_faults import list_tools
from bench.support.commands import Tables, run_camgen, write_job
from bench.support.faults import IDLE, Verdict, try_faults
from bench.support.gcode_text import Move, read_moves, sample_move
from bench.support.motions import Array
from bench.support.runner import ROOT, SHARED, must_be_none, open_table, read_words, select
from camgen.model.signature import sign

#: Drawings with the names of their golden jobs, "" for `JOB`.
CASES = {
    ROOT / "fixtures" / "parts" / "bracket.dxf": "bracket-tabs",
    ROOT / "fixtures" / "parts" / "motor.dxf": "motor-plate",
    SHARED / "cases" / "nested.dxf": "",
    SHARED / "cases" / "slug.dxf": "",
    SHARED / "cases" / "clamp.dxf": "",
}
JOB: Tables = {
    "operation": {"depth": 6.0, "passes": 2, "tabs": 3},
    "tool": {"diameter": 6.0},
    "process": {"spindle": 12_000.0},
}
#: Stock around the drawing, mm.
MARGIN = 60.0
#: Radius and height of the holder, mm, and its distance from the tip.
HOLDER = (22.0, 40.0)
LENGTH = 40.0
#: Size of the cells of the sweep, mm.
PITCH = 0.4

COLUMNS = "fault | seeded | found | missed | left out: without effect"
_DIGEST = re.compile(r" - text [0-9a-f]{12}")
_HEIGHT = re.compile(r"\bZ(-?[0-9.]+)")


class Sound(NamedTuple):
    """A program without faults.

    part: the drawing.
    job: tables of the job.
    text: the program.
    moves: its motions.
    """

    part: Path
    job: Tables
    text: str
    moves: list[Move]


class Fault(NamedTuple):
    """A faulty program.

    job: tables of the job.
    text: the program.
    matters: whether the sweep finds harm.
    """

    job: Tables
    text: str
    matters: bool


def load(case: str) -> Tables:
    """The job of a case, with a thickness, a margin, and a holder on each tool."""
    job = deepcopy(JOB)
    if case:
        job = tomllib.loads((ROOT / "fixtures" / "cases" / case / "job.toml").read_text())
    steps = job.get("operations") or [job["operation"]]
    cuts = [step["depth"] for step in steps if step.get("kind") not in ("drill", "chamfer")]
    stock = job.setdefault("stock", {})
    stock.setdefault("thickness", max(cuts))
    stock["margin"] = MARGIN
    radius, height = HOLDER
    for row in list_tools(job):
        row["length"] = LENGTH
        row["holder"] = [[-radius, -radius, 0.0, radius, radius, -height]]
    return job


# The sweep.


def find_tool(job: Tables, number: int) -> Tables:
    """The row of a tool."""
    rows = list_tools(job)
    return next((row for row in rows if row.get("number", 0) == number), rows[0])


def find_radii(job: Tables) -> dict[int, float]:
    """The radius of each tool by its number, mm."""
    numbers = {0, *(row.get("number", 0) for row in list_tools(job))}
    return {number: find_tool(job, number).get("diameter", 6.0) / 2 for number in numbers}


def is_holder_in_stock(moves: Sequence[Move], job: Tables) -> bool:
    """Whether a holder is half a mm or more in cells that no motion until then has cut."""
    radii = find_radii(job)
    grid = Grid.around(moves, HOLDER[0], PITCH)
    for move in moves:
        for x, y, z in sample_move(move, PITCH) if move.deepest > 0 and not move.rapid else ():
            grid.stamp(x, y, radii[move.tool], -z)
            below = -z - find_tool(job, move.tool)["length"]
            radius = HOLDER[0] - 0.5
            disc = grid.cut_out(x, y, radius)[make_disc(radius, PITCH)]
            if below > 0.5 and disc.min() < below - 0.5:
                return True
    return False


def find_through(moves: Sequence[Move], job: Tables) -> Array:
    """The cells that are cut through."""
    grid, _ = carve(list(moves), find_radii(job), PITCH)
    return np.asarray(grid.depth >= job["stock"]["thickness"] - 0.01)


def count_loose(through: Array) -> int:
    """Pieces of more than a hundred cells that do not reach the rim of the grid."""
    count, labels = cv2.connectedComponents((~through).astype(np.uint8), connectivity=4)
    rim = np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]])
    sizes = np.bincount(labels.ravel(), minlength=count)
    inside = np.setdiff1d(np.arange(1, count), rim)
    return int((sizes[inside] > 100).sum())


# Faults.


def find_tabs(lines: Sequence[str]) -> list[list[list[int]]]:
    """The tabs of each lap: lines between going up at feed and being as deep as before again."""
    laps: list[list[list[int]]] = []
    height, rapid = np.inf, True
    floor, rising = np.inf, list[int]()
    for number, line in enumerate(lines):
        code = line.split("(")[0]
        if re.search(r"\bG0*0\b", code):
            rapid = True
        elif re.search(r"\bG0*[123]\b", code):
            rapid = False
        match = _HEIGHT.search(code)
        if not match and not re.search(r"\b[XY]-?[0-9.]", code):
            continue
        now = float(match[1]) if match else height
        if rapid:
            floor, rising = np.inf, []
            laps.append([])
        elif rising:
            rising.append(number)
            if now <= floor + 1e-6:
                laps[-1].append(rising)
                rising = []
        elif height < -1e-6 and now > height + 1e-6 and now < 0:
            floor, rising = height, [number]
        height = now
    return [lap for lap in laps if lap]


def take_away(lines: Sequence[str], tabs: Sequence[Sequence[int]]) -> list[str]:
    """The text with the heights over tabs as low as beside them."""
    changed = list(lines)
    for tab in tabs:
        match = _HEIGHT.search(lines[tab[-1]])
        assert match
        for number in tab:
            changed[number] = _HEIGHT.sub(f"Z{match[1]}", lines[number])
    return changed


def seed_holder_in_stock(sound: Sound, chance: random.Random) -> Fault | None:
    job = deepcopy(sound.job)
    rows = list_tools(job)
    numbers = {move.tool for move in sound.moves if move.deepest > 2.0}
    row = chance.choice([row for row in rows if row.get("number", 0) in numbers])
    moves = [move for move in sound.moves if move.tool == row.get("number", 0)]
    row["length"] = max(move.deepest for move in moves) - chance.uniform(0.8, 2.0)
    return Fault(job, sound.text, is_holder_in_stock(sound.moves, job))


def seed_tabs(sound: Sound, chance: random.Random, *, is_one: bool) -> Fault | None:
    lines = _DIGEST.sub("", sound.text).split("\n")
    laps = find_tabs(lines)
    if not laps:
        return None
    lap = chance.choice(laps)
    tabs = [chance.choice(lap)] if is_one else lap
    text = sign("\n".join(take_away(lines, tabs)))
    before = find_through(sound.moves, sound.job)
    after = find_through(list(read_moves(text)), sound.job)
    if len(tabs) < len(lap):
        # Half of the smallest bridge: as long as the narrowest tool is wide, and 3 mm wide.
        bridge = 1.5 * min(find_radii(sound.job).values())
        return Fault(sound.job, text, int((after & ~before).sum()) * PITCH**2 > bridge)
    return Fault(sound.job, text, count_loose(after) > count_loose(before))


#: Makes a fault; None if the program has nothing to change.
Seed = Callable[[Sound, random.Random], Fault | None]
#: Kinds of faults.
SEEDS: dict[str, Seed] = {
    "holder in the material": seed_holder_in_stock,
    "one tab taken away": partial(seed_tabs, is_one=True),
    "all tabs of a contour taken away": partial(seed_tabs, is_one=False),
}


# The bench.


@cache
def build(drawing: Path, case: str, folder: Path) -> Sound:
    """The sound program of a case."""
    job = load(case)
    part = folder / "part.dxf"
    part.write_bytes(drawing.read_bytes())
    program = folder / "part.ngc"
    write_job(job, part.with_suffix(".toml"))
    code, lines = run_camgen("build", part, "--post", "gcode", "-o", program)
    if code:
        raise RuntimeError(f"{drawing.name} is not built: {lines}")
    text = program.read_text()
    return Sound(drawing, job, text, list(read_moves(text)))


@cache
def check_sound(drawing: Path, case: str, folder: Path) -> None:
    """Checks that the sweep and `camgen verify` find the sound program free of faults."""
    sound = build(drawing, case, folder)
    if (code := verify(Fault(sound.job, sound.text, matters=False), drawing, folder)) != 0:
        raise RuntimeError(f"{drawing.name} is refused as it is, exit code {code}")
    assert not is_holder_in_stock(sound.moves, sound.job), f"{drawing.name}: holder in material"


def verify(fault: Fault, drawing: Path, folder: Path) -> int:
    """The exit code of `camgen verify` without a plan."""
    part, program, job = folder / "part.dxf", folder / "part.ngc", folder / "fault.toml"
    part.write_bytes(drawing.read_bytes())
    program.write_text(fault.text)
    write_job(fault.job, job)
    return run_camgen("verify", program, "--post", "gcode", "--part", part, "--job", job).code


def try_fault(
    drawings: Mapping[Path, str], make: Seed, folder: Path, number: int, chance: random.Random
) -> Verdict:
    """The verdict on the fault of a number, and its name."""
    drawing, case = list(drawings.items())[number % len(drawings)]
    sound = build(drawing, case, folder)
    fault = make(sound, chance)
    if fault is None or not fault.matters:
        return IDLE, ""
    check_sound(drawing, case, folder)
    is_found = verify(fault, sound.part, folder) in (3, 4)
    return "found" if is_found else "missed", f"{sound.part.name}, fault {number}"


def main(seed: int, count: int, *names: str) -> int:
    """Prints the table and the faults that are missed; 1 if there is one."""
    missed: list[str] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        drawings = {drawing: case for drawing, case in CASES.items() if drawing.exists()}
        table = open_table(COLUMNS, f", seed {seed}")
        for kind in select(SEEDS, names):
            try_kind = partial(try_fault, drawings, SEEDS[kind], folder)
            judged = try_faults(kind, seed, count, try_kind)
            verdicts = Counter(verdict for verdict, _ in judged)
            missed += [f"{kind}, {text}" for verdict, text in judged if verdict == "missed"]
            lost = must_be_none(verdicts["missed"])
            table.add(kind, count, verdicts["found"], lost, verdicts[IDLE])
    absent = [drawing.name for drawing in CASES if drawing not in drawings]
    lines = [*missed, *(f"left out, not there: {drawing}" for drawing in absent)]
    print("\n".join(["", *lines]))
    return bool(missed)


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    sys.exit(main(*read_words(1, 20)))
