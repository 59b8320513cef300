"""Plans tool paths beside contours: outside outer loops, inside holes, with feed and force."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import compress

import numpy as np
import shapely
from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry.intersect import (
    find_near_pairs,
    measure_distances,
    measure_gaps,
    measure_nearest,
)
from camgen.geometry.nesting import (
    Nesting,
    find_enclosing,
    find_nesting,
    mark_small_crossings,
)
from camgen.geometry.ragged import list_owners, number_rows, select_distinct
from camgen.geometry.segments import (
    BoolArray,
    IntArray,
    Segments,
    concatenate,
    find_following,
    flatten,
    make_contour_segments,
    points_at,
    reverse_segments,
)
from camgen.geometry.uncross import find_slips, uncross_loops, weld_short
from camgen.model.job import Job
from camgen.model.part import (
    Contour,
    Note,
    Part,
    list_closed_rows,
    list_ids,
    list_layers,
    select_open,
    tabulate_contours,
)
from camgen.model.path import ToolPath
from camgen.model.pose import FloatArray
from camgen.model.sequences import take_rows
from camgen.model.text import counted, name_ranges, short
from camgen.plan.beside import (
    EXACT,
    OffsetCurve,
    explain_misfit,
    find_channel_lines,
    make_offset_curve,
    select_segments,
    with_centre_lines,
)
from camgen.plan.columns import (
    SLOWEST,
    Label,
    SegmentWork,
    compute_depths,
    compute_sideways,
    make_tool_paths,
)
from camgen.plan.contact_feed import CAPPED, note_contact_feed
from camgen.plan.finish import add_finishing
from camgen.plan.open_outlines import check_outlines
from camgen.plan.unused import check_rules
from camgen.read.join import Places, format_gaps

#: Minimum angle of a sharp outer corner, rad. The tool only rolls around it, so it gets no force
#: (PIST, section 4.2.1).
_SHARP = np.radians(15.0)
#: Largest rest material that counts as none, mm.
_NEGLIGIBLE_MM = 0.02
#: Minimum distance of samples along contours, mm, and approximate maximum number of them.
_SAMPLE_MM, _SAMPLES = 0.1, 50_000
_COMMON = (
    "edges on one line leave the tool no side; draw one outline, or use operation.kind = trace"
)
_CROSSING = "no clear inside; draw one outline, or use operation.kind = trace"
_UNWORKED = (
    "the tool would cut the edge of a contour that is not worked on; "
    "take a smaller one, or work on both"
)
_WITHOUT_INSIDE = (
    "the tool would cut a contour without a clear inside; take a smaller one, or draw one outline"
)
_FAILED = "the path did not keep its distance; please report it"


class _Loops(Struct, frozen=True, eq=False):
    """The contours that the tool follows or keeps clear of.

    index: index of each contour in the part.
    drawn: their segments.
    worked: true for the contours that the tool follows.
    flip: true for contours that are reversed, so that the part is on the left.
    group: label of each contour; a path keeps clear of all contours with the label of its own.
    parent: the contour around each, or -1.
    depth: number of contours around each.
    crossing: segments of the contours without a clear inside, which are left out.
    """

    index: list[int]
    drawn: Segments
    worked: BoolArray
    flip: BoolArray
    group: IntArray
    parent: IntArray
    depth: IntArray
    crossing: Segments

    def keep(self, rows: IntArray) -> _Loops:
        """The contours `rows`, in that order. The next one around each that is kept encloses it."""
        new = np.full(len(self.index), -1)
        new[rows] = np.arange(len(rows))
        parent = find_enclosing(self.parent, new >= 0)[rows]
        drawn = self.drawn.take(new[self.drawn.owner] >= 0)
        return _Loops(
            take_rows(self.index, rows),
            replace(drawn, owner=new[drawn.owner]),
            self.worked[rows],
            self.flip[rows],
            self.group[rows],
            np.where(parent >= 0, new[parent], -1),
            self.depth[rows],
            self.crossing,
        )


def follow(part: Part, job: Job) -> tuple[tuple[ToolPath, ...], tuple[Note, ...]]:
    """Plan paths beside the worked contours of `part`, with notes on those without a path.

    With `operation.finish` there are two paths for each: roughing passes, which leave that
    allowance, and a finishing pass. Raises JobError for a tool that does not cut sideways.
    """
    radius, finish = job.tool.radius, job.operation.finish
    check_rules(
        [
            (
                job.tool.kind == "drill",
                "a drill does not cut sideways",
                "tool.kind",
                "choose a mill",
            ),
            (
                finish != 0 and not job.operation.inside_first,
                "the allowance at the walls is taken last",
                "operation.inside_first",
                "leave it out, or operation.finish",
            ),
        ]
    )
    depths = compute_depths(job.operation.depth, job.operation.passes)
    if not finish:
        return run_beside(part, job, radius, depths, "follow")
    rough, _ = run_beside(part, job, radius + finish, depths, "follow")
    last, notes = run_beside(part, job, radius, depths, "follow")
    return add_finishing(rough, last, finish, notes)


def run_beside(
    part: Part,
    job: Job,
    distance: float,
    depths: tuple[float, ...],
    operation: str,
    reach: float = 0.0,
) -> tuple[tuple[ToolPath, ...], tuple[Note, ...]]:
    """Plan paths of the tool's centre at `distance` mm from the worked contours, with notes.

    The paths keep that distance from the other contours too, or `reach` mm if that is more.
    """
    loops, notes = _choose_sides(part, job.operation.side, job.input.join)
    if not loops.worked.any():
        return (), tuple(notes)
    curve, source = _offset(part, loops, distance, job, operation)
    contours = take_rows(part.contours, loops.index)
    radius = job.operation.corner_radius
    expected = loops.worked
    if not loops.worked.all():
        worked = loops.worked[source.owner]
        is_opposite = (curve.other >= 0) & worked[curve.other]
        curve = select_segments(curve, worked[curve.source] | is_opposite)
    # A roughing pass leaves its allowance at the contours that are worked on alone.
    clear = max(min(distance, job.tool.radius), reach)
    unworked = source.take(~loops.worked[source.owner] & (job.operation.side == "auto"))
    for others, least, how, why in (
        (unworked, reach, "too near to others", _UNWORKED),
        (loops.crossing, clear, "too near to crossing ones", _WITHOUT_INSIDE),
    ):
        is_near = _are_too_near(curve, others, least)
        if is_near.any():
            spoiled = np.zeros(len(contours), dtype=bool)
            spoiled[source.owner[curve.source[is_near]]] = True
            notes += _note_not_followed(list(compress(contours, spoiled)), how, why)
            curve = select_segments(curve, ~is_near)
            expected = expected & ~spoiled
    reached = curve
    if job.operation.rest:
        from camgen.plan.rest import keep_rest  # noqa: PLC0415 (only for jobs that ask for it)

        curve = keep_rest(curve, part, job)
        notes += _note_nothing_left(reached, curve, source, contours)
    labels, place = _make_labels(curve, source, contours, loops, job)
    tool = f"a V tool whose middle is {distance:.4g} mm off the wall"
    if operation == "follow":
        tool = f"a {job.tool.diameter:g} mm tool"
        if radius:
            tool += f" with corner radius {radius:g}"
    notes += _note_unfollowed(reached, source, contours, expected, tool, distance)
    if job.process.force:
        notes += _note_feeds(curve, source, contours, job)
    segments, work = _order_chains(curve, source, place, job)
    return make_tool_paths(segments, labels, work, depths, operation), tuple(notes)


def _offset(
    part: Part, loops: _Loops, distance: float, job: Job, operation: str
) -> tuple[OffsetCurve, Segments]:
    """The paths at `distance` mm from the contours, and the contours with the part on the left."""
    closed = tabulate_contours(take_rows(part.contours, loops.index)).closed
    source = reverse_loops(weld_short(loops.drawn, closed), loops.flip)
    following = find_following(source, closed)
    slips = closed & find_slips(source, following, len(closed))
    source, following = uncross_loops(source, following, slips)
    group = loops.group[source.owner]
    radius = job.operation.corner_radius
    curve = make_offset_curve(source, following, closed, group, distance, radius)
    if operation == "follow" and not radius:
        lines = find_channel_lines(
            curve.segments, source, following, group, distance, job.tolerance.arc_fit
        )
        curve = with_centre_lines(curve, lines)
        # What looks like a channel beside a common edge is the part of the other contour.
        sides = np.column_stack([curve.source, curve.other])
        in_channel = curve.other >= 0
        if in_channel.any():
            is_shared = np.isin(sides, curve.shared).any(axis=1)
            curve = select_segments(curve, ~(in_channel & is_shared))
    return curve, source


def _find_failed(curve: OffsetCurve, source: Segments, count: int) -> BoolArray:
    """(count,) true for contours beside which a path failed its check."""
    failed = np.zeros(count, dtype=bool)
    failed[source.owner[curve.source[~curve.sound[curve.segments.owner]]]] = True
    return failed


def _note_nothing_left(
    reached: OffsetCurve, curve: OffsetCurve, source: Segments, contours: list[Contour]
) -> Iterator[Note]:
    before = set(source.owner[reached.source].tolist())
    finished = sorted(before - set(source.owner[curve.source].tolist()))
    if finished:
        ids = list_ids(take_rows(contours, finished))
        yield Note(
            "assumed",
            f"nothing is left at {counted(len(ids), 'contour')}: {', '.join(name_ranges(ids))}",
            "earlier operations reach all that this tool does",
            ids,
            lacks="paths",
        )


def _are_too_near(curve: OffsetCurve, others: Segments, least: float) -> BoolArray:
    """(N,) true for the segments of all chains that come nearer than `least` mm to `others`."""
    near = np.zeros(len(curve.closed), dtype=bool)
    if least > 0 and len(others):
        gaps = measure_gaps(curve.segments, others, least - EXACT)
        near[curve.segments.owner[np.isfinite(gaps)]] = True
    return near[curve.segments.owner]


def _choose_sides(part: Part, side: str, join: float) -> tuple[_Loops, list[Note]]:
    chosen = part.list_worked_rows()
    selected = take_rows(part.contours, chosen)
    if side in ("left", "right"):
        index = chosen
        count = np.arange(len(index))
        drawn = make_contour_segments(selected)
        flip, parent = np.full(len(index), side == "left"), np.full(len(index), -1)
        none = drawn.take(drawn.owner < 0)
        return _Loops(index, drawn, count >= 0, flip, count, parent, 0 * count, none), []
    index = list_closed_rows(part.contours)
    notes = list(_note_open(select_open(selected), join))
    closed: Sequence[Contour] = part.contours
    # `part.contours` may be views of one table, which is then not copied.
    if len(index) < len(closed):
        closed = take_rows(closed, index)
    drawn = make_contour_segments(closed)
    nesting = mark_small_crossings(drawn, find_nesting(drawn, len(index)))
    worked = np.isin(index, chosen)
    if side == "auto":
        check_outlines(part, list_ids(selected), "set operation.side")
    is_clear = (nesting.crossed < 0) & ~nesting.empty
    notes += _note_crossing(closed, nesting, worked)
    inside = np.full(len(index), side != "outside")
    group = np.arange(len(index))
    if side == "auto":
        inside = nesting.depth % 2 == 1
        # Contours inside one without a clear inside have nothing to do with those outside of it.
        group = find_enclosing(nesting.parent, ~is_clear) + 1
    # The part on the left: outer loops counter-clockwise, holes clockwise.
    flip = (nesting.area > 0) == inside
    crossing = drawn.take(~is_clear[drawn.owner] & (side == "auto"))
    depth, parent = nesting.depth, nesting.parent
    loops = _Loops(index, drawn, worked, flip, group, parent, depth, crossing)
    return loops.keep(np.flatnonzero(is_clear)), notes


def _note_open(contours: list[Contour], join: float) -> Iterator[Note]:
    if contours:
        gaps, places = format_gaps([contour.points for contour in contours], join)
        remedy = f"{gaps}, or " if gaps else ""
        why = f"an open contour has no outside; {remedy}set operation.side to left, right or on"
        yield from _note_not_followed(contours, "open", why, places)


def _note_crossing(
    contours: Sequence[Contour], nesting: Nesting, worked: BoolArray
) -> Iterator[Note]:
    crosses_itself = nesting.crossed == np.arange(len(contours))
    crosses_other = (nesting.crossed >= 0) & ~crosses_itself
    for how, is_crossed in {
        "crossing or retracing themselves": crosses_itself & ~nesting.empty,
        "crossing each other": crosses_other,
        "without an inside": nesting.empty & ~crosses_other,
    }.items():
        yield from _note_not_followed(list(compress(contours, is_crossed & worked)), how, _CROSSING)


def _note_not_followed(
    contours: list[Contour], how: str, why: str, places: Places = ()
) -> Iterator[Note]:
    if contours:
        layers, ids = ", ".join(list_layers(contours)), list_ids(contours)
        names = ", ".join(name_ranges(ids))
        yield Note(
            "skipped",
            f"{counted(len(contours), 'contour')} not followed, {how}: {names} on layer {layers}",
            why,
            ids,
            places,
        )


def reverse_loops(drawn: Segments, flip: BoolArray) -> Segments:
    """The segments, with the contours `flip` (contours,) reversed."""
    reverse, _ = reverse_segments(drawn)
    # Both tables hold each owner's segments in the same rows, so rows can be chosen one by one.
    rows = np.arange(len(drawn))
    rows = np.where(flip[drawn.owner], rows + len(drawn), rows)
    return concatenate([drawn, reverse]).take(rows)


def _make_labels(
    curve: OffsetCurve, source: Segments, contours: list[Contour], loops: _Loops, job: Job
) -> tuple[list[Label], IntArray]:
    """The labels of the paths, and the index (chains,) of the path of each chain; -1 for none."""
    main, chain, contour = _match_contours(curve, source, len(contours))
    order = np.flatnonzero(curve.sound)
    order = order[np.argsort(main[order], kind="stable")]
    place = np.full(len(curve.closed), -1)
    place[order] = np.arange(len(order))
    # The first path beside each contour, also if that path follows another contour for longer.
    first = np.full(len(contours), -1)
    pairs = np.flatnonzero(place[chain] >= 0)
    pairs = pairs[np.argsort(-place[chain[pairs]], kind="stable")]
    first[contour[pairs]] = place[chain[pairs]]
    has_several = (np.bincount(main[order], minlength=len(contours)) > 1).tolist()
    seen = [0] * len(contours)
    main = main[order]
    around = _find_around(place[chain], contour, first, loops)
    # A path around two contours that touch works on both.
    others: dict[int, list[str]] = {}
    for path, k in zip(place[chain].tolist(), contour.tolist(), strict=True):
        if path >= 0 and k != main[path]:
            others.setdefault(path, []).append(contours[k].id)
    labels: list[Label] = []
    any_direction = job.operation.direction == "any"
    columns = main.tolist(), curve.closed[order].tolist(), around.tolist()
    for k, closed, outer in zip(*columns, strict=True):
        name, layer = contours[k].id, contours[k].layer
        names = (name, *others.get(len(labels), ()))
        seen[k] += 1
        if has_several[k]:
            name += f".{seen[k]}"
        labels.append(Label(name, layer, closed, any_direction and not closed, outer, names))
    return labels, place


def _find_around(path: IntArray, contour: IntArray, first: IntArray, loops: _Loops) -> IntArray:
    """(P,) the path around each path, or -1. It is around the outermost contour of the path.

    path, contour: (N,) pairs of a path, -1 for none, and a contour beside which it runs.
    first: (contours,) the first path beside each contour, or -1.
    """
    outermost = np.zeros(int(path.max(initial=-1)) + 1, dtype=np.int64)
    inner_first = np.argsort(-loops.depth[contour], kind="stable")
    inner_first = inner_first[path[inner_first] >= 0]
    outermost[path[inner_first]] = contour[inner_first]
    parent = find_enclosing(loops.parent, first >= 0)[outermost]
    return np.where(parent >= 0, first[parent], -1)


def _match_contours(
    curve: OffsetCurve, source: Segments, count: int
) -> tuple[IntArray, IntArray, IntArray]:
    """For each chain the contour that it follows for longest, and all pairs that touch.

    count: number of contours.
    Returns (chains,) contours, and chain and contour of each pair.
    """
    # In a channel as wide as the tool a chain touches both walls, and follows one of them.
    owner, length = curve.segments.owner, curve.segments.length
    both = np.flatnonzero(curve.other >= 0)
    first, second = source.owner[curve.source], source.owner[curve.other[both]]
    key = np.concatenate([owner * count + first, owner[both] * count + second])
    keys, inverse = np.unique(key, return_inverse=True)
    total = np.bincount(inverse, np.append(length, np.zeros(len(both))), len(keys))
    chain, contour = keys // count, keys % count
    main = np.full(len(curve.closed), -1)
    shortest_first = np.lexsort((total, chain))
    main[chain[shortest_first]] = contour[shortest_first]
    return main, chain, contour


def _note_unfollowed(
    curve: OffsetCurve,
    source: Segments,
    contours: list[Contour],
    worked: BoolArray,
    tool: str,
    distance: float,
) -> Iterator[Note]:
    """Notes on `worked` (contours,) without a path, and on the length that no path touches.

    tool: name of the tool in the notes.
    """
    touched = np.zeros(len(contours), dtype=bool)
    is_sound = curve.sound[curve.segments.owner]
    touched[source.owner[curve.source[is_sound]]] = True
    touched[source.owner[curve.other[is_sound & (curve.other >= 0)]]] = True
    failed = _find_failed(curve, source, len(contours))
    shared = np.isin(np.arange(len(contours)), source.owner[curve.shared]) & worked
    causes = _find_causes(source, contours, failed, shared)
    narrow = worked & ~touched & ~failed & ~shared
    too_narrow = (narrow, _explain_narrow(contours, narrow, tool, distance))
    for how, (cause, why) in {"too narrow": too_narrow, **causes}.items():
        yield from _note_not_followed(list(compress(contours, cause & ~touched)), how, why)
    if (shared & touched).any():
        names = ", ".join(name_ranges(list_ids(compress(contours, shared & touched))))
        yield Note("warning", f"common edges not followed: {names}", _COMMON)
    is_touching = is_sound & (curve.turn <= 0) & ~curve.lost
    contact = np.where(is_touching, curve.segments.length / _compute_ratio(curve, source), 0.0)
    reached = np.bincount(source.owner[curve.source], contact, len(contours))
    length = np.where(worked, np.bincount(source.owner, source.length, len(contours)), 0.0)
    missing = np.where(touched, np.maximum(length - reached, 0.0), 0.0)
    if _is_much(missing, length):
        missing = np.where(missing > 0, _measure_rest(curve, source, missing > 0, distance), 0.0)
    if _is_much(missing, length):
        lengths = f"{short(float(missing.sum()), 2)} mm of {short(float(length.sum()), 2)} mm"
        worst = contours[int(np.argmax(missing))].id
        yield Note(
            "warning",
            f"{lengths} of contour not touched, most of it on {worst}",
            f"inner corners and narrow places that {tool} does not reach",
        )
    partly = failed & touched
    if partly.any():
        is_lost = ~is_sound & partly[source.owner[curve.source]]
        pieces = len(select_distinct(curve.segments.owner[is_lost]))
        what = f"{counted(pieces, 'piece', 'pieces')} of path left out"
        why = next(why for cause, why in causes.values() if (cause & partly).any())
        yield Note("skipped", what, why, list_ids(compress(contours, partly)))


def _explain_narrow(contours: list[Contour], narrow: BoolArray, tool: str, distance: float) -> str:
    """Why `tool` does not fit into the contours `narrow` (contours,), with their width if known."""
    chosen = list(compress(contours, narrow))
    if not chosen or select_open(chosen) or tool[-4:] != "tool":
        return f"{tool} does not fit"
    points, owner = flatten(make_contour_segments(chosen), EXACT / 50)
    polygons = shapely.polygons(shapely.linearrings(points, indices=owner))
    return explain_misfit(shapely.buffer(polygons, 0, quad_segs=16), 2 * distance)


def _is_much(missing: FloatArray, length: FloatArray) -> bool:
    return float(missing.sum()) > max(1e-3 * float(length.sum()), 0.1)


def _measure_rest(
    curve: OffsetCurve, source: Segments, chosen: BoolArray, distance: float
) -> FloatArray:
    """(contours,) length of the `chosen` contours that no path passes at `distance`, mm.

    Rest material up to `_NEGLIGIBLE_MM` does not count: at the shallow inner corners of an outline
    from a photo the tool touches next to the corner.
    """
    rows = np.flatnonzero(chosen[source.owner])
    step = max(_SAMPLE_MM, float(source.length[rows].sum()) / _SAMPLES)
    count = np.maximum(np.ceil(source.length[rows] / step).astype(np.int64), 1)
    owner, place = list_owners(count), number_rows(count)
    points = points_at(source.take(rows[owner]), (place + 0.5) / count[owner])
    paths = curve.segments.take(curve.sound[curve.segments.owner])
    nearest = measure_nearest(points, paths, distance + 2 * _NEGLIGIBLE_MM)
    is_rest = nearest > distance + _NEGLIGIBLE_MM
    length = np.where(is_rest, source.length[rows[owner]] / count[owner], 0.0)
    return np.bincount(source.owner[rows[owner]], length, len(chosen)).astype(np.float64)


def _find_causes(
    source: Segments, contours: list[Contour], failed: BoolArray, shared: BoolArray
) -> dict[str, tuple[BoolArray, str]]:
    """The causes by which contours have no path: the contours (contours,) of each, and a remedy.

    failed: (contours,) those beside which a path failed its check.
    shared: (contours,) those with an edge of another one.

    A contour has one cause. `find_nesting` allows for crossings that may be slips of a drawing;
    they may still leave the path without a side.
    """
    shared = shared | _find_shared(source, failed)
    themselves, others = _find_meeting(source, contours, failed)
    themselves &= ~shared
    others &= ~shared & ~themselves
    return {
        "on a common edge": (shared, _COMMON),
        "crossing themselves": (themselves, _CROSSING),
        "crossing or touching each other": (others, _CROSSING),
        "check failed": (failed & ~shared & ~themselves & ~others, _FAILED),
    }


def _find_meeting(
    source: Segments, contours: list[Contour], failed: BoolArray
) -> tuple[BoolArray, BoolArray]:
    """(contours,) twice: `failed` contours that meet themselves, those that meet others."""
    themselves, others = np.zeros((2, len(failed)), dtype=bool)
    rows = np.flatnonzero(failed)
    if not len(rows):
        return themselves, others
    points, owner = flatten(source, EXACT / 4)
    closed = list_closed_rows(contours)
    first = np.searchsorted(owner, closed)
    owner = np.append(owner, closed)
    order = np.argsort(owner, kind="stable")
    lines = shapely.linestrings(np.vstack([points, points[first]])[order], indices=owner[order])
    themselves[rows] = ~shapely.is_simple(lines[rows])
    row, near = shapely.STRtree(lines).query(lines[rows], predicate="dwithin", distance=EXACT)
    others[rows[row[rows[row] != near]]] = True
    return themselves, others


def _find_shared(source: Segments, failed: BoolArray) -> BoolArray:
    """(contours,) true for `failed` contours with an edge on the edge of another one."""
    shared = np.zeros(len(failed), dtype=bool)
    if not failed[source.owner].any():
        return shared
    i, j = find_near_pairs(source, np.zeros(len(source), dtype=np.int64), EXACT)
    pairs = np.concatenate([np.column_stack([i, j]), np.column_stack([j, i])])
    pairs = pairs[
        failed[source.owner[pairs[:, 0]]] & (source.owner[pairs[:, 0]] != source.owner[pairs[:, 1]])
    ]
    for fraction in (0.13, 0.37, 0.71):
        points = points_at(source.take(pairs[:, 0]), np.full(len(pairs), fraction))
        is_shared = measure_distances(points, source, pairs[:, 1]) < EXACT
        shared[source.owner[pairs[is_shared, 0]]] = shared[source.owner[pairs[is_shared, 1]]] = True
    return shared & failed


def _compute_ratio(curve: OffsetCurve, source: Segments) -> FloatArray:
    """(N,) length of path per length of contour: R'/R on arcs, else 1 (exact PIST eq. 11)."""
    touched = source.take(curve.source)
    arc = touched.is_arc & curve.segments.is_arc & (curve.turn == 0) & ~curve.lost
    with np.errstate(invalid="ignore"):
        return np.where(arc, curve.segments.radius / np.where(arc, touched.radius, 1.0), 1.0)


