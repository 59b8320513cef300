"""Processor seconds of the proofs of a build: of its motion, of its stock, and of its set-up.

    python -m bench.check.proof [RUNS, 3] [SHAPES ...]    default: 251 5001 100001 shapes

The drawings are plates with an outline, round holes and slots, four holes for each slot. They are
cut at once, and up to 5,001 shapes also 10 mm deep in four passes, in aluminium. Without SHAPES the
motor plate follows. All is measured within the same builds, in processor seconds, which other work
on the machine does not count in. As in `camgen build`, Python does not search for cyclic garbage
meanwhile. The exit code is 1 if a goal is missed: the proof of motion in 5 % of the build, the
stock proof in the time of the build without it, the checks of the set-up in 3 %.
"""

from __future__ import annotations

import statistics
import sys
import tempfile
import tomllib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from importlib import import_module
from pathlib import Path
from time import process_time
from typing import Any
from unittest.mock import patch

import camgen
from bench.speed.processes import draw
from bench.support.runner import PARTS, ROOT, Cells, Scenario, read_words, run, verdict
from camgen.pipeline.memory import pause_collector

COLUMNS = (
    "part | post | build s {:.3f} | proof of motion s {:.3f} | % {:.2f} | stock proof s {:.3f} "
    "| times the rest {:.2f} | set-up s {:.4f} | % of the build {:.2f} | deepest gouge mm {:.4f} "
    "| excess mm3 {:.2f} | goal"
)
#: Functions of the stages of a build. The set-up is limits, spindle and digest.
STAGES = (
    ("motion", "camgen.pipeline", "prove_motion"),
    ("stock", "camgen.pipeline", "prove_stock"),
    ("set-up", "camgen.check.stock", "check_set_up"),
    ("set-up", "camgen.check.stock", "follow_spindles"),
    ("set-up", "camgen.check.stock", "check_spindles"),
    ("set-up", "camgen.pipeline.programs", "sign"),
)
#: Goals: % of the build, times the rest of the build, and % of the build.
GOALS = (5.0, 1.0, 3.0)
SHAPES = (251, 5_001, 100_001)
#: Most shapes that are cut in passes.
MOST_PASSES = 10_000
PASSES = {
    "operation": {"depth": 10.0, "passes": 4},
    "process": {"spindle": 10_000.0},
    "stock": {"thickness": 10.0, "material": "aluminium", "held": "tape"},
}
Job = Mapping[str, Any]


def time_build(part: Path, post: str, job: Job) -> tuple[Counter[str], camgen.Result]:
    """Processor seconds of a build and of its stages, and its result."""
    spent: Counter[str] = Counter()

    def timed(stage: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any) -> Any:
            began = process_time()
            result = function(*arguments)
            spent[stage] += process_time() - began
            return result

        return call

    with ExitStack() as patches, pause_collector():
        for stage, module, name in STAGES:
            place = import_module(module)
            function = timed(stage, getattr(place, name))
            patches.enter_context(patch.object(place, name, function))
        began = process_time()
        result = camgen.build(part, post=post, job=job)
        spent["build"] = process_time() - began
    return spent, result


def measure(name: str, part: Path, post: str, job: Job, runs: int) -> Iterator[Cells]:
    """The row of a build."""
    times, results = zip(*(time_build(part, post, job) for _ in range(runs)), strict=True)
    medians = []
    for stage in ("build", "motion", "stock", "set-up"):
        medians.append(statistics.median(spent[stage] for spent in times))
    build, motion, stock, set_up = medians
    shares = 100 * motion / build, stock / (build - stock), 100 * set_up / build
    goal = verdict(all(share <= bound for share, bound in zip(shares, GOALS, strict=True)))
    seconds = motion, shares[0], stock, shares[1], set_up, shares[2]
    gouge = excess = None
    if (proof := results[0].proof) is not None:
        gouge, excess = max((fault.mm for fault in proof.gouges), default=0.0), proof.excess
    yield name, post, build, *seconds, gouge, excess, goal


def list_builds(sizes: list[int], folder: Path) -> Iterator[tuple[str, Path, str, Job]]:
    """Name, part, post and job of each build. sizes: shapes of the plates; empty for all."""
    for count in sizes or SHAPES:
        plate, slots = folder / f"{count}.dxf", (count - 1) // 5
        draw(str(plate), count - 1 - slots, slots)
        yield f"{count:,} shapes", plate, "gcode", {}
        yield f"{count:,} shapes", plate, "rapid", {}
        if count < MOST_PASSES:
            yield f"{count:,} shapes, four passes", plate, "gcode", PASSES
    if not sizes:
        motor = tomllib.loads((ROOT / "fixtures/cases/motor-plate/job.toml").read_text())
        motor["stock"]["material"] = "aluminium"
        yield "motor plate", PARTS / "motor.dxf", "gcode", motor


def main(runs: int, *words: str) -> int:
    """Prints the table."""
    with tempfile.TemporaryDirectory() as folder:
        builds = list_builds(list(map(int, words)), Path(folder))
        inputs = ((*build, runs) for build in builds)
        return run(Scenario(COLUMNS, inputs, measure, may_refuse=True))


if __name__ == "__main__":
    sys.exit(main(*read_words(3)))
