"""The inputs of a command, standard input among them."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from camgen.model.errors import JobError, rename_errors
from camgen.read import find_suffix
from camgen.read.files import Files

#: Where standard input would lie if it were a file: in a folder that nobody makes.
_FOLDER = Path("-")


@contextmanager
def open_inputs(names: Sequence[str], kind: str | None) -> Iterator[tuple[list[Path], Files]]:
    """The inputs as paths, and the files, which have standard input if it is one of them: a file of the format
    ``kind``. Errors about it are told with the name ``-``.
    """
    if "-" not in names:
        if kind:
            raise JobError("--format", "is for standard input", remedy="leave it out, or give - as the input")
        yield [Path(name) for name in names], Files()
        return
    kind = (kind or "").lstrip(".")
    if not kind.isalnum():
        raise JobError("-", "standard input has no suffix", remedy="say what it is, e.g. --format dxf")
    stdin = _FOLDER / f"stdin{find_suffix(kind)}"
    with rename_errors(stdin.name, "-"), rename_errors(str(stdin), "-"):
        yield [stdin if name == "-" else Path(name) for name in names], Files(streams={stdin: sys.stdin.buffer})
