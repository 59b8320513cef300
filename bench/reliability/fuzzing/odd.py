"""What all strategies are made of: numbers and names that are mostly plain and at times odd, and texts with changes."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

from hypothesis import strategies as st

#: Numbers as files have them, and those that no file should.
_PLAIN = (
    "0", "1", "-1", "2", "3", "10", "2.5", "-7.25", "0.001", "45", "90", "100", "12.345", "-20",
    "5e-3", "64",
)  # fmt: skip
_ODD = (
    "1e308", "-1e308", "1e-320", "1e-300", "nan", "inf", "-inf", "1e20", "-1e20", "1e9", "2147483648", "-2147483649",
    "99999999999999999999", "-0.0", ".", "+5", "1.", "0x10", "", "1e400", "\u00b2", "\u0663", "1_000", "1e", "--1",
    "9" * 400, "360", "1e-9", "65536", "*", "1,5",
)  # fmt: skip
_NAMES = ("a", "b", "c", "0", "part", "A B", "")
_ODD_NAMES = (
    "\u00e4\u2603",
    "*Model_Space",
    "x" * 300,
    "../a",
    "a#b",
    "'",
    '"',
    "%s",
    "{}",
    "\\",
    "\ud7ff",
    "-1",
    "$",
)

numbers = st.sampled_from(_PLAIN * 60 + _ODD)
plain_numbers = st.sampled_from(_PLAIN)
#: Small and whole, at times not.
counts = st.sampled_from(
    ("1", "2", "3", "4", "5", "8") * 20 + ("0", "-1", "70", "1000", "2147483648", "nan", "1.5", "")
)
names = st.sampled_from(_NAMES * 30 + _ODD_NAMES)
#: Now and then, one time in sixteen.
rarely = st.sampled_from((False,) * 15 + (True,))
_JUNK = ("\x00", "\n", "(", "<!--", "'", '"', "%", "\u2603", ";", "\t", "#", "&amp;", "]]>", "\x1a")
_TOKEN = re.compile(r"[+-]?\d+\.?\d*(?:[eE][-+]?\d+)?|[A-Za-z_]\w*|\n|[^\sA-Za-z_\d]")
_NUMBER = re.compile(r"[+-]?\d+\.?\d*(?:[eE][-+]?\d+)?")


def as_bytes(text: str) -> bytes:
    """The bytes of a text file, "?" for a mark that has none."""
    return text.encode("utf-8", "replace")


@st.composite
def edited(draw: st.DrawFn, texts: Sequence[str], words: Sequence[str] = (), most: int = 4) -> str:
    """One of the texts with up to ``most`` changes: a token dropped, doubled, made another or an odd number, swapped
    with another, a line dropped or moved.
    """
    pieces = _split(draw(st.sampled_from(texts)))
    for _ in range(draw(st.integers(1, most))):
        if not pieces:
            break
        at = draw(st.integers(0, len(pieces) - 1))
        draw(st.sampled_from(_CHANGES))(draw, pieces, at, words)
    return "".join(pieces)


def _split(text: str) -> list[str]:
    """Tokens, each with the blanks before it."""
    found, last = [], 0
    for token in _TOKEN.finditer(text):
        found.append(text[last : token.end()])
        last = token.end()
    return [*found, text[last:]] if last < len(text) else found


def _put(draw: st.DrawFn, pieces: list[str], at: int, words: Sequence[str]) -> None:
    """Another token in the place of one: a number for a number, mostly."""
    piece = pieces[at]
    token = piece.lstrip(" \t\r")
    blanks = piece[: len(piece) - len(token)]
    others = st.sampled_from(words) if words else names
    new = draw(numbers if _NUMBER.fullmatch(token) and not draw(rarely) else others)
    pieces[at] = blanks + new


def _drop(_draw: st.DrawFn, pieces: list[str], at: int, _words: Sequence[str]) -> None:
    del pieces[at]


def _double(_draw: st.DrawFn, pieces: list[str], at: int, _words: Sequence[str]) -> None:
    pieces.insert(at, pieces[at] if pieces[at].startswith((" ", "\n")) else " " + pieces[at])


def _swap(draw: st.DrawFn, pieces: list[str], at: int, _words: Sequence[str]) -> None:
    other = draw(st.integers(0, len(pieces) - 1))
    pieces[at], pieces[other] = pieces[other], pieces[at]


def _line_of(pieces: list[str], at: int) -> tuple[int, int]:
    begin = at
    while begin and not pieces[begin - 1].endswith("\n"):
        begin -= 1
    end = at
    while end < len(pieces) - 1 and not pieces[end].endswith("\n"):
        end += 1
    return begin, end + 1


def _move(draw: st.DrawFn, pieces: list[str], at: int, _words: Sequence[str]) -> None:
    """A line goes elsewhere, or stands there too."""
    begin, end = _line_of(pieces, at)
    line = pieces[begin:end]
    if draw(st.booleans()):
        del pieces[begin:end]
    where = _line_of(pieces, draw(st.integers(0, len(pieces) - 1)))[0] if pieces else 0
    pieces[where:where] = line


def _cut(_draw: st.DrawFn, pieces: list[str], at: int, _words: Sequence[str]) -> None:
    del pieces[at:]


def _junk(draw: st.DrawFn, pieces: list[str], at: int, words: Sequence[str]) -> None:
    pieces.insert(at, draw(st.sampled_from((*words, *_JUNK) if words else _JUNK)))


_Change = Callable[[st.DrawFn, list[str], int, Sequence[str]], None]
_CHANGES: tuple[_Change, ...] = (
    _put,
    _put,
    _put,
    _put,
    _drop,
    _double,
    _swap,
    _move,
    _move,
    _cut,
    _junk,
)
