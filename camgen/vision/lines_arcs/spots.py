"""What of an outline is kept as lines: the pieces of a chain that do not follow their points, or that cross another.

Only the spot is: the rest of the outline stays fitted. All in pixels, so that the scale of a picture decides nothing.
"""

from __future__ import annotations

import numpy as np
import shapely
from msgspec import Struct

from camgen.geometry.ragged import owners, ramp
from camgen.geometry.rings import ComplexArray
from camgen.geometry.thinning import Polylines, thin
from camgen.model.part import IntArray
from camgen.model.pose import FloatArray
from camgen.vision.lines_arcs.fit import BoolArray
from camgen.vision.lines_arcs.polish import Fillets, FittedChain, along, repair, roundings

#: How a piece is drawn: as it was fitted, as lines thinned out within the noise, as lines from point to point.
FITTED, THINNED, POINTS = 0, 1, 2
#: Arcs are flattened to this (px) to see whether a contour crosses itself.
_CHORD = 0.02
#: No point is farther from the ring than this, px, and the noise.
_LEFT = 1.0
#: Looks at what crosses, until all is drawn from point to point: a spot grows by its neighbours each time.
_LOOKS = 12
#: What is cut off an outline that crosses itself, of its area, at most.
_MOST_CUT = 0.02


class Ring(Struct, frozen=True, eq=False):
    """A closed ring. corners (M,) px; bulges (M,) of the segments that leave them; piece (M,): what they belong to."""

    corners: ComplexArray
    bulges: FloatArray
    piece: IntArray


class Sound(Struct, frozen=True, eq=False):
    """A ring that does not cross itself. drawn (K,): how each piece is. cut: px2 of small loops that were cut off."""

    ring: Ring
    drawn: IntArray
    cut: float = 0.0


def make_sound(
    chain: FittedChain,
    fillets: Fillets,
    bad: BoolArray,
    points: ComplexArray,
    piece: IntArray,
    off: float,
) -> Sound | None:
    """``chain`` as a ring that does not cross itself, ``bad`` (K,) pieces as lines within ``off`` px of their points.

    So are pieces that pass points of theirs by, a spike of a pixel or two. Pieces that cross are drawn as lines too,
    then from point to point, then so are their neighbours; where the points themselves cross, in a slit of a pixel,
    the small loop is cut off. None where too much would be.
    """
    drawn = np.where(bad, THINNED, FITTED)
    farthest = _LEFT + off + roundings(chain, fillets, points, piece)
    for _ in range(_LOOKS):
        ring = halve(_lay(chain, fillets, drawn, points, piece, off))
        pairs = _crossings(ring)
        if not len(pairs):
            left = np.unique(piece[_far(ring, points) > farthest])
            left = left[drawn[left] == FITTED]
            if not len(left):
                return Sound(ring, drawn)
            drawn = drawn.copy()
            drawn[left] = THINNED
            continue
        crossing = np.unique(ring.piece[pairs])
        raised = np.minimum(drawn[crossing] + 1, POINTS)
        if (drawn[crossing] == POINTS).all():
            sound = _cut(ring, drawn)
            if sound is not None:
                return sound
            crossing = np.unique(
                np.concatenate([crossing - 1, crossing, crossing + 1]) % len(drawn)
            )
            raised = np.minimum(drawn[crossing] + 1, POINTS)
        drawn = drawn.copy()
        drawn[crossing] = raised
    drawn = np.full(len(drawn), POINTS)
    return _cut(halve(_lay(chain, fillets, drawn, points, piece, off)), drawn)


def _lay(
    chain: FittedChain,
    fillets: Fillets,
    drawn: IntArray,
    points: ComplexArray,
    piece: IntArray,
    off: float,
) -> Ring:
    bad = drawn != FITTED
    kept = np.ones(len(points), dtype=np.bool_)
    if (drawn == THINNED).any():
        kept = _few(points, drawn[piece] == THINNED, off)
    return Ring(*repair(chain, fillets, bad, points[kept], piece[kept]))


def _few(points: ComplexArray, thinned: BoolArray, off: float) -> BoolArray:
    """(N,) which points are kept: of stretches of ``thinned`` (N,) ones those that lines within ``off`` px need."""
    ends = thinned & ~(np.roll(thinned, 1) & np.roll(thinned, -1))
    fixed = ~thinned | ends
    fixed[[0, -1]] = True
    rows = np.flatnonzero(fixed)
    plane = np.column_stack([points.real, points.imag])
    kept = np.zeros(len(points), dtype=np.bool_)
    kept[thin(Polylines(plane, np.zeros(len(points)), np.array([0, len(points)]), rows), off)] = (
        True
    )
    return kept


def halve(ring: Ring) -> Ring:
    """Arcs of more than half a circle as two."""
    none = np.zeros(len(ring.corners), dtype=np.bool_)
    middle = along(FittedChain(ring.corners, ring.bulges, none, none), 0.5)
    large = np.flatnonzero(np.abs(ring.bulges) > 1)
    half = np.where(np.abs(ring.bulges) > 1, np.tan(np.arctan(ring.bulges) / 2), ring.bulges)
    corners = np.insert(ring.corners, large + 1, middle[large])
    return Ring(
        corners,
        np.insert(half, large + 1, half[large]),
        np.insert(ring.piece, large + 1, ring.piece[large]),
    )


