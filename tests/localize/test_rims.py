"""A part is refused if it only fits into a larger one, as the scan continues beyond its rims.

The true poses of the scans are known. The modules tests/support/shells.py and
tests/support/clouds.py share no code with camgen.
"""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from camgen import cli
from camgen.localize import localize
from camgen.localize.fine import refine
from camgen.localize.model import make_model
from camgen.localize.rims import find_rims, measure_run_on
from camgen.model.errors import InputError, NoSafeProgram
from camgen.model.pose import IDENTITY, Pose
from tests.support import shells
from tests.support.clouds import ASIDE, DOWN, ROUND, placed, scan

PARTS = Path(__file__).parents[2] / "fixtures" / "parts"
BLOCK = trimesh.creation.box((120, 80, 40))
TRUE_START = Pose(IDENTITY, (1.0, -2.0, 0.5))
WRONG_START = Pose(IDENTITY, (60.0, 0.0, 0.0))


def arrays_of(mesh):
    return np.array(mesh.vertices), np.array(mesh.faces)


# -- rims


def test_each_edge_of_a_box_is_a_rim_of_two_faces():
    rims = find_rims(make_model(*arrays_of(BLOCK)))
    at_end = np.isclose(np.abs(rims.places), [60, 40, 20])
    assert (at_end.sum(axis=1) >= 2).all()
    # The outward direction of one face is the normal of the other.
    axes = np.abs(rims.out) + np.abs(rims.normals)
    assert np.allclose(axes, np.isclose(axes, 1))
    assert (np.sign(rims.places) * (rims.out + rims.normals) >= -1e-9).all()
    along_x = np.isclose(rims.out + rims.normals, 0).argmax(axis=1) == 0
    assert along_x.mean() == pytest.approx(120 / 240, abs=0.01)


def test_a_cylinder_has_rims_only_at_its_ends():
    mesh = trimesh.creation.cylinder(radius=30, height=80, sections=64)
    rims = find_rims(make_model(*arrays_of(mesh)))
    assert np.allclose(np.abs(rims.places[:, 2]), 40)


def test_an_inner_edge_is_not_a_rim():
    """The floor of a tray continues into its walls: no rim has material beyond it."""
    mesh = shells.tray()
    rims = find_rims(make_model(*arrays_of(mesh)))
    beyond = rims.places + 1e-3 * rims.out
    inside = [compute_winding(mesh.triangles, point) > 0.5 for point in beyond[::40]]
    assert not any(inside)


def compute_winding(corners, point):
    """The winding number of a surface about a point, by van Oosterom and Strackee (1983).

    It is 1 inside of the surface and 0 outside.
    """
    a, b, c = (corners - point).transpose(1, 0, 2)
    length_a, length_b, length_c = np.linalg.norm([a, b, c], axis=2)
    denominator = (
        length_a * length_b * length_c
        + (a * b).sum(axis=1) * length_c
        + (b * c).sum(axis=1) * length_a
        + (c * a).sum(axis=1) * length_b
    )
    return np.arctan2((a * np.cross(b, c)).sum(axis=1), denominator).sum() / (2 * np.pi)


def test_triangles_that_share_no_corners_have_no_rims():
    faces = np.arange(36).reshape(12, 3)
    corners = BLOCK.triangles + 0.5 * BLOCK.face_normals[:, None]
    assert len(find_rims(make_model(corners.reshape(-1, 3), faces)).places) == 0


# -- parts that are not in the scan


def scan_from(mesh, direction, count=6000):
    """A scan of the part from one viewpoint in a random pose, and the viewpoint."""
    turn, shift = placed(np.random.default_rng(2003), 30, 50)
    eye = mesh.bounds.mean(axis=0) + 600 * np.array(direction) / np.linalg.norm(direction)
    return shells.one_sided(mesh, count, 3, eye) @ turn.T + shift, turn @ eye + shift


