"""The settings of a job as a list: their names, defaults and meanings, and which of them name a file."""

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

#: The settings that name a file; cell.robot only where it ends in .urdf.
FILES = (
    ("image", "background"),
    ("image", "lamp_moved"),
    ("camera", "file"),
    ("tool", "file"),
    ("cell", "file"),
    ("cell", "robot"),
    ("cell", "machine"),
)
#: xacro is a language that makes URDF, and is refused where the file is read.
_SUFFIXES = (".urdf", ".xacro")


def split_name(name: str) -> tuple[str, str] | None:
    """The file and the link at its tip, "" where none is named; None for the name of a built-in robot.

    >>> split_name("cell/arm.urdf#tool0"), split_name("arm.URDF"), split_name("IRB 120")
    (('cell/arm.urdf', 'tool0'), ('arm.URDF', ''), None)
    """
    file, mark, tip = name.rpartition("#")
    if mark and file.lower().endswith(_SUFFIXES):
        return file, tip
    return (name, "") if name.lower().endswith(_SUFFIXES) else None


class Setting(Struct, frozen=True):
    """One key of a job file. allowed: what may stand there, in words. about: what it means."""

    table: str
    key: str
    default: object
    allowed: str
    about: str


#: Keys of [tool] that no single row of ``[[tools]]`` has.
NOT_IN_ROWS = ("file",)
#: The tables of which a job has several, ``[[tools]]``: what their rows hold.
ROWS: dict[str, tuple[type[Struct], ...]] = {
    "tools": (ToolRow,),
    "operations": (Choice, OperationTable, ProcessTable),
}


@cache
def settings() -> tuple[Setting, ...]:
    """All settings in the order of the job file, without those of ``[post]`` and of ``ROWS``."""
    return tuple(found for table, kind in _kinds().items() for found in _settings_of(table, kind))


#: The settings whose defaults hang on others.
BESIDE = (("process", "clearance"),)


def defaults_beside(tree: Mapping[str, Any]) -> dict[tuple[str, str], object]:
    """Of ``BESIDE`` those that have another default in a job with these tables."""
    page = tree.get("page")
    on_page = isinstance(page, Mapping) and page.get("size")
    return {("process", "clearance"): PAGE_CLEARANCE} if on_page else {}


@cache
def row_settings() -> tuple[Setting, ...]:
    """The settings that a row of each table of ``ROWS`` may hold."""
    return tuple(
        found
        for table, kinds in ROWS.items()
        for kind in kinds
        for found in _settings_of(table, kind)
        if found.key not in NOT_IN_ROWS
    )


def keys_of(table: str) -> tuple[str, ...]:
    """The keys that a table may hold, or a row of one of ``ROWS``: what is asked of every job, in little time."""
    name, dot, _ = table.partition(".")
    kinds = ROWS[name] if dot else (_kinds()[name],)
    left_out = NOT_IN_ROWS if dot else ()
    return tuple(key for kind in kinds for key in kind.__struct_fields__ if key not in left_out)


def _settings_of(table: str, kind: type[Struct]) -> list[Setting]:
    defaults = msgspec.structs.asdict(kind())
    found = []
    for key, hint in get_type_hints(kind, include_extras=True).items():
        about = next((m.description for m in get_args(hint)[1:] if m.description), "")
        allowed = _allow(hint) + (
            ' or a text with its unit, "1200 mm/min"' if has_speed(table, key) else ""
        )
        found.append(Setting(table, key, defaults[key], allowed, about))
    return found


def has_speed(table: str, key: str) -> bool:
    """Whether a setting is a speed of the tool, which may have its unit. table: without the number of a row."""
    return key in SPEEDS and table in ("process", *ROWS)


@cache
def _kinds() -> dict[str, type[Struct]]:
    return {name: hint for name, hint in get_type_hints(Job).items() if name not in ("post", *ROWS)}


def tables() -> dict[str, str]:
    """The tables of a job file with what each is for, without ``ROWS``."""
    about = {name: (hint.__doc__ or "").partition(": ")[2] for name, hint in _kinds().items()}
    return about | {"post": "options of the chosen post."}


def row_tables() -> dict[str, str]:
    """The tables of ``ROWS`` with what a row of each is for."""
    return {
        name: " ".join((kinds[0].__doc__ or "").partition(": ")[2].split())
        for name, kinds in ROWS.items()
    }


_WORDS = {float: "a number", int: "a whole number", str: "a text", bool: "true or false"}
_PLURALS: dict[object, str] = {
    float: "numbers",
    str: "texts",
    list[float]: "lists of numbers",
    list[float] | str | DrawnFixture: "lists of numbers, texts and tables of layer, top and bottom",
}


def _allow(hint: Any) -> str:
    """What a value of the type ``hint`` may be, in words."""
    if get_origin(hint) is Annotated:
        base, *metas = get_args(hint)
        bounds = [f" > {_number(m.gt)}" for m in metas if m.gt is not None]
        bounds += [f" >= {_number(m.ge)}" for m in metas if m.ge is not None]
        bounds += [f" < {_number(m.lt)}" for m in metas if m.lt is not None]
        bounds += [f" <= {_number(m.le)}" for m in metas if m.le is not None]
        return _allow(base) + " and".join(bounds)
    if get_origin(hint) is Literal:
        return "one of " + ", ".join(json.dumps(value) for value in get_args(hint))
    if get_origin(hint) is dict:
        return "a table"
    if get_origin(hint) is list:
        (kind,) = get_args(hint)
        if get_origin(kind) is Literal:
            return "a list, each " + _allow(kind)
        return "a list of " + _PLURALS[kind]
    if get_origin(hint) in (Union, UnionType):  # a value or nothing, or one of several kinds
        return " or ".join(_allow(kind) for kind in get_args(hint) if kind is not type(None))
    return _WORDS[hint]


def _number(value: float) -> str:
    return f"{value:g}"
