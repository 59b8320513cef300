"""Programs with motions to joint values, here called anchors, between motions to poses.

The motions from an anchor to the next one are one stretch, which starts at the joint values of the
first anchor.
"""

import math

import numpy as np
import pytest
from msgspec.structs import replace

from camgen.check.reach import JointTrace, check_reach
from camgen.model.errors import CamgenError, NoSafeProgram
from camgen.model.pose import TOOL_DOWN, FloatArray, Pose, frozen, rotation_about, translation
from camgen.model.program import Comment, Joints, MoveC, MoveJ, MoveL, Origin, Program
from camgen.robots.catalogue import find_robot
from camgen.robots.kinematics import continuity
from camgen.robots.kinematics.forward import compute_flange
from camgen.robots.kinematics.inverse import compute_solutions
from camgen.robots.kinematics.joint_limits import are_within_limits

ARM = find_robot("IRB 1200")
HOME = Joints((0.0, 0.0, 0.0, 0.0, math.radians(30), 0.0))
BASE, TOOL = translation(450, -75, 200), translation(0, 0, 100)


def make_pose(x: float, y: float, z: float = 0.0) -> Pose:
    return Pose(TOOL_DOWN, (x, y, z))


def make_program(*motions: MoveJ | MoveL | MoveC) -> Program:
    """A program that runs these motions as edge e1, from home and back."""
    path_motions = [replace(motion, path=0) for motion in motions]
    body = (MoveJ(HOME, 100.0), Comment("edge e1"), *path_motions, MoveJ(HOME, 100.0))
    return Program("part", BASE, TOOL, body, paths=(Origin("e1", operation="edges"),))


def solve_pose(pose: Pose, flip: bool, axis_6: float = 0.0) -> Joints:
    """Joint values of a pose with the elbow up and the arm ahead.

    flip: axis 5 is below 0.
    axis_6: value within half a turn of which axis 6 shall be, rad.
    """
    base_from_flange = BASE @ pose @ TOOL.inverse()
    values = compute_solutions(
        ARM, base_from_flange.rotation[None], np.array([base_from_flange.origin])
    )[0][1 if flip else 0]
    values[5] += math.tau * round((axis_6 - values[5]) / math.tau)
    assert are_within_limits(ARM, values)
    return Joints(tuple(values.tolist()))


def compute_tcp_positions(trace: JointTrace) -> FloatArray:
    """TCP (N, 3) at the rows of a trace, mm, relative to the origin of the work frame."""
    rotations, origins = compute_flange(ARM, trace.joints)
    return origins + rotations @ np.array(TOOL.origin) - np.array(BASE.origin)


def check_trace(trace: JointTrace) -> JointTrace:
    """Check that joint values lead to the poses, that rows are dense and that limits are kept."""
    program = trace.program
    for instruction in program.body:
        if not isinstance(instruction, Comment) and isinstance(instruction.target, Pose):
            assert instruction.joints is not None
            assert instruction.posture is not None
            rotations, origins = compute_flange(ARM, np.array([instruction.joints.values]))
            tip = origins[0] + rotations[0] @ np.array(TOOL.origin) - np.array(BASE.origin)
            assert tip == pytest.approx(np.array(instruction.target.origin), abs=1e-6)
            assert rotations[0] == pytest.approx(np.array(instruction.target.rotation), abs=1e-9)
    assert are_within_limits(ARM, trace.joints).all()
    assert trace.joints[0].tolist() == list(HOME.values)
    assert trace.joints[-1].tolist() == list(HOME.values)
    assert (np.diff(trace.owner) >= 0).all()
    assert len(trace.joints) == len(trace.owner)
    are_joint_motions = np.array([isinstance(motion, MoveJ) for motion in program.body])
    is_joint_motion = are_joint_motions[trace.owner[1:]]
    joint_steps = np.abs(np.diff(trace.joints, axis=0))
    flange_steps = np.linalg.norm(np.diff(compute_flange(ARM, trace.joints)[1], axis=0), axis=1)
    assert np.degrees(joint_steps[is_joint_motion]).max() <= 2 + 1e-9
    assert flange_steps[is_joint_motion].max() <= 10.5
    tcp_steps = np.linalg.norm(np.diff(compute_tcp_positions(trace), axis=0), axis=1)
    assert tcp_steps[~is_joint_motion].max(initial=0.0) <= 10 + 1e-6
    assert np.degrees(joint_steps[~is_joint_motion]).max(initial=0.0) <= 30
    return trace


def trace_program(*motions: MoveJ | MoveL | MoveC) -> JointTrace:
    """The checked joint values of a program with these motions."""
    return check_trace(check_reach(make_program(*motions), ARM, "part"))


def make_rolled_pose(roll: float, x: float, y: float) -> Pose:
    """A pose at the top face with the tool down and rolled by `roll` deg."""
    return Pose(frozen(rotation_about(2, math.radians(roll)) @ TOOL_DOWN), (x, y, 0.0))


