"""G-code: texts written by hand, refused programs and options, arcs and forces."""

import math
from pathlib import Path

import pytest
from msgspec.structs import replace

from camgen.lang.programs import find_language
from camgen.model.errors import JobError, Refused
from camgen.model.pose import Pose, frozen, pose_from_values, rotation_from_fixed_xyz
from camgen.model.program import Force, Joints, MoveC, MoveJ, MoveL, Output, Stop, Wait
from camgen.post.kit import Case, cases, check_case
from camgen.post.plugins import find_post
from tests.post.changes.gcode import TEXT
from tests.support.gcode_programs import PART, PRESSED, S, gcode, read
from tests.support.rs274 import at, difference, posted, program


def test_the_page_of_the_post_shows_the_expected_text():
    page = Path(__file__).parents[2] / "docs" / "posts" / "gcode.md"
    assert f"```\n{TEXT}```" in page.read_text()


def test_the_text_of_a_part_is_the_expected_one():
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


def test_options_change_the_lines_before_the_first_motion():
    _, text = posted(gcode(work="G59.3", tool=1, path_tolerance=0.0, decimals=2), PART)
    modes = ["G17 G21 G40 G59.3 G80 G90 G94", "G91.1", "G61"]
    assert text.splitlines()[3:12] == [*modes, "M5", "M65 P0", "G53 G0 Z0", "G49", "T1 M6", "G43"]
    assert not read(text, work="G59.3", tool=1, path_tolerance=0.0, decimals=2).findings


def test_without_lift_the_first_height_is_the_one_of_the_home_position():
    _, text = posted(gcode(lift=False), PART)
    assert text.splitlines()[5:11] == ["G64 P0.01 Q0", "M5", "M65 P0", "G49", "G0 Z50", "G0 X0 Y0"]
    assert not read(text, lift=False).findings


def test_a_clockwise_arc_is_g2():
    plan = program(MoveL(at(10, 0, 0), 10.0), MoveC(at(S, -S, 0), at(0, -10, 0), 10.0))
    assert "G2 X0 Y-10 I-10 J0" in posted(gcode(), plan)[1]


def test_without_the_option_arcs_an_arc_becomes_chords():
    ready, text = posted(gcode(arcs=False), PART, chord=0.5)
    assert "G3" not in text
    # With r = 10 and 0.5 mm a chord spans 2 acos(1 - 0.05) = 36.4 deg, so a quarter has three.
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
def test_an_arc_that_the_machine_lacks_becomes_chords(via, target):
    plan = program(MoveL(at(0, 0, 0), 10.0), MoveC(at(*via), at(*target), 10.0))
    ready, text = posted(gcode(), plan)
    assert not {"G2", "G3"} & set(text.split())
    assert difference(ready, read(text), gcode().tolerance()) == ""


def test_a_shallow_arc_keeps_its_radius():
    # A chord of 5 mm at r = 1000 has a sagitta of 0.003 mm. Three points with three digits would
    # not determine the radius.
    step = 0.005
    angles = [step * k / 2 for k in range(9)]
    points = [(1000 * math.sin(a), 1000 - 1000 * math.cos(a)) for a in angles]
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
def test_a_feed_is_exact_to_a_thousandth(speed, word):
    _, text = posted(gcode(), program(MoveL(at(1, 0, 0), speed)))
    assert word in text.split()
    assert abs(float(word[1:]) - speed * 60) < 1e-3 * speed * 60


# Refusals


@pytest.mark.parametrize(
    ("plan", "index", "message"),
    [
        (
            program(MoveJ(Joints((0.0,) * 6), 10.0)),
            1,
            "has no joint values to move to; give the home position as a pose",
        ),
        (
            program(MoveL(Pose(rotation_from_fixed_xyz(math.pi - 0.1, 0, 0), (0, 0, 0)), 10.0)),
            1,
            (
                "the tool is not straight down, and the machine has three axes; use a robot's "
                "post or no axis tilt"
            ),
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
            (
                "signal flood has no output (known: spindle, process); give it one in "
                'post.signals, e.g. { flood = "M8" }'
            ),
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
def test_a_refusal_names_index_and_remedy(plan, index, message):
    with pytest.raises(Refused) as caught:
        gcode().prepare(plan, 0.01)
    assert message in str(caught.value)
    assert caught.value.index == index
    assert "\n" not in str(caught.value)


def test_the_roll_of_the_tool_does_not_change_the_text():
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
    ("options", "message"),
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
def test_an_invalid_option_is_refused(options, message):
    with pytest.raises(JobError) as caught:
        gcode(**options)
    assert message in str(caught.value)


def test_a_force_may_be_an_analog_output():
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


def test_the_option_ignore_leaves_the_force_out():
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


#: Comments, and the last digit of a centre: an arc may deviate by six times half a digit.
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


def test_a_half_circle_of_two_decimals_stays_one_arc():
    """Its digits are those of an arc of half a circle and 0.01 rad that starts at X1.17 Y1.73."""
    plan = program(
        MoveJ(at(1.170746, 1.734613, 0), 10.0),
        MoveC(at(0.170746, 2.734613, 0), at(-0.829254, 1.734613, 0), 10.0),
    )
    post = gcode(decimals=2)
    ready, text = posted(post, plan)
    assert "G3 X-0.83 Y1.73 I-1 J0.005" in text
    assert difference(ready, read(text), post.tolerance()) == ""
