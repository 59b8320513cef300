"""The map from view pixels to photo pixels: exact at the nodes of a coarse grid, linear between, used in strips."""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.pose import FloatArray
from camgen.vision.camera import Camera, distorted, undistorted
from camgen.vision.homography import depth, mapped, scales
from camgen.vision.image import Pixels
from camgen.vision.plane import Plane

#: Distances of nodes that are tried, view pixels, and how far off both interpolations may be, photo px.
_STEPS = (32, 16, 8, 4, 2)
_CUBIC_ERROR, _LINEAR_ERROR = 0.0002, 0.0015
#: Rows of the map that exist at once: a multiple of every step.
_STRIP = 128
#: Where a view pixel has no place in the photo.
_NOWHERE = -1e6
#: The lens model is used as far out as the corners of the photo reach, and a little further for the nodes around them,
#: where it does not turn back before; that is looked for in so many directions and in such steps.
_BEYOND, _DIRECTIONS, _BACK = 1.05, 64, 0.99
#: Nodes up to so many px outside of the photo matter for what is inside.
_ROOM = 100.0


class Shown(Struct, frozen=True, eq=False):
    """What a photo of ``size`` (width, height) px shows of a plane, through a camera or as a pinhole (None).

    reach: how far from the camera's principal point the lens model is used, undistorted px. That is beyond the corners
    of the photo, unless the model turns back before; what the photo shows further out has no place on the plane.
    """

    camera: Camera | None
    plane: Plane
    size: tuple[int, int]
    reach: float


def shown_by(camera: Camera | None, plane: Plane, size: tuple[int, int]) -> Shown:
    """The plane in a photo of this size, px."""
    if camera is None:
        return Shown(camera, plane, size, np.inf)
    middle = camera.matrix[:2, 2]
    away = np.linalg.norm(undistorted(camera, photo_grid(size, 17)) - middle, axis=1)
    reach = _BEYOND * float(away.max(initial=0, where=np.isfinite(away)))
    angles = np.arange(_DIRECTIONS) * 2 * np.pi / _DIRECTIONS
    around = np.column_stack([np.cos(angles), np.sin(angles)])
    while not np.isfinite(distorted(camera, middle + reach * around)).all():
        reach *= _BACK
    return Shown(camera, plane, size, reach)


def photo_grid(size: tuple[int, int], count: int) -> FloatArray:
    """``count`` x ``count`` pixels from corner to corner of the photo: (N, 2)."""
    u, v = np.meshgrid(*(np.linspace(0, length - 1, count) for length in size))
    return np.column_stack([u.ravel(), v.ravel()])


def work_from_photo(shown: Shown, px: FloatArray) -> FloatArray:
    """Places on the plane (N, 2), mm, of photo pixels (N, 2); nan beyond the horizon and the lens model's reach."""
    ideal, known = px, np.ones(len(px), dtype=np.bool_)
    if shown.camera is not None:
        ideal = undistorted(shown.camera, px)
        known = np.linalg.norm(ideal - shown.camera.matrix[:2, 2], axis=1) <= shown.reach
    front = known & (depth(shown.plane.work_from_pixel, ideal) > 0)
    found = np.full(ideal.shape, np.nan)
    found[front] = mapped(shown.plane.work_from_pixel, ideal[front])
    return found


def photo_from_work(shown: Shown, mm: FloatArray) -> FloatArray:
    """Photo pixels (N, 2) of places on the plane (N, 2), mm; far outside for those that the photo does not show."""
    found, away = _continued(shown, mm)
    # Only a model that turns back within the photo leaves room there for what lies beyond its reach.
    hidden = (away > shown.reach) & np.all((found >= 0) & (found <= np.array(shown.size) - 1), axis=1)
    found[hidden] = _NOWHERE
    return found


