"""Parts are located in simulated scans and compared with their true poses.

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


def measure_distances(mesh, points):
    """The distance of each point from the nearest triangle, mm.

    All triangles are tested, as the search of trimesh needs another package.
    """
    distance_mm = np.full(len(points), np.inf)
    for corners in mesh.triangles:
        repeated_corners = np.broadcast_to(corners, (len(points), 3, 3))
        offsets = trimesh.triangles.closest_point(repeated_corners, points) - points
        distance_mm = np.minimum(distance_mm, np.linalg.norm(offsets, axis=1))
    return distance_mm


def arrays_of(mesh):
    return np.array(mesh.vertices), np.array(mesh.faces)


def pose_of(location):
    return np.array(location.base_from_work.rotation), np.array(location.base_from_work.origin)


@pytest.mark.parametrize(
    ("name", "views", "table", "seed"),
    [
        ("rfa1", None, 0.0, 1),
        ("rfa2", None, 0.0, 2),
        ("rfa1", ROUND, 0.2, 3),
        ("rfa2", ASIDE, 0.2, 4),
    ],
)
def test_a_part_is_located_at_its_true_pose(name, views, table, seed):
    mesh = MESHES[name]
    truth = placed(np.random.default_rng(seed), 30, 50)
    points = scan(mesh, 20_000, seed, views, 0.1, table) @ truth[0].T + truth[1]
    location = localize("scan", arrays_of(mesh), points)
    origin, worst, angle = errors(pose_of(location), truth, mesh.vertices)
    assert origin < 0.02
    assert worst < 0.02
    assert angle < 0.01
    assert location.overlap > 0.99
    assert location.bench == pytest.approx(20_000 * table, rel=0.03)
    assert location.rms == pytest.approx(0.1, rel=0.03)
    assert location.used == pytest.approx(20_000 * (1 - table), rel=0.01)
    # rfa1 hides a part of its foot.
    assert location.seen.near > 0.75
    assert (location.seen.all > 0.97) == (views is None)
    assert location.weak == ""
    assert location.free == ""


def test_a_part_is_located_in_any_orientation_and_far_away():
    """It is upside down and far away, on a bench three times as large, next to other objects."""
    mesh = MESHES["rfa1"]
    rng = np.random.default_rng(7)
    truth = (
        placed(rng, 0, 0)[0] @ trimesh.transformations.rotation_matrix(3.0, [1, 0.2, 0.4])[:3, :3],
        np.array([1500.0, -800.0, 300.0]),
    )
    stray = rng.uniform([-200, -200, 0], [-120, 250, 60], (2000, 3))
    points = np.vstack([scan(mesh, 20_000, 7, ROUND, 0.05, 0.4), stray]) @ truth[0].T + truth[1]
    location = localize("scan", arrays_of(mesh), points)
    assert errors(pose_of(location), truth, mesh.vertices)[1] < 0.02
    assert location.rivals == ()
    assert location.next_best is not None


def test_a_scan_without_noise_is_located_exactly():
    mesh = MESHES["rfa2"]
    truth = placed(np.random.default_rng(9), 20, 50)
    location = localize(
        "scan", arrays_of(mesh), scan(mesh, 5000, 9, noise=0.0) @ truth[0].T + truth[1]
    )
    assert errors(pose_of(location), truth, mesh.vertices)[1] < 1e-4
    assert location.rms < 1e-4


def test_a_pose_is_repeated_bit_by_bit_and_moves_with_its_scan():
    mesh = MESHES["rfa1"]
    points = scan(mesh, 3000, 11)
    first, second = (pose_of(localize("scan", arrays_of(mesh), points)) for _ in range(2))
    assert np.array_equal(first[0], second[0])
    assert np.array_equal(first[1], second[1])
    turn, shift = placed(np.random.default_rng(12), 180, 500)
    moved = pose_of(localize("scan", arrays_of(mesh), points @ turn.T + shift))
    assert errors(moved, (turn @ first[0], turn @ first[1] + shift), mesh.vertices)[1] < 2e-3


# -- ambiguous poses


def test_a_cube_has_24_poses_and_the_one_with_the_smallest_rotation_is_taken():
    mesh = trimesh.creation.box((60, 60, 60))
    truth = placed(np.random.default_rng(1), 20, 50)
    points = scan(mesh, 6000, 1) @ truth[0].T + truth[1]
    location = localize("scan", arrays_of(mesh), points)
    assert errors(pose_of(location), truth, mesh.vertices)[1] < 0.05
    assert len(location.rivals) == 23
    turns = [round(rival.turn) for rival in location.rivals]
    assert turns == sorted([90] * 6 + [120] * 8 + [180] * 9)
    assert location.free == ""
    half_turn = trimesh.transformations.rotation_matrix(np.pi, [0, 0, 1])[:3, :3]
    start = Pose(frozen(truth[0] @ half_turn), tuple(truth[1].tolist()))
    with_start = localize("scan", arrays_of(mesh), points, start)
    assert errors(pose_of(with_start), (truth[0] @ half_turn, truth[1]), mesh.vertices)[1] < 0.05


def test_rfa2_turned_by_180_deg_is_a_rival():
    mesh = MESHES["rfa2"]
    location = localize("scan", arrays_of(mesh), scan(mesh, 6000, 2))
    (rival,) = location.rivals
    assert rival.turn == pytest.approx(180, abs=0.1)
    moved_vertices = np.array(mesh.vertices) @ rival.base_from_work.rotation.T + np.array(
        rival.base_from_work.origin
    )
    assert measure_distances(mesh, moved_vertices).max() < 0.05


def test_a_cylinder_is_free_to_turn_about_its_axis():
    mesh = trimesh.creation.cylinder(radius=30, height=80, sections=32)
    turn = trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0])[:3, :3]
    location = localize("scan", arrays_of(mesh), scan(mesh, 6000, 3) @ turn.T)
    assert location.free == "turning it about x"


def test_the_sides_of_a_plate_are_distinguished_by_its_rim():
    """The sides are 2 mm apart, which is closer than the steps of the search."""
    mesh = trimesh.creation.box((120, 80, 2))
    truth = placed(np.random.default_rng(1), 20, 50)
    points = scan(mesh, 10_000, 1, ASIDE, 0.05, 0.2) @ truth[0].T + truth[1]
    location = localize("scan", arrays_of(mesh), points)
    assert errors(pose_of(location), truth, mesh.vertices)[1] < 0.1
    assert [round(rival.turn) for rival in location.rivals] == [180, 180, 180]


def test_a_scan_from_above_holds_its_part_weakly_sideways():
    mesh = MESHES["rfa1"]
    location = localize("scan", arrays_of(mesh), scan(mesh, 20_000, 5, DOWN, 0.1, 0.2))
    assert location.weak.startswith("moving it along")
    # Height and tilt are determined, and the rim of the top face limits the rest.
    rotation, origin = pose_of(location)
    assert abs(origin[2]) < 0.02
    assert np.degrees(np.arccos(rotation[2, 2])) < 0.01
    assert np.abs(origin[:2]).max() < 0.2


def test_the_rim_of_a_face_holds_a_plate_sideways():
    """The scan has only points of the top face, without any wall."""
    mesh = trimesh.creation.box((120, 80, 40))
    rng = np.random.default_rng(0)
    points = np.column_stack(
        [rng.uniform(-60, 60, 20_000), rng.uniform(-40, 40, 20_000), np.full(20_000, 20.0)]
    )
    # The bottom fits as well: only the viewpoint decides for the top.
    points += rng.normal(0, 0.1, points.shape)
    location = localize("scan", arrays_of(mesh), points, viewpoint=np.array([0.0, 0.0, 800.0]))
    assert errors(pose_of(location), (np.eye(3), np.zeros(3)), mesh.vertices)[1] < 0.15
    assert location.weak.startswith("moving it along")


# -- refusals


@pytest.mark.parametrize(
    ("model", "scanned_mesh"),
    [(trimesh.creation.box((60, 60, 60)), MESHES["rfa1"]), (MESHES["rfa1"], MESHES["rfa2"])],
)
def test_another_part_is_refused(model, scanned_mesh):
    with pytest.raises(InputError, match="the model was not found in the scan"):
        localize("scan", arrays_of(model), scan(scanned_mesh, 4_000, 1, ROUND, 0.1, 0.2))


def test_a_pose_with_points_inside_the_part_is_rejected():
    """The top fits onto the larger bottom too, but then points of the slope are inside the part."""
    mesh = MESHES["rfa1"]
    top = scan(mesh, 100_000, 1, DOWN, 0.1)[:20_000]
    location = localize("scan", arrays_of(mesh), top)
    assert errors(pose_of(location), (np.eye(3), np.zeros(3)), mesh.vertices)[1] < 0.2


def test_a_cloud_of_random_points_is_refused():
    dust = np.random.default_rng(0).uniform(0, 150, (500, 3))
    with pytest.raises(InputError, match="was not found"):
        localize("dust", arrays_of(MESHES["rfa1"]), dust)


@pytest.mark.parametrize("factor", [1e-3, 1 / 25.4, 1000.0])
def test_a_scan_in_another_unit_is_refused(factor):
    points = scan(MESHES["rfa1"], 2000, 1) * factor
    remedy = "cut out the part, or give the units: --units, --model-units"
    with pytest.raises(InputError, match=f"cannot show this model .*; {remedy}"):
        localize("scan", arrays_of(MESHES["rfa1"]), points)


def test_points_at_a_single_position_are_refused():
    with pytest.raises(InputError, match="all its points are at one place"):
        localize("scan", arrays_of(MESHES["rfa1"]), np.full((500, 3), 7.0))


# -- functions of the search


def test_closest_points_are_those_of_trimesh():
    rng = np.random.default_rng(0)
    corners, points = rng.normal(size=(20_000, 3, 3)), 2 * rng.normal(size=(20_000, 3))
    expected = trimesh.triangles.closest_point(corners, points)
    assert np.abs(compute_closest(corners, points) - expected).max() < 1e-12


@pytest.mark.parametrize("subdivisions", [0, 3])
def test_the_closest_triangle_is_always_among_the_candidates(subdivisions):
    mesh = trimesh.creation.icosphere(subdivisions, 40)
    model = make_model(*arrays_of(mesh))
    rng = np.random.default_rng(1)
    points = rng.normal(size=(2000, 3))
    points *= (40 + rng.uniform(-8, 8, (2000, 1))) / np.linalg.norm(points, axis=1, keepdims=True)
    slack, radius = 0.3, 5.0
    pairs = find_candidates(model, points, radius, slack)
    moved = points + slack / np.sqrt(3) * rng.uniform(-1, 1, points.shape)
    touch = find_touched(model, pairs, moved)
    distance_mm = measure_distances(mesh, moved)
    assert set(np.flatnonzero(distance_mm < radius)) <= set(touch.point)
    assert np.abs(distance_mm[touch.point] - touch.distance).max() < 1e-9


def test_start_rotations_cover_all_orientations():
    """Each rotation is within 30 deg of one of the 600 rotations at which the search starts."""
    rotations = spread_rotations(600)
    assert np.abs(rotations @ rotations.transpose(0, 2, 1) - np.eye(3)).max() < 1e-12
    assert np.linalg.det(rotations) == pytest.approx(np.ones(600))
    rng = np.random.default_rng(2)
    for _ in range(300):
        turn = trimesh.transformations.random_rotation_matrix(rng.random(3))[:3, :3]
        cosine = (np.einsum("bij,ij->b", rotations, turn).max() - 1) / 2
        assert np.degrees(np.arccos(cosine)) < 30


def test_samples_are_spread_evenly_over_the_area():
    mesh = MESHES["rfa1"]
    model = make_model(*arrays_of(mesh), 5000)
    assert model.volume == pytest.approx(mesh.volume)
    assert model.area == pytest.approx(mesh.area)
    assert (WITHIN * model.size) == pytest.approx(0.005 * np.linalg.norm(mesh.extents))
    for axis, sign in ((0, 1), (1, -1), (2, 1)):
        facing = model.sample_normals[:, axis] * sign > 0.99
        fraction = mesh.area_faces[mesh.face_normals[:, axis] * sign > 0.99].sum() / mesh.area
        assert facing.mean() == pytest.approx(fraction, abs=0.002)
    samples = [model.samples[i] for i in range(3)]
    assert all(not np.array_equal(a, b) for a, b in pairwise(samples))
