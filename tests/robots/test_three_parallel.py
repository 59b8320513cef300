"""The closed form of arms with three parallel axes, compared with Denavit-Hartenberg matrices."""

import math

import numpy as np
import pytest
from msgspec.structs import replace

from camgen.model.pose import (
    FloatArray,
    Pose,
    frozen,
    pose_from_values,
    rotation_from_fixed_xyz,
    to_vec3,
)
from camgen.robots.catalogue import find_robot
from camgen.robots.chain import Joint
from camgen.robots.kinematics.arms import recognise_arm
from camgen.robots.kinematics.continuity import Stuck, follow
from camgen.robots.kinematics.inverse import compute_solutions
from camgen.robots.kinematics.joint_limits import compute_theta
from camgen.robots.kinematics.reasons import Reason, explain_stuck
from camgen.robots.kinematics.singular import measure_singularity_distance
from camgen.robots.kinematics.three_parallel import ThreeParallel, _measure_ahead
from camgen.robots.models import Robot

#: d, a, mm, of the joints of two arms as the maker publishes them, and alpha, rad, of both.
UR5E = ((162.5, 0, 0, 133.3, 99.7, 99.6), (0, -425.0, -392.2, 0, 0, 0))
UR10 = ((127.3, 0, 0, 163.941, 115.7, 92.2), (0, -612.0, -572.3, 0, 0, 0))
ALPHA = (math.pi / 2, 0.0, 0.0, math.pi / 2, -math.pi / 2, 0.0)
#: Another pose of the base, a rotated and shifted flange, and the signs of reversed axes.
BASE, FLANGE = (100, -50, 30, 20, -70, 110), (5, 6, 70, 10, 20, 30)
SIGNS = (-1.0, 1.0, -1.0, 1.0, -1.0, -1.0)
Table = tuple[tuple[float, ...], tuple[float, ...]]


def make_link(d: float, a: float, alpha: float) -> FloatArray:
    """The matrix from the frame of a joint to that of the next joint."""
    c, s = math.cos(alpha), math.sin(alpha)
    return np.array([[1, 0, 0, a], [0, c, -s, 0], [0, s, c, d], [0, 0, 0, 1.0]])


def compute_flange_matrix(table: Table, joints: FloatArray) -> FloatArray:
    """base_from_flange (4, 4) for the angles of the joints (6,)."""
    matrix = np.eye(4)
    for angle, d, a, alpha in zip(joints.tolist(), *table, ALPHA, strict=True):
        rotation = np.eye(4)
        rotation[:2, :2] = [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]
        matrix = matrix @ rotation @ make_link(d, a, alpha)
    return np.asarray(matrix)


def make_arm(table: Table) -> Robot:
    """The arm as a chain of joints."""
    steps = [np.eye(4), *(make_link(*row) for row in zip(*table, ALPHA, strict=True))]
    poses = [Pose(frozen(step[:3, :3]), to_vec3(step[:3, 3])) for step in steps]
    joints = tuple(
        Joint(f"axis {k}", False, pose, (0.0, 0.0, 1.0)) for k, pose in enumerate(poses[:-1], 1)
    )
    limits = frozen(np.tile([-2 * math.pi, 2 * math.pi], (6, 1)))
    arm = recognise_arm(joints, poses[-1])
    return replace(find_robot("IRB 120"), joints=joints, flange=poses[-1], limits=limits, arm=arm)


def draw_joint_values(count: int) -> FloatArray:
    """Random angles (N, 6)."""
    return np.random.default_rng(5).uniform(-math.pi, math.pi, (count, 6))


def measure_difference(first: FloatArray, second: FloatArray) -> FloatArray:
    """Largest difference of joint values (..., 6), regardless of whole turns."""
    difference = np.remainder(first - second + math.pi, math.tau) - math.pi
    return np.asarray(np.abs(difference).max(axis=-1))


@pytest.mark.parametrize("table", [UR5E, UR10])
def test_all_branches_bring_the_flange_to_its_pose(table: Table) -> None:
    cobot, joints = make_arm(table), draw_joint_values(300)
    assert cobot.kind == "three-parallel"
    poses = np.array([compute_flange_matrix(table, row) for row in joints])
    solutions = compute_solutions(cobot, poses[:, :3, :3], poses[:, :3, 3])
    assert solutions.shape == (300, 8, 6)
    assert np.nanmin(measure_difference(solutions, joints[:, None]), axis=1).max() < 1e-7
    for pose, branches in zip(poses, solutions, strict=True):
        for row in branches[np.isfinite(branches[:, 0])]:
            assert np.allclose(compute_flange_matrix(table, row), pose, atol=1e-6)
    assert np.isfinite(solutions[..., 0]).sum(axis=1).min() >= 2
    assert (np.isfinite(solutions[..., 0]).sum(axis=1) == 8).mean() > 0.4


def test_the_index_of_a_solution_is_its_branch() -> None:
    cobot, joints = make_arm(UR5E), draw_joint_values(200)
    assert isinstance(cobot.arm, ThreeParallel)
    poses = np.array([compute_flange_matrix(UR5E, row) for row in joints])
    solutions = compute_solutions(cobot, poses[:, :3, :3], poses[:, :3, 3])
    theta = compute_theta(cobot, cobot.arm, solutions)
    branches = 4 * (_measure_ahead(cobot.arm, theta) < 0)
    branches = branches + 2 * (np.sin(theta[..., 2]) < 0) + (np.sin(theta[..., 4]) < 0)
    is_solution = np.isfinite(solutions[..., 0])
    assert (branches == np.arange(8))[is_solution].all()


