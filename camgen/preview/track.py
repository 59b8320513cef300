"""The track of a program: positions and axes of the tool over time.

A motion takes the time that `cycle` computes for it, so the last station has the time of the
report. The speed within a motion is constant.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.check.time import assign_paths, time_motions
from camgen.geometry.ragged import number_rows
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
from camgen.robots.kinematics.forward import compute_flange
from camgen.robots.models import Robot

# The motions and waits of a program by column.

IntArray = NDArray[np.int64]


class Events(Struct, frozen=True, eq=False):
    """E motions and waits. Each starts at the end of the previous one.

    instruction: (E,) index in the body.
    kind: (E,) 0 joint motion, 1 line, 2 arc, 3 wait.
    start, end: (E, 3) TCP at both ends in the work frame, mm.
    via: (E, 3) via point, NaN except for arcs.
    first_axis, last_axis: (E, 3) tool z at both ends.
    feed: (E,) feed, mm/s.
    force: (E,) contact force, N.
    path: (E,) index of the tool path, -1 for travel.
    seconds: (E,) time, s.
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


def make_events(
    columns: Columns, ends: FloatArray, axis: FloatArray, path: IntArray, seconds: FloatArray
) -> Events:
    """The events of a program with M motions.

    ends, axis: (M, 3) TCP and tool z at the end of each motion. A NaN row gets the values of the
        previous known row, or of the first known one.
    path: (M,) path of each motion.
    seconds: (M,) time of each motion, s.
    """
    chosen = np.flatnonzero(columns.are(MoveJ, MoveL, MoveC, Wait))
    moves = np.searchsorted(chosen, columns.at)
    waits = np.flatnonzero(columns.are(Wait)[chosen])
    kind = np.full(len(chosen), 3)
    kind[moves] = np.select([columns.moves_are(MoveJ), columns.moves_are(MoveL)], [0, 1], 2)
    end = _fill_unknown(_spread(len(chosen), moves, ends))
    last_axis = _fill_unknown(_spread(len(chosen), moves, axis))
    start, first_axis = (np.concatenate([values[:1], values[:-1]]) for values in (end, last_axis))
    via = _spread(len(chosen), moves, columns.vias)
    feed = np.nan_to_num(_spread(len(chosen), moves, columns.speed))
    force = np.nan_to_num(_spread(len(chosen), moves, columns.force))
    # A wait belongs to the motion after it, as in `cycle`.
    owner = np.append(path, -1)[np.searchsorted(moves, np.arange(len(chosen)))]
    times = _spread(len(chosen), moves, seconds)
    times[waits] = read_column(columns.list_kinds(Wait), "seconds")
    return Events(chosen, kind, start, via, end, first_axis, last_axis, feed, force, owner, times)


def compute_tool(
    program: Program, arm: Robot, joints: FloatArray, instruction: IntArray
) -> tuple[FloatArray, FloatArray]:
    """TCP and tool z for N joint values (N, J), each (N, 3) in the work frame, mm.

    instruction: (N,) index of the instruction of each. Its tool is that of the last tool change.
    """
    rotations, origins = compute_flange(arm, joints)
    work = program.base_from_work
    changes, frames = list_tool_frames(program)
    tool = np.searchsorted(changes, instruction, side="right") - 1
    tips = np.array([frame.origin for frame in frames])[tool]
    axes = np.array([frame.rotation[:, 2] for frame in frames])[tool]
    positions = origins + np.einsum("nij,nj->ni", rotations, tips)
    directions = np.einsum("nij,nj->ni", rotations, axes)
    return (positions - work.origin) @ work.rotation, directions @ work.rotation


def list_tool_frames(program: Program) -> tuple[IntArray, list[Pose]]:
    """The frames of the tools at the flange, with the instruction from which each holds."""
    columns = program.columns
    frames = [program.flange_from_tool]
    for change in columns.list_kinds(ToolChange):
        frames.append(change.flange_from_tool or program.flange_from_tool)
    return np.append(0, np.flatnonzero(columns.are(ToolChange))), frames


def find_ends(
    columns: Columns, program: Program | None = None, arm: Robot | None = None
) -> tuple[FloatArray, FloatArray]:
    """TCP and tool z at the end of each motion, each (M, 3).

    The end of a joint motion follows from `arm` and the tool of `program`; NaN without an arm.
    """
    end = columns.ends.copy()
    axis = np.full_like(end, np.nan)
    targets = [move.target for move in columns.moves]
    posed = columns.posed
    axes = [target.rotation[:, 2] for target in targets if isinstance(target, Pose)]
    axis[posed] = axes or np.zeros((0, 3))
    joints = [target.values for target in targets if isinstance(target, Joints)]
    if arm is not None and program is not None and joints:
        end[~posed], axis[~posed] = compute_tool(program, arm, np.array(joints), columns.at[~posed])
    return end, axis


def _spread(count: int, rows: IntArray, values: FloatArray) -> FloatArray:
    """A column of `count` rows with `values` at `rows`, NaN elsewhere."""
    column = np.full((count, *values.shape[1:]), np.nan)
    column[rows] = values
    return column


