"""The PacScript post against hand-checked text, its read-back against hand-written programs, and a round trip."""

import math
import re
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from camgen_posts.pacscript import PacScript
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from camgen.lang.pacscript.strict import read
from camgen.lang.programs import Executed
from camgen.model.errors import JobError, Refused
from camgen.model.pose import (
    TOOL_DOWN,
    Pose,
    frozen,
    pose_from_values,
    rotation_about,
    rotation_about_axis,
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
    Output,
    Program,
    Wait,
)
from camgen.post.plugins import make_post
from tests.support.examples import fewer
from tests.support.whole import turning, whole

SHARED = Path(__file__).parents[2].parent / "shared"
HOME = Joints(tuple(math.radians(v) for v in (0.0, 0.0, 90.0, 0.0, 30.0, 0.0)))
WORK = pose_from_values((300.0, -75.0, 150.0, 0.0, 0.0, 90.0))
TOOL = translation(0.0, 0.0, 100.0)


def down(x: float, y: float, z: float = 0.0) -> Pose:
    return Pose(TOOL_DOWN, (x, y, z))


def program(*body: Instruction, name: str = "bracket", header: tuple[str, ...] = ()) -> Program:
    return Program(
        name, WORK, TOOL, whole((MoveJ(HOME, 100.0), MoveJ(down(0, 0, 20), 100.0), *body)), header
    )


def text_of(plan: Program, **options: object) -> str:
    post = make_post(PacScript, options)
    (file,) = post.render(post.prepare(plan, 0.01))
    return file.text


def body_of(plan: Program, **options: object) -> list[str]:
    """The lines between the two opening motions of ``program`` and GiveArm."""
    lines = [line.strip() for line in text_of(plan, **options).splitlines()]
    opening = [k for k, line in enumerate(lines) if line.startswith("Move P")]
    return lines[opening[1] + 1 : len(lines) - 1 - lines[::-1].index("GiveArm")]


def spoken(body: tuple[Instruction, ...]) -> list[Instruction]:
    return [item for item in body if not isinstance(item, Comment)]


def assert_same(planned: Program, reading: Executed, post: PacScript) -> None:
    """Every instruction again, within the tolerance that the post states."""
    limit = post.tolerance()
    assert reading.findings == ()
    assert len(reading.lines) == len(reading.body)
    for want, got in zip(spoken(planned.body), reading.body, strict=True):
        assert type(want) is type(got)
        if isinstance(want, (MoveJ, MoveL, MoveC)) and isinstance(got, (MoveJ, MoveL, MoveC)):
            assert_place(want.target, got.target, limit.mm, limit.angle, limit.joint)
            if not turn_of(want):  # where the TCP stays in its place it has no speed
                assert got.speed == pytest.approx(want.speed, abs=limit.speed, rel=0)
            elif isinstance(got, MoveL):
                assert got.turn == pytest.approx(turn_of(want), abs=limit.turn, rel=0)
            assert (want.blend > 0) == (got.blend > 0)
        if isinstance(want, MoveC) and isinstance(got, MoveC):
            assert_place(want.via, got.via, limit.mm, limit.angle, limit.joint)
        if isinstance(want, (MoveL, MoveC)) and isinstance(got, (MoveL, MoveC)):
            assert np.multiply(want.force, want.force_direction) == pytest.approx(
                np.multiply(got.force, got.force_direction), abs=0.0105
            )
        if isinstance(want, Force) and isinstance(got, Force):
            assert np.multiply(want.newtons, want.force_direction) == pytest.approx(
                np.multiply(got.newtons, got.force_direction), abs=6e-4
            )
        if isinstance(want, Output):
            assert want == got
        if isinstance(want, Wait) and isinstance(got, Wait):
            assert got.seconds == pytest.approx(want.seconds, abs=5.1e-4, rel=0)


def turn_of(item: MoveJ | MoveL | MoveC) -> float:
    return item.turn if isinstance(item, MoveL) else 0.0


def assert_place(
    want: Pose | Joints, got: Pose | Joints, mm: float, angle: float, joint: float
) -> None:
    if isinstance(want, Joints):
        assert isinstance(got, Joints)
        assert got.values == pytest.approx(want.values, abs=joint, rel=0)
    else:
        assert isinstance(got, Pose)
        assert got.origin == pytest.approx(want.origin, abs=mm, rel=0)
        # |sin| of the angle between two rotations from the Frobenius norm: |A - B| = 2 sqrt(2) sin(angle / 2).
        assert np.linalg.norm(want.rotation - got.rotation) / math.sqrt(2) <= angle


# -- the post: text ----------------------------------------------------------------------------------------------------

SMALL = """\
'!TITLE "bracket"
' camgen 0.1.0
' layer _holes_ M3
' work 1 must be set on the pendant to: 300.000, -75.000, 150.000, 0.0000, 0.0000, 90.0000 mm, deg
' tool 1 must be set on the pendant to: 0.000, 0.000, 100.000, 0.0000, 0.0000, 0.0000 mm, deg
' posture: fixed by the first joint move
' external speed: the pendant's, 100 % for the planned speeds
Sub Main
    TakeArm Keep = 0
    Reset IO[24]
    ' Mps() is a percentage: 0.1 m/s is over 0.5 % of any arm, 0.1 mm/s not over 0.1 %
    Dim unit As Single = 1
    If Mps(0.1) > 0.2 Then
        unit = 0.001
    End If
    ' now Mps(100 * unit) is 100 mm/s; no motion where that is not 0.5 to 20 %
    If Mps(100 * unit) < 0.5 Or Mps(100 * unit) > 20 Then
        GiveArm
        Exit Sub
    End If
    Speed 10
    Accel 50, 50
    ChangeTool 1
    ChangeWork 1
    Move P, @0 J(0.0000, 0.0000, 90.0000, 0.0000, 30.0000, 0.0000), Speed = Mps(100 * unit)
    Move P, @P P(12.500, 8.000, 20.000, 180.0000, 0.0000, 0.0000, -1), Speed = Mps(100 * unit)
    Move L, @0 P(12.500, 8.000, 0.000, 180.0000, 0.0000, 0.0000, -1), Speed = Mps(20 * unit)
    ' contour c1
    Set IO[24]
    Delay 150
    Move L, @P P(52.500, 8.000, 0.000, 180.0000, 0.0000, 0.0000, -1), Speed = Mps(15.5 * unit)
    Move C, P(62.500, 18.000, 0.000, 180.0000, 0.0000, 0.0000, -1), @0 P(52.500, 28.000, 0.000, 180.0000, 0.0000, 0.0000, -1), Speed = Mps(20 * unit)
    Reset IO[24]
    Move L, @0 P(52.500, 28.000, 20.000, 180.0000, 0.0000, 90.0000, -1), Speed = Mps(100 * unit)
    GiveArm
End Sub
"""  # noqa: E501


