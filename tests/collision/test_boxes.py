import itertools
import math

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from camgen.collision.boxes import Boxes, bound_distances, meet
from camgen.collision.mesh import (
    Mesh,
    _count_crossings,
    are_inside,
    find_struck,
    make_box_object,
    make_mesh,
    measure_distance,
)
from camgen.collision.tree import make_tree, search_tree
from camgen.model.part import Solid
from camgen.model.pose import frozen, rotation_about, rotation_about_axis

SIGNS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
UPRIGHT = np.eye(3)


def make_boxes(*rows: tuple[object, object, object]) -> Boxes:
    """Boxes from the centre, the axes and the half lengths of each."""
    return Boxes(*(np.array(column, dtype=float) for column in zip(*rows, strict=True)))


def make_solid(shape: trimesh.Trimesh) -> Solid:
    vertices, faces = frozen(shape.vertices), np.asarray(shape.faces, dtype=np.int64)
    return Solid("part", "part.stl", "mm", vertices, faces, frozen(shape.face_normals), (), (), ())


def mesh_of(shape: trimesh.Trimesh) -> Mesh:
    return make_mesh(make_solid(shape))


def draw_boxes(count: int, seed: int, spread: float, size: float) -> Boxes:
    """Random boxes; centres within +-`spread`, half lengths up to `size`."""
    rng = np.random.default_rng(seed)
    rotations = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0]
    rotations *= np.linalg.det(rotations)[:, None, None]
    return Boxes(
        rng.uniform(-spread, spread, (count, 3)), rotations, rng.uniform(0.05, size, (count, 3))
    )


def cube_on_corner(height: float) -> tuple[object, object, object]:
    """A cube with edges of 20 mm that stands on a corner at `height` mm.

    Half of its diagonal is 10 sqrt 3 mm.
    """
    rotation = rotation_about_axis(
        np.array([1.0, -1, 0]) / math.sqrt(2), math.acos(1 / math.sqrt(3))
    )
    return (0, 0, height + 10 * math.sqrt(3)), rotation, (10, 10, 10)


def does_edge_enter(a: Boxes, b: Boxes, k: int) -> bool:
    """Whether an edge of box a is partly inside the faces of box b, or the middle of a is in b."""
    corners = ((a.centres[k] + (SIGNS * a.half[k]) @ a.axes[k].T) - b.centres[k]) @ b.axes[k]
    for i in range(8):
        for j in range(i):
            if (SIGNS[i] != SIGNS[j]).sum() == 1:
                start, edge = corners[i], corners[j] - corners[i]
                with np.errstate(divide="ignore"):
                    cuts = np.sort(
                        [(-b.half[k] - start) / edge, (b.half[k] - start) / edge], axis=0
                    )
                if max(cuts[0].max(), 0) <= min(cuts[1].min(), 1):
                    return True
    return bool((np.abs((a.centres[k] - b.centres[k]) @ b.axes[k]) <= b.half[k]).all())


@pytest.mark.parametrize(
    ("gap", "meets"),
    [(-0.5, True), (-1e-6, True), (0.0, True), (1e-6, False), (0.5, False)],
    ids=str,
)
def test_boxes_meet_if_they_touch_and_not_if_there_is_a_gap(gap: float, meets: bool) -> None:
    table = ((0, 0, -5), UPRIGHT, (50, 50, 5))
    quarter = rotation_about(2, math.radians(45))
    # A box rotated by 45 deg about its long axis has its edge sqrt 2 half widths below its middle.
    diagonal = math.sqrt(2)
    lying = quarter.T @ rotation_about(0, math.radians(45))
    others = [
        ((0, 0, 3 + gap), UPRIGHT, (4, 4, 3)),
        ((50 + 4 + gap, 0, -5), UPRIGHT, (4, 4, 3)),
        (((0, 0, 20 + gap)), quarter, (4, 4, 20)),
        ((50 + 4 * diagonal + gap, 10, -5), quarter, (4, 4, 3)),
        cube_on_corner(gap),
        ((0, 0, diagonal * 3 + gap), lying, (30, 3, 3)),
    ]
    result = meet(make_boxes(*[table] * len(others)), make_boxes(*others))
    assert result.tolist() == [meets] * len(others)
    assert meet(make_boxes(*others), make_boxes(*[table] * len(others))).tolist() == result.tolist()


