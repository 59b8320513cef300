"""Programs with one change each: does the read-back see it, and if not, does it mean anything?

    python -m bench.reliability.mutants [POST ...] [--most N]

Every token of the programs of ``programs`` is changed, dropped, doubled and swapped, every line dropped, doubled and
swapped (``mutations``). Each mutant is read back and compared with the plan as a build does. One that passes is run by
a simulation of the modal state written from the manuals (``modal``), beside the text as it was: the same motions,
outputs, waits, forces and settings within the printed digits, and it is harmless; anything else is left over. --most:
so many mutants a post, spread evenly over all of them. Prints a table for docs/reliability.md, then each mutant that is
left over, and exits with 1 if there is one.
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

from bench.machine import machine
from bench.reliability.modal import pacscript, rapid, reader, rs274, vplus
from bench.reliability.modal.machine import Event, is_same
from bench.reliability.mutations import LANGUAGES, Edit, edits
from bench.reliability.programs import SOURCES, Made, make

TRACES: dict[str, Callable[[str], list[Event]]] = {
    "rapid": rapid.trace,
    "pacscript": pacscript.trace,
    "vplus": vplus.trace,
    "gcode": partial(rs274.trace, grbl=False),
    "grbl": partial(rs274.trace, grbl=True),
}
_PROCESSES, _CHUNK = 2, 500
CAUGHT, HARMLESS, LEFT = "caught", "harmless", "left over"


class Task(NamedTuple):
    """Mutants ``first``, ``first + step``, ... before ``last`` of a program."""

    post: str
    program: int
    first: int
    last: int
    step: int


class LeftOver(NamedTuple):
    """A mutant that is neither caught nor harmless. crash: of the read-back, which is no verdict."""

    post: str
    program: str
    line: int
    edit: str
    was: str
    now: str
    crash: str = ""


@cache
def _edits(post: str, program: int) -> list[Edit]:
    return edits(make(post, program).text, LANGUAGES[post])


def trace(post: str, made: Made, text: str) -> list[Event]:
    """What a program does with ``text`` in its place: of one file, or of a reader and its data."""
    return TRACES[post](text) if len(made.files) == 1 else reader.trace(*made.texts(text).values())


@cache
def _trace(post: str, program: int) -> list[Event]:
    made = make(post, program)
    return trace(post, made, made.text)


def judge(task: Task) -> tuple[str, Counter[str], list[LeftOver]]:
    """The verdicts on the mutants of one task."""
    made, counts, left = make(task.post, task.program), Counter[str](), list[LeftOver]()
    for edit in _edits(task.post, task.program)[task.first : task.last : task.step]:
        text, crash = edit.apply(made.text), ""
        try:
            verdict = CAUGHT if made.is_caught(text) else ""
        # A read-back that fails in any way at all has not judged its text: that is a finding, and the others go on.
        except Exception as error:
            verdict, crash = LEFT, f"{type(error).__name__}: {error}"
        if not verdict:
            same = is_same(_trace(task.post, task.program), trace(task.post, made, text))
            verdict = HARMLESS if same else LEFT
        counts[verdict] += 1
        if verdict == LEFT:
            left.append(_describe(task, made.text, edit, crash))
    return task.post, counts, left


def _describe(task: Task, text: str, edit: Edit, crash: str) -> LeftOver:
    """The lines that an edit touches, before and after it."""
    begin = text.rfind("\n", 0, edit.begin) + 1
    joined = "\n" in text[edit.begin : edit.end] and edit.begin > begin
    end = text.find("\n", edit.end if joined else max(edit.begin, edit.end - 1))
    end = len(text) if end < 0 else end
    now = text[begin : edit.begin] + edit.new + text[edit.end : max(end, edit.end)]
    line = text.count("\n", 0, edit.begin) + 1
    name = SOURCES[task.post][task.program].name
    return LeftOver(task.post, name, line, edit.kind, text[begin:end].strip(), now.strip(), crash)


def plan_tasks(posts: list[str], most: int) -> list[Task]:
    """The work in small pieces, the posts one after the other."""
    tasks: list[Task] = []
    for post in posts:
        sizes = [len(_edits(post, k)) for k in range(len(SOURCES[post]))]
        step = math.ceil(sum(sizes) / most) if most else 1
        for k, size in enumerate(sizes):
            firsts = range(-sum(sizes[:k]) % step, size, _CHUNK * step)
            tasks += (
                Task(post, k, first, min(first + _CHUNK * step, size), step) for first in firsts
            )
    return tasks


def main() -> int:
    """The table, and what is left over."""
    parser = argparse.ArgumentParser(prog="python -m bench.reliability.mutants")
    parser.add_argument(
        "posts", nargs="*", metavar="POST", choices=[*SOURCES, []], help=", ".join(SOURCES)
    )
    parser.add_argument(
        "--most", type=int, default=0, metavar="N", help="mutants a post at most; 0: all"
    )
    given = parser.parse_args()
    if given.most < 0:
        parser.error("--most: give 1 or more, or 0 for all")
    posts = given.posts or list(SOURCES)
    tasks = plan_tasks(posts, given.most)
    counts: dict[str, Counter[str]] = {post: Counter() for post in posts}
    left: list[LeftOver] = []
    with ProcessPoolExecutor(_PROCESSES, mp_context=get_context("fork")) as pool:
        for done, (post, found, over) in enumerate(pool.map(judge, tasks), 1):
            counts[post] += found
            left += over
            print(
                f"\r{done} of {len(tasks)} pieces, {len(left)} left over",
                end="",
                file=sys.stderr,
                flush=True,
            )
    print(file=sys.stderr)
    print(machine(), end="\n\n")
    print(f"| post | programs | made | {CAUGHT} | {HARMLESS} | {LEFT} |\n|---|---|---|---|---|---|")
    total = sum(counts.values(), Counter[str]())
    for post, row in [*counts.items(), ("all", total)]:
        programs = sum(len(SOURCES[each]) for each in (posts if post == "all" else [post]))
        print(
            f"| {post} | {programs} | {row.total():,} | {row[CAUGHT]:,} | {row[HARMLESS]:,} | {row[LEFT]:,} |"
        )
    for one in left:
        crash = f" ({one.crash})" if one.crash else ""
        print(
            f"\n{one.post}, {one.program}, line {one.line}, {one.edit}{crash}\n  was {one.was!r}\n  now {one.now!r}"
        )
    return 1 if left else 0


if __name__ == "__main__":
    sys.exit(main())
