"""Ten questions about each drawn module or page, and the number of right answers.

    python -m docs.make.reading

A seed draws the modules of the lower folders, the modules of the upper folders and the pages, each
as they were before they were rewritten for easier reading. The questions in `reading/*.toml` were
written from the text of that commit, before any answer. Each was answered twice by a reader who saw
the module or page alone: the text of that commit ("before") and the rewritten text ("after"). The
answers and their verdicts are in `reading/*.tsv`.
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
#: Lines of the shortest text that is drawn: a shorter one has no ten questions.
SHORTEST = 60
#: Pages that are made from code, or that list the work done.
NOT_DRAWN = ("docs/api.md", "docs/messages.md", "docs/changelog.md")
TIMES = ("before", "after")
VERDICTS = ("right", "partly", "wrong")


class Question(Struct, frozen=True, forbid_unknown_fields=True):
    """A question about a text, with its reference answer from the code and its callers."""

    text: str
    answer: str


class Module(Struct, frozen=True, forbid_unknown_fields=True):
    """A module or page by its path at the base of its draw, with its questions."""

    path: str
    questions: tuple[Question, ...]


class Answer(Struct, frozen=True, forbid_unknown_fields=True):
    """An answer of a reader who saw the module or page alone.

    module: path at the base of its draw.
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


class Draw(Struct, frozen=True):
    """A draw of modules or pages from folders, and the names of the files about them.

    name: name of its files in `reading`, without suffix.
    base: commit from which texts are drawn, the last before any of them was rewritten.
    seed: seed of the random generator.
    folders: paths of the folders from the root of the repository.
    number: texts drawn from each folder.
    suffix: suffix of the names of files that are drawn.
    """

    name: str
    base: str
    seed: int
    folders: tuple[str, ...]
    number: int
    suffix: str = ".py"

    def list_texts(self) -> list[str]:
        """Paths of the drawn texts at `base`, read from the repository, sorted within a folder.

        Raises CalledProcessError if the repository does not have that commit.
        """
        generator = random.Random(self.seed)
        paths = []
        for folder in self.folders:
            pattern = f"{folder}/*{self.suffix}"
            command = ["git", "-C", str(ROOT), "grep", "-c", "", self.base, "--", pattern]
            result = subprocess.run(command, check=True, capture_output=True, encoding="utf-8")
            counted = [line.split(":")[1:] for line in result.stdout.splitlines()]
            long_enough = {path for path, lines in counted if int(lines) >= SHORTEST}
            paths += sorted(
                generator.sample(sorted(long_enough.difference(NOT_DRAWN)), self.number)
            )
        return paths

    def read_questions(self) -> list[Module]:
        """The texts with their questions, in the order of `list_texts`."""
        tables = tomllib.loads((DATA / f"{self.name}.toml").read_text(encoding="utf-8"))
        return msgspec.convert(tables["module"], list[Module])

    def read_answers(self) -> list[Answer]:
        """All answers, in the order of the file."""
        with (DATA / f"{self.name}.tsv").open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file, delimiter="\t", quoting=csv.QUOTE_NONE))
        return msgspec.convert(rows, list[Answer], strict=False)


_UPPER = (
    "plan",
    "order",
    "lower",
    "check",
    "post",
    "preview",
    "pipeline",
    "batch",
    "workbench",
    "cli",
)
_BEFORE_UPPER = "6e7297a25bc23c7882433d315d6a005bb2d74876"
DRAWS = (
    Draw(
        name="lower",
        base="61b51ed5098e802d2420d6a5398dd48e3df86e4a",
        seed=47,
        folders=tuple(
            f"camgen/{folder}"
            for folder in (
                "model",
                "geometry",
                "vision",
                "read",
                "robots",
                "collision",
                "motion",
                "localize",
            )
        ),
        number=3,
    ),
    Draw(
        "upper",
        _BEFORE_UPPER,
        48,
        (*(f"camgen/{folder}" for folder in _UPPER), "postprocessors", "bench"),
        2,
    ),
    Draw("pages", _BEFORE_UPPER, 48, ("docs",), 12, ".md"),
)


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
    """Prints the drawn texts, and the verdicts on the answers about them."""
    for draw in DRAWS:
        texts = draw.list_texts()
        print(f"Seed {draw.seed}, commit {draw.base[:8]}:")
        for path in texts:
            print(f"  {path}")
        if (DATA / f"{draw.name}.tsv").exists():
            print()
            print(format_results(texts, draw.read_answers()), end="")
        print()


if __name__ == "__main__":
    main()
