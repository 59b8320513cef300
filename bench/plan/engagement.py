"""How much of the tool `pocket` engages: python -m bench.plan.engagement [COUNT | shapes COUNT]

Pockets of COUNT (20) random shapes, and of real drawings without the word `shapes`: stepover 0.5, with the bound of the
default, 0.65, and without one. Judged by counting the cells of a plate that a disc takes along the paths, links and
entries and all: the way on which more than the bound and the judge's own noise is engaged. Prints a table for
docs/benchmarks.md.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import camgen
from bench.machine import machine
from bench.plan.follow import DRAWINGS
from bench.plan.pockets import shapes
from camgen.model.errors import CamgenError
from camgen.model.job import Job, OperationTable, ToolTable
from camgen.model.part import Part
from tests.support.engaged import engaged
from tests.support.swept import enclosed

STEPOVER, BOUND, NOISE = 0.5, 0.65, 0.06
#: Ways longer than this, m, take too long to count.
LONGEST = 8.0


def judged(name: str, part: Part, diameter: float) -> str:
    """One row of the table: with and without the bound metres, planning seconds, mm and percent above it."""
    row = f"| {name} | {diameter:g}"
    for most in (None, 1.0):
        operation = OperationTable(kind="pocket", stepover=STEPOVER, engagement=most)
        start = time.process_time()
        made = camgen.plan(part, Job(tool=ToolTable(diameter=diameter), operation=operation))
        seconds = time.process_time() - start
        found = engaged(made.paths, diameter / 2)
        way, above = found[:, 3].sum(), found[found[:, 2] > BOUND + NOISE, 3].sum()
        row += f" | {way / 1000:.2f} | {seconds:.2f} | {above:.1f} | {100 * above / way:.2f} %"
    return row + " |"


def main() -> int:
    count = int(sys.argv[-1]) if sys.argv[1:] else 20
    folder = Path(__file__).parents[2].parent / "shared" / "data" / "dxf"
    print(f"{machine()}\n")
    print(
        "| drawing | tool mm | m | s | above, mm | above "
        "| m, no bound | s, no bound | above, no bound, mm | above, no bound |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|")
    print(judged(f"{count} shapes", shapes(count), 6.0), flush=True)
    for name, diameter in (
        DRAWINGS.items() if folder.is_dir() and sys.argv[1:2] != ["shapes"] else ()
    ):
        try:
            part = camgen.read(folder / name)
            if enclosed(part.contours).area / diameter < 1000 * LONGEST:
                print(judged(Path(name).name, part, diameter), flush=True)
        except CamgenError as error:
            print(f"| {name} | {diameter:g} | {error} |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