def test_an_arm_is_recognised_with_another_base_flange_and_signs_of_axes() -> None:
    cobot, joints = make_arm(UR10), draw_joint_values(200)
    base, oblique = pose_from_values(BASE), cobot.flange @ pose_from_values(FLANGE)
    reversed_joints = [
        replace(joint, axis=(0.0, 0.0, sign))
        for joint, sign in zip(cobot.joints, SIGNS, strict=True)
    ]
    reversed_joints[0] = replace(
        reversed_joints[0], previous_from_joint=base @ reversed_joints[0].previous_from_joint
    )
    arm = recognise_arm(tuple(reversed_joints), oblique)
    assert isinstance(arm, ThreeParallel)
    other = replace(cobot, joints=tuple(reversed_joints), flange=oblique, arm=arm)
    before, after = np.eye(4), np.eye(4)
    for matrix, values in ((before, BASE), (after, FLANGE)):
        matrix[:3, :3] = rotation_from_fixed_xyz(*np.radians(values[3:]))
        matrix[:3, 3] = values[:3]
    poses = np.array([before @ compute_flange_matrix(UR10, row) @ after for row in joints])
    solutions = compute_solutions(other, poses[:, :3, :3], poses[:, :3, 3])
    assert np.nanmin(measure_difference(solutions, (joints * SIGNS)[:, None]), axis=1).max() < 1e-7


def test_axis_6_keeps_its_given_value_if_it_is_parallel_to_axis_4() -> None:
    cobot = make_arm(UR5E)
    joints = np.radians([[20.0, -80, 100, -40, 0, 35]])
    pose = compute_flange_matrix(UR5E, joints[0])
    solutions = compute_solutions(cobot, pose[None, :3, :3], pose[None, :3, 3], joints[0])
    assert np.nanmin(measure_difference(solutions, joints[:, None])) < 1e-6
    assert np.nanmin(measure_singularity_distance(cobot, joints)[:, 2]) < 1e-9


def test_the_jacobian_loses_rank_at_singularities() -> None:
    """The least singular value of a numerical Jacobian is small there and not at regular values."""
    cobot = make_arm(UR5E)
    straight, elbow = np.radians([[10.0, -60, 90, -50, 0, 20], [10, -60, 0, -50, 60, 20]])
    ahead, over_axis_1 = np.radians([[10.0, 30, 90, -50, 60, 20], [10, -150, 90, -50, 60, 20]])
    assert _measure_wrist_x(ahead) * _measure_wrist_x(over_axis_1) < 0
    for _ in range(60):
        middle = (ahead + over_axis_1) / 2
        if _measure_wrist_x(middle) * _measure_wrist_x(ahead) > 0:
            ahead = middle
        else:
            over_axis_1 = middle
    for k, joints in ((2, straight), (1, elbow), (0, over_axis_1)):
        assert measure_singularity_distance(cobot, joints[None])[0, k] < 1e-6
        assert _find_least_singular_value(joints) < 1e-3
    regular = np.radians([10.0, -60, 90, -50, 60, 20])
    assert measure_singularity_distance(cobot, regular[None]).min() > math.radians(10)
    assert _find_least_singular_value(regular) > 0.05


def _measure_wrist_x(joints: FloatArray) -> float:
    """x of the point where axes 5 and 6 meet, in the frame that rotates with axis 1, mm."""
    pose = compute_flange_matrix(UR5E, joints)
    wrist = pose[:3, 3] - UR5E[0][5] * pose[:3, 2]
    return float(wrist[:2] @ [math.cos(joints[0]), math.sin(joints[0])])


def _find_least_singular_value(joints: FloatArray) -> float:
    """The least singular value of a Jacobian by differences, lengths in units of 500 mm."""
    step = 1e-6
    rows = []
    for k in range(6):
        low, high = (
            compute_flange_matrix(UR5E, joints + sign * step * (np.arange(6) == k))
            for sign in (-1, 1)
        )
        rotation_rate = (
            (high[:3, :3] - low[:3, :3])
            @ compute_flange_matrix(UR5E, joints)[:3, :3].T
            / (2 * step)
        )
        translation_rate = (high[:3, 3] - low[:3, 3]) / (2 * step) / 500
        rows.append(
            [*translation_rate, rotation_rate[2, 1], rotation_rate[0, 2], rotation_rate[1, 0]]
        )
    return float(np.linalg.svd(np.array(rows), compute_uv=False)[-1])


def test_a_pose_out_of_reach_is_named_with_its_shortfall() -> None:
    cobot = make_arm(UR5E)
    joints = np.radians([0.0, -90, 0, 0, 90, 0])
    pose = compute_flange_matrix(UR5E, joints)
    rotations = np.repeat(pose[None, :3, :3], 2, axis=0)
    origins = pose[:3, 3] + np.array([[0, 0, -100.0], [0, 0, 500.0]])
    stuck = follow(cobot, (rotations, origins), joints, 0.0)
    assert isinstance(stuck, Stuck)
    reason = explain_stuck(cobot, rotations, origins, stuck)
    assert isinstance(reason, Reason)
    assert reason.kind == "reach"
    assert 300 < float(reason.text.removeprefix("out of reach by ").removesuffix(" mm")) <= 500


def test_a_chain_whose_axes_4_and_5_do_not_meet_is_not_recognised() -> None:
    cobot = make_arm(UR5E)
    joints = list(cobot.joints)
    shifted = Pose(joints[4].previous_from_joint.rotation, (0.5, -133.3, 0.0))
    joints[4] = replace(joints[4], previous_from_joint=shifted)
    assert recognise_arm(tuple(joints), cobot.flange) is None
