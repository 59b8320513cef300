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
from multiprocessing import get_context
from pathlib import Path

from bench.machine import machine
from camgen.batch import state
from tests.support.damage import damaged, one_sign_changed

SHARED = Path(__file__).parents[3] / "shared" / "data" / "dxf"
SEED = 7
SIGNS = [*"0123456789.-+eE", " ", "A", "\x00", "é"]
STATEMENTS = [
    "0",
    "LINE",
    "ENDSEC",
    "EOF",
    "10",
    "1e308",
    "-0",
    "nan",
    "999",
    "SECTION",
    "CIRCLE",
    "40",
    "0.0",
    "SEQEND",
]


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
    words = ["batch", "parts/*.dxf", "--post", "rapid", "--jobs", str(jobs), "-o", out]
    command = [sys.executable, "-m", "camgen", *words]
    return subprocess.Popen(
        command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )


def one_by_one(folder: Path, parts: list[Path]) -> Counter[int]:
    """``camgen build`` for each, a process of its own; the exit codes."""
    (folder / "alone").mkdir()
    codes: Counter[int] = Counter()
    for part in parts:
        words = ["build", f"parts/{part.name}", "--post", "rapid", "-o", "alone", "-q"]
        done = subprocess.run(
            [sys.executable, "-m", "camgen", *words],
            cwd=folder,
            stderr=subprocess.DEVNULL,
            check=False,
        )
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


def main() -> None:
    source = Path(sys.argv[1]) if len(sys.argv) > 1 else SHARED
    runs, count, most = (
        int(word) for word in (*sys.argv[2:5], *("3", "200", "4")[len(sys.argv[2:5]) :])
    )
    sys.stdout.reconfigure(line_buffering=True)  # type: ignore[union-attr]  # rows as they come, also into a file
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "parts").mkdir()
        parts = drawings(source, folder / "parts", count)
        begun = time.perf_counter()
        codes = one_by_one(folder, parts)
        alone = time.perf_counter() - begun
        truth = programs(folder / "alone")
        print(machine(), end="\n\n")
        print(
            "| way | seconds | exit code | programs | same as one by one |\n|---|---|---|---|---|"
        )
        print(
            f"| `build`, a process for each | {alone:.1f} | {dict(sorted(codes.items()))} | {len(truth)} | |"
        )
        for jobs in (one for one in (1, 2, 4) if one <= most):
            seconds = []
            for run in range(runs):
                begun = time.perf_counter()
                process = batch(folder, f"out-{jobs}-{run}", jobs)
                process.communicate()
                seconds.append(time.perf_counter() - begun)
            made = programs(folder / f"out-{jobs}-{runs - 1}")
            row = f"{statistics.median(seconds):.1f} | {process.returncode} | {len(made)} | {made == truth}"
            print(f"| `batch --jobs {jobs}` | {row} |")
        begun = time.perf_counter()
        again = batch(folder, f"out-{most}-{runs - 1}", most)
        again.communicate()
        print(f"| the same again | {time.perf_counter() - begun:.1f} | {again.returncode} | | |")
        there, left, code = killed_and_resumed(folder, len(truth) // 2, most)
        made = programs(folder / "killed")
        print(
            f"| killed at {there} programs, run again: {left} unchanged | | {code} | {len(made)} | {made == truth} |"
        )
        print(f"\nUntil {most} processes can build:", ", ".join(start_methods(most)))


if __name__ == "__main__":
    main()
