"""Joint motions get the fraction of the maximum joint speeds at which the TCP has its speed."""

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


def make_pose(x: float, y: float, z: float = 20.0) -> Pose:
    return Pose(TOOL_DOWN, (x, y, z))


def measure_nothing(joints: FloatArray, _: FloatArray) -> FloatArray:
    return np.zeros(len(joints))


def set_fractions(*motions: MoveJ | MoveL) -> Program:
    """A program from home with these motions and their speed fractions."""
    program = Program("part", BASE, TOOL, (MoveJ(HOME, 100.0), *motions))
    return share_joints(check_reach(program, ARM, "part"), CELL, measure_nothing, math.inf)


def find_ends(program: Program, index: int) -> tuple[Joints, Joints]:
    motions = program.body[index - 1 : index + 1]
    a, b = (motion.joints or motion.target for motion in motions)  # type: ignore[union-attr]
    assert isinstance(a, Joints)
    assert isinstance(b, Joints)
    return a, b


def measure_maximum_speeds(
    arm: Robot, start: Joints, end: Joints, fraction: float
) -> tuple[float, float]:
    """The maximum speeds of the TCP, mm/s, and of a joint, rad/s, at a speed fraction."""
    a, b = np.array(start.values), np.array(end.values)
    rate = fraction * (b - a) / np.max(np.abs(b - a) / arm.speeds)
    joints = a + np.linspace(0, 1, 2001)[:, None] * (b - a)
    jacobian, rotation, _ = compute_jacobian(arm, joints)
    flange, rotation_rate = (jacobian @ rate)[:, :3], (jacobian @ rate)[:, 3:]
    tip = flange + np.cross(rotation_rate, rotation @ np.array(TOOL.origin))
    return float(np.linalg.norm(tip, axis=1).max()), float(abs(rate).max())


@pytest.mark.parametrize("speed", [20.0, 100.0, 250.0])
def test_the_tcp_or_a_joint_reaches_its_speed_and_none_exceeds_it(speed: float) -> None:
    motions = (
        MoveJ(make_pose(64, 15), speed),
        MoveJ(make_pose(-60, 130), speed),
        MoveJ(HOME, speed),
    )
    program = set_fractions(*motions)
    for index in (1, 2, 3):
        motion = program.body[index]
        assert isinstance(motion, MoveJ)
        tcp_speed, joint_speed = measure_maximum_speeds(
            ARM, *find_ends(program, index), motion.share
        )
        assert tcp_speed <= 1.001 * speed
        assert joint_speed <= math.radians(60.001)
        assert tcp_speed >= 0.99 * speed or joint_speed >= math.radians(59.999)


@pytest.mark.parametrize("speed", [20.0, 100.0])
def test_the_rate_is_the_speed_of_the_joint_with_the_longest_travel(speed: float) -> None:
    """All joints start and end together, so the rate is travel over the time of the slowest."""
    program = set_fractions(MoveJ(make_pose(64, 15), speed), MoveJ(HOME, speed))
    for index in (1, 2):
        a, b = find_ends(program, index)
        travel = np.abs(np.subtract(b.values, a.values))
        motion = program.body[index]
        assert isinstance(motion, MoveJ)
        seconds = max(travel / ARM.speeds) / motion.share
        assert motion.rate == pytest.approx(max(travel) / seconds, abs=1e-6)
        assert motion.rate <= max(travel) / seconds


def test_a_reorientation_keeps_the_speed_limit_of_the_joints() -> None:
    """Axis 6 alone moves and the TCP keeps its position, which would allow any speed.

    The joint gets 60 deg/s of its 360 deg/s.
    """
    rotated = Joints((*HOME.values[:5], math.radians(90.0)))
    (_, motion) = set_fractions(MoveJ(rotated, 100.0)).body
    assert isinstance(motion, MoveJ)
    assert motion.share == pytest.approx(60 / 360, abs=1e-6)
    assert motion.rate == pytest.approx(math.radians(60), abs=1e-5)


def test_the_fraction_of_the_first_motion_and_of_one_without_travel_is_unknown() -> None:
    program = set_fractions(
        MoveJ(HOME, 100.0), MoveJ(make_pose(0, 0), 100.0), MoveL(make_pose(9, 0), 50.0)
    )
    assert [getattr(item, "share", None) for item in program.body[:2]] == [0.0, 0.0]
    assert program.columns.share[2] > 0
    assert program.columns.share[3] == 0


def test_the_text_form_keeps_the_speed_fraction() -> None:
    program = set_fractions(MoveJ(make_pose(0, 0), 100.0))
    assert program.body[1].share > 0  # type: ignore[union-attr]
    parsed = parse(dump(program)).columns
    assert parsed.share.tolist() == program.columns.share.tolist()
    assert parsed.rate.tolist() == program.columns.rate.tolist()


def test_an_invalid_speed_fraction_or_rate_is_refused() -> None:
    with pytest.raises(
        camgen.CamgenError, match="a share of the joints' speeds must be from 0 to 1"
    ):
        Program("part", BASE, TOOL, (MoveJ(HOME, 100.0, share=1.5),))
    with pytest.raises(camgen.CamgenError, match="a speed of a joint must not be negative"):
        Program("part", BASE, TOOL, (MoveJ(HOME, 100.0, rate=-0.1),))


def test_the_time_of_a_joint_motion_follows_its_speed_fraction() -> None:
    """The time is travel over speed plus a ramp of 0.2 s at full speed.

    The slowest joint runs at its speed fraction, except on the ramps.
    """
    trace = check_reach(
        Program("part", BASE, TOOL, (MoveJ(HOME, 100.0), MoveJ(make_pose(64, 15), 100.0))),
        ARM,
        "part",
    )
    program = share_joints(trace, CELL, measure_nothing, math.inf)
    a, b = find_ends(program, 1)
    fraction = program.columns.share[1]
    longest = float(np.max(np.abs(np.subtract(b.values, a.values)) / ARM.speeds))
    seconds = time_motions(program, Dynamics(shares=True), trace, ARM)
    assert seconds[1] == pytest.approx(longest / fraction + 0.2 * fraction, rel=1e-6)
    by_speed = time_motions(program, Dynamics(), trace, ARM)
    without_fractions = program.with_body(
        tuple(replace(item, share=0.0) for item in program.body if isinstance(item, MoveJ))
    )
    assert (
        by_speed.tolist()
        == time_motions(without_fractions, Dynamics(shares=True), trace, ARM).tolist()
    )
    assert by_speed[1] < seconds[1]  # the mean speed of the TCP is below its maximum
