"""``camgen batch``: many parts, each built as ``camgen build`` would, one table; a failing part stops no other."""

from __future__ import annotations

import math
import os
from argparse import Namespace
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
from camgen.batch.writing import check_edits, check_programs, check_targets, write_all
from camgen.check.report import clean
from camgen.cli.say import Voice, table
from camgen.cli.stop import Stopped, exit_code, say_why
from camgen.model.errors import JobError, one_line
from camgen.model.text import counted, duration
from camgen.post.plugins import find_post, find_readback
from camgen.read.job_file import load_job

#: Of several exit codes of parts the first of these is the one of the batch: a fault, a text that does not say what was
#: planned, no safe program, a bad input.
_GRAVEST = (1, 4, 3, 2, 0)
#: Seconds that a part may take: a part that never ends must not keep the others.
_TIMEOUT = 600.0
_BAR = 24
#: Longer reasons stand below the table, in characters.
_WIDEST = 60


class _Row(Struct, frozen=True):
    """What became of a part. status: built, unchanged, or failed."""

    source: str
    status: str
    code: int = 0
    error: str = ""
    files: tuple[str, ...] = ()
    sums: BuildSums | None = None


def run(arguments: Namespace, says: Voice) -> int:
    """Builds what has to be built, writes each program when it is there, sums up."""
    _check(arguments)
    folder = Path(arguments.output or "")
    inputs = find_inputs(arguments.inputs)
    reports = [Path(p) for p in [arguments.report] if p]
    check_targets(reports, [one.source for one in inputs])
    says.stage("looking")
    records = state.load_records(folder)
    order = BatchOptions(arguments.post, arguments.job, tuple(arguments.sets), arguments.strict)
    parts, owners = make_parts(inputs, order, folder, records)
    read = {same: path for part in parts for same, path in part.read.items()}
    check_targets(reports, read.values())
    batch = _Batch(says, folder, parts, records, owners, read, reports, arguments.force)
    batch.take_known()
    try:
        with closing(_builders(arguments, [part.task for part in parts if part.task])) as done:
            for task, outcome in done:
                batch.take(task.place, outcome)
    except Stopped as error:
        left = counted(len(parts) - len(batch.rows), "part")
        says.error(
            f"{say_why(error)}: {left} of {len(parts)} not built; the same command goes on from here"
        )
        return exit_code(error)
    if batch.written:
        state.write_records(folder, records)
    rows = [batch.rows[place] for place in range(len(parts))]
    write_all([(path, _report(rows, arguments.post)) for path in reports], read)
    _tell(rows, says)
    return next(code for code in _GRAVEST if any(row.code == code for row in rows))


def _check(arguments: Namespace) -> None:
    """What is wrong for all parts is said once, before anything is built."""
    find_post(arguments.post)
    find_readback(arguments.post)
    load_job(Path(arguments.job) if arguments.job else None, arguments.sets)
    if arguments.jobs is not None and arguments.jobs < 1:
        raise JobError("--jobs", f"must be 1 or more, not {arguments.jobs}")
    if arguments.timeout is not None and not 0 <= arguments.timeout < math.inf:
        raise JobError("--timeout", f"must be 0 or more seconds, not {arguments.timeout}")
    if arguments.dask and (arguments.jobs or arguments.timeout is not None):
        raise JobError(
            "--dask",
            "the cluster decides how many parts at once and how long",
            remedy="leave out the other",
        )
    if (
        arguments.output
        and os.path.exists(arguments.output)
        and not os.path.isdir(arguments.output)
    ):
        raise JobError(
            arguments.output, "is not a folder", remedy="a batch writes one program for each part"
        )


def _builders(arguments: Namespace, tasks: list[Task]) -> Generator[tuple[Task, Outcome]]:
    if arguments.dask:
        return cluster.run_on_cluster(tasks, arguments.dask)
    jobs = arguments.jobs or os.cpu_count() or 1
    return pool.run_local(tasks, jobs, _TIMEOUT if arguments.timeout is None else arguments.timeout)


