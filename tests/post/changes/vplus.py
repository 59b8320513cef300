"""V+: changes of a program, and what the read-back finds after each."""

from tests.support.changes import fault, remark
from tests.support.samples import Sample

#: A program whose first motion is in line 16.
BRACKET = """\
.PROGRAM bracket_top()
; bracket.dxf_ layer holes
; mm and deg. TRANS(x, y, z, yaw, pitch, roll), R = Rz Ry Rz
; speeds hold at monitor speed 100. SPEED 100 in a MOVE counts as 1000 mm/s
    AUTO cg.tool, cg.work
    SELECT ROBOT = 1
    ATTACH ()
    ENABLE CP
    ACCEL (0) 100, 100
    SET cg.tool = TRANS(0,0,100,0,0,0)
    TOOL cg.tool
    SET cg.work = TRANS(250,-75,150,0,0,0)
    SIGNAL -33
    SPEED 10 ALWAYS
    RIGHTY
    MOVE #PPOINT(0, 45, 50, 0)
    BREAK
    SPEED 12.5 ALWAYS
    MOVE cg.work:TRANS(10,20.5,20,0,180,180)
    SPEED 20, 100 MMPS ALWAYS
    MOVES cg.work:TRANS(10,20.5,0,0,180,180)
    BREAK
    SIGNAL 33
    WAIT.EVENT , 0.15
; edge 1
    MOVES cg.work:TRANS(-0.001,20.5,0,0,180,90)
    SPEED 12.3457, 100 MMPS ALWAYS
    MOVES cg.work:TRANS(40,0,0,0,180,0)
    BREAK
    SIGNAL -33
    SPEED 10 ALWAYS
    MOVE #PPOINT(0, 45, 50, 0)
    BREAK
    DETACH ()
    RETURN
.END
"""
PROGRAMS = {
    "bracket": Sample("vplus", BRACKET, {"rated": 1000.0}),
    "right": Sample("vplus", BRACKET, {"rated": 1000.0, "posture": ["RIGHTY"]}),
}

NO_OUTPUT, SAID = "not an output", "set"
UNSAID = f"not {SAID} before the first motion: the program before may have left it otherwise"
SETTLES = "sets how exactly the robot stops, which camgen never writes"
RATED = "ACCEL other than (0) 100, 100: corners and the time of the program are others"
OVER = "SPEED above 100 %: the controller takes the most that it has"
GONE = "after DETACH: the robot may be another program's by then"
SLOWER = (
    "a straight motion at 5 % rotational speed:"
    " where the tool turns, it may be slower than its SPEED"
)
LEFT_OUT = "a joint of #PPOINT left out, read as 0: what it means is not confirmed"
SHARED_BY = (
    "is not declared by AUTO: a global variable,"
    " which other programs share and which outlives this one"
)
HEADER = ".PROGRAM bracket_top()"
FIRST_MOVE = "    MOVE #PPOINT(0, 45, 50, 0)\n    BREAK\n"
POSTURE = "post.posture asks for RIGHTY before the first MOVE"
POINT = f"{FIRST_MOVE}    SPEED 12.5"

