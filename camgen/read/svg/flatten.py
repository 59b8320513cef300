"""From the shapes of the walk to flat pieces in the work plane, mm. Circles that stay circles stay exact arcs."""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct

from camgen.geometry import curves
from camgen.model.pose import FloatArray
from camgen.read.pieces import Soup
from camgen.read.svg.path import Oval
from camgen.read.svg.tree import DrawnShape

#: How far conjugate diameters may be from equal and square to count as those of a circle.
_ROUND = 1e-9


class _Pieces(Struct):
    """What is put end to end."""

    points: list[FloatArray]
    bulges: list[FloatArray]
    counts: list[int]
    closed: list[bool]
    shape: list[int]


def flatten(drawn: DrawnShape, chord: float) -> Soup:
    """Pieces of all that was drawn, one per subpath. chord: mm, the deviation allowed for curves."""
    placed = [
        (k, track.closed, [_place(run, matrix) for run in track.runs])
        for k, (tracks, matrix) in enumerate(zip(drawn.tracks, drawn.matrices, strict=True))
        for track in tracks
    ]
    smooth = [run for _, _, runs in placed for run in runs if isinstance(run, np.ndarray)]
    fitted = iter(curves.fit(smooth, chord))
    points, bulges = [np.zeros((0, 2))], [np.zeros(0)]
    counts, closed, shape = [0], [], []
    for k, whole, runs in placed:
        outlines = [next(fitted) if isinstance(run, np.ndarray) else run for run in runs]
        rows = [(p[:-1], b[:-1]) for p, b in outlines]
        # A closed piece does not name its first point again.
        last = [] if whole else [(outlines[-1][0][-1:], np.zeros(1))]
        for p, b in (*rows, *last):
            points.append(p)
            bulges.append(b)
        counts.append(counts[-1] + sum(len(p) for p, _ in rows) + len(last))
        closed.append(whole)
        shape.append(k)
    return _soup(drawn, (np.concatenate(points), np.concatenate(bulges)), counts, closed, shape)


def _place(run: FloatArray | Oval, matrix: FloatArray) -> FloatArray | curves.Outline:
    """A run under its matrix: points and bulges as they are, or rational Bezier segments to be fitted."""
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
    return curves.bezier(moved)


def _oval(
    center: FloatArray, first: FloatArray, second: FloatArray, span: tuple[float, float]
) -> FloatArray | curves.Outline:
    start, end = span
    uu, vv, uv = float(first @ first), float(second @ second), float(first @ second)
    size = max(uu, vv)
    flat = abs(first[0] * second[1] - first[1] * second[0]) <= 1e-12 * size
    if flat or abs(uu - vv) > _ROUND * size or abs(uv) > _ROUND * size:
        return curves.ellipse(center, first, second, start, end)
    parts = max(1, math.ceil(abs(end - start) / math.pi - 1e-9))
    t = np.linspace(start, end, parts + 1)
    bulge = math.tan((end - start) / parts / 4) * math.copysign(
        1.0, first[0] * second[1] - first[1] * second[0]
    )
    # Half circles exactly, so that circles are known again.
    bulge = math.copysign(1.0, bulge) if abs(abs(bulge) - 1) < 1e-12 else bulge
    return center + np.cos(t)[:, None] * first + np.sin(t)[:, None] * second, np.full(
        parts + 1, bulge
    )


def _soup(
    drawn: DrawnShape,
    rows: tuple[FloatArray, FloatArray],
    first: list[int],
    closed: list[bool],
    shape: list[int],
) -> Soup:
    layers, kinds, colors = (
        sorted(set(names)) for names in (drawn.names, drawn.kinds, drawn.colors)
    )
    layer_of, kind_of, color_of = (
        {name: k for k, name in enumerate(names)} for names in (layers, kinds, colors)
    )
    return Soup(
        points=rows[0],
        bulges=rows[1],
        first=np.array(first),
        closed=np.array(closed, dtype=np.bool_),
        layer=np.array([layer_of[drawn.names[k]] for k in shape], dtype=np.intp),
        kind=np.array([kind_of[drawn.kinds[k]] for k in shape], dtype=np.intp),
        color=np.array([color_of[drawn.colors[k]] for k in shape], dtype=np.intp),
        layers=tuple(layers),
        kinds=tuple(kinds),
        colors=tuple(colors),
    )
