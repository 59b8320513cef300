"""Triangles of joint values: no free one contains a collision, and most free ones are found."""

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

#: Deviation of the corners of a triangle from its middle, rad; slides move 100 mm per rad.
WIDE = (0.02, 0.1, 0.3)


def make_cell(arm: Robot) -> Scene:
    """An arm with a long tool, a post in front of it, and a block below it that is a mesh."""
    tool = Link("tool", (Box(translation(0, 0, 80), (15, 10, 80)),))
    post = Link("post", (Box(translation(250, 250, 300), (40, 40, 400)),))
    block = trimesh.creation.box((200, 200, 60))
    faces = np.asarray(block.faces, dtype=np.int64)
    part = Solid(
        "b", "b.stl", "mm", frozen(block.vertices), faces, frozen(block.face_normals), (), (), ()
    )
    return make_scene(arm, (tool,), (post,), make_mesh(part), translation(350, -50, 100))


@pytest.mark.parametrize("name", ["IRB 120", "IRB 2400", "VS-6577", "Cobra s600"])
@pytest.mark.parametrize("near", [0.0, 5.0])
def test_a_free_triangle_contains_no_joint_values_near_a_body(name: str, near: float) -> None:
    arm = find_robot(name)
    scene, rng = make_cell(arm), np.random.default_rng(3)
    units = np.where([joint.sliding for joint in arm.joints], 100.0, 1.0)
    middle = rng.uniform(arm.limits[:, 0], arm.limits[:, 1], (8000, len(arm.joints)))
    middle = middle[are_within_limits(arm, middle)]
    # Joint values are kept if a body is near but none collides, since these are hard to classify.
    middle = middle[
        (find_collisions(scene, middle, near=near) < 0)
        & (find_collisions(scene, middle, near=near + 60.0) >= 0)
    ][:100]
    groups = len(middle) * len(WIDE)
    spread = np.repeat(WIDE, len(middle))[:, None, None]
    corners = (
        np.tile(middle, (len(WIDE), 1))[:, None]
        + rng.normal(0.0, 1.0, (groups, 3, len(arm.joints))) * spread * units
    )
    is_free = are_free(scene, corners, np.arange(groups), near)
    weights = np.concatenate(
        [rng.dirichlet(np.ones(3), (groups, 30)), np.tile(np.eye(3), (groups, 1, 1))], axis=1
    )
    inside = np.einsum("kns,ksj->knj", weights, corners)
    collides = (
        find_collisions(scene, inside.reshape(-1, inside.shape[-1]), near=near).reshape(groups, -1)
        >= 0
    )
    collides = collides.any(axis=1)
    assert not (is_free & collides).any()
    assert collides.sum() > groups / 8
    assert is_free.sum() > groups / 5
    # Only a few free triangles are not found, though these are hard to classify. Some of them may
    # contain a collision that no sample has met.
    assert (~is_free & ~collides).sum() < groups / 4
