"""Adds finishing passes to followed contours, which take the allowance at the walls."""

from __future__ import annotations

import numpy as np
from msgspec.structs import replace

from camgen.geometry.intersect import measure_nearest
from camgen.geometry.segments import points_at
from camgen.model.part import Note
from camgen.model.path import ToolPath
from camgen.model.sequences import take_rows
from camgen.model.text import counted, name_ranges
from camgen.plan.beside import EXACT
from camgen.plan.columns import make_path_segments

#: Multiple of the allowance beyond which a finishing pass goes down pass by pass.
_MAX_ALLOWANCES = 3.0


def add_finishing(
    rough: tuple[ToolPath, ...], last: tuple[ToolPath, ...], finish: float, notes: tuple[Note, ...]
) -> tuple[tuple[ToolPath, ...], tuple[Note, ...]]:
    """Join roughing and finishing passes; the finishing passes run at the full depth.

    rough: passes that leave `finish` mm at the walls.
    last: passes along the walls.
    """
    base = len(rough)
    first_last, first_rough = _index_by_contour(last), _index_by_contour(rough)
    before = list(rough)
    for k, path in enumerate(rough):
        if first_last.keys() >= set(path.contours):
            parent = base + min(take_rows(first_last, path.contours))
            before[k] = replace(path, parent=parent)
    after, deep = [], []
    for path in last:
        parent = -1
        if path.parent >= 0:
            parent = first_rough.get(last[path.parent].contours[0], base + path.parent)
        is_deep = _is_far(path, rough, _MAX_ALLOWANCES * finish)
        deep += [path.id] if is_deep else []
        depths = path.depths if is_deep else path.depths[-1:]
        after.append(replace(path, id=f"{path.id}.finish", parent=parent, depths=depths))
    if deep and len(last[0].depths) > 1:
        count = counted(len(deep), "last pass goes", "last passes go")
        what = f"{count} down pass by pass: {', '.join(name_ranges(deep))}"
        notes = (
            *notes,
            Note(
                "assumed",
                what,
                f"in narrow places more than {finish:g} mm is left for them",
                tuple(deep),
            ),
        )
    return (*before, *after), notes


def _index_by_contour(paths: tuple[ToolPath, ...]) -> dict[str, int]:
    first: dict[str, int] = {}
    for k, path in enumerate(paths):
        for name in path.contours:
            first.setdefault(name, k)
    return first


def _is_far(path: ToolPath, others: tuple[ToolPath, ...], distance: float) -> bool:
    if not others:
        return True
    segments = make_path_segments((path,))
    points = [points_at(segments, np.full(len(segments), f)) for f in np.linspace(0.0, 1.0, 9)]
    nearest = measure_nearest(np.concatenate(points), make_path_segments(others), distance + EXACT)
    return bool(np.isinf(nearest).any())
