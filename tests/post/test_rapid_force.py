"""RAPID: sections under contact force, and the force sensor that is set to zero before them."""

import math

import pytest
from camgen_posts.rapid import Rapid
from camgen_posts.rapid.force import choose_calibrations
from msgspec.structs import replace

from camgen.lang.rapid.strict import read
from camgen.model.errors import Refused
from camgen.model.program import Comment, Force, Instruction, MoveC, MoveJ, MoveL, Output
from camgen.post.plugins import make_post
from tests.support.rapid_programs import (
    E9,
    HOME,
    TWO_PATHS,
    assert_same,
    at,
    inward,
    list_routines,
    on_disc,
    path_body,
    pressed,
    pressing_program,
    print_main,
    print_program,
    program,
    program_of_paths,
    turned,
    verify,
)


@pytest.mark.parametrize(("sign", "plus"), [(1, ""), (-1, "-")])
def test_a_section_under_force_starts_presses_and_ends(sign: int, plus: str) -> None:
    options: dict[str, object] = {"force_sign": sign, "force_load": "lTool", "force_change": 10.0}
    plan = pressing_program(
        Output("process", 1),
        pressed(0),
        pressed(0.1, 24.5, 1.0),
        pressed(0.2),
        Output("process", 0),
    )
    got = print_main(plan, **options)
    start = f"[[20.000,0.000,-2.000],[0.0000000,0.0000000,1.0000000,0.0000000],[0,0,0,0],{E9}]"
    tail = "tCamgen\\WObj:=wCamgen;"
    assert got[:2] == ["SetDO doProcess,0;", "IF FCIsForceMode() FCDeact;"]
    assert got[3:5] == ["WaitTime\\InPos,0;", "FCCalib lTool;"]  # in the air, at the home position
    assert got[6:9] == [
        "SetDO doProcess,1;",
        f"FCPress1LStart {start},",
        f"v20,\\Fx:={plus}25,50\\ForceChange:=10,fine,{tail}",
    ]
    assert got[9].startswith("FCPressL [[19.900,1.997,-2.000],")
    assert got[9].endswith(f",v20,{plus}24.5,z1,{tail}")
    assert got[12].startswith("FCPressEnd [[20.000,0.000,9.000],")
    assert got[12].endswith(f",v50,{tail}")
    prepared, files = print_program(plan, **options)
    assert_same(prepared, read(files, options), Rapid().tolerance())


def test_a_force_against_the_tool_axis_is_negative() -> None:
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
        print_program(plan)
    plan = program(
        *plan.body[:-1], MoveC(at(9, 3, 3), at(9, 0, 6), 9.0, 1.0), MoveL(at(0, 0, 9), 9.0)
    )
    prepared, files = print_program(plan)
    assert "\\Fz:=-5,50,fine," in files["plate.mod"]
    assert_same(prepared, read(files, {}), Rapid().tolerance())


def test_an_arc_under_force_becomes_lines_unless_force_arcs_is_set() -> None:
    arc = MoveC(on_disc(-0.3), on_disc(-0.6), 20.0, 0.0, 25.0, inward(-0.6))
    plan = pressing_program(pressed(0), arc)
    assert not any(isinstance(item, MoveC) for item in print_program(plan)[0].body)
    prepared, files = print_program(plan, force_arcs=True)
    assert "FCPressC [[" in files["plate.mod"]
    assert_same(prepared, read(files, {}), Rapid().tolerance())
    # FCPress1LStart is straight, so an arc at the start becomes lines too.
    first = pressing_program(arc)
    prepared, files = print_program(first, force_arcs=True)
    assert "FCPressC" not in files["plate.mod"]
    assert_same(prepared, read(files, {}), Rapid().tolerance())


def test_the_option_ignore_leaves_the_force_out() -> None:
    plan = pressing_program(
        pressed(0), MoveC(on_disc(-0.3), on_disc(-0.6), 20.0, 0.0, 25.0, inward(-0.6))
    )
    prepared, files = print_program(plan, force="ignore")
    assert not any(isinstance(item, Force) or getattr(item, "force", 0) for item in prepared.body)
    assert "! pressing is left out: post.force =" in files["plate.mod"]
    assert "FCPress" not in files["plate.mod"]
    assert_same(prepared, read(files, {"force": "ignore"}), Rapid().tolerance())


def test_the_routine_of_a_path_under_force_also_leaves_the_surface() -> None:
    """The motion off the surface belongs to the next path, whose comment comes after it."""
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
        *path_body(1, 10),
        HOME,
    ]
    prepared, files = print_program(program_of_paths(*body))
    text = files["plate.mod"]
    work = ["SetDO", "FCPress1LStart", "v20", "SetDO", "FCPressEnd"]
    assert list_routines(files)["c1"] == ["MoveL", *work, "ERROR", "RAISE"]
    assert "PROC c2()\n        ! path c2\n        ! path 1\n        MoveL" in text
    verify(prepared, read(files, {}))


END_OF_FORCE = "        IF FCIsForceMode() FCDeact;\n"


