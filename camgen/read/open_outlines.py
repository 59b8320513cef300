"""Finds outlines that are open by a gap although they enclose closed contours.

Inside and outside of closed contours follow from the loops around them. A gap in an outline takes
one of these loops away: a window counts as an outline then, and a tool would run on its wrong side.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from camgen.geometry.ragged import following, offsets
from camgen.geometry.segments import flatten, from_contours
from camgen.model.job import Job
from camgen.model.part import Contour, OpenOutline, tabulate_contours
from camgen.model.pose import FloatArray
from camgen.read.join import GAP_SHARE, assemble, chain, closing_value, pair_ends
from camgen.read.pieces import Soup, same_distance

#: Arcs are flattened to chords within this for the test of inside and outside, mm.
_CHORD_MM = 0.02
#: Operations for which inside and outside of a contour make no difference.
_WITHOUT_SIDES = ("trace", "drill", "bore", "edges", "replay")


def find_open_outlines(contours: Sequence[Contour], job: Job) -> tuple[OpenOutline, ...]:
    """Find the open `contours` that would be outlines of closed ones without their gaps.

    An outline is a chain of open contours with these properties:

    - Each of its ends meets the end with which the reader joins it if `input.join` is as wide as
      the gap between them.
    - Its gaps together are at most `GAP_SHARE` of its length.
    - It does not cross itself once it is closed.
    - At least one closed contour lies in it as a whole.

    All outlines have the same `join`, which closes all of them: they are searched for once more,
    with their ends joined up to that value. Their order is that of their first contours. Nothing
    is searched for if `job` decides no sides.
    """
    opened = [contour for contour in contours if not contour.closed]
    closed = [contour for contour in contours if contour.closed]
    if not opened or not closed or not _decides_sides(job):
        return ()
    pieces, segments = _make_soup(opened), from_contours(opened)
    lengths = np.bincount(segments.owner, segments.length).astype(np.float64)
    # The gaps belong to the length of an outline.
    widest = GAP_SHARE / (1 - GAP_SHARE) * float(lengths.sum())
    candidates = _select_outlines(_close_chains(pieces, lengths, widest), closed)
    if not candidates:
        return ()
    join = closing_value(max(loop.gap for loop, _ in candidates))
    outlines = []
    for loop, inside in _select_outlines(_close_chains(pieces, lengths, join), closed):
        ids = tuple(opened[piece].id for piece in loop.pieces)
        names = tuple(contour.id for contour in inside)
        outlines.append(OpenOutline(ids, names, loop.gap, loop.place, join))
    return tuple(outlines)


def _decides_sides(job: Job) -> bool:
    """Whether an operation of `job` may decide by the loops around a contour how to work on it."""
    if any(step.choice.nesting != "any" for step in job.operations):
        return True
    if job.operations:
        return any(step.operation.kind not in _WITHOUT_SIDES for step in job.operations)
    if job.operation.kind == "auto":
        return not job.page.size
    return job.operation.kind not in _WITHOUT_SIDES


class _Loop(Struct, frozen=True, eq=False):
    """A chain of open contours with its gaps closed.

    pieces: indices of the contours along it.
    gap: width of its widest gap, mm.
    place: middle of that gap, mm.
    outline: the closed contour that it becomes.
    """

    pieces: tuple[int, ...]
    gap: float
    place: tuple[float, float]
    outline: Contour


def _make_soup(contours: Sequence[Contour]) -> Soup:
    """The open `contours` as pieces to be joined."""
    table = tabulate_contours(contours)
    layers, layer = np.unique([contour.layer for contour in contours], return_inverse=True)
    colors, color = np.unique([contour.color for contour in contours], return_inverse=True)
    return Soup(
        points=table.points,
        bulges=table.bulges,
        first=offsets(table.counts),
        closed=table.closed,
        layer=layer,
        kind=np.zeros(len(contours), dtype=np.intp),
        color=color,
        layers=tuple(layers.tolist()),
        kinds=("",),
        colors=tuple(colors.tolist()),
    )


def _close_chains(pieces: Soup, lengths: FloatArray, tolerance: float) -> list[_Loop]:
    """The chains that ends up to `tolerance` mm apart close, if their gaps are short enough.

    lengths: (P,) of the pieces, mm.
    """
    chains, are_closed = chain(pair_ends(pieces, tolerance).tolist(), pieces.closed.tolist())
    chains = [entered for entered, is_closed in zip(chains, are_closed, strict=True) if is_closed]
    if not chains:
        return []
    outlines = _make_outlines(pieces, chains)
    first, last = pieces.first[:-1], pieces.first[1:] - 1
    ends = np.stack([pieces.points[first], pieces.points[last]], axis=1).reshape(-1, 2)
    sizes = np.array([len(entered) for entered in chains])
    entered = np.concatenate(chains)
    left, met = ends[entered ^ 1], ends[entered[following(sizes)]]
    gaps, middles = np.hypot(*(met - left).T), (met + left) / 2
    begins = offsets(sizes)
    gap_sums = np.add.reduceat(gaps, begins[:-1])
    around = gap_sums + np.add.reduceat(lengths[entered >> 1], begins[:-1])
    loops = []
    for k in np.flatnonzero(gap_sums <= GAP_SHARE * around).tolist():
        widest = int(begins[k] + gaps[begins[k] : begins[k + 1]].argmax())
        x, y = middles[widest].tolist()
        members = tuple(end >> 1 for end in chains[k])
        loops.append(_Loop(members, float(gaps[widest]), (x, y), outlines[k]))
    return loops


def _make_outlines(pieces: Soup, chains: list[list[int]]) -> list[Contour]:
    """The closed contours that `chains` become."""
    closed, _ = assemble(pieces, chains, [True] * len(chains), same_distance(pieces))
    ranges = zip(closed.first[:-1].tolist(), closed.first[1:].tolist(), strict=True)
    return [Contour(closed.points[a:b], closed.bulges[a:b], True, "") for a, b in ranges]


def _select_outlines(
    loops: Sequence[_Loop], closed: Sequence[Contour]
) -> list[tuple[_Loop, list[Contour]]]:
    """The loops that do not cross themselves and enclose contours of `closed`, with these."""
    if not loops:
        return []
    import shapely  # noqa: PLC0415 (only drawings with such loops)

    from camgen.geometry.nesting import find_nesting  # noqa: PLC0415 (loads shapely)

    rings = _flatten_outlines(loops)
    loops = [loop for loop, ring in zip(loops, rings, strict=True) if len(ring) > 2]
    polygons = np.array([shapely.Polygon(ring) for ring in rings if len(ring) > 2], dtype=object)
    starts = shapely.points(np.array([contour.points[0] for contour in closed]))
    wide, narrow = shapely.buffer(polygons, _CHORD_MM), shapely.buffer(polygons, -_CHORD_MM)
    which, candidates = shapely.STRtree(starts).query(wide, predicate="contains")
    outlines = []
    for k in np.unique(which).tolist():
        if (
            not polygons[k].is_valid
            and find_nesting(from_contours([loops[k].outline]), 1).crossed[0] >= 0
        ):
            continue
        inside = [closed[j] for j in np.sort(candidates[which == k]).tolist()]
        inside = [contour for contour in inside if _lies_in(contour, wide[k], narrow[k])]
        if inside:
            outlines.append((loops[k], inside))
    return outlines


def _flatten_outlines(loops: Sequence[_Loop]) -> list[FloatArray]:
    """The outline of each loop as points (N, 2); two points run there and back."""
    points, owner = flatten(from_contours([loop.outline for loop in loops]), _CHORD_MM)
    return np.split(points, np.flatnonzero(np.diff(owner)) + 1)


def _lies_in(contour: Contour, wide: object, narrow: object) -> bool:
    """Whether the contour lies in a loop.

    It may touch the loop, but is not drawn on top of it as a whole.

    wide, narrow: polygons of the loop, larger and smaller by `_CHORD_MM`.
    """
    import shapely  # noqa: PLC0415 (only drawings with such loops)

    covered = shapely.contains_xy(wide, contour.points).all()
    return bool(covered and shapely.contains_xy(narrow, contour.points).any())
