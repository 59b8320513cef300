"""Times of motions against closed forms, plain loops and measured LinuxCNC."""

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
#: Large enough for its ramps to take no time.
INSTANT = Dynamics(acceleration=1e12, turning=1e9, ramp=1e-12)


def at(x: float, y: float, z: float = 0.0) -> Pose:
    return Pose(TOOL_DOWN, (x, y, z))


def seconds(*body: Instruction, pace: Dynamics = PACE, start: Pose | None = None) -> list[float]:
    """Of each motion after the first, which ends at the origin."""
    program = Program("p", FRAME, FRAME, whole((MoveJ(start or at(0, 0), 100.0), *body)))
    found: list[float] = time_motions(program, pace, None, None)[0].tolist()
    assert found[0] == 0.0  # where it comes from is not known
    return found[1:]


def polyline(
    points: list[tuple[float, float]], speed: float, blend: float = 1.0
) -> list[Instruction]:
    return [MoveL(at(*point), speed, blend) for point in points[:-1]] + [
        MoveL(at(*points[-1]), speed)
    ]


def test_a_long_line_is_a_trapezoid_and_a_short_one_a_triangle() -> None:
    assert seconds(MoveL(at(50, 0), 20.0)) == pytest.approx([50 / 20 + 20 / 1000])
    assert seconds(MoveL(at(0.1, 0), 20.0)) == pytest.approx([2 * math.sqrt(0.1 / 1000)])


def test_a_square_with_stops_is_four_trapezoids() -> None:
    corners = [(20.0, 0.0), (20.0, 20.0), (0.0, 20.0), (0.0, 0.0)]
    assert seconds(*polyline(corners, 50.0, 0.0)) == pytest.approx([20 / 50 + 50 / 1000] * 4)


def test_an_arc_runs_at_its_feed_or_at_what_the_acceleration_across_allows() -> None:
    def circle(r: float) -> list[Instruction]:
        return [MoveC(at(r, r), at(2 * r, 0), 50.0, 1.0), MoveC(at(r, -r), at(0, 0), 50.0)]

    assert sum(seconds(*circle(10.0))) == pytest.approx(2 * math.pi * 10 / 50 + 50 / 1000)
    slow = math.sqrt(1000 * 0.4)
    assert sum(seconds(*circle(0.4))) == pytest.approx(2 * math.pi * 0.4 / slow + slow / 1000)
    shares = replace(PACE, across=0.25, along=0.5)
    assert sum(seconds(*circle(0.4), pace=shares)) == pytest.approx(
        2 * math.pi * 0.4 / (slow / 2) + slow / 1000
    )


def test_a_blended_corner_is_a_parabola() -> None:
    # 90 deg, zone 2 mm: v^2 = 1000 * 2 / sin(45 deg); run at that speed from 2 mm before to 2 mm behind the corner
    fast, corner = 80.0, math.sqrt(1000 * 2 / math.sin(math.pi / 4))
    line = 98 / fast + (fast / 2000) + (fast - corner) ** 2 / (2 * 1000 * fast)
    expected = line + 2 / corner
    assert corner < fast
    assert seconds(*polyline([(100, 0), (100, 100)], fast, 2.0)) == pytest.approx([expected] * 2)
    # a zone ends half-way along the shorter motion, here 1 mm before the corner
    tight = math.sqrt(1000 * 1 / math.sin(math.pi / 4))
    found = seconds(*polyline([(100, 0), (100, 2)], fast, 5.0))
    assert found[0] == pytest.approx(
        99 / fast + fast / 2000 + (fast - tight) ** 2 / (2 * 1000 * fast) + 1 / tight
    )


