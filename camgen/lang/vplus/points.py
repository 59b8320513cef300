"""Reads the sections .LOCATIONS, .REALS and .STRINGS, and files of taught locations.

STORE writes such sections: a name and its values, with blanks or commas between them. A
transformation has x, y, z, yaw, pitch and roll, a precision point (`#`) has joint values.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping

from camgen.lang.log import Log
from camgen.lang.values import require
from camgen.model.pose import Pose
from camgen.model.text import counted

from .locations import to_joints
from .names import canonical
from .text import SECTIONS, Location, Unreadable, rotation_zyz
from .variables import Value

_NAME = re.compile(
    r"(?:SET\s+)?([#$]?[A-Za-z][A-Za-z0-9._]*)\s*((?:\[[0-9,\s]*\])?)\s*=?\s*(.*)", re.IGNORECASE
)
_CALL = re.compile(r"#?(?:TRANS|PPOINT)\s*\((.*)\)", re.IGNORECASE)
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")


def read_values(lines: Iterable[tuple[int, str, str]], log: Log) -> dict[str, Value]:
    """Read the lines of other sections. Returns the values by name; an invalid line is a finding.

    lines: line, section and text.
    """
    values: dict[str, Value] = {}
    for line, section, text in lines:
        try:
            name, value = _read(section, text)
        except Unreadable as error:
            log.find("refused", str(error), line=line)
        else:
            values[name] = value
    return values


def read_points(files: Mapping[str, str], log: Log) -> dict[str, Value]:
    """Read files that the user names. Returns the values by name; invalid lines are a fact.

    Lines before the first section are locations.
    """
    values: dict[str, Value] = {}
    for name, text in files.items():
        section, wrong = ".LOCATIONS", 0
        for raw in text.splitlines():
            code = raw.partition(";")[0].strip(" \t\f\x1a") if '"' not in raw else raw.strip()
            if not code or code.upper().startswith(".END"):
                continue
            if code.upper() in SECTIONS:
                section = code.upper()
                continue
            try:
                key, value = _read(section, code)
            except Unreadable:
                wrong += 1
            else:
                values[key] = value
        if wrong:
            log.fact(f"of {name}", f"{counted(wrong, 'line')} without a location")
    return values


def _read(section: str, text: str) -> tuple[str, Value]:
    match = require(_NAME.fullmatch(text), Unreadable(f"not a name and its values: {text[:40]}"))
    key = canonical(match[1] + "".join(match[2].split()))
    rest = match[3].strip()
    if key[0] == "$":
        return key, rest[1:-1] if len(rest) > 1 and rest[0] == rest[-1] == '"' else rest
    inner = _CALL.fullmatch(rest)
    parts = re.findall(r"[^\s,]+", inner[1] if inner else rest)
    if not parts or len(parts) > 12 or not all(map(_NUMBER.fullmatch, parts)):
        raise Unreadable(f"not a name and its values: {text[:40]}")
    values = list(map(float, parts))
    if not all(abs(value) <= 1e9 for value in values):
        raise Unreadable(f"a number beyond any machine: {text[:40]}")
    if key[0] == "#":
        if len(values) != 4:
            values += [0.0] * (6 - len(values))
        return key, to_joints(values)
    if len(values) == 1 and (section != ".LOCATIONS" or not inner):
        return key, values[0]
    if section in (".REALS", ".DOUBLES") or len(values) > 6:
        raise Unreadable(f"{len(values)} values of one real: {text[:40]}")
    x, y, z, yaw, pitch, roll = values + [0.0] * (6 - len(values))
    return key, Location(Pose(rotation_zyz(yaw, pitch, roll), (x, y, z)), name=key)
