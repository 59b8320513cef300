"""`camgen calibrate` beside the methods of OpenCV.

    python -m bench.photo.calibrate [FOLDER, BOARD as 9x6] [PHOTOS, 8]

FOLDER holds photos of a board: each method finds the corners in all of them, and
cv2.calibrateCamera computes the camera. OpenCV's best is the method with the least error among
those that find the board in most photos. Corners of rendered boards, PHOTOS of each kind, are
compared with the truth. Exits with 1 if a goal is missed.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from bench.support.runner import SHARED, Cells, Missed, Scenario, find_files, run
from bench.support.timing import timed
from camgen.model.pose import frozen
from camgen.read.files import Files
from camgen.vision.boards.corners import find_board, make_chessboard
from camgen.vision.camera.calibrate import calibrate
from camgen.vision.camera.camera import Camera
from tests.support.board_photos import chess, photo, poses

SETS = {"opencv-left": (9, 6)}
#: Largest difference of the rms, px, and of focal lengths and principal point, of their value.
RMS_GOAL, PART_GOAL = 0.05, 0.005
CAMERA = Camera(
    matrix=frozen([[600, 0, 318], [0, 602, 243], [0, 0, 1]]),
    distortion=frozen([-0.28, 0.1, 0.001, -0.0007, 0.0]),
    size=(640, 480),
    name="rendered",
)
#: Options of the photos of a kind, and the share of the photo's width that the board takes.
KINDS: dict[str, tuple[dict[str, Any], float]] = {
    "blur 0.7 px, noise 2": ({}, 0.6),
    "board in a third of the photo": ({}, 0.35),
    "blur 2 px, noise 5": ({"blur": 2.0, "noise": 5.0}, 0.6),
    "light falls off by 70 %": ({"shading": 0.7}, 0.6),
}
#: Finds the corners of a board in a photo; None without one.
Method = Callable[[np.ndarray, tuple[int, int]], np.ndarray | None]
COLUMNS = (
    "method | photos | rms px {:.4f} | fx {:.2f} | fy {:.2f} | cx {:.2f} | cy {:.2f} | s {:.1f} "
    "| against OpenCV's best: rms px {:+.4f} | fx, fy, cx, cy off % {:.2f}"
)


def _find_by_window(grey: np.ndarray, board: tuple[int, int], *, window: int) -> np.ndarray | None:
    is_found, corners = cv2.findChessboardCorners(grey, board)
    until = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-4)
    if not is_found:
        return None
    return cv2.cornerSubPix(grey, corners, (window, window), (-1, -1), until)


def _find_by_sectors(grey: np.ndarray, board: tuple[int, int], *, flags: int) -> np.ndarray | None:
    cv2.setRNGSeed(0)
    is_found, corners = cv2.findChessboardCornersSB(grey, board, flags=flags)
    return corners if is_found else None


_ACCURATE = cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_EXHAUSTIVE
METHODS: dict[str, Method] = {
    **{f"cornerSubPix, window {w}": partial(_find_by_window, window=w) for w in (3, 5, 7, 11)},
    "findChessboardCornersSB": partial(_find_by_sectors, flags=0),
    "findChessboardCornersSB, accurate": partial(_find_by_sectors, flags=_ACCURATE),
}


def calibrate_by_opencv(
    greys: list[np.ndarray], board: tuple[int, int], method: Method
) -> tuple[int, float, np.ndarray]:
    """Photos used, rms, and fx, fy, cx, cy."""
    v, u = np.mgrid[: board[1], : board[0]]
    places = np.column_stack([u.ravel(), v.ravel(), np.zeros(u.size)]).astype(np.float32)
    corners = [each for grey in greys if (each := method(grey, board)) is not None]
    if len(corners) < 3:
        return len(corners), np.inf, np.full(4, np.nan)
    size = greys[0].shape[::-1]
    rms, matrix, *_ = cv2.calibrateCamera([places] * len(corners), corners, size, None, None)
    return len(corners), rms, matrix[[0, 1, 0, 1], [0, 1, 2, 2]]


def measure(folder: Path, board: tuple[int, int]) -> Iterator[Cells]:
    """The rows of a set of photos, camgen last."""
    paths = find_files(folder, (".jpg", ".jpeg", ".png", ".tif", ".bmp"))
    greys = [cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in paths]
    results = []
    for name, method in METHODS.items():
        result, seconds = timed(partial(calibrate_by_opencv, greys, board, method))
        count, rms, numbers = result
        results.append(result)
        yield name, count, rms, *numbers, seconds
    sources = [Files().read(path) for path in paths]
    chessboard = make_chessboard(*board, 25)
    ours, seconds = timed(lambda: calibrate(sources, chessboard, "own", lambda _: None))
    numbers = ours.camera.matrix[[0, 1, 0, 1], [0, 1, 2, 2]]
    most_photos = max(count for count, _, _ in results)
    best = min((each for each in results if each[0] == most_photos), key=lambda each: each[1])
    _, rms, best_numbers = best
    difference = ours.rms - rms
    error = float(np.abs(numbers / best_numbers - 1).max())
    is_met = difference <= RMS_GOAL and error <= PART_GOAL
    cell = 100 * error if is_met else Missed(f"{100 * error:.2f}")
    yield "**camgen**", len(ours.used), ours.rms, *numbers, seconds, difference, cell


def compare_corners(kind: str, count: int) -> Iterator[Cells]:
    """The rms of the corners' distance from the truth in rendered photos of a kind, px."""
    options, share = KINDS[kind]
    columns, rows = 9, 6
    chessboard = make_chessboard(columns, rows, 25)
    errors: dict[str, list[np.ndarray]] = {name: [] for name in (*METHODS, "camgen")}
    for k, pose in enumerate(poses(CAMERA, (200, 125), count, seed=7, fill=share)):
        view = photo(CAMERA, chess(columns, rows, 25), pose, seed=k, **options)
        board = find_board(view.pixels, chessboard)
        corners = {name: method(view.pixels, (columns, rows)) for name, method in METHODS.items()}
        corners["camgen"] = board and board.corners
        for name, places in corners.items():
            if places is not None and len(places) == len(view.corners):
                errors[name].append(_find_error(places.reshape(-1, 2), view.corners))
    cells = []
    for group in errors.values():
        lost = f" ({count - len(group)} not found)" if len(group) < count else ""
        text = "-"
        if group:
            text = f"{np.sqrt(np.mean(np.sum(np.concatenate(group) ** 2, axis=1))):.3f}"
        cells.append(f"{text}{lost}")
    yield kind, *cells


def _find_error(places: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """The errors of corners, which may be counted from either end."""
    errors = places - corners, places[::-1] - corners
    return min(errors, key=lambda error: float(np.abs(error).max()))


def main(words: list[str]) -> int:
    """Prints the tables; 1 if a goal is missed."""
    sets = {SHARED / "calib" / name: board for name, board in SETS.items()}
    if len(words) > 1:
        columns, rows = words[1].split("x")
        sets = {Path(words[0]): (int(columns), int(rows))}
    count = int(words[2]) if len(words) > 2 else 8
    title = f"Rendered boards of 9x6, 640 x 480 px, {count} photos each: rms of the corners, px"
    kinds = [(kind, count) for kind in KINDS]
    heads = f"photos | {' | '.join(METHODS)} | **camgen**"
    return run(
        Scenario(COLUMNS, sets.items(), measure), Scenario(heads, kinds, compare_corners, title)
    )


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
