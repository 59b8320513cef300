"""Which side of a sheet was scanned, what a hollow part hides of itself, and what nothing settles.

Scans from one place with known truth (tests/support/shells.py shares no code with camgen).
"""

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
import trimesh

from camgen import cli
from camgen.localize import localize, sight
from camgen.localize.model import make_model
from camgen.model.errors import InputError, NoSafeProgram
from camgen.model.pose import IDENTITY, Pose
from tests.support import shells
from tests.support.clouds import errors, placed

pytestmark = pytest.mark.usefixtures("localize_once")
PARTS = Path(__file__).parents[2] / "fixtures" / "parts"
THICK = 1.6


def shape(mesh):
    return np.array(mesh.vertices), np.array(mesh.faces)


def pose_of(found):
    return np.array(found.base_from_work.rotation), np.array(found.base_from_work.origin)


def worst(mesh, found, truth=None):
    return errors(pose_of(found), truth or (np.eye(3), np.zeros(3)), mesh.vertices)[1]


# -- sight


def test_of_a_ball_the_half_is_hidden_that_faces_away():
    ball = trimesh.creation.icosphere(3, 40)
    model = make_model(*shape(ball))
    eye = np.array([100.0, 200.0, -150.0])
    facing = ((eye - model.samples) * model.sample_normals).sum(axis=1) > 0
    assert np.array_equal(sight.find_hidden(model, model.samples, eye, 1e-3), ~facing)


def test_a_wall_hides_the_floor_behind_it_and_only_from_the_side():
    model = make_model(*shape(shells.tray()))
    places = np.array([[10.0, 60.0, 3.0], [60.0, 60.0, 3.0], [60.0, 75.0, 20.0]])
    hidden = [
        sight.find_hidden(model, places, np.array(eye), 0.01).tolist()
        for eye in ((55, 37, 900), (55, 900, 20.0))
    ]
    assert hidden == [[False, False, True], [True, True, False]]


def test_the_place_of_the_scanner_is_estimated_from_what_was_seen():
    model = make_model(*shape(shells.housing()))
    places, normals = model.samples[::25], model.sample_normals[::25]
    way = np.array([0.5, -0.4, 0.77]) / np.linalg.norm([0.5, -0.4, 0.77])
    hit = sight.find_seen(model, places, normals, sight.make_far_eyes(model, way[None]), 0.15)[0]
    estimate = sight.estimate_eye(model, sight.SeenPlaces(places, normals, hit), 0.15)
    found = estimate.eye - (model.low + model.high) / 2
    assert estimate.share > 0.9
    assert np.degrees(np.arccos(found @ way / np.linalg.norm(found))) < 15


# -- which side


def test_a_bent_sheet_is_not_taken_for_its_other_side():
    """Both legs lie on the points when the sheet is moved by its thickness along both; only the rims tell."""
    mesh = shells.angle()
    eye = mesh.bounds.mean(axis=0) + np.array([-450.0, -300.0, 260.0])
    truth = placed(np.random.default_rng(2001), 30, 50)
    points = shells.one_sided(mesh, 6000, 1, eye) @ truth[0].T + truth[1]
    assert worst(mesh, localize("scan", shape(mesh), points), truth) < 0.05
    assert (
        worst(
            mesh, localize("scan", shape(mesh), points, viewpoint=truth[0] @ eye + truth[1]), truth
        )
        < 0.05
    )


def face(noise=0.02):
    """Points of the upper face of a sheet alone, without its rim, and the sheet."""
    mesh = trimesh.creation.box((120, 80, THICK))
    rng = np.random.default_rng(0)
    points = np.column_stack(
        [rng.uniform(-60, 60, 5000), rng.uniform(-40, 40, 5000), np.full(5000, THICK / 2)]
    )
    return mesh, points + rng.normal(0, noise, points.shape)


@pytest.mark.parametrize("middle", [0.0, THICK])
def test_a_start_near_one_of_the_two_decides(middle):
    mesh, points = face()
    found = localize("scan", shape(mesh), points, Pose(IDENTITY, (10.0, -5.0, middle + 0.2)))
    assert found.base_from_work.origin[2] == pytest.approx(middle, abs=0.02)


def test_a_start_between_the_two_decides_nothing():
    mesh, points = face()
    with pytest.raises(NoSafeProgram, match="more exactly where the part stands with --start"):
        localize("scan", shape(mesh), points, Pose(IDENTITY, (0.0, 0.0, THICK / 2)))


def test_a_sheet_thinner_than_the_noise_is_found_without_more():
    mesh = trimesh.creation.box((120, 80, 0.25))
    points = face(0.1)[1] - np.array([0, 0, THICK / 2 - 0.125])
    found = localize("scan", shape(mesh), points)
    assert abs(found.base_from_work.origin[2]) < 0.3


