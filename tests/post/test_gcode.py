import math
import random
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from camgen.geometry.arcs import compute_circle
from camgen.lang.programs import Finding, find_language
from camgen.model.errors import JobError, Refused
from camgen.model.pose import Pose, frozen, pose_from_values, rotation_from_fixed_xyz
from camgen.model.program import Comment, Force, Joints, MoveC, MoveJ, MoveL, Output, Stop, Wait
from camgen.post.kit import Case, cases, check_case
from camgen.post.plugins import find_post, find_readback, make_post
from tests.post.changes.gcode import TEXT
from tests.support.examples import fewer
from tests.support.fast_paths import list_values
from tests.support.rs274 import (
    assert_moves,
    at,
    difference,
    moves,
    needs_rs274,
    posted,
    program,
    programs,
    run,
)

DATA = Path(__file__).parents[2].parent / "shared" / "data" / "gcode"
UNSAID = "not set before the first motion: the program before may have left it otherwise"
SLOW = settings(suppress_health_check=[HealthCheck.too_slow])
S = 10 / math.sqrt(2)


#: The modes that a program says before it moves.
SAFE = "G17 G21 G40 G54 G80 G90 G91.1 G94"


def gcode(**options):
    return make_post(find_post("gcode"), options)


def read(text, **options):
    return find_readback("gcode")({"part.ngc": text}, options)


def faults(*lines, **options):
    """The faults of lines between a lead of two and the end."""
    text = "\n".join([f"{SAFE} G64 P0.01 Q0", "G0 Z5", "G0 X0 Y0", *lines, "M2", ""])
    return [(fault.line - 3, fault.what) for fault in read(text, **options).findings]


# A quarter circle about (45, 15) from (45, 5), another back to (45, 25), both counter-clockwise.
PART = program(
    Output("spindle", 12000.0),
    Wait(1.5),
    MoveJ(at(5, 5, 10), 100.0),
    MoveL(at(5, 5, -1.5), 2.0),
    Output("process", 1.0),
    MoveL(at(45, 5, -1.5), 10.0, 1.0),
    MoveC(at(45 + S, 15 - S, -1.5), at(55, 15, -1.5), 10.0, 1.0),
    MoveC(at(45 + S, 15 + S, -1.5), at(45, 25, -1.5), 10.0),
    MoveL(at(5, 5, -1.5), 100 / 3),
    Output("process", 0.0),
    Comment("lift"),
    MoveL(at(5, 5, 10), 100 / 3),
    Output("spindle", 0.0),
    MoveJ(at(0, 0, 50), 100.0),
    header=("part bracket.dxf",),
)


def test_the_page_of_the_post_shows_this_text():
    page = Path(__file__).parents[2] / "docs" / "posts" / "gcode.md"
    assert f"```\n{TEXT}```" in page.read_text()


def test_text_of_a_part():
    ready, text = posted(gcode(), PART)
    assert text == TEXT
    assert ready is PART


@pytest.mark.parametrize(("stop", "word"), [(Stop(), "M0"), (Stop(optional=True), "M1")])
def test_a_stop_waits_for_the_operator_and_is_read_back(stop, word):
    ready, text = posted(
        gcode(), program(MoveJ(at(5, 5, 10), 100.0), stop, MoveL(at(5, 5, 5), 2.0))
    )
    assert f"\n{word}\n" in text
    assert difference(ready, read(text), gcode().tolerance()) == ""


def test_options_of_the_preamble():
    _, text = posted(gcode(work="G59.3", tool=1, path_tolerance=0.0, decimals=2), PART)
    modes = ["G17 G21 G40 G59.3 G80 G90 G94", "G91.1", "G61"]
    assert text.splitlines()[3:12] == [*modes, "M5", "M65 P0", "G53 G0 Z0", "G49", "T1 M6", "G43"]
    assert not read(text, work="G59.3", tool=1, path_tolerance=0.0, decimals=2).findings


def test_without_lift_the_first_height_is_that_of_the_home_position():
    _, text = posted(gcode(lift=False), PART)
    assert text.splitlines()[5:11] == ["G64 P0.01 Q0", "M5", "M65 P0", "G49", "G0 Z50", "G0 X0 Y0"]
    assert not read(text, lift=False).findings


#: A program that leaves the length of its tool on, 30 mm, and stands low.
BEFORE = "G21 G90 G40\nT1 M6\nG43\nG0 X70 Y80 Z2\n"
LONG_TOOL = "T1 P1 Z30 D3.0 ;cutter\n"


@needs_rs274
def test_linuxcnc_cancels_a_length_that_is_on_at_the_top_of_the_machine():
    """No motion before the known position is lower than the tool stood; without the lift the first height is wrong."""
    ready, text = posted(gcode(), PART)
    canon = run(BEFORE + text, LONG_TOOL)
    assert canon.error == ""
    start, top, across, home = [call for call in canon.calls if call.kind == "STRAIGHT_TRAVERSE"][
        :4
    ]
    assert start.end == (70, 80, 2)
    # With the length on, the machine's own zero is as far below in the work frame as the tool is long.
    assert top.end[:2] == (70, 80)
    assert top.end[2] < -29
    assert across.end == (0, 0, 0)
    assert home.end == (0, 0, 50)
    assert canon.names.index("USE_TOOL_LENGTH_OFFSET") < canon.names.index("STRAIGHT_FEED")
    assert_moves(ready, run(text, LONG_TOOL))


@needs_rs274
@pytest.mark.parametrize(
    ("before", "refused"),
    [("G91\n", True), ("G91 ", True), ("", False), ("G90 ", False), ("G91\nG90 ", False)],
)
def test_reader_and_linuxcnc_agree_on_machine_coordinates(before, refused):
    """LinuxCNC refuses G53 among increments, also those of its own line, and takes it else."""
    text = f"G21 G61\n{before}G53 G0 Z0\nG49 G90\nG0 X1 Y2\nG0 Z3\nM2\n"
    canon = run(text)
    assert bool(canon.error) == refused
    found = [f.what for f in read(text).findings if f.level != "unusual"]
    assert found[:1] == (["G53 among increments (G91)"] if refused else [])
    if not refused:
        (home,) = read(text).body
        (reached,) = moves(canon)
        assert home.target.origin == reached.end == (1, 2, 3)


