"""Curves in space as chains, and the nearest place of a surface: judged by formulas and by dense samples."""

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

#: A frame that is not square to any axis: columns u, v, w.
FRAME = np.linalg.qr(np.array([[1.0, 0.3, -0.2], [0.4, 1.0, 0.5], [0.1, -0.6, 1.0]]))[0]


def to_chain(points: FloatArray, chain: FloatArray) -> FloatArray:
    """The distance of each point (K, 3) from the chain of straight lines (N, 3)."""
    start, along = chain[:-1], np.diff(chain, axis=0)
    share = np.einsum("kni,ni->kn", points[:, None] - start, along) / np.einsum(
        "ni,ni->n", along, along
    )
    foot = start + np.clip(share, 0, 1)[:, :, None] * along
    return np.asarray(np.linalg.norm(points[:, None] - foot, axis=2).min(axis=1))


@pytest.mark.parametrize("sweep", [0.5, 3.0, 4.0, 2 * math.pi, -5.0])
def test_circles_stay_arcs_in_any_plane(sweep: float) -> None:
    center, u, v, w = np.array([7.0, -3.0, 2.0]), *(12 * FRAME.T)
    points, via = make_turn(center, u, v, 0.4, 0.4 + sweep, 0.01)
    assert len(via) == math.ceil(abs(sweep) / math.pi - 1e-12)
    for rows in (points, via):
        assert np.linalg.norm(rows - center, axis=1) == pytest.approx(12, abs=1e-12)
        assert (rows - center) @ w == pytest.approx(0, abs=1e-12)
    # Half-way: as far from the start of its arc as from the end.
    before, after = (
        np.linalg.norm(via - points[:-1], axis=1),
        np.linalg.norm(via - points[1:], axis=1),
    )
    assert before == pytest.approx(after, abs=1e-12)
    assert points[-1] == pytest.approx(
        center + math.cos(0.4 + sweep) * u + math.sin(0.4 + sweep) * v
    )


@pytest.mark.parametrize("chord", [0.1, 0.01, 0.001])
def test_ellipses_become_chords_within_the_tolerance_and_not_far_within(chord: float) -> None:
    u, v = 20 * FRAME[:, 0], 7 * FRAME[:, 1]
    points, via = make_turn(np.zeros(3), u, v, 0.0, 2 * math.pi, chord)
    assert np.isnan(via).all()
    t = np.linspace(0, 2 * math.pi, 4000)
    off = to_chain(np.cos(t)[:, None] * u + np.sin(t)[:, None] * v, points).max()
    assert chord / 4 < off <= chord


@pytest.mark.parametrize(
    ("weights", "chord"), [(None, 0.01), ((1, 0.3, 4, 1), 0.01), (None, 0.0005)]
)
def test_splines_in_space_become_chords_within_the_tolerance(
    weights: tuple[float, ...] | None, chord: float
) -> None:
    control = np.array([[0, 0, 0], [30, 40, 10], [-5, 45, -20], [40, 0, 30]], dtype=np.float64)
    weight = None if weights is None else np.array(weights, dtype=np.float64)
    found = make_chords(
        make_bspline(control, np.array([0, 0, 0, 0, 1, 1, 1, 1.0]), 3, weight), chord
    )
    # Bernstein's form, written out.
    t = np.linspace(0, 1, 3000)[:, None]
    basis = np.hstack([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3])
    basis = basis * (1.0 if weight is None else weight)
    curve = basis @ control / basis.sum(axis=1, keepdims=True)
    assert found[0] == pytest.approx(control[0])
    assert found[-1] == pytest.approx(control[-1])
    off = to_chain(curve, found).max()
    assert chord / 10 < off <= chord
    assert to_chain(found, curve).max() < 1e-3


def test_a_spline_of_infinite_numbers_is_told_and_not_tried() -> None:
    segments = np.ones((1, 4, 4))
    segments[0, 1] = np.inf
    assert np.isnan(make_chords(segments, 0.01)).all()


def cylinder(radius: float, length: float, sections: int) -> Solid:
    """About z."""
    part = camgen.part(trimesh.creation.cylinder(radius, length, sections=sections))
    assert part.solid is not None
    return part.solid


def test_the_normal_runs_round_a_cylinder_evenly() -> None:
    angle = np.linspace(0.0, 2 * math.pi, 217)
    points = np.column_stack([21 * np.cos(angle), 21 * np.sin(angle), np.linspace(-15, 15, 217)])
    found = find_nearest(cylinder(20, 40, 48), points)
    radial = points * (1, 1, 0) / 21
    lean = np.degrees(np.arccos(np.clip((found.normal * radial).sum(axis=1), -1, 1)))
    # The flat of a section is 7.5 deg wide: its own normal would be off by up to 3.75 deg.
    assert lean.max() < 0.3
    # A flat lies up to 20 (1 - cos 3.75 deg) within.
    assert found.distance.min() == pytest.approx(1, abs=1e-6)
    assert found.distance.max() <= 1 + 20 * (1 - math.cos(math.radians(3.75))) + 1e-9


def test_the_nearest_place_is_on_a_face_a_side_or_a_corner_of_a_box() -> None:
    part = camgen.part(trimesh.creation.box((20, 10, 6)))
    assert part.solid is not None
    points = np.array([[1, 2, 9], [12, 1, 5], [13, 9, 7], [1, 1, 2], [-14, 0, 0]], dtype=np.float64)
    found = find_nearest(part.solid, points)
    place = [[1, 2, 3], [10, 1, 3], [10, 5, 3], [1, 1, 3], [-10, 0, 0]]
    assert found.place == pytest.approx(np.array(place))
    assert found.distance == pytest.approx([6, math.sqrt(8), math.sqrt(9 + 16 + 16), 1, 4])
    assert found.normal[[0, 3, 4]] == pytest.approx(np.array([[0, 0, 1], [0, 0, 1], [-1, 0, 0]]))
