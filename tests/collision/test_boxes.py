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

SIGNS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
STRAIGHT = np.eye(3)


def boxes(*rows: tuple[object, object, object]) -> Boxes:
    """From centre, axes and half edges of each."""
    return Boxes(*(np.array(column, dtype=float) for column in zip(*rows, strict=True)))


def solid(made: trimesh.Trimesh) -> Solid:
    vertices, faces = frozen(made.vertices), np.asarray(made.faces, dtype=np.int64)
    return Solid("part", "part.stl", "mm", vertices, faces, frozen(made.face_normals), (), (), ())


def mesh(made: trimesh.Trimesh) -> Mesh:
    return make_mesh(solid(made))


def some(count: int, seed: int, spread: float, size: float) -> Boxes:
    rng = np.random.default_rng(seed)
    turns = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0]
    turns *= np.linalg.det(turns)[:, None, None]
    return Boxes(
        rng.uniform(-spread, spread, (count, 3)), turns, rng.uniform(0.05, size, (count, 3))
    )


def corner_up(height: float) -> tuple[object, object, object]:
    """A cube of edge 20 that stands on a corner, which is at ``height``: half of its diagonal is 10 sqrt 3."""
    turn = rotation_about_axis(np.array([1.0, -1, 0]) / math.sqrt(2), math.acos(1 / math.sqrt(3)))
    return (0, 0, height + 10 * math.sqrt(3)), turn, (10, 10, 10)


def edge_meets_box(a: Boxes, b: Boxes, k: int) -> bool:
    """Whether an edge of box a, cut off at the planes of b's faces, keeps a piece; or a's middle is in b."""
    corners = ((a.centres[k] + (SIGNS * a.half[k]) @ a.axes[k].T) - b.centres[k]) @ b.axes[k]
    for i in range(8):
        for j in range(i):
            if (SIGNS[i] != SIGNS[j]).sum() == 1:
                begin, along = corners[i], corners[j] - corners[i]
                with np.errstate(divide="ignore"):
                    cuts = np.sort(
                        [(-b.half[k] - begin) / along, (b.half[k] - begin) / along], axis=0
                    )
                if max(cuts[0].max(), 0) <= min(cuts[1].min(), 1):
                    return True
    return bool((np.abs((a.centres[k] - b.centres[k]) @ b.axes[k]) <= b.half[k]).all())


@pytest.mark.parametrize(
    ("gap", "met"), [(-0.5, True), (-1e-6, True), (0.0, True), (1e-6, False), (0.5, False)], ids=str
)  # fmt: skip
def test_boxes_that_touch_and_do_not(gap: float, met: bool) -> None:
    table = ((0, 0, -5), STRAIGHT, (50, 50, 5))
    turned = rotation_about(2, math.radians(45))
    crossing = math.sqrt(
        2
    )  # a box turned by 45 deg about its long axis shows its edge, sqrt 2 below its middle
    lying = turned.T @ rotation_about(0, math.radians(45))
    others = [
        ((0, 0, 3 + gap), STRAIGHT, (4, 4, 3)),
        ((50 + 4 + gap, 0, -5), STRAIGHT, (4, 4, 3)),
        (((0, 0, 20 + gap)), turned, (4, 4, 20)),
        ((50 + 4 * crossing + gap, 10, -5), turned, (4, 4, 3)),
        corner_up(gap),
        ((0, 0, crossing * 3 + gap), lying, (30, 3, 3)),
    ]
    found = meet(boxes(*[table] * len(others)), boxes(*others))
    assert found.tolist() == [met] * len(others)
    assert meet(boxes(*others), boxes(*[table] * len(others))).tolist() == found.tolist()


