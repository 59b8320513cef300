"""Points along lines and arcs in space, by formulas of their own. Nothing here imports camgen."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

Array = np.ndarray


def find_arc(start: Array, via: Array, end: Array) -> tuple[Array, Array, float]:
    """Centre (mm), axis and angle (rad, 0 to 2 pi about the axis) of the arc through three points.

    ValueError if they lie on a line.
    """
    a, b = via - start, end - start
    normal = np.cross(a, b)
    size = float(normal @ normal)
    if size < 1e-12:
        raise ValueError("three points of an arc on a line")
    offset = (b @ b) * np.cross(normal, a) + (a @ a) * np.cross(b, normal)
    centre = start + offset / (2.0 * size)
    axis = normal / math.sqrt(size)
    spoke = start - centre
    across = np.cross(axis, spoke)
    angle = math.atan2((end - centre) @ across, (end - centre) @ spoke) % math.tau
    return centre, axis, angle


def place_motion(start: Array, via: Array | None, end: Array, share: Array) -> Array:
    """The places at shares (S,) of a line, or of an arc through `via`, (S, 3) mm."""
    share = share[:, None]
    if via is None:
        return np.asarray(start + share * (end - start))
    centre, axis, angle = find_arc(start, via, end)
    spoke = start - centre
    turn = share * angle
    return np.asarray(centre + np.cos(turn) * spoke + np.sin(turn) * np.cross(axis, spoke))


def measure_motion(start: Array, via: Array | None, end: Array) -> float:
    """The length of a line, or of an arc through `via`, mm."""
    if via is None:
        return float(np.linalg.norm(end - start))
    centre, _, angle = find_arc(start, via, end)
    return float(np.linalg.norm(start - centre)) * angle


def sample_motion(
    start: Array, via: Array | None, end: Array, step: float, fewest: int = 2
) -> Array:
    """Points along a line or an arc, less than `step` mm apart, both ends included, (N, 3) mm.

    fewest: number of points of a short motion.
    """
    count = max(fewest, int(measure_motion(start, via, end) / step) + 2)
    points = place_motion(start, via, end, np.linspace(0.0, 1.0, count))
    points[-1] = end
    return points


def sample_plane(start: Array, via: Array | None, end: Array, step: float) -> Array:
    """Points along a motion as seen from above, at most `step` mm apart, (N,) complex, mm."""
    level = np.array([1.0, 1.0, 0.0])
    middle = None if via is None else via * level
    return sample_motion(start * level, middle, end * level, step)[:, :2] @ [1, 1j]


def measure_from_lines(points: Array, start: Array, end: Array) -> Array:
    """Distances of points from lines, mm. All arrays are (..., D) and are broadcast."""
    step = end - start
    square = (step**2).sum(axis=-1)
    share = ((points - start) * step).sum(axis=-1) / np.where(square > 0, square, 1.0)
    nearest = start + np.clip(share, 0.0, 1.0)[..., None] * step
    return np.asarray(np.linalg.norm(nearest - points, axis=-1))


def rotate(axis: Array, angle: float | Array) -> Array:
    """Rotations about a unit axis (3,) by Rodrigues' formula, (..., 3, 3). angle: rad, (...)."""
    x, y, z = axis
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    turn = np.asarray(angle)[..., None, None]
    return np.asarray(np.eye(3) + np.sin(turn) * skew + (1 - np.cos(turn)) * (skew @ skew))


class LevelArc(NamedTuple):
    """An arc or a helix about an upright axis.

    start, end: (3,) mm. The same place from above is a whole turn.
    centre: (2,) mm.
    is_left: whether it runs counter-clockwise, seen from above.
    turns: number of its turns, the last one as far as `end`.
    """

    start: Array
    end: Array
    centre: Array
    is_left: bool
    turns: int = 1

    @property
    def angle(self) -> float:
        """The angle through which it runs, rad."""
        if math.dist(self.start[:2], self.end[:2]) < 1e-6:
            return math.tau * self.turns
        first, last = (
            math.atan2(*(place[:2] - self.centre)[::-1]) for place in (self.start, self.end)
        )
        sense = 1 if self.is_left else -1
        return sense * (last - first) % math.tau + math.tau * (self.turns - 1)

    def place(self, share: Array) -> Array:
        """The places at shares (S,) of it, (S, 3) mm."""
        x, y = self.start[:2] - self.centre
        turn = share * (self.angle if self.is_left else -self.angle)
        cos, sin = np.cos(turn), np.sin(turn)
        level = self.centre + np.column_stack([cos * x - sin * y, sin * x + cos * y])
        return np.column_stack([level, self.start[2] + share * (self.end[2] - self.start[2])])

    def sample(self, sagitta: float) -> Array:
        """Points on it, both ends included, (N, 3) mm. Chords leave it by at most `sagitta`, mm."""
        radius = max(math.dist(self.start[:2], self.centre), sagitta)
        step = 2 * math.acos(max(1 - sagitta / radius, 0.0))
        points = self.place(np.linspace(0.0, 1.0, max(math.ceil(self.angle / step), 1) + 1))
        points[-1] = self.end
        return points
