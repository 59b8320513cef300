import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from camgen.model.pose import Pose, frozen, rotation_about, rotation_from_fixed_xyz, translation
from camgen.robots.catalogue import find_robot, list_robots
from camgen.robots.chain import Joint
from camgen.robots.kinematics.arms import Spherical, recognise_arm
from camgen.robots.kinematics.continuity import Choice, Stuck, follow
from camgen.robots.kinematics.forward import compute_flange, compute_link_frames, compute_velocities
from camgen.robots.kinematics.inverse import compute_solutions, find_nearest
from camgen.robots.kinematics.joint_limits import are_within_limits, compute_theta, list_turn_counts
from camgen.robots.kinematics.reasons import Reason, explain_stuck
from camgen.robots.kinematics.singular import measure_singularity_distance
from camgen.robots.kinematics.spherical import find_branch, measure_shortfall
from camgen.robots.models import Robot
from tests.support.arm_models import ARMS, by_hand
from tests.support.turned import add_turns

IRB_120 = find_robot("IRB 120")
IRB_2400 = find_robot("IRB 2400")
COBRA = find_robot("Cobra s600")
VS_6556 = find_robot("VS-6556")
DOWN = frozen(np.diag([1.0, -1.0, -1.0]))
CLOSED_FORM_ROBOTS = [robot for robot in list_robots() if robot.arm]
SPHERICAL_WRIST_ROBOTS = [find_robot(name) for name in ARMS]


def measure_errors(
    robot: Robot, solutions: np.ndarray, rotations: np.ndarray, origins: np.ndarray
) -> tuple[float, float]:
    """Largest deviation, mm and rad, of solutions (N, B, J) from the flange poses that they solve.

    rotations (N, 3, 3), origins (N, 3): base_from_flange. Solutions that are nan are left out.
    """
    count, columns, _ = solutions.shape
    flat = solutions.reshape(count * columns, -1)
    is_solution = np.isfinite(flat).all(axis=1)
    reached_rotations, reached_origins = compute_flange(robot, flat[is_solution])
    expected = np.repeat(rotations, columns, axis=0)[is_solution]
    remaining = reached_rotations.transpose(0, 2, 1) @ expected
    if robot.kind == "cartesian":  # rotation about the spindle is free
        angle = np.linalg.norm(remaining[:, :2, 2], axis=1)
    else:
        angle = np.linalg.norm(remaining - np.eye(3), axis=(1, 2))
    distance = np.linalg.norm(
        reached_origins - np.repeat(origins, columns, axis=0)[is_solution], axis=1
    )
    return float(distance.max()), float(angle.max())


