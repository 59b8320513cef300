"""Times on a machine with three different axes, by hand and by a loop like GRBL's planner."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from camgen.check import blocks
from camgen.check.blocks import LOOK_AHEAD, Motions, time_blocks
from camgen.check.time import time_motions
from camgen.model.cell import Axes, Dynamics
from camgen.model.machine import Machine
from camgen.model.pose import TOOL_DOWN, Pose, frozen, rotation_about, translation
from camgen.model.program import Instruction, MoveC, MoveJ, MoveL, Output, Program
from tests.support.whole import whole

FRAME = translation(0, 0, 0)
AXES = Axes((40.0, 30.0, 10.0), (400.0, 300.0, 100.0))
Point = tuple[float, float, float]


def make_dynamics(controller: str, axes: Axes = AXES, **limits: float) -> Dynamics:
    """The dynamics of a controller, limited by a machine with these axes."""
    corner, deviation = ("junction", 0.01) if controller == "grbl" else ("arc", None)
    low, high = (-1e3, -1e3, -1e3), (1e3, 1e3, 1e3)
    machine = Machine("m", "", controller, corner, axes, low, high, deviation=deviation, **limits)
    dynamics = Dynamics(acceleration=500.0, corner=corner, deviation=0.02, across=0.866, along=0.5)
    return machine.drive(dynamics)


def make_pose(x: float, y: float, z: float = 0.0) -> Pose:
    return Pose(TOOL_DOWN, (x, y, z))


def seconds(*body: Instruction, dynamics: Dynamics) -> list[float]:
    """Seconds of each motion of a program that starts at the origin."""
    program = Program("p", FRAME, FRAME, whole((MoveJ(make_pose(0, 0), 100.0), *body)))
    spent: list[float] = time_motions(program, dynamics, None, None).tolist()
    return spent[1:]


@pytest.mark.parametrize("controller", ["grbl", "linuxcnc"])
def test_a_line_runs_as_fast_as_its_slowest_axis(controller: str) -> None:
    dynamics = make_dynamics(controller)
    # 100 mm along (0.6, 0.8, 0): X allows 40 / 0.6 mm/s, Y 30 / 0.8 = 37.5, and 375 mm/s2.
    assert seconds(MoveL(make_pose(60, 80), 1000.0), dynamics=dynamics) == pytest.approx(
        [100 / 37.5 + 37.5 / 375]
    )
    # The feed of the program is lower.
    assert seconds(MoveL(make_pose(60, 80), 20.0), dynamics=dynamics) == pytest.approx(
        [100 / 20 + 20 / 375]
    )
    # Along (0.6, 0, 0.8) Z allows 12.5 mm/s and 125 mm/s2.
    assert seconds(MoveL(make_pose(60, 0, 80), 20.0), dynamics=dynamics) == pytest.approx(
        [100 / 12.5 + 12.5 / 125]
    )


@pytest.mark.parametrize("controller", ["grbl", "linuxcnc"])
def test_a_rapid_motion_runs_at_the_rate_of_the_machine(controller: str) -> None:
    for speed in (1.0, 1000.0):
        assert seconds(
            MoveJ(make_pose(50, 0), speed), dynamics=make_dynamics(controller)
        ) == pytest.approx([50 / 40 + 40 / 400])
    without_axes = replace(make_dynamics(controller), axes=None, acceleration=400.0)
    assert seconds(MoveJ(make_pose(50, 0), 20.0), dynamics=without_axes) == pytest.approx(
        [50 / 20 + 20 / 400]
    )


def test_linuxcnc_limits_the_speed_along_the_path_as_well() -> None:
    dynamics = make_dynamics("linuxcnc", speed=25.0, acceleration=200.0)
    assert seconds(MoveJ(make_pose(60, 80), 1.0), dynamics=dynamics) == pytest.approx(
        [100 / 25 + 25 / 200]
    )


def test_an_arc_of_linuxcnc_is_limited_by_the_weaker_of_its_axes() -> None:
    # Y has 30 mm/s and 300 mm/s2, of which an arc uses 0.866 across and half along the path.
    arcs = [
        MoveC(make_pose(10, 10), make_pose(20, 0), 1000.0),
        MoveC(make_pose(10, -10), make_pose(0, 0), 1000.0),
    ]
    assert math.sqrt(0.866 * 300 * 10) > 30
    assert sum(seconds(*arcs, dynamics=make_dynamics("linuxcnc"))) == pytest.approx(
        2 * math.pi * 10 / 30 + 30 / 150
    )


def test_a_corner_of_linuxcnc_has_the_acceleration_of_its_plane() -> None:
    # In the plane of X and Z the weaker axis is Z, 100 mm/s2. The corner of 90 deg is rounded by
    # 0.02 mm with the radius r, 0.02 = r (sqrt(2) - 1); the square of its speed is 0.866 * 100 r.
    # Half of its arc belongs to each line.
    radius = 0.02 / (math.sqrt(2) - 1)
    square, arc = 0.866 * 100 * radius, radius * math.pi / 4
    corner = math.sqrt(square)
    assert corner < 10

    def time_half(length: float, speed: float, acceleration: float) -> float:
        ramp_up, ramp_down = speed**2 / (2 * acceleration), (speed**2 - square) / (2 * acceleration)
        return (
            (2 * speed - corner) / acceleration
            + (length - arc - ramp_up - ramp_down) / speed
            + arc / corner
        )

    spent = seconds(
        MoveL(make_pose(50, 0), 1000.0),
        MoveL(make_pose(50, 0, 50), 1000.0),
        dynamics=make_dynamics("linuxcnc"),
    )
    assert spent == pytest.approx([time_half(50, 40, 400), time_half(50, 10, 100)])


def test_a_stop_of_grbl_takes_its_idle_delay() -> None:
    body = [MoveL(make_pose(20, 0), 20.0), Output("process", 1.0), MoveL(make_pose(40, 0), 20.0)]
    plain = seconds(*body, dynamics=make_dynamics("grbl"))
    delayed = seconds(*body, dynamics=make_dynamics("grbl", pause=0.025))
    assert np.subtract(delayed, plain) == pytest.approx([0.025, 0.025])
    # Without the output the machine stops once.
    once = seconds(body[0], body[2], dynamics=make_dynamics("grbl", pause=0.025))
    assert sum(once) == pytest.approx(40 / 20 + 20 / 400 + 0.025)


@pytest.mark.parametrize("controller", ["grbl", "linuxcnc"])
def test_a_rotation_of_the_tool_about_its_axis_takes_a_mill_no_time(controller: str) -> None:
    rotation = frozen(rotation_about(2, math.pi / 2) @ TOOL_DOWN)
    line = [MoveL(Pose(rotation, (1.0, 0.0, 0.0)), 20.0)]
    plain = [MoveL(make_pose(1, 0), 20.0)]
    dynamics = make_dynamics(controller)
    assert seconds(*line, dynamics=dynamics) == seconds(*plain, dynamics=dynamics)


def test_a_motion_without_travel_does_not_stop_grbl() -> None:
    through = seconds(
        MoveL(make_pose(20, 0), 20.0), MoveL(make_pose(40, 0), 20.0), dynamics=make_dynamics("grbl")
    )
    twice = [
        MoveL(make_pose(20, 0), 20.0),
        MoveL(make_pose(20, 0), 20.0),
        MoveL(make_pose(40, 0), 20.0),
    ]
    assert sum(seconds(*twice, dynamics=make_dynamics("grbl"))) == pytest.approx(sum(through))


def plan_by_loop(
    points: list[Point], speed: float, axes: Axes, deviation: float, known: int = 14
) -> list[float]:
    """Seconds of each line by a plain loop, which plans as GRBL does.

    Each block is entered at a speed from which the machine can stop within the `known` next blocks.
    """
    blocks = []
    for a, b in pairwise(points):
        step = [end - start for start, end in zip(a, b, strict=True)]
        length = math.hypot(*step)
        blocks.append((length, [part / length for part in step]))

    def limit(limits: tuple[float, ...], unit: list[float]) -> float:
        return min(value / abs(part) for value, part in zip(limits, unit, strict=True) if part)

    acceleration = [limit(axes.accelerations, unit) for _, unit in blocks]
    rate = [min(speed, limit(axes.rates, unit)) for _, unit in blocks]
    entry = [0.0]
    for k, ((_, first), (_, second)) in enumerate(pairwise(blocks)):
        cosine = -sum(a * b for a, b in zip(first, second, strict=True))
        squared = min(rate[k], rate[k + 1]) ** 2
        if cosine > 0.999999:
            squared = 0.0
        elif cosine > -0.999999:
            change = [b - a for a, b in zip(first, second, strict=True)]
            size = math.hypot(*change)
            sine = math.sqrt(0.5 * (1 - cosine))
            across = limit(axes.accelerations, [part / size for part in change])
            squared = min(squared, across * deviation * sine / (1 - sine))
        entry.append(squared)
    spent = []
    squared_speed = 0.0
    for k, (length, _) in enumerate(blocks):
        stoppable = 0.0
        for j in reversed(range(k + 1, min(k + 1 + known, len(blocks)))):
            stoppable = min(entry[j], stoppable + 2 * acceleration[j] * blocks[j][0])
        next_squared = min(stoppable, squared_speed + 2 * acceleration[k] * length)
        peak = math.sqrt(
            min(rate[k] ** 2, (squared_speed + next_squared) / 2 + acceleration[k] * length)
        )
        cruise = length - (2 * peak**2 - squared_speed - next_squared) / (2 * acceleration[k])
        ramps = (2 * peak - math.sqrt(squared_speed) - math.sqrt(next_squared)) / acceleration[k]
        spent.append(ramps + max(cruise, 0.0) / peak)
        squared_speed = next_squared
    return spent


def time_lines(points: list[Point], speed: float, dynamics: Dynamics) -> list[float]:
    """Seconds of each line between points, with a stop at the end."""
    ends = np.array(points)
    count = len(points) - 1
    via, speeds = np.full((count, 3), np.nan), np.full(count, speed)
    stops = np.arange(count) == count - 1
    spent: list[float] = time_blocks(
        Motions(ends[:-1], ends[1:], via, speeds, stops), dynamics
    ).tolist()
    return spent


steps = st.lists(
    st.tuples(st.floats(0.02, 8), st.floats(-2, 2), st.floats(-0.5, 0.5)), min_size=1, max_size=60
)


def make_points(steps: list[tuple[float, float, float]]) -> list[Point]:
    points, heading = [(0.0, 0.0, 0.0)], 0.0
    for length, change, rise in steps:
        heading += change
        x, y, z = points[-1]
        points.append(
            (x + length * math.cos(heading), y + length * math.sin(heading), z + length * rise)
        )
    return points


@given(steps, st.floats(1, 100))
def test_times_of_lines_agree_with_a_loop_over_blocks(
    rows: list[tuple[float, float, float]], speed: float
) -> None:
    points = make_points(rows)
    expected = plan_by_loop(points, speed, AXES, 0.01)
    assert sum(time_lines(points, speed, make_dynamics("grbl"))) == pytest.approx(
        sum(expected), rel=1e-6
    )


def test_short_blocks_are_limited_by_the_look_ahead_buffer() -> None:
    # 300 lines of 0.05 mm straight on at 10 mm/s2: the machine must be able to stop within 14 of
    # them, 0.7 mm, so that it never runs faster than sqrt(2 * 10 * 0.7) = 3.74 mm/s.
    axes = Axes((100.0,) * 3, (10.0,) * 3)
    points = [(0.05 * k, 0.0, 0.0) for k in range(301)]
    spent = time_lines(points, 50.0, make_dynamics("grbl", axes))
    assert spent == pytest.approx(plan_by_loop(points, 50.0, axes, 0.01), rel=1e-6)
    # 14 blocks are known when a block is entered. In its middle the machine may be a little faster.
    top = math.sqrt(2 * 10 * 0.05 * LOOK_AHEAD)
    assert 0.05 / top > spent[150] > 0.05 / math.sqrt(2 * 10 * 0.05 * (LOOK_AHEAD + 1))
    # One line of this length takes far less time.
    assert (
        sum(spent) > 1.5 * time_lines([points[0], points[-1]], 50.0, make_dynamics("grbl", axes))[0]
    )


def test_grbl_runs_an_arc_as_chords() -> None:
    # Half a circle of R 3 mm: a chord that deviates by 0.002 mm has the length
    # 2 sqrt(0.002 (6 - 0.002)) = 0.219 mm; 9.42 / 0.219 is 43, rounded down.
    count = math.floor(math.pi * 3 / (2 * math.sqrt(0.002 * (2 * 3 - 0.002))))
    assert count == 43
    angles = [math.pi * (1 - k / count) for k in range(count + 1)]
    points = [(3 + 3 * math.cos(angle), 3 * math.sin(angle), 0.0) for angle in angles]
    expected = sum(plan_by_loop(points, 100.0, AXES, 0.01))
    spent = seconds(MoveC(make_pose(3, 3), make_pose(6, 0), 100.0), dynamics=make_dynamics("grbl"))
    assert sum(spent) == pytest.approx(expected, rel=1e-6)


def test_chords_run_faster_than_the_acceleration_across_an_arc() -> None:
    # On an arc of R 3 mm v^2 = a r allows 38.7 mm/s at 500 mm/s2. The junctions of its chords allow
    # five times the square, 0.01 mm / 0.002 mm.
    dynamics = Dynamics(acceleration=500.0, corner="junction", deviation=0.01)
    spent = seconds(MoveC(make_pose(3, 3), make_pose(6, 0), 50.0), dynamics=dynamics)
    assert sum(spent) == pytest.approx(math.pi * 3 / 50 + 50 / 500, rel=1e-3)


def test_positions_are_rounded_to_whole_steps() -> None:
    # 2 steps/mm: 0.6 mm becomes 0.5, 1.26 becomes 1.5, 1.3 stays there and takes no time.
    coarse = Axes(AXES.rates, AXES.accelerations, (2.0, 2.0, 2.0))
    points = [(0.0, 0.0, 0.0), (0.6, 0.0, 0.0), (0.6, 1.26, 0.0), (0.6, 1.3, 0.0)]
    expected = plan_by_loop([(0.0, 0.0, 0.0), (0.5, 0.0, 0.0), (0.5, 1.5, 0.0)], 20.0, AXES, 0.01)
    spent = time_lines(points, 20.0, make_dynamics("grbl", coarse))
    assert spent == pytest.approx([*expected, 0.0])


def test_long_programs_are_planned_from_stop_to_stop(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(7)
    ends = np.cumsum(rng.uniform(-2, 2, (400, 3)), axis=0)
    start = np.vstack([np.zeros(3), ends[:-1]])
    stops = rng.uniform(size=400) < 0.1
    stops[-1] = True
    motions = Motions(start, ends, np.full((400, 3), np.nan), np.full(400, 30.0), stops)
    whole_program = time_blocks(motions, make_dynamics("grbl"))
    monkeypatch.setattr(blocks, "_STRETCH", 25)
    assert time_blocks(motions, make_dynamics("grbl")) == pytest.approx(whole_program)
