"""Stretches of edges that an arm reaches by a judge of its own, and that camgen leaves out.

    python -m bench.robots.reach_judge [PART ...]

The parts and set-ups are those of ``coverage``. The judge has a station every 2 mm along the edges,
beside the pieces that camgen works. At each station it draws orientations within the cone that the
job allows, with any turn of the tool. It finds their joint values by py-opw-kinematics, leaves out
those beyond a limit or within 2 deg of a straight wrist, and tests the others with fcl, by
``plain_loop``. A posture is free if it keeps ``cell.margin``, as pieces of edges do. Nothing of
camgen's planner is used.

The table has the stretches that the judge can run at the feed. Its rule, which was committed before
its first run:

- A station counts if its point is the nearest of the edge to the tip. In a hole that is narrower
  than the offset the tip is beyond the axis and nearer to the opposite rim: the tool would work
  that rim, at a smaller offset, and run against the feed. To enter the hole is not to work it.
- All free postures of a station count.
- Two postures of neighbouring stations are linked if no joint turns, by the shorter turn, by more
  than at its maximum speed within the time of the contact. That is the length of the edge by the
  feed, or the way of the tip by `process.max_feed_factor` times the feed if that is longer.
- The longest chain of links is a stretch if it is longer than 5 mm. It is taken out with its
  stations, and the longest chain of the rest is next. Limits of whole turns, and collisions
  between stations, do not count: the judge is an upper limit in both.
"""

from __future__ import annotations

import importlib
import math
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

import camgen
from bench.robots.coverage import list_parts, make_job
from bench.robots.plain_loop import Loop
from bench.robots.rfa import make_loop
from bench.support.motions import place_motion
from bench.support.runner import Cells, Scenario, run
from camgen.model.part import BoolArray, Edge, Part
from camgen.model.pose import FloatArray, pose_from_values
from camgen.robots.catalogue import find_robot
from camgen.robots.kinematics.joint_limits import are_within_limits, compute_joints
from camgen.robots.models import Robot

COLUMNS = "part | stations judged | stretches over 5 mm | mm {:,.0f} | where"
#: Distance of two stations, mm, and length of a stretch that is listed.
STEP, LISTED = 2.0, 5.0
#: Gaps that differ less count as equal, mm.
SAME_MM = 0.01
#: mm by which another point of an edge must be nearer to the tip than the offset. The tip of a bore
#: that is just wide enough is nearly as far from all of its rim.
NEARER_MM = 0.05
#: Parts of half of an arc; height of a straight arc, as a share of its chord.
HALF, STRAIGHT_SHARE = 32, 1e-9
#: Random orientations at a station, and the seed of their draw.
DRAWN, SEED = 150, 43
#: rad: postures nearer to a straight wrist are not counted.
STRAIGHT = math.radians(2)


class Station(NamedTuple):
    """A station of an edge.

    place: distance from the start of the edge, mm.
    point: (3,) its position, mm.
    outward: (3,) unit direction from the edge to the tip.
    along: (3,) direction of the edge.
    """

    place: float
    point: FloatArray
    outward: FloatArray
    along: FloatArray

    def find_tip(self, offset: float) -> FloatArray:
        """Position of the tip, mm."""
        return np.asarray(self.point + offset * self.outward)


#: Stretches of an edge: start and length, mm.
Chains = Iterator[tuple[float, float]]


class Judge:
    """The judge of a part in its set-up."""

    def __init__(self, result: camgen.Result) -> None:
        job = result.job
        self.robot: Robot = find_robot(job.cell.robot)
        arm = self.robot.arm
        c4 = float(np.linalg.norm(arm.flange_from_wrist.origin))
        opw = importlib.import_module("py_opw_kinematics")
        self.transform = importlib.import_module("scipy.spatial.transform")
        model = opw.KinematicModel(
            a1=arm.a1, a2=arm.a2, b=arm.b, c1=arm.c1, c2=arm.c2, c3=arm.c3, c4=c4
        )
        self.oracle = opw.Robot(model, degrees=False)
        self.loop: Loop = make_loop(result, result.part.solid)
        self.offset = job.operation.offset
        self.margin = job.cell.margin
        self.process = job.process
        self.base_from_work = pose_from_values(job.cell.base_from_work)
        self.tool_from_flange = pose_from_values(job.cell.flange_from_tool).inverse()
        self.turns = _draw_turns(math.radians(job.tool.axis_tilt))

    def find_free(self, station: Station) -> FloatArray:
        """The free joint values (K, 6) of a station."""
        rotations = _frame(station.outward, station.along) @ self.turns
        joints = self._find_joints(station.find_tip(self.offset), rotations)
        return joints[[self._is_free(row) for row in joints]]

    def _is_free(self, joints: FloatArray) -> bool:
        """Whether joint values (6,) collide with nothing and keep the margin."""
        if self.loop.find_hit(joints) is not None:
            return False
        clearance = self.loop.measure_clearance(joints, self.margin)
        return clearance >= self.margin - SAME_MM

    def find_chains(self, stations: Sequence[Station], postures: Sequence[FloatArray]) -> Chains:
        """The stretches that can be run at the feed: first station and length, mm.

        postures: (K, 6) joint values of each station; none for one that does not count.
        """
        left = list(postures)
        while True:
            chain = self._find_longest(stations, left)
            if (
                not chain
                or (long := stations[chain[-1]].place - stations[chain[0]].place) <= LISTED
            ):
                return
            yield stations[chain[0]].place, long
            for number in chain:
                left[number] = left[number][:0]

    def _find_longest(
        self, stations: Sequence[Station], postures: Sequence[FloatArray]
    ) -> list[int]:
        """The stations of the longest chain of linked postures."""
        lengths: list[int] = []
        before = np.zeros(0, dtype=np.int64)
        for number, joints in enumerate(postures):
            count = np.ones(len(joints), dtype=np.int64)
            if number and len(joints) and len(before):
                linked = self._are_linked(
                    stations[number - 1 : number + 1], postures[number - 1], joints
                )
                count = np.maximum(count, (linked * (before + 1)[:, None]).max(axis=0))
            lengths.append(int(count.max(initial=0)))
            before = count
        if not lengths:
            return []
        last = int(np.argmax(lengths))
        return list(range(last - lengths[last] + 1, last + 1))

    def _are_linked(
        self, pair: Sequence[Station], first: FloatArray, second: FloatArray
    ) -> BoolArray:
        """Whether each posture (K, 6) of a station leads to each (L, 6) of the next one."""
        long = pair[1].place - pair[0].place
        if long > 1.5 * STEP:
            return np.zeros((len(first), len(second)), dtype=np.bool_)
        tips = [station.find_tip(self.offset) for station in pair]
        tip_path = float(np.linalg.norm(tips[1] - tips[0]))
        seconds = max(long, tip_path / self.process.max_feed_factor) / self.process.feed
        turned = np.abs((second - first[:, None] + math.pi) % math.tau - math.pi)
        return np.asarray((turned <= self.robot.fastest * seconds).all(axis=2))

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
        joints = compute_joints(self.robot, self.robot.arm, theta)
        bent = np.abs(np.sin(theta[:, 4])) > math.sin(STRAIGHT)
        return joints[are_within_limits(self.robot, joints) & bent]


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


