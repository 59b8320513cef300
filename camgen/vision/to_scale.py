"""Photo to a to-scale view of the work plane: lens distortion and perspective out, in one remap (PIST, section 3.1).

A view pixel is a place in mm, that is an undistorted pixel (homography), that is a photo pixel (distortion); the map is
in ``remap``. The photo is interpolated linearly, which OpenCV 5 does exactly; its cubic and Lanczos kernels, and
pictures of two channels, are quantised to 1/32 px.

The scale is the finest that the photo has anywhere in the region, rounded down to three digits: the view is nowhere
coarser than the photo.
"""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.model.errors import InputError, JobError
from camgen.model.part import Note
from camgen.model.pose import FloatArray, frozen
from camgen.model.text import short
from camgen.vision.camera.camera import Camera, distort, undistort
from camgen.vision.image import Picture, Pixels
from camgen.vision.plane import Plane, depth, map_points, same_pixels, scales

# The map from view pixels to photo pixels: exact at the nodes of a coarse grid, linear between, used in strips.

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
_OUTSIDE_PX = 100.0


class Shown(Struct, frozen=True, eq=False):
    """What a photo of ``size`` (width, height) px shows of a plane, through a camera or as a pinhole (None).

    reach: how far from the camera's principal point the lens model is used, undistorted px. That is beyond the corners
    of the photo, unless the model turns back before; what the photo shows further out has no place on the plane.
    """

    camera: Camera | None
    plane: Plane
    size: tuple[int, int]
    reach: float


def show_by(camera: Camera | None, plane: Plane, size: tuple[int, int]) -> Shown:
    """The plane in a photo of this size, px."""
    if camera is None:
        return Shown(camera, plane, size, np.inf)
    middle = camera.matrix[:2, 2]
    away = np.linalg.norm(undistort(camera, photo_grid(size, 17)) - middle, axis=1)
    reach = _BEYOND * float(away.max(initial=0, where=np.isfinite(away)))
    angles = np.arange(_DIRECTIONS) * 2 * np.pi / _DIRECTIONS
    around = np.column_stack([np.cos(angles), np.sin(angles)])
    while not np.isfinite(distort(camera, middle + reach * around)).all():
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
        ideal = undistort(shown.camera, px)
        known = np.linalg.norm(ideal - shown.camera.matrix[:2, 2], axis=1) <= shown.reach
    front = known & (depth(shown.plane.work_from_pixel, ideal) > 0)
    found = np.full(ideal.shape, np.nan)
    found[front] = map_points(shown.plane.work_from_pixel, ideal[front])
    return found


def photo_from_work(shown: Shown, mm: FloatArray) -> FloatArray:
    """Photo pixels (N, 2) of places on the plane (N, 2), mm; far outside for those that the photo does not show."""
    found, away = _continue(shown, mm)
    # Only a model that turns back within the photo leaves room there for what lies beyond its reach.
    hidden = (away > shown.reach) & np.all(
        (found >= 0) & (found <= np.array(shown.size) - 1), axis=1
    )
    found[hidden] = _NOWHERE
    return found


