"""Flat parts by chance, as contours of lines and arcs: the same part for the same number.

Outlines are stars, polygons with arcs of every size, and blocks with a notch; holes hold islands.
Many have features that are hard for an offset: a cusp where an arc returns along the segment before
it, a notch or a hole that the tool just fits or just does not, a neighbour at about the width of
the tool. Contours are flattened here, by formulas that are not camgen's.
"""

from __future__ import annotations

import math
from functools import partial
from typing import NamedTuple

import numpy as np
import shapely
from shapely import affinity

from bench.render.shapes import Loop, Pieces, area, flatten

#: Sagitta of flattened arcs, mm.
CHORD = 2e-4
DIAMETERS = (0.5, 1.0, 2.0, 3.0, 6.0, 10.0)
#: Area, mm2, by which a contour may overlap itself: slips of a drawing at a cusp, no crossing.
_SLIP = 0.01
#: Differences between the width of a hole and that of its tool, mm.
_ROOMS = (-0.05, -0.002, 0.005, 0.01, 0.03, 0.08, 0.15, 0.5)
#: Differences between the turn of a cusp and half a turn, deg.
_CUSPS = (0.0, 0.0, 0.01, -0.01, 0.2, -0.2, 0.8, -0.8, 2.0, -2.0)


class Shape(NamedTuple):
    """A closed contour.

    rows: (N, 3) x and y, mm, and bulge, the tangent of a quarter of the sweep.
    polygon: its area.
    """

    rows: np.ndarray
    polygon: shapely.Geometry


class RandomPart(NamedTuple):
    """A part.

    shapes: contours that do not cross each other.
    diameter: diameter of the tool, mm.
    """

    shapes: list[Shape]
    diameter: float


def random_part(number: int) -> RandomPart:
    """The part of that number."""
    rng = np.random.default_rng([15, number])
    diameter = float(rng.choice(DIAMETERS))
    outline = _try(rng, lambda: _outline(rng, diameter))
    assert outline is not None
    shapes = [outline]
    for _ in range(rng.integers(0, 5)):
        holes = shapely.union_all([shape.polygon for shape in shapes[1:]])
        inside = shapely.difference(outline.polygon, holes)
        hole = _try(rng, lambda room=inside: _place(rng, room, _hole(rng, diameter)))
        if hole is not None:
            shapes.append(hole)
    for hole in shapes[1:]:
        if rng.random() < 0.4:
            room = hole.polygon
            make = partial(_draw_island, rng, room)
            shapes += filter(None, [_try(rng, make, 8)])
    if rng.random() < 0.25:
        shapes += filter(None, [_try(rng, lambda: _neighbour(rng, outline, diameter), 8)])
    order = rng.permutation(len(shapes))
    return RandomPart([shapes[k] for k in order], diameter)


def _try(rng: np.random.Generator, make: object, times: int = 200) -> Shape | None:
    """The first sound shape that ``make`` gives, in a direction by chance; None without one."""
    for _ in range(times):
        rows = make()  # type: ignore[operator]
        polygon = None if rows is None else _polygon(rows)
        if polygon is not None:
            return Shape(_reversed(rows) if rng.random() < 0.5 else rows, polygon)
    return None


def _polygon(rows: np.ndarray) -> shapely.Geometry | None:
    """The area within a contour; None if it crosses itself by more than a slip."""
    points = flat(rows)
    if len(points) < 3:
        return None
    ring = shapely.Polygon(points)
    drawn = abs(area([Loop(points @ [1, 1j], np.zeros(len(points)))]))
    if ring.is_valid:
        return ring if ring.area > 1e-3 else None
    # The even-odd area: the tip beyond a slip belongs to the part, as the rest of a spike does.
    valid = shapely.union_all([p for p in shapely.get_parts(shapely.make_valid(ring)) if p.area])
    largest = max((p.area for p in shapely.get_parts(valid)), default=0.0)
    is_slip = largest > 1.0 and abs(valid.area - drawn) < _SLIP and valid.area - largest < _SLIP
    return valid if is_slip else None


def flat(rows: np.ndarray) -> np.ndarray:
    """Points (M, 2) along a contour, arcs within CHORD of it."""

    def count(whole: Pieces) -> np.ndarray:
        is_arc = (whole.sweep != 0) & (whole.chord != 0)
        turn = np.where(is_arc, np.abs(whole.sweep), 1.0)
        radius = np.where(is_arc, whole.length, 1.0) / turn
        chord_turn = 2 * np.arccos(np.maximum(1 - CHORD / radius, 0.0))
        return np.where(is_arc, np.maximum(np.ceil(turn / chord_turn), 4), 1)

    return flatten(Loop(rows[:, :2] @ [1, 1j], rows[:, 2]), count)


def _reversed(rows: np.ndarray) -> np.ndarray:
    return np.column_stack([rows[::-1, :2], -np.roll(rows[::-1, 2], -1)])


def _outline(rng: np.random.Generator, diameter: float) -> np.ndarray:
    kind = rng.random()
    if kind < 0.3:
        rows = _star(rng, rng.uniform(15, 60), 1)
    elif kind < 0.7:
        rows = _scattered(rng)
    else:
        rows = _neck(rng, diameter)
    return _with_cusp(rng, rows) if rng.random() < 0.5 else rows


