"""Decides by their state and the globs of the job which layers of a drawing are used."""

from __future__ import annotations

from fnmatch import fnmatchcase

from msgspec import Struct, field

from camgen.model.errors import JobError
from camgen.model.text import harmless, suggest
from camgen.read.chosen import is_chosen_layer

OFF, FROZEN, NOT_ASKED = "the layer is off", "the layer is frozen", "left out by input.layers"


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
            is_chosen = folded in self.clamps or is_chosen_layer(layer, self.globs)
            if not verdict and not is_chosen:
                verdict = NOT_ASKED
            self.verdicts[layer] = verdict
        return verdict

    def check(self, file: str) -> None:
        """Raises JobError for a glob that fits no layer.

        A misspelled glob would machine too much or too little.
        """
        for glob in self.globs:
            pattern = glob.removeprefix("!")
            if pattern == "*":
                continue
            if not any(fnmatchcase(name, pattern.casefold()) for name in self.names):
                names = map(harmless, sorted(self.names.values()))
                raise JobError(
                    file,
                    f"no layer fits {harmless(glob)!r}",
                    "input.layers",
                    f"{suggest(harmless(pattern), names)}; camgen inspect lists them",
                )
