"""Triangles of configurations: what is called free is, and little that is free is not called so."""

import numpy as np
import pytest
import trimesh

from camgen.collision.hits import find_collisions
from camgen.collision.mesh import make_mesh
from camgen.collision.scene import Scene, make_scene
from camgen.collision.triangle import are_free
from camgen.model.part import Solid
from camgen.model.pose import frozen, translation
from camgen.robots.catalogue import find_robot
from camgen.robots.kinematics.joint_limits import are_within_limits
from camgen.robots.models import Box, Link, Robot

#: How far the corners of a triangle are apart, rad; slides move 100 mm a rad.
WIDE = (0.02, 0.1, 0.3)


def cell_of(arm: Robot) -> Scene:
    """An arm with a long tool before a post, and above a block that is a mesh."""
    held = Link("tool", (Box(translation(0, 0, 80), (15, 10, 80)),))
    post = Link("post", (Box(translation(250, 250, 300), (40, 40, 400)),))
    made = trimesh.creation.box((200, 200, 60))
    faces = np.asarray(made.faces, dtype=np.int64)
    part = Solid(
        "b", "b.stl", "mm", frozen(made.vertices), faces, frozen(made.face_normals), (), (), ()
    )
    return make_scene(arm, (held,), (post,), make_mesh(part), translation(350, -50, 100))


@pytest.mark.parametrize("name", ["IRB 120", "IRB 2400", "VS-6577", "Cobra s600"])
@pytest.mark.parametrize("near", [0.0, 5.0])
def test_nothing_is_near_in_what_is_called_free(name: str, near: float) -> None:
    arm = find_robot(name)
    tested, rng = cell_of(arm), np.random.default_rng(3)
    units = np.where([joint.sliding for joint in arm.joints], 100.0, 1.0)
    middle = rng.uniform(arm.limits[:, 0], arm.limits[:, 1], (8000, len(arm.joints)))
    middle = middle[are_within_limits(arm, middle)]
    # Those of them where something is near, but nothing meets: they are neither free nor not at first sight.
    middle = middle[
        (find_collisions(tested, middle, near=near) < 0)
        & (find_collisions(tested, middle, near=near + 60.0) >= 0)
    ][:100]
    groups = len(middle) * len(WIDE)
    wide = np.repeat(WIDE, len(middle))[:, None, None]
    corners = (
        np.tile(middle, (len(WIDE), 1))[:, None]
        + rng.normal(0.0, 1.0, (groups, 3, len(arm.joints))) * wide * units
    )
    free = are_free(tested, corners, np.arange(groups), near)
    shares = np.concatenate(
        [rng.dirichlet(np.ones(3), (groups, 30)), np.tile(np.eye(3), (groups, 1, 1))], axis=1
    )
    inside = np.einsum("kns,ksj->knj", shares, corners)
    struck = (
        find_collisions(tested, inside.reshape(-1, inside.shape[-1]), near=near).reshape(groups, -1)
        >= 0
    )
    struck = struck.any(axis=1)
    assert not (free & struck).any()
    assert struck.sum() > groups / 8
    assert free.sum() > groups / 5
    # Few that are free are not found to be so, of those that are hard to tell: no sample may have met what is there.
    assert (~free & ~struck).sum() < groups / 4
