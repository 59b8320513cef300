"""Links that are meshes: they decide where boxes meet, and proofs of motions hold in between."""

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
from tests.collision.test_motion import block

CORNERS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
FACES = np.array(
    [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]
)  # fmt: skip
#: Half the edges of the plates of a fork and their middles, mm: two prongs, 60 mm apart, on a back.
PLATES = (((40.0, 5.0, 40.0), (60.0, 35.0, 0.0)), ((40.0, 5.0, 40.0), (60.0, -35.0, 0.0)))
BACK = ((5.0, 40.0, 40.0), (15.0, 0.0, 0.0))
#: A pillar between the prongs: half its edges, mm.
PILLAR = (8.0, 8.0, 100.0)


def plates(*several: tuple[tuple[float, ...], tuple[float, ...]]) -> Surface:
    corners = [CORNERS * half + middle for half, middle in several]
    faces = [FACES + 8 * k for k in range(len(several))]
    return Surface(frozen(np.concatenate(corners)), np.concatenate(faces))


def fork() -> Robot:
    """Link 1 of a flat arm is a fork, in one box; all other links are nothing. It turns about z."""
    base = find_robot("Cobra s600")
    held = Link("link 1", (Box(translation(55, 0, 0), (45, 40, 40)),), (plates(*PLATES, BACK),))
    links = tuple(held if k == 1 else Link(link.name, ()) for k, link in enumerate(base.links))
    joints = (replace(base.joints[0], previous_from_joint=translation(0, 0, 0)), *base.joints[1:])
    return replace(base, joints=joints, links=links, pad=0.0)


def pillar(x: float, y: float) -> Link:
    return Link("pillar", (Box(Pose(IDENTITY, (x, y, 0.0)), PILLAR),))


def turned(angles: np.ndarray) -> np.ndarray:
    joints = np.zeros((len(angles), 4))
    joints[:, 0] = angles
    return joints


def corners_of(half: tuple[float, ...], middle: tuple[float, ...]) -> np.ndarray:
    """The outline of a plate from above (4, 2), in order."""
    signs = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    return np.asarray(signs * np.array(half[:2]) + np.array(middle[:2]))


def flat_distance(first: np.ndarray, second: np.ndarray) -> float:
    """The distance of two convex outlines (K, 2): 0 unless a side parts them."""
    for a, b in ((first, second), (second, first)):
        sides = np.roll(a, -1, axis=0) - a
        across = np.column_stack([sides[:, 1], -sides[:, 0]])
        if ((b[:, None] - a) * across).sum(axis=2).min(axis=0).max() > 0:
            break
    else:
        return 0.0
    best = math.inf
    for a, b in ((first, second), (second, first)):
        for start, end in zip(a, np.roll(a, -1, axis=0), strict=True):
            share = np.clip(((b - start) @ (end - start)) / ((end - start) @ (end - start)), 0, 1)
            foot = start + share[:, None] * (end - start)
            best = min(best, float(np.linalg.norm(b - foot, axis=1).min()))
    return best


def true_distance(angle: float, x: float, y: float) -> float:
    """All is upright: the distance is that of the outlines from above."""
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, s], [-s, c]])
    post = corners_of(PILLAR, (x, y))
    return min(flat_distance(corners_of(*plate) @ turn, post) for plate in (*PLATES, BACK))


@pytest.fixture(scope="module", params=[False, True], ids=["box", "mesh"])
def between(request: pytest.FixtureRequest) -> Scene:
    """The pillar, a box or a mesh, stands between the prongs."""
    size = tuple(2 * half for half in PILLAR)
    wall = (
        StandingMesh("pillar", block(size), translation(60, 0, 0))
        if request.param
        else pillar(60, 0)
    )
    return make_scene(fork(), obstacles=(wall,))


def test_a_pillar_between_the_prongs_is_free_as_far_as_it_is(between: Scene) -> None:
    angles = np.linspace(-1.2, 1.2, 97)
    true = np.array([true_distance(angle, 60, 0) for angle in angles])
    for near in (0.0, 5.0):
        is_hit = find_collisions(between, turned(angles), near=near) >= 0
        sure = np.abs(true - near) > 1e-6
        assert (is_hit == (true <= near))[sure].all()
        assert 10 < is_hit.sum() < 90
    free = measure_clearance(between, turned(angles), 15.0)
    assert free == pytest.approx(np.minimum(true, 15.0), abs=1e-5)
    joints = turned(angles[true > 0])
    owner = np.zeros(len(joints), dtype=np.int64)
    (nearest,) = find_nearest_pairs(between, joints, owner, np.array([100.0]))
    assert nearest.distance == pytest.approx(true[true > 0].min(), abs=1e-5)


