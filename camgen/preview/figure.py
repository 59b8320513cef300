"""A 3-D part as a figure: seen from in front and above, its faces shaded, its edges numbered in their order."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise

import cv2
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.ragged import run_starts
from camgen.model.part import BoolArray, Solid
from camgen.model.pose import IDENTITY, FloatArray
from camgen.preview.aside import TILT, TURN, look_from
from camgen.preview.view import View

# The direction of view, and points in it.


#: Direction of the light for a part that stands upright.
_LIGHT = np.array([-0.35, -0.55, 0.76])


class Look(Struct, frozen=True, eq=False):
    """How a part is seen on a sheet, as unit vectors of the work frame.

    axes: (2, 3) to the right and up.
    toward: (3,) toward the viewer.
    light: (3,) toward the light.
    """

    axes: FloatArray
    toward: FloatArray
    light: FloatArray

    def place(self, points: FloatArray) -> FloatArray:
        """(N, 2) mm to the right and up."""
        return np.asarray(points @ self.axes.T)


def oblique(upright: FloatArray = IDENTITY) -> Look:
    """The view of 3-D parts, from the side and above.

    upright: (3, 3) the rotation that turns the part as it stands.
    """
    toward = (math.cos(TILT) * math.cos(TURN), math.cos(TILT) * math.sin(TURN), math.sin(TILT))
    axes = np.array(look_from(TURN, TILT))
    return Look(axes @ upright, np.array(toward) @ upright, _LIGHT @ upright)


# What of the part is in front: every pixel of a sheet knows the triangle that is seen there.

#: Pixels of the longer side, and of the border around the part.
_LONG, _BORDER = 1000, 3
#: Of the part's size: what lies less behind a face is on it.
_ON = 0.004
#: Greys of a face away from the light and square to it.
_DARK, _BRIGHT = 168.0, 244.0


class Shaded(Struct, frozen=True, eq=False):
    """front: (H, W) the triangle that is seen at a pixel, -1 for none; row 0 is the highest. low: (2,) mm of the lower
    left pixel. per_px: mm. grey: (F,) of the triangles.
    """

    front: NDArray[np.int32]
    low: FloatArray
    per_px: float
    grey: NDArray[np.uint8]

    def pixels(self) -> NDArray[np.uint8]:
        """(H, W, 4) blue, green, red and how opaque."""
        grey = np.append(self.grey, np.uint8(0))[self.front].astype(np.uint8)
        opaque = np.where(self.front >= 0, 255, 0).astype(np.uint8)
        return np.dstack([grey, grey, grey, opaque])

    def spot(self, at: FloatArray) -> NDArray[np.int64]:
        """Row and column (N, 2) of places (N, 2) on the sheet."""
        column, up = ((at - self.low) / self.per_px).T
        return np.round(np.column_stack([len(self.front) - 1 - up, column])).astype(np.int64)


def shade(solid: Solid, look: Look) -> Shaded:
    """The faces of ``solid`` that look to the viewer, the nearer over the farther ones."""
    at = look.place(solid.vertices)
    low, size = at.min(axis=0), np.ptp(at, axis=0)
    per_px = float(size.max()) / _LONG
    low = low - _BORDER * per_px
    wide, high = (int(v) + 2 * _BORDER + 1 for v in size / per_px)
    front = np.full((high, wide), -1, np.int32)
    across, up = ((at - low) / per_px).T
    corners = np.round(np.column_stack([across, high - 1 - up]) * 16).astype(np.int32)[solid.faces]
    depth = (solid.vertices @ look.toward)[solid.faces].mean(axis=1)
    facing = np.flatnonzero(solid.normals @ look.toward > 0)
    for face in facing[np.argsort(depth[facing], kind="stable")].tolist():
        cv2.fillConvexPoly(front, corners[face], face, cv2.LINE_8, 4)
    lit = np.clip(solid.normals @ look.light, 0.0, 1.0)
    return Shaded(front, low, per_px, np.round(_DARK + (_BRIGHT - _DARK) * lit).astype(np.uint8))


def are_seen(shaded: Shaded, solid: Solid, look: Look, points: FloatArray) -> BoolArray:
    """Which of ``points`` (N, 3) on the part no face hides: at one of the pixels around each nothing is before it."""
    row, column = shaded.spot(look.place(points)).T
    slack = _ON * float(np.linalg.norm(np.ptp(solid.vertices, axis=0)))
    seen = np.zeros(len(points), dtype=bool)
    for down in (-2, 0, 2):
        for aside in (-2, 0, 2):
            r = np.clip(row + down, 0, shaded.front.shape[0] - 1)
            c = np.clip(column + aside, 0, shaded.front.shape[1] - 1)
            face = shaded.front[r, c]
            normal, corner = solid.normals[face], solid.vertices[solid.faces[face, 0]]
            before = ((corner - points) * normal).sum(axis=1) / np.maximum(
                normal @ look.toward, 1e-9
            )
            seen |= (face < 0) | (before < slack)
    return seen


# The edges, each with its number or, where it is left out, its id.

#: Of the part's size: pieces in which an edge is seen or not.
_PIECE = 1 / 120
#: Where along an edge its number may stand.
_PLACES = (0.5, 0.4, 0.6, 0.3, 0.7, 0.2, 0.8)
#: Of an edge: a number stands where it is seen if that is so much of it.
_ENOUGH = 0.25
#: So many edges are numbered.
NUMBERED = 200


class FigureEdge(Struct, frozen=True, eq=False):
    """text: its number in the order, counted from 1, or its id where it is left out; "" where it has neither. number:
    counted from 0, -1 for none. state: as of ``ViewLine``. points: (N, 3), seen: (N - 1,) whether the pieces are.
    """

    text: str
    number: int
    state: str
    points: FloatArray
    seen: BoolArray

    @property
    def middle(self) -> FloatArray:
        """(3,) half-way along it."""
        return _along(self.points, 0.5)


def figure_edges(view: View, solid: Solid, look: Look, shaded: Shaded | None) -> list[FigureEdge]:
    """The edges of the part, in the order of the view. shaded: None where it does not matter what is hidden."""
    numbers = {row.id: k for k, row in enumerate(view.rows)}
    few = sum(line.state in ("done", "skipped") for line in view.lines) <= NUMBERED
    most = float(np.linalg.norm(np.ptp(solid.vertices, axis=0))) * _PIECE
    found = []
    ends = np.cumsum(view.chains.counts)[:-1]
    for line, chain in zip(view.lines, np.split(view.chains.points, ends), strict=True):
        number = numbers.get(line.path or line.id, -1) if line.state == "done" else -1
        text = (
            str(number + 1)
            if number >= 0
            else line.id
            if line.state in ("skipped", "wrong")
            else ""
        )
        points = _cut_up(chain, most)
        middles = (points[1:] + points[:-1]) / 2
        seen = (
            np.ones(len(middles), bool)
            if shaded is None
            else are_seen(shaded, solid, look, middles)
        )
        found.append(FigureEdge(text if few else "", number, line.state, points, seen))
    return found


def _cut_up(chain: FloatArray, most: float) -> FloatArray:
    """The chain with points no farther than ``most`` mm from each other."""
    steps = np.linalg.norm(np.diff(chain, axis=0), axis=1)
    parts = np.maximum(np.ceil(steps / most), 1).astype(np.int64)
    at = np.concatenate(
        [[0.0], *(k + np.arange(1, n + 1) / n for k, n in enumerate(parts.tolist()))]
    )
    return np.column_stack([np.interp(at, np.arange(len(chain)), column) for column in chain.T])


def _length(points: FloatArray) -> float:
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def _along(points: FloatArray, share: float) -> FloatArray:
    steps = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    return np.array([np.interp(share * steps[-1], steps, column) for column in points.T])


def runs(edge: FigureEdge) -> Iterator[tuple[bool, FloatArray]]:
    """The edge in stretches that are seen or hidden, each with its points."""
    for a, b in pairwise([*run_starts(edge.seen).tolist(), len(edge.seen)]):
        yield bool(edge.seen[a]), edge.points[a : b + 1]


def label_places(
    edges: list[FigureEdge], look: Look, apart: float
) -> list[tuple[FloatArray, bool]]:
    """On the sheet (2,) where each edge's text stands, and whether it is seen there: on a seen stretch where there is
    one, ``apart`` mm or more from the others where there is room.
    """
    placed: list[FloatArray] = []
    found = []
    for edge in edges:
        seen = max(
            (points for shown, points in runs(edge) if shown), key=_length, default=edge.points[:1]
        )
        enough = _length(seen) >= _ENOUGH * _length(edge.points)
        points = seen if enough else edge.points
        spots = look.place(np.array([_along(points, share) for share in _PLACES]))
        gaps = [
            min((float(np.hypot(*(spot - other))) for other in placed), default=apart)
            for spot in spots
        ]
        best = next((k for k, gap in enumerate(gaps) if gap >= apart), int(np.argmax(gaps)))
        found.append((spots[best], enough))
        if edge.text:
            placed.append(spots[best])
    return found
