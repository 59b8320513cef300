"""Can the arm run a pose path, and how: the nominal pose first, the tool's freedom only where that fails."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import cache

import numpy as np
from msgspec.structs import replace

from camgen.model.part import BoolArray, Line
from camgen.model.pose import frozen
from camgen.model.text import short
from camgen.motion.pose_paths import PosePath, divide, rows
from camgen.motion.search import Grid, can_stand, grid, search
from camgen.motion.setup import (
    JUMP,
    MARGIN,
    EdgeMotion,
    OrientationFreedom,
    Setup,
    UnreachableEdge,
    dense_parts,
    flange_poses,
)
from camgen.robots.kinematics.continuity import Choice, follow_each
from camgen.robots.kinematics.reasons import why

_grid = cache(grid)
_NONE = OrientationFreedom()
#: Of the tilt, what rows on arcs may have.
_ON_ARCS = 0.9
#: So many edges are looked at together in the nominal orientation: bounds the memory.
_TOGETHER = 32


def _ignore(_: int) -> None:
    """For callers who do not look at it."""


def reach_ways(
    ways: Iterable[tuple[Line, PosePath | UnreachableEdge]],
    setup: Setup,
    freedom: OrientationFreedom = _NONE,
    tell: Callable[[int], None] = _ignore,
) -> tuple[EdgeMotion | UnreachableEdge, ...]:
    """How the arm runs each of ``ways``.

    ways: lines with their poses, or with the reason why they have no poses.
    tell: callback that gets the number of lines that were tried.

    Each motion keeps the joint limits, 2 deg from singularities and clear of collisions wherever it is looked at, at
    least every 5 mm and 5 deg, and no joint turns by more than 15 deg from look to look.
    """
    listed, found = list(ways), []
    for begin in range(0, len(listed), _TOGETHER):
        some = listed[begin : begin + _TOGETHER]
        plain = iter(
            _nominal(setup, [(line.id, way) for line, way in some if isinstance(way, PosePath)])
        )
        for done, (_, way) in enumerate(some, begin):
            tell(done)
            found.append(
                _free(setup, way, freedom, next(plain)) if isinstance(way, PosePath) else way
            )
    return tuple(found)


def can_end(setup: Setup, ways: Sequence[PosePath], freedom: OrientationFreedom) -> BoolArray:
    """The ways at both of whose ends the arm can stand in some orientation of ``freedom``, (K,).

    Along others ``reach_along`` finds no motion either, and takes many times as long.
    """
    choices = [widest_grid(freedom, way) for way in ways]
    found = np.ones(len(ways), dtype=np.bool_)
    for choice in dict.fromkeys(choices):
        own = np.array([k for k, one in enumerate(choices) if one is choice])
        found[own] = _can_end(setup, [ways[k] for k in own.tolist()], choice)
    return found


def _can_end(setup: Setup, ways: Sequence[PosePath], choice: Grid) -> BoolArray:
    found = np.ones(len(ways), dtype=np.bool_)
    # Without a closed form joints depend on those before them.
    for end in (0, -1) if setup.robot.arm else ():
        left = np.flatnonzero(found)
        if len(left):
            position, rotation = (
                np.stack([getattr(ways[k], name)[end] for k in left.tolist()])
                for name in ("position", "rotation")
            )
            found[left] = can_stand(setup, position, rotation, choice)
    return found


def reach_along(
    setup: Setup, name: str, way: PosePath, freedom: OrientationFreedom
) -> EdgeMotion | UnreachableEdge:
    """How the arm runs ``way``, which is called ``name``, with the margin, or else without it, or why it cannot."""
    return reach_each(setup, [(name, way)], freedom)[0]


def reach_each(
    setup: Setup, ways: Sequence[tuple[str, PosePath]], freedom: OrientationFreedom
) -> list[EdgeMotion | UnreachableEdge]:
    """``reach_along`` of each of several, with their names."""
    nominal = _nominal(setup, ways)
    return [
        _free(setup, way, freedom, plain) for (_, way), plain in zip(ways, nominal, strict=True)
    ]


def _free(
    setup: Setup, way: PosePath, freedom: OrientationFreedom, plain: EdgeMotion | UnreachableEdge
) -> EdgeMotion | UnreachableEdge:
    """``reach_along`` where the nominal orientation comes to ``plain``."""
    name = plain.id
    if isinstance(plain, EdgeMotion):
        return _prefer(plain, setup, way, _grids("collision", freedom, way), freedom)
    collision = ""
    grids = _grids(plain.kind, freedom, way)
    for k, choice in enumerate(grids):
        # The last one is searched in any case: it says what stands in the way.
        if k < len(grids) - 1 and not _can_end(setup, [way], choice).all():
            continue
        found = search(setup, name, way, choice, freedom.tilt)
        if isinstance(found, EdgeMotion):
            return _prefer(found, setup, way, grids[k:], freedom)
        collision = found
    return (
        UnreachableEdge(name, plain.kind, plain.text + _in_vain(freedom, collision))
        if freedom
        else plain
    )


def _prefer(
    found: EdgeMotion,
    setup: Setup,
    way: PosePath,
    grids: Sequence[Grid],
    freedom: OrientationFreedom,
) -> EdgeMotion:
    """``found`` where it keeps the margin, else what of ``grids`` keeps it, else ``found`` again."""
    if setup.roomy(found.dense).all():
        return found
    roomy = replace(setup, clear=setup.roomy)
    for choice in grids:
        other = search(roomy, found.id, way, choice, freedom.tilt)
        if isinstance(other, EdgeMotion):
            return replace(other, nearer=found)
    return found


def _grids(kind: str, freedom: OrientationFreedom, way: PosePath) -> list[Grid]:
    """What is tried where the nominal way fails for a reason of this kind, in this order: another branch where the
    first collides, a roll, which costs nothing, all.
    """
    steps = [OrientationFreedom()] if kind == "collision" else []
    steps += [replace(freedom, tilt=0.0)] if freedom.roll else []
    # Along an arc the axis leans more between two rows than at them: the grid leaves room for it.
    share = _ON_ARCS if np.isfinite(way.via).any() else 1.0
    steps += [replace(freedom, tilt=share * freedom.tilt)] if freedom.tilt > 0 else []
    return [_grid(step) for step in steps]


def widest_grid(freedom: OrientationFreedom, way: PosePath) -> Grid:
    """All orientations that the tool may have along ``way``."""
    return _grids("collision", freedom, way)[-1]


def _in_vain(freedom: OrientationFreedom, collision: str) -> str:
    parts = [f"{short(np.degrees(freedom.tilt), 2)} deg of tilt"] if freedom.tilt > 0 else []
    parts += (
        ["any roll" if freedom.turns is None else "any roll of tool.turn"] if freedom.roll else []
    )
    return f"; with {' and '.join(parts)}: " + (
        f"collision, {collision}" if collision else "no way either"
    )


def _nominal(
    setup: Setup, ways: Sequence[tuple[str, PosePath]]
) -> list[EdgeMotion | UnreachableEdge]:
    """How the arm runs each of ``ways``, with their names, in the nominal orientation, or why it cannot."""
    parts = [dense_parts(way) for _, way in ways]
    dense = [divide(way, own) for (_, way), own in zip(ways, parts, strict=True)]
    goals = [flange_poses(setup, one.position, one.rotation) for one in dense]
    found = follow_each(setup.robot, goals, [setup.robot.home] * len(goals), MARGIN, JUMP)
    tested = [one.joints for one in found if isinstance(one, Choice)]
    clear = iter(
        np.split(setup.clear(np.concatenate(tested)), np.cumsum([len(one) for one in tested]))
        if tested
        else []
    )
    made: list[EdgeMotion | UnreachableEdge] = []
    for (name, way), own, looks, goal, one in zip(ways, parts, dense, goals, found, strict=True):
        if not isinstance(one, Choice):
            reason = why(setup.robot, *goal, one, MARGIN, JUMP)
            made.append(
                UnreachableEdge(name, reason.kind, f"{reason.text}, {_place(looks, reason.row)}")
            )
            continue
        hit = np.flatnonzero(~next(clear))
        if len(hit):
            text = f"collision, {setup.hit(one.joints[hit[0]])}, {_place(looks, int(hit[0]))}"
            made.append(UnreachableEdge(name, "collision", text))
            continue
        at, none = rows(own), frozen(np.zeros(len(looks)))
        made.append(
            EdgeMotion(
                name, False, way, frozen(one.joints[at]), looks, frozen(one.joints), at, none, none
            )
        )
    return made


def _place(dense: PosePath, row: int) -> str:
    return f"{short(float(dense.length[:row].sum()), 1)} mm along it"
