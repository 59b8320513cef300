"""Lens calibration from photos of a board: Zhang's method as OpenCV has it, on corners that are fitted more exactly.

Photos are measured, compared and left out, ``best_fit`` fits the lens, and notes name the doubts about the result.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.model.errors import InputError
from camgen.model.files import Source
from camgen.model.part import Note
from camgen.model.pose import FloatArray, frozen
from camgen.model.text import counted, short
from camgen.vision.boards.corners import Chessboard, SeenBoard, Target, find_board
from camgen.vision.camera.camera import Camera, undistort
from camgen.vision.image import load

# Camera, lens and board poses that fit the corners of many photos, and which of the photos contradict the others.

#: So few photos can be calibrated from, if the board is tilted in them.
LEAST_PHOTOS = 3
TILT = "take photos with the board tilted by 20 to 40 deg in different directions"
#: OpenCV's count of coefficients, and the one for wide angles.
_USUAL_LENS, _WIDE_ANGLE = 5, 8
#: Eight coefficients must divide the middle photo's error by so much, and gain so much, px.
_BETTER, _GAIN = 2.0, 0.05
#: A photo is left out if its F ratio and its error, px, are larger; so many of the worst ones are looked at each time.
_CONTRADICTS, _OFF, _TRIED = 6.0, 0.1, 3
_ROUNDS, _SETTLED = 100, 1e-12


class Used(Struct, frozen=True, eq=False):
    """A photo that the calibration rests on. errors: (N, 2) px, the corners as seen less as calculated."""

    name: str
    seen: SeenBoard
    errors: FloatArray

    @property
    def rms(self) -> float:
        """Root mean square of the distances, px."""
        return rms([self])

    @property
    def worst(self) -> float:
        """The largest distance, px."""
        return float(np.linalg.norm(self.errors, axis=1).max())


class LeftOut(Struct, frozen=True):
    """A photo that the calibration does not rest on."""

    name: str
    why: str


class LensFit(Struct, frozen=True, eq=False):
    """matrix (3, 3) px and lens (n,) that fit the photos used best; the standard deviations (4 + n,) of fx, fy, cx, cy
    (px) and the coefficients.
    """

    matrix: FloatArray
    lens: FloatArray
    deviations: FloatArray
    used: tuple[Used, ...]

    @property
    def middle(self) -> float:
        """The error of the middle photo, px."""
        return float(np.median([one.rms for one in self.used]))

    @property
    def squares(self) -> float:
        """The sum of all squared distances, px^2."""
        return sum(_squares(one) for one in self.used)

    @property
    def freedom(self) -> int:
        """Measured numbers less calculated ones: the camera's, and a pose per photo."""
        return sum(2 * len(one.errors) - 6 for one in self.used) - len(self.deviations)


def best_fit(
    boards: Sequence[tuple[str, SeenBoard]], size: tuple[int, int]
) -> tuple[LensFit, list[LeftOut], list[Note]]:
    """The fit to the photos (name, board) of ``size`` px that agree with each other, those left out, and the lens
    model's note. InputError if they do not determine a camera.
    """
    with _one_thread():
        usual, odd = _agreeing(boards, size, _fit(boards, size, _USUAL_LENS))
        if not odd and usual.middle < _GAIN:
            return usual, odd, []
        wide, odd_wide = _agreeing(boards, size, _fit(boards, size, _WIDE_ANGLE))
    better = wide.middle * _BETTER < usual.middle and usual.middle - wide.middle > _GAIN
    whole, whole_wide = (holds(Camera(fit.matrix, fit.lens, size, "")) for fit in (usual, wide))
    if not (len(odd_wide) < len(odd) or better) or (whole and not whole_wide):
        return usual, odd, []
    agreed = [
        f"{len(fit.used)} photos agree within {short(rms(fit.used), 2)} px" for fit in (usual, wide)
    ]
    why = f"with {_USUAL_LENS} of them {agreed[0]}, with all {_WIDE_ANGLE} {agreed[1]}"
    return (
        wide,
        odd_wide,
        [Note("assumed", f"a wide-angle lens of {_WIDE_ANGLE} coefficients", why)],
    )


