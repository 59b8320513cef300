"""The side wall of a thick part on a sheet: a second edge beside its outline in the picture.

The camera is at the height d above the point n of the sheet. A place P of the sheet that is raised
by h is seen at

    n + (P - n) (1 + h / (d - h))

So the walls that face n are visible. Their band has the width (n - P) N h / (d - h) along the
outward normal N of the outline: one height explains the widths at all places. An outline that runs
along the foot of the wall has the second edge inside, one along its upper edge has it outside. A
bevel, a printed frame and a shadow have other widths, or a band on the far sides too. In a view at
the height of the upper face, the foot of the wall is seen in the same places.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import NDArray

from camgen.model.pose import FloatArray
from camgen.vision.boards.lens import fit_sheet_lens
from camgen.vision.camera.camera import Camera
from camgen.vision.image import Picture, Pixels, convert_to_grey
from camgen.vision.plane import Plane, compute_pose

#: About this number of places of the outlines is examined.
_PLACES = 600
#: A normal is that of the chord between the places this number of points before and after.
_CHORD = 4
#: Grey values of an edge are compared at these distances on both its sides, px.
_BESIDE = (1.0, 2.0)
#: A band is at least this wide, px: blur joins its two edges.
_LEAST_BAND = 4.5
#: Heights that are tried, as shares of the distance of the camera: 0.4 to 8 %, in steps of 2 %.
_SHARES = np.geomspace(0.004, 0.08, 152)
#: An edge has a step of this many grey values, and of this many times that of the grain.
_LEAST_STEP, _GRAIN = 5.0, 4.0
#: Share of the places on the near sides with an edge, at least; and on the far sides, at most.
_NEAR, _FAR = 0.6, 0.2
#: An edge has this share of the step of the middle edge. No other one is this number of px beyond.
_OTHER, _BEYOND = 0.4, 6.0
#: The step is larger than this number of px nearer to the outline: else it is blur of the outline.
_BEFORE = 1.5
#: A band is seen at this share of all places, at least.
_SEEN = 0.15
#: Focal lengths of usual cameras, half diagonals of the photo, where the corners do not show it.
_USUAL_FOCAL = (1.3, 1.7, 2.4)


class SideWall(Struct, frozen=True):
    """A side wall. Lengths are mm.

    lowest, highest: its likely height; both are the same with a known focal length.
    shift: the largest distance that such a height moves the outline by.
    width: the largest width of its band.
    is_part: whether the outline runs along its foot.
    """

    lowest: float
    highest: float
    shift: float
    width: float
    is_part: bool


class _Places(Struct, frozen=True, eq=False):
    """Places (N, 2) of the outlines and their outward normals (N, 2), px of the view."""

    places: FloatArray
    normals: FloatArray


def find_side_wall(
    view: Pixels,
    mask: Pixels,
    work_from_view: FloatArray,
    outlines: Sequence[FloatArray],
    plane: Plane,
    cameras: Sequence[Camera],
) -> SideWall | None:
    """The side wall that the view shows, or None.

    view, mask: (H, W) or (H, W, 3) grey values or colors, and the part.
    work_from_view: (2, 3), from pixels of the view to mm.
    outlines: (N, 2) each, closed, pixels of the view.
    plane: the plane of the sheet, or that above it at the height of the job.
    cameras: the camera of the photo, or several that may be it: all must see the wall.
    """
    grey = convert_to_grey(view).astype(np.float32)
    smooth = np.asarray(cv2.GaussianBlur(grey, (0, 0), 0.7), dtype=np.float32)
    border = _outward(mask, outlines)
    mm_per_px = float(np.linalg.norm(work_from_view[:, 0]))
    walls = []
    for camera in cameras:
        pose = compute_pose(plane.pixel_from_work, camera.matrix)
        x, y, distance = (-pose.rotation.T @ np.asarray(pose.origin)).tolist()
        below = np.linalg.solve(work_from_view[:, :2], (x, y) - work_from_view[:, 2])
        facing = np.sum((below - border.places) * border.normals, axis=1)
        reach = float(np.linalg.norm(border.places - below, axis=1).max()) * mm_per_px
        inner, inner_step = _band(smooth, border, facing, -1.0)
        outer, outer_step = _band(smooth, border, facing, 1.0)
        if not inner_step and not outer_step:
            return None
        is_part = inner_step > outer_step
        ratio = inner if is_part else outer / (1 - outer)
        height = (distance + plane.height) * ratio / (1 + ratio)
        width = max(inner, outer) * float(facing.max()) * mm_per_px
        walls.append((height, ratio * reach, width, is_part))
    if not walls:
        return None
    heights, shifts, widths, are_parts = zip(*walls, strict=True)
    return SideWall(min(heights), max(heights), max(shifts), max(widths), all(are_parts))


def list_cameras(picture: Picture, plane: Plane, camera: Camera | None) -> list[Camera]:
    """The camera of a photo of a sheet; three usual ones if its focal length is not known.

    camera: the calibrated camera, or that of ``plane.lens``.
    """
    if camera is not None and plane.lens is None:
        return [camera]
    height, width = picture.pixels.shape[:2]
    lens = plane.lens or fit_sheet_lens(
        plane.pairs_px, plane.pairs_mm, (width, height), True, picture.focal_px
    )
    if lens is None:
        return []
    half = float(np.hypot(width - 1, height - 1)) / 2
    if lens.is_focal_known:
        return [lens.camera]
    cameras = []
    for share in _USUAL_FOCAL:
        matrix = lens.camera.matrix.copy()
        matrix[0, 0] = matrix[1, 1] = share * half
        cameras.append(replace(lens.camera, matrix=matrix))
    return cameras


def _outward(mask: Pixels, outlines: Sequence[FloatArray]) -> _Places:
    """Places along the outlines with normals out of the part."""
    step = max(1, sum(map(len, outlines)) // _PLACES)
    places = np.concatenate([outline[::step] for outline in outlines])
    chords = [
        (np.roll(outline, -_CHORD, axis=0) - np.roll(outline, _CHORD, axis=0))[::step]
        for outline in outlines
    ]
    chord = np.concatenate(chords)
    length = np.linalg.norm(chord, axis=1).clip(1e-9)
    normals = np.column_stack([chord[:, 1], -chord[:, 0]]) / length[:, None]
    grey = mask.astype(np.float32)
    is_inwards = _sample(grey, places + 2.5 * normals) > _sample(grey, places - 2.5 * normals)
    return _Places(places, normals * np.where(is_inwards, -1.0, 1.0)[:, None])


def _band(
    grey: NDArray[np.float32], border: _Places, facing: FloatArray, side: float
) -> tuple[float, float]:
    """The ratio of the widths to ``facing`` (N,) with the strongest edge, and its step; 0 for none.

    side: 1 for a band outside of the outline, -1 for one inside.
    """
    widths = np.abs(facing) * _SHARES[:, None]
    is_wide, near = widths >= _LEAST_BAND, facing > 0
    rows = np.flatnonzero((is_wide & near).sum(axis=1) > _SEEN * len(facing))
    if not len(rows):
        return 0.0, 0.0
    steps = np.array([_steps(grey, border, side * width) for width in widths[rows]])
    grain = float(np.median(np.abs(steps[is_wide[rows]])))
    medians = [float(np.median(steps[k, is_wide[row] & near])) for k, row in enumerate(rows)]
    strongest = int(np.argmax(np.abs(medians)))
    row, median = rows[strongest], medians[strongest]
    near, far = is_wide[row] & near, is_wide[row] & ~near
    least = max(_LEAST_STEP, _GRAIN * grain, _OTHER * abs(median))
    is_edge = np.sign(median) * steps[strongest] > least
    before = abs(float(np.median(_steps(grey, border, side * (widths[row] - _BEFORE))[near])))
    beyond = abs(float(np.median(_steps(grey, border, side * (widths[row] + _BEYOND))[near])))
    is_band = (
        is_edge[near].mean() >= _NEAR
        and (not far.any() or is_edge[far].mean() <= _FAR)
        and before < abs(median)
        and beyond < _OTHER * abs(median)
    )
    return (float(_SHARES[row]), abs(median)) if is_band else (0.0, 0.0)


def _steps(grey: NDArray[np.float32], border: _Places, offsets: FloatArray) -> FloatArray:
    """The rise (N,) of grey values along the normals, at offsets (N,) px from the places."""
    rise = np.zeros(len(offsets))
    for distance in _BESIDE:
        for sign in (-1.0, 1.0):
            at = border.places + (offsets + sign * distance)[:, None] * border.normals
            rise += sign * _sample(grey, at) / len(_BESIDE)
    return rise


def _sample(grey: NDArray[np.float32], at: FloatArray) -> FloatArray:
    """Grey values (N,) at pixels (N, 2); beyond the border those of the border."""
    grid = at.astype(np.float32)
    values = cv2.remap(
        grey, grid[:, :1], grid[:, 1:], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return np.asarray(values, dtype=np.float64)[:, 0]
