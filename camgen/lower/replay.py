"""A recorded program for another machine: its motions between the two home positions of that machine.

A rapid motion becomes travel at ``process.travel`` along the straight line, or stays one where the axes of the machine
are the coordinates. Feeds are those of the program. Corners are rounded within ``tolerance.chord``, unless the program
asks for an exact path (G61, G61.1).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from msgspec.structs import replace

from camgen.lower import origins
from camgen.lower.columns import ZONES
from camgen.model.cell import Cell
from camgen.model.errors import JobError
from camgen.model.job import Job
from camgen.model.path import ToolPath, Tour, segment_lengths
from camgen.model.pose import TOOL_DOWN, FloatArray, Pose, frozen
from camgen.model.program import Columns, Instruction, MoveC, MoveJ, MoveL, Program, taken
from camgen.plan.unused import no_idle
from camgen.read.gcode.interpreter import Recorded

#: Nearer than this two points are one, mm: a motion between them is none.
_SAME = 1e-6


def check(job: Job) -> None:
    """JobError for a setting that would have no effect, or another operation than a replay."""
    if job.operation.kind not in ("auto", "replay"):
        what = f"G-code is replayed, it cannot be used to {job.operation.kind}"
        raise JobError("job", what, "operation.kind", 'set operation.kind to "replay" or leave it out')
    no_idle(job, "a replay")


def tour_of(part: Recorded) -> Tour:
    """The program's motions at feed as paths, from one rapid motion to the next, in its order."""
    columns = Columns(_moving(part.run.body))
    ends, vias, speed = columns.ends, columns.vias, columns.speed
    steps = np.linalg.norm(np.diff(ends, axis=0), axis=1)
    lines = dict(zip(map(id, part.run.body), part.run.lines, strict=True))
    paths = [
        _path(number, lines[id(columns.moves[low + 1])], *(column[low:high] for column in (ends, vias, speed)))
        for number, (low, high) in enumerate(_stretches(columns), 1)
    ]
    return Tour(tuple(paths), math.fsum(steps[columns.moves_are(MoveJ)[1:]].tolist()), "as-drawn")


def _stretches(columns: Columns) -> list[tuple[int, int]]:
    """The motions at feed between two rapid ones, from the rapid one before to the one after, which is not of them."""
    cuts = [*np.flatnonzero(columns.moves_are(MoveJ)).tolist(), len(columns.moves)]
    return [(low, high) for low, high in pairwise(cuts) if high - low > 1]


def _owners(columns: Columns) -> list[int]:
    """(M,) the path that each motion belongs to: rapid motions to the next one, -1 behind the last."""
    ends = np.array([high for _, high in _stretches(columns)], dtype=np.int64)
    owner = np.searchsorted(ends, np.arange(len(columns.moves)), side="right")
    return np.where(owner < len(ends), owner, -1).tolist()  # type: ignore[no-any-return]  # numpy: any nesting


def _path(number: int, line: int, ends: FloatArray, vias: FloatArray, speed: FloatArray) -> ToolPath:
    count = len(ends)
    via, feed = vias.copy(), speed.copy()
    via[0], feed[0] = np.nan, speed[1]
    return ToolPath(
        id=f"n{number}",
        layer=f"line {line}",
        position=frozen(ends),
        via=frozen(via),
        axis=frozen(np.broadcast_to([0.0, 0.0, -1.0], (count, 3))),
        press=frozen(np.zeros((count, 2, 3))),
        force=frozen(np.zeros(count)),
        feed=frozen(feed),
        closed=bool(count > 2 and np.linalg.norm(ends[0] - ends[-1]) < _SAME),
        reversible=False,
        operation="replay",
    )


def replayed(part: Recorded, cell: Cell, job: Job, name: str, header: tuple[str, ...]) -> Program:
    """The program of the machine in ``cell``, whose frames and home hold (``lower.placed``).

    It comes to the first position from above, at the height of travel, and leaves the last one upwards.
    """
    cartesian, travel = isinstance(cell.home, Pose), job.process.travel
    body = _moving(part.run.body)
    first = next(k for k, item in enumerate(body) if isinstance(item, MoveJ))
    columns = Columns(body)
    path, *owners = _owners(columns)
    out: list[Instruction] = [MoveJ(cell.home, travel), *body[:first]]
    arrival = _arrive(body[first], cartesian, job, part.run.entry)  # type: ignore[arg-type]  # a MoveJ, found above
    out += [replace(item, path=path) for item in arrival]
    manner = zip(_blends(columns, job.tolerance.chord).tolist()[1:], owners, strict=True)
    last: MoveJ | MoveL | MoveC = body[first]  # type: ignore[assignment]
    for item in body[first + 1 :]:
        if isinstance(item, MoveJ):
            _, path = next(manner)
            out.append(replace(_rapid(item.target, cartesian, travel), path=path))  # type: ignore[arg-type]  # poses
            last = item
        elif isinstance(item, MoveL):
            blend, path = next(manner)
            out.append(MoveL(item.target, item.speed, blend, path=path, work=True))
            last = item
        elif isinstance(item, MoveC):
            blend, path = next(manner)
            out.append(MoveC(item.via, item.target, item.speed, blend, path=path, work=True))
            last = item
        else:
            out.append(item)
    out += _leave(last.target, cartesian, job)  # type: ignore[arg-type]
    out.append(MoveJ(cell.home, travel))
    return Program(name, cell.base_from_work, cell.flange_from_tool, tuple(out), header, origins(tour_of(part).paths))


