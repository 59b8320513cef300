"""The program's text for the page: its files, and in which line each motion and wait stands."""

from __future__ import annotations

from collections.abc import Sequence

from msgspec import Struct

from camgen.model.text import counted
from camgen.preview import Built
from camgen.preview.track import IntArray

#: Of a longer program the page has no text: letters, and lines.
MOST_LETTERS, MOST_LINES = 8_000_000, 400_000


class Listing(Struct, frozen=True, eq=False):
    """files: name and text of each, LF line ends; none where they are too long, and why. lines: (E,) of the events,
    counted from 1 through all files; 0 where an instruction has none.
    """

    files: tuple[tuple[str, str], ...]
    lines: IntArray
    why: str = ""


def list_program(result: Built, instruction: IntArray) -> Listing:
    """The text of ``result``. instruction: (E,) of the events, their place in the body of the program."""
    return list_texts([(file.name, file.text) for file in result.files], result.lines[instruction])


def list_texts(files: Sequence[tuple[str, str]], lines: IntArray) -> Listing:
    """The texts of ``files``, unless they are too long. lines: (E,) as in ``Listing``."""
    letters = sum(len(text) for _, text in files)
    rows = sum(text.count("\n") for _, text in files)
    if letters > MOST_LETTERS or rows > MOST_LINES:
        names = ", ".join(name for name, _ in files)
        size = f"{counted(rows, 'line')}, {letters / 1e6:.0f} MB"
        return Listing(
            (), lines, f"{names}: too long for this page ({size}); open the file beside it"
        )
    return Listing(tuple(files), lines)
