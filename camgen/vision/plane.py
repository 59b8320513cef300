"""The one number of a view that is to scale."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import ArrayLike

from camgen.model.errors import InputError, JobError
from camgen.model.part import Note
from camgen.model.pose import FloatArray, Pose, frozen, to_vec3
from camgen.model.text import counted, short
from camgen.vision.camera.camera import Camera, undistort
from camgen.vision.camera.sheet_lens import SheetLens
from camgen.vision.image import Picture

# Homographies between two planes: the direct linear transformation, its refinement, and pairs that do not fit.

#: Below this ratio of breadth to length a set of points is a line.
_LINE_RATIO = 0.02
#: More pairs than this are not all left out one by one, only those with the largest residuals.
_TRIED = 40
_ROUNDS = 30


class Suspect(Struct, frozen=True):
    """The pair that fits least. index: its row; error: how far from its image point the others put it, px.

    chance: the probability, at most 1, that plain measuring errors look like this one; it cannot be told from five
    pairs or fewer (then 1).
    """

    index: int
    error: float
    chance: float


def map_points(homography: FloatArray, points: FloatArray) -> FloatArray:
    """``points`` (N, 2) through ``homography`` (3, 3): (N, 2)."""
    lifted = points @ homography[:, :2].T + homography[:, 2]
    moved: FloatArray = lifted[:, :2] / lifted[:, 2:]
    return moved


def depth(homography: FloatArray, points: FloatArray) -> FloatArray:
    """The divisor of each point (N,): of one sign on one side of the horizon, of the other beyond it."""
    divisor: FloatArray = points @ homography[2, :2] + homography[2, 2]
    return divisor


def fit_homography(source: FloatArray, image: FloatArray) -> FloatArray:
    """The homography (3, 3) with the least squared distances in the image; four or more pairs in general position.

    Its scale is 1 (Frobenius), its sign such that the divisor is positive at the middle of the source points.
    """
    to_source, to_image = _normalisation(source), _normalisation(image)
    start = _dlt(map_points(to_source, source), map_points(to_image, image))
    # At the middle of the points, (0, 0) here, the divisor is not zero unless the pairs make no sense at all.
    best = (
        _refine(start / start[2, 2], map_points(to_source, source), map_points(to_image, image))
        if start[2, 2]
        else start
    )
    found = np.linalg.inv(to_image) @ best @ to_source
    found = found / np.linalg.norm(found)
    middle = source.mean(axis=0)[None]
    whole: FloatArray = found if depth(found, middle)[0] > 0 else -found
    return whole


def in_line(points: FloatArray) -> int | None:
    """The row without which all other points lie on one line (four points: three of them do); None: there is none."""
    centred = points - points.mean(axis=0)
    count = len(points) - 1
    products = centred[:, :, None] * centred[:, None, :]
    mean = -centred / count
    spread = products.sum(axis=0) - products - count * mean[:, :, None] * mean[:, None, :]
    values = np.linalg.eigvalsh(spread)
    ratio = np.sqrt(np.maximum(values[:, 0], 0) / np.maximum(values[:, 1], np.finfo(float).tiny))
    worst = int(np.argmin(ratio))
    return worst if ratio[worst] < _LINE_RATIO else None


def suspect(source: FloatArray, image: FloatArray, residuals: FloatArray) -> Suspect:
    """The pair whose absence makes the others fit best. residuals (N,): of the fit to all, px. Six pairs or more.

    With it the squares sum to a, without it to b. If all errors are normal, a / b - 1 is F-distributed with 2 and
    2 N - 10 degrees of freedom, so that chance says (b / a)^(N - 5), times N because the worst one was sought.
    """
    count = len(source)
    order = np.argsort(residuals)[::-1][: count if count <= _TRIED else 8]
    squares = np.array([_squares_without(source, image, int(i)) for i in order])
    index = int(order[np.argmin(squares)])
    total = float(residuals @ residuals)
    chance = count * (float(squares.min()) / total) ** (count - 5) if total > 0 else 1.0
    return Suspect(index, _error_of(source, image, index), min(chance, 1.0))


def most_distorted(source: FloatArray, image: FloatArray, camera: FloatArray | None) -> Suspect:
    """Of five pairs the one whose absence leaves the most plausible picture. camera: matrix (3, 3) or None.

    Any four pairs fit exactly: which of five is wrong, no residual tells. With a camera the plane's axes must come out
    equally long and square to each other; without one the picture that is stretched least is believed.
    """
    oddness = []
    for i in range(len(source)):
        rest = np.arange(len(source)) != i
        found = fit_homography(source[rest], image[rest])
        oddness.append(_stretch(found, source) if camera is None else skewness(found, camera))
    index = int(np.argmin(oddness))
    return Suspect(index, _error_of(source, image, index), 1.0)


def skewness(homography: FloatArray, camera: FloatArray) -> float:
    """How far the plane's two axes, seen by the camera (matrix (3, 3)), are from equally long and square; 0: not."""
    axes = np.linalg.solve(camera, homography)[:, :2]
    a, b = np.linalg.norm(axes, axis=0)
    return float(np.hypot(np.log(a / b), axes[:, 0] @ axes[:, 1] / (a * b)))


