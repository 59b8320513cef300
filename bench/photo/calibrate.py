"""`camgen calibrate` beside OpenCV's own ways.

    python -m bench.photo.calibrate [FOLDER, BOARD as 9x6] [PHOTOS, 8]

FOLDER holds photos of a board: each way finds the corners of all of them and cv2.calibrateCamera does the rest.
OpenCV's best is the way with the least error among those that find the board in the most photos. Rendered boards,
PHOTOS of each kind: the corners against the truth. Prints tables for docs/benchmarks.md and exits with 1 when a figure
misses its goal.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from bench.support.runner import SHARED, Table, find_files, machine, verdict
from bench.support.timing import timed
from camgen.model.pose import frozen
from camgen.read.files import Files
from camgen.vision.boards.corners import find_board, make_chessboard
from camgen.vision.camera.calibrate import calibrate
from camgen.vision.camera.camera import Camera
from tests.support.board_photos import chess, photo, poses

SETS = {"opencv-left": (9, 6)}
#: px; of the focal lengths and of the principal point, each of its own value.
RMS_GOAL, PART_GOAL = 0.05, 0.005
CAMERA = Camera(
    matrix=frozen([[600, 0, 318], [0, 602, 243], [0, 0, 1]]),
    distortion=frozen([-0.28, 0.1, 0.001, -0.0007, 0.0]),
    size=(640, 480),
    name="rendered",
)
#: Photos of one kind, and how much of the photo's width or height the board takes.
KINDS = {
    "blur 0.7 px, noise 2": ({}, 0.6),
    "board in a third of the photo": ({}, 0.35),
    "blur 2 px, noise 5": ({"blur": 2.0, "noise": 5.0}, 0.6),
    "light falls off by 70 %": ({"shading": 0.7}, 0.6),
}
Way = Callable[[np.ndarray, tuple[int, int]], np.ndarray | None]


def refined(window: int) -> Way:
    def way(grey: np.ndarray, board: tuple[int, int]) -> np.ndarray | None:
        found, corners = cv2.findChessboardCorners(grey, board)
        until = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-4)
        return cv2.cornerSubPix(grey, corners, (window, window), (-1, -1), until) if found else None

    return way


def sector_based(flags: int) -> Way:
    def way(grey: np.ndarray, board: tuple[int, int]) -> np.ndarray | None:
        cv2.setRNGSeed(0)
        found, corners = cv2.findChessboardCornersSB(grey, board, flags=flags)
        return corners if found else None

    return way


WAYS = {f"cornerSubPix, window {w}": refined(w) for w in (3, 5, 7, 11)} | {
    "findChessboardCornersSB": sector_based(0),
    "findChessboardCornersSB, accurate": sector_based(
        cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_EXHAUSTIVE
    ),
}


def by_opencv(
    greys: list[np.ndarray], board: tuple[int, int], way: Way
) -> tuple[int, float, np.ndarray]:
    """Photos used, rms, and fx, fy, cx, cy."""
    v, u = np.mgrid[: board[1], : board[0]]
    places = np.column_stack([u.ravel(), v.ravel(), np.zeros(u.size)]).astype(np.float32)
    found = [corners for grey in greys if (corners := way(grey, board)) is not None]
    if len(found) < 3:
        return len(found), np.inf, np.full(4, np.nan)
    rms, matrix, *_ = cv2.calibrateCamera(
        [places] * len(found), found, greys[0].shape[::-1], None, None
    )
    return len(found), rms, matrix[[0, 1, 0, 1], [0, 1, 2, 2]]


def judged(folder: Path, board: tuple[int, int]) -> bool:
    """Prints the table of one set; whether it meets the goals."""
    paths = find_files(folder, (".jpg", ".jpeg", ".png", ".tif", ".bmp"))
    greys = [cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in paths]
    print(f"\n{folder.name}, {len(paths)} photos, board {board[0]}x{board[1]}")
    table = Table(
        "way | photos | rms px {:.4f} | fx {:.2f} | fy {:.2f} | cx {:.2f} | cy {:.2f} | s {:.1f}"
    )
    results = []
    for name, way in WAYS.items():
        result, seconds = timed(partial(by_opencv, greys, board, way))
        photos, rms, numbers = result
        results.append(result)
        table.add(name, photos, rms, *numbers, seconds)
    own, seconds = timed(
        lambda: calibrate(
            [Files().read(path) for path in paths],
            make_chessboard(*board, 25),
            "own",
            lambda _: None,
        )
    )
    numbers = own.camera.matrix[[0, 1, 0, 1], [0, 1, 2, 2]]
    table.add("**camgen**", len(own.used), own.rms, *numbers, seconds)
    most = max(count for count, _, _ in results)
    _, rms, best = min((one for one in results if one[0] == most), key=lambda one: one[1])
    part = np.abs(numbers / best - 1)
    good = own.rms - rms <= RMS_GOAL and part.max() <= PART_GOAL
    print(
        f"\nAgainst OpenCV's best: rms {own.rms - rms:+.4f} px; fx, fy, cx, cy off by "
        f"{', '.join(f'{100 * p:.2f} %' for p in part)}: {verdict(good)}"
    )
    return good


def rendered(count: int) -> None:
    """The corners against the truth, rms of the distance in px."""
    columns, rows = 9, 6
    print(
        f"\nRendered boards of 9x6, 640 x 480 px, {count} photos each: rms of the corners' distance "
        "from the truth, px"
    )
    table = Table(f"photos | {' | '.join(WAYS)} | **camgen**")
    for kind, (options, fill) in KINDS.items():
        errors: dict[str, list[np.ndarray]] = {name: [] for name in (*WAYS, "camgen")}
        for i, pose in enumerate(poses(CAMERA, (200, 125), count, seed=7, fill=fill)):
            view = photo(CAMERA, chess(columns, rows, 25), pose, seed=i, **options)
            own = find_board(view.pixels, make_chessboard(columns, rows, 25))
            found = {name: way(view.pixels, (columns, rows)) for name, way in WAYS.items()}
            for name, corners in (found | {"camgen": own and own.corners}).items():
                if corners is not None and len(corners) == len(view.corners):
                    at = corners.reshape(-1, 2)
                    off = min(
                        (at - view.corners, at[::-1] - view.corners),
                        key=lambda e: float(np.abs(e).max()),
                    )
                    errors[name].append(off)
        cells = []
        for off in errors.values():
            lost = f" ({count - len(off)} not found)" if len(off) < count else ""
            rms = np.sqrt(np.mean(np.sum(np.concatenate(off) ** 2, axis=1))) if off else None
            cells.append(f"-{lost}" if rms is None else f"{rms:.3f}{lost}")
        table.add(kind, *cells)


def main() -> int:
    sets = {SHARED / "calib" / name: board for name, board in SETS.items()}
    if len(sys.argv) > 2:
        columns, rows = sys.argv[2].split("x")
        sets = {Path(sys.argv[1]): (int(columns), int(rows))}
    print(machine())
    good = [judged(path, board) for path, board in sets.items()]
    rendered(int(sys.argv[3]) if len(sys.argv) > 3 else 8)
    return 0 if all(good) else 1


if __name__ == "__main__":
    sys.exit(main())
