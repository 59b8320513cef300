"""Where the arm is after joint values, by language: known where the caller knows the arm, and not guessed elsewhere."""

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
    """A made-up arm: its first three joint values, in degrees, are mm along the axes."""
    if len(values) != 6:
        return None
    x, y, z = (math.degrees(value) for value in values[:3])
    return Pose(IDENTITY, (x, y, z))


def run(language: str, text: str, known: bool = True) -> Executed:
    return find_language(language).run({"a": text}, RunRequest(flange=reach if known else None))


def last(executed: Executed) -> tuple[float, float, float]:
    item = executed.body[-1]
    assert isinstance(item, MoveJ | MoveL)
    assert isinstance(item.target, Pose)
    x, y, z = (round(value, 6) + 0.0 for value in item.target.origin)
    return x, y, z


@pytest.mark.parametrize(
    ("body", "place"),
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
            "p.trans:=CPos(\\Tool:=tG\\WObj:=wT);\np.rot:=[1,0,0,0];\nMoveL p,v100,fine,tG\\WObj:=wT;",
            (-990, 20, 80),
        ),
    ],
)
def test_rapid(body: str, place: tuple[float, float, float]) -> None:
    found = run("rapid", RAPID.format(body))
    assert last(found) == place
    assert not found.assumed
    unknown = run("rapid", RAPID.format(body), known=False)
    # Without the arm no build takes the line.
    assert unknown.lost
    if ":=CRobT(" in body:
        # It is in a frame that the text does not state.
        assert [type(item) for item in unknown.body] == [MoveJ, MoveL]
        assert unknown.frames[unknown.frame[1]].base_from_work is None
    else:
        assert [type(item) for item in unknown.body] == [MoveJ]


def test_rapid_does_not_guess_a_displaced_position() -> None:
    found = run("rapid", RAPID.format("PDispSet [[1,0,0],[1,0,0,0]];\np:=CalcRobT(j1,tG);"))
    assert [one.what for one in found.assumed] == [
        "calcrobt needs the arm: what it gives is not known"
    ]


@pytest.mark.parametrize(
    ("lines", "place"),
    [
        ("HERE p\nMOVES SHIFT(p BY 0,0,-5)", (10, 20, 25)),
        ("TOOL TRANS(0,0,100)\nMOVES SHIFT(HERE BY 1,0,0)", (11, 20, 130)),
        ("DEPARTS 5", (10, 20, 25)),
        ("BASE 60\nMOVES HERE", (70, 20, 30)),
        ("APPROS #PPOINT(1,2,3,0,0,0), 1", (1, 2, 2)),
    ],
)
def test_vplus(lines: str, place: tuple[float, float, float]) -> None:
    text = f".PROGRAM main()\nMOVE #PPOINT(10,20,30,0,0,0)\n{lines}\n.END\n"
    found = run("vplus", text)
    assert last(found) == place
    assert len(found.frames) <= 2
    assert any(frame.work for frame in run("vplus", text, known=False).frames)


@pytest.mark.parametrize(
    ("lines", "place"),
    [
        ("p1 = CurPos\nMove L, @0 p1 + P(0, 0, 5)", (10, 20, 35)),
        ("Depart L, @0 5", (10, 20, 25)),
        (
            "Tool 1, P(0, 0, 100)\nWork 1, P(1, 0, 0)\nChangeTool 1\nChangeWork 1\nMove L, @0 CurPos",
            (9, 20, 130),
        ),
        ("Draw L, @0 V(1, 0, 0)", (11, 20, 30)),
    ],
)
def test_pacscript(lines: str, place: tuple[float, float, float]) -> None:
    text = f"Sub Main\nTakeArm\nMove P, @0 J(10, 20, 30, 0, 0, 0)\n{lines}\nEnd Sub\n"
    found = run("pacscript", text)
    assert last(found) == place
    assert {frame.work for frame in found.frames} <= {"0", "1"}
    assert not {frame.work for frame in run("pacscript", text, known=False).frames} <= {"0", "1"}


def test_an_arm_of_other_joints_says_nothing() -> None:
    found = run(
        "pacscript", "Sub Main\nTakeArm\nMove P, @0 J(10, 20, 30, 0)\nDepart L, @0 5\nEnd Sub\n"
    )
    assert any("joint values of line 3" in frame.work for frame in found.frames)