def scales(homography: FloatArray, points: FloatArray) -> FloatArray:
    """Length in the image per length at the source, least and greatest, at each point: (N, 2)."""
    lifted = points @ homography[:, :2].T + homography[:, 2]
    place = lifted[:, :2] / lifted[:, 2:]
    jacobian = (homography[None, :2, :2] - place[:, :, None] * homography[None, 2:, :2]) / lifted[
        :, 2, None, None
    ]
    sizes: FloatArray = np.linalg.svd(jacobian, compute_uv=False)[:, ::-1].astype(
        np.float64, copy=False
    )
    return sizes


def _stretch(homography: FloatArray, source: FloatArray) -> float:
    if depth(homography, source).min() <= 0:
        return np.inf
    all_scales = scales(homography, source)
    return float(np.log(all_scales.max() / all_scales.min()))


def _error_of(source: FloatArray, image: FloatArray, index: int) -> float:
    rest = np.arange(len(source)) != index
    predicted = map_points(fit_homography(source[rest], image[rest]), source[index : index + 1])
    return float(np.linalg.norm(predicted[0] - image[index]))


def _squares_without(source: FloatArray, image: FloatArray, index: int) -> float:
    rest = np.arange(len(source)) != index
    if in_line(source[rest]) is not None or in_line(image[rest]) is not None:
        return np.inf
    return float(
        np.sum(
            (map_points(fit_homography(source[rest], image[rest]), source[rest]) - image[rest]) ** 2
        )
    )


def _normalisation(points: FloatArray) -> FloatArray:
    """To a mean of (0, 0) and a mean distance of sqrt 2 from it (4.4.4), as a homography."""
    middle = points.mean(axis=0)
    size = np.sqrt(2) / np.linalg.norm(points - middle, axis=1).mean()
    return np.array([[size, 0, -size * middle[0]], [0, size, -size * middle[1]], [0, 0, 1]])


def _dlt(source: FloatArray, image: FloatArray) -> FloatArray:
    lifted = np.column_stack([source, np.ones(len(source))])
    nothing = np.zeros_like(lifted)
    first = np.hstack([lifted, nothing, -image[:, :1] * lifted])
    second = np.hstack([nothing, lifted, -image[:, 1:] * lifted])
    rows = np.vstack([first, second])
    flat: FloatArray = np.linalg.svd(rows, full_matrices=len(rows) < 9)[2][-1]
    return flat.reshape(3, 3)


def _refine(start: FloatArray, source: FloatArray, image: FloatArray) -> FloatArray:
    """Gauss-Newton on the eight parameters beside the last, which stays 1; a step that does not help ends it."""
    lifted = np.column_stack([source, np.ones(len(source))])
    nothing = np.zeros_like(lifted)
    best, least = start, np.inf
    current = start
    for _ in range(_ROUNDS):
        moved = map_points(current, source)
        error = image - moved
        squares = float(np.sum(error**2))
        if not squares < least * (1 - 1e-12):
            break
        best, least = current, squares
        near = lifted / depth(current, source)[:, None]
        first = np.hstack([near, nothing, -moved[:, :1] * near[:, :2]])
        second = np.hstack([nothing, near, -moved[:, 1:] * near[:, :2]])
        step = np.linalg.lstsq(np.vstack([first, second]), error.T.ravel())[0]
        current = current + np.append(step, 0.0).reshape(3, 3)
    return best


