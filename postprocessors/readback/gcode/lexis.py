"""A line of G-code as codes by modal group and words by letter, for LinuxCNC and GRBL.

Written from the LinuxCNC manual (overview, G-codes, M-codes), checked against its interpreter, and from the GRBL 1.1
firmware. A line that its controller would turn down, or that this reader does not know, raises ``Wrong``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

from camgen.read.gcode.arcs import Limits
from camgen.read.gcode.words import Unread, Wrong

_WORD = r"([A-Z])([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+))"
_WORDS = re.compile(_WORD)
_LINE = re.compile(rf"(?:{_WORD})*")
_NUMBERED = re.compile(r"N[0-9]+(?:\.[0-9]*)?")
#: A comment in parentheses, or one that runs to the end of the line.
_COMMENT = re.compile(r"\(([^()]*)\)|;.*")
#: Comments that LinuxCNC acts on. ``MSG`` only shows its text.
_ACTIVE = re.compile(r"\s*(debug|print|log|logopen|logappend|logclose|probeopen|probeclose|abort|py)\b", re.IGNORECASE)
#: Numbers beyond this are no machine's, and their squares would leave the range of floats. mm, mm/min, rpm.
_HUGE = 1e7

#: Codes that exist but are not read, by what they are.
_UNREAD = {
    "a drilling cycle": "G73 G81 G82 G83 G84 G85 G86 G87 G88 G89",
    "a shift of the origin": "G10 G92 G92.1 G92.2 G92.3 G43.1 G43.2",
    "a motion to a stored or machine position": "G28 G28.1 G30 G30.1 G53",
    "a feed mode other than mm/min": "G93 G95",
    "cutter compensation": "G41 G41.1 G42 G42.1",
    "a probe, thread or spline": "G5 G5.1 G5.2 G5.3 G33 G33.1 G38.2 G38.3 G38.4 G38.5 G76",
    "a pause": "M0 M1 M60",
    "a wait for an input": "M66",
    "a subprogram": "M97 M98 M99",
}
_WHY = {code: why for why, codes in _UNREAD.items() for code in codes.split()}


@dataclass(frozen=True, slots=True)
class Rules:
    """What a controller accepts.

    codes: modal group of each code that is read. limit: characters per line, counted without blanks and comments
    where ``squeezed``. forbidden: characters that must not even stand in a comment. linuxcnc: its lexis, else GRBL's.
    arcs: what it takes as one.
    """

    name: str
    codes: Mapping[str, str]
    limit: int
    squeezed: bool
    forbidden: re.Pattern[str] | None
    linuxcnc: bool
    arcs: Limits


def by_group(table: Mapping[str, str]) -> dict[str, str]:
    """Group of each code from codes by group."""
    return {code: group for group, codes in table.items() for code in codes.split()}


Line = tuple[dict[str, str], dict[str, float]]


def lex(raw: str, rules: Rules) -> Line | None:
    """Codes by group and words by letter of the line ``raw``; None where it holds neither. Raises Wrong."""
    text = _bare(raw, rules)
    if not text:
        return None
    if not _LINE.fullmatch(text):
        _complain(text)
    codes: dict[str, str] = {}
    words: dict[str, float] = {}
    for letter, number in _WORDS.findall(text):
        if letter in "GM":
            code = _code(letter, number)
            group = rules.codes.get(code)
            if group is None:
                raise Unread(f"{code} is not read: {_WHY.get(code, f'not a code of {rules.name}')}")
            if group in codes:
                raise Wrong(f"{codes[group]} and {code} are of one group ({group})")
            codes[group] = code
        elif letter in words:
            raise Wrong(f"word {letter} twice in one line")
        else:
            value = words[letter] = float(number)
            if not -_HUGE < value < _HUGE:
                raise Wrong(f"word {letter}{number[:12]} is out of range")
    return codes, words


def is_percent(raw: str) -> bool:
    """Whether the line is a lone per cent sign."""
    return raw.strip(" \t\r") == "%"


def _bare(raw: str, rules: Rules) -> str:
    """The line without comments, blanks, block delete and number, in capitals."""
    text = raw[:-1] if raw.endswith("\r") else raw
    if not rules.squeezed and len(text) > rules.limit:
        raise Wrong(f"{len(text)} characters, {rules.name} reads {rules.limit}")
    if rules.forbidden and (bad := rules.forbidden.search(text)):
        raise Wrong(f"character {bad[0]!r} acts at once or is no ASCII, which {rules.name} minds in comments too")
    if "(" in text or ";" in text or ")" in text:
        text = _uncommented(text, rules)
    text = text.replace(" ", "").replace("\t", "")
    if not text.isascii():
        raise Wrong("a character that is not ASCII outside a comment")
    if rules.squeezed and len(text) > rules.limit:
        raise Wrong(f"{len(text)} characters without blanks and comments, {rules.name} reads {rules.limit}")
    text = text.upper()
    if text.startswith("/"):
        if rules.linuxcnc:
            raise Unread("block delete: whether the line runs depends on a switch of the operator")
        text = text[1:]
    if text.startswith("N"):
        numbered = _NUMBERED.match(text)
        if not numbered:
            raise Wrong("N without a number")
        text = text[numbered.end() :]
    return text


def _uncommented(text: str, rules: Rules) -> str:
    """The line without its comments. Wrong for one that LinuxCNC would act on, and for unbalanced parentheses."""
    if rules.linuxcnc:
        for comment in _COMMENT.finditer(text):
            if comment[1] is not None and "," in comment[1] and _ACTIVE.match(comment[1]):
                raise Wrong(f"active comment {comment[0][:20]!r}")
            if comment[0].lower().startswith(";py,"):
                raise Wrong("active comment ';py,'")
    text = _COMMENT.sub("", text)
    if "(" in text or ")" in text:
        raise Wrong("a comment that is not closed, or closed twice")
    return text


@lru_cache(maxsize=1024)
def _code(letter: str, number: str) -> str:
    return f"{letter}{float(number):g}"


def _complain(text: str) -> None:
    match = _LINE.match(text)
    rest = text[match.end() :] if match else text
    if any(character in text for character in "#[]"):
        raise Unread("parameters and expressions are not read")
    if re.search("O[0-9<]", text):
        raise Unread("O-words are not read")
    raise Wrong(f"cannot read {rest[:12]!r}")
