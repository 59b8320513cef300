"""Fanuc's macros: IF, GOTO, THEN, WHILE, DO and END, ``#1=#2+1``, and the arguments of G65 (operator's manual, custom
macro).
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Mapping, Sequence

from camgen.lang.gcode.words import LineError, Parameters, UnknownWord, key_at, value_at, words_of

_BEGINS = ("if", "goto", "while", "end", "do")
_END = re.compile(r"[ \t]*(?:[nN][0-9]+)?[ \t]*[eE][nN][dD][ \t]*([0-9]{1,6})")
_DO = re.compile(r"do([0-9]+)")
#: The parameters of the arguments of G65.
ARGUMENTS = dict(
    zip("ABCIJKDEFHMQRSTUVWXYZ", [1, 2, 3, 4, 5, 6, 7, 8, 9, 11, 13, *range(17, 27)], strict=True)
)


def find_ends(lines: Sequence[str]) -> dict[int, list[int]]:
    """The lines (from 0) with END, by its number."""
    found: dict[int, list[int]] = {}
    for k, line in enumerate(lines):
        end = _END.match(line)
        if end:
            found.setdefault(int(end[1]), []).append(k)
    return found


def jump(
    text: str, at: int, ends: Mapping[int, Sequence[int]], known: Parameters, loops: dict[int, int]
) -> int | str | None:
    """Where a line leads that is a macro's: the place (from 0) of the next one, or the number of a line, n10. None: it
    is none. text: bare. ends: see ``find_ends``. loops: where the loops began that run, by number. Raises LineError.
    """
    if not text.startswith(_BEGINS):
        return None
    if text.startswith("goto"):
        return _number(text, 4, known)
    if text.startswith("if"):
        return _branch(text, at, known)
    if text.startswith("end"):
        number = int(text[3:]) if text[3:].isdigit() else -1
        if number not in loops:
            raise LineError(f"{text[:8].upper()} has no WHILE or DO before it")
        return loops[number]
    holds, place = (1.0, 0) if text.startswith("do") else value_at(text, 5, known)
    loop = _DO.fullmatch(text, place)
    if loop is None:
        raise UnknownWord(f"cannot read {text[place : place + 12]!r} after WHILE")
    number = int(loop[1])
    if holds:
        loops[number] = at
        return at + 1
    places = ends.get(number, ())
    k = bisect_right(places, at)
    if k < len(places):
        return places[k] + 1
    raise LineError(f"WHILE DO{number} has no END{number}")


def _branch(text: str, at: int, known: Parameters) -> int | str:
    holds, place = value_at(text, 2, known)
    rest = text[place:]
    if rest.startswith("goto"):
        return _number(rest, 4, known) if holds else at + 1
    if not rest.startswith("then"):
        raise UnknownWord(f"cannot read {rest[:12]!r} after IF")
    if holds and not assign(rest[4:], known):
        codes, words = words_of(rest[4:], known)
        if codes or words:
            raise UnknownWord(f"cannot read {rest[4:16]!r} after THEN")
    return at + 1


def assign(text: str, known: Parameters) -> bool:
    """Sets the parameter of a line that does nothing else, ``#1=#2+1``: no brackets are needed there. False for any
    other line. text: bare. Raises LineError for a value that there is none of.
    """
    if not text.startswith("#"):
        return False
    key, at = key_at(text, 0, known)
    if text[at : at + 1] != "=" or text.find("=", at + 1) >= 0:
        return False
    value, end = value_at(f"[{text[at + 1 :]}]", 0, known)
    if end < len(text) - at + 1:
        return False
    known.put(key, value)
    return True


def _number(text: str, place: int, known: Parameters) -> str:
    value, end = value_at(text, place, known)
    if end < len(text):
        raise UnknownWord(f"cannot read {text[end : end + 12]!r} after GOTO")
    return f"n{value:.0f}"
