"""Flat pieces in the work plane, mm, from the shapes of a drawing. Circles stay exact arcs."""

from __future__ import annotations

import math
from itertools import islice

import numpy as np
from msgspec import Struct, field

from camgen.geometry import curves
from camgen.geometry.ragged import compute_offsets
from camgen.model.pose import FloatArray
from camgen.read.pieces import DrawnPieces, index_names
from camgen.read.svg.clip import cut_outline
from camgen.read.svg.path import Oval
from camgen.read.svg.tree import Drawing, DrawnShape

#: How far conjugate diameters may be from equal and square to count as those of a circle.
_ROUND = 1e-9


#: Reasons for shapes at the edges of viewports and clip paths.
_OUTSIDE = "outside of the viewport or clip path around it"
_AREA_CUT = "an area without a line, cut by the viewport or clip path around it"


#: Runs end to end as points and bulges, and whether they are closed.
_Piece = tuple[list[curves.Outline], bool]


class _Pieces(Struct):
    """Flat pieces, which grow.

    points: points (N, 2) of each run without its end, and the ends of open pieces, mm.
    bulges: bulges (N,) of each of them.
    counts: number of points of each piece.
    closed: whether each piece is closed; a closed piece does not repeat its first point.
    shapes: index of the shape of each piece.
    """

    points: list[FloatArray] = field(default_factory=list)
    bulges: list[FloatArray] = field(default_factory=list)
    counts: list[int] = field(default_factory=list)
    closed: list[bool] = field(default_factory=list)
    shapes: list[int] = field(default_factory=list)

    def add(self, piece: _Piece, shape: int) -> None:
        """Adds a piece of a shape; the last point of a closed piece is its first."""
        runs, is_closed = piece
        count = 0 if is_closed else 1
        for points, bulges in runs:
            self.points.append(points[:-1])
            self.bulges.append(bulges[:-1])
            count += len(points) - 1
        if not is_closed:
            self.points.append(runs[-1][0][-1:])
            self.bulges.append(np.zeros(1))
        self.counts.append(count)
        self.closed.append(is_closed)
        self.shapes.append(shape)


def flatten(drawing: Drawing, chord: float) -> DrawnPieces:
    """Pieces of all that was drawn, one per subpath, or several where a clip cuts it.

    chord: mm, the deviation allowed for curves.
    Reports shapes outside of their clips.
    """
    placed: list[FloatArray | curves.Outline] = []
    for shape in drawing.shapes:
        for subpath in shape.subpaths:
            placed += [_place(run, shape.matrix) for run in subpath.runs]
    fitted = iter(curves.fit([run for run in placed if isinstance(run, np.ndarray)], chord))
    outlines = (next(fitted) if isinstance(run, np.ndarray) else run for run in placed)
    pieces = _Pieces()
    for k, shape in enumerate(drawing.shapes):
        parts: list[_Piece] = []
        for subpath in shape.subpaths:
            parts.append((list(islice(outlines, len(subpath.runs))), subpath.closed))
        for part in _clip(drawing, shape, parts):
            pieces.add(part, k)
    return _soup(drawing, pieces)


def _join(outlines: list[curves.Outline]) -> curves.Outline:
    points = [points[:-1] for points, _ in outlines[:-1]]
    bulges = [bulges[:-1] for _, bulges in outlines[:-1]]
    return (
        np.concatenate([*points, outlines[-1][0]]),
        np.concatenate([*bulges, outlines[-1][1]]),
    )


def _clip(drawing: Drawing, shape: DrawnShape, pieces: list[_Piece]) -> list[_Piece]:
    if shape.clip is None:
        return pieces
    parts: list[_Piece] = []
    is_cut = False
    for runs, is_closed in pieces:
        inner = cut_outline(_join(runs), is_closed, shape.clip)
        if inner is None:
            parts.append((runs, is_closed))
        else:
            is_cut = True
            parts += [([part], False) for part in inner]
    if not is_cut:
        return pieces
    if not parts or not shape.paint.is_stroked:
        reason = _AREA_CUT if parts else _OUTSIDE
        drawing.report(reason, shape.kind, shape.layer, shape.name)
        return []
    return parts


def _place(run: FloatArray | Oval, matrix: FloatArray) -> FloatArray | curves.Outline:
    """A run under its matrix: points and bulges, or rational Bezier segments to be fitted."""
    linear, shift = matrix[:, :2], matrix[:, 2]
    if isinstance(run, Oval):
        return _oval(
            run.center @ linear.T + shift,
            linear @ run.first,
            linear @ run.second,
            (run.start, run.end),
        )
    moved = run @ linear.T + shift
    if moved.ndim == 2:
        return moved, np.zeros(len(moved))
    # A segment that goes nowhere has no direction.
    stays = (np.ptp(run, axis=1) == 0).all(axis=1)
    if stays.any():
        if stays.all():
            return moved[0, :2], np.zeros(2)
        moved = moved[~stays]
    return curves.make_bezier(moved)


def _oval(
    center: FloatArray, first: FloatArray, second: FloatArray, span: tuple[float, float]
) -> FloatArray | curves.Outline:
    start, end = span
    uu, vv, uv = float(first @ first), float(second @ second), float(first @ second)
    size = max(uu, vv)
    flat = abs(first[0] * second[1] - first[1] * second[0]) <= 1e-12 * size
    if flat or abs(uu - vv) > _ROUND * size or abs(uv) > _ROUND * size:
        return curves.make_ellipse(center, first, second, start, end)
    parts = max(1, math.ceil(abs(end - start) / math.pi - 1e-9))
    t = np.linspace(start, end, parts + 1)
    bulge = math.tan((end - start) / parts / 4) * math.copysign(
        1.0, first[0] * second[1] - first[1] * second[0]
    )
    # Half circles exactly, so that circles are known again.
    if abs(abs(bulge) - 1) < 1e-12:
        bulge = math.copysign(1.0, bulge)
    return center + np.cos(t)[:, None] * first + np.sin(t)[:, None] * second, np.full(
        parts + 1, bulge
    )


def _soup(drawing: Drawing, pieces: _Pieces) -> DrawnPieces:
    layers, layer = index_names([shape.layer for shape in drawing.shapes])
    kinds, kind = index_names([shape.kind for shape in drawing.shapes])
    colors, color = index_names([shape.paint.color for shape in drawing.shapes])
    owner = np.array(pieces.shapes, dtype=np.intp)
    return DrawnPieces(
        points=np.concatenate([np.zeros((0, 2)), *pieces.points]),
        bulges=np.concatenate([np.zeros(0), *pieces.bulges]),
        first=compute_offsets(pieces.counts),
        closed=np.array(pieces.closed, dtype=np.bool_),
        layer=layer[owner],
        kind=kind[owner],
        color=color[owner],
        layers=layers,
        kinds=kinds,
        colors=colors,
    )
