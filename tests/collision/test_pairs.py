"""Links that are meshes: they decide if boxes meet, and proofs hold between samples."""

import itertools
import math

import numpy as np
import pytest
from msgspec.structs import replace

from camgen.collision import pairs
from camgen.collision.cell import make_cell_scene
from camgen.collision.describe import describe_hit, describe_joints, find_depth
from camgen.collision.hits import (
    GrowthTable,
    find_collisions,
    find_meetings,
    find_nearest_pairs,
    measure_clearance,
)
from camgen.collision.motion import check_motion
from camgen.collision.pairs import _SLACKS_MM
from camgen.collision.scene import Scene, StandingMesh, make_scene
from camgen.collision.triangle import are_free
from camgen.model.cell import Cell
from camgen.model.errors import JobError
from camgen.model.job import Job
from camgen.model.pose import IDENTITY, Pose, frozen, pose_from_values, translation
from camgen.model.program import Joints
from camgen.motion.cell import find_home
from camgen.robots.catalogue import find_robot
from camgen.robots.kinematics.forward import compute_link_frames
from camgen.robots.models import Box, Link, Robot, Surface
from camgen.robots.workcell import equip_cell
from tests.collision.test_motion import make_block

CORNERS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
FACES = np.array(
    [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]
)  # fmt: skip
#: Half edges and middles, mm, of the plates of a fork: two prongs with a gap of 60 mm, and a back.
PLATES = (((40.0, 5.0, 40.0), (60.0, 35.0, 0.0)), ((40.0, 5.0, 40.0), (60.0, -35.0, 0.0)))
BACK = ((5.0, 40.0, 40.0), (15.0, 0.0, 0.0))
#: Half edges of a pillar between the prongs, mm.
PILLAR = (8.0, 8.0, 100.0)


def make_plates(*plates: tuple[tuple[float, ...], tuple[float, ...]]) -> Surface:
    """The surface of plates, each given by its half edges and its middle."""
    corners = [CORNERS * half_edges + middle for half_edges, middle in plates]
    faces = [FACES + 8 * k for k in range(len(plates))]
    return Surface(frozen(np.concatenate(corners)), np.concatenate(faces))


def make_fork() -> Robot:
    """A flat arm whose link 1 is a fork in one box and rotates about z; other links are empty."""
    base = find_robot("Cobra s600")
    prongs = Link(
        "link 1", (Box(translation(55, 0, 0), (45, 40, 40)),), (make_plates(*PLATES, BACK),)
    )
    links = tuple(prongs if k == 1 else Link(link.name, ()) for k, link in enumerate(base.links))
    joints = (replace(base.joints[0], previous_from_joint=translation(0, 0, 0)), *base.joints[1:])
    return replace(base, joints=joints, links=links, pad=0.0)


def make_pillar(x: float, y: float) -> Link:
    """The pillar at a position, as one box."""
    return Link("pillar", (Box(Pose(IDENTITY, (x, y, 0.0)), PILLAR),))


def rotate_axis_1(angles: np.ndarray) -> np.ndarray:
    """Joint values (N, 4) with axis 1 at `angles` (N,), rad."""
    joints = np.zeros((len(angles), 4))
    joints[:, 0] = angles
    return joints


def find_outline(half: tuple[float, ...], middle: tuple[float, ...]) -> np.ndarray:
    """The outline of a plate from above (4, 2), in order."""
    signs = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    return np.asarray(signs * np.array(half[:2]) + np.array(middle[:2]))


def measure_flat_distance(first: np.ndarray, second: np.ndarray) -> float:
    """The distance of two convex outlines (K, 2); 0 unless a side separates them."""
    for a, b in ((first, second), (second, first)):
        sides = np.roll(a, -1, axis=0) - a
        normals = np.column_stack([sides[:, 1], -sides[:, 0]])
        if ((b[:, None] - a) * normals).sum(axis=2).min(axis=0).max() > 0:
            break
    else:
        return 0.0
    best = math.inf
    for a, b in ((first, second), (second, first)):
        for start, end in zip(a, np.roll(a, -1, axis=0), strict=True):
            fractions = np.clip(
                ((b - start) @ (end - start)) / ((end - start) @ (end - start)), 0, 1
            )
            foot = start + fractions[:, None] * (end - start)
            best = min(best, float(np.linalg.norm(b - foot, axis=1).min()))
    return best


