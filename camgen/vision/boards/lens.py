"""The lens that one photo of a marker sheet or a board shows: k1, k2, and f by the tilt.

The corners are fitted twice: by a homography alone, and by one that is seen through a lens,

    place = c + (q - c) (1 + k1 s + k2 s^2) + decentring by p1 and p2,   s = |q - c|^2

with q from the homography, in units of half the photo's diagonal, from its middle. In one photo,
c, p1 and p2 have nearly the same effect. So they have priors, which are their usual sizes. An
F-test with six degrees of freedom decides between both fits.

The focal length does not bend anything. It follows from the homography: the axes of the sheet are
equally long and at right angles (Zhang, 2000). Without a tilt, all focal lengths agree with that.
Then it is assumed to be that of an ordinary camera, and its interval is wide.
"""

from __future__ import annotations

import math

import numpy as np

from camgen.model.errors import JobError
from camgen.model.part import Note
from camgen.model.pose import FloatArray, frozen
from camgen.model.text import counted, short
from camgen.vision.camera.calibrate import can_undistort_border
from camgen.vision.camera.camera import Camera, undistort
from camgen.vision.camera.sheet_lens import SheetLens
from camgen.vision.plane import compute_homography_slopes, fit_homography, map_points

#: Corners below this number show no lens. They may show a focal length.
LEAST_CORNERS = 12
#: A lens is accepted if chance makes corners like these less often.
_CHANCE = 1e-4
#: Corners are not measured more exactly than this, px, as far as the test and the deviations go.
_EXACT_PX = 0.005
#: Points are measured to within this, px, where their residuals do not show it: if they exceed the
#: unknowns by less than the second number.
_READ_PX, _LEAST_FREEDOM = 0.5, 4
#: The share of the measurements that counts in the test: corners of a marker err alike.
_INDEPENDENT = 0.5
#: Usual sizes in half diagonals: of the way from the photo's middle to the principal point, of k2,
#: and of p1 and p2. k1 has no prior.
_PRIORS = {"c": 0.02, "k2": 0.05, "p": 5e-4}
#: A photo with its principal point further from the middle, in half diagonals, was cut: its lens
#: is that of its corners, and its focal length is not known.
_CUT = 0.1
#: Printers stretch paper, and pixels are not quite square: relative length of the sheet's axes.
_STRETCH = 0.002
#: Focal lengths that are tried, in half diagonals: field angles of the diagonal from 130 to 9 deg.
_FOCAL = np.geomspace(0.45, 12.0, 160)
#: Focal lengths agree with the corners up to this number of standard deviations. The best one
#: contradicts them beyond the second number.
AGREES, _CONTRADICTS = 3.0, 5.0
#: A focal length by the 35 mm focal length of the file is right to within this share: it is a whole
#: number of mm, and of the lens focused at infinity.
_BY_FILE = 0.05
#: The focal length is known if none that agrees is further off than by this factor.
_KNOWN = 1.25
#: Focal lengths of ordinary cameras, half diagonals: 22 to 130 mm for a frame of 24 x 36 mm. They
#: are assumed to enclose a focal length that is not known.
_ORDINARY = (1.0, 6.0)
_ROUNDS, _SETTLED = 40, 1e-10
#: Columns of the slopes: nine of the homography, then c, k1 and k2, p1 and p2.
_C, _K, _P = slice(9, 11), slice(11, 13), slice(13, 15)
_COUNT = 15


