"""The output of the command line: the summary, the current stage, and the results."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, NamedTuple, TextIO

from camgen.model.errors import make_one_line
from camgen.model.text import counted

if TYPE_CHECKING:
    from camgen.model.part import Note

#: Label, text and tone of a line of a summary.
Row = tuple[str, str, str]

_COLOURS = {"plain": "", "good": "32", "look": "33", "bad": "31"}
_WIDTH = 10


class Terminal(NamedTuple):
    """The output of a command. It is not a dataclass, whose import takes 8 ms.

    results: standard output.
    quiet: print errors only.
    verbose: number of -v.
    colour: whether standard error is a terminal that shows colours.
    is_interactive: whether standard error is a terminal.
    """

    results: TextIO
    quiet: bool = False
    verbose: int = 0
    colour: bool = False
    is_interactive: bool = False

    def out(self, text: str) -> None:
        """Print a result on standard output."""
        self.clear()
        _write(self.results, text)

    def data(self, value: object) -> None:
        """Print a result as JSON: structs by their fields, arrays as lists."""
        import msgspec  # noqa: PLC0415 (only for JSON)

        text = msgspec.json.encode(value, enc_hook=_plain, order="deterministic")
        self.out(msgspec.json.format(text, indent=2).decode() + "\n")

    def rows(self, rows: Sequence[Row]) -> None:
        """Print rows of the summary on standard error. A tone is plain, good, look or bad."""
        if not self.quiet:
            self.clear()
            _write(sys.stderr, "".join(self._row(*row) for row in rows))

    def stage(self, name: str) -> None:
        """Show the current stage on a terminal. The next line overwrites it."""
        if self.is_interactive and not self.quiet:
            _write(sys.stderr, f"\r\x1b[2K{name} ...")

    def clear(self) -> None:
        """Remove the stage from the terminal."""
        if self.is_interactive and not self.quiet:
            _write(sys.stderr, "\r\x1b[2K")

    def error(self, text: str) -> None:
        """Print the line of an error or a fault."""
        self.clear()
        _write(sys.stderr, self._paint("camgen: ", "bad") + make_one_line(text) + "\n")

    def _row(self, label: str, text: str, tone: str) -> str:
        return self._paint(f"{label:<{_WIDTH}}", tone) + make_one_line(text) + "\n"

    def _paint(self, text: str, tone: str) -> str:
        code = _COLOURS[tone]
        return f"\x1b[{code}m{text}\x1b[0m" if self.colour and code else text


def make_terminal(quiet: bool, verbose: int) -> Terminal:
    """The output of this process, in colour on a terminal unless NO_COLOR or TERM=dumb is set."""
    is_interactive = sys.stderr.isatty() and os.environ.get("TERM") != "dumb"
    return Terminal(
        sys.stdout,
        quiet,
        verbose,
        is_interactive and not os.environ.get("NO_COLOR"),
        is_interactive,
    )


def _plain(value: object) -> object:
    """A value that JSON does not have: an array as a list, a file by its name."""
    return value.tolist() if hasattr(value, "tolist") else str(value)


def _write(stream: TextIO, text: str) -> None:
    """Write a text at once. A closed pipe (`| head`) is not a fault and leaves the exit code."""
    encoding = stream.encoding or "utf-8"
    try:
        stream.write(text.encode(encoding, "backslashreplace").decode(encoding))
        stream.flush()
    except BrokenPipeError:
        # Python flushes again at its exit, now into the null device.
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def label_rows(label: str, texts: Iterable[object], tone: str = "plain") -> list[Row]:
    """A row for each of `texts`, with the same label and tone."""
    return [(label, str(text), tone) for text in texts]


def rows_of_notes(notes: Iterable[Note], tone: str = "look") -> list[Row]:
    """A row for each note, with its reason."""
    return [(note.kind, str(note).removeprefix(f"{note.kind}: "), tone) for note in notes]


def join_rows(rows: Iterable[Row]) -> list[str]:
    """Each row as `label: text`, or its text alone if it has no label."""
    return [f"{label}: {text}".removeprefix(": ") for label, text, _ in rows]


def format_table(rows: Sequence[Sequence[str]]) -> str:
    """Rows of cells as aligned columns."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    form = "  ".join(f"{{:<{width}}}" for width in widths)
    return "".join([form.format(*row).rstrip() + "\n" for row in rows])


def join_names(names: Sequence[str], limit: int = 6) -> str:
    """The first `limit` names with commas, and the number of the others."""
    more = len(names) - limit
    return ", ".join(names[:limit]) + (f" and {more} more" if more > 0 else "")


def format_length(mm: float) -> str:
    """A length as text, in mm below 10 m and in m above."""
    return f"{mm:.1f} mm" if mm < 10_000 else f"{mm / 1000:.2f} m"


def format_size(count: int) -> str:
    """The size of a file as text."""
    if count < 10_000:
        return counted(count, "byte")
    return f"{count / 1000:.0f} kB" if count < 10_000_000 else f"{count / 1e6:.1f} MB"
