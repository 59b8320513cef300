"""Rectifies a photo: the view has constant scale and is perpendicular to the work plane.

A pixel of the view is a place in mm. A homography maps it to an undistorted pixel, and the lens
model maps that to a pixel of the photo. So lens distortion and perspective are removed in one step
(PIST, section 3.1), by `remap`. The photo is interpolated linearly, which OpenCV 5 does exactly.
Its cubic and Lanczos kernels, and pictures of two channels, are quantised to 1/32 px.

The scale is the finest that the photo has anywhere in the region, rounded down to three digits: the
view is nowhere coarser than the photo.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.model.errors import InputError, JobError
from camgen.model.part import IntArray, Note
from camgen.model.pose import FloatArray, frozen
from camgen.model.text import short
from camgen.vision.camera.camera import Camera, distort, sample_photo, undistort
from camgen.vision.image import Picture, Pixels
from camgen.vision.plane import (
    Plane,
    check_pixels,
    compute_depth,
    compute_scales,
    format_numbers,
    map_points,
)

# The map from pixels of the view to pixels of the photo. It is exact at the nodes of a coarse grid
# and linear between nodes, and is computed in strips.

#: Distances between nodes that are tried, view pixels.
_STEPS = (32, 16, 8, 4, 2)
#: Largest error of the cubic interpolation between exact nodes, photo pixels.
_CUBIC_ERROR = 0.0002
#: Largest error of the linear interpolation between nodes, photo pixels.
_LINEAR_ERROR = 0.0015
#: Rows of the map that exist at once: a multiple of every step.
_STRIP = 128
#: Coordinate, px, of a place that the photo does not show.
_NOWHERE = -1e6
#: The lens model is used a little beyond the corners of the photo, for the nodes around them: this
#: factor on their distance from the principal point.
_BEYOND_CORNERS = 1.05
#: The distance is reduced by this factor until the lens model is defined
_REDUCTION = 0.99
#: in this number of directions.
_DIRECTIONS = 64
#: px: nodes up to this distance outside of the photo affect pixels inside of it.
_OUTSIDE_PX = 100.0


class PlaneView(Struct, frozen=True, eq=False):
    """The view of a plane in a photo.

    camera: camera with its lens; None for a pinhole without distortion.
    plane: the plane.
    size: (width, height) of the photo, px.
    reach: largest distance from the principal point at which the lens model is used, undistorted
        px. It is beyond the corners of the photo, unless the model is valid only to a smaller
        radius. Then the photo shows no place of the plane further out.
    """

    camera: Camera | None
    plane: Plane
    size: tuple[int, int]
    reach: float


@lru_cache(maxsize=2)
def make_plane_view(camera: Camera | None, plane: Plane, size: tuple[int, int]) -> PlaneView:
    """The view of a plane in a photo of `size` (width, height), px.

    It is computed once for both looks at a photo.
    """
    if camera is None:
        return PlaneView(camera, plane, size, np.inf)
    middle = camera.matrix[:2, 2]
    distance = np.linalg.norm(undistort(camera, sample_photo(size, 17)) - middle, axis=1)
    reach = _BEYOND_CORNERS * float(distance.max(initial=0, where=np.isfinite(distance)))
    angles = np.arange(_DIRECTIONS) * 2 * np.pi / _DIRECTIONS
    directions = np.column_stack([np.cos(angles), np.sin(angles)])
    while not np.isfinite(distort(camera, middle + reach * directions)).all():
        reach *= _REDUCTION
    return PlaneView(camera, plane, size, reach)


def map_to_work(shown: PlaneView, px: FloatArray) -> FloatArray:
    """Map photo pixels (N, 2) to places on the plane (N, 2), mm.

    nan beyond the horizon and beyond the reach of the lens model.
    """
    ideal, is_valid = px, np.ones(len(px), dtype=np.bool_)
    if shown.camera is not None:
        ideal = undistort(shown.camera, px)
        is_valid = np.linalg.norm(ideal - shown.camera.matrix[:2, 2], axis=1) <= shown.reach
    is_valid &= compute_depth(shown.plane.work_from_pixel, ideal) > 0
    mm = np.full(ideal.shape, np.nan)
    mm[is_valid] = map_points(shown.plane.work_from_pixel, ideal[is_valid])
    return mm


def map_to_photo(shown: PlaneView, mm: FloatArray) -> FloatArray:
    """Map places on the plane (N, 2), mm, to photo pixels (N, 2).

    A place that the photo does not show is far outside of it.
    """
    px, distance = _map_smoothly(shown, mm)
    # A place beyond the reach is inside the photo only if the lens model is not valid everywhere
    # in the photo. The photo shows something else there.
    is_inside = np.all((px >= 0) & (px <= np.array(shown.size) - 1), axis=1)
    px[(distance > shown.reach) & is_inside] = _NOWHERE
    return px


def _map_smoothly(shown: PlaneView, mm: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Map places on the plane (N, 2), mm, to photo pixels, smoothly enough to interpolate.

    The lens model is undefined beyond its valid radius. So beyond the reach the photo is continued
    without further distortion.

    Returns pixels (N, 2), far outside beyond the horizon, and their distance (N,) from the
    principal point, undistorted px, which is 0 there and without a camera.
    """
    px, distance = np.full(mm.shape, _NOWHERE), np.zeros(len(mm))
    is_front = compute_depth(shown.plane.pixel_from_work, mm) > 0
    ideal = map_points(shown.plane.pixel_from_work, mm[is_front]).clip(_NOWHERE / 2, -_NOWHERE / 2)
    if shown.camera is None or not len(ideal):
        px[is_front] = ideal
        return px, distance
    middle = shown.camera.matrix[:2, 2]
    ideal_distance = np.linalg.norm(ideal - middle, axis=1)
    factor = shown.reach / np.maximum(ideal_distance, shown.reach)
    within_reach = middle + (ideal - middle) * factor[:, None]
    px[is_front] = distort(shown.camera, within_reach) + (ideal - within_reach)
    distance[is_front] = ideal_distance
    return px, distance


