"""The open job of the workbench as a value: the inputs, the tables of the job, and its history."""

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
from camgen.read.job_file import find_job_file, load_job, parse_assignment, parse_value
from camgen.workbench.job_text import write_job

#: The tables of a job as in its TOML file. Keys with their default value are left out.
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
        """Whether the job file has the settings of the form. Without a file, all are defaults."""
        return parse_tables(self.base) == self.tables


def open_session(
    inputs: Sequence[Path],
    job: str | None,
    sets: Sequence[str],
    post: str,
    output: Path,
    posts: Sequence[str],
) -> Session:
    """The session of a command.

    Raises JobError for a job file that is not TOML, and for an invalid `--set`.
    """
    job_file = find_job_file(job, inputs[0])
    file = job_file or inputs[0].with_suffix(".toml")
    base = read_base(file, Files()) if job_file else ""
    # An error in the file is shown by the page, after the first build. One in --set is raised here.
    load_job(None, [text for text in sets if text.split(".")[0].strip() not in ROWS], Files())
    tables = parse_tables(base)
    for text in sets:
        tables = _apply_assignment(tables, text, file.parent)
    names = frozenset(identity(file.parent / name) for name in list_files(tables))
    return Session(tuple(inputs), file, base, tables, post, output, tuple(posts), names)


def read_base(file: Path, files: Files) -> str:
    """The text of a job file. Raises JobError if it is not TOML."""
    text = files.read(file).data.decode("utf-8-sig", "replace")
    try:
        tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise JobError(str(file), f"is not TOML: {error}", remedy="correct this file") from error
    return text


def parse_tables(base: str) -> Tables:
    """The tables of a job file's text."""
    return tomllib.loads(base)


def _apply_assignment(tables: Tables, text: str, folder: Path) -> Tables:
    """`tables` with one `--set`.

    A file name in it is relative to the working folder, and in the result to the folder `folder`.
    """
    table, key, value = parse_assignment(text)
    if isinstance(value, str) and value and _names_file(table, key, value):
        value = os.path.relpath(value, folder)
    name, _, row = table.partition(".")
    path: list[str | int] = [name, int(row), key] if row.isdigit() else [table, key]
    return set_value(tables, path, value)


def get_table(tables: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    """A table of a job, empty if the file has none, or anything else there."""
    table = tables.get(name, {})
    return table if isinstance(table, Mapping) else {}


def list_rows(tables: Tables, name: str) -> list[dict[str, Any]]:
    """The rows of `[[tools]]` or `[[operations]]`, empty if the file has anything else there."""
    rows = tables.get(name, [])
    if not isinstance(rows, list):
        return []
    return [dict(row) for row in rows if isinstance(row, Mapping)]


def set_value(tables: Tables, path: Sequence[str | int], value: Any) -> Tables:
    """`tables` with another value.

    path: a table alone, table and key, or table, row and key.
    value: the value. None removes the key. So does its default, except in a row.

    Raises JobError for a row that does not exist.
    """
    name = str(path[0])
    changed = dict(tables)
    if len(path) == 1:
        changed[name] = value
    elif len(path) == 2:
        is_removed = value is None or is_default(name, str(path[1]), value)
        changed[name] = _set_key(tables.get(name, {}), str(path[1]), None if is_removed else value)
    else:
        row, rows = path[1], list(tables.get(name, []))
        if not isinstance(row, int) or not 0 <= row < len(rows):
            raise JobError(f"{name}.{row}", "there is no such row", remedy="rows count from 0")
        rows[row] = _set_key(rows[row], str(path[2]), value)
        changed[name] = rows
    return {name: content for name, content in changed.items() if content}


def _set_key(table: Mapping[str, Any], key: str, value: Any) -> dict[str, Any]:
    """The table with a key, or without it for None."""
    if value is not None:
        return {**table, key: value}
    return {name: content for name, content in table.items() if name != key}


def is_default(table: str, key: str, value: object) -> bool:
    """Whether a key has this value by default, independently of all other settings."""
    known = any(s.table == table and s.key == key and s.default == value for s in list_settings())
    return known and (table, key) not in BESIDE


class Change(Struct, frozen=True):
    """One change of a page.

    path: path as for `set_value`.
    value: the new value, None to remove it.
    raw: text that the user typed, read like that of `--set`; None if the page sends a value.
    """

    path: list[str | int]
    value: Any = None
    raw: str | None = None


def apply_changes(session: Session, changes: Sequence[Change]) -> Session:
    """The session after changes of a page.

    Raises JobError for an unknown table, and for a file outside the open folder.
    """
    tables = session.tables
    for entry in changes:
        check_place(entry)
        value = entry.value
        if entry.raw is not None:
            value = parse_value(entry.raw) if entry.raw.strip() else None
        if isinstance(value, (date, time)):
            value = entry.raw  # No setting is a date, so the error shows the text as typed.
        tables = set_value(tables, entry.path, value)
    _check_folder(session, tables)
    return add_step(session, tables)


def check_place(change: Change) -> None:
    """Raises JobError if a job has no place for a change."""
    table = change.path[0] if change.path else ""
    is_row = table in ROWS and len(change.path) in (1, 3)
    known = {s.table for s in list_settings()} | {"post"}
    if not is_row and not (table in known and len(change.path) == 2):
        name = ".".join(map(str, change.path))[:80]
        raise JobError("job", f"has no place {name}", remedy="reload the page")


def add_step(session: Session, tables: Tables, post: str = "") -> Session:
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
    return replace(
        session,
        tables=last.tables,
        post=last.post,
        before=tuple(before),
        after=(*session.after, session.step),
    )


def redo(session: Session) -> Session:
    """The session after the change that was undone last."""
    if not session.after:
        return session
    *after, following = session.after
    return replace(
        session,
        tables=following.tables,
        post=following.post,
        before=(*session.before, session.step),
        after=tuple(after),
    )


def _check_folder(session: Session, tables: Tables) -> None:
    """Raise JobError for a file that a page names outside the open folder, links followed."""
    root = os.path.realpath(session.folder)
    for name in list_files(tables):
        try:
            file = os.path.realpath(session.job_file.parent / name)
        except ValueError as error:  # a zero byte
            raise JobError(name, "is not a file name") from error
        is_inside = os.path.commonpath([root, file]) == root
        if not is_inside and identity(file) not in session.allowed:
            raise JobError(
                name,
                f"lies outside the open folder {session.folder.resolve().name}",
                remedy="copy it there, or name it in the job file before camgen open",
            )


def list_files(tables: Mapping[str, Any]) -> Iterator[str]:
    """The files that the tables of a job name, as written there."""
    for table, key in FILES:
        name = get_table(tables, table).get(key)
        if isinstance(name, str) and name and _names_file(table, key, name):
            robot = split_name(name) if (table, key) == ("cell", "robot") else None
            yield robot[0] if robot else name
    fixtures = get_table(tables, "cell").get("fixtures")
    if isinstance(fixtures, list):
        yield from (fixture for fixture in fixtures if isinstance(fixture, str))


def _names_file(table: str, key: str, value: str) -> bool:
    return (table, key) in FILES and (
        (table, key) != ("cell", "robot") or split_name(value) is not None
    )