def _note_feeds(
    curve: OffsetCurve, source: Segments, contours: list[Contour], job: Job
) -> Iterator[Note]:
    process = job.process
    factors = np.where(curve.sound[curve.segments.owner], _compute_ratio(curve, source), 1.0)
    slow = np.flatnonzero(factors > process.max_feed_factor * CAPPED)
    if not len(slow):
        return
    contour = source.owner[curve.source]
    worst = int(slow[factors[slow].argmax()])
    names = list_ids(take_rows(contours, np.unique(contour[slow])))
    what = "outer arcs slower than process.feed"
    yield note_contact_feed(
        what, contours[int(contour[worst])].id, float(factors[worst]), process, names
    )


def _order_chains(
    curve: OffsetCurve, source: Segments, place: IntArray, job: Job
) -> tuple[Segments, SegmentWork]:
    process = job.process
    rounding = (curve.turn > 0) & ~curve.lost
    factor = np.clip(_compute_ratio(curve, source), SLOWEST, process.max_feed_factor)
    factor = np.where(rounding, process.max_feed_factor, np.where(curve.lost, 1.0, factor))
    # Between two walls the tool cuts with all of its width: its centre has the feed.
    feed = process.feed * np.where(curve.other >= 0, 1.0, factor)
    force = np.where(curve.lost | (curve.turn > _SHARP), 0.0, process.force)
    rows = np.flatnonzero(place[curve.segments.owner] >= 0)
    rows = rows[np.argsort(place[curve.segments.owner[rows]], kind="stable")]
    segments = curve.segments.take(rows)
    segments = replace(segments, owner=place[segments.owner])
    feed, force, side = feed[rows], force[rows], 1
    if job.operation.direction != "conventional":
        # Climb: the part on the right of the travel.
        segments, back = reverse_segments(segments)
        feed, force, side = feed[back], force[back], -1
    return segments, SegmentWork(compute_sideways(segments, side), force, feed)
