"""What the paths of an image are called, and notes on what they leave out."""

from __future__ import annotations

import numpy as np

from camgen.geometry.segments import BoolArray, IntArray
from camgen.planners.columns import Label
from camgen.planners.image_space_border import Border
from camgen.planners.image_space_rings import ComplexArray, Rings, lengths
from camgen.settings import Job
from camgen.shapes import Note

#: What an image has instead of layers.
_LAYER = "image"
#: A length (px) that is not reached is told from here on: the resolution at two ends.
_TOLD = 4.0


def beside_which(edge: Border, table: Rings, points: ComplexArray, touched: IntArray) -> IntArray:
    """(L,) the border of the part that each path touches most often. touched: (N,) row of ``edge`` or -1.

    A path that touches nothing, only just fitting in, is beside the border that is nearest to its first point.
    """
    borders = len(edge.table.count)
    row = np.flatnonzero(touched >= 0)
    key = table.loop[row] * borders + edge.table.loop[touched[row]]
    often = np.bincount(key, minlength=len(table.count) * borders).reshape(-1, borders)
    main: IntArray = np.argmax(often, axis=1)
    for k in np.flatnonzero(~often.any(axis=1)).tolist():
        main[k] = edge.table.loop[np.argmin(np.abs(edge.points - points[table.first[k]]))]
    return main


def labels(main: IntArray, parent: IntArray, sound: BoolArray) -> list[Label | None]:
    """The paths by the border that each runs beside: ``c1``, or ``c1.1``, ``c1.2`` where that border has several; None
    for those that are not ``sound``, and what they enclose is inside what they are inside of.
    """
    several = np.bincount(main[sound], minlength=1) > 1
    place = np.where(sound, np.cumsum(sound) - 1, -1).tolist()
    seen = [0] * len(several)
    result: list[Label | None] = []
    for k, (on, good) in enumerate(zip(main.tolist(), sound.tolist(), strict=True)):
        if not good:
            result.append(None)
            continue
        seen[on] += 1
        name = f"c{on + 1}.{seen[on]}" if several[on] else f"c{on + 1}"
        around = int(parent[k])
        while around >= 0 and place[around] < 0:
            around = int(parent[around])
        result.append(Label(name, _LAYER, True, False, place[around] if around >= 0 else -1))
    return result


def left_out(
    edge: Border, reached: BoolArray, main: IntArray, sound: BoolArray, job: Job, mm_per_px: float
) -> list[Note]:
    """Notes on borders that have no path, and on the length that no tool of this size can touch.

    reached: (N,) of ``edge``, whether the tool may stand where it would touch that point. main: ``beside_which``.
    sound: (L,) false for paths that did not keep their distance.
    """
    tool = f"a {job.tool.diameter:g} mm tool" + (
        f" with corner radius {job.operation.corner_radius:g}" if job.operation.corner_radius else ""
    )
    count = len(edge.table.count)
    followed = np.isin(np.arange(count), main[sound])
    failed = np.isin(np.arange(count), main[~sound])
    # A border beside which no path runs for longest may still be touched by the one around a near neighbour.
    touched = np.bincount(edge.table.loop, reached, count) > 0
    why = "the path did not keep its distance; use waypoints that are closer together, or report it"
    notes = [
        not_followed(np.flatnonzero(which), how, reason)
        for which, how, reason in (
            (~followed & ~failed & ~touched, "too narrow", f"{tool} does not fit"),
            (failed, "check failed", why),
        )
        if which.any()
    ]
    length = lengths(edge.table, edge.points) * mm_per_px
    whole = float(length.sum())
    missing = np.where(touched & ~failed, np.bincount(edge.table.loop, np.where(reached, 0.0, length), count), 0.0)
    total = float(missing.sum())
    if total > max(1e-3 * whole, _TOLD * mm_per_px):
        worst = int(np.argmax(missing)) + 1
        what = f"{total:.4g} mm of {whole:.6g} mm of contour not touched, most of it on c{worst}"
        notes.append(Note("warning", what, f"inner corners and narrow places that {tool} does not reach"))
    return notes


def not_followed(borders: IntArray, how: str, why: str) -> Note:
    """One note on borders that have no path, the first of them by name."""
    ids = [f"c{k + 1}" for k in borders.tolist()]
    names = ", ".join(ids[:8]) + (" ..." if len(ids) > 8 else "")
    noun = "contour" if len(borders) == 1 else "contours"
    return Note("skipped", f"{len(ids)} {noun} not followed, {how}: {names} on layer {_LAYER}", why, tuple(ids))
