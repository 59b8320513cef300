"""RAPID: texts written by hand, refused programs and options, and generated programs."""

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from camgen_posts.rapid import Rapid
from camgen_posts.rapid.options import legal_name
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from camgen.lang.rapid.strict import read
from camgen.model.errors import JobError, Refused
from camgen.model.pose import Pose, angle_between, rotation_from_quaternion, translation
from camgen.model.program import (
    Comment,
    Force,
    Instruction,
    Joints,
    MoveC,
    MoveJ,
    MoveL,
    Output,
    Posture,
    Program,
    Stop,
    Wait,
)
from camgen.post.plugins import find_post, find_readback, make_post
from tests.support.examples import fewer
from tests.support.rapid_programs import (
    DOWN,
    E9,
    HOME,
    assert_near,
    assert_same,
    at,
    inward,
    on_disc,
    pressed,
    pressing_program,
    print_main,
    print_program,
    program,
    reorientation,
)
from tests.support.whole import turning, whole

# Texts written by hand


def test_the_text_of_a_small_program_is_the_expected_one() -> None:
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
    tool = (
        "[[0.000,0.000,100.000],[1.0000000,0.0000000,0.0000000,0.0000000]],[0.001,[0,0,0.001],"
        "[1,0,0,0],0,0,0]"
    )
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
    prepared, files = print_program(plan)
    assert files == {"plate.mod": expected}
    reading = find_readback("rapid")(files, {})
    assert_same(prepared, reading, Rapid().tolerance())
    assert tuple(reading.lines) == (13, 14, 16, 17, 18, 19, 20, 22, 23)
    assert_near(reading.work, translation(300, -75, 100), Rapid().tolerance())
    assert_near(reading.tool, translation(0, 0, 100), Rapid().tolerance())
    assert find_post("rapid") is Rapid


def test_the_program_on_the_page_is_read_without_findings_and_switches_off() -> None:
    page = (Path(__file__).parents[2] / "docs" / "posts" / "rapid.md").read_text(encoding="utf-8")
    reading = read({"bracket.mod": page.split("```\n")[1]}, {"mass": 1.8, "cog": [0, 0, 55]})
    assert reading.findings == ()
    body = tuple(reading.body)
    assert len(body) == 11
    program(*body)
    assert whole(body) == body


def test_confdata_is_stated_and_supervised_if_the_posture_is_known() -> None:
    known = Posture((-1, 1, 2, 0), 5)
    plan = program(
        HOME, MoveJ(at(0, 0, 9), 100.0, posture=known), MoveL(at(0, 0, 0), 20.0, posture=known)
    )
    text = print_program(plan)[1]["plate.mod"]
    assert "ConfJ\\On;" in text
    assert "ConfL\\On;" in text
    assert text.count(f",[-1,1,2,0],{E9}") == 2
    unknown = program(*plan.body, MoveL(at(5, 0, 0), 20.0))
    assert "ConfL\\Off;" in print_program(unknown)[1]["plate.mod"]
    unsure = program(
        *plan.body, MoveL(at(5, 0, 0), 20.0, joints=Joints((0.1,) * 6), posture=Posture(None, 5))
    )
    assert "ConfL\\Off;" in print_program(unsure)[1]["plate.mod"]
    stated = print_program(plan, conf="state")[1]["plate.mod"]
    assert "ConfJ\\Off;" in stated
    assert "ConfL\\Off;" in stated
    assert stated.count(f",[-1,1,2,0],{E9}") == 2
    without = print_program(plan, conf="off")[1]["plate.mod"]
    assert "ConfJ\\Off;" in without
    assert without.count(f",[0,0,0,0],{E9}") == 2


