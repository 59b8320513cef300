"""Plans old G-code programs: their motions at feed become tool paths."""

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
from camgen.model.path import ToolPath, make_waypoints
from camgen.model.pose import FloatArray
from camgen.model.program import Columns, Instruction, Joints, MoveC, MoveJ, MoveL, select_items
from camgen.model.text import counted, short
from camgen.model.tolerance import SAME_POINT_MM
from camgen.plan import ReplayPlan
from camgen.plan.close_positions import thin_positions
from camgen.plan.tool_parts import split_by_tool
from camgen.plan.unused import check_idle


def plan_replay(part: Part, job: Job, cell: Cell | None) -> ReplayPlan:
    """Plan the motions at feed between rapid motions as paths, in the order of the program.

    Raises JobError for a setting without effect, and InputError for a feed that no machine runs.
    """
    assert isinstance(part, Recorded)
    check_idle(job, "a replay")
    part = _limit_feeds(part, job.process.max_feed)
    on_arm = cell is not None and isinstance(cell.home, Joints)
    if on_arm:
        part = thin_positions(part, job.tolerance.chord)
    parts, notes = split_by_tool(part, job, on_arm)
    paths: list[ToolPath] = []
    travel = 0.0
    for tool_part in parts:
        columns = Columns(drop_still_motions(tool_part.body))
        ends, vias, speed = columns.ends, columns.vias, columns.speed
        lines = dict(zip(map(id, tool_part.body), tool_part.lines, strict=True))
        for low, high in _find_stretches(columns):
            line = lines[id(columns.moves[low + 1])]
            rows = slice(low, high)
            paths.append(_make_path(len(paths) + 1, line, ends[rows], vias[rows], speed[rows]))
        steps = np.linalg.norm(np.diff(ends, axis=0), axis=1)
        travel += math.fsum(steps[columns.moves_are(MoveJ)[1:]].tolist())
    planned, notes = tuple(paths), (*part.notes, *notes)
    return ReplayPlan(
        part, planned, notes, run=part.run, travel=travel, original_paths=planned, parts=parts
    )


def _limit_feeds(part: Recorded, max_feed: float | None) -> Recorded:
    """Limit the feeds of the program to `max_feed`, mm/s, with a note.

    Without it, raises InputError for a feed above that of any machine: a controller takes such a
    number and runs as fast as it can.
    """
    limit = max_feed or FASTEST
    body = list(part.run.body)
    fast = {
        k: item.speed
        for k, item in enumerate(body)
        if isinstance(item, MoveL | MoveC) and item.speed > limit
    }
    if not fast:
        return part
    first = min(fast)
    line = part.run.lines[first]
    if max_feed is None:
        raise InputError(
            part.source,
            f"asks for a feed of {short(fast[first], 0)} mm/s, "
            f"and no machine here runs above {FASTEST:g}",
            f"line {line}",
            "fix this line, or set process.max_feed, mm/s: feeds above it become that",
        )
    for k in fast:
        body[k] = replace(body[k], speed=max_feed)
    count = counted(len(fast), "motion runs", "motions run")
    note = Note(
        "assumed",
        f"{count} at {short(max_feed, 3)} mm/s instead of up to {short(max(fast.values()), 0)}",
        f"process.max_feed; the first is line {line}",
    )
    run = replace(part.run, body=tuple(body), entry=min(part.run.entry, max_feed))
    return replace(part, run=run, notes=(*part.notes, note))


def _find_stretches(columns: Columns) -> list[tuple[int, int]]:
    """The ranges from a rapid motion, over motions at feed, to before the next rapid one."""
    cuts = [*np.flatnonzero(columns.moves_are(MoveJ)).tolist(), len(columns.moves)]
    return [(low, high) for low, high in pairwise(cuts) if high - low > 1]


def find_owners(columns: Columns) -> list[int]:
    """(M,) index of the path of each motion. A rapid motion belongs to the next path, or to -1."""
    ends = np.array(_find_stretches(columns), dtype=np.int64).reshape(-1, 2)[:, 1]
    owner = np.searchsorted(ends, np.arange(len(columns.moves)), side="right")
    # numpy types lists of any nesting
    return np.where(owner < len(ends), owner, -1).tolist()  # type: ignore[no-any-return]


def _make_path(
    number: int, line: int, ends: FloatArray, vias: FloatArray, speed: FloatArray
) -> ToolPath:
    via, feed = vias.copy(), speed.copy()
    via[0], feed[0] = np.nan, speed[1]
    return ToolPath(
        id=f"n{number}",
        layer=f"line {line}",
        table=make_waypoints(position=ends, via=via, feed=feed),
        closed=bool(len(ends) > 2 and np.linalg.norm(ends[0] - ends[-1]) < SAME_POINT_MM),
        reversible=False,
        operation="replay",
    )


def drop_still_motions(body: Sequence[Instruction]) -> list[Instruction]:
    """The body without motions to the current position, except the first motion."""
    columns = Columns(body)
    ends = columns.ends
    is_still = np.zeros(len(ends), np.bool_)
    is_still[1:] = np.abs(np.diff(ends, axis=0)).max(axis=1, initial=0.0) < SAME_POINT_MM
    is_still &= ~columns.moves_are(MoveC)
    if not is_still.any():
        return list(body)
    keep = np.ones(len(body), np.bool_)
    keep[columns.at[is_still]] = False
    return select_items(body, keep)
