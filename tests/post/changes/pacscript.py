"""PacScript: changes of a program, and what the read-back finds after each."""

import math
from collections.abc import Mapping, Sequence

from camgen.model.pose import TOOL_DOWN, Pose, frozen, rotation_about
from camgen.model.program import (
    Force,
    Instruction,
    Joints,
    MoveC,
    MoveJ,
    MoveL,
    Output,
    Posture,
    Wait,
)
from tests.support.changes import deviation, fault, remark, taken
from tests.support.samples import Sample

HOME = MoveJ(Joints(tuple(math.radians(v) for v in (0.0, 0.0, 90.0, 0.0, 30.0, 0.0))), 100.0)
LEFTY = Posture(figure=5)


def at(x: float, y: float, z: float = 0.0) -> Pose:
    return Pose(TOOL_DOWN, (x, y, z))


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
#: Motions of three speeds, which depend on the unit of Mps.
SPEEDS = (
    MoveJ(at(0, 0, 20), 60.0),
    MoveL(at(0, 0), 12.5),
    MoveL(at(20, 0), 20.0),
)
#: Two outputs and a force, which are switched off before the first motion.
PRESSING = (
    MoveL(at(1, 0), 20.0),
    Output("process", 1.0),
    Force(9.0, (0.0, 1.0, 0.0)),
    MoveL(at(2, 0), 20.0, 0.0, 9.0, (0.0, 1.0, 0.0)),
    Force(0.0),
    Output("process", 0.0),
    Output("coolant", 0.0),
    MoveL(at(2, 0, 20), 20.0),
)
TEMPLATE = {"force": "template", "signals": {"process": 24, "coolant": 7}}
#: A joint motion with the speed fraction 0.123456.
SHARED = (MoveJ(at(0, 0, 20), 60.0, share=0.123456), MoveL(at(0, 0), 12.5))
#: The target of a reorientation at 60 deg/s, which is 12 % of 500 deg/s.
TURNED = Pose(frozen(rotation_about(2, math.pi / 2) @ TOOL_DOWN), (0.0, 0.0, 0.0))
QUARTER = (MoveL(at(0, 0), 12.5), MoveL(TURNED, 20.0, turn=math.radians(60.0)))
BLENDED = (MoveJ(at(0, 0, 20), 100.0), MoveL(at(9, 0, 20), 20.0, 2.0), MoveL(at(9, 9, 20), 20.0))
OTHER = {"tool": 3, "work": 2, "ext_speed": 50.0, "accel": 80.0, "define": True}


def sample(body: Sequence[Instruction], options: Mapping[str, object] | None = None) -> Sample:
    """A program that moves home and then runs `body`."""
    return Sample("pacscript", (HOME, *body), options)


PROGRAMS = {
    "plain": sample(CUT),
    "other": sample(CUT, OTHER),
    "parts": sample(CUT, {"max_lines": 5}),
    "mm": sample(CUT, {"pass_mark": "mm"}),
    "blended": sample(BLENDED, {"pass_mark": "mm"}),
    "force": sample(CUT, {"force": "template"}),
    "small": sample(SPEEDS),
    "pressing": sample(PRESSING, TEMPLATE),
    "shared": sample(SHARED),
    "turning": sample(QUARTER),
}
GIVE = "    GiveArm\nEnd Sub"
OUT = "        GiveArm\n        Exit Sub\n"
TARGET = "P(30.000, 0.000, 0.000, 180.0000, 0.0000, 0.0000, 5)"
VIA = "P(5.000, 2.000, 0.000, 180.0000, 0.0000, 0.0000, 5)"
ARC_END = "P(10.000, 0.000, 0.000, 180.0000, 0.0000, 0.0000, 5)"
ARC = f"{VIA}, @0 {ARC_END}"
HOME_JOINTS = "J(0.0000, 0.0000, 90.0000, 0.0000, 30.0000, 0.0000)"
NO_TYPE, NOBODY = "not a type", "no statement"
OTHERWISE = "Mps is asked otherwise than by the programs of the post"
LEFT_OUT = "a value is left out between commas"
SIGNS = "a sign stands right after another or after an operator"
BARE = "a position stands without its P"
NAMES_ALONE = "where Mps decides, only names can be given a value"
ASSIGNED = "a variable gets a value, outside the question of the post for Mps"
ARM = "depends on the arm"
UNIT = "as the controller reads Mps in mm/s or in m/s; give the option mps"
LINE = "    Move L"
TURNING, PLANNED = "speed of turning reads", "planned is 1.047198"

