"""The content of a preview as one value, in the work frame; mm, s, N, rad."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import chain, pairwise

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.check.executed import Rounding
from camgen.check.report import clean, path_sums
from camgen.geometry.corners import check_corners
from camgen.geometry.ragged import compute_first_rows
from camgen.geometry.vectors import interpolate_rows
from camgen.model.part import Contour, Curve, Edge, Line, Note, Solid
from camgen.model.pose import IDENTITY, FloatArray, Pose
from camgen.model.text import duration, join_short, short, short_each
from camgen.model.tolerance import SAME_POINT_MM
from camgen.order.tours import EdgeTour
from camgen.preview import Built, list_seen
from camgen.preview.curves import (
    SpaceChains,
    choose_sag,
    lift,
    measure_length,
    trace_contours,
    trace_spans,
)
from camgen.preview.executed import trace_executed
from camgen.preview.fixtures import FixtureView, clip_fixtures
from camgen.preview.listing import Listing, list_texts
from camgen.preview.notes import ViewLine, ViewNote, link_notes
from camgen.preview.photo import Photo, make_photo
from camgen.preview.stock import (
    Cutter,
    Cutters,
    Mark,
    Stock,
    assign_tools,
    find_marks,
    find_stock,
    format_stock,
    list_cutters,
)
from camgen.preview.track import Arm, IntArray, Switch, Track, list_switches, make_track
from camgen.robots.models import Box, Link

# Bodies beside the part: tool, holder, table and fixtures.

_NO_OFFSET = Pose(IDENTITY, (0.0, 0.0, 0.0))


class ViewBodies(Struct, frozen=True, eq=False):
    """The bodies of the collision test, except the robot and the part.

    bodies: tool and holder, as boxes at the flange.
    standing: table and fixtures, as boxes in the work frame.
    meshes: fixtures that are meshes, in the work frame, with their names.
    """

    bodies: tuple[Link, ...]
    standing: tuple[Link, ...]
    meshes: tuple[tuple[str, Solid], ...]


def find_bodies(result: Built) -> ViewBodies:
    """The bodies of the collision test; without a robot those of the job.

    Raises JobError for invalid boxes in the job.
    """
    where = result.where
    if where is None:
        return _make_untested_bodies(result)
    work_from_base = result.program.base_from_work.inverse()
    standing: list[Link] = []
    for link in where.standing:
        boxes = [Box(work_from_base @ box.link_from_box, box.half) for box in link.boxes]
        standing.append(Link(link.name, tuple(boxes)))
    return ViewBodies(where.bodies, tuple(standing), where.meshes)


def _make_untested_bodies(result: Built) -> ViewBodies:
    job = result.job
    if not job.cell.fixtures and not job.tool.holder:
        return ViewBodies((), (), ())
    from camgen.collision.cell import make_box  # noqa: PLC0415 (loads fcl)

    holder = [
        make_box(_NO_OFFSET, *check_corners("tool.holder", box)) for box in job.tool.holder or ()
    ]
    standing: list[Link] = []
    for number, fixture in enumerate(job.cell.fixtures or (), 1):
        if isinstance(fixture, list):
            box = make_box(_NO_OFFSET, *check_corners("cell.fixtures", fixture))
            standing.append(Link(f"fixture {number}", (box,)))
    return ViewBodies((Link("holder", tuple(holder)),), tuple(standing), result.cell.meshes)


# Edges that are run in pieces.


def split_chain(
    points: FloatArray, stretches: Sequence[tuple[float, float]]
) -> list[tuple[int, FloatArray]]:
    """Split a chain (N, 3) at the ends of stretches.

    stretches: start and end of each worked stretch, as lengths along the chain, mm. On a closed
        chain a stretch may continue beyond the end of the chain, at its start.

    Returns parts of the chain, each with the index of its stretch, -1 for none.
    """
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    lengths = np.append(0.0, np.cumsum(steps))
    total = float(lengths[-1])
    worked = [(low, min(high, total), k) for k, (low, high) in enumerate(stretches)]
    worked += [(0.0, high - total, k) for k, (_, high) in enumerate(stretches) if high > total]
    marks = sorted({0.0, total, *chain.from_iterable(pair[:2] for pair in worked)})
    parts = []
    for low, high in pairwise(marks):
        if high - low < SAME_POINT_MM:
            continue
        places = np.concatenate([[low], lengths[(lengths > low) & (lengths < high)], [high]])
        middle = (low + high) / 2
        number = next((k for start, end, k in worked if start < middle < end), -1)
        parts.append((number, interpolate_rows(places, lengths, points)))
    is_closed = np.array_equal(points[0], points[-1])
    if is_closed and len(parts) > 1 and parts[0][0] == parts[-1][0]:
        number, last = parts.pop()
        parts[0] = number, np.concatenate([last[:-1], parts[0][1]])
    return parts


#: Reason for the end of an edge that is left out without a note.
_TRIMMED = "operation.trim allows it"
#: Points of a ring around a place.
_RING_POINTS = 33


class Row(Struct, frozen=True):
    """A tool path as a row of the list of paths.

    id: id of the path.
    layer: its layer.
    length: its length, mm.
    feed: mean of the programmed feeds, mm/s.
    force: largest force, N.
    seconds: its time in the cycle, s.
    passes: number of its passes.
    operation: its operation and tool, "" for a job with one operation.
    """

    id: str
    layer: str
    length: float
    feed: float
    force: float
    seconds: float
    passes: int
    operation: str = ""


class View(Struct, frozen=True, eq=False):
    """The content of a page.

    title: title of the page.
    facts: labels and texts of the numbers.
    lines: contours and edges, in the order of `chains`.
    chains: points of the lines.
    solid: triangles of the part; None for a flat part.
    flat: whether all of the part lies in the work plane.
    rows: the list of paths.
    track: the program through time.
    arm: the robot; None if none is known.
    base_from_work, flange_from_tool: frames of the program.
    diameter: diameter of the tool, mm.
    bodies: tool and holder, boxes at the flange.
    standing: table and fixtures, boxes in the work frame.
    meshes: fixtures that are meshes.
    notes: notes of the build, in their order.
    listing: text of the program.
    tools: tools of the program, in the order of their use.
    tool_of: (E,) tool of each event.
    stock: the stock; None if no material is removed from above.
    marks: findings of the stock proof, drawn over the stock.
    photo: the picture from which the part was read.
    switches: outputs, in the order of time.
    executed: the path that the controller runs; None without a model of it.
    fixtures: fixtures of a mill, from above.
    upright: (3, 3) rotation of a 3-D part from the work frame to its upright orientation.
    """

    title: str
    facts: tuple[tuple[str, str], ...]
    lines: tuple[ViewLine, ...]
    chains: SpaceChains
    solid: Solid | None
    flat: bool
    rows: tuple[Row, ...]
    track: Track
    arm: Arm | None
    base_from_work: Pose
    flange_from_tool: Pose
    diameter: float
    bodies: tuple[Link, ...]
    standing: tuple[Link, ...]
    meshes: tuple[tuple[str, Solid], ...]
    notes: tuple[ViewNote, ...]
    listing: Listing
    tools: tuple[Cutter, ...]
    tool_of: IntArray
    stock: Stock | None
    marks: tuple[Mark, ...] = ()
    photo: Photo | None = None
    switches: tuple[Switch, ...] = ()
    executed: SpaceChains | None = None
    fixtures: tuple[FixtureView, ...] = ()
    upright: FloatArray = IDENTITY

    @property
    def skipped(self) -> tuple[ViewNote, ...]:
        """The notes on everything that was left out."""
        return tuple(note for note in self.notes if note.kind == "skipped")


def _find_upright(result: Built) -> FloatArray:
    if result.job.cell.rests_on is None:
        return IDENTITY
    from camgen.collision.cell import turn_upright  # noqa: PLC0415 (fcl, rarely needed)

    return turn_upright(result.job.cell.rests_on)


def make_view(result: Built) -> View:
    """The content of the preview of `result`."""
    part, program = result.part, result.program
    ends = [program.columns.ends, *(path.position for path in result.tour.paths)]
    sag = choose_sag(np.concatenate(ends))
    track, arm = make_track(result, sag)
    lines, chains = _make_lines(result, sag)
    surroundings = find_bodies(result)
    cutters = list_cutters(result)
    bodies = surroundings.bodies
    if len(cutters.tools) > 1:
        # The boxes are those of one tool. Several tools are drawn by their profiles.
        bodies = tuple(body for body in bodies if body.name != "tool")
    stock = find_stock(result, cutters)
    rows = _make_rows(result, cutters)
    return View(
        title=clean(f"{part.source}, {result.post.name}"),
        facts=(*_list_facts(result, float(track.time[-1])), *_list_cut(cutters, stock)),
        lines=lines,
        chains=chains,
        solid=part.solid,
        flat=part.solid is None and not part.curves,
        rows=rows,
        track=track,
        arm=arm,
        base_from_work=program.base_from_work,
        flange_from_tool=program.flange_from_tool,
        diameter=cutters.tools[0].diameter,
        bodies=bodies,
        standing=surroundings.standing,
        meshes=surroundings.meshes,
        notes=link_notes(result.notes, lines, [row.id for row in rows]),
        listing=list_texts(
            [(file.name, file.text) for file in result.files],
            result.lines[track.events.instruction],
        ),
        tools=cutters.tools,
        tool_of=assign_tools(result, cutters, track.events.instruction, track.events.path),
        stock=stock,
        marks=find_marks(result),
        photo=make_photo(result),
        switches=list_switches(program.columns, track.events),
        executed=trace_executed(result, sag),
        fixtures=clip_fixtures(result),
        upright=_find_upright(result),
    )


def list_reasons(notes: Sequence[Note]) -> dict[str, str]:
    """The first reason for each contour and edge that is left out, by its id."""
    reasons: dict[str, str] = {}
    for note in reversed(notes):
        if note.kind == "skipped":
            reasons |= dict.fromkeys(note.ids, clean(note.why or note.what))
    return reasons


def _make_lines(result: Built, sag: float) -> tuple[tuple[ViewLine, ...], SpaceChains]:
    """The contours, curves and edges of the part, with the chains that draw them."""
    contours = tuple(contour for contour in result.part.contours if len(contour.points) > 1)
    curves = result.part.curves
    edges = result.part.solid.edges if result.part.solid else ()
    in_space: list[Line] = [*curves, *edges]
    flat = trace_contours(contours, sag)
    spatial = trace_spans([(line.points, line.via) for line in in_space], sag)
    chains = SpaceChains(
        np.concatenate([flat.points, spatial.points]), np.concatenate([flat.counts, spatial.counts])
    )
    why = list_reasons(result.notes)
    states = dict.fromkeys(why, "skipped")
    for path in result.tour.paths:
        states |= dict.fromkeys(path.contours, "done")
    lines = []
    drawn: list[Contour | Curve | Edge] = [*contours, *curves, *edges]
    for line, length in zip(drawn, _measure_chains(chains), strict=True):
        layer, state = clean(_name_layer(result, line)), states.get(line.id, "unused")
        reason = why.get(line.id, "")
        lines.append(ViewLine(clean(line.id), layer, line.closed, length, state, reason))
    if edges or curves:
        return _mark_gaps(result, lines, chains)
    parts = [chains.points]
    for mark, points in (*_mark_places(result), *_list_seen(result), *_list_blocked(result, sag)):
        lines.append(mark)
        parts.append(points)
    counts = [*chains.counts.tolist(), *map(len, parts[1:])]
    return tuple(lines), SpaceChains(np.concatenate(parts), np.array(counts, dtype=np.int64))


def _name_layer(result: Built, line: Contour | Curve | Edge) -> str:
    if isinstance(line, Edge):
        return f"{'convex' if line.convex else 'concave'} {line.kind}"
    # A picture has no layers; the reader of pictures only fills the field.
    return line.layer if result.part.raster is None else ""


def _list_blocked(result: Built, sag: float) -> Iterator[tuple[ViewLine, FloatArray]]:
    """The paths and stretches of paths that are left out for a fixture."""
    why = list_reasons(result.notes)
    for path in result.blocked:
        points = trace_spans([(path.position, path.via[1:])], sag).points
        yield (
            ViewLine(
                id=clean(path.id),
                layer=clean(path.layer),
                closed=False,
                length=measure_length(points),
                state="skipped",
                why=why.get(path.id, ""),
            ),
            points,
        )


def _list_seen(result: Built) -> Iterator[tuple[ViewLine, FloatArray]]:
    for outline in list_seen(result):
        points = lift(outline)
        yield ViewLine("photo", "", False, measure_length(points), "seen", ""), points


def _mark_places(result: Built) -> Iterator[tuple[ViewLine, FloatArray]]:
    """A ring of the tool's size at each place of a note: "noted" for an assumption, or "wrong"."""
    radius = result.job.tool.radius
    angle = np.linspace(0.0, 2 * np.pi, _RING_POINTS)
    ring = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(_RING_POINTS)])
    for note in result.notes:
        state = "noted" if note.kind == "assumed" else "wrong"
        for x, y in note.places:
            line = ViewLine(
                f"{x:.2f}, {y:.2f} mm",
                note.kind,
                False,
                2 * np.pi * radius,
                state,
                clean(note.what),
            )
            yield line, ring + np.array([x, y, 0.0])


