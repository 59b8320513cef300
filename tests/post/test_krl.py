"""KRL, the example of docs/writing-a-post.md: its text, its refusals and its read-back."""

import math
from pathlib import Path

import numpy as np
import pytest

from camgen.model.errors import JobError, Refused
from camgen.model.pose import TOOL_DOWN, Pose, rotation_about
from camgen.model.program import Force, Joints, MoveC, MoveJ, MoveL, Output, Program, Wait
from camgen.post.plugins import find_post, find_readback, make_post
from tests.support.whole import whole

EXAMPLE = Path(__file__).parents[2] / "docs" / "example_post"
KRL = find_post(str(EXAMPLE / "krl.py"))
READ = find_readback(str(EXAMPLE / "krl_language.py"))
HOME = MoveJ(Joints((0.0, -math.pi / 2, math.pi / 2, 0.0, math.pi / 2, 0.0)), 100.0)


def at(x, y, z=0.0, rotation=TOOL_DOWN):
    return Pose(rotation, (x, y, z))


def text(*body, name="part", **options):
    cell = KRL.cell()
    post = make_post(KRL, options)
    program = Program(
        name, cell.base_from_work, cell.flange_from_tool, whole((HOME, *body)), ("FOLD the rest",)
    )
    (file,) = post.render(post.prepare(program, 0.01))
    return file


def lines(*body, **options):
    """The lines of the body after the first PTP."""
    rows = text(*body, **options).text.splitlines()
    first = next(k for k, row in enumerate(rows) if row.startswith("PTP"))
    return rows[first + 1 : -1]


def test_the_settings_of_motions_precede_the_first_one():
    assert text(name="a b").text.splitlines() == [
        "DEF a_b()",
        "; - FOLD the rest",
        "BAS(#INITMOV, 0)",
        "$IPO_MODE=#BASE",
        "$ORI_TYPE=#VAR",
        "$CIRC_TYPE=#BASE",
        *(f"$VEL_AXIS[{axis}]=10" for axis in range(1, 7)),
        "$BASE={X 500.000, Y 0.000, Z 0.000, A 0.0000, B 0.0000, C 0.0000}",
        "$TOOL={X 0.000, Y 0.000, Z 100.000, A 0.0000, B 0.0000, C 0.0000}",
        "PTP {A1 0.0000, A2 -90.0000, A3 90.0000, A4 0.0000, A5 90.0000, A6 0.0000}",
        "END",
    ]


def test_a_speed_is_in_metres_per_second_and_printed_when_it_changes():
    moves = [MoveL(at(x, 0), speed) for x, speed in ((0, 20.0), (1, 20.0), (2, 1500.0))]
    assert [line for line in lines(*moves) if "VEL" in line] == [
        "$VEL.CP=0.020000",
        "$VEL.CP=1.500000",
    ]


def test_angles_are_about_z_then_y_then_x():
    # A rotation by 90 deg about z turns tool x to work y, one about y to -z.
    turned = [
        MoveL(at(0, 0, k, rotation_about(axis, math.pi / 2)), 10.0)
        for k, axis in ((0, 2), (1, 1), (2, 0))
    ]
    targets = [line for line in lines(*turned) if line.startswith("LIN")]
    assert [line.partition("A ")[2].rstrip("}") for line in targets] == [
        "90.0000, B 0.0000, C 0.0000",
        "0.0000, B 90.0000, C 0.0000",
        "0.0000, B 0.0000, C 90.0000",
    ]


def test_a_blend_is_a_distance_and_a_flag():
    moves = [MoveL(at(0, 0), 10.0, 2.5), MoveL(at(9, 0), 10.0, 2.5), MoveL(at(9, 9), 10.0)]
    place = "{{X {}.000, Y {}.000, Z 0.000, A 0.0000, B 0.0000, C 180.0000}}"
    assert lines(*moves)[1:] == [
        "$APO.CDIS=2.500",
        f"LIN {place.format(0, 0)} C_DIS",
        f"LIN {place.format(9, 0)} C_DIS",
        f"LIN {place.format(9, 9)}",
    ]


def test_a_ptp_motion_has_no_blend():
    assert not any(
        "C_" in line for line in lines(MoveJ(at(0, 0), 10.0, 5.0), MoveJ(at(9, 0), 10.0))
    )


def test_an_arc_is_its_auxiliary_point_and_its_end():
    arc = MoveC(at(10, 10), at(20, 0), 10.0)
    (circ,) = [line for line in lines(MoveL(at(0, 0), 10.0), arc) if "CIRC" in line]
    assert circ.startswith("CIRC {X 10.000, Y 10.000, ")
    assert ", {X 20.000, Y 0.000, " in circ


def test_an_arc_that_is_nearly_a_line_becomes_lines():
    rise = 1e5 - math.sqrt(1e10 - 25**2)
    rows = lines(MoveL(at(-25, 0), 10.0), MoveC(at(0, rise), at(25, 0), 10.0))
    assert [row.split()[0] for row in rows if row[0] != "$"] == ["LIN", "LIN"]


