"""Calibrations against the camera that the photos were calculated with, and against OpenCV on real photos."""

import xml.etree.ElementTree as ET
from argparse import Namespace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from camgen.cli import calibrate as cli_calibrate
from camgen.cli.say import make_terminal
from camgen.model.errors import InputError, JobError
from camgen.model.pose import frozen
from camgen.vision.boards.corners import SeenBoard, make_chessboard
from camgen.vision.camera.calibrate import Calibration, Photo, calibrate, fit_camera, read_photo
from camgen.vision.camera.camera import Camera, read_camera
from camgen.vision.camera.residuals import draw_residuals
from tests.support.board_photos import charuco, chess, photo, poses, projected
from tests.support.files import source

SHARED = Path(__file__).parents[2].parent / "shared" / "data" / "calib" / "opencv-left"
CAMERA = Camera(
    matrix=frozen([[600, 0, 318], [0, 602, 243], [0, 0, 1]]),
    distortion=frozen([-0.28, 0.1, 0.001, -0.0007, 0.0]),
    size=(640, 480),
    name="true",
)
#: The same with a quarter of the pixels, for photos that are rendered.
HALF = Camera(frozen(CAMERA.matrix * [[0.5], [0.5], [1]]), CAMERA.distortion, (320, 240), "half")
BOARD = make_chessboard(9, 6, 25)
SIZE = (200.0, 125.0)
_, MM = chess(9, 6, 25)
NOISE = 0.05


def taken(
    camera: Camera, pose: tuple[np.ndarray, np.ndarray], name: str, seed: int, noise: float = NOISE
) -> Photo:
    """A photo whose corners are those of the camera, and noise."""
    errors = np.random.default_rng(seed).normal(0, noise, MM.shape)
    return Photo(
        name, camera.size, SeenBoard(frozen(projected(camera, pose, MM) + errors), frozen(MM), 54)
    )


def photos(camera: Camera, count: int, tilt: float = 35, fill: float = 0.6) -> list[Photo]:
    places = poses(camera, SIZE, count, seed=count, tilt=tilt, fill=fill)
    return [taken(camera, pose, f"p{i}", i) for i, pose in enumerate(places)]


def four(camera: Camera) -> np.ndarray:
    return camera.matrix[[0, 1, 0, 1], [0, 1, 2, 2]]


def names(found: Calibration) -> list[str]:
    return [one.name for one in found.used]


# -- the fit


def test_the_true_camera_comes_out_within_its_deviations() -> None:
    found = fit_camera(photos(CAMERA, 12), BOARD, "camera")
    # Two coordinates of 648 corners, less 9 numbers of the camera and 6 of each pose.
    assert found.rms == pytest.approx(NOISE * np.sqrt(2 * (1296 - 81) / 1296), rel=0.06)
    assert np.all(np.abs(four(found.camera) - four(CAMERA)) < 4 * found.deviations[:4])
    assert found.deviations[:4].max() < 1
    assert (found.camera.size, found.camera.name, len(found.camera.distortion)) == (
        (640, 480),
        "camera",
        5,
    )
    assert found.left_out == ()


def test_the_deviations_are_those_of_many_calibrations() -> None:
    places = poses(CAMERA, SIZE, 6, seed=8)
    results, said = [], []
    for run in range(20):
        one = fit_camera(
            [taken(CAMERA, p, f"p{i}", 100 * run + i) for i, p in enumerate(places)], BOARD, "x"
        )
        results.append(np.concatenate([four(one.camera), one.camera.distortion]))
        said.append(one.deviations)
    # Twenty of them tell a deviation to 16 %.
    assert np.all(np.abs(np.log(np.std(results, axis=0, ddof=1) / np.mean(said, axis=0))) < 0.5)


def test_a_photo_that_contradicts_the_others_is_left_out_and_named() -> None:
    zoomed = Camera(
        frozen(CAMERA.matrix * [[1.05], [1.05], [1]]), CAMERA.distortion, CAMERA.size, "zoomed"
    )
    good = photos(CAMERA, 8)
    pose = poses(CAMERA, SIZE, 1, seed=3, fill=0.5)[0]
    found = fit_camera([*good[:4], taken(zoomed, pose, "zoomed.jpg", 5), *good[4:]], BOARD, "x")
    assert names(found) == [f"p{i}" for i in range(8)]
    assert [one.name for one in found.left_out] == ["zoomed.jpg"]
    assert "contradicts the others" in found.left_out[0].why
    assert np.array_equal(found.camera.matrix, fit_camera(good, BOARD, "x").camera.matrix)


