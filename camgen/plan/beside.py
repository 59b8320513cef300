"""The curve that a round tool runs along beside a drawing, and what it touches there."""

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
from camgen.geometry.ragged import begins
from camgen.geometry.segments import (
    BoolArray,
    IntArray,
    Segments,
    concatenate,
    find_following,
    make,
    points_at,
    reverse_segments,
)
from camgen.model.pose import FloatArray
from camgen.model.text import short

#: How far (mm) a path may be from the distance that was asked for; the plan is checked against it.
EXACT = 0.005
#: Corners may be left by this much (mm) to stay corners: a tenth of the usual chord tolerance.
_MITRE = 0.001
#: A channel may be narrower than the tool by ``tolerance.arc_fit``, and by this at most, mm: on
#: each side the tool then cuts half of it into the wall, which with the digits of a text is less
#: than what counts as a gouge (0.005 mm).
_NARROWER_MM = 0.008
#: With ``tolerance.arc_fit`` = 0 a width is the same as another within this, mm.
_SAME_MM = 2e-4
#: Why a round hole as wide as a mill is left out, and what to do.
NO_HELIX = (
    "no room for a helix, and the mill need not cut over its centre; drill it, "
    "or set tool.center_cutting = true"
)


class Beside(Struct, frozen=True, eq=False):
    """Chains beside a source, the source on their left.

    segments: ``owner`` counts the chains. closed: (chains,). source: (N,) the source segment that is touched. turn:
    (N,) rad by which the source turns at the outer corner that a segment rounds, 0 elsewhere. lost: (N,) true where
    nothing is touched (a rounded inner corner). sound: (chains,) false where the check against the source failed.
    other: (N,) the source segment on the other side of a channel as wide as the tool, -1 elsewhere.
    """

    segments: Segments
    closed: BoolArray
    source: IntArray
    turn: FloatArray
    lost: BoolArray
    sound: BoolArray
    other: IntArray


def beside(
    source: Segments,
    following: IntArray,
    closed: BoolArray,
    group: IntArray,
    distance: float,
    corner_radius: float,
) -> Beside:
    """The curve at ``distance`` mm on the right of ``source``, inner corners at least ``corner_radius`` mm round.

    following: the next segment of each. closed: per owner. group: per segment; what is of one group is kept clear of.
    Inner corners are rounded by going out by distance + radius and back by radius (PIST, section 3.2.4).
    """
    out = _offset(source, following, group, distance + corner_radius)
    if corner_radius == 0.0:
        lost = np.zeros(len(out.segments), dtype=bool)
        sound = np.ones(len(out.closed), dtype=bool)
        other = np.full(len(out.segments), -1)
        curve = Beside(out.segments, out.closed, out.source, out.turn, lost, sound, other)
        return _check(curve, source, closed, group, distance)
    turned, rows = reverse_segments(_weld(out))
    label = group[out.source[rows]]
    back = _offset(turned, find_following(turned, out.closed), label, corner_radius)
    segments, order = reverse_segments(back.segments)
    origin = rows[back.source[order]]
    lost = back.corner[order]
    turn = np.where(lost, 0.0, out.turn[origin])
    sound = np.ones(len(back.closed), dtype=bool)
    other = np.full(len(segments), -1)
    curve = Beside(segments, back.closed, out.source[origin], turn, lost, sound, other)
    return _check(curve, source, closed, group, distance)


def centre_lines(
    known: Segments,
    source: Segments,
    following: IntArray,
    group: IntArray,
    distance: float,
    arc_fit: float,
) -> CentreLines:
    """The centre lines of channels as wide as twice ``distance``, mm, where none of ``known`` runs.

    arc_fit: mm by which a channel may be narrower, see ``tolerance.arc_fit``.
    """
    slack = max(min(arc_fit, _NARROWER_MM), _SAME_MM) / 2
    return find_centre_lines(source, following, group, distance, slack, known)


def does_not_fit(areas: Sequence[Any], diameter: float) -> str:
    """Why a tool does not fit into ``areas``, polygons, with their width in the words of a note."""
    circles = [shapely.maximum_inscribed_circle(area, tolerance=1e-4) for area in areas]
    widest = 2 * max(float(circle.length) for circle in circles)
    which = "it is" if len(areas) == 1 else "the widest is"
    if widest > diameter + _NARROWER_MM:
        return f"a {diameter:g} mm tool does not fit"
    if widest >= diameter - _NARROWER_MM:
        why = f"{short(widest, 3)} mm wide, a {diameter:g} mm tool does not fit sideways"
        return f"{which} {why}; drill or bore it"
    return f"{which} {short(widest, 3)} mm wide, a {diameter:g} mm tool does not fit"


