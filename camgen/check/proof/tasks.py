"""The tasks that drawing and job set: contours, sides, distances and depths.

Nothing here is read from a plan or a tour. A rule that planning follows too is written a second
time, from the documents (docs/follow.md, docs/chamfer.md, docs/several-operations.md), so that a
mistake in either of them shows as a difference.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fnmatch import fnmatchcase
from functools import cached_property

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.check.proof.nesting import Nesting, contour_boxes, nest
from camgen.check.proof.pieces import BoolArray, IntArray, Pieces, drawn_pieces
from camgen.model.job import Choice, Job, OperationTable
from camgen.model.page import compute_page_size
from camgen.model.part import Contour, Part, tabulate_contours
from camgen.model.pose import FloatArray
from camgen.read.colors import resolve_named

#: Operations that run beside contours, so that all contours that bound material count.
BESIDE = ("follow", "chamfer")
#: Operations that look for circles by themselves.
HOLES = ("drill", "bore")
#: A contour is a circle if it leaves one by at most this share of its radius, mm of 1 mm.
_ROUND = 0.002
#: Distance of the tip of a V tool from the wall, mm: usual, and at least (docs/chamfer.md).
_TIP_GAP_MM, _LEAST_TIP_GAP_MM = 0.5, 0.1
#: Height above the floor of a pass at which a pocket is crossed at travel speed, mm
#: (docs/pocket.md).
HOP_MM = 0.3
#: Deviation from the border of a picture of two values, pixels.
_PIXELS = 1.0


class Drawing(Struct, frozen=True, eq=False, dict=True):
    """The contours of a part where they are worked on, mm.

    contours: (C,) as they were read, without the outline of the stock.
    pieces: their lines and arcs; `owner` is the index of the contour.
    closed: (C,) whether each contour is closed.
    length: (C,) mm.
    slack: deviation, mm, that the job allows for chords, arcs found again and thinning.
    """

    contours: tuple[Contour, ...]
    pieces: Pieces
    closed: BoolArray
    length: FloatArray
    slack: float

    @cached_property
    def boxes(self) -> FloatArray:
        """(C, 4) bounding boxes of the contours, infinite for one of no length."""
        return contour_boxes(self.pieces, len(self.contours))


class Task(Struct, frozen=True, eq=False):
    """The work of one operation.

    number: its place in `[[operations]]`, -1 for the only operation of a job.
    kind: name of the operation.
    job: its settings, with its tool.
    worked: (C,) contours of the drawing that it works on.
    kept_clear: (C,) contours that the tool keeps clear of.
    walls: (C,) contours beside which the tool may have no room: those, the worked ones, and those
        that the planner may have kept clear of.
    tool_side: (C,) side of the contour on which the tool runs: 1 left, -1 right, 0 on it.
    distances: distances of the tool's centre from the contours, mm, the one of the last pass last.
    depths: depths of the passes below the top face, mm, in order.
    near: (N, 2) pairs of contours that come near to each other, for `kept_clear`.
    enclosed: (E, 2) pairs of a contour and a closed one around it, where nesting decides the sides.
    """

    number: int
    kind: str
    job: Job
    worked: BoolArray
    kept_clear: BoolArray
    walls: BoolArray
    tool_side: IntArray
    distances: tuple[float, ...]
    depths: tuple[float, ...]
    near: IntArray
    enclosed: IntArray

    @property
    def operation(self) -> OperationTable:
        """The settings of the operation."""
        return self.job.operation


def make_drawing(part: Part, job: Job) -> Drawing:
    """The contours of `part`, scaled and moved to the page of `job` if it has one."""
    drawn = part.contours
    if job.stock.layer:
        drawn = tuple(each for each in drawn if each.layer != job.stock.layer or not each.closed)
    pieces = drawn_pieces(part.contours)
    ratio, shift = _fit_page(part, pieces, job)
    if ratio != 1.0 or shift.any():
        moved = []
        for contour in drawn:
            moved.append(replace(contour, points=contour.points * ratio + shift))
        drawn, pieces = tuple(moved), drawn_pieces(moved)
    elif len(drawn) < len(part.contours):
        pieces = drawn_pieces(drawn)
    closed = tabulate_contours(drawn).closed
    length = np.bincount(pieces.owner, pieces.length, len(drawn)).astype(np.float64)
    return Drawing(drawn, pieces, closed, length, _allowed_slack(part, job, ratio))


def _fit_page(part: Part, pieces: Pieces, job: Job) -> tuple[float, FloatArray]:
    """Factor and shift, mm, that lay the drawing on the page: centred in its margins."""
    page = job.page
    if not page.size or not len(pieces):
        return 1.0, np.zeros(2)
    low, high = pieces.boxes[:, :2].min(axis=0), pieces.boxes[:, 2:].max(axis=0)
    size = np.array(compute_page_size(page))
    if page.scale == "true":
        ratio = 1.0
    elif page.scale == "fit":
        room, drawn = size - 2 * page.margin, high - low
        ratio = float(min(room[drawn > 0] / drawn[drawn > 0]))
    else:
        ratio = float(page.scale) / _unit(part)
    return ratio, size / 2 - ratio * (low + high) / 2


def _unit(part: Part) -> float:
    if part.raster is not None:
        return float(np.hypot(*part.raster.work_from_view[:, 0]))
    from camgen.read.units import MM  # noqa: PLC0415 (only for a page with a scale)

    name = part.units.split(" + ")[0]
    return MM[name] if name in MM else float(name.partition(" mm/")[0])


def _allowed_slack(part: Part, job: Job, ratio: float) -> float:
    """Deviation, mm, that the job allows for chords, arcs found again and thinning."""
    tolerance = job.tolerance
    simplify = tolerance.simplify
    if simplify is None:
        simplify = 0.0
        if part.raster is not None:
            simplify = _PIXELS * ratio * float(np.hypot(*part.raster.work_from_view[:, 0]))
    # A drawing that is thinned before it is laid on a page has another box, and another middle.
    moved = simplify if job.page.size else 0.0
    return tolerance.chord + tolerance.arc_fit + simplify + moved


def make_tasks(drawing: Drawing, job: Job, on_page: bool) -> list[Task]:
    """The task of each operation of `job`. on_page: a drawing on a page is traced by default."""
    if not job.operations:
        worked = np.ones(len(drawing.contours), np.bool_)
        return [_make_task(drawing, job, -1, worked, worked, on_page)]
    chosen = [_choose(drawing, step.choice, step.operation) for step in job.operations]
    material = _bounds_material(job, chosen)
    tasks = []
    for number, (step, worked) in enumerate(zip(job.operations, chosen, strict=True)):
        step_job = replace(
            job,
            tool=step.tool,
            operation=step.operation,
            process=step.process,
            tools=[],
            operations=[],
        )
        shown = worked | material if step.operation.kind in BESIDE else worked
        tasks.append(_make_task(drawing, step_job, number, worked, shown, on_page))
    return tasks


def _make_task(
    drawing: Drawing, job: Job, number: int, worked: BoolArray, shown: BoolArray, on_page: bool
) -> Task:
    operation = job.operation
    kind = operation.kind
    if kind == "auto":
        kind = "trace" if on_page and operation.planner != "image" else "follow"
    if kind == "follow" and operation.side == "on":
        kind = "trace"
    side = np.zeros(len(drawing.contours), np.intp)
    kept_clear = np.zeros(len(drawing.contours), np.bool_)
    near = enclosed = np.zeros((0, 2), np.intp)
    distances, depths = _distances(kind, job)
    if kind in BESIDE and operation.side in ("left", "right"):
        side = np.full(len(drawing.contours), 1 if operation.side == "left" else -1)
    elif kind in BESIDE:
        nesting = _nest_shown(drawing, shown, max(distances))
        near, enclosed = nesting.near, nesting.enclosed
        side, kept_clear = _choose_sides(drawing, operation.side, shown, nesting)
    walls = worked | kept_clear
    return Task(
        number, kind, job, worked, kept_clear, walls, side, distances, depths, near, enclosed
    )


def _distances(kind: str, job: Job) -> tuple[tuple[float, ...], tuple[float, ...]]:
    operation, tool = job.operation, job.tool
    depth, radius = operation.depth, tool.radius
    distances: tuple[float, ...] = (0.0,)
    if kind in ("follow", "pocket"):
        distances = (radius + operation.finish, radius) if operation.finish else (radius,)
    elif kind == "chamfer":
        tip, width = tool.tip_diameter / 2, operation.width or 0.0
        gap = max(min(_TIP_GAP_MM, radius - tip - width), _LEAST_TIP_GAP_MM)
        angle = 90.0 if tool.tip_angle is None else tool.tip_angle
        distances = (tip + gap,)
        depth = (gap + width) / math.tan(math.radians(angle) / 2)
    passes = operation.passes
    return distances, tuple(depth * (k + 1) / passes for k in range(passes))


def _nest_shown(drawing: Drawing, shown: BoolArray, distance: float) -> Nesting:
    shown = shown & drawing.closed
    rows = shown[drawing.pieces.owner]
    pieces = drawing.pieces if rows.all() else drawing.pieces.take(rows)
    return nest(pieces, drawing.boxes, shown, drawing.closed, distance)


def _choose_sides(
    drawing: Drawing, side: str, shown: BoolArray, nesting: Nesting
) -> tuple[IntArray, BoolArray]:
    """The side of the tool at each contour, and the contours to keep clear of."""
    count = len(drawing.contours)
    inside = np.full(count, side == "inside")
    kept_clear = np.zeros(count, np.bool_)
    if side == "auto":
        inside = nesting.depth % 2 == 1
        kept_clear = shown & drawing.closed
    return np.where(inside == nesting.inside_left, 1, -1), kept_clear


# Contours of several operations.


def _bounds_material(job: Job, chosen: Sequence[BoolArray]) -> BoolArray:
    """(C,) contours that bound material: worked on from beside, or by no operation at all."""
    bordered = np.zeros_like(chosen[0])
    others = np.zeros_like(chosen[0])
    for step, worked in zip(job.operations, chosen, strict=True):
        target = bordered if step.operation.kind in BESIDE else others
        target |= worked
    return np.asarray(bordered | ~others)


def _choose(drawing: Drawing, choice: Choice, operation: OperationTable) -> BoolArray:
    """(C,) contours that a row of `[[operations]]` chooses."""
    colors = set[str]().union(*map(resolve_named, choice.colors))
    chosen = np.zeros(len(drawing.contours), np.bool_)
    for index, contour in enumerate(drawing.contours):
        chosen[index] = (
            _has_layer(contour.layer, choice.layers)
            and (not choice.ids or contour.id in choice.ids)
            and (not choice.colors or contour.color in colors)
        )
    if choice.nesting != "any":
        depth = _nest_shown(drawing, drawing.closed, 0.0).depth
        chosen &= drawing.closed & ((depth > 0) == (choice.nesting == "inner"))
    if operation.holes is not None and operation.kind not in HOLES:
        chosen &= _are_circles(drawing, operation.holes)
    return chosen


def _has_layer(layer: str, globs: Sequence[str]) -> bool:
    name = layer.casefold()
    kept: list[str] = []
    dropped: list[str] = []
    for glob in globs:
        text = glob.casefold()
        (dropped if text.startswith("!") else kept).append(text.removeprefix("!"))
    is_kept = any(fnmatchcase(name, glob) for glob in kept or ["*"])
    return is_kept and not any(fnmatchcase(name, glob) for glob in dropped)


def _are_circles(drawing: Drawing, diameters: Sequence[float]) -> BoolArray:
    chosen = np.zeros(len(drawing.contours), np.bool_)
    for index, circle in enumerate(find_circles(drawing)):
        if circle is not None:
            chosen[index] = diameters[0] - 1e-6 <= 2 * circle[2] <= diameters[1] + 1e-6
    return chosen


def find_circles(
    drawing: Drawing, share: float = _ROUND, least: float = 0.0
) -> list[tuple[float, float, float] | None]:
    """Centre and radius, mm, of each contour that is a circle; None for the others.

    A circle leaves its best one by at most `share` of the radius, or by `least` mm.
    """
    circles: list[tuple[float, float, float] | None] = []
    pieces = drawing.pieces
    bounds = np.searchsorted(pieces.owner, np.arange(len(drawing.contours) + 1))
    for index, closed in enumerate(drawing.closed.tolist()):
        rows = slice(int(bounds[index]), int(bounds[index + 1]))
        circles.append(_fit_circle(pieces, rows, share, least) if closed else None)
    return circles


def _fit_circle(
    pieces: Pieces, rows: slice, share: float, least: float
) -> tuple[float, float, float] | None:
    points = np.concatenate([pieces.start[rows], pieces.middle[rows]])
    centre = points[: len(points) // 2].mean(axis=0) if len(points) else np.zeros(2)
    matrix = np.column_stack([2 * (points - centre), np.ones(len(points))])
    solution, *_ = np.linalg.lstsq(matrix, ((points - centre) ** 2).sum(axis=1), rcond=None)
    radius = math.sqrt(max(solution[2] + solution[0] ** 2 + solution[1] ** 2, 0.0))
    centre = centre + solution[:2]
    distance = np.sqrt(((points - centre) ** 2).sum(axis=1))
    # Half a circle there and back has its points on a circle too, but not its length.
    whole = abs(float(pieces.length[rows].sum()) / (2 * math.pi * radius + 1e-300) - 1) < 0.1
    if len(points) < 4 or not whole or np.abs(distance - radius).max() > max(share * radius, least):
        return None
    return float(centre[0]), float(centre[1]), radius
