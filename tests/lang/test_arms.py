"""The pose after a motion to joint values is known if the caller knows the arm, else unknown."""

import math
from collections.abc import Sequence

import pytest

from camgen.lang.programs import Executed, RunRequest, find_language
from camgen.model.pose import IDENTITY, Pose
from camgen.model.program import MoveJ, MoveL

TARGET = "[[10,0,0],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"
RAPID = """MODULE m
PERS tooldata tG:=[TRUE,[[0,0,100],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];
PERS wobjdata wT:=[FALSE,TRUE,"",[[1000,0,0],[1,0,0,0]],[[0,0,50],[1,0,0,0]]];
CONST jointtarget j1:=[[10,20,30,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
VAR robtarget p;
PROC main()
MoveAbsJ j1,v100,fine,tG\\WObj:=wT;
{}
ENDPROC
ENDMODULE
"""


def reach(values: Sequence[float]) -> Pose | None:
    """The flange of a made-up arm, whose first three joint values in deg are mm along the axes."""
    if len(values) != 6:
        return None
    x, y, z = (math.degrees(value) for value in values[:3])
    return Pose(IDENTITY, (x, y, z))


def run_program(language: str, text: str, is_known: bool = True) -> Executed:
    return find_language(language).run({"a": text}, RunRequest(flange=reach if is_known else None))


def last_target(executed: Executed) -> tuple[float, float, float]:
    item = executed.body[-1]
    assert isinstance(item, MoveJ | MoveL)
    assert isinstance(item.target, Pose)
    x, y, z = (round(value, 6) + 0.0 for value in item.target.origin)
    return x, y, z


@pytest.mark.parametrize(
    ("body", "position"),
    [
        (
            "p:=CRobT(\\Tool:=tG\\WObj:=wT);\nMoveL Offs(p,0,0,5),v100,fine,tG\\WObj:=wT;",
            (-990, 20, 85),
        ),
        ("p:=CRobT(\\Tool:=tG\\WObj:=wobj0);\nMoveL p,v100,fine,tG;", (10, 20, 130)),
        ("p:=CRobT(\\Tool:=tool0\\WObj:=wobj0);\nMoveL p,v100,fine,tool0;", (10, 20, 30)),
        (
            "p:=CalcRobT(j1,tG\\WObj:=wT);\nMoveL RelTool(p,0,0,-5),v100,fine,tG\\WObj:=wT;",
            (-990, 20, 75),
        ),
        ("p:=CalcRobT([[1,2,3,0,0,0],j1.extax],tool0);\nMoveL p,v100,fine,tool0;", (1, 2, 3)),
        (
            (
                "p.trans:=CPos(\\Tool:=tG\\WObj:=wT);\np.rot:=[1,0,0,0];\n"
                "MoveL p,v100,fine,tG\\WObj:=wT;"
            ),
            (-990, 20, 80),
        ),
    ],
)
def test_rapid_computes_the_pose_after_joint_values(
    body: str, position: tuple[float, float, float]
) -> None:
    executed = run_program("rapid", RAPID.format(body))
    assert last_target(executed) == position
    assert not executed.assumed
    without_arm = run_program("rapid", RAPID.format(body), is_known=False)
    # Without the arm no build accepts the line.
    assert without_arm.lost
    if ":=CRobT(" in body:
        # The line is in a frame that the text does not state.
        assert [type(item) for item in without_arm.body] == [MoveJ, MoveL]
        assert without_arm.frames[without_arm.frame[1]].base_from_work is None
    else:
        assert [type(item) for item in without_arm.body] == [MoveJ]


def test_rapid_does_not_guess_a_displaced_position() -> None:
    executed = run_program(
        "rapid", RAPID.format("PDispSet [[1,0,0],[1,0,0,0]];\np:=CalcRobT(j1,tG);")
    )
    assert [assumption.what for assumption in executed.assumed] == [
        "calcrobt needs the arm: what it gives is not known"
    ]


@pytest.mark.parametrize(
    ("lines", "position"),
    [
        ("HERE p\nMOVES SHIFT(p BY 0,0,-5)", (10, 20, 25)),
        ("TOOL TRANS(0,0,100)\nMOVES SHIFT(HERE BY 1,0,0)", (11, 20, 130)),
        ("DEPARTS 5", (10, 20, 25)),
        ("BASE 60\nMOVES HERE", (70, 20, 30)),
        ("APPROS #PPOINT(1,2,3,0,0,0), 1", (1, 2, 2)),
    ],
)
def test_vplus_computes_the_pose_after_joint_values(
    lines: str, position: tuple[float, float, float]
) -> None:
    text = f".PROGRAM main()\nMOVE #PPOINT(10,20,30,0,0,0)\n{lines}\n.END\n"
    executed = run_program("vplus", text)
    assert last_target(executed) == position
    assert len(executed.frames) <= 2
    assert any(frame.work for frame in run_program("vplus", text, is_known=False).frames)


@pytest.mark.parametrize(
    ("lines", "position"),
    [
        ("p1 = CurPos\nMove L, @0 p1 + P(0, 0, 5)", (10, 20, 35)),
        ("Depart L, @0 5", (10, 20, 25)),
        (
            (
                "Tool 1, P(0, 0, 100)\nWork 1, P(1, 0, 0)\nChangeTool 1\nChangeWork 1\n"
                "Move L, @0 CurPos"
            ),
            (9, 20, 130),
        ),
        ("Draw L, @0 V(1, 0, 0)", (11, 20, 30)),
    ],
)
def test_pacscript_computes_the_pose_after_joint_values(
    lines: str, position: tuple[float, float, float]
) -> None:
    text = f"Sub Main\nTakeArm\nMove P, @0 J(10, 20, 30, 0, 0, 0)\n{lines}\nEnd Sub\n"
    executed = run_program("pacscript", text)
    assert last_target(executed) == position
    assert {frame.work for frame in executed.frames} <= {"0", "1"}
    assert not {frame.work for frame in run_program("pacscript", text, is_known=False).frames} <= {
        "0",
        "1",
    }


def test_joint_values_of_another_number_have_no_pose() -> None:
    executed = run_program(
        "pacscript", "Sub Main\nTakeArm\nMove P, @0 J(10, 20, 30, 0)\nDepart L, @0 5\nEnd Sub\n"
    )
    assert any("joint values of line 3" in frame.work for frame in executed.frames)
