"""The passes of pockets: rings at growing distances from the walls, exact, and which of them lie in which.

The tool's centre may be where the distance to the walls is at least that of the first pass. What lies at a distance of
at least d is a set of pieces, each with rings as its borders; the pieces of the next pass lie in those of this one, so
that all of them are a forest: its leaves are where the tool goes in.

With passes at most a radius apart nothing stays between them: from any point the way to its nearest wall meets the
next ring within that. With passes farther apart corners and ridges stay. They lie between the band of one pass and what
the next ones sweep, and the ring one radius beyond the pass is within reach of all of them: its stretches beside such a
place are passes of their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry.nesting import loop_areas
from camgen.geometry.ragged import begins
from camgen.geometry.segments import BoolArray, IntArray, Segments, backwards, flatten
from camgen.plan.beside import Beside, beside
from camgen.plan.pocket.chains import cut_out, places

#: Rings are flattened to this, mm, where it is looked at what lies in what, and at what stays uncut.
CHORD = 0.002
#: What is nowhere wider than twice this, mm, need not be cut.
_THIN = 0.002
#: A quarter of a circle has so many chords where discs are swept: they are within a ten-thousandth of a radius.
QUARTER = 48
#: Where the numbers are against a pass, it is tried so many steps farther in.
_NUDGES = (0.0, -0.003, -0.007, -0.02)
#: Places beside which a stretch is looked for lie so far apart, as a share of the tool's radius.
_EVERY = 0.1


class Ground(Struct, frozen=True, eq=False):
    """The walls of pockets, the material on their left. following: (N,) the next segment of each. group: (N,) the
    pocket that a segment is of. count: of pockets.
    """

    walls: Segments
    following: IntArray
    group: IntArray
    count: int


class Piece(Struct, frozen=True, eq=False):
    """One connected piece of what lies at ``distance`` mm or more from the walls of ``pocket``.

    chains: what is cut there, in the direction of travel: closed rings, or stretches of them. ring: whether they are
    its whole borders. area: the piece as a polygon. parent: index of the piece around it, -1 if none.
    """

    pocket: int
    distance: float
    chains: tuple[Segments, ...]
    ring: bool
    area: Any
    parent: int = -1


class Peeled(Struct, frozen=True, eq=False):
    """pieces: all of them, the outer ones first. failed: pockets whose passes did not keep their distance."""

    pieces: tuple[Piece, ...]
    failed: frozenset[int]


def peel(ground: Ground, first: float, step: float, radius: float, climb: bool) -> Peeled:
    """The pieces of all pockets: passes at ``first``, ``first + step``, ... mm from the walls, and what they need more.

    climb: material on the right of the travel, else on the left.
    """
    pieces: list[Piece] = []
    before: list[int] = []
    alive, failed = np.ones(ground.count, dtype=bool), set[int]()
    level = 0
    while alive.any():
        found, bad = _level(ground, alive, first + level * step, step if level else 0.0, climb)
        failed |= bad
        found = [piece for piece in found if piece.pocket not in failed]
        alive = np.zeros(ground.count, dtype=bool)
        alive[[piece.pocket for piece in found]] = True
        if step > radius and level:
            between, spoiled = _between(ground, [pieces[k] for k in before], found, step, radius, climb)
            failed |= spoiled
            before += _append(pieces, between, before)
        before = _append(pieces, found, before)
        level += 1
    return Peeled(tuple(pieces), frozenset(failed))


def along_walls(ground: Ground, distance: float, climb: bool) -> Peeled:
    """One pass at ``distance`` mm from the walls of all pockets."""
    pieces, failed = _level(ground, np.ones(ground.count, dtype=bool), distance, 0.0, climb)
    return Peeled(tuple(pieces), frozenset(failed))


def _append(pieces: list[Piece], found: Sequence[Piece], before: list[int]) -> list[int]:
    """Appends to ``pieces`` those ``found``, which lie in the ones ``before`` them; their indices."""
    around: dict[int, list[int]] = {}
    for k in before:
        around.setdefault(pieces[k].pocket, []).append(k)
    indices = []
    for piece in found:
        parent = _enclosing(piece, [pieces[k] for k in around.get(piece.pocket, [])])
        indices.append(len(pieces))
        pieces.append(replace(piece, parent=around[piece.pocket][parent] if parent >= 0 else -1))
    return indices


def _enclosing(piece: Piece, candidates: Sequence[Piece]) -> int:
    if len(candidates) < 2:
        return len(candidates) - 1
    gaps = shapely.distance(piece.area.representative_point(), np.array([c.area for c in candidates]))
    distance = np.array([c.distance for c in candidates])
    # The innermost of those around it.
    near = np.flatnonzero(gaps <= gaps.min() + CHORD)
    return int(near[np.argmax(distance[near])])


def _level(ground: Ground, alive: BoolArray, distance: float, step: float, climb: bool) -> tuple[list[Piece], set[int]]:
    """The pieces at ``distance`` of the pockets ``alive``, and the pockets that have none for a fault of the numbers.

    step: mm, 0: the distance must be met exactly.
    """
    rows = np.flatnonzero(alive[ground.group])
    new = np.full(len(ground.walls), -1)
    new[rows] = np.arange(len(rows))
    walls, group = ground.walls.take(rows), ground.group[rows]
    following = new[ground.following[rows]]
    best: tuple[list[Piece], set[int]] | None = None
    for nudge in _NUDGES if step else _NUDGES[:1]:
        closed = np.ones(int(walls.owner.max()) + 1, dtype=bool)
        at = distance + nudge * step
        curve = beside(walls, following, closed, group, at, 0.0)
        pieces, bad = _pieces(curve, group, at, climb)
        if best is None or len(bad) < len(best[1]):
            best = pieces, bad
        if not bad:
            break
    assert best is not None
    return best


def _pieces(curve: Beside, group: IntArray, distance: float, climb: bool) -> tuple[list[Piece], set[int]]:
    count = len(curve.closed)
    if not count:
        return [], set()
    first = np.searchsorted(curve.segments.owner, np.arange(count))
    pocket = group[curve.source[first]]
    bad = set(pocket[~(curve.sound & curve.closed)].tolist())
    points, owner = flatten(curve.segments, CHORD)
    sizes = np.bincount(owner, minlength=count)
    area = loop_areas(curve.segments, count)
    length = np.bincount(curve.segments.owner, curve.segments.length, count)
    # What is as thin as this need not be cut, and no polygon has fewer than three corners.
    worth = (sizes >= 3) & (np.abs(area) > _THIN * length / 2)
    travel = backwards(curve.segments)[0] if climb else curve.segments
    long = np.bincount(travel.owner, minlength=count)
    edge, low = begins(long), begins(sizes)
    chains = [travel.take(np.arange(a, a + n)) for a, n in zip(edge, long, strict=True)]
    loops = [points[a : a + n] for a, n in zip(low, sizes, strict=True)]
    pieces = []
    # With the material on the left the border around a piece runs clockwise, that around an island in it the other way.
    for number in np.unique(pocket[worth]).tolist():
        own = np.flatnonzero(worth & (pocket == number))
        if number not in bad:
            for members in _share_out(own[area[own] < 0], own[area[own] > 0], loops):
                polygon = shapely.Polygon(loops[members[0]], [loops[k] for k in members[1:]])
                pieces.append(Piece(number, distance, tuple(chains[k] for k in members), True, polygon))
    return pieces, bad


def _share_out(outer: IntArray, holes: IntArray, loops: Sequence[Any]) -> list[list[int]]:
    """Each of the ``outer`` loops with the holes in it."""
    members = {k: [k] for k in outer.tolist()}
    if len(outer) == 1:
        members[int(outer[0])] += holes.tolist()
    elif len(outer) and len(holes):
        around = [shapely.Polygon(loops[k]) for k in outer]
        size = shapely.area(around)
        for hole in holes.tolist():
            gap = shapely.distance(shapely.Point(loops[hole][0]), around)
            near = np.flatnonzero(gap <= CHORD)
            if len(near):
                members[int(outer[near[np.argmin(size[near])]])].append(hole)
    return list(members.values())


def _between(
    ground: Ground, outer: Sequence[Piece], inner: Sequence[Piece], step: float, radius: float, climb: bool
) -> tuple[list[Piece], set[int]]:
    """Passes for what stays between two: pieces one radius beyond the ``outer`` ones, with what of them is needed."""
    rings = [piece for piece in outer if piece.ring]
    if not rings:
        return [], set()
    alive = np.zeros(ground.count, dtype=bool)
    alive[[piece.pocket for piece in rings]] = True
    distance = min(piece.distance for piece in rings) + radius
    found, failed = _level(ground, alive, distance, step - radius, climb)
    result = []
    for piece in found:
        within = [other.area for other in inner if other.pocket == piece.pocket]
        reach = shapely.union_all(within).intersection(piece.area) if within else shapely.Polygon()
        if reach.is_empty:
            result.append(piece)
            continue
        bare = piece.area.difference(reach.buffer(radius - _THIN, quad_segs=QUARTER)).buffer(-_THIN)
        if not bare.is_empty:
            chains = _stretches(piece.chains, bare, step - radius, radius)
            result.append(replace(piece, chains=chains, ring=False))
    return result, failed


def _stretches(chains: Sequence[Segments], bare: Any, reach: float, radius: float) -> tuple[Segments, ...]:
    """The stretches of closed ``chains`` that come within ``reach`` mm of what is ``bare``."""
    result: list[Segments] = []
    for chain in chains:
        spacing = min(_EVERY * radius, float(chain.length.sum()) / 8)
        at, points = places(chain, spacing)
        # The last place is the first again.
        near = shapely.dwithin(shapely.points(points), bare, reach + spacing + 2 * _THIN)[:-1]
        if near.all():
            result.append(chain)
        elif near.any():
            begin = np.flatnonzero(near & ~np.roll(near, 1))
            end = np.flatnonzero(near & ~np.roll(near, -1))
            if end[0] < begin[0]:
                end = np.roll(end, -1)
            total, count = at[-1], len(near)
            for a, b in zip(begin.tolist(), end.tolist(), strict=True):
                low, high = at[(a - 1) % count], at[(b + 1) % count]
                result.append(cut_out(chain, low, high if high > low else high + total))
    return tuple(result)
