"""PacScript lines: comments, statements that go on, macros, and the ends of procedures."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping

from camgen.lang.columns import Run
from camgen.lang.pacscript.plain import MOTIONS

#: Takes the number of a line and a finding about it.
FaultCallback = Callable[[int, str], None]

#: Bytes of a line at most (RC8 manual 5225), and characters beyond which a line does not go on.
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
    """Replace macros outside of quotes. Raises ValueError if that has no end.

    macros: texts by the name in lower case.
    """
    replaced = False

    def replace_word(match: re.Match[str]) -> str:
        nonlocal replaced
        macro = macros.get(match[0].lower())
        replaced = replaced or macro is not None
        return match[0] if macro is None else macro

    for _ in range(DEEPEST_MACRO):
        replaced = False
        text = _WORD.sub(replace_word, text)
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


def join(
    text: str, before: int, report: FaultCallback, remark: FaultCallback | None = None
) -> list[tuple[int, str | Run]]:
    """Split a text into statements, each with the number of its first line.

    A statement is a text of whole lines without comments. Motions in the usual spelling are runs.

    before: number of lines before the text.
    report: called with line and text of a fault.
    remark: takes note of a comment that another reader may take for the start of a statement.
    """
    statements: list[tuple[int, str | Run]] = []
    number, first, begun = before, 0, ""
    for piece in MOTIONS.cut(text):
        if isinstance(piece, Run) and not begun:
            statements.append((number + 1, piece))
            number += len(piece)
            continue
        for row in split_rows(piece):
            number += 1
            if too_long(row):
                report(number, f"a line of more than {LONGEST_LINE} bytes")
            end = without_comment(row)
            if remark and row.rstrip().endswith(" _") and not end.endswith("_"):
                what = "a comment that ends in _: the controller may join the next line to it"
                remark(number, what)
            statement = begun + end
            if not begun:
                first = number
            begun = ""
            if GOES_ON.search(statement[-2:]) and len(statement) < LONGEST_GROWN:
                begun = statement[:-1] + " "
            elif statement:
                statements.append((first, statement))
    if begun:
        report(first, "the statement goes on after the last line")
    return statements


def split_rows(piece: str | Run) -> list[str]:
    """Return the lines of a piece of a text."""
    text = piece if isinstance(piece, str) else piece.source.text
    return text.removesuffix("\n").split("\n")
