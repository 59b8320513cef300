"""What the operations of a job may take away and what they shall, by place and depth, from the drawing alone."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
import shapely
from msgspec import Struct
from msgspec.structs import replace

from camgen.check.stock.cells import CHORD_MM, Cells, divide
from camgen.check.stock.profile import BEAMS, slope
from camgen.geometry.nesting import find_nesting
from camgen.geometry.segments import (
    BoolArray,
    IntArray,
    Segments,
    compute_bounds,
    flatten,
    from_contours,
)
from camgen.model.job import Job, StockTable
from camgen.model.part import Contour, Part
from camgen.model.pose import FloatArray
from camgen.model.tolerance import BESIDE_WORKED_MM
from camgen.plan.recover import recover

#: A contour is a circle when it leaves one by at most this, mm, or this share of its radius, as for drilling.
_ROUND_MM, _ROUND_SHARE = 0.01, 0.01
#: Circles about one centre, mm.
_SAME_CENTRE_MM = 0.05
#: The tip of a chamfering tool runs beside the wall by at most this, mm, below the bevel.
_TIP_MM = 0.5
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


def task_on(part: Part, job: Job, own: Part) -> Task:
    """One of several operations on ``part``. own: the part as it works on it, with what bounds material for it."""
    return Task(
        job, replace(part, worked=own.worked), frozenset(contour.id for contour in own.contours)
    )


class Lines(Struct, frozen=True, eq=False):
    """Contours on which, or beside which at ``apart`` mm, the tool runs down to ``depth`` mm. apart: 0, or from what to
    what distance, on the left (1) or the right (-1) as ``side`` says. diameter: of the tool, mm.
    """

    segments: Segments
    depth: float
    diameter: float
    apart: tuple[float, float] = (0.0, 0.0)
    side: int = 0


class Recess(Struct, frozen=True, eq=False):
    """A pocket whose walls cross contours of other operations, such as at an edge of the part.

    It divides no cells. A motion that leaves it is judged as if it was not there.

    shape: polygons of it.
    depth: depth down to which it may be cut, mm.
    """

    shape: Any
    depth: float


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
    """Material that an operation has to remove.

    shape: polygons of it.
    room: where the tool may be for it; it cannot reach all corners.
    radius: radius of the tool, mm; 0 if no corner excuses material that is left.
    depth: depth down to which it goes, mm.
    task: number of its task.
    tabs: height of the bridges, their width, and the length of both slopes, mm; all 0 without any.
    loop: contour beside which a kerf runs; -1 for other shapes.
    cell: cell in which a kerf is.
    ring: that contour as a polygon. `lay_out` makes shape, room and ring of a kerf if something is
        left of it.
    """

    shape: Any
    room: Any
    radius: float
    depth: float
    task: int
    tabs: tuple[float, float, float] = (0.0, 0.0, 0.0)
    loop: int = -1
    cell: int = -1
    ring: Any = None


class Tabbed(Struct, frozen=True, eq=False):
    """A contour across whose kerf the job asks for bridges.

    loop: number of its cell.
    inside: whether the tool runs on its inner side.
    job: the job of its operation.
    around: cells of the parts with bridges within it, for whose sake it has its own; none where it
        has them for itself.
    """

    loop: int
    inside: bool
    job: Job
    around: tuple[int, ...] = ()

    def count(self, length: float) -> int:
        """The number of bridges that the job asks for on a path of a length, mm."""
        operation = self.job.operation
        if operation.tabs:
            return operation.tabs
        slack = 0.1 + 4 * math.pi * operation.finish
        return max(2, math.ceil((length - slack) / (operation.tab_spacing or math.inf)))


class Design(Struct, frozen=True, eq=False):
    """Material that the operations may remove, and material that they shall remove.

    cells: the cells of the drawing.
    depth: (C + 1,) depth to which each cell may be cut, mm; the last of them is the outside.
    lines: contours along which a tool cuts.
    bevels: chamfers.
    wanted: material that shall be gone.
    outline: polygons of the stock.
    thickness: thickness of the stock, mm; None if it is not known.
    free: whether anything may be cut, because the limits of an operation are not known.
    notes: parts of the proof that are missing, with the reasons.
    tabbed: contours with bridges.
    waste: cells within holes along whose contour a tool cuts: they are waste though they may not be
        cut.
    untaken: polygons of material that paths would take which are left out; None: no such paths.
    recesses: pockets across contours of other operations.
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
    tabbed: tuple[Tabbed, ...] = ()
    waste: tuple[int, ...] = ()
    untaken: Any = None
    recesses: tuple[Recess, ...] = ()