@pytest.mark.parametrize(
    ("line", "options", "says"),
    [
        (
            "G53 G0 Z0",
            {"lift": False},
            "G53 has sent the tool to the machine's zero of Z, but post.lift is false",
        ),
        ("G53 G0 Z5", {}, "G53 is not read: goes to machine coordinates, which are not known here"),
        (
            "G53 G0 X0 Z0",
            {},
            "G53 is not read: goes to machine coordinates, which are not known here",
        ),
        (
            "G53 G1 Z0 F100",
            {},
            "G53 is not read: goes to machine coordinates, which are not known here",
        ),
        ("G49", {}, "G49 lowers the next height by a tool length that is on; G53 G0 Z0 first"),
        ("", {}, "X or Y moves while Z is not known; read as from 0"),
    ],
)
def test_the_lift_of_the_options_is_held_against_the_text(line, options, says):
    text = f"{SAFE} G64 P0.01 Q0\n{line}\nG49\nG0 X1 Y2\nG0 Z3\nM2\n"
    assert says in [f.what for f in read(text, **options).findings]
    assert not read(text.replace(f"\n{line}\n", "\nG53 G0 Z0\n", 1)).findings


def test_a_clockwise_arc_is_g2():
    plan = program(MoveL(at(10, 0, 0), 10.0), MoveC(at(S, -S, 0), at(0, -10, 0), 10.0))
    assert "G2 X0 Y-10 I-10 J0" in posted(gcode(), plan)[1]


def test_arcs_can_be_left_to_chords():
    ready, text = posted(gcode(arcs=False), PART, chord=0.5)
    assert "G3" not in text
    # Two quarters of r = 10 within 0.5 mm: 2 acos(1 - 0.05) = 36.4 deg a chord, three for each.
    assert sum(isinstance(item, MoveL) for item in ready.body) == 4 + 6


@pytest.mark.parametrize(
    ("via", "target"),
    [
        ((5.0, 0.0, 5.0), (10.0, 0.0, 0.0)),  # upright
        ((0.02, 0.02, 0.0), (0.04, 0.0, 0.0)),  # r = 0.02
        ((5.0, 0.0004, 0.0), (10.0, 0.0, 0.0)),  # leaves its chord by 0.4 of a digit
        ((5.0, 5.0, 0.0), (10.0, 0.0, 2.0)),  # tilted
        ((10.0, 10.0, 0.0), (3e-4, 0.0, 0.0)),  # ends where it starts
    ],
)
def test_arcs_that_the_machine_lacks_become_chords(via, target):
    plan = program(MoveL(at(0, 0, 0), 10.0), MoveC(at(*via), at(*target), 10.0))
    ready, text = posted(gcode(), plan)
    assert not {"G2", "G3"} & set(text.split())
    assert difference(ready, read(text), gcode().tolerance()) == ""


def test_shallow_arcs_keep_their_radius():
    # 5 mm chords of r = 1000: sagitta 0.003 mm, where three points of three digits tell nothing.
    step = 0.005
    points = [
        (1000 * math.sin(a), 1000 - 1000 * math.cos(a)) for a in (step * k / 2 for k in range(9))
    ]
    arcs = [MoveC(at(*points[k - 1], 0), at(*points[k], 0), 10.0) for k in range(2, 9, 2)]
    _, text = posted(gcode(), program(MoveL(at(0, 0, 0), 10.0), *arcs))
    centres = [line.split()[3:5] for line in text.splitlines() if line.startswith("G3")]
    assert len(centres) == 4
    for i, j in centres:
        assert abs(math.hypot(float(i[1:]), float(j[1:])) - 1000) < 1.0


def test_a_motion_without_change_keeps_one_word():
    plan = program(
        MoveL(at(1, 2, 3), 10.0), MoveL(at(1.0001, 2, 3), 10.0), MoveJ(at(1, 2, 3), 10.0)
    )
    _, text = posted(gcode(), plan)
    assert text.splitlines()[-4:] == ["G1 X1 Y2 Z3 F600", "G1 X1", "G0 X1", "M2"]
    assert len(read(text).body) == 4


@pytest.mark.parametrize(
    ("speed", "word"),
    [
        (10.0, "F600"),
        (100 / 3, "F2000"),
        (1 / 3, "F20"),
        (0.001, "F0.06"),
        (0.00123456, "F0.07407"),
        (1e4, "F600000"),
    ],
)
def test_feeds_within_a_thousandth(speed, word):
    _, text = posted(gcode(), program(MoveL(at(1, 0, 0), speed)))
    assert word in text.split()
    assert abs(float(word[1:]) - speed * 60) < 1e-3 * speed * 60


# What is refused.


@pytest.mark.parametrize(
    ("plan", "index", "says"),
    [
        (
            program(MoveJ(Joints((0.0,) * 6), 10.0)),
            1,
            "has no joint values to move to; give the home position as a pose",
        ),
        (
            program(MoveL(Pose(rotation_from_fixed_xyz(math.pi - 0.1, 0, 0), (0, 0, 0)), 10.0)),
            1,
            "the tool is not straight down, and the machine has three axes; use a robot's post or no axis tilt",
        ),
        (program(MoveL(at(1e6, 0, 0), 10.0)), 1, "a coordinate is beyond 99999 mm"),
        (
            program(MoveL(at(1, 0, 0), 1e-5)),
            1,
            "a feed of 0.0006 mm/min is not 0.01 to 999999 mm/min; "
            "change process.feed or process.plunge",
        ),
        (
            program(Output("flood", 1.0)),
            0,
            'signal flood has no output (known: spindle, process); give it one in post.signals, e.g. { flood = "M8" }',
        ),
        (
            program(Output("glue", 1.0)),
            0,
            "signal glue has no output (known: spindle, process); give it one in post.signals",
        ),
        (program(Output("process", 0.5)), 2, "signal process is on (1) or off (0), not 0.5"),
        (
            program(Output("spindle", -100.0)),
            2,
            "the spindle is to turn backwards (M4, 100 rpm), and this post prints M3 alone",
        ),
        (program(Wait(1e9)), 1, "a wait of 1e+09 s is longer than 99999 s"),
        (
            program(Force(10.0, (1.0, 0.0, 0.0)), MoveL(at(1, 0, 0), 10.0), Force(0.0)),
            0,
            'G-code has no force control; set process.force = 0 or post.force = "ignore"',
        ),
        (
            program(MoveC(at(1, 1, 50), at(2, 2, 50), 10.0)),
            1,
            "the three points of the arc are on one line",
        ),
    ],
)
def test_refusals_name_index_and_remedy(plan, index, says):
    with pytest.raises(Refused) as caught:
        gcode().prepare(plan, 0.01)
    assert says in str(caught.value)
    assert caught.value.index == index
    assert "\n" not in str(caught.value)


