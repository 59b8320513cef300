"""Photos of calibration boards with known truth, for the tests and for bench/photo/calibrate.py.

cv2.projectPoints gives the positions of the corners. The photo is made in the opposite direction:
cv2.undistortPoints, with many iterations, traces each pixel back to the board. A pixel near an edge
is sampled in 89 places, any other pixel in its middle. Blur and noise follow.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import cv2
import numpy as np

from camgen.vision.camera.camera import Camera

INK, PAPER, BENCH = 30.0, 220.0, 120.0
#: Number of samples in a pixel near an edge, and step of their Fibonacci lattice. No edge is
#: parallel to a row of this lattice.
_FINE, _STEP = 89, 55
#: Grey values of positions x (N,) and y (N,) on a board, mm.
Drawing = Callable[[np.ndarray, np.ndarray], np.ndarray]


class View(NamedTuple):
    """A photo, and the corners (N, 2) of the board in it, px."""

    pixels: np.ndarray
    corners: np.ndarray


def chess(columns: int, rows: int, square: float) -> tuple[Drawing, np.ndarray]:
    """A board of `columns` x `rows` inner corners with a white rim.

    Returns its drawing, and its corners (N, 2), mm, row by row.
    """

    def draw(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        i, j = np.floor(x / square + 1), np.floor(y / square + 1)
        inside = (i >= 0) & (i <= columns) & (j >= 0) & (j <= rows)
        rim = (
            (x > -2 * square)
            & (x < (columns + 1) * square)
            & (y > -2 * square)
            & (y < (rows + 1) * square)
        )
        return np.where(inside & ((i + j) % 2 == 0), INK, np.where(rim, PAPER, BENCH))

    v, u = np.mgrid[:rows, :columns]
    return draw, np.column_stack([u.ravel(), v.ravel()]) * square


def charuco(
    columns: int, rows: int, square: float, marker: float, dictionary: int
) -> tuple[Drawing, np.ndarray]:
    """A ChArUco board of `columns` x `rows` squares as OpenCV draws it.

    Returns its drawing, and its corners (N, 2), mm, by number.
    """
    board = cv2.aruco.CharucoBoard(
        (columns, rows), square, marker, cv2.aruco.getPredefinedDictionary(dictionary)
    )
    # At 60 px per square the edges are on whole pixels: the modules of a marker divide 60 px if its
    # side is 0.8 or 0.7 of the square.
    dots = 60
    picture = board.generateImage((columns * dots, rows * dots), marginSize=0)

    def draw(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        u, v = np.floor(x / square * dots).astype(int), np.floor(y / square * dots).astype(int)
        inside = (u >= 0) & (u < columns * dots) & (v >= 0) & (v < rows * dots)
        dark = picture[v.clip(0, rows * dots - 1), u.clip(0, columns * dots - 1)] < 128
        rim = (
            (x > -square) & (x < (columns + 1) * square) & (y > -square) & (y < (rows + 1) * square)
        )
        return np.where(inside & dark, INK, np.where(inside | rim, PAPER, BENCH))

    return draw, np.asarray(board.getChessboardCorners())[:, :2].astype(float)


def poses(
    camera: Camera,
    size: tuple[float, float],
    count: int,
    seed: int = 0,
    tilt: float = 35,
    fill: float = 0.6,
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Poses of boards in all places of the photo, each a rotation vector and a translation (mm).

    size: width and height of the board, mm.
    tilt: largest tilt, deg.
    fill: fraction of the width or the height of the photo that a board covers.
    """
    rng = np.random.default_rng(seed)
    board_poses = []
    focal, (width, height) = camera.matrix[0, 0], camera.size
    while len(board_poses) < count:
        azimuth, tilt_angle = rng.uniform(0, 2 * np.pi), np.radians(rng.uniform(0.3, 1) * tilt)
        turn = cv2.Rodrigues(np.array([0, 0, rng.uniform(-0.4, 0.4)]))[0]
        rotation = (
            cv2.Rodrigues(tilt_angle * np.array([np.cos(azimuth), np.sin(azimuth), 0]))[0] @ turn
        )
        distance = focal * max(size[0] / width, size[1] / height) / (fill * rng.uniform(0.8, 1.1))
        offset = (
            np.array([rng.uniform(-1, 1) * width, rng.uniform(-1, 1) * height])
            * 0.5
            * (1 - 0.9 * fill)
        )
        centre = np.array([*(offset * distance / focal), distance])
        board_poses.append(
            (
                cv2.Rodrigues(rotation)[0],
                centre - rotation @ np.array([size[0] / 2, size[1] / 2, 0]),
            )
        )
        if not _in_photo(camera, board_poses[-1], size):
            board_poses.pop()
    return board_poses


