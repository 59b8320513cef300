"""Stretches of edges that an arm reaches by a judge of its own, and that camgen leaves out.

    python -m bench.robots.reach_judge [--feed MM_S] [PART ...]

The parts and set-ups are those of ``coverage``. The judge has a station every 2 mm along the edges,
beside the pieces that camgen works. At each station it draws orientations within the cone that the
job allows, with any turn of the tool. It finds their joint values by py-opw-kinematics, leaves out
those beyond a limit or within 2 deg of a straight wrist, and tests the others with fcl, by
``plain_loop``. A station is reached if one posture is free. The columns "with the margin" count
stations at which one posture keeps ``cell.margin`` too, as pieces of edges do. Nothing of camgen's
planner is used. A stretch of reached stations is an upper limit of what can be worked: one posture
need not lead to the next, and the judge knows no speeds. At a small feed the joints are fast enough
for camgen too.
"""

from __future__ import annotations

import argparse
import importlib
import math
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

import camgen
from bench.machine import machine
from bench.robots.coverage import list_parts, make_job
from bench.robots.plain_loop import Loop
from bench.robots.rfa import loop
from bench.support.runner import Table
from camgen.model.errors import NoSafeProgram
from camgen.model.job import ProcessTable
from camgen.model.part import Edge, Part
from camgen.model.pose import FloatArray, pose_from_values
from camgen.pipeline import Result
from camgen.robots.catalogue import robot
from camgen.robots.kinematics.joint_limits import joints_of, within
from camgen.robots.models import Robot

#: Distance of two stations, mm, and length of a stretch that is listed.
STEP, LISTED = 2.0, 5.0
#: Gaps that differ less count as equal, mm.
SAME_MM = 0.01
#: Random orientations at a station, and the seed of their draw.
DRAWN, SEED = 150, 43
#: rad: postures nearer to a straight wrist are not counted.
STRAIGHT = math.radians(2)


class Judge:
    """The judge of a part in its set-up."""

    def __init__(self, result: Result) -> None:
        job = result.job
        self.robot: Robot = robot(job.cell.robot)
        arm = self.robot.arm
        c4 = float(np.linalg.norm(arm.flange_from_wrist.origin))
        opw = importlib.import_module("py_opw_kinematics")
        self.transform = importlib.import_module("scipy.spatial.transform")
        model = opw.KinematicModel(
            a1=arm.a1, a2=arm.a2, b=arm.b, c1=arm.c1, c2=arm.c2, c3=arm.c3, c4=c4
        )
        self.oracle = opw.Robot(model, degrees=False)
        self.loop: Loop = loop(result, result.part.solid)
        self.offset = job.operation.offset
        self.margin = job.cell.margin
        self.base_from_work = pose_from_values(job.cell.base_from_work)
        self.tool_from_flange = pose_from_values(job.cell.flange_from_tool).inverse()
        self.turns = _draw_turns(math.radians(job.tool.axis_tilt))

    def measure_gap(self, point: FloatArray, outward: FloatArray, along: FloatArray) -> float:
        """The most that a posture with the tip beside a point of an edge keeps from anything, mm.

        At most the margin of the job; -1 if no posture is free.

        outward: unit direction from the edge to the tip.
        along: direction of the edge.
        """
        joints = self._find_joints(
            point + self.offset * outward, _frame(outward, along) @ self.turns
        )
        largest = -1.0
        for row in joints:
            if self.loop.first(row) is None:
                largest = max(largest, self.loop.gap(row, self.margin))
            if largest >= self.margin:
                break
        return largest

    def _find_joints(self, tip: FloatArray, rotations: FloatArray) -> FloatArray:
        """All joint values (K, 6) for a position of the tip and orientations, work frame."""
        base, flange = self.base_from_work, self.tool_from_flange
        turned = base.rotation @ rotations
        origins = np.asarray(base.apply(tip)) + turned @ np.asarray(flange.origin)
        poses = self.transform.RigidTransform.from_components(
            origins, self.transform.Rotation.from_matrix(turned @ flange.rotation)
        )
        theta = np.asarray(self.oracle.reach(poses).joints).reshape(-1, 6)
        theta = theta[np.isfinite(theta).all(axis=1)]
        joints = joints_of(self.robot, self.robot.arm, theta)
        bent = np.abs(np.sin(theta[:, 4])) > math.sin(STRAIGHT)
        return joints[within(self.robot, joints) & bent]


def _draw_turns(tilt: float) -> FloatArray:
    """Orientations (DRAWN, 3, 3) within a cone around z, some upright, with any turn about it."""
    draw = np.random.default_rng(SEED)
    lean = tilt * np.sqrt(draw.random(DRAWN))
    lean[:24] = 0.0
    side, turn = draw.uniform(0, math.tau, (2, DRAWN))
    axis = np.column_stack([np.cos(side), np.sin(side), 0 * side]) * lean[:, None]
    spin = np.column_stack([0 * turn, 0 * turn, turn])
    rotation = importlib.import_module("scipy.spatial.transform").Rotation
    return np.asarray((rotation.from_rotvec(axis) * rotation.from_rotvec(spin)).as_matrix())


