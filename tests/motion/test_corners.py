"""Corners that a controller rounds by speed and acceleration, against two motions that are run at once."""

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
    """The way at times t of a motion from rest to rest, and when it begins to brake."""
    peak = min(speed, (length * acceleration) ** 0.5)
    ramp = peak / acceleration
    brake = length / peak
    rest = brake + ramp
    up = acceleration * np.minimum(t, ramp) ** 2 / 2
    along = peak * (np.clip(t, ramp, brake) - ramp)
    left = np.clip(rest - np.maximum(t, brake), 0, None)
    return up + along + acceleration * (ramp**2 - left**2) / 2, brake


def nearest_to_corner(
    turn: float, lengths: tuple[float, float], speeds: tuple[float, float], acceleration: float
):
    """How near the tool comes to the corner when the second motion begins as the first one begins to brake, mm."""
    _, brake = run_trapezoid(np.zeros(1), lengths[0], speeds[0], acceleration)
    t = brake + np.linspace(0, max(speeds) / acceleration, 4001)
    first, _ = run_trapezoid(t, lengths[0], speeds[0], acceleration)
    second, _ = run_trapezoid(np.maximum(t - brake, 0), lengths[1], speeds[1], acceleration)
    return float(np.abs(first - lengths[0] + second * np.exp(1j * turn)).min())


def chosen(
    turn: float, lengths: tuple[float, float], speeds: tuple[float, float], tolerance: float
) -> float:
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
def test_where_it_does_not_stop_the_tool_stays_near_the_corner(
    turn, lengths, speeds, tolerance
) -> None:
    if chosen(turn, lengths, speeds, tolerance):
        assert nearest_to_corner(turn, lengths, speeds, 5000.0) <= tolerance * 1.01 + 1e-4


@pytest.mark.parametrize("turn", [0.3, np.pi / 2, 2.5, np.pi])
@pytest.mark.parametrize("speed", [20.0, 60.0, 150.0])
def test_it_stops_where_it_would_leave_the_corner_and_nowhere_else(
    turn: float, speed: float
) -> None:
    lengths, speeds = (30.0, 30.0), (speed, speed)
    off = nearest_to_corner(turn, lengths, speeds, 5000.0)
    assert off == pytest.approx(speed**2 / 1e4 * np.sin(turn / 2) / 2, rel=0.02, abs=1e-4)
    assert chosen(turn, lengths, speeds, off * 1.05) == pytest.approx(speed**2 / 1e4, abs=1e-3)
    assert chosen(turn, lengths, speeds, off * 0.95) == 0.0


def stops(text: str) -> tuple[int, int]:
    """Pen-down motions of a V+ text, and how many of them end in BREAK."""
    down = [part.split("SIGNAL -33")[0] for part in text.split("SIGNAL 33\n")[1:]]
    return sum(part.count("MOVES ") for part in down), sum(part.count("BREAK") for part in down)


def test_a_fill_stops_where_the_pen_comes_up_and_nowhere_else() -> None:
    result = build(PARTS / "copper.dxf", post="vplus", job=FILL)
    down = [path for path in result.tour.paths if len(path.position) > 1]
    moves, found = stops(result.text)
    assert found == len(down)
    assert moves > 150
    # At three times the feed corners are rounded nine times as far, at half the acceleration twice.
    counts = [
        stops(build(PARTS / "copper.dxf", post="vplus", job=FILL | more).text)[1]
        for more in (
            {"process": {"feed": 60}},
            {"process": {"feed": 60}, "post": {"accel": 50}},
            {"process": {"feed": 60, "acceleration": 20000}},
            {"tolerance": {"corner": 0}},
            {"tolerance": {"corner": 0.2}, "process": {"feed": 60}},
        )
    ]
    assert found < counts[0] < counts[1] < counts[3]
    assert counts[2] == counts[4] == found


def test_rings_are_arcs_and_v_plus_gets_their_chords() -> None:
    rapid = build(PARTS / "copper.dxf", post="rapid", job=FILL).text
    assert len(re.findall(r"\bMoveC\b", rapid)) >= 10


@pytest.mark.parametrize(
    ("operation", "diameter", "tolerance", "expected"),
    [
        ("fill", 0.8, {}, 0.04), ("trace", 0.5, {}, 0.025), ("trace", 6.0, {}, 0.05), ("fill", 0.1, {}, 0.01),
        ("follow", 0.8, {}, 0.01), ("replay", 6.0, {"chord": 0.02}, 0.02), ("follow", 6.0, {"corner": 0.3}, 0.3),
        ("fill", 0.8, {"corner": 0}, 0.0),
    ],
)  # fmt: skip
def test_the_tolerance_is_a_share_of_the_pen(
    operation: str, diameter: float, tolerance, expected: float
) -> None:
    job = from_mapping({"tool": {"diameter": diameter}, "tolerance": tolerance})
    assert compute_corner_tolerance(job, operation) == pytest.approx(expected)


def test_zones_do_not_hang_on_the_speed() -> None:
    """Turns of 0.2 and 1.6 rad between lines of 30 mm."""
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
def test_an_acceleration_that_nobody_stated_is_told(key: str, value: float) -> None:
    table, _, name = key.partition(".")
    job: dict[str, dict[str, object]] = {"operation": {"kind": "trace"}}
    if key:
        job[table] = {name: value}
    gear = Path(__file__).parents[2] / "fixtures" / "parts" / "logo.svg"
    told = [
        note.what
        for note in camgen.build(gear, post="vplus", job=job).notes
        if "mm/s2" in note.what
    ]
    assert told == ([] if key else ["corners without a stop are rounded as at 5000 mm/s2"])