def small() -> Program:
    # Tool straight down with its x along the work y: Rz(90) Rx(180).
    turned = rotation_about(2, math.pi / 2) @ rotation_about(0, math.pi)
    body = (
        MoveJ(HOME, 100.0),
        MoveJ(down(12.5, 8, 20), 100.0, 5.0),
        MoveL(down(12.5, 8), 20.0),
        Comment("contour c1"),
        Output("process", 1.0),
        Wait(0.15),
        MoveL(down(52.5, 8), 15.5, 0.3),
        MoveC(down(62.5, 18), down(52.5, 28), 20.0),
        Output("process", 0.0),
        MoveL(Pose(turned, (52.5, 28, 20)), 100.0),
    )
    return Program("bracket", WORK, TOOL, whole(body), ("camgen 0.1.0", "layer (holes) M3"))


def test_small_program_is_this_text() -> None:
    (file,) = PacScript().render(small())
    assert file.name == "bracket.pcs"
    assert file.text == SMALL
    assert PacScript.newline == "\r\n"


def test_small_program_reads_back() -> None:
    reading = read({"bracket.pcs": SMALL}, {})
    assert_same(small(), reading, PacScript())
    assert reading.lines == (10, 25, 26, 27, 29, 30, 31, 32, 33, 34)
    assert reading.work is None
    assert reading.tool is None


def test_line_ends_of_the_file_make_no_difference() -> None:
    lf, crlf = (read({"a.pcs": text}, {}) for text in (SMALL, SMALL.replace("\n", "\r\n")))
    assert (crlf.lines, crlf.findings) == (lf.lines, ())


def test_documentation_shows_this_text_and_every_option() -> None:
    page = (Path(__file__).parents[2] / "docs" / "posts" / "pacscript.md").read_text(
        encoding="utf-8"
    )
    assert SMALL in page
    assert [f.name for f in fields(PacScript) if f.init and f"`{f.name}`" not in page] == []


def test_defined_frames_are_written_and_read() -> None:
    text = text_of(program(), define=True, tool=3, work=2)
    assert "    Tool 3, P(0.000, 0.000, 100.000, 0.0000, 0.0000, 0.0000)\n" in text
    assert (
        "    Work 2, P(300.000, -75.000, 150.000, 0.0000, 0.0000, 90.0000)\n    ChangeTool 3\n    ChangeWork 2\n"
        in text
    )
    assert "' tool 3 is set below to: " in text
    reading = read({"a.pcs": text}, {})
    assert reading.work is not None
    assert reading.work.origin == (300.0, -75.0, 150.0)
    assert np.allclose(reading.work.rotation @ [1, 0, 0], [0, 1, 0])
    assert reading.tool is not None
    assert reading.tool.origin == (0.0, 0.0, 100.0)


def test_orientation_is_rz_ry_rx_in_degrees() -> None:
    rx, ry, rz = 25.0, -40.0, 110.0
    rotation = (
        rotation_about(2, math.radians(rz))
        @ rotation_about(1, math.radians(ry))
        @ rotation_about(0, math.radians(rx))
    )
    (line,) = body_of(program(MoveL(Pose(rotation, (1, 2, 3)), 20.0)))
    assert (
        line
        == "Move L, @0 P(1.000, 2.000, 3.000, 25.0000, -40.0000, 110.0000, -1), Speed = Mps(20 * unit)"
    )


def test_posture_without_a_joint_move_is_said_to_be_open() -> None:
    plan = Program("a", WORK, TOOL, (MoveJ(down(0, 0), 10.0),))
    assert "' posture: that of the arm at the start\n" in text_of(plan)


def test_whole_millimetres_as_pass_marks() -> None:
    plan = program(MoveL(down(1, 0), 20.0, 5.0), MoveL(down(2, 0), 20.0))
    marks = [line.split()[2] for line in body_of(plan, pass_mark="mm")]
    assert marks == ["@5", "@0"]
    assert read({"a": text_of(plan, pass_mark="mm")}, {}).body[2].blend == 5.0


def test_speed_in_percent_of_what_the_external_speed_leaves() -> None:
    # 30 mm/s of 1500 at an external 50 %: internal 4 %.
    plan = program(MoveL(down(1, 0), 30.0))
    options = {"speed": "percent", "rated": 1500.0, "ext_speed": 50.0}
    text = text_of(plan, **options)
    assert "    TakeArm Keep = 0\n    ExtSpeed 50\n    Speed 10\n    Accel 50, 50\n" in text
    assert body_of(plan, **options)[-1].endswith(", -1), Speed = 4")
    assert read({"a": text}, {"rated": 1500.0}).body[-1].speed == pytest.approx(30.0)


@given(st.floats(0.05, 5000.0), st.sampled_from([0.0, 30.0]))
def test_written_speed_is_exact_to_a_thousandth(speed: float, external: float) -> None:
    for mps, metres in (("ask", 1), ("mm/s", 1), ("m/s", 1000)):
        (line,) = body_of(program(MoveL(down(1, 0), speed)), ext_speed=external, mps=mps)
        written = (
            float(re.search(r"Mps\(([0-9.]+)( \* unit)?\)$", line)[1])
            * metres
            * (external or 100)
            / 100
        )
        assert written == pytest.approx(speed, rel=1e-3)


def test_splits_into_subs_at_stops() -> None:
    body = [MoveL(down(i, 0), 20.0, 0.0 if i % 7 == 0 else 1.0) for i in range(1, 29)]
    plan = program(*body)
    text = text_of(plan, max_lines=12)
    main, *subs = re.split(r"^Sub ", text, flags=re.MULTILINE)[1:]
    names = [sub.split("(")[0] for sub in subs]
    assert names == [f"bracket_part{i}" for i in range(1, len(subs) + 1)]
    assert [line.split()[1] for line in main.splitlines() if "Call" in line] == [
        f"{name}(unit)" for name in names
    ]
    for sub in subs:
        lines = sub.splitlines()[1:-1]
        assert len(lines) <= 12
        assert "@0 " in lines[-1]
    assert_same(plan, read({"bracket.pcs": text}, {}), PacScript())


