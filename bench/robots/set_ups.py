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
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

import camgen
from bench.robots.coverage import list_parts, make_job
from bench.support.runner import Cells, Scenario, run, verdict
from bench.support.timing import timed
from camgen.pipeline import make_job_post
from camgen.pipeline.inputs import read_inputs
from camgen.pipeline.place import (
    Request,
    Search,
    list_spots,
    make_case,
    measure_worked,
    reach_joints,
    search_place,
)
from camgen.read.files import Files
from camgen.read.job_file import from_mapping

POST = "rapid"
COLUMNS = (
    "part | convex edges | mm {:,.0f} | as the job has it | mm {:,.0f} | best one | mm {:,.0f} "
    "| two | mm {:,.0f} | in reach | left of it | by two | goal | s {:.0f}"
)


def read_case(part: camgen.Part) -> tuple[camgen.Part, camgen.Job, camgen.Workcell]:
    """The part, its job and its cell."""
    files = Files()
    job = from_mapping(make_job(part), files)
    read = read_inputs([part], job, make_job_post(POST, job, "job").cell(), files)
    return read.part, job, read.cell


def search(part: camgen.Part) -> Search:
    """The search of ``camgen place`` for a part."""
    return search_place(*read_case(part), Request(part, POST))


def find_in_reach(part: camgen.Part) -> tuple[set[str], int]:
    """The edges that the joints reach at every sample from one place of the grid.

    The number is the most of them that two places of the grid reach together.
    """
    case = make_case(*read_case(part), Request(part, POST))
    spots = list_spots(case, None)
    names = np.array(list(case.paths))
    rows = []
    for number, resting_pose in enumerate(case.resting_poses):
        own_spots = [spot for spot in spots if spot.resting_pose == number]
        for start in range(0, len(own_spots), 20):
            batch = own_spots[start : start + 20]
            rows.append(reach_joints(case, batch, resting_pose.samples).shares > 1 - 1e-9)
    is_reached = np.concatenate(rows)
    counts = is_reached.sum(axis=1)
    weights = is_reached.astype(np.float64)
    together = counts[:, None] + counts - weights @ weights.T
    return set(names[is_reached.any(axis=0)].tolist()), round(float(together.max()))


def measure(name: str, part: camgen.Part) -> Iterator[Cells]:
    """The row of a part."""
    edges = [edge for edge in part.solid.edges if edge.convex]
    result, seconds = timed(partial(search, part))
    cells: list[object] = [len(edges), sum(edge.length for edge in edges)]
    for trials in ([result.as_given], [result.best[0]], result.set_ups):
        worked = measure_worked(result.case.edges, trials)
        cells += [len(worked), sum(worked.values())]
    in_reach, by_two = find_in_reach(part)
    left = in_reach - measure_worked(result.case.edges, result.set_ups).keys()
    is_met = len(in_reach) - len(left) >= by_two
    yield name, *cells, len(in_reach), len(left), by_two, verdict(is_met), seconds


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        parts = list_parts(Path(folder), sys.argv[1:])
        sys.exit(run(Scenario(COLUMNS, parts, measure)))
