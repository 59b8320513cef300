"""Keeps parts of an outline as lines: pieces of a chain that do not follow their points, or cross.

Only such a spot is kept as lines, the rest of the outline stays fitted. All lengths are in pixels,
so the scale of a picture does not influence any decision.
"""

from __future__ import annotations

import numpy as np
import shapely
from msgspec import Struct

from camgen.geometry.ragged import find_true_runs, list_owners, number_rows
from camgen.geometry.rings import ComplexArray
from camgen.geometry.thinning import Polylines, thin_chains
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray
from camgen.vision.lines_arcs.polish import (
    Fillets,
    FittedChain,
    find_places,
    measure_roundings,
    repair,
)

#: How a piece is drawn: as it was fitted, as lines that are thinned out within the noise, or as
#: lines from point to point.
FITTED, THINNED, POINTS = 0, 1, 2
#: px: largest distance of an arc from the lines that replace it in the test for crossings.
_CHORD = 0.02
#: px: largest distance of a point from the ring, beside the noise.
_MAX_DISTANCE = 1.0
#: Rounds of tests, at most. In each round a spot grows by its neighbours. After that all pieces are
#: drawn from point to point.
_MAX_ROUNDS = 12
#: Largest fraction of the area of an outline that is cut off where it crosses itself.
_MAX_CUT = 0.02


class Ring(Struct, frozen=True, eq=False):
    """A closed ring of M segments.

    corners: (M,) px.
    bulges: (M,) bulge of the segment that leaves each corner.
    piece: (M,) piece of the chain that each segment belongs to.
    """

    corners: ComplexArray
    bulges: FloatArray
    piece: IntArray


class Sound(Struct, frozen=True, eq=False):
    """A ring that does not cross itself.

    ring: the ring.
    drawn: (K,) FITTED, THINNED or POINTS, for each piece of the chain.
    cut: area of small loops that were cut off, px2.
    """

    ring: Ring
    drawn: IntArray
    cut: float = 0.0


def make_sound(
    chain: FittedChain,
    fillets: Fillets,
    bad: BoolArray,
    points: ComplexArray,
    piece: IntArray,
    tolerance: float,
) -> Sound | None:
    """Draw a chain as a ring that does not cross itself.

    Bad pieces are drawn as lines near their points, and so are pieces that miss a point, such as a
    spike of a pixel or two. Pieces that cross are drawn as lines too, then from point to point,
    then also their neighbours. If the points themselves cross, as in a slit of a pixel, the small
    loop is cut off.

    bad: (K,) the piece does not follow its points.
    piece: (N,) piece to which each point belongs.
    tolerance: largest distance of lines from their points, px.

    Returns None if too much would be cut off.
    """
    drawn = np.where(bad, THINNED, FITTED)
    max_distance = _MAX_DISTANCE + tolerance + measure_roundings(chain, fillets, points, piece)
    for _ in range(_MAX_ROUNDS):
        ring = halve(_draw_ring(chain, fillets, drawn, points, piece, tolerance))
        pairs = _find_crossings(ring)
        wrong = np.unique(ring.piece[pairs])
        if not len(pairs):
            missing = np.unique(piece[_measure_distances(ring, points) > max_distance])
            wrong = missing[drawn[missing] == FITTED]
            if not len(wrong):
                return Sound(ring, drawn)
        elif (drawn[wrong] == POINTS).all():
            sound = _cut_loops(ring, drawn)
            if sound is not None:
                return sound
            neighbours = np.concatenate([wrong - 1, wrong, wrong + 1])
            wrong = np.unique(neighbours % len(drawn))
        drawn = drawn.copy()
        drawn[wrong] = np.minimum(drawn[wrong] + 1, POINTS)
    drawn = np.full(len(drawn), POINTS)
    return _cut_loops(halve(_draw_ring(chain, fillets, drawn, points, piece, tolerance)), drawn)


def _draw_ring(
    chain: FittedChain,
    fillets: Fillets,
    drawn: IntArray,
    points: ComplexArray,
    piece: IntArray,
    tolerance: float,
) -> Ring:
    """The ring of a chain whose pieces are drawn as `drawn` (K,) states."""
    kept = _select_points(points, drawn[piece] == THINNED, tolerance)
    return Ring(*repair(chain, fillets, drawn != FITTED, points[kept], piece[kept]))


def _select_points(points: ComplexArray, thinned: BoolArray, tolerance: float) -> IntArray:
    """The rows of the points (N,) that lines within `tolerance` px of all points need.

    Only points in stretches of `thinned` (N,) points are left out.
    """
    is_fixed = ~(thinned & np.roll(thinned, 1) & np.roll(thinned, -1))
    is_fixed[[0, -1]] = True
    plane = np.column_stack([points.real, points.imag])
    ends = np.array([0, len(points)])
    polylines = Polylines(plane, np.zeros(len(points)), ends, np.flatnonzero(is_fixed))
    return thin_chains(polylines, tolerance)


