"""Finds joint values along pose paths: the nominal orientation first, the tool's freedom after it.

Other orientations are searched only if the nominal one fails or does not keep the margin.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np
from msgspec.structs import replace

from camgen.geometry.ragged import compute_offsets
from camgen.model.part import BoolArray, Line
from camgen.model.pose import frozen
from camgen.model.text import short
from camgen.motion.pose_paths import PosePath, divide
from camgen.motion.search import Grid, can_stand, make_grid, search
from camgen.motion.setup import (
    JUMP,
    MARGIN,
    EdgeMotion,
    OrientationFreedom,
    Setup,
    UnreachableEdge,
    compute_flange_poses,
    count_samples,
)
from camgen.robots.kinematics.continuity import Choice, follow_each
from camgen.robots.kinematics.reasons import explain_stuck

#: Fraction of the tilt that rows on arcs may have. The tool axis leans more between two rows.
_ON_ARCS = 0.9
#: Edges that are computed together in the nominal orientation: bounds the memory.
_TOGETHER = 32

#: The motion along a pose path, or the reason for none.
_Result = EdgeMotion | UnreachableEdge


def reach_paths(
    paths: Iterable[tuple[Line, PosePath | UnreachableEdge]],
    setup: Setup,
    freedom: OrientationFreedom = OrientationFreedom(),  # noqa: B008 (frozen)
    on_progress: Callable[[int], None] = lambda _: None,
) -> tuple[_Result, ...]:
    """The motion of the arm along each pose path, or the reason for none.

    Each motion keeps the joint limits, stays 2 deg from singularities, and is free of collisions at
    all of its samples. Between these the TCP moves by at most 5 mm and 5 deg, and a joint by at
    most 15 deg.

    paths: lines with their pose paths, or with the reason why they have none.
    on_progress: callback that gets the number of lines that were tried.
    """
    lines = list(paths)
    results: list[_Result] = []
    for begin in range(0, len(lines), _TOGETHER):
        batch = lines[begin : begin + _TOGETHER]
        named = [(line.id, path) for line, path in batch if isinstance(path, PosePath)]
        nominal = iter(_reach_nominal(setup, named))
        for done, (_, path) in enumerate(batch, begin):
            on_progress(done)
            results.append(
                _reach_freely(setup, path, freedom, next(nominal))
                if isinstance(path, PosePath)
                else path
            )
    return tuple(results)


def can_end(setup: Setup, paths: Sequence[PosePath], freedom: OrientationFreedom) -> BoolArray:
    """Whether the arm reaches both ends of pose paths in an orientation of `freedom`, (K,).

    If not, `reach_along` finds no motion either, and takes many times as long.
    """
    grids = [widest_grid(freedom, path) for path in paths]
    can = np.ones(len(paths), dtype=np.bool_)
    for choice in dict.fromkeys(grids):
        indices = [k for k, path_grid in enumerate(grids) if path_grid is choice]
        can[indices] = _can_end(setup, [paths[k] for k in indices], choice)
    return can


def _can_end(setup: Setup, paths: Sequence[PosePath], choice: Grid) -> BoolArray:
    can = np.ones(len(paths), dtype=np.bool_)
    # Without a closed form the joint values depend on the previous ones.
    for end in (0, -1) if setup.robot.arm else ():
        indices = np.flatnonzero(can)
        if len(indices):
            position = np.stack([paths[k].position[end] for k in indices.tolist()])
            rotation = np.stack([paths[k].rotation[end] for k in indices.tolist()])
            can[indices] = can_stand(setup, position, rotation, choice)
    return can


def reach_along(setup: Setup, name: str, path: PosePath, freedom: OrientationFreedom) -> _Result:
    """The motion of the arm along a pose path, or the reason for none.

    A motion that keeps the margin is preferred.

    name: id of the edge.
    """
    (nominal,) = _reach_nominal(setup, [(name, path)])
    return _reach_freely(setup, path, freedom, nominal)


def _reach_freely(
    setup: Setup, path: PosePath, freedom: OrientationFreedom, nominal: _Result
) -> _Result:
    """`reach_along`, where `nominal` is the result in the nominal orientation."""
    if isinstance(nominal, EdgeMotion):
        return _keep_margin(nominal, setup, path, _list_grids("collision", freedom, path), freedom)
    collision = ""
    grids = _list_grids(nominal.kind, freedom, path)
    for k, choice in enumerate(grids):
        # The last one is searched in any case, because it names the obstacle.
        if k < len(grids) - 1 and not _can_end(setup, [path], choice).all():
            continue
        result = search(setup, nominal.id, path, choice, freedom.tilt)
        if isinstance(result, EdgeMotion):
            return _keep_margin(result, setup, path, grids[k:], freedom)
        collision = result
    if not freedom:
        return nominal
    text = nominal.text + _describe_search(freedom, collision)
    return UnreachableEdge(nominal.id, nominal.kind, text)


def _keep_margin(
    motion: EdgeMotion,
    setup: Setup,
    path: PosePath,
    grids: Sequence[Grid],
    freedom: OrientationFreedom,
) -> EdgeMotion:
    """The motion if it keeps the margin, else one in `grids` that does, else the motion."""
    if setup.roomy(motion.sampled_joints).all():
        return motion
    roomy = replace(setup, clear=setup.roomy)
    for choice in grids:
        other = search(roomy, motion.id, path, choice, freedom.tilt)
        if isinstance(other, EdgeMotion):
            return replace(other, nearer=motion)
    return motion


def _list_grids(kind: str, freedom: OrientationFreedom, path: PosePath) -> list[Grid]:
    """The orientations to be tried, in order, if the nominal one fails for a reason of this kind.

    After a collision another branch is tried first. A roll costs nothing, so it comes before tilt.
    """
    steps = [OrientationFreedom()] if kind == "collision" else []
    steps += [replace(freedom, tilt=0.0)] if freedom.roll else []
    fraction = _ON_ARCS if np.isfinite(path.via).any() else 1.0
    steps += [replace(freedom, tilt=fraction * freedom.tilt)] if freedom.tilt > 0 else []
    return list(map(make_grid, steps))


def widest_grid(freedom: OrientationFreedom, path: PosePath) -> Grid:
    """All orientations that the tool may have along a pose path."""
    return _list_grids("collision", freedom, path)[-1]


def _describe_search(freedom: OrientationFreedom, collision: str) -> str:
    """The end of the reason why no orientation is reached. collision: the obstacle, or empty."""
    parts = [f"{short(np.degrees(freedom.tilt), 2)} deg of tilt"] if freedom.tilt > 0 else []
    if freedom.roll:
        parts.append("any roll" if freedom.turns is None else "any roll of tool.turn")
    result = f"collision, {collision}" if collision else "no way either"
    return f"; with {' and '.join(parts)}: {result}"


def _reach_nominal(setup: Setup, paths: Sequence[tuple[str, PosePath]]) -> list[_Result]:
    """The motion along each pose path in the nominal orientation, or the reason for none."""
    parts = [count_samples(path) for _, path in paths]
    samples = [divide(path, count) for (_, path), count in zip(paths, parts, strict=True)]
    goals = [compute_flange_poses(setup, path.position, path.rotation) for path in samples]
    choices = follow_each(setup.robot, goals, [setup.robot.home] * len(goals), MARGIN, JUMP)
    results: list[_Result] = []
    joints = [choice.joints for choice in choices if isinstance(choice, Choice)]
    if joints:
        ends = np.cumsum(list(map(len, joints)))
        is_clear = iter(np.split(setup.clear(np.concatenate(joints)), ends))
    for (name, path), count, sampled, goal, choice in zip(
        paths, parts, samples, goals, choices, strict=True
    ):
        if not isinstance(choice, Choice):
            reason = explain_stuck(setup.robot, *goal, choice, MARGIN, JUMP)
            text = f"{reason.text}, {_describe_place(sampled, reason.row)}"
            results.append(UnreachableEdge(name, reason.kind, text))
            continue
        hits = np.flatnonzero(~next(is_clear)).tolist()
        if hits:
            place = _describe_place(sampled, hits[0])
            text = f"collision, {setup.hit(choice.joints[hits[0]])}, {place}"
            results.append(UnreachableEdge(name, "collision", text))
            continue
        at, dense, zero = (
            compute_offsets(count),
            frozen(choice.joints),
            frozen(np.zeros(len(sampled))),
        )
        joints_at = frozen(choice.joints[at])
        results.append(EdgeMotion(name, False, path, joints_at, sampled, dense, at, zero, zero))
    return results


def _describe_place(path: PosePath, row: int) -> str:
    return f"{short(float(path.length[:row].sum()), 1)} mm along it"
