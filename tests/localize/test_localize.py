"""Parts found in simulated scans, judged by the pose they were put at.

The scans are made by tests/support/clouds.py, which shares no code with camgen.
"""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import trimesh

from camgen.localize import localize
from camgen.localize.coarse import spread_rotations
from camgen.localize.model import compute_closest, find_candidates, find_touched, make_model
from camgen.localize.search import WITHIN
from camgen.model.errors import InputError
from camgen.model.pose import Pose, frozen
from tests.support.clouds import ASIDE, DOWN, ROUND, errors, placed, scan

PARTS = Path(__file__).parents[2] / "fixtures" / "parts"
MESHES = {name: trimesh.load_mesh(PARTS / f"{name}.stl") for name in ("rfa1", "rfa2")}


def distances(mesh, points):
    """Of each point from the nearest triangle, each asked about (trimesh's own search needs another package)."""
    least = np.full(len(points), np.inf)
    for corners in mesh.triangles:
        every = np.broadcast_to(corners, (len(points), 3, 3))
        least = np.minimum(
            least, np.linalg.norm(trimesh.triangles.closest_point(every, points) - points, axis=1)
        )
    return least


def shape(mesh):
    return np.array(mesh.vertices), np.array(mesh.faces)


def pose_of(found):
    return np.array(found.base_from_work.rotation), np.array(found.base_from_work.origin)


@pytest.mark.parametrize(
    ("name", "views", "table", "seed"),
    [
        ("rfa1", None, 0.0, 1),
        ("rfa2", None, 0.0, 2),
        ("rfa1", ROUND, 0.2, 3),
        ("rfa2", ASIDE, 0.2, 4),
    ],
)
def test_a_part_is_found_where_it_was_put(name, views, table, seed):
    mesh = MESHES[name]
    truth = placed(np.random.default_rng(seed), 30, 50)
    points = scan(mesh, 20_000, seed, views, 0.1, table) @ truth[0].T + truth[1]
    found = localize("scan", shape(mesh), points)
    origin, worst, angle = errors(pose_of(found), truth, mesh.vertices)
    assert origin < 0.02
    assert worst < 0.02
    assert angle < 0.01
    assert found.overlap > 0.99
    assert found.bench == pytest.approx(20_000 * table, rel=0.03)
    assert found.rms == pytest.approx(0.1, rel=0.03)
    assert found.used == pytest.approx(20_000 * (1 - table), rel=0.01)
    assert found.seen.near > 0.75  # rfa1 hides a part of its foot
    assert (found.seen.all > 0.97) == (views is None)
    assert found.weak == ""
    assert found.free == ""


def test_any_orientation_and_any_place_will_do():
    """Upside down, far away, beside other things on a bench that is three times as large as the part."""
    mesh = MESHES["rfa1"]
    rng = np.random.default_rng(7)
    truth = (
        placed(rng, 0, 0)[0] @ trimesh.transformations.rotation_matrix(3.0, [1, 0.2, 0.4])[:3, :3],
        np.array([1500.0, -800.0, 300.0]),
    )
    stray = rng.uniform([-200, -200, 0], [-120, 250, 60], (2000, 3))
    points = np.vstack([scan(mesh, 20_000, 7, ROUND, 0.05, 0.4), stray]) @ truth[0].T + truth[1]
    found = localize("scan", shape(mesh), points)
    assert errors(pose_of(found), truth, mesh.vertices)[1] < 0.02
    assert found.rivals == ()
    assert found.next_best is not None


def test_a_scan_without_noise_is_met_exactly():
    mesh = MESHES["rfa2"]
    truth = placed(np.random.default_rng(9), 20, 50)
    found = localize("scan", shape(mesh), scan(mesh, 5000, 9, noise=0.0) @ truth[0].T + truth[1])
    assert errors(pose_of(found), truth, mesh.vertices)[1] < 1e-4
    assert found.rms < 1e-4


def test_the_same_scan_gives_the_same_bits_and_the_order_of_frames_does_not_matter():
    mesh = MESHES["rfa1"]
    points = scan(mesh, 3000, 11)
    first, second = (pose_of(localize("scan", shape(mesh), points)) for _ in range(2))
    assert np.array_equal(first[0], second[0])
    assert np.array_equal(first[1], second[1])
    turn, shift = placed(np.random.default_rng(12), 180, 500)
    moved = pose_of(localize("scan", shape(mesh), points @ turn.T + shift))
    assert errors(moved, (turn @ first[0], turn @ first[1] + shift), mesh.vertices)[1] < 2e-3


