"""The read-back of RAPID takes no more than a controller does, nor what the options do not ask for: one change each."""

import math
from collections.abc import Mapping
from contextlib import nullcontext

import numpy as np
import pytest
from camgen_posts.rapid import Rapid
from camgen_posts.rapid.force import arc_fault, find_round
from camgen_posts.readback.rapid import read

from camgen.model.errors import Refused, VerifyError
from camgen.model.pose import IDENTITY, TOOL_DOWN, Pose, frozen, rotation_about, translation
from camgen.model.program import (
    Force,
    Instruction,
    Joints,
    MoveC,
    MoveJ,
    MoveL,
    Output,
    Posture,
    Program,
)
from camgen.post import Remark
from camgen.post.plugins import make_post
from camgen.post.verify import compare
from tests.support.strict import find_after
from tests.support.whole import whole

PRESS = (0.0, 0.0, -1.0)
HOME = MoveJ(Joints((0.0, 0.0, 0.0, 0.0, 0.5, 0.0)), 100.0)
SIGNALS: dict[str, object] = {"signals": {"process": "doProcess", "spindle": "aoSpindle"}}


def at(x: float, y: float, z: float = 0.0) -> Pose:
    return Pose(TOOL_DOWN, (x, y, z))


def text_of(body: tuple[Instruction, ...], options: Mapping[str, object]) -> str:
    post = make_post(Rapid, options)
    program = Program(
        "part", translation(300, -75, 100), translation(0, 0, 100), whole((HOME, *body))
    )
    (file,) = post.render(post.prepare(program, 0.01))
    return file.text


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
BODIES = {
    "cut": (CUT, SIGNALS),
    "weighed": (
        CUT,
        SIGNALS | {"mass": 1.8, "cog": [0, 0, 55], "acc_set": [50, 40], "sing_area": "wrist"},
    ),
    "pressed": (PRESSED, {"force_load": "lTool", "force_change": 20.0, "force_distance": 5.0}),
    "posed": (POSED, {}),
    "stated": (POSED, {"conf": "state"}),
    "twice": (
        (
            *PRESSED,
            MoveL(at(0, 0), 20.0),
            Force(9.0, PRESS),
            MoveL(at(30, 0), 20.0, 0.0, 9.0, PRESS),
            Force(0.0),
            MoveL(at(30, 0, 30), 20.0),
        ),
        {"force_load": "lTool"},
    ),
    "glued": (TWO_OUTPUTS, {"signals": {"process": "doProcess", "air": "doAir"}}),
    "ground": (
        (Output("process", 1.0), *PRESSED, Output("process", 0.0)),
        {"force_calibrated": True},
    ),
    "taken": (CUT, SIGNALS | {"declare": False}),
    "old": (CUT, SIGNALS | {"s4": True}),
    "exit": (CUT, SIGNALS | {"on_error": "exit"}),
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
#: What a controller refuses: program, what stands there and what then does, the words of the fault.
FAULTS = [
    ("cut", VIA, "MoveC [[5.000,50.000,0.000]", "an arc of 337 deg; MoveC takes up to 240"),
    (
        "cut",
        VIA,
        "MoveC [[9.999,0.050,0.000]",
        "the circle point of an arc is at an end of it, or nearly on its chord",
    ),
    (
        "cut",
        VIA,
        "MoveC [[5.000,0.020,0.000]",
        "the circle point of an arc is at an end of it, or nearly on its chord",
    ),
    ("cut", VIA, "MoveC [[5.000,0.000,0.000]", "the points of an arc are on one line"),
    (
        "cut",
        "\nENDMODULE",
        "\n    CONST num n:=1;\nENDMODULE",
        "CONST after the first routine of the module",
    ),
    ("cut", 'TRUE,"",', f'TRUE,"{"m" * 81}",', "a string of 81 characters; a controller takes 80"),
    ("cut", "[0,0,0,0],[9E9", "[0,0,0,8],[9E9", "cfx is 8, not 0 to 7"),
    ("cut", "[[0.0000,0.0000,", "[[0.0000,9999.0000,", "axis 2 at 9999 deg"),
    (
        "cut",
        "        SetDO doProcess,1;",
        "        SetAO doProcess,1;",
        "setao of process, which is a digital output",
    ),
    (
        "cut",
        "        SetAO aoSpindle,9000;",
        "        SetDO aoSpindle,1;",
        "setdo of spindle, which is an analog output",
    ),
    (
        "cut",
        "        SetAO aoSpindle,9000;",
        "        Set aoSpindle;",
        "set of spindle, which is an analog output",
    ),
    ("cut", "vCam37:=[37,500,", "vCam37:=[37,0,", "a speed that is not positive"),
    ("cut", "vCam37:=[37,500,", "vCam37:=[37,-500,", "a speed that is not positive"),
    ("cut", "PROC camSafe()", "PROC TPWrite()", "TPWrite is predefined"),
    ("cut", "MODULE part", "MODULE robtarget", "robtarget is predefined"),
    (
        "cut",
        "    CONST speeddata",
        "    CONST num Offs:=1;\n    CONST speeddata",
        "Offs is predefined",
    ),
]
#: What it takes, and no program of ours says.
REMARKS = [
    ("cut", VIA, "MoveC [[0.500,0.600,0.000]", "the circle point of an arc is near an end of it"),
    (
        "cut",
        "[[5.000,2.000,0.000],[0.0000000,1.0000000,0.0000000,0.0000000],[0,0,",
        "[[5.000,2.000,0.000],[0.0000000,1.0000000,0.0000000,0.0000000],[0,1,",
        "the circle point of an arc has another configuration than its end",
    ),
    ("cut", "[0,0,0,0],[9E9", "[5,0,0,0],[9E9", "axis 1 in quarter turn 5; arms have -3 to 2"),
    (
        "cut",
        "[[0.0000,0.0000,0.0000,0.0000,28.6479,0.0000]",
        "[[0.0000,0.0000,0.0000,0.0000,28.6479,720.0000]",
        "axis 6 at 720 deg",
    ),
    (
        "cut",
        "MoveL [[30.000,0.000,0.000],[0.0000000,1.0000000,",
        "MoveL [[30.000,0.000,0.000],[1.0000000,0.0000000,",
        "the tool turns by 180 deg in one straight motion; its sense is open",
    ),
    (
        "cut",
        "TASK PERS tooldata",
        "PERS tooldata",
        "tCamgen is PERS, one for all tasks, not TASK PERS",
    ),
    (
        "cut",
        "TASK PERS wobjdata",
        "PERS wobjdata",
        "wCamgen is PERS, one for all tasks, not TASK PERS",
    ),
    ("old", "PERS tooldata", "TASK PERS tooldata", "tCamgen is TASK PERS, which S4 has not"),
    ("old", "ENGLISH", "ENGLISHH", BANNER),
    ("old", "VERSION:1\n", "VERSION:1 ", BANNER),
    (
        "cut",
        "MODULE part\n",
        "! x\nMODULE part\n",
        "a comment outside of a module, where the kernel manual has none",
    ),
    (
        "cut",
        "ENDMODULE\n",
        "ENDMODULE\n! x\n",
        "a comment outside of a module, where the kernel manual has none",
    ),
    (
        "taken",
        "WObj:=wCamgen",
        "WObj:=WaitTime",
        "WaitTime is not declared, by post.work it is wCamgen",
    ),
    ("pressed", SETTLE, "", UNSETTLED),
    ("pressed", SETTLE + CALIBRATE, CALIBRATE + SETTLE, UNSETTLED),
    ("pressed", SETTLE, SETTLE + "        SetDO doOther,0;\n", UNSETTLED),
    ("pressed", CALIBRATE, CALIBRATE * 2, UNSETTLED),
    ("twice", CALIBRATE, "", "no FCCalib before pressing, though post.force_load asks for it"),
    (
        "glued",
        "    PROC camSafe()\n" + PROCESS_OFF + AIR_OFF,
        "    PROC camSafe()\n" + AIR_OFF + PROCESS_OFF,
        ORDER,
    ),
    ("ground", "        camSafe;\n" + DEACT, DEACT + "        camSafe;\n", ORDER),
    ("cut", CONFJ, "", "a configuration of zeros, and ConfJ is not off"),
    ("cut", CONFL, "", "a configuration of zeros, and ConfL is not off"),
    ("stated", CONFL, CONFL.replace("Off", "On"), "ConfL is on, though post.conf is state"),
    (
        "posed",
        "ConfJ\\On",
        "ConfJ\\Off",
        "ConfJ is off, though each of its motions states a configuration",
    ),
    (
        "posed",
        "ConfL\\On",
        "ConfL\\Off",
        "ConfL is off, though each of its motions states a configuration",
    ),
    (
        "cut",
        "vCam37:=[37,500,",
        "vCam37:=[37,50,",
        "a speed of 50 deg/s limits a motion that travels",
    ),
    (
        "weighed",
        f"{TOOL}[1.8,",
        f"{TOOL}[8.1,",
        "a tool of 8.1 kg with its centre of gravity at 0, 0, 55 mm, by post.mass "
        "and post.cog it has 1.8 kg at 0, 0, 55 mm",
    ),
    (
        "weighed",
        "[1.8,[0,0,55]",
        "[1.8,[0,55,0]",
        "a tool of 1.8 kg with its centre of gravity at 0, 55, 0 mm, by post.mass "
        "and post.cog it has 1.8 kg at 0, 0, 55 mm",
    ),
    (
        "weighed",
        "[0,0,55],[1,0,0,0],0,0,0]",
        "[0,0,55],[1,0,0,0],9,0,0]",
        "a tool with inertia, which the options do not give",
    ),
    ("weighed", "AccSet 50,40", "AccSet 50,90", "AccSet is not what post.acc_set asks for, 50, 40"),
    ("weighed", "        AccSet 50,40;\n", "", "AccSet is not what post.acc_set asks for, 50, 40"),
    (
        "cut",
        CONFL,
        f"{CONFL}        AccSet 50,50;\n",
        "AccSet is not what post.acc_set asks for, none",
    ),
    (
        "weighed",
        "SingArea\\Wrist",
        "SingArea\\Off",
        "SingArea is not what post.sing_area asks for, wrist",
    ),
    ("pressed", ",50\\Force", ",5\\Force", "threshold is 5 %, by post.force_threshold it is 50"),
    (
        "pressed",
        "\\ForceChange:=20",
        "\\ForceChange:=200",
        "forcechange is 200 N/s, by post.force_change it is 20",
    ),
    ("pressed", "\\ForceChange:=20", "", "forcechange is 0 N/s, by post.force_change it is 20"),
    (
        "pressed",
        "\\PosSupvDist:=5",
        "\\PosSupvDist:=50",
        "possupvdist is 50 mm, by post.force_distance it is 5",
    ),
    (
        "pressed",
        "\\PosSupvDist:=5",
        "\\PosSupvDist:=5\\UseSpdFFW",
        "UseSpdFFW, which no option asks for",
    ),
    (
        "pressed",
        "        FCCalib lTool;\n",
        "",
        "no FCCalib before pressing, though post.force_load asks for it",
    ),
    (
        "pressed",
        "FCCalib lTool;",
        "FCCalib [9,[0,0,1],[1,0,0,0],0,0,0];",
        "FCCalib with another load than post.force_load = lTool",
    ),
    (
        "pressed",
        f"    ERROR\n{DEACT}",
        "    ERROR\n",
        "the ERROR handler of main leaves force control on",
    ),
    ("cut", ERROR, "", "main has no ERROR handler, which post.on_error asks for"),
    (
        "exit",
        "        EXIT;",
        "        RAISE;",
        "the ERROR handler of main ends with RAISE, by post.on_error it is exit",
    ),
]


def noted(name: str, before: str, after: str) -> list[tuple[int, bool, str]]:
    """Line, whether it is a remark, and words of what is found in a program with one change."""
    body, options = BODIES[name]
    return find_after(read, text_of(body, options), options, before, after)


@pytest.mark.parametrize(("name", "before", "after", "what"), FAULTS)
def test_what_no_controller_takes_is_a_fault(name: str, before: str, after: str, what: str) -> None:
    found = noted(name, before, after)
    assert [(remark, words) for _, remark, words in found if words == what] == [(False, what)]
    if "predefined" not in what and "CONST" not in what:
        lines = [line for line, _, words in found if words == what]
        assert 0 <= lines[0] <= 1  # of a motion over two lines


@pytest.mark.parametrize(("name", "before", "after", "what"), REMARKS)
def test_what_no_option_asks_for_is_a_remark(name: str, before: str, after: str, what: str) -> None:
    assert [
        (remark, words) for _, remark, words in noted(name, before, after) if words == what
    ] == [(True, what)]


def test_an_arc_that_is_a_point_to_the_controller_is_a_remark() -> None:
    body, options = BODIES["cut"]
    text = (
        text_of(body, options)
        .replace(VIA, "MoveC [[0.040,0.020,0.000]")
        .replace("[[10.000,", "[[0.080,")
    )
    found = read({"a": text}, options).faults
    assert [one.what for one in found if isinstance(one, Remark)] == [
        "the points of an arc are less than 0.1 mm apart"
    ]


def test_a_routine_that_hands_no_error_on_is_a_remark() -> None:
    body, options = BODIES["cut"]
    post = make_post(Rapid, options)
    program = Program(
        "part", translation(300, -75, 100), translation(0, 0, 100), whole((HOME, *body))
    )
    text = post.render(post.prepare(program, 0.01))[0].text
    called = text.replace("        MoveJ ", "        sub;\n        MoveJ ").replace(
        "\nENDMODULE", "\n    PROC sub()\n        WaitTime 1;\n    ENDPROC\nENDMODULE"
    )
    assert [one.what for one in read({"a": called}, options).faults] == [
        "sub has no ERROR handler that hands an error on to main"
    ]


@pytest.mark.parametrize("load", ["lTool", "[1.2,[0,0,60],[1,0,0,0],0,0,0]"])
def test_a_calibration_as_the_options_have_it_is_none(load: str) -> None:
    options: dict[str, object] = {"force_load": load}
    text = text_of(PRESSED, options)
    assert read({"a": text}, options).faults == ()
    heavier = text.replace("FCCalib [1.2,", "FCCalib [1.3,").replace(
        "FCCalib lTool", "FCCalib lOther"
    )
    assert read({"a": heavier}, options).faults != ()


def test_strings_count_what_they_stand_for() -> None:
    """Two quotes, two backslashes or a backslash and two digits are one character (kernel manual, strings)."""
    body, options = BODIES["cut"]
    text = text_of(body, options)
    for sign in ('""', "\\\\", "\\0A"):
        for count, long in ((80, False), (81, True)):
            found = read({"a": text.replace('TRUE,"",', f'TRUE,"{sign * count}",')}, options).faults
            assert any("characters; a controller takes 80" in one.what for one in found) == long


def test_the_post_refuses_a_turn_whose_sense_is_open() -> None:
    flip = (MoveJ(at(0, 0, 20), 100.0), MoveL(Pose(IDENTITY, (9, 0, 20)), 20.0))
    with pytest.raises(
        Refused, match="the tool turns by 180 deg in one straight motion and its sense is open"
    ) as caught:
        text_of(flip, {})
    assert caught.value.index == 2
    nearly = Pose(frozen(rotation_about(0, math.radians(179)) @ TOOL_DOWN), (9, 0, 20))
    text = text_of((flip[0], MoveL(nearly, 20.0), MoveJ(Pose(TOOL_DOWN, (9, 0, 20)), 20.0)), {})
    assert read({"a": text}, {}).faults == ()


def test_the_post_refuses_joints_that_no_arm_has() -> None:
    with pytest.raises(
        Refused, match="an axis at 630 deg, which arms do not turn to; give 450 at most"
    ):
        text_of((MoveJ(Joints((0.0, 0.0, 0.0, 0.0, 0.0, math.radians(630))), 50.0),), {})


def test_an_arc_that_its_digits_make_flat_becomes_lines() -> None:
    """Circle point and end are 1.26 deg apart as planned, and 0.98 deg as printed."""
    start, via, end = (
        at(3.18159, -1.3925, -3.4127),
        at(3.25727, -1.19126, -3.41748),
        at(3.3266, -0.98769, -3.4156),
    )
    text = text_of((MoveJ(start, 50.0), MoveC(via, end, 20.0)), {})
    assert "MoveC" not in text
    assert read({"a": text}, {}).faults == ()
    arc = text_of((MoveJ(start, 50.0), MoveC(via, end, 20.0)), {"decimals": 5})
    assert "MoveC" in arc
    assert read({"a": arc}, {}).faults == ()


def test_each_section_that_was_planned_with_a_calibration_has_it() -> None:
    """Also the one before the second section, after the way up; where the tool stays down there is none."""
    body, options = BODIES["twice"]
    text = text_of(body, options)
    assert text.count("FCCalib lTool;") == 2
    place = text.rindex(CALIBRATE)
    found = read({"a": text[:place] + text[place + len(CALIBRATE) :]}, options).faults
    assert [one.what for one in found] == [
        "no FCCalib before pressing, though post.force_load asks for it"
    ]
    again = (
        MoveL(at(0, 0, 0.5), 20.0),
        Force(9.0, PRESS),
        MoveL(at(20, 0), 20.0, 0.0, 9.0, PRESS),
        Force(0.0),
    )
    low = (*PRESSED[:-1], MoveL(at(30, 0, 0.5), 20.0), *again, MoveL(at(20, 0, 30), 20.0))
    text = text_of(low, options)
    assert text.count("FCCalib lTool;") == 1
    assert read({"a": text}, options).faults == ()


def test_the_orientation_at_a_circle_point_is_compared() -> None:
    """It tells in which sense the tool turns (MoveC)."""
    post = make_post(Rapid, SIGNALS)
    plan = Program("part", translation(300, -75, 100), translation(0, 0, 100), whole((HOME, *CUT)))
    prepared = post.prepare(plan, 0.01)
    text = post.render(prepared)[0].text
    turned = text.replace(f"{VIA},[0.0000000,1.0000000,", f"{VIA},[1.0000000,0.0000000,")
    assert turned != text
    for one, same in ((text, True), (turned, False)):
        reading = read({"a": one}, SIGNALS)
        assert reading.faults == ()
        with (
            nullcontext()
            if same
            else pytest.raises(VerifyError, match="orientation half-way reads")
        ):
            compare(prepared, reading, post.tolerance(), post.list_verified(), "a")


def test_an_arc_whose_circle_point_is_near_an_end_is_split() -> None:
    """The read-back remarks on what the manual advises against, so the post does not write it."""
    start, via, end = at(0, 0), at(377, 0, 58), at(451, 0, 121)
    text = text_of((MoveJ(start, 50.0), MoveC(via, end, 20.0)), {"decimals": 0})
    assert text.count("MoveC") == 2
    assert read({"a": text}, {"decimals": 0}).faults == ()


def test_arcs_that_are_legal_by_column_are_so_one_by_one() -> None:
    rng = np.random.default_rng(5)
    start = rng.normal(size=(4000, 3)) * 10.0 ** rng.uniform(-2, 3, (4000, 1))
    along, across = rng.normal(size=(2, 4000, 3))
    across -= along * ((across * along).sum(axis=1) / (along**2).sum(axis=1))[:, None]
    along, across = (v / np.linalg.norm(v, axis=1)[:, None] for v in (along, across))
    radius = 10.0 ** rng.uniform(-1.5, 3, (4000, 1))
    sweep = rng.uniform(0.03, 2.4, (4000, 1))
    part = sweep * rng.uniform(0.1, 0.9, (4000, 1))
    via, end = (
        start + radius * (np.sin(t) * along + (1 - np.cos(t)) * across) for t in (part, sweep)
    )
    points = [list(map(tuple, column.tolist())) for column in (start, via, end)]
    legal = np.array([not arc_fault(*arc, 3) for arc in zip(*points, strict=True)])
    found = find_round(start, via, end, 3)
    assert not (found & ~legal).any()
    assert np.count_nonzero(found) > 0.99 * np.count_nonzero(legal) > 500
