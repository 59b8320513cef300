"""Checks the text of a line in a strict run: its characters, comments, number and words.

The limits are those of a `Controller`.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from camgen.lang.gcode import arcs
from camgen.lang.gcode.words import COMMENT, LineError, UnknownWord, without_number

_WORDS = re.compile(r"([a-z])([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+))")
_LINE = re.compile(rf"(?:{_WORDS.pattern})*")
#: Comments that LinuxCNC acts on. `MSG` only shows its text.
_ACTIVE = re.compile(
    r"\s*(debug|print|log|logopen|logappend|logclose|probeopen|probeclose|abort|py)\b",
    re.IGNORECASE,
)


@dataclass(frozen=True, slots=True)
class Controller:
    """The rules of a controller.

    name: name of the controller, for messages.
    codes: codes that are read.
    limit: maximum number of characters per line.
    squeezed: whether `limit` counts a line without its blanks and comments.
    forbidden: characters that may not occur, not even in a comment. None: all may occur.
    linuxcnc: whether per cent signs, active comments, block delete and circles without an end
        point have their meaning of LinuxCNC, not that of GRBL.
    arcs: tolerances of arcs.
    max_tool: largest T.
    max_line_number: largest N.
    """

    name: str
    codes: frozenset[str]
    limit: int
    squeezed: bool
    forbidden: re.Pattern[str] | None
    linuxcnc: bool
    arcs: arcs.Limits
    max_tool: float = math.inf
    max_line_number: float = math.inf


def check_characters(text: str, rules: Controller) -> None:
    """Raises LineError for a line that is too long or has characters that may not occur."""
    if not rules.squeezed and len(text) > rules.limit:
        raise LineError(f"{len(text)} characters, {rules.name} reads {rules.limit}")
    if rules.forbidden and (bad := rules.forbidden.search(text)):
        reason = f"acts at once or is not ASCII; {rules.name} rejects it in comments too"
        raise LineError(f"character {bad[0]!r} {reason}")


def remove_number(text: str, rules: Controller) -> str:
    """A line without its number. Raises LineError if the number is too large."""
    words = without_number(text)
    number = text[: len(text) - len(words)]
    if number and float(number[1:]) > rules.max_line_number:
        raise LineError(
            f"{number.upper()[:12]}: {rules.name} numbers lines to {rules.max_line_number:.0f}"
        )
    return words


def check_comments(text: str) -> None:
    """Raises LineError for a comment that LinuxCNC acts on."""
    for comment in COMMENT.finditer(text):
        if comment[1] is not None and "," in comment[1] and _ACTIVE.match(comment[1]):
            raise LineError(f"active comment {comment[0][:20]!r}")
        if comment[0].lower().startswith(";py,"):
            raise LineError("active comment ';py,'")


def check_words(text: str) -> None:
    """Raises LineError for anything but words with plain numbers."""
    if not _LINE.fullmatch(text):
        if any(character in text for character in "#[]"):
            raise UnknownWord("parameters and expressions are not read")
        if re.search("o[0-9<]", text):
            raise UnknownWord("O-words are not read")
        match = _LINE.match(text)
        raise LineError(f"cannot read {text[match.end() if match else 0 :].upper()[:12]!r}")
    if "n" in text or "o" in text:  # the number of a line or a program, which is not a word
        letter, number = next(word for word in _WORDS.findall(text) if word[0] in "no")
        raise LineError(f"word {letter.upper()}{float(number):g}: nothing in the line uses it")
