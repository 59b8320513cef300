"""The bytes of a file that a user has named."""

from __future__ import annotations

import difflib
import os
import stat
from pathlib import Path

from camgen.errors import InputError


def readable(source: Path) -> bytes:
    """The bytes of an input. InputError when there are none: missing, a folder, not to be read."""
    try:
        mode = source.stat().st_mode
        if stat.S_ISDIR(mode):
            raise InputError(str(source), "is a folder", remedy="name the files in it")
        if not stat.S_ISREG(mode):
            raise InputError(str(source), "is not a regular file", remedy="copy it to a file, or use - with --format")
        data = source.read_bytes()
    except FileNotFoundError as error:
        raise InputError(str(source), "no such file", remedy=_nearest(source)) from error
    except (OSError, ValueError) as error:  # ValueError: a zero byte in the name
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(str(source), f"cannot be read: {reason}") from error
    return data


def _nearest(source: Path) -> str:
    try:
        stems = {Path(name).stem: name for name in sorted(os.listdir(source.parent))}
    except OSError:
        return "its folder does not exist"
    near = difflib.get_close_matches(source.stem, stems, 1)
    return f"nearest is {source.parent / stems[near[0]]}" if near else ""
