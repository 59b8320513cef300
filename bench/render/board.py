"""Sheets of ArUco markers and chessboards, as layers for the renderer."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import cv2
import numpy as np

from bench.render.scene import Layer
from bench.render.shapes import Loop, box

PAPER, INK = 0.86, 0.05


def markers(
    page: tuple[float, float, float, float],
    ids: Sequence[int],
    corners: np.ndarray,
    dictionary: str,
    z: float = 0.0,
) -> tuple[Layer, Layer]:
    """Paper and ink of a sheet of markers.

    page: rectangle of the paper (x and y from, x and y to), mm.
    corners: (N, 4, 2) upper left, upper right, lower right, lower left of each marker, mm.
    dictionary: OpenCV's name, for instance "4X4_50".
    """
    known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{dictionary}"))
    side = known.markerSize + 2
    ink: list[Loop] = []
    for number, square in zip(ids, corners[..., 0] + 1j * corners[..., 1], strict=True):
        upper_left, right, down = square[0], square[1] - square[0], square[3] - square[0]
        black = cv2.aruco.generateImageMarker(known, int(number), side) < 128
        for row, line in enumerate(black):
            # One rectangle for modules side by side.
            edges = np.flatnonzero(np.diff(np.concatenate([[0], line, [0]]))).reshape(-1, 2)
            for begin, end in edges.tolist():
                x = np.array([begin, end, end, begin]) / side
                y = np.array([row + 1, row + 1, row, row]) / side
                ink.append(Loop(upper_left + x * right + y * down, np.zeros(4)))
    return Layer((box(*page),), PAPER, z=z), Layer(tuple(ink), INK, z=z)


def chessboard(columns: int, rows: int, square: float) -> tuple[tuple[Layer, Layer], np.ndarray]:
    """Paper and ink of a board of ``columns`` x ``rows`` inner corners, and these (N,), mm.

    The origin is the lowest left inner corner. A rim of one square is white.
    """
    ink = []
    for i, j in product(range(-1, columns), range(-1, rows)):
        if (i + j) % 2 == 0:
            ink.append(box(i * square, j * square, (i + 1) * square, (j + 1) * square))
    paper = box(-2 * square, -2 * square, (columns + 1) * square, (rows + 1) * square)
    y, x = np.mgrid[:rows, :columns]
    return (Layer((paper,), PAPER), Layer(tuple(ink), INK)), ((x + 1j * y) * square).ravel()


def charuco(
    columns: int, rows: int, square: float, marker: float, dictionary: str
) -> tuple[Layer, Layer]:
    """Paper and ink of a ChArUco board of ``columns`` x ``rows`` squares; lengths in mm.

    The origin is the lower left corner of the squares. A rim of half a square is white.
    """
    known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{dictionary}"))
    board = cv2.aruco.CharucoBoard((columns, rows), square, marker, known)
    # OpenCV's y runs down from the upper left corner.
    flip = np.array([1.0, -1.0]), np.array([0.0, rows * square])
    corners = np.array(board.getObjPoints())[..., :2] * flip[0] + flip[1]
    rim = square / 2
    page = (-rim, -rim, columns * square + rim, rows * square + rim)
    paper, ink = markers(page, np.ravel(board.getIds()).tolist(), corners, dictionary)
    # The upper left square is black.
    black = [
        box(i * square, (rows - 1 - j) * square, (i + 1) * square, (rows - j) * square)
        for i, j in np.ndindex(columns, rows)
        if (i + j) % 2 == 0
    ]
    return paper, Layer((*black, *ink.loops), INK)
