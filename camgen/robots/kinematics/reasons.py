"""Why a path cannot go on: what stands in the way of the joints that come nearest to going on."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from msgspec import Struct

from camgen.model.pose import FloatArray
from camgen.model.text import short
from camgen.robots.kinematics import planar as flat
from camgen.robots.kinematics import spherical, three_parallel
from camgen.robots.kinematics.arms import Gantry, Scara
from camgen.robots.kinematics.continuity import JUMP, Stuck
from camgen.robots.kinematics.joint_limits import excess, turns, within
from camgen.robots.kinematics.singular import from_singular, singularities
from camgen.robots.kinematics.three_parallel import ThreeParallel
from camgen.robots.models import Robot

#: rad: a joint that has to jump so near a singularity does so because of it.
_NEAR_SINGULAR = math.radians(20)


class Reason(Struct, frozen=True):
    """row: the first row that cannot be reached. joint: its index, -1 where none is to blame. amount: mm or rad: out
    of reach, leaning, beyond the limit, from the singularity, or of the jump.
    """

    row: int
    kind: Literal["reach", "lean", "limit", "singular", "jump"]
    joint: int
    amount: float
    text: str


def why(
    robot: Robot,
    rotations: FloatArray,
    origins: FloatArray,
    stuck: Stuck,
    margin: float = 0.0,
    jump: float = JUMP,
) -> Reason:
    """What ``stuck`` ran into, for the same path, margin and jump that ``follow`` was given."""
    row = stuck.row
    own = stuck.candidates[row]
    own = own[np.isfinite(own).all(axis=1)]
    if not len(own):
        return _no_solution(robot, rotations[row : row + 1], origins[row : row + 1], row)
    every = (own[:, None] + math.tau * turns(robot)).reshape(-1, own.shape[1])
    good = every[within(robot, every)]
    if not len(good):
        return _limit(robot, every, row)
    clear = good[_clearance(robot, good) >= margin]
    if not len(clear):
        return _singular(robot, good, row)
    return _explain_gap(robot, own, stuck.reached, row, margin, jump)


def _clearance(robot: Robot, joints: FloatArray) -> FloatArray:
    return np.asarray(from_singular(robot, joints).min(axis=-1, initial=math.inf))


def _no_solution(robot: Robot, rotation: FloatArray, origin: FloatArray, row: int) -> Reason:
    arm, lean, short_of = robot.arm, 0.0, 0.0
    if isinstance(arm, Gantry):
        lean = float(flat.gantry_lean(arm, rotation)[0])
    elif isinstance(arm, Scara):
        lean, short_of = (
            float(flat.scara_lean(arm, rotation)[0]),
            float(flat.scara_shortfall(arm, rotation, origin)[0]),
        )
    elif isinstance(arm, ThreeParallel):
        short_of = float(three_parallel.shortfall(arm, rotation, origin)[0])
    elif arm:
        short_of = float(spherical.shortfall(arm, rotation, origin)[0])
    else:
        return Reason(row, "reach", -1, math.nan, "no joints were found for this pose")
    if lean > flat.LEAN:
        text = f"the robot cannot lean its tool, and it has to by {_degrees(lean)}"
        return Reason(row, "lean", -1, lean, text)
    return Reason(row, "reach", -1, short_of, f"out of reach by {short(short_of, 3)} mm")


def tell_limit(robot: Robot, joints: FloatArray) -> str:
    """The joint that is beyond its limits by most at joint values (J,), and by how much."""
    return _limit(robot, joints[None], 0).text


def _limit(robot: Robot, joints: FloatArray, row: int) -> Reason:
    """Of all ``joints`` (M, J) those that break the limits least."""
    beyond = excess(robot, joints)
    nearest = beyond[beyond.max(axis=1).argmin()]
    joint = int(nearest.argmax())
    amount = float(nearest[joint])
    text = f"{robot.joints[joint].name} is beyond its limit by {_amount(robot, joint, amount)}"
    return Reason(row, "limit", joint, amount, text)


def _singular(robot: Robot, joints: FloatArray, row: int) -> Reason:
    """Of all ``joints`` (M, J) those that are farthest from a singularity."""
    away = from_singular(robot, joints)
    best = away[away.min(axis=1).argmax()]
    name = singularities(robot)[int(best.argmin())]
    return Reason(
        row,
        "singular",
        -1,
        float(best.min()),
        f"singular, {name}: {_degrees(float(best.min()))} away",
    )


def _explain_gap(
    robot: Robot, own: FloatArray, reached: FloatArray, row: int, margin: float, jump: float
) -> Reason:
    """``own`` (B, J) solve the row, but nothing leads there from ``reached`` (M, J)."""
    turning = np.array([not joint.sliding for joint in robot.joints])
    moved = own[None] - reached[:, None]
    moved = np.where(turning, np.remainder(moved + math.pi, math.tau) - math.pi, moved)
    leaps = np.abs(moved)[..., turning].max(axis=-1)
    after = (reached[:, None] + moved)[leaps <= jump]
    if len(after):
        return (
            _limit(robot, after, row)
            if not within(robot, after).any()
            else _singular(robot, after, row)
        )
    before, branch = np.unravel_index(leaps.argmin(), leaps.shape)
    joint = int(np.where(turning, np.abs(moved[before, branch]), 0.0).argmax())
    amount = float(leaps[before, branch])
    ends = np.stack([reached[before], own[branch]])
    if _clearance(robot, ends).min() < max(_NEAR_SINGULAR, margin):
        away = from_singular(robot, ends)
        name = singularities(robot)[int(away.min(axis=0).argmin())]
        text = (
            f"singular, {name}: {robot.joints[joint].name} would turn by {_degrees(amount)} at once"
        )
        return Reason(row, "singular", joint, float(away.min()), text)
    return Reason(
        row,
        "jump",
        joint,
        amount,
        f"{robot.joints[joint].name} would turn by {_degrees(amount)} at once",
    )


def _amount(robot: Robot, joint: int, value: float) -> str:
    return f"{short(value, 3)} mm" if robot.joints[joint].sliding else _degrees(value)


def _degrees(angle: float) -> str:
    return f"{short(math.degrees(angle), 3)} deg"
