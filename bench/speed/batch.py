"""A batch of real and damaged drawings: the same programs as one by one, killed and resumed, time.

    python -m bench.speed.batch [FOLDER] [RUNS, 3] [DRAWINGS, 200] [JOBS, 4]

The damaged drawings are copies of the real ones with lines changed, moved, doubled and left out, by
a fixed seed.
"""

from __future__ import annotations

import random
import statistics
import subprocess
import sys
import tempfile
import time
from collections import Counter
from functools import partial
from pathlib import Path

from bench.support.runner import SHARED, find_files, open_table, read_words, verdict
from bench.support.timing import python, timed
from camgen.batch import state
from tests.support.damage import damaged, one_sign_changed

SEED = 7
SIGNS = [*"0123456789.-+eE", " ", "A", "\x00", "é"]
STATEMENTS = ["0", "LINE", "ENDSEC", "EOF", "10", "1e308", "-0", "nan", "999", "SECTION", "CIRCLE"]
STATEMENTS += ["40", "0.0", "SEQEND"]


def write_drawings(source: Path, folder: Path, count: int) -> list[Path]:
    """The real drawings, and damaged ones until there are `count`."""
    real = find_files(source, (".dxf",))[:count]
    chance = random.Random(SEED)
    change = partial(one_sign_changed, signs=SIGNS)
    for k, path in enumerate(real):
        (folder / f"{k:03}-{path.stem}.dxf").write_bytes(path.read_bytes())
    for k in range(len(real), count):
        text = chance.choice(real).read_bytes().decode("latin-1")
        text = damaged(text, chance, STATEMENTS, change)
        (folder / f"{k:03}-damaged.dxf").write_bytes(text.encode("latin-1"))
    return sorted(folder.iterdir())


def start_batch(folder: Path, out: str, jobs: int) -> subprocess.Popen[str]:
    """Starts a batch."""
    words = "--post", "rapid", "--jobs", jobs, "-o", out
    command = python("camgen", "batch", "parts/*.dxf", *words)
    quiet = subprocess.DEVNULL
    return subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=quiet, text=True)


def run_batch(folder: Path, out: str, jobs: int) -> int:
    """The exit code of a batch."""
    process = start_batch(folder, out, jobs)
    process.communicate()
    return process.returncode


def build_each(folder: Path, parts: list[Path]) -> Counter[int]:
    """The exit codes of ``camgen build`` for each part, in processes of their own."""
    (folder / "alone").mkdir()
    codes: Counter[int] = Counter()
    for part in parts:
        words = "--post", "rapid", "-o", "alone", "-q"
        command = python("camgen", "build", f"parts/{part.name}", *words)
        done = subprocess.run(command, cwd=folder, stderr=subprocess.DEVNULL, check=False)
        codes[done.returncode] += 1
    return codes


def read_programs(folder: Path) -> dict[str, bytes]:
    """The programs of a folder. A killed batch may leave a temporary file, which has a dot."""
    programs = {}
    for path in folder.iterdir():
        if path.name != state.NAME and path.name[0] != ".":
            programs[path.name] = path.read_bytes()
    return programs


def kill_and_resume(folder: Path, half: int, jobs: int) -> tuple[int, int, int]:
    """Programs that a batch had when it was killed, those that the next one kept, its exit code."""
    out = folder / "killed"
    first = start_batch(folder, out.name, jobs)
    while first.poll() is None and (not out.is_dir() or len(read_programs(out)) < half):
        time.sleep(0.01)
    first.kill()
    first.communicate()
    present = len(read_programs(out))
    second = start_batch(folder, out.name, jobs)
    rows = second.communicate()[0].splitlines()[1:]
    return present, sum(row.split()[1] == "unchanged" for row in rows), second.returncode


def main(source: Path, runs: int, count: int, most_jobs: int) -> int:
    """Prints the table; 1 if a batch writes other programs than single builds."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "parts").mkdir()
        parts = write_drawings(source, folder / "parts", count)
        codes, alone = timed(lambda: build_each(folder, parts))
        truth = read_programs(folder / "alone")
        table = open_table("batch | seconds {:.1f} | exit code | programs | same as one by one")
        table.add("`build`, a process for each", alone, dict(sorted(codes.items())), len(truth))
        for jobs in (1, 2, 4):
            if jobs > most_jobs:
                break
            seconds = []
            for run in range(runs):
                out = f"out-{jobs}-{run}"
                code, taken = timed(partial(run_batch, folder, out, jobs))
                seconds.append(taken)
            programs = read_programs(folder / out)
            is_same = verdict(programs == truth)
            median = statistics.median(seconds)
            table.add(f"`batch --jobs {jobs}`", median, code, len(programs), is_same)
        code, taken = timed(lambda: run_batch(folder, f"out-{most_jobs}-{runs - 1}", most_jobs))
        table.add("the same again", taken, code)
        present, kept, code = kill_and_resume(folder, len(truth) // 2, most_jobs)
        programs = read_programs(folder / "killed")
        kill = f"killed at {present} programs, run again: {kept} unchanged"
        table.add(kill, None, code, len(programs), verdict(programs == truth))
    return int(table.missed > 0)


if __name__ == "__main__":
    sys.exit(main(*read_words(SHARED / "dxf", 3, 200, 4)))
