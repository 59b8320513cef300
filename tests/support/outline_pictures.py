"""Grey pictures of drawn parts with known outlines, for test_outlines and test_primitives.

A part is a list of loops, each a list of corners (u, v, radius) in px; the radius of a sharp corner
is 0. The grey value of a pixel follows from its area on the part: it is exact along a row, and the
mean of 16 lines per row. Blur and noise follow.
"""

from __future__ import annotations

from itertools import chain
from typing import NamedTuple

import cv2
import numpy as np
import shapely

Corner = tuple[float, float, float]
_LINES = 16
#: Arcs become chords that deviate from them by less than this, px.
_SAGITTA = 1e-4


class Drawn(NamedTuple):
    """The outline of a part.

    loops: closed chains of complex points u + i v, px, dense on arcs.
    sharp: complex sharp corners (N,), px.
    """

    loops: list[np.ndarray]
    sharp: np.ndarray

    def placed(self, turn: float, place: complex) -> Drawn:
        """The part after a rotation by `turn` rad about 0 and a shift by `place`."""
        spin = np.exp(1j * turn)
        return Drawn([loop * spin + place for loop in self.loops], self.sharp * spin + place)

    def gaps(self, points: np.ndarray) -> np.ndarray:
        """The distances (N,) of complex points from the nearest loop, px."""
        lines = [
            np.stack([loop, np.roll(loop, -1)], axis=1).view(float).reshape(-1, 2, 2)
            for loop in self.loops
        ]
        tree = shapely.STRtree(shapely.linestrings(np.concatenate(lines)))
        places = shapely.points(points.real, points.imag)
        return np.asarray(shapely.distance(places, tree.geometries[tree.nearest(places)]))

    def near_corner(self, points: np.ndarray, radius: float) -> np.ndarray:
        """Mask (N,) of the points within a radius, px, of a sharp corner."""
        return (np.abs(points[:, None] - self.sharp) < radius).any(axis=1)


def drawn(*loops: list[Corner]) -> Drawn:
    rings = [rounded(loop) for loop in loops]
    sharp = [complex(u, v) for u, v, radius in chain.from_iterable(loops) if not radius]
    return Drawn(rings, np.array(sharp))


def disc(radius: float) -> Drawn:
    return Drawn([arc(0, radius, 0.0, 2 * np.pi)[:-1]], np.zeros(0, complex))


def with_holes(part: Drawn, *holes: tuple[complex, float]) -> Drawn:
    return Drawn([*part.loops, *(arc(c, r, 0.0, 2 * np.pi)[:-1] for c, r in holes)], part.sharp)


def arc(centre: complex, radius: float, begin: float, sweep: float) -> np.ndarray:
    steps = int(np.ceil(abs(sweep) / np.sqrt(8 * _SAGITTA / radius))) + 1
    return centre + radius * np.exp(1j * (begin + np.linspace(0, sweep, steps + 1)))


def rounded(corners: list[Corner]) -> np.ndarray:
    corner_points = np.array([complex(u, v) for u, v, _ in corners])
    points: list[np.ndarray] = []
    for k, (_, _, radius) in enumerate(corners):
        enter, leave = (
            corner_points[k] - corner_points[k - 1],
            corner_points[(k + 1) % len(corner_points)] - corner_points[k],
        )
        if not radius:
            points.append(corner_points[k : k + 1])
            continue
        corner_angle = float(np.angle(leave / enter))
        ahead = enter / abs(enter)
        begin = corner_points[k] - ahead * radius * np.tan(abs(corner_angle) / 2)
        side = 1j * np.sign(corner_angle)
        points.append(
            arc(begin + ahead * radius * side, radius, float(np.angle(-ahead * side)), corner_angle)
        )
    return np.concatenate(points)


def gear(teeth: int, root: float, tip: float, fillet: float = 0.0) -> Drawn:
    """A gear with straight flanks and straight lands. Each tooth has four corners."""
    pitch = 2 * np.pi / teeth
    corners: list[Corner] = []
    for k in range(teeth):
        for share, radius in ((-0.30, root), (-0.14, tip), (0.14, tip), (0.30, root)):
            point = radius * np.exp(1j * pitch * (k + share))
            corners.append((point.real, point.imag, fillet))
    return drawn(corners)


def plate() -> Drawn:
    """A plate around 0 with rounded corners, a notch, a slot, and holes of 5 px radius and more."""
    outline: list[Corner] = [
        (-200, -140, 30), (0, -140, 0), (0, -100, 0), (40, -100, 0), (40, -140, 0),
        (200, -140, 12), (200, 60, 0), (140, 140, 0), (-200, 140, 5),
    ]  # fmt: skip
    slot: list[Corner] = [(-120, 20, 12), (0, 20, 12), (0, 44, 12), (-120, 44, 12)]
    holes = ((-140 - 80j, 25.0), (-60 - 90j, 10.0), (110 - 60j, 5.0), (60 + 80j, 40.0))
    return with_holes(drawn(outline, slot), *holes)


def covered(part: Drawn, height: int, width: int) -> np.ndarray:
    """The fraction (H, W) of each pixel that the part covers, by the even-odd rule."""
    total = np.zeros((height, width + 1))
    lines = (np.arange(height * _LINES) + 0.5) / _LINES - 0.5
    crossing = [_crossings(loop, lines) for loop in part.loops]
    row, u = (np.concatenate(column) for column in zip(*crossing, strict=True))
    order = np.lexsort([u, row])
    row, u = row[order], u[order] + 0.5
    # The crossings of a line enter and leave the part alternately.
    sign = np.where(np.arange(len(row)) % 2 == 0, 1.0, -1.0) / _LINES
    whole = np.floor(u).astype(int)
    np.add.at(total, (row // _LINES, whole), sign * (1 - (u - whole)))
    np.add.at(total, (row // _LINES, whole + 1), sign * (u - whole))
    return np.cumsum(total, axis=1)[:, :width]


def _crossings(loop: np.ndarray, lines: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The index of the line and the position u of each crossing of a loop."""
    a, b = loop, np.roll(loop, -1)
    first = np.searchsorted(lines, np.minimum(a.imag, b.imag), side="left")
    last = np.searchsorted(lines, np.maximum(a.imag, b.imag), side="left")
    count = last - first
    segment = np.repeat(np.arange(len(a)), count)
    row = np.arange(len(segment)) - np.repeat(np.cumsum(count) - count, count) + first[segment]
    fraction = (lines[row] - a.imag[segment]) / (b.imag - a.imag)[segment]
    return row, a.real[segment] + fraction * (b.real - a.real)[segment]


def picture(
    part: Drawn,
    height: int,
    width: int,
    blur: float = 0.7,
    noise: float = 0.0,
    levels: tuple[float, float] = (60.0, 180.0),
) -> np.ndarray:
    """The picture (H, W) uint8 of a part. levels: grey values around the part and on it."""
    low, high = levels
    grey = low + (high - low) * covered(part, height, width)
    if blur:
        grey = cv2.GaussianBlur(grey, (0, 0), blur)
    if noise:
        grey = grey + np.random.default_rng(1).normal(0, noise, grey.shape)
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


def mask_of(grey: np.ndarray, level: float = 120.0) -> np.ndarray:
    return np.where(grey > level, 255, 0).astype(np.uint8)
