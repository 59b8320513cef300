"""Calibrates a camera and its lens from photos of a board.

Zhang's method as in OpenCV, on corners that are fitted more exactly. The board is measured in each
photo, photos that contradict the others are left out, and notes state weaknesses of the result.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import cv2
import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.model.errors import InputError
from camgen.model.files import Source
from camgen.model.part import Note
from camgen.model.pose import FloatArray, frozen
from camgen.model.text import counted, short
from camgen.vision.boards.corners import Chessboard, SeenBoard, Target, find_board
from camgen.vision.camera.camera import Camera, sample_photo, undistort
from camgen.vision.image import read_picture

# Camera, lens and board poses that fit the corners of many photos.

#: Photos that a calibration needs, at least. Three are enough if the board is tilted in them.
LEAST_PHOTOS = 3
TILT = "take photos with the board tilted by 20 to 40 deg in different directions"
#: Lens coefficients of OpenCV's usual model.
_USUAL_LENS = 5
#: Lens coefficients of the model for wide angles.
_WIDE_ANGLE = 8
#: The model for wide angles is taken if it divides the median error of the photos by more than this
_MIN_IMPROVEMENT = 2.0
#: and reduces it by more than this, px.
_MIN_GAIN_PX = 0.05
#: A photo is left out if its F ratio is above this
_MAX_F_RATIO = 6.0
#: and its error without it in the fit is above this, px.
_MAX_ERROR_PX = 0.1
#: Photos with the largest errors that are tested each time.
_TESTED_PHOTOS = 3
#: Iterations of OpenCV's optimizer, at most, and the relative change at which it stops.
_MAX_ITERATIONS, _MIN_CHANGE = 100, 1e-12
#: Points along each side of a photo at which the lens model is tested.
_BORDER_POINTS = 17

#: Names and boards of photos.
_NamedBoards = Sequence[tuple[str, SeenBoard]]


class UsedPhoto(Struct, frozen=True, eq=False):
    """A photo that the calibration is based on.

    name: file of the photo.
    seen: the board in the photo.
    errors: (N, 2) corners as seen minus as calculated, px.
    """

    name: str
    seen: SeenBoard
    errors: FloatArray

    @property
    def rms(self) -> float:
        """Root mean square of the distances between corners as seen and as calculated, px."""
        return compute_rms([self])

    @property
    def worst(self) -> float:
        """The largest of these distances, px."""
        return float(np.linalg.norm(self.errors, axis=1).max())


class LeftOut(Struct, frozen=True):
    """A photo that the calibration is not based on.

    name: file of the photo.
    why: the reason.
    """

    name: str
    why: str


class LensFit(Struct, frozen=True, eq=False):
    """Camera and lens with the smallest errors in the photos that were used.

    matrix: (3, 3) camera matrix, px.
    lens: (n,) lens coefficients.
    deviations: (4 + n,) standard deviations of fx, fy, cx, cy (px) and of the coefficients.
    used: the photos.
    """

    matrix: FloatArray
    lens: FloatArray
    deviations: FloatArray
    used: tuple[UsedPhoto, ...]

    @property
    def median_rms(self) -> float:
        """The median of the errors of the photos, px."""
        return float(np.median([photo.rms for photo in self.used]))

    @property
    def squares(self) -> float:
        """The sum of all squared distances, px2."""
        return sum(_sum_squares(photo) for photo in self.used)

    @property
    def freedom(self) -> int:
        """Degrees of freedom: measured numbers minus those of the camera and 6 of each pose."""
        return sum(2 * len(photo.errors) - 6 for photo in self.used) - len(self.deviations)


def fit_agreeing(
    boards: _NamedBoards, size: tuple[int, int]
) -> tuple[LensFit, list[LeftOut], list[Note]]:
    """Fit camera and lens to the photos that agree with each other.

    boards: names of the photos and the boards in them.
    size: (width, height) of the photos, px.

    Returns the fit, the photos that were left out, and a note if the lens needs the model for wide
    angles. Raises InputError if the photos do not determine a camera.
    """
    with _one_thread():
        usual, odd = _leave_out_odd(boards, size, _fit(boards, size, _USUAL_LENS))
        if not odd and usual.median_rms < _MIN_GAIN_PX:
            return usual, odd, []
        wide, odd_wide = _leave_out_odd(boards, size, _fit(boards, size, _WIDE_ANGLE))
    is_better = (
        wide.median_rms * _MIN_IMPROVEMENT < usual.median_rms
        and usual.median_rms - wide.median_rms > _MIN_GAIN_PX
    )
    if not is_better and len(odd_wide) >= len(odd):
        return usual, odd, []
    is_whole = can_undistort_border(Camera(usual.matrix, usual.lens, size, ""))
    if is_whole and not can_undistort_border(Camera(wide.matrix, wide.lens, size, "")):
        return usual, odd, []
    agreed = [
        f"{len(fit.used)} photos agree within {short(compute_rms(fit.used), 2)} px"
        for fit in (usual, wide)
    ]
    return (
        wide,
        odd_wide,
        [
            Note(
                "assumed",
                f"a wide-angle lens of {_WIDE_ANGLE} coefficients",
                f"with {_USUAL_LENS} of them {agreed[0]}, with all {_WIDE_ANGLE} {agreed[1]}",
            )
        ],
    )


@contextmanager
def _one_thread() -> Iterator[None]:
    """Run OpenCV in a single thread.

    Several threads add up in a random order, so the last digits of a calibration would differ from
    run to run.
    """
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(before)


def compute_rms(used: Sequence[UsedPhoto]) -> float:
    """Root mean square of the distances of all corners, px."""
    count = sum(len(photo.errors) for photo in used)
    return math.sqrt(sum(_sum_squares(photo) for photo in used) / count)


def can_undistort_border(camera: Camera) -> bool:
    """Whether the lens model has a solution everywhere along the border of the photo."""
    return bool(np.isfinite(undistort(camera, _sample_border(camera.size))).all())


def _sample_border(size: tuple[int, int]) -> FloatArray:
    """Pixels (N, 2) along the border of a photo of `size` (width, height)."""
    pixels = sample_photo(size, _BORDER_POINTS)
    is_border = (pixels == 0) | (pixels == np.array(size) - 1)
    return np.asarray(pixels[is_border.any(axis=1)])


def _fit(boards: _NamedBoards, size: tuple[int, int], count: int) -> LensFit:
    """Fit camera and lens with `count` coefficients to all boards.

    Raises InputError if the photos do not determine them.
    """
    places = [
        np.column_stack([seen.places, np.zeros(len(seen.places))]).astype(np.float32)
        for _, seen in boards
    ]
    corners = [seen.corners.astype(np.float32) for _, seen in boards]
    flags = cv2.CALIB_RATIONAL_MODEL if count == _WIDE_ANGLE else 0
    until = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, _MAX_ITERATIONS, _MIN_CHANGE)
    try:
        result = cv2.calibrateCamera(places, corners, size, None, None, flags=flags, criteria=until)
    except cv2.error as error:
        raise InputError(
            boards[0][0],
            "OpenCV cannot calibrate from this photo and the others",
            " ".join(error.err.split()),
            TILT,
        ) from error
    _, _, _, rotations, translations = result
    matrix, lens = np.asarray(result[1], np.float64), np.asarray(result[2], np.float64)
    if not (np.isfinite(matrix).all() and np.isfinite(lens).all()):
        raise InputError(
            boards[0][0], "OpenCV finds no camera that took this photo and the others", remedy=TILT
        )
    lens = lens.ravel()[:count]
    used: list[UsedPhoto] = []
    normal_matrix = np.zeros((4 + count, 4 + count))
    for (name, board), place, rotation, translation in zip(
        boards, places, rotations, translations, strict=True
    ):
        calculated, slopes = cv2.projectPoints(
            place.astype(np.float64), rotation, translation, matrix, lens
        )
        used.append(UsedPhoto(name, board, frozen(board.corners - calculated.reshape(-1, 2))))
        # Changes that another pose of this board explains do not determine the camera.
        pose = np.linalg.qr(slopes[:, :6])[0]
        free = slopes[:, 6 : 10 + count] - pose @ (pose.T @ slopes[:, 6 : 10 + count])
        normal_matrix += free.T @ free
    fit = LensFit(matrix, lens, np.zeros(4 + count), tuple(used))
    return replace(fit, deviations=_compute_deviations(normal_matrix, fit.squares / fit.freedom))


def _compute_deviations(normal_matrix: FloatArray, variance: float) -> FloatArray:
    """Standard deviations of the parameters, from the normal matrix of the fit.

    inf for a parameter that is not determined, for which OpenCV returns 0.
    """
    scale = np.sqrt(np.diag(normal_matrix)).clip(np.finfo(float).tiny)
    values, vectors = np.linalg.eigh(normal_matrix / np.outer(scale, scale))
    with np.errstate(divide="ignore"):
        spread: FloatArray = np.sqrt(variance * (vectors**2 / values.clip(0)).sum(axis=1)) / scale
    return spread


def _leave_out_odd(
    boards: _NamedBoards, size: tuple[int, int], fit: LensFit
) -> tuple[LensFit, list[LeftOut]]:
    """Leave out photos that contradict the others, the worst one first.

    A photo is tested with a fit without it: the F ratio compares the squares that it alone causes
    with those of the remaining photos.

    Returns the fit to the remaining photos, and the photos that were left out.
    """
    odd: list[LeftOut] = []
    remaining = list(boards)
    while len(remaining) > LEAST_PHOTOS:
        tests = []
        by_error = np.argsort([-photo.rms for photo in fit.used], kind="stable")
        for i in by_error[:_TESTED_PHOTOS].tolist():
            without = _fit([*remaining[:i], *remaining[i + 1 :]], size, len(fit.lens))
            squares, corners = max(fit.squares - without.squares, 0), len(fit.used[i].errors)
            variance = max(without.squares / without.freedom, np.finfo(float).tiny)
            ratio = (squares / (2 * corners - 6)) / variance
            tests.append((ratio, math.sqrt(squares / corners), i, without))
        ratio, error, i, without = max(tests, key=lambda test: test[0])
        if ratio < _MAX_F_RATIO or error < _MAX_ERROR_PX:
            break
        odd.append(
            LeftOut(
                remaining.pop(i)[0],
                f"contradicts the others: {short(error, 2)} px off, "
                f"they agree within {short(compute_rms(without.used), 2)} px",
            )
        )
        fit = without
    return fit, odd


def _sum_squares(photo: UsedPhoto) -> float:
    return float(np.vdot(photo.errors, photo.errors))


# Photos become a calibration.

#: A note states the standard deviation of the focal length from this fraction of it on.
_VAGUE = 0.01
#: From this fraction on there is no calibration.
_UNKNOWN = 0.1
#: px: a larger error does not come from a sound board.
_LARGE_ERROR_PX = 1.0
#: A note warns if all corners are nearer to the middle of the photo than this fraction of the way
#: to its corners.
_MIN_REACH = 0.6


class Photo(Struct, frozen=True, eq=False):
    """A photo and the board in it.

    name: file of the photo.
    size: (width, height), px.
    seen: the board; None if it was not found.
    """

    name: str
    size: tuple[int, int]
    seen: SeenBoard | None


class Calibration(Struct, frozen=True, eq=False):
    """A calibrated camera.

    camera: camera matrix and n lens coefficients.
    deviations: (4 + n,) standard deviations of fx, fy, cx, cy (px) and of the coefficients, from
        the scatter of the corners. A board that is not flat does not show in them.
    used: photos that the calibration is based on.
    left_out: the other photos.
    notes: weaknesses of the result.
    """

    camera: Camera
    deviations: FloatArray
    used: tuple[UsedPhoto, ...]
    left_out: tuple[LeftOut, ...]
    notes: tuple[Note, ...]

    @property
    def rms(self) -> float:
        """OpenCV's reprojection error, px: root mean square of the distances of all corners."""
        return compute_rms(self.used)


