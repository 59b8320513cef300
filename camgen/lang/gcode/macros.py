"""Fanuc's macros: IF, GOTO, THEN, WHILE, DO, ``#1=#2+1``, and the arguments of G65.

Source: operator's manual, custom macro.
"""

from __future__ import annotations

import re

from camgen.lang.gcode.words import Parameters, UnknownWord, key_at, value_at, words_of

_DO = re.compile(r"do([0-9]+)")
#: The parameters of the arguments of G65.
ARGUMENTS = dict(
    zip("ABCIJKDEFHMQRSTUVWXYZ", [1, 2, 3, 4, 5, 6, 7, 8, 9, 11, 13, *range(17, 27)], strict=True)
)


def take_arguments(words: dict[str, float]) -> dict[int, float]:
    """Removes the arguments of a macro. Returns its parameters."""
    return {ARGUMENTS[letter]: words.pop(letter) for letter in [*words] if letter in ARGUMENTS}


def test_branch(text: str, known: Parameters) -> tuple[bool, str]:
    """The condition of IF, and the text after it. Raises LineError.

    text: line in lower case without comments and blanks.
    """
    holds, at = value_at(text, 2, known)
    rest = text[at:]
    if not rest.startswith(("goto", "then")):
        raise UnknownWord(f"cannot read {rest[:12]!r} after IF")
    return bool(holds), rest


def test_loop(text: str, known: Parameters) -> bool:
    """The condition of WHILE, true for DO without it. Raises LineError.

    text: line in lower case without comments and blanks.
    """
    holds, at = (1.0, 0) if text.startswith("do") else value_at(text, 5, known)
    if not _DO.fullmatch(text, at):
        raise UnknownWord(f"cannot read {text[at : at + 12]!r} after WHILE")
    return bool(holds)


def set_then(text: str, known: Parameters) -> None:
    """Sets the parameters after THEN. Raises LineError."""
    if not assign(text, known):
        codes, words = words_of(text, known)
        if codes or words:
            raise UnknownWord(f"cannot read {text[:12]!r} after THEN")


def read_goto(text: str, known: Parameters) -> str:
    """The label of the line to which GOTO leads, n20. Raises LineError."""
    value, end = value_at(text, 4, known)
    if end < len(text):
        raise UnknownWord(f"cannot read {text[end : end + 12]!r} after GOTO")
    return f"n{value:.0f}"


def assign(text: str, known: Parameters) -> bool:
    """Sets the parameter of a line that does nothing else, ``#1=#2+1``. It needs no brackets.

    Returns False for any other line. text: bare. Raises LineError for a value that does not exist.
    """
    if not text.startswith("#"):
        return False
    key, at = key_at(text, 0, known)
    if text[at : at + 1] != "=" or text.find("=", at + 1) >= 0:
        return False
    value, end = value_at(f"[{text[at + 1 :]}]", 0, known)
    if end < len(text) - at + 1:
        return False
    known.set(key, value)
    return True
