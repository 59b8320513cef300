"""The motions of a program as curves: lengths, directions at both ends, radii, and how far the tool turns."""

from __future__ import annotations

from operator import attrgetter
from typing import TYPE_CHECKING

import numpy as np
from msgspec import Struct

from camgen.body import taken
from camgen.ir import MoveC, MoveJ, Program
from camgen.pose import FloatArray
from camgen.report import arc_lengths

if TYPE_CHECKING:
    from camgen.robots.models import Robot

#: Sine of the sweep below which three points are one line, as in ``report.arc_lengths``.
_FLAT = 1e-9


class Shape(Struct, frozen=True, eq=False):
    """M motions. end: (M, 3) mm, work frame, NaN where it is not known. length: (M,) mm of the TCP, 0 where not known.
    first, last: (M, 3) unit vectors of travel at both ends. radius: (M,) mm, infinite but for arcs. turn: (M,) rad of
    the tool on the way.
    """

    end: FloatArray
    length: FloatArray
    first: FloatArray
    last: FloatArray
    radius: FloatArray
    turn: FloatArray


def shaped(program: Program, arm: Robot | None) -> Shape:
    """The motions of ``program``. arm: tells where joint values put the tool; without one that is not known."""
    columns = program.columns
    end, turn = _placed(program, arm)
    start = np.concatenate([np.full((min(1, len(end)), 3), np.nan), end[:-1]])
    chord = end - start
    length = np.linalg.norm(chord, axis=1)
    first = last = chord
    radius = np.full(len(end), np.inf)
    arc = np.flatnonzero(columns.moves_are(MoveC) & ~np.isnan(length))
    if len(arc):
        via, a, b = columns.vias[arc], start[arc], end[arc]
        straight = length[arc]
        length[arc] = arc_lengths(a, via, b)
        first, last = chord.copy(), chord.copy()
        first[arc], last[arc] = _tangent(a, via, b), -_tangent(b, via, a)
        radius[arc] = _radius(a, via, b, straight)
    return Shape(end, np.nan_to_num(length), _unit(first), _unit(last), radius, turn)


def _placed(program: Program, arm: Robot | None) -> tuple[FloatArray, FloatArray]:
    """Where the motions end (M, 3) and the angles (M,) by which the tool turns."""
    columns = program.columns
    if arm is not None:
        from camgen.sampling import ends  # noqa: PLC0415 (kinematics, only for what needs them)

        fixed = taken(columns.moves, columns.moves_are(MoveJ) & ~columns.posed)
        anchors = np.array([move.target.values for move in fixed]).reshape(len(fixed), len(arm.home))
        end, rotation = ends(program, arm, anchors)
        return end, np.append(0.0, _angles(rotation[:-1], rotation[1:]))
    turn = np.zeros(len(columns.moves))
    posed = columns.posed
    rotations = list(map(attrgetter("target.rotation"), taken(columns.moves, posed)))
    same = np.fromiter(map(id, rotations), np.int64, len(rotations))
    where = np.flatnonzero(posed)
    # A turn that starts at joint values is not known.
    other = np.flatnonzero((same[1:] != same[:-1]) & (np.diff(where) == 1))
    if len(other):
        pairs = [np.stack([rotations[k + late] for k in other.tolist()]) for late in (0, 1)]
        turn[where[other + 1]] = _angles(*pairs)
    return columns.ends, turn


def _angles(a: FloatArray, b: FloatArray) -> FloatArray:
    """The angle (N,) of each rotation that takes a (N, 3, 3) to b, as ``pose.angle_between``."""
    step = np.einsum("nji,njk->nik", a, b)
    sine = np.hypot(
        np.hypot(step[:, 2, 1] - step[:, 1, 2], step[:, 0, 2] - step[:, 2, 0]), step[:, 1, 0] - step[:, 0, 1]
    )
    return np.asarray(np.arctan2(sine, np.trace(step, axis1=1, axis2=2) - 1.0))


def _tangent(start: FloatArray, via: FloatArray, end: FloatArray) -> FloatArray:
    """The direction (N, 3) in which the circle through three points leaves its start.

    Inversion about the start makes a line of the circle; the tangent is parallel to that line.
    """
    to_via, to_end = via - start, end - start
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(
            to_via / np.einsum("ij,ij->i", to_via, to_via)[:, None]
            - to_end / np.einsum("ij,ij->i", to_end, to_end)[:, None]
        )


def _radius(start: FloatArray, via: FloatArray, end: FloatArray, chord: FloatArray) -> FloatArray:
    """Infinite for three points on one line, (N,). The angle at via sees the chord: chord = 2 R sin(angle)."""
    a, b = start - via, end - via
    sizes = np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
    sine = np.linalg.norm(np.cross(a, b), axis=1) / np.where(sizes > 0, sizes, 1.0)
    with np.errstate(divide="ignore"):
        return np.where(sine > _FLAT, chord / (2 * sine), np.inf)


def _unit(vectors: FloatArray) -> FloatArray:
    """Unit vectors; those of no length, or not known, are 0."""
    size = np.nan_to_num(np.linalg.norm(vectors, axis=1))
    return np.asarray(
        np.where(size > 0, 1.0, 0.0)[:, None] * np.nan_to_num(vectors) / np.where(size > 0, size, 1.0)[:, None]
    )
