"""Flat parts of about 3 x 2.5 in to be rendered: four by name, and as many as wanted at random.

A part is a tuple of loops, the outer one first, its middle near the origin; mm.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bench.render.shapes import Loop, circle, hole, rounded, slot

Part = tuple[Loop, ...]
_INCH = 25.4


def paper() -> Part:
    """A part as in the paper's case study, 3 x 2.5 in.

    It has outer arcs of 1/2 in, a notch with inner arcs of 1/4 in, and sharp corners. The paper
    gives no drawing; sizes follow the lengths in its figure 13.
    """
    quarter = 0.25
    inches = [
        (0, 0, 0), (0.75, 0, 0), (0.75, 0.75, quarter), (2.25, 0.75, quarter), (2.25, 0, 0),
        (3, 0, 0), (3, 1.5, 0), (2.5, 1.5, 0), (2.5, 2.5, 0.5), (0.5, 2.5, 0.5), (0.5, 1.5, 0),
        (0, 1.5, 0),
    ]  # fmt: skip
    return (rounded([((x - 1.5) * _INCH, (y - 1.25) * _INCH, r * _INCH) for x, y, r in inches]),)


def plate() -> Part:
    """A plate with a slot, two round holes and a square one with round corners."""
    outer = rounded([(-38, -32, 6), (38, -32, 0), (38, 32, 10), (-30, 32, 0), (-38, 24, 0)])
    window = rounded([(8, 4, 4), (26, 4, 4), (26, 22, 4), (8, 22, 4)])
    inner = (slot(-14, 14, 30, 11, 30), circle(-22, -16, 8), circle(18, -15, 10), window)
    return (outer, *map(hole, inner))


def gear() -> Part:
    """Ten teeth on a circle of 38 mm; the gaps are U-shaped, 9 mm wide; a bore of 20 mm."""
    teeth, tip, bottom, half = 10, 38.0, 27.0, 4.5
    out = np.sqrt(tip**2 - half**2)
    points, bulges = [], []
    for k in range(teeth):
        # In, round the bottom clockwise, out, then along the tip circle to the next gap.
        gap = np.array([out - 1j * half, bottom - 1j * half, bottom + 1j * half, out + 1j * half])
        points += (gap * np.exp(2j * np.pi * k / teeth)).tolist()
        tooth = 2 * np.pi / teeth - 2 * np.arcsin(half / tip)
        bulges += [0.0, -1.0, 0.0, float(np.tan(tooth / 4))]
    return (Loop(np.array(points), np.array(bulges)), hole(circle(0, 0, 10)))


def bracket() -> Part:
    """An angle bracket with a round inner corner, a chamfer, a V-notch and three holes."""
    outer = rounded(
        [
            (-38, -31, 8), (38, -31, 12), (38, -7, 12), (20, -7, 0), (14, -15, 0), (8, -7, 0),
            (-12, -7, 7), (-12, 32, 5), (-28, 32, 0), (-38, 22, 0),
        ]
    )  # fmt: skip
    return (
        outer,
        hole(circle(26, -19, 5.5)),
        hole(slot(-8, -19, 20, 8, 0)),
        hole(circle(-25, 16, 6)),
    )


NAMED: dict[str, Callable[[], Part]] = {
    "paper": paper,
    "plate": plate,
    "gear": gear,
    "bracket": bracket,
}


def random_part(seed: int) -> Part:
    """A plate of 66 to 86 x 54 to 72 mm.

    Its corners are sharp, round or cut. It has a notch, a slot and two holes.
    """
    rng = np.random.default_rng(seed)
    w, h = rng.uniform(66, 86) / 2, rng.uniform(54, 72) / 2
    corners: list[tuple[float, float, float]] = []
    for x, y in ((-w, -h), (w, -h), (w, h), (-w, h)):
        corners += _corner(x, y, rng)
        if (x, y) == (w, h):
            corners += _notch(h, rng)
    x, y, length, width, angle = rng.uniform((-3, 11, 24, 8, -12), (3, 13, 32, 10, 12))
    right, up, radius = rng.uniform((14, 6, 4.5), (15, 9, 8))
    holes = [slot(x, y - h, length, width, angle), circle(w - right, up, radius)]
    holes.append(_window(-w + rng.uniform(14, 15), rng.uniform(5, 8), rng))
    return (rounded(corners), *map(hole, holes))


def _corner(x: float, y: float, rng: np.random.Generator) -> list[tuple[float, float, float]]:
    kind, size = rng.integers(3), rng.uniform(3, 11)
    if kind < 2:
        return [(x, y, size * kind)]
    along_x, along_y = (x - np.sign(x) * size, y, 0.0), (x, y - np.sign(y) * size, 0.0)
    return [along_x, along_y] if x * y < 0 else [along_y, along_x]


def _notch(h: float, rng: np.random.Generator) -> list[tuple[float, float, float]]:
    """A notch in the upper side, from right to left: wide at its mouth, with a round bottom."""
    middle, mouth, bottom, deep = rng.uniform((-5, 8, 5, 7.5), (5, 11, 8, 9))
    mouth_radius, radius = rng.choice([0.0, 2.5]), rng.uniform(3.4, 4.5)
    return [
        (middle + mouth, h, mouth_radius),
        (middle + bottom, h - deep, radius),
        (middle - bottom, h - deep, radius),
        (middle - mouth, h, mouth_radius),
    ]


def _window(x: float, y: float, rng: np.random.Generator) -> Loop:
    """A hole: round, or square with sharp or round corners."""
    half, kind = rng.uniform(4.5, 5.5), rng.integers(3)
    if kind == 0:
        return circle(x, y, half)
    radius = rng.uniform(3.3, 4.2) if kind == 1 else 0.0
    square = rounded(
        [(sx * half, sy * half, radius) for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    )
    return square.moved(rng.uniform(0, 1.5), complex(x, y))