@pytest.mark.parametrize(
    ("speed", "blend", "names"),
    [
        (5.0, 0.0, "v5,fine"),
        (7000.0, 0.3, "v7000,z0"),
        (6.0, 1.0, "vCam6,z1"),
        (20.0004, 200.0, "v20,z200"),
        (0.001, 0.0, "vCam0_001,fine"),
        (90.125, 199.9, "vCam90_125,zCam199_9"),
    ],
)
def test_a_speed_or_zone_is_declared_unless_it_is_predefined(
    speed: float, blend: float, names: str
) -> None:
    plan = program(HOME, MoveL(at(0, 0, 0), speed, blend), MoveL(at(900, 0, 0), 20.0))
    assert print_main(plan)[1].endswith(f"{names},tCamgen\\WObj:=wCamgen;")
    assert_same(plan, read(print_program(plan)[1], {}), Rapid().tolerance())


def test_s4_has_a_banner_plain_persistents_and_short_names() -> None:
    plan = replace(program(HOME), name="a very long name of a part")
    text = print_program(plan, s4=True)[1]["a very long name of a part.mod"]
    assert text.startswith("%%%\n  VERSION:1\n  LANGUAGE:ENGLISH\n%%%\nMODULE a_very\n")
    assert "\n    PERS tooldata" in text
    assert "TASK" not in text
    assert read({"a": text}, {"s4": True}).findings == ()


def test_tool_and_work_may_be_on_the_controller() -> None:
    options: dict[str, object] = {"declare": False, "tool": "tSpindle", "work": "wobj0"}
    plan = program(HOME, MoveL(at(0, 0, 0), 20.0))
    files = print_program(plan, **options)[1]
    assert "tooldata" not in files["plate.mod"]
    reading = read(files, options)
    assert reading.findings == ()
    assert reading.tool is None
    assert [fault.what for fault in read(files, {}).findings] == ["tSpindle is not declared"] * 2


def test_a_stop_waits_for_the_operator_and_is_read_back() -> None:
    planned = program(HOME, MoveJ(at(0, 0, 5), 50.0), Stop(), MoveL(at(5, 0, 5), 20.0))
    assert "Stop;" in print_main(planned)
    reading = read(print_program(planned)[1], {})
    assert [type(item) for item in reading.body if isinstance(item, Stop)] == [Stop]
    assert_same(planned, reading, Rapid().tolerance())


def test_rapid_has_no_optional_stop() -> None:
    post = make_post(Rapid, {})
    with pytest.raises(Refused, match="no optional stop") as caught:
        post.prepare(program(HOME, MoveJ(at(0, 0, 5), 50.0), Stop(optional=True)), 0.01)
    assert caught.value.index == 2


def test_the_spindle_is_an_analog_output() -> None:
    options = {"signals": {"spindle": "aoSpindle", "process": "doAir"}}
    plan = program(HOME, Output("spindle", 12000), Output("process", 1))
    home = f"MoveAbsJ [[0.0000,0.0000,0.0000,0.0000,30.0000,0.0000],{E9}],v200,fine,tCamgen;"
    resets = ["SetAO aoSpindle,0;", "SetDO doAir,0;"]
    assert print_main(plan, **options) == [
        *resets,
        home,
        "SetAO aoSpindle,12000;",
        "SetDO doAir,1;",
        *resets,
    ]
    assert_same(plan, read(print_program(plan, **options)[1], options), Rapid().tolerance())


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("plate", "plate"),
        ("10 mm", "m10_mm"),
        ("MoveL", "mMoveL"),
        ("main", "mmain"),
        ("user", "muser"),
        ("Base", "mBase"),
        ("edge", "medge"),
        ("reg5", "mreg5"),
        ("reg6", "reg6"),
        ("wobj1", "mwobj1"),
        ("clock1", "mclock1"),
        ("HIGH", "mHIGH"),
        ("camSafe", "mcamSafe"),
        ("", "m"),
        ("Zähne", "Z_hne"),
        ("x" * 40, "x" * 31),
        ("while", "mwhile"),
    ],
)
def test_a_module_gets_a_legal_name(text: str, name: str) -> None:
    assert legal_name(text, 32) == name


# Refusals