def test_where_motions_overlap_the_next_begins_while_the_last_one_brakes() -> None:
    # two long lines: the brake of one and the start of the other, 50 / 1000 s each, happen at once
    pace = replace(PACE, corner="overlap")
    assert sum(seconds(*polyline([(100, 0), (100, 100)], 50.0), pace=pace)) == pytest.approx(
        200 / 50 + 50 / 1000
    )
    # short ones are triangles of 2 sqrt(s / a), each begun in the middle of the one before
    short = [(float(k), float(k % 2)) for k in range(1, 41)]
    step = math.sqrt(math.hypot(1, 1) / 1000)
    assert step * 1000 < 50.0
    found = seconds(*polyline(short, 50.0), pace=pace)
    assert found[5:-5] == pytest.approx([step] * 30)


def test_outputs_force_and_waits_are_stops_and_comments_are_none() -> None:
    def two(*between: Instruction, blend: float = 0.0) -> float:
        return sum(seconds(MoveL(at(50, 0), 20.0, blend), *between, MoveL(at(100, 0), 20.0)))

    through, stopped = 100 / 20 + 20 / 1000, 100 / 20 + 2 * 20 / 1000
    assert two(blend=1.0) == two(Comment("x"), blend=1.0) == pytest.approx(through)
    assert two() == two(Output("process", 1.0)) == two(Wait(3.0)) == pytest.approx(stopped)
    assert two(Force(5.0, (0.0, 0.0, -1.0)), Force(0.0)) == pytest.approx(stopped)


def test_a_turn_at_rest_takes_the_time_of_the_turn_and_one_on_the_way_slows_the_way() -> None:
    turned = Pose(frozen(rotation_about(2, math.pi / 2) @ TOOL_DOWN), (0.0, 0.0, 0.0))
    # 500 deg/s within 0.2 s are 2500 deg/s2, and 90 deg are too few for full speed
    assert seconds(MoveL(turned, 20.0, turn=math.radians(500))) == pytest.approx(
        [2 * math.sqrt(90 / 2500)]
    )
    # at 60 deg/s: 90 deg and the ramp of 60 deg/s at 2500 deg/s2; no faster than the arm turns, whatever is asked for
    assert seconds(MoveL(turned, 20.0, turn=math.radians(60))) == pytest.approx(
        [90 / 60 + 60 / 2500]
    )
    assert seconds(MoveL(turned, 20.0, turn=math.radians(5000))) == pytest.approx(
        [2 * math.sqrt(90 / 2500)]
    )
    # 1 mm in the 0.18 s of the turn, no faster
    moved = replace(turned, origin=(1.0, 0.0, 0.0))
    speed = 1 / 0.18
    assert seconds(MoveL(moved, 20.0)) == pytest.approx([0.18 + speed / 1000])


lines = st.lists(
    st.tuples(st.floats(0.01, 50), st.floats(-3, 3), st.floats(1, 300)), min_size=1, max_size=30
)


def walk(steps: list[tuple[float, float, float]]) -> list[Instruction]:
    x = y = heading = 0.0
    body: list[Instruction] = []
    for k, (length, turn, speed) in enumerate(steps):
        heading += turn
        x, y = x + length * math.cos(heading), y + length * math.sin(heading)
        body.append(MoveL(at(x, y), speed, 1.0 if k + 1 < len(steps) else 0.0))
    return body


@given(lines, st.sampled_from(["zone", "overlap", "arc", "junction"]))
def test_no_time_is_below_length_over_speed_and_more_acceleration_never_costs(
    steps: list[tuple[float, float, float]], corner: str
) -> None:
    pace = replace(PACE, corner=corner, deviation=0.01)
    naive = sum(length / speed for length, _, speed in steps)
    slow, fast = (
        sum(seconds(*walk(steps), pace=replace(pace, acceleration=a))) for a in (500.0, 1000.0)
    )
    assert naive * (1 - 1e-9) <= fast <= slow * (1 + 1e-9)
    assert sum(
        seconds(*walk(steps), pace=replace(INSTANT, corner=corner, deviation=1e6))
    ) == pytest.approx(naive, rel=1e-3)


