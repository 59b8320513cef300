"""Pockets and holes whose walls cross the outline of the part, compared with independent areas."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

import camgen
from camgen.check.stock import Cut, StockProof, Task, design, prove
from camgen.model.job import Job, OperationTable, StockTable, ToolTable
from camgen.model.part import Contour, Part
from camgen.model.pose import TOOL_DOWN, Pose, frozen
from camgen.model.program import MoveJ, MoveL
from camgen.pipeline import Result
from tests.support.drawn import circle, rectangle

MILL = ToolTable(diameter=5.0)
#: A plate of 100 x 60 mm with a recess of 20 x 16 mm, half of it beyond its right edge.
PLATE, RECESS = rectangle(0, 0, 100, 60, "plate"), rectangle(90, 20, 20, 16, "recess")
#: Circles of 8 mm: one at the right edge of the plate, one within it.
HOLES = circle(100, 30, 4), circle(30, 30, 4, "c2")


def make_job(depth: float = 2.0, **more: Any) -> dict[str, Any]:
    """A job that clears the recess and cuts out the plate; more: keys of the pocket."""
    return {
        "stock": {"thickness": 6.0, "margin": 20.0},
        "tool": {"diameter": 5.0},
        "process": {"spindle": 9000.0},
        "operations": [
            {"kind": "pocket", "ids": ["recess"], "depth": depth, "entry": "ramp", **more},
            {"kind": "follow", "ids": ["plate"], "depth": 6.3, "entry": "ramp", "tabs": 4},
        ],
    }


def build(*contours: Contour, **job: Any) -> Result:
    """Build a part of these contours."""
    part = Part("part", "part.dxf", "mm", contours, ())
    return camgen.build(part, post="gcode", job=make_job(**job))


@pytest.mark.parametrize("recess", [RECESS, circle(100, 30, 9, "recess")], ids=["square", "round"])
def test_a_recess_at_the_edge_is_cut_and_proven(recess: Contour) -> None:
    result = build(PLATE, recess)
    proof = result.proof
    assert proof is not None
    assert (proof.faults, proof.refused) == ((), ())
    assert result.motion is not None
    assert (result.motion.findings, result.motion.unproven) == ((), ())
    # 1 mm below the top face the recess and the kerf around the plate are gone.
    (level,) = [level for level in proof.levels if level.top > -1.0 > level.bottom]
    assert level.excess.unexplained.area == 0
    corners = (4 - math.pi) * 2.5**2 if recess is RECESS else 0.0
    assert level.excess.corners == pytest.approx(corners, abs=0.2)


@pytest.mark.parametrize(
    ("operation", "tool"),
    [("drill", {"kind": "drill", "diameter": 8.0}), ("bore", {"diameter": 5.0})],
)
def test_a_hole_at_the_edge_is_cut_and_proven(operation: str, tool: dict[str, Any]) -> None:
    """Half of the circle is beyond the edge. Another one is within the plate."""
    drawn = Part("part", "part.dxf", "mm", (PLATE, *HOLES), ())
    step = {"kind": operation, "ids": ["c1", "c2"], "depth": 4.0}
    job = {"tool": tool, "process": {"spindle": 9000.0}, "operations": [step]}
    proof = camgen.build(drawn, post="gcode", job=job).proof
    assert proof is not None
    assert (proof.faults, proof.refused) == ((), ())
    (level,) = [level for level in proof.levels if level.top > -1.0 > level.bottom]
    assert level.excess.unexplained.area == 0


@pytest.mark.parametrize("x", [100.0, 30.0])
@pytest.mark.parametrize(
    ("drawn", "tool", "gouge"),
    [
        (8.0, ToolTable(kind="drill", diameter=8.0), 0.0),
        (8.0, ToolTable(kind="drill", diameter=8.4), 0.2),
        (8.0, ToolTable(kind="v", diameter=12.0), 0.0),  # 8 mm wide at the top face
        (8.0, ToolTable(kind="v", diameter=12.0, tip_diameter=1.0), 0.5),
    ],
)
def test_a_hole_wider_than_its_circle_is_a_gouge(
    x: float, drawn: float, tool: ToolTable, gouge: float
) -> None:
    part = Part("part", "part.dxf", "mm", (PLATE, *HOLES), (), worked=frozenset({"c1", "c2"}))
    job = Job(operation=OperationTable(kind="drill", depth=drawn / 2), tool=tool)
    proof = prove_lines([Task(job, part)], tool, (x, 30, 10), (x, 30, -drawn / 2))
    if x == 100 and gouge:
        gouge = drawn / 2  # the whole depth counts if a motion leaves the recess
    assert [round(bite.mm, 2) for bite in proof.gouges] == [gouge] * (gouge > 0)


def test_a_circle_smaller_than_the_drill_is_not_missed() -> None:
    """A note leaves it out. The other circle is drilled."""
    drawn = Part("part", "part.dxf", "mm", (PLATE, circle(30, 30, 2), circle(60, 30, 4, "c2")), ())
    job = {
        "tool": {"kind": "drill", "diameter": 8.0},
        "process": {"spindle": 3000.0},
        "operations": [{"kind": "drill", "ids": ["c1", "c2"], "depth": 4.0}],
    }
    result = camgen.build(drawn, post="gcode", job=job)
    assert [note.ids for note in result.notes if note.kind == "skipped"] == [("c1",)]
    assert result.proof is not None
    (level,) = [level for level in result.proof.levels if level.top > -1.0 > level.bottom]
    assert level.excess.unexplained.area == 0


@pytest.mark.parametrize("corners", [20, 32])
def test_a_circle_of_lines_is_drilled_up_to_its_corners(corners: int) -> None:
    """Between its corners the sides are nearer to the middle by 0.03 and 0.01 mm."""
    angles = np.linspace(0, 2 * np.pi, corners, endpoint=False)
    ring = frozen(np.column_stack([20 + 2.5 * np.cos(angles), 30 + 2.5 * np.sin(angles)]))
    hole = Contour(ring, frozen(np.zeros(corners)), True, "0", "hole")
    part = Part("part", "part.dxf", "mm", (PLATE, hole), ())
    job = {
        "stock": {"thickness": 6.0},
        "tool": {"kind": "drill", "diameter": 5.0},
        "process": {"spindle": 3000.0},
        "operations": [{"kind": "drill", "ids": ["hole"], "depth": 4.0}],
    }
    proof = camgen.build(part, post="gcode", job=job).proof
    assert proof is not None
    assert (proof.faults, proof.refused) == ((), ())


def prove_motions(
    *positions: tuple[float, float, float],
    islands: tuple[Contour, ...] = (),
    followed: tuple[Contour, ...] = (),
) -> StockProof:
    """Prove lines of a mill of 5 mm; the first position is above the stock."""
    part = Part("part", "part.dxf", "mm", (PLATE, RECESS, *islands), ())
    recess = frozenset({"recess", *(island.id for island in islands)})
    bounds = frozenset({"plate", *(contour.id for contour in followed)})
    pocket = OperationTable(kind="pocket", depth=2.0)
    follow = OperationTable(kind="follow", depth=6.3)
    jobs = [Job(operation=operation, tool=MILL) for operation in (pocket, follow)]
    tasks = [
        Task(jobs[0], replace(part, worked=recess)),
        Task(jobs[1], replace(part, worked=bounds), bounds),
    ]
    return prove_lines(tasks, MILL, *positions)


def prove_lines(
    tasks: list[Task], tool: ToolTable, *positions: tuple[float, float, float]
) -> StockProof:
    """Prove lines between the positions; the first one is above the stock."""
    start = MoveJ(Pose(TOOL_DOWN, positions[0]), 100.0)
    body = [start, *(MoveL(Pose(TOOL_DOWN, position), 10.0) for position in positions[1:])]
    stock = StockTable(thickness=6.0, margin=20.0)
    return prove([Cut(body, [*range(len(body))], tool)], design(tasks, stock), stock=stock)


@pytest.mark.parametrize(
    ("x", "y", "z", "gouges"),
    [
        (95.0, 28.0, -2.0, False),  # in the recess, in the plate
        (107.0, 28.0, -2.0, False),  # in the recess, outside the plate
        (92.5, 22.5, -2.0, False),  # in a corner of the recess
        (95.0, 28.0, -2.5, True),  # below the floor of the recess
        (91.5, 28.0, -2.0, True),  # 1 mm into a wall of the recess
        (95.0, 34.5, -2.0, True),  # 1 mm into another wall
        (102.5, 10.0, -6.0, False),  # outside the plate
        (102.5, 28.0, -6.0, False),  # outside the plate, where the recess is
        (101.5, 28.0, -6.0, True),  # 1 mm into the edge of the plate, below the recess
    ],
)
def test_cuts_into_walls_of_the_recess_and_of_the_plate_are_gouges(
    x: float, y: float, z: float, gouges: bool
) -> None:
    proof = prove_motions((x, y, 10.0), (x, y, z))
    assert bool(proof.gouges) == gouges
    if gouges:
        # The whole depth counts if a motion leaves the recess.
        assert proof.gouges[0].mm >= (0.49 if z == -2.5 else 0.99)


def test_a_motion_out_of_the_recess_into_the_plate_is_a_gouge() -> None:
    assert not prove_motions((95, 28, 10), (95, 28, -2), (105, 28, -2)).gouges
    assert prove_motions((95, 28, 10), (95, 28, -2), (80, 28, -2)).gouges


@pytest.mark.parametrize(
    ("middle", "also_followed", "gouges"),
    [(94.0, False, True), (94.0, True, False), (98.0, False, True), (98.0, True, True)],
)
def test_a_cut_into_an_island_of_a_recess_is_a_gouge(
    middle: float, also_followed: bool, gouges: bool
) -> None:
    """The island has a diameter of 6 mm. It is a hole of the plate if it is followed, too.

    At 98 mm it crosses the edge of the plate, so that no path follows it.
    """
    island = circle(middle, 28, 3, "island")
    others = (island,) if also_followed else ()
    free, on_island = (97.4, 22.5), (middle, 28.0)
    for (x, y), is_gouge in ((free, False), (on_island, gouges)):
        proof = prove_motions((x, y, 10), (x, y, -2), islands=(island,), followed=others)
        assert bool(proof.gouges) == is_gouge


@pytest.mark.parametrize(
    ("x", "gouge"),
    [
        (57.5, 0.0),  # beside the hole
        (57.4, 2.0),  # into the disc that stays
        (57.6, 2.0),  # farther out in the plate
        (50.0, 2.0),  # in the middle of the disc
        (102.5, 0.0),  # beside the plate
        (101.5, 1.0),  # into its edge
    ],
)
def test_a_hole_that_is_followed_on_its_outside_has_a_kerf_only(x: float, gouge: float) -> None:
    part = Part("part", "part.dxf", "mm", (PLATE, circle(50, 30, 5)), ())
    job = Job(operation=OperationTable(kind="follow", side="outside", depth=2.0), tool=MILL)
    proof = prove_lines([Task(job, part)], MILL, (x, 30, 10), (x, 30, -2))
    assert [round(bite.mm, 2) for bite in proof.gouges] == [gouge] * (gouge > 0)


def test_a_drawn_line_across_a_part_does_not_open_it_for_cuts() -> None:
    """The line is traced 0.5 mm deep. The part is followed on its outside."""
    line = rectangle(90, 10, 30, 10, "line")
    part = Part("part", "part.dxf", "mm", (PLATE, line), ())
    trace = OperationTable(kind="trace", depth=0.5)
    follow = OperationTable(kind="follow", depth=6.3)
    on_line, on_plate = (replace(part, worked=frozenset({name})) for name in ("line", "plate"))
    tasks = [
        Task(Job(operation=trace, tool=MILL), on_line, frozenset({"line"})),
        Task(Job(operation=follow, tool=MILL), on_plate, frozenset({"plate"})),
    ]
    for x, y, z, gouges in ((102.5, 40, -6, False), (95, 15, -1, True), (95, 20, -0.5, False)):
        assert bool(prove_lines(tasks, MILL, (x, y, 10), (x, y, z)).gouges) == gouges


def test_crossing_contours_of_one_pocket_are_not_a_recess() -> None:
    """Two crossing walls of one operation enclose no defined area, so none may be cut."""
    part = Part("part", "part.dxf", "mm", (rectangle(0, 0, 40, 40), RECESS), ())
    job = Job(operation=OperationTable(kind="pocket", depth=2.0), tool=MILL)
    crossing = Part("part", "part.dxf", "mm", (PLATE, RECESS), ())
    assert design([Task(job, crossing)], StockTable()).recesses == []
    assert design([Task(job, part)], StockTable()).recesses == []
