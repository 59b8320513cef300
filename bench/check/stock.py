"""Seconds of the stock proof and of the checks of the set-up beside those of the build.

python -m bench.check.stock [RUNS, 5] [CIRCLES, 200] [SLOTS, 50]
"""

from __future__ import annotations

import statistics
import sys
import tempfile
import time
import tomllib
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any
from unittest.mock import patch

import camgen
import camgen.pipeline
from bench.speed.processes import draw
from bench.support.runner import PARTS, ROOT, Table, open_table, read_words, verdict
from camgen.check.stock import Cut, Task, design, prove
from camgen.model.job import StockTable
from camgen.post.plugins import fill_tables, find_readback

DEPTH = 10.0
#: Goal for the checks of the set-up, % of the build.
MOST_SHARE = 3.0
JOB = {"operation": {"depth": DEPTH, "passes": 4}, "process": {"spindle": 10_000.0}}
#: Functions of the checks of the set-up: limits, spindle and digest.
SET_UP = (
    ("camgen.check.stock", "check_set_up"),
    ("camgen.check.stock", "follow_spindles"),
    ("camgen.check.stock", "check_spindles"),
    ("camgen.pipeline.programs", "sign"),
)


def measure(drawing: str) -> tuple[dict[str, float], int, float, float]:
    """Seconds of the stages, motions, the deepest gouge (mm) and the excess (mm3)."""
    begun = time.perf_counter()
    # The build without its own proof.
    with patch.object(sys.modules["camgen.pipeline"], "prove_stock", lambda *_: None):
        result = camgen.build(drawing, post="gcode", job=JOB)
    built = time.perf_counter()
    texts = {file.name: file.text for file in result.files}
    reading = find_readback("gcode")(texts, fill_tables(type(result.post), result.job.post))
    read = time.perf_counter()
    wanted = design([Task(result.job, result.part)], StockTable(thickness=DEPTH))
    designed = time.perf_counter()
    proof = prove([Cut(reading.body, reading.lines, result.job.tool)], wanted)
    proven = time.perf_counter()
    seconds = {"build": built - begun, "design": designed - read, "proof": proven - designed}
    gouge = max((fault.mm for fault in proof.gouges), default=0.0)
    return seconds, len(reading.body), gouge, proof.excess


def measure_set_up(part: str, job: Mapping[str, Any]) -> tuple[float, float]:
    """Seconds of a build, and of the checks of the set-up in it."""
    spent: list[float] = []

    def timed(function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any) -> Any:
            begun = time.perf_counter()
            result = function(*arguments)
            spent.append(time.perf_counter() - begun)
            return result

        return call

    with ExitStack() as patches:
        for module, name in SET_UP:
            function = getattr(sys.modules[module], name)
            patches.enter_context(patch.object(sys.modules[module], name, timed(function)))
        begun = time.perf_counter()
        camgen.build(part, post="gcode", job=job)
        return time.perf_counter() - begun, sum(spent)


def main(runs: int, circles: int, slots: int) -> None:
    """Prints the stages of a build, the figures of its proof, and the checks of the set-up."""
    plate = {**JOB, "stock": {"thickness": DEPTH, "material": "aluminium", "held": "tape"}}
    motor = tomllib.loads((ROOT / "fixtures/cases/motor-plate/job.toml").read_text())
    motor["stock"]["material"] = "aluminium"
    shapes = circles + slots + 1
    with tempfile.TemporaryDirectory() as folder:
        drawing = str(Path(folder) / "plate.dxf")
        draw(drawing, circles, slots)
        stages = [measure(drawing) for _ in range(runs)]
        builds = {
            f"{shapes} shapes": (drawing, plate),
            "motor plate": (str(PARTS / "motor.dxf"), motor),
        }
        times: dict[str, list[tuple[float, float]]] = {}
        for name, build in builds.items():
            times[name] = [measure_set_up(*build) for _ in range(runs)]
    table = open_table("stage | median s **{:.3f}** | range s {:.3f} to {:.3f}")
    for stage in stages[0][0]:
        values = [seconds[stage] for seconds, *_ in stages]
        table.add(stage, statistics.median(values), (min(values), max(values)))
    ratios = [(part["design"] + part["proof"]) / part["build"] for part, *_ in stages]
    _, count, gouge, excess = stages[0]
    table = Table(
        "shapes | instructions | proof of the build {:.2f} | deepest gouge mm {:.4f} "
        "| excess mm3 {:.2f}"
    )
    table.add(shapes, count, statistics.median(ratios), gouge, excess)
    table = Table("part | build s {:.3f} | checks of the set-up s {:.4f} | share % | ")
    for name, pairs in times.items():
        whole, checks = (statistics.median(values) for values in zip(*pairs, strict=True))
        share = statistics.median(100 * part / seconds for seconds, part in pairs)
        table.add(name, whole, checks, f"{share:.2f}", verdict(share < MOST_SHARE))


if __name__ == "__main__":
    main(*read_words(5, 200, 50))
