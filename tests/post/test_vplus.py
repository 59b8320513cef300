"""V+: texts written by hand, refused programs and options, and the built-in cell."""

import dataclasses
import itertools
import math
import re
from pathlib import Path

import numpy as np
import pytest
from camgen_posts.vplus import VPlus

from camgen.lang.vplus.strict import read
from camgen.model.errors import CamgenError, JobError, Refused, VerifyError
from camgen.model.pose import TOOL_DOWN, Pose, angle_between, frozen, rotation_about, translation
from camgen.model.program import (
    Comment,
    Force,
    Instruction,
    Joints,
    MoveC,
    MoveJ,
    MoveL,
    Output,
    Program,
    Stop,
    Wait,
)
from camgen.post.plugins import make_post
from camgen.post.verify import compare
from tests.post.changes.vplus import BRACKET
from tests.support.vplus_programs import (
    CELL,
    HOME,
    HOME6,
    assert_same,
    down,
    program,
    render,
    zyz_degrees,
)


def test_the_text_of_a_small_program_is_the_expected_one() -> None:
    # With the tool down, (0, 180, 180) has tool x along work x, (0, 180, 90) along work y,
    # and (0, 180, 0) against work x.
    to_y = Pose(frozen([[0, 1, 0], [1, 0, 0], [0, 0, -1]]), (-0.00051, 20.5, -0.0001))
    back = Pose(frozen(np.diag([-1.0, 1.0, -1.0])), (40, 0, 0))
    source = program(
        HOME,
        MoveJ(down(10, 20.5, 20), 125, 2.0),
        MoveL(down(10, 20.5, 0), 20),
        Output("process", 1),
        Wait(0.15),
        Comment("edge 1"),
        MoveL(to_y, 20, 0.3),
        MoveL(back, 12.345678),
        Output("process", 0),
        HOME,
        name="Bracket top",
        header=("bracket.dxf; layer holes",),
    )
    options: dict[str, object] = {"rated": 1000, "posture": ["RIGHTY"]}
    prepared, text = render(source, options)
    assert text == BRACKET
    reading = read({"a": text}, options)
    assert_same(prepared, reading, options)
    assert reading.findings == ()
    assert [text.splitlines()[line - 1].split()[0] for line in reading.lines] == [
        "SIGNAL",
        "MOVE",
        "MOVE",
        "MOVES",
        "SIGNAL",
        "WAIT.EVENT",
        "MOVES",
        "MOVES",
        "SIGNAL",
        "MOVE",
    ]
    assert reading.work is not None
    assert reading.tool is not None
    assert (reading.work.origin, reading.tool.origin) == ((250, -75, 150), (0, 0, 100))


def verify(prepared: Program, text: str, options: dict[str, object]) -> None:
    """Reads a text and compares it with the program, as a build does. Raises VerifyError."""
    tolerance = make_post(VPlus, options).tolerance()
    compare(prepared, read({"a": text}, options), tolerance, VPlus.verified_fields, "a")


QUARTER = Pose(frozen(rotation_about(2, math.pi / 2) @ TOOL_DOWN), (10, 20, 5))
TURNING = (
    HOME,
    MoveJ(down(10, 20, 5), 100),
    MoveL(QUARTER, 20, turn=math.radians(60)),
    MoveL(Pose(QUARTER.rotation, (40, 20, 5)), 20),
    HOME,
)


