import itertools
import math

import numpy as np
import pytest
import trimesh
from msgspec.structs import replace

from camgen.collision import motion as motion_module
from camgen.collision.boxes import Boxes
from camgen.collision.hits import (
    find_collisions,
    find_nearest_pairs,
    measure_clearance,
    place_boxes,
)
from camgen.collision.mesh import Mesh, are_inside, make_mesh
from camgen.collision.motion import (
    bound_closing,
    check_motion,
    check_motions,
    measure_apart,
    measure_closer,
    measure_moves,
)
from camgen.collision.scene import Allowed, Scene, make_scene, name_pair, select_pairs
from camgen.model.errors import JobError
from camgen.model.part import Solid
from camgen.model.pose import Pose, frozen, rotation_about, translation
from camgen.robots.catalogue import find_robot, list_robots
from camgen.robots.kinematics.forward import compute_flange, compute_link_frames
from camgen.robots.kinematics.joint_limits import are_within_limits
from camgen.robots.models import Box, Link, Robot

SIGNS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))


def make_bar(
    name: str,
    origin: tuple[float, float, float],
    half: tuple[float, float, float],
    angle: float = 0.0,
) -> Link:
    """A link of one box, rotated about z by `angle` deg."""
    return Link(name, (Box(Pose(rotation_about(2, math.radians(angle)), origin), half),))


#: A wire in front of a thick wall, both as high as the rod of the flat arm.
WIRE_AND_WALL = (
    make_bar("wire", (560, 0, 450), (60, 0.05, 60)),
    make_bar("wall", (560, 150, 450), (60, 90, 60)),
)


def make_flat_arm() -> Robot:
    """A SCARA whose only body is a rod 20 mm thick as its second arm, at z = 440 to 460.

    Stretched out, axis 1 is at the origin, axis 2 at x = 325 and the flange at x = 600 and
    z = 387 - J3.
    """
    names = [link.name for link in find_robot("Cobra s600").links]
    second = make_bar("link 2", (137.5, 0, 108), (137.5, 10, 10))
    links = tuple(second if name == "link 2" else Link(name, ()) for name in names)
    return replace(find_robot("Cobra s600"), links=links, pad=0.0)


def joints_at(*values: float) -> np.ndarray:
    """Joint values (1, 4) from J1, J2, J3, J4 in deg, deg, mm, deg."""
    return np.array(
        [[math.radians(values[0]), math.radians(values[1]), values[2], math.radians(values[3])]]
    )


def make_block(size: tuple[float, float, float]) -> Mesh:
    """A cuboid around its origin as a mesh."""
    mesh = trimesh.creation.box(size)
    faces = np.asarray(mesh.faces, dtype=np.int64)
    return mesh_of_triangles(mesh.vertices, faces, mesh.face_normals)


def mesh_of_triangles(vertices: np.ndarray, faces: np.ndarray, normals: np.ndarray) -> Mesh:
    """The mesh of triangles (N, 3) of vertices (V, 3)."""
    return make_mesh(
        Solid("b", "b.stl", "mm", frozen(vertices), faces, frozen(normals), (), (), ())
    )


def draw_joint_values(robot: Robot, count: int, seed: int = 0) -> np.ndarray:
    """Random joint values (count, J) within all limits."""
    rng = np.random.default_rng(seed)
    values = rng.uniform(robot.limits[:, 0], robot.limits[:, 1], (8 * count, len(robot.joints)))
    return values[are_within_limits(robot, values)][:count]


def name_collisions(scene: Scene, joints: np.ndarray) -> list[str]:
    """The pair that collides at each of the joint values (N, J), "" if none does."""
    return [name_pair(scene, k) if k >= 0 else "" for k in find_collisions(scene, joints).tolist()]


def test_a_folded_arm_collides_with_its_own_base() -> None:
    """At J2 = 150 deg the rod is from (325, 0) to (87, 137), with y = 105 at x = 143."""
    arm = make_flat_arm()
    pillar = make_bar("base", (140, 105, 390), (40, 5, 100))
    arm = replace(arm, links=(pillar, *arm.links[1:]))
    assert name_collisions(
        make_scene(arm), np.vstack([joints_at(0, a, 0, 0) for a in (0, 120, 150)])
    ) == [
        "",
        "",
        "base against link 2",
    ]


