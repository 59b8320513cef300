"""The cell that a program is for, and what its machine is taken to do."""

from __future__ import annotations

import math
from typing import Literal

from msgspec import Struct

from camgen.model.pose import Pose
from camgen.model.program import Joints


class Dynamics(Struct, frozen=True):
    """What a machine is taken to do: for the time of a program, and for the corners that it rounds by itself.

    acceleration: mm/s2 of the TCP. turning: rad/s of the tool. ramp: s in which a joint, or the tool where it turns at
    rest, comes to full speed. corner: how one is passed: "zone": rounded within the blend radius; "overlap": the next
    motion begins while the one before ends; "arc": rounded within ``deviation`` mm, whatever the blend; "junction": as
    fast as that, without leaving the lines. across, along: the shares of the acceleration that an arc may use; last:
    the share of a motion that no other follows, and of a level arc and a line up or down beside it;
    below 1 such a motion is entered as if half of it were to stop in. rapid_stops: whether the
    machine stands between a joint motion and a line or an arc. shares: joint motions run at their
    share of the joints' speeds
    where it is known, not at a speed of the TCP. fastest: mm/s of the TCP, most: share of the joints' speeds, that a
    program may ask for.
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
    fastest: float = 5000.0
    most: float = 1.0


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
