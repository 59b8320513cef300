"""An arm that chooses turns, postures and the order of a flat part by the time of its joints."""

import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import camgen
from bench.robots import robotsp
from camgen.geometry.rotations import measure_angles_between
from camgen.model.errors import CamgenError, JobError, NoSafeProgram
from camgen.model.pose import Pose
from camgen.model.program import MoveC, MoveJ, MoveL
from camgen.order import ArmTour
from camgen.pipeline import Result
from camgen.plan.leave_out import leave_out_paths
from camgen.robots.catalogue import find_robot
from camgen.robots.kinematics.forward import compute_flange
from tests.support.built import build

PARTS = Path(__file__).parents[2] / "fixtures" / "parts"
CELL = {"robot": "IRB 1200", "base_from_work": [450, -60, 0, 0, 0, 0]}
Tables = dict[str, dict[str, object]]


@pytest.fixture(scope="module")
def panel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return robotsp.draw(robotsp.make_holes(), tmp_path_factory.mktemp("panel"))


def drilled(panel: Path, post: str = "rapid", **tool: object) -> Result:
    made = robotsp.make_job([])
    made["tool"] = {**made["tool"], "symmetric": False, **tool}  # type: ignore[dict-item]
    return build(panel, post=post, job=made)


def traced(post: str = "rapid", **tables: dict[str, object]) -> Result:
    job: Tables = {
        "cell": CELL,
        "operation": {"kind": "trace"},
        "tool": {"symmetric": True},
        **tables,
    }
    return build(PARTS / "bracket.dxf", post=post, job=job)


def poses(result: Result) -> list[Pose]:
    return [m.target for m in result.program.columns.moves if isinstance(m, (MoveL, MoveC))]


def turn_of(pose: Pose) -> float:
    """deg about the tool's axis from straight down with x along the work's x."""
    return math.degrees(math.atan2(-pose.rotation[1, 0], pose.rotation[0, 0])) * -1


@pytest.mark.parametrize("tool", [{"symmetric": True}, {"turn": [-90, 90, 45]}])
def test_turning_about_the_axis_leaves_the_tip_and_the_axis_where_they_are(
    tool: dict[str, object],
) -> None:
    free, fixed = traced(tool=tool), traced(tool={})
    assert isinstance(free.tour, ArmTour)
    for pose in poses(free):
        np.testing.assert_allclose(pose.rotation[:, 2], [0, 0, -1], atol=1e-12)
    lines = [
        {(round(x, 6), round(y, 6)) for x, y, _ in (p.origin for p in poses(r))}
        for r in (free, fixed)
    ]
    drawn = {
        (round(x, 6), round(y, 6))
        for x, y in np.concatenate([c.points for c in free.part.contours]).tolist()
    }
    assert drawn <= lines[0]
    assert drawn <= lines[1]


@pytest.mark.parametrize("post", ["rapid", "pacscript"])
def test_the_joints_of_the_text_lead_to_its_poses_and_go_on_without_a_jump(post: str) -> None:
    result = traced(post, process={"clearance": 15})
    arm, program = find_robot("IRB 1200"), result.program
    moves = [m for m in program.columns.moves if isinstance(m.target, Pose)]
    rotation, origin = compute_flange(arm, np.array([m.joints.values for m in moves]))
    tips = (
        origin + rotation @ np.asarray(program.flange_from_tool.origin)
    ) - program.base_from_work.origin
    np.testing.assert_allclose(tips, [m.target.origin for m in moves], atol=1e-6)
    turned = rotation @ program.flange_from_tool.rotation
    assert measure_angles_between(turned, np.stack([m.target.rotation for m in moves])).max() < 1e-6
    assert result.reach is not None
    assert np.abs(np.diff(result.reach.joints, axis=0)).max() <= math.radians(30) + 1e-9


def test_only_turns_that_the_tool_has_are_chosen() -> None:
    result = traced(tool={"turn": [-100, 190, 60]})
    asked = {-60.0, 0.0, 60.0, 120.0, 180.0, -180.0}
    assert {round(turn_of(pose), 6) for pose in poses(result)} <= asked
    assert isinstance(result.tour, ArmTour)
    assert {
        round(math.degrees(turn), 6) for turns in result.tour.rolls for turn in turns.tolist()
    } <= asked


def test_holes_out_of_reach_at_the_fixed_turn_are_reached_with_others(panel: Path) -> None:
    with pytest.raises(NoSafeProgram):
        drilled(panel)
    free = drilled(panel, symmetric=True)
    assert robotsp.count_missed(robotsp.list_joints(free), robotsp.make_holes()) == 0
    assert not [note for note in free.notes if note.kind == "skipped"]


def test_the_drill_is_read_back_from_pacscript_too(panel: Path) -> None:
    free = drilled(panel, "pacscript", symmetric=True)
    assert robotsp.count_missed(robotsp.list_joints(free), robotsp.make_holes()) == 0
    assert free.deviation.max_mm < 0.01


def test_seconds_of_the_ways_are_those_of_their_joints(panel: Path) -> None:
    free = drilled(panel, symmetric=True)
    assert isinstance(free.tour, ArmTour)
    _, execution = robotsp.measure(robotsp.list_joints(free))
    assert free.tour.seconds == pytest.approx(execution, rel=1e-6)


