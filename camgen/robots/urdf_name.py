"""The names by which a job asks for a robot that is described in a file: ``arm.urdf``, ``arm.urdf#tool0``."""

from __future__ import annotations

#: xacro is a language that makes URDF, and is refused where the file is read.
_SUFFIXES = (".urdf", ".xacro")


def split_name(name: str) -> tuple[str, str] | None:
    """The file and the link at its tip, "" where none is named; None for the name of a built-in robot.

    >>> split_name("cell/arm.urdf#tool0"), split_name("arm.URDF"), split_name("IRB 120")
    (('cell/arm.urdf', 'tool0'), ('arm.URDF', ''), None)
    """
    file, mark, tip = name.rpartition("#")
    if mark and file.lower().endswith(_SUFFIXES):
        return file, tip
    return (name, "") if name.lower().endswith(_SUFFIXES) else None