@pytest.mark.parametrize(("rated", "percent"), [(1200.0, "5"), (600.0, "10"), (90.0, "66.6667")])
def test_a_reorientation_states_its_rotational_speed(rated: float, percent: str) -> None:
    """In `SPEED v, r MMPS`, r is in % of the rotational speed of the arm.

    The next motion has 100 again.
    """
    options: dict[str, object] = {"rated_turn": rated}
    prepared, text = render(program(*TURNING), options)
    statements = [line for line in text.splitlines() if not line.startswith(";")]
    speeds = [line.split(maxsplit=1)[1] for line in statements if "MMPS" in line]
    assert speeds == [f"20, {percent} MMPS ALWAYS", "20, 100 MMPS ALWAYS"]
    reading = read({"a": text}, options)
    tolerance = make_post(VPlus, options).tolerance()
    verify(prepared, text, options)
    turns = [i.turn for i in reading.body if isinstance(i, MoveL)]
    assert turns == [pytest.approx(math.radians(60), abs=tolerance.turn), 0.0]
    for wrong in ("4", "6", "100"):
        slow = text.replace(f"20, {percent} MMPS", f"20, {wrong} MMPS")
        with pytest.raises(
            VerifyError,
            match=r"instruction 2: speed of turning reads .*, planned is 1\.047198 .line 18",
        ):
            verify(prepared, slow, options)
    without = text.replace(f"20, {percent} MMPS", "20 MMPS")
    with pytest.raises(VerifyError, match="speed of turning"):  # without the number it is 100 %
        verify(prepared, without, options)


@pytest.mark.parametrize(
    ("turn", "message"),
    [
        (
            1300.0,
            (
                "1300 deg/s is more than post.rated_turn = 1200 deg/s; lower process.turn or "
                "raise post.rated_turn"
            ),
        ),
        (
            0.1,
            "0.1 deg/s is 0.00833 % of post.rated_turn = 1200 deg/s, "
            "below the least that prints exactly, 0.05 %; "
            "raise process.turn or lower post.rated_turn (instruction 2)",
        ),
    ],
)
def test_a_reorientation_beyond_the_arm_or_the_digits_is_refused(turn: float, message: str) -> None:
    body = [*TURNING[:2], MoveL(QUARTER, 20, turn=math.radians(turn)), *TURNING[3:]]
    with pytest.raises(Refused) as caught:
        render(program(*body))
    assert message in str(caught.value)


def test_the_page_of_the_post_shows_the_expected_text_and_every_option() -> None:
    page = (Path(__file__).parents[2] / "docs" / "posts" / "vplus.md").read_text(encoding="utf-8")
    assert page.split("```\n")[1] == BRACKET
    for option in (f.name for f in dataclasses.fields(VPlus) if f.init):
        assert f"`{option}`" in page


def test_the_post_declares_its_files_passes_and_verified_fields() -> None:
    assert (VPlus.newline, VPlus.suffix, VPlus.passes) == ("\r\n", ".v2", ("chords",))
    assert {
        "orientation",
        "speed",
        "joint-speed",
        "stop",
        "turn",
        "switches",
    } == VPlus.verified_fields


def test_an_arc_becomes_chords_on_its_circle() -> None:
    arc = MoveC(down(15, 25, 0), down(20, 20, 0), 20, 1.0)
    source = program(HOME, MoveJ(down(10, 20, 0), 100), arc, MoveL(down(40, 20, 0), 20), HOME)
    prepared, text = render(source, chord=0.05)
    points = [i.target.origin for i in prepared.body if isinstance(i, MoveL)][:-1]
    ends = [(10, 20, 0), *points]
    for (x, y, _), (u, v, _) in itertools.pairwise(ends):
        assert math.hypot(u - 15, v - 20) == pytest.approx(5)
        assert 5 - math.hypot((x + u) / 2 - 15, (y + v) / 2 - 20) <= 0.05 + 1e-9
    assert_same(prepared, read({"a": text}, {}))


def test_tool_and_frame_may_be_on_the_controller() -> None:
    options: dict[str, object] = {"declare": False, "tool": "pen", "work": "Table.3"}
    with pytest.raises(JobError, match="ends like the parts"):
        make_post(VPlus, options)
    options["work"] = "Table.b"
    prepared, text = render(
        program(HOME, MoveJ(down(1, 2, 3), 100), MoveL(down(1, 2, 0), 20), HOME), options
    )
    assert "AUTO" not in text
    assert "SET" not in text
    assert "    TOOL pen\n" in text
    assert "    MOVES Table.b:TRANS(1,2,0,0,180,180)\n" in text
    reading = read({"a": text}, options)
    assert_same(prepared, reading)
    assert (reading.findings, reading.work, reading.tool) == ((), None, None)
    # Without the options these locations are not defined.
    assert [f.what for f in read({"a": text}, {}).findings] == [
        "location PEN is not defined",
        "location TABLE.B is not defined",
        "location TABLE.B is not defined",
    ]