def lay_out(design: Design, wanted: Sequence[Wanted]) -> list[Wanted]:
    """Those of kerfs with their shapes: as wide as the tool beside the contour."""
    cells = design.cells
    made = []
    rooms: dict[int, Any] = {cells.outside: None}
    for one in wanted:
        if one.loop < 0:
            made.append(one)
            continue
        if rooms.get(one.cell) is None:
            outer = cells.rings[cells.parent == cells.outside]
            whole = one.cell == cells.outside
            rooms[one.cell] = (
                design.outline - shapely.union_all(outer) if whole else cells.shape(one.cell)
            )
        room, ring = rooms[one.cell], cells.rings[one.loop]
        edge = ring if one.cell != one.loop else shapely.boundary(ring)
        band = shapely.buffer(edge, 2 * one.radius, quad_segs=_QUARTER)
        made.append(replace(one, shape=shapely.intersection(band, room), room=room, ring=ring))
    return made


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
    tabbed: list[Tabbed] = []
    waste: set[int] = set()
    recesses: list[Recess] = []
    #: Distance beside a contour at which the tool goes back to the next operation, mm.
    aside: float = 0.0

    def allow(self, cells: Iterable[int], depth: float) -> None:
        for cell in cells:
            self.depth[cell] = max(self.depth[cell], depth)


def design(tasks: Sequence[Task], stock: StockTable, untaken: Any = None) -> Design:
    """What ``tasks`` may and shall remove of ``stock``. All of them have the contours of one part. untaken: as in
    ``Design``.

    Contours are taken as the planner takes them: short lines that make an arc are that arc within tolerance.arc_fit.
    """
    first = tasks[0]
    contours, _ = recover(first.part.contours, first.job.tolerance.arc_fit)
    own = tuple(contour for contour in contours if not stock.layer or contour.layer != stock.layer)
    across = _find_across(own, tasks)
    cells = divide(tuple(contour for contour in own if contour.id not in across))
    outline = _outline(contours, stock)
    draft = _Draft(cells, np.zeros(len(cells) + 1), outline, stock.thickness)
    if any(task.job.process.stay_down for task in tasks):
        draft.aside = BESIDE_WORKED_MM
    for number, task in enumerate(tasks):
        kind = _kind(task)
        make = _BY_KIND.get(kind)
        if make is None:
            draft.free = True
            draft.notes.append(f"what {kind} may remove is not known: nothing is taken for a gouge")
        else:
            make(
                draft,
                task,
                number,
                [
                    contour
                    for contour in own
                    if task.part.works_on(contour.sources or (contour.id,))
                ],
            )
    if stock.thickness is None:
        draft.notes.append(
            "stock.thickness is not set: cuts below the stock, and pieces that come loose, are not judged"
        )
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
        tuple(draft.tabbed),
        tuple(sorted(draft.waste)),
        untaken,
        tuple(draft.recesses),
    )


def _find_across(contours: Sequence[Contour], tasks: Sequence[Task]) -> frozenset[str]:
    """Walls of pockets that cross contours of other operations, and the islands within them.

    Without them the other contours divide the plane. Empty if walls of pockets cross each other
    there, or if another operation works on one of them.
    """
    pocketed: set[str] = set()
    others: set[str] = set()
    for task in tasks:
        names = _name_worked(contours, task)
        if _kind(task) == "pocket":
            pocketed |= names
        elif _kind(task) not in ("drill", "bore"):  # these choose circles among their contours
            others |= names
    closed = [contour for contour in contours if contour.closed]
    walls = [contour for contour in closed if contour.id in pocketed]
    across = _name_crossed(closed) & pocketed if walls else set[str]()
    if not across:
        return frozenset()
    points, owner = flatten(from_contours(walls), CHORD_MM)
    rings = shapely.make_valid(shapely.polygons(shapely.linearrings(points, indices=owner)))
    is_across = np.array([contour.id in across for contour in walls])
    near = shapely.intersects(rings, shapely.union_all(rings[is_across]))
    names = {walls[k].id for k in np.flatnonzero(near).tolist()}
    return frozenset() if names & (others | _name_crossed(walls)) else frozenset(names)


