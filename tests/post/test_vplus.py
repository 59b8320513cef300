"""The V+ post: its text by hand, its refusals, and that the read-back finds again what was printed."""

import dataclasses
import itertools
import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from camgen_posts.vplus import VPlus
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from camgen.lang.programs import Executed
from camgen.lang.vplus.strict import read
from camgen.model.errors import CamgenError, JobError, Refused, VerifyError
from camgen.model.pose import (
    TOOL_DOWN,
    FloatArray,
    Pose,
    angle_between,
    frozen,
    rotation_about,
    translation,
)
from camgen.model.program import (
    Columns,
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
    splice,
)
from camgen.post.plugins import make_post
from camgen.post.verify import compare
from tests.post.changes.vplus import BRACKET
from tests.support.examples import fewer
from tests.support.fast_paths import list_values
from tests.support.whole import whole

CELL = VPlus.cell()
HOME = MoveJ(CELL.home, 100.0)
HOME6 = MoveJ(Joints((0.1, -0.2, 0.3, -0.4, 0.5, -0.6)), 100.0)


def down(x: float, y: float, z: float) -> Pose:
    return Pose(TOOL_DOWN, (x, y, z))


def program(*body: Instruction, name: str = "part", header: tuple[str, ...] = ()) -> Program:
    return Program(name, CELL.base_from_work, CELL.flange_from_tool, whole(body), header)


def render(
    source: Program, options: dict[str, object] | None = None, chord: float = 0.01
) -> tuple[Program, str]:
    post = make_post(VPlus, options or {})
    prepared = post.prepare(source, chord)
    (file,) = post.render(prepared)
    assert file.name == source.name + ".v2"
    return prepared, file.text


def zyz_degrees(yaw: float, pitch: float, roll: float) -> FloatArray:
    a, b, c = (math.radians(v) for v in (yaw, pitch, roll))
    return frozen(rotation_about(2, a) @ rotation_about(1, b) @ rotation_about(2, c))


def agree(planned: Program, found: Executed, options: dict[str, object] | None = None) -> None:
    """The comparison of this file: every instruction, in order, within what the text carries."""
    tolerance = make_post(VPlus, options or {}).tolerance()
    slack = 1e-9
    body = [item for item in planned.body if not isinstance(item, Comment)]
    assert [type(i) for i in body] == [type(i) for i in found.body]
    for item, other in zip(body, found.body, strict=True):
        if isinstance(item, Output):
            assert item == other
            continue
        if isinstance(item, Wait):
            assert abs(item.seconds - other.seconds) <= tolerance.seconds
            continue
        assert abs(item.speed - other.speed) <= tolerance.speed + slack
        assert abs(item.speed - other.speed) <= 1e-3 * item.speed
        assert (item.blend == 0) == (other.blend == 0)
        if isinstance(item, MoveL) and isinstance(other, MoveL) and item.turn and other.turn:
            assert abs(item.turn - other.turn) <= tolerance.turn + slack
        if isinstance(item.target, Joints):
            assert np.allclose(
                item.target.values, other.target.values, rtol=0, atol=tolerance.joint
            )
        else:
            assert np.allclose(
                item.target.origin, other.target.origin, rtol=0, atol=tolerance.mm + slack
            )
            assert angle_between(item.target.rotation, other.target.rotation) <= tolerance.angle


def test_text_checked_by_hand() -> None:
    # Tool down, x forward is (0, 180, 180); x along work y is (0, 180, 90); x backward is (0, 180, 0).
    to_y = Pose(frozen([[0, 1, 0], [1, 0, 0], [0, 0, -1]]), (-0.00051, 20.5, -0.0001))
    back = Pose(frozen(np.diag([-1.0, 1.0, -1.0])), (40, 0, 0))
    source = program(
        HOME, MoveJ(down(10, 20.5, 20), 125, 2.0), MoveL(down(10, 20.5, 0), 20), Output("process", 1), Wait(0.15),
        Comment("edge 1"), MoveL(to_y, 20, 0.3), MoveL(back, 12.345678), Output("process", 0), HOME,
        name="Bracket top", header=("bracket.dxf; layer holes",),
    )  # fmt: skip
    options: dict[str, object] = {"rated": 1000, "posture": ["RIGHTY"]}
    prepared, text = render(source, options)
    assert text == BRACKET
    found = read({"a": text}, options)
    agree(prepared, found, options)
    assert found.findings == ()
    assert [text.splitlines()[line - 1].split()[0] for line in found.lines] == [
        "SIGNAL", "MOVE", "MOVE", "MOVES", "SIGNAL", "WAIT.EVENT", "MOVES", "MOVES", "SIGNAL", "MOVE",
    ]  # fmt: skip
    assert found.work is not None
    assert found.tool is not None
    assert (found.work.origin, found.tool.origin) == ((250, -75, 150), (0, 0, 100))


QUARTER = Pose(frozen(rotation_about(2, math.pi / 2) @ TOOL_DOWN), (10, 20, 5))
TURNING = (
    HOME, MoveJ(down(10, 20, 5), 100), MoveL(QUARTER, 20, turn=math.radians(60)),
    MoveL(Pose(QUARTER.rotation, (40, 20, 5)), 20), HOME,
)  # fmt: skip


