"""Photo to a to-scale view of the work plane: lens distortion and perspective out, in one remap (PIST, section 3.1).

A view pixel is a place in mm, that is an undistorted pixel (homography), that is a photo pixel (distortion); the map is
in remap.py. The photo is interpolated linearly, which OpenCV 5 does exactly; its cubic and Lanczos kernels, and
pictures of two channels, are quantised to 1/32 px.

The scale is the finest that the photo has anywhere in the region, rounded down to three digits: the view is nowhere
coarser than the photo.
"""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.errors import InputError, JobError
from camgen.pose import FloatArray, frozen
from camgen.shapes import Note
from camgen.text import short
from camgen.vision.camera import Camera
from camgen.vision.image import Picture, Pixels
from camgen.vision.plane import Plane, same_pixels
from camgen.vision.remap import Shown, mm_per_pixel, photo_from_work, photo_grid, remapped, shown_by, work_from_photo

Region = tuple[float, float, float, float]

_MM_PER_INCH = 25.4
#: Without a region, places where a photo pixel is so many times as coarse as the finest one are left out.
_COARSER = 4.0
#: A view of more pixels than the photo times this is refused: the plane is seen at too flat an angle.
_LARGER = 6.0
#: The photo, or the region, is sampled at so many places along each side to find region and scale.
_SAMPLES = 33


class View(Struct, frozen=True, eq=False):
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
    picture: Picture, mm_per_px: float | None = None, width_mm: float | None = None, dpi: float | None = None
) -> View:
    """The view of a picture that needs no rectification; the origin is the lower left corner of its lower left pixel.

    Its scale is one of the three, else the picture's own DPI. JobError for two of them or one that is not positive,
    InputError if there is none at all.
    """
    height, width = picture.pixels.shape[:2]
    ways = {"mm_per_px": mm_per_px, "width_mm": width_mm, "dpi": dpi}
    given = {name: value for name, value in ways.items() if value is not None}
    if len(given) > 1:
        raise JobError("[image]", f"{' and '.join(given)} are both given", remedy="give one of them")
    for name, value in given.items():
        if not (math.isfinite(value) and value > 0):
            raise JobError(f"[image] {name}", f"{value} is no positive number")
    if mm_per_px is None:
        dots = dpi if dpi is not None else picture.dpi
        if width_mm is not None:
            mm_per_px = width_mm / width
        elif dots is not None:
            mm_per_px = _MM_PER_INCH / dots
        else:
            raise _no_scale(picture)
    notes = () if given else (Note("assumed", f"scale of {short(mm_per_px, 5)} mm/px from the file's DPI"),)
    s = mm_per_px
    return View(picture.pixels, frozen([[s, 0, s / 2], [0, -s, (height - 0.5) * s]]), s, None, notes)


