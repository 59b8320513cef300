"""PacScript: texts written by hand, refused programs and options, and generated programs."""

import math
import re
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from camgen_posts.pacscript import PacScript
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from camgen.lang.pacscript.strict import read
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
from tests.support.pacscript_programs import (
    HOME,
    SMALL,
    TOOL,
    WORK,
    assert_same,
    down,
    line_and_arc,
    print_body,
    print_text,
    program,
)
from tests.support.whole import turning, whole


def small_program() -> Program:
    # The tool points straight down and tool x is along work y: Rz(90) Rx(180).
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


def test_the_text_of_a_small_program_is_the_expected_one() -> None:
    (file,) = PacScript().render(small_program())
    assert file.name == "bracket.pcs"
    assert file.text == SMALL
    assert PacScript.newline == "\r\n"


def test_the_expected_text_is_read_back() -> None:
    reading = read({"bracket.pcs": SMALL}, {})
    assert_same(small_program(), reading, PacScript())
    assert reading.lines == (10, 25, 26, 27, 29, 30, 31, 32, 33, 34)
    assert reading.work is None
    assert reading.tool is None


def test_line_ends_of_the_file_make_no_difference() -> None:
    lf, crlf = (read({"a.pcs": text}, {}) for text in (SMALL, SMALL.replace("\n", "\r\n")))
    assert (crlf.lines, crlf.findings) == (lf.lines, ())


def test_the_page_shows_the_expected_text_and_every_option() -> None:
    page = (Path(__file__).parents[2] / "docs" / "posts" / "pacscript.md").read_text(
        encoding="utf-8"
    )
    assert SMALL in page
    assert [f.name for f in fields(PacScript) if f.init and f"`{f.name}`" not in page] == []


def test_defined_frames_are_written_and_read() -> None:
    text = print_text(program(), define=True, tool=3, work=2)
    assert "    Tool 3, P(0.000, 0.000, 100.000, 0.0000, 0.0000, 0.0000)\n" in text
    assert (
        "    Work 2, P(300.000, -75.000, 150.000, 0.0000, 0.0000, 90.0000)\n"
        "    ChangeTool 3\n    ChangeWork 2\n"
    ) in text
    assert "' tool 3 is set below to: " in text
    reading = read({"a.pcs": text}, {})
    assert reading.work is not None
    assert reading.work.origin == (300.0, -75.0, 150.0)
    assert np.allclose(reading.work.rotation @ [1, 0, 0], [0, 1, 0])
    assert reading.tool is not None
    assert reading.tool.origin == (0.0, 0.0, 100.0)


def test_an_orientation_is_rz_ry_rx_in_degrees() -> None:
    rx, ry, rz = 25.0, -40.0, 110.0
    rotation = (
        rotation_about(2, math.radians(rz))
        @ rotation_about(1, math.radians(ry))
        @ rotation_about(0, math.radians(rx))
    )
    (line,) = print_body(program(MoveL(Pose(rotation, (1, 2, 3)), 20.0)))
    assert line == (
        "Move L, @0 P(1.000, 2.000, 3.000, 25.0000, -40.0000, 110.0000, -1), Speed = Mps(20 * unit)"
    )


def test_the_posture_without_a_joint_motion_is_stated_as_open() -> None:
    plan = Program("a", WORK, TOOL, (MoveJ(down(0, 0), 10.0),))
    assert "' posture: that of the arm at the start\n" in print_text(plan)


def test_a_blend_may_be_a_pass_mark_in_whole_millimetres() -> None:
    plan = program(MoveL(down(1, 0), 20.0, 5.0), MoveL(down(2, 0), 20.0))
    marks = [line.split()[2] for line in print_body(plan, pass_mark="mm")]
    assert marks == ["@5", "@0"]
    assert read({"a": print_text(plan, pass_mark="mm")}, {}).body[2].blend == 5.0


def test_a_speed_in_percent_is_a_part_of_the_external_speed() -> None:
    # At an external speed of 50 %, 30 of 1500 mm/s are an internal speed of 4 %.
    plan = program(MoveL(down(1, 0), 30.0))
    options = {"speed": "percent", "rated": 1500.0, "ext_speed": 50.0}
    text = print_text(plan, **options)
    assert "    TakeArm Keep = 0\n    ExtSpeed 50\n    Speed 10\n    Accel 50, 50\n" in text
    assert print_body(plan, **options)[-1].endswith(", -1), Speed = 4")
    assert read({"a": text}, {"rated": 1500.0}).body[-1].speed == pytest.approx(30.0)


@given(st.floats(0.05, 5000.0), st.sampled_from([0.0, 30.0]))
def test_a_printed_speed_is_exact_to_a_thousandth(speed: float, external: float) -> None:
    for mps, metres in (("ask", 1), ("mm/s", 1), ("m/s", 1000)):
        (line,) = print_body(program(MoveL(down(1, 0), speed)), ext_speed=external, mps=mps)
        number = float(re.search(r"Mps\(([0-9.]+)( \* unit)?\)$", line)[1])
        printed = number * metres * (external or 100) / 100
        assert printed == pytest.approx(speed, rel=1e-3)


