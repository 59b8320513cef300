"""A program as a way through time: where the tool is, how it stands, and when.

Every motion takes the time that ``cycle`` gives it, so that the last station has the time of the report. Within a
motion the speed is even.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.check.time import assign_paths, time_motions
from camgen.geometry.ragged import ramp
from camgen.model.pose import FloatArray, Pose
from camgen.model.program import (
    Columns,
    Joints,
    MoveC,
    MoveJ,
    MoveL,
    Output,
    Program,
    ToolChange,
    Wait,
    read_column,
)
from camgen.preview import Built
from camgen.preview.curves import draw_spans
from camgen.robots.kinematics.forward import flange
from camgen.robots.models import Robot

# The motions and waits of a program by column, each from where the one before it ended.

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


def events(
    columns: Columns, known: FloatArray, axis: FloatArray, path: IntArray, seconds: FloatArray
) -> Events:
    """The events of a program. known, axis: (M, 3) where its motions end and tool z there; where they are NaN the tool
    is taken to stand where it is next, or was last. path, seconds: (M,) of its motions.
    """
    chosen = np.flatnonzero(columns.are(MoveJ, MoveL, MoveC, Wait))
    moves = np.searchsorted(chosen, columns.at)
    waits = np.flatnonzero(columns.are(Wait)[chosen])
    kind = np.full(len(chosen), 3)
    kind[moves] = np.select([columns.moves_are(MoveJ), columns.moves_are(MoveL)], [0, 1], 2)
    end, last_axis = (_spread(len(chosen), moves, values) for values in (known, axis))
    end, last_axis = _fill(end), _fill(last_axis)
    start, first_axis = (np.concatenate([values[:1], values[:-1]]) for values in (end, last_axis))
    via, feed, force = (
        _spread(len(chosen), moves, values)
        for values in (columns.vias, columns.speed, columns.force)
    )
    # A wait belongs to the motion after it, as in ``cycle``.
    owner = np.append(path, -1)[np.searchsorted(moves, np.arange(len(chosen)))]
    taken = _spread(len(chosen), moves, seconds)
    taken[waits] = read_column(columns.of(Wait), "seconds")
    feed, force = np.nan_to_num(feed), np.nan_to_num(force)
    return Events(chosen, kind, start, via, end, first_axis, last_axis, feed, force, owner, taken)


def tool_of(
    program: Program, arm: Robot, joints: FloatArray, at: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Where ``arm`` puts the tool with N joint values (N, J): tool centre and tool z, each (N, 3), work frame, mm.

    at: (N,) instructions that they belong to: each has the tool that was changed to before it.
    """
    rotations, origins = flange(arm, joints)
    work = program.base_from_work
    changes, frames = tool_frames(program)
    turn = np.searchsorted(changes, at, side="right") - 1
    tips, ways = (
        np.array([tool.origin for tool in frames]),
        np.array([tool.rotation[:, 2] for tool in frames]),
    )
    place = origins + np.einsum("nij,nj->ni", rotations, tips[turn])
    return (place - work.origin) @ work.rotation, np.einsum(
        "nij,nj->ni", rotations, ways[turn]
    ) @ work.rotation


def tool_frames(program: Program) -> tuple[IntArray, list[Pose]]:
    """From which instruction on the tool has which frame at the flange, beginning with that of the program."""
    changes = np.flatnonzero(program.columns.are(ToolChange))
    made = [program.body[k] for k in changes.tolist()]
    own = [
        item.flange_from_tool or program.flange_from_tool
        for item in made
        if isinstance(item, ToolChange)
    ]
    return np.append(0, changes), [program.flange_from_tool, *own]


def find_ends(
    columns: Columns, program: Program | None = None, arm: Robot | None = None
) -> tuple[FloatArray, FloatArray]:
    """Where the motions end and tool z there, each (M, 3), NaN where it is not known: a target in joints is where
    ``arm`` puts the tool of ``program``.
    """
    end = columns.ends.copy()
    axis = np.full_like(end, np.nan)
    targets = [move.target for move in columns.moves]
    posed = columns.posed
    axis[posed] = [
        target.rotation[:, 2] for target in targets if isinstance(target, Pose)
    ] or np.zeros((0, 3))
    joints = [target.values for target in targets if isinstance(target, Joints)]
    if arm is not None and program is not None and joints:
        end[~posed], axis[~posed] = tool_of(program, arm, np.array(joints), columns.at[~posed])
    return end, axis


def _spread(count: int, rows: IntArray, values: FloatArray) -> FloatArray:
    """``values`` at ``rows`` of a column of ``count``, NaN elsewhere."""
    column = np.full((count, *values.shape[1:]), np.nan)
    column[rows] = values
    return column


