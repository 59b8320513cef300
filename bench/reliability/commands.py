"""Runs commands of camgen in forked children, and finds the fault of how each ends."""

from __future__ import annotations

import multiprocessing
import os
import sys
import tempfile
from argparse import Namespace
from collections.abc import Callable, Iterator, Sequence
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages
from typing import NamedTuple, TypeVar

from bench.support.children import Limits, run_in_child

#: Packages that commands import.
_PACKAGES = (
    *(f"camgen.{name}" for name in ("read", "collision", "plan", "order", "lower", "check")),
    *("camgen.post", "camgen.pipeline", "camgen.cli", "postprocessors"),
)
_Case, _Result = TypeVar("_Case"), TypeVar("_Result")


class Ending(NamedTuple):
    """How a command ended.

    code: its exit code; None if the process ended without one.
    signal: signal that ended the process, 0 if none.
    fields: file, what, where and remedy of the error that a build reports; empty if none.
    messages: text on standard error.
    left: names of the files in the folder afterwards.
    peak: the largest resident memory of the process, MB.
    """

    code: int | None
    signal: int
    fields: tuple[str, ...]
    messages: str
    left: tuple[str, ...]
    peak: float = 0.0

    @property
    def lines(self) -> list[str]:
        """The lines on standard error that are not empty."""
        return [line for line in self.messages.splitlines() if line.strip()]

    @property
    def errors(self) -> list[str]:
        """The lines that report an error."""
        starts = ("camgen: error:", "camgen: fault:")
        return [line for line in self.lines if line.startswith(starts)]


def map_cases(
    run: Callable[[_Case], _Result], cases: Sequence[_Case], processes: int
) -> Iterator[_Result]:
    """The results in forks of this process, which imports the program for all of them."""
    for name in _PACKAGES:
        package = import_module(name)
        for module in walk_packages(package.__path__, f"{name}."):
            import_module(module.name)
    with multiprocessing.get_context("fork").Pool(processes) as pool:
        yield from pool.imap(run, cases)


def run_alone(words: Sequence[str], limits: Limits) -> Ending:
    """Runs a command in an empty folder and a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        child = run_in_child(lambda: [_run_command(words, Path(folder))], limits)
    if child.results:
        return child.results[0]._replace(peak=child.peak)
    return Ending(None, child.signal, (), "", (), child.peak)


def _run_command(words: Sequence[str], folder: Path) -> Ending:
    """Runs a command in an empty folder, and redirects the streams of this process."""
    import camgen.cli.build as command  # noqa: PLC0415 (the worker alone imports the program)
    from camgen.cli import main  # noqa: PLC0415
    from camgen.cli.say import Terminal  # noqa: PLC0415
    from camgen.model.errors import CamgenError  # noqa: PLC0415

    fields: list[str] = []
    build = command.run

    def record(arguments: Namespace, terminal: Terminal) -> None:
        try:
            build(arguments, terminal)
        except CamgenError as error:
            fields.extend((error.file, error.what, error.where, error.remedy))
            raise

    os.chdir(folder)
    with tempfile.TemporaryFile() as stream:
        os.dup2(stream.fileno(), 2)
        command.run = record
        code = main(list(words))
        command.run = build
        sys.stderr.flush()
        stream.seek(0)
        messages = stream.read().decode(errors="replace")
    left = tuple(sorted(path.name for path in folder.iterdir()))
    return Ending(code, 0, tuple(fields), messages, left)


def find_fault(ending: Ending, codes: Sequence[int] = (0, 2, 3)) -> str:
    """The first fault of how a command ended, empty without one.

    codes: exit codes that are right.
    """
    if ending.signal:
        return f"ended by signal {ending.signal}"
    last = ending.lines[-1][:200] if ending.lines else ""
    if "Traceback" in ending.messages:
        return f"traceback: {last}"
    warning = next((line for line in ending.lines if "Warning:" in line), "")
    if warning:
        return f"warning of a library: {warning[:200]}"
    if ending.code not in codes:
        return f"exit {ending.code}: {last}"
    if ending.code and ending.left:
        return f"files left after a failure: {', '.join(ending.left)[:100]}"
    if len(ending.errors) > 1:
        return f"{len(ending.errors)} lines of error"
    return ""
