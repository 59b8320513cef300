"""Writes a job file: the settings that differ from the defaults, with the comments of the file."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

from camgen.model.errors import make_one_line
from camgen.model.job_tables import ROWS, list_settings, list_tables
from camgen.model.toml import format_toml

_BARE = re.compile(r"[A-Za-z0-9_-]+")


def write_job(base: str, wanted: Mapping[str, Any], source: str) -> str:
    """The text of a job file.

    base: text of the existing file, "" without one. Unchanged settings keep their place and their
        comments.
    wanted: tables of the job.
    source: name of the input, for the first line of a new file.
    """
    if not base:
        return _write_new(wanted, source)
    if tomllib.loads(base) == wanted:
        return base
    # An editor of TOML may be wrong about a corner of the language; what it writes is read again.
    with suppress(Exception):
        text = _edit(base, wanted)
        if tomllib.loads(text) == wanted:
            return text
    return _write_new(wanted, source)


def keeps_comments(base: str, text: str) -> bool:
    """Whether `text` has the comments of `base`."""
    lines = [line for line in base.splitlines() if line.lstrip().startswith("#")]
    return all(line.partition("#")[2].strip() in text for line in lines)


def _write_new(wanted: Mapping[str, Any], source: str) -> str:
    lines = [
        f"# camgen job for {make_one_line(source)}",
        "# Lengths mm, angles deg, speeds mm/s, forces N, times s. "
        "What is not here has its default.",
    ]
    order = [*(name for name in list_tables() if name != "post"), *ROWS, "post"]
    for name in sorted(wanted, key=lambda name: order.index(name) if name in order else len(order)):
        content = wanted[name]
        if isinstance(content, list):
            for row in content:
                lines += ["", f"[[{_format_key(name)}]]", *_format_keys(name, row)]
        elif isinstance(content, Mapping):
            lines += ["", f"[{_format_key(name)}]", *_format_keys(name, content)]
        else:  # A key outside any table: reading the file reports it.
            lines.insert(2, f"{_format_key(name)} = {format_toml(content)}")
    return "\n".join(lines) + "\n"


def _format_keys(table: str, content: Mapping[str, Any]) -> list[str]:
    """The lines of the keys, in the order of the page on the job file."""
    order = [s.key for s in list_settings() if s.table == table or table in ROWS]
    names = sorted(content, key=lambda key: order.index(key) if key in order else len(order))
    return [f"{_format_key(key)} = {format_toml(content[key])}" for key in names]


def _format_key(name: str) -> str:
    return name if _BARE.fullmatch(name) else format_toml(name)


def _edit(base: str, wanted: Mapping[str, Any]) -> str:
    """`base` with the values of `wanted` and its comments at their places."""
    import tomlkit  # noqa: PLC0415 (only for an existing job file)

    document: Any = tomlkit.parse(base)
    held = document.unwrap()
    for name in [name for name in held if name not in wanted]:
        del document[name]
    for name, content in wanted.items():
        if held.get(name) == content:
            continue
        if isinstance(content, Mapping) and isinstance(held.get(name), Mapping):
            _edit_table(document[name], held[name], content)
        elif isinstance(content, list) and isinstance(held.get(name), list) and name in ROWS:
            _edit_rows(document, name, held[name], content)
        else:
            document[name] = tomlkit.item(content)
    return str(tomlkit.dumps(document))


def _edit_table(table: Any, held: Mapping[str, Any], content: Mapping[str, Any]) -> None:
    for key in [key for key in held if key not in content]:
        del table[key]
    for key, value in content.items():
        if key not in held or held[key] != value:
            table[key] = value


def _edit_rows(document: Any, name: str, held: list[Any], content: list[Any]) -> None:
    """Change rows and keep their comments. If their number changes, all are written again."""
    import tomlkit  # noqa: PLC0415 (only for an existing job file)

    if len(held) != len(content):
        rows = tomlkit.aot()
        for row in content:
            table = tomlkit.table()
            table.update(row)
            rows.append(table)
        document[name] = rows
        return
    for table, before, row in zip(document[name], held, content, strict=True):
        _edit_table(table, before, row)