def test_a_board_that_was_bent_in_one_photo() -> None:
    places = poses(CAMERA, SIZE, 6, seed=6)
    bent = np.column_stack([MM, 3 * np.sin(np.pi * MM[:, 0] / SIZE[0])])
    px = cv2.projectPoints(bent, *places[0], CAMERA.matrix, CAMERA.distortion)[0].reshape(-1, 2)
    all_photos = [
        Photo("bent", CAMERA.size, SeenBoard(frozen(px), frozen(MM), 54)),
        *photos(CAMERA, 6)[1:],
    ]
    found = fit_camera(all_photos, BOARD, "x")
    assert [one.name for one in found.left_out] == ["bent"]


def test_sound_photos_are_never_left_out() -> None:
    """Not even the one that alone shows the corners of the view."""
    alone = poses(CAMERA, SIZE, 1, seed=2, fill=0.95, tilt=15)[0]
    for count in (3, 5, 10):
        middle = [
            taken(CAMERA, p, f"m{i}", i)
            for i, p in enumerate(poses(CAMERA, SIZE, count, seed=count, fill=0.4))
        ]
        found = fit_camera([*middle, taken(CAMERA, alone, "alone", 99)], BOARD, "x")
        assert found.left_out == ()


def test_a_wide_angle_lens_gets_more_coefficients_and_only_it() -> None:
    """An equidistant fisheye: r = f theta, which five coefficients cannot follow to 65 deg."""
    focal, size = 300.0, (640, 480)
    guide = Camera(
        frozen([[250, 0, 318], [0, 250, 243], [0, 0, 1]]),
        frozen([-0.2, 0.02, 0, 0, 0]),
        size,
        "guide",
    )
    wide = []
    for i, pose in enumerate(poses(guide, SIZE, 25, seed=2, fill=0.35)):
        at = np.column_stack([MM, np.zeros(len(MM))]) @ cv2.Rodrigues(pose[0])[0].T + pose[1]
        radius = np.hypot(at[:, 0], at[:, 1])
        px = at[:, :2] * (focal * np.arctan2(radius, at[:, 2]) / radius)[:, None] + [318, 243]
        noise = np.random.default_rng(i).normal(0, NOISE, px.shape)
        wide.append(Photo(f"p{i}", size, SeenBoard(frozen(px + noise), frozen(MM), 54)))
    found = fit_camera(wide, BOARD, "x")
    assert len(found.camera.distortion) == 8
    assert found.left_out == ()
    assert found.rms < 1.1 * NOISE * np.sqrt(2)
    assert np.all(np.abs(four(found.camera) - [focal, focal, 318, 243]) < 0.8)
    assert any("wide-angle lens of 8 coefficients" in note.what for note in found.notes)


# -- what the user is told


def test_boards_that_were_not_tilted() -> None:
    for tilt in (0.01, 0.5):
        with pytest.raises(
            InputError,
            match=r"p0 and 5 more: the photos do not determine the focal length; .* tilted",
        ):
            fit_camera(photos(CAMERA, 6, tilt=tilt), BOARD, "x")
    found = fit_camera(photos(CAMERA, 6, tilt=4), BOARD, "x")
    assert any("focal length known to" in note.what for note in found.notes)


def test_parts_of_the_view_without_a_board() -> None:
    middle = [
        taken(CAMERA, p, f"p{i}", i)
        for i, p in enumerate(poses(CAMERA, SIZE, 6, seed=1, fill=0.25))
    ]
    near = [p for p in middle if p.seen and np.abs(p.seen.corners - [320, 240]).max() < 200]
    assert len(near) >= 3
    notes = fit_camera(near, BOARD, "x").notes
    assert any(
        "no corner seen beyond" in note.what or "nothing in the corners" in note.what
        for note in notes
    )
    assert not any(
        "corner" in note.what for note in fit_camera(photos(CAMERA, 12), BOARD, "x").notes
    )


def test_large_errors_are_said() -> None:
    rough = [
        taken(CAMERA, p, f"p{i}", i, noise=1.5)
        for i, p in enumerate(poses(CAMERA, SIZE, 10, seed=1))
    ]
    assert any(note.what.startswith("errors of ") for note in fit_camera(rough, BOARD, "x").notes)


