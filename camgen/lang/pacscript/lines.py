"""PacScript lines: comments, statements that go on, macros, and the words that open and close a procedure."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping

#: A line may hold so many bytes (RC8 manual 5225); a line may grow so long before it is given up.
LONGEST_LINE, LONGEST_GROWN = 1024, 8192
#: Macros may nest so deep.
DEEPEST_MACRO = 10
#: What makes the next line a part of this one: a name may end in _ too.
GOES_ON = re.compile(r"(?:^|\W)_$")
DEFINE = re.compile(r"#define\s+([a-z_]\w*)(?:\s+(.*)|$)", re.IGNORECASE | re.ASCII)
CLOSING = re.compile(r"end\s*(sub|function)", re.IGNORECASE)
PARAMETER = re.compile(
    r"\s*(?:(byval|byref)\s+)?([a-z_]\w*[!#%$]?)\s*(\([^()]*\))?\s*(?:as\s+(\w+))?\s*",
    re.IGNORECASE,
)
_QUOTED = re.compile(r'"[^"]*"|\'')
_WORD = re.compile(r'"[^"]*"|\b[a-z_]\w*', re.IGNORECASE)


def without_comment(text: str) -> str:
    """``text`` up to a comment, stripped; empty for ``Rem``."""
    if "'" in text:
        quote = next((m for m in _QUOTED.finditer(text) if m.group() == "'"), None)
        text = text[: quote.start()] if quote else text
    text = text.strip()
    return "" if text[:3].lower() == "rem" and text[3:4] in ("", " ", "\t") else text


def expand(text: str, macros: Mapping[str, str]) -> str:
    """``text`` with the macros, by lower-case name, replaced outside quotes. ValueError where that has no end."""
    replaced = False

    def put(match: re.Match[str]) -> str:
        nonlocal replaced
        found = macros.get(match[0].lower())
        replaced = replaced or found is not None
        return match[0] if found is None else found

    for _ in range(DEEPEST_MACRO):
        replaced = False
        text = _WORD.sub(put, text)
        if not replaced:
            return text
        if len(text) > LONGEST_GROWN:
            break
    raise ValueError("a macro that refers to itself or grows without end")


def too_long(row: str) -> bool:
    """Whether a line has more bytes than the language allows."""
    return (
        len(row) > LONGEST_LINE // 4
        and len(row.rstrip("\r").encode("utf-8", "replace")) > LONGEST_LINE
    )


def join(rows: list[str], before: int, say: Callable[[int, str], None]) -> list[tuple[int, str]]:
    """Statements of whole lines, without comments, by the number of their first line, counted from ``before`` on."""
    found: list[tuple[int, str]] = []
    first, begun = 0, ""
    for number, row in enumerate(rows, start=before + 1):
        if too_long(row):
            say(number, f"a line of more than {LONGEST_LINE} bytes")
        text = begun + without_comment(row)
        first = first if begun else number
        if text.endswith("_") and GOES_ON.search(text[-2:]) and len(text) < LONGEST_GROWN:
            begun = text[:-1] + " "
            continue
        begun = ""
        if text:
            found.append((first, text))
    if begun:
        say(first, "the statement goes on after the last line")
    return found
