"""Inputs for readers that are called by themselves."""

from pathlib import Path

from camgen.model.files import Source
from camgen.read.files import Files


def source(path: str | Path) -> Source:
    """The file, opened."""
    return Files().read(path)
