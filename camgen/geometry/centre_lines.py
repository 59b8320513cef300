"""Centre lines of channels as wide as the tool, where the offsets of both walls are one line.

The offset at a distance d needs room beyond d. A channel of the width 2 d has none. From a point s
on a wall with the normal n into the channel, the opposite wall is searched. Let w be the width
there. Then s + n w / 2 is the middle. It belongs to the centre line if no wall is nearer to it than
w / 2: the disc about it touches s and the opposite wall, and nothing is inside it. The ends of the
lines are found by bisection. Both walls give the same line, so the longer one is kept.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from msgspec import Struct

from camgen.geometry.intersect import Obstacles, find_fractions, measure_gaps
from camgen.geometry.ragged import (
    Runs,
    divide_runs,
    find_run_starts,
    list_chains,
    list_owners,
    list_range_numbers,
    mark_run_ends,
    mark_run_starts,
    number_rows,
)
from camgen.geometry.segments import (
    BoolArray,
    IntArray,
    Segments,
    concatenate,
    make_segments,
    points_at,
    tangents_at,
)
from camgen.geometry.vectors import compute_in_blocks, measure_signed_angles, turn_right
from camgen.model.pose import FloatArray

#: mm: a channel may be wider than the tool by this, because pockets leave out thinner rings.
_WIDER_MM = 0.003
#: Fraction of the distance from a wall at which the search for the opposite wall begins. Both walls
#: of a channel are farther from the wall itself than from there.
_BEYOND = 1.5
#: Fraction of the distance between neighbouring samples on a wall.
_SAMPLE_STEP = 0.25
#: Samples on a wall segment, at least.
_LEAST_SAMPLES = 3
#: Bisections by which the end of a line is found.
_HALVINGS = 40
#: Fraction of the slack by which a wall may be nearer to the middle than half of the width. The
#: width is measured perpendicular to one wall, and the direction of walls of chords varies.
_UNEVEN = 0.1
#: Factor on the slack: lines that are nearer to each other than this are one line.
_SAME = 4.0
#: Fraction of the distance. A shorter line is left out: discs at its ends cover it.
_SHORT = 0.25
#: rad: no line continues around a corner that turns by more.
_MOST_TURN = np.radians(120.0)
#: mm: pieces of a line may miss each other by this.
_MISS_MM = 1e-3
#: mm: lower bound of a length by which a vector is divided.
_LEAST_LENGTH_MM = 1e-9
#: Fraction of a wall segment that may be missing in a whole one, through rounding.
_WHOLE_ROUNDING = 1e-6
#: Fractions of a piece at which it is compared with known lines.
_PROBES = np.linspace(0.02, 0.98, 5)

#: Gets segments (K,) and a fraction (K,) of each; returns (K,) whether the condition holds there.
_Test = Callable[[IntArray, FloatArray], BoolArray]
#: Gets segments (K,) and two fractions (K,) of each; returns (K,) False if the condition holds
#: nowhere between them.
_MayHold = Callable[[IntArray, FloatArray, FloatArray], BoolArray]


class CentreLines(Struct, frozen=True, eq=False):
    """Lines in the middle of channels, and the middles of round holes.

    segments: lines and arcs in order, `owner` counts the centre lines.
    closed: (lines,) whether a line is closed.
    source: (N,) the wall segment beside which each segment was found.
    other: (N,) the wall segment on its other side.
    turn: (N,) angle of the wall's corner around which a segment runs, rad, 0 elsewhere.
    holes: (P, 2) middles of round holes, mm.
    hole_source: (P,) a wall segment of each hole.
    """

    segments: Segments
    closed: BoolArray
    source: IntArray
    other: IntArray
    turn: FloatArray
    holes: FloatArray
    hole_source: IntArray


class _Pieces(Struct, frozen=True, eq=False):
    """Parts of walls with a centre line next to them, in the order of the walls.

    row: (K,) wall segment.
    low, high: (K,) fractions of it at which the part begins and ends.
    """

    row: IntArray
    low: FloatArray
    high: FloatArray

    def take(self, rows: IntArray | BoolArray) -> _Pieces:
        """The pieces chosen by index or mask."""
        return _Pieces(self.row[rows], self.low[rows], self.high[rows])


def find_centre_lines(
    source: Segments,
    following: IntArray,
    group: IntArray,
    distance: float,
    slack: float,
    known: Segments,
) -> CentreLines:
    """The centre lines on the right of `source` of channels as wide as twice `distance`, mm.

    following: (N,) next segment of each, -1 at the end of an open chain.
    group: (N,) labels; segments with different labels do not influence each other.
    slack: largest difference by which a wall may be nearer to a line than `distance`, mm.
    known: paths that the tool runs anyway. Lines along them are left out.
    """
    walls = _Walls(source, group, distance, slack)
    whole_walls = _Pieces(np.arange(len(source)), np.zeros(len(source)), np.ones(len(source)))
    pieces = _find_parts(walls.has_middle, whole_walls, walls, walls.may_have_middle)
    holes, pieces = _split_holes(walls, pieces)
    none = np.zeros(0, dtype=np.int64)
    # The first entry has no segments, for a drawing without centre lines.
    entries = [(known.take(none), np.zeros(0), none, False)]
    kept = known
    for chain in _join_pieces(walls, following, pieces):
        for part in _remove_known(walls, following, chain, kept):
            entry = _make_line(walls, part, len(entries) - 1)
            line, _, _, ring = entry
            if ring or float(line.length.sum()) >= _SHORT * distance:
                entries.append(entry)
                kept = concatenate([kept, line])
    lines, turns, sources, closed = zip(*entries, strict=True)
    segments, rows = concatenate(lines), np.concatenate(sources)
    middles = points_at(segments, np.full(len(segments), 0.5))
    return CentreLines(
        segments,
        np.array(closed[1:], dtype=bool),
        rows,
        walls.opposite(rows, middles),
        np.concatenate(turns),
        walls.middles(holes, np.zeros(len(holes))),
        holes,
    )


class _Walls:
    """Walls of channels, and the widths of the channels at points on them.

    source: N wall segments; the channels are on their right.
    group: (N,) labels.
    distance: half the width of the channels, mm.
    slack: mm, see `find_centre_lines`.
    """

    def __init__(self, source: Segments, group: IntArray, distance: float, slack: float) -> None:
        self.source, self.group = source, group
        self.distance, self.slack = distance, slack
        self.obstacles = Obstacles(source, group)

    def _measure(self, rows: IntArray, fraction: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Widths of the channel at points on walls (K,), and its middles there (K, 2), mm.

        The width is inf if there is no opposite wall.
        """
        walls = self.source.take(rows)
        normal = turn_right(tangents_at(walls, fraction))
        place = points_at(walls, fraction)
        beyond = place + _BEYOND * self.distance * normal
        reach = (2 - _BEYOND) * self.distance + _WIDER_MM
        width = _BEYOND * self.distance + self.obstacles.nearest(beyond, self.group[rows], reach)
        half = np.where(np.isfinite(width), width / 2, self.distance)
        return width, place + half[:, None] * normal

    def may_have_middle(self, rows: IntArray, low: FloatArray, high: FloatArray) -> BoolArray:
        """(K,) False if no point between two fractions of a wall has an opposite wall."""
        walls = self.source.take(rows)
        ends = []
        for fraction in (low, high):
            normal = turn_right(tangents_at(walls, fraction))
            ends.append(points_at(walls, fraction) + _BEYOND * self.distance * normal)
        bulge = np.tan(np.arctan(walls.bulge) * (high - low))
        beyond = make_segments(ends[0], ends[1], bulge, np.arange(len(rows)))
        reach = (2 - _BEYOND) * self.distance + 2 * _WIDER_MM
        near = np.isfinite(measure_gaps(beyond, self.source, reach))
        # The parallel arc is a point if the centre of the wall lies on it.
        is_point = np.abs(walls.radius - _BEYOND * self.distance) <= _WIDER_MM
        return near | (walls.is_arc & is_point)

    def middles(self, rows: IntArray, fraction: FloatArray) -> FloatArray:
        """(K, 2) middles of the channel at points on walls, mm."""
        return self._measure(rows, fraction)[1]

    def has_middle(self, rows: IntArray, fraction: FloatArray) -> BoolArray:
        """(K,) whether the centre line runs next to a point on a wall."""
        return compute_in_blocks(self._has_middle, rows, fraction)

    def _has_middle(self, rows: IntArray, fraction: FloatArray) -> BoolArray:
        width, middle = self._measure(rows, fraction)
        has_middle = np.isfinite(width) & (width >= 2 * (self.distance - self.slack))
        chosen = np.flatnonzero(has_middle)
        if len(chosen):
            least = width[chosen] / 2 - _UNEVEN * self.slack
            least = np.maximum(least, self.distance - self.slack)
            group = self.group[rows[chosen]]
            has_middle[chosen] = ~self.obstacles.nearer_than(middle[chosen], group, least)
        return has_middle

    def opposite(self, rows: IntArray, middles: FloatArray) -> IntArray:
        """(K,) wall segment on the other side of each of `middles` (K, 2)."""
        fraction = np.clip(find_fractions(self.source.take(rows), middles), 0.0, 1.0)
        arm = middles - points_at(self.source.take(rows), fraction)
        length = np.maximum(np.hypot(*arm.T), _LEAST_LENGTH_MM)[:, None]
        beyond = middles + (_BEYOND - 1) * self.distance * arm / length
        return self.obstacles.nearest_rows(beyond, self.group[rows], self.distance)

    def is_clear(self, points: FloatArray, row: int) -> bool:
        """Whether no wall of the group of `row` is too near to `points` (K, 2) by the slack."""
        group = np.full(len(points), self.group[row])
        least = np.full(len(points), self.distance - self.slack)
        return not self.obstacles.nearer_than(points, group, least).any()


