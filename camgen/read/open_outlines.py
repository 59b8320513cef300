"""Finds outlines that are open by a gap although they enclose closed contours.

Inside and outside of a closed contour follow from the loops around it. A gap in an outline removes
one of these loops: a window counts as an outline then, and a tool would run on its wrong side.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import compress

import numpy as np
from msgspec import Struct

from camgen.geometry.ragged import compute_offsets, find_following_rows
from camgen.geometry.segments import flatten, make_contour_segments
from camgen.model.job import Job
from camgen.model.part import (
    Contour,
    OpenOutline,
    list_ids,
    select_closed,
    select_open,
    tabulate_contours,
)
from camgen.model.pose import FloatArray
from camgen.model.sequences import take_rows
from camgen.read.join import GAP_SHARE, assemble, chain, compute_join, pair_ends
from camgen.read.pieces import DrawnPieces, compute_same_distance, index_names

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

    All outlines get the same `join`, which closes all of them: the search is repeated with ends
    joined up to that value. Their order is that of their first contours. The result is empty if
    sides make no difference to `job`.
    """
    opened, closed = select_open(contours), select_closed(contours)
    if not opened or not closed or not _decides_sides(job):
        return ()
    pieces, segments = _make_soup(opened), make_contour_segments(opened)
    lengths = np.bincount(segments.owner, segments.length).astype(np.float64)
    # The gaps belong to the length of an outline.
    widest = GAP_SHARE / (1 - GAP_SHARE) * float(lengths.sum())
    candidates = list(_select_outlines(_close_chains(pieces, lengths, widest), closed))
    if not candidates:
        return ()
    join = compute_join(max(loop.gap for loop, _ in candidates))
    outlines = []
    for loop, inside in _select_outlines(_close_chains(pieces, lengths, join), closed):
        ids = list_ids(take_rows(opened, loop.pieces))
        outlines.append(OpenOutline(ids, list_ids(inside), loop.gap, loop.place, join))
    return tuple(outlines)


def _decides_sides(job: Job) -> bool:
    """Whether an operation of `job` may treat a contour by the loops around it."""
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


def _make_soup(contours: Sequence[Contour]) -> DrawnPieces:
    table = tabulate_contours(contours)
    layers, layer = index_names([contour.layer for contour in contours])
    colors, color = index_names([contour.color for contour in contours])
    return DrawnPieces(
        points=table.points,
        bulges=table.bulges,
        first=compute_offsets(table.counts),
        closed=table.closed,
        layer=layer,
        kind=np.zeros(len(contours), dtype=np.intp),
        color=color,
        layers=layers,
        kinds=("",),
        colors=colors,
    )


def _close_chains(pieces: DrawnPieces, lengths: FloatArray, tolerance: float) -> list[_Loop]:
    """The chains that are closed if ends up to `tolerance` mm apart are joined.

    Chains whose gaps are too large a part of their length are left out.

    lengths: (P,) lengths of the pieces, mm.
    """
    chains, are_closed = chain(pair_ends(pieces, tolerance).tolist(), pieces.closed.tolist())
    chains = list(compress(chains, are_closed))
    if not chains:
        return []
    closed, _ = assemble(pieces, chains, [True] * len(chains), compute_same_distance(pieces))
    first, last = pieces.first[:-1], pieces.first[1:] - 1
    ends = np.stack([pieces.points[first], pieces.points[last]], axis=1).reshape(-1, 2)
    sizes = np.array(list(map(len, chains)))
    entered = np.concatenate(chains)
    left, met = ends[entered ^ 1], ends[entered[find_following_rows(sizes)]]
    gaps, middles = np.hypot(*(met - left).T), (met + left) / 2
    begins = compute_offsets(sizes)
    gap_sums = np.add.reduceat(gaps, begins[:-1])
    around = gap_sums + np.add.reduceat(lengths[entered >> 1], begins[:-1])
    loops = []
    for k in np.flatnonzero(gap_sums <= GAP_SHARE * around).tolist():
        widest = int(begins[k] + gaps[begins[k] : begins[k + 1]].argmax())
        x, y = middles[widest].tolist()
        members = tuple((np.array(chains[k]) >> 1).tolist())
        rows = slice(int(closed.first[k]), int(closed.first[k + 1]))
        outline = Contour(closed.points[rows], closed.bulges[rows], True, "")
        loops.append(_Loop(members, float(gaps[widest]), (x, y), outline))
    return loops


def _select_outlines(
    loops: Sequence[_Loop], closed: Sequence[Contour]
) -> Iterator[tuple[_Loop, list[Contour]]]:
    """The loops that do not cross themselves, each with the contours of `closed` inside it.

    Loops without such contours are left out.
    """
    if not loops:
        return
    import shapely  # noqa: PLC0415 (only drawings with such loops)

    from camgen.geometry.nesting import find_nesting  # noqa: PLC0415 (loads shapely)

    points, owner = flatten(make_contour_segments([loop.outline for loop in loops]), _CHORD_MM)
    rings = np.split(points, np.flatnonzero(np.diff(owner)) + 1)
    has_area = [len(ring) > 2 for ring in rings]
    loops = list(compress(loops, has_area))
    polygons = np.array(list(map(shapely.Polygon, compress(rings, has_area))), dtype=object)
    starts = shapely.points(np.array([contour.points[0] for contour in closed]))
    wide, narrow = shapely.buffer(polygons, _CHORD_MM), shapely.buffer(polygons, -_CHORD_MM)
    which, candidates = shapely.STRtree(starts).query(wide, predicate="contains")
    for k in np.unique(which).tolist():
        if (
            not polygons[k].is_valid
            and find_nesting(make_contour_segments([loops[k].outline]), 1).crossed[0] >= 0
        ):
            continue
        inside = []
        for j in np.sort(candidates[which == k]).tolist():
            # A contour may touch the loop, but not lie on it as a whole.
            points = closed[j].points
            is_covered = shapely.contains_xy(wide[k], points).all()
            if is_covered and shapely.contains_xy(narrow[k], points).any():
                inside.append(closed[j])
        if inside:
            yield loops[k], inside
