"""Jobs with crossing contours, tabs, ramps and circles of lines are built whole, and proven."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import camgen
from camgen.model.part import Contour, Part
from tests.support.drawn import circle, contour, rectangle, rounded

#: Tools by the names that the operations use.
TOOLS: list[dict[str, Any]] = [
    {"name": "mill 6", "number": 1, "diameter": 6.0},
    {"name": "mill 3", "number": 2, "diameter": 3.0, "center_cutting": True},
    {"name": "mill 8", "number": 3, "diameter": 8.0},
    {"name": "ball 4", "number": 4, "kind": "ball mill", "diameter": 4.0},
    {"name": "drill 3", "number": 5, "kind": "drill", "diameter": 3.0},
    {"name": "V 8", "number": 6, "kind": "v", "diameter": 8.0},
]
PLATE = rectangle(0, 0, 100, 70, "plate")
#: Half of it lies beyond the right edge of the plate.
RECESS = rectangle(85, 20, 30, 20, "recess")
HOLE = circle(40, 30, 4.0, "hole")
#: Two of its corners are sharp.
TRIANGLE = contour([(10, 20), (22, 25), (10.5, 28)], name="triangle")


def make_row(kind: str, tool: str, depth: float = 2.0, **more: Any) -> dict[str, Any]:
    """A row of `[[operations]]`. A chamfer has a width in place of a depth."""
    size = {"width": 0.5} if kind == "chamfer" else {"depth": depth}
    return {"kind": kind, "tool": tool, **size, **more}


def polygon() -> Contour:
    """A circle of 8 mm about (40, 30) that is drawn with 16 lines."""
    angles = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    places = np.column_stack([40 + 4 * np.cos(angles), 30 + 4 * np.sin(angles)])
    return contour([(x, y) for x, y in places.tolist()], name="hole")


def build(
    drawn: tuple[Contour, ...], rows: list[dict[str, Any]], post: str = "gcode"
) -> camgen.Result:
    """Build the rows. It raises an error if a proof finds a difference or a gouge."""
    job = {
        "tools": TOOLS,
        "operations": rows,
        "stock": {"thickness": 6.0, "margin": 20.0, "below": 1.0, "held": "tape"},
        "process": {"spindle": 12000.0} if post == "gcode" else {},
    }
    return camgen.build(Part("part", "part.dxf", "mm", drawn, ()), post=post, job=job)


CASES = {
    "the top of a tab is as high as an earlier pass": (
        (rectangle(0, 0, 114, 80),),
        [make_row("follow", "mill 3", passes=4, entry="ramp", finish=0.5, tabs=2)],
    ),
    "the same in two passes without ramps": (
        (rectangle(0, 0, 6.5, 9.9),),
        [make_row("follow", "mill 3", passes=2, finish=0.2, tabs=2)],
    ),
    "16 lines, drilled": (
        (polygon(),),
        [make_row("pocket", "mill 3"), make_row("drill", "drill 3", 6.5)],
    ),
    "16 lines, bored": (
        (polygon(),),
        [make_row("bore", "mill 3", 6.5), make_row("chamfer", "V 8")],
    ),
    "a drawn line crosses a contour that is followed": (
        (PLATE, RECESS),
        [make_row("trace", "V 8", 0.5), make_row("follow", "mill 3", ids=["recess"])],
    ),
    "a drawn line crosses a chamfer": (
        (PLATE, RECESS),
        [make_row("trace", "mill 8", 0.5), make_row("chamfer", "V 8", ids=["plate"])],
    ),
    "a pocket alone, of two that cross": (
        (PLATE, RECESS),
        [make_row("pocket", "mill 6", 3.0), make_row("pocket", "mill 3", 1.0, ids=["recess"])],
    ),
    "a pocket beside what is left out for crossing it": (
        (PLATE, RECESS),
        [
            make_row("trace", "mill 6", 0.2),
            make_row("follow", "mill 8", 6.2),
            make_row("pocket", "mill 3", 1.0, ids=["recess"]),
        ],
    ),
    "a hole in a pocket that is left out of its own row": (
        (PLATE, circle(99, 5, 7, "across"), HOLE),
        [make_row("follow", "mill 3", 6.2), make_row("pocket", "mill 8", 1.0, ids=["plate"])],
    ),
    "holes at the edge of a pocket": (
        (PLATE, HOLE, circle(96, 30, 6, "edge")),
        [make_row("drill", "mill 8"), make_row("pocket", "mill 6", 1.0, ids=["hole", "plate"])],
    ),
    "a bore across an outline with tabs": (
        (rounded(70, 85, 8, "plate"), circle(68, 42, 4, "edge")),
        [
            make_row("pocket", "ball 4", 3.0),
            make_row("bore", "ball 4", 6.5, ids=["edge"]),
            make_row("follow", "ball 4", 6.2, ids=["plate"], tabs=2),
        ],
    ),
    "corners that overlap a little": (
        (rectangle(0, 0, 14, 26, "plate"), circle(21.7, 29.8, 9, "round")),
        [make_row("pocket", "mill 6", 1.0, ids=["round"]), make_row("chamfer", "V 8")],
    ),
    "a recess with a finished wall": (
        (PLATE, circle(0, 30, 2, "edge"), HOLE),
        [
            make_row("follow", "mill 3", 6.2, ids=["plate"]),
            make_row("pocket", "mill 3", 3.0, ids=["plate", "hole"], entry="helix", finish=0.3),
        ],
    ),
    "holes on their outside": (
        (PLATE, HOLE, rectangle(70, 20, 11, 15, "window"), TRIANGLE),
        [make_row("follow", "ball 4", 1.0, side="outside")],
    ),
    "inner contours, of which one reaches out of the plate": (
        (PLATE, circle(0.4, 0.2, 1.5, "corner"), HOLE),
        [make_row("follow", "mill 3", 5.0, nesting="inner"), make_row("trace", "mill 6", 0.5)],
    ),
    "outer contours, of which one reaches out of another": (
        (PLATE, circle(80, 65, 9, "edge")),
        [make_row("follow", "mill 8", 1.0, side="on", nesting="outer")],
    ),
    "nothing is left where a tool fits": (
        (PLATE, TRIANGLE),
        [make_row("follow", "mill 3", 5.0), make_row("follow", "mill 3", rest=True)],
    ),
    "a tool for the rest that fits nowhere": (
        (HOLE,),
        [
            make_row("pocket", "mill 6", 1.0),
            make_row("follow", "mill 8", 1.0, rest=True, side="inside", finish=0.5),
        ],
    ),
    "an open contour beside a pocket": (
        (HOLE, contour([(0, 0), (30, 0), (60, 40)], closed=False, name="open")),
        [make_row("chamfer", "V 8", ids=["hole"]), make_row("pocket", "mill 3", ids=["open"])],
    ),
}


@pytest.mark.parametrize("post", ["gcode", "vplus"])
@pytest.mark.parametrize("case", CASES)
def test_a_job_is_built_and_proven(case: str, post: str) -> None:
    result = build(*CASES[case], post)
    assert result.motion is not None
    assert result.proof is not None
    assert result.motion.findings == ()
    assert result.proof.faults == ()
