"""Checks for an arm of four axes: no tilt of the tool, no postures of an elbow or a wrist.

Joints 1, 2 and 4 of a SCARA rotate about z of the base, and joint 3 moves along it
(docs/posts/vplus.md).
"""

from __future__ import annotations

import math

from camgen.model.pose import FloatArray, Pose
from camgen.model.program import Joints, MoveJ, MoveL

from .robot import RobotState

#: Maximum tilt of a flange, deg. It has three printed orientations, each within 1e-4 deg.
_UPRIGHT = 1e-3


def check_scara(robot: RobotState) -> None:
    """Refuses postures and tilts that only arms of more axes have.

    Tilts are tested in frames that the text defines.
    """
    for line, word in robot.bent.items():
        robot.fault(line, f"{word}: an arm of four axes has no such posture")
    if robot.tool is None:
        return
    flange = robot.tool.rotation[2]
    #: Tilts by the ids of the two rotation matrices, which most motions share.
    tilts: dict[tuple[int, int], float] = {}
    for item, line, frame in zip(robot.body, robot.lines, robot.frames, strict=True):
        if frame is None or frame.external:
            continue
        if not isinstance(item, MoveJ | MoveL) or isinstance(item.target, Joints):
            continue
        key = id(item.target.rotation), id(frame.pose)
        if key not in tilts:
            tilts[key] = _tilt(item.target, frame.pose, flange)
        if tilts[key] > _UPRIGHT:
            what = f"the flange {tilts[key]:.4g} deg from straight down"
            robot.fault(line, f"{what}, which an arm of four axes cannot take")


def _tilt(target: Pose, frame: Pose, flange: FloatArray) -> float:
    """The angle between z of the flange and straight down, deg.

    The rotation of the flange is R_frame R_target R_tool', and z is its last column. R_tool' e_z is
    the last row of R_tool.
    flange: last row of flange_from_tool.
    """
    x, y, z = (frame.rotation @ target.rotation @ flange).tolist()
    return math.degrees(math.atan2(math.hypot(x, y), -z))
