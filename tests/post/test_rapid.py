"""ABB RAPID: the text by hand, the read-back of generated programs, refusals and faults."""

import math
import re
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from camgen_posts.rapid import Rapid
from camgen_posts.rapid.force import choose_calibrations
from camgen_posts.rapid.options import legal_name
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from camgen.lang.programs import Executed
from camgen.lang.rapid.strict import read
from camgen.model.errors import JobError, Refused, VerifyError
from camgen.model.pose import (
    TOOL_DOWN,
    Pose,
    angle_between,
    frozen,
    rotation_about,
    rotation_from_axes,
    rotation_from_quaternion,
    translation,
)
from camgen.model.program import (
    Comment,
    Force,
    Instruction,
    Joints,
    MoveC,
    MoveJ,
    MoveL,
    Origin,
    Output,
    Posture,
    Program,
    Stop,
    Wait,
)
from camgen.post import Tolerance
from camgen.post.plugins import find_post, find_readback, make_post
from camgen.post.verify import compare
from tests.support.examples import fewer
from tests.support.whole import turning, whole

SHARED = Path(__file__).parents[2].parent / "shared"
HOME = MoveJ(Joints((0.0, 0.0, 0.0, 0.0, math.radians(30), 0.0)), 200.0)
E9 = "[9E9,9E9,9E9,9E9,9E9,9E9]"
DOWN = f"[0.0000000,1.0000000,0.0000000,0.0000000],[0,0,0,0],{E9}]"


def at(x: float, y: float, z: float) -> Pose:
    return Pose(TOOL_DOWN, (x, y, z))


def program(*body: Instruction, name: str = "plate") -> Program:
    return Program(
        name, translation(300, -75, 100), translation(0, 0, 100), whole(body), ("made by hand",)
    )


def posted(plan: Program, **options: object) -> tuple[Program, dict[str, str]]:
    """The program as prepared, and its files; where it presses, the cell has set the sensor to zero."""
    post = make_post(Rapid, {"force_calibrated": not options.get("force_load")} | options)
    prepared = post.prepare(plan, 0.01)
    return prepared, {file.name: file.text for file in post.render(prepared)}


def lines(plan: Program, **options: object) -> list[str]:
    """The statements of main, without indentation, supervision and ERROR handler."""
    text = "\n".join(posted(plan, **options)[1].values())
    body = text.split("PROC main()\n")[1].split("ENDPROC")[0].split("    ERROR\n")[0]
    return [line.strip() for line in body.splitlines() if "Conf" not in line and line.strip()]


def assert_same(plan: Program, reading: Executed, tolerance: Tolerance) -> None:
    """The reading says what was planned, comments left out."""
    assert reading.findings == ()
    wanted = [item for item in plan.body if not isinstance(item, Comment)]
    assert [type(item) for item in reading.body] == [type(item) for item in wanted]
    assert len(reading.lines) == len(reading.body)
    assert all(a <= b for a, b in pairwise(reading.lines))
    for want, got in zip(wanted, reading.body, strict=True):
        for name in ("target", "via"):
            assert_near(getattr(want, name, None), getattr(got, name, None), tolerance)
        for name, limit in (("speed", tolerance.speed), ("blend", tolerance.mm), ("seconds", tolerance.seconds),
                            ("value", 5e-4), ("force", tolerance.force), ("newtons", tolerance.force)):  # fmt: skip
            assert getattr(got, name, 0) == pytest.approx(
                getattr(want, name, 0), rel=0, abs=limit + 1e-9
            )
        if getattr(want, "turn", 0):  # any motion of the text has a speed of turning
            assert getattr(got, "turn", 0) == pytest.approx(
                getattr(want, "turn", 0), rel=0, abs=tolerance.turn
            )
        assert getattr(got, "signal", "") == getattr(want, "signal", "")
        if getattr(want, "force", 0) or getattr(want, "newtons", 0):
            assert getattr(got, "force_direction", None) == pytest.approx(
                getattr(want, "force_direction", None), abs=tolerance.angle
            )


def assert_near(
    want: Pose | Joints | None, got: Pose | Joints | None, tolerance: Tolerance
) -> None:
    assert type(got) is type(want)
    if isinstance(want, Joints) and isinstance(got, Joints):
        assert got.values == pytest.approx(want.values, rel=0, abs=tolerance.joint + 1e-12)
    if isinstance(want, Pose) and isinstance(got, Pose):
        assert got.origin == pytest.approx(want.origin, rel=0, abs=tolerance.mm + 1e-9)
        assert angle_between(want.rotation, got.rotation) <= tolerance.angle


def turned(x: float, angle: float) -> Pose:
    return Pose(frozen(rotation_about(2, angle) @ TOOL_DOWN), (x, 0.0, 0.0))


def spot(degrees: float, speed: float = 100.0, angle: float = 1.0) -> Program:
    """To a point, a turn there at so many deg/s, and on."""
    turn = MoveL(turned(0, angle), speed, turn=math.radians(degrees))
    return program(HOME, MoveL(at(0, 0, 0), 100.0), turn, MoveL(turned(9, angle), 100.0))


# The text, by hand ----------------------------------------------------------------------------------------------


def test_small_program_to_the_letter() -> None:
    plan = program(
        HOME,
        Comment('layer "A"!\nENDPROC;'),
        MoveJ(at(10, 10, 20), 100.0, 5.0),
        MoveL(at(10, 10, -0.0004), 37.5),
        Output("process", 1),
        Wait(0.25),
        MoveC(at(20 - 10 * math.sqrt(0.5), 10 + 10 * math.sqrt(0.5), 0), at(20, 20, 0), 20.0, 2.5),
        MoveL(at(20, 20, 20), 20.0),
        Output("process", 0),
    )
    tool = "[[0.000,0.000,100.000],[1.0000000,0.0000000,0.0000000,0.0000000]],[0.001,[0,0,0.001],[1,0,0,0],0,0,0]"
    work = (
        "[[300.000,-75.000,100.000],[1.0000000,0.0000000,0.0000000,0.0000000]],[[0,0,0],[1,0,0,0]]"
    )
    tail = "tCamgen\\WObj:=wCamgen;"
    expected = f"""MODULE plate
    ! made by hand
    ! load: tool mass 0.001 kg is a placeholder - loading this module overwrites tCamgen
    ! load: set post.mass and post.cog, or post.declare = false for the tool of the controller
    TASK PERS tooldata tCamgen:=[TRUE,{tool}];
    TASK PERS wobjdata wCamgen:=[FALSE,TRUE,"",{work}];
    CONST speeddata vCam37_5:=[37.5,500,5000,1000];
    CONST zonedata zCam2_5:=[FALSE,2.5,3.75,3.75,0.375,3.75,0.375];

    PROC main()
        ConfJ\\Off;
        ConfL\\Off;
        SetDO doProcess,0;
        MoveAbsJ [[0.0000,0.0000,0.0000,0.0000,30.0000,0.0000],{E9}],v200,fine,tCamgen;
        ! layer _A___ENDPROC_
        MoveJ [[10.000,10.000,20.000],{DOWN},v100,z5,{tail}
        MoveL [[10.000,10.000,0.000],{DOWN},vCam37_5,fine,{tail}
        SetDO doProcess,1;
        WaitTime 0.25;
        MoveC [[12.929,17.071,0.000],{DOWN},
            [[20.000,20.000,0.000],{DOWN},v20,zCam2_5,{tail}
        MoveL [[20.000,20.000,20.000],{DOWN},v20,fine,{tail}
        SetDO doProcess,0;
    ERROR
        camSafe;
        RAISE;
    ENDPROC

    PROC camSafe()
        SetDO doProcess,0;
    ENDPROC
ENDMODULE
"""
    prepared, files = posted(plan)
    assert files == {"plate.mod": expected}
    reading = find_readback("rapid")(files, {})
    assert_same(prepared, reading, Rapid().tolerance())
    assert tuple(reading.lines) == (13, 14, 16, 17, 18, 19, 20, 22, 23)
    assert_near(reading.work, translation(300, -75, 100), Rapid().tolerance())
    assert_near(reading.tool, translation(0, 0, 100), Rapid().tolerance())
    assert find_post("rapid") is Rapid


