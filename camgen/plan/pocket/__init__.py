"""Pockets: what closed contours enclose is cleared from the middle outwards, each pass at one distance from the walls.

Outermost loops are walls, loops in them islands, loops in islands walls again. The passes are exact offsets: arcs stay
arcs, and the last one runs along the walls.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import NDArray

from camgen.geometry.intersect import nearest_distances
from camgen.geometry.nesting import Nesting, nest
from camgen.geometry.segments import (
    Segments,
    concatenate,
    flatten,
    from_contours,
    neighbours,
    points_at,
)
from camgen.geometry.uncross import find_slips, uncross
from camgen.model.errors import InputError, JobError
from camgen.model.job import Job
from camgen.model.part import Contour, Note, Part
from camgen.model.path import ToolPath
from camgen.model.pose import FloatArray
from camgen.model.text import counted, name_ranges, short
from camgen.plan.beside import NO_HELIX, centre_lines, does_not_fit
from camgen.plan.columns import (
    SLOWEST,
    Label,
    SegmentWork,
    pass_depths,
    plunge_path,
    sideways,
    tool_paths,
)
from camgen.plan.follow import turn_round
from camgen.plan.open_outlines import check_outlines
from camgen.plan.pocket.channel import Channel, plan_channels
from camgen.plan.pocket.engagement import measure_engagement
from camgen.plan.pocket.engagement_limit import EngagementLimit
from camgen.plan.pocket.hops import Speeds, add_hops, lift_hops, make_cleared_area
from camgen.plan.pocket.linking import LinkedPasses, find_outermost, link_passes
from camgen.plan.pocket.medial_axis import compute_medial_axis
from camgen.plan.pocket.regions import (
    CHORD_MM,
    MIN_CORNERS,
    QUARTER_CHORDS,
    OffsetRegion,
    PocketWalls,
    RegionForest,
    compute_regions,
    compute_wall_passes,
    make_pocket_polygon,
    select_pockets,
)

#: Passes that overlap by less than a twentieth of the tool leave ridges on a real machine.
_MOST_STEP = 0.95
#: A helix into the material is no wider than this share of the tool's diameter: a wider one leaves a core.
_HELIX_SHARE = 0.45
#: What stays of a corner is shown as a place from this share of the tool's disc on.
_PLACE_SHARE = 0.02
#: Where no engagement is asked for it may be more than that of a straight pass by so much of the diameter.
_MORE = 0.15
#: Less more than that leaves no room for a link from pass to pass.
_LEAST_MORE = 0.05
#: From this engagement on a pass is as good as a slot.
_MUCH = 0.9
#: A pass takes what is nowhere wider than twice this share of the tool's radius along with its own.
_THIN_SHARE = 0.05
#: A bound of this and more is none.
_MOST_BOUND = 0.995
#: Samples of the walls lie so far apart where the ridge between them is looked for, as a share of the tool's radius.
_SPACING = 0.2
#: Places that are named at most, and in a text.
_MOST_PLACES, _NAMED = 100, 4
#: A pass is along a wall if it is no farther from it than the first one by this, mm.
_AT_WALL = 0.05
_NOTHING = shapely.Polygon()
#: A loop of a wall that crosses itself is a slip of the drawing if no wider disc fits in it, mm.
_SLIP = 0.02


class _Pockets(Struct, frozen=True, eq=False):
    """ground: the walls, the material on their left. names, layers, contours: by pocket, those of its outer wall, and
    the ids of all its walls.

    cleared: polygons that earlier operations clear, for `operation.rest`; empty without it.
    """

    ground: PocketWalls
    names: list[str]
    layers: list[str]
    contours: list[tuple[str, ...]]
    cleared: Any = _NOTHING


def pocket(part: Part, job: Job) -> tuple[tuple[ToolPath, ...], tuple[Note, ...]]:
    """Paths that clear what the contours worked on enclose, and notes on what is not reached.

    Raises InputError where nothing is closed, JobError for settings that make no sense.
    """
    _refuse(job)
    contours = [c for c in part.contours if part.works_on((c.id,))]
    if not any(c.closed for c in contours):
        raise InputError(
            part.source,
            "no closed contour to clear",
            remedy="close its outlines, or raise input.join",
        )
    decided = {contour.id for contour in contours}
    check_outlines(
        replace(part, contours=tuple(contours)), decided, "leave it out of what is cleared"
    )
    pockets, notes = _find(contours)
    if not pockets.names:
        return (), tuple(notes)
    if job.operation.rest:
        pockets, done = _keep_rest(pockets, part, job)
        notes += done
    radius, finish = job.tool.radius, job.operation.finish
    step = job.operation.stepover * job.tool.diameter
    climb = job.operation.direction != "conventional"
    rough = compute_regions(pockets.ground, radius + finish, step, radius, climb)
    walls = compute_wall_passes(pockets.ground, radius, climb) if finish else rough
    failed = rough.failed | walls.failed
    own = [
        pockets.ground.segments.take(pockets.ground.pocket == k) for k in range(len(pockets.names))
    ]
    bound = _bound(job)
    pieces, opened = _open(_without(rough.regions, failed), pockets, bound, job)
    walks = sorted_by_pocket(link_passes(pieces, own, radius + finish, step, opened, bound))
    walks = _with_hops(walks, pieces, opened, job)
    borders = [piece for piece in _without(walls.regions, failed) if piece.parent < 0]
    slots = _slots(walls, pockets.ground, job)
    paths = _paths(walks, borders if finish else [], pieces, pockets, job)
    paths = (*paths, *_slot_paths(slots, pockets, job))
    notes += _tell_failed(failed, borders, slots, pockets, job)
    notes += _tell_passes(walks, pieces, opened, pockets, job)
    notes += _tell_slots(slots, pockets)
    return paths, (*notes, *_tell_unreached(borders, slots, pockets, job))


def _keep_rest(pockets: _Pockets, part: Part, job: Job) -> tuple[_Pockets, list[Note]]:
    """The areas of the pockets that earlier operations leave, and a note on pockets without any.

    JobError if no operation with a larger tool comes before.
    """
    from camgen.plan.pocket.rest import find_rest_of_pockets  # noqa: PLC0415 (only where asked for)

    rest = find_rest_of_pockets(pockets.ground, part, job)
    names: list[str] = []
    for n, k in enumerate(rest.pocket):
        number = rest.pocket[: n + 1].count(k)
        names.append(f"{pockets.names[k]}.rest{number}")
    layers = [pockets.layers[k] for k in rest.pocket]
    contours = [pockets.contours[k] for k in rest.pocket]
    cleared = [k for k in range(len(pockets.names)) if k not in rest.pocket]
    notes: list[Note] = []
    if cleared:
        walls = [pockets.names[k] for k in cleared]
        count = counted(len(walls), "pocket")
        what = f"nothing is left of {count}: {', '.join(name_ranges(walls))}"
        why = "earlier operations reach all that this tool does"
        ids: list[str] = []
        for k in cleared:
            ids += pockets.contours[k]
        notes.append(Note("assumed", what, why, tuple(ids)))
    return _Pockets(rest.ground, names, layers, contours, rest.cleared), notes


class _Slots(Struct, frozen=True, eq=False):
    """Channels as wide as the tool, and round holes.

    pocket: (S,) the pocket of each channel.
    chains: its centre line, in the order of the pockets.
    holes: (H, 2) middles of round holes, mm.
    hole_pocket: (H,) the pocket that is one.
    """

    pocket: list[int]
    chains: list[Segments]
    holes: FloatArray
    hole_pocket: list[int]


def _slots(walls: RegionForest, ground: PocketWalls, job: Job) -> _Slots:
    """The channels and holes that the last pass along the ``walls`` does not get into."""
    known = [from_contours([])]
    for piece in walls.regions:
        known += piece.passes if piece.parent < 0 else ()
    lines = centre_lines(
        concatenate(known),
        ground.segments,
        ground.following,
        ground.pocket,
        job.tool.radius,
        job.tolerance.arc_fit,
    )
    rows = np.searchsorted(lines.segments.owner, np.arange(len(lines.closed)))
    pocket = ground.pocket[lines.source[rows]]
    order = np.argsort(pocket, kind="stable")
    chains = [lines.segments.take(lines.segments.owner == k) for k in order.tolist()]
    hole_pocket = ground.pocket[lines.hole_source].tolist()
    return _Slots(pocket[order].tolist(), chains, lines.holes, hole_pocket)


def _refuse(job: Job) -> None:
    operation, tool = job.operation, job.tool
    if tool.kind == "drill":
        raise JobError("job", "a drill does not cut sideways", "tool.kind", "choose a mill")
    if job.process.force:
        raise JobError(
            "job",
            "a pocket goes to a depth, not to a force",
            "process.force",
            "set process.force to 0",
        )
    if operation.stepover > _MOST_STEP:
        what = f"passes {operation.stepover:g} of the diameter apart leave ridges between them"
        raise JobError("job", what, "operation.stepover", f"{_MOST_STEP:g} at most")
    if operation.engagement is not None and operation.engagement < operation.stepover + _LEAST_MORE:
        what = f"passes {operation.stepover:g} of the diameter apart engage more of it than {operation.engagement:g}"
        remedy = f"{operation.stepover + _LEAST_MORE:g} at least, or a smaller operation.stepover"
        raise JobError("job", what, "operation.engagement", remedy)
    if operation.finish > tool.radius:
        what = f"{operation.finish:g} mm is more than the radius of the tool, a last pass would leave some of it"
        raise JobError("job", what, "operation.finish", "leave less at the walls")
    if not operation.inside_first:
        what = "pockets are cut from the middle outwards"
        raise JobError("job", what, "operation.inside_first", "leave it out")


def _without(pieces: Sequence[OffsetRegion], failed: frozenset[int]) -> list[OffsetRegion]:
    """The pieces of the other pockets; a parent is of the same pocket as its child."""
    return _chosen(pieces, [k for k, piece in enumerate(pieces) if piece.pocket not in failed])


def _chosen(pieces: Sequence[OffsetRegion], kept: Sequence[int]) -> list[OffsetRegion]:
    """The pieces ``kept``; the parents of all of them are."""
    new = {k: n for n, k in enumerate(kept)}
    return [replace(pieces[k], parent=new.get(pieces[k].parent, -1)) for k in kept]


def _bound(job: Job) -> EngagementLimit | None:
    """How much of the tool may be engaged; None: as much as there is."""
    operation, radius = job.operation, job.tool.radius
    most = (
        min(1.0, operation.stepover + _MORE)
        if operation.engagement is None
        else operation.engagement
    )
    if most >= _MOST_BOUND:
        return None
    return EngagementLimit(
        radius, operation.stepover * job.tool.diameter, most, operation.direction != "conventional"
    )


def _open(
    pieces: list[OffsetRegion], pockets: _Pockets, bound: EngagementLimit | None, job: Job
) -> tuple[list[OffsetRegion], list[tuple[Channel, ...]]]:
    """The pieces that are worth a pass after the channels, and the channels in each of the outermost ones."""
    if bound is None:
        return pieces, [()] * len(pieces)
    first = bound.tool_radius + job.operation.finish
    begun = _HELIX_SHARE * job.tool.diameter if job.operation.entry == "helix" else 0.0
    found: list[Channel] = []
    for number in sorted({piece.pocket for piece in pieces}):
        ground = select_pockets(pockets.ground, frozenset([number]))
        region, spacing = make_pocket_polygon(pockets.ground, number), _SPACING * bound.tool_radius
        axis = compute_medial_axis(
            ground.segments, ground.following, region, first, spacing, bound.max_turn
        )
        found += plan_channels(axis, first, bound, begun)
    if not found:
        return pieces, [()] * len(pieces)
    roots = [k for k, piece in enumerate(pieces) if piece.parent < 0]
    begin = shapely.points([(made.discs[0].x, made.discs[0].y) for made in found])
    here, there = shapely.STRtree([pieces[k].polygon for k in roots]).query_nearest(
        begin, all_matches=False
    )
    opened: list[list[Channel]] = [[] for _ in pieces]
    for k, root in zip(here.tolist(), there.tolist(), strict=True):
        opened[roots[root]].append(found[k])
    kept = _worth(pieces, opened, bound.tool_radius)
    return _chosen(pieces, kept), [tuple(opened[k]) for k in kept]


def _worth(
    pieces: Sequence[OffsetRegion], opened: Sequence[Sequence[Channel]], radius: float
) -> list[int]:
    """The pieces in which the channels leave something, or around which others do; radius: of the tool, mm.

    What they leave may be so thin that the pass around takes it along.
    """
    roots = find_outermost(pieces)
    clear = {
        k: shapely.union_all([made.make_polygon(radius) for made in own])
        for k, own in enumerate(opened)
        if own
    }
    kept: set[int] = set()
    for k in range(len(pieces) - 1, -1, -1):
        piece = pieces[k]
        if k not in kept and piece.parent >= 0 and piece.is_whole and roots[k] in clear:
            left = piece.polygon.buffer(radius, quad_segs=QUARTER_CHORDS).difference(
                clear[roots[k]]
            )
            around = pieces[piece.parent].polygon.boundary.buffer(
                radius - CHORD_MM, quad_segs=QUARTER_CHORDS
            )
            if (
                left.buffer(-_THIN_SHARE * radius).is_empty
                and left.buffer(-CHORD_MM).difference(around).is_empty
            ):
                continue
        kept.add(k)
        if piece.parent >= 0:
            kept.add(piece.parent)
    return sorted(kept)


def _with_hops(
    walks: Sequence[LinkedPasses],
    pieces: Sequence[OffsetRegion],
    opened: Sequence[Sequence[Channel]],
    job: Job,
) -> list[LinkedPasses]:
    """The walks with hops over what channels have cleared, where a mill can lift.

    A ramp leads down along the first stretch of a path, which has to be level.
    """
    process, operation = job.process, job.operation
    if not (process.spindle and operation.depth) or process.stay_down:
        return list(walks)
    channels: dict[int, list[Channel]] = {}
    for piece, inside in zip(pieces, opened, strict=True):
        channels.setdefault(piece.pocket, []).extend(inside)
    cleared = {
        pocket: make_cleared_area(loops, job.tool.radius)
        for pocket, loops in channels.items()
        if loops
    }
    result = []
    for walk in walks:
        levels_only = operation.entry == "ramp" or (
            operation.entry == "helix" and walk.entry_radius <= 0
        )
        if walk.pocket in cleared and not levels_only:
            speeds = _speeds(job)
            hopping = add_hops(
                walk.chain, walk.channel_segments, cleared[walk.pocket], job.tool.radius, speeds
            )
            result.append(
                replace(
                    walk,
                    chain=hopping.chain,
                    is_hop=hopping.is_hop,
                    channel_segments=hopping.channel_segments,
                )
            )
        else:
            result.append(walk)
    return result


def _speeds(job: Job) -> Speeds:
    return Speeds(job.process.feed, job.process.travel_speed)


def sorted_by_pocket(walks: Sequence[LinkedPasses]) -> list[LinkedPasses]:
    """Pocket by pocket, each walk before the one that must come after it."""
    order = sorted(range(len(walks)), key=lambda k: walks[k].pocket)
    new = {k: n for n, k in enumerate(order)}
    return [replace(walks[k], successor=new.get(walks[k].successor, -1)) for k in order]


# What is a wall, what an island, and what is left out.


def _find(contours: Sequence[Contour]) -> tuple[_Pockets, list[Note]]:
    closed = [c for c in contours if c.closed]
    nesting = _find_overlaps(closed, nest(from_contours(closed), len(closed)))
    crossings = _find_crossings(closed)
    for k in crossings:
        nesting.crossed[k] = k
    unfit = [(contours_of(closed, own), how, why) for own, how, why in _unfit(nesting, crossings)]
    loose = [c for c in contours if not c.closed]
    if loose:
        unfit.append(
            (loose, "open", "only what is closed has an inside; raise input.join to close gaps")
        )
    notes = [_not_cleared(chosen, how, why) for chosen, how, why in unfit if chosen]
    sound = (nesting.crossed < 0) & ~nesting.empty
    outer = np.flatnonzero(sound & (nesting.depth % 2 == 0))
    spoiled = _with_doubt(closed, outer.tolist(), [c for chosen, _, _ in unfit for c in chosen])
    if spoiled:
        why = "what they are there for is not clear: as islands they would be cut away; mend or leave them out"
        names = [closed[k] for k in spoiled]
        notes.append(
            _not_cleared(names, "with contours in them that are open or cross others", why)
        )
    members = {
        k: [k, *np.flatnonzero(sound & (nesting.parent == k) & (nesting.depth % 2 == 1)).tolist()]
        for k in outer.tolist()
        if k not in spoiled
    }
    chosen = [k for own in members.values() for k in own]
    area = nesting.area[chosen]
    # The material on the left: walls clockwise, islands the other way round.
    flip = (area > 0) == (nesting.depth[chosen] % 2 == 0)
    walls = turn_round(from_contours([closed[k] for k in chosen]), flip)
    every = np.ones(len(chosen), dtype=bool)
    following = neighbours(walls, every)
    slips = find_slips(walls, following, len(chosen)) | _are_crossed(walls, len(chosen))
    walls, following = uncross(walls, following, slips)
    group = np.repeat(np.arange(len(members)), [len(own) for own in members.values()])
    return _Pockets(
        PocketWalls(walls, following, group[walls.owner], len(members)),
        [closed[k].id for k in members],
        [closed[k].layer for k in members],
        [tuple(closed[k].id for k in own) for own in members.values()],
    ), notes


def _find_overlaps(closed: Sequence[Contour], nesting: Nesting) -> Nesting:
    """``nesting`` with the loops that cross others by a sliver too: what is between them would be cut away."""
    points, owner = flatten(from_contours(closed), CHORD_MM)
    many = np.flatnonzero((np.bincount(owner, minlength=len(closed)) >= 3) & (nesting.crossed < 0))
    rows = np.isin(owner, many)
    loops = shapely.polygons(
        shapely.linearrings(points[rows], indices=np.searchsorted(many, owner[rows]))
    )
    edges = shapely.boundary(loops)
    one, two = shapely.STRtree(edges).query(edges, predicate="intersects")
    one, two = one[one < two], two[one < two]
    loops[np.unique([one, two])] = shapely.make_valid(loops[np.unique([one, two])])
    common = shapely.area(shapely.intersection(loops[one], loops[two]))
    apart = np.minimum(shapely.area(loops[one]), shapely.area(loops[two])) - common
    slack = 2 * CHORD_MM * np.minimum(shapely.length(edges[one]), shapely.length(edges[two]))
    partly = (common > slack) & (apart > slack)
    crossed = nesting.crossed.copy()
    crossed[many[one[partly]]], crossed[many[two[partly]]] = many[two[partly]], many[one[partly]]
    return replace(nesting, crossed=crossed)


def contours_of(closed: Sequence[Contour], chosen: Any) -> list[Contour]:
    """Those of ``closed`` that are ``chosen``."""
    return [closed[k] for k in np.flatnonzero(chosen).tolist()]


def _are_crossed(loops: Segments, count: int) -> NDArray[np.bool_]:
    """(count,) which closed loops, ``owner`` of ``loops``, cross themselves."""
    points, owner = flatten(loops, CHORD_MM)
    crossed = np.zeros(count, dtype=np.bool_)
    polygons = np.flatnonzero(np.bincount(owner, minlength=count) >= MIN_CORNERS)
    rows = np.isin(owner, polygons)
    rings = shapely.linearrings(points[rows], indices=np.searchsorted(polygons, owner[rows]))
    crossed[polygons] = ~shapely.is_valid(shapely.polygons(rings))
    return crossed


def _find_crossings(closed: Sequence[Contour]) -> dict[int, tuple[float, float]]:
    """The contours that cross themselves by more than a slip, and a place of the loop, mm.

    Within such a loop it is not clear on which side the pocket lies.
    """
    places: dict[int, tuple[float, float]] = {}
    crossed = _are_crossed(from_contours(closed), len(closed))
    for k in np.flatnonzero(crossed).tolist():
        points, _ = flatten(from_contours([closed[k]]), CHORD_MM)
        parts = shapely.get_parts(shapely.make_valid(shapely.Polygon(points)))
        parts = parts[np.argsort(-shapely.area(parts), kind="stable")]
        loops = parts[1:][~shapely.is_empty(shapely.buffer(parts[1:], -_SLIP / 2))]
        if len(loops):
            places[k] = loops[0].representative_point().coords[0]
    return places


def _unfit(
    nesting: Nesting, crossings: dict[int, tuple[float, float]]
) -> list[tuple[Any, str, str]]:
    own = nesting.crossed == np.arange(len(nesting.crossed))
    other = (nesting.crossed >= 0) & ~own
    why = "no clear inside; draw one outline"
    at = [f"near {short(x, 2)} {short(y, 2)} mm" for x, y in crossings.values()][:_NAMED]
    where = f"{why}, see {', '.join(at)}" if at else why
    return [
        (own & ~nesting.empty, "crossing themselves", where),
        (other, "crossing each other", why),
        (nesting.empty & ~other, "without an inside", why),
    ]


def _with_doubt(
    closed: Sequence[Contour], outer: Sequence[int], doubtful: Sequence[Contour]
) -> list[int]:
    """Those of the ``outer`` loops in which one of the ``doubtful`` contours lies, or that it meets."""
    if not doubtful or not outer:
        return []
    points, owner = flatten(from_contours([closed[k] for k in outer]), CHORD_MM)
    loops = [shapely.make_valid(shapely.Polygon(points[owner == k])) for k in range(len(outer))]
    ends, of = flatten(from_contours(doubtful), CHORD_MM)
    last = np.array([c.points[0 if c.closed else -1] for c in doubtful])
    lines = [shapely.LineString(np.vstack([ends[of == k], last[k]])) for k in range(len(doubtful))]
    tree = shapely.STRtree(loops)
    return [outer[k] for k in np.unique(tree.query(lines, predicate="intersects")[1]).tolist()]


def _not_cleared(contours: Sequence[Contour], how: str, why: str) -> Note:
    ids = tuple(c.id for c in contours)
    layers = ", ".join(sorted({c.layer for c in contours}))
    what = f"{counted(len(ids), 'contour')} not cleared, {how}: {', '.join(name_ranges(list(ids)))} on layer {layers}"
    return Note("skipped", what, why, ids)


# Paths.


class _Run(Struct, frozen=True, eq=False):
    """One path to be. room: mm, for the helix of its entry. loops: how many segments at its start are a channel. whole:
    it runs at the whole depth alone. travels: (N,) which of its segments are hops; empty for none.
    """

    label: Label
    chain: Segments
    room: float = 0.0
    loops: int = 0
    whole: bool = False
    travels: NDArray[np.bool_] = np.zeros(0, dtype=np.bool_)


def _paths(
    walks: Sequence[LinkedPasses],
    borders: Sequence[OffsetRegion],
    pieces: Sequence[OffsetRegion],
    pockets: _Pockets,
    job: Job,
) -> tuple[ToolPath, ...]:
    """The walks, then the finishing passes of each pocket, by pocket."""
    reached = _reached_by_roughing(borders, pieces, job)
    runs: list[_Run] = []
    for number in range(len(pockets.names)):
        last = [
            (chain, full)
            for piece, full in zip(borders, reached, strict=True)
            for chain in piece.passes
            if piece.pocket == number
        ]
        runs += _rough_runs(number, walks, len(runs), bool(last), pockets, job)
        runs += _last_runs(number, last, len(runs), pockets)
    if not runs:
        return ()
    table = concatenate([run.chain for run in runs])
    table = replace(table, owner=np.repeat(np.arange(len(runs)), [len(run.chain) for run in runs]))
    depths = pass_depths(job.operation.depth, job.operation.passes)
    feeds = _feeds(table, runs, pockets.ground.segments, job)
    work = SegmentWork(sideways(table, 0), np.zeros(len(table)), feeds)
    paths = tool_paths(table, [run.label for run in runs], work, depths, "pocket")
    planned = []
    for path, run in zip(paths, runs, strict=True):
        levels = depths[-1:] if run.whole else depths
        whole = replace(path, entry_radius=run.room, depths=levels)
        planned.append(lift_hops(whole, np.append(False, run.travels), _speeds(job)))
    return tuple(planned)


def _rough_runs(
    number: int,
    walks: Sequence[LinkedPasses],
    base: int,
    followed: bool,
    pockets: _Pockets,
    job: Job,
) -> list[_Run]:
    """The walks of a pocket, the first of them path ``base``; followed: by a last pass."""
    own = [k for k, walk in enumerate(walks) if walk.pocket == number]
    runs = []
    for n, k in enumerate(own, 1):
        walk = walks[k]
        after = base + len(own) if followed else -1
        before = base + own.index(walk.successor) if walk.successor >= 0 else after
        name = f"{pockets.names[number]}.{n}" if len(own) > 1 else pockets.names[number]
        label = Label(name, pockets.layers[number], False, False, before, pockets.contours[number])
        room = max(0.0, min(walk.entry_radius, _HELIX_SHARE * job.tool.diameter))
        runs.append(_Run(label, walk.chain, room, walk.channel_segments, travels=walk.is_hop))
    return runs


def _last_runs(
    number: int, last: Sequence[tuple[Segments, bool]], base: int, pockets: _Pockets
) -> list[_Run]:
    """The last passes of a pocket one after the other, the first of them path ``base``."""
    runs = []
    for n, (chain, whole) in enumerate(last, 1):
        name = f"{pockets.names[number]}.finish" + (f".{n}" if len(last) > 1 else "")
        before = base + n if n < len(last) else -1
        label = Label(name, pockets.layers[number], True, False, before, pockets.contours[number])
        runs.append(_Run(label, chain, whole=whole))
    return runs


def _slot_paths(slots: _Slots, pockets: _Pockets, job: Job) -> list[ToolPath]:
    """A path along each channel as wide as the tool, and one straight down into each hole."""
    depths = pass_depths(job.operation.depth, job.operation.passes)
    labels: list[Label] = []
    for k, number in enumerate(slots.pocket):
        name = f"{pockets.names[number]}.slot"
        name += f".{slots.pocket[: k + 1].count(number)}" if slots.pocket.count(number) > 1 else ""
        chain = slots.chains[k]
        ring = bool((chain.start[0] == chain.end[-1]).all())
        either = job.operation.direction == "any" and not ring
        layer, names = pockets.layers[number], pockets.contours[number]
        labels.append(Label(name, layer, ring, either, -1, names))
    paths: list[ToolPath] = []
    if labels:
        table = concatenate(slots.chains)
        sizes = [len(chain) for chain in slots.chains]
        table = replace(table, owner=np.repeat(np.arange(len(sizes)), sizes))
        none = np.zeros(len(table))
        work = SegmentWork(sideways(table, 0), none, none + job.process.feed)
        paths += tool_paths(table, labels, work, depths, "pocket")
    if job.tool.center_cutting:
        for (x, y), number in zip(slots.holes.tolist(), slots.hole_pocket, strict=True):
            name, layer = pockets.names[number], pockets.layers[number]
            paths.append(plunge_path(name, layer, (x, y), job, "pocket", pockets.contours[number]))
    return paths


def _feeds(table: Segments, runs: Sequence[_Run], walls: Segments, job: Job) -> FloatArray:
    """(N,) mm/s: on inner curves along the walls the feed is that of the edge at the wall.

    The centre runs on a smaller circle. Other curves leave no wall. Where engagement is bounded,
    they take no more than it allows, and run at the full feed.
    """
    wall = 1 if job.operation.direction == "conventional" else -1
    loops = np.concatenate([np.arange(len(run.chain)) < run.loops for run in runs])
    inner = table.is_arc & (np.sign(table.bulge) == -wall) & ~loops
    if _bound(job) is not None:
        rows = np.flatnonzero(inner)
        middles = points_at(table.take(rows), np.full(len(rows), 0.5))
        reach = job.tool.radius + job.operation.finish + _AT_WALL
        inner[rows] = np.isfinite(nearest_distances(middles, walls, reach))
    share = 1 / (1 + job.tool.radius / table.radius)
    return np.asarray(job.process.feed * np.maximum(np.where(inner, share, 1.0), SLOWEST))


def _reached_by_roughing(
    borders: Sequence[OffsetRegion], pieces: Sequence[OffsetRegion], job: Job
) -> list[bool]:
    """Whether along the walls of each piece no more is left for the last pass than it may take at the whole depth.

    In places too narrow for the passes before, it would cut a slot.
    """
    most = max(job.operation.finish, job.operation.stepover * job.tool.diameter)
    result = []
    for border in borders:
        inside = [
            piece.polygon for piece in pieces if piece.parent < 0 and piece.pocket == border.pocket
        ]
        rough = shapely.union_all(inside) if inside else shapely.Polygon()
        far = (
            border.polygon
            if rough.is_empty
            else border.polygon.difference(rough.buffer(most + CHORD_MM, quad_segs=QUARTER_CHORDS))
        )
        result.append(bool(far.is_empty))
    return result


# What is said of them.


def _tell_failed(
    failed: frozenset[int],
    borders: Sequence[OffsetRegion],
    slots: _Slots,
    pockets: _Pockets,
    job: Job,
) -> list[Note]:
    """Notes on pockets without a path."""
    reached = {piece.pocket for piece in borders} | set(slots.pocket)
    round_ = [k for k in slots.hole_pocket if not job.tool.center_cutting]
    reached |= set(slots.hole_pocket) - set(round_)
    narrow = [k for k in range(len(pockets.names)) if k not in {*reached, *failed, *round_}]
    tool = "nothing is narrow"
    if narrow:
        regions = [make_pocket_polygon(pockets.ground, k) for k in narrow]
        tool = does_not_fit(regions, job.tool.diameter)
    report = (
        "the border of the tool's way does not close there, as where edges lie on one line: "
        "draw one outline, or take another tool"
    )
    result = []
    for chosen, how, why in (
        (narrow, "too narrow", tool),
        (round_, "round and as wide as the tool", NO_HELIX),
        (sorted(failed), "check failed", report),
    ):
        if chosen:
            ids = [pockets.names[k] for k in chosen]
            layers = ", ".join(sorted({pockets.layers[k] for k in chosen}))
            what = f"{counted(len(ids), 'contour')} not cleared, {how}: {', '.join(name_ranges(ids))} on layer {layers}"
            every = tuple(name for k in chosen for name in pockets.contours[k])
            result.append(Note("skipped", what, why, every))
    return result


def _tell_slots(slots: _Slots, pockets: _Pockets) -> list[Note]:
    """Which channels are as wide as the tool, so that nothing bounds the engagement there."""
    if not slots.chains:
        return []
    names = ", ".join(name_ranges([pockets.names[k] for k in dict.fromkeys(slots.pocket)]))
    length = short(sum(float(chain.length.sum()) for chain in slots.chains), 1)
    what = f"{counted(len(slots.chains), 'channel')} as wide as the tool, {length} mm: {names}"
    return [Note("assumed", what, "along the middle, with all of its width in the material")]


def _tell_passes(
    walks: Sequence[LinkedPasses],
    pieces: Sequence[OffsetRegion],
    opened: Sequence[Sequence[Channel]],
    pockets: _Pockets,
    job: Job,
) -> list[Note]:
    """How many passes there are, how far apart, and how much of the tool is in the material."""
    if not walks:
        return []
    step, radius = job.operation.stepover * job.tool.diameter, job.tool.radius
    share, way = measure_engagement(
        pieces, opened, radius, step, job.operation.direction != "conventional"
    )
    made = [channel for own in opened for channel in own]
    noun = "area" if job.operation.rest else "pocket"
    which = (
        pockets.names[0]
        if len(pockets.names) == 1
        else counted(len({w.pocket for w in walks}), noun)
    )
    passes = sum(walk.pass_count for walk in walks)
    what = f"{which}: {counted(passes, 'pass', 'passes')} in {counted(len(walks), 'path')}, {short(step, 3)} mm apart"
    if made:
        loops = sum(len(channel.discs) for channel in made)
        metres = sum(float(channel.chain.length.sum()) for channel in made) / 1000
        what += f", {counted(loops, 'loop')} of {short(metres, 2)} m before them (none with operation.engagement = 1)"
    if len(share):
        order = np.argsort(share)
        half = share[order[np.searchsorted(np.cumsum(way[order]), way.sum() / 2)]]
        much = 100 * way[share > _MUCH].sum() / way.sum()
        what += f", engagement {_percent(half)} % of the diameter or less on half of the way, {_percent(share.max())} %"
        what += f" at most, over {100 * _MUCH:.0f} % on {short(much, 1)} % of it"
    parents, roots = {piece.parent for piece in pieces}, find_outermost(pieces)
    first = sum(
        k not in parents and piece.is_whole and not opened[roots[k]]
        for k, piece in enumerate(pieces)
    )
    slots = f"the first pass in the middle of {counted(first, 'place')}, which is a slot"
    why = (
        f"not counted: {slots}" if first else "not counted: the first turns where the tool goes in"
    )
    steep = sum(walk.steep_links for walk in walks)
    if made and steep:
        why += f", and {counted(steep, 'link')} for which there was no room to lean"
    return [Note("assumed", what, why)]


def _percent(share: float) -> str:
    """A share in whole percent, rounded up."""
    return f"{max(np.ceil(100 * share - 1e-6), 0.0):.0f}"


def _tell_unreached(
    borders: Sequence[OffsetRegion], slots: _Slots, pockets: _Pockets, job: Job
) -> list[Note]:
    """What the tool leaves of the pockets that it clears: corners and narrow places."""
    radius = job.tool.radius
    total, whole = 0.0, 0.0
    places: list[tuple[float, float, float]] = []
    ids: list[str] = []
    for number in sorted({piece.pocket for piece in borders} | set(slots.pocket)):
        region = make_pocket_polygon(pockets.ground, number).difference(pockets.cleared)
        chains = [slots.chains[k] for k, pocket in enumerate(slots.pocket) if pocket == number]
        centres = [_line(chain) for chain in chains]
        centres += [piece.polygon for piece in borders if piece.pocket == number]
        left = region.difference(
            shapely.union_all(centres).buffer(radius, quad_segs=QUARTER_CHORDS)
        )
        whole += region.area
        # What is as thin as the chords of the flattened curves is none.
        parts = [p for p in shapely.get_parts(left) if not p.buffer(-2 * CHORD_MM).is_empty]
        total += sum(p.area for p in parts)
        large = [p for p in parts if p.area >= _PLACE_SHARE * np.pi * radius**2]
        places += [(p.area, *p.representative_point().coords[0]) for p in large]
        ids += pockets.contours[number] if large else []
    if total <= max(1e-4 * whole, 0.05 * radius**2):
        return []
    places.sort(reverse=True)
    what = f"{short(total, 2)} mm2 of {short(whole, 2)} mm2 not cleared"
    if places:
        what += f", {counted(len(places), 'place')} of {short(places[0][0], 2)} mm2 or less"
    why = f"inner corners and narrow places that a {job.tool.diameter:g} mm tool does not reach"
    return [
        Note("warning", what, why, tuple(ids), tuple((x, y) for _, x, y in places[:_MOST_PLACES]))
    ]


def _line(chain: Segments) -> Any:
    """A chain as a line of chords."""
    points, _ = flatten(chain, CHORD_MM)
    return shapely.LineString(np.vstack([points, chain.end[-1:]]))
