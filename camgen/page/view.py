"""What a preview shows, as one value: ``view`` makes it of a build's result. Work frame, mm, s, N, rad."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from camgen.job import Result
from camgen.page.curves import Chains, of_contours, of_spans
from camgen.page.track import Arm, Track, track
from camgen.pose import FloatArray, Pose
from camgen.report import clean, path_sums
from camgen.robots.models import robot
from camgen.shapes import Note
from camgen.solid import Solid
from camgen.text import short

#: Arcs are drawn to this part of the size of what is shown.
_FINE = 2e-5
_NAMES = re.compile(r"(?<![\w.])((?:\d+/)?)([ce])(\d+)(?:-(?:\d+/)?[ce](\d+))?(?![\w.])")


class Line(Struct, frozen=True):
    """A contour or an edge: state is "done", "skipped" or "unused" (nothing was asked of it); why it was skipped."""

    id: str
    layer: str
    closed: bool
    length: float
    state: str
    why: str


class Row(Struct, frozen=True):
    """A tool path as the list has it: mm, mm/s, N, s; depths: number of passes."""

    id: str
    layer: str
    length: float
    feed: float
    force: float
    seconds: float
    passes: int


class View(Struct, frozen=True, eq=False):
    """title: of the page. facts: label and text of the numbers to show. lines: what ``chains`` draws, in its order.

    solid: triangles, None for a flat part. arm: the robot, None where none is known. base_from_work,
    flange_from_tool: of the program. diameter: of the tool, mm. holder: boxes at the flange, fixtures: boxes in the
    work frame, each as two opposite corners. skipped: what was left out.
    """

    title: str
    facts: tuple[tuple[str, str], ...]
    lines: tuple[Line, ...]
    chains: Chains
    solid: Solid | None
    rows: tuple[Row, ...]
    track: Track
    arm: Arm | None
    base_from_work: Pose
    flange_from_tool: Pose
    diameter: float
    holder: tuple[tuple[float, ...], ...]
    fixtures: tuple[tuple[float, ...], ...]
    skipped: tuple[Note, ...]


def view(result: Result) -> View:
    """What the preview of ``result`` shows."""
    part, program = result.part, result.program
    skipped = tuple(note for note in result.notes if note.kind == "skipped")
    sag = _sag(result)
    known = result.job.cell.robot or result.cell.robot
    model = robot(known) if result.reach and known else None
    way, arm = track(program, result.tour, result.reach, model, sag)
    contours = tuple(c for c in part.contours if len(c.points) > 1)
    edges = part.solid.edges if part.solid else ()
    flat, sharp = of_contours(contours, sag), of_spans([(edge.points, edge.via) for edge in edges], sag)
    chains = Chains(np.concatenate([flat.points, sharp.points]), np.concatenate([flat.counts, sharp.counts]))
    names = [(c.id, c.layer, c.closed) for c in contours]
    names += [(e.id, f"{'convex' if e.convex else 'concave'} {e.kind}", e.closed) for e in edges]
    return View(
        title=clean(f"{part.source}, {result.post.name}"),
        facts=_facts(result, float(way.time[-1])),
        lines=_lines(names, chains, {path.id.partition(".")[0] for path in result.tour.paths}, skipped),
        chains=chains,
        solid=part.solid,
        rows=_rows(result),
        track=way,
        arm=arm,
        base_from_work=program.base_from_work,
        flange_from_tool=program.flange_from_tool,
        diameter=result.job.tool.diameter,
        holder=tuple(map(tuple, result.job.tool.holder or ())),
        fixtures=tuple(tuple(box) for box in result.job.cell.fixtures or () if not isinstance(box, str)),
        skipped=tuple(Note(note.kind, clean(note.what), clean(note.why)) for note in skipped),
    )


def reasons(skipped: Sequence[Note]) -> dict[str, str]:
    """Why, by the id of the contours and edges that the notes name, one by one (c3) or as a range (c3-c8)."""
    found: dict[str, str] = {}
    for note in skipped:
        for before, letter, first, last in _NAMES.findall(note.what):
            for number in range(int(first), int(last or first) + 1):
                found.setdefault(f"{before}{letter}{number}", clean(note.why or note.what))
    return found


def _sag(result: Result) -> float:
    """How far a drawn arc may be from the true one, mm."""
    ends = [result.program.columns.ends, *(path.position for path in result.tour.paths)]
    points = np.concatenate(ends)
    points = points[~np.isnan(points[:, 0])]
    return max(float(np.linalg.norm(np.ptp(points, axis=0))) * _FINE, 1e-4) if len(points) else 1e-3


def _lines(
    names: Sequence[tuple[str, str, bool]], chains: Chains, done: set[str], skipped: Sequence[Note]
) -> tuple[Line, ...]:
    why = reasons(skipped)
    lengths = _lengths(chains)
    return tuple(
        Line(
            id=clean(ident),
            layer=clean(layer),
            closed=closed,
            length=length,
            state="done" if ident in done else "skipped" if ident in why else "unused",
            why="" if ident in done else why.get(ident, ""),
        )
        for (ident, layer, closed), length in zip(names, lengths, strict=True)
    )


def _lengths(chains: Chains) -> list[float]:
    """Of each chain as it is drawn, mm."""
    if not len(chains.counts):
        return []
    steps = np.linalg.norm(np.diff(chains.points, axis=0, prepend=chains.points[:1]), axis=1)
    first = np.cumsum(chains.counts) - chains.counts
    steps[first] = 0.0
    sums: FloatArray = np.add.reduceat(steps, first)
    return list(map(float, sums.tolist()))


def _rows(result: Result) -> tuple[Row, ...]:
    paths = result.tour.paths
    lengths, seconds = path_sums(paths)
    return tuple(
        Row(
            id=clean(path.id),
            layer=clean(path.layer),
            length=length,
            feed=length / time if time > 0 else float(path.feed[0]),
            force=float(path.force.max()),
            seconds=time,
            passes=len(path.depths),
        )
        for path, length, time in zip(paths, lengths.tolist(), seconds.tolist(), strict=True)
    )


def _facts(result: Result, seconds: float) -> tuple[tuple[str, str], ...]:
    part, tour = result.part, result.tour
    work = math.fsum(path_sums(tour.paths)[0].tolist())
    feeds, force = result.motions.speeds, result.motions.force
    found = [
        ("Part", clean(part.source)),
        ("Units", f"drawn in {clean(part.units)}, shown in mm"),
        ("Controller", result.post.name),
        ("Program", clean(result.program.name)),
        ("Robot", result.reach.robot if result.reach else "not checked: no robot model"),
        ("Paths", str(len(tour.paths))),
        ("Work", f"{short(work, 1)} mm"),
        ("Travel", f"{short(tour.travel, 1)} mm ({tour.method})"),
        ("Speed", f"{short(feeds[0], 1)} to {short(feeds[1], 1)} mm/s"),
        ("Force", f"up to {short(force, 2)} N" if force else "none"),
        ("Time", f"{short(seconds, 1)} s without acceleration"),
        ("Verified", f"text read back, within {result.deviation.max_mm:.6f} mm"),
    ]
    meshes = sum(isinstance(one, str) for one in result.job.cell.fixtures or ())
    if meshes:
        found.append(("Not drawn", f"{meshes} of the fixtures, which are meshes"))
    extents = result.motions.extents
    if extents:
        low, high = extents
        size = " x ".join(short(b - a, 1) for a, b in zip(low, high, strict=True))
        found.insert(9, ("Extents", f"{size} mm"))
    return tuple(found)
