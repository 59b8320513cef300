"""Wrist centres as axis 1 of an arm faces them, and the reach of two bodies about two axes."""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct

from camgen.model.part import BoolArray
from camgen.model.pose import FloatArray, Pose

#: mm: an arm that is beyond its reach by less counts as stretched.
REACH = 1e-9
#: Sine of axis 5 below which axis 4 or 6 is free.
STRAIGHT_SINE = 1e-9
#: mm from axis 1 to the wrist centre below which axis 1 is free.
_ON_AXIS = 1e-9


class Wrists(Struct, frozen=True, eq=False):
    """N wrist centres in the frame of the arm, for facing the wrist and for the back to it.

    theta1: (N, 2) angle of axis 1, rad.
    ahead: (N, 2) x of the centre after axis 1 is turned by that, mm.
    height: (N, 1) z of the centre, mm.
    too_near: (N,) mm by which the centre is too near to axis 1 for the side offset of the arm.
    on_axis: (N,) whether the centre is on axis 1, so that theta 1 is free.
    """

    theta1: FloatArray
    ahead: FloatArray
    height: FloatArray
    too_near: FloatArray
    on_axis: BoolArray


def find_wrists(base_from_arm: Pose, b: float, centres: FloatArray) -> Wrists:
    """The wrists with these centres (N, 3), mm, in the base frame.

    base_from_arm: frame with z along axis 1 and y along axis 2.
    b: y of the wrist centre, mm.
    """
    x, y, z = ((centres - base_from_arm.origin) @ base_from_arm.rotation).T
    distance = np.hypot(x, y)
    ahead = np.sqrt(np.maximum(distance**2 - b**2, 0.0))
    towards, lead = np.arctan2(y, x), np.arctan2(b, ahead)
    return Wrists(
        theta1=np.stack([towards - lead, towards + lead - math.pi], axis=1),
        ahead=np.stack([ahead, -ahead], axis=1),
        height=z[:, None],
        too_near=np.maximum(abs(b) - distance, 0.0),
        on_axis=distance < _ON_AXIS,
    )


def measure_beyond(distance: FloatArray, upper: float, fore: float) -> FloatArray:
    """Distance by which a point is too far or too near for two bodies in a chain, mm; else below 0.

    distance: distance of the point from the first axis, mm.
    upper, fore: lengths of the bodies, mm.
    """
    return np.asarray(np.maximum(distance - (upper + fore), abs(upper - fore) - distance))


def bend_elbow(x: FloatArray, z: FloatArray, upper: float, fore: float) -> FloatArray:
    """Angle by which the second of two bodies turns from the first one to reach a point, rad.

    It is 0 for stretched bodies, pi at most, and NaN out of reach.

    x, z: the point from the first axis, mm.
    upper, fore: lengths of the bodies, mm.
    """
    cosine = (x**2 + z**2 - upper**2 - fore**2) / (2 * upper * fore)
    bend = np.arccos(np.clip(cosine, -1.0, 1.0))
    return np.where(measure_beyond(np.hypot(x, z), upper, fore) > REACH, np.nan, bend)
