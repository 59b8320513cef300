"""The built-in cell of a post, and the assumed dynamics of its machine."""

from __future__ import annotations

import math
from typing import Literal

from msgspec import Struct

from camgen.model.pose import Pose, Vec3
from camgen.model.program import Joints


class Axes(Struct, frozen=True):
    """Limits of the axes X, Y and Z of a machine.

    rates: maximum rates, mm/s.
    accelerations: mm/s2.
    steps: steps/mm; None: positions are not rounded to steps.
    """

    rates: Vec3
    accelerations: Vec3
    steps: Vec3 | None = None


class Dynamics(Struct, frozen=True):
    """Assumptions about a machine: for the time of a program, and for the corners that it rounds.

    acceleration: acceleration of the TCP, mm/s2.
    turning: speed of a reorientation, rad/s.
    ramp: time in which a joint, or a reorientation, reaches full speed, s.
    corner: method of passing a corner. "zone": rounded within the blend radius. "overlap": the next
        motion begins while the previous one ends. "arc": rounded within `deviation`, whatever the
        blend. "junction": as fast as "arc", without leaving the lines.
    deviation: maximum distance of a corner path from its corner, mm.
    across, along: fractions of the acceleration that an arc may use, across and along its path.
    last: fraction of the acceleration of a motion without a next one, and of a level arc and a line
        up or down next to it. Below 1 such a motion is entered as if it had to stop within half of
        its length.
    rapid_stops: whether the machine stops between a joint motion and a line or an arc.
    shares: whether joint motions run at their fraction of the maximum joint speeds if it is known,
        not at a TCP speed.
    turns: whether a joint motion keeps its limit of the speed at which the tool rotates.
    fastest: maximum TCP speed, mm/s.
    max_fraction: largest fraction of the maximum joint speeds that a program may set.
    axes: limits of each axis of a machine; None: `acceleration` in every direction.
    chord: distance by which the chords of an arc leave it, mm, for "junction".
    pause: time for which the machine stands after each stop, s.
    """

    acceleration: float = 5000.0
    turning: float = math.radians(500.0)
    ramp: float = 0.2
    corner: Literal["zone", "overlap", "arc", "junction"] = "zone"
    deviation: float = 0.0
    across: float = 1.0
    along: float = 1.0
    last: float = 1.0
    rapid_stops: bool = False
    shares: bool = False
    turns: bool = False
    fastest: float = 5000.0
    max_fraction: float = 1.0
    axes: Axes | None = None
    chord: float = 0.002
    pause: float = 0.0


class Cell(Struct, frozen=True):
    """The built-in cell in which a job without `[cell]` is posted: frames and home position.

    name: name of the cell, for messages.
    base_from_work: work frame in the base frame.
    flange_from_tool: tool frame in the flange frame.
    home: joint values, or the pose of the TCP.
    sliding: indices of the joints whose values are in mm, from 0.
    robot: name of one of the robots of camgen; "" for a machine that is not one of them.
    pace: assumed dynamics of the machine.
    """

    name: str
    base_from_work: Pose
    flange_from_tool: Pose
    home: Joints | Pose
    sliding: frozenset[int] = frozenset()
    robot: str = ""
    pace: Dynamics = Dynamics()
