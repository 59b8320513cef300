"""Computes from the drawing alone which material the operations may remove and which they must."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from itertools import compress
from typing import Any

import numpy as np
import shapely
from msgspec import Struct
from msgspec.structs import replace

from camgen.check.stock.cells import CHORD_MM, Cells, make_cells
from camgen.check.stock.profile import BEAMS, compute_radius, compute_slope
from camgen.check.stock.walls import Task, choose_walls, get_kind, is_within, make_polygons
from camgen.geometry.nesting import measure_loop_areas
from camgen.geometry.segments import (
    BoolArray,
    IntArray,
    Segments,
    compute_bounds,
    flatten,
    make_contour_segments,
)
from camgen.model.job import Job, StockTable
from camgen.model.part import Contour, list_ids, select_closed
from camgen.model.pose import FloatArray
from camgen.model.tolerance import BESIDE_WORKED_MM
from camgen.plan.recover import recover_arcs

#: A contour is a circle if it deviates from one by at most this, mm, or this fraction of its
#: radius; the same as for drilling.
_ROUND_MM, _ROUND_FRACTION = 0.01, 0.01
#: mm: circles whose centres are nearer are concentric.
_SAME_CENTRE_MM = 0.05
#: mm: maximum distance from the wall at which the tip of a chamfering tool runs, below the bevel.
_TIP_MM = 0.5
#: Chords of a quarter circle in shapes of material that must be removed.
_QUARTER = 16


class Lines(Struct, frozen=True, eq=False):
    """Contours along which the tool runs.

    segments: the contours.
    depth: depth down to which the tool runs, mm.
    diameter: diameter of the tool, mm.
    distances: minimum and maximum distance of the tool's centre from the contours, mm.
    side: side of the contours, 1 for left and -1 for right, 0 for both.
    """

    segments: Segments
    depth: float
    diameter: float
    distances: tuple[float, float] = (0.0, 0.0)
    side: int = 0


class Recess(Struct, frozen=True, eq=False):
    """A pocket or a hole whose walls cross other contours, such as at an edge of the part.

    It divides no cells. A motion that leaves it is judged as if the recess did not exist.

    shape: its polygons.
    depth: depth down to which it may be cut, mm.
    """

    shape: Any
    depth: float


class Bevel(Struct, frozen=True, eq=False):
    """A chamfer.

    width: width at the top face, mm.
    slope: decrease of the width per mm of depth.
    loops: cells whose contours have it.
    diameter: diameter of the tool, mm.
    """

    width: float
    slope: float
    loops: IntArray
    diameter: float

    @property
    def depth(self) -> float:
        """The depth of the chamfer, mm."""
        return self.width / self.slope


class Wanted(Struct, frozen=True, eq=False):
    """Material that an operation has to remove.

    shape: its polygons.
    room: area in which the tool may be; it cannot reach all corners of it.
    radius: radius of the tool, mm; 0 if no corner excuses rest material.
    depth: depth down to which it goes, mm.
    tabs: height of the tabs, their width, and the length of both slopes, mm; all 0 without tabs.
    loop: contour beside which a kerf runs; -1 for other shapes.
    cell: cell that contains a kerf.
    ring: polygon of this contour. `make_kerfs` makes shape, room and ring of the kerfs that are not
        cleared.
    """

    shape: Any
    room: Any
    radius: float
    depth: float
    tabs: tuple[float, float, float] = (0.0, 0.0, 0.0)
    loop: int = -1
    cell: int = -1
    ring: Any = None


class Tabbed(Struct, frozen=True, eq=False):
    """A contour whose kerf has tabs.

    loop: number of its cell.
    inside: whether the tool runs on its inner side.
    job: the job of its operation.
    around: cells of the parts with tabs within it, which are the reason for its own tabs; empty if
        the tabs hold its slug.
    """

    loop: int
    inside: bool
    job: Job
    around: tuple[int, ...] = ()

    def count(self, length: float) -> int:
        """Return the number of tabs that the job asks for on a path of a length, mm."""
        operation = self.job.operation
        if operation.tabs:
            return operation.tabs
        slack = 0.1 + 4 * math.pi * operation.finish
        return max(2, math.ceil((length - slack) / (operation.tab_spacing or math.inf)))


class Design(Struct, eq=False):
    """Material that the operations may remove, and material that they must remove.

    `design` makes it: each task adds what it may and must remove.

    cells: the cells of the drawing.
    depth: (C + 1,) depth to which each cell may be cut, mm; the last of them is the outside.
    outline: polygons of the stock.
    thickness: thickness of the stock, mm; None if it is unknown.
    untaken: polygons of material that paths would remove which are left out; None: no such paths.
    aside: distance from a contour at which the tool returns to the next operation, mm.
    lines: contours along which a tool cuts.
    bevels: chamfers.
    wanted: material that must be removed.
    recesses: pockets across contours of other operations, and holes across other contours.
    across: walls and islands of these pockets, which divide no cells.
    tabbed: contours with tabs.
    waste: cells within holes along whose contour a tool cuts: they are waste, although they may not
        be cut.
    free: whether anything may be cut, because the limits of an operation are unknown.
    notes: parts of the proof that are missing, with the reasons.
    """

    cells: Cells
    depth: FloatArray
    outline: Any
    thickness: float | None
    untaken: Any
    aside: float
    lines: list[Lines] = []
    bevels: list[Bevel] = []
    wanted: list[Wanted] = []
    recesses: list[Recess] = []
    across: Sequence[Contour] = ()
    tabbed: list[Tabbed] = []
    waste: set[int] = set()
    free: bool = False
    notes: list[str] = []

    def allow(self, cells: Iterable[int], depth: float) -> None:
        """Allow cuts in some cells down to a depth, mm."""
        for cell in cells:
            self.depth[cell] = max(self.depth[cell], depth)


def make_kerfs(design: Design, wanted: Sequence[Wanted]) -> list[Wanted]:
    """Return `wanted` with the shapes of kerfs, which are as wide as the tool."""
    cells = design.cells
    result = []
    rooms: dict[int, Any] = {}
    for want in wanted:
        if want.loop < 0:
            result.append(want)
            continue
        if want.cell not in rooms and want.cell == cells.outside:
            outer = cells.rings[cells.parent == cells.outside]
            rooms[want.cell] = design.outline - shapely.union_all(outer)
        elif want.cell not in rooms:
            rooms[want.cell] = cells.shape(want.cell)
        room, ring = rooms[want.cell], cells.rings[want.loop]
        edge = ring if want.cell != want.loop else shapely.boundary(ring)
        band = shapely.buffer(edge, 2 * want.radius, quad_segs=_QUARTER)
        result.append(replace(want, shape=shapely.intersection(band, room), room=room, ring=ring))
    return result


def design(tasks: Sequence[Task], stock: StockTable, untaken: Any = None) -> Design:
    """Compute the material that `tasks` may remove and must remove of `stock`.

    All tasks have the contours of one part. As in the planner, short lines that form an arc within
    tolerance.arc_fit are that arc.

    untaken: polygons of material that paths would remove which are left out; None: no such paths.
    """
    first = tasks[0]
    contours, _ = recover_arcs(first.part.contours, first.job.tolerance.arc_fit)
    inner = tuple(
        contour for contour in contours if not stock.layer or contour.layer != stock.layer
    )
    walls = choose_walls(inner, tasks)
    cells = make_cells(walls.dividing)
    stays_down = any(task.job.process.stay_down for task in tasks)
    draft = Design(
        cells,
        np.zeros(len(cells) + 1),
        _make_outline(contours, stock),
        stock.thickness,
        untaken,
        BESIDE_WORKED_MM if stays_down else 0.0,
        across=walls.across,
    )
    for task, worked in zip(tasks, walls.worked, strict=True):
        kind = get_kind(task)
        add = _BY_KIND.get(kind)
        if add is None:
            draft.free = True
            draft.notes.append(
                f"the material that {kind} may remove is not known: no cut counts as a gouge"
            )
        else:
            add(draft, task, worked)
    if stock.thickness is None:
        draft.notes.append(
            "stock.thickness is not set: "
            "cuts below the stock, and pieces that come loose, are not judged"
        )
    return draft


def _make_outline(contours: Sequence[Contour], stock: StockTable) -> Any:
    """Make the stock seen from above: the contours of its layer, or a box around the drawing."""
    if stock.layer:
        drawn = [contour for contour in select_closed(contours) if contour.layer == stock.layer]
        if drawn:
            return shapely.union_all(make_polygons(drawn))
    if not contours:
        return shapely.box(-1e6, -1e6, 1e6, 1e6)
    boxes = compute_bounds(make_contour_segments(contours))
    low, high = boxes[:, :2].min(axis=0) - stock.margin, boxes[:, 2:].max(axis=0) + stock.margin
    return shapely.box(*low, *high)


def _get_depth(task: Task) -> float:
    """Return the depth of an operation, mm; a beam goes through."""
    return math.inf if task.job.tool.kind in BEAMS else task.job.operation.depth


def _find_loops(draft: Design, worked: Sequence[Contour]) -> IntArray:
    names = set(list_ids(worked))
    return np.flatnonzero([name in names for name in draft.cells.ids])


def _follow(draft: Design, task: Task, worked: Sequence[Contour]) -> None:
    """The material side of each contour stays; the other side may be cut to the next contours."""
    cells, side = draft.cells, task.job.operation.side
    if side in ("left", "right"):
        _add_waste(draft, task, worked)
        _follow_lines(draft, task, worked)
        return
    loops = _find_loops(draft, worked)
    inside = _are_inside(draft, loops, task)
    inner, outer = loops[inside], loops[~inside]
    if side == "auto":
        cut = np.unique(np.concatenate([inner, cells.parent[outer]]))
        removed = _add_joined(cells, task, cut)
    elif side == "inside":
        removed = np.flatnonzero(cells.within(inner.tolist()))
    else:
        within = cells.within(outer.tolist())
        removed = np.flatnonzero(~within)
        # Within another loop that is followed on its outside, the tool keeps to its kerf.
        nested = outer[within[cells.parent[outer]]]
        names = {cells.ids[k] for k in nested.tolist()}
        _follow_lines(draft, task, [contour for contour in worked if contour.id in names])
        loops = np.setdiff1d(loops, nested)
    draft.allow(removed.tolist(), _get_depth(task))
    _add_kerfs(draft, task, loops, removed)


def _are_inside(draft: Design, loops: IntArray, task: Task) -> BoolArray:
    """Whether the tool runs on the inner side of each contour, as `operation.side` states."""
    side = task.job.operation.side
    if side == "auto":
        return _are_holes(draft, loops, task)
    return np.full(len(loops), side == "inside")


def _are_holes(draft: Design, loops: IntArray, task: Task) -> BoolArray:
    """Whether each cell lies within an odd number of contours that bound material."""
    cells = draft.cells
    level = cells.depth[loops].copy()
    around = [contour for contour in draft.across if is_within(contour, task)]
    if around:
        starts = cells.segments.start[np.searchsorted(cells.segments.owner, loops)]
        for ring in make_polygons(around):
            level += shapely.contains_xy(ring, starts)
    if task.bounds is not None:
        others = np.array([name not in task.bounds for name in cells.ids], dtype=np.bool_)
        level -= _count_around(cells, others)[cells.parent[loops]]
    return np.asarray(level % 2 == 1)


def _count_around(cells: Cells, chosen: BoolArray) -> IntArray:
    """Count the `chosen` contours (C,) around each cell (C + 1,), its own contour included."""
    count = np.zeros(len(cells) + 1, dtype=np.int64)
    for k in np.argsort(cells.depth, kind="stable").tolist():
        count[k] = count[cells.parent[k]] + chosen[k]
    return count


def _add_joined(cells: Cells, task: Task, chosen: IntArray) -> IntArray:
    """Add to `chosen` all cells that no contour which bounds material separates from them."""
    if task.bounds is None:
        return chosen
    group = np.arange(len(cells) + 1)
    for k in np.argsort(cells.depth, kind="stable").tolist():
        if cells.ids[k] not in task.bounds:
            group[k] = group[cells.parent[k]]
    return np.flatnonzero(np.isin(group, group[chosen]))


def _add_kerfs(draft: Design, task: Task, loops: IntArray, removed: IntArray) -> None:
    cells, operation = draft.cells, task.job.operation
    inner = np.intersect1d(loops, removed)
    outer = np.setdiff1d(loops, inner)
    tabs = (0.0, 0.0, 0.0)
    if operation.tabs or operation.tab_spacing:
        steepest = 45.0 if operation.entry == "plunge" else operation.entry_angle
        slopes = operation.tab_height * (1 + 1 / math.tan(math.radians(steepest)))
        tabs = (operation.tab_height, operation.tab_width, slopes)
        draft.tabbed += _list_tabbed(cells, task.job, inner.tolist(), outer.tolist())
    depth, radius = _get_depth(task), task.job.tool.radius
    for k in (*inner.tolist(), *outer.tolist()):
        cell = k if k in inner else int(cells.parent[k])
        draft.wanted.append(Wanted(None, None, radius, depth, tabs, k, cell))


def _list_tabbed(
    cells: Cells, job: Job, inner: Sequence[int], outer: Sequence[int]
) -> list[Tabbed]:
    """List the contours with tabs: outlines of parts, and the holes around them.

    If an operation cuts no part out, its tabs are in the holes and hold their slugs.
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
    return outlines + [Tabbed(k, True, job, tuple(parts)) for k, parts in around.items() if parts]