def _frame(outward: FloatArray, along: FloatArray) -> FloatArray:
    """The orientation whose z points at the edge, and y along it."""
    y = along - (along @ outward) * outward
    y /= np.linalg.norm(y)
    return np.column_stack([np.cross(y, -outward), y, -outward])


def list_stations(edge: Edge) -> Iterator[tuple[float, FloatArray, FloatArray, FloatArray]]:
    """The stations of an edge: distance from its start, point, and directions outward and along."""
    points = np.empty((2 * len(edge.points) - 1, 3))
    points[::2], points[1::2] = edge.points, edge.via
    normals = np.empty((len(points), 3))
    normals[::2], normals[1::2] = edge.normals.sum(axis=1), edge.via_normals.sum(axis=1)
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    at = np.append(0.0, np.cumsum(steps)) * edge.length / steps.sum()
    for place in np.arange(0.0, edge.length, STEP):
        k = int(np.clip(np.searchsorted(at, place, "right") - 1, 0, len(at) - 2))
        share = (place - at[k]) / (at[k + 1] - at[k])
        outward = (1 - share) * normals[k] + share * normals[k + 1]
        size = float(np.linalg.norm(outward))
        if size > 1e-3:
            point = (1 - share) * points[k] + share * points[k + 1]
            yield float(place), point, outward / size, points[k + 1] - points[k]


def worked(result: Result) -> dict[str, list[tuple[float, float]]]:
    """The lengths between which each edge is worked."""
    edges = {edge.id: edge.length for edge in result.part.solid.edges}
    stretches: dict[str, list[tuple[float, float]]] = {}
    for leg in result.tour.route.legs:
        motion = leg.motion
        low, rest = motion.trimmed[:: -1 if motion.backwards else 1]
        length = edges[motion.line]
        stretches.setdefault(motion.line, []).append((low, length - rest))
        stretches[motion.line].append((low - length, -rest))
    return stretches


Stretch = tuple[str, float, float]


def find_missed(part: Part, result: Result) -> tuple[int, list[Stretch], list[Stretch]]:
    """The number of stations that were judged, and the reached stretches that are not worked.

    A stretch is an edge, its start and its length, mm. The last list is of those with the margin.
    """
    reach_judge, done = Judge(result), worked(result)
    count = 0
    free: list[Stretch] = []
    roomy: list[Stretch] = []
    for edge in (edge for edge in part.solid.edges if edge.convex):
        gaps: dict[float, float] = {}
        for place, point, outward, along in list_stations(edge):
            pieces = done.get(edge.id, [])
            if any(low - STEP / 2 <= place <= high + STEP / 2 for low, high in pieces):
                continue
            count += 1
            gaps[place] = reach_judge.measure_gap(point, outward, along)
        free += _find_stretches(edge.id, [place for place, gap in gaps.items() if gap >= 0])
        with_margin = [place for place, gap in gaps.items() if gap >= reach_judge.margin - SAME_MM]
        roomy += _find_stretches(edge.id, with_margin)
    return count, free, roomy


def _find_stretches(name: str, places: Sequence[float]) -> Iterator[Stretch]:
    """The stretches over `LISTED` of the places on an edge that are reached."""
    for group in np.split(places, np.flatnonzero(np.diff(places) > 1.5 * STEP) + 1):
        if len(group) and (long := float(group[-1] - group[0])) > LISTED:
            yield name, float(group[0]), long


def main(parts: Sequence[str], feed: float) -> int:
    print(machine(), f"{feed:g} mm/s")
    table = Table(
        "part | stations judged | stretches over 5 mm | mm {:,.0f} | with the margin "
        "| mm {:,.0f} | longest, mm {:.0f} | where"
    )
    with tempfile.TemporaryDirectory() as folder:
        for name, part in list_parts(Path(folder), parts):
            job = make_job(part) | {"process": {"feed": feed}}
            try:
                result = camgen.build(part, post="rapid", job=job)
            except NoSafeProgram as error:
                table.add(name, str(error))
                continue
            count, free, roomy = find_missed(part, result)
            lengths = [sum(length for *_, length in free), sum(length for *_, length in roomy)]
            longest = max((length for *_, length in roomy), default=0.0)
            where = ", ".join(f"{edge} at {at:.0f}: {length:.0f}" for edge, at, length in roomy)
            table.add(name, count, len(free), lengths[0], len(roomy), lengths[1], longest, where)
    return 0


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("parts", nargs="*")
    parser.add_argument("--feed", type=float, default=ProcessTable().feed)
    given = parser.parse_args()
    sys.exit(main(given.parts, given.feed))
