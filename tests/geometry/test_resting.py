"""The faces on which a body rests are known for simple bodies, and rotate with the body."""

import math
from itertools import product

import numpy as np
import pytest

from camgen.geometry.resting import (
    find_centre_of_mass,
    find_hull,
    find_resting_faces,
    make_rotation_down,
    turn_down,
)
from camgen.model.part import IntArray
from camgen.model.pose import FloatArray, rotation_from_fixed_xyz

_BOX = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
TETRAHEDRON = np.array([(1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)], dtype=float)
#: Vertices of the faces, counter-clockwise as seen from outside.
TETRAHEDRON_FACES = np.array([(0, 1, 2), (0, 2, 3), (0, 3, 1), (1, 3, 2)])
ROTATION = rotation_from_fixed_xyz(0.7, -1.1, 2.3)


def make_box(size: tuple[float, float, float], shear: float = 0.0) -> tuple[FloatArray, IntArray]:
    """A box from the origin, or a prism whose top is displaced along x."""
    corners = np.array(list(product((0, 1), repeat=3)), dtype=float)[:, ::-1]
    vertices = corners * size
    vertices[:, 0] += shear * corners[:, 2]
    quads = np.array(_BOX)
    return vertices, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


def test_a_box_rests_on_six_faces_the_largest_first() -> None:
    resting = find_resting_faces(*make_box((60, 40, 30)))
    areas = [round(face.area, 6) for face in resting]
    assert areas == [2400, 2400, 1800, 1800, 1200, 1200]
    assert sorted(tuple(face.normal.tolist()) for face in resting) == sorted(
        [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]
    )
    first = resting[0]
    assert first.size == pytest.approx((60, 40))
    assert first.middle.tolist() == pytest.approx([30, 20, 0 if first.normal[2] < 0 else 30])
    # The box tips over the nearer side, at 20 mm. Its centre is 15 mm high.
    assert first.tipping == pytest.approx(math.atan2(20, 15))


def test_a_plate_does_not_rest_on_its_narrow_sides() -> None:
    resting = find_resting_faces(*make_box((200, 150, 8)))
    assert [abs(face.normal[2]) for face in resting] == [1, 1]
    assert len(find_resting_faces(*make_box((200, 150, 8)), stable=math.radians(1))) == 6


def test_a_regular_tetrahedron_rests_on_four_faces() -> None:
    resting = find_resting_faces(TETRAHEDRON, TETRAHEDRON_FACES)
    assert len(resting) == 4
    side = 2 * math.sqrt(2)
    for face in resting:
        assert face.area == pytest.approx(math.sqrt(3) / 4 * side**2)
        # The tangent is the radius of the inner circle of the face over that of the inner ball.
        assert face.tipping == pytest.approx(math.atan2(side / math.sqrt(12), side / math.sqrt(24)))


@pytest.mark.parametrize(("shear", "rests"), [(35.0, True), (45.0, False)])
def test_a_leaning_prism_rests_on_its_base_while_its_centre_is_above_it(
    shear: float, rests: bool
) -> None:
    """The centre is displaced by half of the shear from the middle of a base of 40 mm."""
    resting = find_resting_faces(*make_box((40, 40, 60), shear), stable=0.0)
    assert any(np.allclose(face.normal, (0, 0, -1)) for face in resting) == rests


def test_a_part_on_three_feet_rests_on_the_feet() -> None:
    plate, faces = make_box((100, 100, 10))
    vertices, triangles = [plate + np.array([0, 0, 20])], [faces]
    for x, y in ((0, 0), (90, 0), (45, 90)):
        foot, faces = make_box((10, 10, 20))
        triangles.append(faces + 8 * len(vertices))
        vertices.append(foot + np.array([x, y, 0]))
    resting = find_resting_faces(np.concatenate(vertices), np.concatenate(triangles))
    down = next(face for face in resting if face.normal[2] < -0.999)
    # The hull of the feet is 100 mm wide for 10 mm, and then a trapezium from 100 to 10 mm.
    assert down.area == pytest.approx(100 * 10 + (100 + 10) / 2 * 90)
    assert down.middle[2] == pytest.approx(0)


