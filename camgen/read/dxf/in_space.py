"""From the columns of the walk to pieces in space, mm: what ``flatten`` does where a drawing is meant in space.

Arcs and circles stay arcs wherever their plane lies, under a matrix that keeps angles in it; all other curves become
chords. The outlines of old polylines may bulge by more than half a circle and are cut.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from camgen.geometry import curves
from camgen.geometry.space_curves import Chain, make_chords, make_lines, make_turn
from camgen.model.errors import InputError
from camgen.model.limits import Limits, format_limit
from camgen.model.pose import FloatArray
from camgen.read.dxf.entities import DrawnEntities, Smooth
from camgen.read.dxf.flatten import gather
from camgen.read.space import Piece

_LOST = make_lines(np.full((2, 3), np.nan))


def place_in_space(name: str, drawn: DrawnEntities, chord: float, limits: Limits) -> list[Piece]:
    """Everything that was drawn, in drawing order. chord: mm, the deviation allowed for what is no arc. name: of the
    file. InputError for more spans than may be.
    """
    found: list[tuple[int, Chain]] = []
    spans = 0
    for owner, made in _chains(drawn, chord):
        spans += len(made[1])
        if spans > limits.motions:
            what = f"its curves come to more than {format_limit(limits.motions)} lines and arcs"
            remedy = "raise tolerance.chord, check input.units, or raise limits.motions"
            raise InputError(name, what, "", remedy)
        found.append((owner, made))
    found.sort(key=lambda one: one[0])
    return [Piece(drawn.kind[owner], drawn.layer[owner], *made) for owner, made in found]


def _chains(drawn: DrawnEntities, chord: float) -> Iterator[tuple[int, Chain]]:
    """Owner and chain of each: lines, arcs and outlines, then what is smooth."""
    given = gather(drawn)
    ends = np.cumsum(given.counts)
    for owner, low, high in zip(
        given.owner.tolist(), (ends - given.counts).tolist(), ends.tolist(), strict=True
    ):
        yield (
            owner,
            _outline(
                given.rows[low:high],
                drawn.closed[owner],
                drawn.matrices[drawn.matrix[owner]],
                chord,
            ),
        )
    for owner, curve in zip(drawn.smooth_owner, drawn.smooth, strict=True):
        yield owner, _smooth(curve, drawn.matrices[drawn.matrix[owner]], chord)


def _outline(rows: FloatArray, closed: bool, matrix: FloatArray, chord: float) -> Chain:
    """Rows x, y, z, bulge (K, 4) under ``matrix``."""
    if closed and len(rows) > 1:
        rows = np.concatenate([rows, rows[:1]])
    if not rows[:-1, 3].any():
        return make_lines(_map(matrix, rows[:, :3]))
    chains = [_segment(a, b, matrix, chord) for a, b in pairwise(rows)]
    return _join(chains)


def _segment(a: FloatArray, b: FloatArray, matrix: FloatArray, chord: float) -> Chain:
    """From row ``a`` to row ``b`` of an outline: a line, or an arc by the bulge of ``a``."""
    along, bulge = b[:2] - a[:2], float(a[3])
    if bulge == 0 or not along.any():
        return make_lines(_map(matrix, np.stack([a[:3], b[:3]])))
    if not np.isfinite([*a, *b]).all():
        return _LOST
    center = a[:2] + along / 2 + np.array([-along[1], along[0]]) * (1 - bulge * bulge) / (4 * bulge)
    out = a[:2] - center
    plane = matrix[:3, :2]
    u, v = plane @ out, plane @ np.array([-out[1], out[0]])
    points, via = make_turn(
        _map(matrix, np.array([[*center, a[2]]]))[0], u, v, 0.0, 4 * math.atan(bulge), chord
    )
    points[[0, -1]] = _map(matrix, np.stack([a[:3], b[:3]]))
    return points, via


def _smooth(curve: Smooth, matrix: FloatArray, chord: float) -> Chain:
    """An ellipse or a spline under ``matrix``; not finite where its numbers make none."""
    world = curve.control @ matrix[:3, :3].T
    world[: len(world) if curve.degree else 1] += matrix[:3, 3]
    if not (np.isfinite(curve.knots).all() and np.isfinite(world).all()):
        return _LOST
    if not curve.degree:
        start, end = curve.knots.tolist()
        return make_turn(world[0], world[1], world[2], start, end, chord)
    try:
        run = curves.make_bspline(world, curve.knots, curve.degree, curve.weights)
    except ValueError:
        return _LOST
    return make_lines(make_chords(run, chord))


def _map(matrix: FloatArray, points: FloatArray) -> FloatArray:
    return np.asarray(points @ matrix[:3, :3].T + matrix[:3, 3])


def _join(chains: list[Chain]) -> Chain:
    """Chains of which each begins where the one before ends, as one."""
    points = [chains[0][0][:1], *(points[1:] for points, _ in chains)]
    return np.concatenate(points), np.concatenate([via for _, via in chains])
