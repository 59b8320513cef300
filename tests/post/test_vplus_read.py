"""V+: programs written by hand, and the faults of wrong ones by line."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from camgen.lang.programs import Executed
from camgen.lang.vplus.strict import read
from camgen.model.pose import TOOL_DOWN, Pose, angle_between
from camgen.model.program import Joints, MoveJ, MoveL, Output, Wait
from tests.post.changes.vplus import BRACKET
from tests.support.examples import fewer
from tests.support.fast_paths import list_values
from tests.support.vplus_programs import (
    ANGLES,
    DEGENERATE,
    HOME,
    assert_same,
    down,
    long_program,
    program,
    render,
    zyz_degrees,
)


def read_lines(*lines: str, **options: object) -> Executed:
    """The reading of a program whose first line is line 2 of the text."""
    text = "\n".join([".PROGRAM t()", *lines, ".END"]) + "\n"
    return read({"t.v2": text}, options)


def list_faults(reading: Executed) -> list[tuple[int, str]]:
    """Line and message of each fault. Remarks are left out: a text by hand has many."""
    return [(f.line, f.what) for f in reading.findings if f.level != "unusual"]


def list_origins(reading: Executed) -> list[tuple[float, ...]]:
    """The position of each target, mm, rounded to 1e-6."""
    targets = [item.target for item in reading.body if isinstance(item, (MoveJ, MoveL))]
    return [tuple(np.round(target.origin, 6).tolist()) for target in targets]


def test_the_rotational_speed_is_the_second_number_of_a_speed() -> None:
    """Without a second number it is 100 %.

    It lasts as long as its SPEED, and the monitor speed scales it.
    """
    reading = read_lines(
        "SPEED 20 MMPS ALWAYS",
        "MOVES TRANS(1)",
        "MOVES TRANS(1,0,0,90)",
        "SPEED 20, 5 MMPS",
        "MOVES TRANS(1)",
        "MOVES TRANS(1,0,0,90)",
        "SPEED 30, 10 MMPS ALWAYS",
        "MOVES TRANS(1)",
        "SPEED 50 MONITOR",
        "MOVES TRANS(1,0,0,90)",
        "MOVES TRANS(2,0,0,0)",
        rated_turn=600,
    )
    assert list_faults(reading) == []
    turns = [math.degrees(i.turn) for i in reading.body if isinstance(i, MoveL)]
    assert turns == pytest.approx([0, 600, 30, 600, 60, 30, 0])


def test_a_program_written_by_hand_is_read() -> None:
    """Lower case, labels, approach, departure, and a loop that draws a half circle.

    The expected values are computed by hand.
    """
    reading = read_lines(
        "; pen plot",
        "\tauto wf, i",
        "  select robot = 1",
        "  attach ()",
        "  set pen = trans(0,0,95.5)",
        "  tool pen ; the pen",
        "  set wf = trans(320,-40,60)",
        "  righty",
        "  speed 40 always",
        "  accel (1) 60, 60",
        "  appro wf:trans(10,10,0,0,180,180), 25",
        "  moves wf:trans(10,10,0,0,180,180)",
        "100  break",
        "  signal (33), -34",
        "  wait.event , 0.15",
        "  speed 25, 100 mmps always",
        "  for i = 0 to 180 step 90",
        "    moves wf:trans(40+15*sin(i),25-15*cos(i),0,0,180,180)",
        "  end",
        "  break",
        "  speed 40 always",
        "  departs 25",
        "  break",
        "  detach ()",
        '  type "done; not a comment", /S',
        "  return",
        rated=1000,
        signals={"pen": 33},
    )
    assert list_faults(reading) == []
    assert list_origins(reading) == [
        (10, 10, 25),
        (10, 10, 0),
        (40, 10, 0),
        (55, 25, 0),
        (40, 40, 0),
        (40, 40, 25),
    ]
    kinds = [type(i).__name__[0] + type(i).__name__[-1] for i in reading.body]
    assert kinds == ["MJ", "ML", "Ot", "Ot", "Wt", "ML", "ML", "ML", "ML"]
    moves = [i for i in reading.body if isinstance(i, (MoveJ, MoveL))]
    assert [m.speed for m in moves] == [400, 400, 25, 25, 25, 400]
    assert [m.blend > 0 for m in moves] == [True, False, True, True, False, False]
    assert reading.body[2:5] == (Output("pen", 1), Output("signal 34", 0), Wait(0.15))
    assert reading.lines == (12, 13, 15, 15, 16, 19, 19, 19, 23)
    assert reading.work is not None
    assert reading.tool is not None
    assert (reading.work.origin, reading.tool.origin) == ((320, -40, 60), (0, 0, 95.5))
    assert all(np.allclose(m.target.rotation, TOOL_DOWN, atol=1e-12) for m in moves)


@pytest.mark.parametrize(
    ("text", "origin"),
    [
        ("TRANS(1,,3)", (1, 0, 3)),
        ("TRANS(1,2,3):TRANS(10,20,30)", (11, 22, 33)),
        ("TRANS(0,0,0,90):TRANS(10)", (0, 10, 0)),
        ("RZ(90):TRANS(10,20)", (-20, 10, 0)),
        ("RY(90):TRANS(,,5)", (5, 0, 0)),
        ("RX(90):TRANS(,,5)", (0, -5, 0)),
        ("SHIFT(TRANS(1,2,3,90) BY 10,20)", (11, 22, 3)),
        ("SHIFT(TRANS(1,2,3,90) BY 10,20):TRANS(1)", (11, 23, 3)),
        ("INVERSE(TRANS(1,2,3))", (-1, -2, -3)),
        ("NULL", (0, 0, 0)),
        ("TRANS(-(2+3)*4/8, 2--1, SQRT(16)+ABS(-1.5E1)+.5)", (-2.5, 3, 19.5)),
        ("TRANS(DX(p), DY(p), DZ(p)+TRUE)", (7, 8, 8)),
        ("p", (7, 8, 9)),
    ],
)
def test_a_location_is_evaluated(text: str, origin: tuple[float, ...]) -> None:
    reading = read_lines("SET p = TRANS(7,8,9)", f"MOVE {text}")
    assert list_faults(reading) == []
    (move,) = reading.body
    assert isinstance(move, MoveJ)
    assert isinstance(move.target, Pose)
    assert reading.work is not None
    assert (reading.work @ move.target).origin == pytest.approx(origin, abs=1e-12)


@given(ANGLES, st.floats(0, 180) | DEGENERATE, ANGLES)
def test_the_angles_of_trans_are_about_z_y_and_z(yaw: float, pitch: float, roll: float) -> None:
    reading = read_lines(f"MOVE TRANS(0,0,0,{yaw:.9f},{pitch:.9f},{roll:.9f})")
    (move,) = reading.body
    assert isinstance(move, MoveJ)
    assert isinstance(move.target, Pose)
    assert angle_between(move.target.rotation, zyz_degrees(yaw, pitch, roll)) < 1e-9


def test_precision_points_are_joint_values() -> None:
    slide = read_lines("SET #p = #PPOINT(90, 0, 50, -180)", "MOVE #p", "BREAK")
    six = read_lines("MOVE #PPOINT(180,0,90,0,0,0)", "BREAK")
    assert [m.target for m in (*slide.body, *six.body) if isinstance(m, MoveJ)] == [
        Joints((math.pi / 2, 0, 50, -math.pi)),
        Joints((math.pi, 0, math.pi / 2, 0, 0, 0)),
    ]
    assert list_faults(slide) == list_faults(six) == []


def test_speeds_are_in_percent_mm_or_inches_per_second() -> None:
    reading = read_lines(
        "MOVE TRANS(1)",
        "SPEED 50",
        "MOVE TRANS(2)",
        "MOVE TRANS(3)",
        "SPEED 30 MMPS ALWAYS",
        "MOVES TRANS(4)",
        "SPEED 2 IPS",
        "MOVES TRANS(5)",
        "MOVES TRANS(6)",
        "SPEED 50 MONITOR",
        "MOVES TRANS(7)",
        "MOVE TRANS(8)",
        rated=1000,
    )
    speeds = [m.speed for m in reading.body if isinstance(m, (MoveJ, MoveL))]
    assert speeds[:-1] == pytest.approx([1000, 500, 1000, 30, 50.8, 30, 15])
    assert list_faults(reading) == [(13, "a joint motion wants its SPEED in percent")]


def test_a_motion_stops_without_continuous_path_and_before_a_frame_changes() -> None:
    reading = read_lines(
        "MOVE TRANS(1)",
        "DISABLE CP",
        "MOVE TRANS(2)",
        "ENABLE CP",
        "MOVE TRANS(3)",
        "BASE",
        "MOVE NULL",
    )
    assert [m.blend > 0 for m in reading.body if isinstance(m, MoveJ)] == [True, False, False, True]
    assert list_faults(reading) == []


def test_here_is_the_position_and_dest_the_last_target() -> None:
    reading = read_lines(
        "MOVE TRANS(1)", "SET a = DEST", "BREAK", "MOVE HERE:TRANS(,5)", "MOVE a", "SET b = HERE"
    )
    assert list_origins(reading) == [(1, 0, 0), (1, 5, 0), (1, 0, 0)]
    assert list_faults(reading) == [
        (7, "HERE while the robot may still move: BREAK is missing before it")
    ]


def test_targets_in_several_frames_are_given_in_the_base() -> None:
    reading = read_lines(
        "SET f = TRANS(10)",
        "SET g = TRANS(,10)",
        "MOVE f:TRANS(1)",
        "MOVE g:TRANS(1)",
        "MOVE TRANS(5)",
    )
    assert list_origins(reading) == [(11, 0, 0), (1, 10, 0), (5, 0, 0)]
    assert reading.work is not None
    assert reading.work.origin == (0, 0, 0)
    mixed = read_lines(
        "SET f = TRANS(10)", "MOVE f:TRANS(1)", "MOVE w:TRANS(1)", declare=False, work="w"
    )
    assert list_faults(mixed) == [
        (4, "the frames of the targets differ, and location w is only on the controller")
    ]


def test_a_program_calls_others_of_its_text_or_of_another() -> None:
    sub = ".PROGRAM sub()\nAUTO f\nSET f = TRANS(5)\nMOVE f:NULL\nBREAK\n.END\n"
    text = f"; remark\n.PROGRAM main()\nCALL sub()\nCALL sub()\nMOVE f:NULL\n.END\n\n{sub}"
    reading = read({"a": text}, {})
    assert list_faults(reading) == [(5, "location F is not defined")]
    assert reading.lines == (11, 11)
    split = read({"a": text[: text.index(".PROGRAM sub")], "b": sub}, {})
    assert (split.lines, list_faults(split)) == (reading.lines, list_faults(reading))


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        (["MOVED TRANS(1)"], (2, "unknown statement MOVED")),
        (["JMOVE #[1,2,3]"], (2, "unknown statement JMOVE")),
        (["MOVES wf:TRANS(1)"], (2, "location WF is not defined")),
        (["AUTO a", "MOVE a"], (3, "location A is not defined")),
        (["MOVE #p"], (2, "precision point #P is not defined")),
        (
            ["SET contour_segment_1 = NULL", "SET contour_segment_2 = NULL"],
            (3, "contour_segment_2 and contour_segment_1 are one name: only 15 characters count"),
        ),
        (
            ["MOVE TRANS(1)", "SIGNAL 33"],
            (3, "an output while the robot may still move: BREAK is missing before it"),
        ),
        (
            ["MOVE NULL", "WAIT.EVENT , 1"],
            (3, "a dwell while the robot may still move: BREAK is missing before it"),
        ),
        (
            ["MOVE NULL", "DETACH ()"],
            (3, "DETACH while the robot may still move: BREAK is missing before it"),
        ),
        (
            ["DELAY 0.5"],
            (2, "DELAY is uncertain: it delays the next motion; WAIT.EVENT , s is a dwell"),
        ),
        (["WAIT 0.5"], (2, "WAIT is not evaluated")),
        (["WAIT.EVENT 1"], (2, "WAIT.EVENT with an event is not evaluated")),
        (
            ["IF SIG(1001) THEN", "MOVE TRANS(1)", "ELSE", "MOVE TRANS(2)", "END"],
            (2, "IF is not evaluated"),
        ),
        (["WHILE TRUE DO", "MOVE TRANS(1)", "END"], (2, "WHILE is not evaluated")),
        (["DO", "MOVE TRANS(1)", "UNTIL TRUE"], (2, "DO is not evaluated")),
        (["CASE x OF", "VALUE 1:", "MOVE TRANS(1)", "END"], (2, "CASE is not evaluated")),
        (["GOTO 100"], (2, "GOTO is not evaluated")),
        (["DRIVE 1, 90, 50"], (2, "DRIVE is not evaluated")),
        (["END"], (2, "END closes nothing")),
        (["FOR i = 1 TO 3"], (2, "FOR is not closed")),
        (["FOR i = 1 TO 3 STEP 0", "MOVE NULL", "END"], (2, "a loop with step 0")),
        (["SPEED 0 ALWAYS"], (2, "a speed must be positive")),
        (["SPEED 10 MMPS IPS"], (2, "SPEED cannot end with MMPS IPS")),
        (["SIGNAL 1001"], (2, "1001 is not an output")),
        (["SIGNAL 0"], (2, "0 is not an output")),
        (["SIGNAL 33.5"], (2, "33.5 is not an output")),
        (["BASE 0, 0, 10"], (2, "BASE moves the world frame, which is not evaluated")),
        (["CALL other()"], (2, "program other is not in this text")),
        (["CALL t()"], (2, "more than 20 programs call each other")),
        (["SET tool = NULL"], (2, "tool is a word of V+")),
        (["a = 1", "SET a = NULL"], (3, "a is used as a real and as a location")),
        (["a = ."], (2, "a number expected instead of '.'")),
        (["a = ²"], (2, "a number expected instead of '²'")),
        (["a = 1/0"], (2, "a division by zero")),
        (["a = 1E30*1E30"], (2, "a number is not finite or beyond any machine")),
        (["a = " + "(" * 60 + "1" + ")" * 60], (2, "brackets are nested too deeply")),
        (["MOVE TRANS(1,2"], (2, ") expected before the end of the line")),
        (["MOVE TRANS(1 2)"], (2, ") expected before 2")),
        (["MOVE TRANS(1,2,3,4,5,6,7)"], (2, "TRANS has 7 arguments")),
        (["MOVE #PPOINT(1,2)"], (2, "#PPOINT has 2 values, not 4 or 6")),
        (["MOVES #PPOINT(1,2,3,4)"], (2, "a straight motion to joint values is not evaluated")),
        (["DEPART 5"], (2, "DEST is not known here")),
        (["MOVE FRAME(a,b,c,d)"], (2, "FRAME is not evaluated")),
        (["MOVE NULL", "BREAK", "TOOL TRANS(1)"], (4, "the tool changes between motions")),
        (["ATTACH ()", "AUTO a"], (3, "AUTO after the first instruction")),
        (["70000 BREAK"], (2, "label 70000 is above 65535")),
        (["ACCEL (" + "9" * 5000 + ") 1"], (2, "a number is not finite or beyond any machine")),
        (["; Größe"], (2, "a character that is not ASCII")),
        (['TYPE "open'], (2, "a string that does not end")),
        ([".LOCATIONS", "p 1 2 3", ".END"], (2, ".LOCATIONS before the .END of t")),
        ([".PROGRAM u()", "RETURN"], (2, ".PROGRAM before the .END of t")),
    ],
)
def test_a_wrong_statement_is_a_fault_in_its_line(
    lines: list[str], expected: tuple[int, str]
) -> None:
    reading = read_lines(*lines)
    assert expected in list_faults(reading)
    # No statement of a block that is not evaluated is executed.
    assert not lines[0].startswith(("IF", "WHILE", "DO", "CASE")) or reading.body == ()


def list_remarks(text: str, options: dict[str, object]) -> list[tuple[int, str]]:
    return [(f.line, f.what) for f in read({"a": text}, options).findings if f.level == "unusual"]


def test_a_word_after_the_end_of_a_loop_is_unusual() -> None:
    text = ".PROGRAM a()\nFOR i = 1 TO 2\nEND i\n.END\n"
    assert (3, "END stands alone, without i") in list_remarks(text, {})


def test_speed_and_posture_have_to_be_stated_again_after_a_call() -> None:
    """Whether a CALL or its RETURN keeps them is not confirmed."""
    head = [
        "AUTO cg.work",
        "SELECT ROBOT = 1",
        "ATTACH ()",
        "ENABLE CP",
        "ACCEL (0) 100, 100",
        "TOOL NULL",
        "RIGHTY",
    ]
    sub = ".PROGRAM sub()\nAUTO cg.work\nSET cg.work = NULL\n{}MOVES cg.work:NULL\nBREAK\n.END\n"
    main = "\n".join(
        [".PROGRAM main()", *head, "SPEED 20 MMPS ALWAYS", "CALL sub()", "{}DETACH ()", ".END\n"]
    )
    again = "SPEED 20 MMPS ALWAYS\nRIGHTY\n"
    assert list_remarks(main.format("") + sub.format(again), {}) == []
    speed = "no SPEED since a CALL or its RETURN: whether that keeps the speed is not confirmed"
    posture = (
        "RIGHTY not set since a CALL or its RETURN: whether that keeps the posture is not confirmed"
    )
    assert list_remarks(main.format("") + sub.format(""), {}) == [(16, speed), (16, posture)]
    after = main.format("MOVES TRANS(1)\nBREAK\n") + sub.format(again)
    assert list_remarks(after, {}) == [(11, speed), (11, posture)]


def test_tool_and_frame_on_the_controller_have_the_names_of_the_options() -> None:
    options: dict[str, object] = {"declare": False}
    text = "\n".join(
        [
            ".PROGRAM t()",
            "SELECT ROBOT = 1",
            "ATTACH ()",
            "ENABLE CP",
            "ACCEL (0) 100, 100",
            "TOOL cg.tool",
            "MOVE cg.work:NULL",
            "BREAK",
            "DETACH ()",
            ".END\n",
        ]
    )
    assert list_remarks(text, options) == []
    assert list_remarks(text.replace("TOOL cg.tool", "TOOL cg.work"), options) == [
        (1, "the tool is cg.work, not cg.tool as post.tool has it")
    ]
    assert list_remarks(text.replace("cg.work", "cg.tool"), options) == [
        (7, "a target in cg.tool, not in cg.work as post.work has it")
    ]


def test_an_arm_of_four_axes_cannot_tilt_its_flange() -> None:
    """A tool that is bent by 30 deg may be tilted. A frame on the controller is not judged."""
    frames = [
        "SET t = TRANS(0,0,100,0,30,0)",
        "TOOL t",
        "SET wf = TRANS(300,0,0,90,0,0)",
        "MOVE #PPOINT(0,45,50,0)",
    ]
    upright = read_lines(*frames, "MOVE wf:TRANS(1,2,3,0,150,180)", "MOVE TRANS(1,2,3,40,150,180)")
    assert list_faults(upright) == []
    tilted = read_lines(
        *frames, "MOVE wf:TRANS(1,2,3,0,180,180)", "MOVES wf:TRANS(1,2,3,0,150.1,180)"
    )
    tilt = "deg from straight down, which an arm of four axes cannot take"
    assert list_faults(tilted) == [(6, f"the flange 30 {tilt}"), (7, f"the flange 0.1 {tilt}")]
    assert list_faults(read_lines(*frames[2:], "MOVE wf:TRANS(1,2,3,0,90,0)")) == []
    six = ["MOVE #PPOINT(0,45,50,0,0,0)", "FLIP", "MOVE wf:TRANS(1,2,3,0,90,0)"]
    assert list_faults(read_lines(*frames[:3], *six)) == []


def test_a_robot_moves_only_while_it_is_attached() -> None:
    lines = ["MOVE NULL", "BREAK", "DETACH ()", "ATTACH ()", "MOVE NULL", "BREAK", "DETACH ()"]
    assert list_faults(read_lines(*lines)) == []
    assert list_faults(read_lines(*(line for line in lines if line != "ATTACH ()"))) == [
        (5, "a motion after DETACH: the robot is not attached to this program")
    ]
    rows = ["SET wf = NULL", "DETACH ()", *(f"MOVES wf:TRANS({k},0,0,0,180,180)" for k in range(3))]
    assert [line for line, _ in list_faults(read_lines(*rows))] == [4]


def test_a_label_belongs_to_its_program() -> None:
    sub = ".PROGRAM sub()\n10 BREAK\n20 BREAK\n.END\n"
    assert list_faults(read({"a": f".PROGRAM main()\n10 CALL sub()\n.END\n{sub}"}, {})) == []
    assert list_faults(read_lines("10 BREAK", "BREAK", "10 BREAK")) == [
        (4, "label 10 is there twice")
    ]


def test_a_text_that_is_not_made_of_programs_has_faults() -> None:
    assert list_faults(read({"a": ".PROGRAM a()\nBREAK\n"}, {})) == [(2, "a has no .END")]
    assert list_faults(read({"a": "MOVE NULL\n"}, {}))[0] == (
        1,
        "an instruction outside of a .PROGRAM",
    )
    assert list_faults(read({"a": ""}, {})) == [(1, "there is no .PROGRAM")]
    assert list_faults(read({}, {})) == [(1, "there is no .PROGRAM")]
    twice = ".PROGRAM a()\n.END\n.PROGRAM A()\n.END\n.PROGRAM b()\n.END\n"
    assert list_faults(read({"a": twice}, {})) == [
        (3, "program A is there twice"),
        (5, "program b is called by no other and not evaluated"),
    ]


def test_each_kind_of_line_end_counts_as_one_line() -> None:
    reading = read({"a": ".PROGRAM a()\r\n\r; x\rMOVE NULL\n\nHALT\r\n.END\r\n"}, {})
    assert (reading.lines, list_faults(reading)) == ((4,), [(6, "HALT is not evaluated")])


def test_a_program_with_too_many_iterations_is_a_fault() -> None:
    loop = ["FOR i = 1 TO 900000", "FOR j = 1 TO 900000", "a = i*j", "END", "END"]
    _, what = list_faults(read_lines(*loop))[-1]
    assert what == "the loops of this program do not come to an end"


def test_the_fast_path_and_the_general_parser_read_the_same() -> None:
    _, text = render(long_program(300, "a"))
    fast, general = read({"a": text}, {}), read({"a": re.sub(r"(MOVES .*)\)", r"\1+0)", text)}, {})
    assert fast.findings == ()
    assert list_values(fast, False) == list_values(general, False)


@pytest.mark.parametrize(
    "statement", ["BREAK", "SPEED", "SIGNAL", "WAIT.EVENT", "MOVES", "TOOL", "SET cg.work"]
)
def test_a_text_without_one_of_its_lines_does_not_verify(statement: str) -> None:
    """Without a line that moves the machine there is a fault, or the comparison fails."""
    source = program(
        HOME,
        MoveJ(down(1, 2, 9), 120),
        MoveL(down(1, 2, 0), 20),
        Output("process", 1),
        Wait(1),
        MoveL(down(9, 2, 0), 30, 1.0),
        MoveL(down(9, 9, 0), 20),
        Output("process", 0),
        HOME,
    )
    prepared, text = render(source)
    lines = text.splitlines()
    rows = [i for i, line in enumerate(lines) if line.strip().startswith(statement)]
    assert rows
    for i in rows:
        reading = read({"a": "\n".join(lines[:i] + lines[i + 1 :])}, {})
        if statement == "TOOL":
            assert reading.tool is None
        elif not reading.findings:
            with pytest.raises(AssertionError):
                assert_same(prepared, reading)


GOOD = BRACKET + (
    ".PROGRAM x()\nFOR i = 1 TO 3\nAPPRO p:RX(i*2), 5\nSHIFT(p BY 1,2)\nEND\nIF a THEN\nEND\n.END\n"
)
PIECES = [
    "",
    " ",
    "(",
    ")",
    ",",
    ":",
    ";",
    '"',
    "=",
    "#",
    "$",
    ".",
    "-",
    "1e99",
    "9" * 30,
    "\n",
    "\r",
    "\x00",
    "é",
    "\t",
]
PIECES += [
    ".END\n",
    "TRANS(",
    "FOR ",
    "END\n",
    "CALL x()\n",
    "IF ",
    "HERE",
    "NULL",
    "INVERSE(",
    "SET ",
    "AUTO ",
]
EDITS = st.lists(
    st.tuples(
        st.integers(0, len(GOOD)), st.integers(0, 40), st.sampled_from(PIECES) | st.text(max_size=3)
    ),
    min_size=1,
    max_size=6,
)


@fewer(15)
@given(EDITS)
def test_a_changed_program_is_read_without_an_exception(edits: list[tuple[int, int, str]]) -> None:
    text = GOOD
    for at, cut, piece in edits:
        text = text[:at] + piece + text[at + cut :]
    reading = read({"a": text}, {})
    last = len(re.split(r"\r\n|\r|\n", text))
    assert all(1 <= f.line <= last and f.what.isprintable() for f in reading.findings)
    assert len(reading.lines) == len(reading.body)
    assert all(1 <= line <= last for line in reading.lines)
    for item in reading.body:
        if isinstance(item, (MoveJ, MoveL)) and isinstance(item.target, Pose):
            assert np.isfinite(item.target.rotation).all()


@given(st.text(max_size=200))
def test_any_text_that_is_not_a_program_is_a_fault(text: str) -> None:
    assert read({"a": text}, {}).findings


SHARED = Path(__file__).parents[2].parent / "shared" / "data" / "robot"


@pytest.mark.parametrize("name", ["Prog1.pg", "Kawasaki.pg", "Program.mod"])
def test_a_program_of_another_controller_has_faults(name: str) -> None:
    paths = sorted(SHARED.glob(f"*/{name}"))
    if not paths:
        pytest.skip(f"{name}: the folder shared/data/robot is not there")
    reading = read({name: paths[0].read_text(encoding="utf-8")}, {})
    assert any(
        "unknown statement" in f.what or "outside of a .PROGRAM" in f.what for f in reading.findings
    )
