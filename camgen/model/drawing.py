"""Values draw themselves in a notebook. How is known higher up (``preview.notebook``), which registers itself here."""

from __future__ import annotations

from functools import singledispatch


@singledispatch
def draw_svg(_value: object) -> str | None:
    """``_value`` as an SVG picture, None where nothing that draws such values has been loaded."""
    return None
