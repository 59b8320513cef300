"""A calibration finds the camera of calculated photos, and agrees with OpenCV on real photos."""

import xml.etree.ElementTree as ET
from argparse import Namespace
from collections.abc import Iterable
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
from camgen.vision.camera.calibrate import (
    LeftOut,
    Photo,
    UsedPhoto,
    calibrate,
    fit_camera,
    read_photo,
)
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
#: `CAMERA` with a quarter of the pixels, for photos that are rendered.
HALF = Camera(frozen(CAMERA.matrix * [[0.5], [0.5], [1]]), CAMERA.distortion, (320, 240), "half")
BOARD = make_chessboard(9, 6, 25)
SIZE = (200.0, 125.0)
_, MM = chess(9, 6, 25)
NOISE = 0.05


def taken(
    camera: Camera, pose: tuple[np.ndarray, np.ndarray], name: str, seed: int, noise: float = NOISE
) -> Photo:
    """The corners of the board as the camera sees them, each with an error of `noise` px (rms)."""
    errors = np.random.default_rng(seed).normal(0, noise, MM.shape)
    return Photo(
        name, camera.size, SeenBoard(frozen(projected(camera, pose, MM) + errors), frozen(MM), 54)
    )


def photos(
    camera: Camera, count: int, tilt: float = 35, fill: float = 0.6, seed: int | None = None
) -> list[Photo]:
    """Photos p0, p1, ... of the board in random poses. The count seeds them unless `seed` does."""
    board_poses = poses(camera, SIZE, count, count if seed is None else seed, tilt=tilt, fill=fill)
    return [taken(camera, pose, f"p{i}", i) for i, pose in enumerate(board_poses)]


def pinhole(camera: Camera) -> np.ndarray:
    """Focal lengths and principal point (4,), px."""
    return camera.matrix[[0, 1, 0, 1], [0, 1, 2, 2]]


def list_names(photos: Iterable[UsedPhoto | LeftOut]) -> list[str]:
    return [photo.name for photo in photos]


# -- the fit


def test_the_true_camera_is_found_within_the_stated_deviations() -> None:
    calibration = fit_camera(photos(CAMERA, 12), BOARD, "camera")
    # 648 corners have 1296 coordinates. The fit has 9 numbers of the camera and 6 of each pose.
    assert calibration.rms == pytest.approx(NOISE * np.sqrt(2 * (1296 - 81) / 1296), rel=0.06)
    camera, deviations = calibration.camera, calibration.deviations[:4]
    assert np.all(np.abs(pinhole(camera) - pinhole(CAMERA)) < 4 * deviations)
    assert deviations.max() < 1
    assert (camera.size, camera.name, len(camera.distortion)) == ((640, 480), "camera", 5)
    assert calibration.left_out == ()


def test_the_stated_deviations_are_those_of_many_calibrations() -> None:
    board_poses = poses(CAMERA, SIZE, 6, seed=8)
    results, stated = [], []
    for run in range(20):
        noisy = [taken(CAMERA, p, f"p{i}", 100 * run + i) for i, p in enumerate(board_poses)]
        calibration = fit_camera(noisy, BOARD, "x")
        results.append(np.append(pinhole(calibration.camera), calibration.camera.distortion))
        stated.append(calibration.deviations)
    # Twenty calibrations determine a deviation to 16 %.
    assert np.all(np.abs(np.log(np.std(results, axis=0, ddof=1) / np.mean(stated, axis=0))) < 0.5)


def test_a_photo_that_contradicts_the_others_is_left_out_and_named() -> None:
    zoomed = Camera(
        frozen(CAMERA.matrix * [[1.05], [1.05], [1]]), CAMERA.distortion, CAMERA.size, "zoomed"
    )
    good = photos(CAMERA, 8)
    pose = poses(CAMERA, SIZE, 1, seed=3, fill=0.5)[0]
    calibration = fit_camera(
        [*good[:4], taken(zoomed, pose, "zoomed.jpg", 5), *good[4:]], BOARD, "x"
    )
    assert list_names(calibration.used) == [f"p{i}" for i in range(8)]
    assert list_names(calibration.left_out) == ["zoomed.jpg"]
    assert "contradicts the others" in calibration.left_out[0].why
    assert np.array_equal(calibration.camera.matrix, fit_camera(good, BOARD, "x").camera.matrix)