def _mark_gaps(
    result: Built, lines: Sequence[ViewLine], chains: SpaceChains
) -> tuple[tuple[ViewLine, ...], SpaceChains]:
    """Split the edges that are run in pieces. A stretch that is left out becomes its own line."""
    lengths = {line.id: line.length for line in lines}
    stretches: dict[str, list[tuple[float, float]]] = {}
    names: dict[str, list[str]] = {}
    for leg in result.tour.route.legs if isinstance(result.tour, EdgeTour) else ():
        motion = leg.motion
        if motion.part_of:
            low, rest = motion.trimmed[:: -1 if motion.backwards else 1]
            stretches.setdefault(motion.line, []).append((low, lengths[motion.line] - rest))
            names.setdefault(motion.line, []).append(motion.id)
    pieces: list[tuple[ViewLine, FloatArray]] = []
    for line, points in zip(
        lines, np.split(chains.points, np.cumsum(chains.counts)[:-1]), strict=True
    ):
        if line.state != "done" or line.id not in stretches:
            pieces.append((line, points))
            continue
        for number, part in split_chain(points, stretches[line.id]):
            stretch = replace(line, closed=False, why="", path=names[line.id][number])
            if number < 0:
                stretch = replace(line, closed=False, state="skipped", why=line.why or _TRIMMED)
            pieces.append((stretch, part))
    drawn, parts = zip(*pieces, strict=True)
    split = SpaceChains(np.concatenate(parts), np.array(list(map(len, parts))))
    marked = zip(drawn, _measure_chains(split), strict=True)
    return tuple(replace(line, length=length) for line, length in marked), split


