"""Programs with motions to joint values in between: what is between two of them is one stretch from the first."""

import math

import numpy as np
import pytest
from msgspec.structs import replace

from camgen.check.reach import JointTrace, check_reach
from camgen.model.errors import CamgenError, NoSafeProgram
from camgen.model.pose import TOOL_DOWN, FloatArray, Pose, frozen, rotation_about, translation
from camgen.model.program import Comment, Instruction, Joints, MoveC, MoveJ, MoveL, Origin, Program
from camgen.robots.catalogue import find_robot
from camgen.robots.kinematics import continuity
from camgen.robots.kinematics.forward import compute_flange
from camgen.robots.kinematics.inverse import compute_solutions
from camgen.robots.kinematics.joint_limits import are_within_limits

ARM = find_robot("IRB 1200")
HOME = Joints((0.0, 0.0, 0.0, 0.0, math.radians(30), 0.0))
BASE, TOOL = translation(450, -75, 200), translation(0, 0, 100)


def down(x: float, y: float, z: float = 0.0) -> Pose:
    return Pose(TOOL_DOWN, (x, y, z))


def program(*motions: Instruction) -> Program:
    own = (
        replace(one, path=0) if isinstance(one, (MoveJ, MoveL, MoveC)) else one for one in motions
    )
    body = (MoveJ(HOME, 100.0), Comment("edge e1"), *own, MoveJ(HOME, 100.0))
    return Program("part", BASE, TOOL, body, paths=(Origin("e1", operation="edges"),))


def solution(pose: Pose, flip: bool, near: float = 0.0) -> Joints:
    """The joints of a pose with the elbow up, the arm ahead, axis 5 above or below 0; axis 6 next to ``near``."""
    at = BASE @ pose @ TOOL.inverse()
    values = compute_solutions(ARM, at.rotation[None], np.array([at.origin]))[0][1 if flip else 0]
    values[5] += math.tau * round((near - values[5]) / math.tau)
    assert are_within_limits(ARM, values)
    return Joints(tuple(values.tolist()))


def tips(found: JointTrace) -> FloatArray:
    rotations, origins = compute_flange(ARM, found.joints)
    return origins + rotations @ np.array(TOOL.origin) - np.array(BASE.origin)


def sound(found: JointTrace) -> JointTrace:
    """What holds for every program: its own joints lead to its poses, rows are dense, limits are kept."""
    planned = found.program
    for item in planned.body:
        if not isinstance(item, Comment) and isinstance(item.target, Pose):
            assert item.joints is not None
            assert item.posture is not None
            rotations, origins = compute_flange(ARM, np.array([item.joints.values]))
            tip = origins[0] + rotations[0] @ np.array(TOOL.origin) - np.array(BASE.origin)
            assert tip == pytest.approx(np.array(item.target.origin), abs=1e-6)
            assert rotations[0] == pytest.approx(np.array(item.target.rotation), abs=1e-9)
    assert are_within_limits(ARM, found.joints).all()
    assert found.joints[0].tolist() == list(HOME.values)
    assert found.joints[-1].tolist() == list(HOME.values)
    assert (np.diff(found.owner) >= 0).all()
    assert found.samples == len(found.joints) == len(found.owner)
    free = np.array([isinstance(item, MoveJ) for item in planned.body])[found.owner[1:]]
    turned, moved = (
        np.abs(np.diff(found.joints, axis=0)),
        np.linalg.norm(np.diff(compute_flange(ARM, found.joints)[1], axis=0), axis=1),
    )
    assert np.degrees(turned[free]).max() <= 2 + 1e-9
    assert moved[free].max() <= 10.5
    assert np.linalg.norm(np.diff(tips(found), axis=0), axis=1)[~free].max(initial=0.0) <= 10 + 1e-6
    assert np.degrees(turned[~free]).max(initial=0.0) <= 30
    return found


def ends(found: JointTrace, index: int) -> FloatArray:
    """The joints in which an instruction ends."""
    return found.joints[np.flatnonzero(found.owner == index)[-1]]


