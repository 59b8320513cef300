"""Scans with a bench, stray points and other parts, and scans of parts that resemble the model.

The scenes of tests/support/scenes.py share no code with camgen. Their true poses are known.
"""

import re
from pathlib import Path

import numpy as np
import pytest
from shapely.geometry import Point, box

from camgen import cli
from camgen.localize import localize
from camgen.localize.clutter import find_benches, find_isolated, measure_noise
from camgen.localize.model import make_model
from camgen.model.errors import NoSafeProgram
from tests.support import scenes

CASES = Path(__file__).parents[2].parent / "shared" / "data" / "cases"
needs_cases = pytest.mark.skipif(
    not CASES.is_dir(), reason="the shared data is not beside the repository"
)
ANOTHER = "does not show the shape of the model|the part or a larger one"
EYE = np.array([250.0, -350.0, 500.0])


def plate(length=100.0, hole=(30.0, 30.0), diameter=10.0, thickness=3.0):
    """A plate of 60 mm width with one corner cut and a hole of 12 mm diameter.

    hole, diameter: the middle and the diameter of a second hole, mm.
    """
    outline = box(0, 0, length, 60) - box(length - 15, 45, length, 60) - Point(75, 20).buffer(6, 24)
    return scenes.stack([outline - Point(*hole).buffer(diameter / 2, 24)], [0, thickness])


def cast_scan(mesh, seed=0, step=0.7, margin=25.0, strays=0.0):
    """A scan of the mesh on a bench at z = 0 from a viewpoint above, with stray points.

    strays: share of stray points in the scan, 0 to 1.
    """
    rng = np.random.default_rng(seed)
    middle = np.append(mesh.bounds.mean(axis=0)[:2], 0)
    part, bench, _ = scenes.cast(mesh.triangles - middle, EYE, step, 0.05, rng)
    half = np.ptp(mesh.bounds, axis=0)[:2] / 2 + margin
    bench = bench[(np.abs(bench[:, :2]) < half).all(axis=1)]
    points = np.vstack([part, bench])
    low, high = points.min(axis=0) - 30, points.max(axis=0) + 30
    count = round(strays / (1 - strays) * len(points))
    return np.vstack([points, rng.uniform(low, high, (count, 3))]) + middle


def arrays_of(mesh):
    return np.array(mesh.vertices), np.array(mesh.faces)


def largest_error(mesh, pose, turn=None, place=(0.0, 0.0, 0.0)):
    """The largest distance of a vertex of the mesh from its true position, mm."""
    truth = mesh.vertices @ (np.eye(3) if turn is None else turn).T + np.array(place)
    located = mesh.vertices @ np.array(pose.rotation).T + np.array(pose.origin)
    return np.linalg.norm(located - truth, axis=1).max()


# -- bench and stray points


@pytest.mark.parametrize("is_viewpoint_given", [False, True])
def test_a_thin_plate_on_a_bench_is_located_without_an_error_of_its_thickness(is_viewpoint_given):
    mesh = plate()
    eye = EYE + np.append(mesh.bounds.mean(axis=0)[:2], 0)
    location = localize(
        "scan", arrays_of(mesh), cast_scan(mesh), viewpoint=eye if is_viewpoint_given else None
    )
    assert largest_error(mesh, location.base_from_work) < 0.1
    assert location.bench > 1000


def test_stray_points_do_not_hide_a_part():
    mesh = plate()
    scan = cast_scan(mesh, strays=0.2)
    location = localize("scan", arrays_of(mesh), scan)
    assert largest_error(mesh, location.base_from_work) < 0.1
    # A fifth of the points are strays, of which a few are close to others by chance.
    assert location.isolated == pytest.approx(0.2 * len(scan), rel=0.15)


def test_a_bench_far_larger_than_the_part_is_left_out():
    mesh = plate(thickness=20.0)
    location = localize("scan", arrays_of(mesh), cast_scan(mesh, step=1.2, margin=120.0))
    assert largest_error(mesh, location.base_from_work) < 0.1


def test_the_bench_is_the_plane_with_the_scene_on_one_side():
    mesh = plate(thickness=20.0)
    scan = cast_scan(mesh, margin=60.0)
    bench = find_benches(make_model(*arrays_of(mesh)), scan)[0]
    assert bench.normal @ [0, 0, 1] == pytest.approx(1, abs=1e-4)
    assert bench.height == pytest.approx(0, abs=0.02)
    assert bench.certain  # 220 x 180 mm of bench, 100 x 60 mm of plate
    assert bench.carries(mesh.vertices, 0.1)
    assert not bench.carries(mesh.vertices - [0, 0, 5], 0.1)