def _list_slugs(cells: Cells, job: Job, inner: Sequence[int]) -> list[Tabbed]:
    slugs = shapely.buffer(cells.rings[list(inner)], -job.tool.diameter, quad_segs=_QUARTER)
    tabbed = []
    for k, slug in zip(inner, slugs, strict=True):
        area = float(shapely.area(shapely.get_parts(slug)).max(initial=0.0))
        if area >= job.tool.chip_area:
            tabbed.append(Tabbed(k, True, job))
    return tabbed


def _follow_lines(draft: Design, task: Task, worked: Sequence[Contour]) -> None:
    """A tool beside each contour, on the side that `operation.side` names, and no farther away."""
    operation, radius = task.job.operation, task.job.tool.radius
    far = radius + max(operation.lead_in, operation.lead_out, draft.aside) + operation.finish
    for contour in worked:
        segments = make_contour_segments([contour])
        is_left = operation.side == "left"
        if operation.side == "outside":
            is_left = measure_loop_areas(segments, 1)[0] < 0
        side = 1 if is_left else -1
        lines = Lines(segments, _get_depth(task), task.job.tool.diameter, (radius, far), side)
        draft.lines.append(lines)


def _add_waste(draft: Design, task: Task, worked: Sequence[Contour]) -> None:
    loops = _find_loops(draft, worked)
    draft.waste.update(loops[_are_holes(draft, loops, task)].tolist())


