"""`pocket` on real drawings and on 251 shapes: python -m bench.plan.pockets [FOLDER | FILE DIAMETER | shapes COUNT]

What closed contours enclose is cleared with a 6 mm tool, or another one for small drawings, and judged by GEOS: what a
disc of the tool could reach and is bare by more than 0.01 mm, and what is cut beyond the walls by more than 0.005 mm,
links and all. Pockets that are left out with a note are left out there too. Prints a table for docs/benchmarks.md and
exits with 1 when a figure misses its goal.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

import camgen
from bench.machine import machine
from bench.plan.follow import DRAWINGS
from camgen.model.errors import CamgenError
from camgen.model.job import Job, OperationTable, ToolTable
from camgen.model.part import Contour, Part
from camgen.model.pose import frozen
from tests.support.swept import enclosed, reachable, swept

#: What may be bare or cut too far, mm2, of all pockets of a drawing.
GOAL = 1e-3


def shapes(count: int) -> Part:
    """A plate with ``count`` - 1 pockets of 20 to 40 mm in it, every third with an island."""
    chance = np.random.default_rng(7)
    side = int(np.ceil(np.sqrt(count)))
    found: list[Contour] = []
    while len(found) < count:
        place = np.array([len(found) % side, len(found) // side]) * 60.0
        found.append(_star(place, 12, 25, 3 + len(found) % 9, chance, len(found)))
        if len(found) % 3 == 0 and len(found) < count:
            found.append(_star(place, 2, 5, 5, chance, len(found)))
    return Part("shapes", "shapes", "mm", tuple(found), ())


def _star(
    place: np.ndarray, low: float, high: float, count: int, chance: np.random.Generator, name: int
) -> Contour:
    angle = 2 * np.pi * (np.arange(count) + chance.uniform(0.2, 0.8, count)) / count
    arm = chance.uniform(low, high, count)
    points = place + arm[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    bulges = np.where(chance.random(count) < 0.5, 0.0, 0.2)
    return Contour(frozen(points), frozen(bulges), True, "0", f"c{name + 1}")


def judged(name: str, part: Part, diameter: float) -> str:
    """One row of the table."""
    job = Job(tool=ToolTable(diameter=diameter), operation=OperationTable(kind="pocket"))
    start = time.process_time()
    made = camgen.plan(part, job)
    seconds = time.process_time() - start
    left_out = {i for note in made.notes if note.kind == "skipped" for i in note.ids}
    region = enclosed([c for c in part.contours if c.closed and c.id not in left_out])
    covered = swept(made.paths, diameter / 2)
    bare = reachable(region, diameter / 2).difference(covered).buffer(-0.005).area
    gouged = covered.difference(region.buffer(0.005)).area
    metres = (
        sum(float(np.hypot(*np.diff(path.position[:, :2], axis=0).T).sum()) for path in made.paths)
        / 1000
    )
    failed = sum("check failed" in note.what for note in made.notes)
    verdict = "ok" if max(bare, gouged) <= GOAL and not failed else "**missed**"
    return (
        f"| {name} | {diameter:g} | {len(part.contours)} | {len(left_out)} | {len(made.paths)} | {metres:.1f} "
        f"| {bare:.4f} | {gouged:.4f} | {seconds:.2f} | {verdict} |"
    )


def main() -> int:
    words = sys.argv[1:]
    folder = Path(__file__).parents[2].parent / "shared" / "data" / "dxf"
    print(f"{machine()}\n")
    print(
        "| drawing | tool mm | contours | left out | paths | chords m | bare mm2 | gouged mm2 | processor s | |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|")
    missed = 0
    if words[:1] == ["shapes"]:
        asked = [(f"{words[1]} shapes", shapes(int(words[1])), 6.0)]
    elif words and Path(words[0]).is_file():
        asked = [(Path(words[0]).name, camgen.read(Path(words[0])), float(words[1]))]
    else:
        folder = Path(words[0]) if words else folder
        asked = [("251 shapes", shapes(251), 6.0)]
        asked += [
            (Path(name).name, camgen.read(folder / name), size) for name, size in DRAWINGS.items()
        ]
    for name, part, diameter in asked:
        try:
            row = judged(name, part, diameter)
        except CamgenError as error:
            row = f"| {name} | {diameter:g} | {error} | **missed** |"
        missed += "missed" in row
        print(row, flush=True)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
