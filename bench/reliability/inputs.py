"""Damaged inputs of every kind: what is built of them, or said.

    python -m bench.reliability.inputs [MUTANTS, 20000] [FIRST, 0] [PROCESSES, 2] [READER ...]

Every mutant is one of our fixtures, or a small file made here, with one thing done to it: a byte changed, bytes
dropped, doubled, put in or swapped, the end cut off, a number made huge, tiny, negative or no number, a line doubled
or moved. Mutant N is always the same. Each is given to the command line with a limit of time and of memory. A run is
good when it says one line and writes nothing (exit 2 or 3), or writes a program that was read back (exit 0). Anything
else is a miss: a traceback or exit 1, exit 4, a signal, a hang, a file that is left although it failed, more than one
line, a warning of a library. Prints a table for docs/reliability.md and a line for each miss, and exits with 1 if
there is any.
"""

from __future__ import annotations

import io
import json
import os
import random
import re
import resource
import select
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import NamedTuple

from bench.machine import machine
from bench.support.runner import PARTS, ROOT, Table
from bench.support.timing import peak_mb, python

#: Seconds that a command may take, and bytes of memory that a process may have.
SECONDS, MEMORY = 30, 2 * 1024**3
POSTS = {"rapid": "mod", "pacscript": "pcs", "vplus": "v2", "gcode": "ngc", "grbl": "nc"}
_BUILD = ("build", "--post", "gcode")
_OUTPUTS = 'post.signals={dout0="doTool",spindle="aoSpindle"}'
_NUMBER = re.compile(rb"-?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
_NUMBERS = tuple(b"1e308 -1 0 nan 1e-300 99999999999999999999 -0.0 2147483648 inf ".split(b" "))
_PUT_IN = (
    b"\x00", b"\xff\xfe", b"\n", b"(", b"\xe2\x98\x83", b"%", b"'", b"<!--", bytes(300), b"\x1a",
)  # fmt: skip


class Reader(NamedTuple):
    """words: of the command. files: the sound inputs; the first ``{}`` in the words is where one goes, else it is
    appended.
    """

    words: tuple[str, ...]
    files: tuple[Path, ...]


def _parts(*names: str) -> tuple[Path, ...]:
    return tuple(PARTS / name for name in names)


def readers(made: Path) -> dict[str, Reader]:
    """What is damaged, by kind. made: a folder for the files that no fixture has."""
    import cv2  # noqa: PLC0415 (only for what makes the files)
    import trimesh  # noqa: PLC0415

    gear = cv2.resize(cv2.imread(str(_parts("gear.png")[0]), cv2.IMREAD_GRAYSCALE), (160, 160))
    for suffix in ("pgm", "bmp"):
        cv2.imwrite(str(made / f"gear.{suffix}"), gear)
    box = trimesh.creation.box((30, 20, 10))
    for suffix in ("stl", "ply", "obj", "off", "glb"):
        box.export(made / f"box.{suffix}")
    cases = ROOT / "fixtures" / "cases"
    shutil.copy(cases / "bracket-deburr" / "job.toml", made / "job.toml")
    programs = {
        name: cases / name / "expected"
        for name in ("bracket-follow", "plate-drill", "bracket-deburr")
    }
    drawn = _parts("bracket.dxf", "layers.dxf", "blocks.dxf", "smooth.dxf", "gaps.dxf")
    pictures = ("--set", "operation.kind=trace", "--set", "image.mm_per_px=0.1")
    options = "--post", "rapid", "--set", "post.force_calibrated=true", "--job", "{}"
    job = "build", str(PARTS / "bracket.dxf"), *options
    kinds = {
        "DXF": Reader(_BUILD, (*drawn, *_parts("bracket_binary.dxf"))),
        "SVG": Reader((*_BUILD, "--set", "operation.kind=trace"), _parts("logo.svg")),
        "picture": Reader(
            (*_BUILD, *pictures), (*_parts("gear.png"), made / "gear.pgm", made / "gear.bmp")
        ),
        "mesh": Reader(
            ("inspect",), tuple(made / f"box.{end}" for end in ("stl", "ply", "obj", "off", "glb"))
        ),
        "STEP": Reader(("inspect",), _parts("rfa1.step", "rfa2.step")),
        "G-code": Reader(
            ("build", "--post", "rapid", "--set", _OUTPUTS),
            tuple(folder / "part.ngc" for folder in programs.values()),
        ),
        "job": Reader(job, (made / "job.toml",)),
    }
    for post, end in POSTS.items():
        texts = tuple(folder / f"part.{end}" for folder in programs.values())
        kinds[f"verify {post}"] = Reader(("verify", "{}", "--post", post), texts)
    return kinds


# What is done to a file. Each takes the bytes and a source of chance.

Mutation = Callable[[bytes, random.Random], bytes]


def _change(data: bytes, chance: random.Random) -> bytes:
    at = chance.randrange(len(data))
    return data[:at] + bytes([chance.randrange(256)]) + data[at + 1 :]


def _drop(data: bytes, chance: random.Random) -> bytes:
    at = chance.randrange(len(data))
    return data[:at] + data[at + chance.choice((1, 2, 16, 200)) :]


def _double(data: bytes, chance: random.Random) -> bytes:
    at, size = chance.randrange(len(data)), chance.choice((1, 8, 64, 500))
    return data[: at + size] + data[at:]


def _insert(data: bytes, chance: random.Random) -> bytes:
    at = chance.randrange(len(data))
    return data[:at] + chance.choice(_PUT_IN) + data[at:]


def _swap(data: bytes, chance: random.Random) -> bytes:
    a, b = sorted(chance.randrange(len(data)) for _ in range(2))
    size = min(chance.choice((1, 4, 40)), b - a)
    return (
        data[:a] + data[b : b + size] + data[a + size : b] + data[a : a + size] + data[b + size :]
    )


def _cut(data: bytes, chance: random.Random) -> bytes:
    return data[: chance.randrange(len(data))]


def _number(data: bytes, chance: random.Random) -> bytes:
    found = list(_NUMBER.finditer(data[:100_000]))
    if not found:
        return _change(data, chance)
    one = chance.choice(found)
    return data[: one.start()] + chance.choice(_NUMBERS) + data[one.end() :]


def _line(data: bytes, chance: random.Random) -> bytes:
    lines = data.split(b"\n")
    a, b = chance.randrange(len(lines)), chance.randrange(len(lines))
    lines.insert(b, lines[a] if chance.random() < 0.5 else lines.pop(a))
    return b"\n".join(lines)


MUTATIONS: dict[str, Mutation] = {
    "byte changed": _change, "dropped": _drop, "doubled": _double, "put in": _insert, "swapped": _swap,
    "cut off": _cut, "number": _number, "line": _line,
}  # fmt: skip


def mutant(kinds: dict[str, Reader], number: int) -> tuple[str, str, Path, bytes]:
    """Its kind, what is done to it, the sound file, and the bytes."""
    chance = random.Random(number)
    kind = list(kinds)[number % len(kinds)]
    file = chance.choice(kinds[kind].files)
    name = list(MUTATIONS)[(number // len(kinds)) % len(MUTATIONS)]
    return kind, name, file, MUTATIONS[name](file.read_bytes(), chance)


# The worker: one process that runs many mutants, and tells before each which one it is.


def work(made: Path, numbers: Iterator[int], kinds: dict[str, Reader]) -> None:
    """Runs the mutants, a line of JSON before and after each."""
    from camgen.cli import main  # noqa: PLC0415 (this is what is tried)

    resource.setrlimit(resource.RLIMIT_AS, (4 * MEMORY, 4 * MEMORY))
    tell = os.fdopen(os.dup(1), "w")
    for number in numbers:
        kind, _, file, data = mutant(kinds, number)
        folder = Path(tempfile.mkdtemp(dir=made))
        source = folder / file.name
        source.write_bytes(data)
        words = [word.replace("{}", str(source)) for word in kinds[kind].words]
        if words == list(kinds[kind].words):
            words.append(str(source))
        print(json.dumps({"number": number}), file=tell, flush=True)
        out, err = io.StringIO(), io.StringIO()
        os.chdir(folder)
        with redirect_stdout(out), redirect_stderr(err):
            code = main(words)
        left = sorted(path.name for path in folder.iterdir() if path != source)
        miss = _miss(code, err.getvalue(), left if words[0] == "build" else [])
        ending = {"number": number, "code": code, "miss": miss, "peak": peak_mb()}
        print(json.dumps(ending), file=tell, flush=True)
        os.chdir(made)
        shutil.rmtree(folder)


def _miss(code: int, said: str, left: Sequence[str]) -> str:
    """What is wrong with a run, empty if nothing is."""
    lines = [line for line in said.splitlines() if line.strip()]
    if "Traceback" in said:
        return "traceback: " + lines[-1][:150]
    if "Warning:" in said:
        return "warning: " + next(line for line in lines if "Warning:" in line)[:150]
    if code == 0:
        return ""
    errors = [line for line in lines if line.startswith("camgen: error:")]
    # What verify finds wrong in a text is its answer, line by line.
    if (
        code not in (2, 3)
        and not (code == 4 and not errors)
        and not (code == 4 and "read back" not in said)
    ):
        return f"exit {code}: " + (lines or [""])[-1][:150]
    if left:
        return f"files are left: {', '.join(left)[:100]}"
    return "" if len(errors) <= 1 else f"{len(errors)} errors: {errors[0][:120]}"


# The parent: workers are started again behind a mutant that ends or stops one.


class Run(NamedTuple):
    """One mutant. code: of the command, none where the process ended. miss: what is wrong. peak: MB so far."""

    number: int
    code: int | None
    miss: str
    peak: float


def drive(made: Path, numbers: Sequence[int], names: Sequence[str]) -> list[Run]:
    """Runs the mutants ``numbers`` in one process after the other."""
    runs: list[Run] = []
    while len(runs) < len(numbers):
        left = numbers[len(runs) :]
        share = json.dumps([left[:400], names])
        command = python("bench.reliability.inputs", "--work", made, share)
        with subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=ROOT, text=True
        ) as process:
            runs += _listen(process, left[:400])
    return runs


def _listen(process: subprocess.Popen[str], numbers: Sequence[int]) -> list[Run]:
    runs: list[Run] = []
    assert process.stdout is not None
    limit = SECONDS + 30.0  # the first one imports the libraries
    while len(runs) < len(numbers):
        ready, _, _ = select.select([process.stdout], [], [], limit)
        text = process.stdout.readline() if ready else ""
        if not text:
            process.kill()
            process.wait()
            what = (
                f"the process ended by signal {-process.returncode}"
                if ready
                else f"no end within {SECONDS} s"
            )
            runs.append(Run(numbers[len(runs)], None, what, 0))
            return runs
        said = json.loads(text)
        limit = SECONDS
        if "code" in said:
            runs.append(Run(said["number"], said["code"], said["miss"], said["peak"]))
    return runs


def measure(count: int, first: int, processes: int, names: Sequence[str]) -> int:
    """Prints the table and the misses; how many there are."""
    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder)
        kinds = _chosen(readers(made), names)
        numbers = list(range(first, first + count))
        shares = [numbers[k::processes] for k in range(processes)]
        with ThreadPoolExecutor(processes) as pool:
            found = [
                run
                for part in pool.map(lambda share: drive(made, share, list(kinds)), shares)
                for run in part
            ]
        table: dict[str, Counter[str]] = {kind: Counter() for kind in kinds}
        for run in found:
            kind, name, file, _ = mutant(kinds, run.number)
            row = table[kind]
            row["mutants"] += 1
            row[{0: "built", None: "ended"}.get(run.code, "refused")] += 1
            row["misses"] += bool(run.miss)
            if run.miss:
                print(f"mutant {run.number} ({kind}, {file.name}, {name}): {run.miss}")
    misses = sum(row["misses"] for row in table.values())
    peak = max((run.peak for run in found), default=0)
    print(f"\n{machine()}; {time.perf_counter() - began:.0f} s; at most {peak:.0f} MB")
    columns = Table("input | mutants | read or built | refused | misses")
    for kind, row in table.items():
        columns.add(kind, *(row[key] for key in ("mutants", "built", "refused", "misses")))
    return misses + (1e6 * peak > MEMORY)


def _chosen(kinds: dict[str, Reader], names: Sequence[str]) -> dict[str, Reader]:
    return {kind: reader for kind, reader in kinds.items() if not names or kind in names}


if __name__ == "__main__":
    if sys.argv[1:2] == ["--work"]:
        here = Path(sys.argv[2])
        ahead, wanted = json.loads(sys.argv[3])
        work(here, iter(ahead), _chosen(readers(here), wanted))
        sys.exit()
    given = sys.argv[1:]
    counts = [int(word) for word in given if word.isdigit()]
    count, first, processes = (*counts, *(20000, 0, 2)[len(counts) :])
    sys.exit(
        1 if measure(count, first, processes, [word for word in given if not word.isdigit()]) else 0
    )
