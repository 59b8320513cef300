"""Prints motions and state changes of V+ as lines of a program; `records` prints them as data."""

from __future__ import annotations

import math

from camgen.model.pose import Pose
from camgen.model.program import Joints
from camgen.model.text import short

from . import rules
from .rules import SPEED_DIGITS

IN = "    "
#: Degrees with 4 digits: three angles together stay within 3e-6 rad.
ANGLE_DIGITS = 4
#: Sliding joints get more digits than poses, so that one tolerance serves rad and mm.
SLIDE_DIGITS = 5


class Lines:
    """Lines of a program.

    work: location variable of the work frame.
    decimals: digits of mm.
    """

    def __init__(self, work: str, decimals: int) -> None:
        self._work, self._decimals = work, decimals
        self._angles: dict[bytes, str] = {}

    def percent(self, value: float) -> str:
        """The speed of joint motions."""
        return f"{IN}SPEED {short(value, SPEED_DIGITS)} ALWAYS"

    def straight(self, speed: float, turn: float) -> str:
        """The speed of straight motions, mm/s. turn: % of the rotational speed."""
        return f"{IN}SPEED {short(speed, SPEED_DIGITS)}, {short(turn, SPEED_DIGITS)} MMPS ALWAYS"

    def word(self, word: str) -> str:
        """A posture."""
        return IN + word

    def to_joints(self, joints: Joints, stops: bool) -> tuple[str, ...]:
        """``MOVE`` to a precision point: degrees, and mm for joint 3 of a SCARA."""
        slide = 2 if len(joints.values) == 4 else None
        texts = (
            short(v, SLIDE_DIGITS) if k == slide else short(math.degrees(v), ANGLE_DIGITS)
            for k, v in enumerate(joints.values)
        )
        return (f"{IN}MOVE #PPOINT({', '.join(texts)})", *_stop(stops))

    def to_pose(self, word: str, pose: Pose, stops: bool) -> tuple[str, ...]:
        """``MOVE`` or ``MOVES`` to a pose in the work frame."""
        return (f"{IN}{word} {self._work}:{self.trans(pose)}", *_stop(stops))

    def signal(self, number: int) -> str:
        """An output; negative: off. The motion before it has printed the BREAK that it needs."""
        return f"{IN}SIGNAL {number}"

    def wait(self, seconds: float) -> str:
        """WAIT.EVENT without an event: a dwell."""
        return f"{IN}WAIT.EVENT , {short(seconds, 3)}"

    def trans(self, pose: Pose) -> str:
        """``TRANS(x,y,z,yaw,pitch,roll)``."""
        key = pose.rotation.tobytes()
        angles = self._angles.get(key)
        if angles is None:
            values = (math.degrees(a) for a in rules.yaw_pitch_roll(pose.rotation))
            angles = self._angles[key] = ",".join(short(v, ANGLE_DIGITS) for v in values)
        x, y, z = pose.origin
        d = self._decimals
        return f"TRANS({short(x, d)},{short(y, d)},{short(z, d)},{angles})"


def _stop(stops: bool) -> tuple[str, ...]:
    return (f"{IN}BREAK",) if stops else ()
