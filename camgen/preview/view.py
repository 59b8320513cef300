"""What a preview shows, as one value: ``view`` makes it of a build's result. Work frame, mm, s, N, rad."""

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
from camgen.geometry.ragged import begins
from camgen.model.part import Line, Note, Solid
from camgen.model.pose import IDENTITY, FloatArray, Pose
from camgen.model.text import duration, short
from camgen.model.tolerance import SAME_POINT_MM
from camgen.order.tours import EdgeTour
from camgen.preview import Built, list_seen
from camgen.preview.curves import SpaceChains, of_contours, of_spans
from camgen.preview.executed import trace_executed
from camgen.preview.fixtures import FixtureView, see_fixtures
from camgen.preview.listing import Listing, list_program
from camgen.preview.notes import ViewNote, see_notes
from camgen.preview.photo import Photo, photo_of
from camgen.preview.stock import (
    Cutter,
    Cutters,
    Mark,
    Stock,
    cutters_of,
    marks_of,
    stock_of,
    tell_stock,
    tools_of_events,
)
from camgen.preview.track import Arm, IntArray, Switch, Track, switches_of, track
from camgen.robots.models import Box, Link

# What stands around a part and what the robot holds, as the test for collisions has it.

_HERE = Pose(IDENTITY, (0.0, 0.0, 0.0))


class Around(Struct, frozen=True, eq=False):
    """bodies: tool and holder, their boxes at the flange. standing: table and fixtures, their boxes in the work frame.
    meshes: fixtures that are meshes, work frame.
    """

    bodies: tuple[Link, ...]
    standing: tuple[Link, ...]
    meshes: tuple[tuple[str, Solid], ...]


def around(result: Built) -> Around:
    """As it was tested; without a robot nothing is, and it is what the job says. JobError for boxes that are none."""
    where = result.where
    if where is None:
        return _take_untested(result)
    work_from_base = result.program.base_from_work.inverse()
    standing = [
        Link(
            link.name,
            tuple(Box(work_from_base @ box.link_from_box, box.half) for box in link.boxes),
        )
        for link in where.standing
    ]
    return Around(where.bodies, tuple(standing), where.meshes)


def _take_untested(result: Built) -> Around:
    job = result.job
    if not job.cell.fixtures and not job.tool.holder:
        return Around((), (), ())
    from camgen.collision.cell import make_box  # noqa: PLC0415 (loads fcl)

    holder = tuple(
        make_box(_HERE, *check_corners("tool.holder", box)) for box in job.tool.holder or ()
    )
    named = [
        (f"fixture {k}", box)
        for k, box in enumerate(job.cell.fixtures or (), 1)
        if isinstance(box, list)
    ]
    standing = [
        Link(name, (make_box(_HERE, *check_corners("cell.fixtures", box)),)) for name, box in named
    ]
    return Around((Link("holder", holder),), tuple(standing), result.cell.meshes)


# Edges that are run in pieces: cut where the work begins and ends.


def split_chain(
    points: FloatArray, stretches: Sequence[tuple[float, float]]
) -> list[tuple[int, FloatArray]]:
    """A chain (N, 3) in parts, each with the number of its stretch, -1 for none.

    stretches: lengths, mm, between which it is worked. In a closed chain a stretch may run over the
        end, and is continued at the start.
    """
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    at = np.append(0.0, np.cumsum(steps))
    whole = float(at[-1])
    worked = [(low, min(high, whole), k) for k, (low, high) in enumerate(stretches)]
    worked += [(0.0, high - whole, k) for k, (_, high) in enumerate(stretches) if high > whole]
    marks = sorted({0.0, whole, *chain.from_iterable(pair[:2] for pair in worked)})
    parts = []
    for low, high in pairwise(marks):
        if high - low < SAME_POINT_MM:
            continue
        places = np.concatenate([[low], at[(at > low) & (at < high)], [high]])
        middle = (low + high) / 2
        number = next((k for begin, end, k in worked if begin < middle < end), -1)
        columns = [np.interp(places, at, column) for column in points.T]
        parts.append((number, np.column_stack(columns)))
    is_closed = np.array_equal(points[0], points[-1])
    if is_closed and len(parts) > 1 and parts[0][0] == parts[-1][0]:
        number, last = parts.pop()
        parts[0] = number, np.concatenate([last[:-1], parts[0][1]])
    return parts


