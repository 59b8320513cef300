"""Passes along the border, one inside the other, each the line at one distance from the border.

A pass is followed only where there is room beyond it: in a place that is hardly wider than the tool it would run there
and back on the same line, and that place is left to a centre line.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from camgen.planners.fill_ground import Ground, Pixels
from camgen.planners.image_space_border import CLOSE, foot, near
from camgen.planners.image_space_field import beyond
from camgen.planners.image_space_rings import ComplexArray, latest, rings, unit
from camgen.pose import FloatArray

#: Room beyond a pass that makes it one, px.
ROOM = 0.75
#: Passes that no border shows are made of one pixel in so many.
_EVERY = 3
_DISC = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (5, 5))


def passes(field: Ground, radius: float, spacing: float) -> list[ComplexArray]:
    """Closed lines (N,) px at ``radius``, ``radius + spacing``, ... px from the border, no first point again."""
    level = radius
    found: list[ComplexArray] = []
    deepest = float(field.depth.max()) if field.depth.size else 0.0
    window = (0, 0, field.mask.shape[1], field.mask.shape[0])
    while level + ROOM <= deepest:
        u, v, width, height = window
        depth = field.depth[v : v + height, u : u + width]
        core = beyond(depth, level + ROOM)
        wide = cv2.bitwise_and(cv2.dilate(core, _DISC), beyond(depth, level))
        chains, _ = cv2.findContours(wide, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        first = level == radius
        corner = np.array([u, v], dtype=np.float64)
        pixels = [chain[:: 1 if first else _EVERY, 0] + corner for chain in chains if len(chain) > 2]
        found += _exact(field, pixels, level, 3 if first else 1)
        box = cv2.boundingRect(core)
        window = (max(u + box[0] - 1, 0), max(v + box[1] - 1, 0), box[2] + 2, box[3] + 2)
        level += spacing
    return found


def core(field: Ground, radius: float) -> Pixels:
    """255 where there is room beyond the first pass: what passes take care of."""
    return beyond(field.depth, radius + ROOM)


def _exact(field: Ground, chains: Sequence[FloatArray], level: float, rounds: int) -> list[ComplexArray]:
    """Chains of pixels (N, 2) moved to exactly ``level`` px from the border.

    Beside a corner a point has two sides to keep away from: in further ``rounds`` its neighbours' feet are tried too.
    """
    if not chains:
        return []
    table = rings([len(c) for c in chains])
    flat = np.concatenate(chains)
    pixels = flat[:, 0] + 1j * flat[:, 1]
    depth, inwards = _slope(field, pixels)
    points = pixels - inwards * (depth - level)
    row = near(field.edge, points - inwards * level)
    row = np.where(row >= 0, row, row[np.maximum(latest(table, row >= 0), 0)])
    for again in range(rounds):
        on, row = foot(field.edge, points, np.maximum(row, 0), CLOSE)
        for by in (-3, 3) if again else ():
            other, there = foot(field.edge, points, row[table.shifted(by)], CLOSE)
            nearer = np.abs(points - other) < np.abs(points - on)
            on, row = np.where(nearer, other, on), np.where(nearer, there, row)
        away = points - on
        # A foot much farther than the depth says is that of another border.
        good = np.abs(np.abs(away) - level) < 1.0
        points = np.where(good, on + level * unit(away), points)
    return np.split(points, table.first[1:])


def _slope(field: Ground, pixels: ComplexArray) -> tuple[FloatArray, ComplexArray]:
    """Depth at ``pixels`` and its gradient, unit."""
    width = field.depth.shape[1]
    at = pixels.imag.astype(np.int64) * width + pixels.real.astype(np.int64)
    flat = field.depth.ravel()
    right, down = (
        np.sum([flat[at + by + k] - flat[at - by + k] for k in (-side, 0, side)], axis=0, dtype=np.float64)
        for by, side in ((1, width), (width, 1))
    )
    return flat[at].astype(np.float64), unit(np.asarray(right + 1j * down))
