"""Calibration boards and their corners in a photo: chessboards, and ChArUco boards partly in view.

OpenCV finds the board in a reduced picture. The corners are then fitted in the full one by
`fit_saddles`. A corner counts if its contrast is like that of the others, and if it is dark in the
quadrants that are black on the board. So a grid that OpenCV has placed wrongly is rejected.

A chessboard with one odd and one even number of corners looks different from its two ends. Its
first corner is the one whose inner square is black, so that a corner has the same number in all
photos.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

import cv2
import numpy as np
from msgspec import Struct

from camgen.model.errors import JobError
from camgen.model.part import IntArray
from camgen.model.pose import FloatArray, frozen
from camgen.model.text import short
from camgen.vision.boards.sheet import DICTIONARY, Board
from camgen.vision.image import Pixels, convert_to_grey
from camgen.vision.plane import compute_depth, compute_scales, find_off_line, fit_homography

# Corners of a chessboard to a hundredth of a pixel: a saddle is fitted to the grey values.

#: Maximum number of iterations of a fit, and number of fits. The window of the second fit is around
#: the corner of the first one.
_ITERATIONS, _PASSES = 30, 2
#: px: a fit ends if no corner moves by this.
_SETTLED_PX = 1e-4
#: Limits of the radius of the window, px. A smaller window does not hold the nine unknowns, and the
#: pixels of a larger one add nothing.
_MIN_RADIUS_PX, _MAX_RADIUS_PX = 2.5, 12.0
#: Damping with which each fit starts, as a share of the diagonal.
_DAMPING = 1e-3
#: Columns of the nine unknowns: the corner, px; the angles of the normals of its two edges, rad;
#: contrast, mean, and the slopes of the light, 1/px; logarithm of the blur.
_U, _V, _FIRST, _SECOND, _CONTRAST, _MEAN, _SLOPE_U, _SLOPE_V, _BLUR = range(9)


class Saddles(Struct, frozen=True, eq=False):
    """Corners that were fitted.

    corners: (N, 2) px.
    contrast: (N,) grey values; the sign says which quadrants are dark. It is 0 for a corner that
        left its window, or is at the border of the photo.
    misfit: (N,) rms residual of the fit, grey values.
    """

    corners: FloatArray
    contrast: FloatArray
    misfit: FloatArray


class _Windows(Struct, frozen=True, eq=False):
    """The pixels around N corners.

    x, y: (N, P) distances from the corner, px.
    grey: (N, P) grey values.
    weight: (N, P) 0 outside the round window or the photo, 1 inside.
    """

    x: FloatArray
    y: FloatArray
    grey: FloatArray
    weight: FloatArray


def fit_saddles(grey: Pixels, near: FloatArray, axes: FloatArray, radius: FloatArray) -> Saddles:
    """Fits the corners next to `near` (N, 2) px, at most their radius away.

    axes: (N, 2, 2), the columns are the directions of the two edges in the photo.
    radius: (N,) px, of a round window that no other edge crosses.
    """
    radius = radius.clip(_MIN_RADIUS_PX, _MAX_RADIUS_PX)
    start = np.zeros((len(near), 9))
    start[:, _FIRST] = np.arctan2(axes[:, 0, 0], -axes[:, 1, 0])
    start[:, _SECOND] = np.arctan2(axes[:, 0, 1], -axes[:, 1, 1])
    start[:, _BLUR] = np.log(radius / 4)
    corners, numbers = near, start
    kept, misfit = np.ones(len(near), dtype=np.bool_), np.zeros(len(near))
    for _ in range(_PASSES):
        windows = _cut_out(grey, corners, radius)
        numbers, misfit = _fit(windows, _fit_contrast(windows, numbers))
        distance = np.hypot(*(corners + numbers[:, :2] - near).T)
        kept = kept & np.isfinite(numbers).all(axis=1) & (distance < radius)
        numbers = np.where(kept[:, None], numbers, start)
        corners = np.where(kept[:, None], corners + numbers[:, :2], near)
        numbers[:, :2] = 0
    margin = np.minimum(corners, np.array(grey.shape[::-1]) - 1 - corners).min(axis=1)
    contrast = np.where(kept & (margin >= _MIN_RADIUS_PX), numbers[:, _CONTRAST], 0)
    return Saddles(frozen(corners), frozen(contrast), frozen(misfit))


def _cut_out(grey: Pixels, corners: FloatArray, radius: FloatArray) -> _Windows:
    reach = int(np.ceil(radius.max()))
    down, right = np.mgrid[-reach : reach + 1, -reach : reach + 1].reshape(2, -1)
    middle = np.rint(corners).astype(np.int64)
    u, v = middle[:, :1] + right, middle[:, 1:] + down
    height, width = grey.shape
    inside = (u >= 0) & (v >= 0) & (u < width) & (v < height)
    x, y = u - corners[:, :1], v - corners[:, 1:]
    weight = inside * (radius[:, None] + 0.5 - np.hypot(x, y)).clip(0, 1)
    values = grey[v.clip(0, height - 1), u.clip(0, width - 1)]
    return _Windows(x, y, values.astype(np.float64), weight)


def _fit_contrast(windows: _Windows, numbers: FloatArray) -> FloatArray:
    """The unknowns with the contrast and the mean that fit the others best, and an even light.

    For a given corner, edges and blur the grey values depend on these two linearly.
    """
    fitted = numbers.copy()
    fitted[:, _CONTRAST], fitted[:, _MEAN], fitted[:, _SLOPE_U : _SLOPE_V + 1] = 1, 0, 0
    shape = _model_saddles(windows, fitted)[0]
    total = windows.weight.sum(axis=1)
    shape_mean = (windows.weight * shape).sum(axis=1) / total
    grey_mean = (windows.weight * windows.grey).sum(axis=1) / total
    offset = shape - shape_mean[:, None]
    variance = (windows.weight * offset**2).sum(axis=1) / total
    covariance = (windows.weight * (offset * windows.grey)).sum(axis=1) / total
    fitted[:, _CONTRAST] = covariance / np.maximum(variance, 1e-12)
    fitted[:, _MEAN] = grey_mean - fitted[:, _CONTRAST] * shape_mean
    return fitted


def _fit(windows: _Windows, numbers: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The unknowns (N, 9) that fit the windows, and the rms residual (N,).

    The method is Levenberg-Marquardt, with a damping for each corner.
    """
    damping = np.full(len(numbers), _DAMPING)
    values, slopes = _model_saddles(windows, numbers)
    error = windows.grey - values
    cost = (windows.weight * error**2).sum(axis=1)
    for _ in range(_ITERATIONS):
        weighted = np.swapaxes(slopes * windows.weight[..., None], 1, 2)
        normal = weighted @ slopes
        right = (weighted @ error[..., None])[..., 0]
        size = np.diagonal(normal, axis1=1, axis2=2)
        normal = normal + (damping[:, None] * size + 1e-9)[..., None] * np.eye(9)
        tried = numbers + np.linalg.solve(normal, right[..., None])[..., 0]
        tried_values, tried_slopes = _model_saddles(windows, tried)
        tried_error = windows.grey - tried_values
        tried_cost = (windows.weight * tried_error**2).sum(axis=1)
        better = tried_cost <= cost
        step = np.abs(tried - numbers)[better][:, :2].max(initial=0.0)
        numbers = np.where(better[:, None], tried, numbers)
        cost = np.where(better, tried_cost, cost)
        error = np.where(better[:, None], tried_error, error)
        slopes = np.where(better[:, None, None], tried_slopes, slopes)
        damping = np.where(better, damping / 5, damping * 8)
        if step < _SETTLED_PX and (better | (damping > 1e3)).all():
            break
    return numbers, np.sqrt(cost / windows.weight.sum(axis=1))


