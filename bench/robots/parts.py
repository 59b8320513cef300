"""Real meshes and STEP parts before two arms: how many come to a program, and every motion of it looked at densely.

    python -m bench.robots.parts [FOLDER] [SAMPLES, 400] [PART ...]

FOLDER holds meshes and STEP files (default: ``shared/data`` beside the repository). PART is a file's name without
suffix; unless named, parts of more than 1,000 convex edges are passed over. Each stands on a table before the arm, its
middle at one place for all; all convex edges are asked for. "IRB 120" runs with the nominal tool, "IRB 2400" with 30
deg of tilt.

Every motion of a program is looked at in SAMPLES places, and with the nominal tool that along every edge that is left
out for a collision: the TCP on its line or arc, the tool turned evenly, the joints found there by the inverse and
proved by the forward way. "motions hit" counts those of a program that touch anything in a sample, with the deepest
touch; "unfounded" the edges left out for a collision of which no sample shows one. Exits with 1 where a touch is deeper
than the check promises or a collision is unfounded.
"""

from __future__ import annotations

import math
import re
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

import camgen
from bench.support.motions import place_motion, rotate
from bench.support.runner import SHARED, find_files, open_table, read_words
from camgen.collision.hits import find_collisions
from camgen.collision.scene import Scene
from camgen.model.pose import FloatArray, Pose
from camgen.motion.pose_paths import PosePath, divide
from camgen.motion.setup import JUMP, MARGIN, Setup, compute_flange_poses, count_samples
from camgen.plan.edges.poses import make_poses
from camgen.read.solid import STEP, mesh_file
from camgen.robots.kinematics.continuity import Choice, follow
from camgen.robots.kinematics.forward import compute_flange
from camgen.robots.kinematics.inverse import compute_solutions
from camgen.robots.models import Robot

SAMPLES = 400
#: mm: a touch may be so deep: half a step of the check between standing and moving bodies, and what it adds.
PROMISED = 1.02
#: mm: how deep touches are measured.
DEPTHS = (0.0, 0.05, 0.1, 0.2, 0.5, PROMISED)
#: Why an edge is left out whose nominal motion can be run again.
COLLIDES = re.compile(r"collision, [^;]* along it$")
#: Convex edges of a part that is looked at without being named.
MOST = 1000
#: By arm: where the middle of a part's foot stands in its base, mm, and the tilt that is free, deg.
CELLS = {"IRB 120": ((400.0, 0.0, 100.0), 0.0), "IRB 2400": ((1000.0, 0.0, 600.0), 30.0)}


def job(path: Path, arm: str) -> dict[str, dict[str, object]]:
    """The part before the arm. Meshes of less than 10 units are drawn in inches, the others in mm."""
    units = "auto"
    solid = camgen.read(path).solid
    assert solid is not None
    low, high = solid.vertices.min(axis=0), solid.vertices.max(axis=0)
    if path.suffix.lower() in mesh_file.SUFFIXES and (high - low).max() < 10:
        units, low, high = "inch", low * 25.4, high * 25.4
    place, tilt = CELLS[arm]
    x, y, z = (np.array(place) - [*((low + high) / 2)[:2], low[2]]).tolist()
    return {
        "input": {"units": units},
        "tool": {"axis_tilt": tilt},
        "cell": {"robot": arm, "base_from_work": [x, y, z, 0.0, 0.0, 0.0]},
    }


# Where the TCP is along a motion, from the text-book: a line or a circle through three points, and an even turn.


def turned(start: FloatArray, end: FloatArray, share: FloatArray) -> FloatArray:
    """(S, 3, 3) at ``share`` of the shortest turn."""
    turn = end @ start.T
    axis = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / 2
    sine = float(np.linalg.norm(axis))
    if sine < 1e-12:
        return np.broadcast_to(start, (len(share), 3, 3))
    angle = share * math.atan2(sine, (float(np.trace(turn)) - 1) / 2)
    return np.asarray(rotate(axis / sine, angle) @ start)