def _name_worked(contours: Sequence[Contour], task: Task) -> set[str]:
    return {
        contour.id for contour in contours if task.part.works_on(contour.sources or (contour.id,))
    }


def _name_crossed(closed: Sequence[Contour]) -> set[str]:
    """The ids of closed contours that cross another one, or themselves."""
    if not closed:
        return set()
    crossed = find_nesting(from_contours(closed), len(closed)).crossed >= 0
    return {closed[k].id for k in np.flatnonzero(crossed).tolist()}


def _outline(contours: Sequence[Contour], stock: StockTable) -> Any:
    """The stock seen from above: the contours of its layer, or a box around the drawing."""
    drawn = [
        contour
        for contour in contours
        if stock.layer and contour.layer == stock.layer and contour.closed
    ]
    if drawn:
        points, owner = flatten(from_contours(drawn), CHORD_MM)
        return shapely.union_all(
            shapely.make_valid(shapely.polygons(shapely.linearrings(points, indices=owner)))
        )
    if not contours:
        return shapely.box(-1e6, -1e6, 1e6, 1e6)
    boxes = compute_bounds(from_contours(contours))
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
    inside = (
        _are_holes(cells, loops, task) if side == "auto" else np.full(len(loops), side == "inside")
    )
    inner, outer = loops[inside], loops[~inside]
    if side == "auto":
        removed = _joined(cells, task, np.unique(np.concatenate([inner, cells.parent[outer]])))
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
        others = np.array([name not in task.bounds for name in cells.ids], dtype=np.bool_)
        around = _add_inwards(cells, others)
        level -= around[cells.parent[loops]]
    return np.asarray(level % 2 == 1)


def _add_inwards(cells: Cells, chosen: BoolArray) -> IntArray:
    """(C + 1,) how many of the ``chosen`` contours (C,) lie around each cell, its own with them."""
    count = np.zeros(len(cells) + 1, dtype=np.int64)
    for k in np.argsort(cells.depth, kind="stable").tolist():
        count[k] = count[cells.parent[k]] + chosen[k]
    return count


def _joined(cells: Cells, task: Task, chosen: IntArray) -> IntArray:
    """The ``chosen`` cells and all that no contour which bounds material parts from them."""
    if task.bounds is None:
        return chosen
    group = np.arange(len(cells) + 1)
    for k in np.argsort(cells.depth, kind="stable").tolist():
        if cells.ids[k] not in task.bounds:
            group[k] = group[cells.parent[k]]
    return np.flatnonzero(np.isin(group, group[chosen]))


def _want_kerf(draft: _Draft, task: Task, number: int, loops: IntArray, removed: IntArray) -> None:
    """Beside each contour as wide as the tool."""
    cells, tool, operation = draft.cells, task.job.tool, task.job.operation
    inner = np.intersect1d(loops, removed)
    outer = np.setdiff1d(loops, inner)
    asked = operation.tabs or operation.tab_spacing
    steepest = 45.0 if operation.entry == "plunge" else operation.entry_angle
    slopes = operation.tab_height * (1 + 1 / math.tan(math.radians(steepest)))
    tabs = (operation.tab_height, operation.tab_width, slopes) if asked else (0.0, 0.0, 0.0)
    if asked:
        draft.tabbed += _list_tabbed(cells, task.job, inner.tolist(), outer.tolist())
    deep, radius = _depth(task), tool.radius
    for k in (*inner.tolist(), *outer.tolist()):
        cell = k if k in inner else int(cells.parent[k])
        draft.wanted.append(Wanted(None, None, radius, deep, number, tabs, k, cell))


def _list_tabbed(
    cells: Cells, job: Job, inner: Sequence[int], outer: Sequence[int]
) -> list[Tabbed]:
    """Contours with bridges: outlines of parts, and the holes around them.

    If an operation cuts no part out, its bridges stand in the holes and hold their slugs.
    """
    if not outer:
        return _list_slugs(cells, job, inner)
    around: dict[int, list[int]] = {k: [] for k in inner}
    for k in outer:
        cell = int(cells.parent[k])
        while cell != cells.outside:
            if cell in around:
                around[cell].append(k)
            cell = int(cells.parent[cell])
    outlines = [Tabbed(k, False, job) for k in outer]
    holes = [Tabbed(k, True, job, tuple(parts)) for k, parts in around.items() if parts]
    return outlines + holes