def test_splits_without_a_stop_where_there_is_none() -> None:
    plan = program(*(MoveL(down(i, 0), 20.0, 1.0) for i in range(1, 30)), MoveL(down(30, 0), 20.0))
    text = text_of(plan, max_lines=10)
    assert text.count("Call ") == 4  # 32 lines: 10 + 10 + 10 + 2
    assert_same(plan, read({"bracket.pcs": text}, {}), PacScript())


@pytest.mark.parametrize(
    ("name", "file"),
    [
        ("gear plate-1", "gear_plate_1.pcs"),
        ("12mm", "job_12mm.pcs"),
        ("Move", "job_Move.pcs"),
        ("über", "job__ber.pcs"),
        ("", "job_.pcs"),
        ("x" * 100, "x" * 60 + ".pcs"),
    ],
)
def test_file_name_is_one_that_the_controller_takes(name: str, file: str) -> None:
    (made,) = PacScript().render(program(name=name))
    assert made.name == file
    assert re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,63}\.pcs", made.name)


@given(st.text(max_size=200), st.text(max_size=200), st.text(max_size=50))
def test_no_text_leaves_its_comment(comment: str, header: str, name: str) -> None:
    plan = program(Comment(comment), MoveL(down(1, 0), 20.0), name=name, header=(header,))
    text = text_of(plan)
    assert text.isascii()
    assert "\r" not in text
    assert max(map(len, text.splitlines())) <= 1024
    assert_same(plan, read({"a.pcs": text}, {}), PacScript())


def test_cell_is_within_the_reach_of_the_arm() -> None:
    # VS-060: shoulder 345 mm up, upper arm 305, forearm hypot(300, 10), wrist to flange 70, tool 100 straight down.
    cell = PacScript.cell()
    elbow = math.hypot(300, 10)
    closest = math.sqrt(305**2 + elbow**2 - 2 * 305 * elbow * math.cos(math.pi - math.radians(155)))
    for x in (0, 200):
        for y in (0, 150):
            for z in (0, 20):
                px, py, pz = cell.base_from_work.apply((x, y, z))
                wrist = math.hypot(px, py, pz + 170 - 345)
                assert closest + 50 < wrist < 305 + elbow - 50
    assert cell.flange_from_tool.origin == (0.0, 0.0, 100.0)
    assert [round(math.degrees(v)) for v in cell.home.values] == [0, 0, 90, 0, 30, 0]


# -- the post: what it refuses, gives up or lowers ---------------------------------------------------------------------


@pytest.mark.parametrize(
    ("item", "options", "index", "message"),
    [
        # A signal that the post does not have is refused where it is put off first.
        (
            Output("coolant", 1.0),
            {},
            0,
            "the signal coolant has no IO number; add it to post.signals",
        ),
        (Output("process", 0.5), {}, 3, "an IO is on or off, not 0.5; use 0 or 1"),
        (
            Output("spindle", 9000.0),
            {"signals": {"spindle": 25}},
            0,
            'an IO does not carry a spindle speed; set the speed at its drive and post.spindle to "on-off"',
        ),
        (Wait(3e6), {}, 2, "the wait is longer than a Delay holds; shorten it"),
        (
            MoveL(down(1, 0), 0.01),
            {},
            2,
            "0.01 mm/s is too slow to be written to 0.1 %; raise the speed",
        ),
        (
            MoveL(down(1, 0), 120.0),
            {"rated": 100.0},
            2,
            "120 mm/s is 120 % of the rated 100 mm/s, the controller takes 0.1 to 100 %; "
            "change the speed or correct post.rated",
        ),
        (
            MoveL(down(1, 0), 20.0),
            {"speed": "percent", "rated": 8e4},
            2,
            "20 mm/s is 0.025 % of the rated 80000 mm/s, the controller takes 0.1 to 100 %; "
            "change the speed or correct post.rated",
        ),
        (
            MoveJ(Joints((0.0,) * 4), 100.0),
            {},
            2,
            "J() of 4 axes: four-axis arms slide on axis 3, J() ends with 8; "
            "give a pose, or the angles of an arm that only turns",
        ),
        (
            Force(10.0, (0.0, 1.0, 0.0)),
            {},
            3,
            "the arguments of force control are not public; "
            'check post.force_on and set post.force to "template", or to "ignore"',
        ),
        (
            Force(10.0),
            {"force": "template"},
            3,
            "the force has no direction; follow one side of the contour",
        ),
        (
            Force(6000.0, (1.0, 0.0, 0.0)),
            {"force": "template"},
            3,
            "6000 N is more than the 5000 N of a force table; lower the force",
        ),
    ],
)
def test_refusal_names_index_reason_and_remedy(
    item: Instruction, options: dict[str, object], index: int, message: str
) -> None:
    plan = program(item, Force(0.0)) if isinstance(item, Force) else program(item)
    with pytest.raises(Refused) as error:
        make_post(PacScript, options).prepare(plan, 0.01)
    assert str(error.value) == f"pacscript: {message} (instruction {index})"


def test_fractional_pass_mark_is_refused_in_millimetres() -> None:
    plan = program(MoveL(down(1, 0), 20.0, 0.3), MoveL(down(2, 0), 20.0))
    with pytest.raises(
        Refused, match=r'0.3 mm is not a whole number; set post.pass_mark to "P" \(instruction 2\)'
    ):
        PacScript(pass_mark="mm").prepare(plan, 0.01)


def test_three_points_on_a_line_are_no_arc() -> None:
    with pytest.raises(
        Refused,
        match=r"the three points of the arc are on one line \(instruction \d+\); give the arc a via point",
    ):
        PacScript().prepare(
            program(MoveL(down(0, 0), 20.0), MoveC(down(1, 0), down(2, 0), 20.0)), 0.01
        )


def test_arc_from_joints_is_refused() -> None:
    plan = Program("a", WORK, TOOL, (MoveJ(HOME, 10.0), MoveC(down(1, 1), down(2, 0), 20.0)))
    with pytest.raises(
        Refused, match=r"an arc starts where the text gives no pose; move to a pose first"
    ):
        PacScript().prepare(plan, 0.01)