def test_two_stretches_in_two_postures() -> None:
    first, second = solution(down(0, 0, 30), False), solution(down(80, 60, 30), True)
    plan = program(
        MoveJ(first, 100.0), MoveL(down(0, 0), 20.0), MoveL(down(60, 0), 20.0), MoveL(down(60, 0, 30), 50.0),
        MoveJ(second, 100.0), MoveL(down(80, 60), 20.0), MoveL(down(10, 60), 20.0), MoveL(down(10, 60, 30), 50.0),
    )  # fmt: skip
    found = sound(check_reach(plan, ARM, "part"))
    assert ends(found, 2).tolist() == list(first.values)
    assert ends(found, 6).tolist() == list(second.values)
    for index, sign in ((3, 1), (4, 1), (5, 1), (7, -1), (8, -1), (9, -1)):
        assert (np.sign(found.joints[found.owner == index, 4]) == sign).all()
        item = found.program.body[index]
        assert isinstance(item, MoveL)
        assert item.posture is not None
        assert item.posture.confdata is not None
        # cfx: 1 with axis 5 below 0; the quarters by hand from the joints.
        assert item.joints is not None
        quarters = [math.floor(math.degrees(item.joints.values[k]) / 90 + 1e-9) for k in (0, 3, 5)]
        assert list(item.posture.confdata) == [*quarters, 1 if sign < 0 else 0]
        half = abs(abs(math.degrees(item.joints.values[3])) - 180) < 0.01
        assert item.posture.figure == (None if half else 1 + 4 * (sign > 0))
        assert item.posture.switches[2] == ("NOFLIP" if sign > 0 else "FLIP")
    assert found.program.body[6] is plan.body[6]


def test_lines_and_arcs_are_looked_at_from_an_anchor_on() -> None:
    first = solution(down(0, 0), True)
    found = sound(
        check_reach(
            program(MoveJ(first, 9.0), MoveC(down(50, 50), down(100, 0), 20.0)), ARM, "part"
        )
    )
    arc = tips(found)[found.owner == 3]
    assert np.hypot(arc[:, 0] - 50, arc[:, 1]) == pytest.approx(np.full(len(arc), 50.0), abs=1e-6)
    assert len(arc) >= math.pi * 50 / 10
    assert (found.joints[found.owner == 3, 4] < 0).all()


def test_a_stretch_ends_in_the_values_of_the_next_anchor() -> None:
    """From home the arm would come with axis 5 above 0; it is told to be there with it below, so it comes so."""
    there = down(40, 0, 30)
    plain = (MoveJ(down(0, 0, 30), 50.0), MoveL(there, 20.0))
    assert ends(sound(check_reach(program(*plain), ARM, "part")), 3)[4] > 0
    for told in (solution(there, True), solution(there, False, 6.0), solution(there, False)):
        found = sound(check_reach(program(*plain, MoveJ(told, 50.0)), ARM, "part"))
        assert ends(found, 3) == pytest.approx(np.array(told.values), abs=1e-9)
        # The joint motion after it has nothing to do.
        assert (found.owner == 4).sum() == 1


def test_an_anchor_in_another_posture_is_gone_to_all_the_same() -> None:
    first, told = solution(down(0, 0, 30), False), solution(down(40, 0, 30), True)
    found = sound(
        check_reach(
            program(MoveJ(first, 9.0), MoveL(down(40, 0, 30), 20.0), MoveJ(told, 50.0)), ARM, "part"
        )
    )
    assert ends(found, 3)[4] > 0
    assert ends(found, 4).tolist() == list(told.values)
    assert (found.owner == 4).sum() > 20


def test_a_long_joint_motion_to_a_pose_is_no_jump_and_keeps_the_posture() -> None:
    """Axis 1 turns by 53 deg at once from one side to the other."""
    first = solution(down(0, -100, 30), True)
    plan = program(
        MoveJ(first, 50.0), MoveJ(down(-100, 300, 30), 50.0), MoveL(down(-100, 280, 30), 20.0)
    )
    found = sound(check_reach(plan, ARM, "part"))
    way = found.joints[found.owner == 3]
    assert np.degrees(abs(way[-1, 0] - way[0, 0])) > 45
    assert (way[:, 4] < 0).all()
    # All joints together: every row is the same part of the way of each joint.
    parts = (way - way[0]) / np.where(np.abs(way[-1] - way[0]) > 1e-9, way[-1] - way[0], np.inf)
    assert np.abs(parts[:, 0] - parts[:, 1]).max() < 1e-9


