"""RAPID: changes of a program, and what the read-back finds after each."""

from collections.abc import Mapping, Sequence

from camgen.model.pose import TOOL_DOWN, Pose
from camgen.model.program import Force, Instruction, Joints, MoveC, MoveJ, MoveL, Output, Posture
from tests.support.changes import deviation, fault, remark
from tests.support.samples import Sample

PRESS = (0.0, 0.0, -1.0)
HOME = MoveJ(Joints((0.0, 0.0, 0.0, 0.0, 0.5, 0.0)), 100.0)
SIGNALS: dict[str, object] = {"signals": {"process": "doProcess", "spindle": "aoSpindle"}}


def at(x: float, y: float, z: float = 0.0) -> Pose:
    return Pose(TOOL_DOWN, (x, y, z))


CUT = (
    Output("spindle", 9000.0),
    MoveJ(at(0, 0, 20), 100.0),
    MoveL(at(0, 0), 20.0),
    Output("process", 1.0),
    MoveC(at(5, 2), at(10, 0), 37.0),
    MoveL(at(30, 0), 20.0),
    Output("process", 0.0),
    Output("spindle", 0.0),
)
TWO_OUTPUTS = (
    MoveJ(at(0, 0, 20), 100.0),
    Output("process", 1.0),
    Output("air", 1.0),
    MoveL(at(0, 0), 20.0),
    Output("process", 0.0),
    Output("air", 0.0),
)
PRESSED = (
    MoveL(at(0, 0, 30), 50.0),
    MoveL(at(0, 0), 20.0),
    Force(9.0, PRESS),
    MoveL(at(30, 0), 20.0, 0.0, 9.0, PRESS),
    Force(0.0),
    MoveL(at(30, 0, 30), 20.0),
)
KNOWN = Posture((0, -1, 0, 4))
POSED = (MoveJ(at(0, 0, 20), 100.0, posture=KNOWN), MoveL(at(0, 0), 20.0, posture=KNOWN))
PRESSED_TWICE = (
    *PRESSED,
    MoveL(at(0, 0), 20.0),
    Force(9.0, PRESS),
    MoveL(at(30, 0), 20.0, 0.0, 9.0, PRESS),
    Force(0.0),
    MoveL(at(30, 0, 30), 20.0),
)
GROUND = (Output("process", 1.0), *PRESSED, Output("process", 0.0))
LOAD = {"mass": 1.8, "cog": [0, 0, 55], "acc_set": [50, 40], "sing_area": "wrist"}
PRESSING = {"force_load": "lTool", "force_change": 20.0, "force_distance": 5.0}


def sample(body: Sequence[Instruction], options: Mapping[str, object] | None = None) -> Sample:
    """A program that moves home and then runs `body`."""
    return Sample("rapid", (HOME, *body), options)


PROGRAMS = {
    "cut": sample(CUT, SIGNALS),
    "weighed": sample(CUT, SIGNALS | LOAD),
    "pressed": sample(PRESSED, PRESSING),
    "posed": sample(POSED),
    "stated": sample(POSED, {"conf": "state"}),
    "twice": sample(PRESSED_TWICE, {"force_load": "lTool"}),
    "glued": sample(TWO_OUTPUTS, {"signals": {"process": "doProcess", "air": "doAir"}}),
    "ground": sample(GROUND, {"force_calibrated": True}),
    "taken": sample(CUT, SIGNALS | {"declare": False}),
    "old": sample(CUT, SIGNALS | {"s4": True}),
    "exit": sample(CUT, SIGNALS | {"on_error": "exit"}),
}

TOOL = "tooldata tCamgen:=[TRUE,[[0.000,0.000,100.000],[1.0000000,0.0000000,0.0000000,0.0000000]],"
CONFJ, CONFL = "        ConfJ\\Off;\n", "        ConfL\\Off;\n"
ERROR = "    ERROR\n        camSafe;\n        RAISE;\n"
DEACT = "        IF FCIsForceMode() FCDeact;\n"
SETTLE, CALIBRATE = "        WaitTime\\InPos,0;\n", "        FCCalib lTool;\n"
PROCESS_OFF, AIR_OFF = "        SetDO doProcess,0;\n", "        SetDO doAir,0;\n"
BANNER = "a banner other than %%% / VERSION:1 / LANGUAGE:ENGLISH / %%%"
UNSETTLED = "FCCalib without WaitTime\\InPos right before it: the arm may still swing"
ORDER = "the ERROR handler of main switches off in another order than posts do, force control last"
VIA = "MoveC [[5.000,2.000,0.000]"
UNASKED = "fcdeact without IF FCIsForceMode(): it may be an error where force control is off"