def halve(ring: Ring) -> Ring:
    """Divide each arc of more than half a circle into two."""
    middle = find_places(ring.corners, np.roll(ring.corners, -1), ring.bulges, 0.5)
    is_large = np.abs(ring.bulges) > 1
    large = np.flatnonzero(is_large)
    half = np.where(is_large, np.tan(np.arctan(ring.bulges) / 2), ring.bulges)
    return Ring(
        np.insert(ring.corners, large + 1, middle[large]),
        np.insert(half, large + 1, half[large]),
        np.insert(ring.piece, large + 1, ring.piece[large]),
    )


def _find_crossings(ring: Ring) -> IntArray:
    """Pairs (P, 2) of segments that meet elsewhere than at their common end, the smaller one first.

    Empty if the ring does not cross itself.
    """
    plane, owner = _flatten(ring)
    if len(plane) > 2 and shapely.is_valid(shapely.Polygon(plane)):
        return np.zeros((0, 2), dtype=np.int64)
    lines = shapely.linestrings(np.stack([plane, np.roll(plane, -1, axis=0)], axis=1))
    a, b = shapely.STRtree(lines).query(lines, predicate="intersects")
    offset = (b - a) % len(lines)
    is_apart = (a < b) & (offset > 1) & (offset < len(lines) - 1)
    pairs = np.column_stack([owner[a[is_apart]], owner[b[is_apart]]])
    if not len(pairs):
        # The ring runs back on itself from one line to the next: where it turns most.
        vectors = np.roll(plane, -1, axis=0) - plane
        products = np.einsum("nd,nd->n", vectors, np.roll(vectors, -1, axis=0))
        back = int(np.argmin(products))
        pairs = np.array([[owner[back], owner[(back + 1) % len(owner)]]])
    return np.unique(np.sort(pairs, axis=1), axis=0)


def _flatten(ring: Ring) -> tuple[FloatArray, IntArray]:
    """Replace the arcs of a ring by lines.

    Returns the points (L, 2) of the lines, px, and the segment (L,) that each line belongs to.
    """
    sweep = 4 * np.arctan(np.abs(ring.bulges))
    chord = np.abs(np.roll(ring.corners, -1) - ring.corners)
    radius = chord / (2 * np.maximum(np.sin(sweep / 2), 1e-9))
    # An arc of angle a leaves its chord by r (1 - cos(a / 2)), about r a^2 / 8.
    step = np.sqrt(8 * _CHORD / np.maximum(radius, _CHORD))
    count = np.maximum(np.ceil(sweep / step), 1).astype(np.int64)
    owner, fraction = list_owners(count), number_rows(count) / np.repeat(count, count)
    ends = np.roll(ring.corners, -1)
    places = find_places(ring.corners[owner], ends[owner], ring.bulges[owner], fraction)
    return np.column_stack([places.real, places.imag]), owner


def _measure_distances(ring: Ring, points: ComplexArray) -> FloatArray:
    """Distances (N,) of `points` (N,) from the ring, px."""
    plane, _ = _flatten(ring)
    line = shapely.linestrings(np.append(plane, plane[:1], axis=0))
    shapely.prepare(line)
    return np.asarray(shapely.distance(shapely.points(points.real, points.imag), line))


def _cut_loops(ring: Ring, drawn: IntArray) -> Sound | None:
    """Cut off the small loops of a ring in which lines from point to point cross.

    Returns None if other pieces cross, or if more than `_MAX_CUT` of the area would be cut off.
    """
    ring_area, cut = abs(_compute_area(ring.corners)), 0.0
    while True:
        pairs = _find_crossings(ring)
        if not len(pairs):
            return Sound(ring, drawn, cut)
        count = len(ring.corners)
        inner = pairs[:, 1] - pairs[:, 0]
        is_swapped = inner > count / 2
        first = np.where(is_swapped, pairs[:, 1], pairs[:, 0])
        size = np.where(is_swapped, count - inner, inner)
        k = int(np.argmin(size))
        loop = (first[k] + 1 + np.arange(size[k])) % count
        loop_pieces = ring.piece[np.append(loop, first[k])]
        if count - len(loop) < 3 or (drawn[loop_pieces] != POINTS).any():
            return None
        cut += abs(_compute_area(ring.corners[loop]))
        if cut > _MAX_CUT * ring_area:
            return None
        kept = np.delete(np.arange(count), loop)
        ring = Ring(ring.corners[kept], ring.bulges[kept], ring.piece[kept])


def _compute_area(corners: ComplexArray) -> float:
    """Signed area of a polygon, px2."""
    return float((corners.conj() * np.roll(corners, -1)).imag.sum() / 2)


def find_stretches(
    drawn: IntArray, points: ComplexArray, piece: IntArray
) -> tuple[ComplexArray, FloatArray]:
    """Find the stretches of an outline that are drawn as lines.

    drawn: (K,) state of each piece.
    piece: (N,) piece to which each point belongs.

    Returns the middles (S,) and the lengths (S,) of the stretches, px.
    """
    is_line = (drawn != FITTED)[piece]
    # Begin at a fitted point, so that no stretch is divided.
    start = int(np.argmin(is_line))
    is_line, places = np.roll(is_line, -start), np.roll(points, -start)
    step = np.abs(np.roll(places, -1) - places)
    begin, stop = find_true_runs(is_line).T
    length = np.append(0.0, np.cumsum(step))
    return places[(begin + stop) // 2], length[stop] - length[begin]
