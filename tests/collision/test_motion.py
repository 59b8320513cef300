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


def bar(
    name: str, at: tuple[float, float, float], half: tuple[float, float, float], turn: float = 0.0
) -> Link:
    """One box, turned about z by degrees."""
    return Link(name, (Box(Pose(rotation_about(2, math.radians(turn)), at), half),))


def rods() -> Robot:
    """A flat arm: axis 1 at the origin, axis 2 at x = 325, its flange at x = 600 and z = 387 - J3; a rod of 20 mm as
    its second arm, at z = 440 to 460, and nothing else.
    """
    names = [link.name for link in find_robot("Cobra s600").links]
    second = bar("link 2", (137.5, 0, 108), (137.5, 10, 10))
    links = tuple(second if name == "link 2" else Link(name, ()) for name in names)
    return replace(find_robot("Cobra s600"), links=links, pad=0.0)


def at(*values: float) -> np.ndarray:
    """J1, J2 and J4 in degrees, J3 in mm."""
    return np.array(
        [[math.radians(values[0]), math.radians(values[1]), values[2], math.radians(values[3])]]
    )


def block(size: tuple[float, float, float]) -> Mesh:
    made = trimesh.creation.box(size)
    faces = np.asarray(made.faces, dtype=np.int64)
    return make_mesh(
        Solid(
            "b", "b.stl", "mm", frozen(made.vertices), faces, frozen(made.face_normals), (), (), ()
        )
    )


