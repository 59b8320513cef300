"""Calibration boards and their corners in a photo: chessboards, and ChArUco boards of which a part may be hidden.

OpenCV finds the board in a reduced picture; the corners are then fitted in the full one (``fit_saddles``). A corner
counts when it is as black and white as the others, and dark in those quadrants in which its place on the board says
so; a grid that OpenCV has laid wrongly does not pass.

The first corner of a chessboard is, where its colours tell one end from the other (one of columns and rows odd, the
other even), the one whose inner square is black. So a corner has the same number in all photos.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.model.errors import JobError
from camgen.model.pose import FloatArray, frozen
from camgen.model.text import short
from camgen.vision.boards.sheet import DICTIONARY, Board
from camgen.vision.image import Pixels
from camgen.vision.plane import depth, fit_homography, in_line, scales

if TYPE_CHECKING:
    import cv2


# Corners of a chessboard to a hundredth of a pixel: a saddle fitted to the grey values around each.

#: Rounds of the fit, and twice over: the second time the window lies around what the first one found.
_ROUNDS, _PASSES = 30, 2
_SETTLED = 1e-4
#: Radius of the window, px: as small as can hold nine unknowns, and where more pixels gain nothing.
_LEAST_SADDLE, _MOST_WINDOW = 2.5, 12.0
_DAMPING = 1e-3
_U, _V, _FIRST, _SECOND, _CONTRAST, _MEAN, _SLOPE_U, _SLOPE_V, _BLUR_SADDLE = range(9)


class Saddles(Struct, frozen=True, eq=False):
    """corners (N, 2) px; contrast (N,): the grey value's a, its sign says which quadrants are dark; misfit (N,): rms of
    what the fit leaves, grey values. A corner that ran away, or lies at the photo's border, has contrast 0.
    """

    corners: FloatArray
    contrast: FloatArray
    misfit: FloatArray


class _Windows(Struct, frozen=True, eq=False):
    """Places (N, P) px from each start, grey values and weights there."""

    x: FloatArray
    y: FloatArray
    grey: FloatArray
    weight: FloatArray


def fit_saddles(grey: Pixels, near: FloatArray, axes: FloatArray, radius: FloatArray) -> Saddles:
    """The corners next to ``near`` (N, 2) px, at most their radius (N,) px away.

    axes: (N, 2, 2), the columns are the directions of the two edges in the photo. radius: of the round window in which
    no other edge may be.
    """
    radius = radius.clip(_LEAST_SADDLE, _MOST_WINDOW)
    start = np.zeros((len(near), 9))
    # The normals of the two edges.
    start[:, _FIRST] = np.arctan2(axes[:, 0, 0], -axes[:, 1, 0])
    start[:, _SECOND] = np.arctan2(axes[:, 0, 1], -axes[:, 1, 1])
    start[:, _BLUR_SADDLE] = np.log(radius / 4)
    corners, found = near, start
    kept, misfit = np.ones(len(near), dtype=np.bool_), np.zeros(len(near))
    for _ in range(_PASSES):
        windows = _cut_out(grey, corners, radius)
        found = _with_contrast(windows, found)
        found, misfit = _fit(windows, found)
        kept = (
            kept
            & np.isfinite(found).all(axis=1)
            & (np.hypot(*(corners + found[:, :2] - near).T) < radius)
        )
        found = np.where(kept[:, None], found, start)
        corners = np.where(kept[:, None], corners + found[:, :2], near)
        found[:, :2] = 0
    margin = np.minimum(corners, np.array(grey.shape[::-1]) - 1 - corners).min(axis=1)
    usable = kept & (margin >= _LEAST_SADDLE)
    contrast = np.where(usable, found[:, _CONTRAST], 0)
    return Saddles(frozen(corners), frozen(contrast), frozen(misfit))


def _cut_out(grey: Pixels, corners: FloatArray, radius: FloatArray) -> _Windows:
    reach = int(np.ceil(radius.max()))
    down, right = (o.ravel() for o in np.mgrid[-reach : reach + 1, -reach : reach + 1])
    whole = np.rint(corners).astype(np.int64)
    u, v = whole[:, :1] + right, whole[:, 1:] + down
    height, width = grey.shape
    inside = (u >= 0) & (v >= 0) & (u < width) & (v < height)
    x, y = u - corners[:, :1], v - corners[:, 1:]
    weight = inside * (radius[:, None] + 0.5 - np.hypot(x, y)).clip(0, 1)
    return _Windows(
        x, y, grey[v.clip(0, height - 1), u.clip(0, width - 1)].astype(np.float64), weight
    )


def _with_contrast(windows: _Windows, found: FloatArray) -> FloatArray:
    """Contrast and mean that fit the rest of ``found`` best: a line through grey values over tanh tanh."""
    unit = found.copy()
    unit[:, _CONTRAST], unit[:, _MEAN], unit[:, _SLOPE_U : _SLOPE_V + 1] = 1, 0, 0
    shape = _model(windows, unit)[0]
    total = windows.weight.sum(axis=1)

    def mean(values: FloatArray) -> FloatArray:
        found: FloatArray = (windows.weight * values).sum(axis=1) / total
        return found

    s, g = mean(shape), mean(windows.grey)
    spread = mean((shape - s[:, None]) ** 2)
    unit[:, _CONTRAST] = mean((shape - s[:, None]) * windows.grey) / np.maximum(spread, 1e-12)
    unit[:, _MEAN] = g - unit[:, _CONTRAST] * s
    return unit


def _fit(windows: _Windows, found: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Levenberg-Marquardt, for each corner its own damping; the numbers (N, 9) and the rms misfit (N,)."""
    damping = np.full(len(found), _DAMPING)
    values, slopes = _model(windows, found)
    error = windows.grey - values
    cost = (windows.weight * error**2).sum(axis=1)
    for _ in range(_ROUNDS):
        weighted = slopes * windows.weight[..., None]
        normal = np.swapaxes(weighted, 1, 2) @ slopes
        right = (np.swapaxes(weighted, 1, 2) @ error[..., None])[..., 0]
        size = np.diagonal(normal, axis1=1, axis2=2)
        normal = normal + (damping[:, None] * size + 1e-9)[..., None] * np.eye(9)
        tried = found + np.linalg.solve(normal, right[..., None])[..., 0]
        tried_values, tried_slopes = _model(windows, tried)
        tried_error = windows.grey - tried_values
        tried_cost = (windows.weight * tried_error**2).sum(axis=1)
        better = tried_cost <= cost
        step = np.abs(tried - found)[better][:, :2].max(initial=0.0)
        found, cost = _model_saddle(better, tried, found), _model_saddle(better, tried_cost, cost)
        error, slopes = (
            _model_saddle(better, tried_error, error),
            _model_saddle(better, tried_slopes, slopes),
        )
        damping = np.where(better, damping / 5, damping * 8)
        if step < _SETTLED and (better | (damping > 1e3)).all():
            break
    return found, np.sqrt(cost / windows.weight.sum(axis=1))