def measure_true_distance(angle: float, x: float, y: float) -> float:
    """The distance of the fork from the pillar, mm: all is upright, so outlines are enough."""
    c, s = math.cos(angle), math.sin(angle)
    rotation = np.array([[c, s], [-s, c]])
    pillar = find_outline(PILLAR, (x, y))
    return min(
        measure_flat_distance(find_outline(*plate) @ rotation, pillar) for plate in (*PLATES, BACK)
    )


@pytest.fixture(scope="module", params=[False, True], ids=["box", "mesh"])
def pillar_scene(request: pytest.FixtureRequest) -> Scene:
    """The pillar, a box or a mesh, is between the prongs."""
    size = tuple(2 * half for half in PILLAR)
    obstacle = (
        StandingMesh("pillar", make_block(size), translation(60, 0, 0))
        if request.param
        else make_pillar(60, 0)
    )
    return make_scene(make_fork(), obstacles=(obstacle,))


def test_collisions_and_clearances_of_the_fork_agree_with_true_distances(
    pillar_scene: Scene,
) -> None:
    angles = np.linspace(-1.2, 1.2, 97)
    true = np.array([measure_true_distance(angle, 60, 0) for angle in angles])
    for near in (0.0, 5.0):
        is_hit = find_collisions(pillar_scene, rotate_axis_1(angles), near=near) >= 0
        is_certain = np.abs(true - near) > 1e-6
        assert (is_hit == (true <= near))[is_certain].all()
        assert 10 < is_hit.sum() < 90
    clearances = measure_clearance(pillar_scene, rotate_axis_1(angles), 15.0)
    assert clearances == pytest.approx(np.minimum(true, 15.0), abs=1e-5)
    joints = rotate_axis_1(angles[true > 0])
    owner = np.zeros(len(joints), dtype=np.int64)
    nearest = find_nearest_pairs(pillar_scene, joints, owner, np.array([100.0]))
    assert nearest.distance.tolist() == pytest.approx([true[true > 0].min()], abs=1e-5)


def test_a_fork_without_its_mesh_collides_with_a_pillar_between_its_prongs(
    pillar_scene: Scene,
) -> None:
    solid_fork = replace(
        make_fork(), links=tuple(replace(link, surfaces=()) for link in make_fork().links)
    )
    assert (
        find_collisions(
            make_scene(solid_fork, obstacles=(make_pillar(60, 0),)), rotate_axis_1(np.zeros(1))
        )[0]
        >= 0
    )
    assert find_collisions(pillar_scene, rotate_axis_1(np.zeros(1)))[0] < 0


def test_a_body_that_is_not_named_meets_nothing_when_it_is_enlarged(pillar_scene: Scene) -> None:
    rng = np.random.default_rng(3)
    angles, growth = rng.uniform(-0.6, 0.6, 200), rng.uniform(0, 25, 200)
    rows = np.repeat(growth[:, None], len(pillar_scene.frame), axis=1)
    row, _ = find_meetings(pillar_scene, rotate_axis_1(angles), GrowthTable(rows), np.zeros(200))
    true = np.array([measure_true_distance(angle, 60, 0) for angle in angles])
    is_named = np.isin(np.arange(200), row)
    assert (is_named | (true > growth - 1e-6)).all()
    # Bodies that are farther apart by twice the slack of the small cells are not named.
    is_far = true > growth + 2 * _SLACKS_MM[-1] + 1e-3
    assert is_far.sum() > 10
    assert not (is_named & is_far).any()


def test_a_free_motion_is_free_at_all_fine_samples(pillar_scene: Scene) -> None:
    rng = np.random.default_rng(4)
    verdicts = set()
    for _ in range(16):
        ends = rng.uniform(-0.5, 0.5, 2)
        check = check_motion(pillar_scene, rotate_axis_1(ends), 0.5, near=3.0)
        true = min(measure_true_distance(angle, 60, 0) for angle in np.linspace(*ends, 80))
        verdicts.add(check.hit)
        if check.hit:
            assert true <= 0.25
        else:
            assert true > 0
            assert check.clearance == pytest.approx(min(true, 3.0), abs=0.3)
    assert verdicts == {False, True}