def test_a_long_program_is_split_into_subs_at_stops() -> None:
    body = [MoveL(down(i, 0), 20.0, 0.0 if i % 7 == 0 else 1.0) for i in range(1, 29)]
    plan = program(*body)
    text = print_text(plan, max_lines=12)
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


def test_a_long_program_without_a_stop_is_split_too() -> None:
    plan = program(*(MoveL(down(i, 0), 20.0, 1.0) for i in range(1, 30)), MoveL(down(30, 0), 20.0))
    text = print_text(plan, max_lines=10)
    assert text.count("Call ") == 4  # 32 lines: 10 + 10 + 10 + 2
    assert_same(plan, read({"bracket.pcs": text}, {}), PacScript())


@pytest.mark.parametrize(
    ("name", "file_name"),
    [
        ("gear plate-1", "gear_plate_1.pcs"),
        ("12mm", "job_12mm.pcs"),
        ("Move", "job_Move.pcs"),
        ("über", "job__ber.pcs"),
        ("", "job_.pcs"),
        ("x" * 100, "x" * 60 + ".pcs"),
    ],
)
def test_a_file_gets_a_name_that_the_controller_takes(name: str, file_name: str) -> None:
    (file,) = PacScript().render(program(name=name))
    assert file.name == file_name
    assert re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,63}\.pcs", file.name)


@given(st.text(max_size=200), st.text(max_size=200), st.text(max_size=50))
def test_no_comment_becomes_a_statement(comment: str, header: str, name: str) -> None:
    plan = program(Comment(comment), MoveL(down(1, 0), 20.0), name=name, header=(header,))
    text = print_text(plan)
    assert text.isascii()
    assert "\r" not in text
    assert max(map(len, text.splitlines())) <= 1024
    assert_same(plan, read({"a.pcs": text}, {}), PacScript())


def test_the_built_in_cell_reaches_a_sheet() -> None:
    # VS-060: shoulder at z 345 mm, upper arm 305, forearm hypot(300, 10), wrist to flange 70.
    # The tool is 100 mm long and points straight down.
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


# Refused programs and options, and arcs that become others


