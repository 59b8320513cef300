"""Faults of fixtures seeded in built programs: which of them matter, and which camgen verify finds.

python -m bench.check.fixture_faults [N, 100] [SEED, 1]

Each program is built with a clamp on every corner of its drawing. Then one thing is changed: the
job states another place or height of a clamp, one more clamp, or a shorter tool, or the text loses
a lift. A parser and a dense sampling of this bench decide whether the fault matters: it does where
tool or holder run into a clamp by more than SURE_MM, and it does not where both keep the margin and
SURE_MM more. `camgen verify PROGRAM --job FILE` has neither plan nor drawing. The bench fails where
a fault that matters is missed, or one that does not is reported.
"""

from __future__ import annotations

import math
import random
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np

import camgen
from bench.support.commands import Tables, run_camgen, write_job
from bench.support.gcode_text import read_moves, sample_move
from bench.support.runner import PARTS, open_table, read_words, verdict

DRAWINGS = ("plate.dxf", "bracket.dxf", "motor.dxf")
#: Distances nearer than this to a limit are counted neither way, mm.
SURE_MM = 0.05
#: Length of the steps of the sampling, mm, and the room that the jobs ask for.
STEP_MM, MARGIN = 0.05, 2.0
COLUMNS = "fault | seeded | matter | of these found | missed | do not | of these reported | "


def make_job(chance: random.Random, drawing: str) -> Tables:
    """A job with a clamp on each corner of a drawing."""
    points = np.concatenate([contour.points for contour in camgen.read(PARTS / drawing).contours])
    low, high = points.min(axis=0), points.max(axis=0)
    size, reach = chance.uniform(10, 25), chance.uniform(-4, 4)
    clamps = []
    for x, side in ((low[0], -1), (high[0], 1)):
        for y, end in ((low[1], -1), (high[1], 1)):
            top = chance.uniform(4, 30)
            near, far = (x - side * reach, y - end * reach), (x + side * size, y + end * size)
            clamps.append([float(v) for v in (*near, -10.0, *far, top)])
    diameter = chance.choice([2.0, 3.0, 4.0])
    wide = chance.uniform(8, 20)
    return {
        "operation": {"depth": chance.uniform(1, 5), "passes": chance.choice([1, 2])},
        "process": {"spindle": 9000.0, "clearance": chance.choice([5.0, 10.0, 20.0])},
        "tool": {
            "diameter": diameter,
            "length": chance.uniform(30, 60),
            "holder": [[-wide, -wide, 0, wide, wide, chance.uniform(5, 15)]],
        },
        "cell": {"fixtures": clamps, "margin": MARGIN},
    }


def move_clamp(job: Tables, _text: str, chance: random.Random) -> str | None:
    clamp = chance.choice(job["cell"]["fixtures"])
    angle, distance = chance.uniform(0, 2 * math.pi), chance.uniform(1, 40)
    for k, part in enumerate((math.cos(angle), math.sin(angle))):
        clamp[k] += distance * part
        clamp[k + 3] += distance * part
    return None


def raise_clamp(job: Tables, _text: str, chance: random.Random) -> str | None:
    chance.choice(job["cell"]["fixtures"])[5] += chance.uniform(1, 40)
    return None


def add_clamp(job: Tables, _text: str, chance: random.Random) -> str | None:
    clamps = np.array(job["cell"]["fixtures"])
    low, high = clamps[:, [0, 1]].min(axis=0), clamps[:, [3, 4]].max(axis=0)
    x, y = (chance.uniform(a, b) for a, b in zip(low, high, strict=True))
    job["cell"]["fixtures"].append([x, y, -10, x + 8, y + 8, chance.uniform(-3, 30)])
    return None


def shorten_tool(job: Tables, _text: str, chance: random.Random) -> str | None:
    job["tool"]["length"] -= chance.uniform(1, 25)
    return None


