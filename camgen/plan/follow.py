"""Tool paths beside the contours: outer loops outside, holes inside, feed and force for a round tool."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.geometry.intersect import Obstacles, distances, near_pairs
from camgen.geometry.nesting import Nesting, nest
from camgen.geometry.offset import Offset, offset
from camgen.geometry.segments import BoolArray, IntArray, Segments, backwards, from_contours, neighbours, points_at
from camgen.geometry.uncross import find_slips, uncross
from camgen.model.job import Job
from camgen.model.part import Contour, Note, Part
from camgen.model.path import ToolPath
from camgen.model.pose import FloatArray
from camgen.model.text import counted
from camgen.plan.columns import Label, pass_depths, sideways, tool_paths

# The curve that a round tool runs along beside a drawing, and what it touches there.

#: How far (mm) a path may be from the distance that was asked for; the plan is checked against it.
EXACT = 0.005
#: Corners may be left by this much (mm) to stay corners: a tenth of the usual chord tolerance.
_MITRE = 0.001


class Beside(Struct, frozen=True, eq=False):
    """Chains beside a source, the source on their left.

    segments: ``owner`` counts the chains. closed: (chains,). source: (N,) the source segment that is touched. turn:
    (N,) rad by which the source turns at the outer corner that a segment rounds, 0 elsewhere. lost: (N,) true where
    nothing is touched (a rounded inner corner). sound: (chains,) false where the check against the source failed.
    """

    segments: Segments
    closed: BoolArray
    source: IntArray
    turn: FloatArray
    lost: BoolArray
    sound: BoolArray


def beside(
    source: Segments, following: IntArray, closed: BoolArray, group: IntArray, distance: float, corner_radius: float
) -> Beside:
    """The curve at ``distance`` mm on the right of ``source``, inner corners at least ``corner_radius`` mm round.

    following: the next segment of each. closed: per owner. group: per segment; what is of one group is kept clear of.
    Inner corners are rounded by going out by distance + radius and back by radius (PIST, section 3.2.4).
    """
    out = _offset(source, following, group, distance + corner_radius)
    if corner_radius == 0.0:
        lost = np.zeros(len(out.segments), dtype=bool)
        return _check(out.segments, out.closed, out.source, out.turn, lost, source, closed, group, distance)
    turned, rows = backwards(out.segments)
    label = group[out.source[rows]]
    back = _offset(turned, neighbours(turned, out.closed), label, corner_radius)
    segments, order = backwards(back.segments)
    origin = rows[back.source[order]]
    lost = back.corner[order]
    turn = np.where(lost, 0.0, out.turn[origin])
    return _check(segments, back.closed, out.source[origin], turn, lost, source, closed, group, distance)


def _offset(source: Segments, following: IntArray, group: IntArray, distance: float) -> Offset:
    """``offset``, again with a distance that differs by a hair if the numbers were against it."""
    result = offset(source, following, group, distance, _MITRE)
    for nudge in (3e-6, -7e-6, 2e-5):
        if not result.open_ends:
            break
        again = offset(source, following, group, distance + nudge, _MITRE)
        if again.open_ends < result.open_ends:
            result = again
    return result


def _check(  # noqa: PLR0913, PLR0917 (the columns of Beside, and what they are measured against)
    segments: Segments,
    closed: BoolArray,
    source: IntArray,
    turn: FloatArray,
    lost: BoolArray,
    drawing: Segments,
    drawn_closed: BoolArray,
    group: IntArray,
    distance: float,
) -> Beside:
    """The curve with the verdict of measuring it.

    Every sampled point must be at the distance, or farther where nothing is touched, and what runs beside closed loops
    must be closed.
    """
    sound = np.ones(len(closed), dtype=bool)
    open_piece = ~closed[segments.owner] & drawn_closed[drawing.owner[source]]
    sound[segments.owner[open_piece]] = False
    obstacles = Obstacles(drawing, group)
    for fraction in (0.0, 0.35, 0.8):
        points = points_at(segments, np.full(len(segments), fraction))
        gap = obstacles.nearest(points, group[source], distance + 2 * EXACT)
        good = (gap >= distance - EXACT) & ((gap <= distance + EXACT) | (lost & (fraction > 0)))
        # The first point of a rounded corner belongs to the segment before it as well; the others judge the corner.
        good |= (fraction == 0) & (lost | np.roll(lost, 1)) & (gap >= distance - EXACT)
        sound[segments.owner[~good]] = False
    return Beside(segments, closed, source, turn, lost, sound)


#: From this turn (rad) on an outer corner is sharp: the tool only rolls about it, so no force is put on (PIST 4.2.1).
_SHARP = np.radians(15.0)
#: The tool centre is never slowed below this part of the feed, however tight the inner curve.
_SLOWEST = 0.02


_COMMON = "edges on one line leave the tool no side; draw one outline, or use operation.kind = trace"


class _Loops(Struct, frozen=True, eq=False):
    """The contours that are followed. index: their place in the part. flip: run against the drawn direction so that
    the part is on the left. group: label per contour; what has one label is kept clear of. parent: -1 if none.
    depth: how many loops lie around.
    """

    index: list[int]
    flip: BoolArray
    group: IntArray
    parent: IntArray
    depth: IntArray


def follow(part: Part, job: Job) -> tuple[tuple[ToolPath, ...], tuple[Note, ...]]:
    """Paths beside the contours of ``part`` and what could not be followed."""
    loops, notes = _choose_sides(part, job.operation.side)
    if not loops.index:
        return (), tuple(notes)
    contours = [part.contours[k] for k in loops.index]
    drawn = from_contours(contours)
    source = _turn_round(drawn, loops.flip)
    closed = np.array([c.closed for c in contours])
    following = neighbours(source, closed)
    source, following = uncross(source, following, closed & find_slips(source, following, len(contours)))
    curve = beside(
        source, following, closed, loops.group[source.owner], job.tool.diameter / 2, job.operation.corner_radius
    )
    labels, order = _labels(curve, source, contours, loops, job)
    notes += _left_out(curve, source, contours, job, order)
    return _paths(curve, source, labels, order, job), tuple(notes)


def _choose_sides(part: Part, side: str) -> tuple[_Loops, list[Note]]:
    """Which contours are followed, and on which side."""
    if side in ("left", "right"):
        index = list(range(len(part.contours)))
        count = np.arange(len(index))
        return _Loops(index, np.full(len(index), side == "left"), count, np.full(len(index), -1), 0 * count), []
    index = [k for k, c in enumerate(part.contours) if c.closed]
    notes = _open_notes([c for c in part.contours if not c.closed])
    if not index:
        none = np.zeros(0, dtype=np.int64)
        return _Loops([], none == 0, none, none, none), notes
    nesting = nest(from_contours([part.contours[k] for k in index]), len(index))
    keep = np.flatnonzero((nesting.crossed < 0) & ~nesting.empty)
    notes += _crossing_notes([part.contours[k] for k in index], nesting)
    inside = {"auto": nesting.depth % 2 == 1, "outside": np.zeros(len(index), dtype=bool)}.get(
        side, np.ones(len(index), dtype=bool)
    )
    group = np.zeros(len(index), dtype=np.int64) if side == "auto" else np.arange(len(index))
    # The part on the left: outer loops counter-clockwise, holes clockwise.
    flip = (nesting.area > 0) == inside
    new = np.full(len(index), -1)
    new[keep] = np.arange(len(keep))
    parent = np.where(nesting.parent[keep] >= 0, new[nesting.parent[keep]], -1)
    return _Loops([index[k] for k in keep], flip[keep], group[keep], parent, nesting.depth[keep]), notes


def _open_notes(contours: list[Contour]) -> list[Note]:
    if not contours:
        return []
    gap = min(float(np.hypot(*(c.points[0] - c.points[-1]))) for c in contours)
    why = f"an open contour has no outside, the smallest gap between its ends is {gap:.3g} mm; raise input.join"
    why += " to close it, or set operation.side to left, right or on"
    return [_not_followed(contours, "open", why)]


def _crossing_notes(contours: list[Contour], nesting: Nesting) -> list[Note]:
    own = nesting.crossed == np.arange(len(contours))
    other = (nesting.crossed >= 0) & ~own
    why = "no clear inside; draw one outline, or use operation.kind = trace"
    return [
        _not_followed([contours[k] for k in np.flatnonzero(chosen).tolist()], how, why)
        for chosen, how in (
            (own & ~nesting.empty, "crossing themselves"),
            (other, "crossing each other"),
            (nesting.empty & ~other, "without an inside"),
        )
        if chosen.any()
    ]


def _not_followed(contours: list[Contour], how: str, why: str) -> Note:
    """One note on contours that have no path, all of them named."""
    layers = ", ".join(sorted({c.layer for c in contours}))
    ids = [c.id for c in contours]
    names = ", ".join(_ranges(ids))
    what = f"{counted(len(contours), 'contour')} not followed, {how}: {names} on layer {layers}"
    return Note("skipped", what, why, tuple(ids))


def _ranges(ids: list[str]) -> list[str]:
    """``c1, c2, c3, c7`` as ``c1-c3, c7``; ids of another form stay as they are."""
    runs: list[list[str]] = []
    for name in ids:
        follows = runs and name[1:].isdigit() and runs[-1][-1] == f"c{int(name[1:]) - 1}"
        if follows:
            runs[-1].append(name)
        else:
            runs.append([name])
    return [run[0] if len(run) == 1 else f"{run[0]}-{run[-1]}" for run in runs]


def _turn_round(drawn: Segments, flip: BoolArray) -> Segments:
    """The segments with the loops of ``flip`` run backwards."""
    back, _ = backwards(drawn)
    chosen = flip[drawn.owner]
    # Both tables hold each owner's segments in the same rows, so rows can be chosen one by one.
    rows = np.arange(len(drawn))
    pick = np.where(chosen, rows + len(drawn), rows)
    return Segments(
        *(np.concatenate([getattr(drawn, name), getattr(back, name)])[pick] for name in Segments.__struct_fields__)
    )


def _labels(
    curve: Beside, source: Segments, contours: list[Contour], loops: _Loops, job: Job
) -> tuple[list[Label], IntArray]:
    """Labels of the sound chains and their order: that of the contours they run beside for the longest part."""
    main, chain, contour = _beside_which(curve, source, len(contours))
    order = np.flatnonzero(curve.sound)
    order = order[np.argsort(main[order], kind="stable")]
    place = np.full(len(curve.closed), -1)
    place[order] = np.arange(len(order))
    # The first path beside each contour, also where its path is one with a neighbour's.
    first = np.full(len(contours), -1)
    pairs = np.flatnonzero(place[chain] >= 0)
    pairs = pairs[np.argsort(-place[chain[pairs]], kind="stable")]
    first[contour[pairs]] = place[chain[pairs]]
    several = np.bincount(main[order], minlength=len(contours)) > 1
    seen = [0] * len(contours)
    labels = []
    for c in order.tolist():
        k = int(main[c])
        seen[k] += 1
        name = f"{contours[k].id}.{seen[k]}" if several[k] else contours[k].id
        closed, parent = bool(curve.closed[c]), int(loops.parent[k])
        # A path that also runs beside the contour around it is not inside anything of that contour.
        around = int(first[parent]) if parent >= 0 else -1
        if around >= 0 and loops.depth[main[order[around]]] >= loops.depth[k]:
            around = -1
        reversible = job.operation.direction == "any" and not closed
        labels.append(Label(name, contours[k].layer, closed, reversible, around, (contours[k].id,)))
    return labels, order


def _beside_which(curve: Beside, source: Segments, count: int) -> tuple[IntArray, IntArray, IntArray]:
    """Per chain the contour that it runs beside for longest; and all pairs (chain, contour) that touch."""
    key = curve.segments.owner * count + source.owner[curve.source]
    keys, inverse = np.unique(key, return_inverse=True)
    total = np.bincount(inverse, curve.segments.length, len(keys))
    chain, contour = keys // count, keys % count
    main = np.full(len(curve.closed), -1)
    shortest_first = np.lexsort((total, chain))
    main[chain[shortest_first]] = contour[shortest_first]
    return main, chain, contour


def _left_out(curve: Beside, source: Segments, contours: list[Contour], job: Job, order: IntArray) -> list[Note]:
    """Notes on loops that have no path, and on the length that no tool of this size can touch."""
    touched = np.zeros(len(contours), dtype=bool)
    good = curve.sound[curve.segments.owner]
    touched[source.owner[curve.source[good]]] = True
    tool = f"a {job.tool.diameter:g} mm tool" + (
        f" with corner radius {job.operation.corner_radius:g}" if job.operation.corner_radius else ""
    )
    failed = np.isin(np.arange(len(contours)), source.owner[curve.source[~good]])
    shared = _sharing(source, failed)
    notes = [
        _not_followed([contours[k] for k in np.flatnonzero(chosen).tolist()], how, why)
        for chosen, how, why in (
            (~touched & ~failed, "too narrow", f"{tool} does not fit"),
            (~touched & failed & shared, "on a common edge", _COMMON),
            (~touched & failed & ~shared, "check failed", "the path did not keep its distance; please report it"),
        )
        if chosen.any()
    ]
    contact = _contact(curve, source)
    reached = np.bincount(source.owner[curve.source], np.where(good, contact, 0.0), len(contours))
    whole = np.bincount(source.owner, source.length, len(contours))
    missing = np.where(touched, np.maximum(whole - reached, 0.0), 0.0)
    total = float(missing.sum())
    if total > 1e-3 * float(whole.sum()) and total > 0.1:
        worst = contours[int(np.argmax(missing))].id
        what = f"{total:.4g} mm of {float(whole.sum()):.6g} mm of contour not touched, most of it on {worst}"
        notes.append(Note("warning", what, f"inner corners and narrow places that {tool} does not reach"))
    if len(order) < len(curve.closed) and not (failed & ~touched).any():
        what = f"{counted(len(curve.closed) - len(order), 'piece', 'pieces')} of path left out"
        unsound = "they did not keep their distance from the drawing; please report it"
        notes.append(Note("skipped", what, _COMMON if shared[failed].any() else unsound))
    return notes


def _sharing(source: Segments, failed: BoolArray) -> BoolArray:
    """(contours,): which of the ``failed`` ones have an edge on that of another."""
    shared = np.zeros(len(failed), dtype=bool)
    rows = np.flatnonzero(failed[source.owner])
    if not len(rows):
        return shared
    i, j = near_pairs(source, np.zeros(len(source), dtype=np.int64), EXACT)
    pairs = np.concatenate([np.column_stack([i, j]), np.column_stack([j, i])])
    pairs = pairs[failed[source.owner[pairs[:, 0]]] & (source.owner[pairs[:, 0]] != source.owner[pairs[:, 1]])]
    for fraction in (0.13, 0.37, 0.71):
        points = points_at(source.take(pairs[:, 0]), np.full(len(pairs), fraction))
        on = distances(points, source, pairs[:, 1]) < EXACT
        shared[source.owner[pairs[on, 0]]] = shared[source.owner[pairs[on, 1]]] = True
    return shared & failed


def _stretch(curve: Beside, source: Segments) -> FloatArray:
    """(N,) length of path per length of contour touched: R'/R on arcs, 1 on lines (PIST eq. 11, exact)."""
    touched = source.take(curve.source)
    arc = touched.is_arc & curve.segments.is_arc & (curve.turn == 0) & ~curve.lost
    with np.errstate(invalid="ignore"):
        return np.where(arc, curve.segments.radius / np.where(arc, touched.radius, 1.0), 1.0)