def _pocket(draft: Design, task: Task, worked: Sequence[Contour]) -> None:
    """All between walls and islands; contours of other operations are not islands."""
    cells, deep = draft.cells, _get_depth(task)
    recesses, across = _find_recesses(draft, worked)
    loops = _find_loops(draft, [contour for contour in worked if contour.id not in across])
    # A cell is a floor if the number of these contours around it is odd.
    around = _count_around(cells, np.isin(np.arange(len(cells)), loops))
    draft.allow(np.flatnonzero(around % 2 == 1).tolist(), deep)
    radius = task.job.tool.radius
    walls, islands = loops[around[loops] % 2 == 1], loops[around[loops] % 2 == 0]
    rooms = cells.rings[walls]
    if len(islands):
        # A wall within an island is a pocket again, with its own room.
        rooms = shapely.difference(rooms, shapely.union_all(cells.rings[islands]))
        nested = around[walls] > 1
        rooms[nested] = cells.rings[walls[nested]]
    draft.recesses += [Recess(shape, deep) for shape in recesses]
    draft.wanted += [Wanted(shape, shape, radius, deep) for shape in (*rooms, *recesses)]


def _find_recesses(draft: Design, worked: Sequence[Contour]) -> tuple[list[Any], set[str]]:
    """Find the pockets whose walls divide no cells.

    Returns their polygons, and the ids of their walls and islands.
    """
    closed, known = select_closed(worked), set(draft.cells.ids)
    divides_none = np.array([contour.id not in known for contour in closed], dtype=np.bool_)
    if not divides_none.any():
        return [], set()
    rings = make_polygons(closed)
    near = shapely.intersects(rings, shapely.union_all(rings[divides_none]))
    region = shapely.Polygon()
    for ring in rings[near]:
        region = shapely.symmetric_difference(region, ring)
    return list(shapely.get_parts(region)), set(list_ids(compress(closed, near)))