def test_a_line_does_not_leap_into_another_posture() -> None:
    """The line turns the tool by 200 deg: axis 6 comes to its limit, unless it starts a turn further back."""
    ahead, back = solution(down(0, 0), False, 3.0), solution(down(0, 0), False, -3.0)
    assert ahead.values[5] - back.values[5] == pytest.approx(math.tau)
    assert math.degrees(ahead.values[5]) > 360 - 200
    way = [
        MoveL(
            Pose(frozen(rotation_about(2, math.radians(-a)) @ TOOL_DOWN), (a / 10, 0.0, 0.0)), 20.0
        )
        for a in (100, 200)
    ]
    sound(check_reach(program(MoveJ(back, 9.0), *way), ARM, "part"))
    with pytest.raises(
        NoSafeProgram, match=r"cannot run edge e1 at .*: axis 6 is beyond its limit by"
    ):
        check_reach(program(MoveJ(ahead, 9.0), *way), ARM, "part")


def test_a_line_that_starts_where_the_anchor_is_not_is_told_by_its_path() -> None:
    plan = program(MoveJ(solution(down(0, 0, 30), False), 9.0), MoveL(down(500, 0), 20.0))
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
def test_an_anchor_that_the_arm_has_not_is_refused(values: tuple[float, ...], line: str) -> None:
    with pytest.raises(CamgenError, match=line):
        check_reach(program(MoveJ(Joints(values), 9.0)), ARM, "part")


def test_joint_values_alone_are_rows_as_well() -> None:
    found = sound(
        check_reach(program(MoveJ(Joints((0.5, 0.4, -0.3, 0.2, 0.1, 3.0)), 100.0)), ARM, "part")
    )
    # Axis 6 turns by 3 rad, 172 deg, there and back; every part is at most 2 deg.
    assert found.samples >= 1 + 2 * 86
    assert np.bincount(found.owner).tolist()[0] == 1


def test_half_a_turn_along_an_arc_goes_the_way_of_its_via_point() -> None:
    turned = [Pose(frozen(rotation_about(2, math.radians(a)) @ TOOL_DOWN), p) for a, p in
              ((90, (50.0, 50.0, 0.0)), (180, (100.0, 0.0, 0.0)))]  # fmt: skip
    other = [
        Pose(frozen(rotation_about(2, math.radians(-a)) @ TOOL_DOWN), p.origin)
        for a, p in zip((90, 180), turned, strict=True)
    ]
    last = []
    for via, end in (turned, other):
        found = sound(
            check_reach(program(MoveJ(down(0, 0), 9.0), MoveC(via, end, 20.0)), ARM, "part")
        )
        arc = found.joints[found.owner == 3, 5]
        last.append(math.degrees(arc[-1] - ends(found, 2)[5]))
        assert np.abs(np.diff(np.degrees(arc))).max() <= 15
    # The tool points down: its turn is the flange's, less what axis 1 turns.
    assert last[0] * last[1] < 0
    assert abs(last[0] - last[1]) == pytest.approx(360, abs=1e-6)


def test_costs_that_add_up_are_those_that_are_chosen(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where there is nothing to choose the search takes a short cut; step by step it finds the same."""
    there = [
        Pose(frozen(rotation_about(2, math.radians(a)) @ TOOL_DOWN), (a / 4, 9.0, 0.0))
        for a in range(0, 400, 8)
    ]
    plan = program(
        MoveJ(down(0, 0, 9), 9.0), *(MoveL(pose, 20.0) for pose in there), MoveJ(down(0, 0, 9), 9.0)
    )

    def stepwise(cost, source, times, usable, backs):  # type: ignore[no-untyped-def]
        costs = []
        for row in range(len(times)):
            cost, backs[row] = continuity._step(cost, source[row], times[row])
            cost = np.where(usable[row], cost, math.inf)
            costs.append(cost)
        return np.array(costs)

    short = check_reach(plan, ARM, "part")
    monkeypatch.setattr(continuity, "_add_rows", stepwise)
    assert check_reach(plan, ARM, "part").joints.tolist() == short.joints.tolist()
    assert np.degrees(np.ptp(short.joints[:, 5])) > 360