def _find_parts(
    test: _Test, pieces: _Pieces, walls: _Walls, may_hold: _MayHold | None = None
) -> _Pieces:
    """The parts of `pieces` along which `test` holds.

    may_hold: excludes parts in which it holds nowhere, before they are sampled; None: no part.
    """
    span = pieces.high - pieces.low
    length = walls.source.length[pieces.row] * span
    count = np.ceil(length / (_SAMPLE_STEP * walls.distance)).astype(np.int64)
    count = np.maximum(count, _LEAST_SAMPLES)
    which, place = _list_samples(pieces, count, may_hold)

    def fraction(which: IntArray, place: IntArray) -> FloatArray:
        return np.asarray(pieces.low[which] + (place + 0.5) / count[which] * span[which])

    at = fraction(which, place)
    rows = np.flatnonzero(test(pieces.row[which], at))
    # The second number stays the same from a sample to the next one of its piece.
    runs = np.column_stack([which[rows], place[rows] - np.arange(len(rows))])
    begin, end = rows[mark_run_starts(runs)], rows[mark_run_ends(runs)]
    piece = which[begin]
    before = fraction(piece, place[begin] - 1)
    before = np.where(place[begin] == 0, pieces.low[piece], before)
    after = fraction(piece, place[end] + 1)
    after = np.where(place[end] == count[piece] - 1, pieces.high[piece], after)
    row = pieces.row[piece]
    low, high = _bisect(test, row, before, at[begin]), _bisect(test, row, after, at[end])
    return _Pieces(row, low, high)