def calibrate(
    sources: Sequence[Source], target: Target, name: str, stage: Callable[[str], None]
) -> Calibration:
    """Calibrate the camera `name` from photos of a board.

    Photos of another size than most are left out: a calibration is for one size.

    stage: is called with a description of each step before it begins.

    Raises InputError for a photo that cannot be read or is turned, and for too few good photos.
    """
    photos: list[Photo] = []
    for source in sources:
        stage(f"photo {len(photos) + 1} of {len(sources)}")
        photos.append(read_photo(source, target))
    stage("calibrating")
    if not any(photo.seen for photo in photos):
        raise InputError(
            _name_all(photos),
            f"no photo shows the {target.label}",
            remedy=_suggest_board(sources, target),
        )
    return fit_camera(photos, target, name)


def read_photo(source: Source, target: Target) -> Photo:
    """Find the board in a photo.

    Raises InputError if the photo cannot be read, or was turned by its Exif orientation.
    """
    picture = read_picture(source, sensor=True)
    if picture.turned:
        raise InputError(
            picture.name,
            "is a TIFF turned by its Exif orientation, "
            "a lens calibration belongs to the pixels of the sensor",
            remedy="save the photos without the orientation, or leave this one out",
        )
    height, width = picture.pixels.shape[:2]
    return Photo(picture.name, (width, height), find_board(picture.pixels, target))