def lose_lift(job: Tables, text: str, chance: random.Random) -> str | None:
    """A lift over a clamp stops at the clearance height."""
    low = job["process"]["clearance"]
    lines = text.splitlines(keepends=True)
    lifts = []
    for k, line in enumerate(lines):
        word = next((word for word in line.split() if word[:1] == "Z"), "Z0")
        if line.startswith("G0 Z") and low < float(word[1:]) < 50 and k > 20:
            lifts.append(k)
    if not lifts:
        return None
    lines[chance.choice(lifts)] = f"G0 Z{low:g}\n"
    return "".join(lines)


FAULTS: dict[str, Callable[[Tables, str, random.Random], str | None]] = {
    "clamp moved": move_clamp,
    "clamp higher": raise_clamp,
    "clamp added": add_clamp,
    "tool shorter": shorten_tool,
    "lift lost": lose_lift,
}


def measure(text: str, job: Tables) -> tuple[float, float]:
    """The depth of a body in a clamp, and the smallest distance that the margin limits, mm."""
    tool = job["tool"]
    wide, low = tool["holder"][0][3], tool["length"] - tool["holder"][0][5]
    bodies = ((0.0, tool["diameter"] / 2), (low, wide))
    deepest, nearest = 0.0, math.inf
    for move in read_moves(text):
        places = sample_move(move, STEP_MM)
        across = move.rapid and bool(np.ptp(places[:, :2], axis=0).max() > 1e-6)
        for clamp in job["cell"]["fixtures"]:
            box = np.reshape(clamp, (2, 3))
            x1, y1, _ = box.min(axis=0)
            x2, y2, top = box.max(axis=0)
            dx = np.maximum(np.maximum(x1 - places[:, 0], places[:, 0] - x2), 0)
            dy = np.maximum(np.maximum(y1 - places[:, 1], places[:, 1] - y2), 0)
            for height, radius in bodies:
                aside, up = np.hypot(dx, dy) - radius, places[:, 2] + height - top
                deepest = max(deepest, float(np.minimum(-aside, -up).max(initial=0.0)))
                limited = up < (MARGIN if across else 0.0)
                gap = np.hypot(np.maximum(aside, 0), np.maximum(up, 0))
                nearest = min(nearest, float(gap[limited].min(initial=math.inf)))
    return deepest, nearest


def verify(text: str, job: Tables, folder: Path) -> int:
    """The exit code of camgen verify, without the plan and without the drawing."""
    program, changed = folder / "part.nc", folder / "changed.toml"
    program.write_text(text)
    write_job(job, changed)
    return run_camgen("verify", program, "--job", changed, "--post", "grbl").code


def main(count: int, seed: int) -> int:
    """The table of faults; 1 if one that matters is missed, or one that does not is reported."""
    table = open_table(COLUMNS)
    counts: dict[str, Counter[str]] = {name: Counter() for name in FAULTS}
    with tempfile.TemporaryDirectory() as name:
        for number in range(count):
            chance = random.Random(1000 * seed + number)
            fault = list(FAULTS)[number % len(FAULTS)]
            drawing = chance.choice(DRAWINGS)
            job = make_job(chance, drawing)
            text = camgen.build(PARTS / drawing, post="grbl", job=job).text
            assert measure(text, job)[1] >= MARGIN - SURE_MM, "the build itself is too near"
            text = FAULTS[fault](job, text, chance) or text
            deepest, nearest = measure(text, job)
            matters, clear = deepest > SURE_MM, nearest > MARGIN + SURE_MM
            is_found = verify(text, job, Path(name)) == 3
            tally = counts[fault]
            tally["seeded"] += 1
            tally["matter"] += matters
            tally["found"] += matters and is_found
            tally["clear"] += clear
            tally["reported"] += clear and is_found
    for fault, tally in counts.items():
        missed = tally["matter"] - tally["found"]
        is_met = not missed and not tally["reported"]
        cells = (tally["seeded"], tally["matter"], tally["found"], missed, tally["clear"])
        table.add(fault, *cells, tally["reported"], verdict(is_met))
    return int(table.missed > 0)


if __name__ == "__main__":
    sys.exit(main(*read_words(100, 1)))
