"""The tokens of RAPID text (RAPID kernel manual, chapter 2)."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import lru_cache
from itertools import chain

_N = r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"
_FOUR = rf"\[{_N},{_N},{_N},{_N}\]"
_POINT = rf"\[\[{_N},{_N},{_N}\],{_FOUR},{_FOUR},\[{_N},{_N},{_N},{_N},{_N},{_N}\]\]"
# The manual allows letters of Latin-1. Letters of other encodings are accepted too.
_ANY_NAME = r"[^\W\d_]\w*"
_NUMBER = (
    r"0[xX][0-9a-fA-F]+|0[bB][01]+|0[oO][0-7]+|(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"
)
# A robtarget written out compactly is a single token.
_TOKEN = re.compile(
    rf"""[ \t\f\v]*(?:
    (?P<point>{_POINT})
  | (?P<newline>\n)
  | (?P<comment>![^\n]*)
  | (?P<name>{_ANY_NAME})
  | (?P<number>{_NUMBER})
  | (?P<string>"(?:[^"\n]|"")*")
  | (?P<hole><(?:EXP|SMT|ARG|VAR|ID|DDN|TDN|RDN|PAR|ALT|DIM|CSE|EIT)>)
  | (?P<mark>:=|<=|>=|<>|[^ \t\f\v])
  | (?P<end>\Z)
    )""",
    re.VERBOSE,
)
#: The optional banner of old files: %%% VERSION:1 LANGUAGE:ENGLISH %%%.
_BANNER = re.compile(r"\A\s*%%%[A-Za-z0-9:\s]*%%%[ \t]*(?=\n)")
#: Lines of the banner (RAPID overview, file format).
BANNER_LINES = "%%% VERSION:1 LANGUAGE:ENGLISH %%%".split()  # noqa: SIM905 (as it is written)
#: Reserved words, which cannot be names (RAPID kernel manual 2.4).
RESERVED = frozenset(
    """alias and backward case connect const default div do else elseif endfor endfunc endif
    endmodule endproc endrecord endtest endtrap endwhile error exit false for from func goto if
    inout local mod module nostepin not noview or pers proc raise readonly record retry return step
    sysmodule task test then to trap true trynext undo var viewonly while with
    xor""".split()  # noqa: SIM905 (sixty words read better so)
)
#: The largest value of a num (IEEE single precision).
LARGEST = 3.4e38
#: Prefixes of whole numbers in other bases (newer controllers).
_BASES = ("0x", "0b", "0o")
#: Characters of the longest string.
LONGEST_STRING = 80
#: Escapes in a string: a doubled quotation mark or backslash, or a hexadecimal code.
_ESCAPED = re.compile(r'""|\\\\|\\([0-9a-fA-F]{2})')

#: Kind, text, line, and offset of the start.
Token = tuple[str, str, int, int]


class Wrong(Exception):
    """A fault in a line of the program (1-based, 0 if the caller adds the line)."""

    def __init__(self, line: int, what: str) -> None:
        super().__init__(line, what)
        self.line, self.what = line, what


def banner(text: str) -> int:
    """The length of the banner at the start of a text, 0 without one."""
    match = _BANNER.match(text)
    return match.end() if match else 0


def tokens(text: str, first_line: int, start: int = 0) -> Iterator[Token]:
    """The tokens of a text with LF line ends, without comments.

    first_line: line of the offset `start`.
    start: offset of the first token.
    """
    line = first_line
    for match in _TOKEN.finditer(text, start):
        kind = match.lastgroup or "end"
        if kind == "newline":
            line += 1
        elif kind != "comment":
            yield kind, match[kind], line, match.start(kind)


def number(text: str, line: int) -> float:
    """The value of a num. Raises Wrong above the limit of a num."""
    value = float(int(text, 0)) if text[:2].lower() in _BASES else float(text)
    if abs(value) > LARGEST:
        raise Wrong(line, f"{text[:40]} is larger than a num can be")
    return value


def string(text: str, line: int) -> str:
    """The value of a string in quotation marks (RAPID kernel manual, strings).

    Raises Wrong if it is too long, or if a backslash is neither doubled nor followed by two
    hexadecimal digits.
    """
    if "\\" in text and "\\" in _ESCAPED.sub("", text):
        what = "a backslash in a string is written twice, or before two hexadecimal digits"
        raise Wrong(line, what)
    value = _ESCAPED.sub(
        lambda match: chr(int(match[1], 16)) if match[1] else match[0][0], text[1:-1]
    )
    if len(value) > LONGEST_STRING:
        what = f"a string of {len(value)} characters; a controller takes {LONGEST_STRING}"
        raise Wrong(line, what)
    return value


def point(text: str, line: int) -> tuple[tuple[float, ...], ...]:
    """The numbers of a `point` token: position, orientation, configuration, external axes."""
    trans, rot, rest = text[2:-2].split("],[", 2)
    groups, largest = _groups(rest)
    position, q = tuple(map(float, trans.split(","))), tuple(map(float, rot.split(",")))
    if max(largest, *position, *q) > LARGEST or min(*position, *q) < -LARGEST:
        raise Wrong(line, "a number of a robtarget is larger than a num can be")
    return (position, q, *groups)


@lru_cache(maxsize=1000)
def _groups(text: str) -> tuple[tuple[tuple[float, ...], ...], float]:
    """Configuration and external axes, which many points share, and their largest number."""
    groups = tuple(tuple(map(float, group.split(","))) for group in text.split("],["))
    return groups, max(map(abs, chain.from_iterable(groups)))


def show_token(token: Token) -> str:
    """A token for a message, at most 40 characters on one line."""
    return "the end of the file" if token[0] == "end" else ascii(token[1][:40])
