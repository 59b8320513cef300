"""Rotations and frames: their forms against each other and against matrices, and at their poles."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from camgen.model.pose import (
    IDENTITY,
    TOOL_DOWN,
    Pose,
    angle_between,
    compute_fixed_xyz,
    compute_quaternion,
    compute_zyz,
    frozen,
    pose_from_values,
    rotation_about,
    rotation_about_axis,
    rotation_between,
    rotation_from_fixed_xyz,
    rotation_from_quaternion,
    rotation_from_vector,
    rotation_vector,
    to_vec3,
    translation,
)
from tests.support.rounding import rounding_bound

#: Angles at poles, near poles, and any others.
ANGLES = st.one_of(
    st.sampled_from([k * math.pi / 4 for k in range(-4, 5)]),
    st.builds(
        lambda k, e: k * math.pi / 2 + e,
        st.integers(-2, 2),
        st.sampled_from([1e-15, 1e-12, 1e-9, 1e-8, 1e-7, 1e-6, 1e-4, -1e-9, -1e-7, -1e-10]),
    ),
    st.floats(-math.pi, math.pi),
)
ROTATIONS = st.builds(rotation_from_fixed_xyz, ANGLES, ANGLES, ANGLES)
POSES = st.builds(lambda r, *p: Pose(r, p), ROTATIONS, *[st.floats(-1e4, 1e4)] * 3)


def matrix(axis, angle):
    """A rotation about a coordinate axis, written out."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array(
        {
            "x": [[1, 0, 0], [0, c, -s], [0, s, c]],
            "y": [[c, 0, s], [0, 1, 0], [-s, 0, c]],
            "z": [[c, -s, 0], [s, c, 0], [0, 0, 1]],
        }[axis]
    )


def make_zyz(yaw, pitch, roll):
    """The rotation of the angles of V+, written out."""
    return matrix("z", yaw) @ matrix("y", pitch) @ matrix("z", roll)


@given(ROTATIONS)
def test_each_form_gives_the_rotation_again(rotation):
    # Below a sine of 1e-9 an angle counts as a pole.
    assert angle_between(rotation_from_fixed_xyz(*compute_fixed_xyz(rotation)), rotation) < 4e-9
    assert angle_between(make_zyz(*compute_zyz(rotation)), rotation) < 4e-9
    assert angle_between(rotation_from_quaternion(compute_quaternion(rotation)), rotation) < 1e-14


@given(ROTATIONS)
def test_each_form_is_in_its_range(rotation):
    rx, ry, rz = compute_fixed_xyz(rotation)
    assert abs(ry) <= math.pi / 2
    assert max(abs(rx), abs(rz)) <= math.pi
    assert 0 <= compute_zyz(rotation)[1] <= math.pi
    q = compute_quaternion(rotation)
    assert math.hypot(*q) == pytest.approx(1.0, abs=1e-12)
    assert q[0] > -1e-12
    assert next(v for v in q if abs(v) > 1e-12) > 0
    assert "-0.0" not in map(str, q)


@given(ANGLES, ANGLES, ANGLES)
def test_angles_are_products_of_rotations(a, b, c):
    fixed = matrix("z", c) @ matrix("y", b) @ matrix("x", a)
    # Two products of matrices have five operations each, and the closed form has five.
    rounding = rounding_bound(operations=15, functions=6)
    assert rotation_from_fixed_xyz(a, b, c) == pytest.approx(fixed, abs=rounding)


@pytest.mark.parametrize(
    ("rotation", "angles"), [(TOOL_DOWN, (math.pi, 0, 0)), (IDENTITY, (0, 0, 0))]
)
def test_usual_tools_have_their_fixed_angles(rotation, angles):
    assert compute_fixed_xyz(rotation) == pytest.approx(angles)


def test_a_tool_straight_down_has_its_other_forms():
    assert compute_zyz(TOOL_DOWN) == pytest.approx((0, math.pi, math.pi))
    assert compute_zyz(frozen(np.diag([-1.0, 1.0, -1.0]))) == pytest.approx((0, math.pi, 0))
    assert compute_quaternion(TOOL_DOWN) == (0, 1, 0, 0)
    assert compute_quaternion(frozen(np.diag([-1.0, 1.0, -1.0]))) == (0, 0, 1, 0)


@pytest.mark.parametrize("turn", [0.0, 0.7, -2.0, math.pi])
@pytest.mark.parametrize("ry", [math.pi / 2, -math.pi / 2])
def test_the_free_angle_is_zero_at_a_pole(turn, ry):
    at_pole = rotation_from_fixed_xyz(turn, ry, 0.3)
    assert compute_fixed_xyz(at_pole)[0] == 0.0
    for pitch in (0.0, math.pi):
        assert compute_zyz(make_zyz(0.3, pitch, turn))[0] == 0.0