def fit_camera(photos: Sequence[Photo], target: Target, name: str) -> Calibration:
    """Calibrate the camera `name` from photos in which the board has been searched for.

    Raises InputError for too few good photos, and if they do not determine the camera.
    """
    size, same, other_sizes = _select_size(photos)
    good, left_out = _select_distinct(same, target)
    left_out = [*other_sizes, *left_out]
    if len(good) < LEAST_PHOTOS:
        why = f" ({left_out[0].name}: {left_out[0].why})" if left_out else ""
        raise InputError(
            _name_all(photos),
            f"{len(good)} of {counted(len(photos), 'photo')} can be used with the {target.label}, "
            f"{LEAST_PHOTOS} are needed{why}",
            remedy="take 10 to 20 different ones: the whole board, sharp, tilted, "
            "in all parts of the view",
        )
    fit, odd, notes = fit_agreeing(good, size)
    if not fit.deviations[:2].max() < _UNKNOWN * fit.matrix[:2, :2].max():
        raise InputError(
            _name_all(photos), "the photos do not determine the focal length", remedy=TILT
        )
    camera = Camera(frozen(fit.matrix), frozen(fit.lens), size, name)
    notes += _note_weaknesses(camera, fit)
    return Calibration(camera, frozen(fit.deviations), fit.used, (*left_out, *odd), tuple(notes))