def _list_samples(
    pieces: _Pieces, count: IntArray, may_hold: _MayHold | None
) -> tuple[IntArray, IntArray]:
    """The piece and the number in it of each sample, of `count` (K,) samples on each piece."""
    if may_hold is None:
        return list_owners(count), number_rows(count)

    def holds_nowhere(runs: Runs) -> BoolArray:
        low, row = pieces.low[runs.group], pieces.row[runs.group]
        step = (pieces.high[runs.group] - low) / count[runs.group]
        return ~may_hold(row, low + runs.first * step, low + runs.end * step)

    none = np.zeros_like(count)
    whole = Runs(np.arange(len(count)), none, count, none > 0)
    runs = divide_runs(np.where(holds_nowhere(whole), 0, count), holds_nowhere)
    size = np.where(runs.settled, 0, runs.end - runs.first)
    return np.repeat(runs.group, size), list_range_numbers(runs.first, size)


def _bisect(test: _Test, row: IntArray, outside: FloatArray, inside: FloatArray) -> FloatArray:
    """(K,) the fraction nearest to `outside` (K,) up to which `test` holds from `inside` (K,)."""
    if not len(row):
        return inside
    inside = np.where(test(row, outside), outside, inside)
    for _ in range(_HALVINGS):
        middle = (outside + inside) / 2
        holds = test(row, middle)
        inside, outside = np.where(holds, middle, inside), np.where(holds, outside, middle)
    return inside


def _split_holes(walls: _Walls, pieces: _Pieces) -> tuple[IntArray, _Pieces]:
    """A wall segment of each loop that is a round hole, and the pieces of all other loops."""
    source = walls.source
    count = int(source.owner.max(initial=-1)) + 1
    covered = np.bincount(pieces.row, pieces.high - pieces.low, len(source))
    whole = np.bincount(source.owner, covered < 1 - _WHOLE_ROUNDING, count) == 0
    candidates = pieces.take(whole[source.owner[pieces.row]])
    middle = walls.middles(candidates.row, (candidates.low + candidates.high) / 2)
    first = find_run_starts(source.owner[candidates.row])
    extent = np.maximum.reduceat(middle, first) - np.minimum.reduceat(middle, first)
    rows = candidates.row[first[extent.max(axis=1) <= _SAME * walls.slack]]
    return rows, pieces.take(~np.isin(source.owner[pieces.row], source.owner[rows]))