def _model_saddles(windows: _Windows, numbers: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Grey values (N, P) of corners with the unknowns (N, 9), and their derivatives (N, P, 9)."""
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


# Boards.

#: Boards are searched in a picture of at most this number of pixels, and then in the full one.
_SEARCHED_PIXELS = 2_500_000
#: The window of a corner extends to this part of a square. Near the markers of a ChArUco board it
#: is smaller by this, px, because they are blurred.
_WINDOW_SHARE, _BLUR_PX = 0.5, 1.0
#: A corner counts if it has this part of the median contrast or more.
_FAINT = 0.3
#: Something lies on a corner if its misfit, as a part of its contrast, is larger than this many
#: times the median one. That limit is at least the second value, and at most the third.
_WORSE, _ALWAYS, _NEVER = 3.0, 0.1, 0.4
#: The grid is right if this part of its corners counts, and at least this number of them.
_RIGHT_SHARE, _MIN_CORNERS = 0.75, 6
#: Maximum number of inner corners, or of squares, along a side.
_MAX_SIDE = 100


class Chessboard(Struct, frozen=True):
    """A chessboard of `columns` x `rows` inner corners and squares of `square` mm."""

    columns: int
    rows: int
    square: float

    @property
    def label(self) -> str:
        """The name of the board in messages."""
        return f"chessboard {self.columns}x{self.rows}"


Target = Chessboard | Board


class SeenBoard(Struct, frozen=True, eq=False):
    """A board in a photo.

    corners: (N, 2) px, the inner corners.
    places: (N, 2) mm, their places on the board.
    corner_count: number of inner corners of the whole board.
    """

    corners: FloatArray
    places: FloatArray
    corner_count: int


#: Inner corners (N, 2) as OpenCV finds them, px, and their numbers (N,) on the board, row by row.
_Corners = tuple[FloatArray, IntArray]


def make_chessboard(columns: int, rows: int, square: float) -> Chessboard:
    """The chessboard of `columns` x `rows` inner corners and squares of `square` mm.

    Raises JobError for fewer than 3 x 3 corners or more than 100 in a row, and for an invalid
    square.
    """
    _check_sides(
        columns,
        rows,
        "inner corners cannot be found",
        "give the inner corners, one fewer than squares each way; 3x3 at least",
    )
    _check_length("--square", square)
    return Chessboard(columns, rows, float(square))


def make_charuco(
    columns: int, rows: int, square: float, marker: float, dictionary: str = DICTIONARY
) -> Board:
    """The ChArUco board of `columns` x `rows` squares of `square` mm with markers of `marker` mm.

    Raises JobError for a board that is not possible, and for an unknown dictionary. The message
    then names all dictionaries.
    """
    _check_sides(
        columns, rows, "squares cannot be used", "give the number of squares each way; 3x3 at least"
    )
    _check_length("--square", square)
    _check_length("--marker", marker)
    if marker >= square:
        raise JobError(
            "--marker",
            f"markers of {short(marker, 3)} mm do not fit into squares of {short(square, 3)} mm",
            remedy="measure both on the board, in mm",
        )
    board = Board(columns, rows, float(square), float(marker), dictionary)
    held, needed = len(_load_dictionary(board).bytesList), columns * rows // 2
    if held < needed:
        raise JobError(
            "--dictionary",
            f"{dictionary} has {held} markers, a board of {columns}x{rows} needs {needed}",
            remedy="give the one that the board was made with",
        )
    return board


def _check_sides(columns: int, rows: int, what: str, remedy: str) -> None:
    if not (3 <= columns <= _MAX_SIDE and 3 <= rows <= _MAX_SIDE):
        raise JobError("--board", f"{columns}x{rows} {what}", remedy=remedy)


def _check_length(option: str, value: float) -> None:
    if not (math.isfinite(value) and value > 0):
        raise JobError(
            option,
            f"must be a length above 0 mm, not {value}",
            remedy="measure it on the printed board",
        )


def find_board(pixels: Pixels, target: Target) -> SeenBoard | None:
    """Finds a board in a photo, (H, W) or (H, W, 3) blue, green, red; None if it is not there."""
    grey = convert_to_grey(pixels)
    for factor in dict.fromkeys((math.ceil(math.sqrt(grey.size / _SEARCHED_PIXELS)), 1)):
        for corners, numbers in _search_reduced(grey, factor, target):
            board = _measure_board(grey, corners, numbers, target)
            if board is not None:
                return board
    return None


def _search_reduced(grey: Pixels, factor: int, target: Target) -> Iterator[_Corners]:
    """Candidates for the board in the picture reduced by `factor`, in px of the full one."""
    height, width = grey.shape
    size, small = (width // factor, height // factor), grey
    if factor > 1:
        small = cv2.resize(grey, size, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)
    if isinstance(target, Chessboard):
        candidates = _search_chessboard(small, target, factor > 1)
    else:
        candidates = _search_charuco(small, target)
    for corners, numbers in candidates:
        yield (corners + 0.5) * (np.array([width, height]) / size) - 0.5, numbers


def _search_chessboard(grey: Pixels, target: Chessboard, reduced: bool) -> Iterator[_Corners]:
    """Candidates by two detectors.

    The older one finds boards that lie flat in the photo, the newer one blurred ones, and each
    misses some that the other finds. The older one may take seconds on a large picture without a
    board, so it is not used there.
    """
    size = (target.columns, target.rows)
    numbers = np.arange(target.columns * target.rows)
    if reduced or grey.size <= _SEARCHED_PIXELS:
        flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
        is_found, corners = cv2.findChessboardCorners(grey, size, flags=flags)
        if is_found:
            yield np.asarray(corners, dtype=np.float64).reshape(-1, 2), numbers
    cv2.setRNGSeed(0)  # its search of neighbours is a random one
    flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE
    is_found, corners = cv2.findChessboardCornersSB(grey, size, flags=flags)
    if is_found:
        yield np.asarray(corners, dtype=np.float64).reshape(-1, 2), numbers


def _search_charuco(grey: Pixels, target: Board) -> Iterator[_Corners]:
    for pattern in find_patterns(grey, target):
        if len(pattern.numbers) >= _MIN_CORNERS:
            yield pattern.corners, pattern.numbers


class Pattern(Struct, frozen=True, eq=False):
    """A ChArUco board as a picture shows it in one of its two patterns.

    corners: (N, 2), the inner corners, px.
    numbers: (N,), the numbers of the corners, row by row from above.
    markers: (M,), the numbers of all markers of the board's dictionary in the picture.
    marker_corners: (M, 4, 2), their corners by OpenCV, px, clockwise from the upper left one.
    legacy: whether it is the pattern before OpenCV 4.6.
    """

    corners: FloatArray
    numbers: IntArray
    markers: IntArray
    marker_corners: FloatArray
    legacy: bool


def has_two_patterns(board: Board) -> bool:
    """Whether OpenCV 4.6 changed the pattern. It did not for an odd number of rows."""
    return board.rows % 2 == 0


def find_patterns(grey: Pixels, board: Board) -> Iterator[Pattern]:
    """Finds the board in each of its patterns, the newer one first.

    A pattern that is not in the picture has few corners.
    """
    drawn = cv2.aruco.CharucoBoard(
        (board.columns, board.rows), board.square, board.marker, _load_dictionary(board)
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


def refine_corners(grey: Pixels, pattern: Pattern, board: Board) -> tuple[FloatArray, IntArray]:
    """The inner corners (N, 2) of a board as fitted, px, and their numbers (N,).

    If too few of them are corners of such a board, those of OpenCV are returned.
    """
    if len(pattern.numbers) >= _MIN_CORNERS:
        fitted = _measure_board(grey, pattern.corners, pattern.numbers, board)
        if fitted is not None:
            column, row = np.rint(fitted.places / board.square).astype(np.int64).T
            return fitted.corners, row * (board.columns - 1) + column
    return pattern.corners, pattern.numbers


def _measure_board(
    grey: Pixels, rough: FloatArray, numbers: IntArray, target: Target
) -> SeenBoard | None:
    """The board with fitted corners; None if too few of them are corners of such a board."""
    columns, rows = target.columns, target.rows
    # Around a corner there are only its two edges within this distance, mm, less the blur, px.
    free, blur = _WINDOW_SHARE * target.square, 0.0
    if isinstance(target, Board):
        columns, rows = columns - 1, rows - 1
        # The markers lie diagonally from the corner.
        free, blur = min(free, (target.square - target.marker) / math.sqrt(2)), _BLUR_PX
    row, column = np.divmod(numbers, columns)
    places = np.column_stack([column, row]) * target.square
    if find_off_line(places) is not None or find_off_line(rough) is not None:
        return None
    homography = fit_homography(places, rough)
    if compute_depth(homography, places).min() <= 0:
        return None
    window = free * compute_scales(homography, places)[:, 0] - blur
    saddles = fit_saddles(grey, rough, _find_axes(homography, places), window)
    contrast = saddles.contrast * np.where((row + column) % 2, -1, 1)
    sign = np.sign(np.median(contrast))
    contrast = contrast * sign
    clear = contrast > _FAINT * np.median(contrast)
    if not clear.any():
        return None
    limit = float(np.median(saddles.misfit[clear] / contrast[clear]) * _WORSE)
    good = clear & (saddles.misfit < min(max(limit, _ALWAYS), _NEVER) * contrast)
    is_short = good.sum() < max(_MIN_CORNERS, _RIGHT_SHARE * len(good))
    if is_short or find_off_line(places[good]) is not None:
        return None
    corners, places = saddles.corners[good], places[good]
    if isinstance(target, Chessboard) and (columns + rows) % 2 and sign < 0:
        last = np.array([columns - 1, rows - 1]) * target.square
        corners, places = corners[::-1], (last - places)[::-1]
    return SeenBoard(frozen(corners), frozen(places), columns * rows)


def _find_axes(homography: FloatArray, places: FloatArray) -> FloatArray:
    """The directions of the board's x and y in the photo at N places, of any length.

    Returns (N, 2, 2), with the directions as columns.
    """
    divisor = compute_depth(homography, places)[:, None, None]
    at = places @ homography[:2, :2].T + homography[:2, 2]
    perspective = at[:, :, None] * homography[None, 2:, :2] / divisor
    return np.asarray(homography[None, :2, :2] - perspective)


def _load_dictionary(board: Board) -> cv2.aruco.Dictionary:
    number = getattr(cv2.aruco, f"DICT_{board.dictionary.upper()}", None)
    if number is None:
        names = [name.removeprefix("DICT_") for name in dir(cv2.aruco) if name.startswith("DICT_")]
        raise JobError(
            "--dictionary",
            f"there is no {board.dictionary!r}",
            remedy=f"give one of {', '.join(names)}",
        )
    return cv2.aruco.getPredefinedDictionary(number)
