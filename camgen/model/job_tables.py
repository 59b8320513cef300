"""Lists the settings of a job: names, defaults and meanings, and which of them name a file."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import msgspec
from msgspec import Struct

from camgen.model.job import (
    PAGE_CLEARANCE,
    SPEEDS,
    Choice,
    DrawnFixture,
    Job,
    OperationTable,
    ProcessTable,
    ToolRow,
)

#: Settings that name a file; `cell.robot` only if it ends in .urdf.
FILES = (
    ("image", "background"),
    ("image", "lamp_moved"),
    ("camera", "file"),
    ("tool", "file"),
    ("cell", "file"),
    ("cell", "robot"),
    ("cell", "machine"),
)
#: Suffixes of robot files. xacro is a language that makes URDF; such a file is refused when read.
_SUFFIXES = (".urdf", ".xacro")


def split_name(name: str) -> tuple[str, str] | None:
    """The file of a robot and the link at its tip, "" for none; None for a built-in robot.

    >>> split_name("cell/arm.urdf#tool0"), split_name("arm.URDF"), split_name("IRB 120")
    (('cell/arm.urdf', 'tool0'), ('arm.URDF', ''), None)
    """
    file, mark, tip = name.rpartition("#")
    if mark and file.lower().endswith(_SUFFIXES):
        return file, tip
    return (name, "") if name.lower().endswith(_SUFFIXES) else None


class Setting(Struct, frozen=True):
    """One key of a job file.

    table, key: its place in the job file.
    default: value of a job without the key.
    allowed: possible values, in words.
    about: meaning, in words.
    """

    table: str
    key: str
    default: object
    allowed: str
    about: str


#: Keys of `[tool]` that a row of `[[tools]]` does not have.
NOT_IN_ROWS = ("file",)
#: Tables of which a job may have several, such as `[[tools]]`, with the types of their rows.
ROWS: dict[str, tuple[type[Struct], ...]] = {
    "tools": (ToolRow,),
    "operations": (Choice, OperationTable, ProcessTable),
}


@cache
def list_settings() -> tuple[Setting, ...]:
    """All settings in the order of the job file, without those of `[post]` and of `ROWS`."""
    rows: list[Setting] = []
    for table, kind in _kinds().items():
        rows += _read_settings(table, kind)
    return tuple(rows)


#: Settings whose defaults depend on others.
BESIDE = (("process", "clearance"),)


def defaults_beside(tree: Mapping[str, Any]) -> dict[tuple[str, str], object]:
    """The settings of `BESIDE` that have another default in a job with the tables of `tree`."""
    page = tree.get("page")
    on_page = isinstance(page, Mapping) and page.get("size")
    return {("process", "clearance"): PAGE_CLEARANCE} if on_page else {}


@cache
def list_row_settings() -> tuple[Setting, ...]:
    """The settings that a row of each table of `ROWS` may have."""
    rows: list[Setting] = []
    for table, kinds in ROWS.items():
        for kind in kinds:
            rows += [row for row in _read_settings(table, kind) if row.key not in NOT_IN_ROWS]
    return tuple(rows)


def list_keys(table: str) -> tuple[str, ...]:
    """The keys of a table, or of a row of one of `ROWS`.

    Every job needs them, so they are found without the types and descriptions of the settings.

    table: name, for a row with a dot and its number.
    """
    name, dot, _ = table.partition(".")
    kinds = ROWS[name] if dot else (_kinds()[name],)
    excluded = NOT_IN_ROWS if dot else ()
    keys: list[str] = []
    for kind in kinds:
        keys += [key for key in kind.__struct_fields__ if key not in excluded]
    return tuple(keys)


def _read_settings(table: str, kind: type[Struct]) -> list[Setting]:
    defaults = msgspec.structs.asdict(kind())
    rows = []
    for key, hint in get_type_hints(kind, include_extras=True).items():
        about = next((m.description for m in get_args(hint)[1:] if m.description), "")
        allowed = _describe_type(hint)
        if has_speed(table, key):
            allowed += ' or a text with its unit, "1200 mm/min"'
        rows.append(Setting(table, key, defaults[key], allowed, about))
    return rows


def has_speed(table: str, key: str) -> bool:
    """Whether a setting is a speed of the tool, which may be given with its unit.

    table: name of the table, for a row without its number.
    """
    return key in SPEEDS and table in ("process", *ROWS)


@cache
def _kinds() -> dict[str, type[Struct]]:
    return {name: hint for name, hint in get_type_hints(Job).items() if name not in ("post", *ROWS)}


def list_tables() -> dict[str, str]:
    """The tables of a job file and their purpose, without `ROWS`."""
    about = {name: (hint.__doc__ or "").partition(": ")[2] for name, hint in _kinds().items()}
    return about | {"post": "options of the chosen post."}


def list_row_tables() -> dict[str, str]:
    """The tables of `ROWS` and the purpose of their rows."""
    purposes = {}
    for name, kinds in ROWS.items():
        purpose = (kinds[0].__doc__ or "").partition(": ")[2]
        purposes[name] = " ".join(purpose.split())
    return purposes


#: Signs of the bounds of a setting, by their names in `Meta`.
_BOUNDS = {"gt": ">", "ge": ">=", "lt": "<", "le": "<="}
_WORDS = {float: "a number", int: "a whole number", str: "a text", bool: "true or false"}
_PLURALS: dict[object, str] = {
    float: "numbers",
    str: "texts",
    list[float]: "lists of numbers",
    list[float] | str | DrawnFixture: "lists of numbers, texts and tables of layer, top and bottom",
}


def _describe_type(hint: Any) -> str:
    if get_origin(hint) is Annotated:
        base, *metas = get_args(hint)
        bounds = []
        for name, sign in _BOUNDS.items():
            values = [getattr(meta, name) for meta in metas]
            bounds += [f" {sign} {value:g}" for value in values if value is not None]
        return _describe_type(base) + " and".join(bounds)
    if get_origin(hint) is Literal:
        return "one of " + ", ".join(json.dumps(value) for value in get_args(hint))
    if get_origin(hint) is dict:
        return "a table"
    if get_origin(hint) is list:
        (kind,) = get_args(hint)
        if get_origin(kind) is Literal:
            return "a list, each " + _describe_type(kind)
        return "a list of " + _PLURALS[kind]
    if get_origin(hint) in (Union, UnionType):  # a value or nothing, or one of several kinds
        return " or ".join(
            _describe_type(kind) for kind in get_args(hint) if kind is not type(None)
        )
    return _WORDS[hint]
