"""The stock and the tools of a program, for the material removal on the page.

A stock is a box. The page itself computes the material that is left after each motion.
"""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct

from camgen.check.report import clean
from camgen.geometry.segments import compute_bounds, make_contour_segments
from camgen.model.job import ToolTable
from camgen.model.path import ToolPath
from camgen.model.pose import FloatArray, Pose, frozen
from camgen.model.program import ToolChange
from camgen.model.text import short, short_each
from camgen.order.tours import JobTour
from camgen.plan.steps import format_step
from camgen.preview import Built
from camgen.preview.track import IntArray

#: Tools that remove material by their shape, with the tip angle if the job states none, deg.
_MILLS = {"end mill": 180.0, "ball mill": 180.0, "bull nose": 180.0, "drill": 118.0, "v": 90.0}
#: Operations on a part that already has its shape.
_FINISHED = ("edges", "replay")
#: Points of the profile of a round tool between its tip and its side.
_ROUND_POINTS = 24
#: Maximum number of marks on the page.
_MAX_MARKS = 200
#: Angle between tool z and the vertical, as 1 - cos of it, that still counts as vertical: about a
#: hundredth of a degree.
_STRAIGHT = 1e-8


class Stock(Struct, frozen=True, eq=False):
    """A box of material in the work frame.

    low, high: (3,) corners, mm.
    assumed: whether the thickness is the largest depth of the program, since the job states none.
    """

    low: FloatArray
    high: FloatArray
    assumed: bool


class Cutter(Struct, frozen=True, eq=False):
    """A tool.

    name: its name.
    kind: its kind, as in the job.
    diameter: its diameter, mm.
    profile: radius and height above the tip, mm, of the points of its outline from the tip to the
        side; empty for a tool that removes no material by its shape, such as a laser or a pen.
    frame: its frame at the flange.
    """

    name: str
    kind: str
    diameter: float
    profile: tuple[tuple[float, float], ...]
    frame: Pose


class Cutters(Struct, frozen=True, eq=False):
    """The tools of a program.

    tools: each tool once, in the order of use.
    paths: (P,) index of the tool of each path.
    operations: name of the operation of each path, "" for a job with one operation.
    """

    tools: tuple[Cutter, ...]
    paths: IntArray
    operations: tuple[str, ...]


class Mark(Struct, frozen=True, eq=False):
    """A finding of the stock proof at one height.

    kind: "gouge" for material of the part that is gone, "excess" for rest material.
    polygon: (N, 2) outline in the work frame, mm, without its first point again at the end.
    z: its height, mm.
    width: largest width of the finding, mm.
    text: description of the finding.
    holes: outlines of the holes in the polygon.
    """

    kind: str
    polygon: FloatArray
    z: float
    width: float
    text: str
    holes: tuple[FloatArray, ...] = ()


def compute_profile(tool: ToolTable) -> tuple[tuple[float, float], ...]:
    """The profile of a tool, as in `Cutter`."""
    if tool.kind not in _MILLS:
        return ()
    radius = tool.radius
    corner = {"ball mill": radius, "bull nose": min(tool.corner_radius, radius)}.get(tool.kind, 0.0)
    if corner:
        points = []
        for angle in np.linspace(0.0, math.pi / 2, _ROUND_POINTS).tolist():
            across = radius - corner + corner * math.sin(angle)
            points.append((across, corner - corner * math.cos(angle)))
        return tuple(points)
    angle = tool.tip_angle if tool.kind in ("drill", "v") and tool.tip_angle else _MILLS[tool.kind]
    flat = min(tool.tip_diameter / 2, radius) if tool.kind == "v" else 0.0
    if angle == 180.0 or flat == radius:
        return ((0.0, 0.0), (radius, 0.0))
    return ((0.0, 0.0), (flat, 0.0), (radius, (radius - flat) / math.tan(math.radians(angle / 2))))


def list_cutters(result: Built) -> Cutters:
    """The tools of a build, each once, in the order in which they are used."""
    tour = result.tour
    if not isinstance(tour, JobTour):
        count = len(tour.paths)
        cutter = _make_cutter(result.job.tool, result.program.flange_from_tool)
        return Cutters((cutter,), np.zeros(count, dtype=np.int64), ("",) * count)
    tools: list[ToolTable] = []
    owner: list[int] = []
    operations: list[str] = []
    for step, number, part in zip(tour.steps, tour.numbers, tour.tours, strict=True):
        if step.tool not in tools:
            tools.append(step.tool)
        owner += [tools.index(step.tool)] * len(part.paths)
        name = clean(format_step(result.job, number).removeprefix("operation "))
        operations += [name] * len(part.paths)
    return Cutters(
        tuple(_make_cutter(tool, _find_frame(result, tool)) for tool in tools),
        np.array(owner, dtype=np.int64),
        tuple(operations),
    )