def test_the_page_shows_a_program_that_is_read_and_is_safe() -> None:
    page = (Path(__file__).parents[2] / "docs" / "posts" / "rapid.md").read_text(encoding="utf-8")
    reading = read({"bracket.mod": page.split("```\n")[1]}, {"mass": 1.8, "cog": [0, 0, 55]})
    assert reading.findings == ()
    body = tuple(reading.body)
    assert len(body) == 11
    program(*body)
    assert whole(body) == body


def test_confdata_is_stated_and_supervised_where_it_is_known() -> None:
    known = Posture((-1, 1, 2, 0), 5)
    plan = program(
        HOME, MoveJ(at(0, 0, 9), 100.0, posture=known), MoveL(at(0, 0, 0), 20.0, posture=known)
    )
    text = posted(plan)[1]["plate.mod"]
    assert "ConfJ\\On;" in text
    assert "ConfL\\On;" in text
    assert text.count(f",[-1,1,2,0],{E9}") == 2
    unknown = program(*plan.body, MoveL(at(5, 0, 0), 20.0))
    assert "ConfL\\Off;" in posted(unknown)[1]["plate.mod"]
    unsure = program(
        *plan.body, MoveL(at(5, 0, 0), 20.0, joints=Joints((0.1,) * 6), posture=Posture(None, 5))
    )
    assert "ConfL\\Off;" in posted(unsure)[1]["plate.mod"]
    stated = posted(plan, conf="state")[1]["plate.mod"]
    assert "ConfJ\\Off;" in stated
    assert "ConfL\\Off;" in stated
    assert stated.count(f",[-1,1,2,0],{E9}") == 2
    off = posted(plan, conf="off")[1]["plate.mod"]
    assert "ConfJ\\Off;" in off
    assert off.count(f",[0,0,0,0],{E9}") == 2


@pytest.mark.parametrize(
    ("speed", "blend", "names"),
    [(5.0, 0.0, "v5,fine"), (7000.0, 0.3, "v7000,z0"), (6.0, 1.0, "vCam6,z1"), (20.0004, 200.0, "v20,z200"),
     (0.001, 0.0, "vCam0_001,fine"), (90.125, 199.9, "vCam90_125,zCam199_9")],
)  # fmt: skip
def test_predefined_speeds_and_zones_only_where_they_exist(
    speed: float, blend: float, names: str
) -> None:
    plan = program(HOME, MoveL(at(0, 0, 0), speed, blend), MoveL(at(900, 0, 0), 20.0))
    assert lines(plan)[1].endswith(f"{names},tCamgen\\WObj:=wCamgen;")
    assert_same(plan, read(posted(plan)[1], {}), Rapid().tolerance())


def test_s4_has_a_banner_plain_persistents_and_short_names() -> None:
    plan = replace(program(HOME), name="a very long name of a part")
    text = posted(plan, s4=True)[1]["a very long name of a part.mod"]
    assert text.startswith("%%%\n  VERSION:1\n  LANGUAGE:ENGLISH\n%%%\nMODULE a_very\n")
    assert "\n    PERS tooldata" in text
    assert "TASK" not in text
    assert read({"a": text}, {"s4": True}).findings == ()


def test_tool_and_work_may_be_on_the_controller() -> None:
    options: dict[str, object] = {"declare": False, "tool": "tSpindle", "work": "wobj0"}
    plan = program(HOME, MoveL(at(0, 0, 0), 20.0))
    files = posted(plan, **options)[1]
    assert "tooldata" not in files["plate.mod"]
    reading = read(files, options)
    assert reading.findings == ()
    assert reading.tool is None
    assert [fault.what for fault in read(files, {}).findings] == ["tSpindle is not declared"] * 2


def test_a_stop_waits_for_the_operator_and_is_read_back() -> None:
    planned = program(HOME, MoveJ(at(0, 0, 5), 50.0), Stop(), MoveL(at(5, 0, 5), 20.0))
    assert "Stop;" in lines(planned)
    reading = read(posted(planned)[1], {})
    assert [type(item) for item in reading.body if isinstance(item, Stop)] == [Stop]
    assert_same(planned, reading, Rapid().tolerance())


def test_rapid_has_no_optional_stop() -> None:
    post = make_post(Rapid, {})
    with pytest.raises(Refused, match="no optional stop") as caught:
        post.prepare(program(HOME, MoveJ(at(0, 0, 5), 50.0), Stop(optional=True)), 0.01)
    assert caught.value.index == 2


def test_spindle_is_an_analog_output() -> None:
    options = {"signals": {"spindle": "aoSpindle", "process": "doAir"}}
    plan = program(HOME, Output("spindle", 12000), Output("process", 1))
    home = f"MoveAbsJ [[0.0000,0.0000,0.0000,0.0000,30.0000,0.0000],{E9}],v200,fine,tCamgen;"
    off = ["SetAO aoSpindle,0;", "SetDO doAir,0;"]
    assert lines(plan, **options) == [*off, home, "SetAO aoSpindle,12000;", "SetDO doAir,1;", *off]
    assert_same(plan, read(posted(plan, **options)[1], options), Rapid().tolerance())


@pytest.mark.parametrize(
    ("text", "name"),
    [("plate", "plate"), ("10 mm", "m10_mm"), ("MoveL", "mMoveL"), ("main", "mmain"),
     ("user", "muser"), ("Base", "mBase"), ("edge", "medge"),
     ("reg5", "mreg5"), ("reg6", "reg6"), ("wobj1", "mwobj1"), ("clock1", "mclock1"), ("HIGH", "mHIGH"),
     ("camSafe", "mcamSafe"),
     ("", "m"), ("Zähne", "Z_hne"), ("x" * 40, "x" * 31), ("while", "mwhile")],
)  # fmt: skip
def test_a_module_gets_a_legal_name(text: str, name: str) -> None:
    assert legal_name(text, 32) == name


# Pressing -------------------------------------------------------------------------------------------------------


def on_disc(angle: float, z: float = -2.0) -> Pose:
    """Beside a disc of radius 20 about the origin, tool x towards its centre."""
    c, s = math.cos(angle), math.sin(angle)
    return Pose(rotation_from_axes((0, 0, -1), (-c, -s, 0)), (20 * c, 20 * s, z))


def inward(angle: float) -> tuple[float, float, float]:
    return (-math.cos(angle), -math.sin(angle), 0.0)


def pressing(*body: Instruction) -> Program:
    return program(
        HOME,
        MoveL(on_disc(0), 50.0),
        Force(25.0, inward(0)),
        *body,
        Force(0.0),
        MoveL(on_disc(0, 9), 50.0),
    )


def pressed(angle: float, force: float = 25.0, blend: float = 0.0) -> MoveL:
    return MoveL(on_disc(angle), 20.0, blend, force, inward(angle))


@pytest.mark.parametrize(("sign", "plus"), [(1, ""), (-1, "-")])
def test_a_pressing_section(sign: int, plus: str) -> None:
    options: dict[str, object] = {"force_sign": sign, "force_load": "lTool", "force_change": 10.0}
    plan = pressing(
        Output("process", 1),
        pressed(0),
        pressed(0.1, 24.5, 1.0),
        pressed(0.2),
        Output("process", 0),
    )
    got = lines(plan, **options)
    start = f"[[20.000,0.000,-2.000],[0.0000000,0.0000000,1.0000000,0.0000000],[0,0,0,0],{E9}]"
    tail = "tCamgen\\WObj:=wCamgen;"
    assert got[:2] == ["SetDO doProcess,0;", "IF FCIsForceMode() FCDeact;"]
    assert got[3:5] == ["WaitTime\\InPos,0;", "FCCalib lTool;"]  # at the home position, in the air
    assert got[6:9] == [
        "SetDO doProcess,1;",
        f"FCPress1LStart {start},",
        f"v20,\\Fx:={plus}25,50\\ForceChange:=10,fine,{tail}",
    ]
    assert got[9].startswith("FCPressL [[19.900,1.997,-2.000],")
    assert got[9].endswith(f",v20,{plus}24.5,z1,{tail}")
    assert got[12].startswith("FCPressEnd [[20.000,0.000,9.000],")
    assert got[12].endswith(f",v50,{tail}")
    prepared, files = posted(plan, **options)
    assert_same(prepared, read(files, options), Rapid().tolerance())


