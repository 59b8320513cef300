"""The read-back of PacScript takes no more than a controller does, nor what no option asks for: one change each."""

import math
from collections.abc import Mapping

import pytest
from camgen_posts.pacscript import PacScript
from camgen_posts.readback.pacscript import read

from camgen.model.errors import VerifyError
from camgen.model.pose import TOOL_DOWN, Pose, translation
from camgen.model.program import (
    Instruction,
    Joints,
    MoveC,
    MoveJ,
    MoveL,
    Output,
    Posture,
    Program,
    Wait,
)
from camgen.post import Remark
from camgen.post.plugins import make_post
from camgen.post.verify import compare
from tests.support.strict import find_after
from tests.support.whole import whole

HOME = MoveJ(Joints(tuple(math.radians(v) for v in (0.0, 0.0, 90.0, 0.0, 30.0, 0.0))), 100.0)
LEFTY = Posture(figure=5)


def at(x: float, y: float, z: float = 0.0) -> Pose:
    return Pose(TOOL_DOWN, (x, y, z))


def text_of(body: tuple[Instruction, ...], options: Mapping[str, object]) -> str:
    post = make_post(PacScript, options)
    program = Program(
        "part", translation(300, -75, 150), translation(0, 0, 100), whole((HOME, *body))
    )
    (file,) = post.render(post.prepare(program, 0.01))
    return file.text


