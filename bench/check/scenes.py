"""Programs on which faults are seeded, with what their drawings allow, without the proof."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from itertools import pairwise

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
Body = Sequence[Instruction]


@dataclass(frozen=True)
class Rule:
    """A depth to which the tool may cut.

    contours: its borders.
    inside: whether it holds within the contours (even-odd), or outside of all of them.
    depth: mm.
    """

    contours: tuple[camgen.Contour, ...]
    inside: bool
    depth: float


@dataclass(frozen=True)
class Scene:
    """A job.

    cuts: its programs.
    contours: all closed contours of its part.
    rules: the allowed depths. The deepest one counts where several hold.
    thickness: thickness of the stock, mm.
    tabs: whether tabs were asked for.
    others: make the cuts of tools with other diameters, for faults of the offset.
    """

    name: str
    cuts: tuple[Cut, ...]
    design: Design
    contours: tuple[camgen.Contour, ...]
    rules: tuple[Rule, ...]
    thickness: float
    tabs: bool = False
    others: tuple[Callable[[], Cut], ...] = field(default=())


def make_scenes() -> list[Scene]:
    """All scenes."""
    return [
        _make_follow("plate.dxf", 3.0),
        _make_follow("bracket.dxf", 3.0),
        _make_drill(),
        _make_drill_and_follow(),
        _make_pocket(),
        _make_tabs(),
    ]


def _build(part: camgen.Part | str, job: Job) -> tuple[tuple[Instruction, ...], camgen.Part]:
    """The instructions of a part or of a file of the fixtures, and the part."""
    source = PARTS / part if isinstance(part, str) else part
    result = camgen.build(source, post="gcode", job=job)
    return tuple(item for item in result.program.body if not isinstance(item, Comment)), result.part


def make_cut(body: Body, tool: ToolTable, name: str) -> Cut:
    """A body as the cut of a tool."""
    return Cut(tuple(body), range(1, len(body) + 1), tool, f"{name}.ngc", name)


def _make_job(kind: str, depth: float, diameter: float, **settings: object) -> Job:
    operation = OperationTable(kind=kind, depth=depth, **settings)  # type: ignore[arg-type]
    tool = ToolTable(diameter=diameter, kind="drill" if kind == "drill" else "end mill")
    return Job(operation=operation, tool=tool, process=ProcessTable(spindle=9000.0))


def _list_closed(part: camgen.Part) -> tuple[camgen.Contour, ...]:
    return tuple(contour for contour in part.contours if contour.closed)


def _list_holes(part: camgen.Part) -> tuple[camgen.Contour, ...]:
    """The round holes of 3.3 mm."""
    return tuple(c for c in _list_closed(part) if abs(_measure_width(c) - 3.3) < 0.3)


def _measure_width(contour: camgen.Contour) -> float:
    return float(np.ptp(sample_outline(contour)[:, 0]))


def _make_follow(file: str, diameter: float) -> Scene:
    name = file.partition(".")[0]
    job = _make_job("follow", 5.0, diameter, passes=2)
    body, part = _build(file, job)

    @cache
    def make_other(share: float) -> Cut:
        other, _ = _build(file, _make_job("follow", 5.0, share * diameter, passes=2))
        return make_cut(other, job.tool, name)

    others = [partial(make_other, share) for share in (0.5, 0.98, 1.25, 2)]
    closed = _list_closed(part)
    wanted = design([Task(job, part)], StockTable(thickness=5.0))
    cuts, rules = (make_cut(body, job.tool, name),), (Rule(closed, False, 5.0),)
    return Scene(name, cuts, wanted, closed, rules, 5.0, others=tuple(others))


def _make_drill() -> Scene:
    job = _make_job("drill", 9.0, 3.3, passes=3, holes=[3.0, 3.5])
    body, part = _build("plate.dxf", job)
    wanted = design([Task(job, part)], StockTable(thickness=9.0))
    cuts, rules = (make_cut(body, job.tool, "drill"),), (Rule(_list_holes(part), True, 9.0),)
    return Scene("drill", cuts, wanted, _list_closed(part), rules, 9.0)


def _make_drill_and_follow() -> Scene:
    """Two tools, one after the other: holes, then the outline."""
    drilling = _make_job("drill", 6.0, 3.3, holes=[3.0, 3.5])
    body, part = _build("plate.dxf", drilling)
    holes, closed = _list_holes(part), _list_closed(part)
    outer = max(closed, key=_measure_width)
    cutting = _make_job("follow", 6.0, 6.0, passes=3)
    around, _ = _build(replace(part, contours=(outer,)), cutting)
    tasks = [
        Task(drilling, replace(part, worked=frozenset(hole.id for hole in holes))),
        Task(cutting, replace(part, worked=frozenset({outer.id}))),
    ]
    cuts = (make_cut(body, drilling.tool, "holes"), make_cut(around, cutting.tool, "outline"))
    rules = (Rule(holes, True, 6.0), Rule((outer,), False, 6.0))
    return Scene("two tools", cuts, design(tasks, StockTable(thickness=6.0)), closed, rules, 6.0)


def _make_square(name: str, low: float, high: float) -> camgen.Contour:
    corners = np.array([(low, low), (high, low), (high, high), (low, high)])
    return camgen.Contour(corners, np.zeros(4), True, "0", name)


def _place(x: float, y: float, z: float) -> Pose:
    return Pose(TOOL_DOWN, (x, y, z))


def _cut_lines(points: Iterable[tuple[float, float]], z: float, speed: float) -> list[Instruction]:
    return [MoveL(_place(x, y, z), speed) for x, y in points]


def _make_pocket() -> Scene:
    """A square of 40 mm, 3 mm deep, in rings of 6 mm from the inside outwards, in two levels."""
    walls, plate = _make_square("c2", 10.0, 50.0), _make_square("c1", 0.0, 60.0)
    contours = (plate, walls)
    part = camgen.Part("pocket", "pocket.dxf", "mm", contours, (), worked=frozenset({"c2"}))
    body: list[Instruction] = []
    for depth in (1.5, 3.0):
        body += [MoveJ(_place(27.0, 27.0, z), 100.0) for z in (10.0, 2.0)]
        for half in (3.0, 7.0, 11.0, 15.0, 17.0):
            low, high = 30 - half, 30 + half
            ring = [(low, low), (high, low), (high, high), (low, high), (low, low)]
            body += _cut_lines(ring, -depth, 10.0)
        body.append(MoveJ(_place(low, low, 10.0), 100.0))
    job = _make_job("pocket", 3.0, 6.0)
    wanted = design([Task(job, part)], StockTable(thickness=8.0))
    cuts, rules = (make_cut(body, job.tool, "pocket"),), (Rule((walls,), True, 3.0),)
    return Scene("pocket", cuts, wanted, contours, rules, 8.0)


def _make_tabs() -> Scene:
    """A square of 40 mm in two passes, the second over a bridge on each side, after its hole."""
    plate = _make_square("c1", 0.0, 40.0)
    half = np.array([(26.0, 20.0), (14.0, 20.0)])
    hole = camgen.Contour(half, np.ones(2), True, "0", "c2")
    part = camgen.Part("tabs", "tabs.dxf", "mm", (plate, hole), ())
    job = _make_job("follow", 4.0, 3.0, tabs=4, tab_width=5.0, tab_height=1.0)
    traced, _ = _build(replace(part, contours=(hole,)), _make_job("trace", 4.0, 3.0, passes=1))
    inner = [_scale_inwards(item, 4.5 / 6.0) for item in traced]
    last = next(k for k in reversed(range(len(inner))) if isinstance(inner[k], Output))
    stop = inner.pop(last)
    body = [*inner, *_cut_square(-2.0, False), *_cut_square(-4.0, True), stop]
    wanted = design([Task(job, part)], StockTable(thickness=4.0))
    cuts, rules = (make_cut(body, job.tool, "tabs"),), (Rule((plate, hole), False, 4.0),)
    return Scene("tabs", cuts, wanted, (plate, hole), rules, 4.0, tabs=True)


def _scale_inwards(item: Instruction, share: float) -> Instruction:
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


def _cut_square(z: float, has_bridges: bool) -> list[Instruction]:
    """The outside of the square from 0 to 40, with or without bridges of 5 mm."""
    low, high = -1.5, 41.5
    corners = [(low, low), (high, low), (high, high), (low, high), (low, low)]
    body: list[Instruction] = [
        MoveJ(_place(low, low, 10.0), 100.0),
        MoveL(_place(low, low, z), 5.0),
    ]
    for (x1, y1), (x2, y2) in pairwise(corners):
        if has_bridges:
            ux, uy = (x2 - x1) / 43.0, (y2 - y1) / 43.0
            for length, height in ((17.5, z), (17.5, z + 1), (25.5, z + 1), (25.5, z)):
                body.append(MoveL(_place(x1 + length * ux, y1 + length * uy, height), 5.0))
        body.append(MoveL(_place(x2, y2, z), 5.0))
    return [*body, MoveJ(_place(low, low, 10.0), 100.0)]


def sample_outline(contour: camgen.Contour, step: float = 0.1) -> Array:
    """Points (N, 2) along a closed contour, by the definition of a bulge."""

    def count(whole: Pieces) -> Array:
        fewest = np.where(whole.sweep == 0, 2, 8)
        return np.maximum(np.ceil(whole.length / step), fewest)

    return flatten(*to_loops([contour]), count)