def _crossings(ring: Ring) -> IntArray:
    """Pairs (P, 2) of segments of ``ring`` that meet elsewhere than where one ends and the next begins; i < j."""
    plane, owner = _flat(ring)
    if len(plane) > 2 and shapely.is_valid(shapely.Polygon(plane)):
        return np.zeros((0, 2), dtype=np.int64)
    short = shapely.linestrings(np.stack([plane, np.roll(plane, -1, axis=0)], axis=1))
    a, b = shapely.STRtree(short).query(short, predicate="intersects")
    apart = (b - a) % len(short)
    far = (a < b) & (apart > 1) & (apart < len(short) - 1)
    pairs = np.column_stack([owner[a[far]], owner[b[far]]])
    if not len(pairs):
        # It runs back on itself from one segment to the next.
        ways = np.roll(plane, -1, axis=0) - plane
        turn = np.einsum("nd,nd->n", ways, np.roll(ways, -1, axis=0))
        back = int(np.argmin(turn))
        pairs = np.array([[owner[back], owner[(back + 1) % len(owner)]]])
    return np.unique(np.sort(pairs, axis=1), axis=0)


def _flat(ring: Ring) -> tuple[FloatArray, IntArray]:
    """The ring as points (L, 2) px of lines, and the segment (L,) that each line belongs to."""
    sweep = 4 * np.arctan(np.abs(ring.bulges))
    chord = np.abs(np.roll(ring.corners, -1) - ring.corners)
    radius = chord / (2 * np.maximum(np.sin(sweep / 2), 1e-9))
    # An arc of angle a leaves its chord by r (1 - cos(a / 2)), about r a^2 / 8.
    count = np.maximum(np.ceil(sweep / np.sqrt(8 * _CHORD / np.maximum(radius, _CHORD))), 1).astype(
        np.int64
    )
    owner, share = owners(count), ramp(count) / np.repeat(count, count)
    none = np.zeros(len(owner), dtype=np.bool_)
    places = _places(FittedChain(ring.corners, ring.bulges, none, none), owner, share)
    return np.column_stack([places.real, places.imag]), owner


def _far(ring: Ring, points: ComplexArray) -> FloatArray:
    """Distances (N,) px of ``points`` from the ring."""
    plane, _ = _flat(ring)
    line = shapely.linestrings(np.append(plane, plane[:1], axis=0))
    shapely.prepare(line)
    found: FloatArray = shapely.distance(shapely.points(points.real, points.imag), line)
    return found


def _places(chain: FittedChain, owner: IntArray, share: FloatArray) -> ComplexArray:
    """The place at ``share`` (N,) of the piece ``owner`` (N,) each."""
    a, b, sweep = (
        c[owner] for c in (chain.corners, np.roll(chain.corners, -1), 4 * np.arctan(chain.bulges))
    )
    arc = np.abs(sweep) > 1e-6
    safe = np.where(arc, sweep, 1.0)
    part = np.where(arc, np.expm1(1j * safe * share) / np.expm1(1j * safe), share)
    return np.asarray(a + (b - a) * part)


def _cut(ring: Ring, drawn: IntArray) -> Sound | None:
    """``ring`` without the small loops in which lines from point to point cross; None if it is more than that."""
    whole, cut = abs(_area(ring.corners)), 0.0
    while True:
        pairs = _crossings(ring)
        if not len(pairs):
            return Sound(ring, drawn, cut)
        count = len(ring.corners)
        inner = pairs[:, 1] - pairs[:, 0]
        swapped = inner > count / 2
        first = np.where(swapped, pairs[:, 1], pairs[:, 0])
        size = np.where(swapped, count - inner, inner)
        k = int(np.argmin(size))
        loop = (first[k] + 1 + np.arange(size[k])) % count
        if count - len(loop) < 3 or (drawn[ring.piece[np.append(loop, first[k])]] != POINTS).any():
            return None
        cut += abs(_area(ring.corners[loop]))
        if cut > _MOST_CUT * whole:
            return None
        keep = np.ones(count, dtype=np.bool_)
        keep[loop] = False
        ring = Ring(ring.corners[keep], ring.bulges[keep], ring.piece[keep])


def _area(corners: ComplexArray) -> float:
    return float((corners.conj() * np.roll(corners, -1)).imag.sum() / 2)


def stretches_of(
    drawn: IntArray, points: ComplexArray, piece: IntArray
) -> tuple[ComplexArray, FloatArray]:
    """The middles (S,) and the lengths (S,) px of the stretches that are drawn as lines."""
    lines = (drawn != FITTED)[piece]
    if not lines.any():
        return np.zeros(0, dtype=complex), np.zeros(0)
    # From where an outline is fitted, so that no stretch is divided.
    turn = 0 if lines.all() else int(np.argmin(lines))
    lines, places = np.roll(lines, -turn), np.roll(points, -turn)
    step = np.abs(np.roll(places, -1) - places)
    begin = np.flatnonzero(lines & ~np.append(False, lines[:-1]))
    stop = np.flatnonzero(lines & ~np.append(lines[1:], False)) + 1
    way = np.append(0.0, np.cumsum(step))
    return places[(begin + stop) // 2], way[stop] - way[begin]
