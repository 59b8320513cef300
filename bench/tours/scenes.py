"""Random paths for the search of tours, and paths as SVG for its peers.

Half of the paths are open zigzags of two to five lines, half are closed: circles of two arcs and
polygons. They are spread evenly over a square.
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from bench.support.motions import find_arc, place_motion
from camgen.model.path import ToolPath, make_waypoints

#: Side of the square for each path, and size of a path, mm.
ROOM, SIZE = 20.0, 10.0
#: Distance of chords from their arc in SVG, mm.
SAGITTA = 0.01
Point = tuple[float, float]


def draw_paths(count: int) -> list[ToolPath]:
    """The scene of a number of paths."""
    rng = random.Random(count)
    side = ROOM * math.sqrt(count)
    return [_draw_path(k, rng.uniform(0, side), rng.uniform(0, side), rng) for k in range(count)]


def _draw_path(number: int, x: float, y: float, rng: random.Random) -> ToolPath:
    """An open zigzag for odd numbers, in turns a polygon and a circle for even ones."""
    if number % 2:
        points = [(x, y)]
        for _ in range(rng.randint(2, 5)):
            x, y = x + rng.uniform(-SIZE, SIZE), y + rng.uniform(-SIZE, SIZE)
            points.append((x, y))
        return _make_path(number, points, closed=False)
    half = SIZE / 2
    if number % 4:
        points = [(x + half, y), (x - half, y), (x + half, y)]
        return _make_path(number, points, [(x, y + half), (x, y - half)])
    corners = rng.randint(3, 5)
    turn = rng.uniform(0, math.tau)
    points = []
    for k in range(corners):
        angle = turn + math.tau * k / corners
        points.append((x + half * math.cos(angle), y + half * math.sin(angle)))
    return _make_path(number, [*points, points[0]])


def _make_path(
    number: int, points: list[Point], vias: list[Point] | None = None, *, closed: bool = True
) -> ToolPath:
    """A path of lines, or of arcs through `vias`."""
    position = np.zeros((len(points), 3))
    position[:, :2] = points
    via = np.full(position.shape, np.nan)
    if vias:
        via[1:] = [(*middle, 0.0) for middle in vias]
    return ToolPath(f"c{number}", "0", make_waypoints(position, via, 1.0, force=1.0), closed)


def write_svg(paths: Iterable[ToolPath], file: Path) -> None:
    """Writes paths as polylines of an SVG, a mm as a px."""
    with file.open("w") as out:
        out.write('<svg xmlns="http://www.w3.org/2000/svg" width="9000" height="9000">')
        for path in paths:
            points = " ".join(f"{x:.4f},{y:.4f}" for x, y, _ in _flatten(path).tolist())
            out.write(f'<polyline fill="none" stroke="black" points="{points}"/>')
        out.write("</svg>")


def _flatten(path: ToolPath) -> np.ndarray:
    """Points (N, 3) of a path, its arcs as chords."""
    rows = [path.position[:1]]
    for k in range(1, len(path.position)):
        start, via, end = path.position[k - 1], path.via[k], path.position[k]
        if np.isnan(via[0]):
            rows.append(end[None])
            continue
        centre, _, angle = find_arc(start, via, end)
        radius = max(math.dist(centre, start), 1.1 * SAGITTA)
        chord = 2 * math.acos(1 - SAGITTA / radius)
        share = np.linspace(0, 1, math.ceil(angle / chord) + 1)[1:]
        rows.append(place_motion(start, via, end, share))
    return np.concatenate(rows)
