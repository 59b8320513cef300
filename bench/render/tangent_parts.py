"""Flat parts by chance whose lines and arcs join along their tangents, with small radii.

The rule: part n is drawn by a generator that is seeded with n. Its outline is a star of 4 to 9
corners, 25 to 60 mm from the middle. It holds up to three slots or rounded blocks. Each corner is a
fillet with a radius of 0.2 to 6 mm, evenly chosen by its logarithm, cut where the sides are too
short. The tool, the tolerance of corners, the feed and the language of the program are chosen with
it. The rule is older than what it judges.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import shapely

from bench.render.shapes import Loop, flatten_arcs

DIAMETERS = (2.0, 3.0, 6.0)
TOLERANCES = (0.01, 0.02, 0.05)
FEEDS = (10.0, 40.0, 100.0)
LANGUAGES = ("rapid", "pacscript", "vplus")
#: Smallest and largest radius of a fillet, mm.
RADII = (0.2, 6.0)
#: Share of half a side that a fillet may take.
_SHARE = 0.9
#: mm between points of an arc in the polygon of a part.
_STEP = 0.01
#: mm between contours.
_APART = 7.0


class TangentPart(NamedTuple):
    """A part and how it is milled.

    contours: rows (N, 3) of each contour: x and y, mm, and bulge, the tangent of a quarter of the
        sweep.
    material: the part as a polygon.
    diameter: diameter of the mill, mm.
    tolerance: tolerance of corners, mm.
    feed: feed, mm/s.
    language: language of the program.
    """

    contours: list[np.ndarray]
    material: shapely.Geometry
    diameter: float
    tolerance: float
    feed: float
    language: str


def tangent_part(number: int) -> TangentPart:
    """The part of a number."""
    rng = np.random.default_rng([37, number])
    settings = [rng.choice(values) for values in (DIAMETERS, TOLERANCES, FEEDS)]
    outline = _fillet(rng, _star(rng, int(rng.integers(4, 10)), (25.0, 60.0)))
    contours, material = [outline], shapely.Polygon(_points(outline))
    for _ in range(rng.integers(0, 4)):
        hole = _place_hole(rng, material)
        if hole is not None:
            contours.append(hole)
            material = material.difference(shapely.Polygon(_points(hole)))
    diameter, tolerance, feed = map(float, settings)
    language = LANGUAGES[number % len(LANGUAGES)]
    return TangentPart(contours, material, diameter, tolerance, feed, language)


def _star(rng: np.random.Generator, count: int, reach: tuple[float, float]) -> np.ndarray:
    """(N,) corners about 0, counterclockwise, as complex numbers."""
    angles = (np.arange(count) + rng.uniform(-0.3, 0.3, count)) * math.tau / count
    return np.asarray(rng.uniform(*reach, count) * np.exp(1j * angles))


def _place_hole(rng: np.random.Generator, material: shapely.Geometry) -> np.ndarray | None:
    """A slot or a rounded block within the part; None if 20 tries find no room."""
    for _ in range(20):
        half = rng.uniform(4.0, 12.0) + 1j * rng.uniform(4.0, 8.0)
        block = np.array([-half, half.conjugate(), half, -half.conjugate()])
        corners = block * np.exp(1j * rng.uniform(0, math.tau))
        corners += complex(*rng.uniform(-25.0, 25.0, 2))
        hole = _fillet(rng, corners, is_slot=bool(rng.random() < 0.5))
        if material.buffer(-_APART).contains(shapely.Polygon(_points(hole))):
            return hole
    return None


def _fillet(rng: np.random.Generator, corners: np.ndarray, *, is_slot: bool = False) -> np.ndarray:
    """Rows (2 N, 3) of x, y, bulge: each corner of a polygon as an arc along both tangents.

    is_slot: all radii are nearly half the shorter side.
    """
    before, after = np.roll(corners, 1) - corners, np.roll(corners, -1) - corners
    room = _SHARE * np.minimum(abs(before), abs(after)) / 2
    turn = np.angle(-after / before)
    radius = np.exp(rng.uniform(*np.log(RADII), len(corners)))
    if is_slot:
        radius = np.full(len(corners), np.inf)
    reach = np.minimum(radius * np.tan(abs(turn) / 2), room)
    rows = []
    for k, corner in enumerate(corners):
        start = corner + reach[k] * before[k] / abs(before[k])
        end = corner + reach[k] * after[k] / abs(after[k])
        rows.append((start.real, start.imag, math.tan(turn[k] / 4)))
        rows.append((end.real, end.imag, 0.0))
    return np.array(rows)


def _points(rows: np.ndarray) -> np.ndarray:
    """(P, 2) points of a closed contour, mm. Points of arcs lie on the arcs."""
    return flatten_arcs(Loop(rows[:, :2] @ [1, 1j], rows[:, 2]), _STEP, 8)
