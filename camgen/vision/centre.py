"""Finds thin lines and lettering in ink, and their centre lines.

A piece of ink is connected ink. Its width is twice its area divided by the number of its pixels
that touch the paper, and its length is its area divided by its width.
"""

from __future__ import annotations

from itertools import compress

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.ragged import compute_first_rows, list_owners, number_rows
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray
from camgen.vision.image import Pixels
from camgen.vision.ink import Ink
from camgen.vision.skeleton import Stroke, join_strokes, make_graph, thin_mask

#: Largest width of a line, as a fraction of the longer side of the picture,
_MAX_WIDTH_FRACTION = 0.015
#: or in px, whichever is more.
_MAX_WIDTH_PX = 6.0
#: Smallest length of a line, in widths.
_MIN_LENGTH = 4.0
#: Largest width of a line at any place, in widths.
_MAX_BULGE = 3.0
#: Points before and after a point over which a centre line is averaged: it was a chain of pixels.
_AVERAGED_POINTS = 2
#: px: depth of the border in a pixel of ink beside the paper. The border runs through
#: the middle between the two.
_HALF_PIXEL = 0.5


class Pieces(Struct, frozen=True, eq=False):
    """The P pieces of ink in a picture.

    label: (H, W) int32, number of the piece at each pixel from 1 to P, 0 for paper.
    lines: (P + 1,), by label: the piece is a line.
    width: (P + 1,), by label: mean width, px.
    depth: (H, W) float32, distance of each pixel of ink to the paper, px.
    """

    label: NDArray[np.int32]
    lines: BoolArray
    width: FloatArray
    depth: NDArray[np.float32]


def divide_ink(ink: Ink, all_lines: bool) -> Pieces:
    """Divide ink into pieces and decide which of them are lines.

    all_lines: whether all pieces count as lines.
    """
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    mask = ink.pixels.view(np.uint8)
    count, label, stats, _ = cv2.connectedComponentsWithStats(
        mask, connectivity=8, ltype=cv2.CV_32S
    )
    depth = np.asarray(cv2.distanceTransform(mask, cv2.DIST_L2, cv2.DIST_MASK_5), np.float32)
    flat_label = np.asarray(label, np.int64).ravel()
    max_depth = np.zeros(count, dtype=np.float32)
    np.maximum.at(max_depth, flat_label, depth.ravel())
    # A line has one row of pixels that touch the paper along each side.
    touches_paper = (mask.ravel() > 0) & (depth.ravel() <= 1)
    border_pixels = np.bincount(flat_label[touches_paper], minlength=count)
    area = stats[:, cv2.CC_STAT_AREA]
    width = 2 * area / np.maximum(border_pixels, 1)
    length_in_widths = area / np.maximum(width, 1) ** 2
    has_even_width = 2 * (max_depth - _HALF_PIXEL) <= _MAX_BULGE * width
    is_narrow = width <= max(_MAX_WIDTH_FRACTION * max(mask.shape), _MAX_WIDTH_PX)
    lines = (has_even_width & is_narrow & (length_in_widths >= _MIN_LENGTH)) | all_lines
    lines[0] = False
    return Pieces(np.asarray(label, np.int32), lines, width.astype(np.float64), depth)


#: The centre line of a line of ink, or a part of it between junctions: its points (N, 2) u, v, px,
#: N > 1, and whether the last point is followed by the first.
Middle = tuple[FloatArray, bool]


def find_centre_lines(pieces: Pieces) -> tuple[list[Middle], BoolArray]:
    """Find the centre lines of the pieces that are lines.

    Returns the centre lines, and a mask (P + 1,) of the pieces that have one, by label. In these
    pieces the centre lines are longer than the piece is wide; a dot has no centre line.
    """
    mask: Pixels = pieces.lines[pieces.label].view(np.uint8)
    lines = [
        stroke
        for stroke in join_strokes(make_graph(thin_mask(mask), None, pieces.depth))
        if len(stroke.points) > 1
    ]
    owner = [_find_label(stroke, pieces) for stroke in lines]
    length = np.zeros(len(pieces.lines))
    np.add.at(length, owner, [float(np.abs(np.diff(stroke.points)).sum()) for stroke in lines])
    has_middle = pieces.lines & (length > pieces.width)
    return _average_points(list(compress(lines, has_middle[owner]))), has_middle


def _find_label(stroke: Stroke, pieces: Pieces) -> int:
    """The label of the piece of a stroke.

    The largest label along it: junctions are means of pixels, and may lie on paper, which is 0.
    """
    columns = np.rint(stroke.points.real).astype(np.int64)
    rows = np.rint(stroke.points.imag).astype(np.int64)
    return int(pieces.label[rows, columns].max())


def _average_points(lines: list[Stroke]) -> list[Middle]:
    """Replace each point by the mean of the points around it; the ends of open lines stay."""
    if not lines:
        return []
    count = np.array([len(stroke.points) for stroke in lines])
    first, owner, place = compute_first_rows(count), list_owners(count), number_rows(count)
    closed = np.array([stroke.closed for stroke in lines])[owner]
    points = np.concatenate([stroke.points for stroke in lines])
    # As many points on both sides, so that an end is not drawn in.
    to_end = np.minimum(place, count[owner] - 1 - place)
    reach = np.where(closed, _AVERAGED_POINTS, np.minimum(to_end, _AVERAGED_POINTS))
    total = np.zeros(len(points), dtype=np.complex128)
    for offset in range(-_AVERAGED_POINTS, _AVERAGED_POINTS + 1):
        rows: IntArray = first[owner] + (place + offset) % count[owner]
        total += np.where(np.abs(offset) <= reach, points[rows], 0.0)
    mean = total / (2 * reach + 1)
    parts = np.split(np.column_stack([mean.real, mean.imag]), first[1:])
    return [(part, stroke.closed) for part, stroke in zip(parts, lines, strict=True)]


def find_piece(border: FloatArray, pieces: Pieces) -> int:
    """The label of the piece that a border (N, 2), px, runs around or in.

    A point of a border lies between a pixel of ink and one of paper, which has label 0.
    """
    (u0, v0), (u1, v1) = np.floor(border[0]).astype(int), np.ceil(border[0]).astype(int)
    return int(max(pieces.label[v0, u0], pieces.label[v1, u1]))
