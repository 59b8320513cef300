"""The layers of a DXF document, and the colors of entities.

An entity may have the color of its layer, or of the block reference around it.
"""

from __future__ import annotations

from typing import Any

from ezdxf.document import Drawing
from msgspec import Struct, field

from camgen.model.job import Job
from camgen.read.colors import ACI, resolve_aci
from camgen.read.layers import FROZEN, OFF, Layers


def read_layers(document: Drawing, job: Job) -> Layers:
    """The layers of the document, with the globs and the clamps of the job."""
    names, states = {}, {}
    for layer in document.layers:
        name = str(layer.dxf.name)
        names[name.casefold()] = name
        if layer.is_frozen():
            states[name.casefold()] = FROZEN
        elif layer.is_off():
            states[name.casefold()] = OFF
    return Layers(names, states, tuple(map(str.strip, job.input.layers)), job.clamp_layers)


#: Color number (group 62) of an entity that has the color of its layer.
_BYLAYER = 256
#: Color number of an entity that has the color of the block reference around it.
_BYBLOCK = 0


class Colors(Struct):
    """The different colors of a drawing, "#rrggbb".

    of_layer: color by folded name of the layer.
    names: the colors. The first one is that of an entity without any other.
    known: cache: index in `names` by true color, color number and layer; -1 for the color of the
        block reference.
    """

    of_layer: dict[str, str]
    names: list[str] = field(default_factory=lambda: [ACI[7]])
    known: dict[tuple[int | None, int | None, str], int] = field(default_factory=dict)

    def find(self, attributes: dict[str, Any], layer: str, block: int) -> int:
        """Index in `names` of the color of an entity on `layer`.

        block: index of the color of the block reference around the entity.
        """
        key = (attributes.get("true_color"), attributes.get("color"), layer)
        index = self.known.get(key)
        if index is None:
            index = self.known[key] = self._add(*key)
        return block if index < 0 else index

    def _add(self, true_color: int | None, number: int | None, layer: str) -> int:
        """Index in `names` of a color, which is added if it is new; -1 for `_BYBLOCK`."""
        if true_color is not None:
            color = _format_true_color(true_color)
        elif number == _BYBLOCK:
            return -1
        elif number is None or number == _BYLAYER:
            color = self.of_layer.get(layer.casefold(), ACI[7])
        else:
            color = resolve_aci(number)
        if color not in self.names:
            self.names.append(color)
        return self.names.index(color)


def read_colors(document: Drawing) -> Colors:
    """The colors of the layers of a document."""
    of_layer = {}
    for layer in document.layers:
        true_color = layer.dxf.get("true_color")
        color = resolve_aci(layer.color) if true_color is None else _format_true_color(true_color)
        of_layer[str(layer.dxf.name).casefold()] = color
    return Colors(of_layer)


def _format_true_color(true_color: int) -> str:
    return f"#{true_color & 0xFFFFFF:06x}"