def test_pressing_against_the_tool_axis_is_negative() -> None:
    up = (0.0, 0.0, 1.0)
    plan = program(
        HOME,
        MoveL(at(0, 0, 0), 9.0),
        Force(5, up),
        MoveL(at(9, 0, 0), 9.0, 0, 5, up),
        Force(0),
        HOME,
    )
    with pytest.raises(
        Refused, match=r"^rapid: the motion that leaves the surface must be straight"
    ):
        posted(plan)
    plan = program(
        *plan.body[:-1], MoveC(at(9, 3, 3), at(9, 0, 6), 9.0, 1.0), MoveL(at(0, 0, 9), 9.0)
    )
    prepared, files = posted(plan)
    assert "\\Fz:=-5,50,fine," in files["plate.mod"]
    assert_same(prepared, read(files, {}), Rapid().tolerance())


def test_arcs_while_pressing_become_lines_unless_wanted() -> None:
    arc = MoveC(on_disc(-0.3), on_disc(-0.6), 20.0, 0.0, 25.0, inward(-0.6))
    plan = pressing(pressed(0), arc)
    assert not any(isinstance(item, MoveC) for item in posted(plan)[0].body)
    prepared, files = posted(plan, force_arcs=True)
    assert "FCPressC [[" in files["plate.mod"]
    assert_same(prepared, read(files, {}), Rapid().tolerance())
    first = pressing(arc)  # FCPress1LStart is straight
    prepared, files = posted(first, force_arcs=True)
    assert "FCPressC" not in files["plate.mod"]
    assert_same(prepared, read(files, {}), Rapid().tolerance())


def test_pressing_can_be_left_out() -> None:
    plan = pressing(pressed(0), MoveC(on_disc(-0.3), on_disc(-0.6), 20.0, 0.0, 25.0, inward(-0.6)))
    prepared, files = posted(plan, force="ignore")
    assert not any(isinstance(item, Force) or getattr(item, "force", 0) for item in prepared.body)
    assert "! pressing is left out: post.force =" in files["plate.mod"]
    assert "FCPress" not in files["plate.mod"]
    assert_same(prepared, read(files, {"force": "ignore"}), Rapid().tolerance())


# Refusals -------------------------------------------------------------------------------------------------------

TWISTED = MoveL(on_disc(0.1), 20.0, 0.0, 25.0, inward(0.2))
FOLLOW = (
    'on a drawing set tool.orient = "follow", so that the tool turns with the surface; of a part leave that edge out '
    '(input.select), or all pressing (post.force = "ignore")'
)


@pytest.mark.parametrize(
    ("plan", "message"),
    [
        (program(MoveJ(at(0, 0, 0), 9.0)),
         "(instruction 0)|the first motion must be to joint values; give the home position in deg"),
        (program(MoveJ(Joints((0.0,) * 4), 9.0)), "4 joint values; RAPID here is for arms of six axes"),
        (program(HOME, MoveL(at(9000, 0, 0), 9.0)), "a coordinate of more than 8388 mm"),
        (program(HOME, MoveL(at(0, 0, 0), 1e-4)), "a speed of 0.0001 mm/s; use 0.001 to 99999"),
        (spot(1e-4), "a turn at 0.0001 deg/s; use 0.001 to 99999 for process.turn (instruction 2)"),
        (spot(1e6), "a turn at 1e+06 deg/s; use 0.001 to 99999 for process.turn"),
        (program(HOME, MoveL(at(0, 0, 0), 9.0, 1e-4), HOME), "a blend radius of 0.0001 mm; use 0, or 0.001 to"),
        (program(HOME, MoveC(at(1, 1, 0), at(2, 0, 0), 9.0)), "an arc from a pose that is not known"),
        (program(HOME, MoveL(at(0, 0, 0), 9.0), MoveC(at(1, 0, 0), at(2, 0, 0), 9.0)),
         "the three points of the arc are on one line (instruction 2)"),
        (program(HOME, Output("coolant", 1)),
         'no output is named for coolant; set post.signals, e.g. coolant = "doName"'),
        (program(HOME, Output("spindle", 9)), 'set post.signals, e.g. spindle = "aoName"'),
        (program(HOME, Output("process", 0.5)), "process is a digital output and cannot be 0.5; use 0 or 1"),
        (pressing(TWISTED), f"the press direction is not the same tool axis in the whole section; {FOLLOW}"),
        (pressing(pressed(0), replace(pressed(0.1), force=0.0)), "a motion without force while pressing"),
        (pressing(pressed(0, 20.0)), "the first motion must press as hard as its section starts"),
        (pressing(pressed(0), HOME), "a joint-interpolated motion while pressing"),
        (pressing(pressed(0), Force(9.0, inward(0)), pressed(0)), "the force is on already"),
        (program(HOME, Force(9.0, (1, 0, 0)), MoveL(at(0, 0, 0), 9.0, 0, 9.0, (1, 0, 0)), Force(0)),
         "pressing from a pose that is not known"),
        (program(*pressing(pressed(0)).body[:-1]), "no straight motion leaves the surface"),
        (pressing(), "two changes of force without a motion between them"),
    ],
)  # fmt: skip
def test_refused(plan: Program, message: str) -> None:
    with pytest.raises(Refused) as caught:
        posted(plan)
    assert all(part in str(caught.value) for part in message.split("|"))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"program": "1st"},
            "[post] program: '1st' is not a RAPID name: a letter, then letters, digits and _;",
        ),
        ({"program": "x" * 33}, "is longer than 32 characters"),
        ({"tool": "tToolWithALongName", "s4": True}, "is longer than 16 characters"),
        ({"tool": "Robtarget"}, "is taken already"),
        ({"signals": {"process": "do it"}}, "[post] signals.process: 'do it' is not a RAPID name"),
        (
            {"signals": {"process": "END"}, "tool": "end"},
            "[post] signals.process: 'END' is the name of tool already",
        ),
        ({"signals": {"process": "Trap"}}, "'Trap' is a reserved word of RAPID"),
        ({"force_load": "[1,[0,0]]"}, "[post] force_load"),
        ({"mass": 0.0}, "[post] mass: must be 0.001 to 1000, not 0"),
        ({"mass": math.nan}, "[post] mass: must be 0.001 to 1000, not nan"),
        ({"cog": [1.0]}, "[post] cog: 1 number; give x, y, z in mm"),
        ({"decimals": 9}, "[post] decimals: must be 0 to 6, not 9"),
        ({"force": "hard"}, "Invalid enum value 'hard'"),
        (
            {"program": "user"},
            "'user' is taken already: predefined, of a system module, or given by the post itself",
        ),
        ({"work": "wobj1"}, "[post] work: 'wobj1' is taken already"),
        ({"signals": {"process": "Edge"}}, "'Edge' is taken already"),
        (
            {"fixture": [1, 2, 3]},
            "[post] fixture: 3 numbers; give x, y, z in mm and rx, ry, rz in deg",
        ),
        (
            {"fixture": [0] * 6, "declare": False},
            "[post] fixture: the work object is on the controller",
        ),
        ({"fixture": [9e9, 0, 0, 0, 0, 0]}, "[post] fixture[0]: must be -8388 to 8388, not 9e+09"),
        ({"acc_set": [50]}, "[post] acc_set: 1 number; give acceleration and ramp in %"),
        ({"acc_set": [10, 50]}, "[post] acc_set[0]: must be 20 to 100, not 10"),
    ],
)
def test_options_that_make_no_sense(options: Mapping[str, object], message: str) -> None:
    with pytest.raises(JobError) as caught:
        make_post(Rapid, options)
    assert message in str(caught.value)


def test_arcs_are_halved_or_become_lines() -> None:
    start = MoveL(at(0, 0, 0), 9.0)
    half = program(HOME, start, MoveC(at(5, 5, 0), at(10, 0, 0), 9.0))
    assert [type(item) for item in posted(half)[0].body] == [MoveJ, MoveL, MoveC, MoveC]
    third = program(
        HOME, start, MoveC(at(5, 5 / math.sqrt(3), 0), at(10, 0, 0), 9.0)
    )  # 120 deg, as it is
    assert posted(third)[0] is third
    wider = program(HOME, start, MoveC(at(5, 5 / math.sqrt(3) + 0.01, 0), at(10, 0, 0), 9.0))
    assert [type(item) for item in posted(wider)[0].body] == [MoveJ, MoveL, MoveC, MoveC]
    small = program(HOME, start, MoveC(at(0.1, 0.02, 0), at(0.2, 0, 0), 9.0))
    flat = program(HOME, start, MoveC(at(5, 0.04, 0), at(10, 0, 0), 9.0))
    for plan in (small, flat):
        assert not any(isinstance(item, MoveC) for item in posted(plan)[0].body)


