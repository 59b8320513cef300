"""The text of a program for the page, with the line of each motion and wait."""

from __future__ import annotations

from collections.abc import Sequence

from msgspec import Struct

from camgen.model.text import counted
from camgen.preview.track import IntArray

#: Maximum number of characters and of lines of a text on the page.
MOST_LETTERS, MOST_LINES = 8_000_000, 400_000


class Listing(Struct, frozen=True, eq=False):
    """The text of a program.

    files: name and text of each file, with LF line ends; empty if they are too long.
    lines: (E,) line of each event, from 1 through all files; 0 for an instruction without a line.
    why: reason why there is no text, empty with a text.
    """

    files: tuple[tuple[str, str], ...]
    lines: IntArray
    why: str = ""


def list_texts(files: Sequence[tuple[str, str]], lines: IntArray) -> Listing:
    """The texts of `files`, unless they are too long. lines: (E,) lines as in `Listing`."""
    names, texts = zip(*files, strict=True)
    letters, rows = sum(map(len, texts)), sum(text.count("\n") for text in texts)
    if letters > MOST_LETTERS or rows > MOST_LINES:
        size = f"{counted(rows, 'line')}, {letters / 1e6:.0f} MB"
        why = f"{', '.join(names)}: too long for this page ({size}); open the file beside it"
        return Listing((), lines, why)
    return Listing(tuple(files), lines)
