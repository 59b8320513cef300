"""A line of G-code as codes by modal group and words by letter."""

from __future__ import annotations

import re
from functools import lru_cache

from camgen.gcode.expressions import Parameters, key_at, value_at
from camgen.gcode.wrong import Unread, Wrong

#: Codes by modal group, as the LinuxCNC manual lists them: two of one group in a line contradict each other.
_GROUPS = {
    "cycle off": "G80",
    "motion": "G0 G1 G2 G3 G73 G81 G82 G83 G85 G86 G89",
    "plane": "G17 G18 G19",
    "distance": "G90 G91",
    "arc distance": "G90.1 G91.1",
    "feed mode": "G93 G94 G95",
    "units": "G20 G21",
    "cutter compensation": "G40",
    "length offset": "G43 G49",
    "return level": "G98 G99",
    "work offset": "G54 G55 G56 G57 G58 G59 G59.1 G59.2 G59.3",
    "path": "G61 G61.1 G64",
    "spindle mode": "G97",
    "offsets": "G10 G92 G92.1 G92.2",
    "dwell": "G4",
    "lathe radius": "G8",
    "stop": "M0 M1 M2 M30 M60",
    "outputs": "M62 M63 M64 M65 M67 M68",
    "tool change": "M6",
    "spindle": "M3 M4 M5",
    "override": "M48 M49",
}
_GROUP = {code: group for group, codes in _GROUPS.items() for code in codes.split()}
#: M7 and M8 may stand in one line.
_GROUP |= {"M7": "mist", "M8": "flood", "M9": "coolant off"}

#: Codes that exist but are not replayed, by why.
_UNREAD = {
    "goes to a position that the machine stores": "G28 G28.1 G30 G30.1",
    "goes to machine coordinates, which are not known here": "G53",
    "cutter compensation: the controller moves the path by the radius of the tool": "G41 G41.1 G42 G42.1",
    "a tool length that the program sets itself": "G43.1 G43.2",
    "a cycle that taps, stops or turns the spindle back": "G74 G84 G87 G88",
    "a thread": "G33 G33.1 G76",
    "a probe": "G38.2 G38.3 G38.4 G38.5",
    "a spline": "G5 G5.1 G5.2 G5.3",
    "lathe diameters": "G7",
    "constant surface speed": "G96",
    "a shift of the origin": "G52",
    "brings an earlier shift back": "G92.3",
    "waits for an input": "M66",
    "turns the spindle to an angle": "M19",
    "a subprogram of other controllers": "M97 M98 M99",
    "sets the number of the tool": "M61",
    "keeps or restores the modes": "M70 M71 M72 M73",
}
_WHY = {code: why for why, codes in _UNREAD.items() for code in codes.split()}
_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)")
_COMMENT = re.compile(r"\([^()]*\)|;.*")
_NUMBERED = re.compile(r"n[0-9]+(?:\.[0-9]*)?")
_LETTERS = frozenset("abcdefghijklmpqrstuvwxyz@^")
#: Numbers beyond this are no machine's. mm, mm/min, rpm.
_HUGE = 1e7

Line = tuple[dict[str, str], dict[str, float]]


def bare(raw: str) -> str:
    """The line without comments, blanks, block delete and number, in small letters. Raises Wrong.

    Comments that LinuxCNC acts on only print or log; a line of Python is turned down.
    """
    if ";" in raw or "(" in raw or ")" in raw:
        if raw.lstrip().lower().startswith(";py,"):
            raise Wrong("a line of Python")
        if re.search(r"\(\s*(?:probeopen|abort)\b", raw, re.IGNORECASE):
            raise Wrong("an active comment that stops or probes")
        raw = _COMMENT.sub("", raw)
        if "(" in raw or ")" in raw:
            raise Wrong("a comment that is not closed, or closed twice")
    text = "".join(raw.split()).lower()
    text = text.removeprefix("/")
    if text.startswith("n"):
        numbered = _NUMBERED.match(text)
        if not numbered:
            raise Wrong("N without a number")
        text = text[numbered.end() :]
    return text


def words_of(text: str, known: Parameters) -> Line:
    """Codes by group and words by letter of a bare line; parameters are set once all of it is read. Raises Wrong."""
    codes: dict[str, str] = {}
    words: dict[str, float] = {}
    setting: list[tuple[int | str, float]] = []
    at = 0
    while at < len(text):
        letter = text[at]
        if letter == "#":
            key, at = key_at(text, at, known)
            if text[at : at + 1] != "=":
                raise Wrong(f"cannot read {text[at : at + 12]!r}: a parameter that stands alone is set with =")
            value, at = value_at(text, at + 1, known)
            setting.append((key, value))
            continue
        if letter not in _LETTERS:
            raise Wrong(f"cannot read {text[at : at + 12]!r}")
        number = _NUMBER.match(text, at + 1)
        value, at = (float(number[0]), number.end()) if number else value_at(text, at + 1, known)
        if not -_HUGE < value < _HUGE:
            raise Wrong(f"word {letter.upper()}{value:g} is out of range")
        if letter in "gm":
            _code(codes, letter.upper(), value)
        elif letter.upper() in words:
            raise Wrong(f"word {letter.upper()} twice in one line")
        else:
            words[letter.upper()] = value
    for key, value in setting:
        known.put(key, value)
    return codes, words


def _code(codes: dict[str, str], letter: str, number: float) -> None:
    code = _named(letter, number)
    group = _GROUP.get(code)
    if group is None:
        raise Unread(f"{code} is not read: {_WHY.get(code, 'not a code that is known')}")
    if group in codes:
        raise Wrong(f"{codes[group]} and {code} are of one group ({group})")
    codes[group] = code


@lru_cache(maxsize=1024)
def _named(letter: str, number: float) -> str:
    return f"{letter}{round(number, 3):g}"