def _rapid(target: Pose, cartesian: bool, speed: float) -> MoveJ | MoveL:
    return MoveJ(target, speed) if cartesian else MoveL(target, speed)


def _arrive(first: MoveJ, cartesian: bool, job: Job, entry: float) -> list[MoveJ | MoveL]:
    """From home to where the program begins. entry: the feed of the last way down, where the start was assumed."""
    x, y, z = first.target.origin  # type: ignore[union-attr]  # recorded in poses
    speed, high = job.process.travel, job.process.clearance
    arrival: list[MoveJ | MoveL] = [MoveJ(Pose(TOOL_DOWN, (x, y, max(z, high))), speed)]
    if z < high - _SAME:
        down = Pose(TOOL_DOWN, (x, y, z))
        arrival.append(MoveL(down, min(entry, speed)) if entry else _rapid(down, cartesian, speed))
    return arrival


def _leave(last: Pose, cartesian: bool, job: Job) -> list[Instruction]:
    x, y, z = last.origin
    high = job.process.clearance
    return [_rapid(Pose(TOOL_DOWN, (x, y, high)), cartesian, job.process.travel)] if z < high - _SAME else []


def _moving(body: Sequence[Instruction]) -> list[Instruction]:
    """The body without motions to where the tool already is; the first one stays."""
    columns = Columns(body)
    ends = columns.ends
    still = np.zeros(len(ends), np.bool_)
    still[1:] = np.abs(np.diff(ends, axis=0)).max(axis=1, initial=0.0) < _SAME
    still &= ~columns.moves_are(MoveC)
    if not still.any():
        return list(body)
    keep = np.ones(len(body), np.bool_)
    keep[columns.at[still]] = False
    return taken(body, keep)


def _blends(columns: Columns, chord: float) -> FloatArray:
    """Blend radius (M,) at the end of each motion: as ``lower_rows.blends``, where both motions are at feed, nothing is
    switched between them and the program allows it (a recorded blend above 0).
    """
    ends, vias = columns.ends, columns.vias
    blend = np.zeros(len(ends))
    if len(ends) < 3:
        return blend
    length = np.append(0.0, segment_lengths(ends, vias))
    start, end = _tangents(ends, vias)
    cosine = np.einsum("ij,ij->i", end[1:-1], start[2:])
    sine_half = np.sqrt(np.clip((1 - cosine) / 2, 0.0, 1.0))
    reach = 2 * chord / np.maximum(sine_half, 1e-9)
    half = np.minimum(length[1:-1], length[2:]) / 2 + 1e-9
    room = np.minimum(reach, np.maximum(half, ZONES[-1]))
    working = ~columns.moves_are(MoveJ)
    allowed = working[1:-1] & working[2:] & (columns.blend[1:-1] > 0) & (np.diff(columns.at)[1:] == 1)
    blend[1:-1] = np.where(allowed, np.select([room >= zone for zone in ZONES], ZONES, 0.0), 0.0)
    return blend


def _tangents(ends: FloatArray, vias: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Directions where each motion starts and ends, (M, 3). Of an arc they mirror its chord at its half-chords."""
    begins = np.vstack([ends[:1], ends[:-1]])
    chord = _unit(ends - begins)
    arc = ~np.isnan(vias[:, 0])
    start, end = chord.copy(), chord.copy()
    for out, half in ((start, vias - begins), (end, ends - vias)):
        along = _unit(half[arc])
        out[arc] = 2 * np.einsum("ij,ij->i", along, chord[arc])[:, None] * along - chord[arc]
    return start, end


def _unit(vectors: FloatArray) -> FloatArray:
    size = np.linalg.norm(vectors, axis=1)
    return np.asarray(vectors / np.where(size > 0, size, 1.0)[:, None])