def test_the_noise_is_that_of_the_planes():
    rng = np.random.default_rng(1)
    plane = np.column_stack([rng.uniform(0, 100, (20_000, 2)), rng.normal(0, 0.08, 20_000)])
    assert measure_noise(plane) == pytest.approx(0.08, rel=0.1)


def test_a_sparse_surface_is_not_stray():
    """The bench has one point in 36 mm2, the part on it has four in 1 mm2."""
    rng = np.random.default_rng(2)
    part = np.column_stack([rng.uniform(0, 50, (10_000, 2)), rng.normal(20, 0.02, 10_000)])
    bench = np.column_stack([rng.uniform(-100, 200, (2_500, 2)), rng.normal(0, 0.02, 2_500)])
    strays = rng.uniform([-100, -100, 30], [200, 200, 200], (200, 3))
    is_isolated = find_isolated(np.vstack([part, bench, strays]))
    assert is_isolated[:10_000].mean() < 0.001
    assert is_isolated[10_000:12_500].mean() < 0.01
    assert is_isolated[12_500:].mean() > 0.95


# -- another part, and the part twice


@pytest.mark.parametrize(
    ("other", "place"),
    [
        ({"hole": (36.0, 30.0)}, (30, 30)),
        ({"diameter": 16.0}, (30, 30)),
        ({"length": 106.0}, (100, 22)),
        ({"length": 94.0}, (97, 22)),
    ],
)
def test_a_part_that_resembles_the_model_is_refused_with_the_position(other, place):
    with pytest.raises(NoSafeProgram, match=ANOTHER) as error:
        localize("scan", arrays_of(plate()), cast_scan(plate(**other), step=0.6))
    places = re.findall(r"at (-?[\d.]+), (-?[\d.]+), (?:-?[\d.]+) of the model", error.value.where)
    assert min(np.hypot(float(x) - place[0], float(y) - place[1]) for x, y in places) < 15


def test_the_mirror_image_of_a_plate_with_a_counterbore_is_refused():
    outline = box(0, 0, 100, 60) - box(85, 45, 100, 60) - Point(30, 30).buffer(5, 24)
    mesh = scenes.stack([outline, outline - Point(70, 20).buffer(8, 24)], [0, 2, 4])
    mirrored = scenes.stack([outline - Point(70, 20).buffer(8, 24), outline], [0, 2, 4])
    with pytest.raises(NoSafeProgram, match=ANOTHER):
        localize("scan", arrays_of(mesh), cast_scan(mirrored))


def test_a_second_part_in_the_scan_is_named():
    mesh = plate(thickness=12.0)
    first, second = cast_scan(mesh, 1, margin=0.0), cast_scan(mesh, 2, margin=0.0)
    location = localize(
        "scan", arrays_of(mesh), np.vstack([first, second + np.array([200, 30, 0])])
    )
    places = [location.base_from_work, *location.again]
    assert len(places) == 2
    places.sort(key=lambda pose: pose.origin[0])
    assert largest_error(mesh, places[0]) < 0.1
    assert largest_error(mesh, places[1], place=(200, 30, 0)) < 0.1


# -- shared cases

TILTED = (220.0, -75.0, 40.0, 12.0, -18.0, 140.0)
ON_BENCH = (120.0, 60.0, 0.0, 0.0, 0.0, 35.0)


@needs_cases
@pytest.mark.parametrize(
    ("model", "scan", "truth"),
    [
        ("plate.stl", "pl_up.ply", (350.0, 100.0, 60.0, 0.0, 0.0, 40.0)),
        ("loc_part.stl", "loc_stray3.ply", TILTED),
        ("loc_part.stl", "loc_bench.ply", ON_BENCH),
        ("loc_part.stl", "loc_bench_flying0.005.ply", ON_BENCH),
    ],
)
def test_a_case_is_located_at_its_true_pose(model, scan, truth, tmp_path, capsys):
    target = tmp_path / "frame.toml"
    assert cli.main(["localize", str(CASES / model), str(CASES / scan), "-o", str(target)]) == 0
    values = capsys.readouterr().out.split("[")[1].split("]")[0].split(",")
    assert np.allclose([float(value) for value in values], truth, atol=0.02)


@needs_cases
def test_the_second_of_two_equal_parts_is_named(tmp_path, capsys):
    names = [str(CASES / "loc_part.stl"), str(CASES / "loc_two.xyz")]
    assert cli.main(["localize", *names, "-o", str(tmp_path / "frame.toml")]) == 0
    assert "the scan shows the part once more: base_from_work = [" in capsys.readouterr().err
