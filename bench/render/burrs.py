"""Parts with known burrs and gouges: bumps on the straight pieces of their outlines."""

from __future__ import annotations

from dataclasses import dataclass
from operator import gt

import numpy as np

from bench.render.shapes import Loop

#: Shapes of a burr.
ROUND, POINTED = "round", "pointed"


@dataclass(frozen=True)
class Burr:
    """A burr.

    place: place of its tip, mm.
    width: width of its foot, mm.
    height: height above the material, mm, negative for a gouge.
    shape: `ROUND` or `POINTED`.
    """

    place: complex
    width: float
    height: float
    shape: str


def add_burrs(
    loops: tuple[Loop, ...],
    count: int,
    rng: np.random.Generator,
    low: float = 0.2,
    high: float = 1.0,
    widths: tuple[float, float] | None = None,
) -> tuple[tuple[Loop, ...], list[Burr]]:
    """The part with ``count`` burrs, or fewer if its straight pieces have no room.

    Burrs are ``low`` to ``high`` mm high, two to eight times as wide, and at a distance from each
    other and from corners. One in four is a gouge.

    widths: range of the widths, mm. None derives the widths from the heights. With a range, all
    burrs are bumps.
    """
    changed, burrs = list(loops), []
    for _ in range(20 * count):
        if len(burrs) == count:
            break
        height = rng.uniform(low, high) * (-1 if len(burrs) % 4 == 3 and not widths else 1)
        width = float(np.clip(abs(height) * rng.uniform(2, 8), 1.0, 8.0))
        if widths:
            width = float(rng.uniform(*widths))
        which = int(rng.integers(len(changed)))
        added = _add_burr(changed[which], width, height, str(rng.choice([ROUND, POINTED])), rng)
        if added is None:
            continue
        loop, burr = added
        limits = [max(6, (width + other.width) / 2 + 3) for other in burrs]
        distances = [abs(burr.place - other.place) for other in burrs]
        if all(map(gt, distances, limits)):
            changed[which] = loop
            burrs.append(burr)
    return tuple(changed), burrs


def _add_burr(
    loop: Loop, width: float, height: float, shape: str, rng: np.random.Generator
) -> tuple[Loop, Burr] | None:
    """A burr on a straight piece; None if no piece is long enough. Material is on the left."""
    chord = np.roll(loop.points, -1) - loop.points
    long = np.flatnonzero((loop.bulges == 0) & (np.abs(chord) > width + 4))
    if not len(long):
        return None
    k = int(rng.choice(long))
    along = chord[k] / abs(chord[k])
    foot = loop.points[k] + along * rng.uniform(2, abs(chord[k]) - width - 2)
    tip = foot + along * width / 2 - 1j * along * height
    middle = [foot, foot + along * width] if shape == ROUND else [foot, tip, foot + along * width]
    bulges = [2 * height / width, 0.0] if shape == ROUND else [0.0, 0.0, 0.0]
    points = np.concatenate([loop.points[: k + 1], middle, loop.points[k + 1 :]])
    shaped = np.concatenate([loop.bulges[: k + 1], bulges, loop.bulges[k + 1 :]])
    return Loop(points, shaped), Burr(tip, width, height, shape)
