"""Feeds that the joints of an arm cannot reach, on paths whose joint speeds are known by hand."""

import math
from pathlib import Path

import numpy as np
import pytest

import camgen
from camgen.check.feeds import bound_speed
from camgen.model.errors import JobError, NoSafeProgram
from camgen.robots import catalogue
from camgen.robots.kinematics.forward import compute_flange

RADIUS = 400.0
#: Product specification of the IRB 120: axis 1 has 250 deg/s, axis 6 420 deg/s.
AXIS_1 = math.radians(250.0)


def make_arc_job(feed, **tables):
    """The job of a circular arc about axis 1, with the tool straight down.

    Axis 1 rotates at feed / radius, axis 6 at as much in reverse. No other axis moves.
    """
    cell = {
        "robot": "IRB 120",
        "base_from_work": [0, 0, 200, 0, 0, 0],
        "flange_from_tool": [0, 0, 100, 0, 0, 0],
    }
    return {"cell": cell, "operation": {"kind": "trace"}, "process": {"feed": feed, **tables}}


def build_arc(feed, sweep=60.0):
    """Build an arc of `sweep` deg about axis 1."""
    angles = np.radians(np.linspace(-sweep / 2, sweep / 2, 361))
    chain = np.column_stack([RADIUS * np.cos(angles), RADIUS * np.sin(angles)])
    return camgen.build(camgen.part(chain), post="rapid", job=make_arc_job(feed))


def test_axis_1_limits_the_speed_on_a_circle_about_it():
    slow = build_arc(2000.0).slow
    assert len(slow) == 1
    assert slow[0].joint == 1
    assert slow[0].feed == 2000.0
    assert slow[0].speed == pytest.approx(RADIUS * AXIS_1, rel=1e-3)  # 1745 mm/s
    assert slow[0].share == pytest.approx(1.0)
    assert np.hypot(*slow[0].place[:2]) == pytest.approx(RADIUS, abs=0.1)


def test_a_feed_below_the_limit_of_the_joints_is_kept():
    result = build_arc(1700.0)
    assert result.slow == ()
    assert "slow_feeds" not in result.report


def test_the_note_names_the_path_its_position_and_the_axis():
    result = build_arc(2000.0)
    note = next(note for note in result.notes if "its feed" in note.what)
    assert note.kind == "warning"
    assert note.strict
    assert note.what.startswith("c1: its feed of 2000 mm/s falls to 174")
    assert "where axis 1 is at its maximum speed; 100 % of its length is slower" in note.what
    assert len(note.places) == 1
    row = result.report["slow_feeds"][0]
    assert (row["path"], row["axis"], row["share"]) == ("c1", 1, 1.0)
    line = camgen.part([(400, 0), (300, 200)])
    with pytest.raises(NoSafeProgram, match=r"--strict and c1: its feed of 2000 mm/s falls to"):
        camgen.build(line, post="rapid", job=make_arc_job(2000.0), strict=True)


def test_a_feed_beyond_all_joints_together_is_refused():
    job = {"cell": {"robot": "VS-060"}, "operation": {"kind": "trace"}, "process": {"feed": 6999}}
    with pytest.raises(NoSafeProgram) as caught:
        camgen.build(camgen.part([(0, 0), (40, 0)]), post="pacscript", job=job)
    message = str(caught.value)
    assert "asks for a feed of 6999 mm/s, and VS-060 moves its tool there at" in message
    assert "with all joints at full speed (lower process.feed, or the speed in" in message


def test_no_combination_of_joint_speeds_exceeds_the_bound():
    """The bound is the sum over all joints."""
    robot = catalogue.find_robot("IRB 120")
    rng = np.random.default_rng(1)
    flange_from_tcp = (0.0, 0.0, 100.0)
    joints = rng.uniform(-1.0, 1.0, (50, 6))
    rates = robot.fastest * rng.choice([-1.0, 1.0], (50, 6))

    def compute_tcp(values):
        rotation, origin = compute_flange(robot, values)
        return origin + rotation @ np.asarray(flange_from_tcp)

    step = 1e-6
    speed = np.linalg.norm(
        compute_tcp(joints + step * rates) - compute_tcp(joints - step * rates), axis=1
    )
    assert (speed / (2 * step) <= bound_speed(robot, joints, flange_from_tcp) * (1 + 1e-6)).all()


@pytest.mark.parametrize("key", ["feed", "plunge", "travel"])
def test_a_speed_beyond_all_controllers_is_refused(key):
    with pytest.raises(JobError, match=f"{key} must be a number > 0 and <= 7000"):
        camgen.job({"process": {key: 50000.0}})


SHARED = Path(__file__).parents[3] / "shared" / "data" / "cases"


@pytest.mark.skipif(not SHARED.is_dir(), reason="the shared data is not beside the repository")
def test_the_feed_near_a_singularity_falls_as_measured_independently():
    """Axis 4 would need 937 deg/s and has 320: 400 mm/s fall to 137 mm/s on 83 % of the line."""
    cell = {
        "robot": "IRB 120",
        "base_from_work": [500, 40, 600, 90, 0, -90],
        "flange_from_tool": [0, 0, 80, 0, 0, 0],
    }
    job = {"cell": cell, "operation": {"kind": "trace"}, "process": {"feed": 400}}
    slow = camgen.build(SHARED / "wall_e.dxf", post="rapid", job=job).slow
    assert [row.joint for row in slow] == [4]
    assert slow[0].speed == pytest.approx(400 * 320 / 937, rel=0.01)
    assert slow[0].share == pytest.approx(0.83, abs=0.01)
