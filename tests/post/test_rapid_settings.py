"""RAPID: speeds, frames, loads and settings of the arm."""

import math
import re

import pytest
from camgen_posts.rapid import Rapid
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from camgen.lang.rapid.strict import read
from camgen.model.errors import VerifyError
from camgen.model.pose import translation
from camgen.model.program import Instruction, MoveL
from camgen.post.plugins import make_post
from camgen.post.verify import compare
from tests.support.rapid_programs import (
    HOME,
    TWO_PATHS,
    at,
    print_program,
    program,
    reorientation,
    turned,
    verify,
)


@pytest.mark.parametrize(
    ("degrees", "speed", "name", "data"),
    [
        (60.0, 100.0, "vCam100t60", "[100,60,5000,1000]"),
        (60.0, 37.5, "vCam37_5t60", "[37.5,60,5000,1000]"),
        (12.345, 100.0, "vCam100t12_345", "[100,12.345,5000,1000]"),
        (500.0, 100.0, "v100", ""),
    ],
)
def test_a_reorientation_has_a_speeddata_with_its_orientation_speed(
    degrees: float, speed: float, name: str, data: str
) -> None:
    """The second component of a speeddata is the limit, deg/s. A predefined speeddata has 500."""
    prepared, files = print_program(reorientation(degrees, speed))
    text = files["plate.mod"]
    assert re.findall(r"CONST speeddata (\S+):=(.*);", text) == ([(name, data)] if data else [])
    motions = [line for line in text.splitlines() if "MoveL" in line]
    used = [re.findall(r"],(\w+),fine,tCamgen", line)[0] for line in motions]
    assert used == ["v100", name, "v100"]
    reading = read(files, {})
    turns = [item.turn for item in reading.body if isinstance(item, MoveL)]
    assert turns == pytest.approx([0.0, math.radians(degrees), 0.0], abs=1e-5)
    verify(prepared, reading)


@pytest.mark.parametrize(
    ("before", "after", "reads"),
    [
        (",vCam100t60,", ",v100,", "8.726646"),  # 500 deg/s
        ("[100,60,5000,1000]", "[100,500,5000,1000]", "8.726646"),
        (",vCam100t60,", ",[100,500,5000,1000],", "8.726646"),
        (",vCam100t60,", ",[100,61,5000,1000],", "1.064651"),
    ],
)
def test_a_changed_orientation_speed_does_not_verify(before: str, after: str, reads: str) -> None:
    prepared, files = print_program(reorientation(60.0))
    assert files["plate.mod"].count(before) == 1
    wrong = read({"a": files["plate.mod"].replace(before, after)}, {})
    assert {fault.what for fault in wrong.findings} <= {"vCam100t60 is declared and never used"}
    without_faults = replace(wrong, findings=())
    with pytest.raises(
        VerifyError, match=f"instruction 2: speed of turning reads {reads}, planned is 1.047198"
    ):
        verify(prepared, without_faults)


def test_a_reorientation_below_the_digits_of_the_text_verifies() -> None:
    prepared, files = print_program(reorientation(60.0, angle=1e-9))
    verify(prepared, read(files, {}))


def test_orientation_speeds_beyond_the_sixth_have_no_name() -> None:
    turns = [MoveL(turned(0, k), 100.0, turn=math.radians(10 + k)) for k in range(1, 9)]
    prepared, files = print_program(program(HOME, MoveL(at(0, 0, 0), 100.0), *turns))
    text = files["plate.mod"]
    assert text.count("CONST speeddata") == 6
    assert text.count(",[100,17,5000,1000],fine,") == text.count(",[100,18,5000,1000],fine,") == 1
    verify(prepared, read(files, {}))


def test_the_most_used_and_the_slowest_speeds_have_a_name() -> None:
    """The two that are used twice, and the slowest of the others."""
    speeds = [10.5 + k / 8 for k in range(29)]
    body: list[Instruction] = []
    for k, speed in enumerate(speeds):
        uses = 2 if k in (3, 20) else 1
        body += [MoveL(at(k, use, 0), speed) for use in range(uses)]
    prepared, files = print_program(program(HOME, *body))
    text = files["plate.mod"]
    assert re.findall(r"CONST speeddata (\w+):=", text) == [
        *("vCam10_5", "vCam10_625", "vCam10_75", "vCam10_875", "vCam11", "vCam13"),
    ]
    assert text.count(",[11.125,500,5000,1000],fine,") == 1
    reading = read(files, {})
    verify(prepared, reading)


def test_a_fixture_is_the_user_frame_and_the_object_frame_is_relative_to_it() -> None:
    """A work frame at 900, 200, 510 is at 200, 100, 10 in a fixture at 1000, 0, 500.

    The fixture is turned by 90 deg about z.
    """
    plan = replace(
        program(HOME, MoveL(at(0, 0, 0), 20.0)), base_from_work=translation(900, 200, 510)
    )
    prepared, files = print_program(plan, fixture=[1000, 0, 500, 0, 0, 90])
    user = "[[1000.000,0.000,500.000],[0.7071068,0.0000000,0.0000000,0.7071068]]"
    work_object = "[[200.0000,100.0000,10.0000],[0.7071068,0.0000000,0.0000000,-0.7071068]]"
    data = f'[FALSE,TRUE,"",{user},{work_object}]'
    assert f"TASK PERS wobjdata wCamgen:={data};" in files["plate.mod"]
    verify(prepared, read(files, {}))


@given(
    st.lists(st.floats(-1500, 1500), min_size=3, max_size=3),
    st.lists(st.floats(-180, 180), min_size=3, max_size=3),
    st.integers(0, 6),
)
def test_a_fixture_anywhere_does_not_move_the_work(
    position: list[float], angles: list[float], decimals: int
) -> None:
    options: dict[str, object] = {"fixture": [*position, *angles], "decimals": decimals}
    prepared, files = print_program(program(HOME, MoveL(at(1, 2, 3), 20.0)), **options)
    post = make_post(Rapid, options)
    compare(prepared, read(files, options), post.tolerance(), post.list_verified(), "plate.mod")


def test_a_placeholder_of_the_tool_load_is_remarked_in_the_text() -> None:
    remark = "! load: tool mass 0.001 kg is a placeholder - loading this module overwrites tCamgen"
    assert remark in print_program(TWO_PATHS)[1]["plate.mod"]
    for options in (
        {"mass": 1.8, "cog": [0, 0, 55]},
        {"declare": False, "tool": "tMine", "work": "wMine"},
    ):
        assert "! load:" not in print_program(TWO_PATHS, **options)[1]["plate.mod"]


def test_settings_of_the_arm_precede_the_first_motion() -> None:
    text = print_program(TWO_PATHS, sing_area="wrist", acc_set=[50, 40])[1]["plate.mod"]
    set_up = "        ConfL\\Off;\n        SingArea\\Wrist;\n        AccSet 50,40;\n"
    assert f"{set_up}        SetDO doProcess,0;\n        MoveAbsJ " in text
    options: dict[str, object] = {"sing_area": "wrist", "acc_set": [50, 40]}
    assert read({"a": text}, options).findings == ()
    assert "SingArea\\Off;" in print_program(TWO_PATHS, sing_area="off")[1]["plate.mod"]
    wrong = text.replace("SingArea\\Wrist", "SingArea\\Hand").replace(
        "AccSet 50,40", "AccSet 50,140"
    )
    faults = [item.what for item in read({"a": wrong}, options).findings if item.level != "unusual"]
    assert faults == ["singarea needs \\Wrist or \\Off", "accset is in %, up to 100"]
