"""What is open in the workbench, as a value: the inputs, and the job as its tables stand in the file."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from datetime import date, time
from pathlib import Path
from typing import Any

from msgspec import Struct
from msgspec.structs import replace

from camgen.model.errors import JobError
from camgen.model.job_tables import BESIDE, FILES, ROWS, list_settings, split_name
from camgen.read.files import Files, identity
from camgen.read.job_file import assignment, beside, load, value_of
from camgen.workbench.job_text import write_job

#: The job as TOML has it: tables of keys, and lists of such tables. Keys that hold their default are left out.
Tables = dict[str, Any]


class Step(Struct, frozen=True):
    """The job at a moment of the session.

    tables: the settings that differ from their defaults
    post: name of the controller
    """

    tables: Tables
    post: str


class Session(Struct, frozen=True):
    """The open job and its history.

    inputs: files, as the user named them
    job_file: file to which the job is saved
    base: text of the job file as it was read, "" without a file
    tables: the settings that differ from their defaults
    post: name of the controller
    output: folder of the program
    posts: names of the controllers that a page may choose
    allowed: identities of files outside the folder that the job named before a page did
    before: steps that undo goes back to, the last step first to be restored
    after: steps that redo goes forward to, the last step first to be restored
    """

    inputs: tuple[Path, ...]
    job_file: Path
    base: str
    tables: Tables
    post: str
    output: Path
    posts: tuple[str, ...] = ()
    allowed: frozenset[str] = frozenset()
    before: tuple[Step, ...] = ()
    after: tuple[Step, ...] = ()

    @property
    def step(self) -> Step:
        """The job as it is now."""
        return Step(self.tables, self.post)

    @property
    def folder(self) -> Path:
        """The folder that was opened: of the first input."""
        return self.inputs[0].parent

    @property
    def text(self) -> str:
        """The job file as it would be saved now."""
        return write_job(self.base, self.tables, self.inputs[0].name)

    @property
    def is_saved(self) -> bool:
        """Whether the job file says what the form says; without one, whether all is as it is by default."""
        return tables_of(self.base) == self.tables


def open_session(
    inputs: Sequence[Path],
    job: str | None,
    sets: Sequence[str],
    post: str,
    output: Path,
    posts: Sequence[str],
) -> Session:
    """The session of a command. JobError for a job file that is no TOML, and for a ``--set`` that makes no sense."""
    found = beside(job, inputs[0])
    file = found or inputs[0].with_suffix(".toml")
    base = read_base(file, Files()) if found else ""
    # What the file says is looked at by the build, whose error stands in the page; a slip in --set is told at once.
    load(None, [text for text in sets if text.split(".")[0].strip() not in ROWS], Files())
    tables = tables_of(base)
    for text in sets:
        tables = _set(tables, text, file.parent)
    names = frozenset(identity(file.parent / name) for name in named_files(tables))
    return Session(tuple(inputs), file, base, tables, post, output, tuple(posts), names)


def read_base(file: Path, files: Files) -> str:
    """The text of a job file. JobError where it is no TOML."""
    text = files.read(file).data.decode("utf-8-sig", "replace")
    try:
        tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise JobError(str(file), f"is not TOML: {error}", remedy="mend it") from error
    return text


def tables_of(base: str) -> Tables:
    """The tables of a job file's text."""
    return tomllib.loads(base)


def _set(tables: Tables, text: str, folder: Path) -> Tables:
    """``tables`` with one ``--set``; a file in it lies where the user stands, in the job file beside that."""
    table, key, value = assignment(text)
    if isinstance(value, str) and value and _names_file(table, key, value):
        value = os.path.relpath(value, folder)
    name, _, row = table.partition(".")
    path: list[str | int] = [name, int(row), key] if row.isdigit() else [table, key]
    return put(tables, path, value)


def rows_of(tables: Tables, name: str) -> list[dict[str, Any]]:
    """The rows of ``[[tools]]`` or ``[[operations]]``; none where the file has something else in their place."""
    found = tables.get(name, [])
    return (
        [dict(row) for row in found if isinstance(row, Mapping)] if isinstance(found, list) else []
    )