def test_boxes_that_only_an_axis_across_two_edges_separates_do_not_meet() -> None:
    """Two bars stand on their edges, one along x and one along y.

    Their edges touch if the middles are 2 x 3 sqrt 2 mm apart.
    """
    along_x = rotation_about(0, math.radians(45))
    along_y = rotation_about(2, math.radians(90)) @ along_x
    distance = 6 * math.sqrt(2)
    lower = ((0, 0, 0), along_x, (30, 3, 3))
    upper = [((0, 0, distance + gap), along_y, (30, 3, 3)) for gap in (-1e-6, 1e-6)]
    assert meet(make_boxes(lower, lower), make_boxes(*upper)).tolist() == [True, False]


def test_a_box_inside_another_meets_it() -> None:
    large, small = ((0, 0, 0), UPRIGHT, (50, 50, 50)), cube_on_corner(-20)
    assert meet(make_boxes(large, small), make_boxes(small, large)).all()


def test_boxes_meet_if_an_edge_of_one_enters_the_other() -> None:
    a, b = draw_boxes(1500, 0, 1.0, 1.0), draw_boxes(1500, 1, 1.0, 1.0)
    expected = [does_edge_enter(a, b, k) or does_edge_enter(b, a, k) for k in range(1500)]
    assert 300 < sum(expected) < 1200
    assert meet(a, b).tolist() == expected


@given(st.integers(0, 10**6), st.floats(0, 2))
def test_an_enlarged_box_meets_whatever_the_box_meets(seed: int, growth: float) -> None:
    a, b = draw_boxes(40, seed, 1.5, 1.0), draw_boxes(40, seed + 1, 1.5, 1.0)
    assert (meet(a, b) <= meet(a.grown(growth), b)).all()


def does_clipping_leave_any(
    triangle: np.ndarray, centre: np.ndarray, axes: np.ndarray, half: np.ndarray
) -> bool:
    """Whether anything is left of a triangle that is clipped at the six faces of a box."""
    polygon = [(corner - centre) @ axes for corner in triangle]
    for axis in range(3):
        for sign in (-1, 1):
            depths = [half[axis] - sign * point[axis] for point in polygon]
            clipped = []
            for k, point in enumerate(polygon):
                if depths[k - 1] * depths[k] < 0:
                    clipped.append(
                        polygon[k - 1]
                        + (point - polygon[k - 1]) * depths[k - 1] / (depths[k - 1] - depths[k])
                    )
                if depths[k] >= 0:
                    clipped.append(point)
            polygon = clipped
    return bool(polygon)


def measure_solid_angle(triangles: np.ndarray, point: np.ndarray) -> float:
    """The solid angle of triangles seen from a point, as a fraction of the sphere."""
    a, b, c = (triangles - point).transpose(1, 0, 2)
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    denominator = (
        la * lb * lc
        + (a * b).sum(axis=1) * lc
        + (b * c).sum(axis=1) * la
        + (c * a).sum(axis=1) * lb
    )
    return float(np.arctan2((a * np.cross(b, c)).sum(axis=1), denominator).sum() / (2 * math.pi))


RING = trimesh.creation.torus(8, 3, major_sections=30, minor_sections=20)


def test_a_box_strikes_a_ring_if_it_contains_a_triangle_or_is_inside_the_ring() -> None:
    drawn = draw_boxes(150, 3, 9.0, 3.0)
    triangles = RING.triangles
    expected = []
    for centre, axes, half in zip(drawn.centres, drawn.axes, drawn.half, strict=True):
        cuts = any(does_clipping_leave_any(triangle, centre, axes, half) for triangle in triangles)
        expected.append(cuts or measure_solid_angle(triangles, centre) > 0.5)
    assert 30 < sum(expected) < 120
    assert find_struck(mesh_of(RING), drawn).tolist() == expected


def test_a_point_is_inside_if_the_mesh_covers_its_whole_sphere() -> None:
    ring = mesh_of(RING)
    points = np.random.default_rng(4).uniform(-11, 11, (1500, 3))
    expected = [measure_solid_angle(RING.triangles, point) > 0.5 for point in points]
    assert 50 < sum(expected) < 800
    assert are_inside(ring, points).tolist() == expected


def test_rays_through_corners_and_edges_count_once() -> None:
    """The triangles of the block are on a grid; rays of the points pass corners and sides."""
    block = trimesh.creation.box((4, 4, 4)).subdivide().subdivide()
    grid = np.arange(-3.0, 3.5, 0.5)
    points = np.stack(np.meshgrid(grid, grid, grid), axis=-1).reshape(-1, 3)
    points = points[(np.abs(points) != 2).all(axis=1)]
    expected = (np.abs(points) < 2).all(axis=1)
    assert are_inside(mesh_of(block), points).tolist() == expected.tolist()
    for axis in range(3):
        assert (
            _count_crossings(mesh_of(block).tree, points, axis).tolist()
            == (2.0 * expected).tolist()
        )