def test_force_and_spindle_may_be_signals() -> None:
    press = (0.0, 0.0, -1.0)
    source = program(
        HOME6,
        Output("spindle", 12000),
        MoveJ(down(0, 0, 0), 100),
        Force(15, press),
        MoveL(down(9, 0, 0), 20, 0, 15, press),
        Force(0),
        Output("spindle", 0),
        HOME6,
    )
    options: dict[str, object] = {
        "force": "signal",
        "spindle": "on-off",
        "signals": {"force": 34, "spindle": 2001},
    }
    prepared, text = render(source, options)
    assert [w for w in text.splitlines() if "SIGNAL" in w] == [
        "    SIGNAL -2001",
        "    SIGNAL -34",
        "    SIGNAL 2001",
        "    SIGNAL 34",
        "    SIGNAL -34",
        "    SIGNAL -2001",
    ]
    assert "; set 15 N by hand at the valve of the output named force\n" in text
    assert "; set 12000 rpm by hand at the drive of the output named spindle\n" in text
    reading = read({"a": text}, options)
    assert reading.findings == ()
    assert_same(prepared, reading, options)


def test_the_option_ignore_leaves_the_force_out() -> None:
    press = (0.0, 0.0, -1.0)
    source = program(
        HOME6,
        MoveJ(down(0, 0, 0), 100),
        Force(15, press),
        MoveL(down(9, 0, 0), 20, 1, 12, press),
        MoveL(down(9, 9, 0), 20, 0, 15, press),
        Force(0),
        HOME6,
    )
    prepared, text = render(source, {"force": "ignore"})
    assert "; the force of the plan, up to 15 N, is left out by force = ignore\n" in text
    assert not any(isinstance(i, Force) or getattr(i, "force", 0) for i in prepared.body)
    assert_same(prepared, read({"a": text}, {}))


UP = MoveJ(down(0, 0, 9), 100)
DOWN = (0.0, 0.0, -1.0)
TILTED = MoveJ(Pose(zyz_degrees(0, 179.9, 180), (0, 0, 0)), 100)
ON_OFF: dict[str, object] = {"spindle": "on-off", "signals": {"spindle": 5}}
VALVE: dict[str, object] = {"force": "signal", "signals": {"force": 9}}
REFUSED: list[tuple[dict[str, object], tuple[Instruction, ...], str]] = [
    (
        {},
        (HOME, TILTED),
        (
            "a SCARA cannot tilt its tool, and this pose is 0.1 deg from straight down; "
            "check cell.base"
        ),
    ),
    (
        {},
        (HOME, MoveJ(down(1e4, 0, 0), 9)),
        "at (10000, 0, 0) mm is beyond 8192 mm, where a V+ real is too coarse; mo",
    ),
    (
        {},
        (HOME, MoveC(UP.target, down(9, 9, 0), 9)),
        "V+ has no arc, and no pose is known where this one starts; move",
    ),
    (
        {},
        (HOME, MoveJ(UP.target, 7501)),
        "7501 mm/s is 100 % of post.rated = 7500 mm/s, more than 100 %; lower proce",
    ),
    (
        {},
        (HOME, MoveJ(UP.target, 3)),
        "3 mm/s is 0.04 % of post.rated = 7500 mm/s, below the least that prints exact",
    ),
    (
        {},
        (HOME, UP, MoveL(UP.target, 0.04)),
        "0.04 mm/s is below 0.05 mm/s, the least that prints exactly; raise pro",
    ),
    ({}, (HOME, Output("laser", 1)), "signal laser has no number; add it to post.signals"),
    (
        {},
        (HOME, Output("process", 0.5)),
        "signal process can be 0 or 1, not 0.5; use a signal that is on or off",
    ),
    (
        {},
        (HOME, Output("spindle", 9)),
        "V+ has no spindle speed; set post.spindle to on-off and map spindle in post.s",
    ),
    (
        {"spindle": "on-off"},
        (HOME, Output("spindle", 9)),
        "signal spindle has no number; add it to post.signals",
    ),
    (
        ON_OFF,
        (HOME, Output("spindle", -9)),
        "a spindle turning backwards is more than on or off; give a positive",
    ),
    (
        ON_OFF,
        (HOME, Output("spindle", 9), Output("spindle", 8)),
        "asks for 9 and 8 rpm (instruction 3); plan one value",
    ),
    (
        {},
        (HOME, Wait(0.0)),
        "a wait of 0 s cannot be written; leave it out or wait 0.001 s or more (instruction 1)",
    ),
    (
        {},
        (HOME, Force(5, DOWN), Force(0)),
        "V+ has no confirmed force control; set post.force to signal (a pressure",
    ),
    (
        {"force": "signal"},
        (HOME, Force(5, DOWN), Force(0)),
        "the output named force has no number; add it to post.sig",
    ),
    (
        VALVE,
        (HOME, UP, Force(5, DOWN), MoveL(UP.target, 9, 0, 4), Force(0)),
        "5 and 4 N (instruction 4); plan one",
    ),
    (
        {},
        (HOME, HOME6),
        "a position has 6 joint values, another 4 (instruction 1); give all for one arm",
    ),
    (
        {},
        (MoveJ(Joints((0.0,) * 5), 9),),
        "a position has 5 joint values (instruction 0); give 4 values (SCARA: deg, ",
    ),
    (
        {"posture": ["LEFTY"]},
        (HOME,),
        "LEFTY, but the first position has joint 2 at 45 deg; RIGHTY goes with joint 2",
    ),
    ({"posture": ["FLIP"]}, (HOME,), "FLIP: a SCARA has no such posture; give LEFTY or RIGHTY"),
]


