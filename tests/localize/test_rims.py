"""Parts that are not in the scan, but fit into a larger one that is: there the scan runs on beyond their rims.

Scans with known truth. The modules
tests/support/shells.py and tests/support/clouds.py share no code with camgen.
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
HERE = Pose(IDENTITY, (1.0, -2.0, 0.5))
ELSEWHERE = Pose(IDENTITY, (60.0, 0.0, 0.0))


def shape(mesh):
    return np.array(mesh.vertices), np.array(mesh.faces)


# -- rims


def test_of_a_box_every_edge_is_a_rim_of_two_faces():
    rims = find_rims(make_model(*shape(BLOCK)))
    at_end = np.isclose(np.abs(rims.places), [60, 40, 20])
    assert (at_end.sum(axis=1) >= 2).all()
    # Outward of the one face is the normal of the other.
    assert np.allclose(
        np.abs(rims.out) + np.abs(rims.normals),
        np.isclose(np.abs(rims.out) + np.abs(rims.normals), 1),
    )
    assert (np.sign(rims.places) * (rims.out + rims.normals) >= -1e-9).all()
    along_x = np.isclose(rims.out + rims.normals, 0).argmax(axis=1) == 0
    assert along_x.mean() == pytest.approx(120 / 240, abs=0.01)


def test_a_cylinder_has_rims_at_its_ends_alone():
    rims = find_rims(
        make_model(*shape(trimesh.creation.cylinder(radius=30, height=80, sections=64)))
    )
    assert np.allclose(np.abs(rims.places[:, 2]), 40)


def test_where_a_wall_rises_from_a_floor_is_no_rim():
    """The inner edges of a tray: the floor would run on into the wall."""
    mesh = shells.tray()
    rims = find_rims(make_model(*shape(mesh)))
    beyond = rims.places + 1e-3 * rims.out
    corners = mesh.triangles
    inside = [
        bool(trimesh.triangles.closest_point(corners, np.broadcast_to(p, (len(corners), 3))).size)
        and _winds_about(corners, p) > 0.5
        for p in beyond[::40]
    ]
    assert not any(inside)


def _winds_about(corners, place):
    """How often the surface goes around the place: 1 within it, 0 outside (van Oosterom and Strackee, 1983)."""
    a, b, c = (corners[:, k] - place for k in range(3))
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    below = (
        la * lb * lc
        + (a * b).sum(axis=1) * lc
        + (b * c).sum(axis=1) * la
        + (c * a).sum(axis=1) * lb
    )
    return np.arctan2((a * np.cross(b, c)).sum(axis=1), below).sum() / (2 * np.pi)


def test_triangles_that_share_no_corners_have_no_rims():
    faces = np.arange(36).reshape(12, 3)
    apart = BLOCK.triangles + 0.5 * BLOCK.face_normals[:, None]
    assert len(find_rims(make_model(apart.reshape(-1, 3), faces)).places) == 0


# -- parts that are not there


def seen(mesh, way, count=6000):
    """A scan of the part from one place, put somewhere, and where the scanner stood."""
    turn, shift = placed(np.random.default_rng(2003), 30, 50)
    eye = mesh.bounds.mean(axis=0) + 600 * np.array(way) / np.linalg.norm(way)
    return shells.one_sided(mesh, count, 3, eye) @ turn.T + shift, turn @ eye + shift


@pytest.mark.parametrize("told", [False, True])
def test_a_part_that_fits_into_a_larger_one_is_not_found_there(told):
    """rfa1 shows nine tenths of its near side on rfa2."""
    points, eye = seen(trimesh.load_mesh(PARTS / "rfa2.stl"), (0.25, -0.61, -0.75))
    with pytest.raises(InputError, match="not found in the scan"):
        localize(
            "scan",
            shape(trimesh.load_mesh(PARTS / "rfa1.stl")),
            points,
            viewpoint=eye if told else None,
        )


# -- parts that are there


def flush(*sides):
    """A block seen from above and aside, and beside it things as high as it is, on the sides away from the scanner."""
    rng = np.random.default_rng(5)
    points = [scan(BLOCK, 8000, 5, ASIDE, 0.05)]
    for low, high in sides:
        beside = rng.uniform(low, high, (1500, 2))
        points.append(
            np.column_stack([beside, np.full(1500, 20.0)]) + rng.normal(0, 0.05, (1500, 3))
        )
    return np.vstack(points)


LEFT, FRONT, JAW = ((-100, -40), (-60, 40)), ((-60, -65), (60, -40)), ((-100, -15), (-60, 15))


def test_a_part_that_is_flush_with_a_jaw_is_found_if_a_start_says_so():
    beyond = r"runs on beyond a rim at -60, -?\d.*, 20 of the model over 3\d mm"
    with pytest.raises(NoSafeProgram, match=beyond):
        localize("scan", shape(BLOCK), flush(JAW))
    found = localize("scan", shape(BLOCK), flush(JAW), HERE)
    assert np.abs(found.base_from_work.origin).max() < 0.05
    assert found.run_on == pytest.approx(30 / 960, abs=0.01)


@pytest.mark.parametrize("start", [None, ELSEWHERE])
def test_a_part_that_is_flush_on_two_sides_is_not_told_from_a_place_on_a_larger_one(start):
    with pytest.raises(
        NoSafeProgram, match=r"the part or a larger one .*runs on beyond 2\d % of its rims.*--start"
    ):
        localize("scan", shape(BLOCK), flush(LEFT, FRONT), start)


def test_a_start_says_that_it_is_the_part(tmp_path, capsys):
    found = localize("scan", shape(BLOCK), flush(LEFT, FRONT), HERE)
    assert np.abs(found.base_from_work.origin).max() < 0.05
    assert found.run_on == pytest.approx(200 / 960, abs=0.02)
    BLOCK.export(tmp_path / "block.stl")
    np.savetxt(tmp_path / "scan.xyz", flush(LEFT, FRONT), fmt="%.4f")
    words = [str(tmp_path / name) for name in ("block.stl", "scan.xyz", "frame.toml")]
    assert cli.main(["localize", *words[:2], "-o", words[2], "--start=1,-2,0.5,0,0,0"]) == 0
    assert "of the rims: it stands where --start says" in (tmp_path / "frame.toml").read_text()
    capsys.readouterr()


@pytest.mark.parametrize("views", [ASIDE, ROUND, DOWN])
def test_a_thin_sheet_on_a_bench_ends_at_its_rims(views):
    """The bench is 1.6 mm below the face that was seen, in the plane of the one that was not."""
    mesh = shells.sheet()
    model = make_model(*shape(mesh))
    points = scan(mesh, 10_000, 2, views, 0.1, 0.4)
    assert (
        measure_run_on(model, points, refine(model, points, (np.eye(3), np.zeros(3)), 0.5)) < 0.02
    )