def test_the_tip_keeps_above_the_part_between_the_paths() -> None:
    result = traced(process={"clearance": 20, "approach": 2})
    arm, program = find_robot("IRB 1200"), result.program
    moves = program.columns.moves
    for before, move in pairwise(moves):
        if (
            isinstance(move, MoveJ)
            and not isinstance(move.target, Pose)
            and before.joints is not None
        ):
            share = np.linspace(0, 1, 50)[:, None]
            rows = (
                np.array(before.joints.values) * (1 - share) + np.array(move.target.values) * share
            )
            rotation, origin = compute_flange(arm, rows)
            tip = (
                origin
                + rotation @ np.asarray(program.flange_from_tool.origin)
                - program.base_from_work.origin
            )
            assert tip[:, 2].min() > 2 - 0.1 or move is moves[-1]


def seconds_of(result: Result) -> float:
    """The joints' time between the paths, from the program: all lines at the height of travel."""
    arm = find_robot("VS-060")
    moves = result.program.columns.moves
    ways = [(a, b) for a, b in pairwise(moves) if not b.work]
    total = 0.0
    for a, b in ways:
        one, other = ((m.joints or m.target).values for m in (a, b))
        total += float((np.abs(np.subtract(one, other)) / arm.speeds).max())
    return total


def test_the_order_by_time_is_no_slower_than_the_order_by_length() -> None:
    cell = {"robot": "VS-060", "base_from_work": [330, -60, 150, 0, 0, 0]}
    job: Tables = {
        "cell": cell,
        "operation": {"kind": "drill"},
        "process": {"travel": 2000, "signal": ""},
    }
    drawing = PARTS / "plate.dxf"
    by_time = camgen.build(drawing, post="pacscript", job=job)
    by_length = camgen.build(drawing, post="pacscript", job={**job, "tour": {"method": "nearest"}})
    assert by_time.tour.method == "joint time"
    assert {p.id for p in by_time.tour.paths} == {p.id for p in by_length.tour.paths}
    assert seconds_of(by_time) <= seconds_of(by_length) + 1e-6


def test_without_a_robot_the_order_is_as_it_was() -> None:
    plain = camgen.build(PARTS / "bracket.dxf", post="rapid", job={"operation": {"kind": "trace"}})
    assert plain.tour.method != "joint time"


def test_holes_come_before_their_outline() -> None:
    result = traced(operation={"kind": "follow"})
    parents = {path.id: path.parent for path in result.planned}
    ids = [path.id for path in result.planned]
    order = [path.id for path in result.tour.paths]
    for name, parent in parents.items():
        if parent >= 0:
            assert order.index(name) < order.index(ids[parent])


def test_a_path_that_no_turn_reaches_costs_no_other_one() -> None:
    cell = {**CELL, "fixtures": [[60, 5, -5, 75, 25, 60]]}
    result = traced(cell=cell)
    lost = [name for note in result.notes if note.kind == "skipped" for name in note.ids]
    assert lost
    assert {path.id for path in result.tour.paths} == {path.id for path in result.planned} - set(
        lost
    )


REFUSED = [
    ("rapid", {}, {"symmetric": True}, {}, "tool.symmetric", "without an arm"),
    ("gcode", {}, {"turn": [-90, 90, 10]}, {}, "tool.turn", "a machine, which turns no tool"),
    ("rapid", CELL, {"symmetric": True, "turn": [-90, 90, 10]}, {}, "tool.turn", "any turn"),
    ("rapid", CELL, {"turn": [10, 90, 10]}, {}, "tool.turn", "not a range of turns"),
    ("rapid", CELL, {"turn": [-90, 90]}, {}, "tool.turn", "2 values"),
    ("rapid", CELL, {"turn": [-90, 90, 0]}, {}, "tool.turn", "not a range of turns"),
    (
        "rapid",
        CELL,
        {"symmetric": True, "orient": "follow"},
        {},
        "tool.symmetric",
        "turns with the contour",
    ),
    ("rapid", CELL, {"symmetric": True}, {"stay_down": True}, "process.stay_down", "lifted"),
    ("rapid", CELL, {}, {"clearance": 0}, "process.clearance", "height of the part"),
]


@pytest.mark.parametrize(("post", "cell", "tool", "process", "where", "what"), REFUSED)
def test_what_cannot_be_meant_is_refused(
    post: str,
    cell: dict[str, object],
    tool: dict[str, object],
    process: dict[str, object],
    where: str,
    what: str,
) -> None:
    with pytest.raises(JobError) as error:
        camgen.build(
            PARTS / "bracket.dxf", post=post, job={"cell": cell, "tool": tool, "process": process}
        )
    assert error.value.where == where
    assert what in error.value.what


@pytest.mark.parametrize("key", ["joint_speeds", "joint_accelerations"])
@pytest.mark.parametrize("values", [[1.0], [1, 1, 1, 1, 1, 0]])
def test_speeds_of_joints_are_one_for_each(key: str, values: list[float]) -> None:
    with pytest.raises(CamgenError, match="6 joints"):
        traced(cell={**CELL, key: values})


def test_joints_that_are_held_to_a_speed_take_longer() -> None:
    slow = traced(cell={**CELL, "joint_speeds": [5.0] * 6}, process={"travel": 1000})
    fast = traced(process={"travel": 1000})
    assert slow.cycle.travel > 1.5 * fast.cycle.travel


def test_a_path_that_is_left_out_gives_its_holes_to_what_is_around_it() -> None:
    planned = camgen.plan(camgen.read(PARTS / "bracket.dxf"), {"operation": {"kind": "follow"}})
    outline = next(path.id for path in planned.paths if path.parent < 0)
    left = leave_out_paths(planned, {outline: "a reason"})
    assert {path.id for path in left.paths} == {path.id for path in planned.paths} - {outline}
    assert all(path.parent == -1 for path in left.paths)
    assert [note.ids for note in left.notes if note.kind == "skipped"] == [(outline,)]
