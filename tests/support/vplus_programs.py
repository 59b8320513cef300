"""Programs of tests for V+: their parts, their texts, and the comparison with a reading."""

import math

import numpy as np
from camgen_posts.vplus import VPlus
from hypothesis import strategies as st

from camgen.lang.programs import Executed
from camgen.model.pose import TOOL_DOWN, FloatArray, Pose, angle_between, frozen, rotation_about
from camgen.model.program import Comment, Instruction, Joints, MoveJ, MoveL, Output, Program, Wait
from camgen.post.plugins import make_post
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
    """The program as the post prepares it, and its text. chord: chord error of arcs, mm."""
    post = make_post(VPlus, options or {})
    prepared = post.prepare(source, chord)
    (file,) = post.render(prepared)
    assert file.name == source.name + ".v2"
    return prepared, file.text


def zyz_degrees(yaw: float, pitch: float, roll: float) -> FloatArray:
    """The rotation (3, 3) of a V+ location: angles about z, y and z, deg."""
    a, b, c = (math.radians(v) for v in (yaw, pitch, roll))
    return frozen(rotation_about(2, a) @ rotation_about(1, b) @ rotation_about(2, c))


def assert_same(
    planned: Program, reading: Executed, options: dict[str, object] | None = None
) -> None:
    """The reading has the instructions of `planned` in order, within the digits of the text.

    This comparison is independent of the one of a build. It skips comments.
    """
    tolerance = make_post(VPlus, options or {}).tolerance()
    slack = 1e-9
    body = [item for item in planned.body if not isinstance(item, Comment)]
    assert [type(i) for i in body] == [type(i) for i in reading.body]
    for item, other in zip(body, reading.body, strict=True):
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


def long_program(count: int, name: str) -> Program:
    """A program of `count` straight motions and a few more."""
    lines = [MoveL(down(x % 200, x // 200, 0), 20, 1.0) for x in range(count)]
    return program(HOME, *lines, MoveL(down(0, 0, 20), 50), HOME, name=name)


#: Pitch at and near the angles at which yaw and roll turn about one axis, deg.
DEGENERATE = st.sampled_from([0.0, 180.0, 90.0, 1e-9, 180 - 1e-9, 1e-5, 180 - 4e-5, 1e-3])
ANGLES = st.floats(-180, 180) | st.sampled_from([0.0, 90.0, -90.0, 180.0, -180.0])