def test_two_edges_that_cross_are_seen_apart_though_no_face_parts_them() -> None:
    """Two bars on edge, one along x and one along y: their edges pass at 2 x 3 sqrt 2 between the middles."""
    along_x = rotation_about(0, math.radians(45))
    along_y = rotation_about(2, math.radians(90)) @ along_x
    reach = 6 * math.sqrt(2)
    low = ((0, 0, 0), along_x, (30, 3, 3))
    near, far = (
        ((0, 0, reach - 1e-6), along_y, (30, 3, 3)),
        ((0, 0, reach + 1e-6), along_y, (30, 3, 3)),
    )
    assert meet(boxes(low, low), boxes(near, far)).tolist() == [True, False]


def test_a_box_in_a_box_meets_it() -> None:
    large, small = ((0, 0, 0), STRAIGHT, (50, 50, 50)), corner_up(-20)
    assert meet(boxes(large, small), boxes(small, large)).all()


def test_boxes_meet_where_an_edge_of_one_enters_the_other() -> None:
    a, b = some(1500, 0, 1.0, 1.0), some(1500, 1, 1.0, 1.0)
    expected = [edge_meets_box(a, b, k) or edge_meets_box(b, a, k) for k in range(1500)]
    assert 300 < sum(expected) < 1200
    assert meet(a, b).tolist() == expected


@given(st.integers(0, 10**6), st.floats(0, 2))
def test_growing_a_box_never_removes_a_hit(seed: int, by: float) -> None:
    a, b = some(40, seed, 1.5, 1.0), some(40, seed + 1, 1.5, 1.0)
    assert (meet(a, b) <= meet(a.grown(by), b)).all()


def clipped(triangle: np.ndarray, centre: np.ndarray, axes: np.ndarray, half: np.ndarray) -> bool:
    """Whether something is left of a triangle, cut with the six planes of a box one after the other."""
    polygon = [(corner - centre) @ axes for corner in triangle]
    for axis in range(3):
        for sign in (-1, 1):
            depth = [half[axis] - sign * p[axis] for p in polygon]
            kept = []
            for k, p in enumerate(polygon):
                if depth[k - 1] * depth[k] < 0:
                    kept.append(
                        polygon[k - 1]
                        + (p - polygon[k - 1]) * depth[k - 1] / (depth[k - 1] - depth[k])
                    )
                if depth[k] >= 0:
                    kept.append(p)
            polygon = kept
    return bool(polygon)


def solid_angle(triangles: np.ndarray, point: np.ndarray) -> float:
    """In whole spheres."""
    a, b, c = (triangles - point).transpose(1, 0, 2)
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    under = (
        la * lb * lc
        + (a * b).sum(axis=1) * lc
        + (b * c).sum(axis=1) * la
        + (c * a).sum(axis=1) * lb
    )
    return float(np.arctan2((a * np.cross(b, c)).sum(axis=1), under).sum() / (2 * math.pi))


RING = trimesh.creation.torus(8, 3, major_sections=30, minor_sections=20)


def test_boxes_strike_a_ring_where_a_triangle_cut_with_them_is_left_or_they_are_in_it() -> None:
    every = some(150, 3, 9.0, 3.0)
    triangles = RING.triangles
    expected = [
        any(clipped(t, c, r, h) for t in triangles) or solid_angle(triangles, c) > 0.5
        for c, r, h in zip(every.centres, every.axes, every.half, strict=True)
    ]
    assert 30 < sum(expected) < 120
    assert find_struck(mesh(RING), every).tolist() == expected


def test_a_point_is_inside_where_the_whole_sphere_is_seen() -> None:
    ring = mesh(RING)
    points = np.random.default_rng(4).uniform(-11, 11, (1500, 3))
    expected = [solid_angle(RING.triangles, point) > 0.5 for point in points]
    assert 50 < sum(expected) < 800
    assert are_inside(ring, points).tolist() == expected


