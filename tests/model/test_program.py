"""The program's own rules, and its text form."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from camgen.model.errors import Refused
from camgen.model.pose import TOOL_DOWN, Pose, angle_between, rotation_from_fixed_xyz, translation
from camgen.model.program import Comment, Force, Joints, MoveC, MoveJ, MoveL, Output, Posture, Program, Wait, motions
from camgen.model.program_text import dump, parse

PROGRAMS = sorted((Path(__file__).parents[2] / "fixtures" / "programs").glob("*.ir"))
HOME = MoveJ(Joints((0.0, 0.5)), 100.0)
DOWN = Pose(TOOL_DOWN, (1.0, 2.0, 3.0))
LINE = MoveL(DOWN, 20.0)
ON = Force(5.0, (0.0, 1.0, 0.0))


def program(*body):
    return Program("p", translation(0, 0, 0), translation(0, 0, 100), body)


@pytest.mark.parametrize("file", PROGRAMS, ids=lambda file: file.stem)
def test_a_written_program_is_read_and_written_as_it_stands(file):
    text = file.read_text()
    assert dump(parse(text)) == text


def test_there_is_a_written_program_for_every_instruction():
    items = [item for file in PROGRAMS for item in parse(file.read_text()).body]
    assert {type(item) for item in items} == {MoveJ, MoveL, MoveC, Output, Wait, Force, Comment}
    assert {type(item.target) for item in items if isinstance(item, MoveJ)} == {Joints, Pose}
    assert any(item.joints for item in items if isinstance(item, MoveJ))
    assert any(item.force for item in items if isinstance(item, MoveC))


@pytest.mark.parametrize(
    ("body", "index", "what"),
    [
        ((LINE,), 0, "first motion must be joint-interpolated"),
        ((Output("a", 1.0), LINE), 1, "first motion must be joint-interpolated"),
        ((HOME, replace(LINE, speed=0.0)), 1, "speed must be positive"),
        ((HOME, replace(LINE, speed=-1.0)), 1, "speed must be positive"),
        ((HOME, replace(LINE, blend=-1.0), LINE), 1, "blend not negative"),
        ((HOME, replace(LINE, blend=1.0)), 1, "last motion must not blend"),
        ((HOME, replace(LINE, blend=1.0), Comment("x")), 1, "last motion must not blend"),
        ((HOME, replace(LINE, blend=1.0), Comment("x"), Output("a", 1.0)), 1, "must not blend"),
        ((HOME, replace(LINE, blend=1.0), Wait(1.0), LINE), 1, "must not blend"),
        ((HOME, replace(LINE, blend=1.0), ON, LINE, Force(0.0)), 1, "must not blend"),
        ((HOME, Wait(-0.1)), 1, "wait must not be negative"),
        ((HOME, ON, LINE), 2, "force control must be off at the end"),
        ((HOME, replace(LINE, force=1.0)), 1, "presses while force control is off"),
        ((HOME, ON, LINE, Force(0.0), replace(LINE, force=1.0)), 4, "presses while force control is off"),
    ],
)
def test_a_program_that_breaks_a_rule_is_not_made(body, index, what):
    with pytest.raises(Refused, match=what) as caught:
        program(*body)
    assert caught.value.index == index


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
def test_a_number_that_is_none_is_not_let_in(make, bad):
    with pytest.raises(Refused):
        program(HOME, make(bad), Force(0.0), HOME)


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize(
    "make",
    [
        lambda bad: MoveL(Pose(np.full((3, 3), bad), DOWN.origin), 1.0),
        lambda bad: MoveC(Pose(np.full((3, 3), bad), DOWN.origin), DOWN, 1.0),
        lambda bad: MoveL(DOWN, 1.0, 0.0, bad),
        lambda bad: MoveL(DOWN, 1.0, 0.0, 1.0, (bad, 0.0, 0.0)),
        lambda bad: MoveL(DOWN, 1.0, joints=Joints((bad,))),
    ],
)
def test_a_number_that_is_none_is_not_let_in_by_a_side_door(make, bad):
    with pytest.raises(Refused):
        program(HOME, ON, make(bad), Force(0.0))


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("frame", ["base_from_work", "flange_from_tool"])
def test_frames_are_finite(bad, frame):
    with pytest.raises(Refused):
        replace(program(HOME), **{frame: translation(0, bad, 0)})


def test_motions_are_those_with_their_place():
    body = (Comment("x"), HOME, Wait(1.0), LINE)
    assert list(motions(body)) == [(1, HOME), (3, LINE)]


def test_another_body_keeps_the_rest():
    one = Program("p", translation(1, 2, 3), translation(0, 0, 9), (HOME,), ("h",))
    other = one.with_body((HOME, LINE))
    assert other.body == (HOME, LINE)
    assert (other.name, other.header, other.base_from_work) == ("p", ("h",), one.base_from_work)


# The text form.

NUMBERS = st.floats(-1e5, 1e5) | st.sampled_from([0.0, -0.0, 1e-7, -1e-7, 0.1, 123456.123456])
ANGLES = st.sampled_from([0.0, math.pi / 2, math.pi, -math.pi / 2, 1e-8]) | st.floats(-3.2, 3.2)
POSES = st.builds(lambda r, *p: Pose(r, p), st.builds(rotation_from_fixed_xyz, ANGLES, ANGLES, ANGLES), *[NUMBERS] * 3)
SPEEDS = st.floats(0.001, 5000)
UNITS = st.sampled_from([(1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.6, 0.0, -0.8), (-0.36, 0.48, 0.8)])
JOINTS = st.builds(lambda *v: Joints(v), *[NUMBERS] * 6)
MAYBE = st.none() | JOINTS
CONF = st.tuples(*[st.integers(-5, 7)] * 4)
SWITCHES = st.sampled_from([(), ("RIGHTY",), ("LEFTY", "ABOVE", "NOFLIP", "SINGLE")])
NAMED = st.builds(Posture, st.none() | CONF, st.none() | st.integers(-1, 31), SWITCHES)
KNOWN = st.none() | NAMED.filter(lambda one: one != Posture())
WORDS = st.text("abcXYZ 019_.+-=/:#@*", max_size=30).map(str.strip)
CUTS = st.one_of(
    st.builds(MoveL, POSES, SPEEDS, st.just(0.0), st.floats(0.001, 50), UNITS, MAYBE, KNOWN),
    st.builds(MoveC, POSES, POSES, SPEEDS, st.just(0.0), st.floats(0.001, 50), UNITS, MAYBE, KNOWN),
)
ITEMS = st.one_of(
    st.builds(MoveJ, POSES | JOINTS, SPEEDS, st.just(0.0), MAYBE, KNOWN),
    st.builds(MoveL, POSES, SPEEDS, st.just(0.0), joints=MAYBE),
    st.builds(lambda a, b: [replace(a, blend=b), HOME], st.builds(MoveL, POSES, SPEEDS), st.floats(0.001, 50)),
    st.builds(MoveC, POSES, POSES, SPEEDS),
    st.builds(Output, WORDS.filter(bool), NUMBERS),
    st.builds(Wait, st.floats(0, 1e4)),
    st.builds(Comment, WORDS),
    st.builds(
        lambda n, u, cuts: [Force(n, u), *cuts, Force(0.0)], st.floats(0.001, 500), UNITS, st.lists(CUTS, max_size=2)
    ),
)
BODIES = st.lists(ITEMS, max_size=6).map(
    lambda items: (HOME, *(one for item in items for one in (item if isinstance(item, list) else [item])))
)


def same(a, b):
    """Equal to the digits of the text: 1e-6, poses by their angle."""
    if isinstance(a, Pose):
        return same(a.origin, b.origin) and angle_between(a.rotation, b.rotation) < 5e-9
    if isinstance(a, float):
        return abs(a - b) <= 0.5e-6 + 1e-10
    if isinstance(a, (tuple, list)):
        return len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, (str, int, type(None))):
        return a == b
    return type(a) is type(b) and all(same(getattr(a, name), getattr(b, name)) for name in a.__struct_fields__)


@settings(max_examples=150)
@given(BODIES, POSES, POSES, st.lists(WORDS, max_size=3))
def test_parse_is_the_inverse_of_dump(body, work, tool, header):
    one = Program("a name", work, tool, body, tuple(header))
    again = parse(dump(one))
    assert same(one, again)
    # Once read from text, a program keeps its text up to the last digit of a quaternion.
    assert same(again, parse(dump(again)))


def test_comments_cannot_become_instructions():
    text = dump(Program("p", DOWN, DOWN, (HOME, Comment("x\nmovel 1 2 3 q 1 0 0 0 speed 1")), ("a\nbody\nwait 1",)))
    assert [type(item) for item in parse(text).body] == [MoveJ, Comment]


@pytest.mark.parametrize(
    ("text", "says"),
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
        ("camgen-ir 1\nwork 1 2 3 q 0 0 0 0\nbody\n", "line 2"),
    ],
)
def test_what_cannot_be_read_is_named_by_its_line(text, says):
    with pytest.raises(ValueError, match=says):
        parse(text)


def test_the_rules_hold_for_text_too():
    with pytest.raises(Refused, match="first motion"):
        parse("camgen-ir 1\nbody\nmovel 1 2 3 q 1 0 0 0 speed 4\n")