def measure_mm_per_pixel(shown: PlaneView, mm: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The finest and the coarsest mm per photo pixel (N,) of all directions, at places (N, 2)."""
    step = 0.25 / compute_scales(shown.plane.pixel_from_work, mm)[:, 1:]
    columns = []
    for axis in np.eye(2):
        after, _ = _map_smoothly(shown, mm + step * axis)
        before, _ = _map_smoothly(shown, mm - step * axis)
        columns.append((after - before) / (2 * step))
    px_per_mm = np.linalg.svd(np.stack(columns, axis=2), compute_uv=False)
    return 1 / px_per_mm[:, 0], 1 / px_per_mm[:, 1].clip(np.finfo(float).tiny)


def remap(
    photo: Pixels,
    shown: PlaneView,
    work_from_view: FloatArray,
    size: tuple[int, int],
    coarser: int = 1,
) -> tuple[Pixels, NDArray[np.bool_]]:
    """Resample a photo to a view of `size` (width, height) pixels.

    work_from_view: (2, 3), from pixels of the view to mm.
    coarser: factor on the allowed errors, which are for pixels as fine as those of the photo.

    Returns the view, black where the photo shows nothing, and a mask (H, W) of the pixels that it
    shows.
    """
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    width, height = size
    exact, step = _choose_nodes(shown, work_from_view, size, coarser)
    view = np.zeros((height, width, *photo.shape[2:]), dtype=photo.dtype)
    valid = np.zeros((height, width), dtype=np.bool_)
    for top in range(0, height, _STRIP):
        rows = min(_STRIP, height - top)
        node_rows = np.arange(top // step, (top + rows + step - 1) // step + 2)
        nodes = _interpolate_nodes(exact, step, node_rows, size[0])
        # The view is nowhere coarser than the photo, so neighbouring nodes are at most 2 steps
        # apart.
        seen = np.flatnonzero(_is_in_photo(nodes, shown.size, 2 * step).any(axis=0))
        if not len(seen):
            continue
        columns = np.s_[max(int(seen[0]) - 1, 0) : int(seen[-1]) + 2]
        strip_nodes = nodes[:, columns]
        node_height, node_width = strip_nodes.shape[:2]
        # Node i lies at pixel (i - 1) step + (step - 1) / 2: where resizing by step puts it, one
        # step further out.
        left, right = columns.start * step, min((columns.start + node_width - 2) * step, width)
        if left >= right:
            continue
        resized = cv2.resize(
            strip_nodes, (node_width * step, node_height * step), interpolation=cv2.INTER_LINEAR
        )
        places = resized[step : step + rows, step : step + right - left].astype(
            np.float32, copy=False
        )
        strip = np.s_[top : top + rows, left:right]
        # One map holds u and v; OpenCV's stubs do not know that the second one is None then.
        cv2.remap(  # type: ignore[call-overload]
            photo,
            places,
            None,
            cv2.INTER_LINEAR,
            dst=view[strip],
            borderMode=cv2.BORDER_CONSTANT,
        )
        inside_columns = np.all(_is_in_photo(strip_nodes, shown.size, 0), axis=0)
        _mark_valid(valid[strip], inside_columns, step, places, shown.size)
    return view, valid


def _is_in_photo(
    places: NDArray[np.float32], size: tuple[int, int], margin: float
) -> NDArray[np.bool_]:
    """Whether each place (rows, columns, 2), px, is at most `margin` px outside of the photo."""
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    upper = (size[0] - 1.0 + margin, size[1] - 1.0 + margin)
    return np.asarray(cv2.inRange(places, (-margin, -margin), upper), dtype=np.bool_)


def _mark_valid(
    valid: NDArray[np.bool_],
    inside: NDArray[np.bool_],
    step: int,
    places: NDArray[np.float32],
    size: tuple[int, int],
) -> None:
    """Set the pixels of a strip (rows, columns) that the photo shows, in `valid`.

    Pixels between columns of nodes that are all inside the photo are inside too, if these columns
    are consecutive. All other pixels are tested singly.

    inside: True for each column of nodes that are all inside.
    step: distance between nodes, px.
    places: (rows, columns, 2), photo pixel of each pixel.
    size: (width, height) of the photo, px.
    """
    columns = np.flatnonzero(inside)
    start = end = 0
    if len(columns) and columns[-1] - columns[0] + 1 == len(columns):
        ends = (columns[[0, -1]] - 1) * step + step // 2
        start, end = ends.clip(0, valid.shape[1]).tolist()
    valid[:, start:end] = True
    for first, beyond in ((0, start), (end, valid.shape[1])):
        if first < beyond:
            valid[:, first:beyond] = _is_in_photo(places[:, first:beyond], size, 0)


def _choose_nodes(
    shown: PlaneView, work_from_view: FloatArray, size: tuple[int, int], coarser: int
) -> tuple[_ExactNodes, int]:
    """The exact nodes, and the distance of those between them, at which the map is exact enough.

    The error of the cubic interpolation from the exact nodes to these is at most 3/128 of the
    fourth differences along each axis. The error of the linear interpolation between these is 1/16
    of the second differences, to either side (see `_interpolate_nodes`).

    Both distances are the largest ones, view pixels.

    coarser: factor on the allowed errors.
    """
    for exact_step in _STEPS:
        exact = _compute_exact_nodes(shown, work_from_view, size, exact_step)
        if exact.fourth_difference * 3 / 128 <= _CUBIC_ERROR * coarser:
            break
    for step in _STEPS[_STEPS.index(exact.step) :]:
        if exact.second_difference * (step / exact.step) ** 2 <= _LINEAR_ERROR * coarser * 16:
            break
    return exact, step


class _ExactNodes(Struct, frozen=True, eq=False):
    """Nodes whose photo pixels are computed exactly.

    step: distance between nodes, view pixels.
    places: (rows, columns, 2), photo pixel of each node. There are two nodes beyond each side of
        the view, the second one at least a step away.
    second_difference, fourth_difference: largest differences of this order between nodes around
        the photo, the sum of both axes, px.
    """

    step: int
    places: FloatArray
    second_difference: float
    fourth_difference: float


def _compute_exact_nodes(
    shown: PlaneView, work_from_view: FloatArray, size: tuple[int, int], step: int
) -> _ExactNodes:
    u, v = ((np.arange(-(-length // step) + 5) - 2) * step for length in size)
    columns, rows = np.meshgrid(u, v)
    nodes = np.column_stack([columns.ravel(), rows.ravel()])
    mm = nodes @ work_from_view[:, :2].T + work_from_view[:, 2]
    places = map_to_photo(shown, mm).reshape(len(v), len(u), 2)
    limit = np.array(shown.size) + _OUTSIDE_PX
    usable = np.all((places > -_OUTSIDE_PX) & (places < limit), axis=2)
    second = _measure_differences(places, usable, 2)
    return _ExactNodes(step, places, second, _measure_differences(places, usable, 4))


def _measure_differences(places: FloatArray, usable: NDArray[np.bool_], order: int) -> float:
    """The largest differences of this order between usable neighbours, the sum of both axes, px.

    places: (rows, columns, 2), px.
    usable: (rows, columns), mask of the nodes that count.
    """
    total = 0.0
    for values, is_usable in ((places, usable), (places.swapaxes(0, 1), usable.T)):
        if len(values) > order:
            windows = np.lib.stride_tricks.sliding_window_view(is_usable, order + 1, axis=0)
            all_usable = np.all(windows, axis=2)
            differences = np.abs(np.diff(values, order, axis=0))
            total += float((differences * all_usable[..., None]).max())
    return total


def _interpolate_nodes(
    exact: _ExactNodes, step: int, rows: IntArray, width: int
) -> NDArray[np.float32]:
    """Photo pixels (R, columns, 2) of nodes, by cubic interpolation of exact ones.

    Node i lies at view pixel (i - 1) step + (step - 1) / 2: one node is beyond each side of a view
    of `width` pixels.

    A line between two points of a curve lies on its hollow side, at a distance of an eighth of the
    second difference. So the nodes are shifted by half of that to the other side, which halves the
    error.

    rows: (R,) numbers of the nodes along v.
    """
    is_lost = exact.places[..., 0] == _NOWHERE
    places = exact.places
    for axis, numbers in ((0, rows), (1, np.arange(-(-width // step) + 2))):
        position = ((numbers - 1) * step + (step - 1) / 2) / exact.step + 2
        first = np.floor(position).astype(np.int64) - 1
        weights = _weigh_cubic(position - first - 1, (step / exact.step) ** 2 / 16)
        shape = [1, 1, 2]
        shape[axis] = -1
        parts, lost = [], []
        for k, weight in enumerate(weights):
            # Each weight twice, for u and v: NumPy broadcasts over two numbers slowly.
            factors = np.repeat(weight, 2).reshape(shape)
            parts.append(np.take(places, first + k, axis) * factors)
            lost.append(np.take(is_lost, first + k, axis))
        places = parts[0] + parts[1] + parts[2] + parts[3]
        is_lost = np.any(lost, axis=0)
    places[is_lost] = _NOWHERE
    return places.astype(np.float32)


def _weigh_cubic(t: FloatArray, shift: float) -> tuple[FloatArray, ...]:
    """Weights of four equidistant values for a place `t`, 0 to 1 between the middle two.

    They are those of Lagrange's cubic minus `shift` times those of its second derivative.
    """
    return (
        -t * (t - 1) * (t - 2) / 6 - shift * (1 - t),
        (t + 1) * (t - 1) * (t - 2) / 2 - shift * (3 * t - 2),
        -(t + 1) * t * (t - 2) / 2 - shift * (1 - 3 * t),
        (t + 1) * t * (t - 1) / 6 - shift * t,
    )


# The view: its region and scale.

#: x and y from, x and y to, mm.
Region = tuple[float, float, float, float]

_MM_PER_INCH = 25.4
#: Without a region, places are left out where a photo pixel is more than this many times as coarse
#: as the finest one.
_MAX_COARSENESS = 4.0
#: A view may have this many times the pixels of the photo. A larger one means that the plane is
#: seen at too flat an angle.
_MAX_ENLARGEMENT = 6.0
#: Samples of the photo, or of the region, along each side, to find region and scale.
_PHOTO_SAMPLES = 33


class ScaledView(Struct, frozen=True, eq=False):
    """A rectified view of the work plane.

    pixels: (H, W) grey or (H, W, 3) blue, green, red; uint8.
    work_from_view: (2, 3), from pixel centres (u, v) to mm, x to the right and y up.
    mm_per_px: scale.
    valid: (H, W) bool, pixels that the photo shows; None for all.
    notes: notes to the user.
    """

    pixels: Pixels
    work_from_view: FloatArray
    mm_per_px: float
    valid: NDArray[np.bool_] | None = None
    notes: tuple[Note, ...] = ()

    def convert_to_work(self, pixels: FloatArray) -> tuple[tuple[float, float], ...]:
        """Convert pixels (N, 2) of the view to places in the work frame, mm."""
        lifted = np.column_stack([pixels, np.ones(len(pixels))])
        return tuple((x, y) for x, y in (lifted @ self.work_from_view.T).tolist())


def make_scaled_view(
    picture: Picture, mm_per_px: float | None = None, width_mm: float | None = None
) -> ScaledView:
    """Make the view of a picture that is to scale already.

    The origin is the lower left corner of its lower left pixel. The scale is one of the two values,
    else that of the DPI in the picture's file.

    Raises JobError for two values or one that is not positive, InputError without any scale.
    """
    height, width = picture.pixels.shape[:2]
    if mm_per_px is not None and width_mm is not None:
        raise JobError(
            "[image]", "mm_per_px and width_mm are both given", remedy="give one of them"
        )
    for name, value in (("mm_per_px", mm_per_px), ("width_mm", width_mm)):
        if value is not None and not (math.isfinite(value) and value > 0):
            raise JobError(f"[image] {name}", f"must be more than 0, not {value}")
    notes: tuple[Note, ...] = ()
    if width_mm is not None:
        mm_per_px = width_mm / width
    elif mm_per_px is None:
        if picture.dpi is None:
            raise _describe_missing_scale(picture)
        mm_per_px = _MM_PER_INCH / picture.dpi
        notes = (Note("assumed", f"scale of {short(mm_per_px, 5)} mm/px from the file's DPI"),)
    work_from_view = frozen(
        [[mm_per_px, 0, mm_per_px / 2], [0, -mm_per_px, (height - 0.5) * mm_per_px]]
    )
    return ScaledView(picture.pixels, work_from_view, mm_per_px, None, notes)


def cut_out(view: ScaledView, region: Region | None, coarser: int = 1) -> ScaledView:
    """Cut a region (mm) out of a view, and enlarge its pixels `coarser` times.

    Raises InputError if the view shows nothing of the region.
    """
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    pixels, matrix = view.pixels, view.work_from_view
    if region is not None:
        height, width = pixels.shape[:2]
        corners = np.array([[region[0], region[3]], [region[2], region[1]]])
        view_corners = np.linalg.solve(matrix[:, :2], (corners - matrix[:, 2]).T).T
        (left, top), (right, bottom) = view_corners.round().astype(int)
        left, top = max(left, 0), max(top, 0)
        right, bottom = min(right + 1, width), min(bottom + 1, height)
        if left >= right or top >= bottom:
            raise InputError(
                "picture",
                "does not show the region",
                f"{format_numbers(region)} mm",
                "check its corners, in mm from the lower left corner of the picture",
            )
        pixels = np.ascontiguousarray(pixels[top:bottom, left:right])
        matrix = np.column_stack([matrix[:, :2], matrix @ (left, top, 1.0)])
    if coarser > 1:
        size = (max(pixels.shape[1] // coarser, 1), max(pixels.shape[0] // coarser, 1))
        covered = pixels[: size[1] * coarser, : size[0] * coarser]
        means = cv2.resize(covered, size, interpolation=cv2.INTER_AREA)
        pixels = means.astype(np.uint8, copy=False)
        shift = (coarser - 1) / 2
        matrix = np.column_stack([matrix[:, :2] * coarser, matrix @ (shift, shift, 1.0)])
    return ScaledView(pixels, frozen(matrix), view.mm_per_px * coarser, None, view.notes)


def _describe_missing_scale(picture: Picture) -> InputError:
    """The error for a picture without a scale, with the reason why its DPI is not used."""
    unused = ""
    for note in picture.notes:
        if "not used as a scale" in note.what:
            unused = f" ({note.what}: {note.why})"
    return InputError(
        picture.name,
        f"has no scale{unused}",
        remedy="give [page] size to draw it on paper, [image] mm_per_px or width_mm for a picture "
        "that is to scale, save it with its DPI, or give [camera] points_px and points_mm, "
        "plane_from, or markers for a photo",
    )


def rectify(
    picture: Picture,
    camera: Camera | None,
    plane: Plane,
    region: Region | None = None,
    coarser: int = 1,
) -> ScaledView:
    """Rectify a photo: all that it shows of the work plane, or a region.

    camera: camera with its lens; None for a pinhole without distortion.
    region: x and y from, x and y to, mm; None for all.
    coarser: factor on the size of the pixels. A coarse view of the whole costs less.

    Raises InputError if the photo does not show the region, or at so flat an angle that the view
    would be far larger than the photo.
    """
    if camera is not None:
        check_pixels(picture, camera)
    height, width = picture.pixels.shape[:2]
    shown = make_plane_view(camera, plane, (width, height))
    notes: list[Note] = []
    if region is None:
        region, finest = _find_region(shown, picture, notes)
    else:
        finest = _find_scale(shown, picture, region)
    scale = _round_down(finest) * coarser
    x0, y0, x1, y1 = region
    left, bottom = math.floor(x0 / scale), math.floor(y0 / scale)
    right, top = math.ceil(x1 / scale), math.ceil(y1 / scale)
    columns, rows = right - left + 1, top - bottom + 1
    if columns * rows > _MAX_ENLARGEMENT * width * height:
        raise InputError(
            picture.name,
            f"its view would have {columns} x {rows} pixels, "
            f"over {_MAX_ENLARGEMENT:.0f} times those of the photo",
            remedy="give a smaller region around the part, or take it from above",
        )
    work_from_view = frozen([[scale, 0, left * scale], [0, -scale, top * scale]])
    pixels, valid = remap(picture.pixels, shown, work_from_view, (columns, rows), coarser)
    for array in (pixels, valid):
        array.flags.writeable = False
    return ScaledView(pixels, work_from_view, scale, None if valid.all() else valid, tuple(notes))


def sample_border(
    view: ScaledView, camera: Camera | None, plane: Plane, size: tuple[int, int]
) -> FloatArray:
    """Photo pixels (N, 2) along the border of a view, in a photo of `size` (width, height).

    A place that the photo does not show is far outside of it.
    """
    height, width = view.pixels.shape[:2]
    steps = np.linspace(0.0, 1.0, _PHOTO_SAMPLES)[:-1]
    corners = np.array(
        [[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]], dtype=np.float64
    )
    sides = corners[:, None] + steps[:, None] * (np.roll(corners, -1, axis=0) - corners)[:, None]
    mm = sides.reshape(-1, 2) @ view.work_from_view[:, :2].T + view.work_from_view[:, 2]
    return map_to_photo(make_plane_view(camera, plane, size), mm)


def _find_region(shown: PlaneView, picture: Picture, notes: list[Note]) -> tuple[Region, float]:
    """The region that the photo shows, without places that are much coarser than the finest one.

    Adds a note to `notes` if places are left out. Returns the region and its finest scale, mm/px.
    Raises InputError if the photo does not show the plane, or only its edge.
    """
    places = map_to_work(shown, sample_photo(shown.size, _PHOTO_SAMPLES))
    front = places[np.isfinite(places).all(axis=1)]
    if not len(front):
        raise InputError(
            picture.name, "does not show the work plane", remedy="check the points or the pose"
        )
    finest, coarsest = measure_mm_per_pixel(shown, front)
    kept = front[coarsest <= _MAX_COARSENESS * finest.min()]
    if not len(kept):
        raise InputError(
            picture.name, "sees the work plane on edge", remedy="take the photo from above"
        )
    fraction = 1 - len(kept) / len(places)
    if fraction > 0:
        notes.append(
            Note(
                "assumed",
                f"{100 * fraction:.0f} % of the photo left out of the view",
                "there it is too far away, or seen too flatly; "
                "a part that reaches there is refused",
            )
        )
    return (*kept.min(axis=0).tolist(), *kept.max(axis=0).tolist()), float(finest.min())


def _find_scale(shown: PlaneView, picture: Picture, region: Region) -> float:
    """The finest scale, mm/px, at places of the region that the photo shows.

    Raises JobError for an invalid region, InputError if the photo shows nothing of it.
    """
    x0, y0, x1, y1 = region
    if not (all(map(math.isfinite, region)) and x0 < x1 and y0 < y1):
        raise JobError(
            "region",
            f"{list(region)} is not a rectangle",
            remedy="give [x from, y from, x to, y to] in mm",
        )
    x, y = np.meshgrid(np.linspace(x0, x1, _PHOTO_SAMPLES), np.linspace(y0, y1, _PHOTO_SAMPLES))
    places = np.column_stack([x.ravel(), y.ravel()])
    px = map_to_photo(shown, places)
    inside = places[np.all((px >= 0) & (px <= np.array(shown.size) - 1), axis=1)]
    if not len(inside):
        raise InputError(
            picture.name,
            "does not show the region",
            f"{format_numbers(region)} mm",
            "check its corners, in mm of the work frame",
        )
    return float(measure_mm_per_pixel(shown, inside)[0].min())


def _round_down(scale: float) -> float:
    """`scale` rounded down to three digits."""
    digits = 2 - math.floor(math.log10(scale))
    return float(f"{math.floor(scale * 10**digits * (1 + 1e-12))}e{-digits}")
