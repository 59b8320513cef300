"""Last passes of followed contours: what the others left at the walls, at the whole depth."""

from __future__ import annotations

import numpy as np
from msgspec.structs import replace

from camgen.geometry.intersect import measure_nearest
from camgen.geometry.segments import points_at
from camgen.model.part import Note
from camgen.model.path import ToolPath
from camgen.model.text import counted, name_ranges
from camgen.plan.beside import EXACT
from camgen.plan.columns import path_segments

#: A last pass that finds more than so many times what is left at the walls goes down pass by pass.
_MUCH = 3.0


def rough_then_last(
    rough: tuple[ToolPath, ...], last: tuple[ToolPath, ...], finish: float, notes: tuple[Note, ...]
) -> tuple[tuple[ToolPath, ...], tuple[Note, ...]]:
    """The paths that leave ``finish`` mm, and after them those that take it, at the whole depth."""
    base = len(rough)
    first_last: dict[str, int] = {}
    first_rough: dict[str, int] = {}
    for found, paths in ((first_last, last), (first_rough, rough)):
        for k, path in enumerate(paths):
            for name in path.contours:
                found.setdefault(name, k)
    before = [
        replace(path, parent=base + min(first_last[name] for name in path.contours))
        if all(name in first_last for name in path.contours)
        else path
        for path in rough
    ]
    after, deep = [], []
    for path in last:
        around = -1
        if path.parent >= 0:
            outer = last[path.parent].contours
            around = first_rough.get(outer[0], base + path.parent)
        much = _is_more_left(path, rough, _MUCH * finish)
        deep += [path.id] if much else []
        depths = path.depths if much else path.depths[-1:]
        after.append(replace(path, id=f"{path.id}.finish", parent=around, depths=depths))
    if deep and len(last[0].depths) > 1:
        names = ", ".join(name_ranges(deep))
        what = (
            f"{counted(len(deep), 'last pass goes', 'last passes go')} down pass by pass: {names}"
        )
        why = f"in narrow places more than {finish:g} mm is left for them"
        notes = (*notes, Note("assumed", what, why, tuple(deep)))
    return (*before, *after), notes


def _is_more_left(path: ToolPath, rough: tuple[ToolPath, ...], most: float) -> bool:
    """Whether a place of ``path`` is farther than ``most`` mm from all ``rough`` ones."""
    if not rough:
        return True
    spans = path_segments(rough)
    own = path_segments((path,))
    points = np.concatenate(
        [points_at(own, np.full(len(own), f)) for f in np.linspace(0.0, 1.0, 9)]
    )
    return bool(np.isinf(measure_nearest(points, spans, most + EXACT)).any())