def _bore(draft: Design, task: Task, worked: Sequence[Contour]) -> None:
    """The whole area of circles, contours within them included."""
    circles, deep = _find_circles(draft, task, worked), _get_depth(task)
    circles.allow(draft, deep)
    draft.wanted += [Wanted(ring, ring, 0.0, deep) for ring in circles.rings]


def _drill(draft: Design, task: Task, worked: Sequence[Contour]) -> None:
    """A hole as wide as the end of the tool in the smallest of concentric circles.

    The holes at marks of a picture are not in the drawing, so they are not judged.
    """
    deep, tool = _get_depth(task), task.job.tool
    circles = _find_circles(draft, task, worked)
    if task.part.raster is not None:
        draft.free = True
        draft.notes.append("holes at marks of a picture are not judged: no cut counts as a gouge")
        return
    circles.allow(draft, deep)
    end = float(compute_radius(tool, np.zeros(1))[0])
    # Circles that are smaller than the tool are left out.
    is_wide = circles.diameters / 2 * (1 + _ROUND_FRACTION) + _ROUND_MM >= end
    if end > 0:
        middles = _find_middles(circles.rings[is_wide])
        radii = np.minimum(end, circles.diameters[is_wide] / 2)
        discs = shapely.buffer(middles, radii, quad_segs=2 * _QUARTER)
        draft.wanted += [Wanted(disc, disc, 0.0, deep) for disc in discs]


