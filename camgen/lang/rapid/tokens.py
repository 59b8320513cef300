"""RAPID text as tokens (RAPID kernel manual, chapter 2)."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import lru_cache

_N = r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"
_POINT = rf"\[\[{_N},{_N},{_N}\],\[{_N},{_N},{_N},{_N}\],\[{_N},{_N},{_N},{_N}\],\[{_N},{_N},{_N},{_N},{_N},{_N}\]\]"
# The manual's letters are those of Latin-1; a text that was decoded otherwise keeps its own.
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
#: Its four lines (RAPID overview, file format).
BANNER_LINES = "%%% VERSION:1 LANGUAGE:ENGLISH %%%".split()  # noqa: SIM905 (as it is written)
#: Never a name (RAPID kernel manual 2.4).
RESERVED = frozenset(
    """alias and backward case connect const default div do else elseif endfor endfunc endif endmodule endproc endrecord
    endtest endtrap endwhile error exit false for from func goto if inout local mod module nostepin not noview or pers
    proc raise readonly record retry return step sysmodule task test then to trap true trynext undo var viewonly while
    with xor""".split()  # noqa: SIM905 (sixty words read better so)
)
#: The largest value of a num (IEEE single precision).
LARGEST = 3.4e38
#: What begins a whole number to another base (newer controllers).
_BASES = ("0x", "0b", "0o")
#: The longest string, and what stands in one for another character.
LONGEST_STRING = 80
_ESCAPED = re.compile(r'""|\\\\|\\([0-9a-fA-F]{2})')

Token = tuple[str, str, int, int]  # kind, text, line, offset of its start


class Wrong(Exception):
    """A fault found while something is being read; the reader notes it and goes on behind it. line: 1-based."""

    def __init__(self, line: int, what: str) -> None:
        super().__init__(line, what)
        self.line, self.what = line, what


def banner(text: str) -> int:
    """The length of the banner that ``text`` begins with, if any."""
    found = _BANNER.match(text)
    return found.end() if found else 0


def tokens(text: str, first_line: int, start: int = 0) -> Iterator[Token]:
    """The tokens of ``text`` (LF line ends) from the offset ``start``, in ``first_line``, on; without comments."""
    line = first_line
    for match in _TOKEN.finditer(text, start):
        kind = match.lastgroup or "end"
        if kind == "newline":
            line += 1
        elif kind != "comment":
            yield kind, match[kind], line, match.start(kind)


def number(text: str, line: int) -> float:
    """The num that ``text`` writes out. Wrong when it is larger than one can be."""
    prefix = text[:2].lower()
    value = float(int(text, 0)) if prefix in _BASES else float(text)
    if abs(value) > LARGEST:
        raise Wrong(line, f"{text[:40]} is larger than a num can be")
    return value


def string(text: str, line: int) -> str:
    """The string that ``text`` writes out. Wrong when it is longer than one can be, or has a backslash that is neither
    doubled nor stands before two hexadecimal digits (RAPID kernel manual, strings).
    """
    if "\\" in text and "\\" in _ESCAPED.sub("", text):
        raise Wrong(
            line, "a backslash in a string is written twice, or before two hexadecimal digits"
        )
    value = _ESCAPED.sub(
        lambda found: chr(int(found[1], 16)) if found[1] else found[0][0], text[1:-1]
    )
    if len(value) > LONGEST_STRING:
        raise Wrong(
            line, f"a string of {len(value)} characters; a controller takes {LONGEST_STRING}"
        )
    return value


def point(text: str, line: int) -> tuple[tuple[float, ...], ...]:
    """The numbers of the token ``point``, grouped as the manual groups them."""
    trans, rot, rest = text[2:-2].split("],[", 2)
    groups, largest = _groups(rest)
    position, q = tuple(map(float, trans.split(","))), tuple(map(float, rot.split(",")))
    if max(largest, *position, *q) > LARGEST or min(*position, *q) < -LARGEST:
        raise Wrong(line, "a number of a robtarget is larger than a num can be")
    return (position, q, *groups)


@lru_cache(maxsize=1000)
def _groups(text: str) -> tuple[tuple[tuple[float, ...], ...], float]:
    """Configuration and external axes, and the largest number in them: the same for many points."""
    groups = tuple(tuple(map(float, group.split(","))) for group in text.split("],["))
    return groups, max(abs(v) for group in groups for v in group)


def show_token(token: Token) -> str:
    """A token for a message, short and on one line."""
    return "the end of the file" if token[0] == "end" else ascii(token[1][:40])
