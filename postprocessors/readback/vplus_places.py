"""V+ locations: what is given in what. For the read-back ``vplus``.

Sources: V+ Language Reference and User's Guide as docs/posts/vplus.md quotes them.
"""

from __future__ import annotations

import math
from functools import lru_cache

from msgspec import Struct

from camgen.pose import IDENTITY, FloatArray, Pose, frozen, translation

NULL = translation(0, 0, 0)


class Unreadable(Exception):
    """A statement that cannot be evaluated; the message says why."""


class Frame(Struct, frozen=True, eq=False, gc=False):
    """What a location is given in, the first component of a compound. external: the name of that component where only
    the controller knows it; then ``pose`` means nothing.
    """

    pose: Pose = NULL
    external: str = ""
    compound: bool = False


#: The frame of what is no compound.
BASE = Frame()


class Location(Struct, frozen=True, eq=False, gc=False):
    """``local`` in ``frame``."""

    local: Pose
    frame: Frame = BASE

    def in_base(self) -> Pose:
        """The location in the base frame."""
        if self.frame.external:
            raise Unreadable(f"location {self.frame.external} is only on the controller")
        return self.frame.pose @ self.local if self.frame.compound else self.local

    def moved(self, by: Pose) -> Location:
        """The location compounded with ``by`` on its right."""
        return Location(self.local @ by, self.frame)


@lru_cache(maxsize=4096)
def rotation_zyz(yaw: float, pitch: float, roll: float) -> FloatArray:
    """R = Rz(yaw) Ry(pitch) Rz(roll), angles in degrees. Most targets of a program share theirs, hence the cache."""
    if not (yaw or pitch or roll):
        return IDENTITY
    a, b, c = math.radians(yaw), math.radians(pitch), math.radians(roll)
    ca, sa, cb, sb, cc, sc = math.cos(a), math.sin(a), math.cos(b), math.sin(b), math.cos(c), math.sin(c)
    return frozen(
        [
            [ca * cb * cc - sa * sc, -ca * cb * sc - sa * cc, ca * sb],
            [sa * cb * cc + ca * sc, -sa * cb * sc + ca * cc, sa * sb],
            [-sb * cc, sb * sc, cb],
        ]
    )