def _measure_chains(chains: SpaceChains) -> list[float]:
    """The length of each chain as it is drawn, mm."""
    if not len(chains.counts):
        return []
    steps = np.linalg.norm(np.diff(chains.points, axis=0, prepend=chains.points[:1]), axis=1)
    first = compute_first_rows(chains.counts)
    steps[first] = 0.0
    sums: FloatArray = np.add.reduceat(steps, first)
    return list(map(float, sums.tolist()))


def _make_rows(result: Built, cutters: Cutters) -> tuple[Row, ...]:
    paths = result.tour.paths
    lengths, seconds = path_sums(paths)
    sums = zip(lengths.tolist(), seconds.tolist(), result.cycle.paths.tolist(), strict=True)
    rows = []
    for path, operation, (length, time, spent) in zip(paths, cutters.operations, sums, strict=True):
        rows.append(
            Row(
                id=clean(path.id),
                layer=clean(path.layer) if result.part.raster is None else "",
                length=length,
                feed=length / time if time > 0 else float(path.feed[0]),
                force=float(path.force.max()),
                seconds=spent,
                passes=len(path.depths),
                operation=operation,
            )
        )
    return tuple(rows)


def _list_facts(result: Built, seconds: float) -> tuple[tuple[str, str], ...]:
    part, tour = result.part, result.tour
    work = math.fsum(path_sums(tour.paths)[0].tolist())
    feeds, force = result.motions.speeds, result.motions.force
    joint_speeds = " and joint speeds" if result.reach else ""
    facts = [
        ("Part", clean(part.source)),
        ("Units", f"drawn in {clean(part.units)}, shown in mm"),
        *_list_location(result),
        ("Controller", result.post.name),
        ("Program", clean(result.program.name)),
        ("Robot", result.reach.robot if result.reach else "not checked: no robot model"),
        ("Paths", str(len(tour.paths))),
        ("Work", f"{short(work, 1)} mm"),
        ("Travel", f"{short(tour.travel, 1)} mm ({tour.method})"),
        ("Speed", f"{short(feeds[0], 1)} to {short(feeds[1], 1)} mm/s"),
        ("Force", f"up to {short(force, 2)} N" if force else "none"),
        ("Time", f"{_format_time(seconds)}, {_format_time(result.cycle.travel)} of it travel"),
        ("Time counts", f"feeds, acceleration, corners, waits{joint_speeds}; an estimate"),
        ("Verified", f"text read back, within {result.deviation.max_mm:.6f} mm"),
        ("Rounded corners", _format_rounding(result.rounded)),
    ]
    if result.clear and result.where:
        solid = ["the part"] if part.solid else []
        bodies = [body.name for body in (*result.where.bodies, *result.where.standing)]
        tested = ", ".join(["robot", *bodies, *solid, *[name for name, _ in result.where.meshes]])
        clearance = f"{short(result.clear.clearance, 2)} mm or more apart"
        if result.clear.nearest:
            clearance += f", least {clean(str(result.clear.nearest))}"
        facts.append(("Collision", f"none, {clearance}; tested: {tested}"))
    if result.motions.extents:
        size = short_each(np.ptp(result.motions.extents, axis=0).tolist(), 1)
        facts.insert(9, ("Extents", f"{' x '.join(size)} mm"))
    return tuple(facts)