def joints_on(
    robot: Robot,
    base: Pose,
    tool: Pose,
    position: FloatArray,
    rotation: FloatArray,
    start: FloatArray,
) -> FloatArray:
    """The joints (S, J) at poses of the TCP (work frame), each the nearest to the one before, proved by the forward
    way to 1e-6 mm. ValueError where there are none.
    """
    flange_in_tool = tool.inverse()
    turn = base.rotation @ rotation
    origin = position @ base.rotation.T + np.asarray(base.origin)
    every = compute_solutions(
        robot,
        turn @ flange_in_tool.rotation,
        origin + turn @ np.asarray(flange_in_tool.origin),
        start,
    )
    found = np.empty((len(position), len(start)))
    here = start
    for k, some in enumerate(every):
        away = some - here
        away -= math.tau * np.rint(away / math.tau)
        best = int(np.nanargmin(np.abs(away).max(axis=1)))
        here = found[k] = here + away[best]
    back, tip = compute_flange(robot, found)
    off = np.linalg.norm(tip + back @ np.asarray(tool.origin) - origin, axis=1).max()
    if off > 1e-6:
        raise ValueError(f"the joints lead {off} mm beside the way")
    return found


def runs(program: camgen.Program, robot: Robot, samples: int) -> Iterator[tuple[int, FloatArray]]:
    """The index of every motion and the joints (S, J) along it."""
    share = np.arange(1, samples + 1) / samples
    base, tool = program.base_from_work, program.flange_from_tool
    joints = np.zeros(len(robot.joints))
    for index, item in enumerate(program.body):
        if isinstance(item, camgen.MoveJ):
            end = np.array(
                item.joints.values if isinstance(item.target, Pose) else item.target.values
            )
            way = joints + share[:, None] * (end - joints) if index else end[None]
            yield index, way
        elif hasattr(item, "target"):
            back, tip = (one[0] for one in compute_flange(robot, joints[None]))
            start = base.rotation.T @ back @ tool.rotation
            begin = base.rotation.T @ (
                tip + back @ np.asarray(tool.origin) - np.asarray(base.origin)
            )
            via = np.array(item.via.origin) if isinstance(item, camgen.MoveC) else None
            rotation = turned(start, item.target.rotation, share)
            if isinstance(item, camgen.MoveC):
                half = [turned(start, item.via.rotation, 2 * share[share <= 0.5])]
                half += [
                    turned(item.via.rotation, item.target.rotation, 2 * share[share > 0.5] - 1)
                ]
                rotation = np.concatenate(half)
            way = joints_on(
                robot,
                base,
                tool,
                place_motion(begin, via, np.array(item.target.origin), share),
                rotation,
                joints,
            )
            yield index, way
        else:
            continue
        joints = way[-1]


def depth(scene: Scene, joints: FloatArray) -> float:
    """Mm by which the deepest of the touches at (S, J) goes in, at least, in steps of ``DEPTHS``; -1: no touch."""
    met = joints[find_collisions(scene, joints) >= 0]
    found = -1.0
    for less in DEPTHS:
        if not len(met):
            break
        found = less
        met = met[find_collisions(scene, met, -(less + 1e-9)) >= 0]
    return math.inf if len(met) else found


def touches(result: camgen.Result, samples: int) -> list[float]:
    """The depth of the motions of a program that touch anything in a sample."""
    arm, where = result.cell.arm, result.where
    assert arm is not None
    assert where is not None
    depths = [depth(where.scene, joints) for _, joints in runs(result.program, arm, samples)]
    return [one for one in depths if one >= 0]


