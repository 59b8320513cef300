"""Pictures of values in a notebook, drawn by `preview.notebook`, which registers itself here."""

from __future__ import annotations

from functools import singledispatch


@singledispatch
def draw_svg(_value: object) -> str | None:
    """`_value` as an SVG picture; None if no function for such values has been registered."""
    return None
