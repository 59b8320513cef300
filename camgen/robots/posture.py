"""Computes the words and numbers by which controllers distinguish postures from joint values.

Sources: RAPID's data type confdata (quarter turns of axes 1, 4 and 6; cfx of serial arms as three
offline tools agree on it, no ABB text was seen); figures of robots in DENSO's RC8 manual; V+ on a
READY controller and a simulator of V+. Values that these do not determine are not `sure`. The post
decides what to write then.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.ragged import mark_run_starts
from camgen.model.errors import JobError
from camgen.model.part import BoolArray
from camgen.model.pose import FloatArray
from camgen.model.program import Posture
from camgen.robots.kinematics.arms import Scara, Spherical
from camgen.robots.kinematics.joint_limits import compute_theta
from camgen.robots.kinematics.spherical import find_branch
from camgen.robots.models import Robot

#: Fig that means "keep the present figure".
ANY_FIGURE = -1
#: Decimals of a degree to which angles are rounded, so that an axis at 0 is not at -1e-15.
_DIGITS = 6
#: deg: nearer than this to half a turn, a controller may see an axis on either side of it.
_BORDER = 0.01
_LEFTY, _BELOW, _NONFLIP, _SIX_DOUBLE, _FOUR_DOUBLE = 1, 2, 4, 8, 16


class Notation(Struct, frozen=True, eq=False):
    """A posture per row, as a controller writes it.

    values: (N,) or (N, K), numbers or words.
    sure: (N,) whether the sources determine them.
    """

    values: NDArray[Any]
    sure: BoolArray


def compute_postures(robot: Robot, joints: FloatArray, straight: BoolArray) -> list[Posture | None]:
    """The posture of each row of joint values (N, J), rad or mm, None if nothing of it is sure.

    The rows are the values at the ends of consecutive motions. Equal postures are one object.

    straight: (N,) whether a motion is a line or an arc, which must end in the figure in which it
        starts (RC8 manual, Move C).

    The figure is left out, so that the arm keeps to the nearest one, if a straight motion starts in
    another figure, or if axis 4 or 6 ends at half a turn, where the controller may see it on either
    side. The words of V+ are left out unless they are sure in all rows. Nothing is sure of an arm
    without a known controller, such as most arms from a URDF.
    """
    count = len(joints)
    if not robot.controller:
        return [None] * count
    unsure = np.zeros(count, np.bool_)
    conf = Notation(np.zeros((count, 4), np.int64), unsure)
    words = np.empty((count, 0), np.str_)
    figure = denso_figure(robot, joints)
    kept = figure.sure & ~(straight & (figure.values != np.roll(figure.values, 1)))
    if isinstance(robot.arm, Spherical):
        conf = abb_confdata(robot, joints)
        kept &= (np.abs(np.abs(_degrees(joints[:, [3, 5]])) - 180) > _BORDER).all(axis=1)
    if isinstance(robot.arm, Spherical | Scara):
        switches = vplus_switches(robot, joints)
        words = switches.values if switches.sure.all() else words
    columns = conf.values, conf.sure[:, None], figure.values[:, None], kept[:, None]
    is_start = mark_run_starts(np.column_stack(columns)) | mark_run_starts(words)
    starts = np.flatnonzero(is_start)
    known: dict[Posture, Posture] = {}
    result: list[Posture | None] = []
    for row, end in zip(starts.tolist(), [*starts[1:].tolist(), count], strict=True):
        cf1, cf4, cf6, cfx = conf.values[row].tolist()
        confdata = (cf1, cf4, cf6, cfx) if conf.sure[row] else None
        fig = int(figure.values[row]) if kept[row] else None
        posture = Posture(confdata, fig, tuple(words[row].tolist()))
        shared = known.setdefault(posture, posture) if posture != Posture() else None
        result += [shared] * (end - row)
    return result


def abb_confdata(robot: Robot, joints: FloatArray) -> Notation:
    """cf1, cf4, cf6 and cfx (N, 4) of joint values (N, 6), rad.

    cf: quarter turn of an axis, 0 from 0 to below 90 deg, -1 from -90 to below 0.
    cfx of serial arms: 4 with the wrist centre behind axis 1, + 2 with the wrist centre behind the
        lower arm, + 1 with axis 5 below 0.
    cfx of arms with a rod: 0, which is not sure with the wrist behind axis 1.

    Raises JobError for a robot without a spherical wrist.
    """
    arm = _six_axes(robot, "confdata")
    degrees = _degrees(joints)
    cf = np.floor_divide(degrees[:, [0, 3, 5]], 90.0)
    arm_flags = find_branch(arm, compute_theta(robot, arm, joints)) & 6
    if np.isfinite(robot.serial_limits).any():
        return Notation(np.column_stack([cf, np.zeros(len(cf))]).astype(np.int64), arm_flags < 4)
    cfx = arm_flags + (degrees[:, 4] < 0)
    return Notation(np.column_stack([cf, cfx]).astype(np.int64), np.ones(len(cf), dtype=bool))


def denso_figure(robot: Robot, joints: FloatArray) -> Notation:
    """Fig (N,) of joint values (N, 6), rad.

    1 lefty, + 2 below, + 4 non-flip, + 8 J6 double, + 16 J4 double. Lefty is the wrist centre in
    front of axis 1. It is `ANY_FIGURE` and not sure for righty arms, whose elbow and wrist may be
    counted in the opposite way, and for arms without a spherical wrist (COBOTTA).
    """
    if not isinstance(robot.arm, Spherical):
        return Notation(np.full(len(joints), ANY_FIGURE), np.zeros(len(joints), dtype=bool))
    degrees = _degrees(joints)
    flags = find_branch(robot.arm, compute_theta(robot, robot.arm, joints))
    is_lefty = flags < 4
    figure = _LEFTY + _BELOW * ((flags & 2) > 0) + _NONFLIP * (degrees[:, 4] >= 0)
    figure += _SIX_DOUBLE * _is_double(degrees[:, 5]) + _FOUR_DOUBLE * _is_double(degrees[:, 3])
    return Notation(np.where(is_lefty, figure, ANY_FIGURE), is_lefty)


def vplus_switches(robot: Robot, joints: FloatArray) -> Notation:
    """The switches that V+ needs before a motion to joint values (N, J), rad or mm.

    SCARA: RIGHTY with J2 > 0.
    Six axes: LEFTY with the wrist centre in front of J1, ABOVE with the elbow above the line from
    shoulder to wrist, NOFLIP with J5 from 0 up; a righty arm is not sure.
    Both: SINGLE with the last joint within half a turn.

    Raises JobError for a robot of another kind.
    """
    degrees = _degrees(joints)
    last = np.where(_is_double(degrees[:, -1]), "MULTIPLE", "SINGLE")
    if isinstance(robot.arm, Scara):
        side = np.where(degrees[:, 1] > 0, "RIGHTY", "LEFTY")
        return Notation(np.column_stack([side, last]), np.ones(len(joints), dtype=bool))
    arm = _six_axes(robot, "V+ switches")
    flags = find_branch(arm, compute_theta(robot, arm, joints))
    side = np.where(flags < 4, "LEFTY", "RIGHTY")
    elbow = np.where(flags & 2, "BELOW", "ABOVE")
    wrist = np.where(degrees[:, 4] >= 0, "NOFLIP", "FLIP")
    return Notation(np.column_stack([side, elbow, wrist, last]), flags < 4)


def _six_axes(robot: Robot, what: str) -> Spherical:
    if isinstance(robot.arm, Spherical):
        return robot.arm
    raise JobError(
        f"robot {robot.name}",
        f"has no {what}",
        remedy="they are for six axes with a spherical wrist",
    )


def _degrees(joints: FloatArray) -> FloatArray:
    return np.asarray(np.round(np.degrees(joints), _DIGITS))


def _is_double(degrees: FloatArray) -> BoolArray:
    """Whether angles are beyond half a turn. Single is above -180 and up to 180 deg."""
    return np.asarray((degrees <= -180) | (degrees > 180))
