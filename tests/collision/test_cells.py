"""The grid of cells over a mesh gives the same results as its triangles."""

from pathlib import Path

import numpy as np
import pytest

import camgen
from camgen.collision.boxes import Boxes
from camgen.collision.cells import PASSED, UNKNOWN, divide_space
from camgen.collision.mesh import _meet_surface, are_inside, find_struck, make_mesh
from camgen.geometry.rotations import make_rotations_from_vectors
from camgen.model.part import Solid

PARTS = Path(__file__).parents[2] / "fixtures" / "parts"


@pytest.fixture(scope="module")
def solid() -> Solid:
    result = camgen.read(PARTS / "rfa1.stl").solid
    assert result is not None
    return result


def draw_boxes_around(solid: Solid, count: int) -> Boxes:
    """Random boxes in and up to 30 mm around a solid."""
    rng = np.random.default_rng(7)
    low, high = solid.vertices.min(axis=0) - 30, solid.vertices.max(axis=0) + 30
    half = rng.uniform(0.2, 12.0, (count, 3))
    return Boxes(
        rng.uniform(low, high, (count, 3)),
        make_rotations_from_vectors(rng.normal(size=(count, 3))),
        half,
    )


def test_boxes_strike_a_closed_mesh_as_a_test_of_all_triangles_finds(solid: Solid) -> None:
    mesh, boxes = make_mesh(solid), draw_boxes_around(solid, 4000)
    assert mesh.closed
    expected = are_inside(mesh, boxes.centres) | _meet_surface(mesh.tree, boxes)
    assert 0.1 < expected.mean() < 0.9
    np.testing.assert_array_equal(find_struck(mesh, boxes), expected)


def test_a_box_that_meets_the_surface_is_near_its_cells(solid: Solid) -> None:
    mesh, boxes = make_mesh(solid), draw_boxes_around(solid, 4000)
    near = divide_space(mesh.tree.corners).near(boxes.centres, boxes.reach)
    meets = _meet_surface(mesh.tree, boxes)
    assert near[meets].all()
    assert (~near).mean() > 0.2


def test_points_of_a_plate_are_in_passed_cells() -> None:
    corners = np.array([[[0.0, 0, 0], [100, 0, 0], [0, 100, 0]]])
    cells = divide_space(corners)
    weights = np.random.default_rng(1).dirichlet([1, 1, 1], 500)
    rows, cell = cells.locate(weights @ corners[0])
    assert len(rows) == 500
    assert (cells.state.ravel()[cell] == PASSED).all()
    _, cell = cells.locate(np.array([[90.0, 90.0, 0.0]]))
    assert cells.state.ravel()[cell].tolist() == [UNKNOWN]
    np.testing.assert_allclose(cells.middles(cell), [[90.0, 90.0, 0.0]], atol=cells.size / 2)
    rows, _ = cells.locate(np.array([[90.0, 90.0, 50.0], [np.inf, 0.0, 0.0]]))
    assert len(rows) == 0


def test_points_of_triangles_of_any_shape_are_in_passed_cells() -> None:
    rng = np.random.default_rng(2)
    corners = rng.uniform(-50.0, 50.0, (60, 3, 3))
    # Some triangles are slivers, needles or points. Any of their sides may be the longest.
    corners[:20, 2] = corners[:20, 0] + rng.uniform(0.0, 1.0, (20, 1)) * (
        corners[:20, 1] - corners[:20, 0]
    )
    corners[20:24, 1] = corners[20:24, 0]
    corners[24] = corners[24, 0]
    corners = corners[:, rng.permutation(3)]
    cells = divide_space(corners)
    weights = rng.dirichlet([0.4, 0.4, 0.4], (len(corners), 2000))
    points = np.einsum("fnk,fkj->fnj", weights, corners).reshape(-1, 3)
    rows, cell = cells.locate(points)
    assert len(rows) == len(points)
    assert (cells.state.ravel()[cell] == PASSED).all()
    # Marked cells are less than three cells from the surface.
    passed = cells.middles(np.flatnonzero(cells.state.ravel() == PASSED))
    distances = [np.linalg.norm(points - middle, axis=1).min() for middle in passed[::50]]
    assert max(distances) < 3 * cells.size