def _list_location(result: Built) -> list[tuple[str, str]]:
    """The fact on the pose of the part, if a photo shows it."""
    if result.located is None:
        return []
    photo = clean(result.located.inspection.photo.source)
    deviation = f"which differs from the drawing by {short(result.located.deviation, 3)} mm at most"
    return [("Located", f"{result.located.pose}, by {photo}, {deviation}")]


def _format_rounding(rounded: Rounding | None) -> str:
    """The corner with the largest rounding, as text."""
    if rounded is None:
        return "not modelled for this controller"
    if not rounded.mm:
        return "none"
    place = join_short(rounded.place, 2)
    return f"{short(rounded.mm, 4)} mm off the path at {place} mm, line {rounded.line}"


def _format_time(seconds: float) -> str:
    """A time, with tenths of a second if it is below a minute."""
    return f"{short(seconds, 1)} s" if seconds < 60 else duration(seconds)


def _list_cut(cutters: Cutters, stock: Stock | None) -> list[tuple[str, str]]:
    """The facts on the tools, if there are several, and on the stock."""
    facts = []
    for number, tool in enumerate(cutters.tools, 1):
        facts.append((f"Tool {number}", f"{tool.name}: {tool.kind}, {short(tool.diameter, 2)} mm"))
    if len(facts) == 1:
        facts = []
    if stock:
        facts.append(("Stock", format_stock(stock)))
    return facts
