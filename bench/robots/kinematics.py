"""Joint values from poses: `python -m bench.robots.kinematics [POSES, 10000]`.

Solutions are put through a forward kinematics of quaternions, which is not camgen's, and compared
with those of py-opw-kinematics where that is installed.
"""

from __future__ import annotations

import importlib
import math
import sys
from collections.abc import Iterator
from functools import partial
from importlib.util import find_spec

import numpy as np

from bench.support.runner import Cells, Scenario, read_words, run
from bench.support.timing import best_seconds
from camgen.model.pose import FloatArray, Pose, compute_quaternion
from camgen.robots.catalogue import list_robots
from camgen.robots.kinematics.arms import Spherical
from camgen.robots.kinematics.forward import compute_flange, compute_link_frames
from camgen.robots.kinematics.inverse import compute_solutions
from camgen.robots.kinematics.joint_limits import are_within_limits, compute_theta
from camgen.robots.models import Robot
from tests.support.turned import add_turns

COLUMNS = (
    "robot | poses {:,} | branches {} to {} | found again {:.2f} % | mm {:.1e} | rad {:.1e} "
    "| us per pose {:.2f} | poses/s {:,.0f} | forward, us {:.2f}"
)
PEER_COLUMNS = (
    "robot | same set of solutions as py-opw-kinematics {:,} of {:,} "
    "| largest difference, rad {:.1e} | its us per pose {:.2f}"
)


def multiply(a: FloatArray, b: FloatArray) -> FloatArray:
    """Products of quaternions (..., 4), w first."""
    w, v = a[..., :1], a[..., 1:]
    other_w, other_v = b[..., :1], b[..., 1:]
    scalar = w * other_w - (v * other_v).sum(axis=-1, keepdims=True)
    return np.concatenate([scalar, w * other_v + other_w * v + np.cross(v, other_v)], axis=-1)


def rotate(q: FloatArray, v: FloatArray) -> FloatArray:
    """Vectors (..., 3) rotated by quaternions (..., 4)."""
    u = q[..., 1:]
    t = 2 * np.cross(u, v)
    return np.asarray(v + q[..., :1] * t + np.cross(u, t))


def compute_by_quaternions(robot: Robot, joints: FloatArray) -> tuple[FloatArray, FloatArray]:
    """base_from_flange of (N, J) as quaternions (N, 4) and origins (N, 3)."""
    rotation = np.broadcast_to(np.array([1.0, 0, 0, 0]), (len(joints), 4))
    origin = np.zeros((len(joints), 3))
    serial = np.einsum("jk,nk->nj", robot.coupling, joints)

    def append(pose: Pose) -> tuple[FloatArray, FloatArray]:
        turned = multiply(rotation, np.broadcast_to(compute_quaternion(pose.rotation), (1, 4)))
        return turned, origin + rotate(rotation, np.array(pose.origin))

    for k, joint in enumerate(robot.joints):
        rotation, origin = append(joint.previous_from_joint)
        axis, value = np.array(joint.axis), serial[:, k, None]
        if joint.sliding:
            origin = origin + rotate(rotation, axis * value)
        else:
            turn = np.hstack([np.cos(value / 2), np.sin(value / 2) * axis])
            rotation = multiply(rotation, turn)
    return append(robot.flange)


def measure_errors(robot: Robot, solutions: FloatArray, joints: FloatArray) -> tuple[float, float]:
    """The largest mm and rad between the flange at joint values (N, J) and at all of (N, B, J)."""
    is_there = np.isfinite(solutions[:, :, 0])
    source = np.nonzero(is_there)[0]
    rotation, origin = compute_by_quaternions(robot, joints)
    other_rotation, other_origin = compute_by_quaternions(robot, solutions[is_there])
    error = multiply(other_rotation * [1, -1, -1, -1], rotation[source])
    angle = 2 * np.arctan2(np.linalg.norm(error[:, 1:], axis=1), np.abs(error[:, 0]))
    distance = np.linalg.norm(other_origin - origin[source], axis=1)
    return float(distance.max()), float(angle.max())