def test_a_box_inside_a_block_strikes_it_and_one_in_a_hollow_does_not() -> None:
    outer, inner = trimesh.creation.box((100, 100, 100)), trimesh.creation.box((60, 60, 60))
    small = make_boxes(((0, 0, 0), UPRIGHT, (5, 5, 5)))
    wall = make_boxes(((40, 0, 0), UPRIGHT, (5, 5, 5)))
    assert find_struck(mesh_of(outer), small).all()
    inner.invert()
    hollow = mesh_of(trimesh.util.concatenate([outer, inner]))
    assert not find_struck(hollow, small).any()
    assert find_struck(hollow, wall).all()


def test_a_block_inside_a_box_is_struck() -> None:
    assert find_struck(
        mesh_of(trimesh.creation.box((10, 10, 10))), make_boxes(((3, 0, 0), UPRIGHT, (50, 40, 30)))
    ).all()


def test_a_box_inside_a_block_without_its_lid_strikes_it() -> None:
    block = trimesh.creation.box((100, 100, 100))
    block.update_faces(block.face_normals[:, 2] < 0.5)
    small = make_boxes(((0, 0, 0), UPRIGHT, (5, 5, 5)), ((0, 0, 80), UPRIGHT, (5, 5, 5)))
    assert find_struck(mesh_of(block), small).tolist() == [True, False]


@pytest.mark.parametrize("gap", [0.25, 12.0])
def test_the_distance_of_a_cube_from_a_mesh_is_that_of_its_corner(gap: float) -> None:
    block = mesh_of(
        trimesh.creation.box(
            (100, 100, 100), transform=trimesh.transformations.translation_matrix((0, 0, -50))
        )
    )
    above = make_boxes(cube_on_corner(gap))
    assert not find_struck(block, above).any()
    assert find_struck(block, above.grown(gap)).all()
    assert measure_distance(block.surface, make_box_object(above, 0)) == pytest.approx(
        gap, abs=1e-9
    )


@pytest.mark.parametrize("count", [1, 7, 8, 9, 64, 65, 700])
def test_the_tree_finds_every_triangle_once(count: int) -> None:
    rng = np.random.default_rng(count)
    corners = rng.uniform(0, 10, (count, 1, 3)) + rng.uniform(0, 1, (count, 3, 3))
    tree = make_tree(corners)
    low, high = np.array([2.0, 3, 1]), np.array([6.0, 7, 9])
    query = low[:, None, None], high[:, None, None]
    _, indices, _ = search_tree(
        tree,
        1,
        lambda _, lower, upper: np.flatnonzero(
            ((lower <= query[1]) & (upper >= query[0])).all(axis=0)
        ),
    )
    expected = ((corners.min(axis=1) <= high) & (corners.max(axis=1) >= low)).all(axis=1)
    assert len(indices) == len(set(indices.tolist())) == expected.sum()
    assert sorted(tree.corners[indices].tolist()) == sorted(corners[expected].tolist())


def test_the_distance_bound_is_below_the_distance_and_exact_for_faces_and_edges() -> None:
    a, b = draw_boxes(2000, 5, 60.0, 15.0), draw_boxes(2000, 6, 60.0, 15.0)
    bound, meets = bound_distances(a, b), meet(a, b)
    assert ((bound <= 1e-6) == meets).all()
    separate = np.flatnonzero(~meets)
    exact = np.array(
        [measure_distance(make_box_object(a, k), make_box_object(b, k)) for k in separate.tolist()]
    )
    assert (bound[separate] <= exact + 1e-6).all()
    # The bound is smaller than the distance only if two corners are nearest, as for some of these.
    assert np.median(bound[separate] / exact) > 0.9
    rows = [
        ((9, 1, 2), UPRIGHT, (2, 3, 4)),
        ((7, 7, 0), rotation_about(2, math.radians(45)), (1, 1, 50)),
    ]
    pillars = make_boxes(*[((0, 0, 0), UPRIGHT, (4, 4, 4))] * 2)
    # Two faces, and the upright edges of two pillars opposite each other.
    assert bound_distances(pillars, make_boxes(*rows))[0] == pytest.approx(3.0, abs=1e-6)
    assert bound_distances(pillars, make_boxes(*rows))[1] == pytest.approx(
        3 * math.sqrt(2) - 1, abs=1e-6
    )