@pytest.mark.parametrize("option", ["tool", "work"])
def test_frame_that_the_controller_fixes_must_be_meant(option: str) -> None:
    with pytest.raises(
        Refused, match=f"{option} 0 is the controller's own, .*; give post.{option} from 1 on"
    ):
        make_post(PacScript, {option: 0}).prepare(program(), 0.01)
    own = Program("a", translation(0, 0, 0), translation(0, 0, 0), (MoveJ(HOME, 10.0),))
    assert f"Change{option.title()} 0\n" in text_of(own, **{option: 0})


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"speed": "percent"},
            '[post] speed = "percent": needs rated; give the arm\'s speed at 100 % in mm/s',
        ),
        ({"tool": 64}, "[post] tool: is 64; give 0 to 63"),
        ({"accel": math.nan}, "[post] accel: is nan; give 0.0001 to 100"),
        (
            {"define": True, "tool": 0},
            "[post] define: cannot define tool 0 or work 0; give tool and work from 1 on",
        ),
        (
            {"program": "2nd"},
            "[post] program: 2nd cannot name a program; a letter, then letters, digits and _, at most 64, "
            "no word of the language",
        ),
        (
            {"signals": {"process": 24, "coolant": 24}},
            "[post] signals: two signals share an IO, or one is negative; one IO per signal",
        ),
        (
            {"signals": {"process": 24064}},
            "[post] signals: IO 24064 must be at most 24063; give an IO of the controller",
        ),
        (
            {"ext_speed": 1e-6},
            "[post] ext_speed: must be 0, or 0.0001 to 100, not 1e-06; "
            "smaller ones are printed as 0",
        ),
        (
            {"force_on": ["Press {newtons}"]},
            "[post] force_on: has the places ['newtons']; use ['x', 'y', 'z'], of ['n', 'newtons', 'x', 'y', 'z']",
        ),
        ({"force_off": ["Off {n:3}"]}, "[post] force_off: has the places ['n']; use [], of ['n']"),
        (
            {"force_off": ["Off {"]},
            "[post] force_off: has a brace without its other half; write {{ for a brace",
        ),
        ({"force_off": ["Off {x}"]}, "[post] force_off: has the places ['x']; use [], of ['n']"),
        (
            {"force_off": []},
            "[post] force_off: must be lines of ASCII text; give one list item per line",
        ),
        (
            {"force_off": ["a\nb"]},
            "[post] force_off: must be lines of ASCII text; give one list item per line",
        ),
        ({"pass_mark": "Q"}, "[post] pass_mark: Invalid enum value 'Q'"),
    ],
)
def test_option_that_cannot_be_meant(options: dict[str, object], message: str) -> None:
    with pytest.raises(JobError) as error:
        make_post(PacScript, options)
    assert str(error.value) == message


def test_line_that_is_too_long_is_refused() -> None:
    template = ["Call Press({x}, {y}, {z}) " + "x" * 1000]
    post = PacScript(force="template", force_on=template)
    plan = program(Force(1.0, (1.0, 0.0, 0.0)), Force(0.0))
    with pytest.raises(
        Refused, match=r"a line of 10[0-9][0-9] bytes, the controller takes 1024; shorten it"
    ):
        post.render(post.prepare(plan, 0.01))


def test_spindle_as_on_and_off_keeps_its_speed_as_a_remark() -> None:
    plan = program(Output("spindle", 9000.0), MoveL(down(1, 0), 20.0), Output("spindle", 0.0))
    options = {"signals": {"process": 24, "spindle": 25}, "spindle": "on-off"}
    lines = body_of(plan, **options)
    assert lines[:2] == ["' spindle at 9000 rpm: set at its drive", "Set IO[25]"]
    assert lines[-1] == "Reset IO[25]"
    prepared = make_post(PacScript, options).prepare(plan, 0.01)
    assert [item.value for item in prepared.body if isinstance(item, Output)] == [0.0, 1.0, 0.0]


def arc(radius: float, sweep: float, force: float = 0.0) -> tuple[MoveL, MoveC]:
    """A line to (0, 0) and an arc from there, anticlockwise about (-radius, 0)."""
    press = (1.0, 0.0, 0.0) if force else (0.0, 0.0, 0.0)
    via, end = (down(radius * (math.cos(a) - 1), radius * math.sin(a)) for a in (sweep / 2, sweep))
    return MoveL(down(0, 0), 20.0, 0.0, force, press), MoveC(via, end, 20.0, 0.0, force, press)


@pytest.mark.parametrize(
    ("radius", "degrees", "kinds"),
    [
        (10.0, 90.0, ["C"]),
        (10.0, 180.0, ["C"]),
        (10.0, 200.0, ["C", "C"]),
        (0.08, 90.0, None),
        (5000.0, 0.2, None),
    ],
)
def test_arcs_that_the_controller_may_not_take_are_lowered(
    radius: float, degrees: float, kinds: list[str] | None
) -> None:
    lines = body_of(program(*arc(radius, math.radians(degrees))))[1:]
    found = [line.split()[1].rstrip(",") for line in lines]
    assert found == kinds if kinds else set(found) == {"L"}


def test_arc_that_turns_the_tool_by_half_a_turn_is_halved() -> None:
    line, turn = arc(10.0, math.radians(180.0))
    half, whole = (frozen(rotation_about(2, angle) @ TOOL_DOWN) for angle in (math.pi / 2, math.pi))
    turned = replace(turn, via=Pose(half, turn.via.origin), target=Pose(whole, turn.target.origin))
    prepared = PacScript().prepare(program(line, turned), 0.01)
    assert [type(item) for item in prepared.body[3:]] == [MoveC, MoveC]


# -- force -------------------------------------------------------------------------------------------------------------


def pressed() -> Program:
    """A force of 10 N, first along +y, then turned by 30 deg and lowered to 8 N, then off contact."""
    turned = (-math.sin(math.radians(30)), math.cos(math.radians(30)), 0.0)
    return program(
        Force(10.0, (0.0, 1.0, 0.0)),
        MoveL(down(10, 0), 20.0, 1.0, 10.0, (0.0, 1.0, 0.0)),
        MoveL(down(20, 0), 20.0, 1.0, 10.0005, (0.0, 1.0, 0.0)),
        MoveL(down(30, 5), 20.0, 1.0, 8.0, turned),
        MoveL(down(40, 10), 20.0, 0.0),
        Force(0.0),
        MoveL(down(40, 10, 20), 100.0),
    )