def test_touching_links_are_not_tested_and_a_pad_enlarges_both_bodies() -> None:
    arm = make_flat_arm()
    first = make_bar("link 1", (325, 0, 45), (20, 20, 100))
    arm = replace(arm, links=(arm.links[0], first, *arm.links[2:]))
    assert name_collisions(make_scene(arm), arm.home[None]) == [""]
    # The base has a wall 8.5 mm from the rod of the stretched arm.
    wall = make_bar("base", (460, 18.5 + 1, 450), (50, 1, 50))
    for pad, expected in ((4.0, ""), (4.3, "base against link 2")):
        padded = replace(arm, links=(wall, *arm.links[1:]), pad=pad)
        assert name_collisions(make_scene(padded), joints_at(0, 0, 0, 0)) == [expected]


@pytest.mark.parametrize("robot", list_robots(), ids=lambda robot: robot.name)
def test_robots_at_home_with_a_tool_on_a_short_adapter_do_not_collide(robot: Robot) -> None:
    tool = (make_bar("tool", (0, 0, 80), (20, 20, 40)),)
    assert name_collisions(make_scene(robot, tool), robot.home[None]) == [""]


def test_a_tool_directly_on_the_flange_is_not_hit_by_the_pad_of_the_wrist() -> None:
    """The flange of the IRB 2000 is 150 mm from axis 5.

    Link 5 ends 130.01 mm from axis 5, and its pad of 30 mm beyond the flange.
    """
    robot = find_robot("IRB 2000")
    assert name_collisions(
        make_scene(robot, (make_bar("tool", (0, 0, 40), (20, 20, 40)),)), robot.home[None]
    ) == [""]
    assert name_collisions(
        make_scene(robot, (make_bar("tool", (0, 0, 29), (20, 20, 50)),)), robot.home[None]
    ) == ["link 5 against tool"]


def test_a_tool_that_reaches_the_table_or_the_part_collides() -> None:
    """The flange points down; the tool is 100 mm long from z = 387 - J3."""
    tool = (make_bar("tool", (0, 0, 50), (5, 5, 50)),)
    table = (make_bar("table", (600, 0, 90), (100, 100, 10)),)
    joints = np.vstack(
        [
            joints_at(0, 0, 386.99 - 100 - 100, 0),
            joints_at(0, 0, 387.01 - 100 - 100, 0),
            joints_at(30, 0, 200, 0),
        ]
    )
    assert name_collisions(make_scene(make_flat_arm(), tool, table), joints) == [
        "",
        "tool against table",
        "",
    ]
    for part in (make_block((200, 200, 20)), (Box(translation(0, 0, 0), (100.0, 100.0, 10.0)),)):
        scene = make_scene(make_flat_arm(), tool, (), part, translation(600, 0, 90))
        assert name_collisions(scene, joints) == ["", "tool against part", ""]


def test_a_tool_that_is_wholly_inside_the_part_collides() -> None:
    tool = (make_bar("tool", (0, 0, 50), (5, 5, 5)),)
    scene = make_scene(
        make_flat_arm(), tool, (), make_block((100, 100, 100)), translation(600, 0, 337)
    )
    assert name_collisions(scene, joints_at(0, 0, 0, 0)) == ["tool against part"]


def test_of_several_colliding_pairs_the_first_in_order_is_named() -> None:
    tool = (make_bar("holder", (0, 0, 20), (5, 5, 20)), make_bar("tool", (0, 0, 70), (2, 2, 30)))
    wall = make_bar("wall", (600, 0, 300), (50, 50, 150))
    part = make_block((120, 120, 320))
    scene = make_scene(make_flat_arm(), tool, (wall,), part, translation(600, 0, 300))
    assert name_collisions(scene, joints_at(0, 0, 0, 0)) == ["link 2 against wall"]
    allowed = (("wall", "link 2"), ("wall", "tool"), ("holder", "wall"))
    scene = make_scene(
        make_flat_arm(), tool, (wall,), part, translation(600, 0, 300), Allowed(pairs=allowed)
    )
    assert name_collisions(scene, joints_at(0, 0, 0, 0)) == ["link 2 against part"]
    allowed = (*allowed, ("part", "link 2"))
    scene = make_scene(
        make_flat_arm(), tool, (wall,), part, translation(600, 0, 300), Allowed(pairs=allowed)
    )
    assert name_collisions(scene, joints_at(0, 0, 0, 0)) == ["holder against part"]