def test_the_resting_faces_rotate_with_the_part() -> None:
    vertices, faces = make_box((60, 40, 30), 12.0)
    plain = find_resting_faces(vertices, faces)
    rotated = find_resting_faces(vertices @ ROTATION.T + (5, -80, 300), faces)
    assert len(plain) == len(rotated) > 3
    for face in plain:
        normal = ROTATION @ face.normal
        (same,) = (other for other in rotated if np.allclose(other.normal, normal, atol=1e-6))
        assert same.area == pytest.approx(face.area)
        assert same.tipping == pytest.approx(face.tipping)
        assert np.allclose(same.middle, ROTATION @ face.middle + (5, -80, 300))


def test_an_open_mesh_has_the_centre_of_its_hull() -> None:
    """The box lacks a triangle. The centre of its remaining faces would be displaced."""
    vertices, faces = make_box((60, 40, 30))
    whole, opened = find_resting_faces(vertices, faces), find_resting_faces(vertices, faces[1:])
    assert [face.tipping for face in opened] == pytest.approx([face.tipping for face in whole])
    assert find_resting_faces(vertices[:4], np.array([(0, 1, 2), (1, 3, 2)])) == []


def test_the_centre_of_mass_of_two_bodies_is_their_weighted_mean() -> None:
    """The weights of two boxes are their volumes."""
    (first, faces), (second, _) = make_box((60, 40, 30)), make_box((10, 20, 50))
    vertices = np.concatenate([first, second + np.array([100, 0, 0])])
    centre = find_centre_of_mass(vertices, np.concatenate([faces, faces + 8]))
    volumes = np.array([60 * 40 * 30, 10 * 20 * 50])
    expected = volumes @ np.array([(30, 20, 15), (105, 10, 25)]) / volumes.sum()
    assert centre == pytest.approx(expected)


@pytest.mark.parametrize("normal", [(0, 0, -1), (0, 0, 1), (1, 0, 0), (0.36, -0.48, 0.8)])
def test_the_rotation_makes_the_face_point_down(normal: tuple[float, float, float]) -> None:
    rotation = turn_down(np.array(normal, dtype=float))
    assert np.allclose(rotation @ normal, (0, 0, -1))
    assert np.allclose(rotation @ rotation.T, np.eye(3))
    axis, angle = make_rotation_down(np.array(normal, dtype=float))
    assert angle == pytest.approx(math.acos(-normal[2]))
    assert axis[2] == pytest.approx(0)


def test_a_hull_contains_all_points_and_has_the_known_volume() -> None:
    """The points are a grid in a box, and random points on a ball."""
    rng = np.random.default_rng(5)
    grid = np.stack(np.meshgrid(*[np.linspace(0, 1, 6)] * 3), axis=-1).reshape(-1, 3)
    ball = rng.normal(size=(300, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    for points in (grid * (3, 2, 1) @ ROTATION.T, ball):
        hull = find_hull(points, 1e-9)
        a, b, c = points[hull].transpose(1, 0, 2)
        normals = np.cross(b - a, c - a)
        assert (np.einsum("fpk,fk->fp", points[None] - a[:, None], normals) <= 1e-7).all()
        ends = np.roll(hull, -1, axis=1)
        sides = set(zip(hull.ravel().tolist(), ends.ravel().tolist(), strict=True))
        assert all((end, start) in sides for start, end in sides)
        # A closed surface has two vertices more than half of its triangles (Euler).
        assert len(np.unique(hull)) - len(hull) / 2 == 2
        if points is not ball:
            assert np.einsum("fk,fk->", a, np.cross(b, c)) / 6 == pytest.approx(6)
    assert len(find_hull(np.column_stack([ball[:, :2], 0 * ball[:, 0]]), 1e-9)) == 0
