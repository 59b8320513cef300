"""Processor seconds of the proof of motion, beside those of the build that it belongs to.

    python -m bench.check.proof [SHAPES ...] [--runs N]    default: 251 5001 100001 shapes, 3 runs

The drawing is a plate with an outline, round holes and slots, four holes for each slot. Proof and
build are measured in the same run, in processor seconds, which other work on the machine does not
count in. Both run as in `camgen build`: Python does not search for cyclic garbage meanwhile.
"""

from __future__ import annotations

import argparse
import importlib
import statistics
import sys
import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from time import process_time

import camgen
from bench.support.runner import Cells, Scenario, run
from bench.support.timing import measure_process, python

POSTS = ("gcode", "rapid")
COLUMNS = "shapes | post | proof s {:.3f} | build s {:.2f} | share % {:.1f}"


def time_proof(drawing: Path, post: str) -> tuple[float, float]:
    """Processor seconds of the proof and of the whole build."""
    build = importlib.import_module("camgen.pipeline")
    memory = importlib.import_module("camgen.pipeline.memory")
    prove, spent = build.prove_motion, []

    def timed(*given: object) -> object:
        began = process_time()
        result = prove(*given)
        spent.append(process_time() - began)
        return result

    build.prove_motion = timed
    try:
        began = process_time()
        with memory.pause_collector():
            camgen.build(drawing, post=post)
        return spent[0], process_time() - began
    finally:
        build.prove_motion = prove


def measure(count: int, runs: int) -> Iterator[Cells]:
    """A row for each post, for a drawing of `count` shapes."""
    with tempfile.TemporaryDirectory() as folder:
        drawing = Path(folder, "plate.dxf")
        slots = (count - 1) // 5
        measure_process(python("bench.speed.processes", "draw", drawing, count - 1 - slots, slots))
        for post in POSTS:
            try:
                pairs = [time_proof(drawing, post) for _ in range(runs)]
            except camgen.CamgenError as error:
                yield count, post, f"refused: {str(error).partition(';')[0]}"
                continue
            proof, build = (statistics.median(column) for column in zip(*pairs, strict=True))
            yield count, post, proof, build, 100 * proof / build


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("shapes", nargs="*", type=int, default=[251, 5001, 100001])
    parser.add_argument("--runs", type=int, default=3)
    options = parser.parse_args()
    shapes = [(count,) for count in options.shapes]
    sys.exit(run(Scenario(COLUMNS, shapes, partial(measure, runs=options.runs))))