TWISTED = MoveL(on_disc(0.1), 20.0, 0.0, 25.0, inward(0.2))
FOLLOW = (
    'on a drawing set tool.orient = "follow", so that the tool turns with the surface; '
    "of a part leave that edge out (input.select), "
    'or all pressing (post.force = "ignore")'
)


@pytest.mark.parametrize(
    ("plan", "message"),
    [
        (
            program(MoveJ(at(0, 0, 0), 9.0)),
            (
                "(instruction 0)|the first motion must be to joint values; give the home "
                "position in deg"
            ),
        ),
        (
            program(MoveJ(Joints((0.0,) * 4), 9.0)),
            "4 joint values; RAPID here is for arms of six axes",
        ),
        (program(HOME, MoveL(at(9000, 0, 0), 9.0)), "a coordinate of more than 8388 mm"),
        (program(HOME, MoveL(at(0, 0, 0), 1e-4)), "a speed of 0.0001 mm/s; use 0.001 to 99999"),
        (
            reorientation(1e-4),
            "a turn at 0.0001 deg/s; use 0.001 to 99999 for process.turn (instruction 2)",
        ),
        (reorientation(1e6), "a turn at 1e+06 deg/s; use 0.001 to 99999 for process.turn"),
        (
            program(HOME, MoveL(at(0, 0, 0), 9.0, 1e-4), HOME),
            "a blend radius of 0.0001 mm; use 0, or 0.001 to",
        ),
        (
            program(HOME, MoveC(at(1, 1, 0), at(2, 0, 0), 9.0)),
            "an arc from a pose that is not known",
        ),
        (
            program(HOME, MoveL(at(0, 0, 0), 9.0), MoveC(at(1, 0, 0), at(2, 0, 0), 9.0)),
            "the three points of the arc are on one line (instruction 2)",
        ),
        (
            program(HOME, Output("coolant", 1)),
            'no output is named for coolant; set post.signals, e.g. coolant = "doName"',
        ),
        (program(HOME, Output("spindle", 9)), 'set post.signals, e.g. spindle = "aoName"'),
        (
            program(HOME, Output("process", 0.5)),
            "process is a digital output and cannot be 0.5; use 0 or 1",
        ),
        (
            pressing_program(TWISTED),
            f"the press direction is not the same tool axis in the whole section; {FOLLOW}",
        ),
        (
            pressing_program(pressed(0), replace(pressed(0.1), force=0.0)),
            "a motion without force while pressing",
        ),
        (
            pressing_program(pressed(0, 20.0)),
            "the first motion must press as hard as its section starts",
        ),
        (pressing_program(pressed(0), HOME), "a joint-interpolated motion while pressing"),
        (
            pressing_program(pressed(0), Force(9.0, inward(0)), pressed(0)),
            "the force is on already",
        ),
        (
            program(
                HOME, Force(9.0, (1, 0, 0)), MoveL(at(0, 0, 0), 9.0, 0, 9.0, (1, 0, 0)), Force(0)
            ),
            "pressing from a pose that is not known",
        ),
        (program(*pressing_program(pressed(0)).body[:-1]), "no straight motion leaves the surface"),
        (pressing_program(), "two changes of force without a motion between them"),
    ],
)
def test_a_program_that_the_post_cannot_print_is_refused(plan: Program, message: str) -> None:
    with pytest.raises(Refused) as caught:
        print_program(plan)
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
def test_an_invalid_option_is_refused(options: Mapping[str, object], message: str) -> None:
    with pytest.raises(JobError) as caught:
        make_post(Rapid, options)
    assert message in str(caught.value)