def find_last_joints(trace: JointTrace, index: int) -> FloatArray:
    """The joint values at the end of an instruction."""
    return trace.joints[np.flatnonzero(trace.owner == index)[-1]]


def test_each_stretch_keeps_the_posture_of_its_anchor() -> None:
    first, second = solve_pose(make_pose(0, 0, 30), False), solve_pose(make_pose(80, 60, 30), True)
    plan = make_program(
        MoveJ(first, 100.0),
        MoveL(make_pose(0, 0), 20.0),
        MoveL(make_pose(60, 0), 20.0),
        MoveL(make_pose(60, 0, 30), 50.0),
        MoveJ(second, 100.0),
        MoveL(make_pose(80, 60), 20.0),
        MoveL(make_pose(10, 60), 20.0),
        MoveL(make_pose(10, 60, 30), 50.0),
    )
    trace = check_trace(check_reach(plan, ARM, "part"))
    assert find_last_joints(trace, 2).tolist() == list(first.values)
    assert find_last_joints(trace, 6).tolist() == list(second.values)
    for index, sign in ((3, 1), (4, 1), (5, 1), (7, -1), (8, -1), (9, -1)):
        assert (np.sign(trace.joints[trace.owner == index, 4]) == sign).all()
        motion = trace.program.body[index]
        assert isinstance(motion, MoveL)
        assert motion.posture is not None
        assert motion.posture.confdata is not None
        # cfx is 1 if axis 5 is below 0. The quarter turns are computed from the joint values.
        assert motion.joints is not None
        quarters = [
            math.floor(math.degrees(motion.joints.values[k]) / 90 + 1e-9) for k in (0, 3, 5)
        ]
        assert list(motion.posture.confdata) == [*quarters, 1 if sign < 0 else 0]
        is_half_turn = abs(abs(math.degrees(motion.joints.values[3])) - 180) < 0.01
        assert motion.posture.figure == (None if is_half_turn else 1 + 4 * (sign > 0))
        assert motion.posture.switches[2] == ("NOFLIP" if sign > 0 else "FLIP")
    assert trace.program.body[6] is plan.body[6]


def test_an_arc_from_an_anchor_is_sampled_in_its_posture() -> None:
    first = solve_pose(make_pose(0, 0), True)
    arc_motion = MoveC(make_pose(50, 50), make_pose(100, 0), 20.0)
    trace = trace_program(MoveJ(first, 9.0), arc_motion)
    arc = compute_tcp_positions(trace)[trace.owner == 3]
    assert np.hypot(arc[:, 0] - 50, arc[:, 1]) == pytest.approx(np.full(len(arc), 50.0), abs=1e-6)
    assert len(arc) >= math.pi * 50 / 10
    assert (trace.joints[trace.owner == 3, 4] < 0).all()


def test_a_stretch_ends_at_the_joint_values_of_the_next_anchor() -> None:
    """From home the arm would arrive with axis 5 above 0.

    An anchor at the same pose sets axis 5 below 0 or axis 6 to another turn. The arm arrives so.
    """
    target = make_pose(40, 0, 30)
    motions = (MoveJ(make_pose(0, 0, 30), 50.0), MoveL(target, 20.0))
    assert find_last_joints(trace_program(*motions), 3)[4] > 0
    for flip, axis_6 in ((True, 0.0), (False, 6.0), (False, 0.0)):
        anchor = solve_pose(target, flip, axis_6)
        trace = trace_program(*motions, MoveJ(anchor, 50.0))
        assert find_last_joints(trace, 3) == pytest.approx(np.array(anchor.values), abs=1e-9)
        # The joint motion to the anchor then moves nothing.
        assert (trace.owner == 4).sum() == 1


def test_an_anchor_in_another_posture_is_reached_by_a_joint_motion() -> None:
    first, anchor = solve_pose(make_pose(0, 0, 30), False), solve_pose(make_pose(40, 0, 30), True)
    line = MoveL(make_pose(40, 0, 30), 20.0)
    trace = trace_program(MoveJ(first, 9.0), line, MoveJ(anchor, 50.0))
    assert find_last_joints(trace, 3)[4] > 0
    assert find_last_joints(trace, 4).tolist() == list(anchor.values)
    assert (trace.owner == 4).sum() > 20


def test_a_long_joint_motion_to_a_pose_keeps_the_posture_without_a_jump() -> None:
    """Axis 1 rotates by 53 deg in one motion, from one side to the other."""
    first = solve_pose(make_pose(0, -100, 30), True)
    line = MoveL(make_pose(-100, 280, 30), 20.0)
    trace = trace_program(MoveJ(first, 50.0), MoveJ(make_pose(-100, 300, 30), 50.0), line)
    joints = trace.joints[trace.owner == 3]
    assert np.degrees(abs(joints[-1, 0] - joints[0, 0])) > 45
    assert (joints[:, 4] < 0).all()
    # In each row all joints have completed the same fraction of their motion.
    fractions = (joints - joints[0]) / np.where(
        np.abs(joints[-1] - joints[0]) > 1e-9, joints[-1] - joints[0], np.inf
    )
    assert np.abs(fractions[:, 0] - fractions[:, 1]).max() < 1e-9


