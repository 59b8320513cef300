"""Arm tours of a flat part: the time of the joints decides rolls, postures and the order."""

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
from tests.order.test_arm_flow import locate_tip
from tests.support.built import build

PARTS = Path(__file__).parents[2] / "fixtures" / "parts"
CELL = {"robot": "IRB 1200", "base_from_work": [450, -60, 0, 0, 0, 0]}
Tables = dict[str, dict[str, object]]


@pytest.fixture(scope="module")
def panel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return robotsp.draw(robotsp.make_holes(), tmp_path_factory.mktemp("panel"))


def drill_panel(panel: Path, post: str = "rapid", **tool: object) -> Result:
    job = robotsp.make_job([])
    job["tool"] = {**job["tool"], "symmetric": False, **tool}  # type: ignore[dict-item]
    return build(panel, post=post, job=job)


def trace_bracket(post: str = "rapid", **tables: dict[str, object]) -> Result:
    job: Tables = {
        "cell": CELL,
        "operation": {"kind": "trace"},
        "tool": {"symmetric": True},
        **tables,
    }
    return build(PARTS / "bracket.dxf", post=post, job=job)


def list_poses(result: Result) -> list[Pose]:
    return [m.target for m in result.program.columns.moves if isinstance(m, (MoveL, MoveC))]


def measure_roll(pose: Pose) -> float:
    """Roll of a tool that points down, deg; 0 if its x axis is that of the work frame."""
    return math.degrees(math.atan2(-pose.rotation[1, 0], pose.rotation[0, 0])) * -1


@pytest.mark.parametrize("tool", [{"symmetric": True}, {"turn": [-90, 90, 45]}])
def test_a_roll_changes_neither_the_path_of_the_tip_nor_the_tool_axis(
    tool: dict[str, object],
) -> None:
    free, fixed = trace_bracket(tool=tool), trace_bracket(tool={})
    assert isinstance(free.tour, ArmTour)
    for pose in list_poses(free):
        np.testing.assert_allclose(pose.rotation[:, 2], [0, 0, -1], atol=1e-12)
    drawn = np.concatenate([contour.points for contour in free.part.contours]).round(6)
    for result in (free, fixed):
        origins = np.array([pose.origin for pose in list_poses(result)]).round(6)
        assert set(map(tuple, drawn.tolist())) <= set(map(tuple, origins[:, :2].tolist()))


@pytest.mark.parametrize("post", ["rapid", "pacscript"])
def test_the_joint_values_of_the_text_give_its_poses_and_have_no_jump(post: str) -> None:
    result = trace_bracket(post, process={"clearance": 15})
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


def test_only_rolls_that_the_tool_has_are_chosen() -> None:
    result = trace_bracket(tool={"turn": [-100, 190, 60]})
    allowed = {-60.0, 0.0, 60.0, 120.0, 180.0, -180.0}
    assert {round(measure_roll(pose), 6) for pose in list_poses(result)} <= allowed
    assert isinstance(result.tour, ArmTour)
    rolls = np.degrees(np.concatenate(result.tour.rolls)).round(6)
    assert set(rolls.tolist()) <= allowed


def test_holes_out_of_reach_with_the_fixed_roll_are_reached_with_others(panel: Path) -> None:
    with pytest.raises(NoSafeProgram):
        drill_panel(panel)
    free = drill_panel(panel, symmetric=True)
    assert robotsp.count_missed(robotsp.list_joints(free), robotsp.make_holes()) == 0
    assert not [note for note in free.notes if note.kind == "skipped"]


def test_the_drill_is_read_back_from_pacscript_too(panel: Path) -> None:
    free = drill_panel(panel, "pacscript", symmetric=True)
    assert robotsp.count_missed(robotsp.list_joints(free), robotsp.make_holes()) == 0
    assert free.deviation.max_mm < 0.01


