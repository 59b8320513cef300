"""Engagement of the tool in pockets: python -m bench.plan.engagement [FOLDER | shapes COUNT]

The pockets are those of ``bench.plan.pockets``, without drawings whose paths take too long to
count: stepover 0.5, with the bound of the default, 0.65, and without one. The judge counts the
cells of a plate that a disc takes along the paths, links and entries included. It measures the
length on which more than the bound and its own noise is engaged.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import camgen
from bench.plan.pockets import inputs
from bench.support.runner import Cells, Scenario, run
from camgen.model.job import Job, OperationTable, ToolTable
from tests.support.engaged import engaged
from tests.support.swept import enclosed

STEPOVER, BOUND, NOISE = 0.5, 0.65, 0.06
#: Paths longer than this, m, take too long to count.
LONGEST = 8.0
COLUMNS = (
    "drawing | tool mm {:g} | m {:.2f} | s {:.2f} | above, mm {:.1f} | above {:.2f} % "
    "| m, no bound {:.2f} | s, no bound {:.2f} | above, no bound, mm {:.1f} "
    "| above, no bound {:.2f} %"
)


def measure(name: str, read: Callable[[], camgen.Part], diameter: float) -> Iterator[Cells]:
    """The row of a drawing: length, planning seconds, mm and percent above, twice."""
    part = read()
    if enclosed(part.contours).area / diameter >= 1000 * LONGEST:
        return
    figures: list[float] = []
    for limit in (None, 1.0):
        operation = OperationTable(kind="pocket", stepover=STEPOVER, engagement=limit)
        start = time.process_time()
        plan = camgen.plan(part, Job(tool=ToolTable(diameter=diameter), operation=operation))
        seconds = time.process_time() - start
        pieces = engaged(plan.paths, diameter / 2)
        length = pieces[:, 3].sum()
        above = pieces[pieces[:, 2] > BOUND + NOISE, 3].sum()
        figures += [length / 1000, seconds, above, 100 * above / length]
    yield Path(name).name, diameter, *figures


if __name__ == "__main__":
    sys.exit(run(Scenario(COLUMNS, inputs(sys.argv[1:]), measure, may_refuse=True)))
