"""Recognises G-code by the name and the text of a file, without the interpreter."""

from __future__ import annotations

import re

SUFFIXES = (".nc", ".ngc", ".gcode", ".gc", ".tap", ".cnc", ".eia", ".anc", ".din")
#: Number of characters that are examined.
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
    """Whether the beginning of a text is certainly G-code.

    It has a motion, and at least nine tenths of it are words, apart from comments and blanks.
    """
    head = text[:_BEGINNING]
    if "\0" in head or not (_MOTION.search(head) and _AXIS.search(head)):
        return False
    if len(head) == _BEGINNING:
        head = head.rsplit("\n", 1)[0]  # its last line may be cut
    bare = re.sub(r"\s+", "", _COMMENT.sub("", head))
    return bool(bare) and len(_WORD.sub("", bare)) <= 0.1 * len(bare)