class _Circles(Struct, frozen=True, eq=False):
    """Circles of a drawing, in which holes are made.

    rings: (N,) their polygons.
    diameters: (N,) mm.
    loops: (N,) their cells; -1 for circles that cross other contours and divide no cells.
    """

    rings: Any
    diameters: FloatArray
    loops: IntArray

    def take(self, rows: IntArray | BoolArray) -> _Circles:
        """The circles `rows` (M,), indices or a mask."""
        return _Circles(self.rings[rows], self.diameters[rows], self.loops[rows])

    def allow(self, draft: Design, depth: float) -> None:
        """Allow cuts in all of them down to a depth, mm.

        A circle that is drawn with lines may be cut up to its corners, and beyond by the tolerance
        of circles.
        """
        is_cell = self.loops >= 0
        inner = draft.cells.within(self.loops[is_cell].tolist())
        draft.allow(np.flatnonzero(inner).tolist(), depth)
        draft.recesses += [Recess(ring, depth) for ring in self.rings[~is_cell]]
        middles = _find_middles(self.rings)
        nearest = shapely.distance(middles, shapely.boundary(self.rings))
        farthest = shapely.hausdorff_distance(middles, self.rings)
        lined = farthest - nearest > 2 * CHORD_MM
        if lined.any():
            reach = farthest[lined] + _ROUND_MM
            discs = shapely.buffer(middles[lined], reach, quad_segs=2 * _QUARTER)
            draft.recesses.append(Recess(shapely.union_all(discs), depth))

    def select_innermost(self) -> _Circles:
        """The innermost of concentric circles."""
        ordered = self.take(np.argsort(self.diameters, kind="stable"))
        middles = _find_middles(ordered.rings)
        tree = shapely.STRtree(middles)
        later, earlier = tree.query(middles, predicate="dwithin", distance=_SAME_CENTRE_MM)
        return ordered.take(np.delete(np.arange(len(middles)), later[earlier < later]))


def _find_circles(draft: Design, task: Task, worked: Sequence[Contour]) -> _Circles:
    """Find the innermost of concentric circles whose diameters are within `operation.holes`.

    To bore, the innermost is chosen among circles of these diameters, otherwise among all circles.
    """
    cells, known = draft.cells, set(draft.cells.ids)
    loops = _find_loops(draft, worked)
    across = [contour for contour in select_closed(worked) if contour.id not in known]
    rings, area = cells.rings[loops], cells.area[loops]
    if across:
        crossing = make_polygons(across)
        rings, area = np.append(rings, crossing), np.append(area, shapely.area(crossing))
    loops = np.append(loops, np.full(len(across), -1))
    circles = _Circles(rings, 2 * np.sqrt(area / np.pi), loops)
    circles = circles.take(np.array([_is_round(ring) for ring in rings], dtype=np.bool_))
    if get_kind(task) == "bore":
        return _select_diameters(circles, task).select_innermost()
    return _select_diameters(circles.select_innermost(), task)


