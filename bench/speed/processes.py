"""Time and memory of whole processes, from the command to the written program.

    python -m bench.speed.processes [CASE ...] [--runs N]   all cases, or those named: help, 251, 401, 5,001, 100,001,
                                                            rfa1, rfa2

This process imports nothing heavy: on Linux a child's peak memory counts what its parent held when it was started.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from bench.machine import machine

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
PARTS = Path(__file__).parents[2] / "fixtures" / "parts"
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


def measured(command: list[str]) -> tuple[float, float, float]:
    """Seconds, processor seconds and peak memory (MB) of one process."""
    with tempfile.TemporaryFile() as said:
        begun = time.perf_counter()
        process = subprocess.Popen(command, stdout=said, stderr=said)
        _, status, usage = os.wait4(process.pid, 0)
        seconds = time.perf_counter() - begun
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            said.seek(0)
            sys.exit(f"{' '.join(command)}\n{said.read().decode()}")
    unit = 1e6 if sys.platform == "darwin" else 1e3
    return seconds, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / unit


def row(what: str, values: list[tuple[float, float, float]], goal: str) -> str:
    seconds = [s for s, _, _ in values]
    middle = f"**{statistics.median(seconds):.3f}** | {min(seconds):.3f} to {max(seconds):.3f}"
    spent = statistics.median(s for _, s, _ in values)
    return f"| {what} | {middle} | {spent:.3f} | {max(m for _, _, m in values):.0f} | {goal} |"


def bench(folder: Path, name: str, case: Case, runs: int) -> None:
    """The rows of one drawing: reading alone, then each post, taken in turns."""
    drawing = str(folder / "plate.dxf")
    subprocess.run(
        [
            sys.executable,
            "-m",
            "bench.speed.processes",
            "draw",
            drawing,
            str(case.circles),
            str(case.slots),
        ],
        check=True,
    )
    commands = {"ezdxf": [sys.executable, "-c", f"import ezdxf; ezdxf.readfile({drawing!r})"]}
    settings = [word for one in case.settings for word in ("--set", one)]
    for post in case.posts:
        programs = folder / post
        programs.mkdir()
        build = ["build", drawing, "--post", post, "-q", "-o", str(programs), *settings]
        commands[post] = [sys.executable, "-m", "camgen", *build]
    values: dict[str, list[tuple[float, float, float]]] = {who: [] for who in commands}
    for _ in range(runs or case.runs):
        for who, command in commands.items():
            values[who].append(measured(command))
    reading = statistics.median(s for _, s, _ in values["ezdxf"])
    print(row(f"{name}: ezdxf.readfile alone", values["ezdxf"], ""))
    for post in case.posts:
        goal = (
            f"{case.goal} s"
            if case.goal
            else f"{TIMES[post] * reading:.1f} s of the processor, {MOST_MB} MB"
        )
        print(row(f"{name}: build --post {post}", values[post], goal), flush=True)


def bench_solid(folder: Path, name: str, runs: int) -> None:
    """The row of a 3-D part."""
    build = [
        "build",
        str(PARTS / f"{name}.stl"),
        "--job",
        str(PARTS / f"{name}.toml"),
        "--post",
        "rapid",
        "-q",
    ]
    values = [
        measured([sys.executable, "-m", "camgen", *build, "-o", str(folder)])
        for _ in range(runs or SOLID_RUNS)
    ]
    print(
        row(f"{name}.stl: build --post rapid", values, f"{SOLID_GOAL} s of the processor"),
        flush=True,
    )


def main(wanted: list[str], runs: int) -> None:
    """runs: of each process; 0: as many as its case says."""
    print(machine())
    print(
        "\n| process | median s | range s | processor s | peak MB | goal |\n|---|---|---|---|---|---|",
        flush=True,
    )
    if not wanted or "help" in wanted:
        calls = [
            measured([sys.executable, "-m", "camgen", "--help"]) for _ in range(runs or HELP_RUNS)
        ]
        print(row("camgen --help", calls, f"{HELP_GOAL} s"), flush=True)
    for name, case in CASES.items():
        if not wanted or name.split()[0] in wanted:
            with tempfile.TemporaryDirectory() as folder:
                bench(Path(folder), name, case, runs)
    for name in SOLIDS:
        if not wanted or name in wanted:
            with tempfile.TemporaryDirectory() as folder:
                bench_solid(Path(folder), name, runs)


if __name__ == "__main__":
    if sys.argv[1:2] == ["draw"]:
        draw(sys.argv[2], int(sys.argv[3]), int(sys.argv[4]))
    else:
        arguments = argparse.ArgumentParser()
        arguments.add_argument("cases", nargs="*")
        arguments.add_argument("--runs", type=int, default=0)
        given = arguments.parse_args()
        main(given.cases, given.runs)
