"""The inputs of a command, standard input and cameras among them."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

from camgen.model.errors import JobError, rename_errors
from camgen.model.files import Source
from camgen.read import find_suffix
from camgen.read.files import Files

#: Where standard input would lie if it were a file: in a folder that nobody makes.
_FOLDER = Path("-")
#: How the name of a camera begins; after it its number, a video file or the address of a stream.
CAMERA = "camera:"


@contextmanager
def open_inputs(names: Sequence[str], kind: str | None) -> Iterator[tuple[list[Path], Files]]:
    """The inputs as paths, and the files. Among them are standard input, a file of the format ``kind`` where ``-`` is
    an input, and what the cameras see, pictures that are taken here. Errors about these are told with the names that
    the user gave.
    """
    paths = {name: _FOLDER / _name_camera(name) for name in names if name.startswith(CAMERA)}
    if "-" in names:
        kind = (kind or "").lstrip(".")
        if not kind.isalnum():
            raise JobError(
                "-", "standard input has no suffix", remedy="say what it is, e.g. --format dxf"
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
    from camgen.read.capture import name_picture  # noqa: PLC0415 (OpenCV and numpy, only for cameras)

    return name_picture(name)


def _shoot(name: str, path: Path) -> Source:
    from camgen.read.capture import capture, make_source  # noqa: PLC0415 (OpenCV and numpy, only for cameras)

    return make_source(name, path, capture(name))
