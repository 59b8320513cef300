"""Boards are found in rendered photos, whose true corners are known."""

from functools import cache

import cv2
import numpy as np
import pytest

from camgen.model.errors import JobError
from camgen.model.pose import frozen
from camgen.vision.boards import corners as boards
from camgen.vision.boards.corners import SeenBoard, find_board
from camgen.vision.camera.camera import Camera
from tests.support.board_photos import BENCH, View, charuco, chess, photo, poses

CAMERA = Camera(
    matrix=frozen([[600, 0, 318], [0, 602, 243], [0, 0, 1]]),
    distortion=frozen([-0.28, 0.1, 0.001, -0.0007, 0.0]),
    size=(640, 480),
    name="rendered",
)
CHESS = boards.make_chessboard(9, 6, 25)
DICTIONARY = cv2.aruco.DICT_4X4_50
KINDS: dict[str, dict[str, float]] = {
    "sharp": {},
    "blurred": {"blur": 2.0, "noise": 5.0},
    "shaded": {"shading": 0.7},
}


@cache
def chess_photo(kind: str, index: int, fill: float = 0.6, columns: int = 9, rows: int = 6) -> View:
    size = ((columns - 1) * 25.0, (rows - 1) * 25.0)
    pose = poses(CAMERA, size, index + 1, seed=7, fill=fill)[index]
    return photo(CAMERA, chess(columns, rows, 25), pose, seed=index, **KINDS[kind])


def corner_errors(seen: SeenBoard | None, view: View, columns: int) -> np.ndarray:
    """Distance (N,) px of each corner from its true position."""
    assert seen is not None
    column, row = np.rint(seen.places / 25).astype(int).T
    return np.linalg.norm(seen.corners - view.corners[row * columns + column], axis=1)


@pytest.mark.parametrize(
    ("kind", "fill", "limit"),
    [("sharp", 0.6, 0.02), ("sharp", 0.35, 0.02), ("blurred", 0.6, 0.05), ("shaded", 0.6, 0.02)],
)
def test_corners_are_more_exact_than_those_of_opencv(kind: str, fill: float, limit: float) -> None:
    errors, opencv_errors = [], []
    for index in range(3):
        view = chess_photo(kind, index, fill)
        seen = find_board(view.pixels, CHESS)
        assert seen is not None
        assert (len(seen.corners), seen.corner_count) == (54, 54)
        errors.append(corner_errors(seen, view, 9))
        _, rough = cv2.findChessboardCorners(view.pixels, (9, 6))
        until = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-4)
        for window in (5, 11):
            size = (window, window)
            fine = cv2.cornerSubPix(view.pixels, rough.copy(), size, (-1, -1), until)
            # OpenCV may number the corners from either end.
            orders = (fine.reshape(-1, 2), fine.reshape(-1, 2)[::-1])
            opencv_errors.append(
                min(np.linalg.norm(corners - view.corners, axis=1).mean() for corners in orders)
            )
    assert np.sqrt(np.mean(np.concatenate(errors) ** 2)) < limit
    assert np.mean(np.concatenate(errors)) < 0.8 * np.mean(opencv_errors)


@pytest.mark.parametrize(("columns", "rows"), [(9, 6), (6, 9)])
def test_a_corner_has_the_same_place_in_a_photo_that_is_upside_down(
    columns: int, rows: int
) -> None:
    target = boards.make_chessboard(columns, rows, 25)
    view = chess_photo("sharp", 1, 0.6, columns, rows)
    upright = find_board(view.pixels, target)
    turned = find_board(np.ascontiguousarray(view.pixels[::-1, ::-1]), target)
    assert upright is not None
    assert turned is not None
    # The place (0, 0) mm is the first corner of the drawing, inside of which it is black.
    assert corner_errors(upright, view, columns).max() < 0.1
    assert np.array_equal(turned.places, upright.places)
    assert np.abs(np.array([639, 479]) - turned.corners - upright.corners).max() < 0.02


def test_a_photo_in_colour_or_enlarged_gives_the_same_corners() -> None:
    view = chess_photo("sharp", 0)
    plain = find_board(view.pixels, CHESS)
    colour = find_board(np.dstack([view.pixels] * 3), CHESS)
    # With 4.9 megapixels, the board is searched in a reduced picture.
    large = find_board(cv2.resize(view.pixels, (2560, 1920), interpolation=cv2.INTER_CUBIC), CHESS)
    assert plain is not None
    assert colour is not None
    assert large is not None
    assert np.abs(colour.corners - plain.corners).max() < 1e-6
    assert np.abs((large.corners + 0.5) / 4 - 0.5 - plain.corners).max() < 0.1