CUT = (
    MoveJ(at(0, 0, 20), 100.0, posture=LEFTY),
    MoveL(at(0, 0), 20.0, posture=LEFTY),
    Output("process", 1.0),
    Wait(0.15),
    MoveC(at(5, 2), at(10, 0), 37.0, posture=LEFTY),
    MoveL(at(30, 0), 20.0, posture=LEFTY),
    Output("process", 0.0),
    MoveL(at(30, 0, 20), 20.0, posture=LEFTY),
)
OPTIONS: dict[str, dict[str, object]] = {
    "plain": {},
    "other": {"tool": 3, "work": 2, "ext_speed": 50.0, "accel": 80.0, "define": True},
    "parts": {"max_lines": 5},
    "mm": {"pass_mark": "mm"},
    "force": {"force": "template"},
}
GIVE = "    GiveArm\nEnd Sub"
OUT = "        GiveArm\n        Exit Sub\n"
TARGET = "P(30.000, 0.000, 0.000, 180.0000, 0.0000, 0.0000, 5)"
VIA = "P(5.000, 2.000, 0.000, 180.0000, 0.0000, 0.0000, 5)"
ARC_END = "P(10.000, 0.000, 0.000, 180.0000, 0.0000, 0.0000, 5)"
HOME_JOINTS = "J(0.0000, 0.0000, 90.0000, 0.0000, 30.0000, 0.0000)"
OTHERWISE = "Mps is asked otherwise than by the programs of the post"
LEFT_OUT = "a value is left out between commas"
SIGNS = "a sign stands right after another or after an operator"
BARE = "a position stands without its P"
#: What a controller refuses, or cannot be meant: options, what stands there and what then does, the words of the fault.
FAULTS = [
    ("plain", "    Set IO[24]", "    Motor Off\n    Set IO[24]", "a motion with the motor off"),
    ("plain", "    Set IO[24]", "    Motor 7\n    Set IO[24]", "Motor 7 is not On or Off"),
    ("plain", "    Set IO[24]", "    GiveArm\n    Set IO[24]", "a motion without TakeArm"),
    ("plain", GIVE, "    GiveArm ; end\nEnd Sub", "GiveArm has no arguments, not ; end"),
    ("plain", "Keep = 0", "Keep = 5", "TakeArm Keep = 5; Keep is 0 or 1"),
    ("plain", "TakeArm Keep = 0", "TakeArm Kepp", "unknown name kepp"),
    (
        "plain",
        "    Set IO[24]",
        "    TakeArm Keep = 0\n    Set IO[24]",
        "TakeArm Keep = 0 after the first motion: the frames may change",
    ),
    ("plain", "End Sub", "End Sub\nSub Move\nEnd Sub", "Move is a word of the language"),
    (
        "plain",
        "End Sub",
        f"End Sub\nSub {'m' * 65}\nEnd Sub",
        f"the name {'m' * 20}... is longer than 64 characters",
    ),
    ("plain", "End Sub", "End Sub\nSub x(Speed)\nEnd Sub", "speed is a word of the language"),
    ("plain", "Sub Main", "#Define Then 5\nSub Main", "Then is a word of the language"),
    (
        "plain",
        "Sub Main",
        "Sub Main(ByVal a As Single)",
        "Main has parameters, and nobody calls it with values",
    ),
    ("plain", "    Speed 10", "    Dim unit As Single = 1\n    Speed 10", "unit is declared twice"),
    (
        "plain",
        "    Speed 10",
        "    Dim Timer As Single\n    Speed 10",
        "Timer is a word of the language",
    ),
    (
        "plain",
        "    Speed 10",
        f"    Dim {'v' * 65}\n    Speed 10",
        f"the name {'v' * 20}... is longer than 64 characters",
    ),
    ("plain", "    Speed 10", "    Dim b As Simple\n    Speed 10", "simple is no type"),
    ("plain", "unit As Single", "unit As Integer", "unit is Integer and does not hold this value"),
    (
        "plain",
        "unit As Single",
        "unit As Position",
        "unit is Position and does not hold this value",
    ),
    (
        "parts",
        "ByVal unit As Single",
        "ByVal unit As Integer",
        "unit is Integer and does not hold this value",
    ),
    ("plain", "ChangeTool 1", "ChangeTool 99", "tool 99; there are 0 to 63"),
    ("plain", "ChangeWork 1", "ChangeWork 64", "work 64; there are 0 to 63"),
    ("other", "    Tool 3,", "    Tool 0,", "tool 0; there are 1 to 63"),
    ("plain", "    Set IO[24]", "    Set IO[99999]", "IO[99999]; the highest is IO[24063]"),
    ("plain", "Delay 150", "Delay 3000000000", "a delay longer than a controller holds"),
    (
        "plain",
        "    Set IO[24]",
        "    ForceParam 11, 2, P(0, 0, 5)\n    Set IO[24]",
        "the force table 11; there are 1 to 10",
    ),
    ("plain", "Accel 50, 50", "Accel 50, 50, 50", "an acceleration has one value or two"),
    ("parts", "ByVal unit As Single", "ByVal unit As Singel", "parameters that cannot be read"),
]
#: What it takes, and no program of ours says.
REMARKS = [
    ("plain", "    ChangeTool 1\n", "", "tool 0 is on, by post.tool it is 1"),
    ("plain", "    ChangeWork 1\n", "", "work 0 is on, by post.work it is 1"),
    ("plain", "ChangeTool 1", "ChangeTool 2", "tool 2 is on, by post.tool it is 1"),
    ("other", "ChangeWork 2", "ChangeWork 1", "work 1 is on, by post.work it is 2"),
    (
        "plain",
        "    ChangeTool 1",
        "    Tool 1, P(0, 0, 9)\n    ChangeTool 1",
        "tool 1 is written to the controller, though post.define does not ask for it",
    ),
    ("plain", GIVE, f"    Motor Off\n{GIVE}", "Motor Off, which no option asks for"),
    ("plain", GIVE, "End Sub", "the arm is not given back"),
    ("plain", GIVE, f"    GiveArm\n{GIVE}", "GiveArm of an arm that is not taken"),
    ("plain", GIVE, "    GiveArm\n    Reset IO[24]\nEnd Sub", "an output after GiveArm"),
    ("plain", GIVE, "    GiveArm\n    Delay 5\nEnd Sub", "a delay after GiveArm"),
    ("plain", "    Speed 10", "    TakeArm Keep = 1\n    Speed 10", "the arm is taken twice"),
    (
        "plain",
        "TakeArm Keep = 0",
        "TakeArm 1 Keep = 0",
        "arm group 1, which no program of the post takes",
    ),
    (
        "plain",
        "@0 P(30.000, 0.000, 0.000, 180.0000, 0.0000, 0.0000, 5)",
        "@0 P(30.000, 0.000, 0.000, 180.0000, 0.0000, 0.0000, 1)",
        "from figure 5 to 1 along a line",
    ),
    (
        "plain",
        "Delay 150",
        "Delay 0.15",
        "a delay of 0.15 ms, no whole number; seconds are not meant",
    ),
    (
        "plain",
        "    ChangeTool 1",
        "    ExtSpeed 100\n    ChangeTool 1",
        "ExtSpeed 100, by post.ext_speed it is 0: none",
    ),
    ("plain", GIVE, f"    ExtSpeed 100\n{GIVE}", "ExtSpeed 100, by post.ext_speed it is 0: none"),
    ("other", "    ExtSpeed 50\n", "", "no ExtSpeed, by post.ext_speed it is 50"),
    (
        "other",
        "ExtSpeed 50",
        "ExtSpeed 50, 20, 20",
        "ExtSpeed with an acceleration, which no option asks for",
    ),
    ("plain", "Accel 50, 50", "Accel 100, 100", "Accel is 100, 100, by post.accel it is 50, 50"),
    ("other", "Accel 80, 80", "Accel 80, 100", "Accel is 80, 100, by post.accel it is 80, 80"),
    (
        "plain",
        "    Accel 50, 50\n",
        "",
        "Accel is not set, or not after Speed, by post.accel it is 50, 50",
    ),
    (
        "plain",
        "    Speed 10\n    Accel 50, 50\n",
        "    Accel 50, 50\n    Speed 10\n",
        "Accel is not set, or not after Speed, by post.accel it is 50, 50",
    ),
    (
        "plain",
        "    Set IO[24]",
        "    Decel 5\n    Set IO[24]",
        "Accel is 50, 5, by post.accel it is 50, 50",
    ),
    ("plain", GIVE, f"    Accel 5\n{GIVE}", "Accel is 5, 50, by post.accel it is 50, 50"),
    (
        "plain",
        "Mps(37 * unit)",
        "Mps(37 * unit), Accel = 5",
        "a motion with an Accel of its own, which no option asks for",
    ),
    ("plain", "Speed 10", "Speed 20", "Speed 20, by post.internal_speed it is 10"),
    ("plain", "Speed 10", "Speed Mps(9)", "Speed by Mps, by post.internal_speed it is 10"),
    ("plain", "    Speed 10\n", "", "no Speed, by post.internal_speed it is 10"),
    (
        "plain",
        "Keep = 0",
        "Keep = 1",
        "TakeArm without Keep = 0, so that what the last program has set may hold",
    ),
    (
        "plain",
        "TakeArm Keep = 0",
        "TakeArm",
        "TakeArm without Keep = 0, so that what the last program has set may hold",
    ),
    (
        "plain",
        "    TakeArm Keep = 0\n    Reset IO[24]\n",
        "    Reset IO[24]\n    TakeArm Keep = 0\n",
        "an output before TakeArm",
    ),
    (
        "force",
        "    TakeArm Keep = 0\n",
        "    ForceCtrl False\n    TakeArm Keep = 0\n",
        "a force change before TakeArm",
    ),
    (
        "plain",
        VIA,
        VIA.replace(", 5)", ", -1)"),
        "the via point of an arc leaves its figure open, its end has 5",
    ),
    (
        "plain",
        ARC_END,
        ARC_END.replace(", 5)", ", -1)"),
        "the via point of an arc has figure 5, its end leaves it open",
    ),
    (
        "plain",
        f"@0 {TARGET}",
        f"@E {TARGET}",
        "the pass mark @E, which no program of the post says",
    ),
    (
        "plain",
        f"@0 {TARGET}",
        f"@C {TARGET}",
        "the pass mark @C, which no program of the post says",
    ),
    ("plain", f"@0 {TARGET}", f"@2 {TARGET}", "a blend in mm, by post.pass_mark it is @P"),
    ("mm", f"@0 {TARGET}", f"@P {TARGET}", "@P, by post.pass_mark blends are in mm"),
    ("plain", f"@0 {TARGET}", f"@0 {TARGET[1:]}", BARE),
    ("plain", f"@0 {TARGET}", f"@ {TARGET}", BARE),
    ("plain", VIA, VIA[1:], BARE),
    ("other", "    Tool 3, P(", "    Tool 3, (", BARE),
    ("plain", TARGET, TARGET.replace("0.0000, 5)", ", 5)"), LEFT_OUT),
    ("plain", TARGET, TARGET.replace("0.000, 180", ", 180"), LEFT_OUT),
    ("plain", HOME_JOINTS, HOME_JOINTS.replace("30.0000, 0.0000)", "30.0000, )"), LEFT_OUT),
    ("plain", HOME_JOINTS, HOME_JOINTS.replace("(0.0000, ", "(, "), LEFT_OUT),
    (
        "plain",
        "    Set IO[24]",
        "    ForceParam 1, 2, P(0, 5, 0, 0, , 0)\n    Set IO[24]",
        LEFT_OUT,
    ),
    ("plain", TARGET, TARGET.replace(", 180.0000", ", --180.0000"), SIGNS),
    ("plain", TARGET, TARGET.replace(", 5)", ", 10 / +2)"), SIGNS),
    ("plain", OUT, "        Exit Sub\n", OTHERWISE),
    ("plain", OUT, "        GiveArm\n", OTHERWISE),
    ("plain", OUT, "        GiveArm        Exit Sub\n", OTHERWISE),
    ("plain", OUT, OUT.replace("Exit", "GoTo"), OTHERWISE),
    ("plain", OUT, f"{OUT}        Speed 10\n", OTHERWISE),
    ("plain", "Mps(100 * unit) <", "Mps(110 * unit) <", OTHERWISE),
    ("plain", "> 20 Then", "> 21 Then", OTHERWISE),
    ("plain", "Mps(0.1) > 0.2", "Mps(0.1) > 0.3", OTHERWISE),
]
#: What a program may say otherwise than this post without a remark.
TAKEN = [
    ("plain", TARGET, TARGET.replace(".0000", "").replace(".000", ".0")),
    ("plain", TARGET, TARGET.lower()),
    ("plain", TARGET, TARGET.replace("180.0000", "90 * 2")),
    ("plain", TARGET, TARGET.replace("180.0000", "-(0 - 180)")),
    ("plain", f"@0 {TARGET}", TARGET),
    ("plain", "> 20 Then", ">20  THEN ' or so"),
    ("parts", "ByVal unit As Single", "unit As Single"),
    ("plain", "    Speed 10\n    Accel", "    Speed 10\n    Speed 10.0\n    Accel"),
]


