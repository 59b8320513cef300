"""Jobs that ``camgen init --operations`` proposes, built unedited and judged from their text.

    python -m bench.plan.proposals [FOLDER] [DRAWINGS, 30]

The drawings are chosen by a rule, not by hand: the DXF files of FOLDER with a closed contour and
no coordinate of one beyond 99,999 mm, in the order of the SHA-256 of their bytes, the first
DRAWINGS of them. A drawing without a unit is read in mm.

LinuxCNC's interpreter runs the program (Debian package linuxcnc-uspace). A sweep of this file's
own takes the material away, motion by motion, and looks at each descent of a mill. Exit code 1 if

- a mill descends in material at more than the angle of `operation.entry_angle`,
- a program takes more than two hours,
- less than 95 % of the length of the closed contours is in operations, or
- a drawing has no program.

Columns: `closed` is the length of the closed contours, and the share of it that paths work on.
`steep` counts descents of mills that are too steep, `deepest` is the depth in material of the
deepest of them, mm. `hours` is the time of the program as the report states it.
"""

from __future__ import annotations

import hashlib
import math
import re
import sys
import tempfile
import tomllib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import chdir
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely

import camgen
from bench.support.commands import run_camgen
from bench.support.motions import Array, LevelArc
from bench.support.runner import SHARED, Cells, Missed, Scenario, find_files, run
from camgen.geometry.segments import make_contour_segments
from camgen.model.job import InputTable, Job
from camgen.read import read
from camgen.read.files import Files
from tests.support import canon

#: The most that a program may take, h.
MOST_HOURS = 2.0
#: The least share of the length of closed contours that operations work on.
LEAST_SHARE = 0.95
#: No coordinate of a closed contour is beyond this, mm: the G-code post refuses larger ones.
FARTHEST_MM = 99_999.0
#: Arcs are divided into chords that leave them by this, mm.
CHORD_MM = 0.005
#: Material that stands less than this above the tip is the rounding of printed numbers, mm.
STANDING_MM = 0.02
#: An entry is steeper than its angle from this factor of the slope on: numbers are rounded.
STEEPER = 1.05
COLUMNS = (
    "drawing | closed mm {:.0f} | in operations % {:.1f} | operations {} | tools {} "
    "| steep {} | deepest mm {:.2f} | hours {:.2f}"
)
_TOOL_CHANGE = re.compile(r"^T(\d+) M6", re.MULTILINE)


class Sweep(NamedTuple):
    """Straight pieces of the motions of a program, in order.

    start, end: (N, 3) mm.
    radius: (N,) radius of the tool, mm.
    is_mill: (N,) whether the tool is a mill.
    angle: (N,) largest angle of an entry, rad.
    """

    start: Array
    end: Array
    radius: Array
    is_mill: Array
    angle: float


class Descents(NamedTuple):
    """Descents that are too steep.

    number: number of these descents.
    deepest: largest depth in material, mm.
    """

    number: int
    deepest: float


def choose_drawings(folder: Path, count: int) -> list[Path]:
    """The first drawings that the rule allows, in the order of the digest of their bytes."""
    files = find_files(folder, (".dxf",))
    files.sort(key=lambda path: hashlib.sha256(path.read_bytes()).hexdigest())
    chosen: list[Path] = []
    for path in files:
        if len(chosen) < count and _is_for_a_mill(path):
            chosen.append(path)
    return chosen


def _is_for_a_mill(path: Path) -> bool:
    part = _read(path)
    closed = [c.points for c in part.contours if c.closed] if part else []
    return bool(closed) and bool(np.abs(np.vstack(closed)).max() <= FARTHEST_MM)


def _read(path: Path) -> camgen.Part | None:
    for units in ("auto", "mm"):
        try:
            return read(path, Job(input=InputTable(units=units)), Files())
        except camgen.CamgenError:
            continue
    return None


def measure(path: Path) -> Iterator[Cells]:
    """The row of a drawing."""
    name = f"{path.parent.name}/{path.name}"
    part = _read(path)
    assert part is not None
    with tempfile.TemporaryDirectory() as folder:
        error, job = _propose(path, Path(folder))
    if job is None:
        yield name, None, None, None, None, Missed(f"no proposal: {error}")
        return
    try:
        result = camgen.build(path, post="gcode", job=job)
    except camgen.CamgenError as error:
        yield name, None, None, None, None, Missed(f"not built: {error}")
        return
    length, share = _measure_share(part, result)
    steep = find_steep(read_sweep(result, job))
    hours = result.cycle.total / 3600
    yield (
        name,
        length,
        100 * share if share >= LEAST_SHARE else Missed(f"**{100 * share:.1f}**"),
        len(job["operations"]),
        len(job["tools"]),
        steep.number if not steep.number else Missed(f"**{steep.number}**"),
        steep.deepest,
        hours if hours <= MOST_HOURS else Missed(f"**{hours:.2f}**"),
    )


def _propose(path: Path, folder: Path) -> tuple[str, dict[str, Any] | None]:
    """The job that ``camgen init --operations`` writes, or the error and None."""
    message = ""
    for sets in ((), ("--set", "input.units=mm")):
        with chdir(folder):
            code, lines = run_camgen("init", path, "--operations", *sets)
        if code == 0:
            text = (folder / f"{path.stem}.toml").read_text()
            return "", tomllib.loads(text)
        message = message or lines[-1]
    return message, None


