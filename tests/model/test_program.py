"""Rules of a program, and its text form."""

import math
from itertools import chain
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from camgen.model.errors import Refused
from camgen.model.pose import TOOL_DOWN, Pose, angle_between, rotation_from_fixed_xyz, translation
from camgen.model.program import (
    Comment,
    Force,
    Joints,
    MoveC,
    MoveJ,
    MoveL,
    Output,
    Posture,
    Program,
    Wait,
    motions,
    switch_off_first,
)
from fixtures.program_text import dump, parse
from tests.support.whole import whole

PROGRAMS = sorted((Path(__file__).parents[2] / "fixtures" / "programs").glob("*.ir"))
HOME = MoveJ(Joints((0.0, 0.5)), 100.0)
DOWN = Pose(TOOL_DOWN, (1.0, 2.0, 3.0))
LINE = MoveL(DOWN, 20.0)
ON = Force(5.0, (0.0, 1.0, 0.0))
OFF = Force(0.0)
A_ON, A_OFF = Output("a", 1.0), Output("a", 0.0)
TURNED = Pose(TOOL_DOWN @ rotation_from_fixed_xyz(0.0, 0.0, 1.0), DOWN.origin)
THERE = MoveJ(DOWN, 100.0)


def program(*body):
    return Program("p", translation(0, 0, 0), translation(0, 0, 100), body)


@pytest.mark.parametrize("file", PROGRAMS, ids=lambda file: file.stem)
def test_a_program_of_the_fixtures_is_parsed_and_written_the_same(file):
    text = file.read_text()
    assert dump(parse(text)) == text


def test_the_programs_of_the_fixtures_have_every_instruction():
    bodies = [parse(file.read_text()).body for file in PROGRAMS]
    items = list(chain.from_iterable(bodies))
    assert {type(item) for item in items} == {MoveJ, MoveL, MoveC, Output, Wait, Force, Comment}
    assert {type(item.target) for item in items if isinstance(item, MoveJ)} == {Joints, Pose}
    assert any(item.joints for item in items if isinstance(item, MoveJ))
    assert any(item.force for item in items if isinstance(item, MoveC))
    assert any(item.turn for item in items if isinstance(item, MoveL))


@pytest.mark.parametrize(
    ("body", "index", "what"),
    [
        ((LINE,), 0, "first motion must be joint-interpolated"),
        ((A_OFF, LINE), 1, "first motion must be joint-interpolated"),
        ((HOME, replace(LINE, speed=0.0)), 1, "speed must be positive"),
        ((HOME, replace(LINE, speed=-1.0)), 1, "speed must be positive"),
        ((HOME, replace(LINE, blend=-1.0), LINE), 1, "blend not negative"),
        ((HOME, replace(LINE, blend=1.0)), 1, "last motion must not blend"),
        ((HOME, replace(LINE, blend=1.0), Comment("x")), 1, "last motion must not blend"),
        ((A_OFF, HOME, replace(LINE, blend=1.0), Comment("x"), A_ON, A_OFF), 2, "must not blend"),
        ((HOME, replace(LINE, blend=1.0), Wait(1.0), LINE), 1, "must not blend"),
        ((OFF, HOME, replace(LINE, blend=1.0), ON, LINE, OFF), 2, "must not blend"),
        ((HOME, Wait(-0.1)), 1, "wait must not be negative"),
        ((OFF, HOME, ON, LINE), 3, "force control must be off at the end"),
        ((HOME, ON, LINE, OFF), 0, "force control is not switched off before the first motion"),
        ((A_OFF, HOME, A_ON, LINE), 3, "output a must be off at the end"),
        ((A_OFF, HOME, A_ON, LINE, Comment("x")), 4, "output a must be off at the end"),
        (
            (Comment("x"), HOME, A_ON, LINE, A_OFF),
            1,
            "output a is not switched off before the first motion",
        ),
        ((A_OFF, A_ON, HOME, A_OFF), 2, "output a is not switched off before the first motion"),
        (
            (A_OFF, HOME, Output("b", 0.0)),
            1,
            "output b is not switched off before the first motion",
        ),
        ((A_ON,), 0, "output a must be off at the end"),
        (
            (A_OFF, HOME, THERE, replace(LINE, target=TURNED)),
            3,
            "only turns the tool has no speed of turning",
        ),
        (
            (HOME, LINE, replace(LINE, target=TURNED)),
            2,
            "only turns the tool has no speed of turning",
        ),
        ((HOME, replace(LINE, turn=-1.0)), 1, "speed of turning must not be negative"),
        ((HOME, replace(LINE, force=1.0)), 1, "presses while force control is off"),
        (
            (OFF, HOME, ON, LINE, OFF, replace(LINE, force=1.0)),
            5,
            "presses while force control is off",
        ),
    ],
)
def test_a_program_that_breaks_a_rule_is_refused(body, index, what):
    with pytest.raises(Refused, match=what) as caught:
        program(*body)
    assert caught.value.index == index


