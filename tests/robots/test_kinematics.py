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

DOWN = frozen(np.diag([1.0, -1.0, -1.0]))
CLOSED = [of for of in list_robots() if of.arm]
WRISTS = [find_robot(name) for name in ARMS]


def errors(
    of: Robot, solutions: np.ndarray, rotations: np.ndarray, origins: np.ndarray
) -> tuple[float, float]:
    """mm and rad by which solutions (N, B, J), those there are, miss base_from_flange (N, 3, 3), (N, 3)."""
    count, columns, _ = solutions.shape
    every = solutions.reshape(count * columns, -1)
    good = np.isfinite(every).all(axis=1)
    turned, placed = compute_flange(of, every[good])
    wanted = np.repeat(rotations, columns, axis=0)[good]
    skew = turned.transpose(0, 2, 1) @ wanted
    if of.kind == "cartesian":  # the turn of the spindle is free
        angle = np.linalg.norm(skew[:, :2, 2], axis=1)
    else:
        angle = np.linalg.norm(skew - np.eye(3), axis=(1, 2))
    return float(
        np.linalg.norm(placed - np.repeat(origins, columns, axis=0)[good], axis=1).max()
    ), float(angle.max())


def same(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The largest difference of two configurations (..., J), whole turns aside."""
    return np.abs(np.remainder(a - b + math.pi, math.tau) - math.pi).max(axis=-1)


@st.composite
def configurations(draw: st.DrawFn, of: Robot) -> np.ndarray:
    """Within the limits, singular ones among them: round angles are drawn as often as others."""
    values = []
    for (low, high), joint in zip(of.limits.tolist(), of.joints, strict=True):
        quarter = 1.0 if joint.sliding else math.pi / 12
        round_ones = st.integers(math.ceil(low / quarter), math.floor(high / quarter)).map(
            lambda n, q=quarter: n * q
        )
        values.append(draw(st.one_of(st.floats(low, high), round_ones)))
    return np.array(values)


@pytest.mark.parametrize("of", CLOSED, ids=lambda of: of.name)
@given(data=st.data())
def test_joints_are_found_again(of: Robot, data: st.DataObject) -> None:
    joints = data.draw(configurations(of))
    rotations, origins = compute_flange(of, joints[None])
    solutions = compute_solutions(of, rotations, origins, joints)
    mm, rad = errors(of, solutions, rotations, origins)
    assert mm < 1e-6
    assert rad < 1e-9
    if (
        are_within_limits(of, joints)
        and measure_singularity_distance(of, joints).min(initial=1.0) > 1e-4
    ):
        every = add_turns(of, solutions).reshape(-1, len(joints))
        assert np.nanmin(np.abs(every - joints).max(axis=1)) < 1e-6


@pytest.mark.parametrize("of", WRISTS, ids=lambda of: of.name)
def test_eight_ways_or_four_and_each_on_its_own_branch(of: Robot) -> None:
    rng = np.random.default_rng(5)
    joints = rng.uniform(of.limits[:, 0], of.limits[:, 1], (500, 6))
    rotations, origins = compute_flange(of, joints)
    solutions = compute_solutions(of, rotations, origins)
    found = np.isfinite(solutions[:, :, 0])
    assert set(found.sum(axis=1).tolist()) <= {4, 8}
    assert isinstance(of.arm, Spherical)
    flags = find_branch(of.arm, compute_theta(of, of.arm, solutions))
    assert (flags[found] == np.broadcast_to(np.arange(8), flags.shape)[found]).all()
    # What makes them different branches makes them different joints.
    apart = same(solutions[:, :, None], solutions[:, None]) + 10 * np.eye(8)
    regular = np.nanmin(measure_singularity_distance(of, solutions), axis=(1, 2)) > 0.01
    assert regular.sum() > 300
    assert np.nanmin(apart[regular]) > 1e-3


def test_the_textbooks_arm_is_where_the_solutions_put_it() -> None:
    """Not our own forward way: the table of Denavit and Hartenberg."""
    for name in ARMS:
        of = find_robot(name)
        expected = by_hand(name, [20, 15, 25, -40, 50, 60])
        every = compute_solutions(of, expected[None, :3, :3], expected[None, :3, 3])[0]
        solutions = every[np.isfinite(every).all(axis=1)]
        assert len(solutions)
        for solution in solutions:
            assert np.abs(by_hand(name, np.degrees(solution)) - expected).max() < 1e-9


def test_all_branches_agree_with_another_program() -> None:
    opw = pytest.importorskip(
        "py_opw_kinematics", reason="py-opw-kinematics, the oracle, is not installed"
    )
    transforms = pytest.importorskip("scipy.spatial.transform", reason="scipy is not installed")
    arm: dict[str, Any] = {"a1": 75, "a2": -90, "b": 0, "c1": 335, "c2": 270, "c3": 295, "c4": 80}
    other = opw.Robot(opw.KinematicModel(**arm), degrees=False)
    of = find_robot("VS-6556")
    rng = np.random.default_rng(7)
    rotations, origins = compute_flange(of, rng.uniform(of.limits[:, 0], of.limits[:, 1], (300, 6)))
    poses = transforms.RigidTransform.from_components(
        origins, transforms.Rotation.from_matrix(rotations)
    )
    theirs = np.asarray(other.reach(poses).joints)
    ours = compute_solutions(of, rotations, origins)
    for row in range(len(ours)):
        mine, his = (
            ours[row][np.isfinite(ours[row, :, 0])],
            theirs[row][np.isfinite(theirs[row, :, 0])],
        )
        assert len(mine) == len(his)
        assert same(mine[:, None], his[None]).min(axis=1).max() < 1e-6


def test_a_straight_wrist_keeps_axis_4() -> None:
    of = find_robot("IRB 1200")
    joints = np.radians([10, 20, -30, 70, 0, 15])
    rotations, origins = compute_flange(of, joints[None])
    kept = compute_solutions(of, rotations, origins, joints)
    assert same(kept[0], joints).min() < 1e-9
    alone = compute_solutions(of, rotations, origins)
    assert np.isfinite(alone).all()
    assert np.degrees(alone[0, 0, [3, 5]]) == pytest.approx([0, 85])  # 70 + 15 about the same axis


def test_a_wrist_above_axis_1_keeps_it() -> None:
    of = find_robot("IRB 120")
    over = np.array([[0.0, 0, 700]])  # wrist centre 72 above the flange that points down
    kept = compute_solutions(of, DOWN[None], over, np.radians([33, 0, 0, 0, 0, 0]))
    assert np.degrees(kept[0, :, 0]) == pytest.approx([33] * 8)
    alone = compute_solutions(of, DOWN[None], over)
    assert np.abs(np.degrees(alone[0, :, 0])) == pytest.approx([0] * 4 + [180] * 4)
    for solutions in (kept, alone):
        assert max(errors(of, solutions, DOWN[None], over)) < 1e-9


@pytest.mark.parametrize("angle", [10.0**-n for n in range(2, 14)])
def test_nearly_straight_wrists_are_exact(angle: float) -> None:
    of = find_robot("VS-060")
    rotations, origins = compute_flange(of, np.radians([[10, 20, 30, 70, angle, 15]]))
    solutions = compute_solutions(of, rotations, origins)
    assert np.isfinite(solutions).all()
    mm, rad = errors(of, solutions, rotations, origins)
    assert mm < 1e-6
    assert rad < 1e-9


def test_out_of_reach_is_said_in_millimetres() -> None:
    """IRB 120: arms of 270 mm and hypot(302, 70) mm from axis 2, which is at 290 mm; the flange is 72 mm lower."""
    of = find_robot("IRB 120")
    assert isinstance(of.arm, Spherical)
    most = 270 + math.hypot(302, 70)
    at, turned = (
        np.array([[most - 0.001, 0, 290 - 72], [0, most + 0.25, 290 - 72]]),
        np.stack([DOWN, DOWN]),
    )
    solutions = compute_solutions(of, turned, at)
    assert np.isfinite(solutions[0]).all()
    assert np.isnan(solutions[1]).all()
    assert measure_shortfall(of.arm, turned, at) == pytest.approx([0, 0.25], abs=1e-9)


def test_copies_are_whole_turns_within_the_limits() -> None:
    of = find_robot("IRB 2400")  # axis 1 +-180, axis 4 +-200, axis 6 +-400
    rows = add_turns(of, np.radians([[10, 0, 0, 170, 30, 20]]))[0]
    found = np.degrees(rows[np.isfinite(rows[:, 0])])
    assert sorted(np.round(found[:, [0, 3, 5]]).tolist()) == [
        [10, -190, -340], [10, -190, 20], [10, -190, 380], [10, 170, -340], [10, 170, 20], [10, 170, 380],
    ]  # fmt: skip
    assert len(list_turn_counts(find_robot("IRB 120"))) == 3
    assert len(list_turn_counts(find_robot("3-axis mill"))) == 1


def test_an_arm_is_recognised_by_its_axes_alone() -> None:
    """VS-6556 once more with axes 1, 3, 4 and 6 the other way round, on its side and with a crooked flange."""
    of = find_robot("VS-6556")
    aside = Pose(rotation_from_fixed_xyz(0.3, -1.2, 2.0), (100.0, -50, 30))
    signs = [-1, 1, -1, -1, 1, -1]
    joints = [
        Joint(joint.name, False, joint.previous_from_joint, (sign * x, sign * y, sign * z))
        for joint, sign in zip(of.joints, signs, strict=True)
        for x, y, z in [joint.axis]
    ]
    joints[0] = replace(joints[0], previous_from_joint=aside @ joints[0].previous_from_joint)
    crooked = Pose(rotation_from_fixed_xyz(0.1, 0.2, 0.3), (5.0, 6, 70))
    arm = recognise_arm(tuple(joints), crooked)
    assert isinstance(arm, Spherical)
    assert (arm.a1, arm.a2, arm.b, arm.c2, arm.c3) == pytest.approx(
        (75, -90, 0, 270, 295), abs=1e-9
    )
    other = replace(of, joints=tuple(joints), flange=crooked, arm=arm)
    values = np.radians([[10, 20, 30, 40, 50, 60], [-100, -30, 80, 100, -70, -20]])
    rotations, origins = compute_flange(other, values)
    solutions = compute_solutions(other, rotations, origins)
    assert max(errors(other, solutions, rotations, origins)) < 1e-9
    assert same(solutions, values[:, None]).min(axis=1).max() < 1e-9


def test_the_sign_of_an_axis_does_not_change_what_a_branch_is() -> None:
    of = find_robot("VS-6556")
    signs = np.array([-1, -1, 1, -1, -1, -1])
    joints = tuple(
        replace(joint, axis=tuple(sign * part for part in joint.axis))
        for joint, sign in zip(of.joints, signs.tolist(), strict=True)
    )
    other = replace(of, joints=joints, limits=frozen(np.tile([-math.pi, math.pi], (6, 1))))
    other = replace(other, arm=recognise_arm(joints, of.flange))
    rotations, origins = compute_flange(
        of, np.radians([[10, 20, 30, 40, 50, 60], [-100, -30, 80, 100, -70, -20]])
    )
    theirs, ours = (
        compute_solutions(other, rotations, origins) * signs,
        compute_solutions(of, rotations, origins),
    )
    assert (np.isnan(theirs) == np.isnan(ours)).all()
    assert np.nanmax(same(theirs, ours)) < 1e-9


def test_slides_at_an_angle_and_a_flange_beside_the_last_axis() -> None:
    mill, cobra = find_robot("mill"), find_robot("Cobra s600")
    turned = Pose(rotation_from_fixed_xyz(0.2, -0.3, 0.4), (10.0, 20, 30))
    slides = tuple(replace(joint, previous_from_joint=turned) for joint in mill.joints)
    crooked = replace(mill, joints=slides, arm=recognise_arm(slides, mill.flange))
    aside = Pose(cobra.flange.rotation @ rotation_about(2, 0.7), (30.0, -20, -40))
    offset = replace(cobra, flange=aside, arm=recognise_arm(cobra.joints, aside))
    for of, joints in ((crooked, [100.0, 200, -300]), (offset, [0.3, -0.9, 120, 1.2])):
        rotations, origins = compute_flange(of, np.array([joints]))
        solutions = compute_solutions(of, rotations, origins)
        assert np.isfinite(solutions).all()
        assert max(errors(of, solutions, rotations, origins)) < 1e-9
        assert np.abs(solutions[0] - joints).max(axis=1).min() < 1e-9
    # Three slides, each along an axis of a frame that the one before has turned: by hand for the first two.
    place, origin = turned.rotation, np.array(turned.origin)
    hand = (
        origin
        + place @ np.array([100.0, 0, 0])
        + place @ (origin + place @ np.array([0, 200.0, 0]))
    )
    assert compute_link_frames(crooked, np.array([[100.0, 200, -300]]))[1][0, 2] == pytest.approx(
        hand
    )


@pytest.mark.parametrize(
    ("index", "change", "taken"),
    [
        (
            1,
            translation(75, 40, 132),
            True,
        ),  # axis 2 shifted along itself: the same axis, and a side offset
        (4, translation(2, 0, 187), False),  # axis 5 passes axis 4
        (5, translation(0, 5, 80), False),  # axis 6 passes axis 5
        (5, Pose(rotation_about(0, 0.1), (0.0, 0, 80)), False),  # and is not square to it
        (
            2,
            Pose(rotation_about(2, 0.01), (0.0, 0, 270)),
            False,
        ),  # axis 3 is not parallel to axis 2
    ],
)
def test_only_a_spherical_wrist_is_taken_for_one(index: int, change: Pose, taken: bool) -> None:
    of = find_robot("VS-6556")
    joints = list(of.joints)
    joints[index] = replace(joints[index], previous_from_joint=change)
    assert (recognise_arm(tuple(joints), of.flange) is not None) == taken


def test_a_side_offset_is_part_of_the_closed_form() -> None:
    of = find_robot("VS-060")
    joints = list(of.joints)
    joints[3] = replace(joints[3], previous_from_joint=translation(-10, 25, 164.5))
    other = replace(of, joints=tuple(joints), arm=recognise_arm(tuple(joints), of.flange))
    values = np.radians([[10, 20, 60, 40, 50, 60]])
    rotations, origins = compute_flange(other, values)
    solutions = compute_solutions(other, rotations, origins)
    assert np.isfinite(solutions).all()
    assert max(errors(other, solutions, rotations, origins)) < 1e-9
    assert same(solutions[0], values[0]).min() < 1e-9


def test_a_leaning_tool_is_no_pose_for_a_scara_or_a_mill() -> None:
    lean = (DOWN @ rotation_about(0, 0.01))[None]
    for name, at in (("Cobra s600", (400, 0, 200)), ("mill", (400, 250, -100))):
        assert np.isnan(
            compute_solutions(find_robot(name), lean, np.array([at], dtype=float))
        ).all()
        assert np.isfinite(
            compute_solutions(find_robot(name), DOWN[None], np.array([at], dtype=float))
        ).all()


def test_cobotta_by_iteration() -> None:
    of = find_robot("COBOTTA")
    rng = np.random.default_rng(2)
    joints = rng.uniform(of.limits[:, 0] * 0.9, of.limits[:, 1] * 0.9, (100, 6))
    rotations, origins = compute_flange(of, joints)
    solutions = compute_solutions(of, rotations, origins)
    mm, rad = errors(of, solutions, rotations, origins)
    assert mm < 1e-6
    assert rad < 1e-9
    assert (np.nanmin(same(solutions, joints[:, None]), axis=1) < 1e-6).sum() >= 99
    apart = same(solutions[:, :, None], solutions[:, None]) + 10 * np.eye(solutions.shape[1])
    assert np.nanmin(apart) > 1e-6


def along(
    of: Robot, origins: np.ndarray, rotations: np.ndarray, bound: float = 30, **options: Any
) -> Choice:
    """The joints of a path, checked: on the path, within the limits, no jump."""
    choice = follow(of, (rotations, origins), **options)
    assert isinstance(choice, Choice), explain_stuck(of, rotations, origins, choice).text
    assert max(errors(of, choice.joints[:, None], rotations, origins)) < 1e-6
    assert are_within_limits(of, choice.joints).all()
    turning = [not joint.sliding for joint in of.joints]
    assert np.abs(np.diff(choice.joints, axis=0))[:, turning].max(initial=0.0) < math.radians(bound)
    return choice


def reason(of: Robot, origins: np.ndarray, rotations: np.ndarray, **options: Any) -> Reason:
    stuck = follow(of, (rotations, origins), **options)
    assert isinstance(stuck, Stuck)
    return explain_stuck(of, rotations, origins, stuck, **options)


def ring(
    x: float, y: float, z: float, radius: float, count: int = 360
) -> tuple[np.ndarray, np.ndarray]:
    turn = np.linspace(0, math.tau, count)
    origins = np.column_stack(
        [x + radius * np.cos(turn), y + radius * np.sin(turn), np.full(count, z)]
    )
    return origins, np.broadcast_to(DOWN, (count, 3, 3))


def spun(
    origin: tuple[float, float, float], degrees: float, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """The tool turning about its axis by ``degrees`` in one place."""
    turned = [
        DOWN @ rotation_about(2, angle) for angle in np.radians(np.linspace(0, degrees, count))
    ]
    return np.tile(origin, (count, 1)), np.array(turned)


@pytest.mark.parametrize(
    ("name", "x", "y", "z"),
    [("IRB 120", 350, 0, 300), ("IRB 1200", 500, 0, 300), ("IRB 2000", 900, 0, 700), ("IRB 2400", 900, 0, 700),
     ("VS-060", 350, 0, 300), ("VS-6556", 400, 0, 300), ("Viper s650", 400, 0, 300), ("Cobra s600", 400, 0, 200),
     ("COBOTTA", 200, 60, 150), ("3-axis mill", 400, 250, -100)],
)  # fmt: skip
def test_a_circle_is_followed_and_closed_on_one_branch(
    name: str, x: float, y: float, z: float
) -> None:
    of = find_robot(name)
    choice = along(of, *ring(x, y, z, 50, 60 if name == "COBOTTA" else 360))
    assert len(set(choice.branches.tolist())) == 1
    assert choice.joints[0] == pytest.approx(choice.joints[-1], abs=1e-7)


def test_axis_6_is_wound_back_before_it_is_needed() -> None:
    """Axis 6 of the IRB 2400 has +-400 deg: 700 deg are possible only from one end, whatever is nearest at first."""
    of = find_robot("IRB 2400")
    choice = along(of, *spun((900, 0, 700), 700, 701))
    turned = np.degrees(choice.joints[:, 5])
    assert abs(turned[-1] - turned[0]) == pytest.approx(700)
    assert abs(turned[0]) > 300


def test_the_limit_that_ends_a_path_is_named() -> None:
    """800 deg are all that axis 6 has; tool down, axis 6 upright, it turns with the tool degree by degree."""
    of = find_robot("IRB 2400")
    found = reason(of, *spun((900, 0, 700), 900, 901))
    assert (found.kind, found.joint) == ("limit", 5)
    assert 440 < found.row <= 801
    assert found.amount <= math.radians(1.01)


@pytest.mark.parametrize("most", range(460, 541, 10))
def test_one_axis_cannot_be_wound_back_by_another(most: float) -> None:
    """Axis 4 at 175 deg could as well stand at -185; for axis 6, which has +-most, that is no help."""
    of = find_robot("IRB 2400")
    limits = of.limits.copy()
    limits[5] = np.radians([-most, most])
    of = replace(of, limits=frozen(limits))
    joints = np.radians([[0, 10, 10, 175, 40, turn] for turn in range(0, 1800, 50)])
    rotations, origins = compute_flange(of, joints)
    found = reason(of, origins, rotations, jump=math.radians(60))
    assert (found.kind, found.joint) == ("limit", 5)
    first = along(of, origins[: found.row], rotations[: found.row], jump=math.radians(60), bound=60)
    assert np.abs(np.degrees(np.diff(first.joints[:, 5]))) == pytest.approx([50] * (found.row - 1))


def test_of_two_ways_the_one_nearer_to_the_start_is_taken() -> None:
    of = find_robot("Cobra s600")
    origins, rotations = ring(400, 0, 200, 20, 60)
    for side, start in enumerate(compute_solutions(of, rotations[:1], origins[:1])[0]):
        assert set(along(of, origins, rotations, start=start).branches.tolist()) == {side}


def test_the_first_row_out_of_reach_is_named() -> None:
    of = find_robot("IRB 120")
    origins = np.column_stack([np.arange(400, 700, 1.0), np.zeros(300), np.full(300, 290.0 - 72)])
    found = reason(of, origins, np.broadcast_to(DOWN, (300, 3, 3)))
    # 270 + hypot(302, 70) = 580.0065
    assert (found.row, found.kind, found.text) == (181, "reach", "out of reach by 0.994 mm")


def test_a_row_that_only_limits_forbid_is_named() -> None:
    """Straight behind the IRB 120 axis 1 would stand at 180 deg, and its limit is 165."""
    of = find_robot("IRB 120")
    origins = ring(0, 0, 300, 400)[0][: 180 + 1]
    turned = np.array(
        [rotation_about(2, angle) @ DOWN for angle in np.linspace(0, math.tau, 360)[:181]]
    )
    found = reason(of, origins, turned)
    assert (found.kind, of.joints[found.joint].name) == ("limit", "axis 1")
    assert found.row == math.floor(165 / (360 / 359)) + 1


def straight_through(of: Robot, aside: float, count: int = 101) -> tuple[np.ndarray, np.ndarray]:
    """Axis 5 from 20 deg to -20 in a plane, shifted so that it is missed by ``aside`` rad of axis 4's turn."""
    swing = np.linspace(20, -20, count)
    joints = np.radians([[0, 10, 20, 0, angle, 0] for angle in swing])
    rotations, origins = compute_flange(of, joints)
    return origins, rotations @ rotation_about(0, aside)


def test_through_a_straight_wrist_without_a_flip() -> None:
    of = find_robot("IRB 120")
    origins, rotations = straight_through(of, 0.0)
    choice = along(of, origins, rotations)
    assert np.degrees(choice.joints[:, 4]) == pytest.approx(np.linspace(20, -20, 101), abs=1e-6)
    assert np.abs(choice.joints[:, [3, 5]]).max() < 1e-6
    assert set(choice.branches.tolist()) == {0, 1}


def test_a_straight_wrist_at_the_first_row_takes_axis_4_from_the_next() -> None:
    of = find_robot("IRB 120")
    joints = np.radians([[0, 10, 20, 60, angle, -10] for angle in np.linspace(0, 20, 21)])
    rotations, origins = compute_flange(of, joints)
    choice = along(of, origins, rotations)
    assert np.degrees(np.abs(np.diff(choice.joints[:, 3])).max()) < 1e-6


def test_close_past_a_straight_wrist_axis_4_would_flip() -> None:
    of = find_robot("IRB 120")
    origins, rotations = straight_through(of, 0.001)
    found = reason(of, origins, rotations)
    assert found.kind == "singular"
    assert "wrist straight" in found.text
    assert 49 <= found.row <= 51


def test_a_margin_keeps_away_from_a_straight_wrist() -> None:
    of = find_robot("IRB 120")
    origins, rotations = straight_through(of, 0.0)
    found = reason(of, origins, rotations, margin=math.radians(5))
    assert found.kind == "singular"
    # 20 deg less 0.4 a row: below 5 from row 38 on.
    assert (found.row, math.degrees(found.amount)) == (38, pytest.approx(4.8))


def test_a_gap_in_the_path_is_a_jump() -> None:
    of = find_robot("Cobra s600")
    origins, rotations = ring(400, 0, 200, 20, 50)
    origins[30:] = [200, 400, 200]
    found = reason(of, origins, rotations)
    assert (found.row, found.kind) == (30, "jump")


def test_a_leaning_tool_is_named() -> None:
    origins, rotations = ring(400, 0, 200, 20, 50)
    leaning = np.array(rotations)
    leaning[7] = DOWN @ rotation_about(0, math.radians(2))
    found = reason(find_robot("Cobra s600"), origins, leaning)
    assert (found.row, found.kind, found.text) == (
        7,
        "lean",
        "the robot cannot lean its tool by 2 deg",
    )


def test_slides_end_where_they_end() -> None:
    of = find_robot("mill")
    origins = np.column_stack([np.linspace(700, 810, 12), np.full(12, 100.0), np.full(12, -50.0)])
    found = reason(of, origins, np.broadcast_to(DOWN, (12, 3, 3)))
    assert (found.row, found.kind, found.text) == (11, "limit", "X is beyond its limit by 10 mm")


def test_the_whole_path_decides_and_not_its_first_row() -> None:
    """From home the other elbow is nearer, but only one of them comes along the whole way."""
    of = find_robot("Cobra s600")
    angles = np.radians(np.linspace(25, 85, 61))
    joints = np.column_stack(
        [angles, np.full(61, math.radians(80)), np.full(61, 100.0), np.zeros(61)]
    )
    rotations, origins = compute_flange(of, joints)
    start = compute_solutions(of, rotations[:1], origins[:1])[
        0, 1
    ]  # stands exactly where the lefty solution begins
    assert are_within_limits(of, start)
    left = compute_solutions(of, rotations, origins)[:, 1]
    assert not are_within_limits(of, left).all()
    choice = along(of, origins, rotations, start=start)
    assert (choice.joints[:, 1] > 0).all()


def test_a_single_pose_is_a_path_too() -> None:
    of = find_robot("IRB 120")
    choice = along(of, np.array([[350.0, 0, 300]]), DOWN[None])
    assert choice.joints.shape == (1, 6)
    found = reason(of, np.array([[900.0, 0, 300]]), DOWN[None])
    assert (found.row, found.kind) == (0, "reach")


@pytest.mark.parametrize("name", ["IRB 120", "Cobra s600"])
def test_links_set_out_as_differences_tell(name: str) -> None:
    of, rng, little = find_robot(name), np.random.default_rng(2), 1e-6
    joints, moved = (
        rng.uniform(-1.0, 1.0, (20, len(of.joints))),
        rng.normal(0.0, 1.0, (20, 3, len(of.joints))),
    )
    links = compute_link_frames(of, joints)
    found = compute_velocities(of, links, moved @ of.coupling.T)
    point = rng.normal(0.0, 300.0, 3)
    for way in range(3):
        ends = [compute_link_frames(of, joints + side * little * moved[:, way]) for side in (1, -1)]
        for link in range(len(of.joints) + 1):
            places = [rotation[:, link] @ point + origin[:, link] for rotation, origin in ends]
            here = links[0][:, link] @ point + links[1][:, link]
            turn, shift = np.split(found[link, :, way], 2, axis=1)
            assert np.allclose(
                np.cross(turn, here) + shift, (places[0] - places[1]) / (2 * little), atol=1e-3
            )


@pytest.mark.parametrize("name", ["Cobra s600", "3-axis mill"])
def test_the_nearest_values_leave_sliding_joints_where_the_pose_has_them(name: str) -> None:
    of = find_robot(name)
    low, high = of.limits.T
    values = low + 0.4 * (high - low)
    rotations, origins = compute_flange(of, values[None])
    sliding = np.array([joint.sliding for joint in of.joints])
    # 10 mm away, more than a whole turn would be if millimetres were radians.
    guess = np.where(sliding, values + 10.0, values)
    solution = find_nearest(of, rotations, origins, guess[None])
    assert solution[0][sliding] == pytest.approx(values[sliding], abs=1e-9)
    assert compute_flange(of, solution)[1] == pytest.approx(origins, abs=1e-9)