#: Why an end of an edge is left out without a note that it is skipped.
_TRIMMED = "operation.trim allows it"
#: Points of a ring around a place.
_RING_POINTS = 33
#: Arcs are drawn to this part of the size of what is shown.
_FINE = 2e-5


class ViewLine(Struct, frozen=True):
    """A contour or an edge, or a part of it: state is "done", "skipped" or "unused" (nothing was asked of it); why it
    was skipped. A ring around a place is "wrong" or "noted"; why says what is.
    An outline in a photo is "seen". path: id of the path of a piece of an edge.
    """

    id: str
    layer: str
    closed: bool
    length: float
    state: str
    why: str
    path: str = ""


class Row(Struct, frozen=True):
    """A tool path as the list has it: mm, mm/s, N, s. feed: the mean of what is asked for. seconds: of the cycle.
    operation: with its tool, "" where the job has one.
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
    upright: (3, 3) the rotation that turns a 3-D part as it stands.
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
        """What was left out."""
        return tuple(note for note in self.notes if note.kind == "skipped")


def _stand_upright(result: Built) -> FloatArray:
    """The rotation (3, 3) that turns a 3-D part as it stands."""
    if result.job.cell.rests_on is None:
        return IDENTITY
    from camgen.collision.cell import turn_upright  # noqa: PLC0415 (fcl, rarely needed)

    return turn_upright(result.job.cell.rests_on)


def view(result: Built) -> View:
    """What the preview of ``result`` shows."""
    part, program = result.part, result.program
    sag = _sag(result)
    way, arm = track(result, sag)
    lines, chains = _lines(result, sag)
    beside = around(result)
    found = cutters_of(result)
    stock = stock_of(result, found)
    rows = _rows(result, found)
    return View(
        title=clean(f"{part.source}, {result.post.name}"),
        facts=(*_facts(result, float(way.time[-1])), *_tell_cut(found, stock)),
        lines=lines,
        chains=chains,
        solid=part.solid,
        flat=part.solid is None and not part.curves,
        rows=rows,
        track=way,
        arm=arm,
        base_from_work=program.base_from_work,
        flange_from_tool=program.flange_from_tool,
        diameter=found.tools[0].diameter,
        # The boxes are those of one tool: of several each is drawn by its own outline.
        bodies=tuple(one for one in beside.bodies if one.name != "tool" or len(found.tools) == 1),
        standing=beside.standing,
        meshes=beside.meshes,
        notes=see_notes(result.notes, lines, [row.id for row in rows]),
        listing=list_program(result, way.events.instruction),
        tools=found.tools,
        tool_of=tools_of_events(result, found, way.events.instruction, way.events.path),
        stock=stock,
        marks=marks_of(result),
        photo=photo_of(result),
        switches=switches_of(program.columns, way.events),
        executed=trace_executed(result, sag),
        fixtures=see_fixtures(result),
        upright=_stand_upright(result),
    )


def reasons(skipped: Sequence[Note]) -> dict[str, str]:
    """Why, by the id of the contours and edges that the notes are about; of several notes the first."""
    return {ident: clean(note.why or note.what) for note in reversed(skipped) for ident in note.ids}


def _sag(result: Built) -> float:
    """How far a drawn arc may be from the true one, mm."""
    ends = [result.program.columns.ends, *(path.position for path in result.tour.paths)]
    points = np.concatenate(ends)
    points = points[~np.isnan(points[:, 0])]
    return max(float(np.linalg.norm(np.ptp(points, axis=0))) * _FINE, 1e-4) if len(points) else 1e-3


def _lines(result: Built, sag: float) -> tuple[tuple[ViewLine, ...], SpaceChains]:
    """The contours, curves and edges of the part, and how they are drawn."""
    contours = tuple(c for c in result.part.contours if len(c.points) > 1)
    curves = result.part.curves
    edges = result.part.solid.edges if result.part.solid else ()
    spatial: list[Line] = [*curves, *edges]
    flat, sharp = (
        of_contours(contours, sag),
        of_spans([(one.points, one.via) for one in spatial], sag),
    )
    chains = SpaceChains(
        np.concatenate([flat.points, sharp.points]), np.concatenate([flat.counts, sharp.counts])
    )
    # What a reader of pictures calls a layer is none of the picture.
    named = result.part.raster is None
    names = [(c.id, c.layer if named else "", c.closed) for c in contours] + [
        (c.id, c.layer, c.closed) for c in curves
    ]
    names += [(e.id, f"{'convex' if e.convex else 'concave'} {e.kind}", e.closed) for e in edges]
    why = reasons([note for note in result.notes if note.kind == "skipped"])
    done = {ident for path in result.tour.paths for ident in path.contours}
    lines = [
        ViewLine(
            id=clean(ident),
            layer=clean(layer),
            closed=closed,
            length=length,
            state="done" if ident in done else "skipped" if ident in why else "unused",
            why=why.get(ident, ""),
        )
        for (ident, layer, closed), length in zip(names, _lengths(chains), strict=True)
    ]
    if edges or curves:
        return _mark_gaps(result, lines, chains)
    marks = [*_spots(result), *_outline_seen(result), *_blocked(result, sag)]
    table = SpaceChains(
        np.concatenate([chains.points, *(points for _, points in marks)]),
        np.concatenate(
            [chains.counts, np.array([len(points) for _, points in marks], dtype=np.int64)]
        ),
    )
    return (*lines, *(line for line, _ in marks)), table


def _blocked(result: Built, sag: float) -> Iterator[tuple[ViewLine, FloatArray]]:
    """The paths and stretches of paths that are left out for a fixture."""
    why = reasons([note for note in result.notes if note.kind == "skipped"])
    for path in result.blocked:
        chains = of_spans([(path.position, path.via[1:])], sag)
        length = float(np.linalg.norm(np.diff(chains.points, axis=0), axis=1).sum())
        reason = why.get(path.id, "")
        line = ViewLine(clean(path.id), clean(path.layer), False, length, "skipped", reason)
        yield line, chains.points


def _outline_seen(result: Built) -> Iterator[tuple[ViewLine, FloatArray]]:
    """The outlines in the photo that places the part."""
    for outline in list_seen(result):
        points = np.column_stack([outline, np.zeros(len(outline))])
        length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
        yield ViewLine("photo", "", False, length, "seen", ""), points


def _spots(result: Built) -> list[tuple[ViewLine, FloatArray]]:
    """A ring of the tool's size at every place that a note is about; what was decided there is not wrong."""
    radius = result.job.tool.radius
    turn = np.linspace(0.0, 2 * np.pi, _RING_POINTS)
    ring = np.column_stack([radius * np.cos(turn), radius * np.sin(turn), np.zeros(_RING_POINTS)])
    return [
        (
            ViewLine(
                f"{x:.2f}, {y:.2f} mm",
                note.kind,
                False,
                2 * np.pi * radius,
                "noted" if note.kind == "assumed" else "wrong",
                clean(note.what),
            ),
            ring + np.array([x, y, 0.0]),
        )
        for note in result.notes
        for x, y in note.places
    ]