@pytest.mark.parametrize(("contact", "collides"), [(0.0, True), (0.9, True), (1.1, False)])
def test_the_tool_may_enter_the_part_by_its_contact_but_not_the_table(
    contact: float, collides: bool
) -> None:
    tool = (make_bar("tool", (0, 0, 50), (5, 5, 50)),)
    deep = joints_at(0, 0, 387 - 100 - 100 + 1, 0)
    scene = make_scene(
        make_flat_arm(),
        tool,
        (),
        make_block((200, 200, 20)),
        translation(600, 0, 90),
        Allowed(contact),
    )
    assert (find_collisions(scene, deep) >= 0).tolist() == [collides]
    table = (make_bar("table", (600, 0, 90), (100, 100, 10)),)
    assert name_collisions(
        make_scene(make_flat_arm(), tool, table, allowed=Allowed(contact)), deep
    ) == ["tool against table"]


def test_invalid_bodies_are_refused_in_one_line() -> None:
    tool = (make_bar("tool", (0, 0, 50), (0.5, 5, 50)),)
    with pytest.raises(
        JobError,
        match=r"^tool tool: it may enter the part by 0.5 mm, but is only 1 mm thick; allow ",
    ):
        make_scene(make_flat_arm(), tool, allowed=Allowed(0.5))
    with pytest.raises(
        JobError, match=r"^body tol: it may touch, but there is no such body; nearest is tool$"
    ):
        make_scene(make_flat_arm(), tool, allowed=Allowed(pairs=(("tol", "tool"),)))
    with pytest.raises(JobError, match=r"^body base: there are two of this name; rename one$"):
        make_scene(make_flat_arm(), tool, (make_bar("base", (0, 0, 0), (1, 1, 1)),))


def test_a_joint_value_that_is_nan_is_refused() -> None:
    with pytest.raises(ValueError, match="not finite"):
        find_collisions(make_scene(make_flat_arm()), joints_at(0, math.nan, 0, 0))
    with pytest.raises(ValueError, match="not finite"):
        check_motion(
            make_scene(make_flat_arm()),
            np.vstack([joints_at(0, 0, 0, 0), joints_at(0, math.nan, 0, 0)]),
            1.0,
        )


def find_corners(
    boxes: tuple[Box, ...], rotation: np.ndarray, origin: np.ndarray, pad: float
) -> list[np.ndarray]:
    """The corners (8, 3) of each box of a link, enlarged by `pad` mm, in the base frame."""
    return [
        (box.link_from_box.rotation @ (SIGNS * (np.array(box.half) + pad)).T).T @ rotation.T
        + rotation @ np.array(box.link_from_box.origin)
        + origin
        for box in boxes
    ]


def hulls_meet(a: np.ndarray, b: np.ndarray) -> bool:
    """Whether two boxes, given by their corners (8, 3), meet.

    They do if the convex hull of all differences of corners contains the origin. Its nearest point
    to the origin is found by the pairwise Frank-Wolfe method.
    """
    differences = (a[:, None] - b[None]).reshape(-1, 3)
    weights = np.zeros(len(differences))
    weights[0] = 1.0
    for _ in range(4000):
        point = weights @ differences
        distance = float(np.linalg.norm(point))
        heights = differences @ point
        best = int(heights.argmin())
        if distance < 1e-6 or heights[best] > 1e-9 * distance:
            return distance < 1e-6
        worst = int(np.where(weights > 0, heights, -np.inf).argmax())
        step = differences[best] - differences[worst]
        fraction = min(max(float(-(point @ step) / (step @ step)), 0.0), weights[worst])
        weights[best] += fraction
        weights[worst] -= fraction
    raise AssertionError("undecided")