def test_force_is_written_where_it_changes() -> None:
    lines = [line for line in body_of(pressed(), force="template") if not line.startswith("Move")]
    assert lines == [
        "ForceParam 1, 2, P(0.000, 10.000, 0.000, 0, 0, 0) ' verify",
        "ForceCtrl True, 1 ' verify",
        "ForceParam 1, 2, P(-4.000, 6.928, 0.000, 0, 0, 0) ' verify",  # 8 N x (-1/2, sqrt(3)/2)
        "ForceParam 1, 2, P(0.000, 0.000, 0.000, 0, 0, 0) ' verify",
        "ForceCtrl False ' verify",
    ]
    moves = body_of(pressed(), force="template")
    assert moves[2].startswith("Move L, @P P(10.000,")
    assert moves[4].startswith("ForceParam")
    assert moves[5].startswith("Move L, @P P(30.000,")


def test_default_force_lines_read_back_by_what_they_mean() -> None:
    text = text_of(pressed(), force="template")
    reading = read({"a": text}, {})
    assert_same(pressed(), reading, PacScript(force="template"))
    assert reading.body[0] == Force(0.0)
    assert reading.body[3] == Force(10.0, (0.0, 1.0, 0.0))
    last = reading.body[6]
    assert isinstance(last, MoveL)
    assert last.force == pytest.approx(8.0, abs=1e-3)
    assert last.force_direction == pytest.approx((-0.5, math.sqrt(3) / 2, 0.0), abs=1e-4)


OWN = {
    "force": "template",
    "force_table": 4,
    "force_on": ["' our cell", "Call PressOn({n}, -({x}), -({y}), -({z}))", "Delay 200"],
    "force_change": ["Call PressTo({newtons}, {x}, {y}, {z})"],
    "force_off": ["Call  PressOff ' up"],
}


def test_own_template_is_written_and_read() -> None:
    text = text_of(pressed(), **OWN)
    assert "    Call PressOn(4, -(0.000), -(10.000), -(0.000))\n    Delay 200\n" in text
    assert "    Call PressTo(8.000, -4.000, 6.928, 0.000)\n" in text
    assert_same(pressed(), read({"a": text}, OWN), make_post(PacScript, OWN))
    assert read(
        {"a": text}, {}
    ).findings  # without the template these are calls of what the text does not have


def test_own_template_with_wrong_newtons_is_a_fault() -> None:
    text = text_of(pressed(), **OWN).replace("PressTo(8.000", "PressTo(9.000")
    (fault,) = read({"a": text}, OWN).findings
    assert fault.what == "the newtons of a force line are not those of its vector"
    assert "PressTo(9" in text.splitlines()[fault.line - 1]


def test_force_ignored_leaves_no_trace_and_the_prepared_program_says_so() -> None:
    post = PacScript(force="ignore")
    prepared = post.prepare(pressed(), 0.01)
    assert not any(isinstance(item, Force) for item in prepared.body)
    assert not any(
        isinstance(item, MoveL) and (item.force or any(item.force_direction))
        for item in prepared.body
    )
    text = text_of(pressed(), force="ignore")
    assert "Force" not in text
    assert_same(prepared, read({"a": text}, {}), post)


def test_pressing_arc_becomes_lines_whose_force_turns() -> None:
    line, bend = arc(10.0, math.radians(90.0), 10.0)
    plan = program(
        Force(10.0, (1.0, 0.0, 0.0)),
        line,
        replace(bend, force_direction=(0.0, 1.0, 0.0)),
        Force(0.0),
    )
    post = PacScript(force="template")
    prepared = post.prepare(plan, 0.01)
    lines = [item for item in prepared.body if isinstance(item, MoveL)][1:]
    assert len(lines) > 5
    for item in lines:
        x, y = item.target.origin[0] + 10, item.target.origin[1]
        assert item.force_direction == pytest.approx(
            (x / 10, y / 10, 0.0), abs=1e-9
        )  # away from the centre (-10, 0)
    (file,) = post.render(prepared)
    assert_same(prepared, read({"a": file.text}, {}), post)


# -- round trip --------------------------------------------------------------------------------------------------------

coordinate = st.floats(-900.0, 900.0)
speed = st.floats(0.1, 2000.0)
angle = st.one_of(
    st.sampled_from([-180.0, -90.0, -1e-4, 0.0, 1e-7, 45.0, 90.0, 180.0]), st.floats(-180.0, 180.0)
)


@st.composite
def rotations(draw: st.DrawFn) -> Pose:
    """An orientation: free, or by angles among which the degenerate ones are frequent."""
    if draw(st.booleans()):
        return pose_from_values((0, 0, 0, draw(angle), draw(angle), draw(angle)))
    quaternion = draw(
        st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda q: sum(v * v for v in q) > 1e-3)
    )
    return Pose(rotation_from_quaternion(quaternion), (0.0, 0.0, 0.0))


@st.composite
def poses(draw: st.DrawFn) -> Pose:
    return Pose(draw(rotations()).rotation, (draw(coordinate), draw(coordinate), draw(coordinate)))


@st.composite
def arcs(draw: st.DrawFn) -> list[Instruction]:
    """A line to the start of an arc in any plane, and the arc; the tool turns by less than 90 deg along it."""
    centre, radius = draw(poses()), 10 ** draw(st.floats(-1.5, 3.0))
    sweep = math.radians(draw(st.floats(0.5, 180.0)))
    first = draw(rotations()).rotation
    turn = rotation_about_axis(first[:, 2], draw(st.floats(-1.5, 1.5)))
    start, via, end = (
        centre.apply((radius * math.cos(a), radius * math.sin(a), 0.0))
        for a in (0.0, sweep / 2, sweep)
    )
    return [
        MoveL(Pose(first, start), draw(speed)),
        MoveC(Pose(first, via), Pose(turn @ first, end), draw(speed)),
    ]


@st.composite
def turns(draw: st.DrawFn) -> list[Instruction]:
    """A line, and a turn where it ends, by any angle or by hardly one, at 0.1 to 100 % of 500 deg/s."""
    there, rate = draw(poses()), math.radians(draw(st.floats(0.5, 500.0)))
    little = rotation_about(2, draw(st.sampled_from([1e-12, 1e-7, 1e-3]))) @ there.rotation
    end = draw(st.one_of(rotations().map(lambda pose: pose.rotation), st.just(frozen(little))))
    return [MoveL(there, draw(speed)), MoveL(Pose(end, there.origin), draw(speed), turn=rate)]