def _continued(shown: Shown, mm: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Photo pixels (N, 2), far outside beyond the horizon, and how far from the principal point they are, (N,)
    undistorted px.

    The lens model says nothing beyond the place where it turns back. Beyond the reach the photo is therefore continued
    without further distortion, smoothly enough to interpolate.
    """
    found, distance = np.full(mm.shape, _NOWHERE), np.zeros(len(mm))
    front = depth(shown.plane.pixel_from_work, mm) > 0
    ideal = mapped(shown.plane.pixel_from_work, mm[front]).clip(_NOWHERE / 2, -_NOWHERE / 2)
    if shown.camera is None or not len(ideal):
        found[front] = ideal
        return found, distance
    middle = shown.camera.matrix[:2, 2]
    away = np.linalg.norm(ideal - middle, axis=1)
    held = middle + (ideal - middle) * (shown.reach / np.maximum(away, shown.reach))[:, None]
    found[front], distance[front] = distorted(shown.camera, held) + (ideal - held), away
    return found, distance


def mm_per_pixel(shown: Shown, mm: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The finest and the coarsest mm per photo pixel (N,), over all directions, at places on the plane (N, 2)."""
    step = 0.25 / scales(shown.plane.pixel_from_work, mm)[:, 1:]
    columns = []
    for axis in np.eye(2):
        after, before = _continued(shown, mm + step * axis)[0], _continued(shown, mm - step * axis)[0]
        columns.append((after - before) / (2 * step))
    sizes = np.linalg.svd(np.stack(columns, axis=2), compute_uv=False)
    return 1 / sizes[:, 0], 1 / sizes[:, 1].clip(np.finfo(float).tiny)


def remapped(
    photo: Pixels, shown: Shown, work_from_view: FloatArray, size: tuple[int, int]
) -> tuple[Pixels, NDArray[np.bool_]]:
    """The view of ``size`` (width, height) pixels, and where the photo shows something; it is black elsewhere."""
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    width, height = size
    step, nodes = _nodes(shown, work_from_view, size)
    inside = _in_photo(nodes, shown.size, 0)
    # The view is nowhere coarser than the photo: neighbouring nodes are at most so far apart in it.
    around = _in_photo(nodes, shown.size, 2 * step)
    view = np.zeros((height, width, *photo.shape[2:]), dtype=photo.dtype)
    valid = np.zeros((height, width), dtype=np.bool_)
    for top in range(0, height, _STRIP):
        rows = min(_STRIP, height - top)
        near = np.s_[top // step : (top + rows + step - 1) // step + 2]
        seen = np.flatnonzero(around[near].any(axis=0))
        if not len(seen):
            continue
        columns = np.s_[max(int(seen[0]) - 1, 0) : int(seen[-1]) + 2]
        some = nodes[near, columns]
        # Node i lies at pixel (i - 1) step + (step - 1) / 2: where resizing by step puts it, one step further out.
        left, right = columns.start * step, min((columns.start + some.shape[1] - 2) * step, width)
        if left >= right:
            continue
        wide = cv2.resize(some, (some.shape[1] * step, some.shape[0] * step), interpolation=cv2.INTER_LINEAR)
        places = wide[step : step + rows, step : step + right - left].astype(np.float32, copy=False)
        strip = np.s_[top : top + rows, left:right]
        # One map holds u and v; OpenCV's stubs do not know that the second one is None then.
        border = cv2.BORDER_CONSTANT
        cv2.remap(photo, places, None, cv2.INTER_LINEAR, dst=view[strip], borderMode=border)  # type: ignore[call-overload]
        _mark(valid[strip], np.all(inside[near, columns], axis=0), step, places, shown.size)
    return view, valid


def _in_photo(places: NDArray[np.float32], size: tuple[int, int], room: float) -> NDArray[np.bool_]:
    """Which places (rows, columns, 2), px, are in the photo or at most ``room`` px outside of it."""
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    found = cv2.inRange(places, (-room, -room), (size[0] - 1.0 + room, size[1] - 1.0 + room))
    return np.asarray(found, dtype=np.bool_)


def _mark(
    valid: NDArray[np.bool_], inside: NDArray[np.bool_], step: int, places: NDArray[np.float32], size: tuple[int, int]
) -> None:
    """Sets what of a strip the photo shows: pixels between columns of nodes that are all ``inside``, one run of them,
    are in it; the others are looked at singly.
    """
    run = np.flatnonzero(inside)
    start = end = 0
    if len(run) and run[-1] - run[0] + 1 == len(run):
        start, end = (min(max((i - 1) * step + step // 2, 0), valid.shape[1]) for i in run[[0, -1]].tolist())
    valid[:, start:end] = True
    for first, beyond in ((0, start), (end, valid.shape[1])):
        if first < beyond:
            valid[:, first:beyond] = _in_photo(places[:, first:beyond], size, 0)


def _nodes(shown: Shown, work_from_view: FloatArray, size: tuple[int, int]) -> tuple[int, NDArray[np.float32]]:
    """The largest step that is exact enough, and photo pixels (rows, columns, 2) of the nodes, one beyond each side.

    Cubic interpolation from the exact nodes to these is off by at most 3/128 of the fourth differences along each axis,
    linear interpolation between these by 1/16 of the second differences, to either side (see _finer).
    """
    exact = next(
        grid
        for step in _STEPS
        if (grid := _exact(shown, work_from_view, size, step)).error * 3 / 128 <= _CUBIC_ERROR or step == _STEPS[-1]
    )
    limit = _LINEAR_ERROR * 16
    step = next((s for s in _STEPS if s <= exact.step and exact.bend * (s / exact.step) ** 2 <= limit), _STEPS[-1])
    return step, _finer(exact, step, size)


class _Exact(Struct, frozen=True, eq=False):
    """Photo pixels (rows, columns, 2) of nodes ``step`` view pixels apart, two beyond each side and the second of them
    at least a step; bend, error: the largest sum of second and of fourth differences around the photo, px.
    """

    step: int
    places: FloatArray
    bend: float
    error: float


def _exact(shown: Shown, work_from_view: FloatArray, size: tuple[int, int], step: int) -> _Exact:
    u, v = ((np.arange(-(-length // step) + 5) - 2) * step for length in size)
    across, along = np.meshgrid(u, v)
    mm = np.column_stack([across.ravel(), along.ravel()]) @ work_from_view[:, :2].T + work_from_view[:, 2]
    places = photo_from_work(shown, mm).reshape(len(v), len(u), 2)
    around = np.all((places > -_ROOM) & (places < np.array(shown.size) + _ROOM), axis=2)
    return _Exact(step, places, _differences(places, around, 2), _differences(places, around, 4))


def _differences(places: FloatArray, around: NDArray[np.bool_], order: int) -> float:
    """The largest differences of this order over neighbours that are all around the photo, both axes together, px."""
    total = 0.0
    for values, usable in ((places, around), (places.swapaxes(0, 1), around.T)):
        if len(values) > order:
            whole = np.all(np.lib.stride_tricks.sliding_window_view(usable, order + 1, axis=0), axis=2)
            total += float((np.abs(np.diff(values, order, axis=0)) * whole[..., None]).max())
    return total


def _finer(exact: _Exact, step: int, size: tuple[int, int]) -> NDArray[np.float32]:
    """Nodes ``step`` pixels apart at (i - 1) step + (step - 1) / 2, by cubic interpolation between the exact ones.

    A line between two points of a curve lies on its hollow side, by an eighth of the second difference. The nodes are
    shifted by half of that to the other side: the error is halved.
    """
    lost = exact.places[..., 0] == _NOWHERE
    places = exact.places
    for axis, length in ((0, size[1]), (1, size[0])):
        at = ((np.arange(-(-length // step) + 2) - 1) * step + (step - 1) / 2) / exact.step + 2
        first = np.floor(at).astype(np.int64) - 1
        weights = _cubic(at - first - 1, (step / exact.step) ** 2 / 16)
        rows = [first + k for k in range(4)]
        shape = [1] * 3
        shape[axis] = -1
        parts = [np.take(places, row, axis) * w.reshape(shape) for row, w in zip(rows, weights, strict=True)]
        places = parts[0] + parts[1] + parts[2] + parts[3]
        lost = np.any([np.take(lost, row, axis) for row in rows], axis=0)
    places[lost] = _NOWHERE
    return places.astype(np.float32)


def _cubic(t: FloatArray, shift: float) -> tuple[FloatArray, ...]:
    """Weights of four equidistant values for a place ``t`` of 0 to 1 between the middle two: those of Lagrange's cubic
    less ``shift`` times those of its second derivative.
    """
    return (
        -t * (t - 1) * (t - 2) / 6 - shift * (1 - t),
        (t + 1) * (t - 1) * (t - 2) / 2 - shift * (3 * t - 2),
        -(t + 1) * t * (t - 2) / 2 - shift * (1 - 3 * t),
        (t + 1) * t * (t - 1) / 6 - shift * t,
    )
