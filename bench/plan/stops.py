"""Stops of a V+ robot while it draws, and the area that it covers with rounded corners.

    python -m bench.plan.stops [BOARD ...]

The boards of docs/drawing-robot.md and docs/fill.md (BOARD: board.png, copper.dxf, rendered,
gear.png), each with a stop at every corner (tolerance.corner = 0) and with the default. "As run"
are the lines of the program, with the parabola of docs/posts/vplus.md at every corner without a
stop. Exits with 1 if 5 % or more of the pen-down motions of a board stop; every stroke ends in a
stop.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator

import numpy as np

from bench.plan.boards import board, part_of
from bench.support.runner import PARTS, Cells, Missed, Scenario, run
from camgen.geometry.rings import make_rings
from camgen.pipeline import Result, build
from camgen.plan.fill.cover import measure_areas
from camgen.plan.fill.ground import find_outlines

#: Largest share of pen-down motions that stop.
MOST = 0.05
#: A stroke: its corners (N,) mm, and the distance (N,) mm over which each is rounded.
Stroke = tuple[np.ndarray, np.ndarray]
COLUMNS = (
    "board | corners | strokes | pen-down motions | stops | % {:.1f} | of them at corners "
    "| drawing, s {:.1f} | all, s {:.1f} | covered as planned, % {:.2f} | as run, % {:.2f}"
)
FILL = {"operation": {"kind": "fill"}, "cell": {"robot": "Cobra s600"}}
BOARDS = {
    "board.png": (lambda: PARTS / "board.png", FILL | {"tool": {"diameter": 0.8}}),
    "copper.dxf": (lambda: PARTS / "copper.dxf", FILL | {"tool": {"diameter": 0.85}}),
    "rendered": (lambda: part_of(board(600, 2, plane=True)), FILL | {"tool": {"diameter": 0.85}}),
    "gear.png": (
        lambda: PARTS / "gear.png",
        {"page": {"size": "A5"}, "cell": {"robot": "Cobra s600"}},
    ),
}


def list_strokes(result: Result) -> list[Stroke]:
    """The strokes of a program."""
    columns = result.program.columns
    acceleration = result.cell.pace.acceleration
    strokes = []
    for path in np.unique(columns.path[columns.works]).tolist():
        rows = np.flatnonzero(columns.works & (columns.path == path))
        points = columns.ends[np.append(rows[0] - 1, rows), :2] @ [1, 1j]
        length = np.abs(np.diff(points))
        reach = np.zeros(len(points))
        braking = columns.speed[rows[:-1]] ** 2 / (2 * acceleration)
        inner = np.minimum(braking, np.maximum(length[:-1], length[1:]) / 2)
        reach[1:-1] = np.where(columns.blend[rows[:-1]] > 0, inner, 0.0)
        strokes.append((points, reach))
    return strokes


def round_corners(points: np.ndarray, reach: np.ndarray) -> np.ndarray:
    """The corners as parabolas of eight lines, no longer than half of either neighbour."""
    drawn = [points[:1]]
    share = np.linspace(0, 1, 9)
    for k in range(1, len(points) - 1):
        sides = points[[k - 1, k + 1]] - points[k]
        start, end = points[k] + sides * np.minimum(reach[k] / np.maximum(abs(sides), 1e-9), 0.5)
        corner = 2 * share * (1 - share) * points[k]
        drawn.append((1 - share) ** 2 * start + corner + share**2 * end)
    return np.concatenate([*drawn, points[-1:]])


def measure_covered(result: Result) -> float | str:
    """Share of the copper that the strokes cover as they are run, %."""
    if result.coverage is None:
        return "-"
    radius = result.job.tool.diameter / 2
    counts, points, work_from_grid, _ = find_outlines(result.part, radius)
    places = np.column_stack([points.real, points.imag]) @ work_from_grid[:, :2].T
    border = (places + work_from_grid[:, 2]) @ [1, 1j]
    strokes = [round_corners(*stroke) for stroke in list_strokes(result)]
    for path in result.tour.paths:
        if len(path.position) == 1:
            strokes.append(path.position[:, :2] @ [1, 1j])
    areas = measure_areas(make_rings(counts), border, strokes, [], radius)
    return 100 * areas.covered / areas.copper


def measure(name: str) -> Iterator[Cells]:
    """The rows of a board, with a stop at every corner and as it is by default."""
    part, job = BOARDS[name]
    stopped = build(part(), post="vplus", job=job | {"tolerance": {"corner": 0}})
    yield measure_stops(name, "stop", stopped)
    cells = measure_stops(name, "run on", build(part(), post="vplus", job=job))
    is_missed = cells[5] >= 100 * MOST
    yield [*cells[:5], Missed(f"{cells[5]:.1f}"), *cells[6:]] if is_missed else cells


def measure_stops(name: str, corners: str, result: Result) -> list:
    """The cells of one program."""
    columns = result.program.columns
    moves, stops = int(columns.works.sum()), int((columns.works & (columns.blend == 0)).sum())
    strokes = len(np.unique(columns.path[columns.works]))
    planned: float | str = "-"
    if result.coverage is not None:
        planned = 100 * result.coverage.covered / result.coverage.copper
    counts = [strokes, moves, stops, 100 * stops / moves, stops - strokes]
    drawing = result.cycle.total - result.cycle.travel
    return [name, corners, *counts, drawing, result.cycle.total, planned, measure_covered(result)]


if __name__ == "__main__":
    names = sys.argv[1:] or list(BOARDS)
    sys.exit(run(Scenario(COLUMNS, [(name,) for name in names], measure)))