@contextmanager
def _one_thread() -> Iterator[None]:
    """Several threads add up in an order of chance: the last digits of a calibration would differ from run to run."""
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(before)


def rms(used: Sequence[Used]) -> float:
    """Root mean square of the distances of all corners, px."""
    return math.sqrt(sum(_squares(one) for one in used) / sum(len(one.errors) for one in used))


def holds(camera: Camera) -> bool:
    """Whether the lens model has an answer all along the border of the photo."""
    return bool(np.isfinite(undistort(camera, border(camera.size))).all())


def border(size: tuple[int, int]) -> FloatArray:
    """Pixels (N, 2) around a photo of ``size`` (width, height)."""
    u, v = (np.linspace(0, length - 1, 17) for length in size)
    sides = [np.column_stack([u, np.full(17, y)]) for y in v[[0, -1]]]
    sides += [np.column_stack([np.full(17, x), v]) for x in u[[0, -1]]]
    return np.concatenate(sides)


def _fit(boards: Sequence[tuple[str, SeenBoard]], size: tuple[int, int], count: int) -> LensFit:
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    places = [
        np.column_stack([seen.places, np.zeros(len(seen.places))]).astype(np.float32)
        for _, seen in boards
    ]
    corners = [seen.corners.astype(np.float32) for _, seen in boards]
    flags = cv2.CALIB_RATIONAL_MODEL if count == _WIDE_ANGLE else 0
    until = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, _ROUNDS, _SETTLED)
    try:
        found = cv2.calibrateCamera(places, corners, size, None, None, flags=flags, criteria=until)
    except cv2.error as error:
        what = "OpenCV cannot calibrate from this photo and the others"
        raise InputError(boards[0][0], what, " ".join(error.err.split()), TILT) from error
    _, _, _, turns, shifts = found
    matrix, lens = (np.asarray(values, dtype=np.float64) for values in found[1:3])
    if not (np.isfinite(matrix).all() and np.isfinite(lens).all()):
        raise InputError(
            boards[0][0], "OpenCV finds no camera that took this photo and the others", remedy=TILT
        )
    lens = lens.ravel()[:count]
    used, known = [], np.zeros((4 + count, 4 + count))
    for (name, board), place, turn, shift in zip(boards, places, turns, shifts, strict=True):
        at, slopes = cv2.projectPoints(place.astype(np.float64), turn, shift, matrix, lens)
        used.append(Used(name, board, frozen(board.corners - at.reshape(-1, 2))))
        # What the pose of this board explains tells nothing about the camera.
        pose = np.linalg.qr(slopes[:, :6])[0]
        free = slopes[:, 6 : 10 + count] - pose @ (pose.T @ slopes[:, 6 : 10 + count])
        known += free.T @ free
    fit = LensFit(matrix, lens, np.zeros(4 + count), tuple(used))
    return replace(fit, deviations=_deviations(known, fit.squares / fit.freedom))


def _deviations(known: FloatArray, variance: float) -> FloatArray:
    """Standard deviations from the normal matrix; inf where it tells nothing. OpenCV says 0 then."""
    scale = np.sqrt(np.diag(known)).clip(np.finfo(float).tiny)
    values, vectors = np.linalg.eigh(known / np.outer(scale, scale))
    with np.errstate(divide="ignore"):
        spread: FloatArray = np.sqrt(variance * (vectors**2 / values.clip(0)).sum(axis=1)) / scale
    return spread


