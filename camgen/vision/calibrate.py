"""Lens calibration from photos of a board: Zhang's method as OpenCV has it, on corners that are fitted more exactly.

What is done with which photo, and what the user is told about the result; the fit itself is in calibrate_fit.py.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from msgspec import Struct

from camgen.errors import InputError
from camgen.pose import FloatArray, frozen
from camgen.shapes import Note
from camgen.text import short
from camgen.vision.boards import Chessboard, Seen, Target, seen
from camgen.vision.calibrate_fit import LEAST_PHOTOS, TILT, Fit, LeftOut, Used, best_fit, border, holds, rms
from camgen.vision.camera import Camera
from camgen.vision.image import load

#: Standard deviation of the focal length as a part of it: from where it is said, and from where it is no result.
_VAGUE, _UNKNOWN = 0.01, 0.1
#: An error that no sound board has, px; a part of the way from the middle to the corners of the photo.
_LARGE, _FAR = 1.0, 0.6


class Photo(Struct, frozen=True, eq=False):
    """A photo of ``size`` (width, height) px, and the board in it, if there is one."""

    name: str
    size: tuple[int, int]
    seen: Seen | None


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


def calibrate(paths: Sequence[Path], target: Target, name: str, stage: Callable[[str], None]) -> Calibration:
    """The camera ``name`` that took these photos of the board. ``stage`` is told what is being done.

    InputError for a photo that cannot be read, is turned or of another size than most, and for too few good ones.
    """
    photos: list[Photo] = []
    for path in paths:
        stage(f"photo {len(photos) + 1} of {len(paths)}")
        photos.append(photographed(path, target))
    stage("calibrating")
    if not any(photo.seen for photo in photos):
        raise InputError(_together(photos), f"no photo shows the {target.label}", remedy=_other_board(paths, target))
    return calibrated(photos, target, name)


def photographed(path: Path, target: Target) -> Photo:
    """The board in the photo of this file. InputError if it cannot be read, or was turned by its Exif orientation."""
    picture = load(path, sensor=True)
    if picture.turned:
        what = "is a TIFF turned by its Exif orientation, a lens calibration belongs to the pixels of the sensor"
        raise InputError(picture.name, what, remedy="save the photos without the orientation, or leave this one out")
    height, width = picture.pixels.shape[:2]
    return Photo(picture.name, (width, height), seen(picture.pixels, target))


def calibrated(photos: Sequence[Photo], target: Target, name: str) -> Calibration:
    """The camera from photos in which the board has been sought. InputError as for ``calibrate``."""
    size = _one_size(photos)
    good, left_out = _distinct(photos, target)
    if len(good) < LEAST_PHOTOS:
        what = f"{len(good)} of {len(photos)} photos can be used with the {target.label}, {LEAST_PHOTOS} are needed"
        why = f" ({left_out[0].name}: {left_out[0].why})" if left_out else ""
        remedy = "take 10 to 20 different ones: the whole board, sharp, tilted, in all parts of the view"
        raise InputError(_together(photos), what + why, remedy=remedy)
    fit, odd, notes = best_fit(good, size)
    if not fit.deviations[:2].max() < _UNKNOWN * fit.matrix[:2, :2].max():
        raise InputError(_together(photos), "the photos do not tell the focal length", remedy=TILT)
    camera = Camera(frozen(fit.matrix), frozen(fit.lens), size, name)
    notes += _doubts(camera, fit)
    return Calibration(camera, frozen(fit.deviations), fit.used, (*left_out, *odd), tuple(notes))


def _one_size(photos: Sequence[Photo]) -> tuple[int, int]:
    sizes = [photo.size for photo in photos]
    most = max(dict.fromkeys(sizes), key=sizes.count)
    other = next((photo for photo in photos if photo.size != most), None)
    if other is not None:
        what = f"is {other.size[0]} x {other.size[1]} px, {sizes.count(most)} of {len(sizes)} are {most[0]} x {most[1]}"
        raise InputError(other.name, what, remedy="a calibration is for one camera and one size; leave this photo out")
    return most


def _distinct(photos: Sequence[Photo], target: Target) -> tuple[list[tuple[str, Seen]], list[LeftOut]]:
    """The photos with a board, each once, and why not the others."""
    good: list[tuple[str, Seen]] = []
    left_out: list[LeftOut] = []
    for photo in photos:
        if photo.seen is None:
            left_out.append(LeftOut(photo.name, f"{target.label} not found: covered, cut off, blurred or not there"))
            continue
        twin = next((name for name, one in good if np.array_equal(one.corners, photo.seen.corners)), None)
        if twin is None:
            good.append((photo.name, photo.seen))
        else:
            left_out.append(LeftOut(photo.name, f"the same picture as {twin}"))
    return good, left_out


def _other_board(paths: Sequence[Path], target: Target) -> str:
    """What to do where no photo shows the board: it may be that squares were counted, not corners."""
    if isinstance(target, Chessboard):
        if min(target.columns, target.rows) > 3:
            fewer = Chessboard(target.columns - 1, target.rows - 1, target.square)
            if any(photographed(path, fewer).seen for path in paths[:LEAST_PHOTOS]):
                return f"they show a {fewer.label}: give --board {fewer.columns}x{fewer.rows}, the inner corners"
        return "--board counts inner corners, one fewer than squares each way; a board with markers needs --marker"
    return "--board counts the squares of a ChArUco board; check --dictionary, and the light"


def _together(photos: Sequence[Photo]) -> str:
    more = len(photos) - 1
    return photos[0].name + (f" and {more} more" if more else "")


def _doubts(camera: Camera, fit: Fit) -> list[Note]:
    """What makes this calibration worse than it could be."""
    notes = []
    vague = float((fit.deviations[:2] / np.diag(fit.matrix)[:2]).max())
    if vague > _VAGUE:
        notes.append(Note("warning", f"focal length known to {short(100 * vague, 1)} % only", TILT))
    if rms(fit.used) > _LARGE:
        why = "is the board flat, are all photos of one camera with one zoom, and sharp?"
        notes.append(Note("warning", f"errors of {short(rms(fit.used), 2)} px are large", why))
    middle = camera.matrix[:2, 2]
    seen_to = max(float(np.linalg.norm(one.seen.corners - middle, axis=1).max()) for one in fit.used)
    part = seen_to / float(np.linalg.norm(border(camera.size) - middle, axis=1).max())
    if not holds(camera):
        what = "the lens model shows nothing in the corners of the photo"
        notes.append(Note("warning", what, "no board was seen there: take photos with the board in the corners"))
    elif part < _FAR:
        what = f"no corner seen beyond {short(100 * part, 0)} % of the way to the photo's corners"
        notes.append(Note("warning", what, "the lens is a guess further out: take photos with the board there"))
    return notes