def _list_slugs(cells: Cells, job: Job, inner: Sequence[int]) -> list[Tabbed]:
    """Holes with a slug that is larger than a chip."""
    slugs = shapely.buffer(cells.rings[list(inner)], -job.tool.diameter, quad_segs=_QUARTER)
    tabbed = []
    for k, slug in zip(inner, slugs, strict=True):
        area = float(shapely.area(shapely.get_parts(slug)).max(initial=0.0))
        if area >= job.tool.chip_area:
            tabbed.append(Tabbed(k, True, job))
    return tabbed


def _follow_one_side(draft: _Draft, task: Task, worked: Sequence[Contour]) -> None:
    operation, radius = task.job.operation, task.job.tool.radius
    side = 1 if operation.side == "left" else -1
    far = radius + max(operation.lead_in, operation.lead_out, draft.aside) + operation.finish
    _note_waste(draft, task, worked)
    for contour in worked:
        segments = from_contours([contour])
        lines = Lines(segments, _depth(task), task.job.tool.diameter, (radius, far), side)
        draft.lines.append(lines)


def _note_waste(draft: _Draft, task: Task, worked: Sequence[Contour]) -> None:
    """Notes the cells within holes along whose contours the tool cuts."""
    loops = _loops(draft, worked)
    draft.waste.update(loops[_are_holes(draft.cells, loops, task)].tolist())


def _pocket(draft: _Draft, task: Task, number: int, worked: Sequence[Contour]) -> None:
    """All between walls and islands, whatever else is drawn there: what other operations work on is no island."""
    cells, deep = draft.cells, _depth(task)
    loops = _loops(draft, worked)
    # Around each cell, its own contour with it, so many of these: an odd number of them makes it a floor.
    around = _add_inwards(cells, np.isin(np.arange(len(cells)), loops))
    draft.allow(np.flatnonzero(around % 2 == 1).tolist(), deep)
    radius = task.job.tool.radius
    walls, islands = loops[around[loops] % 2 == 1], loops[around[loops] % 2 == 0]
    rooms = cells.rings[walls]
    if len(islands):
        kept = shapely.union_all(cells.rings[islands])
        # What lies in an island is a pocket again, and a room of its own.
        rooms = shapely.difference(rooms, kept)
        nested = around[walls] > 1
        rooms[nested] = cells.rings[walls[nested]]
    shapes = [*rooms, *_find_recesses(draft, worked)]
    draft.recesses += [Recess(shape, deep) for shape in shapes[len(rooms) :]]
    draft.wanted += [Wanted(shape, shape, radius, deep, number) for shape in shapes]


def _find_recesses(draft: _Draft, worked: Sequence[Contour]) -> list[Any]:
    """The pockets whose walls divide no cells, by the even-odd rule."""
    known = {*draft.cells.ids, *(contour.id for contour in draft.cells.left)}
    walls = [contour for contour in worked if contour.closed and contour.id not in known]
    if not walls:
        return []
    points, owner = flatten(from_contours(walls), CHORD_MM)
    rings = shapely.make_valid(shapely.polygons(shapely.linearrings(points, indices=owner)))
    region = shapely.Polygon()
    for ring in rings:
        region = shapely.symmetric_difference(region, ring)
    return list(shapely.get_parts(region))


def _bore(draft: _Draft, task: Task, number: int, worked: Sequence[Contour]) -> None:
    """Circles, whole: what is drawn within one goes with it."""
    cells, deep = draft.cells, _depth(task)
    loops = _circles(draft, task, worked)
    draft.allow(np.flatnonzero(cells.within(loops.tolist())).tolist(), deep)
    draft.wanted += [
        Wanted(cells.rings[k], cells.rings[k], 0.0, deep, number) for k in loops.tolist()
    ]


def _drill(draft: _Draft, task: Task, number: int, worked: Sequence[Contour]) -> None:
    """Of circles about one centre the smallest; a hole as wide as the tool. Marks of a picture are where planned."""
    cells, deep, radius = draft.cells, _depth(task), task.job.tool.radius
    loops = _circles(draft, task, worked)
    if task.part.raster is not None:
        draft.free = True
        draft.notes.append(
            "holes at marks of a picture are not judged: nothing is taken for a gouge"
        )
        return
    draft.allow(np.flatnonzero(cells.within(loops.tolist())).tolist(), deep)
    middles = (
        shapely.points([_middle(cells.rings[k]) for k in loops.tolist()])
        if len(loops)
        else np.zeros(0, object)
    )
    wide = np.minimum(radius, np.sqrt(cells.area[loops] / np.pi))
    discs = shapely.buffer(middles, wide, quad_segs=2 * _QUARTER)
    draft.wanted += [Wanted(disc, disc, 0.0, deep, number) for disc in discs]


