"""Programs with one change each: does the read-back refuse the change, or is it harmless?

    python -m bench.reliability.mutants [POST ...] [--kind KIND ...] [--most N] [--seed N]

There are four kinds of changes of the programs of `programs`:

- single (`mutations`): every token is changed, dropped, doubled and swapped, and every line is
  dropped, doubled and swapped.
- structural, global and paired (`wide_mutations`): see there.

Each mutant is read back and compared with the plan as a build does it. If a mutant passes, a
simulation of the modal state, written from the manuals (`modal`), runs it and the text without the
change. It is harmless if both have the same motions, outputs, waits, forces and settings within
the printed digits. Anything else is left over.

--most N takes N mutants of each post and kind, spread evenly over all of them. --seed N draws other
structural and global changes. The command prints a table for docs/reliability.md, then each mutant
that is left over, and exits with 1 if there is one.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import cache, partial
from multiprocessing import get_context
from typing import NamedTuple

from bench.reliability.modal import pacscript, rapid, reader, rs274, vplus
from bench.reliability.modal.machine import Event, is_same
from bench.reliability.mutations import Mutation
from bench.reliability.programs import SOURCES, Made, make
from bench.reliability.wide_mutations import KINDS, mutate
from bench.support.runner import open_table

TRACES: dict[str, Callable[[str], list[Event]]] = {
    "rapid": rapid.trace,
    "pacscript": pacscript.trace,
    "vplus": vplus.trace,
    "gcode": partial(rs274.trace, grbl=False),
    "grbl": partial(rs274.trace, grbl=True),
}
_PROCESSES, _CHUNK = 2, 500
CAUGHT, HARMLESS, LEFT = "caught", "harmless", "left over"


class Family(NamedTuple):
    """Mutants of a post that are counted in one row.

    post: name of the post
    kind: member of `KINDS`
    seed: number that draws the changes
    """

    post: str
    kind: str
    seed: int = 0

    def list_mutants(self, program: int) -> list[Mutation]:
        """The mutants of a program, by its index in `SOURCES`."""
        return _list_mutants(self, program)


class Task(NamedTuple):
    """The mutants `first`, `first + step`, ... before `last` of a program of a family."""

    family: Family
    program: int
    first: int
    last: int
    step: int


class LeftOver(NamedTuple):
    """A mutant that is neither caught nor harmless.

    family: kind of mutants
    program: name of its source
    line: first line with a change, from 1
    change: kind of the change
    was, now: lines with a change, without and with it
    crash: error that ended the read-back, empty without one
    """

    family: Family
    program: str
    line: int
    change: str
    was: str
    now: str
    crash: str = ""


#: Changes of a mutant that are listed.
_LISTED = 3


@cache
def _list_mutants(family: Family, program: int) -> list[Mutation]:
    return mutate(make(family.post, program).text, family.post, family.kind, family.seed)


def trace(post: str, made: Made, text: str) -> list[Event]:
    """What a program does with ``text`` in its place: of one file, or of a reader and its data."""
    return TRACES[post](text) if len(made.files) == 1 else reader.trace(*made.texts(text).values())


@cache
def _trace(post: str, program: int) -> list[Event]:
    made = make(post, program)
    return trace(post, made, made.text)


def judge_mutant(post: str, program: int, mutation: Mutation) -> tuple[str, str]:
    """The verdict on a mutant, and the error that ended its read-back, empty without one.

    program: index of its program in `SOURCES`.
    """
    source = make(post, program)
    text = mutation.apply(source.text)
    try:
        if source.is_caught(text):
            return CAUGHT, ""
    # A read-back that fails in any way has not judged its text. The other mutants are judged.
    except Exception as error:
        return LEFT, f"{type(error).__name__}: {error}"
    same = is_same(_trace(post, program), trace(post, source, text))
    return HARMLESS if same else LEFT, ""


def judge(task: Task) -> tuple[Family, Counter[str], list[LeftOver]]:
    """The verdicts on the mutants of one task."""
    counts, left = Counter[str](), list[LeftOver]()
    mutants = task.family.list_mutants(task.program)
    for mutation in mutants[task.first : task.last : task.step]:
        verdict, crash = judge_mutant(task.family.post, task.program, mutation)
        counts[verdict] += 1
        if verdict == LEFT:
            left.append(describe(task.family, task.program, mutation, crash))
    return task.family, counts, left


def describe(family: Family, program: int, mutation: Mutation, crash: str = "") -> LeftOver:
    """The first lines that a mutant of a program changes, before and after it."""
    text = make(family.post, program).text
    was, now = [], []
    for edit in mutation.edits[:_LISTED]:
        begin = text.rfind("\n", 0, edit.begin) + 1
        joined = "\n" in text[edit.begin : edit.end] and edit.begin > begin
        end = text.find("\n", edit.end if joined else max(edit.begin, edit.end - 1))
        end = len(text) if end < 0 else end
        was.append(text[begin:end].strip())
        now.append(f"{text[begin : edit.begin]}{edit.new}{text[edit.end : max(end, edit.end)]}")
    line = text.count("\n", 0, mutation.edits[0].begin) + 1
    name = SOURCES[family.post][program].name
    lines = " ... ".join(was), " ... ".join(text.strip() for text in now)
    return LeftOver(family, name, line, mutation.kind, *lines, crash)


def plan_tasks(families: list[Family], most: int) -> list[Task]:
    """The work in small pieces, family after family. most: mutants of each, 0 for all of them."""
    tasks: list[Task] = []
    for family in families:
        programs = range(len(SOURCES[family.post]))
        sizes = [len(family.list_mutants(k)) for k in programs]
        step = math.ceil(sum(sizes) / most) if most else 1
        for k, size in enumerate(sizes):
            for first in range(-sum(sizes[:k]) % step, size, _CHUNK * step):
                last = min(first + _CHUNK * step, size)
                tasks.append(Task(family, k, first, last, step))
    return tasks


def main() -> int:
    """Prints the table, then the mutants that are left over."""
    arguments = _parse_arguments()
    families = []
    for kind in arguments.kind or KINDS:
        families += [Family(post, kind, arguments.seed) for post in arguments.posts or SOURCES]
    counts: dict[Family, Counter[str]] = {family: Counter() for family in families}
    left: list[LeftOver] = []
    tasks = plan_tasks(families, arguments.most)
    with ProcessPoolExecutor(_PROCESSES, mp_context=get_context("fork")) as pool:
        for done, (family, verdicts, over) in enumerate(pool.map(judge, tasks), 1):
            counts[family] += verdicts
            left += over
            progress = f"\r{done} of {len(tasks)} pieces, {len(left)} left over"
            print(progress, end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    _print_table(counts)
    for mutant in left:
        crash = f" ({mutant.crash})" if mutant.crash else ""
        place = f"{mutant.family.post}, {mutant.program}, line {mutant.line}"
        print(f"\n{place}, {mutant.family.kind}: {mutant.change}{crash}")
        print(f"  was {mutant.was!r}\n  now {mutant.now!r}")
    return 1 if left else 0


def _parse_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m bench.reliability.mutants")
    posts = ", ".join(SOURCES)
    parser.add_argument("posts", nargs="*", metavar="POST", choices=[*SOURCES, []], help=posts)
    parser.add_argument("--kind", action="append", choices=KINDS, help="all kinds without it")
    parser.add_argument(
        "--most", type=int, default=0, metavar="N", help="mutants of a post and kind, 0: all"
    )
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="draws other changes")
    arguments = parser.parse_args()
    if arguments.most < 0:
        parser.error("--most: give 1 or more, or 0 for all")
    return arguments


def _print_table(counts: dict[Family, Counter[str]]) -> None:
    """Prints a row for each post and kind, and the sums."""
    figures = (
        f"programs {{:,}} | mutants {{:,}} | {CAUGHT} {{:,}} | {HARMLESS} {{:,}} | {LEFT} {{:,}}"
    )
    table = open_table(f"kind | post | {figures}")
    for family, verdicts in counts.items():
        table.add(family.kind, family.post, *_list_figures([family.post], verdicts))
    for kind in dict.fromkeys(family.kind for family in counts):
        rows = {family.post: counts[family] for family in counts if family.kind == kind}
        sums = sum(rows.values(), Counter[str]())
        table.add(kind, "all", *_list_figures(list(rows), sums))


def _list_figures(posts: list[str], verdicts: Counter[str]) -> list[int]:
    programs = sum(len(SOURCES[post]) for post in posts)
    return [programs, verdicts.total(), *(verdicts[key] for key in (CAUGHT, HARMLESS, LEFT))]


if __name__ == "__main__":
    sys.exit(main())
