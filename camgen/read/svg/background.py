"""The background of a drawing: a rectangle as large as the page that is paper, not a contour.

The lowest shape is a background, and so is each shape that follows it, if

1. it is one rectangle, parallel to the page, that covers the page or its view box within
   `EDGE_MM`,
2. it is an area without a line,
3. it is white, or another shape that is drawn has a line,
4. another shape is drawn.
"""

from __future__ import annotations

import numpy as np

from camgen.model.part import Note
from camgen.model.pose import FloatArray
from camgen.read.svg.path import list_corners
from camgen.read.svg.tree import Drawing, DrawnShape

#: mm that a background may lack at each edge of the page: exporters round.
EDGE_MM = 0.1
_WHITE = "#ffffff"
_WHY = (
    "an area without a line that covers the page, below all other shapes; "
    "give it a stroke if it is the outline of the part"
)


def remove_background(drawing: Drawing, frames: FloatArray) -> tuple[Note, ...]:
    """Removes the background from the shapes of a drawing; a note counts it.

    frames: (F, 4, 2), mm, the corners of the page and of its view box.
    """
    shapes = drawing.shapes
    has_lines = any(shape.paint.is_stroked for shape in shapes)
    count = 0
    while count < len(shapes) - 1 and _is_background(shapes[count], has_lines, frames):
        count += 1
    if not count:
        return ()
    kinds = [shape.kind + (f" #{shape.name}" if shape.name else "") for shape in shapes[:count]]
    del shapes[:count]
    return (Note("assumed", f"a background is not used: {', '.join(kinds)}", _WHY),)


def _is_background(shape: DrawnShape, has_lines: bool, frames: FloatArray) -> bool:
    if shape.paint.is_stroked or not (has_lines or shape.paint.color == _WHITE):
        return False
    corners = list_corners(shape.subpaths)
    if corners is None or len(corners) != 4:
        return False
    corners = corners @ shape.matrix[:, :2].T + shape.matrix[:, 2]
    return any(_covers(corners, frame) for frame in frames)


def _covers(corners: FloatArray, frame: FloatArray) -> bool:
    """Whether four corners are a rectangle that is parallel to a frame and covers it."""
    axes = np.stack([frame[1] - frame[0], frame[3] - frame[0]])
    sizes = np.hypot(axes[:, 0], axes[:, 1])
    if not (sizes > 0).all():
        return False
    places = (corners - frame[0]) @ (axes / sizes[:, None]).T
    lower, upper = places.min(axis=0), places.max(axis=0)
    is_lower = np.abs(places - lower) <= EDGE_MM
    is_upper = np.abs(places - upper) <= EDGE_MM
    # Each side of a rectangle changes one coordinate.
    changes = (is_lower != np.roll(is_lower, -1, axis=0)).sum(axis=1)
    is_rectangle = (is_lower != is_upper).all() and (changes == 1).all()
    is_covered = (lower <= EDGE_MM).all() and (upper >= sizes - EDGE_MM).all()
    return bool(is_rectangle and is_covered)
