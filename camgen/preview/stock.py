"""The material that a program cuts from, and the tools that it does it with, for the page that plays the cut.

A stock is a box; what is left of it follows from the tools along the way of the program, which the page works out.
"""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct

from camgen.check.report import clean
from camgen.geometry.segments import compute_bounds, from_contours
from camgen.model.job import ToolTable
from camgen.model.path import ToolPath
from camgen.model.pose import FloatArray, Pose, frozen
from camgen.model.program import ToolChange
from camgen.model.text import short
from camgen.order.tours import JobTour
from camgen.plan.steps import name_of
from camgen.preview import Built
from camgen.preview.track import IntArray

#: Tools that leave a shape of their own in the material, with the angle at the tip where the job names none, deg.
_MILLS = {"end mill": 180.0, "ball mill": 180.0, "bull nose": 180.0, "drill": 118.0, "v": 90.0}
#: Operations that run on a part that is there already.
_FINISHED = ("edges", "replay")
#: Points of the outline of a round tool between its tip and its side.
_ROUND_POINTS = 24
#: So many places of excess are shown.
_MOST_MARKS = 200
#: Tool z leans by less than about a hundredth of a degree, as 1 - cos of it.
_STRAIGHT = 1e-8


class Stock(Struct, frozen=True, eq=False):
    """A box of material, work frame, mm: low, high (3,). assumed: its thickness is the greatest depth of the program,
    the job says none.
    """

    low: FloatArray
    high: FloatArray
    assumed: bool


class Cutter(Struct, frozen=True, eq=False):
    """A tool: name, kind, diameter in mm. profile: what turns about its axis, radius and height above the tip, mm, from
    the tip to the side; nothing for a tool that takes no material away by its shape (a laser, a pen). frame: of its tip
    at the flange.
    """

    name: str
    kind: str
    diameter: float
    profile: tuple[tuple[float, float], ...]
    frame: Pose


class Cutters(Struct, frozen=True, eq=False):
    """The tools of a program. paths: (P,) the tool of each path. operations: what each path is of, "" where the job
    has one operation.
    """

    tools: tuple[Cutter, ...]
    paths: IntArray
    operations: tuple[str, ...]


class Mark(Struct, frozen=True, eq=False):
    """What a proof on the stock found at a level. kind: "gouge" (material of the part is gone) or "excess" (material is
    left that should be gone). polygon: (N, 2), work frame, mm, its last point not the first again; holes: such ones
    within it. z: its height, mm. number: how much, mm. text: what is said of it.
    """

    kind: str
    polygon: FloatArray
    z: float
    number: float
    text: str
    holes: tuple[FloatArray, ...] = ()


def profile_of(tool: ToolTable) -> tuple[tuple[float, float], ...]:
    """The outline of a tool from its tip to its side, as in ``Cutter``."""
    if tool.kind not in _MILLS:
        return ()
    radius = tool.radius
    corner = {"ball mill": radius, "bull nose": min(tool.corner_radius, radius)}.get(tool.kind, 0.0)
    if corner:
        turns = np.linspace(0.0, math.pi / 2, _ROUND_POINTS)
        return tuple(
            (radius - corner + corner * math.sin(a), corner - corner * math.cos(a))
            for a in turns.tolist()
        )
    angle = tool.tip_angle if tool.kind in ("drill", "v") and tool.tip_angle else _MILLS[tool.kind]
    flat = min(tool.tip_diameter / 2, radius) if tool.kind == "v" else 0.0
    if angle == 180.0 or flat == radius:
        return ((0.0, 0.0), (radius, 0.0))
    return ((0.0, 0.0), (flat, 0.0), (radius, (radius - flat) / math.tan(math.radians(angle / 2))))


def cutters_of(result: Built) -> Cutters:
    """The tools of a build, each once, in the order in which they are used."""
    tour = result.tour
    if not isinstance(tour, JobTour):
        count = len(tour.paths)
        return Cutters(
            (_cutter(result.job.tool, result.program.flange_from_tool),),
            np.zeros(count, dtype=np.int64),
            ("",) * count,
        )
    tools: list[ToolTable] = []
    owner: list[int] = []
    operations: list[str] = []
    for step, number, part in zip(tour.steps, tour.numbers, tour.tours, strict=True):
        if step.tool not in tools:
            tools.append(step.tool)
        owner += [tools.index(step.tool)] * len(part.paths)
        operations += [clean(name_of(result.job, number).removeprefix("operation "))] * len(
            part.paths
        )
    return Cutters(
        tuple(_cutter(tool, _frame_of(result, tool)) for tool in tools),
        np.array(owner, dtype=np.int64),
        tuple(operations),
    )


