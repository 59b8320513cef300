"""The text of a job file: only what differs from the defaults, and in a file that there was its comments."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

from camgen.model.errors import one_line
from camgen.model.job_tables import ROWS, list_settings, list_tables
from camgen.model.toml import toml

_BARE = re.compile(r"[A-Za-z0-9_-]+")


def write_job(base: str, wanted: Mapping[str, Any], source: str) -> str:
    """The job file that holds the tables ``wanted``. base: the text of the file that there was, "" for none: what stays
    the same keeps its place and its comments. source: the input, for the first line of a new file.
    """
    if not base:
        return _fresh(wanted, source)
    if tomllib.loads(base) == wanted:
        return base
    # An editor of TOML may be wrong about a corner of the language; what it writes is read again.
    with suppress(Exception):
        text = _edit(base, wanted)
        if tomllib.loads(text) == wanted:
            return text
    return _fresh(wanted, source)


def keeps_comments(base: str, text: str) -> bool:
    """Whether the comments of ``base`` stand in ``text`` too."""
    marks = [
        line.partition("#")[2].strip()
        for line in base.splitlines()
        if line.lstrip().startswith("#")
    ]
    return all(mark in text for mark in marks)


def _fresh(wanted: Mapping[str, Any], source: str) -> str:
    lines = [
        f"# camgen job for {one_line(source)}",
        "# Lengths mm, angles deg, speeds mm/s, forces N, times s. What is not here has its default.",
    ]
    order = [*(name for name in list_tables() if name != "post"), *ROWS, "post"]
    for name in sorted(wanted, key=lambda name: order.index(name) if name in order else len(order)):
        content = wanted[name]
        if isinstance(content, list):
            for row in content:
                lines += ["", f"[[{_key(name)}]]", *_keys(name, row)]
        elif isinstance(content, Mapping):
            lines += ["", f"[{_key(name)}]", *_keys(name, content)]
        else:  # stands in no table: reading it says so
            lines.insert(2, f"{_key(name)} = {toml(content)}")
    return "\n".join(lines) + "\n"


def _keys(table: str, content: Mapping[str, Any]) -> list[str]:
    """The keys in the order of the job file's page."""
    order = [s.key for s in list_settings() if s.table == table or table in ROWS]
    names = sorted(content, key=lambda key: order.index(key) if key in order else len(order))
    return [f"{_key(key)} = {toml(content[key])}" for key in names]


def _key(name: str) -> str:
    return name if _BARE.fullmatch(name) else toml(name)


def _edit(base: str, wanted: Mapping[str, Any]) -> str:
    """``base`` with the values of ``wanted``, its comments where they were."""
    import tomlkit  # noqa: PLC0415 (only where a job file with comments is changed)

    found: Any = tomlkit.parse(base)
    held = found.unwrap()
    for name in [name for name in held if name not in wanted]:
        del found[name]
    for name, content in wanted.items():
        if held.get(name) == content:
            continue
        if isinstance(content, Mapping) and isinstance(held.get(name), Mapping):
            _edit_table(found[name], held[name], content)
        elif isinstance(content, list) and isinstance(held.get(name), list) and name in ROWS:
            _edit_rows(found, name, held[name], content)
        else:
            found[name] = tomlkit.item(content)
    return str(tomlkit.dumps(found))


def _edit_table(table: Any, held: Mapping[str, Any], content: Mapping[str, Any]) -> None:
    for key in [key for key in held if key not in content]:
        del table[key]
    for key, value in content.items():
        if key not in held or held[key] != value:
            table[key] = value


def _edit_rows(found: Any, name: str, held: list[Any], content: list[Any]) -> None:
    """Rows that stay in their place keep their comments; where their number changes they are written anew."""
    import tomlkit  # noqa: PLC0415 (only where a job file with comments is changed)

    if len(held) != len(content):
        rows = tomlkit.aot()
        for row in content:
            table = tomlkit.table()
            table.update(row)
            rows.append(table)
        found[name] = rows
        return
    for table, before, row in zip(found[name], held, content, strict=True):
        _edit_table(table, before, row)
