"""Homographies between two planes: the direct linear transformation, its refinement, and pairs that do not fit.

Hartley and Zisserman, Multiple View Geometry, 2nd edition: normalisation and DLT in 4.4, the error that is minimised
(the one in the image) in 4.5. Points are (N, 2) arrays; ``source`` points are mapped to ``image`` points.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.pose import FloatArray

#: Below this ratio of breadth to length a set of points is a line.
_LINE = 0.02
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


def mapped(homography: FloatArray, points: FloatArray) -> FloatArray:
    """``points`` (N, 2) through ``homography`` (3, 3): (N, 2)."""
    lifted = points @ homography[:, :2].T + homography[:, 2]
    moved: FloatArray = lifted[:, :2] / lifted[:, 2:]
    return moved


def depth(homography: FloatArray, points: FloatArray) -> FloatArray:
    """The divisor of each point (N,): of one sign on one side of the horizon, of the other beyond it."""
    divisor: FloatArray = points @ homography[2, :2] + homography[2, 2]
    return divisor


def fitted(source: FloatArray, image: FloatArray) -> FloatArray:
    """The homography (3, 3) with the least squared distances in the image; four or more pairs in general position.

    Its scale is 1 (Frobenius), its sign such that the divisor is positive at the middle of the source points.
    """
    to_source, to_image = _normalisation(source), _normalisation(image)
    start = _dlt(mapped(to_source, source), mapped(to_image, image))
    # At the middle of the points, (0, 0) here, the divisor is not zero unless the pairs make no sense at all.
    best = _refined(start / start[2, 2], mapped(to_source, source), mapped(to_image, image)) if start[2, 2] else start
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
    return worst if ratio[worst] < _LINE else None


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
        found = fitted(source[rest], image[rest])
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
    jacobian = (homography[None, :2, :2] - place[:, :, None] * homography[None, 2:, :2]) / lifted[:, 2, None, None]
    sizes: FloatArray = np.linalg.svd(jacobian, compute_uv=False)[:, ::-1].astype(np.float64, copy=False)
    return sizes


def _stretch(homography: FloatArray, source: FloatArray) -> float:
    if depth(homography, source).min() <= 0:
        return np.inf
    all_scales = scales(homography, source)
    return float(np.log(all_scales.max() / all_scales.min()))


def _error_of(source: FloatArray, image: FloatArray, index: int) -> float:
    rest = np.arange(len(source)) != index
    predicted = mapped(fitted(source[rest], image[rest]), source[index : index + 1])
    return float(np.linalg.norm(predicted[0] - image[index]))


def _squares_without(source: FloatArray, image: FloatArray, index: int) -> float:
    rest = np.arange(len(source)) != index
    if in_line(source[rest]) is not None or in_line(image[rest]) is not None:
        return np.inf
    return float(np.sum((mapped(fitted(source[rest], image[rest]), source[rest]) - image[rest]) ** 2))


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


def _refined(start: FloatArray, source: FloatArray, image: FloatArray) -> FloatArray:
    """Gauss-Newton on the eight parameters beside the last, which stays 1; a step that does not help ends it."""
    lifted = np.column_stack([source, np.ones(len(source))])
    nothing = np.zeros_like(lifted)
    best, least = start, np.inf
    current = start
    for _ in range(_ROUNDS):
        moved = mapped(current, source)
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