def test_another_board_or_half_a_board_is_not_found() -> None:
    view = chess_photo("sharp", 0)
    assert find_board(view.pixels, boards.make_chessboard(10, 7, 25)) is None
    assert find_board(np.full((480, 640), BENCH, np.uint8), CHESS) is None
    half = view.pixels.copy()
    half[:, 300:] = int(BENCH)
    assert find_board(half, CHESS) is None


def test_a_corner_under_a_bright_spot_is_left_out() -> None:
    view = chess_photo("sharp", 2)
    spot = view.pixels.copy()
    covered = view.corners[31]
    cv2.circle(spot, tuple(np.rint(covered).astype(int).tolist()), 4, 235, -1)
    seen = find_board(spot, CHESS)
    assert seen is not None
    assert len(seen.corners) == 53
    assert np.linalg.norm(seen.corners - covered, axis=1).min() > 5
    assert corner_errors(seen, view, 9).max() < 0.3


@pytest.mark.parametrize(
    ("columns", "rows", "marker", "covered"), [(7, 5, 20.0, False), (6, 8, 17.5, True)]
)
def test_a_charuco_board_may_be_partly_covered(
    columns: int, rows: int, marker: float, covered: bool
) -> None:
    drawn = charuco(columns, rows, 25, marker, DICTIONARY)
    pose = poses(CAMERA, (columns * 25.0, rows * 25.0), 1, seed=3, fill=0.8)[0]
    view = photo(CAMERA, drawn, pose)
    pixels = view.pixels.copy()
    if covered:
        pixels[:, : int(np.median(view.corners[:, 0]))] = int(BENCH)
    seen = find_board(pixels, boards.make_charuco(columns, rows, 25, marker))
    assert seen is not None
    corners = (columns - 1) * (rows - 1)
    assert seen.corner_count == corners
    assert len(seen.corners) == corners if not covered else 6 <= len(seen.corners) < corners
    column, row = (np.rint(seen.places / 25).astype(int)).T
    truth = view.corners[row * (columns - 1) + column]
    assert np.sqrt(np.mean(np.sum((seen.corners - truth) ** 2, axis=1))) < 0.04


def test_a_charuco_board_in_the_pattern_before_opencv_4_6_is_found() -> None:
    """Before OpenCV 4.6, the colours of a board with an even number of rows were exchanged."""
    drawn = cv2.aruco.CharucoBoard((5, 6), 25, 20, cv2.aruco.getPredefinedDictionary(DICTIONARY))
    drawn.setLegacyPattern(True)
    picture = cv2.copyMakeBorder(
        drawn.generateImage((400, 480)), 40, 40, 40, 40, cv2.BORDER_CONSTANT, value=255
    )
    seen = find_board(cv2.GaussianBlur(picture, (0, 0), 0.8), boards.make_charuco(5, 6, 25, 20))
    assert seen is not None
    # The squares of 80 px begin at (40, 40). A pixel begins half a pixel before its centre.
    assert np.abs(seen.corners - (seen.places / 25 * 80 + 120 - 0.5)).max() < 0.02
    assert len(seen.corners) == 20


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: boards.make_chessboard(2, 6, 25), "--board: 2x6 inner corners cannot be found"),
        (lambda: boards.make_chessboard(9, 6, 0), "--square: must be a length above 0 mm, not 0"),
        (
            lambda: boards.make_chessboard(9, 6, float("nan")),
            "--square: must be a length above 0 mm, not nan",
        ),
        (
            lambda: boards.make_charuco(7, 5, 25, 25),
            "--marker: markers of 25 mm do not fit into squares of 25 mm",
        ),
        (
            lambda: boards.make_charuco(7, 5, 25, -3),
            "--marker: must be a length above 0 mm, not -3",
        ),
        (
            lambda: boards.make_charuco(7, 5, 25, 18, "9X9"),
            "--dictionary: there is no '9X9'; give one of 4X4_100,",
        ),
        (
            lambda: boards.make_charuco(20, 20, 25, 18),
            "4X4_50 has 50 markers, a board of 20x20 needs 200",
        ),
        (lambda: boards.make_charuco(2, 5, 25, 18), "--board: 2x5 squares cannot be used"),
    ],
)
def test_an_impossible_board_is_refused(make: object, message: str) -> None:
    assert callable(make)
    with pytest.raises(JobError) as caught:
        make()
    assert message in str(caught.value)
