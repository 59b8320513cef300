"""What the command line says and how: rows of the summary, the stage that is running, results on standard output."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from typing import NamedTuple, TextIO

from camgen.model.errors import one_line
from camgen.model.text import counted

#: Label, text and tone of a line of a summary.
Row = tuple[str, str, str]

_COLOURS = {"plain": "", "good": "32", "look": "33", "bad": "31"}
_WIDTH = 10


class Voice(NamedTuple):
    """Where and how much is said. colour: the stream is a terminal that wants it. results: standard output. No
    dataclass: it imports for 8 ms.
    """

    results: TextIO
    quiet: bool = False
    verbose: int = 0
    colour: bool = False
    terminal: bool = False

    def out(self, text: str) -> None:
        """A result on standard output."""
        _write(self.results, text)

    def data(self, value: object) -> None:
        """A result as JSON: structs by their fields, arrays as lists."""
        import msgspec  # noqa: PLC0415 (only where data is asked for)

        text = msgspec.json.encode(value, enc_hook=_plain, order="deterministic")
        self.out(msgspec.json.format(text, indent=2).decode() + "\n")

    def rows(self, rows: Sequence[Row]) -> None:
        """Summary lines (label, text, tone) on standard error; tone: plain, good, look or bad."""
        if not self.quiet:
            self.clear()
            _write(sys.stderr, "".join(self._row(*row) for row in rows))

    def stage(self, name: str) -> None:
        """The stage that is running, on a terminal only; the next line overwrites it."""
        if self.terminal and not self.quiet:
            _write(sys.stderr, f"\r\x1b[2K{name} ...")

    def clear(self) -> None:
        """Takes the stage off the terminal."""
        if self.terminal and not self.quiet:
            _write(sys.stderr, "\r\x1b[2K")

    def error(self, text: str) -> None:
        """The one line of an error or a fault."""
        self.clear()
        _write(sys.stderr, self._paint("camgen: ", "bad") + one_line(text) + "\n")

    def _row(self, label: str, text: str, tone: str) -> str:
        return self._paint(f"{label:<{_WIDTH}}", tone) + one_line(text) + "\n"

    def _paint(self, text: str, tone: str) -> str:
        code = _COLOURS[tone]
        return f"\x1b[{code}m{text}\x1b[0m" if self.colour and code else text


def voice(quiet: bool, verbose: int) -> Voice:
    """The voice for this process: colour only on a terminal, unless NO_COLOR or TERM=dumb asks for none."""
    terminal = sys.stderr.isatty() and os.environ.get("TERM") != "dumb"
    return Voice(sys.stdout, quiet, verbose, terminal and not os.environ.get("NO_COLOR"), terminal)


def _plain(value: object) -> object:
    """What JSON has no kind for: arrays and their numbers as those of Python, files by their names."""
    return value.tolist() if hasattr(value, "tolist") else str(value)


def _write(stream: TextIO, text: str) -> None:
    """Writes all at once. Who reads may have gone (``| head``): that is no fault, the exit code stays."""
    encoding = stream.encoding or "utf-8"
    try:
        stream.write(text.encode(encoding, "backslashreplace").decode(encoding))
        stream.flush()
    except BrokenPipeError:
        # Python flushes again when it exits; let that go nowhere.
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def table(rows: Sequence[Sequence[str]]) -> str:
    """Rows of cells as aligned columns, the last one unpadded."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]) - 1)]
    lines = [
        "  ".join([*(c.ljust(w) for c, w in zip(row, widths, strict=False)), row[-1]]).rstrip()
        for row in rows
    ]
    return "\n".join(lines) + "\n"


def join_names(names: Sequence[str], limit: int = 6) -> str:
    """Names with commas, the rest counted."""
    more = len(names) - limit
    return ", ".join(names[:limit]) + (f" and {more} more" if more > 0 else "")


def length(mm: float) -> str:
    """A length for people: mm below 10 m, else m."""
    return f"{mm:.1f} mm" if mm < 10_000 else f"{mm / 1000:.2f} m"


def size(count: int) -> str:
    """A file size for people."""
    return (
        counted(count, "byte")
        if count < 10_000
        else f"{count / 1000:.0f} kB"
        if count < 10_000_000
        else f"{count / 1e6:.1f} MB"
    )
