"""Tool paths beside the contours: outer loops outside, holes inside, feed and force for a round tool."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import shapely
from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry.intersect import Obstacles, find_near_pairs, measure_distances, measure_nearest
from camgen.geometry.nesting import Nesting, find_nesting
from camgen.geometry.ragged import owners, ramp
from camgen.geometry.segments import (
    BoolArray,
    IntArray,
    Segments,
    find_following,
    flatten,
    from_contours,
    points_at,
    reverse_segments,
)
from camgen.geometry.uncross import find_slips, uncross_loops
from camgen.model.errors import JobError
from camgen.model.job import Job
from camgen.model.part import Contour, Note, Part
from camgen.model.path import ToolPath
from camgen.model.pose import FloatArray
from camgen.model.text import counted, name_ranges
from camgen.plan.beside import (
    EXACT,
    Beside,
    beside,
    centre_lines,
    does_not_fit,
    only_along,
    only_chains,
    with_centre_lines,
)
from camgen.plan.columns import SLOWEST, Label, SegmentWork, pass_depths, sideways, tool_paths
from camgen.plan.contact_feed import CAPPED, note_contact_feed
from camgen.plan.finish import rough_then_last
from camgen.plan.open_outlines import check_outlines
from camgen.read.join import tell_gaps

#: From this turn (rad) on an outer corner is sharp: the tool only rolls about it, so no force is put on (PIST 4.2.1).
_SHARP = np.radians(15.0)
#: What is left standing by no more, mm, counts as touched. Contours are looked at every so many mm, at so many places.
_UNSEEN_MM, _SAMPLE_MM, _SAMPLES = 0.02, 0.1, 50_000
_COMMON = (
    "edges on one line leave the tool no side; draw one outline, or use operation.kind = trace"
)
_CROSSING = "no clear inside; draw one outline, or use operation.kind = trace"
_FAILED = "the path did not keep its distance; please report it"


class _Loops(Struct, frozen=True, eq=False):
    """The contours that the tool keeps clear of. index: their place in the part. drawn: their segments. worked: which
    of them it follows. flip: run against the drawn direction so that the part is on the left. group: label per contour;
    what has one label is kept clear of. parent: -1 if none. depth: how many loops lie around.
    """

    index: list[int]
    drawn: Segments
    worked: BoolArray
    flip: BoolArray
    group: IntArray
    parent: IntArray
    depth: IntArray


def follow(part: Part, job: Job) -> tuple[tuple[ToolPath, ...], tuple[Note, ...]]:
    """Paths beside the contours of ``part`` that are worked on, and what could not be followed.

    With ``operation.finish`` all of them twice: with that left in all passes, then at the whole depth without. JobError
    for a tool that does not cut sideways.
    """
    if job.tool.kind == "drill":
        raise JobError("job", "a drill does not cut sideways", "tool.kind", "choose a mill")
    radius, finish = job.tool.radius, job.operation.finish
    depths = pass_depths(job.operation.depth, job.operation.passes)
    if not finish:
        return run_beside(part, job, radius, depths, "follow")
    if not job.operation.inside_first:
        what = "what is left at the walls is taken last"
        raise JobError("job", what, "operation.inside_first", "leave it out, or operation.finish")
    rough, _ = run_beside(part, job, radius + finish, depths, "follow")
    last, notes = run_beside(part, job, radius, depths, "follow")
    return rough_then_last(rough, last, finish, notes)


def run_beside(
    part: Part,
    job: Job,
    distance: float,
    depths: tuple[float, ...],
    operation: str,
    reach: float = 0.0,
) -> tuple[tuple[ToolPath, ...], tuple[Note, ...]]:
    """Paths of the tool's centre at ``distance`` mm from the contours of ``part`` that are worked on, and notes.

    The other contours are kept clear of by that too, or by ``reach`` mm if that is more.
    """
    loops, notes = _choose_sides(part, job.operation.side, job.input.join)
    if not loops.worked.any():
        return (), tuple(notes)
    contours = [part.contours[k] for k in loops.index]
    source = turn_round(loops.drawn, loops.flip)
    closed = np.array([c.closed for c in contours])
    following = find_following(source, closed)
    source, following = uncross_loops(
        source, following, closed & find_slips(source, following, len(contours))
    )
    curve = beside(
        source, following, closed, loops.group[source.owner], distance, job.operation.corner_radius
    )
    if operation == "follow" and not job.operation.corner_radius:
        group = loops.group[source.owner]
        lines = centre_lines(
            curve.segments, source, following, group, distance, job.tolerance.arc_fit
        )
        curve = with_centre_lines(curve, lines)
    looked_at = loops.worked
    if not loops.worked.all():
        worked = loops.worked[source.owner]
        beyond = (curve.other >= 0) & worked[curve.other]
        curve = only_along(curve, worked[curve.source] | beyond)
        near = _too_near(curve, source, loops, reach)
        spoiled = np.isin(
            np.arange(len(contours)), source.owner[curve.source[near[curve.segments.owner]]]
        )
        notes += _near_note([contours[k] for k in np.flatnonzero(spoiled).tolist()])
        curve = only_chains(curve, ~near)
        looked_at = looked_at & ~spoiled
    reached = curve
    if job.operation.rest:
        from camgen.plan.rest import keep_rest  # noqa: PLC0415 (only for jobs that ask for it)

        curve = keep_rest(curve, part, job)
        notes += _nothing_left(reached, curve, source, contours)
    labels, order = _labels(curve, source, contours, loops, job)
    tool = f"a {job.tool.diameter:g} mm tool" + (
        f" with corner radius {job.operation.corner_radius:g}"
        if job.operation.corner_radius
        else ""
    )
    tool = (
        tool
        if operation == "follow"
        else f"a V tool whose middle is {distance:.4g} mm off the wall"
    )
    notes += _left_out(reached, source, contours, looked_at, tool, distance)
    if job.process.force:
        notes += _note_feeds(curve, source, contours, job)
    segments, work = _order_chains(curve, source, order, job)
    return tool_paths(segments, labels, work, depths, operation), tuple(notes)


def _nothing_left(
    reached: Beside, curve: Beside, source: Segments, contours: list[Contour]
) -> list[Note]:
    """A note on the contours of `reached` at which earlier operations leave nothing for `curve`."""
    before = set(source.owner[reached.source].tolist())
    done = sorted(before - set(source.owner[curve.source].tolist()))
    if not done:
        return []
    ids = [contours[k].id for k in done]
    what = f"nothing is left at {counted(len(ids), 'contour')}: {', '.join(name_ranges(ids))}"
    return [Note("assumed", what, "earlier operations reach all that this tool does", tuple(ids))]


def _too_near(curve: Beside, source: Segments, loops: _Loops, reach: float) -> BoolArray:
    """(chains,): which come nearer than ``reach`` mm to a contour that is not worked on."""
    near = np.zeros(len(curve.closed), dtype=bool)
    others = source.take(~loops.worked[source.owner])
    if not reach or not len(others):
        return near
    obstacles = Obstacles(others, loops.group[others.owner])
    for fraction in np.linspace(0.0, 1.0, 9):
        points = points_at(curve.segments, np.full(len(curve.segments), fraction))
        gap = obstacles.nearest(points, loops.group[source.owner[curve.source]], reach)
        near[curve.segments.owner[gap < reach - EXACT]] = True
    return near


def _near_note(contours: list[Contour]) -> list[Note]:
    if not contours:
        return []
    why = "the tool would cut the edge of a contour that is not worked on; take a smaller one, or work on both"
    return [_not_followed(contours, "too near to others", why)]


def _choose_sides(part: Part, side: str, join: float) -> tuple[_Loops, list[Note]]:
    """Which contours are followed, and on which side; with "auto" the others are kept clear of as well."""
    chosen = np.array([part.works_on(c.sources or (c.id,)) for c in part.contours], dtype=bool)
    if side in ("left", "right"):
        index = np.flatnonzero(chosen).tolist()
        count = np.arange(len(index))
        none = np.full(len(index), -1)
        drawn = from_contours([part.contours[k] for k in index])
        return _Loops(
            index, drawn, count >= 0, np.full(len(index), side == "left"), count, none, 0 * count
        ), []
    index = [k for k, c in enumerate(part.contours) if c.closed]
    notes = _open_notes(
        [c for c, mine in zip(part.contours, chosen, strict=True) if mine and not c.closed], join
    )
    if not index:
        none = np.zeros(0, dtype=np.int64)
        return _Loops([], from_contours([]), none == 0, none == 0, none, none, none), notes
    everything = len(index) == len(part.contours)
    drawn = from_contours(part.contours if everything else [part.contours[k] for k in index])
    nesting = find_nesting(drawn, len(index))
    worked = chosen[index]
    if side == "auto":
        decided = {part.contours[k].id for k in np.flatnonzero(chosen).tolist()}
        check_outlines(part, decided, "set operation.side")
    keep = np.flatnonzero((nesting.crossed < 0) & ~nesting.empty)
    notes += _crossing_notes([part.contours[k] for k in index], nesting, worked)
    inside = {"auto": nesting.depth % 2 == 1, "outside": np.zeros(len(index), dtype=bool)}.get(
        side, np.ones(len(index), dtype=bool)
    )
    group = np.zeros(len(index), dtype=np.int64) if side == "auto" else np.arange(len(index))
    # The part on the left: outer loops counter-clockwise, holes clockwise.
    flip = (nesting.area > 0) == inside
    new = np.full(len(index), -1)
    new[keep] = np.arange(len(keep))
    parent = np.where(nesting.parent[keep] >= 0, new[nesting.parent[keep]], -1)
    drawn = drawn.take(new[drawn.owner] >= 0)
    drawn = replace(drawn, owner=new[drawn.owner])
    kept = [index[k] for k in keep]
    return _Loops(
        kept, drawn, worked[keep], flip[keep], group[keep], parent, nesting.depth[keep]
    ), notes


def _open_notes(contours: list[Contour], join: float) -> list[Note]:
    if not contours:
        return []
    told, places = tell_gaps([contour.points for contour in contours], join)
    why = (
        "an open contour has no outside; "
        + (f"{told}, or " if told else "")
        + "set operation.side to left, right or on"
    )
    return [replace(_not_followed(contours, "open", why), places=places)]


def _crossing_notes(contours: list[Contour], nesting: Nesting, worked: BoolArray) -> list[Note]:
    unclear = ((nesting.crossed >= 0) | nesting.empty) & ~worked
    others = [contours[k].id for k in np.flatnonzero(unclear).tolist()]
    warned = []
    if others:
        what = (
            f"{counted(len(others), 'contour')} not kept clear of: {', '.join(name_ranges(others))}"
        )
        warned = [Note("warning", what, "no clear inside, and not worked on", tuple(others))]
    own = nesting.crossed == np.arange(len(contours))
    other = (nesting.crossed >= 0) & ~own
    return warned + [
        _not_followed(
            [contours[k] for k in np.flatnonzero(chosen & worked).tolist()], how, _CROSSING
        )
        for chosen, how in (
            (own & ~nesting.empty, "crossing themselves"),
            (other, "crossing each other"),
            (nesting.empty & ~other, "without an inside"),
        )
        if (chosen & worked).any()
    ]


def _not_followed(contours: list[Contour], how: str, why: str) -> Note:
    """One note on contours that have no path, all of them named."""
    layers = ", ".join(sorted({c.layer for c in contours}))
    ids = [c.id for c in contours]
    names = ", ".join(name_ranges(ids))
    what = f"{counted(len(contours), 'contour')} not followed, {how}: {names} on layer {layers}"
    return Note("skipped", what, why, tuple(ids))


def turn_round(drawn: Segments, flip: BoolArray) -> Segments:
    """The segments with the loops of ``flip`` run backwards."""
    back, _ = reverse_segments(drawn)
    chosen = flip[drawn.owner]
    # Both tables hold each owner's segments in the same rows, so rows can be chosen one by one.
    rows = np.arange(len(drawn))
    pick = np.where(chosen, rows + len(drawn), rows)
    return Segments(
        *(
            np.concatenate([getattr(drawn, name), getattr(back, name)])[pick]
            for name in Segments.__struct_fields__
        )
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
    several = (np.bincount(main[order], minlength=len(contours)) > 1).tolist()
    seen = [0] * len(contours)
    own, parent = main[order], loops.parent[main[order]]
    around = np.where(parent >= 0, first[parent], -1)
    # A path that also runs beside the contour around it is not inside anything of that contour.
    around[(around >= 0) & (loops.depth[own[around]] >= loops.depth[own])] = -1
    # A path around two contours that touch works on both.
    others: dict[int, list[str]] = {}
    for path, k in zip(place[chain].tolist(), contour.tolist(), strict=True):
        if path >= 0 and k != own[path]:
            others.setdefault(path, []).append(contours[k].id)
    labels: list[Label] = []
    either = job.operation.direction == "any"
    for k, closed, outer in zip(
        own.tolist(), curve.closed[order].tolist(), around.tolist(), strict=True
    ):
        name = contours[k].id
        names = (name, *others.get(len(labels), ()))
        seen[k] += 1
        number = f".{seen[k]}" if several[k] else ""
        labels.append(
            Label(name + number, contours[k].layer, closed, either and not closed, outer, names)
        )
    return labels, order


def _beside_which(
    curve: Beside, source: Segments, count: int
) -> tuple[IntArray, IntArray, IntArray]:
    """Per chain the contour that it runs beside for longest; and all pairs (chain, contour) that touch."""
    key = curve.segments.owner * count + source.owner[curve.source]
    keys, inverse = np.unique(key, return_inverse=True)
    total = np.bincount(inverse, curve.segments.length, len(keys))
    chain, contour = keys // count, keys % count
    main = np.full(len(curve.closed), -1)
    shortest_first = np.lexsort((total, chain))
    main[chain[shortest_first]] = contour[shortest_first]
    return main, chain, contour


def _left_out(
    curve: Beside,
    source: Segments,
    contours: list[Contour],
    worked: BoolArray,
    tool: str,
    distance: float,
) -> list[Note]:
    """Notes on loops of ``worked`` (contours,) without a path, and on the length that no ``tool`` touches."""
    touched = np.zeros(len(contours), dtype=bool)
    good = curve.sound[curve.segments.owner]
    touched[source.owner[curve.source[good]]] = True
    touched[source.owner[curve.other[good & (curve.other >= 0)]]] = True
    failed = np.isin(np.arange(len(contours)), source.owner[curve.source[~good]])
    causes = _find_causes(source, contours, failed)
    narrow = worked & ~touched & ~failed
    notes = []
    for how, (cause, why) in {
        "too narrow": (narrow, _why_narrow(contours, narrow, tool, distance)),
        **causes,
    }.items():
        numbers = np.flatnonzero(cause & ~touched).tolist()
        if numbers:
            notes.append(_not_followed([contours[k] for k in numbers], how, why))
    contact = _contact(curve, source)
    reached = np.bincount(source.owner[curve.source], np.where(good, contact, 0.0), len(contours))
    whole = np.where(worked, np.bincount(source.owner, source.length, len(contours)), 0.0)
    missing = np.where(touched, np.maximum(whole - reached, 0.0), 0.0)
    if _is_much(missing, whole):
        missing = np.where(missing > 0, _left_standing(curve, source, missing > 0, distance), 0.0)
    total = float(missing.sum())
    if _is_much(missing, whole):
        worst = contours[int(np.argmax(missing))].id
        what = f"{total:.4g} mm of {float(whole.sum()):.6g} mm of contour not touched, most of it on {worst}"
        notes.append(
            Note("warning", what, f"inner corners and narrow places that {tool} does not reach")
        )
    unsound = int((~curve.sound).sum())
    if unsound and not (failed & ~touched).any():
        what = f"{counted(unsound, 'piece', 'pieces')} of path left out"
        why = next(why for cause, why in causes.values() if cause.any())
        ids = tuple(contours[k].id for k in np.flatnonzero(failed).tolist())
        notes.append(Note("skipped", what, why, ids))
    return notes


def _why_narrow(contours: list[Contour], narrow: BoolArray, tool: str, distance: float) -> str:
    """Why ``tool`` does not fit into the ``narrow`` (contours,), with their width if known."""
    chosen = [contours[k] for k in np.flatnonzero(narrow).tolist()]
    if not chosen or not all(contour.closed for contour in chosen) or tool[-4:] != "tool":
        return f"{tool} does not fit"
    points, owner = flatten(from_contours(chosen), EXACT / 50)
    areas = [shapely.Polygon(points[owner == k]).buffer(0) for k in range(len(chosen))]
    return does_not_fit(areas, 2 * distance)


def _is_much(missing: FloatArray, whole: FloatArray) -> bool:
    """Whether so much of the contours, mm, is worth a note."""
    return float(missing.sum()) > max(1e-3 * float(whole.sum()), 0.1)


def _left_standing(curve: Beside, source: Segments, mine: BoolArray, distance: float) -> FloatArray:
    """(contours,): mm of the contours ``mine`` that no path passes at ``distance``, or so little farther that nothing
    is seen of it: at the shallow inner corners of an outline from a photo the tool touches next to them.
    """
    rows = np.flatnonzero(mine[source.owner])
    total = float(source.length[rows].sum())
    step = max(_SAMPLE_MM, total / _SAMPLES)
    count = np.maximum(np.ceil(source.length[rows] / step).astype(np.int64), 1)
    of, place = owners(count), ramp(count)
    points = points_at(source.take(rows[of]), (place + 0.5) / count[of])
    ways = curve.segments.take(curve.sound[curve.segments.owner])
    gap = measure_nearest(points, ways, distance + 2 * _UNSEEN_MM)
    length = np.where(gap > distance + _UNSEEN_MM, source.length[rows[of]] / count[of], 0.0)
    return np.bincount(source.owner[rows[of]], length, len(mine)).astype(np.float64)


def _find_causes(
    source: Segments, contours: list[Contour], failed: BoolArray
) -> dict[str, tuple[BoolArray, str]]:
    """The causes for which contours have no path: which ones (contours,) each has, and a remedy.

    A contour has one cause. Crossings that `find_nesting` allows may be slips of a drawing. They
    may still leave the path without a side.
    """
    shared = _sharing(source, failed)
    themselves, others = _meeting(source, contours, failed)
    themselves &= ~shared
    others &= ~shared & ~themselves
    return {
        "on a common edge": (shared, _COMMON),
        "crossing themselves": (themselves, _CROSSING),
        "crossing or touching each other": (others, _CROSSING),
        "check failed": (failed & ~shared & ~themselves & ~others, _FAILED),
    }


def _meeting(
    source: Segments, contours: list[Contour], failed: BoolArray
) -> tuple[BoolArray, BoolArray]:
    """Which of the ``failed`` contours (contours,) meet themselves, and which meet another."""
    themselves, others = np.zeros((2, len(failed)), dtype=bool)
    rows = np.flatnonzero(failed)
    if not len(rows):
        return themselves, others
    points, owner = flatten(source, EXACT / 4)
    closed = np.flatnonzero([contour.closed for contour in contours])
    first = np.searchsorted(owner, closed)
    owner = np.append(owner, closed)
    order = np.argsort(owner, kind="stable")
    lines = shapely.linestrings(np.vstack([points, points[first]])[order], indices=owner[order])
    themselves[rows] = ~shapely.is_simple(lines[rows])
    tree = shapely.STRtree(lines)
    row, near = tree.query(lines[rows], predicate="dwithin", distance=EXACT)
    others[rows[row[rows[row] != near]]] = True
    return themselves, others


def _sharing(source: Segments, failed: BoolArray) -> BoolArray:
    """(contours,): which of the ``failed`` ones have an edge on that of another."""
    shared = np.zeros(len(failed), dtype=bool)
    rows = np.flatnonzero(failed[source.owner])
    if not len(rows):
        return shared
    i, j = find_near_pairs(source, np.zeros(len(source), dtype=np.int64), EXACT)
    pairs = np.concatenate([np.column_stack([i, j]), np.column_stack([j, i])])
    pairs = pairs[
        failed[source.owner[pairs[:, 0]]] & (source.owner[pairs[:, 0]] != source.owner[pairs[:, 1]])
    ]
    for fraction in (0.13, 0.37, 0.71):
        points = points_at(source.take(pairs[:, 0]), np.full(len(pairs), fraction))
        on = measure_distances(points, source, pairs[:, 1]) < EXACT
        shared[source.owner[pairs[on, 0]]] = shared[source.owner[pairs[on, 1]]] = True
    return shared & failed


def _stretch(curve: Beside, source: Segments) -> FloatArray:
    """(N,) length of path per length of contour touched: R'/R on arcs, 1 on lines (PIST eq. 11, exact)."""
    touched = source.take(curve.source)
    arc = touched.is_arc & curve.segments.is_arc & (curve.turn == 0) & ~curve.lost
    with np.errstate(invalid="ignore"):
        return np.where(arc, curve.segments.radius / np.where(arc, touched.radius, 1.0), 1.0)


