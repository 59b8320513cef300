"""Leaves out paths of a mill on which its tool or holder would come too near to a fixture.

A path along a contour loses only its stretch beside the fixture; its other stretches become open
paths. A hole, a pocket and a filled area are left out as a whole.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import chain, pairwise
from typing import Any

import numpy as np
import shapely
from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry.arcs import make_span_chain
from camgen.geometry.fixtures import Body, Fixture, Fixtures, list_bodies
from camgen.model.job import Job, ToolTable
from camgen.model.part import BoolArray, Note
from camgen.model.path import ToolPath
from camgen.model.pose import FloatArray
from camgen.model.text import short
from camgen.model.tolerance import NONZERO, SAME_POINT_MM
from camgen.plan import EdgePlan, JobPlan, Plan, ReplayPlan, join_paths
from camgen.plan.leave_out import leave_out_paths
from camgen.plan.pieces import begin_at, lengths_along, split_at

#: Operations along contours, which are left out stretch by stretch.
_BY_STRETCH = ("follow", "trace", "chamfer")
#: The margin is wider by this, mm: a path is tested in places, and leaves their chords by half of
#: it at most.
_MORE_MM = 0.02
#: Ends of stretches are found within this, mm.
_EXACT_MM = 1e-4
#: A stretch that is not longer, mm, is not cut alone.
_SHORTEST_MM = 0.5
#: Chords of a quarter of a circle around a fixture.
_QUARTER = 16


class _Zone(Struct, frozen=True, eq=False):
    """The area that is closed to the axis of a tool, for one body and one fixture.

    area: polygon, mm.
    body: body that would come too near.
    fixture: fixture to which it would.
    """

    area: Any
    body: Body
    fixture: Fixture


class _Blocked(Struct, frozen=True, eq=False):
    """The areas that are closed to the axis of some tools with their tips at one height.

    zones: one for each body and fixture.
    area: all of them together, prepared; empty for none.
    step: places of a path that are tested are no farther apart, mm.
    """

    zones: tuple[_Zone, ...]
    area: Any
    step: float


class _Split(Struct, frozen=True, eq=False):
    """The stretches of a path.

    kept: its stretches, the path itself where nothing is in the way.
    lost: stretches that are left out.
    zones: the zones in which they are.
    """

    kept: tuple[ToolPath, ...]
    lost: tuple[ToolPath, ...]
    zones: tuple[_Zone, ...]


def clear_fixtures(plan: Plan, job: Job, fixtures: Fixtures) -> Plan:
    """The plan without the paths and stretches that a fixture blocks, which its notes name."""
    if isinstance(plan, (EdgePlan, ReplayPlan)):
        return plan
    areas = _Areas(fixtures)
    in_space = bool(plan.part.curves)
    whole: dict[str, str] = {}
    notes: list[Note] = []
    cleared: list[Plan] = []
    for operation, tool, prefix in _list_operations(plan, job):
        splits = [_split(path, areas.find(path, tool), in_space) for path in operation.paths]
        for path, split in zip(operation.paths, splits, strict=True):
            if not split.zones:
                continue
            areas.remember(path, tool)
            reason = _state_reason(split.zones, fixtures)
            if split.kept:
                notes.append(_note_stretches(prefix, path, split, reason))
            else:
                whole[path.id] = reason
        cleared.append(_replace_paths(operation, splits))
    if not whole and not notes:
        return plan
    clear_plan = cleared[0]
    if isinstance(plan, JobPlan):
        clear_plan = replace(
            plan,
            plans=tuple(cleared),
            paths=join_paths(cleared),
            left_out=tuple(chain.from_iterable(operation.left_out for operation in cleared)),
        )
    return leave_out_paths(replace(clear_plan, notes=(*plan.notes, *notes)), whole)


def _list_operations(plan: Plan, job: Job) -> Iterator[tuple[Plan, ToolTable, str]]:
    """The plan of each operation with its tool, and the beginning of notes on it."""
    if not isinstance(plan, JobPlan):
        yield plan, job.tool, ""
        return
    for number, step, planned in zip(plan.numbers, plan.steps, plan.plans, strict=True):
        yield planned, step.tool, f"operation {number} ({step.operation.kind}): "


class _Areas(Struct, eq=False):
    """The blocked areas of all tools and heights, each made once.

    At a contour a later tool leaves out all that an earlier, wider one has left: its paths are
    tested with the areas of both.

    fixtures: the fixtures.
    earlier: the tools that have left something at a contour.
    known: the areas by their tools and their height.
    """

    fixtures: Fixtures
    earlier: dict[str, list[ToolTable]] = {}
    known: dict[tuple[object, ...], _Blocked] = {}

    def find(self, path: ToolPath, tool: ToolTable) -> _Blocked:
        """The closed areas of a path of this tool."""
        tools = [tool]
        for name in path.contours:
            tools += self.earlier.get(name, [])
        lowest = float(path.position[:, 2].min()) - max(path.depths)
        key = (*map(id, tools), lowest)
        if key not in self.known:
            self.known[key] = _block(tools, lowest, self.fixtures)
        return self.known[key]

    def remember(self, path: ToolPath, tool: ToolTable) -> None:
        """Remembers that the tool has left something at the contours of a path."""
        for name in path.contours:
            self.earlier.setdefault(name, []).append(tool)


def _block(tools: Sequence[ToolTable], lowest: float, fixtures: Fixtures) -> _Blocked:
    zones: list[_Zone] = []
    for tool in tools:
        zones += _list_zones(tool, lowest, fixtures)
    area = shapely.union_all([zone.area for zone in zones])
    shapely.prepare(area)
    smallest = min((zone.body.radius for zone in zones), default=1.0) + fixtures.margin
    # Between two places a path leaves their chord by half of the additional margin at most.
    return _Blocked(tuple(zones), area, float(np.sqrt(8 * smallest * _MORE_MM / 2)))


def _split(path: ToolPath, blocked: _Blocked, in_space: bool) -> _Split:
    """A path in stretches, none of which is near to a fixture.

    in_space: whether the path follows a curve in space, which is kept or left out as a whole.
    """
    untouched = _Split((path,), (), ())
    area, shape = blocked.area, make_span_chain(path.position, path.via[1:])
    if not area.intersects(_find_box(path)):
        return untouched
    along = lengths_along(path)
    count = np.maximum(np.ceil(np.diff(along) / blocked.step), 1).astype(np.int64)
    lengths = np.unique(
        np.concatenate(
            [
                np.linspace(start, end, number + 1)
                for start, end, number in zip(along, along[1:], count.tolist(), strict=False)
            ]
            or [np.zeros(1)]
        )
    )

    def find_points(places: FloatArray) -> FloatArray:
        if len(path) == 1:
            return path.position[:, :2]
        segment = np.clip(np.searchsorted(along, places) - 1, 0, len(along) - 2)
        long = np.maximum(along[segment + 1] - along[segment], NONZERO)
        points = shape.point(np.clip((places - along[segment]) / long, 0.0, 1.0), segment)
        return np.asarray(points[:, :2])

    def test(places: FloatArray) -> BoolArray:
        return np.asarray(shapely.contains_xy(area, find_points(places)))

    inside = test(lengths)
    if not inside.any():
        return untouched
    points = find_points(lengths[inside])
    met = tuple(zone for zone in blocked.zones if shapely.contains_xy(zone.area, points).any())
    if inside.all() or in_space or path.operation not in _BY_STRETCH:
        return _Split((), (path,), met)
    kept, lost = _cut(path, _find_ends(lengths, inside, test), bool(inside[0]))
    return _Split(kept, lost, met)


def find_blocked(tool: ToolTable, lowest: float, fixtures: Fixtures | None) -> Any:
    """The area that is closed to the axis of a tool with its tip as low as `lowest`, mm."""
    zones = _list_zones(tool, lowest, fixtures) if fixtures else ()
    return shapely.union_all([zone.area for zone in zones])


def _list_zones(tool: ToolTable, lowest: float, fixtures: Fixtures) -> Iterator[_Zone]:
    for fixture in fixtures.listed:
        for body in list_bodies(tool):
            layers = [layer for layer in fixture.layers if layer.top > lowest + body.height]
            if layers:
                room = body.radius + fixtures.margin + _MORE_MM
                # Chords lie within the circle that they stand for.
                room /= np.cos(np.pi / 4 / _QUARTER)
                yield _Zone(
                    shapely.buffer(layers[-1].outline, room, quad_segs=_QUARTER), body, fixture
                )


def _find_box(path: ToolPath) -> Any:
    points = [path.position[:, :2]]
    arcs = ~np.isnan(path.via[:, 0])
    if arcs.any():
        via = path.via[arcs, :2]
        reach = np.hypot(*(path.position[arcs, :2] - via).T)[:, None]
        points += [via - reach, via + reach]
    corners = np.concatenate(points)
    return shapely.box(*corners.min(axis=0), *corners.max(axis=0))


def _find_ends(
    lengths: FloatArray, blocked: BoolArray, test: Callable[[FloatArray], BoolArray]
) -> FloatArray:
    """The lengths, mm, at which a path enters or leaves a closed area, on the free side."""
    change = np.flatnonzero(blocked[1:] != blocked[:-1])
    free = np.where(blocked[change], lengths[change + 1], lengths[change])
    shut = np.where(blocked[change], lengths[change], lengths[change + 1])
    while np.abs(shut - free).max() > _EXACT_MM:
        middle = (free + shut) / 2
        inside = test(middle)
        free, shut = np.where(inside, free, middle), np.where(inside, middle, shut)
    return np.asarray(free)


def _cut(
    path: ToolPath, ends: FloatArray, begins_blocked: bool
) -> tuple[tuple[ToolPath, ...], tuple[ToolPath, ...]]:
    if path.closed:
        # Begun where a blocked stretch ends, it is free at its start and blocked at its end.
        first = 0 if begins_blocked else 1
        whole = float(lengths_along(path)[-1])
        path = begin_at(path, float(ends[first]))
        ends = np.sort((ends - ends[first]) % whole)
        ends = ends[ends > SAME_POINT_MM]
        begins_blocked = False
    path = split_at(path, ends)
    along = lengths_along(path)
    vertices = [0, *(int(np.argmin(np.abs(along - end))) for end in ends), len(path) - 1]
    kept: list[ToolPath] = []
    lost: list[ToolPath] = []
    for k, (low, high) in enumerate(pairwise(vertices)):
        if high <= low:
            continue
        is_free = (k % 2 == 1) == begins_blocked
        is_long = along[high] - along[low] > _SHORTEST_MM
        (kept if is_free and is_long else lost).append(path.rows(low, high + 1))
    named = tuple(
        replace(stretch, id=f"{path.id}.{number}", pinned=False, entry_radius=0.0)
        for number, stretch in enumerate(kept, 1)
    )
    return named, tuple(lost)


def _replace_paths(plan: Plan, splits: Sequence[_Split]) -> Plan:
    """The plan with the stretches of its paths; a path without a kept stretch stays for now.

    Enclosed paths run before all stretches of a path: each stretch encloses the one before.
    """
    if not any(split.zones for split in splits):
        return plan
    counts = np.array([max(len(split.kept), 1) for split in splits])
    first = np.cumsum(counts) - counts
    around = {path.parent for path in plan.paths}
    paths: list[ToolPath] = []
    for k, (path, split) in enumerate(zip(plan.paths, splits, strict=True)):
        parent = int(first[path.parent]) if path.parent >= 0 else -1
        stretches = split.kept or (path,)
        for number, stretch in enumerate(stretches, 1):
            goes_on = k in around and number < len(stretches)
            paths.append(replace(stretch, parent=len(paths) + 1 if goes_on else parent))
    lost = tuple(chain.from_iterable(split.lost for split in splits))
    return replace(plan, paths=tuple(paths), left_out=lost)


def _state_reason(zones: Sequence[_Zone], fixtures: Fixtures) -> str:
    numbers = sorted({zone.fixture.number for zone in zones})
    which = f"{'fixture' if len(numbers) == 1 else 'fixtures'} {', '.join(map(str, numbers))}"
    bodies = " and ".join(dict.fromkeys(f"the {zone.body.name}" for zone in zones))
    if not fixtures.margin:
        return f"{which}: {bodies} would run into it"
    room = f"{short(fixtures.margin, 3)} mm, cell.margin"
    return f"{which}: {bodies} would come nearer than {room}"


def _note_stretches(prefix: str, path: ToolPath, split: _Split, reason: str) -> Note:
    length = sum(float(lengths_along(stretch)[-1]) for stretch in split.lost)
    return Note(
        "skipped",
        f"{prefix}{short(length, 1)} mm of path {path.id}",
        reason,
        tuple(dict.fromkeys((path.id, *path.contours))),
    )