def test_rays_through_corners_and_edges_count_once() -> None:
    """A block cut into triangles along a grid: the rays of these points run through corners and sides of them."""
    block = trimesh.creation.box((4, 4, 4)).subdivide().subdivide()
    grid = np.arange(-3.0, 3.5, 0.5)
    points = np.stack(np.meshgrid(grid, grid, grid), axis=-1).reshape(-1, 3)
    points = points[(np.abs(points) != 2).all(axis=1)]
    expected = (np.abs(points) < 2).all(axis=1)
    assert are_inside(mesh(block), points).tolist() == expected.tolist()
    for axis in range(3):
        assert (
            _count_crossings(mesh(block).tree, points, axis).tolist() == (2.0 * expected).tolist()
        )


def test_a_box_within_a_block_strikes_it_and_one_in_a_hollow_does_not() -> None:
    outer, inner = trimesh.creation.box((100, 100, 100)), trimesh.creation.box((60, 60, 60))
    small = boxes(((0, 0, 0), STRAIGHT, (5, 5, 5)))
    wall = boxes(((40, 0, 0), STRAIGHT, (5, 5, 5)))
    assert find_struck(mesh(outer), small).all()
    inner.invert()
    hollow = mesh(trimesh.util.concatenate([outer, inner]))
    assert not find_struck(hollow, small).any()
    assert find_struck(hollow, wall).all()


def test_a_block_within_a_box_is_struck() -> None:
    assert find_struck(
        mesh(trimesh.creation.box((10, 10, 10))), boxes(((3, 0, 0), STRAIGHT, (50, 40, 30)))
    ).all()


def test_a_block_without_its_lid_still_holds_what_is_in_it() -> None:
    block = trimesh.creation.box((100, 100, 100))
    block.update_faces(block.face_normals[:, 2] < 0.5)
    beside = boxes(((0, 0, 0), STRAIGHT, (5, 5, 5)), ((0, 0, 80), STRAIGHT, (5, 5, 5)))
    assert find_struck(mesh(block), beside).tolist() == [True, False]


@pytest.mark.parametrize("gap", [0.25, 12.0])
def test_the_distance_from_a_mesh_is_that_of_the_corner_above_it(gap: float) -> None:
    block = mesh(
        trimesh.creation.box(
            (100, 100, 100), transform=trimesh.transformations.translation_matrix((0, 0, -50))
        )
    )
    above = boxes(corner_up(gap))
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
    wide = low[:, None, None], high[:, None, None]
    _, found, _ = search_tree(
        tree, 1, lambda _, lo, hi: np.flatnonzero(((lo <= wide[1]) & (hi >= wide[0])).all(axis=0))
    )
    expected = ((corners.min(axis=1) <= high) & (corners.max(axis=1) >= low)).all(axis=1)
    assert len(found) == len(set(found.tolist())) == expected.sum()
    assert sorted(tree.corners[found].tolist()) == sorted(corners[expected].tolist())


def test_boxes_are_no_nearer_than_the_best_axis_parts_them_and_as_near_where_no_corner_is_nearest() -> (
    None
):
    a, b = some(2000, 5, 60.0, 15.0), some(2000, 6, 60.0, 15.0)
    bound, met = bound_distances(a, b), meet(a, b)
    assert ((bound <= 1e-6) == met).all()
    free = np.flatnonzero(~met)
    exact = np.array(
        [measure_distance(make_box_object(a, k), make_box_object(b, k)) for k in free.tolist()]
    )
    assert (bound[free] <= exact + 1e-6).all()
    # Corners against corners are parted by less: of boxes at random that is so of a part.
    assert np.median(bound[free] / exact) > 0.9
    rows = [
        ((9, 1, 2), STRAIGHT, (2, 3, 4)),
        ((7, 7, 0), rotation_about(2, math.radians(45)), (1, 1, 50)),
    ]
    stand = boxes(*[((0, 0, 0), STRAIGHT, (4, 4, 4))] * 2)
    # Face to face, and the upright edges of two pillars across their diagonals.
    assert bound_distances(stand, boxes(*rows))[0] == pytest.approx(3.0, abs=1e-6)
    assert bound_distances(stand, boxes(*rows))[1] == pytest.approx(3 * math.sqrt(2) - 1, abs=1e-6)
