"""What an arm of four axes cannot take: a tool that is tilted, postures of an elbow or a wrist. For ``vplus``.

Source: docs/posts/vplus.md; joints 1, 2 and 4 of a SCARA turn about the base's z, joint 3 slides along it.
"""

from __future__ import annotations

import math

from camgen.model.pose import FloatArray, Pose
from camgen.model.program import Joints, MoveJ, MoveL

from .robot import RobotState

#: Deg. Three orientations of four printed digits make up a flange, each within 1e-4 deg.
_UPRIGHT = 1e-3


def check_scara(robot: RobotState) -> None:
    """Reports what stands in the text for an arm of more axes; of tilts those in frames that the text gives."""
    for line, word in robot.bent.items():
        robot.report(line, f"{word}: an arm of four axes has no such posture")
    if robot.tool is None:
        return
    flange = robot.tool.rotation[2]
    #: By the arrays, of which most motions share theirs.
    tilts: dict[tuple[int, int], float] = {}
    for item, line, frame in zip(robot.body, robot.lines, robot.frames, strict=True):
        if (
            frame is None
            or frame.external
            or not isinstance(item, MoveJ | MoveL)
            or isinstance(item.target, Joints)
        ):
            continue
        key = id(item.target.rotation), id(frame.pose)
        if key not in tilts:
            tilts[key] = _tilt(item.target, frame.pose, flange)
        if tilts[key] > _UPRIGHT:
            what = f"the flange {tilts[key]:.4g} deg from straight down"
            robot.report(line, f"{what}, which an arm of four axes cannot take")


def _tilt(target: Pose, frame: Pose, flange: FloatArray) -> float:
    """Deg between the z of the flange and straight down. flange: the bottom row of flange_from_tool.

    R_flange = R_frame R_target R_tool'; its last column is R_frame R_target R_tool' e_z, and R_tool' e_z is that row.
    """
    x, y, z = (frame.rotation @ target.rotation @ flange).tolist()
    return math.degrees(math.atan2(math.hypot(x, y), -z))