def _note_feeds(
    curve: Beside, source: Segments, contours: list[Contour], job: Job
) -> Iterator[Note]:
    """The contours that a pressing tool follows slower than the feed of the job, by its factor."""
    process = job.process
    factors = np.where(curve.sound[curve.segments.owner], _stretch(curve, source), 1.0)
    slow = np.flatnonzero(factors > process.max_feed_factor * CAPPED)
    if not len(slow):
        return
    contour = source.owner[curve.source]
    worst = int(slow[factors[slow].argmax()])
    names = tuple(contours[k].id for k in np.unique(contour[slow]).tolist())
    what = "outer arcs slower than process.feed"
    name = contours[int(contour[worst])].id
    yield note_contact_feed(what, name, float(factors[worst]), process, names)


def _contact(curve: Beside, source: Segments) -> FloatArray:
    """(N,) mm of contour touched along each segment of the path."""
    length = curve.segments.length / _stretch(curve, source)
    return np.where((curve.turn > 0) | curve.lost, 0.0, length)


def _order_chains(
    curve: Beside, source: Segments, order: IntArray, job: Job
) -> tuple[Segments, SegmentWork]:
    """The sound chains in order, in the direction of the job, with force and feed."""
    process = job.process
    rounding = (curve.turn > 0) & ~curve.lost
    factor = np.clip(_stretch(curve, source), SLOWEST, process.max_feed_factor)
    factor = np.where(rounding, process.max_feed_factor, np.where(curve.lost, 1.0, factor))
    # Between two walls the tool cuts with all of its width: its centre has the feed.
    feed = process.feed * np.where(curve.other >= 0, 1.0, factor)
    force = np.where(curve.lost | (curve.turn > _SHARP), 0.0, process.force)
    place = np.full(len(curve.closed), -1)
    place[order] = np.arange(len(order))
    rows = np.flatnonzero(place[curve.segments.owner] >= 0)
    rows = rows[np.argsort(place[curve.segments.owner[rows]], kind="stable")]
    segments = curve.segments.take(rows)
    segments = replace(segments, owner=place[segments.owner])
    feed, force, side = feed[rows], force[rows], 1
    if job.operation.direction != "conventional":
        # Climb: the part on the right of the travel.
        segments, back = reverse_segments(segments)
        feed, force, side = feed[back], force[back], -1
    return segments, SegmentWork(sideways(segments, side), force, feed)