@given(st.floats(1, 200), st.floats(1, 200), st.lists(st.floats(0.01, 0.99), max_size=8))
def test_a_line_cut_into_blended_pieces_takes_as_long(
    length: float, speed: float, cuts: list[float]
) -> None:
    places = sorted({0.0, *(round(cut, 3) for cut in cuts), 1.0})[1:]
    whole = seconds(MoveL(at(length, 0), speed))
    for corner in ("zone", "arc", "junction"):
        pieces = polyline([(length * place, 0.0) for place in places], speed)
        assert sum(seconds(*pieces, pace=replace(PACE, corner=corner))) == pytest.approx(
            sum(whole), rel=1e-6
        )


def by_loop(length: list[float], allowed: list[float], gain: list[float]) -> list[float]:
    """Forward and back, one piece after the other, as look-ahead planners do."""
    square = list(allowed)
    for k, (s, a) in enumerate(zip(length, gain, strict=True)):
        square[k + 1] = min(square[k + 1], square[k] + 2 * a * s)
    for k in reversed(range(len(length))):
        square[k] = min(square[k], square[k + 1] + 2 * gain[k] * length[k])
    return square


pieces = st.lists(
    st.tuples(st.floats(1e-3, 20), st.floats(0.1, 200), st.floats(50, 5000)),
    min_size=1,
    max_size=40,
)


@given(pieces)
def test_speeds_are_those_of_a_loop_forward_and_back(
    rows: list[tuple[float, float, float]],
) -> None:
    length, most, gain = (list(column) for column in zip(*rows, strict=True))
    allowed = [0.0, *(min(a, b) ** 2 for a, b in pairwise(most)), 0.0]
    found = squares(np.array(length), np.array(allowed), np.array(gain))
    assert found.tolist() == pytest.approx(by_loop(length, allowed, gain), rel=1e-6, abs=1e-6)


@given(st.floats(0.1, 50), st.floats(1, 100), st.floats(0, 1), st.floats(0, 1), st.floats(50, 5000))
def test_the_time_of_a_piece_is_the_integral_over_its_way(
    length: float, most: float, first: float, last: float, gain: float
) -> None:
    # speeds at the ends that can be reached from each other
    v0, v1 = by_loop([length], [(first * most) ** 2, (last * most) ** 2], [gain])
    s = length * (1 - np.cos(np.linspace(0, math.pi, 20001))) / 2
    speed = np.sqrt(
        np.minimum(most**2, np.minimum(v0 + 2 * gain * s, v1 + 2 * gain * (length - s)))
    )
    mean = (speed[1:] + speed[:-1]) / 2  # exact where the square of the speed is a line over s
    expected = float((np.diff(s) / np.maximum(mean, 1e-300)).sum())
    found = durations(np.array([length]), np.array([most]), np.array([v0, v1]), np.array([gain]))
    assert found.sum() == pytest.approx(expected, rel=1e-3)


def wave(count: int) -> list[tuple[float, float]]:
    return [(60 * t, 10 * math.sin(12 * t)) for t in np.linspace(0, 1, count)[1:].tolist()]


#: Seconds that LinuxCNC 2.9 needed in its simulator, counted in servo periods of 1 ms (`bench.robots.cycle`),
#: and how near the model has to be.
LINUXCNC: dict[str, tuple[list[Instruction], float, float]] = {
    "line": ([MoveL(at(50, 0), 20.0)], 2.579, 0.001),
    "circle": (
        [MoveC(at(10, 10), at(20, 0), 50.0, 1.0), MoveC(at(10, -10), at(0, 0), 50.0)],
        1.557,
        0.001,
    ),
    "square": (polyline([(20, 0), (20, 20), (0, 20), (0, 0)], 50.0), 2.088, 0.001),
    "zigzag": (polyline([(2.0 * k, 3.0 * (k % 2)) for k in range(1, 40)], 40.0), 6.250, 0.02),
    "few lines": (polyline(wave(60), 40.0), 3.018, 0.02),
    "many lines": (polyline(wave(800), 40.0), 2.721, 0.04),
}


