"""Flat pieces in the work plane, mm, from the shapes of a drawing. Circles stay exact arcs."""

from __future__ import annotations

import math
from itertools import islice

import numpy as np

from camgen.geometry import curves
from camgen.geometry.ragged import compute_offsets
from camgen.model.pose import FloatArray
from camgen.read.pieces import DrawnPieces, IntArray, index_names
from camgen.read.svg.clip import cut_outline
from camgen.read.svg.path import Oval
from camgen.read.svg.tree import Drawing, DrawnShape

#: How far conjugate diameters may be from equal and square to count as those of a circle.
_ROUND = 1e-9


#: Reasons for shapes at the edges of viewports and clip paths.
_OUTSIDE = "outside of the viewport or clip path around it"
_AREA_CUT = "an area without a line, cut by the viewport or clip path around it"


#: Points and bulges of a piece, and whether it is closed; its last point is its first then.
_Piece = tuple[curves.Outline, bool]


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
    pieces: list[_Piece] = []
    owners: list[int] = []
    for k, shape in enumerate(drawing.shapes):
        parts: list[_Piece] = []
        for subpath in shape.subpaths:
            parts.append((_join(list(islice(outlines, len(subpath.runs)))), subpath.closed))
        parts = _clip(drawing, shape, parts)
        pieces += parts
        owners += [k] * len(parts)
    return _make_soup(drawing, pieces, np.array(owners, dtype=np.intp))


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
    for outline, is_closed in pieces:
        inner = cut_outline(outline, is_closed, shape.clip)
        if inner is None:
            parts.append((outline, is_closed))
        else:
            is_cut = True
            parts += [(part, False) for part in inner]
    if is_cut and not (parts and shape.paint.is_stroked):
        drawing.report(_AREA_CUT if parts else _OUTSIDE, shape.kind, shape.layer, shape.name)
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
    bulges = np.append(np.full(parts, bulge), 0.0)
    return center + np.cos(t)[:, None] * first + np.sin(t)[:, None] * second, bulges


def _make_soup(drawing: Drawing, pieces: list[_Piece], owner: IntArray) -> DrawnPieces:
    """The pieces in flat arrays. owner: (P,) index of the shape of each piece."""
    layers, layer = index_names([shape.layer for shape in drawing.shapes])
    kinds, kind = index_names([shape.kind for shape in drawing.shapes])
    colors, color = index_names([shape.paint.color for shape in drawing.shapes])
    points, bulges = [np.zeros((0, 2))], [np.zeros(0)]
    for outline, is_closed in pieces:
        # A closed piece does not repeat its first point.
        kept = slice(-1) if is_closed else slice(None)
        points.append(outline[0][kept])
        bulges.append(outline[1][kept])
    return DrawnPieces(
        points=np.concatenate(points),
        bulges=np.concatenate(bulges),
        first=compute_offsets(list(map(len, bulges[1:]))),
        closed=np.array([is_closed for _, is_closed in pieces], dtype=np.bool_),
        layer=layer[owner],
        kind=kind[owner],
        color=color[owner],
        layers=layers,
        kinds=kinds,
        colors=colors,
    )
