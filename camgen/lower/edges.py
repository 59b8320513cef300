"""From a route over the edges of a part to a program: link, approach, process on, along the edge, process off."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from msgspec.structs import replace

from camgen.geometry.rotations import interpolate_rotations, vectors_of
from camgen.lower.columns import blends, gather
from camgen.lower.contours import dwell, finish, in_air, joints_of, signal, switch_on
from camgen.lower.runs import plunge
from camgen.model.cell import Cell, Dynamics
from camgen.model.job import Job, ProcessTable
from camgen.model.path import ToolPath
from camgen.model.pose import FloatArray, Pose, frozen, to_vec3
from camgen.model.program import (
    Comment,
    Force,
    Instruction,
    Joints,
    MoveC,
    MoveJ,
    MoveL,
    Output,
    Program,
)
from camgen.model.tolerance import SAME_POINT_MM
from camgen.motion.corners import compute_corner_tolerance, limit_blends
from camgen.motion.pose_paths import PosePath
from camgen.motion.setup import EdgeMotion, compute_feed
from camgen.order import EdgeTour
from camgen.order.edges.links import JointLink, LinkMotion, PathLink


def lower_edges(
    tour: EdgeTour, cell: Cell, job: Job, name: str = "part", header: tuple[str, ...] = ()
) -> Program:
    """The program that runs the route of ``tour`` from and back to the home position of ``cell``.

    name, header: of the program.
    """
    route, lengths = tour.route, tour.lengths
    process = job.process
    assert isinstance(cell.home, Joints)
    body: list[Instruction] = [MoveJ(cell.home, process.travel_speed)]
    if process.spindle > 0:
        body += [Output("spindle", process.spindle), *dwell(process)]
    for number, (leg, length) in enumerate(zip(route.legs, lengths, strict=True)):
        out, way = _split(leg.link)
        body += _belonging(_link(out, job), number - 1, False)
        noun = "edge" if tour.paths[number].operation == "edges" else "curve"
        body.append(Comment(f"{noun} {leg.motion.id}"))
        link = [*_link(way, job)]
        if isinstance(leg.link[-1], JointLink):
            link += _state(leg.motion.way, process)
        body += _belonging(link, number, False)
        feed = compute_feed(leg.motion, length, process)
        blend = _blends(leg.motion, tour.paths[number], feed, job, cell.pace)
        body += _belonging(_work(leg.motion, feed, blend, job), number, True)
    out, way = _split(route.back[:-1])
    body += _belonging(_link(out, job), len(route.legs) - 1, False)
    body.append(Comment("back to home"))
    body += _link(way, job)
    if process.spindle > 0:
        body.append(Output("spindle", 0.0))
    last = route.back[-1]
    assert isinstance(last, JointLink)
    body.append(_turn(last))
    return finish(body, tour.paths, cell, job, name, header)


def _belonging(items: Iterable[Instruction], path: int, work: bool) -> Iterator[Instruction]:
    """``items`` with the path of the motions among them."""
    for item in items:
        yield (
            replace(item, path=path, work=work) if isinstance(item, (MoveJ, MoveL, MoveC)) else item
        )


def _split(link: Sequence[LinkMotion]) -> tuple[Sequence[LinkMotion], Sequence[LinkMotion]]:
    """The way up from the edge before, and that to the next one."""
    count = int(bool(link) and isinstance(link[0], PathLink) and link[0].kind == "retraction")
    return link[:count], link[count:]


def _link(link: Sequence[LinkMotion], job: Job) -> Iterator[Instruction]:
    """The pieces of a link; a tool that turns is switched on before it comes to the part, and off where it has left."""
    process, air = job.process, in_air(job)
    turned = False
    for piece in link:
        if isinstance(piece, JointLink):
            yield _turn(piece)
        elif piece.kind == "approach":
            yield from switch_on(process) if air else ()
            yield from _approach(piece, process)
        else:
            yield from _state(piece.way, process) if turned else ()
            yield from _along(piece.way, piece.speed)
            if air and signal(process) and piece.kind == "retraction":
                yield Output(signal(process), 0.0)
        turned = isinstance(piece, JointLink)


def _turn(piece: JointLink) -> MoveJ:
    return MoveJ(joints_of(piece.joints), piece.speed, share=piece.share)


def _state(way: PosePath, process: ProcessTable) -> Iterator[Instruction]:
    """After a motion to joints an arc has no start that the text knows: a motion to where the tool is states it."""
    if not math.isnan(way.via[1, 0]):
        yield MoveL(_pose(way.rotation[0], way.position[0]), process.travel_speed)


def _approach(piece: PathLink, process: ProcessTable) -> Iterator[Instruction]:
    """At its speed but for the last ``process.approach`` mm, which are run at the speed of plunging."""
    way = piece.way
    last = float(way.length[-1])
    slow = min(process.approach, last)
    if slow <= 0 or not np.isnan(way.via[-1, 0]):
        yield from _along(way, piece.speed)
        return
    ahead = _cut(way, 1 - slow / last) if slow < last else way.slice(0, len(way) - 1)
    yield from _along(ahead, piece.speed)
    yield MoveL(_pose(way.rotation[-1], way.position[-1]), plunge(process))


def _cut(way: PosePath, share: float) -> PosePath:
    """``way`` with its last segment, a straight one, only up to ``share`` of it."""
    position, rotation = way.position.copy(), way.rotation.copy()
    position[-1] = way.position[-2] + share * (way.position[-1] - way.position[-2])
    rotation[-1] = interpolate_rotations(
        way.rotation[-2:-1], way.rotation[-1:], np.array([0]), np.array([share])
    )[0]
    return PosePath(frozen(position), way.via, frozen(rotation))


def _along(way: PosePath, speed: FloatArray) -> Iterator[Instruction]:
    for row in range(1, len(way)):
        yield _segment(way, row, float(speed[row - 1]), 0.0)


def _blends(
    motion: EdgeMotion, path: ToolPath, feed: float, job: Job, pace: Dynamics
) -> list[float]:
    """The blend at the end of each row of ``path``: the tool runs on where that rounds the way by no more than
    ``tolerance.corner`` at ``feed`` and hardly changes how it stands; it stops at both ends and where it turns on the
    spot.
    """
    run = np.full(len(path.position), feed)
    rows = replace(gather([path], [0.0]), feed=run)
    blend = blends(rows, np.full_like(run, compute_corner_tolerance(job, path.operation)), pace)
    blend[1:-1] = limit_blends(blend[1:-1], _bends(motion.way), pace)
    return [float(radius) for radius in blend]


def _bends(way: PosePath) -> FloatArray:
    """(N - 2,) rad/mm by which the turning of the tool changes at the rows between two segments."""
    turn = vectors_of(way.rotation[1:] @ np.swapaxes(way.rotation[:-1], 1, 2))
    rate = turn / np.maximum(way.length, SAME_POINT_MM)[:, None]
    return np.asarray(np.linalg.norm(np.diff(rate, axis=0), axis=1))


def _work(
    motion: EdgeMotion, feed: float, blend: Sequence[float], job: Job
) -> Iterator[Instruction]:
    """The processing motion between force on, process on and process off, force off."""
    process, force = job.process, job.process.force
    name = "" if in_air(job) else signal(process)
    if force > 0:
        yield Force(force, to_vec3(motion.way.rotation[0, :, 2]))
    if name:
        yield from switch_on(process)
    for row in range(1, len(motion.way)):
        yield _segment(motion.way, row, feed, force, blend[row])
    if name:
        yield Output(name, 0.0)
    if force > 0:
        yield Force(0.0)


def _segment(
    way: PosePath, row: int, speed: float, force: float, blend: float = 0.0
) -> MoveL | MoveC:
    """One motion; it presses along the tool."""
    target = _pose(way.rotation[row], way.position[row])
    press = to_vec3(way.rotation[row, :, 2]) if force > 0 else (0.0, 0.0, 0.0)
    if math.isnan(way.via[row, 0]):
        return MoveL(target, speed, blend, force, press)
    rotation = interpolate_rotations(
        way.rotation[row - 1 : row], way.rotation[row : row + 1], np.array([0]), np.array([0.5])
    )[0]
    return MoveC(_pose(rotation, way.via[row]), target, speed, blend, force, press)


def _pose(rotation: FloatArray, origin: FloatArray) -> Pose:
    return Pose(frozen(rotation), to_vec3(origin))