CHANGES = [
    fault("bracket", "    RETURN", "    MOVE cg.work:NULL\n    BREAK",
          "a motion after DETACH: the robot is not attached to this program", 0, others=True),
    fault("bracket", HEADER, ".PROGRAM move()", "move is a word of V+, not the name of a program",
          0),
    fault("bracket", HEADER, ".PROGRAM Coarse()",
          "Coarse is a word of V+, not the name of a program", 0),
    remark("bracket", HEADER, ".PROGRAM bracket_top_side()",
           "bracket_top_side is longer than 15 characters, of which V+ ignores the rest", 0),
    fault("bracket", "    AUTO cg.tool, cg.work", "    AUTO cg.tool, cg.work, cg.tool",
          "cg.tool is declared twice", 0),
    fault("bracket", "    SELECT ROBOT", "    AUTO cg.work\n    SELECT ROBOT",
          "cg.work is declared twice", 0),
    fault("bracket", "    BREAK\n    SIGNAL 33", "7   BREAK\n07  SIGNAL 33",
          "label 7 is there twice", 1, others=True),
    remark("bracket", ".END\n", ".END foo\n", "'foo' after .END, of which V+ reads no more", 0),
    fault("bracket", "(40,0,0,0,180,0)", "(40,0,0,0,170,0)",
          "the flange 10 deg from straight down, which an arm of four axes cannot take", 0),
    fault("bracket", "(40,0,0,0,180,0)", "(40,0,0,0,0,0)",
          "the flange 180 deg from straight down, which an arm of four axes cannot take", 0),
    fault("bracket", "    RIGHTY", "    RIGHTY\n    FLIP",
          "FLIP: an arm of four axes has no such posture", 1),
    fault("bracket", "    RIGHTY", "    BELOW", "BELOW: an arm of four axes has no such posture",
          0),
    fault("bracket", "SIGNAL 33\n    WAIT", "SIGNAL 33, 10000\n    WAIT",
          f"10000 is {NO_OUTPUT}", 0),
    fault("bracket", "SIGNAL 33\n    WAIT", "SIGNAL 33, 2000\n    WAIT", f"2000 is {NO_OUTPUT}", 0),
    remark("bracket", "SPEED 12.5 ALWAYS", "SPEED 120 ALWAYS", OVER, 0),
    remark("bracket", "20, 100 MMPS", "20, 101 MMPS", OVER, 0),
    remark("bracket", "    RIGHTY", "    SPEED 101 MONITOR", OVER, 0, others=True),
    fault("bracket", POINT, POINT.replace("50, 0", "50, 0, 0, 0"),
          "a precision point of 4 axes, others have 6", 16),
    remark("bracket", "    RIGHTY", "    COARSE", f"COARSE {SETTLES}", 0),
    remark("bracket", "    RIGHTY", "    COARSE 150 ALWAYS", f"COARSE {SETTLES}", 0),
    remark("bracket", "    RIGHTY", "    FINE 50", f"FINE {SETTLES}", 0),
    remark("bracket", "    RIGHTY", "    NULL", f"NULL {SETTLES}", 0),
    remark("bracket", "    RIGHTY", "    NONULL ALWAYS", f"NONULL {SETTLES}", 0),
    fault("bracket", "    RIGHTY", "    COARSE 0", "COARSE 0 is not evaluated", 0),
    fault("bracket", "    RIGHTY", "    NULL 5", "NULL 5 is not evaluated", 0),
    remark("bracket", "ACCEL (0) 100, 100", "ACCEL (0) 200, 100", RATED, 0),
    remark("bracket", "ACCEL (0) 100, 100", "ACCEL (0) 100", RATED, 0),
    remark("bracket", "ACCEL (0) 100, 100", "ACCEL (1) 100, 100", RATED, 0),
    remark("bracket", "ACCEL (0) 100, 100", "ACCEL 100, 100",
           "ACCEL without a profile keeps that of the program before", 0),
    fault("bracket", "ACCEL (0) 100, 100", "ACCEL (9) 100, 100", "ACCEL has profiles 0 to 8, not 9",
          0, others=True),
    remark("bracket", "    ACCEL (0) 100, 100\n", "", f"ACCEL {UNSAID}", 6),
    remark("bracket", "    ENABLE CP\n", "", f"ENABLE CP {UNSAID}", 7),
    remark("bracket", "    ATTACH ()\n", "", f"ATTACH {UNSAID}", 8),
    remark("bracket", "    SELECT ROBOT = 1\n", "", f"SELECT ROBOT {UNSAID}", 9),
    remark("bracket", "    TOOL cg.tool\n", "", f"TOOL {UNSAID}", 4),
    remark("bracket", "    SELECT ROBOT = 1\n    ATTACH ()", "    ATTACH ()\n    SELECT ROBOT = 1",
           "SELECT ROBOT after ATTACH, which took the robot that was selected before", 1),
    remark("bracket", "ATTACH ()", "ATTACH", "ATTACH without (): what that means is not confirmed",
           0),
    remark("bracket", "DETACH ()", "DETACH ;)",
           "DETACH without (): what that means is not confirmed", 0),
    remark("bracket", "    DETACH ()\n", "",
           "the program ends without DETACH: the robot stays attached", 0),
    remark("bracket", "    DETACH ()\n    RETURN", "    RETURN\n    DETACH ()",
           "the program ends without DETACH: the robot stays attached", 0, others=True),
    remark("bracket", "DETACH ()", "DETACH ()\n    DETACH ()", f"DETACH {GONE}", 1),
    remark("bracket", "DETACH ()", "DETACH ()\n    SIGNAL -33", f"an output {GONE}", 1),
    remark("bracket", "DETACH ()", "DETACH ()\n    WAIT.EVENT , 1", f"a dwell {GONE}", 1),
    fault("bracket", "    RETURN", "    RETURN RETURN", "RETURN stands alone", 0),
    remark("bracket", "    RETURN", "    LEFTY",
           "LEFTY after the last motion stays in force for the program after this one", 0),
    remark("bracket", "100 MMPS ALWAYS", "100 ALWAYS MMPS",
           "ALWAYS stands last in a SPEED: another order is not confirmed", 0),
    remark("bracket", "    SPEED 20, 100 MMPS ALWAYS\n", "",
           "a straight motion with its SPEED in percent: mm/s by post.rated", 0),
    remark("bracket", "20, 100 MMPS", "20, 5 MMPS", SLOWER, 1),
    remark("bracket", "#PPOINT(0, ", "#PPOINT(, ", LEFT_OUT, 0),
    remark("bracket", "#PPOINT(0, 45, 50, 0)", "#PPOINT(0, 45, 50,)", LEFT_OUT, 0),
    remark("bracket", "    AUTO cg.tool, cg.work\n", "", f"cg.tool {SHARED_BY}", 4),
    remark("bracket", "cg.tool, cg.work", "cg.tool, cg.wora", f"cg.work {SHARED_BY}", 7),
    remark("bracket", "    AUTO", "    LOCAL",
           "LOCAL: its variables outlive the program, those of AUTO do not", 0),
    remark("bracket", "ENABLE", "DISABLE",
           "DISABLE CP: every motion stops, those of the programs after this one too", 0),
    remark("bracket", "    RIGHTY", "    BASE", "BASE sets the world frame, for other programs too",
           0),
    remark("bracket", "    RIGHTY", "    SPEED 50 MONITOR",
           "SPEED MONITOR sets the operator's speed, for other programs too", 0, others=True),
    remark("right", "    RIGHTY\n", "", POSTURE, 0),
    remark("right", f"    RIGHTY\n{FIRST_MOVE}", f"{FIRST_MOVE}    RIGHTY\n", POSTURE, 0),
    remark("right", "RIGHTY\n", "LEFTY\n", POSTURE, 1),
    remark("right", "    WAIT.EVENT", "    LEFTY\n    WAIT.EVENT", POSTURE, 0),
]  # fmt: skip
