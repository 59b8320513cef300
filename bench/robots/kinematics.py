"""Joints from poses: `python -m bench.robots.kinematics [POSES, 10000]`.

What is found is put through another forward way.
"""

from __future__ import annotations

import importlib
import math
from functools import partial

import numpy as np

from bench.support.runner import Table, machine, read_words
from bench.support.timing import best_seconds
from camgen.model.pose import FloatArray, Pose, compute_quaternion
from camgen.robots.catalogue import list_robots
from camgen.robots.kinematics.arms import Spherical
from camgen.robots.kinematics.forward import compute_flange, compute_link_frames
from camgen.robots.kinematics.inverse import compute_solutions
from camgen.robots.kinematics.joint_limits import are_within_limits, compute_theta
from camgen.robots.models import Robot
from tests.support.turned import add_turns

#: Of a robot; one whose joints are found by iteration is asked for a tenth.
POSES = 10_000


def times(a: FloatArray, b: FloatArray) -> FloatArray:
    """Products of quaternions (..., 4), w first."""
    aw, ax, ay, az = np.moveaxis(a, -1, 0)
    bw, bx, by, bz = np.moveaxis(b, -1, 0)
    return np.stack([
        aw * bw - ax * bx - ay * by - az * bz, aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx, aw * bz + ax * by - ay * bx + az * bw,
    ], axis=-1)  # fmt: skip


def turned(q: FloatArray, v: FloatArray) -> FloatArray:
    """Vectors (..., 3) turned by quaternions (..., 4)."""
    u = q[..., 1:]
    t = 2 * np.cross(u, v)
    return np.asarray(v + q[..., :1] * t + np.cross(u, t))


def by_quaternions(of: Robot, joints: FloatArray) -> tuple[FloatArray, FloatArray]:
    """base_from_flange of (N, J) as quaternions (N, 4) and origins (N, 3).

    Shares no code with camgen.robots.kinematics.forward.
    """
    q = np.broadcast_to(np.array([1.0, 0, 0, 0]), (len(joints), 4))
    at = np.zeros((len(joints), 3))
    serial = np.einsum("jk,nk->nj", of.coupling, joints)

    def moved(pose: Pose) -> tuple[FloatArray, FloatArray]:
        return times(q, np.array(compute_quaternion(pose.rotation))), at + turned(
            q, np.array(pose.origin)
        )

    for k, joint in enumerate(of.joints):
        q, at = moved(joint.previous_from_joint)
        axis, value = np.array(joint.axis), serial[:, k, None]
        if joint.sliding:
            at = at + turned(q, axis * value)
        else:
            q = times(q, np.hstack([np.cos(value / 2), np.sin(value / 2) * axis]))
    return moved(of.flange)


def errors(of: Robot, solutions: FloatArray, joints: FloatArray) -> tuple[float, float]:
    """The greatest mm and rad between the flange at ``joints`` (N, J) and at all ``solutions`` (N, B, J)."""
    good = np.isfinite(solutions[:, :, 0])
    wanted_q, wanted_at = by_quaternions(of, joints)
    source = np.nonzero(good)[0]
    q, at = by_quaternions(of, solutions[good])
    away = times(q * [1, -1, -1, -1], wanted_q[source])
    angle = 2 * np.arctan2(np.linalg.norm(away[:, 1:], axis=1), np.abs(away[:, 0]))
    return float(np.linalg.norm(at - wanted_at[source], axis=1).max()), float(angle.max())


def drawn(of: Robot, count: int) -> FloatArray:
    """Configurations (count, J) within all limits."""
    rng = np.random.default_rng(0)
    values = rng.uniform(of.limits[:, 0], of.limits[:, 1], (4 * count, len(of.joints)))
    return np.asarray(values[are_within_limits(of, values)][:count])


def table_of_poses(poses: int) -> None:
    table = Table(
        "robot | poses {:,} | branches {} to {} | found again {:.2f} % | mm {:.1e} | rad {:.1e} "
        "| us per pose {:.2f} | poses/s {:,.0f} | forward, us {:.2f}"
    )
    for of in list_robots():
        joints = drawn(of, poses if of.arm else poses // 10)
        rotations, origins = compute_flange(of, joints)
        seconds = best_seconds(
            partial(compute_solutions, of, rotations, origins), 5 if of.arm else 1
        )
        forward = best_seconds(partial(compute_link_frames, of, joints), 5)
        solutions = compute_solutions(of, rotations, origins)
        mm, rad = errors(of, solutions, joints)
        every = add_turns(of, solutions).reshape(len(joints), -1, len(of.joints))
        off = np.abs(np.where(np.isnan(every), math.inf, every) - joints[:, None]).max(axis=2)
        again = 100 * (off.min(axis=1) < 1e-6).mean()
        count = np.isfinite(solutions[:, :, 0]).sum(axis=1)
        each, n = seconds / len(joints), len(joints)
        rates = 1e6 * each, 1 / each, 1e6 * forward / n
        table.add(of.name, n, (count.min(), count.max()), again, mm, rad, *rates)


def table_of_oracle(count: int) -> None:
    try:
        opw = importlib.import_module("py_opw_kinematics")
        transform = importlib.import_module("scipy.spatial.transform")
    except ImportError:
        print("\npy-opw-kinematics, the oracle, is not installed")
        return
    table = Table(
        "robot | same set of solutions as py-opw-kinematics {:,} of {:,} "
        "| greatest difference, rad {:.1e} | its us per pose {:.2f}"
    )
    for of in list_robots():
        arm = of.arm
        if not isinstance(arm, Spherical):
            continue
        c4 = float(np.linalg.norm(arm.flange_from_wrist.origin))
        model = opw.KinematicModel(
            a1=arm.a1, a2=arm.a2, b=arm.b, c1=arm.c1, c2=arm.c2, c3=arm.c3, c4=c4
        )
        other = opw.Robot(model, degrees=False)
        rotations, origins = compute_flange(of, drawn(of, count))
        poses = transform.RigidTransform.from_components(
            origins, transform.Rotation.from_matrix(rotations)
        )
        seconds = best_seconds(partial(other.reach, poses), 3)
        theirs = np.asarray(other.reach(poses).joints)
        ours = compute_theta(of, arm, compute_solutions(of, rotations, origins))
        apart = np.abs(
            np.remainder(ours[:, :, None] - theirs[:, None] + math.pi, math.tau) - math.pi
        ).max(axis=3)
        nearest = np.where(np.isnan(apart), math.inf, apart).min(axis=2)
        here = np.isfinite(ours[:, :, 0])
        same = (here.sum(axis=1) == np.isfinite(theirs[:, :, 0]).sum(axis=1)) & (
            (nearest < 1e-6) | ~here
        ).all(axis=1)
        worst, n = nearest[here & same[:, None]].max(), len(ours)
        table.add(of.name, (same.sum(), n), worst, 1e6 * seconds / n)


if __name__ == "__main__":
    print(machine())
    (count,) = read_words(POSES)
    for measure in (table_of_poses, table_of_oracle):
        measure(count)