def _find_frame(result: Built, tool: ToolTable) -> Pose:
    """The frame of the tool in its tool change, or that of the program if the change has none."""
    program = result.program
    for change in program.body:
        if isinstance(change, ToolChange) and (change.number, change.name) == (
            tool.number,
            tool.name,
        ):
            return change.flange_from_tool or program.flange_from_tool
    return program.flange_from_tool


def _make_cutter(tool: ToolTable, frame: Pose) -> Cutter:
    number = f"T{tool.number}" if tool.number else f"{short(tool.diameter, 2)} mm {tool.kind}"
    name = clean(tool.name or number)
    return Cutter(name, tool.kind, tool.diameter, compute_profile(tool), frame)


def assign_tools(
    result: Built, cutters: Cutters, instruction: IntArray, path: IntArray
) -> IntArray:
    """The index of the tool of each event, shape (E,).

    instruction: (E,) index of the instruction of each event in the body.
    path: (E,) index of the path of each event, -1 for travel.

    Travel has the tool of the path before it. If the tool changes between them, or no path is
    before it, it has the tool of the path after it.
    """
    rows = np.arange(len(path))
    work = path >= 0
    if len(cutters.tools) < 2 or not work.any():
        return np.zeros(len(path), dtype=np.int64)
    before = np.maximum.accumulate(np.where(work, rows, -1))
    after = np.minimum.accumulate(np.where(work, rows, len(rows))[::-1])[::-1]
    changes = np.flatnonzero(result.program.columns.are(ToolChange))
    # Events with the same number of tool changes before them have the same tool.
    change_count = np.searchsorted(changes, instruction)
    is_same = (before >= 0) & (change_count[np.maximum(before, 0)] == change_count)
    chosen = np.where(
        is_same | (after >= len(rows)), np.maximum(before, 0), np.minimum(after, len(rows) - 1)
    )
    return np.asarray(cutters.paths[path[chosen]])


def find_stock(result: Built, cutters: Cutters) -> Stock | None:
    """The stock of a build that mills a drawing or a picture from above; None for any other."""
    part, job, paths = result.part, result.job, result.tour.paths
    deepest = _find_depth(paths)
    kinds = [step.operation.kind for step in job.operations] or [job.operation.kind]
    if part.solid is not None or part.curves or set(kinds) & set(_FINISHED) or deepest <= 0:
        return None
    mills = any(cutters.tools[tool].profile for tool in cutters.paths.tolist())
    if not mills or not all(_is_cut_from_above(path) for path in paths):
        return None
    drawn = []
    if job.stock.layer:
        drawn = [c for c in part.contours if c.layer == job.stock.layer and c.closed]
    box = compute_bounds(make_contour_segments(drawn or part.contours))
    if not len(box):
        box = np.concatenate([np.hstack([path.position[:, :2]] * 2) for path in paths])
    margin = 0.0 if drawn else job.stock.margin
    low, high = box[:, :2].min(axis=0) - margin, box[:, 2:].max(axis=0) + margin
    thickness = job.stock.thickness or deepest
    return Stock(np.append(low, -thickness), np.append(high, 0.0), job.stock.thickness is None)


def _find_depth(paths: tuple[ToolPath, ...]) -> float:
    """The largest depth below the top face, mm."""
    return max((max(path.depths) - float(path.position[:, 2].min()) for path in paths), default=0.0)


def _is_cut_from_above(path: ToolPath) -> bool:
    """Whether the tool is vertical and has no contact force. A force needs an existing edge."""
    return bool((path.axis[:, 2] < -1 + _STRAIGHT).all() and not path.force.any())


def find_marks(result: Built) -> tuple[Mark, ...]:
    """The rest material without an explanation in the stock proof, the widest first.

    A build with a gouge is refused, so there are no gouges.
    """
    levels = result.proof.levels if result.proof else ()
    if not any(level.excess.unexplained.area > 0 for level in levels):
        return ()
    import shapely  # noqa: PLC0415 (slow; here the proof has loaded it already)

    marks = []
    for level in levels:
        heights = f"from z {short(level.top, 2)} to {short(level.bottom, 2)} mm"
        for piece in shapely.get_parts(level.excess.unexplained):
            if piece.geom_type != "Polygon" or piece.is_empty:
                continue
            width = 2 * shapely.maximum_inscribed_circle(piece).length
            size = f"{short(piece.area, 2)} mm2, up to {short(width, 2)} mm wide"
            rings = [frozen(ring.coords[:-1]) for ring in (piece.exterior, *piece.interiors)]
            text = f"left {heights}: {size}"
            marks.append(Mark("excess", rings[0], level.top, width, text, tuple(rings[1:])))
    return tuple(sorted(marks, key=lambda mark: -mark.width)[:_MAX_MARKS])


def format_stock(stock: Stock) -> str:
    """The size of the stock as text, with the source of its thickness."""
    size = " x ".join(short_each((stock.high - stock.low).tolist(), 1))
    why = "; as thick as the program is deep, stock.thickness is not set" if stock.assumed else ""
    return f"{size} mm{why}"