def test_collisions_agree_with_an_independent_test_of_all_pairs() -> None:
    """An IRB 1200 with a tool, a pillar and a box as the part; the test lists the pairs itself."""
    robot = find_robot("IRB 1200")
    tool = (make_bar("tool", (0, 0, 70), (15, 25, 50), 30),)
    pillar = make_bar("pillar", (450, -350, 300), (60, 60, 300), 20)
    part = Box(translation(0, 0, 0), (80.0, 60.0, 40.0))
    base_from_part = Pose(rotation_about(1, 0.3), (500.0, 100.0, 250.0))
    box_scene = make_scene(robot, tool, (pillar,), (part,), base_from_part)
    mesh_scene = make_scene(robot, tool, (pillar,), make_block((160, 120, 80)), base_from_part)
    joints = draw_joint_values(robot, 120)
    expected = []
    for row in joints:
        rotations, origins = (array[0] for array in compute_link_frames(robot, row[None]))
        links, unpadded = [], []
        for link, link_rotation, link_origin in zip(robot.links, rotations, origins, strict=True):
            links.append(find_corners(link.boxes, link_rotation, link_origin, 5.0))
            unpadded.append(find_corners(link.boxes, link_rotation, link_origin, 0.0))
        rotation, origin = (array[0] for array in compute_flange(robot, row[None]))
        tool_corners = find_corners(tool[0].boxes, rotation, origin, 0.0)
        pillar_corners = find_corners(pillar.boxes, np.eye(3), np.zeros(3), 0.0)
        part_corners = find_corners(
            (part,), base_from_part.rotation, np.array(base_from_part.origin), 0.0
        )
        pairs = []
        for i, j in itertools.combinations(range(7), 2):
            if j > i + 1 and (i, j) != (4, 6):
                pairs.append((links[i], links[j]))
        pairs += [((unpadded if i in (4, 5) else links)[i], tool_corners) for i in range(6)]
        moving = [*links[1:], tool_corners]
        pairs += itertools.product(moving, (pillar_corners, part_corners))
        boxes = itertools.chain.from_iterable(itertools.product(*pair) for pair in pairs)
        expected.append(any(hulls_meet(a, b) for a, b in boxes if do_bounds_meet(a, b)))
    assert 20 < sum(expected) < 90
    assert (find_collisions(box_scene, joints) >= 0).tolist() == expected
    assert (find_collisions(mesh_scene, joints) >= 0).tolist() == expected


def do_bounds_meet(a: np.ndarray, b: np.ndarray) -> bool:
    """Whether the bounding boxes of two sets of points meet."""
    return bool(((a.min(axis=0) <= b.max(axis=0)) & (b.min(axis=0) <= a.max(axis=0))).all())


def test_the_clearance_is_the_shortest_distance_of_all_pairs() -> None:
    """The tool is 30 mm above the table and 12 mm from the part.

    Rolled by 45 deg, its edge points at the part and is nearer by 5 (sqrt 2 - 1) mm.
    """
    tool = (make_bar("tool", (0, 0, 50), (5, 5, 50)),)
    table = (make_bar("table", (600, 0, 247), (150, 150, 10)),)
    for part in (make_block((50, 50, 50)), (Box(translation(0, 0, 0), (25.0, 25.0, 25.0)),)):
        scene = make_scene(
            make_flat_arm(), tool, table, part, translation(600 + 25 + 5 + 12, 0, 320)
        )
        joints = np.vstack([joints_at(0, 0, 0, 0), joints_at(0, 0, 0, 45), joints_at(0, 0, 31, 0)])
        edge_on = 17 - 5 * math.sqrt(2)
        assert measure_clearance(scene, joints, 50.0) == pytest.approx([12, edge_on, 0], abs=1e-5)
        assert measure_clearance(scene, joints, 11.0) == pytest.approx([11, edge_on, 0], abs=1e-5)
        owner = np.zeros(2, dtype=np.int64)
        nearest = find_nearest_pairs(scene, joints[:2], owner, np.array([50.0]))
        assert nearest.distance.tolist() == pytest.approx([edge_on], abs=1e-5)
        assert measure_clearance(scene, joints_at(90, 0, 0, 0), 50.0).tolist() == [50.0]
        # The nearest pair there is the tool and the rod, 53 mm above it.
        assert measure_clearance(scene, joints_at(90, 0, 0, 0), 60.0) == pytest.approx(
            [53], abs=1e-5
        )


def make_swept_scene(wall: Link, tool: Link) -> Scene:
    return make_scene(make_flat_arm(), (tool,), (wall,))