def _fill(values: FloatArray) -> FloatArray:
    """(E, 3) with unknown rows as the row before; those before the first known one as that one."""
    known = ~np.isnan(values[:, 0])
    if not known.any():
        return np.zeros_like(values)
    row = np.maximum.accumulate(np.where(known, np.arange(len(values)), -1))
    return np.asarray(values[np.where(row < 0, np.argmax(known), row)], dtype=np.float64)


class Track(Struct, frozen=True, eq=False):
    """S stations on the way. position, axis: (S, 3), tool centre and tool z, work frame, mm. time: (S,) s. event:
    (S,) the row of ``events`` that leads here.
    """

    position: FloatArray
    axis: FloatArray
    time: FloatArray
    event: IntArray
    events: Events


class Arm(Struct, frozen=True, eq=False):
    """The robot on the way: joints (R, J), rad or mm, at times (R,), s."""

    robot: Robot
    joints: FloatArray
    time: FloatArray


class _Stations(Struct, frozen=True, eq=False):
    """Points (S, 3) and tool z (S, 3) at a fraction (S,) of an event (S,)."""

    event: IntArray
    fraction: FloatArray
    points: FloatArray
    axis: FloatArray


def track(result: Built, sag: float) -> tuple[Track, Arm | None]:
    """The way of the program, arcs in pieces within ``sag`` mm, and that of the robot where its joints are known."""
    program, reach, robot = result.program, result.reach, result.cell.arm
    seconds, _ = time_motions(program, result.cell.pace, reach, robot)
    found = events(
        program.columns, *find_ends(program.columns, program, robot), assign_paths(program), seconds
    )
    stations = _stations(found, sag)
    seconds, arm = found.seconds, None
    if reach is not None and robot is not None and len(reach.joints):
        owner = np.searchsorted(found.instruction, reach.owner)
        share = (ramp(np.bincount(owner)) + 1) / np.bincount(owner)[owner]
        swing = found.kind[owner] == 0
        points, axis = tool_of(program, robot, reach.joints[swing], reach.owner[swing])
        stations = _replace(stations, _Stations(owner[swing], share[swing], points, axis))
        arm = Arm(robot, reach.joints, _begins(seconds)[owner] + seconds[owner] * share)
    time = _begins(seconds)[stations.event] + seconds[stations.event] * stations.fraction
    return Track(stations.points, stations.axis, time, stations.event, found), arm


class Switch(Struct, frozen=True):
    """An output from a time on, s."""

    time: float
    signal: str
    value: float


def switches_of(columns: Columns, found: Events) -> tuple[Switch, ...]:
    """When a program switches its outputs."""
    places = np.flatnonzero(columns.are(Output))
    begin = np.append(0.0, np.cumsum(found.seconds))[np.searchsorted(found.instruction, places)]
    return tuple(
        Switch(time, item.signal, item.value)
        for time, item in zip(begin.tolist(), columns.of(Output), strict=True)
    )


def _begins(seconds: FloatArray) -> FloatArray:
    return np.asarray(np.cumsum(seconds) - seconds)


def way_of(found: Events, sag: float) -> Track:
    """The way of a tool that no arm is known for."""
    stations = _stations(found, sag)
    time = (
        _begins(found.seconds)[stations.event] + found.seconds[stations.event] * stations.fraction
    )
    return Track(stations.points, stations.axis, time, stations.event, found)


def _stations(found: Events, sag: float) -> _Stations:
    """The ends of all pieces; tool z turns evenly enough between the ends of a motion."""
    pieces = draw_spans(found.start, found.via, found.end, sag)
    share = pieces.fraction[:, None]
    axis = found.first_axis[pieces.owner] * (1 - share) + found.last_axis[pieces.owner] * share
    size = np.linalg.norm(axis, axis=1, keepdims=True)
    axis = np.where(size > 1e-6, axis / np.maximum(size, 1e-6), found.last_axis[pieces.owner])
    return _Stations(pieces.owner, pieces.fraction, pieces.points, axis)


def _replace(stations: _Stations, others: _Stations) -> _Stations:
    """``stations`` with ``others`` in the place of those of the same events."""
    keep = ~np.isin(stations.event, others.event)
    event = np.concatenate([stations.event[keep], others.event])
    fraction = np.concatenate([stations.fraction[keep], others.fraction])
    order = np.lexsort([fraction, event])
    points, axis = (
        np.concatenate([old[keep], new])[order]
        for old, new in ((stations.points, others.points), (stations.axis, others.axis))
    )
    return _Stations(event[order], fraction[order], points, axis)
