"""Sums up a program in numbers, and makes the report of a build as plain data."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np
from msgspec import Struct

from camgen.geometry.arcs import measure_arcs, measure_spans
from camgen.geometry.ragged import compute_first_rows, count_rows
from camgen.geometry.rotations import measure_angles_between
from camgen.geometry.vectors import compute_in_blocks, measure_lengths
from camgen.model.part import Note, Part
from camgen.model.path import ToolPath, Tour
from camgen.model.pose import FloatArray, Vec3, frozen, to_vec3
from camgen.model.program import (
    Columns,
    Force,
    Indices,
    MoveC,
    MoveJ,
    MoveL,
    Output,
    Stop,
    ToolChange,
    Wait,
)
from camgen.model.sequences import take_rows
from camgen.plan import Coverage
from camgen.plan.columns import join_tables

if TYPE_CHECKING:
    from camgen.check.collide import ClearanceReport
    from camgen.collision.cell import Untested

#: The value of each of ``checks`` as long as the cell has no robot model.
NOT_CHECKED = "not checked"
#: The value of ``collision`` where pairs of bodies are not tested.
PARTLY_CHECKED = "partly checked"


class Motions(Struct, frozen=True):
    """The sums of a program.

    counts: number of instructions by kind.
    straight, arc, joint: lengths of the path of the TCP, mm. A joint motion counts as the straight
        line between its ends, and has no length if one of them is given in joints.
    seconds: time of these lengths at their speeds, and of the waits, without accelerations, s.
    speeds: minimum and maximum, mm/s.
    extents: minimum and maximum of all targets and via points, mm, in the work object of most
        motions. None without Cartesian targets.
    outputs: values of each output, in order of first use.
    force: maximum, N.
    extents_by_work: extents in each work object by its number, if there are several; else empty.
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
    extents_by_work: dict[int, tuple[Vec3, Vec3]] = {}


class Cycle(Struct, frozen=True, eq=False):
    """The time of a program.

    total: time of the whole program, s.
    travel: part of it that is on no path: links, motions from and to home, plunges, and the waits
        there, s.
    paths: (P,) time on each path of the tour, with all its passes and waits, s.
    links: (P,) travel to each path, s. The rest of `travel` is the link home.
    """

    total: float
    travel: float
    paths: FloatArray
    links: FloatArray


#: Number of values that are converted to Python numbers at a time.
_BLOCK = 4096
_COUNTED = (MoveJ, MoveL, MoveC, Output, Wait, Force, ToolChange, Stop)


def sum_up(columns: Columns, works: Sequence[int] = ()) -> Motions:
    """Sum up a body of instructions.

    works: number of the work object of each instruction, empty for one. Poses in different work
        objects are not comparable: a motion from one into another has no length.
    """
    speed = columns.speed
    work = np.asarray(works, np.intp)[columns.at] if works else np.zeros(len(speed), np.intp)
    extents = _find_extents(columns, work)
    length = motion_lengths(columns)
    length[1:][work[1:] != work[:-1]] = 0.0
    seconds = exact_sum(np.maximum(length / speed, _time_reorientations(columns)))
    outputs: dict[str, dict[float, None]] = {}
    for item in columns.outputs:
        outputs.setdefault(item.signal, {})[item.value] = None
    return Motions(
        counts={kind.__name__: int(columns.are(kind).sum()) for kind in _COUNTED},
        straight=exact_sum(length[columns.moves_are(MoveL)]),
        arc=exact_sum(length[columns.moves_are(MoveC)]),
        joint=exact_sum(length[columns.moves_are(MoveJ)]),
        seconds=seconds + math.fsum(item.seconds for item in columns.list_kinds(Wait)),
        speeds=(float(speed.min()), float(speed.max())) if len(speed) else (0.0, 0.0),
        extents=next(iter(extents.values()), None),
        outputs={name: tuple(values) for name, values in outputs.items()},
        force=max((item.newtons for item in columns.list_kinds(Force)), default=0.0),
        extents_by_work=extents if len(extents) > 1 else {},
    )


def _find_extents(columns: Columns, work: Indices) -> dict[int, tuple[Vec3, Vec3]]:
    """Find the extents of each work object by its number, the one with most motions first.

    work: (M,) number of the work object of each motion.
    """
    extents = {}
    for number, _ in Counter(work[columns.posed].tolist()).most_common():
        points = columns.ends[work == number], columns.via[work[columns.arcs] == number]
        extents[number] = _corner(np.fmin, *points), _corner(np.fmax, *points)
    return extents


def _time_reorientations(columns: Columns) -> FloatArray:
    seconds = np.zeros(len(columns.at))
    motions = np.flatnonzero((columns.turn > 0) & columns.posed)
    motions = motions[(motions > 0) & columns.posed[motions - 1]]
    if len(motions):
        table, rotation = columns.table, columns.rotation
        before = np.stack(take_rows(table, rotation[motions - 1].tolist()))
        after = np.stack(take_rows(table, rotation[motions].tolist()))
        seconds[motions] = measure_angles_between(before, after) / columns.turn[motions]
    return seconds


