"""The form of a job: the description, default, unit and kind of each setting, from the schema."""

from __future__ import annotations

import re
from collections import defaultdict
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
from camgen.robots.catalogue import list_robots

#: The unit at the end of a description, or at the end of its first part.
_UNIT = re.compile(
    r", (mm/s2|mm/s|mm2|mm|deg/mm|deg/s2|deg/s|deg|N|s|rpm)(?=$|;|:| \(|,)|^(mm|s)(?=;)"
)
#: Tables whose settings a row of `[[operations]]` or `[[tools]]` may override. Each is a group of
#: the form of a row.
_OVERRIDDEN = ("operation", "process", "tool")

FieldKind = Literal["choice", "flag", "number", "text", "free"]


class Field(Struct, frozen=True):
    """One setting.

    key: its key in the table.
    about: its description.
    allowed: description of the allowed values.
    default: its default, None without one.
    unit: its unit, "" without one.
    kind: kind of the input field; "free" for TOML.
    choices: all allowed values.
    minimum, maximum: bounds of a number, None for no bound.
    offers: known values. Others may be typed too.
    """

    key: str
    about: str
    allowed: str
    default: object
    unit: str
    kind: FieldKind
    choices: tuple[str, ...] = ()
    minimum: float | None = None
    maximum: float | None = None
    offers: tuple[str, ...] = ()


class Group(Struct, frozen=True):
    """A table of the job with its fields.

    table: its name.
    about: its description.
    fields: its settings.
    overridden: the table whose values a row overrides; "" for groups of other kinds.
    """

    table: str
    about: str
    fields: tuple[Field, ...]
    overridden: str = ""


class Form(Struct, frozen=True):
    """The form of a job.

    groups: groups of the tables of a job.
    rows: groups of a row of `[[tools]]` and of `[[operations]]`, by the name of the list.
    """

    groups: tuple[Group, ...]
    rows: dict[str, tuple[Group, ...]]


def make_form(post: str) -> Form:
    """The form of a job for the controller `post`. Raises JobError for an unknown post."""
    properties = schema(post)["properties"]
    groups = []
    for table, about in list_tables().items():
        keys = properties[table].get("properties", {})
        if table == "post":
            fields = [_make_option(key, rule) for key, rule in keys.items()]
        else:
            fields = [_make_field(s, keys[s.key]) for s in list_settings() if s.table == table]
        groups.append(Group(table, about, tuple(fields)))
    return Form(tuple(groups), {name: _make_row_groups(name, properties) for name in ROWS})


def _make_row_groups(name: str, properties: Mapping[str, Any]) -> tuple[Group, ...]:
    """The groups of a row: its own keys first, then those of the tables that it overrides."""
    keys = properties[name]["items"]["properties"]
    overridden = [table for table in _OVERRIDDEN if (table == "tool") == (name == "tools")]
    homes = {s.key: s.table for s in list_settings() if s.table in overridden}
    fields: dict[str, list[Field]] = defaultdict(list)
    for setting in list_row_settings():
        if setting.table == name:
            fields[homes.get(setting.key, name)].append(_make_field(setting, keys[setting.key]))
    groups = [Group(name, list_row_tables()[name], tuple(fields[name]))]
    for table in overridden:
        groups.append(Group(name, list_tables()[table], tuple(fields[table]), table))
    return tuple(groups)


def _make_field(setting: Setting, rule: Mapping[str, Any]) -> Field:
    """The field of a setting. rule: its rule in the schema."""
    unit = _UNIT.search(setting.about)
    choices = list(rule.get("enum", ()))
    bounds = _find_number(rule) or rule
    if setting.key == "kind" and setting.table in ("operation", "operations"):
        choices += [entry.name for entry in list_entries(OPERATIONS) if entry.name not in choices]
    return Field(
        key=setting.key,
        about=setting.about,
        allowed=setting.allowed,
        default=setting.default,
        unit=(unit[1] or unit[2]) if unit and _find_kind(rule) in ("number", "free") else "",
        kind=_find_kind(rule),
        choices=tuple(choices),
        minimum=bounds.get("minimum", bounds.get("exclusiveMinimum")),
        maximum=bounds.get("maximum", bounds.get("exclusiveMaximum")),
        offers=_list_robots() if (setting.table, setting.key) == ("cell", "robot") else (),
    )


@cache
def _list_robots() -> tuple[str, ...]:
    return tuple(robot.name for robot in list_robots())


def _make_option(key: str, rule: Mapping[str, Any]) -> Field:
    """The field of an option of a post."""
    choices = tuple(map(str, rule.get("enum", ())))
    about = str(rule.get("description", ""))
    return Field(key, about, "", rule.get("default"), "", _find_kind(rule), choices)


def _find_number(rule: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """The rule of the number of a speed, which may also be a text with a unit; None for others."""
    kinds = rule.get("anyOf", ())
    number = next((kind for kind in kinds if kind.get("type") == "number"), None)
    return number if any("pattern" in kind for kind in kinds) else None


def _find_kind(rule: Mapping[str, Any]) -> FieldKind:
    if "enum" in rule:
        return "choice"
    if _find_number(rule):
        return "number"
    kinds: dict[object, FieldKind] = {
        "boolean": "flag",
        "number": "number",
        "integer": "number",
        "string": "text",
    }
    return kinds.get(rule.get("type"), "free")


def find_setting(error: CamgenError) -> list[str | int]:
    """The setting that an error is about, as a path in the tables of the job, empty for none."""
    return (
        _find_dotted(f"{error.where} {error.file} {error.what}")
        or _find_in_table(error.where, error.what)
        or _find_dotted(error.remedy)
    )


def _find_dotted(text: str) -> list[str | int]:
    """The setting that a text names as `table.key` or `operations.0.key`, empty for none."""
    for name, row, key in re.findall(r"\b(tools|operations)\.(\d+)(?:\.(\w+))?", text):
        return [name, int(row), key] if key else [name, int(row)]
    known = {(s.table, s.key) for s in list_settings()}
    for table, key in re.findall(r"\b([a-z]+)\.([a-z_]+)\b", text):
        if (table, key) in known or table == "post":
            return [table, key]
    return []


def _find_in_table(where: str, what: str) -> list[str | int]:
    """The setting of an error at `[table]` or `[[rows]] 0` whose message names a key of it."""
    words = re.findall(r"\w+", what)
    if row := re.fullmatch(r"\[\[(\w+)\]\] (\d+)", where):
        keys = {s.key for s in list_row_settings() if s.table == row[1]}
        return [row[1], int(row[2]), *_find_first(words, keys)]
    table = re.match(r"\[(\w+)\](?: (\w+))?", where)
    if not table:
        return []
    if table[1] == "post":
        return ["post", table[2]] if table[2] else ["post"]
    return [table[1], *_find_first(words, {s.key for s in list_settings() if s.table == table[1]})]


def _find_first(words: Iterable[str], keys: set[str]) -> list[str | int]:
    return next(([word] for word in words if word in keys), [])
