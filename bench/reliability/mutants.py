"""Programs with one change each: does the read-back refuse the change, or is it harmless?

    python -m bench.reliability.mutants [POST ...] [--kind KIND ...] [--most N] [--seed N]
    python -m bench.reliability.mutants [POST ...] --list [--every N] [--accept]

There are four kinds of changes of the programs of `programs`:

- single (`mutations`): every token is changed, dropped, doubled and swapped, and every line is
  dropped, doubled and swapped.
- structural, global and paired (`wide_mutations`): see there.

Each mutant is read back and compared with the plan as a build does it. If a mutant passes, a
simulation of the modal state, written from the manuals (`modal`), runs it and the text without the
change. It is harmless if both have the same motions, outputs, waits, forces and settings within
the printed digits. Any other mutant is left over, and so is one whose read-back ends with an error.

--most N takes N mutants of each post and kind, spread evenly over all of them. --seed N draws other
structural and global changes. The command prints a table for docs/reliability.md, then each mutant
that is left over, and exits with 1 if there is one.

--list takes 3,000 mutants of each post and kind by the seed 44. `mutants.tsv` has the verdict on
each of them, a row for each program of a post. A mutant whose verdict is not that of the list is
printed, too. A row cannot be compared if its mutants are others: the post prints another text, or
the rule of the mutants has changed. Such a row is named. --every N judges each N-th of these
mutants only, --accept writes the list.
"""

from __future__ import annotations

import argparse
import hashlib
import math
import re
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import cache, partial
from itertools import groupby
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

from bench.reliability.modal import pacscript, rapid, reader, rs274, vplus
from bench.reliability.modal.machine import Event, is_same
from bench.reliability.mutations import Mutation
from bench.reliability.programs import SOURCES, PostedProgram, make
from bench.reliability.wide_mutations import KINDS, mutate
from bench.support.runner import open_table

TRACES: dict[str, Callable[[str], list[Event]]] = {
    "rapid": rapid.trace,
    "pacscript": pacscript.trace,
    "vplus": vplus.trace,
    "gcode": partial(rs274.trace, grbl=False),
    "grbl": partial(rs274.trace, grbl=True),
}
#: Processes, and mutants that one of them judges at a time.
_PROCESSES, _CHUNK = 2, 500
#: Letters of the verdicts. A mutant is "x" if its read-back ended with an error.
CAUGHT, HARMLESS, LEFT, CRASH = "c", "h", "l", "x"
WORDS = {CAUGHT: "caught", HARMLESS: "harmless", LEFT: "left over", CRASH: "read-back failed"}
#: Changes of a mutant that are listed.
_LISTED = 3
LIST = Path(__file__).with_suffix(".tsv")
#: Seed and number of the mutants of the list.
LIST_SEED, LIST_MOST = 44, 3000


class Family(NamedTuple):
    """Mutants of a post that are counted in one row.

    post: name of the post
    kind: member of `KINDS`
    seed: number that draws the changes
    """

    post: str
    kind: str
    seed: int = 0


class Batch(NamedTuple):
    """Mutants of a program.

    family: kind of its mutants
    program: index of the program in `SOURCES`
    places: indices of these mutants among all of the program
    """

    family: Family
    program: int
    places: range

    @property
    def name(self) -> str:
        """Name of the source of the program."""
        return SOURCES[self.family.post][self.program].name

    def list_mutants(self) -> list[Mutation]:
        """The mutants of the batch."""
        mutants = list_mutants(self.family, self.program)
        return [mutants[place] for place in self.places]


@cache
def list_mutants(family: Family, program: int) -> list[Mutation]:
    """All mutants of a program, given by its index in `SOURCES`."""
    return mutate(make(family.post, program).text, family.post, family.kind, family.seed)


def trace(post: str, source: PostedProgram, text: str) -> list[Event]:
    """The trace of a program with another text. It has one file, or a reader and its data."""
    if len(source.files) == 1:
        return TRACES[post](text)
    return reader.trace(*source.replace_text(text).values())


@cache
def _trace_source(post: str, program: int) -> list[Event]:
    source = make(post, program)
    return trace(post, source, source.text)


def find_verdicts(batch: Batch) -> str:
    """The letters of the verdicts on the mutants of a batch."""
    post, program = batch.family.post, batch.program
    source = make(post, program)
    letters = ""
    for mutation in batch.list_mutants():
        text = mutation.apply(source.text)
        try:
            is_caught = source.is_caught(text)
        # A read-back that fails in any way has not judged its text. The other mutants are judged.
        except Exception:
            letters += CRASH
            continue
        if is_caught:
            letters += CAUGHT
        elif is_same(_trace_source(post, program), trace(post, source, text)):
            letters += HARMLESS
        else:
            letters += LEFT
    return letters