@pytest.mark.parametrize(("rated", "percent"), [(1200.0, "5"), (600.0, "10"), (90.0, "66.6667")])
def test_a_turn_on_the_spot_states_its_rotational_speed(rated: float, percent: str) -> None:
    """SPEED v, r MMPS: r % of the arm's rotational speed, which bounds a motion whose point stays; then 100 again."""
    options: dict[str, object] = {"rated_turn": rated}
    prepared, text = render(program(*TURNING), options)
    said = [
        line.split(maxsplit=1)[1]
        for line in text.splitlines()
        if "MMPS" in line and not line.startswith(";")
    ]
    assert said == [f"20, {percent} MMPS ALWAYS", "20, 100 MMPS ALWAYS"]
    found = read({"a": text}, options)
    tolerance = make_post(VPlus, options).tolerance()
    compare(prepared, found, tolerance, VPlus.verified_fields, "a")
    turns = [i.turn for i in found.body if isinstance(i, MoveL)]
    assert turns == [pytest.approx(math.radians(60), abs=tolerance.turn), 0.0]
    for wrong in ("4", "6", "100"):
        slow = text.replace(f"20, {percent} MMPS", f"20, {wrong} MMPS")
        with pytest.raises(
            VerifyError,
            match=r"instruction 2: speed of turning reads .*, planned is 1\.047198 .line 18",
        ):
            compare(prepared, read({"a": slow}, options), tolerance, VPlus.verified_fields, "a")
    left = text.replace(f"20, {percent} MMPS", "20 MMPS")
    with pytest.raises(VerifyError, match="speed of turning"):  # without the number it is 100 %
        compare(prepared, read({"a": left}, options), tolerance, VPlus.verified_fields, "a")


@pytest.mark.parametrize(
    ("turn", "message"),
    [
        (1300.0, "1300 deg/s is more than post.rated_turn = 1200 deg/s; lower process.turn or raise post.rated_turn"),
        (0.1, "0.1 deg/s is 0.00833 % of post.rated_turn = 1200 deg/s, below the least that prints exactly, 0.05 %; "
              "raise process.turn or lower post.rated_turn (instruction 2)"),
    ],
)  # fmt: skip
def test_a_turn_that_the_arm_or_the_text_does_not_have(turn: float, message: str) -> None:
    body = [*TURNING[:2], MoveL(QUARTER, 20, turn=math.radians(turn)), *TURNING[3:]]
    with pytest.raises(Refused) as caught:
        render(program(*body))
    assert message in str(caught.value)


def test_the_rotational_speed_of_a_text_by_hand() -> None:
    """Where no second number stands it is 100 %; it holds as long as its SPEED, and the monitor speed scales it."""
    found = reading(
        "SPEED 20 MMPS ALWAYS", "MOVES TRANS(1)", "MOVES TRANS(1,0,0,90)", "SPEED 20, 5 MMPS", "MOVES TRANS(1)",
        "MOVES TRANS(1,0,0,90)", "SPEED 30, 10 MMPS ALWAYS", "MOVES TRANS(1)", "SPEED 50 MONITOR",
        "MOVES TRANS(1,0,0,90)", "MOVES TRANS(2,0,0,0)", rated_turn=600,
    )  # fmt: skip
    assert faults(found) == []
    turns = [math.degrees(i.turn) for i in found.body if isinstance(i, MoveL)]
    assert turns == pytest.approx([0, 600, 30, 600, 60, 30, 0])


def test_the_page_about_this_post_shows_that_text() -> None:
    page = (Path(__file__).parents[2] / "docs" / "posts" / "vplus.md").read_text(encoding="utf-8")
    assert page.split("```\n")[1] == BRACKET
    for option in (f.name for f in dataclasses.fields(VPlus) if f.init):
        assert f"`{option}`" in page


def test_the_class_says_what_it_carries() -> None:
    assert (VPlus.newline, VPlus.suffix, VPlus.passes) == ("\r\n", ".v2", ("chords",))
    assert {
        "orientation",
        "speed",
        "joint-speed",
        "stop",
        "turn",
        "switches",
    } == VPlus.verified_fields


def test_arc_becomes_chords_on_its_circle() -> None:
    arc = MoveC(down(15, 25, 0), down(20, 20, 0), 20, 1.0)
    source = program(HOME, MoveJ(down(10, 20, 0), 100), arc, MoveL(down(40, 20, 0), 20), HOME)
    prepared, text = render(source, chord=0.05)
    points = [i.target.origin for i in prepared.body if isinstance(i, MoveL)][:-1]
    ends = [(10, 20, 0), *points]
    for (x, y, _), (u, v, _) in itertools.pairwise(ends):
        assert math.hypot(u - 15, v - 20) == pytest.approx(5)
        assert 5 - math.hypot((x + u) / 2 - 15, (y + v) / 2 - 20) <= 0.05 + 1e-9
    agree(prepared, read({"a": text}, {}))


def test_tool_and_frame_on_the_controller() -> None:
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
    found = read({"a": text}, options)
    agree(prepared, found)
    assert (found.findings, found.work, found.tool) == ((), None, None)
    # Without the options nobody knows these locations.
    assert [f.what for f in read({"a": text}, {}).findings] == [
        "location PEN is not defined", "location TABLE.B is not defined", "location TABLE.B is not defined",
    ]  # fmt: skip


