"""Two links with one link between them: the rounder one is replaced by the solid it sweeps."""

import math

import numpy as np
import pytest
from msgspec.structs import replace

from camgen.collision import pairs
from camgen.collision.hits import are_clear, find_collisions, split_off_meshes
from camgen.collision.motion import bound_closing
from camgen.collision.pairs import MeshPair
from camgen.collision.scene import Scene, make_scene, select_pairs
from camgen.collision.swept import measure_roundness, sweep
from camgen.geometry.rotations import make_rotations_from_vectors
from camgen.model.pose import frozen, translation
from camgen.robots.catalogue import find_robot
from camgen.robots.models import Box, Link, Robot, Surface
from tests.collision.test_pairs import make_pillar, make_plates

#: Half edges and middles of plates, mm: a bar along x, and a block near the axis.
BAR, BLOCK = ((150.0, 20.0, 25.0), (150.0, 60.0, 0.0)), ((30.0, 40.0, 50.0), (10.0, 0.0, 20.0))


#: A square tube of four plates about z, and a pin across its middle.
TUBE = (
    ((60.0, 2.0, 20.0), (0.0, 58.0, 0.0)), ((60.0, 2.0, 20.0), (0.0, -58.0, 0.0)),
    ((2.0, 60.0, 20.0), (58.0, 0.0, 0.0)), ((2.0, 60.0, 20.0), (-58.0, 0.0, 0.0)),
)  # fmt: skip
PIN = ((20.0, 1.0, 1.0), (0.0, 0.0, 0.0))


Plate = tuple[tuple[float, ...], tuple[float, ...]]


def make_arm(
    first: tuple[Plate, ...], third: tuple[Plate, ...], shifts: tuple[tuple[float, ...], ...]
) -> Robot:
    """An arm whose links 1 and 3 are plates; the two axes between them rotate about z.

    shifts: origins of the first three joints, each in the frame of the previous joint, mm.
    """
    base = find_robot("IRB 1200")
    links = [Link(link.name, ()) for link in base.links]
    for k, plates in ((1, first), (3, third)):
        surface = make_plates(*plates)
        low, high = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
        half = ((high - low) / 2).tolist()
        box = Box(translation(*((high + low) / 2).tolist()), tuple(half))
        links[k] = Link(base.links[k].name, (box,), (surface,))
    joints = [
        replace(joint, axis=(0.0, 0.0, 1.0), previous_from_joint=translation(*shift))
        for joint, shift in zip(base.joints, shifts, strict=False)
    ]
    joints += base.joints[len(joints) :]
    return replace(
        base,
        links=tuple(links),
        joints=tuple(joints),
        pad=0.0,
        coupling=frozen(np.eye(6)),
        touching=(),
    )


def make_bar_and_block() -> Robot:
    return make_arm((BAR,), (BLOCK,), ((0, 0, 0), (300, 20, 10), (90, 0, 30)))


def find_mesh_pair(cell_scene: Scene) -> MeshPair:
    """The pair of link 1 and link 3."""
    closer = cell_scene.closer[cell_scene.pairs.index(("link 1", "link 3"))]
    assert closer is not None
    return closer


@pytest.fixture(scope="module")
def cell_scene() -> Scene:
    return make_scene(make_bar_and_block(), obstacles=(make_pillar(200, 250),))


@pytest.fixture(scope="module")
def pair(cell_scene: Scene) -> MeshPair:
    return find_mesh_pair(cell_scene)


def draw_joint_values(count: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-math.pi, math.pi, (count, 6))


