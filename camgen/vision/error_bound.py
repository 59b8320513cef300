"""An upper bound of the error of a part's outline, from the points of the work plane and the lens.

The homography of the plane is fitted with one more parameter: the radial distortion k about the
middle of the photo. To first order in k and in the changes of the homography

    measured = place + k r^2 (place - middle),   r = |place - middle| / half the photo's diagonal

A calibrated camera has k = 0. Otherwise the bound allows for the k that fits best and for four
times its standard deviation on either side. Such a distortion agrees with the points, and it moves
places beside them. The noise of the points adds four standard deviations of the place, in the
direction of the largest deviation.

Few corners can show one radial term. The bound leaves out higher terms, and a lens beside the
middle of the photo. With both, drawn at random, 8 of 443 photos exceeded it. Without them none of
481 did.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.model.pose import FloatArray
from camgen.vision.camera.camera import Camera, undistort
from camgen.vision.plane import Plane, depth, map_points

#: The bound covers this many standard deviations on either side. Three are enough for independent
#: corners. Near corners err alike, and their residuals do not show that.
_SIGMAS = 4.0
#: The points show their noise if the measurements exceed the unknowns by this number.
_LEAST_FREEDOM = 4
#: A lens moves the corner of its photo by at most this share of the half diagonal, beyond the
#: distortion that the points show.
_MOST_DISTORTION = 0.1


class ErrorBound(Struct, frozen=True):
    """The bound of the outline's error at its worst place. Lengths are mm.

    noise: the share of the noise of the points.
    lens: the share of a distortion that nothing corrects; 0 with a calibrated camera.
    outside: the distance of the outline from the convex hull of the points; 0 inside.
    known: whether the points are enough for noise and lens.
    """

    noise: float
    lens: float
    outside: float
    known: bool = True

    @property
    def total(self) -> float:
        """Both together, mm."""
        return self.noise + self.lens


def error_bound(
    plane: Plane, camera: Camera | None, size: tuple[int, int], outline: FloatArray
) -> ErrorBound:
    """The bound of an outline. The height of the part counts as exact.

    plane: a work plane from points.
    size: width and height of the photo, px.
    outline: (N, 2), mm in the work plane.
    """
    measured = plane.pairs_px if camera is None else undistort(camera, plane.pairs_px)
    homography = plane.pixel_from_work @ plane.work_from_pairs
    below = np.linalg.inv(plane.work_from_pairs).astype(np.float64, copy=False)
    places = map_points(below, outline)
    outside = _distance_outside(plane.pairs_mm, places)
    unknowns = 8 if camera is not None else 9
    freedom = 2 * len(measured) - unknowns
    if freedom < _LEAST_FREEDOM:
        return ErrorBound(0.0, 0.0, outside, known=False)
    error = (measured - map_points(homography, plane.pairs_mm)).ravel()
    by_homography = _slopes(homography, plane.pairs_mm)
    inverse = np.linalg.pinv(by_homography)
    at_outline = _slopes(homography, places).reshape(-1, 2, 9)
    mm_per_px = np.linalg.inv(_jacobians(homography, places))
    lens = np.zeros(len(places))
    if camera is None:
        by_lens = _distortion(measured, size).ravel()
        absorbed = inverse @ by_lens
        left = by_lens - by_homography @ absorbed
        strength = float(left @ error) / float(left @ left)
        error = error - strength * left
        deviation = float(np.linalg.norm(error)) / np.sqrt(freedom * float(left @ left))
        largest = abs(strength) + min(_SIGMAS * deviation, _MOST_DISTORTION)
        moved = _distortion(map_points(homography, places), size) - at_outline @ absorbed
        lens = largest * np.linalg.norm(np.einsum("nij,nj->ni", mm_per_px, moved), axis=1)
    spread = mm_per_px @ at_outline @ inverse
    sigma = float(np.linalg.norm(error)) / np.sqrt(freedom)
    noise = _SIGMAS * sigma * np.linalg.norm(spread, ord=2, axis=(1, 2))
    worst = int(np.argmax(noise + lens))
    return ErrorBound(float(noise[worst]), float(lens[worst]), outside)


def _slopes(homography: FloatArray, places: FloatArray) -> FloatArray:
    """Derivatives (2 N, 9) of the pixels of each place by the nine numbers of the homography."""
    lifted = np.column_stack([places, np.ones(len(places))]) / depth(homography, places)[:, None]
    px = map_points(homography, places)
    slopes = np.zeros((len(places), 2, 9))
    slopes[:, 0, 0:3] = lifted
    slopes[:, 1, 3:6] = lifted
    slopes[:, :, 6:9] = -px[:, :, None] * lifted[:, None, :]
    return slopes.reshape(-1, 9)


def _jacobians(homography: FloatArray, places: FloatArray) -> FloatArray:
    """Derivatives (N, 2, 2) of the pixel of each place by its x and y, px/mm."""
    px = map_points(homography, places)
    top = homography[None, :2, :2] - px[:, :, None] * homography[None, 2:, :2]
    slopes: FloatArray = top / depth(homography, places)[:, None, None]
    return slopes


def _distortion(px: FloatArray, size: tuple[int, int]) -> FloatArray:
    """The shift (N, 2), px, of each pixel by a distortion of k = 1."""
    middle = (np.array(size) - 1) / 2
    from_middle = px - middle
    share = np.linalg.norm(from_middle, axis=1) / np.linalg.norm(middle)
    moved: FloatArray = share[:, None] ** 2 * from_middle
    return moved


def _distance_outside(points: FloatArray, places: FloatArray) -> float:
    """The largest distance of ``places`` from the convex hull of ``points``; 0: all are inside."""
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    hull = cv2.convexHull(points.astype(np.float32))
    inside = [cv2.pointPolygonTest(hull, place, measureDist=True) for place in places.tolist()]
    return max(0.0, -min(inside))
