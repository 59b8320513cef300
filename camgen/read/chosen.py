"""Choice of layers and colors by the globs and names of a job."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatchcase

from camgen.read.colors import resolve_named


def is_chosen_layer(layer: str, globs: Sequence[str]) -> bool:
    """Whether a layer is chosen. Upper and lower case are the same, as in CAD.

    globs: a layer has to match one of them, and none that starts with "!". Globs with "!" alone
        choose all other layers.
    """
    name = layer.casefold()
    has_choice = is_chosen = False
    for glob in map(str.casefold, globs):
        if not glob.startswith("!"):
            has_choice = True
            is_chosen |= fnmatchcase(name, glob)
        elif fnmatchcase(name, glob[1:]):
            return False
    return is_chosen or not has_choice


def is_chosen_color(color: str, names: Sequence[str]) -> bool:
    """Whether a color ("#ff0000") has one of the names. Without names every color is chosen."""
    return not names or any(color in resolve_named(name) for name in names)
