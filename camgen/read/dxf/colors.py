"""What color an entity has: its own, that of its layer, or that of the reference to the block that it stands in."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from msgspec import Struct, field

from camgen.read.colors import ACI, resolve_aci

if TYPE_CHECKING:
    from ezdxf.document import Drawing

#: Numbers that stand for another color (group 62): that of the layer, that of the reference to the block.
_BYLAYER, _BYBLOCK = 256, 0


class Colors(Struct):
    """The different colors of a drawing, the first one that of what says nothing.

    of_layer: by folded name. known: what entities say, true color, number and layer, and the index of it in ``names``;
    -1 is that of the block.
    """

    of_layer: dict[str, str]
    names: list[str] = field(default_factory=lambda: [ACI[7]])
    known: dict[tuple[int | None, int | None, str], int] = field(default_factory=dict)

    def find(self, attributes: dict[str, Any], layer: str, block: int) -> int:
        """The index of the color of an entity on ``layer``. block: what BYBLOCK stands for."""
        key = (attributes.get("true_color"), attributes.get("color"), layer)
        index = self.known.get(key)
        if index is None:
            index = self.known[key] = self._add(*key)
        return block if index < 0 else index

    def _add(self, true: int | None, number: int | None, layer: str) -> int:
        if true is None and number == _BYBLOCK:
            return -1
        if true is not None:
            color = _hex(true)
        elif number is None or number == _BYLAYER:
            color = self.of_layer.get(layer.casefold(), ACI[7])
        else:
            color = resolve_aci(number)
        if color not in self.names:
            self.names.append(color)
        return self.names.index(color)


def colors_of(document: Drawing) -> Colors:
    """The colors of the document's layers."""
    found = {}
    for layer in document.layers:
        true = layer.dxf.get("true_color")
        found[str(layer.dxf.name).casefold()] = (
            resolve_aci(layer.color) if true is None else _hex(true)
        )
    return Colors(found)


def _hex(true: int) -> str:
    return f"#{true & 0xFFFFFF:06x}"