def test_the_turn_of_the_tool_about_itself_does_not_matter():
    turned = Pose(frozen([[0.6, 0.8, 0.0], [0.8, -0.6, 0.0], [0.0, 0.0, -1.0]]), (1.0, 2.0, 3.0))
    assert "G1 X1 Y2 Z3 F600" in posted(gcode(), program(MoveL(turned, 10.0)))[1]


def test_a_turned_work_frame_is_refused():
    plan = replace(PART, base_from_work=pose_from_values([10, 20, 30, 0, 0, 5]))
    with pytest.raises(
        Refused, match="G54 cannot turn the work frame; align the part with the axes"
    ):
        gcode().prepare(plan, 0.01)
    shifted = replace(PART, base_from_work=pose_from_values([10, 20, 30, 0, 0, 0]))
    assert posted(gcode(), shifted)[1] == TEXT


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"work": "G53"}, "'G53' is not a work offset"),
        ({"decimals": 1}, "not between 2 and 6"),
        ({"tool": -1}, "not a tool number"),
        (
            {"path_tolerance": 0.00001},
            "without a tolerance LinuxCNC would round corners by any amount",
        ),
        ({"path_tolerance": -1.0}, "is not 0.0001 to 10 mm"),
        ({"path_tolerance": math.nan}, "is not 0.0001 to 10 mm"),
        (
            {"signals": {"process": "P0\nG0 Z-99"}},
            "is not an output of this controller; one of M7 to P63",
        ),
        ({"signals": {"process": "P64"}}, "is not an output"),
        ({"signals": {"process": "M3"}}, "is not an output"),
        ({"signals": {"spindle": "P1"}}, "is not a free name"),
        ({"signals": {"a": "P1", "b": "P1"}}, "P1 is switched off by another signal too"),
        ({"signals": {"a": "M7", "b": "M8"}}, "M7 is switched off by another signal too"),
        ({"force": "analog"}, "analog force needs the output's value per N"),
        ({"force": "analog", "force_scale": 0.1, "force_channel": 64}, "must be 0 to 63, not 64"),
        ({"max_lines": -1}, "must be 0 or more, not -1; 0: the program is not split"),
    ],
)
def test_options_that_cannot_be_meant(options, says):
    with pytest.raises(JobError) as caught:
        gcode(**options)
    assert says in str(caught.value)


# Force.

PRESSED = program(
    MoveL(at(0, 0, 0), 10.0),
    Force(10.0, (1.0, 0.0, 0.0)),
    MoveL(at(10, 0, 0), 10.0, 1.0, 10.0, (1.0, 0.0, 0.0)),
    MoveL(at(20, 0, 0), 10.0, 0.0, 12.5, (1.0, 0.0, 0.0)),
    MoveL(at(30, 0, 0), 10.0),
    Force(0.0),
    MoveL(at(30, 0, 9), 10.0),
)


def test_force_as_an_analog_output():
    options = {"force": "analog", "force_channel": 1, "force_scale": 0.2}
    ready, text = posted(gcode(**options), PRESSED)
    assert text.splitlines()[-10:-1] == [
        "G1 Z0 F600",
        "M68 E1 Q2",
        "G1 X10",
        "M67 E1 Q2.5",
        "G1 X20",
        "M67 E1 Q0",
        "G1 X30",
        "M68 E1 Q0",
        "G1 Z9",
    ]
    assert difference(ready, read(text, **options), gcode(**options).tolerance()) == ""
    assert Output("E1", 2.0) in read(text).body


def test_force_left_out_by_the_user():
    ready, text = posted(gcode(force="ignore"), PRESSED)
    assert not any(isinstance(item, Force) for item in ready.body)
    assert "Q2" not in text
    assert difference(ready, read(text, force="ignore"), gcode().tolerance()) == ""


def test_a_force_too_small_to_print_is_refused():
    plan = program(Force(0.01, (1.0, 0.0, 0.0)), MoveL(at(1, 0, 0), 10.0), Force(0.0))
    with pytest.raises(
        Refused, match=r"0\.01 N is 0 at post\.force_scale = 0\.001; raise the scale"
    ):
        gcode(force="analog", force_scale=0.001).prepare(plan, 0.01)


#: Remarks; and the last digit of a centre, since an arc may be off by six times half a digit.
MEANINGLESS = (r"\(.*\)", r"[IJ]-?\d+\.\d\d(\d)")


@pytest.mark.parametrize("case", cases(), ids=str)
@pytest.mark.parametrize(
    "force",
    [{"force": "ignore"}, {"force": "analog", "force_scale": 0.1}],
    ids=["ignore", "analog"],
)
def test_conformance(case: Case, force):
    signals = {name: f"P{n}" for n, name in enumerate(("process", "glue", "vacuum", "air"))}
    post, lacks = find_post("gcode"), {"joints", "tilt", "signals", "large", "split"}
    options = {"signals": signals, **force}
    check_case(post, find_language("gcode"), case, options, lacks, MEANINGLESS)


# The outside judge.


@needs_rs274
@pytest.mark.parametrize("options", [{}, {"tool": 1}, {"path_tolerance": 0.0}, {"lift": False}])
def test_linuxcnc_moves_as_planned(options):
    ready, text = posted(gcode(**options), PART)
    canon = run(text)
    assert canon.error == ""
    assert_moves(ready, canon)
    switches = [
        (c.kind, c.value) for c in canon.calls if not c.kind.startswith(("STRAIGHT", "ARC"))
    ]
    stops = [("STOP_SPINDLE_TURNING", 0.0)] if "tool" in options else []  # M6 stops the spindle
    assert switches == [
        ("STOP_SPINDLE_TURNING", 0.0),
        ("CLEAR_AUX_OUTPUT_BIT", 0.0),
        *stops,
        ("START_SPINDLE_CLOCKWISE", 12000.0),
        ("DWELL", 1.5),
        ("SET_AUX_OUTPUT_BIT", 0.0),
        ("CLEAR_AUX_OUTPUT_BIT", 0.0),
        ("STOP_SPINDLE_TURNING", 0.0),
        ("STOP_SPINDLE_TURNING", 0.0),  # M2 itself
    ]


