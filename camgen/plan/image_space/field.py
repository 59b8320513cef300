"""The distance image of a part, its gradient, and the offset masks cut from it (PIST, sections 3.2.2 to 3.2.4)."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.rings import ComplexArray, Rings, make_rings
from camgen.geometry.segments import BoolArray, IntArray
from camgen.model.errors import JobError
from camgen.model.pose import FloatArray

Pixels = NDArray[np.uint8]
Distances = NDArray[np.float32]

#: Room (px) around the outermost path, so that every path is closed inside the picture.
_BORDER_PX = 8
#: No picture larger than this (px) is worked on; four bytes a pixel, up to three pictures.
_LARGEST = 100_000_000


class Field(Struct, frozen=True, eq=False):
    """A part in a frame of free pixels. part: (H, W) 255 where the part is. far: (H, W) px from each pixel centre to
    the nearest pixel centre of the part. corner: view pixel of the first pixel, as u + iv.
    """

    part: Pixels
    far: Distances
    corner: complex


class FieldCurves(Struct, frozen=True, eq=False):
    """The borders of a mask in order, the mask on the left as seen on the screen (Suzuki's border following).

    table and pixels (N,): integer pixels of the mask. hole: (L,). parent: (L,) the border around each, -1 for none.
    """

    table: Rings
    pixels: ComplexArray
    hole: BoolArray
    parent: IntArray


def field(mask: Pixels, reach: float) -> Field:
    """The distance image [3.2.2] of the part in `mask` and of `reach` px around it. Holes are outside the part, so
    the one image serves all borders. JobError where that would be a picture without measure.
    """
    u, v, width, height = cv2.boundingRect(mask)
    margin = int(np.ceil(reach)) + _BORDER_PX
    if (width + 2 * margin) * (height + 2 * margin) > _LARGEST:
        what = f"its path runs {reach:.0f} px beside a part of {width} x {height} px"
        raise JobError("job", what, "tool.diameter", "use a smaller tool or a coarser view")
    part = np.zeros((height + 2 * margin, width + 2 * margin), dtype=np.uint8)
    part[margin : margin + height, margin : margin + width] = mask[v : v + height, u : u + width]
    far = cv2.distanceTransform(cv2.bitwise_not(part), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return Field(part, _distances(far), complex(u - margin, v - margin))


def within(far: Distances, distance: float) -> Pixels:
    """The offset mask: 255 up to `distance` px."""
    # OpenCV's types do not know that the second operand may be a number.
    return _pixels(cv2.compare(far, float(distance), cv2.CMP_LE))  # type: ignore[call-overload]


def beyond(far: Distances, distance: float) -> Pixels:
    """255 where it is more than `distance` px."""
    return _pixels(cv2.compare(far, float(distance), cv2.CMP_GT))  # type: ignore[call-overload]


def inside(mask: Pixels) -> Distances:
    """(H, W) px from each pixel of `mask` to the nearest one outside it, 0 there."""
    return _distances(cv2.distanceTransform(mask, cv2.DIST_L2, cv2.DIST_MASK_PRECISE))


def chains(mask: Pixels, fewest: int = 1) -> FieldCurves:
    """The borders of `mask` [3.2.4], from the top down; those of less than `fewest` pixels and what they hold are
    left out.
    """
    found, tree = cv2.findContours(mask, cv2.RETR_TREE, cv2.CHAIN_APPROX_NONE)
    above = [] if tree is None else tree[0, :, 3].tolist()
    hole = [False] * len(found)
    new = [-1] * len(found)
    keep: list[int] = []
    # A border begins at its topmost pixel, so one comes before those that it holds.
    for k in sorted(
        range(len(found)), key=lambda k: (int(found[k][0, 0, 1]), int(found[k][0, 0, 0]))
    ):
        around = above[k]
        hole[k] = around >= 0 and not hole[around]
        if len(found[k]) >= fewest and (around < 0 or new[around] >= 0):
            new[k] = len(keep)
            keep.append(k)
    table = make_rings([len(found[k]) for k in keep])
    pixels = np.concatenate([found[k].reshape(-1, 2) for k in keep]) if keep else np.zeros((0, 2))
    parent = [new[above[k]] if above[k] >= 0 else -1 for k in keep]
    return FieldCurves(
        table,
        pixels[:, 0] + 1j * pixels[:, 1],
        np.array([hole[k] for k in keep], dtype=bool),
        np.array(parent, int),
    )


def gradient(far: Distances, points: ComplexArray, radius: int) -> ComplexArray:
    """Gradient [3.2.3] of `far` at the pixels nearest to `points`: the plane through (2 radius + 1)^2 pixels.

    The distance to a mask of pixels is a field of cones over its outermost pixels, one beside the other, so narrow
    operators see the cone and not the contour: at 20 px from a straight edge Sobel's and Scharr's 3 x 3 err by 3 to 5
    deg rms, the least-squares plane of 11 x 11 pixels by 1 to 2 deg. It is exact on a plane whatever its direction.
    """
    step = np.arange(-radius, radius + 1)
    right, down = np.tile(step, len(step)), np.repeat(step, len(step))
    height, width = far.shape
    u = np.clip(np.rint(points.real).astype(np.int64), radius, width - 1 - radius)
    v = np.clip(np.rint(points.imag).astype(np.int64), radius, height - 1 - radius)
    around = far.ravel()[(v * width + u)[:, None] + (down * width + right)]
    along, across = (np.einsum("np,p->n", around, side / (right @ right)) for side in (right, down))
    return np.asarray(along + 1j * across)


def sample_field(far: Distances, points: ComplexArray) -> FloatArray:
    """`far` at `points` between pixels, bilinear."""
    height, width = far.shape
    u = np.clip(points.real, 0, width - 1.001)
    v = np.clip(points.imag, 0, height - 1.001)
    i, j = v.astype(np.int64), u.astype(np.int64)
    b, a = v - i, u - j
    top = (1 - a) * far[i, j] + a * far[i, j + 1]
    bottom = (1 - a) * far[i + 1, j] + a * far[i + 1, j + 1]
    return np.asarray((1 - b) * top + b * bottom, dtype=np.float64)


def _pixels(image: Any) -> Pixels:
    return np.asarray(image, dtype=np.uint8)


def _distances(image: Any) -> Distances:
    return np.asarray(image, dtype=np.float32)
