"""Poses per second, and every verdict again by a plain loop over fcl.

    python -m bench.robots.collision [POSES, 10000]

The loop has nothing of camgen but the links' frames: it asks fcl about every pair of bodies in turn, with no filter
before it, and takes the sum of the solid angles of all triangles for whether a box is in the part. It exits with 1
when a verdict differs or a figure misses its goal.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

import numpy as np
import trimesh

from bench.machine import machine
from bench.robots.kinematics import drawn, timed
from bench.robots.plain_loop import Loop
from camgen.collision.hits import clearance, hits
from camgen.collision.mesh import Mesh, make_mesh
from camgen.collision.motion import motion
from camgen.collision.scene import Allowed, Scene, scene
from camgen.model.part import Solid
from camgen.model.pose import FloatArray, frozen, pose_from_values, translation
from camgen.robots.catalogue import robot
from camgen.robots.kinematics.continuity import Choice, follow
from camgen.robots.kinematics.inverse import inverse
from camgen.robots.kinematics.joint_limits import within
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
    every = inverse(of, rotations, origins).reshape(-1, len(of.joints))
    every = every[np.isfinite(every).all(axis=1)]
    return np.asarray(rng.permutation(every[within(of, every)])[:count])


def disagreements(loop: Loop, tested: Scene, joints: FloatArray) -> int:
    verdicts = [tested.pairs[k] if k >= 0 else None for k in hits(tested, joints).tolist()]
    return sum(verdict != loop.first(row) for verdict, row in zip(verdicts, joints, strict=True))


def edge(of: Robot, centre: tuple[float, float, float]) -> FloatArray:
    """The tool 2 mm above the ring's top, straight across it, in 400 rows."""
    x, y, z = centre
    ways = np.column_stack(
        [np.full(400, x), y + np.linspace(-120, 120, 400), np.full(400, z + 40 + 180 + 2)]
    )
    choice = follow(of, np.broadcast_to(np.diag([1.0, -1, -1]), (400, 3, 3)), ways)
    assert isinstance(choice, Choice)
    return np.asarray(choice.joints)


def rated(work: Callable[[], object], count: int) -> float:
    return count / timed(work, 3)


def main(poses: int) -> int:
    print(f"{machine()}\n")
    solid = ring()
    begun = time.perf_counter()
    mesh = make_mesh(solid)
    print(f"{len(solid.faces):,} triangles made ready in {time.perf_counter() - begun:.2f} s\n")
    print(
        "| robot | configurations | tested | hits | of these part | poses/s | differ from the plain loop |"
    )
    print("|---|---|---|---|---|---|---|")
    good = True
    for name, centre in CENTRES.items():
        good &= table_of(robot(name), centre, solid, mesh, poses)
    return 0 if all([good, motions(mesh)]) else 1


def table_of(
    of: Robot, centre: tuple[float, float, float], solid: Solid, mesh: Mesh, poses: int
) -> bool:
    base_from_part = pose_from_values([*centre, 20, -10, 30])
    table = Link(
        "table", (Box(translation(centre[0], centre[1], centre[2] - 130), (150.0, 300.0, 30.0)),)
    )
    loop = Loop(of, solid, base_from_part, (table,), TOOL, CONTACT)
    whole = scene(of, TOOL, (table,), mesh, base_from_part, Allowed(CONTACT))
    links = scene(of, (), (), mesh, base_from_part)
    good = True
    for where, joints in (
        ("all over", drawn(of, poses)),
        ("at the part", near(of, centre, poses // 5)),
    ):
        for what, tested in (("7 links", links), ("and holder, tool, table", whole)):
            speed = rated(lambda s=tested, q=joints: hits(s, q), len(joints))  # type: ignore[misc]
            found = hits(tested, joints)
            part = np.isin(
                found, [k for k, pair in enumerate(tested.pairs) if pair[1] == "part"]
            ).sum()
            differ = disagreements(loop, tested, joints) if tested is whole else None
            judged = "" if differ is None else f"{differ} of {len(joints):,}"
            print(
                f"| {of.name} | {where} | {what} | {(found >= 0).sum():,} | {part:,} | {speed:,.0f} | {judged} |"
            )
            good &= not differ and (speed >= GOAL or where != "all over")
    return good


def motions(mesh: Mesh) -> bool:
    print(
        "\n| robot | motion of 240 mm 2 mm above the part, step 1 mm | ms | clearance, mm |\n|---|---|---|---|"
    )
    for name in ("IRB 2000", "IRB 1200"):
        of, centre = robot(name), CENTRES[name]
        tested = scene(of, TOOL, (), mesh, translation(*centre))
        rows = edge(of, centre)
        for what, within_mm in (("hit or not", 0.0), ("clearance up to 5 mm", 5.0)):
            seconds = timed(lambda s=tested, q=rows, d=within_mm: motion(s, q, 1.0, d))  # type: ignore[misc]
            course = motion(tested, rows, 1.0, within_mm)
            print(f"| {name} | {what} | {1000 * seconds:.1f} | {course.clearance:.3f} |")
        every = 1000 * timed(lambda s=tested, q=rows: clearance(s, q, 5.0))  # type: ignore[misc]
        least = clearance(tested, rows, 5.0).min()
        print(f"| {name} | clearance of each of 400 rows | {every:.1f} | {least:.3f} |")
        if not 1.99 < course.clearance < 2.01:
            return False
    return True


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else POSES))