@needs_rs274
def test_linuxcnc_presses_as_planned():
    canon = run(posted(gcode(force="analog", force_scale=0.2), PRESSED)[1])
    presses = [(i, c.kind, c.value) for i, c in enumerate(canon.calls) if "OUTPUT_VALUE" in c.kind]
    assert canon.error == ""
    assert presses == [
        (0, "SET_AUX_OUTPUT_VALUE", 0.0),
        (5, "SET_AUX_OUTPUT_VALUE", 2.0),
        (7, "SET_MOTION_OUTPUT_VALUE", 2.5),
        (9, "SET_MOTION_OUTPUT_VALUE", 0.0),
        (11, "SET_AUX_OUTPUT_VALUE", 0.0),
    ]


HOSTILE = [
    "MSG, stop",
    "DEBUG,#1",
    "print,x",
    " log,x",
    "PROBEOPEN a",
    "a) G0 Z-50 (b",
    "a\nG0 Z-50",
    "!~?%",
    "Größe ö\x18",
    "",
]


@needs_rs274
def test_hostile_comments_stay_comments():
    body = [Comment(text) for text in HOSTILE]
    plan = program(*body, MoveL(at(1, 0, 0), 10.0), name="p) M3 (x", header=("MSG, h",))
    ready, text = posted(gcode(), plan)
    assert text.isascii()
    assert not set(text) & set("!~?%")
    canon = run(text)
    assert canon.error == ""
    assert not {"MESSAGE", "LOG", "LOGOPEN"} & set(canon.names)
    assert_moves(ready, canon)
    assert difference(ready, read(text), gcode().tolerance()) == ""
    assert "(- MSG_ stop)" in text


@needs_rs274
@fewer(12, [HealthCheck.too_slow])
@given(programs())
def test_interpreter_readback_and_program_agree(plan):
    ready, text = posted(gcode(), plan)
    assert difference(ready, read(text), gcode().tolerance()) == ""
    canon = run(text)
    assert canon.error == ""
    assert_moves(ready, canon)
    bits = [c.kind == "SET_AUX_OUTPUT_BIT" for c in canon.calls if "OUTPUT_BIT" in c.kind]
    assert bits == [item.value == 1 for item in ready.body if isinstance(item, Output)]


def test_a_half_circle_of_two_decimals_stays_one_arc():
    """Rounded to G3 X-0.83 Y1.73 I-1 J0.005 from X1.17 Y1.73 it is half a circle and 0.01 rad."""
    plan = program(
        MoveJ(at(1.170746, 1.734613, 0), 10.0),
        MoveC(at(0.170746, 2.734613, 0), at(-0.829254, 1.734613, 0), 10.0),
    )
    post = gcode(decimals=2)
    ready, text = posted(post, plan)
    assert "G3 X-0.83 Y1.73 I-1 J0.005" in text
    assert difference(ready, read(text), post.tolerance()) == ""


@SLOW
@given(programs(), st.integers(2, 5))
def test_readback_is_the_inverse_of_the_post(plan, decimals):
    post = gcode(decimals=decimals)
    ready, text = posted(post, plan)
    assert difference(ready, read(text), post.tolerance()) == ""


# Reading back.


def test_instructions_know_their_lines():
    reading = read(TEXT)
    assert tuple(reading.lines) == (7, 8, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21, 22, 24, 25, 26)
    assert difference(PART, reading, gcode().tolerance()) == ""


def test_every_line_matters():
    """Without any one of its lines the text is not the program: comments, and G49 where G43 follows aside."""
    for options in ({}, {"tool": 1}, {"lift": False}):
        ready, text = posted(gcode(**options), PART)
        lines = text.splitlines()
        for k, line in enumerate(lines):
            if line.startswith("(") or (line == "G49" and "tool" in options):
                continue
            left = read("\n".join(lines[:k] + lines[k + 1 :]) + "\n", **options)
            assert difference(ready, left, gcode().tolerance()), line


@pytest.mark.parametrize("word", ["G17", "G40", "G54", "G80", "G90", "G91.1", "G94"])
@pytest.mark.parametrize("options", [{}, {"lift": False}], ids=["lift", "no lift"])
def test_a_mode_that_is_not_said_is_a_fault_of_our_program(word, options):
    """The program before may have been aborted in another one. A foreign text may rely on the machine's."""
    _, text = posted(gcode(**options), PART)
    left = (
        text.replace(f"{word} ", "", 1) if f"{word} " in text else text.replace(f"{word}\n", "\n")
    )
    first = next(k for k, line in enumerate(left.splitlines(), 1) if "G0 " in line)
    assert read(left, **options).findings == (Finding("unusual", first, f"{word} {UNSAID}"),)
    assert f"{word} not set" in difference(
        PART, read(left, **options), gcode(**options).tolerance()
    )


def test_the_outputs_of_the_machine_are_an_option():
    more = TEXT.replace("M65 P0", "M65 P6\nM65 P0", 1)
    assert [fault.line for fault in read(more).findings] == [8]
    assert not read(more, outputs=8).findings
    assert not read(TEXT.replace("P0\n", "P7\n"), signals={"process": "P7"}).findings
    assert not read(more, signals={"process": "P0", "glue": "P6"}).findings
    assert not read(
        TEXT.replace("M64 P0", "M64 P0\nM68 E7 Q1"),
        force="analog",
        force_scale=1.0,
        force_channel=7,
    ).findings
    with pytest.raises(JobError, match="65 is not 1 to 64"):
        gcode(outputs=65)


