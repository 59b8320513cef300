"""The set-up and the free space of a cell, with the collision tests of motions."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from camgen.collision.cell import CellScene
from camgen.collision.describe import describe_hit
from camgen.collision.hits import are_clear, find_collisions, measure_clearance, split_off_meshes
from camgen.collision.motion import MotionCheck, SceneTest, check_in_scenes, measure_apart
from camgen.collision.scene import Scene, name_pair
from camgen.model.cell import Cell
from camgen.model.errors import JobError, NoSafeProgram
from camgen.model.pose import FloatArray, frozen
from camgen.model.program import Joints
from camgen.motion.joint_paths import APART, JointPath, follow_all
from camgen.motion.setup import Blockage, FreeSpace, SampledMotion, Setup
from camgen.robots.kinematics.joint_limits import are_within_limits
from camgen.robots.kinematics.reasons import describe_limit
from camgen.robots.models import Robot

#: mm: depth to which two bodies may enter each other between two samples without a collision.
STEP = 2.0
#: mm: this depth if the clearance is measured as well.
FINE = 0.5


def find_home(robot: Robot, cell: Cell, scene: Scene) -> FloatArray:
    """(J,) the joint values at home.

    Raises JobError if their number is not that of the joints, or if they are beyond the limits.
    Raises NoSafeProgram if the arm collides.
    """
    assert isinstance(cell.home, Joints)
    home = frozen(cell.home.values)
    if len(home) != len(robot.joints):
        raise JobError(
            "job",
            f"{robot.name} has {len(robot.joints)} joints, home has {len(home)}",
            "cell.home",
            "give home for this robot",
        )
    if not are_within_limits(robot, home):
        raise JobError(
            "job",
            f"at home {describe_limit(robot, home)}",
            "cell.home",
            "give a home within the limits",
        )
    pair = int(find_collisions(scene, home[None])[0])
    if pair >= 0:
        raise NoSafeProgram(
            "job",
            f"home collides: {describe_hit(scene, home, pair)}",
            "cell.home",
            "give another, or move the part",
        )
    return home


def make_setup(robot: Robot, cell: Cell, where: CellScene) -> Setup:
    """The set-up of a cell for motions along edges: arm, frames and collision tests."""
    scene = where.scene
    clear = partial(are_clear, split_off_meshes(scene))
    with_margin = split_off_meshes(where.with_margin, where.margin)
    roomy = partial(are_clear, (*with_margin, *split_off_meshes(where.work)))
    return Setup(
        robot,
        cell.base_from_work,
        cell.flange_from_tool,
        clear,
        lambda joints: name_pair(scene, int(find_collisions(scene, joints[None])[0])),
        partial(measure_apart, scene),
        roomy if where.margin > 0 else clear,
    )


def make_free_space(where: CellScene, setup: Setup) -> FreeSpace:
    """The free space of a cell, with the collision tests of motions along edges and links."""

    def test(near: float, several: Sequence[SampledMotion]) -> list[Blockage | float]:
        paths = follow_all(setup, several)
        rows = [path.joints for path in paths]
        tests = SceneTest(where.with_margin, FINE, near), SceneTest(where.work, STEP)
        with_margin, working = check_in_scenes(tests, rows, APART)
        return list(map(partial(_find_blockage, where), paths, with_margin, working))

    def measure_gaps(joints: FloatArray) -> FloatArray:
        if where.margin > 0:
            return measure_clearance(where.with_margin, joints, where.margin)
        return np.zeros(len(joints))

    look, find_blockages = partial(test, where.margin), partial(test, 0.0)
    corners = where.low, where.high
    return FreeSpace(
        where.level, *corners, where.room, where.margin, look, find_blockages, measure_gaps
    )


def _find_blockage(
    where: CellScene, path: JointPath, with_margin: MotionCheck, working: MotionCheck
) -> Blockage | float:
    """The first place at which joints or a collision stop a motion, or its clearance, mm."""
    if len(path.lost):
        return Blockage("jump", "the joints cannot follow", float(path.lost[0]))
    collisions = []
    for scene, check in ((where.with_margin, with_margin), (where.work, working)):
        if check.hit:
            collisions.append((check.at, where.scene.pairs.index(scene.pairs[check.pair])))
    if not collisions:
        return with_margin.clearance
    first, index = min(collisions)
    at = np.interp(first, np.arange(len(path.at)), path.at)
    return Blockage("collision", f"collision, {name_pair(where.scene, index)}", float(at))