@pytest.mark.parametrize(
    "body",
    [
        (A_OFF, OFF, HOME, A_ON, ON, LINE, OFF, A_OFF),
        (A_ON, A_OFF, HOME),  # on for a while before the first motion
        (A_OFF,),
        (HOME, THERE, LINE),  # neither travels nor turns
        (HOME, THERE, replace(LINE, target=TURNED, turn=1.0)),
        (HOME, replace(LINE, target=TURNED)),  # the pose at the joint values is not known
        (HOME, THERE, replace(THERE, target=TURNED)),  # joints have their own speeds
        (HOME, THERE, MoveL(Pose(TURNED.rotation, (1.0, 2.0, 3.1)), 20.0)),
    ],
)
def test_a_program_that_keeps_the_rules_is_made(body):
    assert program(*body).body == body


def test_the_outputs_of_a_program_are_switched_off_first():
    assert switch_off_first((HOME, LINE)) == (HOME, LINE)
    body = [HOME, Output("b", 1.0), ON, A_ON, LINE, OFF, A_OFF, Output("b", 0.0)]
    assert switch_off_first(body) == (Output("b", 0.0), A_OFF, OFF, *body)


BAD = (math.nan, math.inf, -math.inf)


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize(
    "make",
    [
        lambda bad: MoveJ(Joints((0.0, bad)), 1.0),
        lambda bad: MoveJ(DOWN, bad),
        lambda bad: MoveL(Pose(TOOL_DOWN, (0.0, bad, 0.0)), 1.0),
        lambda bad: MoveL(DOWN, 1.0, bad),
        lambda bad: MoveC(Pose(TOOL_DOWN, (bad, 0.0, 0.0)), DOWN, 1.0),
        lambda bad: MoveC(DOWN, Pose(TOOL_DOWN, (0.0, 0.0, bad)), 1.0),
        lambda bad: Output("a", bad),
        Wait,
        Force,
        lambda bad: Force(1.0, (bad, 0.0, 0.0)),
    ],
)
def test_a_number_that_is_not_finite_is_refused(make, bad):
    with pytest.raises(Refused, match="a number is not finite"):
        program(*whole((HOME, make(bad), HOME)))


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize(
    "make",
    [
        lambda bad: MoveL(Pose(np.full((3, 3), bad), DOWN.origin), 1.0),
        lambda bad: MoveC(Pose(np.full((3, 3), bad), DOWN.origin), DOWN, 1.0),
        lambda bad: MoveL(DOWN, 1.0, 0.0, bad),
        lambda bad: MoveL(DOWN, 1.0, 0.0, 1.0, (bad, 0.0, 0.0)),
        lambda bad: MoveL(DOWN, 1.0, joints=Joints((bad,))),
        lambda bad: MoveL(DOWN, 1.0, turn=bad),
    ],
)
def test_a_number_that_is_not_finite_is_refused_in_less_usual_fields(make, bad):
    with pytest.raises(Refused, match="a number is not finite"):
        program(OFF, HOME, ON, make(bad), OFF)


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("frame", ["base_from_work", "flange_from_tool"])
def test_a_frame_that_is_not_finite_is_refused(bad, frame):
    with pytest.raises(Refused):
        replace(program(HOME), **{frame: translation(0, bad, 0)})


def test_motions_are_listed_with_their_index():
    body = (Comment("x"), HOME, Wait(1.0), LINE)
    assert list(motions(body)) == [(1, HOME), (3, LINE)]


def test_a_program_with_another_body_keeps_its_other_fields():
    first = Program("p", translation(1, 2, 3), translation(0, 0, 9), (HOME,), ("h",))
    second = first.with_body((HOME, LINE))
    assert second.body == (HOME, LINE)
    assert (second.name, second.header) == ("p", ("h",))
    assert second.base_from_work == first.base_from_work


# The text form

