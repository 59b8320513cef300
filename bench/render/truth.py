"""The exact path of the tool centre beside a part of lines and arcs, and the error of a path."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from bench.render.shapes import Loop, Pieces, find_turns, pieces

#: Distance between the points of the truth, mm.
SPACING = 0.05
#: Points of a path that are farther from the truth belong to a path that should not be there, mm.
OTHER = 1.0


@dataclass(frozen=True, eq=False)
class Truth:
    """All places at ``distance`` mm from a part, outside its material.

    points: (N,) complex, mm.
    normals: (N,) complex, unit vectors towards the part.
    sharp: (N,) bool, points at sharp corners: the arc around an outer corner, and the kink before
        an inner corner or before another part of the outline.
    contact: (N,) speed of the contact point over that of the tool centre, 0 around a sharp corner.
    length: (N,) mm, length of the part for each point; where the contact point stands still, of the
        path.
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
    """The error of a path, mm.

    largest: the largest error away from sharp corners, paths that should not be there included.
    rms: the root mean square away from sharp corners.
    near: the largest error near sharp corners.
    missed: share of the truth, away from sharp corners, that has no path.
    """

    largest: float
    rms: float
    near: float
    missed: float


def offset_truth(loops: Sequence[Loop], distance: float) -> Truth:
    """The offset curve of a part: lines are shifted, arcs get another radius, sharp corners an arc.

    Points that are then nearer to the part than ``distance`` are left out.
    """
    part = pieces(loops)
    curves = [_offset_piece(part, k, distance) for k in range(len(part.start))]
    directions, turns = find_turns(loops)
    for k in np.flatnonzero(turns > 1e-6).tolist():
        curves.append(_round_corner(part, k, directions[k], turns[k], distance))
    return Truth(part, distance, *(np.concatenate(column) for column in zip(*curves, strict=True)))


def _offset_piece(part: Pieces, k: int, distance: float) -> tuple[np.ndarray, ...]:
    t = np.linspace(0, 1, max(2, round(part.length[k] / SPACING) + 1))
    place, rate = part.at(np.full(len(t), k), t)
    normal = 1j * rate / np.abs(rate)
    points = place - distance * normal
    free = part.distance(points) > distance - 1e-7
    # Next to points that were left out, the path bends sharply.
    sharp = ~(np.append(True, free[:-1]) & np.append(free[1:], True))
    # The path runs around the centre of an arc with another radius, at the same angles.
    contact = np.full(len(t), part.length[k] / abs(part.length[k] + distance * part.sweep[k]))
    length = _share_length(part.length[k], len(t))
    return points[free], normal[free], sharp[free], contact[free], length[free]


def _share_length(length: float, count: int) -> np.ndarray:
    """The share of each of `count` evenly spaced points in a length."""
    shares = np.full(count, length / (count - 1))
    shares[[0, -1]] /= 2
    return shares


def _round_corner(
    part: Pieces, piece: int, direction: complex, turn: float, distance: float
) -> tuple[np.ndarray, ...]:
    """The arc around the corner at the start of a piece."""
    t = np.linspace(0, 1, max(2, round(distance * turn / SPACING) + 1))
    normal = 1j * direction * np.exp(1j * turn * t)
    points = part.start[piece] - distance * normal
    free = part.distance(points) > distance - 1e-7
    length = _share_length(distance * turn, len(t))
    return points[free], normal[free], np.ones(free.sum(), bool), np.zeros(free.sum()), length[free]


def path_error(path: np.ndarray, truth: Truth, near_by: float = 1.0) -> Error:
    """The error of a path given by points (N,) complex, mm, not farther apart than 0.2 mm.

    near_by: points within this distance of the truth's sharp points count as near them, mm.
    """
    error = np.abs(truth.part.distance(path) - truth.distance)
    from_truth = measure_nearest(path, truth.points)
    other = from_truth > OTHER
    error[other] = from_truth[other]
    sharp = truth.points[truth.sharp]
    near = measure_nearest(path, sharp) < near_by
    smooth = truth.points[measure_nearest(truth.points, sharp) > near_by + OTHER]
    missed = float(np.mean(measure_nearest(smooth, path) > OTHER)) if len(smooth) else 0.0
    rms = float(np.sqrt(np.mean(error[~near] ** 2)))
    largest, largest_near = (float(part.max(initial=0.0)) for part in (error[~near], error[near]))
    return Error(largest, rms, largest_near, missed)


def measure_nearest(places: np.ndarray, others: np.ndarray) -> np.ndarray:
    """The distance from each of the places (N,) to the nearest other (M,), inf without one."""
    if not len(others):
        return np.full(len(places), np.inf)
    return np.abs(places - others[find_nearest(places, others)])


def find_nearest(places: np.ndarray, others: np.ndarray) -> np.ndarray:
    """The index of the nearest of the others (M,) for each of the places, (N,).

    The first one counts where several are as near.
    """
    points = [shapely.points(each.real, each.imag) for each in (others, places)]
    rows = np.full(len(places), len(others))
    np.minimum.at(rows, *shapely.STRtree(points[0]).query_nearest(points[1]))
    return rows
