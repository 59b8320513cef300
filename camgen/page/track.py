"""A program as a way through time: where the tool is, how it stands, and when.

Every motion takes the time that ``cycle`` gives it, so that the last station has the time of the report. Within a
motion the speed is even.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.cycle.times import timed
from camgen.cycle.work import worked
from camgen.job import Result, pace_of
from camgen.page.curves import drawn
from camgen.page.events import Events, IntArray, events, tool_of
from camgen.pose import FloatArray
from camgen.robots.models import Robot


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


def track(result: Result, sag: float) -> tuple[Track, Arm | None]:
    """The way of the program, arcs in pieces within ``sag`` mm, and that of the robot where its joints are known."""
    program, reach, robot = result.program, result.reach, result.arm
    seconds, ends = timed(program, pace_of(result.post, result.job), reach, robot)
    found = events(program, robot, worked(result.tour, ends), seconds)
    stations = _stations(found, sag)
    seconds, arm = found.seconds, None
    if reach is not None and robot is not None and len(reach.joints):
        owner = np.searchsorted(found.instruction, reach.owner)
        share = (np.arange(len(owner)) - np.searchsorted(owner, owner) + 1) / np.bincount(owner)[owner]
        swing = found.kind[owner] == 0
        points, axis = tool_of(program, robot, reach.joints[swing])
        stations = _replaced(stations, _Stations(owner[swing], share[swing], points, axis))
        arm = Arm(robot, reach.joints, _begins(seconds)[owner] + seconds[owner] * share)
    time = _begins(seconds)[stations.event] + seconds[stations.event] * stations.fraction
    return Track(stations.points, stations.axis, time, stations.event, found), arm


def _begins(seconds: FloatArray) -> FloatArray:
    return np.asarray(np.cumsum(seconds) - seconds)


def _stations(found: Events, sag: float) -> _Stations:
    """The ends of all pieces; tool z turns evenly enough between the ends of a motion."""
    pieces = drawn(found.start, found.via, found.end, sag)
    share = pieces.fraction[:, None]
    axis = found.first_axis[pieces.owner] * (1 - share) + found.last_axis[pieces.owner] * share
    size = np.linalg.norm(axis, axis=1, keepdims=True)
    axis = np.where(size > 1e-6, axis / np.maximum(size, 1e-6), found.last_axis[pieces.owner])
    return _Stations(pieces.owner, pieces.fraction, pieces.points, axis)


def _replaced(stations: _Stations, others: _Stations) -> _Stations:
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
