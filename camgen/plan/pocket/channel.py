"""Channels: what the tool would cut with too much of its width is cleared first, in loops along a pocket's ridge.

A pass at one distance from the walls engages its share of the tool on a straight wall, more on inner curves, and nearly
all of it in corners, in necks and on the first way through a basin. All these lie on the ridge (where two walls are
equally near) or turn about places on it. So first discs are cleared one after the other along the ridge, each reaching
so little beyond the one before that the arc along its front engages no more than was asked; back it goes straight over
what is clear. A disc is no larger than the passes need: on a curve of its radius a pass engages no more than that any
more. At the walls it leaves as much as the pass along them may take.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry.segments import BoolArray, Segments, make
from camgen.model.pose import FloatArray
from camgen.plan.pocket.engagement_limit import EngagementLimit, compute_disc_radii
from camgen.plan.pocket.fronts import bare_spans, clear_spans, crossings, unrolled
from camgen.plan.pocket.medial_axis import MedialAxis

#: A disc smaller than this share of the tool's radius about a place gives no room for a loop.
LEAST = 0.05
#: The next disc reaches beyond the one before by this share of the tool's radius, or it is not needed.
_BEYOND = 0.02
#: Its centre lies no farther from that of the one before than this share of the smaller of both discs.
_APART = 1.4
#: Directions along the front of a disc in which it is looked at how much of the tool is engaged.
_FRONTS = 13
#: Places of the ridge that are looked at together.
_AHEAD = 48
#: So many places of a way are looked at, from its end on, for whether it was cleared from another side.
_LOOKS = 16
#: A stretch of a front in clear ground is left out from this length on, as a share of the tool's
#: radius.
_SKIPPED_SHARE = 1.0
#: Points that are nearer to each other are one, and a disc holds points so far within its rim, mm.
_SAME_MM = 1e-6
#: A half turn of a spiral goes so much farther out at least, as a share of the tool's radius.
_FIRST_TURN = 0.1


class Disc(Struct, frozen=True):
    """What the tool's centre may reach around a place. before: index of the disc from which this one was cut, -1."""

    x: float
    y: float
    room: float
    before: int


def _disc(point: FloatArray, room: float, before: int) -> Disc:
    return Disc(float(point[0]), float(point[1]), room, before)


class Channel(Struct, frozen=True, eq=False):
    """A way of the tool's centre that begins and ends in the middle of its first disc.

    discs: all its discs, each after the neighbour from which it was cut.
    radius: radius of the tool, mm.
    room: largest distance of the entry from the middle of the first disc, mm.
    rim: circle of the first disc, in the direction of travel.
    chain: the lines and arcs of the way.
    shares: (M,) engagements along its arcs.
    ways: (M,) lengths on which these last, mm.
    """

    discs: tuple[Disc, ...]
    radius: float
    room: float
    rim: Segments
    chain: Segments
    shares: FloatArray
    ways: FloatArray

    def holds(self, points: FloatArray) -> BoolArray:
        """(N,) which of the ``points`` (N, 2) lie in a disc: there the tool touches nothing."""
        table = _table(self.discs)
        _, held = shapely.STRtree(shapely.points(points)).query(
            shapely.points(table[:, :2]), predicate="dwithin", distance=table[:, 2] - _SAME_MM
        )
        return np.isin(np.arange(len(points)), held)

    def way(self, start: FloatArray, end: FloatArray) -> FloatArray:
        """(K, 2) corners of a way over cleared ground between two points (2,) that discs hold."""
        table = _table(self.discs)
        steps = np.stack([start, end])[:, None] - table[None, :, :2]
        margins = table[:, 2] - np.hypot(*np.moveaxis(steps, 2, 0))
        discs = [self.discs[k] for k in _linked(self.discs, *np.argmax(margins, axis=1).tolist())]
        table = np.vstack([[*start, 0.0], _table(discs), [*end, 0.0]])
        return np.asarray(table[_shortened(table, 0, len(table) - 1), :2])

    def area(self, more: float) -> Any:
        """All discs, larger by ``more`` mm, as one polygon."""
        places = shapely.points([(disc.x, disc.y) for disc in self.discs])
        return shapely.union_all(
            shapely.buffer(places, [disc.room + more for disc in self.discs], quad_segs=32)
        )


