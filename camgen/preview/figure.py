"""A 3-D part as a figure, from the front and above, with shaded faces and numbered edges."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

import cv2
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.ragged import find_run_starts, list_owners, number_rows
from camgen.geometry.vectors import interpolate_rows
from camgen.model.part import BoolArray, Solid
from camgen.model.pose import IDENTITY, FloatArray
from camgen.preview.aside import TILT, TURN, compute_view_axes
from camgen.preview.curves import measure_length
from camgen.preview.view import View

#: Direction of the light for an upright part.
_LIGHT = np.array([-0.35, -0.55, 0.76])


class Projection(Struct, frozen=True, eq=False):
    """A parallel projection onto a sheet, as unit vectors of the work frame.

    axes: (2, 3) directions to the right and up.
    toward: (3,) direction towards the viewer.
    light: (3,) direction towards the light.
    """

    axes: FloatArray
    toward: FloatArray
    light: FloatArray

    def place(self, points: FloatArray) -> FloatArray:
        """Places (N, 2) of points (N, 3) on the sheet, mm to the right and up."""
        return np.asarray(points @ self.axes.T)


def make_oblique(upright: FloatArray = IDENTITY) -> Projection:
    """The view of 3-D parts, from the side and above.

    upright: (3, 3) rotation of the part from the work frame to its upright orientation.
    """
    toward = (math.cos(TILT) * math.cos(TURN), math.cos(TILT) * math.sin(TURN), math.sin(TILT))
    axes = compute_view_axes(TURN, TILT)
    return Projection(axes @ upright, np.array(toward) @ upright, _LIGHT @ upright)


# The visible triangle of each pixel of a sheet.

#: Pixels of the longer side, and of the border around the part.
_LONG, _BORDER = 1000, 3
#: Depth below a face within which a point still counts as on it, as a fraction of the part's size.
_SURFACE_FRACTION = 0.004
#: Grey values of a face that faces away from the light, and of one that faces it.
_DARK, _BRIGHT = 168.0, 244.0


class ShadedFaces(Struct, frozen=True, eq=False):
    """The visible faces of a part as pixels.

    front: (H, W) visible triangle of each pixel, -1 for none; row 0 is the highest.
    low: (2,) place of the lower left pixel on the sheet, mm.
    per_px: size of a pixel, mm.
    grey: (F,) grey value of each triangle.
    """

    front: NDArray[np.int32]
    low: FloatArray
    per_px: float
    grey: NDArray[np.uint8]

    def pixels(self) -> NDArray[np.uint8]:
        """(H, W, 4) blue, green, red and opacity."""
        grey = np.append(self.grey, np.uint8(0))[self.front].astype(np.uint8)
        opaque = np.where(self.front >= 0, 255, 0).astype(np.uint8)
        return np.dstack([grey, grey, grey, opaque])

    def spot(self, places: FloatArray) -> NDArray[np.int64]:
        """Row and column (N, 2) of places (N, 2) on the sheet."""
        column, up = ((places - self.low) / self.per_px).T
        return np.round(np.column_stack([len(self.front) - 1 - up, column])).astype(np.int64)


def shade(solid: Solid, projection: Projection) -> ShadedFaces:
    """Draw the faces of `solid` that face the viewer, from the farthest to the nearest."""
    places = projection.place(solid.vertices)
    low, size = places.min(axis=0), np.ptp(places, axis=0)
    per_px = float(size.max()) / _LONG
    low = low - _BORDER * per_px
    width, height = ((size / per_px).astype(int) + 2 * _BORDER + 1).tolist()
    front = np.full((height, width), -1, np.int32)
    across, up = ((places - low) / per_px).T
    corners = np.round(np.column_stack([across, height - 1 - up]) * 16)
    triangles = corners.astype(np.int32)[solid.faces]
    depth = (solid.vertices @ projection.toward)[solid.faces].mean(axis=1)
    facing = np.flatnonzero(solid.normals @ projection.toward > 0)
    for face in facing[np.argsort(depth[facing], kind="stable")].tolist():
        cv2.fillConvexPoly(front, triangles[face], face, cv2.LINE_8, 4)
    light = np.clip(solid.normals @ projection.light, 0.0, 1.0)
    grey = np.round(_DARK + (_BRIGHT - _DARK) * light).astype(np.uint8)
    return ShadedFaces(front, low, per_px, grey)


def find_visible(
    shaded: ShadedFaces, solid: Solid, projection: Projection, points: FloatArray
) -> BoolArray:
    """Mask of the points (N, 3) on the part that no face hides.

    A point is visible if no face covers it at its pixel, or at one of eight pixels around it.
    """
    row, column = shaded.spot(projection.place(points)).T
    slack = _SURFACE_FRACTION * float(np.linalg.norm(np.ptp(solid.vertices, axis=0)))
    visible = np.zeros(len(points), dtype=bool)
    for down in (-2, 0, 2):
        for right in (-2, 0, 2):
            r = np.clip(row + down, 0, shaded.front.shape[0] - 1)
            c = np.clip(column + right, 0, shaded.front.shape[1] - 1)
            face = shaded.front[r, c]
            normal, corner = solid.normals[face], solid.vertices[solid.faces[face, 0]]
            slope = np.maximum(normal @ projection.toward, 1e-9)
            depth = ((corner - points) * normal).sum(axis=1) / slope
            visible |= (face < 0) | (depth < slack)
    return visible


# The edges with their numbers. An edge that is left out has its id.

#: Length of the pieces of an edge that are visible or hidden, as a fraction of the part's size.
_PIECE = 1 / 120
#: Positions along an edge at which its number may be, as fractions of its length, by preference.
_PLACES = (0.5, 0.4, 0.6, 0.3, 0.7, 0.2, 0.8)
#: Fraction of an edge that has to be visible for its number to be there.
_VISIBLE_FRACTION = 0.25
#: Maximum number of edges that are numbered.
NUMBERED = 200


class FigureEdge(Struct, frozen=True, eq=False):
    """An edge of the figure.

    text: its number in the order, from 1, or its id if it is left out; "" for neither.
    number: index of its path, -1 for none.
    state: state as in `ViewLine`.
    points: (N, 3) points along it.
    seen: (N - 1,) mask of its visible pieces.
    """

    text: str
    number: int
    state: str
    points: FloatArray
    seen: BoolArray

    @property
    def middle(self) -> FloatArray:
        """(3,) point half-way along it."""
        return _interpolate(self.points, [0.5]).reshape(3)


def list_figure_edges(
    view: View, solid: Solid, projection: Projection, shaded: ShadedFaces | None
) -> list[FigureEdge]:
    """The edges of the part, in the order of the view. shaded: None treats all as visible."""
    numbers = {row.id: k for k, row in enumerate(view.rows)}
    has_text = sum(line.state in ("done", "skipped") for line in view.lines) <= NUMBERED
    max_step = float(np.linalg.norm(np.ptp(solid.vertices, axis=0))) * _PIECE
    edges = []
    ends = np.cumsum(view.chains.counts)[:-1]
    for line, chain in zip(view.lines, np.split(view.chains.points, ends), strict=True):
        number = numbers.get(line.path or line.id, -1) if line.state == "done" else -1
        text = ""
        if has_text and number >= 0:
            text = str(number + 1)
        elif has_text and line.state in ("skipped", "wrong"):
            text = line.id
        points = _subdivide(chain, max_step)
        middles = (points[1:] + points[:-1]) / 2
        seen = np.ones(len(middles), bool)
        if shaded is not None:
            seen = find_visible(shaded, solid, projection, middles)
        edges.append(FigureEdge(text, number, line.state, points, seen))
    return edges


def _subdivide(chain: FloatArray, max_step: float) -> FloatArray:
    """The chain with additional points, so that no step is longer than `max_step` mm."""
    steps = np.linalg.norm(np.diff(chain, axis=0), axis=1)
    parts = np.maximum(np.ceil(steps / max_step), 1).astype(np.int64)
    step = list_owners(parts)
    places = np.append(0.0, step + (number_rows(parts) + 1) / parts[step])
    return interpolate_rows(places, np.arange(float(len(chain))), chain)


def _interpolate(points: FloatArray, fractions: Sequence[float]) -> FloatArray:
    """The points at fractions of the length."""
    steps = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    return interpolate_rows(np.array(fractions) * steps[-1], steps, points)


def split_visibility(edge: FigureEdge) -> Iterator[tuple[bool, FloatArray]]:
    """The stretches of the edge, each with whether it is visible and its points."""
    for start, end in pairwise([*find_run_starts(edge.seen).tolist(), len(edge.seen)]):
        yield bool(edge.seen[start]), edge.points[start : end + 1]


def place_labels(
    edges: list[FigureEdge], projection: Projection, spacing: float
) -> Iterator[tuple[FigureEdge, FloatArray, bool]]:
    """Choose the place (2,) of the text of each edge that has one.

    It is on the longest visible stretch if that is long enough, and at least `spacing` mm from the
    other texts if there is room. Yields the edge, the place on the sheet, and whether the edge is
    visible there.
    """
    placed: list[FloatArray] = []
    for edge in edges:
        if not edge.text:
            continue
        visible = [points for is_seen, points in split_visibility(edge) if is_seen]
        longest = max(visible, key=measure_length, default=edge.points[:1])
        is_visible = measure_length(longest) >= _VISIBLE_FRACTION * measure_length(edge.points)
        points = longest if is_visible else edge.points
        places = projection.place(_interpolate(points, _PLACES))
        distances = np.full(len(places), spacing)
        if placed:
            offsets = places[:, None] - np.array(placed)
            distances = np.hypot(offsets[..., 0], offsets[..., 1]).min(axis=1)
        is_free = distances >= spacing
        best = places[int(np.argmax(is_free) if is_free.any() else np.argmax(distances))]
        placed.append(best)
        yield edge, best, is_visible
