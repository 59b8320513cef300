"""Spellings that no program of a post has and whose effect no public text defines."""

from __future__ import annotations

import re

from .machine import StrictMachine

_QUOTED = re.compile(r'"[^"]*"')
#: Unusual spellings. RC8 manual 456 allows to omit numbers of a position without an example.
#: Published programs have positions without their `P`.
_UNUSUAL = (
    (re.compile(r"[(\[,]\s*(?=,)|,\s*(?=[)\]])"), "a value is left out between commas"),
    (re.compile(r"(?<!\w)\(\s*[-+]?[\d.]+\s*\)"), "a bracket stands around a single number"),
    (re.compile(r"[-+*/]\s*[-+]"), "a sign stands right after another or after an operator"),
    (
        re.compile(r"(?:[,=]|@\s*\[?\s*(?:[0PEC]|\d+)\s*\]?)\s*\([^(),]*,[^(),]*,", re.IGNORECASE),
        "a position stands without its P",
    ),
)


def note_unusual(machine: StrictMachine, text: str) -> None:
    """Adds findings for unusual spellings in a statement."""
    bare = _QUOTED.sub("", text)
    for pattern, what in _UNUSUAL:
        if pattern.search(bare):
            machine.remark(what)