def test_the_exact_path_is_that_of_the_option():
    exact = posted(gcode(path_tolerance=0.0), PART)[1]
    assert not read(exact, path_tolerance=0.0).findings
    said = read(exact.replace("G61\n", "G61.1\n"), path_tolerance=0.0).findings
    assert said == (
        Finding(
            "unusual", 6, "G61.1 where post.path_tolerance asks for G61: corners take another time"
        ),
    )


@pytest.mark.parametrize("step", range(1, 10))
def test_every_digit_matters(step):
    passed = set()
    for k, character in enumerate(TEXT):
        line = TEXT.count("\n", 0, k)
        if character.isdigit() and not TEXT.splitlines()[line].startswith("("):
            other = TEXT[:k] + str((int(character) + step) % 10) + TEXT[k + 1 :]
            if not difference(PART, read(other), gcode().tolerance()):
                passed |= set(other.splitlines()[line].split()) - set(
                    TEXT.splitlines()[line].split()
                )
    # What these replace may be left out, or is said again; M62 switches with the motion that follows.
    assert passed <= {"G00", "G61.1", "G97", "G98", "G99", "M62", "M63"}


#: What is said of a line that is read by the interpreter of foreign programs.
FOREIGN = "a word that camgen does not write; the program is read as LinuxCNC runs it"


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("F9 G81 X1 Z-1 R2", FOREIGN),
        (
            "G10 L2 P1 X0",
            "G10 L2 moves G54 in X from 0; where it was, mm, is known to the machine alone; nothing "
            "from here on is read",
        ),
        ("G28", "G28 is not read: goes to a position that the machine stores"),
        ("G53 G0 Z0", "G53 is not read: goes to machine coordinates, which are not known here"),
        ("G93", FOREIGN),
        (
            "G41 D1",
            "G41 is not read: cutter compensation: the controller moves the path by the radius of the tool",
        ),
        ("M60", "M60 is not read: waits for the operator: a program here runs through"),
        ("M66 P0 L3 Q5", "M66 is not read: waits for an input"),
        ("G77", "G77 is not read: not a code that is known"),
        ("#1 = 5", FOREIGN),
        ("G0 X[1+2]", FOREIGN),
        ("O100 sub", "o100 sub has no end; nothing from here on is read"),
        ("G0 X1 X2", "word X twice in one line"),
        ("G0 G1 X1", "G0 and G1 are of one group (motion)"),
        ("M3 M5", "M3 and M5 are of one group (spindle)"),
        ("M7 M8", "M7 and M8 are of one group (coolant)"),
        ("G80 G1 X1 F9", "G80 and G1 are of one group (motion)"),
        ("F9 G98 G83 X1 Z1 R1 Q1", "G83 with pecks and no depth"),
        ("G1", "G1 without a feed (F)"),
        ("O100", "word O100: nothing in the line uses it"),
        ("G1 X1", "G1 without a feed (F)"),
        ("G1 X1 F0", "G1 without a feed (F)"),
        ("G1 X1 F-5", "feed F-5 is negative"),
        ("G0 X1e3", "word E3: nothing in the line uses it"),
        ("G0 A90", "word A90: nothing in the line uses it"),
        ("G0 X", "cannot read 'X'"),
        ("G0 X1,5", "cannot read ',5'"),
        ("G80 X1", "axis words without a motion code (G0, G1, G2, G3)"),
        ("G4", "G4 without its seconds (P)"),
        ("M3", "M3 without a speed (S)"),
        ("M64", "M64 without the number of its output"),
        ("M67 E0", "M67 without its value (Q)"),
        ("M62 P0", "an output that waits for the next motion (M62, M63, M67), and none follows"),
        ("G64", "G64 without P rounds corners by any amount"),
        ("G64 P0.5", "G64 may leave the path by 0.5, post.path_tolerance is 0.01"),
        ("G55", "G55: another work offset after the first motion is not read"),
        ("T1 M6", "tool 1 is changed to, and its length is not applied (G43 H1)"),
        ("G43", "G43 shifts z by the length of a tool, but post.tool is 0"),
        ("(open", "a comment that is not closed, or closed twice"),
        ("(a (b) )", "a comment that is not closed, or closed twice"),
        ("(DEBUG,#1)", "active comment '(DEBUG,#1)'"),
        ("/G0 X1", FOREIGN),
        ("N G0 X1", "N without a number"),
        ("%", "a per cent sign that does not belong to one on the first line"),
        ("G0 X1 ß", "a character that is not ASCII outside a comment"),
        ("G1 F100 X" + "0" * 250 + "1", "260 characters, LinuxCNC reads 252"),
        ("G0 X99999999", "word X99999999 is out of range"),
        ("F100 G2 X2", "arc without a centre or radius (I, J, K or R) in its plane"),
        ("F100 G2 X2 I1 R1", "R and a centre in one arc"),
        ("F100 G2 X2 R0.9", "R0.9 does not reach the end point"),
        ("F100 G2 X0 Y0 R2", "arc with R whose end is its start"),
        ("F100 G2 X2 I1 K1", "word K1: nothing in the line uses it"),
        ("F100 G2 X2 I1.02", "the radii of the arc differ by 0.0400 mm (start 1.0200, end 0.9800)"),
        ("F100 G2 X2 I0", "arc of no radius"),
        ("F100 G2 X0 I1 P1.5", "P1.5 is not a number of turns"),
        (
            "F100 G2 X0 I1 P99999",
            "an arc of more than 20,000 pieces is refused (limits.gcode_pieces)",
        ),
        ("G90.1 F100 G2 X2 I1", "an absolute centre (G90.1) needs both its words"),
    ],
)
def test_faults_name_line_and_word(line, says):
    assert (1, says) in faults(line)


def test_faults_of_the_whole_program():
    assert [(f.line, f.what) for f in read("G21\nG0 Z5\nG61\n").findings] == [
        (2, f"G17, G40, G80, G90, G91.1, G94, G54 {UNSAID}"),
        (2, "neither G49 nor G43 before the first motion: a tool length that is on shifts Z"),
        (2, "neither G61 nor G64 P before the first motion: corners may be rounded by any amount"),
        (3, "the program has no end (M2 or M30)"),
        (3, "the program ends before the position is known in all axes"),
        (3, "G61 where post.path_tolerance asks for G64 P0.01: corners take another time"),
    ]
    assert [
        (f.line, f.what)
        for f in read(
            "G17 G40 G54 G80 G90 G91.1 G94 G64 P0.01 Q0 G49\nG0 X1 Y1\nM2\nG0 X2\n"
        ).findings
    ] == [
        (1, "G49 lowers the next height by a tool length that is on; G53 G0 Z0 first"),
        (2, "a motion before G20 or G21; read as mm"),
        (2, "X or Y moves while Z is not known; read as from 0"),
        (4, "a line after the end of the program"),
    ]
    assert [f.what for f in read("").findings] == ["the program has no end (M2 or M30)"]