@pytest.mark.parametrize(
    ("options", "body", "message"), REFUSED, ids=[m[:30] for _, _, m in REFUSED]
)
def test_a_refusal_names_the_remedy(
    options: dict[str, object], body: tuple[Instruction, ...], message: str
) -> None:
    with pytest.raises(CamgenError) as caught:
        render(program(*body), options)
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("work", "tool", "message"),
    [
        (
            translation(0, 9000, 0),
            CELL.flange_from_tool,
            "vplus: the work frame: at (0, 9000, 0) mm is beyond 8192 mm",
        ),
        (
            CELL.base_from_work,
            translation(0, 0, -9000),
            "vplus: the tool: at (0, 0, -9000) mm is beyond 8192 mm",
        ),
    ],
)
def test_a_frame_beyond_the_digits_of_the_text_is_refused(
    work: Pose, tool: Pose, message: str
) -> None:
    with pytest.raises(Refused) as caught:
        render(Program("a", work, tool, (HOME,)))
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"rated": 0.0},
            "[post] rated: cannot be 0.0; the TCP speed of a MOVE at 100 %, up to 20000 mm/s",
        ),
        ({"rated_turn": 0.0}, "[post] rated_turn: cannot be 0.0; deg/s at 100 %, up to 10000"),
        ({"decimals": 6}, "[post] decimals: cannot be 6; 1 to 4: a V+ real is single precision"),
        ({"max_lines": -1}, "[post] max_lines: cannot be -1; 0 for no limit"),
        (
            {"program": "a.very.long.name"},
            "'a.very.long.name' is longer than 15 characters, of which V+ ignores the",
        ),
        (
            {"program": "1st"},
            "[post] program: '1st' is not a letter followed by letters, digits, dots and underscor",
        ),
        ({"tool": "Tool"}, "[post] tool: 'Tool' is a word of V+; give another name"),
        (
            {"tool": "A", "work": "a"},
            "[post] program, tool, work: have the same name; give three names",
        ),
        (
            {"signals": {"process": 1005}},
            "[post] signals: process cannot be 1005; outputs are 1 to 1000, soft sig",
        ),
        (
            {"signals": {"process": 7, "force": 7}},
            "[post] signals: process and force are both 7; give each its own",
        ),
        (
            {"posture": ["RIGHTY", "LEFTY"]},
            "[post] posture: LEFTY and RIGHTY are one choice; give one of them, once",
        ),
        ({"posture": ["UPSIDE"]}, "[post] posture: Invalid enum value 'UPSIDE'"),
        ({"force": "hard"}, "[post] force: Invalid enum value 'hard'"),
    ],
)
def test_an_invalid_option_is_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(JobError) as caught:
        make_post(VPlus, options)
    assert message in str(caught.value)


