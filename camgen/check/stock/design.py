"""What the operations of a job may take away and what they shall, by place and depth, from the drawing alone."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
import shapely
from msgspec import Struct

from camgen.check.stock.cells import CHORD_MM, Cells, divide
from camgen.check.stock.profile import BEAMS, slope
from camgen.geometry.segments import BoolArray, IntArray, Segments, bounds, flatten, from_contours
from camgen.model.job import Job, StockTable
from camgen.model.part import Contour, Part
from camgen.model.pose import FloatArray
from camgen.plan.recover import recover

#: A contour is a circle when it leaves one by at most this, mm, or this share of its radius, as for drilling.
_ROUND_MM, _ROUND_SHARE = 0.01, 0.01
#: Circles about one centre, mm.
_SAME_CENTRE_MM = 0.05
#: Curves of what shall be gone, as parts of a quarter circle.
_QUARTER = 16


class Task(Struct, frozen=True, eq=False):
    """One operation. job: its operation, tool and process, and the tolerances. part: as it is planned, with all its
    contours; ``part.worked`` says which of them the operation works on. bounds: ids of those that bound material,
    by which the inside is told from the outside; None: all of them.
    """

    job: Job
    part: Part
    bounds: frozenset[str] | None = None


class Lines(Struct, frozen=True, eq=False):
    """Contours on which, or beside which at ``apart`` mm, the tool runs down to ``depth`` mm. apart: 0, or from what to
    what distance, on the left (1) or the right (-1) as ``side`` says. diameter: of the tool, mm.
    """

    segments: Segments
    depth: float
    diameter: float
    apart: tuple[float, float] = (0.0, 0.0)
    side: int = 0


class Bevel(Struct, frozen=True, eq=False):
    """A chamfer. width: mm at the top face. slope: by how much it is narrower for each mm below. loops: the cells whose
    contours have it. diameter: of the tool, mm.
    """

    width: float
    slope: float
    loops: IntArray
    diameter: float

    @property
    def depth(self) -> float:
        """Down to where it reaches, mm."""
        return self.width / self.slope


class Wanted(Struct, frozen=True, eq=False):
    """What shall be gone down to ``depth`` mm. shape: polygons. room: where the tool may be for it, whose corners it
    cannot reach all. radius: of the tool, mm, 0 where no corner excuses what is left. task: which one. tabs: height and
    width of its bridges, mm, 0: none.
    """

    shape: Any
    room: Any
    radius: float
    depth: float
    task: int
    tabs: tuple[float, float] = (0.0, 0.0)


class Design(Struct, frozen=True, eq=False):
    """What may and what shall go. depth: (C + 1,) how deep each cell, the last of them the outside, may be cut, mm.

    outline: polygons of the stock. thickness: mm, None where it is not known. free: what nobody knows the limits of may
    be cut anywhere. notes: what is not judged, and why. held: contours whose inside bridges shall hold.
    """

    cells: Cells
    depth: FloatArray
    lines: tuple[Lines, ...]
    bevels: tuple[Bevel, ...]
    wanted: tuple[Wanted, ...]
    outline: Any
    thickness: float | None
    free: bool
    notes: tuple[str, ...]
    held: frozenset[str] = frozenset()


class _Draft(Struct):
    """A design as it grows, task by task."""

    cells: Cells
    depth: FloatArray
    outline: Any
    thickness: float | None
    lines: list[Lines] = []
    bevels: list[Bevel] = []
    wanted: list[Wanted] = []
    notes: list[str] = []
    free: bool = False
    held: set[str] = set()

    def allow(self, cells: Iterable[int], depth: float) -> None:
        for cell in cells:
            self.depth[cell] = max(self.depth[cell], depth)


def design(tasks: Sequence[Task], stock: StockTable) -> Design:
    """What ``tasks`` may and shall remove of ``stock``. All of them have the contours of one part.

    Contours are taken as the planner takes them: short lines that make an arc are that arc within tolerance.arc_fit.
    """
    first = tasks[0]
    contours, _ = recover(first.part.contours, first.job.tolerance.arc_fit)
    own = tuple(contour for contour in contours if not stock.layer or contour.layer != stock.layer)
    cells = divide(own)
    outline = _outline(contours, stock)
    draft = _Draft(cells, np.zeros(len(cells) + 1), outline, stock.thickness)
    for number, task in enumerate(tasks):
        kind = _kind(task)
        make = _BY_KIND.get(kind)
        if make is None:
            draft.free = True
            draft.notes.append(f"what {kind} may remove is not known: nothing is taken for a gouge")
        else:
            make(draft, task, number, [contour for contour in own if task.part.works_on((contour.id,))])
    if stock.thickness is None:
        draft.notes.append("stock.thickness is not set: what lies below, and parts that come loose, are not judged")
    return Design(
        draft.cells,
        draft.depth,
        tuple(draft.lines),
        tuple(draft.bevels),
        tuple(draft.wanted),
        draft.outline,
        draft.thickness,
        draft.free,
        tuple(draft.notes),
        frozenset(draft.held),
    )


def _outline(contours: Sequence[Contour], stock: StockTable) -> Any:
    """The stock seen from above: the contours of its layer, or a box around the drawing."""
    drawn = [contour for contour in contours if stock.layer and contour.layer == stock.layer and contour.closed]
    if drawn:
        points, owner = flatten(from_contours(drawn), CHORD_MM)
        return shapely.union_all(shapely.make_valid(shapely.polygons(shapely.linearrings(points, indices=owner))))
    if not contours:
        return shapely.box(-1e6, -1e6, 1e6, 1e6)
    boxes = bounds(from_contours(contours))
    low, high = boxes[:, :2].min(axis=0) - stock.margin, boxes[:, 2:].max(axis=0) + stock.margin
    return shapely.box(*low, *high)


def _kind(task: Task) -> str:
    kind, side = task.job.operation.kind, task.job.operation.side
    if kind == "auto":
        kind = "trace" if task.job.page.size else "follow"
    return "trace" if kind == "follow" and side == "on" else kind


def _depth(task: Task) -> float:
    """How deep an operation goes, mm; a beam goes through."""
    deep = task.job.operation.depth
    return float("inf") if task.job.tool.kind in BEAMS else deep


def _loops(draft: _Draft, worked: Sequence[Contour]) -> IntArray:
    """The cells of the contours that are worked on."""
    names = {contour.id for contour in worked}
    return np.array([k for k, name in enumerate(draft.cells.ids) if name in names], dtype=np.int64)


# One function an operation.


def _follow(draft: _Draft, task: Task, number: int, worked: Sequence[Contour]) -> None:
    """The material side of each contour stays; the other side may go as far as the next contours."""
    cells, side, deep = draft.cells, task.job.operation.side, _depth(task)
    if side in ("left", "right"):
        _follow_one_side(draft, task, worked)
        return
    loops = _loops(draft, worked)
    inside = _are_holes(cells, loops, task) if side == "auto" else np.full(len(loops), side == "inside")
    inner, outer = loops[inside], loops[~inside]
    if side == "auto":
        removed = np.unique(np.concatenate([inner, cells.parent[outer]]))
    elif side == "inside":
        removed = np.flatnonzero(cells.within(inner.tolist()))
    else:
        removed = np.flatnonzero(~cells.within(outer.tolist()))
    draft.allow(removed.tolist(), deep)
    _want_kerf(draft, task, number, loops, removed)


def _are_holes(cells: Cells, loops: IntArray, task: Task) -> BoolArray:
    """Which of the cells lie within an odd number of contours that bound material."""
    level = cells.depth[loops].copy()
    if task.bounds is not None:
        others = np.array([name not in task.bounds for name in (*cells.ids, "")])
        level -= [_count_around(cells, int(k), others) for k in loops.tolist()]
    return np.asarray(level % 2 == 1)


def _want_kerf(draft: _Draft, task: Task, number: int, loops: IntArray, removed: IntArray) -> None:
    """Beside each contour as wide as the tool."""
    cells, tool, operation = draft.cells, task.job.tool, task.job.operation
    inner = np.intersect1d(loops, removed)
    outer = np.setdiff1d(loops, inner)
    lines = shapely.boundary(cells.rings)
    asked = operation.tabs or operation.tab_spacing
    tabs = (operation.tab_height, operation.tab_width) if asked else (0.0, 0.0)
    draft.held.update(cells.ids[k] for k in outer.tolist() if asked)
    deep, radius = _depth(task), tool.diameter / 2
    if len(inner):
        rooms = cells.shapes(inner)
        band = shapely.intersection(shapely.buffer(lines[inner], tool.diameter, quad_segs=_QUARTER), rooms)
        draft.wanted += [Wanted(*pair, radius, deep, number, tabs) for pair in zip(band, rooms, strict=True)]
    around = {int(k): draft.outline - shapely.union_all(cells.rings[cells.parent == k]) for k in {cells.outside}}
    for k in outer.tolist():
        parent = int(cells.parent[k])
        room = around[parent] if parent in around else cells.shape(parent)
        band = shapely.buffer(cells.rings[k], tool.diameter, quad_segs=_QUARTER) & room
        draft.wanted.append(Wanted(band, room, radius, deep, number, tabs))


def _follow_one_side(draft: _Draft, task: Task, worked: Sequence[Contour]) -> None:
    operation, radius = task.job.operation, task.job.tool.diameter / 2
    side = 1 if operation.side == "left" else -1
    far = radius + max(operation.lead_in, operation.lead_out) + operation.finish
    for contour in worked:
        segments = from_contours([contour])
        lines = Lines(segments, _depth(task), task.job.tool.diameter, (radius, far), side)
        draft.lines.append(lines)


def _pocket(draft: _Draft, task: Task, number: int, worked: Sequence[Contour]) -> None:
    """All between the walls but for islands."""
    cells, deep = draft.cells, _depth(task)
    loops = _loops(draft, worked)
    # Of nested walls every second one is an island, whatever else of the drawing lies around all of them.
    chosen = np.zeros(len(cells) + 1, dtype=np.bool_)
    chosen[loops] = True
    level = np.array([_count_around(cells, int(k), chosen) for k in loops.tolist()], dtype=np.int64)
    floors = loops[level % 2 == 0]
    draft.allow(floors.tolist(), deep)
    radius = task.job.tool.diameter / 2
    rooms = cells.shapes(floors)
    draft.wanted += [Wanted(room, room, radius, deep, number) for room in rooms]


def _count_around(cells: Cells, cell: int, chosen: Any) -> int:
    count, cell = 0, int(cells.parent[cell])
    while cell != cells.outside:
        count += bool(chosen[cell])
        cell = int(cells.parent[cell])
    return count


def _bore(draft: _Draft, task: Task, number: int, worked: Sequence[Contour]) -> None:
    """Circles, whole: what is drawn within one goes with it."""
    cells, deep = draft.cells, _depth(task)
    loops = _circles(draft, task, worked)
    draft.allow(np.flatnonzero(cells.within(loops.tolist())).tolist(), deep)
    draft.wanted += [Wanted(cells.rings[k], cells.rings[k], 0.0, deep, number) for k in loops.tolist()]


def _drill(draft: _Draft, task: Task, number: int, worked: Sequence[Contour]) -> None:
    """Of circles about one centre the smallest; a hole as wide as the tool. Marks of a picture are where planned."""
    cells, deep, radius = draft.cells, _depth(task), task.job.tool.diameter / 2
    loops = _circles(draft, task, worked)
    if task.part.raster is not None:
        draft.free = True
        draft.notes.append("holes at marks of a picture are not judged: nothing is taken for a gouge")
        return
    draft.allow(np.flatnonzero(cells.within(loops.tolist())).tolist(), deep)
    middles = shapely.points([_middle(cells.rings[k]) for k in loops.tolist()]) if len(loops) else np.zeros(0, object)
    wide = np.minimum(radius, np.sqrt(cells.area[loops] / np.pi))
    discs = shapely.buffer(middles, wide, quad_segs=2 * _QUARTER)
    draft.wanted += [Wanted(disc, disc, 0.0, deep, number) for disc in discs]


def _circles(draft: _Draft, task: Task, worked: Sequence[Contour]) -> IntArray:
    """The innermost circles about each centre whose diameters are wanted."""
    cells, loops = draft.cells, _loops(draft, worked)
    low, high = task.job.operation.holes or (0.0, float("inf"))
    round_ = [
        (int(k), *_middle(cells.rings[k]), float(np.sqrt(cells.area[k] / np.pi))) for k in loops if _is_round(cells, k)
    ]
    round_.sort(key=lambda one: one[3])
    kept: list[tuple[int, float, float, float]] = []
    if round_:
        places = shapely.points([(x, y) for _, x, y, _ in round_])
        one, two = shapely.STRtree(places).query(places, predicate="dwithin", distance=_SAME_CENTRE_MM)
        larger = set(one[two < one].tolist())
        kept = [circle for n, circle in enumerate(round_) if n not in larger]
    return np.array([k for k, _, _, r in kept if low - 1e-9 <= 2 * r <= high + 1e-9], dtype=np.int64)


def _middle(ring: Any) -> tuple[float, float]:
    low_x, low_y, high_x, high_y = shapely.bounds(ring).tolist()
    return (low_x + high_x) / 2, (low_y + high_y) / 2


def _is_round(cells: Cells, loop: int) -> bool:
    points = shapely.get_coordinates(cells.rings[loop])
    apart = np.hypot(*(points - _middle(cells.rings[loop])).T)
    slack = max(_ROUND_MM, _ROUND_SHARE * float(apart.mean())) + CHORD_MM
    return len(points) > 6 and float(np.ptp(apart)) <= 2 * slack


def _trace(draft: _Draft, task: Task, number: int, worked: Sequence[Contour]) -> None:  # noqa: ARG001 (as the others)
    """The lines, as wide as the tool."""
    if worked:
        draft.lines.append(Lines(from_contours(worked), _depth(task), task.job.tool.diameter))


def _fill(draft: _Draft, task: Task, number: int, worked: Sequence[Contour]) -> None:
    """What closed contours enclose, even-odd; thin places by their middle."""
    _pocket(draft, task, number, worked)
    radius = task.job.tool.diameter / 2
    if worked:
        lines = from_contours(worked)
        draft.lines.append(Lines(lines, _depth(task), task.job.tool.diameter, (0.0, radius)))


def _chamfer(draft: _Draft, task: Task, number: int, worked: Sequence[Contour]) -> None:  # noqa: ARG001 (as the others)
    """A cone on the material side of the contours; on their other side the tip may go down to ``operation.depth``, else
    twice as deep as the chamfer.
    """
    cells, operation, tool = draft.cells, task.job.operation, task.job.tool
    width = operation.width or operation.depth * slope(tool)
    loops = _loops(draft, worked)
    draft.bevels.append(Bevel(width, slope(tool), loops, tool.diameter))
    auto = operation.side == "auto"
    inside = _are_holes(cells, loops, task) if auto else np.full(len(loops), operation.side == "inside")
    beside = np.concatenate([loops[inside], cells.parent[loops[~inside]]])
    draft.allow(beside.tolist(), operation.depth or 2 * width / slope(tool))


_BY_KIND: dict[str, Callable[[_Draft, Task, int, Sequence[Contour]], None]] = {
    "follow": _follow, "pocket": _pocket, "bore": _bore, "drill": _drill, "trace": _trace, "engrave": _trace,
    "fill": _fill, "chamfer": _chamfer,
}  # fmt: skip