# Generated programs ---------------------------------------------------------------------------------------------

coordinate = st.floats(-900, 900)
quaternions = st.one_of(
    st.sampled_from([(1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1), (0, 1, -1, 0), (1, 0, 1e-9, 0)]),
    st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: sum(v * v for v in q) > 1e-3),
)  # fmt: skip
poses = st.builds(
    lambda x, y, z, q: Pose(rotation_from_quaternion(q), (x, y, z)),
    coordinate,
    coordinate,
    coordinate,
    quaternions,
)
joint_values = st.tuples(*[st.floats(-6.5, 6.5)] * 6).map(Joints)
speeds = st.one_of(st.sampled_from([5.0, 20.0, 37.5, 7000.0]), st.floats(0.001, 9000))
blends = st.one_of(st.sampled_from([0.0, 0.3, 1.0, 5.0]), st.floats(0.001, 300))
HOSTILE = ["x\n! ; MODULE b", 'a"b', "ENDPROC\rENDMODULE", "%%%", "9\u2028SetDO do1,1;"]
comments = st.one_of(st.text(), st.sampled_from(HOSTILE))
arcs = st.builds(MoveC, poses, poses, speeds, blends)
# A turn where the motion before it ends, which ``settled`` moves there.
spots = st.builds(MoveL, poses, speeds, turn=st.floats(1e-3, 9.0))
instructions = st.one_of(
    spots, st.builds(MoveL, poses, speeds, blends), st.builds(MoveJ, poses, speeds, blends),
    st.builds(MoveJ, joint_values, speeds, blends), arcs, st.builds(Wait, st.floats(0, 100)),
    st.builds(Output, st.just("process"), st.sampled_from([0.0, 1.0])), st.builds(Comment, comments),
)  # fmt: skip


def settled(body: list[Instruction]) -> tuple[Instruction, ...]:
    """The body with stops where a program needs them, and without arcs from poses that nobody knows."""
    result: list[Instruction] = [HOME]
    last = 0
    for item in [*body, Wait(0.0)]:
        before = result[last]
        assert isinstance(before, (MoveJ, MoveL, MoveC))
        if isinstance(item, MoveC) and (
            not isinstance(before.target, Pose) or not proper(before.target, item)
        ):
            continue
        if isinstance(item, MoveL) and item.turn:
            if isinstance(before.target, Pose) and not half_turn(before.target, item.target):
                result.append(
                    replace(item, target=Pose(item.target.rotation, before.target.origin))
                )
                last = len(result) - 1
            continue
        if isinstance(item, (Wait, Output)):
            result[last] = replace(before, blend=0.0)
        if (
            isinstance(item, MoveL)
            and isinstance(before.target, Pose)
            and half_turn(before.target, item.target)
        ):
            result.append(MoveJ(item.target, item.speed, item.blend))
        else:
            result.append(item)
        if isinstance(item, (MoveJ, MoveL, MoveC)):
            last = len(result) - 1
    return turning(result, 1.0)


def half_turn(a: Pose, b: Pose) -> bool:
    return angle_between(a.rotation, b.rotation) > math.radians(179)


def proper(start: Pose, arc: MoveC) -> bool:
    """Whether three points make an arc of at most half a circle: the angle at via is at least 90 deg."""
    u, w = (np.subtract(pose.origin, arc.via.origin) for pose in (start, arc.target))
    sine = float(np.linalg.norm(np.cross(u, w)) / max(np.linalg.norm(u) * np.linalg.norm(w), 1e-9))
    return float(u @ w) < 0 and sine > 1e-3


@fewer(12)
@given(st.lists(instructions, max_size=12), st.integers(0, 6), st.sampled_from([0, 3]))
def test_post_then_read_back_is_the_identity(
    body: list[Instruction], decimals: int, max_lines: int
) -> None:
    options: dict[str, object] = {"decimals": decimals, "max_lines": max_lines}
    prepared, files = posted(program(*settled(body)), **options)
    tolerance = replace(
        Rapid(decimals=decimals).tolerance(), mm=max(0.5 * 10**-decimals, 5e-4)
    )  # a blend has 3 digits
    assert_same(prepared, read(files, options), tolerance)


def test_a_long_program_is_split_into_modules() -> None:
    plan = program(HOME, *[MoveL(at(i, 0, 0), 20.0) for i in range(25)], Output("process", 1))
    prepared, files = posted(plan, max_lines=10)
    assert list(files) == ["plate.mod", "plate_part1.mod", "plate_part2.mod", "plate_part3.mod"]
    main = files["plate.mod"]
    assert main.index("part_1;") < main.index("part_2;") < main.index("part_3;")
    assert files["plate_part2.mod"].startswith(
        "MODULE plate_part2\n\n    PROC part_2()\n        MoveL [[8.000,"
    )
    assert all(text.count("tooldata") == (name == "plate.mod") for name, text in files.items())
    reading = read(files, {})
    assert_same(prepared, reading, Rapid().tolerance())
    assert (
        reading.lines[0] == main.count("\n") + 4
    )  # MODULE, a line of its own and PROC of the first part come before
    backwards = read(dict(reversed(files.items())), {})
    assert backwards.findings == ()


# Routines -------------------------------------------------------------------------------------------------------


def along(path: int, x: float, rise: bool = True, signal: str = "process") -> list[Instruction]:
    """A path of one motion, on from x - 5 to x."""
    up = [MoveL(at(x, 0, 20), 100.0, path=path)] if rise else []
    return [
        Comment(f"path {path}"),
        MoveL(at(x - 5, 0, 0), 50.0, path=path),
        Output(signal, 1),
        MoveL(at(x, 0, 0), 20.0, path=path, work=True),
        Output(signal, 0),
        *up,
    ]


def pathed(*body: Instruction, ids: Sequence[str] = ("c1", "c2"), name: str = "plate") -> Program:
    return Program(
        name,
        translation(300, -75, 100),
        translation(0, 0, 100),
        whole(body),
        (),
        tuple(map(Origin, ids)),
    )


def routines(files: Mapping[str, str]) -> dict[str, list[str]]:
    """The first words of the statements of each PROC."""
    found = re.findall(r"PROC (\w+)\(\)\n(.*?)ENDPROC", "".join(files.values()), re.S)
    return {name: re.findall(r"^ +([A-Za-z_]\w*)", body, re.M) for name, body in found}


def test_each_path_is_a_routine_that_main_calls() -> None:
    spindle = {"signals": {"process": "doAir", "spindle": "aoRpm"}}
    body = [
        HOME,
        Output("spindle", 900),
        *along(0, 10, rise=False),
        *along(1, 20),
        Output("spindle", 0),
        HOME,
    ]
    prepared, files = posted(pathed(*body), **spindle)
    assert list(files) == ["plate.mod"]
    settings = ["ConfJ", "ConfL"]
    work = ["MoveL", "SetDO", "MoveL", "SetDO"]
    assert routines(files) == {
        "main": [
            *settings,
            "SetAO",
            "SetDO",
            "MoveAbsJ",
            "SetAO",
            "c1",
            "c2",
            "SetAO",
            "MoveAbsJ",
            "ERROR",
            "camSafe",
            "RAISE",
        ],
        "camSafe": ["SetAO", "SetDO"],
        "c1": [*work, "ERROR", "RAISE"],
        "c2": [*work, "MoveL", "ERROR", "RAISE"],
    }
    assert "        ! path 1\n" in files["plate.mod"].split("PROC c2()")[1]
    reading = read(files, spindle)
    assert reading.findings == ()
    compare(prepared, reading, Rapid().tolerance(), Rapid().list_verified(), "plate.mod")


def test_what_is_reset_before_the_first_motion_stands_in_main() -> None:
    files = posted(
        pathed(Output("process", 0), HOME, *along(0, 10), *along(1, 20), HOME, Output("process", 0))
    )[1]
    assert routines(files)["main"] == [
        *(
            "ConfJ",
            "ConfL",
            "SetDO",
            "MoveAbsJ",
            "c1",
            "c2",
            "MoveAbsJ",
            "SetDO",
            "ERROR",
            "camSafe",
            "RAISE",
        ),
    ]
    assert read(files, {}).findings == ()