def channels(axis: MedialAxis, first: float, bound: EngagementLimit, begun: float) -> list[Channel]:
    """One for each connected part of a ridge.

    first: mm that the tool's centre keeps from the walls. begun: mm, the radius of the helix on which it goes down, 0
    for none.
    """
    room = compute_disc_radii(axis, axis.wall_distance - first, bound)
    fit = room >= LEAST * bound.tool_radius
    around: list[list[int]] = [[] for _ in room]
    for a, b in axis.links[fit[axis.links].all(axis=1)].tolist():
        around[a].append(b)
        around[b].append(a)
    inside = replace(axis, wall_distance=room)
    left = set(np.flatnonzero(fit).tolist())
    # Where there is most room first; that is in the middle of a basin.
    order = sorted(left, key=lambda k: (-float(axis.wall_distance[k]), k))
    found = []
    for root in order:
        if root in left:
            ways = _spread(axis.points, around, root)
            left -= set(ways)
            made = _cut(inside, root, _leaves(ways, root), ways, bound, begun)
            rim = _rim(made.discs[0], bound)
            found.append(
                Channel(
                    tuple(made.discs),
                    bound.tool_radius,
                    float(axis.wall_distance[root]) - first,
                    rim,
                    made.chain(),
                    *made.engaged(),
                )
            )
    return found


def _spread(points: FloatArray, around: Sequence[Sequence[int]], root: int) -> dict[int, int]:
    """The place before each one on the shortest way from ``root``, for all that it is linked with."""
    before: dict[int, int] = {}
    queue = [(0.0, root, -1)]
    while queue:
        gone, here, source = heapq.heappop(queue)
        if here in before:
            continue
        before[here] = source
        for there in around[here]:
            if there not in before:
                heapq.heappush(queue, (gone + math.dist(points[here], points[there]), there, here))
    return before


def _leaves(before: dict[int, int], root: int) -> list[int]:
    """The ends of the ways, depth first: ways that part late follow each other."""
    below: dict[int, list[int]] = {}
    for here, source in before.items():
        below.setdefault(source, []).append(here)
    ends, stack = [], [root]
    while stack:
        here = stack.pop()
        stack += below.get(here, [])
        if here not in below:
            ends.append(here)
    return ends


class _Made:
    """A channel that is being laid."""

    def __init__(self, bound: EngagementLimit, start: FloatArray) -> None:
        self.bound = bound
        self.discs: list[Disc] = []
        self.ends: list[FloatArray] = [start]
        self.bulges: list[float] = []
        self.shares: list[FloatArray] = []
        self.ways: list[FloatArray] = []

    def go(self, there: FloatArray, bulge: float = 0.0) -> None:
        """On to a point (2,)."""
        if math.dist(there, self.ends[-1]) > _SAME_MM:
            self.ends.append(there)
            self.bulges.append(bulge)

    def chain(self) -> Segments:
        """All of the way so far."""
        points = np.array(self.ends)
        return make(
            points[:-1],
            points[1:],
            np.array(self.bulges),
            np.zeros(len(points) - 1, dtype=np.int64),
        )

    def engaged(self) -> tuple[FloatArray, FloatArray]:
        """Shares of the diameter along the arcs, and how long they last, mm."""
        none = np.zeros(0)
        return np.concatenate([none, *self.shares]), np.concatenate([none, *self.ways])


