"""Convex edges of twelve parts that an arm works in one set-up and in two.

    python -m bench.robots.set_ups [PART ...]

Parts, arm, tool and table are those of ``bench.robots.coverage``. "As the job has it": one set-up,
the part stands as its file has it at the place of that bench. "Best": the set-up that
``camgen place`` finds, and its two set-ups. Edges count that are worked whole or in pieces; mm
are those of the edges, a stretch that both set-ups work once. "In reach": edges that some
resting face and some place of the grid lets the joints reach at every sample, with a tool that is
clear of part and table: the aim of two set-ups. Exits with 1 if two set-ups leave one of those.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from bench.machine import machine
from bench.robots.coverage import list_parts, make_job
from bench.support.runner import Table, verdict
from bench.support.timing import timed
from camgen.model.part import Part
from camgen.pipeline import poster_of
from camgen.pipeline.inputs import read_inputs
from camgen.pipeline.place import Search, search_place
from camgen.read.files import Files
from camgen.read.job_file import from_mapping

POST = "rapid"


def search(part: Part) -> Search:
    """The search of ``camgen place`` for a part."""
    files = Files()
    job = from_mapping(make_job(part), files)
    read = read_inputs([part], job, poster_of(POST, job, "job").cell(), files)
    return search_place(read.part, job, read.cell, POST)


def main(names: Sequence[str]) -> int:
    """The table of all parts."""
    print(machine())
    table = Table(
        "part | convex edges | mm {:,.0f} | as the job has it | mm {:,.0f} | best one | mm {:,.0f} "
        "| two | mm {:,.0f} | in reach | left of it | goal | s {:.0f}"
    )
    with tempfile.TemporaryDirectory() as folder:
        for name, part in list_parts(Path(folder), names):
            edges = [edge for edge in part.solid.edges if edge.convex]
            found, seconds = timed(partial(search, part))
            ways = [[found.here], [found.best[0]], found.set_ups]
            cells: list[object] = []
            for trials in ways:
                worked = found.measure_worked(trials)
                cells += [len(worked), sum(worked.values())]
            left = found.in_reach - found.measure_worked(found.set_ups).keys()
            length = sum(edge.length for edge in edges)
            cells += [len(found.in_reach), len(left), verdict(not left), seconds]
            table.add(name, len(edges), length, *cells)
    return int(table.missed > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