def _star(rng: np.random.Generator, size: float, digits: int) -> np.ndarray:
    """Corners in order about a centre, some of them with arcs between."""
    count = rng.integers(3, 12)
    angle = np.sort(rng.uniform(0, 2 * np.pi, count))
    radius = size * rng.uniform(0.35, 1.0, count)
    bulge = np.where(rng.random(count) < 0.5, 0.0, rng.uniform(-0.7, 0.7, count))
    x, y = (radius * np.cos(angle)).round(digits), (radius * np.sin(angle)).round(digits)
    return np.column_stack([x, y, bulge.round(2)])


def _scattered(rng: np.random.Generator) -> np.ndarray:
    """A few points anywhere, in order about their middle. They may still cross."""
    count = rng.integers(3, 7)
    points = rng.uniform(-50, 50, (count, 2)).round(1)
    middle = points - points.mean(axis=0)
    points = points[np.argsort(np.arctan2(middle[:, 1], middle[:, 0]))]
    bulge = np.where(rng.random(count) < 0.5, 0.0, rng.uniform(-0.95, 0.95, count))
    return np.column_stack([points, bulge.round(2)])


def _neck(rng: np.random.Generator, diameter: float) -> np.ndarray:
    """A block with a notch that is about as wide as the tool."""
    width = diameter + float(rng.choice(_ROOMS)) * rng.choice([1.0, 3.0])
    depth, w, h = rng.uniform(2, 25), rng.uniform(8, 30), rng.uniform(27, 40)
    mouth = float(rng.choice([0.0, 0.0, 1.0, -0.3, 0.5]))
    x = [-w, width + w, width + w, width, width, 0, 0, -w]
    y = [0, 0, h, h, h - depth, h - depth, h, h]
    bulge = [0, rng.choice([0, 0.3, -0.2]), 0, 0, mouth if depth > width else 0, 0, 0, 0]
    return np.column_stack([x, y, bulge])


def _with_cusp(rng: np.random.Generator, rows: np.ndarray) -> np.ndarray:
    """An arc that returns nearly along the segment before it."""
    k = int(rng.integers(len(rows)))
    rows = np.roll(rows, -k, axis=0)
    before = rows[1, :2] - rows[0, :2]
    arrives = math.atan2(before[1], before[0]) + 2 * math.atan(rows[0, 2])
    after = rows[2 % len(rows), :2] - rows[1, :2]
    leaves = arrives + math.pi + math.radians(float(rng.choice(_CUSPS)))
    half = math.remainder(math.atan2(after[1], after[0]) - leaves, 2 * math.pi)
    if abs(half) < 1.5:
        rows[1, 2] = math.tan(half / 2)
    return rows


def _hole(rng: np.random.Generator, diameter: float) -> np.ndarray:
    """A circle, a slot or a rectangle of about the tool's width, or a star."""
    wide = max(diameter + float(rng.choice(_ROOMS)) * rng.choice([1.0, 1.0, 20.0]), 0.2) / 2
    kind, long = rng.random(), rng.uniform(0, 8)
    if kind < 0.25:
        return np.array([[wide, 0, 1.0], [-wide, 0, 1.0]])
    y = [-wide, -wide, wide, wide]
    if kind < 0.45:
        return np.column_stack([[-long, long, long, -long], y, [0.0, 1.0, 0.0, 1.0]])
    if kind < 0.6:
        half = long + wide
        return np.column_stack([[-half, half, half, -half], y, np.zeros(4)])
    star = _star(rng, wide * rng.uniform(1.5, 6), 2)
    return _with_cusp(rng, star) if rng.random() < 0.4 else star


def _draw_island(rng: np.random.Generator, room: shapely.Geometry) -> np.ndarray | None:
    return _place(rng, room, _star(rng, rng.uniform(0.3, 8), 2))


def _place(rng: np.random.Generator, room: shapely.Geometry, rows: np.ndarray) -> np.ndarray | None:
    """A contour turned and moved into a room; None if it does not fit there.

    Walls are 0.05 mm wide or more.
    """
    if room.is_empty:
        return None
    x0, y0, x1, y1 = room.bounds
    angle, shift = rng.uniform(0, 2 * np.pi), (rng.uniform(x0, x1), rng.uniform(y0, y1))
    c, s = math.cos(angle), math.sin(angle)
    points = (rows[:, :2] @ np.array([[c, s], [-s, c]]) + shift).round(3)
    placed = np.column_stack([points, rows[:, 2]])
    polygon = _polygon(placed)
    if polygon is None or not room.contains(polygon):
        return None
    return placed if room.boundary.distance(polygon) > rng.choice([0.05, 1.0]) else None


def _neighbour(rng: np.random.Generator, outline: Shape, diameter: float) -> np.ndarray | None:
    """A star to the right of the outline, at about the width of the tool."""
    rows = _star(rng, rng.uniform(5, 25), 3)
    polygon = _polygon(rows)
    if polygon is None:
        return None
    far = outline.polygon.bounds[2] - polygon.bounds[0] + 1.0
    gap = diameter + float(rng.choice([-0.3, 0.0, 0.02, 0.1, 1.0]))
    for _ in range(30):
        error = affinity.translate(polygon, far, 0.0).distance(outline.polygon) - gap
        if abs(error) < 0.005 or abs(far) > 1000:
            break
        far -= error
    # The star may pass above or below the outline.
    if abs(error) > 0.005:
        return None
    rows[:, 0] = (rows[:, 0] + far).round(3)
    clear = _polygon(rows)
    return rows if clear is not None and clear.distance(outline.polygon) > 0.05 else None