def _mark_gaps(
    result: Built, lines: Sequence[ViewLine], chains: SpaceChains
) -> tuple[tuple[ViewLine, ...], SpaceChains]:
    """Edges that are run in pieces; the stretches that are left out are lines of their own."""
    lengths = {line.id: line.length for line in lines}
    stretches: dict[str, list[tuple[float, float]]] = {}
    names: dict[str, list[str]] = {}
    for leg in result.tour.route.legs if isinstance(result.tour, EdgeTour) else ():
        if leg.motion.part_of:
            low, rest = leg.motion.trimmed[:: -1 if leg.motion.backwards else 1]
            stretches.setdefault(leg.motion.line, []).append((low, lengths[leg.motion.line] - rest))
            names.setdefault(leg.motion.line, []).append(leg.motion.id)
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
                why = line.why or _TRIMMED
                stretch = replace(line, closed=False, state="skipped", why=why)
            pieces.append((stretch, part))
    made = SpaceChains(
        np.concatenate([part for _, part in pieces]), np.array([len(part) for _, part in pieces])
    )
    drawn = _lengths(made)
    marked = zip(pieces, drawn, strict=True)
    return tuple(replace(line, length=length) for (line, _), length in marked), made


def _lengths(chains: SpaceChains) -> list[float]:
    """Of each chain as it is drawn, mm."""
    if not len(chains.counts):
        return []
    steps = np.linalg.norm(np.diff(chains.points, axis=0, prepend=chains.points[:1]), axis=1)
    first = begins(chains.counts)
    steps[first] = 0.0
    sums: FloatArray = np.add.reduceat(steps, first)
    return list(map(float, sums.tolist()))