def test_photos_that_cannot_be_used_together() -> None:
    good = photos(CAMERA, 5)
    none = Photo("bench.jpg", CAMERA.size, None)
    found = fit_camera([none, *good, Photo("again.jpg", CAMERA.size, good[1].seen)], BOARD, "x")
    assert [(one.name, one.why.split(":")[0]) for one in found.left_out] == [
        ("bench.jpg", "chessboard 9x6 not found"),
        ("again.jpg", "the same picture as p1"),
    ]
    with pytest.raises(
        InputError, match="2 of 3 photos can be used with the chessboard 9x6, 3 are needed"
    ):
        fit_camera([none, *good[:2]], BOARD, "x")


def test_photos_of_another_size_are_left_out_with_their_reason() -> None:
    good = photos(CAMERA, 5)
    small = [
        Photo(f"small{k}.jpg", (320, 240), board)
        for k, board in enumerate([*(p.seen for p in good[:2]), None])
    ]
    found = fit_camera([*small, *good], BOARD, "x")
    assert [(one.name, one.why) for one in found.left_out] == [
        (one.name, "is 320 x 240 px, not 640 x 480: a calibration is for one size") for one in small
    ]
    assert names(found) == [f"p{i}" for i in range(5)]
    assert np.array_equal(found.camera.matrix, fit_camera(good, BOARD, "x").camera.matrix)
    # What shows no board does not decide which size is calibrated.
    benches = [Photo(f"bench{k}.jpg", (320, 240), None) for k in range(9)]
    assert fit_camera([*benches, *good], BOARD, "x").camera.size == (640, 480)
    with pytest.raises(
        InputError, match=r"2 of 3 photos can be used .*small0\.jpg: is 320 x 240 px, not 640 x 480"
    ):
        fit_camera([small[0], *good[:2]], BOARD, "x")


# -- from files


@cache
def rendered() -> tuple[np.ndarray, ...]:
    drawn = chess(9, 6, 25)
    return tuple(
        photo(HALF, drawn, p, seed=i).pixels for i, p in enumerate(poses(HALF, SIZE, 6, seed=4))
    )


def written(folder: Path, pictures: tuple[np.ndarray, ...]) -> list[str]:
    paths = [folder / f"photo{i}.png" for i in range(len(pictures))]
    for path, picture in zip(paths, pictures, strict=True):
        cv2.imwrite(str(path), picture)
    return [str(path) for path in paths]


def options(folder: Path, paths: list[str], **given: object) -> Namespace:
    usual = {"board": "9x6", "square": 25.0, "marker": None, "dictionary": None, "preview": None}
    return Namespace(photos=paths, output=str(folder / "camera.yaml"), **(usual | given))


def test_from_files_to_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bench = np.full((240, 320), 120, np.uint8)
    paths = written(tmp_path, (*rendered(), bench))
    arguments = options(tmp_path, paths, preview=str(tmp_path / "residuals.svg"))
    assert cli_calibrate.run(arguments, make_terminal(quiet=False, verbose=0)) == 0
    said = capsys.readouterr()
    assert said.out.count("54 of 54") == 6
    assert "left out  photo6.png: chessboard 9x6 not found" in said.err
    assert "6 of 7 photos, 324 corners" in said.err
    camera = read_camera(source(tmp_path / "camera.yaml"))
    assert np.all(np.abs(four(camera) / four(HALF) - 1) < 0.003)
    assert camera.name == "camera"
    first = (tmp_path / "camera.yaml").read_bytes()
    drawn = (tmp_path / "residuals.svg").read_bytes()
    assert cli_calibrate.run(arguments, make_terminal(quiet=True, verbose=0)) == 0
    assert capsys.readouterr() == ("", "")
    assert (tmp_path / "camera.yaml").read_bytes() == first
    assert (tmp_path / "residuals.svg").read_bytes() == drawn


def test_from_charuco_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    drawn = charuco(7, 5, 25, 20, cv2.aruco.DICT_5X5_100)
    places = poses(CAMERA, (175.0, 125.0), 4, seed=4, fill=0.7)
    paths = written(
        tmp_path, tuple(photo(CAMERA, drawn, p, seed=i).pixels for i, p in enumerate(places))
    )
    arguments = options(tmp_path, paths, board="7x5", marker=20.0, dictionary="5X5_100")
    assert cli_calibrate.run(arguments, make_terminal(quiet=False, verbose=0)) == 0
    assert "ChArUco board 7x5, squares of 25 mm" in capsys.readouterr().err
    assert np.all(
        np.abs(four(read_camera(source(tmp_path / "camera.yaml"))) / four(CAMERA) - 1) < 0.005
    )


