"""Ten questions about each of 24 modules: which modules they are, and how many answers are right.

    python -m docs.make.reading

The modules are drawn by a seed from the eight lower folders as they were at `BASE`, before these
folders were rewritten for easier reading. The questions in `reading/questions.toml` were written
from the code of that commit, before any answer. Each was answered twice by a reader who saw the
module alone: the text of `BASE` ("before") and the rewritten text ("after"). The answers and their
verdicts are in `reading/answers.tsv`.
"""

from __future__ import annotations

import csv
import random
import subprocess
import tomllib
from collections import Counter
from itertools import product
from pathlib import Path

import msgspec
from msgspec import Struct

ROOT = Path(__file__).parents[2]
DATA = Path(__file__).with_name("reading")
#: The last commit before any of the folders was rewritten.
BASE = "61b51ed5098e802d2420d6a5398dd48e3df86e4a"
FOLDERS = ("model", "geometry", "vision", "read", "robots", "collision", "motion", "localize")
#: Modules drawn from each folder.
DRAWN = 3
#: Lines of the shortest module that is drawn: a shorter one has no ten questions.
SHORTEST = 60
SEED = 47
TIMES = ("before", "after")
VERDICTS = ("right", "partly", "wrong")


class Question(Struct, frozen=True, forbid_unknown_fields=True):
    """A question about a module, with its reference answer from the code and its callers."""

    text: str
    answer: str


class Module(Struct, frozen=True, forbid_unknown_fields=True):
    """A module by its path at `BASE`, with its questions."""

    path: str
    questions: tuple[Question, ...]


class Answer(Struct, frozen=True, forbid_unknown_fields=True):
    """An answer of a reader who saw the module alone.

    module: path at `BASE`.
    question: number of the question in its module, from 1.
    when: "before" or "after" the rewrite.
    answer: the words of the reader.
    verdict: "right", "partly" or "wrong", by the reference answer.
    """

    module: str
    question: int
    when: str
    answer: str
    verdict: str


def draw_modules() -> list[str]:
    """Paths of the drawn modules at `BASE`, three per folder, read from the repository.

    Raises CalledProcessError if the repository does not have that commit.
    """
    generator = random.Random(SEED)
    paths = []
    for folder in FOLDERS:
        command = ["git", "-C", str(ROOT), "grep", "-c", "", BASE, "--", f"camgen/{folder}/*.py"]
        result = subprocess.run(command, check=True, capture_output=True, encoding="utf-8")
        counted = [line.split(":")[1:] for line in result.stdout.splitlines()]
        long_enough = sorted(path for path, lines in counted if int(lines) >= SHORTEST)
        paths += sorted(generator.sample(long_enough, DRAWN))
    return paths


def read_questions() -> list[Module]:
    """The modules with their questions, in the order of `draw_modules`."""
    tables = tomllib.loads((DATA / "questions.toml").read_text(encoding="utf-8"))
    return msgspec.convert(tables["module"], list[Module])


def read_answers() -> list[Answer]:
    """All answers, in the order of the file."""
    with (DATA / "answers.tsv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file, delimiter="\t", quoting=csv.QUOTE_NONE))
    return msgspec.convert(rows, list[Answer], strict=False)


def format_results(modules: list[str], answers: list[Answer]) -> str:
    """Markdown table: verdicts before and after, one row per module and one of their sums."""
    counts = Counter((row.module, row.when, row.verdict) for row in answers)
    columns = list(product(TIMES, VERDICTS))
    lines = [["module", *map(" ".join, columns)], ["---"] * (1 + len(columns))]
    sums = [0] * len(columns)
    for path in modules:
        numbers = [counts[path, when, verdict] for when, verdict in columns]
        sums = [total + number for total, number in zip(sums, numbers, strict=True)]
        lines.append([path, *map(str, numbers)])
    lines.append(["all", *map(str, sums)])
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)


def main() -> None:
    """Prints the drawn modules, and the verdicts on the answers about them."""
    modules = draw_modules()
    print(f"Seed {SEED}, commit {BASE[:8]}:")
    for path in modules:
        print(f"  {path}")
    print()
    print(format_results(modules, read_answers()), end="")


if __name__ == "__main__":
    main()
