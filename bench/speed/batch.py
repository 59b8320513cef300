"""A batch of real and damaged drawings: one summary, the same programs as one by one, killed and resumed, seconds.

    python -m bench.speed.batch [FOLDER] [RUNS, 3] [DRAWINGS, 200] [JOBS, 4]

The damaged drawings are copies of the real ones with lines
changed, moved, doubled and left out, by a fixed seed.
"""

import os
import random
import statistics
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from bench.support.runner import SHARED, open_table, read_words
from bench.support.timing import python, timed
from camgen.batch import state
from tests.support.damage import damaged, one_sign_changed

SEED = 7
SIGNS = [*"0123456789.-+eE", " ", "A", "\x00", "é"]
STATEMENTS = [
    "0", "LINE", "ENDSEC", "EOF", "10", "1e308", "-0", "nan", "999", "SECTION", "CIRCLE", "40", "0.0", "SEQEND",
]  # fmt: skip


def drawings(source: Path, folder: Path, count: int) -> list[Path]:
    """The real drawings, ``count`` at most, and as many damaged ones as are missing to it."""
    real = sorted(path for path in source.rglob("*") if path.suffix.lower() == ".dxf")[:count]
    chance = random.Random(SEED)
    for k, path in enumerate(real):
        (folder / f"{k:03}-{path.stem}.dxf").write_bytes(path.read_bytes())
    for k in range(len(real), count):
        text = chance.choice(real).read_bytes().decode("latin-1")
        spoilt = damaged(
            text, chance, STATEMENTS, lambda line, by: one_sign_changed(line, by, SIGNS)
        )
        (folder / f"{k:03}-damaged.dxf").write_bytes(spoilt.encode("latin-1"))
    return sorted(folder.iterdir())


def batch(folder: Path, out: str, jobs: int) -> "subprocess.Popen[str]":
    words = "--post", "rapid", "--jobs", jobs, "-o", out
    command = python("camgen", "batch", "parts/*.dxf", *words)
    return subprocess.Popen(
        command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )


def one_by_one(folder: Path, parts: list[Path]) -> Counter[int]:
    """``camgen build`` for each, a process of its own; the exit codes."""
    (folder / "alone").mkdir()
    codes: Counter[int] = Counter()
    for part in parts:
        words = "--post", "rapid", "-o", "alone", "-q"
        command = python("camgen", "build", f"parts/{part.name}", *words)
        done = subprocess.run(command, cwd=folder, stderr=subprocess.DEVNULL, check=False)
        codes[done.returncode] += 1
    return codes


def programs(folder: Path) -> dict[str, bytes]:
    """What was written for the machine; a batch that is killed may leave a temporary file, which begins with a dot."""
    return {
        p.name: p.read_bytes()
        for p in folder.iterdir()
        if p.name != state.NAME and p.name[0] != "."
    }


def killed_and_resumed(folder: Path, half: int, jobs: int) -> tuple[int, int, int]:
    """How many programs were there when the batch was killed, how many the next one left alone, its exit code."""
    first = batch(folder, "killed", jobs)
    while first.poll() is None and (
        not (folder / "killed").is_dir() or len(programs(folder / "killed")) < half
    ):
        time.sleep(0.01)
    first.kill()
    first.wait()
    there = len(programs(folder / "killed"))
    second = batch(folder, "killed", jobs)
    table = second.communicate()[0].splitlines()[1:]
    return there, sum(row.split()[1] == "unchanged" for row in table), second.returncode


def _hello(link: object) -> None:
    import camgen.batch.perform  # noqa: F401, PLC0415 (what a process pays for)

    link.send(True)  # type: ignore[attr-defined]


def start_methods(workers: int) -> Iterator[str]:
    """Seconds until so many processes can build, by how they are started."""
    for method in ("spawn", "forkserver", "fork"):
        if os.name == "nt" and method != "spawn":
            continue
        context = get_context(method)
        begun = time.perf_counter()
        pipes = [context.Pipe() for _ in range(workers)]
        processes = [context.Process(target=_hello, args=(theirs,)) for _, theirs in pipes]  # type: ignore[attr-defined]
        for process in processes:
            process.start()
        for ours, _ in pipes:
            ours.recv()
        yield f"{method} {time.perf_counter() - begun:.2f} s"
        for process in processes:
            process.join()


def main(source: Path, runs: int, count: int, most: int) -> None:
    sys.stdout.reconfigure(line_buffering=True)  # type: ignore[union-attr]  # rows as they come, also into a file
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "parts").mkdir()
        parts = drawings(source, folder / "parts", count)
        codes, alone = timed(lambda: one_by_one(folder, parts))
        truth = programs(folder / "alone")
        table = open_table("way | seconds {:.1f} | exit code | programs | same as one by one")
        table.add("`build`, a process for each", alone, dict(sorted(codes.items())), len(truth))
        for jobs in (one for one in (1, 2, 4) if one <= most):
            seconds = []
            for run in range(runs):
                code, taken = timed(partial(ended, folder, f"out-{jobs}-{run}", jobs))
                seconds.append(taken)
            made = programs(folder / f"out-{jobs}-{runs - 1}")
            median = statistics.median(seconds)
            table.add(f"`batch --jobs {jobs}`", median, code, len(made), made == truth)
        code, taken = timed(lambda: ended(folder, f"out-{most}-{runs - 1}", most))
        table.add("the same again", taken, code)
        there, left, code = killed_and_resumed(folder, len(truth) // 2, most)
        made = programs(folder / "killed")
        kill = f"killed at {there} programs, run again: {left} unchanged"
        table.add(kill, None, code, len(made), made == truth)
        print(f"\nUntil {most} processes can build:", ", ".join(start_methods(most)))


def ended(folder: Path, out: str, jobs: int) -> int:
    """The exit code of a batch."""
    process = batch(folder, out, jobs)
    process.communicate()
    return process.returncode


if __name__ == "__main__":
    main(*read_words(SHARED / "dxf", 3, 200, 4))