# The work plane: where the part's top face is in the photo, from point pairs or from a known pose (PIST, section 2).

#: A pair is wrong if the others put it this far off, px, and chance would do so less often than once in a thousand.
_WRONG_PX, _WRONG_CHANCE = 2.0, 1e-3
#: Pairs contradict each other above this standard error: px, and as a part of their extent.
_CONTRADICT_PX, _CONTRADICT_PART = 3.0, 0.001
_LOOK_PX = 1.5
_SKEW = 0.03
_SOURCE = "[camera] points_px"
#: What to do if points that the user measured contradict each other, and if those of a sheet do.
_AGAIN = "measure it again or leave it out"
_LIES_FLAT = "see that sheet or board lies flat, is whole, and is that of camera.markers"
_BENDS = "; if the lens bends much, give camera.file (camgen calibrate)"


class Plane(Struct, frozen=True, eq=False):
    """The work plane in a photo.

    pixel_from_work: (3, 3), work mm to undistorted pixels of the camera (of the photo itself where there is none); its
    divisor is positive in front of the camera. work_from_pixel: its inverse. residuals_mm, residuals_px: (N,), how far
    off each pair is; rms_mm and max_mm of them; all 0 and empty where the plane comes from a pose.
    work_from_pairs: (3, 3), from mm in the plane of the pairs to mm of the work plane above it. The
        camera sees both at the same pixel.
    pairs_px, pairs_mm: (N, 2), the pairs: pixels of the photo, and mm.
    height: of the work plane above that of the pairs, mm.
    lens: the camera that the photo of a sheet shows, where no other is given; None without one.
    """

    pixel_from_work: FloatArray
    work_from_pixel: FloatArray
    rms_mm: float = 0.0
    max_mm: float = 0.0
    residuals_mm: FloatArray = frozen([])
    residuals_px: FloatArray = frozen([])
    notes: tuple[Note, ...] = ()
    work_from_pairs: FloatArray = frozen(np.eye(3))
    pairs_px: FloatArray = frozen(np.zeros((0, 2)))
    pairs_mm: FloatArray = frozen(np.zeros((0, 2)))
    height: float = 0.0
    lens: SheetLens | None = None


def plane_from_points(
    camera: Camera | None,
    px: ArrayLike,
    mm: ArrayLike,
    *,
    height: float = 0.0,
    names: Sequence[str] = (),
    source: str = _SOURCE,
) -> Plane:
    """The plane through point pairs: ``px`` (N, 2) in the photo, ``mm`` (N, 2) or (N, 3) with z = 0 in the work frame.

    height: distance of the points below the part's top face, mm; needs the camera.
    names: names of the pairs in messages; empty: pair 1, ...
    source: where the pairs come from.

    Raises JobError for fewer than four pairs, points on a line, a pair that is clearly wrong, and
    mirrored points.
    """
    image, work = _check(px, mm, source)
    names = names or [f"pair {i + 1}" for i in range(len(image))]
    if height and camera is None:
        raise JobError(
            source,
            "points below the top face need a camera",
            remedy="give [camera] file, or height 0",
        )
    _in_general_position(image, work, names, source)
    ideal = image if camera is None else undistort(camera, image)
    if not np.isfinite(ideal).all():
        raise JobError(
            source,
            "a point lies where the lens model shows nothing",
            remedy="calibrate with the board in the corners of the photo",
        )
    found = fit_homography(work, ideal)
    residuals = np.linalg.norm(map_points(found, work) - ideal, axis=1)
    told = [
        f"{name} (pixel {_point(p)}, work {_point(w)} mm)"
        for name, p, w in zip(names, image, work, strict=True)
    ]
    notes = _consistent(camera, ideal, work, residuals, told, source)
    _see_from_above(found, work, source)
    if camera is not None and skewness(found, camera.matrix) > _SKEW:
        why = "with this camera they cannot all be right: check the pairs, their unit and the camera file"
        notes.append(Note("warning", "the points give x and y different scales", why))
    back: FloatArray = np.linalg.inv(found).astype(np.float64, copy=False)
    off = np.linalg.norm(map_points(back, ideal) - work, axis=1)
    pairs = {"pairs_px": frozen(image), "pairs_mm": frozen(work)}
    if not height or camera is None:
        return replace(_plane(found, off, residuals, notes), **pairs)
    raised = raise_plane(found, camera, height)
    if depth(raised, work).min() <= 0:
        what = f"a top face {short(height, 3)} mm above the points lies behind the camera"
        raise JobError("[camera] height", what, remedy="give the height of the part, in mm")
    plane = _plane(raised, off, residuals, notes)
    below = frozen(np.linalg.solve(raised, found))
    return replace(plane, work_from_pairs=below, height=height, **pairs)