def test_a_swept_solid_contains_its_link_at_all_angles() -> None:
    rng = np.random.default_rng(2)
    for _ in range(6):
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        origin = rng.uniform(-80, 80, 3)
        surface = make_plates(BAR, BLOCK)
        link = Link("link", (), (surface,))
        solid = sweep(link, tuple(origin.tolist()), tuple(axis.tolist()))
        weights = rng.dirichlet((1.0, 1.0, 1.0), (12, 40))
        corners = surface.vertices[surface.faces[rng.integers(0, len(surface.faces), 12)]]
        points = np.einsum("fks,fsc->fkc", weights, corners).reshape(-1, 3)
        for angle in rng.uniform(0, math.tau, 5):
            rotation = make_rotations_from_vectors((axis * angle)[None])[0]
            for point in points:
                position = rotation @ (point - origin) + origin
                assert solid.holds_any(position[None], np.eye(3), np.zeros(3))
        # The solid does not extend beyond the farthest corner.
        heights = (surface.vertices - origin) @ axis
        radial = surface.vertices - origin - heights[:, None] * axis
        assert solid.radii.max() == pytest.approx(np.linalg.norm(radial, axis=1).max(), abs=1e-5)
        beyond = origin + axis * (heights.max() + 0.01)
        assert not solid.holds_any(beyond[None], np.eye(3), np.zeros(3))