@pytest.mark.parametrize("is_viewpoint_given", [False, True])
def test_a_part_that_fits_into_a_larger_one_is_refused(is_viewpoint_given):
    """Nine tenths of the near side of rfa1 fit on rfa2."""
    points, eye = scan_from(trimesh.load_mesh(PARTS / "rfa2.stl"), (0.25, -0.61, -0.75))
    with pytest.raises(InputError, match="not found in the scan"):
        localize(
            "scan",
            arrays_of(trimesh.load_mesh(PARTS / "rfa1.stl")),
            points,
            viewpoint=eye if is_viewpoint_given else None,
        )


# -- parts that are in the scan


def scan_flush_block(*sides):
    """A scan of a block, and of surfaces next to it at the height of its top face.

    sides: lower and upper corner of each surface in x and y, mm.
    """
    rng = np.random.default_rng(5)
    points = [scan(BLOCK, 8000, 5, ASIDE, 0.05)]
    for low, high in sides:
        positions = rng.uniform(low, high, (1500, 2))
        surface = np.column_stack([positions, np.full(1500, 20.0)])
        points.append(surface + rng.normal(0, 0.05, (1500, 3)))
    return np.vstack(points)


LEFT, FRONT, JAW = ((-100, -40), (-60, 40)), ((-60, -65), (60, -40)), ((-100, -15), (-60, 15))


def test_a_part_that_is_flush_with_a_jaw_needs_a_start():
    beyond = r"runs on beyond a rim at -60, -?\d.*, 20 of the model over 3\d mm"
    with pytest.raises(NoSafeProgram, match=beyond):
        localize("scan", arrays_of(BLOCK), scan_flush_block(JAW))
    location = localize("scan", arrays_of(BLOCK), scan_flush_block(JAW), TRUE_START)
    assert np.abs(location.base_from_work.origin).max() < 0.05
    assert location.run_on == pytest.approx(30 / 960, abs=0.01)


@pytest.mark.parametrize("start", [None, WRONG_START])
def test_a_part_that_is_flush_on_two_sides_may_be_a_larger_one(start):
    with pytest.raises(
        NoSafeProgram, match=r"the part or a larger one .*runs on beyond 2\d % of its rims.*--start"
    ):
        localize("scan", arrays_of(BLOCK), scan_flush_block(LEFT, FRONT), start)


def test_a_start_at_the_part_decides_that_it_is_not_a_larger_one(tmp_path, capsys, monkeypatch):
    locations = []

    def keep(*arguments):
        locations.append(localize(*arguments))
        return locations[-1]

    monkeypatch.setattr("camgen.cli.localize.localize", keep)
    BLOCK.export(tmp_path / "block.stl")
    np.savetxt(tmp_path / "scan.xyz", scan_flush_block(LEFT, FRONT), fmt="%.4f")
    words = [str(tmp_path / name) for name in ("block.stl", "scan.xyz", "frame.toml")]
    assert cli.main(["localize", *words[:2], "-o", words[2], "--start=1,-2,0.5,0,0,0"]) == 0
    assert "of the rims: it stands where --start says" in (tmp_path / "frame.toml").read_text()
    capsys.readouterr()
    (location,) = locations
    assert np.abs(location.base_from_work.origin).max() < 0.05
    assert location.run_on == pytest.approx(200 / 960, abs=0.02)


@pytest.mark.parametrize("views", [ASIDE, ROUND, DOWN])
def test_a_thin_sheet_on_a_bench_ends_at_its_rims(views):
    """The bench is 1.6 mm below the scanned face, in the plane of the hidden face."""
    mesh = shells.sheet()
    model = make_model(*arrays_of(mesh))
    points = scan(mesh, 10_000, 2, views, 0.1, 0.4)
    assert (
        measure_run_on(model, points, refine(model, points, (np.eye(3), np.zeros(3)), 0.5)) < 0.02
    )