def test_a_board_given_by_its_squares_is_recognised(tmp_path: Path) -> None:
    paths = [Path(name) for name in written(tmp_path, rendered()[:3])]
    with pytest.raises(InputError, match="they show a chessboard 9x6: give --board 9x6"):
        calibrate([source(path) for path in paths], make_chessboard(10, 7, 25), "x", lambda _: None)
    cv2.imwrite(str(tmp_path / "bench.png"), np.full((480, 640), 120, np.uint8))
    with pytest.raises(
        InputError,
        match=r"bench\.png: no photo shows the chessboard 9x6; --board counts inner corners",
    ):
        calibrate([source(tmp_path / "bench.png")], BOARD, "x", lambda _: None)


def test_a_turned_photo_is_taken_as_the_sensor_saw_it(tmp_path: Path) -> None:
    """A JPEG with an Exif orientation of 6, as phones write it: cameras that look down set it almost at random."""
    plain = cv2.imencode(".jpg", rendered()[0])[1].tobytes()
    tag = b"MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0"
    exif = b"\xff\xe1" + (len(tag) + 8).to_bytes(2, "big") + b"Exif\0\0" + tag
    (tmp_path / "plain.jpg").write_bytes(plain)
    (tmp_path / "phone.jpg").write_bytes(plain[:2] + exif + plain[2:])
    seen = [read_photo(source(tmp_path / name), BOARD) for name in ("plain.jpg", "phone.jpg")]
    assert seen[0].size == seen[1].size
    assert seen[0].seen is not None
    assert seen[1].seen is not None
    assert np.array_equal(seen[0].seen.corners, seen[1].seen.corners)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"board": "9 by 6"}, "--board: '9 by 6' is not the size of a board; give columns x rows"),
        ({"dictionary": "4X4_50"}, "--dictionary: a chessboard has no markers; give --marker"),
        ({"preview": "residuals.png"}, "residuals.png: is not a kind of picture"),
        ({"square": -1.0}, "--square: must be a length above 0 mm, not -1.0"),
    ],
)
def test_options_that_cannot_be(tmp_path: Path, given: dict[str, object], says: str) -> None:
    with pytest.raises(JobError) as caught:
        cli_calibrate.run(
            options(tmp_path, ["a.jpg"], **given), make_terminal(quiet=True, verbose=0)
        )
    assert says in str(caught.value)
    assert not (tmp_path / "camera.yaml").exists()


def test_no_photo_is_overwritten(tmp_path: Path) -> None:
    with pytest.raises(JobError, match="would overwrite"):
        cli_calibrate.run(
            options(tmp_path, [str(tmp_path / "camera.yaml")]), make_terminal(quiet=True, verbose=0)
        )


def test_the_picture_shows_every_corner_and_every_photo() -> None:
    blind = Photo('<b>"blind"&.jpg', CAMERA.size, None)
    found = fit_camera([*photos(CAMERA, 5), blind], BOARD, "x")
    root = ET.fromstring(draw_residuals(found, "a < b"))
    kinds = [(element.get("class"), element) for element in root.iter()]
    strokes = "".join(element.get("d", "") for kind, element in kinds if kind == "arrow")
    assert strokes.count("M") == 5 * 54
    assert sum(kind == "bar" for kind, _ in kinds) == 5
    text = [element.text for _, element in kinds]
    assert '<b>"blind"&.jpg' in text
    assert "a < b" in text
    assert any(f"{found.rms:.3f} px rms" in (line or "") for line in text)


@pytest.mark.skipif(
    not SHARED.is_dir(), reason="the photo set opencv-left of the shared data is not there"
)
def test_real_photos_against_opencv() -> None:
    """cornerSubPix with a window of 7 is the best that OpenCV does on these: 0.183 px."""
    paths = sorted(SHARED.glob("*.jpg"))
    found = calibrate([source(path) for path in paths], BOARD, "left", lambda _: None)
    assert len(found.used) == 13
    greys = [cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in paths]
    until = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-4)
    corners = [
        cv2.cornerSubPix(g, cv2.findChessboardCorners(g, (9, 6))[1], (7, 7), (-1, -1), until)
        for g in greys
    ]
    places = np.column_stack([MM, np.zeros(54)]).astype(np.float32)
    rms, matrix, *_ = cv2.calibrateCamera([places] * 13, corners, (640, 480), None, None)
    assert found.rms < rms + 0.05
    assert np.all(np.abs(four(found.camera) / matrix[[0, 1, 0, 1], [0, 1, 2, 2]] - 1) < 0.005)