CHANGES = [
    fault("plain", "    Set IO[24]", "    Motor Off\n    Set IO[24]", "a motion with the motor off",
          times=3, others=True),
    fault("plain", "    Set IO[24]", "    Motor 7\n    Set IO[24]", "Motor 7 is not On or Off",
          others=True),
    fault("plain", "    Set IO[24]", "    GiveArm\n    Set IO[24]", "a motion without TakeArm",
          times=3, others=True),
    fault("plain", GIVE, "    GiveArm ; end\nEnd Sub", "GiveArm has no arguments, not ; end"),
    fault("plain", "Keep = 0", "Keep = 5", "TakeArm Keep = 5; Keep is 0 or 1"),
    fault("plain", "TakeArm Keep = 0", "TakeArm Kepp", "unknown name kepp"),
    fault("plain", "    Set IO[24]", "    TakeArm Keep = 0\n    Set IO[24]",
          "TakeArm Keep = 0 after the first motion: the frames may change", others=True),
    fault("plain", "End Sub", "End Sub\nSub Move\nEnd Sub", "Move is a word of the language"),
    fault("plain", "End Sub", f"End Sub\nSub {'m' * 65}\nEnd Sub",
          f"the name {'m' * 20}... is longer than 64 characters"),
    fault("plain", "End Sub", "End Sub\nSub x(Speed)\nEnd Sub", "speed is a word of the language"),
    fault("plain", "Sub Main", "#Define Then 5\nSub Main", "Then is a word of the language",
          others=True),
    fault("plain", "Sub Main", "Sub Main(ByVal a As Single)",
          f"Main has parameters, but {NOBODY} calls it with values"),
    fault("plain", "    Speed 10", "    Dim unit As Single = 1\n    Speed 10",
          "unit is declared twice"),
    fault("plain", "    Speed 10", "    Dim Timer As Single\n    Speed 10",
          "Timer is a word of the language"),
    fault("plain", "    Speed 10", f"    Dim {'v' * 65}\n    Speed 10",
          f"the name {'v' * 20}... is longer than 64 characters"),
    fault("plain", "    Speed 10", "    Dim b As Simple\n    Speed 10", f"simple is {NO_TYPE}"),
    fault("plain", "unit As Single", "unit As Integer",
          "unit is Integer and does not hold this value", others=True),
    fault("plain", "unit As Single", "unit As Position",
          "unit is Position and does not hold this value", others=True),
    fault("parts", "ByVal unit As Single", "ByVal unit As Integer",
          "unit is Integer and does not hold this value", others=True),
    fault("plain", "ChangeTool 1", "ChangeTool 99", "tool 99; there are 0 to 63", others=True),
    fault("plain", "ChangeWork 1", "ChangeWork 64", "work 64; there are 0 to 63", others=True),
    fault("other", "    Tool 3,", "    Tool 0,", "tool 0; there are 1 to 63"),
    fault("plain", "    Set IO[24]", "    Set IO[99999]", "IO[99999]; the highest is IO[24063]",
          others=True),
    fault("plain", "Delay 150", "Delay 3000000000", "a delay longer than a controller holds",
          others=True),
    fault("plain", "    Set IO[24]", "    ForceParam 11, 2, P(0, 0, 5)\n    Set IO[24]",
          "the force table 11; there are 1 to 10", others=True),
    fault("plain", "Accel 50, 50", "Accel 50, 50, 50", "an acceleration has one value or two",
          others=True),
    fault("parts", "ByVal unit As Single", "ByVal unit As Singel",
          "parameters that cannot be read"),
    remark("plain", "    ChangeTool 1\n", "", "tool 0 is on, by post.tool it is 1"),
    remark("plain", "    ChangeWork 1\n", "", "work 0 is on, by post.work it is 1"),
    remark("plain", "ChangeTool 1", "ChangeTool 2", "tool 2 is on, by post.tool it is 1", 2),
    remark("other", "ChangeWork 2", "ChangeWork 1", "work 1 is on, by post.work it is 2"),
    remark("plain", "    ChangeTool 1", "    Tool 1, P(0, 0, 9)\n    ChangeTool 1",
           "tool 1 is written to the controller, though post.define does not ask for it"),
    remark("plain", GIVE, f"    Motor Off\n{GIVE}", "Motor Off, which no option asks for"),
    remark("plain", GIVE, "End Sub", "the arm is not given back"),
    remark("plain", GIVE, f"    GiveArm\n{GIVE}", "GiveArm of an arm that is not taken"),
    remark("plain", GIVE, "    GiveArm\n    Reset IO[24]\nEnd Sub", "an output after GiveArm"),
    remark("plain", GIVE, "    GiveArm\n    Delay 5\nEnd Sub", "a delay after GiveArm"),
    remark("plain", "    Speed 10", "    TakeArm Keep = 1\n    Speed 10", "the arm is taken twice",
           others=True),
    remark("plain", "TakeArm Keep = 0", "TakeArm 1 Keep = 0",
           "arm group 1, which no program of the post takes"),
    remark("plain", "@0 P(30.000, 0.000, 0.000, 180.0000, 0.0000, 0.0000, 5)",
           "@0 P(30.000, 0.000, 0.000, 180.0000, 0.0000, 0.0000, 1)",
           "from figure 5 to 1 along a line", others=True),
    remark("plain", "Delay 150", "Delay 0.15",
           "a delay of 0.15 ms, no whole number; seconds are not meant", 0),
    remark("plain", "    ChangeTool 1", "    ExtSpeed 100\n    ChangeTool 1",
           "ExtSpeed 100, by post.ext_speed it is 0: none"),
    remark("plain", GIVE, f"    ExtSpeed 100\n{GIVE}",
           "ExtSpeed 100, by post.ext_speed it is 0: none"),
    remark("other", "    ExtSpeed 50\n", "", "no ExtSpeed, by post.ext_speed it is 50"),
    remark("other", "ExtSpeed 50", "ExtSpeed 50, 20, 20",
           "ExtSpeed with an acceleration, which no option asks for"),
    remark("plain", "Accel 50, 50", "Accel 100, 100",
           "Accel is 100, 100, by post.accel it is 50, 50"),
    remark("other", "Accel 80, 80", "Accel 80, 100",
           "Accel is 80, 100, by post.accel it is 80, 80"),
    remark("plain", "    Accel 50, 50\n", "",
           "Accel is not set, or not after Speed, by post.accel it is 50, 50"),
    remark("plain", "    Speed 10\n    Accel 50, 50\n", "    Accel 50, 50\n    Speed 10\n",
           "Accel is not set, or not after Speed, by post.accel it is 50, 50"),
    remark("plain", "    Set IO[24]", "    Decel 5\n    Set IO[24]",
           "Accel is 50, 5, by post.accel it is 50, 50"),
    remark("plain", GIVE, f"    Accel 5\n{GIVE}", "Accel is 5, 50, by post.accel it is 50, 50"),
    remark("plain", "Mps(37 * unit)", "Mps(37 * unit), Accel = 5",
           "a motion with an Accel of its own, which no option asks for"),
    remark("plain", "Speed 10", "Speed 20", "Speed 20, by post.internal_speed it is 10"),
    remark("plain", "Speed 10", "Speed Mps(9)", "Speed by Mps, by post.internal_speed it is 10"),
    remark("plain", "    Speed 10\n", "", "no Speed, by post.internal_speed it is 10"),
    remark("plain", "Keep = 0", "Keep = 1",
           "TakeArm without Keep = 0, so that what the last program has set may hold"),
    remark("plain", "TakeArm Keep = 0", "TakeArm",
           "TakeArm without Keep = 0, so that what the last program has set may hold"),
    remark("plain", "    TakeArm Keep = 0\n    Reset IO[24]\n",
           "    Reset IO[24]\n    TakeArm Keep = 0\n", "an output before TakeArm"),
    remark("force", "    TakeArm Keep = 0\n", "    ForceCtrl False\n    TakeArm Keep = 0\n",
           "a force change before TakeArm"),
    remark("plain", VIA, VIA.replace(", 5)", ", -1)"),
           "the via point of an arc leaves its figure open, its end has 5"),
    remark("plain", ARC_END, ARC_END.replace(", 5)", ", -1)"),
           "the via point of an arc has figure 5, its end leaves it open"),
    remark("plain", f"@0 {TARGET}", f"@E {TARGET}",
           "the pass mark @E, which no program of the post says"),
    remark("plain", f"@0 {TARGET}", f"@C {TARGET}",
           "the pass mark @C, which no program of the post says", others=True),
    remark("plain", f"@0 {TARGET}", f"@2 {TARGET}", "a blend in mm, by post.pass_mark it is @P",
           others=True),
    remark("mm", f"@0 {TARGET}", f"@P {TARGET}", "@P, by post.pass_mark blends are in mm",
           others=True),
    remark("plain", f"@0 {TARGET}", f"@0 {TARGET[1:]}", BARE),
    remark("plain", f"@0 {TARGET}", f"@ {TARGET}", BARE, others=True),
    remark("plain", VIA, VIA[1:], BARE),
    remark("other", "    Tool 3, P(", "    Tool 3, (", BARE),
    remark("plain", TARGET, TARGET.replace("0.0000, 5)", ", 5)"), LEFT_OUT),
    remark("plain", TARGET, TARGET.replace("0.000, 180", ", 180"), LEFT_OUT),
    remark("plain", HOME_JOINTS, HOME_JOINTS.replace("30.0000, 0.0000)", "30.0000, )"), LEFT_OUT),
    remark("plain", HOME_JOINTS, HOME_JOINTS.replace("(0.0000, ", "(, "), LEFT_OUT),
    remark("plain", "    Set IO[24]", "    ForceParam 1, 2, P(0, 5, 0, 0, , 0)\n    Set IO[24]",
           LEFT_OUT, others=True),
    remark("plain", TARGET, TARGET.replace(", 180.0000", ", --180.0000"), SIGNS),
    remark("plain", TARGET, TARGET.replace(", 5)", ", 10 / +2)"), SIGNS),
    remark("plain", OUT, "        Exit Sub\n", OTHERWISE, others=True),
    remark("plain", OUT, "        GiveArm\n", OTHERWISE, others=True),
    remark("plain", OUT, "        GiveArm        Exit Sub\n", OTHERWISE, others=True),
    remark("plain", OUT, OUT.replace("Exit", "GoTo"), OTHERWISE, others=True),
    remark("plain", OUT, f"{OUT}        Speed 10\n", OTHERWISE, others=True),
    remark("plain", "Mps(100 * unit) <", "Mps(110 * unit) <", OTHERWISE, others=True),
    remark("plain", "> 20 Then", "> 21 Then", OTHERWISE, others=True),
    remark("plain", "Mps(0.1) > 0.2", "Mps(0.1) > 0.3", OTHERWISE, others=True),
    taken("plain", TARGET, TARGET.replace(".0000", "").replace(".000", ".0")),
    taken("plain", TARGET, TARGET.lower()),
    taken("plain", TARGET, TARGET.replace("180.0000", "90 * 2")),
    taken("plain", TARGET, TARGET.replace("180.0000", "-(0 - 180)")),
    taken("plain", f"@0 {TARGET}", TARGET),
    taken("plain", "> 20 Then", ">20  THEN ' or so"),
    taken("parts", "ByVal unit As Single", "unit As Single"),
    taken("plain", "    Speed 10\n    Accel", "    Speed 10\n    Speed 10.0\n    Accel"),
    remark("plain", LINE, f"Dim x As Integer\n{LINE}",
           "the variable x, which no program of the post has"),
    remark("plain", LINE, f"Dim unit2 As Single = 1\n{LINE}",
           "the variable unit2, which no program of the post has"),
    remark("plain", LINE, f"x = 5\n{LINE}",
           ASSIGNED),
    remark("plain", LINE, f"unit = 1\n{LINE}",
           ASSIGNED, others=True),
    remark("plain", LINE, f"P[3] = P(1, 2, 3)\n{LINE}",
           ASSIGNED),
    remark("plain", LINE, f"D7 = 5\n{LINE}",
           ASSIGNED),
    remark("plain", LINE, f"Exit Sub\n{LINE}",
           "the procedure is left outside the question of the post for Mps", others=True),
    remark("plain", LINE, f"Motor On\n{LINE}", "Motor On, which no option asks for"),
    remark("plain", LINE, f'PrintDbg "x"\n{LINE}', "PrintDbg, which no program of the post has"),
    remark("plain", LINE, f"#Define X 5\n{LINE}", "#Define, which no program of the post has"),
    remark("plain", LINE, f"Delay (150)\n{LINE}", "a bracket stands around a single number"),
    fault("small", "(0.1) > 0.2", "(0.1) > 0.05", f"whether 0.1 mm/s is over 0.05 % {ARM}",
          others=True),
    fault("small", "(0.1) > 0.2", "(0.1) > 0.5", f"whether 100 mm/s is over 0.5 % {ARM}",
          others=True),
    fault("small", "(0.1) > 0.2", "(0.1) > 5", f"whether 100 mm/s is over 5 % {ARM}", others=True),
    fault("small", "(0.1) > 0.2", "(0.1) > 50", f"100 or 100000 mm/s, {UNIT}", others=True),
    fault("small", "(0.1) > 0.2", "(0.1) < 0.2",
          NAMES_ALONE, others=True),
    fault("small", "(0.1) > 0.2", "(10) > 0.2", f"whether 10 mm/s is over 0.2 % {ARM}",
          others=True),
    fault("small", "unit = 0.001", "unit = 1000",
          NAMES_ALONE, others=True),
    fault("small", "unit = 0.001", "unit = 0.01", f"whether 1000 mm/s is over 20 % {ARM}",
          others=True),
    fault("small", "Single = 1\n", "Single = 1000\n",
          NAMES_ALONE, others=True),
    fault("small", "(20 * unit)", "(20)", f"20 or 20000 mm/s, {UNIT}"),
    fault("small", "        unit = 0.001\n", "",
          NAMES_ALONE, others=True),
    fault("small", "    If Mps(0.1)", "    If IO[3] = On Then\n    End If\n    If Mps(0.1)",
          "If is not evaluated, up to line 11"),
    fault("small", " Or ", " Or 1 < 2 And ", "And beside Or is not evaluated", others=True),
    fault("small", " < 0.5", " = 0.5", "Mps(100 * unit) = 0.5 is not evaluated", others=True),
    fault("plain", ARC, ARC.replace(", 5)", ", 1)"), "from figure 5 to 1 along an arc", 0,
          others=True),
    remark("plain", ARC, ARC.replace(", 5)", ", 1)"), "from figure 1 to 5 along a line", 1,
           others=True),
    deviation("blended", "@2 ", "@3 ", "blend reads 3, planned is 2"),
    deviation("pressing", "    Reset IO[24]\n", "",
              "instruction 0: instruction reads output coolant 0, planned is output process 0"),
    deviation("pressing", "    Reset IO[7]\n", "",
              "instruction 1: instruction reads force 0 N, planned is output coolant 0"),
    deviation("pressing", "    ForceCtrl False ' verify\n", "",
              "instruction 2: instruction reads MoveJ to 6 joint values, planned is force 0 N"),
    deviation("shared", "= 12.3456\n", "= 12.3457\n", "share of the joints' speeds reads"),
    deviation("shared", "= 12.3456\n", "= Mps(60 * unit)\n",
              "share of the joints' speeds reads 0,"),
    deviation("turning", "= 12\n", "= 100\n", f"{TURNING} 8.726646, {PLANNED}"),
    deviation("turning", "= 12\n", "= 12.0002\n", f"{TURNING} 1.047215, {PLANNED}"),
    deviation("turning", "= 12\n", "= 11.9998\n", f"{TURNING} 1.04718, {PLANNED}"),
    deviation("turning", "= 12\n", "= Mps(20 * unit)\n", f"{TURNING} 0, {PLANNED}"),
    fault("turning", "= 12\n", "= Mps(20)\n", f"20 or 20000 mm/s, {UNIT}"),
]  # fmt: skip
