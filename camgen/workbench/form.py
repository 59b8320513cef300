"""The job as a form: every setting with its sentence, default, unit and kind of field, from the job's own schema."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from functools import cache
from typing import Any, Literal

from msgspec import Struct

from camgen.model.errors import CamgenError
from camgen.model.job_tables import (
    ROWS,
    Setting,
    list_row_settings,
    list_row_tables,
    list_settings,
    list_tables,
)
from camgen.model.plugins import OPERATIONS, list_entries
from camgen.post.job_schema import schema
from camgen.robots.catalogue import robots

#: What a sentence ends with, or its first part does, where it has a unit.
_UNIT = re.compile(
    r", (mm/s2|mm/s|mm2|mm|deg/mm|deg/s2|deg/s|deg|N|s|rpm)(?=$|;|:| \(|,)|^(mm|s)(?=;)"
)
#: The settings of rows stand in these groups, as those of the tables that they lie over.
_LAID_OVER = ("operation", "process", "tool")

FieldKind = Literal["choice", "flag", "number", "text", "free"]


class Field(Struct, frozen=True):
    """One setting. about, allowed, default: as ``Setting`` has them. kind: how it is entered; free: as TOML. least,
    most: of a number, None where there is no bound. offers: values that are known, of those that may be typed.
    """

    key: str
    about: str
    allowed: str
    default: object
    unit: str
    kind: FieldKind
    choices: tuple[str, ...] = ()
    least: float | None = None
    most: float | None = None
    offers: tuple[str, ...] = ()


class Group(Struct, frozen=True):
    """A table of the job with its fields. over: of those of a row, the table whose values hold where it is silent."""

    table: str
    about: str
    fields: tuple[Field, ...]
    over: str = ""


class Form(Struct, frozen=True):
    """groups: the tables of a job. rows: those of a row of ``[[tools]]`` and of ``[[operations]]``."""

    groups: tuple[Group, ...]
    rows: dict[str, tuple[Group, ...]]


def form(post: str) -> Form:
    """The form of a job for the controller ``post``. JobError where there is no such post."""
    said = schema(post)["properties"]
    groups = []
    for table, about in list_tables().items():
        own = said[table].get("properties", {})
        if table == "post":
            fields = [_option(key, found) for key, found in own.items()]
        else:
            fields = [_field(s, own[s.key]) for s in list_settings() if s.table == table]
        groups.append(Group(table, about, tuple(fields)))
    return Form(tuple(groups), {name: _row_groups(name, said) for name in ROWS})


def _row_groups(name: str, said: Mapping[str, Any]) -> tuple[Group, ...]:
    """What a row may hold: its own keys first, then those of the tables that it lies over."""
    keys = said[name]["items"]["properties"]
    fields = {s.key: _field(s, keys[s.key]) for s in list_row_settings() if s.table == name}
    # A row of [[operations]] lies over [operation] and [process], one of [[tools]] has keys of its own.
    over = [table for table in _LAID_OVER if (table == "tool") == (name == "tools")]
    homes = {s.key: s.table for s in list_settings() if s.table in over}
    own = tuple(field for key, field in fields.items() if key not in homes)
    groups = [Group(name, list_row_tables()[name], own)]
    for table in over:
        found = tuple(field for key, field in fields.items() if homes.get(key) == table)
        groups.append(Group(name, list_tables()[table], found, table))
    return tuple(groups)


def _field(setting: Setting, said: Mapping[str, Any]) -> Field:
    unit = _UNIT.search(setting.about)
    choices = list(said.get("enum", ()))
    bounds = _number_of(said) or said
    if setting.key == "kind" and setting.table in ("operation", "operations"):
        choices += [entry.name for entry in list_entries(OPERATIONS) if entry.name not in choices]
    return Field(
        key=setting.key,
        about=setting.about,
        allowed=setting.allowed,
        default=setting.default,
        unit=(unit[1] or unit[2]) if unit and _kind(said) in ("number", "free") else "",
        kind=_kind(said),
        choices=tuple(choices),
        least=bounds.get("minimum", bounds.get("exclusiveMinimum")),
        most=bounds.get("maximum", bounds.get("exclusiveMaximum")),
        offers=_robots() if (setting.table, setting.key) == ("cell", "robot") else (),
    )


@cache
def _robots() -> tuple[str, ...]:
    return tuple(one.name for one in robots())


def _option(key: str, said: Mapping[str, Any]) -> Field:
    """An option of a post."""
    choices = tuple(str(one) for one in said.get("enum", ()))
    about = str(said.get("description", ""))
    return Field(key, about, "", said.get("default"), "", _kind(said), choices)


def _number_of(said: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """The number that a speed may be, which may also be a text with its unit."""
    kinds = said.get("anyOf", ())
    number = next((kind for kind in kinds if kind.get("type") == "number"), None)
    return number if any("pattern" in kind for kind in kinds) else None


def _kind(said: Mapping[str, Any]) -> FieldKind:
    if "enum" in said:
        return "choice"
    if _number_of(said):
        return "number"
    kinds: dict[object, FieldKind] = {
        "boolean": "flag",
        "number": "number",
        "integer": "number",
        "string": "text",
    }
    return kinds.get(said.get("type"), "free")


def find_place(error: CamgenError) -> list[str | int]:
    """The setting that an error is about, as a path in the tables of the job; empty where it names none."""
    said = f"{error.where} {error.file} {error.what}"
    return _dotted(said) or _in_table(error.where, error.what) or _dotted(error.remedy)


def _dotted(text: str) -> list[str | int]:
    """``table.key`` or ``operations.0.key`` in a text."""
    for name, row, key in re.findall(r"\b(tools|operations)\.(\d+)(?:\.(\w+))?", text):
        return [name, int(row), key] if key else [name, int(row)]
    known = {(s.table, s.key) for s in list_settings()}
    found = re.findall(r"\b([a-z]+)\.([a-z_]+)\b", text)
    return next(
        ([table, key] for table, key in found if (table, key) in known or table == "post"), []
    )


def _in_table(where: str, what: str) -> list[str | int]:
    """``[table]`` or ``[[rows]] 0`` as the place, and a key of it in the message."""
    words = re.findall(r"\w+", what)
    if row := re.fullmatch(r"\[\[(\w+)\]\] (\d+)", where):
        keys = {s.key for s in list_row_settings() if s.table == row[1]}
        return [row[1], int(row[2]), *_first(words, keys)]
    table = re.match(r"\[(\w+)\](?: (\w+))?", where)
    if not table:
        return []
    if table[1] == "post":
        return ["post", table[2]] if table[2] else ["post"]
    return [table[1], *_first(words, {s.key for s in list_settings() if s.table == table[1]})]


def _first(words: Iterable[str], keys: set[str]) -> list[str | int]:
    return next(([word] for word in words if word in keys), [])