def test_a_scara_may_hold_a_bent_tool() -> None:
    """The flange has to be vertical. The tool axis may be tilted."""
    bent = Pose(rotation_about(1, math.radians(30)), (20, 0, 80))
    target = Pose(frozen(TOOL_DOWN @ bent.rotation), (50, 50, 0))
    prepared, text = render(Program("a", CELL.base_from_work, bent, (HOME, MoveJ(target, 100))))
    reading = read({"a": text}, {})
    assert_same(prepared, reading)
    assert reading.tool is not None
    assert angle_between(reading.tool.rotation, bent.rotation) < 1e-5


@pytest.mark.parametrize("slip", [0.0, 1e-12, 1e-9, 3e-8, 5e-7])
def test_a_tool_that_is_down_up_to_rounding_has_pitch_180_and_yaw_0(slip: float) -> None:
    turned = frozen(rotation_about(2, 0.7) @ rotation_about(0, slip) @ TOOL_DOWN)
    _, text = render(program(HOME, MoveJ(Pose(turned, (0, 0, 0)), 100)))
    roll = 180 - math.degrees(0.7)
    assert f":TRANS(0,0,0,0,180,{roll:.3f})" in text


def test_the_built_in_cell_reaches_a_sheet() -> None:
    """Cobra s600: upper arm 325 mm, forearm 275 mm, elbow to 150 deg, joint 1 to 105 deg.

    The flange can be at z 177 to 387.
    """
    nearest = math.sqrt(325**2 + 275**2 - 2 * 325 * 275 * math.cos(math.radians(30)))
    ox, oy, oz = CELL.base_from_work.origin
    for x in (-30, 230):
        for y in (-30, 180):
            assert nearest + 20 < math.hypot(ox + x, oy + y) < 600 - 20
            assert abs(math.degrees(math.atan2(oy + y, ox + x))) < 60
    for z in (-20, 60):
        assert 177 < oz + z + CELL.flange_from_tool.origin[2] < 387
    assert CELL.home == Joints((0.0, math.radians(45), 50.0, 0.0))


def test_a_stop_waits_for_the_operator_and_is_read_back() -> None:
    source = program(HOME, MoveJ(down(10, 20, 20), 125), Stop(), MoveL(down(10, 20, 0), 20), HOME)
    prepared, text = render(source)
    assert "    BREAK\n    PAUSE\n" in text
    reading = read({"a": text}, {})
    assert reading.findings == ()
    assert [type(item) for item in reading.body] == [MoveJ, MoveJ, Stop, MoveL, MoveJ]
    verify(prepared, text, {})
    without = text.replace("    PAUSE\n", "")
    with pytest.raises(VerifyError):
        verify(prepared, without, {})
    early = text.replace("    BREAK\n    PAUSE\n", "    PAUSE\n")
    what = "PAUSE while the robot may still move: BREAK is missing before it"
    assert what in [fault.what for fault in read({"a": early}, {}).findings]


@pytest.mark.parametrize(
    ("stop", "options", "message"),
    [
        (Stop(optional=True), {}, "V+ has no optional stop"),
        (Stop(), {"points": "file"}, "a stop for the operator has no record"),
    ],
)
def test_a_stop_that_the_text_cannot_hold_is_refused(
    stop: Stop, options: dict[str, object], message: str
) -> None:
    with pytest.raises(Refused, match=re.escape(message)):
        render(program(HOME, MoveJ(down(10, 20, 20), 125), stop, HOME), options)