def test_without_its_mesh_the_fork_is_full(between: Scene) -> None:
    full = replace(fork(), links=tuple(replace(link, surfaces=()) for link in fork().links))
    assert (
        find_collisions(make_scene(full, obstacles=(pillar(60, 0),)), turned(np.zeros(1)))[0] >= 0
    )
    assert find_collisions(between, turned(np.zeros(1)))[0] < 0


def test_what_is_not_named_meets_nothing_in_all_that_it_grows_for(between: Scene) -> None:
    rng = np.random.default_rng(3)
    angles, grow = rng.uniform(-0.6, 0.6, 200), rng.uniform(0, 25, 200)
    rows = np.repeat(grow[:, None], len(between.frame), axis=1)
    row, _ = find_meetings(between, turned(angles), GrowthTable(rows), np.zeros(200))
    true = np.array([true_distance(angle, 60, 0) for angle in angles])
    named = np.isin(np.arange(200), row)
    assert (named | (true > grow - 1e-6)).all()
    # Bodies that are farther apart by twice the slack of the small cells are not named.
    far = true > grow + 2 * _SLACKS_MM[-1] + 1e-3
    assert far.sum() > 10
    assert not (named & far).any()


def test_a_motion_that_is_free_is_free_in_between(between: Scene) -> None:
    rng = np.random.default_rng(4)
    verdicts = set()
    for _ in range(16):
        ends = rng.uniform(-0.5, 0.5, 2)
        met = check_motion(between, turned(ends), 0.5, near=3.0)
        true = min(true_distance(angle, 60, 0) for angle in np.linspace(*ends, 80))
        verdicts.add(met.hit)
        if met.hit:
            assert true <= 0.25
        else:
            assert true > 0
            assert met.clearance == pytest.approx(min(true, 3.0), abs=0.3)
    assert verdicts == {False, True}


def test_a_triangle_that_is_free_is_free_within(between: Scene) -> None:
    rng = np.random.default_rng(5)
    corners = np.stack([turned(rng.uniform(-0.4, 0.4, 3)) for _ in range(30)])
    free = are_free(between, corners, np.arange(30))
    for triangle, is_free in zip(corners, free, strict=True):
        angles = np.linspace(triangle[:, 0].min(), triangle[:, 0].max(), 60)
        true = min(true_distance(angle, 60, 0) for angle in angles)
        assert true > 0 or not is_free
    assert 3 < free.sum() < 27


def test_bounds_are_no_more_than_the_distance_and_what_is_far_is_known_to_be() -> None:
    """One question alone, many together, and questions of which points of both bodies answer."""
    rng = np.random.default_rng(6)
    angles, room = rng.uniform(-1.5, 1.5, 150), rng.uniform(0.0, 30.0, 150)
    true = np.array([true_distance(angle, 60, 0) for angle in angles])
    for together in (1, 150):
        between = make_scene(fork(), obstacles=(pillar(60, 0),))
        (closer,) = [pair for pair in between.closer if pair is not None]
        for begin in range(0, 150, together):
            rows = slice(begin, begin + together)
            values, distance, limit = turned(angles[rows]), true[rows], room[rows]
            bound = pairs.bound_distances(between.robot, closer, values, limit)
            assert (bound <= distance + 1e-5).all()
            may_come = pairs.may_come_within(between.robot, closer, values, limit)
            assert (may_come | (distance > limit - 1e-6)).all()
            comes = pairs.come_within(between.robot, closer, values, limit)
            is_sure = np.abs(distance - limit) > 1e-5
            assert (comes == (distance <= limit))[is_sure].all()
    assert 20 < (true <= room).sum() < 130


def test_answers_do_not_depend_on_what_was_asked_before() -> None:
    angles = np.linspace(-0.5, 0.5, 41)
    fresh = [
        int(
            find_collisions(
                make_scene(fork(), obstacles=(pillar(60, 0),)), turned(angles[k : k + 1]), near=4.0
            )[0]
        )
        for k in range(41)
    ]
    cell_scene = make_scene(fork(), obstacles=(pillar(60, 0),))
    growth = GrowthTable(np.full((41, len(cell_scene.frame)), 9.0))
    find_meetings(cell_scene, turned(angles), growth, np.zeros(41))
    assert find_collisions(cell_scene, turned(angles), near=4.0).tolist() == fresh