def found(options: Mapping[str, object], before: str, after: str) -> list[tuple[bool, str]]:
    """Whether each thing that is found in a program with one change is a remark, and its words."""
    return [
        (remark, what)
        for _, remark, what in find_after(read, text_of(CUT, options), options, before, after)
    ]


@pytest.mark.parametrize(("options", "before", "after", "what"), FAULTS)
def test_what_no_controller_takes_is_a_fault(
    options: str, before: str, after: str, what: str
) -> None:
    assert (False, what) in found(OPTIONS[options], before, after)


@pytest.mark.parametrize(("options", "before", "after", "what"), REMARKS)
def test_what_no_option_asks_for_is_a_remark(
    options: str, before: str, after: str, what: str
) -> None:
    remarks = [one for one in found(OPTIONS[options], before, after) if one[1] == what]
    assert remarks == [(True, what)]


@pytest.mark.parametrize(("options", "before", "after"), TAKEN)
def test_what_means_the_same_needs_no_remark(options: str, before: str, after: str) -> None:
    assert found(OPTIONS[options], before, after) == []


def test_the_internal_speed_is_left_alone_where_motions_run_at_it() -> None:
    """Then it is compared with theirs."""
    lines = (
        "TakeArm Keep = 0",
        "Speed 30",
        "Accel 50, 50",
        "ChangeTool 1",
        "ChangeWork 1",
        "Move P, @0 P(1, 2, 3)",
    )
    for last in ("Move P, @0 P(4, 5, 6)", "Move P, @0 P(4.0, 5.0, 6.0), Speed = 5"):
        text = "\n".join(("Sub Main", *lines, last, "GiveArm", "End Sub", ""))
        assert read({"a": text}, {}).faults == ()
    text = text.replace("P(1, 2, 3)", "P(1, 2, 3), Speed = 5")
    assert [one.what for one in read({"a": text}, {}).faults] == [
        "Speed 30, by post.internal_speed it is 10"
    ]


