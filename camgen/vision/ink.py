"""Ink on paper: which pixels of a drawing are ink, and the borders between the two.

A border runs between an ink pixel and its paper neighbour, at the place where the grey value between the two passes the
level: in a picture of two values half-way, in an anti-aliased one at the drawn edge to a part of a pixel. Ink pixels
that touch at a corner are joined, as in Suzuki's border following. What lies beyond the picture is paper.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.model.pose import FloatArray
from camgen.model.text import short
from camgen.vision.image import Pixels

IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

#: Less contrast than this between ink and paper is noise, grey levels.
_LEAST_CONTRAST = 8.0
#: A border stays off the centres of pixels, so that no two of its points are one.
_BETWEEN = 0.01, 0.99


class Ink(Struct, frozen=True, eq=False):
    """Ink in a picture with one row and column of paper around it. pixels: (H + 2, W + 2) bool.

    grey: of the picture, the same size, float32. level: between ink and paper. why: a sentence.
    """

    pixels: BoolArray
    grey: NDArray[np.float32]
    level: float
    why: str


def ink_of(pixels: Pixels, threshold: float | None, invert: bool) -> Ink | None:
    """The ink of a picture (H, W) or (H, W, 3); None where it has one grey value only.

    threshold: grey level, None: Otsu's. Ink is what differs from most of the picture's border, unless ``invert``.
    """
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    grey = (
        pixels
        if pixels.ndim == 2
        else np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
    )
    split = (
        cv2.threshold(grey, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)[0]
        if threshold is None
        else threshold
    )
    light = grey > split
    if not light.any() or light.all():
        return None
    bright, dark = _middle(grey, light), _middle(grey, ~light)
    if bright - dark < _LEAST_CONTRAST:
        return None
    level = (bright + dark) / 2 if threshold is None else threshold
    light = grey > level
    rim = np.concatenate([light[0], light[-1], light[:, 0], light[:, -1]])
    on_dark = 2 * int(rim.sum()) < len(rim)
    how = f"grey level {short(level, 1)}, " + ("half-way" if threshold is None else "as given")
    why = f"{how}; the picture's border is mostly {'dark' if on_dark else 'light'}" + (
        ", inverted" if invert else ""
    )
    ink = light == (on_dark != invert)
    around = np.zeros((ink.shape[0] + 2, ink.shape[1] + 2), dtype=np.bool_)
    around[1:-1, 1:-1] = ink
    # The mirror image of the last pixel: the border of what is cut off lies on the picture's edge.
    values = np.pad(grey.astype(np.float32), 1, mode="edge")
    mirrored = np.pad(ink, 1, mode="edge") & ~around
    values[mirrored] = 2 * level - values[mirrored]
    return Ink(around, values, float(level), why)


def _middle(grey: Pixels, where: BoolArray) -> float:
    """The median of the pixels ``where``, from their histogram."""
    counts = np.cumsum(np.bincount(grey[where], minlength=256))
    return float(np.searchsorted(counts, counts[-1] / 2))


def borders(ink: Ink) -> list[FloatArray]:
    """The closed borders of the ink, (N, 2) pixels u, v of the padded picture, in the order of their topmost points.

    With v upwards the ink is on the left: outer borders run counter-clockwise, holes clockwise.
    """
    tail, head, way, point = _cracks(ink)
    order = np.argsort(tail, kind="stable")
    following = _following(tail[order], head[order], way[order])
    points = point[order]
    loops, seen, links = [], bytearray(len(following)), following.tolist()
    for first in range(len(links)):
        if seen[first]:
            continue
        loop, at = [], first
        while not seen[at]:
            seen[at] = 1
            loop.append(at)
            at = links[at]
        loops.append(points[loop])
    return loops


#: South, west, north, east: to the right of each way lies the next one (v runs down).
_STEPS = ((1, 0), (0, -1), (-1, 0), (0, 1))


def _cracks(ink: Ink) -> tuple[IntArray, IntArray, IntArray, FloatArray]:
    """The edges between ink and paper: tail and head as numbers of pixel corners, way 0 to 3, and the place (E, 2).

    Corner (i, j) is the upper left one of pixel (i, j). The ink lies to the left of the way.
    """
    width = ink.pixels.shape[1] + 1
    columns: list[tuple[IntArray, ...]] = []
    places = []
    # The paper lies to the right: for each way the pixel beside, and the corner of the ink pixel where the edge begins.
    for way, (beside, corner) in enumerate(
        (((0, -1), (0, 0)), ((-1, 0), (0, 1)), ((0, 1), (1, 1)), ((1, 0), (1, 0)))
    ):
        i, j = np.nonzero(ink.pixels & ~np.roll(ink.pixels, (-beside[0], -beside[1]), axis=(0, 1)))
        begin = (i + corner[0]) * width + j + corner[1]
        step = _STEPS[way]
        columns.append((begin, begin + step[0] * width + step[1], np.full(len(i), way)))
        inner, outer = ink.grey[i, j], ink.grey[i + beside[0], j + beside[1]]
        differ = np.where(inner == outer, 1.0, inner - outer)
        share = np.clip((inner - ink.level) / differ, *_BETWEEN).astype(np.float64)
        places.append(np.column_stack([j + share * beside[1], i + share * beside[0]]))
    tail, head, ways = (np.concatenate(column) for column in zip(*columns, strict=True))
    return tail, head, ways, np.concatenate(places)


def _following(tail: IntArray, head: IntArray, way: IntArray) -> IntArray:
    """The edge that follows each, of edges sorted by tail: the only one, or of two the one to the right."""
    first = np.searchsorted(tail, head)
    second = np.minimum(first + 1, len(tail) - 1)
    right = (way + 1) % 4
    return np.where((tail[second] == head) & (way[second] == right), second, first)
