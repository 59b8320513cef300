"""What passes and centre lines left bare: strokes where the tool has room, one touch where it pays."""

from __future__ import annotations

import cv2
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.segments import BoolArray, IntArray
from camgen.planners.fill_ground import Distances, Ground, Pixels
from camgen.planners.fill_lines import Line, centred
from camgen.planners.image_space_field import sampled
from camgen.planners.image_space_rings import ComplexArray
from camgen.vision.skeleton import skeleton
from camgen.vision.skeleton_graph import graph
from camgen.vision.skeleton_strokes import strokes

#: The tool has room where it is no nearer to the border than this share of its radius.
_ROOM = 0.9
#: A touch needs a piece so many times as large as a line does and so many pixels, which is more than the corner of a
#: square leaves wherever the pixels lie, and must cover this many times what it inks outside.
_TOUCH, _GRAIN, _PAYS = 1.6, 4, 2.0
#: Where a touch is tried, from the place with most room towards the middle of the piece.
_WAY = (0.0, 0.25, 0.5, 0.75, 1.0)


class _Bare(Struct, frozen=True, eq=False):
    """Pieces without ink: labels (H, W), facts (N, 5) as OpenCV gives them, room (N,): depth of the deepest pixel."""

    labels: NDArray[np.int32]
    facts: IntArray
    room: Distances


def uncovered(field: Ground, ink: Pixels, radius: float, least: float) -> list[Line]:
    """Lines and dots for what of ``field`` is without ``ink``. least: pixels of a piece that is worth one."""
    pixels = np.asarray(cv2.bitwise_and(field.mask, cv2.bitwise_not(ink)), dtype=np.uint8)
    count, labels, facts, _ = cv2.connectedComponentsWithStats(pixels)
    room = np.zeros(count, dtype=np.float32)
    here = np.flatnonzero(pixels)
    piece: NDArray[np.int32] = np.asarray(labels, dtype=np.int32)
    np.maximum.at(room, piece.ravel()[here], field.depth.ravel()[here])
    bare = _Bare(piece, np.asarray(facts, dtype=np.int64), room)
    worth = bare.facts[:, cv2.CC_STAT_AREA] >= least
    worth[0] = False
    lines = _lines(field, bare, worth & (room >= _ROOM * radius), radius)
    left = worth & (bare.facts[:, cv2.CC_STAT_AREA] >= _TOUCH * least + _GRAIN)
    if lines:
        drawn = np.concatenate([line.points for line in lines])
        left[bare.labels[np.rint(drawn.imag).astype(np.int64), np.rint(drawn.real).astype(np.int64)]] = False
    touches = [_touch(field, ink, bare, k, radius) for k in np.flatnonzero(left).tolist()]
    return lines + [touch for touch in touches if touch is not None]


def _lines(field: Ground, bare: _Bare, wide: BoolArray, radius: float) -> list[Line]:
    """The centre lines of the pieces ``wide`` (N,), where the tool has room."""
    own = wide[bare.labels].astype(np.uint8) * np.uint8(255)
    if not cv2.countNonZero(own):
        return []
    width = np.asarray(cv2.distanceTransform(own, cv2.DIST_L2, cv2.DIST_MASK_PRECISE), dtype=np.float32)
    found = strokes(graph(skeleton(own), None, width))
    result = []
    for stroke, points in zip(found, centred(found, field, radius)[1] if found else [], strict=True):
        room = sampled(field.depth, points) >= _ROOM * radius
        closed = stroke.closed and bool(room.all()) and len(points) > 2
        result += [Line(part, closed, radius) for part in _runs(points, room)]
    return result


def _touch(field: Ground, ink: Pixels, bare: _Bare, piece: int, radius: float) -> Line | None:
    """One touch, between a piece and where the tool has most room near it, if it covers more than it spoils."""
    left, top, wide, high, _ = bare.facts[piece].tolist()
    reach = int(np.ceil(radius))
    u, v = max(left - 2 * reach, 0), max(top - 2 * reach, 0)
    window = (slice(v, top + high + 2 * reach), slice(u, left + wide + 2 * reach))
    own = bare.labels[window] == piece
    rows, columns = np.nonzero(own)
    middle = complex(columns.mean(), rows.mean())
    y, x = np.ogrid[: own.shape[0], : own.shape[1]]
    near = (y - middle.imag) ** 2 + (x - middle.real) ** 2 <= radius**2
    deepest = np.unravel_index(int(np.argmax(np.where(near, field.depth[window], 0.0))), own.shape)
    room = complex(deepest[1], deepest[0])
    # A pixel of copper that gets ink counts for it, one beside counts against.
    value = np.where(field.mask[window] != 0, 1, -1) * (ink[window] == 0)
    best, most = room, -1
    for place in (room + share * (middle - room) for share in _WAY):
        fresh = value[(y - place.imag) ** 2 + (x - place.real) ** 2 <= radius**2]
        gained, spoiled = int((fresh > 0).sum()), int((fresh < 0).sum())
        if gained >= _PAYS * spoiled and 2 * gained >= len(rows) and gained - spoiled > most:
            best, most = place, gained - spoiled
    return Line(np.array([best + complex(u, v)]), False, radius) if most > 0 else None


def _runs(points: ComplexArray, where: BoolArray) -> list[ComplexArray]:
    """The stretches of a line where it holds."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], where.astype(np.int8), [0]])))
    return [points[a:b] for a, b in edges.reshape(-1, 2).tolist()]
