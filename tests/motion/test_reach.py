"""Motions of a robot along edges, and reasons for refusals, checked by textbook kinematics."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import NDArray

from camgen.model.part import Edge
from camgen.model.pose import FloatArray, Pose, pose_from_values, translation
from camgen.motion.pose_paths import PosePath, cut
from camgen.motion.setup import EdgeMotion, OrientationFreedom, Setup, UnreachableEdge
from camgen.plan.edges.last_face import TOP as UPPER
from camgen.plan.edges.poses import make_poses
from camgen.read.solid import mesh
from camgen.robots.catalogue import find_robot
from camgen.robots.kinematics.forward import compute_flange
from camgen.robots.kinematics.joint_limits import are_within_limits
from tests.support.arm_models import by_hand
from tests.support.edge_shapes import reach, rim, straight
from tests.support.files import source

PARTS = Path(__file__).parents[2] / "fixtures" / "parts"
ARM = find_robot("IRB 2400")
TOOL = pose_from_values((-60, 0, 240, 0, -45, 0))
CELL = Setup(ARM, pose_from_values((900, -50, 600, 0, 0, 30)), TOOL)
TOP = straight((0, 0, 50), (120, 0, 50), (0, 0, 1), (0, -1, 0))
NONE, BOTH = OrientationFreedom(), OrientationFreedom(math.radians(20), roll=True)


def make_matrix(pose: Pose) -> FloatArray:
    """A pose as a homogeneous matrix (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = pose.rotation, pose.origin
    return matrix


def compute_tcp(cell: Setup, joints: FloatArray) -> FloatArray:
    """work_from_tcp (N, 4, 4) at joint values (N, J), by textbook matrices."""
    rows = [
        by_hand(cell.robot.name, np.degrees(q)) @ make_matrix(cell.flange_from_tool) for q in joints
    ]
    return np.linalg.inv(make_matrix(cell.base_from_work)) @ np.array(rows)


def expect_motion(cell: Setup, edge: Edge, freedom: OrientationFreedom = NONE) -> EdgeMotion:
    (result,) = reach([edge], cell, 5.0, "mean", freedom)
    assert isinstance(result, EdgeMotion), result
    return result


def expect_refusal(cell: Setup, edge: Edge, freedom: OrientationFreedom = NONE) -> UnreachableEdge:
    (result,) = reach([edge], cell, 5.0, "mean", freedom)
    assert isinstance(result, UnreachableEdge)
    return result


def check_edge_motion(cell: Setup, motion: EdgeMotion) -> FloatArray:
    """Check joint values against the pose path, the limits and continuity.

    Returns the frames of the TCP (N, 4, 4) at the dense joint values.
    """
    for frame, position, rotation in zip(
        compute_tcp(cell, motion.joints),
        motion.pose_path.position,
        motion.pose_path.rotation,
        strict=True,
    ):
        assert np.allclose(frame[:3, 3], position, atol=1e-6)
        assert np.allclose(frame[:3, :3], rotation, atol=1e-9)
    assert np.array_equal(motion.sampled_joints[motion.at], motion.joints)
    assert are_within_limits(cell.robot, motion.sampled_joints).all()
    assert np.abs(np.diff(motion.sampled_joints, axis=0)).max() <= math.radians(15) + 1e-9
    dense = compute_tcp(cell, motion.sampled_joints)
    assert np.linalg.norm(np.diff(dense[:, :3, 3], axis=0), axis=1).max() <= 5 + 1e-6
    assert cell.clear(motion.sampled_joints).all()
    return dense


def find_nominal_rotation(edge: Edge) -> FloatArray:
    """The nominal orientation (3, 3) of the tool at the start of an edge, in the work frame."""
    poses = make_poses(edge, 5.0)
    assert isinstance(poses, PosePath)
    return poses.rotation[0]


def test_a_straight_edge_has_two_poses_and_one_orientation() -> None:
    motion = expect_motion(CELL, TOP)
    assert len(motion.pose_path) == 2
    dense = check_edge_motion(CELL, motion)
    h = 5 / math.sqrt(2)
    assert np.allclose(dense[:, 1:3, 3], [-h, 50 + h], atol=1e-6)
    assert np.allclose(dense[[0, -1], 0, 3], [0, 120], atol=1e-6)
    assert (np.diff(dense[:, 0, 3]) > 0).all()
    assert np.allclose(dense[:, :3, :3], find_nominal_rotation(TOP), atol=1e-9)


def test_freedom_is_not_used_if_the_nominal_orientation_is_possible() -> None:
    nominal, with_freedom = expect_motion(CELL, TOP), expect_motion(CELL, TOP, BOTH)
    assert with_freedom.freed is None
    assert np.array_equal(nominal.sampled_joints, with_freedom.sampled_joints)


def test_a_reversed_motion_has_the_joint_values_in_reverse_order() -> None:
    motion = expect_motion(CELL, rim((60, 60, 40), 40, outer=True))
    backward = motion.reversed()
    assert (motion.backwards, backward.backwards) == (False, True)
    assert np.array_equal(backward.sampled_joints, motion.sampled_joints[::-1])
    check_edge_motion(CELL, backward)
    assert np.array_equal(backward.reversed().at, motion.at)


def test_an_edge_out_of_reach_is_refused_with_its_shortfall_in_mm() -> None:
    # The tool points straight down along the flange axis: the wrist is 85 + 240 mm above the TCP.
    cell = Setup(ARM, translation(2500, 0, 0), translation(0, 0, 240))
    (refusal,) = reach([straight((0, 0, 0), (50, 0, 0), (0, 0, 1), (0, -1, 0))], cell, 5.0, UPPER)
    assert isinstance(refusal, UnreachableEdge)
    # Axis 2 of the IRB 2400 is at x = 100, z = 615; its upper arm has 705, its forearm 755 and 135.
    wrist = math.hypot(2500 - 100, 5 + 240 + 85 - 615)
    shortfall = wrist - 705 - math.hypot(755, 135)
    assert refusal.kind == "reach"
    stated = re.fullmatch(r"out of reach by ([0-9.]+) mm, 0 mm along it", refusal.text)
    assert stated
    assert float(stated[1]) == pytest.approx(shortfall, abs=1e-3)


def make_cell_through(joints: list[float], half_length: float) -> tuple[Setup, Edge]:
    """A cell and an edge along tool y; its nominal pose in the middle is that of `joints`, deg.

    half_length: half the length of the edge, mm.
    """
    frame = by_hand(ARM.name, joints) @ make_matrix(TOOL)
    z, y, middle = frame[:3, 2], frame[:3, 1], frame[:3, 3] + 5 * frame[:3, 2]
    cell = Setup(ARM, translation(0, 0, 0), TOOL)
    return cell, straight(middle - half_length * y, middle + half_length * y, -z, -z)


def test_an_edge_through_a_straight_wrist_is_refused_as_singular() -> None:
    cell, edge = make_cell_through([0, 10, 20, 0, 0, 0], 30)
    refusal = expect_refusal(cell, edge)
    assert refusal.kind == "singular"
    assert "wrist straight" in refusal.text


def test_with_freedom_an_edge_is_run_past_a_singularity() -> None:
    cell, edge = make_cell_through([0, 10, 20, 0, 0, 0], 30)
    motion = expect_motion(cell, edge, BOTH)
    check_edge_motion(cell, motion)
    assert motion.freed
    assert np.abs(motion.sampled_joints[:, 4]).min() >= math.radians(2)


def test_a_limit_is_named_with_its_amount() -> None:
    # The nominal pose needs axis 5 at 125 or -125 deg, its limits are +-120 deg. No other branch
    # reaches the edge.
    cell, edge = make_cell_through([0, 0, 0, 0, 125, 0], 1)
    refusal = expect_refusal(cell, edge)
    assert refusal.kind == "limit"
    stated = re.match(r"axis 5 is beyond its limit by ([0-9.]+) deg, 0 mm along it$", refusal.text)
    assert stated
    assert float(stated[1]) == pytest.approx(5, abs=0.2)


def require_tilt(cell: Setup, axis: FloatArray, minimum: float) -> Setup:
    """The cell with an obstacle: the tool has to tilt `minimum` deg or more from `axis`.

    axis: unit vector (3,) in the work frame.
    """

    def clear(joints: FloatArray) -> NDArray[np.bool_]:
        z = cell.base_from_work.rotation.T @ compute_flange(ARM, joints)[0] @ TOOL.rotation[:, 2]
        return np.asarray(z @ axis <= math.cos(math.radians(minimum)))

    return replace(cell, clear=clear, hit=lambda _: "the holder with the part")


def test_a_collision_is_avoided_by_the_smallest_sufficient_tilt() -> None:
    axis = find_nominal_rotation(TOP)[:, 2]
    cell = require_tilt(CELL, axis, 8)
    assert expect_refusal(cell, TOP) == UnreachableEdge(
        "e1", "collision", "collision, the holder with the part, 0 mm along it"
    )
    motion = expect_motion(cell, TOP, OrientationFreedom(math.radians(20)))
    check_edge_motion(cell, motion)
    assert motion.freed
    assert motion.freed[0] == pytest.approx(10)  # tilts of 10 and 20 deg are tried
    assert motion.freed[1] == pytest.approx(0, abs=1e-9)
    assert len(motion.pose_path) == 2
    dense = compute_tcp(cell, motion.sampled_joints)
    assert np.allclose(np.degrees(np.arccos(dense[:, :3, 2] @ axis)), 10)
    assert np.allclose(np.degrees(motion.tilt), 10)


def test_a_collision_that_no_tilt_avoids_is_refused_with_both_reasons() -> None:
    cell = require_tilt(CELL, find_nominal_rotation(TOP)[:, 2], 25)
    text = expect_refusal(cell, TOP, BOTH).text
    reason = "collision, the holder with the part"
    assert text == f"{reason}, 0 mm along it; with 20 deg of tilt and any roll: {reason}"


def test_a_roll_is_preferred_to_a_tilt() -> None:
    frame = find_nominal_rotation(TOP)

    def clear(joints: FloatArray) -> NDArray[np.bool_]:
        x = CELL.base_from_work.rotation.T @ compute_flange(ARM, joints)[0] @ TOOL.rotation[:, 0]
        return np.asarray(x @ frame[:, 0] <= math.cos(math.radians(20)))

    cell = replace(CELL, clear=clear)
    motion = expect_motion(cell, TOP, BOTH)
    check_edge_motion(cell, motion)
    assert motion.freed == pytest.approx((0, 30), abs=1e-6)


def test_another_branch_is_preferred_to_any_freedom() -> None:
    first = expect_motion(CELL, TOP)
    sign = math.copysign(1, first.joints[0, 4])
    cell = replace(CELL, clear=lambda joints: np.asarray(joints[:, 4] * sign < 0))
    motion = expect_motion(cell, TOP, BOTH)
    check_edge_motion(cell, motion)
    assert motion.freed is None
    # The result without freedom is equal, since the nominal orientation is enough.
    assert np.array_equal(expect_motion(cell, TOP).sampled_joints, motion.sampled_joints)


def test_an_obstacle_half_way_is_avoided_by_a_tilt_at_the_obstacle_only() -> None:
    axis = find_nominal_rotation(TOP)[:, 2]

    def clear(joints: FloatArray) -> NDArray[np.bool_]:
        frames = compute_tcp(CELL, joints)
        at_obstacle = np.abs(frames[:, 0, 3] - 60) < 15
        return np.asarray(~at_obstacle | (frames[:, :3, 2] @ axis <= math.cos(math.radians(5))))

    cell = replace(CELL, clear=clear)
    assert expect_refusal(cell, TOP).text == "collision, something, 50 mm along it"
    motion = expect_motion(cell, TOP, OrientationFreedom(math.radians(20)))
    dense = check_edge_motion(cell, motion)
    assert np.allclose(dense[:, 1:3, 3], [-5 / math.sqrt(2), 50 + 5 / math.sqrt(2)], atol=1e-6)
    assert np.degrees(motion.tilt).max() == pytest.approx(10, abs=0.01)
    assert np.allclose(motion.tilt[[0, -1]], 0, atol=1e-9)
    assert len(motion.pose_path) == 4  # 120 mm in stretches of 40: nominal, tilted, tilted, nominal


@pytest.mark.parametrize("name", ["e6", "e11"])
def test_a_rim_that_no_wrist_can_follow_is_run_by_rolling_along_it(name: str) -> None:
    solid = mesh.read(source(PARTS / "rfa2.stl"))
    edge = next(e for e in solid.edges if e.id == name)
    arm = find_robot("IRB 2000")
    cell = Setup(
        arm, pose_from_values((1050, -50, 500, 0, 0, 45)), pose_from_values((60, 0, 240, 0, 45, 0))
    )
    assert expect_refusal(cell, edge).kind in ("limit", "jump", "singular")
    motion = expect_motion(cell, edge, OrientationFreedom(roll=True))
    dense = check_edge_motion(cell, motion)
    assert motion.freed
    assert (
        motion.freed[0] < 2
    )  # deg: poses are 30 deg apart, and the axis between two leaves its cone
    assert len(motion.pose_path) <= 13
    # The TCP stays on a circle around the bore of radius 20, which is perpendicular to its face.
    # Half of the offset direction is along the axis of the bore and half towards it.
    middle = edge.points[:2].mean(axis=0)
    axis = edge.normals[0, 1] + edge.normals[1, 1]
    axis /= np.linalg.norm(axis)
    from_middle = dense[:, :3, 3] - middle
    assert np.allclose(from_middle @ axis, 5 / math.sqrt(2), atol=0.02)
    radius = np.linalg.norm(from_middle - np.outer(from_middle @ axis, axis), axis=1)
    assert np.allclose(radius, 20 - 5 / math.sqrt(2), atol=0.02)


def test_an_arm_without_a_closed_form_uses_freedom() -> None:
    arm = find_robot("COBOTTA")
    edge = straight((-15, 0, 0), (15, 0, 0), (0, 0, 1), (0, -1, 0))
    cell = Setup(arm, translation(200, 60, 100), translation(0, 0, 60))
    nominal = expect_motion(cell, edge)
    axis = find_nominal_rotation(edge)[:, 2]

    def clear(joints: FloatArray) -> NDArray[np.bool_]:
        return np.asarray(
            compute_flange(arm, joints)[0][:, :, 2] @ axis <= math.cos(math.radians(5))
        )

    motion = expect_motion(replace(cell, clear=clear), edge, OrientationFreedom(math.radians(10)))
    assert nominal.freed is None
    assert motion.freed == pytest.approx((5, 0), abs=1e-6) or motion.freed == pytest.approx(
        (10, 0), abs=1e-6
    )
    rotations, origins = compute_flange(arm, motion.sampled_joints)
    line = origins + rotations @ [0, 0, 60] - [200, 60, 100]
    assert np.allclose(line[:, 1:], [-5 / math.sqrt(2), 5 / math.sqrt(2)], atol=1e-6)
    assert clear(motion.sampled_joints).all()


@pytest.mark.parametrize("name", ["IRB 2400", "COBOTTA", "Cobra s600", "3-axis mill"])
def test_an_edge_far_away_is_refused_with_any_freedom(name: str) -> None:
    cell = Setup(find_robot(name), translation(90_000, 0, 0), translation(0, 0, 100))
    refusal = expect_refusal(cell, TOP, BOTH)
    assert refusal.kind in ("reach", "lean", "limit")
    assert refusal.text.endswith("; with 20 deg of tilt and any roll: no way either")


def test_a_scara_runs_an_edge_from_above_but_cannot_tilt_its_tool() -> None:
    cell = Setup(find_robot("Cobra s600"), translation(350, 100, 100), translation(0, 0, 60))
    burr, mean = (reach([TOP], cell, 5.0, direction)[0] for direction in (UPPER, "mean"))
    assert isinstance(burr, EdgeMotion)
    rotations, origins = compute_flange(cell.robot, burr.joints)
    assert np.allclose(origins + rotations @ [0, 0, 60], [[350, 100, 155], [470, 100, 155]])
    assert isinstance(mean, UnreachableEdge)
    assert (mean.kind, mean.text) == (
        "lean",
        "the robot cannot lean its tool by 45 deg, 0 mm along it",
    )


# Pieces of pose paths.


@pytest.mark.parametrize(("low", "high"), [(0.0, 30.0), (10.0, 55.0), (25.0, 26.0), (12.0, 71.4)])
def test_a_piece_of_a_pose_path_is_the_same_motion(low: float, high: float) -> None:
    """A line of 20 mm and a quarter circle of radius 30 mm are cut.

    Positions, length and rotation of the piece are computed by hand.
    """
    quarter = 30 * math.pi / 2
    rotations = [np.eye(3), np.eye(3), np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])]
    via = [
        (math.nan,) * 3,
        (math.nan,) * 3,
        (20 + 30 * math.sin(math.pi / 4), 30 - 30 * math.cos(math.pi / 4), 0),
    ]
    path = PosePath(
        np.array([(0.0, 0, 0), (20, 0, 0), (50, 30, 0)]), np.array(via), np.array(rotations)
    )
    high = min(high, 20 + quarter)
    piece = cut(path, low, high)
    assert piece.length.sum() == pytest.approx(high - low)

    def compute_place(s: float) -> tuple[FloatArray, float]:
        """Position and rotation about z, rad, at s mm along the path."""
        if s <= 20:
            return np.array([s, 0, 0]), 0.0
        angle = (s - 20) / 30
        return np.array([20 + 30 * math.sin(angle), 30 - 30 * math.cos(angle), 0]), angle

    for k, s in ((0, low), (-1, high)):
        place, angle = compute_place(s)
        assert piece.position[k] == pytest.approx(place, abs=1e-9)
        assert math.atan2(piece.rotation[k, 1, 0], piece.rotation[k, 0, 0]) == pytest.approx(
            angle, abs=1e-9
        )
    if high > 20:
        assert piece.via[-1] == pytest.approx(compute_place((max(low, 20) + high) / 2)[0], abs=1e-9)
    assert np.isnan(piece.via[0]).all()