def _agreeing(
    boards: Sequence[tuple[str, SeenBoard]], size: tuple[int, int], fit: LensFit
) -> tuple[LensFit, list[LeftOut]]:
    """The fit to the photos that agree with each other, and the others, the worst one first."""
    odd: list[LeftOut] = []
    kept = list(boards)
    while len(kept) > LEAST_PHOTOS:
        tried = []
        for i in np.argsort([-one.rms for one in fit.used], kind="stable")[:_TRIED].tolist():
            rest = _fit([*kept[:i], *kept[i + 1 :]], size, len(fit.lens))
            lost, corners = max(fit.squares - rest.squares, 0), len(fit.used[i].errors)
            ratio = (lost / (2 * corners - 6)) / max(
                rest.squares / rest.freedom, np.finfo(float).tiny
            )
            tried.append((ratio, math.sqrt(lost / corners), i, rest))
        ratio, off, i, rest = max(tried, key=lambda one: one[0])
        if ratio < _CONTRADICTS or off < _OFF:
            break
        why = f"contradicts the others: {short(off, 2)} px off, they agree within {short(rms(rest.used), 2)} px"
        odd.append(LeftOut(kept.pop(i)[0], why))
        fit = rest
    return fit, odd


def _squares(one: Used) -> float:
    return float(np.vdot(one.errors, one.errors))


#: Standard deviation of the focal length as a part of it: from where it is said, and from where it is no result.
_VAGUE, _UNKNOWN = 0.01, 0.1
#: An error that no sound board has, px; a part of the way from the middle to the corners of the photo.
_LARGE_PX, _FAR_SHARE = 1.0, 0.6


class Photo(Struct, frozen=True, eq=False):
    """A photo of ``size`` (width, height) px, and the board in it, if there is one."""

    name: str
    size: tuple[int, int]
    seen: SeenBoard | None


class Calibration(Struct, frozen=True, eq=False):
    """The camera, the standard deviations (4 + n,) of fx, fy, cx, cy (px) and its n coefficients, and the photos.

    The deviations are what the corners' scatter makes of these numbers; they do not know a board that is not flat.
    """

    camera: Camera
    deviations: FloatArray
    used: tuple[Used, ...]
    left_out: tuple[LeftOut, ...]
    notes: tuple[Note, ...]

    @property
    def rms(self) -> float:
        """Root mean square of the distances of all corners used, px; OpenCV's reprojection error."""
        return rms(self.used)


def calibrate(
    sources: Sequence[Source], target: Target, name: str, stage: Callable[[str], None]
) -> Calibration:
    """The camera ``name`` that took these photos of the board. ``stage`` is told what is being done.

    Photos of another size than most are left out: a calibration is for one size. InputError for a photo that cannot be
    read or is turned, and for too few good ones.
    """
    photos: list[Photo] = []
    for source in sources:
        stage(f"photo {len(photos) + 1} of {len(sources)}")
        photos.append(photograph(source, target))
    stage("calibrating")
    if not any(photo.seen for photo in photos):
        raise InputError(
            _together(photos),
            f"no photo shows the {target.label}",
            remedy=_other_board(sources, target),
        )
    return fit_camera(photos, target, name)


def photograph(source: Source, target: Target) -> Photo:
    """The board in a photo. InputError if it cannot be read, or was turned by its Exif orientation."""
    picture = load(source, sensor=True)
    if picture.turned:
        what = "is a TIFF turned by its Exif orientation, a lens calibration belongs to the pixels of the sensor"
        raise InputError(
            picture.name,
            what,
            remedy="save the photos without the orientation, or leave this one out",
        )
    height, width = picture.pixels.shape[:2]
    return Photo(picture.name, (width, height), find_board(picture.pixels, target))


def fit_camera(photos: Sequence[Photo], target: Target, name: str) -> Calibration:
    """The camera from photos in which the board has been sought. InputError as for ``calibrate``."""
    size, same, odd_sizes = _of_one_size(photos)
    good, left_out = _distinct(same, target)
    left_out = [*odd_sizes, *left_out]
    if len(good) < LEAST_PHOTOS:
        usable = f"{len(good)} of {counted(len(photos), 'photo')}"
        what = f"{usable} can be used with the {target.label}, {LEAST_PHOTOS} are needed"
        why = f" ({left_out[0].name}: {left_out[0].why})" if left_out else ""
        remedy = (
            "take 10 to 20 different ones: the whole board, sharp, tilted, in all parts of the view"
        )
        raise InputError(_together(photos), what + why, remedy=remedy)
    fit, odd, notes = best_fit(good, size)
    if not fit.deviations[:2].max() < _UNKNOWN * fit.matrix[:2, :2].max():
        raise InputError(_together(photos), "the photos do not tell the focal length", remedy=TILT)
    camera = Camera(frozen(fit.matrix), frozen(fit.lens), size, name)
    notes += _doubts(camera, fit)
    return Calibration(camera, frozen(fit.deviations), fit.used, (*left_out, *odd), tuple(notes))


