"""Where the tool centre should run beside a part, from formulas for lines and arcs, and how far a path is from it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bench.render.shapes import Loop, Pieces, find_turns, pieces

#: mm between the points of the truth, and how far a path may be off before it counts as another path altogether.
SPACING, OTHER = 0.05, 1.0


@dataclass(frozen=True, eq=False)
class Truth:
    """All places at ``distance`` from a part, outside of its material.

    points: (N,) complex, mm. normals: (N,) complex, unit, towards the part. sharp: (N,) bool, what sharp corners make:
    the arc around an outer one, the kink before an inner one or before another part of the outline. contact: (N,), by
    how much the contact point runs along the part while the tool centre runs a mm: 0 around a sharp corner. length:
    (N,) mm, what each point stands for: of the part where the contact point runs, else of the path.
    """

    part: Pieces
    distance: float
    points: np.ndarray
    normals: np.ndarray
    sharp: np.ndarray
    contact: np.ndarray
    length: np.ndarray


@dataclass(frozen=True)
class Error:
    """Of a path, mm. Away from sharp corners: largest and root mean square; near them: largest. missed: the part of
    the truth, away from sharp corners, beside which there is no path. Paths where none should be count as ``most``.
    """

    most: float
    rms: float
    near: float
    missed: float


def offset_truth(loops: Sequence[Loop], distance: float) -> Truth:
    """Every line is shifted, every arc gets another radius, every sharp outer corner an arc; what is then nearer to
    the part than ``distance`` goes.
    """
    part = pieces(loops)
    kept = [_beside(part, k, distance) for k in range(len(part.start))]
    directions, turns = find_turns(loops)
    for k in np.flatnonzero(turns > 1e-6).tolist():
        kept.append(_around(part, k, directions[k], turns[k], distance))
    return Truth(part, distance, *(np.concatenate(column) for column in zip(*kept, strict=True)))


def _beside(part: Pieces, k: int, distance: float) -> tuple[np.ndarray, ...]:
    t = np.linspace(0, 1, max(2, round(part.length[k] / SPACING) + 1))
    place, rate = part.at(np.full(len(t), k), t)
    normal = 1j * rate / np.abs(rate)
    points = place - distance * normal
    free = part.distance(points) > distance - 1e-7
    # Next to what has gone: there the path bends sharply.
    sharp = ~(np.append(True, free[:-1]) & np.append(free[1:], True))
    # The path runs around the centre of an arc with another radius, at the same angles.
    contact = np.full(len(t), part.length[k] / abs(part.length[k] + distance * part.sweep[k]))
    return (
        points[free],
        normal[free],
        sharp[free],
        contact[free],
        _stands_for(part.length[k], t)[free],
    )


def _stands_for(length: float, t: np.ndarray) -> np.ndarray:
    """What each of the places ``t``, evenly from 0 to 1, has of a length."""
    share = np.full(len(t), length / (len(t) - 1))
    share[[0, -1]] /= 2
    return share


def _around(
    part: Pieces, piece: int, direction: complex, turn: float, distance: float
) -> tuple[np.ndarray, ...]:
    """The arc around the start of ``piece``."""
    t = np.linspace(0, 1, max(2, round(distance * turn / SPACING) + 1))
    normal = 1j * direction * np.exp(1j * turn * t)
    points = part.start[piece] - distance * normal
    free = part.distance(points) > distance - 1e-7
    length = _stands_for(distance * turn, t)
    return points[free], normal[free], np.ones(free.sum(), bool), np.zeros(free.sum()), length[free]


def path_error(path: np.ndarray, truth: Truth, away: float = 1.0) -> Error:
    """The error of a path given by points (N,) complex, mm, not farther apart than 0.2 mm.

    away: points nearer than this to what a sharp corner makes count as near it.
    """
    off = np.abs(truth.part.distance(path) - truth.distance)
    from_truth = nearest(path, truth.points)
    other = from_truth > OTHER
    off[other] = from_truth[other]
    near = nearest(path, truth.points[truth.sharp]) < away
    calm = truth.points[nearest(truth.points, truth.points[truth.sharp]) > away + OTHER]
    missed = float(np.mean(nearest(calm, path) > OTHER)) if len(calm) else 0.0
    return Error(
        _most(off[~near]), float(np.sqrt(np.mean(off[~near] ** 2))), _most(off[near]), missed
    )


def nearest(places: np.ndarray, others: np.ndarray) -> np.ndarray:
    """From each of the places (N,) the distance to the nearest of the others (M,); infinite if there are none."""
    least = np.full(len(places), np.inf)
    if not len(others):
        return least
    x, y = others.real.astype(np.float32), others.imag.astype(np.float32)
    for k in range(0, len(places), 256):
        here = places[k : k + 256, None]
        square = (here.real.astype(np.float32) - x) ** 2 + (here.imag.astype(np.float32) - y) ** 2
        least[k : k + 256] = np.sqrt(square.min(axis=1))
    return least


def _most(values: np.ndarray) -> float:
    return float(values.max()) if len(values) else 0.0
