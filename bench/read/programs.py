"""Programs that others wrote, run by the interpreters of their languages.

    python -m bench.read.programs FOLDER... [--why]

Each folder below FOLDER is a project and has a row:

- its languages, and its programs, each text once
- programs without a start (libraries and headers)
- programs that run to their end, and the number of these that rest on assumptions
- programs that stop, and programs in which the controller would refuse something
- seconds

``--why`` lists the reasons with their files. A program runs alone, without the other files of its
folder: their content is assumed, as ``camgen verify`` does with one file.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

from bench.support.runner import open_table
from bench.support.timing import timed
from camgen.lang.programs import Executed, Finding, Language, RunRequest, list_languages


class Run(NamedTuple):
    """A program that was run."""

    file: Path
    language: str
    executed: Executed
    seconds: float

    @property
    def is_library(self) -> bool:
        """Whether the text has no start: no routine, or several and none of them the main one."""
        stopped = self.executed.stopped
        return stopped is not None and stopped[1].startswith("there is no")

    @property
    def is_stopped(self) -> bool:
        """Whether a program with a start stops before its end."""
        return self.executed.stopped is not None and not self.is_library

    @property
    def refusals(self) -> list[Finding]:
        """The findings that the controller would refuse."""
        return [finding for finding in self.executed.findings if finding.level == "refused"]


def find_languages(file: Path, text: str) -> list[Language]:
    """The languages that a text looks like; without any, those of the file's suffix."""
    languages = list_languages()
    recognised = [language for language in languages if language.recognise(text)]
    suffix = file.suffix.lower()
    return recognised or [language for language in languages if suffix in language.suffixes]


def run_all(folder: Path, seen: set[bytes]) -> Iterator[Run]:
    """Runs all programs below `folder` whose text is not among those seen."""
    for file in sorted(path for path in folder.rglob("*") if path.is_file()):
        data = file.read_bytes()
        if b"\0" in data or not data.strip() or data in seen:
            continue
        seen.add(data)
        text = data.decode("latin-1").replace("\r\n", "\n").replace("\r", "\n")
        for language in find_languages(file, text)[:1]:
            executed, seconds = timed(partial(language.run, {file.name: text}, RunRequest()))
            yield Run(file, language.name, executed, seconds)


def measure(name: str, runs: list[Run]) -> list[object]:
    """The cells of a project."""
    ended = [run for run in runs if not run.executed.stopped]
    counts = (
        len(runs),
        sum(run.is_library for run in runs),
        len(ended),
        sum(bool(run.executed.assumed) for run in ended),
        sum(run.is_stopped for run in runs),
        sum(bool(run.refusals) for run in runs),
    )
    languages = ", ".join(sorted({run.language for run in runs}))
    return [name, languages, *counts, sum(run.seconds for run in runs)]


def list_reasons(runs: list[Run]) -> Iterator[str]:
    """The reason for each program that stops, and the first refusal of each program."""
    for run in runs:
        if run.is_stopped:
            line, reason = run.executed.stopped
            yield f"{run.file}:{line}: stopped: {reason}"
        refusals = run.refusals
        if refusals:
            first = refusals[0]
            yield f"{run.file}:{first.line}: refused ({len(refusals)}): {first.what}"


def main() -> None:
    """Prints the table and the reasons."""
    folders = [Path(name) for name in sys.argv[1:] if name != "--why"]
    table = open_table(
        "project | language | programs | no start | to the end | assumptions | stopped | refused "
        "| s {:.1f}"
    )
    seen: set[bytes] = set()
    all_runs: list[Run] = []
    for folder in folders:
        for project in sorted(path for path in folder.iterdir() if path.is_dir()) or [folder]:
            runs = list(run_all(project, seen))
            all_runs += runs
            if runs:
                table.add(*measure(project.name, runs))
    table.add(*measure("all", all_runs))
    if "--why" in sys.argv:
        print("\n" + "\n".join(list_reasons(all_runs)))


if __name__ == "__main__":
    main()