def test_force_and_spindle_as_signals() -> None:
    press = (0.0, 0.0, -1.0)
    source = program(
        HOME6, Output("spindle", 12000), MoveJ(down(0, 0, 0), 100), Force(15, press),
        MoveL(down(9, 0, 0), 20, 0, 15, press), Force(0), Output("spindle", 0), HOME6,
    )  # fmt: skip
    options: dict[str, object] = {
        "force": "signal", "spindle": "on-off", "signals": {"force": 34, "spindle": 2001},
    }  # fmt: skip
    prepared, text = render(source, options)
    assert [w for w in text.splitlines() if "SIGNAL" in w] == [
        "    SIGNAL -2001", "    SIGNAL -34", "    SIGNAL 2001", "    SIGNAL 34", "    SIGNAL -34", "    SIGNAL -2001",
    ]  # fmt: skip
    assert "; set 15 N by hand at the valve of the output named force\n" in text
    assert "; set 12000 rpm by hand at the drive of the output named spindle\n" in text
    found = read({"a": text}, options)
    assert found.findings == ()
    agree(prepared, found, options)


def test_force_left_out_on_request() -> None:
    press = (0.0, 0.0, -1.0)
    source = program(
        HOME6, MoveJ(down(0, 0, 0), 100), Force(15, press), MoveL(down(9, 0, 0), 20, 1, 12, press),
        MoveL(down(9, 9, 0), 20, 0, 15, press), Force(0), HOME6,
    )  # fmt: skip
    prepared, text = render(source, {"force": "ignore"})
    assert "; the force of the plan, up to 15 N, is left out by force = ignore\n" in text
    assert not any(isinstance(i, Force) or getattr(i, "force", 0) for i in prepared.body)
    agree(prepared, read({"a": text}, {}))