@st.composite
def bodies(draw: st.DrawFn) -> tuple[Instruction, ...]:
    items: list[Instruction] = [MoveJ(HOME, 100.0)]
    joints = st.lists(st.floats(-6.0, 6.0), min_size=6, max_size=8).map(lambda v: Joints(tuple(v)))
    single = st.one_of(
        st.builds(MoveJ, st.one_of(poses(), joints), speed),
        st.builds(MoveL, poses(), speed),
        st.builds(MoveL, poses(), speed, st.sampled_from([0.3, 1.0, 5.0])),
        st.builds(Output, st.just("process"), st.sampled_from([0.0, 1.0])),
        st.builds(Wait, st.floats(0.0, 100.0)),
        st.builds(Comment, st.text(max_size=90)),
    )
    for chunk in draw(
        st.lists(st.one_of(single.map(lambda item: [item]), arcs(), turns()), max_size=12)
    ):
        items += chunk
    items.append(MoveL(down(0, 0), 20.0))
    for i, item in enumerate(items):
        following = next(
            (other for other in items[i + 1 :] if not isinstance(other, Comment)), None
        )
        if isinstance(item, MoveL) and not isinstance(following, (MoveJ, MoveL, MoveC)):
            items[i] = replace(item, blend=0.0)
    return turning(items, 1.0)


OPTIONS: list[dict[str, object]] = [
    {},
    {"decimals": 5, "max_lines": 4, "define": True},
    {"speed": "percent", "rated": 5000.0, "ext_speed": 100.0, "signals": {"process": 3}},
]


@fewer(12)
@given(bodies(), st.sampled_from(OPTIONS))
def test_round_trip(body: tuple[Instruction, ...], options: dict[str, object]) -> None:
    if "rated" in options:
        body = tuple(
            replace(item, speed=max(item.speed, 5.0))
            if isinstance(item, (MoveJ, MoveL, MoveC))
            else item
            for item in body
        )
    post = make_post(PacScript, options)
    assert isinstance(post, PacScript)
    prepared = post.prepare(Program("part", WORK, TOOL, whole(body)), 0.01)
    (file,) = post.render(prepared)
    reading = read({file.name: file.text}, options)
    assert_same(prepared, reading, post)
    assert len(file.text.splitlines()) == file.text.count("\n")


# -- the read-back: hand-written programs ------------------------------------------------------------------------------


def script(*lines: str, before: tuple[str, ...] = ()) -> str:
    """A program that owns the arm and stands at (0, 0, 50), tool down; its first line is line 4 after ``before``."""
    head = (
        *before,
        "Sub Main",
        "TakeArm Keep = 0",
        "Move P, @0 P(0, 0, 50, 180, 0, 0), Speed = Mps(0.1)",
    )
    return "\n".join((*head, *lines, "GiveArm", "End Sub", ""))


#: Programs written by hand mean m/s, unless they are about that, and change no frames.
METRES: dict[str, object] = {"mps": "m/s", "tool": 0, "work": 0}


def reading_of(
    *lines: str, options: dict[str, object] | None = None, before: tuple[str, ...] = ()
) -> Executed:
    return read({"part.pcs": script(*lines, before=before)}, METRES | (options or {}))


def serious(reading: Executed) -> list[tuple[int, str]]:
    """Lines and words of faults that are no remarks."""
    return [(fault.line, fault.what) for fault in reading.findings if fault.level != "unusual"]


def last_motion(reading: Executed) -> MoveJ | MoveL | MoveC:
    assert serious(reading) == []
    item = [item for item in reading.body if isinstance(item, (MoveJ, MoveL, MoveC))][-1]
    assert isinstance(item, (MoveJ, MoveL, MoveC))
    return item


S = ", Speed = Mps(0.1)"
EARLY = "after a motion that passes its target: it may come too early"
NOWHERE = "from a place that the text does not give"
FIRST = "the first motion is not Move P: where it starts is open"


@pytest.mark.parametrize(
    ("lines", "origin"),
    [
        (("Move L, P(1, 2, 3, 180)" + S,), (1, 2, 3)),
        (("move l, @e p( 1.5 , -2 , .5 ), s=mps( 0.1 )",), (1.5, -2, 0.5)),
        (("Move PTP, @0 T(1, 2, 3, 0, -1, 0, 0, 0, -1, 5)" + S,), (1, 2, 3)),
        (("Depart L, @0 30" + S,), (0, 0, 80)),  # the tool points down, so back is up
        (("Depart P, 30" + S,), (0, 0, 80)),
        (("Approach P, P(5, 6, 7, 180), @0 40" + S,), (5, 6, 47)),
        (("Approach L, P(5, 6, 7, 180, 0, 0, -1), 2 * (3 + 4)" + S,), (5, 6, 21)),
        (("Draw L, @0 V(1, -2, 3)" + S,), (1, -2, 53)),
        (
            (
                "Dim a As Position = P(1, 2, 3), b As Integer",
                "b = 7",
                "Move L, @0 a" + S,
                "Draw L, V(b)" + S,
            ),
            (8, 2, 3),
        ),
        (("P[3] = P(4, 5, 6)", "Move L, @0 P3" + S), (4, 5, 6)),
        (("P12 = P(4, 5, 6)", "Move L, @0 P[10 + 2]" + S), (4, 5, 6)),
        (("Move L, @P P(1), @0 P(2, , 4)" + S,), (2, 0, 4)),
        (("Rem Move L, @0 P(9)", "Move L, @0 P(1) " + S + " ' not P(2)"), (1, 0, 0)),
        (
            (
                "Call Go(3, 2 * 2)",
                "End Sub",
                "Sub Go(ByVal a As Integer, b)",
                "Move L, @0 P(a, b)" + S,
            ),
            (3, 4, 0),
        ),
        (
            (
                "Call Go",
                "End Sub",
                "Sub Go()",
                "Move L, @0 P(1)" + S,
                "Exit Sub",
                "Move L, P(2)" + S,
            ),
            (1, 0, 0),
        ),
        (
            ("PrintDbg 5", "Motor On", "Accel 50, 20", "Decel 5", "Move L, P(&B101, &H1F)" + S),
            (5, 31, 0),
        ),
    ],
)
def test_statements_that_move(lines: tuple[str, ...], origin: tuple[float, float, float]) -> None:
    target = last_motion(reading_of(*lines)).target
    assert isinstance(target, Pose)
    assert target.origin == pytest.approx(origin)


def test_homogeneous_position_gives_the_axes() -> None:
    # orient = tool y along -y, approach = tool z down: the tool x is y cross z = +x.
    target = last_motion(reading_of("Move L, T(1, 2, 3, 0, -1, 0, 0, 0, -1)" + S)).target
    assert isinstance(target, Pose)
    assert np.allclose(target.rotation, TOOL_DOWN)


