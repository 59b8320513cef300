"""Explains why no joint values continue a path, by the solutions that come nearest to it."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from msgspec import Struct

from camgen.model.pose import FloatArray
from camgen.model.text import short
from camgen.robots.kinematics import planar as flat
from camgen.robots.kinematics import spherical, three_parallel
from camgen.robots.kinematics.arms import Gantry, Scara, Spherical
from camgen.robots.kinematics.continuity import JUMP, Stuck
from camgen.robots.kinematics.joint_limits import (
    are_within_limits,
    list_turn_counts,
    measure_excess,
)
from camgen.robots.kinematics.singular import SINGULARITIES, measure_singularity_distance
from camgen.robots.kinematics.three_parallel import ThreeParallel
from camgen.robots.models import Robot

#: rad: a joint jump nearer than this to a singularity results from it.
_NEAR_SINGULAR = math.radians(20)


class Reason(Struct, frozen=True):
    """The reason why a path cannot be followed.

    row: first row that cannot be reached.
    text: the reason, with its amount.
    """

    row: int
    kind: Literal["reach", "lean", "limit", "singular", "jump"]
    text: str


def explain_stuck(
    robot: Robot,
    rotations: FloatArray,
    origins: FloatArray,
    stuck: Stuck,
    margin: float = 0.0,
    jump: float = JUMP,
) -> Reason:
    """The reason why `follow` was stuck, for the same path, margin and jump."""
    row = stuck.row
    solutions = stuck.candidates[row]
    solutions = solutions[np.isfinite(solutions).all(axis=1)]
    if not len(solutions):
        return _explain_reach(robot, rotations[row : row + 1], origins[row : row + 1], row)
    turned = (solutions[:, None] + math.tau * list_turn_counts(robot)).reshape(
        -1, solutions.shape[1]
    )
    allowed = turned[are_within_limits(robot, turned)]
    if not len(allowed):
        return _explain_limit(robot, turned, row)
    distances = measure_singularity_distance(robot, allowed).min(axis=-1, initial=math.inf)
    if not (distances >= margin).any():
        return _explain_singularity(robot, allowed, row)
    return _explain_gap(robot, solutions, stuck.reached, row, margin, jump)


def _explain_reach(robot: Robot, rotation: FloatArray, origin: FloatArray, row: int) -> Reason:
    arm, lean, short_of = robot.arm, 0.0, 0.0
    if isinstance(arm, Gantry | Scara):
        lean = float(flat.measure_lean(arm, rotation)[0])
    if isinstance(arm, Scara):
        short_of = float(flat.scara_shortfall(arm, rotation, origin)[0])
    elif isinstance(arm, ThreeParallel):
        short_of = float(three_parallel.measure_shortfall(arm, rotation, origin)[0])
    elif isinstance(arm, Spherical):
        short_of = float(spherical.measure_shortfall(arm, rotation, origin)[0])
    elif arm is None:
        return Reason(row, "reach", "no joints were found for this pose")
    if lean > flat.LEAN:
        return Reason(row, "lean", f"the robot cannot lean its tool by {_degrees(lean)}")
    return Reason(row, "reach", f"out of reach by {short(short_of, 3)} mm")


def describe_limit(robot: Robot, joints: FloatArray) -> str:
    """The joint that is farthest beyond its limits at joint values (J,), with the amount."""
    return _explain_limit(robot, joints[None], 0).text


def _explain_limit(robot: Robot, joints: FloatArray, row: int) -> Reason:
    """The reason by the joint values among (M, J) that exceed the limits least."""
    beyond = measure_excess(robot, joints)
    nearest = beyond[beyond.max(axis=1).argmin()]
    joint, amount = robot.joints[int(nearest.argmax())], float(nearest.max())
    distance = f"{short(amount, 3)} mm" if joint.sliding else _degrees(amount)
    return Reason(row, "limit", f"{joint.name} is beyond its limit by {distance}")


def _explain_singularity(robot: Robot, joints: FloatArray, row: int) -> Reason:
    """The reason by the joint values among (M, J) that are farthest from a singularity."""
    distances = measure_singularity_distance(robot, joints)
    best = distances[distances.min(axis=1).argmax()]
    name, distance = SINGULARITIES[robot.kind][int(best.argmin())], float(best.min())
    return Reason(row, "singular", f"singular, {name}: {_degrees(distance)} away")


def _explain_gap(
    robot: Robot,
    solutions: FloatArray,
    reached: FloatArray,
    row: int,
    margin: float,
    jump: float,
) -> Reason:
    """The reason why no step leads from `reached` (M, J) to the solutions (B, J) of a row."""
    moved = solutions[None] - reached[:, None]
    moved = np.where(robot.revolute, np.remainder(moved + math.pi, math.tau) - math.pi, moved)
    leaps = np.abs(moved)[..., robot.revolute].max(axis=-1)
    after = (reached[:, None] + moved)[leaps <= jump]
    if len(after):
        explain = _explain_singularity if are_within_limits(robot, after).any() else _explain_limit
        return explain(robot, after, row)
    before, branch = np.unravel_index(leaps.argmin(), leaps.shape)
    joint = int(np.where(robot.revolute, np.abs(moved[before, branch]), 0.0).argmax())
    turn = _degrees(float(leaps[before, branch]))
    text = f"{robot.joints[joint].name} would turn by {turn} at once"
    distances = measure_singularity_distance(robot, np.stack([reached[before], solutions[branch]]))
    if distances.min(initial=math.inf) < max(_NEAR_SINGULAR, margin):
        name = SINGULARITIES[robot.kind][int(distances.min(axis=0).argmin())]
        return Reason(row, "singular", f"singular, {name}: {text}")
    return Reason(row, "jump", text)


def _degrees(angle: float) -> str:
    return f"{short(math.degrees(angle), 3)} deg"