def test_a_photo_of_a_bent_board_is_left_out() -> None:
    board_poses = poses(CAMERA, SIZE, 6, seed=6)
    bent = np.column_stack([MM, 3 * np.sin(np.pi * MM[:, 0] / SIZE[0])])
    px, _ = cv2.projectPoints(bent, *board_poses[0], CAMERA.matrix, CAMERA.distortion)
    seen = SeenBoard(frozen(px.reshape(-1, 2)), frozen(MM), 54)
    bent_photo = Photo("bent", CAMERA.size, seen)
    calibration = fit_camera([bent_photo, *photos(CAMERA, 6)[1:]], BOARD, "x")
    assert list_names(calibration.left_out) == ["bent"]


def test_a_photo_that_alone_shows_the_corners_of_the_view_is_used() -> None:
    alone = poses(CAMERA, SIZE, 1, seed=2, fill=0.95, tilt=15)[0]
    for count in (3, 5, 10):
        middle = photos(CAMERA, count, fill=0.4)
        calibration = fit_camera([*middle, taken(CAMERA, alone, "alone", 99)], BOARD, "x")
        assert calibration.left_out == ()


def test_a_wide_angle_lens_gets_eight_coefficients() -> None:
    """Five coefficients cannot follow an equidistant fisheye, r = f theta, up to 65 deg."""
    focal, size = 300.0, (640, 480)
    guide = Camera(
        frozen([[250, 0, 318], [0, 250, 243], [0, 0, 1]]),
        frozen([-0.2, 0.02, 0, 0, 0]),
        size,
        "guide",
    )
    wide = []
    for i, pose in enumerate(poses(guide, SIZE, 25, seed=2, fill=0.35)):
        mm = np.column_stack([MM, np.zeros(len(MM))]) @ cv2.Rodrigues(pose[0])[0].T + pose[1]
        radius = np.hypot(mm[:, 0], mm[:, 1])
        px = mm[:, :2] * (focal * np.arctan2(radius, mm[:, 2]) / radius)[:, None] + [318, 243]
        noise = np.random.default_rng(i).normal(0, NOISE, px.shape)
        wide.append(Photo(f"p{i}", size, SeenBoard(frozen(px + noise), frozen(MM), 54)))
    calibration = fit_camera(wide, BOARD, "x")
    assert len(calibration.camera.distortion) == 8
    assert calibration.left_out == ()
    assert calibration.rms < 1.1 * NOISE * np.sqrt(2)
    assert np.all(np.abs(pinhole(calibration.camera) - [focal, focal, 318, 243]) < 0.8)
    assert any("wide-angle lens of 8 coefficients" in note.what for note in calibration.notes)


# -- notes and refusals


def test_boards_that_are_not_tilted_do_not_determine_the_focal_length() -> None:
    for tilt in (0.01, 0.5):
        with pytest.raises(
            InputError,
            match=r"p0 and 5 more: the photos do not determine the focal length; .* tilted",
        ):
            fit_camera(photos(CAMERA, 6, tilt=tilt), BOARD, "x")
    calibration = fit_camera(photos(CAMERA, 6, tilt=4), BOARD, "x")
    assert any("focal length known to" in note.what for note in calibration.notes)


def test_parts_of_the_view_without_a_board_are_noted() -> None:
    middle = photos(CAMERA, 6, fill=0.25, seed=1)
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


