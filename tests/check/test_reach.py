"""A program is run by the named robot, or refused with the path, the position and the reason."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

import camgen
from camgen.check.reach import check_reach
from camgen.cli import main
from camgen.model.errors import CamgenError, NoSafeProgram
from camgen.model.pose import IDENTITY, TOOL_DOWN, Pose, translation
from camgen.model.program import Comment, Joints, MoveC, MoveJ, MoveL, Origin, Program
from camgen.robots.catalogue import find_robot
from camgen.robots.kinematics.forward import compute_flange

PARTS = Path(__file__).parents[2] / "fixtures" / "parts"
HOME = Joints((0.0, 0.0, 0.0, 0.0, math.radians(30), 0.0))
BASE, TOOL = translation(300, -75, 100), translation(0, 0, 100)


def make_pose(x: float, y: float, z: float = 0.0) -> Pose:
    return Pose(TOOL_DOWN, (x, y, z))


def make_program(
    *motions: MoveJ | MoveL | MoveC, home: Joints = HOME, base: Pose = BASE
) -> Program:
    body = (
        MoveJ(home, 100.0),
        Comment("path c1"),
        *(replace(motion, path=0) for motion in motions),
        MoveJ(home, 100.0),
    )
    return Program("part", base, TOOL, body, paths=(Origin("c1"),))


def test_the_joint_values_lead_along_the_program() -> None:
    arm = find_robot("IRB 120")
    arc = MoveC(make_pose(50, 50), make_pose(100, 0), 20.0)
    trace = check_reach(
        make_program(MoveJ(make_pose(0, 0), 100.0), arc, MoveL(make_pose(0, 0), 20.0)), arm, "part"
    )
    rotations, origins = compute_flange(arm, trace.joints)
    positions = origins + rotations @ np.array([0.0, 0.0, 100.0]) - np.array(BASE.origin)
    assert positions[trace.owner == 2][-1] == pytest.approx([0, 0, 0], abs=1e-6)
    path_positions = positions[(trace.owner == 3) | (trace.owner == 4)]
    on_arc = positions[trace.owner == 3]
    assert np.hypot(on_arc[:, 0] - 50, on_arc[:, 1]) == pytest.approx(
        np.full(len(on_arc), 50.0), abs=1e-6
    )
    assert (on_arc[:-1, 1] > 1).all()
    assert np.abs(path_positions[:, 2]).max() < 1e-6
    assert np.linalg.norm(np.diff(path_positions, axis=0), axis=1).max() <= 10.0 + 1e-6
    assert np.all((trace.joints >= arm.limits[:, 0]) & (trace.joints <= arm.limits[:, 1]))
    assert np.abs(np.diff(trace.joints, axis=0)).max() < math.radians(30)


def test_a_line_out_of_reach_is_refused_with_path_and_position() -> None:
    far = make_program(MoveJ(make_pose(0, 0), 100.0), MoveL(make_pose(600, 0), 20.0))
    with pytest.raises(
        NoSafeProgram, match=r"IRB 120 cannot run path c1 at \d+ 0 0 mm: out of reach by"
    ) as refused:
        check_reach(far, find_robot("IRB 120"), "part.dxf")
    assert str(refused.value).startswith("part.dxf: ")


def test_a_line_with_only_its_ends_in_reach_is_refused() -> None:
    """The line passes through the column of the robot, where no arm can have its tool down."""
    across = make_program(
        MoveJ(make_pose(0, 0), 100.0),
        MoveL(make_pose(-600, 150), 20.0),
        base=translation(300, -75, 100),
    )
    with pytest.raises(NoSafeProgram, match="cannot run"):
        check_reach(across, find_robot("IRB 120"), "part")


def test_the_length_of_the_tool_changes_the_reach() -> None:
    near = make_program(MoveJ(make_pose(120, 0, 0), 100.0))
    assert check_reach(near, find_robot("IRB 120"), "part").owner.tolist()[-1] == 3
    with_long_tool = Program("part", BASE, translation(0, 0, 600), near.body, paths=near.paths)
    with pytest.raises(NoSafeProgram):
        check_reach(with_long_tool, find_robot("IRB 120"), "part")


@pytest.mark.parametrize(
    ("program", "arm", "line"),
    [
        (
            make_program(MoveJ(make_pose(0, 0), 9.0), home=Joints((0.0,) * 4)),
            "IRB 120",
            "has 6 joints, home has 4",
        ),
        (
            make_program(MoveJ(make_pose(0, 0), 9.0), home=Joints((9.0,) * 6)),
            "IRB 120",
            "is beyond the limits of IRB 120",
        ),
        (
            Program("p", Pose(IDENTITY, (0, 0, 0)), TOOL, (MoveJ(make_pose(0, 0), 9.0),)),
            "IRB 120",
            "not for an arm",
        ),
    ],
    ids=["joints", "limits", "machine"],
)
def test_a_program_for_another_arm_is_refused(program: Program, arm: str, line: str) -> None:
    with pytest.raises(CamgenError, match=line):
        check_reach(program, find_robot(arm), "part")


@pytest.mark.parametrize(
    ("post", "arm"), [("rapid", "irb120"), ("pacscript", "VS-060"), ("vplus", "Cobra s600")]
)
def test_the_arm_of_a_controller_reaches_its_default_cell(post: str, arm: str) -> None:
    job: dict[str, Any] = {"cell": {"robot": arm}}
    result = camgen.build(PARTS / "bracket.dxf", post=post, job=job)
    # The boxes of links 4 and 6 of the two six-axis arms overlap.
    collision = "ok" if arm == "Cobra s600" else "partly checked"
    assert result.report["checks"] == {"reach": "ok", "collision": collision, "limits": "ok"}
    assert ("untested" in result.report) == (collision != "ok")
    without_arm = camgen.build(PARTS / "bracket.dxf", post=post)
    assert without_arm.report["checks"] == dict.fromkeys(
        ("reach", "collision", "limits"), "not checked"
    )
    assert [item for item in without_arm.program.body if not isinstance(item, Comment)]
    assert len(without_arm.program.body) == len(result.program.body)


def test_the_command_line_reports_the_reach(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["build", str(PARTS / "bracket.dxf"), "--post", "rapid", "-o", str(tmp_path / "b.mod")]
    assert main([*words, "--set", "cell.robot=IRB 120"]) == 0
    assert "IRB 120 reaches all of it within its limits" in capsys.readouterr().err
    far = ["--set", "cell.robot=IRB 120", "--set", "cell.base_from_work=[900,0,100,0,0,0]"]
    (tmp_path / "b.mod").unlink()
    assert main([*words, *far]) == 3
    assert not (tmp_path / "b.mod").exists()
    assert main(["robots"]) == 0
    assert sum("spherical-wrist" in line for line in capsys.readouterr().out.splitlines()) == 8
