"""Tabs: bridges that hold parts in their stock until they are cut by hand.

They are on the outlines of parts, and on the holes around these, since a part would come loose with
the slug to which it is joined. If an operation cuts no part out, they are on its holes and hold
slugs that are larger than a chip.

Over a tab the tool rises to `tab_height` above the depth by 45 degrees. It runs level for
`tab_width` and its own diameter, so that the width is left. It goes down by `entry_angle`, or by 45
degrees if it may plunge: there is material after the tab. Tabs are spread evenly from the seam on.
Each is moved to the nearest position that is clear of corners, of the seam with its leads and
overlap, and of the other tabs. A corner is a vertex where the tangent turns, or an arc on which the
tool only rolls about a point.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import chain as join
from typing import Any

import numpy as np
import shapely
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import NDArray

from camgen.geometry.arcs import make_span_chain
from camgen.geometry.segments import flatten
from camgen.geometry.vectors import cross, measure_angles, multiply_rows
from camgen.model.job import Job
from camgen.model.part import Note, list_ids
from camgen.model.path import ToolPath
from camgen.model.pose import FloatArray, frozen
from camgen.model.text import counted, name_first, short
from camgen.model.tolerance import SAME_POINT_MM
from camgen.plan.columns import make_path_segments
from camgen.plan.pieces import (
    chorded,
    lengths_along,
    nearest,
    point_at,
    points_at,
    shortest,
    split_at,
)
from camgen.plan.unused import check_rules

#: rad: change of the tangent from which a vertex is a corner. Curves that were drawn as many lines
#: change by less.
_CORNER = math.radians(5)
#: Fraction of its radius by which an arc may be larger if the tool only rolls about a point.
_POINT_SLACK = 1e-3
#: mm: the path is level after a tab for at least this length before its end.
_LEVEL_MM = 0.2
#: mm: chord tolerance of curves of which only the inside matters.
_CHORD_MM = 0.01
#: mm: distance of the samples of a loop at which other paths are searched.
_SAMPLE_MM = 0.5
#: mm: tolerance with which points of a loop are found again.
_SAME_POINT = 1e-4


class _Tab(Struct, frozen=True):
    """The size of all tabs, mm along the path of the tool's centre.

    top: half of the level part.
    rise: length from the foot of the slope before the tab to its middle.
    fall: length from the middle of the tab to the foot of the slope after it.
    depth: depth of the operation.
    height: height of the tabs above that depth.
    """

    top: float
    rise: float
    fall: float
    depth: float
    height: float


class _Loop(Struct, frozen=True, eq=False):
    """The closed part of a path.

    number: index of the path.
    path: the path with its leads.
    begin: position of the loop's start along the path, mm.
    once: the loop, once around.
    seam: positions (low, high) from its start that are kept free of tabs, low below 0, mm.
    corners: (C, 2) start and end of each corner from the start of the loop, mm.
    """

    number: int
    path: ToolPath
    begin: float
    once: ToolPath
    seam: tuple[float, float]
    corners: FloatArray

    @property
    def length(self) -> float:
        """Length of the loop, mm."""
        return float(lengths_along(self.once)[-1])


def add_tabs(
    planned: Sequence[ToolPath], led: Sequence[ToolPath], job: Job
) -> tuple[list[ToolPath], list[Note]]:
    """The paths `led` with the floors of their tabs, and notes on tabs and on missing ones.

    Paths beside one contour, of which one finishes what the other left, have their tabs at the same
    positions. Raises JobError for tabs that are too high for the depth.

    planned: paths before they had leads.
    """
    operation = job.operation
    if not (operation.tabs or operation.tab_spacing):
        return list(led), []
    _check_settings(job)
    chosen = _choose_paths(planned, job)
    chord_fractions = (shortest(planned[k], job.tolerance.chord) for k in chosen)
    tab = _compute_size(job, min(chord_fractions, default=1.0))
    loops = [_find_loop(k, planned[k], led[k], job, tab) for k in chosen]
    result = list(led)
    held: list[str] = []
    near_corners: list[str] = []
    without: list[_Loop] = []
    middles: list[tuple[float, float]] = []
    placed: dict[int, list[FloatArray]] = {}
    for group in _group_loops(loops, job.tool.diameter):
        first, ids = group[0], [loop.path.id for loop in group]
        by_spacing = math.ceil(first.length / (operation.tab_spacing or math.inf) - 1e-9)
        wanted = operation.tabs or max(2, by_spacing)
        ideals = ((np.arange(wanted) + 0.5) / wanted * first.length).tolist()
        inner_tabs = list(join.from_iterable(placed.get(k, []) for k in chosen[first.number]))
        if len(inner_tabs) == wanted:
            # Where the kerfs meet, tabs hold only if they are next to each other.
            ideals = _find_nearest_places(first, inner_tabs)
        crowded = _find_crowded(first.once, group, planned, job.tool.diameter)
        places, is_near_corner = _choose_places(group, tab, ideals, crowded)
        points = [point_at(first.once, place) for place in places]
        placed[first.number] = points
        for loop in group:
            on_loop = sorted(_find_nearest_places(loop, points))
            result[loop.number] = _raise_floor(loop, tab, on_loop, job.tolerance.chord)
        middles += [(float(x), float(y)) for x, y, _ in points]
        if places:
            held += ids
        if is_near_corner:
            near_corners += ids
        if len(places) < wanted:
            without += group
    pieces = [path for path in planned if path.operation == "follow" and not path.closed]
    return result, list(_note_tabs(held, middles, near_corners, without, pieces, job))


def _find_nearest_places(loop: _Loop, points: Sequence[FloatArray]) -> list[float]:
    """The positions along a loop that are nearest to points (3,), mm."""
    return [nearest(loop.once, point)[0] for point in points]


def _group_loops(loops: Sequence[_Loop], distance: float) -> list[list[_Loop]]:
    """The loops in groups beside the same contours, within a distance of the first loop, mm."""
    groups: list[list[_Loop]] = []
    for loop in loops:
        start = loop.once.position[0]
        for group in groups:
            first = group[0].once
            if first.contours == loop.once.contours and nearest(first, start)[1] < distance:
                group.append(loop)
                break
        else:
            groups.append([loop])
    return groups


def _compute_size(job: Job, chord_fraction: float) -> _Tab:
    """The size of the tabs.

    chord_fraction: shortest chords for each mm of an arc, where slopes are steepest.
    """
    operation = job.operation
    top = operation.tab_width / 2 + job.tool.diameter / 2
    slope = 1.0 if operation.entry == "plunge" else math.tan(math.radians(operation.entry_angle))
    rise = top + operation.tab_height / chord_fraction
    fall = top + operation.tab_height / (slope * chord_fraction)
    return _Tab(top, rise, fall, operation.depth, operation.tab_height)


def _check_settings(job: Job) -> None:
    operation, kind = job.operation, job.tool.kind
    height, depth = short(operation.tab_height, 3), short(operation.depth, 3)
    remedy = "set operation.depth to the thickness that is cut through"
    if operation.depth:
        remedy = "make it less than operation.depth"
    check_rules(
        [
            (
                operation.tabs > 0 and operation.tab_spacing is not None,
                "both their number and their spacing are given",
                "operation.tab_spacing",
                "leave out one of the two",
            ),
            (
                operation.tab_height >= operation.depth,
                f"tabs of {height} mm in a depth of {depth} mm",
                "operation.tab_height",
                remedy,
            ),
            (
                kind in ("laser", "plasma"),
                f"a {kind} cuts through tabs at any height of its head",
                "operation.tabs",
                "leave them out",
            ),
        ]
    )


def _choose_paths(planned: Sequence[ToolPath], job: Job) -> dict[int, list[int]]:
    """The paths that have tabs, inner ones first, each with the paths around parts within it."""
    outer: list[int] = []
    holes: list[int] = []
    for k, path in enumerate(planned):
        if path.closed and path.operation == "follow" and len(path.position) >= 3:
            # A hole may be around a part, and no wider than the tool between them.
            is_around = _cuts_out(path) or len(path.contours) > 1
            (outer if is_around else holes).append(k)
    if not outer:
        return {k: [] for k in holes if _leaves_slug(planned[k], job)}
    around = _find_around(planned, outer, holes)
    return {k: [] for k in outer} | {k: around[k] for k in holes if around[k]}


def _leaves_slug(path: ToolPath, job: Job) -> bool:
    slug = shapely.buffer(_make_polygon(path), -job.tool.radius)
    return bool(shapely.area(shapely.get_parts(slug)).max(initial=0.0) >= job.tool.chip_area)


def _make_polygon(path: ToolPath) -> Any:
    points = flatten(make_path_segments((path,)), _CHORD_MM)[0]
    return shapely.Polygon(points) if len(points) > 2 else shapely.Polygon()


def _find_around(
    planned: Sequence[ToolPath], outer: Sequence[int], holes: Sequence[int]
) -> dict[int, list[int]]:
    """The paths around parts within each of the paths in holes."""
    rooms = np.array([_make_polygon(planned[k]) for k in holes], dtype=object)
    starts = shapely.points([planned[k].position[0, :2] for k in outer])
    start, room = shapely.STRtree(rooms).query(starts, predicate="within")
    around: dict[int, list[int]] = {k: [] for k in holes}
    for i, row in zip(start.tolist(), room.tolist(), strict=True):
        around[holes[row]].append(outer[i])
    return around


def _cuts_out(path: ToolPath) -> bool:
    """Whether a closed path runs round the outside of its contour: it presses on its inner side."""
    ahead = make_span_chain(path.position, path.via[1:]).tangents()[0][0]
    left = float(cross(ahead, path.force_direction[1, 0])[2])
    corners = np.empty((2 * len(path.position) - 1, 2))
    corners[::2], corners[1::2] = path.position[:, :2], path.via[1:, :2]
    x, y = corners[~np.isnan(corners[:, 0])].T
    return left * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)) > 0


def _find_loop(number: int, before: ToolPath, path: ToolPath, job: Job, tab: _Tab) -> _Loop:
    """The closed path `before` within `path`, which may have a lead of one segment before it."""
    length, along = float(lengths_along(before)[-1]), lengths_along(path)
    for row in (0, 1):
        last = _find_row_once_around(path, row, length)
        if last:
            break
    else:
        raise ValueError(f"path {path.id} does not hold the loop from which it was made")
    begin, overlap = float(along[row]), min(job.operation.overlap, length)
    # A lead is a quarter of a circle. It extends by its radius along the contour, and the tool is
    # wider by its own radius.
    after = max(0.0, float(along[-1]) - begin - length - overlap)
    low = max(tab.fall + _LEVEL_MM, tab.top + begin / (math.pi / 2))
    high = max(tab.rise, tab.top + after / (math.pi / 2))
    if job.operation.entry != "plunge":
        high += job.tool.diameter  # an entry runs back and forth before the first tab
    once = path.rows(row, last + 1)
    corners = _find_corners(once, job.tool.diameter / 2 + job.operation.finish)
    return _Loop(number, path, begin, once, (-low, overlap + high), corners)


def _find_row_once_around(path: ToolPath, row: int, length: float) -> int:
    """The row that is at the same point as `row`, `length` mm later; 0 without one."""
    along = lengths_along(path)
    difference = np.abs(along - along[row] - length)
    last = int(np.argmin(difference))
    gap = math.dist(path.position[last].tolist(), path.position[row].tolist())
    return last if max(difference[last], gap) < _SAME_POINT else 0


def _find_corners(once: ToolPath, radius: float) -> FloatArray:
    """(C, 2) start and end of each corner from the start of a loop, mm.

    radius: radius of an arc about a corner, mm.
    """
    along, shape = lengths_along(once), make_span_chain(once.position, once.via[1:])
    leaves, arrives = shape.tangents()
    sharp = measure_angles(arrives, np.roll(leaves, -1, axis=0)) > _CORNER
    centre = shape.via - shape.radius[:, None] * shape.towards
    inwards = multiply_rows(once.force_direction[1:, 0], centre - shape.start) > 0
    is_small = shape.radius < radius * (1 + _POINT_SLACK)
    rolls = shape.curved & inwards & is_small & (shape.sweep > _CORNER)
    vertices = np.column_stack([along[1:], along[1:]])[sharp]
    return np.concatenate([vertices, np.column_stack([along[:-1], along[1:]])[rolls]])


def _find_crowded(
    once: ToolPath, group: Sequence[_Loop], planned: Sequence[ToolPath], distance: float
) -> FloatArray:
    """(S, 2) sections of a loop at which a path is nearer than a kerf and cuts tabs off, mm.

    That is another path, or the loop itself on the other side of a narrow place.
    """
    members = {loop.number for loop in group}
    others = [_make_line(path) for k, path in enumerate(planned) if k not in members]
    lines = np.array(others, dtype=object)
    near = lines[shapely.STRtree(lines).query(_make_line(once), "dwithin", distance=distance)]
    length = float(lengths_along(once)[-1])
    places = np.linspace(0.0, length, max(2, math.ceil(length / _SAMPLE_MM)) + 1)
    points = points_at(once, places)[:, :2]
    close = _are_narrow(points, places, distance)
    if len(near):
        close |= shapely.distance(shapely.union_all(near), shapely.points(points)) < distance
    step = float(places[1])
    return np.asarray(places[close][:, None] + np.array([-step, step]))


def _are_narrow(points: FloatArray, places: FloatArray, distance: float) -> NDArray[np.bool_]:
    """(P,) whether a loop comes back near to its points at another position.

    points: (P, 2) points of the loop, mm.
    places: (P,) their positions along the loop, mm, the last one once around.
    distance: distance below which two points are near, mm.
    """
    close = np.zeros(len(places), np.bool_)
    # Maximum length of a section that only rounds a corner.
    corner = math.pi * distance
    which = _list_near_points(points, places, distance, corner)
    chosen = shapely.points(points[which])
    place, near = shapely.STRtree(chosen).query(chosen, predicate="dwithin", distance=distance)
    gaps = _measure_along(places[which[place]] - places[which[near]], float(places[-1]))
    close[which[place[gaps > corner]]] = True
    return close


def _list_near_points(
    points: FloatArray, places: FloatArray, distance: float, corner: float
) -> NDArray[np.intp]:
    """Indices of the points that may be within `distance` of another one, `corner` mm along.

    The loop is compared in pieces as long as the distance. On a line, pieces within the distance of
    each other are neighbours, which are too near to each other along the loop.
    """
    piece = np.arange(len(places)) // max(1, int(distance / float(places[1])))
    first = np.flatnonzero(np.diff(piece, prepend=-1))
    last = np.append(first[1:], len(piece)) - 1
    pieces = shapely.multipoints(points, indices=piece)
    rows, columns = shapely.STRtree(pieces).query(pieces, predicate="dwithin", distance=distance)
    middle, half = (places[first] + places[last]) / 2, (places[last] - places[first]) / 2
    gaps = _measure_along(middle[rows] - middle[columns], float(places[-1]))
    near = np.zeros(len(pieces), np.bool_)
    near[rows[gaps + half[rows] + half[columns] > corner - SAME_POINT_MM]] = True
    return np.flatnonzero(near[piece])


def _measure_along(lengths: FloatArray, once: float) -> FloatArray:
    """Distances along a loop of `once` mm, for differences `lengths` of positions, mm."""
    along = np.abs(lengths)
    return np.minimum(along, once - along)


def _make_line(path: ToolPath) -> Any:
    last = path.position[-1:, :2]
    if len(path.position) == 1:
        return shapely.Point(last[0])
    points, _ = flatten(make_path_segments((path,)), _CHORD_MM)
    return shapely.LineString(np.concatenate([points, last]))


def _choose_places(
    group: Sequence[_Loop],
    tab: _Tab,
    ideals: Sequence[float],
    crowded: FloatArray,
) -> tuple[list[float], bool]:
    """The middles of the tabs along the first loop, mm, and whether some are near corners.

    All seams of the group are kept free.

    ideals: positions that the tabs should have, mm.
    crowded: (S, 2) sections that are avoided if there is another position, mm.
    """
    loop, places, near_corner = group[0], list[float](), False
    length = loop.length
    # Tabs may be nearer to each other on the other paths of the group.
    largest_difference = max(abs(other.length - length) for other in group)
    spacing = tab.rise + tab.fall + largest_difference
    seams = []
    for member in group:
        start = nearest(loop.once, member.once.position[0])[0]
        seams.append((start + member.seam[0], start + member.seam[1]))
    near_corners = _repeat_around(loop.corners + np.array([-tab.top, tab.top]), length)
    taken = _repeat_around(crowded + np.array([-tab.fall, tab.rise]), length)
    for ideal in ideals:
        others = np.array(places)[:, None] + np.array([-spacing, spacing])
        closed = _repeat_around(np.concatenate([seams, others]), length)
        off_corners = np.concatenate([closed, near_corners])
        place = _find_nearest_place(ideal, np.concatenate([off_corners, taken]), length)
        if place is None:
            place = _find_nearest_place(ideal, off_corners, length)
        if place is None:
            place = _find_farthest_place(ideal, closed, loop.corners, length)
            near_corner |= place is not None
        if place is not None:
            places.append(place)
    return places, near_corner


def _repeat_around(sections: FloatArray, length: float) -> FloatArray:
    """(3 S, 2) the sections (S, 2) of a loop, each also once around before and after."""
    return np.reshape(sections[:, None] + np.array([[-length], [0.0], [length]]), (-1, 2))


def _find_nearest_place(ideal: float, closed: FloatArray, length: float) -> float | None:
    """The position nearest to `ideal` that is in none of the sections (S, 2); None if none is."""
    places = _select_open(np.append(ideal, closed[(closed >= 0) & (closed <= length)]), closed)
    return min(places.tolist(), key=lambda place: abs(place - ideal), default=None)


def _select_open(places: FloatArray, closed: FloatArray) -> FloatArray:
    """The positions that are in none of the sections (S, 2)."""
    low, high = closed.T
    is_after = places[:, None] > low + SAME_POINT_MM
    is_before = places[:, None] < high - SAME_POINT_MM
    return np.asarray(places[~(is_after & is_before).any(axis=1)])


def _find_farthest_place(
    ideal: float, closed: FloatArray, corners: FloatArray, length: float
) -> float | None:
    """The position farthest from all corners that is in none of `closed`; None without any.

    The one nearest to `ideal` is taken if several are equally far.
    """
    around = _repeat_around(corners, length)
    low, high = around[np.lexsort(around.T[::-1])].T
    places = np.append((high[:-1] + low[1:]) / 2, closed)
    places = _select_open(places[(places >= 0) & (places <= length)], closed)

    def badness(place: float) -> tuple[float, float]:
        distance = np.maximum(np.maximum(low - place, place - high), 0.0).min()
        return -round(float(distance), 3), abs(place - ideal)

    return min(places.tolist(), key=badness, default=None)


def _raise_floor(loop: _Loop, tab: _Tab, places: Sequence[float], chord: float) -> ToolPath:
    """The path with the floor of its tabs; slopes are chords."""
    if not places:
        return loop.path
    middles = loop.begin + np.array(places)
    positions = (middles[:, None] + np.array([-tab.rise, -tab.top, tab.top, tab.fall])).ravel()
    low, high = -tab.depth, tab.height - tab.depth
    split = split_at(loop.path, positions)
    heights = np.tile([low, high, high, low], len(places))
    floor = np.interp(lengths_along(split), positions, heights)
    for level in (low, high):
        floor[np.abs(floor - level) < SAME_POINT_MM] = level
    slopes = np.abs(np.diff(floor)) > SAME_POINT_MM
    return chorded(replace(split, floor=frozen(floor)), chord, slopes)


def _note_tabs(
    held: Sequence[str],
    middles: Sequence[tuple[float, float]],
    near_corners: Sequence[str],
    without: Sequence[_Loop],
    pieces: Sequence[ToolPath],
    job: Job,
) -> Iterator[Note]:
    """Notes on the tabs: their number, size and positions, and the paths with fewer or none."""
    if held:
        size = f"{short(job.operation.tab_width, 3)} x {short(job.operation.tab_height, 3)} mm"
        what = f"{counted(len(middles), 'tab')} of {size} on {name_first(held)}"
        why = "they hold the part; cut them when it is out"
        yield Note("assumed", what, why, places=tuple(middles))
    elif not without:
        why = "only a path all around a part, or a slug larger than a chip, has them"
        yield Note("warning", "no tabs: no path cuts anything out", why)
    if near_corners:
        why = "no place is as far from all corners as the tool's radius and half the tab's width"
        yield Note("warning", f"tabs near corners on {name_first(near_corners)}", why)
    if without:
        why = (
            "there is no room for more beside the seam, its leads and each other; "
            "fewer or shorter ones may fit"
        )
        what = f"fewer tabs than requested on {name_first([loop.path.id for loop in without])}"
        ids = tuple(join.from_iterable(loop.path.contours for loop in without))
        yield Note("warning", what, why, ids, lacks="tabs")
    if pieces and (held or without):
        why = "only a closed path has tabs; a piece that other paths cut free comes loose"
        what = f"no tabs on {name_first(list_ids(pieces))}"
        ids = tuple(join.from_iterable(path.contours for path in pieces))
        yield Note("warning", what, why, ids, lacks="tabs")