@pytest.mark.parametrize(
    ("ids", "names"),
    [
        (("c1", "c1"), ["c1", "c1_2"]),
        (("user", "v20"), ["puser", "pv20"]),
        (("plate", "doProcess"), ["plate_2", "doProcess_2"]),
        (("a/b c", "7"), ["a_b_c", "p7"]),
        (("x" * 40, "X" * 40), ["x" * 31, "X" * 26 + "_2"]),
        (("camSafe", "MAIN"), ["pcamSafe", "pMAIN"]),
        (("tCamgen", "wcamgen"), ["tCamgen_2", "wcamgen_2"]),
    ],
)
def test_routines_get_legal_names_of_their_own(ids: tuple[str, str], names: list[str]) -> None:
    files = posted(pathed(HOME, *along(0, 10), *along(1, 20), HOME, ids=ids))[1]
    assert list(routines(files))[2:] == names
    assert read(files, {}).findings == ()


def test_paths_that_do_not_fit_into_a_module_stand_in_others() -> None:
    """Each path has 9 lines as a routine; main, cut in pieces, and a path that is longer than a module too."""
    ids = [f"c{k}" for k in range(30)]
    long = [MoveL(at(k, 9, 0), 20.0, path=30) for k in range(45)]
    body = [HOME, *(item for k in range(30) for item in along(k, 10 * k)), *long, HOME]
    plan = pathed(*body, ids=[*ids, "long"])
    prepared, files = posted(plan, max_lines=20)
    found = routines(files)
    assert [name for name in found if name.startswith(("part_", "long"))] == [
        *("part_1", "part_2", "long", "long_1", "long_2", "long_3"),
    ]
    assert found["main"][2:4] == ["part_1", "part_2"]
    assert found["part_2"][-4:] == ["long", "MoveAbsJ", "ERROR", "RAISE"]
    sizes = [text.count("\n") - 2 for name, text in files.items() if name != "plate.mod"]
    assert (
        max(sizes) <= 20 + 5
    )  # PROC, ERROR, RAISE, ENDPROC and the empty line of one that is 20 long
    reading = read(files, {})
    assert reading.findings == ()
    compare(prepared, reading, Rapid().tolerance(), Rapid().list_verified(), "plate.mod")


def test_a_routine_that_presses_also_leaves_the_surface() -> None:
    """The way off the surface is the first of the next path; the remark on that path follows it."""
    pressing_on = [
        MoveL(on_disc(0), 50.0, path=0),
        Output("process", 1),
        Force(25.0, inward(0)),
        replace(pressed(0.1), path=0),
    ]
    up = MoveL(on_disc(0.1, 9), 50.0, path=1)
    body = [
        HOME,
        *pressing_on,
        Output("process", 0),
        Force(0.0),
        Comment("path c2"),
        up,
        *along(1, 10),
        HOME,
    ]
    prepared, files = posted(pathed(*body))
    text = files["plate.mod"]
    work = ["SetDO", "FCPress1LStart", "v20", "SetDO", "FCPressEnd"]
    assert routines(files)["c1"] == ["MoveL", *work, "ERROR", "RAISE"]
    assert "PROC c2()\n        ! path c2\n        ! path 1\n        MoveL" in text
    compare(prepared, read(files, {}), Rapid().tolerance(), Rapid().list_verified(), "plate.mod")


# The ERROR handler ----------------------------------------------------------------------------------------------

ONE = pathed(HOME, *along(0, 10), *along(1, 20), HOME)


@pytest.mark.parametrize(("on_error", "last"), [("raise", "RAISE"), ("exit", "EXIT")])
def test_an_error_drops_the_process(on_error: str, last: str) -> None:
    files = posted(ONE, on_error=on_error)[1]
    assert routines(files)["main"][-3:] == ["ERROR", "camSafe", last]
    assert routines(files)["c2"][-2:] == ["ERROR", "RAISE"]
    assert read(files, {"on_error": on_error}).findings == ()
    without = posted(ONE, on_error="none")[1]["plate.mod"]
    assert "ERROR" not in without
    assert "camSafe" not in without


ASKED = "        IF FCIsForceMode() FCDeact;\n"


def test_force_control_is_ended_before_the_first_motion_and_by_an_error() -> None:
    plan = pressing(Output("process", 1), pressed(0), pressed(0.1), Output("process", 0))
    prepared, files = posted(plan)
    text = files["plate.mod"]
    assert f"ConfL\\Off;\n        SetDO doProcess,0;\n{ASKED}        MoveAbsJ " in text
    assert f"    ERROR\n        camSafe;\n{ASKED}        RAISE;\n" in text
    assert text.count("FCDeact") == 2
    reading = read(files, {})
    assert reading.body[:2] == (Output("process", 0.0), Force(0.0))
    compare(prepared, reading, Rapid().tolerance(), Rapid().list_verified(), "plate.mod")
    assert "FCDeact" not in posted(ONE)[1]["plate.mod"]


def test_an_end_of_force_control_that_does_not_ask_is_read() -> None:
    """In programs from elsewhere it stands after pressing; there it is right, and remarked on alone."""
    end = f"FCPressEnd {POINT},v5,t1\\WObj:=w1;\nFCDeact;"
    way = f"MoveL {POINT},v5,fine,t1\\WObj:=w1;\nFCPress1LStart {POINT},v5,\\Fx:=5,50,fine,t1\\WObj:=w1;\n"
    reading = read({"m.mod": module(way + end)}, BY_HAND)
    (remark,) = reading.findings
    assert remark.level == "unusual"
    assert (remark.line, remark.what.split(":")[0]) == (9, "fcdeact without IF FCIsForceMode()")
    assert reading.body[-1] == Force(0.0)


def test_a_post_prints_a_program_twice_alike() -> None:
    post = Rapid(force_calibrated=True)
    prepared = post.prepare(pressing(pressed(0)), 0.01)
    assert post.render(prepared) == post.render(prepared)


ITSELF = "the ERROR handler of main switches an output itself, not in a routine"


@pytest.mark.parametrize(
    ("handler", "fault"),
    [
        ("camSafe;\n        RAISE;", ""),
        ("SetDO doProcess,0;\n        EXIT;", ITSELF),
        ("Reset doProcess;\n        RAISE;", ITSELF),
        ("RAISE;", "the ERROR handler of main leaves process on"),
        ("SetDO doOther,0;\n        RAISE;", "the ERROR handler of main leaves process on"),
        ("camSafe;", "the ERROR handler of main continues after the error; end it with RAISE"),
        ("SetDO doProcess,1;\n        RAISE;", "an ERROR handler that switches something on"),
        ("camSafe;\n        RAISE;\n        SetDO doProcess,0;", "statements after RAISE"),
        (
            "camSafe;\n        WaitTime 1;\n        RAISE;",
            "waittime in an ERROR handler is not read",
        ),
        (
            "camSafe;\n        IF x FCDeact;\n        RAISE;",
            "IF is read as IF FCIsForceMode() FCDeact; alone",
        ),
        ("camSafe;\n        TRYNEXT;", "TRYNEXT is a statement that is not read"),
        ("nowhere;\n        RAISE;", "nowhere is a statement that is not read"),
    ],
)
def test_what_a_handler_leaves_on_is_a_fault(handler: str, fault: str) -> None:
    text = posted(ONE)[1]["plate.mod"].replace("camSafe;\n        RAISE;", handler, 1)
    on_error = "exit" if "EXIT" in handler else "raise"
    faults = [one.what for one in read({"a": text}, {"on_error": on_error}).findings]
    assert fault in faults if fault else not faults


def test_a_routine_that_ends_the_program_drops_the_process_too() -> None:
    text = posted(ONE)[1]["plate.mod"]
    ends = text.replace("ERROR\n        RAISE;", "ERROR\n        EXIT;", 1)
    assert [fault.what for fault in read({"a": ends}, {}).findings] == [
        "the ERROR handler of c1 leaves process on",
        "the ERROR handler of c1 does more than RAISE",
    ]


