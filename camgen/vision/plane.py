"""The work plane in a photo: homographies between two planes, fitted and checked for outliers."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np
from msgspec import Struct
from numpy.typing import ArrayLike

from camgen.model.errors import InputError, JobError
from camgen.model.part import Note
from camgen.model.pose import IDENTITY, FloatArray, Pose, frozen, to_vec3
from camgen.model.text import counted, short, short_each
from camgen.vision.camera.camera import Camera, undistort
from camgen.vision.camera.sheet_lens import SheetLens
from camgen.vision.image import Picture

# Homographies: the direct linear transformation (DLT), its refinement, and outliers.

#: Points lie on a line if the ratio of their breadth and length is below this.
_LINE_RATIO = 0.02
#: Up to this number of pairs, each one is tested as an outlier.
_MAX_TESTED = 40
#: If there are more pairs, this number is tested, those with the largest residuals.
_FEW_TESTED = 8
#: Iterations of the refinement, at most.
_MAX_ITERATIONS = 30


class Suspect(Struct, frozen=True):
    """The pair of points that fits least.

    index: row of the pair.
    error: distance of its image point from where the other pairs put it, px.
    chance: probability, at most 1, that normal measuring errors cause such an error; 1 for five
        pairs or fewer, from which it cannot be computed.
    """

    index: int
    error: float
    chance: float


def map_points(homography: FloatArray, points: FloatArray) -> FloatArray:
    """Map points (N, 2) by a homography (3, 3) to points (N, 2)."""
    lifted = points @ homography[:, :2].T + homography[:, 2]
    return np.asarray(lifted[:, :2] / lifted[:, 2:])


def compute_depth(homography: FloatArray, points: FloatArray) -> FloatArray:
    """The divisor (N,) of a homography at points (N, 2); its sign changes at the horizon."""
    return np.asarray(points @ homography[2, :2] + homography[2, 2])


def compute_homography_slopes(homography: FloatArray, places: FloatArray) -> FloatArray:
    """Derivatives (N, 2, 9) of the image of each place by the nine numbers of the homography."""
    lifted = (
        np.column_stack([places, np.ones(len(places))]) / compute_depth(homography, places)[:, None]
    )
    image = map_points(homography, places)
    slopes = np.zeros((len(places), 2, 9))
    slopes[:, 0, 0:3] = lifted
    slopes[:, 1, 3:6] = lifted
    slopes[:, :, 6:9] = -image[:, :, None] * lifted[:, None, :]
    return slopes


def fit_homography(source: FloatArray, image: FloatArray) -> FloatArray:
    """Fit a homography (3, 3) to pairs of points, with the least squared distances in the image.

    source, image: (N, 2), four or more pairs in general position.

    Its Frobenius norm is 1, and its divisor is positive at the middle of the source points.
    """
    to_source, to_image = _make_normalisation(source), _make_normalisation(image)
    normal_source, normal_image = map_points(to_source, source), map_points(to_image, image)
    best = _fit_dlt(normal_source, normal_image)
    # At the middle of the points, (0, 0) here, the divisor is not 0, unless the pairs are nonsense.
    if best[2, 2]:
        best = _refine(best / best[2, 2], normal_source, normal_image)
    homography = np.linalg.inv(to_image) @ best @ to_source
    homography = homography / np.linalg.norm(homography)
    middle = source.mean(axis=0)[None]
    return np.asarray(homography if compute_depth(homography, middle)[0] > 0 else -homography)


def find_off_line(points: FloatArray) -> int | None:
    """The row of `points` (N, 2) without which all others lie on one line; None without one.

    With four points this means that three are on a line.
    """
    centred = points - points.mean(axis=0)
    count = len(points) - 1
    products = centred[:, :, None] * centred[:, None, :]
    mean = -centred / count
    spread = products.sum(axis=0) - products - count * mean[:, :, None] * mean[:, None, :]
    values = np.linalg.eigvalsh(spread)
    ratio = np.sqrt(np.maximum(values[:, 0], 0) / np.maximum(values[:, 1], np.finfo(float).tiny))
    worst = int(np.argmin(ratio))
    return worst if ratio[worst] < _LINE_RATIO else None


def find_suspect(source: FloatArray, image: FloatArray, residuals: FloatArray) -> Suspect:
    """Find the pair without which the other pairs fit best. It needs six pairs or more.

    residuals: (N,) of the fit to all pairs, px.

    With the pair the squares sum to a, without it to b. If all errors are normal, a / b - 1 is
    F-distributed with 2 and 2 N - 10 degrees of freedom. So the probability of such a ratio is
    (b / a)^(N - 5), times N because the worst of N pairs was chosen.
    """
    count = len(source)
    order = np.argsort(residuals)[::-1][: count if count <= _MAX_TESTED else _FEW_TESTED]
    squares = np.array([_sum_squares_without(source, image, int(i)) for i in order])
    index = int(order[np.argmin(squares)])
    total = float(residuals @ residuals)
    chance = count * (float(squares.min()) / total) ** (count - 5) if total > 0 else 1.0
    return Suspect(index, _measure_error(source, image, index), min(chance, 1.0))


def find_most_distorted(
    source: FloatArray, image: FloatArray, camera: FloatArray | None
) -> Suspect:
    """Find the pair of five without which the picture is most plausible.

    Any four pairs fit exactly, so residuals do not show which of five is wrong. With a camera the
    axes of the plane must have the same length and a right angle; without one the picture that is
    stretched least is taken.

    camera: camera matrix (3, 3), or None.
    """
    oddness = []
    for i in range(len(source)):
        homography = fit_homography(np.delete(source, i, axis=0), np.delete(image, i, axis=0))
        if camera is None:
            oddness.append(_measure_stretch(homography, source))
        else:
            oddness.append(measure_skewness(homography, camera))
    index = int(np.argmin(oddness))
    return Suspect(index, _measure_error(source, image, index), 1.0)


def measure_skewness(homography: FloatArray, camera: FloatArray) -> float:
    """Deviation of the two axes of a plane, as a camera sees them, from equal and perpendicular.

    camera: camera matrix (3, 3).

    Returns the root of the sum of two squares: the logarithm of the ratio of their lengths, and the
    cosine of their angle. 0 for a real plane.
    """
    axes = np.linalg.solve(camera, homography)[:, :2]
    a, b = np.linalg.norm(axes, axis=0)
    return float(np.hypot(np.log(a / b), axes[:, 0] @ axes[:, 1] / (a * b)))


def compute_scales(homography: FloatArray, points: FloatArray) -> FloatArray:
    """Smallest and largest scale (N, 2) at points (N, 2): length in the image per source length."""
    lifted = points @ homography[:, :2].T + homography[:, 2]
    image = lifted[:, :2] / lifted[:, 2:]
    slopes = homography[None, :2, :2] - image[:, :, None] * homography[None, 2:, :2]
    values = np.linalg.svd(slopes / lifted[:, 2, None, None], compute_uv=False)
    return np.asarray(values[:, ::-1], dtype=np.float64)


def _measure_stretch(homography: FloatArray, source: FloatArray) -> float:
    """Logarithm of the ratio of the largest and the smallest scale; inf beyond the horizon."""
    if compute_depth(homography, source).min() <= 0:
        return np.inf
    all_scales = compute_scales(homography, source)
    return float(np.log(all_scales.max() / all_scales.min()))


def _measure_error(source: FloatArray, image: FloatArray, index: int) -> float:
    """Distance of an image point from where the other pairs put it, px."""
    homography = fit_homography(np.delete(source, index, axis=0), np.delete(image, index, axis=0))
    predicted = map_points(homography, source[index : index + 1])
    return float(np.linalg.norm(predicted[0] - image[index]))


def _sum_squares_without(source: FloatArray, image: FloatArray, index: int) -> float:
    """Sum of the squared residuals of the other pairs, px2; inf if they are on a line."""
    source, image = np.delete(source, index, axis=0), np.delete(image, index, axis=0)
    if find_off_line(source) is not None or find_off_line(image) is not None:
        return np.inf
    return float(np.sum((map_points(fit_homography(source, image), source) - image) ** 2))


def _make_normalisation(points: FloatArray) -> FloatArray:
    """The homography to a mean of (0, 0) and a mean distance of sqrt 2 from it (4.4.4)."""
    middle = points.mean(axis=0)
    size = np.sqrt(2) / np.linalg.norm(points - middle, axis=1).mean()
    return np.array([[size, 0, -size * middle[0]], [0, size, -size * middle[1]], [0, 0, 1]])


def _fit_dlt(source: FloatArray, image: FloatArray) -> FloatArray:
    lifted = np.column_stack([source, np.ones(len(source))])
    zeros = np.zeros_like(lifted)
    first = np.hstack([lifted, zeros, -image[:, :1] * lifted])
    second = np.hstack([zeros, lifted, -image[:, 1:] * lifted])
    rows = np.vstack([first, second])
    return np.asarray(np.linalg.svd(rows, full_matrices=len(rows) < 9)[2][-1].reshape(3, 3))


def _refine(start: FloatArray, source: FloatArray, image: FloatArray) -> FloatArray:
    """Refine a homography (3, 3) by the Gauss-Newton method.

    The last of its nine elements stays 1. A step that does not reduce the squares ends it.
    """
    best, least_squares = start, np.inf
    current = start
    for _ in range(_MAX_ITERATIONS):
        error = image - map_points(current, source)
        squares = float(np.sum(error**2))
        if not squares < least_squares * (1 - 1e-12):
            break
        best, least_squares = current, squares
        slopes = compute_homography_slopes(current, source)[:, :, :8]
        rows = slopes.transpose(1, 0, 2).reshape(-1, 8)
        step = np.linalg.lstsq(rows, error.T.ravel())[0]
        current = current + np.append(step, 0.0).reshape(3, 3)
    return best


# The work plane, from pairs of points or from a known pose (PIST, section 2).

#: px: a pair is wrong if the other pairs put it at least this far away,
_WRONG_PX = 2.0
#: and if chance would do that less often than this.
_WRONG_CHANCE = 1e-3
#: px: pairs contradict each other if their standard error is above this,
_CONTRADICT_PX = 3.0
#: and above this fraction of their extent.
_CONTRADICT_FRACTION = 0.001
#: px: a note names the worst pair if its residual is above this.
_NOTE_PX = 1.5
#: Largest skewness of a plane that is seen by a camera.
_MAX_SKEWNESS = 0.03
_SOURCE = "[camera] points_px"
#: What to do if points that the user measured contradict each other, and if those of a sheet do.
_AGAIN = "measure it again or leave it out"
_LIES_FLAT = "see that sheet or board lies flat, is whole, and is that of camera.markers"
_BENDS = "; if the lens bends much, give camera.file (camgen calibrate)"


class Plane(Struct, frozen=True, eq=False):
    """The work plane in a photo.

    pixel_from_work: (3, 3), from work mm to undistorted pixels of the camera, or pixels of the
        photo without a camera. Its divisor is positive in front of the camera.
    work_from_pixel: its inverse.
    rms_mm, max_mm: root mean square and maximum of `residuals_mm`; 0 for a plane from a pose.
    residuals_mm, residuals_px: (N,) distance of each pair of points from its image by the plane;
        empty for a plane from a pose.
    notes: notes to the user.
    work_from_pairs: (3, 3), from mm in the plane of the pairs to mm of the work plane above it. The
        camera sees both at the same pixel.
    pairs_px, pairs_mm: (N, 2), the pairs: pixels of the photo, and mm.
    height: height of the work plane above that of the pairs, mm.
    lens: the camera that the photo of a sheet shows, if no other is given; otherwise None.
    """

    pixel_from_work: FloatArray
    work_from_pixel: FloatArray
    rms_mm: float = 0.0
    max_mm: float = 0.0
    residuals_mm: FloatArray = frozen([])
    residuals_px: FloatArray = frozen([])
    notes: tuple[Note, ...] = ()
    work_from_pairs: FloatArray = IDENTITY
    pairs_px: FloatArray = frozen(np.zeros((0, 2)))
    pairs_mm: FloatArray = frozen(np.zeros((0, 2)))
    height: float = 0.0
    lens: SheetLens | None = None


def fit_plane(
    camera: Camera | None,
    px: ArrayLike,
    mm: ArrayLike,
    *,
    height: float = 0.0,
    names: Sequence[str] = (),
    source: str = _SOURCE,
) -> Plane:
    """Fit the work plane to pairs of points.

    px: (N, 2), the points in the photo.
    mm: (N, 2), or (N, 3) with z = 0, the points in the work frame.
    height: distance of the points below the part's top face, mm; it needs a camera.
    names: names of the pairs in messages; empty for pair 1, pair 2 and so on.
    source: origin of the pairs, for messages.

    Raises JobError for fewer than four pairs, points on a line, a pair that is clearly wrong, and
    mirrored points.
    """
    image, work = _check_pairs(px, mm, source)
    names = names or [f"pair {i + 1}" for i in range(len(image))]
    if height and camera is None:
        raise JobError(
            source,
            "points below the top face need a camera",
            remedy="give [camera] file, or height 0",
        )
    _check_general_position(image, work, names, source)
    ideal = image if camera is None else undistort(camera, image)
    if not np.isfinite(ideal).all():
        raise JobError(
            source,
            "a point lies where the lens model shows nothing",
            remedy="calibrate with the board in the corners of the photo",
        )
    homography = fit_homography(work, ideal)
    residuals = np.linalg.norm(map_points(homography, work) - ideal, axis=1)
    labels = [
        f"{name} (pixel {format_numbers(p)}, work {format_numbers(w)} mm)"
        for name, p, w in zip(names, image, work, strict=True)
    ]
    notes = _check_consistency(camera, ideal, work, residuals, labels, source)
    _check_seen_from_above(homography, work, source)
    if camera is not None and measure_skewness(homography, camera.matrix) > _MAX_SKEWNESS:
        notes.append(
            Note(
                "warning",
                "the points give x and y different scales",
                "with this camera they cannot all be right: "
                "check the pairs, their unit and the camera file",
            )
        )
    work_from_pixel: FloatArray = np.linalg.inv(homography).astype(np.float64, copy=False)
    residuals_mm = np.linalg.norm(map_points(work_from_pixel, ideal) - work, axis=1)
    raised, work_from_pairs = homography, IDENTITY
    if height and camera is not None:
        raised = raise_plane(homography, camera, height)
        if compute_depth(raised, work).min() <= 0:
            raise JobError(
                "[camera] height",
                f"a top face {short(height, 3)} mm above the points lies behind the camera",
                remedy="give the height of the part, in mm",
            )
        work_from_pairs = frozen(np.linalg.solve(raised, homography))
    return Plane(
        *_scale_homography(raised),
        rms_mm=math.sqrt(float(residuals_mm @ residuals_mm) / len(residuals_mm)),
        max_mm=float(residuals_mm.max()),
        residuals_mm=frozen(residuals_mm),
        residuals_px=frozen(residuals),
        notes=tuple(notes),
        work_from_pairs=work_from_pairs,
        pairs_px=frozen(image),
        pairs_mm=frozen(work),
        height=height,
    )


def make_plane(
    camera: Camera, camera_from_work: Pose, source: str = "[camera] plane_from"
) -> Plane:
    """The work plane of a camera with a known pose.

    camera_from_work: pose of the work frame in the camera frame, mm; there z points forward and y
        down the photo.
    source: origin of the pose, for messages.

    Raises JobError if the origin of the work frame is behind the camera, or its z points away from
    the camera.
    """
    normal = camera_from_work.rotation[:, 2]
    origin = np.asarray(camera_from_work.origin)
    remedy = (
        "give the pose of the work frame in the camera frame (camera_from_work), not its inverse"
    )
    if not origin[2] > 0:
        raise JobError(source, "the work frame is behind the camera", remedy=remedy)
    if not normal @ origin < 0:
        raise JobError(
            source, "the camera sees the part from below, its z points away", remedy=remedy
        )
    axes = np.column_stack([camera_from_work.rotation[:, :2], origin])
    return Plane(*_scale_homography(camera.matrix @ axes))


def check_pixels(picture: Picture, camera: Camera) -> None:
    """Raises InputError if the photo does not have the pixels of the camera's calibration."""
    height, width = picture.pixels.shape[:2]
    if picture.turned:
        raise InputError(
            picture.name,
            "was turned by its Exif orientation, "
            "a lens calibration belongs to the pixels of the sensor",
            remedy="take it with the camera upright, or save it without the orientation",
        )
    if (width, height) != tuple(camera.size):
        raise InputError(
            picture.name,
            f"is {width} x {height} px, camera {camera.name} was calibrated with "
            f"{camera.size[0]} x {camera.size[1]}",
            remedy="take photos and calibration with the same camera settings",
        )


