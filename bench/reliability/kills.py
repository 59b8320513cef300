"""Builds that are killed while they run: what is left in the folder.

    python -m bench.reliability.kills [KILLS, 200] [TERMS, 100]

A drawing of some thousand segments is built with program, plan, report and preview, over older files of the same names.
The process is ended (SIGKILL, then SIGTERM) after a share of the time that a whole build takes, another share each
time, evenly spread from its start to its end. Then every file must be the old one or the new one, whole, and no other
file may be there. Prints a table for docs/reliability.md, and exits with 1 where a file is damaged or left over.
"""

from __future__ import annotations

import hashlib
import math
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from bench.support.runner import open_table, read_words
from bench.support.timing import python, timed

NAMES = ("part.mod", "plan.json", "report.json", "part.html")
_OLD = b"an older file\n"


def _drawing(path: Path) -> None:
    """A star of 2,000 corners, as SVG."""
    radii = [40.0 + 8.0 * (k % 2) for k in range(2000)]
    turns = [k * math.pi / 1000 for k in range(2000)]
    corners = [
        (60 + r * math.cos(t), 60 + r * math.sin(t)) for r, t in zip(radii, turns, strict=True)
    ]
    points = " ".join(f"{x:.3f},{y:.3f}" for x, y in corners)
    path.write_text(
        f'<svg xmlns="http://www.w3.org/2000/svg" width="120mm" height="120mm" viewBox="0 0 120 120">'
        f'<polygon points="{points}"/></svg>'
    )


def _start(folder: Path) -> subprocess.Popen[bytes]:
    for name in NAMES:
        (folder / name).write_bytes(_OLD)
    words = ["build", "part.svg", "--post", "rapid", "--set", "operation.kind=trace", "-q"]
    for option, name in zip(("-o", "--plan", "--report", "--preview"), NAMES, strict=True):
        words += [option, name]
    return subprocess.Popen(python("camgen", *words), cwd=folder, stderr=subprocess.DEVNULL)


def _digests(folder: Path) -> dict[str, str]:
    return {name: hashlib.sha256((folder / name).read_bytes()).hexdigest() for name in NAMES}


def measure(counts: dict[signal.Signals, int]) -> int:
    """Prints the table; how many files are damaged or left over."""
    table = open_table(
        "signal | builds ended {} of {} | files new | files damaged | files left over"
    )
    wrong = 0
    with tempfile.TemporaryDirectory() as text:
        folder = Path(text)
        _drawing(folder / "part.svg")
        _start(folder).wait()
        failed, seconds = timed(lambda: _start(folder).wait())
        if failed:
            sys.exit("the build fails without being killed")
        whole, old = _digests(folder), hashlib.sha256(_OLD).hexdigest()
        for number, count in counts.items():
            ended = new = damaged = left = 0
            for k in range(count):
                process = _start(folder)
                time.sleep(seconds * (k + 0.5) / count)
                process.send_signal(number)
                ended += process.wait() != 0
                found = _digests(folder)
                new += sum(found[name] == whole[name] for name in NAMES)
                damaged += sum(found[name] not in (whole[name], old) for name in NAMES)
                others = [
                    path for path in folder.iterdir() if path.name not in (*NAMES, "part.svg")
                ]
                left += len(others)
                for path in others:
                    path.unlink()
            table.add(number.name, (ended, count), new, damaged, left)
            wrong += damaged + left
    return wrong


if __name__ == "__main__":
    kills, terms = read_words(200, 100)
    sys.exit(1 if measure({signal.SIGKILL: kills, signal.SIGTERM: terms}) else 0)
