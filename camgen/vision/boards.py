"""Calibration boards and their corners in a photo: chessboards, and ChArUco boards of which a part may be hidden.

OpenCV finds the board in a reduced picture; the corners are then fitted in the full one (saddle.py). A corner counts
when it is as black and white as the others, and dark in those quadrants in which its place on the board says so; a grid
that OpenCV has laid wrongly does not pass.

The first corner of a chessboard is, where its colours tell one end from the other (one of columns and rows odd, the
other even), the one whose inner square is black. So a corner has the same number in all photos.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.errors import JobError
from camgen.pose import FloatArray, frozen
from camgen.text import short
from camgen.vision.homography import depth, fitted, in_line, scales
from camgen.vision.image import Pixels
from camgen.vision.saddle import fitted_saddles
from camgen.vision.sheet import DICTIONARY, Board

if TYPE_CHECKING:
    import cv2

#: Boards are sought in a picture of at most so many pixels, then in the full one.
_SOUGHT = 2_500_000
#: The window of a corner reaches so far to the next edge; near the markers of ChArUco so many px less, for blur.
_ROOM, _BLUR = 0.5, 1.0
#: A corner counts with this part of the middle contrast or more. Its misfit as a part of its contrast may be so many
#: times the middle one, between the two limits: something lies on a corner that fits much worse than the others.
_FAINT, _WORSE, _ALWAYS, _NEVER = 0.3, 3.0, 0.1, 0.4
#: The grid is right if this part of its corners counts. So many are needed where a board may be partly hidden.
_RIGHT, _LEAST = 0.75, 6
_MOST_CORNERS = 100


class Chessboard(Struct, frozen=True):
    """A chessboard of ``columns`` x ``rows`` inner corners and squares of ``square`` mm."""

    columns: int
    rows: int
    square: float

    @property
    def label(self) -> str:
        """How messages call it."""
        return f"chessboard {self.columns}x{self.rows}"


Target = Chessboard | Board


class Seen(Struct, frozen=True, eq=False):
    """A board in a photo. corners: (N, 2) px; places: (N, 2) mm on the board; of: how many corners the board has."""

    corners: FloatArray
    places: FloatArray
    of: int


class _Rough(Struct, frozen=True, eq=False):
    """What OpenCV found: corners (N, 2) px and their numbers (N,), row by row."""

    corners: FloatArray
    numbers: NDArray[np.int64]


def chessboard(columns: int, rows: int, square: float) -> Chessboard:
    """The chessboard with so many inner corners. JobError for fewer than 3 x 3, or a square that is no length."""
    if not (3 <= columns <= _MOST_CORNERS and 3 <= rows <= _MOST_CORNERS):
        remedy = "give the inner corners, one fewer than squares each way; 3x3 at least"
        raise JobError("--board", f"{columns}x{rows} inner corners cannot be found", remedy=remedy)
    _is_length("--square", square)
    return Chessboard(columns, rows, float(square))


def charuco(columns: int, rows: int, square: float, marker: float, dictionary: str = DICTIONARY) -> Board:
    """The ChArUco board of ``columns`` x ``rows`` squares. JobError for what cannot be, with the names that can."""
    if not (3 <= columns <= _MOST_CORNERS and 3 <= rows <= _MOST_CORNERS):
        remedy = "give the number of squares each way; 3x3 at least"
        raise JobError("--board", f"{columns}x{rows} squares cannot be used", remedy=remedy)
    _is_length("--square", square)
    _is_length("--marker", marker)
    if marker >= square:
        what = f"markers of {short(marker, 3)} mm do not fit into squares of {short(square, 3)} mm"
        raise JobError("--marker", what, remedy="measure both on the board, in mm")
    board = Board(columns, rows, float(square), float(marker), dictionary)
    held = len(_dictionary(board).bytesList)
    if held < columns * rows // 2:
        what = f"{dictionary} has {held} markers, a board of {columns}x{rows} needs {columns * rows // 2}"
        raise JobError("--dictionary", what, remedy="give the one that the board was made with")
    return board


def seen(pixels: Pixels, target: Target) -> Seen | None:
    """The board in a photo, (H, W) grey or (H, W, 3) blue, green, red; None if it is not there."""
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    grey = pixels if pixels.ndim == 2 else cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY).astype(np.uint8, copy=False)
    reduction = math.ceil(math.sqrt(grey.size / _SOUGHT))
    for factor in (reduction, 1)[: 1 + (reduction > 1)]:
        for rough in _sought(grey, factor, target):
            found = _measured(grey, rough, target)
            if found is not None:
                return found
    return None


def _sought(grey: Pixels, factor: int, target: Target) -> Iterator[_Rough]:
    """What may be the board in the picture reduced by ``factor``; px of the full one."""
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    height, width = grey.shape
    size = (width // factor, height // factor)
    small = grey if factor == 1 else cv2.resize(grey, size, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)
    found = _chess(small, target, factor > 1) if isinstance(target, Chessboard) else _charuco(small, target)
    for rough in found:
        yield _Rough((rough.corners + 0.5) * (np.array([width, height]) / size) - 0.5, rough.numbers)


def _chess(grey: Pixels, target: Chessboard, reduced: bool) -> Iterator[_Rough]:
    """The older detector finds boards that lie flat in the photo, the newer one blurred ones: one misses what the other
    finds. The older one may take seconds on large pictures without a board, so there only the newer one is asked.
    """
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    size = (target.columns, target.rows)
    numbers = np.arange(target.columns * target.rows)
    if reduced or grey.size <= _SOUGHT:
        flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
        found, corners = cv2.findChessboardCorners(grey, size, flags=flags)
        if found:
            yield _Rough(np.asarray(corners, dtype=np.float64).reshape(-1, 2), numbers)
    cv2.setRNGSeed(0)  # its search of neighbours is a random one
    flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE
    found, corners = cv2.findChessboardCornersSB(grey, size, flags=flags)
    if found:
        yield _Rough(np.asarray(corners, dtype=np.float64).reshape(-1, 2), numbers)


def _charuco(grey: Pixels, target: Board) -> Iterator[_Rough]:
    """As OpenCV draws boards now, and as it drew those with an even number of rows before version 4.6."""
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    drawn = cv2.aruco.CharucoBoard((target.columns, target.rows), target.square, target.marker, _dictionary(target))
    for legacy in (False, True)[: 1 + (target.rows % 2 == 0)]:
        drawn.setLegacyPattern(legacy)
        corners, numbers, _, _ = cv2.aruco.CharucoDetector(drawn).detectBoard(grey)
        if numbers is not None and len(numbers) >= _LEAST:
            which = np.asarray(numbers).ravel().astype(np.int64)
            yield _Rough(np.asarray(corners, dtype=np.float64).reshape(-1, 2), which)


def _measured(grey: Pixels, rough: _Rough, target: Target) -> Seen | None:
    """The corners as fitted; None if too few of them are corners of such a board."""
    columns, rows = _corners_of(target)
    row, column = np.divmod(rough.numbers, columns)
    places = np.column_stack([column, row]) * target.square
    if in_line(places) is not None or in_line(rough.corners) is not None:
        return None
    homography = fitted(places, rough.corners)
    if depth(homography, places).min() <= 0:
        return None
    radius = _free(target) * scales(homography, places)[:, 0] - (0 if isinstance(target, Chessboard) else _BLUR)
    saddles = fitted_saddles(grey, rough.corners, _axes(homography, places), radius)
    contrast = saddles.contrast * np.where((row + column) % 2, -1, 1)
    sign = np.sign(np.median(contrast))
    contrast = contrast * sign
    clear = contrast > _FAINT * np.median(contrast)
    if not clear.any():
        return None
    limit = float(np.median(saddles.misfit[clear] / contrast[clear]) * _WORSE)
    good = clear & (saddles.misfit < min(max(limit, _ALWAYS), _NEVER) * contrast)
    if good.sum() < max(_LEAST, _RIGHT * len(good)) or in_line(places[good]) is not None:
        return None
    corners, places = saddles.corners[good], places[good]
    if isinstance(target, Chessboard) and (columns + rows) % 2 and sign < 0:
        corners, places = corners[::-1], (np.array([columns - 1, rows - 1]) * target.square - places)[::-1]
    return Seen(frozen(corners), frozen(places), columns * rows)


def _corners_of(target: Target) -> tuple[int, int]:
    """Inner corners in a row, and rows of them."""
    inner = 0 if isinstance(target, Chessboard) else 1
    return target.columns - inner, target.rows - inner


def _free(target: Target) -> float:
    """How far around a corner there is nothing but its two edges, mm: markers of ChArUco lie diagonally from it."""
    if isinstance(target, Chessboard):
        return _ROOM * target.square
    return min(_ROOM * target.square, (target.square - target.marker) / math.sqrt(2))


def _axes(homography: FloatArray, places: FloatArray) -> FloatArray:
    """Directions of the board's x and y in the photo at each place, (N, 2, 2), as columns; of any length."""
    divisor = depth(homography, places)[:, None, None]
    at = places @ homography[:2, :2].T + homography[:2, 2]
    axes: FloatArray = homography[None, :2, :2] - at[:, :, None] * homography[None, 2:, :2] / divisor
    return axes


def _dictionary(board: Board) -> cv2.aruco.Dictionary:
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    number = getattr(cv2.aruco, f"DICT_{board.dictionary.upper()}", None)
    if number is None:
        names = [name.removeprefix("DICT_") for name in dir(cv2.aruco) if name.startswith("DICT_")]
        remedy = f"give one of {', '.join(names)}"
        raise JobError("--dictionary", f"there is no {board.dictionary!r}", remedy=remedy)
    return cv2.aruco.getPredefinedDictionary(number)


def _is_length(option: str, value: float) -> None:
    if not (math.isfinite(value) and value > 0):
        raise JobError(option, f"{value} is no length in mm", remedy="measure it on the printed board")