def test_two_links_that_both_are_meshes() -> None:
    """Link 2 carries a bar that runs into a prong of link 1 if axis 2 turns too far."""
    base = fork()
    bar = plates(((60.0, 4.0, 4.0), (-60.0, 0.0, 0.0)))
    second = Link("link 2", (Box(translation(-60, 0, 0), (60, 4, 4)),), (bar,))
    links = tuple(second if k == 2 else link for k, link in enumerate(base.links))
    joints = (base.joints[0], replace(base.joints[1], previous_from_joint=translation(150, 0, 0)))
    of = replace(base, links=links, joints=(*joints, *base.joints[2:]), touching=())
    cell_scene = make_scene(of)
    assert ("link 1", "link 2") in cell_scene.pairs
    angles = np.linspace(-0.6, 0.6, 61)
    rows = np.zeros((61, 4))
    rows[:, 1] = angles
    _, origins = compute_link_frames(of, rows)
    assert np.allclose(origins[:, 2, 0], 150)
    is_hit = find_collisions(cell_scene, rows) >= 0
    for angle, met in zip(angles, is_hit, strict=True):
        c, s = math.cos(angle), math.sin(angle)
        outline = corners_of((60.0, 4.0), (-60.0, 0.0)) @ np.array([[c, s], [-s, c]]) + [150, 0]
        true = min(flat_distance(outline, corners_of(*plate)) for plate in (*PLATES, BACK))
        assert met == (true <= 0)
    assert 5 < is_hit.sum() < 56


def test_a_pair_that_cannot_be_told_apart_is_named_and_left_out() -> None:
    """Two meshes that overlap however the arm stands."""
    base = fork()
    middle = Link("link 3", (Box(translation(0, 0, 0), (90, 90, 600)),), ())
    links = [*base.links[:1], base.links[1], Link("link 2", ()), middle, *base.links[4:]]
    joints = [replace(joint, previous_from_joint=translation(0, 0, 0)) for joint in base.joints]
    of = replace(base, links=tuple(links), joints=tuple(joints), touching=((0, 1), (1, 2), (2, 3)))
    cell = Cell("c", pose_from_values([900, 0, 0, 0, 0, 0]), translation(0, 0, 100), Joints(()))
    where = make_cell_scene(Job(), equip_cell(cell, Job(), of), None)
    assert ("link 1", "link 3") in [pair.bodies for pair in where.untested]
    assert ("link 1", "link 3") not in where.scene.pairs


def test_a_link_with_a_mesh_that_is_not_read_is_named() -> None:
    base = find_robot("Cobra s600")
    links = (*base.links[:2], replace(base.links[2], unread=("arm.x3d",)), *base.links[3:])
    cell = Cell("c", pose_from_values([900, 0, 0, 0, 0, 0]), translation(0, 0, 100), Joints(()))
    where = make_cell_scene(Job(), equip_cell(cell, Job(), replace(base, links=links)), None)
    (untested,) = where.untested
    assert untested.bodies == ("link 2", "all others")
    assert untested.why == "arm.x3d could not be read"
    links = (*base.links[:2], Link("link 2", ()), *base.links[3:])
    where = make_cell_scene(Job(), equip_cell(cell, Job(), replace(base, links=links)), None)
    assert [pair.why for pair in where.untested] == ["it has no shape"]


def test_a_collision_is_told_with_its_depth_and_joint_values() -> None:
    cell_scene = make_scene(fork(), obstacles=(pillar(60, 0),))
    (row,) = turned(np.array([math.radians(30)]))
    assert describe_hit(cell_scene, row, cell_scene.pairs.index(("link 1", "pillar"))) == (
        "link 1 against pillar, their meshes meet, at joints 30 deg, 0 deg, 0 mm, 0 deg"
    )
    full = replace(fork(), links=tuple(replace(link, surfaces=()) for link in fork().links))
    size = tuple(2 * half for half in PILLAR)
    # The box of the fork ends at x = 100, the pillar begins at 96.
    for post in (pillar(104, 0), StandingMesh("pillar", block(size), translation(104, 0, 0))):
        cell = make_scene(full, obstacles=(post,))
        pair = int(find_collisions(cell, turned(np.zeros(1)))[0])
        assert find_depth(cell, turned(np.zeros(1))[0], pair) == pytest.approx(4.0, abs=0.02)
    assert (
        describe_joints(find_robot("IRB 1200"), np.radians([1, -2, 3, 0, 30, 0.5]))
        == "1 -2 3 0 30 0.5 deg"
    )


def test_a_home_beyond_its_limits_is_no_collision() -> None:
    arm = find_robot("IRB 1200")
    home = Joints(tuple(np.radians([0.0, 140.0, 0, 0, 30, 0]).tolist()))
    cell = Cell("c", translation(900, 0, 0), translation(0, 0, 100), home)
    with pytest.raises(
        JobError, match=r"at home axis 2 is beyond its limit by 10 deg \(cell.home\)"
    ):
        find_home(arm, cell, make_scene(arm))
