"""Pockets whose walls cross the outline of the part, against independent areas."""

from __future__ import annotations

import math
from typing import Any

import pytest
from msgspec.structs import replace

import camgen
from camgen.check.stock import Cut, StockProof, Task, design, prove
from camgen.model.job import Job, OperationTable, StockTable, ToolTable
from camgen.model.part import Contour, Part
from camgen.model.pose import TOOL_DOWN, Pose
from camgen.model.program import MoveJ, MoveL
from camgen.pipeline import Result
from tests.support.drawn import circle, rectangle

#: A plate of 100 x 60 mm with a recess of 20 x 16 mm, half of it beyond its right edge.
MILL = ToolTable(diameter=5.0)
PLATE, RECESS = rectangle(0, 0, 100, 60, "plate"), rectangle(90, 20, 20, 16, "recess")


def make_job(depth: float = 2.0, **more: Any) -> dict[str, Any]:
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


def prove_moves(
    *places: tuple[float, float, float],
    islands: tuple[Contour, ...] = (),
    followed: tuple[Contour, ...] = (),
) -> StockProof:
    """A mill of 5 mm along straight lines; the first place is above the stock."""
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
    start = MoveJ(Pose(TOOL_DOWN, places[0]), 100.0)
    body = [start, *(MoveL(Pose(TOOL_DOWN, place), 10.0) for place in places[1:])]
    stock = StockTable(thickness=6.0, margin=20.0)
    return prove([Cut(body, [*range(len(body))], MILL)], design(tasks, stock), stock=stock)


@pytest.mark.parametrize(
    ("x", "y", "z", "gouges"),
    [
        (95.0, 28.0, -2.0, False),  # in the recess, in the plate
        (107.0, 28.0, -2.0, False),  # in the recess, beside the plate
        (92.5, 22.5, -2.0, False),  # in its corner
        (95.0, 28.0, -2.5, True),  # below its floor
        (91.5, 28.0, -2.0, True),  # 1 mm into its wall
        (95.0, 34.5, -2.0, True),  # 1 mm into another wall
        (102.5, 10.0, -6.0, False),  # beside the plate
        (102.5, 28.0, -6.0, False),  # beside the plate, where the recess is
        (101.5, 28.0, -6.0, True),  # 1 mm into the edge of the plate, below the recess
    ],
)
def test_walls_of_the_recess_and_of_the_plate_are_judged(
    x: float, y: float, z: float, gouges: bool
) -> None:
    proof = prove_moves((x, y, 10.0), (x, y, z))
    assert bool(proof.gouges) == gouges
    if gouges:
        # The whole depth counts if a motion leaves the recess.
        assert proof.gouges[0].mm >= (0.49 if z == -2.5 else 0.99)


def test_a_way_out_of_the_recess_into_the_plate_is_a_gouge() -> None:
    assert not prove_moves((95, 28, 10), (95, 28, -2), (105, 28, -2)).gouges
    assert prove_moves((95, 28, 10), (95, 28, -2), (80, 28, -2)).gouges


@pytest.mark.parametrize("also_followed", [False, True])
def test_an_island_in_a_recess_stays(also_followed: bool) -> None:
    """A round island of 6 mm; if another operation works on it too, the recess is not known."""
    island = circle(98, 28, 3, "island")
    others = (island,) if also_followed else ()
    free, on_island = (106.0, 28.0), (98.0, 28.0)
    for (x, y), gouges in ((free, also_followed), (on_island, True)):
        proof = prove_moves((x, y, 10), (x, y, -2), islands=(island,), followed=others)
        assert bool(proof.gouges) == gouges


def test_contours_of_one_pocket_that_cross_are_none_of_this() -> None:
    """Two crossing walls of one operation enclose no clear area: nothing of it may be cut."""
    part = Part("part", "part.dxf", "mm", (rectangle(0, 0, 40, 40), RECESS), ())
    job = Job(operation=OperationTable(kind="pocket", depth=2.0), tool=MILL)
    crossing = Part("part", "part.dxf", "mm", (PLATE, RECESS), ())
    assert design([Task(job, crossing)], StockTable()).recesses == ()
    assert design([Task(job, part)], StockTable()).recesses == ()