@pytest.mark.parametrize(
    ("lines", "says"),
    [
        (
            ["G61 G21", "G0 Z5", "G0 Z-5", "G0 X0 Y0"],
            "an axis moves again before the position is known in all axes",
        ),
        (
            ["G61 G21", "G0 Z5", "G1 X0 Y0 F10"],
            "a feed motion from a position that is not known; read as from 0",
        ),
        (
            ["G61 G21", "G91 G0 Z5"],
            "an incremental motion from a position that is not known; read as from 0",
        ),
        (["G61 G21 G55", "G0 X0 Y0 Z5"], "work offset G55, but post.work is G54"),
        (
            ["G61 G20 F10", "G0 X0 Y0 Z5"],
            "F in the line that changes the unit: controllers differ in which unit it has",
        ),
    ],
)
def test_faults_before_the_position_is_known(lines, says):
    assert says in [f.what for f in read("\n".join([*lines, "M2"])).findings]


def test_reading_goes_on_at_the_end_of_what_is_refused():
    text = (
        f"{SAFE} G64 P0.01 Q0 G49\nG0 Z5\nG0 X0 Y0\nF60 G2 X2 Y7 I1\nG1 X3 A9\nX4\nM2 P1\nG0 X9\n"
    )
    reading = read(text, lift=False)
    assert [(fault.line, fault.what.split(" (")[0]) for fault in reading.findings] == [
        (4, "the radii of the arc differ by 6.0711 mm"),
        (5, "word A9: nothing in the line uses it"),
        (7, "word P1: nothing in the line uses it"),
        (8, "a line after the end of the program"),
    ]
    assert [item.target.origin for item in reading.body] == [(0, 0, 5), (3, 7, 5), (4, 7, 5)]


@pytest.mark.parametrize("change", ["T2 M6 G55", "G55 T2 M6", "T2 M6\nG55", "T2 M6\nG43 H2 G55"])
def test_a_work_offset_that_changes_with_the_tool_is_a_fault(change):
    text = (
        f"{SAFE} G64 P0.01 Q0 G49\nT1 M6\nG43 H1\nG0 Z5\nG0 X0 Y0\n"
        "T2 M6\nG43 H2\nG0 Z5\nG0 X9 Y0\nM2\n"
    )
    assert not read(text, lift=False).findings
    changed = text.replace("T2 M6" if "H2" not in change else "T2 M6\nG43 H2", change)
    what = "G55: another work offset after the first motion is not read"
    assert what in [fault.what for fault in read(changed, lift=False).findings]


def test_the_length_of_the_tool_is_applied_once():
    text = posted(gcode(tool=1), PART)[1]
    late = text.replace("G43\n", "").replace("G4 P1.5", "G4 P1.5\nG43")
    assert [f.what for f in read(late, tool=1).findings] == [
        "the length of the tool is not applied (G43) before the first motion",
        "G43 after the first motion shifts the origin",
    ]


def test_options_are_held_against_the_text():
    text = posted(gcode(tool=1, work="G55"), PART)[1]
    assert not read(text, tool=1, work="G55").findings
    assert [f.what for f in read(text, tool=2, work="G55").findings] == [
        "tool T1, but post.tool is 2",
        "the tool change T2 M6 of post.tool is missing",
    ]
    with pytest.raises(JobError, match="signals"):
        read(text, signals="P0")
    with pytest.raises(JobError, match="is not a number"):
        read(text, path_tolerance="wide")


# Lines that both the reader and LinuxCNC know, in every spelling: the interpreter says what they mean.

SPELLINGS = {
    "blanks and case": "g 2 1\ng 0 z 5\n g0 x1. y+.5\nG01 X 1 0 f1 00\nm02",
    "numbers and comments": "N10 G21 (a ; b)\nN20 G0 Z5 ; x ( y\nN30 G0 X1 (p) Y2 (q)\n(only)\n\nM30",
    "inches": "G20\nG0 Z1\nG0 X1 Y0\nF10 G1 X2\nG2 X3 Y1 I1 J0\nG21 G1 X0\nM2",
    "increments": "G21\nG0 X1 Y1 Z1\nG91 G1 X1 F60\nY2 Z-1\nG90 X0\nM2",
    "modal arcs": "G21\nG0 X0 Y0 Z0\nF60 G2 X2 I1\nX4 I1\nG3 X2 R1\nM2",
    "absolute centre": "G21\nG0 X0 Y0 Z0\nG90.1 F60 G3 X0 Y4 I0 J2\nM2",
    "radius short": "G21\nG0 X0 Y0 Z0\nF60 G3 X3 Y3 R3\nG2 X0 Y0 R3\nM2",
    "radius long": "G21\nG0 X0 Y0 Z0\nF60 G3 X3 Y3 R-3\nG2 X0 Y0 R-3\nM2",
    "radius half": "G21\nG0 X0 Y0 Z0\nF60 G3 X4 R1.999\nM2",
    "circles": "G21\nG0 X0 Y0 Z0\nF60 G2 I2\nG3 X0 Y0 J1\nG3 I1 P3\nM2",
    "xz plane": "G21 G18\nG0 X0 Y0 Z0\nF60 G2 X2 I1\nG3 X4 Z1 I1 K0.5\nG2 K3\nM2",
    "yz plane": "G21 G19\nG0 X0 Y0 Z0\nF60 G2 Y2 J1\nG3 Y4 Z1 J1 K0.5\nG3 Y6 Z1 R-4\nM2",
    "helix": "G21\nG0 X0 Y0 Z0\nF60 G2 X2 Z-1 I1\nG3 I2 Z3 P2\nM2",
    "per cent": "%\nG21\nG0 X0 Y0 Z0\n%\n",
    "order in a line": "G21\nG0 X0 Y0 Z0\nG1 X1 F60 M3 S500 G4 P1\nX2 S600 M8\nM9 M5 X3\nM2",
}


