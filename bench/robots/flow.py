"""Links as fast as the joints allow, with blends and a margin, in the twelve builds of the RFA cells.

    python -m bench.robots.flow [PART] [ROBOT]

Two parts, three arms, the nominal tool and one that may lean and roll. Before: no margin, links at 100 mm/s and a stop
at every corner. After: links as fast as the joints allow, 2 mm of margin. Stops are those left at the corners of
links, and between the rows of edges. Time is that of the program by the model of docs/cycle-time.md; least distance
that of all but the tool and the part, told up to 2 mm. Exits with 1 where an edge is lost.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping

import numpy as np
from msgspec.structs import replace

import camgen
from bench.robots.rfa import FREE, RAISED, cell
from bench.support.runner import PARTS, open_table
from bench.support.timing import timed
from camgen.check.passing import find_corners
from camgen.check.time import compute_cycle
from camgen.model.text import short
from camgen.read.files import Files
from camgen.read.solid import mesh

ARMS = ("IRB 2000", "IRB 2400", "IRB 1200")
#: Links as fast as the joints allow. Without it no point of the arm is faster than 250 mm/s.
AFTER = {"process": {"travel": 5000.0}}
BEFORE = {"process": {"travel": 100.0}, "cell": {"margin": 0.0}}


def build(
    part: str, name: str, free: bool, more: Mapping[str, Mapping[str, float]]
) -> tuple[camgen.Result, float]:
    """The build with some settings more, and its seconds."""
    path = PARTS / f"{part}.stl"
    job = cell(mesh.read(Files().read(path)), name)
    tables = {**more, "tool": FREE if free else {}}
    own = {key: {**job.get(key, {}), **tables.get(key, {})} for key in {*job, *tables}}
    return timed(lambda: camgen.build(path, post="rapid", job=own))


def stopped(result: camgen.Result) -> float:
    """Seconds of the program with a stop at the end of every motion."""
    moves = (camgen.MoveJ, camgen.MoveL, camgen.MoveC)
    body = tuple(
        replace(one, blend=0.0) if isinstance(one, moves) else one for one in result.program.body
    )
    return compute_cycle(
        result.program.with_body(body), result.cell.pace, result.reach, result.cell.arm
    ).total


def between_rows(result: camgen.Result) -> str:
    """How many rows of edges end in a stop before the next one, and of how many."""
    columns, corners = result.program.columns, find_corners(result.program)
    inner = corners[
        columns.works[corners] & columns.works[np.minimum(corners + 1, len(columns.works) - 1)]
    ]
    return f"{int((columns.blend[inner] == 0).sum())} of {len(inner)}"


def least(result: camgen.Result) -> str:
    assert result.clear is not None
    return "2 or more" if result.clear.nearest is None else short(result.clear.clearance, 2)


def main(arguments: list[str]) -> int:
    parts, names = arguments[:1] or RAISED, arguments[1:2] or ARMS
    table = open_table(
        "part | robot | tool | edges {}, {} | program, s {:.1f}, {:.1f} | less {:.0f} % "
        "| without blends, s {:.1f} | stops left {} of {} | between rows | least distance {}, {} "
        "| build, s {:.1f}, {:.1f}"
    )
    lost, sums = False, [0.0, 0.0]
    for part, name, free in (
        (part, name, free) for part in parts for name in names for free in (False, True)
    ):
        (old, slow), (new, fast) = build(part, name, free, BEFORE), build(part, name, free, AFTER)
        seconds = stopped(old), new.cycle.total
        sums = [a + b for a, b in zip(sums, seconds, strict=True)]
        counts = len(old.tour.paths), len(new.tour.paths)
        (passed,) = [note.what.split() for note in new.notes if "without a stop" in note.what]
        stops = int(passed[2]) - int(passed[0]), passed[2]
        less = 100 * (1 - seconds[1] / seconds[0])
        corners = stopped(new), stops, between_rows(new)
        tool = "freed" if free else "nominal"
        distances, builds = (least(old), least(new)), (slow, fast)
        table.add(part, name, tool, counts, seconds, less, *corners, distances, builds)
        lost |= counts[1] < counts[0]
    print(
        f"\nAll: {sums[0]:.0f} s before, {sums[1]:.0f} s after, {100 * (1 - sums[1] / sums[0]):.0f} % less."
    )
    return int(lost)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
