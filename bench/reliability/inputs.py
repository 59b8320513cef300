"""Damaged inputs of each kind: programs or lines for the user.

    python -m bench.reliability.inputs [MUTANTS, 20000] [FIRST, 0] [PROCESSES, 2] [READER ...]

A mutant is one of the fixtures, or a small file that is made here, with one change: a byte changed,
bytes dropped, doubled, inserted or swapped, the end cut off, a number that becomes huge, tiny,
negative or no number, a line doubled or moved. A number always gives the same mutant. Each is given
to the command line with limits of time and memory. A run is good if it prints one line and writes
nothing (exit code 2 or 3), or if it writes a program that was read back (exit code 0). A miss is a
traceback or exit code 1, exit code 4, a signal, no end, a file that is left after a failure, more
than one line, or a warning of a library. The command prints the misses and a table for
docs/reliability.md, and exits with 1 if there is a miss.
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
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import NamedTuple

import cv2
import trimesh

from bench.reliability.commands import Ending, find_fault, map_cases, run_alone
from bench.support.children import Limits
from bench.support.runner import PARTS, ROOT, Table, machine, read_words, select

#: Address space of a process, and time of a command.
LIMITS = Limits(memory=8 * 1024**3, clock=30.0)
#: Memory in use that is a miss, MB.
MEMORY_MB = 2 * 1024**3 / 1e6
POSTS = {"rapid": "mod", "pacscript": "pcs", "vplus": "v2", "gcode": "ngc", "grbl": "nc"}
_CASES = ROOT / "fixtures" / "cases"
_BUILD = ("build", "--post", "gcode")
_OUTPUTS = 'post.signals={dout0="doTool",spindle="aoSpindle"}'
_NUMBER = re.compile(rb"-?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
_NUMBERS = tuple(b"1e308 -1 0 nan 1e-300 99999999999999999999 -0.0 2147483648 inf ".split(b" "))
_INSERTED = (
    *(b"\x00", b"\xff\xfe", b"\n", b"(", b"\xe2\x98\x83"),
    *(b"%", b"'", b"<!--", bytes(300), b"\x1a"),
)


class Reader(NamedTuple):
    """A command that reads a kind of input.

    words: command line, with {} for the input.
    files: sound inputs.
    """

    words: tuple[str, ...]
    files: tuple[Path, ...]


def list_readers(folder: Path) -> dict[str, Reader]:
    """The damaged kinds of inputs.

    folder: takes the files that no fixture has.
    """
    gear = cv2.resize(cv2.imread(str(PARTS / "gear.png"), cv2.IMREAD_GRAYSCALE), (160, 160))
    pictures = [PARTS / "gear.png", folder / "gear.pgm", folder / "gear.bmp"]
    for picture in pictures[1:]:
        cv2.imwrite(str(picture), gear)
    box = trimesh.creation.box((30, 20, 10))
    meshes = [folder / f"box.{suffix}" for suffix in ("stl", "ply", "obj", "off", "glb")]
    for mesh in meshes:
        box.export(mesh)
    shutil.copy(_CASES / "bracket-deburr" / "job.toml", folder / "job.toml")
    drawings = ("bracket", "layers", "blocks", "smooth", "gaps", "bracket_binary")
    trace = ("--set", "operation.kind=trace")
    scale = ("--set", "image.mm_per_px=0.1")
    job = ("build", str(PARTS / "bracket.dxf"), "--post", "rapid")
    force = ("--set", "post.force_calibrated=true", "--job", "{}")
    kinds = {
        "DXF": Reader((*_BUILD, "{}"), tuple(PARTS / f"{name}.dxf" for name in drawings)),
        "SVG": Reader((*_BUILD, *trace, "{}"), (PARTS / "logo.svg",)),
        "picture": Reader((*_BUILD, *trace, *scale, "{}"), tuple(pictures)),
        "mesh": Reader(("inspect", "{}"), tuple(meshes)),
        "STEP": Reader(("inspect", "{}"), (PARTS / "rfa1.step", PARTS / "rfa2.step")),
        "G-code": Reader(("build", "--post", "rapid", "--set", _OUTPUTS, "{}"), _programs("ngc")),
        "job": Reader((*job, *force), (folder / "job.toml",)),
    }
    for post, suffix in POSTS.items():
        kinds[f"verify {post}"] = Reader(("verify", "{}", "--post", post), _programs(suffix))
    return kinds


def _programs(suffix: str) -> tuple[Path, ...]:
    names = ("bracket-follow", "plate-drill", "bracket-deburr")
    return tuple(_CASES / name / "expected" / f"part.{suffix}" for name in names)


# The changes of a file. Each takes the bytes and a source of chance.

Mutation = Callable[[bytes, random.Random], bytes]


def _change(data: bytes, chance: random.Random) -> bytes:
    place = chance.randrange(len(data))
    return data[:place] + bytes([chance.randrange(256)]) + data[place + 1 :]


def _drop(data: bytes, chance: random.Random) -> bytes:
    place = chance.randrange(len(data))
    return data[:place] + data[place + chance.choice((1, 2, 16, 200)) :]


def _double(data: bytes, chance: random.Random) -> bytes:
    place, size = chance.randrange(len(data)), chance.choice((1, 8, 64, 500))
    return data[: place + size] + data[place:]


def _insert(data: bytes, chance: random.Random) -> bytes:
    place = chance.randrange(len(data))
    return data[:place] + chance.choice(_INSERTED) + data[place:]


def _swap(data: bytes, chance: random.Random) -> bytes:
    first, second = sorted(chance.randrange(len(data)) for _ in range(2))
    size = min(chance.choice((1, 4, 40)), second - first)
    swapped = bytearray(data)
    swapped[first : first + size] = data[second : second + size]
    swapped[second : second + size] = data[first : first + size]
    return bytes(swapped)


def _cut(data: bytes, chance: random.Random) -> bytes:
    return data[: chance.randrange(len(data))]


def _replace_number(data: bytes, chance: random.Random) -> bytes:
    numbers = list(_NUMBER.finditer(data[:100_000]))
    if not numbers:
        return _change(data, chance)
    number = chance.choice(numbers)
    return data[: number.start()] + chance.choice(_NUMBERS) + data[number.end() :]


def _move_line(data: bytes, chance: random.Random) -> bytes:
    """Doubles a line at another place, or moves it there."""
    lines = data.split(b"\n")
    source, target = chance.randrange(len(lines)), chance.randrange(len(lines))
    line = lines[source] if chance.random() < 0.5 else lines.pop(source)
    lines.insert(target, line)
    return b"\n".join(lines)


MUTATIONS: dict[str, Mutation] = {
    "byte changed": _change,
    "dropped": _drop,
    "doubled": _double,
    "put in": _insert,
    "swapped": _swap,
    "cut off": _cut,
    "number": _replace_number,
    "line": _move_line,
}


class Mutant(NamedTuple):
    """A damaged input.

    kind: key of its reader.
    change: key of `MUTATIONS`.
    file: the sound input.
    data: the damaged bytes.
    """

    kind: str
    change: str
    file: Path
    data: bytes


def make_mutant(kinds: Mapping[str, Reader], number: int) -> Mutant:
    """The mutant of a number."""
    chance = random.Random(number)
    kind = list(kinds)[number % len(kinds)]
    file = chance.choice(kinds[kind].files)
    change = list(MUTATIONS)[(number // len(kinds)) % len(MUTATIONS)]
    return Mutant(kind, change, file, MUTATIONS[change](file.read_bytes(), chance))


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


def run_mutant(kinds: Mapping[str, Reader], number: int) -> Run:
    """Runs the command of a mutant. Files that commands other than a build leave do not count."""
    mutant = make_mutant(kinds, number)
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / mutant.file.name
        source.write_bytes(mutant.data)
        words = [word.replace("{}", str(source)) for word in kinds[mutant.kind].words]
        ending = run_alone(words, LIMITS)
    if words[0] != "build":
        ending = ending._replace(left=())
    return Run(number, ending.code, _find_miss(ending), ending.peak)


def _find_miss(ending: Ending) -> str:
    if ending.signal == signal.SIGXCPU:
        return f"no end within {LIMITS.clock:.0f} s"
    # The findings of verify are lines of an answer, not errors.
    is_answer = not ending.errors or "read back" not in ending.messages
    return find_fault(ending, (0, 2, 3, 4) if is_answer else (0, 2, 3))


def measure(count: int, first: int, processes: int, *names: str) -> int:
    """Prints the misses and the table. Returns the number of misses."""
    start = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        kinds = list_readers(Path(folder))
        kinds = {kind: kinds[kind] for kind in select(kinds, names)}
        table: dict[str, Counter[str]] = {kind: Counter() for kind in kinds}
        peak = 0.0
        numbers = range(first, first + count)
        for run in map_cases(partial(run_mutant, kinds), numbers, processes):
            mutant = make_mutant(kinds, run.number)
            row = table[mutant.kind]
            row["mutants"] += 1
            row[{0: "built", None: "ended"}.get(run.code, "refused")] += 1
            row["misses"] += bool(run.miss)
            peak = max(peak, run.peak)
            if run.miss:
                place = f"{mutant.kind}, {mutant.file.name}, {mutant.change}"
                print(f"mutant {run.number} ({place}): {run.miss}")
    print(f"\n{machine()}; {time.perf_counter() - start:.0f} s; at most {peak:.0f} MB")
    columns = Table("input | mutants | read or built | refused | misses")
    for kind, row in table.items():
        columns.add(kind, *(row[key] for key in ("mutants", "built", "refused", "misses")))
    return sum(row["misses"] for row in table.values()) + (peak > MEMORY_MB)


if __name__ == "__main__":
    sys.exit(measure(*read_words(20000, 0, 2)) > 0)