def test_a_long_arc_is_halved_and_a_short_or_flat_one_becomes_lines() -> None:
    """An arc of up to 120 deg stays as it is."""
    start = MoveL(at(0, 0, 0), 9.0)
    half = program(HOME, start, MoveC(at(5, 5, 0), at(10, 0, 0), 9.0))
    assert [type(item) for item in print_program(half)[0].body] == [MoveJ, MoveL, MoveC, MoveC]
    third = program(HOME, start, MoveC(at(5, 5 / math.sqrt(3), 0), at(10, 0, 0), 9.0))
    assert print_program(third)[0] is third
    wider = program(HOME, start, MoveC(at(5, 5 / math.sqrt(3) + 0.01, 0), at(10, 0, 0), 9.0))
    assert [type(item) for item in print_program(wider)[0].body] == [MoveJ, MoveL, MoveC, MoveC]
    small = program(HOME, start, MoveC(at(0.1, 0.02, 0), at(0.2, 0, 0), 9.0))
    flat = program(HOME, start, MoveC(at(5, 0.04, 0), at(10, 0, 0), 9.0))
    for plan in (small, flat):
        assert not any(isinstance(item, MoveC) for item in print_program(plan)[0].body)


# Generated programs

coordinate = st.floats(-900, 900)
quaternions = st.one_of(
    st.sampled_from(
        [(1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1), (0, 1, -1, 0), (1, 0, 1e-9, 0)]
    ),
    st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: sum(v * v for v in q) > 1e-3),
)
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
# `make_printable` moves a reorientation to the end of the motion before it.
reorientations = st.builds(MoveL, poses, speeds, turn=st.floats(1e-3, 9.0))
instructions = st.one_of(
    reorientations,
    st.builds(MoveL, poses, speeds, blends),
    st.builds(MoveJ, poses, speeds, blends),
    st.builds(MoveJ, joint_values, speeds, blends),
    arcs,
    st.builds(Wait, st.floats(0, 100)),
    st.builds(Output, st.just("process"), st.sampled_from([0.0, 1.0])),
    st.builds(Comment, comments),
)


def make_printable(body: list[Instruction]) -> tuple[Instruction, ...]:
    """The body with the stops that a program needs, without arcs that start at an unknown pose."""
    result: list[Instruction] = [HOME]
    last = 0
    for item in [*body, Wait(0.0)]:
        before = result[last]
        assert isinstance(before, (MoveJ, MoveL, MoveC))
        if isinstance(item, MoveC) and (
            not isinstance(before.target, Pose) or not is_printable_arc(before.target, item)
        ):
            continue
        if isinstance(item, MoveL) and item.turn:
            if isinstance(before.target, Pose) and not is_half_turn(before.target, item.target):
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
            and is_half_turn(before.target, item.target)
        ):
            result.append(MoveJ(item.target, item.speed, item.blend))
        else:
            result.append(item)
        if isinstance(item, (MoveJ, MoveL, MoveC)):
            last = len(result) - 1
    return turning(result, 1.0)


def is_half_turn(a: Pose, b: Pose) -> bool:
    return angle_between(a.rotation, b.rotation) > math.radians(179)


def is_printable_arc(start: Pose, arc: MoveC) -> bool:
    """Whether the angle at the via point is at least 90 deg, as in an arc of half a circle."""
    u, w = (np.subtract(pose.origin, arc.via.origin) for pose in (start, arc.target))
    sine = float(np.linalg.norm(np.cross(u, w)) / max(np.linalg.norm(u) * np.linalg.norm(w), 1e-9))
    return float(u @ w) < 0 and sine > 1e-3


@fewer(12)
@given(st.lists(instructions, max_size=12), st.integers(0, 6), st.sampled_from([0, 3]))
def test_the_reading_of_a_generated_program_is_the_program(
    body: list[Instruction], decimals: int, max_lines: int
) -> None:
    options: dict[str, object] = {"decimals": decimals, "max_lines": max_lines}
    prepared, files = print_program(program(*make_printable(body)), **options)
    # A blend has 3 digits.
    tolerance = replace(Rapid(decimals=decimals).tolerance(), mm=max(0.5 * 10**-decimals, 5e-4))
    assert_same(prepared, read(files, options), tolerance)


# The built-in cell


def test_the_built_in_cell_reaches_a_sheet() -> None:
    """Axes 2, 3 and 5 of an IRB 120 with its tool straight down, in closed form.

    The link lengths are those of the data sheet.
    """
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
