"""Time and memory of whole processes, from the command to the written program.

    python -m bench.speed.processes [CASE ...] [--runs N] [--peer PYTHON]

All cases, or those named: help, 251, 401, 5,001, 100,001, rfa1, rfa2. PYTHON is an interpreter with another state of
camgen, whose builds are measured in turns with ours.

This process imports nothing heavy: on Linux a child's peak memory counts what its parent held when it was started.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from bench.support.runner import PARTS, Table, open_table
from bench.support.timing import Process, measure_in_turns, measure_process, python

POSTS = ("gcode", "rapid")
PITCH = (36.0, 24.0)
#: An arm that reaches all of 401 shapes.
ARM = ("cell.robot=IRB 2400", "cell.base_from_work=[700, -360, 500, 0, 0, 0]")


@dataclass(frozen=True)
class Case:
    """A plate with so many round holes and slots. goal: s; 0: so many times what ezdxf needs to read the drawing.
    settings: of the job, where it has some.
    """

    circles: int
    slots: int
    goal: float
    runs: int
    posts: tuple[str, ...] = POSTS
    settings: tuple[str, ...] = ()


CASES = {
    "251 shapes": Case(circles=200, slots=50, goal=0.8, runs=7),
    "401 shapes at an IRB 2400": Case(
        circles=320, slots=80, goal=2.0, runs=7, posts=("rapid",), settings=ARM
    ),
    "5,001 shapes": Case(circles=4_000, slots=1_000, goal=3.0, runs=5),
    "100,001 entities": Case(circles=20_000, slots=20_000, goal=0.0, runs=3),
}
HELP_GOAL, HELP_RUNS = 0.12, 15
#: 3-D parts of ``fixtures/parts``, each with its job file; the goal in seconds of the processor.
SOLIDS, SOLID_GOAL, SOLID_RUNS = ("rfa1", "rfa2"), 0.7, 9
#: The goals of large drawings: times the processor seconds of ezdxf, and MB.
TIMES, MOST_MB = {"gcode": 2.0, "rapid": 2.5}, 400


def draw(file: str, circles: int, slots: int) -> None:
    """An outline around holes on a grid, mm: 10 to 20 in diameter, and slots 30 x 8 of two lines and two arcs each."""
    import ezdxf  # noqa: PLC0415  # only where this file is run to draw

    document = ezdxf.new("R2010", units=4)
    space = document.modelspace()
    count = circles + slots
    columns = max(1, round(count**0.5))
    every = count // slots
    drawn = 0
    for k in range(count):
        x, y = PITCH[0] * (k % columns), PITCH[1] * (k // columns)
        if k % every == every - 1 and drawn < slots:
            drawn += 1
            # Not in the order of the loop, one line against it: the ends must be found by where they are.
            space.add_line((x - 11, y - 4), (x + 11, y - 4))
            space.add_line((x - 11, y + 4), (x + 11, y + 4))
            space.add_arc((x + 11, y), 4, -90, 90)
            space.add_arc((x - 11, y), 4, 90, 270)
        else:
            space.add_circle((x, y), 5 + k % 11 / 2)
    left, right = -PITCH[0], PITCH[0] * columns
    low, top = -PITCH[1], PITCH[1] * -(-count // columns)
    space.add_lwpolyline([(left, low), (right, low), (right, top), (left, top)], close=True)
    document.saveas(file)


def row(table: Table, name: str, runs: list[Process], goal: str) -> None:
    seconds = [run.seconds for run in runs]
    spent = statistics.median(run.processor for run in runs)
    span = min(seconds), max(seconds)
    peak = max(run.peak for run in runs)
    table.add(name, statistics.median(seconds), span, spent, peak, goal)


class Repeat(NamedTuple):
    """The way in which builds are repeated.

    runs: runs of each process; 0 for the number of the case.
    peer: interpreter with another state of camgen, "" for none.
    """

    runs: int
    peer: str


def list_builds(name: str, words: Sequence[object], peer: str) -> dict[str, list[str]]:
    """The commands of a build by the names of their rows."""
    command = python("camgen", "build", *words)
    builds = {name: command}
    if peer:
        # With -P the peer does not import the camgen of the current folder.
        builds[f"{name}, peer"] = [peer, "-P", *command[1:]]
    return builds


def bench(table: Table, folder: Path, name: str, case: Case, repeat: Repeat) -> None:
    """The rows of one drawing: reading alone, then each post, taken in turns."""
    drawing = str(folder / "plate.dxf")
    measure_process(python("bench.speed.processes", "draw", drawing, case.circles, case.slots))
    read = [sys.executable, "-c", f"import ezdxf; ezdxf.readfile({drawing!r})"]
    commands = {"ezdxf.readfile alone": read}
    settings = [word for one in case.settings for word in ("--set", one)]
    for post in case.posts:
        programs = folder / post
        programs.mkdir()
        words = ["--post", post, "-q", "-o", programs, *settings]
        commands |= list_builds(f"build --post {post}", [drawing, *words], repeat.peer)
    values = measure_in_turns(commands, repeat.runs or case.runs)
    reading = statistics.median(run.processor for run in values["ezdxf.readfile alone"])
    for process, runs in values.items():
        goal = ""
        if process.startswith("build"):
            times = TIMES[process.split()[2].rstrip(",")]
            goal = f"{times * reading:.1f} s of the processor, {MOST_MB} MB"
        if goal and case.goal:
            goal = f"{case.goal} s"
        row(table, f"{name}: {process}", runs, goal)


def bench_solid(table: Table, folder: Path, name: str, repeat: Repeat) -> None:
    """The rows of a 3-D part."""
    job = ["--job", PARTS / f"{name}.toml", "--post", "rapid", "-q", "-o", folder]
    words = [PARTS / f"{name}.stl", *job]
    builds = list_builds(f"{name}.stl: build --post rapid", words, repeat.peer)
    for process, runs in measure_in_turns(builds, repeat.runs or SOLID_RUNS).items():
        row(table, process, runs, f"{SOLID_GOAL} s of the processor")


def main(wanted: list[str], repeat: Repeat) -> None:
    """The rows of the wanted cases, all for none."""
    table = open_table(
        "process | median s **{:.3f}** | range s {:.3f} to {:.3f} | processor s {:.3f} "
        "| peak MB {:.0f} | goal"
    )
    if not wanted or "help" in wanted:
        command = python("camgen", "--help")
        calls = [measure_process(command) for _ in range(repeat.runs or HELP_RUNS)]
        row(table, "camgen --help", calls, f"{HELP_GOAL} s")
    for name, case in CASES.items():
        if not wanted or name.split()[0] in wanted:
            with tempfile.TemporaryDirectory() as folder:
                bench(table, Path(folder), name, case, repeat)
    for name in SOLIDS:
        if not wanted or name in wanted:
            with tempfile.TemporaryDirectory() as folder:
                bench_solid(table, Path(folder), name, repeat)


if __name__ == "__main__":
    if sys.argv[1:2] == ["draw"]:
        draw(sys.argv[2], int(sys.argv[3]), int(sys.argv[4]))
    else:
        arguments = argparse.ArgumentParser()
        arguments.add_argument("cases", nargs="*")
        arguments.add_argument("--runs", type=int, default=0)
        arguments.add_argument("--peer", default="")
        given = arguments.parse_args()
        main(given.cases, Repeat(given.runs, given.peer))