def _fill_unknown(values: FloatArray) -> FloatArray:
    """Replace each NaN row by the previous known one, or by the first known one; (E, 3)."""
    known = ~np.isnan(values[:, 0])
    if not known.any():
        return np.zeros_like(values)
    row = np.maximum.accumulate(np.where(known, np.arange(len(values)), -1))
    return np.asarray(values[np.where(row < 0, np.argmax(known), row)], dtype=np.float64)


class Track(Struct, frozen=True, eq=False):
    """S stations of the tool.

    position: (S, 3) TCP in the work frame, mm.
    axis: (S, 3) tool z.
    time: (S,) time, s.
    event: (S,) row of `events` of the motion that ends or passes here.
    events: the motions and waits.
    """

    position: FloatArray
    axis: FloatArray
    time: FloatArray
    event: IntArray
    events: Events


class Arm(Struct, frozen=True, eq=False):
    """The robot over time.

    robot: the robot.
    joints: (R, J) joint values, rad or mm.
    time: (R,) their times, s.
    """

    robot: Robot
    joints: FloatArray
    time: FloatArray


class _Stations(Struct, frozen=True, eq=False):
    """TCP and tool z (S, 3) after a fraction (S,) of an event (S,)."""

    event: IntArray
    fraction: FloatArray
    points: FloatArray
    axis: FloatArray


def make_track(result: Built, sag: float) -> tuple[Track, Arm | None]:
    """The track of the tool, and that of the robot, None if its joint values are not known.

    sag: maximum distance of a piece of an arc from the arc, mm.
    """
    program, reach, robot = result.program, result.reach, result.cell.arm
    seconds = time_motions(program, result.cell.pace, reach, robot)
    ends, axes = find_ends(program.columns, program, robot)
    events = make_events(program.columns, ends, axes, assign_paths(program), seconds)
    stations = _sample_stations(events, sag)
    if reach is None or robot is None or not len(reach.joints):
        return _time_stations(events, stations), None
    owner = np.searchsorted(events.instruction, reach.owner)
    fraction = (number_rows(np.bincount(owner)) + 1) / np.bincount(owner)[owner]
    in_joints = events.kind[owner] == 0
    points, axis = compute_tool(program, robot, reach.joints[in_joints], reach.owner[in_joints])
    sampled = _Stations(owner[in_joints], fraction[in_joints], points, axis)
    arm = Arm(robot, reach.joints, _compute_times(events.seconds, owner, fraction))
    return _time_stations(events, _replace_stations(stations, sampled)), arm


class Switch(Struct, frozen=True):
    """An output that a program sets.

    time: time from which it has the value, s.
    signal: its name.
    value: its value.
    """

    time: float
    signal: str
    value: float


def list_switches(columns: Columns, events: Events) -> tuple[Switch, ...]:
    """The outputs that a program sets, with their times."""
    rows = np.searchsorted(events.instruction, np.flatnonzero(columns.are(Output)))
    times = np.append(0.0, np.cumsum(events.seconds))[rows]
    return tuple(
        Switch(time, output.signal, output.value)
        for time, output in zip(times.tolist(), columns.list_kinds(Output), strict=True)
    )


def _compute_times(seconds: FloatArray, event: IntArray, fraction: FloatArray) -> FloatArray:
    """Time after a fraction of an event, s."""
    return np.asarray((np.cumsum(seconds) - seconds)[event] + seconds[event] * fraction)


def _time_stations(events: Events, stations: _Stations) -> Track:
    time = _compute_times(events.seconds, stations.event, stations.fraction)
    return Track(stations.points, stations.axis, time, stations.event, events)


def make_tool_track(events: Events, sag: float) -> Track:
    """The track of a tool without an arm; arcs in pieces within `sag` mm."""
    return _time_stations(events, _sample_stations(events, sag))


def _sample_stations(events: Events, sag: float) -> _Stations:
    """Sample the events. Tool z is interpolated linearly and normalized, which is close enough."""
    pieces = draw_spans(events.start, events.via, events.end, sag)
    share = pieces.fraction[:, None]
    last_axis = events.last_axis[pieces.owner]
    axis = events.first_axis[pieces.owner] * (1 - share) + last_axis * share
    size = np.linalg.norm(axis, axis=1, keepdims=True)
    axis = np.where(size > 1e-6, axis / np.maximum(size, 1e-6), last_axis)
    return _Stations(pieces.owner, pieces.fraction, pieces.points, axis)


def _replace_stations(stations: _Stations, others: _Stations) -> _Stations:
    """Replace the stations of the events that `others` has by those of `others`."""
    keep = ~np.isin(stations.event, others.event)
    event = np.concatenate([stations.event[keep], others.event])
    fraction = np.concatenate([stations.fraction[keep], others.fraction])
    order = np.lexsort([fraction, event])
    points = np.concatenate([stations.points[keep], others.points])[order]
    axis = np.concatenate([stations.axis[keep], others.axis])[order]
    return _Stations(event[order], fraction[order], points, axis)
