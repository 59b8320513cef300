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
from concurrent.futures import ProcessPoolExecutor
from itertools import groupby, product
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

from bench.reliability.mutants import (
    CAUGHT,
    HARMLESS,
    LEFT,
    Family,
    describe,
    judge_mutant,
    plan_tasks,
)
from bench.reliability.mutations import Mutation
from bench.reliability.programs import SOURCES, make
from bench.reliability.wide_mutations import KINDS
from bench.support.runner import Missed, open_table

LIST = Path(__file__).with_name("mutants.tsv")
SEED = 44
#: Mutants of a post and kind: all posts and kinds take four minutes.
MOST = 3000
_PROCESSES, _CHUNK = 2, 200
#: Letters of the verdicts in the list. A crash is a read-back that ended with an error.
_LETTERS = {CAUGHT: "c", HARMLESS: "h", LEFT: "l"}
_CRASH = "x"
_WORDS = {letter: verdict for verdict, letter in _LETTERS.items()} | {_CRASH: "crash"}


class Program(NamedTuple):
    """The mutants of a program that are judged.

    family: post, kind and seed.
    number: index of the program in `SOURCES`.
    places: indices of its mutants.
    """

    family: Family
    number: int
    places: tuple[int, ...]

    @property
    def key(self) -> tuple[str, str, str]:
        """Kind, post and number, as in the list."""
        return self.family.kind, self.family.post, str(self.number)

    def list_mutants(self) -> list[Mutation]:
        """The mutants that are judged."""
        mutants = self.family.list_mutants(self.number)
        return [mutants[place] for place in self.places]

    def digest(self) -> str:
        """The first 16 digits of the SHA-256 of the text of the program and of the mutants."""
        lines = [make(self.family.post, self.number).text]
        for mutation in self.list_mutants():
            lines += [f"{edit.begin} {edit.end} {edit.new!r}" for edit in mutation.edits]
        return hashlib.sha256("\n".join(lines).encode()).hexdigest()[:16]


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


class Change(NamedTuple):
    """A mutant with another verdict than before.

    mutation: the mutant.
    before, now: letters of the verdicts.
    """

    mutation: Mutation
    before: str
    now: str


class Result(NamedTuple):
    """The verdicts on the mutants of a program.

    letters: letters of the verdicts.
    changes: mutants with another verdict than before; None if the list has other mutants.
    """

    program: Program
    letters: str
    changes: list[Change] | None


def list_programs(posts: list[str]) -> list[Program]:
    """The programs of posts with the mutants of the list."""
    families = [Family(post, kind, SEED) for kind, post in product(KINDS, posts)]
    places: dict[tuple[Family, int], list[int]] = {}
    for task in plan_tasks(families, MOST):
        group = places.setdefault((task.family, task.program), [])
        group.extend(range(task.first, task.last, task.step))
    return [Program(*key, tuple(indices)) for key, indices in places.items()]


def find_verdicts(program: Program) -> str:
    """The letters of the verdicts on the mutants of a program."""
    letters = []
    for mutation in program.list_mutants():
        verdict, crash = judge_mutant(program.family.post, program.number, mutation)
        letters.append(_CRASH if crash else _LETTERS[verdict])
    return "".join(letters)


def find_all_verdicts(programs: list[Program]) -> list[str]:
    """The letters of the verdicts of each program, judged by two processes."""
    pieces: list[tuple[int, Program]] = []
    for number, program in enumerate(programs):
        for first in range(0, len(program.places), _CHUNK):
            places = program.places[first : first + _CHUNK]
            pieces.append((number, program._replace(places=places)))
    letters = [""] * len(programs)
    with ProcessPoolExecutor(_PROCESSES, mp_context=get_context("fork")) as pool:
        judged = pool.map(find_verdicts, [piece for _, piece in pieces])
        for (number, _), verdicts in zip(pieces, judged, strict=True):
            letters[number] += verdicts
    return letters


def pack(letters: str) -> str:
    """Letters with the lengths of their runs: "ccch" is "c3h1"."""
    return "".join(f"{letter}{len(list(run))}" for letter, run in groupby(letters))


def unpack(text: str) -> str:
    """The letters of `pack`."""
    return "".join(letter * int(length) for letter, length in re.findall(r"([a-z])(\d+)", text))