@given(ROTATIONS, st.floats(1e-9, 3.1), ANGLES, ANGLES)
def test_the_angle_between_two_rotations_is_the_one_that_was_turned(rotation, angle, a, b):
    axis = frozen([math.cos(a) * math.cos(b), math.sin(a) * math.cos(b), math.sin(b)])
    other = frozen(rotation @ rotation_about_axis(axis, angle))
    assert angle_between(rotation, other) == pytest.approx(angle, rel=1e-6, abs=1e-14)
    half = rotation_between(rotation, other, 0.5)
    assert angle_between(rotation, half) == pytest.approx(angle / 2, rel=1e-6, abs=1e-14)
    assert angle_between(half, other) == pytest.approx(angle / 2, rel=1e-6, abs=1e-14)


VECTORS = st.tuples(*[st.floats(-4.0, 4.0)] * 3)


@given(VECTORS)
def test_a_rotation_from_a_vector_is_the_exponential_of_its_cross_product(vector):
    x, y, z = vector
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    term = total = np.eye(3)
    for order in range(1, 60):
        term = term @ cross / order
        total = total + term
    assert np.allclose(rotation_from_vector(vector), total, atol=1e-9)


@given(ROTATIONS)
def test_the_vector_of_a_rotation_gives_the_rotation_again(rotation):
    vector = rotation_vector(rotation)
    assert math.hypot(*vector) <= math.pi + 1e-12
    assert angle_between(rotation, rotation_from_vector(vector)) < 1e-7


def test_usual_tools_have_their_vectors():
    """The pendant of a UR shows pi about x for a tool straight down."""
    assert rotation_vector(TOOL_DOWN) == pytest.approx((math.pi, 0.0, 0.0))
    assert rotation_vector(IDENTITY) == (0.0, 0.0, 0.0)
    quarter = rotation_vector(rotation_about(2, -math.pi / 2))
    assert quarter == pytest.approx((0.0, 0.0, -math.pi / 2))
    tiny = rotation_vector(rotation_about(1, 1e-9))
    assert tiny == pytest.approx((0.0, 1e-9, 0.0), abs=1e-15)


def test_the_angle_of_half_a_turn_is_pi():
    assert angle_between(IDENTITY, TOOL_DOWN) == pytest.approx(math.pi)
    assert angle_between(IDENTITY, IDENTITY) == 0.0


@given(ROTATIONS, st.integers(0, 2), ANGLES)
def test_rotations_about_axes_agree(rotation, axis, angle):
    rounding = rounding_bound(operations=10, functions=4)
    assert rotation_about(axis, angle) == pytest.approx(matrix("xyz"[axis], angle), abs=rounding)
    assert rotation_about_axis(frozen(np.eye(3)[axis]), angle) == pytest.approx(
        rotation_about(axis, angle), abs=rounding
    )
    assert rotation_between(rotation, rotation, 0.3) is rotation


@given(POSES, POSES, st.tuples(*[st.floats(-1e3, 1e3)] * 3))
def test_a_product_of_frames_maps_points_as_both_in_turn(a, b, point):
    assert (a @ b).apply(point) == pytest.approx(a.apply(b.apply(point)), abs=1e-7)
    assert a.inverse().apply(a.apply(point)) == pytest.approx(point, abs=1e-7)
    same = a @ a.inverse()
    assert same.origin == pytest.approx((0, 0, 0), abs=1e-8)
    assert angle_between(same.rotation, IDENTITY) < 1e-12


def test_the_values_of_a_pose_are_in_mm_and_deg():
    pose = pose_from_values([1, 2, 3, 90, 0, 90])
    assert pose.origin == (1, 2, 3)
    assert pose.rotation == pytest.approx(matrix("z", math.pi / 2) @ matrix("x", math.pi / 2))
    assert translation(1, 2, 3).apply((1, 1, 1)) == (2, 3, 4)


def test_a_rotation_is_read_only():
    for rotation in (
        IDENTITY,
        TOOL_DOWN,
        rotation_about(0, 1.0),
        (translation(0, 0, 0) @ translation(0, 0, 1)).rotation,
    ):
        with pytest.raises(ValueError, match="read-only"):
            rotation[0, 0] = 2.0


def test_a_row_of_an_array_becomes_plain_floats() -> None:
    row = to_vec3(np.array([[1.0, 2.5, -3.0]])[0])
    assert row == (1.0, 2.5, -3.0)
    assert {type(value) for value in row} == {float}
