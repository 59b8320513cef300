"""Programs on which faults are seeded, each with what the drawing allows, worked out apart from the proof."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

import camgen
from bench.render.shapes import Pieces, flatten, to_loops
from bench.support.runner import PARTS
from camgen.check.stock import Cut, Design, Task, design
from camgen.model.job import Job, OperationTable, ProcessTable, StockTable, ToolTable
from camgen.model.pose import TOOL_DOWN, Pose, Vec3
from camgen.model.program import Comment, Instruction, MoveJ, MoveL, Output

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Rule:
    """So deep, mm, may be cut inside of the contours (even-odd), or outside of all of them."""

    contours: tuple[camgen.Contour, ...]
    inside: bool
    depth: float


@dataclass(frozen=True)
class Scene:
    """A job. thickness: mm. rules: what may be cut, deepest rule first where several say something. tabs: whether
    bridges were asked for. others: cuts as tools of other diameters would need them, for faults of the offset.
    """

    name: str
    cuts: tuple[Cut, ...]
    design: Design
    contours: tuple[camgen.Contour, ...]
    rules: tuple[Rule, ...]
    thickness: float
    tabs: bool = False
    others: tuple[Cut, ...] = field(default=())


def scenes() -> list[Scene]:
    """All of them."""
    return [
        _follow("plate.dxf", 3.0),
        _follow("bracket.dxf", 3.0),
        _drill(),
        _drill_and_follow(),
        _pocket(),
        _tabs(),
    ]


def _body(part: camgen.Part | Path, job: Job) -> tuple[tuple[Instruction, ...], camgen.Part]:
    result = camgen.build(
        part if isinstance(part, camgen.Part) else str(part), post="gcode", job=job
    )
    return tuple(item for item in result.program.body if not isinstance(item, Comment)), result.part


def _cut(body: Sequence[Instruction], tool: ToolTable, name: str) -> Cut:
    return Cut(body, range(1, len(body) + 1), tool, f"{name}.ngc", name)


def _job(kind: str, depth: float, diameter: float, **more: object) -> Job:
    operation = OperationTable(kind=kind, depth=depth, **more)  # type: ignore[arg-type]  # settings of the table
    tool = ToolTable(diameter=diameter, kind="drill" if kind == "drill" else "end mill")
    return Job(operation=operation, tool=tool, process=ProcessTable(spindle=9000.0))


def _follow(file: str, diameter: float) -> Scene:
    job = _job("follow", 5.0, diameter, passes=2)
    body, part = _body(PARTS / file, job)
    others = [
        _body(PARTS / file, _job("follow", 5.0, share * diameter, passes=2))[0]
        for share in (0.5, 0.98, 1.25, 2)
    ]
    closed = tuple(contour for contour in part.contours if contour.closed)
    name = file.partition(".")[0]
    stock = StockTable(thickness=5.0)
    rules = (Rule(closed, False, 5.0),)
    cut = _cut(body, job.tool, name)
    wrong = tuple(replace(cut, body=other, lines=range(1, len(other) + 1)) for other in others)
    return Scene(name, (cut,), design([Task(job, part)], stock), closed, rules, 5.0, others=wrong)


def _drill() -> Scene:
    job = _job("drill", 9.0, 3.3, passes=3, holes=[3.0, 3.5])
    body, part = _body(PARTS / "plate.dxf", job)
    holes = tuple(c for c in part.contours if c.closed and abs(_width(c) - 3.3) < 0.3)
    made = design([Task(job, part)], StockTable(thickness=9.0))
    closed = tuple(contour for contour in part.contours if contour.closed)
    return Scene(
        "drill", (_cut(body, job.tool, "drill"),), made, closed, (Rule(holes, True, 9.0),), 9.0
    )


def _width(contour: camgen.Contour) -> float:
    return float(np.ptp(outline(contour)[:, 0]))


def _drill_and_follow() -> Scene:
    """Two tools, one after the other: holes, then the outline."""
    drilling = _job("drill", 6.0, 3.3, holes=[3.0, 3.5])
    body, part = _body(PARTS / "plate.dxf", drilling)
    holes = tuple(c for c in part.contours if c.closed and abs(_width(c) - 3.3) < 0.3)
    outer = max((c for c in part.contours if c.closed), key=_width)
    cutting = _job("follow", 6.0, 6.0, passes=3)
    around, _ = _body(replace(part, contours=(outer,)), cutting)
    tasks = [
        Task(drilling, replace(part, worked=frozenset(c.id for c in holes))),
        Task(cutting, replace(part, worked=frozenset({outer.id}))),
    ]
    cuts = (_cut(body, drilling.tool, "holes"), _cut(around, cutting.tool, "outline"))
    rules = (Rule(holes, True, 6.0), Rule((outer,), False, 6.0))
    closed = tuple(contour for contour in part.contours if contour.closed)
    return Scene("two tools", cuts, design(tasks, StockTable(thickness=6.0)), closed, rules, 6.0)


def square(name: str, low: float, high: float) -> camgen.Contour:
    corners = np.array([(low, low), (high, low), (high, high), (low, high)])
    return camgen.Contour(corners, np.zeros(4), True, "0", name)


def _at(x: float, y: float, z: float) -> Pose:
    return Pose(TOOL_DOWN, (x, y, z))


def _pocket() -> Scene:
    """A square of 40 mm, 3 mm deep, in rings of 6 mm from the inside outwards, in two levels."""
    walls, plate = square("c2", 10.0, 50.0), square("c1", 0.0, 60.0)
    part = camgen.Part("pocket", "pocket.dxf", "mm", (plate, walls), (), worked=frozenset({"c2"}))
    body: list[Instruction] = []
    for depth in (1.5, 3.0):
        for half in (3.0, 7.0, 11.0, 15.0, 17.0):
            low, high = 30 - half, 30 + half
            if half == 3.0:
                body += [MoveJ(_at(low, low, 10.0), 100.0), MoveJ(_at(low, low, 2.0), 100.0)]
            body.append(MoveL(_at(low, low, -depth), 10.0))
            ring = [(high, low), (high, high), (low, high), (low, low)]
            body += [MoveL(_at(x, y, -depth), 10.0) for x, y in ring]
        body.append(MoveJ(_at(low, low, 10.0), 100.0))
    job = _job("pocket", 3.0, 6.0)
    made = design([Task(job, part)], StockTable(thickness=8.0))
    return Scene(
        "pocket",
        (_cut(body, job.tool, "pocket"),),
        made,
        (plate, walls),
        (Rule((walls,), True, 3.0),),
        8.0,
    )


def _tabs() -> Scene:
    """A square of 40 mm in two passes, the second over a bridge on each side, and the hole in it before."""
    plate = square("c1", 0.0, 40.0)
    half = np.array([(26.0, 20.0), (14.0, 20.0)])
    hole = camgen.Contour(half, np.ones(2), True, "0", "c2")
    part = camgen.Part("tabs", "tabs.dxf", "mm", (plate, hole), ())
    job = _job("follow", 4.0, 3.0, tabs=4, tab_width=5.0, tab_height=1.0)
    inner, _ = _body(replace(part, contours=(hole,)), _job("trace", 4.0, 3.0, passes=1))
    inner = tuple(_inwards(item, 4.5 / 6.0) for item in inner)
    stop = next(k for k in reversed(range(len(inner))) if isinstance(inner[k], Output))
    turning = [*inner[:stop], *inner[stop + 1 :]]
    body = [*turning, *_ring(-2.0, False), *_ring(-4.0, True), inner[stop]]
    made = design([Task(job, part)], StockTable(thickness=4.0))
    rules = (Rule((plate, hole), False, 4.0),)
    return Scene(
        "tabs", (_cut(body, job.tool, "tabs"),), made, (plate, hole), rules, 4.0, tabs=True
    )


def _inwards(item: Instruction, share: float) -> Instruction:
    """Motions about (20, 20) with their distance from there scaled."""
    return move_poses(item, lambda x, y, z: (20 + share * (x - 20), 20 + share * (y - 20), z))


def move_poses(item: Instruction, place: Callable[[float, float, float], Vec3]) -> Instruction:
    """The instruction with its target and its via point at other places."""
    changed = {}
    for name in ("target", "via"):
        pose = getattr(item, name, None)
        if isinstance(pose, Pose):
            changed[name] = replace(pose, origin=place(*pose.origin))
    return replace(item, **changed)


def _ring(z: float, bridges: bool) -> list[Instruction]:
    """Outside of the square from 0 to 40, from its lower left corner, with or without bridges of 5 mm."""
    low, high = -1.5, 41.5
    corners = [(low, low), (high, low), (high, high), (low, high), (low, low)]
    body: list[Instruction] = [MoveJ(_at(low, low, 10.0), 100.0), MoveL(_at(low, low, z), 5.0)]
    for (ax, ay), (bx, by) in pairwise(corners):
        if bridges:
            ux, uy = (bx - ax) / 43.0, (by - ay) / 43.0
            for way, height in ((17.5, z), (17.5, z + 1), (25.5, z + 1), (25.5, z)):
                body.append(MoveL(_at(ax + way * ux, ay + way * uy, height), 5.0))
        body.append(MoveL(_at(bx, by, z), 5.0))
    return [*body, MoveJ(_at(low, low, 10.0), 100.0)]


def outline(contour: camgen.Contour, step: float = 0.1) -> Array:
    """Points (N, 2) along a closed contour, from the definition of a bulge: tan of a quarter of the angle."""

    def count(whole: Pieces) -> Array:
        fewest = np.where(whole.sweep == 0, 2, 8)
        return np.maximum(np.ceil(whole.length / step), fewest)

    at = flatten(*to_loops([contour]), count)
    return np.column_stack([at.real, at.imag])