def list_stations(edge: Edge, step: float = STEP) -> Iterator[Station]:
    """The stations of an edge, one every ``step`` mm."""
    points = [edge.points[:1]]
    normals = [edge.normals[:1].sum(axis=1)]
    spans = edge.points[:-1], edge.via, edge.points[1:]
    sides = edge.normals[:-1], edge.via_normals, edge.normals[1:]
    for ends, faces in zip(zip(*spans, strict=True), zip(*sides, strict=True), strict=True):
        points.append(_bend(*ends))
        first, middle, last = (face.sum(axis=0) for face in faces)
        shares = np.linspace(0, 2, 2 * HALF + 1)[1:, None]
        before = first + shares * (middle - first)
        after = middle + (shares - 1) * (last - middle)
        normals.append(np.where(shares <= 1, before, after))
    line, outwards = np.concatenate(points), np.concatenate(normals)
    steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
    at = np.append(0.0, np.cumsum(steps)) * edge.length / steps.sum()
    for place in np.arange(0.0, edge.length, step):
        k = int(np.clip(np.searchsorted(at, place, "right") - 1, 0, len(at) - 2))
        share = (place - at[k]) / (at[k + 1] - at[k])
        outward = (1 - share) * outwards[k] + share * outwards[k + 1]
        size = float(np.linalg.norm(outward))
        if size > 1e-3:
            point = (1 - share) * line[k] + share * line[k + 1]
            yield Station(float(place), point, outward / size, line[k + 1] - line[k])


def _bend(first: FloatArray, middle: FloatArray, last: FloatArray) -> FloatArray:
    """Points (2 HALF, 3) of the arc through three points, without the first."""
    chord = last - first
    normal = np.cross(middle - first, chord)
    is_straight = normal @ normal < max(1e-12, (STRAIGHT_SHARE * float(chord @ chord)) ** 2)
    shares = np.linspace(0, 1, 2 * HALF + 1)[1:]
    return place_motion(first, None if is_straight else middle, last, shares)


def is_nearest(rim: FloatArray, station: Station, offset: float) -> bool:
    """Whether no point of an edge, (N, 3), is nearer to the tip than that of the station."""
    tip = station.find_tip(offset)
    return bool(np.linalg.norm(rim - tip, axis=1).min() >= offset - NEARER_MM)


def worked(result: camgen.Result) -> dict[str, list[tuple[float, float]]]:
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


def find_missed(part: Part, result: camgen.Result) -> tuple[int, list[Stretch]]:
    """The number of stations that were judged, and the stretches that are not worked.

    A stretch has the name of its edge, its start and its length, mm.
    """
    reach_judge, done = Judge(result), worked(result)
    count, missed = 0, []
    for edge in (edge for edge in part.solid.edges if edge.convex):
        stations: list[Station] = []
        for station in list_stations(edge):
            bounds = [(low - STEP / 2, high + STEP / 2) for low, high in done.get(edge.id, [])]
            if not any(low <= station.place <= high for low, high in bounds):
                stations.append(station)
        count += len(stations)
        rim = np.array([station.point for station in list_stations(edge, STEP / 10)])
        postures: list[FloatArray] = []
        for station in stations:
            is_worked = is_nearest(rim, station, reach_judge.offset)
            postures.append(reach_judge.find_free(station) if is_worked else np.zeros((0, 6)))
        chains = sorted(reach_judge.find_chains(stations, postures))
        missed += [(edge.id, *chain) for chain in chains]
    return count, missed


def measure(name: str, part: camgen.Part) -> Iterator[Cells]:
    """The row of a part."""
    result = camgen.build(part, post="rapid", job=make_job(part))
    count, missed = find_missed(part, result)
    length = sum(length for *_, length in missed)
    where = ", ".join(f"{edge} at {start:.0f}: {long:.0f}" for edge, start, long in missed)
    yield name, count, len(missed), length, where


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        parts = list_parts(Path(folder), sys.argv[1:])
        sys.exit(run(Scenario(COLUMNS, parts, measure, may_refuse=True)))
