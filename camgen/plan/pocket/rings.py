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
from itertools import pairwise
from typing import Any

import numpy as np
import shapely
from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry.nesting import loop_areas
from camgen.geometry.segments import (
    IntArray,
    Segments,
    backwards,
    concatenate,
    flatten,
    from_contours,
    neighbours,
)
from camgen.plan.beside import Beside, beside
from camgen.plan.pocket.chains import cut_out, sample_chain

#: Rings are flattened to this, mm, where it is looked at what lies in what, and at what stays uncut.
CHORD = 0.002
#: What is nowhere wider than twice this, mm, need not be cut.
_THIN = 0.002
#: The least number of corners of a polygon.
LEAST_CORNERS = 3
#: A quarter of a circle has so many chords where discs are swept: they are within a ten-thousandth of a radius.
QUARTER = 48
#: Where the numbers are against a pass, it is tried so many steps farther out.
_NUDGES = (0.0, -0.003, -0.007, -0.02)
#: Distances, mm, by which a pass along the walls may be farther from them: less than a proof sees.
_WALL_NUDGES_MM = (0.0, 1e-3, 2e-3, 4e-3)
#: Places beside which a stretch is looked for lie so far apart, as a share of the tool's radius.
_EVERY = 0.1


class Ground(Struct, frozen=True, eq=False):
    """The walls of pockets, the material on their left. following: (N,) the next segment of each. group: (N,) the
    pocket that a segment is of. count: of pockets. distance: mm, of these walls from those of the pockets.
    """

    walls: Segments
    following: IntArray
    group: IntArray
    count: int
    distance: float = 0.0


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


class _Level(Struct, frozen=True, eq=False):
    """The pieces at one distance, their borders as the ground for the next ones, and the pockets that have none for a
    fault of the numbers.
    """

    pieces: list[Piece]
    ground: Ground
    bad: frozenset[int]


def peel(ground: Ground, first: float, step: float, radius: float, climb: bool) -> Peeled:
    """The pieces of all pockets: passes at ``first``, ``first + step``, ... mm from the walls, and what they need more.

    climb: material on the right of the travel, else on the left. Each pass is the exact offset of the one before: what
    is nowhere nearer than one step to it is nowhere nearer to the walls than that.
    """
    level = _level(ground, first, climb)
    failed = level.bad
    pieces: list[Piece] = []
    before = _append(pieces, level.pieces, [])
    while level.pieces:
        inner = _level(level.ground, step, climb, ground)
        failed |= inner.bad
        if step > radius:
            between, spoiled = _between(level.ground, inner.pieces, step, radius, climb, ground)
            failed |= spoiled
            before += _append(pieces, between, before)
        before = _append(pieces, inner.pieces, before)
        level = inner
    return Peeled(tuple(pieces), failed)


def along_walls(ground: Ground, distance: float, climb: bool) -> Peeled:
    """One pass at ``distance`` mm from the walls of all pockets."""
    level = _level(ground, distance, climb)
    return Peeled(tuple(level.pieces), level.bad)


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
    gaps = shapely.distance(
        piece.area.representative_point(), np.array([c.area for c in candidates])
    )
    distance = np.array([c.distance for c in candidates])
    # The innermost of those around it.
    near = np.flatnonzero(gaps <= gaps.min() + CHORD)
    return int(near[np.argmax(distance[near])])


def _level(ground: Ground, by: float, climb: bool, walls: Ground | None = None) -> _Level:
    """The pieces at ``by`` mm from ``ground``.

    walls: those of the pockets. Where the numbers are against a pocket it is tried at a little more or less, and from
    these; without them at a little more only, which leaves the wall that much too thick.
    """
    if walls is None:
        tries = [(ground, by + nudge) for nudge in _WALL_NUDGES_MM]
    else:
        tries = [(ground, by * (1 + nudge)) for nudge in _NUDGES]
        tries += [(walls, ground.distance + by * (1 + nudge)) for nudge in _NUDGES]
    pockets = frozenset(np.unique(ground.group).tolist())
    done: list[_Level] = []
    for source, at in tries:
        if not pockets:
            break
        own = of_pockets(source, pockets)
        closed = np.ones(int(own.walls.owner.max(initial=-1)) + 1, dtype=bool)
        curve = beside(own.walls, own.following, closed, own.group, at, 0.0)
        done.append(_pieces(curve, own, at, climb))
        pockets = done[-1].bad
    pieces = [piece for level in done for piece in level.pieces]
    return _Level(pieces, _join([level.ground for level in done], ground.count), pockets)


def of_pockets(ground: Ground, pockets: frozenset[int]) -> Ground:
    """The borders of some pockets alone."""
    rows = np.flatnonzero(np.isin(ground.group, list(pockets)))
    new = np.full(len(ground.walls), -1)
    new[rows] = np.arange(len(rows))
    return Ground(
        ground.walls.take(rows),
        new[ground.following[rows]],
        ground.group[rows],
        ground.count,
        ground.distance,
    )


def region_of(ground: Ground, number: int) -> Any:
    """The area that the walls of a pocket enclose: clockwise loops less the others.

    The walls are in no order: a loop is led from segment to segment.
    """
    loops = of_pockets(ground, frozenset([number]))
    left = set(range(len(loops.walls)))
    sides: tuple[list[Any], list[Any]] = ([], [])
    while left:
        ring = [min(left)]
        while (following := int(loops.following[ring[-1]])) != ring[0]:
            ring.append(following)
        left -= set(ring)
        points, _ = flatten(loops.walls.take(np.array(ring)), CHORD)
        if len(points) >= LEAST_CORNERS:
            outline = shapely.LinearRing(points)
            area = shapely.make_valid(shapely.Polygon(outline))
            sides[int(outline.is_ccw)].append(area)
    return shapely.difference(shapely.union_all(sides[0]), shapely.union_all(sides[1]))