def make_row(program: Program, letters: str) -> Row:
    """The row of a program with its verdicts."""
    counts = Counter(letters)
    name = SOURCES[program.family.post][program.number].name
    left = counts["l"] + counts[_CRASH]
    numbers = (len(letters), counts["c"], counts["h"], left)
    return Row._make([*program.key, name, *map(str, numbers), program.digest(), pack(letters)])


def read_rows() -> dict[tuple[str, str, str], Row]:
    """The rows of the list by kind, post and number."""
    if not LIST.exists():
        return {}
    lines = LIST.read_text(encoding="utf-8").splitlines()[1:]
    rows = [Row(*line.split("\t")) for line in lines]
    return {(row.kind, row.post, row.number): row for row in rows}


def compare(listed: Program, step: int, letters: str, row: Row | None) -> Result:
    """Compares the verdicts on each `step`-th mutant of a program with its row in the list."""
    program = listed._replace(places=listed.places[::step])
    if row is None or row.digest != listed.digest():
        return Result(program, letters, None)
    changes = []
    before = unpack(row.verdicts)[::step]
    for mutation, old, new in zip(program.list_mutants(), before, letters, strict=True):
        if old != new:
            changes.append(Change(mutation, old, new))
    return Result(program, letters, changes)


def main() -> int:
    """Prints the table and the changes."""
    arguments = _parse_arguments()
    posts = arguments.posts or list(SOURCES)
    step = arguments.every
    listed = list_programs(posts)
    judged = find_all_verdicts(
        [program._replace(places=program.places[::step]) for program in listed]
    )
    rows = read_rows()
    results = []
    for program, letters in zip(listed, judged, strict=True):
        results.append(compare(program, step, letters, rows.get(program.key)))
    table = open_table(
        "kind | post | mutants {:,} | caught {:,} | harmless {:,} | left over {:,} | "
        "other verdict | other mutants"
    )
    for kind in KINDS:
        for post in posts:
            group = [result for result in results if result.program.key[:2] == (kind, post)]
            table.add(kind, post, *_sum_up(group))
    for result in results:
        _print_changes(result)
    if arguments.accept:
        made_rows = [make_row(result.program, result.letters) for result in results]
        lines = ["\t".join(row) for row in (Row._make(Row._fields), *made_rows)]
        LIST.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return int(table.missed > 0)


def _sum_up(results: list[Result]) -> list[object]:
    """The cells of a kind and post. The last two are numbers of mutants and of programs."""
    counts = Counter("".join(result.letters for result in results))
    changed = sum(len(result.changes or ()) for result in results)
    others = sum(1 for result in results if result.changes is None)
    left = counts["l"] + counts[_CRASH]
    faults = [Missed(str(number)) if number else "0" for number in (changed, others)]
    return [counts.total(), counts["c"], counts["h"], left, *faults]


def _print_changes(result: Result) -> None:
    """Prints each mutant of a program with its verdicts before and now."""
    family, number, _ = result.program
    if result.changes is None:
        name = SOURCES[family.post][number].name
        print(f"\n{family.post}, {name}, {family.kind}: the list has other mutants")
        return
    for change in result.changes:
        mutant = describe(family, number, change.mutation)
        print(
            f"\n{family.post}, {mutant.program}, line {mutant.line}, {family.kind}: "
            f"{mutant.change}: {_WORDS[change.before]} before, {_WORDS[change.now]} now"
        )
        print(f"  was {mutant.was!r}\n  now {mutant.now!r}")


def _parse_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m bench.languages.mutants")
    posts = ", ".join(SOURCES)
    parser.add_argument("posts", nargs="*", metavar="POST", choices=[*SOURCES, []], help=posts)
    parser.add_argument("--every", type=int, default=1, metavar="N", help="each N-th mutant only")
    parser.add_argument("--accept", action="store_true", help="write mutants.tsv")
    arguments = parser.parse_args()
    if arguments.every < 1:
        parser.error("--every: give 1 or more")
    if arguments.accept and (arguments.posts or arguments.every > 1):
        parser.error("--accept: leave out the posts and --every")
    return arguments


if __name__ == "__main__":
    sys.exit(main())
