"""Single shapes as programs: what rounding, arcs and short lines do to the time of a program."""

from __future__ import annotations

import numpy as np

from camgen.model.pose import TOOL_DOWN, Pose, translation
from camgen.model.program import MoveC, MoveJ, MoveL, Program


def place(x: float, y: float) -> Pose:
    """The pose of the tool at a place of the plane, mm."""
    return Pose(TOOL_DOWN, (float(x), float(y), 0.0))


def make_program(*moves: MoveL | MoveC) -> Program:
    """A program that starts at the origin."""
    frame = translation(0, 0, 0)
    return Program("p", frame, frame, (MoveJ(place(0, 0), 100.0), *moves))


def make_polyline(points: np.ndarray, speed: float) -> Program:
    """Lines through points (N, 2), the first one the origin, with blends of 1 mm."""
    lines = [MoveL(place(x, y), speed, 1.0) for x, y in points[1:-1]]
    return make_program(*lines, MoveL(place(*points[-1]), speed))


def make_wave(count: int) -> Program:
    """A wave of `count` lines at 40 mm/s."""
    share = np.linspace(0, 1, count + 1)
    return make_polyline(np.column_stack([60 * share, 10 * np.sin(12 * share)]), 40.0)


def make_circle(radius: float) -> Program:
    """A circle of two arcs at 50 mm/s."""
    first = MoveC(place(radius, radius), place(2 * radius, 0), 50.0, 1.0)
    return make_program(first, MoveC(place(radius, -radius), place(0, 0), 50.0))


def list_shapes() -> dict[str, Program]:
    """The programs by their names. A number is a radius, mm, or a number of lines."""
    zigzag = np.array([(2 * k, 3 * (k % 2)) for k in range(40)])
    square = np.array([(0, 0), (20, 0), (20, 20), (0, 20), (0, 0)])
    return {
        "line": make_program(MoveL(place(50, 0), 20.0)),
        "square": make_polyline(square, 50.0),
        "circle-10": make_circle(10.0),
        "circle-1": make_circle(1.0),
        "zigzag": make_polyline(zigzag, 40.0),
        "wave-59": make_wave(59),
        "wave-799": make_wave(799),
    }
