"""Builds jobs with random combinations of settings and checks how each build ends.

    python -m bench.reliability.combinations [--count 2000] [--seed 0] [--first 0] [--processes 2]

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

import argparse
import json
import multiprocessing
import os
import re
import resource
import select
import shlex
import signal
import sys
import tempfile
import time
from argparse import Namespace
from collections import Counter
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages
from typing import NamedTuple

from bench.machine import machine
from bench.reliability.drawn_jobs import POSTS, Case, draw_case, list_settings
from bench.support.runner import ROOT, Table

#: Seconds of the processor and of the clock that a build may take.
PROCESSOR_SECONDS, CLOCK_SECONDS = 60, 300
#: Bytes of address space that a build may have.
MEMORY = 8 * 1024**3
#: Packages that builds import.
_FOLDERS = (
    *(f"camgen.{name}" for name in ("read", "collision", "plan", "order", "lower", "check")),
    *("camgen.post", "camgen.pipeline", "camgen.cli", "postprocessors"),
)
#: A sentence of this form says what to give, and needs no remedy beside it.
_SAYS_WHAT_TO_GIVE = re.compile(r"\bmust be\b.*, not ", re.DOTALL)


class Ending(NamedTuple):
    """How the process of a case ended.

    code: exit code of the command; None if the process ended without one.
    signal: signal that ended the process, 0 if none.
    fields: file, what, where and remedy of the error that the command reports; empty if none.
    messages: text on standard error.
    left: names of the files in the folder afterwards.
    """

    code: int | None
    signal: int
    fields: tuple[str, ...]
    messages: str
    left: tuple[str, ...]


class Run(NamedTuple):
    """A case that was built.

    code: exit code of the command; None if the process ended without one.
    line: the first line of error, empty without an error.
    miss: the reason why the build is a miss, empty if it is good.
    """

    case: Case
    code: int | None
    line: str
    miss: str


def run_case(case: Case) -> Run:
    """Builds a case in a process of its own, which has the state of a fresh program."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "built").mkdir()
        ready, result = os.pipe()
        child = os.fork()
        if child == 0:
            os.close(ready)
            _build(case, folder, result)
        os.close(result)
        ending = _wait(child, ready, folder)
    error = next((line for line in ending.messages.splitlines() if _is_error(line)), "")
    return Run(case, ending.code, error, find_miss(case, ending))


def _build(case: Case, folder: Path, result: int) -> None:
    """The child: runs the command, writes code and error to `result`, and ends the process."""
    import camgen.cli.build as command  # noqa: PLC0415 (the worker alone imports the program)
    from camgen.cli import main  # noqa: PLC0415
    from camgen.cli.say import Voice  # noqa: PLC0415
    from camgen.model.errors import CamgenError  # noqa: PLC0415

    resource.setrlimit(resource.RLIMIT_CPU, (PROCESSOR_SECONDS, PROCESSOR_SECONDS + 5))
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    os.chdir(folder / "built")
    for stream, name in ((1, "out"), (2, "err")):
        os.dup2(os.open(folder / name, os.O_WRONLY | os.O_CREAT), stream)
    fields: list[str] = []
    build = command.run

    def recorded(arguments: Namespace, says: Voice) -> int:
        try:
            return build(arguments, says)
        except CamgenError as error:
            fields.extend((error.file, error.what, error.where, error.remedy))
            raise

    command.run = recorded
    code = main([_absolute(word) for word in case.words])
    sys.stdout.flush()
    sys.stderr.flush()
    os.write(result, json.dumps([code, fields]).encode())
    os._exit(0)


def _absolute(word: str) -> str:
    """A file of the fixtures by its full name, any other word as it is."""
    return str(ROOT / word) if word.startswith("fixtures/") else word


def _wait(child: int, ready: int, folder: Path) -> Ending:
    """How the child ends; it is killed when its time is up."""
    answered, _, _ = select.select([ready], [], [], CLOCK_SECONDS)
    if not answered:
        os.kill(child, signal.SIGKILL)
    with open(ready, "rb") as stream:
        answer = stream.read()
    _, status = os.waitpid(child, 0)
    code, fields = json.loads(answer) if answer else (None, ())
    end = signal.SIGXCPU if not answered else os.WTERMSIG(status) * os.WIFSIGNALED(status)
    messages = ""
    if (folder / "err").exists():
        messages = (folder / "err").read_text(errors="replace")
    left = sorted(path.name for path in (folder / "built").iterdir())
    return Ending(code, int(end), tuple(fields), messages, tuple(left))


def find_miss(case: Case, ending: Ending) -> str:
    """The reason why a build is a miss, empty if it is good."""
    if ending.signal == signal.SIGXCPU:
        return f"no end within {PROCESSOR_SECONDS} s of the processor, {CLOCK_SECONDS} s in all"
    if ending.signal:
        return f"ended by signal {ending.signal}"
    lines = [line for line in ending.messages.splitlines() if line.strip()]
    last = lines[-1][:200] if lines else ""
    if "Traceback" in ending.messages:
        return f"traceback: {last}"
    if ending.code not in (0, 2, 3):
        return f"exit {ending.code}: {last}"
    warning = next((line for line in lines if "Warning:" in line), "")
    if warning:
        return f"warning of a library: {warning[:200]}"
    if ending.code == 0:
        return "" if ending.left else "exit 0 without a program"
    if ending.left:
        return f"files left after a failure: {', '.join(ending.left)[:100]}"
    errors = [line for line in lines if _is_error(line)]
    if len(errors) != 1:
        return f"{len(errors)} lines of error"
    return find_silence(case, ending.fields) if ending.code == 2 else ""


def _is_error(line: str) -> bool:
    return line.startswith(("camgen: error:", "camgen: fault:"))


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


def prepare_worker() -> None:
    """Imports the program once; the processes of the cases are copies of this one."""
    for folder in _FOLDERS:
        package = import_module(folder)
        for module in walk_packages(package.__path__, f"{folder}."):
            import_module(module.name)
    for post in POSTS:
        list_settings(post)


def measure(count: int, seed: int, first: int, processes: int) -> int:
    """Prints the table and the misses; returns the number of misses."""
    began = time.perf_counter()
    cases = [draw_case(seed, number) for number in range(first, first + count)]
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # a process with threads must not fork
    context = multiprocessing.get_context("spawn")
    runs = []
    with context.Pool(processes, prepare_worker) as pool:
        for run in pool.imap_unordered(run_case, cases):
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


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m bench.reliability.combinations")
    parser.add_argument("--count", type=int, default=2000, help="how many jobs")
    parser.add_argument("--seed", type=int, default=0, help="of the sequence of jobs")
    parser.add_argument("--first", type=int, default=0, help="number of the first job")
    parser.add_argument("--processes", type=int, default=2, help="how many at once")
    given = parser.parse_args()
    sys.exit(1 if measure(given.count, given.seed, given.first, given.processes) else 0)


if __name__ == "__main__":
    main()
