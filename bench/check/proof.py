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
import subprocess
import sys
import tempfile
from pathlib import Path
from time import process_time

import camgen
from bench.machine import machine

POSTS = ("gcode", "rapid")


def measure(drawing: Path, post: str) -> tuple[float, float]:
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
        with memory.no_collector():
            camgen.build(drawing, post=post)
        return spent[0], process_time() - began
    finally:
        build.prove_motion = prove


def main(shapes: list[int], runs: int) -> None:
    """Prints a row for each drawing and post."""
    print(machine())
    print("\n| shapes | post | proof s | build s | share % |\n|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for count in shapes:
            drawing = Path(folder, f"{count}.dxf")
            slots = (count - 1) // 5
            words = ["draw", str(drawing), str(count - 1 - slots), str(slots)]
            subprocess.run([sys.executable, "-m", "bench.speed.processes", *words], check=True)
            for post in POSTS:
                try:
                    pairs = [measure(drawing, post) for _ in range(runs)]
                except camgen.CamgenError as error:
                    print(f"| {count} | {post} | refused: {str(error).partition(';')[0]} | | |")
                    continue
                proof = statistics.median(pair[0] for pair in pairs)
                build = statistics.median(pair[1] for pair in pairs)
                share = 100 * proof / build
                print(f"| {count} | {post} | {proof:.3f} | {build:.2f} | {share:.1f} |", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("shapes", nargs="*", type=int, default=[251, 5001, 100001])
    parser.add_argument("--runs", type=int, default=3)
    options = parser.parse_args()
    main(options.shapes, options.runs)