class _Batch(Struct):
    """The state of a batch.

    says: voice of the command.
    folder: folder of the programs.
    parts: parts in the order of the inputs.
    records: records of the batch before, by name.
    owners: part that may write a file, by the name of the file.
    read: files that are read and must not be written, by `identity`.
    reports: files that the batch itself writes.
    force: whether programs that were edited by hand are replaced.
    rows: rows of the table, by the number of the part.
    written: number of programs written.
    begun: time of the start, s.
    """

    says: Voice
    folder: Path
    parts: list[BatchPart]
    records: dict[str, state.Record]
    owners: dict[str, int]
    read: Mapping[str, Path]
    reports: list[Path]
    force: bool
    rows: dict[int, _Row] = msgspec.field(default_factory=dict)
    written: int = 0
    begun: float = msgspec.field(default_factory=monotonic)

    def take_known(self) -> None:
        """The parts that need no builder."""
        for place, part in enumerate(self.parts):
            if part.outcome:
                self.take(place, part.outcome)
            elif part.record:
                names = tuple(
                    sorted(
                        str(self.folder / part.input.folder / name) for name in part.record.files
                    )
                )
                self._add(
                    place,
                    _Row(str(part.input.source), "unchanged", files=names, sums=part.record.sums),
                )

    def take(self, place: int, outcome: Outcome) -> None:
        """Writes a program, all files or none, and then the record of it."""
        part = self.parts[place]
        source = str(part.input.source)
        if outcome.sums is None:
            if self.says.verbose > 1 and outcome.trace:
                self.says.rows([("trace", line, "plain") for line in outcome.trace.splitlines()])
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
                what = f"its program would overwrite that of {self.parts[owner].input.source}"
                raise JobError(str(part.input.source), what, name, "rename one of them")
        target = self.folder / below
        try:
            target.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise JobError(str(target), f"cannot be made: {error.strerror}") from error
        files = [(target / name, data) for name, data in outcome.files]
        check_targets([*self.reports, *(path for path, _ in files)], [part.input.source])
        check_programs(files)
        if not self.force:
            check_edits(path for path, _ in files)
        write_all(files, self.read)
        return tuple(str(path) for path, _ in files)

    def _add(self, place: int, row: _Row) -> None:
        self.rows[place] = row
        done, total = len(self.rows), len(self.parts)
        failed = sum(row.status == "failed" for row in self.rows.values())
        if self.says.terminal:
            bar = "#" * (_BAR * done // total)
            self.says.stage(
                f"[{bar:-<{_BAR}}] {done} of {total}, {failed} failed{self._left(done, total)}"
            )
        elif row.status != "unchanged":
            self.says.rows([(row.status, _name(row), "look" if row.error else "plain")])

    def _left(self, done: int, total: int) -> str:
        known = sum(row.status == "unchanged" for row in self.rows.values())
        if done == known:
            return ""
        return (
            f", about {duration((monotonic() - self.begun) / (done - known) * (total - done))} left"
        )


def _tell(rows: list[_Row], says: Voice) -> None:
    """The table, and one line that counts; with -q only the lines of what failed."""
    if says.quiet:
        for row in rows:
            if row.error:
                says.error(f"error: {_name(row)}")
        return
    says.clear()
    cells = [("file", "status", "paths", "time", "notes"), *(_cells(row) for row in rows)]
    below = [f"{one_line(clean(row.source))}: {_why(row)}\n" for row in rows if _is_long(row)]
    says.out(table(cells) + ("\n" + "".join(below) if below else ""))
    counts = {
        status: sum(row.status == status for row in rows)
        for status in ("built", "unchanged", "failed")
    }
    text = ", ".join(f"{number} {status}" for status, number in counts.items() if number)
    says.rows(
        [("batch", f"{counted(len(rows), 'part')}: {text}", "bad" if counts["failed"] else "good")]
    )


def _why(row: _Row) -> str:
    """The error line without the name of the part in front, which stands beside it."""
    names = (f"{one_line(row.source)}: ", f"{row.source}: ", f"{os.path.basename(row.source)}: ")
    return one_line(
        next((row.error[len(name) :] for name in names if row.error.startswith(name)), row.error)
    )


def _is_long(row: _Row) -> bool:
    """Whether the reason would make the table too wide to be read, and stands below it."""
    return bool(row.error) and len(_why(row)) > _WIDEST


def _name(row: _Row) -> str:
    return f"{row.source}: {_why(row)}" if row.error else row.source


def _cells(row: _Row) -> tuple[str, ...]:
    source = one_line(clean(row.source))
    if row.sums is None:
        return (source, f"failed {row.code}", "", "", "below" if _is_long(row) else _why(row))
    nouns = {"warning": "warnings"}  # the other kinds are no nouns
    notes = ", ".join(
        counted(number, kind, nouns.get(kind, kind)) for kind, number in row.sums.notes.items()
    )
    return (source, row.status, str(row.sums.paths), duration(row.sums.time_s), notes)


def _report(rows: list[_Row], post: str) -> bytes:
    """The table as data."""
    parts: list[Mapping[str, object]] = [
        {
            "input": clean(row.source),
            "status": row.status,
            "exit_code": row.code,
            "error": clean(row.error),
            "files": [clean(name) for name in row.files],
            **(msgspec.to_builtins(row.sums) if row.sums else {}),
        }
        for row in rows
    ]
    return (
        msgspec.json.format(msgspec.json.encode({"post": post, "parts": parts}), indent=2) + b"\n"
    )
