"""Faults of clamps and pieces seeded in programs of mills, and whether camgen finds them.

python -m bench.check.mill_faults [SEED, 1] [OF A KIND, 20]

The rule that chooses them was written down before the checks. There are 100 faults, 20 of each kind
of `SEEDS`. The drawings are `CASES` in turn, with their own jobs or with `JOB`, built for LinuxCNC.
A drawing that is not there is named and left out. A clamp stands on the stock beside the part.

- in the job: the clamp moved into the way of the tool, or into the way of the holder; the tool set
  so short that its holder reaches into the material;
- in the text, whose digest is made right again: a tab taken away, or all tabs of one contour.

The numbers come from a generator with the seed. A fault counts if it matters, by a sweep that
shares no code with the checks: the tool or the holder meets the box of the clamp, the holder meets
cells of the stock, cells of a bridge are gone, or a piece of cells has lost the frame. A fault
without effect is replaced by another. Each must be found by `camgen verify` with the drawing and
the job, without a plan: exit code 3 or 4, where the sound program has 0.
"""

from __future__ import annotations

import random
import re
import sys
import tempfile
import tomllib
import warnings
from collections import Counter
from collections.abc import Callable, Sequence
from copy import deepcopy
from functools import partial
from pathlib import Path
from typing import NamedTuple

import cv2
import ezdxf
import numpy as np
from ezdxf import bbox

from bench.check.cells import Grid, carve, make_disc
from bench.check.set_up_faults import list_tools
from bench.support.commands import Tables, run_camgen, write_job
from bench.support.faults import IDLE, Verdict, judge_faults
from bench.support.gcode_text import Move, read_moves, sample_move
from bench.support.motions import Array
from bench.support.runner import ROOT, SHARED, must_be_none, open_table, read_words
from camgen.model.signature import sign

#: Drawings with the names of their golden jobs, "" for `JOB`.
CASES = {
    ROOT / "fixtures" / "parts" / "motor.dxf": "motor-plate",
    ROOT / "fixtures" / "parts" / "bracket.dxf": "bracket-tabs",
    SHARED / "cases" / "nested.dxf": "",
    SHARED / "cases" / "slug.dxf": "",
    SHARED / "cases" / "clamp.dxf": "",
}
JOB: Tables = {
    "operation": {"depth": 6.0, "passes": 2, "tabs": 3},
    "tool": {"diameter": 6.0},
    "process": {"spindle": 12_000.0},
}
#: Stock around the drawing, on which the clamp stands, mm.
MARGIN = 60.0
#: The clamp from above, mm, and its height.
CLAMP = 16.0
HEIGHT = 14.0
#: Radius and height of the holder, mm, and its distance from the tip.
HOLDER = (22.0, 40.0)
LENGTH = 40.0
#: Size of the cells of the sweep, mm.
PITCH = 0.4
#: Places of a clamp that are tried for one fault.
MOST_TRIED = 200

COLUMNS = "fault | seeded | found | missed | left out: without effect"
_DIGEST = re.compile(r" - text [0-9a-f]{12}")
_HEIGHT = re.compile(r"\bZ(-?[0-9.]+)")


class Sound(NamedTuple):
    """A program without faults.

    part: the drawing.
    job: tables of the job.
    text: the program.
    moves: its motions.
    places: (N, 3) places on each motion, mm.
    """

    part: Path
    job: Tables
    text: str
    moves: list[Move]
    places: list[Array]


class Fault(NamedTuple):
    """A faulty program.

    job: tables of the job.
    text: the program.
    matters: whether the sweep finds harm.
    """

    job: Tables
    text: str
    matters: bool


def load(drawing: Path, case: str) -> Tables:
    """The job of a drawing, with a thickness, a clamp on the stock and a holder on each tool."""
    job = deepcopy(JOB)
    if case:
        job = tomllib.loads((ROOT / "fixtures" / "cases" / case / "job.toml").read_text())
    stock = job.setdefault("stock", {})
    stock.setdefault("thickness", max(step["depth"] for step in _list_cuts(job)))
    stock["margin"] = MARGIN
    radius, height = HOLDER
    for row in list_tools(job):
        row["length"] = LENGTH
        row["holder"] = [[-radius, -radius, 0.0, radius, radius, -height]]
    job["cell"] = {"fixtures": [place_clamp(*find_corner(drawing))]}
    return job


