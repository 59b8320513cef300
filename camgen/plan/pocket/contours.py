"""Contours of pockets: walls, islands, and contours that are left out with a note."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import chain, compress
from typing import Any

import numpy as np
import shapely
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import NDArray

from camgen.geometry.nesting import (
    Nesting,
    find_enclosing,
    find_nesting,
    mark_small_crossings,
)
from camgen.geometry.ragged import count_rows, list_owners
from camgen.geometry.segments import (
    Segments,
    find_following,
    flatten,
    make_contour_segments,
)
from camgen.geometry.uncross import find_slips, uncross_loops
from camgen.model.part import Contour, Note, list_ids, list_layers, select_closed, select_open
from camgen.model.sequences import take_rows
from camgen.model.text import counted, name_ranges, short
from camgen.plan.follow import reverse_loops
from camgen.plan.pocket.regions import (
    CHORD_MM,
    MIN_CORNERS,
    PocketWalls,
)

#: Maximum number of places that are listed in the text of a note.
_NAMED_PLACES = 4
#: mm: a loop that crosses itself is repaired if no wider disc fits into the part that crosses.
_SLIP_MM = 0.02
_EMPTY = shapely.Polygon()


class Pockets(Struct, frozen=True, eq=False):
    """The P pockets of a part.

    walls: their walls and islands.
    names: id of the outer wall of each pocket.
    layers: layer of the outer wall of each pocket.
    contours: ids of all walls of each pocket.
    cleared: polygons that earlier operations clear, for `operation.rest`; empty without it.
    """

    walls: PocketWalls
    names: list[str]
    layers: list[str]
    contours: list[tuple[str, ...]]
    cleared: Any = _EMPTY

    def list_contours(self, rows: Iterable[int]) -> tuple[str, ...]:
        """The ids of all walls of the pockets `rows`."""
        return tuple(chain.from_iterable(take_rows(self.contours, rows)))


def find_pockets(contours: Sequence[Contour]) -> tuple[Pockets, list[Note]]:
    """The pockets that the contours enclose, and notes on contours that are left out."""
    closed = select_closed(contours)
    segments = make_contour_segments(closed)
    nesting = _find_overlaps(closed, find_nesting(segments, len(closed)))
    # An island may reach out of its pocket, where no tool of that pocket comes.
    nesting = mark_small_crossings(segments, nesting, islands=False)
    crossings = _find_crossings(closed)
    for k in crossings:
        nesting.crossed[k] = k
    why_loose = "only closed contours have an inside; raise input.join to close gaps"
    loose = (select_open(contours), "open", why_loose)
    unfit = [*_find_unfit(closed, nesting, crossings), loose]
    notes: list[Note] = []
    unfit_contours: list[Contour] = []
    for chosen, problem, why in unfit:
        unfit_contours += chosen
        notes += _note_not_cleared(chosen, problem, why)
    is_valid = (nesting.crossed < 0) & ~nesting.empty
    is_within = find_enclosing(nesting.parent, ~is_valid) >= 0
    within = list(compress(closed, is_valid & is_within))
    notes += _note_not_cleared(within, "inside crossing ones", "no clear inside; draw one outline")
    is_valid &= ~is_within
    outer = np.flatnonzero(is_valid & (nesting.depth % 2 == 0))
    unclear = _find_unclear(closed, outer.tolist(), unfit_contours)
    why = (
        "their purpose is not clear: as islands they would be cut away; "
        "repair them or leave them out"
    )
    problem = "with contours in them that are open or cross others"
    notes += _note_not_cleared(take_rows(closed, unclear), problem, why)
    members: list[list[int]] = []
    for k in outer.tolist():
        if k not in unclear:
            is_island = is_valid & (nesting.parent == k) & (nesting.depth % 2 == 1)
            members.append([k, *np.flatnonzero(is_island).tolist()])
    return _make_pockets(closed, nesting, members), notes


def _make_pockets(
    closed: Sequence[Contour], nesting: Nesting, members: Sequence[Sequence[int]]
) -> Pockets:
    """The pockets, with the material on the left of their walls.

    Outer walls run clockwise, islands counter-clockwise.

    closed: closed contours.
    nesting: depth and signed area of each of them.
    members: indices of the outer wall and of the islands of each pocket.
    """
    chosen = list(chain.from_iterable(members))
    is_reversed = (nesting.area[chosen] > 0) == (nesting.depth[chosen] % 2 == 0)
    segments = reverse_loops(make_contour_segments(take_rows(closed, chosen)), is_reversed)
    following = find_following(segments, np.ones(len(chosen), dtype=bool))
    slips = find_slips(segments, following, len(chosen)) | _are_crossed(segments, len(chosen))
    segments, following = uncross_loops(segments, following, slips)
    pocket = list_owners(count_rows(members))
    walls = PocketWalls(segments, following, pocket[segments.owner], len(members))
    layers = [closed[outer].layer for outer, *_ in members]
    contours = [list_ids(take_rows(closed, pocket_members)) for pocket_members in members]
    return Pockets(walls, [outer for outer, *_ in contours], layers, contours)


def _find_overlaps(closed: Sequence[Contour], nesting: Nesting) -> Nesting:
    """The nesting, with contours marked as crossing that overlap others in a thin sliver.

    Between two such contours material would be cut away.
    """
    points, owner = flatten(make_contour_segments(closed), CHORD_MM)
    has_area = np.bincount(owner, minlength=len(closed)) >= MIN_CORNERS
    tested = np.flatnonzero(has_area & (nesting.crossed < 0))
    rows = np.isin(owner, tested)
    indices = np.searchsorted(tested, owner[rows])
    polygons = shapely.polygons(shapely.linearrings(points[rows], indices=indices))
    edges = shapely.boundary(polygons)
    first, second = shapely.STRtree(edges).query(edges, predicate="intersects")
    first, second = first[first < second], second[first < second]
    touching = np.unique([first, second])
    polygons[touching] = shapely.make_valid(polygons[touching])
    common = shapely.area(shapely.intersection(polygons[first], polygons[second]))
    smaller = np.minimum(shapely.area(polygons[first]), shapely.area(polygons[second]))
    slack = 2 * CHORD_MM * np.minimum(shapely.length(edges[first]), shapely.length(edges[second]))
    overlaps = (common > slack) & (smaller - common > slack)
    first, second = tested[first[overlaps]], tested[second[overlaps]]
    crossed = nesting.crossed.copy()
    crossed[first], crossed[second] = second, first
    return replace(nesting, crossed=crossed)


def _are_crossed(loops: Segments, count: int) -> NDArray[np.bool_]:
    points, owner = flatten(loops, CHORD_MM)
    crossed = np.zeros(count, dtype=np.bool_)
    polygons = np.flatnonzero(np.bincount(owner, minlength=count) >= MIN_CORNERS)
    rows = np.isin(owner, polygons)
    rings = shapely.linearrings(points[rows], indices=np.searchsorted(polygons, owner[rows]))
    crossed[polygons] = ~shapely.is_valid(shapely.polygons(rings))
    return crossed


def _find_crossings(closed: Sequence[Contour]) -> dict[int, tuple[float, float]]:
    """The contours that cross themselves in a loop wider than `_SLIP_MM`, with a point of it, mm.

    Inside such a loop it is not clear on which side the pocket lies.
    """
    places: dict[int, tuple[float, float]] = {}
    crossed = _are_crossed(make_contour_segments(closed), len(closed))
    for k in np.flatnonzero(crossed).tolist():
        points, _ = flatten(make_contour_segments([closed[k]]), CHORD_MM)
        parts = shapely.get_parts(shapely.make_valid(shapely.Polygon(points)))
        parts = parts[np.argsort(-shapely.area(parts), kind="stable")]
        loops = parts[1:][~shapely.is_empty(shapely.buffer(parts[1:], -_SLIP_MM / 2))]
        if len(loops):
            places[k] = loops[0].representative_point().coords[0]
    return places


def _find_unfit(
    closed: Sequence[Contour], nesting: Nesting, crossings: dict[int, tuple[float, float]]
) -> list[tuple[list[Contour], str, str]]:
    """Closed contours that cannot be walls, with the problem, and the reason with a remedy."""
    crosses_itself = nesting.crossed == np.arange(len(nesting.crossed))
    crosses_other = (nesting.crossed >= 0) & ~crosses_itself
    why = "no clear inside; draw one outline"
    points = list(crossings.values())[:_NAMED_PLACES]
    places = ", ".join(f"near {short(x, 2)} {short(y, 2)} mm" for x, y in points)
    why_itself = f"{why}, see {places}" if places else why
    twisted = compress(closed, crosses_itself & ~nesting.empty)
    return [
        (list(twisted), "crossing themselves", why_itself),
        (list(compress(closed, crosses_other)), "crossing each other", why),
        (list(compress(closed, nesting.empty & ~crosses_other)), "without an inside", why),
    ]


def _find_unclear(
    closed: Sequence[Contour], outer: Sequence[int], unfit: Sequence[Contour]
) -> list[int]:
    """Indices of the outer walls that an unfit contour touches, or inside which it lies.

    closed: closed contours.
    outer: indices of those that are outer walls.
    unfit: contours that cannot be walls.
    """
    if not unfit or not outer:
        return []
    points, owner = flatten(make_contour_segments(take_rows(closed, outer)), CHORD_MM)
    polygons = shapely.make_valid(shapely.polygons(shapely.linearrings(points, indices=owner)))
    chords, chord_owner = flatten(make_contour_segments(unfit), CHORD_MM)
    ends = np.array([contour.points[0 if contour.closed else -1] for contour in unfit])
    owners = np.append(chord_owner, np.arange(len(unfit)))
    order = np.argsort(owners, kind="stable")
    lines = shapely.linestrings(np.vstack([chords, ends])[order], indices=owners[order])
    touched = shapely.STRtree(polygons).query(lines, predicate="intersects")[1]
    return take_rows(outer, np.unique(touched))


def _note_not_cleared(contours: Sequence[Contour], problem: str, why: str) -> Iterator[Note]:
    if contours:
        ids = list_ids(contours)
        what = format_not_cleared(ids, set(list_layers(contours)), problem)
        yield Note("skipped", what, why, ids)


def format_not_cleared(names: Sequence[str], layers: set[str], problem: str) -> str:
    """The text of a note: number, ids and layers of contours that are not cleared, and why."""
    count, ranges = counted(len(names), "contour"), ", ".join(name_ranges(list(names)))
    return f"{count} not cleared, {problem}: {ranges} on layer {', '.join(sorted(layers))}"
