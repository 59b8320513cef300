"""Finds the inputs of a batch by patterns, and the folder of each program."""

from __future__ import annotations

import glob
import os
from collections.abc import Sequence
from itertools import takewhile
from pathlib import Path, PurePath

from msgspec import Struct

from camgen.batch.state import NAME
from camgen.model.errors import JobError
from camgen.read.files import identity

#: Endings of the names of files that are not inputs: job files and the state of the batch.
_NO_INPUTS = (".toml", NAME)


class BatchInput(Struct, frozen=True):
    """A file to build, and the folder of its program below the output folder."""

    source: Path
    folder: PurePath


def find_inputs(patterns: Sequence[str]) -> list[BatchInput]:
    """The inputs in the order of their names, each once.

    A program keeps the folders from the first wildcard of its pattern on: `parts/**/*.dxf` puts the
    program of `parts/a/lid.dxf` into `a/`. A name without a wildcard has no such folders.

    Raises JobError for a pattern without a match.
    """
    inputs: dict[str, BatchInput] = {}
    for pattern in patterns:
        for path, folder in _find_matches(pattern):
            inputs.setdefault(identity(path), BatchInput(path, folder))
    return sorted(inputs.values(), key=lambda batch_input: batch_input.source.as_posix())


def _find_matches(pattern: str) -> list[tuple[Path, PurePath]]:
    path = Path(pattern)
    if not glob.has_magic(pattern) or path.is_file():  # a file may be called part[1].dxf
        if not path.is_file():
            what = "is a folder" if path.is_dir() else "no such file"
            raise JobError(pattern, what, remedy="give files or globs")
        return [(path, PurePath())]
    try:
        names = glob.glob(pattern, recursive=True)
    except (ValueError, RecursionError) as error:
        raise JobError(pattern, f"is not a pattern: {error}") from error
    paths = [Path(name) for name in names if not name.endswith(_NO_INPUTS) and os.path.isfile(name)]
    if not paths:
        raise JobError(
            pattern, "no file matches", remedy="put the pattern in quotes, and list the folder"
        )
    base = _find_base(path)
    return [(match, match.relative_to(base).parent) for match in paths]


def _find_base(pattern: Path) -> Path:
    return Path(*takewhile(lambda part: not glob.has_magic(part), pattern.parts[:-1]))