def with_centre_lines(curve: Beside, lines: CentreLines) -> Beside:
    """The curve and, as more chains, the centre lines of channels as wide as the tool."""
    if not len(lines.closed):
        return curve
    segments = replace(lines.segments, owner=lines.segments.owner + len(curve.closed))
    count = len(segments)
    return Beside(
        concatenate([curve.segments, segments]),
        np.concatenate([curve.closed, lines.closed]),
        np.concatenate([curve.source, lines.source]),
        np.concatenate([curve.turn, lines.turn]),
        np.concatenate([curve.lost, np.zeros(count, dtype=bool)]),
        np.concatenate([curve.sound, np.ones(len(lines.closed), dtype=bool)]),
        np.concatenate([curve.other, lines.other]),
    )


def _weld(curve: Offset) -> Segments:
    """The segments of a curve, each up to the start of the next one.

    An offset leaves gaps of 0.0001 mm at flat corners. The offset of its curve has no arc around
    such a gap, so the chain would not close.
    """
    segments = curve.segments
    following = find_following(segments, curve.closed)
    end = np.where((following >= 0)[:, None], segments.start[following], segments.end)
    return make(segments.start, end, segments.bulge, segments.owner)


def _offset(source: Segments, following: IntArray, group: IntArray, distance: float) -> Offset:
    """`make_offset`, again with a distance that differs by a hair if rounding makes it fail."""
    result = make_offset(source, following, group, distance, _MITRE)
    for nudge in (3e-6, -7e-6, 2e-5):
        if not result.open_ends:
            break
        again = make_offset(source, following, group, distance + nudge, _MITRE)
        if again.open_ends < result.open_ends:
            result = again
    return result


def _check(
    curve: Beside, drawing: Segments, closed: BoolArray, group: IntArray, distance: float
) -> Beside:
    """The curve with the verdict of measuring it.

    Every sampled point must be at the distance, or farther where nothing is touched, and what runs beside closed loops
    must be closed.
    """
    segments, source, lost, sound = curve.segments, curve.source, curve.lost, curve.sound.copy()
    open_piece = ~curve.closed[segments.owner] & closed[drawing.owner[source]]
    sound[segments.owner[open_piece]] = False
    # Told anew of the curve as it is, whatever was taken to be apart on the way to it.
    group = set_apart(drawing, group, segments, source, distance)
    obstacles = Obstacles(drawing, group)
    for fraction in (0.0, 0.35, 0.8):
        points = points_at(segments, np.full(len(segments), fraction))
        gap = obstacles.nearest(points, group[source], distance + 2 * EXACT)
        good = (gap >= distance - EXACT) & ((gap <= distance + EXACT) | (lost & (fraction > 0)))
        # The first point of a rounded corner belongs to the segment before it as well; the others judge the corner.
        good |= (fraction == 0) & (lost | np.roll(lost, 1)) & (gap >= distance - EXACT)
        sound[segments.owner[~good]] = False
    return replace(curve, sound=sound)


def only_along(curve: Beside, keep: BoolArray) -> Beside:
    """The segments `keep` (N,) of the chains, as stretches.

    A chain of which all segments are kept stays as it is.
    """
    owner = curve.segments.owner
    count = len(curve.closed)
    whole = np.bincount(owner, ~keep, count) == 0
    sizes = np.bincount(owner, minlength=count)
    first = begins(sizes)
    # A closed chain is begun after a segment that is not kept, so that no stretch goes over its end.
    turn = np.zeros(count, dtype=np.int64)
    lost = np.flatnonzero(~keep)
    turn[owner[lost]] = lost - first[owner[lost]] + 1
    turn[~curve.closed | whole] = 0
    place = np.arange(len(owner)) - first[owner]
    rows = first[owner] + (place + turn[owner]) % sizes[owner]
    rows = rows[keep[rows]]
    old = owner[rows]
    step = (np.diff(rows) != 1) & ~((np.diff(rows) == 1 - sizes[old[1:]]) & (old[1:] == old[:-1]))
    fresh = (
        np.concatenate([np.zeros(1, dtype=bool), step | (old[1:] != old[:-1])])
        if len(rows)
        else np.zeros(0, bool)
    )
    chain = np.cumsum(fresh)
    of = old[np.concatenate([[True], fresh[1:]])] if len(rows) else np.zeros(0, dtype=np.int64)
    segments = replace(curve.segments.take(rows), owner=chain)
    return Beside(
        segments,
        curve.closed[of] & whole[of],
        curve.source[rows],
        curve.turn[rows],
        curve.lost[rows],
        curve.sound[of],
        curve.other[rows],
    )


def only_chains(curve: Beside, chosen: BoolArray) -> Beside:
    """The ``chosen`` (chains,) of a curve."""
    rows = np.flatnonzero(chosen[curve.segments.owner])
    segments = replace(
        curve.segments.take(rows), owner=(np.cumsum(chosen) - 1)[curve.segments.owner[rows]]
    )
    return Beside(
        segments,
        curve.closed[chosen],
        curve.source[rows],
        curve.turn[rows],
        curve.lost[rows],
        curve.sound[chosen],
        curve.other[rows],
    )