def _in_photo(
    camera: Camera, pose: tuple[np.ndarray, np.ndarray], size: tuple[float, float]
) -> bool:
    outline = np.array([(0, 0), (size[0], 0), size, (0, size[1])], dtype=float)
    px = projected(camera, pose, outline)
    return bool(np.all((px > 5) & (px < np.array(camera.size) - 6)))


def projected(camera: Camera, pose: tuple[np.ndarray, np.ndarray], mm: np.ndarray) -> np.ndarray:
    """The positions (N, 2), px, of points (N, 2) of the board, mm."""
    points = np.column_stack([mm, np.zeros(len(mm))])
    return cv2.projectPoints(points, *pose, camera.matrix, camera.distortion)[0].reshape(-1, 2)


def photo(
    camera: Camera,
    board: tuple[Drawing, np.ndarray],
    pose: tuple[np.ndarray, np.ndarray],
    *,
    blur: float = 0.7,
    noise: float = 2.0,
    seed: int = 0,
    shading: float = 0.0,
) -> View:
    """A photo of a board.

    blur: standard deviation, px.
    noise: standard deviation, grey values.
    shading: loss of light from the left to the right side, 0 to 1.
    """
    drawing, corners = board
    width, height = camera.size
    mm = _on_board(camera, pose)
    grey = drawing(mm[1:-1, 1:-1, 0], mm[1:-1, 1:-1, 1])
    bordered = cv2.copyMakeBorder(grey, 1, 1, 1, 1, cv2.BORDER_REPLICATE)
    flat = cv2.dilate(bordered, np.ones((3, 3))) == cv2.erode(bordered, np.ones((3, 3)))
    v, u = np.nonzero(~flat[1:-1, 1:-1])
    total = np.zeros(len(u))
    around = _expanded(mm, v + 1, u + 1)
    for i in range(_FINE):
        down, right = (i + 0.5) / _FINE - 0.5, (i * _STEP + 0.5) / _FINE % 1 - 0.5
        total += drawing(
            *np.tensordot([1, right, down, right**2, down**2, right * down], around, 1)
        )
    grey[v, u] = total / _FINE
    grey = cv2.GaussianBlur(grey, (0, 0), blur) if blur else grey
    grey = grey * (1 - shading * np.arange(width) / width)
    grey = grey + np.random.default_rng(seed).normal(0, noise, grey.shape)
    return View(
        np.rint(grey).clip(0, 255).astype(np.uint8).reshape(height, width),
        projected(camera, pose, corners),
    )


def _on_board(camera: Camera, pose: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """The position on the board of the middle of each pixel, mm, (H + 2, W + 2, 2).

    One pixel around the photo is included.
    """
    width, height = camera.size
    v, u = np.mgrid[-1 : height + 1, -1 : width + 1].astype(float)
    rounds = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 40, 1e-12)
    pixels = np.column_stack([u.ravel(), v.ravel()])[:, None]
    rays = cv2.undistortPoints(pixels, camera.matrix, camera.distortion, criteria=rounds).reshape(
        -1, 2
    )
    rotation, translation = cv2.Rodrigues(pose[0])[0], pose[1]
    back = np.linalg.inv(np.column_stack([rotation[:, :2], translation]))
    positions = rays @ back[:, :2].T + back[:, 2]
    return (positions[:, :2] / positions[:, 2:]).reshape(height + 2, width + 2, 2)


def _expanded(mm: np.ndarray, v: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Coefficients (6, 2, N) of the position on the board near pixels (N,), mm.

    The position is a polynomial in the steps r to the right and d down: its terms are 1, r, d, r^2,
    d^2 and r d. It is exact to 1e-4 px.
    """
    middle, above, below = mm[v, u], mm[v - 1, u], mm[v + 1, u]
    before, after = mm[v, u - 1], mm[v, u + 1]
    twisted = (mm[v + 1, u + 1] - mm[v - 1, u + 1] - mm[v + 1, u - 1] + mm[v - 1, u - 1]) / 4
    terms = [
        middle,
        (after - before) / 2,
        (below - above) / 2,
        (after - 2 * middle + before) / 2,
        (below - 2 * middle + above) / 2,
        twisted,
    ]
    return np.stack([term.T for term in terms])
