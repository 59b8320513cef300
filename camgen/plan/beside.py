"""Offset curves for a round tool along a drawing, with the segments that it touches."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry.apart import set_apart
from camgen.geometry.centre_lines import CentreLines, find_centre_lines
from camgen.geometry.intersect import Obstacles
from camgen.geometry.offset import Offset, make_offset
from camgen.geometry.ragged import compute_first_rows
from camgen.geometry.segments import (
    BoolArray,
    IntArray,
    Segments,
    concatenate,
    find_following,
    make_segments,
    points_at,
    reverse_segments,
)
from camgen.model.pose import FloatArray
from camgen.model.text import short

#: Largest deviation of a path from the requested distance, mm. The plan is checked against it.
EXACT = 0.005
#: Deviation at corners that stay corners, mm: a tenth of the usual chord tolerance.
_MITRE = 0.001
#: A channel may be narrower than the tool by `tolerance.arc_fit`, and by this at most, mm: on
#: each side the tool then cuts half of it into the wall, which with the digits of a text is less
#: than what counts as a gouge (0.005 mm).
_NARROWER_MM = 0.008
#: With `tolerance.arc_fit` = 0 a width is the same as another within this, mm.
_SAME_MM = 2e-4
#: Why a round hole as wide as a mill is left out, and what to do.
NO_HELIX = (
    "no room for a helix, and the mill need not cut over its centre; drill it, "
    "or set tool.center_cutting = true"
)


class OffsetCurve(Struct, frozen=True, eq=False):
    """Chains along a source, with the source on their left.

    segments: segments of all chains; `owner` is the chain.
    closed: (chains,) true for closed chains.
    source: (N,) the source segment that is touched.
    turn: (N,) angle of the outer corner that a segment goes around, rad, 0 for other segments.
    lost: (N,) true if nothing is touched, as on a rounded inner corner.
    sound: (chains,) false if the check against the source failed.
    other: (N,) the source segment on the other side of a channel as wide as the tool, otherwise -1.
    shared: (K,) source segments with an edge that another outer loop has too, without a chain.
    """

    segments: Segments
    closed: BoolArray
    source: IntArray
    turn: FloatArray
    lost: BoolArray
    sound: BoolArray
    other: IntArray
    shared: IntArray


def make_offset_curve(
    source: Segments,
    following: IntArray,
    closed: BoolArray,
    group: IntArray,
    distance: float,
    corner_radius: float,
) -> OffsetCurve:
    """The curve at `distance` mm on the right of `source`.

    following: the next segment of each segment.
    closed: per owner, true if it is closed.
    group: per segment; the curve keeps clear of all segments of one group.
    corner_radius: minimum radius of inner corners, mm. They are rounded by an offset of distance +
        radius, and one of radius back (PIST, section 3.2.4).
    """
    out = _offset(source, following, group, distance + corner_radius)
    shared = out.shared
    lost = np.zeros(len(out.segments), dtype=bool)
    if corner_radius != 0.0:
        turned, rows = reverse_segments(_weld(out))
        label = group[out.source[rows]]
        back = _offset(turned, find_following(turned, out.closed), label, corner_radius)
        segments, order = reverse_segments(back.segments)
        origin = rows[back.source[order]]
        lost = back.corner[order]
        turn = np.where(lost, 0.0, out.turn[origin])
        out = replace(back, segments=segments, source=out.source[origin], turn=turn)
    sound = np.ones(len(out.closed), dtype=bool)
    other = np.full(len(out.segments), -1)
    curve = OffsetCurve(out.segments, out.closed, out.source, out.turn, lost, sound, other, shared)
    return _check(curve, source, closed, group, distance)


def find_channel_lines(
    existing: Segments,
    source: Segments,
    following: IntArray,
    group: IntArray,
    distance: float,
    arc_fit: float,
) -> CentreLines:
    """The centre lines of channels as wide as twice `distance`, mm, beyond the curves `existing`.

    arc_fit: length by which a channel may be narrower, mm, see `tolerance.arc_fit`.
    """
    slack = max(min(arc_fit, _NARROWER_MM), _SAME_MM) / 2
    return find_centre_lines(source, following, group, distance, slack, existing)


def explain_misfit(areas: Sequence[Any], diameter: float) -> str:
    """The reason why a tool does not fit into `areas`, polygons, with their width, for a note."""
    width = 2 * float(shapely.length(shapely.maximum_inscribed_circle(areas, tolerance=1e-4)).max())
    subject = "it is" if len(areas) == 1 else "the widest is"
    if width > diameter + _NARROWER_MM:
        return f"a {diameter:g} mm tool does not fit"
    if width >= diameter - _NARROWER_MM:
        why = f"{short(width, 3)} mm wide, a {diameter:g} mm tool does not fit sideways"
        return f"{subject} {why}; drill or bore it"
    return f"{subject} {short(width, 3)} mm wide, a {diameter:g} mm tool does not fit"


def with_centre_lines(curve: OffsetCurve, lines: CentreLines) -> OffsetCurve:
    """The curve with the centre lines of channels as wide as the tool as more chains."""
    if not len(lines.closed):
        return curve
    segments = replace(lines.segments, owner=lines.segments.owner + len(curve.closed))
    return OffsetCurve(
        concatenate([curve.segments, segments]),
        np.concatenate([curve.closed, lines.closed]),
        np.concatenate([curve.source, lines.source]),
        np.concatenate([curve.turn, lines.turn]),
        np.concatenate([curve.lost, np.zeros(len(segments), dtype=bool)]),
        np.concatenate([curve.sound, np.ones(len(lines.closed), dtype=bool)]),
        np.concatenate([curve.other, lines.other]),
        curve.shared,
    )


def _weld(curve: Offset) -> Segments:
    """The segments of a curve, each up to the start of the next one.

    An offset leaves gaps of 0.0001 mm at flat corners. The offset of its curve has no arc around
    such a gap, so the chain would not close.
    """
    segments = curve.segments
    following = find_following(segments, curve.closed)
    end = np.where((following >= 0)[:, None], segments.start[following], segments.end)
    return make_segments(segments.start, end, segments.bulge, segments.owner)


def _offset(source: Segments, following: IntArray, group: IntArray, distance: float) -> Offset:
    """`make_offset`, repeated at a slightly different distance if it fails."""
    result = make_offset(source, following, group, distance, _MITRE)
    for nudge in (3e-6, -7e-6, 2e-5):
        if not result.open_ends:
            break
        again = make_offset(source, following, group, distance + nudge, _MITRE)
        if again.open_ends < result.open_ends:
            result = again
    return result


def _check(
    curve: OffsetCurve, drawing: Segments, closed: BoolArray, group: IntArray, distance: float
) -> OffsetCurve:
    """The curve with `sound` set by measurements.

    Every sample has to be at the distance, or farther where nothing is touched. A chain along
    closed loops has to be closed.
    """
    segments, source, lost, sound = curve.segments, curve.source, curve.lost, curve.sound.copy()
    open_piece = ~curve.closed[segments.owner] & closed[drawing.owner[source]]
    sound[segments.owner[open_piece]] = False
    # Computed for the final curve, not for one of the offsets that led to it.
    group = set_apart(drawing, group, segments, source, distance)
    obstacles = Obstacles(drawing, group)
    fraction = np.repeat([0.0, 0.35, 0.8], len(segments))
    rows = np.tile(np.arange(len(segments)), 3)
    points = points_at(segments.take(rows), fraction)
    clearance = obstacles.nearest(points, group[source[rows]], distance + 2 * EXACT)
    # The start of a rounded corner belongs to the segment before it too, which touches.
    may_be_farther = np.where(fraction > 0, lost[rows], (lost | np.roll(lost, 1))[rows])
    is_valid = (clearance <= distance + EXACT) | may_be_farther
    is_valid &= clearance >= distance - EXACT
    sound[segments.owner[rows[~is_valid]]] = False
    return replace(curve, sound=sound)


def select_segments(curve: OffsetCurve, keep: BoolArray) -> OffsetCurve:
    """The segments `keep` (N,) of the chains, as stretches.

    A chain of which all segments are kept stays as it is.
    """
    owner = curve.segments.owner
    count = len(curve.closed)
    whole = np.bincount(owner, ~keep, count) == 0
    sizes = np.bincount(owner, minlength=count)
    first = compute_first_rows(sizes)
    # A closed chain starts after a dropped segment, so that no stretch runs over its end.
    start = np.zeros(count, dtype=np.int64)
    dropped = np.flatnonzero(~keep)
    start[owner[dropped]] = dropped - first[owner[dropped]] + 1
    start[~curve.closed | whole] = 0
    place = np.arange(len(owner)) - first[owner]
    rows = first[owner] + (place + start[owner]) % sizes[owner]
    rows = rows[keep[rows]]
    source = owner[rows]
    step = np.diff(rows)
    is_other = source[1:] != source[:-1]
    # The last row of a closed chain is followed by its first one.
    is_gap = (step != 1) & ~((step == 1 - sizes[source[1:]]) & ~is_other)
    is_start = np.concatenate([np.ones(min(len(rows), 1), dtype=bool), is_gap | is_other])
    chains = source[is_start]
    return OffsetCurve(
        replace(curve.segments.take(rows), owner=np.cumsum(is_start) - 1),
        curve.closed[chains] & whole[chains],
        curve.source[rows],
        curve.turn[rows],
        curve.lost[rows],
        curve.sound[chains],
        curve.other[rows],
        curve.shared,
    )
