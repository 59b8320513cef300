"""Finds the ink of a drawing on paper, and the borders between ink and paper.

A border runs between a pixel of ink and a neighbour of paper, at the place where the grey value
between the two passes the threshold. In a picture of two grey values that is half-way, in an
anti-aliased picture it is the drawn edge with sub-pixel accuracy. Pixels of ink that touch at a
corner are joined, as in Suzuki's border following. Beyond the picture is paper.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.ragged import list_chains
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray
from camgen.model.text import short
from camgen.vision.image import Pixels, convert_to_grey

#: Grey values: with less contrast than this between ink and paper, the difference is noise.
_MIN_CONTRAST = 8.0
#: Smallest and largest distance of a border from the centre of the ink pixel, px. It does not reach
#: a centre, so that no two of its points are equal.
_BETWEEN_CENTRES = 0.01, 0.99


class Ink(Struct, frozen=True, eq=False):
    """Ink in a picture of (H, W) pixels, with one row and column of paper around it.

    pixels: (H + 2, W + 2) bool, True on ink.
    grey: (H + 2, W + 2) float32, grey values.
    level: threshold between ink and paper, grey value.
    why: description of the threshold and of the border, for a note.
    """

    pixels: BoolArray
    grey: NDArray[np.float32]
    level: float
    why: str


def find_ink(pixels: Pixels, threshold: float | None, invert: bool) -> Ink | None:
    """Find the ink of a picture (H, W) or (H, W, 3).

    Ink is the side of the threshold on which less than half of the picture's border lies.

    threshold: grey value; None for the mean of the medians of ink and paper.
    invert: ink is the other side.

    Returns None if ink and paper do not differ enough, or if all pixels are on one side.
    """
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    grey, split = convert_to_grey(pixels), threshold
    if split is None:
        split = cv2.threshold(grey, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)[0]
    light = grey > split
    if not light.any() or light.all():
        return None
    bright, dark = _compute_median(grey, light), _compute_median(grey, ~light)
    if bright - dark < _MIN_CONTRAST:
        return None
    level = (bright + dark) / 2 if threshold is None else threshold
    light = grey > level
    border = np.concatenate([light[0], light[-1], light[:, 0], light[:, -1]])
    is_on_dark = 2 * int(border.sum()) < len(border)
    why = f"grey level {short(level, 1)}, {'half-way' if threshold is None else 'as given'}; "
    why += f"the picture's border is mostly {'dark' if is_on_dark else 'light'}"
    if invert:
        why += ", inverted"
    ink = light == (is_on_dark != invert)
    padded_ink = np.pad(ink, 1)
    # Ink at the edge of the picture continues as its mirror image about the threshold. So the
    # border of ink that is cut off lies on the edge.
    values = np.pad(grey.astype(np.float32), 1, mode="edge")
    is_mirrored = np.pad(ink, 1, mode="edge") & ~padded_ink
    values[is_mirrored] = 2 * level - values[is_mirrored]
    return Ink(padded_ink, values, float(level), why)


def _compute_median(grey: Pixels, selected: BoolArray) -> float:
    counts = np.cumsum(np.bincount(grey[selected], minlength=256))
    return float(np.searchsorted(counts, counts[-1] / 2))


def trace_borders(ink: Ink) -> list[FloatArray]:
    """Follow the closed borders of the ink, in the order of their topmost points.

    With v upwards the ink is on the left: outer borders run counter-clockwise, those of holes
    clockwise.

    Returns points (N, 2) u, v of each border, pixels of the padded picture.
    """
    tail, head, direction, point = _find_edges(ink)
    order = np.argsort(tail, kind="stable")
    following = _find_following(tail[order], head[order], direction[order])
    points = point[order]
    return [points[chain] for chain in list_chains(following)]


#: Directions 0 to 3 as steps (rows, columns): south, west, north, east. Each one points to the
#: right of the one before.
_STEPS = ((1, 0), (0, -1), (-1, 0), (0, 1))
#: For each direction, the step from the ink pixel to the paper pixel to the right of the edge, and
#: the corner of the ink pixel at which the edge begins.
_SIDES = (((0, -1), (0, 0)), ((-1, 0), (0, 1)), ((0, 1), (1, 1)), ((1, 0), (1, 0)))


def _find_edges(ink: Ink) -> tuple[IntArray, IntArray, IntArray, FloatArray]:
    """Find the E edges between pixels of ink and of paper; the ink lies to the left.

    Returns the numbers of the pixel corners at which they begin and end (E,), their direction (E,)
    0 to 3, and the place (E, 2) u, v where the grey value passes the threshold. Corner (i, j) is
    the upper left one of pixel (i, j).
    """
    width = ink.pixels.shape[1] + 1
    columns: list[tuple[IntArray, ...]] = []
    places = []
    for direction, (to_paper, corner) in enumerate(_SIDES):
        is_paper = ~np.roll(ink.pixels, (-to_paper[0], -to_paper[1]), axis=(0, 1))
        i, j = np.nonzero(ink.pixels & is_paper)
        begin = (i + corner[0]) * width + j + corner[1]
        step = _STEPS[direction]
        columns.append((begin, begin + step[0] * width + step[1], np.full(len(i), direction)))
        inner, outer = ink.grey[i, j], ink.grey[i + to_paper[0], j + to_paper[1]]
        difference = np.where(inner == outer, 1.0, inner - outer)
        distance = np.clip((inner - ink.level) / difference, *_BETWEEN_CENTRES).astype(np.float64)
        places.append(np.column_stack([j + distance * to_paper[1], i + distance * to_paper[0]]))
    tail, head, directions = np.concatenate(columns, axis=1)
    return tail, head, directions, np.concatenate(places)


def _find_following(tail: IntArray, head: IntArray, direction: IntArray) -> IntArray:
    """Index of the edge that follows each edge; if there are two, the one to the right.

    The edges are sorted by `tail`.
    """
    first = np.searchsorted(tail, head)
    second = np.minimum(first + 1, len(tail) - 1)
    is_second = (tail[second] == head) & (direction[second] == (direction + 1) % 4)
    return np.where(is_second, second, first)