# -- doubt


def test_a_cube_has_24_poses_and_the_one_turned_least_is_taken():
    mesh = trimesh.creation.box((60, 60, 60))
    truth = placed(np.random.default_rng(1), 20, 50)
    points = scan(mesh, 6000, 1) @ truth[0].T + truth[1]
    found = localize("scan", shape(mesh), points)
    assert errors(pose_of(found), truth, mesh.vertices)[1] < 0.05
    assert len(found.rivals) == 23
    turns = [round(rival.turn) for rival in found.rivals]
    assert turns == sorted([90] * 6 + [120] * 8 + [180] * 9)
    assert found.free == ""
    half = trimesh.transformations.rotation_matrix(np.pi, [0, 0, 1])[:3, :3]
    start = Pose(frozen(truth[0] @ half), tuple(truth[1].tolist()))
    told = localize("scan", shape(mesh), points, start)
    assert errors(pose_of(told), (truth[0] @ half, truth[1]), mesh.vertices)[1] < 0.05


def test_half_a_turn_of_rfa2_fits_as_well():
    mesh = MESHES["rfa2"]
    found = localize("scan", shape(mesh), scan(mesh, 6000, 2))
    (other,) = found.rivals
    assert other.turn == pytest.approx(180, abs=0.1)
    back = np.array(mesh.vertices) @ other.base_from_work.rotation.T + np.array(
        other.base_from_work.origin
    )
    away = distances(mesh, back)
    assert away.max() < 0.05


def test_a_cylinder_may_turn_about_its_axis():
    mesh = trimesh.creation.cylinder(radius=30, height=80, sections=32)
    turn = trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0])[:3, :3]
    found = localize("scan", shape(mesh), scan(mesh, 6000, 3) @ turn.T)
    assert found.free == "turning it about x"


def test_both_sides_of_a_plate_are_told_apart_by_its_rim():
    """The sides are 2 mm apart, nearer than the search looks."""
    mesh = trimesh.creation.box((120, 80, 2))
    truth = placed(np.random.default_rng(1), 20, 50)
    points = scan(mesh, 10_000, 1, ASIDE, 0.05, 0.2) @ truth[0].T + truth[1]
    found = localize("scan", shape(mesh), points)
    assert errors(pose_of(found), truth, mesh.vertices)[1] < 0.1
    assert [round(rival.turn) for rival in found.rivals] == [180, 180, 180]


def test_what_a_look_straight_down_does_not_hold_is_said():
    mesh = MESHES["rfa1"]
    found = localize("scan", shape(mesh), scan(mesh, 20_000, 5, DOWN, 0.1, 0.2))
    assert found.weak.startswith("moving it along")
    # Height and tilt are held all the same, and the rim of the top says where it ends.
    rotation, origin = pose_of(found)
    assert abs(origin[2]) < 0.02
    assert np.degrees(np.arccos(rotation[2, 2])) < 0.01
    assert np.abs(origin[:2]).max() < 0.2


def test_the_rim_of_one_face_holds_it_sideways():
    """Points of the top of a plate alone: there is no wall whose plane could say where it stands."""
    mesh = trimesh.creation.box((120, 80, 40))
    rng = np.random.default_rng(0)
    points = np.column_stack(
        [rng.uniform(-60, 60, 20_000), rng.uniform(-40, 40, 20_000), np.full(20_000, 20.0)]
    )
    # The bottom fits as well: that it is the top only the place of the scanner says.
    points += rng.normal(0, 0.1, points.shape)
    found = localize("scan", shape(mesh), points, viewpoint=np.array([0.0, 0.0, 800.0]))
    assert errors(pose_of(found), (np.eye(3), np.zeros(3)), mesh.vertices)[1] < 0.15
    assert found.weak.startswith("moving it along")


# -- refusals


@pytest.mark.parametrize(
    ("wrong", "there"),
    [(trimesh.creation.box((60, 60, 60)), MESHES["rfa1"]), (MESHES["rfa1"], MESHES["rfa2"])],
)
def test_another_part_is_not_found(wrong, there):
    with pytest.raises(InputError, match="the model was not found in the scan"):
        localize("scan", shape(wrong), scan(there, 4_000, 1, ROUND, 0.1, 0.2))


