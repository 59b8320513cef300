"""The digest of a program in its own header, by which an edit of the program shows.

The digest stands at the end of the header line that names the job. Line ends, blanks at the ends of
lines and empty lines at the end of the text do not count, since editors and transfers change them.
"""

from __future__ import annotations

import hashlib
import re
from typing import Literal

#: Characters at the start of a program in which its header stands.
HEADER_LENGTH = 4000
_HEADER = re.compile(r"\bcamgen \S+ - job [0-9a-f]{12}\b")
_SIGNED = re.compile(rf"{_HEADER.pattern}( - text ([0-9a-f]{{12}})\b)")
_BLANKS = re.compile(r"[ \t\r]+$", re.MULTILINE)
_DIGITS = 12

State = Literal["unsigned", "as written", "edited"]


def sign(text: str) -> str:
    r"""A program with the digest in its header; a text without a header as it is.

    >>> sign("; camgen 0.1.0 - job 0123456789ab\\nM5\\n").splitlines()[0]
    '; camgen 0.1.0 - job 0123456789ab - text 0867bb6108d9'
    """
    header = _HEADER.search(text, 0, HEADER_LENGTH)
    if header is None:
        return text
    return f"{text[: header.end()]} - text {_digest(text)}{text[header.end() :]}"


def read_signature(text: str) -> State:
    """Whether a program is as camgen wrote it; "unsigned" for a text without a digest."""
    signed = _SIGNED.search(text, 0, HEADER_LENGTH)
    if signed is None:
        return "unsigned"
    unsigned = text[: signed.start(1)] + text[signed.end(1) :]
    return "as written" if _digest(unsigned) == signed[2] else "edited"


def _digest(text: str) -> str:
    if "\r" in text or " \n" in text or "\t\n" in text:
        text = _BLANKS.sub("", text.replace("\r\n", "\n"))
    return hashlib.sha256(text.rstrip().encode("utf-8", "surrogateescape")).hexdigest()[:_DIGITS]