@pytest.mark.parametrize("name", LINUXCNC)
def test_linuxcnc_took_as_long(name: str) -> None:
    body, measured, near = LINUXCNC[name]
    pace = make_post(find_post("gcode"), {}).dynamics()
    if name == "zigzag":
        # Each axis has 500 mm/s2: along (2, 3) that is 601 mm/s2.
        pace = replace(pace, acceleration=500 * math.hypot(2, 3) / 3)
    assert sum(seconds(*body, pace=pace)) == pytest.approx(measured, rel=near)


#: mm/s2 of motions under G64, of motions that nothing follows, and of arcs that nothing follows.
FULL, LAST, LAST_ARC = 500.0, 250.0, 125.0
SWITCH = Output("process", True)
#: mm/s at the start of the last of two lines of 20 mm, and at its peak.
ENTRY, PEAK = math.sqrt(LAST * 20), math.sqrt(LAST * 20 / 2 + LAST * 20)
#: Motions, their seconds by formula, and the seconds that LinuxCNC 2.9 needed for them.
ENDS: dict[str, tuple[list[Instruction], list[float], list[float]]] = {
    "line, output": ([MoveL(at(20, 0), 100.0), SWITCH], [2 * math.sqrt(20 / LAST)], [0.566]),
    "line, wait": ([MoveL(at(20, 0), 100.0), Wait(0.1)], [2 * math.sqrt(20 / LAST)], [0.566]),
    "rapid, output": ([MoveJ(at(20, 0), 100.0), SWITCH], [2 * math.sqrt(20 / LAST)], [0.566]),
    "arc, output": (
        [MoveC(at(10, -10), at(20, 0), 50.0), SWITCH],
        [10 * math.pi / 50 + 50 / LAST_ARC],
        [1.029],
    ),
    "rapid, line": (
        [MoveJ(at(20, 0), 100.0), MoveL(at(40, 0), 100.0)],
        [2 * math.sqrt(20 / FULL), 2 * math.sqrt(20 / LAST)],
        [0.401, 0.566],
    ),
    "line, rapid": (
        [MoveL(at(20, 0), 100.0), MoveJ(at(40, 0), 100.0)],
        [2 * math.sqrt(20 / FULL), 2 * math.sqrt(20 / LAST)],
        [0.401, 0.566],
    ),
    "arc, rapid": (
        [MoveC(at(10, -10), at(20, 0), 50.0), MoveJ(at(20, 0, 10), 100.0)],
        [10 * math.pi / 50 + 50 / 250, 2 * math.sqrt(10 / LAST)],
        [0.829, 0.400],
    ),
    "line, comment, line": (
        [MoveL(at(20, 0), 100.0), Comment("note"), MoveL(at(40, 0), 100.0)],
        [
            0.2 + (100 - ENTRY) / FULL + (20 - 10 - (100**2 - ENTRY**2) / 2 / FULL) / 100,
            (2 * PEAK - ENTRY) / LAST,
        ],
        [0.309, 0.411],
    ),
}


@pytest.mark.parametrize("name", ENDS)
def test_linuxcnc_stops_at_rapid_motions_and_brakes_slowly_at_the_last(name: str) -> None:
    body, expected, measured = ENDS[name]
    result = seconds(*body, pace=make_post(find_post("gcode"), {}).dynamics())
    assert result == pytest.approx(expected)
    assert result == pytest.approx(measured, abs=0.002)


def test_linuxcnc_runs_the_arc_of_a_corner_at_one_speed() -> None:
    body = (MoveL(at(20, 0), 100.0), MoveL(at(20, 20), 100.0), MoveJ(at(20, 20, 10), 100.0))
    result = seconds(*body, pace=make_post(find_post("gcode"), {}).dynamics())
    radius = 0.01 * math.sqrt(0.5) / (1 - math.sqrt(0.5))
    speed = math.sqrt(0.866 * FULL * radius)
    half = radius * math.pi / 4
    peak = math.sqrt(speed**2 / 2 + FULL * (20 - half))
    expected = (2 * peak - speed) / FULL + half / speed
    assert result[:2] == pytest.approx([expected, expected])


