"""The scanned side of a sheet, the hidden faces of a hollow part, and undecided poses.

The true poses of the scans are known (tests/support/shells.py shares no code with camgen).
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
THICKNESS = 1.6


def arrays_of(mesh):
    return np.array(mesh.vertices), np.array(mesh.faces)


def pose_of(location):
    return np.array(location.base_from_work.rotation), np.array(location.base_from_work.origin)


def worst_error(mesh, location, truth=None):
    return errors(pose_of(location), truth or (np.eye(3), np.zeros(3)), mesh.vertices)[1]


# -- sight


def test_the_half_of_a_ball_that_faces_away_is_hidden():
    ball = trimesh.creation.icosphere(3, 40)
    model = make_model(*arrays_of(ball))
    eye = np.array([100.0, 200.0, -150.0])
    facing = ((eye - model.samples) * model.sample_normals).sum(axis=1) > 0
    assert np.array_equal(sight.find_hidden(model, model.samples, eye, 1e-3), ~facing)


def test_a_wall_hides_the_floor_only_from_the_side():
    model = make_model(*arrays_of(shells.tray()))
    places = np.array([[10.0, 60.0, 3.0], [60.0, 60.0, 3.0], [60.0, 75.0, 20.0]])
    hidden = [
        sight.find_hidden(model, places, np.array(eye), 0.01).tolist()
        for eye in ((55, 37, 900), (55, 900, 20.0))
    ]
    assert hidden == [[False, False, True], [True, True, False]]


def test_the_viewpoint_is_estimated_from_the_visible_faces():
    model = make_model(*arrays_of(shells.housing()))
    places, normals = model.samples[::25], model.sample_normals[::25]
    true_direction = np.array([0.5, -0.4, 0.77]) / np.linalg.norm([0.5, -0.4, 0.77])
    far_eyes = sight.make_far_eyes(model, true_direction[None])
    is_seen = sight.find_seen(model, places, normals, far_eyes, 0.15)[0]
    estimate = sight.estimate_eye(model, sight.SeenPlaces(places, normals, is_seen), 0.15)
    direction = estimate.eye - (model.low + model.high) / 2
    assert estimate.share > 0.9
    assert np.degrees(np.arccos(direction @ true_direction / np.linalg.norm(direction))) < 15


# -- which side


def test_the_scanned_side_of_a_bent_sheet_is_found():
    """Both legs fit the points if the sheet is moved by its thickness: only the rims decide."""
    mesh = shells.angle()
    eye = mesh.bounds.mean(axis=0) + np.array([-450.0, -300.0, 260.0])
    truth = placed(np.random.default_rng(2001), 30, 50)
    points = shells.one_sided(mesh, 6000, 1, eye) @ truth[0].T + truth[1]
    assert worst_error(mesh, localize("scan", arrays_of(mesh), points), truth) < 0.05
    eye = truth[0] @ eye + truth[1]
    assert worst_error(mesh, localize("scan", arrays_of(mesh), points, viewpoint=eye), truth) < 0.05


def scan_face(noise=0.02):
    """A sheet, and a scan of its upper face without the rim."""
    mesh = trimesh.creation.box((120, 80, THICKNESS))
    rng = np.random.default_rng(0)
    points = np.column_stack(
        [rng.uniform(-60, 60, 5000), rng.uniform(-40, 40, 5000), np.full(5000, THICKNESS / 2)]
    )
    return mesh, points + rng.normal(0, noise, points.shape)


@pytest.mark.parametrize("height", [0.0, THICKNESS])
def test_a_start_near_one_of_two_poses_decides(height):
    mesh, points = scan_face()
    location = localize("scan", arrays_of(mesh), points, Pose(IDENTITY, (10.0, -5.0, height + 0.2)))
    assert location.base_from_work.origin[2] == pytest.approx(height, abs=0.02)


def test_a_start_between_two_poses_is_refused():
    mesh, points = scan_face()
    with pytest.raises(NoSafeProgram, match="more exactly where the part stands with --start"):
        localize("scan", arrays_of(mesh), points, Pose(IDENTITY, (0.0, 0.0, THICKNESS / 2)))


def test_a_sheet_thinner_than_the_noise_needs_no_start():
    mesh = trimesh.creation.box((120, 80, 0.25))
    points = scan_face(0.1)[1] - np.array([0, 0, THICKNESS / 2 - 0.125])
    location = localize("scan", arrays_of(mesh), points)
    assert abs(location.base_from_work.origin[2]) < 0.3


def test_a_free_motion_is_refused_without_a_start():
    """The scan shows the four sides of a bar without its ends, so the bar may be moved along x."""
    bar = trimesh.creation.box((200, 40, 30))
    points, _ = trimesh.sample.sample_surface(bar, 12_000, seed=1)
    points = points[np.abs(points[:, 0]) < 75]
    points += np.random.default_rng(1).normal(0, 0.03, points.shape)
    with pytest.raises(NoSafeProgram, match="moving it along x changes nothing"):
        localize("scan", arrays_of(bar), points)
    location = localize("scan", arrays_of(bar), points, Pose(IDENTITY, (0.0, 0.0, 0.0)))
    assert location.free == "moving it along x"


# -- hidden faces


@pytest.mark.parametrize("is_viewpoint_given", [False, True])
def test_a_hollow_part_is_found_though_it_hides_half_of_itself(is_viewpoint_given):
    mesh = shells.housing()
    eye = mesh.bounds.mean(axis=0) + np.array([300.0, 330.0, 400.0])
    points = shells.one_sided(mesh, 6000, 1, eye)
    location = localize(
        "scan", arrays_of(mesh), points, viewpoint=eye if is_viewpoint_given else None
    )
    assert worst_error(mesh, location) < 0.05
    assert location.seen.near > 0.9
    assert location.seen.all < 0.5


def test_a_viewpoint_on_the_wrong_side_is_refused():
    mesh = trimesh.load_mesh(PARTS / "rfa1.stl")
    eye = mesh.bounds.mean(axis=0) + np.array([300.0, 330.0, 400.0])
    with pytest.raises(
        InputError, match=r"% of the points on it from the scanner\); check --viewpoint"
    ):
        localize("scan", arrays_of(mesh), shells.one_sided(mesh, 6000, 1, eye), viewpoint=-eye)


# -- from the command line


def make_pcd(points, viewpoint):
    head = (
        f"VERSION 0.7\nFIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {len(points)}\n"
        "HEIGHT 1\n"
    )
    head += f"VIEWPOINT {viewpoint}\nPOINTS {len(points)}\nDATA binary\n"
    return head.encode() + points.astype("<f8").tobytes()


@pytest.fixture
def localize_sheet(tmp_path):
    mesh, points = scan_face()
    mesh.export(tmp_path / "sheet.stl")

    def run(viewpoint, *words):
        (tmp_path / "scan.pcd").write_bytes(make_pcd(points / 1000, viewpoint))
        paths = [str(tmp_path / name) for name in ("sheet.stl", "scan.pcd", "frame.toml")]
        return cli.main(["localize", *paths[:2], "-o", paths[2], "--units", "m", *words])

    run.target = tmp_path / "frame.toml"
    return run


def read_height(text):
    """The height of the middle of the sheet in a job file, mm."""
    return tomllib.loads(text)["cell"]["base_from_work"][2]


def test_the_viewpoint_of_a_pcd_decides_which_face_was_scanned(localize_sheet):
    assert localize_sheet("0.05 0.02 0.5 1 0 0 0") == 0
    text = localize_sheet.target.read_text()
    assert "# viewpoint: 50, 20, 500 mm, as the scan says" in text
    assert read_height(text) == pytest.approx(0.0, abs=0.02)


def test_an_unknown_face_of_a_sheet_is_refused_without_a_file(localize_sheet, capsys):
    undecided = r"does not settle where the part stands .*up to 1\.6.* mm.*--viewpoint"
    assert localize_sheet("0 0 0 1 0 0 0") == 3
    assert re.search(undecided, capsys.readouterr().err)
    assert localize_sheet("0 0 0.5 1 0 0 0", "--viewpoint", "unknown") == 3
    assert re.search(undecided, capsys.readouterr().err)
    assert not localize_sheet.target.exists()


def test_the_option_replaces_the_viewpoint_of_the_file(localize_sheet):
    assert localize_sheet("0 0 0.5 1 0 0 0", "--viewpoint=50,20,-500") == 0
    text = localize_sheet.target.read_text()
    assert "# viewpoint: 50, 20, -500 mm\n" in text
    assert read_height(text) == pytest.approx(THICKNESS, abs=0.02)


@pytest.mark.parametrize(
    ("viewpoint", "words", "message"),
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
def test_an_invalid_viewpoint_is_refused_in_one_line(
    viewpoint, words, message, localize_sheet, capsys
):
    assert localize_sheet(viewpoint, *words) == 2
    output = capsys.readouterr().err
    assert message in output
    assert output.count("\n") == 1
