"""Poses per second of the collision test, and every verdict again by a plain loop over fcl.

    python -m bench.robots.collision [POSES, 10000]

Exits with 1 if a verdict differs or a figure misses its goal.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from functools import partial

import numpy as np
import trimesh

from bench.robots.kinematics import draw_joints
from bench.robots.plain_loop import Loop, Setting
from bench.support.runner import Cells, Missed, Scenario, read_words, run
from bench.support.timing import best_seconds, timed
from camgen.collision.hits import find_collisions
from camgen.collision.mesh import Mesh, make_mesh
from camgen.collision.scene import Allowed, Scene, make_scene
from camgen.model.part import Solid
from camgen.model.pose import FloatArray, frozen, pose_from_values, translation
from camgen.robots.catalogue import find_robot
from camgen.robots.kinematics.inverse import compute_solutions
from camgen.robots.kinematics.joint_limits import are_within_limits
from camgen.robots.models import Box, Link, Robot

#: Poses/s of an arm without tool and table, anywhere in its range.
GOAL = 25_000
#: Middle of the part before each arm, base frame, mm.
CENTRES = {"IRB 2000": (900, 0, 700), "IRB 1200": (500, 0, 300), "VS-6556": (400, 0, 300)}
TOOL = (
    Link("tool", (Box(translation(0, 0, 130), (6.0, 6.0, 50.0)),)),
    Link("holder", (Box(translation(0, 0, 40), (30.0, 30.0, 39.9)),)),
)
#: Depth by which the tool may enter the part, mm.
CONTACT = 1.0
COLUMNS = (
    "robot | joint values | tested | hits {:,} | of these part {:,} | poses/s {:,.0f} "
    "| differ from the plain loop"
)


def make_ring() -> Solid:
    """A ring of 51,200 triangles, 240 mm wide, 80 mm thick. A tool fits into its hole."""
    torus = trimesh.creation.torus(80, 40, major_sections=160, minor_sections=160)
    vertices, faces = frozen(torus.vertices), np.asarray(torus.faces, dtype=np.int64)
    return Solid("ring", "ring", "mm", vertices, faces, frozen(torus.face_normals), (), (), ())


def draw_near(robot: Robot, centre: tuple[float, float, float], count: int) -> FloatArray:
    """Joint values (count, J) with the flange within 250 mm of `centre`, in any orientation."""
    rng = np.random.default_rng(1)
    origins = np.array(centre) + rng.uniform(-250, 250, (2 * count, 3))
    rotations = np.linalg.qr(rng.normal(size=(2 * count, 3, 3)))[0]
    rotations *= np.linalg.det(rotations)[:, None, None]
    solutions = compute_solutions(robot, rotations, origins).reshape(-1, len(robot.joints))
    solutions = solutions[np.isfinite(solutions).all(axis=1)]
    return np.asarray(rng.permutation(solutions[are_within_limits(robot, solutions)])[:count])


def count_differences(loop: Loop, scene: Scene, pairs: list[int], joints: FloatArray) -> int:
    """The number of verdicts that differ. pairs: index of the pair that meets, -1 without one."""
    verdicts = [scene.pairs[k] if k >= 0 else None for k in pairs]
    return sum(verdict != loop.find_hit(row) for verdict, row in zip(verdicts, joints, strict=True))


def measure(name: str, solid: Solid, mesh: Mesh, poses: int) -> Iterator[Cells]:
    """The rows of a robot."""
    robot, centre = find_robot(name), CENTRES[name]
    base_from_part = pose_from_values([*centre, 20, -10, 30])
    middle = translation(centre[0], centre[1], centre[2] - 130)
    table = (Link("table", (Box(middle, (150.0, 300.0, 30.0)),)),)
    loop = Loop(robot, Setting(solid, base_from_part, table, TOOL, CONTACT))
    whole = make_scene(robot, TOOL, table, mesh, base_from_part, Allowed(CONTACT))
    links = make_scene(robot, (), (), mesh, base_from_part)
    sets = {
        "all over": draw_joints(robot, poses),
        "at the part": draw_near(robot, centre, poses // 5),
    }
    for place, joints in sets.items():
        for bodies, scene in (("7 links", links), ("and holder, tool, table", whole)):
            speed = len(joints) / best_seconds(partial(find_collisions, scene, joints), 3)
            pairs = find_collisions(scene, joints)
            of_part = [k for k, pair in enumerate(scene.pairs) if pair[1] == "part"]
            counts = (pairs >= 0).sum(), np.isin(pairs, of_part).sum()
            verdicts = None
            if scene is whole:
                differ = count_differences(loop, scene, pairs.tolist(), joints)
                text = f"{differ} of {len(joints):,}"
                verdicts = Missed(text) if differ else text
            is_slow = speed < GOAL and place == "all over"
            rate = Missed(f"{speed:,.0f}") if is_slow else speed
            yield name, place, bodies, *counts, rate, verdicts


def main(poses: int) -> int:
    """Prints the table; 1 if a goal is missed."""
    solid = make_ring()
    mesh, seconds = timed(lambda: make_mesh(solid))
    note = f"; {len(solid.faces):,} triangles made ready in {seconds:.2f} s"
    inputs = [(name, solid, mesh, poses) for name in CENTRES]
    return run(Scenario(COLUMNS, inputs, measure), note=note)


if __name__ == "__main__":
    sys.exit(main(*read_words(10_000)))
