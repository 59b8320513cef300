"""The files of a program as text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from camgen.lang.programs import find_text_fault
from camgen.model.errors import InputError
from camgen.read.files import Files, reason


def read_texts(paths: Sequence[Path], files: Files) -> Mapping[str, str]:
    """The texts by file name, in order, with LF line ends. Raises InputError for other files."""
    texts: dict[str, str] = {}
    for path in paths:
        try:
            data = files.open(path).data
        except (OSError, ValueError) as error:
            raise InputError(str(path), f"cannot be read: {reason(error)}") from error
        fault = find_text_fault(data)
        if fault:
            raise InputError(str(path), fault, remedy="give a program that is saved as text")
        if path.name in texts:
            raise InputError(
                str(path),
                "another file has this name",
                remedy="the files of a program differ in name",
            )
        # Comments of other programs may hold any byte, so each byte is a character.
        texts[path.name] = data.decode("latin-1").replace("\r\n", "\n").replace("\r", "\n")
    return texts
