"""Rotations in batches and vectors, judged by those of single poses and by what defines them."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from camgen.geometry import rotations, vectors
from camgen.model.pose import (
    angle_between,
    frozen,
    rotation_about,
    rotation_about_axis,
    rotation_between,
    rotation_from_axes,
    rotation_from_fixed_xyz,
    rotation_from_quaternion,
)
from tests.support.rounding import rounding_bound

UNITS = st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda v: math.hypot(*v) > 0.1)
TURNS = st.one_of(st.floats(0.0, 3.14), st.sampled_from([0.0, 1e-12, 1e-9, 1e-5]))


def unit(v: tuple[float, float, float]) -> np.ndarray:
    return np.array(v) / math.hypot(*v)


@given(UNITS, TURNS)
def test_axis_times_angle_there_and_back(axis: tuple[float, float, float], angle: float) -> None:
    vector = unit(axis) * angle
    made = rotations.make_rotations_from_vectors(vector[None])
    # Ten operations make the angle, and count pi times: it is up to pi.
    rounding = rounding_bound(operations=75, functions=5)
    expected = rotation_about_axis(frozen(unit(axis)), angle)
    assert np.allclose(made[0], expected, rtol=0, atol=rounding)
    # Near half a turn the axis comes of small differences: the sine is up to pi - angle.
    allowed = 1e-12 + math.pi * rounding / (math.pi - angle)
    assert np.allclose(rotations.compute_rotation_vectors(made)[0], vector, rtol=0, atol=allowed)


@given(UNITS, UNITS, TURNS)
def test_the_angle_between_two_is_that_of_the_turn(
    axis: tuple[float, float, float], angles: tuple[float, float, float], angle: float
) -> None:
    a = np.array(rotation_from_fixed_xyz(*angles))
    b = a @ rotation_about_axis(frozen(unit(axis)), angle)
    assert rotations.measure_angles_between(a[None], b[None])[0] == pytest.approx(angle, abs=1e-14)
    assert angle_between(a, b) == pytest.approx(angle, abs=1e-14)


@given(UNITS, UNITS, st.floats(0.0, 3.0), st.floats(0.0, 1.0))
def test_a_part_of_the_shortest_turn(
    axis: tuple[float, float, float], angles: tuple[float, float, float], angle: float, part: float
) -> None:
    a = rotation_from_fixed_xyz(*angles)
    b = frozen(a @ rotation_about_axis(frozen(unit(axis)), angle))
    found = rotations.interpolate_rotations(
        np.array([a, a]), np.array([a, b]), np.array([1, 0]), np.array([part, part])
    )
    assert np.allclose(found, [rotation_between(a, b, part), a], rtol=0, atol=1e-12)


@given(UNITS, UNITS)
def test_a_frame_of_two_directions(
    z: tuple[float, float, float], towards: tuple[float, float, float]
) -> None:
    if np.linalg.norm(np.cross(unit(z), unit(towards))) < 1e-3:
        return
    found = rotations.make_rotations_from_axes(np.array([z]), np.array([towards]))[0]
    assert np.allclose(found, rotation_from_axes(z, towards), rtol=0, atol=1e-12)


@given(st.floats(-3.1, 3.1), st.floats(-3.1, 3.1))
def test_the_turn_about_z_is_told_from_the_lean(turn: float, lean: float) -> None:
    swing, twist = np.array(rotation_about(0, lean / 4)), np.array(rotation_about(2, turn))
    assert rotations.measure_rolls((swing @ twist)[None])[0] == pytest.approx(turn, abs=1e-12)


@given(UNITS, UNITS, st.floats(-6.0, 6.0))
def test_vectors_turn_as_their_rotation_says(
    axis: tuple[float, float, float], vector: tuple[float, float, float], angle: float
) -> None:
    one = unit(axis)
    wanted = rotation_about_axis(frozen(one), angle) @ np.array(vector)
    found = rotations.turn_vectors(np.array([vector]), one[None], np.array([angle]))[0]
    assert np.allclose(found, wanted, rtol=0, atol=1e-12)
    still, cosine, sine = rotations.compute_rotation_terms(one)
    assert np.allclose(
        (still + math.cos(angle) * cosine + math.sin(angle) * sine) @ vector,
        wanted,
        rtol=0,
        atol=1e-12,
    )


@given(st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda q: math.hypot(*q) > 0.1))
def test_quaternions_are_those_of_single_poses(q: tuple[float, float, float, float]) -> None:
    size = math.hypot(*q)
    parts = [np.array([v / size]) for v in q]
    assert np.allclose(
        rotations.make_rotations_from_quaternions(*parts)[0],
        rotation_from_quaternion(q),
        rtol=0,
        atol=1e-14,
    )


def test_vectors_are_those_of_numpy() -> None:
    rng = np.random.default_rng(5)
    a, b = rng.normal(size=(2, 50, 3))
    assert np.array_equal(vectors.cross(a, b), np.cross(a, b))
    assert np.allclose(vectors.multiply_rows(a, b), (a * b).sum(axis=1))
    assert np.allclose(np.linalg.norm(vectors.normalize(a), axis=1), 1.0)
    assert vectors.normalize(np.zeros((1, 3))).tolist() == [[0.0, 0.0, 0.0]]


@given(st.floats(1e-12, 3.14), st.floats(-3.0, 3.0))
def test_angles_between_vectors_are_exact_for_small_ones(angle: float, begin: float) -> None:
    a = np.array([[math.cos(begin), math.sin(begin), 0.0]])
    b = np.array([[math.cos(begin + angle), math.sin(begin + angle), 0.0]])
    rounding = rounding_bound(operations=12, functions=4)
    assert vectors.measure_angles(a, b)[0] == pytest.approx(angle, abs=rounding)
    assert vectors.measure_signed_angles(b[:, :2], a[:, :2])[0] == pytest.approx(
        -angle, abs=rounding
    )
