"""LinuxCNC's own planner runs the golden programs: seconds, and distance from the programmed path.

    python -m bench.controllers.linuxcnc [PROGRAM ...] [--hurry N] [--planned]

Programs are the golden ones of `--post gcode` as their jobs are, the same at 100 mm/s, and what
`camgen build` makes of two files with arcs that end in lines. They are run whole, none is left out
or cut short. Names choose programs, `fast` is the word for 100 mm/s: `logo-trace`,
`logo-trace-fast`. The name `shapes` adds single shapes, which have no goal. LinuxCNC runs headless
in its simulator with 500 mm/s2 and 100 mm/s on each axis, its clocks `--hurry` times as fast as
real ones (5). A program without a result is run once more. `--planned` leaves out LinuxCNC.

It needs Debian's package linuxcnc-uspace, a C compiler, and shared/controllers beside the
repository. Where one is missing, the bench says so and ends with 0. Do not run `rs274` beside it.
Exits with 1 if a path is left by more than P and 1 um, or a time is more than 3 % off.
"""

from __future__ import annotations

import argparse
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import camgen
from bench.controllers.executed_path import Samples, measure_distance, measure_seconds, read_samples
from bench.controllers.programmed_path import ProgrammedPath, read_path
from bench.controllers.shapes import list_shapes
from bench.support.runner import ROOT, Missed, open_table, verdict
from camgen.check.time import time_motions
from camgen.model.program import Program
from camgen.post.plugins import find_post, make_post
from tests.test_cases import FLAT, LEANING, parts

CONTROLLERS = ROOT.parent / "shared" / "controllers"
PYTHON = "/usr/bin/python3"
#: mm/s: the speed of the fast programs, which is that of the simulated axes.
FAST = 100.0
#: mm, and share: goals beyond P, and for the time.
MOST_BEYOND, MOST_APART = 0.001, 0.03
#: s after which LinuxCNC's task runs, if it starts at all.
_START = 15.0
COLUMNS = (
    "program | predicted, s {:.3f} | executed, s {:.3f} | apart {:+.1f} % | off, um {:.1f} "
    "| P, um {:.0f} | dwell, s {:.1f} | line | goal"
)


class Planned(NamedTuple):
    """A program that LinuxCNC is to run.

    text: its lines.
    seconds: time that camgen predicts.
    has_goal: whether it has to meet the goals.
    """

    text: str
    seconds: float
    has_goal: bool = True


def build_case(case: Path, *, is_fast: bool) -> Planned:
    """The golden program of a case, or the program of its job at 100 mm/s."""
    job = tomllib.loads((case / "job.toml").read_text())
    options = case / "posts.toml"
    if options.exists():
        job["post"] = tomllib.loads(options.read_text()).get("gcode", {})
    if is_fast:
        speeds = [job.setdefault("process", {}), *job.get("tools", ())]
        for speed in speeds:
            speed["feed"] = FAST
    part = next(part for part in parts(case) if part.exists())
    return plan(part, job)


def plan(source: Path, job: dict[str, object]) -> Planned:
    result = camgen.build(source, post="gcode", job=job, name="part")
    return Planned(result.text, result.cycle.total)


def plan_shape(program: Program) -> Planned:
    post = make_post(find_post("gcode"), {})
    prepared = post.prepare(program, 0.01)
    seconds = float(time_motions(prepared, post.dynamics(), None, None).sum())
    text = make_post(find_post("gcode"), {}).render(prepared)[0].text
    return Planned(text, seconds, has_goal=False)


def list_programs(names: list[str]) -> dict[str, Planned]:
    """The programs by name, or those of `names`."""
    planned = {}
    for case in FLAT:
        for name, is_fast in ((case.name, False), (f"{case.name}-fast", True)):
            if case not in LEANING and (not names or name in names):
                planned[name] = build_case(case, is_fast=is_fast)
    for source in sorted((CONTROLLERS / "linuxcnc").glob("arc*.ngc")):
        if not names or source.stem in names:
            planned[source.stem] = plan(source, {})
    if "shapes" in names:
        for name, shape in list_shapes().items():
            planned[name] = plan_shape(shape)
    return planned


def find_lack() -> str:
    """The reason why LinuxCNC cannot be run here, empty without one."""
    for program in ("linuxcnc", "cc"):
        if not shutil.which(program):
            return f"{program} is not installed"
    if not CONTROLLERS.is_dir():
        return "shared/controllers is not beside the repository"
    return ""


