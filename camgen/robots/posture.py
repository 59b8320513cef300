"""The words and numbers by which controllers tell one arm posture from another, read off the joints.

Sources: RAPID's data type confdata (quarter turns of axes 1, 4, 6; cfx of serial arms as three offline tools agree on
it, no ABB text was seen); DENSO's RC8 manual, figures of robots; V+ READY and a simulator of V+. What none of them
settles is not ``sure``, and what then to write is up to the post.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.ragged import run_starts
from camgen.model.errors import JobError
from camgen.model.pose import FloatArray
from camgen.model.program import Posture
from camgen.robots.kinematics.arms import Scara, Spherical
from camgen.robots.kinematics.joint_limits import theta_of
from camgen.robots.kinematics.spherical import branch
from camgen.robots.models import Robot

#: Fig for "keep the present figure".
ANY_FIGURE = -1
#: Angles are rounded to so many digits of a degree: an axis at 0 is not at -1e-15.
_DIGITS = 6
#: deg: so close to half a turn it is open on which side of it a controller sees an axis.
_BORDER = 0.01
_LEFTY, _BELOW, _NONFLIP, _SIX_DOUBLE, _FOUR_DOUBLE = 1, 2, 4, 8, 16


class Numbers(Struct, frozen=True, eq=False):
    """One posture per row: values (N,) or (N, 4); sure (N,)."""

    values: NDArray[np.int64]
    sure: NDArray[np.bool_]


class Words(Struct, frozen=True, eq=False):
    """One posture per row: words (N); sure (N,)."""

    words: tuple[tuple[str, ...], ...]
    sure: NDArray[np.bool_]


def postures(robot: Robot, joints: FloatArray, straight: NDArray[np.bool_]) -> list[Posture | None]:
    """The posture of each row of joint values (N, J), rad or mm: the values in which motions end, one after the other;
    None where nothing is sure. Rows that are alike share one.

    straight: (N,) lines and arcs, which must end in the figure in which they start (RC8 manual, Move C). One on which
    axis 4 or 6 turns past half a turn does not; its figure is left out, so that the arm keeps to the nearest. So is one
    with axis 4 or 6 at half a turn, which the controller may see on either side of it.
    Nothing is sure of an arm without a known controller, as most from a URDF.
    """
    count = len(joints)
    if not robot.controller:
        return [None] * count
    six, named = isinstance(robot.arm, Spherical), isinstance(robot.arm, Spherical | Scara)
    conf = (
        abb_confdata(robot, joints)
        if six
        else Numbers(np.zeros((count, 4), np.int64), np.zeros(count, np.bool_))
    )
    figure = denso_figure(robot, joints)
    kept = figure.sure & ~(straight & (figure.values != np.roll(figure.values, 1)))
    if six:
        kept &= (np.abs(np.abs(_degrees(joints[:, [3, 5]])) - 180) > _BORDER).all(axis=1)
    switches = (
        vplus_switches(robot, joints) if named else Words(((),) * count, np.zeros(count, np.bool_))
    )
    words = switches.words if switches.sure.all() else ((),) * count
    said = [conf.values, conf.sure[:, None], figure.values[:, None], kept[:, None]]
    seen: dict[tuple[str, ...], int] = {}
    table = np.column_stack([*said, [seen.setdefault(one, len(seen)) for one in words]])
    starts = run_starts(table)
    made: dict[Posture, Posture] = {}
    found: list[Posture | None] = []
    for row, end in zip(starts.tolist(), [*starts[1:].tolist(), count], strict=True):
        cf1, cf4, cf6, cfx = conf.values[row].tolist()
        confdata = (cf1, cf4, cf6, cfx) if conf.sure[row] else None
        one = Posture(confdata, int(figure.values[row]) if kept[row] else None, words[row])
        found += [made.setdefault(one, one) if one != Posture() else None] * (end - row)
    return found


def abb_confdata(robot: Robot, joints: FloatArray) -> Numbers:
    """cf1, cf4, cf6, cfx (N, 4) of joint values (N, 6), rad.

    cf: the quarter turn of an axis, 0 from 0 to below 90 deg, -1 from -90 to below 0. cfx of serial arms: 4 with the
    wrist centre behind axis 1, + 2 with it behind the lower arm, + 1 with axis 5 below 0; of arms with a rod 0, which
    leaves a wrist behind axis 1 unsaid: not sure. JobError for a robot without a spherical wrist.
    """
    arm = _six_axes(robot, "confdata")
    degrees = _degrees(joints)
    cf = np.floor_divide(degrees[:, [0, 3, 5]], 90.0)
    arm_flags = branch(arm, theta_of(robot, arm, joints)) & 6
    if np.isfinite(robot.serial_limits).any():
        return Numbers(np.column_stack([cf, np.zeros(len(cf))]).astype(np.int64), arm_flags < 4)
    cfx = arm_flags + (degrees[:, 4] < 0)
    return Numbers(np.column_stack([cf, cfx]).astype(np.int64), np.ones(len(cf), dtype=bool))


def denso_figure(robot: Robot, joints: FloatArray) -> Numbers:
    """Fig (N,) of joint values (N, 6), rad: 1 lefty, + 2 below, + 4 non-flip, + 8 J6 double, + 16 J4 double.

    Lefty: the wrist centre in front of axis 1. Not sure, and ``ANY_FIGURE``: righty, where the elbow and the wrist may
    be counted the other way round, and arms without a spherical wrist (COBOTTA).
    """
    if not isinstance(robot.arm, Spherical):
        return Numbers(np.full(len(joints), ANY_FIGURE), np.zeros(len(joints), dtype=bool))
    degrees = _degrees(joints)
    flags = branch(robot.arm, theta_of(robot, robot.arm, joints))
    lefty = flags < 4
    figure = _LEFTY + _BELOW * ((flags & 2) > 0) + _NONFLIP * (degrees[:, 4] >= 0)
    figure += _SIX_DOUBLE * _double(degrees[:, 5]) + _FOUR_DOUBLE * _double(degrees[:, 3])
    return Numbers(np.where(lefty, figure, ANY_FIGURE), lefty)


def vplus_switches(robot: Robot, joints: FloatArray) -> Words:
    """The switches that V+ needs before a motion to joint values (N, J), rad or mm.

    SCARA: RIGHTY with J2 > 0. Six axes: LEFTY with the wrist centre in front of J1, ABOVE with the elbow above the line
    from shoulder to wrist, NOFLIP with J5 from 0 up; a righty arm is not sure. SINGLE: the last joint within half a
    turn. JobError for a robot of another kind.
    """
    degrees = _degrees(joints)
    last = np.where(_double(degrees[:, -1]), "MULTIPLE", "SINGLE").tolist()
    if isinstance(robot.arm, Scara):
        side = np.where(degrees[:, 1] > 0, "RIGHTY", "LEFTY").tolist()
        return Words(tuple(zip(side, last, strict=True)), np.ones(len(joints), dtype=bool))
    arm = _six_axes(robot, "V+ switches")
    flags = branch(arm, theta_of(robot, arm, joints))
    side = np.where(flags < 4, "LEFTY", "RIGHTY").tolist()
    elbow = np.where(flags & 2, "BELOW", "ABOVE").tolist()
    wrist = np.where(degrees[:, 4] >= 0, "NOFLIP", "FLIP").tolist()
    return Words(tuple(zip(side, elbow, wrist, last, strict=True)), flags < 4)


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


def _double(degrees: FloatArray) -> NDArray[np.bool_]:
    """Beyond half a turn: single is above -180 and up to 180 deg."""
    return np.asarray((degrees <= -180) | (degrees > 180))
