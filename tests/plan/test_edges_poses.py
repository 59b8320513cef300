"""Poses along edges, compared with the formulas of a block and of a cylinder."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from camgen.geometry.ragged import compute_offsets
from camgen.model.pose import FloatArray, rotation_about
from camgen.motion.pose_paths import PosePath, count_parts, divide
from camgen.motion.setup import FoldedEdge, UnreachableEdge
from camgen.plan.edges.last_face import TOP
from camgen.plan.edges.poses import make_poses
from tests.support.edge_shapes import rim, straight

H = math.sqrt(0.5)
FRONT = straight((0, 0, 50), (100, 0, 50), (0, 0, 1), (0, -1, 0))


def check_path(path: PosePath | UnreachableEdge) -> PosePath:
    assert isinstance(path, PosePath)
    return path


def test_the_poses_of_the_front_edge_of_a_block_point_into_the_edge() -> None:
    path = check_path(make_poses(FRONT, 10))
    assert np.allclose(path.position, [[0, -10 * H, 50 + 10 * H], [100, -10 * H, 50 + 10 * H]])
    # z points into the edge, x down the front, and y = z cross x runs against the edge.
    expected = np.column_stack([(0, -H, -H), (-1, 0, 0), (0, H, -H)])
    assert np.allclose(path.rotation, expected)
    assert np.isnan(path.via).all()


def test_the_offset_along_the_burr_is_the_normal_of_the_face_that_points_up() -> None:
    path = check_path(make_poses(FRONT, 10, TOP))
    assert np.allclose(path.position, [[0, 0, 60], [100, 0, 60]])
    assert np.allclose(path.rotation[:, :, 2], [0, 0, -1])
    swapped = straight((0, 0, 50), (100, 0, 50), (0, -1, 0), (0, 0, 1))
    assert np.allclose(check_path(make_poses(swapped, 10, TOP)).rotation, path.rotation)


def test_the_offset_along_the_burr_of_a_bore_in_a_wall_is_the_normal_of_the_wall() -> None:
    bore = rim((0, 0, 0), 20, outer=False)
    turned = rotation_about(1, math.pi / 2).T
    wall = type(bore)(
        bore.id, bore.kind, bore.points @ turned, bore.via @ turned, bore.normals[:, ::-1] @ turned,
        bore.via_normals[:, ::-1] @ turned, bore.angle, True, True, 20.0, bore.length,
    )  # fmt: skip
    assert np.allclose(check_path(make_poses(wall, 5, TOP)).rotation[:, :, 2], [-1, 0, 0])


def test_an_upright_edge_has_a_horizontal_x_and_y_upwards() -> None:
    for ends in ((0, 0, 0), (0, 0, 40)), ((0, 0, 40), (0, 0, 0)):
        path = check_path(make_poses(straight(*ends, (-1, 0, 0), (0, -1, 0)), 2))
        assert np.allclose(path.rotation[:, :, 1], [0, 0, 1])
        assert np.allclose(path.rotation[:, :, 2], [H, H, 0])


@pytest.mark.parametrize(("outer", "radius"), [(True, 20 + 4 * H), (False, 20 - 4 * H)])
def test_the_rim_of_a_cylinder_stays_a_circle(outer: bool, radius: float) -> None:
    path = check_path(make_poses(rim((5, 6, 30), 20, outer), 4))
    assert len(path) == 5  # arcs of 120 deg and more are halved
    for points, angles in (
        (path.position, np.arange(5) * 90),
        (path.via[1:], np.arange(4) * 90 + 45),
    ):
        a = np.radians(angles)
        circle = np.column_stack(
            [5 + radius * np.cos(a), 6 + radius * np.sin(a), np.full(len(a), 30 + 4 * H)]
        )
        assert np.allclose(points, circle)
    sign = -1 if outer else 1
    for k, rotation in enumerate(path.rotation):
        outwards = np.array([math.cos(k * math.pi / 2), math.sin(k * math.pi / 2), 0])
        assert np.allclose(rotation[:, 2], sign * H * outwards + [0, 0, -H])
        assert rotation[2, 0] == pytest.approx(-H)


def test_an_offset_that_closes_the_bore_is_refused() -> None:
    refused = make_poses(rim((0, 0, 0), 5, outer=False), 8)
    assert isinstance(refused, UnreachableEdge)
    assert (refused.kind, refused.text) == (
        "shape",
        "an offset of 8 mm leaves nothing of its inner radius",
    )
    assert isinstance(make_poses(rim((0, 0, 0), 5, outer=False), 6), PosePath)  # 6 / sqrt 2 < 5


def test_an_edge_with_one_segment_folded_by_the_offset_keeps_the_others() -> None:
    """The normals at the ends of the middle segment of 0.2 mm converge by 0.2 rad."""
    points = np.array([[0, 0, 0], [10, 0, 0], [10.2, 0, 0], [20, 0, 0]], dtype=float)
    up, inwards = np.tile([0.0, 0.0, 1.0], (4, 1)), np.tile([0.0, -1.0, 0.0], (4, 1))
    turn = 0.1
    inwards[1] = [math.sin(turn), -math.cos(turn), 0.0]
    inwards[2] = [-math.sin(turn), -math.cos(turn), 0.0]
    normals = np.stack([up, inwards], axis=1)
    middles = normals[:-1] + normals[1:]
    middles /= np.linalg.norm(middles, axis=2, keepdims=True)
    edge = replace(
        straight((0, 0, 0), (20, 0, 0), (0, 0, 1), (0, -1, 0)),
        points=points,
        via=(points[:-1] + points[1:]) / 2,
        normals=normals,
        via_normals=middles,
    )
    folded = make_poses(edge, 2)
    assert isinstance(folded, FoldedEdge)
    assert folded.folded.tolist() == [False, True, False]
    assert "10 mm along it" in folded.text
    assert np.linalg.norm(folded.path.position - points, axis=1) == pytest.approx([2.0] * 4)
    # An offset by which the middle segment keeps some of its length folds nothing.
    assert isinstance(make_poses(edge, 0.9 * 0.2 / (2 * H * turn)), PosePath)


def test_an_edge_of_opposite_faces_has_no_mean_direction_and_is_refused() -> None:
    refused = make_poses(straight((0, 0, 0), (9, 0, 0), (0, 1, 0), (0, -1, 0)), 1)
    assert isinstance(refused, UnreachableEdge)
    assert refused.kind == "shape"


unit = st.tuples(*[st.floats(-1, 1)] * 3).map(np.array).filter(lambda v: np.linalg.norm(v) > 0.2)


@given(unit, unit, st.floats(0, math.pi * 0.9), st.floats(0, 30))
def test_frames_are_right_handed_orthogonal_and_point_into_the_edge(
    along: FloatArray, a: FloatArray, turn: float, far: float
) -> None:
    t = along / np.linalg.norm(along)
    first = np.cross(t, a)
    if np.linalg.norm(first) < 0.05:
        return
    first /= np.linalg.norm(first)
    second = math.cos(turn) * first + math.sin(turn) * np.cross(t, first)
    mean = (first + second) / np.linalg.norm(first + second)
    edge = straight(3 * t, 50 * t, first, second)
    back = straight(50 * t, 3 * t, first, second)
    for rotation in check_path(make_poses(edge, far)).rotation:
        assert np.allclose(rotation.T @ rotation, np.eye(3))
        assert np.linalg.det(rotation) == pytest.approx(1)
        assert np.allclose(rotation[:, 2], -mean)
        assert abs(rotation[:, 1] @ t) == pytest.approx(1)
        assert rotation[2, 0] <= 1e-6
    # An edge in the other direction has the same poses in the opposite order.
    forwards, backwards = check_path(make_poses(edge, far)), check_path(make_poses(back, far))
    assert np.allclose(backwards.rotation, forwards.rotation[::-1])
    assert np.allclose(backwards.position, forwards.reversed().position)


def test_the_arcs_of_a_reversed_path_keep_their_via_points_half_way() -> None:
    path = check_path(make_poses(rim((0, 0, 0), 20, outer=True), 4))
    back = path.reversed()
    assert np.allclose(back.position, path.position[::-1])
    assert np.allclose(back.rotation, path.rotation[::-1])
    assert np.isnan(back.via[0]).all()
    for k in range(1, 5):
        near = np.linalg.norm(back.via[k] - back.position[k - 1])
        assert near == pytest.approx(np.linalg.norm(back.via[k] - back.position[k]))
        assert near == pytest.approx(2 * (20 + 4 * H) * math.sin(math.radians(22.5)))


@given(st.integers(1, 9), st.integers(1, 9))
def test_a_divided_rim_is_the_circle_and_its_frame_rotates_evenly(first: int, other: int) -> None:
    path = check_path(make_poses(rim((5, 6, 30), 20, outer=True), 4))
    parts = np.array([first, other, first, other])
    dense = divide(path, parts)
    angles = np.concatenate(
        [[0.0], *[np.pi / 2 * (k + np.arange(1, n + 1) / n) for k, n in enumerate(parts)]]
    )
    radius = 20 + 4 * H
    for angle, position, rotation in zip(angles, dense.position, dense.rotation, strict=True):
        assert np.allclose(
            position, [5 + radius * math.cos(angle), 6 + radius * math.sin(angle), 30 + 4 * H]
        )
        assert np.allclose(rotation, rotation_about(2, angle) @ path.rotation[0])
    assert dense.length.sum() == pytest.approx(math.tau * radius)
    assert np.array_equal(dense.position[compute_offsets(parts)], path.position)
    middles = (angles[1:] + angles[:-1]) / 2
    assert np.allclose(dense.via[1:, 0], 5 + radius * np.cos(middles))


def test_parts_keep_the_largest_length_and_the_largest_angle() -> None:
    line = check_path(make_poses(FRONT, 0))
    assert count_parts(line, 30, 1).tolist() == [4]
    assert count_parts(line, 25, 1).tolist() == [4]
    # Each quarter of the rim rotates the frame by 90 deg, so by 18 deg in each of five parts.
    circle = check_path(make_poses(rim((0, 0, 0), 20, outer=True), 4))
    assert count_parts(circle, 1e3, math.radians(20)).tolist() == [5] * 4
