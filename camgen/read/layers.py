"""Decides by their state and the globs and names of the job which layers and colors are used."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatchcase

from msgspec import Struct, field

from camgen.model.errors import JobError
from camgen.model.job import Choice
from camgen.model.text import harmless, suggest
from camgen.read.colors import resolve_named

OFF, FROZEN, NOT_ASKED = "the layer is off", "the layer is frozen", "left out by input.layers"


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


def is_chosen(layer: str, color: str, choice: Choice) -> bool:
    """Whether an operation chooses curves on a layer and of a color ("#ff0000").

    A choice without names of colors has every color.
    """
    names = choice.colors
    has_color = not names or any(color in resolve_named(name) for name in names)
    return has_color and is_chosen_layer(layer, choice.layers)


class Layers(Struct):
    """The layers of a drawing. CAD programs ignore case, so they are found by their folded names.

    names: name as the file spells it, by folded name.
    states: reason not to use a layer that is off or frozen, by folded name.
    globs: patterns of `input.layers`.
    clamps: folded names of the layers of clamps, which are used without a matching glob.
    verdicts: cache of `why_not`, by name as spelled.
    """

    names: dict[str, str]
    states: dict[str, str]
    globs: tuple[str, ...]
    clamps: frozenset[str] = frozenset()
    verdicts: dict[str, str] = field(default_factory=dict)

    def why_not(self, layer: str) -> str:
        """The reason why curves on `layer` are not used, "" if they are."""
        verdict = self.verdicts.get(layer)
        if verdict is None:
            folded = layer.casefold()
            self.names.setdefault(folded, layer)
            verdict = self.states.get(folded, "")
            if not (verdict or folded in self.clamps or is_chosen_layer(layer, self.globs)):
                verdict = NOT_ASKED
            self.verdicts[layer] = verdict
        return verdict

    def check(self, file: str) -> None:
        """Raises JobError for a glob that fits no layer.

        A misspelled glob would machine too much or too little.
        """
        for glob in self.globs:
            pattern = glob.removeprefix("!")
            fits = any(fnmatchcase(name, pattern.casefold()) for name in self.names)
            if pattern != "*" and not fits:
                names = map(harmless, sorted(self.names.values()))
                raise JobError(
                    file,
                    f"no layer fits {harmless(glob)!r}",
                    "input.layers",
                    f"{suggest(harmless(pattern), names)}; camgen inspect lists them",
                )