def test_a_thin_wall_between_two_free_rows_is_found() -> None:
    """The tool at radius 600 swings from 0 to 90 deg; a plate of 0.2 mm is across at 45 deg.

    The flank of the tool, 5 mm ahead of its middle, meets the plate near 45 deg - 5.1 / 600 rad.
    """
    tool = make_bar("tool", (0, 0, 50), (5, 5, 50))
    plate = make_bar("wall", (424.3, 424.3, 300), (50, 0.1, 100), 45)
    rows = np.vstack([joints_at(0, 0, 0, 0), joints_at(90, 0, 0, 0)])
    thin_block = make_block((100, 0.2, 200))
    base_from_block = Pose(rotation_about(2, math.radians(45)), (424.3, 424.3, 300.0))
    for scene in (
        make_swept_scene(plate, tool),
        make_scene(make_flat_arm(), (tool,), (), thin_block, base_from_block),
    ):
        assert (find_collisions(scene, rows) < 0).all()
        for step in (0.5, 5.0):
            course = check_motion(scene, rows, step)
            assert name_pair(scene, course.pair).startswith("tool against")
            assert course.at * math.pi / 2 == pytest.approx(
                math.pi / 4 - 5.1 / 600, abs=(step + 0.2) / 600
            )
            assert course.clearance == 0.0
        dense = np.linspace(rows[0], rows[1], 91)
        assert check_motion(scene, dense, 0.5).at / 90 == pytest.approx(
            0.5 - 5.1 / 600 * 2 / math.pi, abs=1e-3
        )


def test_a_free_motion_reports_its_clearance_and_where_it_is_nearest() -> None:
    """The outer edge of the tool runs at radius 605 mm, its corners 0.02 mm farther out.

    The wall begins at 610 mm.
    """
    wall = make_bar("wall", (660 * math.sqrt(0.5), 660 * math.sqrt(0.5), 300), (50, 5, 100), 45)
    scene = make_swept_scene(wall, make_bar("tool", (0, 0, 50), (5, 5, 50)))
    rows = np.vstack([joints_at(0, 0, 0, 0), joints_at(90, 0, 0, 0)])
    for step in (0.2, 2.0):
        course = check_motion(scene, rows, step, near=20.0)
        assert (course.pair, math.isnan(course.at)) == (-1, True)
        assert 5 - 0.1 - 1e-6 <= course.clearance <= 5 + step
        # An edge is nearest where its radius is perpendicular to the wall, within 5 mm of 45 deg.
        assert scene.pairs[course.nearest] == ("tool", "wall")
        assert course.nearest_at == pytest.approx(0.5, abs=(5 + step) / 600)
    far = check_motion(scene, rows, 1.0, near=3.0)
    assert (far.clearance, far.nearest, math.isnan(far.nearest_at)) == (3.0, -1, True)
    assert check_motion(scene, rows, 1.0).clearance == 0.0


def test_a_motion_of_one_row_or_of_equal_rows_is_tested() -> None:
    tool, wall = (
        make_bar("tool", (0, 0, 50), (5, 5, 50)),
        make_bar("wall", (600, 0, 300), (5, 5, 100)),
    )
    for rows in (joints_at(0, 0, 0, 0), np.vstack([joints_at(0, 0, 0, 0)] * 3)):
        assert (
            name_pair(
                make_swept_scene(wall, tool),
                check_motion(make_swept_scene(wall, tool), rows, 1.0).pair,
            )
            == "tool against wall"
        )
        assert check_motion(make_scene(make_flat_arm(), (tool,)), rows, 1.0).pair == -1


@pytest.mark.parametrize("name", ["IRB 2400", "VS-060", "COBOTTA", "Cobra s600", "3-axis mill"])
def test_no_point_moves_farther_than_the_bound(name: str) -> None:
    """Every corner of a box is followed in 100 steps of each motion.

    For short motions the bound is at most three times as large as the distance.
    """
    robot = find_robot(name)
    scene = make_scene(
        robot,
        (make_bar("tool", (10, 0, 120), (10, 20, 60)),),
        (make_bar("table", (0, 0, -500), (9, 9, 9)),),
    )
    for fraction, factor in ((0.3, math.inf), (0.004, 3.0)):
        for pair in draw_joint_values(robot, 20).reshape(10, 2, -1):
            rows = np.array([pair[0], pair[0] + (pair[1] - pair[0]) * fraction])
            placed = place_boxes(scene, np.linspace(rows[0], rows[1], 101))
            corners = placed.centres[..., None, :] + (
                SIGNS * scene.half[:, None]
            ) @ placed.axes.transpose(0, 1, 3, 2)
            distances = np.linalg.norm(np.diff(corners, axis=0), axis=-1).sum(axis=0).max(axis=1)
            bound = measure_moves([scene], rows)[0][0]
            assert (distances <= bound + 1e-9).all()
            assert (bound[distances > 0.1] <= factor * distances[distances > 0.1]).all()


