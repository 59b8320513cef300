"""The command `batch`: builds many parts as `build` does, and prints one table.

A part that fails does not stop the others.
"""

from __future__ import annotations

import math
import os
from argparse import Namespace
from collections import Counter
from collections.abc import Generator, Mapping
from contextlib import closing
from pathlib import Path
from time import monotonic

import msgspec
from msgspec import Struct

from camgen.batch import cluster, pool, state
from camgen.batch.inputs import find_inputs
from camgen.batch.parts import BatchOptions, BatchPart, make_parts
from camgen.batch.state import BuildSums, Outcome, Task
from camgen.batch.writing import (
    check_edits,
    check_programs,
    check_targets,
    list_paths,
    write_all,
)
from camgen.check.report import clean
from camgen.cli.inputs import to_path
from camgen.cli.say import Terminal, format_table, label_rows
from camgen.cli.stop import Stopped, exit_code, format_reason
from camgen.model.errors import JobError, make_one_line
from camgen.model.sequences import take_rows
from camgen.model.text import counted, duration
from camgen.post.plugins import find_post, find_readback
from camgen.read.job_file import load_job

#: Exit codes by severity: a fault, a read-back that differs, no safe program, a wrong input, none.
#: The exit code of a batch is the first one that a part has.
_BY_SEVERITY = (1, 4, 3, 2, 0)
#: Default of the maximum time for a part, s, so that a part without an end does not block others.
_TIMEOUT = 600.0
#: Width of the bar that shows the progress, characters.
_BAR = 24
#: Maximum length of a reason in the table, characters. Longer ones are printed below it.
_WIDEST = 60


class _Row(Struct, frozen=True):
    """The result of a part.

    source: its input.
    status: built, unchanged, or failed.
    code: exit code of `camgen build`.
    error: line of the error.
    files: files of the program.
    sums: sums of the program, None without one.
    """

    source: str
    status: str
    code: int = 0
    error: str = ""
    files: tuple[str, ...] = ()
    sums: BuildSums | None = None


def run(arguments: Namespace, terminal: Terminal) -> int:
    """Build the parts that have changed, write each program at once, and print the table."""
    _check(arguments)
    folder = Path(arguments.output or "")
    inputs = find_inputs(arguments.inputs)
    report = to_path(arguments.report)
    check_targets([report], [batch_input.source for batch_input in inputs])
    terminal.stage("looking")
    records = state.load_records(folder)
    options = BatchOptions(arguments.post, arguments.job, tuple(arguments.sets), arguments.strict)
    parts, owners = make_parts(inputs, options, folder, records)
    read: dict[str, Path] = {}
    for part in parts:
        read |= part.read
    check_targets([report], read.values())
    batch = _Batch(terminal, folder, parts, records, owners, read, report, arguments.force)
    batch.take_known()
    try:
        with closing(_builders(arguments, [part.task for part in parts if part.task])) as done:
            for task, outcome in done:
                batch.take(task.place, outcome)
    except Stopped as error:
        missing = f"{counted(len(parts) - len(batch.rows), 'part')} of {len(parts)} not built"
        terminal.error(f"{format_reason(error)}: {missing}; the same command continues from here")
        return exit_code(error)
    if batch.written:
        state.write_records(folder, records)
    rows = take_rows(batch.rows, range(len(parts)))
    if report:
        write_all([(report, _report(rows, arguments.post))], read)
    _print_table(rows, terminal)
    return min((row.code for row in rows), key=_BY_SEVERITY.index)


def _check(arguments: Namespace) -> None:
    """Raise JobError once for an option that is wrong for all parts."""
    find_post(arguments.post)
    find_readback(arguments.post)
    load_job(to_path(arguments.job), arguments.sets)
    if arguments.jobs is not None and arguments.jobs < 1:
        raise JobError("--jobs", f"must be 1 or more, not {arguments.jobs}")
    if arguments.timeout is not None and not 0 <= arguments.timeout < math.inf:
        raise JobError("--timeout", f"must be 0 or more seconds, not {arguments.timeout}")
    if arguments.dask and (arguments.jobs or arguments.timeout is not None):
        raise JobError(
            "--dask",
            "the cluster has its own limits of number and time",
            remedy="leave out --jobs and --timeout",
        )
    output = arguments.output
    if output and os.path.exists(output) and not os.path.isdir(output):
        raise JobError(
            output,
            "is not a folder",
            remedy="give a folder: a batch writes one program for each part",
        )


def _builders(arguments: Namespace, tasks: list[Task]) -> Generator[tuple[Task, Outcome]]:
    if arguments.dask:
        return cluster.run_on_cluster(tasks, arguments.dask)
    jobs = arguments.jobs or os.cpu_count() or 1
    return pool.run_local(tasks, jobs, _TIMEOUT if arguments.timeout is None else arguments.timeout)


