"""Lines and arcs in the plane for the proof of motion, with formulas of its own.

The proof must not share a mistake with planning, so nothing here comes from `camgen.geometry`. A
piece is a line or an arc of at most half a circle. The drawing and the motions are both tables of
pieces.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.model.part import Contour, tabulate_contours
from camgen.model.pose import FloatArray

IntArray = NDArray[np.intp]
BoolArray = NDArray[np.bool_]

#: An arc whose middle is nearer to its chord, mm, is a line. Its centre would be noise.
FLAT_MM = 1e-7
#: Rows of a table that are worked on at a time, so that they stay in the cache of the processor.
BLOCK = 32_768
#: Added to divisors, mm or mm2, so that a piece of no length has finite numbers.
_NONZERO = 1e-300


class Pieces(Struct, frozen=True, eq=False, dict=True):
    """K lines and arcs, mm.

    start, end, middle: (K, 2) points; `middle` is half-way along the piece.
    centre: (K, 2) centre of an arc, 0 for a line.
    radius: (K,) radius of an arc, infinite for a line.
    turn: (K,) 1 for a counter-clockwise arc, -1 for a clockwise one, 0 for a line.
    half: (K,) half of the angle that an arc sweeps, rad, 0 for a line.
    owner: (K,) index of the contour or of the chain of motions.
    """

    start: FloatArray
    end: FloatArray
    middle: FloatArray
    centre: FloatArray
    radius: FloatArray
    turn: FloatArray
    half: FloatArray
    owner: IntArray

    def __len__(self) -> int:
        return len(self.turn)

    def take(self, rows: IntArray | BoolArray) -> Pieces:
        """The pieces at the indices or in the mask `rows`."""
        if rows.dtype == np.bool_:
            rows = np.flatnonzero(rows)
        return Pieces(*(getattr(self, name).take(rows, axis=0) for name in self.__struct_fields__))

    @cached_property
    def cosine(self) -> FloatArray:
        """(K,) cosine of `half`."""
        return np.cos(self.half)

    @cached_property
    def length(self) -> FloatArray:
        """(K,) length, mm."""
        chord = self.end - self.start
        length = np.sqrt(dot(chord, chord))
        arc = self.turn != 0
        length[arc] = 2 * self.half[arc] * self.radius[arc]
        return np.asarray(length)

    @cached_property
    def boxes(self) -> FloatArray:
        """(K, 4) bounding boxes: minimum x and y, maximum x and y."""
        low, high = np.minimum(self.start, self.end), np.maximum(self.start, self.end)
        arc = np.flatnonzero(self.turn)
        centre, radius = rows_of(self.centre, arc), self.radius[arc]
        to_middle, reach = rows_of(self.middle, arc) - centre, self.cosine[arc] * radius
        for axis in (0, 1):
            # An arc passes the right or the upper end of its circle, or the left or lower one.
            above = arc[to_middle[:, axis] >= reach]
            high[above, axis] = self.centre[above, axis] + self.radius[above]
            below = arc[-to_middle[:, axis] >= reach]
            low[below, axis] = self.centre[below, axis] - self.radius[below]
        return np.hstack([low, high])


def arcs_through(
    start: FloatArray, end: FloatArray, owner: IntArray, rows: IntArray, via: FloatArray
) -> Pieces:
    """Lines from `start` to `end`, (K, 2) each; those at the indices `rows` (A,) are arcs.

    via: (A, 2) a point of each arc between its ends.
    """
    count, middle = len(start), start + end
    middle /= 2
    radius, centre = np.full(count, np.inf), np.zeros((count, 2))
    pieces = Pieces(start, end, middle, centre, radius, np.zeros(count), np.zeros(count), owner)
    for low in range(0, len(rows), BLOCK):
        _bend(pieces, rows[low : low + BLOCK], via[low : low + BLOCK])
    return pieces


def _bend(pieces: Pieces, rows: IntArray, via: FloatArray) -> None:
    """Makes the lines at `rows` arcs through `via`, unless they are too flat for a centre."""
    begin = rows_of(pieces.start, rows)
    (cx, cy), (via_x, via_y) = (rows_of(pieces.end, rows) - begin).T, (via - begin).T
    cc = cx * cx + cy * cy
    height = cx * via_y - cy * via_x
    arc = np.abs(height) > FLAT_MM * np.sqrt(cc)
    if not arc.all():
        rows, begin, cc, height = rows[arc], begin[arc], cc[arc], height[arc]
        cx, cy, via_x, via_y = cx[arc], cy[arc], via_x[arc], via_y[arc]
    bb = via_x * via_x + via_y * via_y
    x = (cy * bb - via_y * cc) / (-2 * height)
    y = (via_x * cc - cx * bb) / (-2 * height)
    size = np.sqrt(x * x + y * y)
    # The via point lies to the right of the chord of a counter-clockwise arc.
    sense = -np.sign(height)
    reach = size * sense / np.sqrt(cc)
    to_x, to_y = x + reach * cy, y - reach * cx
    pieces.centre[rows, 0], pieces.centre[rows, 1] = begin[:, 0] + x, begin[:, 1] + y
    pieces.middle[rows, 0], pieces.middle[rows, 1] = begin[:, 0] + to_x, begin[:, 1] + to_y
    pieces.radius[rows], pieces.turn[rows] = size, sense
    # The chord to the middle of the arc subtends half of its angle.
    share = np.sqrt(to_x * to_x + to_y * to_y) / (2 * size)
    pieces.half[rows] = 2 * np.arcsin(np.clip(share, 0.0, 1.0))


def rows_of(table: FloatArray, rows: IntArray) -> FloatArray:
    """(N, ...) the chosen rows of a table; an index in brackets takes ten times as long."""
    return table.take(rows, axis=0)


def dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """(N,) products of vectors (N, 2), by row; three times as fast as a sum over an axis."""
    return np.asarray(a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1])


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """(N,) areas that vectors (N, 2) span, by row, positive if `b` is to the left of `a`."""
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


def drawn_pieces(contours: Sequence[Contour]) -> Pieces:
    """The lines and arcs of contours, in order; `owner` is the index of the contour."""
    points, bulges, counts, closed = tabulate_contours(contours)
    last = np.cumsum(counts) - 1
    following = np.arange(1, len(points) + 1)
    following[last] = last - counts + 1
    kept = np.delete(np.arange(len(points)), last[~closed])
    start, end = rows_of(points, kept), rows_of(points, following[kept])
    bulge, owner = bulges[kept], np.repeat(np.arange(len(counts)), counts)[kept]
    arcs = np.flatnonzero(bulge)
    begin, chord = rows_of(start, arcs), rows_of(end, arcs) - rows_of(start, arcs)
    # The sagitta of an arc is its chord times half the bulge, to the right of the chord.
    right = np.column_stack([chord[:, 1], -chord[:, 0]])
    via = begin + chord / 2 + right * (bulge[arcs] / 2)[:, None]
    return arcs_through(start, end, owner, arcs, via)


class Feet(Struct, frozen=True, eq=False):
    """Positions of N points relative to N pieces.

    distance: (N,) distance from the piece, mm.
    side: (N,) 1 if the point is on the left of the piece, -1 on the right, 0 if the nearest point
        of the piece is one of its ends.
    """

    distance: FloatArray
    side: FloatArray


def find_feet(points: FloatArray, pieces: Pieces, rows: IntArray) -> Feet:
    """The position of each of `points` (N, 2) relative to the piece `rows` (N,)."""
    distance, side = np.empty(len(rows)), np.empty(len(rows))
    is_arc = pieces.turn[rows] != 0
    arc, line = np.flatnonzero(is_arc), np.flatnonzero(~is_arc)
    if len(line):
        distance[line], side[line] = _beside_lines(rows_of(points, line), pieces, rows[line])
    if len(arc):
        distance[arc], side[arc] = _beside_arcs(rows_of(points, arc), pieces, rows[arc])
    return Feet(distance, side)


def _beside_lines(
    points: FloatArray, pieces: Pieces, rows: IntArray
) -> tuple[FloatArray, FloatArray]:
    start = rows_of(pieces.start, rows)
    along, to_point = rows_of(pieces.end, rows) - start, points - start
    size = dot(along, along) + _NONZERO
    share = dot(along, to_point) / size
    offset = cross(along, to_point)
    beyond = share - np.clip(share, 0.0, 1.0)
    # Across the line, and along it beyond its ends.
    distance = np.sqrt(offset * offset / size + beyond * beyond * size)
    return distance, np.where(beyond == 0, np.sign(offset), 0.0)


def _beside_arcs(
    points: FloatArray, pieces: Pieces, rows: IntArray
) -> tuple[FloatArray, FloatArray]:
    centre, radius = rows_of(pieces.centre, rows), pieces.radius[rows]
    from_centre, to_middle = points - centre, rows_of(pieces.middle, rows) - centre
    reach = np.sqrt(dot(from_centre, from_centre))
    within = dot(from_centre, to_middle) >= pieces.cosine[rows] * reach * radius
    inwards = radius - reach
    distance = np.abs(inwards)
    side = np.where(within, np.sign(inwards) * pieces.turn[rows], 0.0)
    outside = np.flatnonzero(~within)
    to_start = rows_of(points, outside) - rows_of(pieces.start, rows[outside])
    to_end = rows_of(points, outside) - rows_of(pieces.end, rows[outside])
    distance[outside] = np.sqrt(np.minimum(dot(to_start, to_start), dot(to_end, to_end)))
    return distance, side


def find_shares(points: FloatArray, pieces: Pieces, rows: IntArray) -> FloatArray:
    """(N,) how far along the piece the nearest point of its line or circle is: 0 start, 1 end."""
    return find_all_shares([points], pieces, rows)[0]


def find_all_shares(
    places: Sequence[FloatArray], pieces: Pieces, rows: IntArray
) -> list[FloatArray]:
    """`find_shares` for several sets of N points beside the same pieces."""
    is_arc = pieces.turn[rows] != 0
    arc, line = np.flatnonzero(is_arc), np.flatnonzero(~is_arc)
    shares = [np.empty(len(rows)) for _ in places]
    if len(line):
        start = rows_of(pieces.start, rows[line])
        along = rows_of(pieces.end, rows[line]) - start
        size = dot(along, along) + _NONZERO
        for share, points in zip(shares, places, strict=True):
            share[line] = dot(along, rows_of(points, line) - start) / size
    if len(arc):
        chosen = rows[arc]
        centre = rows_of(pieces.centre, chosen)
        to_middle = rows_of(pieces.middle, chosen) - centre
        scale = pieces.turn[chosen] / (2 * pieces.half[chosen])
        for share, points in zip(shares, places, strict=True):
            from_centre = rows_of(points, arc) - centre
            angle = np.arctan2(cross(to_middle, from_centre), dot(to_middle, from_centre))
            share[arc] = 0.5 + angle * scale
    return shares


def points_along(pieces: Pieces, rows: IntArray, shares: FloatArray) -> FloatArray:
    """(N, 2) points at `shares` (N,) of the length of the pieces `rows`."""
    start, end = rows_of(pieces.start, rows), rows_of(pieces.end, rows)
    points = start + shares[:, None] * (end - start)
    arc = np.flatnonzero(pieces.turn[rows])
    if len(arc):
        chosen = rows[arc]
        angle = (shares[arc] - 0.5) * 2 * pieces.half[chosen] * pieces.turn[chosen]
        arm = rows_of(pieces.middle, chosen) - rows_of(pieces.centre, chosen)
        points[arc] = rows_of(pieces.centre, chosen) + _rotate(arm, angle)
    return np.asarray(points)


def find_ways_to(points: FloatArray, pieces: Pieces, rows: IntArray) -> FloatArray:
    """(N, 2) vectors, mm, from `points` (N, 2) to the nearest point of the piece `rows` (N,)."""
    shares = np.clip(find_shares(points, pieces, rows), 0.0, 1.0)
    return points_along(pieces, rows, shares) - points


def normals_along(pieces: Pieces, rows: IntArray, shares: FloatArray) -> FloatArray:
    """(N, 2) unit vectors to the left of the pieces `rows` at `shares` of their length."""
    along = rows_of(pieces.end, rows) - rows_of(pieces.start, rows)
    along = _rotate(along, (2 * shares - 1) * pieces.half[rows] * pieces.turn[rows])
    size = np.sqrt(dot(along, along)) + _NONZERO
    return np.column_stack([-along[:, 1] / size, along[:, 0] / size])


def _rotate(vectors: FloatArray, angle: FloatArray) -> FloatArray:
    cosine, sine = np.cos(angle), np.sin(angle)
    x, y = vectors[:, 0], vectors[:, 1]
    return np.column_stack([cosine * x - sine * y, sine * x + cosine * y])