@needs_rs274
@pytest.mark.parametrize("text", SPELLINGS.values(), ids=SPELLINGS)
def test_reader_agrees_with_the_interpreter(text):
    reading = read(text)
    allowed = [
        "neither G49 nor G43 before the first motion: a tool length that is on shifts Z",
        "neither G61 nor G64 P before the first motion: corners may be rounded by any amount",
    ]
    unusual = (UNSAID, "where posts write in", "posts write M2", "Z moves together with X or Y")
    assert [
        f.what for f in reading.findings if not any(words in f.what for words in unusual)
    ] == allowed
    canon = run(text)
    assert canon.error == ""
    calls = [call for call in canon.calls if call.kind.startswith(("STRAIGHT", "ARC"))]
    lines = {}
    for line, item in zip(reading.lines, reading.body, strict=True):
        if isinstance(item, (MoveJ, MoveL, MoveC)):
            lines.setdefault(line, []).append(item)
    lifts = len(calls) - len(lines)
    assert lifts in (0, 1)
    start = calls[0].end
    for items, call in zip(lines.values(), calls[lifts:], strict=True):
        assert math.dist(items[-1].target.origin, call.end) < 3e-3
        if call.kind == "ARC_FEED":
            assert_on_arc(start, items, call)
        else:
            assert [type(item) for item in items] == [
                MoveJ if call.kind == "STRAIGHT_TRAVERSE" else MoveL
            ]
        if not isinstance(items[0], MoveJ):
            assert all(abs(item.speed * 60 - call.feed) < 3e-3 for item in items)
        start = call.end


def assert_on_arc(start, items, call):
    """All points are on the interpreted arc, and their angles add up to its sweep. At most half a circle each."""
    a, b, _ = call.axes
    normal = 3 - a - b
    radius = math.hypot(call.end[a] - call.centre[0], call.end[b] - call.centre[1])
    points = [start]
    for item in items:
        points += (
            [item.via.origin, item.target.origin]
            if isinstance(item, MoveC)
            else [item.target.origin]
        )
    angles = [math.atan2(p[b] - call.centre[1], p[a] - call.centre[0]) for p in points]
    steps = [math.remainder(q - p, math.tau) for p, q in pairwise(angles)]
    least = math.copysign((abs(call.turns) - 1) * math.tau, call.turns)
    rest = (math.copysign(1, call.turns) * (angles[-1] - angles[0])) % math.tau
    rest = math.tau if min(rest, math.tau - rest) < 1e-4 else rest
    assert sum(steps) == pytest.approx(least + math.copysign(rest, call.turns), abs=2e-3)
    assert max(map(abs, steps)) < math.pi / 2 + 1e-3
    lift = 0.0
    for point, step in zip(points[1:], steps, strict=True):
        lift += (call.end[normal] - start[normal]) * step / sum(steps)
        assert abs(math.hypot(point[a] - call.centre[0], point[b] - call.centre[1]) - radius) < 3e-3
        assert abs(point[normal] - start[normal] - lift) < 3e-3


def test_a_half_circle_stays_one_arc_and_a_circle_is_two():
    lead = "G21 G61\nG0 X0 Y0 Z0\nF60\n"
    for radius in (0.05, 1.0, 1000.0):
        over = 0.0007 / radius  # the end rounded beyond the half
        x, y = radius + radius * math.cos(over), radius * math.sin(over)
        assert len(read(f"{lead}G2 X{x:.5f} Y{-y:.5f} I{radius}\nM2").body) == 2
        assert len(read(f"{lead}G2 I{radius}\nM2").body) == 3


def test_helices_are_read_as_lines_close_to_them():
    body = read("G21 G61\nG0 X0 Y0 Z0\nF60 G3 X0 Y0 Z1 I-10\nM2").body[1:]
    assert all(isinstance(item, MoveL) for item in body)
    ends = [(0.0, 0.0, 0.0)] + [item.target.origin for item in body]
    for p, q in pairwise(ends):
        middle = math.hypot((p[0] + q[0]) / 2 + 10, (p[1] + q[1]) / 2)
        assert 0 <= 10 - middle < 0.0021


# Nothing that a file may hold makes the reader fail.


@given(st.randoms(use_true_random=False))
def test_changed_texts_never_raise(chance: random.Random):
    text = list(TEXT)
    for _ in range(chance.randint(1, 12)):
        k = chance.randrange(len(text))
        text[k] = chance.choice(
            [
                "",
                "9" * 300,
                "\n",
                "G2",
                "I",
                "R-",
                "%",
                "(",
                "P7",
                "Z\x00",
                "é",
                "ı",
                *"0123456789.-;/#NO",
            ]
        )
    reading = read("".join(text))
    assert len(reading.body) == len(reading.lines)
    assert list(reading.lines) == sorted(reading.lines)
    assert [f.line for f in reading.findings] == sorted(f.line for f in reading.findings)


@given(st.one_of(st.text(), st.text("GMXYZIJKRFSTPQ0123456789.-+ \n%()/;", max_size=200)))
def test_any_text_gives_a_reading(text):
    reading = read(text)
    # Only a text that ends as a program does can be without a fault.
    assert reading.findings or any(
        end in text.upper().replace(" ", "") for end in ("M2", "M02", "M30")
    )


@pytest.mark.skipif(not DATA.is_dir(), reason="no shared/data/gcode beside the repository")
def test_found_programs_are_read_or_faulted():
    files = [file for file in sorted(DATA.rglob("*")) if file.is_file()]
    assert files
    for file in files:
        text = file.read_bytes().decode("utf-8", "replace")
        for name in ("gcode", "grbl"):
            assert find_readback(name)({file.name: text}, {}).findings