def test_large_errors_are_noted() -> None:
    rough = [
        taken(CAMERA, p, f"p{i}", i, noise=1.5)
        for i, p in enumerate(poses(CAMERA, SIZE, 10, seed=1))
    ]
    assert any(note.what.startswith("errors of ") for note in fit_camera(rough, BOARD, "x").notes)


def test_photos_without_a_board_and_copies_are_left_out_with_their_reason() -> None:
    good = photos(CAMERA, 5)
    bench = Photo("bench.jpg", CAMERA.size, None)
    copy = Photo("again.jpg", CAMERA.size, good[1].seen)
    calibration = fit_camera([bench, *good, copy], BOARD, "x")
    assert [(photo.name, photo.why.split(":")[0]) for photo in calibration.left_out] == [
        ("bench.jpg", "chessboard 9x6 not found"),
        ("again.jpg", "the same picture as p1"),
    ]
    with pytest.raises(
        InputError, match="2 of 3 photos can be used with the chessboard 9x6, 3 are needed"
    ):
        fit_camera([bench, *good[:2]], BOARD, "x")


def test_photos_of_another_size_are_left_out_with_their_reason() -> None:
    good = photos(CAMERA, 5)
    boards = (good[0].seen, good[1].seen, None)
    small = [Photo(f"small{k}.jpg", (320, 240), board) for k, board in enumerate(boards)]
    calibration = fit_camera([*small, *good], BOARD, "x")
    reason = "is 320 x 240 px, not 640 x 480: a calibration is for one size"
    left_out = [(photo.name, photo.why) for photo in calibration.left_out]
    assert left_out == [(photo.name, reason) for photo in small]
    assert list_names(calibration.used) == [f"p{i}" for i in range(5)]
    assert np.array_equal(calibration.camera.matrix, fit_camera(good, BOARD, "x").camera.matrix)
    # Photos without a board do not decide which size is calibrated.
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
        photo(HALF, drawn, pose, seed=i).pixels
        for i, pose in enumerate(poses(HALF, SIZE, 6, seed=4))
    )


def written(folder: Path, pictures: tuple[np.ndarray, ...]) -> list[str]:
    paths = [folder / f"photo{i}.png" for i in range(len(pictures))]
    for path, picture in zip(paths, pictures, strict=True):
        cv2.imwrite(str(path), picture)
    return [str(path) for path in paths]


def options(folder: Path, paths: list[str], **given: object) -> Namespace:
    usual = {"board": "9x6", "square": 25.0, "marker": None, "dictionary": None, "preview": None}
    return Namespace(photos=paths, output=str(folder / "camera.yaml"), **(usual | given))


