"""The passes of pockets one after the other: from the middle outwards, linked at depth where the tool stays inside.

A channel comes first. A piece is cut after all that lies in it. What was cut last in it leads on to its rings: over a
straight link on which the tool keeps the distance of the pass from the walls, or first along the ring that was cut last
to where there is such a link. Where there is none the tool is lifted, and goes on in a path of its own. Where
engagement is bounded, links lead over what is clear already, or lean on the next ring so little that they engage no
more than is allowed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import shapely
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import NDArray

from camgen.geometry.arcs import bulges
from camgen.geometry.intersect import gaps
from camgen.geometry.ragged import owners, ramp
from camgen.geometry.segments import IntArray, Segments, make, points_at, tangents_at
from camgen.model.pose import FloatArray
from camgen.plan.pocket.chains import (
    cut_out,
    find_nearest,
    join_chains,
    locate,
    make_lines,
    make_polyline,
    sample_chain,
    start_at,
    tangents_along,
)
from camgen.plan.pocket.channel import Channel
from camgen.plan.pocket.engagement_limit import EngagementLimit
from camgen.plan.pocket.regions import OffsetRegion

#: A link may come nearer to the walls than the outermost pass by this, mm.
_SLACK = 1e-4
#: Or than an inner pass by so many steps.
_INNER_SLACK = 0.05
#: A link from one ring to the next goes so many steps ahead, the farthest first: a slanting one cuts little more than
#: the ring itself.
_AHEAD = (3.0, 2.0, 1.0, 0.5, 0.0)
#: Places along a ring at which a link is tried.
_TRIES = 48
#: A link leads through so many steps of material that is not cut yet at most.
_UNCUT = 4.0
#: A link through so little, mm, leads over what is clear: that is polygons.
_CLEAR = 0.005
#: Distance of places of a ring that a channel may have cleared, as a share of the tool's radius.
_BESIDE = 0.2
#: Places on a link lie so far apart, as a share of the distance of the outermost passes from the walls.
_EVERY = 0.1
#: And there are so many at most.
_MOST_PLACES = 64
#: A link that leans so little that it engages no more than is allowed may be longer by these factors.
_LEANS = (2.0, 1.4, 1.0)
#: Links that are looked at together.
_AT_ONCE = 16
#: Digits of a size in mm or mm2. Sizes that agree in them are equal, and their order in the array
#: decides, not the last bit of a sine, which differs between processors.
_EQUAL_DIGITS = 6
#: A piece with no more room than this, mm, is entered on its ring.
_NO_ROOM = 0.01


class Walk(Struct, frozen=True, eq=False):
    """Passes that are run without a lift. chain: all of them with their links. rings: how many passes. room: mm, what
    the tool's centre may leave its first point by without coming nearer to the walls than the outermost pass does.
    before: index of the walk that is run after this one, -1 if none has to. loops: how many segments at its start are a
    channel. steep: how many links may engage more than a pass does.
    """

    pocket: int
    chain: Segments
    rings: int
    room: float
    before: int
    loops: int = 0
    steep: int = 0
    #: (N,) segments that are hops; empty for none.
    travels: NDArray[np.bool_] = np.zeros(0, dtype=np.bool_)


class _Room(Struct, frozen=True, eq=False):
    """Where links may go: no nearer to ``walls`` than ``clear`` mm, and ``most`` mm at most outside of what is ``cut``
    already, where the tool would cut a slot. lean: mm along a ring for a link that engages no more than is allowed, and
    turn: rad, by which it leans; 0: not bounded.

    channels: channels that are cut before.
    """

    walls: Segments
    clear: float
    cut: tuple[Any, ...]
    most: float
    lean: float
    turn: float
    channels: Sequence[Channel]


class _Open:
    """A walk that is not ended yet. last: the closed ring that was run last, if one was. loops: segments of a channel.
    steep: links that may engage more than a pass.
    """

    def __init__(self, pocket: int, room: float) -> None:
        self.pocket = pocket
        self.room = room
        self.parts: list[Segments] = []
        self.rings = 0
        self.loops = 0
        self.steep = 0
        self.last: Segments | None = None
        self.before: _Open | None = None

    @property
    def end(self) -> FloatArray:
        """Where the tool is, (2,)."""
        return np.asarray(self.parts[-1].end[-1])

    def add(self, chain: Segments, ring: bool) -> None:
        """Run ``chain``, a closed ring or not."""
        self.parts.append(chain)
        self.rings += 1
        self.last = chain if ring else self.last


def lay(
    pieces: Sequence[OffsetRegion],
    walls: Sequence[Segments],
    first: float,
    step: float,
    channels: Sequence[Sequence[Channel]],
    bound: EngagementLimit | None,
) -> list[Walk]:
    """The walks over all ``pieces``, what must be run first before the rest.

    walls: of each pocket. first: mm, the distance of the outermost passes. step: mm from pass to pass. channels: of
    each piece, those in the outermost ones that are run before all else in them. bound: of engagement, if there is one.
    """
    inside: list[list[int]] = [[] for _ in pieces]
    for k, piece in enumerate(pieces):
        if piece.parent >= 0:
            inside[piece.parent].append(k)
    clear = [tuple(channel.make_polygon(_CLEAR) for channel in own) for own in channels]
    outermost = outermost_of(pieces)
    done: dict[int, _Open] = {}
    ended: list[_Open] = []
    # The walk that begins with a channel runs over what that has cleared to all pieces around it.
    begun: dict[int, _Open] = {}
    for root in sorted(set(outermost)):
        opened = [_open(pieces[root], channel) for channel in channels[root]]
        if opened:
            begun[root] = opened[0]
        ended += opened[1:]
    turn = 0.0 if bound is None else bound.max_turn
    lean = step / math.tan(turn) if turn else 0.0
    for k in _inside_first(inside, [k for k, piece in enumerate(pieces) if piece.parent < 0]):
        piece, root = pieces[k], outermost[k]
        # The largest one leads on.
        areas = np.array([pieces[j].polygon.area for j in inside[k]])
        within = [inside[k][row] for row in _smallest_first(areas).tolist()]
        walk, others = begun.get(root), list[_Open]()
        if root not in begun and within:
            *others, walk = (done.pop(j) for j in within)
        mine: list[_Open] = []
        least = max(first, piece.distance - _INNER_SLACK * step) - _SLACK
        cut = (*clear[root], *(pieces[j].polygon for j in within))
        shapely.prepare(cut)
        room = _Room(walls[piece.pocket], least, cut, _UNCUT * step, lean, turn, channels[root])
        last = _cut(piece, walk, room, first, step, mine)
        for other in others:
            other.before = last
        for earlier, later in pairwise([*mine, last]):
            earlier.before = later
        ended += (*others, *mine)
        if root in begun:
            begun[root] = last
        else:
            done[k] = last
    ended += (*begun.values(), *done.values())
    _put_channels_first(ended)
    index = {id(walk): k for k, walk in enumerate(ended)}
    return [
        Walk(
            walk.pocket,
            join_chains(walk.parts),
            walk.rings,
            walk.room,
            index[id(walk.before)] if walk.before is not None else -1,
            walk.loops,
            walk.steep,
        )
        for walk in ended
    ]


def _inside_first(inside: Sequence[Sequence[int]], roots: Sequence[int]) -> list[int]:
    """All pieces, each after those in it, which follow each other."""
    order, stack = [], list(roots)
    while stack:
        order.append(stack.pop())
        stack += inside[order[-1]]
    return order[::-1]


def outermost_of(pieces: Sequence[OffsetRegion]) -> list[int]:
    """Of each piece the one around all that are around it, or itself."""
    roots: list[int] = []
    for k, piece in enumerate(pieces):
        roots.append(roots[piece.parent] if piece.parent >= 0 else k)
    return roots


def _open(piece: OffsetRegion, channel: Channel) -> _Open:
    """A walk that begins with a channel."""
    walk = _Open(piece.pocket, channel.entry_radius)
    walk.parts.append(channel.chain)
    walk.loops = len(channel.chain)
    walk.last = channel.rim
    return walk


def _put_channels_first(walks: list[_Open]) -> None:
    """Where channels are walks of their own, all in their pocket are run one after the other, they at first."""
    for pocket in {walk.pocket for walk in walks if not walk.rings}:
        own = [walk for walk in walks if walk.pocket == pocket]
        own.sort(key=lambda walk: walk.rings > 0)
        for walk, after in pairwise(own):
            walk.before = after
        own[-1].before = None


def _cut(
    piece: OffsetRegion,
    walk: _Open | None,
    room: _Room,
    first: float,
    step: float,
    ended: list[_Open],
) -> _Open:
    """The walk after the chains of ``piece``; those that were left for another one are appended to ``ended``."""
    left = list(piece.passes)
    while left:
        if walk is None:
            walk = _enter(piece, left, first)
            continue
        gaps_to_chains = np.array([find_nearest(chain, walk.end)[1] for chain in left])
        for k in _smallest_first(gaps_to_chains).tolist():
            if _reach(walk, left[k], room, step):
                left.pop(k)
                break
        else:
            ended.append(walk)
            walk = None
    assert walk is not None
    return walk


def _enter(piece: OffsetRegion, left: list[Segments], first: float) -> _Open:
    """A walk that begins in ``piece``, in its middle if it is whole; the chain that it runs first is taken off
    ``left``.
    """
    if piece.is_whole and len(left) == len(piece.passes):
        # A symmetric area has several such circles, and the last bit of a corner would choose one.
        area = shapely.transform(piece.polygon, lambda points: np.round(points, _EQUAL_DIGITS))
        middle, edge = shapely.get_coordinates(shapely.maximum_inscribed_circle(area, 0.01))
        room = float(np.hypot(*(edge - middle)))
        if room > _NO_ROOM:
            at = [find_nearest(chain, middle) for chain in left]
            k = int(_smallest_first(np.array([gap for _, gap in at]))[0])
            walk = _Open(piece.pocket, piece.distance - first + room)
            ring = start_at(left.pop(k), at[k][0])
            walk.parts.append(make_lines(middle, ring.start[:1]))
            walk.add(ring, True)
            return walk
    walk = _Open(piece.pocket, piece.distance - first)
    lengths = np.array([chain.length.sum() for chain in left])
    walk.add(left.pop(int(_smallest_first(-lengths)[0])), piece.is_whole)
    return walk


def _reach(walk: _Open, chain: Segments, room: _Room, step: float) -> bool:
    """Whether ``chain`` could be added to ``walk``, which then is done."""
    if not _is_closed(chain):
        return _reach_start(walk, chain, room)
    total = float(chain.length.sum())
    foot = find_nearest(chain, walk.end)[0]
    linked = _reach_over(walk, chain, room)
    if linked is None and room.lean:
        linked = _reach_gently(walk, chain, foot, room)
    if linked is not None:
        link, at = linked
        walk.parts.append(link)
        walk.add(start_at(chain, at), True)
        return True
    ahead = np.array([(foot + k * min(step, total / 12)) % total for k in _AHEAD])
    good = ahead[_first_free(make_lines(walk.end, locate(chain, ahead)), room)]
    if not len(good):
        around = sample_chain(chain, total / _TRIES)[0][:-1]
        ends = locate(chain, around)
        links = make_lines(walk.end, ends)
        order = _smallest_first(links.length)
        good = around[order[_first_free(links.take(order), room)]]
        if not len(good):
            good = around[_go_round(walk, ends, room)]
    if not len(good):
        return False
    walk.steep += 1
    walk.add(start_at(chain, float(good[0])), True)
    return True


def _reach_start(walk: _Open, chain: Segments, room: _Room) -> bool:
    """Whether an open ``chain`` could be added to ``walk``, which then is done."""
    start = chain.start[:1]
    is_clear = room.lean > 0 and _is_linked(walk, start, replace(room, most=_CLEAR))
    over = None if is_clear else _go_over(walk, start, room)
    if over is not None:
        walk.parts.append(over[0])
        is_clear = True
    elif not (is_clear or _is_linked(walk, start, room) or len(_go_round(walk, start, room))):
        return False
    walk.steep += not is_clear
    walk.add(chain, False)
    return True


def _reach_over(walk: _Open, chain: Segments, room: _Room) -> tuple[Segments, float] | None:
    """A way over channels to a closed ``chain``, and where it ends, mm from its start."""
    if not room.channels:
        return None
    lengths, points = sample_chain(chain, _BESIDE * room.channels[0].tool_radius)
    over = _go_over(walk, points, room)
    return None if over is None else (over[0], float(lengths[over[1]]))


def _go_over(walk: _Open, ends: FloatArray, room: _Room) -> tuple[Segments, int] | None:
    """A way over the ground of a channel to one of ``ends`` (M, 2), and the row of that end.

    None if the tool or the ends are beside all channels, with material between.
    """
    for channel in room.channels:
        begin = _step_on(walk.end, channel, room)
        if begin is None:
            continue
        held = np.flatnonzero(channel.contains(ends))
        rows = held if len(held) else np.arange(len(ends))
        row = int(rows[_smallest_first(np.hypot(*(ends[rows] - walk.end).T))[0]])
        end = _step_on(ends[row], channel, room)
        if end is not None:
            corners = np.vstack([walk.end, channel.find_link(begin, end), ends[row]])
            return make_polyline(corners), row
    return None


def _step_on(point: FloatArray, channel: Channel, room: _Room) -> FloatArray | None:
    """The ``point`` (2,) if a disc of a channel holds it, or the middle of a disc near to it."""
    if channel.contains(point[None])[0]:
        return point
    middles = np.array([(disc.x, disc.y) for disc in channel.discs])
    links = make_lines(point, middles)
    links = links.take(_smallest_first(links.length)[:_AT_ONCE])
    rows = _first_free(links, replace(room, most=_CLEAR))
    return np.asarray(links.end[rows[0]]) if len(rows) else None


def _reach_gently(
    walk: _Open, chain: Segments, foot: float, room: _Room
) -> tuple[Segments, float] | None:
    """A link to a closed ``chain`` that engages no more than is allowed, and where it ends, mm from its start."""
    total = float(chain.length.sum())
    near = foot + room.lean * np.linspace(-1, 1, _TRIES)
    around = np.concatenate([near % total, sample_chain(chain, total / _TRIES)[0][:-1]])
    links = make_lines(walk.end, locate(chain, around))
    order = _smallest_first(links.length)
    good = order[_first_free(links.take(order), replace(room, most=_CLEAR))]
    if len(good):
        return links.take(good), float(around[good[0]])
    return _lean_on(walk, chain, room)


def _lean_on(walk: _Open, chain: Segments, room: _Room) -> tuple[Segments, float] | None:
    """A link from the ring that was run last to a closed ``chain`` that nears it slowly, and where it ends."""
    total = float(chain.length.sum())
    ways = room.lean * np.array([factor for factor in _LEANS if factor * room.lean < total / 3])
    if walk.last is None or not len(ways):
        return None
    start = find_nearest(walk.last, walk.end)[0]
    here = locate(walk.last, np.array([start]))
    back = make_lines(walk.end, here)
    if back.length[0] > _SLACK and not len(_first_free(back, replace(room, most=_CLEAR))):
        return None
    foot = find_nearest(chain, here[0])[0]
    # Half-way it is in the middle between both rings; on straight ones that is a line.
    inner = locate(walk.last, (start + ways / 2) % float(walk.last.length.sum()))
    half = (inner + locate(chain, (foot + ways / 2) % total)) / 2
    ends = (foot + ways) % total
    links = make_lines(here[0], locate(chain, ends))
    links = make(links.start, links.end, bulges(links.start, half, links.end), links.owner)
    lean = (tangents_at(links, np.ones(len(links))) * tangents_along(chain, ends)).sum(axis=1)
    rows = np.flatnonzero(
        (lean >= math.cos(room.turn)) & (gaps(links, room.walls, room.clear) >= room.clear)
    )
    return (links.take(rows[:1]), float(ends[rows[0]])) if len(rows) else None


def _is_linked(walk: _Open, there: FloatArray, room: _Room) -> bool:
    return len(_first_free(make_lines(walk.end, there), room)) > 0


def _go_round(walk: _Open, ends: FloatArray, room: _Room) -> IntArray:
    """Takes ``walk`` along its last ring to where a link leads to one of ``ends``: the row of that, or none."""
    if walk.last is None:
        return np.zeros(0, dtype=np.int64)
    ring, total = walk.last, float(walk.last.length.sum())
    off, points = sample_chain(ring, total / _TRIES)
    start, gap = find_nearest(ring, walk.end)
    if gap > _SLACK:
        # A stretch beside the ring was run since; back to it first.
        back = np.concatenate([[start], off])
        lines = make_lines(walk.end, locate(ring, back))
        order = _smallest_first(lines.length)
        free = order[_first_free(lines.take(order), room)]
        if not len(free):
            return np.zeros(0, dtype=np.int64)
        start = float(back[free[0]])
    gaps_between = np.hypot(*np.moveaxis(points[:, None] - ends[None], 2, 0))
    one, two = np.unravel_index(
        _smallest_first(gaps_between.ravel())[: 2 * _TRIES], gaps_between.shape
    )
    free = _first_free(_lines(points[one], ends[two]), room)
    if len(free):
        there = float(off[one[free[0]]])
        walk.parts.append(cut_out(ring, start, there if there > start else there + total))
    return np.asarray(two[free])


def _lines(starts: FloatArray, ends: FloatArray) -> Segments:
    lines = make_lines(np.zeros(2), ends)
    return Segments(starts, lines.end, lines.bulge, lines.centre, lines.radius, lines.owner)


def _smallest_first(sizes: FloatArray) -> IntArray:
    """The rows (N,) of ``sizes`` (N,), mm or mm2, in rising order; equal ones as they stand."""
    return np.argsort(np.round(sizes, _EQUAL_DIGITS), kind="stable")


def _first_free(links: Segments, room: _Room) -> IntArray:
    """The row of the first of ``links`` that has ``room``; none if there is none."""
    for low in range(0, len(links), _AT_ONCE):
        rows = np.arange(low, min(low + _AT_ONCE, len(links)))
        # What leads over nothing uncut is soon seen; how near the walls are takes longer.
        rows = rows[_uncut(links.take(rows), room) <= room.most]
        rows = (
            rows[gaps(links.take(rows), room.walls, room.clear) >= room.clear]
            if len(rows)
            else rows
        )
        if len(rows):
            return np.asarray(rows[:1])
    return np.zeros(0, dtype=np.int64)


def _uncut(links: Segments, room: _Room) -> FloatArray:
    """(N,) mm of straight links outside of what is cut, by places along them."""
    count = np.clip(np.ceil(links.length / (_EVERY * room.clear)), 2, _MOST_PLACES).astype(np.int64)
    link = owners(count)
    points = points_at(links.take(link), (ramp(count) + 0.5) / count[link])
    bare = np.ones(len(points), dtype=bool)
    for area in room.cut:
        rows = np.flatnonzero(bare)
        bare[rows] = ~shapely.contains_xy(area, points[rows])
    return np.asarray(np.bincount(link, bare, len(links)) * links.length / count)


def _is_closed(chain: Segments) -> bool:
    return bool(np.hypot(*(chain.end[-1] - chain.start[0])) < _SLACK)