CHANGES = [
    fault("cut", VIA, "MoveC [[5.000,50.000,0.000]", "an arc of 337 deg; MoveC takes up to 240", 0),
    fault("cut", VIA, "MoveC [[9.999,0.050,0.000]",
          "the circle point of an arc is at an end of it, or nearly on its chord", 0),
    fault("cut", VIA, "MoveC [[5.000,0.020,0.000]",
          "the circle point of an arc is at an end of it, or nearly on its chord", 0),
    fault("cut", VIA, "MoveC [[5.000,0.000,0.000]", "the points of an arc are on one line", 0),
    fault("cut", "\nENDMODULE", "\n    CONST num n:=1;\nENDMODULE",
          "CONST after the first routine of the module", 1, others=True),
    fault("cut", 'TRUE,"",', f'TRUE,"{"m" * 81}",',
          "a string of 81 characters; a controller takes 80", 0, others=True),
    fault("cut", "[0,0,0,0],[9E9", "[0,0,0,8],[9E9", "cfx is 8, not 0 to 7", 0),
    fault("cut", "[[0.0000,0.0000,", "[[0.0000,9999.0000,", "axis 2 at 9999 deg", 0, others=True),
    fault("cut", "        SetDO doProcess,1;", "        SetAO doProcess,1;",
          "setao of process, which is a digital output", 0),
    fault("cut", "        SetAO aoSpindle,9000;", "        SetDO aoSpindle,1;",
          "setdo of spindle, which is an analog output", 0),
    fault("cut", "        SetAO aoSpindle,9000;", "        Set aoSpindle;",
          "set of spindle, which is an analog output", 0),
    fault("cut", "vCam37:=[37,500,", "vCam37:=[37,0,", "a speed that is not positive", 0,
          others=True),
    fault("cut", "vCam37:=[37,500,", "vCam37:=[37,-500,", "a speed that is not positive", 0,
          others=True),
    fault("cut", "PROC camSafe()", "PROC TPWrite()", "TPWrite is predefined", 0, others=True),
    fault("cut", "MODULE part", "MODULE robtarget", "robtarget is predefined", 0),
    fault("cut", "    CONST speeddata", "    CONST num Offs:=1;\n    CONST speeddata",
          "Offs is predefined", 0, others=True),
    remark("cut", VIA, "MoveC [[0.500,0.600,0.000]",
           "the circle point of an arc is near an end of it"),
    remark("cut", "[[5.000,2.000,0.000],[0.0000000,1.0000000,0.0000000,0.0000000],[0,0,",
           "[[5.000,2.000,0.000],[0.0000000,1.0000000,0.0000000,0.0000000],[0,1,",
           "the circle point of an arc has another configuration than its end"),
    remark("cut", "[0,0,0,0],[9E9", "[5,0,0,0],[9E9", "axis 1 in quarter turn 5; arms have -3 to 2",
           others=True),
    remark("cut", "[[0.0000,0.0000,0.0000,0.0000,28.6479,0.0000]",
           "[[0.0000,0.0000,0.0000,0.0000,28.6479,720.0000]", "axis 6 at 720 deg"),
    remark("cut", "MoveL [[30.000,0.000,0.000],[0.0000000,1.0000000,",
           "MoveL [[30.000,0.000,0.000],[1.0000000,0.0000000,",
           "the tool turns by 180 deg in one straight motion; its sense is open"),
    remark("cut", "TASK PERS tooldata", "PERS tooldata",
           "tCamgen is PERS, one for all tasks, not TASK PERS"),
    remark("cut", "TASK PERS wobjdata", "PERS wobjdata",
           "wCamgen is PERS, one for all tasks, not TASK PERS"),
    remark("old", "PERS tooldata", "TASK PERS tooldata", "tCamgen is TASK PERS, which S4 has not"),
    remark("old", "ENGLISH", "ENGLISHH", BANNER),
    remark("old", "VERSION:1\n", "VERSION:1 ", BANNER),
    remark("cut", "MODULE part\n", "! x\nMODULE part\n",
           "a comment outside of a module, where the kernel manual has none"),
    remark("cut", "ENDMODULE\n", "ENDMODULE\n! x\n",
           "a comment outside of a module, where the kernel manual has none"),
    remark("taken", "WObj:=wCamgen", "WObj:=WaitTime",
           "WaitTime is not declared, by post.work it is wCamgen", others=True),
    remark("pressed", SETTLE, "", UNSETTLED),
    remark("pressed", SETTLE + CALIBRATE, CALIBRATE + SETTLE, UNSETTLED),
    remark("pressed", SETTLE, SETTLE + "        SetDO doOther,0;\n", UNSETTLED, others=True),
    remark("pressed", CALIBRATE, CALIBRATE * 2, UNSETTLED),
    remark("twice", CALIBRATE, "",
           "no FCCalib before pressing, though post.force_load asks for it"),
    remark("glued", "    PROC camSafe()\n" + PROCESS_OFF + AIR_OFF,
           "    PROC camSafe()\n" + AIR_OFF + PROCESS_OFF, ORDER),
    remark("ground", "        camSafe;\n" + DEACT, DEACT + "        camSafe;\n", ORDER),
    # The orientation at the circle point gives the sense in which the tool turns (MoveC).
    deviation("cut", f"{VIA},[0.0000000,1.0000000,", f"{VIA},[1.0000000,0.0000000,",
              "orientation half-way reads"),
    deviation("ground", DEACT, "",
              "instruction 1: instruction reads MoveJ to 6 joint values, planned is force 0 N"),
    deviation("ground", PROCESS_OFF, "",
              "instruction 0: instruction reads force 0 N, planned is output process 0"),
    remark("ground", DEACT, "        FCDeact;\n", UNASKED),
    remark("ground", f"camSafe;\n{DEACT}", "camSafe;\n        FCDeact;\n", UNASKED),
    fault("ground", DEACT, "        IF FCIsForceMode() FCAct;\n",
          "IF is read as IF FCIsForceMode() FCDeact; alone"),
    fault("ground", DEACT, "        IF NOT FCIsForceMode() FCDeact;\n",
          "IF is a statement that is not read"),
    remark("cut", CONFJ, "", "a configuration of zeros, and ConfJ is not off"),
    remark("cut", CONFL, "", "a configuration of zeros, and ConfL is not off"),
    remark("stated", CONFL, CONFL.replace("Off", "On"), "ConfL is on, though post.conf is state"),
    remark("posed", "ConfJ\\On", "ConfJ\\Off",
           "ConfJ is off, though each of its motions states a configuration"),
    remark("posed", "ConfL\\On", "ConfL\\Off",
           "ConfL is off, though each of its motions states a configuration"),
    remark("cut", "vCam37:=[37,500,", "vCam37:=[37,50,",
           "a speed of 50 deg/s limits a motion that travels"),
    remark("weighed", f"{TOOL}[1.8,", f"{TOOL}[8.1,",
           "a tool of 8.1 kg with its centre of gravity at 0, 0, 55 mm, "
           "by post.mass and post.cog it has 1.8 kg at 0, 0, 55 mm"),
    remark("weighed", "[1.8,[0,0,55]", "[1.8,[0,55,0]",
           "a tool of 1.8 kg with its centre of gravity at 0, 55, 0 mm, "
           "by post.mass and post.cog it has 1.8 kg at 0, 0, 55 mm"),
    remark("weighed", "[0,0,55],[1,0,0,0],0,0,0]", "[0,0,55],[1,0,0,0],9,0,0]",
           "a tool with inertia, which the options do not give"),
    remark("weighed", "AccSet 50,40", "AccSet 50,90",
           "AccSet is not what post.acc_set asks for, 50, 40"),
    remark("weighed", "        AccSet 50,40;\n", "",
           "AccSet is not what post.acc_set asks for, 50, 40"),
    remark("cut", CONFL, f"{CONFL}        AccSet 50,50;\n",
           "AccSet is not what post.acc_set asks for, none"),
    remark("weighed", "SingArea\\Wrist", "SingArea\\Off",
           "SingArea is not what post.sing_area asks for, wrist"),
    remark("pressed", ",50\\Force", ",5\\Force",
           "threshold is 5 %, by post.force_threshold it is 50"),
    remark("pressed", "\\ForceChange:=20", "\\ForceChange:=200",
           "forcechange is 200 N/s, by post.force_change it is 20"),
    remark("pressed", "\\ForceChange:=20", "",
           "forcechange is 0 N/s, by post.force_change it is 20"),
    remark("pressed", "\\PosSupvDist:=5", "\\PosSupvDist:=50",
           "possupvdist is 50 mm, by post.force_distance it is 5"),
    remark("pressed", "\\PosSupvDist:=5", "\\PosSupvDist:=5\\UseSpdFFW",
           "UseSpdFFW, which no option asks for"),
    remark("pressed", "        FCCalib lTool;\n", "",
           "no FCCalib before pressing, though post.force_load asks for it"),
    remark("pressed", "FCCalib lTool;", "FCCalib [9,[0,0,1],[1,0,0,0],0,0,0];",
           "FCCalib with another load than post.force_load = lTool"),
    remark("pressed", f"    ERROR\n{DEACT}", "    ERROR\n",
           "the ERROR handler of main leaves force control on"),
    remark("cut", ERROR, "", "main has no ERROR handler, which post.on_error asks for",
           others=True),
    remark("exit", "        EXIT;", "        RAISE;",
           "the ERROR handler of main ends with RAISE, by post.on_error it is exit"),
    fault("cut", "    PROC main()", "    TASK PROC main()",
          "TASK before PROC: it belongs to data alone"),
    remark("cut", "    PROC camSafe()", "    LOCAL PROC camSafe()",
           "a routine that is LOCAL, which the controller cannot call by an event"),
    remark("cut", "    PROC main()", "    CONST num k:=1;\n    PROC main()",
           "k is declared and never used"),
    remark("cut", "    PROC camSafe()", "    PROC spare()\n    ENDPROC\n    PROC camSafe()",
           "spare is declared and never used"),
    remark("cut", "        camSafe;\n        RAISE;",
           "        camSafe;\n        SetDO doProcess,0;\n        RAISE;",
           "the ERROR handler of main switches an output itself, not in a routine"),
    remark("cut", ",v20,", ",[20,500,5000,0],",
           "a speed with 5000, 0 for external axes, where posts write 5000, 1000"),
    remark("cut", ",v20,", ",[20,500,4000,1000],",
           "a speed with 4000, 1000 for external axes, where posts write 5000, 1000"),
]  # fmt: skip