NUMBERS = st.floats(-1e5, 1e5) | st.sampled_from([0.0, -0.0, 1e-7, -1e-7, 0.1, 123456.123456])
ANGLES = st.sampled_from([0.0, math.pi / 2, math.pi, -math.pi / 2, 1e-8]) | st.floats(-3.2, 3.2)
POSES = st.builds(
    lambda r, *p: Pose(r, p),
    st.builds(rotation_from_fixed_xyz, ANGLES, ANGLES, ANGLES),
    *[NUMBERS] * 3,
)
SPEEDS = st.floats(0.001, 5000)
TURNS = st.floats(0.001, 50)
UNITS = st.sampled_from([(1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.6, 0.0, -0.8), (-0.36, 0.48, 0.8)])
JOINTS = st.builds(lambda *v: Joints(v), *[NUMBERS] * 6)
MAYBE = st.none() | JOINTS
CONF = st.tuples(*[st.integers(-5, 7)] * 4)
SWITCHES = st.sampled_from([(), ("RIGHTY",), ("LEFTY", "ABOVE", "NOFLIP", "SINGLE")])
NAMED = st.builds(Posture, st.none() | CONF, st.none() | st.integers(-1, 31), SWITCHES)
KNOWN = st.none() | NAMED.filter(lambda posture: posture != Posture())
WORDS = st.text("abcXYZ 019_.+-=/:#@*", max_size=30).map(str.strip)
CUTS = st.one_of(
    st.builds(
        MoveL, POSES, SPEEDS, st.just(0.0), st.floats(0.001, 50), UNITS, MAYBE, KNOWN, turn=TURNS
    ),
    st.builds(MoveC, POSES, POSES, SPEEDS, st.just(0.0), st.floats(0.001, 50), UNITS, MAYBE, KNOWN),
)
ITEMS = st.one_of(
    st.builds(MoveJ, POSES | JOINTS, SPEEDS, st.just(0.0), MAYBE, KNOWN),
    st.builds(MoveL, POSES, SPEEDS, st.just(0.0), joints=MAYBE, turn=TURNS),
    st.builds(
        lambda a, b: [replace(a, blend=b), HOME],
        st.builds(MoveL, POSES, SPEEDS, turn=TURNS),
        st.floats(0.001, 50),
    ),
    st.builds(MoveC, POSES, POSES, SPEEDS),
    st.builds(Output, WORDS.filter(bool), NUMBERS),
    st.builds(Wait, st.floats(0, 1e4)),
    st.builds(Comment, WORDS),
    st.builds(
        lambda n, u, cuts: [Force(n, u), *cuts, Force(0.0)],
        st.floats(0.001, 500),
        UNITS,
        st.lists(CUTS, max_size=2),
    ),
)


def make_body(items):
    """A whole body from items that are instructions or lists of them."""
    lists = [item if isinstance(item, list) else [item] for item in items]
    return whole([HOME, *chain.from_iterable(lists)])


BODIES = st.lists(ITEMS, max_size=6).map(make_body)


def same(a, b):
    """Whether two values are equal to the digits of the text, 1e-6, and rotations by angle."""
    if isinstance(a, Pose):
        return same(a.origin, b.origin) and angle_between(a.rotation, b.rotation) < 5e-9
    if isinstance(a, float):
        return abs(a - b) <= 0.5e-6 + 1e-10
    if isinstance(a, (tuple, list)):
        return len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, (str, int, type(None))):
        return a == b
    return type(a) is type(b) and all(
        same(getattr(a, name), getattr(b, name)) for name in a.__struct_fields__
    )


@given(BODIES, POSES, POSES, st.lists(WORDS, max_size=3))
def test_a_dumped_program_is_parsed_as_the_program(body, work, tool, header):
    program = Program("a name", work, tool, body, tuple(header))
    again = parse(dump(program))
    assert same(program, again)
    # Parsing again changes at most the last digit of a quaternion.
    assert same(again, parse(dump(again)))


def test_the_text_has_the_speed_of_a_reorientation():
    body = (
        HOME,
        THERE,
        replace(LINE, target=TURNED, turn=math.pi / 3),
        MoveL(Pose(TURNED.rotation, (9.0, 2.0, 3.0)), 20.0),
    )
    lines = dump(program(*body)).splitlines()[-2:]
    assert [" turn 1.047197551" in line for line in lines] == [True, False]
    assert [item.turn for item in parse(dump(program(*body))).body[2:]] == [
        pytest.approx(math.pi / 3, abs=1e-9),
        0.0,
    ]


def test_a_comment_never_becomes_an_instruction():
    text = dump(
        Program(
            "p",
            DOWN,
            DOWN,
            (HOME, Comment("x\nmovel 1 2 3 q 1 0 0 0 speed 1")),
            ("a\nbody\nwait 1",),
        )
    )
    assert [type(item) for item in parse(text).body] == [MoveJ, Comment]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "line 1"),
        ("camgen-ir 2\n", "line 1"),
        ("camgen-ir 1\nbody\nmovel 1 2 3 speed 4\n", "line 3"),
        ("camgen-ir 1\nbody\nmovel 1 2 3 q 1 0 0 0\n", "line 3"),
        ("camgen-ir 1\nbody\nmovej 1 2 3 q 1 0 0 0 speed\n", "line 3"),
        ("camgen-ir 1\nbody\nmovej 1 2 x q 1 0 0 0 speed 1\n", "line 3"),
        ("camgen-ir 1\nbody\nmovec 1 2 3 q 1 0 0 0 speed 1\n", "line 3"),
        ("camgen-ir 1\nbody\njump 1 2 3 q 1 0 0 0 speed 1\n", "line 3"),
        ("camgen-ir 1\nbody\nforce 1\n", "line 3"),
        ("camgen-ir 1\nbody\nmovel 1 2 3 q 1 0 0 0 speed 1 turn x\n", "line 3"),
        ("camgen-ir 1\nwork 1 2 3 q 0 0 0 0\nbody\n", "line 2"),
    ],
)
def test_an_invalid_line_is_refused_with_its_number(text, message):
    with pytest.raises(ValueError, match=message):
        parse(text)


def test_a_text_that_breaks_a_rule_is_refused():
    with pytest.raises(Refused, match="first motion"):
        parse("camgen-ir 1\nbody\nmovel 1 2 3 q 1 0 0 0 speed 4\n")
