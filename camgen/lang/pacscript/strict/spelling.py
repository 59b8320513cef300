"""What no program of the post spells so, and no public text says how a controller takes."""

from __future__ import annotations

import re

_QUOTED = re.compile(r'"[^"]*"')
#: RC8 manual 456 has numbers left out of a position, not how; published programs have positions without their ``P``.
_UNUSUAL = (
    (re.compile(r"[(\[,]\s*(?=,)|,\s*(?=[)\]])"), "a value is left out between commas"),
    (re.compile(r"(?<!\w)\(\s*[-+]?[\d.]+\s*\)"), "a bracket stands around a single number"),
    (re.compile(r"[-+*/]\s*[-+]"), "a sign stands right after another or after an operator"),
    (
        re.compile(r"(?:[,=]|@\s*\[?\s*(?:[0PEC]|\d+)\s*\]?)\s*\([^(),]*,[^(),]*,", re.IGNORECASE),
        "a position stands without its P",
    ),
)


def find_unusual(text: str) -> list[str]:
    """What is unusual about the spelling of a statement."""
    bare = _QUOTED.sub("", text)
    return [what for pattern, what in _UNUSUAL if pattern.search(bare)]
