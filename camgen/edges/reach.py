"""Can the robot process an edge, and how: the nominal pose first, the tool's freedom only where that fails."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache

import numpy as np

from camgen.edges.freedom import Grid, grid
from camgen.edges.moving import JUMP, MARGIN, dense_parts, flange_poses
from camgen.edges.poses import Offset, poses
from camgen.edges.results import Freedom, Reached, Setup, Unreached
from camgen.edges.search import searched
from camgen.edges.ways import Way, divided, rows
from camgen.pose import frozen
from camgen.robots.continuity import Choice, follow
from camgen.robots.reasons import why
from camgen.solid import Edge
from camgen.text import short

_grid = cache(grid)
_NONE = Freedom()


def reach(
    edges: Iterable[Edge], setup: Setup, offset: float, direction: Offset = "mean", freedom: Freedom = _NONE
) -> tuple[Reached | Unreached, ...]:
    """How each of ``edges`` is processed ``offset`` mm away from it (``poses.poses``), or why it cannot be.

    Each motion keeps the joint limits, 2 deg from singularities and clear of collisions wherever it is looked at, at
    least every 5 mm and 5 deg, and no joint turns by more than 15 deg from look to look.
    """
    return tuple(_reached(edge, setup, offset, direction, freedom) for edge in edges)


def _reached(edge: Edge, setup: Setup, offset: float, direction: Offset, freedom: Freedom) -> Reached | Unreached:
    way = poses(edge, offset, direction)
    if isinstance(way, Unreached):
        return way
    plain = _nominal(setup, edge.id, way)
    if isinstance(plain, Reached):
        return plain
    collision = ""
    for choice in _grids(plain, freedom):
        found = searched(setup, edge.id, way, choice)
        if isinstance(found, Reached):
            return found
        collision = found
    return Unreached(edge.id, plain.kind, plain.text + _in_vain(freedom, collision)) if freedom else plain


def _grids(plain: Unreached, freedom: Freedom) -> list[Grid]:
    """What is tried, in this order: another branch where the first collides, a roll, which costs nothing, all."""
    steps = [Freedom()] if plain.kind == "collision" else []
    steps += [Freedom(roll=True)] if freedom.roll else []
    steps += [freedom] if freedom.tilt > 0 else []
    return [_grid(step) for step in steps]


def _in_vain(freedom: Freedom, collision: str) -> str:
    parts = [f"{short(np.degrees(freedom.tilt), 2)} deg of tilt"] if freedom.tilt > 0 else []
    parts += ["any roll"] if freedom.roll else []
    return f"; with {' and '.join(parts)}: " + (f"collision, {collision}" if collision else "no way either")


def _nominal(setup: Setup, name: str, way: Way) -> Reached | Unreached:
    parts = dense_parts(way)
    dense = divided(way, parts)
    goal = flange_poses(setup, dense.position, dense.rotation)
    found = follow(setup.robot, *goal, margin=MARGIN, jump=JUMP)
    if not isinstance(found, Choice):
        reason = why(setup.robot, *goal, found, MARGIN, JUMP)
        return Unreached(name, reason.kind, f"{reason.text}, {_place(dense, reason.row)}")
    hit = np.flatnonzero(~setup.clear(found.joints))
    if len(hit):
        text = f"collision, {setup.hit(found.joints[hit[0]])}, {_place(dense, int(hit[0]))}"
        return Unreached(name, "collision", text)
    at, none = rows(parts), frozen(np.zeros(len(dense)))
    return Reached(name, False, way, frozen(found.joints[at]), frozen(found.joints), at, none, none)


def _place(dense: Way, row: int) -> str:
    return f"{short(float(dense.length[:row].sum()), 1)} mm along it"
