"""Which layers of a drawing are used: their state in the file and the globs of the job."""

from __future__ import annotations

from fnmatch import fnmatchcase
from typing import TYPE_CHECKING

from msgspec import Struct, field

from camgen.model.errors import JobError
from camgen.model.job import Job
from camgen.model.text import harmless, suggest
from camgen.read.chosen import is_chosen_layer

if TYPE_CHECKING:
    from ezdxf.document import Drawing


_LISTS = "camgen inspect lists them"
OFF, FROZEN, NOT_ASKED = "the layer is off", "the layer is frozen", "left out by input.layers"


class Layers(Struct):
    """States and names by folded name (CAD ignores case), the globs as written, and the verdicts reached so far.

    clamps: folded names of layers that are used whatever the globs say.
    """

    names: dict[str, str]
    states: dict[str, str]
    globs: tuple[str, ...]
    clamps: frozenset[str] = frozenset()
    verdicts: dict[str, str] = field(default_factory=dict)

    def why_not(self, layer: str) -> str:
        """Why curves on ``layer`` are not used, "" if they are."""
        verdict = self.verdicts.get(layer)
        if verdict is None:
            folded = layer.casefold()
            self.names.setdefault(folded, layer)
            verdict = self.states.get(folded, "")
            is_asked = folded in self.clamps or is_chosen_layer(layer, self.globs)
            if not verdict and not is_asked:
                verdict = NOT_ASKED
            self.verdicts[layer] = verdict
        return verdict

    def check(self, file: str) -> None:
        """``JobError`` for a glob that fits no layer: a slip of the pen would machine too much or too little."""
        for glob in self.globs:
            pattern = glob.removeprefix("!")
            if pattern != "*" and not any(
                fnmatchcase(name, pattern.casefold()) for name in self.names
            ):
                near = suggest(
                    harmless(pattern), [harmless(name) for name in sorted(self.names.values())]
                )
                raise JobError(
                    file, f"no layer fits {harmless(glob)!r}", "input.layers", f"{near}; {_LISTS}"
                )


def layers_of(document: Drawing, job: Job) -> Layers:
    """The layer table of the document with the globs and the clamps of the job."""
    names, states = {}, {}
    for layer in document.layers:
        name = str(layer.dxf.name)
        names[name.casefold()] = name
        if layer.is_frozen():
            states[name.casefold()] = FROZEN
        elif layer.is_off():
            states[name.casefold()] = OFF
    globs = tuple(glob.strip() for glob in job.input.layers)
    return Layers(names, states, globs, job.clamp_layers)