# Turns on the spot ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("degrees", "speed", "name", "data"),
    [
        (60.0, 100.0, "vCam100t60", "[100,60,5000,1000]"),
        (60.0, 37.5, "vCam37_5t60", "[37.5,60,5000,1000]"),
        (12.345, 100.0, "vCam100t12_345", "[100,12.345,5000,1000]"),
        (500.0, 100.0, "v100", ""),
    ],
)
def test_a_turn_on_the_spot_has_its_v_ori(
    degrees: float, speed: float, name: str, data: str
) -> None:
    """The second component of a speeddata limits it, deg/s; in a predefined one that is 500."""
    prepared, files = posted(spot(degrees, speed))
    text = files["plate.mod"]
    assert re.findall(r"CONST speeddata (\S+):=(.*);", text) == ([(name, data)] if data else [])
    assert [
        re.findall(r"],(\w+),fine,tCamgen", line)[0]
        for line in text.splitlines()
        if "MoveL" in line
    ] == [*("v100", name, "v100")]
    reading = read(files, {})
    turns = [item.turn for item in reading.body if isinstance(item, MoveL)]
    assert turns == pytest.approx([0.0, math.radians(degrees), 0.0], abs=1e-5)
    compare(prepared, reading, Rapid().tolerance(), Rapid().list_verified(), "plate.mod")


@pytest.mark.parametrize(
    ("before", "after", "reads"),
    [
        (",vCam100t60,", ",v100,", "8.726646"),  # 500 deg/s
        ("[100,60,5000,1000]", "[100,500,5000,1000]", "8.726646"),
        (",vCam100t60,", ",[100,500,5000,1000],", "8.726646"),
        (",vCam100t60,", ",[100,61,5000,1000],", "1.064651"),
    ],
)
def test_a_turn_at_another_speed_is_found(before: str, after: str, reads: str) -> None:
    prepared, files = posted(spot(60.0))
    assert files["plate.mod"].count(before) == 1
    wrong = read({"a": files["plate.mod"].replace(before, after)}, {})
    assert {fault.what for fault in wrong.findings} <= {"vCam100t60 is declared and never used"}
    without_faults = replace(wrong, findings=())
    with pytest.raises(
        VerifyError, match=f"instruction 2: speed of turning reads {reads}, planned is 1.047198"
    ):
        compare(prepared, without_faults, Rapid().tolerance(), Rapid().list_verified(), "plate.mod")


def test_a_turn_that_its_digits_do_not_show_is_one_too() -> None:
    prepared, files = posted(spot(60.0, angle=1e-9))
    compare(prepared, read(files, {}), Rapid().tolerance(), Rapid().list_verified(), "plate.mod")


def test_turns_of_many_speeds_are_written_out() -> None:
    turns = [MoveL(turned(0, k), 100.0, turn=math.radians(10 + k)) for k in range(1, 9)]
    prepared, files = posted(program(HOME, MoveL(at(0, 0, 0), 100.0), *turns))
    text = files["plate.mod"]
    assert text.count("CONST speeddata") == 6
    assert text.count(",[100,17,5000,1000],fine,") == text.count(",[100,18,5000,1000],fine,") == 1
    compare(prepared, read(files, {}), Rapid().tolerance(), Rapid().list_verified(), "plate.mod")


def test_a_turn_while_pressing_has_its_v_ori() -> None:
    """A tool that presses along its axis turns about it."""
    along = (0.0, 0.0, -1.0)
    held = MoveL(turned(9, 1.0), 20.0, 0.0, 5.0, along, turn=math.radians(60.0))
    body = [
        MoveL(at(0, 0, 0), 9.0),
        Force(5.0, along),
        MoveL(at(9, 0, 0), 20.0, 0.0, 5.0, along),
        held,
        Force(0.0),
    ]
    prepared, files = posted(program(HOME, *body, MoveL(at(9, 0, 50), 20.0)))
    (line,) = (line for line in files["plate.mod"].splitlines() if "FCPressL" in line)
    assert line.endswith(",vCam20t60,5,fine,tCamgen\\WObj:=wCamgen;")
    compare(prepared, read(files, {}), Rapid().tolerance(), Rapid().list_verified(), "plate.mod")


# Speeds, frames, settings ---------------------------------------------------------------------------------------


def test_few_speeds_have_a_name() -> None:
    speeds = [10.5 + k / 8 for k in range(29)]
    body = [
        MoveL(at(k, j, 0), speed)
        for k, speed in enumerate(speeds)
        for j in range(2 if k in (3, 20) else 1)
    ]
    prepared, files = posted(program(HOME, *body))
    text = files["plate.mod"]
    assert re.findall(r"CONST speeddata (\w+):=", text) == [
        *("vCam10_5", "vCam10_625", "vCam10_75", "vCam10_875", "vCam11", "vCam13"),
    ]  # the two that are used twice, and the slowest others
    assert text.count(",[11.125,500,5000,1000],fine,") == 1
    reading = read(files, {})
    compare(prepared, reading, Rapid().tolerance(), Rapid().list_verified(), "plate.mod")


def test_a_fixture_is_the_user_frame_and_the_work_lies_in_it() -> None:
    """Turned by 90 deg about z at 1000, 0, 500, a work frame at 900, 200, 510 lies at 200, 100, 10 of the fixture."""
    plan = replace(
        program(HOME, MoveL(at(0, 0, 0), 20.0)), base_from_work=translation(900, 200, 510)
    )
    prepared, files = posted(plan, fixture=[1000, 0, 500, 0, 0, 90])
    user = "[[1000.000,0.000,500.000],[0.7071068,0.0000000,0.0000000,0.7071068]]"
    thing = "[[200.0000,100.0000,10.0000],[0.7071068,0.0000000,0.0000000,-0.7071068]]"
    assert f'TASK PERS wobjdata wCamgen:=[FALSE,TRUE,"",{user},{thing}];' in files["plate.mod"]
    reading = read(files, {})
    compare(prepared, reading, Rapid().tolerance(), Rapid().list_verified(), "plate.mod")


@given(
    st.lists(st.floats(-1500, 1500), min_size=3, max_size=3),
    st.lists(st.floats(-180, 180), min_size=3, max_size=3),
    st.integers(0, 6),
)
def test_a_fixture_anywhere_does_not_move_the_work(
    place: list[float], turn: list[float], decimals: int
) -> None:
    options: dict[str, object] = {"fixture": [*place, *turn], "decimals": decimals}
    prepared, files = posted(program(HOME, MoveL(at(1, 2, 3), 20.0)), **options)
    post = make_post(Rapid, options)
    compare(prepared, read(files, options), post.tolerance(), post.list_verified(), "plate.mod")


def test_a_load_that_nobody_weighed_is_told() -> None:
    remark = "! load: tool mass 0.001 kg is a placeholder - loading this module overwrites tCamgen"
    assert remark in posted(ONE)[1]["plate.mod"]
    for options in (
        {"mass": 1.8, "cog": [0, 0, 55]},
        {"declare": False, "tool": "tMine", "work": "wMine"},
    ):
        assert "! load:" not in posted(ONE, **options)[1]["plate.mod"]


def test_settings_of_the_arm_stand_before_the_first_motion() -> None:
    text = posted(ONE, sing_area="wrist", acc_set=[50, 40])[1]["plate.mod"]
    set_up = "        ConfL\\Off;\n        SingArea\\Wrist;\n        AccSet 50,40;\n"
    assert f"{set_up}        SetDO doProcess,0;\n        MoveAbsJ " in text
    asked: dict[str, object] = {"sing_area": "wrist", "acc_set": [50, 40]}
    assert read({"a": text}, asked).findings == ()
    assert "SingArea\\Off;" in posted(ONE, sing_area="off")[1]["plate.mod"]
    wrong = text.replace("SingArea\\Wrist", "SingArea\\Hand").replace(
        "AccSet 50,40", "AccSet 50,140"
    )
    assert [one.what for one in read({"a": wrong}, asked).findings if one.level != "unusual"] == [
        *("singarea needs \\Wrist or \\Off", "accset is in %, up to 100"),
    ]


# Setting the force sensor to zero -------------------------------------------------------------------------------


def test_pressing_with_a_sensor_that_is_not_zero_is_refused() -> None:
    with pytest.raises(
        Refused, match="the force sensor is not set to zero before pressing"
    ) as caught:
        make_post(Rapid, {}).prepare(pressing(pressed(0)), 0.01)
    assert "give post.force_load, or post.force_calibrated = true if the cell does it" in str(
        caught.value
    )
    assert (
        caught.value.index == 3
    )  # after what puts force control off, the home position and the way there