def test_force_control_ends_before_the_first_motion_and_on_an_error() -> None:
    plan = pressing_program(Output("process", 1), pressed(0), pressed(0.1), Output("process", 0))
    prepared, files = print_program(plan)
    text = files["plate.mod"]
    assert f"ConfL\\Off;\n        SetDO doProcess,0;\n{END_OF_FORCE}        MoveAbsJ " in text
    assert f"    ERROR\n        camSafe;\n{END_OF_FORCE}        RAISE;\n" in text
    assert text.count("FCDeact") == 2
    reading = read(files, {})
    assert reading.body[:2] == (Output("process", 0.0), Force(0.0))
    verify(prepared, reading)
    assert "FCDeact" not in print_program(TWO_PATHS)[1]["plate.mod"]


def test_a_reorientation_under_force_has_its_own_orientation_speed() -> None:
    """The tool presses along its axis and turns about that axis."""
    press = (0.0, 0.0, -1.0)
    held = MoveL(turned(9, 1.0), 20.0, 0.0, 5.0, press, turn=math.radians(60.0))
    body = [
        MoveL(at(0, 0, 0), 9.0),
        Force(5.0, press),
        MoveL(at(9, 0, 0), 20.0, 0.0, 5.0, press),
        held,
        Force(0.0),
    ]
    prepared, files = print_program(program(HOME, *body, MoveL(at(9, 0, 50), 20.0)))
    (line,) = (line for line in files["plate.mod"].splitlines() if "FCPressL" in line)
    assert line.endswith(",vCam20t60,5,fine,tCamgen\\WObj:=wCamgen;")
    verify(prepared, read(files, {}))


# Setting the force sensor to zero


def test_a_force_without_a_zero_of_the_sensor_is_refused() -> None:
    with pytest.raises(
        Refused, match="the force sensor is not set to zero before pressing"
    ) as caught:
        make_post(Rapid, {}).prepare(pressing_program(pressed(0)), 0.01)
    assert "give post.force_load, or post.force_calibrated = true if the cell does it" in str(
        caught.value
    )
    # The end of force control, the home position and the link come before it.
    assert caught.value.index == 3


def sections(*between: Instruction) -> list[str]:
    """The statements of a program with two sections under force, and `between` on the link."""
    plan = pressing_program(pressed(0.1))
    body = [HOME, MoveL(on_disc(0, 30), 90.0, 5.0), MoveL(on_disc(0, 1), 90.0), *plan.body[1:-1]]
    again = [
        MoveL(on_disc(0.1), 20.0),
        *between,
        MoveL(on_disc(0), 50.0),
        Force(25.0, inward(0)),
        pressed(0.1),
    ]
    got = print_main(
        program(*body, *again, Force(0.0), MoveL(on_disc(0.1, 9), 50.0)), force_load="lTool"
    )
    return [line for line in got if not line.startswith("v")]


def test_the_sensor_is_set_to_zero_at_a_stop_at_clearance_height() -> None:
    """The planned blend of 5 mm becomes a stop. The next point is only 3 mm above the start."""
    got = sections()
    assert got[0] == "IF FCIsForceMode() FCDeact;"
    assert got[2].startswith("MoveL [[20.000,0.000,30.000]")
    assert ",fine," in got[2]
    assert got[3:5] == ["WaitTime\\InPos,0;", "FCCalib lTool;"]
    assert got.count("FCCalib lTool;") == 1  # on the link the tool stays low


def test_a_section_after_a_link_in_the_air_has_its_own_zero() -> None:
    got = sections(MoveL(on_disc(0.1, 9), 50.0), MoveL(on_disc(0, 9), 50.0, 2.0))
    zeros = [k for k, line in enumerate(got) if line == "FCCalib lTool;"]
    assert len(zeros) == 2
    assert got[zeros[1] - 2].startswith("MoveL [[20.000,0.000,9.000]")
    assert ",fine," in got[zeros[1] - 2]
    over_home = sections(HOME)
    assert over_home.count("FCCalib lTool;") == 2
    zeros = [k for k, line in enumerate(over_home) if line == "FCCalib lTool;"]
    assert over_home[zeros[1] - 2].startswith("MoveAbsJ ")


def test_a_first_section_without_a_motion_in_the_air_before_it_is_refused() -> None:
    body = pressing_program(pressed(0)).body
    far = MoveL(on_disc(1.0), 50.0)
    with pytest.raises(Refused, match="pressing from a pose that is not known"):
        print_program(program(HOME, *body[3:]), force_load="lTool")
    low = program(MoveJ(on_disc(0.5), 9.0), far, *body[2:])
    with pytest.raises(
        Refused, match="no motion in the air before pressing, where the force sensor can be set to"
    ):
        choose_calibrations("rapid", low.body)


def test_a_program_with_force_states_its_assumptions() -> None:
    plan = pressing_program(pressed(0))
    text = print_program(plan, force_sign=-1, force_threshold=30.0)[1]["plate.mod"]
    sign = "a positive force pushes against the axis of the tool"
    assert f"! force: Machining FC is installed; {sign}" in text
    assert "! force: travel begins when 30 % of the force is felt" in text
    assert "! force: the sensor is set to zero by the cell, before this program" in text
    zeroed = print_program(plan, force_load="lTool")[1]["plate.mod"]
    assert "! force: the sensor is set to zero by FCCalib lTool in the air" in zeroed
