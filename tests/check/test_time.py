"""Times of motions compared with closed forms, plain loops and measurements of LinuxCNC."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from camgen.check.profile import durations, squares
from camgen.check.reach import check_reach
from camgen.check.time import time_motions
from camgen.model.cell import Dynamics
from camgen.model.pose import TOOL_DOWN, Pose, frozen, rotation_about, translation
from camgen.model.program import (
    Comment,
    Force,
    Instruction,
    Joints,
    MoveC,
    MoveJ,
    MoveL,
    Output,
    Program,
    Wait,
)
from camgen.post.plugins import find_post, make_post
from camgen.robots.catalogue import find_robot
from camgen.robots.kinematics.forward import compute_flange
from tests.support.whole import whole

PACE = Dynamics(acceleration=1000.0, turning=math.radians(500), ramp=0.2)
FRAME = translation(0, 0, 0)
#: Accelerations so large that ramps take no time.
INSTANT = Dynamics(acceleration=1e12, turning=1e9, ramp=1e-12)


def make_pose(x: float, y: float, z: float = 0.0) -> Pose:
    return Pose(TOOL_DOWN, (x, y, z))


def seconds(*body: Instruction, pace: Dynamics = PACE, start: Pose | None = None) -> list[float]:
    """Seconds of each motion of a program that starts at the origin, or at `start`."""
    program = Program("p", FRAME, FRAME, whole((MoveJ(start or make_pose(0, 0), 100.0), *body)))
    times: list[float] = time_motions(program, pace, None, None).tolist()
    assert times[0] == 0.0  # the start of the motion to the origin is unknown
    return times[1:]


def polyline(
    points: list[tuple[float, float]], speed: float, blend: float = 1.0
) -> list[Instruction]:
    return [MoveL(make_pose(*point), speed, blend) for point in points[:-1]] + [
        MoveL(make_pose(*points[-1]), speed)
    ]


def test_a_long_line_is_a_trapezoid_and_a_short_one_a_triangle() -> None:
    assert seconds(MoveL(make_pose(50, 0), 20.0)) == pytest.approx([50 / 20 + 20 / 1000])
    assert seconds(MoveL(make_pose(0.1, 0), 20.0)) == pytest.approx([2 * math.sqrt(0.1 / 1000)])


def test_a_square_with_stops_is_four_trapezoids() -> None:
    corners = [(20.0, 0.0), (20.0, 20.0), (0.0, 20.0), (0.0, 0.0)]
    assert seconds(*polyline(corners, 50.0, 0.0)) == pytest.approx([20 / 50 + 50 / 1000] * 4)


def test_the_speed_on_an_arc_is_limited_by_its_centripetal_acceleration() -> None:
    def make_circle(r: float) -> list[Instruction]:
        return [
            MoveC(make_pose(r, r), make_pose(2 * r, 0), 50.0, 1.0),
            MoveC(make_pose(r, -r), make_pose(0, 0), 50.0),
        ]

    assert sum(seconds(*make_circle(10.0))) == pytest.approx(2 * math.pi * 10 / 50 + 50 / 1000)
    slow = math.sqrt(1000 * 0.4)
    assert sum(seconds(*make_circle(0.4))) == pytest.approx(2 * math.pi * 0.4 / slow + slow / 1000)
    half_speed = replace(PACE, across=0.25, along=0.5)
    assert sum(seconds(*make_circle(0.4), pace=half_speed)) == pytest.approx(
        2 * math.pi * 0.4 / (slow / 2) + slow / 1000
    )


def test_a_blended_corner_is_a_parabola() -> None:
    # The corner has 90 deg and a zone of 2 mm: v^2 = 1000 * 2 / sin(45 deg). It is run at that
    # speed from 2 mm before to 2 mm after the corner.
    fast, corner = 80.0, math.sqrt(1000 * 2 / math.sin(math.pi / 4))
    line = 98 / fast + (fast / 2000) + (fast - corner) ** 2 / (2 * 1000 * fast)
    expected = line + 2 / corner
    assert corner < fast
    assert seconds(*polyline([(100, 0), (100, 100)], fast, 2.0)) == pytest.approx([expected] * 2)
    # A zone is at most half of the shorter motion, here 1 mm.
    tight = math.sqrt(1000 * 1 / math.sin(math.pi / 4))
    times = seconds(*polyline([(100, 0), (100, 2)], fast, 5.0))
    assert times[0] == pytest.approx(
        99 / fast + fast / 2000 + (fast - tight) ** 2 / (2 * 1000 * fast) + 1 / tight
    )


def test_overlapping_motions_accelerate_and_brake_at_the_same_time() -> None:
    # The braking of the first line and the start of the second, 50 / 1000 s each, overlap.
    pace = replace(PACE, corner="overlap")
    assert sum(seconds(*polyline([(100, 0), (100, 100)], 50.0), pace=pace)) == pytest.approx(
        200 / 50 + 50 / 1000
    )
    # Short lines are triangles of 2 sqrt(s / a). Each starts at the middle of the previous one.
    short = [(float(k), float(k % 2)) for k in range(1, 41)]
    step = math.sqrt(math.hypot(1, 1) / 1000)
    assert step * 1000 < 50.0
    times = seconds(*polyline(short, 50.0), pace=pace)
    assert times[5:-5] == pytest.approx([step] * 30)


def test_outputs_force_and_waits_stop_a_motion_and_comments_do_not() -> None:
    def time_two_lines(*between: Instruction, blend: float = 0.0) -> float:
        return sum(
            seconds(MoveL(make_pose(50, 0), 20.0, blend), *between, MoveL(make_pose(100, 0), 20.0))
        )

    through, stopped = 100 / 20 + 20 / 1000, 100 / 20 + 2 * 20 / 1000
    assert (
        time_two_lines(blend=1.0)
        == time_two_lines(Comment("x"), blend=1.0)
        == pytest.approx(through)
    )
    assert (
        time_two_lines()
        == time_two_lines(Output("process", 1.0))
        == time_two_lines(Wait(3.0))
        == pytest.approx(stopped)
    )
    assert time_two_lines(Force(5.0, (0.0, 0.0, -1.0)), Force(0.0)) == pytest.approx(stopped)


def test_a_reorientation_takes_its_own_time_and_limits_the_speed_of_a_line() -> None:
    rotated = Pose(frozen(rotation_about(2, math.pi / 2) @ TOOL_DOWN), (0.0, 0.0, 0.0))
    # 500 deg/s within 0.2 s are 2500 deg/s2. 90 deg are too short to reach full speed.
    assert seconds(MoveL(rotated, 20.0, turn=math.radians(500))) == pytest.approx(
        [2 * math.sqrt(90 / 2500)]
    )
    # At 60 deg/s the ramp of 60 deg/s at 2500 deg/s2 is added. A speed beyond that of the arm
    # changes nothing.
    assert seconds(MoveL(rotated, 20.0, turn=math.radians(60))) == pytest.approx(
        [90 / 60 + 60 / 2500]
    )
    assert seconds(MoveL(rotated, 20.0, turn=math.radians(5000))) == pytest.approx(
        [2 * math.sqrt(90 / 2500)]
    )
    # A line of 1 mm takes the 0.18 s of the rotation and its ramp.
    moved = replace(rotated, origin=(1.0, 0.0, 0.0))
    speed = 1 / 0.18
    assert seconds(MoveL(moved, 20.0)) == pytest.approx([0.18 + speed / 1000])


step_lists = st.lists(
    st.tuples(st.floats(0.01, 50), st.floats(-3, 3), st.floats(1, 300)), min_size=1, max_size=30
)


def make_walk(steps: list[tuple[float, float, float]]) -> list[Instruction]:
    x = y = heading = 0.0
    body: list[Instruction] = []
    for k, (length, turn, speed) in enumerate(steps):
        heading += turn
        x, y = x + length * math.cos(heading), y + length * math.sin(heading)
        body.append(MoveL(make_pose(x, y), speed, 1.0 if k + 1 < len(steps) else 0.0))
    return body


@given(step_lists, st.sampled_from(["zone", "overlap", "arc", "junction"]))
def test_more_acceleration_never_takes_longer_and_the_feed_is_the_limit(
    steps: list[tuple[float, float, float]], corner: str
) -> None:
    pace = replace(PACE, corner=corner, deviation=0.01)
    naive = sum(length / speed for length, _, speed in steps)
    slow, fast = (
        sum(seconds(*make_walk(steps), pace=replace(pace, acceleration=a))) for a in (500.0, 1000.0)
    )
    assert naive * (1 - 1e-9) <= fast <= slow * (1 + 1e-9)
    assert sum(
        seconds(*make_walk(steps), pace=replace(INSTANT, corner=corner, deviation=1e6))
    ) == pytest.approx(naive, rel=1e-3)


@given(st.floats(1, 200), st.floats(1, 200), st.lists(st.floats(0.01, 0.99), max_size=8))
def test_a_line_cut_into_blended_pieces_takes_as_long(
    length: float, speed: float, cuts: list[float]
) -> None:
    fractions = sorted({0.0, *(round(cut, 3) for cut in cuts), 1.0})[1:]
    whole = seconds(MoveL(make_pose(length, 0), speed))
    for corner in ("zone", "arc", "junction"):
        pieces = polyline([(length * place, 0.0) for place in fractions], speed)
        assert sum(seconds(*pieces, pace=replace(PACE, corner=corner))) == pytest.approx(
            sum(whole), rel=1e-6
        )


def limit_speeds_by_loop(
    length: list[float], allowed: list[float], acceleration: list[float]
) -> list[float]:
    """The squared speeds at the ends of pieces, forward and back as look-ahead planners do."""
    squared = list(allowed)
    for k, (s, a) in enumerate(zip(length, acceleration, strict=True)):
        squared[k + 1] = min(squared[k + 1], squared[k] + 2 * a * s)
    for k in reversed(range(len(length))):
        squared[k] = min(squared[k], squared[k + 1] + 2 * acceleration[k] * length[k])
    return squared


piece_lists = st.lists(
    st.tuples(st.floats(1e-3, 20), st.floats(0.1, 200), st.floats(50, 5000)),
    min_size=1,
    max_size=40,
)


@given(piece_lists)
def test_speeds_agree_with_a_loop_forward_and_back(
    rows: list[tuple[float, float, float]],
) -> None:
    length, limits, acceleration = (list(column) for column in zip(*rows, strict=True))
    allowed = [0.0, *(min(a, b) ** 2 for a, b in pairwise(limits)), 0.0]
    squared = squares(np.array(length), np.array(allowed), np.array(acceleration))
    assert squared.tolist() == pytest.approx(
        limit_speeds_by_loop(length, allowed, acceleration), rel=1e-6, abs=1e-6
    )


@given(st.floats(0.1, 50), st.floats(1, 100), st.floats(0, 1), st.floats(0, 1), st.floats(50, 5000))
def test_the_time_of_a_piece_is_the_integral_over_its_length(
    length: float, limit: float, first: float, last: float, acceleration: float
) -> None:
    # The speeds at the two ends can be reached from each other.
    v0, v1 = limit_speeds_by_loop(
        [length], [(first * limit) ** 2, (last * limit) ** 2], [acceleration]
    )
    s = length * (1 - np.cos(np.linspace(0, math.pi, 20001))) / 2
    speed = np.sqrt(
        np.minimum(
            limit**2, np.minimum(v0 + 2 * acceleration * s, v1 + 2 * acceleration * (length - s))
        )
    )
    mean = (speed[1:] + speed[:-1]) / 2  # exact if the squared speed is linear in s
    expected = float((np.diff(s) / np.maximum(mean, 1e-300)).sum())
    times = durations(
        np.array([length]), np.array([limit]), np.array([v0, v1]), np.array([acceleration])
    )
    assert times.sum() == pytest.approx(expected, rel=1e-3)


def make_wave(count: int) -> list[tuple[float, float]]:
    return [(60 * t, 10 * math.sin(12 * t)) for t in np.linspace(0, 1, count)[1:].tolist()]


#: Motions, the seconds that LinuxCNC 2.9 needed for them in its simulator, and the relative
#: tolerance of the model. Seconds are counted in servo periods of 1 ms
#: (`bench.controllers.linuxcnc shapes`).
LINUXCNC: dict[str, tuple[list[Instruction], float, float]] = {
    "line": ([MoveL(make_pose(50, 0), 20.0)], 2.579, 0.001),
    "circle": (
        [
            MoveC(make_pose(10, 10), make_pose(20, 0), 50.0, 1.0),
            MoveC(make_pose(10, -10), make_pose(0, 0), 50.0),
        ],
        1.557,
        0.001,
    ),
    "square": (polyline([(20, 0), (20, 20), (0, 20), (0, 0)], 50.0), 2.088, 0.001),
    "zigzag": (polyline([(2.0 * k, 3.0 * (k % 2)) for k in range(1, 40)], 40.0), 6.250, 0.02),
    "few lines": (polyline(make_wave(60), 40.0), 3.018, 0.02),
    "many lines": (polyline(make_wave(800), 40.0), 2.721, 0.04),
}


@pytest.mark.parametrize("name", LINUXCNC)
def test_the_time_agrees_with_a_measurement_of_linuxcnc(name: str) -> None:
    body, measured, tolerance = LINUXCNC[name]
    pace = make_post(find_post("gcode"), {}).dynamics()
    if name == "zigzag":
        # Each axis has 500 mm/s2, which is 601 mm/s2 along (2, 3).
        pace = replace(pace, acceleration=500 * math.hypot(2, 3) / 3)
    assert sum(seconds(*body, pace=pace)) == pytest.approx(measured, rel=tolerance)


#: Accelerations, mm/s2: of motions under G64, of a last motion before a stop, of a last arc.
FULL, LAST, LAST_ARC = 500.0, 250.0, 125.0
SWITCH = Output("process", True)
#: mm/s at the start of the last of two lines of 20 mm, and at its peak.
ENTRY, PEAK = math.sqrt(LAST * 20), math.sqrt(LAST * 20 / 2 + LAST * 20)
#: Motions, their seconds by formula, and the seconds that LinuxCNC 2.9 needed for them.
ENDS: dict[str, tuple[list[Instruction], list[float], list[float]]] = {
    "line, output": ([MoveL(make_pose(20, 0), 100.0), SWITCH], [2 * math.sqrt(20 / LAST)], [0.566]),
    "line, wait": (
        [MoveL(make_pose(20, 0), 100.0), Wait(0.1)],
        [2 * math.sqrt(20 / LAST)],
        [0.566],
    ),
    "rapid, output": (
        [MoveJ(make_pose(20, 0), 100.0), SWITCH],
        [2 * math.sqrt(20 / LAST)],
        [0.566],
    ),
    "arc, output": (
        [MoveC(make_pose(10, -10), make_pose(20, 0), 50.0), SWITCH],
        [10 * math.pi / 50 + 50 / LAST_ARC],
        [1.029],
    ),
    "rapid, line": (
        [MoveJ(make_pose(20, 0), 100.0), MoveL(make_pose(40, 0), 100.0)],
        [2 * math.sqrt(20 / FULL), 2 * math.sqrt(20 / LAST)],
        [0.401, 0.566],
    ),
    "line, rapid": (
        [MoveL(make_pose(20, 0), 100.0), MoveJ(make_pose(40, 0), 100.0)],
        [2 * math.sqrt(20 / FULL), 2 * math.sqrt(20 / LAST)],
        [0.401, 0.566],
    ),
    "arc, rapid": (
        [MoveC(make_pose(10, -10), make_pose(20, 0), 50.0), MoveJ(make_pose(20, 0, 10), 100.0)],
        [10 * math.pi / 50 + 50 / 250, 2 * math.sqrt(10 / LAST)],
        [0.829, 0.400],
    ),
    "line, comment, line": (
        [MoveL(make_pose(20, 0), 100.0), Comment("note"), MoveL(make_pose(40, 0), 100.0)],
        [
            0.2 + (100 - ENTRY) / FULL + (20 - 10 - (100**2 - ENTRY**2) / 2 / FULL) / 100,
            (2 * PEAK - ENTRY) / LAST,
        ],
        [0.309, 0.411],
    ),
}


@pytest.mark.parametrize("name", ENDS)
def test_linuxcnc_stops_at_rapid_motions_and_brakes_slowly_before_a_stop(name: str) -> None:
    body, expected, measured = ENDS[name]
    result = seconds(*body, pace=make_post(find_post("gcode"), {}).dynamics())
    assert result == pytest.approx(expected)
    assert result == pytest.approx(measured, abs=0.002)


def test_linuxcnc_runs_the_arc_of_a_corner_at_one_speed() -> None:
    body = (
        MoveL(make_pose(20, 0), 100.0),
        MoveL(make_pose(20, 20), 100.0),
        MoveJ(make_pose(20, 20, 10), 100.0),
    )
    result = seconds(*body, pace=make_post(find_post("gcode"), {}).dynamics())
    radius = 0.01 * math.sqrt(0.5) / (1 - math.sqrt(0.5))
    speed = math.sqrt(0.866 * FULL * radius)
    half = radius * math.pi / 4
    peak = math.sqrt(speed**2 / 2 + FULL * (20 - half))
    expected = (2 * peak - speed) / FULL + half / speed
    assert result[:2] == pytest.approx([expected, expected])


def test_linuxcnc_nearly_stops_between_a_plunge_and_an_arc() -> None:
    body = (
        MoveL(make_pose(0, 0, -3), 20.0),
        MoveC(make_pose(10, -10, -3), make_pose(20, 0, -3), 50.0),
        MoveJ(make_pose(20, 0), 100.0),
    )
    result = seconds(*body, pace=make_post(find_post("gcode"), {}).dynamics())
    expected = [3 / 20 + 20 / LAST, 10 * math.pi / 50 + 50 / LAST_ARC]
    assert result[:2] == pytest.approx(expected)


def test_a_rotation_of_the_tool_about_its_axis_costs_a_mill_no_time() -> None:
    rotated = Pose(frozen(rotation_about(2, math.pi / 2) @ TOOL_DOWN), (1.0, 0.0, 0.0))
    pace = make_post(find_post("gcode"), {}).dynamics()
    still, turning = (seconds(MoveL(pose, 20.0), pace=pace) for pose in (make_pose(1, 0), rotated))
    assert turning == still
    assert seconds(MoveL(rotated, 20.0)) > seconds(MoveL(make_pose(1, 0), 20.0))


def test_other_controllers_do_not_stop_at_rapid_motions() -> None:
    pace = make_post(find_post("grbl"), {}).dynamics()
    body = (MoveJ(make_pose(20, 0), 100.0), MoveL(make_pose(40, 0), 100.0))
    assert sum(seconds(*body, pace=pace)) == pytest.approx(40 / 100 + 100 / 500 + pace.pause)


def test_a_path_without_tolerance_stops_at_corners_only() -> None:
    pace = make_post(find_post("gcode"), {"path_tolerance": 0.0}).dynamics()
    corner = seconds(*polyline([(20, 0), (40, 0), (40, 20)], 50.0), pace=pace)
    assert sum(corner) == pytest.approx(60 / 50 + 2 * 50 / 500)


ARM = find_robot("IRB 120")
READY = (0.0, 0.3, 0.2, 0.0, 1.07, 0.0)  # the tool points straight down: 0.3 + 0.2 + 1.07 = pi / 2


def time_with_arm(*body: Instruction, pace: Dynamics = INSTANT) -> list[float]:
    program = Program("p", FRAME, FRAME, (MoveJ(Joints(READY), 100.0), *body))
    trace = check_reach(program, ARM, "p")
    return [float(value) for value in time_motions(trace.program, pace, trace, ARM)]


def test_a_joint_motion_takes_as_long_as_its_slowest_joint() -> None:
    # Joint 1 has 250 deg/s, joint 6 has 420 deg/s.
    rotated = Joints((math.radians(30), *READY[1:5], math.radians(90)))
    pace = replace(PACE, acceleration=1e9)
    times = time_with_arm(MoveJ(rotated, 1e6), pace=pace)
    assert times[1] == pytest.approx(90 / 420 + 0.2)
    # The flange runs on a quarter circle about joint 1, at no more than the speed of the motion.
    swung = Joints((math.pi / 2, *READY[1:]))
    times = time_with_arm(MoveJ(swung, 50.0))
    reach = math.hypot(*compute_flange(ARM, np.array([READY]))[1][0, :2].tolist())
    assert times[1] == pytest.approx(reach * math.pi / 2 / 50.0, rel=1e-3)


def test_a_line_is_no_faster_than_its_joints() -> None:
    rotations, origins = compute_flange(ARM, np.array([READY]))
    x, y, z = origins[0].tolist()
    line = MoveL(Pose(frozen(rotations[0]), (x, y + 150, z)), 1e6)
    program = Program("p", FRAME, FRAME, (MoveJ(Joints(READY), 100.0), line))
    trace = check_reach(program, ARM, "p")
    step = np.abs(np.diff(trace.joints, axis=0)) / ARM.speeds
    lower = float(step.max(axis=1).sum())
    assert lower > 0.15 / 2  # the joints allow far less than 2 m/s on the 150 mm
    assert time_motions(trace.program, INSTANT, trace, ARM)[1] == pytest.approx(lower, rel=1e-6)
    slow = program.with_body((program.body[0], replace(line, speed=10.0)))
    assert time_motions(slow, INSTANT, trace, ARM)[1] == pytest.approx(15.0)
