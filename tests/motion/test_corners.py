"""Corners that depend on speed and acceleration, compared with two overlapping motions."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import camgen
from camgen.geometry.arcs import make_spans
from camgen.model.cell import Dynamics
from camgen.motion.corners import blend_corners, compute_corner_tolerance
from camgen.pipeline import build
from camgen.read.job_file import from_mapping

PARTS = Path(__file__).parents[2] / "fixtures" / "parts"
FILL = {"operation": {"kind": "fill"}, "tool": {"diameter": 0.85}}


def run_trapezoid(
    t: np.ndarray, length: float, speed: float, acceleration: float
) -> tuple[np.ndarray, float]:
    """Travel (N,), mm, of a motion from rest to rest at times t, and the start of its braking."""
    peak = min(speed, (length * acceleration) ** 0.5)
    ramp = peak / acceleration
    brake = length / peak
    end = brake + ramp
    ramp_up = acceleration * np.minimum(t, ramp) ** 2 / 2
    cruise = peak * (np.clip(t, ramp, brake) - ramp)
    remaining = np.clip(end - np.maximum(t, brake), 0, None)
    return ramp_up + cruise + acceleration * (ramp**2 - remaining**2) / 2, brake


def measure_corner_distance(
    turn: float, lengths: tuple[float, float], speeds: tuple[float, float], acceleration: float
):
    """Distance from the corner, mm, if the second motion starts when the first one brakes."""
    _, brake = run_trapezoid(np.zeros(1), lengths[0], speeds[0], acceleration)
    t = brake + np.linspace(0, max(speeds) / acceleration, 4001)
    first, _ = run_trapezoid(t, lengths[0], speeds[0], acceleration)
    second, _ = run_trapezoid(np.maximum(t - brake, 0), lengths[1], speeds[1], acceleration)
    return float(np.abs(first - lengths[0] + second * np.exp(1j * turn)).min())


def choose_blend(
    turn: float, lengths: tuple[float, float], speeds: tuple[float, float], tolerance: float
) -> float:
    """The blend of a corner between two lines, mm, on a controller that overlaps motions."""
    end = lengths[1] * np.exp(1j * turn)
    points = np.array([[-lengths[0], 0, 0], [0, 0, 0], [end.real, end.imag, 0]])
    lines = make_spans(points[:-1], np.full((2, 3), np.nan), points[1:])
    dynamics = Dynamics(5000.0, corner="overlap")
    return float(blend_corners(lines, np.array(speeds), tolerance, dynamics)[0])


@given(
    st.floats(0.05, np.pi),
    st.tuples(st.floats(0.05, 50), st.floats(0.05, 50)),
    st.tuples(st.floats(1, 300), st.floats(1, 300)),
    st.floats(0.002, 0.5),
)
def test_the_tool_keeps_the_tolerance_at_a_corner_without_a_stop(
    turn, lengths, speeds, tolerance
) -> None:
    if choose_blend(turn, lengths, speeds, tolerance):
        assert measure_corner_distance(turn, lengths, speeds, 5000.0) <= tolerance * 1.01 + 1e-4


@pytest.mark.parametrize("turn", [0.3, np.pi / 2, 2.5, np.pi])
@pytest.mark.parametrize("speed", [20.0, 60.0, 150.0])
def test_only_a_corner_beyond_the_tolerance_stops(turn: float, speed: float) -> None:
    lengths, speeds = (30.0, 30.0), (speed, speed)
    deviation = measure_corner_distance(turn, lengths, speeds, 5000.0)
    assert deviation == pytest.approx(speed**2 / 1e4 * np.sin(turn / 2) / 2, rel=0.02, abs=1e-4)
    assert choose_blend(turn, lengths, speeds, deviation * 1.05) == pytest.approx(
        speed**2 / 1e4, abs=1e-3
    )
    assert choose_blend(turn, lengths, speeds, deviation * 0.95) == 0.0


def count_stops(text: str) -> tuple[int, int]:
    """The number of motions of a V+ text with the pen down, and of those that end in BREAK."""
    parts = [part.split("SIGNAL -33")[0] for part in text.split("SIGNAL 33\n")[1:]]
    return sum(part.count("MOVES ") for part in parts), sum(part.count("BREAK") for part in parts)


def test_a_fill_stops_only_where_the_pen_is_lifted() -> None:
    result = build(PARTS / "copper.dxf", post="vplus", job=FILL)
    drawn = [path for path in result.tour.paths if len(path.position) > 1]
    moves, break_count = count_stops(result.text)
    assert break_count == len(drawn)
    assert moves > 150
    # Corners deviate nine times as far at three times the feed, and twice as far at half the
    # acceleration.
    counts = [
        count_stops(build(PARTS / "copper.dxf", post="vplus", job=FILL | tables).text)[1]
        for tables in (
            {"process": {"feed": 60}},
            {"process": {"feed": 60}, "post": {"accel": 50}},
            {"process": {"feed": 60, "acceleration": 20000}},
            {"tolerance": {"corner": 0}},
            {"tolerance": {"corner": 0.2}, "process": {"feed": 60}},
        )
    ]
    assert break_count < counts[0] < counts[1] < counts[3]
    assert counts[2] == counts[4] == break_count


def test_rings_of_a_fill_are_arcs_in_rapid() -> None:
    rapid = build(PARTS / "copper.dxf", post="rapid", job=FILL).text
    assert len(re.findall(r"\bMoveC\b", rapid)) >= 10


@pytest.mark.parametrize(
    ("operation", "diameter", "tolerance", "expected"),
    [
        ("fill", 0.8, {}, 0.04), ("trace", 0.5, {}, 0.025), ("trace", 6.0, {}, 0.05),
        ("fill", 0.1, {}, 0.01), ("follow", 0.8, {}, 0.01), ("replay", 6.0, {"chord": 0.02}, 0.02),
        ("follow", 6.0, {"corner": 0.3}, 0.3), ("fill", 0.8, {"corner": 0}, 0.0),
    ],
)  # fmt: skip
def test_the_default_corner_tolerance_depends_on_the_pen_and_the_operation(
    operation: str, diameter: float, tolerance, expected: float
) -> None:
    job = from_mapping({"tool": {"diameter": diameter}, "tolerance": tolerance})
    assert compute_corner_tolerance(job, operation) == pytest.approx(expected)


def test_zones_do_not_depend_on_the_speed() -> None:
    """The corners between lines of 30 mm have 0.2 and 1.6 rad."""
    directions = np.exp(1j * np.cumsum([0.0, 0.2, 1.6]))
    ends = np.append(0.0, np.cumsum(30 * directions))
    points = np.stack([ends.real, ends.imag, 0 * ends.real], axis=1)
    lines = make_spans(points[:-1], np.full((3, 3), np.nan), points[1:])
    for speed in (10.0, 500.0):
        blend = blend_corners(lines, np.full(3, speed), 0.05, Dynamics())
        assert blend.tolist() == [1.0, 0.0]


@pytest.mark.parametrize(
    ("key", "value"), [("", 0), ("process.acceleration", 3000), ("tolerance.corner", 0)]
)
def test_an_acceleration_that_is_not_set_is_noted(key: str, value: float) -> None:
    table, _, name = key.partition(".")
    job: dict[str, dict[str, object]] = {"operation": {"kind": "trace"}}
    if key:
        job[table] = {name: value}
    gear = Path(__file__).parents[2] / "fixtures" / "parts" / "logo.svg"
    messages = [
        note.what
        for note in camgen.build(gear, post="vplus", job=job).notes
        if "mm/s2" in note.what
    ]
    assert messages == ([] if key else ["corners without a stop are rounded as at 5000 mm/s2"])