class _Batch(Struct):
    """The state of a batch.

    terminal: voice of the command.
    folder: folder of the programs.
    parts: parts in the order of the inputs.
    records: records of the batch before, by name.
    owners: part that may write a file, by the name of the file.
    read: files that are read and must not be written, by `identity`.
    report: file that the batch itself writes, None without one.
    force: whether programs that were edited by hand are replaced.
    rows: rows of the table, by the number of the part.
    statuses: number of rows by status.
    written: number of programs written.
    start: time of the start, on the clock `monotonic`, s.
    """

    terminal: Terminal
    folder: Path
    parts: list[BatchPart]
    records: dict[str, state.Record]
    owners: dict[str, int]
    read: Mapping[str, Path]
    report: Path | None
    force: bool
    rows: dict[int, _Row] = msgspec.field(default_factory=dict)
    statuses: Counter[str] = msgspec.field(default_factory=Counter)
    written: int = 0
    start: float = msgspec.field(default_factory=monotonic)

    def take_known(self) -> None:
        """Add the rows of the parts that are not built."""
        for place, part in enumerate(self.parts):
            if part.outcome:
                self.take(place, part.outcome)
            elif part.record:
                target, source = self.folder / part.input.folder, str(part.input.source)
                names = tuple(sorted(str(target / name) for name in part.record.files))
                self._add(place, _Row(source, "unchanged", files=names, sums=part.record.sums))

    def take(self, place: int, outcome: Outcome) -> None:
        """Write a program, all files or none, and then its record."""
        part = self.parts[place]
        source = str(part.input.source)
        if outcome.sums is None:
            if self.terminal.verbose > 1 and outcome.trace:
                self.terminal.rows(label_rows("trace", outcome.trace.splitlines()))
            self._add(place, _Row(source, "failed", outcome.code, outcome.error))
            return
        try:
            names = self._written(place, outcome)
        except JobError as error:
            self._add(place, _Row(source, "failed", error.exit_code, str(error)))
            return
        hashes = {name: state.hash_bytes(data) for name, data in outcome.files}
        self.records[part.program] = state.Record(part.program, part.digest, hashes, outcome.sums)
        state.add_record(self.folder, self.records[part.program])
        self.written += 1
        self._add(place, _Row(source, "built", files=names, sums=outcome.sums))

    def _written(self, place: int, outcome: Outcome) -> tuple[str, ...]:
        part = self.parts[place]
        below = part.input.folder
        for name, _ in outcome.files:
            owner = self.owners.setdefault((below / name).as_posix().casefold(), place)
            if owner != place:
                raise JobError(
                    str(part.input.source),
                    f"its program would overwrite that of {self.parts[owner].input.source}",
                    name,
                    "rename one of them",
                )
        target = self.folder / below
        try:
            target.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise JobError(str(target), f"cannot be made: {error.strerror}") from error
        files = [(target / name, data) for name, data in outcome.files]
        paths = list_paths(files)
        check_targets([self.report, *paths], [part.input.source])
        check_programs(files)
        if not self.force:
            check_edits(paths)
        write_all(files, self.read)
        return tuple(map(str, paths))

    def _add(self, place: int, row: _Row) -> None:
        self.rows[place] = row
        self.statuses[row.status] += 1
        done, total = len(self.rows), len(self.parts)
        if self.terminal.is_interactive:
            bar = "#" * (_BAR * done // total)
            progress = f"{done} of {total}, {self.statuses['failed']} failed"
            rest = self._format_rest(done, total)
            self.terminal.stage(f"[{bar:-<{_BAR}}] {progress}{rest}")
        elif row.status != "unchanged":
            self.terminal.rows([(row.status, _name(row), "look" if row.error else "plain")])

    def _format_rest(self, done: int, total: int) -> str:
        """The remaining time, from the mean time of the parts that were built."""
        built = done - self.statuses["unchanged"]
        if not built:
            return ""
        seconds = (monotonic() - self.start) / built * (total - done)
        return f", about {duration(seconds)} left"


def _print_table(rows: list[_Row], terminal: Terminal) -> None:
    """Print the table and its sums; with -q only the errors."""
    if terminal.quiet:
        for row in rows:
            if row.error:
                terminal.error(f"error: {_name(row)}")
        return
    cells = [("file", "status", "paths", "time", "notes")]
    below = ""
    for row in rows:
        cells.append(_cells(row))
        if _is_long(row):
            below += f"{make_one_line(clean(row.source))}: {_why(row)}\n"
    if below:
        below = f"\n{below}"
    terminal.out(format_table(cells) + below)
    counts = Counter(row.status for row in rows)
    statuses = ("built", "unchanged", "failed")
    text = ", ".join(f"{counts[status]} {status}" for status in statuses if counts[status])
    tone = "bad" if counts["failed"] else "good"
    terminal.rows([("batch", f"{counted(len(rows), 'part')}: {text}", tone)])


def _why(row: _Row) -> str:
    """The error line without the name of the part, which is printed beside it."""
    for name in (make_one_line(row.source), row.source, os.path.basename(row.source)):
        if row.error.startswith(f"{name}: "):
            return make_one_line(row.error.removeprefix(f"{name}: "))
    return make_one_line(row.error)


def _is_long(row: _Row) -> bool:
    """Whether the reason is printed below the table, which it would make too wide."""
    return bool(row.error) and len(_why(row)) > _WIDEST


def _name(row: _Row) -> str:
    return f"{row.source}: {_why(row)}" if row.error else row.source


def _cells(row: _Row) -> tuple[str, str, str, str, str]:
    source = make_one_line(clean(row.source))
    if row.sums is None:
        return (source, f"failed {row.code}", "", "", "below" if _is_long(row) else _why(row))
    # The other kinds of notes are adjectives, which have no plural.
    plurals = {"warning": "warnings"}
    notes = [counted(n, kind, plurals.get(kind, kind)) for kind, n in row.sums.notes.items()]
    return (source, row.status, str(row.sums.paths), duration(row.sums.time_s), ", ".join(notes))


def _report(rows: list[_Row], post: str) -> bytes:
    """The table as JSON."""
    parts = []
    for row in rows:
        part: dict[str, object] = {
            "input": clean(row.source),
            "status": row.status,
            "exit_code": row.code,
            "error": clean(row.error),
            "files": list(map(clean, row.files)),
        }
        if row.sums:
            part |= msgspec.to_builtins(row.sums)
        parts.append(part)
    table = msgspec.json.encode({"post": post, "parts": parts})
    return msgspec.json.format(table, indent=2) + b"\n"
