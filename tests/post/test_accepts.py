"""Motions that a post accepts by column: it accepts them singly too, and most usual ones."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from camgen.model.pose import TOOL_DOWN, Pose, translation
from camgen.model.program import Columns, Comment, Instruction, Joints, MoveC, MoveJ, MoveL, Output
from camgen.post.plugins import find_post, make_post
from tests.support.examples import fewer

POSTS = ("gcode", "grbl", "rapid", "pacscript", "vplus")
TILTED = translation(0, 0, 0).rotation

coordinate = st.sampled_from([0.0, 12.5, -8388.0, 8388.5, 99_999.0, -100_000.0])
pose = st.builds(
    Pose,
    st.sampled_from([TOOL_DOWN, TOOL_DOWN.copy(), TILTED]),
    st.tuples(coordinate, coordinate, coordinate),
)
joints = st.sampled_from([None, Joints((0.0,) * 6), Joints((0.0,) * 4)])
speed = st.sampled_from([1e-5, 2e-4, 10.0, 17_000.0, 1e6])
blend = st.sampled_from([0.0, 1e-4, 1.0, 9000.0])
motion = st.one_of(
    st.builds(MoveJ, st.one_of(pose, joints.filter(lambda j: j is not None)), speed, blend, joints),
    st.builds(
        MoveL, pose, speed, blend, joints=joints, turn=st.sampled_from([0.0, 0.0, 1e-6, 1.0, 1e6])
    ),
)


@pytest.mark.parametrize("name", POSTS)
@fewer(12)
@given(motions=st.lists(motion, max_size=6))
def test_a_motion_that_is_accepted_by_column_is_not_refused_singly(
    name: str, motions: list[MoveJ | MoveL]
) -> None:
    post = make_post(find_post(name), {})
    body: list[Instruction] = [Comment("first"), *motions]
    accepted = post.accepts(Columns(body))
    for index in np.flatnonzero(accepted).tolist():
        before = motions[index - 2] if index > 1 else None
        after = motions[index] if index < len(motions) else None
        assert not post.why_not(body[index], before, after), body[index]


@pytest.mark.parametrize("name", ["gcode", "grbl", "rapid"])
def test_usual_straight_motions_and_outputs_are_accepted_by_column(name: str) -> None:
    post = make_post(find_post(name), {})
    near = Pose(TOOL_DOWN, (10.0, 20.0, 5.0))
    body = (
        Comment("c"),
        MoveJ(near, 100.0),
        MoveL(near, 10.0),
        Output("process", 1.0),
        Output("none", 1.0),
    )
    assert post.accepts(Columns(body)).tolist() == [True, True, True, True, False]


@given(st.floats(0.1, 400.0), st.floats(-6.2, 6.2), st.floats(0.05, 0.95))
def test_an_arc_that_rapid_refuses_by_column_is_refused_singly(
    radius: float, sweep: float, part: float
) -> None:
    post = make_post(find_post("rapid"), {})
    angles = (0.0, sweep * part, sweep)
    start, via, end = (
        Pose(TOOL_DOWN, (radius * math.cos(a), radius * math.sin(a), 0.0)) for a in angles
    )
    arc = MoveC(via, end, 10.0)
    (_, refused) = post.refuses(Columns([MoveL(start, 10.0), arc])).tolist()
    assert not refused or post.why_not(arc, MoveL(start, 10.0), None)
    assert refused or not (abs(sweep) > 2.2 and 0.3 < part < 0.7)