def test_another_radius_of_a_blend_is_found_where_it_is_in_mm() -> None:
    options: dict[str, object] = {"pass_mark": "mm"}
    post = make_post(PacScript, options)
    body = (
        HOME,
        MoveJ(at(0, 0, 20), 100.0),
        MoveL(at(9, 0, 20), 20.0, 2.0),
        MoveL(at(9, 9, 20), 20.0),
    )
    program = post.prepare(
        Program("part", translation(300, -75, 150), translation(0, 0, 100), whole(body)), 0.01
    )
    (file,) = post.render(program)
    assert file.text.count("@2 ") == 1
    compare(program, read({"a": file.text}, options), post.tolerance(), post.list_verified(), "a")
    wider = read({"a": file.text.replace("@2 ", "@3 ")}, options)
    with pytest.raises(VerifyError, match="blend reads 3, planned is 2"):
        compare(program, wider, post.tolerance(), post.list_verified(), "a")


def test_a_fault_is_told_before_a_remark_of_its_line() -> None:
    text = text_of(CUT, {}).replace(TARGET, "(, 2, x)")
    kinds = [isinstance(one, Remark) for one in read({"a": text}, {}).faults]
    assert kinds == [False, True, True]


def test_an_arc_ends_in_the_figure_in_which_it_starts() -> None:
    text = text_of(CUT, {})
    (arc,) = (line for line in text.splitlines() if "Move C" in line)
    faults = read({"a": text.replace(arc, arc.replace(", 5)", ", 1)"))}, {}).faults
    assert [(isinstance(one, Remark), one.what) for one in faults] == [
        (False, "from figure 5 to 1 along an arc"),
        (True, "from figure 1 to 5 along a line"),
    ]
    assert text.splitlines()[faults[0].line - 1] == arc