def _join(grounds: Sequence[Ground], count: int) -> Ground:
    """The borders of several, each of other pockets, as one."""
    if not grounds:
        return Ground(
            from_contours([]), np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), count
        )
    rows, owners = 0, 0
    following, owner = [], []
    for ground in grounds:
        following.append(ground.following + rows)
        owner.append(ground.walls.owner + owners)
        rows += len(ground.walls)
        owners += int(ground.walls.owner.max(initial=-1)) + 1
    walls = replace(concatenate([ground.walls for ground in grounds]), owner=np.concatenate(owner))
    group = np.concatenate([ground.group for ground in grounds])
    return Ground(walls, np.concatenate(following), group, count, grounds[0].distance)


def _lacks_border(curve: Beside, pocket: IntArray, number: int, ground: Ground, by: float) -> bool:
    """Whether the closed chains of a pocket are not all of its border at ``by`` mm from ``ground``.

    An open chain is either a border that the numbers did not close, or a stray piece of one of the
    curves that it is cut out of. The area decides.
    """
    chains = pocket == number
    if not curve.sound[chains & curve.closed].all():
        return True
    area = -loop_areas(curve.segments, len(chains))[chains & curve.closed].sum()
    inside = region_of(ground, number).buffer(-by, quad_segs=QUARTER)
    return bool(abs(area - inside.area) > 2 * CHORD * inside.length)


def _pieces(curve: Beside, ground: Ground, by: float, climb: bool) -> _Level:
    """The pieces that ``curve``, at ``by`` mm from ``ground``, encloses."""
    distance = ground.distance + by
    count = len(curve.closed)
    if not count:
        return _Level([], replace(of_pockets(ground, frozenset()), distance=distance), frozenset())
    first = np.searchsorted(curve.segments.owner, np.arange(count))
    pocket = ground.group[curve.source[first]]
    bad = np.unique(pocket[~(curve.sound & curve.closed)])
    bad = bad[[_lacks_border(curve, pocket, number, ground, by) for number in bad.tolist()]]
    points, owner = flatten(curve.segments, CHORD)
    sizes = np.bincount(owner, minlength=count)
    area = loop_areas(curve.segments, count)
    length = np.bincount(curve.segments.owner, curve.segments.length, count)
    # What is as thin as this need not be cut, and no polygon has fewer than three corners.
    worth = (
        curve.closed
        & (sizes >= LEAST_CORNERS)
        & (np.abs(area) > _THIN * length / 2)
        & ~np.isin(pocket, bad)
    )
    chains = _chains(backwards(curve.segments)[0] if climb else curve.segments, count)
    loops = np.split(points, np.cumsum(sizes)[:-1])
    pieces = []
    # With the material on the left the border around a piece runs clockwise, that around an island in it the other way.
    for number in np.unique(pocket[worth]).tolist():
        own = np.flatnonzero(worth & (pocket == number))
        for members in _share_out(own[area[own] < 0], own[area[own] > 0], loops):
            polygon = shapely.Polygon(loops[members[0]], [loops[k] for k in members[1:]])
            # Chords of two arcs that nearly touch may cross.
            if not polygon.is_valid:
                polygon = shapely.make_valid(polygon)
            pieces.append(Piece(number, distance, tuple(chains[k] for k in members), True, polygon))
    borders = curve.segments.take(worth[curve.segments.owner])
    inner = Ground(
        borders, neighbours(borders, curve.closed), pocket[borders.owner], ground.count, distance
    )
    return _Level(pieces, inner, frozenset(bad.tolist()))


def _chains(segments: Segments, count: int) -> list[Segments]:
    """The segments of each owner."""
    edges = np.searchsorted(segments.owner, np.arange(count + 1))
    return [segments.take(np.arange(a, b)) for a, b in pairwise(edges.tolist())]


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
    ground: Ground, inner: Sequence[Piece], step: float, radius: float, climb: bool, walls: Ground
) -> tuple[list[Piece], frozenset[int]]:
    """Passes for what stays between those whose borders are ``ground`` and the ``inner`` ones, one ``step`` on: the
    pieces one radius on, with what of them is needed.
    """
    level = _level(ground, radius, climb, walls)
    result = []
    for piece in level.pieces:
        within = [other.area for other in inner if other.pocket == piece.pocket]
        reach = shapely.union_all(within).intersection(piece.area) if within else shapely.Polygon()
        if reach.is_empty:
            result.append(piece)
            continue
        bare = piece.area.difference(reach.buffer(radius - _THIN, quad_segs=QUARTER)).buffer(-_THIN)
        if not bare.is_empty:
            chains = _stretches(piece.chains, bare, step - radius, radius)
            result.append(replace(piece, chains=chains, ring=False))
    return result, level.bad


def _stretches(
    chains: Sequence[Segments], bare: Any, reach: float, radius: float
) -> tuple[Segments, ...]:
    """The stretches of closed ``chains`` that come within ``reach`` mm of what is ``bare``."""
    result: list[Segments] = []
    for chain in chains:
        spacing = min(_EVERY * radius, float(chain.length.sum()) / 8)
        at, points = sample_chain(chain, spacing)
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
