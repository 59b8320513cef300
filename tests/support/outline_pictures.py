"""Grey pictures of drawn parts with known outlines, for test_outlines and test_primitives.

A part is a list of loops, each a list of corners (u, v, radius) in pixels, radius 0 for a sharp one. What a pixel shows
is the share of it that the part covers: exact along a row, and the mean of 16 lines per row. Then blur and noise.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
import shapely

Corner = tuple[float, float, float]
_LINES = 16
#: Arcs are drawn as chords that leave them by less than this, px.
_SAGITTA = 1e-4


class Drawn(NamedTuple):
    """Loops as complex points u + i v, dense on arcs, and the sharp corners (N,) complex."""

    loops: list[np.ndarray]
    sharp: np.ndarray

    def placed(self, turn: float, place: complex) -> Drawn:
        """Turned by ``turn`` rad about 0, then moved by ``place``."""
        spin = np.exp(1j * turn)
        return Drawn([loop * spin + place for loop in self.loops], self.sharp * spin + place)

    def gaps(self, points: np.ndarray) -> np.ndarray:
        """The distance (N,) px from complex points to the nearest loop."""
        lines = [
            np.stack([loop, np.roll(loop, -1)], axis=1).view(float).reshape(-1, 2, 2)
            for loop in self.loops
        ]
        tree = shapely.STRtree(shapely.linestrings(np.concatenate(lines)))
        places = shapely.points(points.real, points.imag)
        return np.asarray(shapely.distance(places, tree.geometries[tree.nearest(places)]))

    def near_corner(self, points: np.ndarray, reach: float) -> np.ndarray:
        """Which points (N,) are nearer than ``reach`` px to a sharp corner."""
        return (np.abs(points[:, None] - self.sharp) < reach).any(axis=1)


def drawn(*loops: list[Corner]) -> Drawn:
    found = [rounded(loop) for loop in loops]
    return Drawn(
        found, np.array([complex(u, v) for loop in loops for u, v, radius in loop if not radius])
    )


def disc(radius: float) -> Drawn:
    return Drawn([arc(0, radius, 0.0, 2 * np.pi)[:-1]], np.zeros(0, complex))


def with_holes(part: Drawn, *holes: tuple[complex, float]) -> Drawn:
    return Drawn([*part.loops, *(arc(c, r, 0.0, 2 * np.pi)[:-1] for c, r in holes)], part.sharp)


def arc(centre: complex, radius: float, begin: float, sweep: float) -> np.ndarray:
    steps = int(np.ceil(abs(sweep) / np.sqrt(8 * _SAGITTA / radius))) + 1
    return centre + radius * np.exp(1j * (begin + np.linspace(0, sweep, steps + 1)))


def rounded(corners: list[Corner]) -> np.ndarray:
    at = np.array([complex(u, v) for u, v, _ in corners])
    points: list[np.ndarray] = []
    for k, (_, _, radius) in enumerate(corners):
        into, out = at[k] - at[k - 1], at[(k + 1) % len(at)] - at[k]
        if not radius:
            points.append(at[k : k + 1])
            continue
        turn = float(np.angle(out / into))
        ahead = into / abs(into)
        begin = at[k] - ahead * radius * np.tan(abs(turn) / 2)
        side = 1j * np.sign(turn)
        points.append(
            arc(begin + ahead * radius * side, radius, float(np.angle(-ahead * side)), turn)
        )
    return np.concatenate(points)


def gear(teeth: int, root: float, tip: float, fillet: float = 0.0) -> Drawn:
    """Straight flanks; tip lands and root lands are lines. Four corners per tooth."""
    pitch = 2 * np.pi / teeth
    corners: list[Corner] = []
    for k in range(teeth):
        for share, radius in ((-0.30, root), (-0.14, tip), (0.14, tip), (0.30, root)):
            point = radius * np.exp(1j * pitch * (k + share))
            corners.append((point.real, point.imag, fillet))
    return drawn(corners)


def plate() -> Drawn:
    """Rounded corners, a notch, a slot, and holes down to a radius of 5 px, around 0."""
    outline: list[Corner] = [
        (-200, -140, 30), (0, -140, 0), (0, -100, 0), (40, -100, 0), (40, -140, 0), (200, -140, 12), (200, 60, 0),
        (140, 140, 0), (-200, 140, 5),
    ]  # fmt: skip
    slot: list[Corner] = [(-120, 20, 12), (0, 20, 12), (0, 44, 12), (-120, 44, 12)]
    holes = ((-140 - 80j, 25.0), (-60 - 90j, 10.0), (110 - 60j, 5.0), (60 + 80j, 40.0))
    return with_holes(drawn(outline, slot), *holes)


def covered(part: Drawn, height: int, width: int) -> np.ndarray:
    """The share (H, W) float64 of each pixel that the part covers, even-odd."""
    total = np.zeros((height, width + 1))
    lines = (np.arange(height * _LINES) + 0.5) / _LINES - 0.5
    crossing = [_crossings(loop, lines) for loop in part.loops]
    row, u = (np.concatenate(column) for column in zip(*crossing, strict=True))
    order = np.lexsort([u, row])
    row, u = row[order], u[order] + 0.5
    # Crossings of a line alternate: in, out, in, out.
    sign = np.where(np.arange(len(row)) % 2 == 0, 1.0, -1.0) / _LINES
    whole = np.floor(u).astype(int)
    np.add.at(total, (row // _LINES, whole), sign * (1 - (u - whole)))
    np.add.at(total, (row // _LINES, whole + 1), sign * (u - whole))
    return np.cumsum(total, axis=1)[:, :width]


def _crossings(loop: np.ndarray, lines: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Number of the line and u of every crossing of the loop."""
    a, b = loop, np.roll(loop, -1)
    first = np.searchsorted(lines, np.minimum(a.imag, b.imag), side="left")
    last = np.searchsorted(lines, np.maximum(a.imag, b.imag), side="left")
    count = last - first
    which = np.repeat(np.arange(len(a)), count)
    row = np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count) + first[which]
    share = (lines[row] - a.imag[which]) / (b.imag - a.imag)[which]
    return row, a.real[which] + share * (b.real - a.real)[which]


def picture(
    part: Drawn,
    height: int,
    width: int,
    blur: float = 0.7,
    noise: float = 0.0,
    low: float = 60.0,
    high: float = 180.0,
) -> np.ndarray:
    """(H, W) uint8: grey value ``high`` on the part, ``low`` beside it."""
    grey = low + (high - low) * covered(part, height, width)
    if blur:
        grey = cv2.GaussianBlur(grey, (0, 0), blur)
    if noise:
        grey = grey + np.random.default_rng(1).normal(0, noise, grey.shape)
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


def mask_of(grey: np.ndarray, level: float = 120.0) -> np.ndarray:
    return np.where(grey > level, 255, 0).astype(np.uint8)
