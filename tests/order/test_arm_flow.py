"""Ways that an arm chooses between paths of a flat part are as quick as its joints, and stop where they must."""

from itertools import pairwise
from pathlib import Path

import ezdxf
import numpy as np
import pytest

import camgen
from bench.robots import robotsp
from camgen.check.flow import _keeps_above
from camgen.check.passing import find_corners, trace_motions
from camgen.model.pose import Pose
from camgen.model.program import MoveJ, Output
from camgen.pipeline import Result
from camgen.robots.catalogue import find_robot
from camgen.robots.kinematics.forward import compute_flange
from tests.support.built import build

CELL = {
    "robot": "IRB 1200",
    "base_from_work": [450, -60, 0, 0, 0, 0],
    "fixtures": [[48, -80, -5, 52, 140, 45]],
}
PLACES = [(x, y) for x in (0.0, 100.0) for y in (0.0, 30.0, 60.0)]


@pytest.fixture(scope="module")
def holes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """On both sides of a wall."""
    document = ezdxf.new("R2010", units=4)
    for x, y in PLACES:
        document.modelspace().add_circle((x, y), 2.0)
    file = tmp_path_factory.mktemp("flow") / "holes.dxf"
    document.saveas(file)
    return file


def drilled(
    part: Path, post: str = "rapid", kind: str = "drill", depth: float = 0.0, **process: object
) -> Result:
    job: dict[str, dict[str, object]] = {
        "cell": dict(CELL),
        "operation": {"kind": kind, "depth": depth},
        "tool": {"symmetric": True, "diameter": 4.0},
        "process": process,
    }
    return build(part, post=post, job=job)


def test_a_corner_whose_inside_comes_down_to_the_part_is_not_cut(holes: Path) -> None:
    """The tool hangs down and swings: it is lowest half-way, below all three corners of what a rounding may sweep."""
    program, arm = drilled(holes).program, find_robot("IRB 1200")
    hanging, swing = np.array([0.0, 0, 0, 0, np.pi / 2, 0]), np.array([0.0, 0, 0, 0, 0.5, 0])
    fan = np.array([[hanging - swing, hanging + swing, hanging + swing + [0, -0.1, 0, 0, 0, 0]]])

    def height(joints: np.ndarray) -> float:
        rotation, origin = compute_flange(arm, joints[None])
        return float(
            (origin + rotation @ program.flange_from_tool.origin - program.base_from_work.origin)[
                0, 2
            ]
        )

    lowest, least = height(hanging), min(height(corner) for corner in fan[0])
    assert lowest < least - 5
    assert not _keeps_above(program, arm, fan, least - 1)
    assert _keeps_above(program, arm, fan, lowest - 1)


def test_ways_are_faster_than_a_speed_of_travel_of_100(holes: Path) -> None:
    fast, slow = drilled(holes), drilled(holes, travel=100.0)
    for result, most in ((fast, None), (slow, 100.0)):
        ways = [m for m in result.program.columns.moves[1:-1] if isinstance(m, MoveJ)]
        assert len(ways) >= len(PLACES)
        assert all(0 < m.share <= 1 for m in ways)
        if most is not None:
            assert {m.speed for m in ways} == {most}
    assert fast.cycle.total < 0.8 * slow.cycle.total


def test_joints_that_a_job_holds_back_are_held_back_there(holes: Path) -> None:
    held = np.radians([20.0] * 6)
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
            way = np.abs(np.subtract(*((m.joints or m.target).values for m in (move, before))))
            seconds = (way / speeds).max() / move.share
            assert (way / seconds <= held * (1 + 1e-6)).all()


@pytest.mark.parametrize("post", ["rapid", "pacscript", "vplus"])
def test_corners_in_the_air_are_passed_and_contacts_are_not(holes: Path, post: str) -> None:
    result = drilled(holes, post)
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
            # Of a line down from the height of travel, 20 mm, no more than its upper half is rounded off.
            if isinstance(move.target, Pose):
                assert move.target.origin[2] == pytest.approx(20.0)
                assert move.blend <= 10.0


def test_the_tip_keeps_up_where_corners_are_rounded(holes: Path) -> None:
    """A parabola as wide as RAPID turns the tool in a zone: no body stands for the flat part where that is tested."""
    result = drilled(holes, kind="trace", depth=5.0, clearance=12.0, switch="contact")
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
            way = trace.travelled[rows] - trace.travelled[rows.start]
            share = min(1.5 * program.columns.blend[k] / way[-1], 0.5)
            at = (1 - share if back else share) * way[-1]
            ends.append(
                np.array([np.interp(at, way, column) for column in result.reach.joints[rows].T])
            )
        corner = result.reach.joints[trace.rows(k).stop - 1]
        joints = (1 - t) ** 2 * ends[0] + 2 * t * (1 - t) * corner + t**2 * ends[1]
        rotation, origin = compute_flange(arm, joints)
        tip = (
            origin
            + rotation @ np.asarray(program.flange_from_tool.origin)
            - program.base_from_work.origin
        )
        assert tip[:, 2].min() >= 6.0 - 0.1


def test_a_mark_that_is_reached_at_the_height_of_travel_is_reached(tmp_path: Path) -> None:
    """Nothing tells a contact from a way there but that the next motion is of another hole."""
    result = camgen.build(
        robotsp.draw(robotsp.make_holes(), tmp_path), post="rapid", job=robotsp.make_job([])
    )
    columns = result.program.columns
    last = np.append(columns.path[1:] != columns.path[:-1], True)
    assert not columns.blend[last].any()


def test_a_tool_that_keeps_its_turn_flows_where_it_chooses_its_ways(holes: Path) -> None:
    job = {"cell": CELL, "operation": {"kind": "drill"}, "tool": {"diameter": 4.0}}
    result = camgen.build(holes, post="rapid", job=job)
    assert (result.program.columns.blend > 0).any()
