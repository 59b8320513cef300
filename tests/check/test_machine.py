"""Travel limits of a machine with linear axes: each motion is checked, arcs at their extremes."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

import camgen
from camgen.check.machine import check_machine, check_travel
from camgen.model.errors import Blocked, JobError, NoSafeProgram
from camgen.model.pose import TOOL_DOWN, Pose, pose_from_values, translation
from camgen.model.program import Comment, MoveC, MoveJ, MoveL, Origin, Program, ToolChange
from camgen.post.plugins import cell_of, find_post, make_post
from camgen.read.job_file import from_mapping, load_job
from camgen.robots.catalogue import find_robot
from camgen.robots.workcell import Workcell, equip_cell

PARTS = Path(__file__).parents[2] / "fixtures" / "parts"
MILL = find_robot("3-axis mill")
#: Work zero in machine coordinates, and the tool: 100 mm below the flange.
BASE, TOOL = translation(100, 80, -300), translation(0, 0, 100)
HOME = Pose(TOOL_DOWN, (0.0, 0.0, 50.0))


def make_pose(x: float, y: float, z: float = 0.0) -> Pose:
    return Pose(TOOL_DOWN, (x, y, z))


def make_program(*motions: MoveJ | MoveL | MoveC | ToolChange) -> Program:
    """A program with these motions as path c1, from home and back."""
    body = [MoveJ(HOME, 100.0), Comment("path c1")]
    for motion in motions:
        body.append(motion if isinstance(motion, ToolChange) else replace(motion, path=0))
    return Program("part", BASE, TOOL, (*body, MoveJ(HOME, 100.0)), paths=(Origin("c1"),))


def make_cell(**cell: object) -> tuple[Workcell, Any]:
    """The cell of the mill with these keys, and its job."""
    job = from_mapping({"cell": {"robot": "3-axis mill", **cell}})
    return equip_cell(cell_of(make_post(find_post("gcode"), {}), job), job, MILL), job


def test_axis_positions_are_the_sum_of_tip_work_offset_and_tool_length() -> None:
    generator = np.random.default_rng(1)
    points = generator.uniform((0, 0, -90), (690, 410, 190), (40, 3)).tolist()
    program = make_program(*(MoveL(Pose(TOOL_DOWN, tuple(point)), 20.0) for point in points))
    reach = check_travel(program, MILL, "part")
    for index, point in enumerate(points, start=2):
        at_end = reach.joints[reach.owner == index][-1]
        assert at_end == pytest.approx(np.add(point, (100, 80, -300 + 100)), abs=1e-9)


@pytest.mark.parametrize(
    ("target", "line"),
    [
        (make_pose(700.5, 0), "axis X would be at 800.5 mm, its travel ends at 800 mm"),
        (make_pose(-101, 0), "axis X would be at -1 mm, its travel begins at 0 mm"),
        (make_pose(0, 425), "axis Y would be at 505 mm, its travel ends at 500 mm"),
        # The flange is 100 mm above the tip.
        (make_pose(0, 0, 201), "axis Z would be at 1 mm, its travel ends at 0 mm"),
        (make_pose(0, 0, -201), "axis Z would be at -401 mm, its travel begins at -400 mm"),
    ],
)
def test_a_position_beyond_the_travel_names_axis_limit_and_value(target: Pose, line: str) -> None:
    with pytest.raises(NoSafeProgram) as refused:
        check_travel(make_program(MoveL(target, 20.0)), MILL, "part.dxf")
    assert str(refused.value).startswith("part.dxf: 3-axis mill cannot run path c1 at ")
    assert line in str(refused.value)
    assert refused.value.remedy == "move the part in the machine: cell.base_from_work"


def test_travel_up_to_the_limit_is_allowed() -> None:
    program = make_program(
        MoveL(make_pose(700, 420, 200), 20.0), MoveL(make_pose(-100, -80, -200), 20.0)
    )
    assert check_travel(program, MILL, "part").joints.max(axis=0) == pytest.approx([800, 500, 0])


@pytest.mark.parametrize(
    ("middle", "line"),
    [
        (10.0, "axis X would be at 810 mm, its travel ends at 800 mm"),
        (-10.0, "axis X would be at 810 mm, its travel ends at 800 mm"),
        (75.0, ""),
    ],
)
def test_an_arc_is_checked_where_an_axis_reverses(middle: float, line: str) -> None:
    """Radius 30 mm about X 780 reaches 810 mm at 0 deg; the ends stay within the travel."""
    half_sweep = math.degrees(math.acos(20 / 30)) + 10 + abs(middle) if line else 20.0

    def on_arc(degrees: float) -> Pose:
        angle = math.radians(degrees)
        return make_pose(680 + 30 * math.cos(angle), 100 + 30 * math.sin(angle))

    start, end = on_arc(middle - half_sweep), on_arc(middle + half_sweep)
    assert max(start.origin[0], end.origin[0]) < 700
    arc = MoveC(on_arc(middle), end, 20.0)
    program = make_program(MoveL(start, 20.0), arc)
    if not line:
        check_travel(program, MILL, "part")
        return
    with pytest.raises(NoSafeProgram, match=line):
        check_travel(program, MILL, "part")


def test_a_tilted_tool_is_refused() -> None:
    leaning = pose_from_values([0, 0, 0, 170, 0, 0])
    with pytest.raises(NoSafeProgram, match="the tool cannot lean"):
        check_travel(make_program(MoveL(leaning, 20.0)), MILL, "part")


def test_each_tool_has_its_own_length() -> None:
    """At home the flange of a tool of 260 mm is above its travel: -300 + 50 + 260 mm."""
    cell, job = make_cell(base_from_work=[100, 80, -300, 0, 0, 0])
    motions = (MoveL(make_pose(0, 0), 20.0), MoveJ(HOME, 100.0))
    changed = make_program(
        *motions,
        ToolChange(2, "", 6.0, 240.0, translation(0, 0, 240)),
        MoveJ(HOME, 100.0),
        *motions,
    )
    first = ToolChange(1, "", 6.0, 100.0, TOOL)
    valid = changed.with_body((first, *changed.body))
    reach, _, _ = check_machine(valid, job, cell, "part")
    assert reach.joints[:, 2].max() == pytest.approx(-300 + 50 + 240)
    motions_at = valid.columns.at[1:]
    assert set(reach.owner.tolist()) >= set(motions_at.tolist())
    too_long = ToolChange(2, "", 6.0, 260.0, translation(0, 0, 260))
    body = [
        too_long if isinstance(item, ToolChange) and item.number == 2 else item
        for item in valid.body
    ]
    with pytest.raises(NoSafeProgram, match="axis Z would be at 10 mm, its travel ends at 0 mm"):
        check_machine(valid.with_body(tuple(body)), job, cell, "part")


def test_a_fixture_in_the_way_of_the_spindle_is_a_collision() -> None:
    cell, job = make_cell(
        base_from_work=[100, 80, -300, 0, 0, 0], fixtures=[[40, -10, 0, 60, 10, 80]]
    )
    crossing = make_program(MoveL(make_pose(0, 0, 20), 20.0), MoveL(make_pose(100, 0, 20), 20.0))
    with pytest.raises(Blocked, match="3-axis mill collides on path c1"):
        check_machine(crossing, job, cell, "part")
    passing = make_program(MoveL(make_pose(0, 40, 20), 20.0), MoveL(make_pose(100, 40, 20), 20.0))
    assert check_machine(passing, job, cell, "part")[1].clearance > 0


@pytest.mark.parametrize("post", ["gcode", "grbl"])
def test_the_motions_do_not_change_if_the_machine_is_named(post: str) -> None:
    without_machine = camgen.build(PARTS / "bracket.dxf", post=post)
    with_machine = camgen.build(
        PARTS / "bracket.dxf", post=post, job={"cell": {"robot": "3-axis mill"}}
    )
    # The slides of the model have no shape, as the report states.
    assert with_machine.report["checks"] == {
        "reach": "ok",
        "collision": "partly checked",
        "limits": "ok",
    }
    assert [row["bodies"][0] for row in with_machine.report["untested"]] == ["link 1", "link 2"]

    def motions(text: str) -> list[str]:
        return [line for line in text.splitlines() if not line.startswith("(")]

    assert motions(with_machine.text) == motions(without_machine.text)


def test_without_a_work_offset_the_home_of_the_machine_sets_the_work_zero() -> None:
    """Home is 50 mm above the work zero and the flange 100 mm above the tip: zero is at -250 mm."""
    result = camgen.build(PARTS / "bracket.dxf", post="gcode", job={"cell": {"robot": "mill"}})
    assert result.reach is not None
    assert result.reach.joints[0].tolist() == MILL.home.tolist() == [400, 250, -100]
    notes = [note.what for note in result.notes]
    assert "the work zero is at 400 250 -250 mm of 3-axis mill" in notes
    stated: dict[str, Any] = {"cell": {"robot": "mill", "base_from_work": [90, 80, -250, 0, 0, 0]}}
    result = camgen.build(PARTS / "bracket.dxf", post="gcode", job=stated)
    assert not [note for note in result.notes if "work zero" in note.what]


def test_operations_with_several_tools_are_checked() -> None:
    """Zero is at -250 mm; tools of 80 mm go 11 mm deep and to a home 50 mm above zero."""
    job = PARTS.parent / "cases" / "motor-plate" / "job.toml"
    settings = load_job(job, ["cell.robot=3-axis mill"])
    result = camgen.build(PARTS / "motor.dxf", post="gcode", job=settings)
    assert result.reach is not None
    heights = result.reach.joints[:, 2]
    assert heights.min() == pytest.approx(-250 - 11 + 80)
    assert heights.max() == pytest.approx(-250 + 50 + 80)


@pytest.mark.parametrize(
    ("settings", "line"),
    [
        ({"cell": {"robot": "IRB 120"}}, "the post is for a machine, not for an arm (cell.robot)"),
        (
            {"cell": {"robot": "mill"}, "tool": {"symmetric": True}},
            "has no effect on a machine, which turns no tool (tool.symmetric)",
        ),
    ],
)
def test_a_setting_for_an_arm_is_refused_on_a_machine(settings: dict[str, Any], line: str) -> None:
    with pytest.raises(JobError) as refused:
        camgen.build(PARTS / "bracket.dxf", post="gcode", job=settings)
    assert line in str(refused.value)
    assert refused.value.remedy
