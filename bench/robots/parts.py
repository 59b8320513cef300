"""Real meshes and STEP parts before two arms: programs, and every motion sampled densely.

    python -m bench.robots.parts [FOLDER] [SAMPLES, 400] [PART ...]

FOLDER holds meshes and STEP files (default: ``shared/data`` beside the repository). PART is the
name of a file without its suffix. Without names, parts of more than 1,000 convex edges are left
out. Each part stands on a table before the arm, with the middle of its foot at one place for all
parts. All convex edges are asked for. "IRB 120" has the nominal tool, "IRB 2400" 30 deg of tilt.

A judge samples every motion of a program, and with the nominal tool every edge that is left out for
a collision, SAMPLES times: the TCP on its line or arc, an even turn of the tool, and the joint
values from the inverse kinematics, which the forward kinematics confirms. "motions hit" counts
those that touch anything in a sample, with the deepest touch; "unfounded" the edges left out for a
collision of which no sample shows one. Exits with 1 if a touch is deeper than the check promises,
or a collision is unfounded.
"""

from __future__ import annotations

import math
import re
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

import camgen
from bench.support.motions import place_motion, rotate
from bench.support.runner import SHARED, Cells, Missed, Scenario, find_files, read_words, run
from camgen.collision.hits import find_collisions
from camgen.collision.scene import Scene
from camgen.model.pose import FloatArray, Pose
from camgen.motion.pose_paths import PosePath, divide
from camgen.motion.setup import JUMP, MARGIN, Setup, compute_flange_poses, count_samples
from camgen.plan.edges.poses import make_poses
from camgen.read.solid import STEP, mesh_file
from camgen.robots.kinematics.continuity import follow
from camgen.robots.kinematics.forward import compute_flange
from camgen.robots.kinematics.inverse import compute_solutions
from camgen.robots.models import Robot

#: Depth of a touch that the check may miss, mm: half of its step between bodies, and its addition.
PROMISED = 1.02
#: Depths at which touches are measured, mm.
DEPTHS = (0.0, 0.05, 0.1, 0.2, 0.5, PROMISED)
#: The reason for which an edge is left out whose nominal motion can be run again.
COLLIDES = re.compile(r"collision, [^;]* along it$")
#: Most convex edges of a part that is not named.
MOST = 1000
#: For each arm the place of the middle of a part's foot in its base, mm, and the free tilt, deg.
CELLS = {"IRB 120": ((400.0, 0.0, 100.0), 0.0), "IRB 2400": ((1000.0, 0.0, 600.0), 30.0)}
COLUMNS = (
    "part | arm | edges run | left out | for a collision | of these unfounded | motions hit "
    "| CPU s {:.2f} | verdict"
)


def make_job(path: Path, arm: str) -> dict[str, dict[str, object]]:
    """The part before the arm. Meshes of less than 10 units are read in inches, others in mm."""
    units = "auto"
    vertices = camgen.read(path).solid.vertices
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    if path.suffix.lower() in mesh_file.SUFFIXES and (high - low).max() < 10:
        units, low, high = "inch", low * 25.4, high * 25.4
    place, tilt = CELLS[arm]
    x, y, z = (np.array(place) - [*((low + high) / 2)[:2], low[2]]).tolist()
    return {
        "input": {"units": units},
        "tool": {"axis_tilt": tilt},
        "cell": {"robot": arm, "base_from_work": [x, y, z, 0.0, 0.0, 0.0]},
    }


# The TCP along a motion, from the textbook: a line or a circle through three points, an even turn.


def turn_evenly(start: FloatArray, end: FloatArray, share: FloatArray) -> FloatArray:
    """Rotations (S, 3, 3) at shares (S,) of the shortest turn."""
    turn = end @ start.T
    axis = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / 2
    sine = float(np.linalg.norm(axis))
    if sine < 1e-12:
        return np.broadcast_to(start, (len(share), 3, 3))
    angle = share * math.atan2(sine, (float(np.trace(turn)) - 1) / 2)
    return np.asarray(rotate(axis / sine, angle) @ start)