def _contact(curve: Beside, source: Segments) -> FloatArray:
    """(N,) mm of contour touched along each segment of the path."""
    length = curve.segments.length / _stretch(curve, source)
    return np.where((curve.turn > 0) | curve.lost, 0.0, length)


def _paths(curve: Beside, source: Segments, labels: list[Label], order: IntArray, job: Job) -> tuple[ToolPath, ...]:
    """The sound chains in order as tool paths, in the direction of the job."""
    process = job.process
    rounding = (curve.turn > 0) & ~curve.lost
    factor = np.clip(_stretch(curve, source), _SLOWEST, process.max_feed_factor)
    feed = process.feed * np.where(rounding, process.max_feed_factor, np.where(curve.lost, 1.0, factor))
    force = np.where(curve.lost | (curve.turn > _SHARP), 0.0, process.force)
    place = np.full(len(curve.closed), -1)
    place[order] = np.arange(len(order))
    rows = np.flatnonzero(place[curve.segments.owner] >= 0)
    rows = rows[np.argsort(place[curve.segments.owner[rows]], kind="stable")]
    segments = curve.segments.take(rows)
    segments = Segments(
        segments.start, segments.end, segments.bulge, segments.centre, segments.radius, place[segments.owner]
    )
    feed, force, side = feed[rows], force[rows], 1
    if job.operation.direction != "conventional":
        # Climb: the part on the right of the travel.
        segments, back = backwards(segments)
        feed, force, side = feed[back], force[back], -1
    press = sideways(segments, side)
    depths = pass_depths(job.operation.depth, job.operation.passes)
    return tool_paths(segments, labels, press, force, feed, depths, "follow")