def compute_pose(plane_homography: FloatArray, matrix: FloatArray) -> Pose:
    """The pose camera_from_work of a plane, mm, with the nearest rotation.

    plane_homography: (3, 3), from mm to undistorted px.
    matrix: camera matrix (3, 3).
    """
    axes = np.linalg.solve(matrix, plane_homography)
    axes = axes / np.linalg.norm(axes[:, :2], axis=0).mean()
    u, _, v = np.linalg.svd(np.column_stack([axes[:, :2], np.cross(axes[:, 0], axes[:, 1])]))
    return Pose(frozen(u @ v), to_vec3(axes[:, 2]))


def _scale_homography(homography: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A homography with a Frobenius norm of 1, and its inverse."""
    scaled = homography / np.linalg.norm(homography)
    return frozen(scaled), frozen(np.linalg.inv(scaled))


def raise_plane(homography: FloatArray, camera: Camera, height: float) -> FloatArray:
    """The homography of the plane that is `height` mm above another, from mm to undistorted px."""
    axes = np.linalg.solve(camera.matrix, homography)
    metric = homography / np.linalg.norm(axes[:, :2], axis=0).mean()
    normal = compute_pose(homography, camera.matrix).rotation[:, 2]
    lift = np.zeros((3, 3))
    lift[:, 2] = camera.matrix @ normal * height
    return np.asarray(metric + lift)


def _check_pairs(px: ArrayLike, mm: ArrayLike, source: str) -> tuple[FloatArray, FloatArray]:
    """The pairs as arrays (N, 2) of px and of mm. Raises JobError if they are not valid."""
    what = "is not a list of points"
    try:
        image, work = np.asarray(px, dtype=np.float64), np.asarray(mm, dtype=np.float64)
    except (ValueError, TypeError) as error:
        raise JobError(source, what, remedy="give pairs of numbers, [[u, v], ...]") from error
    if image.ndim != 2 or image.shape[1] != 2 or work.ndim != 2 or work.shape[1] not in (2, 3):
        raise JobError(
            source, what, remedy="give pairs of numbers, [[u, v], ...] and [[x, y], ...]"
        )
    if len(image) != len(work):
        raise JobError(
            source,
            f"{counted(len(image), 'point')} in the photo and {len(work)} in mm",
            remedy="give as many of both, in the same order",
        )
    if len(image) < 4:
        raise JobError(
            source,
            f"{counted(len(image), 'point pair')}, a plane needs four",
            remedy="give four or more",
        )
    if not (np.isfinite(image).all() and np.isfinite(work).all()):
        raise JobError(source, "holds a number that is not finite", remedy="correct the number")
    if work.shape[1] == 3 and np.abs(work[:, 2]).max() > 1e-9:
        raise JobError(
            source,
            "points with a z other than 0",
            remedy="give x and y, and how far they lie below the top face as height",
        )
    return image, work[:, :2]


def _check_general_position(
    image: FloatArray, work: FloatArray, names: Sequence[str], source: str
) -> None:
    for points, kind in ((image, "in the photo"), (work, "in mm")):
        _, first, inverse = np.unique(points, axis=0, return_index=True, return_inverse=True)
        repeated = np.flatnonzero(first[inverse] != np.arange(len(points)))
        if len(repeated):
            twin = int(first[inverse][repeated[0]])
            raise JobError(
                source,
                f"{names[twin]} and {names[int(repeated[0])]} are the same point {kind}",
                format_numbers(points[twin]),
                "give four or more different points",
            )
        odd = find_off_line(points)
        if odd is not None:
            others = [name for i, name in enumerate(names) if i != odd]
            which = ", ".join(others) if len(others) == 3 else f"all points but {names[odd]}"
            raise JobError(
                source,
                f"{which} lie on one line {kind}",
                remedy="four points are needed of which no three are on a line",
            )


def _check_consistency(
    camera: Camera | None,
    ideal: FloatArray,
    work: FloatArray,
    residuals: FloatArray,
    labels: Sequence[str],
    source: str,
) -> list[Note]:
    """Check how well the pairs agree.

    ideal, work: (N, 2), undistorted px and mm.
    residuals: (N,) of the fit to all pairs, px.
    labels: names of the pairs with their points.

    Returns notes. Raises JobError if a pair is clearly wrong, or if they contradict each other.
    """
    count = len(residuals)
    if count == 4:
        return [
            Note(
                "assumed",
                "four point pairs are right",
                "they fit exactly whatever they are; a fifth and a sixth would show an error",
            )
        ]
    odd = find_suspect(work, ideal, residuals) if count > 5 else None
    remedy = _AGAIN if source == _SOURCE else _LIES_FLAT + _BENDS * (camera is None)
    if odd is not None and odd.error > _WRONG_PX and odd.chance < _WRONG_CHANCE:
        raise JobError(
            source,
            f"{labels[odd.index]} is wrong: the others put it {short(odd.error, 1)} px away",
            remedy=remedy,
        )
    error = math.sqrt(float(residuals @ residuals) / (2 * count - 8))
    extent = float(np.linalg.norm(np.ptp(ideal, axis=0)))
    if error > max(_CONTRADICT_PX, _CONTRADICT_FRACTION * extent):
        odd = odd or find_most_distorted(work, ideal, None if camera is None else camera.matrix)
        raise JobError(
            source,
            f"the point pairs contradict each other by {short(error, 1)} px; "
            f"most likely wrong is {labels[odd.index]}, "
            f"which the others put {short(odd.error, 1)} px away",
            remedy=remedy,
        )
    worst = int(np.argmax(residuals))
    if residuals[worst] <= _NOTE_PX:
        return []
    distance = short(float(residuals[worst]), 1)
    return [Note("warning", f"{labels[worst]} is {distance} px off the plane of all pairs")]


def _check_seen_from_above(homography: FloatArray, work: FloatArray, source: str) -> None:
    """Raises JobError if points are behind the camera, or mirrored.

    In the photo v runs down, and y runs up. So the homography of a plane that is seen from above
    has a negative determinant.
    """
    if compute_depth(homography, work).min() <= 0:
        raise JobError(
            source,
            "the points do not lie on a plane in front of the camera",
            remedy="check that both lists are in the same order",
        )
    if np.linalg.det(homography) > 0:
        raise JobError(
            source,
            "the points are mirrored",
            remedy="seen from above, y runs up where v runs down: "
            "check the sign of y, and the order of the points",
        )


def format_numbers(values: Iterable[float]) -> str:
    """The coordinates of a point or a region, mm or px, for messages: "[1.5, 20]"."""
    return f"[{', '.join(short_each(values, 3))}]"
