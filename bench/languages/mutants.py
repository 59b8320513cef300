"""Verdicts on mutants of the posts' programs, compared with those of before.

    python -m bench.languages.mutants [POST ...] [--every N] [--accept]

`mutants.tsv` has the verdicts on up to 3,000 mutants of each post and kind of
`bench.reliability.mutants`, spread evenly and drawn by the seed 44: a row for each program of a
post with the verdict on each of its mutants. The command judges the same mutants again and lists
each that has another verdict. A row cannot be compared if its mutants are others: the post prints
another text, or the rule of the mutants has changed. Such a row is named.

--every N: judge each N-th of these mutants only.
--accept: write `mutants.tsv`, all of it.

The exit code is 1 if a verdict or a row is another one.
"""

from __future__ import annotations

import argparse
import hashlib
import re
import sys
from collections import Counter
from itertools import groupby, product
from pathlib import Path
from typing import NamedTuple

from bench.reliability.mutants import (
    WORDS,
    Batch,
    Family,
    describe,
    find_all_verdicts,
    list_counts,
    plan_batches,
)
from bench.reliability.programs import SOURCES, make
from bench.reliability.wide_mutations import KINDS
from bench.support.runner import must_be_none, open_table

LIST = Path(__file__).with_name("mutants.tsv")
SEED = 44
#: Mutants of a post and kind: all posts and kinds take four minutes.
MOST = 3000


class Row(NamedTuple):
    """A row of `mutants.tsv`.

    kind, post, number: the program.
    name: name of its source.
    mutants, caught, harmless, left: numbers of mutants.
    digest: digest of the program and its mutants.
    verdicts: letters of the verdicts in order, each with the length of its run.
    """

    kind: str
    post: str
    number: str
    name: str
    mutants: str
    caught: str
    harmless: str
    left: str
    digest: str
    verdicts: str


def list_batches(posts: list[str]) -> list[Batch]:
    """The mutants of the list, a batch for each program of the posts."""
    return plan_batches([Family(post, kind, SEED) for kind, post in product(KINDS, posts)], MOST)


def digest(batch: Batch) -> str:
    """The first 16 digits of the SHA-256 of the text of a program and of its mutants."""
    lines = [make(batch.family.post, batch.program).text]
    for mutation in batch.list_mutants():
        lines += [f"{edit.begin} {edit.end} {edit.new!r}" for edit in mutation.edits]
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()[:16]


def pack(letters: str) -> str:
    """Letters with the lengths of their runs: "ccch" is "c3h1"."""
    return "".join(f"{letter}{len(list(run))}" for letter, run in groupby(letters))


def unpack(text: str) -> str:
    """The letters of `pack`."""
    return "".join(letter * int(length) for letter, length in re.findall(r"([a-z])(\d+)", text))


def make_row(batch: Batch, letters: str) -> Row:
    """The row of a program with its verdicts."""
    family = batch.family
    numbers = map(str, list_counts(Counter(letters)))
    program = family.kind, family.post, str(batch.program), batch.name
    return Row(*program, *numbers, digest(batch), pack(letters))


def read_rows() -> dict[tuple[str, ...], Row]:
    """The rows of the list by kind, post and number."""
    lines = LIST.read_text(encoding="utf-8").splitlines()[1:]
    rows = [Row(*line.split("\t")) for line in lines]
    return {row[:3]: row for row in rows}


def find_changes(batch: Batch, letters: str, row: Row | None, step: int = 1) -> list[str] | None:
    """A description of each mutant with another verdict than in its row of the list.

    None if the list has other mutants.

    batch: all mutants of the row.
    letters: verdicts on each `step`-th of them.
    """
    if row is None or row.digest != digest(batch):
        return None
    changes = []
    mutants, before = batch.list_mutants()[::step], unpack(row.verdicts)[::step]
    for mutation, old, new in zip(mutants, before, letters, strict=True):
        if old != new:
            changes.append(describe(batch, mutation, f": {WORDS[old]} before, {WORDS[new]} now"))
    return changes


def main() -> int:
    """Prints the table and the changes."""
    arguments = _parse_arguments()
    step = arguments.every
    batches = list_batches(arguments.posts or list(SOURCES))
    judged = find_all_verdicts([batch._replace(places=batch.places[::step]) for batch in batches])
    rows = read_rows()
    counts: dict[Family, Counter[str]] = {}
    texts = []
    for batch, letters in zip(batches, judged, strict=True):
        family = batch.family
        count = counts.setdefault(family, Counter())
        count.update(letters)
        row = rows.get((family.kind, family.post, str(batch.program)))
        changes = find_changes(batch, letters, row, step)
        if changes is None:
            count["others"] += 1
            texts.append(f"{family.post}, {batch.name}, {family.kind}: the list has other mutants")
        else:
            count["changes"] += len(changes)
            texts += changes
    table = open_table(
        "kind | post | mutants {:,} | caught {:,} | harmless {:,} | left over {:,} | "
        "other verdict | other mutants"
    )
    for family, count in counts.items():
        faults = [must_be_none(count.pop(key, 0)) for key in ("changes", "others")]
        table.add(family.kind, family.post, *list_counts(count), *faults)
    for text in texts:
        print(f"\n{text}")
    if arguments.accept:
        written = [Row._fields, *map(make_row, batches, judged)]
        LIST.write_text("\n".join(map("\t".join, written)) + "\n", encoding="utf-8")
    return int(table.missed > 0)


def _parse_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m bench.languages.mutants")
    posts = ", ".join(SOURCES)
    parser.add_argument("posts", nargs="*", metavar="POST", choices=[*SOURCES, []], help=posts)
    parser.add_argument("--every", type=int, default=1, metavar="N", help="each N-th mutant only")
    parser.add_argument("--accept", action="store_true", help="write mutants.tsv")
    arguments = parser.parse_args()
    if arguments.accept and (arguments.posts or arguments.every > 1):
        parser.error("--accept: leave out the posts and --every")
    return arguments


if __name__ == "__main__":
    sys.exit(main())
