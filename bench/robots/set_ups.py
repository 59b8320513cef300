"""Convex edges of twelve parts that an arm works in one set-up and in two.

    python -m bench.robots.set_ups [PART ...]

Parts, arm, tool and table are those of ``bench.robots.coverage``. "As the job has it": one set-up,
the part stands as its file has it at the place of that bench. "Best": the set-up that
``camgen place`` finds, and its two set-ups. Edges count that are worked whole or in pieces; mm
are those of the edges, a stretch that both set-ups work once. "In reach": edges that some
resting face and some place of the grid lets the joints reach at every sample, with a tool that is
clear of part and table. "By two": the most of them that two faces and places of the grid reach
together, which bounds what two set-ups can do. Exits with 1 if two set-ups work fewer of them.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from bench.machine import machine
from bench.robots.coverage import list_parts, make_job
from bench.support.runner import Table, verdict
from bench.support.timing import timed
from camgen.model.job import Job
from camgen.model.part import Part
from camgen.pipeline import poster_of
from camgen.pipeline.inputs import read_inputs
from camgen.pipeline.place import Request, Search, list_spots, make_case, reach_joints, search_place
from camgen.read.files import Files
from camgen.read.job_file import from_mapping
from camgen.robots.workcell import Workcell

POST = "rapid"


def read_case(part: Part) -> tuple[Part, Job, Workcell]:
    """The part, its job and its cell."""
    files = Files()
    job = from_mapping(make_job(part), files)
    read = read_inputs([part], job, poster_of(POST, job, "job").cell(), files)
    return read.part, job, read.cell


def search(part: Part) -> Search:
    """The search of ``camgen place`` for a part."""
    return search_place(*read_case(part), Request(part, POST))


def find_in_reach(part: Part) -> tuple[set[str], int]:
    """The edges that the joints reach at every sample from one place of the grid.

    The number is the most of them that two places of the grid reach together.
    """
    case = make_case(*read_case(part), Request(part, POST))
    spots = list_spots(case, None)
    names = np.array(list(case.paths))
    rows = []
    for number, stand in enumerate(case.stands):
        stand_spots = [spot for spot in spots if spot.stand == number]
        for begin in range(0, len(stand_spots), 20):
            batch = stand_spots[begin : begin + 20]
            rows.append(reach_joints(case, batch, stand.samples).shares > 1 - 1e-9)
    is_reached = np.concatenate(rows)
    counts = is_reached.sum(axis=1)
    weights = is_reached.astype(np.float64)
    together = counts[:, None] + counts - weights @ weights.T
    return set(names[is_reached.any(axis=0)].tolist()), round(float(together.max()))


def main(names: Sequence[str]) -> int:
    """The table of all parts."""
    print(machine())
    table = Table(
        "part | convex edges | mm {:,.0f} | as the job has it | mm {:,.0f} | best one | mm {:,.0f} "
        "| two | mm {:,.0f} | in reach | left of it | by two | goal | s {:.0f}"
    )
    with tempfile.TemporaryDirectory() as folder:
        for name, part in list_parts(Path(folder), names):
            edges = [edge for edge in part.solid.edges if edge.convex]
            result, seconds = timed(partial(search, part))
            chosen = [[result.as_given], [result.best[0]], result.set_ups]
            cells: list[object] = []
            for trials in chosen:
                worked = result.measure_worked(trials)
                cells += [len(worked), sum(worked.values())]
            in_reach, by_two = find_in_reach(part)
            left = in_reach - result.measure_worked(result.set_ups).keys()
            length = sum(edge.length for edge in edges)
            is_met = len(in_reach) - len(left) >= by_two
            cells += [len(in_reach), len(left), by_two, verdict(is_met), seconds]
            table.add(name, len(edges), length, *cells)
    return int(table.missed > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
