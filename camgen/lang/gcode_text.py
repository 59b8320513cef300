"""What a file of G-code is called, and how its text is known. Nothing of the interpreter is needed for that."""

from __future__ import annotations

import re

SUFFIXES = (".nc", ".ngc", ".gcode", ".gc", ".tap", ".cnc", ".eia", ".anc", ".din")
#: So much of a text is looked at to tell what it is.
_BEGINNING = 20_000
_WORD = re.compile(r"[A-Z][ \t]*[-+]?(?:\d+\.?\d*|\.\d+|#[0-9<]|\[)", re.IGNORECASE)
_MOTION = re.compile(
    r"^[ \t/]*(?:N[ \t]*\d+[ \t]*)?(?:[GM][ \t]*\d+[ \t]*)*G[ \t]*0*[0-3](?![\d.])",
    re.IGNORECASE | re.MULTILINE,
)
_AXIS = re.compile(r"[XYZ][ \t]*[-+]?(?:\d|\.\d|#|\[)", re.IGNORECASE)
_COMMENT = re.compile(
    r"\([^()\n]*\)|;.*|^%.*|^[ \t]*[$].*|\bO[0-9<].*", re.MULTILINE | re.IGNORECASE
)


def is_gcode(text: str) -> bool:
    """Whether the beginning of a text is surely G-code: motions, and nearly nothing but words and comments."""
    head = text[:_BEGINNING]
    if "\0" in head or not (_MOTION.search(head) and _AXIS.search(head)):
        return False
    bare = re.sub(
        r"\s+", "", _COMMENT.sub("", head.rsplit("\n", 1)[0] if len(head) == _BEGINNING else head)
    )
    rest = _WORD.sub("", bare)
    return bool(bare) and len(rest) <= 0.1 * len(bare)
