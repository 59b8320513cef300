"""Time and memory of whole processes, from the command to the written program.

    python -m bench.speed.processes [CASE ...] [--runs N]

All cases, or those named: help, 251, 401, 5,001, 100,001, rfa1, rfa2. Reading a drawing by ezdxf
alone takes turns with its builds.

This process imports nothing heavy: on Linux the peak memory of a child counts that of its parent at
its start.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from bench.support.runner import PARTS, Table, open_table
from bench.support.timing import Process, measure_in_turns, measure_process, python

POSTS = ("gcode", "rapid")
#: Distances of the grid of holes, mm.
PITCH = (36.0, 24.0)
#: An arm that reaches all of 401 shapes.
ARM = ("cell.robot=IRB 2400", "cell.base_from_work=[700, -360, 500, 0, 0, 0]")
COLUMNS = (
    "process | median s **{:.3f}** | range s {:.3f} to {:.3f} | processor s {:.3f} "
    "| peak MB {:.0f} | goal"
)


@dataclass(frozen=True)
class Case:
    """A plate.

    circles: number of its round holes.
    slots: number of its slots.
    goal: s; 0 for a goal in times of the seconds of ezdxf.
    runs: runs of each process.
    posts: posts of the builds.
    settings: settings of the job.
    """

    circles: int
    slots: int
    goal: float
    runs: int
    posts: tuple[str, ...] = POSTS
    settings: tuple[str, ...] = ()


CASES = {
    "251 shapes": Case(200, 50, goal=0.8, runs=7),
    "401 shapes at an IRB 2400": Case(320, 80, 2.0, runs=7, posts=("rapid",), settings=ARM),
    "5,001 shapes": Case(4_000, 1_000, goal=3.0, runs=5),
    "100,001 entities": Case(20_000, 20_000, goal=0.0, runs=3),
}
HELP_GOAL, HELP_RUNS = 0.12, 15
#: 3-D parts of ``fixtures/parts``, each with its job file; the goal in seconds of the processor.
SOLIDS, SOLID_GOAL, SOLID_RUNS = ("rfa1", "rfa2"), 0.7, 9
#: Goals of large drawings: times the processor seconds of ezdxf, and MB.
TIMES, MOST_MB = {"gcode": 2.0, "rapid": 2.5}, 400


def draw(file: str, circles: int, slots: int) -> None:
    """Draws an outline around holes on a grid.

    Round holes have diameters of 10 to 20 mm, slots of 30 x 8 mm two lines and two arcs each.
    """
    import ezdxf  # noqa: PLC0415 (only a process that draws loads it)

    document = ezdxf.new("R2010", units=4)
    space = document.modelspace()
    count = circles + slots
    columns = max(1, round(count**0.5))
    between = count // slots
    drawn = 0
    for k in range(count):
        x, y = PITCH[0] * (k % columns), PITCH[1] * (k // columns)
        if k % between == between - 1 and drawn < slots:
            drawn += 1
            # Not in the order of the loop, and one line against it: a reader must join the ends.
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


def add_row(table: Table, name: str, runs: list[Process], goal: str) -> None:
    """Prints the row of a process."""
    seconds = [run.seconds for run in runs]
    processor = statistics.median(run.processor for run in runs)
    span = min(seconds), max(seconds)
    peak = max(run.peak for run in runs)
    table.add(name, statistics.median(seconds), span, processor, peak, goal)


def measure_drawing(table: Table, folder: Path, name: str, runs: int) -> None:
    """The rows of a drawing: reading alone, then each post, taken in turns."""
    case, drawing, reading = CASES[name], str(folder / "plate.dxf"), "ezdxf.readfile alone"
    measure_process(python("bench.speed.processes", "draw", drawing, case.circles, case.slots))
    read = f"import ezdxf; ezdxf.readfile({drawing!r})"
    commands = {reading: [sys.executable, "-c", read]}
    for post in case.posts:
        words = ["--post", post, "-q", "-o", folder / post]
        for setting in case.settings:
            words += ["--set", setting]
        (folder / post).mkdir()
        commands[post] = python("camgen", "build", drawing, *words)
    processes = measure_in_turns(commands, runs or case.runs)
    seconds = statistics.median(run.processor for run in processes[reading])
    add_row(table, f"{name}: {reading}", processes[reading], "")
    for post in case.posts:
        goal = f"{TIMES[post] * seconds:.1f} s of the processor, {MOST_MB} MB"
        if case.goal:
            goal = f"{case.goal} s"
        add_row(table, f"{name}: build --post {post}", processes[post], goal)


def list_solids(wanted: list[str], folder: str) -> Iterator[tuple[str, list[str]]]:
    """The names of 3-D parts, and their commands."""
    for name in SOLIDS:
        if name in (wanted or SOLIDS):
            job = ["--job", PARTS / f"{name}.toml", "--post", "rapid", "-q", "-o", folder]
            yield name, python("camgen", "build", PARTS / f"{name}.stl", *job)


def main(wanted: list[str], runs: int) -> None:
    """Prints the rows of the wanted cases, all for none."""
    table = open_table(COLUMNS)
    if not wanted or "help" in wanted:
        command = python("camgen", "--help")
        processes = [measure_process(command) for _ in range(runs or HELP_RUNS)]
        add_row(table, "camgen --help", processes, f"{HELP_GOAL} s")
    for name in CASES:
        if not wanted or name.split()[0] in wanted:
            with tempfile.TemporaryDirectory() as folder:
                measure_drawing(table, Path(folder), name, runs)
    with tempfile.TemporaryDirectory() as folder:
        for name, command in list_solids(wanted, folder):
            processes = [measure_process(command) for _ in range(runs or SOLID_RUNS)]
            title = f"{name}.stl: build --post rapid"
            add_row(table, title, processes, f"{SOLID_GOAL} s of the processor")


if __name__ == "__main__":
    if sys.argv[1:2] == ["draw"]:
        draw(sys.argv[2], int(sys.argv[3]), int(sys.argv[4]))
    else:
        arguments = argparse.ArgumentParser()
        arguments.add_argument("cases", nargs="*")
        arguments.add_argument("--runs", type=int, default=0)
        given = arguments.parse_args()
        main(given.cases, given.runs)
