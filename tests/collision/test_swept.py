"""Two links with one link between them: the rounder one as the solid that it sweeps."""

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
from tests.collision.test_pairs import pillar, plates

#: Half the edges and the middles of plates, mm: a bar along x, and a block beside the axis.
BAR, BLOCK = ((150.0, 20.0, 25.0), (150.0, 60.0, 0.0)), ((30.0, 40.0, 50.0), (10.0, 0.0, 20.0))


#: A square tube of four plates about z, and a pin across its middle.
TUBE = (
    ((60.0, 2.0, 20.0), (0.0, 58.0, 0.0)), ((60.0, 2.0, 20.0), (0.0, -58.0, 0.0)),
    ((2.0, 60.0, 20.0), (58.0, 0.0, 0.0)), ((2.0, 60.0, 20.0), (-58.0, 0.0, 0.0)),
)  # fmt: skip
PIN = ((20.0, 1.0, 1.0), (0.0, 0.0, 0.0))


Plate = tuple[tuple[float, ...], tuple[float, ...]]


def arm_of(
    first: tuple[Plate, ...], third: tuple[Plate, ...], shifts: tuple[tuple[float, ...], ...]
) -> Robot:
    """An arm of which links 1 and 3 are plates; the two axes between them turn about z.

    shifts: origins of the first three joints, each in the frame before it, mm.
    """
    base = find_robot("IRB 1200")
    links = [Link(link.name, ()) for link in base.links]
    for k, several in ((1, first), (3, third)):
        surface = plates(*several)
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


def bar_and_block() -> Robot:
    return arm_of((BAR,), (BLOCK,), ((0, 0, 0), (300, 20, 10), (90, 0, 30)))


def closer_of(cell_scene: Scene) -> MeshPair:
    closer = cell_scene.closer[cell_scene.pairs.index(("link 1", "link 3"))]
    assert closer is not None
    return closer


@pytest.fixture(scope="module")
def cell_scene() -> Scene:
    return make_scene(bar_and_block(), obstacles=(pillar(200, 250),))


@pytest.fixture(scope="module")
def pair(cell_scene: Scene) -> MeshPair:
    return closer_of(cell_scene)


def rows(count: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-math.pi, math.pi, (count, 6))


def test_a_solid_holds_its_link_at_all_angles() -> None:
    rng = np.random.default_rng(2)
    for _ in range(6):
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        origin = rng.uniform(-80, 80, 3)
        surface = plates(BAR, BLOCK)
        link = Link("link", (), (surface,))
        solid = sweep(link, tuple(origin.tolist()), tuple(axis.tolist()))
        shares = rng.dirichlet((1.0, 1.0, 1.0), (12, 40))
        corners = surface.vertices[surface.faces[rng.integers(0, len(surface.faces), 12)]]
        points = np.einsum("fks,fsc->fkc", shares, corners).reshape(-1, 3)
        for angle in rng.uniform(0, math.tau, 5):
            turned = make_rotations_from_vectors((axis * angle)[None])[0]
            for point in points:
                place = turned @ (point - origin) + origin
                assert solid.holds_any(place[None], np.eye(3), np.zeros(3))
        # It is no larger than the farthest corner.
        heights = (surface.vertices - origin) @ axis
        across = surface.vertices - origin - heights[:, None] * axis
        assert solid.radii.max() == pytest.approx(np.linalg.norm(across, axis=1).max(), abs=1e-5)
        beyond = origin + axis * (heights.max() + 0.01)
        assert not solid.holds_any(beyond[None], np.eye(3), np.zeros(3))