def _of_one_size(photos: Sequence[Photo]) -> tuple[tuple[int, int], list[Photo], list[LeftOut]]:
    """The size in pixels that most photos with a board have (of all where none has one), the photos of it, the others.

    Of two sizes that are as frequent it is that of the first photo.
    """
    sizes = [photo.size for photo in photos if photo.seen] or [photo.size for photo in photos]
    most = max(dict.fromkeys(sizes), key=sizes.count)
    usual = f"{most[0]} x {most[1]}"
    left_out = [
        LeftOut(
            photo.name,
            f"is {photo.size[0]} x {photo.size[1]} px, not {usual}: a calibration is for one size",
        )
        for photo in photos
        if photo.size != most
    ]
    return most, [photo for photo in photos if photo.size == most], left_out


def _distinct(
    photos: Sequence[Photo], target: Target
) -> tuple[list[tuple[str, SeenBoard]], list[LeftOut]]:
    """The photos with a board, each once, and why not the others."""
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
        twin = next(
            (name for name, one in good if np.array_equal(one.corners, photo.seen.corners)), None
        )
        if twin is None:
            good.append((photo.name, photo.seen))
        else:
            left_out.append(LeftOut(photo.name, f"the same picture as {twin}"))
    return good, left_out


def _other_board(sources: Sequence[Source], target: Target) -> str:
    """What to do where no photo shows the board: it may be that squares were counted, not corners."""
    if isinstance(target, Chessboard):
        if min(target.columns, target.rows) > 3:
            fewer = Chessboard(target.columns - 1, target.rows - 1, target.square)
            if any(photograph(source, fewer).seen for source in sources[:LEAST_PHOTOS]):
                return f"they show a {fewer.label}: give --board {fewer.columns}x{fewer.rows}, the inner corners"
        return "--board counts inner corners, one fewer than squares each way; a board with markers needs --marker"
    return "--board counts the squares of a ChArUco board; check --dictionary, and the light"


def _together(photos: Sequence[Photo]) -> str:
    more = len(photos) - 1
    return photos[0].name + (f" and {more} more" if more else "")


def _doubts(camera: Camera, fit: LensFit) -> list[Note]:
    """What makes this calibration worse than it could be."""
    notes = []
    vague = float((fit.deviations[:2] / np.diag(fit.matrix)[:2]).max())
    if vague > _VAGUE:
        notes.append(Note("warning", f"focal length known to {short(100 * vague, 1)} % only", TILT))
    if rms(fit.used) > _LARGE_PX:
        why = "is the board flat, are all photos of one camera with one zoom, and sharp?"
        notes.append(Note("warning", f"errors of {short(rms(fit.used), 2)} px are large", why))
    middle = camera.matrix[:2, 2]
    seen_to = max(
        float(np.linalg.norm(one.seen.corners - middle, axis=1).max()) for one in fit.used
    )
    part = seen_to / float(np.linalg.norm(border(camera.size) - middle, axis=1).max())
    if not holds(camera):
        what = "the lens model shows nothing in the corners of the photo"
        notes.append(
            Note(
                "warning",
                what,
                "no board was seen there: take photos with the board in the corners",
            )
        )
    elif part < _FAR_SHARE:
        what = f"no corner seen beyond {short(100 * part, 0)} % of the way to the photo's corners"
        notes.append(
            Note(
                "warning", what, "the lens is a guess further out: take photos with the board there"
            )
        )
    return notes
