"""What a program amounts to in numbers, and the report of a build as plain data."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np
from msgspec import Struct

from camgen.geometry.arcs import measure_arcs, measure_spans
from camgen.geometry.rotations import angles_between
from camgen.geometry.vectors import in_blocks, lengths
from camgen.model.part import Note, Part
from camgen.model.path import ToolPath, Tour
from camgen.model.pose import FloatArray, Vec3, frozen, to_vec3
from camgen.model.program import Columns, Force, MoveC, MoveJ, MoveL, Output, Stop, ToolChange, Wait
from camgen.plan import Coverage

if TYPE_CHECKING:
    from camgen.check.collide import Clear
    from camgen.collision.cell import Untested

#: The value of each of ``checks`` as long as the cell has no robot model.
NOT_CHECKED = "not checked"
#: The value of ``collision`` where pairs of bodies are not tested.
PARTLY_CHECKED = "partly checked"


class Motions(Struct, frozen=True):
    """What a program does, summed up.

    counts: instructions by kind. straight, arc, joint: mm of the TCP; a joint motion is counted as the straight line
    between its ends, 0 where one end is given in joints. seconds: those lengths at their speeds, and the waits; what
    the controller spends on acceleration and signals is not in it. speeds: least and greatest, mm/s. extents: least
    and greatest corner of all targets and via points, None without Cartesian targets. outputs: by name, the values
    set, in order of first use. force: the greatest, N.
    """

    counts: dict[str, int]
    straight: float
    arc: float
    joint: float
    seconds: float
    speeds: tuple[float, float]
    extents: tuple[Vec3, Vec3] | None
    outputs: dict[str, tuple[float, ...]]
    force: float


class Cycle(Struct, frozen=True, eq=False):
    """The time of a program, s. total: of all of it. travel: of what is on no path: ways between paths, from and to
    home, plunges, and waits there. paths: (P,) on each path of the tour, all its passes, with its waits. links: (P,) of
    the travel that leads to each path; the rest of ``travel`` is the way back to home.
    """

    total: float
    travel: float
    paths: FloatArray
    links: FloatArray


#: So many numbers are looked at as objects at a time.
_SOME = 4096
_COUNTED = (MoveJ, MoveL, MoveC, Output, Wait, Force, ToolChange, Stop)


def sum_up(columns: Columns) -> Motions:
    """The sums of a body of instructions."""
    end, via, speed = columns.ends, columns.via, columns.speed
    line, arc, joint = (columns.moves_are(kind) for kind in (MoveL, MoveC, MoveJ))
    length = motion_lengths(columns)
    seconds = exact_sum(np.maximum(length / speed, _turn_seconds(columns)))
    waits = math.fsum(item.seconds for item in columns.of(Wait))
    outputs: dict[str, dict[float, None]] = {}
    for item in columns.outputs:
        outputs.setdefault(item.signal, {})[item.value] = None
    return Motions(
        counts={kind.__name__: int(columns.are(kind).sum()) for kind in _COUNTED},
        straight=exact_sum(length[line]),
        arc=exact_sum(length[arc]),
        joint=exact_sum(length[joint]),
        seconds=seconds + waits,
        speeds=(float(speed.min()), float(speed.max())) if len(speed) else (0.0, 0.0),
        extents=(_corner(np.fmin, end, via), _corner(np.fmax, end, via))
        if columns.posed.any()
        else None,
        outputs={name: tuple(values) for name, values in outputs.items()},
        force=max((item.newtons for item in columns.of(Force)), default=0.0),
    )


def _turn_seconds(columns: Columns) -> FloatArray:
    """(M,) s that motions with a speed of turning take for their turn, 0 for others."""
    seconds = np.zeros(len(columns.at))
    motions = np.flatnonzero((columns.turn > 0) & columns.posed)
    motions = motions[(motions > 0) & columns.posed[motions - 1]]
    if len(motions):
        table, rotation = columns.table, columns.rotation
        before = np.stack([table[k] for k in rotation[motions - 1].tolist()])
        after = np.stack([table[k] for k in rotation[motions].tolist()])
        seconds[motions] = angles_between(before, after) / columns.turn[motions]
    return seconds


def motion_lengths(columns: Columns) -> FloatArray:
    """(M,) mm of the TCP, 0 of motions from where or to where nobody knows."""
    end, arcs = columns.ends, columns.arcs
    start = np.concatenate([np.full((min(1, len(end)), 3), np.nan), end[:-1]])
    length = in_blocks(lambda a, b: lengths(b - a), start, end)
    length[arcs] = in_blocks(measure_arcs, start[arcs], columns.via, end[arcs])
    return np.asarray(np.nan_to_num(length))


def exact_sum(values: FloatArray) -> float:
    """The sum of ``values`` (N,), rounded once."""
    blocks = (values[low : low + _SOME].tolist() for low in range(0, len(values), _SOME))
    return math.fsum(chain.from_iterable(blocks))


def _corner(outer: np.ufunc, *points: FloatArray) -> Vec3:
    """The ``outer`` one, fmin or fmax, of points (N, 3) by axis, without those that are not known."""
    corners = [outer.reduce(column, axis=0) for column in points if len(column)]
    return to_vec3(outer.reduce(np.stack(corners), axis=0))


def path_sums(paths: Sequence[ToolPath]) -> tuple[FloatArray, FloatArray]:
    """Length (mm) and duration (s, at the feeds alone) of every path, all its passes, each (N,)."""
    if not paths:
        return frozen([]), frozen([])
    counts = [len(path.position) for path in paths]
    first = np.cumsum([0, *counts[:-1]])
    inner = measure_spans(
        np.concatenate([p.position for p in paths]), np.concatenate([p.via for p in paths])[1:]
    )
    steps = np.concatenate([[0.0], inner])
    steps[first] = 0.0  # from one path to the next
    passes = np.array([len(path.depths) for path in paths])
    durations = steps / np.concatenate([path.feed for path in paths])
    return frozen(np.add.reduceat(steps, first) * passes), frozen(
        np.add.reduceat(durations, first) * passes
    )


class Verified(Struct, frozen=True):
    """The text of a program that was read back.

    files: names of its files.
    deviation: largest deviation of the text from the program, mm.
    """

    files: tuple[str, ...]
    deviation: float


def report(
    part: Part,
    tour: Tour,
    notes: Sequence[Note],
    time: Cycle,
    text: Verified,
    coverage: Coverage | None = None,
) -> dict[str, object]:
    """The report of a build (contract, section 5): mm, s, N; lengths to 1e-3 mm, the deviation to 1e-6 mm.

    time: time of the program.
    text: its text.
    coverage: coverage of a fill.
    The report says that no robot has checked the program.
    """
    contours = part.curves or part.contours
    lengths, durations = path_sums(tour.paths)
    times = (column.tolist() for column in (lengths, durations, time.paths, time.links))
    rows = zip(tour.paths, *times, strict=True)
    return {
        "input": {
            "source": clean(part.source),
            "units": part.units,
            "contours": len(part.contours),
            "closed": sum(c.closed for c in contours),
            "open": sum(not c.closed for c in contours),
            "layers": sorted({clean(c.layer) for c in contours}),
            **({} if part.solid is None else {"edges": len(part.solid.edges)}),
            **({"curves": len(part.curves)} if part.curves else {}),
        },
        "paths": [_path(*row) for row in rows],
        "skipped": [
            {"what": clean(n.what), "why": clean(n.why)} for n in notes if n.kind == "skipped"
        ],
        "tour": {
            "method": tour.method,
            "work_mm": round(math.fsum(lengths.tolist()), 3),
            "travel_mm": round(tour.travel, 3),
            "bound_mm": None if tour.bound is None else round(tour.bound, 3),
        },
        **({} if coverage is None else {"coverage": _coverage(coverage)}),
        "time_s": round(time.total, 1),
        "travel_s": round(time.travel, 1),
        "checks": dict.fromkeys(("reach", "collision", "limits"), NOT_CHECKED),
        "verify": {"status": "equal", "max_deviation_mm": round(text.deviation, 6)},
        "files": [clean(name) for name in text.files],
        "notes": [{"kind": n.kind, "what": clean(n.what), "why": clean(n.why)} for n in notes],
    }


def add_clearances(table: dict[str, object], clear: Clear) -> None:
    """Adds the clearances of a program, mm to 1e-3, to its report.

    In the report as a whole: the least one and the bound up to which it is measured; the bodies,
    the path or link and the place, if it is below the bound; and that of the link home.
    In each path: the clearance on it and on the link that leads to it.
    """
    paths: Any = table["paths"]
    work, links, home = clear.by_path(len(paths))
    nearest = clear.nearest
    place = (
        {"between": list(nearest.pair), "on": clean(nearest.on), "at": nearest.at}
        if nearest
        else {}
    )
    sums = {"mm": clear.clearance, "bound_mm": clear.bound, "home_mm": home}
    table["clearance"] = {name: round(value, 3) for name, value in sums.items()} | place
    for path, on_path, on_link in zip(paths, work, links, strict=True):
        path["clearance_mm"] = round(on_path, 3)
        path["link_clearance_mm"] = round(on_link, 3)


def untested_of(pairs: Sequence[Untested]) -> list[dict[str, object]]:
    """The bodies that are not tested against each other, and the reason of each pair."""
    return [{"bodies": list(map(clean, pair.bodies)), "why": clean(pair.why)} for pair in pairs]


def _coverage(found: Coverage) -> dict[str, float]:
    """mm2 to 1e-3, shares of the copper to 1e-3 %."""
    areas = {"covered": found.covered, "ink_outside": found.outside, "ink_beside_thin": found.thin}
    told = {"copper_mm2": round(found.copper, 3)}
    for name, area in areas.items():
        told |= {f"{name}_percent": round(found.percent(area), 3), f"{name}_mm2": round(area, 3)}
    return told


def _path(
    path: ToolPath, length: float, seconds: float, time: float, travel: float
) -> dict[str, object]:
    """feed: mm/s of the tool centre, its mean; force: the greatest, N; travel_s: of the way to the path."""
    return {
        "id": path.id,
        "layer": clean(path.layer),
        "contours": [clean(ident) for ident in path.contours],
        "operation": path.operation,
        "closed": path.closed,
        "length_mm": round(length, 3),
        "feed": round(length / seconds if seconds > 0 else float(path.feed[0]), 3),
        "force": round(float(path.force.max()), 3),
        "time_s": round(time, 2),
        "travel_s": round(travel, 2),
    }


def clean(text: str) -> str:
    """``text`` that UTF-8 can hold: names of files and layers may hold bytes that are no text."""
    return text.encode("utf-8", "replace").decode("utf-8")
