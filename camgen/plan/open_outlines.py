"""Asks about an outline with a gap before the sides of the contours in it are decided."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from camgen.model.errors import AmbiguousInput
from camgen.model.part import OpenOutline, Part, list_ids
from camgen.model.text import counted, name_ranges, short

#: Contours that a question names.
_NAMED = 8


def check_outlines(part: Part, decided: Collection[str], otherwise: str) -> None:
    """Raise AmbiguousInput if an outline with a gap encloses one of the contours `decided`.

    decided: ids of the closed contours that are worked on by the number of loops around them.
    otherwise: the remedy if the contours are meant to be open.
    """
    present = set(list_ids(part.contours))
    outlines = [outline for outline in part.open_outlines if present.issuperset(outline.ids)]
    outlines = [outline for outline in outlines if not set(decided).isdisjoint(outline.inside)]
    if not outlines:
        return
    outline, count = outlines[0], len(outlines)
    inside = [name for name in outline.inside if name in decided]
    more = f", like {counted(count - 1, 'other', 'others')}" if count > 1 else ""
    what = (
        f"the outline {_list_names(outline.ids)} has a gap of {short(outline.gap, 3)} mm{more}, so "
        f"inside and outside of {_list_names(inside)}, which it encloses, would be swapped"
    )
    x, y = outline.place
    raise AmbiguousInput(
        part.source,
        what,
        f"near x {short(x, 2)}, y {short(y, 2)}",
        f"{_describe_closing(outline, count)}; if it is meant to be open, {otherwise}",
    )


def _list_names(ids: Sequence[str]) -> str:
    more = f" and {len(ids) - _NAMED} more" if len(ids) > _NAMED else ""
    return ", ".join(name_ranges(list(ids[:_NAMED]))) + more


def _describe_closing(outline: OpenOutline, count: int) -> str:
    """How the gaps of `count` outlines, of which `outline` is the first, are closed."""
    what = "it" if count == 1 else "all of them"
    if outline.join:
        return f"input.join = {short(outline.join, 3)} closes {what}"
    return f"close {what}: a closed contour ends at its first point"