def put(tables: Tables, path: Sequence[str | int], value: Any) -> Tables:
    """``tables`` with ``value`` at a path: table and key, or table, row and key, or a table alone. None takes it away,
    and so does the default of a key that is in no row. JobError for a row that is not there.
    """
    found = dict(tables)
    if len(path) == 1:
        found[str(path[0])] = value
    elif len(path) == 2:
        table, key = str(path[0]), str(path[1])
        kept = {name: own for name, own in tables.get(table, {}).items() if name != key}
        found[table] = (
            kept
            if value is None or is_default(table, key, value)
            else {**tables.get(table, {}), key: value}
        )
    else:
        name, row, key = str(path[0]), path[1], str(path[2])
        rows = list(tables.get(name, []))
        if not isinstance(row, int) or not 0 <= row < len(rows):
            raise JobError(
                f"{name}.{row}", "there is no such row", remedy="they are counted from 0"
            )
        own = {other: one for other, one in rows[row].items() if other != key}
        rows[row] = own if value is None else {**rows[row], key: value}
        found[name] = rows
    return {name: content for name, content in found.items() if content}


def is_default(table: str, key: str, value: object) -> bool:
    """Whether a key has this value where nobody sets it, whatever else the job says."""
    known = any(s.table == table and s.key == key and s.default == value for s in list_settings())
    return known and (table, key) not in BESIDE


class Change(Struct, frozen=True):
    """One change of a page. path: as ``put`` has it. value: what is put there; or raw: what the user typed, read as
    ``--set`` reads it.
    """

    path: list[str | int]
    value: Any = None
    raw: str | None = None


def change(session: Session, changes: Sequence[Change]) -> Session:
    """The session after changes of a page. JobError for a table that no job has, and for a file outside the folder."""
    tables = session.tables
    for entry in changes:
        check_place(entry)
        value = entry.value
        if entry.raw is not None:
            value = value_of(entry.raw) if entry.raw.strip() else None
        if isinstance(value, (date, time)):
            value = entry.raw  # no setting is a date: the error shows the text as it was typed
        tables = put(tables, entry.path, value)
    _insist_on_folder(session, tables)
    return step(session, tables)


def check_place(change: Change) -> None:
    """Raises JobError if a job has no place for a change."""
    table = change.path[0] if change.path else ""
    is_row = table in ROWS and len(change.path) in (1, 3)
    known = {s.table for s in list_settings()} | {"post"}
    if not is_row and not (table in known and len(change.path) == 2):
        name = ".".join(map(str, change.path))[:80]
        raise JobError("job", f"has no place {name}", remedy="reload the page")


def step(session: Session, tables: Tables, post: str = "") -> Session:
    """The session with another job, which can be undone. Without `post` the controller stays."""
    following = Step(tables, post or session.post)
    if following == session.step:
        return session
    before = (*session.before, session.step)
    return replace(session, tables=tables, post=following.post, before=before, after=())


def undo(session: Session) -> Session:
    """The session before its last change."""
    if not session.before:
        return session
    *before, last = session.before
    after = (*session.after, session.step)
    return replace(session, tables=last.tables, post=last.post, before=tuple(before), after=after)


def redo(session: Session) -> Session:
    """The session after the change that was undone last."""
    if not session.after:
        return session
    *after, following = session.after
    before = (*session.before, session.step)
    return replace(
        session, tables=following.tables, post=following.post, before=before, after=tuple(after)
    )


def _insist_on_folder(session: Session, tables: Tables) -> None:
    """JobError for a file that a page names and that lies outside the folder, links followed."""
    root = os.path.realpath(session.folder)
    for name in named_files(tables):
        try:
            same = os.path.realpath(session.job_file.parent / name)
        except ValueError as error:  # a zero byte
            raise JobError(name, "is no name of a file") from error
        inside = os.path.commonpath([root, same]) == root
        if not inside and identity(same) not in session.allowed:
            what = f"lies outside the folder that is open, {session.folder.resolve().name}"
            raise JobError(
                name, what, remedy="copy it there, or name it in the job file before camgen open"
            )


def named_files(tables: Mapping[str, Any]) -> Iterator[str]:
    """The files that the tables of a job name, as they stand there."""
    for table, key in FILES:
        content = tables.get(table, {})
        name = content.get(key) if isinstance(content, Mapping) else None
        if isinstance(name, str) and name and _names_file(table, key, name):
            yield split_name(name)[0] if (table, key) == ("cell", "robot") else name  # type: ignore[index]
    cell = tables.get("cell", {})
    fixtures = cell.get("fixtures") if isinstance(cell, Mapping) else None
    yield from (
        one for one in (fixtures if isinstance(fixtures, list) else []) if isinstance(one, str)
    )


def _names_file(table: str, key: str, value: str) -> bool:
    return (table, key) in FILES and (
        (table, key) != ("cell", "robot") or split_name(value) is not None
    )