def some(of: Robot, count: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    values = rng.uniform(of.limits[:, 0], of.limits[:, 1], (8 * count, len(of.joints)))
    return values[are_within_limits(of, values)][:count]


def name_of(tested: Scene, joints: np.ndarray) -> list[str]:
    return [
        name_pair(tested, k) if k >= 0 else "" for k in find_collisions(tested, joints).tolist()
    ]


def test_a_folded_arm_meets_its_own_base() -> None:
    """At J2 = 150 deg the second arm runs from (325, 0) to (87, 137), through y = 105 at x = 143."""
    arm = rods()
    pillar = bar("base", (140, 105, 390), (40, 5, 100))
    arm = replace(arm, links=(pillar, *arm.links[1:]))
    assert name_of(make_scene(arm), np.vstack([at(0, a, 0, 0) for a in (0, 120, 150)])) == [
        "",
        "",
        "base against link 2",
    ]


def test_links_that_touch_anyway_are_left_out_and_a_pad_counts_on_both() -> None:
    arm = rods()
    first = bar("link 1", (325, 0, 45), (20, 20, 100))
    arm = replace(arm, links=(arm.links[0], first, *arm.links[2:]))
    assert name_of(make_scene(arm), arm.home[None]) == [""]
    # Axis 1 bears a wall 8.5 mm beside the second arm, which stands straight out.
    wall = bar("base", (460, 18.5 + 1, 450), (50, 1, 50))
    for pad, expected in ((4.0, ""), (4.3, "base against link 2")):
        padded = replace(arm, links=(wall, *arm.links[1:]), pad=pad)
        assert name_of(make_scene(padded), at(0, 0, 0, 0)) == [expected]


@pytest.mark.parametrize("of", list_robots(), ids=lambda of: of.name)
def test_robots_are_free_at_home_and_with_a_tool_on_a_short_adapter(of: Robot) -> None:
    tool = (bar("tool", (0, 0, 80), (20, 20, 40)),)
    assert name_of(make_scene(of, tool), of.home[None]) == [""]


def test_a_tool_right_on_the_flange_is_not_hit_by_the_pad_of_the_wrist() -> None:
    """IRB 2000: its flange is 150 mm from axis 5, link 5 ends at 130.01 mm, and the pad is 30 mm."""
    of = find_robot("IRB 2000")
    assert name_of(make_scene(of, (bar("tool", (0, 0, 40), (20, 20, 40)),)), of.home[None]) == [""]
    assert name_of(make_scene(of, (bar("tool", (0, 0, 29), (20, 20, 50)),)), of.home[None]) == [
        "link 5 against tool"
    ]


def test_the_tool_meets_the_table_and_the_part_where_it_reaches_them() -> None:
    """The flange looks down; the tool is 100 mm long from z = 387 - J3."""
    tool = (bar("tool", (0, 0, 50), (5, 5, 50)),)
    table = (bar("table", (600, 0, 90), (100, 100, 10)),)
    joints = np.vstack(
        [at(0, 0, 386.99 - 100 - 100, 0), at(0, 0, 387.01 - 100 - 100, 0), at(30, 0, 200, 0)]
    )
    assert name_of(make_scene(rods(), tool, table), joints) == ["", "tool against table", ""]
    for part in (block((200, 200, 20)), (Box(translation(0, 0, 0), (100.0, 100.0, 10.0)),)):
        tested = make_scene(rods(), tool, (), part, translation(600, 0, 90))
        assert name_of(tested, joints) == ["", "tool against part", ""]


def test_a_tool_wholly_within_the_part_is_found() -> None:
    tool = (bar("tool", (0, 0, 50), (5, 5, 5)),)
    tested = make_scene(rods(), tool, (), block((100, 100, 100)), translation(600, 0, 337))
    assert name_of(tested, at(0, 0, 0, 0)) == ["tool against part"]


def test_the_first_pair_in_order_is_named_whatever_else_is_hit() -> None:
    tool = (bar("holder", (0, 0, 20), (5, 5, 20)), bar("tool", (0, 0, 70), (2, 2, 30)))
    wall = bar("wall", (600, 0, 300), (50, 50, 150))
    part = block((120, 120, 320))
    tested = make_scene(rods(), tool, (wall,), part, translation(600, 0, 300))
    assert name_of(tested, at(0, 0, 0, 0)) == ["link 2 against wall"]
    allowed = (("wall", "link 2"), ("wall", "tool"), ("holder", "wall"))
    tested = make_scene(
        rods(), tool, (wall,), part, translation(600, 0, 300), Allowed(pairs=allowed)
    )
    assert name_of(tested, at(0, 0, 0, 0)) == ["link 2 against part"]
    tested = make_scene(
        rods(),
        tool,
        (wall,),
        part,
        translation(600, 0, 300),
        Allowed(pairs=(*allowed, ("part", "link 2"))),
    )
    assert name_of(tested, at(0, 0, 0, 0)) == ["holder against part"]


@pytest.mark.parametrize(("contact", "met"), [(0.0, True), (0.9, True), (1.1, False)])
def test_the_tool_may_enter_the_part_by_its_contact_and_nothing_else(
    contact: float, met: bool
) -> None:
    tool = (bar("tool", (0, 0, 50), (5, 5, 50)),)
    deep = at(0, 0, 387 - 100 - 100 + 1, 0)
    tested = make_scene(
        rods(), tool, (), block((200, 200, 20)), translation(600, 0, 90), Allowed(contact)
    )
    assert (find_collisions(tested, deep) >= 0).tolist() == [met]
    table = (bar("table", (600, 0, 90), (100, 100, 10)),)
    assert name_of(make_scene(rods(), tool, table, allowed=Allowed(contact)), deep) == [
        "tool against table"
    ]


def test_bodies_that_cannot_be_meant_are_refused_in_one_line() -> None:
    tool = (bar("tool", (0, 0, 50), (0.5, 5, 50)),)
    with pytest.raises(
        JobError,
        match=r"^tool tool: it may enter the part by 0.5 mm, but is only 1 mm thick; allow ",
    ):
        make_scene(rods(), tool, allowed=Allowed(0.5))
    with pytest.raises(
        JobError, match=r"^body tol: it may touch, but there is no such body; nearest is tool$"
    ):
        make_scene(rods(), tool, allowed=Allowed(pairs=(("tol", "tool"),)))
    with pytest.raises(JobError, match=r"^body base: there are two of this name; rename one$"):
        make_scene(rods(), tool, (bar("base", (0, 0, 0), (1, 1, 1)),))


def test_a_joint_that_is_not_a_number_is_never_free() -> None:
    with pytest.raises(ValueError, match="not finite"):
        find_collisions(make_scene(rods()), at(0, math.nan, 0, 0))
    with pytest.raises(ValueError, match="not finite"):
        check_motion(make_scene(rods()), np.vstack([at(0, 0, 0, 0), at(0, math.nan, 0, 0)]), 1.0)


def corners_of(
    boxes: tuple[Box, ...], rotation: np.ndarray, origin: np.ndarray, by: float
) -> list[np.ndarray]:
    return [
        (box.link_from_box.rotation @ (SIGNS * (np.array(box.half) + by)).T).T @ rotation.T
        + rotation @ np.array(box.link_from_box.origin)
        + origin
        for box in boxes
    ]


def hulls_meet(a: np.ndarray, b: np.ndarray) -> bool:
    """Whether two boxes given by their corners meet: by the nearest point to the origin of the set of differences,
    walked to from corner to corner (Frank and Wolfe, with steps to the best of the pair).
    """
    differences = (a[:, None] - b[None]).reshape(-1, 3)
    weights = np.zeros(len(differences))
    weights[0] = 1.0
    for _ in range(4000):
        point = weights @ differences
        size = float(np.linalg.norm(point))
        along = differences @ point
        best = int(along.argmin())
        if size < 1e-6 or along[best] > 1e-9 * size:
            return size < 1e-6
        worst = int(np.where(weights > 0, along, -np.inf).argmax())
        way = differences[best] - differences[worst]
        share = min(max(float(-(point @ way) / (way @ way)), 0.0), weights[worst])
        weights[best] += share
        weights[worst] -= share
    raise AssertionError("undecided")


def test_verdicts_are_those_of_all_pairs_of_hulls() -> None:
    """IRB 1200 with a tool, beside a pillar and a box as the part; whose pairs are written down here once more."""
    of = find_robot("IRB 1200")
    tool = (bar("tool", (0, 0, 70), (15, 25, 50), 30),)
    pillar, part = (
        bar("pillar", (450, -350, 300), (60, 60, 300), 20),
        Box(translation(0, 0, 0), (80.0, 60.0, 40.0)),
    )
    base_from_part = Pose(rotation_about(1, 0.3), (500.0, 100.0, 250.0))
    of_boxes = make_scene(of, tool, (pillar,), (part,), base_from_part)
    of_mesh = make_scene(of, tool, (pillar,), block((160, 120, 80)), base_from_part)
    joints = some(of, 120)
    expected = []
    for row in joints:
        rotations, origins = (array[0] for array in compute_link_frames(of, row[None]))
        links = [
            corners_of(k.boxes, r, o, 5.0)
            for k, r, o in zip(of.links, rotations, origins, strict=True)
        ]
        bare = [
            corners_of(k.boxes, r, o, 0.0)
            for k, r, o in zip(of.links, rotations, origins, strict=True)
        ]
        turn, tip = (array[0] for array in compute_flange(of, row[None]))
        held = corners_of(tool[0].boxes, turn, tip, 0.0)
        standing = corners_of(pillar.boxes, np.eye(3), np.zeros(3), 0.0)
        target = corners_of((part,), base_from_part.rotation, np.array(base_from_part.origin), 0.0)
        pairs = [
            (links[i], links[j])
            for i, j in itertools.combinations(range(7), 2)
            if j > i + 1 and (i, j) != (4, 6)
        ]
        pairs += [((bare if i in (4, 5) else links)[i], held) for i in range(6)]
        pairs += [(body, other) for other in (standing, target) for body in [*links[1:], held]]
        expected.append(
            any(hulls_meet(a, b) for one, two in pairs for a in one for b in two if close(a, b))
        )
    assert 20 < sum(expected) < 90
    assert (find_collisions(of_boxes, joints) >= 0).tolist() == expected
    assert (find_collisions(of_mesh, joints) >= 0).tolist() == expected


def close(a: np.ndarray, b: np.ndarray) -> bool:
    return bool(((a.min(axis=0) <= b.max(axis=0)) & (b.min(axis=0) <= a.max(axis=0))).all())


def test_the_clearance_is_the_least_gap() -> None:
    """Above the table by 30 mm, beside the part by 12, or by 7 / sqrt 2 where the tool's edge points to it."""
    tool = (bar("tool", (0, 0, 50), (5, 5, 50)),)
    table = (bar("table", (600, 0, 247), (150, 150, 10)),)
    for part in (block((50, 50, 50)), (Box(translation(0, 0, 0), (25.0, 25.0, 25.0)),)):
        tested = make_scene(rods(), tool, table, part, translation(600 + 25 + 5 + 12, 0, 320))
        joints = np.vstack([at(0, 0, 0, 0), at(0, 0, 0, 45), at(0, 0, 31, 0)])
        edge_on = 17 - 5 * math.sqrt(2)
        assert measure_clearance(tested, joints, 50.0) == pytest.approx([12, edge_on, 0], abs=1e-5)
        assert measure_clearance(tested, joints, 11.0) == pytest.approx([11, edge_on, 0], abs=1e-5)
        owner = np.zeros(2, dtype=np.int64)
        (nearest,) = find_nearest_pairs(tested, joints[:2], owner, np.array([50.0]))
        assert nearest.distance == pytest.approx(edge_on, abs=1e-5)
        assert measure_clearance(tested, at(90, 0, 0, 0), 50.0).tolist() == [50.0]
        # Farther than all else, the tool is 53 mm below the second arm.
        assert measure_clearance(tested, at(90, 0, 0, 0), 60.0) == pytest.approx([53], abs=1e-5)


def sweep(wall: Link, tool: Link) -> Scene:
    return make_scene(rods(), (tool,), (wall,))


def test_a_thin_wall_between_two_free_rows_is_not_skipped() -> None:
    """The tool at radius 600 swings from 0 to 90 deg; a plate of 0.2 mm stands across its way at 45 deg. Tool and plate
    meet where the tool's flank, 5 mm ahead of its middle, arrives: near 45 deg - 5.1 / 600 rad.
    """
    tool, plate = (
        bar("tool", (0, 0, 50), (5, 5, 50)),
        bar("wall", (424.3, 424.3, 300), (50, 0.1, 100), 45),
    )
    rows = np.vstack([at(0, 0, 0, 0), at(90, 0, 0, 0)])
    thin, placed = (
        block((100, 0.2, 200)),
        Pose(rotation_about(2, math.radians(45)), (424.3, 424.3, 300.0)),
    )
    for tested in (sweep(plate, tool), make_scene(rods(), (tool,), (), thin, placed)):
        assert (find_collisions(tested, rows) < 0).all()
        for step in (0.5, 5.0):
            course = check_motion(tested, rows, step)
            assert name_pair(tested, course.pair).startswith("tool against")
            assert course.at * math.pi / 2 == pytest.approx(
                math.pi / 4 - 5.1 / 600, abs=(step + 0.2) / 600
            )
            assert course.clearance == 0.0
        dense = np.linspace(rows[0], rows[1], 91)
        assert check_motion(tested, dense, 0.5).at / 90 == pytest.approx(
            0.5 - 5.1 / 600 * 2 / math.pi, abs=1e-3
        )


def test_a_motion_that_passes_says_how_close_it_came() -> None:
    """The tool's outer edge runs on a circle of radius 605 (its corners 0.02 mm beyond); the wall begins at 610."""
    wall = bar("wall", (660 * math.sqrt(0.5), 660 * math.sqrt(0.5), 300), (50, 5, 100), 45)
    tested = sweep(wall, bar("tool", (0, 0, 50), (5, 5, 50)))
    rows = np.vstack([at(0, 0, 0, 0), at(90, 0, 0, 0)])
    for step in (0.2, 2.0):
        course = check_motion(tested, rows, step, near=20.0)
        assert (course.pair, math.isnan(course.at)) == (-1, True)
        assert 5 - 0.1 - 1e-6 <= course.clearance <= 5 + step
        # An edge is nearest where it is square to the wall: at 45 deg but for what it lies off the middle.
        assert tested.pairs[course.nearest] == ("tool", "wall")
        assert course.nearest_at == pytest.approx(0.5, abs=(5 + step) / 600)
    far = check_motion(tested, rows, 1.0, near=3.0)
    assert (far.clearance, far.nearest, math.isnan(far.nearest_at)) == (3.0, -1, True)
    assert check_motion(tested, rows, 1.0).clearance == 0.0


def test_one_row_and_rows_that_repeat_are_motions_too() -> None:
    tool, wall = bar("tool", (0, 0, 50), (5, 5, 50)), bar("wall", (600, 0, 300), (5, 5, 100))
    for rows in (at(0, 0, 0, 0), np.vstack([at(0, 0, 0, 0)] * 3)):
        assert (
            name_pair(sweep(wall, tool), check_motion(sweep(wall, tool), rows, 1.0).pair)
            == "tool against wall"
        )
        assert check_motion(make_scene(rods(), (tool,)), rows, 1.0).pair == -1


@pytest.mark.parametrize("name", ["IRB 2400", "VS-060", "COBOTTA", "Cobra s600", "3-axis mill"])
def test_no_point_moves_farther_than_the_bound(name: str) -> None:
    """Ways of all corners of all boxes, added up over 100 parts of each stretch; near rows, the bound is not loose."""
    of = find_robot(name)
    tested = make_scene(
        of, (bar("tool", (10, 0, 120), (10, 20, 60)),), (bar("table", (0, 0, -500), (9, 9, 9)),)
    )
    for share, loose in ((0.3, math.inf), (0.004, 3.0)):
        for pair in some(of, 20).reshape(10, 2, -1):
            rows = np.array([pair[0], pair[0] + (pair[1] - pair[0]) * share])
            fine = place_boxes(tested, np.linspace(rows[0], rows[1], 101))
            corners = fine.centres[..., None, :] + (
                SIGNS * tested.half[:, None]
            ) @ fine.axes.transpose(0, 1, 3, 2)
            ways = np.linalg.norm(np.diff(corners, axis=0), axis=-1).sum(axis=0).max(axis=1)
            bound = measure_moves(tested, rows)[0]
            assert (ways <= bound + 1e-9).all()
            assert (bound[ways > 0.1] <= loose * ways[ways > 0.1]).all()


def test_a_motion_agrees_with_every_fine_sample() -> None:
    """Random motions of an arm in a narrow cell: none is called free in which 400 samples find a hit a step deep."""
    of = find_robot("IRB 120")
    tool = (bar("tool", (0, 0, 60), (10, 10, 60)),)
    tested = make_scene(
        of,
        tool,
        (bar("beam", (250, 0, 700), (20, 300, 3)),),
        block((150, 150, 80)),
        translation(350, 0, 100),
    )
    joints = some(of, 80, 3)
    free = joints[find_collisions(tested, joints) < 0]
    verdicts = []
    for rows in zip(free[:-1:2], free[1::2], strict=False):
        course = check_motion(tested, np.array(rows), 2.0)
        samples = np.linspace(*rows, 400)
        deep = np.flatnonzero(find_collisions(tested, samples, -2.0) >= 0)
        shallow = find_collisions(tested, samples) >= 0
        verdicts.append(course.pair >= 0)
        assert course.pair >= 0 or not len(deep)
        if course.pair >= 0:
            assert (
                find_collisions(tested, rows[0][None] + (rows[1] - rows[0])[None] * course.at)[0]
                == course.pair
            )
            assert not len(deep) or course.at <= deep[0] / 399 + 1e-12
            assert course.at <= 1
        else:
            assert shallow.sum() < 20
    assert 5 < sum(verdicts) < len(verdicts) - 3


def test_what_is_not_looked_at_behind_a_hit_changes_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A wire before a thick wall, and motions through both from either side, and beside them."""
    wire, wall = (
        bar("wire", (560, 0, 450), (60, 0.05, 60)),
        bar("wall", (560, 150, 450), (60, 90, 60)),
    )
    tested = make_scene(rods(), obstacles=(wire, wall))
    rng = np.random.default_rng(11)
    several = []
    for start, end in rng.uniform(-60, 60, (40, 2, 2)).tolist():
        several.append(np.vstack([at(*start, 0, 0), at(*end, 0, 0)]))
    hasty = check_motions(tested, several, 0.5, 3.0)
    monkeypatch.setattr(motion_module, "_LONG", math.inf)
    patient = check_motions(tested, several, 0.5, 3.0)
    assert list(map(repr, hasty)) == list(map(repr, patient))
    met = [name_pair(tested, check.pair) for check in patient if check.hit]
    assert 5 < len(met) < 35
    assert {name.rpartition(" ")[2] for name in met} == {"wire", "wall"}


def test_a_wire_before_a_wall_is_the_first_hit_of_a_motion_through_both() -> None:
    """Half a step before the wire there is nothing."""
    tested = make_scene(
        rods(),
        obstacles=(
            bar("wire", (560, 0, 450), (60, 0.05, 60)),
            bar("wall", (560, 150, 450), (60, 90, 60)),
        ),
    )
    waypoints = np.vstack([at(0, -30, 0, 0), at(0, 40, 0, 0)])
    met = check_motion(tested, waypoints, 0.5)
    assert name_pair(tested, met.pair).endswith("wire")
    samples = np.linspace(*waypoints, 20_001)
    first = np.flatnonzero(find_collisions(tested, samples) >= 0)[0] / 20_000
    assert first <= met.at <= first + 0.5 / 275 / math.radians(70)


def test_growing_never_removes_a_hit() -> None:
    of = find_robot("VS-6556")
    tested = make_scene(
        of,
        (bar("tool", (0, 0, 60), (10, 10, 60)),),
        (),
        block((150, 150, 80)),
        translation(350, 0, 300),
    )
    joints = some(of, 300)
    found = [find_collisions(tested, joints, by) >= 0 for by in (0.0, 3.0, 30.0)]
    assert (found[0] <= found[1]).all()
    assert (found[1] <= found[2]).all()
    assert found[0].sum() < found[2].sum()


def test_boxes_are_where_their_links_are() -> None:
    tested = make_scene(
        rods(), (bar("tool", (0, 0, 50), (5, 5, 50)),), (bar("table", (9, 8, 7), (1, 2, 3)),)
    )
    placed = place_boxes(tested, at(0, 90, 10, 0))
    assert isinstance(placed, Boxes)
    middles = {tuple(np.round(centre, 6).tolist()) for centre in placed.centres[0]}
    assert middles == {(325.0, 137.5, 450.0), (325.0, 275.0, 387.0 - 10 - 50), (9.0, 8.0, 7.0)}


@pytest.mark.parametrize("name", ["IRB 2400", "COBOTTA", "Cobra s600", "3-axis mill"])
def test_no_box_comes_nearer_to_another_than_the_bound(name: str) -> None:
    """The corners of the farther box of each pair, seen from the link of the other one, over 100 parts of a stretch."""
    of = find_robot(name)
    tested = make_scene(
        of, (bar("tool", (10, 0, 120), (10, 20, 60)),), (bar("table", (0, 0, -500), (9, 9, 9)),)
    )
    first, second = tested.first, tested.second
    swapped = tested.frame[first] > tested.frame[second]
    near, far = np.where(swapped, second, first), np.where(swapped, first, second)
    moves = 0
    for pair in some(of, 20).reshape(10, 2, -1):
        fine = np.linspace(pair[0], pair[0] + (pair[1] - pair[0]) * 0.2, 101)
        rotations, origins = compute_link_frames(of, fine)
        placed = place_boxes(tested, fine)
        corners = placed.centres[..., None, :] + (
            SIGNS * tested.half[:, None]
        ) @ placed.axes.transpose(0, 1, 3, 2)
        link = tested.frame[near]
        seen = (corners[:, far] - origins[:, link][:, :, None]) @ rotations[:, link]
        ways = np.linalg.norm(np.diff(seen, axis=0), axis=-1).sum(axis=0).max(axis=1)
        serial = np.abs(np.diff(fine @ of.coupling.T, axis=0)).sum(axis=0)
        bound = serial @ bound_closing(tested, np.abs(fine @ of.coupling.T).max(axis=0))
        assert (ways <= bound + 1e-9).all()
        moves += int((ways > 1).sum())
    assert moves > 50


def test_a_cell_in_two_parts_collides_where_the_whole_does() -> None:
    of = find_robot("VS-6556")
    tools = (bar("tool", (0, 0, 60), (10, 10, 60)), bar("holder", (0, 0, 20), (40, 40, 20)))
    table = bar("table", (350, 0, 60), (200, 200, 9))
    tested = make_scene(of, tools, (table,), block((150, 150, 80)), translation(350, 0, 300))
    own = [k for k, pair in enumerate(tested.pairs) if "tool" in pair]
    rest = [k for k in range(len(tested.pairs)) if k not in own]
    joints = some(of, 300)
    whole = name_of(tested, joints)
    parts = [select_pairs(tested, pairs) for pairs in (own, rest)]
    names = [name_of(part, joints) for part in parts]
    assert [set(a) == {""} for a in zip(whole, strict=True)] == [
        a == b == "" for a, b in zip(*names, strict=True)
    ]
    assert all(one in (a, b) for one, a, b in zip(whole, *names, strict=True))
    assert all(any(found) for found in names)
    assert len(parts[0].frame) < len(tested.frame)
    nothing = select_pairs(tested, [])
    assert (find_collisions(nothing, joints) == -1).all()
    assert check_motion(nothing, joints[:2], 2.0, 5.0).clearance == 5.0


def test_the_tool_may_enter_the_part_and_its_holder_may_not() -> None:
    """The tool ends at z = 387 - 100 - 100, 1 mm within a plate; the holder, beside it, as far."""
    tool, holder = bar("tool", (0, 0, 50), (5, 5, 50)), bar("holder", (0, 30, 50), (5, 5, 50))
    plate = block((100, 100, 20))
    for tools, met in (((tool,), ""), ((tool, holder), "holder against part")):
        tested = make_scene(rods(), tools, (), plate, translation(600, 0, 178), Allowed(2.0))
        assert name_of(tested, at(0, 0, 100, 0)) == [met]
    assert name_of(
        make_scene(rods(), (tool,), (), plate, translation(600, 0, 178)), at(0, 0, 100, 0)
    ) == ["tool against part"]


def test_one_axis_is_asked_only_where_the_triangles_bound_a_body() -> None:
    """A box without its two faces across x, which says nothing of its borders: rays along x alone would miss it."""
    made = trimesh.creation.box((40, 40, 40))
    along = np.abs(made.face_normals[:, 0]) < 0.5
    for faces, closed in (
        (made.faces, True),
        (made.faces[along], False),
        (made.faces[:, ::-1], True),
    ):
        normals = frozen(np.zeros((len(faces), 3)))
        mesh = make_mesh(
            Solid(
                "b",
                "b",
                "mm",
                frozen(made.vertices),
                np.asarray(faces, np.int64),
                normals,
                (),
                (),
                (),
            )
        )
        assert mesh.closed == closed
        points = np.array([[3.0, 4.0, 5.0], [30.0, 0.0, 0.0], [3.0, 4.0, 25.0]])
        assert are_inside(mesh, points).tolist() == [True, False, False]
    loose = made.vertices[made.faces].reshape(-1, 3)
    apart = np.arange(len(loose)).reshape(-1, 3)
    mesh = make_mesh(
        Solid("b", "b", "mm", frozen(loose), apart, frozen(made.face_normals), (), (), ())
    )
    assert not mesh.closed
    assert are_inside(mesh, np.array([[3.0, 4.0, 5.0]])).tolist() == [True]


def two_bars() -> Scene:
    """A flat arm with a bar on its first link, from axis 1 to x = 600, and the rod of the second one beside it."""
    arm = rods()
    bars = (
        arm.links[0],
        bar("link 1", (300, 0, 0), (300, 1, 1)),
        bar("link 2", (137.5, 0, 0), (137.5, 1, 1)),
    )
    return make_scene(replace(arm, links=(*bars, *arm.links[3:]), touching=()))


def test_what_carries_two_bodies_along_brings_them_no_nearer() -> None:
    tested = two_bars()
    only = select_pairs(tested, [tested.pairs.index(("link 1", "link 2"))])
    turned, still = at(20, 30, 10, 0), at(0, 30, 10, 0)
    assert measure_apart(only, still, turned) > 2 * 590 * math.sin(math.radians(10))
    assert measure_closer(only, still, turned) == pytest.approx([0.0], abs=1e-9)


def test_two_bodies_that_move_against_each_other_come_nearer_by_what_both_are_off() -> None:
    """The first link turns by 0.1 deg and the second one by 0.4 deg back: the end of the first, 600 mm from axis 1, is
    off by 600 x 0.1 deg and that of the second, 275 mm from axis 2, by 275 x 0.4 deg as the first one sees it.
    """
    tested = two_bars()
    only = select_pairs(tested, [tested.pairs.index(("link 1", "link 2"))])
    one, other = at(0, 10, 0, 0), at(0.1, 9.6, 0, 0)
    off, closer = (
        float(measure_apart(only, one, other)[0]),
        float(measure_closer(only, one, other)[0]),
    )
    assert off == pytest.approx(600 * math.radians(0.1), rel=0.01)
    assert closer == pytest.approx(275 * math.radians(0.4), rel=0.02)
    assert closer > 1.8 * off


@pytest.mark.parametrize("name", ["IRB 120", "IRB 2400", "Cobra s600", "VS-6577"])
def test_no_two_bodies_come_nearer_than_is_measured(name: str) -> None:
    arm = find_robot(name)
    held = Link("tool", (Box(translation(0, 0, 80), (30, 20, 80)),))
    table = Link("table", (Box(translation(300, 0, -200), (500, 500, 50)),))
    tested = make_scene(arm, (held,), (table,), (Box(translation(300, 0, -100), (50, 50, 50)),))
    rng = np.random.default_rng(1)
    one = some(arm, 400)
    other = one + rng.normal(0, 0.01, one.shape)
    for k in range(len(tested.pairs)):
        only = select_pairs(tested, [k])
        # As far as is looked, two that move are not farther apart than the arm is long.
        far = [measure_clearance(only, joints, 2000.0) for joints in (one, other)]
        free = far[0] > 0
        assert (far[0] - far[1] <= measure_closer(only, one, other) + 1e-6)[free].all()
