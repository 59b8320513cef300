"""Rotations in batches agree with those of single poses, and vectors with their definitions."""

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
    rotation_from_fixed_xyz,
    rotation_from_quaternion,
)
from tests.support.rounding import rounding_bound

UNITS = st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda v: math.hypot(*v) > 0.1)
TURNS = st.one_of(st.floats(0.0, 3.14), st.sampled_from([0.0, 1e-12, 1e-9, 1e-5]))


def unit(v: tuple[float, float, float]) -> np.ndarray:
    return np.array(v) / math.hypot(*v)


@given(UNITS, TURNS)
def test_a_rotation_vector_gives_its_rotation_and_back(
    axis: tuple[float, float, float], angle: float
) -> None:
    vector = unit(axis) * angle
    matrices = rotations.make_rotations_from_vectors(vector[None])
    # Ten operations compute the angle. They count pi times, as it may be pi.
    rounding = rounding_bound(operations=75, functions=5)
    expected = rotation_about_axis(frozen(unit(axis)), angle)
    assert np.allclose(matrices[0], expected, rtol=0, atol=rounding)
    # Near half a turn, the axis is computed from small differences: the sine is at most pi - angle.
    allowed = 1e-12 + math.pi * rounding / (math.pi - angle)
    assert np.allclose(
        rotations.compute_rotation_vectors(matrices)[0], vector, rtol=0, atol=allowed
    )


@given(UNITS, UNITS, TURNS)
def test_the_angle_between_two_rotations_is_exact(
    axis: tuple[float, float, float], angles: tuple[float, float, float], angle: float
) -> None:
    a = np.array(rotation_from_fixed_xyz(*angles))
    b = a @ rotation_about_axis(frozen(unit(axis)), angle)
    assert rotations.measure_angles_between(a[None], b[None])[0] == pytest.approx(angle, abs=1e-14)
    assert angle_between(a, b) == pytest.approx(angle, abs=1e-14)


@given(UNITS, UNITS, st.floats(0.0, 3.0), st.floats(0.0, 1.0))
def test_interpolation_follows_the_shortest_rotation(
    axis: tuple[float, float, float],
    angles: tuple[float, float, float],
    angle: float,
    fraction: float,
) -> None:
    a = rotation_from_fixed_xyz(*angles)
    b = frozen(a @ rotation_about_axis(frozen(unit(axis)), angle))
    interpolated = rotations.interpolate_rotations(
        np.array([a, a]), np.array([a, b]), np.array([1, 0]), np.array([fraction, fraction])
    )
    assert np.allclose(interpolated, [rotation_between(a, b, fraction), a], rtol=0, atol=1e-12)


@given(UNITS, UNITS)
def test_a_rotation_is_made_from_two_directions(
    z: tuple[float, float, float], towards: tuple[float, float, float]
) -> None:
    if np.linalg.norm(np.cross(unit(z), unit(towards))) < 1e-3:
        return
    (rotation,) = rotations.make_rotations_from_axes(np.array([z]), np.array([towards]))
    x = np.array(towards) - np.dot(unit(z), towards) * np.array(unit(z))
    columns = [unit(x), np.cross(unit(z), unit(x)), unit(z)]
    assert np.allclose(rotation, np.transpose(columns), rtol=0, atol=1e-12)


@given(st.floats(-3.1, 3.1), st.floats(-3.1, 3.1))
def test_the_roll_about_z_is_independent_of_the_tilt(roll: float, tilt: float) -> None:
    swing, twist = np.array(rotation_about(0, tilt / 4)), np.array(rotation_about(2, roll))
    assert rotations.measure_rolls((swing @ twist)[None])[0] == pytest.approx(roll, abs=1e-12)


@given(UNITS, UNITS, st.floats(-6.0, 6.0))
def test_vectors_are_rotated_by_axis_and_angle_as_by_the_matrix(
    axis: tuple[float, float, float], vector: tuple[float, float, float], angle: float
) -> None:
    direction = unit(axis)
    expected = rotation_about_axis(frozen(direction), angle) @ np.array(vector)
    rotated = rotations.turn_vectors(np.array([vector]), direction[None], np.array([angle]))[0]
    assert np.allclose(rotated, expected, rtol=0, atol=1e-12)
    constant, cosine, sine = rotations.compute_rotation_terms(direction)
    matrix = constant + math.cos(angle) * cosine + math.sin(angle) * sine
    assert np.allclose(matrix @ vector, expected, rtol=0, atol=1e-12)


@given(st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda q: math.hypot(*q) > 0.1))
def test_quaternions_give_the_rotations_of_single_poses(
    q: tuple[float, float, float, float],
) -> None:
    size = math.hypot(*q)
    parts = [np.array([v / size]) for v in q]
    rotation = rotations.make_rotations_from_quaternions(*parts)[0]
    assert np.allclose(rotation, rotation_from_quaternion(q), rtol=0, atol=1e-14)


def test_products_and_lengths_of_vectors_are_those_of_numpy() -> None:
    rng = np.random.default_rng(5)
    a, b = rng.normal(size=(2, 50, 3))
    assert np.array_equal(vectors.cross(a, b), np.cross(a, b))
    assert np.allclose(vectors.multiply_rows(a, b), (a * b).sum(axis=1))
    assert np.allclose(np.linalg.norm(vectors.normalize(a), axis=1), 1.0)
    assert vectors.normalize(np.zeros((1, 3))).tolist() == [[0.0, 0.0, 0.0]]


@given(st.floats(1e-12, 3.14), st.floats(-3.0, 3.0))
def test_small_angles_between_vectors_are_exact(angle: float, start: float) -> None:
    a = np.array([[math.cos(start), math.sin(start), 0.0]])
    b = np.array([[math.cos(start + angle), math.sin(start + angle), 0.0]])
    rounding = rounding_bound(operations=12, functions=4)
    assert vectors.measure_angles(a, b)[0] == pytest.approx(angle, abs=rounding)
    signed = vectors.measure_signed_angles(b[:, :2], a[:, :2])
    assert signed[0] == pytest.approx(-angle, abs=rounding)