def test_a_free_triangle_is_free_at_all_fine_samples(pillar_scene: Scene) -> None:
    rng = np.random.default_rng(5)
    corners = np.stack([rotate_axis_1(rng.uniform(-0.4, 0.4, 3)) for _ in range(30)])
    are_triangles_free = are_free(pillar_scene, corners, np.arange(30))
    for triangle, is_free in zip(corners, are_triangles_free, strict=True):
        angles = np.linspace(triangle[:, 0].min(), triangle[:, 0].max(), 60)
        true = min(measure_true_distance(angle, 60, 0) for angle in angles)
        assert true > 0 or not is_free
    assert 3 < are_triangles_free.sum() < 27


def test_bounds_are_below_the_distance_and_limits_are_decided_exactly() -> None:
    """Joint values are tested one by one and all together."""
    rng = np.random.default_rng(6)
    angles, limits = rng.uniform(-1.5, 1.5, 150), rng.uniform(0.0, 30.0, 150)
    true = np.array([measure_true_distance(angle, 60, 0) for angle in angles])
    for batch in (1, 150):
        pillar_scene = make_scene(make_fork(), obstacles=(make_pillar(60, 0),))
        (closer,) = [pair for pair in pillar_scene.closer if pair is not None]
        for start in range(0, 150, batch):
            rows = slice(start, start + batch)
            joints, distance, limit = rotate_axis_1(angles[rows]), true[rows], limits[rows]
            bound = pairs.bound_distances(pillar_scene.robot, closer, joints, limit)
            assert (bound <= distance + 1e-5).all()
            may_come = pairs.may_come_within(pillar_scene.robot, closer, joints, limit)
            assert (may_come | (distance > limit - 1e-6)).all()
            comes = pairs.come_within(pillar_scene.robot, closer, joints, limit)
            is_certain = np.abs(distance - limit) > 1e-5
            assert (comes == (distance <= limit))[is_certain].all()
    assert 20 < (true <= limits).sum() < 130


def test_results_do_not_depend_on_earlier_tests() -> None:
    angles = np.linspace(-0.5, 0.5, 41)
    fresh: list[int] = []
    for k in range(41):
        new_scene = make_scene(make_fork(), obstacles=(make_pillar(60, 0),))
        fresh += find_collisions(new_scene, rotate_axis_1(angles[k : k + 1]), near=4.0).tolist()
    cell_scene = make_scene(make_fork(), obstacles=(make_pillar(60, 0),))
    growth = GrowthTable(np.full((41, len(cell_scene.frame)), 9.0))
    find_meetings(cell_scene, rotate_axis_1(angles), growth, np.zeros(41))
    assert find_collisions(cell_scene, rotate_axis_1(angles), near=4.0).tolist() == fresh


def test_two_links_that_are_meshes_collide_as_their_outlines_do() -> None:
    """Link 2 has a bar that hits a prong of link 1 if axis 2 rotates too far."""
    base = make_fork()
    bar = make_plates(((60.0, 4.0, 4.0), (-60.0, 0.0, 0.0)))
    second = Link("link 2", (Box(translation(-60, 0, 0), (60, 4, 4)),), (bar,))
    links = tuple(second if k == 2 else link for k, link in enumerate(base.links))
    joints = (base.joints[0], replace(base.joints[1], previous_from_joint=translation(150, 0, 0)))
    robot = replace(base, links=links, joints=(*joints, *base.joints[2:]), touching=())
    cell_scene = make_scene(robot)
    assert ("link 1", "link 2") in cell_scene.pairs
    angles = np.linspace(-0.6, 0.6, 61)
    rows = np.zeros((61, 4))
    rows[:, 1] = angles
    _, origins = compute_link_frames(robot, rows)
    assert np.allclose(origins[:, 2, 0], 150)
    is_hit = find_collisions(cell_scene, rows) >= 0
    for angle, collides in zip(angles, is_hit, strict=True):
        c, s = math.cos(angle), math.sin(angle)
        outline = find_outline((60.0, 4.0), (-60.0, 0.0)) @ np.array([[c, s], [-s, c]]) + [150, 0]
        true = min(
            measure_flat_distance(outline, find_outline(*plate)) for plate in (*PLATES, BACK)
        )
        assert collides == (true <= 0)
    assert 5 < is_hit.sum() < 56