def _model_saddle(which: NDArray[np.bool_], yes: FloatArray, no: FloatArray) -> FloatArray:
    return np.where(which.reshape(-1, *[1] * (yes.ndim - 1)), yes, no)


def _model(windows: _Windows, numbers: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Grey values (N, P) and their derivatives by the nine numbers (N, P, 9)."""
    u, v, first, second, contrast, mean, slope_u, slope_v, blur = numbers.T[..., None]
    x, y = windows.x - u, windows.y - v
    c1, s1, c2, s2 = np.cos(first), np.sin(first), np.cos(second), np.sin(second)
    sharp = np.exp(-blur.clip(-3, 6))
    d1, d2 = (c1 * x + s1 * y) * sharp, (c2 * x + s2 * y) * sharp
    a, b = np.tanh(d1), np.tanh(d2)
    light = 1 + slope_u * windows.x + slope_v * windows.y
    board = contrast * a * b + mean
    by_d1, by_d2 = light * contrast * b * (1 - a * a), light * contrast * a * (1 - b * b)
    slopes = np.stack(
        [
            -sharp * (by_d1 * c1 + by_d2 * c2),
            -sharp * (by_d1 * s1 + by_d2 * s2),
            by_d1 * sharp * (c1 * y - s1 * x),
            by_d2 * sharp * (c2 * y - s2 * x),
            light * a * b,
            light,
            windows.x * board,
            windows.y * board,
            -(by_d1 * d1 + by_d2 * d2),
        ],
        axis=2,
    )
    return light * board, slopes


#: Boards are sought in a picture of at most so many pixels, then in the full one.
_SOUGHT = 2_500_000
#: The window of a corner reaches so far to the next edge; near the markers of ChArUco so many px less, for blur.
_ROOM_SHARE, _BLUR = 0.5, 1.0
#: A corner counts with this part of the middle contrast or more. Its misfit as a part of its contrast may be so many
#: times the middle one, between the two limits: something lies on a corner that fits much worse than the others.
_FAINT, _WORSE, _ALWAYS, _NEVER = 0.3, 3.0, 0.1, 0.4
#: The grid is right if this part of its corners counts. So many are needed where a board may be partly hidden.
_RIGHT_SHARE, _LEAST_CORNERS = 0.75, 6
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


class SeenBoard(Struct, frozen=True, eq=False):
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


def charuco(
    columns: int, rows: int, square: float, marker: float, dictionary: str = DICTIONARY
) -> Board:
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


def find_board(pixels: Pixels, target: Target) -> SeenBoard | None:
    """The board in a photo, (H, W) grey or (H, W, 3) blue, green, red; None if it is not there."""
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    grey = (
        pixels
        if pixels.ndim == 2
        else cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY).astype(np.uint8, copy=False)
    )
    reduction = math.ceil(math.sqrt(grey.size / _SOUGHT))
    for factor in (reduction, 1)[: 1 + (reduction > 1)]:
        for rough in _seek(grey, factor, target):
            found = _measure(grey, rough, target)
            if found is not None:
                return found
    return None


def _seek(grey: Pixels, factor: int, target: Target) -> Iterator[_Rough]:
    """What may be the board in the picture reduced by ``factor``; px of the full one."""
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    height, width = grey.shape
    size = (width // factor, height // factor)
    small = (
        grey
        if factor == 1
        else cv2.resize(grey, size, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)
    )
    found = (
        _chess(small, target, factor > 1)
        if isinstance(target, Chessboard)
        else _charuco(small, target)
    )
    for rough in found:
        yield _Rough(
            (rough.corners + 0.5) * (np.array([width, height]) / size) - 0.5, rough.numbers
        )


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
    for pattern in patterns(grey, target):
        if len(pattern.numbers) >= _LEAST_CORNERS:
            yield _Rough(pattern.corners, pattern.numbers)


class Pattern(Struct, frozen=True, eq=False):
    """A ChArUco board as a picture shows it in one of its two patterns.

    corners: (N, 2), the inner corners, px.
    numbers: (N,), the numbers of the corners, row by row from above.
    markers: (M,), the numbers of all markers of the board's dictionary in the picture.
    marker_corners: (M, 4, 2), their corners by OpenCV, px, clockwise from the upper left one.
    legacy: whether it is the pattern before OpenCV 4.6.
    """

    corners: FloatArray
    numbers: NDArray[np.int64]
    markers: NDArray[np.int64]
    marker_corners: FloatArray
    legacy: bool


def has_two_patterns(board: Board) -> bool:
    """Whether OpenCV 4.6 changed the pattern. It did not for an odd number of rows."""
    return board.rows % 2 == 0


def patterns(grey: Pixels, board: Board) -> Iterator[Pattern]:
    """The board in each of its patterns, the newer one first.

    A pattern that is not in the picture has few corners.
    """
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    drawn = cv2.aruco.CharucoBoard(
        (board.columns, board.rows), board.square, board.marker, _dictionary(board)
    )
    for legacy in (False, True)[: 1 + has_two_patterns(board)]:
        drawn.setLegacyPattern(legacy)
        detector = cv2.aruco.CharucoDetector(drawn)
        corners_px, ids, marker_px, marker_ids = detector.detectBoard(grey)
        numbers = np.asarray(() if ids is None else ids).ravel().astype(np.int64)
        corners = np.asarray(() if ids is None else corners_px, dtype=np.float64).reshape(-1, 2)
        markers = np.asarray(() if marker_ids is None else marker_ids).ravel().astype(np.int64)
        squares = np.asarray(marker_px or (), dtype=np.float64).reshape(-1, 4, 2)
        yield Pattern(corners, numbers, markers, squares, legacy)


def place_markers(board: Board, legacy: bool) -> dict[int, FloatArray]:
    """The middle (2,) of each marker of a board by its number, mm in the board's work frame."""
    first = int(not (legacy and has_two_patterns(board)))
    squares = itertools.product(range(board.rows), range(board.columns))
    marked = [(column, row) for row, column in squares if (column + row) % 2 == first]
    middles = (np.array(marked) + 0.5) * (1, -1) + (0, board.rows)
    return dict(enumerate(board.square * middles))


def refine_corners(
    grey: Pixels, pattern: Pattern, board: Board
) -> tuple[FloatArray, NDArray[np.int64]]:
    """The inner corners (N, 2) of a board as fitted, px, and their numbers (N,).

    Those of OpenCV if too few of them are corners of such a board.
    """
    rough = _Rough(pattern.corners, pattern.numbers)
    fitted = _measure(grey, rough, board) if len(rough.numbers) >= _LEAST_CORNERS else None
    if fitted is None:
        return pattern.corners, pattern.numbers
    column, row = np.rint(fitted.places / board.square).astype(np.int64).T
    return fitted.corners, row * (board.columns - 1) + column


def _measure(grey: Pixels, rough: _Rough, target: Target) -> SeenBoard | None:
    """The corners as fitted; None if too few of them are corners of such a board."""
    columns, rows = _corners_of(target)
    row, column = np.divmod(rough.numbers, columns)
    places = np.column_stack([column, row]) * target.square
    if in_line(places) is not None or in_line(rough.corners) is not None:
        return None
    homography = fit_homography(places, rough.corners)
    if depth(homography, places).min() <= 0:
        return None
    radius = _free(target) * scales(homography, places)[:, 0] - (
        0 if isinstance(target, Chessboard) else _BLUR
    )
    saddles = fit_saddles(grey, rough.corners, _axes(homography, places), radius)
    contrast = saddles.contrast * np.where((row + column) % 2, -1, 1)
    sign = np.sign(np.median(contrast))
    contrast = contrast * sign
    clear = contrast > _FAINT * np.median(contrast)
    if not clear.any():
        return None
    limit = float(np.median(saddles.misfit[clear] / contrast[clear]) * _WORSE)
    good = clear & (saddles.misfit < min(max(limit, _ALWAYS), _NEVER) * contrast)
    if (
        good.sum() < max(_LEAST_CORNERS, _RIGHT_SHARE * len(good))
        or in_line(places[good]) is not None
    ):
        return None
    corners, places = saddles.corners[good], places[good]
    if isinstance(target, Chessboard) and (columns + rows) % 2 and sign < 0:
        corners, places = (
            corners[::-1],
            (np.array([columns - 1, rows - 1]) * target.square - places)[::-1],
        )
    return SeenBoard(frozen(corners), frozen(places), columns * rows)


def _corners_of(target: Target) -> tuple[int, int]:
    """Inner corners in a row, and rows of them."""
    inner = 0 if isinstance(target, Chessboard) else 1
    return target.columns - inner, target.rows - inner


def _free(target: Target) -> float:
    """How far around a corner there is nothing but its two edges, mm: markers of ChArUco lie diagonally from it."""
    if isinstance(target, Chessboard):
        return _ROOM_SHARE * target.square
    return min(_ROOM_SHARE * target.square, (target.square - target.marker) / math.sqrt(2))


def _axes(homography: FloatArray, places: FloatArray) -> FloatArray:
    """Directions of the board's x and y in the photo at each place, (N, 2, 2), as columns; of any length."""
    divisor = depth(homography, places)[:, None, None]
    at = places @ homography[:2, :2].T + homography[:2, 2]
    axes: FloatArray = (
        homography[None, :2, :2] - at[:, :, None] * homography[None, 2:, :2] / divisor
    )
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
        raise JobError(
            option, f"{value} is no length in mm", remedy="measure it on the printed board"
        )
