"""Joint motions get the share of the joints' maximum speeds at which the TCP keeps to its speed."""

import math

import numpy as np
import pytest
from msgspec.structs import replace

import camgen
from camgen.check.reach import check_reach
from camgen.check.shares import share_joints
from camgen.check.time import time_motions
from camgen.model.cell import Dynamics
from camgen.model.pose import TOOL_DOWN, FloatArray, Pose, translation
from camgen.model.program import Joints, MoveJ, MoveL, Program
from camgen.robots.catalogue import find_robot
from camgen.robots.kinematics.forward import compute_jacobian
from camgen.robots.models import Robot
from camgen.robots.workcell import Workcell
from fixtures.program_text import dump, parse

ARM = find_robot("VS-060")
HOME = Joints(tuple(math.radians(v) for v in (0.0, 0.0, 90.0, 0.0, 30.0, 0.0)))
BASE, TOOL = translation(320, -25, 150), translation(0, 0, 100)
CELL = Workcell("VS-060", BASE, TOOL, HOME, arm=ARM)


def down(x: float, y: float, z: float = 20.0) -> Pose:
    return Pose(TOOL_DOWN, (x, y, z))


def stand(joints: FloatArray, _: FloatArray) -> FloatArray:
    return np.zeros(len(joints))


def shared(*motions: MoveJ | MoveL) -> Program:
    program = Program("part", BASE, TOOL, (MoveJ(HOME, 100.0), *motions))
    return share_joints(check_reach(program, ARM, "part"), CELL, stand, math.inf)


def ends_of(program: Program, swing: int) -> tuple[Joints, Joints]:
    a, b = (item.joints or item.target for item in program.body[swing - 1 : swing + 1])  # type: ignore[union-attr]
    assert isinstance(a, Joints)
    assert isinstance(b, Joints)
    return a, b


def fastest(arm: Robot, start: Joints, end: Joints, share: float) -> tuple[float, float]:
    """The maximum speeds of the TCP, mm/s, and of a joint, rad/s, at a share of the joints."""
    a, b = np.array(start.values), np.array(end.values)
    rate = share * (b - a) / np.max(np.abs(b - a) / arm.speeds)
    joints = a + np.linspace(0, 1, 2001)[:, None] * (b - a)
    moves, rotation, _ = compute_jacobian(arm, joints)
    flange, turn = (moves @ rate)[:, :3], (moves @ rate)[:, 3:]
    tip = flange + np.cross(turn, rotation @ np.array(TOOL.origin))
    return float(np.linalg.norm(tip, axis=1).max()), float(abs(rate).max())


@pytest.mark.parametrize("speed", [20.0, 100.0, 250.0])
def test_the_tool_keeps_to_its_speed_and_reaches_it(speed: float) -> None:
    ways = (MoveJ(down(64, 15), speed), MoveJ(down(-60, 130), speed), MoveJ(HOME, speed))
    program = shared(*ways)
    for swing in (1, 2, 3):
        move = program.body[swing]
        assert isinstance(move, MoveJ)
        tip, turn = fastest(ARM, *ends_of(program, swing), move.share)
        assert tip <= 1.001 * speed
        assert turn <= math.radians(60.001)
        assert tip >= 0.99 * speed or turn >= math.radians(59.999)


@pytest.mark.parametrize("speed", [20.0, 100.0])
def test_the_joint_with_the_longest_travel_has_its_speed(speed: float) -> None:
    """All joints start and end together: the rate is travel over the time of the slowest joint."""
    program = shared(MoveJ(down(64, 15), speed), MoveJ(HOME, speed))
    for swing in (1, 2):
        a, b = ends_of(program, swing)
        travel = np.abs(np.subtract(b.values, a.values))
        move = program.body[swing]
        assert isinstance(move, MoveJ)
        seconds = max(travel / ARM.speeds) / move.share
        assert move.rate == pytest.approx(max(travel) / seconds, abs=1e-6)
        assert move.rate <= max(travel) / seconds


def test_a_turn_on_the_spot_is_no_race() -> None:
    """Axis 6 alone turns; the tip stays where it is, and would allow any speed: 60 deg/s of the 360 that it can do."""
    turned = Joints((*HOME.values[:5], math.radians(90.0)))
    (_, turn) = shared(MoveJ(turned, 100.0)).body
    assert isinstance(turn, MoveJ)
    assert turn.share == pytest.approx(60 / 360, abs=1e-6)
    assert turn.rate == pytest.approx(math.radians(60), abs=1e-5)


def test_the_way_from_where_the_arm_stands_and_no_way_at_all_are_not_known() -> None:
    program = shared(MoveJ(HOME, 100.0), MoveJ(down(0, 0), 100.0), MoveL(down(9, 0), 50.0))
    assert [getattr(item, "share", None) for item in program.body[:2]] == [0.0, 0.0]
    assert program.columns.share[2] > 0
    assert program.columns.share[3] == 0


def test_the_text_form_keeps_the_share() -> None:
    program = shared(MoveJ(down(0, 0), 100.0))
    assert program.body[1].share > 0  # type: ignore[union-attr]
    read = parse(dump(program)).columns
    assert read.share.tolist() == program.columns.share.tolist()
    assert read.rate.tolist() == program.columns.rate.tolist()


def test_a_program_has_shares_of_the_whole() -> None:
    with pytest.raises(
        camgen.CamgenError, match="a share of the joints' speeds must be from 0 to 1"
    ):
        Program("part", BASE, TOOL, (MoveJ(HOME, 100.0, share=1.5),))
    with pytest.raises(camgen.CamgenError, match="a speed of a joint must not be negative"):
        Program("part", BASE, TOOL, (MoveJ(HOME, 100.0, rate=-0.1),))


def test_time_of_a_swing_is_that_of_its_share_where_the_machine_takes_one() -> None:
    """Way over speed and one ramp of 0.2 s: the slowest joint of the swing is at its share all but on the ramps."""
    found = check_reach(
        Program("part", BASE, TOOL, (MoveJ(HOME, 100.0), MoveJ(down(64, 15), 100.0))), ARM, "part"
    )
    program = share_joints(found, CELL, stand, math.inf)
    a, b = ends_of(program, 1)
    share = program.columns.share[1]
    longest = float(np.max(np.abs(np.subtract(b.values, a.values)) / ARM.speeds))
    seconds, _ = time_motions(program, Dynamics(shares=True), found, ARM)
    assert seconds[1] == pytest.approx(longest / share + 0.2 * share, rel=1e-6)
    by_way, _ = time_motions(program, Dynamics(), found, ARM)
    bare = program.with_body(
        tuple(replace(item, share=0.0) for item in program.body if isinstance(item, MoveJ))
    )
    assert by_way.tolist() == time_motions(bare, Dynamics(shares=True), found, ARM)[0].tolist()
    assert by_way[1] < seconds[1]  # the mean of the tool's speed on the way is below its greatest