def _frame_of(result: Built, tool: ToolTable) -> Pose:
    """The frame at the flange of a tool that the program changes to, else that of the program."""
    changes = (item for item in result.program.body if isinstance(item, ToolChange))
    own = next(
        (item for item in changes if (item.number, item.name) == (tool.number, tool.name)), None
    )
    return (own and own.flange_from_tool) or result.program.flange_from_tool


def _cutter(tool: ToolTable, frame: Pose) -> Cutter:
    name = tool.name or (
        f"T{tool.number}" if tool.number else f"{short(tool.diameter, 2)} mm {tool.kind}"
    )
    return Cutter(clean(name), tool.kind, tool.diameter, profile_of(tool), frame)


def tools_of_events(
    result: Built, found: Cutters, instruction: IntArray, path: IntArray
) -> IntArray:
    """(E,) the tool of each event. instruction: (E,) of each in the body. path: (E,) of each, -1 for travel.

    Travel has the tool of the path before it, or after it where the tool was changed between them or there is none.
    """
    rows = np.arange(len(path))
    work = path >= 0
    if len(found.tools) < 2 or not work.any():
        return np.zeros(len(path), dtype=np.int64)
    before = np.maximum.accumulate(np.where(work, rows, -1))
    after = np.minimum.accumulate(np.where(work, rows, len(rows))[::-1])[::-1]
    changes = np.flatnonzero(result.program.columns.are(ToolChange))
    # How many changes lie before each event: work on both sides of the same number is with one tool.
    turn = np.searchsorted(changes, instruction)
    same = (before >= 0) & (turn[np.maximum(before, 0)] == turn)
    chosen = np.where(
        same | (after >= len(rows)), np.maximum(before, 0), np.minimum(after, len(rows) - 1)
    )
    return np.asarray(found.paths[path[chosen]])


def stock_of(result: Built, found: Cutters) -> Stock | None:
    """The stock of a build that mills a drawing or a picture from above; None for any other."""
    part, job, paths = result.part, result.job, result.tour.paths
    deepest = _find_depth(paths)
    kinds = [step.operation.kind for step in job.operations] or [job.operation.kind]
    if part.solid is not None or part.curves or set(kinds) & set(_FINISHED) or deepest <= 0:
        return None
    mills = any(found.tools[tool].profile for tool in found.paths.tolist())
    if not mills or not all(_is_cut_from_above(path) for path in paths):
        return None
    drawn = [
        c for c in part.contours if job.stock.layer and c.layer == job.stock.layer and c.closed
    ]
    box = compute_bounds(from_contours(drawn or part.contours))
    if not len(box):
        box = np.concatenate([np.hstack([path.position[:, :2]] * 2) for path in paths])
    margin = 0.0 if drawn else job.stock.margin
    low, high = box[:, :2].min(axis=0) - margin, box[:, 2:].max(axis=0) + margin
    thickness = job.stock.thickness or deepest
    return Stock(np.append(low, -thickness), np.append(high, 0.0), job.stock.thickness is None)


def _find_depth(paths: tuple[ToolPath, ...]) -> float:
    """The greatest depth below the top face, mm."""
    return max((max(path.depths) - float(path.position[:, 2].min()) for path in paths), default=0.0)


def _is_cut_from_above(path: ToolPath) -> bool:
    """Straight down, and without a force, which presses on an edge that is there."""
    return bool((path.axis[:, 2] < -1 + _STRAIGHT).all() and not path.force.any())


def marks_of(result: Built) -> tuple[Mark, ...]:
    """What the proof on the stock found to be left without a reason, level by level, the widest first.

    Gouges are no part of it: a build that makes one is refused.
    """
    levels = result.proof.levels if result.proof else ()
    if not any(level.excess.unexplained.area > 0 for level in levels):
        return ()
    import shapely  # noqa: PLC0415 (slow; here the proof has loaded it already)

    found = []
    for level in levels:
        for piece in shapely.get_parts(level.excess.unexplained):
            if piece.geom_type != "Polygon" or piece.is_empty:
                continue
            wide = 2 * shapely.maximum_inscribed_circle(piece).length
            text = f"left from z {short(level.top, 2)} to {short(level.bottom, 2)} mm: {short(piece.area, 2)} mm2"
            outline, *holes = (
                frozen(ring.coords[:-1]) for ring in (piece.exterior, *piece.interiors)
            )
            found.append(
                Mark(
                    "excess",
                    outline,
                    level.top,
                    wide,
                    f"{text}, up to {short(wide, 2)} mm wide",
                    tuple(holes),
                )
            )
    return tuple(sorted(found, key=lambda mark: -mark.number)[:_MOST_MARKS])


def tell_stock(stock: Stock) -> str:
    """Its size for the numbers of the page, and where its thickness comes from."""
    size = " x ".join(short(value, 1) for value in (stock.high - stock.low).tolist())
    why = "; as thick as the program is deep, stock.thickness is not set" if stock.assumed else ""
    return f"{size} mm{why}"
