"""PacScript: generated programs that are read back."""

import math

from camgen_posts.pacscript import PacScript
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from camgen.lang.pacscript.strict import read
from camgen.model.pose import (
    Pose,
    frozen,
    pose_from_values,
    rotation_about,
    rotation_about_axis,
    rotation_from_quaternion,
)
from camgen.model.program import (
    Comment,
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
from tests.support.pacscript_programs import HOME, TOOL, WORK, assert_same, down
from tests.support.whole import turning, whole

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