def _select_diameters(circles: _Circles, task: Task) -> _Circles:
    low, high = task.job.operation.holes or (0.0, math.inf)
    diameters = circles.diameters
    return circles.take((diameters >= low - _ROUND_MM) & (diameters <= high + _ROUND_MM))


def _find_middles(rings: Any) -> Any:
    bounds = shapely.bounds(rings)
    return shapely.points((bounds[:, :2] + bounds[:, 2:]) / 2)


def _is_round(ring: Any) -> bool:
    points = shapely.get_coordinates(ring)
    bounds = shapely.bounds(ring)
    radii = np.hypot(*(points - (bounds[:2] + bounds[2:]) / 2).T)
    slack = max(_ROUND_MM, _ROUND_FRACTION * float(radii.mean())) + CHORD_MM
    return len(points) > 6 and float(np.ptp(radii)) <= 2 * slack


def _trace(draft: Design, task: Task, worked: Sequence[Contour]) -> None:
    _add_waste(draft, task, worked)
    if worked:
        draft.lines.append(
            Lines(make_contour_segments(worked), _get_depth(task), task.job.tool.diameter)
        )


def _fill(draft: Design, task: Task, worked: Sequence[Contour]) -> None:
    """The area within closed contours, even-odd; narrow places by a line in their middle."""
    _pocket(draft, task, worked)
    if worked:
        lines = make_contour_segments(worked)
        draft.lines.append(
            Lines(lines, _get_depth(task), task.job.tool.diameter, (0.0, task.job.tool.radius))
        )


def _chamfer(draft: Design, task: Task, worked: Sequence[Contour]) -> None:
    """A cone on the material side of contours; on the other side the tip may be `_TIP_MM` away."""
    cells, operation, tool = draft.cells, task.job.operation, task.job.tool
    slope = compute_slope(tool)
    width = operation.width or operation.depth * slope
    loops = _find_loops(draft, worked)
    draft.bevels.append(Bevel(width, slope, loops, tool.diameter))
    inside = _are_inside(draft, loops, task)
    draft.allow(
        np.concatenate([loops[inside], cells.parent[loops[~inside]]]).tolist(),
        operation.depth or (width + _TIP_MM) / slope,
    )


#: The function that adds the material of an operation to a draft, by kind of operation.
_BY_KIND: dict[str, Callable[[Design, Task, Sequence[Contour]], None]] = {
    "follow": _follow,
    "pocket": _pocket,
    "bore": _bore,
    "drill": _drill,
    "trace": _trace,
    "engrave": _trace,
    "fill": _fill,
    "chamfer": _chamfer,
}


def show_stay(design: Design, depth: float) -> Any:
    """Make polygons, for pictures, of the material that must stay at `depth` mm.

    Where operations along lines cut, it is cut out.
    """
    stays = design.depth < depth
    whole = design.outline if stays[-1] else shapely.Polygon()
    for cell in np.argsort(design.cells.depth, kind="stable").tolist():
        ring = design.cells.rings[cell]
        whole = shapely.union(whole, ring) if stays[cell] else shapely.difference(whole, ring)
    for lines in design.lines:
        if lines.depth < depth:
            continue
        segments = lines.segments
        points, owner = flatten(segments, CHORD_MM)
        curves = []
        for k in np.unique(owner):
            last = segments.end[segments.owner == k][-1:]
            curves.append(shapely.LineString(np.concatenate([points[owner == k], last])))
        swept = shapely.buffer(curves, lines.diameter / 2 + lines.distances[1])
        whole = shapely.difference(whole, shapely.union_all(swept))
    recesses = [recess.shape for recess in design.recesses if recess.depth >= depth]
    return shapely.difference(whole, shapely.union_all(recesses)) if recesses else whole
