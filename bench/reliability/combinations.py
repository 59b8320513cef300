"""Builds jobs with random combinations of settings and checks how each build ends.

    python -m bench.reliability.combinations [COUNT, 2000] [SEED, 0] [FIRST, 0] [PROCESSES, 2]

Case N of a seed is always the same job: a part of the fixtures, a post, and one to five settings
with values that `camgen schema` allows (`drawn_jobs.py`). Each case runs `camgen build` in a new
process and an empty folder. A case is a miss if:

- the exit code is not 0, 2 or 3, the process ends by a signal, or it takes longer than its limit;
- standard error holds a traceback, a warning of a library, or more than one error;
- the build fails and leaves files, or succeeds and leaves none;
- the exit code is 2 and the error does not name a setting or the input, or has no remedy. That is
  decided from the fields of the error (`camgen/model/errors.py`), not from the printed line.

Prints a table for docs/reliability.md, and each miss with the command that repeats it. The exit
status is 1 if there is a miss.
"""

from __future__ import annotations

import re
import shlex
import signal
import sys
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from bench.reliability.commands import Ending, find_fault, map_cases, run_alone
from bench.reliability.drawn_jobs import POSTS, Case, draw_case, list_settings
from bench.support.children import Limits
from bench.support.runner import ROOT, Table, machine, read_words

#: A build may take 60 s of the processor, 300 s by the clock and 8 GB.
LIMITS = Limits(memory=8 * 1024**3, processor=60, clock=300.0)
#: A sentence of this form says what to give, and needs no remedy beside it.
_SAYS_WHAT_TO_GIVE = re.compile(r"\bmust be\b.*, not ", re.DOTALL)


class Run(NamedTuple):
    """A case that was built.

    code: exit code of the command; None if the process ended without one.
    miss: the reason why the build is a miss, empty if it is good.
    """

    case: Case
    code: int | None
    miss: str


def run_case(case: Case) -> Run:
    """Builds a case in a process of its own, which has the state of a fresh program."""
    words = [str(ROOT / word) if word.startswith("fixtures/") else word for word in case.words]
    ending = run_alone(words, LIMITS)
    return Run(case, ending.code, find_miss(case, ending))


def find_miss(case: Case, ending: Ending) -> str:
    """The reason why a build is a miss, empty if it is good."""
    if ending.signal == signal.SIGXCPU:
        return f"no end within {LIMITS.processor} s of the processor, {LIMITS.clock:.0f} s in all"
    fault = find_fault(ending)
    if fault:
        return fault
    if ending.code == 0:
        return "" if ending.left else "exit 0 without a program"
    if not ending.errors:
        return "0 lines of error"
    return find_silence(case, ending.fields) if ending.code == 2 else ""


def find_silence(case: Case, fields: Sequence[str]) -> str:
    """The reason why the error of exit code 2 is a miss, empty if it is good.

    fields: file, what, where and remedy of the error.
    """
    if len(fields) < 4:
        return "exit 2 without an error of the build"
    file, what, where, remedy = fields
    text = " ".join(fields)
    if not remedy and not _SAYS_WHAT_TO_GIVE.search(what):
        return f"exit 2 without a remedy: {text[:200]}"
    if names_input(case, file) or names_setting(case.post, text, f"{where} {file} {what}"):
        return ""
    return f"exit 2 without a setting: {text[:200]}"


def names_input(case: Case, file: str) -> bool:
    """The error is about one of the files that the command names."""
    paths = [word for word in case.words if word.startswith("fixtures/")]
    return any(file.endswith(path) or file == Path(path).name for path in paths)


def names_setting(post: str, text: str, place: str) -> bool:
    """The text names a setting as `table.key`, or its table and its key, or the post."""
    if "--post" in text:
        return True
    for setting in list_settings(post):
        table = re.escape(setting.table)
        key = rf"(?<![\w.]){re.escape(setting.key)}(?!\w)"
        if re.search(rf"(?<!\w){table}(\.\d+)?\.{re.escape(setting.key)}(?!\w)", text):
            return True
        if re.search(rf"\[{table}\]", place) and re.search(key, text):
            return True
    return False


def measure(count: int, seed: int, first: int, processes: int) -> int:
    """Prints the table and the misses; returns the number of misses."""
    began = time.perf_counter()
    cases = [draw_case(seed, number) for number in range(first, first + count)]
    runs = []
    for run in map_cases(run_case, cases, processes):
        runs.append(run)
        if run.miss:
            command = f"camgen {shlex.join(run.case.words)}"
            print(f"case {run.case.number}: {run.miss}\n    {command}", flush=True)
    print(f"\n{machine()}; {time.perf_counter() - began:.0f} s")
    print_table(runs)
    return sum(bool(run.miss) for run in runs)


def print_table(runs: Sequence[Run]) -> None:
    """One row for each post and one for all: cases by exit code, and misses."""
    table = Table("post | cases | exit 0 | exit 2 | exit 3 | other | misses")
    for post in (*POSTS, "all"):
        row = [run for run in runs if post in (run.case.post, "all")]
        codes = Counter(run.code for run in row)
        other = len(row) - codes[0] - codes[2] - codes[3]
        misses = sum(bool(run.miss) for run in row)
        table.add(post, len(row), codes[0], codes[2], codes[3], other, misses)


if __name__ == "__main__":
    sys.exit(measure(*read_words(2000, 0, 0, 2)) > 0)