class Frames(NamedTuple):
    """An arm with its work frame and its tool."""

    robot: Robot
    base_from_work: Pose
    flange_from_tool: Pose

    def find_joints(
        self, position: FloatArray, rotation: FloatArray, start: FloatArray
    ) -> FloatArray:
        """Joint values (S, J) at poses of the TCP in the work frame.

        Each is the nearest to the one before, from `start` (J,) on. ValueError if the forward
        kinematics does not confirm them to 1e-6 mm.
        """
        base, tool = self.base_from_work, self.flange_from_tool
        tool_from_flange = tool.inverse()
        turn = base.rotation @ rotation
        origin = position @ base.rotation.T + np.asarray(base.origin)
        flange_origin = origin + turn @ np.asarray(tool_from_flange.origin)
        flange_turn = turn @ tool_from_flange.rotation
        joints = np.empty((len(position), len(start)))
        last = start
        solutions = compute_solutions(self.robot, flange_turn, flange_origin, start)
        for k, branches in enumerate(solutions):
            steps = branches - last
            steps -= math.tau * np.rint(steps / math.tau)
            best = int(np.nanargmin(np.abs(steps).max(axis=1)))
            last = joints[k] = last + steps[best]
        back, tip = compute_flange(self.robot, joints)
        error = np.linalg.norm(tip + back @ np.asarray(tool.origin) - origin, axis=1).max()
        if error > 1e-6:
            raise ValueError(f"the joint values lead {error} mm beside the path")
        return joints

    def find_tool(self, joints: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rotation and position of the TCP in the work frame at joint values (J,)."""
        back, tip = (frame[0] for frame in compute_flange(self.robot, joints[None]))
        work_from_base = self.base_from_work.rotation.T
        origin = tip + back @ np.asarray(self.flange_from_tool.origin)
        position = work_from_base @ (origin - np.asarray(self.base_from_work.origin))
        return work_from_base @ back @ self.flange_from_tool.rotation, position


def sample_program(
    program: camgen.Program, robot: Robot, samples: int
) -> Iterator[tuple[int, FloatArray]]:
    """The index of every motion and the joint values (S, J) along it."""
    share = np.arange(1, samples + 1) / samples
    frames = Frames(robot, program.base_from_work, program.flange_from_tool)
    joints = np.zeros(len(robot.joints))
    for index, item in enumerate(program.body):
        if isinstance(item, camgen.MoveJ):
            target = item.joints if isinstance(item.target, Pose) else item.target
            end = np.array(target.values)
            samples_of_motion = joints + share[:, None] * (end - joints) if index else end[None]
        elif isinstance(item, (camgen.MoveL, camgen.MoveC)):
            samples_of_motion = sample_linear(frames, item, joints, share)
        else:
            continue
        yield index, samples_of_motion
        joints = samples_of_motion[-1]


def sample_linear(
    frames: Frames, item: camgen.MoveL | camgen.MoveC, joints: FloatArray, share: FloatArray
) -> FloatArray:
    """Joint values (S, J) at shares of a linear or circular motion from joint values (J,)."""
    start, position = frames.find_tool(joints)
    via, rotation = None, turn_evenly(start, item.target.rotation, share)
    if isinstance(item, camgen.MoveC):
        via, middle = np.array(item.via.origin), item.via.rotation
        first = turn_evenly(start, middle, 2 * share[share <= 0.5])
        last = turn_evenly(middle, item.target.rotation, 2 * share[share > 0.5] - 1)
        rotation = np.concatenate([first, last])
    places = place_motion(position, via, np.array(item.target.origin), share)
    return frames.find_joints(places, rotation, joints)


def measure_depth(scene: Scene, joints: FloatArray) -> float:
    """Least depth of the deepest touch at (S, J), mm, in steps of ``DEPTHS``; -1 without one."""
    touching = joints[find_collisions(scene, joints) >= 0]
    depth = -1.0
    for less in DEPTHS:
        if not len(touching):
            return depth
        depth = less
        touching = touching[find_collisions(scene, touching, -(less + 1e-9)) >= 0]
    return math.inf if len(touching) else depth


def list_touches(result: camgen.Result, samples: int) -> list[float]:
    """Depths of the motions of a program that touch anything in a sample, mm."""
    motions = sample_program(result.program, result.cell.arm, samples)
    depths = [measure_depth(result.where.scene, joints) for _, joints in motions]
    return [depth for depth in depths if depth >= 0]


def count_unfounded(result: camgen.Result, job: camgen.Job, samples: int) -> tuple[int, int]:
    """Number of edges that are left out for a collision of the nominal tool.

    The second number is that of the edges among them of which no sample shows a collision.
    """
    edges = {edge.id: edge for edge in result.part.solid.edges}
    cell = result.cell
    frames = Frames(cell.arm, cell.base_from_work, cell.flange_from_tool)
    count = unfounded = 0
    for note in result.notes:
        if note.kind != "skipped" or not COLLIDES.match(note.why):
            continue
        path = make_poses(edges[note.ids[0]], job.operation.offset)
        places = divide(path, count_samples(path))
        poses = compute_flange_poses(Setup(*frames), places.position, places.rotation)
        start = follow(cell.arm, poses, margin=MARGIN, jump=JUMP).joints[0]
        count += 1
        joints = follow_path(frames, path, start, samples)
        unfounded += measure_depth(result.where.scene, joints) < 0
    return count, unfounded


def follow_path(frames: Frames, path: PosePath, start: FloatArray, samples: int) -> FloatArray:
    """Joint values along a pose path, from ``start`` (J,) on."""
    share = np.arange(samples + 1) / samples
    parts = [start[None]]
    for k in range(1, len(path)):
        via = None if np.isnan(path.via[k, 0]) else path.via[k]
        places = place_motion(path.position[k - 1], via, path.position[k], share)
        rotation = turn_evenly(path.rotation[k - 1], path.rotation[k], share)
        parts.append(frames.find_joints(places, rotation, parts[-1][-1]))
    return np.concatenate(parts)


def measure(path: Path, arm: str, samples: int, verdicts: list[bool]) -> Iterator[Cells]:
    """The row of a part. verdicts: gets whether there is a program."""
    tables = make_job(path, arm)
    begin = time.process_time()
    try:
        result = camgen.build(path, post="rapid", job=tables)
    except camgen.CamgenError as error:
        seconds = time.process_time() - begin
        place = f" ({error.where})" if error.where else ""
        verdicts.append(False)
        yield path.name, arm, *"-----", seconds, f"exit {error.exit_code}: {error.what}{place}"
        return
    seconds = time.process_time() - begin
    verdicts.append(True)
    skipped = sum(note.kind == "skipped" for note in result.notes)
    # With a tilted tool a note does not state with what the motion collided that was tried last.
    collided, unfounded = "-", "-"
    if not CELLS[arm][1]:
        collided, unfounded = count_unfounded(result, camgen.job(tables), samples)
    depths = list_touches(result, samples)
    is_good = max(depths, default=0.0) <= PROMISED and unfounded in (0, "-")
    hit = f"{len(depths)}, {max(depths):.2f} mm" if depths else "0"
    counts = len(result.tour.paths), skipped, collided, unfounded, hit
    yield path.name, arm, *counts, seconds, "program" if is_good else Missed("program")


def count_edges(path: Path) -> int:
    """The convex edges of the part in a file."""
    try:
        solid = camgen.read(path).solid
    except camgen.CamgenError:
        return 0
    return sum(edge.convex for edge in solid.edges) if solid is not None else 0


def main(folder: Path, samples: int, names: Sequence[str]) -> int:
    """Prints the table."""
    verdicts: list[bool] = []
    inputs = []
    for path in find_files(folder, (*mesh_file.SUFFIXES, *STEP)):
        limit = math.inf if names else MOST
        if path.stem in (names or [path.stem]) and 0 < count_edges(path) <= limit:
            inputs += [(path, arm, samples, verdicts) for arm in CELLS]
    code = run(Scenario(COLUMNS, inputs, measure))
    print(f"\n{sum(verdicts)} of {len(verdicts)} come to a program.")
    return code


if __name__ == "__main__":
    shared, count, *parts = read_words(SHARED, 400)
    sys.exit(main(shared, count, parts))