def test_joints_in_degrees_and_several_targets() -> None:
    reading = reading_of("Move P, @P J(90, -45), @5 P(1), @0 J(0, 0, 180)" + S)
    assert serious(reading) == []
    first, second, third = reading.body[1:]
    assert isinstance(first, MoveJ)
    assert isinstance(second, MoveJ)
    assert isinstance(third, MoveJ)
    assert first.target == Joints((math.pi / 2, -math.pi / 4))
    assert third.target == Joints((0.0, 0.0, math.pi))
    assert [first.blend > 0, second.blend, third.blend] == [True, 5.0, 0.0]
    assert reading.lines == (3, 4, 4, 4)


@pytest.mark.parametrize(
    ("lines", "mm_s"),
    [
        (("Move L, P(1), Speed = 40",), 800.0),
        (("Speed 50", "Move L, P(1)"), 1000.0),
        (("Speed 50", "ExtSpeed 10", "Move L, P(1)"), 100.0),
        (("ExtSpeed 10, 5, 5", "Speed 50", "Move L, P(1), S = 20"), 40.0),
        (("ExtSpeed 50", "Move L, P(1), Speed = Mps(0.03)"), 15.0),
        (("Speed Mps(0.02)", "Move L, P(1)"), 20.0),
        (("Move L, P(1)",), 2000.0),
        (("Speed 10", "TakeArm Keep = 1", "Move L, P(1)"), 200.0),
        (("Speed 10", "TakeArm Keep = 0", "Move L, P(1)"), 2000.0),
    ],
)
def test_internal_times_external_speed(lines: tuple[str, ...], mm_s: float) -> None:
    assert last_motion(reading_of(*lines, options={"rated": 2000.0})).speed == pytest.approx(mm_s)


def test_macros_name_numbers_and_text() -> None:
    before = (
        "#Define PEN 24",
        "#define FEED Speed = Mps(0.02)",
        "#Define UP PEN_UP",
        "#Define PEN_UP 5",
    )
    reading = reading_of(
        "Set IO[PEN]", "Move L, @0 P(0, 0, UP), FEED", "Reset io[ pen ]", before=before
    )
    assert serious(reading) == []
    on, move, off = reading.body[1:]
    assert (on, off) == (Output("process", 1.0), Output("process", 0.0))
    assert isinstance(move, MoveL)
    assert (move.target.origin, move.speed) == ((0.0, 0.0, 5.0), 20.0)


def test_outputs_are_named_by_the_signals() -> None:
    reading = reading_of(
        "Set IO[24]", "Set IO[7]", "Delay 1500", options={"signals": {"coolant": 7}}
    )
    assert reading.body[1:] == (Output("IO[24]", 1.0), Output("coolant", 1.0), Wait(1.5))


def test_second_file_is_called_by_its_name_and_lines_go_on() -> None:
    main = script("Call PartA")
    part = "Sub Main\nMove L, @0 P(7)" + S + "\nEnd Sub\n"
    reading = read({"part.pcs": main, "PartA.pcs": part}, METRES)
    assert serious(reading) == []
    assert reading.lines == (3, main.count("\n") + 2)


@pytest.mark.parametrize(
    ("lines", "line", "what"),
    [
        (("Frobnicate 5",), 4, "unknown statement Frobnicate 5"),
        (("Payload 1000, V(0, 0, 50), V(0, 0, 0)",), 4, "Payload is not evaluated"),
        (("Drive (1, 10)",), 4, "Drive is not evaluated"),
        (("Wait IO[3] = On",), 4, "Wait is not evaluated"),
        (("If IO[1] = On Then", "Set IO[24]", "End If"), 4, "If is not evaluated, up to line 6"),
        (("If IO[1] = On Then Set IO[24]",), 4, "If is not evaluated"),
        (("For i = 1 To 3", "For j = 1 To 3", "Next", "Next i"), 4, "For is not evaluated, up to line 7"),
        (("Do While 1", "Loop"), 4, "Do is not evaluated, up to line 5"),
        (("Select Case x", "Case 1", "End Select"), 4, "Select is not evaluated, up to line 6"),
        (("If x Then",), 4, "If has no End If"),
        (("GoTo *a",), 4, "GoTo is not evaluated"),
        (("*a:",), 4, "unknown statement *a:"),
        (("Move S, 1",), 4, "Move S is not evaluated"),
        (("Move L, @0 home" + S,), 4, "unknown name home"),
        (("Move L, @0 P[4]" + S,), 4, "P[4] is not set in the text"),
        (("Move L, @0 P(1) Ex((7, 10))" + S,), 4, "extended axes are not evaluated"),
        (("Move L, @0 J(1, 2)" + S,), 4, "a straight line to joints is not evaluated"),
        (("Move L, @Q P(1)" + S,), 4, "the pass mark of @Q P(1) is not understood"),
        (("Move L" + S,), 4, "a motion without a target"),
        (("Move L, P(1), Speed = 0.05",), 4, "a speed of 0.05 %, the controller takes 0.1 to 100"),
        (("Move L, P(1), Speed = 101",), 4, "a speed of 101 %, the controller takes 0.1 to 100"),
        (("Move L, P(1), Speed = 50",), 4, "a speed in percent, taken of 1000 mm/s; give the option rated"),
        (("Speed 0",), 4, "a speed of 0 %, the controller takes 0.1 to 100"),
        (("Move L, P(1e999)" + S,), 4, "a number is too large"),
        (("Move L, P(1/0)" + S,), 4, "a division by zero"),
        (("Move L, CurPos" + S,), 4, "unknown name curpos"),
        (("Move L, Dev(P(1), P(2))" + S,), 4, "the function dev is not evaluated"),
        (("Move C, P(1, 1, 50), @0 P(2, 2, 50)" + S,), 4, "the three points of the arc are on one line"),
        (("Move C, P(1, 1, 50), @0 P(0, 0.1, 50)" + S,), 4, "an arc of more than 180 deg"),
        (("Move C, P(1, 1, 50)" + S,), 4, "Move C has 1 point instead of two"),
        (("Move P, J(1)" + S, "Move C, P(1, 1, 50), P(2, 0, 50)" + S), 5, f"an arc {NOWHERE}"),
        (("Move P, J(1)" + S, "Depart L, 5" + S), 5, f"a motion {NOWHERE}"),
        (("Move L, @P P(1)" + S, "Set IO[24]"), 5, f"an output {EARLY}"),
        (("Move L, @P P(1)" + S, "Delay 5"), 5, f"a delay {EARLY}"),
        (("Move L, P(1)" + S + ", Next", "Set IO[24]"), 5, f"an output {EARLY}"),
        (("Move L, @P P(1)" + S,), 4, "the last motion passes its target"),
        (("IO[24] = On",), 4, "unknown statement IO[24] = On"),
        (("Set IO[24], 500",), 4, "an output of IO[24], 500 is not evaluated"),
        (("Set IO[-1]",), 4, "-1 is not an index"),
        (("Delay -5",), 4, "a negative delay"),
        (("GiveArm", "Move L, P(1)" + S), 5, "a motion without TakeArm"),
        (("Call Nobody",), 4, "unknown procedure Nobody"),
        (("ChangeTool 3",), 4, "the tool frame changes after the first motion"),
        (("Work 0, P(1)",), 4, "the work frame changes after the first motion"),
        (("ForceParam 1, 2, P(0, 5)", "ForceCtrl True, 2"), 5, "the force table 2 is not set in the text"),
        (("ForceParam 1, 1, P(0, 5)",), 4, "a force outside the work frame is not evaluated"),
        (("ForceParam 1, 2, P(0, 5), Rate = P(1)",), 4, "ForceParam with options is not evaluated"),
        (("ForceParam 1, 2, P(0, 5)", "ForceCtrl True, 1"), 6, "force control is on at the end"),
        (("' " + "x" * 1023,), 4, "a line of more than 1024 bytes"),
        (("Sub Other",), 4, "Sub Other begins inside another procedure"),
        (("#Include \"a.h\"",), 4, "#Include is not evaluated"),
        (("#Define A A", "Move L, P(A)" + S), 5, "a macro that refers to itself or grows without end"),
        (("Move L, P(" + "(" * 300 + "1" + ")" * 301 + S,), 4, "brackets nested too deep"),
    ],
)  # fmt: skip
def test_fault_with_its_line(lines: tuple[str, ...], line: int, what: str) -> None:
    faults = serious(reading_of(*lines))
    assert (line, what) in faults
    assert len(faults) == 1 or what.endswith("another procedure")