def _circles(draft: _Draft, task: Task, worked: Sequence[Contour]) -> IntArray:
    """The innermost circles about each centre whose diameters are wanted; of those to bore, of the wanted ones."""
    cells = draft.cells
    low, high = task.job.operation.holes or (0.0, float("inf"))
    found = np.array(
        [k for k in _loops(draft, worked).tolist() if _is_round(cells, k)], dtype=np.int64
    )
    wide = 2 * np.sqrt(cells.area / np.pi)
    chosen = (wide[found] >= low - _ROUND_MM) & (wide[found] <= high + _ROUND_MM)
    if _kind(task) == "bore":
        return _innermost(cells, found[chosen])
    inner = _innermost(cells, found)
    return inner[np.isin(inner, found[chosen])]


def _innermost(cells: Cells, loops: IntArray) -> IntArray:
    """Of circles about one centre the smallest."""
    if not len(loops):
        return loops
    loops = loops[np.argsort(cells.area[loops], kind="stable")]
    places = shapely.points([_middle(cells.rings[k]) for k in loops.tolist()])
    one, two = shapely.STRtree(places).query(places, predicate="dwithin", distance=_SAME_CENTRE_MM)
    return np.delete(loops, one[two < one])


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
    _note_waste(draft, task, worked)
    if worked:
        draft.lines.append(Lines(from_contours(worked), _depth(task), task.job.tool.diameter))


def _fill(draft: _Draft, task: Task, number: int, worked: Sequence[Contour]) -> None:
    """What closed contours enclose, even-odd; thin places by their middle."""
    _pocket(draft, task, number, worked)
    radius = task.job.tool.radius
    if worked:
        lines = from_contours(worked)
        draft.lines.append(Lines(lines, _depth(task), task.job.tool.diameter, (0.0, radius)))


def _chamfer(draft: _Draft, task: Task, number: int, worked: Sequence[Contour]) -> None:  # noqa: ARG001 (as the others)
    """A cone on the material side of the contours; on their other side the tip may run ``_TIP_MM`` beside it."""
    cells, operation, tool = draft.cells, task.job.operation, task.job.tool
    width = operation.width or operation.depth * slope(tool)
    loops = _loops(draft, worked)
    draft.bevels.append(Bevel(width, slope(tool), loops, tool.diameter))
    auto = operation.side == "auto"
    inside = (
        _are_holes(cells, loops, task) if auto else np.full(len(loops), operation.side == "inside")
    )
    beside = np.concatenate([loops[inside], cells.parent[loops[~inside]]])
    draft.allow(beside.tolist(), operation.depth or (width + _TIP_MM) / slope(tool))


_BY_KIND: dict[str, Callable[[_Draft, Task, int, Sequence[Contour]], None]] = {
    "follow": _follow, "pocket": _pocket, "bore": _bore, "drill": _drill, "trace": _trace, "engrave": _trace,
    "fill": _fill, "chamfer": _chamfer,
}  # fmt: skip


def show_stay(design: Design, depth: float) -> Any:
    """Polygons of what must stay at ``depth`` mm, for pictures; where operations along lines cut, it is cut out."""
    stays = design.depth < depth
    whole = design.outline if stays[-1] else shapely.Polygon()
    by_depth = np.argsort(design.cells.depth, kind="stable")
    for cell in by_depth.tolist():
        ring = design.cells.rings[cell]
        whole = shapely.union(whole, ring) if stays[cell] else shapely.difference(whole, ring)
    for lines in design.lines:
        if lines.depth >= depth:
            points, owner = flatten(lines.segments, CHORD_MM)
            ways = [
                shapely.LineString(
                    np.concatenate(
                        [points[owner == k], lines.segments.end[lines.segments.owner == k][-1:]]
                    )
                )
                for k in np.unique(owner)
            ]
            whole = shapely.difference(
                whole, shapely.union_all(shapely.buffer(ways, lines.diameter / 2 + lines.apart[1]))
            )
    recesses = [recess.shape for recess in design.recesses if recess.depth >= depth]
    return shapely.difference(whole, shapely.union_all(recesses)) if recesses else whole