UP = MoveJ(down(0, 0, 9), 100)
DOWN = (0.0, 0.0, -1.0)
TILTED = MoveJ(Pose(zyz_degrees(0, 179.9, 180), (0, 0, 0)), 100)
ON_OFF: dict[str, object] = {"spindle": "on-off", "signals": {"spindle": 5}}
VALVE: dict[str, object] = {"force": "signal", "signals": {"force": 9}}
REFUSED: list[tuple[dict[str, object], tuple[Instruction, ...], str]] = [
    (
        {},
        (HOME, TILTED),
        "a SCARA cannot tilt its tool, and this pose is 0.1 deg from straight down; check cell.base",
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
def test_refusals_name_the_remedy(
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
def test_frames_that_cannot_be_printed(work: Pose, tool: Pose, message: str) -> None:
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
def test_options_that_cannot_be_meant(options: dict[str, object], message: str) -> None:
    with pytest.raises(JobError) as caught:
        make_post(VPlus, options)
    assert message in str(caught.value)


def test_a_scara_may_turn_its_tool_and_hold_it_askew() -> None:
    """What counts is the flange: a bent tool that is vertical at the flange is fine, though its own z is not."""
    bent = Pose(rotation_about(1, math.radians(30)), (20, 0, 80))
    target = Pose(frozen(TOOL_DOWN @ bent.rotation), (50, 50, 0))
    prepared, text = render(Program("a", CELL.base_from_work, bent, (HOME, MoveJ(target, 100))))
    found = read({"a": text}, {})
    agree(prepared, found)
    assert found.tool is not None
    assert angle_between(found.tool.rotation, bent.rotation) < 1e-5


@pytest.mark.parametrize("slip", [0.0, 1e-12, 1e-9, 3e-8, 5e-7])
def test_a_rounded_tool_down_prints_pitch_180_and_yaw_0(slip: float) -> None:
    turned = frozen(rotation_about(2, 0.7) @ rotation_about(0, slip) @ TOOL_DOWN)
    _, text = render(program(HOME, MoveJ(Pose(turned, (0, 0, 0)), 100)))
    roll = 180 - math.degrees(0.7)
    assert f":TRANS(0,0,0,0,180,{roll:.3f})" in text


# -- long programs and names ---------------------------------------------------------------------------------------


def long_program(count: int, name: str) -> Program:
    lines = [MoveL(down(x % 200, x // 200, 0), 20, 1.0) for x in range(count)]
    return program(HOME, *lines, MoveL(down(0, 0, 20), 50), HOME, name=name)


def test_a_long_program_calls_its_parts() -> None:
    source = long_program(5000, "A very long name of a part")
    whole, text = render(source, {"max_lines": 0})
    prepared, split = render(source)
    names = re.findall(r"^\.PROGRAM (\S+)\(\)$", split, re.MULTILINE)
    assert names == ["a_very_long_n", "a_very_long_n.1", "a_very_long_n.2", "a_very_long_n.3"]
    assert max(map(len, names)) == 15
    assert split.count("\n.END\n") == 4
    assert [p.count("\n") <= 2000 + 8 for p in split.split(".PROGRAM")] == [True] * 5
    one, many = read({"a": text}, {}), read({"a": split}, {})
    assert (one.findings, many.findings) == ((), ())
    agree(prepared, many)
    agree(whole, one)
    assert many.work is not None
    assert many.work.origin == (250, -75, 150)


class _CountedLines(Sequence[str]):
    """Lines that count how often they are read as a whole, and one by one."""

    def __init__(self, lines: list[str]) -> None:
        self.lines, self.wholes, self.singles = lines, 0, 0

    def __len__(self) -> int:
        return len(self.lines)

    def __iter__(self) -> Iterator[str]:
        self.wholes += 1
        return iter(self.lines)

    def __getitem__(self, index: Any) -> Any:
        self.singles += 1
        return self.lines[index]


def test_each_part_of_a_long_program_is_read_once() -> None:
    """A printed part is one text, which each access to a line splits."""
    post = make_post(VPlus, {})
    parts = [_CountedLines(["    MOVE #PPOINT(0, 0)"] * 100) for _ in range(3)]
    post.assemble(program(HOME), parts)
    assert [(part.wholes, part.singles) for part in parts] == [(1, 0)] * 3


def test_every_part_says_its_speed() -> None:
    _, text = render(long_program(100, "a"), {"max_lines": 20})
    parts = text.split("\n.PROGRAM ")[1:]
    assert len(parts) > 4
    for part in parts:
        lines = [line.split()[0] for line in part.splitlines()]
        assert lines.index("SPEED") < next(
            i for i, word in enumerate(lines) if word.startswith("MOVE")
        )


def test_a_given_name_is_not_cut() -> None:
    source = long_program(100, "a")
    with pytest.raises(
        Refused, match=r"outline_of_part is too long a name for 6 parts; shorten post.program to 13"
    ):
        render(source, {"program": "outline_of_part", "max_lines": 20})
    assert render(source, {"program": "outline_of_part"})[1].startswith(
        ".PROGRAM outline_of_part()\n"
    )


@given(st.text(max_size=30))
def test_any_input_name_becomes_a_name_of_its_own(name: str) -> None:
    _, text = render(Program(name, CELL.base_from_work, CELL.flange_from_tool, (HOME,)))
    header = text.splitlines()[0]
    assert re.fullmatch(r"\.PROGRAM [a-z][a-z0-9._]{0,14}\(\)", header)
    assert header[9:-2] not in ("tool", "base", "here", "null", "cg.tool", "cg.work")


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("tool", "p_tool"),
        ("CG.WORK", "p_cg.work"),
        ("1st", "p_1st"),
        ("Größe 7", "gr__e_7"),
        ("", "p"),
        ("...", "p"),
    ],
)
def test_names_that_are_taken(name: str, expected: str) -> None:
    _, text = render(Program(name, CELL.base_from_work, CELL.flange_from_tool, (HOME,)))
    assert text.startswith(f".PROGRAM {expected}()\n")


# -- the built-in cell ---------------------------------------------------------------------------------------------


def test_the_sheet_lies_within_reach_of_the_cobra_s600() -> None:
    """Upper arm 325, forearm 275 mm, elbow to 150 deg, joint 1 to 105 deg; the flange between z 177 and 387."""
    nearest = math.sqrt(325**2 + 275**2 - 2 * 325 * 275 * math.cos(math.radians(30)))
    ox, oy, oz = CELL.base_from_work.origin
    for x in (-30, 230):
        for y in (-30, 180):
            assert nearest + 20 < math.hypot(ox + x, oy + y) < 600 - 20
            assert abs(math.degrees(math.atan2(oy + y, ox + x))) < 60
    for z in (-20, 60):
        assert 177 < oz + z + CELL.flange_from_tool.origin[2] < 387
    assert CELL.home == Joints((0.0, math.radians(45), 50.0, 0.0))


# -- round trip ----------------------------------------------------------------------------------------------------

NUMBERS = st.floats(-400, 400)
DEGENERATE = st.sampled_from([0.0, 180.0, 90.0, 1e-9, 180 - 1e-9, 1e-5, 180 - 4e-5, 1e-3])
ANGLES = st.floats(-180, 180) | st.sampled_from([0.0, 90.0, -90.0, 180.0, -180.0])
ANY = st.builds(zyz_degrees, ANGLES, st.floats(0, 180) | DEGENERATE, ANGLES)
STRAIGHT = st.builds(lambda roll: zyz_degrees(0, 180, roll), ANGLES)


def bodies(
    rotations: st.SearchStrategy[FloatArray], home: MoveJ
) -> st.SearchStrategy[tuple[Instruction, ...]]:
    places = st.tuples(NUMBERS, NUMBERS, NUMBERS) | st.just((1.0, 2.0, 3.0))
    poses = st.builds(Pose, rotations, places)
    blends = st.sampled_from([0.0, 0.3, 5.0])
    item = st.one_of(
        st.builds(MoveJ, poses, st.floats(4, 7500), blends),
        st.builds(
            MoveL, poses, st.floats(0.05, 3000), blends, turn=st.floats(0.02, math.radians(1200))
        ),
        st.builds(Output, st.just("process"), st.sampled_from([0, 1])),
        st.builds(Wait, st.floats(0.001, 60)),
        st.builds(Comment, st.text(max_size=60)),
    )
    return st.lists(item, max_size=12).map(lambda items: settled([home, *items, home]))


def settled(items: list[Instruction]) -> tuple[Instruction, ...]:
    """The same with a stop wherever a program must have one, and a speed of turning only where the tool stays."""
    stop = True
    for i in reversed(range(len(items))):
        item = items[i]
        if isinstance(item, (MoveJ, MoveL)):
            if stop:
                items[i] = replace(item, blend=0.0)
            stop = False
        elif not isinstance(item, Comment):
            stop = True
    columns = Columns(items)
    travels = np.flatnonzero(columns.moves_are(MoveL) & ~columns.turned)
    return splice(
        items, {int(columns.at[k]): (replace(columns.moves[k], turn=0.0),) for k in travels}
    )


@fewer(12)
@given(bodies(ANY, HOME6), st.sampled_from([0, 5, 2000]))
def test_what_is_printed_is_read_six_axes(body: tuple[Instruction, ...], max_lines: int) -> None:
    round_trip(program(*body, header=("any",)), {"max_lines": max_lines})


@given(bodies(STRAIGHT, HOME))
def test_what_is_printed_is_read_scara(body: tuple[Instruction, ...]) -> None:
    round_trip(program(*body), {"posture": ["RIGHTY"], "rated": 7600})


@given(st.text(max_size=80), ANY, st.tuples(NUMBERS, NUMBERS, NUMBERS))
def test_any_remark_and_any_frame(
    remark: str, rotation: FloatArray, origin: tuple[float, float, float]
) -> None:
    frame = Pose(rotation, origin)
    source = Program(
        "a", frame, frame, (HOME6, MoveJ(down(1, 2, 3), 100)), (remark, "; .END\r\n.END")
    )
    found = round_trip(source, {})
    for pose in (found.work, found.tool):
        assert pose is not None
        assert np.allclose(pose.origin, origin, rtol=0, atol=0.0005 + 1e-9)
        assert angle_between(pose.rotation, rotation) < 1e-5


def round_trip(source: Program, options: dict[str, object]) -> Executed:
    prepared, text = render(source, options)
    assert text.isascii()
    assert max(map(len, text.splitlines())) <= 120
    assert "\r" not in text
    found = read({"a.v2": text.replace("\n", "\r\n")}, options)
    assert found.findings == ()
    agree(prepared, found, options)
    return found


# -- the read-back alone: programs written by hand -----------------------------------------------------------------


def reading(*lines: str, **options: object) -> Executed:
    text = "\n".join([".PROGRAM t()", *lines, ".END"]) + "\n"
    return read({"t.v2": text}, options)


def faults(found: Executed) -> list[tuple[int, str]]:
    """Without remarks, which a text by hand has for what it leaves to the controller."""
    return [(f.line, f.what) for f in found.findings if f.level != "unusual"]


def origins(found: Executed) -> list[tuple[float, ...]]:
    return [
        tuple(round(v, 6) for v in i.target.origin)
        for i in found.body
        if isinstance(i, (MoveJ, MoveL))
    ]


def test_a_program_as_people_write_it() -> None:
    """Lower case, labels, a loop that draws a half circle, approach and departure; every value worked out by hand."""
    found = reading(
        "; pen plot", "\tauto wf, i", "  select robot = 1", "  attach ()", "  set pen = trans(0,0,95.5)",
        "  tool pen ; the pen", "  set wf = trans(320,-40,60)", "  righty", "  speed 40 always", "  accel (1) 60, 60",
        "  appro wf:trans(10,10,0,0,180,180), 25", "  moves wf:trans(10,10,0,0,180,180)", "100  break",
        "  signal (33), -34", "  wait.event , 0.15", "  speed 25, 100 mmps always", "  for i = 0 to 180 step 90",
        "    moves wf:trans(40+15*sin(i),25-15*cos(i),0,0,180,180)", "  end", "  break", "  speed 40 always",
        "  departs 25", "  break", "  detach ()", '  type "done; not a comment", /S', "  return",
        rated=1000, signals={"pen": 33},
    )  # fmt: skip
    assert faults(found) == []
    assert origins(found) == [
        (10, 10, 25),
        (10, 10, 0),
        (40, 10, 0),
        (55, 25, 0),
        (40, 40, 0),
        (40, 40, 25),
    ]
    kinds = [type(i).__name__[0] + type(i).__name__[-1] for i in found.body]
    assert kinds == ["MJ", "ML", "Ot", "Ot", "Wt", "ML", "ML", "ML", "ML"]
    moves = [i for i in found.body if isinstance(i, (MoveJ, MoveL))]
    assert [m.speed for m in moves] == [400, 400, 25, 25, 25, 400]
    assert [m.blend > 0 for m in moves] == [True, False, True, True, False, False]
    assert found.body[2:5] == (Output("pen", 1), Output("signal 34", 0), Wait(0.15))
    assert found.lines == (12, 13, 15, 15, 16, 19, 19, 19, 23)
    assert found.work is not None
    assert found.tool is not None
    assert (found.work.origin, found.tool.origin) == ((320, -40, 60), (0, 0, 95.5))
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
def test_locations(text: str, origin: tuple[float, ...]) -> None:
    found = reading("SET p = TRANS(7,8,9)", f"MOVE {text}")
    assert faults(found) == []
    (move,) = found.body
    assert isinstance(move, MoveJ)
    assert isinstance(move.target, Pose)
    assert found.work is not None
    assert (found.work @ move.target).origin == pytest.approx(origin, abs=1e-12)


@given(ANGLES, st.floats(0, 180) | DEGENERATE, ANGLES)
def test_trans_turns_about_z_y_z(yaw: float, pitch: float, roll: float) -> None:
    found = reading(f"MOVE TRANS(0,0,0,{yaw:.9f},{pitch:.9f},{roll:.9f})")
    (move,) = found.body
    assert isinstance(move, MoveJ)
    assert isinstance(move.target, Pose)
    assert angle_between(move.target.rotation, zyz_degrees(yaw, pitch, roll)) < 1e-9


def test_precision_points() -> None:
    slide = reading("SET #p = #PPOINT(90, 0, 50, -180)", "MOVE #p", "BREAK")
    six = reading("MOVE #PPOINT(180,0,90,0,0,0)", "BREAK")
    assert [m.target for m in (*slide.body, *six.body) if isinstance(m, MoveJ)] == [
        Joints((math.pi / 2, 0, 50, -math.pi)), Joints((math.pi, 0, math.pi / 2, 0, 0, 0)),
    ]  # fmt: skip
    assert faults(slide) == faults(six) == []


def test_speeds() -> None:
    found = reading(
        "MOVE TRANS(1)", "SPEED 50", "MOVE TRANS(2)", "MOVE TRANS(3)", "SPEED 30 MMPS ALWAYS", "MOVES TRANS(4)",
        "SPEED 2 IPS", "MOVES TRANS(5)", "MOVES TRANS(6)", "SPEED 50 MONITOR", "MOVES TRANS(7)", "MOVE TRANS(8)",
        rated=1000,
    )  # fmt: skip
    speeds = [m.speed for m in found.body if isinstance(m, (MoveJ, MoveL))]
    assert speeds[:-1] == pytest.approx([1000, 500, 1000, 30, 50.8, 30, 15])
    assert faults(found) == [(13, "a joint motion wants its SPEED in percent")]


def test_stops() -> None:
    found = reading(
        "MOVE TRANS(1)",
        "DISABLE CP",
        "MOVE TRANS(2)",
        "ENABLE CP",
        "MOVE TRANS(3)",
        "BASE",
        "MOVE NULL",
    )
    assert [m.blend > 0 for m in found.body if isinstance(m, MoveJ)] == [True, False, False, True]
    assert faults(found) == []


def test_here_and_dest() -> None:
    found = reading(
        "MOVE TRANS(1)", "SET a = DEST", "BREAK", "MOVE HERE:TRANS(,5)", "MOVE a", "SET b = HERE"
    )
    assert origins(found) == [(1, 0, 0), (1, 5, 0), (1, 0, 0)]
    assert faults(found) == [(7, "HERE while the robot may still move: BREAK is missing before it")]


def test_targets_in_several_frames_are_given_in_the_base() -> None:
    found = reading(
        "SET f = TRANS(10)",
        "SET g = TRANS(,10)",
        "MOVE f:TRANS(1)",
        "MOVE g:TRANS(1)",
        "MOVE TRANS(5)",
    )
    assert origins(found) == [(11, 0, 0), (1, 10, 0), (5, 0, 0)]
    assert found.work is not None
    assert found.work.origin == (0, 0, 0)
    mixed = reading(
        "SET f = TRANS(10)", "MOVE f:TRANS(1)", "MOVE w:TRANS(1)", declare=False, work="w"
    )
    assert faults(mixed) == [
        (4, "the frames of the targets differ, and location w is only on the controller")
    ]


def test_a_text_with_several_programs() -> None:
    sub = ".PROGRAM sub()\nAUTO f\nSET f = TRANS(5)\nMOVE f:NULL\nBREAK\n.END\n"
    text = f"; remark\n.PROGRAM main()\nCALL sub()\nCALL sub()\nMOVE f:NULL\n.END\n\n{sub}"
    found = read({"a": text}, {})
    assert faults(found) == [(5, "location F is not defined")]
    assert found.lines == (11, 11)
    split = read({"a": text[: text.index(".PROGRAM sub")], "b": sub}, {})
    assert (split.lines, faults(split)) == (found.lines, faults(found))


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        (["MOVED TRANS(1)"], (2, "unknown statement MOVED")),
        (["JMOVE #[1,2,3]"], (2, "unknown statement JMOVE")),
        (["MOVES wf:TRANS(1)"], (2, "location WF is not defined")),
        (["AUTO a", "MOVE a"], (3, "location A is not defined")),
        (["MOVE #p"], (2, "precision point #P is not defined")),
        (["SET contour_segment_1 = NULL", "SET contour_segment_2 = NULL"],
         (3, "contour_segment_2 and contour_segment_1 are one name: only 15 characters count")),
        (["MOVE TRANS(1)", "SIGNAL 33"], (3, "an output while the robot may still move: BREAK is missing before it")),
        (["MOVE NULL", "WAIT.EVENT , 1"], (3, "a dwell while the robot may still move: BREAK is missing before it")),
        (["MOVE NULL", "DETACH ()"], (3, "DETACH while the robot may still move: BREAK is missing before it")),
        (["DELAY 0.5"], (2, "DELAY is uncertain: it delays the next motion; WAIT.EVENT , s is a dwell")),
        (["WAIT 0.5"], (2, "WAIT is not evaluated")),
        (["WAIT.EVENT 1"], (2, "WAIT.EVENT with an event is not evaluated")),
        (["IF SIG(1001) THEN", "MOVE TRANS(1)", "ELSE", "MOVE TRANS(2)", "END"], (2, "IF is not evaluated")),
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
)  # fmt: skip
def test_faults_by_line(lines: list[str], expected: tuple[int, str]) -> None:
    found = reading(*lines)
    assert expected in faults(found)
    # What is in a block that is not evaluated does not count as done.
    assert not lines[0].startswith(("IF", "WHILE", "DO", "CASE")) or found.body == ()


def remarks(text: str, options: dict[str, object]) -> list[tuple[int, str]]:
    return [(f.line, f.what) for f in read({"a": text}, options).findings if f.level == "unusual"]


def test_what_a_call_keeps_is_not_taken_for_granted() -> None:
    """Speed and posture are said again after a CALL and after its RETURN."""
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
    assert remarks(main.format("") + sub.format(again), {}) == []
    speed = "no SPEED since a CALL or its RETURN: whether that keeps the speed is not confirmed"
    posture = (
        "RIGHTY not set since a CALL or its RETURN: whether that keeps the posture is not confirmed"
    )
    assert remarks(main.format("") + sub.format(""), {}) == [(16, speed), (16, posture)]
    after = main.format("MOVES TRANS(1)\nBREAK\n") + sub.format(again)
    assert remarks(after, {}) == [(11, speed), (11, posture)]


def test_what_the_controller_has_is_what_the_options_name() -> None:
    options: dict[str, object] = {"declare": False}
    text = "\n".join([
        ".PROGRAM t()", "SELECT ROBOT = 1", "ATTACH ()", "ENABLE CP", "ACCEL (0) 100, 100", "TOOL cg.tool",
        "MOVE cg.work:NULL", "BREAK", "DETACH ()", ".END\n",
    ])  # fmt: skip
    assert remarks(text, options) == []
    assert remarks(text.replace("TOOL cg.tool", "TOOL cg.work"), options) == [
        (1, "the tool is cg.work, not cg.tool as post.tool has it")
    ]
    assert remarks(text.replace("cg.work", "cg.tool"), options) == [
        (7, "a target in cg.tool, not in cg.work as post.work has it")
    ]


def test_four_axes_take_no_tilt_in_whatever_frames() -> None:
    """The flange counts: a tool that is bent by 30 deg is held tilted. What only the controller knows is not judged."""
    frames = [
        "SET t = TRANS(0,0,100,0,30,0)",
        "TOOL t",
        "SET wf = TRANS(300,0,0,90,0,0)",
        "MOVE #PPOINT(0,45,50,0)",
    ]
    upright = reading(*frames, "MOVE wf:TRANS(1,2,3,0,150,180)", "MOVE TRANS(1,2,3,40,150,180)")
    assert faults(upright) == []
    tilted = reading(*frames, "MOVE wf:TRANS(1,2,3,0,180,180)", "MOVES wf:TRANS(1,2,3,0,150.1,180)")
    said = "deg from straight down, which an arm of four axes cannot take"
    assert faults(tilted) == [(6, f"the flange 30 {said}"), (7, f"the flange 0.1 {said}")]
    assert faults(reading(*frames[2:], "MOVE wf:TRANS(1,2,3,0,90,0)")) == []
    six = ["MOVE #PPOINT(0,45,50,0,0,0)", "FLIP", "MOVE wf:TRANS(1,2,3,0,90,0)"]
    assert faults(reading(*frames[:3], *six)) == []


def test_a_robot_that_is_attached_again_moves() -> None:
    lines = ["MOVE NULL", "BREAK", "DETACH ()", "ATTACH ()", "MOVE NULL", "BREAK", "DETACH ()"]
    assert faults(reading(*lines)) == []
    assert faults(reading(*(line for line in lines if line != "ATTACH ()"))) == [
        (5, "a motion after DETACH: the robot is not attached to this program")
    ]
    rows = ["SET wf = NULL", "DETACH ()", *(f"MOVES wf:TRANS({k},0,0,0,180,180)" for k in range(3))]
    assert [line for line, _ in faults(reading(*rows))] == [4]


def test_labels_belong_to_their_program() -> None:
    sub = ".PROGRAM sub()\n10 BREAK\n20 BREAK\n.END\n"
    assert faults(read({"a": f".PROGRAM main()\n10 CALL sub()\n.END\n{sub}"}, {})) == []
    assert faults(reading("10 BREAK", "BREAK", "10 BREAK")) == [(4, "label 10 is there twice")]


def test_text_around_programs() -> None:
    assert faults(read({"a": ".PROGRAM a()\nBREAK\n"}, {})) == [(2, "a has no .END")]
    assert faults(read({"a": "MOVE NULL\n"}, {}))[0] == (1, "an instruction outside of a .PROGRAM")
    assert faults(read({"a": ""}, {})) == [(1, "there is no .PROGRAM")]
    assert faults(read({}, {})) == [(1, "there is no .PROGRAM")]
    twice = ".PROGRAM a()\n.END\n.PROGRAM A()\n.END\n.PROGRAM b()\n.END\n"
    assert faults(read({"a": twice}, {})) == [
        (3, "program A is there twice"), (5, "program b is called by no other and not evaluated"),
    ]  # fmt: skip


def test_mixed_line_ends_count_as_one_line_each() -> None:
    found = read({"a": ".PROGRAM a()\r\n\r; x\rMOVE NULL\n\nHALT\r\n.END\r\n"}, {})
    assert (found.lines, faults(found)) == ((4,), [(6, "HALT is not evaluated")])


def test_endless_loops_end() -> None:
    loop = ["FOR i = 1 TO 900000", "FOR j = 1 TO 900000", "a = i*j", "END", "END"]
    assert faults(reading(*loop))[-1][1] == "the loops of this program do not come to an end"


def test_the_fast_way_for_plain_targets_says_the_same() -> None:
    _, text = render(long_program(300, "a"))
    fast, general = read({"a": text}, {}), read({"a": re.sub(r"(MOVES .*)\)", r"\1+0)", text)}, {})
    assert fast.findings == ()
    assert list_values(fast, False) == list_values(general, False)


@pytest.mark.parametrize(
    "victim", ["BREAK", "SPEED", "SIGNAL", "WAIT.EVENT", "MOVES", "TOOL", "SET cg.work"]
)
def test_a_missing_line_is_noticed(victim: str) -> None:
    """Every line that a machine obeys matters: without it there is a fault, or the comparison fails."""
    source = program(
        HOME, MoveJ(down(1, 2, 9), 120), MoveL(down(1, 2, 0), 20), Output("process", 1), Wait(1),
        MoveL(down(9, 2, 0), 30, 1.0), MoveL(down(9, 9, 0), 20), Output("process", 0), HOME,
    )  # fmt: skip
    prepared, text = render(source)
    lines = text.splitlines()
    places = [i for i, line in enumerate(lines) if line.strip().startswith(victim)]
    assert places
    for i in places:
        found = read({"a": "\n".join(lines[:i] + lines[i + 1 :])}, {})
        if victim == "TOOL":
            assert found.tool is None
        elif not found.findings:
            with pytest.raises(AssertionError):
                agree(prepared, found)


GOOD = (
    BRACKET
    + ".PROGRAM x()\nFOR i = 1 TO 3\nAPPRO p:RX(i*2), 5\nSHIFT(p BY 1,2)\nEND\nIF a THEN\nEND\n.END\n"
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
def test_no_text_breaks_the_reader(edits: list[tuple[int, int, str]]) -> None:
    text = GOOD
    for at, cut, piece in edits:
        text = text[:at] + piece + text[at + cut :]
    found = read({"a": text}, {})
    last = len(re.split(r"\r\n|\r|\n", text))
    assert all(1 <= f.line <= last and f.what.isprintable() for f in found.findings)
    assert len(found.lines) == len(found.body)
    assert all(1 <= line <= last for line in found.lines)
    for item in found.body:
        if isinstance(item, (MoveJ, MoveL)) and isinstance(item.target, Pose):
            assert np.isfinite(item.target.rotation).all()


@given(st.text(max_size=200))
def test_nonsense_is_a_fault(text: str) -> None:
    assert read({"a": text}, {}).findings


SHARED = Path(__file__).parents[2].parent / "shared" / "data" / "robot"


@pytest.mark.parametrize("name", ["Prog1.pg", "Kawasaki.pg", "Program.mod"])
def test_programs_of_other_controllers_are_faults(name: str) -> None:
    paths = sorted(SHARED.glob(f"*/{name}"))
    if not paths:
        pytest.skip(f"{name}: the folder shared/data/robot is not there")
    found = read({name: paths[0].read_text(encoding="utf-8")}, {})
    assert any(
        "unknown statement" in f.what or "outside of a .PROGRAM" in f.what for f in found.findings
    )


def test_a_stop_waits_for_the_operator_and_is_read_back() -> None:
    source = program(HOME, MoveJ(down(10, 20, 20), 125), Stop(), MoveL(down(10, 20, 0), 20), HOME)
    prepared, text = render(source)
    assert "    BREAK\n    PAUSE\n" in text
    found = read({"a": text}, {})
    assert found.findings == ()
    assert [type(item) for item in found.body] == [MoveJ, MoveJ, Stop, MoveL, MoveJ]
    compare(prepared, found, make_post(VPlus, {}).tolerance(), VPlus.verified_fields, "a")
    lost = text.replace("    PAUSE\n", "")
    with pytest.raises(VerifyError):
        compare(
            prepared,
            read({"a": lost}, {}),
            make_post(VPlus, {}).tolerance(),
            VPlus.verified_fields,
            "a",
        )
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
def test_stops_that_it_lacks(stop: Stop, options: dict[str, object], message: str) -> None:
    with pytest.raises(Refused, match=re.escape(message)):
        render(program(HOME, MoveJ(down(10, 20, 20), 125), stop, HOME), options)
