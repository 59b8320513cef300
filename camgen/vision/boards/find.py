"""Finds a marker sheet or a ChArUco board in a photo, and with it the work plane.

OpenCV finds the markers in a reduced picture. Their corners are then measured in the full one. The
four sides of a marker's black border are located along many short profiles across them, a line is
fitted to each side (without the lens distortion), and neighbouring lines are intersected. OpenCV's
own refinement moves outer corners inwards by blur, 0.14 to 0.5 px in renders with a blur of 0.7 px.
Its `CONTOUR` method has errors of 0.5 px, and the crossings of the sides 0.025 px.

A ChArUco board has both: the inner corners of its squares, to which saddles are fitted, and the
markers, whose corners reach further out. The size of the markers is measured by the inner corners,
so that only the squares of a board must be exact.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import compress, product
from typing import NamedTuple

import cv2
import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from camgen.model.errors import InputError
from camgen.model.part import Note
from camgen.model.pose import FloatArray
from camgen.model.sequences import take_rows
from camgen.model.text import counted, short
from camgen.vision.boards.corners import (
    Pattern,
    find_patterns,
    has_two_patterns,
    place_markers,
    refine_corners,
)
from camgen.vision.boards.lens import check_focal_length, fit_sheet_lens
from camgen.vision.boards.sheet import DICTIONARY, Board, Sheet
from camgen.vision.camera.camera import Camera, distort, undistort
from camgen.vision.camera.sheet_lens import SheetLens
from camgen.vision.image import Picture, Pixels, convert_to_grey
from camgen.vision.plane import (
    Plane,
    check_pixels,
    find_off_line,
    find_suspect,
    fit_homography,
    fit_plane,
    map_points,
)

#: Pixels of the reduced picture in which markers are searched, at most.
_SEARCHED_PIXELS = 2_500_000
#: px: a marker is left out if the others put one of its corners at least this far away,
_WRONG_PX = 0.5
#: and if chance would do that less often than this.
_WRONG_CHANCE = 1e-3
#: Largest fraction of the markers that is left out. If more are wrong, the sheet itself is.
_MAX_LEFT_OUT = 0.25

#: Marks are left out and the lens is fitted in turn, this number of times at most.
_LENS_ROUNDS = 5
#: px: corners have converged if the lens moves them by less.
_SETTLED_PX = 0.005

#: The size of a board's markers is measured by this number of its inner corners, at least.
_SIZE_CORNERS = 6
#: The corners of a marker, in half its sides from its middle.
_SQUARE = np.array([(-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)])

#: Places of the profiles along a side, 0 to 1. They avoid the corners, which blur has rounded.
_ALONG = np.linspace(0.12, 0.88, 33)
#: Samples of a profile, from black to white, in halves of its length.
_ACROSS = np.linspace(-1, 1, 33)
#: Modules along the side of a marker. Its black border is one module wide.
_MODULES = 6
#: Half the length of a profile, as a fraction of a module.
_HALF_LENGTH = 0.45
#: px: smallest half length, and largest half length in each round.
_MIN_HALF_PX, _MAX_HALF_PX = 1.5, (8.0, 5.0, 4.0)


class _MarkCorners(NamedTuple):
    """Corners of the marks of a sheet or board: first four of each marker, then the inner corners.

    px, mm: (N, 2), in the photo and in the work frame.
    owners: (N,), the mark of each corner, an index into `marks`.
    names: name of each corner.
    marks: name of each mark.
    middles: (M, 2), mm, the middle of the marker of each marker's corner; (0, 2) if the size of
        the markers is known.
    notes: notes on the marks.
    """

    px: FloatArray
    mm: FloatArray
    owners: NDArray[np.int64]
    names: list[str]
    marks: list[str]
    middles: FloatArray
    notes: tuple[Note, ...]


def find(
    picture: Picture, camera: Camera | None, target: Sheet | Board, *, height: float = 0.0
) -> Plane:
    """Find the work plane of a sheet or board that lies in a photo.

    The work frame is that of the sheet or board. Without a camera, the lens is computed from the
    corners, and is `lens` of the plane.

    height: distance of the part's top face above the paper, mm.

    Raises InputError for fewer than two markers, or four corners of a board. Raises JobError if
    they contradict each other or all focal lengths.
    """
    if camera is not None:
        check_pixels(picture, camera)
    if isinstance(target, Sheet):
        marks = _find_sheet(picture, camera, target)
    else:
        marks = _find_board(picture, camera, target)
    lens = None
    if camera is None:
        marks, lens = _fit_lens(picture, marks, height)
        camera = lens.camera if lens is not None else None
        if height:
            check_focal_length(lens)
    kept, dropped = _select_agreeing(marks, camera)
    plane = fit_plane(
        camera,
        marks.px[kept],
        marks.mm[kept],
        height=height,
        names=list(compress(marks.names, kept)),
        source=f"{picture.name}: {target.label}",
    )
    notes = marks.notes if lens is None else (*marks.notes, lens.note)
    if dropped:
        notes = (
            *notes,
            Note(
                "warning",
                f"{', '.join(dropped)} left out",
                "they are not where the others put them: covered, bent, or from another sheet?",
            ),
        )
    return replace(plane, notes=(*notes, *plane.notes), lens=lens)


def _fit_lens(
    picture: Picture, marks: _MarkCorners, height: float
) -> tuple[_MarkCorners, SheetLens | None]:
    """Fit the lens, and measure the marks through it.

    A mark that contradicts the others is left out of the fit of the lens. Without the lens, marks
    that are right may contradict each other. So both are done in turn.

    Returns the marks, and the lens or None.
    """
    height_px, width_px = picture.pixels.shape[:2]
    kept = np.ones(len(marks.px), dtype=np.bool_)
    for _ in range(_LENS_ROUNDS):
        px, mm = marks.px[kept], marks.mm[kept]
        lens = fit_sheet_lens(px, mm, (width_px, height_px), bool(height), picture.focal_px)
        camera = None if lens is None else lens.camera
        moved = 0.0
        count = sum(name.startswith("marker") for name in marks.names)
        if count and camera is not None:
            corners = _measure(
                convert_to_grey(picture.pixels), marks.px[:count].reshape(-1, 4, 2), camera
            )
            again = np.concatenate([corners.reshape(-1, 2), marks.px[count:]])
            moved = float(np.abs(again - marks.px).max())
            marks = _fit_marker_size(marks._replace(px=again), camera)
        before = kept
        kept, _ = _select_agreeing(marks, camera)
        if np.array_equal(kept, before) and moved < _SETTLED_PX:
            break
    return marks, lens


def list_marks(pixels: Pixels, target: Sheet | Board) -> tuple[list[int], list[int]]:
    """List the markers of a sheet, or the inner corners of a board, that a picture shows.

    Returns the numbers of those that it shows, and of those that are missing.
    """
    if isinstance(target, Sheet):
        shown = set(dict(_detect(convert_to_grey(pixels), len(target.ids))))
        numbers = set(target.ids)
    else:
        shown = set(_choose_pattern(pixels, target).numbers.tolist())
        numbers = set(range((target.columns - 1) * (target.rows - 1)))
    return sorted(numbers & shown), sorted(numbers - shown)


def _find_sheet(picture: Picture, camera: Camera | None, sheet: Sheet) -> _MarkCorners:
    grey = convert_to_grey(picture.pixels)
    seen = _detect(grey, len(sheet.ids))
    times = Counter(number for number, _ in seen)
    strange = sorted(set(times) - set(sheet.ids))
    double = sorted(number for number, count in times.items() if count > 1)
    usable = [number for number in sheet.ids if times[number] == 1]
    notes = []
    if strange:
        notes.append(Note("warning", f"marker {_list(strange)} ignored", "not on this sheet"))
    if double:
        notes.append(
            Note("warning", f"marker {_list(double)} ignored", "in the photo more than once")
        )
    if len(usable) < 2:
        extra = "".join(f"; {note.what}: {note.why}" for note in notes)
        raise InputError(
            picture.name,
            f"shows {len(usable)} of the {len(sheet.ids)} markers of the {sheet.label}{extra}",
            remedy="bring two or more into view; with four or more the plane is more exact",
        )
    if len(usable) < 4:
        notes.append(
            Note(
                "warning",
                f"only {len(usable)} of {len(sheet.ids)} markers found",
                "the plane is less exact than with four or more around the part",
            )
        )
    corners_of = dict(seen)
    corners = _measure(grey, np.array(take_rows(corners_of, usable)), camera)
    marker_names = [f"marker {number}" for number in usable]
    return _MarkCorners(
        corners.reshape(-1, 2),
        sheet.corners[np.isin(sheet.ids, usable)].reshape(-1, 2),
        np.repeat(np.arange(len(usable)), 4),
        _name_corners(marker_names),
        marker_names,
        np.zeros((0, 2)),
        tuple(notes),
    )


def _find_board(picture: Picture, camera: Camera | None, board: Board) -> _MarkCorners:
    pattern = _choose_pattern(picture.pixels, board)
    if len(pattern.numbers) < 4:
        raise InputError(
            picture.name,
            f"shows {counted(len(pattern.numbers), 'corner')} of the {board.label}",
            remedy="four are needed; check its squares, its dictionary and the light",
        )
    grey = convert_to_grey(picture.pixels)
    inner_px, inner = refine_corners(grey, pattern, board)
    row, column = np.divmod(inner, board.columns - 1)
    inner_mm = np.column_stack([column + 1, board.rows - 1 - row]) * board.square
    middles = place_markers(board, pattern.legacy)
    times = Counter(pattern.markers.tolist())
    usable = sorted(number for number in middles if times[number] == 1)
    if len(inner) < _SIZE_CORNERS or find_off_line(inner_mm) is not None:
        usable = []
    rows = [pattern.markers.tolist().index(number) for number in usable]
    corners = _measure(grey, pattern.marker_corners[rows], camera).reshape(-1, 2)
    around = np.array(take_rows(middles, usable)).reshape(-1, 2).repeat(4, axis=0)
    marker_mm = around + board.marker / 2 * np.tile(_SQUARE, (len(usable), 1))
    marker_names = [f"marker {number}" for number in usable]
    inner_names = [f"corner {number}" for number in inner.tolist()]
    marks = _MarkCorners(
        np.concatenate([corners, inner_px]),
        np.concatenate([marker_mm, inner_mm]),
        np.concatenate([np.arange(len(usable)).repeat(4), len(usable) + np.arange(len(inner))]),
        _name_corners(marker_names) + inner_names,
        marker_names + inner_names,
        around,
        (*_note_pattern(pattern, board), *_missing_lines(pattern, board)),
    )
    return _fit_marker_size(marks, camera)


def _name_corners(markers: Sequence[str]) -> list[str]:
    return [f"{marker} corner {corner}" for marker, corner in product(markers, (1, 2, 3, 4))]


def _fit_marker_size(marks: _MarkCorners, camera: Camera | None) -> _MarkCorners:
    """The marks of a board with markers of the size that its inner corners show.

    A printed marker is as much larger or smaller as ink runs and as the picture is over-exposed.
    """
    count = len(marks.middles)
    if not count:
        return marks
    ideal = marks.px if camera is None else undistort(camera, marks.px)
    inner = np.isfinite(ideal[count:]).all(axis=1)
    to_mm = fit_homography(ideal[count:][inner], marks.mm[count:][inner])
    side = np.sign(marks.mm[:count] - marks.middles)
    half = (map_points(to_mm, ideal[:count]) - marks.middles) * side
    shown = float(np.nanmedian(half.reshape(-1, 8).mean(axis=1)))
    return marks._replace(mm=np.concatenate([marks.middles + shown * side, marks.mm[count:]]))


def _choose_pattern(pixels: Pixels, board: Board) -> Pattern:
    """The board in the pattern with more corners, the newer one if both have as many."""
    return max(
        find_patterns(convert_to_grey(pixels), board), key=lambda pattern: len(pattern.numbers)
    )


def _note_pattern(pattern: Pattern, board: Board) -> tuple[Note, ...]:
    """The note on the pattern of a board for which there are two; none for other boards."""
    if not has_two_patterns(board):
        return ()
    which = "before OpenCV 4.6" if pattern.legacy else "of OpenCV 4.6 and later"
    return (
        Note(
            "assumed",
            f"{board.label} read in the pattern {which}",
            "with an even number of rows there are two; it fits",
        ),
    )


class _Side(NamedTuple):
    """An outer side of a board.

    axis: 0 for rows, 1 for columns.
    step: 1 if the counting starts at the side, else -1.
    """

    name: str
    line: str
    axis: int
    step: int


#: Rows are counted from above, columns from the left.
_SIDES = (
    _Side("upper", "row", 0, 1),
    _Side("lower", "row", 0, -1),
    _Side("left", "column", 1, 1),
    _Side("right", "column", 1, -1),
)


def _missing_lines(pattern: Pattern, board: Board) -> tuple[Note, ...]:
    """Notes on outer rows and columns without corners, and on markers beyond the last one.

    The numbers of markers count row by row from above. The origin is the lower left corner. So a
    wrong number of rows fits the picture without a residual, and moves the origin by whole squares:
    it is a warning. A wrong number of columns moves nearly all markers, and the corners contradict
    it. A note is enough for the other sides.
    """
    notes = []
    for side in _SIDES:
        lines = np.divmod(pattern.numbers, board.columns - 1)[side.axis]
        count = (board.rows, board.columns)[side.axis] - 1
        missing = int(lines.min() if side.step > 0 else count - 1 - lines.max())
        if missing:
            notes.append(_note_missing(missing, side, board))
    last = board.columns * board.rows // 2 - 1
    beyond = np.unique(pattern.markers[pattern.markers > last])
    if len(beyond):
        notes.append(
            Note(
                "warning",
                f"marker {_list(beyond.tolist())} is not on the {board.label}, "
                f"its last one is {last}",
                "with more rows than camera.markers says, the origin, its lower left corner, is "
                "too high: count its squares",
                strict=True,
            )
        )
    return tuple(notes)


def _note_missing(missing: int, side: _Side, board: Board) -> Note:
    line = f"{side.name} {side.line}"
    lines = f"{missing} {line}s" if missing > 1 else line
    what = f"no corner of the {lines} of the {board.label} is found"
    if side.name != "lower":
        return Note(
            "assumed", what, "covered, or out of the picture: the origin does not depend on it"
        )
    shift = short(missing * board.square, 3)
    return Note(
        "warning",
        what,
        "the origin is its lower left corner: if the board has "
        f"{counted(board.rows - missing, 'row')} of squares, all is {shift} mm too far up; "
        "count its squares, or uncover them",
        strict=True,
    )


def _select_agreeing(
    marks: _MarkCorners, camera: Camera | None
) -> tuple[NDArray[np.bool_], list[str]]:
    """The corners that are kept, and the names of the marks that are left out.

    A mark is left out if a corner of it is clearly wrong.
    """
    ideal = marks.px if camera is None else undistort(camera, marks.px)
    # A mark beyond the valid radius of the lens model cannot be used.
    kept = ~np.isin(marks.owners, marks.owners[~np.isfinite(ideal).all(axis=1)])
    dropped: list[int] = []
    max_dropped = int(_MAX_LEFT_OUT * len(set(marks.owners.tolist())))
    while len(dropped) < max_dropped and np.count_nonzero(kept) > 5:
        px, mm = ideal[kept], marks.mm[kept]
        residuals = np.linalg.norm(map_points(fit_homography(mm, px), mm) - px, axis=1)
        odd = find_suspect(mm, px, residuals)
        if odd.error < _WRONG_PX or odd.chance > _WRONG_CHANCE:
            break
        owner = int(marks.owners[kept][odd.index])
        dropped.append(owner)
        kept &= marks.owners != owner
    return kept, [marks.marks[owner] for owner in sorted(dropped)]


# Markers in the picture.


def _detect(grey: Pixels, expected: int) -> list[tuple[int, FloatArray]]:
    """Find the markers in the reduced picture; in the full one if it shows under half of them.

    expected: number of markers.

    Returns the number and the corners (4, 2), px, of each marker.
    """
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{DICTIONARY}"))
    detector = cv2.aruco.ArucoDetector(dictionary, cv2.aruco.DetectorParameters())

    def detect_in(picture: Pixels, step: FloatArray) -> list[tuple[int, FloatArray]]:
        places, ids, _ = detector.detectMarkers(picture)
        if not places:
            return []
        full = [(np.asarray(place, dtype=np.float64)[0] + 0.5) * step - 0.5 for place in places]
        return list(zip(map(int, np.asarray(ids).ravel()), full, strict=True))

    markers: list[tuple[int, FloatArray]] = []
    height, width = grey.shape
    reduction = int(np.ceil(np.sqrt(grey.size / _SEARCHED_PIXELS)))
    if reduction > 1:
        size = (width // reduction, height // reduction)
        small = cv2.resize(grey, size, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)
        markers = detect_in(small, np.array([width / size[0], height / size[1]]))
    if 2 * len(markers) < expected:
        markers = max(markers, detect_in(grey, np.ones(2)), key=len)
    return markers


def _measure(grey: Pixels, corners: FloatArray, camera: Camera | None) -> FloatArray:
    """Measure the corners of black squares on white, where lines along their sides meet.

    corners: (M, 4, 2) approximate corners, clockwise in the photo, px.

    Returns corners (M, 4, 2), px.
    """
    for max_half in _MAX_HALF_PX:
        edge = _locate_sides(grey, corners, max_half)
        flat = edge.reshape(-1, 2)
        ideal = (flat if camera is None else undistort(camera, flat)).reshape(edge.shape)
        crossings = _intersect_sides(ideal).reshape(-1, 2)
        if camera is not None:
            crossings = distort(camera, crossings)
        corners = crossings.reshape(corners.shape)
    return corners


def _locate_sides(grey: Pixels, corners: FloatArray, max_half: float) -> FloatArray:
    """Points (M, 4, P, 2) on each side, px: the centre of the rise of grey along profiles.

    max_half: largest half length of a profile, px.
    """
    side = np.roll(corners, -1, axis=1) - corners
    length = np.linalg.norm(side, axis=2)
    outwards = np.stack([side[..., 1], -side[..., 0]], axis=2) / length[..., None]
    half = np.clip(_HALF_LENGTH * length / _MODULES, _MIN_HALF_PX, max_half)
    across = half[..., None, None] * outwards[:, :, None, :]
    middles = corners[:, :, None, :] + _ALONG[:, None] * side[:, :, None, :]
    places = (middles[:, :, :, None, :] + _ACROSS[:, None] * across[:, :, :, None, :]).reshape(
        -1, len(_ACROSS), 2
    )
    grid = places.astype(np.float32)
    light = cv2.remap(
        grey, grid[..., 0], grid[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    rise = np.diff(np.asarray(light, dtype=np.float64), axis=1)
    total = rise.sum(axis=1)
    centre = (_ACROSS[:-1] + _ACROSS[1:]) / 2
    # A side without any rise is covered. Its middle is taken; the marker contradicts the others.
    offset = np.where(total > 0, rise @ centre / np.where(total > 0, total, 1), 0).clip(-1, 1)
    return np.asarray(middles + offset.reshape(middles.shape[:3])[..., None] * across)


def _intersect_sides(edge: FloatArray) -> FloatArray:
    """Corners (M, 4, 2): crossings of the line of each side and of that of the side before it.

    edge: (M, 4, P, 2) points on each side.
    """
    middle = edge.mean(axis=2)
    spread = edge - middle[:, :, None, :]
    # The first eigenvector has the least spread.
    normal = np.linalg.eigh(np.einsum("mspi,mspj->msij", spread, spread))[1][..., 0]
    before = np.roll(normal, 1, axis=1)
    normals = np.stack([before, normal], axis=2)
    offset_before = (before * np.roll(middle, 1, axis=1)).sum(axis=2)
    offsets = np.stack([offset_before, (normal * middle).sum(axis=2)], axis=2)
    return np.asarray(np.linalg.solve(normals, offsets[..., None])[..., 0])


def _list(numbers: Sequence[int]) -> str:
    return ", ".join(map(str, numbers))
