"""The distance image of a part, its gradient, and offset masks (PIST, sections 3.2.2 to 3.2.4)."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.ragged import count_rows
from camgen.geometry.rings import ComplexArray, Rings, make_rings
from camgen.geometry.segments import IntArray
from camgen.model.errors import JobError
from camgen.model.pose import FloatArray
from camgen.model.sequences import take_rows

Pixels = NDArray[np.uint8]
Distances = NDArray[np.float32]

#: Free pixels around the outermost path, so that every path is closed inside the picture.
_BORDER_PX = 8
#: Maximum number of pixels of a distance image. Up to three such images need 4 bytes per pixel.
_MAX_PIXELS = 100_000_000


class Field(Struct, frozen=True, eq=False):
    """A part in a frame of free pixels.

    part: (H, W) mask, 255 in the part.
    far: (H, W) distance of each pixel centre from the nearest pixel centre of the part, px.
    corner: position of the first pixel in the view, u + iv, px.
    """

    part: Pixels
    far: Distances
    corner: complex


class FieldCurves(Struct, frozen=True, eq=False):
    """The borders of a mask, with the mask on the left as seen on the screen.

    table: lengths of the borders.
    pixels: (N,) integer pixels of the mask along the borders, u + iv.
    parent: (L,) index of the border around each, or -1.
    """

    table: Rings
    pixels: ComplexArray
    parent: IntArray


def make_field(mask: Pixels, reach: float) -> Field:
    """The distance image [3.2.2] of the part in `mask` and of `reach` px around it.

    Holes are outside the part, so one image serves all borders. Raises JobError if the image would
    be too large.
    """
    u, v, width, height = cv2.boundingRect(mask)
    margin = int(np.ceil(reach)) + _BORDER_PX
    if (width + 2 * margin) * (height + 2 * margin) > _MAX_PIXELS:
        raise JobError(
            "job",
            f"its path runs {reach:.0f} px beside a part of {width} x {height} px",
            "tool.diameter",
            "use a smaller tool or a coarser view",
        )
    part = np.zeros((height + 2 * margin, width + 2 * margin), dtype=np.uint8)
    part[margin : margin + height, margin : margin + width] = mask[v : v + height, u : u + width]
    far = cv2.distanceTransform(cv2.bitwise_not(part), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return Field(part, _to_distances(far), complex(u - margin, v - margin))


def mask_within(far: Distances, distance: float) -> Pixels:
    """The offset mask: 255 up to `distance` px."""
    # The types of OpenCV do not allow a number as second operand.
    return _to_pixels(cv2.compare(far, float(distance), cv2.CMP_LE))  # type: ignore[call-overload]


def mask_beyond(far: Distances, distance: float) -> Pixels:
    """255 at distances above `distance` px."""
    return _to_pixels(cv2.compare(far, float(distance), cv2.CMP_GT))  # type: ignore[call-overload]


def measure_inside(mask: Pixels) -> Distances:
    """(H, W) distance from each pixel of `mask` to the nearest one outside it, px; 0 outside."""
    return _to_distances(cv2.distanceTransform(mask, cv2.DIST_L2, cv2.DIST_MASK_PRECISE))


def find_chains(mask: Pixels, min_pixels: int = 1) -> FieldCurves:
    """The borders of `mask` [3.2.4], from the top down (Suzuki's border following).

    Borders of less than `min_pixels` are left out, with the borders inside them.
    """
    borders, tree = cv2.findContours(mask, cv2.RETR_TREE, cv2.CHAIN_APPROX_NONE)
    above = [] if tree is None else tree[0, :, 3].tolist()
    new_index = [-1] * len(borders)
    kept: list[int] = []
    # A border starts at its topmost pixel, so it is sorted before the borders inside it.
    starts = [(int(border[0, 0, 1]), int(border[0, 0, 0])) for border in borders]
    for k in sorted(range(len(borders)), key=starts.__getitem__):
        outer = above[k]
        if len(borders[k]) >= min_pixels and (outer < 0 or new_index[outer] >= 0):
            new_index[k] = len(kept)
            kept.append(k)
    chains = take_rows(borders, kept)
    pixels = np.concatenate([np.zeros((0, 1, 2)), *chains])[:, 0]
    # -1, no border above, stays -1: it chooses the last number.
    parents = take_rows([*new_index, -1], take_rows(above, kept))
    return FieldCurves(
        make_rings(count_rows(chains)),
        pixels[:, 0] + 1j * pixels[:, 1],
        np.array(parents, dtype=int),
    )


def compute_gradient(far: Distances, points: ComplexArray, radius: int) -> ComplexArray:
    """Gradient [3.2.3] of `far` at the pixels nearest to `points`, from (2 radius + 1)^2 pixels.

    It is the slope of the least-squares plane through them, which is exact on a plane in any
    direction. The distance to a mask is a field of cones around its outermost pixels, so a narrow
    operator shows the cones and not the contour: at 20 px from a straight edge the 3 x 3 operators
    of Sobel and Scharr err by 3 to 5 deg rms, the plane of 11 x 11 pixels by 1 to 2 deg.
    """
    step = np.arange(-radius, radius + 1)
    right, down = np.tile(step, len(step)), np.repeat(step, len(step))
    height, width = far.shape
    u = np.clip(np.rint(points.real).astype(np.int64), radius, width - 1 - radius)
    v = np.clip(np.rint(points.imag).astype(np.int64), radius, height - 1 - radius)
    values = far.ravel()[(v * width + u)[:, None] + (down * width + right)]
    along, across = (np.einsum("np,p->n", values, side / (right @ right)) for side in (right, down))
    return np.asarray(along + 1j * across)


def sample_field(far: Distances, points: ComplexArray) -> FloatArray:
    """Bilinear values of `far` at `points`, px."""
    height, width = far.shape
    u, v = np.clip(points.real, 0, width - 1.001), np.clip(points.imag, 0, height - 1.001)
    i, j = v.astype(np.int64), u.astype(np.int64)
    b, a = v - i, u - j
    top = (1 - a) * far[i, j] + a * far[i, j + 1]
    bottom = (1 - a) * far[i + 1, j] + a * far[i + 1, j + 1]
    return np.asarray((1 - b) * top + b * bottom, dtype=np.float64)


def _to_pixels(image: Any) -> Pixels:
    return np.asarray(image, dtype=np.uint8)


def _to_distances(image: Any) -> Distances:
    return np.asarray(image, dtype=np.float32)
