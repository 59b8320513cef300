"""Old programs: the motions at feed of a program that was read, as tool paths."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from msgspec.structs import replace

from camgen.lang.recorded import Recorded
from camgen.model.cell import Cell
from camgen.model.errors import InputError
from camgen.model.job import FASTEST, Job
from camgen.model.part import Note, Part
from camgen.model.path import ToolPath, waypoints
from camgen.model.pose import FloatArray
from camgen.model.program import Columns, Instruction, Joints, MoveC, MoveJ, MoveL, select_items
from camgen.model.text import counted, short
from camgen.model.tolerance import SAME_POINT_MM
from camgen.plan import ReplayPlan
from camgen.plan.close_positions import thin_positions
from camgen.plan.tool_parts import split_by_tool
from camgen.plan.unused import check_idle


def plan_replay(part: Part, job: Job, cell: Cell | None) -> ReplayPlan:
    """The program's motions at feed as paths, from one rapid motion to the next, in its order. JobError for a setting
    that would have no effect, InputError for a feed that no machine runs.
    """
    assert isinstance(part, Recorded)
    check_idle(job, "a replay")
    part = _slow(part, job.process.max_feed)
    on_arm = cell is not None and isinstance(cell.home, Joints)
    if on_arm:
        part = thin_positions(part, job.tolerance.chord)
    parts, notes = split_by_tool(part, job, on_arm)
    paths: list[ToolPath] = []
    travel = 0.0
    for one in parts:
        columns = Columns(moving(one.body))
        ends, vias, speed = columns.ends, columns.vias, columns.speed
        lines = dict(zip(map(id, one.body), one.lines, strict=True))
        paths += [
            _path(
                number,
                lines[id(columns.moves[low + 1])],
                *(column[low:high] for column in (ends, vias, speed)),
            )
            for number, (low, high) in enumerate(_stretches(columns), len(paths) + 1)
        ]
        steps = np.linalg.norm(np.diff(ends, axis=0), axis=1)
        travel += math.fsum(steps[columns.moves_are(MoveJ)[1:]].tolist())
    made, every = tuple(paths), (*part.notes, *notes)
    return ReplayPlan(part, made, every, run=part.run, travel=travel, made=made, parts=parts)


def _slow(part: Recorded, most: float | None) -> Recorded:
    """The program with its feeds at ``most``, mm/s, where they are above it. None: as it is, and InputError for one
    that is faster than any machine here: controllers take such a word and run as fast as they can.
    """
    limit = most or FASTEST
    fast = [
        (k, item)
        for k, item in enumerate(part.run.body)
        if isinstance(item, MoveL | MoveC) and item.speed > limit
    ]
    if not fast:
        return part
    line = part.run.lines[fast[0][0]]
    if most is None:
        what = f"asks for a feed of {short(fast[0][1].speed, 0)} mm/s, and no machine here runs above {FASTEST:g}"
        remedy = "mend this line, or set process.max_feed, mm/s: feeds above it become that"
        raise InputError(part.source, what, f"line {line}", remedy)
    body = list(part.run.body)
    for k, item in fast:
        body[k] = replace(item, speed=most)
    many = counted(len(fast), "motion runs", "motions run")
    what = f"{many} at {short(most, 3)} mm/s instead of up to {short(max(item.speed for _, item in fast), 0)}"
    note = Note("assumed", what, f"process.max_feed; the first is line {line}")
    run = replace(part.run, body=tuple(body), entry=min(part.run.entry, most))
    return replace(part, run=run, notes=(*part.notes, note))


def _stretches(columns: Columns) -> list[tuple[int, int]]:
    """The motions at feed between two rapid ones, from the rapid one before to the one after, which is not of them."""
    cuts = [*np.flatnonzero(columns.moves_are(MoveJ)).tolist(), len(columns.moves)]
    return [(low, high) for low, high in pairwise(cuts) if high - low > 1]


def owners(columns: Columns) -> list[int]:
    """(M,) the path that each motion belongs to: rapid motions to the next one, -1 behind the last."""
    ends = np.array([high for _, high in _stretches(columns)], dtype=np.int64)
    owner = np.searchsorted(ends, np.arange(len(columns.moves)), side="right")
    return np.where(owner < len(ends), owner, -1).tolist()  # type: ignore[no-any-return]  # numpy: any nesting


def _path(
    number: int, line: int, ends: FloatArray, vias: FloatArray, speed: FloatArray
) -> ToolPath:
    via, feed = vias.copy(), speed.copy()
    via[0], feed[0] = np.nan, speed[1]
    return ToolPath(
        id=f"n{number}",
        layer=f"line {line}",
        table=waypoints(
            position=ends,
            via=via,
            feed=feed,
        ),
        closed=bool(len(ends) > 2 and np.linalg.norm(ends[0] - ends[-1]) < SAME_POINT_MM),
        reversible=False,
        operation="replay",
    )


def moving(body: Sequence[Instruction]) -> list[Instruction]:
    """The body without motions to where the tool already is; the first one stays."""
    columns = Columns(body)
    ends = columns.ends
    still = np.zeros(len(ends), np.bool_)
    still[1:] = np.abs(np.diff(ends, axis=0)).max(axis=1, initial=0.0) < SAME_POINT_MM
    still &= ~columns.moves_are(MoveC)
    if not still.any():
        return list(body)
    keep = np.ones(len(body), np.bool_)
    keep[columns.at[still]] = False
    return select_items(body, keep)