def test_a_motion_that_nothing_holds_is_refused_unless_a_start_is_given():
    """The four sides of a bar without its ends: it may stand anywhere along itself."""
    bar = trimesh.creation.box((200, 40, 30))
    points, _ = trimesh.sample.sample_surface(bar, 12_000, seed=1)
    points = points[np.abs(points[:, 0]) < 75]
    points += np.random.default_rng(1).normal(0, 0.03, points.shape)
    with pytest.raises(NoSafeProgram, match="moving it along x changes nothing"):
        localize("scan", shape(bar), points)
    found = localize("scan", shape(bar), points, Pose(IDENTITY, (0.0, 0.0, 0.0)))
    assert found.free == "moving it along x"


# -- what it hides


@pytest.mark.parametrize("told", [False, True])
def test_what_a_hollow_part_hides_of_itself_is_not_asked_for(told):
    mesh = shells.housing()
    eye = mesh.bounds.mean(axis=0) + np.array([300.0, 330.0, 400.0])
    points = shells.one_sided(mesh, 6000, 1, eye)
    found = localize("scan", shape(mesh), points, viewpoint=eye if told else None)
    assert worst(mesh, found) < 0.05
    assert found.seen.near > 0.9
    assert found.seen.all < 0.5


def test_a_viewpoint_from_which_nothing_was_seen_is_refused():
    mesh = trimesh.load_mesh(PARTS / "rfa1.stl")
    eye = mesh.bounds.mean(axis=0) + np.array([300.0, 330.0, 400.0])
    with pytest.raises(
        InputError, match=r"% of the points on it from the scanner\); check --viewpoint"
    ):
        localize("scan", shape(mesh), shells.one_sided(mesh, 6000, 1, eye), viewpoint=-eye)


# -- from the command line


def pcd(points, viewpoint):
    head = f"VERSION 0.7\nFIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {len(points)}\nHEIGHT 1\n"
    head += f"VIEWPOINT {viewpoint}\nPOINTS {len(points)}\nDATA binary\n"
    return head.encode() + points.astype("<f8").tobytes()


@pytest.fixture
def files(tmp_path):
    mesh, points = face()
    mesh.export(tmp_path / "sheet.stl")

    def run(viewpoint, *words):
        (tmp_path / "scan.pcd").write_bytes(pcd(points / 1000, viewpoint))
        paths = [str(tmp_path / name) for name in ("sheet.stl", "scan.pcd", "frame.toml")]
        return cli.main(["localize", *paths[:2], "-o", paths[2], "--units", "m", *words])

    run.target = tmp_path / "frame.toml"
    return run


def height(text):
    """Of the sheet's middle, mm."""
    return tomllib.loads(text)["cell"]["base_from_work"][2]


def test_the_place_of_the_scanner_in_a_pcd_says_which_face_it_is(files):
    assert files("0.05 0.02 0.5 1 0 0 0") == 0
    text = files.target.read_text()
    assert "# viewpoint: 50, 20, 500 mm, as the scan says" in text
    assert height(text) == pytest.approx(0.0, abs=0.02)


def test_one_face_of_a_sheet_does_not_say_which_it_is_and_nothing_is_written(files, capsys):
    undecided = r"does not settle where the part stands .*up to 1\.6.* mm.*--viewpoint"
    assert files("0 0 0 1 0 0 0") == 3
    assert re.search(undecided, capsys.readouterr().err)
    assert files("0 0 0.5 1 0 0 0", "--viewpoint", "unknown") == 3
    assert re.search(undecided, capsys.readouterr().err)
    assert not files.target.exists()


def test_the_option_wins_over_the_file(files):
    assert files("0 0 0.5 1 0 0 0", "--viewpoint=50,20,-500") == 0
    text = files.target.read_text()
    assert "# viewpoint: 50, 20, -500 mm\n" in text
    assert height(text) == pytest.approx(THICK, abs=0.02)


@pytest.mark.parametrize(
    ("viewpoint", "words", "says"),
    [
        ("0 0 x 1 0 0 0", (), "its VIEWPOINT is not seven numbers"),
        ("0 0 1", (), "its VIEWPOINT is not seven numbers"),
        (
            "0 0 1 1 0 0 0",
            ("--viewpoint", "1,2"),
            "--viewpoint: '1,2' is not a position; give x,y,z in mm",
        ),
        ("0 0 1 1 0 0 0", ("--viewpoint", "1,2,inf"), "--viewpoint: '1,2,inf' is not a position"),
    ],
)
def test_a_viewpoint_that_cannot_be_is_refused_in_one_line(viewpoint, words, says, files, capsys):
    assert files(viewpoint, *words) == 2
    said = capsys.readouterr().err
    assert says in said
    assert said.count("\n") == 1
