"""KRL, the example of docs/writing-a-post.md: changes of a program, and the finding after each."""

import math
from pathlib import Path

from camgen.model.pose import TOOL_DOWN, Pose
from camgen.model.program import Joints, MoveC, MoveJ, MoveL, Output, Wait
from tests.support.changes import fault
from tests.support.samples import Sample

EXAMPLE = Path(__file__).parents[3] / "docs" / "example_post"
HOME = MoveJ(Joints((0.0, -math.pi / 2, math.pi / 2, 0.0, math.pi / 2, 0.0)), 100.0)
BODY = (
    HOME,
    MoveL(Pose(TOOL_DOWN, (0, 0, 0)), 20.0, 1.0),
    MoveC(Pose(TOOL_DOWN, (5, 5, 0)), Pose(TOOL_DOWN, (10, 0, 0)), 20.0),
    Output("process", 1.0),
    Wait(0.5),
)
READBACK = str(EXAMPLE / "krl_language.py")
PROGRAMS = {"part": Sample(str(EXAMPLE / "krl.py"), BODY, readback=READBACK)}

BASE = "$BASE={X 300.000, Y -75.000, Z 150.000, A 0.0000, B 0.0000, C 0.0000}\n"
BAS = "BAS(#INITMOV, 0)\n"
HOME_LINE = "PTP {A1 0.0000, A2 -90.0000, A3 90.0000, A4 0.0000, A5 90.0000, A6 0.0000}\n"
TURN = "A 0.0000, B 0.0000, C 180.0000"
ARC = f"CIRC {{X 5.000, Y 5.000, Z 0.000, {TURN}}}, {{X 10.000, Y 0.000, Z 0.000, {TURN}}}"
UNKNOWN = "not a statement that is known: "

CHANGES = [
    fault("part", BASE, "", "$BASE must be set before the first motion"),
    fault("part", BASE, BASE + BASE, "$BASE must be set once, before the first motion"),
    fault("part", BAS, "", "BAS must come before other settings", others=True),
    fault("part", BAS + "$IPO_MODE=#BASE\n", "$IPO_MODE=#BASE\n" + BAS,
          "BAS must come before other settings", times=2),
    fault("part", BAS, "$VEL.CP=0.020000\n" + BAS, "BAS must come before other settings"),
    fault("part", "$VEL_AXIS[4]=10\n", "", "$VEL_AXIS[4] must be set before the first motion"),
    fault("part", "$VEL_AXIS[4]=10\n", "$VEL_AXIS[4]=110\n",
          "$VEL_AXIS[4] must be above 0 and at most 100 %", others=True),
    fault("part", "$ORI_TYPE=#VAR", "$ORI_TYPE=#CONSTANT",
          f"{UNKNOWN}$ORI_TYPE=#CONSTANT", others=True),
    fault("part", "$CIRC_TYPE=#BASE", "$CIRC_TYPE=#PATH",
          f"{UNKNOWN}$CIRC_TYPE=#PATH", others=True),
    fault("part", "$VEL.CP=0.020000\n", "", "$VEL.CP must be set, and positive", times=2),
    fault("part", "$APO.CDIS=1.000\n", "", "C_DIS without a positive $APO.CDIS"),
    fault("part", "WAIT SEC", "$TOOL={X 0, Y 0, Z 0, A 0, B 0, C 0}\nWAIT SEC",
          "$TOOL must be set once, before the first motion"),
    fault("part", HOME_LINE, "", "the first motion must be PTP to axis values", times=2),
    fault("part", "$OUT[1]", "$OUT[2]", "no signal has the output 2"),
    fault("part", "WAIT SEC 0.500", "WAIT SEC 0.500 G0",
          f"{UNKNOWN}WAIT SEC 0.500 G0"),
    fault("part", "CIRC {", "SCIRC {", f"{UNKNOWN}S{ARC}"),
    fault("part", "X 10.000", "X 1.0E1", UNKNOWN + ARC.replace("10.000", "1.0E1")),
    fault("part", "END\n", "", "a program runs from DEF to END"),
    fault("part", "END\n", "END\n$OUT[1]=TRUE\n", "a program runs from DEF to END"),
    fault("part", "WAIT", "END\nWAIT", "a program runs from DEF to END"),
    fault("part", "DEF part()", "DEF 2part()", f"{UNKNOWN}DEF 2part()"),
]  # fmt: skip