def _cut(
    axis: MedialAxis,
    root: int,
    ends: Sequence[int],
    before: dict[int, int],
    bound: EngagementLimit,
    begun: float,
) -> _Made:
    points, room = axis.points, axis.wall_distance
    made = _Made(bound, points[root])
    made.discs.append(_disc(points[root], float(room[root]), -1))
    _grow(made, float(room[root]), min(begun, float(room[root])))
    # The disc from which each place of the ridge is gone on.
    at = {root: 0}
    here = 0
    for end in ends:
        way = [end]
        while way[-1] not in at:
            way.append(before[way[-1]])
        way.reverse()
        last = at[way[0]]
        way = way[1:]
        some = way[:: -max(len(way) // _LOOKS, 1)]
        if (
            way
            and not _covered(
                points[some], room[some], made.discs, _BEYOND * bound.tool_radius
            ).all()
        ):
            here = _back(made, here, last)
            here = _follow(made, way, points, room, here, at)
        at |= {place: at.get(place, last) for place in way}
    _back(made, here, 0)
    made.go(points[root])
    return made


def _rim(disc: Disc, bound: EngagementLimit) -> Segments:
    """All round a disc in two halves."""
    ends = np.array([[disc.x - disc.room, disc.y], [disc.x + disc.room, disc.y]])
    return make(
        ends, ends[::-1], np.full(2, 1.0 if bound.ccw else -1.0), np.zeros(2, dtype=np.int64)
    )


def _covered(
    points: FloatArray, room: FloatArray, discs: Sequence[Disc], slack: float
) -> np.ndarray:
    """Which discs about ``points`` lie in one that is clear already."""
    table = _table(discs)
    gap = np.hypot(*np.moveaxis(points[:, None] - table[None, :, :2], 2, 0))
    return np.asarray((gap + room[:, None] <= table[None, :, 2] + slack).any(axis=1))


def _grow(made: _Made, room: float, begun: float) -> None:
    """From the middle of the first disc on a spiral of half circles to its rim, and once round."""
    middle, bound = made.ends[0], made.bound
    r, rho, side = bound.tool_radius, begun, -1.0
    bulge = 1.0 if bound.ccw else -1.0
    if begun:
        made.go(middle + np.array([side * rho, 0.0]))
    while rho < room - 1e-9:
        # Twice the growth of a half turn is what a turn cuts: share(2 g) = limit on the radius rho + g.
        growth = bound.engagement * r * rho / (rho + (1 - bound.engagement) * r)
        opened = growth > _FIRST_TURN * r
        growth = min(max(growth, _FIRST_TURN * r), room - rho)
        rho, side = rho + growth, -side
        made.go(middle + np.array([side * rho, 0.0]), bulge)
        # The first turns open the place, as the way straight down did, and are not counted.
        if opened:
            made.shares.append(np.array([growth * (rho - growth + r) / (rho * r)]))
            made.ways.append(np.array([math.pi * rho]))
    for _ in range(2):
        side = -side
        made.go(middle + np.array([side * room, 0.0]), bulge)


def _follow(
    made: _Made,
    way: Sequence[int],
    points: FloatArray,
    room: FloatArray,
    here: int,
    at: dict[int, int],
) -> int:
    """Discs along a ``way`` of places from the disc ``here`` on; that of the last one."""
    place = 0
    while place < len(way):
        rows = np.array(way[place : place + _AHEAD])
        disc = made.discs[here]
        middle = np.array([disc.x, disc.y])
        apart = np.hypot(*(points[rows] - middle).T)
        new = apart + room[rows] > disc.room + _BEYOND * made.bound.tool_radius
        if not new.any():
            at |= dict.fromkeys(rows.tolist(), here)
            place += len(rows)
            continue
        share = _engaged(middle, disc.room, points[rows], room[rows], made.bound).max(axis=1)
        near = apart <= _APART * np.minimum(disc.room, np.maximum(room[rows], disc.room / 4))
        good = (share <= made.bound.engagement) & near
        first = int(np.argmax(new))
        # As far as all before it are good as well; where none is, the first one that is new, and that is told.
        stop = first + int(np.argmin(good[first:])) if not good[first:].all() else len(rows)
        chosen = max(stop - 1, first)
        at |= dict.fromkeys(rows[: chosen + 1].tolist(), here)
        _loop(made, here, points[rows[chosen]], float(room[rows[chosen]]))
        here = len(made.discs) - 1
        at[int(rows[chosen])] = here
        place += chosen + 1
    return here


def _engaged(
    middle: FloatArray, room: float, points: FloatArray, rooms: FloatArray, bound: EngagementLimit
) -> FloatArray:
    """(M, F) shares of the diameter along the fronts of discs about ``points``, when that about ``middle`` is clear.

    On the front the tool's centre is at u(phi) from the new middle. What of its rim is farther from the old middle
    than what is clear there spans the angles around the way out from it, by the law of cosines; of these count those
    ahead of the tool, by what they take of its width.
    """
    r, clear = bound.tool_radius, room + bound.tool_radius
    step = points - middle
    apart = np.hypot(*step.T)
    phi = _front(room, apart, rooms)[:, None] * np.linspace(-1, 1, _FRONTS)
    x, y = apart[:, None] + rooms[:, None] * np.cos(phi), rooms[:, None] * np.sin(phi)
    far = np.maximum(np.hypot(x, y), 1e-12)
    half = np.arccos(np.clip((clear**2 - far**2 - r**2) / (2 * far * r), -1, 1))
    lean = np.arctan2(y, x) - phi
    low, high = np.clip(lean - half, 0, np.pi), np.clip(lean + half, 0, np.pi)
    return np.asarray((np.cos(low) - np.cos(high)) / 2)


def _front(room: FloatArray | float, apart: FloatArray, rooms: FloatArray) -> FloatArray:
    """(M,) how far round from the way ahead, rad, the circles of two discs meet: there the tool is in the old one."""
    cosine = (room**2 - apart**2 - rooms**2) / (2 * np.maximum(apart, 1e-12) * rooms)
    return np.arccos(np.clip(cosine, -1, 1))


def _loop(made: _Made, here: int, point: FloatArray, room: float) -> None:
    """The front of a disc, from the one before it on, less its stretches in other discs."""
    disc, bound = made.discs[here], made.bound
    sense = 1.0 if bound.ccw else -1.0
    zero = math.atan2(disc.y - point[1], disc.x - point[0])

    def on_rim(angle: float) -> FloatArray:
        turned = zero + sense * angle
        return point + room * np.array([math.cos(turned), math.sin(turned)])

    spans = clear_spans(np.array([*point, room]), _table(made.discs), zero, sense)
    clear = unrolled(spans)
    reached = spans[here][1]
    made.go(on_rim(reached))
    length = 0.0
    for first, last in bare_spans(clear, reached, _SKIPPED_SHARE * bound.tool_radius / room):
        for angle in crossings(clear, reached, first):
            made.go(on_rim(angle))
        bulge = sense * math.tan((last - first) / 8)
        made.go(on_rim((first + last) / 2), bulge)
        made.go(on_rim(last), bulge)
        length += room * (last - first)
        reached = last
    made.discs.append(_disc(point, room, here))
    middle = np.array([disc.x, disc.y])
    shares = _engaged(middle, disc.room, point[None], np.array([room]), bound)[0]
    made.shares.append(shares)
    made.ways.append(np.full(len(shares), length / len(shares)))


def _table(discs: Sequence[Disc]) -> FloatArray:
    """Middles and radii (D, 3), mm."""
    return np.array([(disc.x, disc.y, disc.room) for disc in discs])


def _back(made: _Made, here: int, there: int) -> int:
    """From one disc to another one over what is clear; ``there``."""
    if here == there:
        return there
    discs = [made.discs[k] for k in _linked(made.discs, here, there)]
    table = _table(discs)
    # From the end of a front to the middle of its disc first: from there on the way is known to be clear.
    for k in _shortened(table, 0, len(table) - 1):
        made.go(table[k, :2])
    return there


def _linked(discs: Sequence[Disc], here: int, there: int) -> list[int]:
    """Indices of the discs from one to another one, each cut from its neighbour."""
    up, down = [here], [there]
    while up[-1] != down[-1]:
        longer = up if up[-1] > down[-1] else down
        longer.append(discs[longer[-1]].before)
    return [*up, *down[-2::-1]]


def _shortened(table: FloatArray, first: int, last: int) -> list[int]:
    """Rows of discs (K, 3) over whose middles one goes straight and never leaves all discs."""
    if last - first < 2:
        return [first, last] if last > first else [first]
    if _is_covered(table[first, :2], table[last, :2], table[first : last + 1]):
        return [first, last]
    middle = (first + last) // 2
    return _shortened(table, first, middle) + _shortened(table, middle, last)[1:]


def _is_covered(start: FloatArray, end: FloatArray, discs: FloatArray) -> bool:
    """Whether the line from ``start`` to ``end`` (2,) lies in the union of ``discs`` (K, 3)."""
    length = math.dist(start, end)
    direction = (end - start) / max(length, _SAME_MM)
    steps = discs[:, :2] - start
    along = steps @ direction
    square = discs[:, 2] ** 2 - (steps**2).sum(axis=1) + along**2
    half = np.sqrt(np.maximum(square, 0.0))
    chords = np.column_stack([along - half, along + half])[square >= 0]
    reached = 0.0
    for low, high in sorted(chords.tolist()):
        if low > reached + _SAME_MM:
            break
        reached = max(reached, high)
    return reached >= length - _SAME_MM
