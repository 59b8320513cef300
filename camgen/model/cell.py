"""The cell that a program is for, and what its machine is taken to do."""

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
    turning: speed at which the tool turns, rad/s.
    ramp: time in which a joint, or a tool that turns at rest, comes to full speed, s.
    corner: how a corner is passed. "zone": rounded within the blend radius. "overlap": the next
        motion begins while the one before ends. "arc": rounded within `deviation`, whatever the
        blend. "junction": as fast as "arc", without leaving the lines.
    deviation: distance by which a corner may be left, mm.
    across, along: shares of the acceleration that an arc may use.
    last: share of the acceleration of a motion that no other follows, and of a level arc and a line
        up or down beside it. Below 1 such a motion is entered as if half of it were to stop in.
    rapid_stops: whether the machine stands between a joint motion and a line or an arc.
    shares: whether joint motions run at their share of the joints' speeds where it is known, not at
        a speed of the TCP.
    turns: whether a joint motion keeps to a speed at which the tool turns.
    fastest: highest speed of the TCP, mm/s.
    most: largest share of the joints' speeds that a program may ask for.
    axes: limits of each axis of a machine; None: `acceleration` in every direction.
    chord: distance by which the chords of an arc leave it, mm, for "junction".
    pause: time for which the machine stands where it comes to rest, s.
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
    most: float = 1.0
    axes: Axes | None = None
    chord: float = 0.002
    pause: float = 0.0


class Cell(Struct, frozen=True):
    """The built-in cell in which a job without ``[cell]`` is posted: frames and home position.

    name: for messages. sliding: the joints, counted from 0, whose values are mm. robot: which of camgen's robots it is,
    empty for a machine that is none. pace: what its machine is taken to do.
    """

    name: str
    base_from_work: Pose
    flange_from_tool: Pose
    home: Joints | Pose
    sliding: frozenset[int] = frozenset()
    robot: str = ""
    pace: Dynamics = Dynamics()
