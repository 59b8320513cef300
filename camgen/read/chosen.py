"""Which layers and colors the globs and names of a job choose."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatchcase

from camgen.read.colors import resolve_named


def takes_layer(layer: str, globs: Sequence[str]) -> bool:
    """Whether a layer fits one of the globs and none with "!"; case does not matter, as in CAD."""
    name = layer.casefold()
    folded = [glob.casefold() for glob in globs]
    wanted = [glob for glob in folded if not glob.startswith("!")] or ["*"]
    if not any(fnmatchcase(name, glob) for glob in wanted):
        return False
    return not any(fnmatchcase(name, glob[1:]) for glob in folded if glob.startswith("!"))


def takes_color(color: str, names: Sequence[str]) -> bool:
    """Whether a color ("#ff0000") is one of the named ones; no names choose every color."""
    return not names or any(color in resolve_named(name) for name in names)
