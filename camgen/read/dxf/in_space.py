"""Maps the entities of a drawing to pieces in space, mm, as `flatten` does for a flat drawing.

Arcs and circles stay arcs in any plane, under a matrix that keeps angles in it. All other curves
become chords. Arcs of old polylines may exceed half a circle, and are divided.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from operator import itemgetter

import numpy as np

from camgen.geometry import curves
from camgen.geometry.space_curves import Chain, make_chords, make_lines, make_turn
from camgen.model.errors import InputError
from camgen.model.limits import Limits, format_limit
from camgen.model.pose import FloatArray
from camgen.read.dxf.entities import DrawnEntities, Smooth
from camgen.read.dxf.flatten import find_arc_center, gather
from camgen.read.space import Piece

#: A curve whose numbers are invalid.
_INVALID = make_lines(np.full((2, 3), np.nan))


def place_in_space(name: str, drawn: DrawnEntities, chord: float, limits: Limits) -> list[Piece]:
    """The curves of the file `name` in drawing order.

    chord: largest deviation of curves that do not become arcs, mm.

    Raises InputError if there are more lines and arcs than `limits` allow.
    """
    chains: list[tuple[int, Chain]] = []
    count = 0
    for owner, chain in _list_chains(drawn, chord):
        count += len(chain[1])
        if count > limits.motions:
            raise InputError(
                name,
                f"its curves come to more than {format_limit(limits.motions)} lines and arcs",
                "",
                "raise tolerance.chord, check input.units, or raise limits.motions",
            )
        chains.append((owner, chain))
    return [
        Piece(drawn.kind[owner], drawn.layer[owner], *chain)
        for owner, chain in sorted(chains, key=itemgetter(0))
    ]


def _list_chains(drawn: DrawnEntities, chord: float) -> Iterator[tuple[int, Chain]]:
    entities = gather(drawn)
    first_row = 0
    for owner, count in zip(entities.owner.tolist(), entities.counts.tolist(), strict=True):
        rows = entities.rows[first_row : first_row + count]
        first_row += count
        if drawn.closed[owner] and count > 1:
            rows = np.concatenate([rows, rows[:1]])
        yield owner, _make_chain(rows, drawn.matrices[drawn.matrix[owner]], chord)
    for owner, curve in drawn.smooth.items():
        yield owner, _make_smooth(curve, drawn.matrices[drawn.matrix[owner]], chord)


def _make_chain(rows: FloatArray, matrix: FloatArray, chord: float) -> Chain:
    """The points (K, 3) and bulges in rows of x, y, z, bulge (K, 4), under a matrix."""
    if not rows[:-1, 3].any():
        return make_lines(_transform(matrix, rows[:, :3]))
    chains = [_make_segment(start, end, matrix, chord) for start, end in pairwise(rows)]
    points = [chains[0][0][:1], *(points[1:] for points, _ in chains)]
    return np.concatenate(points), np.concatenate([via for _, via in chains])


def _make_segment(start: FloatArray, end: FloatArray, matrix: FloatArray, chord: float) -> Chain:
    """The line or the arc from one row to the next, by the bulge of `start`."""
    bulge = float(start[3])
    ends = _transform(matrix, np.stack([start[:3], end[:3]]))
    if bulge == 0 or not (end[:2] - start[:2]).any():
        return make_lines(ends)
    if not np.isfinite([*start, *end]).all():
        return _INVALID
    center = find_arc_center(start[:2], end[:2], bulge)
    radius = start[:2] - center
    axes = matrix[:3, :2]
    u, v = axes @ radius, axes @ np.array([-radius[1], radius[0]])
    middle = _transform(matrix, np.array([[*center, start[2]]]))[0]
    points, via = make_turn(middle, u, v, 0.0, 4 * math.atan(bulge), chord)
    points[[0, -1]] = ends
    return points, via


def _make_smooth(curve: Smooth, matrix: FloatArray, chord: float) -> Chain:
    """An ellipse or a spline under a matrix; `_INVALID` if its numbers do not make a curve."""
    world = curve.transform(matrix)
    if not (np.isfinite(curve.knots).all() and np.isfinite(world).all()):
        return _INVALID
    if not curve.degree:
        start, end = curve.knots.tolist()
        return make_turn(world[0], world[1], world[2], start, end, chord)
    try:
        run = curves.make_bspline(world, curve.knots, curve.degree, curve.weights)
    except ValueError:
        return _INVALID
    return make_lines(make_chords(run, chord))


def _transform(matrix: FloatArray, points: FloatArray) -> FloatArray:
    return np.asarray(points @ matrix[:3, :3].T + matrix[:3, 3])
