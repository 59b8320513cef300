"""Cycle times: length over speed beside acceleration, corners and joints; and LinuxCNC's own planner as the judge.

`python -m bench.robots.cycle [FILE ...] [--lines N ...]`: fixtures, the files, and programs of N lines (50,000 and
500,000). With `linuxcnc` as the file: programs
run by LinuxCNC in its simulator, in real time, about two minutes, as by `bench.controllers.linuxcnc`.
"""

from __future__ import annotations

import argparse
import tempfile
from functools import partial
from pathlib import Path

import numpy as np

import camgen
from bench.controllers.linuxcnc import Planned, copy_runner, find_lack, run_program
from bench.support.runner import ROOT, Table, open_table
from bench.support.timing import median_seconds
from camgen.check.report import sum_up
from camgen.check.time import compute_cycle, time_motions
from camgen.model.pose import TOOL_DOWN, Pose, translation
from camgen.post.plugins import find_post, make_post

JOBS: dict[str, tuple[str, dict[str, object]]] = {
    "bracket.dxf": ("parts/bracket.dxf", {}),
    "bracket.dxf, 100 mm/s": ("parts/bracket.dxf", {"process": {"feed": 100.0, "travel": 500.0}}),
    "bracket.dxf, IRB 120": ("parts/bracket.dxf", {"cell": {"robot": "IRB 120"}}),
    "rfa1.stl": ("parts/rfa1.stl", {}),
}


def at(x: float, y: float, z: float = 0.0) -> Pose:
    return Pose(TOOL_DOWN, (float(x), float(y), float(z)))


def program(*moves: camgen.MoveL | camgen.MoveC) -> camgen.Program:
    frame = translation(0, 0, 0)
    return camgen.Program("p", frame, frame, (camgen.MoveJ(at(0, 0), 100.0), *moves))


def polyline(points: np.ndarray, speed: float) -> camgen.Program:
    last = len(points) - 1
    return program(
        *(
            camgen.MoveL(at(x, y), speed, 1.0 if k < last else 0.0)
            for k, (x, y) in enumerate(points[1:], 1)
        )
    )


def wave(count: int, length: float = 60.0) -> np.ndarray:
    t = np.linspace(0, 1, count)
    return np.column_stack([length * t, 10 * np.sin(0.2 * length * t)])


def cases() -> dict[str, camgen.Program]:
    zigzag = np.array([(2 * k, 3 * (k % 2)) for k in range(40)], float)
    square = np.array([(0, 0), (20, 0), (20, 20), (0, 20), (0, 0)], float)
    circle = (
        camgen.MoveC(at(10, 10), at(20, 0), 50.0, 1.0),
        camgen.MoveC(at(10, -10), at(0, 0), 50.0),
    )
    small = (camgen.MoveC(at(1, 1), at(2, 0), 50.0, 1.0), camgen.MoveC(at(1, -1), at(0, 0), 50.0))
    return {
        "line 50 mm, 20 mm/s": program(camgen.MoveL(at(50, 0), 20.0)),
        "square 20 mm, 50 mm/s": polyline(square, 50.0),
        "circle R 10, 50 mm/s": program(*circle),
        "circle R 1, 50 mm/s": program(*small),
        "zigzag, 40 mm/s": polyline(zigzag, 40.0),
        "wave, 59 lines, 40 mm/s": polyline(wave(60), 40.0),
        "wave, 799 lines, 40 mm/s": polyline(wave(800), 40.0),
    }


def main() -> None:
    arguments = argparse.ArgumentParser()
    arguments.add_argument("files", nargs="*")
    arguments.add_argument("--lines", nargs="*", type=int, default=(50_000, 500_000))
    given = arguments.parse_args()
    if "linuxcnc" in given.files:
        judge_by_linuxcnc()
        return
    table = open_table(
        "input | post | length over speed, s {:.1f} | time, s {:.1f} | travel, s {:.1f}"
    )
    more: dict[str, tuple[str, dict[str, object]]] = {
        Path(file).name: (str(Path(file).resolve()), {}) for file in given.files
    }
    for name, (file, job) in (JOBS | more).items():
        for post in ("rapid", "vplus", "gcode", "grbl"):
            if post != "rapid" and ("rfa" in file or "cell" in job):
                continue
            found = camgen.build(ROOT / "fixtures" / file, post=post, job=job)
            times = found.motions.seconds, found.cycle.total, found.cycle.travel
            table.add(name, post, *times)
    table = Table("lines {:,} | post | timed in, s {:.2f}")
    for count in given.lines:
        one = polyline(wave(count + 1, count / 10), 40.0)
        one.columns.ends, one.columns.speed, one.columns.blend  # noqa: B018 (read before the clock starts)
        for post in ("rapid", "gcode"):
            pace = make_post(find_post(post), {}).dynamics()
            table.add(count, post, median_seconds(partial(compute_cycle, one, pace), 3))


def judge_by_linuxcnc() -> None:
    """The programs of `cases` in LinuxCNC's simulator and here."""
    lack = find_lack()
    if lack:
        print(f"skipped: {lack}")
        return
    post = make_post(find_post("gcode"), {})
    table = open_table(
        "program | length over speed, s {:.3f} | camgen, s {:.3f} | LinuxCNC, s {:.3f} "
        "| apart {:+.2f} %"
    )
    with tempfile.TemporaryDirectory() as temporary:
        # LinuxCNC runs as another user than root.
        Path(temporary).chmod(0o755)
        runner = copy_runner(Path(temporary) / "runner")
        for number, (name, case) in enumerate(cases().items()):
            prepared = post.prepare(case, 0.01)
            ours = float(time_motions(prepared, post.dynamics(), None, None)[0].sum())
            text = make_post(find_post("gcode"), {}).render(prepared)[0].text
            run = run_program(f"program{number}", Planned(text, ours), runner, 1.0)
            naive = sum_up(prepared.columns).seconds
            if run is None:
                table.add(name, naive, ours, "not executed")
            else:
                table.add(name, naive, ours, run.seconds, 100 * (ours / run.seconds - 1))


if __name__ == "__main__":
    main()