def test_a_swept_motion_agrees_with_fine_samples() -> None:
    """A random motion is not free if one of 400 samples collides by more than the step, 2 mm."""
    robot = find_robot("IRB 120")
    tool = (make_bar("tool", (0, 0, 60), (10, 10, 60)),)
    beam = make_bar("beam", (250, 0, 700), (20, 300, 3))
    scene = make_scene(robot, tool, (beam,), make_block((150, 150, 80)), translation(350, 0, 100))
    joints = draw_joint_values(robot, 80, 3)
    free = joints[find_collisions(scene, joints) < 0]
    verdicts = []
    for rows in zip(free[:-1:2], free[1::2], strict=False):
        course = check_motion(scene, np.array(rows), 2.0)
        samples = np.linspace(*rows, 400)
        deep = np.flatnonzero(find_collisions(scene, samples, -2.0) >= 0)
        shallow = find_collisions(scene, samples) >= 0
        verdicts.append(course.pair >= 0)
        assert course.pair >= 0 or not len(deep)
        if course.pair >= 0:
            assert (
                find_collisions(scene, rows[0][None] + (rows[1] - rows[0])[None] * course.at)[0]
                == course.pair
            )
            assert not len(deep) or course.at <= deep[0] / 399 + 1e-12
            assert course.at <= 1
        else:
            assert shallow.sum() < 20
    assert 5 < sum(verdicts) < len(verdicts) - 3