def _continue(shown: Shown, mm: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Photo pixels (N, 2), far outside beyond the horizon, and how far from the principal point they are, (N,)
    undistorted px.

    The lens model says nothing beyond the place where it turns back. Beyond the reach the photo is therefore continued
    without further distortion, smoothly enough to interpolate.
    """
    found, distance = np.full(mm.shape, _NOWHERE), np.zeros(len(mm))
    front = depth(shown.plane.pixel_from_work, mm) > 0
    ideal = map_points(shown.plane.pixel_from_work, mm[front]).clip(_NOWHERE / 2, -_NOWHERE / 2)
    if shown.camera is None or not len(ideal):
        found[front] = ideal
        return found, distance
    middle = shown.camera.matrix[:2, 2]
    away = np.linalg.norm(ideal - middle, axis=1)
    held = middle + (ideal - middle) * (shown.reach / np.maximum(away, shown.reach))[:, None]
    found[front], distance[front] = distort(shown.camera, held) + (ideal - held), away
    return found, distance


def mm_per_pixel(shown: Shown, mm: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The finest and the coarsest mm per photo pixel (N,), over all directions, at places on the plane (N, 2)."""
    step = 0.25 / scales(shown.plane.pixel_from_work, mm)[:, 1:]
    columns = []
    for axis in np.eye(2):
        after, before = _continue(shown, mm + step * axis)[0], _continue(shown, mm - step * axis)[0]
        columns.append((after - before) / (2 * step))
    sizes = np.linalg.svd(np.stack(columns, axis=2), compute_uv=False)
    return 1 / sizes[:, 0], 1 / sizes[:, 1].clip(np.finfo(float).tiny)


def remap(
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
        wide = cv2.resize(
            some, (some.shape[1] * step, some.shape[0] * step), interpolation=cv2.INTER_LINEAR
        )
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
    valid: NDArray[np.bool_],
    inside: NDArray[np.bool_],
    step: int,
    places: NDArray[np.float32],
    size: tuple[int, int],
) -> None:
    """Sets what of a strip the photo shows: pixels between columns of nodes that are all ``inside``, one run of them,
    are in it; the others are looked at singly.
    """
    run = np.flatnonzero(inside)
    start = end = 0
    if len(run) and run[-1] - run[0] + 1 == len(run):
        start, end = (
            min(max((i - 1) * step + step // 2, 0), valid.shape[1]) for i in run[[0, -1]].tolist()
        )
    valid[:, start:end] = True
    for first, beyond in ((0, start), (end, valid.shape[1])):
        if first < beyond:
            valid[:, first:beyond] = _in_photo(places[:, first:beyond], size, 0)


def _nodes(
    shown: Shown, work_from_view: FloatArray, size: tuple[int, int]
) -> tuple[int, NDArray[np.float32]]:
    """The largest step that is exact enough, and photo pixels (rows, columns, 2) of the nodes, one beyond each side.

    Cubic interpolation from the exact nodes to these is off by at most 3/128 of the fourth differences along each axis,
    linear interpolation between these by 1/16 of the second differences, to either side (see _finer).
    """
    exact = next(
        grid
        for step in _STEPS
        if (grid := _exact(shown, work_from_view, size, step)).error * 3 / 128 <= _CUBIC_ERROR
        or step == _STEPS[-1]
    )
    limit = _LINEAR_ERROR * 16
    step = next(
        (s for s in _STEPS if s <= exact.step and exact.bend * (s / exact.step) ** 2 <= limit),
        _STEPS[-1],
    )
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
    mm = (
        np.column_stack([across.ravel(), along.ravel()]) @ work_from_view[:, :2].T
        + work_from_view[:, 2]
    )
    places = photo_from_work(shown, mm).reshape(len(v), len(u), 2)
    around = np.all((places > -_OUTSIDE_PX) & (places < np.array(shown.size) + _OUTSIDE_PX), axis=2)
    return _Exact(step, places, _differences(places, around, 2), _differences(places, around, 4))


def _differences(places: FloatArray, around: NDArray[np.bool_], order: int) -> float:
    """The largest differences of this order over neighbours that are all around the photo, both axes together, px."""
    total = 0.0
    for values, usable in ((places, around), (places.swapaxes(0, 1), around.T)):
        if len(values) > order:
            whole = np.all(
                np.lib.stride_tricks.sliding_window_view(usable, order + 1, axis=0), axis=2
            )
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
        parts = [
            np.take(places, row, axis) * w.reshape(shape)
            for row, w in zip(rows, weights, strict=True)
        ]
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


Region = tuple[float, float, float, float]

_MM_PER_INCH = 25.4
#: Without a region, places where a photo pixel is so many times as coarse as the finest one are left out.
_COARSER = 4.0
#: A view of more pixels than the photo times this is refused: the plane is seen at too flat an angle.
_LARGER = 6.0
#: The photo, or the region, is sampled at so many places along each side to find region and scale.
_PHOTO_SAMPLES = 33


class ScaledView(Struct, frozen=True, eq=False):
    """A to-scale picture of the work plane.

    pixels: (H, W) grey or (H, W, 3) blue, green, red; uint8. work_from_view: (2, 3), mm of the centre of pixel (u, v),
    x to the right, y up. valid: which pixels the photo shows, (H, W) bool; None: all.
    """

    pixels: Pixels
    work_from_view: FloatArray
    mm_per_px: float
    valid: NDArray[np.bool_] | None = None
    notes: tuple[Note, ...] = ()


def already_to_scale(
    picture: Picture,
    mm_per_px: float | None = None,
    width_mm: float | None = None,
    dpi: float | None = None,
) -> ScaledView:
    """The view of a picture that needs no rectification; the origin is the lower left corner of its lower left pixel.

    Its scale is one of the three, else the picture's own DPI. JobError for two of them or one that is not positive,
    InputError if there is none at all.
    """
    height, width = picture.pixels.shape[:2]
    ways = {"mm_per_px": mm_per_px, "width_mm": width_mm, "dpi": dpi}
    given = {name: value for name, value in ways.items() if value is not None}
    if len(given) > 1:
        raise JobError(
            "[image]", f"{' and '.join(given)} are both given", remedy="give one of them"
        )
    for name, value in given.items():
        if not (math.isfinite(value) and value > 0):
            raise JobError(f"[image] {name}", f"must be more than 0, not {value}")
    if mm_per_px is None:
        dots = dpi if dpi is not None else picture.dpi
        if width_mm is not None:
            mm_per_px = width_mm / width
        elif dots is not None:
            mm_per_px = _MM_PER_INCH / dots
        else:
            raise _no_scale(picture)
    notes = (
        ()
        if given
        else (Note("assumed", f"scale of {short(mm_per_px, 5)} mm/px from the file's DPI"),)
    )
    s = mm_per_px
    return ScaledView(
        picture.pixels, frozen([[s, 0, s / 2], [0, -s, (height - 0.5) * s]]), s, None, notes
    )


def cut_out(view: ScaledView, region: Region | None, coarser: int = 1) -> ScaledView:
    """What ``view`` shows of ``region`` (mm), in pixels so many times as large. InputError where it shows nothing."""
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    pixels, matrix = view.pixels, view.work_from_view
    if region is not None:
        height, width = pixels.shape[:2]
        corners = np.array([[region[0], region[3]], [region[2], region[1]]])
        (left, top), (right, bottom) = (
            np.linalg.solve(matrix[:, :2], (corners - matrix[:, 2]).T).T.round().astype(int)
        )
        left, top, right, bottom = (
            max(left, 0),
            max(top, 0),
            min(right + 1, width),
            min(bottom + 1, height),
        )
        if left >= right or top >= bottom:
            remedy = "check its corners, in mm from the lower left corner of the picture"
            raise InputError("picture", "does not show the region", _describe(region), remedy)
        pixels = np.ascontiguousarray(pixels[top:bottom, left:right])
        matrix = np.column_stack([matrix[:, :2], matrix @ (left, top, 1.0)])
    if coarser > 1:
        size = (max(pixels.shape[1] // coarser, 1), max(pixels.shape[0] // coarser, 1))
        whole = pixels[: size[1] * coarser, : size[0] * coarser]
        pixels = cv2.resize(whole, size, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)
        shift = (coarser - 1) / 2
        matrix = np.column_stack([matrix[:, :2] * coarser, matrix @ (shift, shift, 1.0)])
    return ScaledView(pixels, frozen(matrix), view.mm_per_px * coarser, None, view.notes)


def _no_scale(picture: Picture) -> InputError:
    unused = next(
        (
            f" ({note.what}: {note.why})"
            for note in picture.notes
            if "not used as a scale" in note.what
        ),
        "",
    )
    return InputError(
        picture.name,
        f"has no scale{unused}",
        remedy="give [page] size to draw it on paper, [image] mm_per_px or width_mm for a picture that is to scale, "
        "save it with its DPI, or give [camera] points_px and points_mm, plane_from, or markers for a photo",
    )


def rectify(
    picture: Picture,
    camera: Camera | None,
    plane: Plane,
    region: Region | None = None,
    coarser: int = 1,
) -> ScaledView:
    """The to-scale view of what the photo shows of the plane, or of ``region`` (x and y from, x and y to, mm).

    coarser: for a look at the whole, which costs less the coarser it is: pixels so many times as large.
    InputError if the photo does not show the region, or so flatly that the view would be far larger than the photo.
    """
    if camera is not None:
        same_pixels(picture, camera)
    height, width = picture.pixels.shape[:2]
    shown = show_by(camera, plane, (width, height))
    notes: list[Note] = []
    box, finest = _whole(shown, picture, notes) if region is None else _part(shown, picture, region)
    scale = _clean(finest) * coarser
    left, low = (math.floor(v / scale) for v in box[:2])
    right, high = (math.ceil(v / scale) for v in box[2:])
    columns, rows = right - left + 1, high - low + 1
    if columns * rows > _LARGER * width * height:
        what = f"its view would have {columns} x {rows} pixels, over {_LARGER:.0f} times those of the photo"
        raise InputError(
            picture.name,
            what,
            remedy="give a smaller region around the part, or take it from above",
        )
    work_from_view = frozen([[scale, 0, left * scale], [0, -scale, high * scale]])
    pixels, valid = remap(picture.pixels, shown, work_from_view, (columns, rows))
    for array in (pixels, valid):
        array.flags.writeable = False
    return ScaledView(pixels, work_from_view, scale, None if valid.all() else valid, tuple(notes))


def frame_view(
    view: ScaledView, camera: Camera | None, plane: Plane, size: tuple[int, int]
) -> FloatArray:
    """The border of the view in a photo of ``size`` (width, height), (N, 2) px; nan where the lens shows nothing."""
    height, width = view.pixels.shape[:2]
    steps = np.linspace(0.0, 1.0, _PHOTO_SAMPLES)[:-1]
    corners = np.array(
        [[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]], dtype=np.float64
    )
    sides = corners[:, None] + steps[:, None] * (np.roll(corners, -1, axis=0) - corners)[:, None]
    mm = sides.reshape(-1, 2) @ view.work_from_view[:, :2].T + view.work_from_view[:, 2]
    return photo_from_work(show_by(camera, plane, size), mm)


def _whole(shown: Shown, picture: Picture, notes: list[Note]) -> tuple[Region, float]:
    """Box and finest mm/px of all that the photo shows, but for what is much coarser than its finest place."""
    places = work_from_photo(shown, photo_grid(shown.size, _PHOTO_SAMPLES))
    front = places[np.isfinite(places).all(axis=1)]
    if not len(front):
        raise InputError(
            picture.name, "does not show the work plane", remedy="check the points or the pose"
        )
    finest, coarsest = mm_per_pixel(shown, front)
    kept = front[coarsest <= _COARSER * finest.min()]
    if not len(kept):
        raise InputError(
            picture.name, "sees the work plane on edge", remedy="take the photo from above"
        )
    part = 1 - len(kept) / len(places)
    if part > 0:
        why = "there it is too far away, or seen too flatly; a part that reaches there is refused"
        notes.append(Note("assumed", f"{100 * part:.0f} % of the photo left out of the view", why))
    return (*kept.min(axis=0).tolist(), *kept.max(axis=0).tolist()), float(finest.min())


def _part(shown: Shown, picture: Picture, region: Region) -> tuple[Region, float]:
    """The region, and the finest mm/px of what the photo shows of it."""
    x0, y0, x1, y1 = region
    if not (all(map(math.isfinite, region)) and x0 < x1 and y0 < y1):
        remedy = "give [x from, y from, x to, y to] in mm"
        raise JobError("region", f"{list(region)} is no rectangle", remedy=remedy)
    x, y = np.meshgrid(np.linspace(x0, x1, _PHOTO_SAMPLES), np.linspace(y0, y1, _PHOTO_SAMPLES))
    places = np.column_stack([x.ravel(), y.ravel()])
    px = photo_from_work(shown, places)
    inside = places[np.all((px >= 0) & (px <= np.array(shown.size) - 1), axis=1)]
    if not len(inside):
        remedy = "check its corners, in mm of the work frame"
        raise InputError(picture.name, "does not show the region", _describe(region), remedy)
    return region, float(mm_per_pixel(shown, inside)[0].min())


def _describe(region: Region) -> str:
    return "[" + ", ".join(short(v, 3) for v in region) + "] mm"


def _clean(scale: float) -> float:
    """``scale`` rounded down to three digits."""
    digits = 2 - math.floor(math.log10(scale))
    return float(f"{math.floor(scale * 10**digits * (1 + 1e-12))}e{-digits}")