def _list_cuts(job: Tables) -> list[Tables]:
    steps = job.get("operations") or [job["operation"]]
    return [step for step in steps if step.get("kind") not in ("drill", "chamfer")]


def find_corner(drawing: Path) -> tuple[float, float]:
    """A place on the stock outside of the drawing: its lower corner less the margin, mm."""
    box = bbox.extents(ezdxf.readfile(drawing).modelspace())
    return box.extmin.x - MARGIN + CLAMP / 2, box.extmin.y - MARGIN + CLAMP / 2


def place_clamp(x: float, y: float) -> list[float]:
    """The box of a clamp about a place, mm."""
    half = CLAMP / 2
    return [x - half, y - half, 0.0, x + half, y + half, HEIGHT]


# The sweep.


def find_radius(job: Tables, number: int) -> float:
    """The radius of a tool, mm."""
    rows = list_tools(job)
    row = next((row for row in rows if row.get("number", 0) == number), rows[0])
    return float(row.get("diameter", 6.0)) / 2


def find_radii(job: Tables) -> dict[int, float]:
    """The radius of each tool by its number, mm."""
    numbers = {0, *(row.get("number", 0) for row in list_tools(job))}
    return {number: find_radius(job, number) for number in numbers}


def find_length(job: Tables, number: int) -> float:
    """The distance of the holder from the tip of a tool, mm."""
    rows = list_tools(job)
    return float(next((row for row in rows if row.get("number", 0) == number), rows[0])["length"])


def meets_clamp(sound: Sound, job: Tables, *, holder: bool) -> bool:
    """Whether the tool, or its holder, reaches half a mm or more into the clamp of a job."""
    x1, y1, _, x2, y2, top = job["cell"]["fixtures"][0]
    for move, places in zip(sound.moves, sound.places, strict=True):
        radius = HOLDER[0] if holder else find_radius(job, move.tool)
        height = find_length(job, move.tool) if holder else 0.0
        points = places[places[:, 2] + height < top - 0.5]
        distances = np.maximum(np.maximum([x1, y1] - points[:, :2], points[:, :2] - [x2, y2]), 0.0)
        if (np.hypot(*distances.T) < radius - 0.5).any():
            return True
    return False


def holder_meets_stock(moves: Sequence[Move], job: Tables) -> bool:
    """Whether a holder is half a mm or more in cells that no motion until then has cut."""
    radii = find_radii(job)
    grid = Grid.around(moves, HOLDER[0], PITCH)
    for move in moves:
        for x, y, z in sample_move(move, PITCH) if move.deepest > 0 and not move.rapid else ():
            grid.stamp(x, y, radii[move.tool], -z)
            below = -z - find_length(job, move.tool)
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


def seed_tool_meets_clamp(sound: Sound, chance: random.Random) -> Fault | None:
    job = deepcopy(sound.job)
    deep = [move for move in sound.moves if move.deepest > 0]
    x, y, _ = chance.choice(list(sample_move(chance.choice(deep), PITCH)))
    job["cell"]["fixtures"] = [place_clamp(float(x), float(y))]
    return Fault(job, sound.text, meets_clamp(sound, job, holder=False))


def seed_holder_meets_clamp(sound: Sound, chance: random.Random) -> Fault | None:
    """A clamp beside the way of the tool, and a tool so short that its holder reaches the clamp."""
    job = deepcopy(sound.job)
    deep = [move for move in sound.moves if move.deepest > 0]
    lowest = max(move.deepest for move in deep)
    for row in list_tools(job):
        row["length"] = lowest + chance.uniform(1.0, HEIGHT - lowest - 2.0)
    for _ in range(MOST_TRIED):
        x, y, _ = chance.choice(list(sample_move(chance.choice(deep), PITCH)))
        angle = chance.uniform(0.0, 2 * np.pi)
        distance = chance.uniform(CLAMP / 2 + 3.0, HOLDER[0] + CLAMP / 2)
        job["cell"]["fixtures"] = [
            place_clamp(float(x + distance * np.cos(angle)), float(y + distance * np.sin(angle)))
        ]
        if meets_clamp(sound, job, holder=True) and not meets_clamp(sound, job, holder=False):
            return Fault(job, sound.text, matters=True)
    return None