@pytest.mark.parametrize(
    ("text", "line", "what"),
    [
        ("", 1, "there is no Sub Main"),
        ("Move L, P(1)\n", 1, "a statement outside a procedure"),
        ("Sub Main\nTakeArm\n", 1, "the procedure has no end"),
        ("End Sub\n", 1, "End Sub closes nothing"),
        ("Sub Main\nEnd Sub\nSub main\nEnd Sub\n", 3, "a second procedure main"),
        ("Sub Main\nTakeArm\nMove L, P(1), Speed = Mps(1)\nEnd Sub\n", 3, FIRST),
        ("Sub Main\nMove P, P(1), Speed = Mps(1)\nEnd Sub\n", 2, "a motion without TakeArm"),
        ("Sub Main\nCall Main\nEnd Sub\n", 2, "procedures that call each other without end"),
    ],
)  # fmt: skip
def test_fault_of_the_frame_of_a_program(text: str, line: int, what: str) -> None:
    assert (line, what) in [
        (fault.line, fault.what) for fault in read({"a.pcs": text}, {}).findings
    ]


def test_calls_that_multiply_come_to_an_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("camgen.lang.pacscript.strict._STEPS", 5000)
    subs = (
        "".join(f"Sub s{i}\n" + f"Call s{i + 1}\n" * 10 + "End Sub\n" for i in range(15))
        + "Sub s15\nEnd Sub\n"
    )
    reading = read({"a.pcs": "Sub Main\nCall s0\nEnd Sub\n" + subs}, {})
    assert "more statements than a program can have" in {fault.what for fault in reading.findings}


# -- the read-back: anything at all ------------------------------------------------------------------------------------

WORDS = [
    "Move", "P", "L", "C", ",", "@0", "@P", "P(", "J(", "V(", ")", "[", "]", "=", "Speed", "Mps(", "1e9", "-", "'",
    '"', "Sub", "End Sub", "Call", "If", "Then", "For", "Next", "#Define", "Dim", "As", "IO[24]", "Set", "Delay",
    "ForceParam", "ForceCtrl", "True", "TakeArm", "Keep", "Work", "Tool", "\n", "\r", "\x0b", "0", "7", "&H", ".", "*",
    "/", "T(", "\0",
]  # fmt: skip


@given(st.data())
def test_damaged_program_never_ends_in_an_exception(data: st.DataObject) -> None:
    text = text_of(pressed(), force="template", max_lines=4, define=True)
    for _ in range(data.draw(st.integers(1, 6))):
        at = data.draw(st.integers(0, len(text)))
        end = data.draw(st.integers(at, min(len(text), at + 40)))
        patch = data.draw(
            st.one_of(
                st.text(max_size=6), st.lists(st.sampled_from(WORDS), max_size=5).map(" ".join)
            )
        )
        text = text[:at] + patch + text[end:]
    reading = read({"a.pcs": text}, OWN if data.draw(st.booleans()) else {})
    assert len(reading.body) == len(reading.lines)
    assert all(1 <= fault.line <= text.count("\n") + 1 for fault in reading.findings)


@given(st.lists(st.sampled_from(WORDS), max_size=60).map(" ".join))
def test_words_in_any_order_never_end_in_an_exception(text: str) -> None:
    reading = read({"a.pcs": f"Sub Main\nTakeArm\n{text}\nEnd Sub\n"}, {})
    assert len(reading.body) == len(reading.lines)


@given(st.dictionaries(st.sampled_from(["rated", "signals", "force_on", "force_off"]), st.one_of(
    st.none(), st.integers(), st.text(max_size=5), st.lists(st.text(max_size=5), max_size=2),
    st.dictionaries(st.text(max_size=3), st.one_of(st.integers(), st.text(max_size=3)), max_size=2))))  # fmt: skip
def test_options_of_any_kind_are_survived(options: dict[str, object]) -> None:
    reading = read({"a.pcs": SMALL}, options)
    assert len(reading.body) == len(reading.lines)


def foreign() -> Iterator[Path]:
    if SHARED.is_dir():
        yield from sorted(path for path in (SHARED / "data" / "robot").rglob("*") if path.is_file())


@pytest.mark.skipif(
    not SHARED.is_dir(), reason="the shared data folder beside the repository is absent"
)
def test_programs_of_other_makers_are_faults() -> None:
    paths = list(foreign())
    assert paths
    for path in paths:
        reading = read({path.name: path.read_text(encoding="latin-1")}, {})
        assert reading.findings, path
        assert reading.body == ()