def test_the_seconds_of_the_links_are_those_of_their_joints(panel: Path) -> None:
    free = drill_panel(panel, symmetric=True)
    assert isinstance(free.tour, ArmTour)
    _, execution = robotsp.measure(robotsp.list_joints(free))
    assert free.tour.seconds == pytest.approx(execution, rel=1e-6)


def test_the_tip_stays_above_the_part_between_the_paths() -> None:
    result = trace_bracket(process={"clearance": 20, "approach": 2})
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
            lowest = locate_tip(program, arm, rows)[:, 2].min()
            assert lowest > 2 - 0.1 or move is moves[-1]


def measure_link_seconds(result: Result) -> float:
    """Time of the joints on all links of a program, s."""
    arm = find_robot("VS-060")
    moves = result.program.columns.moves
    total = 0.0
    for before, move in pairwise(moves):
        if not move.work:
            turns = np.subtract(*((m.joints or m.target).values for m in (before, move)))
            total += float((np.abs(turns) / arm.speeds).max())
    return total


def test_the_order_by_time_takes_at_most_the_time_of_the_order_by_length() -> None:
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
    assert measure_link_seconds(by_time) <= measure_link_seconds(by_length) + 1e-6


def test_without_a_robot_the_time_of_joints_does_not_decide_the_order() -> None:
    plain = camgen.build(PARTS / "bracket.dxf", post="rapid", job={"operation": {"kind": "trace"}})
    assert plain.tour.method != "joint time"


def test_holes_come_before_their_outline() -> None:
    result = trace_bracket(operation={"kind": "follow"})
    parents = {path.id: path.parent for path in result.planned}
    ids = [path.id for path in result.planned]
    order = [path.id for path in result.tour.paths]
    for name, parent in parents.items():
        if parent >= 0:
            assert order.index(name) < order.index(ids[parent])


def test_a_path_that_no_roll_reaches_is_left_out_alone() -> None:
    cell = {**CELL, "fixtures": [[60, 5, -5, 75, 25, 60]]}
    result = trace_bracket(cell=cell)
    skipped = set().union(*(note.ids for note in result.notes if note.kind == "skipped"))
    assert skipped
    planned = {path.id for path in result.planned}
    assert {path.id for path in result.tour.paths} == planned - skipped


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
def test_settings_that_an_arm_tour_cannot_have_are_refused(
    post: str,
    cell: dict[str, object],
    tool: dict[str, object],
    process: dict[str, object],
    where: str,
    what: str,
) -> None:
    job = {"cell": cell, "tool": tool, "process": process}
    with pytest.raises(JobError) as error:
        camgen.build(PARTS / "bracket.dxf", post=post, job=job)
    assert error.value.where == where
    assert what in error.value.what


@pytest.mark.parametrize("key", ["joint_speeds", "joint_accelerations"])
@pytest.mark.parametrize("values", [[1.0], [1, 1, 1, 1, 1, 0]])
def test_limits_of_joints_need_one_positive_value_per_joint(key: str, values: list[float]) -> None:
    with pytest.raises(CamgenError, match="6 joints"):
        trace_bracket(cell={**CELL, key: values})


def test_links_take_longer_with_slower_joints() -> None:
    slow = trace_bracket(cell={**CELL, "joint_speeds": [5.0] * 6}, process={"travel": 1000})
    fast = trace_bracket(process={"travel": 1000})
    assert slow.cycle.travel > 1.5 * fast.cycle.travel


def test_holes_of_an_outline_that_is_left_out_are_planned_without_it() -> None:
    planned = camgen.plan(camgen.read(PARTS / "bracket.dxf"), {"operation": {"kind": "follow"}})
    outline = next(path.id for path in planned.paths if path.parent < 0)
    left = leave_out_paths(planned, {outline: "a reason"})
    assert {path.id for path in left.paths} == {path.id for path in planned.paths} - {outline}
    assert all(path.parent == -1 for path in left.paths)
    assert [note.ids for note in left.notes if note.kind == "skipped"] == [(outline,)]
