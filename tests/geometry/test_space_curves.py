"""Curves in space become chains, and nearest points of surfaces are found, as formulas give."""

import math

import numpy as np
import pytest
import trimesh

import camgen
from camgen.geometry.curves import make_bspline
from camgen.geometry.space_curves import make_chords, make_turn
from camgen.geometry.surface import find_nearest
from camgen.model.part import Solid
from camgen.model.pose import FloatArray

#: A frame that is parallel to no axis, with the columns u, v and w.
FRAME = np.linalg.qr(np.array([[1.0, 0.3, -0.2], [0.4, 1.0, 0.5], [0.1, -0.6, 1.0]]))[0]


def measure_distances(points: FloatArray, chain: FloatArray) -> FloatArray:
    """Distance (K,) of each point (K, 3) from the chain of straight lines (N, 3), mm."""
    start, chords = chain[:-1], np.diff(chain, axis=0)
    squares = np.einsum("ni,ni->n", chords, chords)
    fraction = np.einsum("kni,ni->kn", points[:, None] - start, chords) / squares
    foot = start + np.clip(fraction, 0, 1)[:, :, None] * chords
    return np.asarray(np.linalg.norm(points[:, None] - foot, axis=2).min(axis=1))


@pytest.mark.parametrize("sweep", [0.5, 3.0, 4.0, 2 * math.pi, -5.0])
def test_a_circle_in_any_plane_becomes_arcs(sweep: float) -> None:
    center, u, v, w = np.array([7.0, -3.0, 2.0]), *(12 * FRAME.T)
    points, via = make_turn(center, u, v, 0.4, 0.4 + sweep, 0.01)
    assert len(via) == math.ceil(abs(sweep) / math.pi - 1e-12)
    for rows in (points, via):
        assert np.linalg.norm(rows - center, axis=1) == pytest.approx(12, abs=1e-12)
        assert (rows - center) @ w == pytest.approx(0, abs=1e-12)
    # A via point is as far from the start of its arc as from the end.
    from_start = np.linalg.norm(via - points[:-1], axis=1)
    assert from_start == pytest.approx(np.linalg.norm(via - points[1:], axis=1), abs=1e-12)
    end = center + math.cos(0.4 + sweep) * u + math.sin(0.4 + sweep) * v
    assert points[-1] == pytest.approx(end)


@pytest.mark.parametrize("chord", [0.1, 0.01, 0.001])
def test_the_chords_of_an_ellipse_use_at_least_a_quarter_of_the_tolerance(chord: float) -> None:
    u, v = 20 * FRAME[:, 0], 7 * FRAME[:, 1]
    points, via = make_turn(np.zeros(3), u, v, 0.0, 2 * math.pi, chord)
    assert np.isnan(via).all()
    t = np.linspace(0, 2 * math.pi, 4000)
    deviation = measure_distances(np.cos(t)[:, None] * u + np.sin(t)[:, None] * v, points).max()
    assert chord / 4 < deviation <= chord


@pytest.mark.parametrize(
    ("weights", "chord"), [(None, 0.01), ((1, 0.3, 4, 1), 0.01), (None, 0.0005)]
)
def test_a_spline_in_space_becomes_chords_within_the_tolerance(
    weights: tuple[float, ...] | None, chord: float
) -> None:
    control = np.array([[0, 0, 0], [30, 40, 10], [-5, 45, -20], [40, 0, 30]], dtype=np.float64)
    weight = None if weights is None else np.array(weights, dtype=np.float64)
    spline = make_bspline(control, np.array([0, 0, 0, 0, 1, 1, 1, 1.0]), 3, weight)
    chords = make_chords(spline, chord)
    # The polynomials of Bernstein, written out.
    t = np.linspace(0, 1, 3000)[:, None]
    basis = np.hstack([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3])
    basis = basis * (1.0 if weight is None else weight)
    curve = basis @ control / basis.sum(axis=1, keepdims=True)
    assert chords[0] == pytest.approx(control[0])
    assert chords[-1] == pytest.approx(control[-1])
    deviation = measure_distances(curve, chords).max()
    assert chord / 10 < deviation <= chord
    assert measure_distances(chords, curve).max() < 1e-3


def test_a_spline_with_infinite_numbers_gives_nan() -> None:
    segments = np.ones((1, 4, 4))
    segments[0, 1] = np.inf
    assert np.isnan(make_chords(segments, 0.01)).all()


def cylinder(radius: float, length: float, sections: int) -> Solid:
    """A cylinder around z."""
    part = camgen.part(trimesh.creation.cylinder(radius, length, sections=sections))
    assert part.solid is not None
    return part.solid


def test_the_normal_of_a_meshed_cylinder_is_interpolated() -> None:
    angle = np.linspace(0.0, 2 * math.pi, 217)
    points = np.column_stack([21 * np.cos(angle), 21 * np.sin(angle), np.linspace(-15, 15, 217)])
    nearest = find_nearest(cylinder(20, 40, 48), points)
    radial = points * (1, 1, 0) / 21
    error_deg = np.degrees(np.arccos(np.clip((nearest.normal * radial).sum(axis=1), -1, 1)))
    # A flat face is 7.5 deg wide. Its normal would deviate by up to 3.75 deg.
    assert error_deg.max() < 0.3
    # A flat face lies up to 20 (1 - cos 3.75 deg) inside the cylinder.
    assert nearest.distance.min() == pytest.approx(1, abs=1e-6)
    assert nearest.distance.max() <= 1 + 20 * (1 - math.cos(math.radians(3.75))) + 1e-9


def test_the_nearest_point_is_on_a_face_an_edge_or_a_corner_of_a_box() -> None:
    part = camgen.part(trimesh.creation.box((20, 10, 6)))
    assert part.solid is not None
    points = np.array([[1, 2, 9], [12, 1, 5], [13, 9, 7], [1, 1, 2], [-14, 0, 0]], dtype=np.float64)
    nearest = find_nearest(part.solid, points)
    expected = [[1, 2, 3], [10, 1, 3], [10, 5, 3], [1, 1, 3], [-10, 0, 0]]
    assert nearest.place == pytest.approx(np.array(expected))
    assert nearest.distance == pytest.approx([6, math.sqrt(8), math.sqrt(9 + 16 + 16), 1, 4])
    assert nearest.normal[[0, 3, 4]] == pytest.approx(np.array([[0, 0, 1], [0, 0, 1], [-1, 0, 0]]))