def test_a_pair_that_always_overlaps_is_named_and_not_tested() -> None:
    """A mesh and a box overlap at any joint values."""
    base = make_fork()
    middle = Link("link 3", (Box(translation(0, 0, 0), (90, 90, 600)),), ())
    links = [*base.links[:1], base.links[1], Link("link 2", ()), middle, *base.links[4:]]
    joints = [replace(joint, previous_from_joint=translation(0, 0, 0)) for joint in base.joints]
    robot = replace(
        base, links=tuple(links), joints=tuple(joints), touching=((0, 1), (1, 2), (2, 3))
    )
    cell = Cell("c", pose_from_values([900, 0, 0, 0, 0, 0]), translation(0, 0, 100), Joints(()))
    job_scene = make_cell_scene(Job(), equip_cell(cell, Job(), robot), None)
    assert ("link 1", "link 3") in [pair.bodies for pair in job_scene.untested]
    assert ("link 1", "link 3") not in job_scene.scene.pairs


def test_a_link_without_a_readable_shape_is_named_as_untested() -> None:
    base = find_robot("Cobra s600")
    links = (*base.links[:2], replace(base.links[2], unread=("arm.x3d",)), *base.links[3:])
    cell = Cell("c", pose_from_values([900, 0, 0, 0, 0, 0]), translation(0, 0, 100), Joints(()))
    job_scene = make_cell_scene(Job(), equip_cell(cell, Job(), replace(base, links=links)), None)
    (untested,) = job_scene.untested
    assert untested.bodies == ("link 2", "all others")
    assert untested.why == "arm.x3d could not be read"
    links = (*base.links[:2], Link("link 2", ()), *base.links[3:])
    job_scene = make_cell_scene(Job(), equip_cell(cell, Job(), replace(base, links=links)), None)
    assert [pair.why for pair in job_scene.untested] == ["it has no shape"]


def test_a_collision_is_described_with_its_depth_and_joint_values() -> None:
    cell_scene = make_scene(make_fork(), obstacles=(make_pillar(60, 0),))
    (row,) = rotate_axis_1(np.array([math.radians(30)]))
    assert describe_hit(cell_scene, row, cell_scene.pairs.index(("link 1", "pillar"))) == (
        "link 1 against pillar, their meshes meet, at joints 30 deg, 0 deg, 0 mm, 0 deg"
    )
    solid_fork = replace(
        make_fork(), links=tuple(replace(link, surfaces=()) for link in make_fork().links)
    )
    size = tuple(2 * half for half in PILLAR)
    # The box of the fork ends at x = 100, the pillar begins at 96.
    for obstacle in (
        make_pillar(104, 0),
        StandingMesh("pillar", make_block(size), translation(104, 0, 0)),
    ):
        cell = make_scene(solid_fork, obstacles=(obstacle,))
        pair = int(find_collisions(cell, rotate_axis_1(np.zeros(1)))[0])
        assert find_depth(cell, rotate_axis_1(np.zeros(1))[0], pair) == pytest.approx(4.0, abs=0.02)
    assert (
        describe_joints(find_robot("IRB 1200"), np.radians([1, -2, 3, 0, 30, 0.5]))
        == "1 -2 3 0 30 0.5 deg"
    )


def test_a_home_beyond_its_limits_is_refused_with_the_limit() -> None:
    arm = find_robot("IRB 1200")
    home = Joints(tuple(np.radians([0.0, 140.0, 0, 0, 30, 0]).tolist()))
    cell = Cell("c", translation(900, 0, 0), translation(0, 0, 100), home)
    with pytest.raises(
        JobError, match=r"at home axis 2 is beyond its limit by 10 deg \(cell.home\)"
    ):
        find_home(arm, cell, make_scene(arm))