def test_outputs_and_the_spindle_are_signals():
    body = (
        Output("process", 1.0),
        Output("spindle", 9000.0),
        Wait(1.5),
        Output("spindle", 0.0),
        Output("process", 0.0),
    )
    signals = {"process": 3, "spindle": 4}
    rows = text(*body, signals=signals, spindle_rpm=9000.0).text.splitlines()[-10:]
    assert [row for row in rows if not row.startswith("PTP")] == [
        "$TOOL={X 0.000, Y 0.000, Z 100.000, A 0.0000, B 0.0000, C 0.0000}",
        "$OUT[3]=FALSE",
        "$OUT[4]=FALSE",
        "$OUT[3]=TRUE",
        "$OUT[4]=TRUE",
        "WAIT SEC 1.500",
        "$OUT[4]=FALSE",
        "$OUT[3]=FALSE",
        "END",
    ]
    assert rows[3].startswith("PTP {A1 ")


@pytest.mark.parametrize(
    ("body", "index", "message"),
    [
        ([MoveL(at(0, 0), 2500.0)], 1, "max_speed"),
        ([MoveL(at(0, 0), 0.001)], 1, "0.001 mm/s"),
        ([Force(5.0, (0.0, 0.0, -1.0)), Force(0.0)], 0, "process.force"),
        ([Output("spindle", 8000.0)], 2, "spindle_rpm"),
        ([Output("glue", 1.0)], 0, "post.signals"),
        ([Output("process", 0.5)], 2, "process = 0.5"),
        ([MoveC(at(1, 1), at(2, 0), 10.0)], 1, "a pose to start from"),
        ([MoveJ(Joints((0.0,) * 7), 10.0)], 1, "six axes"),
    ],
)
def test_an_instruction_that_the_controller_lacks_is_refused(body, index, message):
    with pytest.raises(Refused, match=message) as refusal:
        text(*body, signals={"process": 1, "spindle": 2}, spindle_rpm=9000.0)
    assert refusal.value.index == index


def test_a_first_motion_to_a_pose_is_refused():
    cell, post = KRL.cell(), make_post(KRL, {})
    body = (Output("process", 0.0), MoveJ(at(0, 0, 50), 10.0))
    with pytest.raises(Refused, match=r"set cell\.home to joints") as refusal:
        post.prepare(Program("part", cell.base_from_work, cell.flange_from_tool, body), 0.01)
    assert refusal.value.index == 1


@pytest.mark.parametrize(
    ("name", "called"),
    [
        ("End", "p_End"),
        ("lin_rel", "p_lin_rel"),
        ("E6POS", "p_E6POS"),
        ("ends", "p_ends"),  # begins like a declaration
        ("linear", "linear"),
        ("9 holes", "p_9_holes"),
        ("", "p_"),
        ("a" * 30, "a" * 24),
    ],
)
def test_a_program_gets_a_name_that_krl_takes(name, called):
    file = text(name=name)
    assert (file.name, file.text.splitlines()[0]) == (f"{called}.src", f"DEF {called}()")


@pytest.mark.parametrize(
    "options",
    [
        {"signals": {"a": 1, "b": 1}},
        {"signals": {"a": 0}},
        {"joint_speed": 0},
        {"joint_speed": 101},
        {"program": "two words"},
        {"program": "end"},
        {"program": "a" * 25},
        {"joint_speed": 10.5},
    ],
)
def test_an_invalid_option_is_refused(options):
    with pytest.raises(JobError):
        make_post(KRL, options)


# Read-back

BODY = (
    MoveL(at(0, 0), 20.0, 1.0),
    MoveC(at(5, 5), at(10, 0), 20.0),
    Output("process", 1.0),
    Wait(0.5),
)


def test_a_program_is_read_back():
    """The expected values follow from the manual of the language."""
    reading = READ({"part.src": text(*BODY).text}, {})
    first, home, line, arc, output, wait, last = reading.body
    assert reading.findings == ()
    assert first == last == Output("process", 0.0)
    assert home.target.values == pytest.approx(HOME.target.values, abs=1e-9)
    assert (line.target.origin, line.speed, line.blend) == ((0, 0, 0), pytest.approx(20), 1)
    assert np.allclose(line.target.rotation, TOOL_DOWN, atol=1e-12)
    assert (arc.via.origin, arc.target.origin, arc.blend) == ((5, 5, 0), (10, 0, 0), 0)
    assert (output, wait) == (Output("process", 1.0), Wait(0.5))
    assert reading.work.origin == (500, 0, 0)
    assert reading.tool.origin == (0, 0, 100)
    rows = text(*BODY).text.splitlines()
    starts = [rows[number - 1].split()[0] for number in reading.lines[:3]]
    assert starts == ["$OUT[1]=FALSE", "PTP", "LIN"]


def test_an_empty_file_is_a_fault():
    assert READ({"part.src": ""}, {}).findings
