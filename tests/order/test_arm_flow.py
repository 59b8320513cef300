"""Links of an arm between the paths of a flat part use the speed of its joints.

Corners of links are blended, and contacts with the part are exact stops.
"""

from itertools import pairwise, product
from pathlib import Path

import numpy as np
import pytest

import camgen
from bench.robots import robotsp
from camgen.check.flow import _keeps_above
from camgen.check.passing import find_corners, trace_motions
from camgen.model.pose import FloatArray, Pose
from camgen.model.program import MoveJ, Output, Program
from camgen.pipeline import Result
from camgen.robots.catalogue import find_robot
from camgen.robots.kinematics.forward import compute_flange
from camgen.robots.models import Robot
from tests.order.test_arm_margin import draw_holes
from tests.support.built import build

CELL = {
    "robot": "IRB 1200",
    "base_from_work": [450, -60, 0, 0, 0, 0],
    "fixtures": [[48, -80, -5, 52, 140, 45]],
}
PLACES = list(product((0.0, 100.0), (0.0, 30.0, 60.0)))


@pytest.fixture(scope="module")
def holes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A drawing of six holes, three on each side of a wall."""
    return draw_holes(tmp_path_factory.mktemp("flow"), PLACES)


def locate_tip(program: Program, arm: Robot, joints: FloatArray) -> FloatArray:
    """Position of the TCP for each row of joint values, mm, (N, 3), relative to the work origin."""
    rotation, origin = compute_flange(arm, joints)
    tool = rotation @ np.asarray(program.flange_from_tool.origin)
    return np.asarray(origin + tool - program.base_from_work.origin)


def drill(
    part: Path, post: str = "rapid", kind: str = "drill", depth: float = 0.0, **process: object
) -> Result:
    job: dict[str, dict[str, object]] = {
        "cell": dict(CELL),
        "operation": {"kind": kind, "depth": depth},
        "tool": {"symmetric": True, "diameter": 4.0},
        "process": process,
    }
    return build(part, post=post, job=job)


def test_a_blend_that_would_lower_the_tool_to_the_part_is_refused(holes: Path) -> None:
    """The tool points down and swings about one axis.

    It is lowest half-way, where it is lower than at the three corners of the blend.
    """
    program, arm = drill(holes).program, find_robot("IRB 1200")
    hanging, swing = np.array([0.0, 0, 0, 0, np.pi / 2, 0]), np.array([0.0, 0, 0, 0, 0.5, 0])
    fan = np.array([[hanging - swing, hanging + swing, hanging + swing + [0, -0.1, 0, 0, 0, 0]]])

    def height(joints: np.ndarray) -> float:
        return float(locate_tip(program, arm, joints[None])[0, 2])

    lowest, lowest_corner = height(hanging), min(height(corner) for corner in fan[0])
    assert lowest < lowest_corner - 5
    assert not _keeps_above(program, arm, fan, lowest_corner - 1)
    assert _keeps_above(program, arm, fan, lowest - 1)


def test_links_are_faster_than_a_travel_speed_of_100(holes: Path) -> None:
    fast, slow = drill(holes), drill(holes, travel=100.0)
    for result, speed in ((fast, None), (slow, 100.0)):
        links = [m for m in result.program.columns.moves[1:-1] if isinstance(m, MoveJ)]
        assert len(links) >= len(PLACES)
        assert all(0 < m.share <= 1 for m in links)
        if speed is not None:
            assert {m.speed for m in links} == {speed}
    assert fast.cycle.total < 0.8 * slow.cycle.total


def test_links_keep_the_joint_speeds_of_the_job(holes: Path) -> None:
    limit = np.radians([20.0] * 6)
    job = {
        "cell": {**CELL, "joint_speeds": [20.0] * 6},
        "operation": {"kind": "drill"},
        "tool": {"symmetric": True, "diameter": 4.0},
    }
    result = camgen.build(holes, post="rapid", job=job)
    speeds = find_robot("IRB 1200").speeds
    moves = result.program.columns.moves
    for before, move in list(pairwise(moves))[:-1]:
        if isinstance(move, MoveJ):
            turns = np.abs(np.subtract(*((m.joints or m.target).values for m in (move, before))))
            seconds = (turns / speeds).max() / move.share
            assert (turns / seconds <= limit * (1 + 1e-6)).all()


@pytest.mark.parametrize("post", ["rapid", "pacscript", "vplus"])
def test_corners_in_the_air_are_blended_and_contacts_are_exact_stops(
    holes: Path, post: str
) -> None:
    result = drill(holes, post)
    columns = result.program.columns
    touched = {
        tuple(np.round(m.target.origin, 6))
        for m in columns.moves
        if isinstance(m.target, Pose) and m.blend == 0
    }
    assert {(x, y, 0.0) for x, y in PLACES} <= touched
    assert (columns.blend > 0).sum() >= len(PLACES)
    assert any("passed without a stop" in note.what for note in result.notes)
    corners = set(find_corners(result.program).tolist())
    for k, move in enumerate(columns.moves):
        if move.blend > 0:
            assert k in corners
            assert not move.work
            assert not isinstance(result.program.body[int(columns.at[k]) + 1], Output)
            # A line down from the clearance height, 20 mm, is blended in its upper half only.
            if isinstance(move.target, Pose):
                assert move.target.origin[2] == pytest.approx(20.0)
                assert move.blend <= 10.0


def test_the_tip_keeps_its_height_in_blended_corners(holes: Path) -> None:
    """The corner path is a parabola as wide as the zone in which RAPID reorients the tool.

    The scene has no body for the flat part, so the height of the tip is tested here.
    """
    result = drill(holes, kind="trace", depth=5.0, clearance=12.0, switch="contact")
    assert result.reach is not None
    arm, program = find_robot("IRB 1200"), result.program
    trace = trace_motions(program, result.reach, arm)
    corners = np.flatnonzero((program.columns.blend > 0) & ~program.columns.works)
    assert len(corners)
    t = np.linspace(0.0, 1.0, 21)[:, None]
    for k in corners.tolist():
        ends = []
        for motion, back in ((k, True), (k + 1, False)):
            rows = trace.rows(motion)
            along = trace.travelled[rows] - trace.travelled[rows.start]
            share = min(1.5 * program.columns.blend[k] / along[-1], 0.5)
            at = (1 - share if back else share) * along[-1]
            ends.append(
                np.array([np.interp(at, along, column) for column in result.reach.joints[rows].T])
            )
        corner = result.reach.joints[trace.rows(k).stop - 1]
        joints = (1 - t) ** 2 * ends[0] + 2 * t * (1 - t) * corner + t**2 * ends[1]
        assert locate_tip(program, arm, joints)[:, 2].min() >= 6.0 - 0.1


def test_a_mark_at_the_clearance_height_is_an_exact_stop(tmp_path: Path) -> None:
    """Only the next motion, which belongs to another hole, distinguishes the mark from a link."""
    result = camgen.build(
        robotsp.draw(robotsp.make_holes(), tmp_path), post="rapid", job=robotsp.make_job([])
    )
    columns = result.program.columns
    last = np.append(columns.path[1:] != columns.path[:-1], True)
    assert not columns.blend[last].any()


def test_links_of_a_tool_with_a_fixed_roll_are_blended(holes: Path) -> None:
    job = {"cell": CELL, "operation": {"kind": "drill"}, "tool": {"diameter": 4.0}}
    result = camgen.build(holes, post="rapid", job=job)
    assert (result.program.columns.blend > 0).any()