def motion_lengths(columns: Columns) -> FloatArray:
    """Compute the path of the TCP on each motion (M,), mm; 0 if an end is unknown."""
    end, arcs = columns.ends, columns.arcs
    start = np.concatenate([np.full((min(1, len(end)), 3), np.nan), end[:-1]])
    length = compute_in_blocks(lambda a, b: measure_lengths(b - a), start, end)
    length[arcs] = compute_in_blocks(measure_arcs, start[arcs], columns.via, end[arcs])
    return np.asarray(np.nan_to_num(length))


def exact_sum(values: FloatArray) -> float:
    """Sum up `values` (N,) with one rounding."""
    blocks = (values[low : low + _BLOCK].tolist() for low in range(0, len(values), _BLOCK))
    return math.fsum(chain.from_iterable(blocks))


def _corner(outer: np.ufunc, *points: FloatArray) -> Vec3:
    """Reduce points (N, 3) per axis by `outer`, fmin or fmax, without unknown ones."""
    corners = [outer.reduce(column, axis=0) for column in points if len(column)]
    return to_vec3(outer.reduce(np.stack(corners), axis=0))


def path_sums(paths: Sequence[ToolPath]) -> tuple[FloatArray, FloatArray]:
    """Compute length (N,), mm, and time at the feeds (N,), s, of paths with all their passes."""
    if not paths:
        return frozen([]), frozen([])
    first, drawn = compute_first_rows(count_rows(paths)), join_tables(paths)
    steps = np.concatenate([[0.0], measure_spans(drawn.position, drawn.via[1:])])
    steps[first] = 0.0  # from one path to the next
    passes = np.array([len(path.depths) for path in paths])
    length = np.add.reduceat(steps, first) * passes
    return frozen(length), frozen(np.add.reduceat(steps / drawn.feed, first) * passes)


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
    """Make the report of a build: mm, s, N; lengths to 1e-3 mm, the deviation to 1e-6 mm.

    The report states that no robot has checked the program.

    time: time of the program.
    text: its text.
    coverage: coverage of a fill.
    """
    contours = part.curves or part.contours
    lengths, durations = path_sums(tour.paths)
    times = (column.tolist() for column in (lengths, durations, time.paths, time.links))
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
        "paths": [_make_path_row(*row) for row in zip(tour.paths, *times, strict=True)],
        "skipped": [
            {"what": clean(n.what), "why": clean(n.why)} for n in notes if n.kind == "skipped"
        ],
        "tour": {
            "method": tour.method,
            "work_mm": round(math.fsum(lengths.tolist()), 3),
            "travel_mm": round(tour.travel, 3),
            "bound_mm": None if tour.bound is None else round(tour.bound, 3),
        },
        **({} if coverage is None else {"coverage": _make_coverage(coverage)}),
        "time_s": round(time.total, 1),
        "travel_s": round(time.travel, 1),
        "checks": dict.fromkeys(("reach", "collision", "limits"), NOT_CHECKED),
        "verify": {"status": "equal", "max_deviation_mm": round(text.deviation, 6)},
        "files": [clean(name) for name in text.files],
        "notes": [{"kind": n.kind, "what": clean(n.what), "why": clean(n.why)} for n in notes],
    }


def add_clearances(table: dict[str, object], clear: ClearanceReport) -> None:
    """Add the clearances of a program to its report, mm to 1e-3.

    The report gets the smallest clearance, the bound up to which it is measured, and the clearance
    of the link home; below the bound also the bodies, the path or link, and the position. Each path
    gets the clearance on it and on the link to it.
    """
    paths: Any = table["paths"]
    work, links, home = clear.by_path(len(paths))
    nearest = clear.nearest
    sums = {"mm": clear.clearance, "bound_mm": clear.bound, "home_mm": home}
    row: dict[str, object] = {name: round(value, 3) for name, value in sums.items()}
    if nearest:
        row |= {"between": list(nearest.pair), "on": clean(nearest.on), "at": nearest.at}
    table["clearance"] = row
    for path, on_path, on_link in zip(paths, work, links, strict=True):
        path["clearance_mm"] = round(on_path, 3)
        path["link_clearance_mm"] = round(on_link, 3)


def untested_of(pairs: Sequence[Untested]) -> list[dict[str, object]]:
    """List the bodies that are not tested against each other, with the reason of each pair."""
    return [{"bodies": list(map(clean, pair.bodies)), "why": clean(pair.why)} for pair in pairs]


def _make_coverage(coverage: Coverage) -> dict[str, float]:
    areas = {
        "covered": coverage.covered,
        "ink_outside": coverage.outside,
        "ink_beside_thin": coverage.thin,
    }
    row = {"copper_mm2": round(coverage.copper, 3)}
    for name, area in areas.items():
        row[f"{name}_percent"] = round(coverage.percent(area), 3)
        row[f"{name}_mm2"] = round(area, 3)
    return row


def _make_path_row(
    path: ToolPath, length: float, seconds: float, time: float, travel: float
) -> dict[str, object]:
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
    """Return `text` in valid UTF-8: names of files and layers may contain other bytes."""
    return text.encode("utf-8", "replace").decode("utf-8")
