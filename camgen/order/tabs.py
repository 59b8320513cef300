"""Tabs: bridges that hold parts in their stock until they are cut by hand.

They stand on the outlines of parts, and on the holes around these, since a part would come loose
with the slug to which it is joined. If an operation cuts no part out, they stand on its holes and
hold slugs that are larger than a chip.

Over a tab the tool rises to `tab_height` above the depth by 45 degrees. It runs level for
`tab_width` and its own diameter, so that the width is left. It goes down by `entry_angle`, or by 45
degrees where it may plunge: there is material after the tab. The places are spread evenly from the
seam on. Each is moved to the nearest one that is clear of corners, of the seam with its leads and
overlap, and of the other tabs. A corner is a vertex where the tangent turns, or an arc on which the
tool only rolls about a point.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import chain as join
from itertools import pairwise
from typing import Any

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import NDArray

from camgen.geometry.arcs import chain
from camgen.geometry.segments import flatten
from camgen.geometry.vectors import angles, cross, dots
from camgen.model.errors import JobError
from camgen.model.job import Job
from camgen.model.part import Note
from camgen.model.path import ToolPath
from camgen.model.pose import FloatArray, frozen
from camgen.model.text import counted, name_first, short
from camgen.model.tolerance import SAME_POINT_MM
from camgen.plan.columns import path_segments
from camgen.plan.pieces import (
    chorded,
    lengths_along,
    nearest,
    point_at,
    points_at,
    shortest,
    split_at,
)

#: A turn of the tangent that makes a corner, rad: curves that were drawn as many lines turn by less.
_CORNER = math.radians(5)
#: How much of an arc may touch the part that rolls about a point, as a part of its radius.
_POINT = 1e-3
#: The path is level again after a tab for at least this before its end, mm.
_LEVEL_MM = 0.2
#: Curves as chords that leave them by at most this, mm, where only the inside matters.
_CHORD_MM = 0.01
#: Distance of the places of a loop at which other paths are looked for, mm.
_LOOK_MM = 0.5
#: Points of a loop are found again within this, mm.
_FOUND = 1e-4


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

    @property
    def whole(self) -> float:
        """Length of a tab with both slopes."""
        return self.rise + self.fall


class _Loop(Struct, frozen=True, eq=False):
    """The closed part of a path. number: of its path. begin: where it starts there, mm. round: it
    once round.

    seam: (low, high), mm from its start, what is kept free of tabs, low below 0. corners: (C, 2),
        from where to where.
    """

    number: int
    path: ToolPath
    begin: float
    round: ToolPath
    seam: tuple[float, float]
    corners: FloatArray

    @property
    def length(self) -> float:
        """Once round, mm."""
        return float(lengths_along(self.round)[-1])


def add_tabs(
    planned: Sequence[ToolPath], led: Sequence[ToolPath], job: Job
) -> tuple[list[ToolPath], list[Note]]:
    """The paths ``led`` with the floors of their tabs, and notes on how many there are, and on
    those that are not.

    planned: the same paths before they had leads. Paths beside one contour, of which one finishes
        what the other left,
    have their tabs at the same places. JobError for tabs that the depth has no room for.
    """
    operation = job.operation
    if not (operation.tabs or operation.tab_spacing):
        return list(led), []
    _insist(job)
    chosen = _choose(planned, job)
    tab = _size(job, min((shortest(planned[k], job.tolerance.chord) for k in chosen), default=1.0))
    loops = [_find_loop(k, planned[k], led[k], job, tab) for k in chosen]
    result = list(led)
    held: list[str] = []
    near: list[str] = []
    without: list[_Loop] = []
    middles: list[tuple[float, float]] = []
    placed: dict[int, list[FloatArray]] = {}
    for group in _beside_each_other(loops, job.tool.diameter):
        first, ids = group[0], [loop.path.id for loop in group]
        wanted = operation.tabs or max(
            2, math.ceil(first.length / (operation.tab_spacing or math.inf) - 1e-9)
        )
        ideals = [(k + 0.5) / wanted * first.length for k in range(wanted)]
        within = list(join.from_iterable(placed.get(k, []) for k in chosen[first.number]))
        if len(within) == wanted:
            # Where the kerfs meet, bridges hold only beside each other.
            ideals = [nearest(first.round, point)[0] for point in within]
        crowded = _find_crowded(first.round, group, planned, job.tool.diameter)
        places, close = _place(group, tab, ideals, crowded)
        points = [point_at(first.round, place) for place in places]
        placed[first.number] = points
        for loop in group:
            here = sorted(nearest(loop.round, point)[0] for point in points)
            result[loop.number] = _hold(loop, tab, here, job.tolerance.chord)
        middles += [(x, y) for x, y, _ in map(np.ndarray.tolist, points)]
        held += ids if places else []
        near += ids if close else []
        without += group if len(places) < wanted else []
    pieces = [path for path in planned if path.operation == "follow" and not path.closed]
    return result, _tell(held, middles, near, without, pieces, job)


def _beside_each_other(loops: Sequence[_Loop], within: float) -> list[list[_Loop]]:
    """The loops in groups that run beside the same contours, no farther than ``within`` mm from the first of them."""
    groups: list[list[_Loop]] = []
    for loop in loops:
        start = loop.round.position[0]
        for group in groups:
            first = group[0].round
            if first.contours == loop.round.contours and nearest(first, start)[1] < within:
                group.append(loop)
                break
        else:
            groups.append([loop])
    return groups


def _size(job: Job, flat: float) -> _Tab:
    """The size of the tabs. flat: the least length of chords for each mm of an arc, where slopes are steepest."""
    operation = job.operation
    top = operation.tab_width / 2 + job.tool.diameter / 2
    slope = 1.0 if operation.entry == "plunge" else math.tan(math.radians(operation.entry_angle))
    rise, fall = (top + operation.tab_height / (tangent * flat) for tangent in (1.0, slope))
    return _Tab(top, rise, fall, operation.depth, operation.tab_height)


def _insist(job: Job) -> None:
    operation, kind = job.operation, job.tool.kind
    if operation.tabs and operation.tab_spacing:
        what = "their number is given, and so is their spacing"
        raise JobError("job", what, "operation.tab_spacing", "leave out one of the two")
    if operation.tab_height >= operation.depth:
        what = f"tabs of {short(operation.tab_height, 3)} mm in a depth of {short(operation.depth, 3)} mm"
        remedy = (
            "make it less than operation.depth"
            if operation.depth
            else "set operation.depth to what is cut through"
        )
        raise JobError("job", what, "operation.tab_height", remedy)
    if kind in ("laser", "plasma"):
        what = f"a {kind} cuts through tabs, however high its head stands"
        raise JobError("job", what, "operation.tabs", "leave them out")


def _choose(planned: Sequence[ToolPath], job: Job) -> dict[int, list[int]]:
    """The paths that have tabs, inner ones first, each with the paths around parts within it."""
    closed = [k for k, path in enumerate(planned) if _runs_round(path)]
    outer = [k for k in closed if _cuts_out(planned[k])]
    holes = [k for k in closed if k not in set(outer)]
    if not outer:
        return {k: [] for k in holes if _leaves_slug(planned[k], job)}
    around = _find_around(planned, outer, holes)
    return {k: [] for k in outer} | {k: around[k] for k in holes if around[k]}


def _leaves_slug(path: ToolPath, job: Job) -> bool:
    """Whether a slug is left within the path that is larger than a chip."""
    import shapely  # noqa: PLC0415 (only for what needs it)

    slug = shapely.buffer(_draw_room(path), -job.tool.radius)
    return bool(shapely.area(shapely.get_parts(slug)).max(initial=0.0) >= job.tool.chip_area)


def _draw_room(path: ToolPath) -> Any:
    """The polygon within a closed path."""
    import shapely  # noqa: PLC0415 (only for what needs it)

    points = flatten(path_segments((path,)), _CHORD_MM)[0]
    return shapely.Polygon(points) if len(points) > 2 else shapely.Polygon()


def _find_around(
    planned: Sequence[ToolPath], outer: Sequence[int], holes: Sequence[int]
) -> dict[int, list[int]]:
    """The paths around parts within each of the paths in holes."""
    import shapely  # noqa: PLC0415 (only for what needs it)

    rooms = np.array([_draw_room(planned[k]) for k in holes], dtype=object)
    starts = shapely.points([planned[k].position[0, :2] for k in outer])
    start, room = shapely.STRtree(rooms).query(starts, predicate="within")
    around: dict[int, list[int]] = {k: [] for k in holes}
    for i, row in zip(start.tolist(), room.tolist(), strict=True):
        around[holes[row]].append(outer[i])
    return around


def _runs_round(path: ToolPath) -> bool:
    return path.closed and path.operation == "follow" and len(path.position) >= 3


def _cuts_out(path: ToolPath) -> bool:
    """Whether a closed path runs round the outside of its contour: it presses on its inner side."""
    ahead = chain(path.position, path.via[1:]).tangents()[0][0]
    left = float(cross(ahead, path.force_direction[1, 0])[2])
    corners = np.empty((2 * len(path.position) - 1, 2))
    corners[::2], corners[1::2] = path.position[:, :2], path.via[1:, :2]
    x, y = corners[~np.isnan(corners[:, 0])].T
    area = float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
    return left * area > 0


def _find_loop(number: int, before: ToolPath, path: ToolPath, job: Job, tab: _Tab) -> _Loop:
    """Where the closed path ``before`` is in ``path``, which has a lead of one segment before it, or none."""
    length, along = float(lengths_along(before)[-1]), lengths_along(path)
    row = next((row for row in (0, 1) if _once_round(path, row, length)), 0)
    last = _once_round(path, row, length)
    if not last:
        raise ValueError(f"path {path.id} does not hold the loop that it was made of")
    begin, overlap = float(along[row]), min(job.operation.overlap, length)
    # A lead is a quarter of a circle: it reaches its radius along the contour, and the tool is wider by its own.
    after = max(0.0, float(along[-1]) - begin - length - overlap)
    low = max(tab.fall + _LEVEL_MM, tab.top + begin / (math.pi / 2))
    high = max(tab.rise, tab.top + after / (math.pi / 2))
    if job.operation.entry != "plunge":
        high += job.tool.diameter  # an entry runs back and forth before the first tab
    once = path.rows(row, last + 1)
    return _Loop(
        number,
        path,
        begin,
        once,
        (-low, overlap + high),
        _corners(once, job.tool.diameter / 2 + job.operation.finish),
    )


def _once_round(path: ToolPath, row: int, length: float) -> int:
    """The row at which ``path`` is where it was at ``row``, ``length`` mm later; 0 if it is not."""
    along = lengths_along(path)
    last = int(np.argmin(np.abs(along - along[row] - length)))
    apart = math.dist(path.position[last].tolist(), path.position[row].tolist())
    return last if abs(along[last] - along[row] - length) < _FOUND and apart < _FOUND else 0


def _corners(once: ToolPath, radius: float) -> FloatArray:
    """(C, 2) mm from the start of a loop: its corners, each from where to where. radius: of an arc about a corner."""
    along, shape = lengths_along(once), chain(once.position, once.via[1:])
    leaves, arrives = shape.tangents()
    sharp = angles(arrives, np.roll(leaves, -1, axis=0)) > _CORNER
    centre = shape.via - shape.radius[:, None] * shape.towards
    inwards = dots(once.force_direction[1:, 0], centre - shape.start) > 0
    rolls = (
        shape.curved & inwards & (shape.radius < radius * (1 + _POINT)) & (shape.sweep > _CORNER)
    )
    return np.concatenate(
        [
            np.column_stack([along[1:], along[1:]])[sharp],
            np.column_stack([along[:-1], along[1:]])[rolls],
        ]
    )


def _find_crowded(
    once: ToolPath, group: Sequence[_Loop], planned: Sequence[ToolPath], distance: float
) -> list[tuple[float, float]]:
    """Stretches of a loop at which a path is nearer than a kerf and cuts tabs off, mm.

    That is another path, or the loop itself on the other side of a narrow room.
    """
    import shapely  # noqa: PLC0415 (only for what needs it)

    members = {loop.number for loop in group}
    others = [path for k, path in enumerate(planned) if k not in members]
    lines = np.array([_draw_line(path) for path in others], dtype=object)
    near = lines[shapely.STRtree(lines).query(_draw_line(once), "dwithin", distance=distance)]
    length = float(lengths_along(once)[-1])
    places = np.linspace(0.0, length, max(2, math.ceil(length / _LOOK_MM)) + 1)
    points = points_at(once, places)[:, :2]
    close = _come_back(points, places, distance)
    if len(near):
        close |= shapely.distance(shapely.union_all(near), shapely.points(points)) < distance
    step = float(places[1])
    return [(place - step, place + step) for place in places[close].tolist()]


def _come_back(points: FloatArray, places: FloatArray, distance: float) -> NDArray[np.bool_]:
    """(P,) whether a loop comes back to its points at another place.

    points: (P, 2) of the loop, mm.
    places: (P,) their lengths along the loop, mm, the last one once round.
    distance: distance below which both places are near, mm.
    """
    import shapely  # noqa: PLC0415 (only for what needs it)

    close = np.zeros(len(places), np.bool_)
    # A loop that only rounds a corner is this long at most.
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
    """Numbers of the points that may be within `distance` of another one, `corner` mm along.

    The loop is compared in pieces as long as the distance. On a line, pieces within the distance
    of each other are neighbours, which are too near to each other along the loop.
    """
    import shapely  # noqa: PLC0415 (only for what needs it)

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
    """Distances along a loop of `once` mm of places whose lengths differ by `lengths` mm."""
    along = np.abs(lengths)
    return np.minimum(along, once - along)


def _draw_line(path: ToolPath) -> Any:
    """A path, seen from above."""
    import shapely  # noqa: PLC0415 (only for what needs it)

    last = path.position[-1:, :2]
    if len(path.position) == 1:
        return shapely.Point(last[0])
    points, _ = flatten(path_segments((path,)), _CHORD_MM)
    return shapely.LineString(np.concatenate([points, last]))


def _place(
    group: Sequence[_Loop],
    tab: _Tab,
    ideals: Sequence[float],
    crowded: Sequence[tuple[float, float]],
) -> tuple[list[float], bool]:
    """The middles of the tabs, mm from the start of the first loop, and whether some are near
    corners.

    All seams of the `group` are kept free.

    ideals: places that the tabs should have, mm.
    crowded: stretches to avoid if there is another place, mm.
    """
    loop, places, near = group[0], list[float](), False
    length = loop.length
    # Tabs that are apart on one path may be nearer to each other on the path beside it.
    nearer = max(abs(beside.length - length) for beside in group)
    starts = [nearest(loop.round, one.round.position[0])[0] for one in group]
    seams = [
        (start + one.seam[0], start + one.seam[1]) for start, one in zip(starts, group, strict=True)
    ]
    spacing = tab.whole + nearer
    for ideal in ideals:
        others = [(place - spacing, place + spacing) for place in places]
        closed = _round([*seams, *others], length)
        clear = [
            *closed,
            *_round([(a - tab.top, b + tab.top) for a, b in loop.corners.tolist()], length),
        ]
        taken = _round([(a - tab.fall, b + tab.rise) for a, b in crowded], length)
        place = _nearest(ideal, [*clear, *taken], length)
        if place is None:
            place = _nearest(ideal, clear, length)
        if place is None:
            place = _farthest(ideal, closed, loop.corners, length)
            near |= place is not None
        if place is not None:
            places.append(place)
    return places, near


def _round(stretches: Sequence[tuple[float, float]], length: float) -> list[tuple[float, float]]:
    """The stretches of a loop, and the same once round before and after."""
    return [(a + turn, b + turn) for a, b in stretches for turn in (-length, 0.0, length)]


def _nearest(ideal: float, closed: Sequence[tuple[float, float]], length: float) -> float | None:
    """The place nearest to ``ideal`` that is within none of ``closed``."""
    places = [ideal, *(end for stretch in closed for end in stretch if 0 <= end <= length)]
    return min(
        (p for p in places if _open(p, closed)), key=lambda place: abs(place - ideal), default=None
    )


def _open(place: float, closed: Sequence[tuple[float, float]]) -> bool:
    return all(not low + SAME_POINT_MM < place < high - SAME_POINT_MM for low, high in closed)


def _farthest(
    ideal: float, closed: Sequence[tuple[float, float]], corners: FloatArray, length: float
) -> float | None:
    """The place farthest from all corners within none of ``closed``; of equal ones that nearest to ``ideal``."""
    around = sorted(_round([(a, b) for a, b in corners.tolist()], length))
    middles = [(one[1] + two[0]) / 2 for one, two in pairwise(around)]
    ends = [end for stretch in closed for end in stretch]
    places = [p for p in (*middles, *ends) if 0 <= p <= length and _open(p, closed)]

    def badness(place: float) -> tuple[float, float]:
        room = min(max(low - place, place - high, 0.0) for low, high in around)
        return -round(room, 3), abs(place - ideal)

    return min(places, key=badness, default=None)


def _hold(loop: _Loop, tab: _Tab, places: Sequence[float], chord: float) -> ToolPath:
    """The path with the floor of its tabs; what runs up and down is chords."""
    if not places:
        return loop.path
    middles = loop.begin + np.array(places)
    ends = np.array([-tab.rise, -tab.top, tab.top, tab.fall])
    at = (middles[:, None] + ends).ravel()
    low, high = -tab.depth, tab.height - tab.depth
    split = split_at(loop.path, at)
    floor = np.interp(lengths_along(split), at, np.tile([low, high, high, low], len(places)))
    for level in (low, high):
        floor[np.abs(floor - level) < SAME_POINT_MM] = level
    return chorded(
        replace(split, floor=frozen(floor)), chord, np.abs(np.diff(floor)) > SAME_POINT_MM
    )


def _tell(
    held: Sequence[str],
    middles: Sequence[tuple[float, float]],
    near: Sequence[str],
    without: Sequence[_Loop],
    pieces: Sequence[ToolPath],
    job: Job,
) -> list[Note]:
    """How many tabs there are, of what size and where; and what is not as it was asked."""
    size = f"{short(job.operation.tab_width, 3)} x {short(job.operation.tab_height, 3)} mm"
    notes = []
    if held:
        what = f"{counted(len(middles), 'tab')} of {size} on {name_first(held)}"
        notes.append(
            Note(
                "assumed",
                what,
                "they hold the part; cut them when it is out",
                places=tuple(middles),
            )
        )
    elif not without:
        why = "only a path all around a part, or a slug larger than a chip, has them"
        notes.append(Note("warning", "no tabs: no path cuts anything out", why))
    if near:
        why = "no place is as far from all corners as the tool's radius and half the tab's width"
        notes.append(Note("warning", f"tabs near corners on {name_first(near)}", why))
    if without:
        why = "there is no room for them beside the seam, its leads and each other; fewer or shorter ones may fit"
        what = f"fewer tabs than asked on {name_first([loop.path.id for loop in without])}"
        ids = tuple(join.from_iterable(loop.path.contours for loop in without))
        notes.append(Note("warning", what, why, ids, lacks="tabs"))
    if pieces and (held or without):
        why = "only a path that runs all round has tabs; what others cut free comes loose"
        what = f"no tabs on {name_first([path.id for path in pieces])}"
        ids = tuple(join.from_iterable(path.contours for path in pieces))
        notes.append(Note("warning", what, why, ids, lacks="tabs"))
    return notes