def test_a_solid_holds_a_triangle_that_falls() -> None:
    """A closed mesh runs each side both ways; one triangle does not."""
    corners = np.array([[10.0, 0.0, 50.0], [40.0, 0.0, 0.0], [0.0, 5.0, 20.0]])
    link = Link("link", (), (Surface(frozen(corners), np.array([[0, 1, 2]])),))
    solid = sweep(link, (0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    for share in np.linspace(0.01, 0.99, 99):
        point = share * corners[0] + (1 - share) * corners[1]
        assert solid.holds_any(point[None], np.eye(3), np.zeros(3))


def test_the_rounder_link_is_the_solid(pair: MeshPair) -> None:
    bar, block = (Link("", (Box(translation(*p[1]), p[0]),), (plates(p),)) for p in (BAR, BLOCK))
    end, origin = (300.0, 20.0, 10.0), (0.0, 0.0, 0.0)
    about_z = (0.0, 0.0, 1.0)
    assert measure_roundness(bar, end, about_z) > 2 * measure_roundness(block, origin, about_z)
    wider = pair.wider()
    assert wider is not None
    assert wider.sweep is not None
    assert not wider.sweep.is_first
    assert wider.joints.tolist() == [1]


def test_a_solid_is_no_farther_than_its_link(cell_scene: Scene, pair: MeshPair) -> None:
    arm = cell_scene.robot
    joints = rows(300, 3)
    wider = pair.wider()
    assert wider is not None
    bounds = pairs.bound_distances(arm, wider, joints, np.full(len(joints), 1e6))
    true = np.array([pairs.measure_pair(arm, pair, row) for row in joints])
    assert (bounds <= true + 1e-6).all()
    # It is of use: where the block is beside the bar and where it is not.
    assert (bounds > 5).sum() > 50
    assert (true == 0).sum() > 5


def test_a_link_within_a_solid_is_not_apart_from_it() -> None:
    """Their surfaces are 37 mm apart or more, however the joints turn."""
    inside = make_scene(arm_of((PIN,), TUBE, ((0, 0, 0),) * 3))
    closer = closer_of(inside)
    wider = closer.wider()
    assert wider is not None
    assert wider.sweep is not None
    assert not wider.sweep.is_first
    joints = rows(20, 4)
    assert (pairs.bound_distances(inside.robot, wider, joints, np.full(20, 1e6)) <= 0).all()
    assert min(pairs.measure_pair(inside.robot, closer, row) for row in joints) > 35
    assert not pairs.meet(inside.robot, closer, joints).any()


def test_no_joint_brings_bodies_nearer_than_its_lever(cell_scene: Scene) -> None:
    rng = np.random.default_rng(6)
    arm = cell_scene.robot
    used = 0
    for closer in cell_scene.closer:
        if closer is None:
            continue
        for row in rows(40, 7):
            turn = np.zeros(6)
            turn[int(rng.choice(closer.joints))] = rng.uniform(-0.2, 0.2)
            moved = closer.levers @ np.abs(turn[closer.joints])
            before, after = (pairs.measure_pair(arm, closer, each) for each in (row, row + turn))
            assert abs(before - after) <= moved + 1e-6
            used += int(abs(before - after) > 0.5 * moved)
    assert used > 5


def test_two_boxes_come_no_nearer_than_their_meshes(cell_scene: Scene, pair: MeshPair) -> None:
    table = bound_closing(cell_scene, np.full(6, math.pi))
    (column,) = table[:, cell_scene.of_pair == cell_scene.pairs.index(("link 1", "link 3"))].T
    assert (column[pair.joints] <= pair.levers + 1e-9).all()
    assert (np.delete(column, pair.joints) == 0).all()


def test_the_joint_that_sweeps_a_solid_does_not_count_and_nothing_is_missed(
    cell_scene: Scene, pair: MeshPair
) -> None:
    """Bodies measured at joint values all around: where none may come near, none does."""
    rng = np.random.default_rng(12)
    wider = pair.wider()
    assert wider is not None
    (free,) = set(pair.joints.tolist()) - set(wider.joints.tolist())
    joints, turned = rows(60, 13), np.zeros((60, 6))
    turned[:, pair.joints] = rng.uniform(0.0, 0.05, (60, 2))
    turned[:, free] = rng.uniform(0.5, 3.0, 60)
    more = rng.uniform(0.0, 4.0, 60)
    room = turned[:, pair.joints] @ pair.levers + more
    arm = cell_scene.robot
    loose = pairs.may_come_within(arm, pair, joints, room)
    tight = pairs.may_come_within(arm, pair, joints, room, pairs.Travel(turned, more))
    assert not (tight & ~loose).any()
    assert (loose & ~tight).sum() > 10
    for row in np.flatnonzero(~tight).tolist():
        around = joints[row] + rng.uniform(-1.0, 1.0, (12, 6)) * turned[row]
        assert min(pairs.measure_pair(arm, pair, values) for values in around) > more[row]


def test_pairs_of_boxes_first_give_the_same_answer(cell_scene: Scene) -> None:
    joints = rows(400, 8)
    for near in (0.0, 12.0):
        clear = are_clear(split_off_meshes(cell_scene), joints, near)
        assert clear.tolist() == (find_collisions(cell_scene, joints, near=near) < 0).tolist()
        assert 20 < clear.sum() < 380


def test_the_first_pair_is_named_where_several_collide(cell_scene: Scene) -> None:
    joints = rows(400, 9)
    first = find_collisions(cell_scene, joints)
    each = [
        find_collisions(select_pairs(cell_scene, [k]), joints) >= 0
        for k in range(len(cell_scene.pairs))
    ]
    collides = np.array(each)
    expected = np.where(collides.any(axis=0), collides.argmax(axis=0), -1)
    assert first.tolist() == expected.tolist()
    assert (collides.sum(axis=0) > 1).any()


def test_a_surface_with_a_gap_has_a_solid() -> None:
    """The plates do not hang together: the solid is thin between them."""
    low, high = ((9.0, 9.0, 5.0), (0.0, 0.0, 0.0)), ((9.0, 9.0, 5.0), (0.0, 0.0, 100.0))
    surface = plates(low, high)
    solid = sweep(
        Link("link", (), (Surface(surface.vertices, surface.faces),)), (0, 0, 0), (0, 0, 1)
    )
    for height, radius, is_in in ((0.0, 12.7, True), (50.0, 1.0, False), (100.0, 12.7, True)):
        point = np.array([[radius, 0.0, height]])
        assert solid.holds_any(point, np.eye(3), np.zeros(3)) == is_in