def seed_holder_meets_stock(sound: Sound, chance: random.Random) -> Fault | None:
    job = deepcopy(sound.job)
    rows = list_tools(job)
    numbers = {move.tool for move in sound.moves if move.deepest > 2.0}
    row = chance.choice([row for row in rows if row.get("number", 0) in numbers])
    moves = [move for move in sound.moves if move.tool == row.get("number", 0)]
    row["length"] = max(move.deepest for move in moves) - chance.uniform(0.8, 2.0)
    return Fault(job, sound.text, holder_meets_stock(sound.moves, job))


def seed_tabs(sound: Sound, chance: random.Random, *, is_one: bool) -> Fault | None:
    lines = _DIGEST.sub("", sound.text).split("\n")
    laps = find_tabs(lines)
    if not laps:
        return None
    lap = chance.choice(laps)
    tabs = [chance.choice(lap)] if is_one else lap
    text = sign("\n".join(take_away(lines, tabs)))
    before, after = (
        find_through(moves, sound.job) for moves in (sound.moves, list(read_moves(text)))
    )
    if len(tabs) < len(lap):
        # Half of the smallest bridge: as long as the narrowest tool is wide, and 3 mm wide.
        bridge = 1.5 * min(find_radii(sound.job).values())
        return Fault(sound.job, text, int((after & ~before).sum()) * PITCH**2 > bridge)
    return Fault(sound.job, text, count_loose(after) > count_loose(before))


#: Kinds of faults.
SEEDS: dict[str, Callable[[Sound, random.Random], Fault | None]] = {
    "clamp in the way of the tool": seed_tool_meets_clamp,
    "clamp in the way of the holder": seed_holder_meets_clamp,
    "holder in the material": seed_holder_meets_stock,
    "one tab taken away": partial(seed_tabs, is_one=True),
    "all tabs of a contour taken away": partial(seed_tabs, is_one=False),
}


# The bench.


def build(drawing: Path, case: str, folder: Path) -> Sound:
    """The sound program of a case, which the sweep and `camgen verify` find free of faults."""
    job = load(drawing, case)
    part = folder / "part.dxf"
    part.write_bytes(drawing.read_bytes())
    program = folder / "part.ngc"
    write_job(job, part.with_suffix(".toml"))
    code, lines = run_camgen("build", part, "--post", "gcode", "-o", program)
    if code:
        raise RuntimeError(f"{drawing.name} is not built: {lines}")
    text = program.read_text()
    moves = list(read_moves(text))
    sound = Sound(drawing, job, text, moves, [sample_move(move, PITCH) for move in moves])
    if (code := verify(Fault(job, text, matters=False), drawing, folder)) != 0:
        raise RuntimeError(f"{drawing.name} is refused as it is, exit code {code}")
    for holder in (False, True):
        assert not meets_clamp(sound, job, holder=holder), f"{drawing.name} meets its clamp"
    assert not holder_meets_stock(sound.moves, job), f"{drawing.name} has a holder in material"
    return sound


def verify(fault: Fault, drawing: Path, folder: Path) -> int:
    """The exit code of `camgen verify` without a plan."""
    part, program, job = folder / "part.dxf", folder / "part.ngc", folder / "fault.toml"
    part.write_bytes(drawing.read_bytes())
    program.write_text(fault.text)
    write_job(fault.job, job)
    return run_camgen("verify", program, "--post", "gcode", "--part", part, "--job", job).code


def main(seed: int, count: int) -> int:
    """Prints the table and the faults that are missed; 1 if there is one."""
    missed: list[str] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        drawings = {drawing: case for drawing, case in CASES.items() if drawing.exists()}
        sounds = [build(drawing, case, folder) for drawing, case in drawings.items()]
        table = open_table(COLUMNS, f", seed {seed}")
        for kind, make in SEEDS.items():

            def judge(number: int, chance: random.Random) -> Verdict:
                sound = sounds[number % len(sounds)]
                fault = make(sound, chance)  # noqa: B023 (it is called in this turn alone)
                if fault is None or not fault.matters:
                    return IDLE, ""
                is_found = verify(fault, sound.part, folder) in (3, 4)
                return "found" if is_found else "missed", f"{sound.part.name}, fault {number}"

            judged = judge_faults(kind, seed, count, judge)
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
