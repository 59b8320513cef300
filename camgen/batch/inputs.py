"""Which inputs the patterns of a batch mean, and where the program of each goes."""

from __future__ import annotations

import glob
import os
from collections.abc import Sequence
from pathlib import Path, PurePath

from msgspec import Struct

from camgen.batch.state import NAME
from camgen.model.errors import JobError
from camgen.read.files import identity

#: What lies beside drawings and is none.
_NO_INPUTS = (".toml", NAME)


class BatchInput(Struct, frozen=True):
    """A file to build, and the folder of its program below the output folder."""

    source: Path
    folder: PurePath


def find_inputs(patterns: Sequence[str]) -> list[BatchInput]:
    """The inputs in order of their names, each once. JobError for a pattern that matches none.

    Of a pattern, the folders from the first wildcard on are kept for the program: ``parts/**/*.dxf`` puts that of
    ``parts/a/lid.dxf`` into ``a/``. A name without wildcard has none.
    """
    inputs: dict[str, BatchInput] = {}
    for pattern in patterns:
        for path, folder in _matches(pattern):
            inputs.setdefault(identity(path), BatchInput(path, folder))
    return sorted(inputs.values(), key=lambda one: one.source.as_posix())


def _matches(pattern: str) -> list[tuple[Path, PurePath]]:
    path = Path(pattern)
    if not glob.has_magic(pattern) or path.is_file():  # a file may be called part[1].dxf
        if not path.is_file():
            raise JobError(
                pattern,
                "no such file" if not path.is_dir() else "is a folder",
                remedy="give files or globs",
            )
        return [(path, PurePath())]
    try:
        names = glob.glob(pattern, recursive=True)
    except (ValueError, RecursionError) as error:
        raise JobError(pattern, f"is no pattern: {error}") from error
    paths = [Path(name) for name in names if not name.endswith(_NO_INPUTS) and os.path.isfile(name)]
    if not paths:
        raise JobError(
            pattern, "no file matches", remedy="quote it, and look at the folder with ls"
        )
    base = _before_wildcards(path)
    return [(one, one.relative_to(base).parent) for one in paths]


def _before_wildcards(pattern: Path) -> Path:
    parts = pattern.parts[:-1]
    fixed = next((k for k, part in enumerate(parts) if glob.has_magic(part)), len(parts))
    return Path(*parts[:fixed])