def cut_out(view: View, region: Region | None, coarser: int = 1) -> View:
    """What ``view`` shows of ``region`` (mm), in pixels so many times as large. InputError where it shows nothing."""
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    pixels, matrix = view.pixels, view.work_from_view
    if region is not None:
        height, width = pixels.shape[:2]
        corners = np.array([[region[0], region[3]], [region[2], region[1]]])
        (left, top), (right, bottom) = np.linalg.solve(matrix[:, :2], (corners - matrix[:, 2]).T).T.round().astype(int)
        left, top, right, bottom = max(left, 0), max(top, 0), min(right + 1, width), min(bottom + 1, height)
        if left >= right or top >= bottom:
            remedy = "check its corners, in mm from the lower left corner of the picture"
            raise InputError("picture", "does not show the region", _told(region), remedy)
        pixels = np.ascontiguousarray(pixels[top:bottom, left:right])
        matrix = np.column_stack([matrix[:, :2], matrix @ (left, top, 1.0)])
    if coarser > 1:
        size = (max(pixels.shape[1] // coarser, 1), max(pixels.shape[0] // coarser, 1))
        whole = pixels[: size[1] * coarser, : size[0] * coarser]
        pixels = cv2.resize(whole, size, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)
        shift = (coarser - 1) / 2
        matrix = np.column_stack([matrix[:, :2] * coarser, matrix @ (shift, shift, 1.0)])
    return View(pixels, frozen(matrix), view.mm_per_px * coarser, None, view.notes)


def _no_scale(picture: Picture) -> InputError:
    unused = next((f" ({note.what}: {note.why})" for note in picture.notes if "not used as a scale" in note.what), "")
    return InputError(
        picture.name,
        f"has no scale{unused}",
        remedy="give [page] size to draw it on paper, [image] mm_per_px or width_mm for a picture that is to scale, "
        "save it with its DPI, or give [camera] points_px and points_mm, plane_from, or markers for a photo",
    )


def rectify(
    picture: Picture, camera: Camera | None, plane: Plane, region: Region | None = None, coarser: int = 1
) -> View:
    """The to-scale view of what the photo shows of the plane, or of ``region`` (x and y from, x and y to, mm).

    coarser: for a look at the whole, which costs less the coarser it is: pixels so many times as large.
    InputError if the photo does not show the region, or so flatly that the view would be far larger than the photo.
    """
    if camera is not None:
        same_pixels(picture, camera)
    height, width = picture.pixels.shape[:2]
    shown = shown_by(camera, plane, (width, height))
    notes: list[Note] = []
    box, finest = _whole(shown, picture, notes) if region is None else _part(shown, picture, region)
    scale = _clean(finest) * coarser
    left, low = (math.floor(v / scale) for v in box[:2])
    right, high = (math.ceil(v / scale) for v in box[2:])
    columns, rows = right - left + 1, high - low + 1
    if columns * rows > _LARGER * width * height:
        what = f"its view would have {columns} x {rows} pixels, over {_LARGER:.0f} times those of the photo"
        raise InputError(picture.name, what, remedy="give a smaller region around the part, or take it from above")
    work_from_view = frozen([[scale, 0, left * scale], [0, -scale, high * scale]])
    pixels, valid = remapped(picture.pixels, shown, work_from_view, (columns, rows))
    for array in (pixels, valid):
        array.flags.writeable = False
    return View(pixels, work_from_view, scale, None if valid.all() else valid, tuple(notes))


def framed(view: View, camera: Camera | None, plane: Plane, size: tuple[int, int]) -> FloatArray:
    """The border of the view in a photo of ``size`` (width, height), (N, 2) px; nan where the lens shows nothing."""
    height, width = view.pixels.shape[:2]
    steps = np.linspace(0.0, 1.0, _SAMPLES)[:-1]
    corners = np.array([[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]], dtype=np.float64)
    sides = corners[:, None] + steps[:, None] * (np.roll(corners, -1, axis=0) - corners)[:, None]
    mm = sides.reshape(-1, 2) @ view.work_from_view[:, :2].T + view.work_from_view[:, 2]
    return photo_from_work(shown_by(camera, plane, size), mm)


def _whole(shown: Shown, picture: Picture, notes: list[Note]) -> tuple[Region, float]:
    """Box and finest mm/px of all that the photo shows, but for what is much coarser than its finest place."""
    places = work_from_photo(shown, photo_grid(shown.size, _SAMPLES))
    front = places[np.isfinite(places).all(axis=1)]
    if not len(front):
        raise InputError(picture.name, "does not show the work plane", remedy="check the points or the pose")
    finest, coarsest = mm_per_pixel(shown, front)
    kept = front[coarsest <= _COARSER * finest.min()]
    if not len(kept):
        raise InputError(picture.name, "sees the work plane on edge", remedy="take the photo from above")
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
    x, y = np.meshgrid(np.linspace(x0, x1, _SAMPLES), np.linspace(y0, y1, _SAMPLES))
    places = np.column_stack([x.ravel(), y.ravel()])
    px = photo_from_work(shown, places)
    inside = places[np.all((px >= 0) & (px <= np.array(shown.size) - 1), axis=1)]
    if not len(inside):
        remedy = "check its corners, in mm of the work frame"
        raise InputError(picture.name, "does not show the region", _told(region), remedy)
    return region, float(mm_per_pixel(shown, inside)[0].min())


def _told(region: Region) -> str:
    return "[" + ", ".join(short(v, 3) for v in region) + "] mm"


def _clean(scale: float) -> float:
    """``scale`` rounded down to three digits."""
    digits = 2 - math.floor(math.log10(scale))
    return float(f"{math.floor(scale * 10**digits * (1 + 1e-12))}e{-digits}")
