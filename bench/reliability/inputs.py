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

import random
import re
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

from bench.reliability.commands import Ending, find_fault, map_cases, run_command
from bench.support.children import Limits, run_in_child
from bench.support.runner import PARTS, ROOT, Table, machine

#: A process has 8 GB of address space, a command 30 s; more than `MEMORY` MB in use is a miss.
LIMITS, MEMORY = Limits(memory=8 * 1024**3, clock=30.0), 2 * 1024**3 / 1e6
#: Mutants that a child runs one after the other.
_CHUNK = 400
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


def mutant(kinds: Mapping[str, Reader], number: int) -> tuple[str, str, Path, bytes]:
    """Its kind, what is done to it, the sound file, and the bytes."""
    chance = random.Random(number)
    kind = list(kinds)[number % len(kinds)]
    file = chance.choice(kinds[kind].files)
    name = list(MUTATIONS)[(number // len(kinds)) % len(MUTATIONS)]
    return kind, name, file, MUTATIONS[name](file.read_bytes(), chance)


class Run(NamedTuple):
    """A mutant that was run.

    code: exit code of the command; None if the process ended without one.
    miss: the fault of how it ended, empty without one.
    peak: the largest resident memory of its process, MB.
    """

    number: int
    code: int | None
    miss: str
    peak: float


def run_mutants(kinds: Mapping[str, Reader], folder: Path, numbers: Sequence[int]) -> list[Run]:
    """Runs mutants in a child, and in a new one after each mutant that ends or stops it.

    folder: the place of their files.
    """
    runs: list[Run] = []
    while len(runs) < len(numbers):
        left = numbers[len(runs) :]
        child = run_in_child(partial(_run_each, kinds, folder, left), LIMITS)
        endings = list(child.results)
        if len(endings) < len(left):
            endings.append(Ending(None, child.signal, (), "", ()))
        for number, ending in zip(left, endings, strict=False):
            runs.append(Run(number, ending.code, _find_miss(ending), child.peak))
    return runs


def _run_each(
    kinds: Mapping[str, Reader], folder: Path, numbers: Sequence[int]
) -> Iterator[Ending]:
    """Runs mutants in turn. Files that commands other than a build leave do not count."""
    for number in numbers:
        kind, _, file, data = mutant(kinds, number)
        with tempfile.TemporaryDirectory(dir=folder) as text:
            source, work = Path(text) / file.name, Path(text) / "work"
            work.mkdir()
            source.write_bytes(data)
            words = [word.replace("{}", str(source)) for word in kinds[kind].words]
            if words == list(kinds[kind].words):
                words.append(str(source))
            ending = run_command(words, work)
        yield ending if words[0] == "build" else ending._replace(left=())


def _find_miss(ending: Ending) -> str:
    if ending.signal == signal.SIGXCPU:
        return f"no end within {LIMITS.clock:.0f} s"
    # What verify finds wrong in a text is its answer, line by line.
    is_answer = not ending.errors or "read back" not in ending.messages
    return find_fault(ending, (0, 2, 3, 4) if is_answer else (0, 2, 3))


def measure(count: int, first: int, processes: int, names: Sequence[str]) -> int:
    """Prints the table and the misses. Returns the number of misses."""
    began = time.perf_counter()
    runs: list[Run] = []
    with tempfile.TemporaryDirectory() as text:
        folder = Path(text)
        kinds = readers(folder)
        kinds = {kind: reader for kind, reader in kinds.items() if not names or kind in names}
        numbers = range(first, first + count)
        size = min(_CHUNK, -(-count // processes))
        chunks = [numbers[k : k + size] for k in range(0, count, size)]
        for part in map_cases(partial(run_mutants, kinds, folder), chunks, processes):
            runs += part
        table: dict[str, Counter[str]] = {kind: Counter() for kind in kinds}
        for run in runs:
            kind, name, file, _ = mutant(kinds, run.number)
            row = table[kind]
            row["mutants"] += 1
            row[{0: "built", None: "ended"}.get(run.code, "refused")] += 1
            row["misses"] += bool(run.miss)
            if run.miss:
                print(f"mutant {run.number} ({kind}, {file.name}, {name}): {run.miss}")
    misses = sum(row["misses"] for row in table.values())
    peak = max((run.peak for run in runs), default=0)
    print(f"\n{machine()}; {time.perf_counter() - began:.0f} s; at most {peak:.0f} MB")
    columns = Table("input | mutants | read or built | refused | misses")
    for kind, row in table.items():
        columns.add(kind, *(row[key] for key in ("mutants", "built", "refused", "misses")))
    return misses + (peak > MEMORY)


if __name__ == "__main__":
    counts = [int(word) for word in sys.argv[1:] if word.isdigit()]
    count, first, processes = (*counts, *(20000, 0, 2)[len(counts) :])
    chosen = [word for word in sys.argv[1:] if not word.isdigit()]
    sys.exit(1 if measure(count, first, processes, chosen) else 0)
