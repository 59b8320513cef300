"""Lifts the travel of a mill over the fixtures in its way: up, across, and down again.

The clearance height, `process.clearance`, is enough between most paths. A rapid motion that comes
within `cell.margin` of a fixture is raised to `cell.safety` above its top: the tool first goes
straight up where it is, and comes straight down where it is going.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from msgspec.structs import replace

from camgen.geometry.fixtures import Fixtures, list_bodies
from camgen.model.job import ToolTable
from camgen.model.pose import FloatArray, Pose
from camgen.model.program import Comment, Indices, Instruction, MoveJ, Program, splice
from camgen.model.tolerance import SAME_POINT_MM


def lift_over_fixtures(
    program: Program, fixtures: Fixtures, tools: Sequence[tuple[ToolTable, int]]
) -> Program:
    """The program with its travel above the fixtures.

    tools: the tools in the order of their use, with the number of paths of each.
    """
    columns = program.columns
    ends = columns.ends
    rapid = columns.moves_are(MoveJ)
    start = np.roll(ends, 1, axis=0)
    crosses = np.hypot(*(ends - start)[:, :2].T) > SAME_POINT_MM
    links = np.flatnonzero(
        rapid & crosses & np.append(False, columns.posed[:-1] & columns.posed[1:])
    )
    if not len(links):
        return program
    heights = _find_heights(start[links], ends[links], columns.path[links], fixtures, tools)
    changed: dict[int, tuple[Instruction, ...]] = {}
    low = np.minimum(start[links, 2], ends[links, 2]) < heights - SAME_POINT_MM
    for link, height in zip(links[low].tolist(), heights[low].tolist(), strict=True):
        _lift(program, link, height, changed)
    return program.with_body(splice(program.body, changed)) if changed else program


def _find_heights(
    start: FloatArray,
    end: FloatArray,
    path: Indices,
    fixtures: Fixtures,
    tools: Sequence[tuple[ToolTable, int]],
) -> FloatArray:
    """(K,) least z of travel from start to end, (K, 3), mm; -inf where no fixture is near.

    path: (K,) the path that each belongs to; -1 for one of none, which may have any tool.
    """
    lines = shapely.linestrings(np.stack([start[:, :2], end[:, :2]], axis=1))
    heights = np.full(len(lines), -np.inf)
    first = 0
    for tool, count in tools:
        rows = np.flatnonzero((path < 0) | ((path >= first) & (path < first + count)))
        first += count
        for body in list_bodies(tool):
            room = body.radius + fixtures.margin
            for fixture in fixtures.listed:
                near = rows[shapely.dwithin(lines[rows], fixture.outline, room)]
                for layer in fixture.layers:
                    crossing = near[shapely.dwithin(lines[near], layer.outline, room)]
                    height = layer.top + fixtures.lift - body.height
                    heights[crossing] = np.maximum(heights[crossing], height)
    return heights


def _lift(
    program: Program, link: int, height: float, changed: dict[int, tuple[Instruction, ...]]
) -> None:
    """Puts into `changed` what takes the place of one rapid motion at least `height` mm high."""
    columns = program.columns
    index = int(columns.at[link])
    move = columns.moves[link]
    before = columns.ends[link - 1]
    motions = []
    if before[2] < height - SAME_POINT_MM:
        previous = int(columns.at[link - 1])
        remarks = all(isinstance(item, Comment) for item in program.body[previous + 1 : index])
        if remarks and _goes_straight(program, link - 1, up=True):
            # One motion upwards instead of two.
            changed[previous] = (_at_height(columns.moves[link - 1], before, height),)
        else:
            motions.append(_at_height(move, before, height))
    ends_low = columns.ends[link][2] < height - SAME_POINT_MM
    if ends_low:
        motions.append(_at_height(move, columns.ends[link], height))
    if not (ends_low and _goes_on_down(program, link)):
        motions.append(move)
    changed[index] = tuple(motions)


def _at_height(move: MoveJ, point: FloatArray, height: float) -> MoveJ:
    assert isinstance(move.target, Pose)
    x, y = point[:2].tolist()
    return replace(move, target=replace(move.target, origin=(x, y, height)), blend=0.0)


def _goes_straight(program: Program, motion: int, up: bool) -> bool:
    columns = program.columns
    if motion < 1 or not columns.moves_are(MoveJ)[motion]:
        return False
    x, y, z = (columns.ends[motion] - columns.ends[motion - 1]).tolist()
    return bool(np.hypot(x, y) <= SAME_POINT_MM and (z > 0) == up)


def _goes_on_down(program: Program, link: int) -> bool:
    columns = program.columns
    follows = link + 1 < len(columns.at) and columns.at[link + 1] == columns.at[link] + 1
    return bool(follows) and _goes_straight(program, link + 1, up=False)