class Bend:
    """The model of a lens in half diagonals of the photo from its middle.

    centre: (2,), the principal point.
    lens: (4,), k1 k2 p1 p2.
    """

    def __init__(self, centre: FloatArray, lens: FloatArray) -> None:
        self.centre, self.lens = centre, lens

    def slopes(self, homography: FloatArray, places: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The image (N, 2) of places (N, 2), mm, and its derivatives (N, 2, 15).

        homography: (3, 3), from mm to half diagonals without a lens.
        """
        k1, k2, p1, p2 = self.lens.tolist()
        x, y = (map_points(homography, places) - self.centre).T
        s = x * x + y * y
        factor, rise = 1 + s * (k1 + s * k2), 2 * (k1 + 2 * k2 * s)
        seen = np.column_stack(
            [
                x * factor + 2 * p1 * x * y + p2 * (s + 2 * x * x),
                y * factor + p1 * (s + 2 * y * y) + 2 * p2 * x * y,
            ]
        )
        across = rise * x * y + 2 * (p1 * x + p2 * y)
        by_ideal = np.stack(
            [
                np.column_stack([factor + rise * x * x + 2 * p1 * y + 6 * p2 * x, across]),
                np.column_stack([across, factor + rise * y * y + 6 * p1 * y + 2 * p2 * x]),
            ],
            axis=1,
        )
        slopes = np.zeros((len(places), 2, _COUNT))
        slopes[:, :, :9] = by_ideal @ compute_homography_slopes(homography, places)
        slopes[:, :, _C] = np.eye(2) - by_ideal
        for column, power in zip(range(_K.start, _K.stop), (s, s * s), strict=True):
            slopes[:, 0, column], slopes[:, 1, column] = x * power, y * power
        twice = 2 * x * y
        slopes[:, 0, _P] = np.column_stack([twice, s + 2 * x * x])
        slopes[:, 1, _P] = np.column_stack([s + 2 * y * y, twice])
        return seen + self.centre, slopes

    def prior_rows(self, sigma: float) -> tuple[FloatArray, FloatArray]:
        """The priors as measurements of deviation ``sigma``: slopes (5, 15) and values (5,)."""
        rows = np.zeros((5, _COUNT))
        values = np.array([*self.centre, self.lens[1], *self.lens[2:]])
        sizes = np.array([_PRIORS["c"]] * 2 + [_PRIORS["k2"]] + [_PRIORS["p"]] * 2)
        rows[np.arange(5), (9, 10, 12, 13, 14)] = sigma / sizes
        return rows, -values * sigma / sizes


def find_bend(camera: Camera) -> tuple[Bend, FloatArray, float]:
    """The lens of a `SheetLens`, the middle of its photo (2,) and half the diagonal, px."""
    middle, half = _frame(camera.size)
    scales = (half / camera.matrix[0, 0]) ** np.array([2, 4, 1, 1])
    lens = camera.distortion * scales if len(camera.distortion) else np.zeros(4)
    return Bend((camera.matrix[:2, 2] - middle) / half, lens), middle, half


def _frame(size: tuple[int, int]) -> tuple[FloatArray, float]:
    middle = (np.array(size) - 1) / 2
    return middle, float(np.linalg.norm(middle))


class _Fit:
    """A fit to the corners, in half diagonals.

    homography: (3, 3), from mm.
    bend: the lens.
    squares: the sum of the squared residuals.
    sigma: the standard deviation of the corners.
    covariance: (15, 15), of the numbers of homography and lens.
    """

    def __init__(self, px: FloatArray, mm: FloatArray, exact: float, bends: bool) -> None:
        self.homography = fit_homography(mm, px)
        self.bend = Bend(np.zeros(2), np.zeros(4))
        used = np.arange(_COUNT if bends else _K.start)
        freedom = 2 * len(px) - (14 if bends else 8)
        for _ in range(_ROUNDS):
            seen, slopes = self.bend.slopes(self.homography, mm)
            error = (px - seen).ravel()
            self.squares = float(error @ error)
            self.sigma = max(math.sqrt(self.squares / max(freedom, 1)), exact)
            prior, values = self.bend.prior_rows(self.sigma)
            rows = np.vstack([slopes.reshape(-1, _COUNT), prior])[:, used]
            inverse = np.linalg.pinv(rows, rcond=1e-12)
            step = np.zeros(_COUNT)
            step[used] = inverse @ np.concatenate([error, values])
            moved = self.homography + step[:9].reshape(3, 3)
            self.homography = moved / np.linalg.norm(moved)
            self.bend = Bend(self.bend.centre + step[_C], self.bend.lens + step[_K.start :])
            if np.abs(step).max() < _SETTLED:
                break
        self.covariance = np.zeros((_COUNT, _COUNT))
        self.covariance[np.ix_(used, used)] = self.sigma**2 * inverse @ inverse.T

    def _axes(self, focal: float, steps: FloatArray) -> FloatArray:
        """Relative length and cosine (S, 2) of the axes after steps (S, 11) of the numbers."""
        homography = self.homography + steps[:, :9].reshape(-1, 3, 3)
        centre = self.bend.centre + steps[:, 9:]
        plane = homography[:, :2, :2] - centre[:, :, None] * homography[:, 2:, :2]
        axes = np.concatenate([plane / focal, homography[:, 2:, :2]], axis=1)
        lengths = np.linalg.norm(axes, axis=1)
        cosines = (axes[:, :, 0] * axes[:, :, 1]).sum(axis=1) / lengths.prod(axis=1)
        return np.column_stack([np.log(lengths[:, 0] / lengths[:, 1]), cosines])

    def contradiction(self, focal: float) -> float:
        """The squared distance of a focal length from agreement with the sheet, in deviations."""
        steps = 1e-6 * np.eye(11)
        axes = self._axes(focal, np.vstack([np.zeros((1, 11)), steps, -steps]))
        slopes = (axes[1:12] - axes[12:]).T / 2e-6
        variance = slopes @ self.covariance[:11, :11] @ slopes.T + _STRETCH**2 * np.eye(2)
        return float(axes[0] @ np.linalg.solve(variance, axes[0]))


def compute_chance(with_lens: float, without: float, freedom: float) -> float:
    """The probability that six more parameters gain as much by chance: the F-test, in closed form.

    with_lens, without: sums of squares.
    """
    ratio, half = min(with_lens / without, 1.0), freedom / 2
    gain = 1 - ratio
    return float(ratio**half * (1 + half * gain + half * (half + 1) / 2 * gain**2))


def fit_sheet_lens(
    px: FloatArray,
    mm: FloatArray,
    size: tuple[int, int],
    needs_focal: bool,
    focal_px: float | None = None,
) -> SheetLens | None:
    """The lens that corners (N, 2), px and mm, of a sheet show in a photo of ``size`` px.

    needs_focal: whether a camera is of use that bends nothing. Four corners are enough for it.
    focal_px: the focal length by the photo's file, px.
    None: they show no lens, or one that cannot be used.
    """
    if len(px) < (4 if needs_focal else LEAST_CORNERS):
        return None
    middle, half = _frame(size)
    corners = (px - middle) / half
    exact = (_EXACT_PX if 2 * len(px) - 8 >= _LEAST_FREEDOM else _READ_PX) / half
    fit = plain = _Fit(corners, mm, exact, bends=False)
    bends = is_cut = False
    if len(px) >= LEAST_CORNERS:
        bent = _Fit(corners, mm, exact, bends=True)
        freedom, least = _INDEPENDENT * (2 * len(px) - 14), 2 * len(px) * exact**2
        bends = compute_chance(bent.squares + least, plain.squares + least, freedom) < _CHANCE
        is_cut = bends and float(np.abs(bent.bend.centre).max()) > _CUT
        fit = bent if bends else plain
    if not bends and not needs_focal:
        return None
    focal, interval = _focal_length(fit, None if focal_px is None else focal_px / half)
    camera = _camera(fit, focal * half, size, bends)
    if not np.isfinite(undistort(camera, px)).all():
        return None
    bounds = None if interval is None or is_cut else (interval[0] * half, interval[1] * half)
    deviations = np.sqrt(np.diag(fit.covariance)[[11, 12, 9, 10]])
    deviations *= [focal**2, focal**4, half, half]
    is_known = bounds is not None and _is_known(focal * half, bounds)
    length, source = _focal_words(camera.matrix[0, 0], bounds, is_known, focal_px is not None)
    rms = [half * math.sqrt(squares / len(px)) for squares in (plain.squares, fit.squares)]
    fits = f"{counted(len(px), 'corner')} lie within {rms[0]:.2f} px rms without a lens"
    lens = f"{length}, no distortion"
    if bends:
        k1, k2 = camera.distortion[:2].tolist()
        lens = f"k1 {short(k1, 4)}, k2 {short(k2, 4)}, {length}"
        fits += f", {rms[1]:.2f} px with it"
    if not can_undistort_border(camera):
        fits += "; it does not reach the corners of the photo"
    distance = np.linalg.norm(camera.matrix[:2, 2] - middle)
    note = Note(
        "assumed",
        f"lens from the photo: {lens}",
        f"{fits}; {source}; principal point {distance:.0f} px from the middle of the photo, "
        "which must not be cut",
    )
    return SheetLens(camera, bends, bounds, is_known, frozen(deviations), note)


def check_focal_length(lens: SheetLens | None) -> SheetLens:
    """The lens. Raises JobError if the corners or points contradict all focal lengths."""
    if lens is None or lens.focal is None:
        raise JobError(
            "[camera] height",
            "a height needs the focal length, and this photo contradicts all of them",
            remedy="do not cut the photo, see that the sheet lies flat, or give camera.file "
            "(camgen calibrate)",
        )
    return lens


def _focal_length(fit: _Fit, by_file: float | None) -> tuple[float, tuple[float, float] | None]:
    """The best focal length, and the interval that agrees; None if the corners contradict all.

    A wide interval is narrowed to ordinary cameras.
    """
    squares = np.array([fit.contradiction(focal) for focal in _FOCAL.tolist()])
    if by_file is not None:
        squares += (np.log(_FOCAL / by_file) / _BY_FILE) ** 2
    least = int(np.argmin(squares))
    best = float(_FOCAL[least])
    if 0 < least < len(_FOCAL) - 1:
        # The vertex of the parabola through three neighbours, which are equidistant as logarithms.
        a, b, c = squares[least - 1 : least + 2]
        step = math.log(_FOCAL[1] / _FOCAL[0])
        best *= math.exp(step * 0.5 * (a - c) / (a - 2 * b + c)) if a - 2 * b + c > 0 else 1.0
    agrees = np.flatnonzero(squares <= squares[least] + AGREES**2)
    low = float(min(_FOCAL[max(agrees[0] - 1, 0)], best))
    high = float(max(_FOCAL[min(agrees[-1] + 1, len(_FOCAL) - 1)], best))
    if not _is_known(best, (low, high)) and low < _ORDINARY[1] and high > _ORDINARY[0]:
        low, high = max(low, _ORDINARY[0]), min(high, _ORDINARY[1])
        best = min(max(best, low), high)
    return best, (low, high) if squares[least] < _CONTRADICTS**2 else None


def _is_known(best: float, interval: tuple[float, float]) -> bool:
    """Whether an interval of focal lengths is narrow."""
    return best / interval[0] < _KNOWN and interval[1] / best < _KNOWN


def _camera(fit: _Fit, focal: float, size: tuple[int, int], bends: bool) -> Camera:
    """The camera, rounded to less than its noise so that it is the same on each processor."""
    middle, half = _frame(size)
    focal = float(f"{focal:.4g}")
    u, v = np.round(middle + half * fit.bend.centre, 2).tolist()
    lens = fit.bend.lens * (focal / half) ** np.array([2, 4, 1, 1])
    lens = np.round(lens, 6) if bends else np.zeros(0)
    matrix = np.array([[focal, 0, u], [0, focal, v], [0, 0, 1.0]])
    return Camera(frozen(matrix), frozen(lens), size, "of the sheet")


def _focal_words(
    focal: float, bounds: tuple[float, float] | None, is_known: bool, by_file: bool
) -> tuple[str, str]:
    """The focal length with its bounds, px, and its source."""
    if bounds is None:
        return f"f {focal:.0f} px", "f is a guess, the corners do not show it"
    source = "f from the tilt"
    if by_file:
        source += " and the 35 mm focal length in the file"
    elif not is_known:
        source += ", which hardly shows it, among those of ordinary cameras"
    return f"f {focal:.0f} px ({bounds[0]:.0f} to {bounds[1]:.0f})", source