def test_a_pose_that_leaves_points_inside_the_part_is_none():
    """The top alone fits onto the larger bottom as well; the slope beside it would then run through the part."""
    mesh = MESHES["rfa1"]
    top = scan(mesh, 100_000, 1, DOWN, 0.1)[:20_000]
    found = localize("scan", shape(mesh), top)
    assert errors(pose_of(found), (np.eye(3), np.zeros(3)), mesh.vertices)[1] < 0.2


def test_a_room_of_dust_holds_no_part():
    dust = np.random.default_rng(0).uniform(0, 150, (500, 3))
    with pytest.raises(InputError, match="was not found"):
        localize("dust", shape(MESHES["rfa1"]), dust)


@pytest.mark.parametrize("factor", [1e-3, 1 / 25.4, 1000.0])
def test_a_scan_in_another_unit_is_refused(factor):
    points = scan(MESHES["rfa1"], 2000, 1) * factor
    remedy = "cut out the part, or give the units: --units, --model-units"
    with pytest.raises(InputError, match=f"cannot show this model .*; {remedy}"):
        localize("scan", shape(MESHES["rfa1"]), points)


def test_points_at_one_place_are_no_scan():
    with pytest.raises(InputError, match="all its points are at one place"):
        localize("scan", shape(MESHES["rfa1"]), np.full((500, 3), 7.0))


# -- pieces


def test_closest_points_are_trimeshs():
    rng = np.random.default_rng(0)
    corners, points = rng.normal(size=(20_000, 3, 3)), 2 * rng.normal(size=(20_000, 3))
    assert (
        np.abs(
            compute_closest(corners, points) - trimesh.triangles.closest_point(corners, points)
        ).max()
        < 1e-12
    )


@pytest.mark.parametrize("subdivisions", [0, 3])
def test_the_closest_triangle_is_always_among_the_candidates(subdivisions):
    mesh = trimesh.creation.icosphere(subdivisions, 40)
    model = make_model(*shape(mesh))
    rng = np.random.default_rng(1)
    points = rng.normal(size=(2000, 3))
    points *= (40 + rng.uniform(-8, 8, (2000, 1))) / np.linalg.norm(points, axis=1, keepdims=True)
    slack, reach = 0.3, 5.0
    pairs = find_candidates(model, points, reach, slack)
    moved = points + slack / np.sqrt(3) * rng.uniform(-1, 1, points.shape)
    touch = find_touched(model, pairs, moved)
    away = distances(mesh, moved)
    assert set(np.flatnonzero(away < reach)) <= set(touch.point)
    assert np.abs(away[touch.point] - touch.distance).max() < 1e-9


def test_orientations_leave_no_gap():
    """Every rotation is within 30 deg of one of the 600 that the search starts from."""
    known = spread_rotations(600)
    assert np.abs(known @ known.transpose(0, 2, 1) - np.eye(3)).max() < 1e-12
    assert np.linalg.det(known) == pytest.approx(np.ones(600))
    some = trimesh.transformations
    rng = np.random.default_rng(2)
    for _ in range(300):
        turn = some.random_rotation_matrix(rng.random(3))[:3, :3]
        cosine = (np.einsum("bij,ij->b", known, turn).max() - 1) / 2
        assert np.degrees(np.arccos(cosine)) < 30


def test_samples_spread_by_area():
    mesh = MESHES["rfa1"]
    model = make_model(*shape(mesh), 5000)
    assert model.volume == pytest.approx(mesh.volume)
    assert model.area == pytest.approx(mesh.area)
    assert (WITHIN * model.size) == pytest.approx(0.005 * np.linalg.norm(mesh.extents))
    for axis, sign in ((0, 1), (1, -1), (2, 1)):
        facing = model.sample_normals[:, axis] * sign > 0.99
        share = mesh.area_faces[mesh.face_normals[:, axis] * sign > 0.99].sum() / mesh.area
        assert facing.mean() == pytest.approx(share, abs=0.002)
    low = [model.samples[i] for i in range(3)]
    assert all(not np.array_equal(a, b) for a, b in pairwise(low))