@pytest.mark.skipif(not DATA.is_dir(), reason="no shared/data/gcode beside the repository")
@needs_rs274
@pytest.mark.parametrize(
    "name",
    [
        "bCNC/sample",
        "cncjs/circle",
        "cncjs/circle-inch",
        "cncjs/jsdc",
        "cncjs/tball-engrave-laser",
        "svg2gcode/shapes",
        "svg2gcode/smooth_curves_circular_interpolation",
    ],
)
def test_found_programs_have_the_length_that_linuxcnc_gives(name):
    text = (DATA / f"{name}.gcode").read_text()
    here, read_length, true_length = (0.0, 0.0, 0.0), 0.0, 0.0
    for item in read(text).body:
        if isinstance(item, MoveL):
            read_length += math.dist(here, item.target.origin)
        elif isinstance(item, MoveC):
            _, radius, _, sweep = compute_circle(here, item.via.origin, item.target.origin)
            read_length += radius * sweep
        here = item.target.origin if isinstance(item, (MoveJ, MoveL, MoveC)) else here
    here = (0.0, 0.0, 0.0)
    for call in run(text).calls:
        if call.kind == "STRAIGHT_FEED":
            true_length += math.dist(here, call.end)
        elif call.kind == "ARC_FEED":
            (cx, cy), sense = call.centre, math.copysign(1, call.turns)
            begin, end = (math.atan2(p[1] - cy, p[0] - cx) for p in (here, call.end))
            sweep = (sense * (end - begin)) % math.tau or math.tau
            true_length += math.hypot(here[0] - cx, here[1] - cy) * sweep
        here = call.end if call.kind.startswith(("STRAIGHT", "ARC")) else here
    assert read_length == pytest.approx(true_length, rel=1e-4)


@fewer(12)
@given(
    st.lists(
        st.tuples(
            st.sampled_from(["", "G0", "G1", "G2", "G3"]),
            st.dictionaries(
                st.sampled_from("XYZIJF"), st.decimals(-999, 999, places=3), max_size=6
            ),
        ),
        max_size=6,
    )
)
def test_plain_lines_are_read_as_all_others(lines):
    """A line in the usual form says what the same line says in small letters, which goes the long way."""
    text = "G17 G21 G40 G49 G54 G80 G90 G94\nG64 P0.01 Q0\nG0 Z9\nG0 X0 Y0\nF100\n"
    for code, words in lines:
        ordered = [f"{letter}{words[letter]}" for letter in "XYZIJF" if letter in words]
        text += " ".join([code, *ordered]).strip() + "\n"
    text += "M2\n"
    plain, long = read(text), read(text.lower())
    assert list_values(plain, True)[:2] == list_values(long, True)[:2]
    assert [fault.line for fault in plain.findings] == [fault.line for fault in long.findings]


HEAD = "G17 G21 G40 G54 G80 G90 G91.1 G94\nG64 P0.01 Q0\nG49\n"


@pytest.mark.parametrize(
    ("body", "line", "what"),
    [
        ("G0 Z50 T2\nG0 X0 Y0\nM2\n", 4, "T2 selects a tool that no M6 changes to"),
        ("G0 Z50 S9\nG0 X0 Y0\nM2\n", 4, "S9 without M3 or M4"),
        ("G0 Z50 S9\nG0 X0 Y0\nM3\nM5\nM2\n", 4, ""),
        ("S9\nS8\nM3\nG0 Z50\nG0 X0 Y0\nM5\nM2\n", 4, "S9 without M3 or M4"),
        ("G0 X0 Y0 Z50\nM2\n", 4, "Z moves together with X or Y while it is not known"),
        (
            "G0 Z50\nG0 X0\nY0\nM2\n",
            5,
            "X and Y move one after the other to where the program begins",
        ),
        ("G18\nG0 Z50\nG0 X0 Y0\nM2\n", 4, "G18 where posts write in G17"),
        ("G0 Z50\nG0 X0 Y0\nM30\n", 6, "M30 exchanges pallets before the end; posts write M2"),
        (
            "G0 Z50\nG0 X0 Y0\nG3 X10 Y0 I5.01 J0 F60\nG1 X0\nM2\n",
            6,
            "an arc whose radius goes from 5.0100 to 4.9900 mm",
        ),
        ("G0 Z50\nG0 X0 Y0\nG3 X10 Y0 I5.001 J0 F60\nG1 X0\nM2\n", 6, ""),
    ],
)
def test_what_no_program_of_ours_says_is_a_remark(body, line, what):
    found = read(HEAD + body, lift=False).findings
    assert [(f.line, f.what) for f in found] == ([(line, what)] if what else [])
    assert all(f.level == "unusual" for f in found)


def test_a_tool_that_is_changed_to_twice_is_a_remark():
    head = HEAD.replace("G49", "T3 M6\nT3 M6\nG43 H3")
    assert [
        (f.line, f.what) for f in read(head + "G0 Z50\nG0 X0 Y0\nM2\n", tool=3, lift=False).findings
    ] == [(4, "M6 a second time")]


def test_corners_before_the_lift_are_remarked_on():
    text = HEAD.replace("G64 P0.01 Q0\n", "G53 G0 Z0\n") + "G64 P0.01 Q0\nG0 X0 Y0\nG0 Z50\nM2\n"
    assert [(f.line, f.what) for f in read(text).findings] == [
        (2, "neither G61 nor G64 P before the first motion: corners may be rounded by any amount")
    ]


@pytest.mark.parametrize(
    ("comment", "says"),
    [
        ("(path c1 layer 0)", ""),
        ("(debug: no comma)", ""),
        ("(debug, #1)", "active comment '(debug, #1)'"),
        ("(py,x)", "active comment '(py,x)'"),
        ("(one) X1", ""),
        ("(two) X1 Z1 Q2", "word Q2: nothing in the line uses it"),
        ("(open", "a comment that is not closed, or closed twice"),
        ("(in (it)", "a comment that is not closed, or closed twice"),
        (f"({'x' * 300})", "302 characters, LinuxCNC reads 252"),
        ("(é)", ""),
    ],
)
def test_comments_between_motions_are_looked_at(comment, says):
    found = faults("G1 X1 F100", comment, "G1 X2")
    assert [what for line, what in found if line == 2] == ([says] if says else [])
    body = read(
        "\n".join(
            [f"{SAFE} G64 P0.01 Q0", "G0 Z5", "G0 X0 Y0", "G1 X1 F100", comment, "G1 X2", "M2", ""]
        )
    ).body
    assert body[-1].target.origin == (2.0, 0.0, body[-1].target.origin[2])