def test_a_long_motion_is_tested_only_up_to_its_first_collision(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Motions pass a wire and a thick wall from either side; a test without the shortcut agrees."""
    scene = make_scene(make_flat_arm(), obstacles=WIRE_AND_WALL)
    rng = np.random.default_rng(11)
    motions = []
    for start, end in rng.uniform(-60, 60, (40, 2, 2)).tolist():
        motions.append(np.vstack([joints_at(*start, 0, 0), joints_at(*end, 0, 0)]))
    shortened = check_motions(scene, motions, 0.5, 3.0)
    monkeypatch.setattr(motion_module, "_LONG", math.inf)
    complete = check_motions(scene, motions, 0.5, 3.0)
    assert list(map(repr, shortened)) == list(map(repr, complete))
    collisions = [name_pair(scene, check.pair) for check in complete if check.hit]
    assert 5 < len(collisions) < 35
    assert {name.rpartition(" ")[2] for name in collisions} == {"wire", "wall"}


def test_a_wire_before_a_wall_is_the_first_collision_of_a_motion_through_both() -> None:
    """The collision is found at most one step, 0.5 mm, after the first sample that collides."""
    scene = make_scene(make_flat_arm(), obstacles=WIRE_AND_WALL)
    waypoints = np.vstack([joints_at(0, -30, 0, 0), joints_at(0, 40, 0, 0)])
    check = check_motion(scene, waypoints, 0.5)
    assert name_pair(scene, check.pair).endswith("wire")
    samples = np.linspace(*waypoints, 20_001)
    first = np.flatnonzero(find_collisions(scene, samples) >= 0)[0] / 20_000
    assert first <= check.at <= first + 0.5 / 275 / math.radians(70)


def test_enlarged_bodies_collide_wherever_the_bodies_do() -> None:
    robot = find_robot("VS-6556")
    scene = make_scene(
        robot,
        (make_bar("tool", (0, 0, 60), (10, 10, 60)),),
        (),
        make_block((150, 150, 80)),
        translation(350, 0, 300),
    )
    joints = draw_joint_values(robot, 300)
    collides = [find_collisions(scene, joints, growth) >= 0 for growth in (0.0, 3.0, 30.0)]
    assert (collides[0] <= collides[1]).all()
    assert (collides[1] <= collides[2]).all()
    assert collides[0].sum() < collides[2].sum()


def test_boxes_are_placed_with_their_links() -> None:
    scene = make_scene(
        make_flat_arm(),
        (make_bar("tool", (0, 0, 50), (5, 5, 50)),),
        (make_bar("table", (9, 8, 7), (1, 2, 3)),),
    )
    placed = place_boxes(scene, joints_at(0, 90, 10, 0))
    assert isinstance(placed, Boxes)
    centres = {tuple(np.round(centre, 6).tolist()) for centre in placed.centres[0]}
    assert centres == {(325.0, 137.5, 450.0), (325.0, 275.0, 387.0 - 10 - 50), (9.0, 8.0, 7.0)}


@pytest.mark.parametrize("name", ["IRB 2400", "COBOTTA", "Cobra s600", "3-axis mill"])
def test_no_box_comes_nearer_to_another_than_the_bound(name: str) -> None:
    """The corners of one box of each pair are followed in 100 steps of a motion.

    Their distances are measured in the frame of the link of the other box.
    """
    robot = find_robot(name)
    scene = make_scene(
        robot,
        (make_bar("tool", (10, 0, 120), (10, 20, 60)),),
        (make_bar("table", (0, 0, -500), (9, 9, 9)),),
    )
    first, second = scene.first, scene.second
    swapped = scene.frame[first] > scene.frame[second]
    nearer, farther = np.where(swapped, second, first), np.where(swapped, first, second)
    moves = 0
    for pair in draw_joint_values(robot, 20).reshape(10, 2, -1):
        fine = np.linspace(pair[0], pair[0] + (pair[1] - pair[0]) * 0.2, 101)
        rotations, origins = compute_link_frames(robot, fine)
        placed = place_boxes(scene, fine)
        corners = placed.centres[..., None, :] + (
            SIGNS * scene.half[:, None]
        ) @ placed.axes.transpose(0, 1, 3, 2)
        link = scene.frame[nearer]
        seen = (corners[:, farther] - origins[:, link][:, :, None]) @ rotations[:, link]
        distances = np.linalg.norm(np.diff(seen, axis=0), axis=-1).sum(axis=0).max(axis=1)
        serial = np.abs(np.diff(fine @ robot.coupling.T, axis=0)).sum(axis=0)
        bound = serial @ bound_closing(scene, np.abs(fine @ robot.coupling.T).max(axis=0))
        assert (distances <= bound + 1e-9).all()
        moves += int((distances > 1).sum())
    assert moves > 50


def test_a_scene_divided_by_pairs_collides_where_the_whole_does() -> None:
    robot = find_robot("VS-6556")
    tools = (
        make_bar("tool", (0, 0, 60), (10, 10, 60)),
        make_bar("holder", (0, 0, 20), (40, 40, 20)),
    )
    table = make_bar("table", (350, 0, 60), (200, 200, 9))
    scene = make_scene(robot, tools, (table,), make_block((150, 150, 80)), translation(350, 0, 300))
    tool_pairs = [k for k, pair in enumerate(scene.pairs) if "tool" in pair]
    other_pairs = [k for k in range(len(scene.pairs)) if k not in tool_pairs]
    joints = draw_joint_values(robot, 300)
    whole = name_collisions(scene, joints)
    parts = [select_pairs(scene, pairs) for pairs in (tool_pairs, other_pairs)]
    names = [name_collisions(part, joints) for part in parts]
    assert [name == "" for name in whole] == [a == b == "" for a, b in zip(*names, strict=True)]
    assert all(name in (a, b) for name, a, b in zip(whole, *names, strict=True))
    assert all(any(part_names) for part_names in names)
    assert len(parts[0].frame) < len(scene.frame)
    nothing = select_pairs(scene, [])
    assert (find_collisions(nothing, joints) == -1).all()
    assert check_motion(nothing, joints[:2], 2.0, 5.0).clearance == 5.0


def test_the_tool_may_enter_the_part_and_its_holder_may_not() -> None:
    """The tool and a holder next to it both end at z = 387 - 100 - 100, 1 mm inside a plate."""
    tool, holder = (
        make_bar("tool", (0, 0, 50), (5, 5, 50)),
        make_bar("holder", (0, 30, 50), (5, 5, 50)),
    )
    plate = make_block((100, 100, 20))
    for tools, pair in (((tool,), ""), ((tool, holder), "holder against part")):
        scene = make_scene(
            make_flat_arm(), tools, (), plate, translation(600, 0, 178), Allowed(2.0)
        )
        assert name_collisions(scene, joints_at(0, 0, 100, 0)) == [pair]
    assert name_collisions(
        make_scene(make_flat_arm(), (tool,), (), plate, translation(600, 0, 178)),
        joints_at(0, 0, 100, 0),
    ) == ["tool against part"]


def test_a_mesh_is_closed_only_if_its_triangles_bound_a_body() -> None:
    """A cube without its two faces across x is open, and rays along x alone would not hit it."""
    cube = trimesh.creation.box((40, 40, 40))
    is_side = np.abs(cube.face_normals[:, 0]) < 0.5
    for faces, closed in (
        (cube.faces, True),
        (cube.faces[is_side], False),
        (cube.faces[:, ::-1], True),
    ):
        normals = np.zeros((len(faces), 3))
        mesh = mesh_of_triangles(cube.vertices, np.asarray(faces, np.int64), normals)
        assert mesh.closed == closed
        points = np.array([[3.0, 4.0, 5.0], [30.0, 0.0, 0.0], [3.0, 4.0, 25.0]])
        assert are_inside(mesh, points).tolist() == [True, False, False]
    vertices = cube.vertices[cube.faces].reshape(-1, 3)
    triangles = np.arange(len(vertices)).reshape(-1, 3)
    mesh = mesh_of_triangles(vertices, triangles, cube.face_normals)
    assert not mesh.closed
    assert are_inside(mesh, np.array([[3.0, 4.0, 5.0]])).tolist() == [True]


def make_two_bars() -> Scene:
    """A flat arm with a bar from axis 1 to x = 600 as its first link and a rod as its second."""
    arm = make_flat_arm()
    bars = (
        arm.links[0],
        make_bar("link 1", (300, 0, 0), (300, 1, 1)),
        make_bar("link 2", (137.5, 0, 0), (137.5, 1, 1)),
    )
    return make_scene(replace(arm, links=(*bars, *arm.links[3:]), touching=()))


def test_a_motion_of_both_bodies_together_brings_them_no_closer() -> None:
    scene = make_two_bars()
    pair_scene = select_pairs(scene, [scene.pairs.index(("link 1", "link 2"))])
    turned, still = joints_at(20, 30, 10, 0), joints_at(0, 30, 10, 0)
    assert measure_apart(pair_scene, still, turned) > 2 * 590 * math.sin(math.radians(10))
    assert measure_closer(pair_scene, still, turned) == pytest.approx([0.0], abs=1e-9)


def test_two_bodies_that_rotate_in_opposite_directions_come_closer() -> None:
    """The first link rotates by 0.1 deg, and the second one by 0.4 deg back.

    The end of the first link is 600 mm from axis 1 and moves by 600 x 0.1 deg. The end of the
    second is 275 mm from axis 2 and moves by 275 x 0.4 deg in the frame of the first.
    """
    scene = make_two_bars()
    pair_scene = select_pairs(scene, [scene.pairs.index(("link 1", "link 2"))])
    first, second = joints_at(0, 10, 0, 0), joints_at(0.1, 9.6, 0, 0)
    apart_mm = float(measure_apart(pair_scene, first, second)[0])
    closer_mm = float(measure_closer(pair_scene, first, second)[0])
    assert apart_mm == pytest.approx(600 * math.radians(0.1), rel=0.01)
    assert closer_mm == pytest.approx(275 * math.radians(0.4), rel=0.02)
    assert closer_mm > 1.8 * apart_mm


@pytest.mark.parametrize("name", ["IRB 120", "IRB 2400", "Cobra s600", "VS-6577"])
def test_no_two_bodies_come_closer_than_the_bound(name: str) -> None:
    arm = find_robot(name)
    tool = Link("tool", (Box(translation(0, 0, 80), (30, 20, 80)),))
    table = Link("table", (Box(translation(300, 0, -200), (500, 500, 50)),))
    scene = make_scene(arm, (tool,), (table,), (Box(translation(300, 0, -100), (50, 50, 50)),))
    rng = np.random.default_rng(1)
    first = draw_joint_values(arm, 400)
    second = first + rng.normal(0, 0.01, first.shape)
    for k in range(len(scene.pairs)):
        pair_scene = select_pairs(scene, [k])
        # 2000 mm is more than any two bodies of a pair can be apart.
        clearances = [measure_clearance(pair_scene, joints, 2000.0) for joints in (first, second)]
        is_clear = clearances[0] > 0
        assert (clearances[0] - clearances[1] <= measure_closer(pair_scene, first, second) + 1e-6)[
            is_clear
        ].all()
