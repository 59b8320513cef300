"""Cycle times of single shapes: by length over speed, by camgen, and by LinuxCNC's own planner.

    python -m bench.robots.cycle [planned]

LinuxCNC runs each shape in its simulator, in real time, as `bench.controllers.linuxcnc` does, about
two minutes in all. With `planned`, or where it is not installed, its columns are empty.
"""

from __future__ import annotations

import re
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from bench.controllers.linuxcnc import Planned, copy_runner, find_lack, run_program
from bench.support.runner import Cells, Scenario, run
from camgen.check.report import sum_up
from camgen.check.time import time_motions
from camgen.model.pose import TOOL_DOWN, Pose, translation
from camgen.model.program import MoveC, MoveJ, MoveL, Program
from camgen.post.plugins import find_post, make_post

COLUMNS = (
    "program | length over speed, s {:.3f} | camgen, s {:.3f} | LinuxCNC, s {:.3f} "
    "| apart {:+.2f} %"
)


def place(x: float, y: float) -> Pose:
    """The pose of the tool at a place of the plane, mm."""
    return Pose(TOOL_DOWN, (float(x), float(y), 0.0))


def make_program(*moves: MoveL | MoveC) -> Program:
    """A program that starts at the origin."""
    frame = translation(0, 0, 0)
    return Program("p", frame, frame, (MoveJ(place(0, 0), 100.0), *moves))


def make_polyline(points: np.ndarray, speed: float) -> Program:
    """Lines through points (N, 2), the first one the origin, with blends of 1 mm."""
    lines = [MoveL(place(x, y), speed, 1.0) for x, y in points[1:-1]]
    return make_program(*lines, MoveL(place(*points[-1]), speed))


def make_wave(count: int) -> Program:
    """A wave through `count` points."""
    share = np.linspace(0, 1, count)
    return make_polyline(np.column_stack([60 * share, 10 * np.sin(12 * share)]), 40.0)


def make_circle(radius: float) -> Program:
    """A circle of two arcs."""
    first = MoveC(place(radius, radius), place(2 * radius, 0), 50.0, 1.0)
    return make_program(first, MoveC(place(radius, -radius), place(0, 0), 50.0))


def list_shapes() -> dict[str, Program]:
    """The programs by their names."""
    zigzag = np.array([(2 * k, 3 * (k % 2)) for k in range(40)])
    square = np.array([(0, 0), (20, 0), (20, 20), (0, 20), (0, 0)])
    return {
        "line 50 mm, 20 mm/s": make_program(MoveL(place(50, 0), 20.0)),
        "square 20 mm, 50 mm/s": make_polyline(square, 50.0),
        "circle R 10, 50 mm/s": make_circle(10.0),
        "circle R 1, 50 mm/s": make_circle(1.0),
        "zigzag, 40 mm/s": make_polyline(zigzag, 40.0),
        "wave, 59 lines, 40 mm/s": make_wave(60),
        "wave, 799 lines, 40 mm/s": make_wave(800),
    }


def measure(name: str, program: Program, runner: Path | None) -> Iterator[Cells]:
    """The row of a shape. runner: the script that runs LinuxCNC, None without it."""
    post = make_post(find_post("gcode"), {})
    prepared = post.prepare(program, 0.01)
    naive = sum_up(prepared.columns).seconds
    planned = float(time_motions(prepared, post.dynamics(), None, None).sum())
    executed = None
    if runner:
        text = make_post(find_post("gcode"), {}).render(prepared)[0].text
        executed = run_program(re.sub(r"\W+", "-", name), Planned(text, planned), runner, 1.0)
    if executed is None:
        yield name, naive, planned, "not executed" if runner else None
    else:
        yield name, naive, planned, executed.seconds, 100 * (planned / executed.seconds - 1)


def main(is_planned: bool) -> int:
    """Prints the table."""
    lack = "only planned" if is_planned else find_lack()
    with tempfile.TemporaryDirectory() as temporary:
        # LinuxCNC runs as another user than root.
        Path(temporary).chmod(0o755)
        runner = None if lack else copy_runner(Path(temporary) / "runner")
        inputs = [(*shape, runner) for shape in list_shapes().items()]
        return run(Scenario(COLUMNS, inputs, measure), note=f"; {lack}" if lack else "")


if __name__ == "__main__":
    sys.exit(main("planned" in sys.argv[1:]))