def _join_pieces(walls: _Walls, following: IntArray, pieces: _Pieces) -> list[_Pieces]:
    """Chains of pieces that follow each other along a wall, the longest chain first."""
    count = len(pieces.row)
    after = np.full(count, -1)
    starts = find_run_starts(pieces.row)
    first_of = dict(zip(pieces.row[starts].tolist(), starts.tolist(), strict=True))
    for last in (np.append(starts[1:], count) - 1).tolist() if count else []:
        successor = first_of.get(int(following[pieces.row[last]]), -1)
        if successor >= 0 and _can_continue(walls, pieces, last, successor):
            after[last] = successor
    chains = list_chains(after)
    length = walls.source.length[pieces.row] * (pieces.high - pieces.low)
    lengths = [float(length[chain].sum()) for chain in chains]
    # Equal lengths to a thousandth keep the order of the drawing.
    ranks = np.argsort(-np.round(lengths, 3), kind="stable")
    return [pieces.take(np.array(chains[k])) for k in ranks.tolist()]


def _can_continue(walls: _Walls, pieces: _Pieces, last: int, first: int) -> bool:
    """Whether the line along piece `last` continues along `first`, around a corner or not."""
    rows = pieces.row[[last, first]]
    first_end, next_start = walls.middles(rows, np.array([pieces.high[last], pieces.low[first]]))
    turn = _measure_turn(walls.source, int(rows[0]), int(rows[1]))
    if abs(turn) > _MOST_TURN:
        return False
    gap = float(np.hypot(*(next_start - first_end)))
    if gap > 2 * walls.distance * np.sin(abs(turn) / 2) + _MISS_MM:
        return False
    bulge = np.array([np.tan(turn / 4)])
    corner = make_segments(first_end[None], next_start[None], bulge, np.zeros(1, dtype=np.int64))
    middles = points_at(corner.take(np.zeros(3, dtype=np.int64)), np.array([0.25, 0.5, 0.75]))
    return walls.is_clear(middles, int(rows[0]))


def _measure_turn(source: Segments, before: int, after: int) -> float:
    """The angle by which a wall turns from one segment to the next, rad, left positive."""
    pair = source.take(np.array([before, after]))
    direction = tangents_at(pair, np.array([1.0, 0.0]))
    return float(measure_signed_angles(direction[:1], direction[1:])[0])


def _remove_known(
    walls: _Walls, following: IntArray, chain: _Pieces, known: Segments
) -> list[_Pieces]:
    """The parts of a chain along which no known line runs, as chains."""
    if not len(known):
        return [chain]
    lines = Obstacles(known, np.zeros(len(known), dtype=np.int64))

    def is_new(rows: IntArray, fraction: FloatArray) -> BoolArray:
        middles, group = walls.middles(rows, fraction), np.zeros_like(rows)
        return np.isinf(lines.nearest(middles, group, _SAME * walls.slack))

    rows = np.repeat(chain.row, len(_PROBES))
    span = np.repeat(chain.high - chain.low, len(_PROBES))
    fraction = np.repeat(chain.low, len(_PROBES)) + span * np.tile(_PROBES, len(chain.row))
    if is_new(rows, fraction).all():
        return [chain]
    new = _find_parts(is_new, chain, walls)
    order = np.lexsort((new.low, new.row))
    return _join_pieces(walls, following, new.take(order))


def _make_line(
    walls: _Walls, chain: _Pieces, owner: int
) -> tuple[Segments, FloatArray, IntArray, bool]:
    """The centre line along a chain.

    Returns its segments, their turns at corners, their wall segments, and whether it is closed.
    """
    source = walls.source.take(chain.row)
    low, high = walls.middles(chain.row, chain.low), walls.middles(chain.row, chain.high)
    bulge = np.tan(np.arctan(source.bulge) * (chain.high - chain.low))
    points, bulges, turn, rows = [low[0]], [], [], []

    def add(target: FloatArray, bulge: float, angle: float, row: int) -> None:
        if np.hypot(*(target - points[-1])) > _MISS_MM:
            points.append(target)
            bulges.append(bulge)
            turn.append(angle)
            rows.append(row)

    for k, row in enumerate(chain.row.tolist()):
        if k:
            angle = _measure_turn(walls.source, int(chain.row[k - 1]), row)
            if float((low[k] - points[-1]) @ (high[k] - low[k])) < 0.0:
                # In an inner corner of chords both pieces extend beyond the bisector.
                points[-1] = (points[-1] + low[k]) / 2
            else:
                add(low[k], float(np.tan(angle / 4)), angle, row)
        add(high[k], float(bulge[k]), 0.0, row)
    table = np.array(points)
    ring = len(rows) > 1 and bool(np.hypot(*(table[-1] - table[0])) <= _MISS_MM)
    if ring:
        table[-1] = table[0]
    line = make_segments(table[:-1], table[1:], np.array(bulges), np.full(len(rows), owner))
    return line, np.array(turn), np.array(rows, dtype=np.int64), ring
