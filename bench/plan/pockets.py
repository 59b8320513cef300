"""`pocket` on real drawings and on 251 shapes.

    python -m bench.plan.pockets [FOLDER | shapes COUNT]

All closed contours are pockets and islands for a 6 mm tool, or another one for small drawings. GEOS
judges the area that a disc of the tool could reach and that is bare by more than 0.01 mm, and the
area beyond the walls that is cut by more than 0.005 mm, links included. Pockets that are left out
with a note are not judged. Exits with 1 if a figure misses its goal.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from itertools import chain
from pathlib import Path

import numpy as np

import camgen
from bench.plan.follow import DRAWINGS
from bench.support.runner import SHARED, Cells, Scenario, run, verdict
from camgen.model.job import Job, OperationTable, ToolTable
from camgen.model.pose import frozen
from tests.support.swept import enclosed, reachable, swept

COLUMNS = (
    "drawing | tool mm {:g} | contours | left out | paths | chords m {:.1f} | bare mm2 {:.4f} "
    "| gouged mm2 {:.4f} | processor s {:.2f} | "
)
#: Largest area that may be bare, or cut too far, in all pockets of a drawing, mm2.
GOAL = 1e-3


def shapes(count: int) -> camgen.Part:
    """A plate with ``count`` - 1 pockets of 20 to 40 mm in it, every third with an island."""
    chance = np.random.default_rng(7)
    side = int(np.ceil(np.sqrt(count)))
    stars: list[camgen.Contour] = []
    while len(stars) < count:
        place = np.array([len(stars) % side, len(stars) // side]) * 60.0
        stars.append(_draw_star(f"c{len(stars) + 1}", place, (12, 25), 3 + len(stars) % 9, chance))
        if len(stars) % 3 == 0 and len(stars) < count:
            stars.append(_draw_star(f"c{len(stars) + 1}", place, (2, 5), 5, chance))
    return camgen.Part("shapes", "shapes", "mm", tuple(stars), ())


def _draw_star(
    name: str,
    place: np.ndarray,
    arms: tuple[float, float],
    count: int,
    chance: np.random.Generator,
) -> camgen.Contour:
    """A star about a place. arms: shortest and longest distance of its corners, mm."""
    angle = 2 * np.pi * (np.arange(count) + chance.uniform(0.2, 0.8, count)) / count
    arm = chance.uniform(*arms, count)
    points = place + arm[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    bulges = np.where(chance.random(count) < 0.5, 0.0, 0.2)
    return camgen.Contour(frozen(points), frozen(bulges), True, "0", name)


def measure(name: str, read: Callable[[], camgen.Part], diameter: float) -> Iterator[Cells]:
    """The row of a drawing."""
    part = read()
    job = Job(tool=ToolTable(diameter=diameter), operation=OperationTable(kind="pocket"))
    start = time.process_time()
    plan = camgen.plan(part, job)
    seconds = time.process_time() - start
    skipped = [note.ids for note in plan.notes if note.kind == "skipped"]
    left_out = set(chain.from_iterable(skipped))
    region = enclosed([c for c in part.contours if c.closed and c.id not in left_out])
    covered = swept(plan.paths, diameter / 2)
    bare = reachable(region, diameter / 2).difference(covered).buffer(-0.005).area
    gouged = covered.difference(region.buffer(0.005)).area
    chords = [np.hypot(*np.diff(path.position[:, :2], axis=0).T).sum() for path in plan.paths]
    failed = sum("check failed" in note.what for note in plan.notes)
    counts = len(part.contours), len(left_out), len(plan.paths)
    is_met = max(bare, gouged) <= GOAL and not failed
    yield name, diameter, *counts, sum(chords) / 1000, bare, gouged, seconds, verdict(is_met)


def inputs(words: list[str]) -> Iterator[tuple[str, Callable[[], camgen.Part], float]]:
    """Name, reader and diameter of the tool (mm) of each drawing."""
    if words[:1] == ["shapes"]:
        yield f"{words[1]} shapes", lambda: shapes(int(words[1])), 6.0
        return
    folder = Path(words[0]) if words else SHARED / "dxf"
    yield "251 shapes", lambda: shapes(251), 6.0
    for name, diameter in DRAWINGS.items():
        yield Path(name).name, lambda name=name: camgen.read(folder / name), diameter


if __name__ == "__main__":
    sys.exit(run(Scenario(COLUMNS, inputs(sys.argv[1:]), measure)))
