"""Seconds of the stock proof and of the checks of the set-up beside those of the build.

python -m bench.check.stock [RUNS, 5] [CIRCLES, 200] [SLOTS, 50] [--peer PYTHON]

With a peer, the interpreter of another state of camgen, the proof within a build is timed in turns
in processes of their own: the peer without clamps, this state without them, and this state with a
clamp on each corner of the drawing.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

import camgen
import camgen.pipeline
from bench.speed.processes import draw
from bench.support.runner import PARTS, ROOT, Table, open_table, verdict
from camgen.check.stock import Cut, Task, design, prove
from camgen.model.job import StockTable
from camgen.post.plugins import fill_tables, find_readback

DEPTH = 10.0
#: Goal for the checks of the set-up, % of the build.
MOST_SHARE = 3.0
#: Goal for the proof with clamps, times that of the peer.
MOST_TIMES = 1.5
#: Side of a clamp, part of the longer side of the drawing, and its lowest and highest z, mm. Its
#: middle stands on the corner of the drawing.
CLAMP_SIDE, CLAMP_BOTTOM, CLAMP_TOP = 0.1, -20.0, 15.0
JOB = {"operation": {"depth": DEPTH, "passes": 4}, "process": {"spindle": 10_000.0}}


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
    """Seconds of a build, and of the checks of the set-up in it: limits, spindle and digest."""
    module = sys.modules["camgen.check.stock"]
    programs = sys.modules["camgen.pipeline.programs"]
    spent: list[float] = []

    def timed(function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any) -> Any:
            begun = time.perf_counter()
            result = function(*arguments)
            spent.append(time.perf_counter() - begun)
            return result

        return call

    with ExitStack() as patches:
        for holder, name in (
            (module, "check_set_up"),
            (module, "follow_spindles"),
            (module, "check_spindles"),
            (programs, "sign"),
        ):
            patches.enter_context(patch.object(holder, name, timed(getattr(holder, name))))
        begun = time.perf_counter()
        camgen.build(part, post="gcode", job=job)
        return time.perf_counter() - begun, sum(spent)


#: Prints the seconds of the stock proof in a build of argv[1] with the job argv[2].
_TIME_PROOF = """
import json, sys, time
import camgen, camgen.pipeline
module = sys.modules["camgen.pipeline"]
prove, spent = module.prove_stock, []
def timed(*arguments):
    start = time.perf_counter()
    proof = prove(*arguments)
    spent.append(time.perf_counter() - start)
    return proof
module.prove_stock = timed
camgen.build(sys.argv[1], post="gcode", job=json.loads(sys.argv[2]))
print(sum(spent))
"""


def put_clamps(drawing: str, job: Mapping[str, Any]) -> dict[str, Any]:
    """The job with a clamp on each corner of the drawing."""
    points = np.concatenate([contour.points for contour in camgen.read(drawing).contours])
    low, high = points.min(axis=0), points.max(axis=0)
    half = CLAMP_SIDE * float((high - low).max()) / 2
    clamps = []
    for x in (low[0], high[0]):
        for y in (low[1], high[1]):
            clamps.append([x - half, y - half, CLAMP_BOTTOM, x + half, y + half, CLAMP_TOP])
    return {**job, "cell": {"fixtures": clamps}}


def without_held(job: Mapping[str, Any]) -> dict[str, Any]:
    """The job without `stock.held`, which the peer neither knows nor asks for."""
    stock = {key: value for key, value in job["stock"].items() if key != "held"}
    return {**job, "stock": stock}


def time_proof(python: str, drawing: str, job: Mapping[str, Any]) -> float:
    """Seconds of the stock proof in a build by an interpreter."""
    # With -P an interpreter does not import the camgen of the current folder.
    command = [python, "-P", "-c", _TIME_PROOF, drawing, json.dumps(job)]
    return float(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def compare_peer(builds: Mapping[str, tuple[str, Mapping[str, Any]]], runs: int, peer: str) -> None:
    """The proof of each build beside that of the peer, taken in turns."""
    table = Table("part | proof | median s **{:.3f}** | times the peer **{:.2f}** | ")
    for name, (drawing, job) in builds.items():
        kinds = {
            "peer": (peer, without_held(job)),
            "without clamps": (sys.executable, job),
            "with 4 clamps": (sys.executable, put_clamps(drawing, job)),
        }
        seconds: dict[str, list[float]] = {kind: [] for kind in kinds}
        for _ in range(runs):
            for kind, (python, settings) in kinds.items():
                seconds[kind].append(time_proof(python, drawing, settings))
        for kind, values in seconds.items():
            pairs = zip(values, seconds["peer"], strict=True)
            times = statistics.median(time / of_peer for time, of_peer in pairs)
            goal = None if kind == "peer" else verdict(times < MOST_TIMES)
            table.add(name, kind, statistics.median(values), times, goal)


def main(runs: int, circles: int, slots: int, peer: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        drawing = str(Path(folder) / "plate.dxf")
        draw(drawing, circles, slots)
        found = [measure(drawing) for _ in range(runs)]
        plate = {**JOB, "stock": {"thickness": DEPTH, "material": "aluminium", "held": "tape"}}
        motor = tomllib.loads((ROOT / "fixtures/cases/motor-plate/job.toml").read_text())
        motor["stock"]["material"] = "aluminium"
        builds = {
            f"{circles + slots + 1} shapes": (drawing, plate),
            "motor plate": (str(PARTS / "motor.dxf"), motor),
        }
        times: dict[str, list[tuple[float, float]]] = {}
        for name, build in builds.items():
            times[name] = [measure_set_up(*build) for _ in range(runs)]
        if peer:
            compare_peer(builds, runs, peer)
    table = open_table("stage | median s **{:.3f}** | range s {:.3f} to {:.3f}")
    for stage in found[0][0]:
        values = [seconds[stage] for seconds, *_ in found]
        table.add(stage, statistics.median(values), (min(values), max(values)))
    ratio = statistics.median((one["design"] + one["proof"]) / one["build"] for one, *_ in found)
    _, count, gouge, excess = found[0]
    table = Table(
        "shapes | instructions | proof of the build {:.2f} | deepest gouge mm {:.4f} "
        "| excess mm3 {:.2f}"
    )
    table.add(circles + slots + 1, count, ratio, gouge, excess)
    table = Table("part | build s {:.3f} | checks of the set-up s {:.4f} | share % | ")
    for name, pairs in times.items():
        whole, checks = (statistics.median(values) for values in zip(*pairs, strict=True))
        share = statistics.median(100 * part / seconds for seconds, part in pairs)
        table.add(name, whole, checks, f"{share:.2f}", verdict(share < MOST_SHARE))


if __name__ == "__main__":
    arguments = argparse.ArgumentParser()
    for word, value in (("runs", 5), ("circles", 200), ("slots", 50)):
        arguments.add_argument(word, nargs="?", type=int, default=value)
    arguments.add_argument("--peer", default="")
    given = arguments.parse_args()
    main(given.runs, given.circles, given.slots, given.peer)
