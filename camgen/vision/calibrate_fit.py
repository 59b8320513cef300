"""Camera, lens and board poses that fit the corners of many photos, and which of the photos contradict the others.

Every corner weighs the same. The lens gets OpenCV's five coefficients; eight only where they halve the error of the
middle photo, or where photos agree with the others that otherwise would not.

A photo that contradicts the others is left out. Whether one does is judged by the
sum of squares that the fit loses without it, per degree of freedom, against what remains (an F ratio): a sound photo
that alone shows a part of the view loses no more than the others, however much it changes the result.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.errors import InputError
from camgen.pose import FloatArray, frozen
from camgen.shapes import Note
from camgen.text import short
from camgen.vision.boards import Seen
from camgen.vision.camera import Camera, undistorted

#: So few photos can be calibrated from, if the board is tilted in them.
LEAST_PHOTOS = 3
TILT = "take photos with the board tilted by 20 to 40 deg in different directions"
#: OpenCV's count of coefficients, and the one for wide angles.
_USUAL, _WIDE = 5, 8
#: Eight coefficients must divide the middle photo's error by so much, and gain so much, px.
_BETTER, _GAIN = 2.0, 0.05
#: A photo is left out if its F ratio and its error, px, are larger; so many of the worst ones are looked at each time.
_CONTRADICTS, _OFF, _TRIED = 6.0, 0.1, 3
_ROUNDS, _SETTLED = 100, 1e-12


class Used(Struct, frozen=True, eq=False):
    """A photo that the calibration rests on. errors: (N, 2) px, the corners as seen less as calculated."""

    name: str
    seen: Seen
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


class Fit(Struct, frozen=True, eq=False):
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


def best_fit(boards: Sequence[tuple[str, Seen]], size: tuple[int, int]) -> tuple[Fit, list[LeftOut], list[Note]]:
    """The fit to the photos (name, board) of ``size`` px that agree with each other, those left out, and the lens
    model's note. InputError if they do not determine a camera.
    """
    with _one_thread():
        usual, odd = _agreeing(boards, size, _fit(boards, size, _USUAL))
        if not odd and usual.middle < _GAIN:
            return usual, odd, []
        wide, odd_wide = _agreeing(boards, size, _fit(boards, size, _WIDE))
    better = wide.middle * _BETTER < usual.middle and usual.middle - wide.middle > _GAIN
    whole, whole_wide = (holds(Camera(fit.matrix, fit.lens, size, "")) for fit in (usual, wide))
    if not (len(odd_wide) < len(odd) or better) or (whole and not whole_wide):
        return usual, odd, []
    agreed = [f"{len(fit.used)} photos agree within {short(rms(fit.used), 2)} px" for fit in (usual, wide)]
    why = f"with {_USUAL} of them {agreed[0]}, with all {_WIDE} {agreed[1]}"
    return wide, odd_wide, [Note("assumed", f"a wide-angle lens of {_WIDE} coefficients", why)]


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
    return bool(np.isfinite(undistorted(camera, border(camera.size))).all())


def border(size: tuple[int, int]) -> FloatArray:
    """Pixels (N, 2) around a photo of ``size`` (width, height)."""
    u, v = (np.linspace(0, length - 1, 17) for length in size)
    sides = [np.column_stack([u, np.full(17, y)]) for y in v[[0, -1]]]
    sides += [np.column_stack([np.full(17, x), v]) for x in u[[0, -1]]]
    return np.concatenate(sides)


def _fit(boards: Sequence[tuple[str, Seen]], size: tuple[int, int], count: int) -> Fit:
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    places = [np.column_stack([seen.places, np.zeros(len(seen.places))]).astype(np.float32) for _, seen in boards]
    corners = [seen.corners.astype(np.float32) for _, seen in boards]
    flags = cv2.CALIB_RATIONAL_MODEL if count == _WIDE else 0
    until = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, _ROUNDS, _SETTLED)
    try:
        found = cv2.calibrateCamera(places, corners, size, None, None, flags=flags, criteria=until)
    except cv2.error as error:
        what = "OpenCV cannot calibrate from this photo and the others"
        raise InputError(boards[0][0], what, " ".join(error.err.split()), TILT) from error
    _, _, _, turns, shifts = found
    matrix, lens = (np.asarray(values, dtype=np.float64) for values in found[1:3])
    if not (np.isfinite(matrix).all() and np.isfinite(lens).all()):
        raise InputError(boards[0][0], "OpenCV finds no camera that took this photo and the others", remedy=TILT)
    lens = lens.ravel()[:count]
    used, known = [], np.zeros((4 + count, 4 + count))
    for (name, seen), place, turn, shift in zip(boards, places, turns, shifts, strict=True):
        at, slopes = cv2.projectPoints(place.astype(np.float64), turn, shift, matrix, lens)
        used.append(Used(name, seen, frozen(seen.corners - at.reshape(-1, 2))))
        # What the pose of this board explains tells nothing about the camera.
        pose = np.linalg.qr(slopes[:, :6])[0]
        free = slopes[:, 6 : 10 + count] - pose @ (pose.T @ slopes[:, 6 : 10 + count])
        known += free.T @ free
    fit = Fit(matrix, lens, np.zeros(4 + count), tuple(used))
    return replace(fit, deviations=_deviations(known, fit.squares / fit.freedom))


def _deviations(known: FloatArray, variance: float) -> FloatArray:
    """Standard deviations from the normal matrix; inf where it tells nothing. OpenCV says 0 then."""
    scale = np.sqrt(np.diag(known)).clip(np.finfo(float).tiny)
    values, vectors = np.linalg.eigh(known / np.outer(scale, scale))
    with np.errstate(divide="ignore"):
        spread: FloatArray = np.sqrt(variance * (vectors**2 / values.clip(0)).sum(axis=1)) / scale
    return spread


def _agreeing(boards: Sequence[tuple[str, Seen]], size: tuple[int, int], fit: Fit) -> tuple[Fit, list[LeftOut]]:
    """The fit to the photos that agree with each other, and the others, the worst one first."""
    odd: list[LeftOut] = []
    kept = list(boards)
    while len(kept) > LEAST_PHOTOS:
        tried = []
        for i in np.argsort([-one.rms for one in fit.used], kind="stable")[:_TRIED].tolist():
            rest = _fit([*kept[:i], *kept[i + 1 :]], size, len(fit.lens))
            lost, corners = max(fit.squares - rest.squares, 0), len(fit.used[i].errors)
            ratio = (lost / (2 * corners - 6)) / max(rest.squares / rest.freedom, np.finfo(float).tiny)
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