def sections(*between: Instruction) -> list[str]:
    """The statements of a program that presses twice, with ``between`` on the way to the second section."""
    plan = pressing(pressed(0.1))
    body = [HOME, MoveL(on_disc(0, 30), 90.0, 5.0), MoveL(on_disc(0, 1), 90.0), *plan.body[1:-1]]
    again = [
        MoveL(on_disc(0.1), 20.0),
        *between,
        MoveL(on_disc(0), 50.0),
        Force(25.0, inward(0)),
        pressed(0.1),
    ]
    got = lines(
        program(*body, *again, Force(0.0), MoveL(on_disc(0.1, 9), 50.0)), force_load="lTool"
    )
    return [line for line in got if not line.startswith("v")]


def test_the_sensor_is_set_to_zero_after_a_stop_in_the_air() -> None:
    """At the height of travel, which was to be passed at 5 mm, not 1.5 mm above the start."""
    got = sections()
    assert got[0] == "IF FCIsForceMode() FCDeact;"
    assert got[2].startswith("MoveL [[20.000,0.000,30.000]")
    assert ",fine," in got[2]
    assert got[3:5] == ["WaitTime\\InPos,0;", "FCCalib lTool;"]
    assert got.count("FCCalib lTool;") == 1  # the tool stays at the surface between the sections


def test_each_section_that_is_reached_through_the_air_has_its_own_zero() -> None:
    got = sections(MoveL(on_disc(0.1, 9), 50.0), MoveL(on_disc(0, 9), 50.0, 2.0))
    at_once = [k for k, line in enumerate(got) if line == "FCCalib lTool;"]
    assert len(at_once) == 2
    assert got[at_once[1] - 2].startswith("MoveL [[20.000,0.000,9.000]")
    assert ",fine," in got[at_once[1] - 2]
    over = sections(HOME)
    assert over.count("FCCalib lTool;") == 2
    assert over[[k for k, line in enumerate(over) if line == "FCCalib lTool;"][1] - 2].startswith(
        "MoveAbsJ "
    )


def test_a_zero_in_the_air_is_needed_before_the_first_section() -> None:
    body = pressing(pressed(0)).body
    far = MoveL(on_disc(1.0), 50.0)
    with pytest.raises(Refused, match="pressing from a pose that is not known"):
        posted(program(HOME, *body[3:]), force_load="lTool")
    low = program(MoveJ(on_disc(0.5), 9.0), far, *body[2:])
    with pytest.raises(
        Refused, match="no motion in the air before pressing, where the force sensor can be set to"
    ):
        choose_calibrations("rapid", low.body)


def test_a_force_program_says_what_it_assumes() -> None:
    text = posted(pressing(pressed(0)), force_sign=-1, force_threshold=30.0)[1]["plate.mod"]
    assert (
        "! force: Machining FC is installed; a positive force pushes against the axis of the tool"
        in text
    )
    assert "! force: travel begins when 30 % of the force is felt" in text
    assert "! force: the sensor is set to zero by the cell, before this program" in text
    zeroed = posted(pressing(pressed(0)), force_load="lTool")[1]["plate.mod"]
    assert "! force: the sensor is set to zero by FCCalib lTool in the air" in zeroed


# Executed --------------------------------------------------------------------------------------------------------

FRAMES = """TASK PERS tooldata t1:=[TRUE,[[0,0,9],[1,0,0,0]],[0.001,[0,0,0.001],[1,0,0,0],0,0,0]];
TASK PERS wobjdata w1:=[FALSE,TRUE,"",[[100,0,0],[0.70710678,0,0,0.70710678]],[[10,0,0],[1,0,0,0]]];
"""
POINT = f"[[1,2,3],[0,1,0,0],[0,0,0,0],{E9}]"
START = f"ConfJ\\Off;ConfL\\Off;MoveAbsJ [[0,0,0,0,90,0],{E9}],v100,fine,t1;"
#: Options of programs that people write: they have no ERROR handlers.
BY_HAND: dict[str, object] = {"on_error": "none", "tool": "t1", "work": "w1"}


def module(body: str, data: str = "") -> str:
    """A module whose statements begin in line 6 (line 4 of the data)."""
    return f"MODULE m\n{FRAMES}{data}PROC main()\n{START}\n{body}\nENDPROC\nENDMODULE\n"


def test_reads_what_people_write() -> None:
    text = module(
        """  movel OFFS ( p1 , 0, 0,-1.5e0 ) , v50\\V:=25 , z5 \\Z:=2.5 , T1 , \\wobj := w1 ;  ! down
        MoveJ RelTool(p1,0,0,5\\Rz:=90),v1,FINE,t1\\WObj:=w1;
        SET do1; Reset do1; WaitTime \\InPos, 0.5; SetDO do1,
            high;
        sub;""",
        f"LOCAL CONST robtarget p1:={POINT};\nCONST num a:=7;\nVAR speeddata v1:=[a,500,5000,1000];\n"
        "LOCAL PROC sub()\n! nothing\nENDPROC\n",
    )
    options = BY_HAND | {"signals": {"process": "DO1"}}
    reading = read({"a.mod": text}, options)
    local = "a routine that is LOCAL, which the controller cannot call by an event"
    assert list_faults({"a.mod": text}, options) == [(7, local)]
    kinds = [type(item) for item in reading.body]
    assert kinds == [MoveJ, MoveL, MoveJ, Output, Output, Wait, Output]
    down, turned = reading.body[1], reading.body[2]
    assert isinstance(down, MoveL)
    assert (down.target.origin, down.speed, down.blend) == ((1.0, 2.0, 1.5), 25.0, 2.5)
    assert isinstance(turned, MoveJ)
    assert isinstance(turned.target, Pose)
    # z of the tool points down: 5 along it is z - 5; turning about it turns x (1,0,0) into y of the tool (0,-1,0)
    assert turned.target.origin == pytest.approx((1, 2, -2))
    assert turned.target.rotation[:, 0] == pytest.approx((0, -1, 0))
    assert turned.speed == 7
    assert [item.value for item in reading.body if isinstance(item, Output)] == [1, 0, 1]
    assert {item.signal for item in reading.body if isinstance(item, Output)} == {"process"}
    # the user frame turns x of the object frame to y of the base
    assert reading.work is not None
    assert reading.work.origin == pytest.approx((100, 10, 0), abs=1e-6)


@pytest.mark.parametrize(
    ("body", "faults"),
    [
        (f"MoveL {POINT},v100,fine,t9\\WObj:=w1;", [(6, "t9 is not declared")]),
        (f"\nMoveL {POINT},v37,fine,t1\\WObj:=w1;", [(7, "v37 is not declared")]),
        (f"MoveL {POINT},v100,z3,t1\\WObj:=w1;", [(6, "z3 is not declared")]),
        (f"MoveL {POINT},fine,v100,t1\\WObj:=w1;", [(6, "fine is zonedata, not speeddata")]),
        (f"MoveL [[1,2,3],[0,1,0.01,0],[0,0,0,0],{E9}],v100,fine,t1\\WObj:=w1;",
         [(6, "a quaternion is not normalised (its square differs from 1 by 0.0001)")]),
        (f"MoveL [[1,2,3],[1,0,0],[0,0,0,0],{E9}],v100,fine,t1\\WObj:=w1;", [(6, "orient has 4 components, not 3")]),
        (f"MoveL {POINT},v100,z5,t1\\WObj:=w1;\nSetDO do1,1;", [(6, "a motion that blends before setdo")]),
        (f"MoveL {POINT},v100,z5,t1\\WObj:=w1;", [(6, "a motion that blends before the end")]),
        (f"MoveL {POINT},v100,fine,t1;\nMoveL {POINT},v100,fine,t1\\WObj:=w1;", [(7, "w1 is a second work object")]),
        (f"MoveL {POINT},v100\\T:=5,fine,t1\\WObj:=w1;", [(6, "\\t of movel is not read")]),
        ("MoveL [[1,2,3],[0,1,0,0],[0,0,0,0],[0,9E9,9E9,9E9,9E9,9E9]],v5,fine,t1;",
         [(6, "external axes are not read")]),
        (f"MoveC {POINT},{POINT},v5,fine,t1;\nMoveC {POINT},{POINT},v5,fine,t1;",
         [(7, "the points of an arc are on one line")]),
        ('TPWrite "MoveL";\nStop 1;', [(6, "tpwrite is a statement that is not read"),
                                     (7, "stop is read without arguments")]),
        ("FOR i FROM 1 TO 2 DO\nSetDO do1,1;\nENDFOR", [(6, "FOR is a statement that is not read")]),
        ("x:=5;", [(6, "x:= is a statement that is not read")]),
        ("SetDO do1,2;", [(6, "a digital output is 0 or 1")]),
        (f"SetDO {'d' * 33},1;", [(6, f"{'d' * 33} is longer than 32 characters")]),
        ("SetDO do1,1", [(7, "; expected, found 'ENDPROC'")]),
        ("WaitTime -1;", [(6, "a wait must not be negative")]),
        ("WaitTime 9E99;", [(6, "9E99 is larger than a num can be")]),
        ("main;", [(6, "main is called too deeply")]),
        ("FCPressL p,v100,5,z5,t1;", [(6, "p is not declared")]),
        (f"FCPressL {POINT},v100,5,fine,t1;", [(6, "fcpressl without FCPress1LStart")]),
        (f"MoveL {POINT},v5,fine,t1;\nFCPress1LStart {POINT},v5,\\Fx:=5,50,fine,t1;\nMoveL {POINT},v5,fine,t1;",
         [(8, "movel while pressing, before FCPressEnd"), (10, "FCPressEnd is missing at the end")]),
        (f"MoveL {POINT},v5,fine,t1;\nFCPress1LStart {POINT},v5,\\Fx:=5,50,fine,t1;\nFCPressL {POINT},v5,-5,fine,t1;\n"
         f"FCPressEnd {POINT},v5,t1;", [(8, "fcpressl does not press in the direction of FCPress1LStart")]),
    ],
)  # fmt: skip
def test_faults_by_line(body: str, faults: list[tuple[int, str]]) -> None:
    assert list_faults({"m.mod": module(body)}, BY_HAND) == faults


