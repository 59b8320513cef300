"""Makes a program from a route over edges: link, process on, along the edge, process off."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from msgspec.structs import replace

from camgen.geometry.rotations import compute_rotation_vectors, interpolate_rotations
from camgen.lower.columns import compute_blends, gather_rows
from camgen.lower.contours import (
    find_signal,
    finish_program,
    is_switched_in_air,
    make_dwell,
    switch_on,
)
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
    """The program that runs the route of a tour from and back to the home position of the cell.

    name, header: name of the program, lines of its header.
    """
    route, lengths = tour.route, tour.lengths
    process = job.process
    assert isinstance(cell.home, Joints)
    body: list[Instruction] = [MoveJ(cell.home, process.travel_speed)]
    if process.spindle > 0:
        body += [Output("spindle", process.spindle), *make_dwell(process)]
    for number, (leg, length) in enumerate(zip(route.legs, lengths, strict=True)):
        out, to_next = _split_link(leg.link)
        body += _with_path(_run_link(out, job), number - 1, False)
        noun = "edge" if tour.paths[number].operation == "edges" else "curve"
        body.append(Comment(f"{noun} {leg.motion.id}"))
        link = [*_run_link(to_next, job)]
        if isinstance(leg.link[-1], JointLink):
            link += _state_pose(leg.motion.pose_path, process)
        body += _with_path(link, number, False)
        feed = compute_feed(leg.motion, length, process)
        blend = _compute_blends(leg.motion, tour.paths[number], feed, job, cell.pace)
        body += _with_path(_run_edge(leg.motion, feed, blend, job), number, True)
    out, to_next = _split_link(route.back[:-1])
    body += _with_path(_run_link(out, job), len(route.legs) - 1, False)
    body.append(Comment("back to home"))
    body += _run_link(to_next, job)
    if process.spindle > 0:
        body.append(Output("spindle", 0.0))
    last = route.back[-1]
    assert isinstance(last, JointLink)
    body.append(_make_joint_motion(last))
    return finish_program(body, tour.paths, cell, job, name, header)


def _with_path(items: Iterable[Instruction], path: int, work: bool) -> Iterator[Instruction]:
    for item in items:
        yield (
            replace(item, path=path, work=work) if isinstance(item, (MoveJ, MoveL, MoveC)) else item
        )


def _split_link(link: Sequence[LinkMotion]) -> tuple[Sequence[LinkMotion], Sequence[LinkMotion]]:
    """The retract from the edge before, and the rest of the link."""
    count = int(bool(link) and isinstance(link[0], PathLink) and link[0].kind == "retraction")
    return link[:count], link[count:]


def _run_link(link: Sequence[LinkMotion], job: Job) -> Iterator[Instruction]:
    """Yield the motions of a link.

    A tool that turns is switched on before it comes to the part, and off after it has left.
    """
    process, air = job.process, is_switched_in_air(job)
    after_joints = False
    for motion in link:
        if isinstance(motion, JointLink):
            yield _make_joint_motion(motion)
        elif motion.kind == "approach":
            yield from switch_on(process) if air else ()
            yield from _run_approach(motion, process)
        else:
            yield from _state_pose(motion.pose_path, process) if after_joints else ()
            yield from _run_path(motion.pose_path, motion.speed)
            if air and find_signal(process) and motion.kind == "retraction":
                yield Output(find_signal(process), 0.0)
        after_joints = isinstance(motion, JointLink)


def _make_joint_motion(link: JointLink) -> MoveJ:
    return MoveJ(Joints(tuple(link.joints.tolist())), link.speed, share=link.share)


def _state_pose(pose_path: PosePath, process: ProcessTable) -> Iterator[Instruction]:
    """Yield a motion to the present pose, if an arc follows a joint motion.

    The text would not hold the start of the arc otherwise.
    """
    if not math.isnan(pose_path.via[1, 0]):
        yield MoveL(_make_pose(pose_path.rotation[0], pose_path.position[0]), process.travel_speed)


def _run_approach(link: PathLink, process: ProcessTable) -> Iterator[Instruction]:
    """Yield an approach at its speed, with the end of its last straight piece at the plunge speed.

    The end is `process.approach` mm long, or the whole piece if that is shorter.
    """
    pose_path = link.pose_path
    last = float(pose_path.length[-1])
    slow = min(process.approach, last)
    if slow <= 0 or not np.isnan(pose_path.via[-1, 0]):
        yield from _run_path(pose_path, link.speed)
        return
    first_part = (
        _shorten_last(pose_path, 1 - slow / last)
        if slow < last
        else pose_path.slice(0, len(pose_path) - 1)
    )
    yield from _run_path(first_part, link.speed)
    yield MoveL(_make_pose(pose_path.rotation[-1], pose_path.position[-1]), plunge(process))


def _shorten_last(pose_path: PosePath, fraction: float) -> PosePath:
    """The pose path with its last segment, a straight one, only up to a fraction of its length."""
    position, rotation = pose_path.position.copy(), pose_path.rotation.copy()
    position[-1] = pose_path.position[-2] + fraction * (
        pose_path.position[-1] - pose_path.position[-2]
    )
    rotation[-1] = interpolate_rotations(
        pose_path.rotation[-2:-1], pose_path.rotation[-1:], np.array([0]), np.array([fraction])
    )[0]
    return PosePath(frozen(position), pose_path.via, frozen(rotation))


def _run_path(pose_path: PosePath, speed: FloatArray) -> Iterator[Instruction]:
    for row in range(1, len(pose_path)):
        yield _make_segment(pose_path, row, float(speed[row - 1]), 0.0)


def _compute_blends(
    motion: EdgeMotion, path: ToolPath, feed: float, job: Job, pace: Dynamics
) -> list[float]:
    """The blend radius at the end of each row of a path, mm.

    The corner path stays within `tolerance.corner` at this feed, and the orientation changes
    evenly. The tool stops at both ends and at reorientations.
    """
    feeds = np.full(len(path.position), feed)
    rows = replace(gather_rows([path], np.zeros(1)), feed=feeds)
    blend = compute_blends(
        rows, np.full_like(feeds, compute_corner_tolerance(job, path.operation)), pace
    )
    blend[1:-1] = limit_blends(blend[1:-1], _measure_bends(motion.pose_path), pace)
    return [float(radius) for radius in blend]


def _measure_bends(pose_path: PosePath) -> FloatArray:
    """(N - 2,) change of the rotation rate at the rows between two segments, rad/mm."""
    rotation = compute_rotation_vectors(
        pose_path.rotation[1:] @ np.swapaxes(pose_path.rotation[:-1], 1, 2)
    )
    rate = rotation / np.maximum(pose_path.length, SAME_POINT_MM)[:, None]
    return np.asarray(np.linalg.norm(np.diff(rate, axis=0), axis=1))


def _run_edge(
    motion: EdgeMotion, feed: float, blend: Sequence[float], job: Job
) -> Iterator[Instruction]:
    """Yield the processing motion between force on, process on and process off, force off."""
    process, force = job.process, job.process.force
    name = "" if is_switched_in_air(job) else find_signal(process)
    if force > 0:
        yield Force(force, to_vec3(motion.pose_path.rotation[0, :, 2]))
    if name:
        yield from switch_on(process)
    for row in range(1, len(motion.pose_path)):
        yield _make_segment(motion.pose_path, row, feed, force, blend[row])
    if name:
        yield Output(name, 0.0)
    if force > 0:
        yield Force(0.0)


def _make_segment(
    pose_path: PosePath, row: int, speed: float, force: float, blend: float = 0.0
) -> MoveL | MoveC:
    """One motion; a force is along the tool."""
    target = _make_pose(pose_path.rotation[row], pose_path.position[row])
    press = to_vec3(pose_path.rotation[row, :, 2]) if force > 0 else (0.0, 0.0, 0.0)
    if math.isnan(pose_path.via[row, 0]):
        return MoveL(target, speed, blend, force, press)
    rotation = interpolate_rotations(
        pose_path.rotation[row - 1 : row],
        pose_path.rotation[row : row + 1],
        np.array([0]),
        np.array([0.5]),
    )[0]
    return MoveC(_make_pose(rotation, pose_path.via[row]), target, speed, blend, force, press)


def _make_pose(rotation: FloatArray, origin: FloatArray) -> Pose:
    return Pose(frozen(rotation), to_vec3(origin))