def _measure_share(part: camgen.Part, result: camgen.Result) -> tuple[float, float]:
    """The length of the closed contours, mm, and the share of it that paths work on."""
    closed = [contour for contour in part.contours if contour.closed]
    segments = make_contour_segments(closed)
    lengths = np.bincount(segments.owner, segments.length, len(closed))
    worked = set[str]()
    for path in result.planned:
        worked.update(path.contours)
    chosen = np.array([contour.id in worked for contour in closed])
    return float(lengths.sum()), float(lengths[chosen].sum() / lengths.sum())


# The sweep, from the text alone.


def read_sweep(result: camgen.Result, job: dict[str, Any]) -> Sweep:
    """The motions of the program as LinuxCNC's interpreter makes them."""
    tools = {int(tool["number"]): tool for tool in job["tools"]}
    table = "".join(f"T{k} P{k} Z0 D{tool['diameter']}\n" for k, tool in tools.items())
    output = canon.run(result.text, table)
    if output.error:
        raise SystemExit(f"rs274 refuses the program: {output.error}")
    changes = iter(map(int, _TOOL_CHANGE.findall(result.text)))
    calls = iter(output.moves)
    number, at = next(iter(tools)), (0.0, 0.0, 0.0)
    pieces: list[Array] = []
    numbers: list[Array] = []
    for name in output.names:
        if name == "CHANGE_TOOL":
            number = next(changes)
        elif name in ("STRAIGHT_TRAVERSE", "STRAIGHT_FEED", "ARC_FEED"):
            call = next(calls)
            points = _divide(at, call)
            pieces.append(np.hstack([points[:-1], points[1:]]))
            numbers.append(np.full(len(points) - 1, number))
            at = call.end
    rows, used = np.vstack(pieces), np.concatenate(numbers)
    radius = np.array([float(tools[k]["diameter"]) / 2 for k in used.tolist()])
    is_mill = np.array([tools[k]["kind"] != "drill" for k in used.tolist()])
    steepest = max(float(row.get("entry_angle", 3.0)) for row in job["operations"])
    return Sweep(rows[:, :3], rows[:, 3:], radius, is_mill, math.radians(steepest))


def _divide(at: tuple[float, float, float], call: canon.Call) -> Array:
    """Points along a motion, (N, 3) mm."""
    start, end = np.array(at), np.array(call.end)
    if call.kind != "ARC_FEED" or call.axes != (0, 1, 2):
        return np.array([start, end])
    arc = LevelArc(start, end, np.array(call.centre), call.turns > 0, abs(call.turns))
    return arc.sample(CHORD_MM)


def find_steep(sweep: Sweep) -> Descents:
    """The descents of mills in material that are steeper than the angle of an entry.

    A descent is in material where points of the tool's disc, as high as its tip, were in no tool
    before. There is material everywhere at first.
    """
    down = sweep.start[:, 2] - sweep.end[:, 2]
    level = np.hypot(*(sweep.end - sweep.start)[:, :2].T)
    steep = (
        sweep.is_mill
        & (sweep.end[:, 2] < -STANDING_MM)
        & (down > 1e-3)
        & (down > STEEPER * math.tan(sweep.angle) * level + 1e-3)
    )
    rows = np.flatnonzero(steep)
    if not len(rows):
        return Descents(0, 0.0)
    lines = shapely.linestrings(np.stack([sweep.start[:, :2], sweep.end[:, :2]], axis=1))
    tree = shapely.STRtree(lines)
    widest = float(sweep.radius.max())
    depths: list[float] = []
    for row in rows.tolist():
        x, y, z = sweep.end[row].tolist()
        near = tree.query(shapely.box(x - 1, y - 1, x + 1, y + 1).buffer(2 * widest))
        depth = _depth_in_material(sweep, row, near[near < row], z)
        if depth > STANDING_MM:
            depths.append(depth)
    return Descents(len(depths), max(depths, default=0.0))


def _depth_in_material(sweep: Sweep, row: int, before: Array, z: float) -> float:
    """How high the material stands above the tip in the disc of the tool, mm; 0 without any."""
    points = sweep.end[row, :2] + _disc(float(sweep.radius[row]) - STANDING_MM)
    start, end = sweep.start[before], sweep.end[before]
    along = (end - start)[:, :2]
    square = np.maximum((along**2).sum(axis=1), 1e-12)
    height = np.zeros(len(points))
    for k, point in enumerate(points):
        share = np.clip(((point - start[:, :2]) * along).sum(axis=1) / square, 0.0, 1.0)
        nearest = start + share[:, None] * (end - start)
        gap = np.hypot(*(nearest[:, :2] - point).T)
        swept = nearest[gap <= sweep.radius[before], 2]
        upright = np.hypot(*along.T) < 1e-9
        lowest = np.where(upright, end[:, 2], nearest[:, 2])[gap <= sweep.radius[before]]
        height[k] = min(0.0, float(np.minimum(swept, lowest).min(initial=0.0)))
    return float((height - z).max())


def _disc(radius: float) -> Array:
    """Points of a disc, (N, 2) mm."""
    angle = np.linspace(0.0, math.tau, 24, endpoint=False)
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    return np.vstack([np.zeros((1, 2)), *(share * radius * ring for share in (0.35, 0.7, 1.0))])


def main(arguments: Sequence[str]) -> int:
    if canon.RS274 is None:
        print("rs274 is not installed (Debian package linuxcnc-uspace)")
        return 1
    folder = Path(arguments[0]) if arguments else SHARED / "dxf"
    count = int(arguments[1]) if len(arguments) > 1 else 30
    drawings: Iterable[Path] = choose_drawings(folder, count)
    return run(Scenario(COLUMNS, ((path,) for path in drawings), measure))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