def plane_from_pose(
    camera: Camera, camera_from_work: Pose, source: str = "[camera] plane_from"
) -> Plane:
    """The plane of a known pose: ``camera_from_work`` takes work mm to the camera frame (z forward, y down the photo).

    JobError if the work frame's origin is behind the camera or its z points away from the camera.
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
    found = camera.matrix @ np.column_stack([camera_from_work.rotation[:, :2], origin])
    nothing = np.zeros(0)
    return _plane(found, nothing, nothing, [])


def same_pixels(picture: Picture, camera: Camera) -> None:
    """InputError if the photo cannot have the pixels that the camera was calibrated with."""
    height, width = picture.pixels.shape[:2]
    if picture.turned:
        what = "was turned by its Exif orientation, a lens calibration belongs to the pixels of the sensor"
        raise InputError(
            picture.name,
            what,
            remedy="take it with the camera upright, or save it without the orientation",
        )
    if (width, height) != tuple(camera.size):
        what = f"is {width} x {height} px, camera {camera.name} was calibrated with {camera.size[0]} x {camera.size[1]}"
        raise InputError(
            picture.name, what, remedy="take photos and calibration with the same camera settings"
        )


def pose_of(plane_homography: FloatArray, matrix: FloatArray) -> Pose:
    """camera_from_work of a plane seen by a camera with this ``matrix`` (3, 3): the nearest rotation, mm."""
    axes = np.linalg.solve(matrix, plane_homography)
    axes = axes / np.linalg.norm(axes[:, :2], axis=0).mean()
    u, _, v = np.linalg.svd(np.column_stack([axes[:, :2], np.cross(axes[:, 0], axes[:, 1])]))
    return Pose(frozen(u @ v), to_vec3(axes[:, 2]))


def _plane(found: FloatArray, off: FloatArray, residuals: FloatArray, notes: list[Note]) -> Plane:
    found = found / np.linalg.norm(found)
    rms = math.sqrt(float(off @ off) / len(off)) if len(off) else 0.0
    most = float(off.max()) if len(off) else 0.0
    return Plane(
        frozen(found),
        frozen(np.linalg.inv(found)),
        rms,
        most,
        frozen(off),
        frozen(residuals),
        tuple(notes),
    )


def raise_plane(found: FloatArray, camera: Camera, height: float) -> FloatArray:
    """The homography of the plane ``height`` mm above that of ``found``, both from mm to undistorted px."""
    axes = np.linalg.solve(camera.matrix, found)
    metric = found / np.linalg.norm(axes[:, :2], axis=0).mean()
    normal = pose_of(found, camera.matrix).rotation[:, 2]
    lift = np.zeros((3, 3))
    lift[:, 2] = camera.matrix @ normal * height
    raised: FloatArray = metric + lift
    return raised


def _check(px: ArrayLike, mm: ArrayLike, source: str) -> tuple[FloatArray, FloatArray]:
    try:
        image, work = np.asarray(px, dtype=np.float64), np.asarray(mm, dtype=np.float64)
    except (ValueError, TypeError) as error:
        raise JobError(
            source, "is no list of points", remedy="give pairs of numbers, [[u, v], ...]"
        ) from error
    if image.ndim != 2 or image.shape[1] != 2 or work.ndim != 2 or work.shape[1] not in (2, 3):
        raise JobError(
            source,
            "is no list of points",
            remedy="give pairs of numbers, [[u, v], ...] and [[x, y], ...]",
        )
    if len(image) != len(work):
        what = f"{counted(len(image), 'point')} in the photo and {len(work)} in mm"
        raise JobError(source, what, remedy="give as many of both, in the same order")
    if len(image) < 4:
        raise JobError(
            source,
            f"{counted(len(image), 'point pair')}, a plane needs four",
            remedy="give four or more",
        )
    if not (np.isfinite(image).all() and np.isfinite(work).all()):
        raise JobError(source, "holds a number that is not finite", remedy="correct the number")
    if work.shape[1] == 3 and np.abs(work[:, 2]).max() > 1e-9:
        remedy = "give x and y, and how far they lie below the top face as height"
        raise JobError(source, "points with a z other than 0", remedy=remedy)
    return image, work[:, :2]


def _in_general_position(
    image: FloatArray, work: FloatArray, names: Sequence[str], source: str
) -> None:
    for points, kind in ((image, "in the photo"), (work, "in mm")):
        _, first, inverse = np.unique(points, axis=0, return_index=True, return_inverse=True)
        again = np.flatnonzero(first[inverse] != np.arange(len(points)))
        if len(again):
            twin = int(first[inverse][again[0]])
            what = f"{names[twin]} and {names[int(again[0])]} are the same point {kind}"
            raise JobError(source, what, _point(points[twin]), "give four or more different points")
        odd = in_line(points)
        if odd is not None:
            others = [name for i, name in enumerate(names) if i != odd]
            which = ", ".join(others) if len(others) == 3 else f"all points but {names[odd]}"
            remedy = "four points are needed of which no three are on a line"
            raise JobError(source, f"{which} lie on one line {kind}", remedy=remedy)


def _consistent(
    camera: Camera | None,
    ideal: FloatArray,
    work: FloatArray,
    residuals: FloatArray,
    told: Sequence[str],
    source: str,
) -> list[Note]:
    """Notes on how well the pairs agree; JobError with the name of one that is clearly wrong."""
    count = len(residuals)
    if count == 4:
        why = "they fit exactly whatever they are; a fifth and a sixth would show an error"
        return [Note("assumed", "four point pairs are right", why)]
    odd = suspect(work, ideal, residuals) if count > 5 else None
    remedy = _AGAIN if source == _SOURCE else _LIES_FLAT + _BENDS * (camera is None)
    if odd is not None and odd.error > _WRONG_PX and odd.chance < _WRONG_CHANCE:
        what = f"{told[odd.index]} is wrong: the others put it {short(odd.error, 1)} px away"
        raise JobError(source, what, remedy=remedy)
    error = math.sqrt(float(residuals @ residuals) / (2 * count - 8))
    if error > max(_CONTRADICT_PX, _CONTRADICT_PART * float(np.linalg.norm(np.ptp(ideal, axis=0)))):
        odd = odd or most_distorted(work, ideal, None if camera is None else camera.matrix)
        raise JobError(source, _contradiction(odd, told, error), remedy=remedy)
    worst = int(np.argmax(residuals))
    if residuals[worst] > _LOOK_PX:
        return [
            Note(
                "warning",
                f"{told[worst]} is {short(float(residuals[worst]), 1)} px off the plane of all pairs",
            )
        ]
    return []


def _contradiction(odd: Suspect, told: Sequence[str], error: float) -> str:
    return (
        f"the point pairs contradict each other by {short(error, 1)} px; most likely wrong is {told[odd.index]}, "
        f"which the others put {short(odd.error, 1)} px away"
    )


def _see_from_above(found: FloatArray, work: FloatArray, source: str) -> None:
    """A plane seen from above turns about in the photo, where v runs down and y up: its determinant is negative."""
    if depth(found, work).min() <= 0:
        what = "the points do not lie on a plane in front of the camera"
        raise JobError(source, what, remedy="check that both lists are in the same order")
    if np.linalg.det(found) > 0:
        remedy = "seen from above, y runs up where v runs down: check the sign of y, and the order of the points"
        raise JobError(source, "the points are mirrored", remedy=remedy)


def _point(values: FloatArray) -> str:
    return "[" + ", ".join(short(float(v), 3) for v in values) + "]"
