"""Thin lines and lettering in ink: which pieces of it are lines, and the middles of those.

A piece is as wide as twice its area, divided by its pixels that touch the paper, and as long as its area, divided by
its width.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.ragged import begins, owners, ramp
from camgen.model.part import IntArray
from camgen.model.pose import FloatArray
from camgen.vision.image import Pixels
from camgen.vision.ink import Ink
from camgen.vision.skeleton import Stroke, graph, skeleton, strokes

BoolArray = NDArray[np.bool_]

#: A piece of ink is a line if its width is at most so much of the picture's longer side (or so many px), and it is so
#: many widths long.
_SHARE, _THIN_PX, _LONG = 0.015, 6.0, 4.0
#: A line with a place so many times as wide is none.
_WIDEST = 3.0
#: The steps of the pixels are evened out over so many points before and after.
_EVEN = 2
#: The middle of a pixel of ink is so far from the paper, px, where the border runs half-way.
_HALF_PIXEL = 0.5


class Pieces(Struct, frozen=True, eq=False):
    """Joined pieces of ink. label: (H, W), 0 for paper. lines: (P + 1,) which are lines, by label. width: (P + 1,) px.
    depth: (H, W) px from the paper.
    """

    label: NDArray[np.int32]
    lines: BoolArray
    width: FloatArray
    depth: NDArray[np.float32]


def pieces_of(ink: Ink, every: bool) -> Pieces:
    """The pieces of ``ink``, and which of them are lines; with ``every`` all that are longer than they are wide."""
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    mask = ink.pixels.view(np.uint8)
    count, label, stats, _ = cv2.connectedComponentsWithStats(
        mask, connectivity=8, ltype=cv2.CV_32S
    )
    depth = np.asarray(cv2.distanceTransform(mask, cv2.DIST_L2, cv2.DIST_MASK_5), np.float32)
    flat = np.asarray(label, np.int64).ravel()
    deepest = np.zeros(count, dtype=np.float32)
    np.maximum.at(deepest, flat, depth.ravel())
    # Along both sides of a line runs a row of pixels that touch the paper.
    beside = np.bincount(flat[(mask.ravel() > 0) & (depth.ravel() <= 1)], minlength=count)
    width = 2 * stats[:, cv2.CC_STAT_AREA] / np.maximum(beside, 1)
    long = stats[:, cv2.CC_STAT_AREA] / np.maximum(width, 1) ** 2
    even = 2 * (deepest - _HALF_PIXEL) <= _WIDEST * width
    side = max(mask.shape)
    lines = even & (width <= max(_SHARE * side, _THIN_PX)) & (long >= _LONG)
    if every:
        lines = np.ones(count, dtype=np.bool_)
    lines[0] = False
    return Pieces(np.asarray(label, np.int32), lines, width.astype(np.float64), depth)


class Middle(Struct, frozen=True, eq=False):
    """The middle of a line of ink. points: (N, 2) px, N > 1. closed: the last is followed by the first."""

    points: FloatArray
    closed: bool


def middles_of(pieces: Pieces) -> tuple[list[Middle], BoolArray]:
    """The middles of the lines, and which pieces (P + 1,) have one: a dot has none."""
    mask: Pixels = pieces.lines[pieces.label].view(np.uint8)
    found = [s for s in strokes(graph(skeleton(mask), None, pieces.depth)) if len(s.points) > 1]
    owner = [_label(stroke, pieces) for stroke in found]
    length = np.zeros(len(pieces.lines))
    np.add.at(length, owner, [float(np.abs(np.diff(stroke.points)).sum()) for stroke in found])
    drawn = pieces.lines & (length > pieces.width)
    return _evened([stroke for stroke, k in zip(found, owner, strict=True) if drawn[k]]), drawn


def _label(stroke: Stroke, pieces: Pieces) -> int:
    """The piece of a stroke: its own pixels are ink, the places of its junctions need not be."""
    at = stroke.points
    inside = pieces.label[np.rint(at.imag).astype(np.int64), np.rint(at.real).astype(np.int64)]
    return int(inside.max())


def _evened(found: list[Stroke]) -> list[Middle]:
    """Each stroke with its points as the means of those around them; the ends of open ones stay."""
    if not found:
        return []
    count = np.array([len(s.points) for s in found])
    first, stroke, place = begins(count), owners(count), ramp(count)
    closed = np.array([s.closed for s in found])[stroke]
    raw = np.concatenate([s.points for s in found])
    # As many to both sides, so that an end is not drawn in.
    room = np.where(closed, _EVEN, np.minimum(np.minimum(place, count[stroke] - 1 - place), _EVEN))
    total = np.zeros(len(raw), dtype=np.complex128)
    for by in range(-_EVEN, _EVEN + 1):
        rows: IntArray = first[stroke] + (place + by) % count[stroke]
        total += np.where(np.abs(by) <= room, raw[rows], 0.0)
    even = total / (2 * room + 1)
    parts = np.split(np.column_stack([even.real, even.imag]), first[1:])
    return [Middle(points, s.closed) for points, s in zip(parts, found, strict=True)]


def piece_of(border: FloatArray, pieces: Pieces) -> int:
    """The piece of ink that a border (N, 2) px runs around or in: between an ink pixel and a paper one."""
    (u0, v0), (u1, v1) = np.floor(border[0]).astype(int), np.ceil(border[0]).astype(int)
    return int(max(pieces.label[v0, u0], pieces.label[v1, u1]))