def copy_runner(folder: Path) -> Path:
    """The script that runs LinuxCNC, with the library for its clocks, in a folder of its own."""
    shutil.copytree(CONTROLLERS / "linuxcnc", folder)
    library = ["cc", "-shared", "-fPIC", "-o", "hurry.so", "hurry.c", "-ldl"]
    subprocess.run(library, cwd=folder, check=True)
    return folder / "run_linuxcnc.py"


def execute(runner: Path, text: Path, seconds: float, hurry: float) -> Path | None:
    """Runs a program in LinuxCNC. The folder of its samples, None if it failed twice.

    LinuxCNC does not always start, and its task process ends now and then.
    """
    environment = {name: value for name, value in os.environ.items() if name != "HURRY"}
    if hurry > 1:
        environment["HURRY"] = f"{hurry:g}"
    for attempt in ("first", "second"):
        folder = text.parent / f"{text.stem}-{attempt}"
        command = [PYTHON, str(runner), str(folder), f"{text}={seconds / hurry:.3f}"]
        # Its own judge ends with a traceback without scipy. The samples are written before.
        log = (text.parent / f"{folder.name}.log").open("wb")
        process = subprocess.Popen(command, env=environment, stdout=log, stderr=log)
        began = time.monotonic()
        while process.poll() is None:
            time.sleep(1)
            if time.monotonic() - began > _START and not find_processes("milltask", folder):
                # Its screen would wait for the task for a long time. LinuxCNC ends with it.
                for number in find_processes("screen.py", folder):
                    os.kill(number, signal.SIGTERM)
        log.close()
        if (folder / f"{text.stem}.run.json").exists():
            return folder
    return None


def find_processes(name: str, folder: Path) -> list[int]:
    """Numbers of the processes whose command has a name, and a path in a folder."""
    numbers = []
    for file in Path("/proc").glob("[0-9]*/cmdline"):
        with suppress(OSError):
            command = file.read_bytes().decode(errors="replace")
            if name in command and f"{folder}/" in command:
                numbers.append(int(file.parent.name))
    return numbers


def main() -> int:
    arguments = argparse.ArgumentParser()
    arguments.add_argument("programs", nargs="*")
    arguments.add_argument("--hurry", type=float, default=5.0)
    arguments.add_argument("--planned", action="store_true")
    given = arguments.parse_args()
    lack = "" if given.planned else find_lack()
    if lack:
        print(f"skipped: {lack}")
        return 0
    planned = list_programs(given.programs)
    table = open_table(COLUMNS)
    if given.planned:
        for name, program in planned.items():
            table.add(name, program.seconds)
        return 0
    with tempfile.TemporaryDirectory() as temporary:
        # LinuxCNC runs as another user than root.
        Path(temporary).chmod(0o755)
        runner = copy_runner(Path(temporary) / "runner")
        for name, program in planned.items():
            table.add(name, *compare(program, run_program(name, program, runner, given.hurry)))
    return int(table.missed > 0)


class Run(NamedTuple):
    """A program that was executed.

    path: the programmed path.
    samples: the executed one.
    seconds: time from home to the last motion.
    """

    path: ProgrammedPath
    samples: Samples
    seconds: float


def run_program(name: str, program: Planned, runner: Path, hurry: float) -> Run | None:
    """Runs a program in LinuxCNC, see `execute`."""
    text = runner.parent.parent / f"{name}.ngc"
    text.write_text(program.text)
    folder = execute(runner, text, program.seconds, hurry)
    if folder is None:
        return None
    path = read_path(program.text, folder)
    samples = read_samples(folder / f"{name}.txt")
    # Waits are timed by a clock that is not hurried.
    return Run(path, samples, measure_seconds(samples, path) - (hurry - 1) * path.dwell)


def compare(program: Planned, run: Run | None) -> tuple[object, ...]:
    """The cells of a program after its name. run: None if it was not executed."""
    if run is None:
        return program.seconds, Missed("not executed")
    path = run.path
    distance, line = measure_distance(run.samples, path)
    excess = program.seconds / run.seconds - 1
    is_met = distance <= path.tolerance + MOST_BEYOND and abs(excess) <= MOST_APART
    goal = verdict(is_met) if program.has_goal else ""
    micrometres = 1e3 * distance, 1e3 * path.tolerance
    times = program.seconds, run.seconds, 100 * excess
    return (*times, *micrometres, path.dwell, str(line), goal)


if __name__ == "__main__":
    sys.exit(main())
