"""Plane lines and arcs of many contours as one table: a whole drawing is one set of arrays."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import astuple, replace
from numpy.typing import NDArray

from camgen.geometry.ragged import (
    compute_first_rows,
    concatenate_columns,
    count_rows,
    find_following_rows,
    list_owners,
    measure_runs,
    number_rows,
)
from camgen.model.part import Contour, tabulate_contours
from camgen.model.pose import FloatArray

IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

#: mm: an arc whose middle is nearer than this to its chord is a line. Its centre would be rounding.
_LEAST_HEIGHT_MM = 1e-7
#: rad: smallest step of a chord along an arc, which bounds the number of chords.
_LEAST_STEP = 1e-6


class Segments(Struct, frozen=True, eq=False):
    """N lines and arcs, mm.

    start, end: (N, 2) mm.
    bulge: (N,) tan(sweep / 4), counter-clockwise positive, 0 for a line.
    centre: (N, 2) mm, 0 for a line.
    radius: (N,) mm, inf for a line.
    owner: (N,) index of the contour to which a segment belongs.
    """

    start: FloatArray
    end: FloatArray
    bulge: FloatArray
    centre: FloatArray
    radius: FloatArray
    owner: IntArray

    def __len__(self) -> int:
        return len(self.bulge)

    @property
    def is_arc(self) -> BoolArray:
        """(N,) whether a segment is an arc."""
        return np.asarray(self.bulge != 0.0)

    @property
    def sweep(self) -> FloatArray:
        """(N,) angle of arcs, rad, counter-clockwise positive, 0 for lines."""
        return np.asarray(4.0 * np.arctan(self.bulge))

    @property
    def length(self) -> FloatArray:
        """(N,) length along the segment, mm."""
        chord = np.hypot(*(self.end - self.start).T)
        arc = self.is_arc
        chord[arc] = self.radius[arc] * np.abs(self.sweep[arc])
        return np.asarray(chord)

    def take(self, rows: IntArray | BoolArray) -> Segments:
        """The rows chosen by index or mask, in that order."""
        rows = np.flatnonzero(rows) if rows.dtype == np.bool_ else rows
        # `take` needs a third of the time of an index in brackets.
        return Segments(
            *(getattr(self, name).take(rows, axis=0) for name in self.__struct_fields__)
        )


def make_segments(
    start: FloatArray, end: FloatArray, bulge: FloatArray, owner: IntArray
) -> Segments:
    """Segments from end points (N, 2), mm, bulges (N,) and owners (N,).

    Centres and radii are computed. An arc that is flatter than `_LEAST_HEIGHT_MM` becomes a line.
    """
    chord = end - start
    length = np.hypot(chord[:, 0], chord[:, 1])
    flat = np.abs(bulge) * length / 2 <= _LEAST_HEIGHT_MM
    bulge = np.where(flat, 0.0, bulge)
    safe = np.where(flat, 1.0, bulge)
    # The centre is to the left of the chord's middle, (1 - b^2) / (4 b) of its length away.
    left = np.column_stack([-chord[:, 1], chord[:, 0]])
    centre = (start + end) / 2 + left * ((1 - safe**2) / (4 * safe))[:, None]
    radius = length * (1 + safe**2) / (4 * np.abs(safe))
    return Segments(
        start,
        end,
        bulge,
        np.where(flat[:, None], 0.0, centre),
        np.where(flat, np.inf, radius),
        owner.astype(np.int64),
    )


def concatenate(tables: Sequence[Segments]) -> Segments:
    """The rows of all `tables`, in the given order."""
    return Segments(*concatenate_columns(map(astuple, tables)))


def concatenate_chains(chains: Sequence[Segments]) -> Segments:
    """The rows of all `chains`, in the given order; `owner` counts the chains."""
    return replace(concatenate(chains), owner=list_owners(count_rows(chains)))


def make_contour_segments(contours: Sequence[Contour]) -> Segments:
    """All segments of `contours` in order; `owner` counts the contours."""
    points, bulges, counts, closed = tabulate_contours(contours)
    keep = np.ones(len(points), dtype=bool)
    keep[(np.cumsum(counts) - 1)[~closed]] = False
    return make_segments(
        points[keep],
        points[find_following_rows(counts)[keep]],
        bulges[keep],
        list_owners(counts)[keep],
    )


def find_following(segments: Segments, closed: BoolArray) -> IntArray:
    """(N,) row of the segment that follows each in its contour, -1 at the end of an open one.

    closed: per owner, whether its last segment is followed by its first.
    """
    after = find_following_rows(measure_runs(segments.owner))
    after[(after <= np.arange(len(after))) & ~closed[segments.owner]] = -1
    return after


def compute_bounds(segments: Segments) -> FloatArray:
    """(N, 4) bounding boxes xmin, ymin, xmax, ymax, mm, of arcs too."""
    low = np.minimum(segments.start, segments.end)
    high = np.maximum(segments.start, segments.end)
    rows = np.flatnonzero(segments.is_arc)
    if len(rows):
        middle, sweep = _middle_and_sweep(segments.take(rows))
        # An arc reaches an extreme of its circle if it passes that direction.
        for angle, axis, side, sign in (
            (0.0, 0, high, 1),
            (np.pi / 2, 1, high, 1),
            (np.pi, 0, low, -1),
            (-np.pi / 2, 1, low, -1),
        ):
            fraction = _fraction(angle, middle, sweep)
            inside = rows[(fraction > 0) & (fraction < 1)]
            side[inside, axis] = segments.centre[inside, axis] + sign * segments.radius[inside]
    return np.column_stack([low, high])


def passes(arcs: Segments, angle: FloatArray) -> BoolArray:
    """(N,) whether arc k passes the direction `angle` (N,) from its centre, rad."""
    fraction = compute_arc_fraction(arcs, angle)
    return np.asarray((fraction > 0) & (fraction < 1))


def compute_arc_fraction(arcs: Segments, angle: FloatArray) -> FloatArray:
    """(N,) fraction of arc k at which the direction `angle` (N,) lies, rad, -pi to pi.

    0 is the start and 1 the end. A direction beside the arc is counted from the nearer end: below 0
    before the start, above 1 after the end.
    """
    return _fraction(angle, *_middle_and_sweep(arcs))


def _middle_and_sweep(arcs: Segments) -> tuple[FloatArray, FloatArray]:
    """The direction of the middle of each arc from its centre, and its sweep, both (N,), rad.

    The direction is from -2 pi to 2 pi.
    """
    arm = arcs.start - arcs.centre
    sweep = arcs.sweep
    return np.arctan2(arm[:, 1], arm[:, 0]) + sweep / 2, sweep


def _fraction(angle: FloatArray | float, middle: FloatArray, sweep: FloatArray) -> FloatArray:
    # The angle is measured from the middle of the arc: it jumps by a whole turn opposite to it.
    turn = angle - middle + np.pi
    # `np.mod` takes five times as long: most angles are less than a turn away.
    above = np.where(turn >= 2 * np.pi, turn - 2 * np.pi, turn)
    turn = np.where(turn < 0, turn + 2 * np.pi, above) - np.pi
    return np.asarray(0.5 + turn / sweep)


def points_at(segments: Segments, fraction: FloatArray) -> FloatArray:
    """(N, 2) points at `fraction` (N,) of the length of each segment, mm; exact at 0 and 1."""
    points = segments.start + fraction[:, None] * (segments.end - segments.start)
    rows = np.flatnonzero(segments.is_arc & (fraction != 0.0) & (fraction != 1.0))
    if len(rows):
        arcs = segments.take(rows)
        arm = arcs.start - arcs.centre
        angle = arcs.sweep * fraction[rows]
        c, s = np.cos(angle), np.sin(angle)
        turned = np.column_stack([c * arm[:, 0] - s * arm[:, 1], s * arm[:, 0] + c * arm[:, 1]])
        points[rows] = arcs.centre + turned
    return np.asarray(points)


def tangents_at(segments: Segments, fraction: FloatArray) -> FloatArray:
    """(N, 2) unit directions of travel at `fraction` (N,) of the length of each segment."""
    chord = segments.end - segments.start
    angle = np.arctan2(chord[:, 1], chord[:, 0]) + segments.sweep * (fraction - 0.5)
    return np.column_stack([np.cos(angle), np.sin(angle)])


def measure_triangles(
    start: FloatArray, end: FloatArray, owner: IntArray, count: int
) -> FloatArray:
    """(N,) twice the signed areas between lines and the first point of their loop, mm2.

    For each of `count` loops they add up to twice the area of its polygon (shoelace formula).

    start, end: (N, 2) ends of the lines, sorted by `owner` (N,), the loop of each.
    """
    if not len(owner):
        return np.zeros(0)
    first = np.searchsorted(owner, np.arange(count))
    origin = start[np.minimum(first, len(owner) - 1)][owner]
    a, b = start - origin, end - origin
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


def split_segments(
    segments: Segments, rows: IntArray, low: FloatArray, high: FloatArray
) -> Segments:
    """The pieces of `segments[rows]` from fraction `low` to fraction `high`, each (K,)."""
    whole = segments.take(rows)
    bulge = np.tan(np.arctan(whole.bulge) * (high - low))
    return make_segments(points_at(whole, low), points_at(whole, high), bulge, whole.owner)


def reverse_segments(segments: Segments) -> tuple[Segments, IntArray]:
    """The segments of every owner reversed in order and direction, and the row of each before.

    Owners keep their order.
    """
    rows = len(segments) - 1 - np.argsort(segments.owner[::-1], kind="stable")
    old = segments.take(rows)
    return Segments(old.end, old.start, -old.bulge, old.centre, old.radius, old.owner), rows


def flatten(segments: Segments, chord: float | FloatArray) -> tuple[FloatArray, IntArray]:
    """Points (M, 2) along the segments, mm, and the owner (M,) of each.

    Arcs become chords that deviate by at most `chord` mm, a number or (N,). The end of a segment is
    left out, because the next segment begins there.
    """
    with np.errstate(invalid="ignore"):
        step = 2 * np.arccos(np.clip(1 - chord / segments.radius, -1.0, 1.0))
        chords = np.ceil(np.abs(segments.sweep) / np.maximum(step, _LEAST_STEP))
    count = np.maximum(np.where(segments.is_arc, chords, 1), 1).astype(np.int64)
    first = compute_first_rows(count)
    points = np.empty((int(count.sum()), 2))
    points[first] = segments.start
    # The inner points of arcs, as complex numbers: a whole drawing has millions of them.
    rows = np.flatnonzero(count > 1)
    which, place = list_owners(count[rows] - 1), number_rows(count[rows] - 1) + 1
    centre = segments.centre[rows] @ np.array([1, 1j])
    arm = segments.start[rows] @ np.array([1, 1j]) - centre
    turn = segments.sweep[rows] / count[rows]
    curve = centre[which] + arm[which] * np.exp(1j * (turn[which] * place))
    points[first[rows][which] + place] = curve.view(np.float64).reshape(-1, 2)
    return points, np.repeat(segments.owner, count)
