"""Builds that are killed while they run: the files that they leave in the folder.

    python -m bench.reliability.kills [KILLS, 200] [TERMS, 100]

A drawing of 2,000 segments is built with program, plan, report and preview over older files of the
same names. SIGKILL, then SIGTERM, ends the process at moments that are spread evenly over the time
of a whole build. Afterwards each file must be the old one or the new one, whole, and no other file
may be there. The command prints a table for docs/reliability.md, and exits with 1 if a file is
damaged or left over.
"""

from __future__ import annotations

import math
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from bench.support.runner import Scenario, must_be_none, read_words, run
from bench.support.timing import python, timed

NAMES = ("part.mod", "plan.json", "report.json", "part.html")
_OLD = b"an older file\n"
_COLUMNS = "signal | builds ended {} of {} | files new | files damaged | files left over"


def _draw_star(path: Path) -> None:
    """Writes a star of 2,000 corners."""
    points = []
    for number in range(2000):
        radius, angle = 40 + 8 * (number % 2), number * math.pi / 1000
        points.append(f"{60 + radius * math.cos(angle):.3f},{60 + radius * math.sin(angle):.3f}")
    page = 'xmlns="http://www.w3.org/2000/svg" width="120mm" height="120mm" viewBox="0 0 120 120"'
    path.write_text(f'<svg {page}><polygon points="{" ".join(points)}"/></svg>')


def _start_build(folder: Path) -> subprocess.Popen[bytes]:
    for name in NAMES:
        (folder / name).write_bytes(_OLD)
    words = ["build", "part.svg", "--post", "rapid", "--set", "operation.kind=trace", "-q"]
    for option, name in zip(("-o", "--plan", "--report", "--preview"), NAMES, strict=True):
        words += [option, name]
    return subprocess.Popen(python("camgen", *words), cwd=folder, stderr=subprocess.DEVNULL)


def build_whole(folder: Path) -> tuple[dict[str, bytes], float]:
    """The files of a build that is not killed, and its seconds."""
    _draw_star(folder / "part.svg")
    _start_build(folder).wait()
    code, seconds = timed(lambda: _start_build(folder).wait())
    if code:
        sys.exit("the build fails without being killed")
    return {name: (folder / name).read_bytes() for name in NAMES}, seconds


def measure(
    folder: Path, new_files: dict[str, bytes], seconds: float, number: signal.Signals, count: int
) -> list[tuple[object, ...]]:
    """The row of a signal that ends a number of builds, beside a whole one."""
    ended = new = damaged = left = 0
    for build in range(count):
        process = _start_build(folder)
        time.sleep(seconds * (build + 0.5) / count)
        process.send_signal(number)
        ended += process.wait() != 0
        for path in folder.iterdir():
            if path.name == "part.svg":
                continue
            data = path.read_bytes()
            if path.name not in NAMES:
                left += 1
                path.unlink()
            elif data == new_files[path.name]:
                new += 1
            elif data != _OLD:
                damaged += 1
        damaged += sum(not (folder / name).exists() for name in NAMES)
    return [(number.name, (ended, count), new, must_be_none(damaged), must_be_none(left))]


if __name__ == "__main__":
    kills, terms = read_words(200, 100)
    with tempfile.TemporaryDirectory() as text:
        place = Path(text)
        whole = (place, *build_whole(place))
        inputs = [(*whole, signal.SIGKILL, kills), (*whole, signal.SIGTERM, terms)]
        sys.exit(run(Scenario(_COLUMNS, inputs, measure)))
