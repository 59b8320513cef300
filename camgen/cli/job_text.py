"""Tables of a job as lines of a job file: the settings that differ from their defaults."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping
from pathlib import Path

from msgspec import Struct, structs

from camgen.model.job import Job
from camgen.model.job_tables import FILES, split_name
from camgen.model.toml import format_toml


def write_table(
    name: str, table: Struct, folder: Path, left_out: Collection[tuple[str, str]] = ()
) -> list[str]:
    """The lines of a table with a blank line before it; none if all settings have their defaults.

    folder: folder from which files are named.
    left_out: table and key of settings that are not written.
    """
    default = type(table)()
    values = {}
    for key, value in structs.asdict(table).items():
        if value != getattr(default, key) and (name, key) not in left_out:
            values[key] = _seen_from(folder, name, key, value)
    return write_values(name, values)


def write_values(name: str, values: Mapping[str, object]) -> list[str]:
    """The lines of a table with `values` by key; none without values."""
    if not values:
        return []
    return ["", f"[{name}]", *(f"{key} = {format_toml(value)}" for key, value in values.items())]


def write_tables(job: Job, folder: Path) -> list[str]:
    """The lines of all tables of a job without several operations."""
    lines: list[str] = []
    for name in job.__struct_fields__:
        table = getattr(job, name)
        if isinstance(table, Struct):
            lines += write_table(name, table, folder)
    return lines + write_values("post", job.post)


def _seen_from(folder: Path, table: str, key: str, value: object) -> object:
    """A setting with the files that it names as they are found from ``folder``."""
    if key == "fixtures" and isinstance(value, list):
        return [_relative(folder, item) if isinstance(item, str) else item for item in value]
    is_file = (table, key) in FILES and (key != "robot" or split_name(str(value)))
    return _relative(folder, str(value)) if is_file else value


def _relative(folder: Path, name: str) -> str:
    return Path(os.path.relpath(name, folder)).as_posix()
