"""Poses per second, and every verdict again by a plain loop over fcl.

    python -m bench.robots.collision [POSES, 10000]

The loop has nothing of camgen but the links' frames: it asks fcl about every pair of bodies in turn, with no filter
before it, and takes the sum of the solid angles of all triangles for whether a box is in the part. It exits with 1
when a verdict differs or a figure misses its goal.
"""

from __future__ import annotations

import sys
from functools import partial

import numpy as np
import trimesh

from bench.robots.kinematics import drawn
from bench.robots.plain_loop import Loop
from bench.support.runner import Table, machine, read_words
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

#: Poses all over the robot's range, a fifth as many at the part; poses/s.
POSES, GOAL = 10_000, 25_000
CENTRES = {"IRB 2000": (900, 0, 700), "IRB 1200": (500, 0, 300), "VS-6556": (400, 0, 300)}
TOOL = (
    Link("tool", (Box(translation(0, 0, 130), (6.0, 6.0, 50.0)),)),
    Link("holder", (Box(translation(0, 0, 40), (30.0, 30.0, 39.9)),)),
)
CONTACT = 1.0


def ring() -> Solid:
    """A ring of 51,200 triangles, 240 mm wide, 80 mm thick: not convex, with a hole that a tool fits into."""
    made = trimesh.creation.torus(80, 40, major_sections=160, minor_sections=160)
    vertices, faces = frozen(made.vertices), np.asarray(made.faces, dtype=np.int64)
    return Solid("ring", "ring", "mm", vertices, faces, frozen(made.face_normals), (), (), ())


def near(of: Robot, centre: tuple[float, float, float], count: int) -> FloatArray:
    """Configurations whose flange is within 250 mm of ``centre`` in every direction, turned any way."""
    rng = np.random.default_rng(1)
    origins = np.array(centre) + rng.uniform(-250, 250, (2 * count, 3))
    rotations = np.linalg.qr(rng.normal(size=(2 * count, 3, 3)))[0]
    rotations *= np.linalg.det(rotations)[:, None, None]
    every = compute_solutions(of, rotations, origins).reshape(-1, len(of.joints))
    every = every[np.isfinite(every).all(axis=1)]
    return np.asarray(rng.permutation(every[are_within_limits(of, every)])[:count])


def disagreements(loop: Loop, tested: Scene, joints: FloatArray) -> int:
    verdicts = [
        tested.pairs[k] if k >= 0 else None for k in find_collisions(tested, joints).tolist()
    ]
    return sum(verdict != loop.first(row) for verdict, row in zip(verdicts, joints, strict=True))


def main(poses: int) -> int:
    print(f"{machine()}\n")
    solid = ring()
    mesh, seconds = timed(lambda: make_mesh(solid))
    print(f"{len(solid.faces):,} triangles made ready in {seconds:.2f} s")
    table = Table(
        "robot | configurations | tested | hits {:,} | of these part {:,} | poses/s {:,.0f} "
        "| differ from the plain loop {} of {:,}"
    )
    good = True
    for name in CENTRES:
        good &= rows_of(table, find_robot(name), solid, mesh, poses)
    return 0 if good else 1


def rows_of(table: Table, of: Robot, solid: Solid, mesh: Mesh, poses: int) -> bool:
    """The rows of a robot; whether all verdicts agree and the goal is met."""
    centre = CENTRES[of.name]
    base_from_part = pose_from_values([*centre, 20, -10, 30])
    stand = Link(
        "table", (Box(translation(centre[0], centre[1], centre[2] - 130), (150.0, 300.0, 30.0)),)
    )
    loop = Loop(of, solid, base_from_part, (stand,), TOOL, CONTACT)
    whole = make_scene(of, TOOL, (stand,), mesh, base_from_part, Allowed(CONTACT))
    links = make_scene(of, (), (), mesh, base_from_part)
    sets = {"all over": drawn(of, poses), "at the part": near(of, centre, poses // 5)}
    good = True
    for place, joints in sets.items():
        for bodies, tested in (("7 links", links), ("and holder, tool, table", whole)):
            speed = len(joints) / best_seconds(partial(find_collisions, tested, joints), 3)
            pairs = find_collisions(tested, joints)
            of_part = [k for k, pair in enumerate(tested.pairs) if pair[1] == "part"]
            counts = (pairs >= 0).sum(), np.isin(pairs, of_part).sum()
            differ = disagreements(loop, tested, joints) if tested is whole else 0
            judged = (differ, len(joints)) if tested is whole else None
            table.add(of.name, place, bodies, *counts, speed, judged)
            good &= not differ and (speed >= GOAL or place != "all over")
    return good


if __name__ == "__main__":
    sys.exit(main(*read_words(POSES)))
