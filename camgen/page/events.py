"""The motions and waits of a program by column, each from where the one before it ended."""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.body import column
from camgen.ir import Joints, MoveC, MoveJ, MoveL, Program, Wait
from camgen.pose import FloatArray, Pose
from camgen.robots.forward import flange
from camgen.robots.models import Robot

IntArray = NDArray[np.int64]


class Events(Struct, frozen=True, eq=False):
    """E motions and waits. instruction: (E,) index in the body. kind: (E,) 0 joint, 1 line, 2 arc, 3 wait.

    start, via, end: (E, 3) of the tool centre, work frame, mm; via is NaN but for arcs. first_axis, last_axis: (E, 3)
    tool z at both ends. feed: (E,) mm/s. force: (E,) N. path: (E,) index of the tool path that it works on, -1: travel.
    seconds: (E,).
    """

    instruction: IntArray
    kind: IntArray
    start: FloatArray
    via: FloatArray
    end: FloatArray
    first_axis: FloatArray
    last_axis: FloatArray
    feed: FloatArray
    force: FloatArray
    path: IntArray
    seconds: FloatArray


def events(program: Program, arm: Robot | None, path: IntArray, seconds: FloatArray) -> Events:
    """The events of ``program``. A target in joints is where ``arm`` puts the tool; without one the tool is taken to
    stand where it is next, or was last. path, seconds: (M,) of its motions.
    """
    columns = program.columns
    chosen = np.flatnonzero(columns.are(MoveJ, MoveL, MoveC, Wait))
    moves = np.searchsorted(chosen, columns.at)
    waits = np.flatnonzero(columns.are(Wait)[chosen])
    kind = np.full(len(chosen), 3)
    kind[moves] = np.select([columns.moves_are(MoveJ), columns.moves_are(MoveL)], [0, 1], 2)
    known, axis = _ends(program, arm)
    end, last_axis = (_spread(len(chosen), moves, values) for values in (known, axis))
    end, last_axis = _filled(end), _filled(last_axis)
    start, first_axis = (np.concatenate([values[:1], values[:-1]]) for values in (end, last_axis))
    via, feed, force = (_spread(len(chosen), moves, values) for values in (columns.vias, columns.speed, columns.force))
    # A wait belongs to the motion after it, as in ``cycle``.
    owner = np.append(path, -1)[np.searchsorted(moves, np.arange(len(chosen)))]
    taken = _spread(len(chosen), moves, seconds)
    taken[waits] = column(columns.of(Wait), "seconds")
    feed, force = np.nan_to_num(feed), np.nan_to_num(force)
    return Events(chosen, kind, start, via, end, first_axis, last_axis, feed, force, owner, taken)


def tool_of(program: Program, arm: Robot, joints: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Where ``arm`` puts the tool with N joint values (N, J): tool centre and tool z, each (N, 3), work frame, mm."""
    rotations, origins = flange(arm, joints)
    work, tool = program.base_from_work, program.flange_from_tool
    place = origins + rotations @ np.asarray(tool.origin)
    return (place - work.origin) @ work.rotation, rotations @ tool.rotation[:, 2] @ work.rotation


def _ends(program: Program, arm: Robot | None) -> tuple[FloatArray, FloatArray]:
    """Where the motions end and tool z there, each (M, 3), NaN where it is not known."""
    columns = program.columns
    end = columns.ends.copy()
    axis = np.full_like(end, np.nan)
    targets = [move.target for move in columns.moves]
    posed = columns.posed
    axis[posed] = [target.rotation[:, 2] for target in targets if isinstance(target, Pose)] or np.zeros((0, 3))
    joints = [target.values for target in targets if isinstance(target, Joints)]
    if arm is not None and joints:
        end[~posed], axis[~posed] = tool_of(program, arm, np.array(joints))
    return end, axis


def _spread(count: int, rows: IntArray, values: FloatArray) -> FloatArray:
    """``values`` at ``rows`` of a column of ``count``, NaN elsewhere."""
    column = np.full((count, *values.shape[1:]), np.nan)
    column[rows] = values
    return column


def _filled(values: FloatArray) -> FloatArray:
    """(E, 3) with unknown rows as the row before; those before the first known one as that one."""
    known = ~np.isnan(values[:, 0])
    if not known.any():
        return np.zeros_like(values)
    row = np.maximum.accumulate(np.where(known, np.arange(len(values)), -1))
    return np.asarray(values[np.where(row < 0, np.argmax(known), row)], dtype=np.float64)