def find_all_verdicts(batches: Sequence[Batch]) -> list[str]:
    """The letters of each batch, judged by two processes."""
    pieces: list[tuple[int, Batch]] = []
    for number, batch in enumerate(batches):
        for first in range(0, len(batch.places), _CHUNK):
            places = batch.places[first : first + _CHUNK]
            pieces.append((number, batch._replace(places=places)))
    letters = [""] * len(batches)
    with ProcessPoolExecutor(_PROCESSES, mp_context=get_context("fork")) as pool:
        judged = pool.map(find_verdicts, [piece for _, piece in pieces])
        for done, ((number, _), verdicts) in enumerate(zip(pieces, judged, strict=True), 1):
            letters[number] += verdicts
            print(f"\r{done} of {len(pieces)} pieces", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    return letters


def describe(batch: Batch, mutation: Mutation, verdict: str = "") -> str:
    """The place of a mutant, and the first lines that it changes, before and after.

    verdict: words after the change
    """
    text = make(batch.family.post, batch.program).text
    before, after = [], []
    for edit in mutation.edits[:_LISTED]:
        begin = text.rfind("\n", 0, edit.begin) + 1
        is_joined = "\n" in text[edit.begin : edit.end] and edit.begin > begin
        end = text.find("\n", edit.end if is_joined else max(edit.begin, edit.end - 1))
        end = len(text) if end < 0 else end
        before.append(text[begin:end].strip())
        changed = f"{text[begin : edit.begin]}{edit.new}{text[edit.end : max(end, edit.end)]}"
        after.append(changed.strip())
    line = text.count("\n", 0, mutation.edits[0].begin) + 1
    place = f"{batch.family.post}, {batch.name}, line {line}, {batch.family.kind}"
    lines = f"  was {' ... '.join(before)!r}\n  now {' ... '.join(after)!r}"
    return f"{place}: {mutation.kind}{verdict}\n{lines}"


def plan_batches(families: Sequence[Family], limit: int) -> list[Batch]:
    """A batch for each program of each family with mutants that are spread evenly.

    A program without any of them has no batch.

    limit: number of mutants of a family, 0 for all of them
    """
    batches = []
    for family in families:
        programs = range(len(SOURCES[family.post]))
        sizes = [len(list_mutants(family, program)) for program in programs]
        step = math.ceil(sum(sizes) / limit) if limit else 1
        for program, size in enumerate(sizes):
            places = range(-sum(sizes[:program]) % step, size, step)
            if places:
                batches.append(Batch(family, program, places))
    return batches


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


def find_changes(batch: Batch, letters: str, row: Row | None, step: int = 1) -> list[str]:
    """A description of each mutant with another verdict than in its row of the list.

    batch: all mutants of the row.
    letters: verdicts on each `step`-th of them.
    """
    if row is None or row.digest != digest(batch):
        family = batch.family
        return [f"{family.post}, {batch.name}, {family.kind}: the list has other mutants"]
    changes = []
    mutants, before = batch.list_mutants()[::step], unpack(row.verdicts)[::step]
    for mutation, old, new in zip(mutants, before, letters, strict=True):
        if old != new:
            changes.append(describe(batch, mutation, f": {WORDS[old]} before, {WORDS[new]} now"))
    return changes


def main() -> int:
    """Prints the table, then the mutants that are left over or differ from the list."""
    arguments = _parse_arguments()
    seed, limit = arguments.seed, arguments.most
    if arguments.list:
        seed, limit = LIST_SEED, LIST_MOST
    families = []
    for kind in arguments.kind or KINDS:
        families += [Family(post, kind, seed) for post in arguments.posts or SOURCES]
    step = arguments.every
    batches = plan_batches(families, limit)
    thinned = [batch._replace(places=batch.places[::step]) for batch in batches]
    judged = find_all_verdicts(thinned)
    counts: dict[Family, Counter[str]] = {family: Counter() for family in families}
    texts = []
    for batch, letters in zip(thinned, judged, strict=True):
        counts[batch.family].update(letters)
        for mutation, letter in zip(batch.list_mutants(), letters, strict=True):
            if letter in (LEFT, CRASH):
                texts.append(describe(batch, mutation, f" ({WORDS[letter]})"))
    if arguments.list:
        rows = read_rows()
        for batch, letters in zip(batches, judged, strict=True):
            row = rows.get((batch.family.kind, batch.family.post, str(batch.program)))
            texts += find_changes(batch, letters, row, step)
    _print_table(counts)
    for text in texts:
        print(f"\n{text}")
    if arguments.accept:
        written = [Row._fields, *map(make_row, batches, judged)]
        LIST.write_text("\n".join(map("\t".join, written)) + "\n", encoding="utf-8")
    return int(bool(texts))


def _parse_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m bench.reliability.mutants")
    posts = ", ".join(SOURCES)
    parser.add_argument("posts", nargs="*", metavar="POST", choices=[*SOURCES, []], help=posts)
    parser.add_argument("--kind", action="append", choices=KINDS, help="all kinds without it")
    parser.add_argument(
        "--most", type=int, default=0, metavar="N", help="mutants of a post and kind, 0: all"
    )
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="draws other changes")
    parser.add_argument("--list", action="store_true", help="compare with mutants.tsv")
    parser.add_argument("--every", type=int, default=1, metavar="N", help="each N-th mutant only")
    parser.add_argument("--accept", action="store_true", help="write mutants.tsv")
    arguments = parser.parse_args()
    if arguments.accept and (arguments.posts or arguments.kind or arguments.every > 1):
        parser.error("--accept: leave out the posts, --kind and --every")
    return arguments


def _print_table(counts: dict[Family, Counter[str]]) -> None:
    """Prints a row for each post and kind, and the sums."""
    table = open_table(
        "kind | post | programs {:,} | mutants {:,} | caught {:,} | harmless {:,} | left over {:,}"
    )
    for family, letters in counts.items():
        table.add(family.kind, family.post, len(SOURCES[family.post]), *list_counts(letters))
    for kind in dict.fromkeys(family.kind for family in counts):
        posts = [family.post for family in counts if family.kind == kind]
        total: Counter[str] = Counter()
        for family, letters in counts.items():
            if family.kind == kind:
                total += letters
        programs = sum(len(SOURCES[post]) for post in posts)
        table.add(kind, "all", programs, *list_counts(total))


def list_counts(letters: Counter[str]) -> tuple[int, int, int, int]:
    """The numbers of mutants: all, caught, harmless, and left over with those that crash."""
    left = letters[LEFT] + letters[CRASH]
    return letters.total(), letters[CAUGHT], letters[HARMLESS], left


if __name__ == "__main__":
    sys.exit(main())
