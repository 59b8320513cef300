"""Numbers and names that are mostly plain and at times odd, and changes of texts and bytes."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

from hypothesis import strategies as st


def split_words(text: str) -> tuple[str, ...]:
    """Words of a table."""
    return tuple(text.split())


#: Numbers as files have them, and numbers that no file should have.
_PLAIN = split_words("0 1 -1 2 3 10 2.5 -7.25 0.001 45 90 100 12.345 -20 5e-3 64")
_ODD = (
    *split_words(
        "1e308 -1e308 1e-320 1e-300 nan inf -inf 1e20 -1e20 1e9 1e400 1e-9 1e -0.0 . +5 1."
    ),
    *split_words("2147483648 -2147483649 99999999999999999999 65536 360 0x10 1_000 --1 * 1,5"),
    *("", "\u00b2", "\u0663", "9" * 400),
)
_NAMES = ("a", "b", "c", "0", "part", "A B", "")
_ODD_NAMES = (
    *("\u00e4\u2603", "\ud7ff", "*Model_Space", "x" * 300),
    *("../a", "a#b", "'", '"', "%s", "{}", "\\", "-1", "$"),
)
_ODD_COUNTS = ("0", "-1", "70", "1000", "2147483648", "nan", "1.5", "")

numbers = st.sampled_from((*_PLAIN * 60, *_ODD))
plain_numbers = st.sampled_from(_PLAIN)
counts = st.sampled_from((*"123458" * 20, *_ODD_COUNTS))
names = st.sampled_from(_NAMES * 30 + _ODD_NAMES)
#: One time in sixteen.
rarely = st.sampled_from((False,) * 15 + (True,))
_JUNK = ("\x00", "\n", "(", "<!--", "'", '"', "%", "\u2603", ";", "\t", "#", "&amp;", "]]>", "\x1a")
_TOKEN = re.compile(r"[+-]?\d+\.?\d*(?:[eE][-+]?\d+)?|[A-Za-z_]\w*|\n|[^\sA-Za-z_\d]")
_NUMBER = re.compile(r"[+-]?\d+\.?\d*(?:[eE][-+]?\d+)?")
#: Bytes that replace others: small, signed, huge, and numbers that are not finite.
_BYTES = (
    *(b"\0", b"\1", b"\2", b"\x07", b"\x7f", b"\x80", b"\xff", b"\0\0", b"\xff\xff"),
    *(bytes(4), b"\xff" * 4, b"\xff\xff\xff\x7f", b"\x7f\xff\xff\xff", b"\0\0\0\x80"),
    *(b"\0\0\xc0\x7f", b"\0\0\x80\x7f", b"\xca\xf2\x49\x71", b"\x20\x4e\0\0"),
)


def encode(text: str) -> bytes:
    """The bytes of a text file, "?" for a mark that has none."""
    return text.encode("utf-8", "replace")


@st.composite
def change_bytes(draw: st.DrawFn, samples: Sequence[bytes], size: int) -> bytes:
    """A file of the samples with up to five changes in its first `size` bytes, at times cut off."""
    data = bytearray(draw(st.sampled_from(samples)))
    for _ in range(draw(st.integers(0, 5))):
        new = draw(st.sampled_from(_BYTES))
        place = draw(st.integers(0, min(len(data), size) - 1))
        data[place : place + len(new)] = new
    end = draw(st.integers(0, len(data))) if draw(rarely) else len(data)
    return bytes(data[:end])


@st.composite
def change_text(
    draw: st.DrawFn, texts: Sequence[str], words: Sequence[str] = (), limit: int = 4
) -> str:
    """A text of `texts` with up to `limit` changes of its tokens and lines.

    words: words of the language, which replace others.
    """
    tokens = _split(draw(st.sampled_from(texts)))
    for _ in range(draw(st.integers(1, limit))):
        if not tokens:
            break
        place = draw(st.integers(0, len(tokens) - 1))
        draw(st.sampled_from(_CHANGES))(draw, tokens, place, words)
    return "".join(tokens)


@st.composite
def change_numbers(draw: st.DrawFn, texts: Sequence[str]) -> str:
    """A text of `texts` with up to four of its numbers replaced."""
    tokens = _split(draw(st.sampled_from(texts)))
    places = [place for place, token in enumerate(tokens) if _NUMBER.fullmatch(token.strip())]
    for place in draw(st.lists(st.sampled_from(places), min_size=1, max_size=4)):
        _replace(draw, tokens, place, ("x",))
    return "".join(tokens)


def change_file(
    texts: Sequence[str], words: Sequence[str] = (), limit: int = 4
) -> st.SearchStrategy[bytes]:
    """Files of a text with changes, half of them in numbers alone."""
    return (change_numbers(texts) | change_text(texts, words, limit)).map(encode)


def _split(text: str) -> list[str]:
    """The tokens, each with the blanks before it."""
    tokens = []
    last = 0
    for token in _TOKEN.finditer(text):
        tokens.append(text[last : token.end()])
        last = token.end()
    return [*tokens, text[last:]] if last < len(text) else tokens


def _replace(draw: st.DrawFn, tokens: list[str], place: int, words: Sequence[str]) -> None:
    """Replaces a token: a number by a number, mostly."""
    token = tokens[place].lstrip(" \t\r")
    blanks = tokens[place].removesuffix(token)
    others = st.sampled_from(words) if words else names
    is_number = _NUMBER.fullmatch(token) and not draw(rarely)
    tokens[place] = blanks + draw(numbers if is_number else others)


def _drop(_draw: st.DrawFn, tokens: list[str], place: int, _words: Sequence[str]) -> None:
    del tokens[place]


def _double(_draw: st.DrawFn, tokens: list[str], place: int, _words: Sequence[str]) -> None:
    token = tokens[place]
    tokens.insert(place, token if token.startswith((" ", "\n")) else f" {token}")


def _swap(draw: st.DrawFn, tokens: list[str], place: int, _words: Sequence[str]) -> None:
    other = draw(st.integers(0, len(tokens) - 1))
    tokens[place], tokens[other] = tokens[other], tokens[place]


def _find_line(tokens: list[str], place: int) -> tuple[int, int]:
    """The first token of a line, and the one after its last."""
    begin = place
    while begin and not tokens[begin - 1].endswith("\n"):
        begin -= 1
    end = place
    while end < len(tokens) - 1 and not tokens[end].endswith("\n"):
        end += 1
    return begin, end + 1


def _move_line(draw: st.DrawFn, tokens: list[str], place: int, _words: Sequence[str]) -> None:
    """Moves a line to another place, or repeats it there."""
    begin, end = _find_line(tokens, place)
    line = tokens[begin:end]
    if draw(st.booleans()):
        del tokens[begin:end]
    target = 0
    if tokens:
        target, _ = _find_line(tokens, draw(st.integers(0, len(tokens) - 1)))
    tokens[target:target] = line


def _cut(_draw: st.DrawFn, tokens: list[str], place: int, _words: Sequence[str]) -> None:
    del tokens[place:]


def _insert(draw: st.DrawFn, tokens: list[str], place: int, words: Sequence[str]) -> None:
    tokens.insert(place, draw(st.sampled_from((*words, *_JUNK))))


_Change = Callable[[st.DrawFn, list[str], int, Sequence[str]], None]
_CHANGES: tuple[_Change, ...] = (
    *(_replace, _replace, _replace, _replace, _drop, _double),
    *(_swap, _move_line, _move_line, _cut, _insert),
)