def solve_at(robot: Robot, joints: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Solutions (N, B, J) of the flange poses at joint values (N, J), and these poses."""
    rotations, origins = compute_flange(robot, joints)
    return compute_solutions(robot, rotations, origins), rotations, origins


def measure_difference(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The largest difference of two sets of joint values (..., J), regardless of whole turns."""
    return np.abs(np.remainder(a - b + math.pi, math.tau) - math.pi).max(axis=-1)


@st.composite
def draw_joint_values(draw: st.DrawFn, robot: Robot) -> np.ndarray:
    """Joint values (J,) within the limits.

    Multiples of 15 deg or 1 mm are drawn as often as others, so that some are singular.
    """
    values = []
    for (low, high), joint in zip(robot.limits.tolist(), robot.joints, strict=True):
        step = 1.0 if joint.sliding else math.pi / 12
        round_values = st.integers(math.ceil(low / step), math.floor(high / step)).map(
            lambda n, size=step: n * size
        )
        values.append(draw(st.one_of(st.floats(low, high), round_values)))
    return np.array(values)


@pytest.mark.parametrize("robot", CLOSED_FORM_ROBOTS, ids=lambda robot: robot.name)
@given(data=st.data())
def test_the_inverse_kinematics_finds_the_joint_values_of_a_flange_pose(
    robot: Robot, data: st.DataObject
) -> None:
    joints = data.draw(draw_joint_values(robot))
    rotations, origins = compute_flange(robot, joints[None])
    solutions = compute_solutions(robot, rotations, origins, joints)
    mm, rad = measure_errors(robot, solutions, rotations, origins)
    assert mm < 1e-6
    assert rad < 1e-9
    if (
        are_within_limits(robot, joints)
        and measure_singularity_distance(robot, joints).min(initial=1.0) > 1e-4
    ):
        turned = add_turns(robot, solutions).reshape(-1, len(joints))
        assert np.nanmin(np.abs(turned - joints).max(axis=1)) < 1e-6


@pytest.mark.parametrize("robot", SPHERICAL_WRIST_ROBOTS, ids=lambda robot: robot.name)
def test_a_spherical_wrist_has_four_or_eight_solutions_each_on_its_branch(robot: Robot) -> None:
    rng = np.random.default_rng(5)
    joints = rng.uniform(robot.limits[:, 0], robot.limits[:, 1], (500, 6))
    solutions = solve_at(robot, joints)[0]
    is_solution = np.isfinite(solutions[:, :, 0])
    assert set(is_solution.sum(axis=1).tolist()) <= {4, 8}
    assert isinstance(robot.arm, Spherical)
    branches = find_branch(robot.arm, compute_theta(robot, robot.arm, solutions))
    assert (
        branches[is_solution] == np.broadcast_to(np.arange(8), branches.shape)[is_solution]
    ).all()
    # Solutions on different branches have different joint values, except at a singularity.
    differences = measure_difference(solutions[:, :, None], solutions[:, None]) + 10 * np.eye(8)
    is_regular = np.nanmin(measure_singularity_distance(robot, solutions), axis=(1, 2)) > 0.01
    assert is_regular.sum() > 300
    assert np.nanmin(differences[is_regular]) > 1e-3


def test_solutions_reach_the_pose_of_the_denavit_hartenberg_table() -> None:
    """The forward kinematics here is a table of Denavit and Hartenberg, not that of camgen."""
    for name in ARMS:
        robot = find_robot(name)
        expected = by_hand(name, [20, 15, 25, -40, 50, 60])
        branches = compute_solutions(robot, expected[None, :3, :3], expected[None, :3, 3])[0]
        solutions = branches[np.isfinite(branches).all(axis=1)]
        assert len(solutions)
        for solution in solutions:
            assert np.abs(by_hand(name, np.degrees(solution)) - expected).max() < 1e-9


def test_all_branches_agree_with_opw_kinematics() -> None:
    opw = pytest.importorskip(
        "py_opw_kinematics", reason="py-opw-kinematics, the oracle, is not installed"
    )
    transforms = pytest.importorskip("scipy.spatial.transform", reason="scipy is not installed")
    arm: dict[str, Any] = {"a1": 75, "a2": -90, "b": 0, "c1": 335, "c2": 270, "c3": 295, "c4": 80}
    other = opw.Robot(opw.KinematicModel(**arm), degrees=False)
    rng = np.random.default_rng(7)
    rotations, origins = compute_flange(
        VS_6556, rng.uniform(VS_6556.limits[:, 0], VS_6556.limits[:, 1], (300, 6))
    )
    poses = transforms.RigidTransform.from_components(
        origins, transforms.Rotation.from_matrix(rotations)
    )
    other_solutions = np.asarray(other.reach(poses).joints)
    solutions = compute_solutions(VS_6556, rotations, origins)
    for row in range(len(solutions)):
        actual = solutions[row][np.isfinite(solutions[row, :, 0])]
        expected = other_solutions[row][np.isfinite(other_solutions[row, :, 0])]
        assert len(actual) == len(expected)
        assert measure_difference(actual[:, None], expected[None]).min(axis=1).max() < 1e-6


def test_a_straight_wrist_keeps_the_given_value_of_axis_4() -> None:
    robot = find_robot("IRB 1200")
    joints = np.radians([10, 20, -30, 70, 0, 15])
    rotations, origins = compute_flange(robot, joints[None])
    kept = compute_solutions(robot, rotations, origins, joints)
    assert measure_difference(kept[0], joints).min() < 1e-9
    alone = compute_solutions(robot, rotations, origins)
    assert np.isfinite(alone).all()
    assert np.degrees(alone[0, 0, [3, 5]]) == pytest.approx([0, 85])  # 70 + 15 about the same axis


def test_a_wrist_above_axis_1_keeps_the_given_value_of_axis_1() -> None:
    origins = np.array([[0.0, 0, 700]])  # the flange points down, 72 mm below the wrist centre
    kept = compute_solutions(IRB_120, DOWN[None], origins, np.radians([33, 0, 0, 0, 0, 0]))
    assert np.degrees(kept[0, :, 0]) == pytest.approx([33] * 8)
    alone = compute_solutions(IRB_120, DOWN[None], origins)
    assert np.abs(np.degrees(alone[0, :, 0])) == pytest.approx([0] * 4 + [180] * 4)
    for solutions in (kept, alone):
        assert max(measure_errors(IRB_120, solutions, DOWN[None], origins)) < 1e-9


@pytest.mark.parametrize("angle", [10.0**-n for n in range(2, 14)])
def test_solutions_of_a_nearly_straight_wrist_are_exact(angle: float) -> None:
    robot = find_robot("VS-060")
    solutions, *poses = solve_at(robot, np.radians([[10, 20, 30, 70, angle, 15]]))
    assert np.isfinite(solutions).all()
    mm, rad = measure_errors(robot, solutions, *poses)
    assert mm < 1e-6
    assert rad < 1e-9


def test_the_shortfall_of_a_pose_out_of_reach_is_measured_in_mm() -> None:
    """Axis 2 of the IRB 120 is at 290 mm, and the flange that points down is 72 mm below the wrist.

    The upper arm is 270 mm long, the forearm hypot(302, 70) mm.
    """
    assert isinstance(IRB_120.arm, Spherical)
    reach = 270 + math.hypot(302, 70)
    origins = np.array([[reach - 0.001, 0, 290 - 72], [0, reach + 0.25, 290 - 72]])
    rotations = np.stack([DOWN, DOWN])
    solutions = compute_solutions(IRB_120, rotations, origins)
    assert np.isfinite(solutions[0]).all()
    assert np.isnan(solutions[1]).all()
    assert measure_shortfall(IRB_120.arm, rotations, origins) == pytest.approx([0, 0.25], abs=1e-9)


def test_whole_turns_are_added_within_the_limits() -> None:
    # axis 1 +-180, axis 4 +-200, axis 6 +-400
    rows = add_turns(IRB_2400, np.radians([[10, 0, 0, 170, 30, 20]]))[0]
    copies = np.degrees(rows[np.isfinite(rows[:, 0])])
    assert sorted(np.round(copies[:, [0, 3, 5]]).tolist()) == [
        [10, -190, -340], [10, -190, 20], [10, -190, 380],
        [10, 170, -340], [10, 170, 20], [10, 170, 380],
    ]  # fmt: skip
    assert len(list_turn_counts(find_robot("IRB 120"))) == 3
    assert len(list_turn_counts(find_robot("3-axis mill"))) == 1


def test_an_arm_is_recognised_by_its_axes_alone() -> None:
    """The VS-6556 with axes 1, 3, 4 and 6 reversed, laid on its side and with an oblique flange."""
    lying = Pose(rotation_from_fixed_xyz(0.3, -1.2, 2.0), (100.0, -50, 30))
    signs = [-1, 1, -1, -1, 1, -1]
    joints = []
    for joint, sign in zip(VS_6556.joints, signs, strict=True):
        x, y, z = joint.axis
        axis = (sign * x, sign * y, sign * z)
        joints.append(Joint(joint.name, False, joint.previous_from_joint, axis))
    joints[0] = replace(joints[0], previous_from_joint=lying @ joints[0].previous_from_joint)
    crooked = Pose(rotation_from_fixed_xyz(0.1, 0.2, 0.3), (5.0, 6, 70))
    arm = recognise_arm(tuple(joints), crooked)
    assert isinstance(arm, Spherical)
    assert (arm.a1, arm.a2, arm.b, arm.c2, arm.c3) == pytest.approx(
        (75, -90, 0, 270, 295), abs=1e-9
    )
    other = replace(VS_6556, joints=tuple(joints), flange=crooked, arm=arm)
    values = np.radians([[10, 20, 30, 40, 50, 60], [-100, -30, 80, 100, -70, -20]])
    solutions, *poses = solve_at(other, values)
    assert max(measure_errors(other, solutions, *poses)) < 1e-9
    assert measure_difference(solutions, values[:, None]).min(axis=1).max() < 1e-9


def test_the_sign_of_an_axis_does_not_change_the_order_of_the_branches() -> None:
    signs = np.array([-1, -1, 1, -1, -1, -1])
    joints = []
    for joint, sign in zip(VS_6556.joints, signs.tolist(), strict=True):
        joints.append(replace(joint, axis=tuple(sign * part for part in joint.axis)))
    other = replace(
        VS_6556, joints=tuple(joints), limits=frozen(np.tile([-math.pi, math.pi], (6, 1)))
    )
    other = replace(other, arm=recognise_arm(other.joints, VS_6556.flange))
    rotations, origins = compute_flange(
        VS_6556, np.radians([[10, 20, 30, 40, 50, 60], [-100, -30, 80, 100, -70, -20]])
    )
    reversed_solutions = compute_solutions(other, rotations, origins) * signs
    solutions = compute_solutions(VS_6556, rotations, origins)
    assert (np.isnan(reversed_solutions) == np.isnan(solutions)).all()
    assert np.nanmax(measure_difference(reversed_solutions, solutions)) < 1e-9


def test_oblique_slides_and_a_flange_off_the_last_axis_are_solved() -> None:
    mill, cobra = find_robot("mill"), find_robot("Cobra s600")
    oblique = Pose(rotation_from_fixed_xyz(0.2, -0.3, 0.4), (10.0, 20, 30))
    slides = tuple(replace(joint, previous_from_joint=oblique) for joint in mill.joints)
    crooked = replace(mill, joints=slides, arm=recognise_arm(slides, mill.flange))
    shifted_flange = Pose(cobra.flange.rotation @ rotation_about(2, 0.7), (30.0, -20, -40))
    offset = replace(cobra, flange=shifted_flange, arm=recognise_arm(cobra.joints, shifted_flange))
    for robot, joints in ((crooked, [100.0, 200, -300]), (offset, [0.3, -0.9, 120, 1.2])):
        solutions, *poses = solve_at(robot, np.array([joints]))
        assert np.isfinite(solutions).all()
        assert max(measure_errors(robot, solutions, *poses)) < 1e-9
        assert np.abs(solutions[0] - joints).max(axis=1).min() < 1e-9
    # Each slide moves along an axis of a frame that the previous joint has rotated. The first two
    # of the three are computed by hand.
    rotation, origin = oblique.rotation, np.array(oblique.origin)
    expected = (
        origin
        + rotation @ np.array([100.0, 0, 0])
        + rotation @ (origin + rotation @ np.array([0, 200.0, 0]))
    )
    assert compute_link_frames(crooked, np.array([[100.0, 200, -300]]))[1][0, 2] == pytest.approx(
        expected
    )


@pytest.mark.parametrize(
    ("index", "change", "is_recognised"),
    [
        # Axis 2 is shifted along itself. It stays the same axis, and the arm has a side offset.
        (1, translation(75, 40, 132), True),
        (4, translation(2, 0, 187), False),  # axis 5 does not meet axis 4
        (5, translation(0, 5, 80), False),  # axis 6 does not meet axis 5
        # Axis 6 meets axis 5 and is not perpendicular to it.
        (5, Pose(rotation_about(0, 0.1), (0.0, 0, 80)), False),
        # Axis 3 is not parallel to axis 2.
        (2, Pose(rotation_about(2, 0.01), (0.0, 0, 270)), False),
    ],
)
def test_only_a_spherical_wrist_is_recognised_as_one(
    index: int, change: Pose, is_recognised: bool
) -> None:
    joints = list(VS_6556.joints)
    joints[index] = replace(joints[index], previous_from_joint=change)
    assert (recognise_arm(tuple(joints), VS_6556.flange) is not None) == is_recognised


def test_the_closed_form_includes_a_side_offset() -> None:
    robot = find_robot("VS-060")
    joints = list(robot.joints)
    joints[3] = replace(joints[3], previous_from_joint=translation(-10, 25, 164.5))
    other = replace(robot, joints=tuple(joints), arm=recognise_arm(tuple(joints), robot.flange))
    values = np.radians([[10, 20, 60, 40, 50, 60]])
    solutions, *poses = solve_at(other, values)
    assert np.isfinite(solutions).all()
    assert max(measure_errors(other, solutions, *poses)) < 1e-9
    assert measure_difference(solutions[0], values[0]).min() < 1e-9


def test_a_scara_and_a_mill_cannot_reach_a_pose_with_a_tilted_tool() -> None:
    lean = (DOWN @ rotation_about(0, 0.01))[None]
    for name, position in (("Cobra s600", (400, 0, 200)), ("mill", (400, 250, -100))):
        assert np.isnan(
            compute_solutions(find_robot(name), lean, np.array([position], dtype=float))
        ).all()
        assert np.isfinite(
            compute_solutions(find_robot(name), DOWN[None], np.array([position], dtype=float))
        ).all()


def test_the_cobotta_is_solved_by_iteration() -> None:
    robot = find_robot("COBOTTA")
    rng = np.random.default_rng(2)
    joints = rng.uniform(robot.limits[:, 0] * 0.9, robot.limits[:, 1] * 0.9, (100, 6))
    solutions, *poses = solve_at(robot, joints)
    mm, rad = measure_errors(robot, solutions, *poses)
    assert mm < 1e-6
    assert rad < 1e-9
    assert (np.nanmin(measure_difference(solutions, joints[:, None]), axis=1) < 1e-6).sum() >= 99
    differences = measure_difference(solutions[:, :, None], solutions[:, None]) + 10 * np.eye(
        solutions.shape[1]
    )
    assert np.nanmin(differences) > 1e-6


def follow_checked(
    robot: Robot, origins: np.ndarray, rotations: np.ndarray, bound: float = 30, **options: Any
) -> Choice:
    """Follow a path; check that the joint values are on it, within the limits and without a jump.

    bound: the largest change of a revolute joint between two poses, deg.
    """
    choice = follow(robot, (rotations, origins), **options)
    assert isinstance(choice, Choice), explain_stuck(robot, rotations, origins, choice).text
    assert max(measure_errors(robot, choice.joints[:, None], rotations, origins)) < 1e-6
    assert are_within_limits(robot, choice.joints).all()
    turning = [not joint.sliding for joint in robot.joints]
    assert np.abs(np.diff(choice.joints, axis=0))[:, turning].max(initial=0.0) < math.radians(bound)
    return choice


def find_reason(robot: Robot, origins: np.ndarray, rotations: np.ndarray, **options: Any) -> Reason:
    """The reason why a robot cannot follow a path."""
    stuck = follow(robot, (rotations, origins), **options)
    assert isinstance(stuck, Stuck)
    return explain_stuck(robot, rotations, origins, stuck, **options)


def make_circle(
    x: float, y: float, z: float, radius: float, count: int = 360
) -> tuple[np.ndarray, np.ndarray]:
    """Origins and rotations of a horizontal circle around (x, y, z), with the tool down."""
    angles = np.linspace(0, math.tau, count)
    origins = np.column_stack(
        [x + radius * np.cos(angles), y + radius * np.sin(angles), np.full(count, z)]
    )
    return origins, np.broadcast_to(DOWN, (count, 3, 3))


def make_spin(
    origin: tuple[float, float, float], degrees: float, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Origins and rotations of a tool that points down and rolls by `degrees` in one place."""
    rotations = [
        DOWN @ rotation_about(2, angle) for angle in np.radians(np.linspace(0, degrees, count))
    ]
    return np.tile(origin, (count, 1)), np.array(rotations)


@pytest.mark.parametrize(
    ("name", "x", "y", "z"),
    [("IRB 120", 350, 0, 300), ("IRB 1200", 500, 0, 300), ("IRB 2000", 900, 0, 700),
     ("IRB 2400", 900, 0, 700), ("VS-060", 350, 0, 300), ("VS-6556", 400, 0, 300),
     ("Viper s650", 400, 0, 300), ("Cobra s600", 400, 0, 200), ("COBOTTA", 200, 60, 150),
     ("3-axis mill", 400, 250, -100)],
)  # fmt: skip
def test_a_circle_is_followed_on_one_branch_to_its_first_joint_values(
    name: str, x: float, y: float, z: float
) -> None:
    robot = find_robot(name)
    choice = follow_checked(robot, *make_circle(x, y, z, 50, 60 if name == "COBOTTA" else 360))
    assert len(set(choice.branches.tolist())) == 1
    assert choice.joints[0] == pytest.approx(choice.joints[-1], abs=1e-7)


def test_axis_6_is_wound_back_before_it_is_needed() -> None:
    """Axis 6 of the IRB 2400 has +-400 deg, so a roll by 700 deg has to start near one end."""
    choice = follow_checked(IRB_2400, *make_spin((900, 0, 700), 700, 701))
    axis_6 = np.degrees(choice.joints[:, 5])
    assert abs(axis_6[-1] - axis_6[0]) == pytest.approx(700)
    assert abs(axis_6[0]) > 300


def test_the_limit_that_ends_a_path_is_named() -> None:
    """Axis 6 has 800 deg in all, and the tool points down, so that axis 6 follows its roll."""
    reason = find_reason(IRB_2400, *make_spin((900, 0, 700), 900, 901))
    assert (reason.kind, reason.text[:6]) == ("limit", "axis 6")
    assert 440 < reason.row <= 801
    beyond = reason.text.removeprefix("axis 6 is beyond its limit by ").removesuffix(" deg")
    assert float(beyond) <= 1.01


@pytest.mark.parametrize("limit", range(460, 541, 10))
def test_a_limit_of_axis_6_is_not_moved_by_whole_turns_of_axis_4(limit: float) -> None:
    """Axis 4 at 175 deg could also be at -185 deg, but axis 6 with +-`limit` deg gains nothing."""
    robot = find_robot("IRB 2400")
    limits = robot.limits.copy()
    limits[5] = np.radians([-limit, limit])
    robot = replace(robot, limits=frozen(limits))
    joints = np.radians([[0, 10, 10, 175, 40, axis_6] for axis_6 in range(0, 1800, 50)])
    rotations, origins = compute_flange(robot, joints)
    reason = find_reason(robot, origins, rotations, jump=math.radians(60))
    assert (reason.kind, reason.text[:6]) == ("limit", "axis 6")
    first = follow_checked(
        robot, origins[: reason.row], rotations[: reason.row], jump=math.radians(60), bound=60
    )
    assert np.abs(np.degrees(np.diff(first.joints[:, 5]))) == pytest.approx([50] * (reason.row - 1))


def test_the_branch_nearer_to_the_start_is_followed() -> None:
    origins, rotations = make_circle(400, 0, 200, 20, 60)
    for side, start in enumerate(compute_solutions(COBRA, rotations[:1], origins[:1])[0]):
        assert set(follow_checked(COBRA, origins, rotations, start=start).branches.tolist()) == {
            side
        }


def test_the_first_row_out_of_reach_is_named() -> None:
    origins = np.column_stack([np.arange(400, 700, 1.0), np.zeros(300), np.full(300, 290.0 - 72)])
    reason = find_reason(IRB_120, origins, np.broadcast_to(DOWN, (300, 3, 3)))
    # 270 + hypot(302, 70) = 580.0065
    assert (reason.row, reason.kind, reason.text) == (181, "reach", "out of reach by 0.994 mm")


def test_the_first_row_beyond_a_joint_limit_is_named() -> None:
    """On the far side of the IRB 120 axis 1 would be at 180 deg; its limit is 165 deg."""
    origins = make_circle(0, 0, 300, 400)[0][: 180 + 1]
    rotations = np.array(
        [rotation_about(2, angle) @ DOWN for angle in np.linspace(0, math.tau, 360)[:181]]
    )
    reason = find_reason(IRB_120, origins, rotations)
    assert (reason.kind, reason.text[:6]) == ("limit", "axis 1")
    assert reason.row == math.floor(165 / (360 / 359)) + 1


def make_wrist_swing(robot: Robot, tilt: float, count: int = 101) -> tuple[np.ndarray, np.ndarray]:
    """A path on which axis 5 goes from 20 to -20 deg, so that it passes the straight wrist.

    With `tilt`, rad, the tool is rotated about its x axis and the path misses the singularity.
    """
    axis_5 = np.linspace(20, -20, count)
    joints = np.radians([[0, 10, 20, 0, angle, 0] for angle in axis_5])
    rotations, origins = compute_flange(robot, joints)
    return origins, rotations @ rotation_about(0, tilt)


def test_a_path_through_a_straight_wrist_is_followed_without_a_flip() -> None:
    origins, rotations = make_wrist_swing(IRB_120, 0.0)
    choice = follow_checked(IRB_120, origins, rotations)
    assert np.degrees(choice.joints[:, 4]) == pytest.approx(np.linspace(20, -20, 101), abs=1e-6)
    assert np.abs(choice.joints[:, [3, 5]]).max() < 1e-6
    assert set(choice.branches.tolist()) == {0, 1}


def test_axis_4_of_a_straight_wrist_at_the_first_row_fits_the_next_row() -> None:
    joints = np.radians([[0, 10, 20, 60, angle, -10] for angle in np.linspace(0, 20, 21)])
    rotations, origins = compute_flange(IRB_120, joints)
    choice = follow_checked(IRB_120, origins, rotations)
    assert np.degrees(np.abs(np.diff(choice.joints[:, 3])).max()) < 1e-6


def test_a_path_close_to_a_straight_wrist_is_refused_as_singular() -> None:
    origins, rotations = make_wrist_swing(IRB_120, 0.001)
    reason = find_reason(IRB_120, origins, rotations)
    assert reason.kind == "singular"
    assert "wrist straight" in reason.text
    assert 49 <= reason.row <= 51


def test_a_path_within_the_margin_of_a_straight_wrist_is_refused() -> None:
    origins, rotations = make_wrist_swing(IRB_120, 0.0)
    reason = find_reason(IRB_120, origins, rotations, margin=math.radians(5))
    assert reason.kind == "singular"
    # Axis 5 starts at 20 deg and loses 0.4 deg per row: it is below 5 deg from row 38 on.
    assert (reason.row, reason.text.rpartition(": ")[2]) == (38, "4.8 deg away")


def test_a_gap_in_the_path_is_reported_as_a_jump() -> None:
    origins, rotations = make_circle(400, 0, 200, 20, 50)
    origins[30:] = [200, 400, 200]
    reason = find_reason(COBRA, origins, rotations)
    assert (reason.row, reason.kind) == (30, "jump")


def test_a_tilted_tool_is_named_as_the_reason() -> None:
    origins, rotations = make_circle(400, 0, 200, 20, 50)
    leaning = np.array(rotations)
    leaning[7] = DOWN @ rotation_about(0, math.radians(2))
    reason = find_reason(find_robot("Cobra s600"), origins, leaning)
    assert (reason.row, reason.kind, reason.text) == (
        7,
        "lean",
        "the robot cannot lean its tool by 2 deg",
    )


def test_the_limit_of_a_slide_is_named_with_its_excess() -> None:
    robot = find_robot("mill")
    origins = np.column_stack([np.linspace(700, 810, 12), np.full(12, 100.0), np.full(12, -50.0)])
    reason = find_reason(robot, origins, np.broadcast_to(DOWN, (12, 3, 3)))
    assert (reason.row, reason.kind, reason.text) == (11, "limit", "X is beyond its limit by 10 mm")


def test_the_branch_is_chosen_for_the_whole_path_and_not_for_its_first_row() -> None:
    """The start is on the lefty branch, but only the righty branch can follow the whole path."""
    angles = np.radians(np.linspace(25, 85, 61))
    joints = np.column_stack(
        [angles, np.full(61, math.radians(80)), np.full(61, 100.0), np.zeros(61)]
    )
    rotations, origins = compute_flange(COBRA, joints)
    # The start is exactly the lefty solution of the first pose.
    start = compute_solutions(COBRA, rotations[:1], origins[:1])[0, 1]
    assert are_within_limits(COBRA, start)
    left = compute_solutions(COBRA, rotations, origins)[:, 1]
    assert not are_within_limits(COBRA, left).all()
    choice = follow_checked(COBRA, origins, rotations, start=start)
    assert (choice.joints[:, 1] > 0).all()


def test_a_single_pose_is_followed_as_a_path() -> None:
    choice = follow_checked(IRB_120, np.array([[350.0, 0, 300]]), DOWN[None])
    assert choice.joints.shape == (1, 6)
    reason = find_reason(IRB_120, np.array([[900.0, 0, 300]]), DOWN[None])
    assert (reason.row, reason.kind) == (0, "reach")


@pytest.mark.parametrize("name", ["IRB 120", "Cobra s600"])
def test_the_velocities_of_links_are_the_slopes_of_their_frames(name: str) -> None:
    robot, rng, step = find_robot(name), np.random.default_rng(2), 1e-6
    joints = rng.uniform(-1.0, 1.0, (20, len(robot.joints)))
    joint_velocities = rng.normal(0.0, 1.0, (20, 3, len(robot.joints)))
    links = compute_link_frames(robot, joints)
    velocities = compute_velocities(robot, links, joint_velocities @ robot.coupling.T)
    point = rng.normal(0.0, 300.0, 3)
    for direction in range(3):
        ends = [
            compute_link_frames(robot, joints + side * step * joint_velocities[:, direction])
            for side in (1, -1)
        ]
        for link in range(len(robot.joints) + 1):
            positions = [rotation[:, link] @ point + origin[:, link] for rotation, origin in ends]
            position = links[0][:, link] @ point + links[1][:, link]
            rotation_rate, translation_rate = np.split(velocities[link, :, direction], 2, axis=1)
            assert np.allclose(
                np.cross(rotation_rate, position) + translation_rate,
                (positions[0] - positions[1]) / (2 * step),
                atol=1e-3,
            )


@pytest.mark.parametrize("name", ["Cobra s600", "3-axis mill"])
def test_the_nearest_solution_takes_sliding_joints_from_the_pose(name: str) -> None:
    robot = find_robot(name)
    low, high = robot.limits.T
    values = low + 0.4 * (high - low)
    rotations, origins = compute_flange(robot, values[None])
    sliding = np.array([joint.sliding for joint in robot.joints])
    # The guess is 10 mm off, which is more than a whole turn if mm were mistaken for rad.
    guess = np.where(sliding, values + 10.0, values)
    solution = find_nearest(robot, rotations, origins, guess[None])
    assert solution[0][sliding] == pytest.approx(values[sliding], abs=1e-9)
    assert compute_flange(robot, solution)[1] == pytest.approx(origins, abs=1e-9)