@pytest.mark.parametrize(
    ("item", "options", "index", "message"),
    [
        # An unknown signal is refused where it is switched off first.
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
            (
                "an IO does not carry a spindle speed; set the speed at its drive and "
                'post.spindle to "on-off"'
            ),
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
def test_a_refusal_names_index_reason_and_remedy(
    item: Instruction, options: dict[str, object], index: int, message: str
) -> None:
    plan = program(item, Force(0.0)) if isinstance(item, Force) else program(item)
    with pytest.raises(Refused) as error:
        make_post(PacScript, options).prepare(plan, 0.01)
    assert str(error.value) == f"pacscript: {message} (instruction {index})"


def test_a_fractional_blend_is_refused_as_a_pass_mark_in_millimetres() -> None:
    plan = program(MoveL(down(1, 0), 20.0, 0.3), MoveL(down(2, 0), 20.0))
    with pytest.raises(
        Refused, match=r'0.3 mm is not a whole number; set post.pass_mark to "P" \(instruction 2\)'
    ):
        PacScript(pass_mark="mm").prepare(plan, 0.01)


def test_an_arc_through_three_points_on_a_line_is_refused() -> None:
    with pytest.raises(
        Refused,
        match=(
            r"the three points of the arc are on one line \(instruction \d+\); give the arc a "
            r"via point"
        ),
    ):
        PacScript().prepare(
            program(MoveL(down(0, 0), 20.0), MoveC(down(1, 0), down(2, 0), 20.0)), 0.01
        )


def test_an_arc_from_joint_values_is_refused() -> None:
    plan = Program("a", WORK, TOOL, (MoveJ(HOME, 10.0), MoveC(down(1, 1), down(2, 0), 20.0)))
    with pytest.raises(
        Refused, match=r"an arc starts where the text gives no pose; move to a pose first"
    ):
        PacScript().prepare(plan, 0.01)


@pytest.mark.parametrize("option", ["tool", "work"])
def test_frame_0_is_refused_unless_the_plan_has_it(option: str) -> None:
    with pytest.raises(
        Refused, match=f"{option} 0 is the controller's own, .*; give post.{option} from 1 on"
    ):
        make_post(PacScript, {option: 0}).prepare(program(), 0.01)
    at_origin = Program("a", translation(0, 0, 0), translation(0, 0, 0), (MoveJ(HOME, 10.0),))
    assert f"Change{option.title()} 0\n" in print_text(at_origin, **{option: 0})


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
            "[post] program: 2nd cannot name a program; a letter, then letters, digits and "
            "_, at most 64, "
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
            (
                "[post] force_on: has the places ['newtons']; use ['x', 'y', 'z'], of ['n', "
                "'newtons', 'x', 'y', 'z']"
            ),
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
def test_an_invalid_option_is_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(JobError) as error:
        make_post(PacScript, options)
    assert str(error.value) == message


def test_a_line_that_is_too_long_is_refused() -> None:
    template = ["Call Press({x}, {y}, {z}) " + "x" * 1000]
    post = PacScript(force="template", force_on=template)
    plan = program(Force(1.0, (1.0, 0.0, 0.0)), Force(0.0))
    with pytest.raises(
        Refused, match=r"a line of 10[0-9][0-9] bytes, the controller takes 1024; shorten it"
    ):
        post.render(post.prepare(plan, 0.01))


def test_a_spindle_that_is_on_or_off_has_its_speed_in_a_comment() -> None:
    plan = program(Output("spindle", 9000.0), MoveL(down(1, 0), 20.0), Output("spindle", 0.0))
    options = {"signals": {"process": 24, "spindle": 25}, "spindle": "on-off"}
    lines = print_body(plan, **options)
    assert lines[:2] == ["' spindle at 9000 rpm: set at its drive", "Set IO[25]"]
    assert lines[-1] == "Reset IO[25]"
    prepared = make_post(PacScript, options).prepare(plan, 0.01)
    assert [item.value for item in prepared.body if isinstance(item, Output)] == [0.0, 1.0, 0.0]


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
def test_an_arc_that_the_controller_may_not_take_is_halved_or_becomes_lines(
    radius: float, degrees: float, kinds: list[str] | None
) -> None:
    lines = print_body(program(*line_and_arc(radius, math.radians(degrees))))[1:]
    printed = [line.split()[1].rstrip(",") for line in lines]
    assert printed == kinds if kinds else set(printed) == {"L"}


def test_an_arc_that_turns_the_tool_by_half_a_turn_is_halved() -> None:
    line, turn = line_and_arc(10.0, math.radians(180.0))
    half, full = (frozen(rotation_about(2, angle) @ TOOL_DOWN) for angle in (math.pi / 2, math.pi))
    turned = replace(turn, via=Pose(half, turn.via.origin), target=Pose(full, turn.target.origin))
    prepared = PacScript().prepare(program(line, turned), 0.01)
    assert [type(item) for item in prepared.body[3:]] == [MoveC, MoveC]


# Generated programs

coordinate = st.floats(-900.0, 900.0)
speed = st.floats(0.1, 2000.0)
angle = st.one_of(
    st.sampled_from([-180.0, -90.0, -1e-4, 0.0, 1e-7, 45.0, 90.0, 180.0]), st.floats(-180.0, 180.0)
)


@st.composite
def rotations(draw: st.DrawFn) -> Pose:
    """An orientation by a quaternion, or by angles that are often degenerate."""
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
    """A line to the start of an arc in any plane, and the arc.

    The tool turns by less than 90 deg along the arc.
    """
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
def reorientations(draw: st.DrawFn) -> list[Instruction]:
    """A line and a reorientation at its end, by any angle, at 0.1 to 100 % of 500 deg/s.

    Angles near 0 are frequent.
    """
    start, rate = draw(poses()), math.radians(draw(st.floats(0.5, 500.0)))
    turned_little = rotation_about(2, draw(st.sampled_from([1e-12, 1e-7, 1e-3]))) @ start.rotation
    end = draw(
        st.one_of(rotations().map(lambda pose: pose.rotation), st.just(frozen(turned_little)))
    )
    return [MoveL(start, draw(speed)), MoveL(Pose(end, start.origin), draw(speed), turn=rate)]


@st.composite
def bodies(draw: st.DrawFn) -> tuple[Instruction, ...]:
    """A body with the stops that a program needs."""
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
        st.lists(st.one_of(single.map(lambda item: [item]), arcs(), reorientations()), max_size=12)
    ):
        items += chunk
    items.append(MoveL(down(0, 0), 20.0))
    for i, item in enumerate(items):
        later = [other for other in items[i + 1 :] if not isinstance(other, Comment)]
        before_motion = bool(later) and isinstance(later[0], (MoveJ, MoveL, MoveC))
        if isinstance(item, MoveL) and not before_motion:
            items[i] = replace(item, blend=0.0)
    return turning(items, 1.0)


OPTIONS: list[dict[str, object]] = [
    {},
    {"decimals": 5, "max_lines": 4, "define": True},
    {"speed": "percent", "rated": 5000.0, "ext_speed": 100.0, "signals": {"process": 3}},
]


@fewer(12)
@given(bodies(), st.sampled_from(OPTIONS))
def test_the_reading_of_a_generated_program_is_the_program(
    body: tuple[Instruction, ...], options: dict[str, object]
) -> None:
    if "rated" in options:
        items = list(body)
        for k, item in enumerate(items):
            if isinstance(item, (MoveJ, MoveL, MoveC)):
                items[k] = replace(item, speed=max(item.speed, 5.0))
        body = tuple(items)
    post = make_post(PacScript, options)
    assert isinstance(post, PacScript)
    prepared = post.prepare(Program("part", WORK, TOOL, whole(body)), 0.01)
    (file,) = post.render(prepared)
    reading = read({file.name: file.text}, options)
    assert_same(prepared, reading, post)
    assert len(file.text.splitlines()) == file.text.count("\n")
