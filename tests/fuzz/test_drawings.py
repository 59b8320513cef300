"""Drawings of shapes that touch, overlap and lie in each other are built, or refused with a reason.

No contour of them ends with a fault of camgen itself, for which a user is asked to report it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import chain
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

import camgen
from camgen.model.errors import NoSafeProgram
from camgen.model.pose import FloatArray
from tests.support.examples import fewer, is_night

PLACES = st.sampled_from([0.0, 0.5, 2.0, 10.0, 12.0, 20.0, 25.0, 30.0])
SIZES = st.sampled_from([1.0, 2.0, 4.0, 5.0, 8.0, 10.0, 16.0])
LENGTHS = st.sampled_from([0.0, 0.5, 2.0])


Shape = tuple[FloatArray, list[float]]


@st.composite
def tiles(draw: st.DrawFn) -> list[Shape]:
    """The outlines and holes of squares of 10 mm that touch each other."""
    cells = draw(st.sets(st.tuples(st.integers(0, 3), st.integers(0, 3)), min_size=1, max_size=6))
    place = np.array([draw(PLACES), draw(PLACES)])
    squares = [shapely.box(10 * i, 10 * j, 10 * i + 10, 10 * j + 10) for i, j in sorted(cells)]
    shapes: list[Shape] = []
    for piece in shapely.get_parts(shapely.union_all(squares)):
        for ring in (piece.exterior, *piece.interiors):
            corners = place + np.array(ring.coords)[:-1]
            shapes.append((corners, [0.0] * len(corners)))
    return shapes


@st.composite
def figures(draw: st.DrawFn) -> list[Shape]:
    """A circle, a ring, a rectangle, a slot or a polygon."""
    place = np.array([draw(PLACES), draw(PLACES)])
    size, length = draw(SIZES), draw(SIZES)
    box = np.array([[0, 0], [length, 0], [length, size], [0, size]])
    ends = np.array([[size, 0], [-size, 0]])
    inner = draw(st.sampled_from([0.5, 0.8, 1.0]))
    angles = draw(st.floats(0, 1)) + np.linspace(0, 2 * math.pi, draw(st.integers(4, 9)))[:-1]
    corners = size * np.column_stack([np.cos(angles), np.sin(angles)])
    kinds: dict[str, list[Shape]] = {
        "circle": [(place + ends, [1.0, 1.0])],
        "ring": [(place + ends, [1.0, 1.0]), (place + inner * ends, [1.0, 1.0])],
        "rectangle": [(place + box, [0.0] * 4)],
        "slot": [(place + box, [0.0, 1.0, 0.0, 1.0])],
        "polygon": [(place + corners, [0.0] * len(corners))],
    }
    return kinds[draw(st.sampled_from(sorted(kinds)))]


def format_svg(shapes: Iterable[Shape]) -> str:
    """The drawing as SVG, 1 mm a unit. A bulge of 1 is half of a circle."""
    lines = ['<svg xmlns="http://www.w3.org/2000/svg" width="90mm" height="90mm"']
    lines.append('viewBox="-20 -20 90 90"><g fill="none" stroke="black">')
    for points, bulges in shapes:
        path = "M {:.6f} {:.6f}".format(*points[0])
        for start, end, bulge in zip(points, np.roll(points, -1, axis=0), bulges, strict=True):
            radius = math.dist(start, end) / 2
            to = f"A {radius:.6f} {radius:.6f} 0 0 1" if bulge else "L"
            path += " {} {:.6f} {:.6f}".format(to, *end)
        lines.append(f'<path d="{path} Z"/>')
    return "\n".join([*lines, "</g></svg>"])


@st.composite
def jobs(draw: st.DrawFn) -> tuple[str, dict[str, Any]]:
    """A post, and a job that follows or clears the contours."""
    kind = draw(st.sampled_from(["follow", "follow", "pocket"]))
    post = draw(st.sampled_from(["gcode", "rapid", "pacscript", "vplus"]))
    operation: dict[str, Any] = {"kind": kind, "finish": draw(st.sampled_from([0.0, 0.1, 0.2]))}
    if kind == "follow":
        operation |= {key: draw(LENGTHS) for key in ("lead_in", "lead_out", "overlap")}
        operation["corner_radius"] = draw(LENGTHS)
    else:
        post = "gcode"
    process: dict[str, Any] = {}
    if post == "gcode":
        process["spindle"] = 12000.0
        operation |= {"depth": 2.0, "passes": draw(st.integers(1, 3))}
        operation["entry"] = draw(st.sampled_from(["plunge", "ramp", "helix"]))
    tool = {"diameter": draw(st.sampled_from([0.5, 1.0, 2.0, 3.0, 6.0]))}
    return post, {"tool": tool, "operation": operation, "process": process}


# The examples are the same in each run by day.
@settings(
    fewer(12),
    derandomize=not is_night(),
    database=None,
    phases=(Phase.explicit, Phase.generate),
)
@given(st.lists(st.one_of(tiles(), figures()), min_size=2, max_size=7), jobs())
def test_a_drawing_is_built_or_refused_with_a_reason(
    tmp_path_factory: pytest.TempPathFactory,
    groups: list[list[Shape]],
    job: tuple[str, dict[str, Any]],
) -> None:
    file = tmp_path_factory.getbasetemp() / "drawing.svg"
    file.write_text(format_svg(chain.from_iterable(groups)))
    post, tables = job
    try:
        result = camgen.build(file, post=post, job=tables)
        reasons = [note.why for note in result.notes]
    except NoSafeProgram as error:
        reasons = [str(error)]
    faults = [text for text in reasons if "please report" in text or "must stay" in text]
    assert faults == []