#: Remarks that many short texts get, which have tests of their own.
COMMON = re.compile(
    r".* is declared and never used|(?:t1|wobj0) is the \w+(?: object)? of a motion.*"
)


def list_faults(files: dict[str, str], options: dict[str, object]) -> list[tuple[int, str]]:
    """Lines and words of the faults of a text, without those that are `COMMON`."""
    faults = [(fault.line, fault.what) for fault in read(files, options).findings]
    return [(line, what) for line, what in faults if not COMMON.fullmatch(what)]


@pytest.mark.parametrize(
    ("text", "faults"),
    [
        ("", [(1, "there is no PROC main")]),
        ("MODULE m\nENDMODULE\n! tail\n5", [(3, "a comment outside of a module, where the kernel manual has none"),
                                           (4, "'5' stands outside a module"), (4, "there is no PROC main")]),
        (f"MODULE m\nPROC main()\n{START}\n", [(3, "t1 is not declared"), (4, "ENDPROC of main is missing"),
                                               (4, "ENDMODULE of m is missing")]),
        (f"MODULE m\n{FRAMES}PROC main()\nConfJ\\Off;MoveJ {POINT},v5,fine,t1;\nENDPROC\nENDMODULE",
         [(5, "the first motion is movej, not MoveAbsJ")]),
        (f"MODULE {'n' * 33}\nCONST num {'k' * 33}:=1;\nCONST num v5:=1;\nCONST num a:=b;\nCONST num b:=a;\n"
         "PERS num c:=a;\nPROC main()\nENDPROC\nENDMODULE",
         [(1, f"{'n' * 33} is longer than 32 characters"), (2, f"{'k' * 33} is longer than 32 characters"),
          (3, "v5 is predefined"), (4, "a is defined by itself or through too many others"),
          (6, "PERS c must have a literal value")]),
        ("MODULE user\nCONST num reg1:=1;\nLOCAL CONST num edge:=1;\nPROC main()\nENDPROC\nENDMODULE",
         [(1, "user is the name of a system module or of what one declares"),
          (2, "reg1 is the name of a system module or of what one declares")]),
        ("MODULE a\nPROC main()\nENDPROC\nPROC b()\nENDPROC\nPROC MoveL()\nENDPROC\nENDMODULE\nMODULE b\nENDMODULE",
         [(6, "MoveL is predefined"), (9, "the module b has the name of something global")]),
        ("MODULE p\nPROC p()\nENDPROC\nPROC main()\nENDPROC\nPROC MAIN()\nENDPROC\nENDMODULE",
         [(2, "p is global and has the name of a module"), (6, "MAIN is declared twice")]),
    ],
)  # fmt: skip
def test_faults_of_modules(text: str, faults: list[tuple[int, str]]) -> None:
    assert list_faults({"m.mod": text}, {}) == faults


def test_whole_line_and_general_rules_read_the_same() -> None:
    plan = pressing(pressed(0), pressed(0.3, 12.0, 1.0), pressed(0.5))
    plan = program(*plan.body, MoveJ(at(1, 2, 3), 33.0, 5.0), MoveC(at(2, 3, 3), at(3, 2, 3), 9.0))
    text = posted(plan)[1]["plate.mod"]
    compact, spaced = read({"a": text}, {}), read({"a": re.sub(r"([\[\],])", r" \1 ", text)}, {})
    assert spaced.lines == compact.lines
    assert_same(program(*compact.body), spaced, Tolerance(0, 0, 0, 0, 0, 0))


GOOD = posted(pressing(pressed(0), pressed(0.3), Output("process", 1), Comment("x"), Wait(1)))[1][
    "plate.mod"
]
TOKENS = re.findall(r"\w+|[^\w\s]|\s+", GOOD)
PIECES = [
    *"[];,\\!\n-()é\x00\"", ":=", "9E999", "PROC x()", "ENDPROC", "MODULE y", "IF", "THEN", "%%%", "[" * 3000, "main;",
    "CONST num q:=", "1.2.3", "TASK", "MoveL", "TRUE", "t1", "fine",
]  # fmt: skip
CHANGES = st.tuples(st.integers(0, len(TOKENS) - 1), st.sampled_from(PIECES), st.booleans())


@given(st.lists(CHANGES, min_size=1, max_size=4))
def test_no_text_breaks_the_reader(changes: list[tuple[int, str, bool]]) -> None:
    tokens = list(TOKENS)
    for place, piece, insert in changes:
        tokens[place] = f"{tokens[place]} {piece} " if insert else piece
    text = "".join(tokens)
    reading = read({"a": text}, {})
    assert all(
        1 <= fault.line <= text.count("\n") + text.count("\r") + 1 for fault in reading.findings
    )
    assert len(reading.body) == len(reading.lines)


@given(st.text(), st.text(alphabet='[]();,\\:=!"%MODULE PRCEND\n09.'))
def test_no_text_at_all_breaks_the_reader(one: str, two: str) -> None:
    assert read({"a": one, "b": two}, {}).findings


@pytest.mark.skipif(
    not (SHARED / "data").is_dir(), reason="the folder shared is not beside the repository"
)
def test_programs_from_elsewhere_give_faults_not_errors() -> None:
    paths = sorted((SHARED / "data" / "robot").rglob("*.*"))
    assert paths
    for path in paths:
        reading = read({path.name: path.read_text(errors="replace")}, {})
        assert reading.findings, path.name


# The cell -------------------------------------------------------------------------------------------------------


def test_a_sheet_is_within_reach_of_the_built_in_cell() -> None:
    """IRB 120, tool straight down: axes 2, 3 and 5 in closed form from its link lengths (data sheet)."""
    cell = Rapid.cell()
    for x in (0, 200):
        for y in (0, 75, 150):
            for z in (-10, 50):
                px, py, pz = cell.base_from_work.apply((x, y, z))
                up = cell.flange_from_tool.origin[2] + 72  # wrist centre above the tool tip
                r, h = math.hypot(px, py), pz + up - 290
                arm, reach = math.hypot(302, 70), math.hypot(r, h)
                inner = math.acos((270**2 + arm**2 - reach**2) / (2 * 270 * arm))
                q3 = math.pi - math.atan2(302, 70) - inner
                q2 = (
                    math.pi / 2
                    - math.atan2(h, r)
                    - math.acos((270**2 + reach**2 - arm**2) / (2 * 270 * reach))
                )
                q5 = math.pi / 2 - q2 - q3
                assert abs(math.degrees(math.atan2(py, px))) < 165
                assert -110 < math.degrees(q2) < 110
                assert -110 < math.degrees(q3) < 70
                assert 5 < math.degrees(q5) < 120