def _select_size(photos: Sequence[Photo]) -> tuple[tuple[int, int], list[Photo], list[LeftOut]]:
    """Select the photos of the most frequent size, px, and leave out the others.

    Photos with a board count, all photos if none has one. If two sizes are equally frequent, the
    one that comes first is taken.
    """
    sizes = [photo.size for photo in photos if photo.seen] or [photo.size for photo in photos]
    size = max(dict.fromkeys(sizes), key=sizes.count)
    selected: list[Photo] = []
    left_out: list[LeftOut] = []
    for photo in photos:
        if photo.size == size:
            selected.append(photo)
        else:
            why = f"is {photo.size[0]} x {photo.size[1]} px, not {size[0]} x {size[1]}"
            left_out.append(LeftOut(photo.name, f"{why}: a calibration is for one size"))
    return size, selected, left_out


def _select_distinct(
    photos: Sequence[Photo], target: Target
) -> tuple[list[tuple[str, SeenBoard]], list[LeftOut]]:
    """Select the photos with a board, without copies, and leave out the others."""
    good: list[tuple[str, SeenBoard]] = []
    left_out: list[LeftOut] = []
    for photo in photos:
        if photo.seen is None:
            left_out.append(
                LeftOut(
                    photo.name, f"{target.label} not found: covered, cut off, blurred or not there"
                )
            )
            continue
        corners = photo.seen.corners
        twins = [name for name, board in good if np.array_equal(board.corners, corners)]
        if twins:
            left_out.append(LeftOut(photo.name, f"the same picture as {twins[0]}"))
        else:
            good.append((photo.name, photo.seen))
    return good, left_out


def _suggest_board(sources: Sequence[Source], target: Target) -> str:
    """The remedy if no photo shows the board.

    The first photos are searched for a chessboard that is smaller by one each way: the user may
    have counted squares, not corners.
    """
    if not isinstance(target, Chessboard):
        return "--board counts the squares of a ChArUco board; check --dictionary, and the light"
    if min(target.columns, target.rows) > 3:
        smaller = Chessboard(target.columns - 1, target.rows - 1, target.square)
        if any(read_photo(source, smaller).seen for source in sources[:LEAST_PHOTOS]):
            return (
                f"they show a {smaller.label}: "
                f"give --board {smaller.columns}x{smaller.rows}, the inner corners"
            )
    return (
        "--board counts inner corners, one fewer than squares each way; "
        "a board with markers needs --marker"
    )


def _name_all(photos: Sequence[Photo]) -> str:
    """The name of the first photo and the number of the others."""
    others = len(photos) - 1
    return photos[0].name + (f" and {others} more" if others else "")


def _note_weaknesses(camera: Camera, fit: LensFit) -> list[Note]:
    """Notes on a vague focal length, large errors, and parts of the photo without corners."""
    notes = []
    vague = float((fit.deviations[:2] / np.diag(fit.matrix)[:2]).max())
    if vague > _VAGUE:
        notes.append(Note("warning", f"focal length known to {short(100 * vague, 1)} % only", TILT))
    if compute_rms(fit.used) > _LARGE_ERROR_PX:
        notes.append(
            Note(
                "warning",
                f"errors of {short(compute_rms(fit.used), 2)} px are large",
                "is the board flat, are all photos of one camera with one zoom, and sharp?",
            )
        )
    middle = camera.matrix[:2, 2]
    reach = max(
        float(np.linalg.norm(photo.seen.corners - middle, axis=1).max()) for photo in fit.used
    )
    fraction = reach / float(np.linalg.norm(_sample_border(camera.size) - middle, axis=1).max())
    if not can_undistort_border(camera):
        notes.append(
            Note(
                "warning",
                "the lens model shows nothing in the corners of the photo",
                "no board was seen there: take photos with the board in the corners",
            )
        )
    elif fraction < _MIN_REACH:
        notes.append(
            Note(
                "warning",
                f"no corner seen beyond {short(100 * fraction, 0)} % of the way "
                "to the photo's corners",
                "the lens is a guess further out: take photos with the board there",
            )
        )
    return notes
