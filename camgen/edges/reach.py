"""Can the robot process an edge, and how: the nominal pose first, the tool's freedom only where that fails."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache

import numpy as np
from msgspec.structs import replace

from camgen.edges.freedom import Grid, grid
from camgen.edges.moving import JUMP, MARGIN, dense_parts, flange_poses
from camgen.edges.poses import Offset, poses
from camgen.edges.results import Freedom, Reached, Setup, Unreached
from camgen.edges.search import searched
from camgen.edges.ways import Way, cut, divided, rows
from camgen.pose import frozen
from camgen.robots.continuity import Choice, follow
from camgen.robots.reasons import why
from camgen.solid import Edge
from camgen.text import short

_grid = cache(grid)
_NONE = Freedom()
#: Of the tilt, what rows on arcs may have.
_ON_ARCS = 0.9
#: Of the trim, what is tried.
_SHARES = (0.25, 0.5, 1.0)


def reach(
    edges: Iterable[Edge],
    setup: Setup,
    offset: float,
    direction: Offset = "mean",
    freedom: Freedom = _NONE,
    trim: float = 0.0,
) -> tuple[Reached | Unreached, ...]:
    """How each of ``edges`` is processed ``offset`` mm away from it (``poses.poses``), or why it cannot be. trim: mm at
    either end that may be left out where the whole cannot be reached; closed edges have no ends.

    Each motion keeps the joint limits, 2 deg from singularities and clear of collisions wherever it is looked at, at
    least every 5 mm and 5 deg, and no joint turns by more than 15 deg from look to look.
    """
    return tuple(_reached(edge, setup, offset, direction, freedom, trim) for edge in edges)


def _reached(
    edge: Edge, setup: Setup, offset: float, direction: Offset, freedom: Freedom, trim: float
) -> Reached | Unreached:
    way = poses(edge, offset, direction)
    if isinstance(way, Unreached):
        return way
    whole = _along(setup, edge.id, way, freedom)
    if isinstance(whole, Reached) or edge.closed:
        return whole
    length = float(way.length.sum())
    for low, high in _trims(trim, length):
        part = _along(setup, edge.id, cut(way, low, length - high), freedom)
        if isinstance(part, Reached):
            return replace(part, trimmed=(low, high))
    return whole


def _trims(trim: float, length: float) -> list[tuple[float, float]]:
    """What is left out at the ends, least first; at least half of the edge stays."""
    steps = [trim * share for share in _SHARES]
    found = [pair for step in steps for pair in ((0.0, step), (step, 0.0), (step, step))]
    return [pair for pair in found if 0 < sum(pair) <= length / 2]


def _along(setup: Setup, name: str, way: Way, freedom: Freedom) -> Reached | Unreached:
    plain = _nominal(setup, name, way)
    if isinstance(plain, Reached):
        return plain
    collision = ""
    for choice in _grids(plain, freedom, way):
        found = searched(setup, name, way, choice, freedom.tilt)
        if isinstance(found, Reached):
            return found
        collision = found
    return Unreached(name, plain.kind, plain.text + _in_vain(freedom, collision)) if freedom else plain


def _grids(plain: Unreached, freedom: Freedom, way: Way) -> list[Grid]:
    """What is tried, in this order: another branch where the first collides, a roll, which costs nothing, all."""
    steps = [Freedom()] if plain.kind == "collision" else []
    steps += [Freedom(roll=True)] if freedom.roll else []
    # Along an arc the axis leans more between two rows than at them: the grid leaves room for it.
    share = _ON_ARCS if np.isfinite(way.via).any() else 1.0
    steps += [Freedom(share * freedom.tilt, freedom.roll)] if freedom.tilt > 0 else []
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