def draw_joints(robot: Robot, count: int) -> FloatArray:
    """Joint values (count, J) within all limits."""
    rng = np.random.default_rng(0)
    values = rng.uniform(robot.limits[:, 0], robot.limits[:, 1], (4 * count, len(robot.joints)))
    return np.asarray(values[are_within_limits(robot, values)][:count])


def measure(robot: Robot, poses: int) -> Iterator[Cells]:
    """The row of a robot. A robot that is solved by iteration has a tenth of the poses."""
    joints = draw_joints(robot, poses if robot.arm else poses // 10)
    rotations, origins = compute_flange(robot, joints)
    inverse = partial(compute_solutions, robot, rotations, origins)
    seconds = best_seconds(inverse, 5 if robot.arm else 1)
    forward = best_seconds(partial(compute_link_frames, robot, joints), 5)
    solutions = inverse()
    errors = measure_errors(robot, solutions, joints)
    turned = add_turns(robot, solutions).reshape(len(joints), -1, len(robot.joints))
    distances = np.abs(np.where(np.isnan(turned), math.inf, turned) - joints[:, None]).max(axis=2)
    again = 100 * (distances.min(axis=1) < 1e-6).mean()
    count = np.isfinite(solutions[:, :, 0]).sum(axis=1)
    rates = 1e6 * seconds / len(joints), len(joints) / seconds, 1e6 * forward / len(joints)
    yield robot.name, len(joints), (count.min(), count.max()), again, *errors, *rates


def compare_peer(robot: Robot, count: int) -> Iterator[Cells]:
    """The row of a robot with a spherical wrist beside py-opw-kinematics."""
    opw = importlib.import_module("py_opw_kinematics")
    transform = importlib.import_module("scipy.spatial.transform")
    arm = robot.arm
    lengths = {name: getattr(arm, name) for name in ("a1", "a2", "b", "c1", "c2", "c3")}
    c4 = float(np.linalg.norm(arm.flange_from_wrist.origin))
    peer = opw.Robot(opw.KinematicModel(**lengths, c4=c4), degrees=False)
    rotations, origins = compute_flange(robot, draw_joints(robot, count))
    matrices = transform.Rotation.from_matrix(rotations)
    poses = transform.RigidTransform.from_components(origins, matrices)
    seconds = best_seconds(partial(peer.reach, poses), 3)
    theirs = np.asarray(peer.reach(poses).joints)
    ours = compute_theta(robot, arm, compute_solutions(robot, rotations, origins))
    turns = np.remainder(ours[:, :, None] - theirs[:, None] + math.pi, math.tau) - math.pi
    errors = np.abs(turns).max(axis=3)
    nearest = np.where(np.isnan(errors), math.inf, errors).min(axis=2)
    is_there = np.isfinite(ours[:, :, 0])
    is_same = is_there.sum(axis=1) == np.isfinite(theirs[:, :, 0]).sum(axis=1)
    is_same &= ((nearest < 1e-6) | ~is_there).all(axis=1)
    worst, n = nearest[is_there & is_same[:, None]].max(), len(ours)
    yield robot.name, (is_same.sum(), n), worst, 1e6 * seconds / n


def main(count: int) -> int:
    """Prints the tables of all robots."""
    scenarios = [Scenario(COLUMNS, [(robot, count) for robot in list_robots()], measure)]
    if find_spec("py_opw_kinematics"):
        robots = [robot for robot in list_robots() if isinstance(robot.arm, Spherical)]
        inputs = [(robot, count) for robot in robots]
        scenarios.append(Scenario(PEER_COLUMNS, inputs, compare_peer))
    return run(*scenarios)


if __name__ == "__main__":
    sys.exit(main(*read_words(10_000)))