def test_a_swept_solid_contains_a_single_sloping_triangle() -> None:
    """In a closed mesh each side occurs in both directions, but not here."""
    corners = np.array([[10.0, 0.0, 50.0], [40.0, 0.0, 0.0], [0.0, 5.0, 20.0]])
    link = Link("link", (), (Surface(frozen(corners), np.array([[0, 1, 2]])),))
    solid = sweep(link, (0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    for fraction in np.linspace(0.01, 0.99, 99):
        point = fraction * corners[0] + (1 - fraction) * corners[1]
        assert solid.holds_any(point[None], np.eye(3), np.zeros(3))


def test_the_rounder_link_is_replaced_by_its_solid(pair: MeshPair) -> None:
    bar, block = (
        Link("", (Box(translation(*p[1]), p[0]),), (make_plates(p),)) for p in (BAR, BLOCK)
    )
    end, origin = (300.0, 20.0, 10.0), (0.0, 0.0, 0.0)
    about_z = (0.0, 0.0, 1.0)
    assert measure_roundness(bar, end, about_z) > 2 * measure_roundness(block, origin, about_z)
    wider = pair.wider()
    assert wider is not None
    assert wider.sweep is not None
    assert not wider.sweep.is_first
    assert wider.joints.tolist() == [1]


def test_the_distance_of_a_swept_solid_is_a_lower_bound_for_its_link(
    cell_scene: Scene, pair: MeshPair
) -> None:
    arm = cell_scene.robot
    joints = draw_joint_values(300, 3)
    wider = pair.wider()
    assert wider is not None
    bounds = pairs.bound_distances(arm, wider, joints, np.full(len(joints), 1e6))
    true = np.array([pairs.measure_pair(arm, pair, row) for row in joints])
    assert (bounds <= true + 1e-6).all()
    # The samples contain useful bounds as well as collisions.
    assert (bounds > 5).sum() > 50
    assert (true == 0).sum() > 5


def test_a_link_inside_a_swept_solid_has_no_distance_from_it() -> None:
    """The distance of their surfaces is at least 37 mm at all joint values."""
    inside = make_scene(make_arm((PIN,), TUBE, ((0, 0, 0),) * 3))
    closer = find_mesh_pair(inside)
    wider = closer.wider()
    assert wider is not None
    assert wider.sweep is not None
    assert not wider.sweep.is_first
    joints = draw_joint_values(20, 4)
    assert (pairs.bound_distances(inside.robot, wider, joints, np.full(20, 1e6)) <= 0).all()
    assert min(pairs.measure_pair(inside.robot, closer, row) for row in joints) > 35
    assert not pairs.meet(inside.robot, closer, joints).any()


def test_a_joint_brings_bodies_no_closer_than_its_lever_allows(cell_scene: Scene) -> None:
    rng = np.random.default_rng(6)
    arm = cell_scene.robot
    tight_count = 0
    for closer in cell_scene.closer:
        if closer is None:
            continue
        for row in draw_joint_values(40, 7):
            change = np.zeros(6)
            change[int(rng.choice(closer.joints))] = rng.uniform(-0.2, 0.2)
            bound = closer.levers @ np.abs(change[closer.joints])
            before, after = (
                pairs.measure_pair(arm, closer, joints) for joints in (row, row + change)
            )
            assert abs(before - after) <= bound + 1e-6
            tight_count += int(abs(before - after) > 0.5 * bound)
    assert tight_count > 5


def test_the_bound_of_boxes_is_below_that_of_their_meshes(
    cell_scene: Scene, pair: MeshPair
) -> None:
    table = bound_closing(cell_scene, np.full(6, math.pi))
    (column,) = table[:, cell_scene.of_pair == cell_scene.pairs.index(("link 1", "link 3"))].T
    assert (column[pair.joints] <= pair.levers + 1e-9).all()
    assert (np.delete(column, pair.joints) == 0).all()


def test_the_joint_that_sweeps_a_solid_needs_no_clearance(
    cell_scene: Scene, pair: MeshPair
) -> None:
    """Bodies that cannot come near are measured at random joint values, and none is near."""
    rng = np.random.default_rng(12)
    wider = pair.wider()
    assert wider is not None
    (free,) = set(pair.joints.tolist()) - set(wider.joints.tolist())
    joints, changes = draw_joint_values(60, 13), np.zeros((60, 6))
    changes[:, pair.joints] = rng.uniform(0.0, 0.05, (60, 2))
    changes[:, free] = rng.uniform(0.5, 3.0, 60)
    margins = rng.uniform(0.0, 4.0, 60)
    limits = changes[:, pair.joints] @ pair.levers + margins
    arm = cell_scene.robot
    without_sweep = pairs.may_come_within(arm, pair, joints, limits)
    with_sweep = pairs.may_come_within(arm, pair, joints, limits, pairs.Travel(changes, margins))
    assert not (with_sweep & ~without_sweep).any()
    assert (without_sweep & ~with_sweep).sum() > 10
    for row in np.flatnonzero(~with_sweep).tolist():
        nearby = joints[row] + rng.uniform(-1.0, 1.0, (12, 6)) * changes[row]
        assert min(pairs.measure_pair(arm, pair, values) for values in nearby) > margins[row]


def test_a_test_of_boxes_before_meshes_gives_the_same_result(cell_scene: Scene) -> None:
    joints = draw_joint_values(400, 8)
    for near in (0.0, 12.0):
        clear = are_clear(split_off_meshes(cell_scene, near), joints)
        assert clear.tolist() == (find_collisions(cell_scene, joints, near=near) < 0).tolist()
        assert 20 < clear.sum() < 380


def test_the_first_of_several_colliding_pairs_is_named(cell_scene: Scene) -> None:
    joints = draw_joint_values(400, 9)
    first = find_collisions(cell_scene, joints)
    by_pair = [
        find_collisions(select_pairs(cell_scene, [k]), joints) >= 0
        for k in range(len(cell_scene.pairs))
    ]
    collides = np.array(by_pair)
    expected = np.where(collides.any(axis=0), collides.argmax(axis=0), -1)
    assert first.tolist() == expected.tolist()
    assert (collides.sum(axis=0) > 1).any()


def test_a_surface_with_a_gap_has_a_swept_solid() -> None:
    """The plates are not connected, and the solid is thin between them."""
    low, high = ((9.0, 9.0, 5.0), (0.0, 0.0, 0.0)), ((9.0, 9.0, 5.0), (0.0, 0.0, 100.0))
    surface = make_plates(low, high)
    solid = sweep(
        Link("link", (), (Surface(surface.vertices, surface.faces),)), (0, 0, 0), (0, 0, 1)
    )
    for height, radius, is_in in ((0.0, 12.7, True), (50.0, 1.0, False), (100.0, 12.7, True)):
        point = np.array([[radius, 0.0, height]])
        assert solid.holds_any(point, np.eye(3), np.zeros(3)) == is_in
