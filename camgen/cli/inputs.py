"""Opens the inputs of a command: files, standard input and cameras."""

from __future__ import annotations

import sys
from collections.abc import Collection, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

from camgen.model.errors import JobError, rename_errors
from camgen.model.files import Source
from camgen.read import find_suffix
from camgen.read.files import Files

#: Folder of the path that stands for standard input. No file has such a path.
_FOLDER = Path("-")
#: Prefix of a camera, before its number, a video file or the address of a stream.
CAMERA = "camera:"


def to_path(name: str | None) -> Path | None:
    """The file that an option names; None without one."""
    return Path(name) if name else None


def check_suffix(
    name: str | Path | None, suffixes: Collection[str], what: str, remedy: str
) -> None:
    """Raise JobError for a file that is named and has none of `suffixes`."""
    if name and Path(name).suffix.lower() not in suffixes:
        raise JobError(str(name), what, remedy=remedy)


@contextmanager
def open_inputs(names: Sequence[str], kind: str | None) -> Iterator[tuple[list[Path], Files]]:
    """The inputs as paths, with the cache that reads them.

    names: names that the user gives. `-` is standard input. A camera takes a picture here.
    kind: format of standard input.

    Errors about standard input and pictures have the names that the user gives.
    """
    paths = {name: _FOLDER / _name_camera(name) for name in names if name.startswith(CAMERA)}
    if "-" in names:
        kind = (kind or "").lstrip(".")
        if not kind.isalnum():
            raise JobError(
                "-", "standard input has no suffix", remedy="give its format, e.g. --format dxf"
            )
        paths["-"] = _FOLDER / f"stdin{find_suffix(kind)}"
    elif kind:
        raise JobError(
            "--format", "is for standard input", remedy="leave it out, or give - as the input"
        )
    with ExitStack() as stack:
        for name, path in paths.items():
            stack.enter_context(rename_errors(path.name, name))
            stack.enter_context(rename_errors(str(path), name))
        streams = {paths["-"]: sys.stdin.buffer} if "-" in names else {}
        shots = [_shoot(name, path) for name, path in paths.items() if name != "-"]
        yield [paths.get(name, Path(name)) for name in names], Files(given=shots, streams=streams)


def _name_camera(name: str) -> str:
    from camgen.read.capture import name_picture  # noqa: PLC0415 (OpenCV, only for cameras)

    return name_picture(name)


def _shoot(name: str, path: Path) -> Source:
    from camgen.read.capture import capture, make_source  # noqa: PLC0415 (OpenCV)

    return make_source(name, path, capture(name))