def test_linuxcnc_nearly_stops_between_a_plunge_and_an_arc() -> None:
    body = (
        MoveL(at(0, 0, -3), 20.0),
        MoveC(at(10, -10, -3), at(20, 0, -3), 50.0),
        MoveJ(at(20, 0), 100.0),
    )
    result = seconds(*body, pace=make_post(find_post("gcode"), {}).dynamics())
    expected = [3 / 20 + 20 / LAST, 10 * math.pi / 50 + 50 / LAST_ARC]
    assert result[:2] == pytest.approx(expected)


def test_a_mill_does_not_wait_for_the_tool_to_turn_about_itself() -> None:
    turned = Pose(frozen(rotation_about(2, math.pi / 2) @ TOOL_DOWN), (1.0, 0.0, 0.0))
    pace = make_post(find_post("gcode"), {}).dynamics()
    still, turning = (seconds(MoveL(pose, 20.0), pace=pace) for pose in (at(1, 0), turned))
    assert turning == still
    assert seconds(MoveL(turned, 20.0)) > seconds(MoveL(at(1, 0), 20.0))


def test_other_controllers_run_through_rapid_motions() -> None:
    pace = make_post(find_post("grbl"), {}).dynamics()
    body = (MoveJ(at(20, 0), 100.0), MoveL(at(40, 0), 100.0))
    assert sum(seconds(*body, pace=pace)) == pytest.approx(40 / 100 + 100 / 500 + pace.pause)


def test_an_exact_path_stops_at_corners_only() -> None:
    pace = make_post(find_post("gcode"), {"path_tolerance": 0.0}).dynamics()
    corner = seconds(*polyline([(20, 0), (40, 0), (40, 20)], 50.0), pace=pace)
    assert sum(corner) == pytest.approx(60 / 50 + 2 * 50 / 500)


ARM = find_robot("IRB 120")
READY = (0.0, 0.3, 0.2, 0.0, 1.07, 0.0)  # the tool straight down: 0.3 + 0.2 + 1.07 = pi / 2


def with_arm(*body: Instruction, pace: Dynamics = INSTANT) -> list[float]:
    program = Program("p", FRAME, FRAME, (MoveJ(Joints(READY), 100.0), *body))
    found = check_reach(program, ARM, "p")
    return [float(value) for value in time_motions(found.program, pace, found, ARM)[0]]


def test_a_joint_motion_takes_as_long_as_its_slowest_joint() -> None:
    # joint 1 at 250 deg/s and joint 6 at 420 deg/s
    turned = Joints((math.radians(30), *READY[1:5], math.radians(90)))
    pace = replace(PACE, acceleration=1e9)
    found = with_arm(MoveJ(turned, 1e6), pace=pace)
    assert found[1] == pytest.approx(90 / 420 + 0.2)
    # the tool runs on a quarter of a circle about joint 1 at no more than its speed
    swung = Joints((math.pi / 2, *READY[1:]))
    found = with_arm(MoveJ(swung, 50.0))
    reach = math.hypot(*compute_flange(ARM, np.array([READY]))[1][0, :2].tolist())
    assert found[1] == pytest.approx(reach * math.pi / 2 / 50.0, rel=1e-3)


def test_a_line_is_no_faster_than_its_joints() -> None:
    turned, origins = compute_flange(ARM, np.array([READY]))
    x, y, z = origins[0].tolist()
    line = MoveL(Pose(frozen(turned[0]), (x, y + 150, z)), 1e6)
    program = Program("p", FRAME, FRAME, (MoveJ(Joints(READY), 100.0), line))
    found = check_reach(program, ARM, "p")
    step = np.abs(np.diff(found.joints, axis=0)) / ARM.speeds
    lower = float(step.max(axis=1).sum())
    assert lower > 0.15 / 2  # 150 mm at far less than 2 m/s
    assert time_motions(found.program, INSTANT, found, ARM)[0][1] == pytest.approx(lower, rel=1e-6)
    slow = program.with_body((program.body[0], replace(line, speed=10.0)))
    assert time_motions(slow, INSTANT, found, ARM)[0][1] == pytest.approx(15.0)