def test_a_line_does_not_jump_to_another_turn_of_axis_6() -> None:
    """The tool rolls by 200 deg, and axis 6 reaches its limit unless it starts a turn lower."""
    high_axis_6, low_axis_6 = (
        solve_pose(make_pose(0, 0), False, 3.0),
        solve_pose(make_pose(0, 0), False, -3.0),
    )
    assert high_axis_6.values[5] - low_axis_6.values[5] == pytest.approx(math.tau)
    assert math.degrees(high_axis_6.values[5]) > 360 - 200
    lines = [MoveL(make_rolled_pose(-roll, roll / 10, 0.0), 20.0) for roll in (100, 200)]
    trace_program(MoveJ(low_axis_6, 9.0), *lines)
    with pytest.raises(
        NoSafeProgram, match=r"cannot run edge e1 at .*: axis 6 is beyond its limit by"
    ):
        check_reach(make_program(MoveJ(high_axis_6, 9.0), *lines), ARM, "part")


def test_a_line_out_of_reach_after_an_anchor_is_refused_with_its_edge() -> None:
    plan = make_program(
        MoveJ(solve_pose(make_pose(0, 0, 30), False), 9.0), MoveL(make_pose(500, 0), 20.0)
    )
    with pytest.raises(
        NoSafeProgram, match=r"IRB 1200 cannot run edge e1 at [0-9.]+ 0 [0-9.]+ mm: .*instruction 3"
    ):
        check_reach(plan, ARM, "part")


@pytest.mark.parametrize(
    ("values", "line"),
    [
        (
            (0.0, 3.0, 0.0, 0.0, 0.5, 0.0),
            r"IRB 1200 cannot run edge e1: joint values beyond its limits \(instruction 2\)",
        ),
        ((0.0, 0.5, 0.0, 0.5), "IRB 1200 has 6 joints, motion 2 has 4"),
    ],
    ids=["limits", "joints"],
)
def test_an_anchor_that_does_not_fit_the_arm_is_refused(
    values: tuple[float, ...], line: str
) -> None:
    with pytest.raises(CamgenError, match=line):
        check_reach(make_program(MoveJ(Joints(values), 9.0)), ARM, "part")


def test_a_program_of_joint_motions_alone_is_sampled() -> None:
    trace = trace_program(MoveJ(Joints((0.5, 0.4, -0.3, 0.2, 0.1, 3.0)), 100.0))
    # Axis 6 rotates by 3 rad, 172 deg, and back; neighbouring rows differ by at most 2 deg.
    assert len(trace.joints) >= 1 + 2 * 86
    assert np.bincount(trace.owner).tolist()[0] == 1


def test_half_a_turn_along_an_arc_has_the_direction_of_the_via_point() -> None:
    changes = []
    for sign in (1, -1):
        via, end = make_rolled_pose(sign * 90, 50.0, 50.0), make_rolled_pose(sign * 180, 100.0, 0.0)
        trace = trace_program(MoveJ(make_pose(0, 0), 9.0), MoveC(via, end, 20.0))
        arc = trace.joints[trace.owner == 3, 5]
        changes.append(math.degrees(arc[-1] - find_last_joints(trace, 2)[5]))
        assert np.abs(np.diff(np.degrees(arc))).max() <= 15
    # Axis 1 ends at the same value both times, and so does the tool: axis 6 differs by one turn.
    assert changes[0] * changes[1] < 0
    assert abs(changes[0] - changes[1]) == pytest.approx(360, abs=1e-6)


def test_the_shortcut_of_the_branch_search_finds_the_joints_of_the_full_search(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Costs of rows without a change of branch are added at once; row by row gives the same."""
    lines = [MoveL(make_rolled_pose(roll, roll / 4, 9.0), 20.0) for roll in range(0, 400, 8)]
    start = MoveJ(make_pose(0, 0, 9), 9.0)
    plan = make_program(start, *lines, start)

    def stepwise(cost, source, times, usable, backs):  # type: ignore[no-untyped-def]
        costs = []
        for row in range(len(times)):
            cost, backs[row] = continuity._step(cost, source[row], times[row])
            cost = np.where(usable[row], cost, math.inf)
            costs.append(cost)
        return np.array(costs)

    summed = check_reach(plan, ARM, "part")
    monkeypatch.setattr(continuity, "_add_rows", stepwise)
    assert check_reach(plan, ARM, "part").joints.tolist() == summed.joints.tolist()
    assert np.degrees(np.ptp(summed.joints[:, 5])) > 360