def test_a_calibration_of_files_writes_a_camera_and_a_picture(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bench = np.full((240, 320), 120, np.uint8)
    paths = written(tmp_path, (*rendered(), bench))
    arguments = options(tmp_path, paths, preview=str(tmp_path / "residuals.svg"))
    cli_calibrate.run(arguments, make_terminal(quiet=False, verbose=0))
    printed = capsys.readouterr()
    assert printed.out.count("54 of 54") == 6
    assert "left out  photo6.png: chessboard 9x6 not found" in printed.err
    assert "6 of 7 photos, 324 corners" in printed.err
    camera = read_camera(source(tmp_path / "camera.yaml"))
    assert np.all(np.abs(pinhole(camera) / pinhole(HALF) - 1) < 0.003)
    assert camera.name == "camera"
    first = (tmp_path / "camera.yaml").read_bytes()
    drawn = (tmp_path / "residuals.svg").read_bytes()
    cli_calibrate.run(arguments, make_terminal(quiet=True, verbose=0))
    assert capsys.readouterr() == ("", "")
    assert (tmp_path / "camera.yaml").read_bytes() == first
    assert (tmp_path / "residuals.svg").read_bytes() == drawn


def test_files_with_a_charuco_board_are_calibrated(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drawn = charuco(7, 5, 25, 20, cv2.aruco.DICT_5X5_100)
    board_poses = poses(CAMERA, (175.0, 125.0), 4, seed=4, fill=0.7)
    pictures = [photo(CAMERA, drawn, p, seed=i).pixels for i, p in enumerate(board_poses)]
    paths = written(tmp_path, tuple(pictures))
    arguments = options(tmp_path, paths, board="7x5", marker=20.0, dictionary="5X5_100")
    cli_calibrate.run(arguments, make_terminal(quiet=False, verbose=0))
    assert "ChArUco board 7x5, squares of 25 mm" in capsys.readouterr().err
    assert np.all(
        np.abs(pinhole(read_camera(source(tmp_path / "camera.yaml"))) / pinhole(CAMERA) - 1) < 0.005
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


def test_a_photo_keeps_the_orientation_of_the_sensor(tmp_path: Path) -> None:
    """An Exif orientation is ignored: a phone that looks down sets it almost at random."""
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
    ("given", "message"),
    [
        ({"board": "9 by 6"}, "--board: '9 by 6' is not the size of a board; give columns x rows"),
        ({"dictionary": "4X4_50"}, "--dictionary: a chessboard has no markers; give --marker"),
        ({"preview": "residuals.png"}, "residuals.png: is not a kind of picture"),
        ({"square": -1.0}, "--square: must be a length above 0 mm, not -1.0"),
    ],
)
def test_an_invalid_option_is_refused(
    tmp_path: Path, given: dict[str, object], message: str
) -> None:
    with pytest.raises(JobError) as caught:
        cli_calibrate.run(
            options(tmp_path, ["a.jpg"], **given), make_terminal(quiet=True, verbose=0)
        )
    assert message in str(caught.value)
    assert not (tmp_path / "camera.yaml").exists()


def test_a_camera_file_that_would_overwrite_a_photo_is_refused(tmp_path: Path) -> None:
    with pytest.raises(JobError, match="would overwrite"):
        cli_calibrate.run(
            options(tmp_path, [str(tmp_path / "camera.yaml")]), make_terminal(quiet=True, verbose=0)
        )


def test_the_picture_shows_every_corner_and_every_photo() -> None:
    blind = Photo('<b>"blind"&.jpg', CAMERA.size, None)
    calibration = fit_camera([*photos(CAMERA, 5), blind], BOARD, "x")
    root = ET.fromstring(draw_residuals(calibration, "a < b"))
    kinds = [(element.get("class"), element) for element in root.iter()]
    strokes = "".join(element.get("d", "") for kind, element in kinds if kind == "arrow")
    assert strokes.count("M") == 5 * 54
    assert sum(kind == "bar" for kind, _ in kinds) == 5
    text = [element.text for _, element in kinds]
    assert '<b>"blind"&.jpg' in text
    assert "a < b" in text
    assert any(f"{calibration.rms:.3f} px rms" in (line or "") for line in text)


@pytest.mark.skipif(
    not SHARED.is_dir(), reason="the photo set opencv-left of the shared data is not there"
)
def test_real_photos_are_fitted_as_well_as_by_opencv() -> None:
    """OpenCV reaches 0.183 px (rms) here, at best: cornerSubPix with a window of 7 px."""
    paths = sorted(SHARED.glob("*.jpg"))
    calibration = calibrate([source(path) for path in paths], BOARD, "left", lambda _: None)
    assert len(calibration.used) == 13
    greys = [cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in paths]
    until = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-4)
    corners = [
        cv2.cornerSubPix(g, cv2.findChessboardCorners(g, (9, 6))[1], (7, 7), (-1, -1), until)
        for g in greys
    ]
    board = np.column_stack([MM, np.zeros(54)]).astype(np.float32)
    rms, matrix, *_ = cv2.calibrateCamera([board] * 13, corners, (640, 480), None, None)
    assert calibration.rms < rms + 0.05
    assert np.all(
        np.abs(pinhole(calibration.camera) / matrix[[0, 1, 0, 1], [0, 1, 2, 2]] - 1) < 0.005
    )