def test_a_figure_that_is_left_open_is_not_held_against_the_next() -> None:
    """Along a line that ends at -1 axis 4 may pass half a turn; a joint motion may go to any figure."""
    text = text_of(CUT, {})
    lines = text.splitlines(keepends=True)
    at_once = [k for k, line in enumerate(lines) if "Move L" in line]
    opened = [
        line.replace(", 5)", ", -1)") if k == at_once[0] else line for k, line in enumerate(lines)
    ]
    arc = next(k for k, line in enumerate(lines) if "Move C" in line)
    other = [line.replace(", 5)", ", 1)") if k >= arc else line for k, line in enumerate(opened)]
    assert read({"a": "".join(opened)}, {}).faults == ()
    assert read({"a": "".join(other)}, {}).faults == ()


def test_a_change_has_its_line() -> None:
    text = text_of(CUT, {})
    lines = text.splitlines()
    (fault,) = read({"a": text.replace("ChangeTool 1", "ChangeTool 2")}, {}).faults
    assert fault.line == next(k for k, line in enumerate(lines, 1) if "Move P" in line)
    (fault,) = read({"a": text.replace("Delay 150", "Delay 0.15")}, {}).faults
    assert lines[fault.line - 1] == "    Delay 150"


@pytest.mark.parametrize(
    ("declared", "value", "holds"),
    [
        ("Single", "0.5", True), ("Double", "0.5", True), ("Integer", "5", True), ("Integer", "0.5", False),
        ("Position", "P(1, 2, 3)", True), ("Position", "J(1)", False), ("Joint", "J(1)", True), ("Joint", "5", False),
        ("Vector", "V(1)", True), ("Vector", "P(1)", False), ("Trans", "T(1, 2, 3, 0, 1, 0, 0, 0, 1)", True),
        ("Variant", "P(1)", True), ("Variant", "5", True),
    ],
)  # fmt: skip
def test_a_variable_holds_what_its_type_does(declared: str, value: str, holds: bool) -> None:
    for text in (f"Dim a As {declared} = {value}", f"Dim a As {declared}\na = {value}"):
        faults = read({"a": f"Sub Main\n{text}\nEnd Sub\n"}, {}).faults
        assert any(not isinstance(fault, Remark) for fault in faults) is not holds
