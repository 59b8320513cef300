"""Runs ABB RAPID modules of any origin.

Sources: the kernel manual for the language, the technical reference manual for instructions and
functions. docs/languages/rapid.md states the limits.
"""

from __future__ import annotations

from collections.abc import Mapping

from camgen.lang.coverage import measure_coverage
from camgen.lang.programs import Executed, RunRequest, index_frames, strip_mark, unify_line_ends
from camgen.model.program import pack

from .grammar import parse
from .link import link
from .machine import Machine
from .run import Runner, report_end, run_entry
from .tokens import Wrong
from .tree import Routine


def run_modules(files: Mapping[str, str], request: RunRequest) -> Executed:
    """The effects of the modules' entry, run once. Raises nothing, whatever the text."""
    machine = Machine(request)
    modules = []
    line = 1
    for name, text in files.items():
        plain = unify_line_ends(strip_mark(text)).rstrip("\x00\x1a")
        if "\x00" in plain[:1000]:
            what = "controllers write modules that may not be seen like this"
            machine.log.find("refused", f"{name[-60:]} is not text: {what}", line=line)
            line += plain.count("\n") + 1
            continue
        file_modules, notes = parse(plain, line)
        modules += file_modules
        for note in notes:
            machine.log.find("unusual" if note.odd else "refused", note.what, line=note.line)
        line += plain.count("\n") + (not plain.endswith("\n"))
    entry = link(machine, modules, Runner.perform)
    stopped = None if entry is None else _run(machine, entry, line)
    if entry is not None and stopped is None:
        report_end(machine, entry.last or entry.line)
    return _make_executed(machine, stopped)


def _run(machine: Machine, entry: Routine, lines: int) -> tuple[int, str] | None:
    try:
        return run_entry(machine, entry, lines)
    except Wrong as wrong:
        machine.log.find("refused", wrong.what, line=wrong.line)
        return wrong.line, wrong.what


def _make_executed(machine: Machine, stopped: tuple[int, str] | None) -> Executed:
    return Executed(
        body=pack(machine.body),
        lines=tuple(machine.lines),
        frames=tuple(machine.frames),
        frame=index_frames(machine.frames, machine.frame_of),
        stopped=stopped,
        coverage=measure_coverage(machine.codes.values(), machine.log.ran, machine.line),
        **machine.log.list_all("; ", 8),
    )
