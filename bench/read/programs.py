"""Programs that others wrote, run by the interpreters of their languages: python -m bench.read.programs FOLDER...

A row for each folder below FOLDER, which is a project: its programs by language, each text once; how many have nothing
to begin with (libraries and headers), how many are run to their end, how many of these with assumptions, how many
cannot be run on, and in how many something is refused by their controller; and the time. ``--why`` lists the reasons
with their files. What a program needs of others in its folder is not given to it: what they hold is assumed, as
``camgen verify`` does with one file.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

from bench.support.runner import open_table
from bench.support.timing import timed
from camgen.lang.programs import Ask, Executed, Language, list_languages


class Ran(NamedTuple):
    """A program and what came of it."""

    file: Path
    language: str
    executed: Executed
    seconds: float


def languages_of(file: Path, text: str) -> list[Language]:
    """The languages that a text looks like, or that its name says."""
    every = list_languages()
    return [one for one in every if one.recognise(text)] or [
        one for one in every if file.suffix.lower() in one.suffixes
    ]


def run_all(folder: Path, seen: set[bytes]) -> Iterator[Ran]:
    """All programs below ``folder`` whose text is not among those seen."""
    for file in sorted(path for path in folder.rglob("*") if path.is_file()):
        data = file.read_bytes()
        if b"\0" in data or not data.strip() or data in seen:
            continue
        seen.add(data)
        text = data.decode("latin-1").replace("\r\n", "\n").replace("\r", "\n")
        for language in languages_of(file, text)[:1]:
            executed, seconds = timed(partial(language.run, {file.name: text}, Ask()))
            yield Ran(file, language.name, executed, seconds)


def measure(name: str, ran: list[Ran]) -> list[object]:
    """The cells of a project."""
    library = [one for one in ran if is_library(one)]
    stopped = [one for one in ran if one.executed.stopped and not is_library(one)]
    whole = [one for one in ran if not one.executed.stopped]
    assumed = [one for one in whole if one.executed.assumed]
    refused = [
        one for one in ran if any(found.level == "refused" for found in one.executed.findings)
    ]
    kinds = ", ".join(sorted({one.language for one in ran}))
    seconds = sum(one.seconds for one in ran)
    groups = ran, library, whole, assumed, stopped, refused
    return [name, kinds, *map(len, groups), seconds]


def is_library(one: Ran) -> bool:
    """Whether nothing says where a program begins: it holds no routine, or several and no main one."""
    return one.executed.stopped is not None and one.executed.stopped[1].startswith("there is no")


def reasons(ran: list[Ran]) -> Iterator[str]:
    """Why programs cannot be run on, and what is refused first."""
    for one in ran:
        if one.executed.stopped and not is_library(one):
            line, what = one.executed.stopped
            yield f"{one.file}:{line}: stopped: {what}"
        refused = [found for found in one.executed.findings if found.level == "refused"]
        for found in refused[:1]:
            yield f"{one.file}:{found.line}: refused ({len(refused)}): {found.what}"


def main() -> None:
    """The table."""
    why = "--why" in sys.argv
    folders = [Path(name) for name in sys.argv[1:] if name != "--why"]
    table = open_table(
        "project | language | programs | no start | to the end | assumptions | stopped | refused "
        "| s {:.1f}"
    )
    seen: set[bytes] = set()
    every: list[Ran] = []
    for folder in folders:
        for project in sorted(path for path in folder.iterdir() if path.is_dir()) or [folder]:
            ran = list(run_all(project, seen))
            every += ran
            if ran:
                table.add(*measure(project.name, ran))
    table.add(*measure("all", every))
    if why:
        print("\n" + "\n".join(reasons(every)))


if __name__ == "__main__":
    main()