def _rows(result: Built, found: Cutters) -> tuple[Row, ...]:
    paths = result.tour.paths
    lengths, seconds = path_sums(paths)
    return tuple(
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
        for path, length, time, spent, operation in zip(
            paths,
            lengths.tolist(),
            seconds.tolist(),
            result.cycle.paths.tolist(),
            found.operations,
            strict=True,
        )
    )


def _facts(result: Built, seconds: float) -> tuple[tuple[str, str], ...]:
    part, tour = result.part, result.tour
    work = math.fsum(path_sums(tour.paths)[0].tolist())
    feeds, force = result.motions.speeds, result.motions.force
    found = [
        ("Part", clean(part.source)),
        ("Units", f"drawn in {clean(part.units)}, shown in mm"),
        *_tell_place(result),
        ("Controller", result.post.name),
        ("Program", clean(result.program.name)),
        ("Robot", result.reach.robot if result.reach else "not checked: no robot model"),
        ("Paths", str(len(tour.paths))),
        ("Work", f"{short(work, 1)} mm"),
        ("Travel", f"{short(tour.travel, 1)} mm ({tour.method})"),
        ("Speed", f"{short(feeds[0], 1)} to {short(feeds[1], 1)} mm/s"),
        ("Force", f"up to {short(force, 2)} N" if force else "none"),
        ("Time", f"{_tell_time(seconds)}, {_tell_time(result.cycle.travel)} of it travel"),
        (
            "Time counts",
            f"feeds, acceleration, corners, waits{' and joint speeds' if result.reach else ''}; an estimate",
        ),
        ("Verified", f"text read back, within {result.deviation.max_mm:.6f} mm"),
        ("Rounded corners", _tell_rounding(result.rounded)),
    ]
    if result.clear and result.where:
        solid = ["the part"] if part.solid else []
        names = [
            "robot",
            *(body.name for body in (*result.where.bodies, *result.where.standing)),
            *solid,
        ]
        names += [name for name, _ in result.where.meshes]
        apart = f"{short(result.clear.clearance, 2)} mm or more apart"
        if result.clear.nearest:
            apart += f", least {clean(str(result.clear.nearest))}"
        found.append(("Collision", f"none, {apart}; tested: {', '.join(names)}"))
    extents = result.motions.extents
    if extents:
        low, high = extents
        size = " x ".join(short(b - a, 1) for a, b in zip(low, high, strict=True))
        found.insert(9, ("Extents", f"{size} mm"))
    return tuple(found)


def _tell_place(result: Built) -> list[tuple[str, str]]:
    """The place of the part by a photo."""
    if result.located is None:
        return []
    photo = clean(result.located.inspection.photo.source)
    deviation = f"which leaves the drawing by {short(result.located.deviation, 3)} mm at most"
    return [("Located", f"{result.located.pose}, by {photo}, {deviation}")]


def _tell_rounding(rounded: Rounding | None) -> str:
    """The corner that the controller rounds most."""
    if rounded is None:
        return "not modelled for this controller"
    if not rounded.mm:
        return "none"
    place = " ".join(short(value, 2) for value in rounded.place)
    return f"{short(rounded.mm, 4)} mm off the path at {place} mm, line {rounded.line}"


def _tell_time(seconds: float) -> str:
    """Tenths of a second below a minute."""
    return f"{short(seconds, 1)} s" if seconds < 60 else duration(seconds)


def _tell_cut(found: Cutters, stock: Stock | None) -> list[tuple[str, str]]:
    """The tools where there are several, and the stock."""
    tools = [
        (f"Tool {k}", f"{one.name}: {one.kind}, {short(one.diameter, 2)} mm")
        for k, one in enumerate(found.tools, 1)
    ]
    told = [("Stock", tell_stock(stock))] if stock else []
    return [*(tools if len(tools) > 1 else []), *told]