def unfounded(result: camgen.Result, job: camgen.Job, samples: int) -> tuple[int, int]:
    """How many edges are left out for a collision of the nominal tool, and of how many of them no sample shows one."""
    arm, where, cell = result.cell.arm, result.where, result.cell
    assert arm is not None
    assert where is not None
    assert result.part.solid is not None
    edges = {edge.id: edge for edge in result.part.solid.edges}
    setup = Setup(arm, cell.base_from_work, cell.flange_from_tool)
    lost = [note for note in result.notes if note.kind == "skipped" and COLLIDES.match(note.why)]
    none = []
    for note in lost:
        way = make_poses(edges[note.ids[0]], job.operation.offset)
        assert isinstance(way, PosePath)
        looks = divide(way, count_samples(way))
        chosen = follow(
            arm,
            compute_flange_poses(setup, looks.position, looks.rotation),
            margin=MARGIN,
            jump=JUMP,
        )
        assert isinstance(chosen, Choice)
        joints = joints_along(result.cell, way, chosen.joints[0], samples)
        if depth(where.scene, joints) < 0:
            none.append(note)
    return len(lost), len(none)


def joints_along(
    cell: camgen.Workcell, way: PosePath, start: FloatArray, samples: int
) -> FloatArray:
    """The joints on a way from ``start`` (J,), as in ``runs``."""
    assert cell.arm is not None
    share = np.arange(samples + 1) / samples
    found = [start[None]]
    for k in range(1, len(way)):
        via = None if np.isnan(way.via[k, 0]) else way.via[k]
        at = place_motion(way.position[k - 1], via, way.position[k], share)
        rotation = turned(way.rotation[k - 1], way.rotation[k], share)
        frames = cell.base_from_work, cell.flange_from_tool
        found.append(joints_on(cell.arm, *frames, at, rotation, found[-1][-1]))
    return np.concatenate(found)


def row(path: Path, arm: str, samples: int) -> tuple[list[object], bool, bool]:
    """The cells of a part; whether there is a program; whether all is as promised."""
    tables = job(path, arm)
    begin = time.process_time()
    try:
        result = camgen.build(path, post="rapid", job=tables)
    except camgen.CamgenError as error:
        seconds = time.process_time() - begin
        place = f" ({error.where})" if error.where else ""
        refusal = f"exit {error.exit_code}: {error.what}{place}"
        return [path.name, arm, *"-----", seconds, refusal], False, True
    seconds = time.process_time() - begin
    skipped = [note for note in result.notes if note.kind == "skipped"]
    deep = touches(result, samples)
    # A tilted tool: the motion that was tried last does not say what it collided with.
    collided, none = "-", "-"
    if not CELLS[arm][1]:
        collided, none = unfounded(result, camgen.job(tables), samples)
    good = max(deep, default=0.0) <= PROMISED and none in (0, "-")
    hit = f"{len(deep)}, {max(deep):.2f} mm" if deep else "0"
    counts = len(result.tour.paths), len(skipped), collided, none, hit
    return [path.name, arm, *counts, seconds, "program"], True, good


def count_edges(path: Path) -> int:
    """The convex edges of the part in a file."""
    try:
        solid = camgen.read(path).solid
    except camgen.CamgenError:
        return 0
    return sum(edge.convex for edge in solid.edges) if solid is not None else 0


def main(folder: Path, samples: int, names: Sequence[str]) -> int:
    """Prints the table."""
    kinds = (*mesh_file.SUFFIXES, *STEP)
    table = open_table(
        "part | arm | edges run | left out | for a collision | of these unfounded | motions hit "
        "| CPU s {:.2f} | verdict"
    )
    made, every, good = 0, 0, True
    for path in find_files(folder, kinds):
        if names and path.stem not in names:
            continue
        if not 0 < count_edges(path) <= (math.inf if names else MOST):
            continue
        for arm in CELLS:
            cells, program, right = row(path, arm, samples)
            table.add(*cells)
            made, every, good = made + program, every + 1, good and right
    print(f"\n{made} of {every} come to a program.")
    return int(not good)


if __name__ == "__main__":
    shared, count, *parts = read_words(SHARED, SAMPLES)
    sys.exit(main(shared, count, parts))
